"""The shortest ways of a car that drives forward and backward, of at most five arcs and straights.

Source: Reeds and Shepp, Optimal Paths for a Car That Goes Both Forwards and Backwards, Pacific J. Math. 145(2), 1990,
eqs. 8.1 to 8.11. Words are in units of the turning radius, from the origin along x; plans are in the world.
"""

import math

import numpy as np

from wayfield.envs.world.geometry import clearance
from wayfield.envs.world.grids import grid_clearance
from wayfield.envs.world.movers import any_moves, go_on
from wayfield.system.compiled import allocating, compiled, inlined
from wayfield.system.elementary import bearing, sin_cos

MOST_PIECES = 5
PLAN = MOST_PIECES + 1  # pieces of a plan: those of a word, and a straight
STEP = 0.02  # m, between the places where a plan is looked at
WORDS = 8  # families of words; their mirror images and reversals follow by symmetry
_QUARTER = 0.5 * math.pi
_EXACT = 1e-9  # how far a word may end from where it shall, and a piece turn out the other way: by rounding alone


@inlined
def polar(x, y):
    """Returns the length and the direction of a vector."""
    return math.sqrt(x * x + y * y), bearing(y, x)


@inlined
def turned(angle):
    """Returns the angle in [-pi, pi] that points the same way; half a turn is pi, also where rounding makes it more."""
    return angle - 2.0 * math.pi * math.floor((angle + math.pi - _EXACT) / (2.0 * math.pi))


@inlined
def root(square):
    """Returns the square root of what is negative by rounding at most."""
    return math.sqrt(max(square, 0.0))


@inlined
def arc_cosine(cosine):
    """Returns the angle in [0, pi] of a cosine in [-1, 1]."""
    return bearing(root(1.0 - cosine * cosine), cosine)


@inlined
def outer_arcs(u, v, xi, eta, phi):
    """Returns the first and the last arc (t, v) of a word of four arcs, from the two between: eq. 8.6."""
    delta = turned(u - v)
    sin_u, cos_u = sin_cos(u)
    sin_d, cos_d = sin_cos(delta)
    a = sin_u - sin_d
    b = cos_u - cos_d - 1.0
    t = bearing(eta * a - xi * b, xi * a + eta * b)
    if 2.0 * (cos_d - sin_cos(v)[1] - cos_u) + 3.0 < 0.0:
        t += math.pi
    t = turned(t)
    return t, turned(t - u + v - phi)


