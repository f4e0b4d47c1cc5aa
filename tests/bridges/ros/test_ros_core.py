"""What a driven robot is asked for, without ROS: conventions of scans, states, limits, what no message may cause."""

import dataclasses
import importlib.util
import itertools
import math
import random
import struct

import click
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from wayfield.bridges.ros.command import Numbers, main
from wayfield.bridges.ros.conventions import AHEAD, Outgoing, Sight, fault_of, read
from wayfield.bridges.ros.guard import Decision, Driver, Limits
from wayfield.bridges.ros.messages import STILL, Odometry, Scan, Twist, path_of, quaternion_of, yaw_of
from wayfield.envs.robots import ROBOTS
from wayfield.system.extras import installs

BURGER = ROBOTS["turtlebot3"]


def scan_of(ranges, stamp=0.0, first=-math.pi, turn=1, range_min=0.1, range_max=3.5):
    """Returns a scan of a full circle from an angle on, one way round or the other."""
    ranges = np.asarray(ranges, float)
    step = turn * 2.0 * math.pi / len(ranges)
    return Scan(stamp, first, first + (len(ranges) - 1) * step, step, range_min, range_max, ranges)


def sight(beams=360, max_range=3.5, **kwargs):
    return Sight(np.linspace(-math.pi, math.pi, beams, endpoint=False), max_range, **kwargs)


def seen(scan, eye=None, pose=(0.0, 0.0, 0.0)):
    """Returns the ranges that a policy reads of one scan, by whole degrees from -180 on."""
    eye = eye or sight()
    eye.enter(scan, pose)
    return eye.view(pose, scan.stamp).ranges


# conventions


@given(
    st.floats(-math.pi, math.pi),
    st.sampled_from([1, -1]),
    st.integers(60, 1000),
    st.integers(1, 5),
    st.sampled_from([36, 360]),
)
def test_a_hit_is_seen_where_it_is_whatever_the_scan_begins_with(first, turn, count, at, beams):
    """A wall's distance as a function of the angle is the same for every start, sign and number of beams."""
    angles = first + turn * 2.0 * math.pi / count * np.arange(count)
    ranges = 1.0 + 0.3 * np.cos(angles - at)
    found = seen(scan_of(ranges, first=first, turn=turn), sight(beams))
    true = 1.0 + 0.3 * np.cos(np.linspace(-math.pi, math.pi, beams, endpoint=False) - at)
    width = math.pi / beams + 2.0 * math.pi / count
    assert np.abs(found - true).max() <= 0.3 * width + 1e-9


def test_the_nearest_hit_of_a_sector_wins():
    ranges = np.full(720, np.inf)
    ranges[360], ranges[361] = 2.0, 1.0  # both nearest to beam 0 of 36
    assert seen(scan_of(ranges), sight(36))[18] == 1.0


@pytest.mark.parametrize("far", [False, True])
@pytest.mark.parametrize(
    ("told", "read_as", "is_hit"),
    [
        (np.inf, 3.5, False),
        (7.0, 3.5, False),
        (3.4, 3.4, True),
        (-np.inf, 0.1, True),
        (0.05, 0.1, True),
        (0.0, "no return", False),
        (-0.0, "no return", False),
        (np.nan, "no return", False),
        (-1.0, None, False),
    ],
)
def test_what_drivers_write_for_nothing_too_near_and_not_measured(told, read_as, is_hit, far):
    beams = read(scan_of([told]), 3.5, far)
    if read_as == "no return":
        read_as = 3.5 if far else None
    assert beams.distances.tolist() == ([] if read_as is None else [read_as])
    assert beams.is_hit.tolist() == ([] if read_as is None else [is_hit])


