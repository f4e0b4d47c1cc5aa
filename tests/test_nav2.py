"""Nav2's controllers: their critics against numbers made by hand, and that they reach goals."""

import itertools
import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from test_local_planners import briefing_of, drive, observed, scan

from wayfield.envs.compiled import compiled
from wayfield.envs.kinematics import integrate_arc
from wayfield.policies import nav2_dwb, nav2_mppi
from wayfield.policies.nav2_dwb import ILLEGAL, Nav2Dwb
from wayfield.policies.nav2_mppi import FILTER, HISTORY, Nav2Mppi, Samples
from wayfield.policies.parts import costmap
from wayfield.policies.parts.costmap import BACK_UP, CLEAR, POINT_SPACING, SPIN, WAIT, inflated
from wayfield.policies.parts.polyline_tracker import FARTHEST, UNIT
from wayfield.policies.parts.stopping import Scan, Seen

Array = NDArray[np.float64]
CONTROLLERS = [Nav2Dwb, Nav2Mppi]
every_controller = pytest.mark.parametrize("controller", CONTROLLERS)
RADIUS = 0.25  # m, of the P3DX

cost_of = compiled(lambda p, m, costs, places, near: nav2_mppi.cost_critic(p[0], m[0], costs, places, near))
beyond = compiled(lambda p, controls: nav2_mppi.beyond_limits(p[0], controls))
apart = compiled(lambda places, goal: nav2_mppi.mean_distance(places, goal))
turned = compiled(lambda places, heading: nav2_mppi.mean_angle(places, heading))
is_open = compiled(lambda p, taken, farthest: nav2_mppi.is_open(p[0], taken, farthest))
misaligned = compiled(lambda p, points, taken, places: nav2_mppi.misalignment(p[0], points, taken, places))
follow = compiled(lambda p, taken, farthest: nav2_mppi.following(p[0], taken, farthest))
end_away = compiled(lambda places, point: nav2_mppi.away_from(places, point))
aside = compiled(lambda p, points, pose, farthest: nav2_mppi.is_aside(p[0], points, pose, farthest))
end_angle = compiled(lambda places, point: nav2_mppi.angle_to(places, point))
backward = compiled(lambda p, controls: nav2_mppi.backward_way(p[0], controls))
limit = compiled(lambda p, now, sequence: nav2_mppi.limit(p[0], now, sequence))
roll_out = compiled(lambda p, sequence, samples, now, pose: nav2_mppi.roll_out(p[0], sequence, samples, now, pose))
nearest = compiled(lambda cells, row, column: nav2_dwb.nearest(cells, row, column))
flips = compiled(lambda p, m, pose: nav2_dwb.note_flips(p[0], m[0], pose))
oscillates = compiled(lambda m, vx, vy, w: nav2_dwb.oscillates(m[0], vx, vy, w))
arrives = compiled(lambda p, m, distance, speed: nav2_dwb.note_arrival(p[0], m[0], distance, speed))
scored = compiled(
    lambda p, m, costs, told, pose, now, twist: nav2_dwb.scored(p[0], m[0], costs, told, pose, now, twist)
)
driven = compiled(lambda p, m, costs, pose, now, twist: nav2_dwb.driven(p[0], m[0], costs, pose, now, twist))
recovers = compiled(lambda p, m, pose, goal: costmap.recovers(p[0], m[0], pose, goal))
slow_down = compiled(lambda p, m, scan, seen: costmap.slow_down(p[0], m[0], scan, seen, 0))


def gains(controller: Any, acceleration: float = 1e6, yaw_acceleration: float = 1e6, **more: Any) -> NDArray[Any]:
    """Returns what the law of a P3DX with some limits of acceleration reads, with none unless they are given."""
    read = np.array(controller(**more).given(briefing_of("p3dx")))
    read["acceleration"], read["yaw_acceleration"] = acceleration, yaw_acceleration
    return read


