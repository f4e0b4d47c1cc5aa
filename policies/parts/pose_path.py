"""The path ahead as a curve of poses, on which a corner is a turn with a length of its own: what predictive laws share.

Its parameter sigma counts metres, and where the path turns sharper than a circle of radius `turn_radius`, the turn:
d sigma = max(ds, turn_radius |d heading|).
"""

import math

import numpy as np

from wayfield.envs.world.paths import segment_at, vertex
from wayfield.system.compiled import any_layout, compiled, inlined
from wayfield.system.elementary import wrap_angle

BEHIND = 0.1  # m, of the path behind the robot's projection that its place on the path is looked for on
BLEND = 0.02  # m, on either side of a vertex, over which the path's heading turns there; at most half a segment
BACK = 2.7  # rad, of a corner where the path goes back: the robot cannot follow a turn over a length there
ON_THE_SPOT = 0.002  # m, in place of BLEND there
SPACING = 0.02  # m, between the control points of the path ahead


@inlined
def blend_length(vertices, run, i, turn):
    """Returns the length (m) at an end of segment i over which the path's heading turns, by `turn` with the next."""
    most = BLEND if abs(turn) < BACK else ON_THE_SPOT
    return min(most, 0.5 * (vertex(vertices, run, i + 1).s - vertex(vertices, run, i).s))


@inlined
def turn_at(vertices, run, i):
    """Returns (turn, 1/m): by how much the path turns at the start of segment i, rad, and over what length."""
    j = i
    if i == 0 or i == run.segments:
        if not run.closed:
            return 0.0, 0.0
        i = 0
        j = run.segments
    turn = wrap_angle(vertex(vertices, run, i).heading - vertex(vertices, run, j - 1).heading)
    return turn, turn / (blend_length(vertices, run, i, turn) + blend_length(vertices, run, j - 1, turn))


@compiled
def poses_ahead(vertices, run, start, seen, turn_radius, path):
    """Fills `path` (p, 3) with the poses every SPACING of sigma, of which row 1 lies at arc length `start`.

    Returns (sigma at arc length `seen`, NaN if not reached; sigma at the path's end, inf if not reached); sigma is 0 at
    `start`. Beyond its ends the path goes on straight. The headings are unwrapped.
    """
    lap = math.floor(start / run.length) * run.length if run.closed else 0.0
    s = min(start - lap, run.length)
    i = segment_at(vertices, run, s)
    heading = vertex(vertices, run, i).heading
    filled = 1
    sigma = 0.0
    sigma_seen = np.nan
    sigma_end = np.inf
    while filled < path.shape[0]:
        a = vertex(vertices, run, i)
        length = vertex(vertices, run, i + 1).s - a.s
        turn_in, rate_in = turn_at(vertices, run, i)
        turn_out, rate_out = turn_at(vertices, run, i + 1)
        blend_in = blend_length(vertices, run, i, turn_in)
        blend_out = blend_length(vertices, run, i, turn_out)
        for part in range(3):
            # the turn at the segment's start, its straight middle, the turn at its end
            if part == 0:
                low = 0.0
                high = blend_in
                rate = rate_in
                at_low = heading - rate_in * blend_in
            elif part == 1:
                low = blend_in
                high = length - blend_out
                rate = 0.0
                at_low = heading
            else:
                low = length - blend_out
                high = length
                rate = rate_out
                at_low = heading
            if s - a.s > high:
                continue
            t = max(s - a.s, low)
            stretch = max(1.0, turn_radius * abs(rate))
            while filled < path.shape[0]:
                u = t + ((filled - 1) * SPACING - sigma) / stretch
                if u > high:
                    break
                path[filled, 0] = a.x + u * a.ux
                path[filled, 1] = a.y + u * a.uy
                path[filled, 2] = at_low + rate * (u - low)
                filled += 1
            beyond = seen - lap - a.s
            if t <= beyond <= high:
                sigma_seen = sigma + stretch * (beyond - t)
            sigma += stretch * (high - t)
        s = a.s + length
        i += 1
        if i == run.segments:
            if not run.closed:
                sigma_end = sigma
                last = vertex(vertices, run, run.segments)
                while filled < path.shape[0]:
                    over = (filled - 1) * SPACING - sigma
                    path[filled, 0] = last.x + over * a.ux
                    path[filled, 1] = last.y + over * a.uy
                    path[filled, 2] = heading
                    filled += 1
                break
            i = 0
            s = 0.0
            lap += run.length
        heading += turn_out
    for j in range(3):
        path[0, j] = 2.0 * path[1, j] - path[2, j]
    return sigma_seen, sigma_end


