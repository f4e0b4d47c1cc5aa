"""Scenarios: what belongs together, what decides them, proofs that a way is there, curves."""

import copy
import itertools
import json
import math
from typing import Any

import numpy as np
import pytest
from scipy.integrate import quad

from wayfield.envs.robots.references import evaluate
from wayfield.envs.scenarios import GoalScenario, PathScenario, splits, tracing, ways
from wayfield.envs.scenarios.obstacles import box, circle, moving_circle, obstacle_field, wall
from wayfield.envs.scenarios.scenario import check_clear
from wayfield.envs.tasks.specs import TASKS
from wayfield.envs.world.grids import OccupancyGrid
from wayfield.envs.world.movers import PATROL
from wayfield.envs.world.paths import Path

LINE = Path([(0.0, 0.0), (1.0, 0.0), (2.0, 0.0)])
RING = Path([(0.0, 0.0), (1.0, 0.0), (1.0, 1.0)], closed=True)


def test_a_start_and_its_scatter_are_within_the_corridor() -> None:
    # 0.5 m before the first point and 0.75 m beside it; 0.25 m beside the middle
    slant = Path([(0.0, 0.0), (3.0, 4.0), (3.0, 9.0)])
    for path, start, away in (
        (LINE, (-0.5, 0.75, 9.0), math.hypot(0.5, 0.75)), (LINE, (1.25, -0.25, 0.0), 0.25),
        (LINE, (3.0, 0.0, 0.0), 1.0),
        (slant, (1.5 - 0.8, 2.0 + 0.6, 0.0), 1.0), (slant, (3.5, 7.0, 0.0), 0.5), (slant, (-3.0, -4.0, 0.0), 5.0),
    ):  # fmt: skip
        kept = PathScenario("mine", path, start=start, start_offset=0.125, corridor=away + 0.12501)
        assert kept.start is not None
        assert math.remainder(kept.start[2] - start[2], 2 * math.pi) == pytest.approx(0.0, abs=1e-12)
        with pytest.raises(ValueError, match=r"up to .* from the path"):
            PathScenario("mine", path, start=start, start_offset=0.125, corridor=away + 0.1249)
    larger = PathScenario("mine", LINE, start=(0.25, 0.5, 1.0), tier="easy", quantity=2.0, family="f").scaled(2.0)
    assert (larger.start, larger.path.length, larger.tier, larger.family) == ((0.5, 1.0, 1.0), 4.0, "", "f")
    assert math.isnan(larger.quantity)
    assert larger.corridor == 1.0


def test_a_reference_twice_as_large_is_twice_as_fast_at_the_same_times() -> None:
    (eight,) = TASKS["trajectory_tracking"].presets["eight_2m"]()
    times = np.linspace(0.0, eight.knots[-1, 0], 50)
    once, twice = (evaluate(each.knots, times) for each in (eight, eight.scaled(2.0)))
    factors = np.array([2.0, 2.0, 1.0])  # a place and its derivatives, a heading
    np.testing.assert_allclose(twice, factors[:, None, None] * once, atol=1e-12)


def test_patrols_belong_to_discs_that_begin_on_them() -> None:
    disc = moving_circle(1.0, 2.0, 0.3, 0.2, -0.1, 4.0, 5.0)
    # on the way back: 3 s from where it began
    assert (disc["x"], disc["y"]) == pytest.approx((1.0 + 3.0 * 0.2, 2.0 - 3.0 * 0.1))
    assert disc["patrol"].item() == (1.0, 2.0, 0.2, -0.1, 4.0, 5.0)

    def made(obstacle: Any = disc, **changes: float) -> GoalScenario:
        moving = obstacle.copy()
        moving["patrol"] = disc["patrol"]
        for name, value in changes.items():
            moving["patrol"][name] = value
        return GoalScenario("mine", (9.0, 0.0, 0.0), obstacles=obstacle_field(moving))

    assert made().moving.all()
    still = dict.fromkeys(("x", "y", "vx", "vy", "leg_time", "phase"), 0.0)
    assert not made(**still).moving.any()
    for name, value in (("vx", 1001.0), ("vy", -1001.0), ("leg_time", 9e-4), ("leg_time", -1.0), ("leg_time", 2e6),
                        ("phase", -1.0), ("phase", 2e6), ("x", math.nan), ("y", 2e6)):  # fmt: skip
        with pytest.raises(ValueError, match=rf"obstacles\[0\]\.patrol\.{name}"):
            made(**{name: value})
    made(x=1.0 + 9e-10)
    for name in ("x", "y"):
        with pytest.raises(ValueError, match="not where its patrol begins"):
            made(**{name: disc["patrol"][name] + 2e-9})
    for other in (circle(1.6, 1.7, 0.3, 1.0), box(1.6, 1.7, 0.3, 0.2), wall(1.6, 1.6, 1.6, 1.8)):
        with pytest.raises(ValueError, match="only a circle of mass 0 moves"):
            made(other)


