"""RLlib's PPO. Ray's workers import nothing of ours, so the id names the module that registers it: "wayfield:...".

pip install . "ray[rllib]" torch; python examples/rllib_ppo.py --steps 200000
"""

import argparse

import ray
from ray.rllib.algorithms.ppo import PPOConfig


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--steps", type=int, default=200_000, help="of all robots together")
    parser.add_argument("--runners", type=int, default=1)
    options = parser.parse_args()

    ray.init(num_cpus=options.runners + 1, include_dashboard=False)
    config = (
        PPOConfig()
        .environment("wayfield:wayfield/DiffDrivePathFollowing-v0", env_config={"actuators": "lagged"})
        .env_runners(num_env_runners=options.runners, num_envs_per_env_runner=4, rollout_fragment_length="auto")
        .training(train_batch_size_per_learner=min(4000, options.steps), minibatch_size=128, num_epochs=4)
    )
    algorithm = config.build_algo()
    steps = 0
    while steps < options.steps:
        result = algorithm.train()
        steps = int(result["env_runners"]["num_env_steps_sampled_lifetime"])
        print(f"{steps} steps, mean return {result['env_runners'].get('episode_return_mean', float('nan')):.2f}")
    print(f"trained for {steps} steps")
    algorithm.stop()
    ray.shutdown()


if __name__ == "__main__":
    main()