@pytest.mark.parametrize("scale", [100.0, 1000.0])
@pytest.mark.parametrize("limits", ["m", "scaled", "scaled from 0"])
def test_ranges_in_other_units_are_refused_and_never_read_as_free(scale, limits):
    rng = np.random.default_rng(0)
    for _ in range(50):  # rooms of 1.5 to 8 m, a lidar of 12 m
        ranges = rng.uniform(0.5, 1.0, 360) * rng.uniform(1.5, 8.0)
        lost = rng.random(360) < 0.2
        least, most = {"m": (0.1, 12.0), "scaled": (0.1 * scale, 12.0 * scale), "scaled from 0": (0.0, 12.0 * scale)}[
            limits
        ]
        ranges[lost] = rng.choice([0.0, math.inf, 65.535, 12.001])
        assert fault_of(scan_of(ranges, range_max=12.0)) == ""
        if limits == "scaled from 0" and scale < 1000.0:
            continue  # a lidar of 1,200 m on a plain has such scans
        assert "in mm or cm?" in fault_of(scan_of(ranges * scale, range_min=least, range_max=most))


def test_what_lies_beyond_range_max_alike_or_differently_is_no_other_unit():
    for far in (13.0, 65.535, 1e4, 3.4e38):
        assert fault_of(scan_of(np.full(360, far), range_max=12.0)) == ""
    assert fault_of(scan_of(np.linspace(13.0, 90.0, 360), range_max=12.0)) == ""


def test_a_scan_counts_as_none_where_its_sizes_do_not_agree_or_it_says_nothing_of_what_is_ahead():
    good = scan_of(np.full(360, 2.0))
    assert sight().fault(good) == ""
    assert "360 ranges" in fault_of(dataclasses.replace(good, angle_max=good.angle_max - 3.0 * good.angle_increment))
    assert sight().fault(dataclasses.replace(good, angle_max=good.angle_max + good.angle_increment)) == ""
    assert fault_of(dataclasses.replace(good, ranges=np.empty(0)))
    assert fault_of(dataclasses.replace(good, angle_increment=math.nan))
    assert fault_of(dataclasses.replace(good, range_max=0.0))
    assert "angle_min" in fault_of(
        dataclasses.replace(good, angle_min=1e9, angle_max=1e9 + good.angle_max - good.angle_min)
    )
    for n in (1, 2, 4):  # a ring of sonars sees too little of what is ahead
        turn = 2.0 * math.pi / n
        assert "rad apart" in sight().fault(Scan(1.0, 0.0, (n - 1) * turn, turn, 0.0, 3.5, np.full(n, math.inf)))
    angles = good.angle_min + good.angle_increment * np.arange(360)
    ahead = np.flatnonzero(np.abs(angles) <= AHEAD)
    for share, counts in ((0.4, True), (0.6, False)):
        ranges = good.ranges.copy()
        ranges[ahead[: int(share * len(ahead))]] = np.nan
        assert (sight().fault(dataclasses.replace(good, ranges=ranges)) == "") == counts


def test_a_scanner_that_is_mounted_elsewhere_sees_the_same_point():
    """A hit one metre ahead of a scanner that stands backward, 0.1 m behind the middle, is 1.1 m behind it."""
    ranges = np.full(360, np.inf)
    ranges[180] = 1.0
    found = seen(scan_of(ranges), sight(mount=(-0.1, 0.0, math.pi)))
    assert found[0] == pytest.approx(1.1)
    assert (found[1:] == 3.5).all()


def test_hits_move_with_odometry_and_stay_for_half_a_second_where_nothing_more_is_known():
    ranges = np.full(360, np.inf)
    ranges[180] = 2.0
    eye = sight()
    eye.enter(scan_of(ranges), (0.0, 0.0, 0.0))
    moved = eye.view((0.5, 0.0, math.pi / 2), 0.1)
    assert moved.ranges[90] == pytest.approx(1.5)  # to the right of the robot, which has turned left
    ranges[150:210] = np.nan
    eye.enter(scan_of(ranges, stamp=0.2), (0.5, 0.0, 0.0))
    kept = eye.view((0.5, 0.0, 0.0), 0.4)
    assert kept.ranges[180] == pytest.approx(1.5)
    assert np.abs(kept.hits - [1.5, 0.0]).max() < 1e-9
    assert kept.blind
    gone = eye.view((0.5, 0.0, 0.0), 0.6)
    assert gone.ranges[180] == 3.5
    assert gone.blind
    behind = np.full(360, 2.0)
    behind[:20] = np.nan
    eye.enter(scan_of(behind, stamp=9.0), (0.5, 0.0, 0.0))
    free = eye.view((0.5, 0.0, 0.0), 9.0)
    assert free.ranges[5] == 3.5
    assert not free.blind


