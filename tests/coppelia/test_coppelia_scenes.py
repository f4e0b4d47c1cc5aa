"""The scenes, models and objects of the server of CoppeliaSim's remote API."""

import itertools
import math
import re

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

cbor2 = pytest.importorskip("cbor2", reason='needs pip install "wayfield[coppelia]"')
zmq = pytest.importorskip("zmq", reason='needs pip install "wayfield[coppelia]"')

from oracles.desk import refused  # noqa: E402

from wayfield.envs.coppelia import models  # noqa: E402
from wayfield.envs.coppelia.scene_files import run_setup  # noqa: E402
from wayfield.envs.coppelia.scenes import Conditions, make_world  # noqa: E402
from wayfield.envs.coppelia.server import Server  # noqa: E402
from wayfield.envs.robots import ROBOTS  # noqa: E402
from wayfield.envs.scenarios import TASKS, scenarios_of  # noqa: E402

SHAPE, JOINT, SENSOR = 0, 1, 5
CUBOID, CYLINDER = 3, 5


# Scenes.


def upright(x, y, z, yaw=0.0):
    return (x, y, z, 0.0, 0.0, math.sin(0.5 * yaw), math.cos(0.5 * yaw))


def test_document_a_s_scene():
    world = make_world("document-a")
    scene = world.scene
    walls = [(2.4, -0.025, 90), (-2.375, 0.025, 90), (0.0, 2.4, 0), (0.025, -2.4, 0)]
    for i, (x, y, degrees) in enumerate(walls):
        node = scene.find(f"/Cuboid[{i}]")
        assert scene.pose(node) == pytest.approx(upright(x, y, 0.25, math.radians(degrees)))
        assert node.primitive == (CUBOID, (5.0, 0.2, 0.5))
    for alias, (x, y), radius in (
        ("Disc", (1.325, 1.525), 0.25),
        ("LH", (0.55, 0.775), 0.05),
        ("Perp", (-0.7, 1.2), 0.05),
    ):
        node = scene.find(f"/{alias}")
        assert scene.pose(node)[:2] == (x, y)
        assert node.footprint is None
        assert node.primitive[1][:2] == (2 * radius, 2 * radius)
    assert scene.pose(scene.base)[:2] == pytest.approx((-1.475, -1.675))
    assert world.robot_pose == (-1.475 + 0.0445, -1.675, 0.0)


@pytest.mark.parametrize("name", ["straight_offset", "circle", "right_angle", "figure_eight_lap"])
def test_a_path_scenario_is_its_path_with_headings(name):
    (scenario, *_) = scenarios_of(TASKS["path_following"], name, 0.2)
    path = scenario.path
    world = make_world(name)
    assert world.robot_pose == pytest.approx(path.start_pose if scenario.start is None else scenario.start)
    fields = (path.vertices[field] for field in ("x", "y", "heading"))
    rows = [upright(x, y, 0.0, heading) for x, y, heading in zip(*fields, strict=True)]
    data = world.scene.find("/Path").data
    assert np.frombuffer(data["PATH"]).reshape(-1, 7) == pytest.approx(np.array(rows))
    assert len(data["PATHCTRLPTS"]) == 56 * (len(rows) - path.closed)


@pytest.mark.parametrize(
    ("scene", "task", "name", "robot"),
    [
        ("document-b", "goal_reaching", "omni3_waypoints", "omni3"),
        ("document-c", "goal_reaching", "apf_1", "omni4"),
        ("push_box", "goal_reaching", "push_box", "p3dx"),
        ("mixed", "goal_reaching", "mixed", "p3dx"),
        ("sideways", "docking", "sideways", "p3dx"),
    ],
)
def test_a_goal_scenario_is_its_start_obstacles_goal_and_waypoints(scene, task, name, robot):
    scenario = scenarios_of(TASKS[task], name, ROBOTS[robot].hull_radius)[0]
    world = make_world(scene)
    assert world.model.robot.name == robot
    assert world.robot_pose == pytest.approx(scenario.start)
    assert world.batch.obstacles[0, : len(scenario.obstacles)].tolist() == scenario.obstacles.tolist()
    solids = [node for node in world.scene.objects.values() if node.footprint is not None]
    for node, o in zip(solids, scenario.obstacles, strict=True):
        kind, (length, width, _) = node.primitive
        assert world.scene.pose(node)[:2] == pytest.approx((o["x"], o["y"]))
        assert length == pytest.approx(2.0 * (o["radius"] if kind == CYLINDER else o["half_length"]))
        assert width == pytest.approx(max(2.0 * (o["radius"] if kind == CYLINDER else o["half_width"]), 0.01))
    goal = world.scene.pose(world.scene.find("/Goal"))
    assert (*goal[:2], 2.0 * math.atan2(goal[5], goal[6])) == pytest.approx(scenario.goal)
    marks = [world.scene.pose(world.scene.find(f"/Waypoint[{k}]"))[:2] for k in range(len(scenario.waypoints))]
    assert marks == [pytest.approx(tuple(point)) for point in scenario.waypoints]
    other = make_world(scene, Conditions("omni3" if robot == "omni4" else "omni4", "pymunk", "lagged", dt=0.02))
    assert other.model.robot.name != robot
    assert (other.dynamics, other.actuators, other.dt) == ("pymunk", "lagged", 0.02)


