"""The tools around the page and the pictures, with compilers, browsers and drives that only pretend."""

import contextlib
import dataclasses
import json
import sys
import types
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from click.testing import CliRunner
from PIL import Image

from wayfield.benchmarks import evaluate, pictures, video
from wayfield.benchmarks.cases import Case
from wayfield.benchmarks.contests import CONTESTS, OVERVIEW
from wayfield.benchmarks.documents import documents
from wayfield.benchmarks.report import __main__ as report
from wayfield.benchmarks.report import demo, speed, wasm
from wayfield.benchmarks.results import write_rows
from wayfield.benchmarks.run_folder import MANIFEST, REPORT
from wayfield.benchmarks.suite import Setting
from wayfield.benchmarks.table import Table
from wayfield.envs.robots import ROBOTS
from wayfield.envs.scenarios import TASKS
from wayfield.policies import make
from wayfield.policies.policy import lacks

# ---- WebAssembly


def test_a_c_function_takes_pointers_and_lengths_and_numbers(monkeypatch: pytest.MonkeyPatch) -> None:
    from typing import NamedTuple

    class Pair(NamedTuple):
        first: Any
        second: float

    called: list[Any] = []
    made: list[Any] = []

    def cfunc(signature: Any, error_model: str) -> Any:
        made.append((signature, error_model))
        return lambda function: function

    import numba

    monkeypatch.setattr(numba, "cfunc", cfunc)
    monkeypatch.setattr(numba, "carray", lambda pointer, shape: (pointer, shape))
    grid, line = np.zeros((2, 3)), np.zeros(4, np.int32)
    values = (Pair(grid, 0.5), 7, line, True, 1.5)
    names = [("p.first", grid), ("p.second", 0.5), ("k", 7), ("line", line), ("flag", True), ("x", 1.5)]
    entry, order = wasm.adapter(lambda *words: called.append(words), names, values)  # type: ignore[arg-type]
    assert order == ["p.first", "p.first#0", "p.first#1", "p.second", "k", "line", "line#0", "flag", "x"]
    entry("G", 2, 3, 0.25, 7.0, "L", 4, 1.0, 2.5)
    assert called == [(Pair(("G", (2, 3)), 0.25), 7, ("L", (4,)), True, 2.5)]
    assert isinstance(called[0][1], int)
    ((signature, model),) = made
    assert model == "numpy"
    kinds = numba.types
    floats, integers = kinds.CPointer(kinds.float64), kinds.CPointer(kinds.int32)
    two, one = [floats, kinds.int32, kinds.int32], [integers, kinds.int32]
    assert signature == kinds.void(*two, *[kinds.float64] * 2, *one, *[kinds.float64] * 2)


def test_code_is_for_webassembly_and_seen_by_its_entry(monkeypatch: pytest.MonkeyPatch) -> None:
    text = "\n".join(
        [
            'target triple = "x86"', 'target datalayout = "e-x"', "@a = common global i64 0",
            "define void @native(i8 %x) {", "  call i8 @llvm.x86.atomic.add.cc.i64(ptr %p, i64 1, i32 3)",
            "  call i8 @llvm.x86.atomic.sub.cc.i64(ptr %p, i64 1, i32 3)", "}",
            "declare i8 @llvm.x86.atomic.add.cc.i64(ptr nocapture, i64, i32 immarg) #1",
            "declare i8 @llvm.x86.atomic.sub.cc.i64(ptr nocapture, i64, i32 immarg) #1", "declare void @other() #1",
        ]
    )  # fmt: skip
    function = types.SimpleNamespace(inspect_llvm=lambda: text, native_name="native")
    monkeypatch.setattr(wasm, "adapter", lambda *words: (function, list(words)))
    found, order = wasm.code_of("kernel", ["names"], ("values",), "step")  # type: ignore[list-item]
    assert order == ["kernel", ["names"], ("values",)]
    assert found.splitlines() == [
        f'target triple = "{wasm.TRIPLE}"', f'target datalayout = "{wasm.LAYOUT}"', "@a = internal global i64 0",
        "define void @entry_step(i8 %x) {", "  call i8 @count_add(ptr %p, i64 1, i32 3)",
        "  call i8 @count_sub(ptr %p, i64 1, i32 3)", "}", "declare i8 @count_add(ptr, i64, i32)",
        "declare i8 @count_sub(ptr, i64, i32)", "declare void @other() #1",
    ]  # fmt: skip


