"""A run's folder: what it is, its last state and the one before, its best agent, its curve.

Every file is the old one or the new one. A state knows itself by a digest; one that is damaged is refused, and the one
before takes its place.
"""

import csv
import hashlib
import io
import json
import os
import pathlib
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray
from safetensors.numpy import save

from wayfield.system.checks import shown
from wayfield.system.readers import of_folder, of_path, reader
from wayfield.system.reading import is_whole, parsed_object, read_arrays, read_object
from wayfield.system.storage import sync_folder, write_whole

RUN, LAST, PREVIOUS, BEST, CURVE = "run.json", "last.safetensors", "previous.safetensors", "best", "curve.csv"
LOCK = ".lock"  # held by the process that writes in the folder
_NEXT = "next.safetensors"  # a state until it takes the place of the last

State = tuple[dict[str, NDArray[Any]], dict[str, Any]]  # arrays, and numbers and text that JSON keeps exactly


def write_run(folder: pathlib.Path, description: Mapping[str, Any]) -> None:
    """Writes what a run is."""
    folder.mkdir(parents=True, exist_ok=True)
    write_whole(folder / RUN, (json.dumps(description, indent=2) + "\n").encode())


def sample_job(folder: pathlib.Path) -> Any:
    """Returns a training of a second."""
    from wayfield.policies.training.presets import overridden, preset_for
    from wayfield.policies.training.run import Job

    env_id = "wayfield/DiffDrivePathFollowing-v0"
    settings = ("num_envs=24", "horizon=4", "batch_size=48", "epochs=1", "hidden=4", "validations=1", "steps=192")
    preset = overridden(preset_for(env_id, "path_following_plain"), settings)
    return Job(env_id, preset, settings, 0, folder)


def _sample_run(folder: pathlib.Path) -> None:
    from wayfield.policies.training.run import train

    train(sample_job(folder), lambda report: None)


def _sample_two_states(folder: pathlib.Path) -> None:
    """Leaves a run whose last state is damaged: the one before it is what is read."""
    _sample_run(folder)
    os.replace(folder / LAST, folder / PREVIOUS)
    (folder / LAST).write_bytes(b"cut short")


@reader("training run", RUN, _sample_run, of_folder)
def read_run(folder: pathlib.Path) -> dict[str, Any] | None:
    """Returns what the run in a folder is; None where there is none.

    Raises:
        ValueError: naming the file, the field and its value, if the description is damaged.
    """
    file = folder / RUN
    if not file.exists():
        return None
    description = read_object(file)
    for key in ("env_id", "preset"):
        if not isinstance(description.get(key), str):
            raise ValueError(f"{file}: {key} must be a text, got {shown(description.get(key))}")
    settings = description.get("settings")
    if not isinstance(settings, list) or not all(isinstance(each, str) for each in settings):
        raise ValueError(f"{file}: settings must be a list of texts, got {shown(settings)}")
    for key in ("steps", "seed"):
        if not is_whole(description.get(key), 0, 2**63 - 1):
            raise ValueError(f"{file}: {key} must be a whole number, got {shown(description.get(key))}")
    return description


def write_state(folder: pathlib.Path, arrays: Mapping[str, NDArray[Any]], numbers: Mapping[str, Any]) -> None:
    """Writes the last state, arrays as tensors, the rest as JSON in the same file; the one before it is kept.

    At any moment `last_state` finds one of the three: that one, the one before it, or this.

    Raises:
        OSError: if it cannot be written; the last state is still there.
    """
    tensors, text = {name: np.ascontiguousarray(array) for name, array in arrays.items()}, json.dumps(numbers)
    write_whole(folder / _NEXT, save(tensors, {"numbers": text, "sha256": _digest(tensors, text)}))
    if (folder / LAST).exists():
        os.replace(folder / LAST, folder / PREVIOUS)
    os.replace(folder / _NEXT, folder / LAST)
    sync_folder(folder)


@reader("training state", LAST, _sample_run, of_path)
def read_state(file: pathlib.Path) -> State:
    """Returns the state in a file.

    Raises:
        ValueError: naming the file, if it is missing or damaged.
    """
    arrays, texts = read_arrays(file)
    if "sha256" not in texts or "numbers" not in texts:
        raise ValueError(f"{file} has no digest of itself: it is no state of a run, or one of an earlier wayfield")
    if texts["sha256"] != _digest(arrays, texts["numbers"]):
        raise ValueError(f"{file} is damaged: its digest differs from what it holds")
    return arrays, parsed_object(texts["numbers"], str(file))


def last_state(folder: pathlib.Path) -> tuple[State | None, str]:
    """Returns the last state, and a line that says so if the one before had to take its place.

    That one then stands as the last, so that the next to be written cannot push it out. None where a run was stopped
    before its first.

    Raises:
        ValueError: naming the files, if there are states and none is good.
    """
    (folder / _NEXT).unlink(missing_ok=True)
    state, note = _good_state(folder)
    if note:
        os.replace(folder / PREVIOUS, folder / LAST)
        sync_folder(folder)
    return state, note


@reader("state before the last", PREVIOUS, _sample_two_states, lambda read, file: read(file.parent)[0])
def _good_state(folder: pathlib.Path) -> tuple[State | None, str]:
    """Returns what `last_state` does and leaves the files as they are."""
    last, previous = folder / LAST, folder / PREVIOUS
    if not last.exists() and not previous.exists():
        return None, ""
    try:
        return read_state(last), ""
    except ValueError as error:
        if not previous.exists():
            raise ValueError(f"{error}; there is no save before it: train anew with another --out") from None
        try:
            state = read_state(previous)
        except ValueError as other:
            raise ValueError(f"{error}; {other}; train anew with another --out") from None
        return state, f"{error}; going on from the save before it"


def _digest(arrays: Mapping[str, NDArray[Any]], text: str) -> str:
    """Returns the SHA-256 of names, kinds, shapes and bytes of arrays, and of a text."""
    sha = hashlib.sha256(text.encode())
    for name, array in sorted(arrays.items()):
        sha.update(f"\n{name} {array.dtype.str} {array.shape}\n".encode())
        sha.update(array.tobytes())
    return sha.hexdigest()


IN_FIELD = "success in "  # begins the columns of a learning curve with the successes in one condition


def write_curve(folder: pathlib.Path, rows: Sequence[Mapping[str, Any]]) -> None:
    """Writes the learning curve, one row a validation."""
    text = io.StringIO()
    writer = csv.DictWriter(text, list(rows[0]), lineterminator="\n")
    writer.writeheader()
    writer.writerows(rows)
    write_whole(folder / CURVE, text.getvalue().encode())
