"""MuJoCo's model of a robot and of what stands around it: MJCF, made from the data sheet. Nothing here imports MuJoCo.

The base is a free body. What a data sheet does not say is chosen here and is the same for every robot:

* A wheel is 0.4 radii wide and weighs 2.5 % of the robot, or less where wheels would have all of the sheet's inertia.
  The centre of mass lies at the height of the axles.
* Wheel motors are velocity servos of 1 ms, with at most twice the torque at which the wheel slips. Rotor and gear have
  as much inertia, seen from the wheel, as the share of the robot that the wheel carries.
* A differential drive has a frictionless caster behind (ahead if the hull reaches farther there), which bears what the
  wheels do not, and a pad at the other end, 1 mm above the floor, on which it would tip. Of other bases the friction
  is scaled by `driven_load` instead.

Wheels, by drive:

* differential: "cylinders", which touch the floor along a line and scrub in turns, or "points", ellipsoids, which touch
  it in one. A wheelbase makes four wheels of the two: a skid steer.
* omni: "anisotropic", capsules whose contact has next to no friction along the axle: MuJoCo's capsule on a plane has a
  contact frame that turns with it; or "rollers", twelve barrels on hinges.
* mecanum: "rollers".

A barrel that rolls on the inside of the wheel's cylinder of radius R has, at t along its own axis, the radius
R - sqrt((R - r)^2 + (t cos g)^2), with r in the middle and g the roller angle. It is an ellipsoid with the same
curvature: half axis sqrt(r (R - r)) / cos g.
"""

import math
from typing import Any
from xml.etree import ElementTree

import numpy as np
from numpy.typing import NDArray

from wayfield.envs.robots.robot import Robot, Wheel

WHEELS = {
    "differential": ("cylinders", "points"),
    "omni": ("anisotropic", "rollers"),
    "mecanum": ("rollers",),
}
GRAVITY = 9.81  # m/s^2
TIMESTEP = 0.002  # s

WIDTH = 0.4  # of a wheel, times its radius
ROLLERS = 12  # of a wheel
_BARREL = 0.2  # radius of a roller, times the wheel's
_WHEEL_MASS = 0.025  # of the robot's
_WHEEL_INERTIA = 0.3  # of the robot's, that all wheels have at most
_SERVO = 1e-3  # s
_TORQUE = 2.0  # times the one at which a wheel slips
_CASTER = 0.7  # of the way from the axle to the end of the hull: where caster and pad stand
_PAD = 1e-3  # m above the floor
# How soft contacts with the floor are. Stiff, light rollers do not sink in; soft, by 0.7 mm as a tyre, both edges of a
# cylinder stay on the floor: stiffer ones chatter in turns, and scrub next to nothing. MuJoCo leaves out how fast a
# contact's frame turns, so that in a bend of v and w a wheel drifts by v w d t / 2, t and d the time constant and the
# impedance of friction.
_STIFF = {"solimp": "0.9 0.9 0.001", "solreffriction": "0.004 1"}
_TYRE = {"solimp": "0.5 0.5 0.001"}
_ALONG_AXLE = 1e-3  # friction of an anisotropic wheel
_HEIGHT = 0.25  # m, of the hull's upper edge, and twice the wheel's radius at least
_GROUND = 0.03  # m, of its lower one
THINGS_HIGH = 0.2  # m: what is pushed; lower than the hull, so that it tips late
WALLS_HIGH = 0.4  # m


def wheels_of(robot: Robot, wheels: str | None) -> str:
    """Returns the kind of wheels of a model: the first of the drive's, unless one is named.

    Raises:
        ValueError: if the drive has no such wheels, or the robot cannot be built.
    """
    kinds = WHEELS[robot.drive]
    if wheels is not None and wheels not in kinds:
        raise ValueError(f"wheels={wheels!r}: a drive {robot.drive} has {' or '.join(map(repr, kinds))} in MuJoCo")
    if robot.hull_radius == 0.0:
        raise ValueError("hull.radius is 0; MuJoCo builds no robot without a body")
    built = robot.built
    for i, one in enumerate(built):
        for k in range(i):
            if _overlap(built[k], one):
                raise ValueError(
                    f"wheels {k} and {i} of robot {robot.name!r} overlap: wheels of radius {one.radius:g} m, "
                    f"{WIDTH * one.radius:.3g} m wide, need more room between them to be built"
                )
    return wheels or kinds[0]


