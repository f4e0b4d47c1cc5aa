"""The fault campaign, as it is started: it notices a defect, keeps it, and does it again."""

import os
import re
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path

import wayfield
from wayfield import benchmarks, envs, policies
from wayfield.command import COMMANDS

CAMPAIGN = Path(__file__).parents[1] / "faults"


def campaign(folder: Path, *words: str) -> subprocess.CompletedProcess[str]:
    """Runs the campaign on the package in a folder, or on the one that is installed."""
    line = [sys.executable, str(CAMPAIGN), "--out", str(folder / "out"), *words]
    environment = os.environ | {"PYTHONPATH": str(folder)}
    return subprocess.run(line, env=environment, capture_output=True, text=True, check=False, timeout=300)


def test_a_planted_defect_is_found_and_repeated_until_it_is_mended(tmp_path: Path) -> None:
    for part, module in (("", wayfield), ("envs", envs), ("policies", policies), ("benchmarks", benchmarks)):
        ignored = shutil.ignore_patterns("__pycache__")
        shutil.copytree(module.__path__[0], tmp_path / "wayfield" / part, ignore=ignored, dirs_exist_ok=True)
    command = tmp_path.joinpath(*COMMANDS["evaluate"].module.split(".")).with_suffix(".py")
    good = command.read_text(encoding="utf-8")
    command.write_text(f"{good}\nmain.callback = lambda **_: 1 / 0\n", encoding="utf-8")
    found = campaign(tmp_path, "--minutes", "0.01", "--only", "commands")
    assert found.returncode == 1, found.stderr
    assert "ZeroDivisionError" in found.stdout
    finding = str(next((tmp_path / "out" / "findings").iterdir()))
    assert campaign(tmp_path, "--repeat", finding).returncode == 1
    command.write_text(good, encoding="utf-8")
    assert "nothing is wrong any more" in campaign(tmp_path, "--repeat", finding).stdout


def test_ctrl_c_is_a_line_of_what_was_tried(tmp_path: Path) -> None:
    line = [sys.executable, str(CAMPAIGN), "--out", str(tmp_path), "--only", "commands"]
    with subprocess.Popen(line, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as process:
        while not list(tmp_path.glob("work/scratch/*")) and process.poll() is None:  # until it tries something
            time.sleep(0.05)
        process.send_signal(signal.SIGINT)
        try:
            _, told = process.communicate(timeout=60)
        finally:
            process.kill()
    assert process.returncode == 130
    assert re.fullmatch(r"faults: interrupted; commands: \d+ tried, 0 failed, .*\n", told), told
