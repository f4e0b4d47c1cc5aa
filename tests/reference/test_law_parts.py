"""Reference implementations of parts that laws share: bands, maps, recoveries, linear programs, ways."""

import dataclasses
import itertools
import math
from typing import Any

import numpy as np
import pytest
from oracles.local_planning import briefing_of

import wayfield  # noqa: F401  registers the environments
from wayfield.envs.robots import ROBOTS
from wayfield.envs.robots.records import aligned
from wayfield.policies.nav2_dwb import Nav2Dwb
from wayfield.policies.parts import polyline_tracker, scan_map
from wayfield.policies.parts.params import params
from wayfield.policies.parts.polyline_tracker import plan_fields
from wayfield.policies.parts.scan_map import CELLS, CHART, stamps
from wayfield.policies.parts.steering import velocity_twists
from wayfield.policies.parts.stopping import Scan
from wayfield.policies.training.ways import sweep
from wayfield.system.compiled import compiled

DT = 0.05
CELL, SIDE, POINTS = 0.1, 60, 40  # m, cells, points
FARTHEST, UNIT = 1.275, 0.005  # m

relaxed = compiled(lambda m, held, wanted, least, rounds: polyline_tracker.relax(m[0], held, wanted, least, rounds))
is_clear = compiled(lambda m, reach, needed: polyline_tracker.plan_is_clear(m[0], reach, needed))
entered = compiled(lambda m, table, scan, pose, radius: scan_map.enter_scan(m[0], table, scan, 0, pose, radius))
moved = compiled(lambda m, x, y: scan_map.move_grid(m[0], x, y))


# The elastic band.


def banded(rng: np.random.Generator, points: Any) -> Any:
    """Returns the memory (1,) of a band of these points, on a grid with two discs."""
    memory = np.zeros(1, aligned([*plan_fields(POINTS), ("grid", np.uint8, (SIDE, SIDE))]))
    ys, xs = np.mgrid[:SIDE, :SIDE] * CELL + 0.5 * CELL
    clear = np.full((SIDE, SIDE), FARTHEST)
    for _ in range(2):
        x, y = points[rng.integers(len(points))] + rng.normal(0.0, 0.3, 2)
        clear = np.minimum(clear, np.hypot(xs - x + 1.0, ys - y + 2.0) - rng.uniform(0.1, 0.3))
    memory["grid"] = np.ceil((FARTHEST - np.clip(clear, 0.0, FARTHEST)) / UNIT)
    memory["origin"], memory["cell"] = (1.0, 2.0), CELL
    memory["num_points"] = len(points)
    memory["points"][0, : len(points)] = points
    return memory


def clearance(memory: Any, x: float, y: float) -> float:
    grid = memory["grid"][0]
    u, v = (x - 1.0) / CELL - 0.5, (y - 2.0) / CELL - 0.5
    column, row = math.floor(u), math.floor(v)
    if not (0 <= column < SIDE - 1 and 0 <= row < SIDE - 1):
        return FARTHEST
    u, v = u - column, v - row
    level = (1 - v) * ((1 - u) * grid[row, column] + u * grid[row, column + 1])
    level += v * ((1 - u) * grid[row + 1, column] + u * grid[row + 1, column + 1])
    return float(FARTHEST - UNIT * level)


def arc_of(points: Any) -> list[float]:
    lengths = [math.dist(a, b) for a, b in itertools.pairwise(points)]
    return [0.0, *itertools.accumulate(lengths)]


