"""Scans: how ours are published by REP 117, and how others' are read.

Conventions differ between drivers: where the first beam looks, which way round they go, how many there are, and what
stands for "nothing there", "too near" and "not measured".
"""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from wayfield.bridges.ros.messages import Scan

Array = NDArray[np.float64]

AHEAD = math.radians(60.0)  # rad, to either side: where the robot must see to drive
MOST_UNKNOWN = 0.5  # share of what is ahead
MEMORY = 0.5  # s, that a hit is remembered in a direction that is no longer seen
MOST_TURNS = 4.0 * math.pi  # rad, of the first beam: farther round, directions are no longer exact
FARTHEST_NEAR = 5.0  # m, of range_min
FAR_BEYOND, FARTHEST_SEEN = 5.0, 300.0  # times range_max, and m, beyond which ranges are in other units
NO_RETURN = ("far", "unknown")  # what 0 and NaN mean: free as far as the lidar sees, or not known


class Outgoing:
    """The order in which a full or partial circle of beams of ours is published.

    The last angle is rounded up to what a message can hold, so that nodes that count beams from first angle, last angle
    and increment, the last excluded, find as many as there are.

    Args:
        beam_angles: (n,) rad, body frame, rising, as an environment has them.
        max_range: m.
        first: rad, where the first beam of a full circle shall look: 0 as TurtleBot3's does, or -pi. A partial circle
            begins at its right end, whatever is requested.
    """

    def __init__(self, beam_angles: Array, max_range: float, first: float = 0.0) -> None:
        n = len(beam_angles)
        self.max_range = max_range
        self.increment = float(np.float32(beam_angles[1] - beam_angles[0] if n > 1 else 2.0 * math.pi))
        full = n * self.increment > 2.0 * math.pi - 0.5 * self.increment
        # the first beam at or behind the requested direction, within rounding
        behind = np.mod(beam_angles - first + 1e-9, 2.0 * math.pi)
        self._roll = int(behind.argmin()) if full else 0
        start = float(beam_angles[self._roll])
        turns = round((start - first - float(behind[self._roll]) + 1e-9) / (2.0 * math.pi)) if full else 0
        self.angle_min = float(np.float32(start - 2.0 * math.pi * turns))
        last = np.float32(self.angle_min + (n - 1) * self.increment)
        self.angle_max = float(np.nextafter(last, np.float32(np.inf)))

    def ranges(self, ranges: NDArray[np.float32]) -> NDArray[np.float32]:
        """Returns ranges (n,), m, in the published order: +inf where nothing is in range, or the beam dropped out."""
        out = np.roll(ranges, -self._roll).astype(np.float32)
        out[out >= np.float32(self.max_range)] = np.inf
        return out


class Beams(NamedTuple):
    """What the beams of a scan say: those that are known, hits among them."""

    angles: Array  # (k,) rad, frame of the scanner, in [-pi, pi]
    distances: Array  # (k,) m; of what is free, how far it is known to be
    is_hit: NDArray[np.bool_]  # (k,)
    spacing: float  # rad, between two beams


def fault_of(scan: Scan) -> str:
    """Returns what is wrong with the sizes of a scan, in a line; "" where it can be read."""
    count = len(scan.ranges)
    if not count:
        return "scan has no ranges"
    numbers = (scan.angle_min, scan.angle_max, scan.angle_increment, scan.range_min, scan.range_max)
    if not all(map(math.isfinite, numbers)) or (scan.angle_increment == 0.0 and count > 1):
        return f"scan's angles or limits are not finite, or angle_increment is 0: {numbers}"
    if count == 1 or abs(scan.angle_increment) > AHEAD:
        return f"scan has {count} beams {abs(scan.angle_increment):.3g} rad apart; they must be {AHEAD:.3g} rad or less"
    if not 0.0 <= scan.range_min < scan.range_max:
        return f"scan's range_min is {scan.range_min:g} and range_max {scan.range_max:g}; 0 <= range_min < range_max"
    if abs(scan.angle_min) > MOST_TURNS:
        return f"scan's angle_min is {scan.angle_min:g} rad; it must be within {MOST_TURNS:.3g} rad of 0"
    if scan.range_min > FARTHEST_NEAR:
        return f"scan's range_min is {scan.range_min:g} m; it must be at most {FARTHEST_NEAR:g}: is it in mm or cm?"
    # out of range all drivers write the same; what differs is measured, and read as free where it is beyond range_max
    ranges = np.asarray(scan.ranges, np.float64)
    measured = np.isfinite(ranges) & (ranges > 0.0)
    beyond = measured & (ranges > min(FAR_BEYOND * scan.range_max, FARTHEST_SEEN))
    if 2 * beyond.sum() > measured.sum() and len(np.unique(ranges[beyond])) > 2:
        median = float(np.median(ranges[beyond]))
        return f"scan has ranges of {median:.4g} m, its range_max is {scan.range_max:g} m: are they in mm or cm?"
    requested = (scan.angle_max - scan.angle_min) / scan.angle_increment + 1.0 if count > 1 else 1.0
    if not abs(requested - count) <= 1.0 + 1e-3 * count**0.5:
        return f"scan has {count} ranges, but angle_min, angle_max and angle_increment imply {requested:.1f}"
    if abs((count - 1) * scan.angle_increment) > 2.0 * math.pi + 2.0 * abs(scan.angle_increment):
        return f"scan goes round more than once: {count} beams of {abs(scan.angle_increment):g} rad"
    return ""


