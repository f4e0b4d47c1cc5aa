"""Small files that stand for large ones are refused at once, in a line."""

import subprocess
import sys
from pathlib import Path

from wayfield.system.checks import shown

READ = """
import sys
from wayfield.system.objects import json_object
from wayfield.envs.scenarios.maps import grid_from_file
for file in sys.argv[1:]:
    try:
        (grid_from_file if file.endswith("yaml") else json_object)(file)
    except ValueError as error:
        print(error)
"""
TENS = "a0: &a0 [1]\n" + "".join(f"a{k}: &a{k} [{', '.join([f'*a{k - 1}'] * 9)}]\n" for k in range(1, 12))
SETTINGS = "resolution: 0.05\norigin: [0, 0, 0]\n"
MANY = 500_000


def test_a_file_is_read_in_time_that_grows_with_its_size(tmp_path: Path) -> None:
    twice = "{" + ",".join(f'"k{k}":1' for k in [*range(MANY), MANY - 1]) + "}"
    files = {
        "nested.yaml": (f"{TENS}image: *a11\n{SETTINGS}", "nested.yaml:1: 'a0' is an anchor or an alias"),
        "room.yaml": (f"image: &own room.pgm\nnote: *own\n{SETTINGS}", "room.yaml:1: 'own' is an anchor or an alias"),
        "goal.json": (twice, f"goal.json: field 'k{MANY - 1}' is given twice"),
    }
    for name, (text, _) in files.items():
        (tmp_path / name).write_text(text)
    words = [sys.executable, "-c", READ, *(tmp_path / name for name in files)]
    run = subprocess.run(words, capture_output=True, text=True, timeout=60, check=True)
    for line, (_, said) in zip(run.stdout.splitlines(), files.values(), strict=True):
        assert said in line


def test_a_value_that_holds_itself_a_billion_times_over_is_shown_at_once() -> None:
    value: object = "x"
    for _ in range(20):
        value = [value, {"key": value}, (value,)]
    assert len(shown(value)) == 60
