"""Two processes that talk by ROS 2 on this machine: a simulated robot, and who drives it."""

# ruff: noqa: E402  what needs rclpy is imported behind the reason for its absence

import contextlib
import json
import math
import os
import random
import re
import signal
import subprocess
import sys
import threading
import time

import pytest

pytestmark = pytest.mark.ros
rclpy = pytest.importorskip("rclpy", reason="rclpy is not installed: ROS 2 by apt, or the extra [ros]")
pytest.importorskip("geometry_msgs", reason="geometry_msgs is not installed")

import numpy as np
from builtin_interfaces.msg import Time
from geometry_msgs.msg import PoseStamped, PoseWithCovarianceStamped, Twist, TwistStamped
from nav_msgs.msg import OccupancyGrid, Odometry, Path
from rclpy.context import Context
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from rclpy.serialization import serialize_message
from rclpy.signals import SignalHandlerOptions
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import LaserScan
from std_msgs.msg import Bool, String

from wayfield.bridges.ros.messages import path_of

BEST_EFFORT = QoSProfile(depth=5, reliability=ReliabilityPolicy.BEST_EFFORT)
LATCHED = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
# s: timeout, the way down from 0.22 m/s at 1 m/s^2, three lags of 0.1 s, 0.1 s
STANDSTILL = 0.5 + 0.22 + 0.3 + 0.1


class Bench:
    """A domain of its own: processes of `wayfield ros`, and a node that listens and speaks."""

    def __init__(self, stack, name="bench"):
        self._stack = stack
        self.lines = {}
        self.context = Context()
        rclpy.init(context=self.context, signal_handler_options=SignalHandlerOptions.NO)
        self.node = Node(name, context=self.context)
        self._executor = SingleThreadedExecutor(context=self.context)
        self._executor.add_node(self.node)
        self.got = {}
        threading.Thread(target=self._spin, daemon=True).start()
        stack.callback(self.close)

    def _spin(self):
        with contextlib.suppress(Exception):
            self._executor.spin()

    def close(self):
        self._executor.shutdown(timeout_sec=1.0)
        self.node.destroy_node()
        rclpy.try_shutdown(context=self.context)

    def start(self, *words):
        """Starts `wayfield ros WORDS` and collects its lines."""
        command = [sys.executable, "-u", "-m", "wayfield.command", "ros", *words]
        process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True)
        lines = self.lines[process.pid] = []

        def read():
            lines.extend(iter(process.stdout.readline, ""))

        threading.Thread(target=read, daemon=True).start()
        self._stack.callback(finish, process)
        return process

    def said(self, process):
        return "".join(self.lines[process.pid])

    def until(self, holds, seconds=60.0):
        end = time.monotonic() + seconds
        while not holds():
            assert time.monotonic() < end, {pid: "".join(lines)[-2000:] for pid, lines in self.lines.items()}
            time.sleep(0.005)

    def hears(self, kind, topic, qos=10):
        """Returns the list of (monotonic time, message) that grows as messages come."""
        found = []
        self.node.create_subscription(kind, topic, lambda message: found.append((time.monotonic(), message)), qos)
        return found

    def speaks(self, kind, topic, qos=10):
        publisher = self.node.create_publisher(kind, topic, qos)
        return publisher.publish


class HandMade:
    """A robot made by hand, which publishes odometry and scans best effort."""

    def __init__(self, bench):
        self._scans, self._odoms = (
            bench.speaks(LaserScan, "scan", BEST_EFFORT),
            bench.speaks(Odometry, "odom", BEST_EFFORT),
        )

    def says(self, seconds, ranges, beams, x):
        """Publishes a pose and a scan of a time (s), whose angles are those of a number of beams."""
        now = Time(sec=int(seconds), nanosec=int(1e9 * (seconds % 1.0)))
        odom = Odometry()
        odom.header.stamp, odom.header.frame_id = now, "odom"
        odom.pose.pose.position.x, odom.pose.pose.orientation.w = x, 1.0
        self._odoms(odom)
        scan = LaserScan(angle_increment=2.0 * math.pi / beams, range_min=0.1, range_max=3.5, ranges=ranges)
        scan.angle_max = (beams - 1) * scan.angle_increment
        scan.header.stamp = now
        self._scans(scan)
        return now


