"""The scenes, models and objects of the server of CoppeliaSim's remote API."""

import json
import math
import re
import warnings

import numpy as np
import pytest

from wayfield.bridges.coppelia.scene_files import run_setup
from wayfield.bridges.coppelia.scenes import Conditions, make_world
from wayfield.bridges.coppelia.server import Server
from wayfield.envs.robots import ROBOTS
from wayfield.envs.scenarios import TASKS, scenarios_of

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


# The tree of objects.


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
        ('"name": "P1"', '"name": "a/b"', r"objects[2].name"),
        ('"empty"', '"emty"', "Did you mean 'empty'?"),
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


@pytest.mark.parametrize(
    ("fields", "told"),
    [
        ({"start": [0, 0, 90]}, r"start\[2\] is 90 rad, more than a turn; degrees"),
        ({"kind": "box", "name": "A", "at": [3, 0, 90]}, r"objects\[0\].at\[2\] is 90 rad"),
        ({"kind": "disc", "name": "A", "at": [2000, 1000]}, r"objects\[0\].at is 2000 m, usual is at most 300"),
        ({"kind": "cylinder", "name": "A", "at": [2, 1], "radius": 200}, r"objects\[0\].radius is 200 m"),
        ({"kind": "robot", "at": [-2, 2, 6.28]}, ""),
    ],
)
def test_a_scene_in_other_units_is_doubted_in_a_line(tmp_path, fields, told):
    file = tmp_path / "mine.json"
    objects = [fields] if "kind" in fields else []
    file.write_text(json.dumps({"objects": objects} | ({} if objects else fields)))
    with warnings.catch_warnings(record=True) as found:
        warnings.simplefilter("always")
        make_world(str(file))
    assert [bool(re.search(told, str(each.message))) for each in found] == [True] * bool(told)
