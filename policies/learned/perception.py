"""What a network sees and what its outputs mean: numbers of order one, from named fields of observations, to twists.

Training and driving run the same code, so that an agent meets the numbers that it was trained on.
"""

import dataclasses
import math
from collections.abc import Mapping
from typing import Any, ClassVar, Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from wayfield.envs import goal_reaching, path_following
from wayfield.envs.briefing import Briefing
from wayfield.envs.checks import choose, shown
from wayfield.envs.compiled import allocating, any_layout, compiled, inlined
from wayfield.envs.elementary import area_sine
from wayfield.envs.geometry import bearing, sin_cos, wrap_angle
from wayfield.envs.kinematics import limit_acceleration, saturation_factor
from wayfield.envs.robots import Actuators, Robot
from wayfield.policies.learned.reading import is_number
from wayfield.policies.parts.arriving import is_there, turn_rate
from wayfield.policies.parts.steering import unicycle_twists
from wayfield.policies.parts.stopping import FASTEST, INTERVAL, MOVED, WATCHED, step_of_surface
from wayfield.policies.policy import check_gain, check_whole

Array = NDArray[np.float64]
Numbers = NDArray[np.float32]

LIMIT = 5.0  # beyond which a number tells a network nothing new
NEXT_GOAL = 0.5  # m, by which the distance to the goal grows only where the goal is another
MOST_SEEN = 1000  # of frames, points, actions, crumbs and trails, and MOST_BEAMS of beams: they size memory
MOST_BEAMS = 10_000
MOST_INPUTS, MOST_KEPT = 2**16, 2**20  # numbers that a network may see, and a robot remember
LEAST_BEAMS = 32  # of a scan that is read as one of more
ASIDE = 0.3  # rad, of a goal, beyond which a differential drive turns before it drives on to it
FULL = 2.0 * math.pi  # rad
FORESIGHT = 1.2  # s, for which what comes nearer by itself is put forward
NEAR = 0.01  # m, under which two points of a path give no direction
POSE = 5  # numbers of `fill_pose`


@dataclasses.dataclass(frozen=True)
class PathFeatures:
    """Of a path follower: its errors, its motion, the preview, the speed asked for, and what it did last.

    asinh(e / error_scale), asinh(turn / turn_scale), the rest by plain division. The preview is seen twice: as points
    about the body, and as the turns of the path between them, which are what a steering law asks for. With `limits` it
    sees what its base can do, too: see `limits_of`.
    """

    num_preview: int = 10
    error_scale: float = 0.02  # m, up to which the cross-track error is seen in proportion
    preview_scale: float = 0.5  # m
    turn_scale: float = 0.1  # rad, up to which a turn of the path from point to point is seen in proportion
    speed_scale: float = 0.6  # m/s
    yaw_scale: float = 2.0  # rad/s
    previous: int = 2  # own actions seen
    trails: tuple[float, ...] = ()  # s, see GoalFeatures
    frames: int = 1  # observations seen
    stride: int = 1  # control periods between them
    limits: bool = False  # whether the base's accelerations and lag are seen

    crumbs: ClassVar[int] = 0
    crumbed: ClassVar[int] = 0  # numbers that crumbs give
    moved: ClassVar[int] = 0  # numbers that what moves gives
    posed: ClassVar[int] = 0  # numbers that a pose to rest at gives

    def __post_init__(self) -> None:
        check_seen(self)
        for name in ("error_scale", "preview_scale", "turn_scale", "speed_scale", "yaw_scale"):
            check_gain(self, name, above=0.0)
        check_whole(self, "num_preview", most=MOST_SEEN)

    fields: ClassVar[tuple[str, ...]] = ("cross_track_error", "heading_error", "twist", "preview")
    observation: ClassVar[type] = path_following.Observation

    def check(self, briefing: Briefing) -> None:
        """Refuses no robot: `observe` looks at the preview."""

    def width(self, num_twist: int) -> int:
        """Returns how many numbers one observation gives."""
        return 5 + num_twist + 3 * self.num_preview

    def observe(self, observation: path_following.Observation, speeds: Array, out: Numbers) -> Array:
        """Fills out (b, width) and returns the angle (b,) of the frame that the action is meant in: 0, the body's."""
        if observation.preview.shape[1] != self.num_preview:
            raise ValueError(f"preview has {observation.preview.shape[1]} points, the agent knows {self.num_preview}")
        scales = np.array([self.error_scale, self.preview_scale, self.speed_scale, self.yaw_scale, self.turn_scale])
        fill_path(
            observation.cross_track_error, observation.heading_error, observation.twist, observation.preview,
            speeds, scales, out,
        )  # fmt: skip
        return np.zeros(len(out))

    def arrived(
        self, observation: path_following.Observation, twists: Array, speed: float, actuators: Actuators
    ) -> Array:
        """Returns the twists as they are: a path ends where it ends."""
        return twists

    def guarded(
        self,
        observation: path_following.Observation,
        twists: Array,
        speed: float,
        actuators: Actuators,
        eased: bool = False,
    ) -> Array:
        """Returns the twists as they are: nothing stands beside a path."""
        return twists


