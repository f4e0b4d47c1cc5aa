"""The commands behind the page's other tables, with episodes and trainings that only pretend: what they ask of them."""

import contextlib
import csv
import dataclasses
import io
import sys
import types
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from click.testing import CliRunner

from wayfield.benchmarks import coppelia, learners, transfer
from wayfield.benchmarks.contests import ALL_CONTESTS, CONTESTS, Course
from wayfield.benchmarks.learners import Learned
from wayfield.benchmarks.public_suites import PUBLIC
from wayfield.benchmarks.results import read_rows
from wayfield.benchmarks.suite import Setting
from wayfield.benchmarks.trajectory import Trajectory
from wayfield.envs.scenarios import GOAL_SCENARIOS, PATH_SCENARIOS, SPLITS

NOBODY = Learned("", "", "", "", "", "")


def shown(file: Path) -> list[dict[str, str]]:
    return list(csv.DictReader(io.StringIO(file.read_text(encoding="utf-8"))))


@pytest.fixture
def engine(monkeypatch: pytest.MonkeyPatch) -> list[int]:
    """Returns how many processes were asked for, of which none is begun."""
    counts: list[int] = []

    @contextlib.contextmanager
    def shared(count: int) -> Iterator[Any]:
        counts.append(count)
        yield lambda function, wanted: [function(each) for each in wanted]

    monkeypatch.setattr(transfer, "shared_out", shared)
    monkeypatch.setattr(learners, "workers", shared)
    return counts


def episodes_of(seen: list[Setting]) -> Any:
    """Returns what stands in for `suite.episodes`: a success in two of three, and a yaw rate that grows."""

    def episodes(setting: Setting) -> list[Any]:
        seen.append(setting)
        rates = np.array([0.0, 0.25, 0.75])
        driven = Trajectory(0.05 * np.arange(3), np.zeros((3, 3)), np.column_stack([rates, rates, rates]))
        return [
            (
                {
                    "scenario": f"{setting.case.scenario}#{k}", "episode": str(k), "policy": setting.case.policy,
                    "success": str(int(k % 3 > 0)), "mean_speed": "0.5", "cross_track_rms": repr(0.01 * (k + 1)),
                    "time": "9.0",
                },
                driven,
            )
            for k in range(setting.episodes)
        ]  # fmt: skip

    return episodes


def above(output: str) -> str:
    """Returns the headers of a table that was printed, line by line."""
    lines = output.splitlines()
    rules = [k for k, line in enumerate(lines) if set(line.strip()) and set(line.strip()) <= set("━─┏┳┓┡╇┩╌-+ ")]
    return "\n".join(lines[rules[0] : rules[1]] if len(rules) > 1 else lines[: rules[0]])


# ---- learners beside each other


def test_a_learner_s_agent_drives_a_family_and_so_does_the_controller(monkeypatch: pytest.MonkeyPatch) -> None:
    seen: list[Setting] = []
    monkeypatch.setattr(learners, "episodes", episodes_of(seen))
    family = learners.CONTEST.families("kinematic")[2]
    rows = learners.driven((NOBODY, family, "validation"))
    (setting,) = seen
    count = SPLITS["validation"]
    assert (setting.suite, setting.dynamics, setting.actuators, setting.seed) == ("learners", "kinematic", "lagged", 0)
    assert (setting.episodes, setting.members) == (count, tuple(range(count)))
    assert (setting.case.policy, setting.case.gains_name) == ("regulated_pure_pursuit", "tuned")
    assert (setting.case.experiment, setting.case.split) == (family, "validation")
    assert [int(row["episode"]) for row in rows] == list(range(count))
    for k, row in enumerate(rows):
        assert row["learner"] == row["policy"] == "regulated_pure_pursuit"
        assert (row["agent_seed"], row["split"], row["family"]) == ("", "validation", family)
        assert row["failure_cost"] == str(learners.CONTEST.failure_cost(setting.case.max_episode_steps))
        assert row["yaw_change"] == "0.375"
        assert row["cross_track_rms"] == repr(0.01 * (k + 1))
        assert "frames" in row["learned_from"]
        assert "time" not in row
    told = types.SimpleNamespace(gains={"seed": 4})
    other = types.SimpleNamespace(gains={"seed": 7})
    home: list[Any] = []

    class Contest:
        bar = learners.CONTEST.bar

        def cases(self, robot: Any, course: Course, entrants: Any) -> list[Any]:
            home.append((robot.name, course.family, entrants.homes))
            case = setting.case
            return [dataclasses.replace(case, policy="ppo", gains=each.gains) for each in (other, told)]

        def failure_cost(self, steps: int) -> float:
            return 1.0

    monkeypatch.setattr(learners, "CONTEST", Contest())
    monkeypatch.setattr(learners, "described", lambda contest, case: {"knows": "sensors", "learned_from": "x"})
    rows = learners.driven((Learned("SAC", "nothing", "4", "2000000", "9", "8", "/home"), family, "test"))
    assert home == [("p3dx", family, ("/home",))]
    assert seen[1].case.gains["seed"] == 4
    assert {(row["learner"], row["begins"], row["agent_seed"], row["learned_from"]) for row in rows} == {
        ("SAC", "nothing", "4", "2.0 M frames")
    }
    assert {(row["frames"], row["seconds"], row["cpu_seconds"], row["knows"]) for row in rows} == {
        ("2000000", "9", "8", "sensors")
    }


