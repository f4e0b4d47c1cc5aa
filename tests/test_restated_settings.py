"""Who drives where in a contest, with which gains and from which seeds, stated once more from the files that ship."""

import dataclasses
import itertools
import json
import math
import zlib
from collections.abc import Iterator
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

import wayfield
from wayfield import policies
from wayfield.benchmarks import parts
from wayfield.benchmarks.contest_options import ContestOptions, seed_of
from wayfield.benchmarks.contests import ALL_CONTESTS, CONTESTS, GAINS, PAPER, Contest, Course, Entrants
from wayfield.benchmarks.parts import described, in_frames
from wayfield.benchmarks.suite import Setting
from wayfield.envs.robots import ROBOTS
from wayfield.envs.scenarios import splits
from wayfield.policies.learned.ppo import shipped
from wayfield.policies.policy import check_gain, check_robot, lacks

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
        if name in ("ppo", "hybrid"):
            agents = HOME / "agents" / f"{contest.spec.name}_{robot}"
            for seed in sorted(int(folder.name[5:]) for folder in agents.glob("seed_*")):
                yield name, "trained", {"seed": seed}
            continue
        found = []
        if "tuned" in kinds or "best" in kinds:
            found.append(("tuned", tuned(contest, name, robot, pace, "none")))
        if "robust" in kinds:
            found.append(("robust", tuned(contest, name, robot, pace, "moderate")))
        better = [(kind, each["gains"]) for kind, each in found if each and each["chosen"] == "search"]
        stands_in = bool(found) and found[0][0] == "tuned" and "tuned" not in dict(better)
        if "default" in kinds or stands_in:
            yield name, "default", {}
        yield from ((name, kind, gains) for kind, gains in better)
        if "paper" in kinds and name in PAPER:
            yield name, "paper", dict(PAPER[name])


def cruising(name: str, gains: dict[str, Any], speed: float) -> dict[str, Any] | None:
    try:
        return policies.cruising(name, gains, speed)
    except policies.NoCruisingSpeed:
        return None


@pytest.mark.parametrize("name", ALL_CONTESTS)
@pytest.mark.parametrize("robot", ROBOTS_TRIED)
def test_every_case_is_a_policy_with_one_of_its_sets(name: str, robot: str) -> None:
    contest = ALL_CONTESTS[name]
    course = Course(contest.timed_on, "test", env_kwargs={"scale": 2.0})
    for kinds, speed in itertools.product((*GAINS.values(), ("default", "tuned", "robust")), (None, 0.9)):
        asked = contest.rules.speed if speed is None and contest.rules else speed
        wanted = []
        for policy, kind, gains in sets_of(contest, contest.policies, robot, kinds, asked):
            if asked is not None and kind not in ("tuned", "robust"):
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
    assert {name: contest.env_kwargs for name, contest in ALL_CONTESTS.items()} == {
        name: pytest.approx(told) for name, told in scanners.items()
    }
    # asked speed and that of the optimal time, where the clock starts and ends, whose way SPL compares with
    told = {
        **{"barn": (1.2, 2.0, 0.1, 100.0, False), "barn-p3dx": (0.6, 0.6, 0.1, 100.0, False)},
        **{"mrpb": (0.55, math.nan, 0.0, math.inf, False), "movingai": (0.6, math.nan, 0.0, math.inf, True)},
        "racetracks": (0.6, math.nan, 0.0, math.inf, False),
    }
    for name, contest in ALL_CONTESTS.items():
        assert (contest.rules is not None) == (name in told)
        if contest.rules is not None:
            assert dataclasses.astuple(contest.rules) == pytest.approx(told[name], nan_ok=True)


@pytest.mark.parametrize("name", PLAIN)
def test_a_failure_counts_as_the_clock_or_as_the_task_says(name: str) -> None:
    contest = CONTESTS[name]
    wanted = 1.0 if name == "path-following" else 35.0
    assert contest.failure_cost(700) == pytest.approx(wanted)
    assert ALL_CONTESTS["barn"].failure_cost(700) == pytest.approx(35.0)
    assert ALL_CONTESTS["barn"].failure_cost(10**6) == pytest.approx(100.0)


