"""Entries, scenarios and seeds of a contest, from the files that ship."""

import dataclasses
import itertools
import math
import zlib

import numpy as np
import pytest

from wayfield.benchmarks.commands.contest_options import seed_of
from wayfield.benchmarks.contests import ALL_CONTESTS, CROSS, Course, Entrants
from wayfield.envs.tasks.specs import CROWDS


def test_in_a_cross_play_every_two_policies_share_a_team_once_each_way() -> None:
    names = ("polar", "vfh_plus", "orca_team")
    cases = list(CROSS.cases("p3dx", Course("circle_8", "test"), Entrants(names, ("default", "paper"))))
    assert [(case.policy, case.beside) for case in cases] == list(itertools.permutations(names, 2))
    assert {case.gains_name for case in cases} == {f"beside {name}" for name in names}


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


def first_seed(seed: int, split: str, family: str) -> int:
    words = [seed, zlib.crc32(split.encode()), zlib.crc32(family.encode())]
    return int(np.random.SeedSequence(words).generate_state(1)[0]) // 2


def test_seeds_of_families_are_apart_and_fit_thirty_one_bits() -> None:
    for seed, split, family in itertools.product((0, 7), ("test", "claims"), ("rooms", "doors_narrow")):
        assert seed_of(seed, split, family) == first_seed(seed, split, family) < 2**31
    assert len({seed_of(*each) for each in itertools.product((0, 7), ("test", "claims"), ("a", "b"))}) == 8
    assert math.isfinite(seed_of(2**31 - 1, "test", ""))
