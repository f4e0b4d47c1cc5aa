"""Checks a student's file of a lab on scenes that the sheet does not show: `python check.py 1 lab1.py`.

Needs no network. Grade with another `--seed`: it draws other scenes. `--practice FOLDER` writes paths of the same kind.
"""

import argparse
import ast
import json
import math
import runpy
import sys
import tempfile
import warnings
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np

import wayfield  # noqa: F401  registers the ids
from wayfield.policies import Pilot, load_agent, make

ENV = "wayfield/DiffDrivePathFollowing-v0"
MEANINGS = {
    "e_d": "x of the reference point in the body frame, m; it is the path point nearest to the look-ahead point, not "
    "to the robot, on the segments and not only at their ends",
    "e_h": "atan2(y, x) of the reference point in the body frame, rad",
    "e_o": "heading of the path's segment minus the robot's, rad, wrapped to (-pi, pi]",
    "v": "k_lin e_d, m/s",
    "w": "k_ang (1 - mode) e_h + k_ori mode e_o, rad/s, with mode from the distance to the reference point",
}


class Wrong(Exception):
    """One line that says what is wrong."""


def line_of(error: Exception) -> str:
    """Returns an error as a line, with its kind unless it is Wrong."""
    return str(error) if isinstance(error, Wrong) else f"{type(error).__name__}: {' '.join(str(error).split())}"


def wavy(rng: np.random.Generator, step: float = 0.05) -> np.ndarray:
    """Returns a path (n, 2) of two sines of random height and phase, 12 m wide, points every `step` m of x."""
    x = np.arange(0.0, 12.0 + step / 2, step)
    waves = ((1.0, 7.0), (0.25, 2.5))
    y = sum(rng.uniform(0.5, 1.0) * a * np.sin(2 * np.pi * x / length + rng.uniform(0, 6)) for a, length in waves)
    return np.column_stack([x, y])


def write(file: Path, points: Any, **fields: Any) -> str:
    """Writes a scenario file and returns its name."""
    file.write_text(json.dumps({"path": np.asarray(points, float).tolist(), **fields}), encoding="utf-8")
    return str(file)


def write_wavy(folder: Path, rng: np.random.Generator) -> None:
    """Writes eight paths, each started 0.1 m beside it."""
    for k in range(8):
        points = wavy(rng)
        (x, y), ahead = points[0], points[1] - points[0]
        write(folder / f"path_{k}.json", points, start=[x, y + 0.1, math.atan2(ahead[1], ahead[0])])


def drive(file: str, **gains: Any) -> dict[str, Any]:
    """Returns the last info of an episode of the documented controller, with other gains where given."""
    env = gymnasium.make(ENV, scenario=file, actuators="ideal")
    observation, info = env.reset(seed=0)
    pilot = Pilot(make("lookahead_documented", **gains), env)
    pilot.reset()
    ended = False
    while not ended:
        observation, _, terminated, truncated, info = env.step(pilot.act(observation))
        ended = terminated or truncated
    return info