def memory(controller: Any, cell: float = 0.08) -> Any:
    """Returns the memory (1,) of a robot whose map is free, around the origin."""
    state = controller().reset(briefing_of("p3dx"))["state"]
    state["cell"] = cell
    state["origin"] = -80.0 * cell
    return state


def straight(speed: float, steps: int = 56, y: float = 0.0, heading: float = 0.0) -> Array:
    """Returns a trajectory (steps, 3) along x, from the origin's step on."""
    x = 0.05 * speed * np.arange(1, steps + 1)
    return np.column_stack([x, np.full(steps, y), np.full(steps, heading)])


def plan(length: float) -> Array:
    """Returns a plan along x."""
    count = round(length / POINT_SPACING) + 1
    return np.column_stack([POINT_SPACING * np.arange(count), np.zeros(count)])


# The costmap.


def test_costs_fall_off_from_the_hull_as_documented() -> None:
    costs = inflated(RADIUS, 0.7, 3.0)
    at = {distance: costs[round((FARTHEST - distance) / UNIT)] for distance in (0.0, 0.1, 0.25, 0.35, 0.5, 0.7, 0.705)}
    assert at == {
        0.0: 254.0,
        0.1: 253.0,
        0.25: 253.0,
        0.35: math.floor(252.0 * math.exp(-0.3)),
        0.5: math.floor(252.0 * math.exp(-0.75)),
        0.7: math.floor(252.0 * math.exp(-1.35)),
        0.705: 0.0,
    }
    assert (np.diff(costs) >= 0.0).all()  # the nearer the dearer


@every_controller
@pytest.mark.parametrize("inflation_radius", [0.1, 0.4, 0.7])
def test_the_map_knows_of_obstacles_as_far_as_costs_or_plans_ask(controller: Any, inflation_radius: float) -> None:
    """Up to the inflation radius, or the room beside the hull that plans want, 0.2 m, whichever is the farther."""
    table = controller(inflation_radius=inflation_radius).maps(briefing_of("p3dx")).table
    half = table.shape[2] // 2
    spot = np.array([0.125, 0.375, 0.625, 0.875])  # of a side of the cell
    away = 0.08 * np.abs(np.arange(-half, half + 1) + 0.5 - spot[:, None])
    distance = np.hypot(away[:, None, :, None], away[None, :, None, :])
    known = table > 0
    # of what lies no farther than that from a point there are cells beyond, to interpolate between
    assert known[distance <= max(inflation_radius, RADIUS + 0.2) + 0.08].all()
    assert not known[distance > max(inflation_radius, RADIUS + 0.2) + 0.16].any()


@every_controller
def test_a_command_is_slowed_by_the_share_of_the_time_that_is_free(controller: Any) -> None:
    p, m = gains(controller), memory(controller)
    briefing = briefing_of("p3dx")
    policy = controller()
    ahead = 0.25 + 0.6 * 0.6  # half of 1.2 s at 0.6 m/s until the hull is there
    seen = observed(briefing, scan(briefing.beam_angles, [(ahead, -0.01, ahead, 0.01)]))
    sighted = Scan.of(policy, seen, briefing, policy.reset(briefing)), Seen.of(seen, briefing)
    m["command"] = 0.6, 0.0, 0.0
    slow_down(p, m, *sighted)
    assert m["command"][0].tolist() == pytest.approx([0.3, 0.0, 0.0], abs=1e-6)
    m["command"] = -0.6, 0.0, 0.0  # nothing is there
    slow_down(p, m, *sighted)
    assert m["command"][0].tolist() == [-0.6, 0.0, 0.0]


