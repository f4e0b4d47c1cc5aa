"""How people walk and teams avoid each other, against closed forms, published numbers and laws of motion."""

import itertools
import math
from typing import Any

import gymnasium
import numpy as np
import pytest
from numpy.typing import NDArray

import wayfield  # noqa: F401  registers the environments
from wayfield import policies
from wayfield.envs.crowds import people
from wayfield.envs.crowds.half_planes import shared_half_plane
from wayfield.envs.crowds.people import stroll
from wayfield.envs.scenarios.team_scenario import TeamScenario
from wayfield.policies import Pilot

Array = NDArray[np.float64]
SOCIAL = ("helbing_molnar", "moussaid", "helbing_farkas_vicsek")


def walks(law: str, starts: Array, goals: Array, **fields: Any) -> NDArray[np.void]:
    found = np.zeros(len(starts), people.WALK)
    found["law"] = people.LAWS[law]
    found["x"], found["y"], found["goal_x"], found["goal_y"] = starts[:, 0], starts[:, 1], goals[:, 0], goals[:, 1]
    usual = {"speed": 1.0, "radius": 0.3, "horizon": 2.0, "wall_horizon": 0.5, "share": 0.5}
    for name, value in (usual | fields).items():
        found[name] = value
    return found


def scattered(n: int, seed: int, side: float) -> Array:
    rng = np.random.default_rng(seed)
    places: list[Array] = []
    while len(places) < n:
        place = rng.uniform(0.0, side, 2)
        if all(math.hypot(*(place - other)) > 0.7 for other in places):
            places.append(place)
    return np.array(places)


# CrowdNav's test of ORCA, restated: Chen, Liu, Kreiss and Alahi 2019.


def crowdnav(seed: int, visible: bool) -> tuple[str, float]:
    """Returns how a case of CrowdNav's circle crossing ends, and when (s)."""
    random = np.random.RandomState(seed)
    ends = [(0.0, -4.0, 0.0, 4.0)]
    while len(ends) < 6:
        angle = random.random_sample() * np.pi * 2
        x, y = 4.0 * np.cos(angle) + random.random_sample() - 0.5, 4.0 * np.sin(angle)
        y += random.random_sample() - 0.5
        if all(min(np.hypot(x - a, y - b), np.hypot(x - c, y - d)) >= 0.8 for a, b, c, d in ends):
            ends.append((x, y, -x, -y))
    found = np.array(ends)
    walk = walks("orca", found[:, :2], found[:, 2:], horizon=5.0, wall_horizon=5.0, margin=0.01)
    walk["blind"][1:] = not visible
    out = stroll(walk, 98, 0.25, reach=10.0, robots=(0,))
    for k in range(98):
        before, after = out[k], out[k + 1]
        if 0.25 * k >= 24.0:
            return "timeout", 0.25 * k
        way = 0.25 * (before[1:, 2:4] - after[0, 2:4])
        apart = before[1:, :2] - before[0, :2]
        share = np.clip(-(apart * way).sum(axis=1) / np.maximum((way**2).sum(axis=1), 1e-300), 0.0, 1.0)
        if np.hypot(*(apart + share[:, None] * way).T).min() < 0.6:
            return "collision", 0.25 * (k + 1)
        if np.hypot(*(after[0, :2] - (0.0, 4.0))) < 0.3:
            return "success", 0.25 * (k + 1)
    raise AssertionError


def test_orca_has_the_outcomes_of_rvo2_in_crowdnav() -> None:
    """RVO2 in float32 gives 0.426, 0.568 and 0.006 with 10.863 s unseen, and 1, 0, 0 with 10.018 s seen."""
    for visible, shares, time in ((False, (0.426, 0.568, 0.006), 10.863), (True, (1.0, 0.0, 0.0), 10.018)):
        found = [crowdnav(1000 + k, visible) for k in range(500)]
        outcomes = [outcome for outcome, _ in found]
        assert tuple(outcomes.count(each) / 500 for each in ("success", "collision", "timeout")) == shares
        assert np.mean([t for outcome, t in found if outcome == "success"]) == pytest.approx(time, abs=0.002)


# Exact laws.