def _overlap(one: Wheel, other: Wheel) -> bool:
    """Returns whether two wheels meet, seen from above as rectangles: no axis of either separates them."""
    apart = np.array([other.x - one.x, other.y - one.y])
    axes = [np.array([math.cos(w.direction + turn), math.sin(w.direction + turn)])
            for w in (one, other) for turn in (0.0, 0.5 * math.pi)]  # fmt: skip
    for axis in axes:
        reach = sum(
            w.radius * (abs(axis @ ahead) + 0.5 * WIDTH * abs(axis @ aside))
            for w, (ahead, aside) in ((one, axes[:2]), (other, axes[2:]))
        )
        if abs(axis @ apart) >= reach:
            return False
    return True


class _Base:
    """The masses and forces of a robot's model."""

    def __init__(self, robot: Robot, wheels: str) -> None:
        self.robot, self.wheels = robot, wheels
        self.built = robot.built
        self.contact = _TYRE if wheels == "cylinders" else _STIFF
        count = len(self.built)
        self.height = float(np.mean([wheel.radius for wheel in self.built]))
        self.caster = robot.drive == "differential" and not robot.wheelbase
        half = 0.5 * robot.hull_box[0] if robot.hull_box else robot.hull_radius
        # under the longer end, which is the one behind where none is longer
        side = math.copysign(_CASTER, robot.hull_x or -1.0)
        self.supports = side * (half + abs(robot.hull_x)), side * (abs(robot.hull_x) - half)
        middle = np.array([(1.0 - robot.driven_load) * self.supports[0] if self.caster else 0.0, 0.0])
        places = np.array([(wheel.x, wheel.y) for wheel in self.built])
        arms = ((places - middle) ** 2).sum(axis=1)
        own = np.array([wheel.radius**2 for wheel in self.built]) * (0.25 + WIDTH**2 / 12.0)
        self.wheel_mass = min(_WHEEL_MASS * robot.mass, _WHEEL_INERTIA * robot.inertia / float((arms + own).sum()))
        self.mass = robot.mass - count * self.wheel_mass
        # the chassis lies so that the whole has its centre of mass in the middle, and the sheet's inertia about it
        self.centre = (robot.mass * middle - self.wheel_mass * places.sum(axis=0)) / self.mass
        inertia = robot.inertia - self.wheel_mass * float((arms + own).sum())
        inertia -= self.mass * float(((self.centre - middle) ** 2).sum())
        self.inertia = max(inertia, 0.1 * robot.inertia)
        self.friction = robot.friction * (1.0 if self.caster else robot.driven_load)
        self.most = _TORQUE * robot.friction * robot.mass * GRAVITY * robot.driven_load / count  # N, at the rim

    def carried(self, wheel: Wheel) -> float:
        """Returns the inertia (kg m^2) about its axle of what a wheel has to carry."""
        return self.robot.mass / len(self.built) * wheel.radius**2


Element = ElementTree.Element
_DARK, _ROLLER, _GREY = "0.17 0.20 0.25 1", "0.45 0.50 0.57 1", "0.55 0.57 0.60 1"
_GHOST = {"contype": "0", "conaffinity": "0"}  # meets the floor alone, by pairs
_SOLID = {"contype": "2", "conaffinity": "2", "friction": "0.5 0 0"}  # hulls and what stands around them
_LYING = (math.sqrt(0.5), math.sqrt(0.5), 0.0, 0.0)  # a cylinder whose axis is y