# Models.


@pytest.mark.parametrize("half", [None, 0.02, 0.1905, 1.0])
def test_the_p3dx_stands_on_its_wheels_with_its_sonars_around_it(half):
    model = models.model_of("p3dx", half)
    track = 0.1655 if half is None else half
    robot, sheet = model.robot, ROBOTS["p3dx"]
    assert [(w.x, w.y, w.radius) for w in robot.wheels] == [(0.0, -track, 0.0975), (0.0, track, 0.0975)]
    assert robot.hull_radius == sheet.hull_radius
    assert robot.track == sheet.wheels[1].y - sheet.wheels[0].y
    assert (model.alias, model.height, model.ahead) == ("PioneerP3DX", 0.1388, 0.0445)
    world = make_world("empty", Conditions(half_track=half))
    scene = world.scene
    base = scene.pose(scene.base)
    assert base == pytest.approx(upright(-0.0445, 0.0, 0.1388))
    for joint, side, y in zip(world.wheels, ("right", "left"), (-track, track), strict=True):
        assert joint.alias == f"{side}Motor"
        assert joint.wheel == (side == "left")
        place = scene.pose(joint)
        assert place[:3] == pytest.approx((0.0, y, 0.0975))
        # the axis, z, to the left
        assert Rotation.from_quat(place[3:]).as_matrix() == pytest.approx(np.array([[1, 0, 0], [0, 0, 1], [0, -1, 0]]))
        (tyre,) = joint.children
        assert (tyre.alias, tyre.kind, tyre.primitive) == (f"{side}Wheel", SHAPE, (CYLINDER, (0.195, 0.195, 0.05)))
    caster = scene.find("/PioneerP3DX/caster_freeJoint")
    assert scene.pose(caster)[:3] == pytest.approx((-0.0445 - 0.149, 0.0, 0.1388 - 0.078))
    chain = [(node.alias, node.kind) for node in caster.tree()]
    assert chain == [
        ("caster_freeJoint", JOINT), ("caster_link", SHAPE), ("caster_freeJoint", JOINT), ("caster_wheel", SHAPE),
    ]  # fmt: skip
    sonars = [node for node in scene.objects.values() if node.kind == SENSOR]
    assert {node.parent.alias for node in sonars} == {"visible"}
    degrees = [90, 50, 30, 10, -10, -30, -50, -90, -90, -130, -150, -170, 170, 150, 130, 90]
    for node, angle in zip(sonars, np.radians(degrees).tolist(), strict=True):
        assert node.alias == "ultrasonicSensor"
        assert node.sonar.bearing == pytest.approx(angle)
        place = scene.pose(node)
        turn = Rotation.from_quat(place[3:]).as_matrix()
        assert place[:3] == pytest.approx((node.sonar.x - 0.0445, node.sonar.y, 0.2068))
        assert turn[:, 2] == pytest.approx([math.cos(angle), math.sin(angle), 0.0], abs=1e-12)
        assert turn[:, 0] == pytest.approx([-math.sin(angle), math.cos(angle), 0.0], abs=1e-12)
        assert turn[:, 1] == pytest.approx([0.0, 0.0, 1.0], abs=1e-12)
    assert all(node.part for node in scene.base.tree())


