"""How people walk: by a law of their own, inside of the compiled step, among robots, people and walls.

A person is a disc that can take up any velocity. All decide from the places of one moment, then all move: no result
depends on who is counted first.

The laws are those of the literature by name: `ORCA` (van den Berg et al. 2011), the social forces of
Helbing and Molnar (Phys. Rev. E 51, 1995), of Moussaid et al. (Proc. R. Soc. B 276, 2009) and of Helbing, Farkas and
Vicsek (Nature 407, 2000), a constant velocity, standing, and a recorded track. "pysocialforce" and "lightsfm" are the
force of 2009 with the numbers of two programs that many use: PySocialForce (config/default.toml: 5.1 m/s^2 among
people, walls 10 m/s^2 within 0.2 m of the hull) and lightsfm, HuNavSim's (sfm.hpp: 2.1 m/s^2, the same walls, a drive
twice as strong, and nobody faster than wanted). The nearest place of a wall pushes, where they sum points of it.

People of a group walk together by the forces of Moussaid et al. (PLoS ONE 5, e10047, 2010): they keep the others in
view, near and apart. Of a person with a reaction to robots, HuNavSim says which (Perez-Higueras et al., RA-L 2023;
agent_manager.cpp): see REACTIONS. Both are for the forces of 2009.

In one stream the speed of people falls with their density (Weidmann 1993). No law keeps that to 20 % from 0.5 to 2
people a square metre: by the force of 1995 they are slower by 16 to 26 %; by ORCA and the forces of 2009, its sets
included, quicker by 5 to 22 % up to 1, and by 60 % at 1.5 and 110 to 120 % at 2, and by that of 2000 by more than 80 %
there: who walk alike do not slow down.
"""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from wayfield.envs.crowds.bodies import (
    HULL,
    NEAREST,
    PERSON,
    PLACE,
    ROBOT,
    STANDS_BELOW,
    Bodies,
    Sight,
    cells_for,
    lay_cells,
    note_neighbours,
)
from wayfield.envs.crowds.half_planes import best_velocity, shared_half_plane
from wayfield.envs.world.geometry import OBSTACLE, nearest_surface
from wayfield.envs.world.grids import FRAME
from wayfield.system.compiled import allocating, compiled, inlined
from wayfield.system.elementary import bearing, exponential, sin_cos

STANDING, CONSTANT, ORCA, HELBING_MOLNAR, MOUSSAID, HELBING_FARKAS_VICSEK, REPLAY, PYSOCIALFORCE, LIGHTSFM = range(9)
LAWS = {
    "standing": STANDING,
    "constant_velocity": CONSTANT,
    "orca": ORCA,
    "helbing_molnar": HELBING_MOLNAR,
    "moussaid": MOUSSAID,
    "helbing_farkas_vicsek": HELBING_FARKAS_VICSEK,
    "replay": REPLAY,
    "pysocialforce": PYSOCIALFORCE,
    "lightsfm": LIGHTSFM,
}
OF_2009 = (MOUSSAID, PYSOCIALFORCE, LIGHTSFM)  # laws of those who walk in groups or react
REGULAR, IMPASSIVE, SURPRISED, SCARED, CURIOUS, THREATENING = range(6)
REACTIONS = {
    "regular": REGULAR,  # a robot is another person
    "impassive": IMPASSIVE,  # a robot is a thing that stands: as near as a wall
    "surprised": SURPRISED,  # stops while it sees a robot
    "scared": SCARED,  # keeps away from it, slowly
    "curious": CURIOUS,  # approaches it, and stops before it
    "threatening": THREATENING,  # gets in front of it
}
STAYS, TURNS_BACK, COMES_AGAIN, LEAVES, GOES_ON = range(5)  # what a person does at the goal

