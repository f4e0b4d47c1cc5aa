"""The simulator as a page without a run: `wayfield demo`."""

import datetime
import html
import os
import re
import tempfile
import webbrowser
from collections.abc import Collection
from importlib.metadata import version
from pathlib import Path
from typing import Any

import click
from gymnasium.utils.seeding import np_random

from wayfield.benchmarks.contests import ALL_CONTESTS
from wayfield.benchmarks.entrants.documents import FLOOR
from wayfield.benchmarks.report.page import Content, commit, kernel_part, rendered
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
    "that are made larger for it. Trajectory tracking is absent, and its best controllers tv_lqr, timed_ilqr and "
    "timed_mpc with it: that task is not compiled for the page (timed_mpc also needs OSQP)."
)
# what the page opens on, as a link holds it
_CALM = {"actuators": "lagged", "disturbance": "none"}
_SIDES = ("people_free (trained)", "dwa")
OPENING = {
    **{"v": 2, "robot": "omni3", **_CALM, "policy": _SIDES[0], "place": {"family": "people: lanes_24", "seed": 0}},
    **{"runs": [{"policy": each} for each in _SIDES], "step": 0, "beside": _SIDES[1]},
}
SENTENCE = "Above, a network that learned; below, a hand-written program: it crashes. Can you do better?"
FOUND = (
    "In 180 scenes with people, the network that the page opens on arrives in 88 % and ORCA, a controller with gains "
    "found by a search, in 84 %: no significant difference."
)
# races by hand, the same for everybody: what each is called, its scene and its robot
CHALLENGES = [
    {"name": name, "family": family, "seed": seed, "robot": robot}
    for name, family, seed, robot in (
        ("open field", "goal: open_fields", 4, "p3dx"),
        ("wide door", "goal: doors_wide", 4, "p3dx"),
        ("few obstacles", "goal: clutter_5", 1, "p3dx"),
        ("oncoming traffic", "goal: moving_head_on", 0, "p3dx"),
        ("corridors", "goal: corridors", 1, "p3dx"),
        ("dead end", "goal: u_traps_15", 0, "p3dx"),
        ("people in a corridor", "people: lanes_12", 0, "omni3"),
        ("moving crowd", "goal: moving_crowd", 0, "p3dx"),
        ("narrow door", "goal: doors_narrow", 1, "p3dx"),
        ("parking", "dock: open", 0, "p3dx"),
        ("24 people, both ways", "people: lanes_24", 0, "omni3"),  # where the page opens
    )
]

# what the page calls the scenes of each family; {} is the number at the end of its name
SCENES = {
    "path: straights": "straight line",
    "path: circles": "circle",
    "path: clothoids": "smooth bends",
    "path: s_curves_wide": "gentle S-bends",
    "path: s_curves_medium": "S-bends",
    "path: s_curves_tight": "tight S-bends",
    "path: figure_eights_gerono": "figure eight",
    "path: figure_eights_tangent": "figure eight of two circles",
    "path: polylines_90": "square corners",
    "path: polylines_120": "sharp corners",
    "path: polylines_150": "hairpin corners",
    "path: splines": "winding line",
    "path: circuits": "race track",
    "goal: open_fields": "open field",
    "goal: collinear_exact": "obstacle straight ahead",
    "goal: collinear_1mm": "obstacle ahead, 1 mm to the side",
    "goal: collinear_2cm": "obstacle ahead, 2 cm to the side",
    "goal: near_goal": "obstacles close to the star",
    "goal: clutter_5": "few obstacles",
    "goal: clutter_10": "more obstacles",
    "goal: clutter_15": "many obstacles",
    "goal: doors_narrow": "narrow door",
    "goal: doors_medium": "a door",
    "goal: doors_wide": "wide door",
    "goal: u_traps_05": "shallow dead end",
    "goal: u_traps_15": "dead end",
    "goal: u_traps_30": "deep dead end",
    "goal: corridors": "corridors",
    "goal: rooms": "rooms",
    "goal: moving_crossing": "crossing traffic",
    "goal: moving_head_on": "oncoming traffic",
    "goal: moving_overtaking": "slow traffic ahead",
    "goal: moving_crowd": "moving crowd",
    "dock: open": "parking",
    "dock: behind": "parking, star behind you",
    "dock: wall": "parking with your back to a wall",
    "dock: berth": "parking between two boxes",
    "dock: moving": "parking behind traffic",
    "team: head_on_exact": "two robots meet head-on",
    "team: head_on_1mm": "two robots meet, 1 mm off centre",
    "team: head_on_2cm": "two robots meet, 2 cm off centre",
    "team: crossing": "{} robots at a crossing",
    "team: circle_exact": "{} robots swap sides",
    "team: circle": "{} robots swap sides, uneven circle",
    "team: open": "{} robots criss-cross",
    "team: doorway": "{} robots through one door",
    "team: corridor": "{} robots in a corridor",
    "team: intersection": "{} robots where corridors cross",
    "team: bottleneck": "{} robots leave by one door",
    "team: rooms": "{} robots from room to room",
    "people: crowdnav": "{} people swap sides",
    "people: attngraph": "{} people cross a square",
    "people: lanes": "{} people in a corridor",
    "people: crossing_flow": "{} people cross your way",
    "people: overtaking": "slow people ahead",
    "people: head_on": "people come towards you",
    "people: blind_corner": "people behind a corner",
    "people: queue_at_door": "a crowd ahead of you at a door",
    "people: standing_groups": "groups stand and talk",
    "people: crossing_streams": "{} people in two crossing streams",
    "people: queue_against": "a crowd comes through the door at you",
    "people: walking_groups": "groups walk",
    "people: reactions": "five people who react differently",
}

