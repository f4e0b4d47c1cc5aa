"""The shield: behind any driving, on any base, nothing that stands and is wide enough to be seen is touched."""

import dataclasses
import itertools
from typing import Any, ClassVar

import gymnasium
import numpy as np
import pytest

from wayfield.envs import goal_reaching
from wayfield.envs.robots import ROBOTS, Robot
from wayfield.envs.scenarios import TASKS, field_scenarios
from wayfield.policies import Pilot, Policy, Shielded, make
from wayfield.policies.parts.shield import Shield

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


def thick(scenario: Any) -> Any:
    """Returns a scenario whose walls have a thickness, so that a scan can see them end-on."""
    obstacles = scenario.obstacles.copy()
    obstacles["half_width"] = np.where(obstacles["radius"] > 0.0, 0.0, np.maximum(obstacles["half_width"], THICK))
    return dataclasses.replace(scenario, obstacles=obstacles)


def collisions(policy: Policy, robot: Robot | str, scenarios: list[Any], num_envs: int, steps: int, **kw: Any) -> int:
    """Returns how many of the episodes end in a collision."""
    base = ROBOTS[robot] if isinstance(robot, str) else robot
    kind = "Omni" if base.holonomic else "DiffDrive"
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
    """Returns a base with accelerations and a lag of its own, what the environment is made with, and a speed (m/s)."""
    robot = ROBOTS[str(rng.choice(["p3dx", "turtlebot3", "kobuki", "omni3", "omni4", "mecanum4"]))]
    settings = {
        "actuators": str(rng.choice(["ideal", "lagged", "slow"])),
        "num_beams": int(rng.choice([32, 48, 72, 180, 720])),
    }
    return robot, settings, float(rng.choice([0.3, 0.6, 1.0, 1.2]))


def counted(seed: int, settings: int, num_envs: int, steps: int) -> tuple[int, int]:
    """Returns collisions without and with the shield, over families and settings drawn at random."""
    rng = np.random.default_rng(seed)
    bare = shielded = 0
    for k, family in zip(range(settings), itertools.cycle(FAMILIES)):
        robot, kwargs, speed = drawn(rng)
        task = TASKS["goal_reaching"]
        scenarios = [thick(each) for each in field_scenarios(task, family, robot.hull_radius)[:num_envs]]
        reckless = Reckless(speed, 1000 * seed + k)
        run = (robot.name, scenarios, num_envs, steps)
        bare += collisions(reckless, *run, **kwargs)
        shielded += collisions(Shielded(reckless), *run, **kwargs)
    return bare, shielded


def test_reckless_driving_touches_nothing_behind_the_shield() -> None:
    bare, shielded = counted(seed=3, settings=6, num_envs=8, steps=400)
    assert shielded == 0
    assert bare >= 12  # a quarter of the same driving without it


@pytest.mark.slow
def test_ten_thousand_reckless_episodes_touch_nothing() -> None:
    assert counted(seed=4, settings=313, num_envs=32, steps=600)[1] == 0


def test_a_twist_far_from_everything_passes_unchanged() -> None:
    env = gymnasium.make("wayfield/OmniGoalObstacles-v0", scenario="open_field", actuators="lagged")
    plain, behind = (Pilot(each, env) for each in (make("vfh_plus"), Shielded(make("vfh_plus"))))
    observation, _ = env.reset(seed=2)
    plain.reset()
    behind.reset()
    for _ in range(60):
        action = plain.act(observation)
        assert np.array_equal(action, behind.act(observation))
        observation, *_ = env.step(action)


def test_a_scan_that_leaves_a_gap_is_refused() -> None:
    env = gymnasium.make("wayfield/DiffDriveGoalObstacles-v0", num_beams=0)
    env.reset(seed=0)
    with pytest.raises(ValueError, match="Shield needs a scan all around; num_beams is 0"):
        Shield().reset(env.unwrapped.briefing("sensors"))