def lab_1(file: Path, rng: np.random.Generator, folder: Path) -> Iterator[Callable[[], str]]:
    """Yields the checks of the look-ahead lab."""
    for node in ast.walk(ast.parse(file.read_text(encoding="utf-8"))):
        names = [node.module] if isinstance(node, ast.ImportFrom) else []
        names += [each.name for each in node.names] if isinstance(node, ast.Import) else []
        if bad := [name for name in names if str(name).partition(".")[0] not in ("math", "numpy")]:
            raise Wrong(f"line {node.lineno} imports {bad[0]}: write the controller with math and numpy alone")
    mine = runpy.run_path(str(file))
    if missing := [name for name in ("lookahead", "offset", "BREAKS") if name not in mine]:
        raise Wrong(f"{missing[0]} is missing: keep the names of the starter file")

    def controller() -> str:
        for k, step in enumerate((0.05, 0.6, 0.05, 0.6)):
            points = wavy(rng, step)[:: 1 if k < 2 else -1]
            env = gymnasium.make(ENV, scenario=write(folder / f"law_{k}.json", points), actuators="ideal")
            env.reset(seed=0)
            pilot = Pilot(make("lookahead_documented"), env)
            pilot.reset()
            for i in range(50):
                near, spread = (points[-1], 0.05) if i % 4 == 0 else (points[rng.integers(len(points))], 0.6)
                pose = np.array([*(near + rng.uniform(-spread, spread, 2)), rng.uniform(-math.pi, math.pi)])
                x, y, e_h, e_o, _ = pilot.policy.errors(pose[None], np.zeros(1), pilot.briefing)[0]
                mode = math.exp(-math.hypot(x, y) / 0.05)
                right = (x, e_h, e_o, 1.2 * x, 0.8 * (1.0 - mode) * e_h + 8.0 * mode * e_o)
                found = mine["lookahead"](tuple(pose), points.copy())
                if np.shape(found) != (5,):
                    raise Wrong(f"lookahead must return 5 numbers: {', '.join(MEANINGS)}")
                for name, is_, should in zip(MEANINGS, found, right, strict=True):
                    if not abs(is_ - should) < 1e-6:
                        at = f"({pose[0]:.2f}, {pose[1]:.2f}, {pose[2]:.2f}), path {k + 1}"
                        raise Wrong(f"{name} is {is_:.4f}, not {should:.4f}, at pose {at}: {MEANINGS[name]}")
        return "lookahead agrees at 200 poses on 4 paths"

    def prediction() -> str:
        for radius in rng.uniform(0.5, 2.5, 4):
            turn = np.arange(0.0, 2 * np.pi, 0.02 / radius)
            points = radius * np.column_stack([np.sin(turn), 1.0 - np.cos(turn)])
            measured = -drive(write(folder / "circle.json", points, closed=True, laps=3))["cross_track_error"]
            if not abs(mine["offset"](radius) - measured) < 0.005:
                told = f"{mine['offset'](radius):.3f} m, the robot drives {measured:.3f} m outside"
                raise Wrong(f"offset({radius:.2f}) is {told}: which angle makes the turn of v/w steady?")
        return "offset predicts four circles within 5 mm"

    def breaks() -> str:
        points = np.asarray(mine["BREAKS"], float)
        length = np.hypot(*np.diff(points, axis=0).T).sum()
        if not 2.0 <= length <= 30.0:
            raise Wrong(f"BREAKS is {length:.1f} m long: give a path of 2 to 30 m")
        path = write(folder / "breaks.json", points, corridor=0.5)
        if drive(path)["success"]:
            raise Wrong("BREAKS: the documented controller completes it; where would the nearest point mislead it?")
        if not drive(path, search="window")["success"]:
            raise Wrong('BREAKS: search="window" fails on it too, so that the whole-path search is not the cause')
        return "BREAKS stops the documented controller; the windowed search completes it"

    yield from (controller, prediction, breaks)


def measured(mine: Any, rivals: dict[str, Any], rng: np.random.Generator, folder: Path) -> dict[str, dict[str, float]]:
    """Returns success, tracking error (mm) and mean speed (m/s) of each on eight paths, driven by a Kobuki."""
    from wayfield.benchmarks import compare

    write_wavy(folder, rng)
    means = {}
    for key, policy in {"mine": mine, **rivals}.items():
        rows = compare([policy], folder, robot="kobuki", gains="default").rows
        units = {"success": 1.0, "tracking_rms": 1000.0, "mean_speed": 1.0}
        means[key] = {name: unit * float(np.mean([row[name] for row in rows])) for name, unit in units.items()}
    return means