def test_every_number_of_a_scenario_decides() -> None:
    disc = moving_circle(1.0, 2.0, 0.3, 0.2, -0.1, 4.0, 5.0)
    goal = GoalScenario(
        "mine", (9.0, 0.0, 0.1), (0.1, 0.2, 0.3), ((4.0, 1.0),),
        obstacle_field(disc, box(5.0, 5.0, 0.8, 0.4, 0.2, 2.0)), 0.1, 0.2, 0.3, 0.4, 0.5,
    )  # fmt: skip
    path = PathScenario("mine", RING, 2, (0.1, 0.0, 0.2), 0.1, 0.2, 0.9)
    for scenario, names in (
        (goal, ("goal", "start", "waypoints", "start_offset", "start_turn", "position_tolerance", "heading_tolerance",
                "waypoint_radius", "published_length")),
        (path, ("start", "start_offset", "start_turn", "corridor", "laps")),
    ):  # fmt: skip
        known = splits.canonical(scenario)
        assert splits.canonical(copy.copy(scenario)) == known
        for name in names:
            value = getattr(scenario, name)
            parts = np.ravel(np.array(value, float))
            for k in range(len(parts)):
                other = copy.copy(scenario)
                new: Any = parts.copy()
                new[k] = 3.0 if math.isnan(new[k]) else new[k] + 0.125
                new = np.reshape(new, np.shape(value)).tolist()
                object.__setattr__(other, name, new)
                assert splits.canonical(other) != known, name
    for name, j in itertools.product(PATROL.names or (), (0, 1)):
        other = copy.copy(goal)
        changed = goal.obstacles.copy()
        changed["patrol"][name][j] += 0.5
        object.__setattr__(other, "obstacles", changed)
        assert splits.canonical(other) != splits.canonical(goal), name
    for name in ("x", "y", "cos", "sin", "half_length", "half_width", "radius", "mass"):
        changed = goal.obstacles.copy()
        changed[name][1] += 0.125
        other = copy.copy(goal)
        object.__setattr__(other, "obstacles", changed)
        assert splits.canonical(other) != splits.canonical(goal), name


def test_a_hull_fits_at_both_ends_and_passes_the_waypoints() -> None:
    def asked(x: float, **settings: Any) -> None:
        stones = obstacle_field(circle(-50.0, 0.0, 1.0), circle(x, 0.0, 1.0))
        check_clear(GoalScenario("mine", (9.0, 0.0, 0.0), obstacles=stones, **settings), 0.5)

    asked(1.5)
    asked(7.5)
    with pytest.raises(ValueError, match=r"obstacles\[1\] .* is over the start"):
        asked(1.49)
    with pytest.raises(ValueError, match=r"obstacles\[1\] .* is over the goal"):
        asked(7.51)
    # a waypoint is passed within its radius, but not inside of anything
    asked(5.0, waypoints=((1.0, 5.0), (5.0, 1.21)), waypoint_radius=0.3)
    with pytest.raises(ValueError, match=r"is over the waypoints\[1\]"):
        asked(5.0, waypoints=((1.0, 5.0), (5.0, 1.19)), waypoint_radius=0.3)
    asked(5.0, waypoints=((5.0, 1.01),), waypoint_radius=2.0)
    with pytest.raises(ValueError, match=r"is over the waypoints\[0\]"):
        asked(5.0, waypoints=((5.0, 1.0),), waypoint_radius=2.0)
    with pytest.raises(ValueError, match="hull_radius"):
        check_clear(GoalScenario("mine", (9.0, 0.0, 0.0)), 0.0)


