"""The commands `wayfield ros sim`, `drive` and `excite`; the nodes that they run need rclpy."""

import contextlib
import dataclasses
import importlib
import importlib.util
import math
import os
import sys
import warnings
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import click

from wayfield.benchmarks.entrants.own_policies import own_policy
from wayfield.bridges.ros.body import WORLDS, Body
from wayfield.bridges.ros.conventions import NO_RETURN, Sight
from wayfield.bridges.ros.driving import AlongPath, ToGoal, beams_of, check_drives
from wayfield.bridges.ros.excite import OVER, Script, script
from wayfield.bridges.ros.guard import Driver, Limits
from wayfield.bridges.ros.messages import Goal
from wayfield.envs.robots import ACTUATORS, Robot
from wayfield.envs.robots.disturbances import DISTURBANCES
from wayfield.envs.robots.robot_option import robot_option
from wayfield.envs.tasks.specs import EVERY
from wayfield.envs.tasks.task import CONTROL_PERIOD, IN_PROCESS
from wayfield.policies import POLICIES, NoCruisingSpeed, cruising, make
from wayfield.policies.parts.tuned import read_gains
from wayfield.system.checks import WHOLE_TURN, printable, suggestion
from wayfield.system.command_line import SEED, Choice, Finite, OneLineErrors, usual_is
from wayfield.system.extras import installs
from wayfield.system.objects import FileNote

NEEDS_ROS = (
    "rclpy is missing: on a robot, install ROS 2 by apt, source /opt/ros/DISTRO/setup.bash and use an environment made "
    f"with --system-site-packages; for tests on Linux x86_64, {installs('ros')}"
)
PERIODS = 20.0  # Hz, of the control periods of our worlds


def nodes() -> Any:
    """Returns the module that imports rclpy.

    Raises:
        click.ClickException: if there is no ROS, with what to do.
    """
    try:
        return importlib.import_module("wayfield.bridges.ros.nodes")
    except ModuleNotFoundError as error:
        if (error.name or "").startswith("wayfield"):
            raise
        name = (error.name or "").partition(".")[0]
        raise click.ClickException(
            NEEDS_ROS if name == "rclpy" else f"{name} is missing: {installs('ros')}, or ros-DISTRO-*"
        ) from None
    except ImportError as error:  # compiled against another Python or NumPy
        raise click.ClickException(f"rclpy is there and does not load in this Python: {error}") from None


class Numbers(click.ParamType):  # type: ignore[type-arg]
    """Finite numbers separated by commas."""

    name = "numbers"

    def __init__(self, field: str, least: int, names: str, usual: float = math.inf) -> None:
        self.field, self.least, self.names, self.usual = field, least, names, usual

    def get_metavar(self, param: click.Parameter, ctx: click.Context) -> str:
        """Returns what the help shows."""
        del param, ctx
        return self.names

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> tuple[float, ...]:
        """Returns the numbers, or fails."""
        del param, ctx
        most = self.names.count(",") + 1
        try:
            result = tuple(float(each) for each in str(value).split(","))
        except ValueError:
            result = ()
        if not self.least <= len(result) <= most or not all(map(math.isfinite, result)):
            short = ",".join(self.names.split(",")[: self.least])
            names = self.names if self.least == most else f"{short} or {self.names}"
            raise click.UsageError(f"{self.field} {value!r} must be {names}, finite numbers in m and rad")
        if len(result) == 3 and abs(result[2]) > WHOLE_TURN:
            raise click.UsageError(
                f"{self.field} {value!r}: {result[2]:g} rad is more than a turn; degrees must be multiplied by pi / 180"
            )
        if (farthest := max(map(abs, result[:2]))) > self.usual:
            warnings.warn(f"{self.field} is {farthest:g} m away, {usual_is(self.usual)}", FileNote, stacklevel=2)
        return result


def _rate(ctx: click.Context, param: click.Parameter, value: float) -> float:
    """Returns a rate (Hz) of which whole control periods are made, or fails."""
    del ctx
    if abs(PERIODS / value - round(PERIODS / value)) > 1e-9:
        raise click.UsageError(
            f"--{str(param.name).replace('_', '-')} {value:g} must divide {PERIODS:g} Hz: 20, 10, 5, 4"
        )
    return value


