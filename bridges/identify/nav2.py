"""`wayfield nav2`: gains and a data sheet as parameters of Nav2, each with its origin as a comment.

Names are those of ros-navigation/navigation2 at jazzy f4108e5, kilted 71a1d84 and lyrical aa3dab8.
"""

import dataclasses
import math
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import click

from wayfield import __version__
from wayfield.envs.robots import ROBOTS, Robot
from wayfield.envs.robots.robot_option import robot_option
from wayfield.policies.parts.gain import gains_of
from wayfield.policies.parts.tuned import read_gains
from wayfield.policies.registry import POLICIES, make
from wayfield.system.checks import choose, printable, shown, unread
from wayfield.system.command_line import Choice, OneLineErrors, command_given, say
from wayfield.system.objects import json_object, read_text
from wayfield.system.readers import reader
from wayfield.system.storage import write_whole

DISTROS = ("jazzy", "kilted", "lyrical")
COMMITS = {"jazzy": "f4108e5", "kilted": "71a1d84", "lyrical": "aa3dab8"}
MAPPED = ("regulated_pure_pursuit", "nav2_dwb", "nav2_mppi")
PERIOD = 0.05  # s, of Nav2's controller_server as it ships

Block = dict[str, Any]  # of a name: an Entry, another Block, or a text that is a comment


@dataclasses.dataclass(frozen=True)
class Entry:
    """A value and where it comes from."""

    value: float | int | bool | str | list[float] | list[str]
    origin: str = ""


@dataclasses.dataclass(frozen=True)
class Tuned:
    """A policy's gains and what is known of them."""

    name: str
    gains: Mapping[str, Any]
    origin: str
    about: tuple[str, ...] = ()


def tuned(word: str, robot: Robot) -> Tuned:
    """Returns the gains of a file that `wayfield tune` has written, or a policy's own by its name.

    Raises:
        ValueError: if it is neither, or the policy has no counterpart in Nav2.
        OSError: if the file cannot be opened.
    """
    if not word.endswith(".json"):
        if word in POLICIES and word not in MAPPED:
            raise ValueError(f"policy {word} has no counterpart in Nav2; those that have are {', '.join(MAPPED)}")
        choose("GAINS", word, MAPPED)
        return Tuned(word, _whole(word, {}), f"{word}'s own")
    return read_tuned(word, robot)


_SAMPLE = """{"policy": "regulated_pure_pursuit", "robot": "p3dx", "speed": 0.6, "level": "none", "chosen": "search",
"frames": 100000, "gains": {"min_radius": 0.7}, "validation": {"chosen": {"failures": 3, "episodes": 130}}}"""


def _read_sample(read: Any, file: Path) -> Any:
    return read(str(file), ROBOTS["p3dx"])


@reader("gains for Nav2", "pursuit.json", {"pursuit.json": _SAMPLE}, _read_sample)
def read_tuned(word: str, robot: Robot) -> Tuned:
    """Returns the gains of a file that `wayfield tune` has written; see `tuned`."""
    content = json_object(word)
    name = content.get("policy")
    if not isinstance(name, str) or name not in POLICIES:
        raise ValueError(f"{word}: policy is {shown(name)}; it must be one of {', '.join(MAPPED)}")
    if name not in MAPPED:
        raise ValueError(f"{word}: policy {name} has no counterpart in Nav2; those that have are {', '.join(MAPPED)}")
    content = read_gains(read_text(word), word, name)
    about = [
        f"{Path(word).name}: tuned for {content['robot']} at {content['speed']:g} m/s, disturbance {content['level']}"
    ]
    validation = content.get("validation")
    validation = validation.get("chosen") if isinstance(validation, dict) else None
    if isinstance(validation, dict) and {"failures", "episodes"} <= set(validation):
        about.append(f"on validation {validation['failures']} failures in {validation['episodes']} episodes")
    if content.get("sheet", robot.digest) != robot.digest:
        about.append(f"TUNED FOR ANOTHER SHEET than that of {robot.name}: tune again with --robot")
    try:
        gains = _whole(name, content["gains"])
    except (TypeError, ValueError) as error:
        raise ValueError(f"{word}: {error}") from None
    return Tuned(name, gains, f"{Path(word).name}, ", tuple(about))


