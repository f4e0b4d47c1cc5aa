"""The simulator in the page: bit for bit the one in Python, with its gains, data sheets and agents."""

import base64
import json
import shutil
import subprocess
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
import page_recipes
import pytest
from gymnasium.utils.seeding import np_random
from numpy.typing import NDArray
from page_recipes import AGENT, contest_of, environment

from wayfield.benchmarks import report
from wayfield.benchmarks.report.page import TABLES
from wayfield.benchmarks.report.worlds import DRAWS, plain
from wayfield.envs.robots import ROBOTS
from wayfield.envs.scenarios import TASKS
from wayfield.policies import Pilot, cruising, make

PAGE = Path(report.__path__[0]) / "page"
RUNNER = Path(__file__).with_name("page_runner.js")
STEPS = 200
LOOKED = 40  # steps, after which overlays are compared
NODE = shutil.which("node")


def node(test: Any) -> Any:
    """Marks a test that runs the page's kernels under Node."""
    missing = pytest.mark.skipif(NODE is None, reason="node is missing: apt-get install nodejs")
    return pytest.mark.page(missing(test))


def tables() -> Any:
    return json.loads((PAGE / TABLES).read_text(encoding="utf-8"))


REBUILD = "build the page's kernels anew: python benchmarks/studies/page_kernels.py"


def by_value(told: Any, blobs: list[str]) -> Any:
    """Returns tables with each constant in place of its number."""
    if isinstance(told, dict):
        inner = ("blob", "sizes", "numbers", "directions")
        return {
            key: blobs[each] if key in inner and isinstance(each, int) else by_value(each, blobs)
            for key, each in told.items()
        }
    return [by_value(each, blobs) for each in told] if isinstance(told, list) else told


def entries(content: dict[str, Any]) -> dict[str, Any]:
    """Returns what the page is handed, each policy and each task's robots by their name."""
    blobs = content["blobs"]
    for task in content["tasks"].values():
        task["params"] = {name: blobs[k] for name, k in task["params"].items()}
    return {
        **{f"policy {name}": by_value(each, blobs) for name, each in content["pilots"].items()},
        **{f"task {name}": by_value(each, blobs) for name, each in content["tasks"].items()},
        **{name: content[name] for name in ("disturbances", "tiers", "records")},
    }


@pytest.mark.slow
def test_the_page_has_the_gains_data_sheets_and_agents_of_the_package() -> None:
    shipped, package = entries(tables()), entries(json.loads(json.dumps(page_recipes.tables())))
    other = sorted(name for name in shipped.keys() | package.keys() if shipped.get(name) != package.get(name))
    assert not other, f"{REBUILD}\nother numbers in {len(other)} of {len(package)}: {', '.join(other[:8])}"


def labels(task: str, robot: str, actuators: str) -> list[str]:
    start = f"{task} {robot} {actuators} "
    return [key.removeprefix(start) for key in tables()["pilots"] if key.startswith(start)]


def cases(every: bool) -> Iterator[dict[str, Any]]:
    """Yields the runs that are compared: each policy on five scenarios, or one of them."""
    for task in TASKS:
        contest = contest_of(task)
        families = list(contest.families("kinematic"))
        for robot in ROBOTS:
            for n, policy in enumerate(labels(task, robot, "lagged")):
                if not every and "(" in policy and not policy.startswith(AGENT):
                    continue
                chosen = [families[(n + 4 * k) % len(families)] for k in range(5 if every else 1)]
                for family in chosen:
                    yield {"task": task, "robot": robot, "actuators": "lagged", "policy": policy, "family": family}


