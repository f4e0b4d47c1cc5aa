"""The fault campaign: no reader of files is forgotten, damage is repeatable, and a short campaign finds nothing."""

import ast
import random
import re
import sys
from pathlib import Path

import click
import pytest

import wayfield
from wayfield import benchmarks, envs, policies
from wayfield.benchmarks.faults import campaign, commands, files, mutations, place, server, steps
from wayfield.envs.readers import READERS

OPENING = {
    "open",
    "read_text",
    "read_bytes",
    "loadtxt",
    "genfromtxt",
    "fromfile",
    "safe_open",
    "load_file",
    "imread",
    "ZipFile",
}
LOADING = {"np", "numpy", "json", "pickle", "torch", "onnx"}  # whose `load` reads a file
# what opens a file for reading outside of a registered reader, and why that is right
ALLOWED = {
    ("envs/storage.py", "_alive"): "the system's word about a process",
    ("envs/objects.py", "read_text"): "called by the readers of tables, scenarios and data sheets",
    ("envs/objects.py", "json_object"): "called by the readers of scenarios and data sheets",
    ("envs/scenarios/tables.py", "_points"): "parses lines that were read already",
    ("envs/scenarios/splits.py", "_read"): "called by the reader of splits",
    **{
        ("envs/scenarios/maps.py", name): "called by the reader of maps"
        for name in ("_ros_fields", "_octile", "_brightness")
    },
    ("envs/scenarios/arrays.py", "stored_array"): "called by the readers of maps and of BARN's paths",
    ("envs/scenarios/splits.py", "_shipped"): "a sample",
    ("benchmarks/rooms.py", "digest"): "of files that were drawn in the same run",
    ("envs/scenarios/freeze.py", "_written"): "a developer's tool on the package's own files",
    ("policies/learned/reading.py", "read_bytes"): "called by the readers of agents and training runs",
    ("policies/learned/reading.py", "read_object"): "called by the readers of agents and training runs",
    ("policies/learned/reading.py", "read_arrays"): "called by the readers of agents and training states",
    ("policies/learned/agent.py", "_shipped"): "a sample",
    **{("benchmarks/report/page.py", name): "files of the package" for name in ("asset", "kernel_part")},
    **{
        ("benchmarks/report/wasm.py", name): "builds from the package's own sources"
        for name in ("kernel_digest", "linked")
    },
    (
        "policies/training/slices.py",
        "train_far",
    ): "the bytes of a data sheet, which its reader has read and will read there",
    ("policies/tuned.py", "_read"): "reads bytes for read_gains",
    ("policies/tuned.py", "_read_sample"): "reads bytes for read_gains",
    ("benchmarks/parts.py", "_packed"): "takes what it has just written",
    ("benchmarks/throughput.py", "_resident"): "the system's word about this process",
    ("benchmarks/pictures.py", "sheet_png"): "what it has just drawn",
    ("policies/training/slices.py", "files_of"): "takes a run's files along, whatever their content",
    ("benchmarks/parcels.py", "parcel"): "takes files that were read already along, whatever their content",
    ("benchmarks/parts.py", "_key"): "takes the digest of an agent's card that was read",
    ("benchmarks/run_folder.py", "_publish"): "flushes what it has just written",
    ("benchmarks/run_folder.py", "file_digest"): "takes a digest, whatever the content",
    ("envs/identity.py", "source_digest"): "takes the digest of the package's own files",
    ("benchmarks/archive.py", "__enter__"): "called by the readers of trajectories and drives",
    ("benchmarks/results.py", "read_table"): "called by the readers of episodes and decisions",
    ("envs/coppelia/codec.py", "_request_of_file"): "calls the reader of requests",
    ("envs/scenarios/files.py", "kind_of"): "called by the readers of scenarios of one's own",
    ("benchmarks/robot_page.py", "main"): "a developer's tool on the repository's own pages",
    ("benchmarks/page.py", "text"): "a developer's tool on the repository's own pages",
    ("benchmarks/video.py", "_mp4"): "takes what the encoder has just written",
    ("benchmarks/publish.py", "gathered"): "takes over files whose digests its run has written down",
}


def _readings(tree: ast.Module) -> list[tuple[str, int]]:
    """Returns the function and line of every call that opens a file for reading outside of a registered reader."""
    found = []

    def visit(node: ast.AST, name: str, registered: bool) -> None:
        if isinstance(node, ast.FunctionDef):
            marks = {getattr(each.func, "id", "") for each in node.decorator_list if isinstance(each, ast.Call)}
            name, registered = node.name, registered or "reader" in marks
        if isinstance(node, ast.Call) and not registered and _opens(node):
            found.append((name, node.lineno))
        for child in ast.iter_child_nodes(node):
            visit(child, name, registered)

    visit(tree, "", False)
    return found


def _opens(call: ast.Call) -> bool:
    function = call.func
    if isinstance(function, ast.Attribute) and getattr(function.value, "id", "") == "os":
        return False  # handles of folders and devices
    name = function.attr if isinstance(function, ast.Attribute) else getattr(function, "id", "")
    if name == "load":
        return isinstance(function, ast.Attribute) and getattr(function.value, "id", "") in LOADING
    modes = [each.value for each in call.args[1:2] if isinstance(each, ast.Constant)]
    modes += [each.value.value for each in call.keywords if each.arg == "mode" and isinstance(each.value, ast.Constant)]
    return name in OPENING and not any(str(mode).strip("bt") in ("w", "x", "a") for mode in modes)


