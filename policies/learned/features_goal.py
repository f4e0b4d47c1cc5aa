"""What a goal seeker's network sees: the goal, its scan, where it came from, and what moves."""

import dataclasses
import math
from typing import ClassVar, Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from wayfield.envs.goal_reaching import Observation
from wayfield.envs.robots import Actuators
from wayfield.envs.tasks.briefing import Briefing
from wayfield.policies.learned.arrival import arrive
from wayfield.policies.learned.features import LIMIT, MOST_SEEN, Array, Numbers, Tolerances, check_trails
from wayfield.policies.learned.guard import guard
from wayfield.policies.parts.gain import Gains, gain
from wayfield.policies.parts.stopping import FASTEST, INTERVAL, MOVED, WATCHED, boxes_of, rest_radius, step_of_surface
from wayfield.system.compiled import allocating, any_layout, compiled, inlined
from wayfield.system.elementary import area_sine, bearing, sin_cos, wrap_angle

NEXT_GOAL = 0.5  # m, by which the distance to the goal grows only where the goal is another
MOST_BEAMS = 10_000  # they size memory
LEAST_BEAMS = 32  # of a scan that is read as one of more
FULL = 2.0 * math.pi  # rad
ARRIVED = 0.015  # m, from a goal, within which a robot turns to its heading
FORESIGHT = 1.2  # s, for which what comes nearer by itself is put forward