def _whole(name: str, gains: Mapping[str, Any]) -> dict[str, Any]:
    """Returns all gains of a policy, the given ones and its own."""
    policy: Any = make(name, **gains)
    return {field.name: getattr(policy, field.name) for field in dataclasses.fields(policy)}


class _Gains:
    """Gains that are taken one by one, so that what is left over is known."""

    def __init__(self, source: Tuned) -> None:
        self._source = source
        self._left = dict.fromkeys(source.gains)

    def __call__(self, name: str) -> Any:
        self._left.pop(name, None)
        return self._source.gains[name]

    def entry(self, name: str, note: str = "") -> Entry:
        """Returns a gain as it is."""
        return Entry(self(name), self.origin(name, note))

    def most(self, name: str, limit: float, what: str) -> Entry:
        """Returns a gain, or the sheet's limit where that is lower."""
        value = self(name)
        if value <= limit:
            return Entry(float(value), self.origin(name))
        return Entry(float(limit), f"{what} of the sheet, below {name} {value:g} of {self._source.name}")

    def origin(self, name: str, note: str = "") -> str:
        """Returns where a gain comes from."""
        return f"{name} of {self._source.name}" + (f"; {note}" if note else "")

    def unmapped(self) -> list[str]:
        """Returns a comment for each gain that nothing was made of."""
        units = {name: each.unit for name, each in gains_of(make(self._source.name)).items()}
        left = [each for each in self._left if each != "seed"]
        return [
            f"{each} = {self._source.gains[each]} {units.get(each, '')}: no counterpart".replace(" 1:", ":").replace(
                " :", ":"
            )
            for each in left
        ]


def limits(robot: Robot) -> dict[str, float]:
    """Returns what a base can: speeds (m/s, rad/s), slews both ways, delay and lag (s) and gain of both axes."""
    actuators = robot.actuators("lagged")
    numbers = actuators.response
    delays = (numbers.delays[0], numbers.delays[2]) if numbers is not None else (0.0, 0.0)
    lags = (numbers.lags[0], numbers.lags[2]) if numbers is not None else (actuators.lag, actuators.lag)
    return {
        "v": float(robot.max_twist[0]),
        "sideways": float(robot.max_twist[1]) if robot.holonomic else 0.0,
        "w": float(robot.max_twist[-1]),
        "acceleration": actuators.acceleration,
        "yaw_acceleration": actuators.yaw_acceleration,
        "deceleration": numbers.deceleration if numbers is not None else actuators.acceleration,
        "yaw_deceleration": numbers.yaw_deceleration if numbers is not None else actuators.yaw_acceleration,
        "delay_v": delays[0],
        "delay_w": delays[1],
        "lag_v": lags[0],
        "lag_w": lags[1],
        "gain_v": robot.gain[0] if robot.gain else 1.0,
        "gain_w": robot.gain[-1] if robot.gain else 1.0,
    }


def pursuit(source: Tuned, can: Mapping[str, float], distro: str, tolerances: bool) -> Block:
    """Returns the parameters of Nav2's regulated pure pursuit."""
    del tolerances
    g = _Gains(source)
    fastest = g.most("speed", can["v"], "top speed")
    speed = float(fastest.value)  # type: ignore[arg-type]
    deceleration = min(g("deceleration"), can["deceleration"])
    block: Block = {
        "plugin": Entry("nav2_regulated_pure_pursuit_controller::RegulatedPurePursuitController"),
        "max_linear_vel" if distro == "lyrical" else "desired_linear_vel": fastest,
        "use_velocity_scaled_lookahead_dist": Entry(True, f"as {source.name} looks ahead"),
        "min_lookahead_dist": g.entry("min_lookahead"),
        "max_lookahead_dist": g.entry("max_lookahead"),
        "lookahead_time": g.entry("lookahead_time"),
        "use_regulated_linear_velocity_scaling": Entry(True, "bends are driven slower"),
        "regulated_linear_scaling_min_radius": g.entry("min_radius"),
        "regulated_linear_scaling_min_speed": g.entry("min_speed"),
        "use_rotate_to_heading": Entry(True, "as it turns on the spot"),
        "rotate_to_heading_min_angle": g.entry("rotate_angle"),
        "rotate_to_heading_angular_vel": g.most("max_yaw_rate", can["w"], "top yaw rate"),
        "max_angular_accel": g.most("yaw_acceleration", can["yaw_acceleration"], "yaw acceleration"),
        "approach_velocity_scaling_dist": Entry(
            speed * speed / deceleration,
            g.origin("deceleration", "speed^2 / deceleration; Nav2 slows linearly with distance"),
        ),
    }
    if distro == "lyrical":
        block["max_linear_decel"] = Entry(-deceleration, g.origin("deceleration"))
    return _with_comments(block, [*g.unmapped(), *_response(can)])