@inlined
def on_path(path, sigma):
    """Returns (x, y, heading) at sigma and their derivatives: the uniform quadratic B-spline of the poses."""
    u = sigma / SPACING + 1.5
    j = min(max(int(u), 1), path.shape[0] - 2)
    f = u - j
    a = 0.5 * (1.0 - f) * (1.0 - f)
    c = 0.5 * f * f
    b = 1.0 - a - c
    da = (f - 1.0) / SPACING
    dc = f / SPACING
    db = -da - dc
    return (
        a * path[j - 1, 0] + b * path[j, 0] + c * path[j + 1, 0],
        a * path[j - 1, 1] + b * path[j, 1] + c * path[j + 1, 1],
        a * path[j - 1, 2] + b * path[j, 2] + c * path[j + 1, 2],
        da * path[j - 1, 0] + db * path[j, 0] + dc * path[j + 1, 0],
        da * path[j - 1, 1] + db * path[j, 1] + dc * path[j + 1, 1],
        da * path[j - 1, 2] + db * path[j, 2] + dc * path[j + 1, 2],
    )


@any_layout
@compiled
def locate(vertices, runs, path_index, params, poses, arc_lengths, i, path, start):
    """Fills `path` with the path ahead of robot i, and `start` with (x, y, heading, sigma_0, the most sigma may be)."""
    m = params[0]
    run = runs[path_index[i]]
    seen = arc_lengths[i] if run.closed else min(arc_lengths[i], run.length)
    sigma_seen, sigma_end = poses_ahead(vertices, run, max(seen - BEHIND, 0.0), seen, m.turn_radius, path)
    if math.isnan(sigma_seen):
        # more turns behind the robot than the memory is made for
        sigma_seen, sigma_end = poses_ahead(vertices, run, seen, seen, m.turn_radius, path)
    x = poses[i, 0]
    y = poses[i, 1]
    heading = poses[i, 2]
    end = min(sigma_end, (path.shape[0] - 3) * SPACING)
    # a corner that has been turned on may lie ahead of the projection with all its length
    last = min(sigma_seen + math.pi * m.turn_radius, end)
    best = np.inf
    sigma = 0.0
    for j in range(1, min(int(last / SPACING) + 2, path.shape[0])):
        dx = x - path[j, 0]
        dy = y - path[j, 1]
        turn = wrap_angle(heading - path[j, 2])
        distance = m.position * (dx * dx + dy * dy) + m.heading * turn * turn
        if distance < best:
            best = distance
            sigma = (j - 1) * SPACING
    for _ in range(3):
        px, py, pth, dx, dy, dth = on_path(path, sigma)
        along = m.position * ((x - px) * dx + (y - py) * dy) + m.heading * wrap_angle(heading - pth) * dth
        move = along / (m.position * (dx * dx + dy * dy) + m.heading * dth * dth + 1e-9)
        sigma = min(max(sigma + min(max(move, -SPACING), SPACING), 0.0), end)
    px, py, pth, dx, dy, dth = on_path(path, sigma)
    start[0] = x
    start[1] = y
    start[2] = pth + wrap_angle(heading - pth)
    start[3] = sigma
    start[4] = end
