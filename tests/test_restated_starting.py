"""The `wayfield` command before it is any of its commands: words, Ctrl-C while it is imported, and what is missing."""

import signal
import sys
import types
from typing import Any

import pytest

from wayfield import command, starting


@pytest.fixture
def seen(monkeypatch: pytest.MonkeyPatch) -> list[Any]:
    found: list[Any] = []
    monkeypatch.setattr(command, "started", lambda: found.append("started"))
    return found


def _main(monkeypatch: pytest.MonkeyPatch, *words: str) -> int | None:
    monkeypatch.setattr(sys, "argv", ["wayfield", *words])
    with pytest.raises(SystemExit) as ended:
        command.main()
    assert ended.value.code is None or isinstance(ended.value.code, int)
    return ended.value.code


@pytest.mark.parametrize("words", [(), ("-h",), ("--help",), ("help",), ("-V",), ("--version",), ("nothing",), ("-x",)])
def test_what_ends_at_once_has_started(
    words: tuple[str, ...], seen: list[Any], monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    status = _main(monkeypatch, *words)
    assert seen == ["started"]
    said = capsys.readouterr()
    if words in (("nothing",), ("-x",)):
        assert status == 2
        assert said.err.startswith(f"wayfield: {words[0]!r} is no command.")
        assert ("An option comes behind its command" in said.err) is (words[0] == "-x")
        assert all(name in said.err for name in command.COMMANDS)
        assert not said.out
        return
    assert status == 0
    assert not said.err
    if words in (("-V",), ("--version",)):
        assert said.out == f"wayfield {command.__version__}\n"
    else:
        for name, each in command.COMMANDS.items():
            assert f"  {name:<10} {each.does}\n" in said.out


def test_a_word_that_is_nearly_a_command_is_told(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    assert command._refused("evaluat") == 2
    assert "Did you mean 'evaluate'?" in capsys.readouterr().err
    assert command._refused("qqqqq") == 2
    assert "Did you mean" not in capsys.readouterr().err


def test_a_command_is_handed_its_words(seen: list[Any], monkeypatch: pytest.MonkeyPatch) -> None:
    asked: list[Any] = []
    for name, each in command.COMMANDS.items():
        module = types.SimpleNamespace(**{each.function: lambda **more: asked.append(more)})
        monkeypatch.setattr(
            command.importlib, "import_module", lambda found, module=module: asked.append(found) or module
        )
        monkeypatch.setattr(sys, "argv", ["wayfield", name, "--help", "x"])
        monkeypatch.delenv("OMP_WAIT_POLICY", raising=False)
        command.main()
        assert asked[-2:] == [each.module, {"args": ["--help", "x"], "prog_name": f"wayfield {name}"}]
        assert command.os.environ.get("OMP_WAIT_POLICY") == ("PASSIVE" if name == "train" else None)
        monkeypatch.setenv("OMP_WAIT_POLICY", "ACTIVE")
        command.main()
        assert command.os.environ["OMP_WAIT_POLICY"] == "ACTIVE"
    assert not seen


def test_what_is_missing_is_told_with_its_extra(
    seen: list[Any], monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def fails(error: Exception) -> Any:
        def imported(name: str) -> None:
            raise error

        return imported

    inner = ImportError("install")
    inner.__cause__ = ModuleNotFoundError("no pygame", name="pygame.display")
    for error, name in ((ModuleNotFoundError("no", name="click"), "click"), (inner, "pygame")):
        monkeypatch.setattr(command.importlib, "import_module", fails(error))
        assert _main(monkeypatch, "play") == 1
        assert capsys.readouterr().err == f'wayfield play: {name} is missing: pip install "wayfield[render]"\n'
    for broken in (
        ModuleNotFoundError("no", name="wayfield.envs.x"),
        ImportError("no name"),
        ModuleNotFoundError("no"),
    ):
        monkeypatch.setattr(command.importlib, "import_module", fails(broken))
        monkeypatch.setattr(sys, "argv", ["wayfield", "play"])
        with pytest.raises(ImportError):
            command.main()


@pytest.mark.parametrize(
    ("argv", "orig", "name"),
    [
        (["/bin/wayfield", "tune"], ["python", "/bin/wayfield", "tune"], "wayfield"),
        (["wayfield.exe"], ["wayfield.exe"], "wayfield"),
        (["-m"], ["python", "-m", "wayfield.benchmarks.audit"], "audit"),
        (["-m", "x"], ["python", "-X", "y", "-m", "wayfield.command", "x"], "command"),
        (["-m"], ["python", "-m", "pytest"], ""),
        (["-m"], ["python", "-m", "wayfieldish"], ""),
        (["script.py"], ["python", "script.py"], ""),
        (["script.py", "wayfield"], ["python", "script.py", "wayfield"], ""),
        ([], ["python"], ""),
        (["x", "-m"], ["python", "x", "-m", "wayfield.envs"], ""),
        (["-m"], ["python", "-m"], ""),
    ],
)
def test_which_command_a_process_is(
    argv: list[str], orig: list[str], name: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(sys, "argv", argv)
    monkeypatch.setattr(sys, "orig_argv", orig)
    assert starting._command() == name


def test_ctrl_c_while_it_is_imported_ends_it_in_one_line(monkeypatch: pytest.MonkeyPatch) -> None:
    done: list[Any] = []
    monkeypatch.setattr(starting.os, "write", lambda *words: done.append(words))
    monkeypatch.setattr(starting.os, "_exit", done.append)
    monkeypatch.setattr(starting, "_NAME", "tune")
    starting._interrupted(2, None)
    assert done == [(2, b"tune: interrupted; nothing was written\n"), 130]


def test_ctrl_c_has_its_meaning_back_once_it_has_started(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sys, "unraisablehook", sys.__unraisablehook__)
    before = signal.getsignal(signal.SIGINT)
    try:
        signal.signal(signal.SIGINT, starting._interrupted)
        starting.started()
        assert signal.getsignal(signal.SIGINT) is signal.default_int_handler
        assert sys.unraisablehook is starting.again
        mine = lambda *_: None  # noqa: E731
        signal.signal(signal.SIGINT, mine)
        monkeypatch.setattr(sys, "unraisablehook", mine)
        starting.started()
        assert signal.getsignal(signal.SIGINT) is mine  # another program's stays
        assert sys.unraisablehook is mine
    finally:
        signal.signal(signal.SIGINT, before)


def test_what_fell_into_a_destructor_is_sent_again(monkeypatch: pytest.MonkeyPatch) -> None:
    begun: list[Any] = []
    told: list[Any] = []

    class Timer:
        def __init__(self, *words: Any) -> None:
            self.words = words

        def start(self) -> None:
            begun.append(self.words)

    monkeypatch.setattr(starting.threading, "Timer", Timer)
    monkeypatch.setattr(sys, "__unraisablehook__", told.append)
    for kind, number in ((KeyboardInterrupt, signal.SIGINT), (SystemExit, signal.SIGTERM), (ValueError, None)):
        begun.clear()
        told.clear()
        lost: Any = types.SimpleNamespace(exc_type=kind)
        starting.again(lost)
        if number is None:
            assert (begun, told) == ([], [lost])
        else:
            ((soon, kill, words),) = begun
            assert 0.0 < soon < 0.5
            assert kill is starting.os.kill
            assert words == (starting.os.getpid(), number)
            assert not told
