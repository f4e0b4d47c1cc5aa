"""A path driven in thought before the start: laws that lose some paths say so in a line, whatever the shape is."""

import contextlib
import dataclasses
import warnings
import weakref
from collections.abc import Iterator
from contextvars import ContextVar
from typing import Any

import numpy as np
from numpy.typing import NDArray

from wayfield.envs.path_following import Observation, project
from wayfield.envs.robots.kinematics import limits
from wayfield.envs.tasks.briefing import Briefing
from wayfield.policies.parts.carrot import place_on_lap
from wayfield.policies.parts.params import params
from wayfield.policies.parts.shooting import lagged_period
from wayfield.system.compiled import any_layout, compiled

WINDOW = 1.0  # m, ahead of the last projection, that the next one is searched in
CORRIDOR = 1.0  # m, from the path, beyond which it is lost
PATIENCE = 10.0  # s in which it comes no STEP farther, after which it is lost
STEP = 0.02  # m
MOST = 20_000  # control periods that are driven at most: what has gone well so far is taken to end well
NEAR = 0.05  # m, before its end where a path counts as driven

_rehearsed: set[tuple[Any, ...]] = set()  # path, law, robot and actuators
_rehearses = ContextVar("rehearses", default=True)


class PathLost(UserWarning):
    """A law does not get to the end of a path."""


@contextlib.contextmanager
def unrehearsed() -> Iterator[None]:
    """Lets laws begin at once, where a table shows who was lost: half of a cheap law's time is its rehearsal."""
    token = _rehearses.set(False)
    try:
        yield
    finally:
        _rehearses.reset(token)


def rehearse(law: Any, briefing: Briefing) -> None:
    """Warns, once a path, of the first path that a law without memory does not get to the end of.

    The base is the nominal one of the data sheet, which starts on the path, along it.

    Args:
        law: whose `act` reads the pose, the twist and the arc length.
    """
    course = briefing.path
    if course is None or not _rehearses.get():
        return
    if (key := (id(course.vertices), law, briefing.robot.name, briefing.actuators)) in _rehearsed:
        return
    _rehearsed.add(key)
    weakref.finalize(course.vertices, _rehearsed.discard, key)
    driven = course._replace(path_index=np.unique(course.path_index))
    lost, reached = _drive(law, dataclasses.replace(briefing, num_envs=len(driven.path_index), path=driven))
    if not lost.any():
        return
    k = int(lost.argmax())
    run = driven.runs[driven.path_index[k]]
    first = driven.vertices[run["first"]]
    others = f", nor of {lost.sum() - 1} others" if lost.sum() > 1 else ""
    instead = "lqr, stanley or regulated_pure_pursuit" if briefing.robot.turns_on_the_spot else "lqr"
    warnings.warn(
        f"{type(law).__name__} is likely not to get to the end of the path of {run['length']:.4g} m from "
        f"({first['x']:.4g}, {first['y']:.4g}){others}: it is lost at {reached[k]:.3g} m; "
        f"choose {instead}",
        PathLost,
        stacklevel=4,
    )


def _drive(law: Any, briefing: Briefing) -> tuple[NDArray[np.bool_], NDArray[np.float64]]:
    """Returns which robots were lost and how far along its path each got (m)."""
    assert briefing.path is not None
    course, n = briefing.path, briefing.num_envs
    runs = course.runs[course.path_index]
    starts = course.vertices[runs["first"]]
    poses = np.column_stack([starts["x"], starts["y"], starts["heading"]])
    commands, twists = np.zeros((2, n, 2))
    reached, off, late, mark = np.zeros((4, n))
    seen = np.zeros((n, len(briefing.robot.twist_axes)))
    base, memory = params(law, briefing), np.empty((n, 0))
    lost, going = np.zeros(n, bool), np.ones(n, bool)
    for _ in range(MOST):
        seen[:, [0, -1]] = twists
        observation = Observation(poses, seen, off, off, reached, np.empty((n, 0, 2)))
        requests = law.act(observation, briefing, memory)[:, [0, -1]]
        drive_on_paths(base, course, requests, commands, twists, poses, reached, off)
        on = reached > mark + STEP
        mark, late = np.where(on, reached, mark), np.where(on, 0.0, late + briefing.dt)
        lost |= going & ((abs(off) > CORRIDOR) | (late > PATIENCE))
        going &= ~lost & (reached < runs["length"] - NEAR)
        if not going.any():
            break
    return lost, reached


@any_layout
@compiled
def drive_on_paths(base, course, requests, commands, twists, poses, reached, off):
    """Moves robots on by a control period: commands and twists (b, 2), poses (b, 3), places and errors (b,) m."""
    p = base[0]
    vertices, runs, path_index = course
    for i in range(path_index.shape[0]):
        run = runs[path_index[i]]
        last = commands[i, 0], 0.0, commands[i, 1]
        v, _, w, _ = limits(p.plant, last, (requests[i, 0], 0.0, requests[i, 1]), p.plant.dt)
        commands[i, 0] = v
        commands[i, 1] = w
        pose = poses[i, 0], poses[i, 1], poses[i, 2]
        (x, y, heading), (v, w), _ = lagged_period(p, pose, (twists[i, 0], twists[i, 1]), (v, w))
        twists[i, 0] = v
        twists[i, 1] = w
        poses[i, 0] = x
        poses[i, 1] = y
        poses[i, 2] = heading
        along, segment = place_on_lap(vertices, run, reached[i])
        laps = reached[i] - along
        s, _, off[i], _ = project(vertices, run, WINDOW, x, y, heading, along, segment)
        reached[i] = laps + s