@pytest.mark.parametrize(
    ("card", "told"),
    [
        ({}, "2.0 M frames"),
        ({"taught_by": "lqr"}, "2.0 M frames, taught by lqr"),
        ({"base": "lqr"}, "2.0 M frames, adds to lqr"),
        ({"base": "lqr", "taught_by": "lqr"}, "2.0 M frames, adds to lqr"),  # as cards once were
    ],
)
def test_a_controller_that_an_agent_adds_to_is_told_as_no_teacher(
    monkeypatch: pytest.MonkeyPatch, card: dict[str, str], told: str
) -> None:
    training = {"steps": 2_000_000, **{name: card[name] for name in ("taught_by",) if name in card}}
    whole = {"training": training} | ({"base": {"controller": card["base"]}} if "base" in card else {})
    agent = SimpleNamespace(card=whole, knows="sensors", num_parameters=7)
    monkeypatch.setattr(parts, "load_agent", lambda _: agent)
    contest = CONTESTS["path-following"]
    case = next(contest.cases("p3dx", Course(contest.timed_on, "test"), Entrants(("ppo",), ("default",))))
    assert described(contest, case)["learned_from"] == told


def test_what_gains_were_found_from_is_told_in_frames() -> None:
    for name in PLAIN:
        contest = CONTESTS[name]
        course = Course(contest.timed_on, "test")
        for case in contest.cases("p3dx", course, Entrants(contest.policies, ("default", "tuned", "robust", "paper"))):
            found = described(contest, case)
            if case.gains_name == "trained":
                folder = HOME / "agents" / f"{contest.spec.name}_p3dx" / f"seed_{case.gains['seed']}"
                card = json.loads((folder / "card.json").read_text(encoding="utf-8"))
                training = card["training"]
                taught = f", taught by {training['taught_by']}" if "taught_by" in training else ""
                sizes = [card["network"]["hidden"], card["network"]["parameters"]]
                assert found["parameters"] == f"{sizes[1]:,}"
                assert found["learned_from"] == f"{training['steps'] / 1e6:.1f} M frames{taught}"
                assert (found["agent_seed"], found["knows"]) == (str(case.gains["seed"]), "sensors")
                continue
            assert found["agent_seed"] == ""
            assert found["knows"] == policies.make(case.policy).knows
            level = "moderate" if case.gains_name == "robust" else "none"
            told = tuned(contest, case.policy, "p3dx", 0.6, level)
            if case.gains_name == "paper":
                wanted = "0 frames, as published"
            elif case.gains_name == "default" and (told is None or told["chosen"] == "search"):
                wanted = "0 frames" + ", as Nav2 configures it" * case.policy.startswith("nav2")
            else:
                assert told is not None
                wanted = in_frames(told["frames"]) + ", best of them" * (case.gains_name == "default")
                wanted += ", on validation" * (told.get("searched_on", {}).get("split") == "validation")
            assert found["learned_from"] == wanted, case.policy
    assert [in_frames(count) for count in (0, 40, 99_999, 100_000, 1_260_000)] == [
        *("0 M frames", "4e-05 M frames", "0.1 M frames", "0.1 M frames", "1.3 M frames")
    ]


def options(suite: str, names: tuple[str, ...], **more: Any) -> ContestOptions:
    told: dict[str, Any] = {
        "policies": None, "dynamics": ("kinematic",), "actuators": "lagged", "robot": ROBOTS["p3dx"],
        "gains_names": GAINS["all"], "families": None, "episodes": None, "seed": 3,
    }  # fmt: skip
    return ContestOptions(suite, names, **{**told, **more})


@pytest.mark.parametrize(("episodes", "members"), [(None, (3, 1, 4)), (2, (3, 1)), (9, (3, 1, 4))])
def test_of_a_public_bank_the_first_of_its_members_are_driven(episodes: int | None, members: tuple[int, ...]) -> None:
    course = Course("worlds", "public", "/a/folder", 7, members=(3, 1, 4))
    found = options("barn", ("barn",), courses=(course,), episodes=episodes, policies=("vfh_plus",)).settings()
    assert found
    for each in found:
        assert (each.members, each.episodes, each.seed) == (members, len(members), first_seed(3, "public", "worlds"))
        assert (each.case.scenario, each.case.max_episode_steps) == ("/a/folder", 7)
    # a file of one's own is driven once, or as often as is asked for
    alone = dataclasses.replace(course, members=())
    for each in options("barn", ("barn",), courses=(alone,), episodes=episodes, policies=("vfh_plus",)).settings():
        assert (each.members, each.episodes) == ((), episodes or 1)


