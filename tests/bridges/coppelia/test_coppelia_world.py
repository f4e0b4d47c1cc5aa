"""The scene that a CoppeliaSim script finds: objects, frames, motion, sonars, paths, drawing. With the real client."""

import itertools
import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

pytest.importorskip("cbor2", reason='needs pip install "wayfield[coppelia]"')
pytest.importorskip("zmq", reason='needs pip install "wayfield[coppelia]"')
pytest.importorskip("coppeliasim_zmqremoteapi_client", reason='needs pip install "wayfield[coppelia]"')

from wayfield.bridges.coppelia import frames, sonars
from wayfield.bridges.coppelia.scene import wild_match
from wayfield.bridges.coppelia.scenes import SCENES, Conditions, make_world
from wayfield.envs.robots import ROBOTS
from wayfield.envs.scenarios import GOAL_SCENARIOS, PATH_SCENARIOS, box, circle, wall

ROBOT, RIGHT, LEFT = "/PioneerP3DX", "/PioneerP3DX/rightMotor", "/PioneerP3DX/leftMotor"
BEHIND = 0.0445  # m, of the base's origin behind the axle
PLANTS = pytest.mark.parametrize("dynamics", ["kinematic", "pymunk"])


def stepping(sim, right=None, left=None):
    """Starts a simulation that steps, with wheel speeds; returns the handles of robot and wheels."""
    robot, *wheels = (sim.getObject(path) for path in (ROBOT, RIGHT, LEFT))
    sim.setStepping(True)
    sim.startSimulation()
    for wheel, speed in zip(wheels, (right, left), strict=True):
        if speed is not None:
            sim.setJointTargetVelocity(wheel, speed)
    return robot, *wheels


# Motion.


def test_equal_wheels_drive_exactly_straight(serve, connect):
    sim = connect(serve())
    robot, *_ = stepping(sim, 2.0, 2.0)
    x, y, _ = sim.getObjectPosition(robot)
    for _ in range(20):
        sim.step()
    place = sim.getObjectPosition(robot)
    assert place[0] - x == pytest.approx(0.195, abs=1e-12)
    assert place[1] == y


@pytest.mark.parametrize("half_track", [None, 0.1905])
def test_turning_on_the_spot_goes_round_the_axle_at_the_reported_track(serve, connect, half_track):
    sim = connect(serve(half_track=half_track))
    robot, right, left = stepping(sim, 1.0, -1.0)
    apart = sim.getObjectPosition(left, robot)[1] - sim.getObjectPosition(right, robot)[1]
    radius = sim.getShapeGeomInfo(sim.getObject("/rightWheel"))[2][0] / 2
    assert apart / 2 == pytest.approx(half_track or 0.1655, abs=1e-15)
    for k in range(1, 20):
        sim.step()
        assert sim.getObjectOrientation(robot)[2] == pytest.approx(0.05 * radius * 2 * k / apart, abs=1e-12)
        assert math.dist(sim.getObjectPosition(robot)[:2], (0.0, 0.0)) == pytest.approx(BEHIND, abs=1e-12)
        (vx, vy, vz), (_, _, rate) = sim.getObjectVelocity(robot)
        x, y, _ = sim.getObjectPosition(robot)
        assert (vx, vy, vz) == pytest.approx((-rate * y, rate * x, 0.0), abs=1e-12)