def test_who_does_not_get_on_clears_its_map_then_turns_waits_and_backs_away() -> None:
    p, m = gains(Nav2Dwb), memory(Nav2Dwb)
    goal = 5.0, 0.0, 0.0
    done: list[tuple[int, float, float, float]] = []
    m["evidence"][0, 5, 5] = 18
    for step in range(1, 1150):
        m["steps"] = step
        if recovers(p, m, (0.0, 0.0, 0.0), goal):
            done.append((int(m["recovering"][0]), *m["command"][0].tolist()))
    kinds = [kind for kind, *_ in done]
    assert [kinds.count(kind) for kind in (CLEAR, SPIN, WAIT, BACK_UP)] == [0, 31, 100, 40]
    assert kinds == sorted(kinds)
    assert {tuple(twist) for kind, *twist in done if kind == SPIN} == {(0.0, 0.0, 1.0)}
    assert {tuple(twist) for kind, *twist in done if kind == BACK_UP} == {(-0.15, 0.0, 0.0)}
    assert m["evidence"].max() == 0
    # at the goal it need not get on
    m = memory(Nav2Dwb)
    for step in range(1, 600):
        m["steps"] = step
        assert not recovers(p, m, (4.9, 0.0, 0.0), goal)


# MPPI.


def test_noise_is_drawn_once_and_has_the_deviations_that_were_asked_for() -> None:
    noise = nav2_mppi.drawn(0, 500, 56, 0.2, 0.4)
    assert noise is nav2_mppi.drawn(0, 500, 56, 0.2, 0.4)
    assert noise.std((0, 1)) == pytest.approx([0.2, 0.2, 0.4], rel=0.02)
    assert abs(noise.mean((0, 1))).max() < 0.01
    assert abs(np.corrcoef(noise.reshape(-1, 3).T) - np.eye(3)).max() < 0.02
    other = nav2_mppi.drawn(1, 500, 56, 0.2, 0.4)
    assert len(np.unique(np.append(noise, other))) == 2 * noise.size  # no number twice
    assert not noise.flags.writeable  # all decisions share it


def test_samples_start_at_the_twist_that_the_robot_has_and_keep_to_the_accelerations() -> None:
    p = gains(Nav2Mppi, 1.0, 3.0)
    samples = Samples.of(nav2_mppi.drawn(0, 50, 56, 0.2, 0.4))
    roll_out(p, np.zeros((56, 3)), samples, (0.4, 0.0, 0.2), (1.0, 2.0, 0.0))
    assert samples.places[:, 0] == pytest.approx(np.tile([1.02, 2.0, 0.01], (50, 1)), abs=1e-12)
    before = np.concatenate([np.tile([0.4, 0.0, 0.2], (50, 1, 1)), samples.controls], axis=1)
    assert abs(np.diff(before, axis=1)).max((0, 1)) == pytest.approx([0.05, 0.0, 0.15], abs=1e-12)


def test_critics_of_the_way_give_what_is_worked_out_by_hand() -> None:
    p = gains(Nav2Mppi)
    points, free = plan(1.7), np.zeros(69, np.bool_)
    along, beside = straight(0.5), straight(0.5, y=0.1)
    # counted from the first point of the trajectory, which lies a step, 0.025 m, along the plan
    assert misaligned(p, points, free, along) == pytest.approx(0.025)
    assert misaligned(p, points, free, beside) == pytest.approx(math.hypot(0.1, 0.025))
    assert misaligned(p, points, ~free, beside) == 0.0  # what is taken is not kept to
    assert end_away(beside, np.array([1.4, 0.4])) == pytest.approx(0.3)
    assert end_angle(straight(0.5, heading=0.5), np.array([1.4, 1.0])) == pytest.approx(0.5 * math.pi - 0.5)
    assert apart(straight(0.0), (3.0, 4.0, 0.0)) == pytest.approx(5.0)
    assert apart(along, (0.0, 0.0, 0.0)) == pytest.approx(0.025 * 57 / 2)
    assert turned(straight(0.5, heading=3.0), -3.0) == pytest.approx(2.0 * math.pi - 6.0)
    ends = np.stack([straight(0.5), straight(-0.5), straight(0.25)])
    assert nav2_mppi.farthest_reached(points, ends) == 56  # 1.4 m
    assert aside(p, points, (0.0, 0.0, 0.9), 10)[0] == 0
    assert aside(p, points, (0.0, 0.0, 1.1), 10) == (True, 14)
    assert aside(p, points, (0.0, 0.0, 0.0), 67) == (False, 68)