# A person of a scenario.
WALK = np.dtype(
    [
        ("law", np.int64),
        ("x", np.float64),  # m, where the walk begins
        ("y", np.float64),
        ("goal_x", np.float64),
        ("goal_y", np.float64),
        ("gate_x", np.float64),  # m, one end of a gate that is passed first; both ends in one place: there is none
        ("gate_y", np.float64),
        ("gate_to_x", np.float64),  # m, the other: the goal is on the right of the way from one end to the other
        ("gate_to_y", np.float64),
        ("speed", np.float64),  # m/s, wanted
        ("radius", np.float64),  # m
        ("then", np.int64),  # STAYS, TURNS_BACK, COMES_AGAIN, LEAVES or GOES_ON
        ("blind", np.int64),  # 1: robots are not seen
        ("horizon", np.float64),  # s, of ORCA
        ("wall_horizon", np.float64),  # s
        ("margin", np.float64),  # m, that every disc is larger by
        ("share", np.float64),  # of the change of velocity that this one takes
        ("turn", np.float64),  # rad, to the right, of the wanted velocity
        ("frame_time", np.float64),  # s, between the rows of a track
        ("begins", np.float64),  # s, when the first row is
        ("first", np.int64),  # the first row of the track; of who GOES_ON, of the goals that follow, round and round
        ("rows", np.int64),
        ("group", np.int64),  # of whom one walks with, from 1 on; 0: alone
        ("reaction", np.int64),  # to robots, of REACTIONS
    ],
    align=True,
)

WALKER = np.dtype(
    [
        ("x", np.float64),  # m
        ("y", np.float64),
        ("vx", np.float64),  # m/s
        ("vy", np.float64),
        ("next_vx", np.float64),  # m/s, of the law for the next step
        ("next_vy", np.float64),
        ("goal_x", np.float64),
        ("goal_y", np.float64),
        ("present", np.int64),
        ("laps", np.int64),  # how often the goal was reached
        ("arrived", np.float64),  # s, when it was for the first time; -1: not yet
    ],
    align=True,
)


class People(NamedTuple):
    """The people of all worlds, as compiled functions read them."""

    walks: NDArray[np.void]  # (scenarios, q) WALK records
    tracks: NDArray[np.float64]  # (rows, 4) x, y (m), vx, vy (m/s)
    walkers: NDArray[np.void]  # (worlds, q) WALKER records


class Scratch(NamedTuple):
    """Room for the half-planes of one person."""

    lines: NDArray[np.float64]
    program: NDArray[np.float64]


@allocating
def scratch_for(obstacles):
    """Returns room for the half-planes that so many obstacles and all neighbours leave."""
    return Scratch(np.empty((obstacles + NEAREST, 3)), np.empty((obstacles + NEAREST, 3)))


# Constants of the laws, with the units of their sources.
_RELAXATION = 0.5  # s, Helbing
_MOST = 1.3  # times the wanted speed, at most
_V0, _SIGMA, _STEP = 2.1, 0.3, 2.0  # m^2/s^2, m, s (1995)
_U0, _WALL = 10.0, 0.2  # m^2/s^2, m
_BEHIND, _COS_SIGHT = 0.5, -0.17364817766693033  # cos(100 degrees)
_RELAXATION_M = 0.54  # s, Moussaid
_A, _GAMMA, _N, _N_PRIME, _LAMBDA = 4.5, 0.35, 2.0, 3.0, 2.0  # m/s^2, -, -, -, -
_A_WALL, _B_WALL = 3.0, 0.1  # m/s^2, m
_MASS, _A_HFV, _B_HFV = 80.0, 2000.0, 0.08  # kg, N, m
_BODY, _FRICTION = 1.2e5, 2.4e5  # kg/s^2, kg/(m s)
_SUBSTEP = 1e-3  # s, of contact forces, which are stiff
_FARTHEST_WALL = 2.0  # m, from which on walls exert no force
_GAZE, _COHESION, _REPULSION, _CLOSE = 4.0, 3.0, 1.0, 0.8  # 1/s, m/s^2, m/s^2, m, of groups (Moussaid et al. 2010)
# HuNavSim's: m, rad, how far and wide a robot is seen
_NOTICED, _COS_NOTICED = 5.0, -0.16918235006698592  # cos(pi / 2 + 0.17)
_SCARED_SPEED, _SCARED_FORCE = 0.6, 4.0  # m/s; m^2/s^2: 20 times 0.2 m
_CURIOUS_SPEED, _CURIOUS_SIGHT, _CURIOUS_GAP = 1.8, 10.0, 1.5  # m/s at that distance (m), slower when nearer; m
_BLOCK_SPEED, _BLOCK_AHEAD = 2.0, 1.4  # m/s, m


