"""Several robots in one world: what must stay as it was, what no order decides, and who ends when."""

import dataclasses
import pickle
from typing import Any

import gymnasium
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env

import wayfield  # noqa: F401  registers the environments
from wayfield import policies
from wayfield.envs.crowds.bodies import ROBOT
from wayfield.envs.crowds.people import GOES_ON, MOUSSAID, ORCA, REPLAY, stroll
from wayfield.envs.robots import ROBOTS
from wayfield.envs.scenarios.obstacles import box, obstacle_field
from wayfield.envs.scenarios.people_families import tracks_of, walks_of
from wayfield.envs.scenarios.team_families import TEAM_FAMILIES
from wayfield.envs.scenarios.team_scenario import TeamScenario
from wayfield.envs.world.geometry import OBSTACLE
from wayfield.policies.pilot import Pilot

DIFF, OMNI = "wayfield/DiffDriveTeam-v0", "wayfield/OmniTeam-v0"
ALONE = {DIFF: "wayfield/DiffDriveGoalObstacles-v0", OMNI: "wayfield/OmniGoalObstacles-v0"}


def actions_of(env: Any, rng: np.random.Generator) -> Any:
    space = env.action_space
    drawn = rng.uniform(-1.0, 1.0, space.shape) * space.high
    drawn[..., 0] = np.abs(drawn[..., 0])
    return drawn


def driven(env: Any, steps: int, seed: int = 0) -> list[bytes]:
    """Returns the bits of all that an environment says in some steps."""
    rng = np.random.default_rng(seed)
    said = [env.reset(seed=seed)[0].tobytes()]
    for _ in range(steps):
        observation, reward, terminated, truncated, info = env.step(actions_of(env, rng))
        said.append(observation.tobytes() + np.asarray([reward, terminated, truncated], object).astype(float).tobytes())
        said += [np.asarray(info[name]).tobytes() for name in ("gap", "collision", "success", "touched")]
    return said


@pytest.mark.parametrize("env_id", ALONE)
@pytest.mark.parametrize("options", [{}, {"noise": 1.0, "scenario": "moving_crossing"}, {"disturbance": "moderate"}])
def test_a_team_of_one_among_nobody_is_goal_reaching(env_id: str, options: dict[str, Any]) -> None:
    keywords = {"scenario": "discs"} | options
    team, robot = gymnasium.make(env_id, **keywords), gymnasium.make(ALONE[env_id], **keywords)
    for seed in range(2):
        mine, its = team.reset(seed=seed), robot.reset(seed=seed)
        assert mine[0].tobytes() == its[0].tobytes()
        rng = np.random.default_rng(seed)
        for _ in range(80):
            action = actions_of(team, rng)
            mine, its = team.step(action), robot.step(action)
            assert mine[0].tobytes() == its[0].tobytes()
            assert mine[1:4] == its[1:4]
            assert {name: mine[4][name] for name in its[4]} == its[4]
            if mine[2]:
                break


def test_a_world_of_a_batch_is_the_single_world_of_its_seed() -> None:
    worlds = gymnasium.make_vec(DIFF, num_envs=12, scenario="circle_4", noise=1.0)
    rng = np.random.default_rng(0)
    seen, _ = worlds.reset(seed=5)
    actions = [actions_of(worlds, rng) for _ in range(150)]
    outputs = [worlds.step(action) for action in actions]
    for w in range(3):
        world = gymnasium.make(DIFF, scenario="circle_4", noise=1.0)
        assert world.reset(seed=5 + w)[0].tobytes() == seen[4 * w : 4 * w + 4].tobytes()
        for action, (observations, rewards, _, _, info) in zip(actions, outputs, strict=True):
            part = slice(4 * w, 4 * w + 4)
            observation, reward, terminated, _, told = world.step(action[part])
            assert observation.tobytes() == observations[part].tobytes()
            assert told["gap"].tobytes() == info["gap"][part].tobytes()
            took_part = told["alive"]
            assert reward == (rewards[part][took_part].mean() if took_part.any() else 0.0)
            if terminated:
                break


