"""Gains that were found by search on validation scenarios, as they ship with the package."""

import re
from collections.abc import Callable
from importlib import resources
from pathlib import Path
from typing import Any

from wayfield.envs.checks import shown
from wayfield.envs.readers import reader
from wayfield.policies.learned.reading import is_number, is_whole, parsed_object

MOST_DRIVEN = 10**12  # trials, and scenarios of each


def tuned_gains(name: str, suite: str) -> dict[str, Any]:
    """Returns the tuned gains of a policy for a suite; empty when none ship.

    Raises:
        ValueError: if the file is damaged or belongs to another policy; the message names it.
    """
    content = _shipped(name, suite)
    return dict(content["gains"]) if content else {}


def tuning_runs(name: str, suite: str) -> int:
    """Returns how many episodes were driven to find the tuned gains of a policy for a suite; 0 when none ship.

    Raises:
        ValueError: as `tuned_gains`.
    """
    content = _shipped(name, suite)
    return int(content["trials"]) * int(content["scenarios"]) if content else 0


def tuned_robot(name: str, suite: str) -> str:
    """Returns the name of the robot that the tuned gains of a policy for a suite were found with; "" when none ship.

    Raises:
        ValueError: as `tuned_gains`.
    """
    return str(_shipped(name, suite).get("robot", ""))


def _shipped(name: str, suite: str) -> dict[str, Any]:
    if not re.fullmatch(r"[a-z0-9_]+", name) or not re.fullmatch(r"[a-z0-9-]+", suite):
        raise ValueError(f"policy {name!r} and suite {suite!r} must be plain names")
    file = resources.files("wayfield.policies") / "gains" / suite / f"{name}.json"
    return read_gains(file.read_bytes(), str(file), name) if file.is_file() else {}


_SAMPLE = '{"policy": "lqr", "gains": {"q_e": 100.0, "share": 0.9}, "trials": 40, "scenarios": 100}'


def _read_sample(read: Callable[..., Any], file: Path) -> Any:
    return read(file.read_bytes(), str(file), "lqr")


@reader("gains", "lqr.json", {"lqr.json": _SAMPLE}, _read_sample)
def read_gains(text: bytes | str, source: str, name: str) -> dict[str, Any]:
    """Returns the content of a gains file: the gains and their budget.

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
    for key in ("trials", "scenarios"):
        if not is_whole(content.get(key), 0, MOST_DRIVEN):
            raise ValueError(
                f"{source}: {key} must be a whole number from 0 to {MOST_DRIVEN}, got {shown(content.get(key))}"
            )
    return content
