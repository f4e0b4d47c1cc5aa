"""The scenes, models, objects and clock of the server of CoppeliaSim's remote API, stated once more."""

import itertools
import math

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

cbor2 = pytest.importorskip("cbor2", reason='needs pip install "wayfield[coppelia]"')
zmq = pytest.importorskip("zmq", reason='needs pip install "wayfield[coppelia]"')

from test_restated_coppelia import refused  # noqa: E402

from wayfield.envs.coppelia import constants, models, server  # noqa: E402
from wayfield.envs.coppelia.scenes import Conditions, make_world  # noqa: E402
from wayfield.envs.coppelia.signatures import Wait  # noqa: E402
from wayfield.envs.robots import ROBOTS  # noqa: E402
from wayfield.envs.scenarios import TASKS, scenarios_of  # noqa: E402

SHAPE, JOINT, DUMMY, SENSOR = 0, 1, 4, 5
DISC, CUBOID, CYLINDER = 2, 3, 5


# Scenes.


def furniture(world):
    """Returns alias, kind, pose, primitive and colour of what is no part of the robot, in order."""
    return [
        (node.alias, node.kind, world.scene.pose(node), node.primitive, node.colour)
        for node in world.scene.objects.values()
        if not node.part
    ]


def upright(x, y, z, yaw=0.0):
    return (x, y, z, 0.0, 0.0, math.sin(0.5 * yaw), math.cos(0.5 * yaw))


def lying(alias, x, y, radius, colour, yaw=0.0):
    return alias, SHAPE, upright(x, y, 0.002, yaw), (DISC, (2 * radius, 2 * radius, 0.002)), colour


def floor(low_x, low_y, high_x, high_y):
    middle = upright(0.5 * (low_x + high_x), 0.5 * (low_y + high_y), 0.0)
    return "Floor", SHAPE, middle, (CUBOID, (high_x - low_x, high_y - low_y, 0.002)), None


def solid(alias, x, y, length, width, degrees, height=0.5):
    sizes = (length, length if width is None else width, height)
    return (
        alias,
        SHAPE,
        upright(x, y, 0.5 * height, math.radians(degrees)),
        (CYLINDER if width is None else CUBOID, sizes),
        None,
    )


def compared(world, wanted):
    found = furniture(world)
    assert [each[:2] for each in found] == [each[:2] for each in wanted]
    for (alias, _, pose, primitive, colour), (_, _, there, shape, shade) in zip(found, wanted, strict=True):
        assert pose[:3] == pytest.approx(there[:3], abs=1e-9), alias
        assert abs(np.dot(pose[3:], there[3:])) == pytest.approx(1.0, abs=1e-9), alias
        assert (primitive is None) == (shape is None)
        if shape is not None:
            assert primitive[0] == shape[0], alias
            assert primitive[1] == pytest.approx(shape[1], abs=1e-9), alias
        assert (colour is None) == (shade is None)
        assert colour is None or colour == pytest.approx(shade)
    # what stands in the way is as large as it is shown, but that a wall without thickness is shown with some
    solids = [node for node in world.scene.objects.values() if node.footprint is not None]
    assert [node.footprint.index for node in solids] == list(range(len(solids)))
    for node, o in zip(solids, world.batch.obstacles[0], strict=False):
        kind, (length, width, _) = node.primitive
        half = 0.0 if node.alias == "Wall" and width == 0.01 else 0.5 * width
        sizes = (0.0, 0.0, half) if kind == CYLINDER else (0.5 * length, half, 0.0)
        assert (o["half_length"], o["half_width"], o["radius"]) == pytest.approx(sizes), node.alias
        place = world.scene.pose(node)
        assert (o["x"], o["y"]) == pytest.approx(place[:2])


GREEN, PURPLE, ORANGE, TEAL = (0.2, 0.7, 0.3), (0.6, 0.3, 0.7), (0.9, 0.4, 0.1), (0.0, 0.62, 0.45)


def test_the_plain_scenes_are_floors_with_walls_and_things():
    world = make_world("empty")
    compared(world, [floor(-5.0, -5.0, 5.0, 5.0)])
    assert world.bounds == (-5.0, -5.0, 5.0, 5.0)
    assert world.robot_pose == (0.0, 0.0, 0.0)
    world = make_world("arena")
    walls = [(5.0, 0.0, 90), (-5.0, 0.0, 90), (0.0, 5.0, 0), (0.0, -5.0, 0)]
    posts = [(2.0, 1.5, 0.3), (-2.5, 2.0, 0.4), (1.0, -2.5, 0.25), (-3.0, -2.5, 0.5), (3.5, -1.0, 0.2)]
    boxes = [(0.0, 3.2, 1.2, 0.4, 20), (-1.5, -1.2, 0.6, 0.6, 45), (3.2, 3.0, 0.8, 0.3, -30)]
    compared(
        world,
        [
            floor(-5.0, -5.0, 5.0, 5.0),
            *(solid("Wall", x, y, 10.0, 0.2, turn) for x, y, turn in walls),
            *(solid("Cylinder", x, y, 2 * radius, None, 0.0) for x, y, radius in posts),
            *(solid("Cuboid", *box) for box in boxes),
        ],
    )
    fields = world.batch.obstacles[0, :12]
    assert fields["radius"][4:9] == pytest.approx([radius for _, _, radius in posts])
    assert fields["half_length"][9:] == pytest.approx([0.5 * length for _, _, length, _, _ in boxes])
    assert fields["half_width"][:4] == pytest.approx([0.1] * 4)
    assert np.arctan2(fields["sin"], fields["cos"])[9:] == pytest.approx(np.radians([20, 45, -30]))