def finish(process):
    """Asks a process to end, and kills it when it does not."""
    process.send_signal(signal.SIGINT)
    with contextlib.suppress(subprocess.TimeoutExpired):
        process.wait(10)
    process.kill()
    process.wait(10)


def alone(patch):
    """A domain on the loopback, by UDP: a killed process can leave shared memory locked, and who reads it hangs."""
    patch.setenv("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")
    patch.setenv("FASTDDS_BUILTIN_TRANSPORTS", "UDPv4")
    patch.setenv("ROS_DOMAIN_ID", str(random.randrange(100, 230)))


PUBLISHER = """
import time, rclpy
from rclpy.qos import QoSProfile
from std_msgs.msg import Bool
rclpy.init()
say = rclpy.create_node("probe").create_publisher(Bool, "probe", QoSProfile(depth=10)).publish
while True:
    say(Bool(data=True))
    time.sleep(0.05)
"""


@pytest.fixture(scope="module")
def network():
    """Skips where two processes of ROS 2 do not find each other on this machine."""
    with pytest.MonkeyPatch.context() as patch, contextlib.ExitStack() as stack:
        alone(patch)
        heard = Bench(stack, "listener").hears(Bool, "probe")
        process = subprocess.Popen([sys.executable, "-c", PUBLISHER])
        stack.callback(finish, process)
        limit = time.monotonic() + 30.0
        while not heard and time.monotonic() < limit:
            time.sleep(0.05)
    if not heard:
        pytest.skip("two processes do not find each other by ROS 2 here: its discovery needs UDP on the loopback")


@pytest.fixture
def bench(network, monkeypatch):
    alone(monkeypatch)
    with contextlib.ExitStack() as stack:
        yield Bench(stack)


def speed(message):
    return math.hypot(message.twist.twist.linear.x, message.twist.twist.linear.y)


def test_a_policy_drives_to_its_goal_in_lockstep_and_the_recording_is_read(bench, tmp_path):
    file = tmp_path / "drive.mcap"
    sim = bench.start(
        *("sim", "--seed", "3", "--scan-rate", "20", "--lockstep", "120", "--rate", "0", "--for", "25"),
        *("--record", str(file)),
    )
    bench.start("drive", "--goal", "1.0,0.5,0", "--arm", "--ros-args", "-p", "use_sim_time:=true")
    bench.until(lambda: sim.poll() is not None, 300.0)
    said = bench.said(sim)
    found = re.search(r"(\d+) of (\d+) scans answered.*; (\d+) late; (\d+) contacts", said)
    assert found, said
    answered, scans, late, contacts = map(int, found.groups())
    assert scans == 500
    assert answered == scans
    assert late <= 1  # the first, while the driver comes up
    assert contacts == 0
    rosbags = pytest.importorskip("rosbags.highlevel")
    topics = {}
    with rosbags.AnyReader([file]) as reader:
        for connection, _, raw in reader.messages():
            topics.setdefault(connection.topic, []).append(reader.deserialize(raw, connection.msgtype))
    assert len(topics["/odom"]) == len(topics["/ground_truth"]) == len(topics["/scan"]) == 500
    assert len(topics["/cmd_vel"]) >= 499
    last = topics["/odom"][-1].pose.pose
    assert math.hypot(last.position.x - 1.0, last.position.y - 0.5) < 0.1
    assert len(topics["/scan"][0].ranges) == 360


OWN = """
import dataclasses
import numpy as np
from wayfield.envs import goal_reaching

@dataclasses.dataclass(frozen=True)
class Straight:
    speed: float = 0.5
    knows = "sensors"
    observes = (goal_reaching.Observation,)

    def reset(self, briefing):
        return np.empty((briefing.num_envs, 0))

    def act(self, observation, briefing, memory):
        return np.column_stack([np.full(len(observation.goal), self.speed), np.zeros(len(observation.goal))])
"""


