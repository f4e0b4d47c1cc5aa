"""Recorded sets that are learned from: opened with care, and compared with the digest that they were written with."""

import hashlib
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

from numpy.typing import NDArray

from wayfield.system.checks import LAST_OF_EPISODES, shown
from wayfield.system.extras import installs
from wayfield.system.reading import is_whole, read_object

KEY = "wayfield"  # of what we add to the metadata of a set and of an episode
MOST_EPISODES = 10**7
_METADATA = "metadata.json"  # Minari's, of the set and of an episode
_EPISODE = "part-0.arrow"


def opened(source: str) -> Any:
    """Returns the Minari data set of a name, or of the folder of one, with all its numbers compared.

    Raises:
        ValueError: if it is none of ours, it is damaged, or Minari is missing; one line that names the file.
    """
    try:
        import minari
        from minari.storage.datasets_root_dir import get_dataset_path
    except ImportError:
        raise ValueError(f"data sets need minari: {installs('record')}") from None
    folder = Path(source) / "data"
    try:
        if not folder.is_dir():
            folder = Path(get_dataset_path(source)) / "data"
        check_metadata(folder / _METADATA)
        data = minari.MinariDataset(folder)
        _check_episodes(data, folder)
    except Exception as error:  # of whatever reads what is there
        raise ValueError(f"DATASET {source!r} cannot be read: {' '.join(str(error).split())[:600]}") from None
    return data


def check_metadata(file: Path) -> None:
    """Raises ValueError, naming file and field, unless the metadata of a set are ours and sound."""
    metadata = read_object(file)
    if not isinstance(about := metadata.get(KEY), dict):
        raise ValueError(f"{file}: it was not recorded by wayfield record")
    # of a set without spaces, Minari would make the environment that it names to learn them
    for key in ("dataset_id", "observation_space", "action_space", "env_spec"):
        if not isinstance(metadata.get(key), str):
            raise ValueError(f"{file}: {key} must be text, got {shown(metadata.get(key))}")
    if metadata.get("data_format") != "arrow":
        raise ValueError(f"{file}: data_format must be 'arrow', got {shown(metadata.get('data_format'))}")
    for key, most in (("total_episodes", MOST_EPISODES), ("total_steps", 2**53)):
        if not is_whole(metadata.get(key), 1, most):
            raise ValueError(f"{file}: {key} must be a whole number from 1 to {most}, got {shown(metadata.get(key))}")
    if not isinstance(about.get("digest"), str) or not isinstance(about.get("policies"), dict):
        raise ValueError(f"{file}: {KEY} must have a digest and policies, got {shown(about)}")


def _check_episodes(data: Any, folder: Path) -> None:
    """Raises ValueError, naming the file, unless the episodes of a set are those that were recorded."""
    digests, steps = {}, 0
    for number in (int(each) for each in data.episode_indices):
        about = read_object(folder / str(number) / _METADATA)
        options = about.get("options")
        start = about.get("seed"), options.get("scenario") if isinstance(options, dict) else None
        if not all(is_whole(each, 0, LAST_OF_EPISODES) for each in start):
            raise ValueError(
                f"{folder / str(number) / _METADATA}: seed and options.scenario must be whole numbers >= 0, got "
                f"{shown(about.get('seed'))} and {shown(options)}"
            )
        own = about[KEY].get("digest") if isinstance(about.get(KEY), dict) else None  # older sets have none
        file = folder / str(number) / _EPISODE
        try:
            (read,) = data.storage.get_episodes([number])
            digests[number] = digest_of_episode(about, read)
        except Exception as error:
            raise ValueError(f"{file} is damaged: {error}") from None
        if own is not None and digests[number].hex() != own:
            raise ValueError(f"{file} is damaged: it does not have the SHA-256 that it was recorded with")
        steps += len(read["actions"])
    if digest_of_digests(digests) != data.storage.metadata[KEY]["digest"]:
        raise ValueError(f"{folder} is damaged: its episodes do not have the SHA-256 that they were recorded with")
    if steps != data.total_steps:
        raise ValueError(f"{folder / _METADATA}: total_steps is {data.total_steps}; the episodes have {steps}")


def digest_of_episode(about: Mapping[str, Any], read: Mapping[str, Any]) -> bytes:
    """Returns the SHA-256 of an episode's start and of every number in it, as Minari's storage gives them."""
    names = ("observations", "actions", "rewards", "terminations", "truncations")
    start = about["seed"], about["options"]["scenario"]
    return episode_digest(*start, (read[name] for name in names), read["infos"])


def episode_digest(
    seed: int, scenario: int, arrays: Iterable[NDArray[Any]], infos: Mapping[str, NDArray[Any]]
) -> bytes:
    """Returns the SHA-256 of an episode's start and of every number, little-endian."""
    sha = hashlib.sha256(f"{seed} {scenario}".encode())
    for array in arrays:
        sha.update(array.astype(array.dtype.newbyteorder("<")).tobytes())
    for name, values in infos.items():
        sha.update(name.encode() + values.astype(values.dtype.newbyteorder("<")).tobytes())
    return sha.digest()


def digest_of_digests(digests: Mapping[int, bytes]) -> str:
    """Returns the digest of a set from those of its episodes by number."""
    return hashlib.sha256(b"".join(digests[number] for number in sorted(digests))).hexdigest()
