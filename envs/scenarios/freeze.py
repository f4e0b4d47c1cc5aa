"""Writes frozen splits: `python -m wayfield.envs.scenarios.freeze FAMILY ...`, for developers, some minutes.

A seed is taken when what it makes can be done: the largest robot has room at start and goal and a proven way past all
that stands, which is not too long. Freezing again after a change of a family changes what published tables are about.
"""

import json
import re
from typing import Any

import click

from wayfield.envs.command_line import Choice, OneLineErrors
from wayfield.envs.scenarios import splits
from wayfield.envs.scenarios.tasks import FAMILIES, TASKS, TaskSpec
from wayfield.envs.storage import write_whole

_FIRST_SEEDS = {"train": 0, "validation": 1_000_000, "test": 2_000_000}  # no seed is in two splits


def frozen(spec: TaskSpec, family: str, name: str) -> dict[str, Any]:
    """Returns what the split file says about one split of a family."""
    seeds: list[int] = []
    scenarios: list[Any] = []
    seed = _FIRST_SEEDS[name]
    while len(seeds) < splits.SPLITS[name]:
        scenario = spec.families[family](seed)
        if spec.feasible(scenario):
            object.__setattr__(scenario, "quantity", spec.quantity(scenario))
            object.__setattr__(scenario, "tier", spec.tier(scenario.quantity))
            scenarios.append(scenario)
            seeds.append(seed)
        seed += 1
    return {
        "sha256": splits.digest(scenarios),
        "seeds": seeds,
        "tiers": [scenario.tier for scenario in scenarios],
        "quantities": [scenario.quantity for scenario in scenarios],
    }


@click.command("freeze", cls=OneLineErrors)
@click.argument(
    "families",
    metavar="FAMILY...",
    type=Choice("FAMILY", (name for families in FAMILIES.values() for name in families)),
    nargs=-1,
    required=True,
)
@click.option("--force", is_flag=True, help="Also families that are frozen: tables made with them are of no use then.")
def main(families: tuple[str, ...], force: bool) -> None:
    """Writes the splits of each FAMILY into the split file of its task."""
    written = {task: _written(task) for task in TASKS}
    for family in families:
        if not force and any(family in of_task for of_task in written.values()):
            raise click.UsageError(f"FAMILY {family!r} is frozen; --force freezes it again, which ends all its tables")
    for task, spec in TASKS.items():
        for family in (name for name in spec.families if name in families):
            written[task][family] = {name: frozen(spec, family, name) for name in splits.SPLITS}
            in_order = {each: written[task][each] for each in spec.families if each in written[task]}
            write_whole(splits.FOLDER / f"{task}.json", _text(task, in_order).encode())
            print(task, family, flush=True)


def _written(task: str) -> dict[str, Any]:
    """Returns what the split file of a task holds, by family; nothing where there is none."""
    file = splits.FOLDER / f"{task}.json"
    try:
        return dict(json.loads(file.read_text(encoding="utf-8"))["families"])
    except FileNotFoundError:
        return {}
    except (LookupError, TypeError, ValueError) as error:
        raise click.ClickException(f"{file} is damaged: {type(error).__name__}: {error}") from None


def _text(task: str, families: dict[str, Any]) -> str:
    """Returns the text of a split file, a line a list: a change is then seen for what it is."""
    text = json.dumps({"task": task, "families": families}, indent=1)
    return re.sub(r"\n {5,}|\n {4}(?=])", "", text) + "\n"


if __name__ == "__main__":
    main()
