"""The audit of published tables: it agrees with right tables, sees every wrong cell, and asks what it says it asks."""

import csv
import io
import json
import math
import re
import statistics
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from click.testing import CliRunner
from test_restated_tables import COMMAND, costs_of, groups, named, number, rows_of

from wayfield.benchmarks import audit, audit_formulas
from wayfield.benchmarks.aggregates import counted_interval, interval, iqm
from wayfield.benchmarks.audit import Audit
from wayfield.benchmarks.contests import ALL_CONTESTS, CONTESTS
from wayfield.benchmarks.kept_rows import packed
from wayfield.benchmarks.results import write_rows
from wayfield.benchmarks.sections import SECTIONS
from wayfield.benchmarks.standings import contest_tables

NAN = math.nan


def shown(text: str) -> list[dict[str, str]]:
    return list(csv.DictReader(io.StringIO(text)))


@pytest.fixture(scope="module", params=["path-following", "goal-obstacles"])
def run(request: pytest.FixtureRequest) -> tuple[list[dict[str, str]], dict[str, list[dict[str, str]]]]:
    """Returns the rows of a contest, and its tables by what their names end in."""
    rows = [row | {"learned_from": "2.0 M frames"} for row in rows_of(CONTESTS[request.param], 0)]
    stem = f"{request.param.replace('-', '_')}_p3dx"
    tables = contest_tables(rows, [], COMMAND, ladder=False)
    return rows, {name.removeprefix(stem): shown(table.csv()) for name, table in tables.items()}


AUDITS = {"": audit.audit_standings, "_better": audit.audit_pairs, "_claims": audit.audit_claims}


def found(rows: Sequence[Any], tables: dict[str, list[dict[str, str]]], end: str) -> Audit:
    result = Audit()
    AUDITS[end](result, rows, tables[end], "here")
    return result


def test_right_tables_agree_and_every_number_in_them_is_made_again(run: Any) -> None:
    rows, tables = run
    for end in AUDITS:
        result = found(rows, tables, end)
        # the brackets' widths are compared with a bootstrap, which few and skewed runs may part from
        assert [each for each in result.wrong if " wide, resampling gives" not in each] == []
        if end == "_claims":
            assert result.cells == 2 * len(tables[end])
        elif end == "_better":
            numbers = [cell for line in tables[end] for name, cell in line.items() if name != "policy"]
            assert result.cells == sum(cell != "" for cell in numbers) > 12
        else:
            headers = [name for name in tables[end][0] if name in audit_formulas.MEANINGS]
            alone = [line for line in tables[end] if line["policy"] != "ppo" and "[" in line["success (%)"]]
            assert result.cells == len(tables[end]) * len(headers) + 2 * len(alone)


def off(cell: str) -> str:
    """Returns a cell whose first number differs by two of its last digit."""
    (text,) = re.findall(r"^[^0-9+-]*([+-]?\d+(?:\.\d+)?)", cell)
    digits = len(text.partition(".")[2])
    plus = "+" if text.startswith("+") else ""
    return cell.replace(text, f"{plus if float(text) >= 0 else ''}{float(text) + 2 * 10.0**-digits:.{digits}f}", 1)