@PLANTS
def test_wheel_odometry_by_what_the_scene_reports_is_the_axle(serve, connect, dynamics):
    sim = connect(serve(dynamics=dynamics))
    robot, right, left = stepping(sim)
    at_right, at_left = sim.getObjectPosition(right, robot), sim.getObjectPosition(left, robot)
    ahead, apart = at_right[0], at_left[1] - at_right[1]
    radius = sim.getShapeGeomInfo(sim.getObject("/rightWheel"))[2][0] / 2
    dt = sim.getSimulationTimeStep()
    x = y = heading = 0.0
    slow = 0.02 if dynamics == "pymunk" else 1.0  # wheels that grip
    rng = np.random.default_rng(0)
    for k in range(60):
        if k % 10 == 0:
            speeds = slow * rng.uniform(-5.0, 5.0, 2)
            sim.setJointTargetVelocity(right, float(speeds[0]))
            sim.setJointTargetVelocity(left, float(speeds[1]))
        sim.step()
        v_right, v_left = (radius * sim.getJointVelocity(joint) for joint in (right, left))
        v, w = 0.5 * (v_right + v_left), (v_right - v_left) / apart
        half = 0.5 * w * dt
        chord = v * dt * (math.sin(half) / half if half else 1.0)
        x, y = x + chord * math.cos(heading + half), y + chord * math.sin(heading + half)
        heading += w * dt
        place, yaw = sim.getObjectPosition(robot), sim.getObjectOrientation(robot)[2]
        assert place[0] + ahead * math.cos(yaw) == pytest.approx(x, abs=1e-9)
        assert place[1] + ahead * math.sin(yaw) == pytest.approx(y, abs=1e-9)
        assert math.remainder(yaw - heading, 2 * math.pi) == pytest.approx(0.0, abs=1e-9)


def test_the_rim_speed_is_limited_by_one_factor(serve, connect):
    sim = connect(serve())
    _, right, left = stepping(sim, 50.0, 25.0)
    sim.step()
    assert sim.getJointVelocity(right) * 0.0975 == pytest.approx(1.2)
    assert sim.getJointVelocity(left) == pytest.approx(sim.getJointVelocity(right) / 2)


@PLANTS
def test_a_stop_brings_back_what_was_before_the_start(serve, connect, dynamics):
    sim = connect(serve("push_box", dynamics=dynamics))
    robot, right, left = (sim.getObject(path) for path in (ROBOT, RIGHT, LEFT))
    thing, dummy = sim.getObject("/Cuboid"), sim.createDummy(0.1)
    sim.setObjectPose(dummy, [1, 2, 3, 0, 0, 0, 1])
    sim.setObjectPosition(robot, [0.3, 0.1, 5.0])
    sim.setJointTargetVelocity(right, 1.5)
    sim.setJointTargetVelocity(left, 1.5)

    def told():
        poses = [sim.getObjectPose(each) for each in (robot, thing, dummy)]
        return poses, [sim.getJointPosition(each) for each in (right, left)], sim.getJointTargetVelocity(right)

    before = told()
    assert before[0][0][2] == pytest.approx(0.1388)  # the robot stays on the floor
    sim.setStepping(True)
    sim.startSimulation()
    made = sim.createDummy(0.1), sim.createPrimitiveShape(sim.primitiveshape_cylinder, [0.2, 0.2, 0.5])
    x = sim.getObjectPosition(robot)[0]
    for _ in range(40):
        sim.step()
    assert sim.getObjectPosition(robot)[0] > x + 0.1  # targets set before the start drive
    sim.setObjectPosition(thing, [3.0, 3.0, 0.25])
    sim.setObjectPosition(dummy, [0, 0, 0])
    sim.setJointTargetVelocity(right, 0.0)
    time = sim.getSimulationTime()
    sim.stopSimulation(True)
    assert told() == before
    assert not any(map(sim.isHandle, made))
    assert sim.getSimulationTime() == pytest.approx(time + 3 * 0.05)
    assert sim.setStepping(True) == 0


def test_the_robot_is_stopped_by_a_wall_and_pushes_what_is_loose(serve, connect):
    for dynamics, moved in (("kinematic", False), ("pymunk", True)):
        sim = connect(serve("push_box", dynamics=dynamics))
        stepping(sim, 5.0, 5.0)
        start = sim.getObjectPosition(sim.getObject("/Cuboid"))[0]
        for _ in range(100):
            sim.step()
        assert (sim.getObjectPosition(sim.getObject("/Cuboid"))[0] > start + 0.01) == moved
        hull = sim.getObjectPosition(sim.getObject(ROBOT))[0] + BEHIND + 0.25
        assert hull <= sim.getObjectPosition(sim.getObject("/Cuboid"))[0] - 0.2 + 1e-3