def test_a_row_tells_of_its_own_scenario_and_of_the_run_s_clock(monkeypatch: pytest.MonkeyPatch) -> None:
    contest = CONTESTS["goal-obstacles"]
    (case,) = contest.cases("p3dx", Course("clutter_10", "test"), Entrants(("zero",), ("default",)))
    bank = splits.split("goal_reaching", "clutter_10", "test")
    setting = Setting("it", case, "kinematic", "ideal", 0, len(bank) + 2)
    monkeypatch.setattr(parts, "episodes", lambda asked: [({"n": str(i)}, None) for i in range(asked.episodes)])
    rows = [row for row, _ in parts.played(setting)]
    assert [row["n"] for row in rows] == [str(i) for i in range(len(bank) + 2)]
    for row, member in zip(rows, [*bank, *bank[:2]], strict=True):
        assert (row["tier"], float(row["quantity"])) == (member.tier, member.quantity)
        assert (row["split"], float(row["failure_cost"]), row["knows"]) == ("test", 60.0, "sensors")
        assert "speed" not in row
        assert "scenario" not in row
    assert len({row["quantity"] for row in rows}) == len(bank)
    # of a public bank it tells the scenario's name, too; of the front the speed
    few = [SimpleNamespace(name=f"world {k}", tier="", quantity=float(k)) for k in (4, 9)]
    monkeypatch.setattr(parts, "members_of", lambda contest, setting: few)
    swept = dataclasses.replace(setting, case=dataclasses.replace(case, speed=0.45), episodes=2, members=(4, 9))
    told = [(row["scenario"], row["quantity"], row["split"], row["speed"]) for row, _ in parts.played(swept)]
    assert told == [("world 4", "4.0", "front", "0.45"), ("world 9", "9.0", "front", "0.45")]


def test_of_a_folder_of_agents_those_for_the_task_and_the_robot_take_part(tmp_path: Path) -> None:
    home = tmp_path / "mine"
    trained_for = [(each, robot) for each in CONTESTS.values() for robot in ROBOTS if shipped(each.spec.name, robot)]
    for seed, (contest, robot) in enumerate(trained_for):
        card = next(iter(shipped(contest.spec.name, robot).values())) / "card.json"
        (home / f"seed_{seed}" / "best").mkdir(parents=True)
        (home / f"seed_{seed}" / "best" / "card.json").write_bytes(card.read_bytes())
    (home / "seed_99").mkdir()  # has not come to an agent yet
    for seed, (contest, robot) in enumerate(trained_for):
        found = list(contest.own_sets(str(home), ROBOTS[robot]))
        assert found == [("mine", {"seed": seed, "home": str(home)})], (contest.name, robot)
        entrants = Entrants((), ("default",), (str(home),))
        (case,) = contest.cases(robot, Course("here", "own", "/a/file.json", 77), entrants)
        assert (case.policy, case.gains_name, case.gains["seed"]) == ("ppo", "mine", seed)
        # another sheet under the same name is another robot
        heavier = dataclasses.replace(ROBOTS[robot], mass=2.0 * ROBOTS[robot].mass)
        assert not list(contest.own_sets(str(home), heavier))
    with pytest.raises(ValueError, match="holds no trained agents"):
        list(CONTESTS["docking"].own_sets(str(home / "seed_0"), ROBOTS["p3dx"]))


@pytest.mark.parametrize("name", PLAIN)
def test_decisions_are_timed_once_an_entry_and_where_the_run_drives(name: str) -> None:
    contest = CONTESTS[name]
    own = (Course("mine", "own", "/a/file.json", 77), Course("other", "own", "/another/file.json", 88))
    for more, scenario in (
        ({}, f"{contest.timed_on}/test"),
        ({"split": "claims"}, f"{contest.timed_on}/claims"),
        ({"courses": own}, "/a/file.json"),
    ):
        cases = options(name, (name,), **more).timed()
        assert {case.scenario for case in cases} == {scenario}
        entries = [(case.policy, case.gains_name) for case in cases]
        driven = contest.cases("p3dx", Course(contest.timed_on, "test"), Entrants(contest.policies, GAINS["all"]))
        assert sorted(entries) == sorted({(case.policy, case.gains_name) for case in driven})


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
    found = options(name, (name,), dynamics=plants, episodes=few).settings()
    assert [told_of(each) for each in found] == wanted
    assert {(each.suite, each.actuators, each.keep, each.members) for each in found} == {(name, "lagged", 3, ())}