@pytest.mark.parametrize("apart", [4.0, 8.0])
def test_two_who_meet_head_on_close_in_by_one_factor_a_step(apart: float) -> None:
    ends = np.array([[0.0, 0.0], [apart, 0.0]])
    out = stroll(walks("orca", ends, ends[::-1]), 90, 0.1, reach=15.0)
    assert (out[:, :, 1] == 0.0).all()  # nobody leaves the line
    gaps = out[:, 1, 0] - out[:, 0, 0] - 0.6
    bound = int(np.argmax(gaps < 2.0 * 1.0 * 2.0)) + 1
    np.testing.assert_allclose(gaps[bound + 1 : 60] / gaps[bound:59], 1.0 - 0.1 / 2.0, atol=1e-9)
    assert (gaps > 0.0).all()


@pytest.mark.parametrize("n", [3, 5, 8, 16])
def test_a_symmetric_circle_stands_still_unless_all_turn_aside(n: int) -> None:
    angles = 2.0 * np.pi * np.arange(n) / n
    radius = max(4.0, 0.24 * n)
    starts = radius * np.column_stack([np.cos(angles), np.sin(angles)])
    stuck = stroll(walks("orca", starts, -starts), 600, 0.1, reach=15.0)[-1]
    assert np.hypot(*(stuck[:, :2] + starts).T).min() > 1.0
    ring = np.hypot(stuck[:, 0], stuck[:, 1])
    np.testing.assert_allclose(ring, 0.3 / math.sin(math.pi / n), rtol=0.02)
    turned = stroll(walks("orca", starts, -starts, turn=0.05), 900, 0.1, reach=15.0)
    assert np.hypot(*(turned[-1, :, :2] + starts).T).max() < 0.3
    gaps = np.hypot(*(turned[:, :, None, :2] - turned[:, None, :, :2]).transpose(3, 0, 1, 2)) + 9.0 * np.eye(n)
    assert gaps.min() >= 0.6 - 1e-6


def test_what_two_give_way_by_is_exactly_opposite() -> None:
    rng = np.random.default_rng(0)
    for _ in range(200):
        px, py, *v = rng.uniform(-2.0, 2.0, 6)
        mine = shared_half_plane(px, py, 0.6, (v[0], v[1]), (v[2], v[3]), 2.0, 0.1, 0.5)
        other = shared_half_plane(-px, -py, 0.6, (v[2], v[3]), (v[0], v[1]), 2.0, 0.1, 0.5)
        assert mine[0] == -other[0]
        assert mine[1] == -other[1]
        give = [n[2] - n[0] * u - n[1] * w for n, (u, w) in ((mine, v[:2]), (other, v[2:]))]
        assert give[0] == pytest.approx(give[1], abs=1e-12)


@pytest.mark.parametrize("law", ["orca", *SOCIAL])
@pytest.mark.parametrize("n", [12, 100])
def test_no_numbering_and_no_cells_change_a_bit(law: str, n: int) -> None:
    starts = scattered(n, 3, math.sqrt(n / 0.3))
    goals = starts[np.random.default_rng(1).permutation(n)]
    steps, dt = (20, 0.1) if law != "helbing_farkas_vicsek" else (3, 0.05)
    walk = walks(law, starts, goals)
    out = stroll(walk, steps, dt, cells_from=1)
    assert out.tobytes() == stroll(walk, steps, dt, cells_from=10_000).tobytes()
    order = np.random.default_rng(2).permutation(n)
    assert np.ascontiguousarray(out[:, order]).tobytes() == stroll(walk[order], steps, dt).tobytes()
    # mirrored at the x axis, and turned by a quarter
    flipped = stroll(walks(law, starts * (1.0, -1.0), goals * (1.0, -1.0)), steps, dt)
    np.testing.assert_array_equal(out, flipped * (1.0, -1.0, 1.0, -1.0, 1.0))
    turned = stroll(walks(law, starts[:, ::-1] * (-1.0, 1.0), goals[:, ::-1] * (-1.0, 1.0)), steps, dt)
    np.testing.assert_array_equal(turned, out[:, :, [1, 0, 3, 2, 4]] * (-1.0, 1.0, -1.0, 1.0, 1.0))


