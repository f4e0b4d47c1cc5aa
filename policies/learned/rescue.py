"""The laws that drive where an agent makes no way; they see no more than the agent.

`reeds_shepp_scan` docks, and does so too where the scans show that something moves. On a path a robot turns to the
preview and drives on for a little: there are corners before which a network stands for ever.
"""

import functools
from typing import Any

import numpy as np
from numpy.typing import NDArray

from wayfield.envs import goal_reaching, path_following
from wayfield.envs.tasks.briefing import Briefing
from wayfield.policies.learned.residual import controller_at
from wayfield.policies.parts.policy import Policy
from wayfield.policies.parts.steering import unicycle_twists

SPEED = 0.4  # m/s, of the law at most
WAY = 0.1  # m, by which what is left becomes less
TURN = 0.3  # m/rad, that a turn to the heading counts for, as in the reward
DENSE = 0.09  # rad, between beams, below which the law sees in time what moves
STILL = 0.01  # m/s and rad/s, asked for by an agent that stands
STRETCH = 0.3  # m, of a path that the law drives
CREEP = 0.2  # m/s, on it at most
TURN_GAIN = 2.0  # 1/s, of the turn to the preview
AHEAD = 0.15  # m, from the robot, beyond which a point of the preview is driven to
NEXT_GOAL = 0.5  # m, by which what is left grows in a control period only where the goal is another


@functools.lru_cache(maxsize=64)
def law_at(speed: float) -> Policy:
    """Returns the law of an agent that is asked for a speed (m/s)."""
    return controller_at("reeds_shepp_scan", {}, min(speed, SPEED))


def waiting(briefing: Briefing, speed: float) -> NDArray[Any]:
    """Returns the memory (b,) of the law at a speed (m/s), and of how far the agent has come."""
    law = law_at(speed).reset(briefing)
    numbers = [(name, np.float64) for name in ("left", "least", "stood", "moving")]  # m, m, s, and 0 or 1
    memory = np.zeros(briefing.num_envs, [("law", law.dtype), *numbers])
    memory["law"], memory["left"], memory["least"] = law, np.inf, np.inf
    return memory


def take_over(
    observation: goal_reaching.Observation,
    briefing: Briefing,
    memory: NDArray[Any],
    twist_requested: tuple[float, float],
    twists: NDArray[np.float64],
) -> NDArray[np.int64]:
    """Puts the law's twists in place of those (b, t) of robots that have made no way for some time, or past whom
    something moves, from then on.

    Way is made when distance and turn that are left become less than ever before.

    Args:
        asked: the speed (m/s) that the agent is asked for, and that time, s.

    Returns:
        The rows of those robots.
    """
    speed, patience = twist_requested
    left = np.hypot(*observation.goal.T) + TURN * np.abs(observation.goal_heading_error)
    anew = left > memory["left"] + NEXT_GOAL
    memory["left"] = left
    made = anew | ((left < memory["least"] - WAY) & (memory["stood"] <= patience))
    memory["least"] = np.where(made, left, memory["least"])
    stood = np.where(made, 0.0, memory["stood"] + briefing.dt)
    alone = memory["moving"] == 0.0
    begins = (stood > patience) & (memory["stood"] <= patience) & alone
    memory["stood"] = stood
    memory["law"][begins] = waiting(briefing, speed)["law"][begins]  # what it planned while another drove is no plan
    dense = len(briefing.beam_angles) > 1 and np.diff(briefing.beam_angles[:2])[0] < DENSE
    watching = np.arange(len(stood)) if dense else np.flatnonzero(stood > patience)
    law = memory["law"][watching]
    driven = law_at(speed).act(type(observation)(*(each[watching] for each in observation)), briefing, law)
    if dense:
        tracks = law["state"]["tracks"]
        sees = ((tracks["moves"] > 0.0) & (tracks["radius"] > 0.0)).any(axis=1)
        law["state"]["radius"][sees & alone & (stood <= patience)] = 0.0
        memory["moving"][sees] = 1.0
    memory["law"][watching] = law
    takes = (stood[watching] > patience) | (memory["moving"][watching] > 0.0)
    rows = watching[takes]
    twists[rows] = driven[takes]
    return rows


def drive_on(
    observation: path_following.Observation,
    briefing: Briefing,
    memory: NDArray[np.float64],
    twist_requested: tuple[float, float],
    twists: NDArray[np.float64],
) -> NDArray[np.int64]:
    """Puts twists towards the preview in place of those (b, t) of robots that stand before the end of a path.

    Args:
        memory: (b, 2) time that it stands (s), arc length up to which the law drives (m).
        asked: the speed (m/s) that the agent is asked for, and the time (s) after which the law takes over.

    Returns:
        The rows of those robots.
    """
    along = observation.arc_length
    memory[:, 0] = np.where((np.abs(twists) > STILL).any(axis=1), 0.0, memory[:, 0] + briefing.dt)
    memory[:, 1] = np.where(memory[:, 0] > twist_requested[1], along + STRETCH, memory[:, 1])
    rows = np.flatnonzero(along < memory[:, 1])
    ahead = observation.preview[rows]
    if len(rows) and ahead.shape[1]:
        far = np.hypot(ahead[..., 0], ahead[..., 1]) > AHEAD
        point = ahead[np.arange(len(rows)), np.where(far.any(axis=1), far.argmax(axis=1), -1)]
        turn = np.arctan2(point[:, 1], point[:, 0])
        speed = min(CREEP, twist_requested[0]) * np.maximum(np.cos(turn), 0.0) ** 4
        twists[rows] = unicycle_twists(briefing.robot, speed, np.clip(TURN_GAIN * turn, -1.0, 1.0))
    return rows
