"""The compiled step and reset of every task, but for what is its own: how it begins, and how it judges."""

import collections
import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from wayfield.envs.robots import kinematic_plant, records
from wayfield.envs.robots.hulls import hull_clearance
from wayfield.envs.world.grids import Grids
from wayfield.envs.world.movers import go_on
from wayfield.system.compiled import inlined
from wayfield.system.sharing import BEGUN, PART, add, next_rows

# The phases of a step. The kinematic plant runs all three in one compiled call; another plant drives in between.
COMMAND = 1  # action to the twist commanded to the wheels
DRIVE = 2  # motion
JUDGE = 4  # observation, reward, end


class Robots(NamedTuple):
    """The arrays of b robots that a step and a reset are handed, whatever the task."""

    params: NDArray[np.void]  # (1,)
    states: NDArray[np.void]  # (b,)
    obstacles: NDArray[np.void] | None  # (b, m) OBSTACLE records; None for a task that has none
    noise: NDArray[np.float64]  # (b, rows, columns)
    grids: Grids


class Step(NamedTuple):
    """What a step is handed of b robots."""

    params: NDArray[np.void]  # (1,)
    states: NDArray[np.void]  # (b,)
    obstacles: NDArray[np.void]  # (b, m)
    actions: NDArray[np.float64]  # (b, columns)
    noise: NDArray[np.float64]
    skip: NDArray[np.bool_]  # (b,) whose episode is over


class Reset(NamedTuple):
    """What a reset is handed of b robots."""

    params: NDArray[np.void]
    states: NDArray[np.void]
    obstacles: NDArray[np.void]
    rows: NDArray[np.int64]  # those that begin, ascending
    draws: NDArray[np.float64]  # uniform numbers, (len(rows), 1 + the task's draws) or 2 more
    noise: NDArray[np.float64]


class Turn(NamedTuple):
    """Whose turn it is, where threads share out the robots."""

    thread: int  # 0: the one that begins
    shares: NDArray[np.int64]  # see `sharing`; empty: it is alone


class Outputs(NamedTuple):
    """The arrays that a step writes, for b robots."""

    out: NDArray[np.float32]  # (b, n) observations
    numbers: NDArray[np.float64]  # (info values and the reward, b)
    flags: NDArray[np.bool_]  # (info flags and whether the episode ended, b)


def numbered(*names: str) -> Any:
    """Returns the index of each name, by name: what a kernel writes rows of numbers and flags by."""
    return collections.namedtuple("Places", names)(*range(len(names)))


@inlined
def first_not_finite(actions, skip):
    """Returns the first robot, of those not in `skip`, whose action is not finite; -1 if there is none."""
    finite = True
    for i in range(actions.shape[0]):
        for k in range(actions.shape[1]):
            finite &= math.isfinite(actions[i, k])
    if finite:
        return -1
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


@inlined
def nothing_more(p, world, robots, skip, first, last, outputs):
    """No-op, for tasks that judge each robot separately."""


@inlined
def begun(phases, turn, actions, skip):
    """Notes that a step has begun; returns the first robot whose action is not finite, -1 if there is none.

    Where other threads take rows too, the first checks that actions are finite.
    """
    thread, shares = turn
    if shares.shape[0] > 0:
        if thread == 0:
            add(shares, BEGUN, 1)
    elif phases & COMMAND:
        return first_not_finite(actions, skip)
    return -1


@inlined
def let_obstacles_move(phases, p, s, robots, i):
    """Moves the obstacles around robot i, which stops where one hits it; in a plant with forces it is pushed."""
    go_on(robots.obstacles, i, s.num_obstacles, (s.steps + 1) * p.dt)
    s.clearance = hull_clearance(p, robots, i, s, s.x, s.y, s.heading)
    if phases & DRIVE and s.clearance < 0.0:
        s.contact = 1
        records.stop(s)


@inlined
def move(phases, p, s, robots, actions, i, row):
    """Runs the phases COMMAND and DRIVE of robot i, whose noise is in `row`; robots: Robots."""
    if phases & COMMAND:
        s.contact = 0
        kinematic_plant.command(p, s, actions, i)
        if p.moving:
            let_obstacles_move(phases, p, s, robots, i)
        if not s.contact:
            kinematic_plant.shove(p, s, robots, i)
    if phases & DRIVE and not s.contact:
        kinematic_plant.drive(p, s, robots, actions, i, row)