def test_every_function_that_reads_a_file_is_registered() -> None:
    found = set()
    for module in (wayfield, envs, policies, benchmarks):
        root = Path(module.__path__[0])
        label = "" if module is wayfield else f"{module.__name__.rpartition('.')[2]}/"
        for file in root.rglob("*.py") if label else root.glob("*.py"):
            name = label + file.relative_to(root).as_posix()
            if name == "envs/readers.py" or name.startswith("benchmarks/faults/"):
                continue
            found |= {(name, each) for each, _ in _readings(ast.parse(file.read_text(encoding="utf-8")))}
    assert found - set(ALLOWED) == set(), "give these @reader, so that the fault campaign damages their files"
    assert set(ALLOWED) - found == set(), "these open no file any more"


def test_readers_are_known_where_another_extra_is_missing(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "mcap.writer", None)  # as where it is not installed
    for name in ("mcap_file", "record"):
        monkeypatch.delitem(sys.modules, f"wayfield.benchmarks.{name}", raising=False)
        monkeypatch.delattr(benchmarks, name, raising=False)  # put back too: later tests shall meet one module
    files.load_all()
    assert len(READERS) >= 15


def test_the_sample_of_every_reader_is_read(tmp_path: Path) -> None:
    files.load_all()
    assert len(READERS) >= 15
    for k, reader in enumerate(READERS.values()):
        folder = tmp_path / str(k)
        folder.mkdir()
        file = reader.fill(folder)
        assert file.is_file(), reader.name
        assert reader.read(file) is not None, reader.name


@pytest.mark.parametrize("name", ["a.json", "a.csv", "a.safetensors", "a.npz", "a.csv.gz", "a.map"])
def test_damage_is_the_same_for_the_same_seed_and_nearly_always_damage(name: str) -> None:
    content = b'{"a": [1, 2.5, {"b": "c"}], "d": null}\n1,2,3\n'
    first = [mutations.damaged(content, name, random.Random(k)) for k in range(100)]
    assert first == [mutations.damaged(content, name, random.Random(k)) for k in range(100)]
    assert sum(each != content for each in first) > 80


@pytest.mark.parametrize("group", campaign.GROUPS)
def test_the_same_seed_draws_the_same_trials(group: str) -> None:
    def drawn(seed: int) -> list[object]:
        trials = campaign.GROUPS[group].trials(random.Random(seed))
        return [each for each, _ in zip(trials, range(400), strict=False)]

    assert drawn(3) == drawn(3)
    assert drawn(3) != drawn(4)


def test_what_is_wrong_about_an_end_is_told() -> None:
    assert place.Ended(2, "", "evaluate: no\n").fault((1, 2)) is None
    assert place.Ended(0, "", "").fault((1, 2))
    assert place.Ended(None, "", "").fault((1, 2))
    assert place.Ended(-11, "", "").fault((0, 1, 2))
    assert place.Ended(2, "", "one\ntwo\n").fault((1, 2))
    assert place.Ended(1, "", "Traceback (most recent call last)\nKeyError: 1\n").fault((1, 2))


def test_a_line_that_an_option_would_take_is_not_taken_for_a_wrong_one() -> None:
    rng = random.Random(0)
    for command in commands.COMMANDS:
        for _ in range(40):
            line = commands._wrong(command, rng)
            assert line["allowed"] == [1, 2]
            assert line["arguments"] != list(commands.COMMANDS[command])


def test_every_command_is_tried() -> None:
    started = re.compile(r'^if __name__ == "__main__":$', re.M)
    modules = {
        ".".join(file.relative_to(folder.parent).with_suffix("").parts)
        for folder in map(Path, (envs.__path__[0], policies.__path__[0], benchmarks.__path__[0]))
        for file in folder.rglob("*.py")
        if started.search(file.read_text(encoding="utf-8"))
    }
    inner = {"benchmarks.faults.worker", "envs.coppelia.standstill"}  # children of commands, not for a person to start
    known = {entry.partition(":")[0].removeprefix("wayfield.") for entry in place.ENTRIES.values()}
    assert modules - inner <= known
    for command in place.ENTRIES:
        assert isinstance(place.found(command), click.Command)


def test_code_that_checks_bounds_is_kept_apart_from_code_that_does_not(tmp_path: Path, monkeypatch) -> None:
    started: list[dict[str, str]] = []

    def popen(*_: object, env: dict[str, str], **__: object) -> None:
        started.append(env)
        raise RuntimeError("seen")

    work = place.Place(tmp_path)
    monkeypatch.setattr(server.subprocess, "Popen", popen)
    with pytest.raises(RuntimeError, match="seen"):
        server.Server(work, **steps.BOUNDS).ask("steps", {})
    (checked,) = started
    assert checked["NUMBA_BOUNDSCHECK"] == "1"
    assert checked["NUMBA_CACHE_DIR"] != work.environment()["NUMBA_CACHE_DIR"]


@pytest.mark.slow
def test_a_short_campaign_finds_nothing(tmp_path: Path) -> None:
    work = place.Place(tmp_path)
    told: list[str] = []
    try:
        counts = campaign.run(work, ("steps", "files"), 2.0, 0, told.append)
    finally:
        work.close()
    assert not told
    assert all(count.tried for count in counts.values())
