"""The pymunk plant: traction, contacts and pushed things obey the laws of mechanics."""

import itertools
import json
import math
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
import pytest
from numpy.typing import NDArray

import wayfield  # noqa: F401  registers the environments
from wayfield.envs.pymunk_plant import (
    FLOOR_FRICTION,
    GRAVITY,
)
from wayfield.envs.robots import CASTER_LOAD, ROBOTS
from wayfield.envs.robots.kinematics import integrate_arc
from wayfield.envs.world.geometry import clearance

DT = 0.05
GOAL_ID = "wayfield/OmniGoalObstacles-v0"
PATH_ID = "wayfield/DiffDrivePathFollowing-v0"

# Of the weight times the friction coefficient, the share that the wheels can pull straight ahead: the caster
# carries nothing to it, and an omni wheel only what its drive direction has of it.
AHEAD = {
    "p3dx": 1.0 - CASTER_LOAD,
    "omni3": 2.0 / 3.0 * math.cos(math.pi / 6),
    "omni4": math.cos(math.pi / 4),
}


class Arena:
    """One robot among obstacles, its goal far away."""

    def __init__(self, tmp_path: Path, robot: str, *obstacles: dict[str, Any], **kwargs: Any) -> None:
        options: dict[str, Any] = {"dynamics": "pymunk", **kwargs}
        if robot == "p3dx":
            assert not obstacles
            env = gymnasium.make(PATH_ID, scenario="straight", robot=robot, **options)
        else:
            file = tmp_path / "arena.json"
            file.write_text(json.dumps({"goal": [90.0, 90.0, 0.0], "obstacles": obstacles}))
            options.setdefault("end_on_contact", options["dynamics"] == "kinematic")
            env = gymnasium.make(GOAL_ID, scenario=str(file), robot=robot, num_beams=4, **options)
        self.env: Any = env.unwrapped
        self.env.reset(seed=0)
        self.robot = ROBOTS[robot]
        self.state = self.env.batch.states[0]
        self.obstacles = self.env.batch.obstacles[0]
        self.plant = self.env.batch.plant

    def drive(self, *twist: float, steps: int = 1) -> None:
        for _ in range(steps):
            self.env.step(np.array(twist, np.float32))

    def set_twist(self, *twist: float, rolling: bool = False) -> None:
        for kind in ("", "command_", "wheel_") if rolling else ("",):
            for name, value in zip(("vx", "vy", "yaw_rate"), twist, strict=True):
                self.state[kind + name] = value

    def place(self, x: float, y: float, heading: float) -> None:
        self.state["x"], self.state["y"], self.state["heading"] = x, y, heading
        self.state["clearance"] = clearance(self.obstacles, len(self.obstacles), x, y) - self.robot.hull_radius

    @property
    def pose(self) -> NDArray[np.float64]:
        return np.array([self.state["x"], self.state["y"], self.state["heading"]])

    @property
    def speed(self) -> float:
        return math.hypot(self.state["vx"], self.state["vy"])

    def kinetic_energy(self) -> float:
        """Returns the kinetic energy (J) of the robot and of everything that it pushed."""
        robot = 0.5 * self.robot.mass * self.speed**2 + 0.5 * self.robot.inertia * self.state["yaw_rate"] ** 2
        world = self.plant.worlds[0]
        pushed = [] if world is None else [body for _, body in world.pushable]
        return float(robot + sum(0.5 * b.mass * b.velocity.length**2 + 0.5 * b.moment * b.angular_velocity**2
                                 for b in pushed))  # fmt: skip


def circle_at(x: float, y: float, radius: float, mass: float = 0.0) -> dict[str, Any]:
    return {"kind": "circle", "x": x, "y": y, "radius": radius, "mass": mass}


def box_at(x: float, y: float, side: float, mass: float = 0.0, heading: float = 0.0) -> dict[str, Any]:
    return {"kind": "box", "x": x, "y": y, "length": side, "width": side, "mass": mass, "heading": heading}


def wall_at(x1: float, y1: float, x2: float, y2: float) -> dict[str, Any]:
    return {"kind": "wall", "x1": x1, "y1": y1, "x2": x2, "y2": y2}