@compiled
def base_word(kind, x, y, phi, turns, lengths):
    """Fills the turns (5,) and signed lengths (5,) of a word from the origin to (x, y, phi), by its family.

    Every word here begins with a forward arc to the left. Returns whether there is one; where a piece has no length but
    for rounding, it may have the wrong sign.
    """
    turns[:] = 0.0
    lengths[:] = 0.0
    sine, cosine = sin_cos(phi)
    turns[0] = 1.0
    if kind == 0:  # eq. 8.1: L+ S+ L+
        u, t = polar(x - sine, y - 1.0 + cosine)
        if u < _EXACT:  # one arc: a straight of no length has no direction
            t = 0.0
        t = turned(t)
        turns[2] = 1.0
        lengths[0], lengths[1], lengths[2] = t, u, turned(phi - t)
        return t >= -_EXACT and lengths[2] >= -_EXACT
    if kind == 2:  # eqs. 8.3 and 8.4: L+ R- L
        rho, theta = polar(x - sine, y - 1.0 + cosine)
        if rho > 4.0 + _EXACT:
            return False
        half = 0.25 * rho
        u = -2.0 * bearing(half, root(1.0 - half * half))
        t = turned(theta + 0.5 * u + math.pi)
        turns[1], turns[2] = -1.0, 1.0
        lengths[0], lengths[1], lengths[2] = t, u, turned(phi - t + u)
        return t >= -_EXACT
    if kind == 5:  # eq. 8.9: L+ R-(quarter) S- L-
        rho, theta = polar(x - sine, y - 1.0 + cosine)
        if rho < 2.0 - _EXACT:
            return False
        r = root(rho * rho - 4.0)
        t = turned(theta + bearing(r, -2.0))
        turns[1], turns[3] = -1.0, 1.0
        lengths[0], lengths[1], lengths[2], lengths[3] = t, -_QUARTER, 2.0 - r, turned(phi - _QUARTER - t)
        return t >= -_EXACT and lengths[2] <= _EXACT and lengths[3] <= _EXACT
    xi = x + sine
    eta = y - 1.0 - cosine
    rho, theta = polar(xi, eta)
    if kind == 1:  # eq. 8.2: L+ S+ R+
        if rho < 2.0 - _EXACT:
            return False
        u = root(rho * rho - 4.0)
        t = turned(theta + bearing(2.0, u))
        turns[2] = -1.0
        lengths[0], lengths[1], lengths[2] = t, u, turned(t - phi)
        return t >= -_EXACT and lengths[2] >= -_EXACT
    turns[1] = -1.0
    if kind == 3:  # eq. 8.7: L+ R+(u) L-(u) R-
        if rho > 2.0 + _EXACT:
            return False
        u = arc_cosine(0.25 * (2.0 + rho))
        t, v = outer_arcs(u, -u, xi, eta, phi)
        turns[2], turns[3] = 1.0, -1.0
        lengths[0], lengths[1], lengths[2], lengths[3] = t, u, -u, v
        return t >= -_EXACT and v <= _EXACT
    if kind == 4:  # eq. 8.8: L+ R-(u) L-(u) R+
        cosine_u = (20.0 - rho * rho) / 16.0
        if not -_EXACT <= cosine_u <= 1.0 + _EXACT:
            return False
        u = -arc_cosine(cosine_u)
        t, v = outer_arcs(u, u, xi, eta, phi)
        turns[2], turns[3] = 1.0, -1.0
        lengths[0], lengths[1], lengths[2], lengths[3] = t, u, u, v
        return t >= -_EXACT and v >= -_EXACT
    if rho < 2.0 - _EXACT:
        return False
    if kind == 6:  # eq. 8.10: L+ R-(quarter) S- R-
        t = turned(bearing(xi, -eta))
        turns[3] = -1.0
        lengths[0], lengths[1], lengths[2], lengths[3] = t, -_QUARTER, 2.0 - rho, turned(t + _QUARTER - phi)
        return t >= -_EXACT and lengths[3] <= _EXACT
    # eq. 8.11: L+ R-(quarter) S- L-(quarter) R+
    u = 4.0 - root(rho * rho - 4.0)
    t = turned(bearing((4.0 - u) * xi - 2.0 * eta, -2.0 * xi + (u - 4.0) * eta))
    turns[3], turns[4] = 1.0, -1.0
    lengths[0], lengths[1], lengths[2], lengths[3], lengths[4] = t, -_QUARTER, u, -_QUARTER, turned(t - phi)
    return t >= -_EXACT and u <= _EXACT and lengths[4] >= -_EXACT


@inlined
def step_along(x, y, heading, turn, length):
    """Returns the pose (units of the radius, rad) at the end of an arc or a straight; turn: 1 left, 0, -1 right."""
    if turn == 0.0:
        sine, cosine = sin_cos(heading)
        return x + length * cosine, y + length * sine, heading
    s0, c0 = sin_cos(heading)
    after = heading + turn * length
    s1, c1 = sin_cos(after)
    return x + turn * (s1 - s0), y - turn * (c1 - c0), after


@inlined
def ends_at(turns, lengths, x, y, phi):
    """Returns whether a word ends at a pose, to rounding."""
    px = 0.0
    py = 0.0
    heading = 0.0
    for k in range(MOST_PIECES):
        px, py, heading = step_along(px, py, heading, turns[k], lengths[k])
    return abs(px - x) + abs(py - y) + abs(turned(heading - phi)) < _EXACT * (1.0 + abs(x) + abs(y))


