"""What a task is made of, and the options that all tasks share."""

import abc
import dataclasses
import importlib
import math
from collections.abc import Callable, Collection, Mapping
from typing import Any, ClassVar, NamedTuple

import numpy as np
from numpy.typing import NDArray

from wayfield.envs.robots import ACTUATORS, Actuators, Robot, offered, records
from wayfield.envs.robots.disturbances import DISTURBANCES, Disturbance
from wayfield.envs.tasks.constraints import Constraint, of_request
from wayfield.envs.tasks.observation import Layout
from wayfield.envs.tasks.specs import TaskSpec
from wayfield.envs.world.grids import NO_GRIDS, Grids
from wayfield.system.checks import FARTHEST_SHOVE, LONGEST, MOST_NOISE, choose, heading, number, real, shown, truth
from wayfield.system.extras import installs

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
    address: str | None = None  # host:port of the simulator, of the plant that has one
    constraints: bool = False  # whether the info has their values
    wheels: str | None = None  # of MuJoCo's model, one of mjcf.WHEELS; None: the first of the drive's

    @classmethod
    def of(cls, robots: tuple[str, ...], **values: Any) -> "Options":
        """Returns the options whose values and names are those of the registered classes' arguments.

        Args:
            robots: the names that the environment offers; the first is the default. A data sheet or a `Robot` with a
                drive of their kind will do as well.
            values: one for each field but `dt`. shove: (time s, dx m, dy m, turn rad): the pose is displaced by this at
                that time, in the world frame.

        Raises:
            ValueError: if a name is unknown or a number out of range, or a data sheet is wrong; the message names the
                field and the choices.
            OSError: if a data sheet cannot be opened.
        """
        values["robot"] = robot = offered(values["robot"], robots)
        for field, choices in _CHOICES.items():
            choose(field, values[field], choices)
        values["actuators"] = robot.actuators(values["actuators"])
        if values["dynamics"] == "coppelia" and values["actuators"].response is not None:
            raise ValueError(
                f'robot {robot.name!r} has a delay or a response of its own; dynamics="coppelia" has no such motors'
            )
        values["disturbance"] = DISTURBANCES[values["disturbance"]]
        if values["address"] is not None and values["dynamics"] != "coppelia":
            raise ValueError(f'address={values["address"]!r} belongs to dynamics="coppelia"')
        if values["wheels"] is not None and values["dynamics"] != "mujoco":
            raise ValueError(f'wheels={shown(values["wheels"])} belongs to dynamics="mujoco"')
        noise = values["noise"]
        if not 0.0 <= real(noise) < math.inf:
            raise ValueError(f"noise must be a finite number >= 0 (0 is none, 1 nominal), got {shown(noise)}")
        values["noise"] = number("noise", noise, least=0.0, most=MOST_NOISE)
        truth("constraints", values.get("constraints", False))
        if values["shove"] is not None:
            values["shove"] = _shove(values["shove"])
        return cls(**values)

    def robot_params(self) -> dict[str, Any]:
        """Returns the values of records.ROBOT_PARAMS, but for the beams, which a task sets."""
        robot, actuators, disturbance, dt = self.robot, self.actuators, self.disturbance, self.dt
        true_pose = self.pose_source == "ground_truth"
        encoders, odometry, passive = records.odometry_matrices(robot, "odometry" if true_pose else self.pose_source)
        decay, mean = records.lag_factors(actuators.lag, dt)
        when, shove_x, shove_y, shove_heading = self.shove or (-dt, 0.0, 0.0, 0.0)
        pose_noise, encoder_noise = self.noise + disturbance.pose_noise, self.noise + disturbance.encoder_noise
        right = pose_noise == encoder_noise == 0.0 and not disturbance.distorts
        return {
            **records.motor_numbers(robot, actuators, dt),
            "twist_action": self.action_mode == "twist",
            "holonomic": robot.holonomic,
            "lag_decay": decay,
            "lag_mean": mean,
            "requests": len(self.max_action),
            "hull_radius": robot.hull_radius,
            "hull_length": robot.hull_box[0] if robot.hull_box else 0.0,
            "hull_width": robot.hull_box[1] if robot.hull_box else 0.0,
            "hull_x": robot.hull_x,
            "perfect_pose": true_pose and right,
            "pose_from_odometry": not true_pose,
            "passive_encoders": passive,
            "num_encoders": len(encoders),
            "encoder_matrix": records.padded(encoders, (records.MAX_WHEELS, 3)),
            "odometry_matrix": records.padded(odometry, (3, records.MAX_WHEELS)),
            "position_noise": records.POSITION_NOISE * pose_noise,
            "heading_noise": records.HEADING_NOISE * pose_noise,
            "encoder_noise": records.ENCODER_NOISE * encoder_noise,
            "range_noise": records.RANGE_NOISE * (self.noise + disturbance.range_noise),
            "dropout_below": disturbance.dropout_below,
            "distorted": disturbance.distorts,
            "distortion": disturbance.distortion(robot),
            "side_slip": disturbance.side_slip,
            **disturbance.displacement(dt),
            "shove_step": round(when / dt),
            "shove_x": shove_x,
            "shove_y": shove_y,
            "shove_heading": shove_heading,
        }

    @property
    def num_requested(self) -> int:
        """Returns how many numbers of what was requested lie behind an action."""
        return records.num_requests(self.actuators.response, self.dt)

    @property
    def max_action(self) -> NDArray[np.float64]:
        """Returns the bound of the action space, (a,): m/s and rad/s, or rad/s of each wheel."""
        if self.action_mode == "twist":
            return self.robot.max_twist
        return np.full(len(self.robot.wheel_matrix), self.robot.rated_wheel_speed)