def driven(case: dict[str, Any], steps: int) -> tuple[dict[str, Any], NDArray[np.float64]]:
    """Returns the world of a run as the page has it, and the poses (n + 1, 3) that Python drives."""
    contest = contest_of(case["task"])
    env = environment(case["task"], case["robot"], case["actuators"], case.get("file", f"{case['family']}/test"))
    name, _, gains_name = case["policy"].partition(" ")
    wanted = gains_name.strip("()") or "default"
    key = " ".join(case[part] for part in ("task", "robot", "actuators", "policy"))
    made = tables()["pilots"][key]
    if made.get("network"):
        gains = made["make"]["gains"]
    else:
        gains = dict(contest.gain_sets(name, case["robot"], ("default", "tuned", "paper"))).get(wanted, {})
    pilot = Pilot(make(name, **gains), env)
    observation, _ = env.reset(seed=0, options={"scenario": [0]})
    pilot.reset()
    world = plain(env.task.scenarios[0], contest.spec.clock) | {"draws": np_random(0)[0].random(DRAWS).tolist()}
    poses = [env.batch.states[0][["x", "y", "heading"]].item()]
    for _ in range(steps):
        observation, _, terminated, _, _ = env.step(pilot.command(observation))
        poses.append(env.batch.states[0][["x", "y", "heading"]].item())
        if terminated[0]:
            break
    env.close()
    return world, np.array(poses)


def driven_among(case: dict[str, Any], steps: int) -> tuple[dict[str, Any], NDArray[np.float64]]:
    """Returns the world, and (n + 1, 3 + 2 m) the pose of the first robot and where its m others are, 1e6: gone."""
    contest = contest_of(case["task"])
    env = gymnasium.make(
        contest.env_id(case["robot"]),
        scenario=f"{case['family']}/test",
        robot=case["robot"],
        actuators=case["actuators"],
        people=case.get("people"),
        max_episode_steps=contest.spec.clock,
        **{name: each for name, each in contest.env_kwargs.items() if name != "visible"},
    )
    inner: Any = env.unwrapped
    name, trained = case["policy"].split()[0], case["policy"].endswith("(trained)")
    gains: dict[str, Any] = {"seed": 0} if trained else {}
    asked = {"speed": case["speed"]} if "speed" in case else {}
    if asked:
        gains |= cruising(name, gains, case["speed"])
    pilot = Pilot(make(name, **gains), env)
    observation, _ = env.reset(seed=0, options={"scenario": 0})
    pilot.reset()
    world = plain(inner.task.scenarios[0], contest.spec.clock) | asked

    def placed() -> list[float]:
        places, *_, clocks, _ = inner.batch.own
        others = places[clocks[0, 0], 0, 1:]
        spots = np.where(others["present"][:, None] == 1, np.column_stack([others["x"], others["y"]]), 1e6)
        return [*inner.batch.states[0][["x", "y", "heading"]].item(), *spots.ravel().tolist()]

    poses = [placed()]
    for _ in range(steps):
        observation, _, terminated, _, _ = env.step(pilot.command(observation))
        poses.append(placed())
        if terminated:
            break
    env.close()
    return world, np.array(poses)


def compare(chosen: list[dict[str, Any]], steps: int, driven: Any = driven) -> None:
    """Asserts that page and Python drive the same poses to the last bit."""
    python = [driven(case, steps) for case in chosen]
    asked = [case | {"world": world, "steps": steps} for case, (world, _) in zip(chosen, python, strict=True)]
    run = subprocess.run(
        ["node", str(RUNNER), str(PAGE)], input=json.dumps(asked), capture_output=True, text=True, check=True
    )
    off = []  # a line each
    for case, (_, poses), result in zip(chosen, python, json.loads(run.stdout), strict=True):
        name = " ".join((case["task"], case["robot"], case["policy"], case["family"]))
        if "error" in result:
            off.append(f"{name}: {result['error']}")
            continue
        found = np.frombuffer(base64.b64decode(result["poses"])).reshape(-1, poses.shape[1])
        if found.shape != poses.shape or found.tobytes() != poses.tobytes():
            n = min(len(found), len(poses))
            first = np.flatnonzero((found[:n] != poses[:n]).any(axis=1))
            off.append(f"{name}: from step {first[0] if len(first) else n} on")
    told = "\n".join([REBUILD, f"the page drives otherwise in {len(off)} of {len(chosen)} episodes:", *off[:8]])
    assert not off, told


@node
def test_the_page_drives_what_python_drives() -> None:
    compare(list(cases(every=False)), 60)


