"""Published episodes come out the same when they are driven again, and a section says so, or that it is stale."""

import json
import shutil
from pathlib import Path

import pytest
import results_page
from click.testing import CliRunner
from packed_rows import SUFFIX, packed, read_packed
from reproduction import check, main
from sections import RESULTS, ROWS

from wayfield.benchmarks.commands.submit import verify

ROOT = Path(__file__).parents[2]
PUBLISHED = results_page.Store(ROOT).sections()


def packed_rows(rows: list[dict[str, str]]) -> bytes:
    return packed({name: [row[name] for row in rows] for name in rows[0]})


@pytest.mark.parametrize("section", [section for section, _ in PUBLISHED], ids=lambda section: section.name)
@pytest.mark.slow
def test_a_section_says_how_its_sample_comes_out(section: results_page.Section) -> None:
    made = {kept.name: each for kept, each in PUBLISHED}[section.name]
    found = check(section, results_page.Store(ROOT))
    words = "python benchmarks/studies/reproduction.py --write"
    assert (found.sampled, found.same) == (made.sampled, made.same), "\n".join([words, *found.other])


@pytest.mark.parametrize(
    "name", sorted(file.parent.name for file in (ROOT / results_page.LEADERBOARD).glob("*/card.json"))
)
def test_an_accepted_entry_drives_as_it_says(name: str) -> None:
    done = CliRunner().invoke(verify, [str(ROOT / results_page.LEADERBOARD / name), "--sample", "1"])
    assert done.exit_code == 0, done.output
    assert ": 1 of " in done.output


QUICK = ("path-following", "goal-obstacles", "docking")


@pytest.mark.parametrize("name", QUICK)
def test_the_first_entries_of_a_section_that_is_not_stale_come_out_the_same(name: str) -> None:
    ((section, made),) = [each for each in PUBLISHED if each[0].name == name]
    assert made.sampled
    found = check(section, results_page.Store(ROOT), most=3)
    told = f"stale: python benchmarks/studies/reproduction.py --only {name} --write"
    assert made.stale or not found.other, "\n".join([told, *found.other])


@pytest.fixture
def repository(tmp_path: Path) -> Path:
    """Returns a repository with the published rows of one law alone, and what made them unchecked."""
    home = tmp_path / "repository"
    (home / ROWS).mkdir(parents=True)
    shutil.copy(ROOT / "README.md", home)
    rows = [row for row in read_packed(ROOT / f"{ROWS}/path-following{SUFFIX}") if row["policy"] == "pure_pursuit"]
    (home / f"{ROWS}/path-following{SUFFIX}").write_bytes(packed_rows(rows))
    made = json.loads((ROOT / f"{RESULTS}/path-following.json").read_text(encoding="utf-8"))
    unchecked = made | {"sampled": 0, "same": 0, "checked": ""}
    (home / f"{RESULTS}/path-following.json").write_text(json.dumps(unchecked), encoding="utf-8")
    return home


def run(home: Path, *words: str) -> tuple[int, str]:
    done = CliRunner().invoke(main, ["--root", str(home), *words])
    return done.exit_code, done.output


def pages(repository: Path) -> str:
    """Returns the text of all pages of results."""
    files = [repository / results_page.PAGE, *sorted((repository / "docs/results").glob("*.md"))]
    return "\n".join(file.read_text(encoding="utf-8") for file in files)


def test_a_section_is_stale_once_a_row_is_not_what_is_driven(repository: Path) -> None:
    status, said = run(repository)
    assert status == 1
    assert "path-following: the page says otherwise; give --write" in said
    assert run(repository, "--write")[0] == 0
    shown = pages(repository)
    assert "samples reproduced." in shown
    assert "Stale" not in shown
    assert run(repository)[0] == 0
    file = repository / f"{ROWS}/path-following{SUFFIX}"
    rows = [row | {"mean_speed": "0.123456"} for row in read_packed(file)]
    file.write_bytes(packed_rows(rows))
    status, said = run(repository)
    assert status == 1
    assert "mean_speed is " in said
    assert "was '0.123456'" in said
    assert run(repository, "--write")[0] == 0
    assert "**Stale: on 20" in pages(repository)