class Plant(NamedTuple):
    """Where a plant is found that drives beside the compiled step, and which extra brings what it imports."""

    module: str
    name: str
    extra: str | None = None


# The kinematic plant is part of the step. A plant is loaded where it is chosen, and then alone.
PLANTS: Mapping[str, Plant] = {
    "pymunk": Plant("wayfield.envs.pymunk_plant", "PymunkPlant"),
    "mujoco": Plant("wayfield.envs.mujoco_plant", "MujocoPlant", "mujoco"),
    "coppelia": Plant("wayfield.bridges.coppelia.plant", "CoppeliaPlant", "coppelia"),
}
IN_PROCESS = ("kinematic", "pymunk", "mujoco")  # plants that need no other program
# robots of a world, at most, of the plants that drive teams, and robots among people
LARGEST_TEAMS: Mapping[str, float] = {"kinematic": math.inf, "mujoco": 8}
_CHOICES: Mapping[str, Collection[str]] = {
    "dynamics": ("kinematic", *PLANTS),
    "actuators": ACTUATORS,
    "action_mode": ("twist", "wheel_speeds"),
    "pose_source": records.POSE_SOURCES,
    "disturbance": DISTURBANCES,
}


def plant_class(dynamics: str) -> Any:
    """Returns the class of a plant of PLANTS.

    Raises:
        ImportError: in one line, without what it needs, or with another version of what that brings.
    """
    module, name, extra = PLANTS[dynamics]
    try:
        return getattr(importlib.import_module(module), name)
    except ModuleNotFoundError as error:
        how = installs(extra) if extra is not None else f"pip install {error.name}"
        raise ModuleNotFoundError(f'dynamics="{dynamics}" needs {error.name}: {how}') from None


def _shove(shove: Any) -> tuple[float, float, float, float]:
    """Returns (time s, dx m, dy m, turn rad) of a displacement; ValueError if it is none."""
    listed = isinstance(shove, tuple | list) or (isinstance(shove, np.ndarray) and shove.ndim == 1)
    values = [real(each) for each in shove] if listed and len(shove) == 4 else []
    if not values or not all(map(math.isfinite, values)) or values[0] < 0.0:
        raise ValueError(f"shove must be (time >= 0, dx, dy, turn), four finite numbers, got {shown(shove)}")
    return (
        number("shove[0]", values[0], least=0.0, most=LONGEST),
        number("shove[1]", values[1], most=FARTHEST_SHOVE),
        number("shove[2]", values[2], most=FARTHEST_SHOVE),
        heading("shove[3]", values[3]),
    )


