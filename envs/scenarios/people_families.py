"""The families of robots among people: from a seed, a field, a robot's start and goal, and how people walk.

Every scenario is decided by its seed alone, people included: two policies meet the same people until they differ. The
tier is read from how dense the people are. "waiting" proves a scenario: within 20 s the robot's straight way at 0.6 m/s
is clear of the people as they walk without it; people who react would do otherwise. Of streams and queues, which may
never leave it clear, only the ends are proven.
"""

import functools
import math
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from wayfield.envs.crowds.people import (
    GOES_ON,
    HELBING_FARKAS_VICSEK,
    IMPASSIVE,
    LEAVES,
    LIGHTSFM,
    MOUSSAID,
    ORCA,
    STANDING,
    STAYS,
    THREATENING,
    TURNS_BACK,
    WALK,
    stroll,
)
from wayfield.envs.scenarios.draws import Draw, rounded
from wayfield.envs.scenarios.goal_families import LARGEST_HULL
from wayfield.envs.scenarios.obstacles import circle, obstacle_field, wall
from wayfield.envs.scenarios.team_proofs import prove
from wayfield.envs.scenarios.team_scenario import TeamScenario, check_team
from wayfield.envs.tasks.specs import Family, Repertoire
from wayfield.system.elementary import bearing, sin_cos

_PACE = 0.6  # m/s, of the robot on its straight way
_LONGEST_WAIT = 20.0  # s
_PERIOD = 0.1  # s, of what is proven
_GAP = 0.1  # m, at start, between hulls

Point = tuple[float, float]
# the robot's start and goal, people and what stands; m^2 that they share
Field = tuple[Point, Point, list[dict[str, Any]], list[np.void], float]


def walks_of(people: list[dict[str, Any]]) -> NDArray[np.void]:
    """Returns WALK records of people, each a dict of fields; those not said are a person's of 0.25 m at 1.3 m/s.

    "goals" are those that follow (x, y), of who goes on: rows of `tracks_of`.
    """
    walks = np.zeros(len(people), WALK)
    usual = {"speed": 1.3, "radius": 0.25, "horizon": 2.0, "wall_horizon": 0.5, "margin": 0.05, "share": 0.5}
    first = 0
    for walk, person in zip(walks, people, strict=True):
        goals = person.get("goals", ())
        own = {name: value for name, value in person.items() if name != "goals"}
        for name, value in (usual | {"first": first, "rows": len(goals)} | own).items():
            walk[name] = value
        first += len(goals)
    return walks


def tracks_of(people: list[dict[str, Any]]) -> NDArray[np.float64]:
    """Returns the goals that follow, of all people, as the rows of a scenario's tracks."""
    return np.array([(*goal, 0.0, 0.0) for person in people for goal in person.get("goals", ())]).reshape(-1, 4)


def _family(name: str, about: str, field: Callable[[Draw], "Field | None"], reach: float = 5.0) -> Family:
    """Returns the family of a random field; the robot looks at its goal."""

    def scenario(seed: int) -> TeamScenario:
        draw = Draw(name, seed)
        start, goal, people, obstacles, area = draw.until_one(lambda: field(draw))
        ahead = rounded(bearing.py_func(goal[1] - start[1], goal[0] - start[0]))
        return TeamScenario.made(
            f"{name}_{seed}",
            [(*start, ahead)],
            [(*goal, ahead)],
            obstacle_field(*obstacles),
            walks=walks_of(people),
            tracks=tracks_of(people),
            reach=reach,
            bound=rounded(len(people) / area),
            family=name,
        )

    return Family(name, about, scenario)


def _clear(x: float, y: float, radius: float, start: Point, people: list[dict[str, Any]]) -> bool:
    """Returns whether a person may begin here."""
    if math.hypot(x - start[0], y - start[1]) < LARGEST_HULL + radius + 4.0 * _GAP:
        return False
    return all(math.hypot(x - p["x"], y - p["y"]) >= radius + p["radius"] + _GAP for p in people)


