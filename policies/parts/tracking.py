"""Discs that move among what stands, told from it by the scans of a robot: where they are, how fast, where they turn.

A surface in sight is followed as a disc through its hits. It counts as moving once it has been in two places that no
solid can have been in both: a beam goes through where its middle was, or went, on the way to it, through where that is.
What stands gives no such beam, however its shape is seen from elsewhere.
"""

import math

import numpy as np

from wayfield.policies.parts.stopping import WATCHED, WHOLE
from wayfield.system.compiled import allocating, compiled, inlined
from wayfield.system.elementary import sin_cos

MOST = 6  # discs that a robot follows
TRACKS = [
    (
        "tracks",
        np.dtype(
            [
                ("radius", np.float64),  # m; 0: none is followed here
                ("hits", np.float64),  # that it is known by
                ("place", np.float64, (2,)),  # m, world frame, of the middle
                ("velocity", np.float64, (2,)),  # m/s
                ("unseen", np.float64),  # s
                ("place_then", np.float64, (2,)),  # m, of the middle
                ("from_then", np.float64, (2,)),  # m, of the robot
                ("since_then", np.float64),  # s
                ("evidence", np.float64),  # scans since then by which it cannot be where it was
                ("moves", np.float64),  # 1 once that was enough
                ("pace", np.float64),  # m/s, of what moves
                ("course", np.float64, (2,)),  # unit vector
                ("farthest", np.float64, (2,)),  # m, where it was on its course
                ("ends", np.float64, (2, 2)),  # m, where it turned back, the last one first
                ("turns", np.float64),  # how many of them are known
                ("strayed", np.float64),  # s, since it was on its course
            ],
            align=True,
        ),
        (MOST,),
    )
]

SMALLEST, LARGEST = 0.05, 0.4  # m, radius of a disc
ROUND = 0.03  # m, by which hits may lie off its rim
SAME = 0.25  # share of its radius, by which that of a disc in one scan may differ
GATE = 0.25  # m, from its rim, within which a hit is a disc's
LOOSE = 0.02  # weight of where a disc was foreseen, beside that of a hit
UNSEEN = 2.0  # s, for which a disc out of sight is kept
SETTLING = 0.3  # s, in which a velocity follows
STEADY = 1.0  # s, in which a pace does

ENOUGH = 3  # scans of evidence
SLOWEST = 0.08  # m/s, of what moves
LEAST_WAY = 0.12  # m, that it has gone
UNEVEN = 0.4  # share of its way, by which that differs from a steady one
CORE = 0.5  # of its radius: what lies deeper is solid, though the surface be another
RIM = 0.7  # of its radius, up to which beams surely met it
CLEAR = 0.05  # m, that a beam goes farther than where something was
THEN = 2.0  # s, after which its place is taken for that of then

BACK = 0.1  # m, behind the farthest place on its course, where a disc has turned
STRAYED = 1.0  # s, off its course, after which it is on another
ASTRAY = 0.15  # m, off its patrol, with which the far end of that is forgotten
FAR = 1e3  # s, of a leg whose end is not known
TURNS = 8  # s, within which a disc may turn that has not been seen to
LAID = MOST * (TURNS + 1)  # OBSTACLE records of all discs, at most