@pytest.mark.parametrize("name", ["omni3", "omni4", "mecanum4"])
def test_an_omni_base_s_wheel_joints_are_where_its_data_sheet_says(name):
    model, robot = models.model_of(name), ROBOTS[name]
    assert (model.robot, model.alias, model.height, model.ahead) == (robot, name.capitalize(), 0.1, 0.0)
    world = make_world("empty", Conditions(robot=name))
    assert world.scene.pose(world.scene.base) == pytest.approx(upright(0.0, 0.0, 0.1))
    for i, ((x, y), direction) in enumerate(zip(robot.wheel_positions, robot.wheel_directions, strict=True)):
        joint, radius = world.wheels[i], robot.wheels[i].radius
        assert (joint.alias, joint.kind, joint.wheel, joint.parent) == (f"wheel{i + 1}", JOINT, i, world.scene.base)
        place = world.scene.pose(joint)
        turn = Rotation.from_quat(place[3:]).as_matrix()
        assert place[:3] == pytest.approx((x, y, radius))
        assert turn[:, 0] == pytest.approx([math.cos(direction), math.sin(direction), 0.0], abs=1e-12)
        assert turn[:, 2] == pytest.approx([-math.sin(direction), math.cos(direction), 0.0], abs=1e-12)
        (tyre,) = joint.children
        assert (tyre.alias, tyre.primitive) == (f"tyre{i + 1}", (CYLINDER, (2 * radius, 2 * radius, 0.03)))
    assert all(node.part for node in world.scene.base.tree())
    with pytest.raises(ValueError, match="belongs to the p3dx"):
        models.model_of(name, 0.2)


# The tree of objects.


def test_a_turning_joint_takes_its_children_along_and_not_its_own_frame(desk):
    one = desk("empty")
    joint = one.getObject("/leftMotor")
    dummy = one.createDummy(0.1)
    one.startSimulation()
    one.setJointTargetVelocity(joint, 4.0)
    one.setJointTargetVelocity(one.getObject("/rightMotor"), -1e9)
    assert one.getJointTargetVelocity(one.getObject("/rightMotor")) == -1e6
    one.setJointTargetVelocity(one.getObject("/rightMotor"), 4.0)
    for _ in range(30):
        one.world.advance()
    angle = math.remainder(4.0 * 30 * 0.05, 2.0 * math.pi)
    assert one.getJointPosition(joint) == pytest.approx(angle)
    assert one.getJointVelocity(joint) == pytest.approx(4.0)
    place = np.array(one.getObjectPose(joint))
    still = Rotation.from_quat(place[3:])
    turned = still * Rotation.from_euler("z", angle)
    tyre = one.getObjectChild(joint, 0)
    assert abs(np.dot(one.getObjectPose(tyre)[3:], turned.as_quat())) == pytest.approx(1.0)
    at = np.array([0.3, -0.2, 1.0])
    one.setObjectPosition(dummy, at.tolist())
    assert one.getObjectPosition(dummy, joint) == pytest.approx(turned.inv().apply(at - place[:3]).tolist(), abs=1e-9)
    assert one.getObjectPosition(dummy, joint | 0x400000) == pytest.approx(still.inv().apply(at - place[:3]).tolist())
    x, y, z, w = one.getObjectQuaternion(dummy)
    assert one.getObjectPose(dummy | 0x1000000) == [*at.tolist(), w, x, y, z]
    one.setObjectPose(dummy | 0x1000000, [*at.tolist(), 2.0, 0.0, 0.0, 2.0])
    assert one.getObjectQuaternion(dummy) == pytest.approx([0.0, 0.0, math.sqrt(0.5), math.sqrt(0.5)])
    one.setObjectQuaternion(dummy | 0x1000000, [0.0, 3.0, 0.0, 0.0])
    assert one.getObjectQuaternion(dummy) == [1.0, 0.0, 0.0, 0.0]
    assert one.getObjectOrientation(dummy) == pytest.approx([math.pi, 0.0, 0.0])
    refused("cannot be placed relative to itself", one.setObjectPosition, dummy, [0, 0, 0], dummy)
    child = one.createDummy(0.1)
    one.setObjectParent(child, dummy)
    refused("cannot be placed relative to itself", one.setObjectPosition, dummy, [0, 0, 0], child)
    one.setObjectPosition(dummy, [9e5, 0, 0])
    refused("beyond 1e+06 m", one.setObjectPosition, child, [9e5, 0, 0], dummy)
    for value, words in (([0.0] * 4, "the quaternion is zero"), ([1.0] * 3, "4 numbers are needed")):
        refused(words, one.setObjectQuaternion, dummy, value)
    assert one.getJointPosition(one.getObject("/caster_freeJoint")) == 0.0
    free = one.getObject("/caster_freeJoint")
    assert (one.getJointVelocity(free), one.getJointTargetVelocity(free)) == (0.0, 0.0)
    refused("joint is not driven", one.setJointTargetVelocity, free, 1.0)


