"""Entries, scenarios and seeds of a contest, from the files that ship."""

import dataclasses
import itertools
import json
import math
import zlib
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import wayfield
from wayfield import policies
from wayfield.benchmarks.commands.contest_options import Options, seed_of
from wayfield.benchmarks.contests import ALL_CONTESTS, CONTESTS, CROSS, GAINS, PAPER, Contest, Course, Entrants
from wayfield.envs.robots import ROBOTS
from wayfield.envs.scenarios import splits
from wayfield.envs.tasks.specs import CROWDS
from wayfield.policies.policy import lacks

HOME = Path(wayfield.__file__).parent / "policies"
PLAIN = [name for name, contest in CONTESTS.items()]
ROBOTS_TRIED = ("p3dx", "omni3", "omni4", "turtlebot3")


def tuned(contest: Contest, name: str, robot: str, pace: float, level: str) -> dict[str, Any] | None:
    """Returns what stands in a file of gains; None where none ships."""
    file = HOME / "gains" / contest.spec.suite / f"{name}_{robot}_{pace:g}_{level}.json"
    return json.loads(file.read_text(encoding="utf-8")) if file.is_file() else None


def sets_of(
    contest: Contest, names: tuple[str, ...], robot: str, kinds: tuple[str, ...], speed: float | None
) -> Iterator[tuple[str, str, dict[str, Any]]]:
    """Yields policy, name of its gains, and gains, of the policies that can drive a robot."""
    pace = 0.6 if speed is None else speed
    for name in names:
        if lacks(policies.make(name), ROBOTS[robot]):
            continue
        if name in ("ppo", "hybrid", "team_guided", "people_free"):
            kind = {"team_guided": "_guided", "people_free": "_free"}.get(name, "")
            agents = HOME / "agents" / f"{contest.spec.name}{kind}_{robot}"
            for seed in sorted(int(folder.name[5:]) for folder in agents.glob("seed_*")):
                yield name, "trained", {"seed": seed}
            continue
        found = []
        if "tuned" in kinds or "best" in kinds:
            found.append(("tuned", tuned(contest, name, robot, pace, "none")))
        if "robust" in kinds:
            found.append(("robust", tuned(contest, name, robot, pace, "moderate")))
        better = [(kind, each) for kind, each in found if each and each["chosen"] != "default"]
        stands_in = bool(found) and found[0][0] == "tuned" and "tuned" not in dict(better)
        if "default" in kinds or stands_in:
            yield name, "default", {}
        by_hand = {"tuned": "by hand", "robust": "by hand, disturbed"}
        for k, (kind, each) in enumerate(better):
            if all(each["gains"] != other["gains"] for _, other in better[:k]):
                yield name, kind if each["chosen"] == "search" else by_hand[kind], each["gains"]
        if "paper" in kinds and name in PAPER:
            yield name, "paper", dict(PAPER[name])


def cruising(name: str, gains: dict[str, Any], speed: float) -> dict[str, Any] | None:
    try:
        return policies.cruising(name, gains, speed)
    except policies.NoCruisingSpeed:
        return None


def test_in_a_cross_play_every_two_policies_share_a_team_once_each_way() -> None:
    names = ("polar", "vfh_plus", "orca_team")
    cases = list(CROSS.cases("p3dx", Course("circle_8", "test"), Entrants(names, ("default", "paper"))))
    assert [(case.policy, case.beside) for case in cases] == list(itertools.permutations(names, 2))
    assert {case.gains_name for case in cases} == {f"beside {name}" for name in names}


