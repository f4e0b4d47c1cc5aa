"""The scripts of examples/: by default those of the libraries that the tests have, all of them in the slow part."""

import os
import re
import runpy
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
from wayfield.policies.learned.ppo import shipped

ROOT = Path(__file__).parents[1]
EXAMPLES = ROOT / "examples"

# script: what pip installs beside wayfield
LIBRARIES = {
    "cleanrl_ppo.py": ["torch"],
    "minari_collect.py": ["minari[create,hdf5]", "pillow"],
    "onnx_drive.py": ["click", "onnx", "onnxruntime"],
    "rllib_ppo.py": ["ray[rllib]", "torch"],
    "sb3_contrib_recurrent_ppo.py": ["sb3-contrib", "stable-baselines3", "torch"],
    "sb3_ppo.py": ["stable-baselines3", "torch"],
    "skrl_ppo.py": ["skrl", "torch"],
}
HERE = [
    ("onnx_drive.py",),
    ("sb3_ppo.py",),
    ("cleanrl_ppo.py", "--autoreset", "NextStep"),
    ("cleanrl_ppo.py", "--autoreset", "SameStep"),
]


def run(python: Path | str, script: str, *arguments: str, folder: Path) -> str:
    """Returns what an example prints, run in another folder so that the installed package is what it finds."""
    command = [str(python), str(EXAMPLES / script), *arguments]
    environment = os.environ | {
        "OMP_NUM_THREADS": "1",  # on a shared machine threads of torch that wait for each other take minutes
        "MINARI_DATASETS_PATH": str(folder / "minari"),
        "RAY_ACCEL_ENV_VAR_OVERRIDE_ON_ZERO": "0",
    }
    done = subprocess.run(
        command, cwd=folder, env=environment, capture_output=True, text=True, timeout=900, check=False
    )
    assert done.returncode == 0, done.stdout[-2000:] + done.stderr[-4000:]
    return done.stdout


def steps_told(output: str) -> int:
    """Returns the number of steps in the last line that an example prints."""
    return int(re.findall(r"(\d+) steps", output)[-1])


def test_no_example_is_forgotten() -> None:
    assert sorted(LIBRARIES) == sorted(file.name for file in EXAMPLES.glob("*.py"))


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
@pytest.mark.parametrize("script", sorted(LIBRARIES))
def test_an_example_runs_with_its_library_freshly_installed(script: str, tmp_path: Path) -> None:
    try:
        urllib.request.urlopen("https://pypi.org/simple/pip/", timeout=20).close()
    except (urllib.error.URLError, TimeoutError) as error:
        pytest.skip(f"the registry of packages is not reachable: {error}")
    # gymnasium as the library wants it: RLlib pins another release than ours
    pins = [line for line in (ROOT / "constraints.txt").read_text().splitlines() if not line.startswith("gymnasium")]
    (tmp_path / "constraints.txt").write_text("\n".join(pins) + "\n")
    subprocess.run([sys.executable, "-m", "venv", tmp_path / "venv"], check=True)
    python = tmp_path / "venv/bin/python"
    pip = [python, "-m", "pip", "--quiet"]
    subprocess.run(
        [*pip, "install", "-c", tmp_path / "constraints.txt", f"wayfield @ {ROOT.as_uri()}", *LIBRARIES[script]],
        check=True,
    )
    names = {"gymnasium", "numpy", *(name.split("[")[0] for name in LIBRARIES[script])}
    listed = subprocess.run([*pip, "freeze"], capture_output=True, text=True, check=True).stdout.splitlines()
    print(*(line for line in listed if line.split("==")[0].replace("_", "-") in names))
    assert steps_told(run(python, script, "--steps", "512", folder=tmp_path)) >= 512
