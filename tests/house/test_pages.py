"""README, docs and tutorials run as they are printed: the Python in every run, every shell line in the slow part.

A page's blocks run in order, in one folder of that page. A block below a line that ends with a file's name and a colon
is that file. Each line runs to its end but those of LONG; only those of LEFT_OUT are not run.
"""

import os
import re
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
PAGES = [ROOT / "README.md", *sorted((ROOT / "docs").glob("*.md")), *sorted((ROOT / "docs/tutorials").glob("*.md"))]
BLOCK = re.compile(r"(?:`([\w/]+\.\w+)`:\n\n)?^```(python|bash|text|json)\n(.*?)^```$", re.MULTILINE | re.DOTALL)

# what a line or a Python block contains that is not run, and why not
LEFT_OUT = {
    "pip install": "it would change the environment of the tests; .ci/run runs README's in fresh ones",
    "uvx": "it needs uv, which the tests do not install",
    "pytest": "these are the tests",
    "config.environment(": "one call of a script of RLlib's, which examples/rllib_ppo.py is",
    "10.0.0.5": "it needs a second machine; tests of clusters start schedulers here",
    "#SBATCH": "it needs SLURM",
    "kubectl": "it needs Kubernetes",
    "--data ": "it needs files of public benchmarks, which do not ship",
}
# Python that needs what shell lines of its page left, or minutes, so that it runs in the slow part alone
SLOW = ("results/", "load_dataset", "localhost:23000", "workers=4", "model.learn")
# What works for longer than a test may wait: interrupted (Ctrl-C) after so many seconds, in which it must not fail.
LONG = {
    "wayfield play": 30,  # until its window is closed, here an unseen one
    "--suite": 45,  # contests and searches of half an hour to days
    "train": 45,  # millions of frames
    "--video": 45,
    "flocks.py --drive": 45,
    "tune_all": 45,
    "compare([": 45,
}
# which later lines need, however long
WHOLE = ("--episodes 1", "results/short", "results/mine", "gains.json", "offline")
SERVER = "python -m wayfield.bridges.coppelia"  # runs beside the lines below it
LIMIT = 1200  # s, of a line


def parts(page: Path) -> list[tuple[str, str, str]]:
    """Returns file (or ""), language and text of each block of a page; of shell blocks, of each line."""
    found = []
    for name, language, text in BLOCK.findall(page.read_text(encoding="utf-8")):
        whole = language != "bash" or text.startswith("#!") or name
        lines = [text] if whole else text.replace("\\\n", " ").splitlines()
        found += [(name, language, line) for line in lines]
    return found


def save(file: Path, text: str) -> None:
    """Writes a file that a page shows."""
    file.parent.mkdir(exist_ok=True)
    file.write_text(text)


def left_out(text: str) -> bool:
    """Returns whether a line is one of LEFT_OUT, by what it does and not by its comment."""
    return any(part in text.partition("  #")[0] for part in LEFT_OUT)


def paged(page: Path) -> str:
    """Returns the name of a page below docs."""
    return page.relative_to(ROOT).with_suffix("").as_posix()


PYTHON = [page for page in PAGES if any(language == "python" for _, language, _ in parts(page))]
SHELL = [page for page in PAGES if any(language == "bash" and not left_out(text) for _, language, text in parts(page))]


@pytest.mark.parametrize("page", PYTHON, ids=paged)
def test_the_python_of_a_page_runs(page: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.syspath_prepend(tmp_path)
    for name, language, text in parts(page):
        if name:
            save(tmp_path / name, text)
        elif language == "python" and not left_out(text) and not any(part in text for part in SLOW):
            exec(compile(text, paged(page), "exec"), {"__name__": "__main__"})


def test_no_exception_outlives_its_line() -> None:
    lines = [text for page in PAGES for _, _, text in parts(page)]
    exceptions = [*LEFT_OUT, *SLOW, *LONG, *WHOLE, SERVER]
    assert [each for each in exceptions if not any(each in line for line in lines)] == []


@pytest.mark.slow
@pytest.mark.parametrize("page", SHELL, ids=paged)
def test_a_page_runs_as_it_is_printed(page: Path, tmp_path: Path) -> None:
    """Each Python block is a process of its own, as each line is."""
    for script in ("evaluate.py", "train.py"):
        shutil.copy(ROOT / script, tmp_path)
    shutil.copytree(ROOT / "benchmarks/studies", tmp_path / "benchmarks/studies")
    servers: list[subprocess.Popen[bytes]] = []
    try:
        for name, language, text in parts(page):
            if name:
                save(tmp_path / name, text)
            elif language in ("python", "bash") and text.strip() and not left_out(text):
                command = [sys.executable, "-c", text] if language == "python" else ["bash", "-c", f"exec {text}"]
                if text.startswith(SERVER) and "--legacy" not in text:
                    stop(servers)
                    servers.append(start(command, tmp_path))
                    time.sleep(20)
                    assert servers[-1].poll() is None, said(text, tmp_path)
                else:
                    finish(command, text, tmp_path)
    finally:
        stop(servers)


def start(command: list[str], folder: Path) -> subprocess.Popen[bytes]:
    """Returns a running command, in a group of its own; what it prints goes to the file `said`."""
    environment = os.environ | {
        "PATH": f"{Path(sys.executable).parent}:{os.environ['PATH']}",
        "SDL_VIDEODRIVER": "dummy",  # windows are unseen
        "BROWSER": "true",  # which opens nothing
        "MINARI_DATASETS_PATH": str(folder / "minari"),
    }
    with open(folder / "said", "wb") as file:
        return subprocess.Popen(command, cwd=folder, env=environment, stdout=file, stderr=file, start_new_session=True)


def said(text: str, folder: Path) -> str:
    """Returns what a failed line printed last, below the line."""
    return f"{text}\n{(folder / 'said').read_text(errors='replace')[-3000:]}"


def finish(command: list[str], text: str, folder: Path) -> None:
    """Waits for a line to end well, or interrupts one of LONG, which may then end as interrupted."""
    what = text.partition("  #")[0]
    long = [seconds for part, seconds in LONG.items() if part in what and not any(each in what for each in WHOLE)]
    running = start(command, folder)
    try:
        running.wait(min(long, default=LIMIT))
    except subprocess.TimeoutExpired:
        assert long, f"longer than {LIMIT} s: {said(text, folder)}"
        stop([running])
        assert running.returncode in (0, 1, 130, -signal.SIGINT), said(text, folder)
        assert "Error" not in said(text, folder).replace("KeyboardInterrupt", ""), said(text, folder)
    else:
        assert running.returncode == 0, said(text, folder)


def stop(running: list[subprocess.Popen[bytes]]) -> None:
    """Interrupts commands and waits for their ends."""
    for process in running:
        os.killpg(process.pid, signal.SIGINT)
        try:
            process.wait(60)
        except subprocess.TimeoutExpired:
            os.killpg(process.pid, signal.SIGKILL)
            raise
    running.clear()
