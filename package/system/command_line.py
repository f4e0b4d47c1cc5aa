"""Command lines that end in one line whatever the user or the machine does, and the kinds of values that they take.

Only commands import this module: it needs click, which the core install does without.
"""

import contextlib
import errno
import functools
import importlib.util
import math
import os
import shlex
import sys
import warnings
from collections.abc import Callable, Iterable, Iterator
from importlib.metadata import version
from typing import Any, NoReturn, TypeVar

import click

from wayfield.starting import Terminated, started
from wayfield.system.checks import choose, printable
from wayfield.system.cluster import NoScheduler, cluster
from wayfield.system.executors import Executor, Failed, workers
from wayfield.system.extras import installs
from wayfield.system.objects import FileNote

SEED = click.IntRange(0, 2**31 - 1)  # what every generator that is seeded takes
_INTERRUPTED = 128 + 2  # exit statuses as a shell reports them: 128 and the number of the signal
_UNREAD = 128 + 13
_LONGEST = 1000  # characters of a message


class OneLineErrors(click.Command):
    """A command that ends in one line on stderr and a status: 2 for wrong input, 1 for the rest, 130 for Ctrl-C and 143
    for SIGTERM.

    Nothing is said, and the status is 141, where the reader of the output has gone, such as `head`. What remains a
    traceback is a defect of ours.
    """

    interrupted = "interrupted; nothing was written"

    def __init__(self, *args: Any, **kwargs: Any) -> None:
        super().__init__(*args, **kwargs)
        self._warnings_said: set[str] = set()
        self.context_settings.setdefault("help_option_names", ["-h", "--help"])
        click.version_option(version("wayfield"), "-V", "--version", message="wayfield %(version)s")(self)

    def main(self, *args: Any, **kwargs: Any) -> NoReturn:
        """Runs the command and exits."""
        started()
        kwargs["standalone_mode"] = False
        _prepare_streams()
        with self._ending(), warnings.catch_warnings():
            warnings.showwarning = functools.partial(self._warned, warnings.showwarning)
            super().main(*args, **kwargs)
            sys.stdout.flush()
        sys.exit(0)

    def make_context(self, *args: Any, **kwargs: Any) -> click.Context:
        """Returns the context of the words, or ends, before click makes something else of what was raised."""
        with self._ending():
            return super().make_context(*args, **kwargs)

    def invoke(self, ctx: click.Context) -> Any:
        """Does the work, or ends, before click makes something else of what was raised."""
        with self._ending():
            return super().invoke(ctx)

    @contextlib.contextmanager
    def _ending(self) -> Iterator[None]:
        """Turns what is the user's or the machine's into the end of the process."""
        try:
            yield
        except click.ClickException as error:
            self._exit(error.exit_code, error.format_message())
        except (click.Abort, KeyboardInterrupt):
            self._exit(_INTERRUPTED, self.interrupted)
        except Failed as error:
            self._exit(1, str(error))
        except MemoryError as error:
            self._exit(1, f"out of memory: {error}" if str(error) else "out of memory")
        except OSError as error:
            if error.errno == errno.EPIPE:
                self._exit(_UNREAD)
            where = f": {os.path.abspath(error.filename)}" if isinstance(error.filename, str | os.PathLike) else ""
            cause = "the disk is full" if error.errno == errno.ENOSPC else error.strerror
            self._exit(1, f"{cause}{where}" if cause else str(error))
        except Terminated as ended:
            self._exit(int(str(ended.code)), self.interrupted)
        except SystemExit as ended:
            if isinstance(ended.__context__, BrokenPipeError):  # rich makes an exit of its own of it
                self._exit(_UNREAD)
            raise

    def _warned(self, otherwise: Callable[..., None], message: Any, category: Any, *where: Any, **kwargs: Any) -> None:
        """Prints warnings for the user as a line, and others as Python does."""
        if issubclass(category, UserWarning) or str(message).startswith("wayfield "):  # of its compiled code
            line = f"{self.name}: {printable(str(message))}"
            if line not in self._warnings_said:  # a file is read anew by each part of a run
                self._warnings_said.add(line)
                click.echo(line, err=True)
        else:
            otherwise(message, category, *where, **kwargs)

    def parse_args(self, ctx: click.Context, args: list[str]) -> list[str]:
        """Parses the words of the command and keeps them for `words_given`."""
        ctx.meta[_WORDS] = shlex.join(args)
        words = list(args)  # click empties the list that it is given
        try:
            rest = super().parse_args(ctx, args)
            given = self.make_parser(ctx).parse_args(words)[2]
        except click.UsageError as error:
            options = {each for param in self.params for each in param.opts}
            for word in words:
                meant = "--" + word.lstrip("-\u2013\u2014").partition("=")[0]  # and the dashes of a page's typesetter
                if word[:1] in "-\u2013\u2014" and not word.startswith("--") and meant in options:
                    raise click.UsageError(f"{word!r} is no option. Did you mean {meant!r}?", ctx) from None
            if "unexpected extra argument" not in error.message:
                raise
            example = " --policies lqr,mpc" if any("--policies" in each.opts for each in self.params) else " a,b"
            how = f"; each value stands behind its option, several are separated by commas alone:{example}"
            raise click.UsageError(error.message + how, ctx) from None
        for option in {each: None for k, each in enumerate(given) if each in given[:k]}:
            # click takes the last value and drops the others without a word
            if isinstance(option, click.Option) and not (option.multiple or option.is_flag):
                told = f"{option.opts[-1]} is given more than once"
                if isinstance(option.type, Names):  # of which nobody drops some on purpose
                    raise click.UsageError(f"{told}; several values are one word: a,b", ctx)
                click.echo(f"{self.name}: {told}; the last counts", err=True)
        return rest

    def _exit(self, status: int, message: str = "") -> NoReturn:
        try:
            if message:
                line = printable(" ".join(message.split()))
                if len(line) > _LONGEST:  # of what was typed; where it begins and what is wrong with it
                    line = f"{line[: _LONGEST // 2]} ... {line[-_LONGEST // 2 :]}"
                click.echo(f"{self.name}: {line}", err=True)
        except OSError:  # nobody reads it
            pass
        for stream in (sys.stdout, sys.stderr):
            _close_quietly(stream)
        sys.exit(status)