def test_how_a_learner_begins_is_on_its_card(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    cards: dict[str, Any] = {}
    monkeypatch.setattr(learners, "trained", lambda home: {2: tmp_path})
    monkeypatch.setattr(learners, "read_card", lambda file: cards)
    for card, begins in (
        ({"base": {"controller": "lqr"}, "training": {"taught_by": "x"}}, "adds to lqr"),
        ({"training": {"taught_by": "lqr"}}, "a copy of lqr"),
        ({"training": {}}, "nothing"),
    ):
        cards.clear()
        cards.update(card)
        assert learners.learned(tmp_path, 2) == Learned("PPO", begins, "2", "", "", "", str(tmp_path))
        assert learners._frames(tmp_path, 2) == 0
    cards["training"] = {"run_frames": 77}
    assert learners._frames(tmp_path, 2) == 77
    assert learners._frames(tmp_path, 3) == 0


def test_what_lacks_frames_is_trained_and_what_was_begun_goes_on(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    asked: list[Any] = []
    state = {"done": True, "error": ""}

    @dataclasses.dataclass(frozen=True)
    class Job:
        env_id: str
        preset: Any
        settings: tuple[str, ...]
        seed: int
        folder: Path
        command: str
        resume: bool = False

    def train_all(jobs: Sequence[Job], at_once: int, show: Any) -> list[Any]:
        asked.append((list(jobs), at_once))
        show(types.SimpleNamespace(row=None, seed=9, frames=1, steps=2))
        show(types.SimpleNamespace(row={}, seed=1, frames=1500, steps=20_000))
        return [types.SimpleNamespace(**state) for _ in jobs]

    def module(name: str, **content: Any) -> None:
        found = types.ModuleType(name)
        for key, value in content.items():
            setattr(found, key, value)
        monkeypatch.setitem(sys.modules, name, found)

    def overridden(preset: Any, settings: tuple[str, ...]) -> Any:
        steps = int(settings[0].partition("=")[2]) if settings else 100
        return types.SimpleNamespace(steps=steps, env_ids=(f"env of {preset}", "other"))

    checked: list[Job] = []
    known = {name: name for name in learners.PRESETS}
    training = "wayfield.policies.training"
    module(f"{training}.presets", PRESETS=known, overridden=overridden)
    module(f"{training}.run", Job=Job, Report=object, check_folder=checked.append)
    module(f"{training}.seeds", train_all=train_all)
    frames = {(learners.PRESETS[0], 0): 100, (learners.PRESETS[1], 0): 99, (learners.PRESETS[0], 1): 500}
    monkeypatch.setattr(learners, "_frames", lambda home, seed: frames.get((home.name, seed), 0))
    for name, seed in frames:
        (tmp_path / name / f"seed_{seed}").mkdir(parents=True)
        (tmp_path / name / f"seed_{seed}" / "run.json").touch()
    learners.train_missing(tmp_path, range(2), None, 3)
    assert capsys.readouterr().err == "seed 1: 1,500 of 20,000 frames\n"
    ((jobs, at_once),) = asked
    assert at_once == 3
    every = [(name, seed) for seed in range(2) for name in learners.PRESETS]
    assert [(job.preset.env_ids[0].removeprefix("env of "), job.seed) for job in checked] == every
    whole = {(learners.PRESETS[0], 0), (learners.PRESETS[0], 1)}  # as many frames as were asked for, or more
    assert [(job.folder.parent.name, job.seed) for job in jobs] == [each for each in every if each not in whole]
    for job in jobs:
        name = job.folder.parent.name
        assert job.folder == tmp_path / name / f"seed_{job.seed}"
        assert job.env_id == f"env of {name}"
        assert job.command == f"python train.py env of {name} --preset {name} --seed {job.seed}"
        assert job.resume is ((name, job.seed) in frames)
        assert job.settings == ()
    asked.clear()
    learners.train_missing(tmp_path, [0], 99, 1)
    assert all(job.settings == ("steps=99",) for job in asked[0][0])
    assert (learners.PRESETS[1], 0) not in {(job.folder.parent.name, job.seed) for job in asked[0][0]}
    state["done"] = False
    for error, said in (("", "stopped; given again, the command goes on"), ("lost", "lost")):
        state["error"] = error
        with pytest.raises(RuntimeError, match=said):
            learners.train_missing(tmp_path, [0], None, 1)
    asked.clear()
    monkeypatch.setattr(learners, "_frames", lambda home, seed: 100)
    for name in learners.PRESETS:
        (tmp_path / name / "seed_0").mkdir(parents=True, exist_ok=True)
        (tmp_path / name / "seed_0" / "run.json").touch()
    learners.train_missing(tmp_path, [0], None, 1)
    assert not asked


def test_learners_are_trained_driven_and_told(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, engine: list[int]
) -> None:
    trained: list[Any] = []
    drives: list[Any] = []

    def driven(asked: tuple[Learned, str, str]) -> list[dict[str, str]]:
        who, family, split = asked
        drives.append(asked)
        told = {key: value for key, value in dataclasses.asdict(who).items() if key not in ("seed", "home")}
        law = who.learner or "law"
        return [
            told | {"learner": law, "agent_seed": who.seed, "split": split, "family": family, "episode": str(k),
                    "scenario": f"{family}/{split}", "success": "1", "mean_speed": "0.6", "policy": law,
                    "knows": "x", "learned_from": "2.0 M frames", "failure_cost": "1.0", "yaw_change": "0.1",
                    "cross_track_rms": repr(0.01 + 0.001 * k)}
            for k in range(2)
        ]  # fmt: skip

    monkeypatch.setattr(learners, "driven", driven)
    monkeypatch.setattr(learners, "train_missing", lambda home, *words: trained.append((home, *map(str, words))))
    monkeypatch.setattr(
        learners, "learned",
        lambda home, seed: Learned("PPO", home.name, str(seed), "2000000", "90", str(50 + 10 * seed), str(home)),
    )  # fmt: skip
    monkeypatch.setattr(learners, "cores", lambda: 7)
    home, out = tmp_path / "runs", tmp_path / "out"
    words = ["--seeds", "2", "--steps", "5000", "--agents", str(home), "--out", str(out), "--workers", "2"]
    done = CliRunner().invoke(learners.main, words)
    assert done.exit_code == 0, done.output
    assert trained == [(home, "range(0, 2)", "5000", "2")]
    assert engine == [2]
    families = learners.CONTEST.families("kinematic")
    asked = [(who.home and Path(who.home).name, who.seed, family, split) for who, family, split in drives]
    whose = [("", ""), *((name, str(seed)) for name in learners.PRESETS for seed in range(2))]
    assert asked == [(*who, family, split) for who in whose for split in ("validation", "test") for family in families]
    rows = read_rows(out)
    assert len(rows) == 2 * len(drives)
    lines = shown(out / "learners.csv")
    assert [line["begins with"] for line in lines] == ["", *learners.PRESETS]
    assert [line["seeds"] for line in lines] == ["", "2", "2", "2", "2"]
    assert lines[1]["CPU (s)"] == "55 [50 to 60]"
    said = " ".join(done.output.split())
    assert "`python -m wayfield.benchmarks.learners --seeds 2 --steps 5000`" in said
    assert "Learners beside each other" in (out / "table.md").read_text(encoding="utf-8")
    header = above(done.output)
    for name in ("learner", "seeds", "success"):
        assert name in header
    for name in ("told", "CPU", "wall"):  # in the files alone
        assert name not in header
    done = CliRunner().invoke(learners.main, ["--agents", str(home)])
    assert trained[1] == (home, "range(0, 3)", "None", "7")
    assert "`python -m wayfield.benchmarks.learners`" in " ".join(done.output.split())
    for error in (OSError("bad"), RuntimeError("bad"), ValueError("bad"), FloatingPointError("bad")):
        monkeypatch.setattr(learners, "train_missing", lambda *_, error=error: (_ for _ in ()).throw(error))
        done = CliRunner().invoke(learners.main, ["--agents", str(home)])
        assert (done.exit_code, done.output) == (1, "learners: bad\n")


# ---- gains elsewhere


def test_gains_are_tried_where_they_were_chosen_and_elsewhere(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    count = len(transfer.CONTEST.families("kinematic"))
    room = Course("room_0", "public", str(tmp_path), 4000, members=(0, 1))
    asked: list[Any] = []
    barn = dataclasses.replace(PUBLIC["barn"], courses=lambda data, robot: asked.append((data, robot)) or [room])
    monkeypatch.setitem(PUBLIC, "barn", barn)  # type: ignore[arg-type]
    for robot in transfer.TUNED_FOR:
        found = list(transfer.places(robot, [room], "/data"))
        others = ["rooms, turtlebot3", "rooms, jackal"] if robot.name == "p3dx" else []
        assert [place.name for place in found] == ["validation", "test", "rooms", *others, "BARN"]
        for place in found[:2]:
            (course,) = place.courses
            assert (course.family, course.split) == ("all", place.name)
            assert course.members == tuple(range(count * SPLITS[place.name]))
        assert found[-1].contest is ALL_CONTESTS[PUBLIC["barn"].modes["p3dx"].contest]
        assert asked.pop() == ("/data", robot)
        assert all(place.robot == robot for place in found if place.name in ("validation", "test", "rooms", "BARN"))
        assert "BARN" not in [place.name for place in transfer.places(robot, [room], None)]
    entry = next(each for each in transfer.entries(("vfh_plus",)) if each.gains_name == "tuned")
    seen: list[Setting] = []
    monkeypatch.setattr(transfer, "episodes", episodes_of(seen))
    monkeypatch.setattr(
        transfer, "described",
        lambda contest, case: {"learned_from": f"{case.gains_name} {case.env_kwargs['robot']}"},
    )  # fmt: skip
    place = next(iter(transfer.places(entry.robot, [], None)))
    (course,) = place.courses
    members = dataclasses.replace(course, members=(3, 1, 4))
    rows = transfer.tried((entry, place, members))
    (setting,) = seen
    assert (setting.suite, setting.dynamics, setting.actuators, setting.seed) == ("transfer", "kinematic", "lagged", 0)
    assert (setting.episodes, setting.members) == (3, (3, 1, 4))
    assert (setting.case.policy, setting.case.gains_name) == ("vfh_plus", "tuned")
    assert {name: setting.case.gains[name] for name in entry.gains} == dict(entry.gains)
    assert [row["episode"] for row in rows] == ["3", "1", "4"]
    assert [row["success"] for row in rows] == ["0", "1", "1"]
    assert {(row["place"], row["learned_from"], row["robot"]) for row in rows} == {("validation", "tuned p3dx", "p3dx")}
    assert rows[0]["scenario"] == f"{setting.case.scenario}#0"
    # with another hull it is the same set, with what it was learned from
    seen.clear()
    elsewhere = next(each for each in transfer.places(entry.robot, [room], None) if each.name == "rooms, jackal")
    rows = transfer.tried((entry, elsewhere, room))
    assert seen[0].case.env_kwargs["robot"] == "jackal"
    assert {(row["robot"], row["learned_from"], row["scenario"]) for row in rows} == {
        ("p3dx", "tuned p3dx", "rooms, jackal, room_0")
    }


def test_the_command_tries_every_set_in_every_place(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, engine: list[int]
) -> None:
    tried: list[Any] = []
    rooms: list[Any] = []
    datas: list[Any] = []
    course = Course("all", "test", members=(0,))

    def one(asked: Any) -> list[dict[str, str]]:
        entry, place, where = asked
        tried.append((entry, place.name, where))
        told = {"robot": entry.robot.name, "policy": entry.policy, "gains_name": entry.gains_name}
        return [told | {"learned_from": "1 M frames", "place": place.name, "scenario": f"{place.name} {k}",
                        "episode": str(k), "success": str(int(k < 3))} for k in range(4)]  # fmt: skip

    def places(robot: Any, found: Any, data: Any) -> list[Any]:
        datas.append(data)
        names = ("test", "rooms", *(("BARN",) if data else ()))
        return [types.SimpleNamespace(name=name, courses=[course, course]) for name in names]

    monkeypatch.setattr(transfer, "tried", one)
    monkeypatch.setattr(transfer, "places", places)
    monkeypatch.setattr(transfer, "write_rooms", lambda folder, *words: rooms.append(words) or [])
    sets = list(transfer.entries(("vfh_plus", "dwa")))
    for words, told, asked in (
        (["--policies", "vfh_plus,dwa"], " --policies vfh_plus,dwa", (16, 0)),
        (["--policies", "vfh_plus,dwa", "--rooms", "3", "--data", str(tmp_path), "--seed", "7", "--workers", "2"],
         " --policies vfh_plus,dwa --rooms 3 --data BARN --seed 7", (3, 7)),
    ):  # fmt: skip
        for each in (tried, rooms, datas, engine):
            each.clear()
        out = tmp_path / f"out{len(words)}"
        done = CliRunner().invoke(transfer.main, [*words, "--out", str(out)])
        assert done.exit_code == 0, done.output
        barn = "--data" in words
        assert datas == [str(tmp_path) if barn else None] * 3
        assert rooms == [asked]
        assert engine == [2 if barn else 1]
        names = ["test", "test", "rooms", "rooms", *(("BARN", "BARN") if barn else ())]
        assert [(entry, name) for entry, name, _ in tried] == [(entry, name) for entry in sets for name in names]
        lines = shown(out / "transfer.csv")
        assert list(lines[0]) == ["robot", "policy", "gains", "learned from", "test", "rooms", *(["BARN"] * barn)]
        assert len(lines) == len(sets)
        assert all(line["test"].startswith("75.0 [") for line in lines)
        assert len(read_rows(out)) == 4 * len(tried)
        text = (out / "table.md").read_text(encoding="utf-8")
        assert f"`python -m wayfield.benchmarks.transfer{told}`" in text
        assert "Rooms: 4 of 8 to 20 m" in text
        header = above(done.output)
        assert "learned" not in header  # for which a terminal has no room
        assert "gains" in header
        assert done.output.count("75.0 [") >= len(sets) or "75.0" in done.output
    monkeypatch.setattr(transfer, "write_rooms", lambda *_: (_ for _ in ()).throw(OSError("full")))
    done = CliRunner().invoke(transfer.main, ["--policies", "dwa"])
    assert (done.exit_code, done.output) == (1, "transfer: full\n")


# ---- policies in a running simulator


def test_what_is_driven_in_a_simulator(tmp_path: Path) -> None:
    for name, presets in (("path-following", PATH_SCENARIOS), ("goal-obstacles", GOAL_SCENARIOS)):
        contest = CONTESTS[name]
        for scenario in (next(iter(presets)), f"{contest.families('kinematic')[0]}/test"):
            found = coppelia.cases_of(scenario, None, "host:1", None)
            assert [case.policy for case in found] == list(contest.policies)
            for case in found:
                assert case.scenario == case.experiment == scenario
                assert case.env_id == contest.env_id("p3dx")
                assert dict(case.env_kwargs) == {**contest.env_kwargs, "address": "host:1"}
                assert case.max_episode_steps == 1200
        two = contest.policies[1:3]
        found = coppelia.cases_of(scenario, two, None, 77)
        assert [case.policy for case in found] == list(two)
        assert {case.max_episode_steps for case in found} == {77}
        wrong = CONTESTS["goal-obstacles" if name == "path-following" else "path-following"].policies[0]
        with pytest.raises(ValueError, match=f"policy '{wrong}' cannot do it; choose from"):
            coppelia.cases_of(scenario, (two[0], wrong), None, None)
    file = tmp_path / "way.csv"
    file.write_text("x,y\n0,0\n30,0\n", encoding="utf-8")
    (case,) = coppelia.cases_of(str(file), ("lqr",), "host:2", None)
    assert case.env_kwargs["address"] == "host:2"
    assert case.max_episode_steps > 1200
    (case,) = coppelia.cases_of(str(file), ("lqr",), None, 5)
    assert case.max_episode_steps == 5
    with pytest.raises(ValueError, match=r"'circl' is unknown\. Did you mean 'circle'"):
        coppelia.cases_of("circl", None, None, None)


def test_episodes_in_a_simulator_come_one_after_another(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    seen: list[Setting] = []
    monkeypatch.setattr(coppelia, "episodes", episodes_of(seen))
    cases = coppelia.cases_of("circle", ("lqr", "stanley"), None, 50)
    rows, trajectories = coppelia.driven(cases, "lagged", 5, 2)
    assert [(each.case.policy, each.seed, each.episodes) for each in seen] == [
        ("lqr", 5, 1), ("lqr", 6, 1), ("stanley", 5, 1), ("stanley", 6, 1),
    ]  # fmt: skip
    assert {(each.suite, each.dynamics, each.actuators) for each in seen} == {("coppelia", "coppelia", "lagged")}
    assert [(row["policy"], row["episode"], row["trajectory"]) for row in rows] == [
        ("lqr", "0", "00000"), ("lqr", "1", "00001"), ("stanley", "0", "00002"), ("stanley", "1", "00003"),
    ]  # fmt: skip
    assert list(trajectories) == ["00000", "00001", "00002", "00003"]
    assert capsys.readouterr().err.splitlines()[1] == "lqr, seed 6: 0.10 s"


def test_the_command_drives_in_a_simulator_and_writes_what_it_saw(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    asked: list[Any] = []
    made: list[Any] = []
    monkeypatch.setattr(coppelia, "cases_of", lambda *words: asked.append(words) or cases)
    cases = coppelia.Case("path", "circle", "id", "circle", "lqr"), coppelia.Case("path", "circle", "id", "circle", "x")
    driven = Trajectory(0.05 * np.arange(3), np.zeros((3, 3)))

    def drive(*words: Any) -> Any:
        made.append(words)
        return [{"trajectory": "00000", "policy": "lqr", "success": "1"}], {"00000": driven}

    printed: list[Any] = []
    written: list[Any] = []
    drawn: list[Any] = []

    @contextlib.contextmanager
    def drawing(*words: Any) -> Iterator[None]:
        drawn.append(words)
        yield

    monkeypatch.setattr(coppelia, "driven", drive)
    monkeypatch.setattr(coppelia, "_print", printed.append)
    monkeypatch.setattr(coppelia, "write_case_tables", lambda stage, rows, cases: written.append((rows, cases)) or "T")
    monkeypatch.setattr(coppelia, "wanted_figures", lambda stage, rows: rows)
    monkeypatch.setattr(coppelia, "drawing", drawing)
    out = tmp_path / "out"
    words = ["--scenario", "circle", "--policies", "lqr,stanley", "--address", "h:9", "--actuators", "slow"]
    done = CliRunner().invoke(
        coppelia.main, [*words, "--steps", "9", "--episodes", "3", "--seed", "4", "--out", str(out)]
    )
    assert done.exit_code == 0, done.output
    assert asked == [("circle", ("lqr", "stanley"), "h:9", 9)]
    assert made == [(cases, "slow", 4, 3)]
    assert printed == ["T"]
    assert [dict(row)["policy"] for row in written[0][0]] == ["lqr"]
    assert written[0][1] == cases
    assert len(drawn) == 1
    assert done.output == f"Results are in {out}/\n"
    assert {"episodes.csv", "trajectories.npz", "run.json"} <= {file.name for file in out.iterdir()}
    folders: list[Any] = []
    monkeypatch.setattr(coppelia, "default_folder", lambda *words: folders.append(words) or tmp_path / "named")
    done = CliRunner().invoke(coppelia.main, [])
    assert done.exit_code == 0, done.output
    assert asked[1] == ("figure_eight_lap", None, None, None)
    assert made[1][1:] == ("ideal", 0, 1)
    assert folders == [("coppelia", {"scenario": "figure_eight_lap", "policies": None, "episodes": None, "seed": 0})]
    for error in (ValueError("no"), RuntimeError("no"), ModuleNotFoundError("no")):
        monkeypatch.setattr(coppelia, "driven", lambda *_, error=error: (_ for _ in ()).throw(error))
        done = CliRunner().invoke(coppelia.main, ["--out", str(tmp_path / "none")])
        assert (done.exit_code, done.output) == (1, "coppelia: no\n")
        assert not (tmp_path / "none" / "episodes.csv").exists()
    monkeypatch.setattr(coppelia, "cases_of", lambda *_: (_ for _ in ()).throw(OSError("gone")))
    done = CliRunner().invoke(coppelia.main, [])
    assert done.exit_code == 2
    assert "--scenario: gone" in done.output