@inlined
def numbers_of(law):
    """Returns (s, m/s^2, m/s^2, m, 1) of a force: relaxation, people (of 2009), walls, their range, greatest speed."""
    if law == HELBING_MOLNAR:
        return _RELAXATION, 0.0, _U0 / _WALL, _WALL, _MOST
    if law == HELBING_FARKAS_VICSEK:
        return _RELAXATION, 0.0, 0.0, 1.0, np.inf  # walls push as bodies do, and nothing bounds the speed
    if law == PYSOCIALFORCE:
        return 0.5, 5.1, 10.0, 0.2, 1.3
    if law == LIGHTSFM:
        return 0.25, 2.1, 10.0, 0.2, 1.0
    return _RELAXATION_M, _A, _A_WALL, _B_WALL, _MOST


@compiled
def towards(walk, walker):
    """Returns (x, y, last), from a person to what is headed for, m: the goal, or a gate that is not yet passed."""
    dx = walk.gate_to_x - walk.gate_x
    dy = walk.gate_to_y - walk.gate_y
    squared = dx * dx + dy * dy
    x = walker.goal_x - walker.x
    y = walker.goal_y - walker.y
    last = True
    if squared > 0.0:
        px = walker.x - walk.gate_x
        py = walker.y - walk.gate_y
        gx = walker.goal_x - walk.gate_x
        gy = walker.goal_y - walk.gate_y
        if (dx * py - dy * px) * (dx * gy - dy * gx) < 0.0:
            last = False
            # on the other side: the nearest place of the gate that leaves room for the shoulders
            spare = min(walk.radius / math.sqrt(squared), 0.5)
            share = min(max((px * dx + py * dy) / squared, spare), 1.0 - spare)
            x = share * dx - px
            y = share * dy - py
            # a little beyond, so that it is not stopped at
            side = math.copysign(0.5 / math.sqrt(squared), dx * gy - dy * gx)
            x -= side * dy
            y += side * dx
    return x, y, last


@inlined
def wanted(walk, walker):
    """Returns the velocity (m/s) that a person would walk at alone: slower within a second of the goal, not a gate."""
    x, y, last = towards(walk, walker)
    distance = max(math.sqrt(x * x + y * y), 1e-12)
    factor = 1.0 if last and distance <= walk.speed else walk.speed / distance
    if walk.turn != 0.0:
        sine, cosine = sin_cos(-walk.turn)
        x, y = cosine * x - sine * y, sine * x + cosine * y
    return factor * x, factor * y


@inlined
def other_body(bodies, people, now, w, robots, j):
    """Returns (x, y, vx, vy) of body j: of a person as it walks at this moment."""
    if j < robots:
        place = bodies.places[now, w, j]
        return place.x, place.y, place.vx, place.vy
    walker = people.walkers[w, j - robots]
    return walker.x, walker.y, walker.vx, walker.vy


@compiled
def orca_velocity(walk, walker, bodies, people, now, w, robots, k, around, scratch, dt):
    """Sets the next velocity of a person by ORCA."""
    obstacles, field, count = around
    lines = scratch.lines
    total = 0
    radius = walk.radius + walk.margin
    for o in range(count):
        distance, nx, ny = nearest_surface(obstacles[field, o], walker.x, walker.y)
        if distance > radius + walk.wall_horizon * 2.0 * walk.speed:
            continue
        lines[total, 0] = nx
        lines[total, 1] = ny
        lines[total, 2] = min((radius - distance) / (walk.wall_horizon if distance > radius else dt), 0.0)
        total += 1
    hard = total
    i = robots + k
    own = (walker.vx, walker.vy)
    for a in range(bodies.counts[w, i]):
        j = bodies.near[w, i, a]
        if j < robots and bodies.places[now, w, j].present == 0:
            continue  # it has just left
        x, y, vx, vy = other_body(bodies, people, now, w, robots, j)
        reach = walk.radius + bodies.hulls[w, j].reach + 2.0 * walk.margin
        lines[total, 0], lines[total, 1], lines[total, 2] = shared_half_plane(
            x - walker.x, y - walker.y, reach, own, (vx, vy), walk.horizon, dt, walk.share
        )
        total += 1
    ux, uy = wanted(walk, walker)
    walker.next_vx, walker.next_vy = best_velocity(lines, total, hard, walk.speed, ux, uy, scratch.program)


