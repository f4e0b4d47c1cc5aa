"""Reference implementation of the pymunk plant: wheels that grip or slip, the body's motion, what a space holds."""

import cmath
import json
import math
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
import pytest
from numpy.typing import NDArray
from oracles.episodes import DT, GOAL, PATH, Bank, Goals, Paths, Robot, compared, moved, wrap

import wayfield  # noqa: F401  registers the environments
from wayfield.envs import pymunk_plant
from wayfield.envs.robots import ROBOTS
from wayfield.envs.robots.hulls import clearance_of, way_out
from wayfield.envs.scenarios.obstacles import box, circle, obstacle_field, wall
from wayfield.envs.tasks.stepping import Robots
from wayfield.envs.world.geometry import OBSTACLE

H = DT / 5.0  # s, a sub-step
GRAVITY = 9.81


class Floor:
    """How the wheels of a base hold on to the floor: along each one's axis, and plain wheels across it too."""

    def __init__(self, name: str) -> None:
        base = ROBOTS[name]
        rows: list[tuple[float, float, float]] = []
        for wheel in base.wheels:
            axis = cmath.rect(1.0, wheel.direction + wheel.roller_angle)
            arm = (1j * complex(wheel.x, wheel.y)).conjugate()
            rows += [(a.real, a.imag, (a * arm).real) for a in ((axis,) if base.holonomic else (axis, 1j * axis))]
        self.count = len(base.wheels)
        self.rows = np.array(rows).reshape(self.count, -1, 3)  # wheel, direction, twist to speed over the floor
        self.weights = np.array([base.mass, base.mass, base.inertia])
        # the load of the driven wheels, evenly
        self.most = base.friction * base.mass * GRAVITY * base.driven_load / self.count * H

    def least(self, change: Any) -> NDArray[np.float64]:
        """Returns the size of the impulse of each wheel, where together they are the least that change a twist so."""
        impulses = np.linalg.pinv(self.rows.reshape(-1, 3).T) @ (self.weights * change)
        return np.asarray(np.linalg.norm(impulses.reshape(self.count, -1), axis=1))

    def slipped(self, twist: Any, to: Any) -> NDArray[np.float64]:
        """Returns the twist after a sub-step of Coulomb friction, by which the slip's energy falls furthest."""
        impulses = np.zeros(self.rows.shape[:2])
        twist = np.array(twist)
        for _ in range(200):  # of a differential drive it may be cut off there
            before = impulses.copy()
            for i, rows in enumerate(self.rows):
                felt = ((rows**2) / self.weights).sum(axis=1).max()
                wanted = impulses[i] - rows @ (twist - to) / felt
                wanted *= min(1.0, self.most / max(np.linalg.norm(wanted), 1e-300))
                twist = twist + (wanted - impulses[i]) @ rows / self.weights
                impulses[i] = wanted
            if np.abs(impulses - before).max() <= 1e-14 * self.most:
                break
        return twist


def turned(twist: Any, angle: float) -> NDArray[np.float64]:
    velocity = complex(twist[0], twist[1]) * cmath.rect(1.0, angle)
    return np.array([velocity.real, velocity.imag, twist[2]])