# what the page calls each policy, and what it does, in a phrase
NAMES = {
    "ppo": ("trained network (PPO)", "copied a controller, then learned by trial and error to drive alone"),
    "people_free": (
        "trained network (people)",
        "learned by trial and error to correct ORCA, a rule that dodges people",
    ),
    "team_guided": ("trained network (team)", "learned by trial and error to correct ORCA, which keeps it clear"),
    "team_scan": ("trained network (team, laser)", "learned by trial and error, sees by its laser alone"),
    "hybrid": ("planner with network", "a planner finds the way, a network drives along it"),
    "any_robot": ("network for any robot", "a copy of VFH+ for any base by its data sheet, behind a planner"),
    "astar_tracker": ("A* planner", "is given the map, drives the shortest way"),
    "scan_planner": ("laser planner", "plans on a map of what its laser has seen"),
    "vfh_plus": ("vector histogram", "steers to the cheapest free direction (VFH+)"),
    "dwa": ("dynamic window", "takes the best arc of the next seconds (DWA)"),
    "mppi": ("random plans (MPPI)", "tries random plans, drives the mean of the good ones"),
    "apf_corrected": ("potential field", "the star pulls, obstacles push"),
    "social_force": ("social force", "the star pulls, people and walls push"),
    "orca": ("ORCA", "takes the nearest velocity that hits nothing for some seconds"),
    "orca_team": ("ORCA", "steps aside half as far as it must, and trusts others to do the rest"),
    "orca_team_map": ("ORCA with map", "dodges so along the shortest way on the map"),
    "waypoint": ("straight there", "goes straight to the pose, the slower the nearer"),
    "polar": ("polar steering", "lets distance and bearing to the pose decay together"),
    "smooth_pose": ("smooth curve", "drives a curve that ends in the right heading"),
    "smooth_pose_backward": ("smooth curve, both ways", "drives such a curve forward or backward"),
    "reeds_shepp": ("Reeds-Shepp", "drives the shortest way of a car, forward and backward"),
    "reeds_shepp_scan": ("Reeds-Shepp with laser", "drives such a way around what its laser shows"),
    "pure_pursuit": ("pure pursuit", "drives an arc to a point of the path ahead"),
    "regulated_pure_pursuit": ("regulated pursuit", "pure pursuit that slows down for bends"),
    "stanley": ("Stanley", "steers a virtual front wheel onto the path"),
    "lqr": ("LQR", "feeds path errors back by optimal gains"),
    "ilqr": ("iterative LQR", "plans the next seconds anew in every step"),
}

