"""A driver to goals for every robot: the agent of its kinematic class below a planner, behind the shield."""

import dataclasses
import functools
from typing import Any

import numpy as np
from numpy.typing import NDArray

from wayfield.envs.robots import Robot
from wayfield.envs.tasks.briefing import Briefing
from wayfield.policies.gain import gain
from wayfield.policies.hybrid import TASK, Hybrid
from wayfield.policies.learned.agent import Agent
from wayfield.policies.learned.features_sheet import TOP
from wayfield.policies.learned.ppo import shipped, shipped_agent
from wayfield.policies.parts.shield import Shielded
from wayfield.policies.scan_planner import ScanPlanner

KINDS = {2: "any_diff_drive", 3: "any_omni"}  # by the number of twist components


@dataclasses.dataclass(frozen=True)
class AnyRobot(Hybrid):
    """Drives any base to a goal by its data sheet: a sheet in, a driver out.

    The agent of the seed that ships for every robot of the kinematic class (`SheetFeatures`) drives, as in `Hybrid`, to
    a point ahead on the way of the scan planner with its default gains; or alone, to the goal, with `ahead` 0. Where no
    agent ships for the class, or the scan is not one that it can read, the planner drives. Behind them stands, always,
    a `Shield`, which knows the base's accelerations and lag and how far its beams stand apart.

    It asks for no more than 0.95 of what the base can drive. Needs a scan of half a turn or more.
    """

    speed: float = gain(0.6, "m/s", "the most that it drives, where the base can", above=0.0)
    ahead: float = gain(1.2, "m", "of the point on the plan that the agent drives to; 0: it drives alone", least=0.0)

    def agent(self, briefing: Briefing) -> Agent:
        """Returns the agent of the kinematic class.

        Raises:
            ValueError: if none ships for it, or none of this seed.
        """
        robot = briefing.robot
        return shipped_agent(TASK, KINDS[len(robot.twist_axes)], self.seed, self._speed(robot))

    def planner(self, briefing: Briefing, agent: Agent) -> ScanPlanner:
        """Returns the planner, which drives as fast as the agent."""
        return ScanPlanner(max_speed=agent.speed)

    def _speed(self, robot: Robot) -> float:
        return min(self.speed, TOP * float(robot.max_twist[0]))

    def _alone(self, briefing: Briefing) -> Agent | Shielded | None:
        """Returns what drives without the other; none where they drive together."""
        if agents_of(briefing.robot):
            agent = self.agent(briefing)
            try:
                agent.features.check(briefing)
            except ValueError:  # it cannot read the scan
                pass
            else:
                return None if self.ahead else agent
        return _planner(self._speed(briefing.robot))

    def reset(self, briefing: Briefing) -> NDArray[Any]:
        """Returns the empty memory of what drives.

        Raises:
            ValueError: if the scan looks at less than half a turn, or none of the agents that ship has this seed.
        """
        alone = self._alone(briefing)
        return super().reset(briefing) if alone is None else alone.reset(briefing)

    def act(self, observation: Any, briefing: Briefing, memory: NDArray[Any]) -> NDArray[np.float64]:
        """Returns the twists (b, t), m/s and rad/s."""
        alone = self._alone(briefing)
        return super().act(observation, briefing, memory) if alone is None else alone.act(observation, briefing, memory)


@functools.lru_cache(maxsize=64)
def agents_of(robot: Robot) -> tuple[int, ...]:
    """Returns the seeds of the agents that ship for every robot of the kinematic class of one."""
    return tuple(shipped(TASK, KINDS[len(robot.twist_axes)]))


@functools.lru_cache(maxsize=64)
def _planner(speed: float) -> Shielded:
    return Shielded(ScanPlanner(max_speed=speed))