@pytest.mark.parametrize("robot", [None, "omni4"])
def test_document_a_s_scene(robot):
    world = make_world("document-a", Conditions(robot))
    walls = [(2.4, -0.025, 90), (-2.375, 0.025, 90), (0.0, 2.4, 0), (0.025, -2.4, 0)]
    controls = [
        (-1.8701, 2.225, 0, 0, 0, 0, 1),
        (-1.43951, -1.552455, 0, 0, 0, math.sin(math.pi / 16), math.cos(math.pi / 16)),
        (2.60524, 0.50524, 0, 0, 0, math.sin(math.pi / 8), math.cos(math.pi / 8)),
        (0.522545, -1.88951, 0, 0, 0, math.sin(3 * math.pi / 16), math.cos(3 * math.pi / 16)),
    ]
    kinds = [each[:3] for each in furniture(world)]
    assert [kind[:2] for kind in kinds] == [
        ("Floor", SHAPE), *[("Cuboid", SHAPE)] * 4, ("Disc", SHAPE), ("LH", SHAPE), ("Perp", SHAPE), ("Path", DUMMY),
        *[("ctrlPt", DUMMY)] * 4,
    ]  # fmt: skip
    assert np.array([pose for _, _, pose in kinds[-4:]]) == pytest.approx(np.array(controls), abs=2e-5)
    shown = furniture(world)
    compared_part = [floor(-2.5, -2.5, 2.5, 2.5), *(solid("Cuboid", x, y, 5.0, 0.2, turn) for x, y, turn in walls)]
    compared_part += [
        lying("Disc", 1.325, 1.525, 0.25, GREEN), lying("LH", 0.55, 0.775, 0.05, PURPLE),
        lying("Perp", -0.7, 1.2, 0.05, ORANGE),
    ]  # fmt: skip
    for found, wanted in zip(shown, compared_part, strict=False):
        assert found[2] == pytest.approx(wanted[2], abs=1e-9)
        assert found[3][0] == wanted[3][0]
        assert found[3][1] == pytest.approx(wanted[3][1])
        assert found[4] == wanted[4]
    ahead = 0.0445 if robot is None else 0.0
    assert world.robot_pose == (-1.475 + ahead, -1.675, 0.0)
    assert world.scene.pose(world.scene.base)[:2] == pytest.approx((-1.475, -1.675))
    path = world.scene.find("/Path")
    assert len(np.frombuffer(path.data["PATH"])) == 700
    quaternions = np.frombuffer(path.data["PATHCTRLPTS"]).reshape(-1, 7)[:, 3:]
    assert np.linalg.norm(quaternions, axis=1) == pytest.approx(1.0, abs=1e-15)


@pytest.mark.parametrize("name", ["straight_offset", "circle", "right_angle", "figure_eight_lap"])
def test_a_path_scenario_is_a_floor_a_path_and_three_markers(name):
    (scenario, *_) = scenarios_of(TASKS["path_following"], name, 0.2)
    path, points = scenario.path, scenario.path.points
    start = path.start_pose if scenario.start is None else scenario.start
    world = make_world(name)
    assert world.robot_pose == pytest.approx(start)
    headings = path.vertices["heading"]
    rows = [upright(x, y, 0.0, h) for x, y, h in zip(path.vertices["x"], path.vertices["y"], headings, strict=True)]
    node = world.scene.find("/Path")
    assert np.frombuffer(node.data["PATH"]).reshape(-1, 7) == pytest.approx(np.array(rows))
    controls = rows[:-1] if path.closed else rows
    assert np.frombuffer(node.data["PATHCTRLPTS"]).reshape(-1, 7) == pytest.approx(np.array(controls))
    dummies = [("ctrlPt", DUMMY, row, None, None) for row in controls] if len(controls) <= 200 else []
    low, high = points.min(axis=0) - 1.0, points.max(axis=0) + 1.0
    end = points[0 if path.closed else -1]
    compared(
        world,
        [
            floor(*low, *high),
            ("Path", DUMMY, upright(0.0, 0.0, 0.0), None, None),
            *dummies,
            lying("Disc", *end, 0.25, GREEN),
            lying("LH", *start[:2], 0.05, PURPLE),
            lying("Perp", *points[0], 0.05, ORANGE),
        ],
    )
    assert world.bounds == pytest.approx((*low, *high))


