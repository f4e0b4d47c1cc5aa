"""Half-planes of velocities that keep clear of a disc, and the linear programs over them.

Source: van den Berg, Guy, Lin and Manocha, Reciprocal n-body collision avoidance, ISRR 2009 (STAR 70, 2011), and their
library RVO2.
"""

import math

from wayfield.system.compiled import compiled, inlined


@compiled
def disc_half_plane(px, py, reach, vx, vy, horizon, recovery):
    """Returns (nx, ny, b): the relative velocities n . v >= b that a disc leaves, its centre at p = (px, py).

    The velocity obstacle is the cone from the origin that touches the disc of radius `reach`, cut off by the disc at
    p / horizon of radius reach / horizon. Its boundary nearest to (vx, vy) is on that disc while the velocity, seen
    from there, points backwards to between the points where the cone touches it; else on the leg of its side.
    """
    squared = px * px + py * py
    distance = math.sqrt(squared)
    if distance <= reach:
        if distance < 1e-9:
            return 1.0, 0.0, reach / recovery
        return -px / distance, -py / distance, (reach - distance) / recovery
    wx = vx - px / horizon
    wy = vy - py / horizon
    size = math.sqrt(wx * wx + wy * wy)
    if -(wx * px + wy * py) >= reach * size and size > 1e-9:
        nx = wx / size
        ny = wy / size
        return nx, ny, (nx * px + ny * py + reach) / horizon
    # outward normal of a leg: the direction to the centre, turned by a right angle and the cone's half angle
    sine = reach / distance
    cosine = math.sqrt(max(squared - reach * reach, 0.0)) / distance
    side = 1.0 if px * vy - py * vx >= 0.0 else -1.0
    nx = (-sine * px - side * cosine * py) / distance
    ny = (side * cosine * px - sine * py) / distance
    return nx, ny, 0.0


@inlined
def shared_half_plane(px, py, reach, own, other, horizon, dt, share):
    """Returns (nx, ny, b): the velocities n . v >= b that leave a disc that moves, of which one takes a `share`.

    Where the discs overlap, they come apart within one period: the cut-off disc is that of dt, as in RVO2.

    Args:
        px, py: from the own centre to the disc's, m.
        reach: m, the sum of the radii.
        own, other: velocities (vx, vy), m/s.
        horizon: s, in which they do not meet.
        share: of the change of the relative velocity: 1/2 where both take it, 1 where the other takes none.
    """
    vx = own[0] - other[0]
    vy = own[1] - other[1]
    if px * px + py * py > reach * reach:
        nx, ny, b = disc_half_plane(px, py, reach, vx, vy, horizon, dt)
    else:
        wx = vx - px / dt
        wy = vy - py / dt
        size = math.sqrt(wx * wx + wy * wy)
        nx = 1.0
        ny = 0.0
        if size > 1e-12:
            nx = wx / size
            ny = wy / size
        b = (nx * px + ny * py + reach) / dt
    along = nx * vx + ny * vy
    return nx, ny, nx * own[0] + ny * own[1] + share * (b - along)


# Linear programs over half-planes nx vx + ny vy >= b, rows of `lines`, within the disc |v| <= limit.


@compiled
def best_velocity(lines, count, hard, limit, ux, uy, scratch):
    """Returns the velocity nearest to (ux, uy) that keeps the lines, or violates those from `hard` on the least.

    Standstill has to keep the lines before `hard`.
    """
    vx, vy, failed = nearest_velocity(lines, count, limit, ux, uy)
    if failed < count:
        if failed < hard:
            # nothing but standstill is left, and rounding hid that
            vx = 0.0
            vy = 0.0
        vx, vy = least_violation(lines, count, hard, limit, failed, vx, vy, scratch)
    return vx, vy


