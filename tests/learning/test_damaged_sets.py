"""A recorded set is learned from as it was recorded, or not at all: one line names the file that is damaged."""

import json
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from click.testing import CliRunner

pytest.importorskip("pyarrow", reason='needs pip install "wayfield[record]"')
pytest.importorskip("minari", reason='needs pip install "wayfield[record]"')
pytest.importorskip("torch", reason='needs pip install "wayfield[train]"')

from wayfield.benchmarks.recordings import record
from wayfield.policies.training import offline

WORDS = ("pure_pursuit", "--suite", "path-following", "--family", "splines", "--episodes", "3", "--dataset", "mine-v0")
Damage = Callable[[Path], Any]


@pytest.fixture(scope="module")
def sound(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Returns the folder of a recorded set."""
    home = tmp_path_factory.mktemp("minari")
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("MINARI_DATASETS_PATH", str(home))
        result = CliRunner().invoke(record.main, WORDS)
        assert result.exit_code == 0, result.output
    return home / "mine-v0"


def flipped(file: Path, place: float) -> None:
    """Flips a bit of a file, at a share of its length."""
    content = bytearray(file.read_bytes())
    content[int(place * len(content))] ^= 4
    file.write_bytes(content)


def said(file: Path, **values: Any) -> None:
    """Writes other values into a JSON file."""
    file.write_text(json.dumps(json.loads(file.read_text()) | values))


@pytest.mark.parametrize(
    ("damage", "named"),
    [
        (lambda data: flipped(data / "1" / "part-0.arrow", 0.5), "1/part-0.arrow"),
        (lambda data: said(data / "1" / "metadata.json", options=3), "1/metadata.json"),
        (lambda data: said(data / "metadata.json", total_episodes=2), "data is damaged"),
        (lambda data: said(data / "metadata.json", wayfield={"digest": 1}), "metadata.json: wayfield"),
        (lambda data: (data / "2" / "part-0.arrow").write_bytes(b"ARROW1"), "2/part-0.arrow"),
        (lambda data: said(data / "1" / "metadata.json", seed=77), "1/part-0.arrow"),
        (lambda data: said(data / "metadata.json", total_episodes=-1), "metadata.json: total_episodes"),
        (lambda data: said(data / "metadata.json", total_steps=7), "metadata.json: total_steps"),
        (lambda data: said(data / "metadata.json", wayfield=[1]), "metadata.json: it was not recorded"),
        (lambda data: said(data / "metadata.json", action_space=None), "metadata.json: action_space"),
    ],
)
def test_a_damaged_set_is_one_line_that_names_the_file(damage: Damage, named: str, sound: Path, tmp_path: Path) -> None:
    folder = shutil.copytree(sound, tmp_path / "set")
    damage(folder / "data")
    out = tmp_path / "agents"
    result = CliRunner().invoke(offline.main, ["bc", str(folder), "--gradient-steps", "1", "--out", str(out)])
    assert result.exit_code == 2, result.output
    assert named in result.output
    assert len(result.output.splitlines()[-1]) <= 1000
    assert not out.exists()


def test_the_entry_point_that_a_set_names_is_not_imported(sound: Path, tmp_path: Path) -> None:
    folder = shutil.copytree(sound, tmp_path / "set")
    file = folder / "data" / "metadata.json"
    spec = json.loads(json.loads(file.read_text())["env_spec"])
    (tmp_path / "evil.py").write_text(f"open({str(tmp_path / 'ran')!r}, 'w')")
    said(file, env_spec=json.dumps(spec | {"entry_point": "evil:Env"}))
    with pytest.MonkeyPatch.context() as patch:
        patch.syspath_prepend(tmp_path)
        assert offline.task_of(offline.opened(str(folder))).spec.name == "path_following"
    assert not (tmp_path / "ran").exists()