def _place(
    draw: Draw,
    along: tuple[float, float],
    across: tuple[float, float],
    start: Point,
    people: list[dict[str, Any]],
    radii: tuple[float, float] = (0.2, 0.3),
    *,
    turned: bool = False,
) -> tuple[float, float, float] | None:
    """Returns the x, y (m) of a person who may begin there and its radius (m); None where 300 draws found no room.

    turned: whether "along" is y.
    """
    for _ in range(300):
        u, v, radius = draw.number(*along), draw.number(*across), draw.number(*radii)
        x, y = (v, u) if turned else (u, v)
        if _clear(x, y, radius, start, people):
            return x, y, radius
    return None


def _speed(draw: Draw, mean: float = 1.29, deviation: float = 0.19) -> float:
    """Returns a wanted speed (m/s): about normal, the sum of twelve uniform numbers, cut to 0.5..2."""
    z = sum(draw.number(0.0, 1.0) for _ in range(12)) - 6.0
    return rounded(min(max(mean + deviation * z, 0.5), 2.0))


def _crowdnav(n: int) -> Callable[[Draw], Field]:
    """Returns CrowdNav's circle crossing: all change sides of a circle of 4 m, by ORCA, blind to the robot."""

    def field(draw: Draw) -> Field:
        start, goal = (0.0, -4.0), (0.0, 4.0)
        people: list[dict[str, Any]] = []
        while len(people) < n:
            sine, cosine = sin_cos.py_func(draw.heading())
            x, y = (rounded(4.0 * each + draw.number(-0.5, 0.5)) for each in (cosine, sine))
            ends = [(start, goal), *(((p["x"], p["y"]), (p["goal_x"], p["goal_y"])) for p in people)]
            if any(math.hypot(x - u, y - v) < 0.8 for pair in ends for u, v in pair):
                continue
            orca = {"speed": 1.0, "radius": 0.3, "horizon": 5.0, "wall_horizon": 5.0, "margin": 0.01, "blind": 1.0}
            people.append({"law": ORCA, "x": x, "y": y, "goal_x": -x, "goal_y": -y, "then": STAYS, **orca})
        return start, goal, people, [], math.pi * 16.0

    return field


def _attngraph(n: int) -> Callable[[Draw], "Field | None"]:
    """Returns AttnGraph's crowd: all cross a circle about a square of 12 m by ORCA, blind to the robot, time and again.

    There, somebody who has arrived is replaced by somebody else on the circle; here, by a new goal on it.

    Source: Liu et al., ICRA 2023; github.com/Shuijing725/CrowdNav_Prediction_AttnGraph (crowd_sim_var_num.py).
    """

    def field(draw: Draw) -> "Field | None":
        start, goal = ((draw.number(-6.0, 6.0), draw.number(-6.0, 6.0)) for _ in range(2))
        if math.dist(start, goal) < 8.0:
            return None

        def on_circle(least: float, most: float) -> Point:
            sine, cosine = sin_cos.py_func(draw.heading())
            x, y = (rounded(6.0 * math.sqrt(2.0) * each + draw.number(least, most)) for each in (cosine, sine))
            return x, y

        orca = {"law": ORCA, "speed": 1.0, "radius": 0.3, "horizon": 5.0, "wall_horizon": 5.0, "margin": 0.16}
        people: list[dict[str, Any]] = []
        while len(people) < n:
            x, y = on_circle(0.0, 2.0)
            ends = [start, goal, *((p[u], p[v]) for p in people for u, v in (("x", "y"), ("goal_x", "goal_y")))]
            if any(math.hypot(x - u, y - v) < 0.85 for u, v in ends):
                continue
            after = [on_circle(-0.5, 0.5) for _ in range(12)]
            person = {"x": x, "y": y, "goal_x": -x, "goal_y": -y, "then": GOES_ON, "goals": after, "blind": 1.0}
            people.append(orca | person)
        return start, goal, people, [], 144.0

    return field


