"""Prints the most memory that a process takes which verifies entries, or reads files that unpack to far more."""

import sys
from pathlib import Path

from click.testing import CliRunner

from wayfield.benchmarks.commands.submit import verify
from wayfield.benchmarks.entrants.own_policies import own_policy
from wayfield.benchmarks.records.results import read_trajectories
from wayfield.envs.scenarios import barn


def read_all(folder: Path) -> None:
    """Reads every bomb of a folder; prints what was not refused in a line, and the most memory by then and at last."""
    for each in sorted(folder.glob("*, *")):
        done = CliRunner().invoke(verify, [str(each)])
        if done.exit_code != 1 or done.stderr.count("\n") != 1 or str(each)[:40] not in done.stderr:
            print(f"{each}: {done.output} {done.stderr} {done.exception}")
    verified = peak()
    readers = {"*.zip": lambda file: own_policy(str(file)), "*.gz": barn.read_cylinders}
    readers["*.npz"] = lambda file: read_trajectories(file.parent)
    for pattern, reader in readers.items():
        for file in folder.rglob(pattern):
            try:
                reader(file)
                print(f"{file} was read")
            except ValueError as error:
                print(*[f"{file}: {error}"] * ("\n" in str(error)), sep="", end="")
    print(verified, peak(), sep="\n")


def peak() -> int:
    """Returns the most bytes that the process has taken; what resource.getrusage tells begins with the parent's."""
    return int(Path("/proc/self/status").read_text().partition("VmHWM:")[2].split()[0]) << 10


if __name__ == "__main__":
    if sys.argv[2:]:
        print(CliRunner().invoke(verify, sys.argv[1:]).output, peak(), sep="")
    else:
        read_all(Path(sys.argv[1]))
