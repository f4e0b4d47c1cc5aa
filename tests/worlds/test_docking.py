"""Docking: what the task asks, the shortest ways of Reeds and Shepp, and the laws that come to rest at a pose."""

import dataclasses
import itertools
import json
import math
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st
from numpy.typing import NDArray
from oracles.drives import end_of

import wayfield  # noqa: F401  registers the ids
from wayfield import policies
from wayfield.benchmarks.contests.docking import direction_changes
from wayfield.benchmarks.records.trajectory import Trajectory
from wayfield.envs import goal_reaching
from wayfield.envs.robots import ACTUATORS, ROBOTS
from wayfield.envs.scenarios import FAMILIES, TASKS, split
from wayfield.envs.scenarios.docking_families import FARTHEST_START, DockingScenario, manoeuvre
from wayfield.envs.scenarios.obstacles import obstacle_field, wall
from wayfield.envs.tasks.briefing import Briefing
from wayfield.envs.world.geometry import clearance
from wayfield.envs.world.movers import motion_at, turns
from wayfield.envs.world.reeds_shepp import MOST_PIECES, pose_along, shortest_word
from wayfield.policies.learned.perception import DockFeatures
from wayfield.policies.parts.arriving import is_there
from wayfield.policies.pilot import Pilot

DIFF_ID, OMNI_ID = "wayfield/DiffDriveDocking-v0", "wayfield/OmniDocking-v0"
LAWS = ("polar", "smooth_pose", "smooth_pose_backward", "reeds_shepp")
OMNI_LAWS = ("waypoint", "apf_corrected")
ANGLES = st.floats(-math.pi, math.pi)
PLACES = st.floats(-6.0, 6.0)


def written(folder: Path, **fields: Any) -> str:
    file = folder / "my_dock.json"
    file.write_text(json.dumps(fields))
    return str(file)


def env_id(robot: str) -> str:
    return TASKS["docking"].env_id(ROBOTS[robot])


# ---- the task


@pytest.mark.parametrize("robot", ["p3dx", "omni3"])
def test_the_reward_of_docking_follows_from_info(robot: str) -> None:
    env = gymnasium.make(env_id(robot), scenario="wall/test", robot=robot, actuators="lagged")
    pilot = Pilot(policies.make("polar"), env)
    ends = set()
    for k in range(6):
        observation, before = env.reset(seed=k, options={"scenario": k})
        pilot.reset()
        terminated = truncated = False
        while not (terminated or truncated):
            observation, reward, terminated, truncated, info = env.step(pilot.act(observation))
            progress = before["goal_distance"] - info["goal_distance"]
            turned = abs(before["goal_heading_error"]) - abs(info["goal_heading_error"])
            wanted = progress + 0.3 * turned - 0.01 + 5.0 * info["success"] - 5.0 * info["collision"]
            assert reward == pytest.approx(wanted, abs=1e-9)
            assert terminated == (info["success"] or info["collision"])
            before = info
        ends.add(bool(info["success"]))
    assert ends == {True, False}


@pytest.mark.parametrize("robot", ["p3dx", "omni3"])
def test_who_drives_through_the_pose_has_not_docked(tmp_path: Path, robot: str) -> None:
    file = written(tmp_path, dock=[1.0, 0.0, 0.0])
    env: Any = gymnasium.make(env_id(robot), scenario=file, robot=robot)
    env.reset(seed=0)
    ahead = np.zeros(env.action_space.shape, np.float32)
    ahead[0] = 0.4
    nearest = math.inf
    for _ in range(75):
        *_, info = env.step(ahead)
        nearest = min(nearest, info["goal_distance"])
        assert not info["success"]
    assert nearest < 0.05
    for turn in (-0.04, 0.06):  # at rest within the tolerances, and with the heading outside of them
        file = written(tmp_path, dock=[0.04, 0.0, turn])
        env = gymnasium.make(env_id(robot), scenario=file, robot=robot)
        env.reset(seed=0)
        *_, terminated, _, info = env.step(0.0 * ahead)
        assert terminated == info["success"] == (abs(turn) <= 0.05)


