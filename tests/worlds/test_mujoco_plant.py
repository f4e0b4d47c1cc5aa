"""The MuJoCo plant against closed forms: what wheels on a floor do, whoever wrote the engine."""

import copy
import dataclasses
import json
import math
import pickle
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
import pytest
from numpy.typing import NDArray

import wayfield  # noqa: F401  registers the environments
from wayfield.envs.crowds.bodies import PERSON, ROBOT
from wayfield.envs.robots import ROBOTS, Robot
from wayfield.envs.robots.mjcf import GRAVITY, ROLLERS, WHEELS, WIDTH, mjcf
from wayfield.envs.scenarios.people_families import walks_of
from wayfield.envs.scenarios.team_scenario import TeamScenario

mujoco = pytest.importorskip("mujoco", reason="needs [mujoco]")

PATH, GOAL = "DiffDrivePathFollowing-v0", "OmniGoalObstacles-v0"
KINDS = [(name, wheels) for name, robot in ROBOTS.items() for wheels in WHEELS[robot.drive]]


def env_of(robot: Any, dynamics: str = "mujoco", **options: Any) -> Any:
    """Returns an environment that was reset, where nothing is near."""
    holonomic = (ROBOTS[robot] if isinstance(robot, str) else robot).holonomic
    env = gymnasium.make(
        f"wayfield/{'Omni' if holonomic else 'DiffDrive'}PathFollowing-v0",
        **{"scenario": "straight", "robot": robot, "dynamics": dynamics, **options},
    ).unwrapped
    env.reset(seed=0)
    return env


def arena(tmp_path: Path, *obstacles: dict[str, Any], robot: str = "p3dx", **options: Any) -> Any:
    """Returns an environment of one robot at the origin, heading along x, among obstacles, its goal far away."""
    file = tmp_path / "arena.json"
    file.write_text(json.dumps({"start": [0.0, 0.0, 0.0], "goal": [90.0, 90.0, 0.0], "obstacles": obstacles}))
    name = "Omni" if ROBOTS[robot].holonomic else "DiffDrive"
    options = {"dynamics": "mujoco", "end_on_contact": False, "num_beams": 4, **options}
    env = gymnasium.make(f"wayfield/{name}GoalObstacles-v0", scenario=str(file), robot=robot, **options).unwrapped
    env.reset(seed=0)
    return env


def pose(env: Any) -> NDArray[np.float64]:
    state = env.batch.states[0]
    return np.array([state[name].item() for name in ("x", "y", "heading")])


def wandering(robot: Robot, steps: int, seed: int) -> NDArray[np.float64]:
    """Returns commands (steps, axes) of half the robot's speeds at most, that turn over in seconds."""
    rng = np.random.default_rng(seed)
    most = 0.5 * np.minimum(robot.max_twist, 1.0)
    times = 0.05 * np.arange(steps)[:, None]
    rates, phases = rng.uniform(0.3, 1.0, len(most)), rng.uniform(0.0, 6.0, len(most))
    return most * np.sin(rates * times + phases) * np.minimum(times, 1.0)


@pytest.mark.parametrize(("name", "wheels"), [("p3dx", "points"), ("omni3", "anisotropic"), ("omni4", "anisotropic")])
def test_light_robots_on_sticky_points_are_the_kinematic_plant(name: str, wheels: str) -> None:
    """Within 0.2 % of the way, and of the angle turned by."""
    light = {"name": "light", "mass": 0.1 * ROBOTS[name].mass, "inertia": 0.1 * ROBOTS[name].inertia, "friction": 2.0}
    robot = dataclasses.replace(ROBOTS[name], **light)
    for seed in range(3):
        both = [env_of(robot, "kinematic", actuators="lagged"), env_of(robot, wheels=wheels, actuators="lagged")]
        gone, turned = 0.0, 0.0
        for twist in wandering(robot, 400, seed):
            for env in both:
                env.step(twist)
            state = both[0].batch.states[0]
            gone += 0.05 * math.hypot(state["vx"], state["vy"])
            turned += 0.05 * abs(state["yaw_rate"])
        apart = np.abs(pose(both[0]) - pose(both[1]))
        assert apart[2] < 0.002 * turned
        assert math.hypot(*apart[:2]) < 0.002 * gone