@pytest.mark.parametrize("ends", ["leave", "respawn"])
def test_threads_change_no_bit(ends: str) -> None:
    said = [
        driven(gymnasium.make_vec(OMNI, num_envs=160, scenario="circle_8", num_threads=k, ends=ends, noise=0.5), 60)
        for k in (1, 3)
    ]
    assert said[0] == said[1]


def crowded(cells_from: int, order: Any = None) -> tuple[Any, Any]:
    """Returns a world of 60 robots in an open field, and where they stand after some steps."""
    scenario = TEAM_FAMILIES["open_100"].make(3)
    robots = scenario.robots[:60]
    order = np.arange(60) if order is None else order
    moved = TeamScenario("crowd", tuple(robots[k] for k in order))
    env: Any = gymnasium.make(OMNI, scenario=moved, robot="omni4", sees="bodies", num_beams=16).unwrapped
    env.task.params["cells_from"] = cells_from
    seen, _ = env.reset(seed=0)
    rng = np.random.default_rng(1)
    out = [seen]
    for _ in range(40):
        drive = rng.uniform(-1.0, 1.0, (60, 3)) * 0.5
        observation, _, _, _, info = env.step(drive[order])
        out += [observation, info["gap"][:, None], info["collision"][:, None]]
    return env, out


def test_cells_and_all_pairs_and_any_numbering_give_the_same_bits() -> None:
    _, by_cells = crowded(1)
    _, by_pairs = crowded(1000)
    order = np.random.default_rng(7).permutation(60)
    _, renumbered = crowded(1, order)
    for a, b, c in zip(by_cells, by_pairs, renumbered, strict=True):
        assert a.tobytes() == b.tobytes()
        assert a[order].tobytes() == c.tobytes()


def turned(x: Any, y: Any, hand: float, quarters: int) -> tuple[Any, Any]:
    """Returns x and y mirrored at the x axis by hand -1, then turned left by quarters."""
    y = hand * y
    for _ in range(quarters):
        x, y = -y, x
    return x, y


def mingled(hand: float, quarters: int) -> TeamScenario:
    """Returns robots and people of two laws around a box, mirrored at the x axis by hand -1, then turned left."""

    def put(x: float, y: float) -> tuple[float, float]:
        return turned(x, y, hand, quarters)

    rng = np.random.default_rng(11)
    ends = rng.permutation(np.stack(np.meshgrid(np.arange(4), np.arange(4)), -1).reshape(16, 2)) * 1.5
    ends += rng.uniform(-0.2, 0.2, ends.shape)
    headings = rng.uniform(-3.0, 3.0, 6)
    starts = [(*put(*p), hand * h + quarters * np.pi / 2) for p, h in zip(ends[:6], headings, strict=True)]
    goals = [(*put(*p), 0.0) for p in ends[10:]]
    laws = [ORCA, ORCA, MOUSSAID, MOUSSAID]
    people = [
        {"law": law, **dict(zip(("x", "y", "goal_x", "goal_y"), (*put(*p), *put(*q)), strict=True))}
        for law, p, q in zip(laws, ends[6:10], ends[:4], strict=True)
    ]
    thing = box(*put(-1.4, 2.2), 0.7, 0.3, hand * 0.4 + quarters * np.pi / 2)
    return TeamScenario.made("mingled", starts, goals, obstacle_field(thing), walks=walks_of(people))


