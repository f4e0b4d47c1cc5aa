"""How people walk, beside what others print or compute: AttnGraph's table, Weidmann's diagram."""

import math
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from wayfield.envs.crowds import people
from wayfield.envs.crowds.people import stroll
from wayfield.envs.scenarios.obstacles import obstacle_field, wall

Array = NDArray[np.float64]


def walks(law: str, starts: Array, goals: Array, **fields: Any) -> NDArray[np.void]:
    found = np.zeros(len(starts), people.WALK)
    found["law"] = people.LAWS[law]
    found["x"], found["y"], found["goal_x"], found["goal_y"] = *starts.T, *goals.T
    usual = {"speed": 1.0, "radius": 0.3, "horizon": 2.0, "wall_horizon": 0.5, "share": 0.5}
    for name, value in (usual | fields).items():
        found[name] = value
    return found


def scene(n: int, density: float, seed: int) -> tuple[Array, Array, Array]:
    """Returns starts, goals and velocities of agents in a square, 0.65 m apart while there is room."""
    rng = np.random.default_rng(seed)
    side = math.sqrt(n / density)
    places = np.empty((0, 2))
    tries = 0
    while len(places) < n:
        place, tries = rng.uniform(0.0, side, 2), tries + 1
        if tries > 100 * n or not len(places) or np.hypot(*(places - place).T).min() > 0.65:
            places = np.vstack([places, place])
    return places, rng.uniform(0.0, side, (n, 2)), rng.uniform(-0.7, 0.7, (n, 2))


# AttnGraph's test of ORCA, restated: Liu, Chang, Huang, Chakraborty, Hong, Liang, McPherson, Geng and
# Driggs-Campbell, ICRA 2023; github.com/Shuijing725/CrowdNav_Prediction_AttnGraph.


def human(random: np.random.RandomState, ends: list[Array]) -> tuple[Array, Array]:
    """Returns start and goal of somebody who crosses the circle, away from those of others."""
    while True:
        angle = 2.0 * np.pi * random.random_sample()
        noise = 2.0 * random.random_sample(2)
        place = 6.0 * math.sqrt(2.0) * np.array([math.cos(angle), math.sin(angle)]) + noise
        if np.hypot(*(np.vstack(ends) - place).T).min() >= 0.85:
            return place, -place


def attngraph(seed: int) -> tuple[str, float, float, Array, Array]:
    """Returns how a case among 20 people who do not see the robot ends, when (s), after how long a way (m), from, to.

    The robot knows people within 5 m of its hull; others it takes to go on as it last saw them.
    """
    random = np.random.RandomState(seed)
    robot, goal = np.zeros(2), np.zeros(2)
    while math.dist(robot, goal) < 8.0:
        robot, goal = random.uniform(-6.0, 6.0, (2, 2))
    start = robot
    places, goals = np.empty((0, 2)), np.empty((0, 2))
    for _ in range(20):
        place, to = human(random, [robot, goal, places, goals])
        places, goals = np.vstack([places, place]), np.vstack([goals, to])
    velocity, velocities, length = np.zeros(2), np.zeros((20, 2)), 0.0
    known = np.tile((15.0, 15.0, 0.0, 0.0), (20, 1))
    orca = {"horizon": 5.0, "wall_horizon": 5.0, "margin": 0.16}  # twice: about itself and about the other
    for step in range(200):
        apart = np.hypot(*(places - robot).T) - 0.6
        if step:
            known[:, :2] += 0.25 * known[:, 2:]
        known[apart <= 5.0] = np.hstack([places, velocities])[apart <= 5.0]
        if step == 196:
            break
        if apart.min() < 0.0:
            return "collision", 0.25 * step, length, start, robot
        if math.dist(robot, goal) < 0.3:
            return "success", 0.25 * step, length, start, robot
        seen = walks("orca", np.vstack([robot, known[:, :2]]), np.vstack([goal, known[:, :2]]), **orca)
        mine = stroll(seen, 1, 0.25, reach=10.0, velocities=np.vstack([velocity, known[:, 2:]]))[1, 0]
        theirs = stroll(walks("orca", places, goals, **orca), 1, 0.25, reach=10.0, velocities=velocities)[1]
        length += math.dist(mine[:2], robot)
        robot, velocity, places, velocities = mine[:2], mine[2:4], theirs[:, :2], theirs[:, 2:4]
        for k in np.flatnonzero(np.hypot(*(goals - places).T) < 0.3):
            places[k], goals[k] = human(random, [robot, goal, places, goals])
            velocities[k] = 0.0
    return "timeout", 49.0, length, start, robot


@pytest.mark.slow
def test_orca_has_attngraphs_row() -> None:
    """Its log prints 0.69 success, 0.29 collision, 0.02 timeout, 14.77 s and 17.67 m, over 500 cases."""
    found = [attngraph(1000 + k) for k in range(500)]
    outcomes = [outcome for outcome, *_ in found]
    for outcome, printed in (("success", 0.69), ("collision", 0.29), ("timeout", 0.02)):
        assert outcomes.count(outcome) / 500 == pytest.approx(printed, abs=0.04)
    assert np.mean([time for outcome, time, *_ in found if outcome == "success"]) == pytest.approx(14.77, rel=0.05)
    # its way goes on to where the next case starts: at 1 m/s nobody drives 17.67 m in 14.77 s
    ways = [way + math.dist(to, found[(k + 1) % 500][3]) for k, (_, _, way, _, to) in enumerate(found)]
    assert np.mean(ways) == pytest.approx(17.67, rel=0.05)


