"""The documents' systems against numbers that follow from their laws, and the documented against the corrected.

Each law is solved here a second time, by hand or by SciPy, for the documents' constants and for others.
"""

import dataclasses
import functools
import json
import math
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.integrate import trapezoid
from scipy.optimize import brentq

import wayfield  # noqa: F401  registers the environments
from wayfield import policies
from wayfield.envs.robots import ROBOTS
from wayfield.envs.robots.kinematics import plain_sum_matrix
from wayfield.envs.scenarios import GOAL_SCENARIOS
from wayfield.policies import Pilot, Policy
from wayfield.policies.paths.lookahead import Lookahead

DT = 0.05
PATH_ID = "wayfield/DiffDrivePathFollowing-v0"
GOAL_ID = "wayfield/OmniGoalObstacles-v0"


@dataclasses.dataclass
class Run:
    """A recorded episode: the state before the first step and after each."""

    states: NDArray[np.void]  # (t + 1,)
    info: dict[str, Any]  # of the last step
    terminated: bool
    references: NDArray[np.float64]  # (t,) arc length of a look-ahead controller's reference point, m

    def __getitem__(self, name: str) -> NDArray[Any]:
        return self.states[name]

    @property
    def rms(self) -> float:
        return float(np.sqrt((self["cross_track_error"][1:] ** 2).mean()))

    @property
    def worst(self) -> float:
        return float(np.abs(self["cross_track_error"][1:]).max())

    @property
    def points(self) -> NDArray[np.float64]:
        return np.column_stack([self["x"], self["y"]])

    def first_time(self, reached: NDArray[np.bool_]) -> float:
        """Returns when (s) something was first so; inf if never."""
        return float(np.argmax(reached) * DT) if reached.any() else math.inf


def drive(
    env_id: str, scenario: str, policy: Policy, steps: int = 1200, *, to_the_clock: bool = False, **kwargs: Any
) -> Run:
    env: Any = gymnasium.make(env_id, scenario=scenario, max_episode_steps=steps, **kwargs)
    observation, info = env.reset(seed=0)
    pilot = Pilot(policy, env)
    pilot.reset()
    state = env.unwrapped.batch.states[0]
    states, references = [state.copy()], []
    terminated = truncated = False
    while not (truncated or (terminated and not to_the_clock)):
        if isinstance(policy, Lookahead):
            fields = pilot.briefing.layout.unpack(observation[None].astype(np.float64))
            references.append(policy.errors(fields.pose, fields.arc_length, pilot.briefing)[0, 4])
        observation, _, terminated, truncated, info = env.step(pilot.command(observation))
        states.append(state.copy())
    return Run(np.array(states), info, terminated, np.array(references))


def written(folder: Path, **fields: Any) -> str:
    file = folder / "scenario.json"
    file.write_text(json.dumps(fields))
    return str(file)


# A. Path tracking with a look-ahead point.

NO_BLEND = 0.01  # m, a mode distance that leaves nothing of the aligning term at a look-ahead distance


@pytest.mark.parametrize(
    ("k_lin", "k_ang", "lookahead_distance"), [(1.2, 0.8, 0.5), (1.2, 2.4, 0.5), (0.9, 1.5, 0.8), (1.5, 0.6, 0.3)]
)
@pytest.mark.parametrize("side", [1.0, -1.0])
def test_small_errors_on_a_straight_line_swing_as_a_second_order_system(
    tmp_path: Path, k_lin: float, k_ang: float, lookahead_distance: float, side: float
) -> None:
    offset = 1e-3 * side
    line = written(tmp_path, path=[[0, 0], [60, 0]], start=[0, offset, 0])
    gains = {"k_lin": k_lin, "k_ang": k_ang, "lookahead_distance": lookahead_distance}
    run = drive(PATH_ID, line, policies.make("lookahead_documented", mode_distance=NO_BLEND, **gains), 240)
    v = k_lin * lookahead_distance
    # th'' + k_ang th' + (k_ang v / L) th = 0, and so for y, with commands held over the control period
    rates = np.array([[0.0, v], [0.0, 0.0]])
    gain = -k_ang * np.array([1.0 / lookahead_distance, 1.0])
    held = np.eye(2) + DT * rates + np.outer([v * DT**2 / 2.0, DT], gain)
    wanted = [np.array([offset, 0.0])]
    for _ in range(240):
        wanted.append(held @ wanted[-1])
    np.testing.assert_allclose(np.column_stack([run["y"], run["heading"]]), wanted, atol=1e-3 * abs(offset))
    # the continuous law; holding the command costs half a period of phase
    wn = math.sqrt(k_ang * v / lookahead_distance)
    damping = k_ang / (2.0 * wn)
    if damping < 0.9:
        overshoot = math.exp(-math.pi * damping / math.sqrt(1.0 - damping**2))
        assert -(side * run["y"]).min() / abs(offset) == pytest.approx(overshoot, abs=0.02)
        crossings = np.flatnonzero(np.diff(np.sign(run["heading"][1:])) != 0)
        half_period = math.pi / (wn * math.sqrt(1.0 - damping**2))
        assert (crossings[0] + 2) * DT == pytest.approx(half_period, rel=0.03)