def _add(parent: Element, tag: str, **values: Any) -> Element:
    """Returns a new element of a parent; numbers are written to the last digit that matters."""
    texts = {}
    for name, value in values.items():
        numbers = value if isinstance(value, tuple | list) else (value,)
        texts[name] = value if isinstance(value, str) else " ".join(f"{each:.12g}" for each in numbers)
    return ElementTree.SubElement(parent, tag, texts)


def _yawed(angle: float) -> tuple[float, float, float, float]:
    """Returns the quaternion of a turn about the vertical."""
    return math.cos(0.5 * angle), 0.0, 0.0, math.sin(0.5 * angle)


def prefixes(team: int) -> list[str]:
    """Returns what the names of each robot's parts begin with; the first one's have no prefix."""
    return [f"robot{r}_" if r else "" for r in range(team)]


def _wheel(body: Element, base: _Base, wheel: Wheel, name: str) -> None:
    """Adds a wheel: it turns about its axle, and a positive speed drives along its direction."""
    radius, half = wheel.radius, 0.5 * WIDTH * wheel.radius
    own = _add(body, "body", name=name, pos=(wheel.x, wheel.y, radius), quat=_yawed(wheel.direction))
    _add(own, "joint", name=name, type="hinge", axis="0 1 0", armature=base.carried(wheel))
    if base.wheels == "rollers":
        _rollers(own, base, wheel, name)
        return
    shape: dict[str, Any] = {
        "cylinders": {"type": "cylinder", "size": (radius, half), "quat": _LYING},
        "points": {"type": "ellipsoid", "size": (radius, half, radius)},
        # short, but no sphere: its axis is the direction that the contact's frame follows
        "anisotropic": {"type": "capsule", "size": (radius, 1e-3), "quat": _LYING},
    }[base.wheels]
    _add(own, "geom", name=name, mass=base.wheel_mass, rgba=_DARK, **shape, **_GHOST)


def _rollers(hub: Element, base: _Base, wheel: Wheel, name: str) -> None:
    """Adds the hub of a wheel and its rollers; each turns freely about its axis."""
    radius, thick = wheel.radius, _BARREL * wheel.radius
    rim = radius - thick
    size = 0.75 * rim, 0.3 * WIDTH * radius
    _add(hub, "geom", type="cylinder", size=size, quat=_LYING, mass=0.6 * base.wheel_mass, rgba=_DARK, **_GHOST)
    barrel = math.sqrt(thick * rim) / math.cos(wheel.roller_angle), thick, thick
    mass = 0.4 * base.wheel_mass / ROLLERS
    for k in range(ROLLERS):
        turn = 2.0 * math.pi * k / ROLLERS
        # of the lowest roller, x is the drive direction; the others are that one, turned about the axle
        c, s = math.cos(0.5 * turn), math.sin(0.5 * turn)
        cs, ss = math.cos(0.5 * wheel.roller_angle), math.sin(0.5 * wheel.roller_angle)
        place = -rim * math.sin(turn), 0.0, -rim * math.cos(turn)
        roller = _add(hub, "body", pos=place, quat=(c * cs, s * ss, s * cs, c * ss))
        _add(roller, "joint", type="hinge", axis="1 0 0", armature=0.1 * mass * thick**2)
        _add(roller, "geom", name=f"{name}_{k}", type="ellipsoid", size=barrel, mass=mass, rgba=_ROLLER, **_GHOST)


