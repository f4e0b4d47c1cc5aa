"""`wayfield submit` and `wayfield verify`: an entry of a contest as a folder, and whether it drives as it says."""

import contextlib
from pathlib import Path

import click

from wayfield.benchmarks.commands.submission import (
    check,
    content,
    differing,
    draw_seed,
    drawn,
    least_seen,
    made,
    other_code,
    read_submission,
)
from wayfield.benchmarks.entrants.apart import SECONDS, Apart
from wayfield.benchmarks.entrants.own_policies import own_policy
from wayfield.system.command_line import OneLineErrors
from wayfield.system.storage import write_whole

_POLICY = click.option(
    "--policy",
    "own",
    metavar="SOURCE",
    help="Your own policy, as in evaluate: module:Class with gains, or a model.zip (loading it can run code).",
)
_FOLDER = click.Path(path_type=Path)


@click.command("submit", cls=OneLineErrors)
@click.argument("run", type=_FOLDER)
@click.argument("entry")
@click.option("--out", required=True, metavar="DIR", help="The folder of the submission: new, or empty.")
@_POLICY
def submit(run: Path, entry: str, out: str, own: str | None) -> None:
    """Makes a submission of ENTRY, as tables call it, from RUN, the folder of a contest: `polar`, `"lqr (tuned)"`.

    It must hold every frozen scenario of its split.
    """
    folder = Path(out)
    try:
        if folder.exists() and any(folder.iterdir()):
            raise ValueError(f"--out {out!r} is not empty")
        files = content(made(run, entry, None if own is None else own_policy(own)))
        folder.mkdir(parents=True, exist_ok=True)
        for name, data in files.items():
            write_whole(folder / name, data)
    except ValueError as error:
        raise click.ClickException(str(error)) from None
    print(f"{folder}: verify it with `wayfield verify {folder}`")


@click.command("verify", cls=OneLineErrors)
@click.argument("folder", type=_FOLDER)
@click.option("--all", "every", is_flag=True, help="Re-run every episode.  [default: a sample]")
@click.option(
    "--sample", "most", type=click.IntRange(min=1), default=60, show_default=True, help="Episodes of the sample."
)
@click.option(
    "--seed", type=click.IntRange(min=0), help="Seed of the sample.  [default: of the entry's digest and the clock]"
)
@click.option(
    "--seconds", type=click.FloatRange(min=0.0, min_open=True), default=SECONDS, show_default=True,
    help="Most time for a decision of your own policy; loading it and the first decision may take two minutes.",
)  # fmt: skip
@_POLICY
def verify(folder: Path, every: bool, most: int, seed: int | None, seconds: float, own: str | None) -> None:
    """Checks the submission in FOLDER against the frozen scenarios, and drives a sample of it again, drawn at random.

    Every bit is compared; status 1 where one differs. Nothing in FOLDER is run: an entry from outside of the package
    needs --policy, and runs in a process of its own, which gets briefings and observations.
    """
    other = ""
    with contextlib.ExitStack() as stack:
        try:
            submission = read_submission(folder)
            entrant = None if own is None else stack.enter_context(Apart(own, seconds))
            other = other_code(submission, entrant)
            check(submission, entrant)
            seed = draw_seed(submission) if seed is None else seed
            numbers = drawn(len(submission.rows), None if every else most, seed)
            if wrong := differing(submission, entrant, numbers):
                raise ValueError(f"{folder}: {wrong}; drawn with --seed {seed}")
        except ValueError as error:
            raise click.ClickException(f"{error}{f' ({other})' if other else ''}") from None
    count, driven = len(submission.rows), len(numbers)
    outcome = f"{driven} of {count} episodes were driven again, each the same to the last bit"
    if driven < count:
        forged = least_seen(count, driven)
        outcome += f"; drawn with --seed {seed}, which meets one of {forged} forged episodes with 95 % probability"
    print(f"{folder}: {outcome}{f', though {other}' if other else ''}")