@pytest.mark.parametrize("env_id", ALONE)
@pytest.mark.parametrize(("hand", "quarters"), [(-1.0, 0), (1.0, 1), (-1.0, 3)])
@pytest.mark.parametrize("by_law", [False, True], ids=["driven", "orca_team"])
def test_a_world_that_is_mirrored_or_turned_goes_on_alike(
    env_id: str, hand: float, quarters: int, by_law: bool
) -> None:
    """Robots and people bit for bit in the mirror, and to rounding where a heading is turned; the law has no side."""
    law = policies.make("orca_team", turn=0.0, stuck_turn=0.0)
    worlds = []
    for scenario, side in ((mingled(1.0, 0), 1.0), (mingled(hand, quarters), hand)):
        env: Any = gymnasium.make(env_id, scenario=scenario, sees="bodies", num_beams=25)
        task, batch = env.unwrapped.task, env.unwrapped.batch
        pilot, rng = Pilot(law, env), np.random.default_rng(3)
        seen, _ = env.reset(seed=0)
        pilot.reset()
        found = []
        for _ in range(60):
            action = 0.5 * actions_of(env, rng)
            action[:, 1:] *= side
            seen, _, ended, _, info = env.step(pilot.command(seen) if by_law else action)
            assert not ended
            places, _, _, _, clocks = batch.own[:5]
            now = places[clocks[0, 0], 0]
            places_of = (now[name] for name in ("x", "y", "vx", "vy", "cos", "sin"))
            found.append((*places_of, info["gap"], task.layout.unpack(seen)))
        worlds.append(found)
    most, seen_most = (1e-12, 1e-6) if quarters else (0.0, 0.0)
    for (*mine, my_gaps, my_view), (*its, its_gaps, its_view) in zip(*worlds, strict=True):
        np.testing.assert_allclose(its_gaps, my_gaps, rtol=0.0, atol=most)
        for k in (0, 2, 4):
            there = turned(mine[k], mine[k + 1], hand, quarters)
            np.testing.assert_allclose(its[k : k + 2], there, rtol=0.0, atol=most)
        sides = (1.0, hand, 1.0, hand, 1.0, 1.0, 1.0)
        np.testing.assert_allclose(its_view.bodies, my_view.bodies * sides, rtol=0.0, atol=seen_most)
        beams = my_view.ranges if hand > 0.0 else np.roll(my_view.ranges[:, ::-1], 1, axis=1)
        np.testing.assert_allclose(its_view.ranges, beams, rtol=0.0, atol=seen_most)


def test_a_body_is_met_by_beams_as_an_obstacle_of_its_shape() -> None:
    off = dataclasses.replace(ROBOTS["jackal"], name="off", hull_x=-0.1)
    for robot, env_id in (("p3dx", DIFF), ("jackal", DIFF), (off, DIFF), ("omni3", OMNI)):
        two = TeamScenario.made("two", [(0.0, 0.0, 0.3), (1.3, 0.4, 0.8)], [(5.0, 0.0, 0.0), (5.0, 3.0, 0.0)])
        env: Any = gymnasium.make(env_id, scenario=two, robot=robot, num_beams=180).unwrapped
        seen, _ = env.reset(seed=0)
        shape = np.zeros(1, OBSTACLE)
        hull, ahead = env.task.robot.hull_box, env.task.robot.hull_x
        shape["x"], shape["y"] = 1.3 + ahead * np.cos(0.8), 0.4 + ahead * np.sin(0.8)
        shape["cos"], shape["sin"] = (np.cos(0.8), np.sin(0.8)) if hull else (1.0, 0.0)
        if hull:
            shape["half_length"], shape["half_width"] = hull[0] / 2, hull[1] / 2
        else:
            shape["radius"] = env.task.robot.hull_radius
        one = TeamScenario.made("one", [(0.0, 0.0, 0.3)], [(5.0, 0.0, 0.0)], shape)
        alone, _ = gymnasium.make(env_id, scenario=one, robot=robot, num_beams=180).reset(seed=0)
        ranges = env.task.layout.unpack(seen).ranges[0]
        assert (ranges < 5.0).any()
        np.testing.assert_allclose(ranges, alone[-180:], rtol=0.0, atol=1e-6 if hull else 0.0)