class Slipping(Bank):
    """Motion on wheels that pull no more than friction allows; nothing is touched."""

    floor: Floor

    def drive(self, s: Any) -> None:
        r, start = self.robot, s.pose
        mean, end = r.lagging(s, DT)
        rolled = r.of_body(mean)
        if self.holds(s):
            s.pose, s.wheels, s.twist = moved(s.pose, rolled, DT), end, r.of_body(end)
        else:
            self.slips = True
            for _ in range(5):
                self.pull(s)
            dx, dy, turn = s.pose[0] - start[0], s.pose[1] - start[1], wrap(s.pose[2] - start[2])
            chord = complex(dx, dy) * cmath.rect(1.0, -start[2] - 0.5 * turn) / (np.sinc(0.5 * turn / math.pi) * DT)
            rolled = np.array([chord.real, chord.imag, turn / DT])
        s.odometry = moved(s.odometry, r.measured(rolled if r.passive else mean, s.noise[s.row]), DT)

    slips = False

    def holds(self, s: Any) -> bool:
        """Returns whether the body goes with its wheels and they hold it in every sub-step: then all is one arc."""
        r = self.robot
        twist = r.of_body(s.wheels)
        if np.abs(twist - s.twist).max() > 1e-12:
            return False
        wheels = s.wheels
        for _ in range(5):
            mean, s.wheels = r.lagging(s, H)
            to = r.of_body(s.wheels)
            held = self.floor.least(to - turned(twist, -H * r.of_body(mean)[2])).max() <= self.floor.most
            twist = to
            if not held:
                break
        s.wheels = wheels
        return bool(held)

    def pull(self, s: Any) -> None:
        r, floor = self.robot, self.floor
        first = r.of_body(s.command + (s.wheels - s.command) if r.lag else s.command)
        mean, s.wheels = r.lagging(s, H)
        mean, to = r.of_body(mean), r.of_body(s.wheels)
        slip = s.twist - first
        rolling = np.abs(slip).max() <= 1e-12
        guess = H * (mean[2] if rolling else s.twist[2])
        kept = turned(s.twist, -guess)  # the velocity as it is in the world
        twist = to if floor.least(to - kept).max() <= floor.most else floor.slipped(kept, to)
        grips = np.abs(twist - to).max() <= 1e-12
        turn = H * (mean[2] + 0.5 * (slip[2] + twist[2] - to[2]))
        x, y, heading = s.pose
        if grips:
            x, y, heading = moved(s.pose, (*mean[:2], turn / H), H)
            fading = 0.5 * H * turned(slip, s.pose[2])
            s.pose = x + fading[0], y + fading[1], heading
        else:
            twist = turned(twist, guess - turn)
            way = 0.5 * H * (turned(s.twist, heading) + turned(twist, heading + turn))
            s.pose = x + way[0], y + way[1], wrap(heading + turn)
        s.twist = to if grips else twist


class SlippingPaths(Slipping, Paths):
    pass


class SlippingGoals(Slipping, Goals):
    pass


CASES: dict[str, tuple[str, str, dict[str, Any], str]] = {
    "ideal": ("p3dx", "figure_eight", {}, "random"),
    "lagged": ("p3dx", "figure_eight", {"actuators": "lagged", "disturbance": "moderate"}, "path"),
    "passive": ("omni3", "circle_r2", {"pose_source": "odometry", "noise": 0.5, "disturbance": "wheel_error"},
                "random"),
    "four": ("omni4", "circle_r2", {"actuators": "slow", "disturbance": "severe", "action_mode": "wheel_speeds"},
             "random"),
    "mecanum": ("mecanum4", "straight", {"shove": (0.3, 0.1, 0.1, 0.5), "pose_source": "odometry"}, "random"),
    "skidding": ("jackal", "figure_eight", {"actuators": "lagged"}, "random"),
}  # fmt: skip

HELD = {"lagged", "four"}  # gentle enough that no wheel slips


@pytest.mark.parametrize("case", CASES)
def test_a_row_answers_what_friction_says(case: str) -> None:
    name, scenario, options, kind = CASES[case]
    env_id = PATH.format("Omni" if ROBOTS[name].holonomic else "DiffDrive")
    env = gymnasium.make_vec(
        env_id, 2, robot=name, scenario=scenario, max_episode_steps=25, dynamics="pymunk", **options
    )
    get = options.get
    robot = Robot(
        name, get("actuators", "ideal"), get("action_mode", "twist"), get("pose_source", "ground_truth"),
        get("noise", 0.0), get("disturbance", "none"),
    )  # fmt: skip
    bank = SlippingPaths(env, robot, get("shove"), 10, 0.1)
    bank.floor = Floor(name)
    compared(env, bank, 25, kind)
    assert bank.slips == (case not in HELD)


@pytest.mark.parametrize(("before", "command"), [((1.0, 0.0), (0.5, 3.0)), ((0.5, 0.0), (-0.5, 3.0))])
def test_where_a_skid_leads_does_not_hang_on_the_last_bit(before: Any, command: Any) -> None:
    env = gymnasium.make_vec(
        PATH.format("DiffDrive"), 4, robot="jackal", scenario="straight", dynamics="pymunk", actuators="lagged"
    )
    env.reset(seed=0)
    states = env.unwrapped.batch.states
    for start in ("", "wheel_", "command_"):
        states[f"{start}vx"], states[f"{start}yaw_rate"] = before
    states["vx"][1] = np.nextafter(before[0], 9.0)
    states["vy"][2] = states["yaw_rate"][3] = 1e-15
    slips = []
    for _ in range(3):
        env.step(np.tile(np.array(command, np.float32), (4, 1)))
        slips.append(abs(states["vx"][0] - states["wheel_vx"][0]))
        for name in ("x", "y", "heading", "vx", "vy", "yaw_rate"):
            assert states[name] == pytest.approx(states[name][0], abs=1e-12)
    assert max(slips) > 1e-3