def test_the_plan_counts_only_where_it_is_open_and_is_followed_past_what_is_taken() -> None:
    p = gains(Nav2Mppi)
    taken = np.zeros(69, np.bool_)
    taken[[3, 4]] = True
    assert is_open(p, taken, 10)  # two are forgiven
    taken[5] = True
    assert not is_open(p, taken, 40)
    assert is_open(p, taken, 60)  # 5 %
    assert follow(p, taken, 20) == 25
    taken[25:30] = True
    assert follow(p, taken, 20) == 30
    assert follow(p, taken, 67) == 68


def test_critics_of_the_motion_give_what_is_worked_out_by_hand() -> None:
    p = gains(Nav2Mppi)
    controls = np.zeros((56, 3))
    controls[:10, 0] = 0.7
    controls[10:30, 0] = -0.45
    assert beyond(p, controls) == pytest.approx(0.05 * (10 * 0.1 + 20 * 0.1))
    assert backward(p, controls) == pytest.approx(0.05 * 20 * 0.45)


def test_the_cost_critic_takes_the_mean_and_a_collision_for_all() -> None:
    p, m = gains(Nav2Mppi), memory(Nav2Mppi)
    costs = inflated(RADIUS, 0.7, 3.0)
    assert cost_of(p, m, costs, straight(0.5), False) == (0.0, False)
    level = round((FARTHEST - 0.35) / UNIT)
    m["grid"] = level
    wanted = 3.81 / 254.0 * costs[level]
    assert cost_of(p, m, costs, straight(0.5), False) == (pytest.approx(wanted), False)
    assert cost_of(p, m, costs, straight(0.5), True) == (0.0, False)  # near the goal
    m["grid"] = 255
    found, collides = cost_of(p, m, costs, straight(0.5), False)
    assert collides
    assert found == pytest.approx(3.81 / 254.0 * 1e6 / 28)


def test_the_mean_is_weighted_by_the_costs() -> None:
    controls = np.zeros((3, 4, 3))
    controls[0, :, 0], controls[1, :, 0], controls[2, :, 0] = 1.0, 5.0, 100.0
    costs = np.array([2.0, 2.0 + 0.3 * math.log(3.0), 1e6])
    sequence = np.empty((4, 3))
    nav2_mppi.average(0.3, Samples(controls, controls, controls, costs), sequence)
    assert sequence == pytest.approx(np.tile([2.0, 0.0, 0.0], (4, 1)))


def test_the_filter_leaves_what_is_quadratic_and_reads_the_history() -> None:
    assert FILTER.sum() == pytest.approx(1.0)
    t = np.arange(-HISTORY, 56.0)
    curve = np.column_stack([0.1 + 0.01 * t - 0.001 * t * t, t, np.ones_like(t)])
    sequence = curve[HISTORY:].copy()
    nav2_mppi.smooth(curve[:HISTORY], sequence)
    assert sequence[:-4] == pytest.approx(curve[HISTORY:-4], abs=1e-9)
    assert not np.allclose(sequence[-4:], curve[-4:])  # beyond the end the last twist stands


def test_a_plan_keeps_to_the_limits_from_the_twist_that_the_robot_has() -> None:
    p = gains(Nav2Mppi, 1.0, 3.0)
    sequence = np.tile([2.0, 0.0, -9.0], (56, 1))
    limit(p, (0.2, 0.0, 0.0), sequence)
    assert sequence[:3, 0].tolist() == pytest.approx([0.2, 0.25, 0.3])
    assert sequence[:3, 2].tolist() == pytest.approx([0.0, -0.15, -0.3])
    assert sequence[-1].tolist() == pytest.approx([0.6, 0.0, -1.9])


