"""The option of commands that names a robot.

Only commands import this module: it needs click, which the core install does without.
"""

from collections.abc import Callable
from typing import Any, TypeVar

import click

from wayfield.envs.robots.robot import ROBOTS, Robot, robot_of
from wayfield.system.checks import unread

_Command = TypeVar("_Command", bound=Callable[..., Any])


class RobotChoice(click.ParamType):  # type: ignore[type-arg]
    """A robot that ships, by its name, or one of a data sheet, by its file."""

    name = "robot"

    def __init__(self, field: str) -> None:
        self.field = field

    def get_metavar(self, param: click.Parameter, ctx: click.Context) -> str:
        """Returns the choices as the help shows them."""
        del param, ctx
        return "|".join((*ROBOTS, "FILE.json"))

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Robot:
        """Returns the robot, or fails."""
        del param, ctx
        try:
            return robot_of(value, self.field)
        except OSError as error:
            raise click.UsageError(f"{self.field} {value!r} cannot be read: {unread(value, error)}") from None
        except ValueError as error:
            text = str(error)
            named = text.startswith(("--", f"{self.field}="))
            raise click.UsageError(text if named else f"{self.field} {text}") from None


def robot_option(
    about: str | None = "A robot that ships, or a data sheet.", **settings: Any
) -> Callable[[_Command], _Command]:
    """Returns the option --robot of a command, with its help and what else `click.option` takes."""
    return click.option("--robot", type=RobotChoice("--robot"), help=about, **settings)
