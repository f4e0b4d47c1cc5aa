"""What a network sees and what its outputs mean: numbers of order one, from named fields of observations, to twists.

Training and driving run the same code, so that an agent meets the numbers that it was trained on.
"""

import dataclasses
import math
from typing import Any, ClassVar, Literal

import numpy as np
from numpy.typing import NDArray

from wayfield.envs import goal_reaching, path_following
from wayfield.envs.compiled import compiled
from wayfield.envs.robots import Robot
from wayfield.policies.steering import unicycle_twists

Array = NDArray[np.float64]
Numbers = NDArray[np.float32]

LIMIT = 5.0  # beyond which a number tells a network nothing new


@dataclasses.dataclass(frozen=True)
class PathFeatures:
    """Of a path follower: its errors, its motion, the preview, the speed asked for, and what it did last.

    asinh(e / error_scale), the preview points about the body and the rest by plain division.
    """

    num_preview: int = 10
    error_scale: float = 0.02  # m, up to which the cross-track error is seen in proportion
    preview_scale: float = 0.5  # m
    speed_scale: float = 0.6  # m/s
    yaw_scale: float = 2.0  # rad/s
    previous: int = 2  # own actions seen
    frames: int = 1  # observations seen
    stride: int = 1  # control periods between them

    fields: ClassVar[tuple[str, ...]] = ("cross_track_error", "heading_error", "twist", "preview")
    observation: ClassVar[type] = path_following.Observation

    def width(self, num_twist: int) -> int:
        """Returns how many numbers one observation gives."""
        return 5 + num_twist + 2 * self.num_preview

    def observe(self, observation: path_following.Observation, speeds: Array, out: Numbers) -> Array:
        """Fills out (b, width) and returns the angle (b,) of the frame that the action is meant in: 0, the body's."""
        if observation.preview.shape[1] != self.num_preview:
            raise ValueError(f"preview has {observation.preview.shape[1]} points, the agent knows {self.num_preview}")
        scales = np.array([self.error_scale, self.preview_scale, self.speed_scale, self.yaw_scale])
        fill_path(
            observation.cross_track_error, observation.heading_error, observation.twist, observation.preview,
            speeds, scales, out,
        )  # fmt: skip
        return np.zeros(len(out))


@dataclasses.dataclass(frozen=True)
class GoalFeatures:
    """Of a goal seeker: where the goal is, its motion, the scan, the speed asked for, and what it did last.

    A range r is seen as its nearness, n = range_scale / (range_scale + max(r - hull_radius, 0)), the nearest of `pool`
    neighbouring beams. In the frame "goal" all is turned, scan and action too, by a whole number of beams so that the
    goal lies ahead: a holonomic robot has no front. The goal's heading is not looked at.
    """

    num_beams: int = 72
    hull_radius: float = 0.3  # m
    max_range: float = 5.0  # m
    range_scale: float = 0.5  # m
    distance_scale: float = 1.0  # m
    speed_scale: float = 0.6  # m/s
    yaw_scale: float = 2.0  # rad/s
    pool: int = 2  # beams
    frame: Literal["goal", "body"] = "goal"
    previous: int = 1  # own actions seen
    frames: int = 1  # observations seen
    stride: int = 1  # control periods between them

    fields: ClassVar[tuple[str, ...]] = ("twist", "goal", "ranges")
    observation: ClassVar[type] = goal_reaching.Observation

    def width(self, num_twist: int) -> int:
        """Returns how many numbers one observation gives."""
        return 5 + num_twist + self.num_beams // self.pool

    def observe(self, observation: goal_reaching.Observation, speeds: Array, out: Numbers) -> Array:
        """Fills out (b, width) and returns the angle (b,) of the frame that the action is meant in, rad."""
        if observation.ranges.shape[1] != self.num_beams:
            raise ValueError(f"ranges has {observation.ranges.shape[1]} beams, the agent knows {self.num_beams}")
        scales = np.array([self.hull_radius, self.range_scale, self.distance_scale, self.speed_scale, self.yaw_scale])
        angles = np.zeros(len(out))
        fill_goal(
            observation.goal, observation.twist, observation.ranges, speeds, scales,
            self.pool, self.frame == "goal", angles, out,
        )  # fmt: skip
        return angles


Features = PathFeatures | GoalFeatures


@dataclasses.dataclass(frozen=True)
class Actions:
    """What the outputs of a network mean, each clipped to [-1, 1].

    "unicycle": v = speed (a_0 + 1)/2, w = yaw_rate a_1. "planar": the velocity speed (a_0, a_1), no faster than speed,
    in the frame of the features; no turning.
    """

    kind: Literal["unicycle", "planar"] = "unicycle"
    yaw_rate: float = 2.0  # rad/s

    @property
    def size(self) -> int:
        """Returns how many outputs the network has."""
        return 2

    def twists(self, actions: NDArray[Any], speeds: Array, angles: Array, robot: Robot) -> Array:
        """Returns the twists (b, t) of actions (b, 2) in [-1, 1], m/s and rad/s."""
        a = actions.astype(np.float64)
        if self.kind == "unicycle":
            return unicycle_twists(robot, speeds * 0.5 * (a[:, 0] + 1.0), self.yaw_rate * a[:, 1])
        speeds = speeds / np.maximum(np.sqrt(a[:, 0] * a[:, 0] + a[:, 1] * a[:, 1]), 1.0)
        out = np.zeros((len(a), 3))
        turn(a, speeds, angles, out)
        return out