@dataclasses.dataclass(frozen=True)
class GoalFeatures(Gains):
    """Of a goal seeker: where the goal is, its motion, the scan, the speed asked for, and what it did last.

    The scan is seen twice, in every `pool`-th direction: as the nearness n = range_scale / (range_scale + d) of the
    nearest of `pool` neighbouring beams, d = max(r - hull_radius, 0), and as that of the way d that a disc of
    hull_radius + margin could go in a straight line before it touches a point of the scan. In the frame "goal" all is
    turned, scan and action too, by a whole number of beams so that the goal lies ahead: a holonomic robot has no front.
    The network does not look at the goal's heading: within `arrival` of the goal, a law takes over, which drives on to
    it and turns to its heading (`arrive`).

    A scan of other beams, all around and as far at least, is read as if it had `num_beams`: see `resample`.

    A scan alone does not tell a dead end that the robot has just left from a new way. So it sees where it came from:
    points m that trail behind it, m' = (p - m)/T for each T of `trails`, by its measured positions p; and, where crumbs
    are dropped, one each crumb_gap of its way, the nearness of the nearest of the last of them in each direction, how
    much farther than ever before the goal is, and for how long it has come no nearer, t/(t + 5 s).

    Where it looks for what moves, it sees two numbers more of each direction: how fast the surface there comes nearer
    by itself (m/s, less than 0: goes away), and the nearness of the hull's disc to where those that come will be in
    1.2 s. A surface's own step is what a hit lies before the line through two neighbouring hits of a scan 0.2 to 0.4 s
    older, both by the measured poses, as in `stopping.find_approaching`.

    What the network asks for is guarded: towards a point of the scan at the distance d beyond gap, a robot goes no
    faster than it could stop on d after the time `reaction`: v = a (sqrt(reaction^2 + 2 d / a) - reaction), a the
    braking. An omni base loses the part of its velocity that is too fast and slides along; a differential drive slows
    down. What stands is so hardly ever touched; what moves may still come. A base that brakes no harder than a, or lags
    by tau, is guarded by at most 0.7 a and by at least tau + 0.1 s; and by as much longer as it then takes to stop, a
    differential drive is also kept from where it would be heading after that time at its yaw rate. An omni base that
    brakes with the share s of a is eased where an agent drives it: it turns by sqrt(s) of what the network asks for, so
    that it turns on as far before it stops to, w^2 / (2 alpha), and drives by sqrt(sqrt(s)) of it. In training it is
    not: those that ship learned so.
    """

    num_beams: int = gain(72, "1", "of the scan, all around; the environment's too", least=1, most=MOST_BEAMS)
    hull_radius: float = gain(0.3, "m", "of the disc that the ways ahead are measured for", least=0.0)
    max_range: float = gain(5.0, "m", "of the scan; the environment's too", above=0.0)
    range_scale: float = gain(0.5, "m", "at which nearness is one half", above=0.0)
    margin: float = gain(0.03, "m", "added to the disc", least=0.0)
    distance_scale: float = gain(1.0, "m", "up to which the goal's is seen in proportion", above=0.0)
    speed_scale: float = gain(0.6, "m/s", "up to which it is seen in proportion", above=0.0)
    yaw_scale: float = gain(2.0, "rad/s", "up to which it is seen in proportion", above=0.0)
    pool: int = gain(2, "1", "beams a direction; divides num_beams", least=1)
    frame: Literal["goal", "body"] = gain("goal", "", "in which the scan and the action are meant")
    previous: int = gain(1, "1", "own actions seen", most=MOST_SEEN)
    trails: tuple[float, ...] = gain(
        (1.0, 3.0, 10.0, 30.0), "s", "of the points that trail behind", words="a,b,... > 0"
    )
    crumbs: int = gain(0, "1", "places remembered; 0: none", most=MOST_SEEN)
    crumb_gap: float = gain(0.3, "m", "between them", above=0.0)
    frames: int = gain(1, "1", "observations seen", least=1, most=MOST_SEEN)
    stride: int = gain(1, "1", "control periods between them", least=1, most=MOST_SEEN)
    gap: float = gain(0.02, "m", "that the guard keeps", least=0.0)
    braking: float = gain(0.7, "m/s^2", "of the guard; 0: nothing is guarded", least=0.0)
    reaction: float = gain(0.2, "s", "of the guard", least=0.0)
    limits: bool = gain(False, "", "whether the base's accelerations and lag are seen")
    arrival: float = gain(0.0, "m", "from which a law ends the way to the goal; 0: the network does", least=0.0)
    moving: bool = gain(False, "", "whether what comes nearer by itself is seen")

    def __post_init__(self) -> None:
        super().__post_init__()
        check_trails(self)
        if self.num_beams % self.pool:
            raise ValueError(f"GoalFeatures: pool must divide num_beams, got {self.pool} and {self.num_beams}")

    posed: ClassVar[int] = 0
    shielded: ClassVar[bool | Literal["always"]] = True  # away from what an agent was trained on

    fields: ClassVar[tuple[str, ...]] = ("pose", "twist", "goal", "ranges")
    observation: ClassVar[type] = Observation

    @property
    def crumbed(self) -> int:
        """Returns how many numbers crumbs give."""
        return 2 + self.num_beams // self.pool if self.crumbs else 0

    @property
    def moved(self) -> int:
        """Returns how many numbers what moves gives."""
        return 2 * (self.num_beams // self.pool) if self.moving else 0

    def check(self, briefing: Briefing) -> None:
        """Raises ValueError unless the robots have a scan that can be read as the one that is seen."""
        given, angles = len(briefing.beam_angles), briefing.beam_angles
        around = given > 1 and abs(angles[0] + math.pi) < 1e-9 and abs(given * (angles[1] - angles[0]) - FULL) < 1e-6
        if not around or given < min(self.num_beams, LEAST_BEAMS) or briefing.max_range < self.max_range:
            spanned = math.degrees(angles[-1] - angles[0]) if given > 1 else 0.0
            raise ValueError(
                f"needs num_beams={self.num_beams}, or at least {LEAST_BEAMS}, over the full circle and max_range="
                f"{self.max_range:g} m or more, got {given} over {spanned:.0f} degrees and {briefing.max_range:g} m"
            )

    def width(self, num_twist: int) -> int:
        """Returns how many numbers one observation gives."""
        return 5 + num_twist + 2 * (self.num_beams // self.pool)

    def observe(self, observation: Observation, speeds: Array, out: Numbers) -> Array:
        """Fills out (b, width) and returns the angle (b,) of the frame that the action is meant in, rad."""
        ranges = self.read(observation.ranges)
        scales = np.array(
            [self.hull_radius, self.range_scale, self.distance_scale, self.speed_scale, self.yaw_scale, self.margin]
        )
        angles = np.zeros(len(out))
        fill_goal(
            observation.goal, observation.twist, ranges, speeds, scales,
            self.max_range, self.pool, self.frame == "goal", angles, out,
        )  # fmt: skip
        return angles

    def read(self, ranges: Array) -> Array:
        """Returns a scan (b, beams) as that of the beams that are known, (b, num_beams), m."""
        if ranges.shape[1] == self.num_beams:
            return ranges
        known = np.empty((len(ranges), self.num_beams))
        resample(ranges, known)
        return known

    def arrived(
        self, observation: Observation, twists: Array, speed: float, actuators: Actuators,
        tolerances: Tolerances = (None, None),
    ) -> Array:  # fmt: skip
        """Returns the twists, those of robots near their goal replaced by the law that ends the way.

        Args:
            tolerances: of the goals; the law comes no nearer than it needs to.
        """
        if not self.arrival:
            return twists
        most = min(actuators.yaw_acceleration, 3.0)
        nears = np.broadcast_to(rest_radius(ARRIVED, tolerances[0]), len(twists))
        for near in set(nears.tolist()):
            rows = np.flatnonzero(nears == near)
            scales = np.array([self.arrival, min(speed, 0.3), 1.5, near, 2.0, 0.5 * most, 1.5])
            goals, errors, left, ended = (
                each[rows]
                for each in (observation.goal, observation.goal_heading_error, observation.waypoints_left, twists)
            )
            arrive(goals, errors, left, scales, ended)
            twists[rows] = ended
        return twists

    def guarded(
        self,
        observation: Observation,
        twists: Array,
        speed: float,
        actuators: Actuators,
        eased: bool = False,
    ) -> Array:
        """Returns the twists with what would not stop in time taken away.

        Args:
            eased: whether an omni base that is slower than what it is guarded for turns and drives more gently.
        """
        if self.braking:
            braking = min(self.braking, 0.7 * actuators.acceleration)
            reaction = max(self.reaction, actuators.lag + 0.1)
            late = reaction - self.reaction + speed / braking - speed / self.braking
            turning = math.sqrt(braking / self.braking) if eased and twists.shape[1] == 3 else 1.0
            law = np.array([self.hull_radius + self.gap, braking, reaction, late, math.sqrt(turning), turning])
            guard(observation.ranges, observation.twist[:, -1].copy(), law, twists)
        return twists


class Crumbs(NamedTuple):
    """What robots remember of crumbs: columns of a memory."""

    dropped: NDArray[np.float32]  # (b,) how many
    least: NDArray[np.float32]  # (b,) m, the least distance to the goal
    distance: NDArray[np.float32]  # (b,) m, the last
    waited: NDArray[np.float32]  # (b,) s, without a lesser one
    places: NDArray[np.float32]  # (b, crumbs, 2) x, y, m: the last of them, in turn


class Sights(NamedTuple):
    """What robots remember of two earlier scans: columns of a memory."""

    ages: NDArray[np.float32]  # (b, 2) s, of the older and the newer
    older: NDArray[np.float32]  # (b, beams, 2) x, y, m, in the frame of the measured pose; NaN where nothing was met
    newer: NDArray[np.float32]


@any_layout
@allocating
def fill_goal(goals, twists, ranges, speeds, scales, max_range, pool, ahead, angles, out):
    """Fills the rows of `GoalFeatures.observe`, and the angles of their frames; scales: as it makes them."""
    hull, range_scale, distance_scale, speed_scale, yaw_scale, margin = scales
    beams = ranges.shape[1]
    step = 2.0 * math.pi / beams
    cosines = np.empty(beams)
    sines = np.empty(beams)
    for m in range(beams):
        sines[m], cosines[m] = sin_cos(m * step)
    side = (beams - 1) // 4  # beams to either side of a direction that point ahead
    directions = beams // pool
    for i in range(out.shape[0]):
        goal_bearing = bearing(goals[i, 1], goals[i, 0])
        distance = math.sqrt(goals[i, 0] * goals[i, 0] + goals[i, 1] * goals[i, 1])
        shift = math.floor(goal_bearing / step + 0.5) if ahead else 0
        frame = shift * step
        angles[i] = frame
        out[i, 0] = area_sine(distance / distance_scale)
        out[i, 1] = distance / (distance + 0.2)
        out[i, 2], out[i, 3] = sin_cos(goal_bearing - frame)
        out[i, 4] = speeds[i] / speed_scale
        k = 5
        last = twists.shape[1] - 1
        vx = twists[i, 0]
        if last == 2:
            sine, cosine = sin_cos(frame)
            vx = cosine * twists[i, 0] + sine * twists[i, 1]
            vy = cosine * twists[i, 1] - sine * twists[i, 0]
            out[i, k + 1] = min(max(vy / speed_scale, -LIMIT), LIMIT)
        out[i, k] = min(max(vx / speed_scale, -LIMIT), LIMIT)
        out[i, k + last] = min(max(twists[i, last] / yaw_scale, -LIMIT), LIMIT)
        k += last + 1
        for j in range(directions):
            nearest = np.inf
            for m in range(pool):
                nearest = min(nearest, ranges[i, (j * pool + m + shift) % beams])
            out[i, k] = range_scale / (range_scale + max(nearest - hull, 0.0))
            k += 1
        for j in range(directions):
            out[i, k + j] = max_range
        for b in range(beams):
            r = ranges[i, b]
            if r >= max_range:
                continue
            # only directions near that of the beam lead the disc to its point
            radius = min(hull + margin, r)
            at = (b - shift) % beams
            j = at // pool
            for toward in (-1, 1):
                m = abs(at - j * pool)
                while m <= side and r * sines[m] < radius:
                    aside = r * sines[m]
                    way = max(r * cosines[m] - math.sqrt(radius * radius - aside * aside), 0.0)
                    out[i, k + j % directions] = min(out[i, k + j % directions], way)
                    j += toward
                    m += pool
                j = at // pool + 1
        for j in range(directions):
            out[i, k + j] = range_scale / (range_scale + out[i, k + j])
        k += directions


@compiled
def resample(ranges, known):
    """Fills a scan (b, m) from one of n beams (b, n), both once around from the back on.

    Of more beams, the least of those nearer to the direction than half a step of the m; of fewer, the nearest, and of
    two as near the lesser.
    """
    n = ranges.shape[1]
    m = known.shape[1]
    for i in range(ranges.shape[0]):
        for j in range(m):
            # angles in parts of a circle of n m; the beam k stands at k m, the direction at j n
            first = (2 * j * n - max(n, m) + 2 * m - 1) // (2 * m)
            last = (2 * j * n + max(n, m)) // (2 * m)
            least = np.inf
            for k in range(first, last + 1):
                least = min(least, ranges[i, k % n])
            known[i, j] = least


@any_layout
@compiled
def fill_crumbs(poses, goals, angles, scales, crumbs, out):
    """Drops crumbs and fills what is known by them; see `GoalFeatures`."""
    dt, gap, range_scale = scales
    count = crumbs.places.shape[1]
    directions = out.shape[1] - 2
    for i in range(out.shape[0]):
        x = poses[i, 0]
        y = poses[i, 1]
        # as the memory keeps it: what was rounded up there would else be undercut by a robot that stands
        distance = np.float32(math.sqrt(goals[i, 0] * goals[i, 0] + goals[i, 1] * goals[i, 1]))
        dropped = int(crumbs.dropped[i])
        begins = dropped == 0
        last = (dropped - 1) % count
        dx = x - crumbs.places[i, last, 0]
        dy = y - crumbs.places[i, last, 1]
        if begins or math.sqrt(dx * dx + dy * dy) >= gap:
            crumbs.places[i, dropped % count, 0] = x
            crumbs.places[i, dropped % count, 1] = y
            dropped += 1
            crumbs.dropped[i] = dropped
        # a goal that jumps away is the next one
        if begins or distance < crumbs.least[i] or distance > crumbs.distance[i] + NEXT_GOAL:
            crumbs.least[i] = distance
            crumbs.waited[i] = 0.0
        else:
            crumbs.waited[i] += dt
        crumbs.distance[i] = distance
        out[i, 0] = area_sine(distance - crumbs.least[i])
        out[i, 1] = crumbs.waited[i] / (crumbs.waited[i] + 5.0)
        out[i, 2:] = 0.0
        heading = poses[i, 2] + angles[i]
        for k in range(min(dropped, count)):
            dx = crumbs.places[i, k, 0] - x
            dy = crumbs.places[i, k, 1] - y
            turn = wrap_angle(bearing(dy, dx) - heading) / (2.0 * math.pi)
            j = 2 + math.floor(turn * directions + 0.5) % directions
            out[i, j] = max(out[i, j], range_scale / (range_scale + math.sqrt(dx * dx + dy * dy)))


@any_layout
@allocating
def fill_moving(poses, ranges, angles, scales, max_range, pool, sights, out):
    """Fills what comes nearer by itself, in every direction; see `GoalFeatures`."""
    dt, hull, margin, range_scale = scales
    beams = ranges.shape[1]
    directions = beams // pool
    step = 2.0 * math.pi / beams
    for i in range(out.shape[0]):
        x = poses[i, 0]
        y = poses[i, 1]
        sine, cosine = sin_cos(poses[i, 2])
        shift = math.floor(angles[i] / step + 0.5)
        taken = shelve(sights, i, dt)
        age = sights.ages[i, 0]
        lines = sights.older[i].copy()
        boxes = boxes_of(lines)
        out[i, :] = 0.0
        for b in range(beams):
            r = ranges[i, b]
            if r <= 0.0 or r >= (1.0 - 1e-6) * max_range:
                continue
            s, c = sin_cos(b * step - math.pi)
            ux = cosine * c - sine * s
            uy = sine * c + cosine * s
            px = x + r * ux
            py = y + r * uy
            if taken:
                sights.newer[i, b, 0] = px
                sights.newer[i, b, 1] = py
            if r > WATCHED or r <= hull:
                continue
            squared, rx, ry = step_of_surface(lines, boxes, px, py, FASTEST * age * FASTEST * age)
            nearer = -(rx * ux + ry * uy)
            j = (b - shift) % beams // pool
            if abs(nearer) > 0.5 * MOVED and abs(nearer) > age * abs(out[i, j]):
                out[i, j] = nearer / age
            if nearer > MOVED:
                ahead = min(FORESIGHT / age, (r - hull) / math.sqrt(squared))
                fx = r * ux + ahead * rx
                fy = r * uy + ahead * ry
                away = max(math.sqrt(fx * fx + fy * fy), 1e-6)
                covered = min((hull + margin) / away, 1.0)
                half = bearing(covered, math.sqrt(1.0 - covered * covered)) / (pool * step)
                middle = wrap_angle(bearing(fy, fx) - poses[i, 2] - angles[i] + math.pi) / (pool * step)
                near = range_scale / (range_scale + max(away - hull, 0.0))
                for k in range(math.ceil(middle - half - 0.5), math.floor(middle + half + 0.5) + 1):
                    at = directions + k % directions
                    out[i, at] = max(out[i, at], near)


@inlined
def shelve(sights, i, dt):
    """Lets robot i's sights grow older by dt (s); returns whether a new one is to be taken, for which it makes room."""
    sights.ages[i, 0] += dt
    sights.ages[i, 1] += dt
    if sights.ages[i, 1] < INTERVAL - 0.5 * dt:
        return False
    for j in range(sights.newer.shape[1]):
        for side in range(2):
            sights.older[i, j, side] = sights.newer[i, j, side]
            sights.newer[i, j, side] = np.nan
    sights.ages[i, 0] = sights.ages[i, 1]
    sights.ages[i, 1] = 0.0
    return True