ROOM = [
    *(
        wall_at(*a, *b)
        for a, b in itertools.pairwise([(-1.5, -1.5), (1.5, -1.5), (1.5, 1.5), (-1.5, 1.5), (-1.5, -1.5)])
    ),
    box_at(0.9, 0.0, 0.4, mass=3.0, heading=0.3),
    box_at(-0.2, 0.9, 0.3, mass=20.0),
    circle_at(-0.9, -0.2, 0.2, mass=1.0),
    circle_at(0.2, -0.9, 0.25),
]


def smooth_twists(robot: str, steps: int, scale: float = 0.5) -> NDArray[np.float64]:
    """Returns slowly wandering twists of a commandable size, (steps, axes)."""
    most = ROBOTS[robot].max_twist.copy()
    most[-1] = min(most[-1], 2.0)
    t = DT * np.arange(steps)[:, None]
    rng = np.random.default_rng(3)
    rates, phases = rng.uniform(0.2, 1.0, (2, 3, len(most)))
    return scale * most * np.minimum(t, 1.0) * np.sin(rates * t[:, None] + 6.0 * phases).mean(axis=1)


def momentum_twist(arena: Arena) -> NDArray[np.float64]:
    return np.array([arena.state["vx"], arena.state["vy"], arena.state["yaw_rate"]])


# No slip, no contact.


@pytest.mark.parametrize("robot", ["p3dx", "omni3", "omni4"])
@pytest.mark.parametrize("actuators", ["ideal", "lagged", "slow"])
def test_agrees_with_the_kinematic_plant_while_wheels_grip(tmp_path: Path, robot: str, actuators: str) -> None:
    arenas = [Arena(tmp_path, robot, dynamics=d, actuators=actuators) for d in ("kinematic", "pymunk")]
    twists = smooth_twists(robot, 400)
    for twist in twists:
        for arena in arenas:
            arena.drive(*twist)
        np.testing.assert_allclose(arenas[1].pose, arenas[0].pose, rtol=0.0, atol=1e-9)
    assert np.ptp(twists, axis=0).min() > 0.1


@pytest.mark.parametrize("robot", ["omni3", "omni4"])
def test_pymunk_itself_leaves_the_arc_exact(tmp_path: Path, robot: str) -> None:
    arena = Arena(tmp_path, robot, actuators="lagged")
    twist = (0.4, -0.3, 1.2)
    arena.set_twist(*twist, rolling=True)
    for _ in range(100):
        arena.plant.progress["pushing"] = 1  # has pymunk step every sub-step
        arena.drive(*twist)
    assert arena.plant.worlds[0] is not None
    np.testing.assert_allclose(arena.pose, integrate_arc(0.0, 0.0, 0.0, *twist, 5.0), rtol=0.0, atol=1e-6)


def test_sub_stepped_motion_agrees_with_the_whole_step(tmp_path: Path) -> None:
    kinematic = Arena(tmp_path, "omni3", dynamics="kinematic", actuators="lagged")
    stepped = Arena(tmp_path, "omni3", actuators="lagged")
    for twist in smooth_twists("omni3", 400):
        stepped.plant.progress["pushing"] = 1
        for arena in (kinematic, stepped):
            arena.drive(*twist)
        # they differ by the arc's curvature within a step: dt^3/12 |v' x w| at each
        np.testing.assert_allclose(stepped.pose, kinematic.pose, rtol=0.0, atol=1e-3)


# Traction.


@pytest.mark.parametrize("robot", ["p3dx", "omni3", "omni4"])
def test_spinning_wheels_pull_with_the_friction_of_their_load(tmp_path: Path, robot: str) -> None:
    arena = Arena(tmp_path, robot, actuators="ideal")
    speed = 0.9 * ROBOTS[robot].max_twist[0]
    acceleration = AHEAD[robot] * ROBOTS[robot].friction * GRAVITY
    axes = len(ROBOTS[robot].max_twist)
    start = arena.state["x"].item()
    steps = int(speed / acceleration / DT)
    assert steps >= 2
    for k in range(1, steps + 1):
        arena.drive(speed, *[0.0] * (axes - 1))
        assert arena.state["vx"] == pytest.approx(acceleration * k * DT, rel=1e-6)
        assert arena.state["x"] - start == pytest.approx(0.5 * acceleration * (k * DT) ** 2, rel=1e-6)
        assert arena.state["wheel_vx"] == pytest.approx(speed, rel=1e-6)
    arena.drive(speed, *[0.0] * (axes - 1), steps=2)
    assert arena.state["vx"] == arena.state["wheel_vx"]


