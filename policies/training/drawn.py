"""What training draws beyond the frozen splits: robots, each with worlds of its own, and further scenarios."""

import dataclasses
import functools
import math
from collections.abc import Mapping
from typing import Any

import numpy as np

from wayfield.envs.robots import FULL_TURN, Robot, Sensors, Wheel
from wayfield.envs.scenarios import TASKS, GoalScenario, field_scenarios
from wayfield.envs.scenarios.goal_families import LARGEST_HULL
from wayfield.envs.scenarios.splits import members
from wayfield.envs.tasks.specs import EVERY

LAST_FROZEN = 9_999  # seed of a training split, at most; those of other splits begin at a million
SEED = 37  # of the draws: the robots of a preset are the same for every seed of training
BEAMS = (32, 40, 48, 64, 72, 90, 120, 180, 240, 360)
REACHES = (3.0, 3.5, 5.0, 8.0, 12.0, 30.0)  # m
LEVELS = ("none", "none", "none", "light", "moderate", "severe")
TWICE = ("clutter_15", "rooms", "doors_narrow", "u_traps_30")  # families met more often than as one of twenty
THRICE = ("moving_crossing", "moving_head_on", "moving_crowd")
EACH = 2  # scenarios of a family that a robot meets

# What is drawn, least and most; the first five evenly in the logarithm.
RANGES: Mapping[str, tuple[float, float]] = {
    "hull": (0.1, 0.6),  # m
    "speed": (0.2, 1.5),  # m/s, that is asked for
    "stopping_way": (0.01, 1.2),  # m, from that
    "acceleration": (0.3, 20.0),  # m/s^2
    "yaw_acceleration": (0.9, 30.0),  # rad/s^2
    "yaw_rate": (1.0, 4.0),  # rad/s
    "lag": (0.0, 0.3),  # s
    "view": (math.pi, FULL_TURN),  # rad; of three in four a full circle
}


@functools.cache
def further(task: str, family: str, hull_radius: float, count: int) -> tuple[Any, ...]:
    """Returns as many scenarios of a family, for a hull (m), as are asked for beyond those of its training split.

    They are made and proven as those, of the seeds that follow: none is in another split.
    """
    spec, result, seed = EVERY[task], list[Any](), LAST_FROZEN
    while len(result) < count:
        seed += 1
        scenario = spec.families[family].make(seed)
        if spec.feasible(scenario):
            hull = spec.repertoire.hull_class(hull_radius)
            made = scenario.of_class(hull) if hull else scenario
            result.append(made.fitted((hull or LARGEST_HULL) - hull_radius))
    return tuple(result)


@dataclasses.dataclass(frozen=True)
class Drawn:
    """A robot, what its environment is made with, and the speed (m/s) that it is asked for."""

    robot: Robot
    kwargs: Mapping[str, Any]
    speed: float

    @property
    def size(self) -> float:
        """Returns how many times as large as the families its scenes are."""
        return max(self.robot.hull_radius / LARGEST_HULL, 1.0)


def draw_robots(count: int, holonomic: bool, seed: int = SEED) -> list[Drawn]:
    """Returns robots of a kinematic class.

    Speeds and stopping ways are drawn in strata that are put together by chance, so that the quick and weakly braked
    are met as often as others; the acceleration follows from them and the lag.
    """
    rng = np.random.default_rng([seed, holonomic])
    strata = {name: (rng.permutation(count) + rng.random(count)) / count for name in ("hull", "speed", "stopping_way")}
    return [
        _drawn(k, {name: float(values[k]) for name, values in strata.items()}, holonomic, rng) for k in range(count)
    ]


def _drawn(k: int, strata: Mapping[str, float], holonomic: bool, rng: np.random.Generator) -> Drawn:
    hull, speed, way = (_between(name, share) for name, share in strata.items())
    lag = min(rng.uniform(*RANGES["lag"]), 0.6 * way / speed)
    acceleration = _clipped("acceleration", 0.5 * speed * speed / (way - speed * lag))
    yaw_acceleration = _clipped("yaw_acceleration", 3.0 * acceleration * rng.uniform(0.6, 1.6))
    top, yaw_rate = speed / 0.94 * rng.uniform(1.0, 1.4), rng.uniform(*RANGES["yaw_rate"])
    view = FULL_TURN if rng.random() < 0.75 else rng.uniform(*RANGES["view"])
    sensors = Sensors(int(rng.choice(BEAMS)), float(rng.choice(REACHES)), float(view))
    name = f"drawn_{'omni' if holonomic else 'differential'}_{k}"
    robot = robot_like(name, holonomic, hull, top, yaw_rate, acceleration, yaw_acceleration, lag, sensors)
    kwargs = {
        "robot": robot,
        "actuators": "lagged",
        "scenario": scenes(hull, k),
        "disturbance": str(rng.choice(LEVELS)),
    }
    return Drawn(robot, kwargs, speed)


def _between(name: str, share: float) -> float:
    low, high = RANGES[name]
    return float(low * (high / low) ** share)


def _clipped(name: str, value: float) -> float:
    return float(np.clip(value, *RANGES[name]))


def robot_like(
    name: str,
    holonomic: bool,
    hull: float,
    top: float,
    yaw_rate: float,
    acceleration: float,
    yaw_acceleration: float,
    lag: float,
    sensors: Sensors,
) -> Robot:
    """Returns a disc on two wheels or on three omni wheels.

    Args:
        hull: m, radius.
        top: m/s, its fastest at rated wheel speed; an omni base's forward.
        yaw_rate: rad/s, at which its driver stops turns.
        acceleration, yaw_acceleration, lag: m/s^2, rad/s^2 and s, in the tier "lagged".
    """
    radius, mass = 0.25 * hull, 150.0 * hull * hull
    if holonomic:
        places = [math.pi / 3.0 * (2 * k - 1) for k in range(3)]
        wheels = tuple(
            Wheel(0.9 * hull * math.cos(a), 0.9 * hull * math.sin(a), radius, (a + 0.5 * math.pi)) for a in places
        )
        rated = top / radius * math.cos(math.pi / 6.0)
    else:
        wheels = (Wheel(0.0, -0.75 * hull, radius), Wheel(0.0, 0.75 * hull, radius))
        rated = top / radius
    return Robot(
        name=name,
        drive="omni" if holonomic else "differential",
        wheels=wheels,
        hull_radius=hull,
        mass=mass,
        inertia=0.5 * mass * hull * hull,
        friction=0.8,
        rated_wheel_speed=rated,
        peak_wheel_speed=rated,
        turn_speed=yaw_rate,
        acceleration=acceleration,
        yaw_acceleration=yaw_acceleration,
        lag=lag,
        sensors=sensors,
    )


def scenes(hull: float, k: int) -> tuple[GoalScenario, ...]:
    """Returns the training scenes of the k-th robot with a hull (m): some of each family.

    Those of a hull beyond 0.3 m are scaled for it, movers' ways too, so that they keep the ways that were proven.
    """
    task, result = TASKS["goal_reaching"], []
    for family in members(task.name, 1):
        if task.families[family].needs_forces:
            continue
        bank = field_scenarios(task, f"{family}/train", min(hull, LARGEST_HULL))
        count = EACH * (3 if family in THRICE else 2 if family in TWICE else 1)
        result += [bank[(k * count + j) % len(bank)] for j in range(count)]
    if hull <= LARGEST_HULL:
        return tuple(result)
    return tuple(each.scaled(hull / LARGEST_HULL, speeds=True) for each in result)
