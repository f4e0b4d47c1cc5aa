"""Worlds of the BARN challenge's kind: what each has in common, and that they are like the published ones."""

import csv
from pathlib import Path

import numpy as np
import pytest

from wayfield.envs.scenarios import goal_scenarios, ways
from wayfield.envs.scenarios.barn import CELL
from wayfield.envs.scenarios.cellular import cellular_world

PUBLISHED = Path(__file__).parents[3] / "shared" / "data" / "barn" / "bottleneck_radius.csv"


def test_a_seed_decides_a_world_and_each_leaves_a_way() -> None:
    for seed in range(4):
        world = cellular_world(seed)
        assert world.obstacles.tobytes() == cellular_world(seed).obstacles.tobytes()
        places = np.stack([world.obstacles["x"], world.obstacles["y"]], axis=1)
        assert len(np.unique(places, axis=0)) == len(places)
        cells = (places - places.min(axis=0)) / CELL
        np.testing.assert_allclose(cells, np.rint(cells), atol=1e-4)
        np.testing.assert_array_equal(world.obstacles["radius"], CELL / 2.0)
        assert ways.clear_radius(world) >= 0.36 - 1e-9
    assert cellular_world(0).obstacles.tobytes() != cellular_world(1).obstacles.tobytes()


def test_a_hull_that_does_not_pass_is_refused() -> None:
    with pytest.raises(ValueError, match=r"hull_radius is 0\.37; 'cellular' leaves a way for at most 0\.36 m"):
        goal_scenarios("cellular", 0.37)


@pytest.mark.skipif(not PUBLISHED.is_file(), reason="BARN's published worlds are not here")
def test_they_are_as_full_and_as_narrow_as_the_published_worlds() -> None:
    """Quartiles of how many cylinders there are, of 24, and of how large a disc passes, of 12; of 60 published."""
    theirs = list(csv.DictReader(PUBLISHED.read_text(encoding="utf-8").splitlines()))
    worlds = [cellular_world(seed) for seed in range(24)]
    narrow = [ways.clear_radius(world) for world in worlds[:12]]
    for ours, column, tolerance in (
        ([len(world.obstacles) for world in worlds], "n_cylinders", 30.0),
        (narrow, "bottleneck_disc_radius_m", 0.1),
    ):
        quartiles = [np.percentile(each, (25, 50, 75)) for each in (ours, [float(row[column]) for row in theirs])]
        np.testing.assert_allclose(*quartiles, atol=tolerance)