@dataclasses.dataclass(frozen=True)
class SimSettings:
    """How a simulator talks: see the options of `wayfield ros sim`."""

    rate: float
    lockstep: float
    scan_rate: float
    odom_rate: float
    angle_min: float
    cmd_vel: str
    frames: tuple[str, str, str]
    namespace: str
    no_clock: bool
    substeps: int  # messages of the clock a control period
    seconds: float
    variance: float  # of odometry, m^2 and rad^2


@click.command(cls=OneLineErrors)
@robot_option(default="turtlebot3", show_default=True)
@click.option("--env", "world", type=Choice("--env", WORLDS), default="goal", show_default=True, help="Kind of scene.")
@click.option("--scenario", default=None, help="A name, FAMILY, FAMILY/SPLIT or a file. [default: rooms, for goals]")
@click.option("--dynamics", type=Choice("--dynamics", IN_PROCESS), default="kinematic", show_default=True)
@click.option("--actuators", type=Choice("--actuators", ACTUATORS), default="lagged", show_default=True)
@click.option("--disturbance", type=Choice("--disturbance", DISTURBANCES), default="none", show_default=True)
@click.option(
    "--pose-source",
    type=Choice("--pose-source", ("odometry", "ground_truth")),
    default="odometry",
    show_default=True,
    help="Pose in odom: from encoders, with drift, or the true one, as after localisation.",
)
@click.option("--seed", type=SEED, default=0, show_default=True, help="Seed of the scenario and of all noise.")
@click.option(
    "--rate",
    type=Finite(0.0),
    default=1.0,
    show_default=True,
    help="Speed, in times of real time; 0: as fast as possible.",
)
@click.option(
    "--lockstep",
    type=Finite(0.0, usual=60.0),
    default=0.0,
    help="Wait up to so long (s) for a command after each scan.",
)
@click.option(
    "--scan-rate", type=Finite(0.1, PERIODS), default=5.0, show_default=True, callback=_rate, help="Rate of scan, Hz."
)
@click.option(
    "--odom-rate", type=Finite(0.1, PERIODS), default=20.0, show_default=True, callback=_rate, help="Rate of odom, Hz."
)
@click.option(
    "--angle-min",
    type=Finite(-2.0 * math.pi, 2.0 * math.pi),
    default=0.0,
    show_default=True,
    help="Angle of the first beam, rad: 0 as on TurtleBot3, -3.14159 as Nav2's default.",
)
@click.option("--cmd-vel", type=Choice("--cmd-vel", ("auto", "twist", "stamped")), default="auto", show_default=True)
@click.option(
    "--timeout",
    type=Finite(0.05, usual=60.0),
    default=0.5,
    show_default=True,
    help="Time without a command until the base brakes, s.",
)
@click.option(
    "--frames", default="odom,base_footprint,base_scan", show_default=True, help="Names of the frames: ODOM,BASE,SCAN."
)
@click.option("--beams", type=click.IntRange(8, 10_000), help="Number of beams. [default: that of the data sheet]")
@click.option("--namespace", default="", help="Namespace of all topics.")
@click.option("--no-clock", is_flag=True, help="Publish no clock, and stamp with the system clock; needs --rate 1.")
@click.option(
    "--substeps",
    type=click.IntRange(1, 50),
    default=1,
    show_default=True,
    help="Clock messages per step: 5 gives 100 Hz.",
)
@click.option(
    "--others",
    type=Choice("--others", POLICIES),
    default="orca_team",
    show_default=True,
    help="Policy of the other robots of --env team.",
)
@click.option("--record", "record", metavar="FILE.mcap", help="Record all published topics, and cmd_vel.")
@click.option("--for", "seconds", type=Finite(0.0), default=None, help="Stop after so many seconds of simulated time.")
@click.option("--start", type=Numbers("--start", 3, "X,Y,HEADING", 300.0), help="Start pose in the world, m and rad.")
def sim(
    robot: Robot,
    world: str,
    scenario: str | None,
    frames: str,
    record: str | None,
    seconds: float | None,
    **options: Any,
) -> None:
    """Simulates a robot as a ROS 2 node. Publishes scan, odom, clock, ground_truth and contact; reads cmd_vel."""
    named = tuple(each.strip() for each in frames.split(","))
    if len(named) != 3 or not all(named):
        raise click.UsageError(f"--frames {frames!r} must be three names: ODOM,BASE,SCAN")
    names = {each.name for each in dataclasses.fields(SimSettings)}
    talk = {name: options.pop(name) for name in names & options.keys()}
    if talk["lockstep"] and world == "path":
        raise click.UsageError("--lockstep waits for an answer to a scan; --env path has none")
    if talk["no_clock"] and (talk["rate"] != 1.0 or talk["lockstep"]):
        raise click.UsageError("--no-clock stamps by the wall, which needs --rate 1 and no --lockstep")
    module = nodes()
    recorder = recorder_of(record)
    default = {"goal": "rooms", "path": "figure_eight", "dock": "all", "team": "circle_8", "people": "crowdnav_5"}
    try:
        body = Body(robot, world, scenario or default[world], **options)
    except (ValueError, TypeError) as error:
        raise click.UsageError(str(error)) from None
    noise = DISTURBANCES[options["disturbance"]].encoder_noise
    settings = SimSettings(
        frames=(named[0], named[1], named[2]),
        seconds=math.inf if seconds is None else seconds,
        variance=(0.02 * noise) ** 2,
        **talk,
    )
    try:
        module.simulate(body, settings, _ros_args(), recorder)
    except ValueError as error:
        raise click.UsageError(str(error)) from None