def test_a_changed_cell_is_seen_and_named(run: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    rows, tables = run
    monkeypatch.setattr(audit, "_check_ends", lambda *_: None)
    monkeypatch.setattr(audit_formulas, "resampled", lambda *_: (0.6, 0.9))
    for end in AUDITS:
        line = next(k for k, each in enumerate(tables[end]) if "B" in (each["policy"], each.get("against")))
        for header, cell in tables[end][line].items():
            counts = header in ("success (points)", "cost") or header in audit_formulas.MEANINGS or end == "_better"
            if not counts or header == "policy" or not re.match(r"[+-]?\d", cell):
                continue
            changed = [dict(each) for each in tables[end]]
            changed[line][header] = off(cell)
            (wrong,) = [each for each in found(rows, {end: changed}, end).wrong if "shows" in each]
            name = {"success (points)": "success", "cost": "cost"}.get(header, header)
            assert wrong.startswith("here, ")
            assert name in wrong
            assert "B" in wrong
            changed[line][header] = "-"
            assert any("shows -, the rows give" in each for each in found(rows, {end: changed}, end).wrong)


def test_lines_without_rows_and_rows_without_a_line_are_seen(run: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    rows, tables = run
    monkeypatch.setattr(audit, "_check_ends", lambda *_: None)
    short = {"": [line for line in tables[""] if line["policy"] != "B"]}
    assert found(rows, short, "").wrong == ["here: B has rows and no line"]
    fewer = [row for row in rows if row["policy"] != "B"]
    assert found(fewer, tables, "").wrong == ["here: B (default) has a line and no rows"]
    claims = len(tables["_claims"])
    cut = {"_claims": tables["_claims"][1:]}
    assert found(rows, cut, "_claims").wrong == [f"here: {claims - 1} claims, where the rows have {claims} comparisons"]
    wrong = found(fewer, tables, "_claims").wrong
    of_b = [line for line in tables["_claims"] if line["against"] == "B"]
    assert wrong[1:] == [f"here: {line['condition']}, B has a claim and no rows" for line in of_b]
    few = [row for row in rows if row["family"] == "narrow" or int(row["episode"]) < 4]
    brackets = [each for each in found(few, tables, "").wrong if "brackets of fewer than 5" in each]
    assert len(brackets) == sum("[" in cell for line in tables[""] for name, cell in line.items()
                                if name in audit_formulas.MEANINGS)  # fmt: skip


def test_a_verdict_needs_an_interval_on_its_side(run: Any) -> None:
    rows, tables = run
    lines = [dict(line) for line in tables["_claims"]]
    base = len(found(rows, {"_claims": lines}, "_claims").wrong)
    for verdict in ("wins", "loses", "level"):
        for cell, fault in (
            ("+1.0 [-1.0, +2.0]", True),
            ("+1.0 [+0.5, +2.0]", False),
            ("+1.0", True),
            ("-1.0 [-2.0, -0.5]", False),
            ("-1.0 [-2.0, 0.0]", True),
            ("+1 s [0.0, 1.0]", True),
        ):
            changed = [lines[0] | {"success (points)": cell, "on success": verdict}, *lines[1:]]
            wrong = [each for each in found(rows, {"_claims": changed}, "_claims").wrong if "holds 0" in each]
            assert len(wrong) == (fault and verdict != "level")
            assert not wrong or wrong[0].endswith(f"{verdict}, where the interval holds 0")
    assert base == 0


def test_a_number_is_compared_to_its_last_digit() -> None:
    for cell, wanted, same in (
        ("1.00", 1.005, True), ("1.00", 1.0051, False), ("1.00", 0.995, True), ("0.10 [a]", 0.104, True),
        ("-3", -3.4, True), ("-3", -3.6, False), ("+2.5", 2.54, True), ("x", NAN, True), ("", NAN, True),
        ("", 1.0, False), ("1.0", NAN, False), ("7000000", 7000013.0, True), ("7000000", 7000016.0, False),
    ):  # fmt: skip
        result = Audit()
        result.check("it", cell, wanted)
        assert (result.wrong == []) is same, (cell, wanted)
        assert result.cells == 1
    result = Audit()
    result.check("it", "1.0", 1.05, 0.06)
    result.check("it", "1.0", 1.07, 0.06)
    result.check("it", "", 2.0)
    result.check("it", "1", NAN)
    assert result.wrong == [
        "it: shows 1.0, the rows give 1.07",
        "it: shows nothing, the rows give 2",
        "it: shows 1, the rows give nan",
    ]
    for _ in range(2):
        result.ask("why?")
    result.note("no")
    assert result.questions == ["why?"]
    assert result.wrong[-1] == "no"


def row(**cells: Any) -> dict[str, str]:
    """Returns a row of goal reaching."""
    whole = {
        "contest": "goal-obstacles", "robot": "p3dx", "split": "test", "family": "f", "scenario": "f/test",
        "episode": "0", "seed": "0", "policy": "A", "gains_name": "default", "gains": "", "agent_seed": "",
        "success": 1.0, "time": 10.0, "failure_cost": 60.0, "speed": "", "disturbance": "none", "knows": "scan",
        "learned_from": "2.0 M frames", "mean_speed": 0.6,
    }  # fmt: skip
    return {name: each if isinstance(each, str) else repr(each) for name, each in (whole | cells).items()}


def many(count: int, **cells: Any) -> list[dict[str, str]]:
    rng = np.random.default_rng(count)
    return [
        row(**{"episode": str(k), "seed": str(k), "time": float(rng.normal(20.0, 3.0))} | cells) for k in range(count)
    ]


def test_rows_are_put_together_by_what_they_are() -> None:
    assert audit.label(row()) == "A"
    assert audit.label(row(gains_name="tuned")) == "A (tuned)"
    rows = [row(policy="B"), row(), row(policy="B", episode="1")]
    assert audit.entries(rows) == {"B": [rows[0], rows[2]], "A": [rows[1]]}
    two = [row(family="a", scenario="x", episode="1"), row(family="a", scenario="x"), row(family="b", scenario="y")]
    assert audit.strata(two) == {"a": ["x 0", "x 1"], "b": ["y 0"]}
    assert audit.strata([each | {"split": "own"} for each in two]) == {"own": ["x 0", "x 1", "y 0"]}
    alone = [each | {"split": "public"} for each in two]
    assert set(audit.strata(alone)) == {"own"}
    more = [*alone, row(split="public", family="b", scenario="z")]
    assert set(audit.strata(more)) == {"a", "b"}
    assert audit._condition("p3dx, asked for 0.3 m/s, strong disturbance") == ("0.3", "strong")
    assert audit._condition("p3dx") == ("", "none")
    assert audit._cost(row()) == "time"
    assert audit._cost(row(cross_track_rms=0.1)) == audit._cost(row(contest="path-x")) == "cross_track_rms"


def test_brackets_are_those_of_other_formulas(monkeypatch: pytest.MonkeyPatch) -> None:
    rows = [*many(12), *many(8, family="g", scenario="g/test")]
    rows[3]["success"] = "0.0"

    def said(cell: str, header: str, group: Sequence[dict[str, str]] = rows) -> list[str]:
        result = Audit()
        audit._check_ends(result, "it", cell, group, header)
        return result.wrong

    low, high = audit_formulas.binomial_ends(19, 20)
    share = f"95.0 [{100 * low:.1f}, {100 * high:.1f}]"
    assert said(share, "success (%)") == []
    assert ["low end" in said(f"95.0 [{100 * low + 0.2:.1f}, {100 * high:.1f}]", "success (%)")[0]] == [True]
    assert "high end" in said(f"95.0 [{100 * low:.1f}, {100 * high - 0.2:.1f}]", "success (%)")[0]
    # of several agents only the order is looked at
    agents = [each | {"agent_seed": str(k % 2)} for k, each in enumerate(rows)]
    assert said("95.0 [1.0, 96.0]", "success (%)", agents) == []
    for cell in ("95.0 [96.0, 97.0]", "95.0 [90.0, 94.0]", "95.0 [95.0, 95.0]"):
        (told,) = said(cell, "success (%)", agents)
        assert "is no interval of 95" in told
    families = [[each for each in rows if each["family"] == name] for name in "fg"]
    for header, reduce, failure in (("imputed (s)", None, 60.0), ("time (s)", audit_formulas.middle_half, 0.0)):
        if reduce is None:
            pairs = [[(float(each["time"]) if each["success"] == "1.0" else failure, each["success"] == "1.0")
                      for each in group] for group in families]  # fmt: skip
            below, above = audit_formulas.counted_ends(pairs, failure)
        else:
            below, above = audit_formulas.resampled(
                [[float(each["time"]) for each in group if each["success"] == "1.0"] for group in families], reduce
            )
        width = above - below
        for factor, fine in ((1.0, True), (0.75, True), (1.45, True), (0.6, False), (1.65, False)):
            half = 0.5 * factor * width
            wrong = said(f"20.00 [{20 - half:.2f}, {20 + half:.2f}]", header)
            assert (wrong == []) is fine, (header, factor)
            assert fine or f"resampling gives {width:.4g}" in wrong[0]


def test_an_entry_off_the_asked_speed_is_marked() -> None:
    for speed, cell, wrong, asked in (
        (0.6, "0.600", 0, 0), (0.617, "0.617", 0, 0), (0.583, "0.583", 0, 0), (0.619, "0.619", 1, 1),
        (0.58, "0.580 ‡", 0, 1), (0.6, "0.600 ‡", 1, 0), (0.619, "0.619 ‡", 0, 1),
    ):  # fmt: skip
        result = Audit()
        rows = [row(mean_speed=speed), row(mean_speed=0.1, success=0.0)]
        audit._check_pace(result, "here", "A", rows, {"mean speed (m/s)": cell})
        assert (len(result.wrong), len(result.questions)) == (wrong, asked), (speed, cell)
    for rows, line in (([row(mean_speed=0.1)], {}), ([row(success=0.0)], {"mean speed (m/s)": "0.9"})):
        audit._check_pace(result, "here", "A", rows, line)
    assert (len(result.wrong), len(result.questions)) == (0, 1)


def test_who_wins_a_pair_and_by_how_much_they_differ() -> None:
    good, slow, bad = row(time=10.0), row(time=12.0), row(success=0.0, time=1.0)
    for a, b, share in ((good, slow, 1.0), (slow, good, 0.0), (good, good, 0.5), (good, bad, 1.0), (bad, slow, 0.0),
                        (bad, row(success=0.0, time=9.0), 0.5)):  # fmt: skip
        assert audit._win(a, b) == share
    ours = [row(time=10.0, agent_seed="0"), row(time=20.0, agent_seed="1"), row(family="g", episode="1", time=3.0)]
    theirs = [row(time=15.0), row(time=15.0, episode="1"), row(time=1.0, episode="2")]
    assert audit._wins(ours, theirs) == {"f": [0.5], "g": [1.0]}
    assert audit._cost_difference(ours, theirs) == pytest.approx((-5.0 + 5.0 - 12.0) / 3)
    a, b = ([each | {"cross_track_rms": repr(v)} for each, v in zip(rows, vs, strict=False)]
            for rows, vs in ((ours, (0.5, 0.1, 0.2)), (theirs, (0.1, 0.4, 0.9))))  # fmt: skip
    assert audit._cost_difference(a, b) == pytest.approx(1e3 * (0.4 + 0.0 - 0.2) / 3)  # three have no quarters
    a[0]["success"] = "0.0"
    assert audit._cost_difference(a, b) == pytest.approx(1e3 * (60.0 - 0.1 + 0.0 - 0.2) / 3)


def test_a_star_that_a_bootstrap_is_not_sure_of_is_seen(monkeypatch: pytest.MonkeyPatch) -> None:
    rows = [*many(10), *many(10, policy="B", time=1000.0)]
    for ends, seen in (((0.4, 0.6), 1), ((0.6, 0.9), 0), ((0.1, 0.5), 0), ((0.5, 0.9), 0)):
        monkeypatch.setattr(audit_formulas, "resampled", lambda *_, ends=ends: ends)
        for star in ("1.00*", "1.00"):
            for other in (rows, [each | {"agent_seed": str(k % 2)} for k, each in enumerate(rows)]):
                result = Audit()
                table = [{"policy": "A", "A": "", "B": star, "nobody": "0.1"}, {"policy": "nobody", "A": "0.1"}]
                audit.audit_pairs(result, other, table, "here")
                wrong = seen if "*" in star and other is rows else 0
                assert result.wrong == ["here, A / B: starred, where a bootstrap is not sure"] * wrong
                assert result.cells == 1


def test_entries_meet_the_same_scenarios_with_noise_of_their_own() -> None:
    def told(rows: Sequence[dict[str, str]]) -> tuple[list[str], list[str]]:
        result = Audit()
        audit.audit_pairing(result, rows, "here")
        return result.wrong, result.questions

    rows = [*many(6), *many(6, policy="B")]
    assert told(rows) == ([], [])
    for change in ({"seed": "9"}, {"episode": "9"}, {"scenario": "z"}):
        wrong, _ = told([*rows[:-1], rows[-1] | change])
        assert wrong == ["here, test  none: B met other scenarios or seeds than A"]
    assert told([*rows, row(policy="B", split="validation")]) == ([], [])
    wrong, asked = told([*rows, *many(5, policy="C", split="front", speed="0.3")])
    assert (wrong, asked) == ([], [])
    same = [each | {"seed": "0"} for each in rows]
    assert told(same)[1] == [
        "here, test  none: the same seeds drive several scenes: is their noise one sample or many?"
    ]
    assert told([*many(4), *many(4, policy="B")])[1] == [
        "here, test  none: 4 scenarios in a family: why not 5, for an interval?"
    ]


def test_what_a_sceptic_asks_about_gains_and_budgets(monkeypatch: pytest.MonkeyPatch) -> None:
    file = {"policy": "A", "gains": {"k": 1.5, "speed": 0.6, "n": 3}, "searched_on": {"split": "train"}, "speed": 0.6}
    files = [file]
    monkeypatch.setattr(audit, "_shipped_gains", lambda: iter(files))

    def asked(*rows: dict[str, str], wrong: int = 0) -> list[str]:
        result = Audit()
        audit.audit_conditions(result, rows, "here")
        assert len(result.wrong) == wrong
        return result.questions

    tuned = {"gains_name": "tuned", "gains": "k=1.5 speed=0.3 n=3"}
    assert asked(row(**tuned)) == []
    assert asked(row(**tuned, split="validation", robot="omni3")) == []
    assert asked(row(**tuned, robot="omni3"), row(**tuned, robot="omni3")) == [
        "here: A (tuned) was tuned for another condition than omni3: at its best there?"
    ]
    assert asked(row(**tuned, robot="omni3", speed="0.3", split="front")) == [
        "here: A (tuned) was tuned for another condition than omni3, 0.3 m/s: at its best there?"
    ]
    assert asked(row(**tuned | {"gains": "k=1.6 n=3"}, robot="omni3")) == []
    files.append(file | {"robot": "omni3"})
    assert asked(row(**tuned, robot="omni3")) == []
    files[:] = [file | {"searched_on": {"split": "validation"}}]
    assert asked(row(**tuned)) == ["here: A (tuned) was searched for on the split that it was chosen by: what would "
                                   "another give?"]  # fmt: skip
    files[:] = [file]
    mild = "here: {} was tuned without disturbances: where are gains that were tuned under them?"
    assert asked(row(**tuned, disturbance="mild"), row(**tuned)) == [mild.format("A (tuned)")]
    assert asked(row(**tuned | {"gains_name": "robust"}, disturbance="mild")) == []
    files[:] = []
    two = [row(**tuned, speed=speed, split="front") for speed in ("0.3", "0.9")]
    same = ["here: A (tuned) has one set of gains at every asked speed: which is it at its best?"]
    assert asked(*two) == same
    assert asked(two[0], two[1] | {"gains": "k=1.5 speed=0.9 n=3"}) == same
    assert asked(two[0], two[1] | {"gains": "k=1.7 speed=0.9 n=3"}) == []
    assert asked(two[0]) == []
    # budgets
    assert asked(row(), row(policy="B", learned_from="3.0 M frames, taught by A")) == []
    assert asked(row(), row(policy="B", learned_from="3.2 M frames")) == [
        "here: B learned from 3.2 M frames, A from 2 M: what if it had as many?"
    ]
    nothing = "0 frames, as published"
    assert asked(row(), row(policy="B", learned_from=nothing)) == [
        "here: nothing was searched for B: what would a search find?"
    ]
    assert asked(row(learned_from=nothing), row(policy="zero", learned_from=nothing)) == [
        "here: nothing was searched for A: what would a search find?"
    ]
    for free in ({"gains_name": "paper"}, {"gains_name": "own"}):
        assert asked(row(), row(policy="B", learned_from=nothing, **free)) == []
    assert asked(row(**tuned), row(learned_from=nothing)) == []  # beside what was searched for
    assert asked(row(policy="B", **tuned), row(learned_from=nothing)) != []
    assert asked(row(learned_from="much"), wrong=1) == []
    assert asked(row(), row(policy="B", knows="map")) == [
        "here: entries are told map, scan: which of them may be compared?"
    ]


def test_gains_files_are_known_by_what_they_hold(tmp_path: Path) -> None:
    content = {"policy": "A", "gains": {"k": 1.5, "speed": 0.6, "n": 3, "k_ang": 2.0}}
    assert audit._same(content, "k=1.5 n=3")
    assert audit._same(content, "k=1.5 n=3 speed=9 more x=a=b=c")
    assert not audit._same(content, "k=1.5")
    assert not audit._same(content, "k=1.6 n=3")
    rows = [row(speed="0.3", gains="a=1 speed=2 k_lin=3"), row(speed="0.3", gains="max_speed=1 a=1"), row(gains="a=2")]
    assert audit._other_gains(rows) == {"a=1"}
    for text, whole in ((json.dumps(content), True), ("{", False), ("[]", False), ('{"gains": {}}', False),
                        ('{"policy": "A"}', False), ('{"policy": "A", "gains": 1}', False)):  # fmt: skip
        file = tmp_path / "a.json"
        file.write_text(text, encoding="utf-8")
        assert (audit.read_gains_file(file) is not None) is whole
    shipped = list(audit._shipped_gains())
    assert len(shipped) > 20
    assert {"lqr", "vfh_plus"} <= {each["policy"] for each in shipped}


@pytest.mark.parametrize("name", ["path-following", "goal-obstacles"])
def test_coverage_is_that_of_the_tables_own_intervals(
    name: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    rows = [each for each in rows_of(CONTESTS[name], 1) if each["policy"] != "B"]
    monkeypatch.setattr(audit, "RESAMPLES", 12)
    errors = name == "path-following"
    entries = groups([each for each in rows if each["split"] == "test"])
    rng_shares = {}
    for entry in entries:
        mine = sorted(entries[entry], key=lambda each: (each["scenario"], each["episode"], each["agent_seed"]))
        agents = len({each["agent_seed"] for each in mine})
        numbers = np.array(costs_of(mine, "cross_track_rms" if errors else "time")).reshape(-1, agents)
        won = np.array([number(each, "success") for each in mine]).reshape(-1, agents)
        families = np.array([each["family"] for each in mine[::agents]])
        failure = number(mine[0], "failure_cost")
        true = audit_formulas.middle_half(numbers.ravel().tolist()) if errors else statistics.fmean(numbers.ravel())
        rng, inside = np.random.default_rng(1), 0
        for k in range(12):
            order = list(dict.fromkeys(families.tolist()))
            lines = np.concatenate([rng.choice(np.flatnonzero(families == each), (families == each).sum())
                                    for each in order])  # fmt: skip
            columns = rng.integers(agents, size=agents)
            sample, met = numbers[lines][:, columns], families[lines].tolist()
            if errors:
                ends = interval(sample, met, iqm, k, 400)
            else:
                ends = counted_interval(sample, won[lines][:, columns], failure, met, k, 400)
            inside += ends is not None and ends[0] <= true <= ends[1]
        rng_shares[named(entry)] = 100.0 * inside / 12
    names = list(rng_shares)[:: max(len(rng_shares) // 3, 1)][:3]
    result = Audit()
    audit.measured_coverage(result, rows, "here")
    told = dict(re.findall(r"interval of (.*): ([\d.]+) % of 12 resamples", capsys.readouterr().out))
    assert told == {each: f"{rng_shares[each]:.1f}" for each in names}
    least = 100.0 * (0.95 - 2.5 * math.sqrt(0.95 * 0.05 / 12))
    assert len(result.wrong) == sum(rng_shares[each] < least for each in names)
    # which hold nothing are told
    monkeypatch.setattr(audit, "interval", lambda *_: None)
    monkeypatch.setattr(audit, "counted_interval", lambda *_: (1e9, 2e9))
    audit.measured_coverage(result, rows, "here")
    assert [each for each in result.wrong if "hold in 0.0 % of resamples" in each][-1].startswith(f"here, {names[-1]}:")
    few = [each for each in rows if int(each["episode"]) < 4]
    capsys.readouterr()
    audit.measured_coverage(result, few, "here")
    assert capsys.readouterr().out == ""


def test_runs_are_found_in_a_folder_or_among_those_that_are_kept(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="holds neither"):
        list(audit.found_runs(tmp_path))
    rows = many(2)
    write_rows(tmp_path / "run" if (tmp_path / "run").mkdir() is None else tmp_path, rows)
    ((name, read, folder),) = audit.found_runs(tmp_path / "run")
    assert (name, folder) == ("run", tmp_path / "run")
    assert [dict(each) for each in read] == rows
    (tmp_path / "rows").mkdir()
    within = next(section for section in SECTIONS if section.within)
    for each in ("nobody", within.name):
        (tmp_path / "rows" / f"{each}.csv.xz").write_bytes(packed(rows))
    runs = {name: (list(map(dict, read)), folder) for name, read, folder in audit.found_runs(tmp_path)}
    assert runs == {"nobody": (rows, tmp_path), within.name: (rows, tmp_path / within.within)}


def test_the_command_counts_and_ends_with_status_1_where_a_cell_disagrees(
    run: Any, tmp_path: Path, monkeypatch: Any
) -> None:
    rows, tables = run
    monkeypatch.setattr(audit, "RESAMPLES", 2)
    monkeypatch.setattr(audit, "_check_ends", lambda *_: None)
    monkeypatch.setattr(audit, "HOLDS", 0.0)
    write_rows(tmp_path, rows)
    stem = f"{rows[0]['contest'].replace('-', '_')}_p3dx"
    for end in AUDITS:
        with open(tmp_path / f"{stem}{end}.csv", "w", encoding="utf-8") as file:
            writer = csv.DictWriter(file, tables[end][0])
            writer.writeheader()
            writer.writerows(tables[end])
    whole = Audit()
    for end, each in AUDITS.items():
        each(whole, rows, tables[end], f"{stem}{end}")
    audit.audit_pairing(whole, rows, f"{tmp_path.name}, p3dx")
    audit.audit_conditions(whole, rows, f"{tmp_path.name}, p3dx")
    done = CliRunner().invoke(audit.main, [str(tmp_path)])
    assert done.exit_code == 0, done.output
    lines = done.output.splitlines()
    assert lines[0] == f"{tmp_path.name}, {stem}: {len(rows)} rows"
    assert f"{whole.cells:,} numbers made a second time; 0 findings" in lines
    asked = [f"  {k}. {each}" for k, each in enumerate(whole.questions, 1)]
    assert lines[-len(asked) - 1 :] == [f"What a sceptic would ask ({len(asked)}):", *asked]
    assert sum("coverage of the interval" in line for line in lines) == 3
    file = tmp_path / f"{stem}_better.csv"
    file.write_text(file.read_text(encoding="utf-8").replace("0.", "1.", 1), encoding="utf-8")
    done = CliRunner().invoke(audit.main, [str(tmp_path)])
    assert done.exit_code == 1
    assert "; 1 findings" in done.output
    assert done.output.count("  disagrees: ") == 1
    done = CliRunner().invoke(audit.main, [str(tmp_path / "nowhere")])
    assert done.exit_code == 2


def test_a_ladder_has_its_claims_audited_and_nothing_else(tmp_path: Path, monkeypatch: Any) -> None:
    rows = [*many(6), *many(6, disturbance="mild")]
    (tmp_path / "goal_obstacles_p3dx_ladder_claims.csv").write_text("a\n1\n", encoding="utf-8")
    (tmp_path / "goal_obstacles_p3dx.csv").write_text("a\n1\n", encoding="utf-8")
    seen: list[Any] = []
    for name in ("audit_standings", "audit_claims", "audit_pairs", "audit_pairing", "audit_conditions"):
        monkeypatch.setattr(audit, name, lambda *words, name=name: seen.append((name, words[-1])))
    monkeypatch.setattr(audit, "measured_coverage", lambda *words: seen.append(("coverage", words[-1])))
    audit.audit_run(Audit(), "x", rows, tmp_path)
    ladder = [("audit_claims", "goal_obstacles_p3dx_ladder_claims")]
    rest = [("audit_pairing", "x, p3dx"), ("audit_conditions", "x, p3dx")]
    assert seen == ladder + rest
    seen.clear()
    audit.audit_run(Audit(), "x", rows[:6], tmp_path)
    assert seen == [("audit_standings", "goal_obstacles_p3dx"), *rest, ("coverage", "x, p3dx")]


def test_the_second_formulas_are_their_definitions() -> None:
    rows = [row(time=3.0), row(time=9.0, success=0.0), row(time="", spl=0.5), row(time=1.0)]
    assert audit_formulas.counted(rows[:2], "time") == [3.0, 60.0]
    assert audit_formulas.of_successes(rows[:2], "time") == [3.0]
    assert audit_formulas.every(rows, "time") == [3.0, 9.0, 1.0]
    assert audit_formulas.every(rows, "spl") == [0.5]
    assert math.isnan(audit_formulas.value(rows[2], "time"))
    assert math.isnan(audit_formulas.average([]))
    assert math.isnan(audit_formulas.largest([]))
    assert audit_formulas.largest([1.0, 3.0, 2.0]) == 3.0
    for count in range(1, 14):
        numbers = [float((7 * k) % 31) for k in range(count)]
        assert audit_formulas.middle_half(numbers) == pytest.approx(iqm(np.array(numbers)))
    rng = np.random.default_rng(0)
    strata = [rng.normal(3.0, 1.0, 40).tolist(), rng.normal(9.0, 2.0, 30).tolist()]
    whole = strata[0] + strata[1]
    # the spread of a mean over families of their own sizes
    spread = math.sqrt(sum(len(each) * statistics.variance(each) for each in strata)) / 70
    low, high = audit_formulas.resampled(strata, audit_formulas.average)
    assert 0.5 * (low + high) == pytest.approx(statistics.fmean(whole), abs=0.3 * spread)
    assert high - low == pytest.approx(2.0 * 1.96 * spread, rel=0.12)
    assert audit_formulas.resampled(strata, audit_formulas.average, 50, 3) != (low, high)
    seen: list[int] = []

    def counting(numbers: audit_formulas.Numbers) -> float:
        seen.append(len(numbers))
        return statistics.fmean(numbers)

    audit_formulas.resampled(strata, counting, 7)
    assert seen == [68] * 7  # samples, with one number fewer of each family
    # a middle half that six failures in fifty hardly ever reach: 400 resamples hold some of thousands all the same
    docks = [rng.uniform(16.0, 17.0, 10).tolist() for _ in range(5)]
    docks[0][:2], docks[1][:4] = [2000.0] * 2, [1000.0] * 4
    low, high = audit_formulas.resampled(docks, audit_formulas.middle_half)
    assert 16.0 < low < high < 17.0
    runs = [[(number, True) for number in strata[0]], [(number, k > 2) for k, number in enumerate(strata[1])]]
    good = [number for each in runs for number, success in each if success]
    bad = [number for each in runs for number, success in each if not success]
    cost = statistics.fmean(bad) - statistics.fmean(good)
    ends = sorted(cost * (end - 3 / 70) for end in audit_formulas.binomial_ends(3, 70))
    apart = [[number - statistics.fmean(good if success else bad) for number, success in each] for each in runs]
    below, above = audit_formulas.resampled(apart, audit_formulas.average)
    mean = statistics.fmean(whole)
    told = audit_formulas.counted_ends(runs, 1e9)
    assert told == pytest.approx((mean - math.hypot(below, ends[0]), mean + math.hypot(above, ends[1])))
    sure = [[(number, True) for number in each] for each in strata]
    low, high = audit_formulas.counted_ends(sure, 60.0)
    most = (60.0 - mean) * audit_formulas.binomial_ends(0, 70)[1]
    apart = [[number - mean for number in each] for each in strata]
    below, above = audit_formulas.resampled(apart, audit_formulas.average)
    assert (low, high) == pytest.approx((mean - abs(below), mean + math.hypot(above, most)))
    assert audit_formulas.binomial_ends(0, 5)[0] == 0.0
    assert audit_formulas.binomial_ends(5, 5)[1] == 1.0
    # the chances at the ends are a fortieth
    low, high = audit_formulas.binomial_ends(3, 10)
    chance = [math.comb(10, k) for k in range(11)]
    assert sum(c * low**k * (1 - low) ** (10 - k) for k, c in enumerate(chance) if k >= 3) == pytest.approx(
        0.025, rel=1e-3
    )
    assert sum(c * high**k * (1 - high) ** (10 - k) for k, c in enumerate(chance) if k <= 3) == pytest.approx(
        0.025, rel=1e-3
    )


def test_a_column_s_second_formula_takes_the_same_runs_and_the_same_metric() -> None:
    reductions = {"mean": audit_formulas.average, "iqm": audit_formulas.middle_half, "max": audit_formulas.largest}
    seen = {"success (%)"}  # which is no column of a contest's own
    for contest in ALL_CONTESTS.values():
        for column in contest.columns:
            of, metric, reduce, factor = audit_formulas.MEANINGS[column.header]
            seen.add(column.header)
            is_cost = column.metric == "cost"
            assert metric == (contest.spec.cost.metric if is_cost else column.metric)
            assert (reduce, factor) == (reductions[column.reduction], column.factor)
            runs = audit_formulas.counted if is_cost or column.imputed else audit_formulas.every
            assert of is (audit_formulas.of_successes if column.successes_only else runs)
    assert seen == set(audit_formulas.MEANINGS)
