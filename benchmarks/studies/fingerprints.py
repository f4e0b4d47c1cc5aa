"""Digests of what every policy observes, does and earns: python benchmarks/studies/fingerprints.py --out FILE

Two versions of the code that give the same file behave alike, bit for bit, in every robot, plant and policy, alone and
in a batch. `--against FILE` says what has changed since the file was written. Other versions of Numba or of the machine
may round otherwise: compare on one machine.
"""

import dataclasses
import hashlib
import json
import sys
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import click
import gymnasium
import numpy as np
from numpy.typing import NDArray

import wayfield.envs  # noqa: F401  registers the ids
from wayfield import policies
from wayfield.benchmarks.contests import CONTESTS, TRAINED, Contest
from wayfield.benchmarks.records.progress import tracked
from wayfield.envs.robots import ROBOTS as ROBOTS_THAT_SHIP
from wayfield.policies.pilot import Pilot
from wayfield.system.command_line import Names, OneLineErrors
from wayfield.system.readers import of_path, reader
from wayfield.system.reading import read_object
from wayfield.system.storage import write_whole

DRIVEN = ("p3dx", "omni3", "omni4", "mecanum4")  # the documents' robots, and one of each other drive
ROBOTS = 4  # of a batch
FEW_ROBOTS = 2  # of a batch of a policy that takes its time
SLOW = ("mpc", "mppi", "nav2_mppi")
STEPS = 200
CLOCK = 120  # steps of an episode, so that every run sees a reset

QUANTITIES = ("observations", "actions", "rewards", "ends", "info")
Step = Mapping[str, NDArray[Any]]  # one step of all robots, by quantity
Print = dict[str, str]  # digests: of each quantity, and "steps", four digits a step of all that came until then


@dataclasses.dataclass(frozen=True)
class Condition:
    """A scenario and what goes wrong in it."""

    name: str
    scenario: str
    env_kwargs: Mapping[str, Any] = dataclasses.field(default_factory=dict)


_LAGGED: Mapping[str, Any] = {"actuators": "lagged"}
CONDITIONS = {
    "path-following": (
        Condition("plain", "figure_eight_lap"),
        Condition("noise", "splines/test", {**_LAGGED, "noise": 1.0}),
        Condition(
            "moderate", "polylines_90/test", {**_LAGGED, "disturbance": "moderate", "action_mode": "wheel_speeds"}
        ),
    ),
    "goal-obstacles": (
        Condition("plain", "omni3_waypoints"),
        Condition("noise", "clutter_10/test", {**_LAGGED, "noise": 1.0}),
        Condition("moderate", "moving_crossing/test", {**_LAGGED, "disturbance": "moderate"}),
        Condition("half_blind", "u_traps_05/test", {**_LAGGED, "field_of_view": 4.0}),
    ),
}
PLANTS = ("kinematic", "pymunk")
_ANSWERS: Mapping[str, Any] = {"saturation": "wheels", "response": "continuous", "decelerations": (0.8, 2.0)}
# Bases that answer late, in place of two of the documents' robots.
LATE = {
    "p3dx": dataclasses.replace(
        ROBOTS_THAT_SHIP["p3dx"], name="late", delay=(0.13, 0.06), gain=(1.0, 0.8), lag=(0.1, 0.2), **_ANSWERS
    ),
    "omni3": dataclasses.replace(ROBOTS_THAT_SHIP["omni3"], name="late", delay=(0.03, 0.08, 0.2), **_ANSWERS),
}


@dataclasses.dataclass(frozen=True)
class World:
    """An environment, single and batched, that several policies are driven in."""

    contest: str
    robot: str
    plant: str
    condition: Condition

    def options(self) -> dict[str, Any]:
        """Returns the keyword arguments of gymnasium.make and make_vec."""
        contest = CONTESTS[self.contest]
        return {
            "id": contest.env_id(self.robot),
            "robot": self.robot,
            "dynamics": self.plant,
            "scenario": self.condition.scenario,
            "max_episode_steps": CLOCK,
            **contest.env_kwargs,
            **self.condition.env_kwargs,
        }

    def key(self, policy: str, gains_name: str) -> str:
        """Returns the name of an entry."""
        return " ".join((self.contest, self.robot, self.plant, self.condition.name, policy, gains_name))