def test_a_class_of_ones_own_drives_no_faster_than_its_gain_and_the_limit(bench, tmp_path, monkeypatch):
    (tmp_path / "own_of_ros.py").write_text(OWN)
    monkeypatch.chdir(tmp_path)
    heard = bench.hears(TwistStamped, "cmd_vel")
    bench.start("sim", "--scenario", "open_fields")
    stamped = ("--goal", "5,0", "--arm", "--cmd-vel", "stamped", "--ros-args", "-p", "use_sim_time:=true")
    for gain, most, top in (("0.15", "1.0", 0.15), ("0.2", "0.1", 0.1)):
        driver = bench.start("drive", "--policy", f"own_of_ros:Straight speed={gain}", "--max-speed", most, *stamped)
        bench.until(lambda: max((m.twist.linear.x for _, m in heard), default=0.0) > 0.9 * top, 120.0)  # noqa: B023
        finish(driver)
        assert max(message.twist.linear.x for _, message in heard) <= top + 1e-9
        heard.clear()


def test_a_killed_driver_leaves_a_robot_that_stands_and_a_killed_robot_a_driver_that_says_zero(bench):
    truth = bench.hears(Odometry, "ground_truth")
    commands = bench.hears(TwistStamped, "cmd_vel")
    sim = bench.start("sim", "--seed", "3")
    words = ("drive", "--goal", "2.0,0.5", "--arm", "--cmd-vel", "stamped", "--ros-args", "-p", "use_sim_time:=true")
    first = bench.start(*words)
    bench.until(lambda: truth and speed(truth[-1][1]) > 0.1)
    first.kill()
    first.wait()
    killed, at = time.monotonic(), truth[-1][1].header.stamp
    bench.until(lambda: speed(truth[-1][1]) < 1e-3, 10.0)
    end = truth[-1][1].header.stamp
    # half a second for two processes that share the cores with others
    assert end.sec - at.sec + 1e-9 * (end.nanosec - at.nanosec) <= STANDSTILL + 0.5
    bench.start(*words)
    bench.until(lambda: commands and commands[-1][0] > killed + 0.5 and commands[-1][1].twist.linear.x > 0.05)
    sim.kill()
    killed = time.monotonic()
    bench.until(lambda: commands[-1][1].twist.linear.x == 0.0, 10.0)
    time.sleep(1.0)
    late = [each for when, each in commands if when > killed + 1.0]
    assert late
    assert all(each.twist.linear.x == each.twist.angular.z == 0.0 for each in late)


def test_nothing_moves_before_it_is_armed_and_the_emergency_stop_holds(bench):
    commands = bench.hears(Twist, "cmd_vel")
    states = bench.hears(String, "wayfield_drive/status")
    arm, estop = bench.speaks(Bool, "arm"), bench.speaks(Bool, "estop")
    goal = bench.speaks(PoseStamped, "goal_pose")
    bench.start("sim", "--seed", "3")
    driver = bench.start("drive", "--cmd-vel", "twist", "--ros-args", "-p", "use_sim_time:=true")

    def state():
        return json.loads(states[-1][1].data)["state"] if states else ""

    def sent(frame):
        message = PoseStamped()
        message.header.frame_id = frame
        message.pose.position.x, message.pose.orientation.w = 2.0, 1.0
        goal(message)

    bench.until(lambda: state() == "disarmed" and len(commands) > 20)
    bench.until(lambda: json.loads(states[-1][1].data)["scan_age"] is not None)
    sent("map")
    bench.until(lambda: "goal refused: its frame is 'map'" in bench.said(driver))
    sent("odom")
    bench.until(lambda: "goal (2.00" in bench.said(driver))
    time.sleep(0.5)
    assert all(each.linear.x == each.angular.z == 0.0 for _, each in commands)
    arm(Bool(data=True))
    bench.until(lambda: state() == "driving" and commands[-1][1].linear.x > 0.05)
    estop(Bool(data=True))
    bench.until(lambda: state() == "stopped" and commands[-1][1].linear.x == 0.0)
    count = len(commands)
    arm(Bool(data=True))
    bench.until(lambda: "arm refused" in bench.said(driver))
    estop(Bool(data=False))
    time.sleep(0.5)
    assert all(each.linear.x == 0.0 for _, each in commands[count:])
    arm(Bool(data=True))
    bench.until(lambda: commands[-1][1].linear.x > 0.05)
    driver.send_signal(signal.SIGTERM)
    driver.wait(60)
    assert commands[-1][1].linear.x == 0.0


