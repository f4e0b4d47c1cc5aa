"""How tables are laid out, and the documents' tables of ours beside the published, stated once more."""

import csv
import io
import math
import re
import statistics
from collections.abc import Sequence
from typing import Any

import numpy as np
import pytest
import rich.console
from scipy.stats import beta

from wayfield.benchmarks import document_tables, terminal
from wayfield.benchmarks.cases import Case
from wayfield.benchmarks.columns import Rows, text
from wayfield.benchmarks.document_tables import deviation, ranked, reproduced
from wayfield.benchmarks.results import number
from wayfield.benchmarks.table import Table
from wayfield.benchmarks.terminal import print_short

NAN = math.nan
SMALL = Table(
    "Who wins",
    ["policy", "gains", "success (%)", "speed (m/s)"],
    [["a|b", "default", "97.1 [90.0, 99.9]", "0.60"], ["a|b", "tuned", "3.0 / 4.0", "0.61"], ["c", "", "", "1.00"]],
    "A note of a table, " + "which goes on and on, " * 12,
)


def shown(table: Any, width: int) -> list[str]:
    stream = io.StringIO()
    rich.console.Console(file=stream, width=width).print(table)
    return stream.getvalue().splitlines()


def test_a_table_in_markdown_latex_and_csv() -> None:
    title, _, header, rule, *lines, _, note = SMALL.markdown().splitlines()
    assert (title, note) == ("## Who wins", SMALL.note)
    found = [[cell.strip() for cell in re.split(r"(?<!\\)\|", line)[1:-1]] for line in (header, *lines)]
    assert found == [SMALL.header, *([cell.replace("|", "\\|") for cell in row] for row in SMALL.rows)]
    assert set(rule) == set("|-")
    assert list(csv.reader(io.StringIO(SMALL.csv()))) == [SMALL.header, *SMALL.rows]
    assert SMALL.csv().endswith("1.00\n")
    first, *inside = SMALL.latex().splitlines()
    assert first == "% Who wins"
    told = [line for line in inside if line.startswith("% ")]
    assert " ".join(line[2:] for line in told).split() == SMALL.note.split()
    assert 90 < max(map(len, told)) <= 112
    cells = [line.rstrip("\\ ").split("&") for line in inside if "&" in line]
    assert [[cell.strip().replace("\\", "") for cell in row] for row in cells] == [SMALL.header, *SMALL.rows]


def words(table: Any, width: int) -> list[list[str]]:
    return [line.split() for line in shown(table, width)]


def test_a_table_on_a_terminal() -> None:
    wide = words(SMALL.terminal(), 100)
    # a unit stands under its name, and a rule between the first two, which are of one policy, and the third
    assert wide[:4] == [["Who", "wins"], [], ["success", "speed"], ["policy", "gains", "(%)", "(m/s)"]]
    assert wide[5:] == [
        *(["a|b", "default", "97.1", "[90.0,", "99.9]", "0.60"], ["a|b", "tuned", "3.0", "/", "4.0", "0.61"]),
        *([], ["c", "1.00"], []),
    ]
    assert words(SMALL.terminal(2), 100)[2] == ["policy", "gains"]
    stacked = words(SMALL.terminal(stacked=True), 100)
    assert stacked[2:4] == [["policy", "success", "speed"], ["gains", "(%)", "(m/s)"]]
    assert stacked[5:] == [
        *(["a|b", "97.1", "0.60"], ["default", "[90.0,", "99.9]"], ["a|b", "3.0", "/", "0.61"], ["tuned", "4.0"]),
        *([], ["c", "1.00"], [], []),
    ]
    assert len(shown(SMALL.terminal(stacked=True), 100)[0]) < len(shown(SMALL.terminal(), 100)[0])
    other = Table("t", ["who", "gains"], [["x", "default"]], "")  # no gains of a policy
    assert words(other.terminal(stacked=True), 60)[4] == ["x", "default"]
    long = Table("t", ["policy"], [["one two three four-five six seven"]], "")
    assert [line.rstrip()[1:] for line in shown(long.terminal(cell_width=12), 60)[4:-1]] == [
        *("one two", "  three", "  four-five", "  six seven"),
    ]
    assert [line.strip() for line in shown(long.terminal(), 60)[4:-1]] == ["one two three four-five", "six seven"]


