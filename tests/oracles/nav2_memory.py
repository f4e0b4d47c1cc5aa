"""What Nav2's laws read and remember, and its parts by themselves."""

from typing import Any

import numpy as np
from numpy.typing import NDArray
from oracles.local_planning import briefing_of

from wayfield.policies import nav2_dwb
from wayfield.policies.parts import costmap
from wayfield.system.compiled import compiled

flips = compiled(lambda p, m, pose: nav2_dwb.note_flips(p[0], m[0], pose))
recovers = compiled(lambda p, m, pose, goal: costmap.recovers(p[0], m[0], pose, goal))


def gains(controller: Any, acceleration: float = 1e6, yaw_acceleration: float = 1e6, **more: Any) -> NDArray[Any]:
    """Returns what the law of a P3DX with some limits of acceleration reads, with none unless they are given."""
    read = np.array(controller(**more).given(briefing_of("p3dx")))
    read["acceleration"], read["yaw_acceleration"] = acceleration, yaw_acceleration
    return read


def memory(controller: Any, cell: float = 0.08) -> Any:
    """Returns the memory (1,) of a robot whose map is free, around the origin."""
    state = controller().reset(briefing_of("p3dx"))["state"]
    state["cell"] = cell
    state["origin"] = -80.0 * cell
    return state