@pytest.mark.parametrize("seed", range(6))
def test_a_band_shortens_and_moves_off_what_is_near_across_itself(seed: int) -> None:
    rng = np.random.default_rng(seed)
    turns = np.cumsum(rng.normal(0.0, 0.4, POINTS - 3))
    points = np.cumsum(0.1 * np.column_stack([np.cos(turns), np.sin(turns)]), axis=0)
    points += (4.0, 5.0) - points.mean(axis=0)
    memory = banded(rng, points)
    held = np.zeros(POINTS, np.bool_)
    held[[0, 11, len(points) - 1]] = True
    wanted, least, band = 0.5, 0.2, points.tolist()
    relaxed(memory, held, wanted, least, 5)
    pushed = stayed = 0
    for _ in range(5):
        for k in range(1, len(band) - 1):
            if held[k]:
                continue
            (x, y), before, after = band[k], band[k - 1], band[k + 1]
            to = [a + 0.4 * (0.5 * (b + c) - a) for a, b, c in zip((x, y), before, after, strict=True)]
            here = clearance(memory, x, y)
            if here < wanted:
                pushed += 1
                half = 0.5 * CELL
                gx = clearance(memory, x + half, y) - clearance(memory, x - half, y)
                gy = clearance(memory, x, y + half) - clearance(memory, x, y - half)
                tx, ty = after[0] - before[0], after[1] - before[1]
                # the part of the gradient that is across the band
                share = (tx * gy - ty * gx) / (tx * tx + ty * ty)
                size = min(0.4 * (wanted - here), 0.04) / max(2.0 * half, math.hypot(gx, gy))
                to = [to[0] - size * share * ty, to[1] + size * share * tx]
            if clearance(memory, *to) >= min(least, here):
                band[k] = to
            else:
                stayed += 1
    assert pushed > 20
    np.testing.assert_allclose(memory["points"][0, : len(band)], band, atol=1e-9)
    np.testing.assert_allclose(memory["arc"][0, : len(band)], arc_of(band), atol=1e-9)
    # what lies ahead is clear as far as it is asked about
    memory["segment"] = 4
    found = set()
    for reach, needed in itertools.product((0.0, 0.3, 1.0, 9.0), (0.003, 0.1, 0.3, 1.2)):
        arc = arc_of(band)
        asked = [k for k in range(5, len(band)) if arc[k] <= arc[4] + reach]
        wanted_clear = all(clearance(memory, *band[k]) >= needed for k in asked)
        assert is_clear(memory, reach, needed) == wanted_clear
        found.add(wanted_clear)
    assert found == {True, False}


# A map of one's own scans.


class Chart:
    """What scans say of each cell: a count of the evidence, and the spots of the hits."""

    def __init__(self, cell: float, origin: tuple[float, float]) -> None:
        self.cell, self.origin = cell, origin
        self.evidence: dict[tuple[int, int], int] = {}
        self.spots: dict[tuple[int, int], set[int]] = {}

    def at(self, x: float, y: float) -> tuple[float, float]:
        return (x - self.origin[0]) / self.cell, (y - self.origin[1]) / self.cell

    def weaken(self, cell: tuple[int, int]) -> None:
        was = self.evidence.get(cell, 0)
        if was == 127:
            return
        self.evidence[cell] = max(was - 1, -4)
        if self.evidence[cell] <= 0 and self.spots.get(cell):
            self.evidence[cell] = -1
            self.spots[cell] = set()

    def scan(self, pose: Any, angles: Any, ranges: Any, reach: float, radius: float) -> None:
        u, v = self.at(*pose[:2])
        span = int(radius / self.cell)
        for row, column in itertools.product(range(-span, span + 1), repeat=2):
            if row * row + column * column <= span * span:
                self.weaken((int(v) + row, int(u) + column))
        for angle, distance in zip(angles + pose[2], ranges, strict=True):
            length = min(distance, reach) / self.cell - 1.0
            along = [math.cos(angle), math.sin(angle)]
            # where the beam crosses lines of the grid, up to a cell before its end
            cuts = [
                ((line - start) / step, axis)
                for axis, (start, step) in enumerate(zip((u, v), along, strict=True))
                for line in range(math.floor(min(start, start + length * step)) - 1, math.ceil(start + 99.0) + 99)
                if 0.0 <= (line - start) / step <= length
            ]
            column, row = int(u), int(v)
            for _, axis in sorted(cuts):
                column += (axis == 0) * round(math.copysign(1.0, along[0]))
                row += (axis == 1) * round(math.copysign(1.0, along[1]))
                if not (0 <= row < CELLS and 0 <= column < CELLS):
                    break
                if -4 < self.evidence.get((row, column), 0) < 127:
                    self.weaken((row, column))
        for angle, distance in zip(angles + pose[2], ranges, strict=True):
            if distance >= reach * (1.0 - 1e-6):
                continue
            a, b = self.at(pose[0] + distance * math.cos(angle), pose[1] + distance * math.sin(angle))
            cell = math.floor(b), math.floor(a)
            if not (0 <= cell[0] < CELLS and 0 <= cell[1] < CELLS):
                continue
            if self.evidence.get(cell, 0) != 127:
                self.evidence[cell] = min(max(self.evidence.get(cell, 0), 0) + 6, 18)
            spot = int((b - cell[0]) * 4) * 4 + int((a - cell[1]) * 4)
            self.spots.setdefault(cell, set()).add(spot)