def test_small_nodes_of_the_usual_kind_drive_the_robot_by_either_type(bench):
    """Drive until something is ahead, by `ranges[0]`; drive to a point, by odometry; each 20 lines, unaware of us."""
    truth, contacts = bench.hears(Odometry, "ground_truth"), bench.hears(Bool, "contact")
    say = bench.speaks(Twist, "cmd_vel")

    def obstacle_stop(scan):
        near = min([each for each in [*scan.ranges[-30:], *scan.ranges[:30]] if each > 0.0], default=0.0)
        message = Twist()
        message.linear.x = 0.2 if near > 0.5 else 0.0
        say(message)

    sim = bench.start("sim", "--seed", "3", "--rate", "5")
    subscription = bench.node.create_subscription(LaserScan, "scan", obstacle_stop, BEST_EFFORT)
    bench.until(lambda: len(truth) > 20 and speed(truth[-1][1]) > 0.15)
    bench.until(lambda: speed(truth[-1][1]) < 1e-3)
    bench.node.destroy_subscription(subscription)
    start = len(truth)

    with contextlib.ExitStack() as stack:
        other = Bench(stack, "other")  # one participant has one type a topic
        say_stamped = other.speaks(TwistStamped, "cmd_vel")

        def back_up(odometry):
            del odometry
            message = TwistStamped()
            message.twist.linear.x, message.twist.angular.z = -0.1, 0.3
            say_stamped(message)

        other.node.create_subscription(Odometry, "odom", back_up, 10)
        bench.until(lambda: speed(truth[-1][1]) > 0.05 and len(truth) > start + 20)
        assert not any(each.data for _, each in contacts)
        bench.until(lambda: "2 nodes publish /cmd_vel: /bench, /other" in bench.said(sim))


def test_what_a_robot_says_wrong_stops_it_with_a_line_and_it_drives_on_afterwards(bench):
    """A robot made by hand, which publishes best effort and stamps by a clock of its own."""
    commands, made = bench.hears(TwistStamped, "cmd_vel"), HandMade(bench)
    tell = bench.speaks(Clock, "clock", BEST_EFFORT)
    driver = bench.start(
        *("drive", "--goal", "2,0", "--arm", "--cmd-vel", "stamped"),
        *("--ros-args", "-p", "use_sim_time:=true", "-p", "max_speed:=0.1", "-p", "base_frame_id:=base_link"),
    )
    clock = 100.0

    def robot(ranges, holds, back=0.0, beams=180, x=0.0, seconds=60.0):
        """Goes on until something holds."""
        nonlocal clock
        clock -= back
        end, first = time.monotonic() + seconds, len(commands)
        while not holds([each.twist.linear.x for _, each in commands[first:]]):
            assert time.monotonic() < end, (bench.said(driver)[-2000:], commands[-1:])
            clock += 0.05
            tell(Clock(clock=made.says(clock, ranges, beams, x)))
            time.sleep(0.05)

    def said(text):
        return lambda speeds: text in bench.said(driver) and 0.0 in speeds

    def drives(speeds):
        return bool(speeds) and speeds[-1] > 0.05

    free = [3.0] * 180
    robot(free, drives)
    robot([math.nan] * 180, said("nothing to say of 100 % of what is ahead"))
    robot(free, drives)
    robot(free, said("scan has 180 ranges, but angle_min, angle_max and angle_increment imply 90.0"), beams=90)
    robot(free, drives)
    robot(free, said("the clock jumped by -1.9"), back=2.0)
    robot(free, drives)
    robot(free, said("the pose jumped"), x=1.0)
    robot(free, drives, x=1.0)
    robot([0.2] * 180, lambda speeds: speeds and speeds[-1] < 0.01, x=1.0)  # the guard: a wall is at the hull
    assert max(each.twist.linear.x for _, each in commands) <= 0.1 + 1e-9
    assert commands[-1][1].header.frame_id == "base_link"