@pytest.mark.parametrize("law", ["orca", *SOCIAL])
def test_no_numbering_decides_between_those_who_are_equally_far(law: str) -> None:
    starts = 1.5 * np.stack(np.meshgrid(np.arange(6.0), np.arange(6.0)), -1).reshape(-1, 2)
    order = np.random.default_rng(5).permutation(36)
    goals = np.random.default_rng(6).permutation(starts)
    out = stroll(walks(law, starts, goals), 3, 0.1)
    assert np.ascontiguousarray(out[:, order]).tobytes() == stroll(walks(law, starts, goals)[order], 3, 0.1).tobytes()


@pytest.mark.parametrize(("law", "tau"), [("helbing_molnar", 0.5), ("moussaid", 0.54), ("helbing_farkas_vicsek", 0.5)])
def test_one_person_alone_takes_up_the_wanted_speed_exponentially(law: str, tau: float) -> None:
    out = stroll(walks(law, np.zeros((1, 2)), np.array([[100.0, 0.0]])), 100, 0.01)
    time = 0.01 * np.arange(101)
    np.testing.assert_allclose(out[:, 0, 2], 1.0 - np.exp(-time / tau), atol=0.011)
    assert (out[:, 0, 3] == 0.0).all()


def test_the_force_of_1995_is_the_gradient_of_its_potential() -> None:
    rng = np.random.default_rng(5)

    def potential(x: float, y: float, vx: float, vy: float) -> float:
        sx, sy = 2.0 * vx, 2.0 * vy
        both = math.hypot(x, y) + math.hypot(x - sx, y - sy)
        return 2.1 * math.exp(-0.5 * math.sqrt(both**2 - sx**2 - sy**2) / 0.3)

    for _ in range(50):
        x, y, vx, vy = rng.uniform(-1.0, 1.0, 4)
        h = 1e-6
        gradient = [
            (potential(x + h, y, vx, vy) - potential(x - h, y, vx, vy)) / (2 * h),
            (potential(x, y + h, vx, vy) - potential(x, y - h, vx, vy)) / (2 * h),
        ]
        np.testing.assert_allclose(people.pushed_1995(x, y, vx, vy), -np.array(gradient), rtol=1e-4, atol=1e-6)


def test_the_interaction_of_2009_restated() -> None:
    rng = np.random.default_rng(6)
    for _ in range(50):
        x, y, vx, vy = rng.uniform(-2.0, 2.0, 4)
        distance = math.hypot(x, y)
        d = np.array([2.0 * vx + x / distance, 2.0 * vy + y / distance])
        b, t = 0.35 * math.hypot(*d), d / math.hypot(*d)
        angle = math.atan2(t[0] * y - t[1] * x, t[0] * x + t[1] * y)
        left = np.array([-t[1], t[0]])
        along = math.exp(-distance / b - (3.0 * b * angle) ** 2)
        aside = math.exp(-distance / b - (2.0 * b * angle) ** 2) * np.sign(angle)
        np.testing.assert_allclose(people.pushed_2009(x, y, vx, vy), -4.5 * (along * t + aside * left), atol=1e-12)


def test_a_recorded_person_moves_as_the_track_says() -> None:
    time = np.arange(6.0) * 0.4
    track = np.column_stack([1.3 * time, 0.5 * time**2, np.full(6, 1.3 * 0.4), 0.4 * time])
    walk = walks("replay", np.zeros((1, 2)), np.ones((1, 2)), frame_time=0.4, begins=0.5, rows=6)
    out = stroll(walk, 60, 0.05, tracks=track)
    seconds = 0.05 * np.arange(61)
    there = (seconds >= 0.5 - 1e-9) & (seconds <= 2.5 + 1e-9)
    assert (out[:, 0, 4] == there).all()
    s = seconds[there] - 0.5
    expected = np.column_stack([1.3 * s, 0.5 * s**2, np.full(len(s), 1.3), s])
    np.testing.assert_allclose(out[there, 0, :4], expected, atol=1e-9)