# who is first in the published results of each kind of scene, of those that the page drives
BEST = {
    "path": ["ilqr", "lqr", "regulated_pure_pursuit"],
    "goal": ["astar_tracker", "orca", "any_robot"],
    "dock": ["polar", "smooth_pose_backward", "reeds_shepp"],
    "team": ["scan_planner"],  # the best agent there, hybrid, is not in the page
    "people": ["people_free", "orca_team"],
}


def worlds(families: Collection[str] = ()) -> list[World]:
    """Returns the first scenarios of the test split of some families, or of all that the page can drive in."""
    worlds_drawn = []
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
                worlds_drawn.append(world | {"draws": draws, "seed": seed, "hull": LARGEST_HULL})
    return worlds_drawn


def scenes() -> dict[str, str]:
    """Returns what the scenes of each family of the page are called."""
    calls = {}
    for key in (f"{spec.kind}: {name}" for spec in IN_PAGE.values() for name in spec.families):
        stem, _, count = key.rpartition("_")
        if called := SCENES.get(key) or SCENES.get(stem):
            calls[key] = called.format(count)
    return calls


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
    if out is not None and out.suffix.lower() not in (".html", ".htm"):
        raise click.UsageError(f"--out {str(out)!r} must end in .html")
    text = page()
    file = out or Path(tempfile.mkdtemp(prefix="wayfield-")) / "demo.html"
    write_whole(file, text.encode())
    print(f"{file}: {len(text.encode()):,} bytes")
    if out is None and not webbrowser.open(file.resolve().as_uri()):
        raise click.ClickException(f"no browser was found: open {file} in one")


def site() -> str:
    """Returns the address that the site is published at, or ""; click.UsageError if it is no web address."""
    address = os.environ.get(SITE, "").rstrip("/")
    if address and not address.startswith(("https://", "http://")):
        raise click.UsageError(f"{SITE} is {address!r}; it must begin with https:// or http://")
    return address


def preview(address: str) -> str:
    """Returns the tags by which a link to the page is shown elsewhere, with a picture where the site is published."""
    tags_of = {"title": TITLE, "description": ABOUT, "type": "website"}
    if address:
        tags_of |= {"url": f"{address}/demo.html", "image": f"{address}/demo.png"}
    tags = [f'<meta property="og:{name}" content="{html.escape(each)}">' for name, each in tags_of.items()]
    return "\n".join([f'<meta name="description" content="{html.escape(ABOUT)}">', *tags])


def setup() -> dict[str, Any]:
    """Returns what the page is told besides its scenes; links lead to the site where its address is known."""
    return {
        "opening": OPENING,
        "sentence": SENTENCE,
        "challenges": CHALLENGES,
        "scenes": scenes(),
        "names": NAMES,
        "best": BEST,
        "robots": {name: re.split(r"[,(]", robot.title)[0].strip() for name, robot in ROBOTS.items()},
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
        "Race wheeled robots by hand against controllers and trained networks, or watch them: alone, in teams, among "
        "people. Draw them a path, put things in their way, give them other motors or another robot. All is computed "
        "in this page, by the compiled code of the Python package wayfield: the same run, to the last bit. "
        "Your best times stay in this browser; nothing is sent anywhere."
    )
    content.sentences.append(
        "Controllers compute each command by a rule or a plan that somebody wrote; the list of robots says what each "
        "does. The networks learned by trial and error (reinforcement learning, PPO), in millions of simulated steps, "
        "in other scenes than those here. Most began as copies of a controller and now drive alone. Among people, and "
        "in one of the two for teams, the network corrects a controller, ORCA, which drives along with it. "
        f"“{NAMES['any_robot'][0]}” in that list is still the copy of a controller. {FOUND}"
    )
    how = [["version", version("wayfield")], ["commit", (commit() or "not known").replace("-dirty", ", and changes")]]
    how += [["licence", "MIT"], ["made", datetime.date.today().isoformat()]]
    how += [["address", f"{site()}/demo.html"], ["documentation", f"{site()}/"]] if site() else []
    text = rendered(TITLE, content, how, BUDGET, {"demo": setup()}, AGENTS_THERE, preview(site()))
    if len(text.encode()) > BUDGET:
        raise ValueError(f"the page has {len(text.encode()):,} bytes; at most {BUDGET:,} may be")
    return text


if __name__ == "__main__":
    main()