def test_a_map_is_drawn_of_scans_cell_by_cell_and_moves_with_the_robot() -> None:
    rng = np.random.default_rng(6)
    cell, reach, beams = 0.08, 3.0, 24
    memory = np.zeros(1, aligned([*CHART, ("origin", np.float64, (2,)), ("cell", np.float64)]))
    memory["cell"], memory["origin"] = cell, (-6.0, -5.0)
    table, chart = stamps(cell, 0.5), Chart(cell, (-6.0, -5.0))
    angles = np.linspace(-math.pi, math.pi, beams, endpoint=False) + 0.0123
    directions = np.column_stack([np.cos(angles), np.sin(angles)])
    barred = (66, 78)
    memory["evidence"][0][barred] = chart.evidence[barred] = 127
    ranges = rng.uniform(0.4, 3.4, beams)
    for step in range(14):
        if step in (5, 9):  # what stood there is gone, or nearer
            ranges = rng.uniform(0.4, 3.4, beams)
        pose = (0.313 + 0.011 * step, 0.273, 0.4 * (step % 2))
        seen = np.minimum(ranges, reach)[None]
        scan = Scan(seen, directions, reach, np.zeros((1, beams, 2)), np.zeros((1, beams, 2)))
        entered(memory, table, scan, pose, 0.25)
        chart.scan(pose, angles, ranges, reach, 0.25)
    evidence, spots = np.zeros((CELLS, CELLS), int), np.zeros((CELLS, CELLS), int)
    for at, count in chart.evidence.items():
        evidence[at] = count
    for at, found in chart.spots.items():
        spots[at] = sum(1 << each for each in found)
    off = (memory["evidence"][0] != evidence) | (memory["spots"][0] != spots)
    assert off.sum() <= 2  # a corner of a cell that a beam passes to the last digit
    assert {-4, -1, 6, 18, 127} <= set(evidence.ravel())
    before = memory.copy()
    moved(memory, 0.9, -0.7)
    columns = math.floor((0.9 + 6.0) / cell) - CELLS // 2
    rows = math.floor((-0.7 + 5.0) / cell) - CELLS // 2
    assert columns > 0 > rows
    np.testing.assert_allclose(memory["origin"][0], (-6.0 + columns * cell, -5.0 + rows * cell))
    for name in ("grid", "evidence", "spots"):
        whole = np.zeros((3 * CELLS, 3 * CELLS), before[name].dtype)
        whole[CELLS : 2 * CELLS, CELLS : 2 * CELLS] = before[name][0]
        seen = whole[CELLS + rows : 2 * CELLS + rows, CELLS + columns : 2 * CELLS + columns]
        np.testing.assert_array_equal(memory[name][0], seen)


# What a robot does that does not get on.


# Twists and velocities.