class Task(abc.ABC):
    """A task: its records, its compiled step over all robots, and the bank of scenarios it draws from.

    The compiled functions take the arrays that `Batch` passes, then those of `world`, which describe the bank.
    """

    state_dtype: ClassVar[np.dtype[np.void]]
    info_names: ClassVar[tuple[str, ...]]
    flag_names: ClassVar[tuple[str, ...]]
    draws: int
    step_rows: ClassVar[Callable[..., int]]
    reset_rows: ClassVar[Callable[..., None]]

    scenarios: tuple[Any, ...]
    options: Options
    robot: Robot
    layout: Layout[Any]
    params: NDArray[np.void]
    world: Any  # a named tuple of arrays
    beam_angles: NDArray[np.float64]
    max_obstacles: int
    grids: Grids = NO_GRIDS
    # where none moves or is pushed, those of the bank: (scenarios, max_obstacles), and as `blocks.in_blocks` puts them
    fields: NDArray[np.void] | None = None
    shared_obstacles: NDArray[np.void] | None = None

    @abc.abstractmethod
    def __init__(self, arguments: Any, options: Options) -> None: ...

    def __deepcopy__(self, memo: dict[int, Any]) -> "Task":
        """Returns the task itself: it never changes, and the maps of its bank are large."""
        del memo
        return self

    @property
    def spec(self) -> TaskSpec:
        """Returns the task's spec, which its observations carry."""
        assert self.layout.task is not None
        return self.layout.task

    @property
    def team(self) -> int:
        """Returns how many robots a world has."""
        return 1

    def present(self, states: NDArray[np.void]) -> NDArray[np.bool_]:
        """Returns which robots (b,) have not left their worlds."""
        return np.ones(len(states), np.bool_)

    def courses_of(self) -> tuple[Any, ...]:
        """Returns the scenario of each robot, in the order of states["scenario"]."""
        return self.scenarios

    @property
    def num_beams(self) -> int:
        """Returns how many beams the range scan has."""
        return len(self.beam_angles)

    @property
    def constraints(self) -> tuple[Constraint, ...]:
        """Returns what base and task allow, in the order of `info["constraint_values"]`."""
        return of_request(self.params[0], self.robot.max_twist, self.robot.twist_axes) + self.of_states

    @property
    def of_states(self) -> tuple[Constraint, ...]:
        """Returns the constraints of the task's own states."""
        return ()

    @property
    def noise_columns(self) -> int:
        """Returns how many random numbers a task's own sensors take in a step, beside those of pose and beams."""
        return 0

    def own_arrays(self, num_envs: int) -> tuple[NDArray[Any], ...]:
        """Returns arrays that the step of `num_envs` robots keeps besides their states; most tasks have none."""
        del num_envs
        return ()

    def others(
        self, states: NDArray[np.void], own: Any, i: int
    ) -> tuple[list[tuple[int, tuple[float, float, float], tuple[float, float], bool]], NDArray[np.float64]]:
        """Returns the other bodies in robot i's world: number, pose, goal and whether it left of robots, and people.

        People are (q, 4): x, y (m), heading (rad), radius (m).
        """
        del states, own, i
        return [], np.zeros((0, 4))

    @abc.abstractmethod
    def obstacle_counts(self, states: NDArray[np.void]) -> NDArray[np.int64]:
        """Returns how many obstacles each robot has around it."""

    def last_indices(self, scenarios: NDArray[np.int64]) -> dict[str, NDArray[np.int64]]:
        """Returns the greatest value (b,) of each field of a task's own states that is an index, by its name.

        Args:
            scenarios: (b,) of the bank.
        """
        del scenarios
        return {}

    def scenario_of(self, states: NDArray[np.void]) -> NDArray[np.int64]:
        """Returns which scenario (b,) of the bank robots are in."""
        return np.asarray(states["scenario"])

    def same_world(self, name: str, values: NDArray[Any], there: NDArray[Any]) -> NDArray[np.bool_]:
        """Returns whether robots (b,) with these values of what a scenario decides are where those with others are."""
        del name
        return np.asarray(values == there)

    def check_own(self, own: tuple[NDArray[Any], ...], there: tuple[NDArray[Any], ...]) -> None:
        """Raises ValueError, naming the field, unless arrays like `own_arrays` may take the place of those there."""
        del own, there

    @abc.abstractmethod
    def drawing(self, state: NDArray[np.void]) -> dict[str, Any]:
        """Returns what a frame shows of the task, as fields of `rendering.Scene`."""

    @abc.abstractmethod
    def briefing_fields(self, states: NDArray[np.void], knows: str) -> dict[str, Any]:
        """Returns the task's part of the briefing of a policy that knows `knows`."""