def window(source: Tuned, can: Mapping[str, float], distro: str, tolerances: bool) -> Block:
    """Returns the parameters of Nav2's DWB."""
    g = _Gains(source)
    fastest = g.most("max_speed", can["v"], "top speed")
    linear = g.most("acceleration", can["acceleration"], "acceleration")
    angular = g.most("yaw_acceleration", can["yaw_acceleration"], "yaw acceleration")
    ahead = "forward_point"
    block: Block = {
        "plugin": Entry("dwb_core::DWBLocalPlanner"),
        "min_vel_x": Entry(0.0, f"{source.name} drives no way backward"),
        "max_vel_x": fastest,
        "max_speed_xy": fastest,
        "max_vel_theta": g.most("max_yaw_rate", can["w"], "top yaw rate"),
        "acc_lim_x": linear,
        "acc_lim_theta": angular,
        "decel_lim_x": _lower(linear, can["deceleration"], "deceleration"),
        "decel_lim_theta": _lower(angular, can["yaw_deceleration"], "yaw deceleration"),
        "vx_samples": g.entry("speeds"),
        "vy_samples": g.entry("sideways"),
        "vtheta_samples": g.entry("turns"),
        "sim_time": g.entry("horizon"),
        "linear_granularity": g.entry("linear_step"),
        "angular_granularity": g.entry("angular_step"),
        "trans_stopped_velocity": g.entry("stopped_speed"),
        "critics": Entry(
            ["RotateToGoal", "Oscillation", "BaseObstacle", "GoalAlign", "PathAlign", "PathDist", "GoalDist"]
        ),
        "BaseObstacle": {"scale": g.entry("obstacle")},
        "PathAlign": {"scale": g.entry("path_align"), "forward_point_distance": g.entry(ahead)},
        "GoalAlign": {"scale": g.entry("goal_align"), "forward_point_distance": g.entry(ahead)},
        "PathDist": {"scale": g.entry("path_distance")},
        "GoalDist": {"scale": g.entry("goal_distance")},
        "RotateToGoal": {"scale": g.entry("rotate_to_goal"), "slowing_factor": g.entry("slowing")},
    }
    tolerance = g.entry("tolerance")
    notes = [f"xy_goal_tolerance: {tolerance.value} m of {source.name}, with --tolerances"]
    if tolerances:
        block["xy_goal_tolerance"], notes = tolerance, []
    if distro != "lyrical":  # there the path handler's
        block["prune_distance"] = g.entry("prune_distance")
    notes.append(f"window: {g('window')} m is width and height of the local costmap")
    return _with_comments(block, [*notes, *_costmap_apart(g), *_response(can)])


