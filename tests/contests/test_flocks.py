"""What is said of agents beside laws: by the best law there, in one of three outcomes."""

import itertools

import flocks
import numpy as np
import pytest

from wayfield.envs.scenarios.team_families import TEAM_FAMILIES
from wayfield.policies.registry import entering


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
        (1.0, 1.0, 20, "tie"),  # that neither failed in few worlds does not make them alike
        (0.9, 0.2, 500, "better"),
        (0.2, 0.9, 500, "worse"),
        (0.52, 0.5, 200, "tie"),
    ],
)
def test_alike_is_what_is_shown_to_be_and_not_what_is_not_told_apart(
    ours: float, theirs: float, worlds: int, outcome: str
) -> None:
    won = [[k % 100 < 100.0 * share for k in range(worlds)] for share in (ours, theirs)]
    rows = drives("agent", won[0]) + drives("law", won[1][::-1])
    assert flocks.less(rows, "agent", "law", "success").outcome([0.5] * 40) == outcome


def test_what_only_the_uncorrected_interval_says_is_no_tie_and_not_shown() -> None:
    found = flocks.Less(0.02, 0.004, 0.036, 0.02, 500, True)
    assert [found.outcome([]), found.outcome([0.5] * 40)] == ["better", "ahead, not significantly"]
    fewer = flocks.Less(-0.036, -0.05, -0.02, 0.02, 500, True)
    assert fewer.outcome([0.5] * 40) == "behind, not significantly"


def test_the_rival_is_the_law_that_solves_most_and_of_such_the_quickest() -> None:
    rows = [drives("agent", [True] * 20), drives("poor", [False] * 20), drives("good", [True] * 20)]
    rows.append([{**row, "extra_time": "1.0"} for row in drives("quick", [True] * 20)])
    every = [row for each in rows for row in each]
    assert flocks.rival(every, ("poor", "agent"), ("poor", "good", "quick"), "success")[:2] == ("agent", "quick")
    assert flocks.rival(every, ("agent",), ("poor", "good"), "success")[1] == "good"


def test_a_sentence_is_of_the_best_rival_of_an_access_and_none_is_lost_from_the_tables() -> None:
    shares = {"orca_team": 0.5, "orca_team tuned": 0.7, "vfh_plus": 0.6, "dwa": 0.4, "ppo seed 0": 0.3}
    rows: list[flocks.Row] = []
    for k in range(3):
        shares[f"team_scan seed {k}"] = 0.8
    for name, share in shares.items():
        rows += [
            {**row, "family": "open_4", "solved": row["success"], "arrived": "0", "touched": "0"}
            for row in drives(name, [k < 20 * share for k in range(20)])
        ]
    compared, shown = flocks.team_tables(rows)
    mine = [each for each in compared if each.agent == "team_scan"]
    assert {each.law for each in flocks.hardest(mine)} == {"orca_team tuned", "vfh_plus", "ppo"}
    assert all(f"| {law}" in shown([]) for law in ("orca_team", "dwa", "vfh_plus", "ppo"))


def test_every_policy_that_drives_among_others_is_entered_or_named_as_left_out() -> None:
    entered = {*flocks.AGENTS, *itertools.chain(*flocks.RIVALS.values(), *flocks.AMONG_PEOPLE.values())}
    lacking = {*entering("teams"), *entering("people"), "any_robot", "hybrid"} - entered
    left_out = flocks.PROSE.partition("Not shown:")[2]
    assert all(f"`{name}`" in left_out for name in lacking), lacking


@pytest.mark.parametrize("law", ["orca_team", "vfh_plus"])
def test_what_is_advised_is_what_the_page_takes(law: str) -> None:
    teams, people = [], []
    for place, solved in (("open_4", 0.9), ("doorway_4", 0.3)):
        for name, share in (
            ("team_scan seed 0", solved),
            ("team_scan seed 1", solved),
            ("team_scan seed 2", solved),
            (law, 0.85),
        ):
            for k in range(40):
                won = k < 40 * share
                teams.append(
                    {
                        "family": place,
                        "world": str(k),
                        "policy": name,
                        "solved": str(int(won)),
                        "arrived": str(int(won)),
                        "touched": "0",
                        "extra_time": "2.0" if won else "",
                    }
                )
    page = flocks.of_page(teams, people)
    for each in flocks.team_tables(teams)[0]:
        if kind := {"open alone": "open field", "walls alone": "doors and rooms"}.get(each.what):
            line = next(line for line in flocks.advice(teams, people).splitlines() if f"{kind} " in line)
            assert f"| `{flocks.taken(each.agent, each.law, each.difference, page, each.seeds)}` " in line


def test_worlds_that_are_one_scene_turned_are_counted_once() -> None:
    for name, family in TEAM_FAMILIES.items():
        if family.team > 32 or family.walled:
            continue
        apart = []
        for seed in range(3):
            ends = np.array([(*robot.start[:2], *robot.goal[:2]) for robot in family.make(seed).robots]).reshape(-1, 2)
            apart.append(np.linalg.norm(ends[:, None] - ends, axis=-1))
        one = all(np.allclose(each, apart[0], atol=1e-4) for each in apart)
        rows: list[flocks.Row] = [{"family": name, "world": str(k)} for k in range(3)]
        assert len(flocks.independent(rows)) == (1 if one else 3), name