def test_a_module_is_linked_of_every_function_once(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    lines: list[list[str]] = []

    def run(line: list[str], check: bool) -> None:
        assert check
        lines.append(line)
        Path(line[line.index("-o") + 1]).write_bytes(b"module")

    monkeypatch.setattr(wasm.subprocess, "run", run)
    monkeypatch.setattr(wasm, "jobs", lambda: [("a", ""), ("a", "law"), ("b", "")])
    monkeypatch.setattr(wasm, "exports", lambda task, policy: {f"{task}{policy}": (1, 2, 3), "both": (4, 5, 6)})
    monkeypatch.setattr(wasm, "code_of", lambda *words: (f"text {words[3]}", [f"order {words[3]}"]))
    monkeypatch.setattr(wasm, "object_of", lambda text, name: f"{text} of {name}".encode())
    module, orders = wasm.built(tmp_path)
    names = ["a", "both", "alaw", "b"]
    assert module == b"module"
    assert orders == {name: [f"order {name}"] for name in names}
    assert all((tmp_path / f"{name}.o").read_bytes() == f"text {name} of {name}".encode() for name in names)
    (line,) = lines
    assert line[:4] == [sys.executable, "-m", "ziglang", "wasm-ld"]
    assert [each for each in line if each.startswith("--export=")] == [
        *(f"--export=entry_{name}" for name in names), "--export=__heap_base",
    ]  # fmt: skip
    assert {"--no-entry", "--allow-undefined", "--strip-all", "--gc-sections", "--export-memory"} <= set(line)
    assert line[line.index("-z") + 1] == "stack-size=1048576"
    assert [each for each in line if each.endswith(".o")] == [str(tmp_path / f"{name}.o") for name in names]
    assert "--initial-memory=16777216" in line


def test_the_module_and_its_tables_are_built_in_a_process_that_compiles_anew(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "ziglang", None)
    done = CliRunner().invoke(wasm.main, ["--out", str(tmp_path)])
    assert done.exit_code == 1
    assert "ziglang is missing" in done.output
    monkeypatch.setitem(sys.modules, "ziglang", types.ModuleType("ziglang"))
    asked: list[Any] = []

    def run(line: list[str], env: dict[str, str]) -> Any:
        asked.append((line, env))
        return types.SimpleNamespace(returncode=7)

    monkeypatch.setattr(wasm, "__spec__", types.SimpleNamespace(name="its.name"))
    monkeypatch.setattr(wasm.subprocess, "run", run)
    monkeypatch.setattr(wasm, "built", lambda folder: (b"module", {"a": ["x"]}))
    monkeypatch.setattr(wasm, "tables", lambda: {"t": 1})
    monkeypatch.setattr(wasm.sys, "argv", ["wasm", "--out", "there"])
    monkeypatch.delenv("WAYFIELD_WASM", raising=False)
    assert CliRunner().invoke(wasm.main, ["--out", str(tmp_path)]).exit_code == 7
    ((line, env),) = asked
    assert line == [sys.executable, "-m", "its.name", "--out", "there"]
    assert env["WAYFIELD_WASM"] == "1"
    assert env["NUMBA_CACHE_DIR"] != wasm.os.environ.get("NUMBA_CACHE_DIR")
    assert not list(tmp_path.iterdir())
    monkeypatch.setenv("WAYFIELD_WASM", "1")
    monkeypatch.setattr(wasm, "kernel_digest", lambda: "digest")
    done = CliRunner().invoke(wasm.main, ["--out", str(tmp_path)])
    assert done.exit_code == 0, done.output
    assert (tmp_path / wasm.MODULE).read_bytes() == b"module"
    text = (tmp_path / wasm.TABLES).read_text(encoding="utf-8")
    assert text == '{"digest":"digest","orders":{"a":["x"]},"t":1}'
    assert f": 6 bytes; {wasm.TABLES}: {len(text)} bytes" in done.output


# ---- how fast the page is


def test_laws_are_timed_by_the_least_of_many_rounds(monkeypatch: pytest.MonkeyPatch) -> None:
    now = {"is": 0.0}
    calls: list[Any] = []
    rounds = [5e-3, 2e-3, 9e-3]

    def kernel(*values: Any) -> None:
        calls.append(values)
        of_law = (len(calls) - 1) % 61  # the first of a law compiles
        now["is"] += rounds[(of_law - 1) // 4 % 3] if of_law else 1.0

    state = np.zeros(1, [("scenario", int)])
    state["scenario"] = 1
    env = types.SimpleNamespace(
        batch=types.SimpleNamespace(states=state), task=types.SimpleNamespace(scenarios=["no", "yes"])
    )
    asked: list[Any] = []
    monkeypatch.setattr(speed, "CALLS", 4)
    monkeypatch.setattr(speed, "ROUNDS", 15)
    monkeypatch.setattr(speed, "environment", lambda *words: asked.append(words) or env)
    monkeypatch.setattr(speed, "first_decision", lambda env, policy, functions: [(kernel, ("v", functions))])
    monkeypatch.setattr(speed, "of_policies", lambda module: module)
    monkeypatch.setattr(speed, "plain", lambda scenario, clock: {"scenario": scenario, "clock": clock})
    monkeypatch.setattr(speed.time, "perf_counter", lambda: now["is"])
    world: dict[str, Any] = {}
    found = speed.native(world)
    assert list(found) == list(speed.LAWS)
    assert list(found.values()) == pytest.approx([2000.0] * 3)
    contest = CONTESTS["goal-obstacles"]
    assert asked == [("goal_reaching", "p3dx", "lagged", f"{contest.timed_on}/test")]
    assert (world["scenario"], world["clock"]) == ("yes", contest.spec.clock)
    assert len(world["draws"]) == speed.DRAWS
    assert [values[1] for values in calls[::61]] == [[tuple(law)] for law in speed.LAWS.values()]
    lines: list[Any] = []
    monkeypatch.setattr(
        speed.subprocess, "run",
        lambda line, **more: lines.append((line, more)) or types.SimpleNamespace(stdout='{"dwa": 3.5}'),
    )  # fmt: skip
    assert speed.in_webassembly({"w": 1}) == {"dwa": 3.5}
    ((line, more),) = lines
    assert line[0] == "node"
    assert line[1].endswith("speed.js")
    told = {"world": {"w": 1}, "robot": "p3dx", "actuators": "lagged", "calls": 4, "rounds": 15}
    assert json.loads(more["input"]) == [told | {"policy": name} for name in speed.LAWS]


def test_frames_are_timed_in_a_browser(monkeypatch: pytest.MonkeyPatch) -> None:
    done: list[Any] = []

    class Tab:
        def goto(self, uri: str) -> None:
            done.append(("goto", uri))
            assert Path(uri.removeprefix("file://")).read_text(encoding="utf-8") == "page"

        def evaluate(self, text: str) -> Any:
            done.append(text)
            return [3, 1.0, 2.5]

    class Browser:
        def new_page(self) -> Tab:
            return Tab()

        def close(self) -> None:
            done.append("close")

    @contextlib.contextmanager
    def sync_playwright() -> Iterator[Any]:
        def launch(executable_path: str, args: list[str]) -> Browser:
            done.append((executable_path, args))
            return Browser()

        yield types.SimpleNamespace(chromium=types.SimpleNamespace(launch=launch))

    module = types.ModuleType("playwright.sync_api")
    module.sync_playwright = sync_playwright  # type: ignore[attr-defined]
    monkeypatch.setitem(sys.modules, "playwright", types.ModuleType("playwright"))
    monkeypatch.setitem(sys.modules, "playwright.sync_api", module)
    pages: list[Any] = []
    monkeypatch.setattr(speed, "rendered", lambda *words: pages.append(words) or "page")
    assert speed.frames({"family": "f", "a": 1}, "/chromium") == [1.0, 2.5, 3.0]
    ((name, content, how, budget, more),) = pages
    assert (name, how, budget, more) == ("frames", [], speed.BUDGET, {"demo": {"first": "goal: f"}})
    assert content.worlds == [{"family": "f", "a": 1, "seed": 0}]
    assert done[0] == ("/chromium", ["--no-sandbox"])
    assert done[2] == "ready"
    assert ["'vfh_plus'" in done[3], "'dwa'" in done[4], "'ppo (trained)'" in done[5]] == [True] * 3
    assert f"k < {speed.FRAMES}" in done[6]
    assert done[7] == "close"


def test_the_page_s_speed_is_a_share_of_machine_code_s(monkeypatch: pytest.MonkeyPatch) -> None:
    there = {"node": "/node", "chromium": None}
    monkeypatch.setattr(speed.shutil, "which", lambda name: there[name])
    monkeypatch.setattr(speed, "native", lambda world: world.update(x=1) or {"dwa": 30.0, "mppi": 50.0})
    monkeypatch.setattr(speed, "in_webassembly", lambda world: {"dwa": 60.0 * world["x"], "mppi": 62.5})
    done = CliRunner().invoke(speed.main, [])
    assert done.exit_code == 0, done.output
    assert done.output.splitlines() == [
        "dwa          machine code     30.0 us, WebAssembly     60.0 us: 50 % of the speed",
        "mppi         machine code     50.0 us, WebAssembly     62.5 us: 80 % of the speed",
        "chromium is missing: apt-get install chromium",
    ]
    there["chromium"] = "/chromium"  # type: ignore[assignment]
    monkeypatch.setattr(speed, "frames", lambda world, chromium: [float(k) for k in range(100)])
    done = CliRunner().invoke(speed.main, [])
    assert done.output.splitlines()[2] == (
        "frame of 3 policies, 72 beams: median 50.00 ms of script, 95 % below 95.00 ms"
    )
    there["node"] = None  # type: ignore[assignment]
    done = CliRunner().invoke(speed.main, [])
    assert (done.exit_code, done.output) == (1, "speed: node is missing: apt-get install nodejs\n")


def test_the_demo_has_the_first_scenarios_of_every_family(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    bank = types.SimpleNamespace(split=lambda *words: [(*words, k) for k in range(9)])
    monkeypatch.setattr(demo, "splits", bank)
    monkeypatch.setattr(demo, "plain", lambda scenario, clock: {"scenario": scenario, "clock": clock})
    found = demo.worlds()
    wanted = [(spec, family) for spec in TASKS.values() for family in spec.families if family not in spec.needs_pymunk]
    assert len(found) == 5 * len(wanted)
    for k, each in enumerate(found):
        spec, family = wanted[k // 5]
        assert (each["clock"], each["seed"], each["hull"]) == (spec.clock, k % 5, demo.LARGEST_HULL)
        assert each["scenario"] == (spec.name, family, "train", k % 5)
        assert len(each["draws"]) == demo.DRAWS
    assert found[0]["draws"] == found[5]["draws"] != found[1]["draws"]
    unable = demo.unable()
    for contest in CONTESTS.values():
        assert set(unable[contest.spec.kind]) < set(contest.policies)
        assert not {"zero", "random", "ppo"} & set(unable[contest.spec.kind])
    pages: list[Any] = []
    monkeypatch.setattr(demo, "worlds", lambda: ["w"])
    monkeypatch.setattr(demo, "made", lambda command, content: [command])
    monkeypatch.setattr(demo, "rendered", lambda *words: pages.append(words) or "page é")
    out = tmp_path / "demo.html"
    done = CliRunner().invoke(demo.main, ["--out", str(out)])
    assert (done.exit_code, done.output) == (0, f"{out}: 7 bytes\n")
    assert out.read_text(encoding="utf-8") == "page é"
    ((title, content, how, budget, more),) = pages
    assert (title, how, budget) == ("wayfield: drive", ["python -m wayfield.benchmarks.report.demo"], demo.BUDGET)
    assert content.worlds == ["w"]
    assert len(content.sentences) == 1
    assert more == {"demo": {"first": "goal: clutter_10", "unable": unable}}
    monkeypatch.setattr(demo, "BUDGET", 7)
    assert CliRunner().invoke(demo.main, ["--out", str(out)]).exit_code == 0
    monkeypatch.setattr(demo, "BUDGET", 6)
    done = CliRunner().invoke(demo.main, ["--out", str(tmp_path / "other")])
    assert (done.exit_code, done.output) == (1, "demo: the page has 7 bytes; at most 6 may be\n")
    assert not (tmp_path / "other").exists()


# ---- a report anew


def test_a_report_is_written_anew_from_a_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    pages: list[Any] = []
    monkeypatch.setattr(report, "write_page", lambda *words: pages.append(words))
    monkeypatch.setattr(report, "section_of", lambda folder, command: (folder, command))
    folder = tmp_path / "run"
    folder.mkdir()
    done = CliRunner().invoke(report.main, [str(folder)])
    assert done.exit_code == 2
    assert "holds no run" in done.output
    write_rows(folder, [{"policy": "lqr"}])
    done = CliRunner().invoke(report.main, [str(folder)])
    assert (done.exit_code, done.output) == (0, f"Report: {folder / REPORT}\n")
    assert pages == [(folder / REPORT, "wayfield: run", [(folder, "not known")], "not known", report.BUDGET)]
    (folder / MANIFEST).write_text('{"command": "c"}', encoding="utf-8")
    CliRunner().invoke(report.main, [str(folder), "--out", str(tmp_path / "x.html")])
    assert pages[1] == (tmp_path / "x.html", "wayfield: run", [(folder, "c")], "c", report.BUDGET)
    over = tmp_path / "over"
    for name in ("contests", "documents"):
        (over / name).mkdir(parents=True)
        write_rows(over / name, [{"policy": "lqr"}])
    (over / "contests" / MANIFEST).write_text('{"command": "d"}', encoding="utf-8")
    CliRunner().invoke(report.main, [str(over)])
    sections = [(over / "contests", "d"), (over / "documents", "d")]
    assert pages[2] == (over / REPORT, f"wayfield: {OVERVIEW}", sections, "d", report.SMALL_BUDGET)
    for error, said in ((ValueError("bad"), "bad"), (OSError(28, "full", "here"), "here: full")):
        monkeypatch.setattr(report, "write_page", lambda *_, error=error: (_ for _ in ()).throw(error))
        done = CliRunner().invoke(report.main, [str(folder)])
        assert done.exit_code == 2
        assert said in done.output


def test_what_a_report_shows_is_what_its_episodes_are_of(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    asked: list[Any] = []
    monkeypatch.setattr(report, "contest_tables", lambda *words: asked.append(words) or {"t": "T"})
    monkeypatch.setattr(report, "document_tables", lambda rows, cases: [f"D{len(cases)}"])
    monkeypatch.setattr(report, "reproduced", lambda rows, cases: "reproduced")
    monkeypatch.setattr(report, "ranked", lambda rows: "ranked")
    monkeypatch.setattr(report, "read_decisions", lambda folder: "decisions")
    cases = [
        ({"contest": "path-following", "suite": "path-following"}, False, []),
        ({"contest": "path-following", "suite": "disturbances"}, True, "decisions"),
    ]
    for k, (row, ladder, decisions) in enumerate(cases):
        folder = tmp_path / str(k)
        folder.mkdir()
        write_rows(folder, [row])
        if decisions:
            (folder / report.DECISIONS).touch()
        section = report.section_of(folder, "c")
        assert (section.folder, section.tables) == (folder, ["T"])
        assert asked[k][1:] == (decisions, "c", ladder)
    for document, small in (("A", "reproduced"), ("C", "reproduced"), ("path", "ranked")):
        folder = tmp_path / document
        folder.mkdir()
        write_rows(folder, [{"document": document}])
        section = report.section_of(folder, "c")
        assert section.tables == [f"D{len(documents())}"]
        assert small in dataclasses.asdict(section).values()
    folder = tmp_path / "none"
    folder.mkdir()
    write_rows(folder, [{"suite": "coverage"}])
    with pytest.raises(ValueError, match="is of suite 'coverage'"):
        report.section_of(folder, "c")
    write_rows(folder, [])
    with pytest.raises(ValueError, match=r"holds no episodes|empty"):
        report.section_of(folder, "c")


# ---- pictures and films


def test_pictures_of_few_colours_carry_their_digest() -> None:
    import io

    image = Image.fromarray(np.random.default_rng(0).integers(0, 255, (40, 40, 4), np.uint8))
    for told in ("", "digest"):
        found = Image.open(io.BytesIO(pictures._png(image, told)))
        assert found.mode == "P"
        assert len(found.getcolors(256)) <= 160  # type: ignore[arg-type]
        assert found.info.get(pictures.DIGEST) == (told or None)
    assert len(found.getcolors(256)) > 100  # type: ignore[arg-type]


def test_a_drive_is_pictured_and_filmed_every_fifth_step(monkeypatch: pytest.MonkeyPatch, capsys: Any) -> None:
    env_id = next(iter(pictures.FILMS))
    shown = pictures.FILMS[env_id]
    done: list[Any] = []

    @dataclasses.dataclass(frozen=True)
    class Scene:
        number: int
        ranges: Any = "rays"

    class Place:
        def __init__(self, *words: Any) -> None:
            done.append(words)

        def make(self, policy: str) -> Any:
            return types.SimpleNamespace(close=lambda: done.append("close"))

        def policy(self, name: str, env: Any) -> str:
            return f"policy {name}"

    class Drive:
        def __init__(self, env: Any, policy: str) -> None:
            done.append(policy)

        def begin(self, *words: Any) -> None:
            done.append(words)

    scenes = [Scene(k) for k in range(13)]
    film = types.SimpleNamespace(told="goal", scenes=scenes, dt=0.05)
    drawn: list[Scene] = []

    def draw(scene: Scene) -> Any:
        drawn.append(scene)
        return None if scene.number == 5 else np.full((2, 2, 3), scene.number, np.uint8)

    monkeypatch.setattr(pictures, "Place", Place)
    monkeypatch.setattr(pictures, "Drive", Drive)
    monkeypatch.setattr(pictures, "filmed", lambda drive, *words: done.append(words) or film)
    sizes: list[Any] = []
    monkeypatch.setattr(pictures, "Renderer", lambda *words: sizes.append(words) or types.SimpleNamespace(draw=draw))
    monkeypatch.setattr(pictures, "picture", lambda film, size: sizes.append(size) or np.zeros((3, 3, 3), np.uint8))
    films: list[Any] = []
    monkeypatch.setattr(pictures, "gif", lambda frames, seconds: films.append((frames, seconds)) or b"gif")
    png, gif = pictures.driven(env_id)
    assert (png[:4], gif) == (b"\x89PNG", b"gif")
    robot = ROBOTS[shown.robot] if isinstance(shown.robot, str) else shown.robot
    place = (env_id, shown.scenario, shown.index, robot, "lagged", None, None, (), 0, "tuned")
    assert done == [place, f"policy {shown.policy}", (0, shown.index), (None, shown.seconds), "close"]
    assert [each.number for each in drawn] == [0, 5, 10, 12, 12, 12, 12]
    assert all(each.ranges is None for each in drawn)
    ((frames, seconds),) = films
    assert len(frames) == 6
    assert seconds == 5 * 0.05 / 2.5
    assert sizes == [("rgb_array", pictures.FPS, 280), 560]
    assert capsys.readouterr().out == f"{env_id}: {shown.policy} in {shown.scenario} {shown.index}: goal\n"


def test_pictures_keep_to_their_budget(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(pictures, "sheet_png", lambda spec: spec.name.encode())
    monkeypatch.setattr(pictures, "driven", lambda env_id: (b"png", b"gif"))
    names = {f"{spec.name}_families.png" for spec in TASKS.values()}
    for env_id in pictures.FILMS:
        stem = env_id.removeprefix("wayfield/").rpartition("-v")[0]
        names |= {f"{stem}.png", f"{stem}.gif"}
    assert set(pictures.files()) == names
    total = sum(map(len, pictures.files().values()))
    for budget, fits in ((total, True), (total - 1, False)):
        monkeypatch.setattr(pictures, "BUDGET", budget)
        out = tmp_path / str(budget) / "deep"
        done = CliRunner().invoke(pictures.main, ["--out", str(out)])
        assert done.exit_code == (0 if fits else 1)
        assert out.exists() is fits
    out = tmp_path / str(total) / "deep"
    assert {file.name for file in out.iterdir()} == names
    assert (out / next(iter(sorted(names)))).read_bytes() in (b"png", b"gif", *(n.encode() for n in TASKS))


def test_the_first_of_cases_is_filmed_or_those_that_are_meant(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    filmed: list[Any] = []
    monkeypatch.setattr(video, "_film", lambda *words: filmed.append(words))
    cases = [Case("d", f"e{k}", "id", "s", "p", filmed=k in (1, 3)) for k in range(4)]
    video.film(tmp_path, iter(cases), "kinematic", "ideal", 3)
    assert filmed == [(tmp_path, cases[k], "kinematic", "ideal", 3) for k in (1, 3)]
    filmed.clear()
    video.film(tmp_path, cases[::2], "kinematic", "ideal", 3)
    assert filmed == [(tmp_path, cases[0], "kinematic", "ideal", 3)]


def test_a_case_is_filmed_to_its_end(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    made: list[Any] = []
    steps: list[Any] = []
    ends = {"terminated": 3, "truncated": 99}

    class Recorded:
        def __init__(self, env: Any, folder: str, name_prefix: str, disable_logger: bool) -> None:
            made.append((env, folder, name_prefix, disable_logger))
            self.unwrapped = types.SimpleNamespace()

        def reset(self, seed: int) -> Any:
            steps.append(("reset", seed))
            return "seen", {}

        def step(self, action: Any) -> Any:
            steps.append(action)
            return "seen", 0.0, len(steps) > ends["terminated"], len(steps) > ends["truncated"], {}

        def close(self) -> None:
            steps.append("close")

    class Pilot:
        def __init__(self, policy: Any, env: Any) -> None:
            self.policy = policy

        def reset(self) -> None:
            steps.append("pilot")

        def act(self, observation: Any) -> str:
            return f"act on {observation}"

    monkeypatch.setattr(video.gymnasium, "make", lambda *words, **more: made.append((words, more)) or "env")
    monkeypatch.setattr(video.gymnasium.wrappers, "RecordVideo", Recorded)
    monkeypatch.setattr(video, "Pilot", Pilot)
    monkeypatch.setattr(video, "make_policy", lambda case, seed: (case.policy, seed))
    case = Case("Doc A", "an experiment", "id", "circle", "lqr", {"k": 1.5}, {"noise": 1.0}, max_episode_steps=10**9)
    video._film(tmp_path, case, "pymunk", "lagged", 4)
    (words, more), (env, folder, name, quiet) = made
    assert words == ("id",)
    assert more == {"max_episode_steps": video.LONGEST, "render_mode": "rgb_array", "scenario": "circle",
                    "dynamics": "pymunk", "actuators": "lagged", "noise": 1.0}  # fmt: skip
    assert (env, folder, name, quiet) == ("env", str(tmp_path), "Doc-A-an-experiment-lqr-k-1.5", True)
    assert steps == [("reset", 4), "pilot", "act on seen", "act on seen", "close"]
    steps.clear()
    ends.update(terminated=99, truncated=2)
    video._film(tmp_path, dataclasses.replace(case, max_episode_steps=7), "pymunk", "lagged", 4)
    assert steps[2:] == ["act on seen", "close"]
    assert made[2][1]["max_episode_steps"] == 7


# ---- the overview


def test_the_overview_is_the_documents_and_a_scenario_a_family(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    asked: dict[str, Any] = {"begun": []}
    cell = Table("t", ["a"], [["1"]], "")

    class Ahead:
        def __init__(self, processes: Any) -> None:
            self.processes = processes

        def begin(self, function: Any, items: list[Any]) -> None:
            asked["begun"].append((function, items))

    @contextlib.contextmanager
    def contest_section(*words: Any) -> Iterator[Any]:
        asked["contest"] = words
        yield types.SimpleNamespace(tables=[cell])

    @contextlib.contextmanager
    def cases_section(self: Any, *words: Any) -> Iterator[Any]:
        asked["cases"] = words
        yield types.SimpleNamespace(tables=[cell, cell])

    @contextlib.contextmanager
    def shared_out(count: int) -> Iterator[str]:
        asked["count"] = count
        yield "processes"

    def write_page(file: Path, title: str, sections: Any, command: str, budget: Any) -> list[Any]:
        asked["page"] = (file.name, title, len(sections), budget)
        return [("who wins", cell)]

    parts = [types.SimpleNamespace(setting=f"part {k}", folder=tmp_path / f"part {k}") for k in range(3)]
    parts[1].folder.mkdir()
    monkeypatch.setattr(evaluate, "Ahead", Ahead)
    monkeypatch.setattr(evaluate, "ahead", Ahead)
    monkeypatch.setattr(evaluate, "contest_section", contest_section)
    monkeypatch.setattr(evaluate.Asked, "_cases_section", cases_section)
    monkeypatch.setattr(evaluate, "shared_out", shared_out)
    monkeypatch.setattr(evaluate, "write_page", write_page)
    monkeypatch.setattr(evaluate, "settings_of", lambda options: asked.update(options=options) or ["settings"])
    monkeypatch.setattr(evaluate, "parts_of", lambda settings, inner: asked.update(inner=inner) or parts)
    monkeypatch.setattr(evaluate, "heads_first", lambda settings: list(reversed(range(len(settings)))))
    out = tmp_path / "out"
    done = CliRunner().invoke(evaluate.main, ["--out", str(out), "--seed", "7", "--workers", "3"])
    assert done.exit_code == 0, done.output
    options, settings, inner, engine, count = asked["contest"]
    assert options is asked["options"]
    assert (settings, inner, asked["inner"], count, asked["count"]) == (
        ["settings"], out / "contests", out / "contests", 3, 3,
    )  # fmt: skip
    assert isinstance(engine, Ahead)
    assert engine.processes == "processes"
    robot = ROBOTS["p3dx"]
    names = [name for contest in CONTESTS.values() for name in contest.overview if not lacks(make(name), robot)]
    told = list(vars(options).values())
    assert told[:7] == [
        OVERVIEW, tuple(CONTESTS), tuple(dict.fromkeys(names)), ("kinematic",), "lagged", robot, evaluate.GAINS["best"],
    ]  # fmt: skip
    assert options.seed == 7
    name, cases, folder, same = asked["cases"]
    assert (name, folder) == ("documents", out / "documents")
    assert [case.key for case in cases] == [case.key for case in documents()]
    assert same is engine
    assert asked["page"] == (REPORT, "wayfield: overview", 2, evaluate.SMALL_BUDGET)
    # all work at once, in the order that compiles first; parts that are there are left out
    begun = asked["begun"]
    assert [(function, item) for function, (item,) in begun[:2]] == [
        (evaluate.play, "part 2"), (evaluate.play, "part 0"),
    ]  # fmt: skip
    rest = [item for function, (item,) in begun[2:] if function is evaluate.episodes]
    assert len(rest) == len(begun) - 2 == len(documents())
    assert all(isinstance(each, Setting) and each.dynamics == "kinematic" and each.seed == 7 for each in rest)
    assert [each.case.key for each in reversed(rest)] == [case.key for case in documents()]
    assert done.output.splitlines()[-1] == f"Report: {out / REPORT}"
    begun.clear()
    evaluate._begin("another engine", rest, parts)  # type: ignore[arg-type]
    assert not begun
