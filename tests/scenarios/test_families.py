"""The families of scenarios and their frozen splits: what they promise, checked without the searches that made them."""

import json
import math
import pathlib
import re
import shutil
import warnings

import numpy as np
import pytest
from numpy.typing import NDArray
from oracles.surfaces import clearances
from scipy import ndimage, sparse
from scipy.sparse import csgraph

from wayfield.envs.scenarios import (
    FAMILIES,
    GOAL_SCENARIOS,
    PATH_SCENARIOS,
    SPLITS,
    TASKS,
    TIERS,
    GoalScenario,
    PathScenario,
    circle,
    goal_scenarios,
    moving_circle,
    obstacle_field,
    path_scenarios,
    scenarios_of,
    split,
    splits,
    wall,
    ways,
)
from wayfield.envs.scenarios.files import field_scenario_from_file
from wayfield.envs.world.movers import motion_at
from wayfield.system.objects import FileNote

HULL = 0.3  # m, omni3's: the largest robot
GOALS = FAMILIES["goal_reaching"]
PATHS = FAMILIES["path_following"]
EVERY = [(task, family) for task, families in FAMILIES.items() for family in families]
MOVING = [name for name, family in GOALS.items() if family.moving]
Points = NDArray[np.float64]


def standing(scenario: GoalScenario) -> NDArray[np.void]:
    return scenario.obstacles[~scenario.moving]


def corners(obstacle: np.void) -> Points:
    u = np.array([obstacle["cos"], obstacle["sin"]]) * (obstacle["half_length"] + obstacle["radius"])
    v = np.array([-obstacle["sin"], obstacle["cos"]]) * (obstacle["half_width"] + obstacle["radius"])
    centre = np.array([obstacle["x"], obstacle["y"]])
    return np.array([centre + u + v, centre + u - v, centre - u - v, centre + v - u])


def axes(scenario: GoalScenario, obstacles: NDArray[np.void], spacing: float) -> list[Points]:
    """Returns the x and the y of nodes around all of a scenario, whole multiples of the spacing."""
    ends = np.array([scenario.start[:2], scenario.goal[:2]])
    shape = np.vstack([ends, *(corners(o) for o in obstacles)])
    low, high = np.floor((shape.min(axis=0) - 1.2) / spacing), np.ceil((shape.max(axis=0) + 1.2) / spacing)
    return [np.arange(a, b + 1) * spacing for a, b in zip(low, high, strict=True)]


def joined(scenario: GoalScenario, obstacles: NDArray[np.void], radius: float, spacing: float) -> bool:
    """Returns whether a disc gets from start to goal between nodes that it fits on."""
    x, y = axes(scenario, obstacles, spacing)
    free = np.ones((len(x), len(y)), np.bool_)
    for o in obstacles:  # only the nodes about it
        (left, below), (right, above) = corners(o).min(axis=0) - radius, corners(o).max(axis=0) + radius
        i, j = np.flatnonzero((x >= left) & (x <= right)), np.flatnonzero((y >= below) & (y <= above))
        nodes = np.stack(np.meshgrid(x[i], y[j], indexing="ij"), axis=-1).reshape(-1, 2)
        free[np.ix_(i, j)] &= (clearances(obstacle_field(o), nodes) >= radius).reshape(len(i), len(j))
    regions, _ = ndimage.label(free)
    first, last = (regions[np.abs(x - end[0]).argmin(), np.abs(y - end[1]).argmin()]
                   for end in (scenario.start, scenario.goal))  # fmt: skip
    return bool(first == last != 0)


# ---- splits


def test_there_are_many_test_scenarios_a_task() -> None:
    for task, families in FAMILIES.items():
        count = sum(len(split(task, family, "test")) for family in families)
        assert count == SPLITS["test"] * len(families) >= 50
        assert not set(families) & {*GOAL_SCENARIOS, *PATH_SCENARIOS}


