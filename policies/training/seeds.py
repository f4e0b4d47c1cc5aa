"""Many runs side by side, each in a process of its own."""

import multiprocessing
import queue
from collections.abc import Callable, Sequence

from wayfield.policies.training.run import Job, Report, interruptible, train

GO_ON = "--resume goes on from its last save"


def train_all(jobs: Sequence[Job], at_once: int, report: Callable[[Report], None]) -> list[Report]:
    """Runs the jobs, `at_once` at a time, and returns their last reports in order.

    A job that fails says why in `error`; the others go on. Ctrl-C reaches every process: each saves and ends.
    """
    if len(jobs) == 1:
        return [train(jobs[0], report)]
    context = multiprocessing.get_context("spawn")
    reports = context.Queue()
    waiting = list(range(len(jobs)))
    running: dict[int, multiprocessing.process.BaseProcess] = {}
    last: dict[int, Report] = {}
    with interruptible() as interrupted:
        while running or (waiting and not interrupted.is_set()):
            while waiting and len(running) < at_once and not interrupted.is_set():
                k = waiting.pop(0)
                running[k] = context.Process(target=_work, args=(k, jobs[k], reports))
                running[k].start()
            try:
                k, each, ended = reports.get(timeout=0.5)
            except queue.Empty:
                for k, process in list(running.items()):
                    if not process.is_alive() and reports.empty():
                        job = jobs[k]
                        problem = f"its process ended with status {process.exitcode}; {GO_ON}"
                        last[k] = Report(job.seed, 0, job.preset.steps, error=problem)
                        del running[k]
                continue
            last[k] = each
            if ended:
                running.pop(k).join()
            report(each)
    return [last.get(k, Report(job.seed, 0, job.preset.steps)) for k, job in enumerate(jobs)]


def _work(k: int, job: Job, reports: "multiprocessing.queues.Queue[tuple[int, Report, bool]]") -> None:
    try:
        last = train(job, lambda each: reports.put((k, each, False)))
    except KeyboardInterrupt:
        last = Report(job.seed, 0, job.preset.steps, error=f"interrupted twice; {GO_ON}")
    except (ValueError, OSError) as error:
        last = Report(job.seed, 0, job.preset.steps, error=str(error))
    reports.put((k, last, True))
