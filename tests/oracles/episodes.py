"""Episodes of every task in plain Python, from data sheets: draws, wheels, motion, sensors, rewards and ends."""

import cmath
import math
import statistics
from collections.abc import Iterator
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from gymnasium.utils.seeding import np_random
from numpy.typing import NDArray

import wayfield  # noqa: F401  registers the environments
from wayfield.envs.robots import ROBOTS

DT = 0.05
FULL = 2.0 * math.pi
# at noise 1: position, heading, encoders, ranges
NOISES = (0.01, 0.01, 0.02, 0.01)
# radius, track, slip, side slip, noise of pose, encoders and ranges, dropout, delay, shove
WRONG = {
    "none": (0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0, 0.0),
    "moderate": (0.01, 0.02, 0.05, 0.02, 1.0, 1.0, 1.0, 0.02, 1, 0.1),
    "severe": (0.03, 0.05, 0.15, 0.06, 3.0, 3.0, 3.0, 0.10, 3, 0.3),
    "wheel_error": (0.02, 0.03, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0, 0.0),
    "shove": (0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0, 0.2),
}
TIERS = {"ideal": (math.inf, math.inf, 0.0), "lagged": (1.0, 3.0, 0.1), "slow": (0.5, 1.5, 0.25)}


def wrap(angle: float) -> float:
    return math.remainder(angle, FULL)


def rolling(wheels: Any, track: float = 1.0, radii: float = 0.0) -> NDArray[np.float64]:
    """Returns the rates of wheels for unit twists: each holds on to the floor along the axis of its roller."""
    rows = []
    for k, wheel in enumerate(wheels):
        axis = cmath.rect(1.0, wheel.direction + wheel.roller_angle)
        radius = wheel.radius * (1.0 + (-1) ** k * radii) * math.cos(wheel.roller_angle)
        at = track * complex(wheel.x, wheel.y)
        rows.append([axis.real / radius, axis.imag / radius, (axis * (1j * at).conjugate()).real / radius])
    return np.array(rows)