def test_two_wheels_that_turn_on_the_spot_scrub_at_their_edges() -> None:
    """A cylinder's contacts are two points, at its edges: the moment of a wheel is mu N w / 2, not mu N w / 4."""
    robot = ROBOTS["p3dx"]
    env = env_of(robot.name, actuators="ideal")
    for _ in range(60):
        env.step(np.array([0.0, 1.0]))
    wheel = robot.wheels[0]
    torque = np.abs(env.batch.plant.worlds[0].data.actuator_force).mean()
    load = 0.5 * robot.driven_load * robot.mass * GRAVITY
    scrub = robot.friction * load * WIDTH * wheel.radius / 2.0
    # of both wheels, against the motors' pull at half the track; some of the weight is the caster's all the time
    assert torque / wheel.radius * abs(wheel.y) * 2.0 == pytest.approx(2.0 * scrub, rel=0.15)
    # so the robot turns as if its track were wider, by less than the width of the wheels
    assert 1.0 < 1.0 / env.batch.states[0]["yaw_rate"] < 1.0 + WIDTH * wheel.radius / abs(wheel.y) / 2.0


def test_a_skid_steer_turns_as_if_its_track_were_wider() -> None:
    """Four Coulomb contacts at a ahead and b aside: motors and floor balance at the track 2 b (1 + (a / b)^2)."""
    robot = ROBOTS["jackal"]
    env = env_of("jackal", actuators="ideal")
    for _ in range(20):
        env.step(np.array([0.0, 1.0]))
    before = pose(env)[2]
    for _ in range(40):
        env.step(np.array([0.0, 1.0]))
    rate = (pose(env)[2] - before) / 2.0
    ahead, aside = abs(robot.built[0].x), abs(robot.built[0].y)
    effective = 2.0 * abs(robot.wheels[0].y) / rate
    assert effective == pytest.approx(2.0 * aside * (1.0 + (ahead / aside) ** 2), rel=0.1)


@pytest.mark.parametrize(("speed", "turn"), [(0.2, 0.3), (1.0, 0.8), (1.0, 1.6)])
def test_a_skid_steer_drifts_out_of_a_bend_and_turns_further(speed: float, turn: float) -> None:
    """All wheels slide, and what holds the base in the bend is taken from the friction that resists its turn.

    Coulomb friction of two contacts a wheel, at its edges, gives the forces and the moment of a steady bend.
    """
    from scipy.optimize import least_squares

    robot = ROBOTS["jackal"]
    edge = 0.5 * WIDTH * robot.wheels[0].radius
    x, y = np.array([(wheel.x, wheel.y + side) for wheel in robot.built for side in (-edge, edge)]).T
    rim = speed - np.sign(y) * abs(robot.wheels[0].y) * turn

    def balance(twist: NDArray[np.float64]) -> NDArray[np.float64]:
        vx, vy, rate = twist
        slips = np.array([vx - rate * y - rim, vy + rate * x])
        fx, fy = -robot.friction * GRAVITY / len(x) * slips / np.hypot(np.hypot(*slips), 1e-4)
        return np.array([fx.sum() + vy * rate, fy.sum() - vx * rate, (x * fy - y * fx).sum()])

    _, sideways, rate = least_squares(balance, [speed, 0.0, turn]).x
    env = env_of("jackal", actuators="ideal")
    found = []
    for _ in range(60):
        env.step(np.array([speed, turn]))
        found.append([env.batch.states[0][name] for name in ("vy", "yaw_rate")])
    drift, turned = np.mean(found[20:], axis=0)
    assert turned == pytest.approx(rate, rel=0.08)
    assert drift == pytest.approx(sideways, abs=0.03)