def test_the_documents_straight_line_response(tmp_path: Path) -> None:
    line = written(tmp_path, path=[[0, 0], [60, 0]], start=[0, 0.01, 0])
    run = drive(PATH_ID, line, policies.make("lookahead_documented"), 400)
    assert run["vx"][1:] == pytest.approx(0.6, abs=1e-3)
    assert math.sqrt(0.8 * 0.6 / 0.5) == pytest.approx(0.98, abs=0.005)
    assert -run["y"].min() / 0.01 == pytest.approx(0.245, abs=0.015)
    assert abs(run["cross_track_error"][-1]) < 1e-4


def ring(folder: Path, radius: float, direction: int) -> str:
    angles = direction * np.linspace(0.0, 2.0 * math.pi, round(1200 * radius), endpoint=False)
    points = radius * np.column_stack([np.cos(angles), np.sin(angles)])
    return written(folder, path=points.tolist(), closed=True, laps=0)


def steady_radius(radius: float, k_lin: float, k_ang: float, lookahead_distance: float) -> float:
    """Returns the radius (m) on which w = k_ang e_h and v = k_lin e_d fit the circle driven on."""

    def surplus(rho: float) -> float:
        phi = math.atan(lookahead_distance / rho)
        e_h = math.atan2(rho - radius * math.cos(phi), radius * math.sin(phi))
        return k_ang * e_h - k_lin * radius * math.sin(phi) / rho

    return float(brentq(surplus, 0.7 * radius, 2.0 * radius))


@pytest.mark.parametrize(("radius", "direction"), [(0.5, 1), (0.8, -1), (1.0, 1), (2.0, -1), (3.0, 1)])
@pytest.mark.parametrize(("k_lin", "k_ang", "lookahead_distance"), [(1.2, 0.8, 0.5), (1.2, 2.4, 0.5), (1.0, 1.3, 0.4)])
def test_steady_radius_on_a_circle(
    tmp_path: Path, radius: float, direction: int, k_lin: float, k_ang: float, lookahead_distance: float
) -> None:
    gains = {"k_lin": k_lin, "k_ang": k_ang, "lookahead_distance": lookahead_distance}
    policy = policies.make("lookahead_documented", mode_distance=NO_BLEND, **gains)
    run = drive(PATH_ID, ring(tmp_path, radius, direction), policy, 1400)
    offset = steady_radius(radius, **gains) - radius
    # it drives a polygon with sides of a centimetre
    np.testing.assert_allclose(np.hypot(run["x"], run["y"])[-100:] - radius, offset, atol=5e-4)
    # outside is to the right of a circle driven to the left
    np.testing.assert_allclose(run["cross_track_error"][-100:], -direction * offset, atol=5e-4)


@pytest.mark.parametrize(("scenario", "offset"), [("circle_r0.5", 0.1525), ("circle", 0.1469), ("circle_r2", 0.1040)])
def test_the_documents_offsets_on_circles(scenario: str, offset: float) -> None:
    radius = {"circle_r0.5": 0.5, "circle": 1.0, "circle_r2": 2.0}[scenario]
    assert steady_radius(radius, 1.2, 0.8, 0.5) - radius == pytest.approx(offset, abs=1e-4)
    # the blend takes half a millimetre off it, and the path is a polygon
    driven = tracked(scenario, "lookahead_documented")["cross_track_error"][-100:]
    np.testing.assert_allclose(-driven, offset, atol=1e-3)


