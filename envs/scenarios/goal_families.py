"""The families of random goal scenarios: from a seed, obstacles, how they move, a start and a goal.

Every scenario is decided by its seed alone. The goal is reached within 0.2 m at any heading. A seed may give a field
without a way; the frozen splits hold those for which a way was found, for a disc of 0.3 m: the largest robot's hull.
"""

import itertools
import math
from collections.abc import Callable, Iterable, Mapping
from typing import Any

import numpy as np

from wayfield.envs.scenarios import ways
from wayfield.envs.scenarios.draws import Draw, Frame, rounded
from wayfield.envs.scenarios.goal_presets import GOAL_SCENARIOS
from wayfield.envs.scenarios.obstacles import box, circle, moving_circle, obstacle_field, wall
from wayfield.envs.scenarios.scenario import GoalScenario
from wayfield.envs.tasks.specs import Family, Repertoire
from wayfield.envs.world.geometry import clearance, clearance_to
from wayfield.system.elementary import bearing, sin_cos

LARGEST_HULL = 0.3  # m, of the robot that every scenario has a way for
ROOM = 0.1  # m, kept around the hull at start and goal
PATROL_GAP = 0.3  # m, that a patrol keeps from the hull at start and goal
HALF_SIDE = 5.0  # m, of the walled square
_LONGEST_WAY = 20.0  # m; 60 s at 0.6 m/s are 36 m
_LEAST_SPARE = 0.05  # m, of a goal beside an obstacle

_CLEAR = LARGEST_HULL + ROOM
_REACH = HALF_SIDE - _CLEAR  # m, of starts and goals in the square

Point = tuple[float, float]
Lane = tuple[Point, Point, float]  # the ends of a disc's patrol and its radius, m
# start, goal and obstacles; None: drawn in vain, draw again
Field = tuple[Point, Point, Iterable[np.void]]


def _family(name: str, about: str, field: Callable[[Draw], "Field | None"], **known: Any) -> Family:
    """Returns the family of a random field. The robot starts in any direction, or looks at the goal."""

    def scenario(seed: int) -> GoalScenario:
        draw = Draw(name, seed)
        start, goal, obstacles = draw.until_one(lambda: field(draw))
        ahead = rounded(bearing(goal[1] - start[1], goal[0] - start[0]))
        return GoalScenario(
            f"{name}_{seed}",
            goal=(*goal, ahead),
            start=(*start, ahead if draw.sign() > 0.0 else draw.heading()),
            obstacles=obstacle_field(*obstacles),
            position_tolerance=0.2,
            heading_tolerance=math.pi,
            family=name,
        )

    return Family(name, about, scenario, **known)


# ---- what the fields are built from


def somewhere(draw: Draw, reach: float = 2.0) -> Frame:
    """Returns a frame within `reach` (m) of the origin in x and y, turned and mirrored as drawn."""
    return Frame(draw.number(-reach, reach), draw.number(-reach, reach), draw.heading(), draw.sign() < 0.0)


def _walls(frame: Frame, *corners: Point) -> list[np.void]:
    """Returns the walls from corner to corner, given in a frame."""
    points = [frame.point(*corner) for corner in corners]
    return [wall(*a, *b) for a, b in itertools.pairwise(points)]


def _rectangle(frame: Frame, x0: float, y0: float, x1: float, y1: float) -> list[np.void]:
    return _walls(frame, (x0, y0), (x1, y0), (x1, y1), (x0, y1), (x0, y0))


_BORDER = _rectangle(Frame(), -HALF_SIDE, -HALF_SIDE, HALF_SIDE, HALF_SIDE)


def _distance(a: Point, b: Point) -> float:
    return math.sqrt((a[0] - b[0]) ** 2 + (a[1] - b[1]) ** 2)


def _clear(obstacles: Iterable[np.void], point: Point, needed: float = _CLEAR) -> bool:
    return all(clearance_to(obstacle, *point) >= needed for obstacle in obstacles)


def _apart(places: list[tuple[float, float, float]]) -> bool:
    """Returns whether no two discs, given as x, y and radius (m), overlap."""
    return all(_distance((x, y), (u, v)) >= r + q for i, (x, y, r) in enumerate(places) for u, v, q in places[:i])