@pytest.mark.parametrize("name", ["omni3", "mecanum4"])
def test_a_wheel_of_rollers_ripples_once_a_roller(name: str) -> None:
    robot = ROBOTS[name]
    model = mujoco.MjModel.from_xml_string(mjcf(robot, "rollers"))
    data = mujoco.MjData(model)
    # straight on, so that the wheels of a pair are in the same phase, at half a turn a second
    data.ctrl[:] = math.pi * np.sign(np.round(robot.wheel_matrix[:, 0], 9))
    heights = []
    for k in range(5000):
        mujoco.mj_step(model, data)
        if k >= 1000:
            heights.append(data.qpos[2])
    spectrum = np.abs(np.fft.rfft(np.array(heights) - np.mean(heights)))
    assert np.fft.rfftfreq(len(heights), 0.002)[spectrum.argmax()] == pytest.approx(0.5 * ROLLERS, abs=0.2)


@pytest.mark.parametrize(("name", "wheels"), KINDS)
def test_what_stands_still_stands(name: str, wheels: str) -> None:
    env = env_of(name, wheels=wheels)
    before = pose(env)
    for _ in range(200):
        env.step(np.zeros(env.action_space.shape))
    moved = np.abs(pose(env) - before)
    # at the rim too, a millimetre a minute: this is ten seconds
    assert math.hypot(*moved[:2]) + ROBOTS[name].hull_radius * moved[2] < 1e-3 / 6.0


@pytest.mark.parametrize(("name", "wheels"), KINDS)
def test_energy_never_grows_without_torque(name: str, wheels: str) -> None:
    model = mujoco.MjModel.from_xml_string(mjcf(ROBOTS[name], wheels))
    model.opt.timestep = 5e-4
    data = mujoco.MjData(model)
    mujoco.mj_step(model, data, 2000)
    model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_ACTUATION
    model.opt.enableflags |= mujoco.mjtEnableBit.mjENBL_ENERGY
    data.qvel[:6] = 0.4, 0.2, 0.0, 0.0, 0.0, 1.5
    energies = []
    for _ in range(2000):
        mujoco.mj_step(model, data)
        mujoco.mj_energyPos(model, data)
        mujoco.mj_energyVel(model, data)
        energies.append(data.energy.sum())
    spent = energies[0] - energies[-1]
    assert spent > 0.0
    # contacts are springs, which give back what they hold: the weight, over a millimetre
    springs = 1e-3 * ROBOTS[name].mass * GRAVITY
    assert (energies - np.minimum.accumulate(energies)).max() < springs


@pytest.mark.parametrize(("name", "wheels"), [("p3dx", "cylinders"), ("jackal", "cylinders"), ("omni3", "anisotropic")])
def test_mirrored_commands_drive_the_mirror_image(name: str, wheels: str) -> None:
    robot = ROBOTS[name]
    one, other = (env_of(name, wheels=wheels, actuators="lagged") for _ in range(2))
    start = pose(one)
    sides = np.array([1.0, -1.0, -1.0] if robot.holonomic else [1.0, -1.0])
    for twist in wandering(robot, 60, 1):
        one.step(twist)
        other.step(sides * twist)
    ways = [pose(env) - start for env in (one, other)]
    assert np.abs(ways[0]).max() > 0.1
    # rounding differs, and contacts that chatter make millimetres of it
    np.testing.assert_allclose(ways[0] * [1.0, -1.0, -1.0], ways[1], atol=5e-3)


@pytest.mark.parametrize("name", list(ROBOTS))
def test_weights_and_inertia_are_the_data_sheets(name: str) -> None:
    robot = ROBOTS[name]
    for wheels in WHEELS[robot.drive]:
        model = mujoco.MjModel.from_xml_string(mjcf(robot, wheels))
        data = mujoco.MjData(model)
        mujoco.mj_forward(model, data)
        full = np.zeros((model.nv, model.nv))
        mujoco.mj_fullM(model, data, full)
        assert full[0, 0] == pytest.approx(robot.mass)
        middle = data.subtree_com[1, :2]
        assert full[5, 5] - robot.mass * (middle**2).sum() == pytest.approx(robot.inertia, rel=0.02)


