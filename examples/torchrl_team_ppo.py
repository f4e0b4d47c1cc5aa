"""TorchRL's multi-agent PPO on a team: a world of four robots as PettingZoo's ParallelEnv, one network for all of them.

pip install ".[multi]" torchrl; python examples/torchrl_team_ppo.py --steps 400000
"""

import argparse

import torch
from tensordict.nn import TensorDictModule
from tensordict.nn.distributions import NormalParamExtractor
from torchrl.collectors import Collector
from torchrl.envs import PettingZooWrapper, RewardSum, TransformedEnv
from torchrl.modules import MultiAgentMLP, ProbabilisticActor, TanhNormal
from torchrl.objectives import ClipPPOLoss

import wayfield

GROUP = "robot"  # PettingZoo's agents are robot_0, robot_1, ...


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--steps", type=int, default=400_000, help="of all robots together")
    options = parser.parse_args()

    world = wayfield.parallel_env("wayfield/DiffDriveTeam-v0", scenario="circle_4", num_beams=24, max_episode_steps=600)
    # a robot that has arrived or collided is masked until all have
    env = PettingZooWrapper(world, use_mask=True, done_on_any=False)
    env = TransformedEnv(env, RewardSum(in_keys=[env.reward_key], out_keys=[(GROUP, "episode_reward")]))
    robots = len(world.possible_agents)
    shape = {"n_agents": robots, "centralised": False, "share_params": True, "depth": 2, "num_cells": 64}
    observed = env.observation_spec[GROUP, "observation"].shape[-1]
    action = env.full_action_spec[env.action_key]
    network = torch.nn.Sequential(
        MultiAgentMLP(n_agent_inputs=observed, n_agent_outputs=2 * action.shape[-1], **shape), NormalParamExtractor()
    )
    policy = ProbabilisticActor(
        TensorDictModule(network, [(GROUP, "observation")], [(GROUP, "loc"), (GROUP, "scale")]),
        in_keys=[(GROUP, "loc"), (GROUP, "scale")],
        out_keys=[env.action_key],
        distribution_class=TanhNormal,
        distribution_kwargs={"low": action.space.low, "high": action.space.high},
        return_log_prob=True,
    )
    critic = TensorDictModule(
        MultiAgentMLP(n_agent_inputs=observed, n_agent_outputs=1, **shape),
        [(GROUP, "observation")],
        [(GROUP, "state_value")],
    )
    loss = ClipPPOLoss(policy, critic, entropy_coeff=1e-4, normalize_advantage_exclude_dims=(-2,))
    loss.set_keys(
        reward=env.reward_key,
        action=env.action_key,
        value=(GROUP, "state_value"),
        done=(GROUP, "done"),
        terminated=(GROUP, "terminated"),
    )
    loss.make_value_estimator(gamma=0.975, lmbda=0.95)
    optimizer = torch.optim.Adam(loss.parameters(), 3e-4)
    frames = max(1, min(options.steps // robots, 1000))
    collector = Collector(
        env, policy, frames_per_batch=frames, total_frames=-(-options.steps // (robots * frames)) * frames
    )
    steps = 0
    for batch in collector:
        with torch.no_grad():
            loss.value_estimator(
                batch, params=loss.critic_network_params, target_params=loss.target_critic_network_params
            )
        flat = batch.reshape(-1)
        for _ in range(4):
            for some in torch.randperm(len(flat)).split(256):
                terms = loss(flat[some])
                sum(terms[name] for name in ("loss_objective", "loss_critic", "loss_entropy")).backward()
                torch.nn.utils.clip_grad_norm_(loss.parameters(), 1.0)
                optimizer.step()
                optimizer.zero_grad()
        steps += (
            batch["next", GROUP, "mask"].sum().item()
            if ("next", GROUP, "mask") in batch.keys(True)
            else batch.numel() * robots
        )
        print(f"{steps} steps, mean reward {batch['next'][env.reward_key].mean():.4f}")
    print(f"trained for {steps} steps")


if __name__ == "__main__":
    main()