@pytest.mark.parametrize(
    ("critic", "goal", "turn", "counts"),
    [
        ("goal", (1.35, 0.0), 0.0, True), ("goal", (1.5, 0.0), 0.0, False),
        ("goal_angle", (0.45, 0.0), 1.0, True), ("goal_angle", (0.55, 0.0), 1.0, False),
        ("path_align", (0.6, 0.1), 0.0, True), ("path_align", (0.4, 0.1), 0.0, False),
        ("path_follow", (1.6, 0.0), 0.0, True), ("path_follow", (1.3, 0.0), 0.0, False),
        ("path_angle", (-0.55, 0.0), 0.0, True), ("path_angle", (-0.45, 0.0), 0.0, False),
        ("path_angle", (0.55, 0.0), 0.0, False),
        ("prefer_forward", (0.55, 0.0), 0.0, True), ("prefer_forward", (0.45, 0.0), 0.0, False),
    ],
)  # fmt: skip
def test_each_critic_counts_where_it_is_said_to(critic: str, goal: Any, turn: float, counts: bool) -> None:
    briefing = briefing_of("p3dx")
    seen = observed(briefing, scan(briefing.beam_angles, []), goal, turn)
    asked = []
    for weight in (0.0, 20.0):
        policy = Nav2Mppi(samples=200, path_align_offset=0, **{critic: weight})
        asked.append(policy.act(seen, briefing, policy.reset(briefing))[0].tolist())
    assert (asked[0] != asked[1]) == counts


# DWB.


def test_speeds_are_even_and_hold_zero_between_two_signs() -> None:
    assert nav2_dwb.sampled(-0.3, 0.3, 4).tolist() == pytest.approx([-0.3, -0.1, 0.0, 0.1, 0.3])
    assert nav2_dwb.sampled(-0.2, 0.2, 5).tolist() == pytest.approx([-0.2, -0.1, 0.0, 0.1, 0.2])
    assert nav2_dwb.sampled(0.0, 0.6, 4).tolist() == pytest.approx([0.0, 0.2, 0.4, 0.6])
    assert nav2_dwb.sampled(0.1, 0.1, 20).tolist() == [0.1]


def test_distances_are_counted_along_the_axes_from_the_cell_nearest_as_the_crow_flies() -> None:
    cells = np.array([[0, 0], [4, 4], [6, 0]])
    assert nearest(cells, 3, 3) == 2  # of (4, 4)
    assert nearest(cells, 0, -7) == 7
    assert nearest(cells, 3, 0) == 3  # the first of equals


def test_a_twist_is_driven_as_far_as_it_leads_and_its_end_is_paid_for() -> None:
    p, m = gains(Nav2Dwb), memory(Nav2Dwb)
    costs = inflated(RADIUS, 0.7, 3.0)
    end, cost = driven(p, m, costs, (0.0, 0.0, 0.0), (0.5, 0.0, 0.0), (0.5, 0.0, 0.0))
    assert (end, cost) == (pytest.approx((0.85, 0.0, 0.0)), 0.0)
    # a plan along x of 2 m: the end lies on it, 23 cells before its last; so does the nose, and the nose's goal
    cells = np.column_stack([np.zeros(41, np.int64), np.arange(41)])
    told = cells, (0, 42), (2.0, 0.0, 0.0), True
    wanted = 0.025 * (24.0 * 23 + 24.0 * 23)
    assert scored(p, m, costs, told, (0.0, 0.0, 0.0), (0.5, 0.0, 0.0), (0.5, 0.0, 0.0)) == pytest.approx(wanted)
    # and 0.2 m beside it four cells, the nose's too
    beside = scored(p, m, costs, told, (0.0, 0.21, 0.0), (0.5, 0.0, 0.0), (0.5, 0.0, 0.0))
    assert beside == pytest.approx(0.025 * (2 * 32.0 * 4 + 2 * 24.0 * 27))
    m["grid"] = round((FARTHEST - 0.35) / UNIT)
    dearer = scored(p, m, costs, told, (0.0, 0.0, 0.0), (0.5, 0.0, 0.0), (0.5, 0.0, 0.0))
    assert dearer == pytest.approx(wanted + 0.02 * math.floor(252.0 * math.exp(-0.3)))
    m["grid"] = 255
    assert scored(p, m, costs, told, (0.0, 0.0, 0.0), (0.5, 0.0, 0.0), (0.5, 0.0, 0.0)) == ILLEGAL


