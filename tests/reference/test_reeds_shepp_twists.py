"""Reference implementation of the law along Reeds and Shepp's shortest ways gives the same twists."""

import itertools
import json
import math
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
import pytest

import wayfield  # noqa: F401  registers the environments
from wayfield.envs.robots import ROBOTS
from wayfield.envs.world.reeds_shepp import plan_to
from wayfield.policies import Pilot
from wayfield.policies.poses.reeds_shepp import ReedsShepp

DT = 0.05


def wrap(angle: float) -> float:
    return math.remainder(angle, 2.0 * math.pi)


def plans(start: Any, goal: Any, radius: float) -> list[tuple[float, Any]]:
    """Returns the length (m) and the pieces of each way, that without a straight end first."""
    ways = []
    for straight in (0.0, *(sign * 0.3 * k for k in range(1, 6) for sign in (1.0, -1.0))):
        plan = np.zeros((6, 2))
        ways.append((plan_to(np.array(start), np.array(goal), radius, straight, plan), plan))
    return ways


class Way:
    """A plan from a pose on, of pieces (turn, length in radii), and how far along it the robot is."""

    def __init__(self, start: Any, goal: Any, radius: float, plan: Any = None) -> None:
        self.start, self.radius, self.along = start, radius, 0.0
        # where nothing stands the shortest
        self.length, plan = plan or min(plans(start, goal, radius), key=lambda way: way[0])
        self.pieces = [(turn, length) for turn, length in plan if abs(length) > 1e-9]
        self.ends = radius * np.cumsum([abs(length) for _, length in self.pieces])

    def piece(self, s: float) -> int:
        """Returns the piece at arc length s, beyond the end the last."""
        return min(int(np.searchsorted(self.ends, s + 1e-9, side="right")), len(self.pieces) - 1)

    def pose(self, s: float) -> tuple[float, float, float]:
        x, y, th = self.start
        for (turn, length), end in zip(self.pieces, self.ends, strict=True):
            size = abs(length)
            there = math.copysign(min(max((s - end) / self.radius + size, 0.0), size), length)
            if turn:
                x += self.radius * (math.sin(th + turn * there) - math.sin(th)) / turn
                y -= self.radius * (math.cos(th + turn * there) - math.cos(th)) / turn
            else:
                x, y = x + self.radius * there * math.cos(th), y + self.radius * there * math.sin(th)
            th += turn * there
        return x, y, th

    @property
    def way(self) -> float:
        if self.along >= self.length - 1e-9:
            return 0.0
        return math.copysign(1.0, self.pieces[self.piece(self.along)][1])

    @property
    def leg_end(self) -> float:
        begun = [0.0, *self.ends]
        for k, (_, length) in enumerate(self.pieces):
            if begun[k + 1] > self.along + 1e-9 and length * self.way < 0.0:
                return begun[k]
        return self.length

    def bend(self, s: float) -> float:
        return self.pieces[self.piece(s)][0] / self.radius

    def advance(self, x: float, y: float) -> bool:
        """Moves on to the nearest place in the next 0.15 m; returns whether that is within 0.15 m of the robot."""
        end = self.leg_end
        last = min(self.along + 0.15, end)
        places = [*np.arange(self.along, last - 1e-12, 0.005), last]
        away = [math.dist(self.pose(s)[:2], (x, y)) for s in places]
        self.along = float(places[int(np.argmin(away))])
        if end - self.along < 0.01 and end < self.length:
            self.along = end + 1e-6
        return min(away) <= 0.15


