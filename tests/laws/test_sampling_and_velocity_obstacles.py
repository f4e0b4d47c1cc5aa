"""Model predictive path integral control and velocity obstacles: their laws, alone and at the wheel."""

import dataclasses
import itertools
import math
from typing import Any

import gymnasium
import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray
from scipy.optimize import linprog

import wayfield  # noqa: F401  registers the environments
from wayfield.envs import goal_reaching
from wayfield.envs.crowds import half_planes
from wayfield.envs.robots import ACTUATORS, ROBOTS
from wayfield.envs.robots.kinematics import integrate_arc, limit_acceleration
from wayfield.envs.robots.records import lag_factors
from wayfield.envs.scenarios.obstacles import circle, moving_circle, obstacle_field, wall
from wayfield.envs.tasks.briefing import Briefing, Goals, Surroundings
from wayfield.envs.world.movers import motion_at
from wayfield.policies.parts.stopping import SECTORS
from wayfield.policies.pilot import Pilot
from wayfield.policies.scans import mppi
from wayfield.policies.scans.mppi import Mppi
from wayfield.policies.teams.orca import Orca

DT = 0.05
DIFF = "wayfield/DiffDriveGoalObstacles-v0"
OMNI = "wayfield/OmniGoalObstacles-v0"
ENVIRONMENTS = [(DIFF, "p3dx"), (OMNI, "omni3"), (OMNI, "omni4")]
sides = st.floats(-math.pi, math.pi)


def brief(robot: str, actuators: str = "lagged", num_beams: int = 72, **told: Any) -> Briefing:
    """Returns the briefing of a goal seeker."""
    return Briefing(
        num_envs=1,
        robot=ROBOTS[robot],
        actuators=ACTUATORS[actuators],
        dt=DT,
        action_mode="twist",
        layout=goal_reaching.Observation.layout(len(ROBOTS[robot].twist_axes), num_beams, 5.0),
        beam_angles=np.linspace(-math.pi, math.pi, num_beams, endpoint=False),
        max_range=5.0,
        **told,
    )


# Linear programs over half-planes.


def planes_of(count: int) -> st.SearchStrategy[Any]:
    """Returns lists of (direction of the normal, bound)."""
    return st.lists(st.tuples(sides, st.floats(-1.5, 0.8)), min_size=0, max_size=count)


def as_lines(planes: Any) -> NDArray[np.float64]:
    return np.array([(math.cos(a), math.sin(a), b) for a, b in planes]).reshape(-1, 3)


def corners(lines: NDArray[np.float64], u: NDArray[np.float64], limit: float) -> list[NDArray[np.float64]]:
    """Returns all points where the nearest velocity can lie: the wanted one, feet, and meetings of two borders."""
    points = [u, u * limit / max(float(np.hypot(*u)), 1e-12)]
    for line in lines:
        n, b = line[:2], line[2]
        points.append(u + (b - n @ u) * n)
        if abs(b) <= limit:
            left = math.sqrt(limit**2 - b**2) * np.array([-n[1], n[0]])
            points += [b * n + left, b * n - left]
    for one, other in itertools.combinations(lines, 2):
        if abs(np.linalg.det(np.array([one[:2], other[:2]]))) > 1e-9:
            points.append(np.linalg.solve(np.array([one[:2], other[:2]]), [one[2], other[2]]))
    return points


