"""Records episodes as a data set to learn from: wayfield record POLICY... --family F --episodes N

The set is a Minari data set (https://minari.farama.org) of arrow files: observations, float32 actions, rewards, ends
and infos of every step; for each episode its policy, gains, family, scenario and seed; for the whole set the named
fields of the observations, each policy's card, the command, and a digest of all numbers. Scenarios are those of the
training split by default. Needs the extra [record].
"""

import collections
import concurrent.futures
import contextlib
import dataclasses
import os
import shutil
import sys
import time
from collections.abc import Iterator, Sequence
from importlib import metadata as installed
from pathlib import Path
from typing import Any

import click
import gymnasium

import wayfield.envs  # noqa: F401  registers the ids
from wayfield import policies
from wayfield.benchmarks.contests import CONTESTS, Contest, Course, Entrants
from wayfield.benchmarks.contests.contest import with_agents
from wayfield.benchmarks.episodes.recorder import Episode, Start, record, robots_for
from wayfield.benchmarks.episodes.rollout import make_policy, make_vector
from wayfield.benchmarks.records.cases import Case
from wayfield.benchmarks.records.progress import tracked
from wayfield.envs.robots import ACTUATORS, Robot
from wayfield.envs.robots.disturbances import LEVELS
from wayfield.envs.robots.robot_option import robot_option
from wayfield.envs.scenarios.splits import SPLITS
from wayfield.envs.tasks.task import IN_PROCESS
from wayfield.policies.training.recorded import KEY
from wayfield.system.command_line import SEED, Choice, OneLineErrors, say, words_given
from wayfield.system.extras import installs
from wayfield.system.storage import clear_stale, locked, replace_folder, restore_folder, temporary_folder

_IN_FLIGHT = 64  # episodes that wait for the disk

# policies that act by the row they drive in, so that every episode of a row would be driven alike
_BY_ROW = ("random",)
_FLOOR = ("zero",)  # takes part in no contest and can drive in all


@dataclasses.dataclass(frozen=True)
class Conditions:
    """What all episodes of a set have in common."""

    split: str
    robot: Robot
    dynamics: str
    actuators: str
    disturbance: str
    gains: str
    exploration: float


@dataclasses.dataclass(frozen=True)
class Source:
    """Where episodes come from: a policy with its gains, in the scenarios of one family."""

    case: Case
    starts: tuple[Start, ...]
    first: int  # number of its first episode in the set


def sources(
    contest: Contest,
    names: tuple[str, ...],
    families: tuple[str, ...],
    episodes: int,
    seed: int,
    conditions: Conditions,
) -> list[Source]:
    """Returns what is driven: the episodes of the set, shared out evenly among policies and families in their order.

    Episode k of the set has seed `seed + k`; of a policy and family, episode j drives scenario j of the split, round
    and round.
    """
    sources_there = []
    cases = [
        case
        for name in names
        for family in families
        for case in contest.cases(
            conditions.robot,
            Course(family, conditions.split),
            Entrants((name,), (conditions.gains,)),
            conditions.disturbance,
        )
    ]
    first = 0
    for k, case in enumerate(cases):
        count = (k + 1) * episodes // len(cases) - k * episodes // len(cases)
        starts = tuple(Start(seed + first + j, j % SPLITS[conditions.split]) for j in range(count))
        if count:
            sources_there.append(Source(case, starts, first))
        first += count
    return sources_there


def recorded(source: Source, conditions: Conditions) -> Iterator[tuple[int, Episode]]:
    """Yields the episodes of a source with their numbers in the set."""
    env = make_vector(source.case, conditions.dynamics, conditions.actuators, 1)
    robots = robots_for(env, len(source.starts))
    if robots > 1:
        env.close()
        env = make_vector(source.case, conditions.dynamics, conditions.actuators, robots)
    for k, episode in record(env, make_policy(source.case, 0), source.starts, conditions.exploration):
        yield source.first + k, episode
    env.close()