_WORDS = f"{__name__}.words"


def words_given() -> str:
    """Returns the words after the name of the command that runs, quoted for a shell."""
    return str(click.get_current_context().meta[_WORDS])


def command_given(script: str) -> str:
    """Returns the whole command that runs, as it was given to `wayfield NAME` or to a script of the same."""
    path = click.get_current_context().command_path
    return f"{path if path.startswith('wayfield ') else script} {words_given()}".strip()


def say(text: str, err: bool = False) -> None:
    """Prints lines that hold names of the user's: control characters in them are shown, not obeyed."""
    click.echo("\n".join(map(printable, text.split("\n"))), err=err)


_CLUSTER = f"{__name__}.cluster"
_Command = TypeVar("_Command", bound=Callable[..., Any])


def on_cluster(function: _Command) -> _Command:
    """Adds the option --cluster to a command, whose work `shared_out` then shares out."""

    def checked(ctx: click.Context, param: click.Parameter, value: str | None) -> None:
        del param
        if value is not None and not value.strip():
            raise click.UsageError("--cluster is empty; it must be a scheduler's address, or local")
        ctx.meta[_CLUSTER] = value

    return click.option(
        "--cluster",
        metavar="ADDRESS",
        help="Distribute the work over the scheduler of a Dask cluster, such as tcp://host:8786; local: start a "
        "scheduler on this machine, with the usual number of processes.",
        expose_value=False,
        callback=checked,
    )(function)


def cluster_given() -> str | None:
    """Returns the address that the command which runs was given; None where the work stays on this machine."""
    context = click.get_current_context(silent=True)
    return None if context is None else context.meta.get(_CLUSTER)


@contextlib.contextmanager
def shared_out(count: int) -> Iterator[Executor]:
    """Yields the executor of --cluster, or of `count` processes of this machine where it was not given.

    Raises:
        click.ClickException: if there is no scheduler to work with.
        ConnectionError: while it works, if the scheduler is lost.
    """
    address = cluster_given()
    if address is None:
        with workers(count) as executor:
            yield executor
        return
    if importlib.util.find_spec("distributed") is None:
        raise click.ClickException(f"--cluster needs distributed: {installs('cluster')}")
    try:
        with cluster(address, count) as executor:
            yield executor
    except NoScheduler as error:
        raise click.ClickException(f"--cluster {address!r} {error}") from None


def _prepare_streams() -> None:
    """Makes stdout and stderr take every text, and be there where the caller has closed them."""
    for name in ("stdout", "stderr"):
        stream = getattr(sys, name)
        if stream is None:
            setattr(sys, name, open(os.devnull, "w", encoding="utf-8"))  # noqa: SIM115  as long as the process lives
        elif hasattr(stream, "reconfigure"):
            stream.reconfigure(errors="backslashreplace")


def _close_quietly(stream: Any) -> None:
    """Empties a stream; where that fails the rest goes nowhere, or the interpreter would complain at its end."""
    try:
        stream.flush()
    except OSError:
        os.dup2(os.open(os.devnull, os.O_WRONLY), stream.fileno())


class Choice(click.ParamType):  # type: ignore[type-arg]  # generic from click 8.4 on alone
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


class Finite(click.FloatRange):
    """A number of a range; not NaN, which lies in every one, nor infinity. One beyond `usual` is doubted in a line."""

    def __init__(
        self, least: float, most: float | None = None, min_open: bool = False, usual: float = math.inf
    ) -> None:
        super().__init__(least, most, min_open)
        self.usual = usual

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> float:
        number = float(super().convert(value, param, ctx))
        if not math.isfinite(number):
            self.fail(f"{value!r} is no finite number", param, ctx)
        if number > self.usual and param is not None:
            warnings.warn(f"{param.opts[-1]} is {number:g}, {usual_is(self.usual)}", FileNote, stacklevel=2)
        return number


def usual_is(most: float) -> str:
    """Returns how a number of an option is doubted."""
    return f"usual is at most {most:g}; units are m, s and rad"


class Names(Choice):
    """Names separated by commas."""

    name = "names"

    def get_metavar(self, param: click.Parameter, ctx: click.Context) -> str:
        """Returns what the help shows."""
        del param, ctx
        return "a,b,..."

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        """Returns the names, each once, or fails."""
        names = [name.strip() for name in str(value).split(",") if name.strip()] or [""]
        return tuple(dict.fromkeys(Choice.convert(self, name, param, ctx) for name in names))


class Scale(click.ParamType):  # type: ignore[type-arg]
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
