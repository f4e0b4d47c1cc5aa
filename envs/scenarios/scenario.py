"""What an episode is about: the path or the goal, where the robot starts, what stands or moves in the way."""

import dataclasses
import math
from collections.abc import Collection, Iterable
from typing import Any, ClassVar, Self

import numpy as np
from numpy.typing import NDArray

from wayfield.envs.scenarios.obstacles import described, obstacle_field
from wayfield.envs.world.geometry import OBSTACLE, clearance_to
from wayfield.envs.world.grids import OccupancyGrid
from wayfield.envs.world.movers import PATROL, motion_at
from wayfield.envs.world.paths import Path, doubt
from wayfield.system.checks import (
    FARTHEST,
    FASTEST,
    FINEST,
    HEAVIEST,
    LIGHTEST,
    LONGEST,
    MOST_LAPS,
    MOST_OBSTACLES,
    MOST_TURN,
    SHORTEST,
    THINNEST,
    number,
    numbers_of,
    pose,
    real,
    shown,
)

LONG = 300.0  # m, of a way from which on it is in other units, most likely, unless its points or its map are of metres
CORRIDORS = 0.01, 20.0  # m, that are usual


# Compared by identity: arrays have no single truth value, and a bank never holds the same scenario twice.
@dataclasses.dataclass(frozen=True, eq=False)
class PathScenario:
    """A path to follow.

    Raises:
        ValueError: if a value is not finite or out of its range, or the start can lie outside the corridor;
            the message names the field and the value.
    """

    name: str
    path: Path
    laps: int = 1  # laps to drive on a closed path, 0 for no end but the clock; an open path has 1
    start: tuple[float, float, float] | None = None  # x, y (m), heading (rad); None: the first point, along the path
    start_offset: float = 0.0  # m, the lateral start offset is drawn from [-start_offset, start_offset]
    start_turn: float = 0.0  # rad, the start heading is turned by a draw from [-start_turn, start_turn]
    corridor: float = 1.0  # m, the episode fails when |cross-track error| exceeds it
    family: str = ""  # the family of a frozen split that it belongs to
    tier: str = ""  # "easy", "medium" or "hard" within the task
    quantity: float = math.nan  # what the tier is read from: the sharpness of the path, 1/m

    # what a file of one may say, besides the path
    file_fields: ClassVar[tuple[str, ...]] = ("closed", "laps", "start", "start_offset", "start_turn", "corridor")

    def __post_init__(self) -> None:
        check_labels(self)
        if not isinstance(self.path, Path):
            raise ValueError(f"path is {shown(self.path)}; it must be a Path")
        if not (np.abs(self.path.points) <= FARTHEST).all():
            raise ValueError(f"path has a point beyond {FARTHEST:g} m of the origin")
        if not self.path.length >= SHORTEST:
            raise ValueError(
                f"path is {self.path.length:g} m long; it must be at least {SHORTEST:g} m, and points are in metres"
            )
        whole = isinstance(self.laps, int | np.integer) and not isinstance(self.laps, bool)
        if not whole or not 0 <= self.laps <= MOST_LAPS:
            raise ValueError(f"laps is {shown(self.laps)}; it must be a whole number from 0 to {MOST_LAPS}")
        if self.laps != 1 and not self.path.closed:
            raise ValueError(f"laps is {self.laps}; an open path has 1 lap, only a closed one can have another number")
        _settle(self, "laps", int(self.laps))
        _settle(self, "start_offset", number("start_offset", self.start_offset, least=0.0))
        _settle(self, "start_turn", number("start_turn", self.start_turn, least=0.0, most=MOST_TURN))
        _settle(self, "corridor", number("corridor", self.corridor, above=0.0))
        distance = 0.0
        if self.start is not None:
            _settle(self, "start", pose("start", self.start))
            distance = _distance_to(self.path, *self.start[:2])
        if distance + self.start_offset > self.corridor:
            raise ValueError(
                f"start is {self.start} with start_offset {self.start_offset:g}, up to "
                f"{distance + self.start_offset:.3g} m from the path; the corridor is {self.corridor:g} m"
            )

    def scaled(self, scale: float) -> "PathScenario":
        """Returns the scenario with the positions of path and start multiplied; offsets and corridor stay.

        It has no tier: a larger path has wider bends.
        """
        path = Path(self.path.points * scale, self.path.closed)
        start = self.start and (self.start[0] * scale, self.start[1] * scale, self.start[2])
        return dataclasses.replace(self, path=path, start=start, tier="", quantity=math.nan)

    def doubt(self) -> str:
        """Returns what makes it one that robots may not follow as it is meant; "" where nothing does."""
        length = self.path.length
        apart = length / len(self.path.points)
        if length > LONG and apart > 1.0:
            return (
                f"the path is {length:,.0f} m long, {apart:,.0f} m from point to point; lengths are in m: scale 0.001 "
                "is for a path in mm, 0.01 for one in cm"
            )
        if not CORRIDORS[0] <= self.corridor <= CORRIDORS[1]:
            usual = f"usual is {CORRIDORS[0]:g} to {CORRIDORS[1]:g}"
            return f"corridor is {self.corridor:g} m, {usual}; lengths are in m"
        said = doubt(self.path)
        return f"the path {said}" if said else ""

    @property
    def length(self) -> float:
        """Returns the length (m) of the way: of all laps, or of one where only the clock ends them."""
        return max(self.laps, 1) * float(self.path.length)

    def decisive(self) -> list[Any]:
        """Returns all numbers that decide an episode, in an order of their own."""
        start = self.start or self.path.start_pose
        scatter = (self.start_offset, self.start_turn)
        points = self.path.points
        return [len(points), points, self.path.closed, start, scatter, self.laps, self.corridor]