@dataclasses.dataclass(frozen=True)
class DriveSettings:
    """How a driver talks: see the options of `wayfield ros drive`."""

    name: str
    namespace: str
    cmd_vel: str  # "twist" or "stamped"
    dry_run: bool
    frame: str  # of stamped commands
    goal: Goal | None


def _by_distro(cmd_vel: str) -> str:
    """Returns which type commands are of: Twist up to Jazzy, TwistStamped from Kilted on."""
    if cmd_vel != "auto":
        return cmd_vel
    return "twist" if os.environ.get("ROS_DISTRO", "") in ("humble", "iron", "jazzy") else "stamped"


_TALK = (
    click.option(
        "--timeout",
        type=Finite(0.05, 10.0),
        default=0.5,
        show_default=True,
        help="Time without scan or odom until the robot stops, s.",
    ),
    click.option(
        "--scan-pose",
        type=Numbers("--scan-pose", 3, "X,Y,HEADING", 5.0),
        default="0,0,0",
        help="Pose of the scanner on the robot, m and rad.",
    ),
    click.option(
        "--no-return",
        type=Choice("--no-return", NO_RETURN),
        default=None,
        help="What ranges of 0 and NaN mean: far (LDS-01) or unknown. [default: unknown, with a message]",
    ),
    click.option("--arm", is_flag=True, help="Drive at once. Without it the robot waits for true on arm."),
    click.option(
        "--cmd-vel",
        type=Choice("--cmd-vel", ("auto", "twist", "stamped")),
        default="auto",
        help="Type of cmd_vel. [default: by ROS_DISTRO, Twist up to jazzy]",
    ),
    click.option("--dry-run", is_flag=True, help="Publish on cmd_vel_dry: nothing moves."),
    click.option("--namespace", default="", help="Namespace of all topics."),
    click.option("--base-frame", default="base_footprint", show_default=True, help="Frame of stamped commands."),
    click.option("--record", "record", metavar="FILE.mcap", help="Record cmd_vel, odom and scan."),
)


def _talking(function: Any) -> Any:
    for each in reversed(_TALK):
        function = each(function)
    return function


_BASE = "a base must stop by itself when commands end: a process that has died publishes nothing. Keep a stop at hand."


