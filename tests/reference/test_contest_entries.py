"""Entries, scenarios and seeds of a contest, from the files that ship."""

import itertools
import math
import zlib

import numpy as np

from wayfield.benchmarks.commands.contest_options import seed_of
from wayfield.benchmarks.contests import CROSS, Course, Entrants


def test_in_a_cross_play_every_two_policies_share_a_team_once_each_way() -> None:
    names = ("polar", "vfh_plus", "orca_team")
    cases = list(CROSS.cases("p3dx", Course("circle_8", "test"), Entrants(names, ("default", "paper"))))
    assert [(case.policy, case.beside) for case in cases] == list(itertools.permutations(names, 2))
    assert {case.gains_name for case in cases} == {f"beside {name}" for name in names}


def first_seed(seed: int, split: str, family: str) -> int:
    words = [seed, zlib.crc32(split.encode()), zlib.crc32(family.encode())]
    return int(np.random.SeedSequence(words).generate_state(1)[0]) // 2


def test_seeds_of_families_are_apart_and_fit_thirty_one_bits() -> None:
    for seed, split, family in itertools.product((0, 7), ("test", "claims"), ("rooms", "doors_narrow")):
        assert seed_of(seed, split, family) == first_seed(seed, split, family) < 2**31
    assert len({seed_of(*each) for each in itertools.product((0, 7), ("test", "claims"), ("a", "b"))}) == 8
    assert math.isfinite(seed_of(2**31 - 1, "test", ""))
