"""What environments are made with: a dataclass a task, whose fields are the keyword arguments of its classes."""

import dataclasses
import json
from typing import Any, ClassVar, TypeVar

from wayfield.envs.robots import AnyRobot, robots_with
from wayfield.envs.tasks.task import Options
from wayfield.system.checks import WHOLE_TURN, real

Numbers = TypeVar("Numbers")
FRAME_SIZE = (640, 640)  # px, width and height
_SHOVED = ("shove[0]", "shove[1]", "shove[2]", "shove[3]")
_USUAL = {
    "noise": (0.0, 20.0, "times the nominal sensors'"),
    "max_range": (0.05, 300.0, "m"),
    "field_of_view": (0.05, WHOLE_TURN, "rad"),
    "sight": (0.1, 300.0, "m"),
    "preview_spacing": (1e-3, 10.0, "m, or s of a reference"),
    "scale": (1e-4, 100.0, "times the coordinates, in m"),
    **dict(zip(_SHOVED, ((0.0, 1000.0, "s"), (0.0, 5.0, "m"), (0.0, 5.0, "m"), (0.0, WHOLE_TURN, "rad")), strict=True)),
}


def argument(default: Any, meaning: str = "", shown: str | None = None) -> Any:
    """Returns a field with what its row of a sheet says: what it means, and its default, where it is shown otherwise.

    One without a meaning stands in the row of the one before.
    """
    return dataclasses.field(default=default, metadata={"meaning": meaning, "shown": shown})


WHEELS_OF_MUJOCO: Any = argument(
    None, 'of MuJoCo\'s model: "cylinders" or "points"; of omni bases "anisotropic" or "rollers"'
)


@dataclasses.dataclass(frozen=True, kw_only=True)
class Arguments:
    """What every environment takes."""

    scenario: Any = None
    robot: AnyRobot | None = None
    actuators: str = argument(
        "ideal", '"lagged": 1 m/s^2, 3 rad/s^2, lag 0.1 s, or the data sheet\'s; "slow": 0.5, 1.5, 0.25'
    )
    action_mode: str = argument("twist", '"twist" or "wheel_speeds"')
    noise: float = argument(
        0.0, "scales standard deviations: position 0.01 m, heading 0.01 rad, encoders 2 %, ranges of a scan 0.01 m"
    )
    pose_source: str = "ground_truth"
    shove: tuple[float, float, float, float] | None = argument(
        None, "(t, dx, dy, turn): the pose is displaced at time t, in the world frame, up to contact"
    )
    disturbance: str = argument(
        "none", '"light", "moderate", "strong", "severe", or one cause: see `envs.robots.disturbances`'
    )
    constraints: bool = argument(
        False, "`info` has the values of `env.unwrapped.constraints`, at most 0 where kept, and `constraint_violation`"
    )
    render_mode: str | None = argument(None, '"rgb_array" or "human"; width and height of the frames, px')
    frame_size: tuple[int, int] = argument(FRAME_SIZE)

    dynamics: ClassVar[str] = "kinematic"
    address: ClassVar[str | None] = None
    wheels: ClassVar[str | None] = None

    def options(self, robots: tuple[str, ...]) -> Options:
        """Returns those that all tasks share, looked up and checked, of an environment for these robots."""
        names = (each.name for each in dataclasses.fields(Options) if each.name != "dt")
        return Options.of(robots, **{name: getattr(self, name) for name in names})

    def doubt(self) -> str:
        """Returns what is in other units than it is read in, most likely, by its size; "" where nothing is."""
        given = {name: real(getattr(self, name, None)) for name in _USUAL}
        if self.shove is not None:
            given |= zip(_SHOVED, map(real, self.shove), strict=False)
        for field, (least, most, unit) in _USUAL.items():
            if 0.0 < abs(given[field]) < least or abs(given[field]) > most:
                return f"{field} is {given[field]:g} {unit}, usual is {least:g} to {most:g}"
        return ""

    def numbers(self, kind: type[Numbers]) -> Numbers:
        """Returns the numbers of a task, those that are arguments as these say."""
        names = [each.name for each in dataclasses.fields(kind) if hasattr(self, each.name)]  # type: ignore[arg-type]
        truths = {name for name in names if isinstance(getattr(type(self), name), bool)}  # which are 0 or 1 there
        return kind(**{name: int(getattr(self, name)) if name in truths else getattr(self, name) for name in names})


@dataclasses.dataclass(frozen=True, kw_only=True)
class PlantArguments(Arguments):
    """What an environment takes whose robot may be driven by a plant with forces, too."""

    dynamics: str = argument(  # type: ignore[misc]
        "kinematic",
        '"pymunk": mass, wheel slip, contacts, pushable obstacles; "mujoco": the same in MuJoCo, in three dimensions; '
        '"coppelia": a running CoppeliaSim',
    )
    address: str | None = argument(  # type: ignore[misc]
        None, "host:port of the CoppeliaSim; None: $WAYFIELD_COPPELIA, or localhost:23000"
    )
    wheels: str | None = WHEELS_OF_MUJOCO  # type: ignore[misc]


@dataclasses.dataclass(frozen=True, kw_only=True)
class ScanArguments(Arguments):
    """What an environment takes whose robot has a range scan."""

    num_beams: int | None = argument(
        None, "the range scan; 32, 2 pi, 5 m where no data sheet says so", "as the robot's"
    )
    field_of_view: float | None = argument(None, shown="")
    max_range: float | None = argument(None, shown="")


def arguments_table(kind: type[Arguments], holonomic: bool) -> str:
    """Returns a sheet's section of arguments: a row each, those of the task itself first."""
    robots = robots_with(holonomic)
    given = ", ".join(f'"{name}"' for name in robots)
    own = {
        "robot": (f'"{robots[0]}"', f"{given}, a data sheet (.json) of your own, or a `wayfield.envs.robots.Robot`"),
        "pose_source": (
            '"ground_truth"',
            'or "odometry"' + ', "odometry_uncorrected", "odometry_plain_sum": see below' * holonomic,
        ),
    }
    shared = {each.name for base in (PlantArguments, ScanArguments) for each in dataclasses.fields(base)} - {"scenario"}
    rows: list[list[str]] = []
    for each in sorted(dataclasses.fields(kind), key=lambda each: each.name in shared):
        default = json.dumps(each.default) if isinstance(each.default, str) else str(each.default)
        if (shown := each.metadata.get("shown")) is not None:
            default = shown
        default, meaning = own.get(each.name, (default, each.metadata.get("meaning", "")))
        if meaning:
            rows.append([each.name, default, meaning])
        else:
            rows[-1][0] += f", {each.name}"
            rows[-1][1] += f", {default}" if default else ""
    lines = ["| argument | default | meaning |", "|---|---|---|", *(f"| {' | '.join(row)} |" for row in rows)]
    more = 'The vector environment takes `autoreset_mode="NextStep"|"SameStep"` and `num_threads=1` besides.'
    return "\n    ".join([*lines, "", more])