def test_at_the_goal_a_robot_slows_down_and_then_only_turns() -> None:
    p, m = gains(Nav2Dwb), memory(Nav2Dwb)
    costs = inflated(RADIUS, 0.7, 3.0)
    told = np.zeros((1, 2), np.int64), (0, 0), (0.01, 0.01, 1.7), False
    at, now = (0.01, 0.01, 0.0), (0.4, 0.0, 0.0)
    arrives(p, m, 0.2, 0.0)
    assert (m["near"][0], m["rotating"][0]) == (0, 0)
    arrives(p, m, 0.05, 0.4)
    assert (m["near"][0], m["rotating"][0]) == (1, 0)
    assert scored(p, m, costs, told, at, now, (0.4, 0.0, 0.0)) == ILLEGAL
    slower = scored(p, m, costs, told, at, now, (0.1, 0.0, 0.0))
    assert math.isfinite(slower)
    arrives(p, m, 0.3, 0.2)
    assert m["rotating"][0] == 1
    assert scored(p, m, costs, told, at, now, (0.1, 0.0, 0.0)) == ILLEGAL
    still = 0.0, 0.0, 0.0
    turns = [scored(p, m, costs, told, at, still, (0.0, 0.0, w)) for w in (0.2, 0.5, 1.0)]
    assert turns[0] - turns[2] == pytest.approx(32.0 * 0.8 * 1.7 + 0.025 * 24.0 * 0, abs=0.025 * 24.0 * 4)
    assert turns[0] > turns[1] > turns[2]


def test_a_sign_that_was_flipped_stays_until_the_robot_has_moved() -> None:
    p, m = gains(Nav2Dwb), memory(Nav2Dwb)
    for w in (0.5, -0.5):
        m["command"] = 0.0, 0.0, w
        flips(p, m, (1.0, 1.0, 0.0))
    assert oscillates(m, 0.0, 0.0, 0.1)
    assert not oscillates(m, 0.0, 0.0, -0.1)
    assert not oscillates(m, 0.3, 0.0, 0.0)
    flips(p, m, (1.04, 1.0, 0.1))
    assert oscillates(m, 0.0, 0.0, 0.1)
    flips(p, m, (1.0, 1.0, -0.25))
    assert not oscillates(m, 0.0, 0.0, 0.1)
    m["command"] = 0.3, 0.0, 0.5  # while it drives, turns are free
    flips(p, m, (2.0, 1.0, 0.0))
    m["command"] = 0.3, 0.0, -0.5
    flips(p, m, (2.0, 1.0, 0.0))
    assert not oscillates(m, 0.0, 0.0, 0.5)


def test_a_forbidden_sign_forbids_all_of_it_and_nothing_else() -> None:
    m = memory(Nav2Dwb)
    for c, sign, speed in itertools.product(range(3), (1.0, -1.0), (1e-6, 0.5, -1e-6, -0.5)):
        m["forbidden"] = 0.0
        m["forbidden"][0, c] = sign
        for axis in range(3):
            assert oscillates(m, *(speed * np.eye(3)[axis])) == (axis == c and speed * sign > 0.0)


# At the wheel.