@pytest.mark.parametrize("width", [200, 100, 52])
def test_the_short_print_keeps_to_the_width(
    width: int, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(terminal.shutil, "get_terminal_size", lambda fallback: type("Size", (), {"columns": width}))
    rows = [[f"policy {k} with a rather long name", f"{k}.0 [1.0, 2.0]", "0.60"] for k in range(8)]
    table = Table("t", ["policy", "imputed time (s)", "speed (m/s)"], rows, "")
    sentence = "word " * 40 + "end."
    print_short([(sentence, table), ("Short.", Table("u", ["a"], [["b"]] * 6, ""))])
    first, second, rest = capsys.readouterr().out.split("\n\n")
    assert rest == ""
    lines = first.splitlines()
    told = [line for line in lines if line.startswith("word") or line.endswith("end.")]
    assert " ".join(told).split() == sentence.split()
    assert max(map(len, lines)) <= min(width, 100)
    assert max(map(len, told)) > min(width, 100) - 6
    assert lines[-1] == "2 more in table.md"
    whole = "  ".join(["policy 5 with a rather long name", "5.0 [1.0, 2.0]", "0.60"])
    squeezed = [" ".join(line.split()) for line in lines]
    if width >= 100:
        assert " ".join(whole.split()) in squeezed
        assert "policy imputed time (s) m/s" in squeezed
    else:  # intervals, units and names go on below
        assert "policy 5 with a rather long 5.0 0.60" in squeezed
        assert "name [1.0, 2.0]" in squeezed
        assert "policy imputed time m/s" in squeezed
        assert "(s)" in squeezed
    assert not any(line.startswith("policy 6") for line in lines)
    assert second.splitlines()[0] == "Short."
    assert "more in" not in second


def episode(policy: str, dynamics: str = "kinematic", won: str = "1", **metrics: Any) -> dict[str, str]:
    row = {
        "document": "A", "experiment": "course", "policy": policy, "gains": "k=2", "dynamics": dynamics,
        "actuators": "ideal", "success": won, "collision": "0", "left_corridor": str(1 - int(won)), "timeout": "0",
    }  # fmt: skip
    for column in document_tables._COLUMNS["A"]:
        row |= dict.fromkeys(column.metrics, "")
    return row | {name: repr(each) if isinstance(each, float) else each for name, each in metrics.items()}


def case(policy: str, **published: Any) -> Case:
    return Case("A", "course", "wayfield/DiffDrivePathFollowing-v0", "x", policy, {"k": 2}, published=published)


def off(ours: Sequence[float], figure: Any) -> float:
    """Returns how far the mean lies outside of a published figure or range, by the end that is nearest."""
    if not ours:
        return math.inf
    low, high = figure if isinstance(figure, tuple) else (figure, figure)
    mean = statistics.fmean(ours)
    return (low - mean) / abs(low) if mean < low else (mean - high) / abs(high) if mean > high else 0.0


def test_a_published_figure_is_met_within_its_range() -> None:
    rng = np.random.default_rng(3)
    for _ in range(200):
        ours = [float(each) for each in rng.normal(0.0, 2.0, rng.integers(1, 4))]
        low, high = sorted(rng.normal(0.0, 1.5, 2).tolist())
        figure = (low, high) if rng.random() < 0.5 else low
        rows = [{"x": repr(each), "y": "" if rng.random() < 0.1 else "2.0"} for each in ours] + [{"x": "", "y": "2.0"}]
        assert deviation(rows, {"x": figure}) == pytest.approx(off(ours, figure))
        assert deviation(rows, {"x": figure, "y": 1.0}) == pytest.approx(max(off(ours, figure), 1.0))
    assert deviation([{"x": ""}], {"x": 1.0}) == math.inf
    assert deviation([{"x": "1"}], {}) == 0.0


def test_a_documents_table_holds_ours_and_the_published() -> None:
    rows = [
        episode("p", cross_track_rms=0.1234, time=30.006, steady_offset=-0.00001, reference_jumps=2.0),
        episode("p", cross_track_rms=0.1434, time=31.0, steady_offset=-0.00003, reference_jumps=3.0),
        episode("p", won="0", cross_track_rms=0.2, time=NAN, steady_offset=0.00001, reference_jumps=3.0),
        episode("q", "pymunk", "0", cross_track_rms=0.5, time=12.0),
        episode("r", cross_track_rms=0.5, time=12.0),
    ]
    rows = [{name: "" if cell == "nan" else cell for name, cell in row.items()} for row in rows]
    cases = [case("p", cross_track_rms=(0.15, 0.16), mean_speed=0.4), case("q", cross_track_rms=0.1)]
    (table,) = document_tables.document_tables(rows, cases)
    assert table.header == [
        *("experiment", "policy", "plant", "outcome", "RMS error (m)", "steady offset (m)", "mean speed (m/s)"),
        *("time (s)", "jumps", "off by"),
    ]
    errors, times = [0.1234, 0.1434, 0.2], [30.006, 31.0]
    low, high = beta.ppf(0.025, 2, 2), beta.ppf(0.975, 3, 1)
    assert table.rows == [
        [
            *("course", "p k=2", "kinematic", f"2/3 [{low:.2f}, {high:.2f}]"),
            f"{statistics.fmean(errors):.3f} ± {statistics.stdev(errors):.3f} / 0.150 to 0.160",
            "0.0000 ± 0.0000", "never / 0.40",
            f"{statistics.fmean(times):.2f} ± {statistics.stdev(times):.2f} (2 of 3)", "3 ± 1", "never",
        ],
        ["course", "q k=2", "pymunk", "left corridor", "0.500 / 0.100", "", "", "12.00", "", "> 100 %"],
        ["course", "r k=2", "kinematic", "success", "0.500", "", "", "12.00", "", ""],
    ]  # fmt: skip
    assert table.note.startswith("Cells read ours / published")
    (plain,) = document_tables.document_tables([row | {"actuators": "lagged"} for row in rows[:1]], [])
    assert plain.rows[0][2] == "kinematic, lagged"
    assert not plain.note.startswith("Cells read")
    # a column that nothing fills is left out, the first of the metrics too; what says which run it is stays
    (bare,) = document_tables.document_tables([episode("p", time=12.0)], [])
    assert bare.header == ["experiment", "policy", "plant", "outcome", "time (s)"]
    (bare,) = document_tables.document_tables([episode("p")], [])
    assert bare.header == ["experiment", "policy", "plant", "outcome"]
    sentence, small = reproduced([*rows[:1], *rows[3:]], cases)
    apart = sorted([off([0.1234], (0.15, 0.16)), math.inf, off([0.5], 0.1)])
    close = sum(each <= 0.05 for each in apart)
    assert small.rows == [[small.rows[0][0], f"{close} of 3", f"{100.0 * apart[1]:.1f} %", "1"]]
    assert sentence == f"The documents: {close} of 3 published figures are met within 5 %."
    near = episode("p", cross_track_rms=0.157, mean_speed=0.4)
    sentence, small = reproduced([near], [case("p", cross_track_rms=0.15)])
    assert (sentence.split()[2:5], small.rows[0][1:]) == (["1", "of", "1"], ["1 of 1", "4.7 %", "0"])
    assert "for none of which" in reproduced(rows[:2], [])[0]


def test_who_does_best_in_a_scenario_of_ones_own() -> None:
    rows = [
        episode("late", cross_track_rms=0.3, mean_speed=0.5, time=9.0),
        episode("lost", won="0", cross_track_rms=0.01, mean_speed=0.6, time=5.0),
        episode("first", cross_track_rms=0.1234, mean_speed=0.55, time=30.0),
        episode("gone", won="0", mean_speed=0.1),
    ]
    rows = [row | {"experiment": "my bend"} for row in rows]
    sentence, table = ranked(rows)
    assert table.rows == [
        ["first", "kinematic", "success", "0.1234", "0.55"],
        ["late", "kinematic", "success", "0.3000", "0.50"],
        ["lost", "kinematic", "left corridor", "0.0100", "0.60"],
        ["gone", "kinematic", "left corridor", "inf", "0.10"],
    ]
    assert sentence.startswith("my bend: 4 policies, one scenario. first does best: RMS error 0.1234 m; one run each")
    goals = [
        row | {"cross_track_rms": "", "time": each} for row, each in zip(rows, ("9.0", "5.0", "30.0", ""), strict=True)
    ]
    both = [row | {"dynamics": plant} for row in goals for plant in ("kinematic", "pymunk")]
    sentence, table = ranked(both)
    assert sentence.startswith("my bend: 4 policies, one scenario. late does best: time 9.00 s;")
    assert [row[0] for row in table.rows[::2]] == ["late", "first", "lost", "gone"]
    assert "No policy succeeds" in ranked([rows[1], rows[3]])[0]


@pytest.mark.parametrize(
    ("value", "cell"),
    [(0.0, "0"), (3.0, "3"), (-2.0, "-2"), (1e15, "1000000000000000.0"), (999999999999999.0, "999999999999999"),
     (0.1, "0.1"), (NAN, ""), (1e-7, "1e-07"), (np.float64(0.25), "0.25")],
)  # fmt: skip
def test_a_number_as_a_cell_reads_back_as_itself(value: float, cell: str) -> None:
    assert text(value) == cell
    assert number({"x": cell}, "x") == pytest.approx(value, rel=0.0, abs=0.0, nan_ok=True)


def test_rows_are_a_sequence_of_mappings() -> None:
    given = [{"a": "1", "b": "x"}, {"b": "y", "c": ""}, {"a": "2.5"}]
    rows = Rows(given)
    whole = [{"a": "1", "b": "x", "c": ""}, {"a": "", "b": "y", "c": ""}, {"a": "2.5", "b": "", "c": ""}]
    assert (rows.names, len(rows)) == (["a", "b", "c"], 3)
    assert rows == whole == [dict(row) for row in rows]
    assert rows != whole[:2]
    assert rows != [*whole[:2], whole[0]]
    assert rows != "abc"
    assert rows != 3
    assert [dict(row) for row in rows[1:]] == whole[1:]
    assert (dict(rows[-1]), rows[0] | {"a": "7"}) == (whole[2], {**whole[0], "a": "7"})
    assert (len(rows[0]), repr(rows[0])) == (3, repr(whole[0]))
    assert [number(row, "a") for row in rows] == pytest.approx([1.0, NAN, 2.5], nan_ok=True)
    assert math.isnan(number(rows[0], "nowhere"))
    with pytest.raises(IndexError):
        rows[3]
    with pytest.raises(ValueError, match="column 'b' holds 'x'"):
        number(rows[0], "b")