def sampling(source: Tuned, can: Mapping[str, float], distro: str, tolerances: bool) -> Block:
    """Returns the parameters of Nav2's MPPI."""
    del tolerances
    g = _Gains(source)
    acceleration = g.most("acceleration", can["acceleration"], "acceleration")
    step = g("step_time")
    block: Block = {
        "plugin": Entry("nav2_mppi_controller::MPPIController"),
        "batch_size": g.entry("samples"),
        "time_steps": g.entry("steps"),
        "model_dt": g.entry("step_time", f"at least the controller's period, {PERIOD:g} s as it ships"),
        "temperature": g.entry("temperature"),
        "gamma": g.entry("gamma"),
        "vx_std": g.entry("speed_noise"),
        "vy_std": g.entry("speed_noise"),
        "wz_std": g.entry("yaw_noise"),
        "vx_max": g.most("max_speed", can["v"], "top speed"),
        "vx_min": Entry(-min(g("max_reverse"), can["v"]), g.origin("max_reverse")),
        "wz_max": g.most("max_yaw_rate", can["w"], "top yaw rate"),
        "ax_max": acceleration,
        "ax_min": _lower(acceleration, can["deceleration"], "deceleration"),
        "az_max": g.most("yaw_acceleration", can["yaw_acceleration"], "yaw acceleration"),
    }
    if distro == "lyrical":
        for axis, name in (("v", "vx"), ("w", "wz")):
            shifted = f"delay of the sheet; shifts by {round(can[f'delay_{axis}'] / step)} steps of model_dt"
            block[f"model_delay_{name}"] = Entry(can[f"delay_{axis}"], shifted)
    notes = []
    slowest = max(can["delay_v"] + can["lag_v"], can["delay_w"] + can["lag_w"])
    if distro == "kilted":
        notes.append(
            f"open_loop: {distro} has no such parameter" + (" (it would be proposed)" if slowest > 2.0 * step else "")
        )
        g("open_loop")
    else:
        proposed = distro == "jazzy" and slowest > 2.0 * step and not g("open_loop")
        note = f"try true: delay and lag are {slowest:.2g} s, more than two steps of model_dt" if proposed else ""
        block["open_loop"] = g.entry("open_loop", note)
    if distro != "lyrical":
        notes.append(f"delay {can['delay_v']:.3g} s and {can['delay_w']:.3g} s: {distro} has no model_delay_vx, _wz")
    else:
        notes.append("prune_distance: of the path handler there")
    if distro == "lyrical":
        g("prune_distance")
    else:
        block["prune_distance"] = g.entry("prune_distance")
    block |= _critics(g)
    return _with_comments(block, [*notes, *_costmap_apart(g), *_response(can, with_delay=False)])


def _critics(g: _Gains) -> Block:
    """Returns the critics of MPPI."""
    return {
        "critics": Entry(
            ["ConstraintCritic", "CostCritic", "GoalCritic", "GoalAngleCritic", "PathAlignCritic", "PathFollowCritic",
             "PathAngleCritic", "PreferForwardCritic"]
        ),
        "ConstraintCritic": {"cost_weight": g.entry("constraint")},
        "CostCritic": {
            "cost_weight": g.entry("cost"),
            "collision_cost": g.entry("collision_cost"),
            "near_goal_distance": g.entry("near_goal"),
            "trajectory_point_step": g.entry("cost_stride"),
        },
        "GoalCritic": {"cost_weight": g.entry("goal"), "threshold_to_consider": g.entry("goal_within")},
        "GoalAngleCritic": {
            "cost_weight": g.entry("goal_angle"),
            "threshold_to_consider": g.entry("goal_angle_within"),
        },
        "PathAlignCritic": {
            "cost_weight": g.entry("path_align"),
            "threshold_to_consider": g.entry("path_align_from"),
            "offset_from_furthest": g.entry("path_align_offset"),
            "trajectory_point_step": g.entry("align_stride"),
            "max_path_occupancy_ratio": g.entry("most_occupied"),
        },
        "PathFollowCritic": {
            "cost_weight": g.entry("path_follow"),
            "threshold_to_consider": g.entry("path_follow_from"),
            "offset_from_furthest": g.entry("path_follow_offset"),
        },
        "PathAngleCritic": {
            "cost_weight": g.entry("path_angle"),
            "threshold_to_consider": g.entry("path_angle_from"),
            "offset_from_furthest": g.entry("path_angle_offset"),
            "max_angle_to_furthest": g.entry("path_angle_beyond"),
        },
        "PreferForwardCritic": {
            "cost_weight": g.entry("prefer_forward"),
            "threshold_to_consider": g.entry("prefer_forward_from"),
        },
    }  # fmt: skip


