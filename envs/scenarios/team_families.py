"""The families of teams: from a seed, a field, and a start and a goal for each of N robots; N is part of the name.

Every scenario is decided by its seed alone, for hulls of up to 0.3 m, and is proven: see `team_proofs`.
"""

import dataclasses
import functools
import itertools
import math
from collections.abc import Callable, Iterable, Mapping
from typing import Any

import numpy as np

from wayfield.envs.scenarios.draws import Draw, Frame, rounded
from wayfield.envs.scenarios.goal_families import LARGEST_HULL, somewhere
from wayfield.envs.scenarios.obstacles import circle, obstacle_field, wall
from wayfield.envs.scenarios.team_proofs import prove
from wayfield.envs.scenarios.team_scenario import TeamScenario, check_team
from wayfield.envs.tasks.specs import Family, Repertoire
from wayfield.system.elementary import bearing, sin_cos

APART = 0.8  # m, between the centres of starts, and of goals
DOOR = 0.9  # m
CORRIDOR = 2.4  # m, wide
SCATTER = 0.5  # m, CrowdNav's noise of a circle's starts
PACE = 0.6  # m/s, at which ways that cross are timed
_SLOT = 0.85  # m, between places along a wall
_LANE = 0.4  # m, of a place beside a wall: the middle of a corridor is free

Point = tuple[float, float]
# starts, goals and what stands; None: drawn in vain, draw again
Field = tuple[list[Point], list[Point], list[np.void]]


def _family(name: str, about: str, team: int, field: Callable[[Draw], "Field | None"], **known: Any) -> Family:
    """Returns the family of a random field; robots look at their goals."""

    def scenario(seed: int) -> TeamScenario:
        draw = Draw(name, seed)
        starts, goals, obstacles = draw.until_one(lambda: field(draw))
        ahead = [rounded(bearing.py_func(g[1] - s[1], g[0] - s[0])) for s, g in zip(starts, goals, strict=True)]
        return TeamScenario.made(
            f"{name}_{seed}",
            [(*each, heading) for each, heading in zip(starts, ahead, strict=True)],
            [(*each, heading) for each, heading in zip(goals, ahead, strict=True)],
            obstacle_field(*obstacles),
            family=name,
        )

    return Family(name, about, scenario, team, **known)


def _far_from(place: Point, others: Iterable[Point], least: float = APART) -> bool:
    return all((place[0] - x) ** 2 + (place[1] - y) ** 2 >= least * least for x, y in others)


def _walls(frame: Frame, *corners: Point) -> list[np.void]:
    """Returns the walls from corner to corner, given in a frame."""
    return [wall(*a, *b) for a, b in itertools.pairwise([frame.point(*corner) for corner in corners])]


def _rectangle(frame: Frame, x0: float, y0: float, x1: float, y1: float) -> list[np.void]:
    return _walls(frame, (x0, y0), (x1, y0), (x1, y1), (x0, y1), (x0, y0))


def _scattered(draw: Draw, count: int, x0: float, y0: float, x1: float, y1: float) -> list[Point] | None:
    """Returns so many places in a rectangle that are apart; None when they did not fit."""
    places: list[Point] = []
    for _ in range(400 * count):
        place = draw.number(x0, x1), draw.number(y0, y1)
        if _far_from(place, places):
            places.append(place)
            if len(places) == count:
                return places
    return None


def _shuffled(draw: Draw, places: list[Point]) -> list[Point]:
    """Returns the places in a drawn order."""
    left, shuffled = list(places), []
    while left:
        shuffled.append(left.pop(draw.whole(0, len(left) - 1)))
    return shuffled


def _in_frame(frame: Frame, places: Iterable[Point]) -> list[Point]:
    return [frame.point(*place) for place in places]


# ---- the fields


def _head_on(offset: float) -> Callable[[Draw], Field]:
    """Returns two robots on parallel ways, the other way round, beside each other by an offset (m)."""

    def field(draw: Draw) -> Field:
        half, heading, side = 0.5 * draw.number(4.0, 8.0), draw.heading(), draw.sign()
        sine, cosine = sin_cos.py_func(heading)
        # places are whole multiples of one step: an offset of 0 leaves none by rounding
        x, y = rounded(half * cosine), rounded(half * sine)
        u, v = rounded(-0.5 * side * offset * sine), rounded(0.5 * side * offset * cosine)
        return [(u - x, v - y), (x - u, y - v)], [(u + x, v + y), (-x - u, -y - v)], []

    return field