@pytest.mark.parametrize("robot", ["p3dx", "omni4"])
@pytest.mark.parametrize("open_loop", [False, True])
@pytest.mark.parametrize("sense", [1.0, -1.0])
def test_samples_start_where_the_robot_is_when_it_drives_them(robot: str, open_loop: bool, sense: float) -> None:
    """A period on at the measured twist, at what the last command makes of that; in an open loop here, at the last."""
    briefing = briefing_of(robot)
    policy = Nav2Mppi(samples=16, acceleration=0.5, yaw_acceleration=0.8, open_loop=open_loop)
    sideways = float(briefing.robot.holonomic)
    measured, last = np.array([0.3, 0.1 * sideways, -0.4]), sense * np.array([0.1, 0.2 * sideways, 0.5])
    kept = policy.reset(briefing)
    kept["state"]["command"] = last
    free = scan(briefing.beam_angles, [])
    policy.act(observed(briefing, free, twist=measured[list(briefing.robot.twist_axes)]), briefing, kept)
    x, y, heading, now = 0.0, 0.0, 0.0, last
    if not open_loop:
        x, y, heading = integrate_arc(0.0, 0.0, 0.0, *measured, 0.05)
        now = np.clip(last, measured - 0.05 * np.array([0.5, 0.5, 0.8]), measured + 0.05 * np.array([0.5, 0.5, 0.8]))
    x += 0.05 * (math.cos(heading) * now[0] - math.sin(heading) * now[1])
    y += 0.05 * (math.sin(heading) * now[0] + math.cos(heading) * now[1])
    samples = Samples.of(nav2_mppi.drawn(0, 16, 56, 0.2, 0.4))
    np.testing.assert_allclose(samples.places[:, 0], np.tile([x, y, heading + 0.05 * now[2]], (16, 1)), atol=1e-9)


def test_the_goal_counts_once_little_is_left_of_the_way() -> None:
    none = dict.fromkeys(("gamma", "constraint", "cost", "goal_angle", "path_align", "path_follow", "path_angle"), 0.0)
    briefing, policy = briefing_of("p3dx"), Nav2Mppi(samples=16, prefer_forward=0.0, **none)  # type: ignore[arg-type]
    kept, free = policy.reset(briefing), scan(briefing.beam_angles, [])
    for x, counts in ((0.0, False), (0.3, False), (0.5, False), (0.7, True), (1.1, True), (1.6, True)):
        seen = observed(briefing, free, (2.0 - x, 0.0))._replace(pose=np.array([[x, 0.0, 0.0]]))
        policy.act(seen, briefing, kept)
        assert Samples.of(nav2_mppi.drawn(0, 16, 56, 0.2, 0.4)).costs.any() == counts
    assert kept["state"]["plans"][0] == 1


def test_after_a_recovery_nothing_is_left_of_the_plan_before_it() -> None:
    briefing, policy = briefing_of("p3dx"), Nav2Mppi(samples=16)
    kept = policy.reset(briefing)
    state = kept["state"]
    state["recovering"], state["recovering_until"] = SPIN, 20
    state["sequence"], state["history"] = 0.3, 0.3
    twist = policy.act(observed(briefing, scan(briefing.beam_angles, [])), briefing, kept)
    assert twist.tolist() == [[0.0, 1.0]]
    assert not state["sequence"].any()
    assert not state["history"].any()


@every_controller
def test_who_has_no_way_stands_still(controller: Any) -> None:
    briefing = briefing_of("p3dx")
    policy = controller()
    shut = scan(briefing.beam_angles, [(0.27, -1.0, 0.27, 1.0), (-0.27, -1.0, -0.27, 1.0), (-1.0, 0.27, 1.0, 0.27),
                                       (-1.0, -0.27, 1.0, -0.27)])  # fmt: skip
    kept = policy.reset(briefing)
    recoveries = []
    for _ in range(7):
        assert not policy.act(observed(briefing, shut), briefing, kept).any()
        recoveries.append(int(kept["state"]["recoveries"][0]))
    assert recoveries == [0, 0, 0, 0, 0, 0, 1]  # Nav2's failure tolerance: 0.3 s, of 0.05 s each
    kept = policy.reset(briefing)
    kept["state"]["stuck"] = 5
    policy.act(observed(briefing, scan(briefing.beam_angles, [])), briefing, kept)
    assert kept["state"]["stuck"][0] == 0  # only such a time without a break counts


@every_controller
@pytest.mark.parametrize("robot", ["p3dx", "omni4"])
def test_it_drives_around_a_block_to_its_goal(controller: Any, robot: str, tmp_path: Path) -> None:
    block = {"kind": "circle", "x": 2.0, "y": 0.1, "radius": 0.5}
    poses, info = drive(controller(), {"goal": [4, 0, 0], "obstacles": [block]}, robot, tmp_path, 600)
    assert info["success"]
    assert len(poses) > 20