def _walkers(
    draw: Draw, n: int, start: Point, room: tuple[Point, Point], law: int, to: Callable[[int, float, float], Point],
    *, turned: bool = False,
) -> list[dict[str, Any]] | None:  # fmt: skip
    """Returns n people who walk to and fro between the room, x and y in m, and `to(k, x, y)`; None: it is too small.

    turned: whether every other begins in the room turned by a right angle.
    """
    people: list[dict[str, Any]] = []
    for k in range(n):
        place = _place(draw, *room, start, people, turned=turned and k % 2 == 1)
        if place is None:
            return None
        x, y, radius = place
        goal_x, goal_y = to(k, x, y)
        person = {"law": law, "x": x, "y": y, "goal_x": goal_x, "goal_y": goal_y, "radius": radius}
        people.append(person | {"speed": _speed(draw), "then": TURNS_BACK})
    return people


def _lanes(n: int) -> Callable[[Draw], "Field | None"]:
    """Returns two streams in a corridor of 4.8 by 15 m; the robot goes along it."""

    def field(draw: Draw) -> "Field | None":
        start, goal, room = (0.6, draw.number(1.0, 3.8)), (14.4, draw.number(1.0, 3.8)), ((0.5, 14.5), (0.5, 4.3))
        people = _walkers(draw, n, start, room, MOUSSAID, lambda k, x, y: (13.3 if k % 2 == 0 else 1.7, y))
        walls = [wall(0.0, 0.0, 15.0, 0.0), wall(0.0, 4.8, 15.0, 4.8)]
        return None if people is None else (start, goal, people, walls, 72.0)

    return field


def _crossing_flow(n: int) -> Callable[[Draw], "Field | None"]:
    """Returns a stream 5 m wide at a right angle to the robot's way."""

    def field(draw: Draw) -> "Field | None":
        start, goal = (-4.5, draw.number(-0.5, 0.5)), (4.5, draw.number(-0.5, 0.5))
        law, room = MOUSSAID if draw.sign() > 0.0 else ORCA, ((-2.5, 2.5), (-6.0, 6.0))
        people = _walkers(draw, n, start, room, law, lambda k, x, y: (x, math.copysign(6.5, -y)))
        return None if people is None else (start, goal, people, [], 60.0)

    return field


def _crossing_streams(n: int) -> Callable[[Draw], "Field | None"]:
    """Returns two streams at a right angle, each 5 m wide, n people in both; the robot goes with the first."""

    def field(draw: Draw) -> "Field | None":
        start, goal = (-7.0, draw.number(-1.5, 1.5)), (7.0, draw.number(-1.5, 1.5))
        law, room = MOUSSAID if draw.sign() > 0.0 else ORCA, ((-6.0, 6.0), (-2.5, 2.5))

        def to(k: int, x: float, y: float) -> Point:
            end = 6.5 if draw.sign() > 0.0 else -6.5
            return (end, y) if k % 2 == 0 else (x, end)

        people = _walkers(draw, n, start, room, law, to, turned=True)
        return None if people is None else (start, goal, people, [], 95.0)

    return field


def _walking_groups(draw: Draw) -> "Field | None":
    """Returns two to four groups of 2 to 4 that walk together, towards the robot or across its way.

    Moussaid et al. 2010 have 1.26 m/s less 0.04 m/s for each of a group, at low density.
    """
    start, goal = (0.0, 0.0), (9.0, 0.0)
    people: list[dict[str, Any]] = []
    for group in range(1, draw.whole(2, 4) + 1):
        count = draw.whole(2, 4)
        towards = draw.sign() > 0.0
        x, y = (draw.number(5.0, 9.0), draw.number(-1.5, 1.5)) if towards else (draw.number(2.5, 6.5), 0.0)
        side = draw.sign() * draw.number(2.5, 4.5)
        for k in range(count):
            aside = 0.7 * (k - 0.5 * (count - 1))  # abreast
            at = (x, y + aside) if towards else (x + aside, side)
            to = (-8.0, y + aside) if towards else (x + aside, -math.copysign(9.0, side))
            if not _clear(*at, 0.25, start, people):
                return None
            place = {"x": rounded(at[0]), "y": rounded(at[1]), "goal_x": rounded(to[0]), "goal_y": rounded(to[1])}
            own = {"law": MOUSSAID, "speed": rounded(1.26 - 0.04 * count), "group": group, "then": STAYS}
            people.append(place | own | {"radius": 0.25})
    return start, goal, people, [], 54.0