@pytest.mark.parametrize("radius", [0.5, 0.8, 1.5])
@pytest.mark.parametrize("lookahead_distance", [0.5, 0.3])
def test_zero_offset_gain_on_a_circle(tmp_path: Path, radius: float, lookahead_distance: float) -> None:
    phi = math.atan(lookahead_distance / radius)
    gains = {"k_ang": 2.0 * 1.2 * math.sin(phi) / phi, "lookahead_distance": lookahead_distance}
    policy = policies.make("lookahead_documented", mode_distance=NO_BLEND, **gains)
    run = drive(PATH_ID, ring(tmp_path, radius, 1), policy, 800)
    assert np.abs(run["cross_track_error"][-100:]).max() < 5e-5


@functools.cache
def tracked(scenario: str, policy: str) -> Run:
    return drive(PATH_ID, scenario, policies.make(policy))


@pytest.mark.parametrize(
    ("scenario", "rms", "worst"),
    [
        ("circle", 0.144, 0.160),
        ("s_curve", 0.106, 0.164),
        ("s_curve_tight", 0.122, 0.207),
        ("right_angle", 0.105, 0.217),
        ("figure_eight", 0.123, 0.189),
    ],
)
def test_reproduces_the_documented_accuracy(scenario: str, rms: float, worst: float) -> None:
    run = tracked(scenario, "lookahead_documented")
    assert run.rms == pytest.approx(rms, abs=0.002)
    assert run.worst == pytest.approx(worst, abs=0.002)
    assert not run.info["left_corridor"]


def test_reproduces_the_documented_times_and_speed() -> None:
    assert tracked("circle", "lookahead_documented")["vx"][1:].mean() == pytest.approx(0.48, abs=0.005)
    for scenario, time in (("s_curve", 29.7), ("s_curve_tight", 52.0)):
        run = tracked(scenario, "lookahead_documented")
        assert run.info["success"]
        assert run.info["time"] == pytest.approx(time, abs=0.1)


@pytest.mark.parametrize("scenario", ["circle_r0.5", "circle", "circle_r2"])
def test_the_retuned_gain_is_ten_times_as_accurate_on_circles(scenario: str) -> None:
    documented, retuned = tracked(scenario, "lookahead_documented"), tracked(scenario, "lookahead_retuned")
    assert documented.rms > 10.0 * retuned.rms
    if scenario == "circle":
        assert retuned.rms == pytest.approx(0.004, abs=5e-4)


def jumps(run: Run, lap: float) -> int:
    """Returns how often the reference point moved more than half a metre in a control period."""
    moved = np.diff(run.references)
    return int((np.abs(moved - lap * np.round(moved / lap)) > 0.5).sum())


def test_the_whole_path_search_jumps_at_crossings_and_the_window_does_not() -> None:
    lap = 12.1944  # of the figure eight, m
    assert jumps(tracked("figure_eight", "lookahead_documented"), lap) == 8
    assert jumps(tracked("figure_eight", "lookahead_retuned"), lap) == 0


@pytest.mark.parametrize("turn", [90.0, 110.0, -90.0])
def test_the_disc_reading_deadlocks_at_a_corner(tmp_path: Path, turn: float) -> None:
    beyond = [3.0 + 3.0 * math.cos(math.radians(turn)), 3.0 * math.sin(math.radians(turn))]
    corner = written(tmp_path, path=[[0, 0], [3, 0], beyond])
    held = drive(PATH_ID, corner, policies.make("lookahead_documented", reference_heading=0.0))
    assert not held.terminated
    assert held.points[-1] == pytest.approx([3.0, 0.0], abs=1e-3)
    assert held["heading"][-1] == pytest.approx(0.0, abs=1e-3)
    assert abs(held["vx"][-1]) < 1e-3
    assert abs(held["yaw_rate"][-1]) < 1e-3
    assert drive(PATH_ID, corner, policies.make("lookahead_documented")).info["success"]


