"""Plays a contest in parts that survive an interruption: a part is one policy on one family of scenarios."""

import dataclasses
import hashlib
import json
import math
import os
import shutil
import tempfile
import warnings
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from wayfield.benchmarks.contests import ALL_CONTESTS, ANY, HAND_TUNED, ROBUST_LEVEL, TRAINED, TRANSFER_SPLIT, Contest
from wayfield.benchmarks.entrants.own_policies import OwnClass, changed_source, sources
from wayfield.benchmarks.entrants.own_scenario import own_scenario
from wayfield.benchmarks.records.cases import Case
from wayfield.benchmarks.records.episode import Episodes, Row
from wayfield.benchmarks.records.progress import tell_of_compiling, tracked
from wayfield.benchmarks.records.replays import MOST_DRIVES, Drive, drive_of, read_drives, write_drives
from wayfield.benchmarks.records.results import TRAJECTORIES, read_trajectories, write_trajectories
from wayfield.benchmarks.records.run_folder import DRIVES, UNFINISHED, file_digest
from wayfield.benchmarks.records.trajectory import Trajectory
from wayfield.benchmarks.runs.payloads import sent
from wayfield.benchmarks.runs.suite import Episode, Setting, episodes_together, together
from wayfield.envs import goal_reaching
from wayfield.envs.robots import robot_of
from wayfield.envs.scenarios import scenarios_of, splits
from wayfield.policies import POLICIES, make
from wayfield.policies.learned.agent import CARD, load_agent
from wayfield.policies.learned.conditions import NewToAgent
from wayfield.policies.parts.tuned import tuned_set
from wayfield.policies.trained.any_robot import agents_of
from wayfield.policies.trained.ppo import trained
from wayfield.system.executors import Executor, say
from wayfield.system.identity import source_digest
from wayfield.system.objects import FileNote
from wayfield.system.readers import of_folder, reader
from wayfield.system.storage import clear_stale, temporary_folder

_ROWS, _DIGESTS = "rows.json", "part.json"  # of a part, beside its trajectories
_SOURCES = "sources.json"  # of a part: the modules of the user's own that it was played with
_MARK = ".parts"  # in the folder of the parts
NO_FRAMES = "0 frames"  # of a law whose gains nothing was driven for
_OF_NAV2 = ("nav2_dwb", "nav2_mppi")
_VALIDATED = ", on validation"  # said of what was found with scenarios that gains are chosen by
_ENTRY = ("contest", "suite", "policy", "gains_name", "robot", "split", "disturbance")  # what the worst are chosen of


@dataclasses.dataclass(frozen=True)
class Part:
    """A setting, and the folder that its episodes are kept in until the whole run is done."""

    setting: Setting
    folder: Path

    def __str__(self) -> str:
        case = self.setting.case
        return f"{self.folder} ({case.policy} on {case.scenario})"


def run_contest(
    settings: Sequence[Setting], folder: Path, executor: Executor
) -> tuple[Episodes, Mapping[str, Trajectory]]:
    """Returns one row for each episode, and the trajectories of the worst episodes of each entry, or of all.

    The rows are held by columns, the trajectories are read from the parts on access.

    Parts that an earlier, interrupted run of the same settings and the same code left in `folder` are not run again,
    but for those that are damaged, or were played with other files of a policy of the user's own.

    Raises:
        ValueError: if a part is damaged as soon as it is written, an agent or a split is damaged, or a file of a policy
            has changed since it was loaded.
        OSError: if a part cannot be written, or all workers are lost.
        Failed: once all others are played, if parts failed as often as the executor lets them.
    """
    parts = parts_of(settings, folder)
    _open_parts(folder)
    missing = []
    for part in parts:
        if part.folder.is_dir():
            try:
                read_part(part.folder)
                if not (changed := _changed(part)):
                    continue
                say(f"{part} was played with another {changed} and is played again")
            except (ValueError, OSError) as error:
                say(f"{part} is damaged and is played again: {error}")
            shutil.rmtree(part.folder)
        missing.append(part)
    if len(missing) < len(parts):
        say(f"{len(parts) - len(missing)} of {len(parts)} parts are there from before")
    compiles = tell_of_compiling(goal_reaching.step_rows)
    settings_left = [part.setting for part in missing]
    if executor.remote:
        for k, files in tracked(executor.as_done(*sent(executor, play, settings_left)), len(missing), "runs", compiles):
            keep(missing[k], files)
    else:
        groups = together(settings_left)
        items = [tuple(settings_left[k] for k in group) for group in groups]
        for k, of_group in tracked(executor.as_done(play_together, items), len(items), "runs", compiles):
            for number, files in zip(groups[k], of_group, strict=True):
                keep(missing[number], files)
    for part in parts:
        if changed := _changed(part):
            raise ValueError(f"{changed} was changed while {part} was played: the same command plays it again")
    worst: dict[tuple[str, ...], list[_Place]] = {}
    rows = Episodes(_rows_of(parts, settings[0].keep, worst))
    places = [place for of_entry in worst.values() for place in of_entry]
    keys = [""] * len(rows)
    for k, place in enumerate(places):
        keys[place.row] = f"{k:05d}"
    return rows.with_column("trajectory", keys), _Trajectories({f"{k:05d}": place for k, place in enumerate(places)})