@pytest.mark.parametrize("name", [name for name, contest in ALL_CONTESTS.items() if not contest.cross])
@pytest.mark.parametrize("robot", ROBOTS_TRIED)
def test_every_case_is_a_policy_with_one_of_its_sets(name: str, robot: str) -> None:
    contest = ALL_CONTESTS[name]
    course = Course(contest.timed_on, "test", env_kwargs={"scale": 2.0})
    for kinds, speed in itertools.product((*GAINS.values(), ("default", "tuned", "robust")), (None, 0.9)):
        asked = contest.rules.speed if speed is None and contest.rules else speed
        wanted = []
        for policy, kind, gains in sets_of(contest, contest.policies, robot, kinds, asked):
            if asked is not None and kind not in ("tuned", "robust", "by hand", "by hand, disturbed"):
                more = cruising(policy, gains, asked)
                if more is None and speed is not None:
                    continue
                gains = {**gains, **(more or {})}
            wanted.append((policy, kind, gains))
        cases = list(contest.cases(robot, course, Entrants(contest.policies, kinds), "light", speed))
        assert [(case.policy, case.gains_name, dict(case.gains)) for case in cases] == wanted
        for case in cases:
            assert case.env_kwargs == {**contest.env_kwargs, "scale": 2.0, "robot": robot, "disturbance": "light"}
            assert (case.document, case.experiment, case.scenario) == (name, course.family, f"{course.family}/test")
            assert (case.speed, case.rules, case.split, case.every_scenario) == (speed, contest.rules, "test", True)
            assert case.max_episode_steps == contest.spec.clock
            assert case.asked == (contest.rules.speed if contest.rules else speed or 0.6)
            assert case.place == {"contest": name, "family": course.family}
            assert case.gains_text == " ".join(
                f"{key}={value:g}" if isinstance(value, float) else f"{key}={value}"
                for key, value in case.gains.items()
            )
    (calm,) = contest.cases(robot, Course("here", "own", "/a/file.json", 77), Entrants(("zero",), ("default",)))
    assert (calm.scenario, calm.max_episode_steps) == ("/a/file.json", 77)
    assert "disturbance" not in calm.env_kwargs
    assert calm.key == (name, "here", "zero", "")


def test_a_contest_s_scanner_and_rules_are_those_that_its_notes_tell_of() -> None:
    ours = {"num_beams": 72, "max_range": 5.0}
    ust10 = {"num_beams": 720, "field_of_view": 1.5 * math.pi, "max_range": 30.0}  # of the challenge's Jackal
    scanners = {
        **{"path-following": {}, "racetracks": {}, "barn": ust10},
        **dict.fromkeys(("goal-obstacles", "docking", "barn-p3dx", "mrpb", "movingai"), ours),
    }
    for name, contest in ALL_CONTESTS.items():
        rest = dict(contest.env_kwargs)
        if contest.spec in CROWDS.values():  # tracks beside the scan, and what the people are
            scanners[name] = ours
            assert rest.pop("sees") == "bodies"
            assert rest.pop("visible", None) == (None if contest.spec.name == "teams" else name.endswith("-seen"))
            assert rest.pop("people", name) in name
        assert rest == pytest.approx(scanners[name])
    # asked speed and that of the optimal time, where the clock starts and ends, whose way SPL compares with
    told = {
        **{"barn": (1.2, 2.0, 0.1, 100.0, False), "barn-p3dx": (0.6, 0.6, 0.1, 100.0, False)},
        **{"mrpb": (0.55, math.nan, 0.0, math.inf, False), "movingai": (0.6, math.nan, 0.0, math.inf, True)},
        "racetracks": (0.6, math.nan, 0.0, math.inf, False),
        **dict.fromkeys(("crowdnav", "crowdnav-seen"), (1.0, math.nan, 0.0, 25.0, False)),
    }
    for name, contest in ALL_CONTESTS.items():
        assert (contest.rules is not None) == (name in told)
        if contest.rules is not None:
            assert dataclasses.astuple(contest.rules) == pytest.approx(told[name], nan_ok=True)


def options(suite: str, names: tuple[str, ...], **more: Any) -> Options:
    return Options(suite, contests=names, seed=3, **more)


def first_seed(seed: int, split: str, family: str) -> int:
    words = [seed, zlib.crc32(split.encode()), zlib.crc32(family.encode())]
    return int(np.random.SeedSequence(words).generate_state(1)[0]) // 2


def told_of(setting: Any) -> tuple[Any, ...]:
    case = setting.case
    return (
        *(case.document, setting.dynamics, case.experiment, case.split, case.speed),
        *(case.env_kwargs.get("disturbance", "none"), case.policy, case.gains_name, case.gains.get("seed")),
        *(setting.episodes, setting.seed),
    )