@pytest.mark.parametrize("robot", ["p3dx", "omni3"])
@pytest.mark.parametrize(
    ("twist", "rests"),
    [((0.019, 0.0), True), ((0.021, 0.0), False), ((-0.05, 0.0), False), ((0.0, 0.049), True), ((0.0, -0.051), False)],
)
def test_at_rest_is_slower_than_two_centimetres_and_a_twentieth_of_a_radian_a_second(
    tmp_path: Path, robot: str, twist: tuple[float, float], rests: bool
) -> None:
    env: Any = gymnasium.make(env_id(robot), scenario=written(tmp_path, dock=[0.01, 0.0, 0.0]), robot=robot)
    env.reset(seed=0)
    action = np.zeros(env.action_space.shape, np.float32)
    action[0], action[-1] = twist
    *_, terminated, _, info = env.step(action)
    assert terminated == info["success"] == rests


# ---- the families


@pytest.mark.parametrize("family", FAMILIES["docking"])
def test_starts_are_near_and_clear_and_a_way_is_proven(family: str) -> None:
    for scenario in split("docking", family, "test"):
        distance = math.dist(scenario.start[:2], scenario.goal[:2])
        assert 0.3 - 1e-6 <= distance <= FARTHEST_START + 1e-5
        assert clearance(scenario.obstacles, len(scenario.obstacles), *scenario.start[:2]) >= 0.4
        assert (scenario.position_tolerance, scenario.heading_tolerance) == (0.05, 0.05)
        assert scenario.quantity == manoeuvre(scenario) >= distance - 1e-6
        assert scenario.tier == TASKS["docking"].tier(scenario.quantity)


# ---- files of one's own


BOX = {"kind": "box", "x": 0.0, "y": 0.55, "length": 0.6, "width": 0.6}


@pytest.mark.parametrize(
    ("fields", "words"),
    [
        ({}, "exactly one of the fields 'dock' and 'goal' must be given"),
        ({"dock": [0, 0]}, "dock is [0, 0]; it must be 3 numbers (x, y, heading)"),
        ({"dock": [0, 0, 0], "strat": [1, 0, 0]}, "field 'strat' is not known"),
        ({"dock": [0, 0, 0], "obstacles": [{"kind": "bax"}]}, "obstacles[0].kind is 'bax'"),
        (
            {"dock": [0, 0, 0], "start": [2, 0, 0], "obstacles": [{**BOX, "y": 0.54}]},
            "obstacles[0] (box of 0.6 x 0.6 m at (0, 0.54)) is over the goal at (0, 0): clearance 0.24 m for a hull of "
            "radius 0.25 m",
        ),
    ],
)
def test_a_wrong_file_is_refused_by_name_in_one_line(tmp_path: Path, fields: dict[str, Any], words: str) -> None:
    with pytest.raises(ValueError, match=r"my_dock\.json") as refused:
        gymnasium.make(DIFF_ID, scenario=written(tmp_path, **fields))
    assert words in str(refused.value)
    assert "\n" not in str(refused.value)


def test_direction_changes_are_counted_without_creeping() -> None:
    forward = np.array([0.0, 0.3, 0.3, 0.01, -0.01, 0.01, 0.2, -0.2, -0.3, 0.0, 0.1])
    twists = np.column_stack([forward, np.zeros((11, 2))])
    run = Trajectory(times=np.arange(11.0), poses=np.zeros((11, 3)), twists=twists)
    assert direction_changes(run) == 2.0
    assert direction_changes(Trajectory(times=np.arange(2.0), poses=np.zeros((2, 3)))) == 0.0


# ---- Reeds and Shepp


def driven(pieces: list[tuple[int, float]]) -> tuple[float, float, float]:
    """Returns the pose at the end of arcs and straights of radius 1, by complex numbers."""
    place, heading = 0j, 0.0
    for turn, length in pieces:
        if turn:
            centre = place + 1j * turn * np.exp(1j * heading)
            heading += turn * length
            place = centre - 1j * turn * np.exp(1j * heading)
        else:
            place += length * np.exp(1j * heading)
    return place.real, place.imag, heading


