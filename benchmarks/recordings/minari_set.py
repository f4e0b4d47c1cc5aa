"""A Minari data set of arrow files, written episode by episode: https://minari.farama.org.

Minari's own writer takes one single environment at a time, and looks at every file of the set after each episode. What
is written here is the same to the byte of every column, and read by Minari alone.
"""

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import gymnasium
import minari
import numpy as np
import pyarrow as pa
from minari.dataset.minari_storage import MinariStorage
from numpy.typing import NDArray

from wayfield.benchmarks.episodes.recorder import Episode
from wayfield.policies.training.recorded import KEY, digest_of_digests


def _padded(values: NDArray[Any], rows: int) -> NDArray[Any]:
    """Returns values with a last row of zeros: Minari's tables are as long as the observations."""
    return np.concatenate([values, np.zeros((rows - len(values), *values.shape[1:]), values.dtype)])


def _lists(values: NDArray[Any]) -> pa.Array:
    """Returns rows (n, k) as arrow lists of fixed size."""
    flat = np.ascontiguousarray(values).reshape(-1)
    return pa.FixedSizeListArray.from_arrays(
        pa.array(flat), type=pa.list_(pa.from_numpy_dtype(values.dtype), values.shape[1])
    )


def table(episode: Episode) -> pa.RecordBatch:
    """Returns an episode as a record batch with Minari's columns."""
    rows = len(episode.observations)
    infos = [pa.array(values) for values in episode.infos.values()]
    return pa.RecordBatch.from_pydict(
        {
            "observations": _lists(episode.observations),
            "actions": _lists(_padded(episode.actions, rows)),
            "rewards": _padded(episode.rewards, rows),
            "terminations": _padded(episode.terminations, rows),
            "truncations": _padded(episode.truncations, rows),
            "infos": pa.StructArray.from_arrays(infos, names=list(episode.infos)),
        }
    )


class MinariSet:
    """A set that is being written into an empty folder.

    Args:
        folder: of the whole set; it gets Minari's `data`.
        env: a single environment, from which Minari makes its spaces and finds it again.
    """

    def __init__(self, folder: Path, env: gymnasium.Env[Any, Any]) -> None:
        self.folder = folder / "data"
        self._storage = MinariStorage.new(
            self.folder,
            observation_space=env.observation_space,
            action_space=env.action_space,
            env_spec=env.spec,
            data_format="arrow",
            jpeg_encoding=False,
        )
        self._steps: dict[int, int] = {}
        self._digests: dict[int, bytes] = {}
        self._bytes = 0

    def write(self, number: int, episode: Episode, metadata: Mapping[str, Any]) -> None:
        """Writes an episode under its number, with its metadata."""
        folder = self.folder / str(number)
        folder.mkdir()
        batch = table(episode)
        with pa.OSFile(str(folder / "part-0.arrow"), "wb") as sink, pa.ipc.new_file(sink, batch.schema) as writer:
            writer.write_batch(batch)
        start, digest = episode.start, episode.digest()
        content = {
            "id": number,
            "total_steps": len(episode.actions),
            "seed": start.seed,
            "options": {"scenario": start.scenario},
            KEY: {**metadata, "digest": digest.hex()},
        }
        (folder / "metadata.json").write_text(json.dumps(content))
        self._steps[number] = len(episode.actions)
        self._digests[number] = digest
        self._bytes += batch.nbytes

    def close(self, dataset_id: str, metadata: Mapping[str, Any], **described: Any) -> str:
        """Writes what is known of the whole set; returns its digest.

        Args:
            metadata: what stands under our key: fields, policies, seeds, command.
            described: Minari's own fields, such as algorithm_name and description.
        """
        digest = digest_of_digests(self._digests)
        self._storage.update_metadata(
            {
                "dataset_id": dataset_id,
                "minari_version": minari.__version__,
                "total_episodes": len(self._steps),
                "total_steps": sum(self._steps.values()),
                "dataset_size": round(self._bytes / 1e6, 1),
                **described,
                KEY: {**metadata, "digest": digest},
            }
        )
        return digest
