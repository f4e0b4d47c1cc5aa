"""What the network of a robot that follows in time sees."""

import dataclasses
from typing import Any, ClassVar

import numpy as np

from wayfield.envs import trajectory_tracking
from wayfield.policies.learned.features import LIMIT, Array, Numbers
from wayfield.policies.learned.features_path import PathFeatures
from wayfield.policies.parts.gain import gain
from wayfield.system.compiled import any_layout, compiled
from wayfield.system.elementary import area_sine


@dataclasses.dataclass(frozen=True)
class ReferenceFeatures(PathFeatures):
    """Of a robot that follows in time: its error, its motion and last command, and the reference now and ahead.

    Errors are seen twice, as asinh(e / error_scale) and by plain division by 10 error_scale; twists and what lies ahead
    by plain division.
    """

    num_preview: int = gain(4, "1", "samples of the reference ahead that are seen", most=100)
    error_scale: float = gain(0.005, "m", "up to which the error is seen in proportion", above=0.0)

    fields: ClassVar[tuple[str, ...]] = ("error", "twist", "reference_twist", "command", "preview")
    observation: ClassVar[type] = trajectory_tracking.Observation

    def width(self, num_twist: int) -> int:
        """Returns how many numbers one observation gives."""
        return 6 + 3 * num_twist + (3 + num_twist) * self.num_preview

    def observe(self, observation: Any, speeds: Array, out: Numbers) -> Array:
        """Fills out (b, width) and returns the angle (b,) of the frame that the action is meant in: 0, the body's."""
        preview = observation.preview[:, : self.num_preview]
        if preview.shape[1] < self.num_preview:
            raise ValueError(f"preview has {preview.shape[1]} samples, the agent sees num_preview={self.num_preview}")
        scales = np.array([self.error_scale, self.turn_scale, self.preview_scale, self.speed_scale, self.yaw_scale])
        fill_reference(
            observation.error, observation.twist, observation.reference_twist, observation.command, preview, scales, out
        )
        return np.zeros(len(out))


@any_layout
@compiled
def fill_reference(errors, twists, references, commands, previews, scales, out):
    """Fills the rows of `ReferenceFeatures.observe`; scales: as it makes them."""
    error_scale, turn_scale, preview_scale, speed_scale, yaw_scale = scales
    last = twists.shape[1] - 1
    for i in range(out.shape[0]):
        k = 0
        for c in range(3):
            scale = turn_scale if c == 2 else error_scale
            out[i, k] = area_sine(errors[i, c] / scale)
            out[i, k + 1] = min(max(errors[i, c] / (10.0 * scale), -LIMIT), LIMIT)
            k += 2
        for c in range(last + 1):
            scale = yaw_scale if c == last else speed_scale
            out[i, k] = min(max(twists[i, c] / scale, -LIMIT), LIMIT)
            out[i, k + 1] = min(max((references[i, c] - twists[i, c]) / scale, -LIMIT), LIMIT)
            out[i, k + 2] = min(max((commands[i, c] - twists[i, c]) / scale, -LIMIT), LIMIT)
            k += 3
        for j in range(previews.shape[1]):
            for c in range(4 + last):
                scale = preview_scale
                if c == 2:
                    scale = 1.0
                elif c > 2:
                    scale = yaw_scale if c == 3 + last else speed_scale
                out[i, k] = min(max(previews[i, j, c] / scale, -LIMIT), LIMIT)
                k += 1