@pytest.mark.parametrize("name", PLAIN)
@pytest.mark.parametrize("few", [None, 3])
def test_a_contest_drives_the_split_then_where_gains_were_chosen_then_the_front(name: str, few: int | None) -> None:
    contest = CONTESTS[name]
    wanted: list[tuple[Any, ...]] = []
    plants = ("kinematic", "pymunk")
    for plant in plants:
        families = [
            each for each in contest.spec.families if plant == "pymunk" or each not in contest.spec.needs_pymunk
        ]
        for family in families:
            runs = [("test", None, ("default", "tuned", "paper"), None), ("validation", None, ("tuned",), 5)]
            runs += [("front", speed, ("best",), 5) for speed in contest.speeds]
            for split, speed, kinds, most in runs:
                real = "test" if split == "front" else split
                there = len(splits.split(contest.spec.name, family, real))
                for policy, kind, gains in sets_of(contest, contest.policies, "p3dx", kinds, speed):
                    if speed is not None and kind != "tuned" and cruising(policy, gains, speed) is None:
                        continue
                    limit = most if split == "front" or policy not in ("ppo", "hybrid") else None
                    count = min(each for each in (there, limit, few) if each is not None)
                    seed = first_seed(3, real, family)
                    wanted.append(
                        (name, plant, family, real, speed, "none", policy, kind, gains.get("seed"), count, seed)
                    )
    found = options(name, (name,), dynamics="both", episodes=few).settings()
    assert [told_of(each) for each in found] == wanted
    assert {(each.suite, each.actuators, each.keep, each.members) for each in found} == {(name, "lagged", 3, ())}


def test_the_overview_is_one_scenario_a_family_and_three_seeds() -> None:
    names = tuple(PLAIN)
    found = options("overview", names, gains="best").settings()
    wanted = []
    for name in names:
        contest = CONTESTS[name]
        for family in contest.families("kinematic"):
            for policy, kind, gains in sets_of(contest, contest.policies, "p3dx", ("best",), None):
                if gains.get("seed", 0) < 3 or kind != "trained":
                    seed = first_seed(3, "test", family)
                    told = gains.get("seed") if kind == "trained" else None
                    wanted.append((name, "kinematic", family, "test", None, "none", policy, kind, told, 1, seed))
    assert [told_of(each) for each in found] == wanted


def test_the_ladder_is_five_scenarios_at_every_level() -> None:
    name = "goal-obstacles"
    contest = CONTESTS[name]
    levels = ["none", "light", "moderate", "strong", "severe"]
    more: dict[str, Any] = {"families": ("rooms", "clutter_5"), "policies": ("vfh_plus", "ppo")}
    for asked, kinds in (("all", ("default", "tuned", "robust")), ("default", ("default",))):
        wanted = []
        for family in (each for each in contest.families("kinematic") if each in more["families"]):
            for level in levels:
                for policy, kind, gains in sets_of(contest, ("vfh_plus", "ppo"), "p3dx", kinds, None):
                    told = gains.get("seed") if kind == "trained" else None
                    seed = first_seed(3, "test", family)
                    wanted.append((name, "kinematic", family, "test", None, level, policy, kind, told, 5, seed))
        found = options("disturbances", (name,), gains=asked, **more).settings()
        order = [policy for policy in contest.policies if policy in more["policies"]]
        assert sorted(map(str, map(told_of, found))) == sorted(map(str, wanted))
        assert list(dict.fromkeys(each.case.policy for each in found)) == order


def test_seeds_of_families_are_apart_and_fit_thirty_one_bits() -> None:
    for seed, split, family in itertools.product((0, 7), ("test", "claims"), ("rooms", "doors_narrow")):
        assert seed_of(seed, split, family) == first_seed(seed, split, family) < 2**31
    assert len({seed_of(*each) for each in itertools.product((0, 7), ("test", "claims"), ("a", "b"))}) == 8
    assert math.isfinite(seed_of(2**31 - 1, "test", ""))
