"""Sample efficiency: success on validation scenes against environment steps, of PPO, SAC and TD3, beside controllers.

    python benchmarks/studies/learning.py --workers 2

A run that is in docs/results/learning.csv is not made again; page and figure are made from that file.
"""

import io
import itertools
import multiprocessing
import sys
from collections.abc import Iterator, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from pathlib import Path
from typing import Any, NamedTuple

import click
import gymnasium
import numpy as np
import torch
from matplotlib import rc_context
from matplotlib.figure import Figure
from part_rows import read, write
from stable_baselines3 import PPO, SAC, TD3
from stable_baselines3.common.base_class import BaseAlgorithm
from stable_baselines3.common.callbacks import BaseCallback
from stable_baselines3.common.noise import NormalActionNoise

from wayfield.benchmarks.figures.drawing import RC
from wayfield.policies import make, tuned_gains
from wayfield.policies.learned.agent import Agent, Network
from wayfield.policies.training.learner import Layers, PpoLearner, layers_of, make_worlds, mean_of
from wayfield.policies.training.presets import PRESETS, Preset
from wayfield.policies.training.run import described_agent
from wayfield.policies.training.sac import squashed
from wayfield.policies.training.validation import Score, validate
from wayfield.system.storage import write_whole

RESULTS = Path("docs/results")
TABLE, PAGE, FIGURE = RESULTS / "learning.csv", RESULTS / "learning.md", RESULTS / "learning.png"
STEPS, VALIDATIONS, SEEDS = 100_000, 5, 3
ROBOTS, HIDDEN = 64, [64, 64]
UPDATES_PER_STEP = 0.25  # gradient steps of SAC and TD3 a control period of a robot
FULL = "PPO, preset"  # at its own number of robots, with its own numbers
COLUMNS = ("task", "learner", "seed", "steps", "success", "failure", "error", "speed")
COLORS = {"PPO": "#E69F00", "SAC": "#56B4E9", "TD3": "#009E73", FULL: "#D55E00"}  # of Okabe and Ito


class Task(NamedTuple):
    """What is learned: a preset without what a controller would teach it, and the controllers beside it."""

    title: str
    preset: Preset
    laws: tuple[str, ...]


TASKS = {
    "path following": Task("Path following, P3DX", PRESETS["path_following_plain"], ("pure_pursuit", "ilqr")),
    "goal reaching": Task(
        "Goal reaching among obstacles, P3DX",
        PRESETS["diff_drive_goal"].changed(controller="", imitation=0, lessons=0, steps=2_000_000),
        ("vfh_plus", "scan_planner"),
    ),
}


class Validator(BaseCallback):
    """Validates what was learned so far, `VALIDATIONS` times in a run."""

    def __init__(self, seen: Any) -> None:
        super().__init__()
        self.seen, self.due = seen, 0

    def _on_step(self) -> bool:
        if self.due < STEPS and self.num_timesteps >= self.due:  # the last one is after the last update
            self.seen(self.num_timesteps)
            self.due += STEPS // VALIDATIONS
        return True