@pytest.mark.parametrize("beams", [8, 9, 360, 361])
@pytest.mark.parametrize("first", [0.0, -math.pi])
def test_what_is_published_reads_back_as_it_was(beams, first):
    angles = np.linspace(-math.pi, math.pi, beams, endpoint=False)
    out = Outgoing(angles, 3.5, first)
    assert first <= out.angle_min + 1e-6 < first + out.increment
    assert out.angle_max == pytest.approx(out.angle_min + (beams - 1) * out.increment)
    # what many nodes pair with the ranges, of a message whose numbers are float32
    numbers = np.float32([out.angle_min, out.angle_max, out.increment])
    assert numbers.tolist() == [out.angle_min, out.angle_max, out.increment]
    assert len(np.arange(*numbers.tolist())) == beams
    ours = np.linspace(0.5, 3.5, beams).astype(np.float32)
    scan = Scan(0.0, out.angle_min, out.angle_max, out.increment, 0.0, 3.5, out.ranges(ours).astype(float))
    assert np.isinf(scan.ranges).sum() == 1  # the one that reads max_range
    assert np.allclose(seen(scan, sight(beams)), ours)


@settings(max_examples=40)
@given(st.sampled_from("<>"), st.lists(st.tuples(st.text(max_size=9), st.floats(-9, 9), st.floats(-9, 9)), max_size=9))
def test_a_path_is_read_from_the_bytes_of_its_message(order, poses):
    content, numbers = bytes([0, order == "<", 0, 0]), [0.0, 0.0, 0.0, 0.0, 1.0]

    def put(kind, *values):
        nonlocal content
        size = min(8, struct.calcsize(f"{order}{kind[-1]}"))
        content += bytes((4 - len(content)) % size) + struct.pack(f"{order}{kind}", *values)

    def header(frame):
        nonlocal content
        put("2I", 7, 8)
        put("I", len(frame.encode()) + 1)
        content += frame.encode() + b"\0"

    header("odom")
    put("I", len(poses))
    for frame, x, y in poses:
        header(frame)
        put("7d", x, y, *numbers)
    frame, points = path_of(content)
    assert (frame, points.tolist()) == ("odom", [[x, y] for _, x, y in poses])
    with pytest.raises(ValueError, match="path cannot be read"):
        path_of(content[: len(content) // 2])


@given(st.floats(-math.pi, math.pi))
def test_a_yaw_comes_back_from_its_quaternion(yaw):
    z, w = quaternion_of(yaw)
    assert math.isclose(math.cos(yaw_of(0.0, 0.0, z, w) - yaw), 1.0, abs_tol=1e-12)
    assert math.isnan(yaw_of(0.0, 0.0, 0.0, 0.0))


# limits


@given(st.floats(allow_nan=False), st.floats(allow_nan=False), st.sampled_from([0.1, math.inf]))
def test_a_twist_is_scaled_by_one_factor_to_what_the_base_can_do(v, w, most):
    limits = Limits(BURGER, max_speed=most)
    if not (math.isfinite(v) and math.isfinite(w)):
        return
    found = limits.within(Twist(v, 0.0, w))
    assert math.hypot(found.vx, found.vy) <= min(most, 0.22) + 1e-12
    wheels = BURGER.wheel_matrix @ np.array([found.vx, 0.0, found.yaw_rate])
    assert np.abs(wheels).max() <= BURGER.rated_wheel_speed * (1.0 + 1e-12)
    assert found.vx * w == pytest.approx(found.yaw_rate * v, rel=1e-9, abs=1e-9 * abs(v * w) + 1e-12)


@settings(max_examples=40)
@given(
    st.sampled_from(["turtlebot3", "p3dx", "jackal", "mir100"]),
    st.floats(0.3, 3.0),
    st.floats(-math.pi, math.pi),
    st.floats(-1.0, 1.0),
    st.floats(-1.0, 1.0),
)
def test_a_robot_under_the_guard_stops_before_a_wall(name, distance, bearing, forward, turn):
    """Whatever is asked for, a base that brakes as its sheet says never comes as near to a wall as its hull."""
    robot = ROBOTS[name]
    limits = Limits(robot)
    across = np.linspace(-4.0, 4.0, 161)
    normal = np.array([math.cos(bearing), math.sin(bearing)])
    wall = (robot.hull_radius + distance) * normal + across[:, None] * np.array([-normal[1], normal[0]])
    x = y = heading = v = w = 0.0
    dt, age = 0.02, 0.1
    asked = limits.within(Twist(forward * robot.max_twist[0], 0.0, turn * robot.max_twist[1]))
    behind = [(x, y, heading)] * 6  # where it was when the scan was made
    for _ in range(400):
        c, s = math.cos(behind[0][2]), math.sin(behind[0][2])
        rel = wall - behind[0][:2]
        hits = np.column_stack([c * rel[:, 0] + s * rel[:, 1], c * rel[:, 1] - s * rel[:, 0]])
        eye = sight()
        view = eye.view((0.0, 0.0, 0.0), 0.0)._replace(hits=hits, blind=False)
        command = limits.clear_of_obstacles(asked, view, age + dt)
        a, b = limits.acceleration * dt, limits.yaw_acceleration * dt
        v += min(max(command.vx - v, -a), a)
        w += min(max(command.yaw_rate - w, -b), b)
        heading += w * dt
        x, y = x + v * dt * math.cos(heading), y + v * dt * math.sin(heading)
        behind = [*behind[1:], (x, y, heading)]
        rel = wall - (x, y)
        c, s = math.cos(heading), math.sin(heading)
        body = np.column_stack([c * rel[:, 0] + s * rel[:, 1], c * rel[:, 1] - s * rel[:, 0]])
        if robot.hull_box is None:
            clear = np.hypot(*body.T).min() - robot.hull_radius
        else:
            apart = np.abs(body - (robot.hull_x, 0.0)) - 0.5 * np.array(robot.hull_box)
            clear = np.hypot(*np.maximum(apart, 0.0).T).min()
        assert clear > 0.0


# states


class Drives:
    """A mission that asks for what is put into it."""

    def __init__(self):
        self.asked = Twist(0.2, 0.0, 0.5)
        self.lacks = ""
        self.resets = 0
        self.arrived = False

    def reset(self):
        self.resets += 1

    def sent(self, twist):
        """Needs no note of it."""

    def decide(self, odometry, view):
        return Decision(self.asked, self.arrived)


class Bench:
    """A driver with a clock that stands still until it is moved, and a robot that sends good messages."""

    def __init__(self, armed=True, no_return=None, **kwargs):
        self.now = 100.0
        self.mission = Drives()
        self.said = []
        self.driver = Driver(
            self.mission,
            sight(8, no_return=no_return),
            Limits(BURGER),
            armed=armed,
            clock=lambda: self.now,
            say=self.said.append,
            **kwargs,
        )

    def odom(self, x=0.0, stamp=None, **other):
        good = Odometry(self.now if stamp is None else stamp, "odom", x, 0.0, 0.0)
        return self.driver.odometry(dataclasses.replace(good, **other), self.now)

    def scan(self, ranges=(3.0,) * 8, stamp=None):
        return self.driver.scan(scan_of(ranges, self.now if stamp is None else stamp), self.now)

    def pair(self, ranges=(3.0,) * 8, **kwargs):
        self.now += 0.05
        first = self.odom(**kwargs)
        second = self.scan(ranges)
        return second if second is not None else first

    def driving(self):
        for _ in range(5):
            found = self.pair()
        assert self.driver.state[0] == "driving"
        assert found.vx > 0.0
        return self


def test_nothing_moves_before_it_is_armed():
    bench = Bench(armed=False)
    assert [bench.pair() or STILL for _ in range(10)] == [STILL] * 10
    assert bench.driver.state[0] == "disarmed"
    assert bench.driver.tick() == STILL
    bench.driver.arm(True)
    assert bench.pair().vx > 0.0


def test_three_good_messages_of_both_come_before_the_first_command():
    bench = Bench()
    assert [(bench.pair() or STILL).vx > 0.0 for _ in range(4)] == [False, False, True, True]


@pytest.mark.parametrize("lost", ["scan", "odom"])
def test_a_source_that_stays_away_stops_the_robot_which_drives_on_by_itself_after_three(lost):
    bench = Bench().driving()
    for _ in range(10):
        bench.now += 0.05
        bench.odom() if lost == "scan" else bench.scan()
    bench.now += 0.01
    assert bench.driver.tick() == STILL
    assert bench.driver.state == ("waiting", f"no {lost} for 0.5 s")
    assert [(bench.pair() or STILL).vx > 0.0 for _ in range(4)] == [False, False, True, True]


def test_stamps_that_are_old_or_run_backward_count_as_not_received():
    bench = Bench().driving()
    assert bench.odom(stamp=bench.now - 0.4) is None
    assert bench.scan(stamp=bench.now - 0.02) is None
    assert any("run backward" in line for line in bench.said)
    for _ in range(12):
        bench.now += 0.05
        bench.odom()
        bench.scan(stamp=bench.now - 0.4)
    assert bench.driver.state[0] == "waiting"
    assert "old" in bench.driver.state[1] or "no scan" in bench.driver.state[1]


def test_clocks_that_are_constantly_apart_are_said_once_and_driven_by():
    bench = Bench()
    for _ in range(20):
        bench.now += 0.05
        bench.odom(stamp=bench.now + 40.0)
        found = bench.scan(stamp=bench.now + 40.0)
    assert found.vx > 0.0
    assert sum("clock is constantly -40.00 s off" in line for line in bench.said) == 2  # odom and scan


@pytest.mark.parametrize("by", [-10.0, 10.0])
def test_a_jump_of_the_clock_resets_memory_and_gives_zero_for_a_period(by):
    bench = Bench().driving()
    resets = bench.mission.resets
    assert bench.driver.clock_jumped(by) == STILL
    assert bench.mission.resets == resets + 1
    assert bench.driver.tick() == STILL
    assert bench.pair().vx > 0.0
    assert bench.driver.clock_jumped(0.5) is None


@pytest.mark.parametrize("name", ["x", "heading"])
def test_a_jump_of_the_pose_resets_memory_and_three_stop_the_robot_until_it_is_armed(name):
    bench = Bench().driving()
    for k in range(1, 4):
        resets = bench.mission.resets
        bench.now += 0.05
        assert bench.odom(**{name: float(k)}) == STILL
        assert bench.mission.resets == resets + 1
        for _ in range(4):
            bench.pair(**{name: float(k)})
        assert bench.driver.state[0] == ("stopped" if k == 3 else "driving")
    bench.driver.arm(True)
    for _ in range(4):
        bench.pair(**{name: 3.0})
    assert bench.driver.state[0] == "driving"


def test_the_emergency_stop_wants_false_and_then_arm():
    bench = Bench().driving()
    assert bench.driver.estop(True) == STILL
    assert (bench.pair() or STILL) == STILL
    bench.driver.arm(True)
    assert bench.driver.state == ("stopped", "estop")
    bench.driver.estop(False)
    assert bench.driver.state == ("stopped", "estop")
    bench.driver.arm(True)
    assert bench.pair().vx > 0.0


def test_what_is_not_finite_is_zero_and_three_in_a_row_stop_the_robot():
    bench = Bench().driving()
    bench.mission.asked = Twist(math.nan, 0.0, 0.0)
    assert bench.pair() == STILL
    bench.mission.asked = Twist(0.2, 0.0, 0.0)
    assert bench.pair().vx > 0.0
    bench.mission.asked = Twist(0.0, 0.0, math.inf)
    assert [bench.pair() for _ in range(3)] == [STILL] * 3
    assert bench.driver.state[0] == "stopped"


@pytest.mark.parametrize(
    "wrong",
    [
        *({name: value} for name in ("x", "y") for value in (math.nan, -math.inf, 1e300, -2e6)),
        {"heading": math.nan},
        *(
            {"twist": Twist(*(value * k for k in row))}
            for row in np.eye(3).tolist()
            for value in (math.nan, -1e300, 9.9)
        ),
    ],
    ids=str,
)
def test_odometry_that_no_robot_has_reaches_no_decision_and_stops_the_robot_with_a_reason(wrong):
    bench = Bench().driving()
    seen, decide = [], bench.mission.decide
    bench.mission.decide = lambda odometry, view: (seen.append(odometry), decide(odometry, view))[1]
    found = [bench.pair(**wrong) for _ in range(20)]
    for odometry in seen:
        assert odometry.is_finite
        assert abs(odometry.x) + abs(odometry.y) + abs(odometry.twist.vx) + abs(odometry.twist.yaw_rate) < 1.0
    assert found[-1] in (None, STILL)
    assert bench.driver.tick() == STILL
    state, why = bench.driver.state
    assert state == "waiting"
    assert why.startswith("odom")
    assert sum(line == why for line in bench.said) == 1
    assert [(bench.pair() or STILL).vx > 0.0 for _ in range(4)][-1]


def test_odometry_in_another_frame_stops_the_robot_until_the_first_is_back_and_it_is_armed():
    bench = Bench().driving()
    for _ in range(2):
        assert bench.odom(frame="map" * 99) == STILL
        state, why = bench.driver.state
        assert state == "stopped"
        assert why.startswith("odom's frame_id changed from 'odom' to 'mapmap")
        assert len(why) < 200
        assert (bench.pair() or STILL) == STILL
        bench.driver.arm(True)
    assert [(bench.pair() or STILL).vx > 0.0 for _ in range(4)][-1]


@pytest.mark.parametrize("told", [0.0, math.nan], ids=str)
@pytest.mark.parametrize("no_return", [None, "unknown", "far"])
def test_in_an_open_hall_a_lidar_that_is_silent_is_driven_by_where_the_user_says_so(told, no_return):
    """Else the robot stands, and one line names the option, unless the user has chosen."""
    bench = Bench(no_return=no_return)
    found = [bench.pair(ranges=(told,) * 8) or STILL for _ in range(20)]
    assert (found[-1].vx > 0.0) == (no_return == "far")
    lines = [line for line in bench.said if "--no-return far" in line]
    assert len(lines) == (no_return is None)
    if no_return != "far":
        state, why = bench.driver.state
        assert state == "waiting"
        assert "nothing to say of 100 % of what is ahead" in why


def test_a_lidar_that_is_silent_here_and_there_is_driven_by_with_one_line():
    bench = Bench()
    for k in range(20):
        found = bench.pair(ranges=(0.0,) * (1 + k % 2) + (3.0,) * (7 - k % 2))
    assert found.vx > 0.0
    assert ["--no-return far" in line for line in bench.said] == [True]
    careful = Bench()  # NaN beside +inf are errors by REP 117, no silence
    careful.pair(ranges=(math.nan, math.inf) + (3.0,) * 6)
    careful.pair(ranges=(math.nan, math.inf) + (3.0,) * 6)
    assert careful.said == []


def test_a_decision_that_fails_stops_the_robot_and_is_told():
    bench = Bench().driving()
    bench.mission.decide = lambda odometry, view: 1 // 0
    with pytest.raises(ZeroDivisionError):
        bench.pair()
    assert bench.driver.state[0] == "stopped"
    assert bench.driver.tick() == STILL


@pytest.mark.parametrize(("seconds", "moves", "late"), [(0.03, True, False), (0.09, True, True), (0.15, False, True)])
def test_a_decision_that_comes_late_is_told_and_one_that_comes_too_late_is_zero(seconds, moves, late):
    bench = Bench().driving()
    asked = bench.mission.asked

    def slow(odometry, view):
        bench.now += seconds
        return Decision(asked)

    bench.mission.decide = slow
    assert (bench.pair().vx > 0.0) == moves
    assert ("late" in bench.driver.state[1]) == late


def test_what_has_arrived_stands_until_it_has_a_new_goal():
    bench = Bench().driving()
    bench.mission.arrived = True
    assert bench.pair() == STILL
    assert bench.driver.state[0] == "arrived"
    bench.mission.arrived = False
    assert (bench.pair() or STILL) == STILL
    bench.driver.began()
    assert bench.pair().vx > 0.0


def test_slow_scans_are_driven_by_at_the_rate_of_odometry():
    bench = Bench()
    commands = 0
    for k in range(40):
        bench.now += 0.05
        commands += bench.odom(x=0.005 * k) is not None
        if k % 4 == 0:
            commands += bench.scan() is not None
    assert 25 <= commands <= 40


@pytest.mark.skipif(importlib.util.find_spec("rclpy") is not None, reason="rclpy is installed")
@pytest.mark.parametrize("name", ["sim", "drive", "excite"])
def test_without_ros_a_line_says_what_to_do(name, capsys):
    with pytest.raises(SystemExit) as found:
        main([name])
    assert found.value.code
    [line] = capsys.readouterr().err.strip().splitlines()
    assert "rclpy is missing" in line
    assert installs("ros") in line


# what no message may cause

MESSAGES = ("pair", "pair", "pair", "pair", "odom", "scan", "late", "early", "nan", "short", "unknown", "inside",
            "far", "back", "ahead", "estop", "free", "arm", "disarm", "new", "wild", "wait", "odd")  # fmt: skip


def random_messages(draw, count):
    """Drives a bench by random messages; fails where a command is beyond the limits or too long after a good pair."""
    bench = Bench(armed=draw.random() < 0.5)
    driver, x = bench.driver, 0.0
    last, before, good, armed_once = STILL, STILL, {"scan": -math.inf, "odom": -math.inf}, driver.armed

    def check(command):
        nonlocal last, before
        if command is not None:
            assert math.hypot(command.vx, command.vy) <= 0.22 + 1e-12
            assert abs(command.yaw_rate) <= 2.84
            wheels = BURGER.wheel_matrix @ np.array([command.vx, command.vy, command.yaw_rate])
            assert np.abs(wheels).max() <= BURGER.rated_wheel_speed * (1.0 + 1e-9)
            assert abs(command.vx) <= max(0.0, math.copysign(before.vx, before.vx * command.vx)) + 0.1 + 1e-12
            before = last = command
        if last != STILL:
            assert armed_once
            assert bench.now - min(good.values()) <= driver.timeout + 0.05 + 1e-9

    for kind in draw.choices(MESSAGES, k=count):
        wait = draw.uniform(0.05, 1.5) if kind == "wait" else draw.choice((0.001, 0.05, 0.05, 0.05, 0.2))
        while wait > 0.0:  # the watchdog ticks meanwhile
            bench.now += min(wait, 0.05)
            wait -= 0.05
            check(driver.tick())
        bench.mission.asked = Twist(draw.uniform(-1e3, 1e3), draw.uniform(-1, 1), draw.uniform(-9, 9))
        if kind == "wild":
            bench.mission.asked = Twist(*(draw.choice((math.nan, math.inf, 1e300, -1e300, 0.0)) for _ in range(3)))
        if kind in ("pair", "odom", "wild", "inside"):
            x += draw.uniform(0.0, 0.01)
            good["odom"] = bench.now
            check(bench.odom(x=x))
        if kind in ("pair", "scan", "wild"):
            good["scan"] = bench.now
            check(bench.scan())
        ranges = {"nan": (math.nan,) * 8, "short": (), "unknown": (0.0,) * 8, "inside": (0.01,) * 8}.get(kind)
        if ranges is not None:
            if kind == "inside":
                good["scan"] = bench.now
            scan = scan_of(ranges or [1.0] * 8, bench.now)
            check(driver.scan(scan if ranges else dataclasses.replace(scan, ranges=np.empty(0)), bench.now))
        if kind == "late":
            check(bench.scan(stamp=bench.now - 0.5))
            check(bench.odom(x=x, stamp=bench.now - 0.5))
        if kind == "early":
            check(bench.odom(x=x, stamp=bench.now + 5.0))
        if kind == "far":
            good["odom"] = bench.now
            x += draw.choice((-5.0, 5.0))
            check(bench.odom(x=x))
        if kind == "odd":
            odd = draw.choice(({"x": 1e300}, {"y": math.nan}, {"twist": Twist(0.0, 0.0, -1e300)}, {"frame": "map"}))
            assert (bench.odom(**{"x": x, **odd}) or STILL) == STILL
            last = STILL if "frame" in odd else last
        if kind in ("back", "ahead"):
            check(driver.clock_jumped(-3.0 if kind == "back" else 3.0))
        if kind in ("estop", "free"):
            check(driver.estop(kind == "estop"))
            if kind == "estop":
                assert last == STILL
        if kind in ("arm", "disarm"):
            armed_once |= kind == "arm"
            check(driver.arm(kind == "arm"))
            if kind == "disarm":
                assert last == STILL
        if kind == "new":
            driver.began()
        if draw.random() < 0.1:
            bench.mission.arrived = not bench.mission.arrived


def test_no_sequence_of_messages_yields_a_command_beyond_the_limits_or_after_the_last_good_pair():
    for seed in range(700):
        random_messages(random.Random(seed), 25)


@pytest.mark.slow
@pytest.mark.parametrize("part", range(10))
def test_no_sequence_of_very_many_does(part):
    for seed in itertools.islice(itertools.count(10_000 * (part + 1)), 10_000):
        random_messages(random.Random(seed), 25)


@pytest.mark.parametrize(
    ("text", "told"),
    [
        ("1", "must be X,Y or X,Y,HEADING"),
        ("1,a", "must be X,Y or"),
        ("1,0,90", "is more than a turn; degrees must be"),
    ],
)
def test_a_goal_that_is_none_is_refused_in_a_line(text, told):
    with pytest.raises(click.UsageError, match=told):
        Numbers("--goal", 2, "X,Y,HEADING").convert(text, None, None)
    assert Numbers("--goal", 2, "X,Y,HEADING").convert("1,0", None, None) == (1.0, 0.0)


@pytest.mark.skipif(importlib.util.find_spec("rclpy") is not None, reason="rclpy is installed")
@pytest.mark.parametrize(
    ("words", "told"),
    [
        (("drive", "--goal", "2000,500"), "--goal is 2000 m away, usual is at most 300"),
        (("drive", "--max-speed", "36"), "--max-speed is 36, usual is at most 10"),
        (("drive", "--max-yaw-rate", "90"), "--max-yaw-rate is 90, usual is at most 40"),
        (("drive", "--tolerance", "100"), "--tolerance is 100, usual is at most 5"),
        (("drive", "--turned", "10"), "--turned is 10, usual is at most 3.15"),
        (("excite", "--scan-pose", "100,0,0"), "--scan-pose is 100 m away, usual is at most 5"),
        (("sim", "--timeout", "500"), "--timeout is 500, usual is at most 60"),
        (("sim", "--lockstep", "200"), "--lockstep is 200, usual is at most 60"),
        (("sim", "--start", "1000,0,0"), "--start is 1000 m away, usual is at most 300"),
    ],
)
def test_options_in_other_units_are_doubted_in_a_line(words, told, capsys):
    with pytest.raises(SystemExit):
        main(list(words))
    first, last = capsys.readouterr().err.strip().splitlines()
    assert first == f"{words[0]}: {told}; units are m, s and rad"
    assert "rclpy is missing" in last