@given(planes_of(8), st.floats(-1.5, 1.5), st.floats(-1.5, 1.5))
def test_the_nearest_velocity_is_the_nearest_of_all_corners(planes: Any, ux: float, uy: float) -> None:
    lines, u = as_lines(planes), np.array([ux, uy])
    vx, vy, failed = half_planes.nearest_velocity(lines, len(lines), 1.0, ux, uy)
    kept = [
        float(np.hypot(*(q - u)))
        for q in corners(lines, u, 1.0)
        if np.hypot(*q) <= 1.0 + 1e-7 and (lines[:, :2] @ q >= lines[:, 2] - 1e-7).all()
    ]
    if failed == len(lines):
        assert math.hypot(vx, vy) <= 1.0 + 1e-9
        assert (lines[:, :2] @ [vx, vy] >= lines[:, 2] - 1e-6).all()
        assert kept
        # nearly parallel borders meet far from where rounding puts them
        assert math.hypot(vx - ux, vy - uy) <= min(kept) + 1e-5
    else:
        shut = [
            q
            for q in corners(lines, u, 1.0)
            if np.hypot(*q) <= 1.0 - 1e-6 and (lines[:, :2] @ q >= lines[:, 2] + 1e-6).all()
        ]
        assert not shut


@settings(max_examples=2 * settings().max_examples // 5)
@given(planes_of(7), st.lists(sides, max_size=3), st.floats(-1.0, 1.0), st.floats(-1.0, 1.0))
def test_the_least_violation_is_that_of_a_linear_program(planes: Any, standing: Any, ux: float, uy: float) -> None:
    """Against scipy's, the disc replaced by a polygon around it."""
    hard = len(standing)
    lines = np.vstack([as_lines([(a, -0.2) for a in standing]), as_lines(planes)])
    scratch = np.empty((len(lines), 3))
    v = np.array(half_planes.best_velocity(lines, len(lines), hard, 1.0, ux, uy, scratch))
    assert np.hypot(*v) <= 1.0 + 1e-9
    lacking = lines[:, 2] - lines[:, :2] @ v
    assert (lacking[:hard] <= 1e-9).all()
    around = np.linspace(-math.pi, math.pi, 720, endpoint=False)
    polygon = np.column_stack([np.cos(around), np.sin(around), np.zeros(720)])
    soft = np.column_stack([-lines[:, :2], np.where(np.arange(len(lines)) < hard, 0.0, -1.0)])
    found = linprog(
        [0.0, 0.0, 1.0],
        A_ub=np.vstack([soft, polygon]),
        b_ub=np.concatenate([-lines[:, 2], np.ones(720)]),
        bounds=[(None, None), (None, None), (0.0, None)],
    )
    assert found.success
    assert max(lacking[hard:].max(initial=0.0), 0.0) == pytest.approx(found.fun, abs=1e-4)


def test_standstill_is_what_is_left_between_two_walls_that_touch() -> None:
    lines = np.array([[1.0, 0.0, 0.0], [-1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, -1.0, 0.0]])
    assert np.hypot(*half_planes.best_velocity(lines, 4, 4, 1.0, 0.7, 0.3, np.empty((4, 3)))) <= 1e-9


# The half-plane of a disc.

places = st.tuples(st.floats(0.3, 5.0), sides)
velocities = st.tuples(st.floats(0.0, 1.5), sides)


def closest(p: NDArray[np.float64], v: NDArray[np.float64], horizon: float) -> float:
    """Returns the least distance to the point p within the time ahead at a constant velocity."""
    t = np.clip(p @ v / max(float(v @ v), 1e-12), 0.0, horizon)
    return float(np.hypot(*(p - t * v)))


def polar(size: float, angle: float) -> NDArray[np.float64]:
    return size * np.array([math.cos(angle), math.sin(angle)])


@given(places, velocities, st.floats(0.1, 1.0), st.floats(0.3, 5.0), st.floats(-3.0, 3.0), st.floats(0.0, 3.0))
def test_what_a_half_plane_leaves_meets_nothing_for_the_time_ahead(
    place: Any, velocity: Any, reach: float, horizon: float, along: float, beyond: float
) -> None:
    p, v = polar(*place), polar(*velocity)
    assume(np.hypot(*p) > reach + 1e-6)
    nx, ny, b = half_planes.disc_half_plane(*p, reach, *v, horizon, 0.5)
    assert math.hypot(nx, ny) == pytest.approx(1.0)
    chosen = (b + beyond) * np.array([nx, ny]) + along * np.array([-ny, nx])
    assert closest(p, chosen, horizon) >= reach - 1e-6
    # where the disc does not move standstill is always left
    assert b <= 1e-12


@given(places, velocities, st.floats(0.1, 1.0), st.floats(0.3, 5.0))
def test_a_half_plane_touches_the_velocity_obstacle_where_the_velocity_is_nearest(
    place: Any, velocity: Any, reach: float, horizon: float
) -> None:
    p, v = polar(*place), polar(*velocity)
    assume(np.hypot(*p) > reach + 1e-3)
    n_and_b = half_planes.disc_half_plane(*p, reach, *v, horizon, 0.5)
    n, b = np.array(n_and_b[:2]), n_and_b[2]
    distance = abs(n @ v - b)
    foot = v + (b - n @ v) * n
    # the foot is on the border: a little farther in collides within the time ahead
    assert closest(p, foot - 1e-3 * n, horizon * (1.0 + 1e-6)) < reach
    # no velocity of another kind is nearer
    free = closest(p, v, horizon) >= reach
    for angle in np.linspace(-math.pi, math.pi, 60):
        near = v + polar(0.999 * distance - 1e-6, angle) if distance > 1e-5 else v
        assert (closest(p, near, horizon) >= reach - 1e-6) == free or distance <= 1e-5


def test_a_disc_that_is_too_near_is_left() -> None:
    nx, ny, b = half_planes.disc_half_plane(0.4, 0.0, 0.5, 0.3, 0.0, 2.0, 0.5)
    assert (nx, ny) == (-1.0, 0.0)
    assert b == pytest.approx(0.1 / 0.5)


# Among discs that move. The plant is the suite's motion, the world is the policy's own briefing.


def passes(
    robot: str,
    discs: list[tuple[float, float, float, float]],
    goal: tuple[float, float] = (6.0, 0.0),
    standing: tuple[np.void, ...] = (),
    **gains: Any,
) -> tuple[float, float]:
    """Returns (least gap between hull and any disc, distance to the goal after 40 s), both in m.

    discs: x, y, vx, vy; they have a radius of 0.3 m and go on for a minute.
    """
    moving = [moving_circle(x, y, 0.3, vx, vy, 60.0) for x, y, vx, vy in discs]
    obstacles = obstacle_field(*moving, *standing)[None]
    briefing = brief(
        robot,
        num_beams=0,
        # as an environment hands them over: what nobody may write has kernels of its own
        map=Surroundings.of(obstacles.copy(), np.array([obstacles.shape[1]])),
        goal=Goals(np.array([[[*goal, 0.0]]]), np.array([1])),
    )
    axes = list(briefing.robot.twist_axes)
    actuators = briefing.actuators
    decay, mean = lag_factors(actuators.lag, DT)
    policy = Orca(**gains)
    memory = policy.reset(briefing)
    pose, command, wheel = np.zeros(3), np.zeros(3), np.zeros(3)
    least = math.inf
    for step in range(800):
        s, c = math.sin(pose[2]), math.cos(pose[2])
        dx, dy = goal[0] - pose[0], goal[1] - pose[1]
        seen = goal_reaching.Observation(
            pose[None],
            wheel[None, axes],
            np.array([[c * dx + s * dy, c * dy - s * dx]]),
            np.array([-pose[2]]),
            np.zeros(1),
            np.empty((1, 0)),
        )
        wanted = np.zeros(3)
        wanted[axes] = policy.act(seen, briefing, memory)[0]
        command = np.array(
            limit_acceleration(tuple(command), tuple(wanted), actuators.acceleration, actuators.yaw_acceleration, DT)
        )
        pose = np.array(integrate_arc(*pose, *(command + mean * (wheel - command)), DT))
        wheel = command + decay * (wheel - command)
        for disc in moving:
            x, y, _, _ = motion_at(disc, (step + 1) * DT)
            least = min(least, math.hypot(x - pose[0], y - pose[1]) - 0.3 - briefing.robot.hull_radius)
        for each in standing:
            least = min(least, math.hypot(each["x"] - pose[0], each["y"] - pose[1]) - each["radius"]
                        - briefing.robot.hull_radius)  # fmt: skip
    return least, math.hypot(goal[0] - pose[0], goal[1] - pose[1])


ENCOUNTERS = {
    "head on": [(6.0, 0.0, -0.5, 0.0)],
    "from the right": [(3.0, -2.5, 0.0, 0.45)],
    "from the left": [(3.0, 2.5, 0.0, -0.45)],
    "overtaking": [(1.5, 0.0, 0.15, 0.0)],
    "overtaken": [(-3.0, 0.0, 0.8, 0.0)],
    "two at once": [(3.0, 2.5, 0.0, -0.45), (6.0, 0.2, -0.4, 0.0)],
}


@pytest.mark.parametrize("robot", ["p3dx", "omni4"])
@pytest.mark.parametrize("encounter", ENCOUNTERS)
def test_moving_discs_are_passed_without_contact(robot: str, encounter: str) -> None:
    least, left = passes(robot, ENCOUNTERS[encounter])
    assert least > 0.0
    assert left < 0.1


@pytest.mark.parametrize("robot", ["p3dx", "omni4"])
def test_a_disc_on_the_line_is_passed(robot: str) -> None:
    least, left = passes(robot, [], standing=(circle(3.0, 0.0, 0.4),))
    assert least > 0.0
    assert left < 0.1


def test_only_what_is_sensed_matters() -> None:
    asked = []
    for x in (2.0, 4.0):
        obstacles = obstacle_field(circle(x, 0.0, 0.5))[None]
        told = Surroundings.of(obstacles.copy(), np.array([1]))
        goal = Goals(np.zeros((1, 1, 3)), np.array([1]))
        briefing = brief("omni4", num_beams=0, map=told, goal=goal)
        policy = Orca(sensing_radius=2.0, perturbation=0.0, horizon=10.0, roadmap=False)
        seen = goal_reaching.Observation(
            np.zeros((1, 3)), np.zeros((1, 3)), np.array([[9.0, 0.0]]), np.zeros(1), np.zeros(1), np.empty((1, 0))
        )
        asked.append(policy.act(seen, briefing, policy.reset(briefing))[0, 0])
    assert asked[0] < asked[1] == pytest.approx(policy.max_speed)


# Path integral control: weights, noise and plans.

costs = st.lists(st.integers(0, 1 << 20), min_size=2, max_size=50)


@given(costs, st.integers(-(1 << 30), 1 << 30))
def test_a_constant_on_all_costs_changes_nothing(each: list[int], constant: int) -> None:
    """Costs in multiples of 2^-10 m, to which sums are exact."""
    weights, moved = np.empty(len(each)), np.empty(len(each))
    best = mppi.weigh(np.array(each) / 1024.0, 0.05, weights)
    assert best == mppi.weigh((np.array(each) + constant) / 1024.0, 0.05, moved) == int(np.argmin(each))
    assert weights.tobytes() == moved.tobytes()
    assert weights.sum() == pytest.approx(1.0)
    assert (weights >= 0.0).all()


def test_weights_fall_by_e_with_each_temperature() -> None:
    weights = np.empty(3)
    mppi.weigh(np.array([7.0, 7.5, 8.0]), 0.5, weights)
    np.testing.assert_allclose(weights[1:] / weights[:-1], math.exp(-1.0))


def plans_of(policy: Mppi, robot: str, plan: NDArray[np.float64], decision: int = 0) -> NDArray[np.float64]:
    """Returns the samples (samples, steps, 3) around a plan (steps, 3)."""
    params = policy.params(brief(robot))
    plans = np.empty((policy.samples + 1, policy.steps, 3))
    noise = np.empty((policy.samples, policy.steps, 3))
    mppi.draw(params[0], decision, noise)
    mppi.sample(params[0], noise, plan, plans)
    return plans[:-1]


@pytest.mark.parametrize("robot", ["p3dx", "omni4"])
def test_without_noise_every_sample_is_the_plan_and_so_is_their_mean(robot: str) -> None:
    policy = Mppi(samples=8, speed_noise=0.0, yaw_noise=0.0)
    plan = np.tile([0.4, 0.0, 0.3], (policy.steps, 1))
    plans = plans_of(policy, robot, plan)
    others = plans[[0, *range(2, 8)]]
    assert (others == plan).all()
    assert not plans[1].any()
    mean = np.concatenate([others, np.empty((1, policy.steps, 3))])
    mppi.average(mean, np.full(7, 1.0 / 7.0), 7)
    np.testing.assert_allclose(mean[7], plan, atol=1e-12)


def test_no_plan_reverses_without_a_view_behind() -> None:
    policy, whole = Mppi(samples=64, speed_noise=1.0), brief("p3dx")
    for briefing, least in (
        (whole, -policy.max_reverse),
        (dataclasses.replace(whole, beam_angles=whole.beam_angles[9:-9]), 0.0),
    ):
        plans = np.empty((policy.samples + 1, policy.steps, 3))
        noise = np.empty((policy.samples, policy.steps, 3))
        mppi.draw(policy.params(briefing)[0], 0, noise)
        mppi.sample(policy.params(briefing)[0], noise, np.zeros((policy.steps, 3)), plans)
        assert plans[:-1, :, 0].min() == least


@pytest.mark.parametrize("robot", ["p3dx", "omni3"])
def test_samples_and_their_mean_keep_the_bounds(robot: str) -> None:
    """A plan at its bounds, with noise far beyond them."""
    policy = Mppi(speed_noise=3.0, yaw_noise=9.0)
    plans = plans_of(policy, robot, np.tile([0.6, 0.0, 1.5], (policy.steps, 1)))
    plans = np.concatenate([plans, np.empty((1, policy.steps, 3))])
    mppi.average(plans, np.full(policy.samples, 1.0 / policy.samples), policy.samples)
    assert (np.hypot(plans[..., 0], plans[..., 1]) <= policy.max_speed + 1e-12).all()
    assert (np.abs(plans[..., 2]) <= policy.max_yaw_rate + 1e-12).all()
    if robot == "p3dx":
        assert plans[..., 0].min() >= -policy.max_reverse - 1e-12
        assert not plans[..., 1].any()
    # the mean of clamped samples lies within; that of the noise would have left the plan where it is
    assert plans[-1, :, 2].max() < 1.0


@pytest.mark.parametrize("actuators", ["ideal", "lagged", "slow"])
@pytest.mark.parametrize(("env_id", "robot"), ENVIRONMENTS)
def test_a_rollout_ends_where_the_plant_does(env_id: str, robot: str, actuators: str) -> None:
    """A plan of random twists at the control period, its cost the distance from a far goal."""
    policy = Mppi(steps=40, step_time=DT, samples=2, detour=False, goal_weight=0.0, terminal_weight=1.0,
                  obstacle_weight=0.0, turn_weight=0.0, reverse_weight=0.0, heading_weight=0.0)  # fmt: skip
    env: Any = gymnasium.make(env_id, scenario="open_field", robot=robot, actuators=actuators).unwrapped
    seen, info = env.reset(seed=4)
    pilot = Pilot(policy, env)
    pilot.reset()
    rng = np.random.default_rng(5)
    axes = list(ROBOTS[robot].twist_axes)
    plans = np.zeros((3, 40, 3))
    plans[0][:, axes] = rng.uniform(-1.5, 1.5, (8, len(axes))).repeat(5, axis=0)
    fields = pilot.briefing.layout.unpack(seen[None].astype(np.float64))
    grid = np.full((81, 81), 9.0)
    cost = mppi.roll_out(
        policy.params(pilot.briefing)[0], plans[0], np.zeros(3), np.zeros(3), (*fields.goal[0], 0.0, False), grid, grid
    )  # fmt: skip
    for twist in plans[0]:
        _, _, terminated, _, info = env.step(twist[axes])
        assert not terminated
    # the observed goal has single precision
    assert cost == pytest.approx(info["goal_distance"], abs=1e-5)


# Path integral control: what the scan says.


def grids(
    policy: Mppi, ranges: NDArray[np.float64], goal: tuple[float, float], robot: str = "p3dx"
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64], int]:
    """Returns (clearances, ways, hits, number of hits) of a scan."""
    briefing = brief(robot, num_beams=len(ranges))
    p = policy.params(briefing)[0]
    angles = briefing.beam_angles
    hits = np.empty((len(ranges), 3))
    near = np.full((SECTORS, 4), np.inf)
    count = mppi.find_hits(p, np.column_stack([np.cos(angles), np.sin(angles)]), ranges[None], 0, near, hits)
    side = 2 * int(p["half"]) + 1
    clearances, slowness, ways = np.empty((side, side)), np.empty((side, side)), np.empty((side, side))
    mppi.measure_clearances(p, hits, count, clearances)
    mppi.measure_ways(p, clearances, *goal, slowness, ways)
    # a way's price: 1 wherever an obstacle is farther than its influence, and that of a wall where the hull cannot be
    closed = np.clip((policy.margin - clearances) / policy.cell, 0.0, 1.0)
    narrow = 1.0 - np.clip(clearances / policy.influence, 0.0, 1.0)
    np.testing.assert_allclose(slowness, 1.0 + policy.obstacle_weight * narrow**2 + 60.0 * closed, atol=1e-12)
    return clearances, ways, hits, count