class Perception:
    """From observations to the inputs of a network, with a memory of one row a robot.

    A row holds the last actions, newest first, then the numbers of earlier observations, newest first.
    """

    def __init__(self, features: Features, actions: Actions, num_twist: int) -> None:
        self.features = features
        self.actions = actions
        self.width = features.width(num_twist)
        self.acted = features.previous * actions.size
        self.kept = (features.frames - 1) * features.stride
        self.num_inputs = self.width * features.frames + self.acted

    def fresh(self, num_envs: int) -> Numbers:
        """Returns the memory (num_envs, ...) of robots that have seen and done nothing."""
        return np.zeros((num_envs, self.acted + self.kept * self.width), np.float32)

    def inputs(self, observation: Any, speeds: Array, memory: Numbers) -> tuple[Numbers, Array]:
        """Returns the inputs (b, num_inputs) of the network and the angle (b,) of the frame of its action, rad."""
        inputs = np.empty((len(memory), self.num_inputs), np.float32)
        angles = self.features.observe(observation, speeds, inputs[:, : self.width])
        first = self.width + self.acted
        inputs[:, self.width : first] = memory[:, : self.acted]
        for k in range(1, self.features.frames):
            at = self.acted + (k * self.features.stride - 1) * self.width
            inputs[:, first : first + self.width] = memory[:, at : at + self.width]
            first += self.width
        return inputs, angles

    def remember(self, inputs: Numbers, actions: NDArray[Any], memory: Numbers) -> None:
        """Puts what was just seen and done at the head of the memory."""
        size = self.actions.size
        if self.acted:
            memory[:, size : self.acted] = memory[:, : self.acted - size].copy()
            memory[:, :size] = actions
        if self.kept:
            memory[:, self.acted + self.width :] = memory[:, self.acted : -self.width].copy()
            memory[:, self.acted : self.acted + self.width] = inputs[:, : self.width]


@compiled
def fill_path(errors, heading_errors, twists, previews, speeds, scales, out):
    """Fills the rows of `PathFeatures.observe`."""
    for i in range(out.shape[0]):
        out[i, 0] = math.asinh(errors[i] / scales[0])
        out[i, 1] = min(max(errors[i] / (10.0 * scales[0]), -LIMIT), LIMIT)
        out[i, 2] = math.sin(heading_errors[i])
        out[i, 3] = math.cos(heading_errors[i])
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


@compiled
def fill_goal(goals, twists, ranges, speeds, scales, pool, ahead, angles, out):
    """Fills the rows of `GoalFeatures.observe`, and the angles of their frames."""
    beams = ranges.shape[1]
    step = 2.0 * math.pi / beams
    for i in range(out.shape[0]):
        bearing = math.atan2(goals[i, 1], goals[i, 0])
        distance = math.sqrt(goals[i, 0] * goals[i, 0] + goals[i, 1] * goals[i, 1])
        shift = 0
        if ahead:
            shift = int(math.floor(bearing / step + 0.5))
            angles[i] = shift * step
        out[i, 0] = math.asinh(distance / scales[2])
        out[i, 1] = distance / (distance + 0.2)
        out[i, 2] = math.sin(bearing - angles[i])
        out[i, 3] = math.cos(bearing - angles[i])
        out[i, 4] = speeds[i] / scales[3]
        k = 5
        last = twists.shape[1] - 1
        vx = twists[i, 0]
        if last == 2:
            cosine = math.cos(angles[i])
            sine = math.sin(angles[i])
            vx = cosine * twists[i, 0] + sine * twists[i, 1]
            vy = cosine * twists[i, 1] - sine * twists[i, 0]
            out[i, k + 1] = min(max(vy / scales[3], -LIMIT), LIMIT)
        out[i, k] = min(max(vx / scales[3], -LIMIT), LIMIT)
        out[i, k + last] = min(max(twists[i, last] / scales[4], -LIMIT), LIMIT)
        k += last + 1
        for j in range(beams // pool):
            nearest = np.inf
            for m in range(pool):
                nearest = min(nearest, ranges[i, (j * pool + m + shift) % beams])
            out[i, k] = scales[1] / (scales[1] + max(nearest - scales[0], 0.0))
            k += 1


@compiled
def turn(actions, speeds, angles, out):
    """Fills the planar velocities (b, 3) of actions meant in turned frames."""
    for i in range(out.shape[0]):
        cosine = math.cos(angles[i])
        sine = math.sin(angles[i])
        out[i, 0] = speeds[i] * (cosine * actions[i, 0] - sine * actions[i, 1])
        out[i, 1] = speeds[i] * (sine * actions[i, 0] + cosine * actions[i, 1])
