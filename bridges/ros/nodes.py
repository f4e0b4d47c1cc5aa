"""The nodes: what connects body, driver and script with ROS 2. No other module imports rclpy."""

import array
import collections
import contextlib
import dataclasses
import gc
import importlib
import json
import math
import signal
import sys
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from typing import Any

import numpy as np
import rclpy
from builtin_interfaces.msg import Time
from geometry_msgs.msg import PoseStamped, PoseWithCovarianceStamped, TransformStamped, TwistStamped
from geometry_msgs.msg import Twist as TwistMessage
from nav_msgs.msg import OccupancyGrid
from nav_msgs.msg import Odometry as OdometryMessage
from nav_msgs.msg import Path as PathMessage
from numpy.typing import NDArray
from rcl_interfaces.msg import ParameterDescriptor
from rclpy.clock import Clock as RclClock
from rclpy.clock import ClockType, JumpThreshold
from rclpy.context import Context
from rclpy.duration import Duration
from rclpy.event_handler import SubscriptionEventCallbacks
from rclpy.exceptions import NameValidationException
from rclpy.executors import ExternalShutdownException, SingleThreadedExecutor
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from rclpy.serialization import serialize_message
from rclpy.signals import SignalHandlerOptions
from rclpy.validate_namespace import validate_namespace
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import LaserScan
from std_msgs.msg import Bool, String

from wayfield.bridges.ros.body import Body
from wayfield.bridges.ros.conventions import Outgoing
from wayfield.bridges.ros.driving import AlongPath, ToGoal
from wayfield.bridges.ros.guard import Driver
from wayfield.bridges.ros.messages import STILL, Goal, Odometry, Scan, Twist, path_of, quaternion_of, yaw_of
from wayfield.bridges.ros.recording import Recorder, definition
from wayfield.system.checks import shown

RELIABLE = QoSProfile(depth=10)
SENSORS = QoSProfile(depth=5, reliability=ReliabilityPolicy.BEST_EFFORT)
CLOCK = QoSProfile(depth=1, reliability=ReliabilityPolicy.BEST_EFFORT)
LATCHED = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
NEWEST = QoSProfile(depth=1)
_FORMER = 0.25  # s after a scan, within which a command of an older stamp belongs to a scan before
_UNMEASURED = 1e6  # variance of z, roll and pitch


def say(line: str) -> None:
    """Prints a line at once."""
    print(line, flush=True)


