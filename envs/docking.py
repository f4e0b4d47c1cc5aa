"""Docking: come to rest at a pose, forward or backward, in the open, at a wall, between boxes, past what moves."""

import dataclasses
from typing import Any

import numpy as np
from numpy.typing import NDArray

from wayfield.envs import goal_reaching
from wayfield.envs.goal_reaching import DiffDriveGoalObstacles, GoalArguments, GoalReaching, OmniGoalObstacles
from wayfield.envs.scenarios import TASKS
from wayfield.envs.tasks.arguments import argument
from wayfield.envs.tasks.sheets import sheet_like
from wayfield.envs.vector import vector_of

_LEAST_FRAME = 3.0  # m


@dataclasses.dataclass(frozen=True)
class Params(goal_reaching.Params):
    """The numbers of the task: a turn counts for more than among obstacles, and at the goal the robot must rest."""

    heading_weight: float = 0.3  # m/rad
    rest_speed: float = 0.02  # m/s
    rest_yaw_rate: float = 0.05  # rad/s


class Docking(GoalReaching):
    """The docking task of one robot on a bank of poses: goal reaching that ends at rest."""

    belongs_to = TASKS["docking"]
    numbers = Params

    def drawing(self, state: NDArray[np.void]) -> dict[str, Any]:
        """Returns what a frame shows of the task, as fields of `rendering.Scene`; no frame is smaller than 3 by 3 m."""
        drawn = super().drawing(state)
        x0, y0, x1, y1 = drawn["bounds"]
        x, y = 0.5 * max(_LEAST_FRAME - (x1 - x0), 0.0), 0.5 * max(_LEAST_FRAME - (y1 - y0), 0.0)
        return drawn | {"bounds": (x0 - x, y0 - y, x1 + x, y1 + y)}


_REWARDS = """
    With `progress` (decrease of `remaining_distance`), `turn_progress` (decrease of |goal_heading_error|), `success`
    and `collision` of info:

        reward = progress + 0.3 turn_progress - 0.01 + 5 success - 5 collision

    The first two are differences of a potential, so that a way there and back earns nothing, and to back off for a
    better approach costs only its time.
"""
_STARTING_STATE = """
    At rest at the scenario's start, at most 3 m from the goal in the random families, displaced by uniform draws from
    +-`start_offset` in x and y (not where that would touch an obstacle) and turned by one from +-`start_turn`. A family
    such as "open" draws one of 64 scenarios, "all" one of those of all five; `reset(options={"scenario": k})` starts
    the k-th instead, and draws all else as without it. In "wall" and "berth" what the robot docks at stands as near to
    its hull as the family says, whatever the robot.
"""
_EPISODE_END = """
    Terminated in success when the pose is within the scenario's tolerance of the goal, 0.05 m and 0.05 rad in the
    families, the speed at most 0.02 m/s and the yaw rate at most 0.05 rad/s; in failure when the hull touches an
    obstacle, in front of which the kinematic robot stops, or when a moving obstacle runs into the hull, which makes
    `clearance` negative. Truncated after 1200 steps (60 s). `end_on_success=False` runs on, to show station keeping,
    and pays the success reward at every step at rest within tolerance; `end_on_contact=False` (pymunk) survives
    contact.
"""


@dataclasses.dataclass(frozen=True, kw_only=True)
class DockingArguments(GoalArguments):
    """What an environment of docks takes."""

    scenario: Any = argument(
        "all", 'the families, or one: "open", "behind", "wall", "berth", "moving" ("wall/train"); "sideways"; a file'
    )


class OmniDocking(OmniGoalObstacles):
    __doc__ = sheet_like(
        OmniGoalObstacles,
        "An omni robot comes to rest at a pose.",
        {
            "Description": """
                A holonomic robot with three omni wheels (document B: wheel radius 0.075 m on a circle of 0.3 m), four
                (document C: 0.03 m on 0.13 m) or four mecanum wheels (0.05 m) shall come to rest at a pose from close
                by: in the open, with its back to a wall, between two boxes, or past a disc that moves. Control period
                0.05 s. The hull is a disc: 0.3 m for omni3, 0.177 m for omni4, 0.27 m for mecanum4.
            """,
            "Rewards": _REWARDS,
            "Starting state": _STARTING_STATE,
            "Episode end": _EPISODE_END,
        },
        arguments=DockingArguments,
        holonomic=True,
    )

    arguments = DockingArguments
    asks = Docking


OmniDockingVector = vector_of(OmniDocking)


class DiffDriveDocking(OmniDocking):
    __doc__ = sheet_like(
        DiffDriveGoalObstacles,
        "A Pioneer P3DX comes to rest at a pose.",
        {
            "Description": """
                A differential-drive robot (document A: wheel radius 0.0975 m, half track 0.1905 m, rim speed at most
                1.2 m/s), which cannot go sideways, shall come to rest at a pose from close by, forward or backward: in
                the open, with its back to a wall, between two boxes, or past a disc that moves. No smooth feedback of
                the pose alone can do it (Brockett, 1983). Control period 0.05 s. The hull is a disc of 0.25 m.
            """,
            "Rewards": _REWARDS,
            "Starting state": _STARTING_STATE,
            "Episode end": _EPISODE_END,
        },
        arguments=DockingArguments,
        holonomic=False,
    )

    robots = DiffDriveGoalObstacles.robots


DiffDriveDockingVector = vector_of(DiffDriveDocking)