def _robot(world: Element, base: _Base, prefix: str) -> None:
    """Adds the free body of a robot."""
    robot = base.robot
    high = max(_HEIGHT, 2.0 * max(wheel.radius for wheel in base.built))
    middle, half = 0.5 * (_GROUND + high), 0.5 * (high - _GROUND)
    body = _add(world, "body", name=f"{prefix}base")
    _add(body, "freejoint", name=f"{prefix}base")
    inertia = 0.6 * base.inertia, 0.6 * base.inertia, base.inertia
    _add(body, "inertial", pos=(*base.centre, base.height), mass=base.mass, diaginertia=inertia)
    shape: dict[str, Any] = {"type": "cylinder", "size": (robot.hull_radius, half)}
    if robot.hull_box:
        shape = {"type": "box", "size": (0.5 * robot.hull_box[0], 0.5 * robot.hull_box[1], half)}
    blue = "0.30 0.55 0.80 0.35"
    _add(body, "geom", name=f"{prefix}hull", pos=(robot.hull_x, 0.0, middle), mass=0.0, rgba=blue, **shape, **_SOLID)
    if base.caster:
        small = 0.5 * base.height
        level = 0.0 if robot.driven_load == 1.0 else _PAD
        for part, at, z in zip(("caster", "pad"), base.supports, (small, small + level), strict=True):
            place = (at, 0.0, z)
            _add(body, "geom", name=prefix + part, type="sphere", size=small, pos=place, mass=0.0, rgba=_GREY, **_GHOST)
    for i, wheel in enumerate(base.built):
        _wheel(body, base, wheel, f"{prefix}wheel{i}")


def _motors_and_floor(contact: Element, motors: Element, base: _Base, prefix: str) -> None:
    """Adds the contacts of a robot with the floor, and its motors."""
    grip = _ALONG_AXLE if base.wheels == "anisotropic" else base.friction, base.friction, 0.0, 0.0, 0.0
    for i, wheel in enumerate(base.built):
        one = f"{prefix}wheel{i}"
        for part in [f"{one}_{k}" for k in range(ROLLERS)] if base.wheels == "rollers" else [one]:
            _add(contact, "pair", geom1="floor", geom2=part, condim=3, friction=grip, **base.contact)
        servo = 2.0 * base.carried(wheel) / _SERVO
        most = base.most * wheel.radius
        limits: dict[str, Any] = {"forcelimited": "true", "forcerange": (-most, most)}
        _add(motors, "velocity", name=one, joint=one, kv=servo, **limits)
    for part in ("caster", "pad") if base.caster else ():
        _add(contact, "pair", geom1="floor", geom2=prefix + part, condim=1, **base.contact)


def _footprint(obstacle: Any) -> list[tuple[str, float, float, float, float]]:
    """Returns the parts of a shape in its own frame, a rectangle whose corners are rounded by its radius.

    Boxes and cylinders: kind, place and half sides, or place and radius twice.
    """
    length, width, radius = (float(obstacle[name]) for name in ("half_length", "half_width", "radius"))
    parts = []
    if length or width:  # a wall is a millimetre thick
        boxes = {(length + radius, width), (length, width + radius)}
        parts += [("box", 0.0, 0.0, max(a, 1e-3), max(b, 1e-3)) for a, b in sorted(boxes)]
    if radius:
        corners = {(a + 0.0, b + 0.0) for a in (-length, length) for b in (-width, width)}
        parts += [("cylinder", a, b, radius, radius) for a, b in sorted(corners)]
    return parts


def _things(world: Element, obstacles: NDArray[np.void], floor_friction: float) -> None:
    """Adds OBSTACLE records: fixed, pushed ("thing3") and moving ("mover3") ones, by number."""
    for j, obstacle in enumerate(obstacles):
        moves = obstacle["patrol"]["leg_time"] > 0.0
        pushed = not moves and obstacle["mass"] > 0.0
        half = 0.5 * (THINGS_HIGH if pushed else WALLS_HIGH)
        named = {"name": f"mover{j}", "mocap": "true"} if moves else {"name": f"thing{j}"} if pushed else {}
        turn = math.atan2(float(obstacle["sin"]), float(obstacle["cos"]))
        body = _add(world, "body", **named, pos=(float(obstacle["x"]), float(obstacle["y"]), half), quat=_yawed(turn))
        parts = _footprint(obstacle)
        solid: dict[str, Any] = {**_SOLID, "rgba": _GREY}
        if pushed:
            _add(body, "freejoint")
            mass = float(obstacle["mass"]) / len(parts)
            solid |= {"conaffinity": "3", "friction": (floor_friction, 0.0, 0.0), "rgba": "0.85 0.62 0.35 1"}
            solid |= {"mass": mass}
        for kind, x, y, a, b in parts:
            size = (a, half) if kind == "cylinder" else (a, b, half)
            _add(body, "geom", type=kind, pos=(x, y, 0.0), size=size, **solid)