def lab_2_or_3(file: Path, rng: np.random.Generator, folder: Path, lab: int) -> Iterator[Callable[[], str]]:
    """Yields the checks of the labs that compare: 2, gains; 3, an agent."""
    field, kind, named = ("gains", dict, "an object of gains") if lab == 2 else ("agent", str, "a folder's name")
    try:
        content = json.loads(file.read_text(encoding="utf-8"))
    except json.JSONDecodeError as error:
        raise Wrong(f"it must be JSON: {error}") from None
    if not isinstance(content, dict) or not isinstance(content.get(field), kind):
        raise Wrong(f"it must be a JSON object whose {field!r} is {named}, got {json.dumps(content)}")
    if lab == 2:
        mine = make("lookahead_retuned", **content["gains"])
        rivals = {"default": make("lookahead_retuned"), "mpc": make("mpc")}
    else:
        agent = file.parent / content["agent"]
        if not (agent / "card.json").is_file():
            raise Wrong(f"agent is {content['agent']!r}, which holds no card.json: train one as the sheet says")
        robots = json.loads((agent / "card.json").read_text(encoding="utf-8"))["robots"]
        if robots != ["kobuki"]:
            raise Wrong(f"agent was trained on {', '.join(robots)}: train one on the Kobuki, --robot kobuki")
        mine, rivals = load_agent(agent), {"default": make("lookahead_retuned"), "pure_pursuit": make("pure_pursuit")}
    found = measured(mine, rivals, rng, folder)
    share, least = (0.65, 0.55) if lab == 2 else (1.0, 0.5)

    def drives() -> str:
        if found["mine"]["success"] < 1.0:
            raise Wrong(f"yours completes {found['mine']['success']:.0%} of 8 paths: all are needed")
        if found["mine"]["mean_speed"] < least:
            raise Wrong(f"yours drives {found['mine']['mean_speed']:.3f} m/s: at least {least} m/s are needed")
        return f"yours completes 8 paths at {found['mine']['mean_speed']:.3f} m/s"

    def tracks() -> str:
        error, most = found["mine"]["tracking_rms"], share * found["default"]["tracking_rms"]
        if not error <= most:
            raise Wrong(
                f"tracking error {error:.1f} mm: at most {most:.1f} mm, {share:.0%} of the default gains' error"
            )
        return f"tracking error {error:.1f} mm, of the default gains {found['default']['tracking_rms']:.1f} mm"

    def report() -> str:
        told = content["error_mm"]
        for key in ("mine", list(rivals)[1]):
            here = found[key]["tracking_rms"]
            if not isinstance(told.get(key), int | float) or not here / 1.5 <= told[key] <= here * 1.5:
                raise Wrong(
                    f"error_mm.{key} is {told.get(key)}, here {here:.2f} mm: report the mean tracking error, in mm"
                )
        return "error_mm agrees within a factor of 1.5"

    yield from (drives, tracks, report)


def main() -> int:
    """Returns 0 if all checks pass."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("lab", nargs="?", type=int, choices=(1, 2, 3))
    parser.add_argument("file", nargs="?", type=Path)
    parser.add_argument("--seed", type=int, default=1, help="of the scenes")
    parser.add_argument("--practice", type=Path, metavar="FOLDER", help="write eight paths to practise on, and end")
    given = parser.parse_args()
    if given.practice:
        given.practice.mkdir(parents=True, exist_ok=True)
        write_wavy(given.practice, np.random.default_rng(0))
        return 0
    if not given.lab or not given.file:
        parser.error("name the lab and your file: check.py 1 lab1.py")
    warnings.simplefilter("ignore")
    failed = 0
    with tempfile.TemporaryDirectory() as folder:
        words = (given.file, np.random.default_rng(given.seed), Path(folder))
        try:
            for check in lab_1(*words) if given.lab == 1 else lab_2_or_3(*words, given.lab):
                try:
                    print("pass:", check())
                except Exception as error:  # of the student's code, too: the other parts are checked all the same
                    failed += 1
                    print("FAIL:", line_of(error))
        except Exception as error:
            failed += 1
            print(f"FAIL: {given.file}: {line_of(error)}")
    print("all checks pass" if not failed else f"{failed} failed")
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main())