def rows_so_far(parts: Sequence[Part], ended: Mapping[int, Mapping[str, bytes]]) -> Episodes:
    """Returns the rows of the parts that are done, of a run that was interrupted, as can be compared.

    These are in each contest the families that most policies have finished, and the policies that have finished them.

    Args:
        ended: the files of parts that were played but are not kept yet, by their number; they are kept now.
    """
    _open_parts(parts[0].folder.parents[1])
    for k, files in ended.items():
        if not parts[k].folder.is_dir():
            keep(parts[k], files)
    entered: dict[tuple[str, str], dict[tuple[str, str], list[Part]]] = {}
    for part in parts:
        case = part.setting.case
        entered.setdefault((case.contest, case.family), {}).setdefault((case.policy, case.gains_name), []).append(part)
    done = {
        family: {entry for entry, mine in entries.items() if all(part.folder.is_dir() for part in mine)}
        for family, entries in entered.items()
    }
    rows: list[Row] = []
    for contest in dict.fromkeys(contest for contest, _ in entered):
        of_family = {family: entries for family, entries in done.items() if family[0] == contest}
        most = max(of_family.values(), key=len)
        for family, entries in of_family.items():
            if most and most <= entries:
                rows += [row for entry in most for part in entered[family][entry] for row in _rows_of_part(part.folder)]
    return Episodes(rows)


@dataclasses.dataclass(frozen=True)
class _Place:
    """Where a trajectory is kept: a part's folder, its number there, and that of its row in the run."""

    badness: tuple[float, float]
    folder: Path
    episode: str
    row: int


class _Trajectories(Mapping[str, Trajectory]):
    """The trajectories of a run, each read from its part on access, so that one is in memory and not all."""

    def __init__(self, places: Mapping[str, _Place]) -> None:
        self._places = places

    def __getitem__(self, key: str) -> Trajectory:
        place = self._places[key]
        return read_trajectories(place.folder, {place.episode})[place.episode]

    def __iter__(self) -> Iterator[str]:
        return iter(self._places)

    def __len__(self) -> int:
        return len(self._places)


def _rows_of(parts: Sequence[Part], most: int | None, worst: dict[tuple[str, ...], list[_Place]]) -> Iterator[Row]:
    """Yields the rows of all parts; notes where the worst trajectories of each entry are, or all, the worst first."""
    first = 0
    for part in parts:
        rows = _rows_of_part(part.folder)
        cost = ALL_CONTESTS[rows[0]["contest"]].spec.cost.metric
        here = worst.setdefault(tuple(rows[0][name] for name in _ENTRY), [])
        here += [
            _Place(badness(rows[i], cost), part.folder, f"{i:05d}", first + i) for i in _shown(rows, part.setting.keep)
        ]
        here.sort(key=lambda place: place.badness)
        del here[len(here) if most is None else most :]
        first += len(rows)
        yield from rows


def played(setting: Setting) -> list[Episode]:
    """Returns the episodes of a setting, with all in their rows that the tables of a contest need.

    Raises:
        ValueError: if an agent, a split or a policy of the user's own is damaged.
    """
    return played_together((setting,))[0]