@pytest.mark.parametrize("robot", ["p3dx", "omni3", "omni4"])
def test_braking_distance(tmp_path: Path, robot: str) -> None:
    arena = Arena(tmp_path, robot, actuators="ideal")
    speed = 0.9 * ROBOTS[robot].max_twist[0]
    arena.set_twist(speed, 0.0, 0.0, rolling=True)
    start = arena.state["x"].item()
    arena.drive(*[0.0] * len(ROBOTS[robot].max_twist), steps=40)
    assert arena.speed == 0.0
    distance = speed**2 / (2.0 * AHEAD[robot] * ROBOTS[robot].friction * GRAVITY)
    assert arena.state["x"] - start == pytest.approx(distance, rel=0.01)


@pytest.mark.parametrize("robot", ["omni3", "omni4"])
def test_what_spins_on_locked_wheels_glides_straight_on(tmp_path: Path, robot: str) -> None:
    """All wheels of a base that spins fast slip along their rims, where their pulls cancel: its momentum is kept."""
    arena = Arena(tmp_path, robot, actuators="ideal")
    arena.set_twist(1.0, 0.3, 14.0)
    before = arena.pose
    arena.drive(0.0, 0.0, 0.0)
    assert 8.0 < arena.state["yaw_rate"] < 13.0
    cosine, sine = math.cos(arena.state["heading"]), math.sin(arena.state["heading"])
    vx, vy = arena.state["vx"], arena.state["vy"]
    assert (cosine * vx - sine * vy, sine * vx + cosine * vy) == pytest.approx((1.0, 0.3), abs=1e-9)
    assert arena.pose[:2] - before[:2] == pytest.approx([0.05, 0.015], abs=1e-9)


def test_locked_plain_wheels_skid_straight_whatever_way_they_point(tmp_path: Path) -> None:
    arena = Arena(tmp_path, "p3dx", actuators="ideal")
    arena.set_twist(0.6, 0.7, 0.0)
    start = arena.pose
    arena.drive(0.0, 0.0, steps=2)
    deceleration = AHEAD["p3dx"] * ROBOTS["p3dx"].friction * GRAVITY
    left = math.hypot(0.6, 0.7) - deceleration * 2 * DT
    assert arena.speed == pytest.approx(left, rel=1e-3)
    dx, dy, turn = arena.pose - start
    assert math.atan2(dy, dx) == pytest.approx(math.atan2(0.7, 0.6), abs=1e-3)
    assert abs(turn) < 1e-9


def test_a_bend_too_fast_for_the_traction_is_left_outwards(tmp_path: Path) -> None:
    for speed, yaw_rate, skids in ((0.8, 1.5, False), (3.0, 3.0, True)):
        arena = Arena(tmp_path, "omni3", actuators="ideal")
        arena.set_twist(speed, 0.0, yaw_rate, rolling=True)
        arena.drive(speed, 0.0, yaw_rate, steps=5)
        assert (arena.state["vy"] < -0.05) == skids
        if not skids:
            assert arena.state["vy"] == 0.0


def test_slip_fools_drive_wheel_odometry_but_not_passive_wheels(tmp_path: Path) -> None:
    driven = Arena(tmp_path, "omni4", actuators="ideal", pose_source="odometry")
    passive = Arena(tmp_path, "omni3", actuators="ideal", pose_source="odometry")
    for arena, twist in itertools.product((driven, passive), ((0.6, 0.2, 1.0), (-0.5, 0.3, -1.0))):
        arena.drive(*twist, steps=10)
    for arena, error in ((driven, 0.01), (passive, 0.0)):
        odometry = np.array([arena.state[f"odometry_{name}"] for name in ("x", "y", "heading")])
        off = np.abs(odometry - arena.pose).max()
        assert off > error if error else off < 1e-9


# Contact.


@pytest.mark.parametrize("actuators", ["ideal", "lagged"])
def test_a_wall_holds_the_body_while_wheels_turn(tmp_path: Path, actuators: str) -> None:
    arena = Arena(tmp_path, "omni3", wall_at(1.0, -3.0, 1.0, 3.0), actuators=actuators)
    arena.drive(1.0, 0.0, 0.0, steps=40)
    for _ in range(20):
        arena.drive(1.0, 0.0, 0.0)
        assert arena.state["contact"] == 1
        assert arena.state["x"] == pytest.approx(1.0 - 0.3, abs=1e-4)
        assert arena.state["wheel_vx"] == pytest.approx(1.0, abs=1e-4)
        assert arena.speed < 1e-6
    arena.drive(-0.5, 0.0, 0.0, steps=40)
    assert arena.state["contact"] == 0
    assert arena.state["x"] < 0.69


