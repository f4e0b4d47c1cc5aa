"""Results of environments, compared bit for bit."""

from typing import Any

import numpy as np


def differences(a: Any, b: Any, place: str = "") -> list[str]:
    """Returns where two nested results differ, in type, shape, dtype or any bit."""
    if isinstance(a, dict):
        if not isinstance(b, dict) or a.keys() != b.keys():
            return [f"{place}: {sorted(a)} and {b!r}"]
        return [each for key in a for each in differences(a[key], b[key], f"{place}[{key!r}]")]
    if isinstance(a, tuple | list) or (isinstance(a, np.ndarray) and a.dtype == object):
        if type(a) is not type(b) or len(a) != len(b):
            return [f"{place}: {a!r} and {b!r}"]
        return [each for i in range(len(a)) for each in differences(a[i], b[i], f"{place}[{i}]")]
    one, other = np.asarray(a), np.asarray(b)
    alike = type(a) is type(b) and (one.dtype, one.shape) == (other.dtype, other.shape)
    return [] if alike and one.tobytes() == other.tobytes() else [f"{place}: {a!r} and {b!r}"]
