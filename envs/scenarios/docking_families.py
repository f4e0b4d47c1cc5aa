"""The families of random docking scenarios: from a seed, a pose to reach, a start within 3 m, and what stands around.

Every scenario is decided by its seed alone, for a hull of 0.3 m; `DockingScenario.fitted` moves what a robot docks at
up to a smaller hull, so that the gaps are those of the family for every robot. A scenario is feasible when a way is
found on which the hull is clear all along: the shortest of a car that goes both ways (`reeds_shepp`), with circles of
0.3 m, to a place straight ahead of the pose or behind it, and then straight. Past a disc that moves, one is driven at a
steady speed after some waiting.
"""

import dataclasses
import math
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from wayfield.envs.scenarios.draws import Draw, Frame, rounded
from wayfield.envs.scenarios.goal_families import (
    LARGEST_HULL,
    ROOM,
    Point,
    disc_on_patrol,
    keeps_off,
    somewhere,
)
from wayfield.envs.scenarios.obstacles import box, obstacle_field, wall
from wayfield.envs.scenarios.scenario import GoalScenario
from wayfield.envs.tasks.specs import Family, Repertoire
from wayfield.envs.world.geometry import clearance
from wayfield.envs.world.grids import NO_GRIDS, lay_grids
from wayfield.envs.world.movers import any_moves
from wayfield.envs.world.reeds_shepp import PLAN, is_free, plan_to
from wayfield.system.checks import FARTHEST, shown
from wayfield.system.compiled import allocating
from wayfield.system.elementary import sin_cos

FARTHEST_START = 3.0  # m, from the pose to be reached
WALL_GAP = 0.05  # m, between wall and hull
BERTH_GAPS = (0.05, 0.2)  # m, between the hull and the box on either side
RADIUS = 0.3  # m, of the circles of a proven way
_STRAIGHTS = (0.0, 0.3, 0.6, 0.9, 1.2, 1.5)  # m, of the last piece of such a way, forward or backward
_PACE = 0.3  # m/s, on a way past what moves
_LONGEST_WAIT = 20  # s
_LONGEST_WAY = 9.0  # m; 60 s at 0.3 m/s are 18 m

Pose = tuple[float, float, float]
# in the frame of the pose to be reached: that pose's heading, the start, and what stands with the direction in which it
# is moved up to a smaller hull; None: drawn in vain, draw again
Dock = tuple[float, Pose, list[tuple[np.void, Point]]]
_STILL = (0.0, 0.0)


def _nothing_closes() -> NDArray[np.float64]:
    return np.empty((0, 2))


@dataclasses.dataclass(frozen=True, eq=False)
class DockingScenario(GoalScenario):
    """A pose to come to rest at, exactly, from close by.

    Raises:
        ValueError: as a `GoalScenario`.
    """

    position_tolerance: float = 0.05  # m
    heading_tolerance: float = 0.05  # rad
    # (m, 2) of each obstacle of a family, how far in x and y (m) it is moved for a metre less of hull radius; (0, 2):
    # all stand where they are
    closing: NDArray[np.float64] = dataclasses.field(default_factory=_nothing_closes)
    quantity: float = math.nan  # what the tier is read from: the length of the shortest proven way, m

    def __post_init__(self) -> None:
        super().__post_init__()
        closing = self.closing
        sized = isinstance(closing, np.ndarray) and closing.shape in ((0, 2), (len(self.obstacles), 2))
        if not sized or closing.dtype != np.float64 or not (np.abs(closing) <= FARTHEST).all():
            raise ValueError(f"closing is {shown(closing)}; it must be an array (obstacles, 2) of finite numbers, m")

    def fitted(self, shrinkage: float) -> "DockingScenario":
        """Returns the scenario for a hull that is smaller by `shrinkage` (m) than the one that it was made for.

        What the hull docks at is moved up to it, so that the gaps stay; the rest stands.
        """
        if not self.closing.any():
            return self
        obstacles = self.obstacles.copy()
        obstacles["x"] += shrinkage * self.closing[:, 0]
        obstacles["y"] += shrinkage * self.closing[:, 1]
        return dataclasses.replace(self, obstacles=obstacles)

    def of_class(self, hull: float) -> "DockingScenario":
        """Returns the scenario for a larger hull (m): the gaps stay, for they are the task."""
        return self.fitted(LARGEST_HULL - hull)

    def decisive(self) -> list[Any]:
        """Returns all numbers that decide an episode, in an order of their own."""
        return [*super().decisive(), self.closing]


