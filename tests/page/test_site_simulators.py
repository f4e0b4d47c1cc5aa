"""The site's simulators: every page with one loads without an error, and asks for nothing but its own files."""

import shutil
import sys
from pathlib import Path
from urllib.parse import unquote, urlparse

import pytest
from pictures import stem_of

from wayfield.benchmarks.report.worlds import IN_PAGE
from wayfield.policies import POLICIES

DOCS = Path(__file__).resolve().parents[2] / "docs"
CHROMIUM = shutil.which("chromium") or shutil.which("chromium-browser") or shutil.which("google-chrome")
pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(CHROMIUM is None, reason="chromium is missing: apt-get install chromium"),
]
pytest.importorskip("playwright.sync_api", reason='playwright is missing: pip install -e ".[dev]"')
pytest.importorskip("sphinx", reason='sphinx is missing: pip install ".[docs]"')

from playwright.sync_api import sync_playwright  # noqa: E402
from sphinx.application import Sphinx  # noqa: E402


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("site")
    path, modules = list(sys.path), set(sys.modules)
    Sphinx(str(DOCS), str(DOCS), str(out), str(out / ".doctrees"), "html", status=None, warningiserror=True).build()
    sys.path[:] = path
    for name in set(sys.modules) - modules:
        if name in ("simulators", "equations"):
            del sys.modules[name]
    return out


def test_every_page_with_a_simulator_loads_and_asks_for_its_own_files_alone(site: Path) -> None:
    shown = [page for page in sorted(site.rglob("*.html")) if 'iframe class="simulator"' in page.read_text()]
    names = {page.stem for page in shown}
    assert {
        "gallery",
        "pursuit",
        "teams",
        *(stem_of(env_id) for spec in IN_PAGE.values() for env_id in spec.ids.values()),
    } <= names
    assert len(names & set(POLICIES)) >= 18
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=CHROMIUM, args=["--no-sandbox"])
        for page in shown:
            tab = browser.new_page(viewport={"width": 1280, "height": 900})
            said: list[str] = []
            asked: list[str] = []
            tab.on("console", lambda told, said=said: said.append(told.text) if told.type == "error" else None)
            tab.on("pageerror", lambda error, said=said: said.append(str(error)))
            tab.on("request", lambda request, asked=asked: asked.append(request.url))
            tab.goto(page.as_uri())
            for frame in tab.locator("iframe.simulator").all():
                frame.scroll_into_view_if_needed()
                handle = frame.element_handle()
                inner = handle.content_frame()
                assert inner is not None
                inner.wait_for_load_state()
                inner.evaluate("ready")
                assert inner.locator("#problem").is_hidden(), f"{page}: {inner.locator('#problem').inner_text()}"
                assert inner.evaluate("drive.runs.length > 0 && document.body.dataset.embed !== undefined")
                assert inner.evaluate("document.documentElement.scrollWidth <= innerWidth")
            own = [urlparse(each) for each in asked if not each.startswith(("data:", "blob:"))]
            assert all(each.scheme == "file" and Path(unquote(each.path)).is_relative_to(site) for each in own), asked
            assert said == [], page
            tab.close()
        browser.close()
