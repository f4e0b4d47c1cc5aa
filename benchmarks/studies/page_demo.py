"""Makes the demo page, the simulator without a run: python benchmarks/studies/page_demo.py"""

from collections.abc import Collection
from pathlib import Path

import click
from gymnasium.utils.seeding import np_random
from page_recipes import AGENT, contest_of, decisions

from wayfield.benchmarks.entrants.documents import FLOOR
from wayfield.benchmarks.report.page import Content, made, rendered
from wayfield.benchmarks.report.worlds import DRAWS, World, plain
from wayfield.envs.scenarios import splits
from wayfield.envs.scenarios.goal_families import LARGEST_HULL
from wayfield.envs.tasks.specs import CROWDS, EVERY
from wayfield.system.command_line import OneLineErrors
from wayfield.system.storage import write_whole

DEMO = "docs/demo.html"
BUDGET = 2_500_000  # bytes
SEEDS = 5  # scenarios of each family; of those of several bodies FEW, of at most SOME bodies
FEW, SOME = 2, 33
FIRST = "goal: clutter_10"
AGENTS_THERE = ("team_guided",)  # of those trained among bodies: the others' networks are too large for the budget


def worlds(families: Collection[str] = ()) -> list[World]:
    """Returns the first scenarios of the training split of some families, or of all that the page can drive in."""
    found = []
    for spec in EVERY.values():
        for family in spec.families:
            if family in spec.needs_pymunk or (families and family not in families):
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
    """Returns who enters a contest and cannot drive in the page, by the kind of its scenarios; floors aside."""
    found = {}
    for contest in map(contest_of, EVERY):
        able = {*decisions(contest.spec.name), AGENT, *AGENTS_THERE, *FLOOR}
        found[contest.spec.kind] = [name for name in contest.policies if name not in able]
    return found


@click.command("demo", cls=OneLineErrors)
@click.option("--out", type=click.Path(path_type=Path), default=DEMO, show_default=True, help="The file.")
def main(out: Path) -> None:
    """Writes the page on which one drives against the policies, in scenarios of every family or of one's own."""
    content = Content(worlds=worlds())
    content.sentences.append(
        "Drive a wheeled robot against classical controllers and trained agents, in the package's own simulator: the "
        "same compiled code, in WebAssembly. Choose a family and a seed, let a policy drive, take over at any moment, "
        "move obstacles, goal or path, switch actuators and disturbances, save the scenario. Teams drive there too, "
        "each robot to a goal of its own, and people walk by their laws."
    )
    how = made("python benchmarks/studies/page_demo.py", content)
    told = {"demo": {"first": FIRST, "unable": unable()}}
    text = rendered("wayfield: drive", content, how, BUDGET, told, AGENTS_THERE)
    if len(text.encode()) > BUDGET:
        raise click.ClickException(f"the page has {len(text.encode()):,} bytes; at most {BUDGET:,} may be")
    write_whole(out, text.encode())
    print(f"{out}: {len(text.encode()):,} bytes")


if __name__ == "__main__":
    main()
