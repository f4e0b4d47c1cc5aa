"""What stands between a policy and a base: limits of twists, and when nothing but zero may be published.

Software limits are no emergency stop. The base must time out by itself, for a process that has died publishes nothing.
"""

import collections
import dataclasses
import math
import re
import statistics
import time
from collections.abc import Callable
from typing import NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from wayfield.bridges.ros.conventions import Sight, View
from wayfield.bridges.ros.messages import STILL, Odometry, Scan, Twist, wrapped
from wayfield.envs.robots import Robot
from wayfield.system.checks import FARTHEST, shown

MARGIN = 0.05  # m, that the guard keeps from what the scan hits, besides the hull
BLIND_STOP = 0.3  # m, within which the robot can stop where something ahead is not seen
OLDEST = 0.3  # s, of a header's stamp
CONSTANT = 0.1  # s, within which ages count as constant: those of clocks that are not synchronised
APART = 2.0  # s, from which on a constant age is an offset of clocks rather than a slow network
GOOD = 3  # messages in a row after which a source counts as there again
JUMPS, WITHIN = 3, 10.0  # so many jumps of the pose within so many seconds stop the robot
WRONG = 3  # decisions in a row that are not finite stop it
FORWARD = 1.0  # s, that a clock may jump ahead
FASTER = 3.0  # times what the robot can do; and, for what sensors add,
SLACK = 1.0  # m/s, rad/s: odometry beyond both is wrong
SLACK_STEP = (0.1, 0.5)  # m, rad, between two poses


@dataclasses.dataclass(frozen=True)
class Limits:
    """The limits of commands to a base: its data sheet's, or lower ones."""

    robot: Robot
    max_speed: float = math.inf  # m/s
    max_yaw_rate: float = math.inf  # rad/s
    by_sheet: bool = True  # the sheet's wheels and accelerations hold besides; not where they are to be found out

    @property
    def delay(self) -> float:
        """Returns the time (s) from a command to the base's answer, where its data sheet says it."""
        return max(self.robot.delay[:-1], default=0.0)

    @property
    def deceleration(self) -> float:
        """Returns how fast (m/s^2) the base brakes."""
        return self.robot.decelerations[0] if self.robot.decelerations else self.acceleration

    @property
    def acceleration(self) -> float:
        """Returns the acceleration (m/s^2) of the base."""
        return self.robot.actuators("lagged").acceleration

    @property
    def yaw_acceleration(self) -> float:
        """Returns the yaw acceleration (rad/s^2) of the base."""
        return self.robot.actuators("lagged").yaw_acceleration

    @property
    def fastest(self) -> tuple[float, float]:
        """Returns the speed (m/s) and the yaw rate (rad/s) that the robot cannot exceed."""
        way, turn = math.hypot(*self.robot.max_twist[:-1].tolist()), float(self.robot.max_twist[-1])
        return (way, turn) if self.by_sheet else (max(way, self.max_speed), max(turn, self.max_yaw_rate))

    def within(self, twist: Twist) -> Twist:
        """Returns a twist that is scaled by one factor where a wheel, or a limit, would be exceeded."""
        requested = np.array([twist.vx, twist.vy if self.robot.holonomic else 0.0, twist.yaw_rate])
        largest = float(np.abs(requested).max())
        if largest > 1e9:  # below where squares overflow
            requested *= 1e9 / largest
        speed, yaw_rate = math.hypot(requested[0], requested[1]), abs(float(requested[2]))
        over = [yaw_rate / self.max_yaw_rate, speed / self.max_speed]
        if self.by_sheet:
            wheels = float(np.abs(self.robot.wheel_matrix @ requested).max())
            over += [wheels / self.robot.rated_wheel_speed, yaw_rate / self.robot.turn_speed]
        vx, vy, turn = (requested / max(1.0, *over)).tolist()
        return Twist(vx, vy, turn)

    def ramped(self, before: Twist, requested: Twist, dt: float) -> Twist:
        """Returns the twist that the base can follow to after dt (s): it may always slow down."""
        if not self.by_sheet:
            return requested
        vx, vy = requested.vx, requested.vy
        speed, wanted = math.hypot(before.vx, before.vy), math.hypot(vx, vy)
        # what lasts of the motion before along the wanted one
        along = max(0.0, (before.vx * vx + before.vy * vy) / wanted) if wanted > 0.0 else 0.0
        most = min(along, speed) + self.acceleration * dt
        if wanted > most:
            vx, vy = vx * most / wanted, vy * most / wanted
        turn = requested.yaw_rate
        lasting = abs(before.yaw_rate) if before.yaw_rate * turn > 0.0 else 0.0
        turn = math.copysign(min(abs(turn), lasting + self.yaw_acceleration * dt), turn)
        return Twist(vx, vy, turn)

    def clear_of_obstacles(self, twist: Twist, view: View, age: float) -> Twist:
        """Returns a twist that comes no nearer to what the scan hits than the base can stop for.

        Towards a hit at a distance d from the hull the hull moves at most at sqrt(2 a (d - 0.05)) - a (delay + age).
        The way is slowed down, turns only where they bring a corner of the hull nearer.

        Args:
            age: s, of the scan.
        """
        lost = self.deceleration * (self.delay + max(0.0, age))
        if view.blind:
            most = max(0.0, math.sqrt(2.0 * self.deceleration * BLIND_STOP) - lost)
            speed = math.hypot(twist.vx, twist.vy)
            if speed > most:
                twist = Twist(twist.vx * most / speed, twist.vy * most / speed, twist.yaw_rate)
        if not len(view.hits):
            return twist
        nearest, normals, gaps = _from_hull(self.robot, view.hits)
        allowed = np.maximum(np.sqrt(2.0 * self.deceleration * np.maximum(gaps - MARGIN, 0.0)) - lost, 0.0)
        turning = twist.yaw_rate * (normals[:, 1] * nearest[:, 0] - normals[:, 0] * nearest[:, 1])
        moving = normals[:, 0] * twist.vx + normals[:, 1] * twist.vy
        turn = _share(turning, allowed)
        way = _share(moving, np.maximum(allowed - turn * np.maximum(turning, 0.0), 0.0))
        return Twist(way * twist.vx, way * twist.vy, turn * twist.yaw_rate)


