"""A Minari data set of a controller's episodes, collected on the single environment.

pip install -c constraints.txt . "minari[create,hdf5]"; python examples/minari_collect.py --steps 5000
Its collector needs JAX, which `minari[create]` brings; `wayfield record` writes such sets without.
Set MINARI_DATASETS_PATH to choose where it is written.
"""

import argparse

import gymnasium
import minari
from minari import DataCollector

import wayfield  # noqa: F401  registers the ids
from wayfield.policies import Pilot, make


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--steps", type=int, default=5_000)
    parser.add_argument("--dataset", default="wayfield/path-following/pure-pursuit-v0")
    options = parser.parse_args()

    env = DataCollector(gymnasium.make("wayfield/DiffDrivePathFollowing-v0", actuators="lagged"))
    pilot = Pilot(make("pure_pursuit"), env)
    observation, _ = env.reset(seed=0)
    pilot.reset()
    for _ in range(options.steps):
        observation, _, terminated, truncated, _ = env.step(pilot.act(observation))
        if terminated or truncated:
            observation, _ = env.reset()
            pilot.reset()
    env.create_dataset(
        options.dataset,
        algorithm_name="pure_pursuit",
        author="wayfield",
        description="Pure pursuit on random splines, lagged actuators",
    )
    env.close()
    data = minari.load_dataset(options.dataset)
    print(f"{data.total_episodes} episodes, {data.total_steps} steps")


if __name__ == "__main__":
    main()
