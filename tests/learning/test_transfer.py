"""Gains where they were chosen and where they were not: rooms, rows and the table."""

import math
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner
from transfer import TRANSFER, TUNED_FOR, main, transfer_table

from wayfield.benchmarks.records.results import read_rows
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
from wayfield.envs.scenarios import TASKS, scenarios_of


def test_a_room_has_a_way_for_every_hull_from_each_start_to_its_goal(tmp_path: Path) -> None:
    """By the planner's own search of the map, not by the clearance that the room was drawn with."""
    assert max(robot.hull_radius for robot in (*TUNED_FOR, *OTHER_HULLS["p3dx"])) <= WIDEST
    (course, *_) = write_rooms(tmp_path, 2, 3)
    for scenario in scenarios_of(TASKS["goal_reaching"], course.file, WIDEST):
        assert math.dist(scenario.start[:2], scenario.goal[:2]) >= LEAST_WAY - 1e-3
    assert len(course.members) == PAIRS


def test_rooms_of_the_search_the_choice_and_the_table_are_others(tmp_path: Path) -> None:
    """Of the seeds that they have by default; and nobody makes a table in those of the search."""
    seed = next(each.default for each in main.params if each.name == "seed")
    rooms = {split: searched_rooms(tmp_path, split, 3) for split in SEEDS}
    rooms["table"] = write_rooms(tmp_path / "table", 3, seed)
    worlds = [(Path(course.file) / "map.pgm").read_bytes() for courses in rooms.values() for course in courses]
    assert len(set(worlds)) == len(worlds) == 9
    assert len({digest(courses) for courses in rooms.values()}) == 3
    assert digest(searched_rooms(tmp_path / "again", "train", 3)) == digest(rooms["train"])
    for seed in SEEDS.values():
        refused = CliRunner().invoke(main, ["--seed", str(seed)])
        assert refused.exit_code == 2
        assert f"--seed {seed}: gains were chosen in the rooms of that seed" in refused.stderr


def test_rooms_are_of_their_seed() -> None:
    (occupied, ways), (again, same), (other, _) = (room(np.random.default_rng(seed)) for seed in (1, 1, 2))
    assert np.array_equal(occupied, again)
    assert ways == same
    assert occupied.shape != other.shape or not np.array_equal(occupied, other)


def test_what_was_not_tuned_is_refused_in_one_line() -> None:
    done = CliRunner().invoke(main, ["--policies", "mpc"])
    assert done.exit_code == 2
    assert "nothing was tuned for them in goal reaching" in done.output


@pytest.mark.slow
def test_the_command_writes_the_table_that_its_rows_make(tmp_path: Path) -> None:
    done = CliRunner().invoke(main, ["--policies", "astar_tracker", "--rooms", "1", "--out", str(tmp_path / "out")])
    assert done.exit_code == 0, done.output
    rows = read_rows(tmp_path / "out")
    command = "python benchmarks/studies/transfer.py --policies astar_tracker --rooms 1"
    assert (tmp_path / "out" / TRANSFER).read_text() == transfer_table(rows, command).csv()
    assert {row["success"] for row in rows} <= {0.0, 1.0}
