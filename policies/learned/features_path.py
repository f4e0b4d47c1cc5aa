"""What a path follower's network sees."""

import dataclasses
from typing import ClassVar

import numpy as np

from wayfield.envs import path_following
from wayfield.envs.tasks.briefing import Briefing
from wayfield.policies.learned.features import LIMIT, MOST_SEEN, Array, Numbers, check_trails, unchanged
from wayfield.policies.parts.gain import Gains, gain
from wayfield.system.compiled import any_layout, compiled
from wayfield.system.elementary import area_sine, bearing, sin_cos, wrap_angle

NEAR = 0.01  # m, under which two points of a path give no direction


@dataclasses.dataclass(frozen=True)
class PathFeatures(Gains):
    """Of a path follower: its errors, its motion, the preview, the speed asked for, and what it did last.

    asinh(e / error_scale), asinh(turn / turn_scale), the rest by plain division. The preview is seen twice: as points
    about the body, and as the turns of the path between them, which are what a steering law asks for. With `limits` it
    sees what its base can do, too: see `limits_of`.
    """

    num_preview: int = gain(10, "1", "points of the path ahead that are seen", most=MOST_SEEN)
    error_scale: float = gain(0.02, "m", "up to which the error is seen in proportion", above=0.0)
    preview_scale: float = gain(0.5, "m", "of the points ahead", above=0.0)
    turn_scale: float = gain(0.1, "rad", "up to which turns are seen in proportion", above=0.0)
    speed_scale: float = gain(0.6, "m/s", "up to which it is seen in proportion", above=0.0)
    yaw_scale: float = gain(2.0, "rad/s", "up to which it is seen in proportion", above=0.0)
    previous: int = gain(2, "1", "own actions seen", most=MOST_SEEN)
    trails: tuple[float, ...] = gain((), "s", "of points that trail behind", words="a,b,... > 0")
    frames: int = gain(1, "1", "observations seen", least=1, most=MOST_SEEN)
    stride: int = gain(1, "1", "control periods between them", least=1, most=MOST_SEEN)
    limits: bool = gain(False, "", "whether the base's accelerations and lag are seen")

    crumbs: ClassVar[int] = 0
    crumbed: ClassVar[int] = 0  # numbers that crumbs give
    moved: ClassVar[int] = 0  # numbers that what moves gives
    posed: ClassVar[int] = 0  # numbers that a pose to rest at gives
    shielded: ClassVar[bool] = False

    def __post_init__(self) -> None:
        super().__post_init__()
        check_trails(self)

    fields: ClassVar[tuple[str, ...]] = ("cross_track_error", "heading_error", "twist", "preview")
    observation: ClassVar[type] = path_following.Observation

    def check(self, briefing: Briefing) -> None:
        """Refuses no robot: `observe` takes the first points of the preview, and refuses one that is too short."""

    def width(self, num_twist: int) -> int:
        """Returns how many numbers one observation gives."""
        return 5 + num_twist + 3 * self.num_preview

    def observe(self, observation: path_following.Observation, speeds: Array, out: Numbers) -> Array:
        """Fills out (b, width) and returns the angle (b,) of the frame that the action is meant in: 0, the body's."""
        preview = observation.preview[:, : self.num_preview]
        if preview.shape[1] < self.num_preview:
            raise ValueError(f"preview has {preview.shape[1]} points, the agent sees num_preview={self.num_preview}")
        scales = np.array([self.error_scale, self.preview_scale, self.speed_scale, self.yaw_scale, self.turn_scale])
        fill_path(
            observation.cross_track_error, observation.heading_error, observation.twist, preview, speeds, scales, out,
        )  # fmt: skip
        return np.zeros(len(out))

    arrived = unchanged  # a path ends where it ends
    guarded = unchanged  # and nothing stands beside it


@any_layout
@compiled
def fill_path(errors, heading_errors, twists, previews, speeds, scales, out):
    """Fills the rows of `PathFeatures.observe`; scales: as it makes them."""
    error_scale, preview_scale, speed_scale, yaw_scale, turn_scale = scales
    for i in range(out.shape[0]):
        out[i, 0] = area_sine(errors[i] / error_scale)
        out[i, 1] = min(max(errors[i] / (10.0 * error_scale), -LIMIT), LIMIT)
        out[i, 2], out[i, 3] = sin_cos(heading_errors[i])
        out[i, 4] = speeds[i] / speed_scale
        k = 5
        last = twists.shape[1] - 1
        for j in range(last + 1):
            out[i, k] = min(max(twists[i, j] / (yaw_scale if j == last else speed_scale), -LIMIT), LIMIT)
            k += 1
        for j in range(previews.shape[1]):
            for side in range(2):
                out[i, k] = min(max(previews[i, j, side] / preview_scale, -LIMIT), LIMIT)
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
            out[i, k] = area_sine(turn / turn_scale)
            k += 1
            x = previews[i, j, 0]
            y = previews[i, j, 1]
