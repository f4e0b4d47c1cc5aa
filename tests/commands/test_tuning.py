"""Which set a search chooses: by the whole validation split, in rooms too, and none that is told apart as worse."""

import dataclasses
import json
import re
from collections.abc import Iterable, Sequence
from typing import Any

import click
import pytest
from hypothesis import given
from hypothesis import strategies as st

from wayfield import policies
from wayfield.benchmarks.contests import ALL_CONTESTS, Score

pytest.importorskip("optuna")

from wayfield.benchmarks.tuning import tune
from wayfield.benchmarks.tuning.tune import Drive, Search
from wayfield.envs.robots import ROBOTS

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


# What is chosen.


@given(st.lists(st.booleans(), min_size=20, max_size=20), st.lists(st.booleans(), min_size=20, max_size=20))
def test_no_set_loses_to_itself_nor_to_one_that_does_worse(ours: list[bool], theirs: list[bool]) -> None:
    a, b = drive(place=ours), drive(place=theirs)
    assert a.losses(a) == []
    if sum(ours) >= sum(theirs):
        assert a.losses(b) == []
    assert not (a.losses(b) and b.losses(a))
    assert drive(place=goals(range(20), 20)).losses(drive(place=goals([], 20))) == ["place"]


def test_what_gains_gain_is_paired_by_scenario_on_the_robot_and_on_those_drawn() -> None:
    """Forty scenarios: the tuned gains win four more on the robot, and on each drawn robot one less each."""
    families = [f"family {k // 10}" for k in range(40)]
    names = ("all", "all, drawn 1", "all, drawn 2")

    def driven(lost: dict[str, set[int]], cost: float) -> Drive:
        won = {name: (families, [k not in lost[name] for k in range(40)]) for name in names}
        return Drive(Score(0, 0, 1.0), {}, won, {name: [cost + 0.1 * (k % 3) for k in range(40)] for name in names})

    before = driven({"all": {1, 11, 21, 31}, "all, drawn 1": {2}, "all, drawn 2": set()}, cost=2.0)
    after = driven({"all": set(), "all, drawn 1": {2, 3}, "all, drawn 2": {12}}, cost=1.5)
    same, others = tune.compared(after, before, "all")
    assert (same["robots"], same["episodes"], others["robots"], others["episodes"]) == (1, 40, 2, 80)
    assert same["success"] == [0.9, 1.0]
    assert others["success"] == [0.9875, 0.9625]
    for each, value in ((same, 0.1), (others, -0.025)):
        found, low, high = each["success_difference"]
        assert found == pytest.approx(value)
        assert low < found < high
        assert each["cost_difference"][0] == pytest.approx(-0.5)


def test_the_asked_speed_is_held_at_every_level_or_not_at_all() -> None:
    """Too quick at one level and too slow at the other is not the asked speed, though their mean may be."""
    quick, slow, held = (Score(0, off, 2.0, speed, 10, 100) for off, speed in ((1, 0.64), (1, 0.56), (0, 0.6)))
    both = tune.together([quick, slow])
    assert (both.off_pace, both.mean_speed, both.quality) == (1, pytest.approx(0.6), 2.0)
    assert tune.together([held, held]) < tune.together([held, slow]) < tune.together([held, Score(1, 0, 0.1, 0.6, 10)])
    assert tune.together([slow]) == slow


@pytest.mark.parametrize("suite", tune.TUNED_FOR)
def test_ranges_hold_the_default_and_one_that_ends_at_the_best_is_widened_to_what_the_gain_may_be(suite: str) -> None:
    contest = ALL_CONTESTS[suite]
    speed = contest.rules.speed if contest.rules else 0.6
    tuned = [name for name in contest.policies if name in tune.SEARCHED]
    assert tuned
    for name in tuned:
        asked = search(policy=name, contest=contest, speed=speed)
        default: Any = policies.make(name)
        for gain, each in asked.ranges.items():
            assert each.low <= getattr(default, gain) <= each.high, f"{name}.{gain}"
            for end in (each.low, each.high):
                told = tune.at_ends(name, {gain: each}, {gain: end})
                if told:
                    (wider,) = tune.given_ranges(asked, [told[gain]]).values()
                    assert wider.low < end < wider.high, f"{name}.{gain}"
                else:  # nothing beyond is a gain
                    with pytest.raises(ValueError, match=gain):
                        policies.make(name, **{gain: end + (1e-6 if end == each.high else -1e-6)})


@pytest.mark.parametrize(
    "text", ["margin", "margin=0.1", "margin=0.3:0.1", "margin=0.2:0.3", "marjin=0:1", "margin=-1:1", "max_speed=0.2:2"]
)
def test_a_range_that_cannot_be_searched_is_refused_by_its_name(text: str) -> None:
    asked = search(policy="orca_team", contest=ALL_CONTESTS["crowdnav"], speed=1.0)
    with pytest.raises(click.UsageError, match=re.escape(text)):
        tune.given_ranges(asked, [text])


@pytest.mark.parametrize("suite", tune.CONTESTS)
def test_a_search_may_start_from_what_ships_for_another_condition(suite: str) -> None:
    """From the gains that are searched, and the pace at which a path follower then cruises as the set that ships."""
    found = [json.loads(file.read_text()) for file in sorted(tune.folder_of(suite).glob("*.json"))]
    found = [each for each in found if each["chosen"] == "search"]
    if not found:
        pytest.skip(f"no searched set of gains ships for {suite}")
    for ships in found:
        known = f"{ships['robot']}_{ships['speed']:g}_{ships['level']}"
        start = tune.starting_gains(ships["policy"], suite, known)
        pace = start.pop("pace", None)
        assert start == {k: ships["gains"][k] for k in tune.search_space(ships["policy"], suite) if k in ships["gains"]}
        asked = search(policy=ships["policy"], contest=tune.CONTESTS[suite], speed=ships["speed"])
        assert (pace is not None) == asked.paced
        if pace is not None:
            again = asked.gains_at(start, pace)
            assert again == {name: pytest.approx(ships["gains"][name], rel=0.01) for name in again}