def test_what_pushes_nothing_leaves_goals_as_they_are() -> None:
    env = gymnasium.make_vec(
        GOAL.format("Omni"), 2, robot="omni4", scenario="open_fields/train", max_episode_steps=20, dynamics="pymunk",
        end_on_contact=False,
    )  # fmt: skip
    bank = SlippingGoals(env, Robot("omni4", "ideal", "twist", "ground_truth", 0.0, "none"), None, 0.1,
                         (math.inf, math.inf))  # fmt: skip
    bank.floor = Floor("omni4")
    compared(env, bank, 20, "random")


# The space around a robot.


@pytest.mark.parametrize("name", ["p3dx", "jackal"])
def test_a_space_holds_what_stands_and_what_can_be_pushed(name: str) -> None:
    robot = ROBOTS[name]
    obstacles = obstacle_field(
        circle(2.0, 1.0, 0.3), circle(-2.0, 1.0, 0.4, 5.0), box(1.0, -2.0, 0.8, 0.6, 0.7, 3.0),
        wall(4.0, -1.0, 4.0, 2.0), circle(-3.0, -3.0, 0.2), box(-5.0, 0.0, 0.6, 0.2, -0.4),
    )  # fmt: skip
    moving = np.array([False, False, False, False, True, False])
    world = pymunk_plant.World(robot, obstacles, 0.01, moving)
    assert world.space.iterations == 30
    assert world.space.collision_slop == 2e-5
    # of an overlap four fifths are left after a sub-step
    assert world.space.collision_bias**0.01 == pytest.approx(0.8)
    assert (world.hull.mass, world.hull.moment) == (robot.mass, robot.inertia)
    (shape,) = world.hull.shapes
    if robot.hull_box:
        corners = sorted((abs(v.x), abs(v.y)) for v in shape.get_vertices())
        assert corners == [(0.5 * robot.hull_box[0], 0.5 * robot.hull_box[1])] * 4
    else:
        assert shape.radius == robot.hull_radius
    assert {s.friction for s in world.space.shapes} == {math.sqrt(0.5)}
    assert [j for j, _ in world.pushable] == [1, 2]
    assert [j for j, _ in world.moving] == [4]
    assert len(world.space.shapes) == 1 + len(obstacles)
    # a disc and a plate of even mass; the floor holds both by friction, and turns by that of a disc of their area
    disc, plate = (body for _, body in world.pushable)
    assert (disc.mass, disc.moment) == (5.0, pytest.approx(0.5 * 5.0 * 0.4**2))
    assert (plate.mass, plate.moment) == (3.0, pytest.approx(3.0 / 12.0 * (0.8**2 + 0.6**2)))
    assert (*disc.position, disc.angle) == (-2.0, 1.0, 0.0)
    assert (*plate.position, plate.angle) == pytest.approx((1.0, -2.0, 0.7))
    for body, reach in ((disc, 0.4), (plate, math.sqrt(0.8 * 0.6 / math.pi))):
        push, turn = sorted(body.constraints, key=lambda joint: type(joint).__name__, reverse=True)
        weight = 0.4 * body.mass * GRAVITY
        assert push.max_force == pytest.approx(weight)
        assert turn.max_force == pytest.approx(weight * 2.0 / 3.0 * reach)
        assert push.max_bias == turn.max_bias == 0.0


def test_a_pushed_disc_slides_as_far_as_friction_lets_it_and_a_spinning_one_stops() -> None:
    world = pymunk_plant.World(ROBOTS["p3dx"], obstacle_field(circle(5.0, 0.0, 0.3, 2.0)), 0.01)
    ((_, disc),) = world.pushable
    disc.velocity, disc.angular_velocity = (1.0, 0.0), 0.0
    hulls, bodies = np.zeros(1, pymunk_plant.BODY), np.zeros((1, 1), pymunk_plant.BODY)
    for _ in range(60):
        world.step(0.01, 0, hulls, bodies, np.zeros((1, 1), OBSTACLE))
    assert bodies["x"][0, 0] - 5.0 == pytest.approx(1.0 / (2.0 * 0.4 * GRAVITY), rel=0.05)
    disc.angular_velocity = 3.0
    world.step(0.01, 0, hulls, bodies, np.zeros((1, 1), OBSTACLE))
    # m g mu 2/3 r over m r^2 / 2
    assert 3.0 - bodies["yaw_rate"][0, 0] == pytest.approx(0.01 * 0.4 * GRAVITY * (2.0 / 3.0) / (0.5 * 0.3), rel=1e-6)