def _two_points(draw: Draw, least: float, reach: float = _REACH) -> tuple[Point, Point] | None:
    """Returns a start and a goal in the walled square that are not too near."""
    start = draw.number(-reach, reach), draw.number(-reach, reach)
    goal = draw.number(-reach, reach), draw.number(-reach, reach)
    return (start, goal) if _distance(start, goal) >= least else None


# ---- the fields


def _open_field(draw: Draw) -> Field:
    frame = somewhere(draw)
    return frame.point(0.0, 0.0), frame.point(draw.number(4.0, 9.0), 0.0), ()


def _collinear(offset: float) -> Callable[[Draw], Field]:
    """Returns the fields with one or two obstacles on the straight line, all beside it by the same offset (m).

    Document C's runs, turned and scaled. The places are whole multiples of one small step from the start, so that an
    offset of 0 leaves no offset by rounding.
    """

    def field(draw: Draw) -> Field:
        distance, heading, side = draw.number(4.0, 7.0), draw.heading(), draw.sign()
        sine, cosine = sin_cos(heading)
        step = rounded(0.01 * distance * cosine), rounded(0.01 * distance * sine)
        aside = rounded(-side * offset * sine), rounded(side * offset * cosine)
        count = draw.whole(1, 2)
        size = draw.number(0.12, 0.4) if count == 1 else draw.number(0.12, 0.25)
        places = [draw.whole(35, 65)] if count == 1 else [draw.whole(28, 38), draw.whole(60, 72)]
        turn = draw.whole(0, 1) * 0.25 * math.pi  # a side or an edge towards the robot: symmetric either way
        round_ones = draw.sign() > 0.0
        obstacles = []
        for place in places:
            x, y = rounded(place * step[0] + aside[0]), rounded(place * step[1] + aside[1])
            obstacles.append(
                circle(x, y, size) if round_ones else box(x, y, 2.0 * size, 2.0 * size, rounded(heading + turn))
            )
        return (0.0, 0.0), (rounded(100 * step[0]), rounded(100 * step[1])), obstacles

    return field


def _near_goal(draw: Draw) -> Field | None:
    """A goal with 0.05 to 0.25 m to spare between the hull and an obstacle behind or beside it."""
    frame = somewhere(draw)
    distance = draw.number(4.0, 7.0)
    obstacles, places = [], []
    for _ in range(draw.whole(1, 2)):
        angle = draw.number(-0.65 * math.pi, 0.65 * math.pi)  # 0: straight behind the goal
        sine, cosine = sin_cos(angle)
        size, gap = draw.number(0.15, 0.45), LARGEST_HULL + draw.number(0.06, 0.24)
        x, y = frame.point(distance + (gap + size) * cosine, (gap + size) * sine)
        kind = draw.whole(0, 2)
        if kind == 0:
            obstacles.append(circle(x, y, size))
        elif kind == 1:
            half = draw.number(0.3, 0.8)
            obstacles.append(box(x, y, 2.0 * size, 2.0 * half, frame.turned(angle)))
            size += half
        else:
            half = size = draw.number(0.5, 1.2)
            ends = [(distance + gap * cosine - s * half * sine, gap * sine + s * half * cosine) for s in (-1.0, 1.0)]
            obstacles += _walls(frame, *ends)
        places.append((x, y, size))
    start, goal = frame.point(0.0, 0.0), frame.point(distance, 0.0)
    spare = min(clearance_to(obstacle, *goal) for obstacle in obstacles) - LARGEST_HULL
    fits = 0.05 <= spare <= 0.25 and _clear(obstacles, start) and _apart(places)
    return (start, goal, obstacles) if fits else None


