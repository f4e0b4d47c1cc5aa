"""How a command ends, and what its options take, stated once more."""

import contextlib
import errno
import importlib
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import click
import pytest
from click.testing import CliRunner

from wayfield.envs import command_line
from wayfield.envs.cluster import NoScheduler
from wayfield.envs.engines import Failed
from wayfield.envs.robots import ROBOTS


def ending(work: Any, *words: str) -> tuple[int, str, str]:
    """Returns the status, the output and the errors of a command that does some work."""

    @click.command("name", cls=command_line.OneLineErrors)
    @click.option("--number", type=command_line.Finite(0.0, 5.0), default=1.0)
    @click.argument("rest", nargs=-1)
    def run(number: float, rest: tuple[str, ...]) -> None:
        work(number, *rest)

    result = CliRunner().invoke(run, list(words))
    return result.exit_code, result.stdout, result.stderr


def raising(error: BaseException) -> Any:
    def work(*_: Any) -> None:
        raise error

    return work


@pytest.mark.parametrize(
    ("error", "status", "line"),
    [
        (click.UsageError("wrong\n words"), 2, "wrong words"),
        (click.ClickException("no"), 1, "no"),
        (KeyboardInterrupt(), 130, "interrupted; nothing was written"),
        (click.Abort(), 130, "interrupted; nothing was written"),
        (Failed([(3, ValueError("no"))], 7, 2), 1, "1 of 7 failed twice: 3 (ValueError: no)"),
        (MemoryError(), 1, "out of memory"),
        (MemoryError("of it"), 1, "out of memory: of it"),
        (OSError(errno.ENOSPC, "full", "a.csv"), 1, "the disk is full: a.csv"),
        (OSError(errno.ENOSPC, "full"), 1, "the disk is full"),
        (OSError(errno.EACCES, "Permission denied", "b"), 1, "[Errno 13] Permission denied: 'b'"),
        (ConnectionError("lost"), 1, "lost"),
        (click.ClickException("x" * 1000), 1, "x" * 1000),
        (click.ClickException("x" * 600 + "y" * 401), 1, "x" * 500 + " ... " + "x" * 99 + "y" * 401),
    ],
)
def test_a_command_ends_in_a_line_and_a_status(error: BaseException, status: int, line: str) -> None:
    assert ending(raising(error)) == (status, "", f"name: {line}\n")


def test_where_nobody_reads_nothing_is_said() -> None:
    assert ending(raising(BrokenPipeError(errno.EPIPE, "gone"))) == (141, "", "")

    def rich() -> None:
        try:
            raise BrokenPipeError(errno.EPIPE, "gone")
        except BrokenPipeError:
            raise SystemExit(1)  # noqa: B904

    assert ending(lambda *_: rich()) == (141, "", "")
    assert ending(raising(SystemExit(3))) == (3, "", "")
    result = CliRunner().invoke(click.command("n", cls=command_line.OneLineErrors)(lambda: click.echo("done")), [])
    assert (result.exit_code, result.stdout) == (0, "done\n")


def test_the_words_of_a_command_are_told_as_a_shell_takes_them() -> None:
    said: list[Any] = []
    work = lambda *_: said.append((command_line.words_given(), command_line.command_given("run.py")))  # noqa: E731
    ending(work, "--number", "2", "a b")
    ending(work)
    assert said == [("--number 2 'a b'", "run.py --number 2 'a b'"), ("", "run.py")]

    @click.command("name", cls=command_line.OneLineErrors)
    def own() -> None:
        said.append(command_line.command_given("run.py"))

    CliRunner().invoke(own, [], prog_name="wayfield name")
    assert said[-1] == "wayfield name"


@pytest.mark.parametrize(
    ("word", "found"),
    [("0", 0.0), ("5", 5.0), ("2.5", 2.5), ("-0.1", None), ("5.1", None), ("nan", None), ("inf", None), ("x", None)],
)
def test_numbers_of_a_range(word: str, found: float | None) -> None:
    said: list[Any] = []
    status, _, line = ending(said.append, f"--number={word}")
    assert said == ([] if found is None else [found])
    assert status == (2 if found is None else 0)
    assert ("--number" in line) == (found is None)
    unbounded = command_line.Finite()
    for value in ("nan", "inf", "-inf"):
        with pytest.raises(click.UsageError, match=f"'{value}' is no finite number"):
            unbounded.convert(value, None, None)
    assert unbounded.convert("-7", None, None) == -7.0


def refused(words: str, kind: click.ParamType, value: Any) -> None:  # type: ignore[type-arg]
    with pytest.raises(click.UsageError, match=re.escape(words)):
        kind.convert(value, None, None)