@pytest.mark.parametrize(
    ("controller", "wrong", "words"),
    [
        (Nav2Mppi, {"prune_distance": 9.0}, "prune_distance must be at most 4 m, got 9.0"),
        (Nav2Dwb, {"prune_distance": 9.0}, "prune_distance must be at most 4 m, got 9.0"),
        (Nav2Mppi, {"inflation_radius": 3.0}, r"inflation_radius must be at most 1\.275 m, got 3\.0"),
        (Nav2Dwb, {"turns": 1}, "turns must be a whole number"),
    ],
)
def test_gains_out_of_range_are_named(controller: Any, wrong: dict[str, Any], words: str) -> None:
    with pytest.raises(ValueError, match=words):
        controller(**wrong)


def test_a_goal_that_jumps_by_more_than_half_a_cell_is_planned_for_at_once() -> None:
    briefing = briefing_of("p3dx")
    policy, free = Nav2Dwb(), scan(briefing.beam_angles, [])
    for jump, anew in (
        ((0.05, 0.0), True), ((-0.05, 0.0), True), ((0.0, 0.05), True), ((0.0, -0.05), True), ((0.03, -0.03), True),
        ((0.03, 0.0), False), ((0.0, -0.03), False),
    ):  # fmt: skip
        kept = policy.reset(briefing)
        for k in range(3):
            goal = (2.0 + jump[0] * (k > 0), 1.0 + jump[1] * (k > 0))
            policy.act(observed(briefing, free, goal), briefing, kept)
        assert kept["state"]["plans"][0] == (2 if anew else 1)


def test_it_plans_once_a_second() -> None:
    briefing = briefing_of("p3dx")
    policy, free = Nav2Dwb(), scan(briefing.beam_angles, [])
    kept, plans = policy.reset(briefing), []
    for _ in range(50):
        policy.act(observed(briefing, free), briefing, kept)
        plans.append(int(kept["state"]["plans"][0]))
    assert plans == [1] * 20 + [2] * 20 + [3] * 10  # of 0.05 s each


@pytest.mark.parametrize("left", [0.0, 1.0])
def test_only_the_last_goal_is_arrived_at(left: float) -> None:
    briefing = briefing_of("p3dx")
    policy, seen = Nav2Dwb(), observed(briefing, scan(briefing.beam_angles, []), (0.05, 0.0))
    kept = policy.reset(briefing)
    policy.act(seen._replace(waypoints_left=np.full(1, left)), briefing, kept)
    assert (kept["state"]["near"][0], kept["state"]["rotating"][0]) == ((1, 1) if left == 0.0 else (0, 0))


@pytest.mark.parametrize(("away", "counts"), [(0.12, True), (0.08, False)])
def test_the_nose_keeps_to_the_plan_until_it_would_be_past_its_end(away: float, counts: bool) -> None:
    briefing = briefing_of("p3dx")
    seen, asked = observed(briefing, scan(briefing.beam_angles, []), (0.0, away)), []
    for weight in (0.0, 1.0):
        policy = Nav2Dwb(tolerance=0.01, path_distance=0.0, goal_distance=0.0, goal_align=0.0, path_align=weight)
        asked.append(policy.act(seen, briefing, policy.reset(briefing))[0].tolist())
    assert (asked[0] != asked[1]) == counts


def test_dwb_heads_for_the_last_place_of_the_plan_that_its_local_costmap_holds() -> None:
    """The plan leads straight to the goal, and leaves a square of 1.5 m around the robot on the left."""
    alone = dict.fromkeys(("obstacle", "path_distance", "path_align", "goal_align"), 0.0)
    policy, briefing = Nav2Dwb(window=1.5, sideways=21, max_yaw_rate=0.01, **alone), briefing_of("omni4")
    seen = observed(briefing, scan(briefing.beam_angles, []), (1.0, 3.0))
    twist = policy.act(seen, briefing, policy.reset(briefing))[0]
    assert policy.horizon * twist[:2] == pytest.approx([0.25, 0.75], abs=0.1)
