"""Shield and barrier: behind any driving, on any base, nothing that stands and is wide enough to be seen is touched."""

import dataclasses
import itertools
from typing import Any, ClassVar

import gymnasium
import numpy as np
import pytest

from wayfield.envs import goal_reaching
from wayfield.envs.robots import ACTUATORS, FULL_TURN, ROBOTS, Robot, Sensors
from wayfield.envs.scenarios import TASKS, field_scenarios
from wayfield.envs.scenarios.goal_families import GOAL_FAMILIES, LARGEST_HULL
from wayfield.policies import Pilot, Policy, Shielded, cbf, make
from wayfield.policies.parts.shield import LEAST_VIEW, Shield
from wayfield.policies.training.drawn import robot_like

FAMILIES = ("clutter_10", "clutter_15", "corridors", "doors_narrow", "rooms", "u_traps_15")
THICK = 0.05  # m, half of a wall's thickness


@dataclasses.dataclass(frozen=True)
class Reckless:
    """Drives twists at random for a second or so each."""

    speed: float  # m/s
    seed: int

    knows: ClassVar[str] = "sensors"
    observes: ClassVar[tuple[type, ...]] = (goal_reaching.Observation,)

    def reset(self, briefing: Any) -> Any:
        return np.zeros(briefing.num_envs, [("step", np.int64), ("twist", np.float64, (3,))])

    def act(self, observation: Any, briefing: Any, memory: Any) -> Any:
        rng = np.random.default_rng((self.seed, memory["step"][0]))
        new = (rng.random(len(memory)) < 0.05) | (memory["step"] == 0)
        twists = rng.uniform((-0.3, -1.0, -1.5), (1.0, 1.0, 1.5), (len(memory), 3)) * (self.speed, self.speed, 1.0)
        memory["twist"][new] = twists[new]
        memory["step"] += 1
        return memory["twist"][:, briefing.robot.twist_axes]


class Backwards(Reckless):
    """Backs away, turning."""

    def __init__(self) -> None:
        super().__init__(0.3, 0)

    def act(self, observation: Any, briefing: Any, memory: Any) -> Any:
        return np.tile([-0.3, 0.5], (len(memory), 1))


def thick(scenario: Any) -> Any:
    """Returns a scenario whose walls have a thickness, so that a scan can see them end-on."""
    obstacles = scenario.obstacles.copy()
    obstacles["half_width"] = np.where(obstacles["radius"] > 0.0, 0.0, np.maximum(obstacles["half_width"], THICK))
    return dataclasses.replace(scenario, obstacles=obstacles)


def collisions(policy: Policy, robot: Robot, scenarios: list[Any], num_envs: int, steps: int, **kw: Any) -> int:
    """Returns how many of the episodes end in a collision."""
    kind = "Omni" if robot.holonomic else "DiffDrive"
    env = gymnasium.make_vec(
        f"wayfield/{kind}GoalObstacles-v0", num_envs=num_envs, scenario=scenarios, robot=robot, **kw
    )
    pilot = Pilot(policy, env)
    observation, _ = env.reset(seed=1)
    pilot.reset()
    hit, over = np.zeros(num_envs, bool), np.zeros(num_envs, bool)
    for _ in range(steps):
        observation, _, terminated, truncated, info = env.step(pilot.act(observation))
        hit |= info["collision"] & ~over
        over |= terminated | truncated
    env.close()
    return int(hit.sum())


def drawn(rng: np.random.Generator) -> tuple[Robot, dict[str, Any], float]:
    """Returns a base of any sheet, what the environment is made with, and a speed (m/s)."""
    speed = float(rng.uniform(0.2, 1.5))
    robot = robot_like(
        "drawn",
        holonomic=bool(rng.random() < 0.4),
        hull=float(rng.uniform(0.1, 0.6)),
        top=speed * float(rng.uniform(0.8, 2.0)),
        yaw_rate=float(rng.uniform(0.5, 4.0)),
        acceleration=float(rng.uniform(0.4, 4.0)),
        yaw_acceleration=float(rng.uniform(1.0, 12.0)),
        lag=float(rng.uniform(0.0, 0.3)),
        sensors=Sensors(
            beams=int(rng.choice([32, 48, 72, 180, 720])),
            range=float(rng.choice([3.0, 5.0, 12.0])),
            angle=float(rng.choice([FULL_TURN, FULL_TURN, rng.uniform(LEAST_VIEW, FULL_TURN)])),
        ),
    )
    return robot, {"actuators": str(rng.choice(["ideal", "lagged", "slow"]))}, speed


def counted(policy: Any, seed: int, settings: int, num_envs: int, steps: int) -> int:
    """Returns the collisions of a policy, made of reckless driving, over families and settings drawn at random."""
    rng = np.random.default_rng(seed)
    hits = 0
    for k, family in zip(range(settings), itertools.cycle(FAMILIES)):
        robot, kwargs, speed = drawn(rng)
        hull = robot.hull_radius
        bank = field_scenarios(TASKS["goal_reaching"], family, min(hull, LARGEST_HULL))[:num_envs]
        scenarios = [thick(each).scaled(max(hull / LARGEST_HULL, 1.0), speeds=True) for each in bank]
        hits += collisions(policy(Reckless(speed, 1000 * seed + k)), robot, scenarios, num_envs, steps, **kwargs)
    return hits


