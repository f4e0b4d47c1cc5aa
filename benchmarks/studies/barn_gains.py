"""Searches gains for the BARN challenge's Jackal: python benchmarks/studies/barn_gains.py --policy scan_planner

In worlds of the challenge's kind that are none of its own (`cellular_world`), scored by its formula: success x
OT/clip(T, 2 OT, 8 OT). OT is the time at 2 m/s of a way 1.1 times as long as the shortest one of the Jackal's disc: by
so much the published ways are longer, which the planner that made them kept from the cylinders. From a set chosen by
hand, some gains at a time are changed by normal draws, and a set that scores no less and touches nothing is kept.
The sets that ship are those that it begins with, written with `--trials 0`: scan_planner's first, of which any_robot's
planner has its gains.
"""

import json
from pathlib import Path
from typing import Any

import click
import gymnasium
import numpy as np
from flocks import first_episodes

from wayfield import policies
from wayfield.benchmarks.contests.barn import ANGLE, ASKED, BEAMS, RANGE, SPEED
from wayfield.envs.robots import ROBOTS
from wayfield.envs.scenarios import ways
from wayfield.envs.scenarios.cellular import cellular_world
from wayfield.envs.scenarios.scenario import GoalScenario
from wayfield.envs.scenarios.splits import digest
from wayfield.policies import Pilot
from wayfield.system.command_line import OneLineErrors
from wayfield.system.storage import write_whole

FILE = "policies/gains/goal-obstacles/{}_jackal_1.2_none.json"
FIRST_SEED = 1000  # of the worlds; those of the preset are 0 to 31
DETOUR = 1.1
STEPS = 1300  # of an episode; the score of a success falls no more after 8 OT, half of that
CHANGED = (2, 5)  # gains at a time, at least and at most
WIDTH = 0.2  # standard deviation of a change, of its range
SPENT = {"scan_planner": 550_000, "any_robot": 200_000}  # frames, about, on the set that it begins with
# The planner's were found by a search of 30 sets in the 24 worlds from 100 on, seed 1; the pause, of eleven more sets,
# in 48; the foresight, of three, in 48 of its own: among many cylinders, with so many beams and so fast, one that comes
# into view behind another passes for a mover, whose way to come shuts the gaps. The agent's, of 14 in these 48 or less.
START: dict[str, dict[str, float]] = {
    "scan_planner": {
        "max_speed": 2.0,
        "acceleration": 4.2854,
        "yaw_acceleration": 7.3634,
        "max_yaw_rate": 3.0204,
        "lookahead": 0.7639,
        "min_turn_radius": 0.3,
        "rotate_beyond": 0.8,
        "slow_speed": 0.8063,
        "slow_clearance": 0.1,
        "skin": 0.01,
        "margin": 0.01,
        "give": 0.02,
        "wanted_clearance": 0.3,
        "weight": 3.7081,
        "creep": 1.2,
        "cell": 0.06,
        "period": 4.0,
        "pause": 2.0,
        "foresight": 0.0,
    },
    "any_robot": {"speed": 2.0, "planned": ASKED, "patience": 1.0},
}
RANGES = {
    "scan_planner": {
        "max_speed": (1.2, 2.0),
        "acceleration": (1.0, 6.0),
        "yaw_acceleration": (2.0, 10.0),
        "max_yaw_rate": (1.0, 4.0),
        "lookahead": (0.3, 1.2),
        "min_turn_radius": (0.1, 0.8),
        "rotate_beyond": (0.4, 1.5),
        "slow_speed": (0.3, 1.4),
        "slow_clearance": (0.02, 0.3),
        "skin": (0.002, 0.02),
        "margin": (0.0, 0.03),
        "give": (0.0, 0.06),
        "wanted_clearance": (0.05, 0.5),
        "weight": (0.5, 12.0),
        "creep": (0.3, 2.0),
        "cell": (0.055, 0.08),
        "period": (0.5, 4.0),
        "pause": (0.1, 3.0),
    },
    "any_robot": {"speed": (1.2, 2.0), "patience": (0.5, 4.0)},
}