def conditions(contest: Contest) -> tuple[Condition, ...]:
    """Returns the conditions of a contest that has none of its own: its first family, and its last, disturbed."""
    first, *_, last = contest.spec.families
    return (
        Condition("plain", f"{first}/test"),
        Condition("noise", f"{first}/test", {**_LAGGED, "noise": 1.0}),
        Condition("moderate", f"{last}/test", {**_LAGGED, "disturbance": "moderate", "action_mode": "wheel_speeds"}),
    )


def worlds() -> list[World]:
    """Returns every robot on every plant under every condition."""
    return [
        World(name, robot, plant, condition)
        for name, contest in CONTESTS.items()
        for robot in DRIVEN
        for plant in PLANTS
        for condition in (*(CONDITIONS.get(name) or conditions(contest)), *late(contest, robot))
    ]


def late(contest: Contest, robot: str) -> tuple[Condition, ...]:
    """Returns the condition in which a base with a delay and a response of its own takes the place of a robot."""
    if robot not in LATE:
        return ()
    return (Condition("late", f"{next(iter(contest.spec.families))}/test", {**_LAGGED, "robot": LATE[robot]}),)


def entrants(world: World, names: Sequence[str]) -> Iterator[tuple[str, str, dict[str, Any]]]:
    """Yields policies and the names and values of their gains; of trained agents the first."""
    for name in names:
        sets = list(CONTESTS[world.contest].gain_sets(name, world.robot, ("default", "tuned", "paper")))
        for gains_name, gains in sets[:1] if name in TRAINED else sets:
            yield name, gains_name, gains


def batched(envs: Any, pilot: Pilot, steps: int) -> Iterator[Step]:
    """Yields what a batch observes, does and earns, step by step; ended robots begin anew."""
    observations, info = envs.reset(seed=0)
    pilot.reset()
    yield {"observations": observations, **_inside(info)}
    ended = np.empty(0, np.int64)
    for _ in range(steps):
        actions = pilot.command(observations)
        observations, rewards, terminated, truncated, info = envs.step(actions)
        if len(ended):
            # their new episodes have begun with this step
            pilot.reset(ended)
        ends = np.column_stack([terminated, truncated])
        yield {"observations": observations, "actions": actions, "rewards": rewards, "ends": ends, **_inside(info)}
        ended = np.flatnonzero(ends.any(axis=1))


def alone(env: Any, pilot: Pilot, steps: int) -> Iterator[Step]:
    """Yields what a single robot observes, does and earns, as `batched` does: a reset takes the place of a step."""
    observation, info = env.reset(seed=0)
    pilot.reset()
    yield {"observations": observation[None], **_inside(info)}
    ended = False
    for _ in range(steps):
        action = pilot.command(observation)
        if ended:
            observation, info = env.reset()
            pilot.reset()
            reward, terminated, truncated = 0.0, False, False
        else:
            observation, reward, terminated, truncated, info = env.step(action)
        yield {
            "observations": observation[None],
            "actions": action[None],
            "rewards": np.array([reward]),
            "ends": np.array([[terminated, truncated]]),
            **_inside(info),
        }
        ended = terminated or truncated


def _inside(info: Mapping[str, Any]) -> dict[str, NDArray[Any]]:
    """Returns the numbers and flags of info as one column each, in the order of their names."""
    columns = [np.atleast_1d(np.asarray(info[name], np.float64)) for name in sorted(info) if not name.startswith("_")]
    return {"info": np.column_stack(columns)}


def fingerprint(records: Iterator[Step], rows: int | None = None) -> Print:
    """Returns the digests of a run, or of its first rows."""
    sums = {name: hashlib.sha256() for name in QUANTITIES}
    whole = hashlib.sha256()
    steps = ""
    for step in records:
        for name, values in step.items():
            content = np.ascontiguousarray(values[:rows]).tobytes()
            sums[name].update(content)
            whole.update(content)
        steps += whole.hexdigest()[:4]
    return {name: each.hexdigest() for name, each in sums.items()} | {"steps": steps}