def test_a_wall_takes_away_only_what_leads_into_it(desk):
    one = desk("empty")
    wall = one.createPrimitiveShape(3, [0.2, 10.0, 0.5])
    one.setObjectPosition(wall, [1.0, 0.0, 0.25])
    angle, speed, seconds = 0.7, 0.5, 2.0
    base = one.getObject("/PioneerP3DX")
    one.setObjectPose(base, [0.6, 0.0, 0.0, 0.0, 0.0, math.sin(angle / 2), math.cos(angle / 2)])
    for side in ("left", "right"):
        one.setJointTargetVelocity(one.getObject(f"/{side}Motor"), speed / 0.0975)
    _, y, _ = one.world.robot_pose
    one.startSimulation()
    for _ in range(round(seconds / 0.05)):
        one.world.advance()
    face = 0.9 - 0.25
    assert one.world.robot_pose == pytest.approx((face, y + seconds * speed * math.sin(angle), angle), abs=1e-6)
    assert one.getObjectVelocity(base)[0] == pytest.approx([0.0, speed * math.sin(angle), 0.0], abs=1e-6)
    # a corner holds it; it can still turn, and back out
    end = one.createPrimitiveShape(3, [10.0, 0.2, 0.5])
    one.setObjectPosition(end, [0.0, 2.0, 0.25])
    for _ in range(100):
        one.world.advance()
    assert one.world.robot_pose == pytest.approx((face, 1.9 - 0.25, angle), abs=1e-6)
    one.setJointTargetVelocity(one.getObject("/leftMotor"), -speed / 0.0975)
    one.setJointTargetVelocity(one.getObject("/rightMotor"), -speed / 0.0975)
    for _ in range(20):
        one.world.advance()
    assert one.world.robot_pose == pytest.approx(
        (face - speed * math.cos(angle), 1.65 - speed * math.sin(angle), angle), abs=1e-6
    )


def test_a_made_obstacle_stands_in_the_way_until_it_is_removed(serve, connect):
    sim = connect(serve())
    shape = sim.createPrimitiveShape(sim.primitiveshape_cuboid, [0.2, 2.0, 0.5], 0)
    sim.setObjectPosition(shape, [0.6, 0.0, 0.25])
    robot, *_ = stepping(sim, 5.0, 5.0)
    for _ in range(40):
        sim.step()
    assert sim.getObjectPosition(robot)[0] + BEHIND == pytest.approx(0.6 - 0.1 - 0.25, abs=1e-6)
    sim.removeObjects([shape])
    for _ in range(20):
        sim.step()
    assert sim.getObjectPosition(robot)[0] > 0.5


# Omni bases.


@pytest.mark.parametrize(("scene", "robot"), [("document-b", "omni3"), ("document-c", "omni4")])
def test_an_omni_base_drives_by_its_wheel_joints_in_order(serve, connect, scene, robot):
    sim = connect(serve(scene))
    model = ROBOTS[robot]
    base = sim.getObject(f"/{robot.capitalize()}")
    joints = [sim.getObject(f"/{robot.capitalize()}/wheel{i + 1}") for i in range(len(model.wheel_positions))]
    for joint, (px, py), direction in zip(joints, model.wheel_positions, model.wheel_directions, strict=True):
        assert sim.getObjectPosition(joint, base)[:2] == pytest.approx([px, py], abs=1e-12)
        axis = np.array(sim.getObjectMatrix(joint, base)).reshape(3, 4)[:, 2]
        assert axis == pytest.approx([-math.sin(direction), math.cos(direction), 0.0], abs=1e-12)
    twist = np.array([0.2, -0.1, 0.3])
    sim.setStepping(True)
    sim.startSimulation()
    for joint, speed in zip(joints, (model.wheel_matrix @ twist).tolist(), strict=True):
        sim.setJointTargetVelocity(joint, speed)
    yaw = sim.getObjectOrientation(base)[2]
    sim.step()
    linear, angular = sim.getObjectVelocity(base)
    yaw += 0.3 * 0.05
    c, s = math.cos(yaw), math.sin(yaw)
    assert linear[:2] == pytest.approx([c * 0.2 + s * 0.1, s * 0.2 - c * 0.1], abs=1e-9)
    assert angular[2] == pytest.approx(0.3, abs=1e-9)


# Frames.