@dataclasses.dataclass(frozen=True, eq=False)
class GoalScenario:
    """A pose to reach, past waypoints and around obstacles.

    Raises:
        ValueError: if a value is not finite or out of its range; the message names the field and the value.
    """

    name: str
    goal: tuple[float, float, float]  # x, y (m), heading (rad)
    start: tuple[float, float, float] = (0.0, 0.0, 0.0)  # x, y (m), heading (rad)
    waypoints: tuple[tuple[float, float], ...] = ()  # x, y (m), passed in this order before the goal
    # OBSTACLE records, shape (m,), read-only
    obstacles: NDArray[np.void] = dataclasses.field(default_factory=obstacle_field)
    start_offset: float = 0.0  # m, the start is drawn from a square of this half side, where it is clear
    start_turn: float = 0.0  # rad, the start heading is turned by a draw from [-start_turn, start_turn]
    position_tolerance: float = 0.1  # m
    heading_tolerance: float = 0.1  # rad; pi accepts every heading
    waypoint_radius: float = 0.5  # m, a waypoint counts as passed within it
    grid: OccupancyGrid | None = None  # what stands besides the obstacles
    family: str = ""  # the family of a frozen split that it belongs to
    tier: str = ""  # "easy", "medium" or "hard" within the task
    quantity: float = math.nan  # what the tier is read from: the room on the way, m
    published_length: float = math.nan  # m, of the way that the makers of a public benchmark give; NaN: they give none

    # what a file of one may say, besides the goal: the fields, with a grid as its "map"
    file_fields: ClassVar[tuple[str, ...]] = (
        *("start", "waypoints", "obstacles", "map", "start_offset", "start_turn"),
        *("position_tolerance", "heading_tolerance", "waypoint_radius"),
    )

    def __post_init__(self) -> None:
        check_labels(self)
        _settle(self, "goal", pose("goal", self.goal))
        _settle(self, "start", pose("start", self.start))
        if not isinstance(self.waypoints, Collection):
            raise ValueError(f"waypoints is {shown(self.waypoints)}; it must be a list of (x, y)")
        if len(self.waypoints) > MOST_OBSTACLES:
            raise ValueError(f"waypoints are {len(self.waypoints)}; there must be at most {MOST_OBSTACLES}")
        waypoints = [numbers_of(f"waypoints[{i}]", p, 2, "x, y") for i, p in enumerate(self.waypoints)]
        _settle(self, "waypoints", tuple(waypoints))
        _settle(self, "obstacles", _checked_obstacles(self.obstacles))
        if not (self.grid is None or isinstance(self.grid, OccupancyGrid)):
            raise ValueError(f"grid is {shown(self.grid)}; it must be an OccupancyGrid or None")
        for field, most in (("start_offset", FARTHEST), ("start_turn", MOST_TURN)):
            _settle(self, field, number(field, getattr(self, field), least=0.0, most=most))
        for field, most in (
            ("position_tolerance", FARTHEST),
            ("heading_tolerance", MOST_TURN),
            ("waypoint_radius", FARTHEST),
        ):
            _settle(self, field, number(field, getattr(self, field), above=0.0, most=most))
        if not (isinstance(self.published_length, float) and math.isnan(self.published_length)):
            _settle(self, "published_length", number("published_length", self.published_length, above=0.0))

    def doubt(self) -> str:
        """Returns what is said in other units than metres and seconds, by its size; "" where nothing is."""
        o, patrols = self.obstacles, self.obstacles["patrol"][self.moving]
        speeds, start = np.hypot(patrols["vx"], patrols["vy"]), self.start[:2]
        length, width = o["half_length"] + o["radius"], o["half_width"] + o["radius"]
        halves, area = np.minimum(length, width), np.maximum(4.0 * length * width, FINEST)
        away = np.hypot(o["x"] - start[0], o["y"] - start[1]) - length - width
        far = 2000.0 if self.grid is not None else LONG
        for what, value, most, unit in (
            ("the distance from start to goal", math.dist(start, self.goal[:2]), far, "m"),
            ("the distance from start to an obstacle", away.max(initial=0.0), far, "m"),
            ("the speed of a moving obstacle", speeds.max(initial=0.0), 15.0, "m/s"),
            ("the way of a moving obstacle", (speeds * patrols["leg_time"]).max(initial=0.0), far, "m"),
            ("half the width of an obstacle", halves.max(initial=0.0), 10.0, "m"),
            ("the mass of an obstacle over its area", (o["mass"] / area).max(initial=0.0), 3000.0, "kg/m^2"),
            ("waypoint_radius", self.waypoint_radius, 20.0, "m"),
            ("start_offset", self.start_offset, 20.0, "m"),
        ):
            if value > most:
                return f"{what} is {value:.4g} {unit}, usual is at most {most:g}; units are m, s, kg"
        return ""

    @property
    def moving(self) -> NDArray[np.bool_]:
        """Returns which obstacles (m,) move by themselves."""
        mask: NDArray[np.bool_] = self.obstacles["patrol"]["leg_time"] > 0.0
        return mask

    @property
    def fixed(self) -> NDArray[np.void]:
        """Returns the obstacles that stand for ever: they neither move nor can be pushed."""
        obstacles: NDArray[np.void] = self.obstacles[(self.obstacles["mass"] == 0.0) & ~self.moving]
        return obstacles

    def fitted(self, shrinkage: float) -> "GoalScenario":
        """Returns the scenario for a smaller hull: itself, with more room."""
        del shrinkage
        return self

    def scaled(self, factor: float, speeds: bool = False) -> Self:
        """Returns the scenario with all places and sizes multiplied; tolerances stay, in m.

        Args:
            speeds: whether moving obstacles are as many times as fast; else they keep their speeds and their patrols
                take as many times as long.
        """
        obstacles = self.obstacles.copy()
        for name in ("x", "y", "half_length", "half_width", "radius"):
            obstacles[name] *= factor
        for name in ("x", "y", *(("vx", "vy") if speeds else ("leg_time", "phase"))):
            obstacles["patrol"][name] *= factor
        (x, y, heading), (u, v, there) = self.start, self.goal
        return dataclasses.replace(
            self,
            start=(factor * x, factor * y, heading),
            goal=(factor * u, factor * v, there),
            obstacles=obstacles,
        )

    def of_class(self, hull: float) -> Self:
        """Returns the scenario of a family for a larger hull (m) than the one of 0.3 m that it was made for."""
        return self.scaled(hull / 0.3)

    def decisive(self) -> list[Any]:
        """Returns all numbers that decide an episode, in an order of their own."""
        o = self.obstacles
        x, y = o["half_length"] * o["cos"], o["half_length"] * o["sin"]
        # the ends of the long axis: those of a wall are whole numbers
        ends = [o["x"] - x, o["y"] - y, o["x"] + x, o["y"] + y]
        shapes = [*ends, 2.0 * o["half_width"], o["radius"], o["mass"]]
        moves = [o["patrol"][name] for name in PATROL.names or ()]
        tolerances = (self.position_tolerance, self.heading_tolerance, self.waypoint_radius)
        scatter = (self.start_offset, self.start_turn)
        sizes = len(o), len(self.waypoints)
        grid = [] if self.grid is None else self.grid.decisive()
        published = [] if math.isnan(self.published_length) else [self.published_length]
        return [sizes, self.start, self.goal, self.waypoints, *shapes, *moves, tolerances, scatter, *grid, *published]


