"""A run's folder: what it is, its last state, its best agent, its curve. Every file is the old one or the new one."""

import csv
import io
import json
import pathlib
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray
from safetensors import SafetensorError, safe_open
from safetensors.numpy import save

from wayfield.policies.agent import write_whole

RUN, LAST, BEST, CURVE = "run.json", "last.safetensors", "best", "curve.csv"


def write_run(folder: pathlib.Path, description: Mapping[str, Any]) -> None:
    """Writes what a run is."""
    folder.mkdir(parents=True, exist_ok=True)
    write_whole(folder / RUN, (json.dumps(description, indent=2) + "\n").encode())


def read_run(folder: pathlib.Path) -> dict[str, Any] | None:
    """Returns what the run in a folder is; None where there is none.

    Raises:
        ValueError: if the description is damaged.
    """
    file = folder / RUN
    if not file.exists():
        return None
    try:
        description = json.loads(file.read_text(encoding="utf-8"))
    except (OSError, ValueError) as error:
        raise ValueError(f"{file} is damaged: {error}") from None
    if not isinstance(description, dict) or not {"env_id", "preset", "settings", "steps", "seed"} <= set(description):
        raise ValueError(f"{file} does not describe a training run")
    return description


def write_state(folder: pathlib.Path, arrays: Mapping[str, NDArray[Any]], numbers: Mapping[str, Any]) -> None:
    """Writes the last state: arrays as tensors, the rest as JSON in the same file."""
    content = save({name: np.ascontiguousarray(a) for name, a in arrays.items()}, {"numbers": json.dumps(numbers)})
    write_whole(folder / LAST, content)


def read_state(folder: pathlib.Path) -> tuple[dict[str, NDArray[Any]], dict[str, Any]] | None:
    """Returns the last state; None where a run was stopped before its first.

    Raises:
        ValueError: if the file is damaged.
    """
    file = folder / LAST
    if not file.exists():
        return None
    try:
        with safe_open(file, "numpy") as content:
            numbers = json.loads((content.metadata() or {})["numbers"])
            return {name: content.get_tensor(name) for name in content.keys()}, numbers  # noqa: SIM118
    except (SafetensorError, OSError, KeyError, ValueError) as error:
        raise ValueError(f"{file} is damaged: {error}") from None


def write_curve(folder: pathlib.Path, rows: Sequence[Mapping[str, Any]]) -> None:
    """Writes the learning curve, one row a validation."""
    text = io.StringIO()
    writer = csv.DictWriter(text, list(rows[0]), lineterminator="\n")
    writer.writeheader()
    writer.writerows(rows)
    write_whole(folder / CURVE, text.getvalue().encode())