def test_what_is_set_is_got_in_both_orders_and_relative_to_anything(serve, connect):
    sim = connect(serve("document-a"))
    robot = sim.getObject(ROBOT)
    holder, dummy = sim.createDummy(0.1), sim.createDummy(0.1)
    sim.setObjectPose(holder, [0.4, -0.3, 0.2, *frames.quaternion_from_euler(0.1, 0.2, 0.3)])
    sim.setObjectParent(dummy, holder, True)
    written = {
        "Position": [0.1, 0.2, 0.3],
        "Orientation": [0.3, -0.2, 0.9],
        "Quaternion": list(frames.quaternion_from_euler(0.5, 0.1, -0.2)),
        "Pose": [1.0, 2.0, 3.0, *frames.quaternion_from_euler(-0.5, 0.1, 0.2)],
        "Matrix": frames.matrix_of((0.1, 0.2, 0.3, *frames.quaternion_from_euler(1.0, 0.5, 0.2))),
    }
    for (kind, value), rel, swapped in itertools.product(
        written.items(), (sim.handle_world, sim.handle_parent, robot, sim.getObject(RIGHT)), (False, True)
    ):
        put, get = getattr(sim, f"setObject{kind}"), getattr(sim, f"getObject{kind}")
        put(*((dummy, rel, value) if swapped else (dummy, value, rel)))
        assert get(dummy, rel) == pytest.approx(value, abs=1e-12)
    x, y, z, w = sim.getObjectQuaternion(dummy)
    assert sim.getObjectQuaternion(dummy | sim.handleflag_wxyzquat) == [w, x, y, z]
    sim.setObjectPosition(robot, [0.5, 0.6, 9.0])
    sim.setObjectOrientation(robot, -1, [0.2, 0.3, 1.0])
    assert sim.getObjectPosition(robot) == pytest.approx([0.5, 0.6, 0.1388], abs=1e-12)
    assert sim.getObjectOrientation(robot)[:2] == [0.0, 0.0]
    with pytest.raises(Exception, match="part of the robot"):
        sim.setObjectPosition(sim.getObject("/visible"), [0, 0, 0])


# Names.


def test_every_object_is_found_by_the_paths_of_its_aliases(serve, connect):
    sim = connect(serve("document-a"))
    for handle in sim.getObjectsInTree(sim.handle_scene):
        for option in (1, 2):
            assert sim.getObject(sim.getObjectAlias(handle, option)) == handle
        parent = sim.getObjectParent(handle)
        assert parent == -1 or handle in sim.getObjectsInTree(parent, sim.handle_all, 3)


@given(st.text("ab*?", max_size=8), st.text("ab", max_size=8))
def test_wildcards_match_as_the_shell_does(pattern, name):
    import fnmatch

    assert wild_match(pattern, name) == fnmatch.fnmatchcase(name, pattern)


@pytest.mark.parametrize("name", [*SCENES, *PATH_SCENARIOS, *GOAL_SCENARIOS])
def test_every_scene_can_be_made_and_driven(name):
    world = make_world(name, Conditions())
    world.start()
    world.advance()
    assert world.time == 0.05
    aliases = {node.alias for node in world.scene.objects.values()}
    assert "Floor" in aliases
    assert name not in PATH_SCENARIOS or {"Path", "Disc", "LH", "Perp"} <= aliases
    assert name not in GOAL_SCENARIOS or "Goal" in aliases


def test_a_scenario_file_is_a_scene(tmp_path):
    file = tmp_path / "own.json"
    file.write_text('{"goal": [2, 0, 0], "obstacles": [{"kind": "circle", "x": 1, "y": 1, "radius": 0.2}]}')
    world = make_world(str(file), Conditions())
    assert world.scene.find("/Cylinder") is not None
    file.write_text('{"path": [[0, 0], [1, 0], [1, 1]]}')
    rows = np.frombuffer(make_world(str(file)).scene.find("/Path").data["PATH"]).reshape(-1, 7)
    assert rows[:, :2].tolist() == [[0, 0], [1, 0], [1, 1]]


# Sonars.

SEEN = {2: 0.8380, 3: 0.7908, 4: 0.7908, 5: 0.8381}