def single(case: Case, conditions: Conditions, scenarios: Sequence[str] = ()) -> gymnasium.Env[Any, Any]:
    """Returns the single environment of a case, with the scenarios of one name or of several, one after the other."""
    return gymnasium.make(
        case.env_id,
        scenario=list(scenarios) if len(scenarios) > 1 else case.scenario,
        dynamics=conditions.dynamics,
        actuators=conditions.actuators,
        max_episode_steps=case.max_episode_steps,
        **case.env_kwargs,
    )


def _card(case: Case) -> dict[str, Any]:
    """Returns a policy's metadata: its name, all of its gains, its privileged information."""
    policy: Any = make_policy(case, 0)
    gains = {
        field.name: value
        for field in dataclasses.fields(policy)
        if isinstance(value := getattr(policy, field.name), bool | int | float | str)
    }
    return {"policy": case.policy, "gains_name": case.gains_name, "gains": gains, "knows": policy.knows}


def _contest_of(names: tuple[str, ...], families: tuple[str, ...]) -> Contest:
    """Returns the contest in which all of the policies take part and to which all of the families belong.

    Raises:
        click.UsageError: if there is none, or the families leave it open.
    """
    for name in names:
        if name in _BY_ROW:
            raise click.UsageError(
                f"POLICY {name!r} drives every episode of a robot alike; random actions are `zero --exploration 1`"
            )
    for family in families:
        Choice("--family", sorted({each for contest in CONTESTS.values() for each in contest.spec.families})).convert(
            family, None, None
        )
    fits = [
        contest
        for contest in CONTESTS.values()
        if all(name in (*contest.policies, *_FLOOR) for name in names)
        and all(each in contest.spec.families for each in families)
    ]
    if not fits:
        raise click.UsageError(
            f"no suite has all of the policies {', '.join(names)}"
            + (f" and the families {', '.join(families)}" if families else "")
        )
    if len(fits) > 1:
        raise click.UsageError(f"--suite must say which: {', '.join(contest.name for contest in fits)}")
    return fits[0]


def _folder(dataset: str) -> Path:
    """Returns where Minari will look for a set.

    Raises:
        click.ClickException: if the extra is missing.
        click.UsageError: if the name is none of Minari's.
    """
    try:
        import mcap  # noqa: F401
        import pyarrow  # noqa: F401
        from minari.dataset.minari_dataset import parse_dataset_id
        from minari.storage.datasets_root_dir import get_dataset_path
    except ImportError as error:
        raise click.ClickException(f"{error.name or 'minari'} is missing: {installs('record')}") from None
    try:
        parse_dataset_id(dataset)
    except ValueError as error:
        raise click.UsageError(f"--dataset {dataset!r}: {error}") from None
    except TypeError:  # Minari's own, of a name that has no version
        raise click.UsageError(f"--dataset {dataset!r} has no version: {dataset}-v0, for example") from None
    return Path(get_dataset_path(dataset))


