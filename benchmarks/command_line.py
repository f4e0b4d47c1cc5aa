"""Command lines whose every refusal is one line, and the kinds of values that they take."""

import errno
import math
import os
import sys
from collections.abc import Iterable
from typing import Any, NoReturn

import click

from wayfield.envs.task import choose


class OneLineErrors(click.Command):
    """A command whose every refusal is one line on stderr and an exit status: 2 for wrong input, 1 for the rest."""

    def main(self, *args: Any, **kwargs: Any) -> NoReturn:
        """Runs the command and exits."""
        kwargs["standalone_mode"] = False
        try:
            super().main(*args, **kwargs)
        except click.ClickException as error:
            self._exit(error.exit_code, error.format_message())
        except (click.Abort, KeyboardInterrupt):
            self._exit(130, "interrupted; nothing was written")
        except OSError as error:
            if error.errno == errno.EPIPE:  # the reader of a pipe, such as head, has seen enough
                os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
                sys.exit(0)
            self._exit(1, str(error))
        sys.exit(0)

    def _exit(self, status: int, message: str) -> NoReturn:
        click.echo(f"{self.name}: {' '.join(message.split())}", err=True)
        sys.exit(status)


class Choice(click.ParamType[Any]):
    """One of some names; a wrong one is answered with the nearest."""

    name = "name"

    def __init__(self, field: str, choices: Iterable[str]) -> None:
        self.field = field
        self.choices = tuple(choices)

    def get_metavar(self, param: click.Parameter, ctx: click.Context) -> str:
        """Returns the choices as the help shows them."""
        del param, ctx
        return "|".join(self.choices)

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> str:
        """Returns the name, or fails."""
        del param, ctx
        try:
            choose(self.field, value, self.choices)
        except ValueError as error:
            raise click.UsageError(str(error)) from None
        return str(value)


class Names(Choice):
    """Names separated by commas."""

    name = "names"

    def get_metavar(self, param: click.Parameter, ctx: click.Context) -> str:
        """Returns what the help shows."""
        del param, ctx
        return "a,b,..."

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        """Returns the names, each once, or fails."""
        names = [name.strip() for name in str(value).split(",")]
        return tuple(dict.fromkeys(Choice.convert(self, name, param, ctx) for name in names))


class Scale(click.ParamType[float]):
    """A positive number, or a ratio such as 1:50."""

    name = "number or ratio"

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> float:
        """Returns the factor, or fails."""
        del param, ctx
        try:
            numerator, _, denominator = str(value).partition(":")
            scale = float(numerator) / float(denominator or 1.0)
        except (ValueError, ZeroDivisionError):
            scale = math.nan
        if not 0.0 < scale < math.inf:
            raise click.UsageError(f"--scale {value!r} must be a number above 0 or a ratio such as 1:50")
        return scale