def driven(p: ReedsShepp, base: Any, way: Way | None, seen: Any, arrived: bool) -> tuple[Any, Way | None, bool]:
    """Returns the twist, the plan and whether the robot has arrived."""
    x, y, th = seen.pose[0]
    (gx, gy), turn = seen.goal[0], seen.goal_heading_error[0]
    left = math.inf if way is None else way.length - way.along
    back = -1.0 if way is not None and way.way < 0.0 else 1.0
    r = math.hypot(gx, gy)
    there = r <= 2.0 * p.arrival_radius and (arrived or r <= p.arrival_radius or back * gx <= 0.0)
    arrived = (arrived or left < 2.0 * p.arrival_radius or r < 0.005) and there
    if arrived:
        alpha = min(p.yaw_acceleration, base.yaw_acceleration)
        rate = min(p.turn_gain * abs(turn), math.sqrt(2.0 * alpha * abs(turn)), p.max_yaw_rate)
        return (0.0, math.copysign(rate, turn)), way, True
    if way is None or left < 0.005 or not way.advance(x, y):
        c, s = math.cos(th), math.sin(th)
        way = Way((x, y, th), (x + c * gx - s * gy, y + s * gx + c * gy, th + turn), p.radius)
    px, py, pth = way.pose(way.along)
    e, off, d = math.cos(pth) * (y - py) - math.sin(pth) * (x - px), wrap(th - pth), way.way or 1.0
    end, bend = way.leg_end, abs(way.bend(way.along))
    deceleration = min(p.deceleration, 0.5 * base.acceleration, 0.005 / base.lag**2)
    most = min(p.speed, 0.3 * p.settling / base.lag, p.max_yaw_rate / max(bend, 1e-9))
    v = min(most, math.sqrt(2.0 * deceleration * (end - way.along)))
    v = max(v, 0.02)
    kappa = way.bend(min(way.along + v * (base.lag + DT), end - 1e-6))
    w = d * v * kappa - v * (2.0 * off / p.settling + d * e / p.settling**2)
    share = min(1.0, p.max_yaw_rate / max(abs(w), 1e-12))
    return (share * d * v, share * w), way, False


STARTS = ([0.0, 0.0, 0.3], [-0.4, 0.5, -2.0], [0.1, -0.6, 1.2], [1.0, 0.7, 0.1], [2.2, 0.3, -0.9])


@pytest.mark.parametrize("tier", ["lagged", "slow"])
@pytest.mark.parametrize(
    "policy",
    [ReedsShepp(), ReedsShepp(radius=0.3, speed=0.6, deceleration=0.7, settling=0.25, arrival_radius=0.04,
                              turn_gain=1.3, yaw_acceleration=0.6, max_yaw_rate=0.9)],
    ids=["default", "other"],
)  # fmt: skip
def test_the_shortest_way_is_driven_as_the_docstring_says(policy: ReedsShepp, tier: str, tmp_path: Path) -> None:
    ends = legs = 0
    for start in STARTS:
        file = tmp_path / "scene.json"
        file.write_text(json.dumps({"goal": [0.9, 0.6, 1.9], "start": start, "obstacles": []}))
        env: Any = gymnasium.make_vec(
            "wayfield/DiffDriveGoalObstacles-v0", 1, vectorization_mode="vector_entry_point", scenario=str(file),
            actuators=tier, num_beams=0,
        )  # fmt: skip
        flat, _ = env.reset(seed=1)
        pilot = Pilot(policy, env)
        pilot.reset()
        way, arrived, base, rng = None, False, env.unwrapped.task.options.actuators, np.random.default_rng(2)
        for k in range(400):
            seen = pilot.briefing.layout.unpack(flat.astype(np.float64))
            command = pilot.command(flat)
            twist, way, arrived = driven(policy, base, way, seen, arrived)
            np.testing.assert_allclose(command[0], twist, atol=1e-6)
            assert way is not None
            memory = pilot.memory[0]
            assert memory["along"] == pytest.approx(way.along, abs=1e-9)
            assert (memory["radius"], memory["arrived"]) == (policy.radius, arrived)
            assert memory["length"] == pytest.approx(way.length)
            legs += way.leg_end < way.length
            # a little off what was asked for, so that there is something to bring down, and once far off
            noise = rng.normal(0.0, 0.02, (1, 2)) if k != 40 else np.array([[2.0, 3.0]])
            flat, _, ended, _, _ = env.step(command + noise)
            if ended[0]:
                ends += 1
                break
    assert ends == len(STARTS)
    assert legs > 20


