"""An editable install, which type checkers follow. README's lines are run as printed by .ci/run."""

import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

ROOT = Path(__file__).parents[2]

USER = """
import gymnasium
import numpy as np

import wayfield
from wayfield.envs.path_following import Observation
from wayfield.envs.robots import ROBOTS, Robot
from wayfield.policies import Pilot, make

robot: Robot = ROBOTS["p3dx"]
radius: float = robot.hull_radius
env = gymnasium.make("wayfield/DiffDrivePathFollowing-v0")
pilot = Pilot(make("pure_pursuit"), env)


def sideways(seen: Observation) -> bool:
    return bool(np.abs(seen.cross_track_error).max() > radius)
"""


def copy_of_the_repository(folder: Path) -> Path:
    """Returns a copy in a folder, since an install rebuilds the links that another one may be using."""
    leave = shutil.ignore_patterns(".*", "build", "results", "*.egg-info", "__pycache__")
    return Path(shutil.copytree(ROOT, folder / "wayfield", ignore=leave))


@pytest.mark.slow
def test_mypy_follows_a_plain_editable_install(tmp_path: Path) -> None:
    copy = copy_of_the_repository(tmp_path)
    subprocess.run([sys.executable, "-m", "venv", tmp_path / "venv"], check=True)
    python = tmp_path / "venv/bin/python"
    site = next((tmp_path / "venv/lib").glob("python*/site-packages"))
    (site / "zz_present.pth").write_text(f"{Path(np.__file__).parents[2]}\n")  # nothing is downloaded
    # Python 3.11 puts an old setuptools into each environment
    subprocess.run([python, "-m", "pip", "uninstall", "--quiet", "--yes", "setuptools"], check=True)
    install = [python, "-m", "pip", "install", "--quiet", "--no-index", "--no-deps", "--no-build-isolation"]
    subprocess.run([*install, "-e", copy], check=True)
    user = tmp_path / "user"
    user.mkdir()
    (user / "mine.py").write_text(USER)
    good = subprocess.run([python, "-m", "mypy", "--strict", "mine.py"], cwd=user, capture_output=True, text=True)
    assert good.returncode == 0, good.stdout
    (user / "mine.py").write_text(USER.replace("radius: float", "radius: str"))
    bad = subprocess.run([python, "-m", "mypy", "--strict", "mine.py"], cwd=user, capture_output=True, text=True)
    assert "Incompatible types" in bad.stdout
    # what the project writes about itself goes where git sees it, not into the links
    told = (
        "from wayfield.envs.scenarios import splits; from wayfield.benchmarks.tuning import tune; import wayfield; "
        + ("print(splits.FOLDER, tune.folder_of('path-following'), wayfield.__file__, sep='\\n')")
    )
    folders = subprocess.run([python, "-c", told], cwd=user, capture_output=True, text=True, check=True).stdout.split()
    assert folders[:2] == [str(copy / "envs/scenarios/splits"), str(copy / "policies/gains/path-following")]
    assert "build" in Path(folders[2]).parts