def learner_of(name: str, preset: Preset, worlds: Any, seed: int) -> BaseAlgorithm:
    """Returns an algorithm of stable-baselines3 with its own numbers, but for the sizes that all share."""
    discount = preset.learning.discount
    shared: dict[str, Any] = {
        "gamma": discount, "seed": seed, "device": "cpu",
        "policy_kwargs": {"net_arch": HIDDEN, "activation_fn": torch.nn.Tanh},
    }  # fmt: skip
    if name == "PPO":
        return PPO("MlpPolicy", worlds, n_steps=2048 // ROBOTS, **shared)
    shared |= {"learning_starts": 10_240, "train_freq": 1, "gradient_steps": round(UPDATES_PER_STEP * ROBOTS)}
    shared["buffer_size"] = STEPS
    if name == "SAC":  # rewards are multiplied by 1 - discount
        return SAC("MlpPolicy", worlds, ent_coef=f"auto_{1.0 - discount}", **shared)
    size = worlds.action_space.shape[0]
    noise = NormalActionNoise(np.zeros(size), 0.1 * np.ones(size))  # as its paper has it
    return TD3("MlpPolicy", worlds, action_noise=noise, **shared)


def layers(model: BaseAlgorithm) -> Layers:
    """Returns weights and biases of the action that is taken without noise, layer after layer."""
    if isinstance(model, PPO):
        return layers_of(mean_of(model.policy))
    actor: Any = model.actor  # type: ignore[attr-defined]
    return squashed([*actor.latent_pi, actor.mu] if isinstance(model, SAC) else actor.mu)


def score(preset: Preset, layers: Layers) -> Score:
    """Returns what a network does on the validation scenes of its preset."""
    here = preset.worlds
    kwargs = preset.env_kwargs(here.validation)
    probe: Any = gymnasium.make(here.env_ids[0], **kwargs).unwrapped
    card = described_agent(preset, probe.task, here.env_ids[0], kwargs, "", layers)
    network = Network.of(layers, preset.learning.activation)
    agent = Agent(network, preset.features, preset.actions, card, here.speed, preset.base)
    return validate(agent, here.env_ids[0], kwargs, probe.spec.max_episode_steps or 1200)


def row_of(task: str, name: str, seed: int | str, steps: int, made: Score) -> dict[str, Any]:
    """Returns a row of the table."""
    numbers = (f"{each:.4f}" for each in (made.success, made.collision, made.error, made.speed))
    return dict(zip(COLUMNS, (task, name, seed, steps, *numbers), strict=True))


def run(task: str, name: str, seed: int) -> list[dict[str, Any]]:
    """Returns the rows of a run: a row a validation."""
    torch.set_num_threads(1)
    rows: list[dict[str, Any]] = []
    preset = TASKS[task].preset

    def seen(steps: int, layers: Layers) -> None:
        with torch.no_grad():
            made = score(preset, layers)
        rows.append(row_of(task, name, seed, steps, made))

    if name == FULL:
        own = PpoLearner(preset, preset.worlds.env_ids[0], seed)
        due = 0
        while own.frames < preset.learning.steps:
            own.update()
            if own.frames >= due:
                seen(own.frames, own.layers())
                due = own.frames + preset.learning.steps // VALIDATIONS
        seen(own.frames, own.layers())
        return rows
    preset = preset.changed(num_envs=ROBOTS, hidden=tuple(HIDDEN), activation="tanh")
    worlds = make_worlds(preset, preset.worlds.env_ids[0])
    worlds.seed(seed)
    model = learner_of(name, preset, worlds, seed)
    model.learn(STEPS, Validator(lambda steps: seen(steps, layers(model))))
    seen(model.num_timesteps, layers(model))
    return rows


def law_rows(task: str) -> Iterator[dict[str, Any]]:
    """Yields what controllers do on the same scenes at the same speed."""
    preset = TASKS[task].preset
    here, kwargs = preset.worlds, preset.env_kwargs(preset.worlds.validation)
    for law in TASKS[task].laws:
        suite = "path-following" if task == "path following" else "goal-obstacles"
        made = validate(make(law, **tuned_gains(law, suite, "p3dx", here.speed)), here.env_ids[0], kwargs, 1200)
        yield row_of(task, law, "", 0, made)


def curve(rows: Sequence[Mapping[str, Any]], task: str, name: str) -> tuple[np.ndarray, np.ndarray]:
    """Returns the steps (k,) and the shares of success (seeds, k) of a learner."""
    mine = [row for row in rows if (row["task"], row["learner"]) == (task, name)]
    by_seed = [list(each) for _, each in itertools.groupby(mine, lambda row: row["seed"])]
    least = min(map(len, by_seed))
    steps = np.array([float(row["steps"]) for row in by_seed[0][:least]])
    return steps, np.array([[float(row["success"]) for row in each[:least]] for each in by_seed])


def figure(rows: Sequence[Mapping[str, Any]]) -> bytes:
    """Returns the figure as PNG: a panel a task, the mean of the seeds in a band from the least to the most."""
    with rc_context(RC):
        drawn = Figure((10.0, 4.6), layout="constrained")
        for axes, (task, entrants) in zip(drawn.subplots(1, 2), TASKS.items(), strict=True):
            for name in (*COLORS,):
                steps, shares = curve(rows, task, name)
                axes.plot(steps, 100.0 * shares.mean(axis=0), color=COLORS[name], label=name)
                axes.fill_between(
                    steps,
                    *(100.0 * end(axis=0) for end in (shares.min, shares.max)),
                    color=COLORS[name],
                    alpha=0.2,
                    lw=0,
                )
            for law, style in zip(entrants.laws, ("--", ":"), strict=True):
                row = next(each for each in rows if (each["task"], each["learner"]) == (task, law))
                axes.axhline(100.0 * float(row["success"]), color="#0072B2", ls=style, label=law)
            axes.set(title=entrants.title, xlabel="environment steps", ylabel="success (%)", ylim=(-2.0, 102.0))
            axes.set_xscale("log")
            axes.set_xlim(5e3, 3e6)
            axes.set_xticks([1e4, 1e5, 1e6], ["10,000", "100,000", "1 million"])
            axes.legend(fontsize=9)
        file = io.BytesIO()
        drawn.savefig(file, format="png", dpi=100)
    return file.getvalue()


def page(rows: Sequence[Mapping[str, Any]]) -> str:
    """Returns the page."""
    lines = [
        "# Learning curves: PPO, SAC and TD3", "",
        "Made by `python benchmarks/studies/learning.py` from [every validation](learning.csv).", "",
        "[All results](../results.md)", "",
        "![Success on validation scenes against environment steps of four learners and controllers](learning.png)", "",
        f"A line is the mean of {SEEDS} seeds, its band reaches from the least to the most successful one. Dashed and "
        "dotted: controllers on the same scenes, `pure_pursuit` with default gains, the others hand-tuned, those of "
        "goals on these very scenes, which helps them. No network begins as a copy of a controller. PPO, SAC and TD3 "
        f"are those of Stable-Baselines3, with the same inputs and actions, {ROBOTS} robots side by side, "
        f"networks of two layers of {HIDDEN[0]} units (tanh) and {STEPS:,} environment steps.", "",
        "Nothing was tuned for them. Other than Stable-Baselines3's defaults are the discount (the preset's), and for "
        f"SAC and TD3 {UPDATES_PER_STEP:g} gradient steps per environment step instead of 1, 10,240 random steps at "
        "first, TD3's exploration noise of 0.1 (its paper's), and SAC's first entropy coefficient (1 - discount, as "
        f"rewards are scaled). `{FULL}` has the preset's own network, hyperparameters and 1,024 robots."
        " On paths, the preset charges up to five times as much for errors as its run goes on; the others pay the "
        "initial price throughout.", "",
    ]  # fmt: skip
    for task, entrants in TASKS.items():
        cost = "cross-track RMS (mm)" if task == "path following" else "time (s)"
        factor = 1000.0 if task == "path following" else 1.0
        header = ["learner", "steps", "success (%)", "seeds (%)", "failure (%)", cost, "mean speed (m/s)"]
        lines += [f"## {entrants.title}", "", f"| {' | '.join(header)} |", "|---" * len(header) + "|"]
        for name in (*COLORS, *entrants.laws):
            ends = [each for each in rows if (each["task"], each["learner"]) == (task, name)]
            ends = [list(each)[-1] for _, each in itertools.groupby(ends, lambda row: row["seed"])]
            last = {
                key: np.array([float(row[key]) for row in ends]) for key in ("success", "failure", "error", "speed")
            }
            seeds = ", ".join(f"{100.0 * each:.1f}" for each in last["success"]) if name in COLORS else ""
            cells = [name if name in COLORS else f"`{name}`", f"{int(ends[0]['steps']):,}" if name in COLORS else ""]
            cells += [f"{100.0 * last['success'].mean():.1f}", seeds, f"{100.0 * last['failure'].mean():.1f}"]
            cells += [f"{factor * np.nanmean(last['error']):.1f}", f"{last['speed'].mean():.2f}"]
            lines.append(f"| {' | '.join(cells)} |")
        failed = "leaving the corridor" if task == "path following" else "a collision"
        of = "of all runs, with 1 m for a failed one" if task == "path following" else "of successes"
        lines += [
            "",
            f"Failure: {failed}; the others run out of time. The {cost.rpartition(' ')[0]} is the interquartile",
        ]
        lines += [f"mean {of}.", ""]
    return "\n".join(lines)


@click.command(context_settings={"help_option_names": ["-h", "--help"]})
@click.option("--workers", type=click.IntRange(1), default=1, show_default=True, help="Processes.")
@click.option("--pages", is_flag=True, help="Only make page and figure anew.")
def main(workers: int, pages: bool) -> None:
    """Learns what is missing, and makes page and figure."""
    rows: list[dict[str, Any]] = list(read(TABLE))
    there = {(row["task"], row["learner"], row["seed"]) for row in rows}
    names = [(task, name, seed) for seed in range(SEEDS) for name in COLORS for task in TASKS]
    missing = [] if pages else [each for each in names if (*each[:2], f"{each[2]}") not in there]
    for task in [] if pages else TASKS:
        if not any((task, law, "") in there for law in TASKS[task].laws):
            rows += law_rows(task)
    with ProcessPoolExecutor(workers, multiprocessing.get_context("spawn")) as executor:
        for done in as_completed([executor.submit(run, *each) for each in missing]):
            rows += done.result()
            rows.sort(key=lambda row: (row["task"], row["learner"], str(row["seed"]), int(row["steps"])))
            write(TABLE, COLUMNS, rows)
            print(*done.result()[-1].values(), file=sys.stderr, flush=True)
    rows = list(read(TABLE))
    write_whole(FIGURE, figure(rows))
    write_whole(PAGE, page(rows).encode())


if __name__ == "__main__":
    main()