@inlined
def pushed_1995(x, y, vx, vy):
    """Returns the acceleration away from another person, (x, y) the way from the other, (vx, vy) its velocity.

    The gradient of V0 exp(-b / sigma), b the half axis of an ellipse about the other's next step.
    """
    sx = vx * _STEP
    sy = vy * _STEP
    first = math.sqrt(x * x + y * y)
    second = math.sqrt((x - sx) * (x - sx) + (y - sy) * (y - sy))
    b = 0.5 * math.sqrt(max((first + second) * (first + second) - (sx * sx + sy * sy), 1e-12))
    size = _V0 / _SIGMA * exponential(-b / _SIGMA) * (first + second) / (4.0 * b)
    first = max(first, 1e-9)
    second = max(second, 1e-9)
    return size * (x / first + (x - sx) / second), size * (y / first + (y - sy) / second)


@inlined
def pushed_2009(x, y, vx, vy):
    """Returns the acceleration of Moussaid's interaction: (x, y) the way to the other, (vx, vy) own minus its velocity.

    The exponent n' belongs to the deceleration along the interaction, n to the evasion across it.
    """
    return pushed_by(_A, x, y, vx, vy)


@inlined
def pushed_by(most, x, y, vx, vy):
    """Returns the acceleration of that interaction, `most` m/s^2 in the limit of nearness."""
    distance = max(math.sqrt(x * x + y * y), 1e-9)
    ex = x / distance
    ey = y / distance
    dx = _LAMBDA * vx + ex
    dy = _LAMBDA * vy + ey
    size = max(math.sqrt(dx * dx + dy * dy), 1e-9)
    tx = dx / size
    ty = dy / size
    across = tx * ey - ty * ex
    angle = bearing(across, tx * ex + ty * ey)
    b = _GAMMA * size
    slow = most * exponential(-distance / b - (_N_PRIME * b * angle) * (_N_PRIME * b * angle))
    aside = most * exponential(-distance / b - (_N * b * angle) * (_N * b * angle))
    side = 1.0 if across > 0.0 else -1.0 if across < 0.0 else 0.0
    return -slow * tx + side * aside * ty, -slow * ty - side * aside * tx


@inlined
def pushed_2000(overlap, nx, ny, vx, vy):
    """Returns the force (N) of contact and nearness: (nx, ny) away from the other, (vx, vy) own minus its velocity.

    Args:
        overlap: m, of the bodies; below 0 where they are apart.
    """
    size = _A_HFV * exponential(overlap / _B_HFV)
    x = size * nx
    y = size * ny
    if overlap > 0.0:
        x += _BODY * overlap * nx
        y += _BODY * overlap * ny
        slip = _FRICTION * overlap * (vx * ny - vy * nx)
        x -= slip * ny
        y += slip * nx
    return x, y


@compiled
def together(walk, walker, people, w, scenario, k, ex, ey):
    """Returns the acceleration (m/s^2) of a person of a group: gaze, cohesion and repulsion of Moussaid et al. 2010.

    The head is turned until the centre of the others is within a right angle of (ex, ey), where one wants to go, and
    the more it must turn, the slower one walks; who is farther than (N - 1) / 2 m from the centre of all N is drawn
    to it; members nearer than 0.8 m are pushed apart.
    """
    total = 0
    x = 0.0
    y = 0.0
    ax = 0.0
    ay = 0.0
    for j in range(people.walkers.shape[1]):
        other = people.walkers[w, j]
        if j == k or other.present == 0 or people.walks[scenario, j].group != walk.group:
            continue
        total += 1
        x += other.x
        y += other.y
        dx = walker.x - other.x
        dy = walker.y - other.y
        distance = math.sqrt(dx * dx + dy * dy)
        if 1e-9 < distance < _CLOSE:
            ax += _REPULSION * dx / distance
            ay += _REPULSION * dy / distance
    if total == 0:
        return 0.0, 0.0
    dx = x / total - walker.x
    dy = y / total - walker.y
    turn = abs(bearing(ex * dy - ey * dx, ex * dx + ey * dy)) - 0.5 * math.pi
    if turn > 0.0:
        ax -= _GAZE * turn * walker.vx
        ay -= _GAZE * turn * walker.vy
    dx = (x + walker.x) / (total + 1) - walker.x
    dy = (y + walker.y) / (total + 1) - walker.y
    distance = math.sqrt(dx * dx + dy * dy)
    if distance > max(0.5 * total, 1e-9):
        ax += _COHESION * dx / distance
        ay += _COHESION * dy / distance
    return ax, ay


