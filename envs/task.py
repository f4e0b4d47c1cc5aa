"""What a task is made of, and the options that all tasks share."""

import abc
import dataclasses
import difflib
import math
from collections.abc import Callable, Iterable
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from wayfield.envs import records
from wayfield.envs.disturbances import DISTURBANCES, Disturbance
from wayfield.envs.observation import Layout
from wayfield.envs.robots import ACTUATORS, ROBOTS, Actuators, Robot

# The phases of a step. The kinematic plant runs all three in one compiled call; another plant drives in between.
COMMAND = 1  # action to the twist asked of the wheels
DRIVE = 2  # motion
JUDGE = 4  # observation, reward, end

CONTROL_PERIOD = 0.05  # s


@dataclasses.dataclass(frozen=True)
class Options:
    """The options of every task, looked up and checked."""

    robot: Robot
    dynamics: str
    actuators: Actuators
    action_mode: str
    noise: float
    pose_source: str
    shove: tuple[float, float, float, float] | None
    disturbance: Disturbance
    dt: float = CONTROL_PERIOD

    @classmethod
    def of(
        cls,
        robot: str,
        robots: tuple[str, ...],
        dynamics: str,
        actuators: str,
        action_mode: str,
        noise: float,
        pose_source: str,
        shove: tuple[float, float, float, float] | None,
        disturbance: str,
    ) -> "Options":
        """Returns the options of the given names.

        Args:
            robots: the names that the environment offers.
            shove: (time s, dx m, dy m, turn rad): the pose is displaced by this at that time, in the world frame.

        Raises:
            ValueError: if a name is unknown or a number out of range; the message names the field and the choices.
        """
        choose("robot", robot, robots)
        choose("dynamics", dynamics, ("kinematic", "pymunk"))
        choose("actuators", actuators, tuple(ACTUATORS))
        choose("action_mode", action_mode, ("twist", "wheel_speeds"))
        choose("pose_source", pose_source, records.POSE_SOURCES)
        choose("disturbance", disturbance, DISTURBANCES)
        if isinstance(noise, bool) or not isinstance(noise, int | float) or not 0.0 <= noise < math.inf:
            raise ValueError(f"noise must be a finite number >= 0 (0 is none, 1 nominal), got {noise!r}")
        if shove is not None:
            try:
                values = np.asarray(shove, dtype=np.float64)
            except (TypeError, ValueError):
                values = np.empty(0)
            if values.shape != (4,) or not np.isfinite(values).all() or values[0] < 0.0:
                raise ValueError(f"shove must be (time >= 0, dx, dy, turn), four finite numbers, got {shove!r}")
            shove = (float(values[0]), float(values[1]), float(values[2]), float(values[3]))
        return cls(
            ROBOTS[robot],
            dynamics,
            ACTUATORS[actuators],
            action_mode,
            float(noise),
            pose_source,
            shove,
            DISTURBANCES[disturbance],
        )

    def robot_params(self) -> dict[str, Any]:
        """Returns the values of records.ROBOT_PARAMS, but for the beams."""
        return records.robot_params(
            self.robot,
            self.actuators,
            dt=self.dt,
            action_mode=self.action_mode,
            pose_source=self.pose_source,
            noise=self.noise,
            shove=self.shove,
            disturbance=self.disturbance,
        )

    @property
    def max_action(self) -> NDArray[np.float64]:
        """Returns the bound of the action space, (a,): m/s and rad/s, or rad/s of each wheel."""
        if self.action_mode == "twist":
            return self.robot.max_twist
        return np.full(len(self.robot.wheel_matrix), self.robot.rated_wheel_speed)


def choose(field: str, value: str, choices: Iterable[str]) -> None:
    """Raises ValueError, naming the field and the nearest choice, unless the value is one of the choices."""
    choices = tuple(choices)
    if value in choices:
        return
    near = difflib.get_close_matches(str(value), choices, 1)
    hint = f" Did you mean {near[0]!r}?" if near else ""
    raise ValueError(f"{field}={value!r} is unknown.{hint} Choose from {', '.join(map(repr, choices))}.")


def whole(field: str, value: int, least: int) -> None:
    """Raises ValueError, naming the field, unless the value is a whole number of at least `least`."""
    if isinstance(value, bool) or not isinstance(value, int | np.integer) or value < least:
        raise ValueError(f"{field} must be a whole number >= {least}, got {value!r}")


def positive(field: str, value: float) -> None:
    """Raises ValueError, naming the field, unless the value is a finite number above 0."""
    if isinstance(value, bool) or not isinstance(value, int | float | np.number) or not 0.0 < value < math.inf:
        raise ValueError(f"{field} must be a finite number > 0, got {value!r}")


def truth(field: str, value: bool) -> None:
    """Raises ValueError, naming the field, unless the value is True or False."""
    if not isinstance(value, bool | np.bool_):
        raise ValueError(f"{field} must be True or False, got {value!r}")


class Task(abc.ABC):
    """A task: its records, its compiled step over all robots, and the bank of scenarios it draws from.

    The compiled functions take the arrays that `Batch` passes, then those of `world`, which describe the bank.
    """

    state_dtype: ClassVar[np.dtype[np.void]]
    info_names: ClassVar[tuple[str, ...]]
    flag_names: ClassVar[tuple[str, ...]]
    draws: ClassVar[int]
    step_rows: ClassVar[Callable[..., int]]
    reset_rows: ClassVar[Callable[..., None]]

    scenarios: tuple[Any, ...]
    options: Options
    robot: Robot
    layout: Layout[Any]
    params: NDArray[np.void]
    world: tuple[NDArray[Any], ...]
    beam_angles: NDArray[np.float64]
    max_obstacles: int
    patrols: NDArray[np.void]  # (scenarios, max_obstacles) PATROL records; (scenarios, 0) where nothing moves

    @property
    def num_beams(self) -> int:
        """Returns how many beams the range scan has."""
        return len(self.beam_angles)

    @abc.abstractmethod
    def obstacle_counts(self, states: NDArray[np.void]) -> NDArray[np.int64]:
        """Returns how many obstacles each robot has around it."""

    @abc.abstractmethod
    def drawing(self, state: NDArray[np.void]) -> dict[str, Any]:
        """Returns what a frame shows of the task, as fields of `rendering.Scene`."""

    @abc.abstractmethod
    def told(self, states: NDArray[np.void], knows: str) -> dict[str, Any]:
        """Returns the task's part of the briefing of a policy that knows `knows`."""