def _crossing(n: int) -> Callable[[Draw], Field]:
    """Returns robots on perpendicular ways that come to one place within 0.2 s of each other."""

    def field(draw: Draw) -> Field:
        frame, length = somewhere(draw), draw.number(3.0, 4.0)
        starts, goals = [], []
        for k in range(n):
            sine, cosine = ((0.0, 1.0), (1.0, 0.0), (0.0, -1.0), (-1.0, 0.0))[k]
            late = draw.number(0.0, 0.2 * PACE)
            aside = 0.45 if n == 4 else 0.0  # of two that come from opposite sides
            starts.append((-(length + late) * cosine - aside * sine, -(length + late) * sine + aside * cosine))
            goals.append(((length + 0.5) * cosine - aside * sine, (length + 0.5) * sine + aside * cosine))
        return _in_frame(frame, starts), _in_frame(frame, goals), []

    return field


def _circle(n: int, noisy: bool = True) -> Callable[[Draw], "Field | None"]:
    """Returns robots on a circle that all change sides."""

    def field(draw: Draw) -> "Field | None":
        radius = max(4.0, 0.24 * n)
        phase = draw.heading()
        starts: list[Point] = []
        for k in range(n):
            for _ in range(1000):
                sine, cosine = sin_cos.py_func(phase + 2.0 * math.pi * k / n)
                x, y = radius * cosine, radius * sine
                if noisy:
                    x, y = x + draw.number(-SCATTER, SCATTER), y + draw.number(-SCATTER, SCATTER)
                place = rounded(x), rounded(y)
                if not noisy or _far_from(place, starts):
                    starts.append(place)
                    break
            else:
                return None
        return starts, [(-x, -y) for x, y in starts], []

    return field


def _open(n: int) -> Callable[[Draw], "Field | None"]:
    """Returns starts and goals anywhere in a square."""

    def field(draw: Draw) -> "Field | None":
        half = 0.5 * max(8.0, 2.0 * math.sqrt(n))
        square = (-half, -half, half, half)
        starts, goals = _scattered(draw, n, *square), _scattered(draw, n, *square)
        return None if starts is None or goals is None else (starts, goals, [])

    return field


def _doorway(n: int) -> Callable[[Draw], "Field | None"]:
    """Returns two halves of a team that change sides through one door."""

    def field(draw: Draw) -> "Field | None":
        frame = somewhere(draw)
        sides = [_scattered(draw, n, -4.0, -2.5, -1.2, 2.5), _scattered(draw, n, 1.2, -2.5, 4.0, 2.5)]
        if sides[0] is None or sides[1] is None:
            return None
        left, right = sides[0], sides[1]
        half = n // 2
        starts = left[:half] + right[:half]
        goals = right[half : 2 * half] + left[half : 2 * half]
        at = draw.number(-1.0, 1.0)
        obstacles = _rectangle(frame, -4.8, -3.3, 4.8, 3.3)
        obstacles += _walls(frame, (0.0, -3.3), (0.0, at - 0.5 * DOOR)) + _walls(
            frame, (0.0, at + 0.5 * DOOR), (0.0, 3.3)
        )
        return _in_frame(frame, starts), _in_frame(frame, goals), obstacles

    return field


def _slots(draw: Draw, first: int, last: int) -> list[Point]:
    """Returns the places along both walls of a corridor from one slot to another, (along, across), in any order."""
    across = 0.5 * CORRIDOR - _LANE
    return _shuffled(draw, [(0.5 + _SLOT * k, side * across) for k in range(first, last + 1) for side in (-1.0, 1.0)])


def _corridor(n: int) -> Callable[[Draw], Field]:
    """Returns two streams in a closed corridor, against each other; starts and goals lie along its walls."""

    def field(draw: Draw) -> Field:
        frame, half = somewhere(draw), n // 2
        starts = _slots(draw, 0, 3)[:half] + _slots(draw, 10, 13)[:half]
        goals = _slots(draw, 6, 9)[:half] + _slots(draw, 2, 5)[:half]
        walls = _rectangle(frame, 0.0, -0.5 * CORRIDOR, 12.05, 0.5 * CORRIDOR)
        return _in_frame(frame, starts), _in_frame(frame, goals), walls

    return field


