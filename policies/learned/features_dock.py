"""What the network of a robot sees that comes to rest at a pose: a goal seeker's, and that pose finely."""

import dataclasses
from typing import ClassVar, Literal

import numpy as np

from wayfield.envs.goal_reaching import Observation
from wayfield.envs.robots import Actuators
from wayfield.policies.learned.features import Array, Numbers, Tolerances
from wayfield.policies.learned.features_goal import GoalFeatures
from wayfield.policies.parts.gain import gain
from wayfield.policies.parts.stopping import rest_radius
from wayfield.system.compiled import any_layout, compiled
from wayfield.system.elementary import area_sine, sin_cos

POSE = 5  # numbers of `fill_pose`


@dataclasses.dataclass(frozen=True)
class DockFeatures(GoalFeatures):
    """Of a robot that comes to rest at a pose: what a goal seeker sees, and that pose once more, finely.

    Besides the numbers of `GoalFeatures`, its place as asinh(x / fine) and asinh(y / fine) in the body frame, and the
    turn e to its heading as sin e, cos e and asinh(e / fine_turn). It is guarded as a goal seeker, forward and
    backward; and where the robot is within `rest` and `rest_turn` of the pose, or less where the goal asks for that, it
    is told to stand still, in training too: to hold still is no network's strength, and what explores never does.
    """

    trails: tuple[float, ...] = gain((), "s", "of points that trail behind", words="a,b,... > 0")
    frame: Literal["goal", "body"] = gain("body", "", "in which the scan and the action are meant")
    limits: bool = gain(True, "", "whether the base's accelerations and lag are seen")
    fine: float = gain(0.05, "m", "up to which the place of a dock is seen in proportion", above=0.0)
    fine_turn: float = gain(0.05, "rad", "up to which the turn to its heading is", above=0.0)
    rest: float = gain(0.02, "m", "of a dock, within which the robot is told to stand", above=0.0)
    rest_turn: float = gain(0.02, "rad", "of its heading, within which it is", above=0.0)

    posed: ClassVar[int] = POSE
    shielded: ClassVar[bool] = False  # a dock is nearer than a shield lets a robot come

    fields: ClassVar[tuple[str, ...]] = ("pose", "twist", "goal", "goal_heading_error", "ranges")

    def width(self, num_twist: int) -> int:
        """Returns how many numbers one observation gives."""
        return super().width(num_twist) + POSE

    def observe(self, observation: Observation, speeds: Array, out: Numbers) -> Array:
        """Fills out (b, width) and returns the angle (b,) of the frame that the action is meant in, rad."""
        angles = super().observe(observation, speeds, out[:, :-POSE])
        scales = np.array([self.fine, self.fine_turn])
        fill_pose(observation.goal, observation.goal_heading_error, angles, scales, out[:, -POSE:])
        return angles

    def arrived(
        self, observation: Observation, twists: Array, speed: float, actuators: Actuators,
        tolerances: Tolerances = (None, None),
    ) -> Array:  # fmt: skip
        """Returns the twists, none where the robot is to rest."""
        rest, rest_turn = (rest_radius(*each) for each in zip((self.rest, self.rest_turn), tolerances, strict=True))
        x, y = observation.goal[:, 0], observation.goal[:, 1]
        there = (x * x + y * y < rest * rest) & (observation.waypoints_left < 0.5)
        twists[there & (np.abs(observation.goal_heading_error) < rest_turn)] = 0.0
        return twists


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