def check_clear(scenario: GoalScenario, hull_radius: float) -> None:
    """Checks that a disc of `hull_radius` (m) fits at the start and at the goal, and can pass the waypoints.

    A waypoint may be nearer to an obstacle than the hull allows, since it need only be passed within its
    radius, but not so near that the radius does not make up for it, and not inside an obstacle.

    Raises:
        ValueError: naming the scenario, the place and the obstacle or the map that lies over it.
    """
    number("hull_radius", hull_radius, above=0.0)
    places = [
        ("start", scenario.start[:2], hull_radius),
        ("goal", scenario.goal[:2], hull_radius),
        *(
            (f"waypoints[{i}]", point, max(hull_radius - scenario.waypoint_radius, 0.0))
            for i, point in enumerate(scenario.waypoints)
        ),
    ]
    for place, (x, y), needed in places:
        if scenario.grid is not None:
            distance = float(scenario.grid.clearances(np.array([[x, y]]))[0])
            if distance < needed or distance <= 0.0:
                where = f"scenario {scenario.name!r}: the map {scenario.grid.name}"
                (west, south), (east, north) = scenario.grid.corners.min(axis=0), scenario.grid.corners.max(axis=0)
                if not (west <= x <= east and south <= y <= north):
                    where += f" spans x from {west:.4g} to {east:.4g} m and y from {south:.4g} to {north:.4g} m"
                    raise ValueError(f"{where}; the {place} at ({x:g}, {y:g}) lies outside")
                raise ValueError(
                    f"{where} is occupied or unknown over the {place} at ({x:g}, {y:g}): clearance {distance:.3g} m "
                    f"for a hull of radius {hull_radius:g} m"
                )
        for j, obstacle in enumerate(scenario.obstacles):
            distance = clearance_to(obstacle, x, y)
            if distance < needed or distance <= 0.0:
                raise ValueError(
                    f"scenario {scenario.name!r}: obstacles[{j}] ({described(obstacle)}) is over the {place} "
                    f"at ({x:g}, {y:g}): clearance {distance:.3g} m for a hull of radius {hull_radius:g} m"
                )