@dataclasses.dataclass(frozen=True)
class GoalFeatures:
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

    num_beams: int = 72
    hull_radius: float = 0.3  # m
    max_range: float = 5.0  # m
    range_scale: float = 0.5  # m
    margin: float = 0.03  # m
    distance_scale: float = 1.0  # m
    speed_scale: float = 0.6  # m/s
    yaw_scale: float = 2.0  # rad/s
    pool: int = 2  # beams
    frame: Literal["goal", "body"] = "goal"
    previous: int = 1  # own actions seen
    trails: tuple[float, ...] = (1.0, 3.0, 10.0, 30.0)  # s
    crumbs: int = 0
    crumb_gap: float = 0.3  # m
    frames: int = 1  # observations seen
    stride: int = 1  # control periods between them
    gap: float = 0.02  # m
    braking: float = 0.7  # m/s^2; 0: nothing is guarded
    reaction: float = 0.2  # s
    limits: bool = False  # whether the base's accelerations and lag are seen
    arrival: float = 0.0  # m; 0: the network drives to the end
    moving: bool = False  # whether what comes nearer by itself is seen

    def __post_init__(self) -> None:
        check_seen(self)
        if not isinstance(self.moving, bool):
            raise ValueError(f"GoalFeatures: moving must be true or false, got {shown(self.moving)}")
        for name in ("max_range", "range_scale", "distance_scale", "speed_scale", "yaw_scale", "crumb_gap"):
            check_gain(self, name, above=0.0)
        for name in ("hull_radius", "margin", "gap", "braking", "reaction", "arrival"):
            check_gain(self, name, least=0.0)
        check_whole(self, "crumbs", most=MOST_SEEN)
        check_whole(self, "num_beams", least=1, most=MOST_BEAMS)
        check_whole(self, "pool", least=1)
        if self.num_beams % self.pool:
            raise ValueError(f"GoalFeatures: pool must divide num_beams, got {self.pool} and {self.num_beams}")
        choose("frame", self.frame, ("goal", "body"))

    posed: ClassVar[int] = 0

    fields: ClassVar[tuple[str, ...]] = ("pose", "twist", "goal", "ranges")
    observation: ClassVar[type] = goal_reaching.Observation

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

    def observe(self, observation: goal_reaching.Observation, speeds: Array, out: Numbers) -> Array:
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
        self, observation: goal_reaching.Observation, twists: Array, speed: float, actuators: Actuators
    ) -> Array:
        """Returns the twists, those of robots near their goal replaced by the law that ends the way."""
        if self.arrival:
            most = min(actuators.yaw_acceleration, 3.0)
            scales = np.array([self.arrival, min(speed, 0.3), 1.5, 0.015, 2.0, 0.5 * most, 1.5])
            heading_errors, left = observation.goal_heading_error, observation.waypoints_left
            arrive(observation.goal, heading_errors, left, scales, twists)
        return twists

    def guarded(
        self,
        observation: goal_reaching.Observation,
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


@dataclasses.dataclass(frozen=True)
class DockFeatures(GoalFeatures):
    """Of a robot that comes to rest at a pose: what a goal seeker sees, and that pose once more, finely.

    Besides the numbers of `GoalFeatures`, its place as asinh(x / fine) and asinh(y / fine) in the body frame, and the
    turn e to its heading as sin e, cos e and asinh(e / fine_turn). It is guarded as a goal seeker, forward and
    backward; and where the robot is within `rest` and `rest_turn` of the pose it is told to stand still, in training
    too: to hold still is no network's strength, and what explores never does.
    """

    trails: tuple[float, ...] = ()  # s
    frame: Literal["goal", "body"] = "body"
    limits: bool = True
    fine: float = 0.05  # m, up to which the place is seen in proportion
    fine_turn: float = 0.05  # rad
    rest: float = 0.02  # m
    rest_turn: float = 0.02  # rad

    def __post_init__(self) -> None:
        super().__post_init__()
        for name in ("fine", "fine_turn", "rest", "rest_turn"):
            check_gain(self, name, above=0.0)

    posed: ClassVar[int] = POSE

    fields: ClassVar[tuple[str, ...]] = ("pose", "twist", "goal", "goal_heading_error", "ranges")

    def width(self, num_twist: int) -> int:
        """Returns how many numbers one observation gives."""
        return super().width(num_twist) + POSE

    def observe(self, observation: goal_reaching.Observation, speeds: Array, out: Numbers) -> Array:
        """Fills out (b, width) and returns the angle (b,) of the frame that the action is meant in, rad."""
        angles = super().observe(observation, speeds, out[:, :-POSE])
        scales = np.array([self.fine, self.fine_turn])
        fill_pose(observation.goal, observation.goal_heading_error, angles, scales, out[:, -POSE:])
        return angles

    def guarded(
        self,
        observation: goal_reaching.Observation,
        twists: Array,
        speed: float,
        actuators: Actuators,
        eased: bool = False,
    ) -> Array:
        """Returns the twists with what would not stop in time taken away, and none where the robot is to rest."""
        twists = super().guarded(observation, twists, speed, actuators, eased)
        x, y = observation.goal[:, 0], observation.goal[:, 1]
        there = (x * x + y * y < self.rest * self.rest) & (observation.waypoints_left < 0.5)
        twists[there & (np.abs(observation.goal_heading_error) < self.rest_turn)] = 0.0
        return twists


Features = PathFeatures | GoalFeatures
LIMITS = 3  # numbers of `limits_of`
FEATURES: Mapping[str, type[Features]] = {
    "path_following": PathFeatures,
    "goal_reaching": GoalFeatures,
    "docking": DockFeatures,
}  # by task


def check_seen(features: Features) -> None:
    """Raises ValueError, naming the field, its value and its range, unless what both features have is right."""
    check_whole(features, "previous", most=MOST_SEEN)
    for name in ("frames", "stride"):
        check_whole(features, name, least=1, most=MOST_SEEN)
    if not isinstance(features.limits, bool):
        raise ValueError(f"{type(features).__name__}: limits must be true or false, got {shown(features.limits)}")
    trails = features.trails
    if not isinstance(trails, tuple) or not all(is_number(each) and each > 0.0 for each in trails):
        raise ValueError(f"{type(features).__name__}: trails must be times > 0 s, got {shown(trails)}")
    if len(trails) > MOST_SEEN:
        raise ValueError(f"{type(features).__name__}: trails must be at most {MOST_SEEN}, got {len(trails)}")


def limits_of(features: Features, actuators: Actuators) -> Numbers:
    """Returns what a network sees of a base (3,): s_v / a, s_w / alpha and lag / 0.1 s, each at most 5.

    a and alpha are the accelerations (m/s^2, rad/s^2), s_v and s_w the scales of speed and yaw rate: so the first two
    are the seconds that a usual change of the twist takes, and all are 0 for a base that does at once what it is told.
    """
    seen = np.array(
        [
            features.speed_scale / actuators.acceleration,
            features.yaw_scale / actuators.yaw_acceleration,
            actuators.lag / 0.1,
        ],
        np.float32,
    )
    return np.minimum(seen, np.float32(LIMIT))


@dataclasses.dataclass(frozen=True)
class Actions:
    """What the outputs of a network mean, each clipped to [-1, 1].

    "unicycle": v = speed ((1 + reverse) (a_0 + 1)/2 - reverse), w = yaw_rate a_1. "planar": the velocity speed (a_0,
    a_1), no faster than speed, in the frame of the features; no turning.
    """

    kind: Literal["unicycle", "planar"] = "unicycle"
    yaw_rate: float = 2.0  # rad/s
    reverse: float = 0.0  # share of the speed, of the fastest "unicycle" backwards

    def __post_init__(self) -> None:
        choose("kind", self.kind, ("unicycle", "planar"))
        check_gain(self, "yaw_rate", above=0.0)
        check_gain(self, "reverse", least=0.0, most=1.0)

    @property
    def size(self) -> int:
        """Returns how many outputs the network has."""
        return 2

    def twists(self, actions: NDArray[Any], speeds: Array, angles: Array, robot: Robot) -> Array:
        """Returns the twists (b, t) of actions (b, 2) in [-1, 1], m/s and rad/s."""
        a = actions.astype(np.float64)
        if self.kind == "unicycle":
            forward = 0.5 * (1.0 + self.reverse) * (a[:, 0] + 1.0) - self.reverse
            return unicycle_twists(robot, speeds * forward, self.yaw_rate * a[:, 1])
        speeds = speeds / np.maximum(np.sqrt(a[:, 0] * a[:, 0] + a[:, 1] * a[:, 1]), 1.0)
        out = np.zeros((len(a), 3))
        turn(a, speeds, angles, out)
        return out

    def added(
        self, twists: Array, actions: NDArray[Any], reach: float, speeds: Array, angles: Array, robot: Robot
    ) -> Array:
        """Returns the twists (b, t) of a controller with what actions (b, 2) add to them; see `base.Base`."""
        a = reach * actions.astype(np.float64)
        out = twists.copy()
        if self.kind != "planar":
            out[:, 0] += 0.5 * (1.0 + self.reverse) * speeds * a[:, 0]
            out[:, -1] += self.yaw_rate * a[:, 1]
        else:
            more = np.zeros((len(a), 3))
            turn(a, speeds, angles, more)
            out[:, :2] += more[:, :2]
        planar = slice(0, 2 if robot.holonomic else 1)
        most = np.maximum(speeds, np.linalg.norm(twists[:, planar], axis=1))
        out[:, planar] *= (most / np.maximum(np.linalg.norm(out[:, planar], axis=1), most))[:, None]
        return out

    def of_twists(self, twists: Array, speeds: Array, angles: Array) -> Numbers:
        """Returns the actions (b, 2) that come nearest to twists (b, t)."""
        if self.kind == "unicycle":
            forward = 2.0 * (twists[:, 0] / speeds + self.reverse) / (1.0 + self.reverse) - 1.0
            a = np.column_stack([forward, twists[:, -1] / self.yaw_rate])
        else:
            a = np.zeros((len(twists), 3))
            turn(twists / speeds[:, None], np.ones(len(twists)), -angles, a)
        return np.clip(a[:, :2], -1.0, 1.0).astype(np.float32)


class Perception:
    """From observations to the inputs of a network, with a memory of one row a robot.

    Where the network adds to a controller, its inputs end with the action that comes nearest to what that asks for.

    Raises:
        ValueError: if there were more numbers to see or to remember than memory is meant for.
    """

    def __init__(self, features: Features, actions: Actions, num_twist: int, dt: float, based: bool = False) -> None:
        self.features = features
        self.actions = actions
        self.width = features.width(num_twist)
        self.trails = np.array(features.trails, np.float64)
        self.shares = 1.0 - np.exp(-dt / self.trails)  # of the way to a trailing point that it is drawn on in a step
        self.dt = dt
        self.asked = actions.size if based else 0
        self.limits = LIMITS if features.limits else 0
        self.crumbed = features.crumbed
        self.moved = features.moved
        kept = self._kept()
        before = features.previous * actions.size + 2 * len(self.trails) + self.crumbed + self.moved
        self.num_inputs = self.width * features.frames + before + self.limits + self.asked
        for what, count, most in (
            ("sees", self.num_inputs, MOST_INPUTS),
            ("remembers", sum(math.prod(shape) for shape in kept.values()), MOST_KEPT),
        ):
            if count > most:
                raise ValueError(f"{type(features).__name__} {what} {count} numbers of a robot; at most {most} may be")
        self.memory = np.dtype([(name, np.float32, shape) for name, shape in kept.items()])

    def _kept(self) -> dict[str, tuple[int, ...]]:
        """Returns the shapes of what a robot remembers, by name."""
        features = self.features
        kept: dict[str, tuple[int, ...]] = {"actions": (features.previous, self.actions.size)}  # newest first
        if len(self.trails):
            kept |= {"begun": (), "trails": (len(self.trails), 2)}  # whether they have; x, y of each, m
        if features.crumbs:
            kept |= dict.fromkeys(Crumbs._fields[:-1], ()) | {"places": (features.crumbs, 2)}
        if isinstance(features, GoalFeatures) and features.moving:
            kept |= {"ages": (2,), "older": (features.num_beams, 2), "newer": (features.num_beams, 2)}
        return kept | {"seen": ((features.frames - 1) * features.stride, self.width)}  # newest first

    def fresh(self, num_envs: int) -> NDArray[np.void]:
        """Returns the memory (num_envs,) of robots that have seen and done nothing: zeros."""
        return np.zeros(num_envs, self.memory)

    def inputs(
        self,
        observation: Any,
        speeds: Array,
        memory: NDArray[np.void],
        asked: Array | None = None,
        limits: Numbers | None = None,
    ) -> tuple[Numbers, Array]:
        """Returns the inputs (b, num_inputs) of the network and the angle (b,) of the frame of its action, rad.

        Draws the trailing points on; call it once a step.

        Args:
            asked: (b, t) m/s and rad/s, the twists of the controller that the network adds to, if it does.
            limits: (b, 3) or (3,), see `limits_of`; needed where the features ask for them.
        """
        inputs = np.empty((len(memory), self.num_inputs), np.float32)
        angles = self.features.observe(observation, speeds, inputs[:, : self.width])
        at = self.width + self.features.previous * self.actions.size
        inputs[:, self.width : at] = memory["actions"].reshape(len(memory), -1)
        if len(self.trails):
            scales = self.features.speed_scale * self.trails
            trailed = inputs[:, at : at + 2 * len(scales)]
            fill_trails(observation.pose, angles, self.shares, scales, memory["begun"], memory["trails"], trailed)
            at += 2 * len(scales)
        if isinstance(self.features, GoalFeatures) and self.crumbed:
            scales = np.array([self.dt, self.features.crumb_gap, self.features.range_scale])
            crumbs = Crumbs(*(memory[name] for name in Crumbs._fields))
            fill_crumbs(observation.pose, observation.goal, angles, scales, crumbs, inputs[:, at : at + self.crumbed])
            at += self.crumbed
        if isinstance(self.features, GoalFeatures) and self.moved:
            ranges = self.features.read(observation.ranges)
            features = self.features
            scales = np.array([self.dt, features.hull_radius, features.margin, features.range_scale])
            sights = Sights(*(memory[name] for name in Sights._fields))
            moved = inputs[:, at : at + self.moved]
            fill_moving(observation.pose, ranges, angles, scales, features.max_range, features.pool, sights, moved)
            at += self.moved
        for k in range(1, self.features.frames):
            inputs[:, at : at + self.width] = memory["seen"][:, k * self.features.stride - 1]
            at += self.width
        if self.limits:
            assert limits is not None
            inputs[:, at : at + self.limits] = limits
            at += self.limits
        if asked is not None:
            inputs[:, at:] = self.actions.of_twists(asked, speeds, angles)
        return inputs, angles

    def remember(self, inputs: Numbers, actions: NDArray[Any], memory: NDArray[np.void]) -> None:
        """Puts what was just seen and done at the head of the memory."""
        for name, newest in (("actions", actions), ("seen", inputs[:, : self.width])):
            if memory[name].size:
                memory[name][:, 1:] = memory[name][:, :-1].copy()
                memory[name][:, 0] = newest


class TurnLaw(NamedTuple):
    """What `arriving.turn_rate` reads."""

    turn_gain: float  # 1/s
    yaw_acceleration: float  # rad/s^2
    max_yaw_rate: float  # rad/s


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
@compiled
def fill_path(errors, heading_errors, twists, previews, speeds, scales, out):
    """Fills the rows of `PathFeatures.observe`."""
    for i in range(out.shape[0]):
        out[i, 0] = area_sine(errors[i] / scales[0])
        out[i, 1] = min(max(errors[i] / (10.0 * scales[0]), -LIMIT), LIMIT)
        out[i, 2], out[i, 3] = sin_cos(heading_errors[i])
        out[i, 4] = speeds[i] / scales[2]
        k = 5
        last = twists.shape[1] - 1
        for j in range(last + 1):
            out[i, k] = min(max(twists[i, j] / (scales[3] if j == last else scales[2]), -LIMIT), LIMIT)
            k += 1
        for j in range(previews.shape[1]):
            for side in range(2):
                out[i, k] = min(max(previews[i, j, side] / scales[1], -LIMIT), LIMIT)
                k += 1
        # from the nearest point of the path on, in the body frame
        heading = -heading_errors[i]
        sine, cosine = sin_cos(heading)
        x = errors[i] * sine
        y = -errors[i] * cosine
        for j in range(previews.shape[1]):
            dx = previews[i, j, 0] - x
            dy = previews[i, j, 1] - y
            turn = 0.0
            if dx * dx + dy * dy > NEAR * NEAR:  # where a path ends, all points are one
                ahead = bearing(dy, dx)
                turn = wrap_angle(ahead - heading)
                heading = ahead
            out[i, k] = area_sine(turn / scales[4])
            k += 1
            x = previews[i, j, 0]
            y = previews[i, j, 1]


@any_layout
@allocating
def fill_goal(goals, twists, ranges, speeds, scales, max_range, pool, ahead, angles, out):
    """Fills the rows of `GoalFeatures.observe`, and the angles of their frames."""
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
        out[i, 0] = area_sine(distance / scales[2])
        out[i, 1] = distance / (distance + 0.2)
        out[i, 2], out[i, 3] = sin_cos(goal_bearing - frame)
        out[i, 4] = speeds[i] / scales[3]
        k = 5
        last = twists.shape[1] - 1
        vx = twists[i, 0]
        if last == 2:
            sine, cosine = sin_cos(frame)
            vx = cosine * twists[i, 0] + sine * twists[i, 1]
            vy = cosine * twists[i, 1] - sine * twists[i, 0]
            out[i, k + 1] = min(max(vy / scales[3], -LIMIT), LIMIT)
        out[i, k] = min(max(vx / scales[3], -LIMIT), LIMIT)
        out[i, k + last] = min(max(twists[i, last] / scales[4], -LIMIT), LIMIT)
        k += last + 1
        for j in range(directions):
            nearest = np.inf
            for m in range(pool):
                nearest = min(nearest, ranges[i, (j * pool + m + shift) % beams])
            out[i, k] = scales[1] / (scales[1] + max(nearest - scales[0], 0.0))
            k += 1
        for j in range(directions):
            out[i, k + j] = max_range
        for b in range(beams):
            r = ranges[i, b]
            if r >= max_range:
                continue
            # only directions near that of the beam lead the disc to its point
            radius = min(scales[0] + scales[5], r)
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
            out[i, k + j] = scales[1] / (scales[1] + out[i, k + j])
        k += directions


@any_layout
@compiled
def fill_pose(goals, turns, angles, scales, out):
    """Fills what `DockFeatures.observe` adds."""
    fine, fine_turn = scales
    for i in range(out.shape[0]):
        sine, cosine = sin_cos(angles[i])
        out[i, 0] = area_sine((cosine * goals[i, 0] + sine * goals[i, 1]) / fine)
        out[i, 1] = area_sine((cosine * goals[i, 1] - sine * goals[i, 0]) / fine)
        out[i, 2], out[i, 3] = sin_cos(turns[i])
        out[i, 4] = area_sine(turns[i] / fine_turn)


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
def arrive(goals, turns, waypoints_left, scales, twists):
    """Replaces the twists (b, t) of robots within scales[0] of their goal; see `GoalFeatures.arrived`.

    v = min(scales[1], scales[2] d) towards the goal, which a differential drive first turns to; where `is_there` says
    so within scales[3], the base turns to the goal's heading, a holonomic one on the way.
    """
    reach, most, gain, near, turn_gain, yaw_acceleration, max_yaw_rate = scales
    law = TurnLaw(turn_gain, yaw_acceleration, max_yaw_rate)
    last = twists.shape[1] - 1
    for i in range(twists.shape[0]):
        x = goals[i, 0]
        y = goals[i, 1]
        distance = math.sqrt(x * x + y * y)
        if waypoints_left[i] > 0.5 or distance > reach:
            continue
        v = min(most, gain * distance)
        if last == 2:
            share = v / max(distance, 1e-9)
            twists[i, 0] = share * x
            twists[i, 1] = share * y
            twists[i, 2] = turn_rate(law, turns[i])
        elif is_there(False, x, y, near):
            twists[i, 0] = 0.0
            twists[i, 1] = turn_rate(law, turns[i])
        else:
            aside = bearing(y, x)
            twists[i, 0] = v if abs(aside) < ASIDE else 0.0
            twists[i, 1] = turn_rate(law, aside)


@any_layout
@compiled
def hold(law, matrix, held, twists):
    """Turns twists (b, t) into those that a slower base would drive by them, as the kinematic plant has it.

    law: acceleration (m/s^2), yaw acceleration (rad/s^2), control period (s), share of a deviation that its lag leaves
    after that, mean share of it until then, and the limits of the wheel speeds and of the yaw rate (rad/s). matrix
    (n, 3): of the wheels.
    held (b, 2, 3): the command, and the twist at which the slower base's wheels would turn by now.
    """
    acceleration, yaw_acceleration, dt, decay, mean, limit, turn_limit = law
    last = twists.shape[1] - 1
    for i in range(twists.shape[0]):
        x = twists[i, 0]
        y = twists[i, 1] if last == 2 else 0.0
        w = twists[i, last]
        factor = saturation_factor(matrix, matrix.shape[0], limit, turn_limit, x, y, w)
        x, y, w = limit_acceleration(
            held[i, 0, 0], held[i, 0, 1], held[i, 0, 2],
            factor * x, factor * y, factor * w, acceleration, yaw_acceleration, dt,
        )  # fmt: skip
        for k in range(3):
            command = x if k == 0 else y if k == 1 else w
            deviation = held[i, 1, k] - command
            held[i, 0, k] = command
            held[i, 1, k] = command + decay * deviation
            if k == 0:
                twists[i, 0] = command + mean * deviation
            elif k == 1 and last == 2:
                twists[i, 1] = command + mean * deviation
            elif k == 2:
                twists[i, last] = command + mean * deviation


@compiled
def turn(actions, speeds, angles, out):
    """Fills the planar velocities (b, 3) of actions meant in turned frames."""
    for i in range(out.shape[0]):
        sine, cosine = sin_cos(angles[i])
        out[i, 0] = speeds[i] * (cosine * actions[i, 0] - sine * actions[i, 1])
        out[i, 1] = speeds[i] * (sine * actions[i, 0] + cosine * actions[i, 1])


@any_layout
@compiled
def fill_trails(poses, angles, shares, scales, begun, trails, out):
    """Draws on the trailing points (b, k, 2), begun or not, and fills where they are, in the frames."""
    for i in range(out.shape[0]):
        sine, cosine = sin_cos(poses[i, 2] + angles[i])
        on = begun[i] > 0.0
        begun[i] = 1.0
        for k in range(shares.shape[0]):
            for side in range(2):
                if on:
                    trails[i, k, side] += shares[k] * (poses[i, side] - trails[i, k, side])
                else:
                    trails[i, k, side] = poses[i, side]
            dx = (trails[i, k, 0] - poses[i, 0]) / scales[k]
            dy = (trails[i, k, 1] - poses[i, 1]) / scales[k]
            out[i, 2 * k] = min(max(cosine * dx + sine * dy, -LIMIT), LIMIT)
            out[i, 2 * k + 1] = min(max(cosine * dy - sine * dx, -LIMIT), LIMIT)


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
            squared, rx, ry = step_of_surface(lines, px, py, FASTEST * age * FASTEST * age)
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


@any_layout
@allocating
def guard(ranges, yaw_rates, law, twists):
    """Slows the twists (b, t) down; see `GoalFeatures`. The scan goes once around, from the back.

    law: hull (m), braking (m/s^2), reaction (s), for how long (s) differential drives turn on before they stop, and
    the shares of the velocity and of the yaw rate that are driven at all.
    """
    hull, braking, reaction, late, driving, turning = law
    beams = ranges.shape[1]
    cosines = np.empty(beams)
    sines = np.empty(beams)
    for j in range(beams):
        sines[j], cosines[j] = sin_cos(j * (2.0 * math.pi / beams) - math.pi)
    planar = twists.shape[1] == 3
    for i in range(ranges.shape[0]):
        vx = driving * twists[i, 0]
        vy = driving * twists[i, 1] if planar else 0.0
        w = turning * twists[i, twists.shape[1] - 1]
        twists[i, twists.shape[1] - 1] = w
        if abs(yaw_rates[i]) > abs(w):
            w = yaw_rates[i]
        turned = 0.0 if planar else min(max(late * w, -0.5 * math.pi), 0.5 * math.pi)
        sine, cosine = sin_cos(turned)
        for turn in range(3):
            share = 1.0
            for j in range(beams):
                towards = vx * cosines[j] + vy * sines[j]
                if turned != 0.0 and vx > 0.0:
                    after = cosines[j] * cosine + sines[j] * sine
                    between = sines[j] * turned > 0.0 and (cosine * sines[j] - sine * cosines[j]) * turned < 0.0
                    towards = vx if between and cosines[j] > 0.0 else max(towards, vx * after)
                if towards <= 0.0:
                    continue
                room = max(ranges[i, j] - hull, 0.0)
                most = braking * (math.sqrt(reaction * reaction + 2.0 * room / braking) - reaction)
                if towards <= most:
                    continue
                if planar and turn < 2:
                    vx -= (towards - most) * cosines[j]
                    vy -= (towards - most) * sines[j]
                else:
                    share = min(share, most / towards)
            vx *= share
            vy *= share
        twists[i, 0] = vx
        if planar:
            twists[i, 1] = vy
