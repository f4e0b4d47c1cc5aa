"""Short runs of the commands that take long: what they are asked, and what they leave when nobody disturbs them."""

import dataclasses
import shutil
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from wayfield.benchmarks.faults.place import contents

_SMALL = ("num_envs=64", "horizon=8", "batch_size=64", "epochs=1", "hidden=8", "validations=2")
_ENV = "wayfield/DiffDrivePathFollowing-v0"
LIMIT = 400.0  # s, that a run may take on a machine that must compile first
OUT = "out"


@dataclasses.dataclass(frozen=True)
class Run:
    """A command that writes a folder, and the files in it that must come out bit for bit."""

    command: str
    arguments: tuple[str, ...]
    results: tuple[str, ...]
    out: str = OUT  # what --out is given

    @property
    def line(self) -> list[str]:
        """Returns the arguments, with the folder."""
        return [*self.arguments, "--out", self.out]


def _contest(policies: str, workers: str = "2", episodes: str = "2") -> Run:
    asked = (
        "--suite",
        "path-following",
        "--policies",
        policies,
        "--families",
        "straights,circles",
        "--gains",
        "default",
    )
    return Run("evaluate", (*asked, "--episodes", episodes, "--workers", workers), ("episodes.csv", "trajectories.npz"))


def _training(seeds: int) -> Run:
    words = [word for each in _SMALL for word in ("--set", each)]
    asked = (_ENV, "--preset", "path_following_plain", "--steps", "4096", "--seeds", str(seeds))
    return Run("train", (*asked, *words), tuple(f"seed_{k}/best/weights.safetensors" for k in range(seeds)))


def _tuning(workers: str) -> Run:
    asked = ("lqr", "--suite", "path-following", "--trials", "2", "--scenarios", "1", "--workers", workers)
    return Run("tune", asked, ("gains.json",), f"{OUT}/gains.json")


RUNS = {
    "contest": _contest("pure_pursuit,stanley"),
    "another contest": _contest("smooth_pose"),
    "training": _training(2),
    "one training": _training(1),
    "tuning": _tuning("2"),
    "contest in one process": _contest("pure_pursuit", "1", "1"),
    "another contest in one process": _contest("stanley", "1", "1"),
    "tuning in one process": _tuning("1"),
}
# a run that a fork of a worker can do, in place of each
FORKED = {name: name if name == "one training" else f"{name} in one process"
          for name in ("contest", "another contest", "one training", "tuning")}  # fmt: skip


def reference(name: str, place: Any) -> tuple[dict[str, str], float] | str:
    """Returns what the run leaves undisturbed and the seconds it takes, from a first run at this place; or what went
    wrong with that."""
    if name not in place.references:
        with place.folder() as folder:
            (folder / OUT).mkdir()
            run = RUNS[name]
            place.warm(run.command, run.line, folder)
            shutil.rmtree(folder / OUT)
            (folder / OUT).mkdir()
            began = time.monotonic()
            ended = place.run(run.command, run.line, folder, LIMIT)
            if ended.status != 0:
                return f"undisturbed it ends with status {ended.status}: {ended.err[-300:]}"
            place.references[name] = contents(folder / OUT), time.monotonic() - began
    found: tuple[dict[str, str], float] = place.references[name]
    return found


def differs(name: str, folder: Path, wanted: dict[str, str]) -> str | None:
    """Returns how a folder differs from what the run leaves undisturbed; None where it does not."""
    found = contents(folder)
    for file in RUNS[name].results:
        if found.get(file) != wanted[file]:
            return f"{file} {'differs from' if file in found else 'is missing, unlike in'} the undisturbed run"
    odd = {each for each in set(found) ^ set(wanted) if "tensorboard" not in each}
    return f"leaves other files: {', '.join(sorted(odd)[:4])}" if odd else None


def parts_of(folder: Path) -> list[Path]:
    """Returns the rows of the finished parts of a contest under way, not of those that are being written."""
    found = sorted((folder / OUT).glob("**/rows.json"))
    return [each for each in found if not each.parent.name.startswith(".")]


def finished(name: str, place: Any, folder: Path, wanted: dict[str, str], arguments: Sequence[str] = ()) -> str | None:
    """Runs again until it is done; returns what is wrong with that or with the results."""
    run = RUNS[name]
    ended = place.run(run.command, [*run.line, *arguments], folder, LIMIT)
    if ended.status != 0 and "--resume" in arguments and "no run to resume" in ended.err:
        ended = place.run(run.command, run.line, folder, LIMIT)
    if ended.status != 0:
        return f"run again it ends with status {ended.status}: {' '.join(ended.err.split())[-300:]}"
    return differs(name, folder / OUT, wanted)