def goal_scene(scenario):
    places = [scenario.start[:2], scenario.goal[:2], *scenario.waypoints]
    solids = []
    for o in scenario.obstacles:
        x, y, length, width, radius = (float(o[k]) for k in ("x", "y", "half_length", "half_width", "radius"))
        reach = length + width + radius
        places += [(x - reach, y - reach), (x + reach, y + reach)]
        turn = math.degrees(math.atan2(o["sin"], o["cos"]))
        if length == width == 0.0:
            solids.append(solid("Cylinder", x, y, 2 * radius, None, turn))
        elif width == 0.0:
            solids.append(solid("Wall", x, y, 2 * length, 0.01, turn))
        else:
            solids.append(solid("Cuboid", x, y, 2 * length, max(2 * width, 0.01), turn))
    low, high = np.min(places, axis=0) - 1.0, np.max(places, axis=0) + 1.0
    goal = lying("Goal", *scenario.goal[:2], max(scenario.position_tolerance, 0.05), TEAL, scenario.goal[2])
    return [floor(*low, *high), *solids, goal, *(lying("Waypoint", x, y, 0.05, TEAL) for x, y in scenario.waypoints)]


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
def test_a_goal_scenario_is_a_floor_its_obstacles_its_goal_and_waypoints(scene, task, name, robot):
    hull = ROBOTS[robot].hull_radius
    scenario = scenarios_of(TASKS[task], name, hull)[0]
    world = make_world(scene)
    assert world.model.robot.name == robot
    assert world.robot_pose == pytest.approx(scenario.start)
    compared(world, goal_scene(scenario))
    assert world.batch.obstacles[0, : len(scenario.obstacles)].tolist() == scenario.obstacles.tolist()
    other = make_world(scene, Conditions("omni3" if robot == "omni4" else "omni4", "pymunk", "lagged", dt=0.02))
    assert other.model.robot.name != robot
    assert (other.dynamics, other.actuators, other.dt) == ("pymunk", "lagged", 0.02)


def test_a_family_s_scenarios_are_scenes_by_their_number():
    bank = scenarios_of(TASKS["goal_reaching"], "moving_crossing/test", ROBOTS["p3dx"].hull_radius)
    for number in (0, 3):
        world = make_world("moving_crossing/test", Conditions(number=number))
        compared(world, goal_scene(bank[number]))
        assert world.moving
        moving = [node.footprint.patrol for node in world.scene.objects.values() if node.footprint is not None]
        wanted = [patrol if patrol["leg_time"] > 0.0 else None for patrol in bank[number].patrols]
        assert [None if p is None else p.tolist() for p in moving] == [
            None if p is None else p.tolist() for p in wanted
        ]
        world.start()
        for _ in range(4):
            before = world.batch.obstacles[0, : len(wanted)].copy()
            world.advance()
            after = world.batch.obstacles[0]
            for j, node in enumerate(node for node in world.scene.objects.values() if node.footprint is not None):
                way = [(float(after[j][k]) - float(before[j][k])) / 0.05 for k in "xy"]
                linear, angular = world.velocity(node)
                assert (linear[2], angular) == (0.0, (0.0, 0.0, 0.0))
                assert linear[:2] == pytest.approx(way, abs=0.02) or world.batch.obstacles[0, j]["x"] == after[j]["x"]
    assert not make_world("mixed").moving
    for number in (len(bank), -1):
        with pytest.raises(ValueError, match=f"has {len(bank)} scenarios; index is {number}"):
            make_world("moving_crossing/test", Conditions(number=number))


def test_what_is_no_scene_is_named(tmp_path):
    for name, words in (
        ("emty", "is unknown.*The scenes are document-a"),
        ("own.ttt", "own format"),
        ("OWN.TTT", "own"),
    ):
        with pytest.raises(ValueError, match=words):
            make_world(name)
    file = tmp_path / "own.json"
    file.write_text('{"goal": [2, 0, 0]}')
    assert make_world(str(file)).scene.find("/Goal") is not None
    with pytest.raises(ValueError, match="is unknown"):
        make_world(str(file), files=False)
    with pytest.raises(ValueError, match="is unknown"):
        make_world("moving_crossing/test", files=False)
    assert make_world("apf_0", files=False).scene.find("/Goal") is not None
    file.write_text('{"path": [[0, 0], [1, 0]]}')
    assert make_world(str(file)).scene.find("/Path") is not None


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
    # those in front from left to right, those behind the other way round, on two rings: both sides alike within a cm
    places = np.array([(node.sonar.x, node.sonar.y) for node in sonars])
    assert places == pytest.approx(places[[7, 6, 5, 4, 3, 2, 1, 0, 15, 14, 13, 12, 11, 10, 9, 8]] * [1, -1], abs=5e-3)
    assert places[:8] == pytest.approx(-places[8:] - [0.0041, 0.0], abs=5e-3)
    ring = np.hypot(places[:, 0], places[:, 1])
    assert ((ring > 0.174) & (ring < 0.216)).all()
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


@pytest.mark.parametrize("half", [0.0199, 1.001, -0.2, math.nan])
def test_a_half_track_is_within_bounds(half):
    with pytest.raises(ValueError, match=r"0\.02 to 1"):
        models.model_of("p3dx", half)


# The tree of objects.


