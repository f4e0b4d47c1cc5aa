"""Options of `wayfield evaluate`, and what else the commands hand on, with runs that only pretend."""

import contextlib
import dataclasses
import json
import signal
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import click
import pytest
from click.testing import CliRunner

from wayfield.benchmarks import evaluate, fingerprints
from wayfield.benchmarks.cases import PATH_FOLLOWING, Case
from wayfield.benchmarks.contest_options import ContestOptions
from wayfield.benchmarks.contests import CONTESTS
from wayfield.benchmarks.documents import documents
from wayfield.benchmarks.evaluate import Asked
from wayfield.benchmarks.public_suites import PUBLIC
from wayfield.benchmarks.run_folder import REPORT
from wayfield.benchmarks.table import Table
from wayfield.envs.engines import HERE
from wayfield.envs.robots import ROBOTS

DEFAULTS: dict[str, Any] = dict.fromkeys(
    ("suite", "policies", "dynamics", "actuators", "robot", "gains", "families", "split", "path", "scenarios", "scale",
     "data", "mode", "episodes", "out", "keep", "count")
) | {"homes": (), "own": (), "seed": 0, "full": False, "video": False}  # fmt: skip
CELL = Table("t", ["a"], [["1"]], "")


def asked(**changes: Any) -> Asked:
    return Asked(**DEFAULTS | changes)


def refused(**changes: Any) -> str:
    with pytest.raises(click.ClickException) as error:
        asked(**changes).check()
    return error.value.message


def test_what_is_asked_for_chooses_the_suite() -> None:
    assert asked().wanted == "overview"
    assert asked(out="x", seed=3, count=2, full=True).wanted == "overview"  # which every suite takes
    narrowing = {
        "policies": ("lqr",), "dynamics": "both", "actuators": "lagged", "robot": ROBOTS["omni3"], "gains": "tuned",
        "homes": ("x",), "own": ("a:B",), "families": ("splines",), "path": "x.csv", "scenarios": "x", "data": "x",
        "mode": "p3dx", "split": "claims", "episodes": 2, "video": True, "keep": "all",
    }  # fmt: skip
    for name, value in narrowing.items():
        assert asked(**{name: value}).narrowed, name
        assert asked(**{name: value}).wanted == "documents"
        assert asked(**{name: value}, suite="docking").wanted == "docking"
    assert not asked(policies=("all",)).narrowed
    assert asked(policies=("lqr", "all")).names is None
    assert asked(policies=("lqr",)).names == ("lqr",)
    assert asked().names is None
    assert asked(count=3).processes == 3
    assert asked().processes == evaluate.cores()


def test_what_differs_from_the_defaults_names_the_folder(tmp_path: Path) -> None:
    nothing = asked().differing
    assert {name: value for name, value in nothing.items() if value} == {}
    assert asked(robot=ROBOTS["p3dx"]).differing == nothing
    # a sheet of one's own under the same name is another robot
    heavier = dataclasses.replace(ROBOTS["p3dx"], mass=2.0 * ROBOTS["p3dx"].mass)
    assert asked(robot=heavier).differing == nothing | {"robot": "p3dx"}
    whole = asked(
        robot=ROBOTS["omni3"], homes=(str(tmp_path / "runs"),), own=("a:B",), policies=("lqr",), families=("splines",),
        split="claims", scale=0.5, episodes=3, seed=4, keep="all",
    ).differing  # fmt: skip
    assert whole == {
        "robot": "omni3", "agents": ("runs",), "own": ("a:B",), "policies": ("lqr",), "families": ("splines",),
        "split": "claims", "scale": 0.5, "episodes": 3, "seed": 4, "trajectories": "all_trajectories",
    }  # fmt: skip
    assert asked(keep="worst").differing["trajectories"] is None
    assert asked(out="there").folder("x", {}) == Path("there")
    assert evaluate._conditions(None, "both", None, "ideal") == {"plant": None, "tier": None}
    assert evaluate._conditions("both", "both", "lagged", "ideal") == {"plant": None, "tier": "lagged"}
    assert evaluate._conditions("pymunk", "both", "ideal", "ideal") == {"plant": "pymunk", "tier": None}


