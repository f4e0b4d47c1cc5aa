"""skrl's PPO on a native vector environment.

pip install -c constraints.txt . "skrl[torch]"; python examples/skrl_ppo.py --steps 500000
"""

import argparse

import gymnasium
import torch
from skrl.agents.torch.ppo import PPO, PPO_CFG
from skrl.envs.wrappers.torch import wrap_env
from skrl.memories.torch import RandomMemory
from skrl.models.torch import DeterministicMixin, GaussianMixin, Model
from skrl.trainers.torch import SequentialTrainer
from torch import nn

import wayfield  # noqa: F401  registers the ids


class Policy(GaussianMixin, Model):
    """A Gaussian policy."""

    def __init__(self, **spaces: object) -> None:
        Model.__init__(self, **spaces)
        GaussianMixin.__init__(self)
        self.net = nn.Sequential(nn.Linear(self.num_observations, 64), nn.Tanh(), nn.Linear(64, self.num_actions))
        self.log_std = nn.Parameter(torch.zeros(self.num_actions))

    def compute(self, inputs: dict[str, torch.Tensor], role: str = "") -> tuple[torch.Tensor, dict[str, torch.Tensor]]:
        return self.net(inputs["observations"]), {"log_std": self.log_std}


class Value(DeterministicMixin, Model):
    """A value of the observation."""

    def __init__(self, **spaces: object) -> None:
        Model.__init__(self, **spaces)
        DeterministicMixin.__init__(self)
        self.net = nn.Sequential(nn.Linear(self.num_observations, 64), nn.Tanh(), nn.Linear(64, 1))

    def compute(self, inputs: dict[str, torch.Tensor], role: str = "") -> tuple[torch.Tensor, dict[str, torch.Tensor]]:
        return self.net(inputs["observations"]), {}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--steps", type=int, default=500_000, help="of all robots together")
    parser.add_argument("--robots", type=int, default=64)
    options = parser.parse_args()

    # skrl never sees a final observation: it takes every step for a transition, as SameStep gives them
    env = wrap_env(
        gymnasium.make_vec("wayfield/OmniGoalObstacles-v0", options.robots, autoreset_mode="SameStep"),
        wrapper="gymnasium",
    )
    spaces = {"observation_space": env.observation_space, "action_space": env.action_space, "device": env.device}
    config = PPO_CFG(rollouts=32, learning_epochs=4, mini_batches=4)
    config.experiment.write_interval = config.experiment.checkpoint_interval = 0
    agent = PPO(
        models={"policy": Policy(**spaces), "value": Value(**spaces)},
        memory=RandomMemory(memory_size=32, num_envs=env.num_envs, device=env.device),
        cfg=config,
        **spaces,
    )
    steps = max(1, options.steps // env.num_envs)
    SequentialTrainer(env=env, agents=agent, cfg={"timesteps": steps, "headless": True}).train()
    print(f"trained for {steps * env.num_envs} steps")


if __name__ == "__main__":
    main()