def test_pushed_boxes_slide_to_rest_by_friction_and_walls_hold(tmp_path: Path) -> None:
    box = {"kind": "box", "x": 1.0, "y": 0.0, "length": 0.4, "width": 0.4, "mass": 1.0}
    wall = {"kind": "wall", "x1": 3.0, "y1": -1.0, "x2": 3.0, "y2": 1.0}
    env = arena(tmp_path, box, wall)
    for _ in range(60):
        env.step(np.array([0.6, 0.0]))
    state, things = env.batch.states[0], env.batch.obstacles[0]
    assert things["x"][0] > 1.3
    assert things["x"][0] - 0.2 - state["x"] == pytest.approx(ROBOTS["p3dx"].hull_radius, abs=5e-3)
    for _ in range(40):
        env.step(np.array([-0.3, 0.0]))
    before = things["x"][0].item()
    env.batch.plant.worlds[0].data.qvel[-6] = 1.0  # of the box, the last body
    for _ in range(20):
        env.step(np.array([-0.3, 0.0]))
    assert things["x"][0] - before == pytest.approx(1.0 / (2.0 * 0.4 * GRAVITY), rel=0.1)
    for _ in range(400):
        env.step(np.array([0.6, 0.0]))
    # the box is between robot and wall
    assert state["x"] == pytest.approx(3.0 - 0.4 - ROBOTS["p3dx"].hull_radius, abs=0.01)
    assert state["contact"] == 1


@pytest.mark.parametrize("dynamics", ["kinematic", "pymunk", "mujoco"])
@pytest.mark.parametrize("way", [1.0, -1.0])
def test_the_corner_of_a_box_touches_at_the_same_place_on_every_plant(
    dynamics: str, way: float, tmp_path: Path
) -> None:
    base = ROBOTS["mir100"]
    length, width = base.hull_box or (0.0, 0.0)
    disc = {"kind": "circle", "x": 2.0 * way, "y": 0.5 * width + 0.12, "radius": 0.2}  # 0.16 m before it: 3, 4, 5
    env = arena(tmp_path, disc, robot="mir100", dynamics=dynamics, end_on_contact=True)
    ended = False
    while not ended:
        *_, ended, _, info = env.step(np.array([0.4 * way, 0.0]))
        assert info["time"] < 10.0
    assert info["collision"]
    assert way * pose(env)[0] == pytest.approx(2.0 - 0.16 - (0.5 * length + way * base.hull_x), abs=8e-3)


def test_contact_ends_the_episode_where_a_map_is_occupied(tmp_path: Path) -> None:
    cells = np.zeros((40, 40), np.uint8)
    cells[:, 30:] = 255
    from PIL import Image

    Image.fromarray(255 - cells).save(tmp_path / "map.png")
    (tmp_path / "map.yaml").write_text(
        "image: map.png\nresolution: 0.1\norigin: [-1.0, -2.0, 0.0]\n"
        "occupied_thresh: 0.65\nfree_thresh: 0.2\nnegate: 0\n"
    )
    file = tmp_path / "scene.json"
    file.write_text(json.dumps({"start": [0.0, 0.0, 0.0], "goal": [0.5, 1.0, 0.0], "map": "map.yaml"}))
    env = gymnasium.make("wayfield/DiffDriveGoalObstacles-v0", scenario=str(file), dynamics="mujoco").unwrapped
    env.reset(seed=0)
    for _ in range(100):
        *_, terminated, _, _ = env.step(np.array([0.6, 0.0]))
        if terminated:
            break
    assert terminated
    assert pose(env)[0] == pytest.approx(2.0 - ROBOTS["p3dx"].hull_radius, abs=0.01)


