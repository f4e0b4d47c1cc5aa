"""The scripts of examples/: by default those of the libraries that the tests have, all of them in the slow part."""

import json
import os
import re
import runpy
import shutil
import subprocess
import sys
import urllib.error
import urllib.request
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
import pytest

from wayfield.policies import Pilot, load_agent
from wayfield.policies.learned.onnx import export_onnx
from wayfield.policies.trained.ppo import shipped

ROOT = Path(__file__).parents[2]
EXAMPLES = ROOT / "examples"

SCRIPTS = sorted(file.name for file in EXAMPLES.glob("*.py"))
HERE = [
    ("onnx_drive.py",),
    ("sb3_ppo.py",),
    ("cleanrl_ppo.py", "--autoreset", "NextStep"),
    ("cleanrl_ppo.py", "--autoreset", "SameStep"),
]


def steps_told(output: str) -> int:
    """Returns the number of steps in the last line that an example prints."""
    return int(re.findall(r"(\d+) steps", output)[-1])


@pytest.mark.parametrize("command", HERE, ids=" ".join)
def test_an_example_runs(
    command: tuple[str, ...], tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    # in this process, which has loaded their libraries already
    script, *words = command
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "argv", [script, *words, "--steps", "8192"])
    runpy.run_path(str(EXAMPLES / script), run_name="__main__")
    assert steps_told(capsys.readouterr().out) == 8192


@pytest.mark.slow
def test_the_notebook_runs_from_its_first_cell_to_its_last(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    cells = json.loads((EXAMPLES / "identify_a_log.ipynb").read_text(encoding="utf-8"))["cells"]
    names = {"__name__": "__main__"}
    for cell in cells:
        if cell["cell_type"] == "code":
            exec(compile("".join(cell["source"]), "identify_a_log.ipynb", "exec"), names)
    assert (tmp_path / "mine.json").is_file()
    assert (tmp_path / "drive.png").is_file()


@pytest.mark.parametrize(("task", "seed"), [("path_following", 1), ("goal_reaching", 0)])
def test_the_graph_and_plain_numpy_drive_as_the_agent_does(task: str, seed: int, tmp_path: Path) -> None:
    onnx_drive = runpy.run_path(str(EXAMPLES / "onnx_drive.py"))
    agent = load_agent(shipped(task, "p3dx")[seed])
    export_onnx(agent, tmp_path / "agent.onnx")
    driver = onnx_drive["Driver"](tmp_path / "agent.onnx")
    env: Any = gymnasium.make(agent.card["env_id"], **agent.card["env_kwargs"])
    pilot = Pilot(agent, env)
    for scenario in (0, 70):
        seen, _ = env.reset(seed=scenario, options={"scenario": scenario})
        pilot.reset()
        driver.reset()
        for _ in range(200):
            asked = pilot.command(seen)
            np.testing.assert_allclose(driver.act(seen), asked, atol=2e-4)
            seen, _, terminated, _, _ = env.step(asked)
            if terminated:
                break


@pytest.mark.slow
@pytest.mark.parametrize("script", SCRIPTS)
def test_an_example_installs_and_runs_by_the_line_at_its_top(script: str, tmp_path: Path) -> None:
    try:
        urllib.request.urlopen("https://pypi.org/simple/pip/", timeout=20).close()
    except (urllib.error.URLError, TimeoutError) as error:
        pytest.skip(f"the registry of packages is not reachable: {error}")
    leave = shutil.ignore_patterns(".*", "build", "results", "*.egg-info", "__pycache__", "docs")
    clone = Path(shutil.copytree(ROOT, tmp_path / "wayfield", ignore=leave))
    subprocess.run([sys.executable, "-m", "venv", tmp_path / "venv"], check=True)
    (line,) = re.findall(r"^pip install .*; python examples/.*$", (EXAMPLES / script).read_text(), re.MULTILINE)
    environment = os.environ | {
        "PATH": f"{tmp_path / 'venv/bin'}:{os.environ['PATH']}",
        "OMP_NUM_THREADS": "1",  # on a shared machine threads of torch that wait for each other take minutes
        "MINARI_DATASETS_PATH": str(tmp_path / "minari"),
        "RAY_ACCEL_ENV_VAR_OVERRIDE_ON_ZERO": "0",
    }
    done = subprocess.run(
        ["bash", "-c", f"{line} --steps 512"], cwd=clone, env=environment, capture_output=True, text=True, timeout=1800
    )
    assert done.returncode == 0, done.stdout[-2000:] + done.stderr[-4000:]
    assert steps_told(done.stdout) >= 512