@pytest.mark.parametrize("name", ["p3dx", "omni4"])
def test_a_planar_velocity_is_driven_or_turned_to(name: str) -> None:
    rng = np.random.default_rng(4)
    velocity = np.vstack([rng.normal(size=(9, 2)), [[-1.0, 0.0], [0.0, -1.0], [1.0, 0.0], [0.0, 0.0], [-1e-3, 0.0]]])
    turn = rng.normal(size=len(velocity))
    for (vx, vy), wanted, twist in zip(velocity, turn, velocity_twists(ROBOTS[name], velocity, turn, 1.7), strict=True):
        error = math.atan2(vy, vx) if (vx, vy) != (0.0, 0.0) else 0.0
        other = [vx, vy, 1.7 * wanted]
        assert twist.tolist() == pytest.approx([max(vx, 0.0), 1.7 * error] if name == "p3dx" else other, abs=1e-12)


# The shortest way.


def test_a_way_solves_the_eikonal_equation_to_the_end_of_a_spiral() -> None:
    side, cell = 33, 0.1
    costs = np.full((side, side), cell)
    row, column, length = side - 2, 1, side - 2
    walls = np.zeros((side, side), bool)
    for k in range(14):  # arms of a spiral, two cells from each other
        for _ in range(max(length, 0)):
            walls[row, column] = True
            row += (0, -1, 0, 1)[k % 4]
            column += (1, 0, -1, 0)[k % 4]
        length -= 2 if k else 1
    costs[walls] = 10.0 * cell
    ways = np.full((side, side), np.inf)
    ways[side // 2, side // 2] = 0.0
    sweep(costs, ways)
    assert np.isfinite(ways).all()
    beyond = np.pad(ways, 1, constant_values=np.inf)
    low = np.minimum(beyond[:-2, 1:-1], beyond[2:, 1:-1]), np.minimum(beyond[1:-1, :-2], beyond[1:-1, 2:])
    a, b = np.minimum(*low), np.maximum(*low)
    with np.errstate(invalid="ignore"):
        both = 0.5 * (a + b + np.sqrt(2.0 * costs**2 - (b - a) ** 2))
    wanted = np.where(b - a >= costs, a + costs, both)
    wanted[side // 2, side // 2] = 0.0
    np.testing.assert_allclose(ways, wanted, atol=2e-6)
    assert ways.max() > 2.0 * math.hypot(side, side) * 0.5 * cell  # round the arms, not straight


# What laws read.


def test_a_law_reads_its_gains_and_the_sheet_of_its_robot_and_may_not_write() -> None:
    briefing = briefing_of("omni4")
    policy = Nav2Dwb(max_speed=0.47, speeds=9)
    made = params(policy, briefing, cell=0.3, more=4)
    assert params(policy, briefing, cell=0.3, more=4) is made
    assert params(policy, briefing, cell=0.4, more=4) is not made
    assert params(policy, briefing_of("p3dx"), cell=0.3, more=4) is not made
    (p,) = made
    for field in dataclasses.fields(policy):
        assert p[field.name] == (0.3 if field.name == "cell" else getattr(policy, field.name))
    assert p["more"] == 4
    assert {name for name, (kind, *_) in made.dtype.fields.items() if kind == np.int64} == {
        "more", *(field.name for field in dataclasses.fields(policy) if field.type in (int, bool))
    }  # fmt: skip
    robot, base, plant = briefing.robot, briefing.actuators, p["plant"]
    decay = math.exp(-DT / base.lag)
    told = {
        "dt": DT, "holonomic": 1, "hull_radius": robot.hull_radius, "num_wheels": 4, "lag": base.lag,
        "acceleration": base.acceleration, "yaw_acceleration": base.yaw_acceleration, "turn_speed": robot.turn_speed,
        "wheel_speed_limit": robot.rated_wheel_speed if base.at_rated_speed else robot.peak_wheel_speed,
        "lag_decay": decay, "lag_mean": (1.0 - decay) * base.lag / DT,
    }  # fmt: skip
    assert {name: plant[name] for name in told} == pytest.approx(told)
    np.testing.assert_array_equal(plant["wheel_matrix"], np.vstack([robot.wheel_matrix, np.zeros((4, 3))]))
    with pytest.raises(ValueError, match="read-only"):
        made["max_speed"] = 1.0
