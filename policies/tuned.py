"""Gains that were found by search on validation scenarios, as they ship with the package."""

import json
import re
from collections.abc import Mapping
from importlib import resources
from typing import Any


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


def _shipped(name: str, suite: str) -> dict[str, Any]:
    if not re.fullmatch(r"[a-z0-9_]+", name) or not re.fullmatch(r"[a-z0-9-]+", suite):
        raise ValueError(f"policy {name!r} and suite {suite!r} must be plain names")
    file = resources.files("wayfield.policies") / "gains" / suite / f"{name}.json"
    return read_gains(file.read_text(encoding="utf-8"), str(file), name) if file.is_file() else {}


def read_gains(text: str, source: str, name: str) -> dict[str, Any]:
    """Returns the content of a gains file: the gains and their budget.

    Raises:
        ValueError: if the text is no gains file of that policy; the message names the source.
    """
    try:
        content = json.loads(text)
    except ValueError as error:
        raise ValueError(f"{source} is no JSON: {error}") from None
    if not isinstance(content, Mapping) or content.get("policy") != name:
        raise ValueError(f"{source} does not hold gains of policy {name!r}")
    gains = content.get("gains")
    if not isinstance(gains, dict) or not all(isinstance(v, int | float | str | bool) for v in gains.values()):
        raise ValueError(f"{source}: gains is {gains!r}; it must map names to plain values")
    for key in ("trials", "scenarios"):
        if type(content.get(key)) is not int:
            raise ValueError(f"{source}: {key} must be a whole number, got {content.get(key)!r}")
    return dict(content)