def _family(name: str, about: str, dock: Callable[[Draw, Frame], "Dock | None"], **known: Any) -> Family:
    """Returns the family of a random dock."""

    def scenario(seed: int) -> DockingScenario:
        draw = Draw(name, seed)
        frame = somewhere(draw)
        heading, (x, y, turn), around = draw.until_one(lambda: dock(draw, frame))
        turned = [(frame.cosine * u - frame.sine * frame.side * v, frame.sine * u + frame.cosine * frame.side * v)
                  for _, (u, v) in around]  # fmt: skip
        return DockingScenario(
            f"{name}_{seed}",
            goal=(*frame.point(0.0, 0.0), _within(frame.turned(heading))),
            start=(*frame.point(x, y), _within(frame.turned(turn))),
            obstacles=obstacle_field(*(obstacle for obstacle, _ in around)),
            closing=np.array([[rounded(u), rounded(v)] for u, v in turned]).reshape(-1, 2),
            family=name,
        )

    return Family(name, about, scenario, **known)


def _within(heading: float) -> float:
    """Returns a heading within half a turn."""
    return rounded(math.remainder(heading, 2.0 * math.pi))


def _at(distance: float, angle: float) -> Point:
    """Returns the point at a distance (m) in a direction (rad)."""
    sine, cosine = sin_cos(angle)
    return distance * cosine, distance * sine


def _open(draw: Draw, frame: Frame) -> Dock:
    """A pose within 3 m, in any direction, with any heading."""
    place = _at(draw.number(0.3, FARTHEST_START), draw.heading())
    return 0.0, (*place, draw.heading()), []


def _behind(draw: Draw, frame: Frame) -> Dock:
    """A pose beside or behind the robot, that looks the robot's way but for half a radian."""
    turn = draw.number(-0.5, 0.5)
    # the bearing of the pose from the robot: from straight to the left over behind to straight to the right
    side = turn + draw.number(0.5, 1.5) * math.pi
    x, y = _at(draw.number(0.3, FARTHEST_START), side)
    return 0.0, (-x, -y, turn), []


def _wall(draw: Draw, frame: Frame) -> Dock:
    """A pose with its back to a wall."""
    at = -(LARGEST_HULL + WALL_GAP)
    left, right = draw.number(0.5, 2.0), draw.number(0.5, 2.0)
    x, y = _at(draw.number(0.8, FARTHEST_START), draw.number(-1.2, 1.2))
    standing = wall(*frame.point(at, -right), *frame.point(at, left))
    return 0.0, (x, y, draw.heading()), [(standing, (1.0, 0.0))]


def _berth(draw: Draw, frame: Frame) -> Dock:
    """A pose between two boxes, that looks in or out."""
    around: list[tuple[np.void, Point]] = []
    for side in (-1.0, 1.0):
        length, width = draw.number(0.6, 1.0), draw.number(0.3, 0.8)
        y = side * (LARGEST_HULL + draw.number(*BERTH_GAPS) + 0.5 * width)
        ahead = draw.number(-0.1, 0.1)
        around.append((box(*frame.point(ahead, y), length, width, frame.turned(0.0)), (0.0, -side)))
    x, y = _at(draw.number(1.2, FARTHEST_START), draw.number(-1.0, 1.0))
    return (0.0 if draw.sign() > 0.0 else math.pi), (x, y, draw.heading()), around