@node
@pytest.mark.slow  # what finds the numbers is compiled for Python here alone
def test_overlays_show_the_numbers_that_the_laws_have_in_python() -> None:
    robot, tier = "p3dx", "lagged"
    rng = np.random.default_rng(3)
    asked, python = [], []
    for task, family in (("path_following", "circuits"), ("goal_reaching", "clutter_10"), ("docking", "wall")):
        for policy in (*page_recipes.decisions(task), AGENT):
            look = page_recipes.look_of(task, policy)
            case = {"task": task, "robot": robot, "actuators": tier, "policy": policy, "family": family}
            if policy == AGENT and task == "goal_reaching":
                case["policy"] = next(label for label in labels(task, robot, tier) if label.startswith(AGENT))
            elif look is None:
                continue
            env = environment(task, robot, tier, f"{family}/test")
            pilot = Pilot(make(policy, **({"seed": 0} if policy == AGENT else {})), env)
            observation, _ = env.reset(seed=0, options={"scenario": [0]})
            pilot.reset()
            draws = np_random(0)[0].random(DRAWS).tolist()
            world = plain(env.task.scenarios[0], contest_of(task).spec.clock) | {"draws": draws}
            for _ in range(LOOKED):
                observation, *_ = env.step(pilot.command(observation))
            places = rng.uniform(-3.0, 3.0, (look.places if look else 0, 2))
            asked.append(case | {"world": world, "steps": LOOKED, "places": places.ravel().tolist()})
            if look is None:  # the agent: what its guard is handed, and what it drives
                guard = page_recipes.of_policies("perception", "guard")
                ((_, (*_, wanted)),) = page_recipes.noted(pilot, observation, [(guard, "guard")])
                python.append(wanted[0])
                continue
            handed = page_recipes.handed_to_look(
                look, *page_recipes.handed_to(task, policy, pilot, observation), places
            )
            look.kernel(*handed)
            python.append(handed[-1])
    run = ["node", str(RUNNER), str(PAGE)]
    done = subprocess.run(run, input=json.dumps(asked), capture_output=True, text=True, check=True)
    for case, numbers, result in zip(asked, python, json.loads(done.stdout), strict=True):
        found = np.frombuffer(base64.b64decode(result["looked"]))
        if len(numbers) == 2:
            found = found[[3, 5]]  # of two planar twists the second: what the network wanted
        np.testing.assert_array_equal(found, numbers.ravel(), case["policy"])


@node
def test_the_page_drives_teams_and_people_as_python_does() -> None:
    """Each law of the page once, people by each law of theirs, walls, groups, reactions, and who leaves."""
    chosen = [
        {"task": task, "robot": robot, "actuators": "lagged", "policy": policy, "family": family, "people": law}
        for task, robot, policy, family, law in (
            ("teams", "p3dx", "orca_team", "circle_8", None),
            ("teams", "omni3", "orca_team", "head_on_2cm", None),
            ("teams", "p3dx", "orca_team_map", "doorway_4", None),
            ("teams", "omni4", "social_force", "doorway_4", None),
            ("teams", "p3dx", "vfh_plus", "crossing_4", None),
            ("people", "omni3", "orca_team", "crowdnav_5", None),
            ("people", "p3dx", "social_force", "crossing_flow_16", "helbing_molnar"),
            ("people", "p3dx", "dwa", "walking_groups", None),
            ("people", "p3dx", "scan_planner", "reactions", None),
            ("people", "omni3", "mppi", "blind_corner", "moussaid"),
            ("people", "p3dx", "polar", "crowdnav_5", "helbing_farkas_vicsek"),
            ("people", "omni3", "orca_team", "crossing_flow_8", "lightsfm"),
            ("people", "p3dx", "orca_team", "crossing_flow_8", "pysocialforce"),
            ("people", "p3dx", "orca_team", "crossing_flow_8", "constant_velocity"),
        )
    ]
    compare(chosen, 120, driven_among)


@node
@pytest.mark.filterwarnings("ignore::wayfield.policies.learned.conditions.NewToAgent")
@pytest.mark.parametrize(
    ("task", "policy", "family", "actuators", "people"),
    [
        ("teams", "team_guided (trained)", "circle_4", "lagged", None),
        ("teams", "team_scan (trained)", "doorway_4", "lagged", None),
        ("people", "people_free (trained)", "crowdnav_5", "lagged", None),
        # held to slower actuators that they know; shielded where their own are slower, and in larger teams
        ("teams", "team_guided (trained)", "crossing_4", "ideal", None),
        ("teams", "team_guided (trained)", "circle_16", "lagged", None),
        ("teams", "team_scan (trained)", "circle_16", "ideal", None),
        ("people", "people_free (trained)", "crossing_flow_8", "slow", "moussaid"),
    ],
)
def test_the_page_drives_agents_among_bodies_as_python_does(
    task: str, policy: str, family: str, actuators: str, people: str | None
) -> None:
    case = {"task": task, "robot": "omni3", "actuators": actuators, "policy": policy, "family": family}
    compare([case | {"people": people}], contest_of(task).spec.clock, driven_among)


