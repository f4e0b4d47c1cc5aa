"""What the sheets of several registered classes share: each class has a whole one, and no text stands twice."""

import inspect
import re
from collections.abc import Mapping
from typing import Any

# Sections are indented like the docstrings that they are put into.
BEYOND_BOUNDS = """Values beyond the bounds are allowed: the base scales all wheels by one factor,
    which keeps the direction of motion. Non-finite values, other shapes and other types are errors."""

DIFF_DRIVE_ACTIONS = f"""`Box(2,)` float32. {BEYOND_BOUNDS}

    | index | `action_mode="twist"` | bound | `action_mode="wheel_speeds"` | bound |
    |---|---|---|---|---|
    | 0 | forward speed v, m/s | 1.2 | right wheel, rad/s | 12.31 |
    | 1 | yaw rate w, rad/s | 6.30 | left wheel, rad/s | 12.31 |"""

OMNI_ACTIONS = f"""`Box(3,)` float32 for `action_mode="twist"`, `Box(3,)` or `Box(4,)` for `"wheel_speeds"`.
    {BEYOND_BOUNDS}

    | index | "twist" | omni3 | omni4 | "wheel_speeds" | omni3 | omni4 |
    |---|---|---|---|---|---|---|
    | 0 | v_x, m/s | 1.73 | 1.27 | wheel 1, rad/s | 20 | 30 |
    | 1 | v_y, m/s | 1.5 | 1.27 | wheel 2, rad/s | 20 | 30 |
    | 2 | yaw rate, rad/s | 5.0 | 6.92 | wheel 3, rad/s | 20 | 30 |
    | 3 | | | | wheel 4, rad/s | | 30 |"""

DIFF_DRIVE_ODOMETRY = '"odometry" integrates the encoders of the drive wheels.'

OMNI_ODOMETRY = """"odometry" reads omni3's two passive encoder wheels and IMU, and omni4's drive wheels;
    "odometry_uncorrected" leaves out the rotation term of the passive wheels, "odometry_plain_sum" uses the forward map
    that documents B and C print. In the tier "ideal" the wheels turn up to 200 rad/s, so that document B's unsaturated
    runs can be shown; in the other tiers the bounds of the action space hold."""


def signature_like(other: type, **defaults: Any) -> inspect.Signature:
    """Returns the signature of another registered class, but for the defaults of some arguments."""
    signature = inspect.signature(other)
    changed = [
        each.replace(default=defaults[name]) if name in defaults else each
        for name, each in signature.parameters.items()
    ]
    return signature.replace(parameters=changed)


def sheet_like(other: type, summary: str, sections: Mapping[str, str], arguments: Mapping[str, str]) -> str:
    """Returns a registered class's docstring: the whole sheet of another class but for what is not alike.

    Args:
        sections: the text of the sections that are not, by heading; all keep their order.
        arguments: the rest of the row of each argument that is not, by the argument's name.

    Raises:
        ValueError: if the other sheet has no such section or argument.
    """
    if other.__doc__ is None:  # python -OO
        return summary
    pieces = re.split(r"^## (.*)\n", inspect.cleandoc(other.__doc__), flags=re.MULTILINE)
    sheet = dict(zip(pieces[1::2], pieces[2::2], strict=True))
    for heading, text in sections.items():
        if heading not in sheet:
            raise ValueError(f"the sheet of {other.__name__} has no section {heading!r}, only {', '.join(sheet)}")
        sheet[heading] = inspect.cleandoc(text)
    for name, rest in arguments.items():
        sheet["Arguments"], rows = re.subn(
            rf"^\| {name} \|.*$", f"| {name} | {rest} |", sheet["Arguments"], flags=re.MULTILINE
        )
        if rows != 1:
            raise ValueError(f"the sheet of {other.__name__} has {rows} rows for the argument {name!r}, not one")
    return "\n\n".join([summary, *(f"## {heading}\n\n{text.strip()}" for heading, text in sheet.items())]) + "\n"
