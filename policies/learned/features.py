"""What the features of all tasks share: limits of what a network may see, and the check of trailing points."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from wayfield.system.checks import shown
from wayfield.system.reading import is_number

Array = NDArray[np.float64]
Numbers = NDArray[np.float32]
Tolerances = tuple[Array | None, Array | None]  # (b,) m and rad, within which goals are reached; None: not told

LIMIT = 5.0  # beyond which a number tells a network nothing new
MOST_SEEN = 1000  # of frames, points, actions, crumbs and trails: they size memory


def check_trails(features: Any) -> None:
    """Raises ValueError unless the trails are times above 0, at most MOST_SEEN."""
    trails = features.trails
    if not isinstance(trails, tuple) or not all(is_number(each) and each > 0.0 for each in trails):
        raise ValueError(f"{type(features).__name__}: trails must be times > 0 s, got {shown(trails)}")
    if len(trails) > MOST_SEEN:
        raise ValueError(f"{type(features).__name__}: trails must be at most {MOST_SEEN}, got {len(trails)}")


def unchanged(self: Any, observation: Any, twists: Array, *_: Any, **__: Any) -> Array:
    """Returns the twists (b, t) as they are: `arrived` or `guarded` of a network that no law stands behind."""
    return twists