def check_labels(scenario: Any) -> None:
    """Raises ValueError, naming the field, unless a scenario's labels are text and its measures numbers, or NaN."""
    for field in ("name", "family", "tier", "proof"):
        if not isinstance(getattr(scenario, field, ""), str):
            raise ValueError(f"{field} is {shown(getattr(scenario, field))}; it must be text")
    for field in ("quantity", "bound"):
        value = getattr(scenario, field, math.nan)
        if not (abs(real(value)) <= FARTHEST or (isinstance(value, float) and math.isnan(value))):
            raise ValueError(f"{field} is {shown(value)}; it must be a number of at most {FARTHEST:g} in size, or NaN")


def _settle(scenario: PathScenario | GoalScenario, field: str, value: Any) -> None:
    """Sets a field of a frozen scenario to its checked value."""
    object.__setattr__(scenario, field, value)


def _checked_obstacles(obstacles: Any) -> NDArray[np.void]:
    """Returns a read-only copy of OBSTACLE records, shape (m,); ValueError names the record that is no
    obstacle."""
    if not isinstance(obstacles, Iterable):
        raise ValueError(f"obstacles is {shown(obstacles)}; it must be a list of OBSTACLE records")
    records = list(obstacles)
    if len(records) > MOST_OBSTACLES:
        raise ValueError(f"obstacles are {len(records)}; there must be at most {MOST_OBSTACLES}")
    for j, record in enumerate(records):
        # NumPy would spread a plain number over all fields of a record
        if not isinstance(record, np.void) or record.dtype != OBSTACLE:
            raise ValueError(f"obstacles[{j}] is {shown(record)}; it must be an OBSTACLE record: circle, box or wall")
    field = obstacle_field(*records)
    if not records:  # as of each robot of a team but the first
        return field
    sizes = ("half_length", "half_width", "radius", "mass")
    for name in (each for each in OBSTACLE.names or () if each != "patrol"):
        bad = np.flatnonzero(~np.isfinite(field[name]) | ((field[name] < 0.0) & (name in sizes)))
        if len(bad):
            raise ValueError(
                f"obstacles[{bad[0]}].{name} is {field[name][bad[0]]}; it must be finite"
                + (" and at least 0" if name in sizes else "")
            )
        # what the constructors allow, for records that were made without them
        if name == "mass":
            bad = np.flatnonzero((field[name] > 0.0) & ~((field[name] >= LIGHTEST) & (field[name] <= HEAVIEST)))
        else:
            bad = np.flatnonzero(np.abs(field[name]) > (1.0 + 1e-9 if name in ("cos", "sin") else 2.0 * FARTHEST))
        if len(bad):
            raise ValueError(f"obstacles[{bad[0]}].{name} is {field[name][bad[0]]}; it is out of bounds")
    thickness = 2.0 * (np.minimum(field["half_length"], field["half_width"]) + field["radius"])
    thin = np.flatnonzero((field["mass"] > 0.0) & (thickness < THINNEST))
    if len(thin):
        raise ValueError(
            f"obstacles[{thin[0]}] ({described(field[thin[0]])}) has a mass and is {thickness[thin[0]]:g} m thick; "
            f"what can be pushed must be at least {THINNEST:g} m thick"
        )
    _check_patrols(field)
    return field