def test_slides_along_a_wall_against_its_friction(tmp_path: Path) -> None:
    arena = Arena(tmp_path, "omni3", wall_at(0.31, -9.0, 0.31, 9.0), actuators="lagged")
    arena.drive(0.2, 0.6, 0.0, steps=100)
    assert arena.state["contact"] == 1
    assert 0.1 < arena.state["y"] < 3.0
    assert arena.state["clearance"] > -1e-4


def test_a_pushed_box_moves_and_the_floor_stops_it(tmp_path: Path) -> None:
    arena = Arena(tmp_path, "omni3", box_at(0.8, 0.0, 0.4, mass=3.0), actuators="lagged")
    arena.drive(1.0, 0.0, 0.0, steps=60)
    box = arena.obstacles[0]
    assert box["x"] > 2.0
    # robot and box keep in touch, at the speed of the wheels
    assert arena.state["contact"] == 1
    assert box["x"] - 0.2 - arena.state["x"] == pytest.approx(0.3, abs=2e-3)
    # but for what the box takes off between two pulls of the wheels
    taken = FLOOR_FRICTION * 3.0 * GRAVITY * arena.plant.substep / arena.robot.mass
    assert arena.state["vx"] == pytest.approx(1.0 - taken, abs=1e-6)
    arena.set_twist(0.0, 0.0, 0.0, rolling=True)
    start = box["x"].item()
    arena.drive(0.0, 0.0, 0.0, steps=20)
    stopped = box["x"].item()
    assert stopped - start == pytest.approx(1.0 / (2.0 * FLOOR_FRICTION * GRAVITY), rel=0.05)
    arena.drive(0.0, 0.0, 0.0, steps=20)
    assert box["x"] == stopped
    assert arena.plant.progress["pushing"][0] == 0


def test_pushing_force_is_traction_less_floor_friction(tmp_path: Path) -> None:
    mass = 8.0
    arena = Arena(tmp_path, "omni3", box_at(0.5 + 1e-6, 0.0, 0.4, mass=mass), actuators="ideal")
    arena.drive(1.4, 0.0, 0.0, steps=2)
    before = arena.state["vx"].item()
    arena.drive(1.4, 0.0, 0.0, steps=2)
    robot = ROBOTS["omni3"]
    pull = AHEAD["omni3"] * robot.friction * robot.mass * GRAVITY
    wanted = (pull - FLOOR_FRICTION * mass * GRAVITY) / (robot.mass + mass)
    assert (arena.state["vx"] - before) / (2 * DT) == pytest.approx(wanted, rel=0.02)


def test_a_box_too_heavy_for_the_traction_stays(tmp_path: Path) -> None:
    arena = Arena(tmp_path, "omni3", box_at(0.5 + 1e-6, 0.0, 0.4, mass=20.0), actuators="lagged")
    arena.drive(1.0, 0.0, 0.0, steps=100)
    assert arena.state["contact"] == 1
    assert arena.obstacles[0]["x"] == pytest.approx(0.5, abs=1e-4)
    assert arena.speed < 1e-3


def test_an_impact_keeps_momentum(tmp_path: Path) -> None:
    arena = Arena(tmp_path, "omni3", circle_at(1.0, 0.0, 0.3, mass=6.0), actuators="lagged")
    arena.place(0.39, 0.0, 0.0)
    arena.set_twist(1.0, 0.0, 0.0, rolling=True)
    momentum = 12.0 * 1.0
    arena.drive(1.0, 0.0, 0.0)
    ((_, body),) = arena.plant.worlds[0].pushable
    after = 12.0 * arena.state["vx"] + 6.0 * body.velocity.x
    floor = (FLOOR_FRICTION * 6.0 + ROBOTS["omni3"].friction * 12.0) * GRAVITY * DT
    assert body.velocity.x > 0.4
    assert abs(after - momentum) <= floor
    # nothing bounces
    assert body.velocity.x == pytest.approx(arena.state["vx"], abs=0.05)


