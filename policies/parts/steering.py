"""Paths, maps and goals of a briefing as bundles of arrays, and the twist that a base can drive."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from wayfield.envs import path_following
from wayfield.envs.robots import Robot
from wayfield.envs.tasks.briefing import Briefing
from wayfield.envs.world.grids import NO_GRIDS, frames_of
from wayfield.envs.world.patrols import PATROL
from wayfield.system.elementary import bearings

Array = NDArray[np.float64]


class Course(NamedTuple):
    """The paths of b robots, as compiled laws take them."""

    vertices: NDArray[np.void]
    runs: NDArray[np.void]
    path_index: NDArray[np.int64]  # (b,) the run of each robot

    @classmethod
    def of(cls, briefing: Briefing) -> "Course":
        """Returns the paths of a briefing that has them."""
        assert briefing.paths is not None
        assert briefing.path_index is not None
        return cls(briefing.paths.vertices, briefing.paths.runs, briefing.path_index)


class Motion(NamedTuple):
    """What b path followers observe of themselves."""

    poses: Array  # (b, 3) m, rad
    twists: Array  # (b, t) m/s and rad/s
    arc_lengths: Array  # (b,) m, of the projection on the path

    @classmethod
    def of(cls, observation: path_following.Observation) -> "Motion":
        """Returns the fields of an observation."""
        return cls(observation.pose, observation.twist, observation.arc_length)


class Map(NamedTuple):
    """The obstacles around b robots, standing and moving; `Briefing` says what each array holds."""

    obstacles: NDArray[np.void]
    counts: NDArray[np.int64]  # of the obstacles
    patrols: NDArray[np.void]
    goals: Array
    num_goals: NDArray[np.int64]
    frames: NDArray[np.void]  # of the grids
    cells: NDArray[np.uint8]

    @classmethod
    def of(cls, briefing: Briefing) -> "Map":
        """Returns the map of a briefing that has it."""
        assert briefing.obstacles is not None
        assert briefing.num_obstacles is not None
        assert briefing.goals is not None
        assert briefing.num_goals is not None
        patrols = np.zeros(briefing.obstacles.shape, PATROL) if briefing.patrols is None else briefing.patrols
        grids = briefing.grids or frames_of(NO_GRIDS, np.zeros(briefing.num_envs, np.int64))
        return cls(briefing.obstacles, briefing.num_obstacles, patrols, briefing.goals, briefing.num_goals, *grids)


class Goals(NamedTuple):
    """The waypoints and goals of b robots."""

    goals: Array  # (b, m, 3)
    num_goals: NDArray[np.int64]

    @classmethod
    def of(cls, briefing: Briefing) -> "Goals":
        """Returns the goals of a briefing that has them."""
        assert briefing.goals is not None
        assert briefing.num_goals is not None
        return cls(briefing.goals, briefing.num_goals)


def unicycle_twists(robot: Robot, speed: Array, yaw_rate: Array) -> Array:
    """Returns the twists (b, t) of a law that drives forward and turns; an omni base is driven the same way.

    Args:
        speed: (b,) m/s.
        yaw_rate: (b,) rad/s.
    """
    twists = np.zeros((len(speed), 3 if robot.holonomic else 2))
    twists[:, 0] = speed
    twists[:, -1] = yaw_rate
    return twists


def velocity_twists(robot: Robot, velocity: Array, turn: Array, turn_gain: float) -> Array:
    """Returns the twists (b, t) of a law that asks for a planar velocity.

    An omni base drives it as it is and turns by `turn`. A differential drive cannot go sideways: it turns towards the
    velocity with yaw rate turn_gain * error and drives forward with the part of it that lies ahead, v = |u| max(cos
    error, 0), so that it turns on the spot while the velocity points behind it.

    Args:
        velocity: (b, 2) wanted velocity u in the body frame, m/s.
        turn: (b,) rad by which an omni base shall turn; a differential drive has no say in it.
        turn_gain: 1/s.
    """
    if robot.holonomic:
        return np.column_stack([velocity, turn_gain * turn])
    speed = np.sqrt(velocity[:, 0] * velocity[:, 0] + velocity[:, 1] * velocity[:, 1])
    error = bearings(velocity[:, 1], velocity[:, 0])
    error[speed < 1e-9] = 0.0
    return np.column_stack([np.maximum(velocity[:, 0], 0.0), turn_gain * error])
