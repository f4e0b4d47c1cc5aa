"""Which set a search chooses: by the whole validation split, in rooms too, and none that is told apart as worse."""

import dataclasses
import json
from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import pytest
from click.testing import CliRunner
from hypothesis import given
from hypothesis import strategies as st

from wayfield.benchmarks.contests.contest import Score

pytest.importorskip("optuna")

from wayfield.benchmarks import tune
from wayfield.benchmarks.rooms import PAIRS, SEEDS, WIDEST
from wayfield.benchmarks.suite import Setting
from wayfield.benchmarks.tune import Drive, Search
from wayfield.envs.robots import ROBOTS
from wayfield.envs.scenarios import SPLITS, splits
from wayfield.policies.tuned import TunedSet

GOALS = tune.CONTESTS["goal-obstacles"]
SLOWEST = 0.43  # m/s, of whatever is driven


def search(name: str = "p3dx", **others: Any) -> Search:
    asked = Search("apf_corrected", GOALS, ROBOTS[name], 0.6, "none", "lagged", 10**9, 3, 2, 0)
    return dataclasses.replace(asked, **others)


def drive(**places: Sequence[bool]) -> Drive:
    """Returns what a set comes to that reaches these goals, ten scenarios a family."""
    won = {name: ([f"family {k // 10}" for k in range(len(each))], list(each)) for name, each in places.items()}
    lost = {name: sum(not each for each in there) for name, (_, there) in won.items()}
    score = Score(sum(lost.values()), 0, 1.0, SLOWEST)
    return Drive(score, {name: Score(count, 0, 1.0) for name, count in lost.items()}, won)


def goals(lost: Iterable[int], count: int = 60) -> list[bool]:
    return [k not in set(lost) for k in range(count)]


# Where a search drives, and where it chooses.


@pytest.mark.parametrize("robot", ["p3dx", "omni3"])
def test_a_set_is_chosen_on_all_of_validation_and_in_rooms_of_its_own(robot: str, tmp_path: Path) -> None:
    asked = search(robot, level="moderate", actuators="slow")
    asked = dataclasses.replace(asked, rooms=asked._drawn_rooms(tmp_path))
    hulls = ["p3dx", "turtlebot3", "jackal"] if robot == "p3dx" else [robot]
    families = len(GOALS.families("kinematic"))
    for split, count, rooms in (
        (tune.SEARCH_SPLIT, asked.scenarios, asked.scenarios),
        (tune.TRANSFER_SPLIT, SPLITS["validation"], tune.VALIDATION_ROOMS),
    ):
        first, *others = asked.places(split)
        assert [place.robot.name for place in others] == hulls
        assert asked._scenarios(first)[0] is splits.split("goal_reaching", next(iter(GOALS.spec.families)), split)[0]
        assert len(asked._scenarios(first)) == count * families
        for place in others:
            there = asked._scenarios(place)
            assert len(there) == rooms * PAIRS
            assert len({each.grid.occupied.shape for each in there}) > 1  # sizes vary
            parts = asked.settings(place, {"k": 0.7})
            assert sum(len(part.members) for part in parts) == len(there)
            assert {part.case.env_kwargs["robot"] for part in parts} == {place.robot.name}
            assert {part.case.gains["k"] for part in parts} == {0.7}
        for place in (first, *others):
            for part in asked.settings(place, {}):
                assert (part.case.env_kwargs["disturbance"], part.actuators, part.dynamics) == (
                    "moderate",
                    "slow",
                    "kinematic",
                )
    files = [{course.file for course in courses} for courses in asked.rooms.values()]
    assert not files[0] & files[1]


def test_paths_are_searched_on_no_rooms_and_neither_are_gains_of_a_hull_that_has_no_way_there(tmp_path: Path) -> None:
    paths = search(contest=tune.CONTESTS["path-following"], policy="lqr")
    wide = search(robot=dataclasses.replace(ROBOTS["omni3"], hull_radius=WIDEST + 0.01))
    for asked in (paths, wide):
        assert asked._drawn_rooms(tmp_path) == {}
        assert [place.name for place in asked.places("train")] == ["train"]
    assert not list(tmp_path.iterdir())