def test_a_tree_of_objects_is_kept_as_it_is_told(desk):
    """A tree of dummies is changed at random; beside it is kept what its frames and lists must be."""
    one = desk("document-a")
    rng = np.random.default_rng(4)
    own = {}  # handle: parent, and pose in the world
    frames = {-1: (np.zeros(3), Rotation.identity())}
    family = {-1: []}

    def relative(child, parent):
        (p, a), (q, b) = frames[parent], frames[child]
        return a.inv().apply(q - p), a.inv() * b

    def below(handle):
        return [handle, *(each for child in family[handle] for each in below(child))]

    for _ in range(12):
        handle = one.createDummy(0.1)
        place, turn = rng.uniform(-2, 2, 3), Rotation.random(random_state=rng)
        one.setObjectPose(handle, [*place.tolist(), *turn.as_quat().tolist()])
        own[handle], frames[handle], family[handle] = -1, (place, turn), []
        family[-1].append(handle)
    for _ in range(60):
        child = int(rng.choice(list(own)))
        to = int(rng.choice([-1, *own]))
        keep = bool(rng.integers(2))
        if to in below(child):
            refused("its own parent", one.setObjectParent, child, to, keep)
            continue
        offset = {each: relative(each, own[child]) for each in below(child)}
        family[own[child]].remove(child)
        one.setObjectParent(child, to, *([] if keep and rng.integers(2) else [keep]))
        family[to].append(child)
        if not keep:
            p, a = frames[to]
            frames.update({each: (p + a.apply(q), a * b) for each, (q, b) in offset.items()})
        own[child] = to
    for handle, parent in own.items():
        (place, turn), found = frames[handle], one.getObjectPose(handle)
        assert found[:3] == pytest.approx(place.tolist(), abs=1e-9)
        assert abs(np.dot(found[3:], turn.as_quat())) == pytest.approx(1.0, abs=1e-9)
        assert one.getObjectParent(handle) == parent
        assert [one.getObjectChild(handle, k) for k in range(-1, len(family[handle]) + 1)] == [-1, *family[handle], -1]
        assert one.getObjectsInTree(handle) == below(handle)
        assert one.getObjectsInTree(handle, -2, 1) == below(handle)[1:]
        assert one.getObjectsInTree(handle, -2, 2) == [handle, *family[handle]]
        assert one.getObjectsInTree(handle, -2, 3) == family[handle]
        assert one.getObjectsInTree(handle, SHAPE, 3) == []
        assert one.getObjectsInTree(handle, DUMMY) == below(handle)
        q, b = relative(handle, parent)
        assert one.getObjectPosition(handle, -11) == pytest.approx(q.tolist(), abs=1e-9)
        assert one.getObjectMatrix(handle, -11) == pytest.approx(
            np.column_stack([b.as_matrix(), q]).ravel().tolist(), abs=1e-9
        )
    everything = one.getObjectsInTree(-12)
    assert everything == one.getObjectsInTree(-1)
    assert sorted(everything) == sorted(one.world.scene.objects)
    roots = one.getObjectsInTree(-12, -2, 2)
    assert roots == [handle for handle in roots if one.getObjectParent(handle) == -1]
    assert set(roots) == {handle for handle in everything if one.getObjectParent(handle) == -1}
    for kind in (SHAPE, JOINT, DUMMY, SENSOR, -2):
        of_kind = [h for h in sorted(everything) if kind in (-2, one.getObjectType(h))]
        assert [one.getObjects(i, kind) for i in range(-1, len(of_kind) + 1)] == [-1, *of_kind, -1]
    # one that goes leaves its children where they are
    gone = next(handle for handle in own if family[handle] and own[handle] != -1)
    children, at, home = family[gone], {h: one.getObjectPose(h) for h in own}, own[gone]
    assert one.isHandle(gone) is True
    assert one.removeObject(gone) == 1
    assert one.isHandle(gone) is False
    for child in children:
        assert one.getObjectParent(child) == home
        assert one.getObjectPose(child) == pytest.approx(at[child], abs=1e-9)
    top = next(handle for handle in own if own[handle] == -1 and len(below(handle)) > 1)
    count = len(one.getObjectsInTree(top))
    assert one.removeModel(top) == count
    assert not any(one.isHandle(handle) for handle in below(top))


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


