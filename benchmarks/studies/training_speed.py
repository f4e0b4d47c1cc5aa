"""Training steps per second, beside Stable-Baselines3: python benchmarks/studies/training_speed.py

All learn with one thread and the preset's network, epochs and minibatches. They take turns of one update each, so that
a machine that slows down slows all of them. A second is one of processor time, which other work on the machine changes
little; the median of the turns counts. The learners of Stable-Baselines3 get the environment's own observation.
"""

import os
import statistics
import time
from collections.abc import Callable

# before NumPy is loaded, which reads it once
os.environ.setdefault("OMP_NUM_THREADS", "1")

import click
import numba
import rich.console
import rich.table
import torch
from stable_baselines3 import PPO
from stable_baselines3.common.callbacks import BaseCallback
from stable_baselines3.common.env_util import make_vec_env
from stable_baselines3.common.vec_env import DummyVecEnv, VecEnv

from wayfield.benchmarks.records.progress import tracked
from wayfield.envs.sb3 import NativeVecEnv
from wayfield.policies.training.learner import PpoLearner, anneal
from wayfield.policies.training.presets import PRESETS, Ppo, Preset
from wayfield.system.command_line import Choice, OneLineErrors

CHOSEN = tuple(name for name, preset in PRESETS.items() if isinstance(preset.learning.algorithm, Ppo))
DUMMIES = 64  # robots of DummyVecEnv: more of them are no faster


class _Nothing(BaseCallback):
    def _on_step(self) -> bool:
        return True


def plain_updates(preset: Preset, worlds: VecEnv) -> Callable[[], int]:
    """Returns a function that makes an update by Stable-Baselines3 alone and returns its steps."""
    learning, own = preset.learning, preset.learning.algorithm
    assert isinstance(own, Ppo)
    model = PPO(
        "MlpPolicy",
        worlds,
        n_steps=learning.horizon * preset.worlds.num_envs // worlds.num_envs,
        batch_size=min(learning.batch_size, preset.frames_per_update),
        n_epochs=own.epochs,
        learning_rate=anneal(learning.learning_rate, learning.final_learning_rate),
        gamma=learning.discount,
        policy_kwargs={"net_arch": list(learning.hidden)},
        device="cpu",
        seed=0,
    )
    _, callback = model._setup_learn(learning.steps, _Nothing())

    def update() -> int:
        model.collect_rollouts(worlds, callback, model.rollout_buffer, model.n_steps)
        model.train()
        return model.n_steps * worlds.num_envs

    return update


def contenders(preset: Preset) -> dict[str, Callable[[], int]]:
    """Returns what takes turns, by name; each has made its first, slow update."""
    env_id, kwargs = preset.worlds.env_ids[0], preset.env_kwargs(preset.worlds.validation)
    mine = PpoLearner(preset, env_id, seed=0)
    native = NativeVecEnv(env_id, preset.worlds.num_envs, **kwargs)
    alone = make_vec_env(env_id, DUMMIES, vec_env_cls=DummyVecEnv, env_kwargs=kwargs)

    def update() -> int:
        mine.update()
        return preset.frames_per_update

    chosen = {
        f"wayfield train, {preset.name}": update,
        "Stable-Baselines3, NativeVecEnv": plain_updates(preset, native),
        f"Stable-Baselines3, DummyVecEnv of {DUMMIES}": plain_updates(preset, alone),
    }
    for each in chosen.values():
        each()
    return chosen


@click.command("training_speed", cls=OneLineErrors)
@click.option("--preset", "name", type=Choice("--preset", CHOSEN), default="path_following_plain", show_default=True)
@click.option("--rounds", type=click.IntRange(min=1), default=5, show_default=True, help="Turns of each learner.")
def main(name: str, rounds: int) -> None:
    """Prints the steps per second that learners take, and the parts of one that is ours."""
    torch.set_num_threads(1)
    numba.set_num_threads(1)
    chosen = contenders(PRESETS[name])
    rates: dict[str, list[float]] = {each: [] for each in chosen}
    turns = [each for _ in range(rounds) for each in chosen]
    for each in tracked(turns, len(turns), "turns"):
        began = time.process_time()
        steps = chosen[each]()
        rates[each].append(steps / (time.process_time() - began))
    table = rich.table.Table(title=f"Training, one core, median of {rounds} updates", title_justify="left")
    for header in ("learner", "steps a CPU second", "wayfield is faster by"):
        table.add_column(header, justify="left" if header == "learner" else "right")
    first = statistics.median(next(iter(rates.values())))
    for each, values in rates.items():
        table.add_row(each, f"{statistics.median(values):,.0f}", f"{first / statistics.median(values):.2f}")
    rich.console.Console(width=100).print(table)


if __name__ == "__main__":
    main()
