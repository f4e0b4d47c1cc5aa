"""Many runs side by side, each in a process of its own that ends with this one."""

import dataclasses
import multiprocessing
import multiprocessing.queues
import multiprocessing.synchronize
import os
import queue
import signal
from collections.abc import Callable, Sequence

from wayfield.policies.training.run import Job, Report, interruptible, train
from wayfield.system.processes import end_with_parent, interrupts_held

GO_ON = "--resume goes on from its last save"


def train_all(jobs: Sequence[Job], at_once: int, report: Callable[[Report], None]) -> list[Report]:
    """Runs the jobs, `at_once` at a time, and returns their last reports in order.

    A job that fails says why in `error`; the others go on. Ctrl-C or SIGTERM stops them all: each saves and ends. A
    second one cuts them off.
    """
    if len(jobs) == 1:
        return [train(jobs[0], report)]
    context = multiprocessing.get_context("spawn")
    reports = context.Queue()
    stop = context.Event()
    waiting = list(range(len(jobs)))
    running: dict[int, multiprocessing.process.BaseProcess] = {}
    last: dict[int, Report] = {}
    try:
        with interruptible() as interrupted:
            while running or (waiting and not interrupted.number):
                while waiting and len(running) < at_once and not interrupted.number:
                    k = waiting.pop(0)
                    running[k] = context.Process(target=_work, args=(k, jobs[k], reports, stop, os.getpid()))
                    with interrupts_held():
                        running[k].start()
                if interrupted.number:
                    stop.set()
                try:
                    k, each, ended = reports.get(timeout=0.5)
                except queue.Empty:
                    for k, process in list(running.items()):
                        if not process.is_alive() and reports.empty():
                            # a signal to the whole group may meet it while it cannot heed one yet
                            if not (interrupted.number and process.exitcode == -interrupted.number):
                                problem = f"its process ended with status {process.exitcode}; {GO_ON}"
                                last[k] = Report(jobs[k].seed, 0, jobs[k].plan.frames, error=problem)
                            del running[k]
                    continue
                last[k] = each
                if ended:
                    running.pop(k).join()
                report(each)
    finally:
        for process in running.values():
            process.kill()
    ends = [last.get(k, Report(job.seed, 0, job.plan.frames)) for k, job in enumerate(jobs)]
    return [each if each.done else dataclasses.replace(each, stopped=interrupted.number) for each in ends]


def _work(
    k: int,
    job: Job,
    reports: "multiprocessing.queues.Queue[tuple[int, Report, bool]]",
    stop_requested: multiprocessing.synchronize.Event,
    parent: int,
) -> None:
    end_with_parent(parent)
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    last = Report(job.seed, 0, job.plan.frames)
    try:
        if not stop_requested.is_set():
            last = train(job, lambda each: reports.put((k, each, False)), (signal.SIGTERM,), stop_requested.is_set)
    except KeyboardInterrupt:
        last = dataclasses.replace(last, error=f"interrupted twice; {GO_ON}")
    except MemoryError as error:
        last = dataclasses.replace(last, error=f"out of memory: {error}; {GO_ON}")
    except (ValueError, FloatingPointError, OSError) as error:
        last = dataclasses.replace(last, error=" ".join(str(error).split()))
    reports.put((k, last, True))