OPTIONS: list[dict[str, Any]] = [
    {"scenario": "push_boxes/train", "end_on_contact": False, "actuators": "lagged", "noise": 1.0},
    {"scenario": "moving_crowd/train", "disturbance": "strong", "pose_source": "odometry", "robot": "omni4"},
    {"robot": "mecanum4", "actuators": "slow", "action_mode": "wheel_speeds", "shove": (0.5, 0.1, 0.1, 0.3)},
]


@pytest.mark.parametrize("options", OPTIONS)
def test_a_row_equals_a_lone_robot_and_its_copies(options: dict[str, Any]) -> None:
    name = f"wayfield/{GOAL}"
    options = {"dynamics": "mujoco", **options}
    many = gymnasium.make_vec(name, 2, vectorization_mode="vector_entry_point", **options)
    alone = [gymnasium.make(name, **options) for _ in range(2)]
    many.reset(seed=3)
    for k, env in enumerate(alone):
        env.reset(seed=3 + k)
    dice = np.random.default_rng(0)
    for step in range(40):
        actions = dice.uniform(-0.5, 0.5, many.action_space.shape) * alone[0].action_space.high
        rows = many.step(actions.astype(np.float32))[0]
        for k, env in enumerate(alone):
            observation, _, terminated, _, _ = env.step(actions[k].astype(np.float32))
            assert observation.tobytes() == rows[k].tobytes()
            assert not terminated
        if step == 20:
            alone = [copy.deepcopy(alone[0]), pickle.loads(pickle.dumps(alone[1]))]


TEAM, ALONE = "wayfield/DiffDriveTeam-v0", "wayfield/DiffDriveGoalObstacles-v0"
HULL = ROBOTS["p3dx"].hull_radius


def team_of(starts: Any, goals: Any, **options: Any) -> Any:
    """Returns the environment of a team from poses to poses, which was reset."""
    scenario = TeamScenario.made("here", starts, goals)
    env = gymnasium.make(TEAM, scenario=scenario, dynamics="mujoco", **options).unwrapped
    env.reset(seed=0)
    return env


def pushing(wheels: str) -> Any:
    """Returns model and data of two robots that face each other, 0.1 m apart, and stand."""
    from wayfield.envs.mujoco_plant import World
    from wayfield.envs.world.geometry import OBSTACLE

    apart = HULL + 0.05
    poses = np.array([[-apart, 0.0, 0.0], [apart, 0.0, math.pi]])
    return World(ROBOTS["p3dx"], wheels, poses, np.zeros(0, OBSTACLE), None)


def test_robots_that_push_head_on_hold_each_other_as_far_as_their_wheels_grip() -> None:
    """They push at the lower edges of their hulls, which tips them onto their casters, and so takes load off wheels."""
    robot, world = ROBOTS["p3dx"], pushing("cylinders")
    ahead, data, force = np.full((2, 1, 2), 2.0), world.data, np.zeros(6)
    assert not world.step(np.repeat(ahead, 200, axis=1), True, None).any()  # a robot is nothing that stands
    pushes, gaps = np.zeros(500), np.zeros(500)
    for step in range(500):
        world.step(ahead, True, None)
        gaps[step] = world.own[1, 0] - world.own[0, 0] - 2.0 * HULL
        for k in np.flatnonzero(np.isin(data.contact.geom, world.hulls).all(axis=1)).tolist():
            mujoco.mj_contactForce(world.model, data, k, force)
            pushes[step] += force[0]
    assert np.abs(gaps).max() < 1e-3
    hull = world.model.geom(world.hulls[0])
    lever = (hull.pos[2] - hull.size[1]) / (0.7 * HULL)  # of the push, over the caster's
    grip = robot.friction * robot.driven_load * robot.mass * GRAVITY
    assert pushes.mean() == pytest.approx(grip / (1.0 + robot.friction * lever), rel=0.03)