def _clutter(share: float) -> Callable[[Draw], "Field | None"]:
    """Returns the walled squares of which discs of about 0.15 to 0.4 m cover this share."""
    area = share * (2.0 * HALF_SIDE) ** 2

    def field(draw: Draw) -> Field | None:
        ends = _two_points(draw, 6.0)
        if ends is None:
            return None
        radii: list[float] = []
        while math.pi * sum(r * r for r in radii) < area - 0.5 * math.pi * 0.3**2:
            radii.append(draw.number(0.15, 0.4))
        scale = math.sqrt(area / (math.pi * sum(r * r for r in radii)))
        placed: list[tuple[float, float, float]] = []
        for r in sorted((rounded(scale * radius) for radius in radii), reverse=True):
            for _ in range(200):
                x, y = draw.number(r - HALF_SIDE, HALF_SIDE - r), draw.number(r - HALF_SIDE, HALF_SIDE - r)
                free = all((x - u) ** 2 + (y - v) ** 2 >= (r + q) ** 2 for u, v, q in placed)
                if free and all(_distance((x, y), end) >= r + _CLEAR for end in ends):
                    placed.append((x, y, r))
                    break
            else:
                return None
        return *ends, [*_BORDER, *(circle(*each) for each in placed)]

    return field


def _door(width: float) -> Callable[[Draw], "Field | None"]:
    """Returns the walled squares that a wall with one door (m) parts into start's side and goal's."""

    def field(draw: Draw) -> Field | None:
        frame = Frame(heading=draw.whole(0, 1) * 0.5 * math.pi, mirrored=draw.sign() < 0.0)
        at, middle, side = draw.number(-1.5, 1.5), draw.number(-3.8, 3.8), draw.sign()
        ends = [
            frame.point(side * s * draw.number(side * s * at + 0.8, _REACH), draw.number(-_REACH, _REACH))
            for s in (-1.0, 1.0)
        ]
        below, above = rounded(middle - 0.5 * width), rounded(middle + 0.5 * width)
        parting = _walls(frame, (at, -HALF_SIDE), (at, below)) + _walls(frame, (at, above), (at, HALF_SIDE))
        return ends[0], ends[1], [*_BORDER, *parting]

    return field


def _u_trap(depth: float) -> Callable[[Draw], Field]:
    """Returns the fields with a U of walls of this depth (m) across the straight line, open towards the robot."""

    def field(draw: Draw) -> Field:
        frame = somewhere(draw)
        half, mouth = 0.5 * draw.number(1.4, 2.4), draw.number(0.8, 2.0)
        bottom = mouth + depth
        # where hull and straight line both pass the mouth
        inside = half - LARGEST_HULL - 0.1
        start = frame.point(0.0, draw.number(-inside, inside))
        goal = frame.point(bottom + draw.number(0.6, 2.0), draw.number(-inside, inside))
        return start, goal, _walls(frame, (mouth, -half), (bottom, -half), (bottom, half), (mouth, half))

    return field


def _corridor(draw: Draw) -> Field | None:
    """A corridor 0.9 to 1.4 m wide with one bend (L) or two (Z), closed at both ends."""
    frame = somewhere(draw)
    half = 0.5 * draw.number(0.9, 1.4)
    turns = [draw.number(1.2, 1.9) * draw.sign()]
    if draw.sign() > 0.0:
        turns.append(-turns[0] + draw.number(-0.2, 0.2))
    corners, heading = [(0.0, 0.0)], 0.0
    left, right = [(0.0, half)], [(0.0, -half)]
    for turn in [*turns, None]:
        leg = draw.number(2.5, 4.5)
        sine, cosine = sin_cos(heading)
        x, y = corners[-1][0] + leg * cosine, corners[-1][1] + leg * sine
        corners.append((x, y))
        # the corners of both sides lie on the bisector
        turn = turn or 0.0
        _, half_cosine = sin_cos(0.5 * turn)
        sine, cosine = sin_cos(heading + 0.5 * turn)
        wide = half / half_cosine
        left.append((x - wide * sine, y + wide * cosine))
        right.append((x + wide * sine, y - wide * cosine))
        heading += turn
    (x0, y0), (x1, y1) = corners[-2:]
    back = 0.5 / math.sqrt((x1 - x0) ** 2 + (y1 - y0) ** 2)
    goal = frame.point(x1 + back * (x0 - x1), y1 + back * (y0 - y1))
    return frame.point(0.5, 0.0), goal, _walls(frame, *left, *reversed(right), left[0])