def test_people_of_a_group_walk_by_the_forces_of_2010() -> None:
    """Gaze, cohesion and repulsion restated: what a group adds to one step of who walk alone."""
    starts = np.array([(0.0, 0.0), (0.5, 0.3), (-1.9, -0.9), (0.4, -0.2)])
    velocities = np.array([(0.6, 0.1), (0.7, -0.1), (0.5, 0.0), (0.4, 0.2)])
    walk = walks("moussaid", starts, starts + np.array([40.0, 0.0]))
    alone = stroll(walk, 1, 0.01, velocities=velocities)[1, :, 2:4]
    walk["group"][:3] = 1  # the fourth walks by itself
    added = (stroll(walk, 1, 0.01, velocities=velocities)[1, :, 2:4] - alone) / 0.01
    for i in range(3):
        others = [j for j in range(3) if j != i]
        to = starts[others].mean(axis=0) - starts[i]
        turn = max(math.acos(to[0] / math.hypot(*to)) - 0.5 * math.pi, 0.0)
        expected = -4.0 * turn * velocities[i]
        to = starts[:3].mean(axis=0) - starts[i]
        if math.hypot(*to) > 1.0:  # (N - 1) / 2
            expected = expected + 3.0 * to / math.hypot(*to)
        for j in others:
            away = starts[i] - starts[j]
            if math.hypot(*away) < 0.8:
                expected = expected + away / math.hypot(*away)
        np.testing.assert_allclose(added[i], expected, atol=1e-9)
    assert (added[3] == 0.0).all()


def test_a_group_stays_together_where_each_would_go_by_itself() -> None:
    starts = np.array([(0.0, 0.0), (1.5, 1.2), (-1.0, -0.8)])
    walk = walks("moussaid", starts, starts + np.array([60.0, 0.0]), speed=[1.0, 1.2, 1.4])
    widths = []
    for group in (0, 3):
        walk["group"] = group
        last = stroll(walk, 600, 0.05)[-1, :, :2]
        widths.append(np.hypot(*(last - last.mean(axis=0)).T).max())
    assert widths[0] > 3.0
    assert widths[1] < 1.2


@pytest.mark.parametrize(("law", "tau", "people_push", "most"), [("pysocialforce", 0.5, 5.1, 1.3),
                                                                 ("lightsfm", 0.25, 2.1, 1.0)])  # fmt: skip
def test_sets_of_programs_are_the_force_of_2009_with_their_numbers(
    law: str, tau: float, people_push: float, most: float
) -> None:
    from wayfield.envs.scenarios.obstacles import obstacle_field, wall

    starts, velocities = np.array([(0.0, 0.0), (1.4, 0.3)]), np.array([(0.5, 0.1), (-0.4, 0.0)])
    goals = starts + np.array([(20.0, 0.0), (-20.0, 0.0)])

    def pushed(name: str) -> Array:
        both = stroll(walks(name, starts, goals), 1, 0.001, velocities=velocities)[1, 0, 2:4]
        one = stroll(walks(name, starts[:1], goals[:1]), 1, 0.001, velocities=velocities[:1])[1, 0, 2:4]
        return (both - one) / 0.001

    np.testing.assert_allclose(pushed(law), people_push / 4.5 * pushed("moussaid"), rtol=1e-9)
    alone = walks(law, starts[:1], goals[:1], speed=1.2)
    free = stroll(alone, 200, 0.005)[:, 0, 2]
    np.testing.assert_allclose(free, 1.2 * (1.0 - np.exp(-0.005 * np.arange(201) / tau)), atol=0.02)
    fast = stroll(alone, 1, 0.001, velocities=np.array([(9.0, 0.0)]))[1, 0, 2]
    assert fast == pytest.approx(most * 1.2)
    side = obstacle_field(wall(-5.0, -0.6, 5.0, -0.6))
    near = stroll(alone, 1, 0.001, side)[1, 0, 3] / 0.001
    assert near == pytest.approx(10.0 * math.exp(-(0.6 - alone["radius"][0]) / 0.2), rel=1e-9)


def met(reaction: str, **fields: Any) -> Array:
    """Returns how a person of lightsfm walks towards a robot that stands at the origin, facing it: 12 s."""
    start, goal = np.array([(6.0, 0.3)]), np.array([(-6.0, 0.3)])
    walk = walks("lightsfm", start, goal, reaction=people.REACTIONS[reaction], **fields)
    world = TeamScenario.made("met", [(0.0, 0.0, 0.0)], [(0.0, 9.0, 0.0)], walks=walk)
    env: Any = gymnasium.make("wayfield/OmniPeople-v0", scenario=world).unwrapped
    env.reset(seed=0)
    found = []
    for _ in range(240):
        env.step(np.zeros(3, np.float32))
        found.append(env.task.walking(env.batch.own)[0, 0, :4])
    return np.array(found)