def drive(policy: str, gains: dict[str, float], bank: tuple[GoalScenario, ...]) -> tuple[float, float, float, int]:
    """Returns a set's mean score, its shares of successes and of contacts, and the frames driven."""
    env: Any = gymnasium.make_vec(
        "wayfield/DiffDriveGoalObstacles-v0",
        len(bank),
        scenario=bank,
        robot="jackal",
        num_beams=BEAMS,
        field_of_view=ANGLE,
        max_range=RANGE,
        actuators="lagged",
        max_episode_steps=STEPS,
    ).unwrapped
    pilot = Pilot(policies.make(policy, **gains), env)
    steps, arrived, touched = first_episodes(env, pilot, np.arange(len(bank)))
    optimal = np.array([DETOUR * ways.way_length(each, ROBOTS["jackal"].hull_radius) / SPEED for each in bank])
    taken = steps * env.task.options.dt
    env.close()
    score = arrived * optimal / np.clip(taken, 2.0 * optimal, 8.0 * optimal)
    return float(score.mean()), float(arrived.mean()), float(touched.mean()), int(steps.sum())


def search(policy: str, bank: tuple[GoalScenario, ...], trials: int, seed: int) -> dict[str, Any]:
    """Returns the best set that was found, its score and the frames driven; says each that is kept."""
    random = np.random.default_rng(seed)
    gains, ranges = START[policy], RANGES[policy]
    best, *_, frames = drive(policy, gains, bank)
    for number in range(1, trials + 1):
        changed = dict(gains)
        count = min(int(random.integers(CHANGED[0], CHANGED[1] + 1)), len(ranges))
        for name in random.choice(list(ranges), count, replace=False):
            low, high = ranges[name]
            value = changed[name] + WIDTH * (high - low) * random.normal()
            changed[name] = round(float(np.clip(value, low, high)), 4)
        score, arrived, touched, more = drive(policy, changed, bank)
        frames += more
        if score >= best and not touched:
            gains, best = changed, score
            click.echo(f"{number} of {trials}: score {best:.4f}, success {100 * arrived:.0f} %: {json.dumps(gains)}")
    return {"gains": gains, "score": best, "frames": frames}


@click.command("barn_gains", cls=OneLineErrors, context_settings={"help_option_names": ["-h", "--help"]})
@click.option("--policy", type=click.Choice(list(START)), default="scan_planner", show_default=True)
@click.option("--trials", type=click.IntRange(min=0), default=40, show_default=True, help="Sets to try.")
@click.option("--worlds", type=click.IntRange(min=2), default=48, show_default=True)
@click.option("--seed", type=click.IntRange(min=0), default=1, show_default=True, help="Of the search.")
@click.option("--out", default=FILE, show_default=True, metavar="FILE", help="The gains file, {} for the policy.")
def main(policy: str, trials: int, worlds: int, seed: int, out: str) -> None:
    """Searches, drives what was found in as many other worlds, and writes the gains with both scores."""
    last = FIRST_SEED + worlds
    bank = tuple(map(cellular_world, range(FIRST_SEED, last)))
    found = search(policy, bank, trials, seed)
    others = tuple(map(cellular_world, range(last, last + worlds)))
    sets = {"chosen": found["gains"], "default": policies.cruising(policy, {}, ASKED)}
    scores = {name: drive(policy, gains, others) for name, gains in sets.items()}
    for name, (score, arrived, touched, _) in scores.items():
        told = f"success {100 * arrived:.0f} %, contact {100 * touched:.0f} %"
        click.echo(f"{name}, in {worlds} other worlds: score {score:.4f}, {told}")
    content = {
        "policy": policy,
        "suite": "goal-obstacles",
        "robot": "jackal",
        "sheet": ROBOTS["jackal"].digest,
        "speed": ASKED,
        "level": "none",
        "actuators": "lagged",
        "chosen": "hand" if found["gains"] == START[policy] else "search",
        "gains": found["gains"],
        "frames": SPENT[policy] + found["frames"],
        "validation": {
            name: {
                "failures": round(worlds * (1.0 - arrived)),
                "episodes": worlds,
                "off_pace": 0,  # it asks for no speed but at most the challenge's
                "quality": round(-score, 6),
            }
            for name, (score, arrived, _, _) in scores.items()
        },
        "searched_on": {
            "split": f"cellular worlds, seeds {FIRST_SEED} to {last - 1}",
            "scenarios": worlds,
            "sha256": digest(bank),
            "validation_sha256": digest(others),
        },
        "seed": seed,
        "command": f"python benchmarks/studies/barn_gains.py --policy {policy} --trials {trials} --worlds {worlds} "
        f"--seed {seed}",
    }
    file = Path(out.format(policy))
    write_whole(file, (json.dumps(content, indent=2) + "\n").encode())
    click.echo(f"Written to {file}")


if __name__ == "__main__":
    main()