@pytest.mark.parametrize("filmed", [False, True])
def test_a_film_is_of_the_run_s_own_episodes(filmed: bool, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Of its cases, on its plant and tier, with its seed."""
    films: list[Any] = []
    ran: list[Any] = []
    monkeypatch.setattr("wayfield.benchmarks.video.film", lambda *words: films.append(words))
    for name in ("write_rows", "write_trajectories", "write_drives", "write_worlds"):
        monkeypatch.setattr(evaluate, name, lambda *_: None)
    monkeypatch.setattr(evaluate, "run", lambda settings, in_parallel: ran.extend(settings) or ([], {}))
    monkeypatch.setattr(evaluate, "read_rows", lambda _: [])
    monkeypatch.setattr(evaluate, "write_case_tables", lambda *_: ["table"])
    monkeypatch.setattr(evaluate, "ranked", lambda _: "told")
    monkeypatch.setattr("wayfield.benchmarks.document_figures.wanted_figures", lambda *_: [])
    cases = [Case("path", "mine", PATH_FOLLOWING, "circle", policy, episodes=2) for policy in ("lqr", "stanley")]
    monkeypatch.setattr(Asked, "command", "wayfield evaluate")
    given = asked(path="x", video=filmed, seed=4, dynamics="pymunk", actuators="slow", count=1)
    with given._cases_section("mine", cases, tmp_path / "out", HERE) as section:
        stage = section.folder
    assert (section.tables, section.small) == (["table"], "told")
    assert films == ([(stage / "video", cases, "pymunk", "slow", 4)] if filmed else [])
    assert [(each.case, each.dynamics, each.actuators, each.seed, each.episodes) for each in ran] == [
        (case, "pymunk", "slow", 4, 2) for case in cases
    ]


def test_options_that_are_empty_or_belong_elsewhere_are_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    contest = "path-following"
    for name, option in (("out", "--out"), ("path", "--path"), ("scenarios", "--scenarios"), ("data", "--data")):
        assert refused(**{name: " "}).startswith(f"{option} is empty; it must name a ")
    assert refused(suite=contest, path="x") == "--path takes the place of --suite: give one of them"
    assert refused(path="x", scenarios="y") == "--scenarios takes the place of --path: give one of them"
    scale = "--scale belongs to --path FILE, --scenarios FOLDER or --suite racetracks"
    assert refused(scale=0.5) == refused(suite=contest, scale=0.5) == scale
    for fine in ({"path": "x", "scale": 0.5}, {"scenarios": "x", "scale": 0.5}, {"suite": contest}, {},
                 {"suite": "racetracks", "data": "x", "scale": 0.5}, {"suite": "documents", "video": True},
                 {"suite": "documents", "dynamics": "both"}, {"path": "x", "robot": ROBOTS["omni3"]},
                 {"scenarios": "x", "gains": "tuned", "homes": ("y",)}, {"suite": contest, "families": ("splines",)},
                 {"suite": "overview", "out": "x", "seed": 3, "count": 2}):  # fmt: skip
        asked(**fine).check()
    assert "takes no options but" in refused(suite="overview", episodes=2)
    for name, value in (("robot", ROBOTS["p3dx"]), ("gains", "tuned"), ("homes", ("x",)), ("own", ("x",)),
                        ("families", ("splines",)), ("split", "test"), ("keep", "all")):  # fmt: skip
        option = {"homes": "agents", "own": "policy", "keep": "keep-trajectories"}.get(name, name)
        assert refused(suite="documents", **{name: value}).startswith(f"--{option} belongs to the contests: --suite ")
        if name != "robot":
            assert refused(path="x", **{name: value}).startswith(f"--{option} belongs to the contests")
    assert refused(suite=contest, video=True) == "--video belongs to --suite documents"
    assert "a contest is run on one plant" in refused(suite=contest, dynamics="both")
    assert "of --scenarios each file is a family" in refused(scenarios="x", families=("splines",))
    assert "--scenarios brings its own" in refused(scenarios="x", split="test")
    for name, option in (("data", "--data"), ("mode", "--mode")):
        assert refused(suite=contest, **{name: "x"}).startswith(f"{option} belongs to public benchmarks: --suite ")
    for name, suite in PUBLIC.items():
        assert refused(suite=name) == f"--suite {name} needs --data FOLDER, the folder of its official files"
        assert refused(suite=name, data="x", mode="zz") == f"--mode 'zz' is none of suite {name!r}"
        assert "--episodes takes the first of each course" in refused(suite=name, data="x", families=("splines",))
        for key, mode in suite.modes.items():
            asked(suite=name, data="x", mode=key, robot=ROBOTS[mode.robot]).check()
            other = ROBOTS["omni3"]
            if mode.fixed:
                said = refused(suite=name, data="x", mode=key, robot=other)
                assert said == f"--robot of this mode of {name} is {mode.robot}: see --mode"
            else:
                asked(suite=name, data="x", mode=key, robot=other).check()
    missing: list[str] = []
    monkeypatch.setattr(evaluate.importlib.util, "find_spec", lambda name: None if name in missing else "there")
    for name, extra in (("pygame", "render"), ("moviepy", "render"), ("matplotlib", "evaluate")):
        missing[:] = [name]
        assert refused(suite="documents", video=True) == f'{name} is missing: pip install "wayfield[{extra}]"'
    missing[:] = ["pygame"]
    asked(suite="documents").check()


@pytest.fixture
def told(monkeypatch: pytest.MonkeyPatch) -> list[Any]:
    found: list[Any] = []
    monkeypatch.setattr(Asked, "_tell", lambda self, *words: found.append(words))
    return found


def test_a_contest_is_run_as_it_was_asked_for(told: list[Any], monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    seen: list[Any] = []

    @contextlib.contextmanager
    def shared_out(count: int) -> Iterator[str]:
        yield f"{count} processes"

    monkeypatch.setattr(evaluate, "command_given", lambda program: f"{program} as given")
    monkeypatch.setattr(evaluate, "shared_out", shared_out)
    monkeypatch.setattr(evaluate, "contest_report", lambda *words: seen.append(words) or (["T"], "told"))
    monkeypatch.setattr(evaluate, "own_policy", lambda text: f"own {text}")
    monkeypatch.setattr(evaluate, "told_of_models", lambda own: [f"careful with {each}" for each in own])
    monkeypatch.setattr(evaluate, "default_folder", lambda name, differing: (name, differing))
    asked(count=2).run_contest("suite", ("one",))
    ((options, folder, engine, count),) = seen
    assert (engine, count) == ("2 processes", 2)
    assert options == ContestOptions(
        "suite", ("one",), None, ("kinematic",), "lagged", ROBOTS["p3dx"], evaluate.GAINS["all"], None, None, 0, (), (),
        (), "python evaluate.py as given", 3, "test",
    )  # fmt: skip
    assert folder[0] == "suite"
    assert {name: value for name, value in folder[1].items() if value} == {}
    assert told == [(["T"], "told", folder)]
    whole = asked(
        policies=("lqr",), dynamics="pymunk", actuators="slow", robot=ROBOTS["omni3"], gains="tuned",
        families=("splines",), episodes=2, seed=5, homes=("h",), own=("a:B",), keep="all", split="claims", out="there",
        count=1, scenarios=str(tmp_path / "mine"),
    )  # fmt: skip
    whole.run_contest("suite", ("one", "two"), ("course",))  # type: ignore[arg-type]
    options, folder, *_ = seen[1]
    assert options == ContestOptions(
        "suite", ("one", "two"), ("lqr",), ("pymunk",), "slow", ROBOTS["omni3"], evaluate.GAINS["tuned"], ("splines",),
        2, 5, ("h",), ("own a:B",), ("course",), options.command, None, "claims",  # type: ignore[arg-type]
    )  # fmt: skip
    assert folder == Path("there")
    asked(dynamics="pymunk", actuators="slow", gains="tuned", scenarios=str(tmp_path / "mine")).run_contest("s", ("o",))
    named = {name: value for name, value in seen[2][1][1].items() if value}
    assert named == {"scenarios": "mine", "plant": "pymunk", "tier": "slow", "gains": "tuned"}
    asked(dynamics="kinematic", actuators="lagged", gains="all").run_contest("s", ("o",))
    assert not any(seen[3][1][1].values())


def test_a_public_benchmark_has_its_robot_and_its_files(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    seen: list[Any] = []
    monkeypatch.setattr(Asked, "run_contest", lambda self, *words: seen.append((self, *words)))
    courses: list[Any] = []
    monkeypatch.setattr(evaluate, "racetrack_courses", lambda *words: courses.append(words) or "scaled")
    for name, suite in PUBLIC.items():
        for mode in (None, *suite.modes):
            monkeypatch.setitem(PUBLIC, name, dataclass_with(suite, lambda *words: courses.append(words) or "courses"))
            for policies in (None, ("lqr",), ("all",)):
                asked(suite=name, data=str(tmp_path), mode=mode, policies=policies).run_public()
                mine, label, contests, found = seen[-1]
                key = mode or next(iter(suite.modes))
                contest = suite.contest(key)
                assert (label, contests, found) == (contest.name, (contest.name,), "courses")
                assert mine.robot == ROBOTS[suite.modes[key].robot]
                assert mine.policies == (contest.policies if policies == ("all",) else policies)
                assert courses[-1] == (str(tmp_path), mine.robot)
            asked(suite=name, data=str(tmp_path), robot=ROBOTS["omni4"]).run_public()
            assert seen[-1][0].robot == ROBOTS["omni4"]
    asked(suite="racetracks", data=str(tmp_path), scale=0.5).run_public()
    assert seen[-1][3] == "scaled"
    assert courses[-1][0] == str(tmp_path)
    assert courses[-1][2] == 0.5
    with pytest.raises(click.UsageError, match="is no folder; it must be the one of the official files"):
        asked(suite="barn", data=str(tmp_path / "none")).run_public()


def dataclass_with(suite: Any, courses: Any) -> Any:
    import dataclasses

    return dataclasses.replace(suite, courses=courses)


def test_a_file_or_a_folder_of_one_s_own_is_run(told: list[Any], monkeypatch: pytest.MonkeyPatch) -> None:
    cases = [Case("path", "x", "id", "x", "lqr")]
    seen: list[Any] = []
    monkeypatch.setattr(evaluate, "own_cases", lambda *words: seen.append(words) or cases)
    monkeypatch.setattr(evaluate, "without_way", lambda *words: "no way")
    monkeypatch.setattr(evaluate, "default_folder", lambda name, differing: (name, differing))
    runs: list[Any] = []
    monkeypatch.setattr(Asked, "_run_cases", lambda self, *words: runs.append(words) or (["T"], [("wins", CELL)]))
    asked(path="deep/way.csv", policies=("lqr",)).run_path()
    assert seen == [("deep/way.csv", None, ("lqr",), "p3dx")]
    name, same, folder = runs[0]
    assert (name, same, folder[0]) == ("path", cases, "path")
    assert {key: value for key, value in folder[1].items() if value} == {"file": "way", "policies": ("lqr",)}
    assert told[-1] == (["T"], [("no way. wins", CELL)], folder)
    asked(path="way.csv", scale=0.5, robot=ROBOTS["omni3"], dynamics="pymunk", actuators="lagged").run_path()
    assert seen[1] == ("way.csv", 0.5, None, ROBOTS["omni3"])
    assert told[-1][1] == [("wins", CELL)]  # of a path that is scaled nothing is looked for
    named = {key: value for key, value in runs[1][2][1].items() if value}
    assert named == {"file": "way", "robot": "omni3", "scale": 0.5, "plant": "pymunk", "tier": "lagged"}
    contests: list[Any] = []
    contest = CONTESTS["docking"]
    monkeypatch.setattr(evaluate, "own_courses", lambda *words: contests.append(words) or (contest, ("c",)))
    monkeypatch.setattr(Asked, "run_contest", lambda self, *words: contests.append(words))
    asked(scenarios="folder").run_scenarios()
    asked(scenarios="folder", scale=2.0, robot=ROBOTS["omni3"]).run_scenarios()
    assert contests == [
        ("folder", None, "p3dx"), ("docking", ("docking",), ("c",)), ("folder", 2.0, ROBOTS["omni3"]),
        ("docking", ("docking",), ("c",)),
    ]  # fmt: skip
    asked(suite="documents", policies=("lookahead_documented",)).run_documents()
    name, cases, folder = runs[-1]
    assert name == folder[0] == "documents"
    assert {case.policy for case in cases} == {"lookahead_documented"}
    assert len(evaluate._cases_of_documents(None)) == len(documents())
    with pytest.raises(click.UsageError, match="'mpc' has no case in suite 'documents'"):
        evaluate._cases_of_documents(("lookahead_documented", "mpc"))


def test_settings_are_every_case_on_every_plant() -> None:
    cases = [Case("a", "x", "id", "x", "lqr", episodes=4), Case("a", "y", "id", "y", "mpc")]
    for changes, plants, tier, counts in (
        ({"suite": "documents"}, ("kinematic", "pymunk"), "ideal", (4, 1)), ({}, ("kinematic",), "ideal", (4, 1)),
        ({"dynamics": "pymunk", "actuators": "slow", "episodes": 2, "seed": 9}, ("pymunk",), "slow", (2, 2)),
    ):  # fmt: skip
        found = asked(**changes)._settings_of("n", cases)
        assert [(each.case, each.dynamics) for each in found] == [(case, plant) for case in cases for plant in plants]
        assert {(each.suite, each.actuators, each.seed) for each in found} == {("n", tier, changes.get("seed", 0))}
        assert [each.episodes for each in found] == [count for count in counts for _ in plants]


def test_the_report_is_named_last_and_tables_are_printed_if_asked_for(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    short: list[Any] = []
    monkeypatch.setattr(evaluate, "print_short", short.append)
    asked()._tell([CELL], "told", tmp_path)  # type: ignore[arg-type]
    lines = capsys.readouterr().out.splitlines()
    assert short == ["told"]
    assert lines == [
        f"All tables, figures and episodes are in {tmp_path}/; --full prints the tables.",
        f"Report: {tmp_path / REPORT}",
    ]
    asked(full=True)._tell([Table("Title", ["a", "b"], [["1", "2"]], "Note.")], "told", tmp_path)  # type: ignore[arg-type]
    lines = capsys.readouterr().out.splitlines()
    assert len(short) == 1
    assert lines[0].startswith("Title")
    assert "Note." in lines
    assert lines[-1] == f"Report: {tmp_path / REPORT}"
    assert all(line == line.rstrip() for line in lines)


def test_a_narrow_terminal_has_the_columns_that_it_has_room_for(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    import rich.console

    headers = [f"header{k}" for k in range(8)]
    table = Table("T", headers, [["c" * 14] * 8], "Note.")
    console = rich.console.Console
    monkeypatch.setattr(evaluate.sys.stdout, "isatty", lambda: True, raising=False)
    shown = {}
    for width in (200, 100, 60, 20):
        monkeypatch.setattr(
            evaluate.rich.console,
            "Console",
            lambda width=None, asked=width: console(width=width or asked, force_terminal=False),
        )
        evaluate._print([table])
        text = capsys.readouterr().out
        body, _, note = text.partition("Note.")
        note = " ".join(note.split())
        left = [name for name in headers if name in note]
        shown[width] = headers[: len(headers) - len(left)]
        assert headers == [*shown[width], *left]
        assert not any(name in body for name in left)
        assert width < 60 or all(name in body for name in shown[width])
        assert ("Left out for want of width" in note) is bool(left)
        assert max(map(len, body.splitlines())) <= max(width, 4 * 16)
    assert len(shown[200]) == 8
    assert 4 <= len(shown[60]) < len(shown[100]) <= 8
    assert len(shown[20]) == 4
    # a note is as wide as a page and no wider
    monkeypatch.setattr(evaluate.rich.console, "Console", lambda width=None: console(width=width or 300))
    evaluate._print([Table("T", headers, [["c"] * 8], "a " * 200)])
    assert next(len(line) for line in capsys.readouterr().out.splitlines() if line.startswith("a ")) in (119, 120)


def test_what_is_wrong_with_an_option_s_value_is_one_line() -> None:
    def said(error: Exception, option: str = "--path", value: str = "x") -> str:
        with pytest.raises(click.UsageError) as found, evaluate._one_line(option, value):
            raise error
        return found.value.message

    assert said(OSError(2, "No such file")) == "--path 'x' cannot be read: No such file"
    assert said(OSError(2, "No such file", "x")) == "--path 'x' cannot be read: No such file"
    assert said(OSError(2, "No such file", "y")) == "--path 'x' cannot be read: No such file (y)"
    assert said(OSError("odd")) == "--path 'x' cannot be read: odd"
    assert said(ValueError("it is no")) == "--path it is no"
    assert said(ValueError("--scale is no")) == "--scale is no"
    with pytest.raises(KeyError), evaluate._one_line("--path", "x"):
        raise KeyError("x")


def test_a_run_that_is_asked_to_end_ends_in_order() -> None:
    before = signal.getsignal(signal.SIGTERM)
    with evaluate._ended_by_signals():
        handler: Any = signal.getsignal(signal.SIGTERM)
        with pytest.raises(SystemExit) as ended:
            handler(15, None)
        assert ended.value.code == 143
    assert signal.getsignal(signal.SIGTERM) is before
    with pytest.raises(ValueError, match="x"), evaluate._ended_by_signals():
        raise ValueError("x")
    assert signal.getsignal(signal.SIGTERM) is before


def test_fingerprints_are_written_or_compared(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    now = {"path p3dx kinematic plain lqr default": {"a": {"x": 1}}, "path p3dx kinematic plain mpc default": {}}
    asked_for: list[Any] = []
    monkeypatch.setattr(fingerprints, "fingerprints", lambda names, worlds: asked_for.append((names, worlds)) or now)
    monkeypatch.setattr(fingerprints, "worlds", lambda: "worlds")
    out = tmp_path / "prints.json"
    for words in ([], ["--out", str(out), "--against", str(tmp_path)]):
        assert CliRunner().invoke(fingerprints.main, words).exit_code == 2
    done = CliRunner().invoke(fingerprints.main, ["--out", str(out)])
    assert (done.exit_code, done.output) == (0, f"2 fingerprints in {out}\n")
    assert json.loads(out.read_text(encoding="utf-8")) == {"steps": fingerprints.STEPS, "entries": now}
    assert asked_for == [(tuple(fingerprints.policies.POLICIES), "worlds")]
    seen: list[Any] = []
    monkeypatch.setattr(fingerprints, "differences", lambda before, now: seen.append(before) or found)
    for found, status in (([], 0), (["one", "two"], 1)):
        done = CliRunner().invoke(fingerprints.main, ["--against", str(out)])
        assert done.exit_code == status
        assert done.output.splitlines() == [*found, f"{len(found)} differences in 2 entries"]
    assert seen[0] == now
    found = []
    CliRunner().invoke(fingerprints.main, ["--against", str(out), "--policies", "lqr"])
    assert list(seen[2]) == ["path p3dx kinematic plain lqr default"]
    assert asked_for[-1][0] == ("lqr",)
    out.write_text('{"entries": []}', encoding="utf-8")
    done = CliRunner().invoke(fingerprints.main, ["--against", str(out)])
    assert done.exit_code == 2
    assert "holds no fingerprints" in done.output


def test_fingerprints_differ_from_the_first_step_on_that_does() -> None:
    quantities = dict.fromkeys(fingerprints.QUANTITIES, "0")
    first, *_ = fingerprints.QUANTITIES
    old = quantities | {"steps": "aaaabbbbcccc"}
    assert fingerprints.differences({"k": {"m": old}}, {"k": {"m": old}}) == []
    assert fingerprints.differences({"k": {}}, {}) == ["k: is gone"]
    assert fingerprints.differences({}, {"k": {}}) == ["k: is new"]
    for steps, at in (("aaaabbbbdddd", 2), ("xaaabbbbcccc", 0), ("aaaabbbb", 2), ("aaaabbbbccccdddd", 3), ("", 0)):
        new = old | {first: "1", "steps": steps}
        assert fingerprints.differences({"k": {"m": old}}, {"k": {"m": new}}) == [f"k, m: {first} from step {at} on"]
    assert fingerprints.differences({"k": {"m": old}}, {"k": {}}) == ["k, m: is gone"]
    assert fingerprints.differences({"k": {}}, {"k": {"m": old}}) == ["k, m: is new"]
    words = [{"words": "no"}, {"words": "another"}]
    assert fingerprints.differences({"k": {"m": words[0]}}, {"k": {"m": words[1]}}) == ["k, m: another"]


def test_a_contest_without_conditions_of_its_own_is_driven_in_three() -> None:
    for contest in CONTESTS.values():
        plain, noise, moderate = fingerprints.conditions(contest)
        first, *_, last = contest.spec.families
        assert (plain.name, plain.scenario, dict(plain.env_kwargs)) == ("plain", f"{first}/test", {})
        assert (noise.scenario, noise.env_kwargs["noise"]) == (f"{first}/test", 1.0)
        assert moderate.scenario == f"{last}/test"
        assert (moderate.env_kwargs["disturbance"], moderate.env_kwargs["action_mode"]) == ("moderate", "wheel_speeds")
        for each in (noise, moderate):
            assert each.env_kwargs["actuators"] == "lagged"
    found = fingerprints.worlds()
    assert len(found) == sum(
        len(fingerprints.DRIVEN) * len(fingerprints.PLANTS) * len(fingerprints.CONDITIONS.get(name) or (1, 2, 3))
        for name in CONTESTS
    )