def test_names_robots_and_scales(tmp_path: Path) -> None:
    context = click.Context(click.Command("c"))
    option = click.Option(["--f"])
    one, many = command_line.Choice("--f", ["slow", "fast"]), command_line.Names("--f", ["slow", "fast"])
    assert one.get_metavar(option, context) == "slow|fast"
    assert many.get_metavar(option, context) == "a,b,..."
    assert one.convert("fast", None, None) == "fast"
    assert many.convert("fast, slow,fast", None, None) == ("fast", "slow")
    for kind, value in ((one, "sloow"), (many, "fast,sloow")):
        refused("--f='sloow' is unknown. Did you mean 'slow'? Choose from 'slow', 'fast'.", kind, value)
    refused("--f='' is unknown", many, "fast,")
    robot = command_line.RobotChoice("--robot")
    assert robot.get_metavar(option, context) == "|".join([*ROBOTS, "FILE.json"])
    assert robot.convert("omni4", None, None) is ROBOTS["omni4"]
    refused("--robot", robot, "omni5")
    refused("--robot 'no.json' cannot be read: No such file or directory", robot, "no.json")
    file = tmp_path / "mine.json"
    file.write_text("{")
    with pytest.raises(click.UsageError) as error:
        robot.convert(str(file), None, None)
    assert str(error.value).startswith("--robot ")
    assert str(error.value).count("--robot") == 1
    scale = command_line.Scale()
    for word, factor in (("2", 2.0), ("1:50", 0.02), ("3:4", 0.75), ("0.5:", 0.5)):
        assert scale.convert(word, None, None) == factor
    for word in ("0", "-1", "1:0", "a", "1:b", "inf", "nan", "1:-2"):
        refused(f"--scale {word!r} must be a number above 0 or a ratio such as 1:50", scale, word)
    assert command_line.SEED.convert("0", None, None) == 0
    assert command_line.SEED.convert(str(2**31 - 1), None, None) == 2**31 - 1
    for word in ("-1", str(2**31)):
        refused("is not in the range", command_line.SEED, word)


def test_work_is_shared_out_as_the_command_was_told(monkeypatch: pytest.MonkeyPatch) -> None:
    said: list[Any] = []

    def engine(kind: str, fails: bool = False) -> Any:
        @contextlib.contextmanager
        def made(*args: Any) -> Iterator[Any]:
            said.append((kind, *args))
            if fails:
                raise NoScheduler("is none")
            yield kind
            said.append("closed")

        return made

    @click.command("name", cls=command_line.OneLineErrors)
    @command_line.on_cluster
    def run() -> None:
        said.append(command_line.cluster_given())
        with command_line.shared_out(3) as made:
            said.append(made)

    def result(*words: str) -> tuple[int, str, list[Any]]:
        said.clear()
        found = CliRunner().invoke(run, list(words))
        return found.exit_code, found.stderr, list(said)

    monkeypatch.setattr(command_line, "workers", engine("here"))
    monkeypatch.setattr(command_line, "cluster", engine("there"))
    monkeypatch.setattr(command_line.importlib.util, "find_spec", lambda name: name)
    assert command_line.cluster_given() is None
    assert result() == (0, "", [None, ("here", 3), "here", "closed"])
    assert result("--cluster", "a:1") == (0, "", ["a:1", ("there", "a:1", 3), "there", "closed"])
    assert result("--cluster", " ")[:2] == (2, "name: --cluster is empty; it must be a scheduler's address, or local\n")
    monkeypatch.setattr(command_line, "cluster", engine("there", fails=True))
    status, line, _ = result("--cluster", "a:1")
    assert (status, line.startswith("name: --cluster 'a:1' ")) == (1, True)
    monkeypatch.setattr(command_line.importlib.util, "find_spec", lambda name: None)
    assert result("--cluster", "a:1")[:2] == (
        1, 'name: --cluster needs distributed: pip install "wayfield[cluster]"\n',
    )  # fmt: skip


def test_what_was_said_is_sent_before_a_command_ends(monkeypatch: pytest.MonkeyPatch) -> None:
    said: list[Any] = []

    class Stream:
        def __init__(self, error: OSError | None) -> None:
            self.error = error

        def flush(self) -> None:
            said.append("flushed")
            if self.error is not None:
                raise self.error

        def fileno(self) -> int:
            return 77

    monkeypatch.setattr(command_line.os, "open", lambda *args: said.append(args) or 5)
    monkeypatch.setattr(command_line.os, "dup2", lambda *args: said.append(args))
    command_line._close_quietly(Stream(None))
    assert said == ["flushed"]
    command_line._close_quietly(Stream(OSError()))
    assert said == ["flushed", "flushed", (command_line.os.devnull, command_line.os.O_WRONLY), (5, 77)]