def test_reckless_driving_touches_nothing_behind_a_filter() -> None:
    run = {"seed": 3, "settings": 12, "num_envs": 8, "steps": 400}
    assert counted(Shielded, **run) == 0
    assert counted(cbf, **run) == 0
    assert counted(lambda reckless: reckless, **run) >= 24  # a quarter of the same driving without it


@pytest.mark.slow
@pytest.mark.parametrize("behind", [Shielded, cbf])
def test_ten_thousand_reckless_episodes_touch_nothing(behind: Any) -> None:
    assert counted(behind, seed=4, settings=313, num_envs=32, steps=400) == 0


@pytest.mark.slow
@pytest.mark.parametrize("tier", ACTUATORS)
def test_a_policy_that_sees_nothing_touches_nothing_in_a_thousand_scenes(tier: str) -> None:
    rng = np.random.default_rng(0)
    scenes = [thick(GOAL_FAMILIES[family].make(rng)) for family in ("clutter_5", "clutter_10", "clutter_15") * 334]
    blind, run = make("smooth_pose"), {"actuators": tier, "num_beams": 72}
    assert collisions(blind, ROBOTS["p3dx"], scenes, len(scenes), 600, **run) > 500
    assert collisions(cbf(blind), ROBOTS["p3dx"], scenes, len(scenes), 600, **run) == 0


@pytest.mark.parametrize(
    ("env_id", "guard", "atol"),
    [("OmniGoalObstacles", Shielded, 0.0), ("OmniGoalObstacles", cbf, 1e-12), ("DiffDriveGoalObstacles", cbf, 1e-12)],
)
def test_a_twist_far_from_everything_passes(env_id: str, guard: Any, atol: float) -> None:
    kwargs: dict[str, Any] = {"actuators": "lagged", "num_beams": 72}
    env = gymnasium.make(f"wayfield/{env_id}-v0", scenario="open_field", **kwargs)
    plain, behind = (Pilot(each, env) for each in (make("vfh_plus"), guard(make("vfh_plus"))))
    observation, _ = env.reset(seed=2)
    plain.reset()
    behind.reset()
    for _ in range(60):
        action = plain.act(observation)
        np.testing.assert_allclose(behind.act(observation), action, rtol=0.0, atol=atol)
        observation, *_ = env.step(action)


@pytest.mark.parametrize(
    ("seen", "told"), [({"num_beams": 0}, "num_beams is 0"), ({"field_of_view": 2.0}, "it spans 2 rad")]
)
def test_a_scan_of_less_than_half_a_turn_is_refused(seen: dict[str, Any], told: str) -> None:
    env = gymnasium.make("wayfield/DiffDriveGoalObstacles-v0", **seen)
    env.reset(seed=0)
    with pytest.raises(ValueError, match=f"Shield needs a scan of at least half a turn; {told}"):
        Shield().reset(env.unwrapped.briefing("sensors"))


def test_a_base_that_sees_no_more_than_ahead_does_not_back_into_the_rest() -> None:
    env = gymnasium.make("wayfield/DiffDriveGoalObstacles-v0", scenario="open_field", field_of_view=3.3, num_beams=60)
    pilot = Pilot(Shielded(Backwards()), env)
    observation, _ = env.reset(seed=2)
    pilot.reset()
    for _ in range(20):
        assert np.array_equal(pilot.act(observation), [0.0, 0.5])
        observation, *_ = env.step(pilot.act(observation))


def test_a_post_that_was_seen_once_is_not_driven_into_after_standing_beside_it() -> None:
    robot = dataclasses.replace(ROBOTS["mir100"], name="disc", hull_box=None, hull_x=0.0, hull_radius=0.45)
    how: dict[str, Any] = {"scenario": "open_field", "num_beams": 72, "actuators": "lagged"}
    env = gymnasium.make("wayfield/DiffDriveGoalObstacles-v0", robot=robot, **how)
    flat, _ = env.reset(seed=0)
    base: Any = env.unwrapped
    briefing, shield = base.briefing("sensors"), Shield(spread=0.3, beside=1.25)
    memory = shield.reset(briefing)
    beam, away = 45, 0.54  # 45 degrees to the left, farther than what could be met at rest
    for step in range(500):
        seen = base.task.layout.unpack(flat[None].astype(float))
        x, y, heading = seen.pose[0]
        if step == 0:
            angle = heading + briefing.beam_angles[beam]
            post = x + away * np.cos(angle), y + away * np.sin(angle)
            seen.ranges[0, beam] = away
        asked = np.array([[0.5 if step > 400 else 0.0, 0.0]])  # 20 s later, straight on, past it nearer than the hull
        flat, *_ = env.step(shield.passed(seen, briefing, memory, asked)[0])
        assert np.hypot(x - post[0], y - post[1]) >= robot.hull_radius
