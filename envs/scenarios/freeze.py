"""Writes frozen splits: `python -m wayfield.envs.scenarios.freeze FAMILY ...`, for developers, some minutes.

All splits of a family are written. What "all" means stays the same, and with it what contests are about, until `--all
TASK` makes another version of it, of all families that are frozen.

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
        scenario = spec.families[family].make(seed)
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
)
@click.option("--all", "task", type=Choice("--all", EVERY), help='A new version of "all" of this task.')
@click.option("--force", is_flag=True, help="Also families that are frozen: tables made with them are of no use then.")
def main(families: tuple[str, ...], task: str | None, force: bool) -> None:
    """Writes all splits of each FAMILY into the split files of its task."""
    if not families and task is None:
        raise click.UsageError("name at least one FAMILY, or a task with --all")
    written = {
        spec.name: {file: _written(file) for file in {splits.file_of(spec.name, name) for name in splits.SPLITS}}
        for spec in EVERY.values()
    }
    for family in families if not force else ():
        if any(all(family in content["families"] for content in of_task.values()) for of_task in written.values()):
            raise click.UsageError(f"FAMILY {family!r} is frozen; --force freezes it again, which ends all its tables")
    for spec in EVERY.values():
        files = {name: splits.file_of(spec.name, name) for name in splits.SPLITS}
        contents = written[spec.name]
        for family in (each for each in families if each in spec.families):
            made = {name: frozen(spec, family, name) for name in files}
            for file, content in contents.items():
                if force or family not in content["families"]:
                    content["families"][family] = {name: made[name] for name in files if files[name] == file}
                content["families"] = {each: content["families"][each] for each in _in_order(spec, content)}
                write_whole(file, _text(content).encode())
            print(spec.name, family, flush=True)
        if spec.name == task:
            file = files["train"]
            contents[file].setdefault("all", []).append(_in_order(spec, contents[file]))
            write_whole(file, _text(contents[file]).encode())
            print(f"{task}: all is version {len(contents[file]['all'])}")


def _in_order(spec: TaskSpec, content: dict[str, Any]) -> list[str]:
    """Returns the families that a split file holds, in the order of the task."""
    return [each for each in spec.families if each in content["families"]]


def _written(file: pathlib.Path) -> dict[str, Any]:
    """Returns what a split file holds; no families where there is none."""
    try:
        content = dict(json.loads(file.read_text(encoding="utf-8")))
        content["families"] = dict(content["families"])
    except FileNotFoundError:
        return {"task": file.stem.removesuffix("_claims"), "families": {}}
    except (LookupError, TypeError, ValueError) as error:
        raise click.ClickException(f"{file} is damaged: {type(error).__name__}: {error}") from None
    return content


def _text(content: dict[str, Any]) -> str:
    """Returns the text of a split file, a line a list: a change is then seen for what it is."""
    text = json.dumps({"task": content["task"], "families": content["families"]}, indent=1)
    text = re.sub(r"\n {5,}|\n {4}(?=])", "", text)
    if "all" in content:
        versions = ",\n  ".join(json.dumps(each) for each in content["all"])
        text = text.replace('\n "families"', f'\n "all": [\n  {versions}\n ],\n "families"', 1)
    return text + "\n"


if __name__ == "__main__":
    main()
