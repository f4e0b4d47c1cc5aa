"""Files of others under our names in --out: never changed, never deleted; the command ends well or with one line."""

import random
from collections.abc import Iterator
from typing import Any

from wayfield.benchmarks.faults.place import changed, contents
from wayfield.benchmarks.faults.runs import FORKED, LIMIT, OUT, RUNS

_THEIRS = "somebody else's\n"
_NAMES = {
    "contest": (
        "unfinished/notes.txt", "unfinished/deep/er/notes.txt", "unfinished", "table.md", "episodes.csv",
        "trajectories.npz", "run.json", "manifest.json", "table.md/notes.txt", "notes.txt", ".wayfield-x/notes.txt",
        ".lock", "figures/notes.txt", "video/notes.txt",
    ),
    "path": ("table.md", "episodes.csv", "unfinished/notes.txt", "trajectories.npz", "run.json"),
    "one training": (
        "seed_0/run.json", "seed_0/best/weights.safetensors", "seed_0/best", "seed_0/last.safetensors", "seed_0",
        "seed_0/curve.csv", "seed_0/.lock", "seed_0/notes.txt", "curves.png", "seed_0/tensorboard/notes.txt",
    ),
}  # fmt: skip


def trials(rng: random.Random) -> Iterator[dict[str, Any]]:
    """Yields every name alone, the likeliest first, in an order of the seed's own; then two at a time, without end."""
    listed = [("contest", "unfinished/notes.txt"), ("contest", "table.md"), ("path", "table.md")]
    others = [(run, name) for run, names in _NAMES.items() for name in names if (run, name) not in listed]
    rng.shuffle(others)
    for run, name in (*listed, *others):
        yield {"run": run, "names": [name], "forked": (run, name) not in listed}
    while True:
        run = rng.choice(tuple(_NAMES))
        names = rng.sample(_NAMES[run], 2)
        if not any(f"{a}/".startswith(f"{b}/") for a in names for b in names if a is not b):
            yield {"run": run, "names": names, "content": rng.choice(("", "{}", _THEIRS)), "forked": True}


def attempt(spec: dict[str, Any], place: Any, server: Any) -> str | None:
    """Returns what became of somebody else's file."""
    del server
    with place.folder() as folder:
        for name in spec["names"]:
            file = folder / OUT / name
            file.parent.mkdir(parents=True, exist_ok=True)
            file.write_text(spec.get("content", _THEIRS), encoding="utf-8")
        if spec["run"] == "path":
            (folder / "way.csv").write_text("x,y\n0,0\n1,0\n2,0.5\n", encoding="utf-8")
            command = "evaluate"
            line = ["--path", "way.csv", "--policies", "pure_pursuit", "--dynamics", "kinematic", "--episodes", "1",
                    "--workers", "1", "--out", OUT]  # fmt: skip
        else:
            run = RUNS[FORKED[spec["run"]] if spec.get("forked") else spec["run"]]
            command, line = run.command, run.line
        before = contents(folder)
        ended = place.run(command, line, folder, LIMIT)
        harmed = changed(before, contents(folder))
        if harmed:
            return f"somebody else's {harmed[0]}"
        fault: str | None = ended.fault((0, 1, 2))
        return fault
