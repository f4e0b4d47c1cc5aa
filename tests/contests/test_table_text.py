"""Tables as text, cells as numbers, and figures of a source beside ours."""

import csv
import io
import re

import numpy as np

from wayfield.benchmarks.entrants.documents import documents
from wayfield.benchmarks.leaderboards.document_tables import reproduced
from wayfield.benchmarks.records.episode import Episodes
from wayfield.benchmarks.records.table import Table

SMALL = Table(
    "Who wins",
    ["policy", "gains", "success (%)", "speed (m/s)"],
    [["a|b", "default", "97.1 [90.0, 99.9]", "0.60"], ["a|b", "tuned", "3.0 / 4.0", "0.61"], ["c", "", "", "1.00"]],
    "A note of a table, " + "which goes on and on, " * 12,
)


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


def test_what_a_document_prints_is_counted_apart_from_solutions_of_its_equations() -> None:
    (printed,) = [case for case in documents() if case.source == "Table 1"]
    solved = next(case for case in documents() if case.scenario == "apf_1" and "final_x" in case.reference)
    place = {"contest": "C", "family": "scenario 1", "policy": "apf_documented", "actuators": "ideal"}
    rows = []
    for plant, off in (("kinematic", 1.0), ("pymunk", 2.0)):
        for case in (printed, solved):
            figures = case.published or case.reference
            ours = {metric: repr(off * float(np.mean(figure))) for metric, figure in figures.items()}
            rows.append(place | {"gains": case.gains_text, "dynamics": plant} | ours)
    names = {name for row in rows for name in row}
    sentence, small = reproduced(Episodes([dict.fromkeys(names, "") | row for row in rows]), documents())
    told = [line[:3] + line[4:] for line in small.rows]
    assert told == [["C", "kinematic", "2 of 2", "3 of 3"], ["C", "pymunk", "0 of 2", "0 of 3"]]
    assert "2 of 2 reference solutions" in sentence
    assert "0 of 3 average values printed in C" in sentence
    assert sentence.count("C = ") == 1
