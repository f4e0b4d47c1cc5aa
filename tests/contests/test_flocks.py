"""What is said of agents beside laws: by the best law there, in one of three outcomes."""

import flocks
import pytest


def drives(name: str, solved: list[bool]) -> list[flocks.Row]:
    return [
        {"contest": "crowdnav", "family": "crowdnav", "world": str(k), "policy": name, "success": str(int(each)),
         "extra_time": "2.0" if each else ""}
        for k, each in enumerate(solved)
    ]  # fmt: skip


@pytest.mark.parametrize(
    ("ours", "theirs", "worlds", "outcome"),
    [
        (1.0, 1.0, 500, "equivalent"),
        (1.0, 1.0, 20, "open"),  # that neither failed in few worlds does not make them alike
        (0.9, 0.2, 500, "better"),
        (0.2, 0.9, 500, "worse"),
        (0.52, 0.5, 200, "open"),
    ],
)
def test_alike_is_what_is_shown_to_be_and_not_what_is_not_told_apart(
    ours: float, theirs: float, worlds: int, outcome: str
) -> None:
    won = [[k % 100 < 100.0 * share for k in range(worlds)] for share in (ours, theirs)]
    rows = drives("agent", won[0]) + drives("law", won[1][::-1])
    assert flocks.less(rows, "agent", "law", "success").outcome([0.5] * 40) == outcome


def test_what_only_the_uncorrected_interval_says_stays_open() -> None:
    found = flocks.Less(0.02, 0.004, 0.036, 0.02, 500, True)
    assert [found.outcome([]), found.outcome([0.5] * 40)] == ["better", "open, ahead uncorrected"]


def test_the_rival_is_the_law_that_solves_most_and_of_such_the_quickest() -> None:
    rows = [drives("agent", [True] * 20), drives("poor", [False] * 20), drives("good", [True] * 20)]
    rows.append([{**row, "extra_time": "1.0"} for row in drives("quick", [True] * 20)])
    every = [row for each in rows for row in each]
    assert flocks.rival(every, "agent", ("poor", "good", "quick"), "success")[0] == "quick"
    assert flocks.rival(every, "agent", ("poor", "good"), "success")[0] == "good"