@allocating
def shortest_word(x, y, phi, word):
    """Fills the shortest way from the origin to the pose (x, y, phi); returns its length, in units of the radius.

    Args:
        word: (5, 2): of each piece the turn, 1 left, 0 straight, -1 right, and the length, negative backward; what is
            not needed has length 0.
    """
    turns = np.empty(MOST_PIECES)
    lengths = np.empty(MOST_PIECES)
    best = np.inf
    sine, cosine = sin_cos(phi)
    # the way back, reversed, is a way there: of the words that it does not map onto themselves
    back_x = x * cosine + y * sine
    back_y = x * sine - y * cosine
    for kind in range(WORDS):
        for back in range(2 if kind in (2, 5, 6) else 1):
            for symmetry in range(4):
                time = -1.0 if symmetry & 1 else 1.0  # forward and backward changed for one another
                side = -1.0 if symmetry & 2 else 1.0  # left and right
                px = time * (back_x if back else x)
                py = side * (back_y if back else y)
                if not base_word(kind, px, py, time * side * phi, turns, lengths):
                    continue
                total = 0.0
                for k in range(MOST_PIECES):
                    turns[k] *= side
                    lengths[k] *= time
                    total += abs(lengths[k])
                if back:
                    for k in range(MOST_PIECES // 2):
                        last = MOST_PIECES - 1 - k
                        turns[k], turns[last] = turns[last], turns[k]
                        lengths[k], lengths[last] = lengths[last], lengths[k]
                if total < best and ends_at(turns, lengths, x, y, phi):
                    best = total
                    for k in range(MOST_PIECES):
                        word[k, 0] = turns[k]
                        word[k, 1] = lengths[k]
    return best


@compiled
def pose_along(plan, radius, start, s):
    """Returns the pose (m, m, rad) at arc length s (m) of a plan from a start pose (3,), on circles of a radius (m)."""
    x = 0.0
    y = 0.0
    heading = 0.0
    left = s / radius
    for k in range(plan.shape[0]):
        length = abs(plan[k, 1])
        part = min(left, length)
        x, y, heading = step_along(x, y, heading, plan[k, 0], math.copysign(part, plan[k, 1]))
        left -= part
        if left <= 0.0:
            break
    sine, cosine = sin_cos(start[2])
    return (
        start[0] + radius * (cosine * x - sine * y),
        start[1] + radius * (sine * x + cosine * y),
        start[2] + heading,
    )


@compiled
def plan_to(start, goal, radius, straight, plan):
    """Fills the shortest plan between two poses (3,) that ends with a given straight; returns its length, m.

    Args:
        radius: m, of its circles.
        straight: m, of the last piece, negative backward.
        plan: (6, 2): of each piece the turn, 1 left, 0 straight, -1 right, and the length in radii, negative backward.
    """
    sine, cosine = sin_cos(start[2])
    ahead_y, ahead_x = sin_cos(goal[2])
    dx = (goal[0] - straight * ahead_x - start[0]) / radius
    dy = (goal[1] - straight * ahead_y - start[1]) / radius
    length = shortest_word(
        cosine * dx + sine * dy, cosine * dy - sine * dx, goal[2] - start[2], plan[:MOST_PIECES]
    )  # fmt: skip
    plan[MOST_PIECES, 0] = 0.0
    plan[MOST_PIECES, 1] = straight / radius
    return length * radius + abs(straight)


@compiled
def is_free(plan, radius, start, length, field, needed, times):
    """Returns whether the places of a plan have a clearance (m) all along.

    The clearance of a point changes by at most a metre per metre: what is clear by half a step more at the places that
    are looked at is clear in between. Beside what moves it is a whole step more: a disc that is no faster than twice
    the robot comes nearer by no more meanwhile.

    Args:
        length: m, of the plan.
        field: OBSTACLE records (1, m), how many there are, and the grid's frame (1,) and cells; the moving
            ones are moved.
        needed: m.
        times: s, when the robot sets off, and its pace, m/s, which it keeps.
    """
    obstacles, count, frames, cells = field
    moves = any_moves(obstacles, 0, count)
    steps = math.ceil(length / STEP)
    step = length / max(steps, 1)
    needed += (1.5 if moves else 0.5) * step
    for k in range(steps + 1):
        x, y, _ = pose_along(plan, radius, start, k * step)
        if moves:
            go_on(obstacles, 0, count, times[0] + k * step / times[1])
        if clearance(obstacles[0], count, x, y) < needed:
            return False
        if cells.shape[0] > 0 and grid_clearance(frames[0], cells, x, y) < needed:
            return False
    return True
