"""One agent for every robot: what it sees of a sheet, that it begins as its planner, and what it says of itself."""

import dataclasses
import json
import math
import warnings
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
import pytest

from wayfield.envs.robots import FULL_TURN, ROBOTS, Sensors
from wayfield.envs.tasks.briefing import Briefing
from wayfield.policies import Pilot, Shielded, make
from wayfield.policies.learned.agent import Agent, Network, load_agent, save_agent, weights_digest
from wayfield.policies.learned.conditions import NewToAgent
from wayfield.policies.learned.features_sheet import SHEET, SheetFeatures, numbers_of, windows
from wayfield.policies.learned.perception import Actions, Perception
from wayfield.policies.learned.residual import Base
from wayfield.policies.parts.tuned import tuned_gains
from wayfield.policies.trained.any_robot import AnyRobot
from wayfield.policies.training.drawn import RANGES, draw_robots, robot_like

GOALS = {2: "wayfield/DiffDriveGoalObstacles-v0", 3: "wayfield/OmniGoalObstacles-v0"}
WIDE = {name: [0.0, 1e6] for name in SHEET}


def described(num_twist: int, ranges: dict[str, Any]) -> tuple[list[Any], dict[str, Any]]:
    """Returns the layers of a network that has learned nothing, and the card of its agent."""
    features, actions = SheetFeatures(), Actions("unicycle" if num_twist == 2 else "planar")
    inputs = Perception(features, actions, num_twist, 0.05, True).num_inputs
    layers = [(np.zeros((2, inputs), np.float32), np.zeros(2, np.float32))]
    card = {
        "name": "any, seed 0", "env_id": GOALS[num_twist], "env_kwargs": {}, "task": "goal_reaching",
        "robots": ["any base"], "dt": 0.05, "speed": 0.6, "features": dataclasses.asdict(features),
        "actions": dataclasses.asdict(actions), "base": dataclasses.asdict(Base("scan_planner", {}, 0.7)),
        "network": {"hidden": [], "activation": "tanh", "num_twist": num_twist, "parameters": 2 * inputs + 2},
        "sha256": weights_digest(layers), "training": {"steps": 1},
        "trained_on": {"ranges": ranges, "robots": 2, "disturbances": ["none"]},
    }  # fmt: skip
    return layers, card


def drive_alike(env: Any, pilots: list[Pilot], steps: int) -> None:
    """Asserts that both pilots command the same, bit for bit."""
    observation, _ = env.reset(seed=1)
    for pilot in pilots:
        pilot.reset()
    for _ in range(steps):
        ours, theirs = (pilot.act(observation) for pilot in pilots)
        assert np.array_equal(ours, theirs)
        observation, *_ = env.step(ours)


def untrained(tmp_path: Path, num_twist: int, ranges: dict[str, Any] = WIDE, **gains: Any) -> Agent:
    """Returns an agent that adds nothing, as it is read from its folder."""
    save_agent(tmp_path / "agent", *described(num_twist, ranges))
    return load_agent(tmp_path / "agent", **gains)


@pytest.mark.parametrize("robot", ["turtlebot3", "jackal", "mecanum4"])
def test_an_agent_that_has_learned_nothing_drives_as_its_planner_behind_the_shield(robot: str, tmp_path: Path) -> None:
    base, speed = ROBOTS[robot], 0.2
    env = gymnasium.make_vec(GOALS[len(base.twist_axes)], 4, scenario="discs", robot=robot, actuators="lagged")
    agent = untrained(tmp_path, len(base.twist_axes), speed=speed)
    pilots = [Pilot(each, env) for each in (agent, Shielded(make("scan_planner", max_speed=speed)))]
    drive_alike(env, pilots, 100)


def test_scans_of_any_count_and_view_are_read_by_direction() -> None:
    around = np.linspace(-math.pi, math.pi, 72, endpoint=False)
    beams, looked = windows(around, 72)
    assert beams.tolist() == [[k] for k in range(72)]
    assert looked.all()
    dense, _ = windows(np.linspace(-math.pi, math.pi, 720, endpoint=False), 72)
    assert all(set(range(10 * k - 4, 10 * k + 5)) <= {(b + 360) % 720 - 360 for b in row} | set(row)
               for k, row in enumerate(dense.tolist()) if 0 < k < 36)  # fmt: skip
    sparse, looked = windows(np.linspace(-math.pi, math.pi, 32, endpoint=False), 72)
    assert looked.all()
    assert set(sparse.ravel().tolist()) == set(range(32))
    _, looked = windows(np.linspace(-0.75 * math.pi, 0.75 * math.pi, 271), 72)
    assert looked.sum() == pytest.approx(0.75 * 72, abs=2)
    assert not looked[0]  # behind


def briefed(robot: Any, **kwargs: Any) -> Any:
    """Returns a briefing of a robot in the open."""
    env: Any = gymnasium.make(GOALS[len(robot.twist_axes)], scenario="open_field", robot=robot, **kwargs).unwrapped
    env.reset(seed=0)
    return env.briefing("sensors")