@allocating
def follow(p, scan, seen, m, i, still):
    """Follows the discs in robot i's scan, and takes those that move out of its row of the ranges `still` (b, beams).

    p: with `plant`, and `closed`, whether the beams surround the robot. m: a record with TRACKS.
    """
    beams = scan.directions.shape[0]
    dt = p.plant.dt
    for k in range(MOST):
        track = m.tracks[k]
        track.place[0] += dt * track.velocity[0]
        track.place[1] += dt * track.velocity[1]
        track.unseen += dt
        track.since_then += dt
        if track.unseen > UNSEEN:
            track.radius = 0.0
    sine, cosine = sin_cos(seen.poses[i, 2])
    rays = np.empty((beams, 2))
    hits = np.empty((beams, 2))
    joined = np.zeros(beams, np.bool_)  # to the one before
    for j in range(beams):
        rays[j, 0] = cosine * scan.directions[j, 0] - sine * scan.directions[j, 1]
        rays[j, 1] = sine * scan.directions[j, 0] + cosine * scan.directions[j, 1]
        hits[j, 0] = seen.poses[i, 0] + scan.ranges[i, j] * rays[j, 0]
        hits[j, 1] = seen.poses[i, 1] + scan.ranges[i, j] * rays[j, 1]
    farthest = (1.0 - 1e-6) * scan.reach
    first = 0
    for j in range(beams):
        dx = hits[j, 0] - hits[j - 1, 0]
        dy = hits[j, 1] - hits[j - 1, 1]
        near = max(scan.ranges[i, j], scan.ranges[i, j - 1]) < farthest and dx * dx + dy * dy < WHOLE * WHOLE
        joined[j] = near and (j > 0 or p.closed)
        if not joined[j]:
            first = j
    surface = np.empty((beams, 2))
    count = 0
    for n in range(beams):
        j = (first + n) % beams
        if scan.ranges[i, j] < min(farthest, WATCHED):
            surface[count] = hits[j]
            count += 1
        after = (j + 1) % beams
        if count > 0 and (n + 1 == beams or not joined[after]):
            moving = update(p, scan, seen, m, i, rays, surface[:count])
            for back in range(n + 1):
                if moving:
                    still[i, (j - back) % beams] = scan.reach
                if not joined[(j - back) % beams]:
                    break
            count = 0


@inlined
def update(p, scan, seen, m, i, rays, surface):
    """Enters the hits (n, 2), m, of a surface into the tracks; returns whether it is a disc that moves."""
    last = surface.shape[0] - 1
    dx = surface[last, 0] - surface[0, 0]
    dy = surface[last, 1] - surface[0, 1]
    if dx * dx + dy * dy > 4.0 * LARGEST * LARGEST:
        return False
    fitted, cx, cy, radius = disc_through(surface, seen.poses[i, 0], seen.poses[i, 1])
    chosen = -1
    least = GATE
    free = -1
    for k in range(MOST):
        track = m.tracks[k]
        if track.radius == 0.0:
            free = k
        elif track.unseen > 0.0:
            off = 0.0
            for j in range(surface.shape[0]):
                ux = surface[j, 0] - track.place[0]
                uy = surface[j, 1] - track.place[1]
                off = max(off, abs(math.sqrt(ux * ux + uy * uy) - track.radius))
            if off < least:
                least = off
                chosen = k
    if chosen < 0:
        if fitted and free >= 0:
            begin(seen, m.tracks[free], i, surface.shape[0], cx, cy, radius)
        return False
    track = m.tracks[chosen]
    same = fitted and abs(radius - track.radius) < SAME * track.radius
    if fitted and surface.shape[0] >= track.hits:
        track.radius = radius
        track.hits = surface.shape[0]
    measure(p, track, surface)
    if same:
        weigh(scan, seen, track, i, rays)
    elif fitted and track.moves == 0.0:
        note_then(seen, track, i)
    if track.moves == 1.0:
        note_course(p, seen, track, i)
    return track.moves == 1.0


@inlined
def disc_through(surface, x, y):
    """Returns whether a disc lies behind hits (n, 2) as seen from (x, y), and its middle and radius, m.

    Source: Kasa, A Circle Fitting Procedure and Its Error Analysis, IEEE Trans. Instrumentation and Measurement 25(1),
    1976.
    """
    n = surface.shape[0]
    if n < 3:
        return False, 0.0, 0.0, 0.0
    mx = 0.0
    my = 0.0
    for j in range(n):
        mx += surface[j, 0] / n
        my += surface[j, 1] / n
    uu = 0.0
    uv = 0.0
    vv = 0.0
    a = 0.0
    b = 0.0
    for j in range(n):
        u = surface[j, 0] - mx
        v = surface[j, 1] - my
        uu += u * u
        uv += u * v
        vv += v * v
        a += 0.5 * u * (u * u + v * v)
        b += 0.5 * v * (u * u + v * v)
    inverse = uu * vv - uv * uv
    if inverse < 1e-12:
        return False, 0.0, 0.0, 0.0
    cu = (a * vv - b * uv) / inverse
    cv = (b * uu - a * uv) / inverse
    radius = math.sqrt(cu * cu + cv * cv + (uu + vv) / n)
    ok = SMALLEST <= radius <= LARGEST and cu * (mx - x) + cv * (my - y) > 0.0
    for j in range(n):
        u = surface[j, 0] - mx - cu
        v = surface[j, 1] - my - cv
        ok = ok and abs(math.sqrt(u * u + v * v) - radius) < ROUND
    return ok, mx + cu, my + cv, radius