def test_the_overview_is_one_scenario_a_family_and_three_seeds() -> None:
    names = tuple(PLAIN)
    found = options("overview", names, gains_names=GAINS["best"]).settings()
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
    for asked, kinds in ((GAINS["all"], ("default", "tuned", "robust")), (("default",), ("default",))):
        wanted = []
        for family in (each for each in contest.families("kinematic") if each in more["families"]):
            for level in levels:
                for policy, kind, gains in sets_of(contest, ("vfh_plus", "ppo"), "p3dx", kinds, None):
                    told = gains.get("seed") if kind == "trained" else None
                    seed = first_seed(3, "test", family)
                    wanted.append((name, "kinematic", family, "test", None, level, policy, kind, told, 5, seed))
        found = options("disturbances", (name,), gains_names=asked, **more).settings()
        order = [policy for policy in contest.policies if policy in more["policies"]]
        assert sorted(map(str, map(told_of, found))) == sorted(map(str, wanted))
        assert list(dict.fromkeys(each.case.policy for each in found)) == order


def test_seeds_of_families_are_apart_and_fit_thirty_one_bits() -> None:
    for seed, split, family in itertools.product((0, 7), ("test", "claims"), ("rooms", "doors_narrow")):
        assert seed_of(seed, split, family) == first_seed(seed, split, family) < 2**31
    assert len({seed_of(*each) for each in itertools.product((0, 7), ("test", "claims"), ("a", "b"))}) == 8
    assert math.isfinite(seed_of(2**31 - 1, "test", ""))


@pytest.mark.parametrize(
    ("given", "value", "said"),
    [
        ({}, 1.5, ""), ({}, -3, ""), ({}, np.float32(2.0), ""), ({}, math.inf, "a finite number"),
        ({}, "1", "a finite number"), ({}, math.nan, "a finite number"), ({}, True, "a finite number"),
        ({}, 10**400, "a finite number"),
        ({"above": 0.0}, 0.0, "a finite number > 0"), ({"above": 0.0}, 1e-9, ""),
        ({"least": 0.0}, -1e-9, "a finite number >= 0"), ({"least": 0.0}, 0.0, ""),
        ({"least": 0.0, "most": 1.0}, 1.0, ""), ({"least": 0.0, "most": 1.0}, 1.01, "at most 1 in size"),
        ({"most": 2.0}, -2.01, "at most 2 in size"), ({"finite": False}, math.inf, ""),
        ({"finite": False, "above": 1.0}, math.inf, ""), ({"finite": False, "above": 1.0}, 1.0, "a number > 1"),
        ({"finite": False}, 10**400, "a number"), ({}, 1e300, "in size"),
    ],
)  # fmt: skip
def test_a_gain_outside_of_its_range_is_told_the_range(given: dict[str, Any], value: Any, said: str) -> None:
    holder = type("Law", (), {"k": value})()
    if not said:
        check_gain(holder, "k", **given)
        return
    with pytest.raises(ValueError, match="Law: k") as refused:
        check_gain(holder, "k", **given)
    assert said in str(refused.value)
    assert ("> " in said) == ("> " in str(refused.value))


def test_who_needs_what_a_robot_cannot_do_is_left_out() -> None:
    law = policies.make("waypoint")
    for robot in ROBOTS.values():
        assert lacks(law, robot) == [need for need in law.needs if not getattr(robot, need)]  # type: ignore[attr-defined]
        if not lacks(law, robot):
            check_robot(law, robot)
            continue
        able = ", ".join(name for name, each in ROBOTS.items() if each.holonomic)
        with pytest.raises(ValueError, match=rf"Waypoint drives holonomic robots only \({able}\), not '{robot.name}'"):
            check_robot(law, robot)
