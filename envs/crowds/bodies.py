"""The bodies of a world, robots and people: positions, neighbours, contacts and lines of sight.

A world keeps two snapshots of its places, that of the period before and that of this one. What no step writes, the
hulls, is kept once. Neighbours are sorted by (distance^2, x, y): sums and linear programs meet them in an order that no
numbering of the bodies decides, so that renumbered bodies have renumbered results, bit for bit.
"""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from wayfield.envs.robots import sensing
from wayfield.envs.world.geometry import ray_to_box, ray_to_circle
from wayfield.envs.world.grids import grid_place, grid_ray
from wayfield.system.compiled import allocating, compiled, inlined

NEAREST = 10  # neighbours that are kept of each body
CELLS_FROM = 49  # bodies of a world from which on they are found by cells
_A_CELL = 2.0  # bodies, on average
_MOST_ACROSS = 256  # cells along a side of a world

ROBOT, PERSON = 1, 2  # kinds
STANDS_BELOW = 0.01  # m/s

# what a step writes of a body
PLACE = np.dtype(
    [
        ("x", np.float64),  # m
        ("y", np.float64),
        ("cos", np.float64),  # of the heading
        ("sin", np.float64),
        ("vx", np.float64),  # m/s, world frame: the mean velocity over ground of the last period
        ("vy", np.float64),
        ("stood", np.float64),  # s, for which it has not moved
        ("present", np.int64),  # 0: it has left the world, or was never there
    ],
    align=True,
)

# what it does not
HULL = np.dtype(
    [
        ("half_length", np.float64),  # m, along the heading; 0: a disc
        ("half_width", np.float64),  # m
        ("ahead", np.float64),  # m, of its middle
        ("radius", np.float64),  # m, of a disc; 0 of a rectangle, as of an OBSTACLE
        ("reach", np.float64),  # m, of the disc around it
        ("kind", np.int64),  # ROBOT or PERSON
        ("blind", np.int64),  # 1: robots are none of its neighbours
    ],
    align=True,
)


class Bodies(NamedTuple):
    """The bodies of all worlds, m each: robots first, then people."""

    places: NDArray[np.void]  # (2, worlds, m) PLACE records
    hulls: NDArray[np.void]  # (worlds, m) HULL records
    near: NDArray[np.int64]  # (worlds, m, NEAREST) neighbours, the nearest first
    counts: NDArray[np.int64]  # (worlds, m) how many of them there are
    clocks: NDArray[np.int64]  # (worlds, 2) which of the places are those of now; steps since the world began


class Cells(NamedTuple):
    """Room for one thread to look for neighbours in."""

    starts: NDArray[np.int64]  # (cells + 1,) the first body of each cell in `order`
    order: NDArray[np.int64]  # (m,) bodies, cell by cell
    cell_of: NDArray[np.int64]  # (m,)
    xs: NDArray[np.float64]  # (m,) in that order
    ys: NDArray[np.float64]
    nearest: NDArray[np.int64]  # (NEAREST,) neighbours of one body
    squares: NDArray[np.float64]  # (NEAREST,) their squared distances, m^2
    met: NDArray[np.void]  # (1, m) OBSTACLE records: bodies as the beams of others meet them


class Frame(NamedTuple):
    """How a world is divided into cells; nx = 0: it is not."""

    x: float  # m, of the lower left corner
    y: float
    size: float  # m
    nx: int
    ny: int


@allocating
def cells_for(count, obstacles):
    """Returns room for worlds of `count` bodies among obstacles (b, m)."""
    size = 2 * count + 16
    return Cells(
        np.empty(size, np.int64),
        np.empty(count, np.int64),
        np.empty(count, np.int64),
        np.empty(count),
        np.empty(count),
        np.empty(NEAREST, np.int64),
        np.empty(NEAREST),
        np.empty((1, count), obstacles.dtype),
    )


@inlined
def comes_before(squared, x, y, other_squared, other_x, other_y):
    """Returns whether a neighbour sorts before another: by distance, and of equal ones by place."""
    if squared != other_squared:
        return squared < other_squared
    return x < other_x or (x == other_x and y < other_y)


