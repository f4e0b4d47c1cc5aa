"""The simulator as a page without a run: `wayfield demo`."""

import tempfile
import webbrowser
from collections.abc import Collection
from pathlib import Path

import click
from gymnasium.utils.seeding import np_random

from wayfield.benchmarks.contests import ALL_CONTESTS
from wayfield.benchmarks.entrants.documents import FLOOR
from wayfield.benchmarks.report.page import Content, kernel_part, made, rendered
from wayfield.benchmarks.report.worlds import DRAWS, World, plain
from wayfield.envs.robots import ROBOTS
from wayfield.envs.scenarios import splits
from wayfield.envs.scenarios.goal_families import LARGEST_HULL
from wayfield.envs.tasks.specs import CROWDS, EVERY
from wayfield.system.command_line import OneLineErrors
from wayfield.system.storage import write_whole

BUDGET = 2_500_000  # bytes
SEEDS = 5  # scenarios of each family; of those of several bodies FEW, of at most SOME bodies
FEW, SOME = 2, 33
FIRST = "goal: clutter_10"
AGENTS_THERE = ("team_guided",)  # of those trained among bodies: the others' networks are too large for the budget


def worlds(families: Collection[str] = ()) -> list[World]:
    """Returns the first scenarios of the training split of some families, or of all that the page can drive in."""
    found = []
    for spec in EVERY.values():
        for family in splits.members(spec.name):
            if spec.families[family].needs_pymunk or (families and family not in families):
                continue
            seeds = FEW if spec.name in CROWDS else SEEDS
            for seed, scenario in enumerate(splits.split(spec.name, family, "train")[:seeds]):
                world = plain(scenario, spec.clock)
                if "bodies" in world and ("walks" not in world or len(world["bodies"]) >= SOME):
                    continue
                draws = np_random(seed)[0].random(DRAWS).tolist()
                found.append(world | {"draws": draws, "seed": seed, "hull": LARGEST_HULL})
    return found


def unable() -> dict[str, list[str]]:
    """Returns who enters a task's contest and cannot drive in the page, by the kind of its scenarios; floors aside."""
    told = kernel_part(set(ROBOTS), AGENTS_THERE)[0]["pilots"]
    able = {(key.split()[0], key.split()[3]) for key in told} | {(spec, name) for spec in EVERY for name in FLOOR}
    entered = {
        contest.spec.kind: dict.fromkeys(contest.policies, contest.spec.name)
        for contest in reversed(list(ALL_CONTESTS.values()))  # the task's own contest comes first
    }
    return {kind: [name for name, task in who.items() if (task, name) not in able] for kind, who in entered.items()}


@click.command("demo", cls=OneLineErrors)
@click.option("--out", type=click.Path(path_type=Path), help="Write the page to this file instead of opening it.")
def main(out: Path | None) -> None:
    """Opens the simulator in the browser: drive a robot against controllers and trained agents.

    The page is one file of 2.4 MB that needs no network.
    """
    text = page()
    file = out or Path(tempfile.mkdtemp(prefix="wayfield-")) / "demo.html"
    write_whole(file, text.encode())
    print(f"{file}: {len(text.encode()):,} bytes")
    if out is None and not webbrowser.open(file.resolve().as_uri()):
        raise click.ClickException(f"no browser was found: open {file} in one")


def page() -> str:
    """Returns the page, with the first scenarios of every family.

    Raises:
        ValueError: if it is larger than its budget.
    """
    content = Content(worlds=worlds())
    content.sentences.append(
        "Drive a wheeled robot against classical controllers and trained agents, in the package's own simulator: the "
        "same compiled code, in WebAssembly. Choose a family and a seed, let a policy drive, take over at any moment, "
        "move obstacles, goal or path, switch actuators and disturbances, save the scenario. Teams drive there too, "
        "each robot to a goal of its own, and people walk by their laws."
    )
    told = {"demo": {"first": FIRST, "unable": unable()}}
    text = rendered("wayfield: drive", content, made("wayfield demo", content), BUDGET, told, AGENTS_THERE)
    if len(text.encode()) > BUDGET:
        raise ValueError(f"the page has {len(text.encode()):,} bytes; at most {BUDGET:,} may be")
    return text


if __name__ == "__main__":
    main()