@given(PLACES, PLACES, ANGLES)
def test_a_shortest_word_ends_at_its_pose_and_is_its_own_reversal(x: float, y: float, heading: float) -> None:
    word = np.zeros((MOST_PIECES, 2))
    length = shortest_word(x, y, heading, word)
    assert length == pytest.approx(np.abs(word[:, 1]).sum(), abs=1e-12)
    end = driven([(int(turn), along) for turn, along in word])
    assert end[:2] == pytest.approx((x, y), abs=1e-6)
    assert math.remainder(end[2] - heading, 2.0 * math.pi) == pytest.approx(0.0, abs=1e-6)
    assert pose_along(word, 1.0, np.zeros(3), length)[:2] == pytest.approx((x, y), abs=1e-6)
    # the mirror image, and the way back, are as long
    assert shortest_word(x, -y, -heading, word) == pytest.approx(length, abs=1e-6)
    cosine, sine = math.cos(heading), math.sin(heading)
    back = shortest_word(-cosine * x - sine * y, sine * x - cosine * y, -heading, word)
    assert back == pytest.approx(length, abs=1e-6)


@given(st.lists(st.tuples(st.sampled_from([-1, 0, 1]), st.floats(-2.0, 2.0)), min_size=1, max_size=6))
def test_nothing_that_can_be_driven_is_shorter(pieces: list[tuple[int, float]]) -> None:
    x, y, heading = driven(pieces)
    heading = math.remainder(heading, 2.0 * math.pi)
    length = shortest_word(float(x), float(y), heading, np.zeros((MOST_PIECES, 2)))
    assert length <= sum(abs(along) for _, along in pieces) + 1e-6


def test_where_words_meet_rounding_hides_none() -> None:
    """No arc of no length is missed, nor half a turn: a heading off by rounding changes the length by as little."""
    word = np.zeros((MOST_PIECES, 2))
    along = [side * piece for piece in (1.0, 0.25 * math.pi, 0.5 * math.pi, math.pi) for side in (1.0, -1.0)]
    pieces = list(itertools.product((-1, 0, 1), along))
    for way in itertools.product(pieces, pieces):
        x, y, heading = map(float, driven(list(way)))
        length = shortest_word(x, y, heading, word)
        assert length <= sum(abs(piece) for _, piece in way) + 1e-6
        for rounding in (2e-16, -2e-16, 1e-12, -1e-12):
            assert shortest_word(x, y, heading + rounding, word) == pytest.approx(length, abs=1e-6), (way, rounding)


@pytest.mark.slow
def test_a_numeric_search_finds_nothing_shorter() -> None:
    """Random searches over the lengths of five pieces, refined, reach the length of the word and never less."""
    from scipy.optimize import minimize

    rng = np.random.default_rng(0)
    for _ in range(12):
        goal = [*rng.uniform(-3.0, 3.0, 2).tolist(), rng.uniform(-math.pi, math.pi)]
        exact = shortest_word(*goal, np.zeros((MOST_PIECES, 2)))
        best = math.inf
        for _ in range(150):
            turns = [0 if k == 2 and rng.random() < 0.6 else int(rng.choice([-1, 1])) for k in range(5)]

            def misses(lengths: NDArray[np.float64], turns: list[int] = turns, goal: list[float] = goal) -> Any:
                x, y, heading = driven(list(zip(turns, lengths, strict=True)))
                return np.array([x - goal[0], y - goal[1], math.sin(0.5 * (heading - goal[2]))])

            found = minimize(
                lambda lengths: float(np.sqrt(lengths**2 + 1e-8).sum()),
                rng.uniform(-2.0, 2.0, 5),
                constraints={"type": "eq", "fun": misses},
                method="SLSQP",
                options={"maxiter": 200},
            )
            if np.abs(misses(found.x)).max() < 1e-6:
                best = min(best, float(np.abs(found.x).sum()))
        assert best >= exact - 1e-4
        assert best <= exact + 0.02


# ---- the laws