def _share(speeds: NDArray[np.float64], allowed: NDArray[np.float64]) -> float:
    """Returns the largest factor of at most 1 with which no speed exceeds what is allowed."""
    over = speeds > allowed
    return float((allowed[over] / speeds[over]).min()) if over.any() else 1.0


def _from_hull(
    robot: Robot, hits: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """Returns the points (k, 2) of the hull that are nearest to hits (k, 2), the directions to those, the distances."""
    if robot.hull_box is None:
        distances = np.hypot(hits[:, 0], hits[:, 1])
        normals = hits / np.maximum(distances, 1e-9)[:, None]
        return normals * robot.hull_radius, normals, distances - robot.hull_radius
    half, middle = 0.5 * np.array(robot.hull_box), np.array([robot.hull_x, 0.0])
    nearest = np.clip(hits, middle - half, middle + half)
    apart = hits - nearest
    gaps = np.hypot(apart[:, 0], apart[:, 1])
    inside = gaps < 1e-9
    # what is seen within the hull is a hit at its middle's side
    apart[inside] = hits[inside] - middle
    normals = apart / np.maximum(np.hypot(apart[:, 0], apart[:, 1]), 1e-9)[:, None]
    return nearest, normals, gaps


class Decision(NamedTuple):
    """A mission."""

    twist: Twist
    arrived: bool = False
    stop: str = ""  # why the robot shall stop until it is armed again; "": it shall not


class Mission(Protocol):
    """What decides where to drive."""

    @property
    def lacks(self) -> str:
        """Returns what it waits for, such as "no goal"; "" where it can decide."""

    def reset(self) -> None:
        """Forgets what it remembers; the goal stays."""

    def decide(self, odometry: Odometry, view: View) -> Decision:
        """Returns what to drive."""

    def sent(self, twist: Twist) -> None:
        """Takes note of what the base is sent: the decision behind the guard, or zero."""


class _Source:
    """Whether messages of one topic come, and are good ones."""

    def __init__(self, name: str, timeout: float) -> None:
        self.name, self.timeout = name, timeout
        self._row = 0
        self._fault = ""  # of the last one
        self.lost = True
        self.last = -math.inf  # s, monotonic, of the last good one
        self.why = f"no {name} yet"
        self.forget()

    def forget(self) -> None:
        """Forgets stamps, as where clocks have jumped."""
        self.stamp = -math.inf
        self.offset = 0.0
        self._ages: collections.deque[float] = collections.deque(maxlen=10)
        self._backward = 0

    def came(self, stamp: float, at: float) -> str:
        """Returns why a message with a stamp (s) that came at a time of the node's clock counts as none; "" if good."""
        if not math.isfinite(stamp) or not math.isfinite(at):
            return f"{self.name}'s stamp is not finite"
        if stamp < self.stamp:
            self._backward = self._backward + 1 if self.stamp - stamp > FORWARD else 0
            if self._backward < GOOD:
                return f"{self.name}'s stamps run backward"
            self.forget()  # a clock was set, or the robot started anew
        self._backward = 0
        self._ages.append(at - stamp)
        low, high = min(self._ages), max(self._ages)
        if len(self._ages) == self._ages.maxlen and high - low < CONSTANT and abs(low) > APART:
            self.offset = low
        age = at - stamp - self.offset
        if abs(age) > OLDEST:
            return f"{self.name}'s stamps are {age:.2f} s old; synchronise the clocks, or set use_sim_time"
        self.stamp = stamp
        return ""

    def good(self, now: float) -> None:
        """Notes a good message."""
        self.last, self._fault = now, ""
        self._row += 1
        if self._row >= GOOD:
            self.lost = False

    def bad(self, why: str) -> None:
        """Notes a message that counts as none."""
        self._row, self._fault, self.why = 0, why, why

    def check(self, now: float) -> None:
        """Notes that too long nothing good has come."""
        if now - self.last > self.timeout and not self.lost:
            self.lost, self._row = True, 0
            self.why = self._fault or f"no {self.name} for {self.timeout:g} s"


class Driver:
    """The states of a driven robot: disarmed, waiting, driving, arrived, stopped. In all but driving it gets zero.

    Each event returns the twist to publish, or None. `tick` comes at 20 Hz by a clock that never jumps.

    Args:
        mission: what decides.
        sight: what takes scans.
        timeout: s, of monotonic time, without a good scan or odometry after which zero is published.
        period: s, between two decisions.
        armed: whether it may move at once.
        clock: a monotonic clock, s.
        say: takes lines for the user.
    """

    def __init__(
        self,
        mission: Mission,
        sight: Sight,
        limits: Limits,
        timeout: float = 0.5,
        period: float = 0.05,
        armed: bool = False,
        clock: Callable[[], float] = time.monotonic,
        say: Callable[[str], None] = lambda line: None,
    ) -> None:
        self.mission, self.sight, self.limits = mission, sight, limits
        self.timeout, self.period = timeout, period
        self._clock, self._say = clock, say
        self.armed = armed
        self.stopped = ""
        self._estop = False
        self._frame: str | None = None  # of odometry, in which goals and paths are
        self._scan, self._odom = _Source("scan", timeout), _Source("odom", timeout)
        self._said: set[str] = set()
        self._arrived = False
        self._wrong = 0
        self._jumps: list[float] = []
        self._last_decision = -math.inf  # s, monotonic
        self.decision_times: collections.deque[float] = collections.deque(maxlen=200)  # s
        self._hold = -math.inf  # s, monotonic, until when zero is published
        self._forget()

    def _forget(self) -> None:
        """Forgets what stamps and poses say, and what the mission remembers."""
        self.mission.reset()
        self.sight.forget()
        self._history: collections.deque[Odometry] = collections.deque(maxlen=100)
        self._scans: collections.deque[float] = collections.deque(maxlen=10)  # stamps
        self._waiting = False  # a scan for odometry of its time
        self._decided = -math.inf  # s, stamp of the newest message of the last decision
        self._command = STILL
        self._late = ""

    @property
    def latest(self) -> Odometry | None:
        """Returns the newest odometry; None before there is some."""
        return self._history[-1] if self._history else None

    @property
    def stamp(self) -> float:
        """Returns the stamp (s) of the newest message that the last decision knows."""
        newest = max(self._scan.stamp, self._odom.stamp)
        return newest if math.isfinite(newest) else 0.0

    def set_timeout(self, timeout: float) -> None:
        """Sets how long (s) nothing good may come."""
        self.timeout = self._scan.timeout = self._odom.timeout = timeout

    @property
    def scan_period(self) -> float:
        """Returns the time (s) between scans, as their stamps say."""
        gaps = np.diff(list(self._scans)).tolist()
        return statistics.median(gaps) if gaps else self.period

    @property
    def state(self) -> tuple[str, str]:
        """Returns the state and its reason."""
        now = self._clock()
        self._scan.check(now)
        self._odom.check(now)
        if self.stopped:
            return "stopped", self.stopped
        if not self.armed:
            return "disarmed", "publish true on arm, or start with --arm"
        for source in (self._scan, self._odom):
            if source.lost:
                return "waiting", source.why
        if self.mission.lacks:
            return "waiting", self.mission.lacks
        if self._arrived:
            return "arrived", ""
        return "driving", self._late

    @property
    def ages(self) -> tuple[float, float]:
        """Returns how long ago (s) the last good scan and odometry came."""
        now = self._clock()
        return now - self._scan.last, now - self._odom.last

    def scan(self, scan: Scan, at: float) -> Twist | None:
        """Takes a scan that came at a time (s) of the node's clock."""
        why = self.sight.fault(scan) or self._scan.came(scan.stamp, at)
        if why:
            self._refused(self._scan, why)
            return None
        self._offset(self._scan)
        if not self._history:
            self._scan.bad("no odom yet")
            return None
        if hint := self.sight.hint(scan):
            self._once("no return", f"scan: {hint}")
        self._scan.good(self._clock())
        self._scans.append(scan.stamp)
        self.sight.enter(scan, self._pose_at(scan.stamp))
        paced = self.scan_period <= 1.5 * self.period
        if paced or scan.stamp - self._decided >= 0.9 * self.period:
            if scan.stamp - self._history[-1].stamp > 0.5 * self.period:
                self._waiting = True  # its odometry is on the way
                return None
            return self._decision(at)
        return None

    def odometry(self, odometry: Odometry, at: float) -> Twist | None:
        """Takes a measured pose and twist that came at a time (s) of the node's clock."""
        why = self._nonsense(odometry) or self._odom.came(odometry.stamp, at)
        if why:
            self._refused(self._odom, why)
            return None
        if self._frame not in (None, odometry.frame):
            return self._frame_changed(odometry.frame)
        self._frame = odometry.frame
        self._offset(self._odom)
        if self._history and self._jumped(self._history[-1], odometry):
            return self._pose_jumped(odometry)
        self._odom.good(self._clock())
        self._history.append(odometry)
        paced = self.scan_period <= 1.5 * self.period
        due = not paced and odometry.stamp - self._decided >= 0.9 * self.period
        if self._waiting or due:
            self._waiting = False
            return self._decision(at)
        return None

    def tick(self) -> Twist | None:
        """Returns zero where nothing else may be published, None where the last command holds."""
        state, _ = self.state
        now = self._clock()
        if state == "driving" and now >= self._hold and now - self._last_decision <= self.timeout:
            return None
        return self._zero()

    def estop(self, pressed: bool) -> Twist | None:
        """Takes a message of the emergency stop's topic."""
        self._estop = pressed
        if not pressed:
            return None
        self.armed, self.stopped = False, "estop"
        return self._zero()

    def arm(self, armed: bool) -> Twist | None:
        """Takes a message of the topic that arms and disarms."""
        if not armed:
            self.armed = False
            return self._zero()
        if self._estop:
            self._say("arm refused: estop is true; publish false on estop, then true on arm")
            return None
        self.armed, self.stopped, self._wrong = True, "", 0
        self._jumps.clear()
        return None

    def began(self) -> None:
        """Notes that the mission has a new goal."""
        self._arrived = False
        self.mission.reset()
        self._command = STILL

    def clock_jumped(self, by: float) -> Twist | None:
        """Takes a jump (s) of the node's clock: memory is reset and zero published for a period; the goal is kept."""
        if 0.0 <= by <= FORWARD:
            return None
        there = bool(self._history)
        self._scan.forget()
        self._odom.forget()
        self._forget()
        self._hold = self._clock() + self.period
        if there:
            self._once(f"the clock jumped by {by:+.2f} s: memory is reset, the goal is kept")
        return self._zero()

    def _refused(self, source: _Source, why: str) -> None:
        source.bad(why)
        self._once("no return" if "--no-return" in why else re.sub(r"[-+]?\d[\d.e+-]*", "#", why), why)

    def _once(self, key: str, line: str = "") -> None:
        if key not in self._said:
            self._said.add(key)
            self._say(line or key)

    def _offset(self, source: _Source) -> None:
        if source.offset:
            self._once(
                f"offset of {source.name}",
                f"{source.name}'s clock is constantly {source.offset:+.2f} s off ours, which is taken off: synchronise",
            )

    def _pose_at(self, stamp: float) -> tuple[float, float, float]:
        """Returns the pose (m, m, rad) of odometry at a time (s), in proportion between two messages."""
        before = after = self._history[-1]
        for each in reversed(self._history):
            before = each
            if each.stamp <= stamp:
                break
            after = each
        if not before.stamp <= stamp or after.stamp <= before.stamp:
            return before.x, before.y, before.heading
        share = min(1.0, (stamp - before.stamp) / (after.stamp - before.stamp))
        return (
            before.x + share * (after.x - before.x),
            before.y + share * (after.y - before.y),
            before.heading + share * wrapped(after.heading - before.heading),
        )

    def _nonsense(self, odometry: Odometry) -> str:
        """Returns why no robot can be or move as odometry says, in a line; "" where it may."""
        if not odometry.is_finite:
            return "odom is not finite"
        if max(abs(odometry.x), abs(odometry.y)) > FARTHEST:
            return f"odom's pose is ({odometry.x:.6g}, {odometry.y:.6g}) m; it must be within {FARTHEST:g} m"
        requested = math.hypot(odometry.twist.vx, odometry.twist.vy), abs(odometry.twist.yaw_rate)
        most = self.limits.fastest
        if any(each > FASTER * limit + SLACK for each, limit in zip(requested, most, strict=True)):
            return (
                f"odom's twist is {requested[0]:.6g} m/s, {requested[1]:.6g} rad/s; "
                f"{self.limits.robot.name} does {most[0]:.3g} m/s, {most[1]:.3g} rad/s"
            )
        return ""

    def _frame_changed(self, frame: str) -> Twist:
        line = f"odom's frame_id changed from {shown(self._frame)} to {shown(frame)}"
        self.stopped, self.armed = f"{line}; goals are in the first: publish one, then arm again", False
        self._odom.bad(line)
        return self._zero()

    def _jumped(self, before: Odometry, after: Odometry) -> bool:
        """Returns whether a pose is further from the one before than the robot can go, or turn."""
        dt = max(0.0, after.stamp - before.stamp)
        steps = math.hypot(after.x - before.x, after.y - before.y), abs(wrapped(after.heading - before.heading))
        limits = zip(steps, self.limits.fastest, SLACK_STEP, strict=True)
        return any(step > FASTER * most * dt + slack for step, most, slack in limits)

    def _pose_jumped(self, odometry: Odometry) -> Twist:
        now = self._clock()
        self._forget()
        self._history.append(odometry)
        # three good messages first: the scan before belongs to the pose before
        self._scan.lost, self._scan.why = True, "the pose jumped"
        self._scan.bad("the pose jumped")
        self._jumps = [*(each for each in self._jumps if now - each <= WITHIN), now]
        if len(self._jumps) >= JUMPS:
            self.stopped, self.armed = f"the pose jumped {JUMPS} times within {WITHIN:g} s; arm again", False
        self._once("the pose jumped further than the robot can go: memory is reset")
        return self._zero()

    def _decision(self, at: float) -> Twist:
        """Returns the guarded twist of a decision; zero where there is none to be made."""
        state, _ = self.state
        now = self._clock()
        if state != "driving" or now < self._hold:
            return self._zero()
        odometry = self._history[-1]
        view = self.sight.view((odometry.x, odometry.y, odometry.heading), odometry.stamp)
        try:
            decision = self.mission.decide(odometry, view)
        except Exception:
            self.stopped, self.armed = "a decision failed", False
            raise
        took = self._clock() - now
        self.decision_times.append(took)
        self._last_decision = now
        stamp = max(odometry.stamp, self._scan.stamp)
        dt = min(max(stamp - self._decided, 0.0), 2.0 * self.period)
        self._decided = stamp
        self._late = "" if took <= 0.8 * self.scan_period else f"late: a decision took {1e3 * took:.0f} ms"
        if decision.stop:
            self.stopped, self.armed = decision.stop, False
            return self._zero()
        if decision.arrived:
            self._arrived = True
            return self._zero()
        if not decision.twist.is_finite:
            self._wrong += 1
            self.mission.reset()
            if self._wrong >= WRONG:
                self.stopped, self.armed = f"{WRONG} decisions in a row were not finite", False
            return self._zero()
        self._wrong = 0
        if took > 2.0 * self.scan_period:
            return self._zero()
        age = max(0.0, at - self._scan.stamp - self._scan.offset) + took
        requested = self.limits.clear_of_obstacles(self.limits.within(decision.twist), view, age)
        self._command = self.limits.ramped(self._command, requested, dt)
        self.mission.sent(self._command)
        return self._command

    def _zero(self) -> Twist:
        self._command = STILL
        self.mission.sent(STILL)
        return STILL