@pytest.mark.parametrize("side", [1.0, -1.0])
@pytest.mark.parametrize(("k_ang", "k_ori"), [(0.8, 8.0), (1.2, 6.0)])
def test_the_disc_reading_parks_off_an_open_end(tmp_path: Path, side: float, k_ang: float, k_ori: float) -> None:
    line = written(tmp_path, path=[[0, 0], [3, 0]])
    yaw = side * math.pi / 2.0
    policy = policies.make("lookahead_documented", reference_heading=yaw, k_ang=k_ang, k_ori=k_ori)
    # the episode ends 5 cm before the path does; the law drives on
    run = drive(PATH_ID, line, policy, to_the_clock=True)
    assert np.ptp(run.points[-100:], axis=0) == pytest.approx([0.0, 0.0], abs=1e-6)
    heading = run["heading"][-1]
    assert np.ptp(run["heading"][-100:]) < 1e-6
    away = np.array([3.0, 0.0]) - run.points[-1]
    distance, left = float(np.hypot(*away)), side * (yaw - heading)
    mode = math.exp(-distance / 0.05)
    # at rest the end lies across, and the two turns cancel
    assert away @ (math.cos(heading), math.sin(heading)) == pytest.approx(0.0, abs=1e-4)
    assert k_ang * (1.0 - mode) * math.pi / 2.0 == pytest.approx(k_ori * mode * left, rel=1e-3)
    if (k_ang, k_ori) == (0.8, 8.0):
        assert distance == pytest.approx(0.075, abs=0.003)
        assert math.degrees(left) == pytest.approx(32.0, abs=1.5)


@pytest.mark.parametrize("direction", [0.0, 2.0, -2.5])
def test_the_tangent_reading_converges_at_an_open_end(tmp_path: Path, direction: float) -> None:
    end = [3.0 * math.cos(direction), 3.0 * math.sin(direction)]
    line = written(tmp_path, path=[[0, 0], end])
    run = drive(PATH_ID, line, policies.make("lookahead_documented"), 800, to_the_clock=True)
    assert run.info["success"]
    assert run.points[-1] == pytest.approx(end, abs=1e-3)
    assert run["heading"][-1] == pytest.approx(direction, abs=1e-3)


# B. Waypoints with a three-omni-wheel robot.


@pytest.mark.parametrize("lam", [0.3, 0.5, 1.0, 3.0])
@pytest.mark.parametrize("goal", [(3.0, 4.0), (-2.0, 1.0)])
def test_the_position_error_decays_exponentially(tmp_path: Path, lam: float, goal: tuple[float, float]) -> None:
    scenario = written(tmp_path, goal=[*goal, 0.0], position_tolerance=0.001)
    distance = math.hypot(*goal)
    steps = math.ceil(math.log(1.0 / 20.0) / math.log(1.0 - lam * DT))
    run = drive(GOAL_ID, scenario, policies.make("waypoint", lam=lam, final_tolerance=0.0), steps)
    wanted = distance * (1.0 - lam * DT) ** np.arange(steps + 1)
    np.testing.assert_allclose(run["goal_distance"], wanted, atol=1e-5)
    assert run.first_time(run["goal_distance"] <= distance / 20.0) == pytest.approx(steps * DT)
    if lam in (0.5, 1.0):
        assert steps * DT == pytest.approx({0.5: 5.95, 1.0: 2.95}[lam])


def test_the_heading_decays_on_after_the_position_has(tmp_path: Path) -> None:
    """At the place and 0.5 rad off, with a tolerance of the heading that is never met: it turns on towards it."""
    scenario = written(tmp_path, goal=[0.001, 0.0, 0.5], heading_tolerance=1e-6, position_tolerance=0.02)
    run = drive(GOAL_ID, scenario, policies.make("waypoint", final_tolerance=0.01), 120)
    left = np.abs(run["goal_heading_error"])
    np.testing.assert_allclose(left, 0.5 * (1.0 - DT) ** np.arange(len(left)), rtol=1e-5)
    assert left[-1] < 0.002


@pytest.mark.parametrize(("lam", "time"), [(1.0, 2.95), (0.5, 5.95)])
def test_experiment_1_of_document_b(lam: float, time: float) -> None:
    run = drive(GOAL_ID, "omni3_goal", policies.make("waypoint", lam=lam))
    assert run.first_time(run["goal_distance"] <= 0.25) == pytest.approx(time)
    assert run.info["success"]
    assert run["heading"][-1] == pytest.approx(math.radians(45.0), abs=0.02)


@pytest.mark.parametrize(
    ("radius", "arrivals", "length"),
    [(0.25, (2.60, 4.85, 7.00, 9.25), 9.69), (0.35, (2.30, 4.25, 6.10, 8.05), 9.47)],
)
def test_experiment_2_of_document_b(radius: float, arrivals: tuple[float, ...], length: float) -> None:
    run = drive(GOAL_ID, "omni3_waypoints", policies.make("waypoint", switching_radius=radius))
    assert run.info["success"]
    assert run["clearance"].min() > 0.0
    k = 0
    for place, arrival in zip([(2.5, 2.5), (4.0, 0.5), (6.0, 1.0), (8.0, 2.0)], arrivals, strict=True):
        k += int(np.argmax(np.hypot(*(run.points[k:] - place).T) < radius))
        assert k * DT == pytest.approx(arrival)
    assert np.hypot(*np.diff(run.points[: k + 1], axis=0).T).sum() == pytest.approx(length, abs=0.005)
    if radius == 0.35:
        # stopping at the switching radius would leave the heading so far off
        assert math.degrees(abs(run["goal_heading_error"][k])) == pytest.approx(24.0, abs=0.5)


