"""Reference implementation of the pymunk plant: wheels that grip or slip, the body's motion, what a space holds."""

import cmath
import math
from typing import Any

import gymnasium
import numpy as np
import pytest
from numpy.typing import NDArray
from oracles.episodes import DT, GOAL, PATH, Bank, Goals, Paths, Robot, compared, moved, wrap

import wayfield  # noqa: F401  registers the environments
from wayfield.envs import pymunk_plant
from wayfield.envs.robots import ROBOTS
from wayfield.envs.scenarios.obstacles import circle, obstacle_field
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
