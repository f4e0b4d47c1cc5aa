"""The size of training runs that tests wait for."""

from typing import Any

from wayfield.policies.training.presets import Ppo

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