def told(goals: NDArray[np.float64], dt: float = 1e-3) -> Briefing:
    layout = goal_reaching.Observation.layout(2, 0, 5.0, TASKS["docking"])
    return Briefing(len(goals), ROBOTS["p3dx"], ACTUATORS["ideal"], dt, "twist", layout, np.empty(0), 5.0)


def followed(law: Any, start: tuple[float, float, float], seconds: float, dt: float = 1e-3) -> NDArray[np.float64]:
    """Returns the poses (n, 3) of a unicycle that a law drives to the origin."""
    briefing = told(np.zeros((1, 3)), dt)
    memory = law.reset(briefing)
    x, y, heading = start
    poses = [start]
    for _ in range(round(seconds / dt)):
        cosine, sine = math.cos(heading), math.sin(heading)
        goal = np.array([[-cosine * x - sine * y, sine * x - cosine * y]])
        seen = goal_reaching.Observation(
            np.array([[x, y, heading]]), np.zeros((1, 2)), goal, np.array([math.remainder(-heading, 2.0 * math.pi)]),
            np.zeros(1), np.empty((1, 0)),
        )  # fmt: skip
        ((v, w),) = law.act(seen, briefing, memory)
        middle = heading + 0.5 * w * dt
        x, y, heading = x + v * dt * math.cos(middle), y + v * dt * math.sin(middle), heading + w * dt
        poses.append((x, y, heading))
    return np.array(poses)


UNBOUNDED = {"max_speed": 100.0, "max_yaw_rate": 100.0, "deceleration": 1e6, "arrival_radius": 1e-6}


@pytest.mark.parametrize("way", [1.0, -1.0])
def test_on_the_axis_the_polar_law_decays_as_an_exponential(way: float) -> None:
    law = policies.make("polar", **UNBOUNDED)
    poses = followed(law, (-way * 1.0, 0.0, 0.0), 1.5)
    times = 1e-3 * np.arange(len(poses))
    assert np.abs(poses[:, 0]) == pytest.approx(np.exp(-3.0 * times), rel=0.01)
    assert np.abs(poses[:, 1:]).max() < 1e-12


@pytest.mark.parametrize(("k_rho", "k_alpha", "k_beta"), [(3.0, 8.0, -1.5), (1.0, 4.0, -0.5)])
def test_near_the_axis_the_polar_law_decays_by_its_matrix(k_rho: float, k_alpha: float, k_beta: float) -> None:
    law = policies.make("polar", k_rho=k_rho, k_alpha=k_alpha, k_beta=k_beta, **UNBOUNDED)
    heading, y = 0.02, 0.01
    poses = followed(law, (-1.0, y, heading), 1.2 / k_rho)
    sight = np.arctan2(-poses[:, 1], -poses[:, 0])
    found = np.column_stack([sight - poses[:, 2], -sight])  # alpha, beta
    values, vectors = np.linalg.eig(np.array([[k_rho - k_alpha, -k_beta], [-k_rho, 0.0]]))
    parts = np.linalg.solve(vectors, found[0])
    times = 1e-3 * np.arange(len(poses))
    wanted = (vectors @ (parts[:, None] * np.exp(values[:, None] * times))).T
    assert np.abs(found - wanted).max() <= 0.01 * np.abs(found[0]).max()
    assert np.hypot(poses[:, 0], poses[:, 1]) == pytest.approx(
        math.hypot(1.0, y) * np.exp(-k_rho * times), rel=0.01
    )  # fmt: skip


@pytest.mark.parametrize("name", ["polar", "smooth_pose_backward"])
@given(st.floats(0.4, 2.5), st.floats(-1.2, 1.2), st.floats(-1.2, 1.2))
def test_backward_is_forward_in_a_frame_turned_by_half_a_turn(
    name: str, distance: float, side: float, turn: float
) -> None:
    start = (-distance * math.cos(side), -distance * math.sin(side), side + 0.5 * turn)
    there = followed(policies.make(name), start, 1.0, 0.05)
    law = policies.make(name)
    # the same way, seen in a mirror through the origin: robot and pose keep their headings
    back = followed(law, (-start[0], -start[1], start[2]), 1.0, 0.05)
    assert back[:, :2] == pytest.approx(-there[:, :2], abs=1e-9)
    assert back[:, 2] == pytest.approx(there[:, 2], abs=1e-9)