@inlined
def begin(seen, track, i, hits, cx, cy, radius):
    """Begins to follow a disc."""
    track.radius = radius
    track.hits = hits
    track.place[0] = cx
    track.place[1] = cy
    track.velocity[0] = 0.0
    track.velocity[1] = 0.0
    track.unseen = 0.0
    track.moves = 0.0
    note_then(seen, track, i)


@inlined
def note_then(seen, track, i):
    """Takes the present place of a disc for that of then."""
    for axis in range(2):
        track.place_then[axis] = track.place[axis]
        track.from_then[axis] = seen.poses[i, axis]
    track.since_then = 0.0
    track.evidence = 0.0


@inlined
def measure(p, track, surface):
    """Puts the middle of a disc where its rim meets the hits (n, 2), and draws the velocity after it.

    Gauss and Newton's steps; across to where few hits tell, the middle stays where it was foreseen.
    """
    cx = track.place[0]
    cy = track.place[1]
    for _ in range(3):
        xx = LOOSE
        xy = 0.0
        yy = LOOSE
        a = LOOSE * (track.place[0] - cx)
        b = LOOSE * (track.place[1] - cy)
        for j in range(surface.shape[0]):
            ux = cx - surface[j, 0]
            uy = cy - surface[j, 1]
            length = max(math.sqrt(ux * ux + uy * uy), 1e-6)
            ux /= length
            uy /= length
            xx += ux * ux
            xy += ux * uy
            yy += uy * uy
            a += ux * (track.radius - length)
            b += uy * (track.radius - length)
        inverse = xx * yy - xy * xy
        cx += (a * yy - b * xy) / inverse
        cy += (b * xx - a * xy) / inverse
    share = min(1.0, p.plant.dt / SETTLING) / track.unseen
    track.velocity[0] += share * (cx - track.place[0])
    track.velocity[1] += share * (cy - track.place[1])
    track.place[0] = cx
    track.place[1] = cy
    track.unseen = 0.0


@inlined
def weigh(scan, seen, track, i, rays):
    """Counts evidence that a disc moves: it went a steady way, and beams say that it is no longer where it was."""
    core = CORE * track.radius
    vx, vy = track.velocity
    went = False
    gone = track.since_then
    gx = track.place[0] - track.place_then[0]
    gy = track.place[1] - track.place_then[1]
    off = math.sqrt((gx - gone * vx) ** 2 + (gy - gone * vy) ** 2)
    way = math.sqrt(gx * gx + gy * gy)
    if way > max(LEAST_WAY, SLOWEST * gone) and off < UNEVEN * way:
        # one of the beams that met it then went through where its middle is now
        ax = track.place_then[0] - track.from_then[0]
        ay = track.place_then[1] - track.from_then[1]
        length = math.sqrt(ax * ax + ay * ay)
        cx = track.place[0] - track.from_then[0]
        cy = track.place[1] - track.from_then[1]
        along = (cx * ax + cy * ay) / length
        wide = core + RIM * track.radius * along / length
        went = 0.0 < along < length - track.radius - CLEAR and abs(cx * ay - cy * ax) < wide * length
        # one of now goes through where its middle was
        cx = track.place_then[0] - seen.poses[i, 0]
        cy = track.place_then[1] - seen.poses[i, 1]
        for j in range(rays.shape[0]):
            along = cx * rays[j, 0] + cy * rays[j, 1]
            across = cx * rays[j, 1] - cy * rays[j, 0]
            went = went or (along > 0.0 and scan.ranges[i, j] > along + CLEAR and abs(across) < core)
    if went:
        track.evidence += 1.0
        if track.moves == 0.0 and track.evidence >= ENOUGH:
            track.moves = 1.0
            begin_leg(track, track.place_then[0], track.place_then[1], vx, vy)
    elif track.since_then > THEN or gx * vx + gy * vy < 0.0:
        note_then(seen, track, i)