def _intersection(n: int) -> Callable[[Draw], Field]:
    """Returns four streams where two corridors cross."""

    def field(draw: Draw) -> Field:
        frame, each = somewhere(draw), n // 4
        half, end = 0.5 * CORRIDOR, 0.5 * CORRIDOR + 4.4
        starts: list[Point] = []
        goals: list[Point] = []
        obstacles: list[np.void] = []
        for k in range(4):
            sine, cosine = ((0.0, 1.0), (1.0, 0.0), (0.0, -1.0), (-1.0, 0.0))[k]
            outer, inner = _slots(draw, 0, 1)[:each], _slots(draw, 2, 3)[:each]
            # slots count from the end of an arm inwards; goals lie in the arm on the other side
            starts += [(-(end - a) * cosine - b * sine, -(end - a) * sine + b * cosine) for a, b in outer]
            goals += [((end - a) * cosine - b * sine, (end - a) * sine + b * cosine) for a, b in inner]
            corners = [(half, half), (end, half), (end, -half), (half, -half)]
            arm = [(a * cosine - b * sine, a * sine + b * cosine) for a, b in corners]
            obstacles += _walls(frame, *arm)
        return _in_frame(frame, starts), _in_frame(frame, goals), obstacles

    return field


def _bottleneck(n: int) -> Callable[[Draw], "Field | None"]:
    """Returns a team that leaves a room of 8 m by one door."""

    def field(draw: Draw) -> "Field | None":
        frame = somewhere(draw)
        starts = _scattered(draw, n, -7.5, -3.5, -0.7, 3.5)
        if starts is None:
            return None
        outside = [(2.0 + 1.3 * a, 1.3 * b) for a in range(6) for b in range(-3, 4)]
        goals = _shuffled(draw, outside)[:n]
        obstacles = _walls(
            frame, (0.0, -0.5 * DOOR), (0.0, -4.0), (-8.0, -4.0), (-8.0, 4.0), (0.0, 4.0), (0.0, 0.5 * DOOR)
        )
        return _in_frame(frame, starts), _in_frame(frame, goals), obstacles

    return field


def _rooms(n: int) -> Callable[[Draw], "Field | None"]:
    """Returns four rooms with doors, and goals in another room than the start."""

    def field(draw: Draw) -> "Field | None":
        half, wide = 5.0, 0.5 * (DOOR + 0.2)
        places = _scattered(draw, 2 * n, -half + 0.6, -half + 0.6, half - 0.6, half - 0.6)
        if places is None or any(min(abs(x), abs(y)) < 0.9 for x, y in places):
            places = (
                None
                if places is None
                else [(math.copysign(max(abs(x), 0.9), x), math.copysign(max(abs(y), 0.9), y)) for x, y in places]
            )
        if places is None:
            return None
        starts, goals = places[:n], places[n:]
        room = [[(x > 0.0, y > 0.0) for x, y in each] for each in (starts, goals)]
        if any(a == b for a, b in zip(*room, strict=True)):
            return None
        if not all(_far_from(each, group[:k]) for group in (starts, goals) for k, each in enumerate(group)):
            return None
        obstacles = _rectangle(Frame(), -half, -half, half, half)
        for sign in (-1.0, 1.0):
            at = sign * draw.number(1.5, 3.5)
            for x0, x1 in ((min(0.0, sign * half), at - wide), (at + wide, max(0.0, sign * half))):
                obstacles += [wall(x0, 0.0, x1, 0.0)]
            at = sign * draw.number(1.5, 3.5)
            for y0, y1 in ((min(0.0, sign * half), at - wide), (at + wide, max(0.0, sign * half))):
                obstacles += [wall(0.0, y0, 0.0, y1)]
        return starts, goals, obstacles

    return field