def _rooms(draw: Draw) -> Field | None:
    """Two by two or three by two rooms; doors of 0.8 to 1.2 m join them all."""
    columns, size = draw.whole(2, 3), draw.number(2.8, 3.4)
    frame = Frame(heading=draw.heading(), mirrored=draw.sign() < 0.0)
    width, height = rounded(columns * size), rounded(2 * size)
    between = [(i, j, i + 1, j) for i in range(columns - 1) for j in (0, 1)]
    between += [(i, 0, i, 1) for i in range(columns)]
    order = sorted((draw.number(0.0, 1.0), pair) for pair in between)
    joined = {(i, j): (i, j) for i in range(columns) for j in (0, 1)}
    obstacles = _rectangle(frame, 0.0, 0.0, width, height)
    for _, (i, j, k, m) in order:
        new = joined[i, j] != joined[k, m]
        if new:
            old = joined[k, m]
            joined = {room: joined[i, j] if group == old else group for room, group in joined.items()}
        door, gap = draw.number(0.7, size - 0.7), draw.number(0.8, 1.2)
        spans = [(0.0, size)]
        if new or draw.number(0.0, 1.0) < 0.25:
            spans = [(0.0, door - 0.5 * gap), (door + 0.5 * gap, size)]
        for low, high in spans:
            if i != k:  # a wall along y between columns
                obstacles += _walls(frame, (k * size, j * size + low), (k * size, j * size + high))
            else:
                obstacles += _walls(frame, (i * size + low, m * size), (i * size + high, m * size))
    margin = _CLEAR + 0.1
    start = draw.number(margin, size - margin), draw.number(margin, size - margin)
    far = (columns - 1) * size, draw.whole(0, 1) * size
    goal = far[0] + draw.number(margin, size - margin), far[1] + draw.number(margin, size - margin)
    return frame.point(*start), frame.point(*goal), obstacles


# ---- discs that move


def disc_on_patrol(lane: Lane, speed: float, phase: float) -> np.void:
    """Returns a disc that goes to the other end of its lane and back; phase: share of the way there and back."""
    (x0, y0), (x1, y1), radius = lane
    leg_time = rounded(_distance((x0, y0), (x1, y1)) / speed)
    vx, vy = rounded((x1 - x0) / leg_time), rounded((y1 - y0) / leg_time)
    return moving_circle(x0, y0, radius, vx, vy, leg_time, rounded(2.0 * phase * leg_time))


def _from_line(point: Point, a: Point, b: Point) -> float:
    """Returns the distance (m) of a point from the line between a and b."""
    dx, dy = b[0] - a[0], b[1] - a[1]
    u, v = point[0] - a[0], point[1] - a[1]
    t = min(max((u * dx + v * dy) / (dx * dx + dy * dy), 0.0), 1.0)
    return _distance((u, v), (t * dx, t * dy))


def keeps_off(lane: Lane, *points: Point) -> bool:
    """Returns whether a disc never comes near the hull of a robot that stands at one of the points."""
    a, b, radius = lane
    # a millimetre for what rounding the speed does to the far end
    return all(_from_line(point, a, b) >= radius + LARGEST_HULL + PATROL_GAP + 0.001 for point in points)


def _never_meet(one: Lane, other: Lane) -> bool:
    """Returns whether two discs stay apart wherever they are on their lanes."""
    a, b, radius = one
    c, d, other_radius = other
    needed = radius + other_radius + 0.05
    for k in (0, 1):
        if abs(a[k] + b[k] - c[k] - d[k]) >= abs(a[k] - b[k]) + abs(c[k] - d[k]) + 2.0 * needed:
            return True  # beside each other: most pairs are
    sides = []
    for (x, y), (u, v), ends in ((a, b, (c, d)), (c, d, (a, b))):
        sides += [(u - x) * (end[1] - y) - (v - y) * (end[0] - x) for end in ends]
    if sides[0] * sides[1] < 0.0 and sides[2] * sides[3] < 0.0:  # the lanes cross
        return False
    nearest = min(_from_line(a, c, d), _from_line(b, c, d), _from_line(c, a, b), _from_line(d, a, b))
    return nearest >= needed