def test_sonars_before_a_wall(serve, connect):
    sim = connect(serve())
    shape = sim.createPrimitiveShape(sim.primitiveshape_cuboid, [0.2, 6.0, 0.5], 0)
    sim.setObjectPosition(shape, [1.1, 0.0, 0.25])
    sensors = [sim.getObject(f"/PioneerP3DX/ultrasonicSensor[{i}]") for i in range(16)]
    nothing = (0, 0.0, [0, 0, 0], -1, [0, 0, 0])
    robot, *_ = stepping(sim, 0.0, 0.0)
    sim.setObjectPosition(robot, [0.0, 0.0, 0.0])
    assert [sim.readProximitySensor(each) for each in sensors] == [nothing] * 16  # before the first pass
    assert sim.checkProximitySensor(sensors[3], shape)[1] == pytest.approx(0.7908, abs=1e-4)
    sim.step()
    for i, sensor in enumerate(sensors):
        hit, distance, point, handle, normal = sim.readProximitySensor(sensor)
        if i not in SEEN:
            assert (hit, distance, point, handle, normal) == nothing
            continue
        assert (hit, handle) == (1, shape)
        assert distance == pytest.approx(SEEN[i], abs=1e-4)
        m = np.array(sim.getObjectMatrix(sensor)).reshape(3, 4)
        at = m @ [*point, 1.0]
        assert at[0] == pytest.approx(1.0, abs=1e-6)
        assert at[2] == pytest.approx(0.1388 + 0.068, abs=1e-6)
        assert m[:, :3] @ normal == pytest.approx([-1.0, 0.0, 0.0], abs=1e-9)
    assert sim.readProximitySensor(sensors[3])[2] == pytest.approx([-0.1373, 0.0, 0.7788], abs=1e-4)
    sim.setObjectPosition(robot, [0.76, 0.0, 0.0])  # 3.08 cm before the front sonars: blind; others read the last pass
    assert sim.readProximitySensor(sensors[3])[1] == pytest.approx(0.7908, abs=1e-4)
    sim.step()
    assert sim.readProximitySensor(sensors[3]) == nothing
    assert sim.checkProximitySensor(sensors[3], sim.handle_all) == (0, None, None, None, None)
    sim.stopSimulation(True)
    assert sim.readProximitySensor(sensors[3]) == nothing


def densely(x, y, bearing, obstacle):
    """Returns the distance to the nearest point of an obstacle's outline that a sonar sees, by trying many."""
    record = obstacle
    best = math.inf
    points = []
    if record["half_length"] == 0.0:
        for angle in np.linspace(-math.pi, math.pi, 8001):
            n = (math.cos(angle), math.sin(angle))
            points.append((record["x"] + record["radius"] * n[0], record["y"] + record["radius"] * n[1], *n))
    else:
        c, s, hl, hw = (float(record[name]) for name in ("cos", "sin", "half_length", "half_width"))
        sides = [((0.0, 1.0), hw, hl), ((0.0, -1.0), hw, hl)]
        if hw > 0.0:
            sides += [((1.0, 0.0), hl, hw), ((-1.0, 0.0), hl, hw)]
        for (nx, ny), away, half in sides:
            for t in np.linspace(-half, half, 4001):
                px, py = (nx * away - ny * t, ny * away + nx * t)
                points.append(
                    (record["x"] + c * px - s * py, record["y"] + s * px + c * py, c * nx - s * ny, s * nx + c * ny)
                )
    table = np.array(points)
    dx, dy = table[:, 0] - x, table[:, 1] - y
    distance = np.hypot(dx, dy)
    off = np.abs(np.remainder(np.arctan2(dy, dx) - bearing + math.pi, 2 * math.pi) - math.pi)
    facing = -(dx * table[:, 2] + dy * table[:, 3]) / np.maximum(distance, 1e-12)
    seen = (off <= math.radians(15.0)) & (facing >= math.cos(math.radians(45.0)))
    best = distance[seen].min() if seen.any() else math.inf
    return float(best)


@pytest.mark.parametrize("obstacle", [circle(0.6, 0.1, 0.2), box(0.7, -0.1, 0.5, 0.3, 0.4), wall(0.5, -1.0, 0.8, 0.6)])
def test_a_sonar_sees_the_nearest_point_of_all_in_its_sector(obstacle):
    for bearing in np.linspace(-1.2, 1.2, 17):
        found = sonars.echo(0.0, 0.0, float(bearing), [obstacle.item()])
        expected = densely(0.0, 0.0, float(bearing), obstacle)
        if abs(expected - 1.0) < 1e-4 or expected < 0.05:
            continue
        if expected > 1.0:  # beyond its reach, or seen at a slant of more than 45 degrees alone
            assert found is None
            continue
        assert found is not None
        assert found.distance == pytest.approx(expected, abs=2e-4)