def _hall(n: int) -> Callable[[Draw], "Field | None"]:
    """Returns a hall of 20 m with twelve pillars, and goals at the far side."""

    def field(draw: Draw) -> "Field | None":
        left = [(-9.3 + 1.3 * a, -9.1 + 1.3 * b) for a in range(7) for b in range(15)]
        right = [(-x, y) for x, y in left]
        pillars = [(draw.number(-0.9, 0.9), -9.1 + 1.5 * k + draw.number(0.0, 0.3)) for k in range(12)]
        obstacles = _rectangle(Frame(), -10.0, -10.0, 10.0, 10.0)
        obstacles += [circle(rounded(x), rounded(y), 0.15) for x, y in pillars]
        starts = [(rounded(x), rounded(y)) for x, y in _shuffled(draw, left)[:n]]
        goals = [(rounded(x), rounded(y)) for x, y in _shuffled(draw, right)[:n]]
        # the robot that starts in front goes to the back of the other side, so that one after another can pass
        order = np.argsort([-x for x, _ in starts], kind="stable"), np.argsort([-x for x, _ in goals], kind="stable")
        return [starts[k] for k in order[0]], [goals[k] for k in order[1]], obstacles

    return field


def _sized(
    name: str, about: str, field: Callable[[int], Callable[[Draw], "Field | None"]], *sizes: int, **known: Any
) -> Iterable[Family]:
    """Yields the families of a field for teams of some sizes."""
    for n in sizes:
        yield _family(f"{name}_{n}", f"{n}: {about}", n, field(n), **known)


_EXACT = functools.partial(_circle, noisy=False)
_HEAD_ON = {"exact": 0.0, "1mm": 0.001, "2cm": 0.02}
TEAM_FAMILIES: Mapping[str, Family] = {
    family.name: family
    for family in (
        *(
            _family(f"head_on_{name}", f"two on one line, {1e3 * offset:g} mm beside each other", 2, _head_on(offset))
            for name, offset in _HEAD_ON.items()
        ),
        *_sized("crossing", "perpendicular ways that meet within 0.2 s of each other", _crossing, 2, 4),
        *_sized("circle_exact", "all change sides of a circle", _EXACT, 2, 4, 8, 16, 32),
        *_sized("circle", "the same, each start moved by up to 0.5 m in x and y", _circle, 2, 4, 8, 16, 32, 100),
        *_sized("open", "starts and goals anywhere in a square", _open, 2, 4, 8, 16, 32, 100),
        *_sized("doorway", "two halves change sides through a door of 0.9 m", _doorway, 2, 4, 8, gap=DOOR, walled=True),
        *_sized("corridor", "two streams in a corridor of 2.4 m", _corridor, 4, 8, 16, gap=CORRIDOR, walled=True),
        *_sized(
            "intersection", "four streams where two corridors of 2.4 m cross", _intersection, 4, 8, 16,
            gap=CORRIDOR, walled=True,
        ),
        *_sized(
            "bottleneck", "all leave a room of 8 m by a door of 0.9 m", _bottleneck, 8, 16, 32,
            gap=DOOR, walled=True,
        ),
        *_sized("rooms", "four rooms with doors, goals in another room", _rooms, 4, 8, walled=True),
        *_sized("hall", "a hall of 20 m with twelve pillars, goals at the far side", _hall, 100, walled=True),
    )
}  # fmt: skip


@functools.lru_cache(maxsize=4)  # one scenario is asked both
def _proven(scenario: TeamScenario) -> tuple[str, float]:
    try:
        check_team(scenario, LARGEST_HULL)
    except ValueError:
        return "", math.inf
    return prove(scenario, LARGEST_HULL)


def room(scenario: TeamScenario) -> float:
    """Returns the quantity of a tier: the proven makespan over the longest straight way, rounded to 1e-6."""
    return round(_proven(scenario)[1], 6)


def feasible(scenario: TeamScenario) -> bool:
    """Returns whether the team can reach its goals: proven."""
    return math.isfinite(_proven(scenario)[1])


def proven(scenario: TeamScenario) -> TeamScenario:
    """Returns the scenario with its proof and what that bounds."""
    proof, bound = _proven(scenario)
    return dataclasses.replace(scenario, proof=proof, bound=bound)


REPERTOIRE = Repertoire(
    scenario=TeamScenario,
    presets={},
    families=TEAM_FAMILIES,
    quantity=room,
    feasible=feasible,
    largest_hull=LARGEST_HULL,
)
