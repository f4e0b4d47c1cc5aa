"""Rooms that gains are searched and chosen in: each has a way, and none is in two splits."""

import math
from pathlib import Path

import numpy as np

from wayfield.benchmarks.tuning.random_scenes import (
    LEAST_WAY,
    OTHER_HULLS,
    PAIRS,
    SEEDS,
    WIDEST,
    digest,
    room,
    searched_rooms,
    write_rooms,
)
from wayfield.envs.robots import ROBOTS
from wayfield.envs.scenarios import TASKS, scenarios_of


def test_a_room_has_a_way_for_every_hull_from_each_start_to_its_goal(tmp_path: Path) -> None:
    """By the planner's own search of the map, not by the clearance that the room was drawn with."""
    assert max(robot.hull_radius for robot in (ROBOTS["p3dx"], *OTHER_HULLS["p3dx"])) <= WIDEST
    (course, *_) = write_rooms(tmp_path, 2, 3)
    for scenario in scenarios_of(TASKS["goal_reaching"], course.file, WIDEST):
        assert math.dist(scenario.start[:2], scenario.goal[:2]) >= LEAST_WAY - 1e-3
    assert len(course.members) == PAIRS


def test_rooms_of_the_search_and_of_the_choice_are_others(tmp_path: Path) -> None:
    rooms = {split: searched_rooms(tmp_path, split, 3) for split in SEEDS}
    worlds = [(Path(course.file) / "map.pgm").read_bytes() for courses in rooms.values() for course in courses]
    assert len(set(worlds)) == len(worlds) == 3 * len(SEEDS)
    assert len({digest(courses) for courses in rooms.values()}) == len(SEEDS)
    assert digest(searched_rooms(tmp_path / "again", "train", 3)) == digest(rooms["train"])


def test_rooms_are_of_their_seed() -> None:
    (occupied, ways), (again, same), (other, _) = (room(np.random.default_rng(seed)) for seed in (1, 1, 2))
    assert np.array_equal(occupied, again)
    assert ways == same
    assert occupied.shape != other.shape or not np.array_equal(occupied, other)