@pytest.mark.parametrize("heading", [0.0, 1.0, -2.0])
def test_half_a_turn_is_taken_to_the_left(tmp_path: Path, heading: float) -> None:
    # the heading that float32 takes for half a turn
    opposite = float(np.float32(heading)) + math.pi
    scenario = written(tmp_path, goal=[1.0, 0.0, opposite], start=[0.0, 0.0, float(np.float32(heading))])
    run = drive(GOAL_ID, scenario, policies.make("waypoint"))
    assert run.info["success"]
    assert (run["yaw_rate"][1:] > 0.0).all()
    turned = np.unwrap(run["heading"])
    assert turned[-1] - turned[0] == pytest.approx(math.pi, abs=0.11)


def test_the_printed_odometry_stops_short() -> None:
    policy = policies.make("waypoint")
    run = drive(GOAL_ID, "omni3_goal", policy, pose_source="odometry_plain_sum")
    assert not run.info["success"]
    # the robot believes that it has arrived
    believed = np.array([run["measured_x"][-1], run["measured_y"][-1]])
    assert believed == pytest.approx([3.0, 4.0], abs=0.02)
    # Believed position errors decay at 3/2 lam, heading errors at 3 lam: the robot drives the believed straight line
    # turned back by 2/3 of the believed heading, at 2/3 of its length. A short control period of lam = 1 adds 2 cm.
    share = np.linspace(0.0, 1.0, 2001)
    back = -math.radians(45.0) * 2.0 / 3.0 * (1.0 - (1.0 - share) ** 2)
    stop = 2.0 / 3.0 * (3.0 + 4.0j) * trapezoid(np.exp(1j * back), share)
    assert run["goal_distance"][-1] == pytest.approx(abs(3.0 + 4.0j - stop), abs=0.03)
    assert run["goal_distance"][-1] == pytest.approx(2.3, abs=0.1)
    assert drive(GOAL_ID, "omni3_goal", policy, pose_source="odometry").info["success"]


@pytest.mark.parametrize(("robot", "share"), [("omni3", 2.0 / 3.0), ("omni4", 1.0 / 2.0)])
@pytest.mark.parametrize("goal", [(2.0, 1.0), (-1.0, 3.0)])
def test_without_a_turn_the_printed_odometry_stops_after_two_nths(
    tmp_path: Path, robot: str, share: float, goal: tuple[float, float]
) -> None:
    scenario = written(tmp_path, goal=[*goal, 0.0])
    policy = policies.make("waypoint", final_tolerance=0.0)
    run = drive(GOAL_ID, scenario, policy, 400, robot=robot, pose_source="odometry_plain_sum")
    assert run.points[-1] == pytest.approx(share * np.array(goal), abs=1e-3)
    matrix, radii = ROBOTS[robot].wheel_matrix, ROBOTS[robot].wheel_radii
    np.testing.assert_allclose(
        plain_sum_matrix(matrix, radii) @ matrix, np.diag([1 / share, 1 / share, 2 / share]), atol=1e-12
    )


@pytest.mark.parametrize("robot", ["omni3", "omni4"])
@pytest.mark.parametrize("goal", [(3.0, 4.0), (5.0, -1.0), (-2.0, -4.5)])
def test_uniform_saturation_keeps_the_straight_line(tmp_path: Path, robot: str, goal: tuple[float, float]) -> None:
    scenario = written(tmp_path, goal=[*goal, 0.0])
    run = drive(GOAL_ID, scenario, policies.make("waypoint"), robot=robot, actuators="lagged")
    assert run["saturated"].sum() > 10
    assert run.info["success"]
    across = (run["x"] * goal[1] - run["y"] * goal[0]) / math.hypot(*goal)
    assert np.abs(across).max() < 1e-5
    # clipping each wheel by itself would have left it at once
    base = ROBOTS[robot]
    wheels = np.clip(base.wheel_matrix @ (*goal, 0.0), -base.rated_wheel_speed, base.rated_wheel_speed)
    vx, vy, yaw_rate = base.forward_matrix @ wheels
    bent = abs(vx * goal[1] - vy * goal[0]) / math.hypot(*goal) / math.hypot(vx, vy)
    assert bent > math.sin(math.radians(5.0)) or abs(yaw_rate) > 0.1