# Seeds that were passed over, because the largest robot cannot do what they make, beside the next that was taken.
GAPS = {"goal_reaching": ("validation", 2), "docking": ("train", 1)}


@pytest.mark.parametrize("task", GAPS)
def test_what_was_passed_over_cannot_be_done_and_what_was_taken_can(task: str) -> None:
    spec, (name, most) = TASKS[task], GAPS[task]
    frozen = json.loads(splits.file_of(task, name).read_text(encoding="utf-8"))["families"]
    tried = 0
    for family, of_family in frozen.items():
        seeds = of_family[name]["seeds"]
        passed = sorted(set(range(seeds[0], seeds[-1])) - set(seeds))
        if not passed or tried == most:
            continue
        tried += 1
        assert not spec.feasible(spec.families[family].make(passed[0])), family
        assert spec.feasible(spec.families[family].make(next(seed for seed in seeds if seed > passed[0]))), family
    assert tried == most


def test_a_way_on_a_map_is_as_long_as_it_is() -> None:
    room = np.zeros((40, 60), np.bool_)
    room[:30, 30] = True
    grid = OccupancyGrid(room, 0.1, (0.0, 0.0, 0.0))
    straight = GoalScenario("mine", (2.5, 1.0, 0.0), (0.5, 1.0, 0.0), grid=grid)
    assert ways.way_length(straight, 0.2) == pytest.approx(2.0, rel=0.02)
    # over the wall's end, round a quarter of a disc at either corner
    over = GoalScenario("mine", (5.0, 1.0, 0.0), (1.0, 1.0, 0.0), grid=grid)
    rise = math.hypot(2.0, 2.0)
    assert 2.0 * rise < ways.way_length(over, 0.2) < 2.0 * (rise + 0.5)
    assert ways.clear_radius(over) == pytest.approx(0.5, abs=0.03)
    assert ways.way_length(over, 0.55) == math.inf
    # straight on until the wall is a radius and a node and a half ahead, and from there over it
    stop, length = 3.0 - 0.2 - 1.5 * ways.STEP, 0.1
    for across in (3.0 - stop, 5.0 - 3.1):  # a tangent and an arc at either corner of its end
        away = math.hypot(across, 2.0)
        length += math.sqrt(away**2 - 0.2**2) + 0.2 * (math.atan2(2.0, across) + math.asin(0.2 / away))
    assert 4.0 * ways.detour(over, 0.2) == pytest.approx(stop - 1.0 + length, rel=0.02)
    assert ways.detour(straight, 0.2) == 1.0


# Curves.


def test_an_arc_has_the_curvature_that_is_asked_for() -> None:
    pieces = np.array([[1.5, 0.0, 1.2], [0.8, 1.2, -0.6], [0.3, -0.6, -0.6]])
    points = tracing.arc(pieces, 0.002)
    assert points.shape == (2, 1 + 750 + 400 + 150)

    def heading(s: float) -> float:
        turn = 0.0
        for length, first, last in pieces:
            part = min(max(s, 0.0), length)
            turn += first * part + 0.5 * (last - first) / length * part**2
            s -= length
        return float(turn)

    for s, k in ((0.7, 350), (1.5, 750), (2.0, 1000), (2.6, 1300)):
        wanted = [quad(lambda at, f=f: f(heading(at)), 0.0, s, limit=200)[0] for f in (math.cos, math.sin)]
        assert points[:, k] == pytest.approx(wanted, abs=2e-6)
    along = tracing.lengths(points)
    assert along[0] == 0.0
    assert along[-1] == pytest.approx(2.6, abs=1e-5)