def free_way(policy: ReedsShepp, start: Any, goal: Any, clear: Any) -> tuple[int, float, float] | None:
    """Returns which of the searches finds a way, its radius and its length (m); None where roundings decide.

    Args:
        clear: the room (m) that a hull has at a place.
    """
    room = min(clear(*start[:2]), clear(*goal[:2])) - 0.02  # at a wall there is no more to spare anywhere
    for search, (margin, radius) in enumerate(
        itertools.product((policy.margin, 0.0), (policy.radius, 0.5 * policy.radius))
    ):
        # of ways that are as long, to the last digits, either may be tried
        turned = [(*goal[:2], goal[2] + 2.0 * math.pi * k) for k in (0, 1, -1)]
        alike = [plans(start, each, radius) for each in turned]
        lengths = []
        for ways in zip(*alike, strict=True):
            found = set()
            for length, plan in ways[:1] + tuple(way for way in ways[1:] if not np.allclose(way[1], ways[0][1])):
                way, steps = Way(start, goal, radius, (length, plan)), math.ceil(length / 0.02)
                step = length / steps  # what is clear by half of it more at each is clear in between
                spare = min(clear(*way.pose(k * step)[:2]) for k in range(steps + 1)) - 0.5 * step
                found.add(None if abs(spare - min(margin, room)) < 1e-5 else spare > min(margin, room))
            if len(found) > 1 or None in found:
                return None
            if True in found:
                lengths.append(ways[0][0])
        if lengths:
            return search, radius, min(lengths)
    return 4, 0.0, plans(start, goal, policy.radius)[0][0]


def test_of_the_ways_that_spare_the_margin_the_shortest_is_taken(tmp_path: Path) -> None:
    """Or of those with half the radius, then without the margin; or none, which is counted."""
    policy, hull, rng = ReedsShepp(margin=0.15), ROBOTS["p3dx"].hull_radius, np.random.default_rng(31)
    file, searches = tmp_path / "scene.json", []
    for _ in range(25):
        start, goal = np.array([0.0, 0.0, rng.uniform(-3.1, 3.1)]), rng.uniform(-1.4, 1.4, 3) * (1.0, 1.0, 2.2)
        discs = []
        for x, y in rng.uniform(-1.8, 1.8, (40, 2)).tolist():
            least = min(math.dist((x, y), each[:2]) for each in (start, goal)) - hull - rng.uniform(0.01, 0.5)
            if least > 0.05 and len(discs) < 16:
                discs.append((x, y, min(least, 0.4)))
        obstacles = [{"kind": "circle", "x": x, "y": y, "radius": radius} for x, y, radius in discs]
        file.write_text(json.dumps({"goal": goal.tolist(), "start": start.tolist(), "obstacles": obstacles}))
        env: Any = gymnasium.make_vec(
            "wayfield/DiffDriveGoalObstacles-v0", 1, vectorization_mode="vector_entry_point", scenario=str(file),
            num_beams=0,
        )  # fmt: skip
        flat, _ = env.reset(seed=1)
        pilot = Pilot(policy, env)
        pilot.reset()
        pilot.command(flat)

        def clear(x: float, y: float, discs: Any = discs) -> float:
            return min(math.dist((x, y), disc[:2]) - disc[2] for disc in discs) - hull

        wanted = free_way(policy, start, goal, clear)
        if wanted is None:
            continue
        search, radius, length = wanted
        m = pilot.memory[0]
        assert (m["radius"], m["length"], m["no_path"]) == pytest.approx((radius, length, int(search == 4)), abs=1e-5)
        searches.append(search)
    assert set(searches) == {0, 1, 2, 3, 4}