@inlined
def noticed(bodies, now, w, robots, i, walker):
    """Returns the nearest robot that person i sees ahead, or -1."""
    here = bodies.places[now, w, i]
    for a in range(bodies.counts[w, i]):
        j = bodies.near[w, i, a]
        if j < robots and bodies.places[now, w, j].present == 1:
            dx = bodies.places[now, w, j].x - walker.x
            dy = bodies.places[now, w, j].y - walker.y
            distance = math.sqrt(dx * dx + dy * dy)
            if distance <= _NOTICED and here.cos * dx + here.sin * dy >= _COS_NOTICED * distance:
                return j
    return -1


@compiled
def reaction_to(walk, walker, place, ux, uy, most):
    """Returns the wanted velocity (m/s), the greatest speed and a further acceleration (m/s^2) of who sees a robot."""
    dx = place.x - walker.x
    dy = place.y - walker.y
    distance = max(math.sqrt(dx * dx + dy * dy), 1e-9)
    if walk.reaction == SURPRISED:
        return 0.0, 0.0, most, 0.0, 0.0
    if walk.reaction == SCARED:
        slower = min(1.0, _SCARED_SPEED / max(walk.speed, 1e-9))
        push = _SCARED_FORCE / max(distance - walk.radius, 0.1) / distance
        return slower * ux, slower * uy, min(most, _SCARED_SPEED), -push * dx, -push * dy
    if walk.reaction == CURIOUS:
        if distance <= _CURIOUS_GAP:
            return 0.0, 0.0, most, 0.0, 0.0
        speed = _CURIOUS_SPEED * distance / _CURIOUS_SIGHT
        return speed * dx / distance, speed * dy / distance, speed, 0.0, 0.0
    dx += _BLOCK_AHEAD * place.cos
    dy += _BLOCK_AHEAD * place.sin
    distance = max(math.sqrt(dx * dx + dy * dy), 1e-9)
    speed = min(_BLOCK_SPEED, distance)  # slower within a second of its place
    return speed * dx / distance, speed * dy / distance, _BLOCK_SPEED, 0.0, 0.0


@compiled
def social_velocity(walk, walker, bodies, people, now, w, scenario, robots, k, around, dt):
    """Sets the next velocity of a person by a social force, with group and reaction, after dt."""
    obstacles, field, count = around
    law = walk.law
    ux, uy = wanted(walk, walker)
    i = robots + k
    relaxation, repulsion, wall, wall_range, factor = numbers_of(law)
    most = factor * walk.speed
    px, py = 0.0, 0.0
    if walk.reaction > IMPASSIVE:
        j = noticed(bodies, now, w, robots, i, walker)
        if j >= 0:
            ux, uy, most, px, py = reaction_to(walk, walker, bodies.places[now, w, j], ux, uy, most)
    ax = (ux - walker.vx) / relaxation + px
    ay = (uy - walker.vy) / relaxation + py
    size = max(math.sqrt(ux * ux + uy * uy), 1e-12)
    ex = ux / size
    ey = uy / size
    if walk.group > 0:
        px, py = together(walk, walker, people, w, scenario, k, ex, ey)
        ax += px
        ay += py
    for a in range(bodies.counts[w, i]):
        j = bodies.near[w, i, a]
        if j < robots and bodies.places[now, w, j].present == 0:
            continue  # it has just left
        x, y, vx, vy = other_body(bodies, people, now, w, robots, j)
        x -= walker.x
        y -= walker.y
        reach = bodies.hulls[w, j].reach
        if law == HELBING_MOLNAR:
            fx, fy = pushed_1995(-x, -y, vx, vy)
            seen = -(ex * fx + ey * fy) >= _COS_SIGHT * math.sqrt(fx * fx + fy * fy)
            weight = 1.0 if seen else _BEHIND
            ax += weight * fx
            ay += weight * fy
        elif law == HELBING_FARKAS_VICSEK:
            distance = max(math.sqrt(x * x + y * y), 1e-9)
            overlap = walk.radius + reach - distance
            fx, fy = pushed_2000(overlap, -x / distance, -y / distance, walker.vx - vx, walker.vy - vy)
            ax += fx / _MASS
            ay += fy / _MASS
        elif j < robots and walk.reaction == IMPASSIVE:
            distance = max(math.sqrt(x * x + y * y), 1e-9)
            gap = max(distance - reach - walk.radius, 0.0)
            size = wall * exponential(-gap / wall_range) / distance
            ax -= size * x
            ay -= size * y
        else:
            fx, fy = pushed_by(repulsion, x, y, walker.vx - vx, walker.vy - vy)
            ax += fx
            ay += fy
    for o in range(count):
        distance, nx, ny = nearest_surface(obstacles[field, o], walker.x, walker.y)
        if distance > _FARTHEST_WALL:
            continue
        if law == HELBING_FARKAS_VICSEK:
            fx, fy = pushed_2000(walk.radius - distance, nx, ny, walker.vx, walker.vy)
            ax += fx / _MASS
            ay += fy / _MASS
        else:
            gap = distance if law == HELBING_MOLNAR else max(distance - walk.radius, 0.0)
            size = wall * exponential(-gap / wall_range)
            ax += size * nx
            ay += size * ny
    vx = walker.vx + dt * ax
    vy = walker.vy + dt * ay
    speed = math.sqrt(vx * vx + vy * vy)
    if speed > most:
        vx *= most / speed
        vy *= most / speed
    walker.next_vx = vx
    walker.next_vy = vy