def _crossing(draw: Draw) -> Field | None:
    """One to three discs that cross the straight line to and fro, each on a lane of its own."""
    frame, distance = somewhere(draw), draw.number(6.0, 9.0)
    start, goal = frame.point(0.0, 0.0), frame.point(distance, 0.0)
    lanes: list[Lane] = []
    discs = []
    for _ in range(draw.whole(1, 3)):
        x, slant = draw.number(0.2, 0.8) * distance, draw.number(-0.8, 0.8)
        side, reach = draw.sign(), draw.number(1.5, 3.0)
        ends = frame.point(x - slant, -side * reach), frame.point(x + slant, side * reach)
        lane = (*ends, draw.number(0.2, 0.4))
        if not (keeps_off(lane, start, goal) and all(_never_meet(lane, other) for other in lanes)):
            return None
        lanes.append(lane)
        discs.append(disc_on_patrol(lane, draw.number(0.2, 0.6), draw.number(0.0, 1.0)))
    return start, goal, discs


def _along(speeds: Point, first: Point, last: Point, phases: Point) -> Callable[[Draw], "Field | None"]:
    """Returns the fields with a disc, or two at one speed, along the straight line: towards the robot or ahead of it.

    Args:
        speeds: m/s, from and to.
        first, last: where the first leg begins and ends, share of the line, from and to.
        phases: share of the first leg gone at the start, from and to.
    """

    def field(draw: Draw) -> Field | None:
        frame, distance = somewhere(draw), draw.number(6.0, 9.0)
        start, goal = frame.point(0.0, 0.0), frame.point(distance, 0.0)
        a, b = draw.number(*first) * distance, draw.number(*last) * distance
        speed, phase, gap = draw.number(*speeds), 0.5 * draw.number(*phases), draw.number(0.9, 1.3)
        lanes: list[Lane] = []
        for shift in (0.0,) if draw.sign() > 0.0 else (-0.5 * gap, 0.5 * gap):
            aside = draw.number(-0.25, 0.25)
            ends = frame.point(a + shift, aside), frame.point(b + shift, aside)
            lanes.append((*ends, draw.number(0.2, 0.35)))
        if not all(keeps_off(lane, start, goal) for lane in lanes):
            return None
        return start, goal, [disc_on_patrol(lane, speed, phase) for lane in lanes]

    return field


def _crowd(draw: Draw) -> Field | None:
    """8 to 30 discs that go to and fro all over the walled square, each on a lane of its own."""
    ends = _two_points(draw, 6.0)
    if ends is None:
        return None
    lanes: list[Lane] = []
    count = draw.whole(8, 30)
    for _ in range(400):
        if len(lanes) == count:
            discs = [disc_on_patrol(lane, draw.number(0.1, 0.5), draw.number(0.0, 1.0)) for lane in lanes]
            return *ends, [*_BORDER, *discs]
        radius = draw.number(0.15, 0.3)
        reach = HALF_SIDE - radius - 0.05
        a = draw.number(-reach, reach), draw.number(-reach, reach)
        b = Frame(*a, draw.heading()).point(draw.number(1.0, 4.0), 0.0)
        lane = a, b, radius
        inside = max(abs(b[0]), abs(b[1])) <= reach
        if inside and keeps_off(lane, *ends) and all(_never_meet(lane, other) for other in lanes):
            lanes.append(lane)
    return None


def _push_boxes(draw: Draw) -> Field | None:
    """One to three boxes of 0.5 to 4 kg about the straight line, which a robot may push or pass."""
    frame, distance = somewhere(draw), draw.number(4.0, 7.0)
    start, goal = frame.point(0.0, 0.0), frame.point(distance, 0.0)
    boxes, places = [], []
    count = draw.whole(1, 3)
    for i in range(count):
        x, y = frame.point((i + draw.number(0.8, 1.2)) * distance / (count + 1), draw.number(-0.2, 0.2))
        length, width = draw.number(0.3, 0.7), draw.number(0.3, 0.7)
        boxes.append(box(x, y, length, width, draw.heading(), mass=draw.number(0.5, 4.0)))
        places.append((x, y, 0.5 * math.sqrt(length * length + width * width)))
    fits = _clear(boxes, start) and _clear(boxes, goal) and _apart(places)
    return (start, goal, boxes) if fits else None