def test_shapes_are_made_in_their_sizes_and_are_obstacles_when_they_are_tall(desk):
    one = desk("empty")
    names = {1: "Plane", 2: "Disc", 3: "Cuboid", 4: "Sphere", 5: "Cylinder", 6: "Cone"}
    for (kind, name), sizes in itertools.product(
        names.items(), ([0.4, 0.6, 0.3], [0.4, 0.6, 0.019], [0.5], [0.2, 0.3])
    ):
        handle = one.createPrimitiveShape(kind, sizes)
        length, width, height = [*sizes, *[sizes[-1]] * 2][:3]
        node = one.world.scene.objects[handle]
        height = 0.0 if kind in (1, 2) else height
        assert (one.getObjectAlias(handle), one.getObjectType(handle)) == (name, SHAPE)
        assert one.getShapeGeomInfo(handle) == (6, kind, [length, width, height, 0.0])
        assert one.getObjectPose(handle) == [0, 0, 0, 0, 0, 0, 1]
        assert (node.footprint is not None) == (height >= 0.02)
        if node.footprint is not None:
            one.setObjectPose(handle, [1.0, 2.0, 0.5, 0.0, 0.0, math.sin(0.2), math.cos(0.2)])
            o = one.world.batch.obstacles[0, node.footprint.index]
            assert (o["x"], o["y"], math.atan2(o["sin"], o["cos"])) == pytest.approx((1.0, 2.0, 0.4))
            assert o["radius"] == pytest.approx(0.0 if kind == 3 else 0.25 * (length + width))
            assert (o["half_length"], o["half_width"]) == ((0.5 * length, 0.5 * width) if kind == 3 else (0.0, 0.0))
            # one that lies on its side keeps its pose, and its footprint
            one.setObjectOrientation(handle, [0.3, 0.0, 0.0])
            assert one.getObjectOrientation(handle) == pytest.approx([0.3, 0.0, 0.0])
        one.removeObjects([handle, handle])
        assert not one.isHandle(handle)
    for args, words in (
        ((7, [1.0] * 3), "primitive shape type 7 is unknown"),
        ((3, []), "sizes are three numbers"),
        ((3, [1.0, 1.0, 0.9e-4]), "sizes must be 0.0001 to 10000"),
        ((2, [1.0, 1.1e4, 1.0]), "sizes must be 0.0001 to 10000"),
    ):
        refused(words, one.createPrimitiveShape, *args)
    one.createPrimitiveShape(2, [1e-4, 1e4, 0.0])
    assert one.getShapeGeomInfo(one.getObject("/visible")) == (1, 0, [0.0] * 4)
    refused("it must be 0 to 10000", one.createDummy, -0.1)
    refused("it must be 0 to 10000", one.createDummy, 1.1e4)


def test_sonars_are_read_and_sensed(desk):
    one = desk("empty")
    front, back = (one.getObject(f"/ultrasonicSensor[{k}]") for k in (3, 11))
    nothing = (0, 0.0, [0.0, 0.0, 0.0], -1, [0.0, 0.0, 0.0])
    post = one.createPrimitiveShape(5, [0.2, 0.2, 0.5])
    x, y, _ = one.getObjectPosition(front)
    at = [x + 0.6 * math.cos(math.radians(10)), y + 0.6 * math.sin(math.radians(10)), 0.25]
    one.setObjectPosition(post, at)
    assert one.readProximitySensor(front) == nothing
    hit, distance, point, handle, normal = one.handleProximitySensor(front)
    assert (hit, distance, handle) == (1, pytest.approx(0.5), post)
    assert point == pytest.approx([0.0, 0.0, 0.5], abs=1e-9)
    assert normal == pytest.approx([0.0, 0.0, -1.0], abs=1e-9)
    assert one.readProximitySensor(front) == nothing  # the simulation stands
    assert one.checkProximitySensor(front)[:2] == (1, pytest.approx(0.5))
    assert one.checkProximitySensor(front, post)[:2] == (1, pytest.approx(0.5))
    assert one.checkProximitySensor(front, one.getObject("/Floor")) == (0, None, None, None, None)
    assert one.checkProximitySensor(back) == (0, None, None, None, None)
    one.startSimulation()
    one.handleProximitySensor(front)
    assert one.readProximitySensor(front)[:2] == (1, pytest.approx(0.5))
    last = one.getObject("/ultrasonicSensor[15]")
    assert one.handleProximitySensor(-2) == one.world.peek(one.world.scene.objects[last])
    assert one.readProximitySensor(front)[0] == 1
    one.world.advance()
    one.removeObject(post)  # what the last pass saw stays until the next
    assert one.readProximitySensor(front)[3] == post
    one.world.advance()
    assert one.readProximitySensor(front) == nothing
    bare = desk("document-c")
    refused("the scene has none", bare.handleProximitySensor, -2)