def _reactions(draw: Draw) -> "Field | None":
    """Returns five people across the robot's way, each with another reaction to it; by HuNavSim's force, lightsfm."""
    start, goal = (0.0, 0.0), (9.0, 0.0)
    people: list[dict[str, Any]] = []
    for reaction in range(IMPASSIVE, THREATENING + 1):
        x, side = draw.number(2.0, 7.5), draw.sign() * draw.number(1.5, 4.0)
        if not _clear(x, side, 0.25, start, people):
            return None
        walk = {"law": LIGHTSFM, "x": x, "y": side, "goal_x": x, "goal_y": rounded(-math.copysign(6.0, side))}
        own = {"speed": draw.number(0.7, 1.2), "reaction": reaction, "radius": 0.25, "then": STAYS}
        people.append(walk | own)
    return start, goal, people, [], 54.0


def _few(along: float, speed: tuple[float, float]) -> Callable[[Draw], Field]:
    """Returns one to three people on the robot's line: ahead of it in its direction, or towards it."""

    def field(draw: Draw) -> Field:
        start, goal, law = (0.0, 0.0), (9.0, 0.0), (MOUSSAID if draw.sign() > 0.0 else ORCA)
        people = []
        for k in range(draw.whole(1, 3)):
            x, y = 2.0 + 1.5 * k if along > 0.0 else 9.0 - 1.2 * k, draw.number(-0.4, 0.4)
            # oncoming people leave before they reach its start
            goal_x, then = (16.0, STAYS) if along > 0.0 else (1.2, LEAVES)
            person = {"law": law, "x": x, "y": y, "goal_x": goal_x, "goal_y": y, "then": then}
            people.append(person | {"speed": draw.number(*speed)})
        return start, goal, people, [], 36.0

    return field


def _blind_corner(draw: Draw) -> Field:
    """Returns people that come from behind the corner that the robot passes."""
    start, goal = (0.0, 0.0), (7.0, 0.0)
    x, people = 3.5 + draw.number(0.2, 0.8), []
    for k in range(draw.whole(1, 3)):
        person = {"law": ORCA, "x": x, "y": 2.5 + 1.0 * k, "goal_x": x, "goal_y": -6.0, "speed": draw.number(0.9, 1.4)}
        people.append(person | {"then": STAYS})
    return start, goal, people, [wall(-1.0, 0.9, 3.3, 0.9), wall(3.3, 0.9, 3.3, 6.0)], 30.0


def _queue(draw: Draw) -> "Field | None":
    """Returns 10 to 20 people who push through a door of 1 m that the robot follows them through."""
    return _through_door(draw, (-5.5, draw.number(-1.0, 1.0)), (4.0, 0.0))


def _queue_against(draw: Draw) -> "Field | None":
    """Returns 10 to 20 people who push through a door of 1 m towards the robot, which has to go through it too."""
    return _through_door(draw, (4.0, draw.number(-2.0, 2.0)), (-5.5, draw.number(-1.0, 1.0)))