def _moving(draw: Draw, frame: Frame) -> Dock | None:
    """A pose behind the lane of a disc that goes to and fro."""
    distance = draw.number(2.2, FARTHEST_START)
    angle = draw.heading()
    x, y = _at(distance, angle)
    at, slant, reach = draw.number(0.4, 0.6), draw.number(-0.3, 0.3), draw.number(0.8, 1.5)
    side, radius = draw.sign(), draw.number(0.15, 0.25)
    sine, cosine = sin_cos(angle + side * (0.5 * math.pi + slant))
    ends = [frame.point(at * x + s * reach * cosine, at * y + s * reach * sine) for s in (-1.0, 1.0)]
    lane = (ends[0], ends[1], radius)
    if not keeps_off(lane, frame.point(0.0, 0.0), frame.point(x, y)):
        return None
    disc = disc_on_patrol(lane, draw.number(0.15, 0.4), draw.number(0.0, 1.0))
    return draw.heading(), (x, y, draw.heading()), [(disc, _STILL)]


# ---- what is proven


def way(scenario: DockingScenario, hull_radius: float = LARGEST_HULL) -> float:
    """Returns the length (m) of the shortest way that is proven for a hull; inf when none is found."""
    grids = lay_grids([scenario.grid], NO_GRIDS.frames.copy())
    field = scenario.obstacles[None].copy(), len(scenario.obstacles), *grids
    return float(_shortest(np.array(scenario.start), np.array(scenario.goal), field, hull_radius))


@allocating
def _shortest(start, goal, field, hull_radius):
    """Returns `way`; field: as `reeds_shepp.is_free` takes it."""
    best = np.inf
    plan = np.empty((PLAN, 2))
    moves = any_moves(field[0], 0, field[1])
    for k in range(2 * len(_STRAIGHTS) - 1):
        straight = _STRAIGHTS[(k + 1) // 2] * (1.0 if k % 2 else -1.0)
        length = plan_to(start, goal, RADIUS, straight, plan)
        if not length < best:
            continue
        for wait in range(_LONGEST_WAIT + 1 if moves else 1):
            if is_free(plan, RADIUS, start, length, field, hull_radius, (1.0 * wait, _PACE)):
                best = length
                break
    return best


def manoeuvre(scenario: DockingScenario) -> float:
    """Returns the quantity of a dock's tier, m, rounded to 1e-6: the length of the shortest way that is proven."""
    return round(way(scenario), 6)


def feasible(scenario: DockingScenario, hull: float = LARGEST_HULL) -> bool:
    """Returns whether a robot has room at the start and a proven way, within 3 m and not too long; hull: m, radius.

    A hull above 0.3 m need only be clear at the start: starts are not moved away from what is docked at.
    """
    obstacles = scenario.obstacles
    return (
        clearance(obstacles, len(obstacles), *scenario.start[:2]) >= hull + (ROOM if hull <= LARGEST_HULL else 0.0)
        and math.dist(scenario.start[:2], scenario.goal[:2]) <= FARTHEST_START + 1e-6
        and way(scenario, hull) <= _LONGEST_WAY
    )


def _sideways(hull_radius: float) -> tuple[DockingScenario, ...]:
    """Returns the textbook's case: a metre to the left, where no wheel of a differential drive rolls."""
    del hull_radius
    return (DockingScenario("sideways", goal=(0.0, 1.0, 0.0)),)


DOCKING_SCENARIOS: Mapping[str, Callable[[float], tuple[DockingScenario, ...]]] = {
    # A metre to the left, in the open: parallel parking.
    "sideways": _sideways,
}

DOCKING_FAMILIES: Mapping[str, Family] = {
    family.name: family
    for family in (
        _family("open", "nothing in the way, from any direction to any heading, at most 3 m", _open),
        _family("behind", "the pose lies beside or behind the robot and looks its way", _behind),
        _family("wall", "back up to a wall, 0.05 m from the hull", _wall),
        _family("berth", "between two boxes, 0.05 to 0.2 m from the hull on either side", _berth),
        _family("moving", "beyond a disc that goes to and fro", _moving, moving=True),
    )
}


REPERTOIRE = Repertoire(
    DockingScenario, DOCKING_SCENARIOS, DOCKING_FAMILIES, manoeuvre, feasible, LARGEST_HULL, lambda hull: 1.0
)