@compiled
def track_place(track, first, rows, at):
    """Returns (x, y, vx, vy) `at` rows into a recorded track, by cubic Hermite interpolation; rates are a row's."""
    row = int(min(max(0.0, math.floor(at)), rows - 2.0))
    s = at - row
    a = first + row
    h = (1.0 + 2.0 * s) * (1.0 - s) * (1.0 - s)
    g = s * (1.0 - s) * (1.0 - s)
    h1 = s * s * (3.0 - 2.0 * s)
    g1 = s * s * (s - 1.0)
    dh = 6.0 * s * (s - 1.0)
    dg = (1.0 - s) * (1.0 - 3.0 * s)
    dg1 = s * (3.0 * s - 2.0)
    x = h * track[a, 0] + g * track[a, 2] + h1 * track[a + 1, 0] + g1 * track[a + 1, 2]
    y = h * track[a, 1] + g * track[a, 3] + h1 * track[a + 1, 1] + g1 * track[a + 1, 3]
    vx = dh * (track[a, 0] - track[a + 1, 0]) + dg * track[a, 2] + dg1 * track[a + 1, 2]
    vy = dh * (track[a, 1] - track[a + 1, 1]) + dg * track[a, 3] + dg1 * track[a + 1, 3]
    return x, y, vx, vy


@inlined
def on_track(walk, walker, tracks, time):
    """Puts a recorded person where the track is at a time (s) since the world began; away before and after it."""
    at = (time - walk.begins) / walk.frame_time
    # rounding of the last row's time lets nobody vanish
    walker.present = 1 if -1e-9 <= at <= walk.rows - 1.0 + 1e-9 else 0
    if walker.present == 1:
        x, y, vx, vy = track_place(tracks, walk.first, walk.rows, at)
        walker.x = x
        walker.y = y
        walker.vx = vx / walk.frame_time
        walker.vy = vy / walk.frame_time


@compiled
def place_people(people, scenario, w):
    """Puts the people of a world where their walks begin."""
    for k in range(people.walkers.shape[1]):
        walk = people.walks[scenario, k]
        walker = people.walkers[w, k]
        walker.x = walk.x
        walker.y = walk.y
        walker.vx = 0.0
        walker.vy = 0.0
        walker.goal_x = walk.goal_x
        walker.goal_y = walk.goal_y
        walker.laps = 0
        walker.arrived = -1.0
        walker.present = 1 if walk.radius > 0.0 else 0
        if walk.law == CONSTANT:
            walker.vx, walker.vy = wanted(walk, walker)
        if walk.law == REPLAY and walk.radius > 0.0:
            on_track(walk, walker, people.tracks, 0.0)


@compiled
def decide_people(bodies, people, now, w, scenario, robots, around, scratch, dt):
    """Sets the next velocity of every person of a world by its law; reads places and velocities, writes neither."""
    for k in range(people.walkers.shape[1]):
        walk = people.walks[scenario, k]
        walker = people.walkers[w, k]
        if walker.present == 0 or walk.law == REPLAY:
            continue
        if walk.law == ORCA:
            orca_velocity(walk, walker, bodies, people, now, w, robots, k, around, scratch, dt)
        elif walk.law == STANDING:
            walker.next_vx = 0.0
            walker.next_vy = 0.0
        elif walk.law == CONSTANT:
            walker.next_vx, walker.next_vy = walker.vx, walker.vy
        else:
            social_velocity(walk, walker, bodies, people, now, w, scenario, robots, k, around, dt)