# Paths.


def test_document_a_s_path_and_one_made_from_its_points_are_the_same(serve, connect):
    sim = connect(serve("document-a"))
    path = sim.getObject("/Path")
    rows = np.array(sim.unpackDoubleTable(sim.getBufferProperty(path, "customData.PATH"))).reshape(-1, 7)
    for i, (x, y) in {
        0: (-1.517196, 1.238504),
        1: (-1.612281, 1.204004),
        25: (-0.733778, -0.880886),
        50: (1.7641, -0.049796),
        75: (0.023381, -0.767159),
    }.items():
        assert rows[i, :3] == pytest.approx([x, y, 0.0], abs=1e-6)
    assert len(rows) == 100
    assert rows[99].tolist() == rows[0].tolist()
    block = sim.readCustomBufferData(path, "PATHCTRLPTS")
    assert len(block) == 4 * 56
    made = sim.createPath(sim.unpackDoubleTable(block), 2, 100, 1.0)
    remade = sim.unpackDoubleTable(sim.readCustomDataBlock(made, "PATH"))
    assert remade == pytest.approx(rows.ravel().tolist(), abs=1e-12)
    lengths, total = sim.getPathLengths(rows.ravel().tolist(), 7)
    assert total == pytest.approx(10.5101, abs=1e-4)
    flat = rows[:, :3].ravel().tolist()
    assert sim.getClosestPosOnPath(flat, lengths, rows[30, :3].tolist()) == pytest.approx(lengths[30])
    assert sim.getPathInterpolatedConfig(flat, lengths, lengths[30]) == pytest.approx(rows[30, :3].tolist())


# The lidar.


def test_the_lidar_reads_the_walls_by_signal_by_property_and_by_vision_sensor(serve, connect):
    sim = connect(serve("document-a"))
    robot, *_ = stepping(sim)
    base = sim.getObject("/PioneerP3DX/lidar")
    assert sim.getStringSignal("PioneerP3dxLidarData") is None  # before the first pass
    sim.setObjectPosition(robot, [0.0 - BEHIND, 0.0, 0.1388])
    sim.step()
    ranges = np.array(sim.unpackFloatTable(sim.getStringSignal("PioneerP3dxLidarData")))
    angles = np.array(sim.unpackFloatTable(sim.getStringSignal("hokuyo_angle_data")))
    same = sim.unpackFloatTable(sim.getBufferProperty(sim.handle_scene, "signal.hokuyo_range_data"))
    assert ranges.tolist() == list(same)
    assert ranges.shape == angles.shape == (684,)
    assert (np.degrees(angles[[341, -1]])) == pytest.approx([0.0, 120.0], abs=1e-4)
    x, y = ranges * np.cos(angles), ranges * np.sin(angles)
    # the faces of the four walls
    off = np.min([abs(x - 2.3), abs(x + 2.275), abs(y - 2.3), abs(y + 2.3)], axis=0)
    assert off.max() < 1e-5
    seen = []
    for name in ("fastHokuyo_sensor1", "sensor2"):
        half = sim.getObject(f"/PioneerP3DX/fastHokuyo/{name}")
        _, _, packet = sim.readVisionSensor(half)
        to_base = sim.multiplyMatrices(sim.getMatrixInverse(sim.getObjectMatrix(base)), sim.getObjectMatrix(half))
        rows = np.array(packet[2:]).reshape(int(packet[0]) * int(packet[1]), 4)
        seen += [sim.multiplyVector(to_base, row[:3].tolist())[:2] for row in rows]
    assert np.array(seen) == pytest.approx(np.column_stack([x, y]), abs=1e-5)
    place = sim.getObjectPosition(base)
    assert place[:2] == pytest.approx([0.0, 0.0], abs=1e-12)
    for name, words in (("camera", "no cameras"), ("velodyneVPL_16", "the only lidar")):
        with pytest.raises(Exception, match=words):
            sim.getObject(f"/PioneerP3DX/{name}")