def played_together(settings: Sequence[Setting]) -> list[list[Episode]]:
    """Returns `played` of each of some settings that are driven `together`."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", NewToAgent)  # the table shows how agents do there
        warnings.simplefilter("ignore", FileNote)  # said where the courses were made
        complete = []
        about = described(ALL_CONTESTS[settings[0].case.contest], settings[0].case)  # they differ in scenarios alone
        for setting, driven in zip(settings, episodes_together(settings), strict=True):
            rows = zip(driven, declared(setting, about), strict=True)
            complete.append([(row | more, trajectory) for (row, trajectory), more in rows])
        return complete


def declared(setting: Setting, about: Mapping[str, str] | None = None) -> list[dict[str, Any]]:
    """Returns what a row of each episode has of its scenario and of the policy: all that driving does not show.

    Args:
        about: what `described` says of the policy; None: it is asked.

    Raises:
        ValueError: as `played`.
    """
    contest, case = ALL_CONTESTS[setting.case.contest], setting.case
    split = "front" if case.speed is not None else case.split
    speed = {} if case.speed is None else {"speed": case.speed}
    failure = contest.failure_cost(case.max_episode_steps)
    about = described(contest, case) if about is None else about
    more = {"split": split, **speed, "failure_cost": failure, **about}
    members = members_of(contest, setting)
    lines = []
    for k in setting.numbers or range(setting.episodes):
        member = members[k % len(members)]
        named = {"scenario": member.name} if setting.members else {}
        lines.append(more | named | {"tier": member.tier, "quantity": member.quantity})
    return lines


def members_of(contest: Contest, setting: Setting) -> Sequence[Any]:
    """Returns the scenarios of a setting: frozen, of the user's own, or of a public benchmark."""
    case = setting.case
    if case.scenario == f"{case.family}/{case.split}":
        return splits.split(contest.spec.name, case.family, case.split)
    if setting.members:
        bank = scenarios_of(contest.spec, case.scenario, robot_of(case.env_kwargs["robot"]).hull_radius)
        return [bank[k] for k in setting.members]
    return [own_scenario(case.scenario, case.env_kwargs.get("scale")).tiered]


def described(contest: Contest, case: Case) -> dict[str, str]:
    """Returns a policy's privileged information, number of parameters, their origin and the agent's seed."""
    agent_seed = ""
    if case.entrant is not None:
        knows = f"own, {case.entrant.make(case.gains).knows}"
        parameters, learned = case.entrant.described()
    elif (folder := _agent_folder(contest, case)) is not None:
        agent = load_agent(folder)
        training = agent.card["training"]
        knows, parameters = agent.knows, f"{agent.num_parameters:,}"
        agent_seed = str(case.gains["seed"]) if case.policy in TRAINED else ""  # any_robot has one
        taught = f", taught by {training['taught_by']}" if "taught_by" in training else ""
        if "began_as" in training:
            taught = f", began as the agent of {training['began_as']}"
        if base := agent.card.get("base"):  # cards of before named it as a teacher too
            taught = f", adds to {base['controller']}"
        behind = training.get("taught_by"), "scan_planner" if case.policy in ("hybrid", ANY) else None
        if any(name and _on_validation(contest, name, str(case.env_kwargs["robot"])) for name in behind):
            taught += _VALIDATED
        learned = f"{in_frames(training['steps'])}{taught}"
    else:
        made: Any = make(case.policy)
        knows, parameters, learned = made.knows, str(len(dataclasses.fields(made))), _searched(contest, case)
    return {"knows": knows, "parameters": parameters, "learned_from": learned, "agent_seed": agent_seed}


def _agent_folder(contest: Contest, case: Case) -> Path | None:
    """Returns the folder of the network that drives, None for a law alone."""
    seed, robot = case.gains.get("seed", 0), robot_of(case.env_kwargs["robot"])
    if case.policy == ANY:
        return agents_of(robot).get(seed)
    if case.policy not in TRAINED:
        return None
    home = case.gains.get("home")
    return (trained(home) if home else contest.agents_of(case.policy, robot.name))[seed]


def _searched(contest: Contest, case: Case) -> str:
    """Returns what the gains of a law were found from; of default gains, whether a search was lost to them."""
    if case.gains_name == "paper":
        return f"{NO_FRAMES}, as published"
    level = ROBUST_LEVEL if case.gains_name in ("robust", HAND_TUNED["robust"]) else "none"
    robot = case.env_kwargs["robot"]  # a name where it ships
    suite, speed = contest.gains_suite, case.target_speed
    tuned = tuned_set(case.policy, suite, robot, speed, level) if isinstance(robot, str) else None
    if case.gains_name == "default" and (tuned is None or tuned.chosen != "default"):
        return f"{NO_FRAMES}, as Nav2 configures it" if case.policy in _OF_NAV2 else NO_FRAMES
    if tuned is None:
        return ""  # of gains that were given
    best = ", best of them" if case.gains_name == "default" else ""
    return in_frames(tuned.frames) + best + (_VALIDATED if tuned.split == TRANSFER_SPLIT else "")


def _on_validation(contest: Contest, policy: str, robot: str) -> bool:
    """Returns whether the gains of a law, as a teacher or a planner has them, were found on the validation split."""
    # a teacher may be one of the user's own, or a mix in recorded data
    tuned = tuned_set(policy, contest.gains_suite, robot) if policy in POLICIES else None
    return tuned is not None and tuned.chosen != "default" and tuned.split == TRANSFER_SPLIT