def fingerprints(names: Sequence[str], of: Sequence[World], steps: int = STEPS) -> dict[str, dict[str, Print]]:
    """Returns the fingerprints of the named policies in some worlds, single and batched, by the key of each.

    A policy that refuses a robot or its sensors has one of the refusal's words.
    """
    prints: dict[str, dict[str, Print]] = {}
    for world in tracked(of, len(of), "worlds"):
        batches = {
            num: gymnasium.make_vec(**world.options(), num_envs=num, vectorization_mode="vector_entry_point")
            for num in (ROBOTS, FEW_ROBOTS)
        }
        single = gymnasium.make(**world.options(), disable_env_checker=True)
        for name, gains_name, gains in entrants(world, names):
            policy = policies.make(name, **gains)
            if single.unwrapped.task.layout.kind not in policy.observes:  # type: ignore[attr-defined]
                continue
            envs = batches[FEW_ROBOTS if name in SLOW else ROBOTS]
            try:
                prints[world.key(name, gains_name)] = {
                    "single": fingerprint(alone(single, Pilot(policy, single), steps)),
                    "vector": fingerprint(batched(envs, Pilot(policy, envs), steps)),
                }
            except ValueError as refusal:
                prints[world.key(name, gains_name)] = {"refused": {"words": str(refusal)}}
        single.close()
        for envs in batches.values():
            envs.close()
    return dict(sorted(prints.items()))


def differences(before: Mapping[str, Any], now: Mapping[str, Any]) -> list[str]:
    """Returns a line for each entry that is not as it was: since which step, and in which quantities."""
    lines = []
    for key in sorted({*before, *now}):
        if key not in now or key not in before:
            lines.append(f"{key}: {'is gone' if key not in now else 'is new'}")
            continue
        for mode in sorted({*before[key], *now[key]}):
            old, new = before[key].get(mode), now[key].get(mode)
            if old == new:
                continue
            if not old or not new or "steps" not in old:
                lines.append(f"{key}, {mode}: {'is gone' if not new else 'is new' if not old else new['words']}")
                continue
            changed = [name for name in QUANTITIES if old[name] != new[name]]
            length = min(len(old["steps"]), len(new["steps"])) // 4
            same = (old["steps"][4 * k : 4 * k + 4] == new["steps"][4 * k : 4 * k + 4] for k in range(length))
            first = next((k for k, each in enumerate(same) if not each), length)
            lines.append(f"{key}, {mode}: {', '.join(changed)} from step {first} on")
    return lines


_SAMPLE = (
    '{"steps": 2, "entries": {"path-following p3dx kinematic plain lqr default": {"actions": "0a", "steps": "0a1b"}}}'
)


@reader("fingerprints", "before.json", {"before.json": _SAMPLE}, of_path)
def read(file: Path) -> dict[str, Any]:
    """Returns the fingerprints of a file.

    Raises:
        ValueError: if the file holds none; the message names it.
    """
    entries = read_object(file).get("entries")
    if not isinstance(entries, dict) or not all(isinstance(each, dict) for each in entries.values()):
        raise ValueError(f"{file} holds no fingerprints: entries must map names to digests")
    return entries


@click.command("fingerprints", cls=OneLineErrors)
@click.option("--out", type=click.Path(path_type=Path, dir_okay=False), help="Write them to this file.")
@click.option("--against", type=click.Path(path_type=Path, exists=True, dir_okay=False), help="Compare with this file.")
@click.option("--policies", "names", type=Names("--policies", policies.POLICIES), help="Only these.  [default: all]")
def main(out: Path | None, against: Path | None, names: tuple[str, ...] | None) -> None:
    """Writes or compares digests of what every policy observes, does and earns."""
    if (out is None) == (against is None):
        raise click.UsageError("give --out FILE to write fingerprints, or --against FILE to compare with them")
    try:
        before = read(against) if against else {}
    except ValueError as error:
        raise click.UsageError(str(error)) from None
    now = fingerprints(names or tuple(policies.POLICIES), worlds())
    if out is not None:
        content = {"steps": STEPS, "entries": now}
        write_whole(out, (json.dumps(content, indent=1) + "\n").encode())
        click.echo(f"{len(now)} fingerprints in {out}")
        return
    if names:
        before = {key: each for key, each in before.items() if key.split()[4] in names}
    lines = differences(before, now)
    for line in lines:
        click.echo(line)
    click.echo(f"{len(lines)} differences in {len(now)} entries")
    if lines:
        sys.exit(1)


if __name__ == "__main__":
    main()