@given(st.lists(st.floats(0.3, 6.0), min_size=12, max_size=40))
@settings(max_examples=settings().max_examples // 10)
def test_clearances_are_distances_to_the_nearest_hit(values: list[float]) -> None:
    policy = Mppi(reach=2.0)
    ranges = np.minimum(np.array(values), 5.0)
    clearances, _, hits, count = grids(policy, ranges, (3.0, 0.0))
    nodes = policy.cell * np.stack(np.meshgrid(*[np.arange(-20, 21)] * 2, indexing="ij"), axis=-1)
    expected = np.full(clearances.shape, np.inf)
    for h in range(count):
        for share in np.linspace(0.0, 1.0, 100 if hits[h, 2] else 1):
            point = (1.0 - share) * hits[h, :2] + share * hits[(h + 1) % count, :2]
            expected = np.minimum(expected, np.hypot(*np.moveaxis(nodes - point, -1, 0)))
    known = expected - 0.25 < policy.influence
    np.testing.assert_allclose(clearances[known], expected[known] - 0.25, atol=0.02)
    assert (clearances[~known] >= policy.influence - 0.02).all()


def scan(*shapes: np.void, num_beams: int = 72) -> NDArray[np.float64]:
    """Returns the ranges of a robot at the origin, found by marching."""
    angles = np.linspace(-math.pi, math.pi, num_beams, endpoint=False)
    distances = np.arange(0.0, 5.0, 0.002)
    points = distances[None, :, None] * np.stack([np.cos(angles), np.sin(angles)], axis=-1)[:, None]
    ranges = np.full(num_beams, 5.0)
    for shape in shapes:
        d = points - [shape["x"], shape["y"]]
        along = np.abs(d @ [shape["cos"], shape["sin"]]) - shape["half_length"]
        across = np.abs(d @ [-shape["sin"], shape["cos"]]) - max(shape["half_width"], 0.002)
        inside = np.hypot(np.maximum(along, 0.0), np.maximum(across, 0.0)) <= max(shape["radius"], 1e-9)
        ranges = np.minimum(ranges, np.where(inside.any(axis=1), distances[inside.argmax(axis=1)], 5.0))
    return ranges


@pytest.mark.parametrize("goal", [(1.3, 0.4), (-4.0, 1.0)], ids=["inside", "outside"])
def test_ways_solve_the_eikonal_equation_and_hulls_beside_walls_read_their_neighbours(
    goal: tuple[float, float],
) -> None:
    """At every node where the hull fits: the upwind scheme's own value; elsewhere the least way around a neighbour."""
    policy = Mppi(reach=2.5, cell=0.125, obstacle_weight=2.0, influence=0.5, margin=0.06)
    ranges = scan(circle(0.9, 0.2, 0.3), wall(-1.0, -0.8, 0.6, -1.1), circle(-0.9, 0.9, 0.2))
    clearances, ways, _, _ = grids(policy, ranges, goal)
    side, h = len(ways), policy.cell
    closed = np.clip((policy.margin - clearances) / h, 0.0, 1.0)
    narrow = np.maximum(1.0 - np.maximum(clearances, 0.0) / policy.influence, 0.0)
    cost = h * (1.0 + policy.obstacle_weight * narrow**2 + 60.0 * closed)  # m of way, through a cell
    fits = clearances >= policy.margin
    assert 20 < (~fits).sum() < 0.5 * side**2
    half = (side - 1) // 2
    for i in range(side):
        for j in range(side):
            if not fits[i, j]:
                around = [
                    ways[a, b] + h * math.hypot(a - i, b - j)
                    for a in range(max(i - 1, 0), min(i + 2, side))
                    for b in range(max(j - 1, 0), min(j + 2, side))
                    if fits[a, b]
                ]
                if around:
                    assert ways[i, j] == pytest.approx(min(around))
                continue
            straight = math.hypot((i - half) * h - goal[0], (j - half) * h - goal[1])
            if straight < 2.0 * h:
                assert ways[i, j] == pytest.approx(straight)
            if straight < 2.0 * h or {i, j} & {0, side - 1}:
                assert ways[i, j] <= straight + 1e-9
                continue
            if not (fits[i - 1 : i + 2, j].all() and fits[i, j - 1 : j + 2].all()):
                continue  # what those were worth as they were swept is not kept
            a, b = min(ways[i - 1, j], ways[i + 1, j]), min(ways[i, j - 1], ways[i, j + 1])
            wanted = min(a, b) + cost[i, j]
            if abs(a - b) < cost[i, j]:
                wanted = 0.5 * (a + b + math.sqrt(2.0 * cost[i, j] ** 2 - (a - b) ** 2))
            assert ways[i, j] == pytest.approx(
                wanted, abs=0.02
            )  # swept until nothing changes by more than a centimetre


def test_ways_in_the_open_are_straight_and_behind_a_wall_lead_round_its_end() -> None:
    policy = Mppi()
    _, ways, _, _ = grids(policy, np.full(72, 5.0), (2.0, 1.0))
    nodes = policy.cell * np.stack(np.meshgrid(*[np.arange(-40, 41)] * 2, indexing="ij"), axis=-1)
    straight = np.hypot(*np.moveaxis(nodes - np.array([2.0, 1.0]), -1, 0))
    assert (ways >= straight - 1e-9).all()
    # the scheme is of first order in the cell
    np.testing.assert_allclose(ways, straight, atol=0.12)
    barrier = wall(1.0, -1.5, 1.0, 1.5)
    _, ways, _, _ = grids(policy, scan(barrier), (2.0, 0.0))
    # two legs to a corner that the hull passes at its radius, and the arc around it
    assert math.hypot(1.0, 1.75) * 2.0 < ways[40, 40] < math.hypot(1.0, 1.75) * 2.0 + 0.9