def test_who_meets_head_on_ends_with_both_where_they_were() -> None:
    robots = TeamScenario.made("meet", [(0.0, 0.0, 0.0), (1.0, 0.0, np.pi)], [(4.0, 0.0, 0.0), (-3.0, 0.0, np.pi)])
    env: Any = gymnasium.make(DIFF, scenario=robots).unwrapped
    env.reset(seed=0)
    before = 0.0
    for _ in range(40):
        _, _, terminated, _, info = env.step(np.array([[0.5, 0.0], [0.5, 0.0]]))
        if info["collision"].any():
            break
        before = info["gap"][0]
        assert info["gap"][0] == info["gap"][1]
    assert terminated
    assert info["collision"].tolist() == info["caused"].tolist() == [True, True]
    assert info["touched"].tolist() == [1 + ROBOT] * 2
    assert 0.0 <= before < 0.05
    x = env.batch.states["x"]
    assert x[1] - x[0] - 0.5 == pytest.approx(before, abs=1e-12)  # they stand where the period began


def test_who_stands_has_not_caused_it_and_who_has_ended_waits() -> None:
    starts = [(0.0, 0.0, 0.0), (1.0, 0.0, 0.0), (0.0, 5.0, 0.0)]
    three = TeamScenario.made("three", starts, [(4.0, 0.0, 0.0), (9.0, 0.0, 0.0), (1.0, 5.0, 0.0)])
    env: Any = gymnasium.make_vec(DIFF, num_envs=3, scenario=three, max_episode_steps=100)
    env.reset(seed=0)
    drive = np.array([[0.5, 0.0], [0.0, 0.0], [0.5, 0.0]])
    rewards, ends, alive = [], [], []
    for _ in range(60):
        _, reward, terminated, truncated, info = env.step(drive)
        rewards.append(reward)
        ends.append(terminated | truncated)
        alive.append(info["alive"])
        if ends[-1][:2].any():
            assert info["caused"].tolist()[:2] == [True, False]
    ends_of, alive_of = np.array(ends)[:50], np.array(alive)[:50]
    assert ends_of.sum(axis=0).tolist() == [1, 1, 1]  # each exactly once
    hit, arrived = int(ends_of[:, 0].argmax()), int(ends_of[:, 2].argmax())
    assert hit < arrived
    assert not alive_of[hit + 1 : arrived + 1, :2].any()
    assert (np.array(rewards)[hit + 1 : arrived + 1, :2] == 0.0).all()
    assert alive[arrived + 1].all()  # the world began anew


def test_who_has_arrived_leaves_or_parks() -> None:
    two = TeamScenario.made("pass", [(0.0, 0.0, 0.0), (3.0, 0.0, 0.0)], [(1.0, 0.0, 0.0), (8.0, 0.0, 0.0)])
    for parks in (False, True):
        env: Any = gymnasium.make(DIFF, scenario=two, parks=parks, sees="bodies").unwrapped
        env.reset(seed=0)
        for _ in range(80):
            observation, _, _, _, info = env.step(np.array([[0.5, 0.0], [0.0, 0.0]]))
        assert info["success"][0]
        assert env.task.layout.unpack(observation).bodies[1, 0, 6] == float(parks)


def test_walls_hide_bodies_from_those_who_track_them() -> None:
    wall = np.zeros(1, OBSTACLE)
    wall["x"], wall["y"], wall["sin"], wall["half_length"] = 1.0, 0.0, 1.0, 1.0
    starts = [(0.0, 0.0, 0.0), (2.0, 0.0, 0.0), (0.0, 3.0, 0.0)]
    three = TeamScenario.made("wall", starts, [(0.0, -4.0, 0.0), (2.0, -4.0, 0.0), (0.0, 4.0, 0.0)], wall)
    env: Any = gymnasium.make(OMNI, scenario=three, sees="bodies").unwrapped
    bodies = env.task.layout.unpack(env.reset(seed=0)[0]).bodies
    assert bodies[0, :2, 6].tolist() == [1.0, 0.0]
    np.testing.assert_allclose(bodies[0, 0], [0.0, 3.0, 0.0, 0.0, 0.3, ROBOT, 1.0], atol=1e-6)


