"""Models of the robots in CoppeliaSim: objects, names, poses. A scene reports the geometry that the plant uses."""

import dataclasses
import math

from wayfield.bridges.coppelia import frames
from wayfield.bridges.coppelia.constants import CYLINDER, JOINT, PROXIMITY_SENSOR, SHAPE, VISION_SENSOR
from wayfield.bridges.coppelia.scene import Object, Scene, Sonar
from wayfield.envs.robots import ROBOTS, Robot, robots_with

# Robots with a model: CoppeliaSim's P3DX, and omnidirectional bases, which are built from their data sheets.
MODELLED = ("p3dx", *robots_with(holonomic=True))

P3DX_HALF_TRACK = 0.1655  # m, of CoppeliaSim's model; document A gives 0.1905
P3DX_BASE_HEIGHT = 0.1388  # m, of the base's origin above the floor
P3DX_AXLE_AHEAD = 0.0445  # m, from the base's origin to the axle
_P3DX_WHEEL_WIDTH = 0.05  # m
_P3DX_CASTER = (-0.149, 0.0, -0.078)  # m, in the base frame
_P3DX_SONAR_HEIGHT = 0.068  # m, in the base frame
_P3DX_LIDAR_HEIGHT = 0.2  # m, in the base frame; it stands over the axle's middle

_OMNI_BASE_HEIGHT = 0.1  # m
_OMNI_WHEEL_WIDTH = 0.03  # m

# x, y (m) in the base frame, bearing (degrees); front ones from left to right, then the rear ones from right to left.
_P3DX_SONARS = (
    (0.1064, 0.1382, 90.0),
    (0.1554, 0.1250, 50.0),
    (0.1906, 0.0831, 30.0),
    (0.2092, 0.0273, 10.0),
    (0.2092, -0.0273, -10.0),
    (0.1905, -0.0785, -30.0),
    (0.1555, -0.1202, -50.0),
    (0.1064, -0.1381, -90.0),
    (-0.1103, -0.1382, -90.0),
    (-0.1596, -0.1202, -130.0),
    (-0.1946, -0.0785, -150.0),
    (-0.2132, -0.0273, -170.0),
    (-0.2132, 0.0273, 170.0),
    (-0.1946, 0.0785, 150.0),
    (-0.1596, 0.1203, 130.0),
    (-0.1103, 0.1382, 90.0),
)


@dataclasses.dataclass(frozen=True)
class Model:
    """A robot and the place of its base frame."""

    robot: Robot
    alias: str
    height: float  # m, of the base's origin above the floor
    ahead: float  # m, from the base's origin forward to the robot's centre


def model_of(name: str, half_track: float | None = None) -> Model:
    """Returns the model of a robot of `MODELLED`.

    Args:
        half_track: m, of the differential drive; None is that of CoppeliaSim's P3DX.

    Raises:
        ValueError: if the half track is out of range, or the robot has none.
    """
    robot = ROBOTS[name]
    if robot.holonomic:
        if half_track is not None:
            raise ValueError(f"track={half_track!r} belongs to the p3dx; robot {name!r} has none")
        return Model(robot, name.capitalize(), _OMNI_BASE_HEIGHT, 0.0)
    half = P3DX_HALF_TRACK if half_track is None else half_track
    if not 0.02 <= half <= 1.0:
        raise ValueError(f"track={half!r} must be the half track in m, 0.02 to 1")
    right, left = (dataclasses.replace(wheel, y=y) for wheel, y in zip(robot.wheels, (-half, half), strict=True))
    # the hull and the track as built do not depend on the half track
    built = robot.wheels[1].y - robot.wheels[0].y
    robot = dataclasses.replace(robot, wheels=(right, left), track=built)
    return Model(robot, "PioneerP3DX", P3DX_BASE_HEIGHT, P3DX_AXLE_AHEAD)


def build(scene: Scene, model: Model) -> list[Object]:
    """Adds the model's objects to a scene; returns the wheel joints in the order of the robot's wheels."""
    scene.base = base = scene.add(model.alias, SHAPE, part=True)
    return _build_omni(scene, model, base) if model.robot.holonomic else _build_p3dx(scene, model, base)


def _wheel_pose(model: Model, i: int) -> frames.Pose:
    """Returns the pose of a wheel joint in the base frame; its axis points left of the drive direction."""
    (x, y), direction = model.robot.wheel_positions[i], model.robot.wheel_directions[i]
    axis = frames.quaternion_from_euler(-0.5 * math.pi, 0.0, 0.0)
    z = model.robot.wheels[i].radius - model.height
    return frames.composed(frames.yawed(model.ahead + x, y, z, direction), (0.0, 0.0, 0.0, *axis))


def _build_p3dx(scene: Scene, model: Model, base: Object) -> list[Object]:
    diameter = 2.0 * model.robot.wheels[0].radius
    joints = []
    for i, side in enumerate(("right", "left")):
        joint = scene.add(f"{side}Motor", JOINT, base, _wheel_pose(model, i), part=True, wheel=i)
        primitive = (CYLINDER, (diameter, diameter, _P3DX_WHEEL_WIDTH))
        scene.add(f"{side}Wheel", SHAPE, joint, part=True, primitive=primitive)
        joints.append(joint)
    swivel = scene.add("caster_freeJoint", JOINT, base, (*_P3DX_CASTER, 0.0, 0.0, 0.0, 1.0), part=True)
    link = scene.add("caster_link", SHAPE, swivel, part=True)
    roll = scene.add("caster_freeJoint", JOINT, link, part=True)
    scene.add("caster_wheel", SHAPE, roll, part=True)
    visible = scene.add("visible", SHAPE, base, part=True)
    for x, y, degrees in _P3DX_SONARS:
        bearing = math.radians(degrees)
        pose = frames.composed(
            frames.yawed(x, y, _P3DX_SONAR_HEIGHT, bearing), (0.0, 0.0, 0.0, 0.5, 0.5, 0.5, 0.5)
        )  # z along the bearing, x to its left, y up
        scene.add("ultrasonicSensor", PROXIMITY_SENSOR, visible, pose, part=True, sonar=Sonar(x, y, bearing))
    place = (model.ahead, 0.0, _P3DX_LIDAR_HEIGHT, 0.0, 0.0, 0.0, 1.0)
    lidar = scene.add("lidar", SHAPE, base, place, part=True)
    scanner = scene.add("fastHokuyo", SHAPE, lidar, part=True)
    for half in range(2):
        scene.add(f"fastHokuyo_sensor{half + 1}", VISION_SENSOR, scanner, part=True, scans=half)
    return joints


def _build_omni(scene: Scene, model: Model, base: Object) -> list[Object]:
    joints = []
    for i, wheel in enumerate(model.robot.wheels):
        diameter = 2.0 * wheel.radius
        joint = scene.add(f"wheel{i + 1}", JOINT, base, _wheel_pose(model, i), part=True, wheel=i)
        primitive = (CYLINDER, (diameter, diameter, _OMNI_WHEEL_WIDTH))
        scene.add(f"tyre{i + 1}", SHAPE, joint, part=True, primitive=primitive)
        joints.append(joint)
    return joints