@inlined
def begin_leg(track, x, y, vx, vy):
    """Begins a leg at (x, y), m, by the present velocity, m/s; nothing is known of where the disc turns."""
    track.turns = 0.0
    track.strayed = 0.0
    track.pace = max(math.sqrt(vx * vx + vy * vy), SLOWEST)
    track.course[0] = vx / track.pace
    track.course[1] = vy / track.pace
    track.ends[0, 0] = x
    track.ends[0, 1] = y
    track.farthest[0] = track.place[0]
    track.farthest[1] = track.place[1]


@inlined
def note_course(p, seen, track, i):
    """Notes where a disc that moves heads, how fast, and where it turned back."""
    x, y = track.place
    vx, vy = track.velocity
    on = (x - track.farthest[0]) * track.course[0] + (y - track.farthest[1]) * track.course[1]
    if on < -BACK:
        for axis in range(2):
            track.ends[1, axis] = track.ends[0, axis]
            track.ends[0, axis] = track.farthest[axis]
            track.course[axis] = -track.course[axis]
        track.turns += 1.0
    if on > 0.0 or on < -BACK:
        track.farthest[0] = x
        track.farthest[1] = y
    dx = x - track.ends[0, 0]
    dy = y - track.ends[0, 1]
    gone = math.sqrt(dx * dx + dy * dy)
    ahead = vx * track.course[0] + vy * track.course[1]
    if ahead > 0.5 * track.pace:
        track.strayed = 0.0
        track.pace += min(1.0, p.plant.dt / STEADY) * (ahead - track.pace)
        if gone > 2.0 * BACK:
            track.course[0] = dx / gone
            track.course[1] = dy / gone
    else:
        track.strayed += p.plant.dt
        if track.strayed > STRAYED:
            begin_leg(track, x, y, vx, vy)
            if vx * vx + vy * vy < SLOWEST * SLOWEST:
                track.moves = 0.0
                note_then(seen, track, i)
    if track.turns > 1.0:
        ex = track.ends[1, 0] - track.ends[0, 0]
        ey = track.ends[1, 1] - track.ends[0, 1]
        length = max(math.sqrt(ex * ex + ey * ey), 1e-6)
        if max((dx * ex + dy * ey) / length - length, abs(dx * ey - dy * ex) / length) > ASTRAY:
            track.turns = 1.0


@compiled
def lay_movers(m, now, wary, records, i, count):
    """Adds to row i of OBSTACLE records (b, n), of which there are `count`, the discs that move; returns the new count.

    A disc turns where it was seen to turn, at either end. Before, it goes on as it does; with `wary` it is there
    several times, as if it turned at once, in a second, in two, and so on.

    Args:
        now: s, in the episode.
    """
    for k in range(MOST):
        track = m.tracks[k]
        if track.radius == 0.0 or track.moves == 0.0:
            continue
        for later in range(TURNS + 1 if wary and track.turns < 2.0 else 1):
            each = records[i, count]
            count += 1
            each.x = track.place[0]
            each.y = track.place[1]
            each.cos = 1.0
            each.radius = track.radius
            each.patrol.vx = track.pace * track.course[0]
            each.patrol.vy = track.pace * track.course[1]
            each.patrol.x = track.place[0] - FAR * each.patrol.vx
            each.patrol.y = track.place[1] - FAR * each.patrol.vy
            each.patrol.leg_time = FAR + (FAR if later == 0 else later - 1.0)
            each.patrol.phase = FAR - now
            if track.turns > 1.0:
                ex = track.ends[1, 0] - track.ends[0, 0]
                ey = track.ends[1, 1] - track.ends[0, 1]
                length = max(math.sqrt(ex * ex + ey * ey), 0.01)
                along = ((track.place[0] - track.ends[0, 0]) * ex + (track.place[1] - track.ends[0, 1]) * ey) / length
                each.patrol.x = track.ends[0, 0]
                each.patrol.y = track.ends[0, 1]
                each.patrol.vx = track.pace * ex / length
                each.patrol.vy = track.pace * ey / length
                each.patrol.leg_time = length / track.pace
                each.patrol.phase = max(along, 0.0) / track.pace - now
    return count
