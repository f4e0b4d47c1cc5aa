"""The simulated robot, missions, scripts and recordings, without ROS."""

import dataclasses
import json
import math

import gymnasium
import numpy as np
import pytest

from wayfield.bridges.ros.body import Body
from wayfield.bridges.ros.conventions import View
from wayfield.bridges.ros.driving import AlongPath, ToGoal, check_drives
from wayfield.bridges.ros.excite import Script, farthest, script
from wayfield.bridges.ros.messages import STILL, Goal, Odometry, Twist, wrapped
from wayfield.envs.robots import ROBOTS
from wayfield.envs.tasks.specs import TASKS
from wayfield.policies import Pilot, make

BURGER = ROBOTS["turtlebot3"]


@pytest.fixture(scope="module")
def free(tmp_path_factory):
    """Returns a world with one wall, 3 m ahead of where the robot starts."""
    file = tmp_path_factory.mktemp("world") / "wall.json"
    wall = {"kind": "wall", "x1": 3.0, "y1": -3.0, "x2": 3.0, "y2": 3.0}
    file.write_text(json.dumps({"goal": [1.0, 2.0, 0.0], "start": [0.5, 0.5, math.pi / 2], "obstacles": [wall]}))
    return str(file)


def test_a_command_is_driven_until_it_times_out_and_then_the_base_brakes_by_its_limits(free):
    body = Body(BURGER, scenario=free)
    body.command(Twist(0.2, 0.0, 0.0))
    speeds = []
    for _ in range(30):
        body.step()
        speeds.append(body.truth.twist.vx)
    assert max(speeds) == pytest.approx(0.2, abs=0.01)
    assert speeds[9] == pytest.approx(0.2, abs=0.01)  # 0.5 s
    assert speeds[-1] == pytest.approx(0.0, abs=1e-3)
    # 0.5 s, the way down at 1 m/s^2, three lags of 0.1 s
    assert all(abs(each) < 0.02 for each in speeds[round((0.5 + 0.2 + 0.3) / 0.05) :])


def test_odometry_begins_where_the_robot_does_and_truth_is_in_the_world(free):
    body = Body(BURGER, scenario=free)
    assert (body.odometry.x, body.odometry.y, body.odometry.heading) == pytest.approx((0.0, 0.0, 0.0), abs=1e-9)
    assert (body.truth.x, body.truth.y, body.truth.heading) == pytest.approx((0.5, 0.5, math.pi / 2))
    for _ in range(20):
        body.command(Twist(0.2, 0.0, 0.3))
        body.step()
    found, true = body.odometry, body.truth
    assert (found.x, found.y) == pytest.approx((true.y - 0.5, 0.5 - true.x), abs=1e-9)
    assert found.twist.vx == pytest.approx(true.twist.vx)


def test_contact_ends_nothing_and_the_robot_drives_away(free):
    body = Body(BURGER, scenario=free, start=(2.8, 0.0, 0.0))
    for _ in range(40):
        body.command(Twist(0.2))
        body.step()
    assert body.contact
    assert body.contacts == 1
    assert body.truth.x == pytest.approx(3.0 - BURGER.hull_radius, abs=1e-3)
    for _ in range(40):
        body.command(Twist(-0.2))
        body.step()
    assert not body.contact
    assert body.truth.x < 2.7


def test_what_is_not_finite_is_zero_and_counted(free):
    body = Body(BURGER, scenario=free)
    body.command(Twist(math.nan))
    body.step()
    assert body.not_finite == 1
    assert body.truth.twist == STILL


def test_it_is_put_where_its_hull_fits_and_odometry_does_not_jump(free):
    body = Body(BURGER, scenario=free)
    before = body.odometry
    assert "does not fit" in body.put((3.0, 0.0, 0.0))
    assert "not finite" in body.put((math.nan, 0.0, 0.0))
    assert "must be within" in body.put((0.0, -1e9, 0.0))
    assert body.put((1.0, -1.0, 0.3)) == ""
    body.step()
    assert (body.truth.x, body.truth.y) == (1.0, -1.0)
    assert (body.odometry.x, body.odometry.y) == (before.x, before.y)
    with pytest.raises(ValueError, match="does not fit"):
        Body(BURGER, scenario=free, start=(3.0, 0.0, 0.0))