class Robot:
    """Wheels, grip, encoders: from what is asked to where the base is and where it believes to be."""

    def __init__(self, name: str, actuators: str, action_mode: str, source: str, noise: float, wrong: str) -> None:
        self.base = base = ROBOTS[name]
        tier = TIERS[actuators]
        # data sheets say what "lagged" is; the tiers keep their proportions
        self.acceleration, self.yaw_acceleration, self.lag = (
            mine * (share / nominal)
            for mine, share, nominal in zip(
                (base.acceleration, base.yaw_acceleration, base.lag), tier, TIERS["lagged"], strict=True
            )
        )
        self.most = base.peak_wheel_speed if actuators == "ideal" else base.rated_wheel_speed
        self.twists, self.source = action_mode == "twist", source
        radii, track, slip, self.side_slip, pose, encoder, ranges, self.dropout, self.delay, self.shove = WRONG[wrong]
        self.wheels = rolling(base.wheels)
        true = rolling(base.wheels, 1.0 + track, radii)
        self.pull = (1.0 - slip) * np.linalg.pinv(true) @ self.wheels
        self.position, self.heading = NOISES[0] * (noise + pose), NOISES[1] * (noise + pose)
        self.encoder, self.range = NOISES[2] * (noise + encoder), NOISES[3] * (noise + ranges)
        self.noisy = max(self.position, self.encoder, self.range, self.dropout) > 0.0
        self.exact = source == "ground_truth" and max(noise + pose, noise + encoder, *WRONG[wrong][:4]) == 0.0
        # document B's two encoder wheels turn with the floor, beside a gyroscope; others are the driven ones
        self.passive = bool(base.encoders)
        self.read = np.vstack([rolling(base.encoders), [0.0, 0.0, 1.0]]) if self.passive else self.wheels
        believed = self.read.copy()
        if source == "odometry_uncorrected":
            believed[:2, 2] = 0.0
        self.believe = np.linalg.pinv(believed)

    def asked(self, action: Any, s: Any) -> NDArray[np.float64]:
        """Returns the twist that the motors are told."""
        if not self.twists:
            twist = np.linalg.pinv(self.wheels) @ action
        else:
            twist = np.array([action[0], action[1] if len(action) == 3 else 0.0, action[-1]])
        share = min(1.0, self.most / max(np.abs(self.wheels @ twist).max(), 1e-300))
        share = min(share, self.base.turn_speed / max(abs(twist[2]), 1e-300))
        change = share * twist - s.command
        speed = math.hypot(*change[:2])
        change[:2] *= min(1.0, self.acceleration * DT / max(speed, 1e-300))
        change[2] = min(max(change[2], -self.yaw_acceleration * DT), self.yaw_acceleration * DT)
        return np.asarray(s.command + change)

    def lagging(self, s: Any, time: float) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Returns the twists that the wheels turn for, on average over a time and at its end."""
        if self.lag == 0.0:
            return s.command, s.command
        late, left = s.wheels - s.command, math.exp(-time / self.lag)
        return s.command + late * (self.lag / time * (1.0 - left)), s.command + late * left

    def of_body(self, wheels: Any) -> NDArray[np.float64]:
        vx, vy, w = self.pull @ wheels
        return np.array([vx + self.side_slip * w * vy, vy - self.side_slip * w * vx, w])

    def measured(self, twist: Any, row: Any) -> NDArray[np.float64]:
        rates = self.read @ twist
        if self.encoder > 0.0:
            rates = rates * (1.0 + self.encoder * row[3 : 3 + len(rates)])
        return np.asarray(self.believe @ rates)


def moved(pose: Any, twist: Any, time: float) -> tuple[float, float, float]:
    """Returns where a constant twist leads: round its centre, or straight on."""
    x, y, heading = pose
    velocity, turn = complex(twist[0], twist[1]), twist[2] * time
    if abs(turn) < 1e-9:
        way = velocity * time * cmath.rect(1.0, heading + 0.5 * turn)
    else:
        centre = 1j * velocity / twist[2]  # in the body frame
        way = cmath.rect(1.0, heading) * centre * (1.0 - cmath.rect(1.0, turn))
    return x + way.real, y + way.imag, wrap(heading + turn)


class Bank:
    """What the two kinds of tasks share: the episode's draws, the motion until something is touched, the sensors."""

    draws = 0
    beams: NDArray[np.float64] = np.empty(0)
    max_range = 0.0

    def __init__(self, env: Any, robot: Robot, shove: Any) -> None:
        self.scenarios, self.robot, self.shove = env.task.scenarios, robot, shove

    def reset(self, s: Any) -> None:
        r, rng = self.robot, s.rng
        draws = rng.random(1 + self.draws + 2 * (r.shove > 0.0))
        if r.noisy:
            s.noise = rng.standard_normal((64, 7 + len(self.beams) * (2 if r.dropout else 1)))
        else:
            s.noise = np.zeros((512, 7))  # of more steps than any clock has
        s.row = 0
        s.scenario = self.scenarios[int(draws[0] * len(self.scenarios))]
        s.steps, s.contact = 0, False
        s.command = s.wheels = s.twist = np.zeros(3)
        s.late = [np.zeros(len(r.wheels))] * r.delay
        s.shove = None
        if r.shove > 0.0:
            s.shove = int((2.0 + 4.0 * draws[-2]) / DT), r.shove * cmath.rect(1.0, FULL * draws[-1])
        self.place(s, draws)
        s.odometry = s.pose
        self.look(s, first=True)

    def place(self, s: Any, draws: Any) -> None:
        raise NotImplementedError

    def look(self, s: Any, first: bool = False) -> None:
        raise NotImplementedError

    def room(self, s: Any, pose: Any) -> float:
        """Returns how far the hull is from what stands and moves."""
        return math.inf

    def go(self, s: Any, twist: Any) -> None:
        """Moves the hull along an arc, at most until it touches something that it comes nearer to."""
        start, low, high = s.pose, 0.0, 1.0
        if self.room(s, start) < DT * math.hypot(*twist[:2]) + 1e-6:
            before = self.room(s, start)
            for k in range(1, 201):
                room = self.room(s, moved(start, twist, DT * k / 200))
                if room < 0.0 and room < before:
                    s.contact, low, high = True, (k - 1) / 200, k / 200
                    break
                before = room
            while s.contact and high - low > 1e-9:
                middle = 0.5 * (low + high)
                low, high = (low, middle) if self.room(s, moved(start, twist, DT * middle)) < 0.0 else (middle, high)
        s.pose = moved(start, twist, DT * (low if s.contact else 1.0))

    def step(self, s: Any, action: Any) -> None:
        r = self.robot
        if r.noisy and s.row >= 64:
            s.noise, s.row = s.rng.standard_normal(s.noise.shape), 0
        s.late.append(np.asarray(action, float))
        s.contact = False
        s.command = r.asked(s.late.pop(0), s)
        s.time = (s.steps + 1) * DT  # what moves by itself moves first
        s.contact = self.room(s, s.pose) < 0.0 and self.moves(s)
        if not s.contact:
            self.be_shoved(s)
        if not s.contact:
            self.drive(s)
        if s.contact:
            s.twist = np.zeros(3)
        s.steps += 1
        self.look(s)

    def drive(self, s: Any) -> None:
        """Lets the wheels follow what they are told, by a first-order lag, and the body the wheels."""
        r = self.robot
        mean, s.wheels = r.lagging(s, DT)
        s.twist = r.of_body(s.wheels)
        rolled = r.of_body(mean)
        self.go(s, rolled)
        s.odometry = moved(s.odometry, r.measured(rolled if r.passive else mean, s.noise[s.row]), DT)

    def moves(self, s: Any) -> bool:
        return any(each["patrol"]["leg_time"] > 0.0 for each in getattr(s.scenario, "obstacles", ()))

    def be_shoved(self, s: Any) -> None:
        way, turn, now = 0j, 0.0, False
        if self.shove and s.steps == round(self.shove[0] / DT):
            way, turn, now = complex(*self.shove[1:3]), self.shove[3], True
        if s.shove and s.steps == s.shove[0]:
            way, now = way + s.shove[1], True
        if now:
            velocity = way / DT * cmath.rect(1.0, -s.pose[2])
            self.go(s, (velocity.real, velocity.imag, 0.0))
            s.pose = (*s.pose[:2], wrap(s.pose[2] + turn))

    def sense(self, s: Any) -> Iterator[float]:
        """Yields measured pose and twist, and notes the former."""
        r, row = self.robot, s.noise[s.row]
        s.seen, twist = s.pose, s.twist
        if r.source != "ground_truth":
            s.seen = s.odometry
        elif not r.exact:
            x, y, heading = s.pose
            s.seen = x + r.position * row[0], y + r.position * row[1], wrap(heading + r.heading * row[2])
        if not r.exact:
            twist = r.measured(s.twist if r.passive else s.wheels, row)
        yield from s.seen
        yield from twist[[0, 1, 2] if r.base.holonomic else [0, 2]]