def test_rays_and_clearance_follow_what_is_pushed(tmp_path: Path) -> None:
    arena = Arena(tmp_path, "omni3", box_at(0.8, 0.15, 0.4, mass=2.0), actuators="lagged")
    arena.drive(0.8, 0.0, 0.0, steps=40)
    pushed = arena.obstacles[0]
    assert pushed["x"] > 1.2
    assert abs(pushed["sin"]) > 0.01  # pushed off its centre, it turned
    assert pushed["sin"] ** 2 + pushed["cos"] ** 2 == pytest.approx(1.0)
    exact = clearance(arena.obstacles, 1, arena.state["x"], arena.state["y"]) - 0.3
    assert arena.state["clearance"] == exact


# Laws.


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("actuators", ["ideal", "lagged"])
def test_energy_comes_from_the_wheels_only(tmp_path: Path, seed: int, actuators: str) -> None:
    arena = Arena(tmp_path, "omni3", *ROOM, actuators=actuators)
    rng = np.random.default_rng(seed)
    base = arena.plant.base[0]
    reach = 0.3
    touched = 0
    for k in range(150):
        if k % 10 == 0:
            action = rng.uniform(-1.0, 1.0, 3) * arena.env.action_space.high
        before, twist = arena.kinetic_energy(), momentum_twist(arena)
        arena.drive(*action)
        gained = arena.kinetic_energy() - before
        fastest = max(np.hypot(*t[:2]) + reach * abs(t[2]) for t in (twist, momentum_twist(arena)))
        # friction pulls a contact point no faster than the body moves there, and no harder than it can
        assert gained <= 3 * base["traction"] * DT * fastest + 1e-9
        touched += arena.state["contact"]
        assert arena.state["clearance"] > -2e-3
    assert touched > 5


@pytest.mark.parametrize("seed", range(12))
def test_energy_never_grows_while_wheels_stand_still(tmp_path: Path, seed: int) -> None:
    arena = Arena(tmp_path, "omni3", *ROOM, actuators="ideal")
    rng = np.random.default_rng(seed)
    arena.set_twist(*rng.uniform(-4.0, 4.0, 2), rng.uniform(-10.0, 10.0))
    arena.plant.base["traction"] *= 0.05 * seed  # from ice to rubber
    energy = first = arena.kinetic_energy()
    for _ in range(60):
        arena.drive(0.0, 0.0, 0.0)
        assert arena.kinetic_energy() <= energy + 1e-9 * first
        energy = arena.kinetic_energy()
    assert energy < first or seed == 0


def test_on_ice_momentum_is_kept(tmp_path: Path) -> None:
    arena = Arena(tmp_path, "omni4", actuators="ideal")
    arena.plant.base["traction"] = 0.0
    arena.set_twist(0.5, 0.2, 4.0)
    arena.drive(0.3, 0.0, -1.0, steps=50)
    np.testing.assert_allclose(arena.pose[:2], (0.5 * 2.5, 0.2 * 2.5), rtol=0.0, atol=1e-9)
    assert arena.speed == pytest.approx(math.hypot(0.5, 0.2), abs=1e-12)
    assert arena.state["yaw_rate"] == 4.0


@pytest.mark.parametrize("robot", ["omni3", "omni4"])
@pytest.mark.parametrize("angle", np.linspace(-1.2, 1.2, 7))
def test_no_tunnelling_through_a_thin_wall(tmp_path: Path, robot: str, angle: float) -> None:
    arena = Arena(tmp_path, robot, wall_at(3.0, -50.0, 3.0, 50.0), actuators="ideal")
    # as fast as the wheels can turn
    top = 200.0 / np.abs(ROBOTS[robot].wheel_matrix @ (math.cos(angle), math.sin(angle), 0.0)).max()
    twist = (top * math.cos(angle), top * math.sin(angle), 0.0)
    arena.set_twist(*twist, rolling=True)
    touched = 0
    for _ in range(40):
        arena.drive(*twist)
        touched += arena.state["contact"]
        assert arena.state["x"] <= 3.0 - ROBOTS[robot].hull_radius + 1e-3
    assert touched