@pytest.mark.parametrize("turn", [-2.0, -0.3, 0.05, 1.2])
def test_the_turn_at_the_pose_ends_as_the_base_can_brake(turn: float) -> None:
    """|w| = min(turn_gain e, sqrt(2 alpha e), max_yaw_rate), with no more alpha than the base has: 1.5 rad/s^2."""
    law = policies.make("polar", yaw_acceleration=5.0, turn_gain=5.0)
    briefing = dataclasses.replace(told(np.zeros((1, 3))), actuators=ACTUATORS["slow"])
    seen = goal_reaching.Observation(
        np.zeros((1, 3)), np.zeros((1, 2)), np.zeros((1, 2)), np.array([turn]), np.zeros(1), np.empty((1, 0))
    )
    ((v, w),) = law.act(seen, briefing, law.reset(briefing))
    assert v == 0.0
    assert w == pytest.approx(math.copysign(min(5.0 * abs(turn), math.sqrt(3.0 * abs(turn)), 1.5), turn))


@given(st.floats(0.0, 0.1), st.floats(-math.pi, math.pi), st.booleans())
def test_who_is_there_stays_there_and_who_is_just_past_it_too(r: float, bearing: float, was_there: bool) -> None:
    """Within a radius; and within a wider one for who was there, or has the pose no longer ahead."""
    x, y = r * math.cos(bearing), r * math.sin(bearing)
    assume(min(abs(math.hypot(x, y) - radius) for radius in (0.03, 0.05)) > 1e-9)
    assert is_there(was_there, x, y, 0.03, 0.05) == (r < 0.03 or (r < 0.05 and (was_there or x <= 0.0)))


@pytest.mark.parametrize(
    ("gains", "words"),
    [
        ({"k_beta": 0.5}, "k_beta must be a finite number < 0, got 0.5"),
        ({"k_alpha": 2.0}, "k_alpha must be a finite number > k_rho = 3, got 2.0"),
        ({"k_rho": 0.0}, "k_rho must be a finite number > 0"),
    ],
)
def test_gains_with_which_the_polar_law_diverges_are_refused(gains: dict[str, float], words: str) -> None:
    with pytest.raises(ValueError, match=words):
        policies.make("polar", **gains)


def reached(
    name: str, robot: str, family: str, actuators: str, count: int, monkeypatch: pytest.MonkeyPatch, num_beams: int = 8
) -> NDArray[np.bool_]:
    """Returns which of many scenarios of a family, of seeds of no split, end in success."""
    hull = ROBOTS[robot].hull_radius
    bank = tuple(FAMILIES["docking"][family].make(5_000_000 + k).fitted(0.3 - hull) for k in range(count))
    return docked(name, robot, actuators, bank, monkeypatch, num_beams)[0]


def docked(
    name: str, robot: str, actuators: str, bank: tuple[Any, ...], monkeypatch: pytest.MonkeyPatch, num_beams: int = 8
) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
    """Returns which scenarios of a bank end in success, and which in a collision."""
    count = len(bank)
    monkeypatch.setattr(goal_reaching, "field_scenarios", lambda *_: bank)
    env: Any = gymnasium.make_vec(
        env_id(robot), count, vectorization_mode="vector_entry_point", robot=robot, actuators=actuators,
        num_beams=num_beams,
    )  # fmt: skip
    observations, _ = env.reset(seed=0, options={"scenario": list(range(count))})
    pilot = Pilot(policies.make(name), env)
    pilot.reset()
    done, won, touched = (np.zeros(count, np.bool_) for _ in range(3))
    for _ in range(1200):
        observations, _, terminated, truncated, info = env.step(pilot.act(observations))
        won |= ~done & info["success"]
        touched |= ~done & info["collision"]
        done |= terminated | truncated
        if done.all():
            break
    return won, touched