@pytest.mark.parametrize(
    "qos", [QoSProfile(depth=10), LATCHED, BEST_EFFORT], ids=["ordinary", "latched", "best_effort"]
)
def test_an_emergency_stop_of_any_publisher_is_heard_and_rclpy_raises_no_alarm(bench, capfd, qos):
    states, say = bench.hears(String, "wayfield_drive/status"), bench.speaks(Bool, "estop", qos)
    if qos is LATCHED:
        say(Bool(data=True))  # before the driver is there
    driver = bench.start("drive", "--goal", "2,0", "--arm")

    def stopped():
        if qos is not LATCHED:
            say(Bool(data=True))
        return states and "estop" in states[-1][1].data

    bench.until(stopped)
    driver.send_signal(signal.SIGINT)
    driver.wait(60)
    assert "incompatible" not in bench.said(driver) + "".join(capfd.readouterr())


# wakes 200 times a second on one processor, and says when it was late, by how much (s)
WATCH = """
import os, sys, time
os.sched_setaffinity(0, {int(sys.argv[1])})
due = time.time()
while True:
    due += 0.005
    time.sleep(max(0.0, due - time.time()))
    if (late := time.time() - due) > 0.005:
        print(due, late, flush=True)
        due += late
"""


@contextlib.contextmanager
def watched():
    """Yields a list of when (s) the machine itself ran nothing on one of its processors, and for how long (s)."""
    words = [sys.executable, "-c", WATCH]
    watches = [
        subprocess.Popen([*words, str(cpu)], stdout=subprocess.PIPE, text=True) for cpu in os.sched_getaffinity(0)
    ]
    stalls = []
    try:
        yield stalls
    finally:
        for each in watches:
            each.kill()
            stalls.extend(tuple(map(float, line.split())) for line in each.communicate()[0].splitlines())


def test_commands_come_at_their_rate_while_long_paths_do(bench):
    """The largest gap is two periods, without the time that the machine gave to others: plans in the way took 0.6 s."""
    commands, made = bench.hears(TwistStamped, "cmd_vel"), HandMade(bench)
    path = Path()
    path.header.frame_id = "odom"
    points = [[0.01 * k, math.sin(0.005 * k)] for k in range(20_000)]
    for x, y in points:
        pose = PoseStamped()
        pose.header.frame_id = "odom"
        pose.pose.position.x, pose.pose.position.y = x, y
        path.poses.append(pose)
    content = serialize_message(path)
    frame, found = path_of(content)
    assert (frame, found.tolist()) == ("odom", points)
    send = bench.speaks(Path, "path")
    driver = bench.start(
        "drive", "--policy", "pure_pursuit", "--path", "topic", "--arm", "--cmd-vel", "stamped", "--max-speed", "0.1"
    )
    bench.until(lambda: "ready" in bench.said(driver))
    begun, due = None, time.monotonic()
    end = due + 120.0
    with watched() as stalls:
        while begun is None or due < begun + 8.0 or bench.said(driver).count("path of 20000 points") < 5:
            assert due < end, bench.said(driver)
            if "path of 20000 points" in bench.said(driver) and begun is None:
                begun = due
                first = len(commands)
            if round(20.0 * (due - (begun or 0.0))) % 20 == 0:
                send(content)
            made.says(time.time(), [3.0] * 180, 180, 0.0)
            due += 0.05
            time.sleep(max(0.0, due - time.monotonic()))
    stamps = np.array([each.header.stamp.sec + 1e-9 * each.header.stamp.nanosec for _, each in commands[first:]])
    assert len(stamps) > 100
    at = np.rint(1e3 * (stamps - stamps[0])).astype(int)  # ms
    ran = np.ones(at[-1], int)
    for since, seconds in stalls:
        begin, stop = np.clip(np.rint(1e3 * (since - stamps[0] + np.array([0.0, seconds]))), 0, at[-1]).astype(int)
        ran[begin:stop] = 0
    assert np.add.reduceat(ran, at[:-1]).max() <= 100
    assert commands[-1][1].twist.linear.x > 0.05


