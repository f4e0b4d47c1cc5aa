"""Training on other machines: a slice of a run at a time, whose folder travels there and back.

A slice goes on from the files of the run, trains until the first validation after a minute, and saves. So a worker
needs none of this machine's files, one that is lost costs a slice, and what has come back is a run like any other.
"""

import collections
import dataclasses
import tempfile
import threading
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path

from wayfield.envs.robots import ROBOTS
from wayfield.policies.training.checkpoints import LAST, LOCK, RUN
from wayfield.policies.training.run import Job, Report, check_folder, held, train
from wayfield.system.executors import Executor, Failed
from wayfield.system.storage import write_whole

SLICE = 60.0  # s
_ALONE = threading.Lock()  # torch draws from one generator a process, and a worker may have several threads


@dataclasses.dataclass(frozen=True)
class Slice:
    """A run as far as it is: its job, and the files of its folder by their path in it; none before it has begun."""

    job: Job
    files: Mapping[str, bytes]
    seconds: float  # of training, after which it ends behind the next validation
    sheet: bytes | None = None  # of a robot of one's own, whose file is on the machine that the run comes from

    def __str__(self) -> str:
        return f"seed {self.job.seed}"


def train_slice(piece: Slice) -> tuple[Report, dict[str, bytes]]:
    """Returns how far a run has come in a slice, and the files that it goes on from.

    Raises:
        ValueError: if the files are those of another run, or damaged.
        FloatingPointError: if the training diverged.
    """
    began, validated = time.monotonic(), []
    with _ALONE, tempfile.TemporaryDirectory() as scratch:
        folder = Path(scratch) / f"seed_{piece.job.seed}"
        for name, content in piece.files.items():
            (folder / name).parent.mkdir(parents=True, exist_ok=True)
            (folder / name).write_bytes(content)
        job = dataclasses.replace(piece.job, folder=folder, resume=RUN in piece.files)
        if piece.sheet is not None:
            sheet = Path(scratch) / Path(str(job.preset.worlds.robot)).name
            sheet.write_bytes(piece.sheet)
            job = dataclasses.replace(job, preset=job.preset.changed(robot=str(sheet)))
        last = train(
            job,
            lambda report: validated.append(report.row is not None),
            signals=(),
            stop_requested=lambda: any(validated) and time.monotonic() - began >= piece.seconds,
        )
        return last, files_of(folder)


def files_of(folder: Path) -> dict[str, bytes]:
    """Returns the files of a run by their path in its folder, the state that all others follow from first."""
    result = sorted(file for file in folder.rglob("*") if file.is_file() and file.name != LOCK)
    result.sort(key=lambda file: file.name != LAST)
    return {file.relative_to(folder).as_posix(): file.read_bytes() for file in result}


def train_far(
    executor: Executor, jobs: Sequence[Job], report: Callable[[Report], None], seconds: float = SLICE
) -> list[Report]:
    """Runs the jobs wherever the executor takes them, slice by slice, and returns their last reports in order.

    A job that fails twice says why in `error`; the others go on. What an interruption leaves, --resume goes on from.

    Raises:
        ValueError: if a folder holds another run, or files that are damaged.
        ConnectionError: if all workers are lost; what has come back is saved.
        OSError: if it cannot be saved.
    """
    for job in jobs:
        check_folder(job)
    # a run takes its turn behind all others, so that few workers share many runs out evenly
    robot = jobs[0].preset.worlds.robot
    sheet = Path(robot).read_bytes() if robot is not None and robot not in ROBOTS else None
    waiting = collections.deque(Slice(job, files_of(job.folder) if job.resume else {}, seconds, sheet) for job in jobs)
    handed: list[Slice] = []
    last = {job.seed: Report(job.seed, 0, job.plan.frames) for job in jobs}
    try:
        for k, (reached, files) in executor.as_done(train_slice, _Pieces(waiting, handed)):
            job = handed[k].job
            _keep(job, files)
            last[job.seed] = reached
            report(reached)
            if not reached.done and not reached.error:
                waiting.append(Slice(job, files, seconds, sheet))
    except Failed as failed:
        for piece, error in failed.failures:
            seed = piece.job.seed
            last[seed] = dataclasses.replace(last[seed], error=" ".join(str(error).split()))
    return [last[job.seed] for job in jobs]


class _Pieces:
    """What waits, as an iterator that goes on when more has come; `handed` keeps what it gave, by its number."""

    def __init__(self, waiting: "collections.deque[Slice]", handed: list[Slice]) -> None:
        self._waiting, self._handed = waiting, handed

    def __iter__(self) -> Iterator[Slice]:
        return self

    def __next__(self) -> Slice:
        if not self._waiting:
            raise StopIteration
        self._handed.append(dataclasses.replace(self._waiting[0], files={}))
        return self._waiting.popleft()


def _keep(job: Job, files: Mapping[str, bytes]) -> None:
    """Writes the files of a run, each whole or not at all."""
    with held(job.folder):
        for name, content in files.items():
            (job.folder / name).parent.mkdir(parents=True, exist_ok=True)
            write_whole(job.folder / name, content)
