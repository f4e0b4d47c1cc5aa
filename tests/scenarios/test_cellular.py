"""Worlds of the BARN challenge's kind: what each has in common, and that they are like the published ones."""

from pathlib import Path

import numpy as np
import pytest

from wayfield.envs.scenarios import goal_scenarios, ways
from wayfield.envs.scenarios.barn import CELL, barn_scenarios
from wayfield.envs.scenarios.cellular import cellular_world
from wayfield.envs.scenarios.scenario import GoalScenario

PUBLISHED = Path(__file__).parents[3] / "shared" / "data" / "barn"


def test_a_seed_decides_a_world_and_each_leaves_a_way() -> None:
    for seed in range(12):
        world = cellular_world(seed)
        again = cellular_world(seed)
        assert world.obstacles.tobytes() == again.obstacles.tobytes()
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


@pytest.mark.skipif(not PUBLISHED.is_dir(), reason="BARN's published worlds are not here")
def test_they_are_as_full_and_as_narrow_as_the_published_worlds() -> None:
    """Quartiles of how many cylinders there are and of how large a disc passes, of 60 worlds each."""
    ours, theirs = [_sizes(cellular_world(seed)) for seed in range(60)], list(map(_sizes, barn_scenarios(PUBLISHED)))
    for column, tolerance in ((0, 30.0), (1, 0.1)):
        quartiles = [np.percentile(np.array(each)[:, column], (25, 50, 75)) for each in (ours, theirs)]
        np.testing.assert_allclose(*quartiles, atol=tolerance)


def _sizes(world: GoalScenario) -> tuple[int, float]:
    return len(world.obstacles), ways.clear_radius(world)