@click.command("record", cls=OneLineErrors)
@click.argument("names", metavar="POLICY...", nargs=-1, required=True)
@click.option("--suite", type=Choice("--suite", CONTESTS), help="Contest; needed if the policies can drive in several.")
@click.option("--family", "families", multiple=True, help="Family of scenarios; may be repeated.  [default: all]")
@click.option("--split", type=Choice("--split", SPLITS), default="train", show_default=True)
@click.option(
    "--episodes",
    type=click.IntRange(1, 10**7),
    default=100,
    show_default=True,
    help="Number of episodes in the whole data set.",
)
@robot_option(None, default="p3dx", show_default=True)
@click.option("--dynamics", type=Choice("--dynamics", IN_PROCESS), default="kinematic", show_default=True)
@click.option("--actuators", type=Choice("--actuators", ACTUATORS), default="lagged", show_default=True)
@click.option("--disturbance", type=Choice("--disturbance", LEVELS), default="none", show_default=True)
@click.option("--gains", type=Choice("--gains", ("default", "tuned", "best")), default="best", show_default=True)
@click.option(
    "--exploration",
    type=float,
    default=0.0,
    show_default=True,
    help="Standard deviation of the noise added to actions, as a share of the largest action.",
)
@click.option(
    "--seed",
    type=SEED,
    default=0,
    show_default=True,
    help="Seed of the first episode; the next episode has the next seed.",
)
@click.option("--dataset", help="Name of the data set in Minari.  [default: wayfield/SUITE/POLICY-ROBOT-v0]")
@click.option(
    "--mcap",
    type=click.Path(path_type=Path, dir_okay=False),
    help="Also write the first episode to an MCAP file, for Foxglove.",
)
@click.option(
    "--force",
    is_flag=True,
    help="Replace a data set of that name, and an MCAP file, that this command recorded.",
)
def main(
    names: tuple[str, ...],
    suite: str | None,
    families: tuple[str, ...],
    episodes: int,
    seed: int,
    dataset: str | None,
    mcap: Path | None,
    force: bool,
    **options: Any,
) -> None:
    """Records episodes of policies as a Minari data set."""
    for name in names:
        Choice("POLICY", policies.POLICIES).convert(name, None, None)
    contest = CONTESTS[suite] if suite else _contest_of(names, families)
    conditions = Conditions(**options)
    if not 0.0 <= conditions.exploration <= 10.0:  # NaN is neither
        raise click.UsageError(f"--exploration {conditions.exploration} must be from 0 to 10")
    known = contest.families(conditions.dynamics, contest.spec.families if families else None)
    for family in families:
        Choice("--family", known).convert(family, None, None)
    names, left_out = with_agents([contest], names, conditions.robot)
    for line in left_out:
        say(f"record: {line}", err=True)
    if untrained := contest.without_agents(names, conditions.robot):
        raise click.UsageError(next(iter(untrained.values())))
    dataset = dataset or f"wayfield/{contest.name}/{'-'.join(names).replace('_', '-')}-{conditions.robot.name}-v0"
    folder = _folder(dataset)
    try:
        parts = sources(contest, names, families or known, episodes, seed, conditions)
    except ValueError as error:
        raise click.ClickException(str(error)) from None
    if not parts:
        raise click.UsageError(f"--gains {conditions.gains!r}: none of the policies has them")
    with _held(folder, f"{dataset} is being recorded by another process"):
        restore_folder(folder)
        _check_free(folder, dataset, force)
        if mcap is not None:
            _check_mcap(mcap, force)
        clear_stale(folder.parent)
        began = time.perf_counter()
        staged = temporary_folder(folder.parent)
        try:
            steps, digest = _write(staged, dataset, contest, parts, conditions)
            os.chmod(staged, 0o755)
            if folder.exists():
                replace_folder(staged, folder)
            else:
                staged.rename(folder)
        except ValueError as error:
            raise click.ClickException(str(error)) from None
        finally:
            shutil.rmtree(staged, ignore_errors=True)
    if mcap is not None:
        _write_mcap(mcap, dataset, parts[0], conditions)
    rate = steps / (time.perf_counter() - began)
    say(f"{dataset}: {episodes} episodes, {steps:,} steps, {rate:,.0f} steps/s, SHA-256 {digest[:16]}...")
    say(f'minari.load_dataset("{dataset}"); files in {folder}')


@contextlib.contextmanager
def _held(folder: Path, busy: str) -> Iterator[None]:
    """Holds the lock of a set, in the folder above it, which is made; of both nothing empty is left afterwards.

    Raises:
        BlockingIOError: at once, if another process holds it.
        OSError: if it cannot be made.
    """
    made = [above for above in folder.parents if not above.exists()]
    lock = folder.parent / f".{folder.name}.lock"
    try:
        folder.parent.mkdir(parents=True, exist_ok=True)
        with locked(lock, busy):
            try:
                yield
            finally:
                lock.unlink(missing_ok=True)
    finally:
        with contextlib.suppress(OSError):  # the first that holds something keeps those above it
            for above in made:
                above.rmdir()


def _write_mcap(file: Path, dataset: str, source: Source, conditions: Conditions) -> None:
    """Writes the first episode of the set as an MCAP file."""
    from wayfield.benchmarks.recordings.mcap_file import write_mcap

    first = dataclasses.replace(source, starts=source.starts[:1])
    ((number, episode),) = recorded(first, conditions)
    env = single(source.case, conditions)
    write_mcap(
        file,
        env,
        episode,
        {"dataset": dataset, "episode": number, "policy": source.case.policy, "seed": episode.start.seed},
    )
    env.close()