@inlined
def keep_nearest(places, now, w, cells, count, squared, j):
    """Puts body j where it belongs among the `count` nearest so far, if it does; returns how many there are then."""
    x = places[now, w, j].x
    y = places[now, w, j].y
    nearest = cells.nearest
    squares = cells.squares
    if count == NEAREST:
        last = places[now, w, nearest[NEAREST - 1]]
        if not comes_before(squared, x, y, squares[NEAREST - 1], last.x, last.y):
            return count
        k = NEAREST - 1
    else:
        k = count
        count += 1
    while k > 0:
        other = places[now, w, nearest[k - 1]]
        if not comes_before(squared, x, y, squares[k - 1], other.x, other.y):
            break
        squares[k] = squares[k - 1]
        nearest[k] = nearest[k - 1]
        k -= 1
    squares[k] = squared
    nearest[k] = j
    return count


@compiled
def lay_cells(places, now, w, cells, from_count):
    """Sorts the bodies of a world into cells of about two by counting; returns their Frame.

    With fewer than `from_count` bodies there are no cells.
    """
    m = places.shape[2]
    if m < from_count:
        return Frame(0.0, 0.0, 1.0, 0, 0)
    x0 = np.inf
    y0 = np.inf
    x1 = -np.inf
    y1 = -np.inf
    count = 0
    for j in range(m):
        place = places[now, w, j]
        if place.present == 1:
            x0 = min(x0, place.x)
            x1 = max(x1, place.x)
            y0 = min(y0, place.y)
            y1 = max(y1, place.y)
            count += 1
    if count == 0:
        return Frame(0.0, 0.0, 1.0, 0, 0)
    wide = max(x1 - x0, 1e-3)
    high = max(y1 - y0, 1e-3)
    size = max(math.sqrt(_A_CELL * wide * high / count), max(wide, high) / _MOST_ACROSS)
    nx = int(wide / size) + 1
    ny = int(high / size) + 1
    while nx * ny > cells.starts.shape[0] - 1:
        size *= 1.25
        nx = int(wide / size) + 1
        ny = int(high / size) + 1
    starts = cells.starts
    for c in range(nx * ny + 1):
        starts[c] = 0
    for j in range(m):
        place = places[now, w, j]
        if place.present == 1:
            c = min(int((place.x - x0) / size), nx - 1) + nx * min(int((place.y - y0) / size), ny - 1)
            cells.cell_of[j] = c
            starts[c + 1] += 1
    for c in range(nx * ny):
        starts[c + 1] += starts[c]
    # filled from behind: afterwards starts[c + 1] is where cell c begins
    for j in range(m - 1, -1, -1):
        place = places[now, w, j]
        if place.present == 1:
            c = cells.cell_of[j]
            starts[c + 1] -= 1
            k = starts[c + 1]
            cells.order[k] = j
            cells.xs[k] = place.x
            cells.ys[k] = place.y
    for c in range(nx * ny):
        starts[c] = starts[c + 1]
    starts[nx * ny] = count
    return Frame(x0, y0, size, nx, ny)


@inlined
def ring_gap(frame, x, y, ring):
    """Returns a distance (m) that every body in a ring of cells, and beyond, has from a body at (x, y) at least."""
    cx = min(int((x - frame.x) / frame.size), frame.nx - 1)
    cy = min(int((y - frame.y) / frame.size), frame.ny - 1)
    along = x - frame.x - cx * frame.size
    across = y - frame.y - cy * frame.size
    edge = min(along, frame.size - along, across, frame.size - across)
    reach = (ring - 1) * frame.size + edge
    return reach - 1e-9 * (1.0 + abs(reach))