def test_a_simulated_robot_on_a_map_is_put_elsewhere_and_takes_commands_of_any_publisher(bench, tmp_path):
    (tmp_path / "hall.pgm").write_bytes(b"P5 40 20 255 " + bytes(254 if 2 < k % 40 < 37 else 0 for k in range(800)))
    file = tmp_path / "hall.yaml"
    file.write_text(
        "image: hall.pgm\nresolution: 0.1\norigin: [0.0, 0.0, 0.0]\n"
        "negate: 0\noccupied_thresh: 0.65\nfree_thresh: 0.196\n"
    )
    truth, odom, clock = (
        bench.hears(Odometry, "truth"),
        bench.hears(Odometry, "odom"),
        bench.hears(Clock, "clock", BEST_EFFORT),
    )
    sim = bench.start(
        *("sim", "--scenario", str(file), "--start", "1.0,1.0,0", "--substeps", "5", "--rate", "2"),
        *("--ros-args", "-r", "ground_truth:=truth", "-p", "base_frame_id:=base_link", "-p", "timeout:=1"),
    )
    bench.until(lambda: len(truth) > 5 and odom and len(clock) > 50)
    maps = bench.hears(OccupancyGrid, "map", LATCHED)
    put = bench.speaks(PoseWithCovarianceStamped, "initialpose")

    def sent(frame, x):
        message = PoseWithCovarianceStamped()
        message.header.frame_id = frame
        message.pose.pose.position.x, message.pose.pose.position.y, message.pose.pose.orientation.w = x, 1.0, 1.0
        put(message)

    bench.until(lambda: maps and bench.node.count_subscribers("initialpose"))
    info = maps[0][1].info
    assert (info.width, info.height, info.resolution) == (40, 20, pytest.approx(0.1))
    assert sum(each == 100 for each in maps[0][1].data) == 20 * 6
    sent("odom", 2.0)
    bench.until(lambda: "initialpose refused: its frame is 'odom'" in bench.said(sim))
    sent("map", 3.75)
    bench.until(lambda: "the hull does not fit there" in bench.said(sim))
    assert abs(truth[-1][1].pose.pose.position.x - 1.0) < 1e-3
    sent("map", 2.0)
    bench.until(lambda: abs(truth[-1][1].pose.pose.position.x - 2.0) < 1e-3)
    assert abs(odom[-1][1].pose.pose.position.x) < 1e-3
    assert odom[-1][1].child_frame_id == "base_link"
    stamps = [each.clock.sec + 1e-9 * each.clock.nanosec for _, each in clock]
    assert np.diff(stamps[-50:]).min() == pytest.approx(0.01, abs=1e-6)
    say = bench.speaks(Twist, "cmd_vel", BEST_EFFORT)

    def drives(vx, holds):
        message = Twist()
        message.linear.x = vx

        def spoken():
            say(message)
            return holds()

        bench.until(spoken)

    drives(0.1, lambda: speed(truth[-1][1]) > 0.05)
    assert "/bench publishes /cmd_vel best effort" in bench.said(sim)
    drives(math.nan, lambda: speed(truth[-1][1]) < 1e-3)
    sim.send_signal(signal.SIGINT)
    sim.wait(60)
    bench.until(lambda: "commands not finite" in bench.said(sim))
    assert "; 0 commands not finite" not in bench.said(sim)


def test_a_script_is_driven_recorded_and_left(bench, tmp_path):
    world, file = tmp_path / "wall.json", tmp_path / "excite.mcap"
    wall = {"kind": "wall", "x1": 3.0, "y1": -3.0, "x2": 3.0, "y2": 3.0}
    world.write_text(json.dumps({"goal": [1.0, 2.0, 0.0], "obstacles": [wall]}))
    bench.start("sim", "--scenario", str(world), "--rate", "0", "--scan-rate", "20", "--lockstep", "120")
    script = bench.start(
        *("excite", "--seconds", "20", "--space", "0.4", "--top-speed", "0.2", "--arm", "--record", str(file)),
        *("--ros-args", "-p", "use_sim_time:=true"),
    )
    bench.until(lambda: script.poll() is not None, 300.0)
    assert script.returncode == 0, bench.said(script)
    assert "done" in bench.said(script)
    rosbags = pytest.importorskip("rosbags.highlevel")
    with rosbags.AnyReader([file]) as reader:
        found = {connection.topic: connection.msgcount for connection in reader.connections}
        speeds = [reader.deserialize(raw, each.msgtype).twist.linear.x for each, _, raw in reader.messages(
            [each for each in reader.connections if each.topic == "/cmd_vel"])]  # fmt: skip
    assert set(found) == {"/cmd_vel", "/odom", "/scan"}
    assert min(speeds) < -0.05
    assert max(speeds) > 0.05