# each law from both families and with both kinds of actuators; all four together in the slow part
DOCKERS = [*((name, "p3dx") for name in LAWS), *((name, "omni3") for name in OMNI_LAWS)]
STARTS = [
    pytest.param(*docker, family, actuators, marks=[] if (k + f + a) % 2 == 0 else pytest.mark.slow)
    for k, docker in enumerate(DOCKERS)
    for f, family in enumerate(("open", "behind"))
    for a, actuators in enumerate(("ideal", "lagged"))
]


@pytest.mark.parametrize(("name", "robot", "family", "actuators"), STARTS)
def test_random_starts_all_end_in_the_pose(
    name: str, robot: str, family: str, actuators: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    assert reached(name, robot, family, actuators, 300, monkeypatch).all()


def around_a_pose(directions: int, tolerances: tuple[float, ...]) -> tuple[DockingScenario, ...]:
    """Returns starts beside, before and behind a pose in as many directions, with as many headings, at rising distance.

    Each has one of the tolerances, m and rad.
    """
    angles = [math.remainder(2.0 * math.pi * k / directions, 2.0 * math.pi) for k in range(directions)]
    starts = [(r * math.cos(at), r * math.sin(at), turn)
              for r, at, turn in itertools.product((0.01, 0.06, 0.2, 0.5, 1.2), angles, angles)]  # fmt: skip
    return tuple(
        DockingScenario(f"around_{k}", goal=(0.0, 0.0, 0.0), start=start, position_tolerance=near,
                        heading_tolerance=min(near, 0.05))
        for k, start in enumerate(starts) for near in (tolerances[k // directions % len(tolerances)],)
    )  # fmt: skip


TO_A_POSE = ("polar", "smooth_pose", "smooth_pose_backward", "mpc_pose", "reeds_shepp", "reeds_shepp_scan",
             "apf_corrected", "astar_tracker", "scan_planner")  # fmt: skip


@pytest.mark.parametrize("name", [*TO_A_POSE, "waypoint"])
def test_every_law_docks_from_all_around_as_near_as_the_task_asks(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    bank = around_a_pose(4, (0.05, 0.005, 0.1))
    won, _ = docked(name, "omni3" if name == "waypoint" else "p3dx", "lagged", bank, monkeypatch)
    assert won.all(), [bank[k] for k in np.flatnonzero(~won)]


@pytest.mark.slow
@pytest.mark.parametrize("actuators", ["ideal", "lagged", "slow"])
@pytest.mark.parametrize("robot", sorted(ROBOTS))
@pytest.mark.parametrize("name", [*TO_A_POSE, "waypoint"])
def test_every_robot_docks_from_all_around(
    name: str, robot: str, actuators: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    if name != "waypoint" or ROBOTS[robot].holonomic:
        for tolerances in ((0.05, 0.1, 0.02), (0.01, 0.005, 0.02)):
            bank = around_a_pose(8, tolerances)
            won, _ = docked(name, robot, actuators, bank, monkeypatch)
            assert won.all(), [bank[k] for k in np.flatnonzero(~won)]


@pytest.mark.slow
@pytest.mark.parametrize("family", ["open", "behind"])
@pytest.mark.parametrize("actuators", ["ideal", "lagged"])
def test_predicted_ways_from_many_starts_all_end_in_the_pose(
    family: str, actuators: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    assert reached("mpc_pose", "p3dx", family, actuators, 1000, monkeypatch).all()


@pytest.mark.parametrize(("family", "least"), [("wall", 1.0), ("berth", 0.97), ("moving", 0.94)])
def test_the_planner_docks_where_laws_without_a_map_touch(
    family: str, least: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    planned = reached("reeds_shepp", "p3dx", family, "lagged", 100, monkeypatch).mean()
    assert planned >= least
    assert reached("polar", "p3dx", family, "lagged", 100, monkeypatch).mean() < planned


@pytest.mark.parametrize(("actuators", "least"), [("lagged", 0.98), ("slow", 0.9)])
def test_with_the_map_it_docks_past_what_moves_and_touches_nothing(
    actuators: str, least: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    bank = tuple(FAMILIES["docking"]["moving"].make(5_000_000 + k).fitted(0.05) for k in range(100))
    won, touched = docked("reeds_shepp", "p3dx", actuators, bank, monkeypatch)
    assert won.mean() >= least
    assert not touched.any()


def test_with_the_map_it_stands_where_no_way_is_free(monkeypatch: pytest.MonkeyPatch) -> None:
    corners = [(0.6, 0.6), (-0.6, 0.6), (-0.6, -0.6), (0.6, -0.6), (0.6, 0.6)]
    walls = obstacle_field(*(wall(*a, *b) for a, b in itertools.pairwise(corners)))
    bank = (DockingScenario("shut", goal=(0.0, 0.0, 0.0), start=(1.5, 0.5, 0.0), obstacles=walls),)
    won, touched = docked("reeds_shepp", "p3dx", "lagged", bank, monkeypatch)
    assert not won.any()
    assert not touched.any()


@pytest.mark.parametrize("robot", ["p3dx", "omni4"])
@pytest.mark.parametrize("family", ["open", "behind", "wall", "berth", "moving"])
def test_by_the_scan_it_docks_from_anywhere_and_where_laws_that_see_nothing_touch(
    robot: str, family: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    seen = reached("reeds_shepp_scan", robot, family, "lagged", 60, monkeypatch, 72).mean()
    blind = reached("polar", robot, family, "lagged", 60, monkeypatch).mean()
    assert seen == 1.0 if family in ("open", "behind") else seen > blind


@pytest.mark.parametrize(
    ("robot", "actuators", "least", "most"), [("p3dx", "lagged", 0.92, 0.06), ("omni3", "slow", 0.8, 0.15)]
)
def test_by_the_scan_it_waits_for_what_moves(
    robot: str, actuators: str, least: float, most: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    hull = ROBOTS[robot].hull_radius
    bank = tuple(FAMILIES["docking"]["moving"].make(5_000_000 + k).fitted(0.3 - hull) for k in range(100))
    won, touched = docked("reeds_shepp_scan", robot, actuators, bank, monkeypatch, 72)
    assert won.mean() >= least
    assert touched.mean() <= most


@pytest.mark.parametrize("family", ["wall", "berth", "moving"])
def test_what_moves_is_told_from_what_stands_and_its_lane_is_found(
    family: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Nothing that stands ever counts as moving; a disc is followed within 0.1 m, and turns where it was seen to."""
    bank = tuple(FAMILIES["docking"][family].make(5_000_000 + k).fitted(0.05) for k in range(60))
    monkeypatch.setattr(goal_reaching, "field_scenarios", lambda *_: bank)
    env: Any = gymnasium.make_vec(
        DIFF_ID, len(bank), vectorization_mode="vector_entry_point", actuators="lagged", num_beams=72, max_range=5.0
    )
    seen, _ = env.reset(seed=0, options={"scenario": list(range(len(bank)))})
    pilot = Pilot(policies.make("reeds_shepp_scan"), env)
    pilot.reset()
    done = np.zeros(len(bank), np.bool_)
    found = set()
    for step in range(400):
        actions = pilot.act(seen)
        tracks = pilot.memory["state"]["tracks"]
        for i, k in np.argwhere((tracks["moves"] == 1.0) & (tracks["radius"] > 0.0) & ~done[:, None]):
            assert family == "moving"
            track, disc = tracks[i, k], bank[i].obstacles[0]
            found.add(i)
            if track["unseen"] == 0.0:
                assert math.dist(track["place"], motion_at(disc, 0.05 * step)[:2]) < 0.1
            if track["turns"] > 1.0:
                ends = np.sort(turns(bank[i].obstacles)[0], axis=0)
                assert np.abs(np.sort(track["ends"], axis=0) - ends).max() < 0.1
        seen, _, terminated, truncated, _ = env.step(actions)
        done |= terminated | truncated
    assert len(found) == (len(bank) if family == "moving" else 0)


@pytest.mark.parametrize("family", ["wall", "berth"])
def test_a_base_that_answers_late_docks_as_a_prompt_one(family: str, monkeypatch: pytest.MonkeyPatch) -> None:
    late, prompt = (reached("reeds_shepp", "p3dx", family, each, 60, monkeypatch).mean() for each in ("slow", "lagged"))
    assert late >= prompt - 0.02


def end_by_the_scan(folder: Path, steps: int = 1200, **fields: Any) -> dict[str, Any]:
    """Returns the last info of an episode that `reeds_shepp_scan` drives with the P3DX."""
    env: Any = gymnasium.make(
        DIFF_ID, scenario=written(folder, **fields), actuators="lagged", num_beams=72, max_episode_steps=steps
    )
    return end_of(env, Pilot(policies.make("reeds_shepp_scan"), env))


@pytest.mark.parametrize("start", [(1.4, 0.6, 2.0), (0.3, 1.6, -0.4), (-1.5, -0.8, 1.0)])
def test_by_the_scan_it_docks_with_gaps_of_two_centimetres(start: tuple[float, float, float], tmp_path: Path) -> None:
    aside = ROBOTS["p3dx"].hull_radius + 0.02 + 0.25
    boxes = [{"kind": "box", "x": 0, "y": y, "length": 0.8, "width": 0.5} for y in (aside, -aside)]
    assert end_by_the_scan(tmp_path, dock=[0, 0, 0], start=start, obstacles=boxes)["success"]


def test_by_the_scan_it_stands_where_no_way_is_free(tmp_path: Path) -> None:
    corners = [(0.6, 0.6), (-0.6, 0.6), (-0.6, -0.6), (0.6, -0.6), (0.6, 0.6)]
    walls = [{"kind": "wall", "x1": a, "y1": b, "x2": c, "y2": d} for (a, b), (c, d) in itertools.pairwise(corners)]
    info = end_by_the_scan(tmp_path, 300, dock=[0, 0, 0], start=[1.5, 0.5, 0], obstacles=walls)
    assert not info["collision"]
    assert info["goal_distance"] > 0.6


# ---- agents


def seen_from(goal: tuple[float, float], turn: float, ranges: NDArray[np.float64]) -> goal_reaching.Observation:
    """Returns what one standing robot observes of a pose in its frame."""
    return goal_reaching.Observation(
        np.zeros((1, 3)), np.zeros((1, 2)), np.array([goal]), np.array([turn]), np.zeros(1), ranges[None]
    )


@given(PLACES, PLACES, ANGLES)
def test_a_mirrored_dock_is_seen_mirrored(x: float, y: float, turn: float) -> None:
    features, away = DockFeatures(), np.full(72, 5.0)
    out = np.empty((2, features.width(2)), np.float32)
    for k, side in enumerate((1.0, -1.0)):
        features.observe(seen_from((x, side * y), side * turn, away), np.ones(1), out[k : k + 1])
    signs = np.array([1.0, -1.0, -1.0, 1.0, -1.0])
    np.testing.assert_allclose(out[1, -5:], signs * out[0, -5:], atol=1e-6)
    np.testing.assert_allclose(np.sinh(out[0, -5:-3]), np.array([x, y]) / features.fine, rtol=1e-4, atol=1e-5)


@pytest.mark.parametrize("way", [1.0, -1.0])
def test_the_guard_holds_backward_as_forward(way: float) -> None:
    """Towards a wall on the side that it drives to, a robot slows to what stops; away from it, it does not."""
    features, base = DockFeatures(), ACTUATORS["lagged"]
    angles = np.arange(72) * 2.0 * math.pi / 72 - math.pi
    room = 0.4
    towards = np.maximum(way * np.cos(angles), 1e-9)
    ranges = np.minimum((features.hull_radius + room) / towards, 5.0)
    for v in (0.6 * way, -0.6 * way):
        twists = features.guarded(seen_from((3.0, 0.0), 0.0, ranges), np.array([[v, 0.0]]), 0.6, base)
        speed = abs(twists[0, 0])
        if v * way > 0.0:
            braking, reaction = 0.7 * min(1.0, base.acceleration / 1.0), max(0.2, base.lag + 0.1)
            assert speed * reaction + speed * speed / (2.0 * braking) <= room
            assert twists[0, 0] * way > 0.0
        else:
            assert twists[0, 0] == v
