"""A planner above and an agent below: the agent that ships drives to a point ahead on the scan planner's way."""

import dataclasses
import functools
from typing import Any

import numpy as np
from numpy.typing import NDArray

from wayfield.envs.goal_reaching import Observation
from wayfield.envs.tasks.briefing import Briefing
from wayfield.policies.learned.agent import Agent, body_of
from wayfield.policies.parts.gain import gain
from wayfield.policies.parts.laws import GoalLaw
from wayfield.policies.parts.polyline_tracker import point_at, project
from wayfield.policies.parts.tuned import tuned_set
from wayfield.policies.scans.scan_planner import ScanPlanner
from wayfield.policies.trained.ppo import shipped_agent
from wayfield.system.checks import LAST_SEED
from wayfield.system.compiled import any_layout, compiled
from wayfield.system.elementary import sin_cos

TASK, SUITE = "goal_reaching", "goal-obstacles"
Array = NDArray[np.float64]
Memory = NDArray[Any]
Both = tuple[Array, Array]  # the planner's and the agent's


@dataclasses.dataclass(frozen=True)
class Hybrid(GoalLaw):
    """Plans as `scan_planner` does and drives as the goal seeker of its seed that ships: each does what it is good at.

    In every step the planner enters the scan in its map and plans where it must. In place of the goal the agent gets
    the point `ahead` further on along that way, as a waypoint, and once the way left is shorter, or where there is
    none, the goal itself; its twist is driven. So the planner's map leads out of dead ends and around what is out of
    sight, and the network sees to what moves and to what is near. What the agent remembers of a goal that it comes no
    nearer to, it does not of a point that moves on with it. The planner takes the agent's command as its own
    command.

    Nothing was trained for it: the agent is the one of `ppo`, the planner has the gains tuned for the robot, or its own
    where none were found to be better. Serves the robots that goal seekers ship for, and sees what those see. Limits: a
    point that the planner leads around a mover with moves on as it plans anew, which takes from what the network knows
    of crowds; the agents drive omni bases as differential drives, where the planner alone is beaten by seconds among
    what moves and not among what stands.

    Source: waypoints of a planner for a learned local planner, as in Faust et al., "PRM-RL: Long-range robotic
    navigation tasks by combining reinforcement learning and sampling-based planning", ICRA 2018; here on a map of its
    own scans.
    """

    seed: int = gain(0, "1", "of the agent's training run", most=LAST_SEED)
    speed: float = gain(0.0, "m/s", "the most that it drives; 0: the one that the agent was validated at", least=0.0)
    ahead: float = gain(1.2, "m", "of the point on the plan that the agent drives to", above=0.0)

    def agent(self, briefing: Briefing) -> Agent:
        """Returns the agent that drives.

        Raises:
            ValueError: if none ships for the robot, or none of this seed.
        """
        return shipped_agent(TASK, body_of(briefing.robot).name, self.seed, self.speed)

    def planner(self, briefing: Briefing, agent: Agent) -> ScanPlanner:
        """Returns the planner, which drives as fast as the agent."""
        return planner_of(body_of(briefing.robot).name, agent.speed)

    def reset(self, briefing: Briefing) -> NDArray[Any]:
        """Returns the planner's empty memory beside the agent's, (b,).

        Raises:
            ValueError: if no agent ships for robot and seed, or its card needs another scan or control period.
        """
        parts = self.parts(briefing)
        fields: list[Any] = [(name, each.dtype, each.shape[1:]) for name, each in parts.items()]
        # whole words a robot, so that every map begins with one; by a field, as what only pads is not copied with a row
        if spare := -np.dtype(fields).itemsize % 8:
            fields.append(("spare", np.uint8, (spare,)))
        memory: NDArray[Any] = np.zeros(briefing.num_envs, fields)
        for name, each in parts.items():
            memory[name] = each
        return memory

    def parts(self, briefing: Briefing) -> dict[str, NDArray[Any]]:
        """Returns the empty memories (b,) of which that of `reset` is made."""
        agent = self.agent(briefing)
        return {"planner": self.planner(briefing, agent).reset(briefing), "agent": agent.reset(briefing)}

    def act(self, observation: Observation, briefing: Briefing, memory: NDArray[Any]) -> Array:
        """Returns the twists (b, t), m/s and rad/s."""
        agent = self.agent(briefing)
        # the planner's kernels take records that lie apart; the agent's are compiled for such as lie side by side
        planned, retained = memory["planner"], memory["agent"].copy()
        own = self.planner(briefing, agent).act(observation, briefing, planned)
        goals, led = observation.goal.copy(), np.zeros(len(memory), np.bool_)
        lead(planned["state"], observation.pose, self.ahead, goals, led)
        seen = retained["network"] if "network" in (retained.dtype.names or ()) else retained
        if "least" in (seen.dtype.names or ()):
            seen["least"][led] = seen["distance"][led] = np.hypot(goals[led, 0], goals[led, 1])
            seen["waited"][led] = 0.0
        left = np.where(led, np.maximum(observation.waypoints_left, 1.0), observation.waypoints_left)
        twists = agent.act(observation._replace(goal=goals, waypoints_left=left), briefing, retained)
        twists = self.taken(observation, briefing, memory, retained, (own, twists))
        planned["state"]["command"][:, briefing.robot.twist_axes] = twists
        memory["agent"] = retained
        return twists

    def taken(
        self, observation: Observation, briefing: Briefing, memory: Memory, retained: Memory, twists: Both
    ) -> Array:
        """Returns the twists (b, t) that are driven, here the agent's.

        Args:
            memory: that of `reset`, in which the planner has decided and the agent has not.
            retained: (b,) what the agent remembers of its decision.
            twists: the planner's and the agent's, m/s and rad/s.
        """
        return twists[1]


@functools.lru_cache(maxsize=64)
def planner_of(robot: str, speed: float) -> ScanPlanner:
    """Returns the planner at a cruising speed (m/s), with the gains tuned for a robot where there are better ones."""
    result = tuned_set("scan_planner", SUITE, robot)
    return ScanPlanner(**{**(result.gains if result else {}), "max_speed": speed})


@any_layout
@compiled
def lead(memory, poses, ahead, goals, led):
    """Puts points ahead (m) on the ways of the planner's memory (b,) in place of goals (b, 2), m, body frame.

    led (b,) becomes true where that was done: not where there is no way, nor where less of it is left.
    """
    for i in range(goals.shape[0]):
        m = memory[i]
        if m.num_points < 2 or m.arrived == 1:
            continue
        x = poses[i, 0]
        y = poses[i, 1]
        s, _, _ = project(m, x, y)
        if m.arc[m.num_points - 1] - s <= ahead:
            continue
        px, py = point_at(m, m.segment, s + ahead)
        sine, cosine = sin_cos(poses[i, 2])
        goals[i, 0] = cosine * (px - x) + sine * (py - y)
        goals[i, 1] = cosine * (py - y) - sine * (px - x)
        led[i] = True
