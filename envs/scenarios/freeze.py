"""Writes frozen splits: `python -m wayfield.envs.scenarios.freeze FAMILY ...`, for developers, some minutes.

`--split claims` writes the split of that name alone, which has a file of its own; without, the others are written.

A seed is taken when what it makes can be done: the largest robot has room at start and goal and a proven way past all
that stands, which is not too long. Freezing again after a change of a family changes what published tables are about.
"""

import json
import pathlib
import re
from typing import Any

import click

from wayfield.envs.scenarios import splits
from wayfield.envs.tasks.specs import EVERY, TaskSpec
from wayfield.system.command_line import Choice, OneLineErrors
from wayfield.system.storage import write_whole

# no seed is in two splits
_FIRST_SEEDS = {"train": 0, "validation": 1_000_000, "test": 2_000_000, "claims": 3_000_000}
_CLAIMS = ("claims",)


def frozen(spec: TaskSpec, family: str, name: str) -> dict[str, Any]:
    """Returns what the split file says about one split of a family."""
    seeds: list[int] = []
    scenarios: list[Any] = []
    seed = _FIRST_SEEDS[name]
    while len(seeds) < splits.SPLITS[name]:
        scenario = spec.families[family](seed)
        if spec.feasible(scenario):
            # what claims are about is kept to the digit that their hash knows
            quantity = spec.quantity(scenario)
            object.__setattr__(scenario, "quantity", round(quantity, 6) if name in _CLAIMS else quantity)
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
    type=Choice("FAMILY", (name for spec in EVERY.values() for name in spec.families)),
    nargs=-1,
    required=True,
)
@click.option("--split", "only", type=Choice("--split", _CLAIMS), help="Only this one, which has a file of its own.")
@click.option("--force", is_flag=True, help="Also families that are frozen: tables made with them are of no use then.")
def main(families: tuple[str, ...], only: str | None, force: bool) -> None:
    """Writes the splits of each FAMILY into the split file of its task."""
    names = [name for name in splits.SPLITS if (name == only if only else name not in _CLAIMS)]
    files = {task: splits.file_of(task, names[0]) for task in EVERY}
    written = {task: _written(file) for task, file in files.items()}
    for family in families:
        if not force and any(family in of_task for of_task in written.values()):
            raise click.UsageError(f"FAMILY {family!r} is frozen; --force freezes it again, which ends all its tables")
    for task, spec in EVERY.items():
        for family in (name for name in spec.families if name in families):
            written[task][family] = {name: frozen(spec, family, name) for name in names}
            in_order = {each: written[task][each] for each in spec.families if each in written[task]}
            write_whole(files[task], _text(task, in_order).encode())
            print(task, family, flush=True)


def _written(file: pathlib.Path) -> dict[str, Any]:
    """Returns what a split file holds, by family; nothing where there is none."""
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