def _through_door(draw: Draw, start: Point, goal: Point) -> "Field | None":
    """Returns people who push through a door of 1 m, and where the robot begins and shall go."""
    people: list[dict[str, Any]] = []
    for _ in range(draw.whole(10, 20)):
        place = _place(draw, (-4.0, -0.8), (-2.2, 2.2), start, people, (0.22, 0.28))
        if place is None:
            return None
        x, y, radius = place
        gate = {"gate_x": 0.0, "gate_y": -0.5, "gate_to_x": 0.0, "gate_to_y": 0.5}
        person = {"law": HELBING_FARKAS_VICSEK, "x": x, "y": y, "goal_x": 9.0, "goal_y": y, "radius": radius}
        people.append(person | gate | {"speed": _speed(draw, 1.0), "then": STAYS})
    walls = [
        wall(0.0, -4.0, 0.0, -0.5),
        wall(0.0, 0.5, 0.0, 4.0),
        wall(-7.0, -4.0, 0.0, -4.0),
        wall(-7.0, 4.0, 0.0, 4.0),
    ]
    return start, goal, people, walls, 48.0


def _standing_groups(draw: Draw) -> "Field | None":
    """Returns groups of 2 to 5 that stand on circles of 0.6 to 1 m, about the robot's way."""
    start, goal = (0.0, 0.0), (9.0, 0.0)
    centres: list[tuple[float, float, float]] = []
    people: list[dict[str, Any]] = []
    for _ in range(draw.whole(2, 4)):
        x, y, reach = draw.number(2.0, 7.0), draw.number(-2.0, 2.0), draw.number(0.6, 1.0)
        if any(math.hypot(x - u, y - v) < reach + r + 1.3 for u, v, r in centres):
            return None
        centres.append((x, y, reach))
        count, phase = draw.whole(2, 5), draw.heading()
        for k in range(count):
            sine, cosine = sin_cos.py_func(phase + 2.0 * math.pi * k / count)
            u, v = rounded(x + reach * cosine), rounded(y + reach * sine)
            people.append({"law": STANDING, "x": u, "y": v, "goal_x": u, "goal_y": v})
    return start, goal, people, [], 54.0


PEOPLE_FAMILIES: Mapping[str, Family] = {
    family.name: family
    for family in (
        *(
            _family(f"crowdnav_{n}", f"CrowdNav's circle crossing, {n} blind to the robot", _crowdnav(n), reach=10.0)
            for n in (5, 10)
        ),
        _family(
            "attngraph_20",
            "AttnGraph's crowd, 20 who cross a square of 12 m, blind to the robot",
            _attngraph(20),
            reach=10.0,
        ),
        *(_family(f"lanes_{n}", f"two streams of {n} in a corridor of 4.8 m", _lanes(n)) for n in (12, 24, 48)),
        *(_family(f"crossing_flow_{n}", f"a stream of {n} across the way", _crossing_flow(n)) for n in (8, 16)),
        _family("overtaking", "one to three people, slower than the robot, on its line", _few(1.0, (0.3, 0.5))),
        _family("head_on", "one to three people towards the robot on its line", _few(-1.0, (0.9, 1.4))),
        _family("blind_corner", "one to three people from behind a corner", _blind_corner),
        _family("queue_at_door", "10 to 20 people who push through a door of 1 m", _queue),
        _family("standing_groups", "groups of 2 to 5 that stand on circles", _standing_groups),
        *(
            _family(f"crossing_streams_{n}", f"two streams at a right angle, {n} in both", _crossing_streams(n))
            for n in (16, 32)
        ),
        _family("queue_against", "10 to 20 people who push through a door of 1 m against the robot", _queue_against),
        _family(
            "walking_groups",
            "groups of 2 to 4 that walk together, towards the robot or across its way",
            _walking_groups,
        ),
        _family("reactions", "five people, each with another reaction to the robot", _reactions),
    )
}


def density(scenario: TeamScenario) -> float:
    """Returns the quantity of a tier: people a square metre of the field."""
    return float(scenario.bound)