# Weidmann's fundamental diagram (1993): v = 1.34 (1 - exp(-1.913 (1/rho - 1/5.4))).


def stream(law: str, density: float, seed: int, seconds: float = 20.0) -> float:
    """Returns the mean speed (m/s) of one stream in a corridor 3 m wide that is closed to a ring of 20 m."""
    rng, dt = np.random.default_rng(seed), 0.05
    places = np.empty((0, 2))
    while len(places) < round(60.0 * density):
        place = rng.uniform((0.0, 0.25), (20.0, 2.75))
        apart = places - place
        apart[:, 0] -= 20.0 * np.round(apart[:, 0] / 20.0)
        if not len(places) or np.hypot(*apart.T).min() > 0.4:
            places = np.vstack([places, place])
    speed = np.clip(rng.normal(1.34, 0.26, len(places)), 0.5, 2.0)
    sides = obstacle_field(wall(-20.0, 0.0, 40.0, 0.0), wall(-20.0, 3.0, 40.0, 3.0))
    velocities, found = np.column_stack([0.5 * speed, np.zeros(len(places))]), []
    for _ in range(round(seconds / dt)):
        ends = [(places[:, 0] < 5.0, 20.0), (places[:, 0] > 15.0, -20.0)]  # who is seen round the ring
        all_of = [np.arange(len(places)), *(np.flatnonzero(mask) for mask, _ in ends)]
        there = np.vstack([places, *(places[mask] + np.array([shift, 0.0]) for mask, shift in ends)])
        same = np.concatenate(all_of)
        walk = walks(law, there, there + np.array([100.0, 0.0]), speed=speed[same], radius=0.2)
        after = stroll(walk, 1, dt, sides, velocities=velocities[same])[1, : len(places)]
        places, velocities = np.column_stack([after[:, 0] % 20.0, after[:, 1]]), after[:, 2:4]
        found.append(velocities[:, 0].mean())
    return float(np.mean(found[len(found) // 2 :]))


@pytest.mark.slow
def test_how_far_laws_are_from_the_fundamental_diagram_is_as_told() -> None:
    """What the docstring of `people` says: by all but the force of 1995, who walk alike do not slow down."""
    told = {density: 1.34 * (1.0 - math.exp(-1.913 * (1.0 / density - 1.0 / 5.4))) for density in (0.5, 1.0, 1.5, 2.0)}
    for density, weidmann in told.items():
        assert stream("helbing_molnar", density, 0, seconds=8.0) == pytest.approx(weidmann, rel=0.27)
    for law in ("moussaid", "pysocialforce", "lightsfm", "orca"):
        off = [stream(law, density, 0, seconds=8.0) / weidmann - 1.0 for density, weidmann in told.items()]
        np.testing.assert_allclose(off, (0.07, 0.2, 0.62, 1.15), atol=0.06)
    assert stream("helbing_farkas_vicsek", 2.0, 0, seconds=6.0) > 1.8 * told[2.0]


# Safety and locality.


@pytest.mark.parametrize("seed", range(8))
def test_orca_lets_nobody_touch_whose_programs_can_be_kept(seed: int) -> None:
    """Discs that start apart and at rest, in the open, with goals apart: for all the time."""
    (starts, *_), (goals, *_) = scene(12, 0.1, seed), scene(12, 0.1, 100 + seed)
    out = stroll(walks("orca", starts, goals), 200, 0.1, reach=8.0)
    apart = np.hypot(*(out[:, :, None, :2] - out[:, None, :, :2]).transpose(3, 0, 1, 2)) + 9.0 * np.eye(12)
    assert apart.min() >= 0.6 - 1e-6


@pytest.mark.parametrize("law", ["orca", "helbing_molnar", "moussaid", "helbing_farkas_vicsek"])
def test_who_is_beyond_reach_changes_no_bit(law: str) -> None:
    starts, goals, velocities = scene(12, 0.4, 5)
    near = stroll(walks(law, starts, goals), 5, 0.05, velocities=velocities)
    far = np.array([[40.0, 3.0], [-30.0, 1.0], [2.0, 60.0]])
    more = walks(law, np.vstack([starts, far]), np.vstack([goals, far + 1.0]))
    with_them = stroll(more, 5, 0.05, velocities=np.vstack([velocities, np.ones((3, 2))]))
    assert np.ascontiguousarray(with_them[:, :12]).tobytes() == near.tobytes()


def test_forces_of_contact_add_up_to_nothing() -> None:
    """Of Helbing, Farkas and Vicsek: the mean velocity of people who want to stand is kept."""
    starts, _, velocities = scene(10, 0.8, 3)
    starts = starts * 0.6  # they press on each other
    walk = walks("helbing_farkas_vicsek", starts, starts, speed=1e-9)
    after = stroll(walk, 1, 1e-3, velocities=velocities)[1, :, 2:4]
    relaxed = velocities * (1.0 - 1e-3 / 0.5)
    np.testing.assert_allclose((after - relaxed).sum(axis=0), 0.0, atol=1e-9)
    assert np.abs(after - relaxed).max() > 0.01