@pytest.mark.parametrize("pose_source", ["odometry", "ground_truth"])
def test_a_robot_that_is_put_elsewhere_is_where_map_to_odom_and_odometry_say(free, pose_source):
    body = Body(BURGER, scenario=free, pose_source=pose_source)

    def placed():
        x, y, turn = body.map_to_odom
        c, s, found = math.cos(turn), math.sin(turn), body.odometry
        return x + c * found.x - s * found.y, y + s * found.x + c * found.y, wrapped(turn + found.heading)

    for pose in (None, (1.0, -1.0, 0.3), (-1.0, 1.5, -3.0)):
        before = body.odometry
        assert pose is None or body.put(pose) == ""
        assert (body.odometry.x, body.odometry.y) == pytest.approx((before.x, before.y), abs=1e-9)
        for _ in range(30):
            body.command(Twist(0.2, 0.0, 0.5))
            body.step()
            assert placed() == pytest.approx((body.truth.x, body.truth.y, body.truth.heading), abs=1e-6)


@pytest.mark.parametrize(("world", "scenario"), [("people", "crowdnav_5"), ("team", "doorway_4")])
def test_people_walk_and_robots_drive_by_their_policy_while_this_one_stands(world, scenario):
    body = Body(ROBOTS["turtlebot3"], world, scenario, seed=1)
    first, scans = body.others, set()
    for _ in range(300):
        body.step()
        scans.add(body.ranges.tobytes())
    assert np.hypot(*(body.others - first)[:, :2].T).max() > 0.3
    assert len(scans) > 10
    assert body.truth.twist == STILL
    with pytest.raises(ValueError, match="kinematic"):
        Body(ROBOTS["turtlebot3"], world, scenario, dynamics="pymunk")


def test_touching_another_robot_ends_nothing():
    body = Body(BURGER, "team", "open_2", others="zero")
    x, y, radius = body.others[0].tolist()
    turn = math.atan2(body.truth.y - y, body.truth.x - x)  # towards where it came from all is free
    assert "does not fit" in body.put((x + radius * math.cos(turn), y + radius * math.sin(turn), 0.0))
    away = 2.0 * radius + 0.1
    assert body.put((x + away * math.cos(turn), y + away * math.sin(turn), wrapped(turn + math.pi))) == ""
    for speed in (0.2, -0.2):
        for _ in range(40):
            body.command(Twist(speed))
            body.step()
        apart = math.hypot(body.truth.x - x, body.truth.y - y) - 2.0 * radius
        assert (body.contacts, body.contact) == (1, speed > 0.0)
        assert (0.0 <= apart < 0.02) if speed > 0.0 else apart > 0.2


def test_a_map_alone_is_a_world_where_a_start_is_given(tmp_path):
    (tmp_path / "hall.pgm").write_bytes(b"P5 40 20 255 " + bytes(254 if 2 < k % 40 < 37 else 0 for k in range(800)))
    file = tmp_path / "hall.yaml"
    file.write_text(
        "image: hall.pgm\nresolution: 0.1\norigin: [-1.0, 0.0, 0.0]\n"
        "negate: 0\noccupied_thresh: 0.65\nfree_thresh: 0.196\n"
    )
    body = Body(BURGER, scenario=str(file), start=(1.0, 1.0, 0.0))
    assert body.grid.shape == (20, 40)
    assert body.grid.origin == (-1.0, 0.0, 0.0)
    ahead = body.ranges[int(np.abs(body.beam_angles).argmin())]
    assert ahead == pytest.approx(2.7 - 1.0, abs=1e-3)  # the wall begins with column 37
    with pytest.raises(ValueError, match="--start"):
        Body(BURGER, scenario=str(file))
    with pytest.raises(ValueError, match="occupied or unknown over the start"):
        Body(BURGER, scenario=str(file), start=(-0.9, 1.0, 0.0))