def test_the_stopping_way_is_that_of_the_data_sheet() -> None:
    robot = robot_like("mine", False, 0.2, 1.0, 2.0, 0.8, 2.4, 0.15, Sensors(120, 8.0, FULL_TURN))
    told = numbers_of(briefed(robot, actuators="lagged"), 0.6)
    assert told["stopping_way"] == pytest.approx(0.6 * 0.15 + 0.36 / 1.6)
    assert (told["hull"], told["speed"], told["range"]) == (0.2, 0.6, 8.0)
    assert told["beams"] == pytest.approx(120.0)
    assert told["yaw_rate"] == pytest.approx(1.9)


def test_a_robot_beyond_the_ranges_is_told_of_with_the_number(tmp_path: Path) -> None:
    ranges = {**WIDE, "hull": [0.1, 0.2]}
    agent = untrained(tmp_path, 2, ranges)
    with pytest.warns(NewToAgent, match=r"p3dx with hull 0.25 m, not 0.1 to 0.2, .*; nearest to that, nothing was"):
        agent.reset(briefed(ROBOTS["p3dx"]))
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        agent.reset(briefed(ROBOTS["turtlebot3"]))
        # as dense as the network can tell, and denser
        dense = untrained(tmp_path, 2, {**WIDE, "beams": [32.0, 400.0], "range": [3.0, 30.0]})
        dense.reset(briefed(ROBOTS["turtlebot3"], num_beams=1081, field_of_view=4.712, max_range=60.0))


def test_what_was_measured_nearest_is_told_with_its_robot(tmp_path: Path) -> None:
    layers, card = described(2, {**WIDE, "hull": [0.1, 0.21]})  # a line is told once
    card["measured"] = [
        {
            "asked_speed": speed,
            "env_kwargs": {"actuators": "lagged", "num_beams": 72},
            "success": share,
            "collision": 0.0,
        }
        for speed, share in ((0.6, 0.9), (0.3, 0.8))
    ]
    save_agent(tmp_path / "agent", layers, card)
    with pytest.warns(NewToAgent, match=r"nearest to that, 80 % .* \(the default robot, lagged, 0.3 m/s, 72 beams\)"):
        load_agent(tmp_path / "agent", speed=0.3).reset(briefed(ROBOTS["p3dx"], actuators="lagged"))


def test_a_scan_of_too_few_beams_or_too_narrow_is_refused(tmp_path: Path) -> None:
    agent = untrained(tmp_path, 2)
    for seen, told in (({"num_beams": 20}, "got 20 over 360"), ({"field_of_view": 2.0}, "got 32 over 118")):
        with pytest.raises(ValueError, match=rf"needs a scan of at least 32 beams over 180 degrees or more, {told}"):
            agent.reset(briefed(ROBOTS["p3dx"], **seen))


@pytest.mark.parametrize("broken", [{"hull": [0.2, 0.1]}, {"hull": [0.1]}, {"mass": [1.0, 2.0]}])
def test_a_card_with_ranges_that_cannot_be_is_refused(broken: dict[str, Any], tmp_path: Path) -> None:
    with pytest.raises(ValueError, match=r"trained_on\.ranges must be least and most of speed, yaw_rate"):
        untrained(tmp_path, 2, {**WIDE, **broken})


@pytest.mark.parametrize("holonomic", [False, True])
def test_drawn_robots_lie_in_the_ranges_and_their_scenes_have_room_for_them(holonomic: bool) -> None:
    drawn = draw_robots(6, holonomic)
    assert [each.robot for each in drawn] == [each.robot for each in draw_robots(6, holonomic)]
    for each in drawn:
        robot = each.robot
        for name, value in (("hull", robot.hull_radius), ("speed", each.speed), ("lag", robot.lag)):
            assert RANGES[name][0] <= value <= RANGES[name][1]
        assert each.speed < 0.95 * robot.max_twist[0]
        env = gymnasium.make(GOALS[len(robot.twist_axes)], **each.kwargs)  # refuses a scene without room
        env.close()


@pytest.mark.slow
def test_a_run_on_drawn_robots_goes_on_bit_for_bit() -> None:
    pytest.importorskip("stable_baselines3")
    from wayfield.policies.training.learner import PpoLearner
    from wayfield.policies.training.presets import PRESETS, overridden
    from wayfield.policies.training.run import trained_on

    small = ["drawn=4", "num_envs=16", "horizon=24", "steps=768", "hidden=8", "time_limit=30", "imitation=384"]
    preset = overridden(PRESETS["any_diff_drive_goal"], small)
    first, second = (PpoLearner(preset, preset.worlds.env_ids[0], 0) for _ in range(2))
    first.update()
    state = first.state()
    expected = [first.update() for _ in range(2)]
    second.restore(*state)  # the libraries' own generators too, which both draw from
    assert [second.update() for _ in range(2)] == expected
    assert all(np.array_equal(a, b) for a, b in zip(first.layers()[0], second.layers()[0], strict=True))
    ranges = trained_on(preset, first.env.briefings)["ranges"]
    paces = [pace for _, _, pace in preset.parts]
    assert ranges["speed"] == [pytest.approx(min(paces)), pytest.approx(max(paces))]