@functools.lru_cache(maxsize=4)
def feasible(scenario: TeamScenario) -> bool:
    """Returns whether the robot's straight way is clear of the people within 20 s, as they walk without it: proven.

    Of streams and queues only that its start and goal are clear of walls.
    """
    check_team(scenario, LARGEST_HULL)
    if (scenario.walks["then"] == TURNS_BACK).any() or (scenario.walks["law"] == HELBING_FARKAS_VICSEK).any():
        return True
    if (scenario.walks["law"] == STANDING).all():
        standing = obstacle_field(*(circle(w["x"].item(), w["y"].item(), w["radius"].item()) for w in scenario.walks))
        robot = TeamScenario.made(scenario.name, scenario.starts.tolist(), scenario.goals.tolist(), standing)
        return math.isfinite(prove(robot, LARGEST_HULL)[1])
    start, goal = scenario.starts[0, :2], scenario.goals[0, :2]
    length = float(scenario.straight[0])
    steps = round((_LONGEST_WAIT + length / _PACE) / _PERIOD)
    walked = stroll(scenario.walks, steps, _PERIOD, scenario.obstacles, scenario.tracks, scenario.reach)
    room = scenario.walks["radius"] + LARGEST_HULL
    going = round(length / _PACE / _PERIOD)
    way = start + np.linspace(0.0, 1.0, going + 1)[:, None] * (goal - start)
    there = walked[:, :, 4] > 0.0
    at_start = np.sqrt(((walked[:, :, :2] - start) ** 2).sum(axis=2)) - room
    waits = np.where(there, at_start, np.inf).min(axis=1) > 0.0
    for wait in range(0, round(_LONGEST_WAIT / _PERIOD), 5):
        if not waits[: wait + 1].all():
            return False
        part = walked[wait : wait + going + 1]
        gaps = np.sqrt(((part[:, :, :2] - way[: len(part), None]) ** 2).sum(axis=2)) - room
        if np.where(part[:, :, 4] > 0.0, gaps, np.inf).min() > 0.0:
            return True
    return False


CROWDNAV_CASES, CROWDNAV_TESTS = 500, 1000  # of its test, and the seed of the first


def crowdnav_tests(hull_radius: float) -> tuple[TeamScenario, ...]:
    """Returns the 500 test cases of CrowdNav to the letter: five people on its circle, a goal within 0.3 m.

    Source: Chen, Liu, Kreiss and Alahi, ICRA 2019; github.com/vita-epfl/CrowdNav (crowd_sim.py, env.config).
    """
    del hull_radius
    return tuple(crowdnav_case(CROWDNAV_TESTS + k) for k in range(CROWDNAV_CASES))


def crowdnav_case(seed: int) -> TeamScenario:
    """Returns the case of a seed of CrowdNav's: 0 to 99 validate, 1000 to 1499 test, from 2000 on it trains."""
    random = np.random.RandomState(seed).random_sample  # the legacy generator, as there
    start, goal = (0.0, -4.0), (0.0, 4.0)
    ends = [(start, goal)]
    while len(ends) < 6:
        angle = random() * np.pi * 2
        x, y = 4.0 * np.cos(angle) + random() - 0.5, 4.0 * np.sin(angle)
        y += random() - 0.5
        if all(math.hypot(x - u, y - v) >= 0.8 for pair in ends for u, v in pair):
            ends.append(((float(x), float(y)), (-float(x), -float(y))))
    orca = {"law": ORCA, "speed": 1.0, "radius": 0.3, "horizon": 5.0, "wall_horizon": 5.0, "margin": 0.01, "blind": 1.0}
    people = [{"x": x, "y": y, "goal_x": u, "goal_y": v, "then": STAYS, **orca} for (x, y), (u, v) in ends[1:]]
    ahead = 0.5 * math.pi
    return TeamScenario.made(
        f"crowdnav_{seed - CROWDNAV_TESTS}",
        [(*start, ahead)],
        [(*goal, ahead)],
        walks=walks_of(people),
        reach=10.0,
        position_tolerance=0.3,
        bound=rounded(5.0 / (16.0 * math.pi)),
        family="crowdnav",
    )


REPERTOIRE = Repertoire(
    scenario=TeamScenario,
    presets={"crowdnav": crowdnav_tests},
    families=PEOPLE_FAMILIES,
    quantity=density,
    feasible=feasible,
    largest_hull=LARGEST_HULL,
)
