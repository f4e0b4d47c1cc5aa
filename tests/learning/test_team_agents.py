"""Agents of teams: what guards them, what they begin as, how they are trained, and where they warn."""

import dataclasses
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
import pytest
from scipy.optimize import linprog

pytest.importorskip("stable_baselines3")

import wayfield  # noqa: F401  registers the ids
from wayfield import policies
from wayfield.envs.crowds.half_planes import shared_half_plane
from wayfield.envs.scenarios.splits import SPLITS, split
from wayfield.envs.tasks.specs import EVERY
from wayfield.envs.team_worlds import Observation
from wayfield.policies.learned.agent import Agent, Network, load_agent
from wayfield.policies.learned.conditions import NewToAgent
from wayfield.policies.learned.residual import Base
from wayfield.policies.pilot import Pilot
from wayfield.policies.trained.ppo import shipped
from wayfield.policies.training.drawn import further
from wayfield.policies.training.learner import PpoLearner, make_worlds
from wayfield.policies.training.measured import conditions
from wayfield.policies.training.presets import PRESETS, overridden
from wayfield.policies.training.run import trained_on

TEAM, PEOPLE = "wayfield/OmniTeam-v0", "wayfield/OmniPeople-v0"
SPEED = 0.6
PRESET = PRESETS["omni_team"]
# by the policy that drives with them: the preset of its agents, and worlds of theirs
SHIPPED = {
    "team_guided": (PRESET, "circle_4/validation", 8),
    "team_scan": (PRESETS["team_scan"], "circle_4/validation", 8),
    "people_free": (PRESETS["people"], "crowdnav_5/validation", 6),
}


def worlds(scenario: str, num_envs: int, env_id: str = TEAM, **kwargs: Any) -> Any:
    asked = {"actuators": "lagged", "num_beams": 72, "max_range": 5.0, "sees": "bodies"} | kwargs
    return gymnasium.make_vec(env_id, num_envs=num_envs, scenario=scenario, **asked)


def driven(policy: Any, env: Any, steps: int) -> np.ndarray[Any, Any]:
    """Returns the poses that robots drive through, step by step."""
    pilot = Pilot(policy, env)
    seen, _ = env.reset(seed=5)
    pilot.reset()
    poses = []
    for _ in range(steps):
        seen, *_ = env.step(pilot.command(seen))
        poses.append(np.atleast_2d(seen)[:, :3].copy())
    return np.array(poses)


def agent_of(env: Any, layers: Any, preset: Any = PRESET) -> Agent:
    """Returns an agent of a preset with a network of these layers."""
    card: dict[str, Any] = {
        "name": "an agent",
        "task": preset.worlds.task,
        "robots": ["omni3"],
        "dt": 0.05,
        "speed": SPEED,
        "env_kwargs": {},
    }
    return Agent(Network.of(layers), preset.features, preset.actions, card, SPEED, preset.base)


def inputs_of(env: Any, preset: Any = PRESET) -> int:
    probe = agent_of(env, [(np.zeros((2, 1), np.float32), np.zeros(2, np.float32))], preset)
    return probe.perception(env.unwrapped.briefing("bodies")).num_inputs


@pytest.mark.parametrize("name", ["omni_team", "people"])
def test_a_network_that_has_learned_nothing_drives_as_its_law_does(name: str) -> None:
    preset = PRESETS[name]
    scenario, num_envs = ("crowdnav_5/validation", 6) if name == "people" else ("circle_4/validation", 8)
    env = worlds(scenario, num_envs, preset.worlds.env_ids[0])
    nothing = [(np.zeros((2, inputs_of(env, preset)), np.float32), np.zeros(2, np.float32))]
    own = driven(agent_of(env, nothing, preset), env, 60)
    law = driven(policies.make(preset.prior.controller), worlds(scenario, num_envs, preset.worlds.env_ids[0]), 60)
    assert np.abs(own - law).max() < 1e-9
    assert np.abs(own[-1] - own[0]).max() > 0.1