def _check_free(folder: Path, dataset: str, force: bool) -> None:
    """Raises click.ClickException if there is a set of that name that may not be replaced."""
    if not folder.exists():
        return
    from minari.dataset.minari_storage import MinariStorage

    if not force:
        raise click.ClickException(f"{dataset} is there already ({folder}): name another --dataset, or --force")
    try:
        ours = KEY in MinariStorage.read_raw_metadata(folder / "data")
    except (ValueError, OSError):
        ours = False
    if not ours:
        raise click.ClickException(f"{folder} was not recorded by this command: name another --dataset")


def _check_mcap(file: Path, force: bool) -> None:
    """Raises click.ClickException if an MCAP file cannot be written there, or another file is there already."""
    from wayfield.benchmarks.recordings.mcap_file import is_ours

    if not file.parent.is_dir():
        raise click.ClickException(f"{file.parent} is no folder: name another --mcap")
    if not os.path.lexists(file):
        return
    if not is_ours(file):
        raise click.ClickException(f"{file} was not recorded by this command: name another --mcap")
    if not force:
        raise click.ClickException(f"{file} is there already: name another --mcap, or --force")


def _write(
    staged: Path, dataset: str, contest: Contest, parts: list[Source], conditions: Conditions
) -> tuple[int, str]:
    """Writes the whole set into a folder; returns how many steps it has, and its digest."""
    from wayfield.benchmarks.recordings.minari_set import MinariSet

    scenarios = list(dict.fromkeys(source.case.scenario for source in parts))
    env = single(parts[0].case, conditions, scenarios)  # what Minari makes again from the set replays every episode
    layout = env.unwrapped.task.layout  # type: ignore[attr-defined]
    written = MinariSet(staged, env)
    env.close()
    total = sum(len(source.starts) for source in parts)
    steps = 0

    def driven() -> Iterator[tuple[Source, int, Episode]]:
        for source in parts:
            for number, episode in recorded(source, conditions):
                yield source, number, episode

    # the disk works beside the robots; what waits for it is bounded
    with concurrent.futures.ThreadPoolExecutor(1) as disk:
        waiting: collections.deque[concurrent.futures.Future[None]] = collections.deque()
        for source, number, episode in tracked(driven(), total, "episodes"):
            steps += len(episode.actions)
            case = source.case
            of_set = scenarios.index(case.scenario) * SPLITS[conditions.split] + episode.start.scenario
            episode = dataclasses.replace(episode, start=Start(episode.start.seed, of_set))
            metadata: dict[str, Any] = {"policy": case.policy, "gains_name": case.gains_name, "family": case.family}
            metadata |= {"split": case.split, "success": bool(episode.infos["success"][-1])}
            waiting.append(disk.submit(written.write, number, episode, metadata))
            while len(waiting) > _IN_FLIGHT:
                waiting.popleft().result()
        for each in waiting:
            each.result()
    ends = [0]
    for field in layout.fields:
        ends.append(ends[-1] + field.size)
    cards = {f"{source.case.policy}, {source.case.gains_name}": _card(source.case) for source in parts}
    about = {
        "fields": {
            field.name: {"columns": ends[k : k + 2], "shape": list(field.shape)}
            for k, field in enumerate(layout.fields)
        },
        "policies": cards,
        "families": sorted({source.case.family for source in parts}),
        "seeds": [parts[0].starts[0].seed, parts[0].starts[0].seed + total - 1],
        "conditions": {**vars(conditions), "robot": conditions.robot.name},
        "version": installed.version("wayfield"),
        "command": f"wayfield record {words_given()}",
    }
    digest = written.close(
        dataset,
        about,
        algorithm_name=", ".join(cards),
        author={"wayfield"},
        description=f"{contest.spec.title}, {conditions.robot.name}, {conditions.actuators} actuators",
        requirements=[f"wayfield=={installed.version('wayfield')}"],
    )
    return steps, digest


if __name__ == "__main__":
    sys.exit(main())