def test_names_of_objects(desk):
    one = desk("document-a")
    sensor = one.getObject("/ultrasonicSensor[4]")
    aliases = [one.getObjectAlias(sensor, option) for option in (-1, 0, 1, 2, 4, 5, 3)]
    assert aliases == [
        "ultrasonicSensor", "ultrasonicSensor[4]", "/PioneerP3DX/ultrasonicSensor[4]",
        "/PioneerP3DX/visible/ultrasonicSensor[4]", f"ultrasonicSensor__{sensor}__", "/PioneerP3DX/ultrasonicSensor[4]",
        "ultrasonicSensor",
    ]  # fmt: skip
    assert one.getObjectName(sensor) == "ultrasonicSensor"
    assert one.getObjectAlias(one.getObject("/Cuboid[2]"), 2) == "/Cuboid[2]"
    assert one.getObject("/ultrasonicSensor", {"index": 4}) == sensor
    assert one.getObject("/ultrasonicSensor", {"index": None}) == one.getObject("/ultrasonicSensor[0]")
    refused("options.index: it is negative", one.getObject, "/ultrasonicSensor", {"index": -1})
    refused("options.index: got", one.getObject, "/ultrasonicSensor", {"index": "a"})
    assert one.getObject("/ultrasonicSensor", {"index": 99, "noError": True}) == -1
    assert one.getObjectHandle("Pioneer_p3dx") == one.getObject("/PioneerP3DX")
    assert one.getObjectHandle("Pioneer_p3dx_ultrasonicSensor5") == sensor
    for name in ("Pioneer_p3dx_ultrasonicSensor0", "Pioneer_p3dx_ultrasonicSensor17", "Pioneer_p3dx_arm", "LH"):
        assert one.getObjectHandle(name, {"noError": True}) == -1
    refused("is no path such as", one.getObject, "Pioneer_p3dx")
    dummy = one.createDummy(0.1)
    for alias in ("a", "x" * 128, "own-name_1. b"):
        one.setObjectAlias(dummy, alias)
        assert one.getObjectAlias(dummy) == alias
    for alias in ("", "x" * 129, "a/b", "a\n"):
        refused("an alias is 1 to 128", one.setObjectAlias, dummy, alias)
    refused("its name is fixed", one.setObjectAlias, sensor, "a")
    refused("its parent is fixed", one.setObjectParent, sensor, -1)
    refused("the robot stays", one.removeObject, one.getObject("/PioneerP3DX"))
    refused("the robot stays", one.removeModel, one.getObject("/leftMotor"))
    refused("stands on the floor", one.setObjectParent, one.getObject("/Cuboid[0]"), dummy)
    assert one.setObjectParent(one.getObject("/Cuboid[0]"), -1) is None
    chain = [one.createDummy(0.1) for _ in range(65)]
    for parent, child in itertools.pairwise(chain[:64]):
        one.setObjectParent(child, parent)
    refused("65 levels; 64 is most", one.setObjectParent, chain[64], chain[63])
    one.setObjectParent(chain[0], -1)
    refused("65 levels; 64 is most", one.setObjectParent, chain[0], chain[64])


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
        assert one.getShapeBB(handle) == ([length, width, height], [0, 0, 0, 0, 0, 0, 1])
        box = [-0.5 * length, -0.5 * width, -0.5 * height, 0.5 * length, 0.5 * width, 0.5 * height]
        assert [one.getObjectFloatParam(handle, which) for which in range(15, 21)] == box
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
    for which in (14, 21):
        refused(f"parameter {which} is unknown", one.getObjectFloatParam, one.getObject("/Floor"), which)
    assert one.getObjectInt32Param(one.getObject("/Floor"), 10) == 1
    refused("parameter 11 is unknown", one.getObjectInt32Param, one.getObject("/Floor"), 11)
    assert one.getShapeGeomInfo(one.getObject("/visible")) == (1, 0, [0.0] * 4)
    refused("it must be 0 to 10000", one.createDummy, -0.1)
    refused("it must be 0 to 10000", one.createDummy, 1.1e4)


def test_colours_are_the_first_three_numbers_within_0_and_1(desk):
    one = desk("empty")
    dummy = one.createDummy(0.3, [2.0, 0.25, -1.0, 9.0])
    node = one.world.scene.objects[dummy]
    assert (node.size, node.colour) == (0.3, (1.0, 0.25, 0.0))
    assert one.setObjectColor(dummy, 0, 0, [0.1, 0.2, 0.3]) == 1
    assert node.colour == (0.1, 0.2, 0.3)
    one.setShapeColor(dummy, None, 1)
    one.setShapeColor(dummy, [])
    assert node.colour == (0.1, 0.2, 0.3)
    for values, words in (
        ([1.0, 2.0], "3 to 12 numbers, got 2"),
        ([1.0] * 13, "got 13"),
        ([1.0, "a", 1.0], "the colour:"),
    ):
        refused(words, one.createDummy, 0.1, values)
    assert one.world.scene.objects[one.createDummy()].size == 0.01


def test_what_a_joint_says_of_itself(desk):
    one = desk("empty")
    joint = one.getObject("/leftMotor")
    force = ("getJointTargetForce", "getJointMaxForce")
    assert [getattr(one, name)(joint) for name in (*force, "getJointForce")] == [3.0, 3.0, 0.0]
    for value, name in ((2.0, "setJointTargetForce"), (1.5, "setJointForce"), (4.0, "setJointMaxForce")):
        assert getattr(one, name)(joint, value) == 1
        assert [getattr(one, each)(joint) for each in force] == [value] * 2
    assert one.getJointMode(joint) == (5, 0)
    assert one.getJointType(joint) == 10
    assert one.getJointInterval(joint) == (True, [-math.pi, 2.0 * math.pi])
    for name in ("setJointPosition", "setJointTargetPosition"):
        refused("velocity control", getattr(one, name), joint, 1.0)
    refused("object is not a joint", one.getJointPosition, one.getObject("/Floor"))
    refused("object is not a shape", one.getShapeGeomInfo, joint)
    refused("not a proximity sensor", one.readProximitySensor, joint)
    refused("no object has the handle 999", one.getObjectPose, 999)
    refused("no object has the handle -1", one.getObjectPose, -1)
    for name in ("setObjectInt32Param", "setObjectFloatParam", "setModelProperty"):
        assert getattr(one, name)(joint) == 1
    assert len(one.server.said) == 4