def room_on_the_way(scenario: GoalScenario) -> float:
    """Returns the quantity of a goal's tier, m, rounded to 1e-6.

    The radius of the largest disc that has a way (at most 1 m, around all that moving discs sweep), over the detour of
    a disc of 0.3 m.
    """
    return round(ways.clear_radius(scenario, sweeping=True) / ways.detour(scenario, LARGEST_HULL), 6)


def size(hull: float) -> float:
    """Returns how many times as large as the frozen scenes those for a hull (m) are: 1 up to 0.3 m."""
    return max(hull / LARGEST_HULL, 1.0)


def feasible(scenario: GoalScenario, hull: float = LARGEST_HULL) -> bool:
    """Returns whether a robot has room at start and goal and a way past all that stands, not too long.

    Args:
        hull: m, radius. All lengths grow with it from 0.3 m on, and so does the grid of the search: what is proven for
            a scene is proven for its hull class too, but for the last digits.
    """
    obstacles, factor = scenario.obstacles, size(hull)
    spare = GOAL_FAMILIES[scenario.family].goal_room * factor - 1e-9 * (factor - 1.0)
    least = hull - 1e-9 * (factor - 1.0)
    return (
        clearance(obstacles, len(obstacles), *scenario.start[:2]) >= least + ROOM * factor
        and clearance(obstacles, len(obstacles), *scenario.goal[:2]) >= hull + spare
        and math.dist(scenario.start[:2], scenario.goal[:2]) >= 2.0 * factor - 1e-9 * (factor - 1.0)
        and ways.clear_radius(scenario, size=factor) >= least
        and ways.way_length(scenario, hull, size=factor) <= _LONGEST_WAY * factor
    )


GOAL_FAMILIES: Mapping[str, Family] = {
    family.name: family
    for family in (
        _family("open_fields", "nothing in the way, 4 to 9 m", _open_field),
        _family("collinear_exact", "one or two boxes or discs exactly on the straight line", _collinear(0.0)),
        _family("collinear_1mm", "the same, 1 mm beside the line", _collinear(0.001)),
        _family("collinear_2cm", "the same, 2 cm beside the line", _collinear(0.02)),
        _family(
            "near_goal", "obstacles that leave the hull 0.05 to 0.25 m at the goal", _near_goal, goal_room=_LEAST_SPARE
        ),
        _family("clutter_5", "discs over 5 per cent of a walled square of 10 m", _clutter(0.05)),
        _family("clutter_10", "discs over 10 per cent of it", _clutter(0.10)),
        _family("clutter_15", "discs over 15 per cent of it", _clutter(0.15)),
        _family("doors_narrow", "a wall across the square with one door of 0.65 m", _door(0.65)),
        _family("doors_medium", "a wall across the square with one door of 0.8 m", _door(0.80)),
        _family("doors_wide", "a wall across the square with one door of 1 m", _door(1.00)),
        _family("u_traps_05", "a U of walls 0.5 m deep, open towards the robot", _u_trap(0.5)),
        _family("u_traps_15", "a U of walls 1.5 m deep", _u_trap(1.5)),
        _family("u_traps_30", "a U of walls 3 m deep", _u_trap(3.0)),
        _family("corridors", "one bend or two, 0.9 to 1.4 m wide", _corridor),
        _family("rooms", "four or six rooms with doors of 0.8 to 1.2 m", _rooms),
        _family("moving_crossing", "one to three discs that cross the straight line", _crossing, moving=True),
        _family(
            "moving_head_on",
            "one or two discs that come towards the robot",
            _along((0.2, 0.5), (0.65, 0.8), (0.15, 0.3), (0.0, 0.3)),
            moving=True,
        ),
        _family(
            "moving_overtaking",
            "one or two slow discs that go the robot's way",
            _along((0.1, 0.25), (0.2, 0.35), (0.7, 0.85), (0.0, 0.3)),
            moving=True,
        ),
        _family("moving_crowd", "8 to 30 discs that go to and fro in the square", _crowd, moving=True),
        _family(
            "push_boxes", 'boxes that can be pushed, for dynamics="pymunk" or "mujoco"', _push_boxes, needs_forces=True
        ),
    )
}


REPERTOIRE = Repertoire(GoalScenario, GOAL_SCENARIOS, GOAL_FAMILIES, room_on_the_way, feasible, LARGEST_HULL, size)