@pytest.mark.parametrize("dynamics", ["kinematic", "pymunk"])
def test_a_robot_that_is_put_somewhere_stands_there(desk, dynamics):
    one = desk("arena", actuators="slow", dynamics=dynamics)
    robot, wheels = one.getObject("/PioneerP3DX"), [one.getObject(f"/{side}Motor") for side in ("left", "right")]
    one.startSimulation()
    for wheel, speed in zip(wheels, (3.0, 5.0), strict=True):
        one.setJointTargetVelocity(wheel, speed)
    for _ in range(10):
        one.world.advance()
    driven = one.world.robot_pose
    still = one.getObject("/Cylinder[1]")
    assert one.getObjectVelocity(still) == one.getVelocity(still) == ([0.0] * 3, [0.0] * 3)
    assert one.getObjectVelocity(one.getObject("/Floor")) == ([0.0] * 3, [0.0] * 3)
    speed = one.getObjectVelocity(robot)[0]
    assert math.hypot(*speed) > 0.1
    assert one.world.trail[-1] == driven[:2]
    assert len(one.world.trail) == 10
    one.setObjectPose(robot, [0.5, -0.5, 9.0, 0.0, 0.0, math.sin(0.2), math.cos(0.2)])
    assert one.world.robot_pose == pytest.approx((0.5 + 0.0445 * math.cos(0.4), -0.5 + 0.0445 * math.sin(0.4), 0.4))
    assert one.getObjectVelocity(robot) == ([0.0] * 3, [0.0] * 3)
    assert [one.getJointVelocity(wheel) for wheel in wheels] == [0.0, 0.0]
    assert one.world.batch.states["num_obstacles"][0] == 12
    steps = int(one.world.batch.states["steps"][0])
    assert steps == 10
    # from there it goes on as from a start
    first = one.world.robot_pose
    one.world.advance()
    fresh = desk("arena", actuators="slow", dynamics=dynamics)
    fresh.startSimulation()
    for wheel, speed in zip(("leftMotor", "rightMotor"), (3.0, 5.0), strict=True):
        fresh.setJointTargetVelocity(fresh.getObject(f"/{wheel}"), speed)
    fresh.world.advance()
    (x, y, turn), (there_x, there_y, heading) = fresh.world.robot_pose, one.world.robot_pose
    cosine, sine = math.cos(first[2]), math.sin(first[2])
    assert (there_x, there_y) == pytest.approx((first[0] + cosine * x - sine * y, first[1] + sine * x + cosine * y))
    assert heading - first[2] == pytest.approx(turn)
    # a stop brings back the first start; the next one is like it
    one.stopSimulation()
    for _ in range(3):
        one.world.advance()
    assert one.world.robot_pose == (0.0, 0.0, 0.0)
    one.startSimulation()
    assert one.world.trail == []
    for wheel, speed in zip(wheels, (3.0, 5.0), strict=True):
        one.setJointTargetVelocity(wheel, speed)
    for _ in range(10):
        one.world.advance()
    assert one.world.robot_pose == driven


def test_who_is_run_into_stands_still(desk):
    one = desk("moving_crossing/test")
    one.startSimulation()
    state, moving = one.world.batch.states[0], one.world.batch.obstacles[0]
    one.world.advance()
    first = np.array([moving["x"][0], moving["y"][0]])
    one.world.advance()
    way = np.array([moving["x"][0], moving["y"][0]]) - first
    ahead = first + way * (1.0 + (moving["radius"][0] + 0.4) / math.hypot(*way))
    base = one.world.scene.base.handle
    one.setObjectPosition(base, [*ahead.tolist(), one.getObjectPosition(base)[2]])
    for path, speed in (("/leftMotor", -2.0), ("/rightMotor", 2.5)):
        one.setJointTargetVelocity(one.getObject(path), speed)
    twist = ["vx", "vy", "yaw_rate"]
    for _ in range(60):
        before = state.copy()
        one.world.advance()
        if state["contact"]:
            break
    assert before["yaw_rate"] > 1.0
    assert before["vx"] > 0.01
    for _ in range(2):
        assert [state[name] for name in twist] == [0.0] * 3
        assert [state[name] for name in ("x", "y", "heading")] == [before[name] for name in ("x", "y", "heading")]
        one.world.advance()


