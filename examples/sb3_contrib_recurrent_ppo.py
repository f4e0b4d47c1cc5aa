"""sb3-contrib's RecurrentPPO: an LSTM for a robot that sees little and noisily, on the native adapter.

pip install -c constraints.txt ".[train]" sb3-contrib; python examples/sb3_contrib_recurrent_ppo.py --steps 200000
"""

import argparse

from sb3_contrib import RecurrentPPO

from wayfield.envs.sb3 import NativeVecEnv


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--steps", type=int, default=200_000, help="of all robots together")
    parser.add_argument("--robots", type=int, default=16)
    options = parser.parse_args()

    env = NativeVecEnv("wayfield/OmniGoalObstacles-v0", options.robots, num_beams=8, disturbance="moderate")
    model = RecurrentPPO("MlpLstmPolicy", env, n_steps=32, batch_size=128, n_epochs=2, device="cpu", verbose=1)
    model.learn(options.steps)
    print(f"trained for {model.num_timesteps} steps")


if __name__ == "__main__":
    main()