def test_sonars_are_read_sensed_and_reset(desk):
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
    one.resetProximitySensor(front)
    assert one.readProximitySensor(front) == nothing
    one.world.advance()
    assert one.readProximitySensor(front)[0] == 1
    one.resetProximitySensor(-2)
    assert one.readProximitySensor(front) == nothing
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


# Time.


def test_a_simulation_goes_through_its_states_and_brings_back_what_was(desk):
    one = desk("arena", dt=0.1)
    states = []

    def passes(count):
        for _ in range(count):
            one.world.advance()
            states.append(one.getSimulationState())

    assert (one.getSimulationState(), one.getSimulationTime(), one.getSimulationTimeStep()) == (0, 0.0, 0.1)
    assert one.getSimulationStopping()
    box = one.getObject("/Cuboid[0]")
    at = one.getObjectPose(box)
    one.startSimulation()
    states.append(one.getSimulationState())
    one.startSimulation()
    made = one.createDummy(0.1)
    passes(2)
    one.setObjectPosition(box, [4.0, 4.0, 0.2])
    one.setJointTargetVelocity(one.getObject("/leftMotor"), 2.0)
    one.pauseSimulation()
    passes(2)
    one.startSimulation()
    states.append(one.getSimulationState())
    passes(1)
    assert not one.getSimulationStopping()
    assert one.getSimulationTime() == pytest.approx(0.5)
    one.stopSimulation()
    passes(1)
    assert one.getSimulationStopping()
    passes(1)
    assert one.getSimulationStopping()
    assert one.isHandle(made)
    passes(1)
    assert states == [16, 17, 17, 19, 8, 20, 17, 21, 22, 0]
    assert one.getObjectPose(box) == at
    assert not one.isHandle(made)
    assert one.getJointTargetVelocity(one.getObject("/leftMotor")) == 0.0
    assert one.world.robot_pose == (0.0, 0.0, 0.0)
    assert one.world.passes == 8
    one.pauseSimulation()
    one.startSimulation()
    assert one.getSimulationTime() == 0.0
    passes(1)
    assert states[-1] == 17  # a pause that was asked for while nothing ran is none
    one.pauseSimulation()
    passes(2)
    one.stopSimulation()
    assert one.getSimulationState() == 21


def test_stepping_locks_and_waits_are_counted(desk):
    one = desk("empty")
    client = one.client
    assert [one.setStepping(), one.setStepping(True), one.setStepping(False)] == [0, 1, 2]
    assert client.level == 1
    assert [one.setStepping(0), one.setStepping(0)] == [1, 0]
    assert client.level == 0
    client.level = 1_000_000
    refused("stepping is enabled 1,000,000 times", one.setStepping)
    client.level, client.locks = 0, 1_000_000
    refused("the lock is held 1,000,000 times", one.acquireLock)
    client.locks = 0
    one.releaseLock()
    one.acquireLock()
    one.acquireLock()
    one.releaseLock()
    assert client.locks == 1
    assert one.step() is None  # nothing runs
    assert one.wait(1.0) == 0.0
    assert not client.wish
    one.startSimulation()
    for name in ("step", "yield", "switchThread"):
        client.wish = False
        waiting = getattr(one, name)()
        assert client.wish
        assert waiting.done() is None
        assert not waiting.steps
        one.world.advance()
        assert waiting.done() == []
        client.wish = False
        assert getattr(one, name)(False) is None
        assert client.wish
    waiting = one.wait(0.12)
    assert waiting.steps
    for _ in range(2):
        assert waiting.done() is None
        one.world.advance()
    assert waiting.done() is None
    one.world.advance()
    (left,) = waiting.done()
    assert left == pytest.approx(0.12 - 0.15)
    stepping, timed, ending = one.step(), one.wait(100.0), one.stopSimulation(True)
    assert isinstance(ending, Wait)
    assert one.stopSimulation() is None
    for _ in range(3):
        assert ending.done() is None
        one.world.advance()
    assert ending.done() == []
    assert (stepping.done(), len(timed.done())) == ([], 1)
    clocked = one.wait(0.0, False)
    assert clocked.done()[0] <= 0.0
    slow = one.wait(50.0, False)
    assert slow.done() is None
    assert not slow.steps
    assert slow.until == pytest.approx(server.time.monotonic() + 50.0, abs=5.0)
    one.startSimulation()
    ahead, longest = one.step(), one.wait(1e9)
    one.server.replace(make_world("empty"))
    assert ahead.done() == []
    assert longest.done() == [pytest.approx(1e6)]