def test_further_scenarios_are_proven_and_in_no_split() -> None:
    """So that none is among those that agents are chosen by or tested with; all fit the hull that is asked for."""
    names = {each.name for part in SPLITS for each in split("people", "walking_groups", part)}
    drawn = further("people", "walking_groups", 0.2, 3)
    assert not names & {each.name for each in drawn}
    assert len({each.name for each in drawn}) == 3
    assert all(EVERY["people"].feasible(each) for each in drawn)
    people = PRESETS["people"]
    two = tuple((0.5, kwargs) for _, kwargs in (people.worlds.shares[0], people.worlds.shares[-1]))
    preset = people.changed(further=2, num_envs=48, shares=two, shortest_ways=False)
    met = {len(part.task.scenarios) for part in make_worlds(preset, preset.worlds.env_ids[0]).worlds.parts}
    assert met == {SPLITS["train"] + 2, len(split("people", "all", "train"))}  # of one family, and of all
    with pytest.raises(ValueError, match=r"^further must be 0 where no world is of one family alone, got 5$"):
        PRESETS["path_following"].changed(further=5)


def test_whatever_is_wanted_keeps_the_half_planes_where_they_leave_a_velocity() -> None:
    """Of any moving discs, and so no two who both keep theirs come nearer than their hulls within the horizon."""
    generator = np.random.default_rng(3)
    orca: Any = policies.make("orca_team")
    briefing = worlds("circle_4/validation", 4).unwrapped.briefing("bodies")
    robot_radius = briefing.robot.hull_radius
    reach, feasible_ones, pairs = 2.0 * (robot_radius + orca.margin), 0, 0
    for _ in range(120):
        n = int(generator.integers(2, 7))
        places = generator.uniform(-2.5, 2.5, (n, 2))
        apart = np.hypot(*(places[:, None] - places[None]).transpose(2, 0, 1)) + 10.0 * np.eye(n)
        if apart.min() < reach:
            continue
        velocities = generator.uniform(-0.4, 0.4, (n, 2))
        bodies = np.zeros((n, 10, 7))
        for i in range(n):
            others = [j for j in range(n) if j != i]
            bodies[i, : n - 1, :2] = places[others] - places[i]
            bodies[i, : n - 1, 2:4] = velocities[others]
            bodies[i, : n - 1, 4:] = robot_radius, 1.0, 1.0
        nothing = np.zeros((n, 3))
        seen = Observation(
            nothing, np.column_stack([velocities, np.zeros(n)]), nothing[:, :2], nothing[:, 0], nothing[:, 0],
            bodies, np.full((n, len(briefing.beam_angles)), briefing.max_range),
        )  # fmt: skip
        few = dataclasses.replace(briefing, num_envs=n)
        chosen = orca.keep_clear(seen, few, generator.uniform(-1.0, 1.0, (n, 2)))
        keeps = np.zeros(n, bool)
        for i in range(n):
            lines = np.array(
                [
                    shared_half_plane(*body[:2], reach, tuple(velocities[i]), tuple(body[2:4]), orca.horizon, 0.5, 0.5)
                    for body in bodies[i, : n - 1]
                ]
            )
            # the greatest margin s that a velocity within the disc can have: its polygon lies inside
            angles = np.linspace(0.0, 2.0 * np.pi, 64, endpoint=False)
            sides = np.column_stack([np.cos(angles), np.sin(angles), np.zeros(64)])
            rows = np.vstack([np.column_stack([-lines[:, :2], np.ones(n - 1)]), sides])
            most = np.concatenate([-lines[:, 2], np.full(64, SPEED * np.cos(np.pi / 64))])
            best = linprog([0.0, 0.0, -1.0], rows, most, bounds=[(None, None)] * 3)
            if best.x[2] > 1e-6:
                keeps[i] = True
                assert (lines[:, :2] @ chosen[i, :2] >= lines[:, 2] - 1e-9).all()
            assert np.hypot(*chosen[i, :2]) <= SPEED + 1e-9
        feasible_ones += keeps.sum()
        for i in range(n):
            for j in range(i):
                if keeps[i] and keeps[j]:
                    pairs += 1
                    p, v = places[j] - places[i], chosen[j, :2] - chosen[i, :2]
                    soonest = np.clip(-(p @ v) / max(v @ v, 1e-12), 0.0, orca.horizon)
                    assert np.hypot(*(p + soonest * v)) >= reach - 1e-6
    assert feasible_ones > 200
    assert pairs > 200