@compiled
def move_people(people, w, scenario, time, dt):
    """Moves every person of a world by dt; time: s since the world began, behind the move."""
    for k in range(people.walkers.shape[1]):
        walk = people.walks[scenario, k]
        walker = people.walkers[w, k]
        if walk.law == REPLAY:
            if walk.radius > 0.0:
                on_track(walk, walker, people.tracks, time)
            continue
        if walker.present == 0:
            continue
        walker.vx = walker.next_vx
        walker.vy = walker.next_vy
        walker.x += dt * walker.vx
        walker.y += dt * walker.vy


@compiled
def walk_people(bodies, people, now, w, scenario, robots, around, scratch, time, dt):
    """Moves the people of a world by one period: in steps of a millisecond where they push each other."""
    stiff = False
    for k in range(people.walkers.shape[1]):
        stiff = stiff or people.walks[scenario, k].law == HELBING_FARKAS_VICSEK
    parts = math.ceil(dt / _SUBSTEP - 1e-9) if stiff else 1
    for part in range(parts):
        decide_people(bodies, people, now, w, scenario, robots, around, scratch, dt / parts)
        move_people(people, w, scenario, time + dt * (part + 1) / parts, dt / parts)


@compiled
def note_arrivals(bodies, people, to, w, scenario, robots, time):
    """Lets those who are at their goals stay, turn back, go on, leave, or begin again where their start is clear."""
    for k in range(people.walkers.shape[1]):
        walk = people.walks[scenario, k]
        walker = people.walkers[w, k]
        if walk.law == REPLAY or walk.radius == 0.0:
            continue
        if walker.present == 1:
            dx = walker.goal_x - walker.x
            dy = walker.goal_y - walker.y
            if dx * dx + dy * dy > walk.radius * walk.radius:
                continue
            if walker.arrived < 0.0:
                walker.arrived = time
            if walk.then == TURNS_BACK:
                back = walker.laps % 2 == 1
                walker.goal_x = walk.goal_x if back else walk.x
                walker.goal_y = walk.goal_y if back else walk.y
                walker.laps += 1
            elif walk.then == GOES_ON:
                row = walk.first + walker.laps % walk.rows
                walker.goal_x = people.tracks[row, 0]
                walker.goal_y = people.tracks[row, 1]
                walker.laps += 1
            elif walk.then != STAYS:
                walker.present = 0
                walker.laps += 1
                bodies.places[to, w, robots + k].present = 0
        elif walk.then == COMES_AGAIN:
            clear = True
            for j in range(bodies.places.shape[2]):
                place = bodies.places[to, w, j]
                if place.present == 1 and j != robots + k:
                    gap = walk.radius + bodies.hulls[w, j].reach + 0.3
                    clear = clear and (place.x - walk.x) ** 2 + (place.y - walk.y) ** 2 > gap * gap
            if clear:
                walker.present = 1
                walker.x = walk.x
                walker.y = walk.y
                walker.vx = 0.0
                walker.vy = 0.0
                bodies.places[to, w, robots + k].x = walk.x
                bodies.places[to, w, robots + k].y = walk.y
                bodies.places[to, w, robots + k].present = 1


@compiled
def note_people(bodies, people, now, to, w, robots, dt):
    """Writes the places of a world's people into the next snapshot."""
    for k in range(people.walkers.shape[1]):
        walker = people.walkers[w, k]
        before = bodies.places[now, w, robots + k]
        place = bodies.places[to, w, robots + k]
        place.x = walker.x
        place.y = walker.y
        place.vx = walker.vx
        place.vy = walker.vy
        place.present = walker.present
        speed = math.sqrt(walker.vx * walker.vx + walker.vy * walker.vy)
        place.cos = walker.vx / speed if speed > STANDS_BELOW else before.cos
        place.sin = walker.vy / speed if speed > STANDS_BELOW else before.sin
        place.stood = 0.0 if speed > STANDS_BELOW else before.stood + dt


@compiled
def note_hulls(bodies, people, w, scenario, robots):
    """Writes the hulls of a world's people."""
    for k in range(people.walkers.shape[1]):
        walk = people.walks[scenario, k]
        hull = bodies.hulls[w, robots + k]
        hull.half_length = 0.0
        hull.half_width = 0.0
        hull.ahead = 0.0
        hull.radius = walk.radius
        hull.reach = walk.radius
        hull.kind = PERSON
        hull.blind = walk.blind