@inlined
def step_robots(judge, conclude, phases, turn, robots, actions, skip, world, outputs):
    """Runs the given phases of a step for all robots but those in `skip`, as the task's `step_rows`.

    Returns the first robot whose action is not finite, before anything has moved; -1 if there is none.

    Args:
        judge: the task's compiled judge(p, s, world, robots, i, row, outputs): measures robot i, whose noise is in
            `row`, against its goal, and writes its observation, numbers and flags.
        conclude: its conclude(p, world, robots, skip, first, last, outputs): what is done for several robots at once,
            behind the judging of each.
        turn: Turn.
        robots: Robots.
        world: what the task's own functions read of its bank.
        outputs: Outputs.
    """
    bad = begun(phases, turn, actions, skip)
    if bad >= 0:
        return bad
    thread, shares = turn
    params, states, _, noise, _ = robots
    p = params[0]
    first, last = next_rows(shares, thread, 0, states.shape[0])
    while first < last:
        for i in range(first, last):
            if skip[i]:
                continue
            s = states[i]
            row = s.noise_row if noise.shape[1] > 1 else 0
            move(phases, p, s, robots, actions, i, row)
            if phases & JUDGE:
                s.steps += 1
                judge(p, s, world, robots, i, row, outputs)
                s.noise_row += 1
        if phases & JUDGE:
            conclude(p, world, robots, skip, first, last, outputs)
        first, last = next_rows(shares, thread, last, states.shape[0])
    return -1


@inlined
def reset_robots(place, begin, robots, rows, draws, world, outputs):
    """Starts an episode for each robot in `rows`, as the task's `reset_rows`.

    Args:
        place: the task's compiled place(p, s, world, robots, i, draws, j): sets the obstacles and the pose at which
            robot i starts in scenario s.scenario, from row j of the draws.
        begin: its begin(p, s, world, robots, i, outputs): the first observation and numbers.
        robots: Robots.
        draws: uniform numbers, (len(rows), 1 + the task's draws) or 2 more.
        world: what they read of the task's bank; world.courses has a record a scenario.
        outputs: Outputs.
    """
    states = robots.states
    p = robots.params[0]
    for j in range(rows.shape[0]):
        i = rows[j]
        s = states[i]
        s.scenario = drawn_scenario(draws, j, world.courses.shape[0])
        place(p, s, world, robots, i, draws, j)
        records.halt(s)
        records.draw_shove(p, s, draws, j)
        s.clearance = hull_clearance(p, robots, i, s, s.x, s.y, s.heading)
        begin(p, s, world, robots, i, outputs)
        s.noise_row = 1
        outputs.flags[:, i] = False


# ---- worlds of several bodies


@inlined
def next_worlds(shares, thread, last, worlds, per):
    """Returns the first world, and the one behind the last, that a thread does next: `sharing.next_rows` of worlds.

    Args:
        last: where those ended that it has done; 0 in the beginning.
        per: worlds that are taken at once.
    """
    parts = (worlds + per - 1) // per
    first, end = next_rows(shares, thread, (last + per - 1) // per * PART, parts * PART)
    return min(first // PART * per, worlds), min(end // PART * per, worlds)


@inlined
def step_worlds(begin_step, exchange, judge, conclude, phases, turn, robots, crowd, actions, skip, world, outputs):
    """Runs the given phases of a step of all worlds: COMMAND, DRIVE, and JUDGE, before which bodies are exchanged.

    In COMMAND, DRIVE and JUDGE a robot reads the snapshot of its world and its own record, and writes its own alone.

    Returns the first robot whose action is not finite, before anything has moved; -1 if there is none.

    Args:
        begin_step: the task's begin_step(p, robots, crowd, world, w), before the robots of world w move.
        exchange: its exchange(p, robots, crowd, world, skip, w), once they have.
        judge: its judge(p, s, world, robots, crowd, i, row, outputs).
        conclude: its conclude(p, world, robots, skip, first, last, outputs), as of `step_robots`.
        crowd: what the task keeps of its worlds.
        skip: (b,) robots whose episode is over.
    """
    bad = begun(phases, turn, actions, skip)
    if bad >= 0:
        return bad
    thread, shares = turn
    params, states, _, noise, _ = robots
    p = params[0]
    n = p.team
    worlds = states.shape[0] // n
    per = max(1, PART // n)
    first, last = next_worlds(shares, thread, 0, worlds, per)
    while first < last:
        for w in range(first, last):
            going = False
            for i in range(w * n, (w + 1) * n):
                going = going or not skip[i]
            if not going:
                continue
            if phases & COMMAND:
                begin_step(p, robots, crowd, world, w)
                for i in range(w * n, (w + 1) * n):
                    if skip[i]:
                        continue
                    s = states[i]
                    move(phases, p, s, robots, actions, i, s.noise_row if noise.shape[1] > 1 else 0)
            if not phases & JUDGE:
                continue
            exchange(p, robots, crowd, world, skip, w)
            for i in range(w * n, (w + 1) * n):
                if skip[i]:
                    continue
                s = states[i]
                s.steps += 1
                judge(p, s, world, robots, crowd, i, s.noise_row if noise.shape[1] > 1 else 0, outputs)
                s.noise_row += 1
        if phases & JUDGE:
            conclude(p, world, robots, skip, first * n, last * n, outputs)
        first, last = next_worlds(shares, thread, last, worlds, per)
    return -1
