"""RLlib's PPO on a team: a world of four robots as PettingZoo's ParallelEnv, one network for all of them.

pip install ".[multi]" "ray[rllib]" torch; python examples/rllib_team_ppo.py --steps 400000
"""

import argparse

import ray
from ray.rllib.algorithms.ppo import PPOConfig
from ray.rllib.core.rl_module.multi_rl_module import MultiRLModuleSpec
from ray.rllib.core.rl_module.rl_module import RLModuleSpec
from ray.rllib.env.wrappers.pettingzoo_env import ParallelPettingZooEnv
from ray.tune.registry import register_env


def make_world(config: dict[str, object]) -> ParallelPettingZooEnv:
    """Returns a world; Ray's workers import what it needs here."""
    import wayfield

    return ParallelPettingZooEnv(wayfield.parallel_env("wayfield/DiffDriveTeam-v0", **config))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--steps", type=int, default=400_000, help="of all robots together")
    parser.add_argument("--runners", type=int, default=1)
    options = parser.parse_args()

    ray.init(num_cpus=options.runners + 1, include_dashboard=False)
    register_env("team", make_world)
    config = (
        PPOConfig()
        .environment("team", env_config={"scenario": "circle_4", "num_beams": 24, "max_episode_steps": 600})
        .env_runners(num_env_runners=options.runners, rollout_fragment_length="auto")
        .multi_agent(policies={"shared"}, policy_mapping_fn=lambda agent, episode, **_: "shared")
        .rl_module(rl_module_spec=MultiRLModuleSpec(rl_module_specs={"shared": RLModuleSpec()}))
        .training(train_batch_size_per_learner=min(4000, options.steps), minibatch_size=128, num_epochs=4)
    )
    algorithm = config.build_algo()
    steps = 0
    while steps < options.steps:
        result = algorithm.train()
        each = result["env_runners"]["num_agent_steps_sampled_lifetime"]
        steps = int(sum(each.values()))
        print(f"{steps} steps, mean return {result['env_runners'].get('episode_return_mean', float('nan')):.2f}")
    print(f"trained for {steps} steps")
    algorithm.stop()
    ray.shutdown()


if __name__ == "__main__":
    main()
