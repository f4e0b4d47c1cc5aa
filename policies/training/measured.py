"""Writes into agents' cards what they do elsewhere: `python -m wayfield.policies.training.measured FOLDER ...`

Each agent drives the validation scenarios with the slow actuators, a path follower also fast, one that follows in time
also under the disturbance moderate, a goal seeker also slowly and fast and what `make` gives who asks for nothing; one
among others drives other fields instead, and among people also at their pace. Beside its validation, it is what an
agent tells of itself where it warns. A path follower's card also says how fast it drives in the mean at a speed input,
so that it can hold the one that it is asked for.
"""

import dataclasses
import functools
import json
import warnings
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import click

from wayfield.envs.tasks.specs import task_spec
from wayfield.policies.learned.agent import CARD, Agent, load_agent, signed
from wayfield.policies.learned.conditions import NewToAgent
from wayfield.policies.training.validation import finite, validate, validated
from wayfield.system.command_line import OneLineErrors
from wayfield.system.storage import write_whole

FAST = 1.05  # m/s, of a path follower, beside the speed that it was validated at
OTHERS = (0.3, 1.0)  # m/s, of a goal seeker
EVERY = 16  # of the training scenarios, that a path follower's mean speed is measured on: four of a family


# fields beside that of the validation
AMONG = {
    "teams": ("doorway_4", "corridor_8", "intersection_8", "bottleneck_8", "rooms_4"),
    "people": ("crowdnav_10", "attngraph_20", "lanes_24", "crossing_flow_16", "queue_at_door"),
}

Condition = tuple[float, dict[str, Any]]  # a requested speed, m/s, and the keyword arguments of the environment


def _of_paths(speed: float, base: Mapping[str, Any]) -> list[Condition]:
    return [(FAST, dict(base))]


def _of_references(speed: float, base: Mapping[str, Any]) -> list[Condition]:
    return [(speed, {**base, "disturbance": "moderate"})]


def _of_goals(speed: float, base: Mapping[str, Any]) -> list[Condition]:
    """Returns other speeds, the greatest with slow actuators too, fewer beams, and what `make` gives.

    That is the scan of the data sheet, and goals with a heading.
    """
    robot = {"robot": base["robot"]} if "robot" in base else {}
    made = {"actuators": "ideal", "num_beams": 32, **robot}
    default = [(speed, {"scenario": scenario, **made}) for scenario in ("discs", "open_field")]
    hard = [(max(OTHERS), {**base, "actuators": "slow"}), (speed, {**base, "num_beams": 32})]
    return [*((other, dict(base)) for other in OTHERS), *hard, *default]


def _of_docks(speed: float, base: Mapping[str, Any]) -> list[Condition]:
    """Returns what `make` gives, on the validation scenarios."""
    robot = {"robot": base["robot"]} if "robot" in base else {}
    return [(speed, {"scenario": "all/validation", "actuators": "ideal", "num_beams": 32, **robot})]


def _among(task: str, paces: Sequence[float], speed: float, base: Mapping[str, Any]) -> list[Condition]:
    """Returns the validation and closer fields, or other people; and the validation at other paces."""
    fields = ((speed, {**base, "scenario": f"{name}/validation"}) for name in AMONG[task])
    return [*((pace, dict(base)) for pace in (speed, *paces)), *fields]


MORE: Mapping[str, Callable[[float, Mapping[str, Any]], list[Condition]]] = {
    "path_following": _of_paths,
    "trajectory_tracking": _of_references,
    "goal_reaching": _of_goals,
    "docking": _of_docks,
    "teams": functools.partial(_among, "teams", ()),
    "people": functools.partial(_among, "people", OTHERS[-1:]),
}  # by task


def conditions(agent: Agent) -> list[Condition]:
    """Returns in what an agent is measured; quicker bases than those that it knows it drives as those."""
    base: dict[str, Any] = dict(agent.card["env_kwargs"])
    task = agent.card["task"]
    slow = [] if task in AMONG else [(agent.speed, base | {"actuators": "slow"})]
    return [*slow, *MORE[task](agent.speed, base)]


def measure(agent: Agent) -> list[dict[str, Any]]:
    """Returns what an agent does in each of its conditions, as its card has it."""
    task, result = task_spec(agent.card["task"]), []
    for speed, kwargs in conditions(agent):
        score = validate(dataclasses.replace(agent, speed=speed), agent.card["env_id"], kwargs, task.clock)
        result.append(measurement(speed, kwargs, dataclasses.asdict(score)))
    return result


def cruises(agent: Agent) -> dict[str, list[list[float]]]:
    """Returns how fast a path follower drives on training paths where a speed is requested, by tier of its actuators.

    Pairs of the requested speed and the mean one, m/s, at the speeds that it was trained at, both rising: a speed at
    which it is no faster than at a lower one is left out.
    """
    task, base, result = task_spec(agent.card["task"]), dict(agent.card["env_kwargs"]), {}
    unpaced = dataclasses.replace(agent, card={**agent.card, "cruises": {}})
    for tier in agent.card["trained_on"]["actuators"]:
        kwargs = base | {"scenario": "all/train", "actuators": tier}
        pairs: list[list[float]] = []
        for speed in sorted(agent.card["trained_on"]["speeds"]):
            score = validate(
                dataclasses.replace(unpaced, speed=speed), agent.card["env_id"], kwargs, task.clock, every=EVERY
            )
            driven = round(score.speed, 4)
            if driven > (pairs[-1][1] if pairs else 0.0):
                pairs.append([speed, driven])
        result[tier] = pairs
    return result


def measurement(speed: float, kwargs: Mapping[str, Any], score: Mapping[str, float]) -> dict[str, Any]:
    """Returns a condition and what was found in it, as a card has it."""
    return {"asked_speed": speed, "env_kwargs": dict(kwargs), **finite(score)}


@click.command("measured", cls=OneLineErrors)
@click.argument("folders", metavar="FOLDER...", nargs=-1, required=True, type=click.Path(path_type=Path))
def main(folders: tuple[Path, ...]) -> None:
    """Measures the agent of each FOLDER, such as results/mine/seed_0/best, and writes it into its card."""
    warnings.simplefilter("ignore", NewToAgent)  # that it is new is why it is measured
    for folder in folders:
        try:
            agent = load_agent(folder, pace_time=0.0, patience=0.0)  # as training validates
        except ValueError as error:
            raise click.UsageError(str(error)) from None
        card = dict(agent.card)
        if task_spec(card["task"]).observes == "path" and card.get("trained_on"):
            card["cruises"] = cruises(agent)
            paced = dataclasses.replace(agent, card=card)
            score = validate(paced, card["env_id"], card["env_kwargs"], task_spec(card["task"]).clock)
            card["validation"] = validated(score)
        result = measure(dataclasses.replace(agent, card=card))
        write_whole(folder / CARD, (json.dumps(signed({**card, "measured": result}), indent=2) + "\n").encode())
        words = ", ".join(
            f"{each['env_kwargs']['scenario']} {each['env_kwargs']['actuators']} {each['asked_speed']:g} m/s: "
            f"{100.0 * each['success']:.0f} %"
            for each in result
        )
        click.echo(f"{folder}: {words}")


if __name__ == "__main__":
    main()
