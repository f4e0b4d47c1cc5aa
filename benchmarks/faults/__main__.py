"""The command line: python -m wayfield.benchmarks.faults --help"""

import signal
import sys
from pathlib import Path

import click

from wayfield.benchmarks.faults.campaign import GROUPS, repeated, run, totals_of
from wayfield.benchmarks.faults.place import Place
from wayfield.envs.command_line import Finite, Names, OneLineErrors
from wayfield.envs.storage import locked


@click.command("faults", cls=OneLineErrors)
@click.option("--minutes", type=Finite(0.0, 10_000.0, min_open=True), default=10.0, show_default=True)
@click.option("--seed", type=click.IntRange(0, 2**32 - 1), default=0, show_default=True, help="Of all that is drawn.")
@click.option("--out", type=click.Path(path_type=Path, file_okay=False), default=Path("results/faults"),
              show_default=True, help="Folder of the findings, the totals and the copy that is worked on.")  # fmt: skip
@click.option("--only", type=Names("--only", GROUPS), help=f"Only these groups of {', '.join(GROUPS)}.")
@click.option("--repeat", type=click.Path(path_type=Path, dir_okay=False), help="Does one finding's trial again.")
def main(minutes: float, seed: int, out: Path, only: tuple[str, ...] | None, repeat: Path | None) -> None:
    """Looks for faults: damaged files, random settings, kills, crowded folders, full disks, wrong command lines.

    Prints how many trials each group did and how many went wrong; ends with status 1 if any did. Every finding is kept
    in OUT/findings, for --repeat. Works on a copy of the package. Campaigns in one folder add up.
    """
    if minutes != minutes:
        raise click.UsageError("--minutes is nan; it must be a number above 0")
    if not out.name:
        raise click.UsageError("--out is empty; it must name a folder")
    out.mkdir(parents=True, exist_ok=True)
    for number in (signal.SIGTERM, signal.SIGINT):  # what was started is ended on the way out; jobs ignore the second
        signal.signal(number, lambda *_: sys.exit(130))
    with locked(out / ".lock", f"another campaign works in {out}"):
        place = Place(out)
        try:
            if repeat is not None:
                try:
                    problem = repeated(place, repeat)
                except (OSError, ValueError) as error:
                    raise click.UsageError(str(error)) from None
                click.echo(problem or "nothing is wrong any more")
                sys.exit(1 if problem else 0)
            counts = run(place, only or tuple(GROUPS), minutes, seed, click.echo)
        finally:
            place.close()
    for name, count in counts.items():
        moved = f", {count.steps:,} steps" if count.steps else ""
        click.echo(f"{name:10} {count.tried:7,} tried, {count.failed:5,} failed, {count.seconds:7.1f} s{moved}")
    totals = totals_of(out)
    whole = {key: sum(each[key] for each in totals.values()) for key in ("tried", "failed", "steps")}
    click.echo(f"in this folder so far {whole['tried']:,} tried, {whole['failed']:,} failed, {whole['steps']:,} steps")
    sys.exit(1 if any(count.failed for count in counts.values()) else 0)


if __name__ == "__main__":
    main()