def test_people_react_to_a_robot_as_in_hunavsim() -> None:
    ways = {reaction: met(reaction) for reaction in people.REACTIONS}
    gaps = {reaction: np.hypot(way[:, 0], way[:, 1]) for reaction, way in ways.items()}
    for passes in ("regular", "impassive"):
        assert ways[passes][-1, 0] < -4.0
    # beside a thing one passes as near as beside a wall, a person is left more room
    assert gaps["impassive"].min() != gaps["regular"].min()
    assert np.hypot(*ways["surprised"][-1, 2:]) < 0.01
    assert 3.0 < gaps["surprised"][-1] < 5.0
    assert gaps["scared"].min() > max(gaps["regular"].min(), gaps["impassive"].min()) + 0.5
    seen = gaps["scared"] < 4.9
    assert np.hypot(*ways["scared"][:, 2:].T)[np.flatnonzero(seen)[1:]].max() <= 0.6 + 1e-9
    assert gaps["curious"][-1] == pytest.approx(1.5, abs=0.4)
    assert np.hypot(*ways["curious"][-1, 2:]) < 0.05
    assert np.hypot(*(ways["threatening"][-1, :2] - (1.4, 0.0))) < 0.3
    blind = met("threatening", blind=1)
    assert blind.tobytes() == met("regular", blind=1).tobytes()


def test_groups_and_reactions_are_refused_of_laws_that_have_none() -> None:
    walk = walks("orca", np.array([(3.0, 0.0)]), np.array([(9.0, 0.0)]), reaction=people.REACTIONS["curious"])
    with pytest.raises(ValueError, match=r"walks\[0\].reaction is 4 with the law orca; only moussaid, pysocialforce"):
        TeamScenario.made("odd", [(0.0, 0.0, 0.0)], [(0.0, 9.0, 0.0)], walks=walk)


@pytest.mark.parametrize(("field", "value"), [("x", math.inf), ("goal_y", math.nan), ("speed", -math.inf)])
def test_a_walk_that_is_not_finite_is_refused_in_a_line(field: str, value: float) -> None:
    walk = walks("moussaid", np.array([(0.0, 0.0), (3.0, 0.0)]), np.array([(9.0, 0.0), (-9.0, 0.0)]))
    walk[field][1] = value
    with pytest.raises(ValueError, match=rf"^walks\[1\].{field} is {value}; it must be finite$"):
        stroll(walk, 3, 0.1)
    good = walks("moussaid", np.zeros((1, 2)), np.ones((1, 2)))
    with pytest.raises(ValueError, match=r"^velocities\[0, 1\] is inf; it must be finite$"):
        stroll(good, 3, 0.1, velocities=np.array([(0.0, math.inf)]))


# Statistical laws.


def door(speed: float, seed: int) -> float:
    """Returns the time (s) until 80 of 100 have left a room of 10 m by a door of 1 m (Helbing et al. 2000)."""
    from wayfield.envs.scenarios.obstacles import obstacle_field, wall

    rng = np.random.default_rng(seed)
    grid = np.stack(np.meshgrid(np.arange(10), np.arange(10)), -1).reshape(-1, 2)
    starts = 0.5 + grid * (0.93, 0.98) + rng.uniform(-0.05, 0.05, (100, 2))
    goals = np.column_stack([np.full(100, 16.0), starts[:, 1]])
    walk = walks("helbing_farkas_vicsek", starts, goals, speed=speed, radius=rng.uniform(0.25, 0.35, 100))
    walk["gate_x"] = walk["gate_to_x"] = 10.0
    walk["gate_y"], walk["gate_to_y"] = 4.5, 5.5
    corners = [(10.0, 4.5), (10.0, 0.0), (0.0, 0.0), (0.0, 10.0), (10.0, 10.0), (10.0, 5.5)]
    walls = obstacle_field(*(wall(*a, *b) for a, b in itertools.pairwise(corners)))
    out = stroll(walk, 1500, 0.1, walls, reach=2.0)
    left = (out[:, :, 0] > 10.5).sum(axis=1)
    return float(0.1 * np.argmax(left >= 80)) if (left >= 80).any() else 150.0


