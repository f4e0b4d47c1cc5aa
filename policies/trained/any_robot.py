"""A driver to goals for every robot: the agent of its kinematic class below a planner, behind the shield."""

import dataclasses
import functools
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from wayfield.envs.goal_reaching import Observation
from wayfield.envs.robots import Robot
from wayfield.envs.tasks.briefing import Briefing
from wayfield.policies.learned.agent import Agent
from wayfield.policies.learned.features_sheet import TOP
from wayfield.policies.parts.gain import gain
from wayfield.policies.parts.shield import Shield, Shielded
from wayfield.policies.parts.stopping import Scan, find_approached
from wayfield.policies.parts.tuned import tuned_gains
from wayfield.policies.scans.scan_planner import BESIDE, RECALL, ScanPlanner, fills_doors
from wayfield.policies.trained.hybrid import SUITE, TASK, Array, Both, Hybrid, Memory
from wayfield.policies.trained.ppo import shipped, shipped_agent

KINDS = {2: "any_diff_drive", 3: "any_omni"}  # by the number of twist components
PROGRESS = np.dtype(
    [
        ("least", np.float64),  # m, of the way left so far
        ("stood", np.float64),  # s, since that became less, or something came nearer by itself
        ("approached", np.int64),  # control periods in a row in which something came nearer by itself
    ]
)
PACE = 0.6  # m/s, from which on patience is as long as it says
WAY = 0.1  # m, by which the way left becomes less
APPROACHED = 4  # such periods until that is believed: a single one is often noise, or a corner between two beams
BEHIND_PLANNER = Shield(spread=0.3)
IN_DOORS = Shield(spread=0.3, beside=BESIDE)  # behind the planner of a hull that may fill a door