def time_of(seconds: float) -> Time:
    """Returns a stamp."""
    nanoseconds = round(1e9 * seconds)
    return Time(sec=nanoseconds // 10**9, nanosec=nanoseconds % 10**9)


def seconds_of(stamp: Time) -> float:
    """Returns a stamp in seconds."""
    return float(stamp.sec + 1e-9 * stamp.nanosec)


@contextlib.contextmanager
def stopping() -> Iterator[threading.Event]:
    """Yields an event that Ctrl-C and SIGTERM set; rclpy's own handlers would end a node before its last words."""
    stop = threading.Event()
    before = {each: signal.getsignal(each) for each in (signal.SIGINT, signal.SIGTERM)}
    for each in before:
        signal.signal(each, lambda *_: stop.set())
    try:
        yield stop
    finally:
        for each, handler in before.items():
            signal.signal(each, handler)


class Participant:
    """A context of its own with one node, whose callbacks run in a thread.

    Raises:
        ValueError: if what stands behind --ros-args, or the namespace, is nothing that ROS takes.
    """

    def __init__(self, name: str, ros_args: Sequence[str], namespace: str = "", **options: Any) -> None:
        self.context = Context()
        try:
            validate_namespace(f"/{namespace.lstrip('/')}")
            rclpy.init(args=list(ros_args), context=self.context, signal_handler_options=SignalHandlerOptions.NO)
            self.node = Node(name, context=self.context, namespace=namespace, **options)
        except RuntimeError as error:  # of rcl, whose classes are no public names
            line = str(error).splitlines()[0].partition(", at /")[0]
            raise ValueError(f"{' '.join(ros_args)}: {line}") from None
        except NameValidationException as error:
            raise ValueError(f"--namespace {namespace!r}: {str(error).splitlines()[0].rstrip(':')}") from None
        self._executor = SingleThreadedExecutor(context=self.context)
        self._executor.add_node(self.node)
        self._thread = threading.Thread(target=self._spin, name=name, daemon=True)

    def start(self) -> None:
        """Begins to take messages."""
        self._thread.start()

    def spin_once(self, seconds: float) -> None:
        """Takes a message in this thread, or waits as long for one."""
        self._executor.spin_once(timeout_sec=seconds)

    def _spin(self) -> None:
        with contextlib.suppress(ExternalShutdownException):
            self._executor.spin()

    def close(self) -> None:
        """Leaves the network."""
        self._executor.shutdown(timeout_sec=1.0)
        if self._thread.is_alive():
            self._thread.join(2.0)
        self.node.destroy_node()
        rclpy.try_shutdown(context=self.context)


def message_class(kind: str) -> Any:
    """Returns the class of a message type such as "std_msgs/Header"."""
    package, _, name = kind.partition("/")
    return getattr(importlib.import_module(f"{package}.msg"), name)


def parameter(node: Node, name: str, default: Any) -> Any:
    """Returns a parameter that --ros-args -p may set; a whole number does for a number.

    Raises:
        ValueError: if it is of another type than the default, or not finite.
    """
    value = node.declare_parameter(name, default, ParameterDescriptor(dynamic_typing=True)).value
    if type(default) is float and type(value) is int:
        value = float(value)
    if type(value) is not type(default) or (value != default and type(value) is float and not math.isfinite(value)):
        kind = {float: "a finite number", bool: "true or false", str: "text"}[type(default)]
        raise ValueError(f"parameter {name} is {value!r}; it must be {kind}")
    return value


class Outlet:
    """A publisher that records what it publishes where there is a recorder."""

    def __init__(self, node: Node, kind: Any, topic: str, qos: QoSProfile, recorder: Recorder | None) -> None:
        self._publisher = node.create_publisher(kind, topic, qos)
        self._recorder = recorder
        self._topic = self._publisher.topic_name
        if recorder is not None:
            package = kind.__module__.partition(".")[0]
            recorder.add(self._topic, f"{package}/msg/{kind.__name__}", definition(kind, message_class))

    def publish(self, message: Any, seconds: float) -> None:
        """Publishes a message of a time (s)."""
        if self._recorder is None:
            self._publisher.publish(message)
            return
        content = serialize_message(message)
        self._publisher.publish(content)
        self._recorder.write(self._topic, seconds, content)


class Tables:
    """Messages of odometry and scans, made once and filled anew."""

    def __init__(
        self, frames: tuple[str, str, str], outgoing: Outgoing | None, scan_period: float, noise: float
    ) -> None:
        self.odometry = OdometryMessage()
        self.odometry.child_frame_id = frames[1]
        spread = np.full(6, _UNMEASURED)
        spread[[0, 1, 5]] = max(noise, 1e-6)
        self.odometry.pose.covariance = np.diag(spread).ravel()
        self.odometry.twist.covariance = np.diag(spread).ravel()
        self.scan = LaserScan()
        if outgoing is not None:
            self.scan.header.frame_id = frames[2]
            self.scan.angle_min, self.scan.angle_max = outgoing.angle_min, outgoing.angle_max
            self.scan.angle_increment, self.scan.scan_time = outgoing.increment, scan_period
            self.scan.range_min, self.scan.range_max = 0.0, outgoing.max_range

    def odometry_of(self, odometry: Odometry, stamp: Time, frame: str) -> OdometryMessage:
        """Returns odometry as a message."""
        message = self.odometry
        message.header.stamp, message.header.frame_id = stamp, frame
        message.pose.pose.position.x, message.pose.pose.position.y = odometry.x, odometry.y
        message.pose.pose.orientation.z, message.pose.pose.orientation.w = quaternion_of(odometry.heading)
        fill(message.twist.twist, odometry.twist)
        return message


def fill(message: TwistMessage, twist: Twist) -> TwistMessage:
    """Returns a message that holds a twist."""
    message.linear.x, message.linear.y, message.angular.z = twist.vx, twist.vy, twist.yaw_rate
    return message


class Simulator:
    """A body that publishes scan, odometry, clock and truth, and drives by cmd_vel."""

    def __init__(self, body: Body, settings: Any, ros_args: Sequence[str], recorder: Recorder | None = None) -> None:
        self.body, self.settings = body, settings
        self._lock = threading.Condition()
        self._commands: list[tuple[float, float, Twist]] = []  # when it came by the wall, its stamp, what
        self._poses: list[tuple[float, float, float]] = []
        self._recorder = recorder
        args, where = list(ros_args), settings.namespace
        self._main = Participant("wayfield_sim", args, where)
        self._parts = [self._main]
        node = self._main.node
        self._parameters()
        if settings.cmd_vel in ("auto", "twist"):
            node.create_subscription(TwistMessage, "cmd_vel", self._twist, RELIABLE)
        if settings.cmd_vel in ("auto", "stamped"):
            # one participant refuses a second type on a topic
            second = self._main if settings.cmd_vel == "stamped" else Participant("wayfield_sim_stamped", args, where)
            second.node.create_subscription(TwistStamped, "cmd_vel", self._stamped, RELIABLE)
            if second is not self._main:
                self._parts.append(second)
        node.create_subscription(PoseWithCovarianceStamped, "initialpose", self._pose, RELIABLE)

        def outlet(kind: Any, topic: str, qos: QoSProfile = RELIABLE, record: Recorder | None = recorder) -> Outlet:
            return Outlet(node, kind, topic, qos, record)

        self._clock = None if settings.no_clock else outlet(Clock, "clock", CLOCK, None)
        self._odom = outlet(OdometryMessage, "odom")
        self._truth = outlet(OdometryMessage, "ground_truth")
        self._touch = outlet(Bool, "contact")
        self._outgoing = None
        if len(body.beam_angles):
            self._outgoing = Outgoing(body.beam_angles, body.max_range, self._angle_min)
            self._scan = outlet(LaserScan, "scan")
        self._tables = Tables(self._frames, self._outgoing, 1.0 / settings.scan_rate, settings.variance)
        self._truths = Tables(self._frames, None, 1.0, 0.0)
        self._topic = node.resolve_topic_name("cmd_vel")
        if recorder is not None:
            recorder.add(self._topic, "geometry_msgs/msg/TwistStamped", definition(TwistStamped, message_class))
        self._transforms = _transforms(self._main.node, self._frames, self._localises)
        if body.grid is not None:
            self._map = node.create_publisher(OccupancyGrid, "map", LATCHED)
            self._map.publish(_map_of(body.grid))
        self._rivals: tuple[str, ...] = ()
        self._said: set[str] = set()
        self._softer: set[str] = set()  # types of commands that are taken best effort besides
        # what stamps begin with: where there is no clock to follow, the wall's time
        self._epoch = time.time() if settings.no_clock else 0.0
        self.round_trips: list[float] = []  # s, from a scan to the first command after it
        self.scans = self.answered = self.late = 0
        self._begin: tuple[float, int] | None = None  # when the first command came, and at which step

    def _parameters(self) -> None:
        """Takes the parameters of --ros-args -p over the options."""
        node, settings = self._main.node, self.settings
        names = ("odom_frame_id", "base_frame_id", "scan_frame_id")
        odom, base, scan = (parameter(node, *each) for each in zip(names, settings.frames, strict=True))
        if not (odom and base and scan):
            raise ValueError(f"parameters {', '.join(names)} are {odom!r}, {base!r}, {scan!r}; none may be empty")
        self._frames: tuple[str, str, str] = (odom, base, scan)
        self._angle_min = parameter(node, "scan_start", float(settings.angle_min))
        self._localises = parameter(node, "publish_map_odom_tf", True)
        timeout = parameter(node, "timeout", float(self.body.timeout))
        if timeout < 0.05:
            raise ValueError(f"parameter timeout is {timeout:g}; it must be at least 0.05 s")
        self.body.timeout = timeout

    def _twist(self, message: TwistMessage) -> None:
        self._came(np.inf, message)

    def _stamped(self, message: TwistStamped) -> None:
        self._came(seconds_of(message.header.stamp), message.twist)

    def _came(self, stamp: float, message: TwistMessage) -> None:
        with self._lock:
            twist = Twist(message.linear.x, message.linear.y, message.angular.z)
            self._commands.append((time.monotonic(), stamp, twist))
            self._lock.notify()

    def _pose(self, message: PoseWithCovarianceStamped) -> None:
        pose, q = message.pose.pose, message.pose.pose.orientation
        if message.header.frame_id not in ("", "map"):
            say(f"initialpose refused: its frame is {shown(message.header.frame_id)}; it must be 'map'")
            return
        with self._lock:
            self._poses.append((pose.position.x, pose.position.y, yaw_of(q.x, q.y, q.z, q.w)))

    def run(self, stop: threading.Event) -> None:
        """Publishes, takes what comes until the next step is due, and steps, until it is stopped."""
        for part in self._parts:
            part.start()
        say("ready")
        body, settings = self.body, self.settings
        if self._transforms is not None:
            self._transforms.stand(body.map_to_odom, self._stamp())
        begin = due = time.monotonic()
        looked = begin
        period = body.dt / settings.rate if settings.rate > 0.0 else 0.0
        while not stop.is_set() and body.steps * body.dt < settings.seconds - 1e-9:
            published = self._publish()
            if settings.lockstep and published == published:
                self._await_answer(published, stop)
            for k in range(1, settings.substeps + 1):
                self._wait(due + k / settings.substeps * period, stop)
                if k < settings.substeps and self._clock is not None:
                    seconds = body.time + k / settings.substeps * body.dt
                    self._clock.publish(Clock(clock=time_of(seconds)), seconds)
            due += period
            self._take(published)
            body.step()
            now = time.monotonic()
            if period and now - due > 1.0:
                self._epoch += now - due if settings.no_clock else 0.0
                due = now  # the machine was busy: it does not make up for it in a burst
            if now - looked > 1.0:
                looked = now
                self._look_around()
        self._end = time.monotonic()
        self.wall = self._end - begin

    def _stamp(self) -> Time:
        return time_of(self._epoch + self.body.time)

    def _publish(self) -> float:
        """Publishes what is due at this step; returns when the scan went out, by the wall, NaN if none did."""
        body, settings = self.body, self.settings
        stamp, seconds = self._stamp(), self._epoch + body.time
        if self._clock is not None:
            self._clock.publish(Clock(clock=stamp), seconds)
        if body.steps % round(1.0 / (settings.odom_rate * body.dt)) == 0:
            odometry, truth = body.odometry, body.truth
            if self._transforms is not None:
                self._transforms.move(odometry, stamp)
            self._truth.publish(self._truths.odometry_of(truth, stamp, "map"), seconds)
            self._odom.publish(self._tables.odometry_of(odometry, stamp, self._frames[0]), seconds)
        if body.contact != getattr(self, "_touched", None):
            self._touched = body.contact
            self._touch.publish(Bool(data=body.contact), seconds)
        if self._outgoing is None or body.steps % round(1.0 / (settings.scan_rate * body.dt)):
            return float("nan")
        message = self._tables.scan
        message.header.stamp = stamp
        message.ranges = array.array("f", self._outgoing.ranges(body.ranges).tobytes())
        sent = time.monotonic()
        self._scan.publish(message, seconds)
        self.scans += 1
        return sent

    def _await_answer(self, published: float, stop: threading.Event) -> None:
        """Waits for an answer to the scan, as long as lockstep says."""
        until = published + self.settings.lockstep
        with self._lock:
            while not self._answers(published) and not stop.is_set() and time.monotonic() < until:
                self._lock.wait(min(0.1, max(0.0, until - time.monotonic())))
            self.late += not self._answers(published)

    def _wait(self, due: float, stop: threading.Event) -> None:
        """Waits until a time by the monotonic clock."""
        left = due - time.monotonic()
        if left > 0.0:
            stop.wait(left)
        elif not self.settings.lockstep:
            time.sleep(0.0)  # for the threads that take messages

    def _answers(self, published: float) -> bool:
        """Returns whether a command has come that knows this step's scan."""
        return any(
            came >= published and (stamp >= self.body.time - 1e-6 or came >= published + _FORMER)
            for came, stamp, _ in self._commands
        )

    def _take(self, published: float) -> None:
        """Hands what has come to the body."""
        with self._lock:
            commands, self._commands = self._commands, []
            poses, self._poses = self._poses, []
        if published == published:
            self._published = published
            self._open = True
        for came, _, twist in commands:
            self._begin = self._begin or (came, self.body.steps)
            if getattr(self, "_open", False):
                self._open = False
                self.answered += 1
                self.round_trips.append(came - self._published)
            self.body.command(twist)
            if self._recorder is not None:
                passed = (came - self._published) * self.settings.rate if published == published else 0.0
                at = self._epoch + self.body.time + min(max(passed, 0.0), 0.999 * self.body.dt)
                message = TwistStamped()
                message.header.stamp, message.header.frame_id = time_of(at), self._frames[1]
                fill(message.twist, twist)
                self._recorder.write(self._topic, at, serialize_message(message))
        for pose in poses:
            wrong = self.body.put(pose)
            if wrong:
                say(f"initialpose refused: {wrong}")
            elif self._transforms is not None:
                self._transforms.stand(self.body.map_to_odom, self._stamp())

    def _look_around(self) -> None:
        """Says what is wrong with the publishers of commands: there are several, or one has an incompatible QoS."""
        node = self._main.node
        publishers = node.get_publishers_info_by_topic(self._topic)
        names = _names_of(publishers)
        if len(names) > 1 and names != self._rivals:
            say(f"warning: {len(names)} nodes publish {self._topic}: {', '.join(names)}; stop all but one")
        self._rivals = names
        taken = {"twist": ("Twist",), "stamped": ("TwistStamped",)}.get(
            self.settings.cmd_vel, ("Twist", "TwistStamped")
        )
        for each in publishers:
            (name,), kind = _names_of([each]), each.topic_type.rpartition("/")[2]
            if kind not in taken:
                self._say_once(
                    f"warning: {name} publishes {self._topic} as {each.topic_type}; it must be {' or '.join(taken)}"
                )
            elif each.qos_profile.reliability == ReliabilityPolicy.BEST_EFFORT and kind not in self._softer:
                self._softer.add(kind)
                part, take = (self._parts[0], self._twist) if kind == "Twist" else (self._parts[-1], self._stamped)
                part.node.create_subscription(
                    TwistMessage if kind == "Twist" else TwistStamped, "cmd_vel", take, SENSORS
                )
                self._say_once(f"{name} publishes {self._topic} best effort: it is taken, and some may be lost")

    def _say_once(self, line: str) -> None:
        if line not in self._said:
            self._said.add(line)
            say(line)

    def summary(self) -> str:
        """Returns what became of the run, in a line."""
        body = self.body
        driven = body.steps * body.dt
        text = f"{driven:.1f} s in {self.wall:.1f} s ({driven / max(self.wall, 1e-9):.2f} times real time)"
        if self._begin is not None:
            begin, step = self._begin
            fast = (body.steps - step) * body.dt / max(self._end - begin, 1e-9)
            text += f", {fast:.2f} times from the first command on"
        if self.scans:
            text += f"; {self.answered} of {self.scans} scans answered"
        if self.round_trips:
            p50, p95, p99, most = (1e3 * np.percentile(self.round_trips, [50, 95, 99, 100])).tolist()
            text += f", in {p50:.1f} ms (p95 {p95:.1f}, p99 {p99:.1f}, most {most:.1f})"
        if self.settings.lockstep:
            text += f"; {self.late} late"
        return f"{text}; {body.contacts} contacts; {body.not_finite} commands not finite"

    def close(self) -> None:
        """Leaves the network, and ends the recording."""
        for part in self._parts:
            part.close()
        if self._recorder is not None:
            self._recorder.close()


def _map_of(grid: Any) -> OccupancyGrid:
    """Returns a grid of ours as a message."""
    message = OccupancyGrid()
    message.header.frame_id = "map"
    message.info.resolution = grid.resolution
    message.info.height, message.info.width = grid.shape
    x, y, yaw = grid.origin
    message.info.origin.position.x, message.info.origin.position.y = x, y
    message.info.origin.orientation.z, message.info.origin.orientation.w = quaternion_of(yaw)
    message.data = array.array("b", np.where(grid.occupied, 100, 0).astype(np.int8).tobytes())
    return message


def _names_of(publishers: Sequence[Any]) -> tuple[str, ...]:
    """Returns the full names of the nodes that publishers belong to."""
    return tuple(sorted({f"{each.node_namespace.rstrip('/')}/{each.node_name}" for each in publishers}))


class Transforms:
    """What publishes tf and tf_static: map -> odom as a localiser would, odom -> base, base -> scanner.

    Raises:
        ModuleNotFoundError: without tf2_msgs.
    """

    def __init__(self, node: Node, frames: tuple[str, str, str], localises: bool) -> None:
        from tf2_msgs.msg import TFMessage

        self._kind, self._frames, self._localises = TFMessage, frames, localises
        self._moving = node.create_publisher(TFMessage, "tf", QoSProfile(depth=100))
        self._standing = node.create_publisher(TFMessage, "tf_static", LATCHED)

    def stand(self, map_to_odom: tuple[float, float, float], stamp: Time) -> None:
        """Publishes what stands, until the robot is put elsewhere."""
        odom, base, scan = self._frames
        standing = [_transform(base, scan, (0.0, 0.0, 0.0), stamp)]
        if self._localises:
            standing.append(_transform("map", odom, map_to_odom, stamp))
        self._standing.publish(self._kind(transforms=standing))

    def move(self, odometry: Odometry, stamp: Time) -> None:
        """Publishes where odometry believes the robot to be."""
        odom, base, _ = self._frames
        moved = _transform(odom, base, (odometry.x, odometry.y, odometry.heading), stamp)
        self._moving.publish(self._kind(transforms=[moved]))


def _transform(parent: str, child: str, pose: tuple[float, float, float], stamp: Time) -> TransformStamped:
    message = TransformStamped()
    message.header.stamp, message.header.frame_id, message.child_frame_id = stamp, parent, child
    message.transform.translation.x, message.transform.translation.y = pose[:2]
    message.transform.rotation.z, message.transform.rotation.w = quaternion_of(pose[2])
    return message


def _transforms(node: Node, frames: tuple[str, str, str], localises: bool) -> Transforms | None:
    """Returns what publishes transforms; None without tf2_msgs, which it says."""
    try:
        return Transforms(node, frames, localises)
    except ModuleNotFoundError:
        say("tf2_msgs is not installed: nothing is published on tf; odom has the pose")
        return None


def simulate(body: Body, settings: Any, ros_args: Sequence[str], recorder: Recorder | None) -> None:
    """Runs a simulator until it is stopped, and prints what became of it."""
    simulator = Simulator(body, settings, ros_args, recorder)
    try:
        with stopping() as stop:
            simulator.run(stop)
        say(simulator.summary())
    finally:
        simulator.close()
        sys.stdout.flush()


class PathPlanner:
    """Makes worlds of the paths that come, in a thread of its own: commands do not wait for a long one.

    Args:
        course_of: from points (m) to a world; its ValueError says in a line why there is none.
    """

    def __init__(self, course_of: Callable[[NDArray[np.float64]], Any]) -> None:
        self._course_of = course_of
        self._came: collections.deque[bytes] = collections.deque(maxlen=1)  # the newest alone is worth a plan
        self._wake = threading.Event()
        self.ready: collections.deque[tuple[str, int, Any]] = collections.deque(maxlen=1)  # frame, points, course
        threading.Thread(target=self._plan, name="planner", daemon=True).start()

    def came(self, content: bytes) -> None:
        """Takes a nav_msgs/Path as it comes from the network."""
        self._came.append(content)
        self._wake.set()

    def _plan(self) -> None:
        while True:
            self._wake.wait()
            self._wake.clear()
            while self._came:
                frame, count = "", 0
                try:
                    frame, points = path_of(self._came.pop())
                    count = len(points)
                    course = self._course_of(points)
                except Exception as error:  # the node's thread says it, or ends of it
                    course = error
                self.ready.append((frame, count, course))


class DriverNode:
    """A driver that listens to scan, odom, goal_pose, path, estop and arm, and publishes cmd_vel and its status."""

    def __init__(
        self, driver: Driver, settings: Any, ros_args: Sequence[str], recorder: Recorder | None = None
    ) -> None:
        self.driver, self.settings, self._recorder = driver, settings, recorder
        self._part = Participant(settings.name, ros_args, settings.namespace)
        self._node = node = self._part.node
        self._parameters()
        self._stamped = settings.cmd_vel == "stamped"
        kind = TwistStamped if self._stamped else TwistMessage
        topic = "cmd_vel_dry" if settings.dry_run else "cmd_vel"
        self._cmd = node.create_publisher(kind, topic, NEWEST)
        self._status = node.create_publisher(String, "~/status", RELIABLE)
        if recorder is not None:
            self._topics = {
                TwistStamped: self._cmd.topic_name,
                OdometryMessage: node.resolve_topic_name("odom"),
                LaserScan: node.resolve_topic_name("scan"),
            }
            for each, name in self._topics.items():
                package = each.__module__.partition(".")[0]
                recorder.add(name, f"{package}/msg/{each.__name__}", definition(each, message_class))
        # odometry first: the executor takes it before a scan of the same moment
        node.create_subscription(OdometryMessage, "odom", self._odometry, SENSORS)
        node.create_subscription(LaserScan, "scan", self._scan, SENSORS)
        if isinstance(driver.mission, ToGoal):
            node.create_subscription(PoseStamped, "goal_pose", self._goal, RELIABLE)
        if isinstance(driver.mission, AlongPath):
            self._planner = PathPlanner(driver.mission.course_of)
            node.create_subscription(PathMessage, "path", self._planner.came, RELIABLE, raw=True)
        self._estops: set[tuple[ReliabilityPolicy, DurabilityPolicy]] = set()
        self._hear_estop(SENSORS)  # reaches every publisher
        node.create_subscription(Bool, "arm", self._arm, RELIABLE)
        steady = RclClock(clock_type=ClockType.STEADY_TIME)
        node.create_timer(0.05, self._tick, clock=steady)
        threshold = JumpThreshold(
            min_forward=Duration(seconds=1), min_backward=Duration(nanoseconds=-1), on_clock_change=True
        )
        self._jumps = node.get_clock().create_jump_callback(threshold, post_callback=self._jumped)
        self._pending: Goal | None = settings.goal
        self._shown = ("", "")
        self._next_status = 0.0
        self._rivals: tuple[str, ...] = ()
        self.failure: Exception | None = None
        self.commands = 0

    def _parameters(self) -> None:
        """Takes the parameters of --ros-args -p over the options."""
        limits = self.driver.limits
        mine: dict[str, Any] = {}
        for name in ("max_speed", "max_yaw_rate"):
            value = parameter(self._node, name, float(getattr(limits, name)))
            if not value > 0.0:
                raise ValueError(f"parameter {name} is {value:g}; it must be above 0")
            mine[name] = value
        self.driver.limits = dataclasses.replace(limits, **mine)
        value = parameter(self._node, "timeout", float(self.driver.timeout))
        if not 0.05 <= value <= 10.0:
            raise ValueError(f"parameter timeout is {value:g}; it must be from 0.05 to 10 s")
        self.driver.set_timeout(value)
        self._frame = parameter(self._node, "base_frame_id", self.settings.frame)

    def _now(self) -> float:
        return float(1e-9 * self._node.get_clock().now().nanoseconds)

    def _record(self, message: Any) -> None:
        if self._recorder is not None:
            self._recorder.write(self._topics[type(message)], self._now(), serialize_message(message))

    def _publish(self, twist: Twist | None) -> None:
        if twist is None:
            return
        message = TwistStamped()
        # what it knows, where the clock lags behind; now, where what it knows is old
        message.header.stamp = time_of(max(self._now(), self.driver.stamp))
        message.header.frame_id = self._frame
        fill(message.twist, twist)
        self._cmd.publish(message if self._stamped else message.twist)
        self.commands += 1
        self._record(message)

    def _odometry(self, message: OdometryMessage) -> None:
        pose, q, twist = message.pose.pose, message.pose.pose.orientation, message.twist.twist
        odometry = Odometry(
            seconds_of(message.header.stamp),
            message.header.frame_id,
            pose.position.x,
            pose.position.y,
            yaw_of(q.x, q.y, q.z, q.w),
            Twist(twist.linear.x, twist.linear.y, twist.angular.z),
        )
        self._record(message)
        self._publish(self.driver.odometry(odometry, self._now()))
        if self._pending is not None and self.driver.latest is not None:
            goal, self._pending = self._pending, None
            self._take(goal)

    def _scan(self, message: LaserScan) -> None:
        numbers = np.frombuffer(message.ranges, np.float32) if len(message.ranges) else np.empty(0)
        scan = Scan(
            seconds_of(message.header.stamp),
            message.angle_min,
            message.angle_max,
            message.angle_increment,
            message.range_min,
            message.range_max,
            numbers.astype(np.float64),
        )
        self._record(message)
        self._publish(self.driver.scan(scan, self._now()))

    def _goal(self, message: PoseStamped) -> None:
        q = message.pose.orientation
        yaw = yaw_of(q.x, q.y, q.z, q.w)
        self._take(Goal(message.header.frame_id, message.pose.position.x, message.pose.position.y, yaw))

    def _take(self, goal: Goal) -> None:
        mission = self.driver.mission
        assert isinstance(mission, ToGoal)
        wrong = mission.refusal(goal, self.driver.latest)
        if wrong:
            say(f"goal refused: {wrong}")
            return
        mission.goal = goal
        self.driver.began()
        heading = "" if math.isnan(goal.heading) else f", {goal.heading:.2f}"
        say(f"goal ({goal.x:.2f}, {goal.y:.2f}{heading})")

    def _path(self, frame: str, count: int, course: Any) -> None:
        """Drives along a path that has been planned, or says why not."""
        mission, latest = self.driver.mission, self.driver.latest
        assert isinstance(mission, AlongPath)
        if latest is None:
            say("path refused: there is no odometry yet")
        elif isinstance(course, ValueError):
            say(f"path refused: {course}")
        elif isinstance(course, Exception):
            raise course
        elif frame not in ("", latest.frame):
            say(f"path refused: its frame is {shown(frame)}, not {shown(latest.frame)}")
        else:
            mission.take(course)
            self.driver.began()
            say(f"path of {count} points{', closed' if course.task.scenarios[0].path.closed else ''}")

    def _hear_estop(self, qos: QoSProfile) -> None:
        if (kind := (qos.reliability, qos.durability)) not in self._estops:
            self._estops.add(kind)
            quiet = SubscriptionEventCallbacks(incompatible_qos=lambda _: None)
            self._node.create_subscription(Bool, "estop", self._estop, qos, event_callbacks=quiet)

    def _match_estops(self) -> None:
        """Subscribes to estop as its publishers offer it: who asks for more has rclpy say that nothing comes."""
        for each in self._node.get_publishers_info_by_topic(self._node.resolve_topic_name("estop")):
            if each.qos_profile.reliability != ReliabilityPolicy.BEST_EFFORT:
                latched = each.qos_profile.durability == DurabilityPolicy.TRANSIENT_LOCAL
                self._hear_estop(LATCHED if latched else RELIABLE)

    def _estop(self, message: Bool) -> None:
        self._publish(self.driver.estop(message.data))

    def _arm(self, message: Bool) -> None:
        self._publish(self.driver.arm(message.data))

    def _jumped(self, jump: Any) -> None:
        self._publish(self.driver.clock_jumped(1e-9 * jump.delta.nanoseconds))

    def _tick(self) -> None:
        self._publish(self.driver.tick())
        self._match_estops()
        if isinstance(self.driver.mission, AlongPath) and self._planner.ready:
            self._path(*self._planner.ready.pop())
        now = time.monotonic()
        shown = self.driver.state
        if shown != self._shown or now >= self._next_status:
            if shown[0] != self._shown[0] or (shown[0] == "stopped" and shown != self._shown):
                say(": ".join(filter(None, shown)))
            self._shown, self._next_status = shown, now + 0.5
            self._status.publish(String(data=json.dumps(self.status())))
            publishers = self._node.get_publishers_info_by_topic(self._cmd.topic_name)
            names = _names_of(publishers)
            if len(names) > 1 and names != self._rivals:
                say(f"warning: {', '.join(names)} publish {self._cmd.topic_name}; stop all but one")
            self._rivals = names

    def status(self) -> dict[str, Any]:
        """Returns what ~/status says; numbers that are not known are null."""
        driver = self.driver
        state, reason = driver.state
        scan, odom = driver.ages
        times = sorted(driver.decision_times)
        took = 1e3 * times[len(times) // 2] if times else math.nan
        numbers = {
            "goal_distance": getattr(driver.mission, "distance", math.nan),
            "decision_ms": took,
            "scan_age": scan,
            "odom_age": odom,
        }
        finite = {name: round(value, 3) if math.isfinite(value) else None for name, value in numbers.items()}
        return {"state": state, "reason": reason, **finite}

    def run(self, stop: threading.Event, done: Callable[[], bool] = lambda: False) -> None:
        """Drives until it is stopped, or done; then zero is published three times, whatever happened."""
        gc.collect()
        gc.freeze()  # else each full collection walks through all that was imported: 0.3 s without a command
        say("ready: disarmed" if not self.driver.armed else "ready: armed")
        try:
            while not stop.is_set() and not done():
                self._part.spin_once(0.05)
        finally:
            for _ in range(3):
                self._publish(STILL)
                time.sleep(0.02)

    def close(self) -> None:
        """Leaves the network, and ends the recording."""
        self._part.close()
        if self._recorder is not None:
            self._recorder.close()


def drive(
    driver: Driver,
    settings: Any,
    ros_args: Sequence[str],
    recorder: Recorder | None = None,
    done: Callable[[], bool] = lambda: False,
) -> None:
    """Runs a driver until it is stopped."""
    node = DriverNode(driver, settings, ros_args, recorder)
    try:
        with stopping() as stop:
            node.run(stop, done)
        if done():
            say("done")
    finally:
        node.close()
        sys.stdout.flush()
