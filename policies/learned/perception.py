"""What a network sees and what its outputs mean: numbers of order one, from named fields of observations, to twists.

Training and driving run the same code, so that an agent meets the numbers that it was trained on.
"""

import dataclasses
import math
from collections.abc import Mapping
from typing import Any, Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from wayfield.envs.robots import Actuators, Robot
from wayfield.envs.robots.kinematics import limits
from wayfield.envs.tasks.briefing import Briefing
from wayfield.policies.learned.features import LIMIT, Array, Numbers
from wayfield.policies.learned.features_dock import DockFeatures
from wayfield.policies.learned.features_goal import Crumbs, GoalFeatures, Sights, fill_crumbs, fill_moving
from wayfield.policies.learned.features_path import PathFeatures
from wayfield.policies.learned.features_reference import ReferenceFeatures
from wayfield.policies.learned.features_sheet import RobotFeatures, SheetFeatures
from wayfield.policies.learned.features_team import TeamFeatures
from wayfield.policies.parts.gain import Gains, gain
from wayfield.policies.parts.steering import unicycle_twists
from wayfield.system.compiled import any_layout, compiled
from wayfield.system.elementary import sin_cos

MOST_INPUTS, MOST_REMEMBERED = 2**16, 2**20  # numbers that a network may see, and a robot remember


Features = PathFeatures | GoalFeatures
LIMITS = 3  # numbers of `limits_of`, but of `SheetFeatures`
FEATURES: Mapping[str, type[Features]] = {
    "path_following": PathFeatures,
    "goal_reaching": GoalFeatures,
    "trajectory_tracking": ReferenceFeatures,
    "docking": DockFeatures,
    "teams": TeamFeatures,
    "people": TeamFeatures,
}  # by task


def features_kind(task: str, described: Mapping[str, Any]) -> type[Features]:
    """Returns the class of the features that a card describes; among others, an agent may see its scan alone."""
    kind = FEATURES[task]
    return GoalFeatures if kind is TeamFeatures and "bodies" not in described else kind


def features_for(features: Features, briefing: Briefing, speed: float) -> Features:
    """Returns the features of a robot: those of any made for the one that is briefed, asked for a speed (m/s)."""
    return features.of(briefing, speed) if isinstance(features, SheetFeatures) else features