def test_tracks_have_the_noise_of_sensors_and_miss_a_body_now_and_then() -> None:
    """At nominal noise 2 cm and 0.1 m/s; by strong dropouts a body is unseen in 5 % of the periods."""
    two = TeamScenario.made("two", [(0.0, 0.0, 0.0), (2.0, 1.0, 0.0)], [(9.0, 0.0, 0.0), (9.0, 3.0, 0.0)])
    env: Any = gymnasium.make_vec(
        OMNI, num_envs=400, scenario=two, sees="bodies", noise=1.0, disturbance="dropout", max_episode_steps=1000
    )
    seen, _ = env.reset(seed=0)
    tracks = []
    for _ in range(30):
        tracks.append(env.task.layout.unpack(seen).bodies[::2, 0])
        seen, *_ = env.step(np.zeros((400, 3)))
    found = np.concatenate(tracks)
    there = found[:, 6] == 1.0
    assert (1.0 - there.mean()) == pytest.approx(0.05, abs=0.01)
    assert (found[~there] == 0.0).all()
    np.testing.assert_allclose(found[there, :2].mean(axis=0), [2.0, 1.0], atol=0.02)
    np.testing.assert_allclose(found[there, :4].std(axis=0), [0.02, 0.02, 0.1, 0.1], rtol=0.1)
    clean, _ = gymnasium.make(OMNI, scenario=two, sees="bodies").reset(seed=0)
    np.testing.assert_allclose(env.task.layout.unpack(clean).bodies[0, 0, :4], [2.0, 1.0, 0.0, 0.0], atol=1e-6)


def test_a_copy_in_mid_episode_goes_on_alike() -> None:
    for env in (
        gymnasium.make(DIFF, scenario="circle_4").unwrapped,
        gymnasium.make_vec(DIFF, num_envs=8, scenario="circle_4", ends="respawn", autoreset_mode="SameStep"),
    ):
        env.reset(seed=0)
        rng = np.random.default_rng(0)
        for _ in range(20):
            env.step(actions_of(env, rng))
        other = pickle.loads(pickle.dumps(env))
        for _ in range(40):
            action = actions_of(env, rng)
            assert env.step(action)[0].tobytes() == other.step(action)[0].tobytes()


def test_both_snapshots_agree_after_a_reset_in_what_no_robot_has_done() -> None:
    env: Any = gymnasium.make_vec(DIFF, num_envs=8, scenario="doorway_4", autoreset_mode="SameStep")
    env.reset(seed=0)
    rng = np.random.default_rng(0)
    for _ in range(30):
        env.step(actions_of(env, rng))
    env.reset(seed=1)
    places = env.batch.own[0]
    assert places[0].tobytes() == places[1].tobytes()