def test_the_same_seed_and_commands_are_the_same_bits():
    runs = []
    for _ in range(2):
        body = Body(BURGER, disturbance="moderate", seed=4)
        for k in range(20):
            body.command(Twist(0.2, 0.0, math.sin(k)))
            body.step()
        runs.append((body.odometry, body.ranges.tobytes()))
    assert runs[0] == runs[1]


LATE = dataclasses.replace(BURGER, name="late", delay=(0.12, 0.16), gain=(1, 0.8), response="continuous")


@pytest.mark.parametrize("robot", [BURGER, LATE], ids=lambda robot: robot.name)
def test_a_policy_briefed_by_the_sheet_decides_as_in_its_environment(robot):
    """Shown the same pose, twist and scan, a mission asks for what the pilot does of the policy in our world."""
    env = gymnasium.make(TASKS["goal_reaching"].env_id(robot), robot=robot, scenario="rooms", actuators="lagged")
    seen, _ = env.reset(seed=5)
    pilot = Pilot(make("dwa"), env)
    pilot.reset()
    layout, task = env.unwrapped.task.layout, env.unwrapped.task
    scenario = task.scenarios[int(env.unwrapped.batch.states[0]["scenario"])]
    mission = ToGoal(make("dwa"), robot, tolerance=scenario.position_tolerance)
    mission.goal = Goal("", *scenario.goal)
    for _ in range(20):
        fields = layout.unpack(seen.astype(float))
        if fields.waypoints_left:
            pytest.skip("has waypoints")
        x, y, heading = fields.pose.tolist()
        asked = pilot.command(seen)
        found = mission.decide(
            Odometry(0.0, "odom", x, y, heading, Twist(fields.twist[0], 0.0, fields.twist[1])),
            View(fields.ranges, np.empty((0, 2)), False),
        )
        assert (found.twist.vx, found.twist.yaw_rate) == pytest.approx(tuple(asked.tolist()), abs=1e-3)
        mission.sent(found.twist)
        seen, *_ = env.step(asked)


def test_goals_elsewhere_are_refused_in_a_line():
    mission = ToGoal(make("vfh_plus"), BURGER)
    here = Odometry(0.0, "odom", 0.0, 0.0, 0.0)
    assert mission.lacks == "no goal"
    assert mission.refusal(Goal("odom", 1.0, 0.0), here) == ""
    assert mission.refusal(Goal("", 1.0, 0.0), here) == ""
    assert "'map'" in mission.refusal(Goal("map", 1.0, 0.0), here)
    assert "60 m away" in mission.refusal(Goal("odom", 60.0, 0.0), here)
    assert "not finite" in mission.refusal(Goal("odom", math.nan, 0.0), here)
    assert "no odometry" in mission.refusal(Goal("odom", 1.0, 0.0), None)
    long = dataclasses.replace(here, frame="o" * 200_000)
    for goal, seen in ((Goal("odom", 1e300, -1e300), here), (Goal("m" * 200_000, 1.0, 0.0), long)):
        line = mission.refusal(goal, seen)
        assert line
        assert len(line) < 200
        assert line.isprintable()


def test_policies_that_know_more_than_sensors_are_refused_with_those_that_drive():
    for name in ("orca", "astar_tracker", "pure_pursuit"):
        with pytest.raises(ValueError, match="vfh_plus") as found:
            check_drives(make(name), name, BURGER, False)
        assert name in str(found.value)
    check_drives(make("pure_pursuit"), "pure_pursuit", BURGER, True)
    with pytest.raises(ValueError, match="pure_pursuit"):
        check_drives(make("dwa"), "dwa", BURGER, True)