def test_every_row_of_a_drive_belongs_to_its_place(tmp_path: Path) -> None:
    """With an engine that tells of each setting what it was asked for, in place of driving it."""
    asked = search()
    asked = dataclasses.replace(asked, rooms=asked._drawn_rooms(tmp_path))

    def engine(function: Any, settings: Iterable[Setting]) -> Iterator[list[dict[str, str]]]:
        del function
        for setting in settings:
            robot = setting.case.env_kwargs["robot"]
            won = str(int(robot == "jackal" or (robot == "p3dx" and setting.case.split == "train")))
            row = {"family": setting.case.experiment, "success": won, "sct": won, "time": "1.0", "mean_speed": "0.5"}
            yield [row] * setting.episodes

    engine.remote = False  # type: ignore[attr-defined]
    found = asked.drive({}, "train", engine)  # type: ignore[arg-type]
    families = len(GOALS.families("kinematic"))
    ways = asked.scenarios * PAIRS
    assert {name: (each.failures, each.episodes) for name, each in found.places.items()} == {
        "train": (0, asked.scenarios * families),
        "rooms": (ways, ways),
        "rooms, turtlebot3": (ways, ways),
        "rooms, jackal": (0, ways),
    }
    assert found.score.failures == 2 * ways
    assert found.score.frames == sum(each.frames for each in found.places.values())
    assert len(set(found.won["train"][0])) == families
    assert len(set(found.won["rooms"][0])) == asked.scenarios


# What is chosen.


def chosen(
    monkeypatch: pytest.MonkeyPatch, drives: Mapping[float, Drive], ships: TunedSet | None = None
) -> tuple[dict[str, Any], list[float]]:
    """Returns what a search comes to that finds the sets in this order, k alone, and what it validated.

    The first is the policy's own, as k = 0.
    """
    validated: list[float] = []

    def driven(_: Search, gains: dict[str, Any], split: str, engine: Any, least: float = 0.0) -> Drive:
        del engine
        assert split == tune.TRANSFER_SPLIT
        assert least == (SLOWEST if validated else 0.0)  # no set shall be slower than the default gains, the first
        validated.append(gains.get("k", 0.0))
        return drives[gains.get("k", 0.0)]

    found = [{"k": k} for k in drives if k and (ships is None or k != ships.gains["k"])]
    monkeypatch.setattr(Search, "drive", driven)
    monkeypatch.setattr(Search, "_searched", lambda *_: (found, 1000))
    monkeypatch.setattr(tune, "tuned_set", lambda *_: ships)
    return search().run(lambda *_: []), validated  # type: ignore[arg-type, return-value]


def test_the_best_of_the_search_does_not_win_by_it_but_by_validation(monkeypatch: pytest.MonkeyPatch) -> None:
    drives = {0.0: drive(all=goals([1, 2, 3])), 1.5: drive(all=goals([1, 2])), 1.6: drive(all=goals([2]))}
    content, validated = chosen(monkeypatch, drives)
    assert (content["chosen"], content["gains"]) == ("search", {"k": 1.6})
    assert content["validation"]["winner"] == "found 2"
    assert content["validation"]["chosen"]["failures"] == 1
    assert sorted(validated) == [0.0, 1.5, 1.6]
    many = {k: drive(all=goals([1])) for k in (0.0, *(1.1 + 0.1 * n for n in range(tune.FINALISTS + 3)))}
    assert len(chosen(monkeypatch, many)[1]) == 1 + tune.FINALISTS