@compiled
def find_nearest(bodies, now, w, i, reach, seen, cells, frame):
    """Finds the NEAREST bodies within `reach` (m) of body i, sorted; returns how many there are.

    Args:
        seen: `Sight`; of a body with walls around only what these do not hide counts.
        frame: of `lay_cells`; without cells all bodies are looked at. The bits are the same.
    """
    places = bodies.places
    m = places.shape[2]
    here = places[now, w, i]
    x = here.x
    y = here.y
    blind = bodies.hulls[w, i].blind
    limit = reach * reach
    count = 0
    if frame.nx == 0:
        for j in range(m):
            dx = places[now, w, j].x - x
            dy = places[now, w, j].y - y
            squared = dx * dx + dy * dy
            if squared < limit and (count < NEAREST or squared <= cells.squares[NEAREST - 1]):
                if j == i or places[now, w, j].present == 0 or (blind == 1 and bodies.hulls[w, j].kind == ROBOT):
                    continue
                if in_sight(seen, x, y, dx, dy, squared):
                    count = keep_nearest(places, now, w, cells, count, squared, j)
        return count
    cx = min(int((x - frame.x) / frame.size), frame.nx - 1)
    cy = min(int((y - frame.y) / frame.size), frame.ny - 1)
    for ring in range(max(frame.nx, frame.ny) + 1):
        gap = ring_gap(frame, x, y, ring)
        if (
            ring > 0
            and gap > 0.0
            and (gap * gap > limit or (count == NEAREST and gap * gap > cells.squares[NEAREST - 1]))
        ):
            break
        for gy in range(max(cy - ring, 0), min(cy + ring, frame.ny - 1) + 1):
            stride = 1 if gy == cy - ring or gy == cy + ring or ring == 0 else 2 * ring
            for gx in range(cx - ring, cx + ring + 1, stride):
                if gx < 0 or gx >= frame.nx:
                    continue
                c = gx + frame.nx * gy
                for k in range(cells.starts[c], cells.starts[c + 1]):
                    dx = cells.xs[k] - x
                    dy = cells.ys[k] - y
                    squared = dx * dx + dy * dy
                    if squared < limit and (count < NEAREST or squared <= cells.squares[NEAREST - 1]):
                        j = cells.order[k]
                        if j == i or (blind == 1 and bodies.hulls[w, j].kind == ROBOT):
                            continue
                        if in_sight(seen, x, y, dx, dy, squared):
                            count = keep_nearest(places, now, w, cells, count, squared, j)
    return count


@compiled
def note_neighbours(bodies, now, w, reach, nothing, cells, frame):
    """Finds the neighbours of all bodies of a world; nothing: a Sight that nothing hides."""
    for i in range(bodies.places.shape[2]):
        bodies.counts[w, i] = 0
        if bodies.places[now, w, i].present == 1:
            count = find_nearest(bodies, now, w, i, reach, nothing, cells, frame)
            for k in range(count):
                bodies.near[w, i, k] = cells.nearest[k]
            bodies.counts[w, i] = count


# ---- lines of sight


class Sight(NamedTuple):
    """What may stand between two bodies."""

    obstacles: NDArray[np.void]  # (b, m) OBSTACLE records
    field: int  # the row that is meant
    standing: int  # of its obstacles; 0: nothing blocks sight
    frames: NDArray[np.void]  # (scenarios,) of maps
    scenario: int
    words: NDArray[np.uint8]  # the cells of maps
    maps: int  # 1: they hide


@compiled
def in_sight(seen, x, y, dx, dy, squared):
    """Returns whether the line from (x, y) over (dx, dy), m, meets neither obstacle nor map."""
    if seen.standing == 0 and seen.maps == 0:
        return True
    distance = math.sqrt(squared)
    if distance == 0.0:
        return True
    ux = dx / distance
    uy = dy / distance
    clear = True
    for k in range(seen.standing):
        o = seen.obstacles[seen.field, k]
        if o.half_length == 0.0 and o.half_width == 0.0:
            clear = clear and not ray_to_circle(o.x - x, o.y - y, o.radius, ux, uy) < distance
        else:
            clear = clear and not (
                ray_to_box(o.x - x, o.y - y, o.cos, o.sin, o.half_length, o.half_width, ux, uy) < distance
            )
    if clear and seen.maps == 1:
        frame = seen.frames[seen.scenario]
        if frame.grid_cell > 0.0:
            u, v = grid_place(frame, x, y)
            du = frame.grid_cos * ux + frame.grid_sin * uy
            dv = frame.grid_cos * uy - frame.grid_sin * ux
            reach = distance / frame.grid_cell
            clear = not grid_ray(frame, seen.words, u, v, du, dv, reach) < reach
    return clear