@node
def test_the_page_drives_among_people_at_the_speed_that_a_contest_asks_for() -> None:
    case = {"task": "people", "robot": "omni3", "actuators": "lagged", "family": "crowdnav_5", "speed": 1.0}
    policies = ("people_free (trained)", "orca_team", "social_force", "vfh_plus", "dwa", "polar")
    compare([case | {"policy": policy} for policy in policies], 500, driven_among)


@node
def test_the_page_drives_paths_of_steps_and_wiggles_as_python_does(tmp_path: Path) -> None:
    stairs = [[0.1 * (k - k // 2), 0.1 * (k // 2)] for k in range(60)]
    rng = np.random.default_rng(7)
    track = np.column_stack([np.arange(0.0, 4.0, 0.05), rng.normal(0.0, 0.01, 80)])
    ring = [[1.5 * np.cos(a), np.sin(a) + 0.02 * (-1) ** k] for k, a in enumerate(np.linspace(0.0, 6.2, 60))]
    paths = {"stairs": {"path": stairs}, "track": {"path": track.tolist()}, "ring": {"path": ring, "closed": True}}
    chosen = []
    for name, content in paths.items():
        file = tmp_path / f"{name}.json"
        file.write_text(json.dumps(content))
        case = {"task": "path_following", "robot": "p3dx", "actuators": "lagged", "family": name, "file": str(file)}
        chosen += [case | {"policy": policy} for policy in page_recipes.ALONG_PATHS]
    compare(chosen, 100)


ROOM = ("." * 40 + "\n") * 12 + ("." * 18 + "@@@@" + "." * 18 + "\n") * 8 + ("." * 40 + "\n") * 12


@node
def test_the_page_drives_among_the_cells_of_a_map(tmp_path: Path) -> None:
    (tmp_path / "room.map").write_text(f"type octile\nheight 32\nwidth 40\nmap\n{ROOM}")
    chosen = []
    for task, word, policies in (
        ("goal_reaching", "goal", ("vfh_plus", "scan_planner", "astar_tracker", "apf_corrected")),
        ("docking", "dock", ("reeds_shepp", "polar")),
    ):
        file = tmp_path / f"{word}.json"
        content = {word: [7.0, 2.0, 0.3], "start": [1.0, 4.0, 0.2], "map": {"file": "room.map", "resolution": 0.25}}
        content["obstacles"] = [{"kind": "circle", "x": 3.0, "y": 3.0, "radius": 0.2}]
        file.write_text(json.dumps(content))
        case = {"task": task, "robot": "p3dx", "actuators": "lagged", "family": "map", "file": str(file)}
        chosen += [case | {"policy": policy} for policy in policies]
    world, _ = driven(chosen[0], 1)
    assert world["grid"]
    assert len(world["obstacles"]) == 1
    compare(chosen, 120)


@node
def test_the_page_comes_as_near_to_a_goal_as_that_asks(tmp_path: Path) -> None:
    file = tmp_path / "near.json"
    file.write_text(json.dumps({"goal": [0.5, 0.1, 0.3], "position_tolerance": 0.06, "heading_tolerance": 0.02}))
    case = {"task": "goal_reaching", "robot": "p3dx", "actuators": "lagged", "family": "near", "file": str(file)}
    chosen = [case | {"policy": policy} for policy in ("dwa", "dwa (hand-tuned)", "vfh_plus")]
    _, poses = driven(chosen[1], 120)
    assert np.hypot(*(poses[-1, :2] - (0.5, 0.1))) < 0.06  # which its gain, 0.15 m, would not have come to
    compare(chosen, 120)


@node
@pytest.mark.slow
def test_the_page_drives_what_python_drives_for_every_task_robot_and_compiled_policy() -> None:
    compare(list(cases(every=True)), STEPS)