@pytest.mark.slow
def test_faster_is_slower() -> None:
    hurry, best, calm = (np.mean([door(speed, seed) for seed in range(2)]) for speed in (6.0, 2.5, 0.8))
    assert hurry > 1.3 * best
    assert calm > 1.8 * best


def lane_order(there: Array) -> float:
    """Returns how much strips of 0.6 m belong to one stream each: the mean of ((n+ - n-)/(n+ + n-))^2, weighted."""
    middle = there[(there[:, 0] > 2.0) & (there[:, 0] < 13.0)]
    strip, way = (middle[:, 1] / 0.6).astype(int), np.sign(middle[:, 2])
    return sum(way[strip == k].sum() ** 2 / (strip == k).sum() for k in np.unique(strip)) / len(middle)


@pytest.mark.parametrize("n", [36, 72])
def test_two_streams_of_people_form_lanes(n: int) -> None:
    from wayfield.envs.scenarios.obstacles import obstacle_field, wall

    sides = obstacle_field(wall(-2.0, 0.0, 17.0, 0.0), wall(-2.0, 4.8, 17.0, 4.8))
    for seed in range(4):
        rng = np.random.default_rng(seed)
        places: list[Array] = []
        while len(places) < n:
            place = rng.uniform((0.4, 0.4), (14.6, 4.4))
            if all(math.hypot(*(place - other)) > 0.5 for other in places):
                places.append(place)
        starts = np.array(places)
        way = np.where(np.arange(n) % 2 == 0, 1.0, -1.0)
        goals = np.column_stack([np.where(way > 0.0, 15.5, -0.5), starts[:, 1]])
        speed = np.maximum(rng.normal(1.29, 0.19, n), 0.6)
        walk = walks("moussaid", starts, goals, speed=speed, radius=0.2, then=people.TURNS_BACK)
        out = stroll(walk, 1200, 0.05, sides, velocities=np.column_stack([0.5 * way * speed, np.zeros(n)]))
        late = np.mean([lane_order(there) for there in out[900::20]])
        assert late > 1.5 * lane_order(out[1])


# Teams.


def test_a_robot_pushed_by_nothing_takes_up_its_speed_as_people_do() -> None:
    scenario = TeamScenario.made("alone", [(0.0, 0.0, 0.0)], [(30.0, 0.0, 0.0)])
    env: Any = gymnasium.make("wayfield/OmniTeam-v0", scenario=scenario, sees="bodies", actuators="ideal")
    pilot = Pilot(policies.make("social_force"), env)
    seen, _ = env.reset(seed=0)
    pilot.reset()
    for k in range(60):
        seen, *_ = env.step(pilot.act(seen))
        twist = env.unwrapped.batch.states[0]
        assert twist["vx"] == pytest.approx(0.6 * (1.0 - math.exp(-0.05 * (k + 1) / 0.54)), abs=0.02)
        assert twist["vy"] == 0.0


@pytest.mark.slow
@pytest.mark.parametrize("angle", [0.0, 0.7, 2.0])
def test_of_two_who_meet_in_a_door_one_gives_way_whoever_is_counted_first(angle: float) -> None:
    from wayfield.envs.scenarios.obstacles import obstacle_field, wall

    def at(x: float, y: float) -> tuple[float, float]:
        return math.cos(angle) * x - math.sin(angle) * y, math.sin(angle) * x + math.cos(angle) * y

    sides = obstacle_field(*(wall(*at(0.0, side * 0.45), *at(0.0, side * 4.0)) for side in (-1.0, 1.0)))
    ends = [(*at(-2.0, 0.3), angle), (*at(2.0, -0.2), angle + math.pi)]
    steps = {}
    for gains in ({}, {"turn": 0.0, "stuck_turn": 0.0, "back_off": 0.0}):
        for order in (1, -1):
            scenario = TeamScenario.made("door", ends[::order], ends[::-order], sides)
            env: Any = gymnasium.make("wayfield/OmniTeam-v0", scenario=scenario, sees="bodies", actuators="lagged")
            pilot = Pilot(policies.make("orca_team_map", **gains), env)
            seen, _ = env.reset(seed=0)
            pilot.reset()
            ways, ended = [], False
            while not ended and len(ways) < 800:
                seen, _, ended, _, info = env.step(pilot.act(seen))
                states = env.unwrapped.batch.states
                ways.append(np.column_stack([states["x"], states["y"]])[::order])
            assert bool(info["success"].all()) == (not gains)
            steps[len(gains), order] = np.array(ways)
    for gains in (0, 3):
        np.testing.assert_allclose(steps[gains, 1], steps[gains, -1], atol=1e-9)


