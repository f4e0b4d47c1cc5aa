"""What a data sheet says that no robot is likely to have: most likely, it is in other units than m, kg, s and rad."""

import math
import warnings
from typing import TYPE_CHECKING

import numpy as np

from wayfield.envs.robots.intervals import Interval
from wayfield.system.objects import FileNote

if TYPE_CHECKING:
    from wayfield.envs.robots.robot import Robot

BRISK = 22.0  # m/s times the root of a wheel's radius, m: a Froude number of 50; bases that ship have 4.2 at most
CREEPING = 0.05  # m/s, at the rim
USUAL = {
    "friction": (0.05, 2.0, ""),
    "driven_load": (0.1, 1.0, ""),
    "turn_speed": (0.05, 40.0, "rad/s"),
    "acceleration": (0.01, 30.0, "m/s^2"),
    "yaw_acceleration": (0.05, 60.0, "rad/s^2"),
    "lag": (0.0, 1.5, "s"),
    "gain": (0.5, 2.0, ""),
}


def tell(robot: "Robot", where: str) -> None:
    """Warns in a line of what `doubt` finds; of a robot, wherever it goes, once."""
    if not vars(robot).setdefault("_told", False) and (said := doubt(robot)):
        warnings.warn(f"{where}: {said}; units are m, kg, s and rad", FileNote, stacklevel=3)
    vars(robot)["_told"] = True


def doubt(robot: "Robot") -> str:
    """Returns in a line what no robot of its size is likely to have and nobody measured; "" where nothing is so."""
    hull, radius, rated = robot.hull_radius or math.nan, robot.wheels[-1].radius, robot.rated_wheel_speed
    said = []
    if rated * radius > BRISK * math.sqrt(radius):
        said.append(
            f"rated_wheel_speed is {rated:g} rad/s, {rated * radius:.3g} m/s at the rim, above what a wheel of "
            f"{radius:g} m is likely to do; if it is in rpm, write {rated * math.pi / 30.0:.4g}"
        )
    if rated * radius < CREEPING:
        said.append(
            f"rated_wheel_speed is {rated:g} rad/s, {rated * radius:.3g} m/s at the rim; if it is in m/s, write "
            f"{rated / radius:.4g}"
        )
    area = math.prod(robot.hull_box) if robot.hull_box else math.pi * hull**2
    bounds: list[tuple[str, float, float, float, str]] = [
        ("mass", robot.mass, area, 3000.0 * area, "kg"),
        ("turning_radius", robot.turning_radius, 0.0, 20.0 * hull, "m"),
        ("sensors.range", robot.sensors.range, hull, 300.0, "m"),
    ]
    if area <= robot.mass <= 3000.0 * area:  # else it would be beside a wrong one
        bounds.append(("inertia", robot.inertia, 0.01 * robot.mass * hull**2, robot.mass * hull**2, "kg m^2"))
    if robot.holonomic:
        bounds += [(f"wheels[{k}].radius", each.radius, hull / 30.0, hull, "m") for k, each in enumerate(robot.wheels)]
    else:
        track, driven = robot.built[-1].y - robot.built[0].y, 2.0 * robot.wheels[-1].y
        bounds += [
            ("wheels.radius", radius, hull / 30.0, hull, "m"),
            ("wheels.track", track, 0.1 * hull, 2.0 * hull, "m"),
            ("wheels.effective_track", driven, 0.5 * track, 5.0 * track, "m"),
        ]
    for k, each in enumerate(robot.encoders):
        bounds.append((f"encoders[{k}].radius", each.radius, 0.0, hull, "m"))
        bounds.append((f"the distance of encoders[{k}]", math.hypot(each.x, each.y), 0.0, hull, "m"))
    for field, usual in USUAL.items():
        values = np.atleast_1d(getattr(robot, field)).tolist()
        bounds += [(f"{field}[{k}]" if len(values) > 1 else field, each, *usual) for k, each in enumerate(values)]
    for k, value in enumerate(robot.decelerations):
        bounds.append((f"decelerations[{k}]", value, *USUAL[("acceleration", "yaw_acceleration")[k]]))
    for field, value, least, most, unit in bounds:
        measured = isinstance(robot.sources.get(field.partition("[")[0]), Interval)
        if not measured and (value < least or math.inf > value > most):
            said.append(f"{field} is {value:g}{' ' * bool(unit)}{unit}, usual is {least:.3g} to {most:.3g}")
    return "; ".join(said)