@dataclasses.dataclass(frozen=True)
class AnyRobot(Hybrid):
    """Drives any base to a goal by its data sheet: a sheet in, a driver out.

    The agent of the seed that ships for every robot of the kinematic class (`SheetFeatures`) drives, as in `Hybrid`, to
    a point ahead on the way of the scan planner with its default gains, or those tuned for the robot at the speed
    `planned`; or alone, to the goal, with `ahead` 0. Where no agent ships for the class, or the scan is not one that it
    can read, the planner drives. Behind them stands, always, a `Shield`, which knows the base's accelerations and lag
    and how far its beams stand apart.

    When for `patience` the way left has not become less, by 0.1 m, and nothing has come nearer by itself (a surface, as
    `find_approaching` sees it, in four control periods in a row), the planner drives by itself until something does:
    among what stands still it makes its way where the agent stands, and among what moves the agent is the better one.
    The planner's map remembers what stands between the beams, so that the shield behind it grows hits by 0.3 of what it
    does behind the agent, to which the narrowest doors are shut with few beams. A round hull of 0.35 m and more may
    fill such a door: the shield behind its planner keeps the posts in mind (`Shield.beside`). What it costs: the wait
    itself, and that the planner drives among what moves, where it is worse, as long as nothing is seen to come nearer.
    Behind a planner without `foresight` nothing counts as coming nearer.

    It asks for no more than 0.95 of what the base can drive. Needs a scan of half a turn or more.
    """

    speed: float = gain(0.6, "m/s", "the most that it drives, where the base can", above=0.0)
    ahead: float = gain(1.2, "m", "of the point on the plan that the agent drives to; 0: it drives alone", least=0.0)
    patience: float = gain(
        3.0, "s", "without way made at 0.6 m/s, longer for a slower one; then the planner drives; 0: never", least=0.0
    )
    planned: float = gain(0.0, "m/s", "that the planner's gains were tuned for; 0: its default ones", least=0.0)

    def agent(self, briefing: Briefing) -> Agent:
        """Returns the agent of the kinematic class.

        Raises:
            ValueError: if none ships for it, or none of this seed.
        """
        robot = briefing.robot
        return shipped_agent(TASK, KINDS[len(robot.twist_axes)], self.seed, self._speed(robot))

    def planner(self, briefing: Briefing, agent: Agent) -> ScanPlanner:
        """Returns the planner, which drives as fast as the agent.

        Raises:
            NotTuned: if none was tuned for the robot at `planned`.
        """
        return _planner(briefing.robot.name, agent.speed, self.planned)

    def parts(self, briefing: Briefing) -> dict[str, NDArray[Any]]:
        """Returns the empty memories (b,) of planner, agent and progress."""
        progress = np.zeros(briefing.num_envs, PROGRESS)
        progress["least"] = np.inf
        return super().parts(briefing) | {"progress": progress}

    def taken(
        self, observation: Observation, briefing: Briefing, memory: Memory, retained: Memory, twists: Both
    ) -> Array:
        """Returns the twists (b, t) that are driven: the agent's, or where it makes no way the planner's."""
        planned, driven = twists
        alone = self._by_planner(observation, briefing, memory)
        if not alone.any():
            return driven
        shields = memory["agent"]["shield"].copy()
        behind = IN_DOORS if fills_doors(briefing.robot) else BEHIND_PLANNER
        passed = behind.passed(observation, briefing, shields, planned)
        retained["shield"][alone] = shields[alone]
        return np.where(alone[:, None], passed, driven)

    def _by_planner(self, observation: Observation, briefing: Briefing, memory: NDArray[Any]) -> NDArray[np.bool_]:
        """Returns which robots (b,) the planner drives by itself, and notes what decides that."""
        if not self.patience:
            return np.zeros(len(memory), np.bool_)
        # a slow robot makes way as far in a longer time
        patience = self.patience * max(1.0, PACE / self._speed(briefing.robot))
        progress, planner = memory["progress"], memory["planner"]
        seen = np.zeros(len(memory), np.bool_)
        if _planner(briefing.robot.name, self._speed(briefing.robot), self.planned).foresight:
            scan = Scan.of(self, observation, briefing, planner)
            ages = planner["state"]["older_age"]
            find_approached(scan, observation.pose, ages, briefing.robot.hull_radius, seen)
        progress["approached"] = np.where(seen, progress["approached"] + 1, 0)
        left = way_left(planner["state"], observation.goal)
        made = left < progress["least"] - WAY
        progress["least"][made] = left[made]
        # once the planner drives, the way that it makes does not call it off
        begins = (made & (progress["stood"] <= patience)) | (progress["approached"] >= APPROACHED)
        progress["stood"] = np.where(begins, 0.0, progress["stood"] + briefing.dt)
        alone: NDArray[np.bool_] = progress["stood"] > patience
        return alone

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
        return _shielded(briefing.robot.name, self._speed(briefing.robot), self.planned)

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


def way_left(planned: NDArray[Any], goals: NDArray[np.float64]) -> NDArray[np.float64]:
    """Returns the way left (b,), m, on the planner's plans, or straight to the goals (b, 2), m, where there is none."""
    rows, last = np.arange(len(goals)), np.maximum(planned["num_points"] - 1, 0)
    left = planned["arc"][rows, last] - planned["arc"][rows, planned["segment"]]
    return np.where(last > 0, left, np.hypot(goals[:, 0], goals[:, 1]))


@functools.lru_cache(maxsize=64)
def agents_of(robot: Robot) -> Mapping[int, Path]:
    """Returns the folders of the agents that ship for every robot of the kinematic class of one, by seed."""
    return shipped(TASK, KINDS[len(robot.twist_axes)])


@dataclasses.dataclass(frozen=True)
class _Planner(ScanPlanner):
    """The planner below an agent: the shield behind them remembers hits for longer than it needs to."""

    def recall(self, robot: Robot) -> float:
        return RECALL


@functools.lru_cache(maxsize=64)
def _planner(robot: str, speed: float, planned: float) -> ScanPlanner:
    result = tuned_gains("scan_planner", SUITE, robot, planned) if planned else {}
    return _Planner(**{**result, "max_speed": speed})


@functools.lru_cache(maxsize=64)
def _shielded(robot: str, speed: float, planned: float) -> Shielded:
    return Shielded(_planner(robot, speed, planned))
