"""Sets of gains that are named after a search have the record of one, and rows print what was spent."""

import copy
from pathlib import Path
from typing import Any

import pytest
from audit_searches import misnamed_rows, missing_records, shipped_gains
from kept_rows import SUFFIX, read_packed

from wayfield.benchmarks.contests import CONTESTS
from wayfield.policies.learned.agent import CARD, read_card
from wayfield.policies.learned.ppo import shipped

ROWS = Path(__file__).parents[2] / "docs" / "results" / "rows"
NAME = "path-following/lqr_p3dx_0.6_none.json"
GAINS = {"q_e": 40.0, "speed": 0.7}
RECORD: dict[str, Any] = {
    "policy": "lqr", "suite": "path-following", "robot": "p3dx", "speed": 0.6, "level": "none", "chosen": "search",
    "gains": GAINS, "frames": 450_000, "searched_on": {"split": "train"},
    "command": "python -m x lqr --suite path-following --robot p3dx --speed 0.6 --level none --frames 400000",
    "validation": {
        "winner": "found 1", "chosen": {"episodes": 130},
        "finalists": {"default": {"gains": {}}, "found 1": {"gains": GAINS}},
    },
}  # fmt: skip
ROW = {
    "contest": "path-following", "policy": "lqr", "robot": "p3dx", "speed": "", "gains_name": "tuned",
    "gains": "q_e=40 speed=0.7", "learned_from": "0.5 M frames",
}  # fmt: skip


def changed(place: str, value: Any) -> dict[str, Any]:
    """Returns the record with one value another one; the place is written with dots."""
    content = copy.deepcopy(RECORD)
    *above, last = place.split(".")
    inner = content
    for name in above:
        inner = inner[name]
    inner[last] = value
    return content


def test_every_set_that_ships_under_the_name_of_a_search_has_its_record() -> None:
    assert list(missing_records(dict(shipped_gains()))) == []


@pytest.mark.parametrize("section", sorted(file.name.removesuffix(SUFFIX) for file in ROWS.glob(f"*{SUFFIX}")))
def test_published_sets_are_called_what_they_are_and_print_what_was_spent(section: str) -> None:
    rows = [{"speed": "", **row} for row in read_packed(ROWS / f"{section}{SUFFIX}") if row.get("contest")]
    assert list(misnamed_rows(rows, dict(shipped_gains()), section)) == []


@pytest.mark.parametrize("section", sorted(file.name.removesuffix(SUFFIX) for file in ROWS.glob(f"*goal*{SUFFIX}")))
def test_agents_say_where_the_gains_of_teacher_and_planner_were_found_on_validation(section: str) -> None:
    sets = dict(shipped_gains())
    told: dict[tuple[str, str, str], set[str]] = {}
    for row in read_packed(ROWS / f"{section}{SUFFIX}"):
        if row["gains_name"] == "trained":
            told.setdefault((row["contest"], row["policy"], row["robot"]), set()).add(row["learned_from"])
    assert told
    for (suite, policy, robot), words in told.items():
        folders = shipped(CONTESTS[suite].spec.name, robot)
        behind = {read_card(folder / CARD)["training"]["taught_by"] for folder in folders.values()}
        behind |= {"scan_planner"} if policy == "hybrid" else set()
        found = [sets.get(f"{suite}/{name}_{robot}_0.6_none.json", {}) for name in behind]
        kept = [each["searched_on"]["split"] for each in found if each.get("chosen", "default") != "default"]
        assert all(each.endswith(", on validation") == ("validation" in kept) for each in words)


def test_a_whole_record_has_no_fault() -> None:
    assert list(missing_records({NAME: RECORD})) == []
    assert list(misnamed_rows([ROW], {NAME: RECORD}, "here")) == []


@pytest.mark.parametrize(
    ("place", "value", "message"),
    [
        ("frames", 30_000, "of 400000 frames that were asked for 30000 were driven"),
        ("level", "moderate", "not for lqr under the disturbance moderate"),
        ("speed", 0.45, "not for speed 0.45"),
        ("robot", "jackal", "not for robot jackal"),
        ("command", "", "no budget is printed"),
        ("searched_on.split", "validation", "searched for on the split 'validation'"),
        ("validation.chosen.episodes", 65, "drove 65 of 130 episodes"),
        ("validation.winner", "default", "not the set that won"),
    ],
)
def test_a_record_that_does_not_match_is_found(place: str, value: Any, message: str) -> None:
    found = "\n".join(missing_records({NAME: changed(place, value)}))
    assert message in found
    assert list(missing_records({NAME: changed(place, value) | {"chosen": "hand"}})) == []


@pytest.mark.parametrize(
    ("sets", "row", "message"),
    [
        ({}, {}, "is missing"),
        ({NAME: changed("chosen", "hand")}, {}, "is hand"),
        ({NAME: RECORD}, {"gains_name": "by hand"}, "is search"),
        ({NAME: RECORD}, {"learned_from": "8.2 M frames"}, "prints 8.2 M frames"),
        ({NAME: RECORD}, {"gains": "q_e=41 speed=0.7"}, "other gains"),
        ({NAME: RECORD}, {"speed": "0.45"}, "lqr_p3dx_0.45_none.json is missing"),
    ],
)
def test_a_row_that_is_called_otherwise_is_found(sets: dict[str, Any], row: dict[str, str], message: str) -> None:
    (found,) = misnamed_rows([ROW | row], sets, "here")
    assert message in found