def test_the_program_s_numbers(desk):
    one = desk("arena")
    assert [one.getInt32Param(which) for which in (1, 30, 26)] == [40900, 6, 0]
    one.setInt32Param(26, 8)
    assert one.getInt32Param(26) == 8
    assert one.getBoolParam(25) is one.getRealTimeSimulation() is False
    one.setBoolParam(25, 1)
    assert one.getBoolParam(25) is one.getRealTimeSimulation() is True
    one.setFloatParam(1, 0.02)
    assert one.getFloatParam(1) == one.getSimulationTimeStep() == 0.02
    assert one.getStringParam(0) == "arena"
    assert 0.0 <= one.getSystemTime() < 100.0
    for function, args, words in (
        (one.getInt32Param, [2], "parameter 2 is not known"),
        (one.setInt32Param, [1, 5], "parameter 1 cannot be set"),
        (one.getBoolParam, [26], "parameter 26 is not known"),
        (one.setBoolParam, [26, 1], "parameter 26 cannot be set"),
        (one.getFloatParam, [2], "parameter 2 is not known"),
        (one.setFloatParam, [2, 0.1], "parameter 2 cannot be set"),
        (one.setFloatParam, [1, 0.9e-3], "it must be 0.001 to 1"),
        (one.setFloatParam, [1, 1.1], "it must be 0.001 to 1"),
    ):
        refused(words, function, *args)
    for dt in (1e-3, 1.0):
        one.setFloatParam(1, dt)
        assert one.world.dt == dt
    one.startSimulation()
    refused("simulation is not stopped", one.setFloatParam, 1, 0.05)
    refused("simulation is not stopped", one.loadScene, "empty")
    one.world.stop()
    for _ in range(3):
        one.world.advance()
    refused("this server serves one scene", one.loadScene, "empty")
    assert one.setThreadAutomaticSwitch() is True
    assert one.setThreadSwitchTiming(2) is None
    assert one.addStatusbarMessage("words") == 1
    found = one.testCB(1, "mine@func", 2)
    assert (found.function, found.args) == ("mine", [1, 2])
    for name in ("mine", "@func"):
        refused("must be a function", one.testCB, 1, name, 2)


def test_a_loaded_scene_takes_the_place_of_the_old_one(desk):
    one = desk("arena")
    one.server.load = lambda name: make_world(name, files=False)
    one.setStringSignal("s", "kept")
    dummy = one.createDummy(0.1)
    one.writeCustomDataBlock(dummy, "d", b"123")
    assert one.loadScene("empty") == 1
    assert one.getStringParam(0) == "empty"
    assert one.getStringSignal("s") == "kept"
    assert one.server.stored == {(0, "s"): 4}
    refused("is unknown", one.loadScene, "nowhere")
    one.loadScene("arena")
    assert one.closeScene() == 1
    assert one.getStringParam(0) == "empty"


# The window.


def test_what_a_window_shows(desk):
    pytest.importorskip("pygame", reason='needs pip install "wayfield[render]"')
    from wayfield.envs.coppelia.window import picture

    one = desk("document-a")
    scene = picture(one.world)
    path = np.frombuffer(one.world.scene.find("/Path").data["PATH"]).reshape(-1, 7)[:, :2]
    assert scene.path == pytest.approx(path)
    assert scene.bounds == (-2.5, -2.5, 2.5, 2.5)
    assert scene.pose == one.world.robot_pose
    assert len(scene.obstacles) == 4
    rings = [(mark.points.tolist(), mark.radius, mark.outline, mark.colour) for mark in scene.marks]
    assert rings == [
        ([[1.325, 1.525]], 0.25, True, (51, 178, 76)), ([[0.55, 0.775]], 0.05, True, (153, 76, 178)),
        ([[-0.7, 1.2]], 0.05, True, (230, 102, 26)),
    ]  # fmt: skip
    one = desk("empty")
    turn = Rotation.from_euler("z", 0.5)
    small, holder = one.createDummy(0.01), one.createDummy(0.4, [0.0, 1.0, 0.5])
    one.setObjectPose(holder, [1.0, 2.0, 0.0, *turn.as_quat().tolist()])
    corners = [1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.5, 0.5, 0.0]
    handles = {}
    for kind, width in {0: 3, 1: 6, 2: 9, 7: 3, 8: 3, 9: 7, 10: 7, 11: 7, 12: 7}.items():
        handles[kind] = one.addDrawingObject(kind, 3.0, 0.0, holder, 0, [1.0, 0.0, 0.0])
        for shift in (0.0, 1.0):
            one.addDrawingObjectItem(handles[kind], [c + shift for c in corners[:width]])
    one.addDrawingObject(0, 3.0)
    one.addDrawingObject(0, 1.0, 0.0, -1, 0, [0.0, 0.0, 1.0])
    one.addDrawingObjectItem(one.addDrawingObject(0, 1.0), [0.5, 0.25, 1.0])
    marks = list(picture(one.world).marks)

    def seen(*points):
        moved = turn.apply([[*point, 0.0] for point in points])[:, :2] + [1.0, 2.0]
        return pytest.approx(moved, abs=1e-9)

    first, second = marks[:2]
    assert (first.points.tolist(), first.radius, first.colour) == ([[0.0, 0.0]], 0.02, (204, 121, 167))
    assert (second.points.tolist(), second.radius, second.colour) == ([[1.0, 2.0]], 0.2, (0, 255, 128))
    rest = iter(marks[2:])
    for kind in handles:
        one_mark = next(rest)
        assert one_mark.colour == (255, 0, 0)
        if kind == 8:
            assert one_mark.line == 3.0
            assert one_mark.points == seen((1.0, 0.0), (2.0, 1.0))
        elif kind in (1, 2):
            lines = [one_mark, next(rest)]
            for shift, mark in zip((0.0, 1.0), lines, strict=True):
                ends = [(1.0 + shift, shift), (shift, 1.0 + shift), (0.5 + shift, 0.5 + shift), (1.0 + shift, shift)]
                assert mark.points == seen(*ends[: 2 if kind == 1 else 4])
                assert mark.line == 3.0
        else:
            assert one_mark.points == seen((1.0, 0.0), (2.0, 1.0))
            wide = kind in (7, 9, 10, 11, 12)
            assert (one_mark.radius, one_mark.pixels, one_mark.line) == ((1.5, 0.0, 0.0) if wide else (0.0, 1.5, 0.0))
    last = next(rest)
    assert (last.points.tolist(), last.pixels, last.colour) == ([[0.5, 0.25]], 1.0, (0, 0, 0))
    assert next(rest, None) is None
    one.setObjectPosition(one.getObject("/PioneerP3DX"), [7.0, -8.0, 0.0])
    assert picture(one.world).bounds == pytest.approx((-5.0, -8.0, 7.0445, 5.0))
    one.world.bounds = None
    assert picture(one.world).bounds == pytest.approx((4.5445, -10.5, 9.5445, -5.5))
    assert small is not None
    # a path that a client has written anything into is none
    for data in (b"", b"123", np.full(14, math.nan).tobytes(), "text"):
        one.world.scene.objects[small].data["PATH"] = data
        assert picture(one.world).path is None
    one.setObjectPose(holder, [1.0, 2.0, 0.0, *turn.as_quat().tolist()])
    one.world.scene.objects[small].data.clear()
    one.world.scene.objects[holder].data["PATH"] = np.array(
        [[1.0, 0, 0, 0, 0, 0, 1], [2.0, 1, 0, 0, 0, 0, 1]]
    ).tobytes()
    assert picture(one.world).path == seen((1.0, 0.0), (2.0, 1.0))


