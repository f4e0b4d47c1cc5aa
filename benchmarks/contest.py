"""Runs a contest in parts that survive an interruption: a part is one policy on one family of scenarios."""

import dataclasses
import hashlib
import json
import os
import pathlib
import shutil
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path

import wayfield.envs
import wayfield.policies
from wayfield import benchmarks
from wayfield.benchmarks.contests import CONTESTS
from wayfield.benchmarks.progress import tracked
from wayfield.benchmarks.results import Row, number, read_trajectories, write_trajectories
from wayfield.benchmarks.suite import Setting, episodes
from wayfield.benchmarks.trajectory import Trajectory
from wayfield.benchmarks.workers import Map
from wayfield.envs.scenarios import splits
from wayfield.policies.agent import CARD
from wayfield.policies.ppo import trained

UNFINISHED = "unfinished"  # folder of the parts of a run that was interrupted
WORST = 3  # episodes of each policy whose trajectories are kept


@dataclasses.dataclass(frozen=True)
class Part:
    """A setting, and the folder that its episodes are kept in until the whole run is done."""

    setting: Setting
    folder: Path


def run_contest(settings: Sequence[Setting], folder: Path, workers: Map) -> tuple[list[Row], dict[str, Trajectory]]:
    """Returns one row for each episode, and the trajectories of the worst episodes of each entry.

    Parts that an earlier, interrupted run of the same settings and the same code left in `folder` are not run again.
    """
    code = _source_digest()
    parts = [Part(setting, folder / UNFINISHED / _key(setting, code)) for setting in settings]
    missing = [part for part in parts if not part.folder.is_dir()]
    if len(missing) < len(parts):
        print(f"{len(parts) - len(missing)} of {len(parts)} parts are there from before", file=sys.stderr)
    for _ in tracked(workers(play, missing), len(missing), "parts"):
        pass
    rows: list[Row] = []
    kept: dict[tuple[str, ...], list[tuple[Row, Trajectory]]] = {}
    for part in parts:
        found = json.loads((part.folder / "rows.json").read_text(encoding="utf-8"))
        trajectories = read_trajectories(part.folder)
        for row in found:
            row["trajectory"] = ""
            rows.append(row)
        entry = tuple(found[0][name] for name in ("suite", "policy", "gains_name", "robot", "split", "disturbance"))
        kept.setdefault(entry, []).extend((found[int(i)], trajectory) for i, trajectory in trajectories.items())
    worst: dict[str, Trajectory] = {}
    for candidates in kept.values():
        contest = CONTESTS[candidates[0][0]["document"]]
        for row, trajectory in sorted(candidates, key=lambda each: badness(each[0], contest.cost))[:WORST]:
            row["trajectory"] = f"{len(worst):05d}"
            worst[row["trajectory"]] = trajectory
    return rows, worst


def play(part: Part) -> None:
    """Runs a part and leaves its rows and its worst trajectories in its folder, whole or not at all."""
    setting = part.setting
    contest = CONTESTS[setting.case.document]
    family, split = setting.case.scenario.split("/")
    members = splits.split(contest.task, family, split)
    played = episodes(setting)
    for (row, _), member in zip(played, members, strict=False):
        row["split"], row["tier"], row["quantity"] = split, member.tier, repr(member.quantity)
        if setting.case.speed is not None:
            row["split"], row["speed"] = "front", f"{setting.case.speed:g}"
    order = sorted(range(len(played)), key=lambda i: badness(played[i][0], contest.cost))
    part.folder.parent.mkdir(parents=True, exist_ok=True)
    stage = Path(tempfile.mkdtemp(prefix=".part-", dir=part.folder.parent))
    try:
        (stage / "rows.json").write_text(json.dumps([row for row, _ in played]), encoding="utf-8")
        write_trajectories(stage, {f"{i:05d}": slim(played[i][1]) for i in order[:WORST]})
        os.replace(stage, part.folder)
    finally:
        shutil.rmtree(stage, ignore_errors=True)


def badness(row: Row, cost: str) -> tuple[float, float]:
    """Returns a key that sorts the worst episode first: failures before successes, then the higher cost."""
    value = number(row, cost)
    return number(row, "success"), -value if value == value else 0.0


def slim(trajectory: Trajectory) -> Trajectory:
    """Returns what a figure of the driven way needs."""
    nothing = Trajectory(times=trajectory.times, poses=trajectory.poses)
    return dataclasses.replace(
        trajectory,
        **{name: getattr(nothing, name) for name in ("twists", "wheel_speeds", "saturated", "references")},
    )


def _key(setting: Setting, code: str) -> str:
    """Returns the name of a setting's folder: the same for the same setting and code."""
    family, split = setting.case.scenario.split("/")
    # agents of one's own may be trained anew in the same folder
    gains = setting.case.gains
    card = (trained(gains["home"])[gains["seed"]] / CARD).read_text(encoding="utf-8") if "home" in gains else ""
    geometry = splits.digest(splits.split(CONTESTS[setting.case.document].task, family, split))
    return hashlib.sha256(f"{setting!r} {geometry} {card} {code}".encode()).hexdigest()[:24]


def _source_digest() -> str:
    """Returns a digest of source files and agents, so that parts of another version are not taken for this one's."""
    digest = hashlib.sha256()
    for module in (wayfield.envs, wayfield.policies, benchmarks):
        for file in sorted(pathlib.Path(module.__path__[0]).rglob("*")):
            if file.suffix in (".py", ".json", ".safetensors"):
                digest.update(file.read_bytes())
    return digest.hexdigest()


def finished(folder: Path) -> list[Path]:
    """Returns the folders of the parts that an unfinished run has left."""
    return [each for each in (folder / UNFINISHED).glob("*") if not each.name.startswith(".")]


def clear_parts(folder: Path) -> None:
    """Deletes the parts of a run that is done."""
    shutil.rmtree(folder / UNFINISHED, ignore_errors=True)