def test_a_path_is_followed_to_its_end():
    mission = AlongPath(make("pure_pursuit"), BURGER)
    assert mission.lacks == "no path"
    for points in ([], [[0.0, 0.0]], [[1.0, 1.0]] * 5, [[0.0, 0.0], [math.nan, 1.0]], [[0.0, 0.0], [1e300, 0.0]]):
        with pytest.raises(ValueError, match="point"):
            mission.course_of(np.array(points).reshape(-1, 2))
    mission.take(mission.course_of(np.array([[0.0, 0.0], [0.0, 0.0], [0.5, 0.0], [1.0, 0.3]])))
    x = y = heading = 0.0
    for _ in range(400):
        decision = mission.decide(Odometry(0.0, "odom", x, y, heading), View(np.empty(0), np.empty((0, 2)), False))
        if decision.arrived:
            break
        v, w = min(decision.twist.vx, 0.2), max(-2.0, min(2.0, decision.twist.yaw_rate))
        heading += 0.05 * w
        x, y = x + 0.05 * v * math.cos(heading), y + 0.05 * v * math.sin(heading)
    assert decision.arrived
    assert math.hypot(x - 1.0, y - 0.3) < 0.2
    assert "off the path" in mission.decide(Odometry(0.0, "odom", 0.5, 4.0, 0.0), None).stop


@pytest.mark.parametrize(("top", "space"), [(0.2, 2.0), (2.0, 1.0)])
def test_a_script_stays_in_its_space_and_has_what_identification_needs(top, space):
    parts, factor = script(top, 1.0, 60.0, space)
    assert 50.0 <= sum(each.seconds for each in parts) <= 80.0
    assert (factor < 1.0) == (top > 1.0)
    assert farthest(parts, 1.0) <= space + 1e-9
    over = [each for each in parts if each.v > 1.25 * top * factor and each.seconds >= 3.0]
    assert over
    assert sum(each.seconds >= 1.9 and each.v == each.w == 0.0 for each in parts) >= 3


def test_a_script_stops_where_something_is_near_or_the_space_ends():
    parts, _ = script(0.2, 1.0, 60.0, 2.0)
    mission = Script(parts, BURGER, 2.0)
    free = View(np.empty(0), np.empty((0, 2)), False)
    assert mission.decide(Odometry(0.0, "odom", 0.0, 0.0, 0.0), free).twist == STILL  # begins with a rest
    near = free._replace(hits=np.array([[0.0, 0.35]]))
    assert "nearer" in mission.decide(Odometry(0.1, "odom", 0.0, 0.0, 0.0), near).stop
    assert "outside" in mission.decide(Odometry(0.2, "odom", 2.6, 0.0, 0.0), free).stop
    assert mission.decide(Odometry(1e3, "odom", 0.0, 0.0, 0.0), free).arrived


class _Time:
    @classmethod
    def get_fields_and_field_types(cls):
        return {"sec": "int32", "nanosec": "uint32"}


class _Message:
    @classmethod
    def get_fields_and_field_types(cls):
        return {
            "stamp": "builtin_interfaces/Time",
            "ranges": "sequence<float>",
            "covariance": "double[36]",
            "ok": "boolean",
        }


def test_a_recording_holds_definitions_and_takes_its_name_once_it_is_whole(tmp_path):
    pytest.importorskip("mcap", reason='needs pip install "wayfield[record]"')
    from mcap.reader import make_reader

    from wayfield.bridges.ros.recording import Recorder, definition

    text = definition(_Message, {"builtin_interfaces/Time": _Time}.__getitem__)
    assert text.splitlines()[:4] == [
        "builtin_interfaces/Time stamp",
        "float32[] ranges",
        "float64[36] covariance",
        "bool ok",
    ]
    assert "MSG: builtin_interfaces/Time\nint32 sec\nuint32 nanosec" in text
    file = tmp_path / "drive.mcap"
    recorder = Recorder(file)
    recorder.add("/odom", "mine/msg/Message", text)
    recorder.write("/odom", 1.5, b"abc")
    assert not file.exists()
    recorder.close()
    with file.open("rb") as stream:
        [(schema, channel, message)] = make_reader(stream).iter_messages()
    assert (schema.name, channel.topic, message.log_time, message.data) == (
        "mine/msg/Message",
        "/odom",
        1_500_000_000,
        b"abc",
    )
    with pytest.raises(FileExistsError):
        Recorder(file)
    with pytest.raises(ValueError, match=r"\.mcap"):
        Recorder(tmp_path / "drive.bag")