# in the fast part the worst of each thickness
SQUEEZED = [
    pytest.param(width, mass, heading, speed, actuators,
                 marks=[] if (mass, heading, speed) in ((0.1, 1.2, 1.5), (0.5, 1.2, 1.5)) else pytest.mark.slow)
    for width in (0.005, 0.01, 0.03, 0.05, 0.08)
    for mass in (0.1, 0.5, 2.0)
    for heading in (0.0, 0.3, 1.2, None)  # None: a disc
    for speed in (0.4, 1.0, 1.5)
    for actuators in ("lagged", "ideal")
]  # fmt: skip


@pytest.mark.parametrize(("width", "mass", "heading", "speed", "actuators"), SQUEEZED)
def test_nothing_thin_is_pushed_through_a_wall(
    tmp_path: Path, width: float, mass: float, heading: float | None, speed: float, actuators: str
) -> None:
    thing = circle_at(0.7, 0.03, 0.5 * width, mass)
    if heading is not None:
        thing = {**box_at(0.7, 0.03, 0.4, mass, heading), "length": width}
    arena = Arena(tmp_path, "omni3", wall_at(1.2, -3.0, 1.2, 3.0), thing, actuators=actuators)
    for _ in range(80):
        arena.drive(speed, 0.0, 0.0)
        assert arena.obstacles[1]["x"] <= 1.2


def test_what_is_too_thin_to_be_pushed_is_refused(tmp_path: Path) -> None:
    with pytest.raises(
        ValueError, match=r"obstacles\[0\] \(box of 0.004 x 0.4 m .* is 0.004 m thick; .* at least 0.005 m"
    ):
        Arena(tmp_path, "omni3", {**box_at(1.0, 0.0, 0.4, 1.0), "length": 0.004})


@pytest.mark.parametrize("speed", [0.1, 1.0, 1.5])
def test_stays_out_of_what_is_fixed(tmp_path: Path, speed: float) -> None:
    corner = [
        wall_at(1.0, -1.0, 1.0, 1.0),
        wall_at(-1.0, 1.0, 1.0, 1.0),
        box_at(0.6, -0.7, 0.3),
        circle_at(-0.7, 0, 0.2),
    ]
    arena = Arena(tmp_path, "omni3", *corner, actuators="lagged")
    for angle in np.random.default_rng(1).uniform(-math.pi, math.pi, 25):
        for _ in range(10):
            arena.drive(speed * math.cos(angle), speed * math.sin(angle), 0.5)
            assert arena.state["clearance"] > -1e-3


def test_an_overlap_is_resolved_gently(tmp_path: Path) -> None:
    arena = Arena(tmp_path, "omni3", wall_at(1.0, -3.0, 1.0, 3.0), box_at(-0.6, 0.0, 0.4, mass=2.0), actuators="ideal")
    arena.place(0.8, 0.0, 0.0)  # 10 cm inside the wall
    x, inside = arena.state["x"].item(), [0.1]
    for _ in range(20):
        arena.drive(0.0, 0.0, 0.0)
        assert arena.kinetic_energy() < 1e-9
        assert arena.state["x"] <= x + 1e-9
        x = arena.state["x"].item()
        inside.append(-arena.state["clearance"].item())
    assert inside[-1] == pytest.approx(0.0, abs=1e-3)
    # not out at once: while it is deep, a period lets it out by no more than three quarters of what is left
    assert all(after > 0.25 * before for before, after in itertools.pairwise(inside) if before > 0.01)


# Determinism.


def room_file(tmp_path: Path) -> str:
    file = tmp_path / "room.json"
    file.write_text(json.dumps({"goal": [0.9, 0.9, 0.0], "obstacles": ROOM, "start_offset": 0.1, "start_turn": 3.0}))
    return str(file)


def test_a_reset_forgets_what_was_pushed(tmp_path: Path) -> None:
    env: Any = gymnasium.make(GOAL_ID, scenario=room_file(tmp_path), dynamics="pymunk", end_on_contact=False).unwrapped
    runs = []
    for _ in range(2):
        env.reset(seed=3)
        at_first = env.batch.obstacles.copy()
        assert env.batch.plant.worlds == [None]
        for angle in np.linspace(0.0, 2.0 * math.pi, 160):
            env.step(np.array([math.cos(angle), math.sin(angle), 0.0], np.float32))
        assert (env.batch.obstacles["x"] != at_first["x"]).any()
        runs.append(env.batch.states.tobytes() + env.batch.obstacles.tobytes())
    assert runs[0] == runs[1]