@compiled
def nearest_velocity(lines, count, limit, ux, uy):
    """Returns (vx, vy, failed): the velocity nearest to (ux, uy), and the first line that cannot be kept, or count."""
    size = math.sqrt(ux * ux + uy * uy)
    shorten = limit / size if size > limit else 1.0
    vx = shorten * ux
    vy = shorten * uy
    for j in range(count):
        if lines[j, 0] * vx + lines[j, 1] * vy >= lines[j, 2] - 1e-12:
            continue
        low, high = free_stretch(lines, j, limit)
        if low > high:
            return vx, vy, j
        along = min(max(lines[j, 0] * uy - lines[j, 1] * ux, low), high)
        vx, vy = on_line(lines, j, along)
    return vx, vy, count


@compiled
def farthest_velocity(lines, count, limit, dx, dy):
    """Returns (vx, vy, failed) as `nearest_velocity` does, for the velocity farthest along the unit vector (dx, dy)."""
    vx = limit * dx
    vy = limit * dy
    for j in range(count):
        if lines[j, 0] * vx + lines[j, 1] * vy >= lines[j, 2] - 1e-12:
            continue
        low, high = free_stretch(lines, j, limit)
        if low > high:
            return vx, vy, j
        vx, vy = on_line(lines, j, high if lines[j, 0] * dy - lines[j, 1] * dx > 0.0 else low)
    return vx, vy, count


@inlined
def on_line(lines, j, along):
    """Returns the velocity on the border of line j, `along` to the left of its foot as seen along the normal."""
    return (
        lines[j, 2] * lines[j, 0] - along * lines[j, 1],
        lines[j, 2] * lines[j, 1] + along * lines[j, 0],
    )


@compiled
def free_stretch(lines, j, limit):
    """Returns (low, high) along line j within which the lines before it are kept and |v| <= limit; low > high if none.

    The normals have unit length.
    """
    squared = limit * limit - lines[j, 2] * lines[j, 2]
    if squared < 0.0:
        return 1.0, -1.0
    high = math.sqrt(squared)
    low = -high
    for i in range(j):
        # n_i . (foot + along * left) >= b_i
        slope = lines[j, 0] * lines[i, 1] - lines[j, 1] * lines[i, 0]
        lacking = lines[i, 2] - lines[j, 2] * (lines[i, 0] * lines[j, 0] + lines[i, 1] * lines[j, 1])
        if abs(slope) < 1e-10:
            if lacking > 1e-10:
                return 1.0, -1.0
        elif slope > 0.0:
            low = max(low, lacking / slope)
        else:
            high = min(high, lacking / slope)
    return low, high


@compiled
def least_violation(lines, count, hard, limit, failed, vx, vy, scratch):
    """Returns the velocity that keeps the lines before `hard` and has the least largest violation of the others.

    Wherever line j is the one violated most, violation d = b_j - n_j . v, no other is while n_i . v >= b_i - d: a
    half-plane again. Among those the least d is the farthest velocity along n_j.
    """
    worst = 0.0
    for j in range(max(failed, hard), count):
        if lines[j, 2] - lines[j, 0] * vx - lines[j, 1] * vy <= worst:
            continue
        for i in range(hard):
            scratch[i, 0] = lines[i, 0]
            scratch[i, 1] = lines[i, 1]
            scratch[i, 2] = lines[i, 2]
        rows = hard
        for i in range(hard, j):
            nx = lines[i, 0] - lines[j, 0]
            ny = lines[i, 1] - lines[j, 1]
            size = math.sqrt(nx * nx + ny * ny)
            # lines with one direction: the farther one has the greater violation everywhere
            if size < 1e-9:
                continue
            scratch[rows, 0] = nx / size
            scratch[rows, 1] = ny / size
            scratch[rows, 2] = (lines[i, 2] - lines[j, 2]) / size
            rows += 1
        to_vx, to_vy, failing = farthest_velocity(scratch, rows, limit, lines[j, 0], lines[j, 1])
        if failing == rows:
            vx = to_vx
            vy = to_vy
        worst = max(worst, lines[j, 2] - lines[j, 0] * vx - lines[j, 1] * vy)
    return vx, vy