def turned_to(pose: Any, x: float, y: float) -> complex:
    """Returns a point as it is seen from a pose."""
    return (complex(x, y) - complex(pose[0], pose[1])) * cmath.rect(1.0, -pose[2])


class Goals(Bank):
    draws = 3

    def __init__(self, env: Any, robot: Robot, shove: Any, weight: float, rest: tuple[float, float]) -> None:
        super().__init__(env, robot, shove)
        scan = robot.base.sensors
        self.weight, self.rest, self.max_range = weight, rest, scan.range
        self.beams = -math.pi + FULL / scan.beams * np.arange(scan.beams)

    def around(self, s: Any) -> Iterator[tuple[Any, float, float]]:
        """Yields each obstacle and where it is."""
        for o in s.scenario.obstacles:
            x, y, p = o["x"], o["y"], o["patrol"]
            if p["leg_time"] > 0.0:
                # a triangle wave: out and back
                along = (s.time + p["phase"]) % (2.0 * p["leg_time"])
                along = min(along, 2.0 * p["leg_time"] - along)
                x, y = p["x"] + along * p["vx"], p["y"] + along * p["vy"]
            yield o, x, y

    def room(self, s: Any, pose: Any) -> float:
        nearest = math.inf
        for o, x, y in self.around(s):
            at = (complex(pose[0], pose[1]) - complex(x, y)) * complex(o["cos"], -o["sin"])
            along, across = abs(at.real) - o["half_length"], abs(at.imag) - o["half_width"]
            outside = math.hypot(max(along, 0.0), max(across, 0.0))
            nearest = min(nearest, outside + min(max(along, across), 0.0) - o["radius"])
        return nearest - self.robot.base.hull_radius

    def place(self, s: Any, draws: Any) -> None:
        x, y, heading = s.scenario.start
        aside = [s.scenario.start_offset * (2.0 * draw - 1.0) for draw in draws[1:3]]
        turn = s.scenario.start_turn * (2.0 * draws[3] - 1.0)
        s.time = 0.0
        s.pose = x + aside[0], y + aside[1], wrap(heading + turn)
        if self.room(s, s.pose) <= 0.0:
            s.pose = x, y, s.pose[2]
        s.passed = 0

    def ranges(self, s: Any) -> NDArray[np.float64]:
        ways = np.exp(1j * (self.beams + s.pose[2]))
        found = np.full(len(ways), self.max_range)
        for o, x, y in self.around(s):
            back = complex(o["cos"], -o["sin"])
            at, way = (complex(*s.pose[:2]) - complex(x, y)) * back, ways * back
            if o["half_length"] == o["half_width"] == 0.0:
                along = (at.conjugate() * way).real
                inside = along**2 - abs(at) ** 2 + o["radius"] ** 2
                hit = -along - np.sqrt(np.maximum(inside, 0.0))
                found = np.where((inside >= 0.0) & (hit >= 0.0), np.minimum(found, hit), found)
                continue
            # between each pair of sides from one time to another
            enter, leave = np.zeros(len(ways)), np.full(len(ways), math.inf)
            for place, speed, half in (
                (at.real, way.real, o["half_length"]),
                (at.imag, way.imag, max(o["half_width"], 1e-12)),
            ):
                ends = np.sort(np.array([-half - place, half - place])[:, None] / speed, axis=0)
                enter, leave = np.maximum(enter, ends[0]), np.minimum(leave, ends[1])
            found = np.where(enter <= leave, np.minimum(found, enter), found)
        r, noise = self.robot, s.noise[s.row]
        if r.range > 0.0:
            noisy = np.clip(found + r.range * noise[7 : 7 + len(found)], 0.0, self.max_range)
            found = np.where(found < self.max_range, noisy, found)
        if r.dropout > 0.0:
            found[noise[7 + len(found) :] < statistics.NormalDist().inv_cdf(r.dropout)] = self.max_range
        return found

    def look(self, s: Any, first: bool = False) -> None:
        stops = [*s.scenario.waypoints, s.scenario.goal[:2]]
        before = () if first else (s.left, abs(s.turn))
        while s.passed < len(stops) - 1 and math.dist(s.pose[:2], stops[s.passed]) <= s.scenario.waypoint_radius:
            s.passed += 1
        way = [s.pose[:2], *stops[s.passed :]]
        s.left = sum(map(math.dist, way, way[1:]))
        away, s.turn = math.dist(s.pose[:2], stops[-1]), wrap(s.scenario.goal[2] - s.pose[2])
        progress, turned = (
            (was - now for was, now in zip(before, (s.left, abs(s.turn)), strict=True)) if before else (0, 0)
        )
        seen = list(self.sense(s))
        goal = turned_to(s.seen, *stops[s.passed])
        seen += goal.real, goal.imag, wrap(s.scenario.goal[2] - s.seen[2]), len(stops) - 1 - s.passed
        s.observation = np.array([*seen, *self.ranges(s)])
        done = s.passed == len(stops) - 1 and away <= s.scenario.position_tolerance
        done = done and abs(s.turn) <= s.scenario.heading_tolerance and not s.contact
        done = done and math.hypot(*s.twist[:2]) <= self.rest[0] and abs(s.twist[2]) <= self.rest[1]
        s.info = {
            "time": s.steps * DT, "goal_distance": away, "goal_heading_error": s.turn, "remaining_distance": s.left,
            "progress": progress, "turn_progress": turned, "clearance": self.room(s, s.pose), "waypoint": s.passed,
            "success": done and not first, "collision": s.contact,
        }  # fmt: skip
        s.reward = 0.0 if first else progress + self.weight * turned - 0.01 + 5.0 * done - 5.0 * s.contact
        s.ended = not first and (done or s.contact)
        s.row += 1