def _lower(entry: Entry, limit: float, what: str) -> Entry:
    """Returns minus an acceleration, or minus the sheet's deceleration where that is less."""
    value = float(entry.value)  # type: ignore[arg-type]
    return Entry(-value, entry.origin) if value <= limit else Entry(-limit, f"{what} of the sheet")


def _costmap_apart(g: _Gains) -> list[str]:
    """Returns the comments of a controller on a costmap, whose inflation is among the costmaps' parameters."""
    g("inflation_radius")
    g("cost_scaling")
    return g.unmapped()


def _response(can: Mapping[str, float], with_delay: bool = True) -> list[str]:
    """Returns what Nav2 cannot be given of how the base answers, as comments."""
    lag = f"lag {can['lag_v']:.3g} s and {can['lag_w']:.3g} s"
    lines = [f"{lag}: Nav2 has no model of it; the limits of velocity_smoother help"]
    if max(abs(can["gain_v"] - 1.0), abs(can["gain_w"] - 1.0)) > 0.01:
        gain = f"gain {can['gain_v']:.3g} and {can['gain_w']:.3g}"
        lines.append(f"{gain}: Nav2 takes what it asks for as reached; correct it in the driver of the base")
    if with_delay and max(can["delay_v"], can["delay_w"]) > 0.0:
        lines.append(f"delay {can['delay_v']:.3g} s and {can['delay_w']:.3g} s: this controller has no model of it")
    return lines


def _with_comments(block: Block, comments: Sequence[str]) -> Block:
    return {**block, **{f"# {k}": text for k, text in enumerate(comments)}}


_MADE = {"regulated_pure_pursuit": pursuit, "nav2_dwb": window, "nav2_mppi": sampling}


def parameters(sources: Sequence[Tuned], robot: Robot, distro: str, tolerances: bool = False) -> Block:
    """Returns Nav2's parameters: the controllers of gains, the velocity smoother, both costmaps.

    Args:
        sources: one of each policy; the first becomes FollowPath, any other is called as its policy.
        robot: whose limits they keep to.
        distro: of DISTROS.
        tolerances: whether the goal's tolerance is written, too.

    Raises:
        ValueError: if a policy is given twice.
    """
    names = [each.name for each in sources]
    if len(set(names)) < len(names):
        raise ValueError(f"GAINS name {', '.join(names)}; each policy may be given once")
    can = limits(robot)
    ids = ["FollowPath", *names[1:]]
    controllers: Block = {"controller_plugins": Entry(list(ids))}
    for name, source in zip(ids, sources, strict=True):
        controllers[name] = _MADE[source.name](source, can, distro, tolerances)
    smoother: Block = {
        "max_velocity": Entry([can["v"], can["sideways"], can["w"]], f"limits of {robot.name}: m/s, m/s, rad/s"),
        "min_velocity": Entry([-can["v"], -can["sideways"], -can["w"]], f"limits of {robot.name}"),
        "max_accel": Entry(_each(robot, can, ""), f"accelerations of {robot.name}"),
        "max_decel": Entry([-each for each in _each(robot, can, "de")], f"decelerations of {robot.name}"),
    }
    if robot.responds and robot.saturation == "wheels":
        smoother["# saturation"] = (
            "each wheel saturates by itself: Nav2's limits are of each speed alone, and do not know it"
        )
    block: Block = {
        "controller_server": {"ros__parameters": controllers},
        "velocity_smoother": {"ros__parameters": smoother},
    }
    inflating = next((each for each in sources if "inflation_radius" in each.gains), None)
    for name in ("local_costmap", "global_costmap"):
        costmap = _hull(robot)
        if inflating is not None:
            g = _Gains(inflating)
            costmap["inflation_layer"] = {
                "inflation_radius": g.entry("inflation_radius"),
                "cost_scaling_factor": g.entry("cost_scaling"),
            }
        block[name] = {name: {"ros__parameters": costmap}}
    return block