@pytest.mark.parametrize("shove", [(6.0, 0.8, -0.5, 0.7), (7.0, -1.5, 0.0, -1.0)])
def test_station_keeping_after_a_shove(shove: tuple[float, float, float, float]) -> None:
    policy = policies.make("waypoint")
    run = drive(GOAL_ID, "omni3_goal", policy, 300, end_on_success=False, shove=shove)
    step = round(shove[0] / DT)
    assert run["goal_distance"][step] < 0.02
    pushed = math.hypot(shove[1], shove[2])
    assert run["goal_distance"][step + 1] == pytest.approx(pushed, abs=0.03)
    assert run["goal_distance"][-1] < 0.02
    assert abs(run["goal_heading_error"][-1]) < 0.02
    # home again as fast as from anywhere
    back = run["goal_distance"][step + 1 :] <= 0.1 * pushed
    assert np.argmax(back) * DT == pytest.approx(math.log(10.0), abs=0.15)


# C. Potential fields with a four-omni-wheel robot.

RUNS = ("apf_0", "apf_1", "apf_2")


def field(folder: Path, goal: tuple[float, float], *obstacles: tuple[float, float], start: Any = (0, 0, 0)) -> str:
    discs = [{"kind": "circle", "x": x, "y": y, "radius": 0.01} for x, y in obstacles]
    return written(folder, goal=[*goal, 0.0], obstacles=discs, start=list(start))


def seek(scenario: str, policy: Policy, steps: int = 1200) -> Run:
    return drive(GOAL_ID, scenario, policy, steps, robot="omni4", end_on_success=False)


def stagnation_distance(k_att: float, k_rep: float, behind: float) -> float:
    """Returns the distance d (m) before an obstacle, with the goal `behind` it, where k_att (D + d) d^3 = k_rep."""
    return float(brentq(lambda d: k_att * (behind + d) * d**3 - k_rep, 1e-3, 20.0))


@pytest.mark.parametrize("tau", [1.2, 2.0, 3.0])
def test_the_documented_field_stagnates_in_scenario_1(tau: float) -> None:
    run = seek("apf_1", policies.make("apf_documented", tau=tau))
    assert stagnation_distance(0.2, 0.52, math.hypot(1.0, 0.5)) == pytest.approx(1.0607, abs=1e-4)
    assert run.points[-1] == pytest.approx([0.0513, 0.0256], abs=1e-4)


@pytest.mark.parametrize(
    ("k_att", "k_rep", "ahead", "behind"), [(0.2, 0.52, 3.0, 2.0), (0.3, 0.2, 2.0, 1.0), (0.15, 1.0, 4.0, 3.0)]
)
@pytest.mark.parametrize("direction", [0.0, math.pi / 2.0, math.pi])
def test_the_documented_field_stagnates_before_an_obstacle(
    tmp_path: Path, k_att: float, k_rep: float, ahead: float, behind: float, direction: float
) -> None:
    axis = np.round([math.cos(direction), math.sin(direction)], 12)
    scenario = field(tmp_path, tuple((ahead + behind) * axis), tuple(ahead * axis))
    run = seek(scenario, policies.make("apf_documented", k_att=k_att, k_rep=k_rep, tau=2.5), 800)
    d = stagnation_distance(k_att, k_rep, behind)
    assert d < 2.4
    assert run.points[-1] == pytest.approx((ahead - d) * axis, abs=2e-4)
    # the document's test for a local minimum: 1 at any equilibrium
    attraction, repulsion = k_att * (behind + d), k_rep / d**3
    assert attraction / (repulsion + 0.0001) == pytest.approx(1.0, abs=2e-3)
    at_rest = k_att * np.hypot(*((ahead + behind) * axis - run.points[-1]))
    assert at_rest / (k_rep / np.hypot(*(ahead * axis - run.points[-1])) ** 3 + 0.0001) == pytest.approx(1.0, abs=5e-3)


