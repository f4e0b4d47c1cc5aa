"""Commands from which a base's delay, lag, limits and accelerations can be identified, driven within a small space."""

import math
from typing import NamedTuple

import numpy as np

from wayfield.bridges.ros.conventions import View
from wayfield.bridges.ros.guard import Decision
from wayfield.bridges.ros.messages import STILL, Odometry, Twist
from wayfield.envs.robots import Robot

REST = 2.0  # s
CLEAR = 0.3  # m, to what the scan hits, besides the hull and the way that braking takes
OVER = 1.3  # times the top speed: a base whose limit is the top shows it
_TICK = 0.05  # s, of the checks of how far a script goes


class Segment(NamedTuple):
    """Part of a script: speeds at its begin and end, between which they are ramped, or swept as a sine."""

    seconds: float
    v: float = 0.0  # m/s
    w: float = 0.0  # rad/s
    to_v: float = math.nan  # at the end; NaN: as at the begin
    to_w: float = math.nan
    sweep: bool = False  # a chirp from 0.2 to 1.3 Hz of this amplitude

    def at(self, t: float) -> Twist:
        """Returns what is commanded at a time (s) of the segment."""
        if self.sweep:
            phase = 2.0 * math.pi * (0.2 * t + 0.5 * (1.3 - 0.2) / self.seconds * t * t)
            return Twist(self.v * math.sin(phase), 0.0, self.w * math.sin(phase))
        share = t / self.seconds
        v = self.v if math.isnan(self.to_v) else self.v + share * (self.to_v - self.v)
        w = self.w if math.isnan(self.to_w) else self.w + share * (self.to_w - self.w)
        return Twist(v, 0.0, w)


def script(top_speed: float, top_yaw_rate: float, seconds: float, space: float) -> tuple[list[Segment], float]:
    """Returns the segments, and the factor by which speeds ahead are lowered so that they stay in the space.

    Steps of 1, 1/2 and 1/4 of the top speed, there and back; 1.3 times the top for as long as the space has room; a
    slow ramp; a chirp; first ahead, then turning, then both at once. Steps are stretched to about `seconds`.

    Args:
        top_speed: m/s.
        top_yaw_rate: rad/s.
        space: m, how far from its start it may go.
    """
    parts: list[Segment] = []
    for v, w in ((1.0, 0.0), (0.0, 1.0), (0.6, 0.6)):
        parts.append(Segment(REST))
        for share in (1.0, 0.5, 0.25):
            parts += [Segment(1.2, share * v, share * w), Segment(1.2, -share * v, -share * w), Segment(0.6)]
        parts += [Segment(3.0, OVER * v, OVER * w), Segment(3.0, -OVER * v, -OVER * w), Segment(0.6)]
        if not (v and w):
            parts += [Segment(1.0, 0.0, 0.0, v, w), Segment(2.0, v, w, -v, -w), Segment(1.0, -v, -w, 0.0, 0.0)]
            parts.append(Segment(4.0, 0.5 * v, 0.5 * w, sweep=True))
    parts.append(Segment(REST))
    # rests and the longest steps are shortened by nothing
    stretch = max(seconds / sum(each.seconds for each in parts), 0.5)
    parts = [
        each._replace(seconds=each.seconds * (max(stretch, 1.0) if each.seconds >= REST else stretch)) for each in parts
    ]
    reach = farthest(parts, top_speed)
    factor = min(1.0, space / reach) if reach > 0.0 else 1.0
    scaled = [
        each._replace(
            v=each.v * top_speed * factor,
            w=each.w * top_yaw_rate,
            to_v=each.to_v * top_speed * factor,
            to_w=each.to_w * top_yaw_rate,
        )
        for each in parts
    ]
    return scaled, factor


def farthest(parts: list[Segment], top_speed: float) -> float:
    """Returns how far (m) from its start a base that follows at once goes straight ahead or back."""
    place, most = 0.0, 0.0
    for each in parts:
        for t in np.arange(0.0, each.seconds, _TICK).tolist():
            place += top_speed * each.at(t).vx * _TICK
            most = max(most, abs(place))
    return most


class Script:
    """A mission that drives a script, and stops where something comes too near or the space ends.

    Args:
        space: m, how far from its start it may go; half a metre of grace is for the base's own dynamics.
    """

    def __init__(self, parts: list[Segment], robot: Robot, space: float) -> None:
        self._parts, self._robot, self._space = parts, robot, space
        self._begin: Odometry | None = None
        self.seconds = sum(each.seconds for each in parts)
        self.distance = self.seconds  # s left, where others have metres
        self.done = False

    @property
    def lacks(self) -> str:
        """Returns nothing: a script needs no goal."""
        return ""

    def reset(self) -> None:
        """Begins anew at the next decision."""
        self._begin = None

    def sent(self, twist: Twist) -> None:
        """Needs no note of it: commands do not depend on what came before."""
        del twist

    def decide(self, odometry: Odometry, view: View) -> Decision:
        """Returns what the script says now."""
        if self._begin is None:
            self._begin = odometry
        t = odometry.stamp - self._begin.stamp
        self.distance = self.seconds - t
        gone = math.hypot(odometry.x - self._begin.x, odometry.y - self._begin.y)
        if gone > self._space + 0.5:
            return Decision(STILL, stop=f"{gone:.2f} m from the start: outside of the space of {self._space:g} m")
        speed = math.hypot(odometry.twist.vx, odometry.twist.vy)
        need = self._robot.hull_radius + CLEAR + speed * speed / (2.0 * self._robot.actuators("lagged").acceleration)
        if len(view.hits) and float(np.hypot(*view.hits.T).min()) < need:
            return Decision(STILL, stop=f"something is nearer than {need:.2f} m: hull, {CLEAR} m and braking way")
        for each in self._parts:
            if t < each.seconds:
                return Decision(each.at(t))
            t -= each.seconds
        self.done = True
        return Decision(STILL, arrived=True)