def limits_of(features: Features, actuators: Actuators) -> Numbers:
    """Returns what a network sees of a base, (3,): s_v / a, s_w / alpha and lag / 0.1 s, each at most 5.

    a and alpha are the accelerations (m/s^2, rad/s^2), s_v and s_w the scales of speed and yaw rate: so the first two
    are the seconds that a usual change of the twist takes, and all are 0 for a base that does at once what it is told.
    Of `RobotFeatures` all numbers of SHEET.
    """
    if isinstance(features, RobotFeatures):
        return features.numbers
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
class Actions(Gains):
    """What the outputs of a network mean, each clipped to [-1, 1].

    "unicycle": v = speed ((1 + reverse) (a_0 + 1)/2 - reverse), w = yaw_rate a_1. "planar": the velocity speed (a_0,
    a_1), no faster than speed, in the frame of the features; no turning.
    """

    kind: Literal["unicycle", "planar"] = gain("unicycle", "", "what the outputs mean; planar is for holonomic robots")
    yaw_rate: float = gain(2.0, "rad/s", "of a full turn", above=0.0)
    reverse: float = gain(0.0, "1", "share of the speed that it may drive backwards", least=0.0, most=1.0)

    @property
    def size(self) -> int:
        """Returns how many outputs the network has."""
        return 2

    def of(self, features: Features) -> "Actions":
        """Returns the actions of the robot that features are for: of one of any, no sharper turns than it can."""
        return dataclasses.replace(self, yaw_rate=features.yaw_scale) if isinstance(features, RobotFeatures) else self

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

    def wished(self, wanted: Array, actions: NDArray[Any], reach: float, speeds: Array, angles: Array) -> Array:
        """Returns wanted velocities (b, 2), m/s, with what actions (b, 2) add to them, no faster than the speeds."""
        more = np.zeros((len(wanted), 3))
        turn(reach * actions.astype(np.float64), speeds, angles, more)
        out: Array = wanted + more[:, :2]
        sizes = np.sqrt(out[:, 0] * out[:, 0] + out[:, 1] * out[:, 1])
        return np.asarray(out * (speeds / np.maximum(sizes, speeds))[:, None])

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
        self.base_inputs = actions.size if based else 0
        limits = features.sheet_inputs if isinstance(features, SheetFeatures) else LIMITS
        self.limits = limits if features.limits else 0
        self.crumbed = features.crumbed
        self.moved = features.moved
        retained = self._remembered()
        before = features.previous * actions.size + 2 * len(self.trails) + self.crumbed + self.moved
        self.num_inputs = self.width * features.frames + before + self.limits + self.base_inputs
        for what, count, most in (
            ("sees", self.num_inputs, MOST_INPUTS),
            ("remembers", sum(math.prod(shape) for shape in retained.values()), MOST_REMEMBERED),
        ):
            if count > most:
                raise ValueError(f"{type(features).__name__} {what} {count} numbers of a robot; at most {most} may be")
        self.memory = np.dtype([(name, np.float32, shape) for name, shape in retained.items()])

    def _remembered(self) -> dict[str, tuple[int, ...]]:
        """Returns the shapes of what a robot remembers, by name."""
        features = self.features
        retained: dict[str, tuple[int, ...]] = {"actions": (features.previous, self.actions.size)}  # newest first
        if len(self.trails):
            retained |= {"begun": (), "trails": (len(self.trails), 2)}  # whether they have; x, y of each, m
        if features.crumbs:
            retained |= dict.fromkeys(Crumbs._fields[:-1], ()) | {"places": (features.crumbs, 2)}
        if isinstance(features, GoalFeatures) and features.moving:
            retained |= {"ages": (2,), "older": (features.num_beams, 2), "newer": (features.num_beams, 2)}
        return retained | {"seen": ((features.frames - 1) * features.stride, self.width)}  # newest first

    def fresh(self, num_envs: int) -> NDArray[np.void]:
        """Returns the memory (num_envs,) of robots that have seen and done nothing: zeros."""
        return np.zeros(num_envs, self.memory)

    def inputs(
        self,
        observation: Any,
        speeds: Array,
        memory: NDArray[np.void],
        requested: Array | None = None,
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
        if requested is not None:
            inputs[:, at:] = self.actions.of_twists(requested, speeds, angles)
        return inputs, angles

    def remember(self, inputs: Numbers, actions: NDArray[Any], memory: NDArray[np.void]) -> None:
        """Puts what was just seen and done at the head of the memory."""
        for name, newest in (("actions", actions), ("seen", inputs[:, : self.width])):
            if memory[name].size:
                memory[name][:, 1:] = memory[name][:, :-1].copy()
                memory[name][:, 0] = newest


class Slower(NamedTuple):
    """A slower base, as `limits` reads it."""

    num_wheels: int
    wheel_matrix: Numbers  # (n, 3) rad/s
    wheel_speed_limit: float  # rad/s
    turn_speed: float  # rad/s
    turning_radius: float  # m
    acceleration: float  # m/s^2
    yaw_acceleration: float  # rad/s^2


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
    slower = Slower(matrix.shape[0], matrix, limit, turn_limit, 0.0, acceleration, yaw_acceleration)
    last = twists.shape[1] - 1
    for i in range(twists.shape[0]):
        x = twists[i, 0]
        y = twists[i, 1] if last == 2 else 0.0
        w = twists[i, last]
        x, y, w, _ = limits(slower, (held[i, 0, 0], held[i, 0, 1], held[i, 0, 2]), (x, y, w), dt)
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