SEEDS = (0, 0, 2**31 - 1)  # of NumPy's older generators too
COUNTED = (1, 1, None)
# What a command takes where it is told nothing, and between which ends a number may be: a result names the command that
# made it, and whoever gives that again counts on the same.
TOLD: dict[str, dict[str, Any]] = {
    "benchmarks.coverage": {"simulations": (1000, 10, None), "seed": (0, 0, None)},
    "benchmarks.tune": {
        "robot": "p3dx", "speed": (0.6, 0.05, 3.0), "level": "none", "actuators": "lagged", "seed": SEEDS,
        "frames": (2_000_000, 1, None), "trials": (400, 1, None), "scenarios": (10, 1, None),
    },
    "benchmarks.tune_all": {
        "frames": (8_000_000, 1, None), "trials": (400, 1, None), "scenarios": (10, 1, None), "seed": SEEDS,
        "count": COUNTED,
    },
    "benchmarks.cluster_cost": {"parts": (2000, 10, None), "count": (40, 2, None), "seconds": (0.5, 0.01, 60.0)},
    "benchmarks.pictures": {"out": "docs/pictures"},
    "benchmarks.publish": {"first": True, "results": "results", "root": "."},
    "benchmarks.faults.__main__": {
        "minutes": (10.0, 0.0, 10_000.0), "seed": (0, 0, 2**32 - 1), "out": "results/faults",
    },
    "benchmarks.record": {
        "split": "train", "episodes": (100, 1, 10_000_000), "robot": "p3dx", "dynamics": "kinematic", "seed": SEEDS,
        "actuators": "lagged", "disturbance": "none", "gains": "best", "exploration": 0.0,
    },
    "benchmarks.report.demo": {"out": "docs/demo.html"},
    "benchmarks.coppelia_latency": {"calls": (2000, 10, None), "seconds": (5.0, 0.1, 600.0), "dynamics": "kinematic"},
    "benchmarks.video": {"actuators": "lagged", "seed": SEEDS, "gains": "tuned", "pace": (1.0, 0.1, 100.0)},
    "benchmarks.evaluate": {"seed": SEEDS},
    "benchmarks.learners": {"seeds": (3, 2, 100), "home": "results/training"},
    "benchmarks.robot_page": {"docs": "docs"},
    "benchmarks.throughput": {"rounds": (5, 1, None), "seconds": 0.5},
    "benchmarks.decisions": {"robot": "p3dx", "rounds": (3, 1, None)},
    "benchmarks.transfer": {"rooms": (16, 1, 1000), "seed": SEEDS, "count": COUNTED},
    "benchmarks.play": {
        "actuators": "lagged", "seed": SEEDS, "gains": "tuned", "speed": (0.6, 0.0, None), "yaw_rate": (1.5, 0.0, None),
        "size": (800, 300, 4000),
    },
    "benchmarks.coppelia": {"scenario": "figure_eight_lap", "actuators": "ideal", "count": COUNTED, "seed": SEEDS},
    "policies.training.command": {"seed": SEEDS, "seeds": (1, 1, 1000)},
    "policies.training.offline": {"count": (20_000, 1, 100_000_000), "seed": SEEDS, "seeds": (1, 1, 1000)},
    "envs.coppelia.__main__": {
        "scene": "document-a", "index": (0, 0, None), "port": (23_000, 0, 65_535), "host": "127.0.0.1", "speed": 1.0,
        "dynamics": "kinematic", "actuators": "ideal", "track": "coppelia", "dt": 0.05, "render": "none",
    },
}  # fmt: skip


@pytest.mark.parametrize("name", TOLD)
def test_what_a_command_takes_where_it_is_told_nothing(name: str) -> None:
    try:
        module = importlib.import_module(f"wayfield.{name}")
    except ModuleNotFoundError as error:
        pytest.skip(f"needs {error.name}")
    found = {}
    for option in module.main.params:
        default = option.default
        if not isinstance(default, bool | int | float | str | Path) or (default is False):
            continue  # none, a flag, or worked out
        least, most = (getattr(option.type, end, None) for end in ("min", "max"))
        told = default.as_posix() if isinstance(default, Path) else default
        found[option.name] = told if (least, most) == (None, None) else (told, least, most)
    assert found == TOLD[name]