def _walls(world: Element, grid: Any) -> None:
    """Adds boxes that cover the occupied cells of a grid: runs of a row, and equal runs of rows one upon another."""
    occupied = np.pad(np.asarray(grid.occupied), ((0, 1), (1, 1)))
    steps = np.diff(occupied.astype(np.int8), axis=1)
    growing: dict[tuple[int, int], int] = {}
    for row, step in enumerate(steps):
        ends = (np.flatnonzero(step == side).tolist() for side in (1, -1))
        runs = list(zip(*ends, strict=True))
        for (left, right), low in growing.items():
            if (left, right) not in runs:
                at = np.array([0.5 * (left + right), 0.5 * (low + row)])
                sides = 0.5 * grid.resolution * np.array([right - left, row - low])
                place = (*grid.points(at).tolist(), 0.5 * WALLS_HIGH)
                size = (*sides.tolist(), 0.5 * WALLS_HIGH)
                _add(world, "geom", type="box", size=size, pos=place, quat=_yawed(grid.origin[2]), rgba=_GREY, **_SOLID)
        growing = {run: growing.get(run, row) for run in runs}


def mjcf(
    robot: Robot,
    wheels: str | None = None,
    obstacles: NDArray[np.void] | None = None,
    grid: Any = None,
    floor_friction: float = 0.4,
    team: int = 1,
) -> str:
    """Returns the MJCF of a robot, or a team of the same robots, on a floor among obstacles.

    Its free body is "base", its wheels are "wheel0", "wheel1", ... in the order of `Robot.built`, and so are its
    motors, whose control is a wheel speed, rad/s. Further robots are "robot1_base", "robot1_wheel0", ...

    Args:
        wheels: one of WHEELS of its drive; None: the first.
        obstacles: (m,) OBSTACLE records.
        grid: a `grids.OccupancyGrid`, whose occupied cells are boxes.
        floor_friction: of what is pushed.
        team: robots.

    Raises:
        ValueError: in one line, if the robot cannot be built.
    """
    base = _Base(robot, wheels_of(robot, wheels))
    root = Element("mujoco", model=robot.name)
    _add(root, "compiler", angle="radian")
    solver = {"integrator": "implicitfast", "cone": "elliptic", "impratio": "10"}
    _add(root, "option", timestep=TIMESTEP, gravity=(0.0, 0.0, -GRAVITY), **solver)
    visual, asset, world = _add(root, "visual"), _add(root, "asset"), _add(root, "worldbody")
    _add(visual, "global", offwidth=1280, offheight=960)
    tiles = {"rgb1": "0.93 0.94 0.95", "rgb2": "0.86 0.88 0.90", "width": "64", "height": "64"}
    _add(asset, "texture", name="tiles", type="2d", builtin="checker", **tiles)
    _add(asset, "material", name="floor", texture="tiles", texrepeat="1 1", texuniform="true")
    _add(world, "light", pos="0 0 6", dir="0 0 -1", diffuse="0.35 0.35 0.35")
    # of two frictions the larger one counts: on the floor that of what is pushed
    _add(
        world,
        "geom",
        name="floor",
        type="plane",
        size="0 0 1",
        material="floor",
        contype=1,
        conaffinity=0,
        friction="0 0 0",
    )
    for prefix in prefixes(team):
        _robot(world, base, prefix)
    if obstacles is not None:
        _things(world, obstacles, floor_friction)
    if grid is not None:
        _walls(world, grid)
    contact, motors = _add(root, "contact"), _add(root, "actuator")
    for prefix in prefixes(team):
        _motors_and_floor(contact, motors, base, prefix)
    ElementTree.indent(root)
    return ElementTree.tostring(root, encoding="unicode") + "\n"