class Paths(Bank):
    draws = 2

    def __init__(self, env: Any, robot: Robot, shove: Any, num_preview: int, spacing: float) -> None:
        super().__init__(env, robot, shove)
        self.preview, self.spacing = num_preview, spacing

    def place(self, s: Any, draws: Any) -> None:
        path = s.scenario.path
        points = np.vstack([path.points, path.points[:1]]) if path.closed else np.array(path.points)
        s.corners, s.ways = points @ [1.0, 1j], np.diff(points @ [1.0, 1j])
        s.at = np.append(0.0, np.cumsum(np.abs(s.ways)))
        x, y, heading = s.scenario.start or (*points[0], cmath.phase(s.ways[0]))
        aside = 1j * cmath.rect(s.scenario.start_offset * (2.0 * draws[1] - 1.0), heading)
        s.pose = x + aside.real, y + aside.imag, wrap(heading + s.scenario.start_turn * (2.0 * draws[2] - 1.0))
        s.arc = s.seen_arc = 0.0

    def nearest(self, s: Any, pose: Any, since: float) -> tuple[float, float, float, bool]:
        """Returns arc length, cross-track and heading error of the nearest point within a metre on; and if a corner."""
        lap, sizes, place = s.at[-1], np.abs(s.ways), complex(pose[0], pose[1])
        end = since + (min(1.0, lap) if s.scenario.path.closed else 1.0)
        least, found = math.inf, (since, 0.0, 0.0, False)
        turn = math.floor(since / lap) if s.scenario.path.closed else 0
        for more in range(turn, turn + 3) if s.scenario.path.closed else (0,):
            start = more * lap + s.at[:-1]
            units = s.ways / sizes
            along = ((place - s.corners[:-1]) * units.conj()).real
            along = np.clip(along, np.maximum(since - start, 0.0), np.minimum(sizes, end - start))
            apart = np.abs(place - s.corners[:-1] - along * units)
            apart[(start > end) | (start + sizes < since)] = math.inf
            k = int(apart.argmin())
            if apart[k] < least - 1e-12:
                least, across = apart[k], ((place - s.corners[k]) * units[k].conjugate()).imag
                found = (
                    start[k] + along[k], math.copysign(least, across), wrap(pose[2] - cmath.phase(units[k])),
                    min(along[k], sizes[k] - along[k]) < 1e-9,
                )  # fmt: skip
        return found

    def ahead(self, s: Any, arc: float) -> complex:
        lap = s.at[-1]
        arc = arc % lap if s.scenario.path.closed else min(arc, lap)
        return complex(np.interp(arc, s.at, s.corners.real), np.interp(arc, s.at, s.corners.imag))

    def look(self, s: Any, first: bool = False) -> None:
        before = s.arc
        s.arc, error, turn, s.corner = self.nearest(s, s.pose, s.arc)
        seen, errors = list(self.sense(s)), (error, turn)
        if first:
            s.seen_arc = s.arc
        if self.robot.exact:
            s.seen_arc = s.arc
        else:
            s.seen_arc, *errors, corner = self.nearest(s, s.seen, s.seen_arc)  # type: ignore[assignment]
            s.corner = s.corner or corner
        seen += *errors, s.seen_arc
        for k in range(self.preview):
            point = self.ahead(s, s.seen_arc + (k + 1) * self.spacing)
            point = turned_to(s.seen, point.real, point.imag)
            seen += point.real, point.imag
        s.observation = np.array(seen)
        laps, lap, progress = s.scenario.laps, s.at[-1], 0.0 if first else s.arc - before
        done, left = bool(laps) and s.arc >= laps * lap - 0.05, abs(error) > s.scenario.corridor
        s.info = {
            "time": s.steps * DT, "arc_length": s.arc, "progress": progress, "cross_track_error": error,
            "heading_error": turn, "completion": s.arc / (max(laps, 1) * lap),
            "success": done and not left and not first, "left_corridor": left and not first, "collision": False,
        }  # fmt: skip
        s.reward = progress / (self.robot.base.max_twist[0] * DT * (1.0 + (error / 0.1) ** 2)) - 10.0 * left
        s.reward *= not first
        s.ended = not first and (done or left)
        s.row += 1


