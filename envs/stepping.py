"""What the compiled step of every task does alike."""

import collections
import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from wayfield.envs.compiled import inlined


class Outputs(NamedTuple):
    """The arrays that a step writes, for b robots."""

    observations: NDArray[np.float32]  # (b, n)
    numbers: NDArray[np.float64]  # (info values and the reward, b)
    flags: NDArray[np.bool_]  # (info flags and whether the episode ended, b)


def places(*names: str) -> Any:
    """Returns the index of each name, by name: what a kernel writes rows of numbers and flags by."""
    return collections.namedtuple("Places", names)(*range(len(names)))


@inlined
def first_not_finite(actions, skip):
    """Returns the first robot, of those not in `skip`, whose action is not finite; -1 if there is none."""
    for i in range(actions.shape[0]):
        for k in range(actions.shape[1]):
            if not skip[i] and not math.isfinite(actions[i, k]):
                return i
    return -1


@inlined
def drawn_scenario(draws, j, count):
    """Returns the index of one of `count` scenarios that the first uniform number of row j stands for."""
    return int(min(max(0.0, draws[j, 0] * count), count - 1.0))


@inlined
def write_motion(s, holonomic, i, out):
    """Writes the measured pose and twist, with which every observation begins; returns the next column.

    Columns are unsigned here and where the rest is written: a signed index is first asked whether it counts from the
    end.
    """
    out[i, 0] = s.measured_x
    out[i, 1] = s.measured_y
    out[i, 2] = s.measured_heading
    out[i, 3] = s.measured_vx
    k = 4
    if holonomic:
        out[i, np.uint64(k)] = s.measured_vy
        k += 1
    out[i, np.uint64(k)] = s.measured_yaw_rate
    return k + 1
