"""The documentation as a site: complete, small, of today, and without a warning."""

import re
import subprocess
import sys
from pathlib import Path

import pictures
import pytest
from PIL import Image

from wayfield.envs.tasks.specs import EVERY
from wayfield.policies import POLICIES

pytest.importorskip("myst_parser", reason='sphinx is missing: pip install "wayfield[docs]"')
DOCS = Path(__file__).parents[2] / "docs"
sys.path.insert(0, str(DOCS))

import docstrings  # noqa: E402
import registry_pages  # noqa: E402

IDS = [env_id for spec in EVERY.values() for env_id in spec.ids.values()]


@pytest.fixture(scope="module")
def pages() -> dict[str, str]:
    return dict(registry_pages.pages(DOCS))


def test_every_environment_has_its_page_with_its_whole_sheet(pages: dict[str, str]) -> None:
    for env_id in IDS:
        page = pages[f"environments/{pictures.stem_of(env_id)}.md"]
        assert f'gymnasium.make("{env_id}")' in page
        for part in ("Action space", "Observation space", "Rewards", "Episode end", "Arguments", "Version history"):
            assert f"\n## {part}\n" in page, f"{env_id}: {part}"
        for kind in ("png", "gif"):
            assert (DOCS / "pictures" / f"{pictures.stem_of(env_id)}.{kind}").is_file()


def test_every_policy_has_its_page_with_its_law_and_gains(pages: dict[str, str]) -> None:
    for name in POLICIES:
        page = pages[f"policies/{name}.md"]
        assert "\n## The law\n" in page
        for gain, *_, meaning in registry_pages.gain_rows(name):
            assert meaning, f"{name}: {gain} has no meaning"


def test_every_page_is_in_the_contents(pages: dict[str, str]) -> None:
    index = (DOCS / "index.md").read_text(encoding="utf-8")
    for page in [*DOCS.glob("*.md"), *DOCS.glob("tutorials/*.md")]:
        name = str(page.relative_to(DOCS).with_suffix(""))
        assert name == "index" or f"\n{name}\n" in index, name
    assert {"environments.md", "policies.md", "api.md"} <= set(pages)


@pytest.mark.parametrize(
    "spec",
    # of teams with 100 robots a picture takes a while
    [pytest.param(each, marks=[pytest.mark.slow] if name == "teams" else []) for name, each in EVERY.items()],
    ids=list(EVERY),
)
def test_every_family_is_in_a_picture_of_today(spec: pictures.TaskSpec) -> None:
    with Image.open(DOCS / "pictures" / pictures.sheet_name(spec)) as sheet:
        told = sheet.info[pictures.DIGEST]
    assert told == pictures.digest(spec), "run python benchmarks/studies/pictures.py"


def test_pictures_are_small_and_nothing_else_is_there() -> None:
    there = {file.name: file.stat().st_size for file in (DOCS / "pictures").iterdir()}
    assert sum(there.values()) <= pictures.BUDGET
    made = {pictures.sheet_name(spec) for spec in EVERY.values()}
    made |= {f"{pictures.stem_of(env_id)}.{kind}" for env_id in IDS for kind in ("png", "gif")}
    made |= {f"policy_{name}.gif" for name in pictures.POLICY_FILMS}
    made |= {f"hull_{name}.png" for name in pictures.HULL_FILMS}
    assert set(there) == made
    assert set(pictures.FILMS) == set(IDS)


@pytest.mark.parametrize(
    ("told", "read"),
    [
        (["Returns `x` * 2 of **kwargs and a_."], [r"Returns ``x`` \* 2 of \*\*kwargs and a\_."]),
        (["The law:", "", "    w = 2 * y", "", "with y."], ["The law:", "", "::", "", "    w = 2 * y", "", "with y."]),
        (["Args:", "    x: of `y`.", "        more"], [":param x: of ``y``.", "    more"]),
        (["Raises:", "    ValueError: if `x`."], [":raises ValueError: if ``x``."]),
        (["* a", "* b*c"], ["* a", r"* b\*c"]),
    ],
)
def test_a_docstring_is_read_as_it_is_meant(told: list[str], read: list[str]) -> None:
    assert docstrings.restructured(told) == read


def test_what_the_site_makes_is_not_kept_in_the_repository() -> None:
    told = subprocess.run(["git", "ls-files", "docs"], cwd=DOCS.parent, capture_output=True, text=True, check=False)
    if told.returncode != 0:
        pytest.skip("no git repository")
    assert [name for name in told.stdout.split() if "generated/" in name or name.endswith("searchindex.js")] == []


@pytest.mark.slow
def test_it_is_built_without_a_warning(tmp_path: Path) -> None:
    command = [sys.executable, "-m", "sphinx", "-W", "--keep-going", "--quiet", str(DOCS), str(tmp_path)]
    built = subprocess.run(command, capture_output=True, text=True, check=False)
    assert built.returncode == 0, built.stderr
    assert (tmp_path / "demo.html").is_file()
    loads = re.compile(r'<(?:script|img|iframe|link)\b[^>]*(?:src|href)="https?:[^"]*"')
    for page in tmp_path.rglob("*.html"):
        text = page.read_text(encoding="utf-8")
        assert loads.findall(text) == [], page.name  # from the network
        assert "{width" not in text, page.name  # an attribute that was not read
    for name in POLICIES:
        assert (tmp_path / f"generated/policies/{name}.html").is_file()