def test_respawned_robots_stand_clear_and_none_waits() -> None:
    env: Any = gymnasium.make_vec(OMNI, num_envs=32, scenario="circle_8", ends="respawn", autoreset_mode="SameStep")
    env.reset(seed=0)
    rng = np.random.default_rng(3)
    begun = 0
    for _ in range(300):
        _, _, terminated, _, _ = env.step(actions_of(env, rng))
        rows = np.flatnonzero(terminated)
        whole = np.bincount(rows // 8, minlength=4)
        for i in rows:
            if whole[i // 8] > 1:
                continue
            states, w = env.batch.states, i // 8
            others = [k for k in range(8 * w, 8 * w + 8) if k != i]
            apart = np.hypot(states["x"][others] - states["x"][i], states["y"][others] - states["y"][i])
            assert apart.min() >= 0.6 + 0.3 - 1e-9
            assert states["steps"][i] == 0
            begun += 1
    assert begun > 0


def test_gymnasium_finds_nothing_to_say() -> None:
    check_env(gymnasium.make(DIFF, scenario="crossing_2").unwrapped, skip_render_check=True)


def among(people: list[dict[str, float]]) -> TeamScenario:
    return TeamScenario.made("among", [(0.0, 0.0, 0.0)], [(9.0, 0.0, 0.0)], walks=walks_of(people))


@pytest.mark.parametrize(
    ("fields", "said"),
    [
        ({"law": 9}, r"walks\[0\].law is 9; it must be from 0 to 8"),
        ({"speed": 30.0}, r"walks\[0\].speed is 30.0; it must be from 0 to 3"),
        ({"law": REPLAY}, r"walks\[0\].frame_time is 0.0; it must be from 0.001 to"),
        (
            {"law": REPLAY, "frame_time": 0.4},
            r"walks\[0\] has rows 0 to 0 of tracks, which has 0; there must be at least 2",
        ),
    ],
)
def test_people_who_cannot_be_are_refused_in_a_line(fields: dict[str, float], said: str) -> None:
    with pytest.raises(ValueError, match=said) as caught:
        among([{"x": 3.0, "y": 0.0} | fields])
    assert "\n" not in str(caught.value)


def test_who_goes_on_heads_for_one_goal_after_the_other() -> None:
    goals = [(3.0, 2.0), (5.0, 2.0), (3.0, 0.0)]
    walker = {"law": ORCA, "x": 3.0, "y": 0.0, "goal_x": 3.0, "goal_y": 2.0, "then": GOES_ON}
    after = [walker | {"goals": goals[1:] + goals[:1]}]
    out = stroll(walks_of(after), 400, 0.05, tracks=tracks_of(after))[:, 0, :2]
    first = [int(np.argmax(np.hypot(*(out - goal).T) < 0.26)) for goal in goals]
    assert 0 < first[0] < first[1]
    assert first[2] == 0  # where it began
    again = np.hypot(*(out[first[1] :] - goals[2]).T)
    assert again.min() < 0.26


@pytest.mark.parametrize(
    ("keywords", "said"),
    [
        ({"team": 20}, "team=20 is larger than scenario 'circle_8_0' allows; it must be at most 8"),
        ({"scenario": "cirle_8"}, "unknown team scenario 'cirle_8'.*Did you mean 'circle_8'"),
        ({"sees": "all"}, "sees='all' is unknown"),
        ({"num_envs": 20}, "num_envs=20 with team=8: .* must be a multiple of 8"),
        (
            {"scenario": TeamScenario.made("x", [(0, 0, 0), (0.4, 0, 0)], [(3, 0, 0), (6, 0, 0)])},
            r"starts\[0\] and starts\[1\] overlap by 0.1 m",
        ),
        ({"ends": "respawn", "scenario": "moving_crossing"}, "nothing patrols"),
        (
            {"scenario": among([{"x": 1.0, "y": 1.0}, {"x": 1.3, "y": 1.0}])},
            r"walks\[0\] and walks\[1\] overlap by 0.2 m",
        ),
    ],
)
def test_what_cannot_be_is_refused_in_a_line(keywords: dict[str, Any], said: str) -> None:
    with pytest.raises(ValueError, match=said) as caught:
        gymnasium.make_vec(DIFF, **({"num_envs": 8} | keywords))
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("name", sorted(TEAM_FAMILIES))
def test_every_family_has_a_world_whose_robots_are_clear(name: str) -> None:
    scenario = TEAM_FAMILIES[name].make(0)
    assert scenario.team == int(name.rsplit("_", 1)[-1]) if name.rsplit("_", 1)[-1].isdigit() else scenario.team == 2
    assert TEAM_FAMILIES[name].make(0).decisive()[2:3] == scenario.decisive()[2:3]
    places = scenario.starts[:, :2]
    gaps = np.sqrt(((places[:, None] - places[None]) ** 2).sum(axis=2)) + 10.0 * np.eye(len(places))
    assert gaps.min() >= 0.6
