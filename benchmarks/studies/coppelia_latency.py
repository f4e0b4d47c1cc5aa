"""How fast our CoppeliaSim server answers, with the real client: python benchmarks/studies/coppelia_latency.py

The server is a process of its own, as for a script. Medians count: the means of a busy machine tell of the machine.
"""

import contextlib
import multiprocessing
import os
import statistics
import time
from collections.abc import Callable, Iterator
from typing import Any

import click
import rich.console
import rich.table

from wayfield.system.command_line import Choice, Finite, OneLineErrors
from wayfield.system.extras import installs
from wayfield.system.processes import end_with_parent


def _serve(pipe: Any, dynamics: str, parent: int) -> None:
    """Serves document A's scene at wall-clock speed; answers each word with the lateness of passes and the CPU time."""
    end_with_parent(parent)
    from wayfield.envs.coppelia.scenes import Conditions, make_world
    from wayfield.envs.coppelia.server import Server

    with Server(make_world("document-a", Conditions(dynamics=dynamics)), port=0) as server:
        pipe.send(server.port)
        with contextlib.suppress(EOFError):
            while pipe.recv():
                pipe.send((list(server.lateness), time.process_time()))


@contextlib.contextmanager
def served(dynamics: str) -> Iterator[tuple[int, Callable[[], tuple[list[float], float]]]]:
    """Yields the port of a server in another process, and what asks it for lateness (s) and CPU time (s)."""
    context = multiprocessing.get_context("spawn")
    ours, theirs = context.Pipe()
    child = context.Process(target=_serve, args=(theirs, dynamics, os.getpid()), daemon=True)
    child.start()
    theirs.close()

    def ask() -> tuple[list[float], float]:
        ours.send(True)
        answer: tuple[list[float], float] = ours.recv()
        return answer

    try:
        yield ours.recv(), ask
    finally:
        ours.close()
        child.join(5)
        child.kill()


def median_time(call: Callable[[], object], count: int) -> float:
    """Returns the median duration of a call, s."""
    times = []
    for _ in range(count):
        began = time.perf_counter()
        call()
        times.append(time.perf_counter() - began)
    return statistics.median(times)


@click.command("coppelia_latency", cls=OneLineErrors)
@click.option("--calls", type=click.IntRange(min=10), default=2000, show_default=True, help="Of each kind.")
@click.option("--seconds", type=Finite(0.1, 600), default=5.0, show_default=True, help="Free running, idle.")
@click.option(
    "--dynamics",
    type=Choice("--dynamics", ("kinematic", "pymunk")),
    default="kinematic",
    show_default=True,
    help="The server's plant.",
)
def main(calls: int, seconds: float, dynamics: str) -> None:
    """Prints round trips, control loops, the lateness of passes, and the CPU that an idle server takes."""
    try:
        from coppeliasim_zmqremoteapi_client import RemoteAPIClient
    except ModuleNotFoundError as error:
        raise click.ClickException(f"{error.name} is missing: {installs('coppelia')}") from None
    table = rich.table.Table(title=f"CoppeliaSim server, {dynamics}, real client", title_justify="left")
    for header in ("measure", "value", "target"):
        table.add_column(header, justify="left" if header == "measure" else "right")
    with served(dynamics) as (port, ask):
        sim = RemoteAPIClient(port=port).require("sim")
        robot, left, right = (sim.getObject(path) for path in ("/PioneerP3DX", "/leftMotor", "/rightMotor"))
        _, before = ask()
        time.sleep(seconds)
        _, after = ask()
        idle = (after - before) / seconds
        trip = median_time(lambda: sim.getObjectPosition(robot), calls)
        sim.startSimulation()
        time.sleep(seconds)
        late, _ = ask()
        sim.stopSimulation(True)
        sim.setStepping(True)
        sim.startSimulation()

        def loop() -> None:
            sim.getObjectPosition(robot)
            sim.getObjectOrientation(robot)
            sim.setJointTargetVelocity(left, 1.0)
            sim.setJointTargetVelocity(right, 1.0)
            sim.step()

        looped = median_time(loop, calls)
        sim.stopSimulation(True)
    on_time = sum(each < 0.01 for each in late) / max(len(late), 1)
    table.add_row("getObjectPosition, median", f"{1e6 * trip:.0f} us", "150 us")
    table.add_row("loop of five calls with a step, median", f"{1e3 * looped:.2f} ms", "1 ms")
    table.add_row(f"free-running passes late by < 10 ms, of {len(late)}", f"{100 * on_time:.1f} %", "99 %")
    table.add_row("CPU of an idle server", f"{100 * idle:.2f} %", "3 %")
    rich.console.Console(width=100).print(table)


if __name__ == "__main__":
    main()