@pytest.mark.parametrize(("task", "family"), EVERY)
def test_splits_are_what_was_frozen_and_share_nothing(task: str, family: str) -> None:
    files = dict.fromkeys(splits.file_of(task, name) for name in SPLITS)
    frozen = {name: split for file in files for name, split in json.loads(file.read_text())["families"][family].items()}
    assert list(frozen) == list(SPLITS)
    seen: set[bytes] = set()
    seeds: list[int] = []
    for name, count in SPLITS.items():
        scenarios = split(task, family, name)
        assert len(scenarios) == count
        # those of the digest; made again from their seeds
        again = [FAMILIES[task][family].make(seed) for seed in frozen[name]["seeds"][:4]]
        assert [splits.canonical(s) for s in again] == [splits.canonical(s) for s in scenarios[:4]]
        assert splits.digest(scenarios) == frozen[name]["sha256"]
        assert [s.name for s in scenarios] == [f"{family}_{seed}" for seed in frozen[name]["seeds"]]
        assert [s.tier for s in scenarios] == frozen[name]["tiers"]
        assert {s.family for s in scenarios} == {family}
        seeds += frozen[name]["seeds"]
        seen |= {splits.canonical(s) for s in scenarios}
    assert len(seen) == len(set(seeds)) == sum(SPLITS.values())


@pytest.mark.parametrize("task", FAMILIES)
def test_tiers_follow_their_thresholds_and_all_occur(task: str) -> None:
    scenarios = [s for family in FAMILIES[task] for s in split(task, family, "test")]
    for s in scenarios:
        first, second = TASKS[task].tier_bounds
        rising = first < second
        expected = [s.quantity < bound if rising else s.quantity > bound for bound in (first, second)]
        assert s.tier == ("easy" if expected[0] else "medium" if expected[1] else "hard")
    assert {s.tier for s in scenarios} == set(TIERS)


@pytest.mark.parametrize(("task", "family"), EVERY)
def test_quantities_are_reproduced(task: str, family: str) -> None:
    for s in split(task, family, "test")[:2]:
        assert TASKS[task].quantity(s) == pytest.approx(s.quantity, abs=2e-6)