def read(scan: Scan, max_range: float, far: bool = False) -> Beams:
    """Returns what a scan says, in the words of REP 117 and of drivers that do without it.

    +inf and what lies beyond range_max is free that far; -inf and what lies nearer than range_min is a hit at
    range_min; negative numbers are not known, nor are 0 and NaN unless the lidar writes them for "no return".

    Args:
        max_range: m, beyond which we do not look.
        far: whether 0 and NaN are "no return", free like +inf.
    """
    r = np.asarray(scan.ranges, np.float64)
    angles = scan.angle_min + scan.angle_increment * np.arange(len(r))
    reach = min(scan.range_max, max_range)
    silent = np.isnan(r) | (r == 0.0)
    r = np.where(silent & far, np.inf, r)
    known = (r > 0.0) | np.isneginf(r)
    near = known & (r < scan.range_min)
    distances = np.where(near, scan.range_min, r)
    is_hit = known & (distances <= scan.range_max) & (distances < max_range)
    distances = np.where(is_hit, distances, reach)
    turned = np.remainder(angles[known] + math.pi, 2.0 * math.pi) - math.pi
    return Beams(turned, distances[known], is_hit[known], abs(scan.angle_increment) or 2.0 * math.pi)


def unknown_ahead(beams: Beams, turned: float = 0.0) -> float:
    """Returns the share of the directions ahead, AHEAD to either side, in which nothing is known.

    Args:
        turned: rad, how the scanner stands on the robot.
    """
    width = max(beams.spacing, math.radians(1.0))
    sectors = np.arange(-AHEAD + 0.5 * width, AHEAD, width)
    seen, _ = in_sectors(np.remainder(beams.angles + turned + math.pi, 2.0 * math.pi) - math.pi, beams.distances,
                         sectors, beams.spacing, math.inf)  # fmt: skip
    return float(np.isnan(seen).mean())


def in_sectors(
    angles: Array, distances: Array, sectors: Array, spacing: float, max_range: float
) -> tuple[Array, NDArray[np.int64]]:
    """Returns the nearest distance (n,) in each sector, NaN where nothing is known, and the sector (k,) of each beam.

    A beam belongs to the sector whose direction is nearest; a sector without one has the nearer of its neighbours'
    within one spacing of beams.

    Args:
        angles, distances: (k,) rad in [-pi, pi], and m, of what is known.
        sectors: (n,) rad, evenly spaced and rising.
        spacing: rad, between two beams.
        max_range: m, what distances are cut to.
    """
    n, k = len(sectors), len(angles)
    result = np.full(n, np.inf)
    if not k:
        return np.full(n, np.nan), np.empty(0, np.int64)
    width = float(sectors[1] - sectors[0]) if n > 1 else 2.0 * math.pi
    place = np.rint((angles - sectors[0]) / width).astype(np.int64)
    round_ = n * width > 2.0 * math.pi - 0.5 * width
    if round_:
        place %= n
    inside = (place >= 0) & (place < n)
    np.minimum.at(result, place[inside], distances[inside])
    empty = np.flatnonzero(np.isinf(result))
    if len(empty):
        order = np.argsort(angles)
        along, far = angles[order], distances[order]
        right = np.searchsorted(along, sectors[empty])
        for side in (right - 1, right):
            gap = np.abs(np.remainder(along[side % k] - sectors[empty] + math.pi, 2.0 * math.pi) - math.pi)
            near = gap <= max(spacing, 0.5 * width) * (1.0 + 1e-6)
            result[empty[near]] = np.minimum(result[empty[near]], far[side % k][near])
    seen = np.where(np.isinf(result), np.nan, np.minimum(result, max_range))
    return seen, place


def silent_beams(scan: Scan) -> str:
    """Returns how many ranges are 0 or NaN, in words; "" where none is.

    NaN beside +inf are not counted: that lidar follows REP 117, in which NaN is an error.
    """
    r = scan.ranges
    zeros = int((r == 0.0).sum())
    nans = 0 if np.isposinf(r).any() else int(np.isnan(r).sum())
    counts = [f"{count} of {len(r)} ranges are {name}" for count, name in ((zeros, "0"), (nans, "NaN")) if count]
    return " and ".join(counts)


class View(NamedTuple):
    """What the robot has around it at a moment."""

    ranges: Array  # (n,) m, in the directions of a policy's beams
    hits: Array  # (k, 2) m, body frame: what a guard keeps away from
    blind: bool  # nothing is known of some direction ahead, nor was it lately