def in_frames(count: int) -> str:
    """Returns a budget in words: millions, and enough digits of few frames to tell them from none."""
    return f"{count / 1e6:.1f} M frames" if count >= 100_000 else f"{count / 1e6:.2g} M frames"


def load(_: int) -> None:
    """Does nothing, in a process that has imported what it plays with by then."""


def play(setting: Setting) -> dict[str, bytes]:
    """Returns the files of a part, by their name: its rows, the trajectories that are kept, and the drives of all."""
    return play_together((setting,))[0]


def play_together(settings: Sequence[Setting]) -> list[dict[str, bytes]]:
    """Returns `play` of each of some settings that are driven `together`."""
    return [_files(setting, driven) for setting, driven in zip(settings, played_together(settings), strict=True)]


def _files(setting: Setting, driven: Sequence[Episode]) -> dict[str, bytes]:
    rows, most = [row for row, _ in driven], setting.keep
    trajectories = {f"{i:05d}": driven[i][1] if most is None else slim(driven[i][1]) for i in _shown(rows, most)}
    drives = {i: drive_of(trajectory) for i, (_, trajectory) in enumerate(driven)}
    own = isinstance(setting.case.entrant, OwnClass)
    return _packed(rows, trajectories, drives, sources() if own else {})


def _shown(rows: Sequence[Row], most: int | None) -> list[int]:
    """Returns which episodes of a part keep their trajectory, the worst first."""
    cost = ALL_CONTESTS[rows[0]["contest"]].spec.cost.metric
    return sorted(range(len(rows)), key=lambda i: badness(rows[i], cost))[:most]


def _changed(part: Part) -> str:
    """Returns the file of the user's own that is another one now than when a part was played; "" where none is."""
    return changed_source(_parsed(part.folder / _SOURCES))


def _packed(
    rows: Sequence[Row],
    trajectories: dict[str, Trajectory],
    drives: dict[int, Drive],
    loaded: Mapping[str, str],
) -> dict[str, bytes]:
    with tempfile.TemporaryDirectory() as scratch:
        folder = Path(scratch)
        write_drives(folder, drives)
        write_trajectories(folder, trajectories)
        files = {name: (folder / name).read_bytes() for name in (TRAJECTORIES, DRIVES)}
    return {_ROWS: json.dumps(rows).encode(), _SOURCES: json.dumps(loaded).encode(), **files}


def keep(part: Part, files: Mapping[str, bytes]) -> None:
    """Leaves the files of a part in its folder, whole or not at all.

    They are not waited for until they are on the disk, which would take longer than to play them: a part that a loss of
    power has torn is known by its digests, and played again.

    Raises:
        OSError: if they cannot be written.
    """
    stage = temporary_folder(part.folder.parent)
    try:
        _write_part(stage, files)
        os.replace(stage, part.folder)
    finally:
        shutil.rmtree(stage, ignore_errors=True)


def _write_part(folder: Path, files: Mapping[str, bytes]) -> None:
    for name, content in files.items():
        (folder / name).write_bytes(content)
    digests = {name: hashlib.sha256(content).hexdigest() for name, content in files.items()}
    (folder / _DIGESTS).write_text(json.dumps(digests), encoding="utf-8")


def _sample_part(folder: Path) -> None:
    driven = Trajectory(times=np.arange(3.0), poses=np.ones((3, 3)))
    rows = [{"policy": "lqr", "success": 1.0}]
    _write_part(folder, _packed(rows, {"00000": driven}, {0: np.ones((3, 3), np.int32)}, {}))


@reader("digests of a part", _DIGESTS, _sample_part, of_folder)
@reader("sources of a part", _SOURCES, _sample_part, of_folder)
@reader("rows of a part", _ROWS, _sample_part, of_folder)
@reader("trajectories of a part", TRAJECTORIES, _sample_part, of_folder)
def read_part(folder: Path) -> tuple[list[Row], dict[str, Trajectory]]:
    """Returns the rows of a part, and the trajectories of its worst episodes by their number.

    Raises:
        ValueError: if the part is not as it was written; the message names the file.
        OSError: if a file is missing or cannot be opened.
    """
    return _rows_of_part(folder), read_trajectories(folder)