# Scenes of one's own.

SCENE = """{"scene": "empty", "start": [-1, 0.5, 0.3], "objects": [
 {"kind": "disc", "name": "Goal", "at": [2, 1], "radius": 0.2, "colour": [0, 0.6, 0.4]},
 {"kind": "sphere", "name": "Sphere", "at": [0, 2], "radius": 0.1, "obstacle": false},
 {"kind": "dummy", "name": "P1", "at": [1, 0.5, 0.7]},
 {"kind": "box", "name": "Wall", "at": [3, 0, 0.5], "length": 4, "width": 0.2},
 {"kind": "robot", "at": [-2, 2, 1]},
 {"kind": "path", "name": "Track", "points": [[0, 0], [1, 1], [2, 0]]}]}"""


def test_a_scene_file_has_its_objects_where_it_says(tmp_path, desk):
    file = tmp_path / "mine.json"
    file.write_text(SCENE)
    one = desk(str(file))
    for name, place in (("Goal", [2, 1, 0.002]), ("Sphere", [0, 2, 0.1]), ("P1", [1, 0.5, 0]), ("Wall", [3, 0, 0.25])):
        assert one.getObjectPosition(one.getObject(f"/{name}")) == pytest.approx(place), name
    assert one.getObjectOrientation(one.getObject("/Wall"))[2] == pytest.approx(0.5)
    robots = [one.getObject(f"/PioneerP3DX[{i}]") for i in range(2)]
    assert [one.getObjectPosition(each)[:2] for each in robots] == [
        pytest.approx([-1, 0.5]),
        pytest.approx([-2, 2]),
    ]
    solid = {node.alias for node in one.world.scene.objects.values() if node.footprint is not None}
    assert solid == {"Wall", "PioneerP3DX"}
    rows = np.frombuffer(one.getBufferProperty(one.getObject("/Track"), "customData.PATH")).reshape(-1, 7)
    assert rows[:, :2].tolist() == [[0, 0], [1, 1], [2, 0]]


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ('"dummy"', '"dumy"', "Did you mean 'dummy'?"),
        ('"at": [2, 1]', '"at": [2]', r"objects[0].at"),
        ('"radius": 0.1', '"radius": -1', r"objects[1].radius"),
        ('"name": "P1"', '"name": "a/b"', r"objects[2].name"),
        ('"empty"', '"emty"', "Did you mean 'empty'?"),
        ("[0, 0], [1, 1], [2, 0]", "[0, 0]", "path"),
        ('"objects"', '"object"', "'object'"),
    ],
)
def test_what_is_wrong_with_a_scene_file_is_one_line(tmp_path, old, new, words):
    file = tmp_path / "mine.json"
    file.write_text(SCENE.replace(old, new))
    with pytest.raises(ValueError, match=f"^{re.escape(str(file))}: .*{re.escape(words)}") as found:
        make_world(str(file))
    assert "\n" not in str(found.value)


def test_a_setup_script_makes_what_scripts_ask_for(tmp_path):
    script = tmp_path / "setup.py"
    script.write_text(
        "for i in range(3):\n"
        "    point = sim.createDummy(0.1)\n"
        "    sim.setObjectAlias(point, f'P{i}')\n"
        "    sim.setObjectPosition(point, [i, 0.5, 0.0])\n"
        "sim.setStringSignal('ready', 'yes')\n"
    )
    with Server(make_world("empty"), port=0, speed=0.0) as server:
        run_setup(str(script), server)
        scene = server.world.scene
        assert [scene.pose(scene.find(f"/P{i}"))[:2] for i in range(3)] == [(i, 0.5) for i in range(3)]
        assert server.world.signals == {"ready": "yes"}
        script.write_text("sim.step()\nsim.startSimulation()\nsim.step()")
        with pytest.raises(RuntimeError, match=r"sim.step waits for a pass"):
            run_setup(str(script), server)