def all_arrive(env: Any, options: dict[str, Any]) -> None:
    """Drives by orca_team until all robots are there, and none has touched another."""
    pilot = Pilot(policies.make("orca_team"), env)
    seen, _ = env.reset(seed=0, options=options)
    pilot.reset()
    arrived = np.zeros(env.num_envs, np.bool_)
    for _ in range(2400):
        seen, _, terminated, _, info = env.step(pilot.act(seen))
        assert not info["collision"].any()
        arrived |= terminated & info["success"]
        if arrived.all():
            return
    raise AssertionError(f"{int(arrived.sum())} of {len(arrived)} arrived")


def test_orca_team_turns_all_circles_and_lets_nobody_touch() -> None:
    for env_id, n in (
        ("wayfield/DiffDriveTeam-v0", 4),
        ("wayfield/DiffDriveTeam-v0", 16),
        ("wayfield/OmniTeam-v0", 8),
    ):
        scenario = f"circle_exact_{n}"
        env: Any = gymnasium.make_vec(env_id, num_envs=3 * n, scenario=scenario, sees="bodies", max_episode_steps=2400)
        all_arrive(env, {"scenario": np.repeat(np.arange(3), n)})


@pytest.mark.parametrize(
    "n", [3, 10, pytest.param(12, marks=pytest.mark.slow), pytest.param(16, marks=pytest.mark.slow)]
)
@pytest.mark.parametrize("digits", [6, 17])
def test_orca_team_turns_a_circle_that_is_exact_to_the_last_digit_too(n: int, digits: int) -> None:
    angles = 2.0 * np.pi * np.arange(n) / n
    places = np.column_stack([4.0 * np.cos(angles), 4.0 * np.sin(angles)]).round(digits)
    scenario = TeamScenario.made("ring", [(*each, 0.0) for each in places], [(*-each, 0.0) for each in places])
    env: Any = gymnasium.make_vec(
        "wayfield/DiffDriveTeam-v0", num_envs=n, scenario=(scenario,), sees="bodies", max_episode_steps=2400
    )
    all_arrive(env, {})


def test_who_has_no_access_to_bodies_is_not_shown_them() -> None:
    options = {"scenario": "circle_4", "max_episode_steps": 60}
    drives = []
    for sees in ("scan", "bodies"):
        env: Any = gymnasium.make_vec("wayfield/DiffDriveTeam-v0", num_envs=4, sees=sees, **options)
        pilot = Pilot(policies.make("vfh_plus"), env)
        seen, _ = env.reset(seed=0)
        pilot.reset()
        actions = []
        for _ in range(30):
            actions.append(pilot.act(seen))
            seen, *_ = env.step(actions[-1])
        drives.append(np.array(actions))
    assert drives[0].tobytes() == drives[1].tobytes()
    with pytest.raises(TypeError, match='needs bodies; make the environment with sees="bodies"'):
        Pilot(policies.make("orca_team"), gymnasium.make("wayfield/DiffDriveTeam-v0", scenario="circle_4"))


def test_people_see_the_robot_or_not() -> None:
    walk = walks("orca", np.array([[3.0, 0.02]]), np.array([[-6.0, 0.02]]), speed=1.0)
    world = TeamScenario.made("meet", [(0.0, 0.0, 0.0)], [(9.0, 0.0, 0.0)], walks=walk)
    ends = {}
    for visible in (True, False):
        env: Any = gymnasium.make("wayfield/DiffDrivePeople-v0", scenario=world, visible=visible)
        env.reset(seed=0)
        for _ in range(120):
            _, _, terminated, _, info = env.step(np.zeros(2))
            if terminated:
                break
        ends[visible] = terminated, info["touched"], info["caused"]
    assert ends[True][0] is False
    assert ends[False] == (True, 3.0, False)  # a person ran into a robot that stood