def _rows_of_part(folder: Path) -> list[Row]:
    """Returns the rows of a part as `read_part`, which alone looks into the trajectories: their digest is enough."""
    digests = _parsed(folder / _DIGESTS)
    for name in (_ROWS, _SOURCES, TRAJECTORIES, DRIVES):
        if not isinstance(digests, dict) or file_digest(folder / name) != digests.get(name):
            raise ValueError(f"{folder / name} does not have the SHA-256 that it was written with")
    rows, loaded = _parsed(folder / _ROWS), _parsed(folder / _SOURCES)
    if not isinstance(rows, list) or not all(_of(each, str, int, float) for each in rows) or not rows:
        raise ValueError(f"{folder / _ROWS} must be a list of rows, each of texts and numbers by their names")
    if not _of(loaded, str):
        raise ValueError(f"{folder / _SOURCES} must map modules to digests")
    return rows


def _parsed(file: Path) -> Any:
    """Returns what a file of a part holds; ValueError, naming it, if it is no JSON."""
    try:
        return json.loads(file.read_text(encoding="utf-8"))
    except (ValueError, RecursionError) as error:
        raise ValueError(f"{file} is no JSON: {error}") from None


def _of(value: object, *kinds: type) -> bool:
    return isinstance(value, dict) and all(isinstance(each, kinds) for each in value.values())


def drives_of(parts: Sequence[Part]) -> dict[int, Drive]:
    """Returns the drives of the episodes of some parts, by the number of their row in the run.

    They are those of all, or of more than `MOST_DRIVES` the first ones of each part, or of parts here and there.

    Raises:
        ValueError: if a part is damaged; the message names the file.
        OSError: if a file is missing or cannot be opened.
    """
    drives: dict[int, Drive] = {}
    first, stride, most = 0, 1, MOST_DRIVES
    if sum(part.setting.episodes for part in parts) > MOST_DRIVES:
        stride, most = math.ceil(len(parts) / MOST_DRIVES), max(1, MOST_DRIVES // len(parts))
    for k, part in enumerate(parts):
        if k % stride == 0:
            drives.update((first + i, drive) for i, drive in read_drives(part.folder).items() if i < most)
        first += part.setting.episodes
    return drives


def badness(row: Row, cost: str) -> tuple[float, float]:
    """Returns a key that sorts the worst episode first: failures before successes, then the higher cost."""
    value = row[cost]
    return row["success"], -value if value == value else 0.0


def slim(trajectory: Trajectory) -> Trajectory:
    """Returns what a figure of the driven way needs."""
    nothing = Trajectory(times=trajectory.times, poses=trajectory.poses)
    return dataclasses.replace(
        trajectory,
        **{name: getattr(nothing, name) for name in ("twists", "wheel_speeds", "saturated", "references")},
    )


def _key(setting: Setting, code: str, geometry: str) -> str:
    """Returns the name of a setting's folder: the same for the same setting, code and digest of its scenarios."""
    case = setting.case
    # agents of one's own may be trained anew in the same folder; a policy's or a model's digest is in its entrant
    gains = case.gains
    card = (trained(gains["home"])[gains["seed"]] / CARD).read_text(encoding="utf-8") if "home" in gains else ""
    return hashlib.sha256(f"{setting!r} {geometry} {card} {code}".encode()).hexdigest()[:24]


def parts_of(settings: Sequence[Setting], folder: Path) -> list[Part]:
    """Returns the parts of a run that keeps them in a folder."""
    code = source_digest()
    members = [members_of(ALL_CONTESTS[setting.case.contest], setting) for setting in settings]
    each = {tuple(map(id, those)): those for those in members}  # most settings are about the same scenarios
    digests = {key: splits.digest(those) for key, those in each.items()}
    keys = (
        _key(setting, code, digests[tuple(map(id, those))]) for setting, those in zip(settings, members, strict=True)
    )
    return [Part(setting, folder / UNFINISHED / key) for setting, key in zip(settings, keys, strict=True)]


def _open_parts(folder: Path) -> None:
    """Makes the folder of the parts, with a mark in it that it is one.

    Raises:
        FileExistsError: if something else bears its name.
    """
    parts = folder / UNFINISHED
    if not os.path.lexists(parts):
        stage = temporary_folder(folder)
        (stage / _MARK).touch()
        stage.chmod(folder.stat().st_mode)
        os.replace(stage, parts)
    if not (parts / _MARK).is_file():
        raise FileExistsError(f"{parts} is not from a run of ours: move it away, or give another --out")
    clear_stale(parts)


def clear_parts(parts: Sequence[Part]) -> None:
    """Deletes the parts of a run that is done, and their folder unless it holds those of other runs."""
    for part in parts:
        shutil.rmtree(part.folder, ignore_errors=True)
    for folder in {part.folder.parent for part in parts}:
        clear_stale(folder)
        if os.listdir(folder) == [_MARK]:
            (folder / _MARK).unlink()
            folder.rmdir()
        else:
            say(f"{folder} holds parts of other runs; they stay there")
