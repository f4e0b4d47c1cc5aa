"""`wayfield submit` and `wayfield verify`: an entry of a contest as a folder, and whether it drives as it says."""

from pathlib import Path

import click

from wayfield.benchmarks.commands.submission import Refused, check, content, differing, made, read_submission
from wayfield.benchmarks.entrants.own_policies import own_policy
from wayfield.benchmarks.records.cases import Entrant
from wayfield.system.command_line import OneLineErrors
from wayfield.system.storage import write_whole

_POLICY = click.option(
    "--policy",
    "own",
    metavar="SOURCE",
    help="The policy of an entry of your own, as in evaluate: module:Class with gains, or a model.zip, which can run "
    "code when it is loaded.",
)
_FOLDER = click.Path(path_type=Path)


@click.command("submit", cls=OneLineErrors)
@click.argument("run", type=_FOLDER)
@click.argument("entry")
@click.option("--out", required=True, metavar="DIR", help="The folder of the submission: new, or empty.")
@_POLICY
def submit(run: Path, entry: str, out: str, own: str | None) -> None:
    """Makes a submission of ENTRY, as tables call it, from RUN, the folder of a contest: `polar`, `"lqr (tuned)"`."""
    folder = Path(out)
    try:
        files = content(made(run, entry, _entrant(own)))
        if folder.exists() and any(folder.iterdir()):
            raise Refused(f"--out {out!r} is not empty")
        folder.mkdir(parents=True, exist_ok=True)
        for name, data in files.items():
            write_whole(folder / name, data)
    except ValueError as error:
        raise click.ClickException(str(error)) from None
    print(f"{folder}: verify it with `wayfield verify {folder}`")


@click.command("verify", cls=OneLineErrors)
@click.argument("folder", type=_FOLDER)
@click.option("--all", "every", is_flag=True, help="Drive every episode again.  [default: a sample]")
@click.option(
    "--sample", "most", type=click.IntRange(min=1), default=10, show_default=True,
    help="Cases of the sample, spread over the submission; two episodes of each are driven.",
)  # fmt: skip
@_POLICY
def verify(folder: Path, every: bool, most: int, own: str | None) -> None:
    """Drives a sample of the submission in FOLDER again and compares every bit; status 1 where one differs.

    Nothing in FOLDER is run: an entry from outside of the package needs --policy.
    """
    try:
        submission = read_submission(folder)
        entrant = _entrant(own)
        other = check(submission, entrant)
        driven, wrong = differing(submission, entrant, None if every else most)
    except ValueError as error:
        raise click.ClickException(str(error)) from None
    if wrong:
        raise click.ClickException(f"{folder}: {wrong}{f' ({other})' if other else ''}")
    outcome = f"{driven} of {len(submission.rows)} episodes were driven again, each the same to the last bit"
    print(f"{folder}: {outcome}{f', though {other}' if other else ''}")


def _entrant(own: str | None) -> Entrant | None:
    return None if own is None else own_policy(own)
