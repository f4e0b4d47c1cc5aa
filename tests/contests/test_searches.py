"""Sets of gains that are named after a search have the record of one, and rows print what was spent."""

from pathlib import Path

import pytest
from audit_searches import misnamed_rows, missing_records, shipped_gains
from kept_rows import SUFFIX, read_packed

from wayfield.benchmarks.contests import CONTESTS
from wayfield.policies.learned.agent import CARD, read_card
from wayfield.policies.trained.ppo import shipped

ROWS = Path(__file__).parents[2] / "docs" / "results" / "rows"


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