@click.command(cls=OneLineErrors)
@click.option(
    "--policy",
    "name",
    default="vfh_plus",
    show_default=True,
    metavar="NAME",
    help="A policy of the package; or, in quotes, your own: module:Class key=value, or a model.zip.",
)
@robot_option(default="turtlebot3", show_default=True)
@click.option("--gains", metavar="FILE", help="Gains of the policy: a file of `wayfield tune`.")
@click.option("--home", metavar="FOLDER", help="Folder of your training runs, for --policy ppo.")
@click.option(
    "--env", "world", type=Choice("--env", WORLDS), default="goal", show_default=True, help="Task of an agent."
)
@click.option(
    "--goal",
    type=Numbers("--goal", 2, "X,Y,HEADING", 300.0),
    help="Goal in odometry's frame, m and rad; HEADING is optional.",
)
@click.option("--path", metavar="FILE", help="Path in odometry's frame; `topic`: from the topic path.")
@click.option(
    "--max-speed", type=Finite(0.0, min_open=True, usual=10.0), help="Speed limit below that of the data sheet, m/s."
)
@click.option(
    "--max-yaw-rate",
    type=Finite(0.0, min_open=True, usual=40.0),
    help="Yaw rate limit below that of the data sheet, rad/s.",
)
@click.option(
    "--tolerance",
    type=Finite(0.0, min_open=True, usual=5.0),
    default=0.1,
    show_default=True,
    help="Distance to the goal that counts as arrived, m.",
)
@click.option(
    "--turned",
    type=Finite(0.0, min_open=True, usual=3.15),
    default=0.1,
    show_default=True,
    help="Heading error that counts as arrived, rad.",
)
@click.option("--period", type=Finite(0.01, 1.0), default=0.05, show_default=True, help="Time between decisions, s.")
@click.option(
    "--beams",
    type=click.IntRange(8, 10_000),
    help="Beams that the policy gets. [default: those of the data sheet, at least 72]",
)
@_talking
def drive(name: str, robot: Robot, **options: Any) -> None:
    """Drives a robot by a policy: reads scan and odom, publishes cmd_vel. Disarmed until --arm, or true on arm."""
    module = nodes()
    mission, heading = _mission(name, robot, options), options["goal"]
    goal = None if heading is None else Goal("", *heading)
    limits = Limits(robot, options["max_speed"] or math.inf, options["max_yaw_rate"] or math.inf)
    click.echo(f"drive: {_BASE}")
    mission.rehearse()
    _run(module, mission, limits, "wayfield_drive", beams_of(robot, options["beams"]), goal, options)


def _mission(name: str, robot: Robot, options: dict[str, Any]) -> Any:
    """Returns what drives to goals or along a path, or fails in a line."""
    path, period = options["path"], options["period"]
    try:
        gains: dict[str, Any] = {}
        own = own_policy(name) if ":" in name or name.lower().endswith(".zip") else None
        if own is not None:
            name, gains = own.name, dict(own.gains)
        if options["gains"]:
            gains |= read_gains(Path(options["gains"]).read_bytes(), options["gains"], name)["gains"]
        if options["home"]:
            gains["home"] = options["home"]
        if options["max_speed"]:
            with contextlib.suppress(NoCruisingSpeed):
                # never above the one that a policy has
                top = options["max_speed"]
                slower = cruising(name, gains, top) if own is None else own.cruising(top) or {}
                faster: Any = make(name, **gains) if own is None else own.make(gains)
                faster = faster if own is None else faster.policy  # what `Checked` holds
                gains |= {key: value for key, value in slower.items() if value < (getattr(faster, key) or math.inf)}
        policy = make(name, **gains) if own is None else own.make(gains)
        check_drives(policy, name, robot, bool(path))
        if path:
            if period != CONTROL_PERIOD:
                raise ValueError(
                    f"--period {period:g} is for goals; along a path decisions are {CONTROL_PERIOD} s apart"
                )
            return AlongPath(policy, robot, None if path == "topic" else path)
        spec = next(each for each in EVERY.values() if each.kind == options["world"])
        if spec.on_path:
            raise ValueError("--env path needs --path FILE, or --path topic")
        angles = beams_of(robot, options["beams"])
        return ToGoal(policy, robot, spec, angles, period, options["tolerance"], options["turned"])
    except (ValueError, TypeError) as error:
        raise click.UsageError(str(error)) from None
    except ImportError as error:
        raise click.ClickException(str(error)) from None