def test_a_set_that_loses_in_one_place_is_not_chosen_however_well_it_does_in_another(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    default = drive(validation=goals(range(30)), rooms=goals([]))
    away = drive(validation=goals([]), rooms=goals(range(0, 60, 4)))  # fewer in all, a quarter of the rooms
    level = drive(validation=goals(range(25)), rooms=goals([7]))  # one more there is not told apart
    assert away.score < level.score < default.score
    content, _ = chosen(monkeypatch, {0.0: default, 1.5: away, 1.6: level})
    assert content["gains"] == {"k": 1.6}
    told = content["validation"]["finalists"]
    assert told["found 1"]["loses_to_default_in"] == ["rooms"]
    assert told["found 1"]["rooms"]["failures"] == 15
    assert told["found 2"]["loses_to_default_in"] == told["default"]["loses_to_default_in"] == []
    content, _ = chosen(monkeypatch, {0.0: default, 1.5: away})
    assert (content["chosen"], content["gains"]) == ("default", {})
    assert content["validation"]["chosen"] == content["validation"]["default"]


def test_what_ships_is_validated_too_and_stays_where_nothing_is_better(monkeypatch: pytest.MonkeyPatch) -> None:
    ships = TunedSet({"k": 0.9}, "p3dx", 0.6, "none", "search", 5000, "validation")
    drives = {0.0: drive(all=goals([1, 2, 3])), 1.5: drive(all=goals([1, 2])), 0.9: drive(all=goals([1]))}
    content, validated = chosen(monkeypatch, drives, ships)
    assert sorted(validated) == [0.0, 0.9, 1.5]
    assert (content["chosen"], content["gains"], content["validation"]["winner"]) == ("search", {"k": 0.9}, "shipped")
    assert content["frames"] == 1000 + 5000  # what it was found with, too
    assert content["searched_on"]["split"] == "validation"  # and where
    assert content["searched_on"]["rooms"]["validation"]["seed"] == SEEDS["validation"]
    default = dataclasses.replace(ships, chosen="default", gains={})
    content, validated = chosen(monkeypatch, {k: each for k, each in drives.items() if k != 0.9}, ships=None)
    assert content["gains"] == {"k": 1.5}
    monkeypatch.setattr(tune, "tuned_set", lambda *_: default)
    assert search()._ships is None
    assert search(robot=dataclasses.replace(ROBOTS["p3dx"], hull_radius=0.3))._ships is None


@given(st.lists(st.booleans(), min_size=20, max_size=20), st.lists(st.booleans(), min_size=20, max_size=20))
def test_no_set_loses_to_itself_nor_to_one_that_does_worse(ours: list[bool], theirs: list[bool]) -> None:
    a, b = drive(place=ours), drive(place=theirs)
    assert a.losses(a) == []
    if sum(ours) >= sum(theirs):
        assert a.losses(b) == []
    assert not (a.losses(b) and b.losses(a))
    assert drive(place=goals(range(20), 20)).losses(drive(place=goals([], 20))) == ["place"]


@pytest.mark.parametrize("suite", tune.CONTESTS)
def test_a_search_may_start_from_what_ships_for_another_condition(suite: str) -> None:
    """From the gains that are searched, and the pace at which a path follower then cruises as the set that ships."""
    found = [json.loads(file.read_text()) for file in sorted(tune.folder_of(suite).glob("*.json"))]
    found = [each for each in found if each["chosen"] == "search"]
    assert found
    for ships in found:
        known = f"{ships['robot']}_{ships['speed']:g}_{ships['level']}"
        start = tune.start_of(ships["policy"], suite, known)
        pace = start.pop("pace", None)
        assert start == {k: ships["gains"][k] for k in tune.searched(ships["policy"], suite) if k in ships["gains"]}
        asked = search(policy=ships["policy"], contest=tune.CONTESTS[suite], speed=ships["speed"])
        assert (pace is not None) == asked.paced
        if pace is not None:
            again = asked.gains_at(start, pace)
            assert again == {name: pytest.approx(ships["gains"][name], rel=0.01) for name in again}


def test_a_file_in_the_way_ends_a_search_before_it_begins_and_one_that_came_meanwhile_stays(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    out, searched = tmp_path / "gains.json", []
    found = {"policy": "lqr", "chosen": "default", "validation": {"default": 1, "winner": "default"}}

    def run(asked: Search, engine: Any) -> dict[str, Any]:
        del engine
        searched.append(asked)
        out.write_text("another's")
        return found

    monkeypatch.setattr(Search, "run", run)
    words = (
        "lqr --suite path-following --robot omni3 --speed 0.45 --level light --actuators slow --frames 9000 --trials 7"
    )
    words += f" --scenarios 3 --seed 5 --workers 1 --from {{}} --study s.journal --out {out}"
    for before in (False, True):
        if before:
            out.write_text("another's")
        refused = CliRunner().invoke(tune.main, words.split())
        assert (refused.exit_code, "--force replaces it" in refused.stderr) == (2, True)
        assert out.read_text() == "another's"
        assert len(searched) == 1
    contest = tune.CONTESTS["path-following"]
    wanted = Search("lqr", contest, ROBOTS["omni3"], 0.45, "light", "slow", 9000, 7, 3, 5, ({},), "s.journal")
    assert searched == [wanted]
    assert CliRunner().invoke(tune.main, [*words.split(), "--force"]).exit_code == 0
    assert json.loads(out.read_text()) == found
