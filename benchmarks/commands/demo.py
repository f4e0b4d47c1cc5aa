"""The simulator as a page without a run: `wayfield demo`."""

import html
import os
import tempfile
import webbrowser
from collections.abc import Collection
from pathlib import Path
from typing import Any

import click
from gymnasium.utils.seeding import np_random

from wayfield.benchmarks.contests import ALL_CONTESTS
from wayfield.benchmarks.entrants.documents import FLOOR
from wayfield.benchmarks.report.page import Content, kernel_part, made, rendered
from wayfield.benchmarks.report.worlds import DRAWS, IN_PAGE, World, plain
from wayfield.envs.robots import ROBOTS
from wayfield.envs.scenarios import splits
from wayfield.envs.scenarios.goal_families import LARGEST_HULL
from wayfield.envs.tasks.specs import CROWDS
from wayfield.system.command_line import OneLineErrors
from wayfield.system.storage import write_whole

BUDGET = 3_000_000  # bytes
SEEDS = 5  # scenarios of each family; of those of several bodies FEW, of at most SOME bodies
FEW, SOME = 2, 33
ABOUT = "Drive against controllers and trained networks, draw them a path, put things in their way. No installation."
SITE = "WAYFIELD_SITE"  # environment variable: the address that the site is published at, which links lead to
TITLE = "wayfield: race robots in your browser"
AGENTS_THERE = ("team_guided", "team_scan", "people_free", "any_robot")  # of those that are left out elsewhere
ABSENT = (
    "The robots mir100 and husky are absent: these scenes have no room for their hulls. Jackal drives alone, in scenes "
    "that are made larger for it. Tracking a reference in time is absent: the page has no kernels of that task."
)
# what the page opens on, as a link holds it
_CALM = {"actuators": "lagged", "disturbance": "none"}
_SIDES = ("people_free (trained)", "dwa")
OPENING = {
    **{"v": 1, "robot": "omni3", **_CALM, "policy": _SIDES[0], "place": {"family": "people: lanes_24", "seed": 0}},
    **{"runs": [{"policy": each} for each in _SIDES], "step": 0, "beside": _SIDES[1]},
}
SENTENCE = "One robot among 24 people. In this scene a trained network gets through and DWA, a controller, does not."
# races by hand, the same for everybody: what each is called, its scene and its robot
CHALLENGES = [
    {"name": name, "family": family, "seed": seed, "robot": robot}
    for name, family, seed, robot in (
        ("open field", "goal: open_fields", 0, "p3dx"),
        ("wide doors", "goal: doors_wide", 0, "p3dx"),
        ("few obstacles", "goal: clutter_5", 0, "p3dx"),
        ("oncoming traffic", "goal: moving_head_on", 0, "p3dx"),
        ("corridors", "goal: corridors", 0, "p3dx"),
        ("dead end", "goal: u_traps_15", 0, "p3dx"),
        ("people crossing", "people: crossing_flow_8", 0, "omni3"),
        ("moving crowd", "goal: moving_crowd", 0, "p3dx"),
        ("narrow doors", "goal: doors_narrow", 0, "p3dx"),
        ("parking", "dock: open", 0, "p3dx"),
    )
]


def worlds(families: Collection[str] = ()) -> list[World]:
    """Returns the first scenarios of the test split of some families, or of all that the page can drive in."""
    found = []
    for spec in IN_PAGE.values():
        for family in splits.members(spec.name):
            if spec.families[family].needs_forces or (families and family not in families):
                continue
            seeds = FEW if spec.name in CROWDS else SEEDS
            for seed, scenario in enumerate(splits.split(spec.name, family, "test")[:seeds]):
                world = plain(scenario, spec.clock)
                if "bodies" in world and ("walks" not in world or len(world["bodies"]) >= SOME):
                    continue
                draws = np_random(seed)[0].random(DRAWS).tolist()
                found.append(world | {"draws": draws, "seed": seed, "hull": LARGEST_HULL})
    return found


def unable() -> dict[str, list[str]]:
    """Returns who enters a task's contest and cannot drive in the page, by the kind of its scenarios; floors aside."""
    able_there = kernel_part(set(ROBOTS), AGENTS_THERE)[0]["pilots"]
    able = {(key.split()[0], key.split()[3]) for key in able_there} | {
        (spec, name) for spec in IN_PAGE for name in FLOOR
    }
    entered = {
        contest.spec.kind: dict.fromkeys(contest.policies, contest.spec.name)
        for contest in reversed(list(ALL_CONTESTS.values()))  # the task's own contest comes first
    }
    return {kind: [name for name, task in who.items() if (task, name) not in able] for kind, who in entered.items()}


@click.command("demo", cls=OneLineErrors)
@click.option("--out", type=click.Path(path_type=Path), help="Write the page to this file instead of opening it.")
def main(out: Path | None) -> None:
    """Opens the simulator in the browser: drive a robot against controllers and trained agents.

    The page is one file of 3 MB that needs no network.
    """
    text = page()
    file = out or Path(tempfile.mkdtemp(prefix="wayfield-")) / "demo.html"
    write_whole(file, text.encode())
    print(f"{file}: {len(text.encode()):,} bytes")
    if out is None and not webbrowser.open(file.resolve().as_uri()):
        raise click.ClickException(f"no browser was found: open {file} in one")


def site() -> str:
    """Returns the address that the site is published at, or ""."""
    return os.environ.get(SITE, "").rstrip("/")


def preview(address: str) -> str:
    """Returns the tags by which a link to the page is shown elsewhere, with a picture where the site is published."""
    told = {"title": TITLE, "description": ABOUT, "type": "website"}
    if address:
        told |= {"url": f"{address}/demo.html", "image": f"{address}/demo.png"}
    tags = [f'<meta property="og:{name}" content="{html.escape(each)}">' for name, each in told.items()]
    return "\n".join([f'<meta name="description" content="{html.escape(ABOUT)}">', *tags])


def told() -> dict[str, Any]:
    """Returns what the page is told besides its scenes; links lead to the site where its address is known."""
    return {
        "opening": OPENING,
        "sentence": SENTENCE,
        "free": CHALLENGES[2],
        "challenges": CHALLENGES,
        "unable": unable(),
        "absent": ABSENT,
        "site": f"{site()}/demo.html" if site() else "",
    }


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
    text = rendered(
        TITLE, content, made("wayfield demo", content), BUDGET, {"demo": told()}, AGENTS_THERE, preview(site())
    )
    if len(text.encode()) > BUDGET:
        raise ValueError(f"the page has {len(text.encode()):,} bytes; at most {BUDGET:,} may be")
    return text


if __name__ == "__main__":
    main()
