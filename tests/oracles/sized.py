"""Robots and scenes by their size: for laws that hold for any base."""

import dataclasses
import math

from wayfield.envs.robots import Robot, Sensors, Wheel
from wayfield.envs.scenarios import GoalScenario


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


def scaled(scenario: GoalScenario, factor: float) -> GoalScenario:
    """Returns a scenario with all places, sizes and speeds of movers multiplied; the goal's tolerance stays."""
    if factor == 1.0:
        return scenario
    obstacles, patrols = scenario.obstacles.copy(), scenario.patrols.copy()
    for name in ("x", "y", "half_length", "half_width", "radius"):
        obstacles[name] *= factor
    for name in ("x", "y", "vx", "vy"):
        patrols[name] *= factor
    (x, y, heading), (u, v, there) = scenario.start, scenario.goal
    return dataclasses.replace(
        scenario,
        start=(factor * x, factor * y, heading),
        goal=(factor * u, factor * v, there),
        obstacles=obstacles,
        patrols=patrols,
    )
