"""Hull classes: the frozen scenes for hulls above 0.3 m."""

import dataclasses
from pathlib import Path

import gymnasium
import numpy as np
import pytest
from click.testing import CliRunner

from wayfield.benchmarks.commands.evaluate import main
from wayfield.benchmarks.contests import CONTESTS, Entrants
from wayfield.benchmarks.figures import video
from wayfield.benchmarks.runs.suite import Setting, episodes
from wayfield.envs.robots import ROBOTS
from wayfield.envs.scenarios import TASKS, field_scenarios, split
from wayfield.envs.scenarios.splits import digest

# (goals, docks as they were frozen, docks) of all/test, by class: docks without a way for the hull are other ones
PINNED = {
    "0.35": ("0ad6f7a5b0ae2a4a", "35f4eb3700eba45c", "35f4eb3700eba45c"),
    "0.50": ("29d86c053db06478", "a01112fc161a39c9", "b116d44b42daf93b"),
    "0.70": ("b5d2fb1e202eda8a", "e2c3fada02ae76e4", "3dc0cd9dfd6990cf"),
}
# the widths of ways that were nearest to the hull, and what moves
TIGHT = ("near_goal", "doors_narrow", "corridors", "moving_head_on")


@pytest.mark.parametrize("name", PINNED)
def test_a_class_is_pinned_and_proven_for_its_hull(name: str) -> None:
    goals, docks = (TASKS[task] for task in ("goal_reaching", "docking"))
    hull = float(name)
    large, proven = (split(spec.name, "all", f"test@{name}") for spec in (goals, docks))
    moved = [each.of_class(hull) for each in split("docking", "all", "test")]
    assert tuple(digest(each)[:16] for each in (large, moved, proven)) == PINNED[name]
    assert all(docks.feasible(each, hull) for each in proven)
    for family in TIGHT:
        assert all(goals.feasible(each, hull) for each in split("goal_reaching", family, f"test@{name}")[::4])


def test_movers_keep_their_speed_and_docks_their_gaps() -> None:
    frozen, larger = (split("goal_reaching", "moving_crowd", name)[0] for name in ("test", "test@0.60"))
    for name, factor in {"vx": 1.0, "vy": 1.0, "x": 2.0, "leg_time": 2.0, "phase": 2.0}.items():
        np.testing.assert_allclose(
            larger.obstacles["patrol"][name], factor * frozen.obstacles["patrol"][name], rtol=1e-12
        )
    assert larger.position_tolerance == frozen.position_tolerance
    for a, b in zip(split("docking", "berth", "test"), split("docking", "berth", "test@0.60"), strict=True):
        moved = np.hypot(b.obstacles["x"] - a.obstacles["x"], b.obstacles["y"] - a.obstacles["y"])
        np.testing.assert_allclose(moved, 0.3 * np.hypot(*a.closing.T), atol=1e-9)


@pytest.mark.parametrize(
    ("task", "name", "hull", "message"),
    [
        ("goal_reaching", "all/test@0.30", 0.3, "must be @0.35 to @1.00.*all/test$"),
        ("goal_reaching", "all/test@abc", 0.4, "must be @0.35 to @1.00"),
        ("docking", "all/test@11", 0.4, "must be @0.35 to @1.00"),
        ("goal_reaching", "all/test@nan", 0.4, "must be @0.35 to @1.00"),
        ("goal_reaching", "all/test@0.3_5", 0.35, "must be @0.35 to @1.00"),
        ("goal_reaching", "all/test", 0.43, "its hull class is 'all/test@0.45'$"),
        ("goal_reaching", "rooms@0.45", 0.46, "its hull class is 'rooms/train@0.50'$"),
        ("goal_reaching", "push_boxes/test@0.45", 0.45, "has no hull class '@0.45': .* at most 0.3 m"),
        ("goal_reaching", "push_boxes/test", 0.45, "of at most 0.3 m$"),
        ("teams", "all/test@0.45", 0.45, "has no hull class"),
    ],
)
def test_what_is_no_class_is_refused_in_a_line(task: str, name: str, hull: float, message: str) -> None:
    with pytest.raises(ValueError, match=message) as refused:
        field_scenarios(TASKS[task], name, hull) if task in TASKS else split(task, *name.split("/"))
    assert "\n" not in str(refused.value)


def test_robots_of_a_class_drive_the_same_scenes_and_small_ones_may() -> None:
    same = [field_scenarios(TASKS["goal_reaching"], "rooms/test@0.45", hull) for hull in (0.43, 0.45)]
    assert digest(same[0]) == digest(same[1])
    env = gymnasium.make(
        "wayfield/DiffDriveGoalObstacles-v0", robot=ROBOTS["p3dx"], scenario="rooms/test@0.45", num_beams=8
    )
    env.reset(seed=1)


def test_the_planner_finds_doors_that_lie_as_much_farther_as_its_hull_is_larger(tmp_path: Path) -> None:
    """Rendered as a user would: the class brings the scan and the clock along, and the law its grid."""
    options = ["--policy", "scan_planner", "--scenario", "doors_narrow/train@0.60", "--index", "1"]
    told = CliRunner().invoke(
        video.main, [*options, "--robot", "mir100", "--out", str(tmp_path / "way.png"), "--size", "100"]
    )
    assert "success" in told.output, told.output


@pytest.mark.filterwarnings("ignore::wayfield.policies.learned.conditions.NewToAgent")
@pytest.mark.parametrize("policy", ["scan_planner", "any_robot"])
def test_discs_that_fill_the_narrowest_doors_seldom_touch_their_posts(policy: str) -> None:
    contest, base, scenes = CONTESTS["goal-obstacles"], ROBOTS["mir100"], tuple(range(20))
    touched = []
    for drawn in np.random.default_rng(0).uniform(0.35, 0.7, 3):
        hull = np.ceil(20.0 * drawn) / 20.0  # a whole class
        robot = dataclasses.replace(base, name="drawn", hull_box=None, hull_x=0.0, hull_radius=float(hull))
        course = dataclasses.replace(contest.course("doors_narrow", "train", robot), members=scenes)
        case = next(contest.cases(robot, course, Entrants((policy,), ("default",))))
        how = Setting("drawn", case, "kinematic", "lagged", 0, len(scenes), members=scenes)
        touched += [row["collision"] for row, _ in episodes(how)]
    # they are of 16 families of static obstacles, and in the 15 others there is room: 0.3 % of all those scenes
    assert np.mean(touched) <= 0.05


@pytest.mark.parametrize("suite", ["teams", "people", "crowdnav"])
def test_crowds_are_refused_to_a_hull_that_they_have_no_class_for(tmp_path: Path, suite: str) -> None:
    out = tmp_path / "run"
    refused = CliRunner().invoke(main, ["--suite", suite, "--robot", "mir100", "--episodes", "1", "--out", str(out)])
    assert refused.exit_code == 2
    assert "has a hull of 0.569 m; the frozen scenarios of" in refused.output
    assert not out.exists()