# ---- contacts


@inlined
def chords_apart(a, to_a, b, to_b):
    """Returns the least distance (m) of two centres that go straight from their places before to those after.

    It is the same number whichever of the two comes first: their differences change sign, and nothing else.
    """
    px = b.x - a.x
    py = b.y - a.y
    dx = (to_b.x - b.x) - (to_a.x - a.x)
    dy = (to_b.y - b.y) - (to_a.y - a.y)
    squared = dx * dx + dy * dy
    share = 0.0
    if squared > 0.0:
        share = min(max(-(px * dx + py * dy) / squared, 0.0), 1.0)
    x = px + share * dx
    y = py + share * dy
    return math.sqrt(x * x + y * y)


# ---- what a scan meets


@compiled
def scan_bodies(lidar, bodies, w, i, cells, frame, pose, ranges, row, column):
    """Shortens the beams of body i's scan to the other bodies of its world.

    As an OBSTACLE of that shape would: the bits are the same. By cells it goes outwards in rings as far as beams reach.
    """
    places = bodies.places
    now = bodies.clocks[w, 0]
    x, y, _ = pose
    far = lidar.max_range
    count = 0
    if frame.nx == 0:
        for j in range(places.shape[2]):
            count = note_body(bodies, now, w, i, j, x, y, far, cells, count)
        sensing.shorten_to(lidar, cells.met, count, pose, ranges, row, column)
        return
    cx = min(int((x - frame.x) / frame.size), frame.nx - 1)
    cy = min(int((y - frame.y) / frame.size), frame.ny - 1)
    for ring in range(max(frame.nx, frame.ny) + 1):
        # hulls stand out of their cells by half a metre at most
        if ring > 1 and ring_gap(frame, x, y, ring) - MOST_REACH > far:
            break
        if ring > 1 and count > 0:
            sensing.shorten_to(lidar, cells.met, count, pose, ranges, row, column)
            count = 0
            far = 0.0
            for k in range(lidar.beams.shape[1]):
                far = max(far, ranges[row, column + k])
        for gy in range(max(cy - ring, 0), min(cy + ring, frame.ny - 1) + 1):
            stride = 1 if gy == cy - ring or gy == cy + ring or ring == 0 else 2 * ring
            for gx in range(cx - ring, cx + ring + 1, stride):
                if gx < 0 or gx >= frame.nx:
                    continue
                c = gx + frame.nx * gy
                for k in range(cells.starts[c], cells.starts[c + 1]):
                    count = note_body(bodies, now, w, i, cells.order[k], x, y, far, cells, count)
    sensing.shorten_to(lidar, cells.met, count, pose, ranges, row, column)


MOST_REACH = 0.5  # m, of a hull


@inlined
def note_body(bodies, now, w, i, j, x, y, far, cells, count):
    """Notes body j as an obstacle to the beams of body i, unless it is out of reach; returns how many there are."""
    place = bodies.places[now, w, j]
    hull = bodies.hulls[w, j]
    dx = place.x - x
    dy = place.y - y
    reach = far + hull.reach
    if j == i or place.present == 0 or dx * dx + dy * dy > 1.000001 * reach * reach:
        return count
    shape = cells.met[0, count]
    shape.x = place.x + hull.ahead * place.cos
    shape.y = place.y + hull.ahead * place.sin
    disc = hull.half_length == 0.0
    # a disc has no heading, as a circle that stands
    shape.cos = 1.0 if disc else place.cos
    shape.sin = 0.0 if disc else place.sin
    shape.half_length = hull.half_length
    shape.half_width = hull.half_width
    shape.radius = hull.radius
    shape.mass = 0.0
    return count + 1