PATH = "wayfield/{}PathFollowing-v0"
GOAL = "wayfield/{}GoalObstacles-v0"
DOCK = "wayfield/{}Docking-v0"


def chosen(kind: str, s: Any, robot: Robot, rng: np.random.Generator) -> NDArray[np.float64]:
    """Returns a twist: along the way that is asked and a little beside it, or any."""
    ahead, *_, fastest = robot.base.max_twist
    most = np.array([ahead, ahead * robot.base.holonomic, fastest])
    anything = rng.uniform(-1.2, 1.2, 3) * most
    if kind == "still":
        return 0.02 * anything
    if kind == "random":
        return anything
    seen = s.observation[3 + (3 if robot.base.holonomic else 2) :]
    x, y = seen[:2] if kind == "goal" else seen[3:5]
    turn = math.atan2(y, x)
    if robot.base.holonomic:
        twist = np.array([2.0 * x, 2.0 * y, 2.0 * (seen[2] if kind == "goal" else -seen[1])])
    else:
        twist = np.array([most[0] * max(math.cos(turn), 0.0), 0.0, 2.0 * turn])
    return np.clip(twist, -most, most) + 0.05 * anything * (rng.random() < 0.3)


def compared(env: Any, bank: Bank, clock: int, kind: str) -> set[str]:
    """Compares a vector environment with the reference; returns what ended its episodes."""
    robot, rows = bank.robot, env.num_envs
    first, info = env.reset(seed=40)
    lone = [SimpleNamespace(rng=np_random(40 + i)[0], over=False, held=np.zeros(3)) for i in range(rows)]
    for s in lone:
        bank.reset(s)
    rng = np.random.default_rng(7)
    answer: Any = (first, np.zeros(rows), np.zeros(rows, bool), np.zeros(rows, bool), info)
    ends = set()
    for step in range(2 * clock + 30):
        for i, s in enumerate(lone):
            observation, reward, terminated, truncated = (each[i] for each in answer[:4])
            info = answer[4]
            place = f"step {step}, row {i}"
            found = {name: info[name][i] for name in s.info}
            assert all(info[f"_{name}"][i] for name in s.info)
            told = np.ones(len(s.observation), bool)
            if getattr(s, "corner", False):  # at a corner of the path either side of it may be meant
                heading = 4 + (3 if robot.base.holonomic else 2)
                told[heading] = False
                found["heading_error"] = s.info["heading_error"]
            np.testing.assert_allclose(observation[told], s.observation[told], rtol=1e-5, atol=2e-5, err_msg=place)
            assert found == pytest.approx(s.info, rel=1e-6, abs=2e-6), place
            assert reward == pytest.approx(s.reward, rel=1e-5, abs=2e-5), place
            assert (terminated, truncated) == (s.ended, s.steps >= clock), place
            s.over = bool(s.ended or s.steps >= clock)
            ends |= {key for key in ("success", "collision", "left_corridor") if s.info.get(key)}
            ends |= {"clock"} if s.steps >= clock else set()
        actions = []
        for s in lone:
            if step % 8 == 0 or kind in ("goal", "path"):
                s.held = chosen(kind, s, robot, rng)
            actions.append(s.held if robot.twists and robot.base.holonomic else s.held[[0, 2]] if robot.twists
                           else robot.wheels @ s.held)  # fmt: skip
        actions = np.array(actions, np.float32)  # type: ignore[assignment]
        answer = env.step(actions)
        for s, action in zip(lone, actions, strict=True):
            if s.over:
                bank.reset(s)
            else:
                bank.step(s, action)
    return ends