def _each(robot: Robot, can: Mapping[str, float], kind: str) -> list[float]:
    names = ("deceleration", "yaw_deceleration") if kind else ("acceleration", "yaw_acceleration")
    return [can[names[0]], can[names[0]] if robot.holonomic else 0.0, can[names[1]]]


def _hull(robot: Robot) -> Block:
    """Returns the hull as costmaps have it."""
    if robot.hull_box is None:
        return {"robot_radius": Entry(robot.hull_radius, f"hull of {robot.name}, m")}
    x, y = (0.5 * each for each in robot.hull_box)
    corners = ", ".join(f"[{robot.hull_x + a * x:g}, {b * y:g}]" for a, b in ((1, 1), (1, -1), (-1, -1), (-1, 1)))
    return {"footprint": Entry(f"[{corners}]", f"hull of {robot.name}, m")}


def yaml_text(block: Block, header: Sequence[str]) -> str:
    """Returns the parameters as YAML, with each value's origin behind it."""
    return "\n".join([*(f"# {printable(line)}" for line in header), *_lines(block, "")]) + "\n"


def _lines(block: Block, indent: str) -> list[str]:
    lines = []
    for name, content in block.items():
        if isinstance(content, str):
            lines.append(f"{indent}# {printable(content)}")
        elif isinstance(content, Entry):
            comment = f"  # {printable(content.origin)}" if content.origin else ""
            lines.append(f"{indent}{name}: {_value(content.value)}{comment}")
        else:
            lines += [f"{indent}{name}:", *_lines(content, f"{indent}  ")]
    return lines


def _value(value: Any) -> str:
    """Returns a value as YAML has it: floats with a point, which ROS tells from whole numbers."""
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, str):
        return f'"{value}"'
    if isinstance(value, list):
        return f"[{', '.join(map(_value, value))}]"
    if isinstance(value, int):
        return str(value)
    if not math.isfinite(value):
        raise ValueError(f"a parameter is {value}; a sheet whose accelerations are finite is needed")
    text = f"{value + 0.0:.6g}"  # no minus before zero
    mantissa, e, exponent = text.partition("e")
    return (mantissa if "." in mantissa else f"{mantissa}.0") + e + exponent


@click.command("nav2", cls=OneLineErrors)
@click.argument("gains", nargs=-1, required=True)
@robot_option("The base, such as `wayfield identify` wrote it.", required=True)
@click.option("--distro", type=Choice("--distro", DISTROS), default="jazzy", show_default=True, help="Of ROS 2.")
@click.option("--tolerances", is_flag=True, help="The goal's tolerance, too.")
@click.option("--out", type=click.Path(path_type=Path), help="The file, .yaml.  [default: printed]")
def main(gains: tuple[str, ...], robot: Robot, distro: str, tolerances: bool, out: Path | None) -> None:
    """Writes GAINS and a data sheet as Nav2's parameters, to be merged into one's own.

    GAINS are files of `wayfield tune`, or names of policies: regulated_pure_pursuit, nav2_dwb, nav2_mppi. The first
    becomes FollowPath.
    """
    if out is not None and out.suffix not in (".yaml", ".yml"):
        raise click.UsageError(f"--out {str(out)!r} must end in .yaml")
    try:
        sources = [tuned(word, robot) for word in gains]
        block = parameters(sources, robot, distro, tolerances)
        header = [
            f"Nav2 parameters for {distro} (names as of navigation2 {COMMITS[distro]}), wayfield {__version__}:",
            command_given("nav2"),
            "A start, not a promise: gains are those of wayfield's plan and costmap, Nav2's differ. Merge it.",
            *(line for source in sources for line in source.about),
        ]
        text = yaml_text(block, header)
    except OSError as error:
        raise click.UsageError(unread(error.filename, error) if error.filename else str(error)) from None
    except ValueError as error:
        raise click.UsageError(str(error)) from None
    if out is None:
        click.echo(text, nl=False)
    else:
        write_whole(out, text.encode())
        say(f"Parameters: {out}")


if __name__ == "__main__":
    main(prog_name="nav2", args=sys.argv[1:])