def test_where_no_agent_can_drive_the_planner_does_behind_the_shield() -> None:
    """An omni base, for which none ships, and a scan of too few beams; by gains of its own, and by tuned ones."""
    for robot, seen, speed, planned in (
        ("mecanum4", {}, 0.4, 0.0),
        ("p3dx", {"num_beams": 20}, 0.4, 0.0),
        ("p3dx", {"num_beams": 20}, 0.4, 0.6),
        ("turtlebot3", {"num_beams": 20}, 0.95 * 0.22, 0.0),
    ):
        gains = tuned_gains("scan_planner", "goal-obstacles", robot, planned) if planned else {}
        env = gymnasium.make_vec(GOALS[len(ROBOTS[robot].twist_axes)], 2, scenario="discs", robot=robot, **seen)
        planner = make("scan_planner", **{**gains, "max_speed": speed})
        ours = make("any_robot", speed=0.4, planned=planned)
        drive_alike(env, [Pilot(each, env) for each in (ours, Shielded(planner))], 20)


@pytest.mark.parametrize("robot", ["kobuki", "jackal"])
@pytest.mark.parametrize("ahead", [0.0, 1.2])
def test_robots_of_one_world_drive_as_each_alone(robot: str, ahead: float) -> None:
    """By the agent that ships for all, below the planner and without it."""
    many = gymnasium.make_vec(GOALS[2], 3, scenario="discs", robot=robot, actuators="lagged", num_beams=72)
    alone = gymnasium.make_vec(GOALS[2], 1, scenario="discs", robot=robot, actuators="lagged", num_beams=72)
    pilots = [Pilot(make("any_robot", ahead=ahead), env) for env in (many, alone)]
    seen, one = (env.reset(seed=4)[0] for env in (many, alone))
    for pilot in pilots:
        pilot.reset()
    for _ in range(60):
        twists, twist = pilots[0].act(seen), pilots[1].act(one)
        assert np.array_equal(twists[0], twist[0])
        seen, one = many.step(twists)[0], alone.step(twist)[0]


class Standing(AnyRobot):
    """One whose agent stands still, whatever it sees."""

    def agent(self, briefing: Briefing) -> Agent:
        agent = super().agent(briefing)
        inputs, back = int(agent.network.sizes[0]), agent.actions.reverse
        nothing = np.array([(back - 1.0) / (back + 1.0), 0.0], np.float32)
        still = Network.of([(np.zeros((2, inputs), np.float32), nothing)])
        return dataclasses.replace(agent, network=still)


def moved(policy: AnyRobot, folder: Path, seconds: float, robot: str = "kobuki", **scene: Any) -> list[float]:
    """Returns how far (m) from its start the robot is at each second, facing along x, until it arrives."""
    (folder / "scene.json").write_text(json.dumps({"start": [0, 0, 0], "heading_tolerance": math.pi, **scene}))
    env: Any = gymnasium.make(
        GOALS[2], robot=robot, scenario=str(folder / "scene.json"), num_beams=72, actuators="lagged"
    )
    seen, _ = env.reset(seed=0)
    pilot = Pilot(policy, env)
    pilot.reset()
    away = []
    for k in range(round(20 * seconds)):
        seen, _, terminated, _, _ = env.step(pilot.act(seen))
        if k % 20 == 19 or terminated:
            away.append(math.hypot(*(float(env.unwrapped.batch.states[axis][0]) for axis in ("x", "y"))))
        if terminated:
            break
    return away


def test_the_planner_drives_once_the_agent_has_made_no_way_for_its_patience(tmp_path: Path) -> None:
    for patience, speed, stands in ((2.0, 0.6, 2), (4.0, 0.6, 4), (2.0, 0.3, 4)):
        away = moved(Standing(patience=patience, speed=speed), tmp_path, 20.0, goal=[2.0, 1.0, 0.0])
        assert max(away[:stands]) < 1e-3 < away[stands + 1]
        assert away[-1] == pytest.approx(math.hypot(2.0, 1.0), abs=0.2)
        assert len(away) < 20
    assert max(moved(Standing(patience=0.0), tmp_path, 10.0, goal=[2.0, 1.0, 0.0])) < 1e-3


def test_the_agent_drives_as_long_as_something_comes_nearer(tmp_path: Path) -> None:
    """A disc that comes for five seconds and goes away for five; but not above a planner that foresees no motion."""
    patrol = {"vx": -0.4, "vy": 0.0, "leg_time": 5.0}
    disc = {"kind": "circle", "x": 3.5, "y": 0.0, "radius": 0.5, "patrol": patrol}
    scene: dict[str, Any] = {"goal": [0.0, 4.0, 0.0], "obstacles": [disc]}
    away = moved(Standing(patience=1.0), tmp_path, 9.0, **scene)
    assert max(away[:5]) < 1e-3 < away[8]
    assert moved(Standing(patience=1.0, planned=1.2), tmp_path, 5.0, "jackal", **scene)[4] > 1.0
