"""Gains that were found for a condition, by search or by hand, as they ship with the package.

A set of a search has its record in its file: the command, the frames, and what its finalists came to on the whole
validation split. A set that was compared without such a record says "hand". A set belongs to a robot, a speed
and a level of disturbance. No set is returned for another condition: a request for one that was not tuned
for is an error.
"""

import dataclasses
import functools
import re
from collections.abc import Callable, Mapping
from importlib import resources
from pathlib import Path
from typing import Any, Literal

from wayfield.system.checks import shown
from wayfield.system.readers import reader
from wayfield.system.reading import is_number, is_whole, parsed_object

PACE = 0.6  # m/s, the speed that is asked for unless another is
MOST_FRAMES = 10**12  # of a search


class NotTuned(ValueError):
    """No gains were tuned for the requested condition; the message names those that there are."""


@dataclasses.dataclass(frozen=True)
class TunedSet:
    """Gains that were found for a condition, and what that cost."""

    gains: Mapping[str, Any]  # complete: the cruising speed that holds the requested one is among them
    robot: str
    speed: float  # m/s, asked for
    level: str  # of disturbance
    # what was best on validation: a set that a search found, one that was compared by hand, or the policy's own gains
    chosen: Literal["search", "hand", "default"]
    frames: int  # driven to find it
    split: str = ""  # of the scenarios that they were driven on; "" where its file does not say


def tuned_gains(name: str, suite: str, robot: str = "p3dx", speed: float = PACE, level: str = "none") -> dict[str, Any]:
    """Returns the gains of a policy that were tuned for a condition.

    Args:
        name: of the policy.
        suite: of the contest, "path-following", "goal-obstacles" or "docking".
        robot: its name.
        speed: m/s, that is asked for.
        level: of disturbance, "none" or another of `wayfield.envs.robots.disturbances.LEVELS`.

    Raises:
        NotTuned: if none ship for that condition; the message names the conditions that they ship for.
        ValueError: if the file is damaged or belongs to another policy or condition; the message names it.
    """
    result = tuned_set(name, suite, robot, speed, level)
    if result is None:
        there = ", ".join(tuned_conditions(name, suite)) or "none"
        raise NotTuned(
            f"policy {name!r} has no gains tuned for suite {suite!r} with {condition(robot, speed, level)}; "
            f"there are: {there}"
        )
    return dict(result.gains)


def tuned_set(name: str, suite: str, robot: str = "p3dx", speed: float = PACE, level: str = "none") -> TunedSet | None:
    """Returns the set of gains that was tuned for a condition, as `tuned_gains`; None if there is none.

    Raises:
        ValueError: if the file is damaged or belongs to another policy or condition; the message names it.
    """
    if not re.fullmatch(r"[a-z0-9_]+", name) or not re.fullmatch(r"[a-z0-9-]+", suite):
        raise ValueError(f"policy {name!r} and suite {suite!r} must be plain names")
    wanted = condition(robot, speed, level)
    file = _folder(suite) / f"{name}_{wanted}.json" if re.fullmatch(r"[a-z0-9_.]+", wanted) else None
    if file is None or not file.is_file():
        return None
    content = _read(file, name)
    result = condition(content["robot"], content["speed"], content["level"])
    if result != wanted:
        raise ValueError(f"{file} holds gains for {result}, not for {wanted}")
    searched = int(content["frames"]), content.get("searched_on", {}).get("split", "")
    return TunedSet(content["gains"], robot, float(content["speed"]), level, content["chosen"], *searched)


def tuned_conditions(name: str, suite: str) -> list[str]:
    """Returns the conditions that gains of a policy ship for, as `condition` names them."""
    pattern = re.compile(rf"{re.escape(name)}_([a-z0-9]+_[0-9.]+_[a-z]+)\.json")
    folder = _folder(suite)
    names = sorted(file.name for file in folder.iterdir()) if folder.is_dir() else []
    return [match[1] for match in map(pattern.fullmatch, names) if match]


def condition(robot: str, speed: float, level: str) -> str:
    """Returns the name of a condition, such as "p3dx_0.6_none"."""
    return f"{robot}_{speed:g}_{level}"


def _folder(suite: str) -> Any:
    return resources.files("wayfield.policies") / "gains" / suite


@functools.lru_cache(maxsize=512)
def _read(file: Any, name: str) -> dict[str, Any]:
    return read_gains(file.read_bytes(), str(file), name)


_SAMPLE = """{"policy": "lqr", "robot": "p3dx", "speed": 0.6, "level": "none", "chosen": "search", "frames": 100000,
"gains": {"q_e": 100.0, "share": 0.9}}"""


def _read_sample(read: Callable[..., Any], file: Path) -> Any:
    return read(file.read_bytes(), str(file), "lqr")


@reader("gains", "lqr.json", {"lqr.json": _SAMPLE}, _read_sample)
def read_gains(text: bytes | str, source: str, name: str) -> dict[str, Any]:
    """Returns the content of a gains file: the gains, their condition and their budget.

    Raises:
        ValueError: if the text is no gains file of that policy; the message names the source.
    """
    content = parsed_object(text, source)
    if content.get("policy") != name:
        raise ValueError(f"{source} does not hold gains of policy {name!r}")
    gains = content.get("gains")
    if not isinstance(gains, dict):
        raise ValueError(f"{source}: gains must map names to plain values, got {shown(gains)}")
    for key, value in gains.items():
        if not isinstance(value, str | bool) and not is_number(value):
            raise ValueError(f"{source}: gains must map names to plain values, got {key}: {shown(value)}")
    for key in ("robot", "level"):
        if not isinstance(content.get(key), str):
            raise ValueError(f"{source}: {key} must be a name, got {shown(content.get(key))}")
    speed = content.get("speed")
    if not is_number(speed) or not isinstance(speed, int | float) or not speed > 0.0:
        raise ValueError(f"{source}: speed must be a number above 0, got {shown(speed)}")
    if content.get("chosen") not in ("search", "hand", "default"):
        raise ValueError(f'{source}: chosen must be "search", "hand" or "default", got {shown(content.get("chosen"))}')
    if not is_whole(content.get("frames"), 0, MOST_FRAMES):
        raise ValueError(
            f"{source}: frames must be a whole number from 0 to {MOST_FRAMES}, got {shown(content.get('frames'))}"
        )
    searched_on = content.get("searched_on", {})
    if not isinstance(searched_on, dict) or not isinstance(searched_on.get("split", ""), str):
        raise ValueError(f"{source}: searched_on must be an object with a split, got {shown(searched_on)}")
    return content