def test_robots_that_meet_share_their_momentum() -> None:
    """Floor and wheels exchange what they like: m v of robots and I w / r of wheels, which roll, are conserved."""
    robot, world = ROBOTS["p3dx"], pushing("points")
    model = mujoco.MjModel.from_xml_string(mjcf(robot, "points", team=2))
    model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_ACTUATION
    data = mujoco.MjData(model)
    data.qpos[:], data.qacc_warmstart[:] = world.data.qpos, world.data.qacc_warmstart
    full, half, radius = np.zeros((model.nv, model.nv)), model.nv // 2, robot.wheels[0].radius
    mujoco.mj_forward(model, data)
    mujoco.mj_fullM(model, data, full)

    def momentum() -> float:
        wheels = full[6, 6] / radius * (data.qvel[6:half].sum() - data.qvel[half + 6 :].sum())
        return float(robot.mass * (data.qvel[0] + data.qvel[half]) + wheels)

    data.qvel[0], data.qvel[6:half] = 0.5, 0.5 / radius
    before = momentum()
    mujoco.mj_step(model, data, 500)
    assert data.qvel[half] > 0.2  # it was hit
    assert momentum() == pytest.approx(before, rel=0.02)


def test_a_team_of_one_is_goal_reaching_and_robots_apart_drive_as_alone() -> None:
    options = {"dynamics": "mujoco", "actuators": "lagged", "disturbance": "moderate"}
    one, alone = gymnasium.make(TEAM, scenario="discs", **options), gymnasium.make(ALONE, scenario="discs", **options)
    one.reset(seed=3)
    alone.reset(seed=3)
    for twist in wandering(ROBOTS["p3dx"], 60, 0):
        assert one.step(twist)[0].tobytes() == alone.step(twist)[0].tobytes()
    starts = [(0.0, 0.0, 0.5), (0.0, 30.0, -1.0)]
    two = team_of(starts, [(90.0, 0.0, 0.0), (90.0, 30.0, 0.0)], actuators="lagged")
    each = [team_of([start], [(90.0, 0.0, 0.0)], actuators="lagged") for start in starts]
    ways = [wandering(ROBOTS["p3dx"], 60, seed) for seed in range(2)]
    for twists in zip(*ways, strict=True):
        two.step(np.array(twists))
        for env, twist in zip(each, twists, strict=True):
            env.step(twist)
    for k, env in enumerate(each):
        there = [two.batch.states[name][k] for name in ("x", "y", "heading")]
        np.testing.assert_allclose(there, pose(env), atol=1e-4)


def test_robots_that_meet_end_in_contact_and_brake_where_they_are() -> None:
    starts = [(0.0, 0.0, 0.0), (1.2, 0.0, math.pi), (0.0, 5.0, 0.0)]
    env = team_of(starts, [(9.0, 0.0, 0.0), (-9.0, 0.0, 0.0), (9.0, 5.0, 0.0)])
    for _ in range(40):
        *_, info = env.step(np.full((3, 2), (0.5, 0.0)))
        if info["collision"].any():
            break
    assert info["touched"].tolist() == [1 + ROBOT, 1 + ROBOT, 0]
    assert info["caused"].tolist() == [True, True, False]
    states = env.batch.states
    met = states["x"][:2].copy()
    assert met[1] - met[0] == pytest.approx(2.0 * HULL, abs=1e-2)  # contacts are soft, and they met at 1 m/s
    for _ in range(20):
        env.step(np.full((3, 2), (0.5, 0.0)))
    np.testing.assert_allclose(states["x"][:2], met, atol=5e-3)
    assert states["x"][2] > 0.8


