"""Stable-Baselines3's PPO on wayfield's robots, all stepped by one compiled call.

pip install -c constraints.txt ".[train]"; python examples/sb3_ppo.py --steps 500000
"""

import argparse

from stable_baselines3 import PPO
from stable_baselines3.common.vec_env import VecNormalize

from wayfield.envs.sb3 import NativeVecEnv


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--steps", type=int, default=500_000, help="of all robots together")
    parser.add_argument("--robots", type=int, default=64)
    options = parser.parse_args()

    robots = NativeVecEnv("wayfield/DiffDriveGoalObstacles-v0", options.robots, scenario="discs", actuators="lagged")
    # no VecMonitor needed: the final infos hold Monitor's `episode`, and `is_success`
    env = VecNormalize(robots, gamma=0.99)
    model = PPO("MlpPolicy", env, n_steps=64, batch_size=1024, n_epochs=5, device="cpu", verbose=1)
    model.learn(options.steps)
    print(f"trained for {model.num_timesteps} steps")


if __name__ == "__main__":
    main()