def test_a_team_larger_than_those_trained_with_is_said_once_and_a_scan_alone_is_refused() -> None:
    env = worlds("circle_16/validation", 16)
    agent = agent_of(env, [(np.zeros((2, inputs_of(env)), np.float32), np.zeros(2, np.float32))])
    trained = {"actuators": ["lagged"], "disturbances": ["none"], "speeds": [0.6], "beams": [72], "teams": [2, 8]}
    told = dataclasses.replace(agent, card={**agent.card, "trained_on": trained, "name": "one of eight"})
    with pytest.warns(NewToAgent, match="one of eight drives in a team of 16, not 2 to 8"):
        driven(told, env, 1)
    with pytest.raises(TypeError, match='needs bodies; make the environment with sees="bodies"'):
        Pilot(told, worlds("circle_4/validation", 4, sees="scan"))
    with pytest.raises(ValueError, match="num_envs must be a multiple of 8, the robots of a team, got 1001"):
        overridden(PRESET, ["num_envs=1001"])
    with pytest.raises(ValueError, match="guards=true needs reach"):
        overridden(PRESET, ["actions.kind=unicycle"])
    with pytest.raises(ValueError, match="keeps clear by a wanted velocity, got 'vfh_plus'"):
        Base("vfh_plus", {}, 1.0, guards=True)


@pytest.mark.parametrize(
    ("name", "seed", "folder"),
    [
        (name, seed, folder)
        for name, (preset, _, _) in SHIPPED.items()
        for seed, folder in shipped(policies.POLICIES[name].agents_of(preset.worlds.task), "omni3").items()  # type: ignore[attr-defined]
    ],
)
def test_agents_that_ship_say_how_they_were_made_and_drive_alone_as_among_many(
    name: str, seed: int, folder: Path
) -> None:
    preset, scenario, num_envs = SHIPPED[name]
    agent = load_agent(folder)
    assert (agent.features, agent.actions) == (preset.features, preset.actions)
    base = agent.base and dataclasses.replace(agent.base, gains={})
    assert base == preset.base  # its law is that of its training
    card = agent.card
    assert (card["training"]["seed"], card["training"]["steps"]) == (seed, preset.learning.steps)
    assert card["trained_on"] == trained_on(preset)
    assert card["env_kwargs"] == preset.env_kwargs(preset.worlds.validation)
    assert [(each["asked_speed"], each["env_kwargs"]) for each in card["measured"]] == conditions(agent)
    env_id = preset.worlds.env_ids[0]
    many = driven(policies.make(name, seed=seed), worlds(scenario, num_envs, env_id), 40)
    seen = {"actuators": "lagged", "num_beams": 72, "max_range": 5.0, "sees": "bodies"}
    one: Any = gymnasium.make(env_id, scenario=scenario, **seen)
    rows = 4 if preset.worlds.task == "teams" else 1
    assert driven(agent, one, 40).tobytes() == many[:, :rows].tobytes()


def test_agents_among_bodies_need_them() -> None:
    scans = worlds("circle_4/validation", 4, sees="scan")
    for name in ("team_guided", "people_free"):
        with pytest.raises(TypeError, match='needs bodies; make the environment with sees="bodies"'):
            Pilot(policies.make(name), scans)


def test_a_network_may_begin_as_an_agent_that_ships() -> None:
    small = ["num_envs=256", "horizon=2", "batch_size=256"]
    scan = PRESETS["team_scan"]
    few = {"shares": ((1.0, {**scan.worlds.shares[0][1], "scenario": "circle_4/train"}),), "shortest_ways": False}
    learner = PpoLearner(overridden(scan, small).changed(**few), TEAM, 1)
    agent = load_agent(shipped("goal_reaching", "omni3")[1])
    assert all(map(np.array_equal, sum(learner.layers(), ()), sum(agent.network.layers, ())))
    with pytest.raises(ValueError, match=r"hidden must be \[256, 256\], as of the agent .*, got \[64, 64\]"):
        PpoLearner(overridden(scan, [*small, "hidden=64,64"]), TEAM, 1)
    with pytest.raises(ValueError, match=r"features.margin must be 0.03, as of the agent .*, got 0.01$"):
        PpoLearner(overridden(scan, [*small, "robot=omni4"]), TEAM, 1)
    with pytest.raises(ValueError, match="no agent of seed 99 ships for goal_reaching with omni3; there are seeds 0"):
        PpoLearner(overridden(scan, small), TEAM, 99)
    with pytest.raises(ValueError, match=r"begins is .goal_reaching.; .* imitation > 0"):
        overridden(scan, ["imitation=0"])


def test_where_no_agent_ships_a_line_says_so() -> None:
    env = gymnasium.make("wayfield/DiffDriveTeam-v0", scenario="circle_2", sees="bodies")
    env.reset(seed=0)
    with pytest.raises(ValueError, match="no agent of seed 0 ships for teams_guided with p3dx; there are none"):
        Pilot(policies.make("team_guided"), env).reset()