@pytest.mark.parametrize(
    ("damage", "message"),
    [
        (lambda text: text[: len(text) // 2], "damaged: JSONDecodeError"),
        (lambda text: re.sub(r'("doors_wide".*?"test".*?"seeds": \[)\d+', r"\g<1>1.5", text, flags=re.S), "damaged"),
        (lambda text: re.sub(r'("doors_wide".*?"test".*?"seeds": \[)\d+', r"\g<1>77", text, flags=re.S), "SHA-256"),
        (lambda text: re.sub(r'("doors_wide".*?"test".*?"sha256": ")\w', r"\g<1>x", text, flags=re.S), "SHA-256"),
    ],
)
def test_damaged_splits_are_refused(
    tmp_path: pathlib.Path, monkeypatch: pytest.MonkeyPatch, damage: object, message: str
) -> None:
    for file in splits.FOLDER.glob("*.json"):
        shutil.copy(file, tmp_path)
    file = tmp_path / "goal_reaching.json"
    text = file.read_text()
    file.write_text(damage(text))  # type: ignore[operator]
    assert file.read_text() != text
    splits.members("goal_reaching")  # which families there are is read once
    monkeypatch.setattr(splits, "FOLDER", tmp_path)
    with pytest.raises(ValueError, match=message) as caught:
        goal_scenarios("doors_wide/test", HULL)
    for part in (str(file), "'doors_wide'", "'test'"):
        assert part in str(caught.value)
    assert "\n" not in str(caught.value)


def test_missing_split_files_are_named(tmp_path: pathlib.Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(splits, "FOLDER", tmp_path)
    with pytest.raises(ValueError, match=r"path_following\.json: family 'circles', split 'train': .*FileNotFound"):
        path_scenarios("circles")


# ---- names


@pytest.mark.parametrize(
    ("name", "message"),
    [
        (
            "clutter_10/tests",
            "'clutter_10' has no split 'tests'; the splits are train, validation, test, claims. Did you mean",
        ),
        ("cluter_10", "unknown goal scenario 'cluter_10'. Did you mean 'clutter_10'?"),
        ("splines", "unknown goal scenario 'splines'."),
    ],
)
def test_unknown_splits_are_answered_with_the_nearest(name: str, message: str) -> None:
    with pytest.raises(ValueError, match=re.escape(message)):
        goal_scenarios(name, HULL)


def test_unknown_arguments_of_split() -> None:
    with pytest.raises(ValueError, match="task is 'goals'"):
        split("goals", "rooms", "test")
    with pytest.raises(ValueError, match=r"family is 'room'.*Did you mean 'rooms'"):
        split("goal_reaching", "room", "test")
    with pytest.raises(ValueError, match=r"split is 'tset'.*Did you mean 'test'"):
        split("goal_reaching", "rooms", "tset")


def test_larger_hulls_are_refused() -> None:
    with pytest.raises(ValueError, match=r"hull_radius is 0\.31; 'rooms/test' was searched .* at most 0\.3 m"):
        goal_scenarios("rooms/test", 0.31)


# ---- paths


def turns(path: PathScenario) -> tuple[Points, Points]:
    """Returns the turn (rad) at each inner point and the step (m) before it."""
    points = path.path.points
    points = np.vstack([points, points[:2]]) if path.path.closed else points
    a, b = np.diff(points, axis=0)[:-1], np.diff(points, axis=0)[1:]
    return np.arctan2(a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0], (a * b).sum(axis=1)), np.hypot(*a.T)


@pytest.mark.parametrize("family", PATHS)
def test_paths_have_what_all_share(family: str) -> None:
    for name in SPLITS:
        for s in split("path_following", family, name):
            points = s.path.points
            ring = np.vstack([points, points[:1]]) if s.path.closed else points
            steps = np.hypot(*np.diff(ring, axis=0).T)
            assert np.abs(steps / 0.02 - 1.0).max() <= 0.03
            assert np.abs(points - np.rint(points * 1e6) / 1e6).max() <= 1e-12
            assert TASKS["path_following"].feasible(s)
            assert s.path.length <= 20.0
            assert (s.laps, s.corridor, s.start_offset, s.start_turn) == (1, 1.0, 0.0, 0.0)
            assert s.start is not None
            x, y, heading = s.path.start_pose
            beside = np.array(s.start[:2]) - [x, y]
            most, turn = (0.5, 0.8) if family == "straights" else (0.1, 0.3)
            assert abs(beside @ [math.cos(heading), math.sin(heading)]) < 2e-6
            assert np.hypot(*beside) <= most + 1e-5
            assert abs(math.remainder(s.start[2] - heading, math.tau)) <= turn + 1e-5


BENDS = {  # 1/m, the range of the largest curvature
    "straights": (0.0, 0.0),
    "circles": (1.0 / 3.0, 1.0 / 0.8),
    "clothoids": (0.6, 2.2),
    "s_curves_wide": (0.3, 1.0),
    "s_curves_medium": (1.0, 2.5),
    "s_curves_tight": (2.5, 4.5),
    "figure_eights_gerono": (1.0, 4.0),
    "figure_eights_tangent": (1.0 / 1.5, 1.0 / 0.6),
    "splines": (0.0, 2.0),
    "circuits": (0.3, 2.0),
}


@pytest.mark.parametrize("family", BENDS)
def test_curvature_bounds(family: str) -> None:
    low, high = BENDS[family]
    for s in split("path_following", family, "train"):
        turn, step = turns(s)
        # an angle between two steps of whole micrometres is off by 1e-4 at most
        assert low - 0.015 <= (np.abs(turn) / step).max() <= high + 0.015
        assert s.quantity <= high + 0.015


def test_the_curvature_of_clothoids_never_jumps() -> None:
    for s in split("path_following", "clothoids", "train"):
        turn, step = turns(s)
        # the steepest ramp: 2.2 1/m over 0.3 of the way that 40 degrees take at it
        assert np.abs(np.diff(turn / step)).max() < 0.02 * 2.2**2 / (0.3 * math.radians(40.0)) + 0.03
    worst = max(
        np.abs(np.diff(turns(s)[0])).max() / 0.02 for s in split("path_following", "figure_eights_tangent", "train")
    )
    assert worst > 1.0  # where that of two circles does


def test_circles_are_circles_and_circuits_do_not_cross_themselves() -> None:
    for s in split("path_following", "circles", "test"):
        centre = s.path.points.mean(axis=0)
        assert np.ptp(np.hypot(*(s.path.points - centre).T)) < 1e-4
    for s in split("path_following", "circuits", "test"):
        some = s.path.points[::5]
        gap = np.linalg.norm(some[:, None] - some, axis=2)
        i, j = np.indices(gap.shape)
        apart = np.minimum(abs(i - j), len(some) - abs(i - j)) > 10
        assert gap[apart].min() > 0.1
        turn, _ = turns(s)
        assert abs(turn.sum()) == pytest.approx(math.tau, abs=1e-3)


# ---- goals


@pytest.mark.parametrize("family", GOALS)
def test_goals_have_what_all_share(family: str) -> None:
    for name in ("test", "claims"):
        for s in split("goal_reaching", family, name):
            ends = np.array([s.start[:2], s.goal[:2]])
            room = clearances(s.obstacles, ends) - HULL
            assert room[0] >= 0.1
            assert room[1] >= (0.05 if family == "near_goal" else 0.1)
            assert 2.0 <= math.dist(*ends) <= 12.0
            assert (s.position_tolerance, s.heading_tolerance) == (0.2, math.pi)
            assert (s.start_offset, s.start_turn, s.waypoints) == (0.0, 0.0, ())
            assert (family == "push_boxes") == bool((s.obstacles["mass"] > 0.0).any())


@pytest.mark.parametrize("family", GOALS)
def test_another_search_finds_a_way_for_the_largest_robot(family: str) -> None:
    # a door of 0.65 m has nodes at most 0.0125 m off its middle
    for s in split("goal_reaching", family, "test"):
        assert joined(s, standing(s), HULL, 0.025)


def test_clear_radius_is_that_of_the_widest_way() -> None:
    """The maximin over the nodes of a maximum spanning tree, whose bottleneck is that of the widest way."""
    for family in ("clutter_10", "rooms", "doors_medium", "near_goal"):
        for s in split("goal_reaching", family, "test")[:1]:
            x, y = axes(s, s.obstacles, 0.05)
            nx, ny = len(x), len(y)
            nodes = np.stack(np.meshgrid(x, y, indexing="ij"), axis=-1).reshape(-1, 2)
            clear = clearances(s.obstacles, nodes).reshape(nx, ny)
            index = np.arange(nx * ny, dtype=np.int32).reshape(nx, ny)
            a = np.concatenate([index[1:].ravel(), index[:, 1:].ravel()])
            b = np.concatenate([index[:-1].ravel(), index[:, :-1].ravel()])
            width = np.minimum(clear.ravel()[a], clear.ravel()[b])
            tree = csgraph.minimum_spanning_tree(sparse.coo_array((100.0 - width, (a, b)), (nx * ny, nx * ny)).tocsr())
            at = [int(np.linalg.norm(nodes - end[:2], axis=1).argmin()) for end in (s.start, s.goal)]
            _, before = csgraph.breadth_first_order(tree, at[0], directed=False)
            way = [at[1]]
            while way[-1] != at[0]:
                way.append(before[way[-1]])
            widest = min(1.0, float(clear.ravel()[way].min()))
            assert ways.clear_radius(s) == pytest.approx(widest, abs=0.05)
            assert ways.clear_radius(s) >= HULL


def test_searches_on_courses_with_known_ways() -> None:
    goal = (4.0, 0.0, 0.0)
    free = GoalScenario("free", goal)
    assert (ways.clear_radius(free), ways.detour(free, HULL)) == (1.0, 1.0)
    assert ways.way_length(free, HULL) == pytest.approx(4.0, rel=0.01)
    hall = [wall(-1, -2, 5, -2), wall(5, -2, 5, 2), wall(5, 2, -1, 2), wall(-1, 2, -1, -2)]
    door = GoalScenario("door", goal, obstacles=obstacle_field(*hall, wall(2, 0.4, 2, 2), wall(2, -0.4, 2, -2)))
    assert 0.385 <= ways.clear_radius(door) <= 0.4
    shut = GoalScenario("shut", goal, obstacles=obstacle_field(*hall, wall(2, 2, 2, -2)))
    assert ways.clear_radius(shut) <= 0.0
    assert ways.way_length(shut, HULL) == math.inf
    # round a disc: two tangents and the arc between, of the disc grown by the hull
    disc = GoalScenario("disc", goal, obstacles=obstacle_field(circle(2.0, 0.0, 0.7)))
    tangent = math.sqrt(2.0**2 - 1.0)
    assert ways.way_length(disc, HULL) == pytest.approx(2 * tangent + math.pi - 2 * math.acos(0.5), rel=0.02)
    # straight on to the disc and half round it
    assert ways.detour(disc, HULL) == pytest.approx((1.0 + math.pi - math.acos(0.5) + tangent) / 4.0, rel=0.03)
    obstacle = moving_circle(2.0, -2.0, 0.2, 0.0, 0.5, 8.0, 3.0)
    patrolled = GoalScenario("patrolled", goal, obstacles=obstacle_field(obstacle))
    assert ways.clear_radius(patrolled) == 1.0
    assert ways.taken_up(patrolled, True)["half_length"] == pytest.approx([2.0])
    across = np.array([[2.0, y] for y in np.linspace(-2.0, 2.0, 50)])
    assert (clearances(ways.taken_up(patrolled, True), across) == 0.0).all()


@pytest.mark.parametrize(("family", "width"), [("doors_narrow", 0.65), ("doors_medium", 0.8), ("doors_wide", 1.0)])
def test_doors_are_the_only_way(family: str, width: float) -> None:
    for s in split("goal_reaching", family, "test"):
        *border, first, second = s.obstacles
        ends = [np.array([o["x"], o["y"]]) + sign * o["half_length"] * np.array([o["cos"], o["sin"]])
                for o in (first, second) for sign in (-1.0, 1.0)]  # fmt: skip
        inner = sorted(ends, key=lambda end: float(np.abs(end).max()))
        assert math.dist(inner[0], inner[1]) == pytest.approx(width, abs=2e-6)
        for end in inner[2:]:  # on the border
            assert np.abs(end).max() == pytest.approx(5.0, abs=1e-9)
        assert not joined(s, obstacle_field(*s.obstacles, wall(*inner[0], *inner[1])), 0.03, 0.05)
        assert joined(s, obstacle_field(*border), 0.03, 0.05)


@pytest.mark.parametrize(("family", "depth"), [("u_traps_05", 0.5), ("u_traps_15", 1.5), ("u_traps_30", 3.0)])
def test_u_traps_trap_the_straight_way(family: str, depth: float) -> None:
    for name in ("test", "claims"):
        for s in split("goal_reaching", family, name):
            way = np.linspace(s.start[:2], s.goal[:2], 3000)
            arms, bottom = s.obstacles[[0, 2]], s.obstacles[1:2]
            assert 2.0 * arms["half_length"] == pytest.approx(depth, abs=3e-6)
            blocked = int((clearances(s.obstacles, way) < HULL).argmax())
            assert blocked > 0
            # by the bottom, when the robot is between the arms already: a trap of less than a hull it is not
            assert clearances(bottom, way[blocked : blocked + 1])[0] < HULL
            assert clearances(bottom, way).min() < 1e-2
            out = depth - clearances(bottom, way[blocked : blocked + 1])[0]
            assert out == pytest.approx(depth - HULL, abs=1e-2)


@pytest.mark.parametrize("percent", [5, 10, 15])
def test_clutter_covers_its_share(percent: int) -> None:
    for s in split("goal_reaching", f"clutter_{percent}", "test"):
        discs = s.obstacles[s.obstacles["radius"] > 0.0]
        assert math.pi * (discs["radius"] ** 2).sum() == pytest.approx(percent, rel=1e-3)  # of 100 m^2
        at = np.column_stack([discs["x"], discs["y"]])
        gap = np.linalg.norm(at[:, None] - at, axis=2) - discs["radius"] - discs["radius"][:, None]
        assert (gap[np.triu_indices(len(discs), 1)] > -5e-6).all()  # none covers another's share
        assert (np.abs(at).max(axis=1) + discs["radius"] <= 5.0 + 1e-6).all()
        assert 0.12 <= discs["radius"].min() <= discs["radius"].max() <= 0.5


# ---- discs that move


@pytest.mark.parametrize("family", MOVING)
def test_patrols_keep_off_walls_start_and_goal(family: str) -> None:
    for name in ("test", "claims"):
        for s in split("goal_reaching", family, name):
            moving = s.obstacles[s.moving]
            assert 0 < len(moving) <= 30
            for o in moving:
                p = o["patrol"]
                # the way out and back, by the clock
                times = np.linspace(0.0, 2.0 * p["leg_time"], 80)
                at = np.array([motion_at(o, t)[:2] for t in times])
                assert at[0] == pytest.approx([o["x"], o["y"]], abs=1e-9)
                assert clearances(standing(s), at).min() >= o["radius"]
                for end in (s.start, s.goal):
                    assert np.linalg.norm(at - end[:2], axis=1).min() >= o["radius"] + HULL + 0.3 - 1e-9
                assert 0.05 <= np.hypot(p["vx"], p["vy"]) <= 0.65
            for time in (0.0, 3.7, 21.3):  # and off each other
                at = np.array([motion_at(o, time)[:2] for o in moving])
                radii = moving["radius"]
                gap = np.linalg.norm(at[:, None] - at, axis=2) - radii - radii[:, None]
                assert (gap[np.triu_indices(len(at), 1)] > 0.0).all()


def test_crossing_discs_cross_and_others_come_or_go() -> None:
    for s in split("goal_reaching", "moving_crossing", "train"):
        line = np.array(s.goal[:2]) - s.start[:2]
        for o in s.obstacles:
            ends = np.array([motion_at(o, t - o["patrol"]["phase"])[:2] for t in (0.0, o["patrol"]["leg_time"])])
            ends -= s.start[:2]
            sides = [line[0] * y - line[1] * x for x, y in ends]
            assert sides[0] * sides[1] < 0.0
    for family, way in (("moving_head_on", -1.0), ("moving_overtaking", 1.0)):
        for s in split("goal_reaching", family, "train"):
            line = np.array(s.goal[:2]) - s.start[:2]
            for o in s.obstacles:
                velocity = motion_at(o, 0.0)[2:]
                assert way * (line @ velocity) > 0.0
                if way > 0.0:  # slower than any robot here
                    assert np.hypot(*velocity) < 0.3


@pytest.mark.parametrize(
    ("centimetres", "said"),
    [
        ({"goal": [900, 0, 0]}, "the distance from start to goal is 900 m, usual is at most 300; units are m, s, kg"),
        ({"obstacles": [{"kind": "circle", "x": 2, "y": 45, "radius": 30}]}, "half the width of an obstacle is 30 m"),
        ({"obstacles": [{"kind": "box", "x": 2, "y": 65, "length": 60, "width": 80}]}, "half the width of an obstacle"),
        ({"obstacles": [{"kind": "circle", "x": 400, "y": 0, "radius": 3}]}, "the distance from start to an obstacle"),
        ({"obstacles": [{"kind": "circle", "x": 2, "y": 5, "radius": 0.3, "mass": 2e3}]}, "the mass of an obstacle"),
        ({"obstacles": [{"kind": "circle", "x": 2, "y": 5, "radius": 0.3,
          "patrol": {"vx": 0.5, "vy": 0, "leg_time": 4000}}]}, "the way of a moving obstacle is 2000 m"),
        ({"waypoints": [[4, 2]], "waypoint_radius": 50}, "waypoint_radius is 50 m"),
        ({"start_offset": 50}, "start_offset is 50 m"),
        ({"obstacles": [{"kind": "circle", "x": 2, "y": 5, "radius": 0.3,
          "patrol": {"vx": 50, "vy": 0, "leg_time": 4}}]}, "the speed of a moving obstacle is 50 m/s"),
    ],
)  # fmt: skip
def test_a_file_in_other_units_is_doubted_in_a_line(
    tmp_path: pathlib.Path, centimetres: dict[str, object], said: str
) -> None:
    file = tmp_path / "mine.json"
    file.write_text(json.dumps({"goal": [9, 9, 0], **centimetres}))
    with pytest.warns(FileNote, match=f"^mine: {re.escape(said)}"):
        goal_scenarios(str(file), HULL)
    with pytest.warns(FileNote, match=f"^mine: {re.escape(said)}"):  # made in Python, too
        scenarios_of(TASKS["goal_reaching"], field_scenario_from_file(str(file)), HULL)
    file.write_text(json.dumps({"goal": [9, 9, 0]}))
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        goal_scenarios(str(file), HULL)


def test_patrols_from_json(tmp_path: pathlib.Path) -> None:
    patrol = {"vx": 0.5, "vy": 0.0, "leg_time": 4.0, "phase": 1.0}
    moving = {"kind": "circle", "x": 2, "y": 0, "radius": 0.3, "patrol": patrol}
    file = tmp_path / "mine.json"
    content = {"goal": [9, 9, 0], "obstacles": [moving, {"kind": "circle", "x": 5, "y": 0, "radius": 0.3}]}
    file.write_text(json.dumps(content))
    (s,) = goal_scenarios(str(file), HULL)
    assert s.obstacles["patrol"].tolist() == [(2.0, 0.0, 0.5, 0.0, 4.0, 1.0), (0.0,) * 6]
    assert s.obstacles["x"].tolist() == [2.5, 5.0]
    for change, message in [
        ({"patrol": 3}, "obstacles[0]: patrol is 3; it must be an object"),
        ({"patrol": {"vx": 1}}, "field 'obstacles[0].patrol.vy' is missing"),
        ({"patrol": {**patrol, "speed": 1}}, "field 'obstacles[0].patrol.speed' is not known; the fields are vx, vy"),
        ({"patrol": {**patrol, "leg_time": 0}}, "obstacles[0]: patrol leg_time is 0; it must be a finite number of at"),
        ({"mass": 1}, "obstacles[0]: a circle with a patrol cannot have a mass"),
    ]:
        file.write_text(json.dumps({**content, "obstacles": [{**moving, **change}]}))
        with pytest.raises(ValueError, match=re.escape(message)) as caught:
            goal_scenarios(str(file), HULL)
        assert str(caught.value).startswith(f"{file}:")
