"""The size of training runs that tests wait for."""

from typing import Any

from wayfield.policies.learned.perception import Actions, GoalFeatures
from wayfield.policies.training.presets import Ppo
from wayfield.policies.training.shaping import GoalReward

# a run of seconds: few robots, few updates
SHORT: dict[str, Any] = {
    "num_envs": 16,
    "horizon": 8,
    "batch_size": 64,
    "algorithm": Ppo(epochs=1),
    "hidden": (8,),
    "steps": 16 * 8 * 6,
    "validations": 3,
    "time_limit": 15,
}
# one that has all that a robot can remember: actions, trails, crumbs, frames, and what its controller does
SEEKER: dict[str, Any] = {
    "task": "goal_reaching",
    "features": GoalFeatures(
        num_beams=24, pool=4, crumbs=4, crumb_gap=0.05, frames=2, stride=2, previous=2, moving=True
    ),
    "actions": Actions("planar"),
    "reward": GoalReward(),
    "robot": "omni3",
    "shortest_ways": True,
    "controller": "vfh_plus",
    "reach": 0.3,
}