def _check_patrols(obstacles: NDArray[np.void]) -> None:
    """Checks how OBSTACLE records move.

    Raises:
        ValueError: if a patrol is not finite, does not begin where its obstacle is, or moves what cannot move.
    """
    patrols = obstacles["patrol"]
    for name in PATROL.names or ():
        bad = np.flatnonzero(~np.isfinite(patrols[name]) | ((patrols[name] < 0.0) & (name == "leg_time")))
        if len(bad):
            raise ValueError(
                f"obstacles[{bad[0]}].patrol.{name} is {patrols[name][bad[0]]}; it must be finite"
                + (" and at least 0" if name == "leg_time" else "")
            )
    most = {"x": FARTHEST, "y": FARTHEST, "vx": FASTEST, "vy": FASTEST, "leg_time": LONGEST, "phase": LONGEST}
    for j in np.flatnonzero(patrols["leg_time"]):
        obstacle, field = obstacles[j], f"obstacles[{j}].patrol"
        for name in PATROL.names or ():
            number(f"{field}.{name}", patrols[name][j].item(), most=most[name])
        number(f"{field}.leg_time", patrols["leg_time"][j].item(), least=SHORTEST, most=LONGEST)
        number(f"{field}.phase", patrols["phase"][j].item(), least=0.0, most=LONGEST)
        if obstacle["half_length"] > 0.0 or obstacle["half_width"] > 0.0 or obstacle["mass"] > 0.0:
            raise ValueError(f"obstacles[{j}] ({described(obstacle)}) has a patrol; only a circle of mass 0 moves")
        x, y, _, _ = motion_at(obstacle, 0.0)
        if max(abs(x - obstacle["x"]), abs(y - obstacle["y"])) > 1e-9:
            raise ValueError(
                f"obstacles[{j}] ({described(obstacle)}) is not where its patrol begins, at ({x:g}, {y:g})"
            )


def _distance_to(path: Path, x: float, y: float) -> float:
    """Returns the distance (m) from a point to the polyline."""
    vertices = path.vertices
    dx, dy = x - vertices["x"][:-1], y - vertices["y"][:-1]
    ux, uy = vertices["ux"][:-1], vertices["uy"][:-1]
    along = np.clip(dx * ux + dy * uy, 0.0, np.diff(vertices["s"]))
    return float(np.hypot(dx - along * ux, dy - along * uy).min())