# ---- people alone


def check_finite(walks: NDArray[np.void]) -> None:
    """Raises ValueError, naming the person and the field, unless all numbers of WALK records (q,) are finite."""
    for name in WALK.names or ():
        bad = np.flatnonzero(~np.isfinite(walks[name].astype(np.float64)))
        if len(bad):
            raise ValueError(f"walks[{bad[0]}].{name} is {walks[name][bad[0]]}; it must be finite")


def stroll(
    walks: NDArray[np.void],
    steps: int,
    dt: float,
    obstacles: NDArray[np.void] | None = None,
    tracks: NDArray[np.float64] | None = None,
    reach: float = 5.0,
    cells_from: int = 49,
    velocities: NDArray[np.float64] | None = None,
    robots: tuple[int, ...] = (),
) -> NDArray[np.float64]:
    """Returns how people walk without robots: (steps + 1, q, 5), x, y (m), vx, vy (m/s), and whether they are there.

    Args:
        walks: (q,) WALK records.
        dt: s, of a step.
        obstacles: (m,) OBSTACLE records.
        tracks: (rows, 4) of the replayed people.
        reach: m, within which others are neighbours.
        cells_from: bodies from which on they are found by cells, with the same bits.
        velocities: (q, 2) m/s at the start; None: all rest.
        robots: bodies that count as robots, which people without eyes for robots ignore.

    Raises:
        ValueError: if a number of the walks, or a velocity, is not finite.
    """
    check_finite(walks)
    q = len(walks)
    field = np.zeros((1, 0), OBSTACLE) if obstacles is None else np.ascontiguousarray(obstacles)[None].copy()
    people = People(walks[None].copy(), np.zeros((0, 4)) if tracks is None else tracks, np.zeros((1, q), WALKER))
    bodies = Bodies(
        np.zeros((2, 1, q), PLACE),
        np.zeros((1, q), HULL),
        np.zeros((1, q, NEAREST), np.int64),
        np.zeros((1, q), np.int64),
        np.zeros((1, 2), np.int64),
    )
    out = np.empty((steps + 1, q, 5))
    kinds = np.full(q, PERSON)
    kinds[list(robots)] = ROBOT
    first = np.zeros((q, 2)) if velocities is None else np.asarray(velocities, np.float64)
    bad = np.argwhere(~np.isfinite(first))
    if len(bad):
        k, axis = bad[0].tolist()
        raise ValueError(f"velocities[{k}, {axis}] is {first[k, axis]}; it must be finite")
    no_map = np.zeros(1, np.dtype(FRAME, align=True))
    _stroll(bodies, people, field, no_map, kinds, first, reach, cells_from, float(dt), out)
    return out


@allocating
def _stroll(bodies, people, obstacles, frames, kinds, velocities, reach, cells_from, dt, out):
    """Runs `stroll`."""
    q = people.walkers.shape[1]
    cells = cells_for(q, obstacles)
    scratch = scratch_for(obstacles.shape[1])
    nothing = Sight(obstacles, 0, 0, frames, 0, np.empty(0, np.uint8), 0)
    place_people(people, 0, 0)
    note_hulls(bodies, people, 0, 0, 0)
    for k in range(q):
        bodies.hulls[0, k].kind = kinds[k]
        if people.walks[0, k].law != REPLAY and people.walks[0, k].law != CONSTANT:
            people.walkers[0, k].vx = velocities[k, 0]
            people.walkers[0, k].vy = velocities[k, 1]
    note_people(bodies, people, 0, 0, 0, 0, dt)
    around = (obstacles, 0, obstacles.shape[1])
    for step in range(out.shape[0]):
        for k in range(q):
            walker = people.walkers[0, k]
            out[step, k, 0] = walker.x
            out[step, k, 1] = walker.y
            out[step, k, 2] = walker.vx
            out[step, k, 3] = walker.vy
            out[step, k, 4] = walker.present
        note_neighbours(bodies, 0, 0, reach, nothing, cells, lay_cells(bodies.places, 0, 0, cells, cells_from))
        walk_people(bodies, people, 0, 0, 0, 0, around, scratch, step * dt, dt)
        note_people(bodies, people, 0, 0, 0, 0, dt)
        note_arrivals(bodies, people, 0, 0, 0, 0, (step + 1) * dt)
