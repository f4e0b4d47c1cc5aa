"""What the sheets of several registered classes share: each class has a whole one, and no text stands twice."""

import inspect
import re
from collections.abc import Mapping

from wayfield.envs.robots import ROBOTS, robots_with
from wayfield.envs.tasks.arguments import Arguments, arguments_table

# Sections are indented like the docstrings that they are put into.
BEYOND_BOUNDS = """Values beyond the bounds are allowed: the base scales all wheels by one factor,
    which keeps the direction of motion. Non-finite values, other shapes and other types are errors."""


def _actions(holonomic: bool) -> str:
    """Returns the table of the actions: what each number is, and its bound for every robot that ships."""
    robots = [ROBOTS[name] for name in robots_with(holonomic)]
    twist = ("v_x, m/s", "v_y, m/s", "yaw rate, rad/s") if holonomic else ("forward speed v, m/s", "yaw rate w, rad/s")
    most = max(len(robot.wheels) for robot in robots)
    wheels = [f"wheel {k + 1}, rad/s" for k in range(most)] if holonomic else ["right, rad/s", "left, rad/s"]
    names = " | ".join(robot.name for robot in robots)
    rows = [f'| index | "twist" | {names} | "wheel_speeds" | {names} |', "|---" * (3 + 2 * len(robots)) + "|"]
    for k in range(max(len(twist), most)):
        bounds = [f"{robot.max_twist[k]:.3g}" if k < len(twist) else "" for robot in robots]
        speeds = [f"{robot.rated_wheel_speed:.4g}" if k < len(robot.wheels) else "" for robot in robots]
        component = twist[k] if k < len(twist) else ""
        rows.append(f"| {k} | {component} | {' | '.join(bounds)} | {wheels[k]} | {' | '.join(speeds)} |")
    return "\n    ".join(rows)


DIFF_DRIVE_ACTIONS = f"""`Box(2,)` float32, with these bounds by `action_mode`. {BEYOND_BOUNDS}

    {_actions(False)}"""

OMNI_ACTIONS = f"""`Box(3,)` float32 for `action_mode="twist"`, a number for each wheel for `"wheel_speeds"`.
    {BEYOND_BOUNDS}

    {_actions(True)}"""

DIFF_DRIVE_ODOMETRY = '"odometry" integrates the encoders of the drive wheels.'

OMNI_ODOMETRY = """"odometry" reads the two passive encoder wheels and the IMU of omni3 (and of a data sheet with
    `encoders`), and the drive wheels of the others; "odometry_uncorrected" leaves out the rotation term of the
    passive wheels, "odometry_plain_sum" uses the forward map that documents B and C print, of omni wheels. In the
    tier "ideal" the wheels turn up to 200 rad/s, so that document B's unsaturated runs can be shown; in the other
    tiers the bounds of the action space hold."""


def arguments_and_odometry(arguments: type[Arguments], *, holonomic: bool) -> str:
    """Returns two sections of a sheet, indented as it is: what an environment takes, and what odometry reads."""
    return f"""## Arguments

    {arguments_table(arguments, holonomic)}

    ## Odometry and wheels

    {OMNI_ODOMETRY if holonomic else DIFF_DRIVE_ODOMETRY}"""


def sheet_like(
    other: type, summary: str, sections: Mapping[str, str] | None = None, *, arguments: type[Arguments], holonomic: bool
) -> str:
    """Returns a registered class's docstring: the whole sheet of another class but for what is not alike.

    Args:
        sections: the text of the sections that are not, by heading; all keep their order.
        arguments: what its environment takes.
        holonomic: whether it is of omni bases: actions, arguments and odometry follow from it.

    Raises:
        ValueError: if the other sheet has no such section.
    """
    if other.__doc__ is None:  # python -OO
        return summary
    whole = inspect.cleandoc(other.__doc__)
    for omni, differential in ((OMNI_ACTIONS, DIFF_DRIVE_ACTIONS), (OMNI_ODOMETRY, DIFF_DRIVE_ODOMETRY)):
        old, new = (differential, omni) if holonomic else (omni, differential)
        whole = whole.replace(inspect.cleandoc(old), inspect.cleandoc(new))
    pieces = re.split(r"^## (.*)\n", whole, flags=re.MULTILINE)
    sheet = dict(zip(pieces[1::2], pieces[2::2], strict=True))
    for heading, text in {"Arguments": arguments_table(arguments, holonomic), **(sections or {})}.items():
        if heading not in sheet:
            raise ValueError(f"the sheet of {other.__name__} has no section {heading!r}, only {', '.join(sheet)}")
        sheet[heading] = inspect.cleandoc(text)
    return "\n\n".join([summary, *(f"## {heading}\n\n{text.strip()}" for heading, text in sheet.items())]) + "\n"