# What is near is looked at in time, wherever it stands and however the robot is turned.


def arena(tmp_path: Path, robot: str, *obstacles: dict[str, Any]) -> Any:
    file = tmp_path / "arena.json"
    file.write_text(json.dumps({"goal": [90.0, 90.0, 0.0], "start": [30.0, 30.0, 0.0], "obstacles": obstacles}))
    env_id = GOAL.format("Omni" if ROBOTS[robot].holonomic else "DiffDrive")
    env: Any = gymnasium.make(
        env_id, robot=robot, scenario=str(file), dynamics="pymunk", end_on_contact=False, num_beams=0
    )
    env.reset(seed=0)
    return env.unwrapped


@pytest.mark.parametrize("axis", [0, 1])
def test_a_wall_is_met_where_coordinates_are_zero(tmp_path: Path, axis: int) -> None:
    robot = ROBOTS["omni4"]
    edge = robot.hull_radius + 0.001
    ends = (-9.0, edge, 9.0, edge) if axis else (edge, -9.0, edge, 9.0)
    env = arena(tmp_path, "omni4", {"kind": "wall", **dict(zip(("x1", "y1", "x2", "y2"), ends, strict=True))})
    state = env.batch.states[0]
    for k in range(24):
        env.reset(seed=0)
        state["x"], state["y"], state["heading"] = 0.0, 0.0, 0.0
        state["xy"[axis]] = -0.15 - 0.0005 * k
        state["clearance"] = edge - state["xy"[axis]] - robot.hull_radius
        for name in ("vx", "vy")[axis], ("wheel_vx", "wheel_vy")[axis], ("command_vx", "command_vy")[axis]:
            state[name] = 0.5
        for _ in range(10):
            env.step(np.array([0.0, 0.5, 0.0] if axis else [0.5, 0.0, 0.0], np.float32))
        assert -2e-5 < state["clearance"] < 1e-3
        assert state["contact"]


def test_a_side_that_turns_into_a_post_meets_it_where_the_heading_is_zero(tmp_path: Path) -> None:
    _, width = ROBOTS["jackal"].hull_box or (0.0, 0.0)
    # first touched at -0.003 rad, on the left, 0.23 m ahead of the middle
    at = complex(0.23, 0.5 * width + 0.1) * cmath.rect(1.0, -0.003)
    env = arena(tmp_path, "jackal", {"kind": "circle", "x": at.real, "y": at.imag, "radius": 0.1})
    state, obstacles = env.batch.states[0], env.batch.obstacles[0]
    for k in range(24):
        env.reset(seed=0)
        state["x"], state["y"], state["heading"] = 0.0, 0.0, -0.004 - 0.0015 * k
        state["clearance"] = clearance_of(ROBOTS["jackal"], obstacles, 1, (0.0, 0.0, state["heading"]))
        for name in ("yaw_rate", "wheel_yaw_rate", "command_yaw_rate"):
            state[name] = 1.0
        for _ in range(3):
            env.step(np.array([0.0, 1.0], np.float32))
            assert state["clearance"] > -2e-4
        assert state["contact"]


def test_the_way_out_of_a_slanted_side_is_square_to_it(tmp_path: Path) -> None:
    env = arena(tmp_path, "jackal")
    task, states = env.task, env.batch.states
    length, _ = ROBOTS["jackal"].hull_box or (0.0, 0.0)
    obstacles = np.zeros((1, 1), OBSTACLE)
    robots = Robots(task.params, states, obstacles, env.batch.noise, task.patrols, task.grids)
    states["field"] = 0
    for turn in np.linspace(-3.0, 3.0, 13).tolist():
        # a disc that is 1 mm within the front side: out is straight back, along the heading
        ahead = 0.5 * length + 0.2 - 0.001
        obstacles["x"], obstacles["y"] = ahead * math.cos(turn), ahead * math.sin(turn)
        obstacles["cos"], obstacles["radius"] = 1.0, 0.2
        found = way_out(task.params[0], robots, 0, states[0], 0, 0.0, 0.0, turn)
        assert found == pytest.approx((-math.cos(turn), -math.sin(turn)), abs=1e-4)