class Sight:
    """Scans in the directions that a policy sees, moved by odometry to where the robot is now.

    Args:
        beam_angles: (n,) rad, body frame, of the policy's beams.
        max_range: m.
        mount: pose (x m, y m, heading rad) of the scanner on the robot.
        no_return: what 0 and NaN mean, one of NO_RETURN; None: unknown, and `hint` names the option.
    """

    def __init__(
        self,
        beam_angles: Array,
        max_range: float,
        mount: tuple[float, float, float] = (0.0, 0.0, 0.0),
        no_return: str | None = None,
    ) -> None:
        self._sectors = np.asarray(beam_angles, np.float64)
        self.max_range = max_range
        self._mount = mount
        self._far, self._is_default = no_return == "far", no_return is None
        self.forget()

    def forget(self) -> None:
        """Forgets all scans, as where poses have jumped."""
        self._pose = (0.0, 0.0, 0.0)
        self._free: Array = np.empty((0, 2))  # frame of odometry, as all that is kept
        self._hits: Array = np.empty((0, 2))
        self._old: Array = np.empty((0, 3))  # hits of scans before, and when they were seen
        self._spacing = 2.0 * math.pi
        self.stamp = -math.inf

    def fault(self, scan: Scan) -> str:
        """Returns why a scan counts as none, in a line; "" where it counts."""
        wrong = fault_of(scan)
        if wrong:
            return wrong
        share = unknown_ahead(read(scan, self.max_range, self._far), self._mount[2])
        if share > MOST_UNKNOWN:
            hint = self.hint(scan)
            return f"scan has nothing to say of {100.0 * share:.0f} % of what is ahead{': ' if hint else ''}{hint}"
        return ""

    def hint(self, scan: Scan) -> str:
        """Returns a line that names --no-return where it was not given and a scan may want it, else ""."""
        silent = silent_beams(scan) if self._is_default else ""
        if not silent:
            return ""
        return f"{silent}, taken as unknown; if your lidar writes that for no return, start with --no-return far"

    def enter(self, scan: Scan, pose: tuple[float, float, float]) -> None:
        """Takes a scan that was made at a pose (m, m, rad) of odometry."""
        beams = read(scan, self.max_range, self._far)
        x, y, turn = self._mount
        angles = beams.angles + turn
        points = np.column_stack([x + beams.distances * np.cos(angles), y + beams.distances * np.sin(angles)])
        seen = _placed(points, pose)
        old = np.column_stack([self._hits, np.full(len(self._hits), self.stamp)])
        self._old = np.vstack([self._old, old])
        self._old = self._old[self._old[:, 2] >= scan.stamp - MEMORY]
        self._hits, self._free = seen[beams.is_hit], seen[~beams.is_hit]
        self._spacing = beams.spacing
        self.stamp = scan.stamp

    def view(self, pose: tuple[float, float, float], stamp: float) -> View:
        """Returns what is around a pose (m, m, rad) of odometry at a time (s)."""
        hits, free = _seen_from(self._hits, pose), _seen_from(self._free, pose)
        points = np.vstack([hits, free])
        distances = np.hypot(points[:, 0], points[:, 1])
        distances[len(hits) :] = self.max_range
        angles = np.arctan2(points[:, 1], points[:, 0])
        ranges, _ = in_sectors(angles, distances, self._sectors, self._spacing, self.max_range)
        unknown = np.isnan(ranges)
        if unknown.any() and len(self._old):
            late = self._old[self._old[:, 2] >= stamp - MEMORY]
            past = _seen_from(late[:, :2], pose)
            where, place = in_sectors(
                np.arctan2(past[:, 1], past[:, 0]), np.hypot(past[:, 0], past[:, 1]), self._sectors, 0.0, self.max_range
            )
            ranges = np.where(unknown, where, ranges)
            inside = (place >= 0) & (place < len(ranges))
            retained = inside & unknown[np.where(inside, place, 0)]
            hits = np.vstack([hits, past[retained]])
        unknown = np.isnan(ranges)
        blind = bool((unknown & (np.abs(self._sectors) <= AHEAD)).any())
        return View(np.where(unknown, self.max_range, ranges), hits, blind)


def _placed(points: Array, pose: tuple[float, float, float]) -> Array:
    """Returns points (k, 2) of the body frame at a pose in the frame of the pose."""
    x, y, heading = pose
    c, s = math.cos(heading), math.sin(heading)
    return np.column_stack([x + c * points[:, 0] - s * points[:, 1], y + s * points[:, 0] + c * points[:, 1]])


def _seen_from(points: Array, pose: tuple[float, float, float]) -> Array:
    """Returns points (k, 2) in the body frame at a pose: the inverse of `_placed`."""
    x, y, heading = pose
    c, s = math.cos(heading), math.sin(heading)
    dx, dy = points[:, 0] - x, points[:, 1] - y
    return np.column_stack([c * dx + s * dy, c * dy - s * dx])
