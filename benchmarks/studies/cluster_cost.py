"""What sharing out costs a part, and how well workers are used: python benchmarks/studies/cluster_cost.py

Parts that do nothing show what the executor itself takes, in time and in processor time of this process, which holds
the client and the scheduler. Parts of a known work show the efficiency: the time that one process needs for them by
itself, over the time with n workers times n. The machine must be otherwise idle.
"""

import time

import click
import rich.console
import rich.table

from wayfield.system.cluster import LOCAL, cluster
from wayfield.system.command_line import Finite, OneLineErrors
from wayfield.system.executors import HERE, Executor


def nothing(k: int) -> int:
    """Returns its argument."""
    return k


def busy(seconds: float) -> float:
    """Keeps a core busy for so much processor time (s), and returns it."""
    began = time.thread_time()
    while time.thread_time() - began < seconds:
        pass
    return seconds


def cost(executor: Executor, count: int) -> tuple[float, float]:
    """Returns the time and the processor time of this process that a part takes which does nothing, s."""
    began, worked = time.perf_counter(), time.process_time()
    for _ in executor.as_done(nothing, range(count)):
        pass
    return (time.perf_counter() - began) / count, (time.process_time() - worked) / count


def taken(executor: Executor, count: int, seconds: float) -> float:
    """Returns the time (s) of parts that each keep a core busy."""
    began = time.perf_counter()
    for _ in executor.as_done(busy, [seconds] * count):
        pass
    return time.perf_counter() - began


@click.command("cluster_cost", cls=OneLineErrors)
@click.option("--parts", type=click.IntRange(min=10), default=2000, show_default=True, help="That do nothing.")
@click.option("--busy", "count", type=click.IntRange(min=2), default=40, show_default=True, help="That do something.")
@click.option("--seconds", type=Finite(0.01, 60.0), default=0.5, show_default=True, help="Of such a part.")
def main(parts: int, count: int, seconds: float) -> None:
    """Prints what the executor of --cluster local costs a part, and how well it uses one and two workers."""
    alone = taken(HERE, count, seconds)
    table = rich.table.Table(title="Executor of --cluster local", title_justify="left")
    for header in (
        "workers",
        "a part (ms)",
        "of it this process (ms)",
        f"{count} parts of {seconds:g} s (s)",
        "efficiency",
    ):
        table.add_column(header, justify="right")
    table.add_row("none", "", "", f"{alone:.2f}", "1.00")
    for n in (1, 2):
        with cluster(LOCAL, n) as executor:
            taken(executor, n, 0.01)  # they are there
            whole, ours = cost(executor, parts)
            time_taken = taken(executor, count, seconds)
        efficiency = f"{alone / time_taken / n:.2f}"
        table.add_row(str(n), f"{1e3 * whole:.2f}", f"{1e3 * ours:.2f}", f"{time_taken:.2f}", efficiency)
    rich.console.Console(width=100).print(table)


if __name__ == "__main__":
    main()