def test_who_leaves_is_gone_and_the_others_go_on_as_if_alone() -> None:
    starts = [(2.0, 0.0, 0.0), (0.0, 0.0, 0.0)]
    two = team_of(starts, [(2.3, 0.0, 0.0), (9.0, 0.0, 0.0)], actuators="lagged")
    one = team_of(starts[1:], [(9.0, 0.0, 0.0)], actuators="lagged")
    for _ in range(120):
        *_, ended, _, _ = two.step(np.full((2, 2), (0.5, 0.0)))
        one.step(np.array([0.5, 0.0]))
    assert not ended
    assert two.batch.plant.rows == [[1]]
    assert two.batch.states["x"][1] > 2.5
    np.testing.assert_allclose(two.batch.states["x"][1], pose(one)[0], atol=1e-4)


def test_people_end_the_episode_of_whom_they_touch() -> None:
    scenario = TeamScenario.made(
        "person", [(0.0, 0.0, 0.0)], [(9.0, 0.0, 0.0)], walks=walks_of([{"x": 1.5, "y": 0.0, "law": 0}])
    )
    env = gymnasium.make("wayfield/DiffDrivePeople-v0", scenario=scenario, dynamics="mujoco").unwrapped
    env.reset(seed=0)
    for _ in range(80):
        *_, ended, _, info = env.step(np.array([0.5, 0.0]))
        if ended:
            break
    assert info["touched"] == 1 + PERSON


@pytest.mark.parametrize(
    ("options", "said"),
    [
        ({"scenario": "circle_16"}, 'the world has 16 robots; dynamics="mujoco" drives at most 8'),
        ({"dynamics": "pymunk"}, "dynamics is 'pymunk', which drives one robot; for teams and people it is 'kin"),
    ],
)
def test_teams_that_cannot_be_driven_are_refused_in_a_line(options: dict[str, Any], said: str) -> None:
    with pytest.raises(ValueError, match=said) as error:
        gymnasium.make(TEAM, **{"scenario": "circle_8", "dynamics": "mujoco", **options})
    assert "\n" not in str(error.value)


@pytest.mark.parametrize("ends", ["leave", "respawn"])
def test_a_world_of_a_batch_goes_on_alike_copied_or_not(ends: str) -> None:
    options = {"scenario": "circle_4", "dynamics": "mujoco", "ends": ends, "noise": 1.0, "max_episode_steps": 30}
    envs = [gymnasium.make_vec(TEAM, 8, vectorization_mode="vector_entry_point", **options) for _ in range(2)]
    envs.append(gymnasium.make_vec(TEAM, 4, vectorization_mode="vector_entry_point", **options))
    for env in envs:
        env.reset(seed=3)
    dice = np.random.default_rng(0)
    for step in range(70):
        actions = dice.uniform(-1.0, 1.0, envs[0].action_space.shape) * envs[0].single_action_space.high
        rows, again, fewer = (env.step(actions[: env.num_envs].astype(np.float32))[0] for env in envs)
        assert rows.tobytes() == again.tobytes()
        assert rows[:4].tobytes() == fewer.tobytes()
        if step in (20, 40):
            envs[1] = copy.deepcopy(envs[1]) if step == 20 else pickle.loads(pickle.dumps(envs[1]))
    states = envs[0].batch.states
    assert np.isfinite(states["x"]).all()


@pytest.mark.parametrize(
    ("robot", "options", "said"),
    [
        ("p3dx", {"wheels": "rollers"}, "wheels='rollers': a drive differential has 'cylinders' or 'points'"),
        ("p3dx", {"wheels": "points", "dynamics": "pymunk"}, "wheels='points' belongs to dynamics=\"mujoco\""),
        (dataclasses.replace(ROBOTS["jackal"], name="long", wheelbase=0.15), {}, "wheels 0 and 1 .* overlap"),
        (dataclasses.replace(ROBOTS["p3dx"], name="point", hull_radius=0.0), {}, "hull.radius is 0"),
    ],
)
def test_what_cannot_be_built_is_refused_in_a_line(robot: Any, options: dict[str, Any], said: str) -> None:
    with pytest.raises(ValueError, match=said) as error:
        env_of(robot, **options)
    assert "\n" not in str(error.value)