def _run(
    module: Any, mission: Any, limits: Limits, name: str, angles: Any, goal: Goal | None, options: dict[str, Any]
) -> None:
    """Runs the driver of a mission."""
    driver = Driver(
        mission,
        Sight(angles, limits.robot.sensors.range, options["scan_pose"], options["no_return"]),
        limits,
        options["timeout"],
        options["period"],
        options["arm"],
        say=lambda line: click.echo(printable(line)),
    )
    settings = DriveSettings(
        name,
        options["namespace"],
        _by_distro(options["cmd_vel"]),
        options["dry_run"],
        options["base_frame"],
        goal,
    )
    try:
        module.drive(
            driver, settings, _ros_args(), recorder_of(options["record"]), lambda: getattr(mission, "done", False)
        )
    except ValueError as error:
        raise click.UsageError(str(error)) from None


@click.command(cls=OneLineErrors)
@robot_option("Your robot or its data sheet: for the hull.", default="turtlebot3", show_default=True)
@click.option(
    "--top-speed",
    type=Finite(0.0, 20.0, min_open=True),
    default=0.2,
    show_default=True,
    help="Top speed of the base, m/s.",
)
@click.option(
    "--top-yaw-rate",
    type=Finite(0.0, 20.0, min_open=True),
    default=1.0,
    show_default=True,
    help="Top yaw rate of the base, rad/s.",
)
@click.option("--seconds", type=Finite(20.0, 600.0), default=60.0, show_default=True)
@click.option(
    "--space", type=Finite(0.2, 100.0), default=2.0, show_default=True, help="Free space in every direction, m."
)
@_talking
def excite(robot: Robot, top_speed: float, top_yaw_rate: float, seconds: float, space: float, **options: Any) -> None:
    """Drives a test run that identifies the base: steps, reversals, more than its top speed, ramps, a chirp."""
    module = nodes()
    parts, factor = script(top_speed, top_yaw_rate, seconds, space)
    mission = Script(parts, robot, space)
    click.echo(f"excite: {_BASE}")
    if factor < 1.0:
        click.echo(
            f"excite: speeds ahead are {factor:.2f} of what was asked, to stay within {space:g} m; a limit above "
            f"{OVER * factor * top_speed:.2f} m/s will not be seen"
        )
    limits = Limits(robot, OVER * top_speed, OVER * top_yaw_rate, by_sheet=False)
    _run(module, mission, limits, "wayfield_excite", beams_of(robot), None, {**options, "period": 0.05})


def recorder_of(file: str | None) -> Any:
    """Returns the recorder of --record, if it was given; fails in a line."""
    if file is None:
        return None
    if importlib.util.find_spec("mcap") is None:
        raise click.ClickException(f"--record needs mcap: {installs('ros')}")
    from wayfield.bridges.ros.recording import Recorder

    try:
        recorder = Recorder(Path(file))
    except ValueError as error:
        raise click.UsageError(str(error)) from None
    click.echo(f"recording to {recorder.part}; it becomes {file} at the end")
    return recorder


COMMANDS = {"sim": sim, "drive": drive, "excite": excite}

_HELP = "\n".join(
    [
        "Usage: wayfield ros COMMAND [OPTIONS] [--ros-args ...]",
        "",
        "  sim      a simulated robot, to test your nodes",
        "  drive    a policy as a node that drives your robot",
        "  excite   a test run, from whose log `wayfield identify` estimates your base",
        "",
        "  wayfield ros COMMAND --help   its options",
    ]
)

_rest: list[str] = []  # what stands behind --ros-args


def _ros_args() -> list[str]:
    return list(_rest)


def main(args: Sequence[str], prog_name: str = "wayfield ros") -> None:
    """Runs the command that the words name; what stands behind --ros-args is ROS's."""
    words = list(args)
    if "--ros-args" in words:
        at = words.index("--ros-args")
        end = words.index("--", at) if "--" in words[at:] else len(words)
        _rest[:] = words[at:end]
        words = words[:at] + words[end + 1 :]
    if not words or words[0] in ("-h", "--help", "help"):
        print(_HELP)
        return
    name, *rest = words
    if name not in COMMANDS:
        near = suggestion(name, (*COMMANDS, "--help"))
        print(f"{prog_name}: {name!r} is no command.{near} Choose from {', '.join(COMMANDS)}.", file=sys.stderr)
        sys.exit(2)
    COMMANDS[name].main(args=rest, prog_name=f"{prog_name} {name}")
