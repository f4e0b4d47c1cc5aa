"""A damaged file under a digest that is made right again is refused in a line that names it."""

import hashlib
import json
from pathlib import Path

import numpy as np
import pytest
from safetensors.numpy import load_file, save_file

import wayfield.benchmarks.runs.shards  # noqa: F401  registers the reader of parts
from wayfield.policies.learned.agent import CARD, WEIGHTS, load_agent, signed, weights_digest
from wayfield.system.readers import READERS


@pytest.mark.parametrize("content", ["[" * 100_000, "{}", '[{"success": [1]}]'])
def test_rows_that_are_none(content: str, tmp_path: Path) -> None:
    reader = READERS["rows of a part"]
    file = reader.fill(tmp_path)
    digests = tmp_path / READERS["digests of a part"].file
    file.write_bytes(content.encode(errors="surrogateescape"))
    known = json.loads(digests.read_bytes()) | {file.name: hashlib.sha256(file.read_bytes()).hexdigest()}
    digests.write_text(json.dumps(known), encoding="utf-8")
    with pytest.raises(ValueError, match=file.name):
        reader.read(file)


def test_weights_so_large_that_a_network_overflows(tmp_path: Path) -> None:
    READERS["agent's weights"].fill(tmp_path)
    tensors = {name: np.full_like(tensor, 3e38) for name, tensor in load_file(tmp_path / WEIGHTS).items()}
    save_file(tensors, tmp_path / WEIGHTS)
    layers = [(tensors[f"layer_{k}.weight"], tensors[f"layer_{k}.bias"]) for k in range(len(tensors) // 2)]
    card = json.loads((tmp_path / CARD).read_bytes()) | {"sha256": weights_digest(layers)}
    (tmp_path / CARD).write_text(json.dumps(signed(card)), encoding="utf-8")
    with pytest.raises(ValueError, match=f"{WEIGHTS}: .* at most 1e\\+06 in size"):
        load_agent(tmp_path)
