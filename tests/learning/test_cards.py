"""A card is read field by field: wrong values under a right digest are a line that names the field."""

import copy
import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

import wayfield.policies
from wayfield.policies.learned.agent import CARD, WEIGHTS, load_agent, signed

AGENTS = Path(wayfield.policies.__path__[0]) / "agents"
OTHERS: tuple[Any, ...] = (None, True, 2, -0.5, 10**400, "x", [2], {"x": 1})
BASE = {"controller": "pure_pursuit", "gains": {"lookahead_distance": 0.4}, "reach": 0.5}


def places(value: Any, at: tuple[Any, ...] = ()) -> Iterator[tuple[Any, ...]]:
    """Yields where the values of a card are, those of a list by its first element."""
    if at:
        yield at
    if isinstance(value, dict):
        for key in value:
            yield from places(value[key], (*at, key))
    elif isinstance(value, list) and value:
        yield from places(value[0], (*at, 0))


def changed(card: dict[str, Any], at: tuple[Any, ...], value: Any) -> dict[str, Any]:
    """Returns a card with another value at a place, signed."""
    found: Any = copy.deepcopy(card)
    inner = found
    for key in at[:-1]:
        inner = inner[key]
    inner[at[-1]] = value
    return signed(found)


@pytest.mark.parametrize(
    ("name", "more"),
    [("goal_reaching_p3dx", {}), ("path_following_p3dx", {}), ("path_following_p3dx", {"base": BASE})],
    ids=["goal", "path", "adds to a controller"],
)
def test_a_signed_card_with_a_value_of_another_type_loads_or_names_file_and_field(
    name: str, more: dict[str, Any], tmp_path: Path
) -> None:
    home = AGENTS / name / "seed_0"
    (tmp_path / WEIGHTS).write_bytes((home / WEIGHTS).read_bytes())
    card = json.loads((home / CARD).read_text())
    at = places(card | more) if not more else (("base", *each) for each in places(BASE))
    for place in at:
        if place[0] in ("digest", "format"):  # which `signed` writes
            continue
        was: Any = card | more
        for key in place:
            was = was[key]
        for value in OTHERS:
            if type(value) is type(was):
                continue
            (tmp_path / CARD).write_text(json.dumps(changed(card | more, place, value)))
            try:
                load_agent(tmp_path)
            except ValueError as error:
                said = str(error)
                if said.startswith(str(tmp_path / WEIGHTS)):  # the card is right, and of another network
                    continue
                assert said.startswith(str(tmp_path / CARD)), (place, value, said)
                assert any(str(key) in said for key in place if isinstance(key, str)), (place, value, said)
                assert len(said.splitlines()) == 1, (place, value, said)
                assert len(said) < 1000, (place, value, said)
