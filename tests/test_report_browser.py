"""The report in a real browser, from a file: it opens, replays, sorts, and drives."""

import json
import shutil
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from test_report import HOSTILE, hostile

from wayfield.benchmarks.report import demo, page
from wayfield.benchmarks.report.page import Content, made, rendered
from wayfield.benchmarks.report.recipes import FITTING
from wayfield.envs.robots import ROBOTS
from wayfield.envs.scenarios import TASKS, scenarios_of

CHROMIUM = shutil.which("chromium") or shutil.which("chromium-browser") or shutil.which("google-chrome")
pytestmark = pytest.mark.skipif(CHROMIUM is None, reason="chromium is missing: apt-get install chromium")
pytest.importorskip("playwright.sync_api", reason='playwright is missing: pip install "wayfield[dev]"')

from playwright.sync_api import Browser, Page, sync_playwright  # noqa: E402

CHOSEN = "(robot) => { drive.robot.value = robot; drive.robot.dispatchEvent(new Event('change')); }"


@pytest.fixture(scope="module")
def browser() -> Iterator[Browser]:
    with sync_playwright() as playwright:
        found = playwright.chromium.launch(executable_path=CHROMIUM, args=["--no-sandbox"])
        yield found
        found.close()


@pytest.fixture(scope="module")
def files(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    folder = tmp_path_factory.mktemp("pages")
    content = hostile()
    content.missing = []
    content.episodes[0] |= {"contest": "goal-obstacles", "family": "clutter_5", "tier": "easy"}
    content.episodes[0] |= {"robot": "mine", "hull": 0.123}
    files = {name: folder / f"{name}.html" for name in ("report", "demo", "bare")}
    files["report"].write_text(rendered(HOSTILE, content, made("evaluate", content), page.BUDGET), encoding="utf-8")
    bare = Content(sentences=["a won"], missing=["old-run lacks drives.npz: nothing of it can be replayed."])
    files["bare"].write_text(rendered("bare", bare, made("evaluate", bare), page.BUDGET), encoding="utf-8")
    every = demo.worlds()
    # in the last one nothing moves, so that what stands there can be dragged
    named = (next(each for each in every if each["family"] == family) for family in ("wall", "clutter_5"))
    driving = Content(worlds=[*every[::20], *named])
    first = driving.worlds[-1]
    told = {"demo": {"first": f"{first['kind']}: {first['family']}", "unable": demo.unable()}}
    files["demo"].write_text(rendered("demo", driving, made("demo", driving), demo.BUDGET, told), encoding="utf-8")
    return files


class Watched:
    """A page, and what it said and asked for."""

    def __init__(self, browser: Browser, file: Path, **options: Any) -> None:
        self.context = browser.new_context(**options)
        self.page: Page = self.context.new_page()
        self.errors: list[str] = []
        self.requests: list[str] = []
        self.page.on("console", lambda told: self.errors.append(told.text) if told.type == "error" else None)
        self.page.on("pageerror", lambda error: self.errors.append(str(error)))
        self.page.on("request", lambda request: self.requests.append(request.url))
        self.page.goto(file.as_uri())
        self.page.evaluate("ready")

    def until(self, condition: str) -> None:
        """Waits, half a minute at most, until an expression of the page holds; the page lets nobody evaluate text."""
        for _ in range(300):
            if self.page.evaluate(condition):
                return
            self.page.wait_for_timeout(100)
        raise AssertionError(f"never: {condition}")

    def __enter__(self) -> "Watched":
        return self

    def __exit__(self, *_: object) -> None:
        self.context.close()


@pytest.mark.parametrize("name", ["report", "demo", "bare"])
@pytest.mark.parametrize(("width", "scheme"), [(1280, "light"), (390, "dark")])
def test_it_opens_from_a_file_and_fits(
    browser: Browser, files: dict[str, Path], name: str, width: int, scheme: Any
) -> None:
    with Watched(browser, files[name], viewport={"width": width, "height": 800}, color_scheme=scheme) as watched:
        assert watched.errors == []
        assert [each for each in watched.requests if not each.startswith(("file:", "data:", "blob:"))] == []
        assert len([each for each in watched.requests if each.startswith("file:")]) == 1
        assert watched.page.evaluate("document.documentElement.scrollWidth") <= width
        assert watched.page.locator("#problem").is_hidden()


def test_a_name_that_is_a_script_stays_text(browser: Browser, files: dict[str, Path]) -> None:
    with Watched(browser, files["report"]) as watched:
        assert watched.page.title() == HOSTILE
        assert watched.page.locator("script").count() == 2
        assert HOSTILE in watched.page.locator("#full").inner_text()


def test_the_replay_reaches_the_end(browser: Browser, files: dict[str, Path]) -> None:
    with Watched(browser, files["report"]) as watched:
        watched.page.evaluate("replay.rate = 8")
        watched.page.get_by_role("button", name="play", exact=True).click()
        watched.until("replay.step === replay.last && !replay.playing")
        assert watched.page.evaluate("replay.last") == 59
        watched.page.locator(".board canvas").focus()
        watched.page.keyboard.press("Home")
        watched.page.keyboard.press("ArrowRight")
        assert watched.page.evaluate("replay.step") == 1
        assert watched.errors == []


def test_tables_sort(browser: Browser, files: dict[str, Path]) -> None:
    with Watched(browser, files["report"]) as watched:
        cells = watched.page.locator("#full tbody td:nth-child(2)")
        head = watched.page.locator("#full th button").nth(1)
        head.click()
        assert cells.all_inner_texts() == ["2", "10"]  # as numbers, not as text
        head.click()
        assert cells.all_inner_texts() == ["10", "2"]


@pytest.mark.parametrize(
    ("form", "begins", "holds"),
    [
        ("Markdown", f"| {HOSTILE} | n |\n|---|---|\n", "| b | 10 |"),
        ("LaTeX", "% ", "b & 10 \\\\"),
        ("CSV", '"<script>alert(1)</script>&""\'",n\n', "b,10"),
    ],
)
def test_a_table_is_copied_as_it_is_sorted(
    browser: Browser, files: dict[str, Path], form: str, begins: str, holds: str
) -> None:
    with Watched(browser, files["report"]) as watched:
        tab = watched.page
        # the clipboard is not to be read without asking: what the page would put there is
        tab.evaluate("() => { navigator.clipboard.writeText = async (text) => { window.taken = text; }; }")
        tab.locator("#full th button").nth(1).click()
        tab.locator("#full th button").nth(1).click()  # falling: 10 before 2
        tab.locator("#full").get_by_role("button", name=form, exact=True).first.click()
        watched.until("window.taken !== undefined")
        taken = tab.evaluate("window.taken")
        assert taken.startswith(begins)
        assert holds in taken
        assert taken.index("10") < taken.rindex("2")
        assert f"copied as {form}" in tab.locator("#said").inner_text()


def test_the_keyboard_moves_the_robot(browser: Browser, files: dict[str, Path]) -> None:
    with Watched(browser, files["demo"]) as watched:
        assert watched.page.evaluate("drive !== null"), "the page has no kernels"
        watched.page.evaluate("drive.who.value = KEYBOARD")
        watched.page.get_by_role("button", name="drive", exact=True).click()
        watched.page.keyboard.down("ArrowUp")
        watched.until("drive.run.actor.x.length > 30 || drive.run.actor.outcome")
        watched.page.keyboard.up("ArrowUp")
        moved = "(({x, y}) => Math.hypot(x.at(-1) - x[0], y.at(-1) - y[0]))(drive.run.actor)"
        assert watched.page.evaluate(moved) > 0.1
        assert watched.errors == []


def test_a_dragged_obstacle_changes_the_run(browser: Browser, files: dict[str, Path]) -> None:
    with Watched(browser, files["demo"], viewport={"width": 1280, "height": 900}) as watched:
        tab = watched.page
        tab.evaluate("drive.who.value = 'vfh_plus'; drive.go(); replay.toggle(false)")
        tab.evaluate("drive.advance(400, 20000); replay.seek(replay.last)")
        before = tab.evaluate("drive.run.actor.x.concat(drive.run.actor.y)")
        tab.evaluate("drive.edit(true)")
        tab.locator(".board canvas").scroll_into_view_if_needed()
        # the obstacle that is nearest to the middle of the way, onto it
        place = """() => {
          const {x, y} = drive.run.actor, m = Math.floor(x.length / 2), box = replay.canvas.getBoundingClientRect();
          const at = (px, py) => [box.left + box.width / 2 + (px - replay.view.centre[0]) * replay.view.pixels,
                                  box.top + box.height / 2 - (py - replay.view.centre[1]) * replay.view.pixels];
          const circles = replay.world.obstacles.filter((o) => o[6] > 0);
          circles.sort((a, b) => Math.hypot(a[0] - x[m], a[1] - y[m]) - Math.hypot(b[0] - x[m], b[1] - y[m]));
          return [at(circles[0][0], circles[0][1]), at(x[m], y[m])];
        }"""
        start, end = tab.evaluate(place)
        tab.mouse.move(*start)
        tab.mouse.down()
        tab.mouse.move(*end, steps=4)
        tab.mouse.up()
        tab.evaluate("drive.advance(400, 20000)")
        assert tab.evaluate("drive.run.actor.x.concat(drive.run.actor.y)") != before
        assert watched.errors == []


def test_a_scenario_is_saved_and_loaded(browser: Browser, files: dict[str, Path], tmp_path: Path) -> None:
    with Watched(browser, files["demo"]) as watched:
        with watched.page.expect_download() as download:
            watched.page.get_by_role("button", name="save scenario").click()
        file = tmp_path / "saved.json"
        download.value.save_as(file)
        assert "goal" in json.loads(file.read_text())
        watched.page.locator("input[type=file]").set_input_files(file)
        watched.until("replay.world.name === 'saved'")
        assert watched.page.evaluate("replay.world.obstacles.length") > 0


@pytest.mark.parametrize(
    ("text", "told"),
    [
        ('{"goal": [1, 2, 0], "map": "room.map"}', "it names a map, another file"),
        ('{"goal": [1, 2, 0], "dock": [1, 2, 0]}', "goal and dock"),
        ("{", "no JSON"),
        ('{"goal": [1, 2]}', "goal"),
        ('{"goal": [1, 2, 0], "gaol": 3}', "gaol"),
        ("[]", "object"),
    ],
)
def test_a_damaged_scenario_is_a_sentence(
    browser: Browser, files: dict[str, Path], tmp_path: Path, text: str, told: str
) -> None:
    with Watched(browser, files["demo"]) as watched:
        file = tmp_path / "damaged.json"
        file.write_text(text)
        watched.page.locator("input[type=file]").set_input_files(file)
        place = watched.page.get_by_role("status").filter(has_text="damaged.json")
        place.wait_for(timeout=10_000)
        assert told in place.inner_text()
        assert watched.errors == []


def test_a_damaged_scenario_that_is_dropped_is_a_sentence_and_the_world_stays(
    browser: Browser, files: dict[str, Path]
) -> None:
    with Watched(browser, files["demo"]) as watched:
        tab = watched.page
        before = tab.evaluate("JSON.stringify(replay.world)")
        drop = """(text) => {
          const files = new DataTransfer();
          files.items.add(new File([text], "damaged.json", { type: "application/json" }));
          const event = { bubbles: true, cancelable: true, dataTransfer: files };
          document.querySelector(".board canvas").dispatchEvent(new DragEvent("drop", event));
        }"""
        tab.evaluate(drop, '{"goal": [1, 2, "north"]}')
        place = tab.get_by_role("status").filter(has_text="damaged.json")
        place.wait_for(timeout=10_000)
        assert "goal[2]" in place.inner_text()
        assert tab.evaluate("JSON.stringify(replay.world)") == before
        # and a good one is taken
        tab.evaluate(drop, '{"goal": [3, 1, 0]}')
        watched.until("replay.world.name === 'damaged'")
        assert tab.evaluate("replay.world.goal[0]") == 3
        assert watched.errors == []


def test_a_run_without_trajectories_is_a_sentence_and_no_blank(browser: Browser, files: dict[str, Path]) -> None:
    with Watched(browser, files["bare"]) as watched:
        assert "nothing of it can be replayed" in watched.page.locator("#player").inner_text()
        assert watched.page.locator("#player canvas").count() == 0
        assert watched.page.locator("#summary").get_by_text("a won").is_visible()
        assert watched.errors == []


def test_every_robot_that_the_kernels_know_can_be_chosen_and_drives(browser: Browser, files: dict[str, Path]) -> None:
    with Watched(browser, files["demo"]) as watched:
        tab = watched.page
        offered = tab.evaluate("[...drive.robot.options].map((each) => each.value)")
        assert offered == list(FITTING)
        for robot in offered:
            tab.evaluate(CHOSEN, robot)
            tab.evaluate("drive.who.value = 'vfh_plus'; drive.go(); replay.toggle(false); drive.advance(40, 20000)")
            moved = "(({x, y}) => Math.hypot(x.at(-1) - x[0], y.at(-1) - y[0]))(drive.run.actor)"
            assert tab.evaluate("drive.run.actor.robot") == robot
            assert tab.evaluate(moved) > 0.05
            # it is drawn as large as it is
            assert tab.evaluate("HULLS[replay.robot]") == pytest.approx(ROBOTS[robot].hull_radius)
        assert watched.errors == []


def test_docking_is_driven_by_laws_and_by_hand_up_to_the_wall_for_every_hull(
    browser: Browser, files: dict[str, Path], tmp_path: Path
) -> None:
    with Watched(browser, files["demo"]) as watched:
        tab = watched.page
        tab.get_by_label("family").select_option("dock: wall")
        able = tab.evaluate("[...drive.who.options].map((each) => each.value)")
        assert {"polar", "smooth_pose", "smooth_pose_backward", "reeds_shepp", "apf_corrected"} <= set(able)
        assert "waypoint" not in able  # drives bases that go sideways
        assert "mpc_pose (solves its problem with OSQP)" in tab.locator(".drive").inner_text()
        for robot in ("p3dx", "turtlebot3"):
            tab.evaluate(CHOSEN, robot)
            # the back of the hull stands as far from the wall as the family says, whatever the robot
            gap = "clearanceAt(replay.world, 0, replay.world.goal[0], replay.world.goal[1], HULLS[replay.robot])"
            assert tab.evaluate(gap) == pytest.approx(0.05, abs=2e-6)
            tab.evaluate(
                "drive.who.value = 'reeds_shepp'; drive.go(); replay.toggle(false); drive.advance(1300, 20000)"
            )
            assert tab.evaluate("drive.run.actor.outcome") == "success"
        tab.evaluate(CHOSEN, "omni3")
        assert "waypoint" in tab.evaluate("[...drive.who.options].map((each) => each.value)")
        tab.evaluate("drive.who.value = KEYBOARD")
        tab.get_by_role("button", name="drive", exact=True).click()
        tab.keyboard.down("ArrowUp")
        watched.until("drive.run.actor.x.length > 30 || drive.run.actor.outcome")
        tab.keyboard.up("ArrowUp")
        assert tab.evaluate("(({x, y}) => Math.hypot(x.at(-1) - x[0], y.at(-1) - y[0]))(drive.run.actor)") > 0.05
        with tab.expect_download() as download:
            tab.get_by_role("button", name="save scenario").click()
        file = tmp_path / "mine.json"
        download.value.save_as(file)
        saved = json.loads(file.read_text())
        assert "goal" not in saved
        assert saved["position_tolerance"] == 0.05
        (scenario,) = scenarios_of(TASKS["docking"], str(file), ROBOTS["omni3"].hull_radius)
        assert list(scenario.goal) == tab.evaluate("replay.world.goal")
        tab.locator("input[type=file]").set_input_files(file)
        watched.until("replay.world.name === 'mine' && replay.world.kind === 'dock'")
        assert watched.errors == []


def test_a_robot_of_ones_own_is_drawn_with_its_hull(browser: Browser, files: dict[str, Path]) -> None:
    with Watched(browser, files["report"]) as watched:
        assert watched.page.evaluate("[replay.robot, HULLS[replay.robot]]") == ["mine", 0.123]
        # a rectangle, and the disc around it
        assert watched.page.evaluate("(tellHull('box', [0.6, 0.8]), [HULLS.box, BOXES.box])") == [0.5, [0.6, 0.8]]


def test_a_browser_without_webassembly_is_told(browser: Browser, files: dict[str, Path]) -> None:
    context = browser.new_context()
    context.add_init_script("delete globalThis.WebAssembly")
    tab = context.new_page()
    tab.goto(files["demo"].as_uri())
    tab.evaluate("ready")
    assert "no WebAssembly" in tab.locator("#player").inner_text()
    context.close()