def test_the_constants_that_scripts_compare_with():
    told = constants.CONSTANTS
    assert {told[f"sceneobject_{kind}"] for kind in ("shape", "joint", "dummy", "proximitysensor")} == {0, 1, 4, 5}
    assert [told[f"simulation_{name}"] for name in ("stopped", "paused", "advancing_running")] == [0, 8, 17]
    assert [told[f"handle_{name}"] for name in ("world", "all", "parent", "scene", "app")] == [-1, -2, -11, -12, -13]
    assert [told[f"drawing_{name}"] for name in ("points", "lines", "triangles", "spherepts", "linestrip")] == [
        0,
        1,
        2,
        7,
        8,
    ]
    assert told["drawing_cyclic"] == 0x1000


# What is put somewhere, and what starts anew.


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


def test_what_moves_by_a_script_begins_anew_at_every_start(desk):
    one = desk("moving_crossing/test")
    ways = []
    for _ in range(2):
        assert one.world.batch.states["steps"][0] == 0
        one.startSimulation()
        way = []
        for _ in range(8):
            one.world.advance()
            way.append(one.world.batch.obstacles[0, :4].tolist())
        ways.append(way)
        one.stopSimulation()
        for _ in range(3):
            one.world.advance()
    assert ways[0] == ways[1]
    assert ways[0][0] != ways[0][-1]


def test_what_moves_by_a_script_goes_on_while_the_robot_is_put_elsewhere(desk):
    places = []
    for put in (False, True):
        one = desk("moving_crossing/test")
        one.startSimulation()
        for k in range(8):
            if put and k == 5:
                _, _, height = one.getObjectPosition(one.world.scene.base.handle)
                there = one.world.batch.obstacles[0].tolist()
                one.setObjectPosition(one.world.scene.base.handle, [-3.0, 0.5, height])
                assert one.world.batch.obstacles[0].tolist() == there
                assert one.world.robot_pose[1] == pytest.approx(0.5, abs=0.1)
            one.world.advance()
        places.append([(each["x"], each["y"]) for each in one.world.batch.obstacles[0]])
    assert places[0] == places[1]


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


def test_what_is_removed_is_in_nobody_s_way_and_the_others_keep_their_places(desk):
    one = desk("arena")
    count = 12
    for path in ("/Cylinder[1]", "/Wall[0]", "/Cuboid[2]"):
        solids = [node for node in one.world.scene.objects.values() if node.footprint is not None]
        gone = one.world.scene.objects[one.getObject(path)]
        kept = [one.world.batch.obstacles[0, node.footprint.index].tolist() for node in solids if node is not gone]
        one.removeObject(gone.handle)
        count -= 1
        assert one.world.batch.states["num_obstacles"][0] == count
        assert one.world.batch.obstacles[0, :count].tolist() == kept
    one.setObjectPosition(one.getObject("/Cuboid[0]"), [1e6, 0.0, 0.1])
    assert one.getObjectPosition(one.getObject("/Cuboid[0]"))[0] == 1e6
    refused("1.1e+06 is beyond 1e+06", one.setObjectPosition, one.getObject("/Cuboid[0]"), [0, 1.1e6, 0])


def test_a_full_drawing_takes_no_more(desk):
    one = desk("empty")
    handle = one.addDrawingObject(0, 0.0, 0.0, -1, 2)
    assert [one.addDrawingObjectItem(handle, [float(k), 0.0, 0.0]) for k in range(4)] == [1, 1, 0, 0]
    assert one.addDrawingObject(0, 0.05, 0.05) == handle + 1