@pytest.mark.parametrize(
    ("k_att", "k_rep", "behind", "documented"),
    [(0.2, 0.52, math.hypot(1.0, 0.5), 0.21), (0.3, 0.9, 1.0, None), (0.1, 0.52, 2.5, None)],
)
@pytest.mark.parametrize("side", [1.0, -1.0])
def test_stagnation_is_a_saddle(
    tmp_path: Path, k_att: float, k_rep: float, behind: float, documented: float | None, side: float
) -> None:
    d = stagnation_distance(k_att, k_rep, behind)
    growth = k_rep / d**4 - k_att
    if documented is not None:
        assert growth == pytest.approx(documented, abs=0.005)
    offset = 1e-3 * side
    scenario = field(tmp_path, (behind, 0.0), (0.0, 0.0), start=(-d, offset, 0.0))
    run = seek(scenario, policies.make("apf_documented", k_att=k_att, k_rep=k_rep, tau=5.0), 160)
    wanted = offset * (1.0 + growth * DT) ** np.arange(161)
    np.testing.assert_allclose(run["y"], wanted, rtol=0.01)


@pytest.mark.parametrize(
    ("k_att", "k_rep", "behind"), [(0.2, 0.52, math.hypot(1.0, 0.5)), (0.3, 0.2, 0.8), (0.15, 1.0, 1.5)]
)
def test_a_goal_near_an_obstacle_is_pushed_out_of_reach(
    tmp_path: Path, k_att: float, k_rep: float, behind: float
) -> None:
    beyond = float(brentq(lambda e: k_att * e * (behind + e) ** 3 - k_rep, 1e-6, 20.0))
    if behind == math.hypot(1.0, 0.5):
        assert beyond == pytest.approx(0.555, abs=5e-4)
        assert behind + beyond == pytest.approx(1.673, abs=5e-4)
    scenario = field(tmp_path, (behind, 0.0), (0.0, 0.0), start=(behind + 2.5, 0.1, 0.0))
    run = seek(scenario, policies.make("apf_documented", k_att=k_att, k_rep=k_rep, tau=behind + beyond + 0.05))
    assert run.points[-1] == pytest.approx([behind + beyond, 0.0], abs=1e-3)
    # within reach exactly when the repulsion does not get to the goal
    free = seek(scenario, policies.make("apf_documented", k_att=k_att, k_rep=k_rep, tau=0.99 * behind))
    assert free["goal_distance"][-1] < 1e-3
    # in between, the robot is thrown back at the rim of the repulsion for ever
    rim = behind + 0.5 * beyond
    thrown = seek(scenario, policies.make("apf_documented", k_att=k_att, k_rep=k_rep, tau=rim))
    assert thrown["goal_distance"].min() > 0.3 * beyond


@pytest.mark.parametrize("scenario", RUNS)
@pytest.mark.parametrize("tau", [0.2, 0.5, 1.0, 3.0])
def test_the_documented_field_reaches_no_goal(scenario: str, tau: float) -> None:
    run = seek(scenario, policies.make("apf_documented", tau=tau))
    assert run["goal_distance"].min() > 0.25
    assert not run.info["success"]


@pytest.mark.parametrize("scenario", RUNS)
@pytest.mark.parametrize("tau", [0.4, 0.8])
def test_the_avoiding_force_frees_the_documented_field(scenario: str, tau: float) -> None:
    run = seek(scenario, policies.make("apf_escape", tau=tau))
    assert not run["contact"].any()
    assert 11.0 < run.first_time(run["goal_distance"] <= 0.25) < 16.0
    (course,) = GOAL_SCENARIOS[scenario](ROBOTS["omni4"].hull_radius)
    centres = np.column_stack([course.obstacles["x"], course.obstacles["y"]])
    nearest = np.hypot(*(run.points[:, None] - centres).transpose(2, 0, 1)).min()
    assert nearest == pytest.approx(min(tau - 0.02, np.hypot(*centres.T).min()), abs=0.012)


ARRIVALS = {"apf_0": 18.3, "apf_1": 11.6, "apf_2": 11.3}


@pytest.mark.parametrize("scenario", RUNS)
def test_the_corrected_field_reaches_every_goal(scenario: str) -> None:
    run = seek(scenario, policies.make("apf_corrected"))
    time = run.first_time(run["goal_distance"] <= 0.02)
    assert time == pytest.approx(ARRIVALS[scenario], rel=0.1)
    assert run["goal_distance"][-1] < 0.02
    assert run["clearance"].min() > 0.05
