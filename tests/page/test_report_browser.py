"""The report in a real browser, from a file: it opens, replays, sorts, and drives."""

import itertools
import json
import math
import shutil
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import page_demo
import pytest
from oracles.hostile_page import HOSTILE, hostile
from page_recipes import FITTING
from PIL import Image

from wayfield.benchmarks.report import page
from wayfield.benchmarks.report.page import Content, made, rendered
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
    every = page_demo.worlds()
    # in the last one nothing moves, so that what stands there can be dragged
    named = (next(each for each in every if each["family"] == family) for family in ("wall", "clutter_5"))
    driving = Content(worlds=[*every[::20], *named])
    first = driving.worlds[-1]
    told = {"demo": {"first": f"{first['kind']}: {first['family']}", "unable": page_demo.unable()}}
    files["demo"].write_text(rendered("demo", driving, made("demo", driving), page_demo.BUDGET, told), encoding="utf-8")
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
        watched.page.get_by_role("button", name="Tables").click()
        assert HOSTILE in watched.page.locator("#full").inner_text()


def test_the_replay_reaches_the_end(browser: Browser, files: dict[str, Path]) -> None:
    with Watched(browser, files["report"]) as watched:
        watched.page.evaluate("replay.rate = 8")
        watched.page.get_by_role("button", name="play", exact=True).click()
        watched.until("replay.step === replay.last && !replay.playing")
        assert watched.page.evaluate("replay.last") == 59
        watched.page.locator(".board canvas >> nth=0").focus()
        watched.page.keyboard.press("Home")
        watched.page.keyboard.press("ArrowRight")
        assert watched.page.evaluate("replay.step") == 1
        assert watched.errors == []


def test_tables_sort(browser: Browser, files: dict[str, Path]) -> None:
    with Watched(browser, files["report"]) as watched:
        watched.page.get_by_role("button", name="Tables").click()
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
        tab.get_by_role("button", name="Tables").click()
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


DRIVEN = "drive.runs.every((run) => !run.pending)"
POSES = (
    "drive.runs.map((run) => [run.asked.label, [run.actor.x, run.actor.y, run.actor.heading].map((each) => [...each])])"
)
MOVED = "(({x, y}) => Math.hypot(x.at(-1) - x[0], y.at(-1) - y[0]))(drive.runs.at(-1).actor)"


def test_the_first_key_starts_the_clock_and_the_rival(browser: Browser, files: dict[str, Path]) -> None:
    with Watched(browser, files["demo"]) as watched:
        tab = watched.page
        assert tab.evaluate("drive !== null"), "the page has no kernels"
        tab.evaluate("drive.clear()")
        tab.get_by_role("button", name="drive yourself").click()
        watched.until(DRIVEN)
        assert tab.evaluate("[replay.step, replay.playing]") == [0, False]
        tab.keyboard.down("ArrowUp")
        watched.until("drive.hand.actor.x.length > 30 || drive.hand.actor.outcome")
        tab.keyboard.up("ArrowUp")
        assert tab.evaluate(MOVED) > 0.1
        rival = tab.evaluate("drive.runs[0].asked.label")
        assert rival.startswith(("ppo", "agent"))
        assert tab.evaluate("drive.runs[0].actor.x.length > replay.step && replay.step > 0")
        assert watched.errors == []


@pytest.mark.parametrize(("robot", "keys"), [("p3dx", 4), ("omni3", 6)])
def test_the_pad_has_every_degree_of_freedom(browser: Browser, files: dict[str, Path], robot: str, keys: int) -> None:
    with Watched(browser, files["demo"], viewport={"width": 390, "height": 844}, has_touch=True) as watched:
        tab = watched.page
        tab.evaluate(CHOSEN, robot)
        tab.get_by_role("button", name="drive yourself").click()
        pad = tab.get_by_role("group", name="drive by hand").get_by_role("button")
        assert pad.count() == keys
        twists = set()
        for k in range(keys):
            pad.nth(k).dispatch_event("pointerdown")
            before = tab.evaluate("drive.hand.tape.length")
            watched.until(f"drive.hand.actor.outcome || drive.hand.tape.length > {before + 1}")
            twists.add(str(tab.evaluate("drive.twistByHand(drive.hand.simulator)")))
            pad.nth(k).dispatch_event("pointerup")
        assert len(twists) == keys  # ahead and back, left and right turns, and sideways where the base can
        assert watched.errors == []


@pytest.mark.parametrize(("width", "height"), [(1280, 800), (1440, 900), (390, 844)])
def test_robot_pad_policy_and_play_are_in_one_view(
    browser: Browser, files: dict[str, Path], width: int, height: int
) -> None:
    with Watched(browser, files["demo"], viewport={"width": width, "height": height}) as watched:
        tab = watched.page
        tab.get_by_role("button", name="drive yourself").click()
        for part in (".board canvas", ".pad", ".quick select", ".quick .go", ".bar button >> nth=0", ".bar input"):
            box = tab.locator(part).first.bounding_box()
            assert box is not None
            assert box["y"] >= 0
            assert box["y"] + box["height"] <= height, part
            assert box["x"] + box["width"] <= width, part
        assert tab.evaluate("window.scrollY") == 0


def test_nothing_plays_by_itself_under_reduced_motion_and_focus_stays(browser: Browser, files: dict[str, Path]) -> None:
    with Watched(browser, files["demo"], reduced_motion="reduce") as watched:
        tab = watched.page
        watched.until(DRIVEN)
        assert tab.evaluate("[replay.playing, replay.step, document.activeElement === document.body]") == [
            False,
            0,
            True,
        ]
        tab.get_by_role("button", name="play", exact=True).click()
        watched.until("replay.step > 3")


def drag(tab: Page, points: list[list[float]]) -> None:
    """Drags the mouse along points of the scene (m)."""
    place = """([x, y]) => {
      const box = replay.canvas.getBoundingClientRect();
      return [box.left + box.width / 2 + (x - replay.view.centre[0]) * replay.view.pixels,
              box.top + box.height / 2 - (y - replay.view.centre[1]) * replay.view.pixels];
    }"""
    first, *others = (tab.evaluate(place, point) for point in points)
    tab.mouse.move(*first)
    tab.mouse.down()
    for point in others:
        tab.mouse.move(*point, steps=2)
    tab.mouse.up()


def test_all_that_the_page_drives_is_driven_again_when_the_scene_changes(
    browser: Browser, files: dict[str, Path]
) -> None:
    with Watched(browser, files["demo"], viewport={"width": 1280, "height": 900}) as watched:
        tab = watched.page
        tab.evaluate("drive.clear(); for (const label of ['vfh_plus', 'apf_corrected']) drive.add({ label })")
        tab.evaluate("drive.pump(20000)")
        before = tab.evaluate(POSES)
        tab.evaluate("drive.editor.take('move')")
        # the disc that is nearest to the middle of the way, onto it
        ends = """() => {
          const {x, y} = drive.runs[0].actor, m = Math.floor(x.length / 2);
          const discs = replay.world.obstacles.filter((o) => o[6] > 0);
          discs.sort((a, b) => Math.hypot(a[0] - x[m], a[1] - y[m]) - Math.hypot(b[0] - x[m], b[1] - y[m]));
          return [[discs[0][0], discs[0][1]], [x[m], y[m]]];
        }"""
        drag(tab, tab.evaluate(ends))
        watched.until(DRIVEN)
        after = tab.evaluate(POSES)
        assert [label for label, _ in after] == ["vfh_plus", "apf_corrected"]
        assert after[0] != before[0]
        # no robot that arrived has driven through what stands there now
        least = "drive.runs.filter((run) => run.actor.outcome === 'success').map((run) => run.measures.clearance)"
        assert all(each >= 0.0 for each in tab.evaluate(least))
        tab.get_by_role("button", name="undo all").click()
        watched.until(DRIVEN)
        assert tab.evaluate(POSES) == before
        assert watched.errors == []


def test_a_touch_moves_an_obstacle_and_does_not_scroll(browser: Browser, files: dict[str, Path]) -> None:
    with Watched(browser, files["demo"], viewport={"width": 390, "height": 844}, has_touch=True) as watched:
        tab = watched.page
        tab.evaluate("drive.editor.take('move')")
        assert tab.evaluate("getComputedStyle(replay.canvas).touchAction") == "none"
        before = tab.evaluate("replay.world.goal")
        touch = """(at) => {
          const box = replay.canvas.getBoundingClientRect();
          const [{ centre: [cx, cy], pixels }, finger] = [replay.view, { bubbles: true, cancelable: true, buttons: 1 }];
          const place = ([x, y]) => ({ clientX: box.left + box.width / 2 + (x - cx) * pixels,
            clientY: box.top + box.height / 2 - (y - cy) * pixels });
          const send = (type, where) => replay.canvas.dispatchEvent(
            new PointerEvent(type, { pointerType: "touch", pointerId: 1, ...finger, ...place(where) }));
          replay.canvas.setPointerCapture = () => {};
          send("pointerdown", at); send("pointermove", [at[0] - 0.5, at[1]]); send("pointerup", [at[0] - 0.5, at[1]]);
        }"""
        tab.evaluate(touch, before[:2])
        assert tab.evaluate("replay.world.goal[0]") == pytest.approx(before[0] - 0.5, abs=1e-9)
        assert tab.evaluate("window.scrollY") == 0
        assert watched.errors == []


def taken(tab: Page, button: str) -> str:
    """Returns what a button puts on the clipboard."""
    tab.evaluate(
        "() => { window.taken = null; navigator.clipboard.writeText = async (text) => { window.taken = text; }; }"
    )
    tab.get_by_role("button", name=button).click()
    for _ in range(100):
        if text := tab.evaluate("window.taken"):
            return str(text)
        tab.wait_for_timeout(50)
    raise AssertionError("nothing was copied")


def same_in_python(tab: Page, label: str) -> None:
    """Asserts that the copied Python drives the run of a policy to the last bit."""
    tab.evaluate("(label) => replay.choose(drive.runs.find((run) => run.asked.label === label).actor)", label)
    space: dict[str, Any] = {}
    exec(taken(tab, "copy Python"), space)
    state = space["env"].unwrapped.batch.states[0]
    last = tab.evaluate("[replay.chosen.x.at(-1), replay.chosen.y.at(-1), replay.chosen.x.length - 1]")
    assert [state["x"], state["y"], round(space["info"]["time"] / 0.05)] == last


def test_a_drawn_path_is_driven_by_all_and_by_python(browser: Browser, files: dict[str, Path]) -> None:
    with Watched(browser, files["demo"], viewport={"width": 1280, "height": 900}) as watched:
        tab = watched.page
        tab.evaluate("drive.editor.take('path')")
        turns = [k / 40 * 2 * math.pi * 0.97 for k in range(41)]
        drag(tab, [[2.0 * math.cos(a), 1.2 * math.sin(2.0 * a)] for a in turns])
        watched.until(f"replay.world.kind === 'path' && {DRIVEN}")
        assert tab.evaluate("drive.runs.map((run) => run.asked.label)") == tab.evaluate("drive.able()")
        assert tab.evaluate("drive.runs.every((run) => run.actor.outcome === 'success')")
        for label in ("lqr (tuned)", "pure_pursuit"):
            same_in_python(tab, label)
        assert watched.errors == []


def test_a_link_shows_the_same_runs_and_python_drives_them(browser: Browser, files: dict[str, Path]) -> None:
    with Watched(browser, files["demo"], viewport={"width": 1280, "height": 900}) as watched:
        tab = watched.page
        tab.evaluate("drive.clear(); for (const label of ['vfh_plus', 'dwa (by hand)']) drive.add({ label })")
        tab.evaluate("drive.editor.take('box')")
        x, y, _ = tab.evaluate("replay.world.goal")
        drag(tab, [[x + 0.8, y + 0.6], [x + 1.0, y + 1.1]])
        watched.until(DRIVEN)
        tab.evaluate("replay.seek(17)")
        same_in_python(tab, "dwa (by hand)")
        url = taken(tab, "copy link")
        other = watched.context.new_page()
        other.goto(url)
        other.evaluate("ready")
        for _ in range(300):
            if other.evaluate(DRIVEN):
                break
            other.wait_for_timeout(100)
        assert other.evaluate(POSES) == tab.evaluate(POSES)
        assert other.evaluate("replay.step") == 17
        assert watched.errors == []


@pytest.mark.parametrize(
    ("changed", "told"),
    [
        (lambda text: text[:-40], "cut off or was changed"),
        (lambda text: text.replace("p3dx", "p3dy"), "robot is"),
        (lambda text: text.replace("lagged", "sticky"), "actuators is"),
        (lambda text: text.replace("vfh_plus", "vfh_minus"), "vfh_minus"),
        (lambda text: text.replace("%22v%22%3A1", "%22v%22%3A9"), "version"),
        (lambda text: text.replace("clutter_5", "clutter_x"), "family is"),
    ],
)
def test_a_link_that_was_edited_is_a_sentence(
    browser: Browser, files: dict[str, Path], changed: Any, told: str
) -> None:
    with Watched(browser, files["demo"]) as watched:
        watched.page.evaluate("drive.clear(); drive.add({ label: 'vfh_plus' })")
        url = taken(watched.page, "copy link")
        other = watched.context.new_page()
        page_errors: list[str] = []
        other.on("pageerror", lambda error: page_errors.append(str(error)))
        head, _, tail = url.partition("#")
        other.goto(f"{head}#{changed(tail)}")
        other.evaluate("ready")
        assert told in other.locator("#problem").inner_text()
        assert other.evaluate("replay.world !== undefined")
        assert page_errors == []


EDITED = {
    "(s) => { s.runs = [null]; }": "runs[0] is null",
    "(s) => { s.runs[0].actuators = 'constructor'; }": "actuators is",
    "(s) => { s.runs[0].gains = null; }": "gains is null",
    "(s) => { s.runs[0] = { policy: 'mppi', gains: { samples: 100.5 } }; }": "samples is 100.5",
    "(s) => { s.step = '9'; }": "step is",
    "(s) => { s.sheet = null; }": "sheet is null",
    "(s) => { delete s.world; s.place = null; }": "place is null",
    "(s) => { s.world.steps = 0; }": "steps is 0",
    "(s) => { s.world.position_tolerance = -1; }": "position_tolerance is -1",
    "(s) => { delete s.world.waypoint_radius; }": "waypoint_radius is undefined",
    "(s) => { s.world.patrols = [[0, 0, 1, 1, 2, 0]]; }": "patrols has 1 rows",
    "(s) => { s.world.obstacles[0][6] = -1; }": "size or mass is -1",
    "(s) => { s.world.obstacles[0].splice(2, 2, 0, 0); }": "direction is [0, 0]",
}


def test_a_link_that_holds_what_cannot_be_is_a_sentence(browser: Browser, files: dict[str, Path]) -> None:
    with Watched(browser, files["demo"]) as watched:
        tab = watched.page
        tab.evaluate("drive.clear(); drive.add({ label: 'vfh_plus' }); drive.editor.change(() => {})")
        state = tab.evaluate("drive.share.state()")
        opened = """([state, edit]) => {
          const changed = structuredClone(state);
          edit(changed);
          try { drive.share.restore(encodeURIComponent(JSON.stringify(changed))); } catch (error) { return `${error}`; }
          return "opened";
        }"""
        for edit, told in EDITED.items():
            answer = tab.evaluate(opened.replace("edit(changed)", f"({edit})(changed)"), [state, None])
            assert answer.startswith("Error: "), edit  # and no TypeError of the machine
            assert told in answer, edit
        assert tab.evaluate(opened.replace("edit(changed);", ""), [state, None]) == "opened"
        assert watched.errors == []


def test_a_tool_on_a_phone_brings_the_picture_back(browser: Browser, files: dict[str, Path]) -> None:
    phone: dict[str, Any] = {"viewport": {"width": 390, "height": 844}, "has_touch": True}
    with Watched(browser, files["demo"], **phone) as watched:
        tab = watched.page
        tab.get_by_role("button", name="disc", exact=True).tap()
        tab.wait_for_timeout(1000)  # a scroll takes some frames
        box = tab.locator(".board canvas").first.bounding_box()
        assert box is not None
        assert box["y"] >= 0
        assert box["y"] + box["height"] <= 844
        tab.get_by_role("button", name="done").tap()
        assert tab.evaluate("[drive.editor.tool, getComputedStyle(replay.canvas).touchAction]") == [None, "pan-y"]


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
        assert "nothing of it can be replayed" in watched.page.locator("#summary").inner_text()
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
            tab.evaluate("drive.clear(); drive.add({ label: 'vfh_plus' }); drive.pump(20000)")
            assert tab.evaluate("drive.runs[0].actor.robot") == robot
            assert tab.evaluate(MOVED) > 0.05
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
        assert "mpc_pose (solves its problem with OSQP)" in tab.locator(".drive").text_content()
        for robot in ("p3dx", "turtlebot3"):
            tab.evaluate(CHOSEN, robot)
            # the back of the hull stands as far from the wall as the family says, whatever the robot
            gap = "clearanceAt(replay.world, 0, replay.world.goal[0], replay.world.goal[1], HULLS[replay.robot])"
            assert tab.evaluate(gap) == pytest.approx(0.05, abs=2e-6)
            tab.evaluate("drive.clear(); drive.add({ label: 'reeds_shepp' }); drive.pump(20000)")
            assert tab.evaluate("drive.runs[0].actor.outcome") == "success"
        tab.evaluate(CHOSEN, "omni3")
        assert "waypoint" in tab.evaluate("[...drive.who.options].map((each) => each.value)")
        tab.get_by_role("button", name="drive yourself").click()
        tab.keyboard.down("ArrowUp")
        watched.until("drive.hand.actor.x.length > 30 || drive.hand.actor.outcome")
        tab.keyboard.up("ArrowUp")
        assert tab.evaluate(MOVED) > 0.05
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


def test_a_slider_changes_the_run_and_python_drives_the_same(browser: Browser, files: dict[str, Path]) -> None:
    with Watched(browser, files["demo"], viewport={"width": 1280, "height": 900}) as watched:
        tab = watched.page
        tab.evaluate(
            "drive.clear(); drive.who.value = 'vfh_plus'; drive.chosenPolicy(); drive.go(false); drive.pump(20000)"
        )
        tab.get_by_text("Gains of the policy").click()
        (before,) = tab.evaluate(POSES)
        slider = tab.get_by_role("slider", name="max_speed")
        slider.fill("0.3")
        watched.until(DRIVEN)
        assert tab.evaluate("drive.runs.map((run) => Boolean(run.reference))") == [False, True]
        changed, untouched = tab.evaluate(POSES)
        assert untouched == before
        assert changed != before
        assert tab.evaluate("drive.runs[0].measures.speed") < 0.3
        assert "untouched" in tab.locator(".deltas").inner_text()
        same_in_python(tab, "vfh_plus")
        tab.get_by_role("spinbutton", name="max_speed as a number").fill("-1")
        tab.keyboard.press("Enter")
        assert "max_speed is -1; it must be from" in tab.locator(".quick").inner_text()
        tab.get_by_role("button", name="reset", exact=True).click()
        watched.until(DRIVEN)
        assert tab.evaluate(POSES) == [before]
        assert watched.errors == []


@pytest.mark.parametrize("task", list(TASKS))
def test_each_slider_is_the_gain_of_python(browser: Browser, files: dict[str, Path], task: str) -> None:
    """A gain that is moved in the page drives as the gain that Python is handed, for each policy one."""
    with Watched(browser, files["demo"]) as watched:
        tab = watched.page
        kind = TASKS[task].kind
        family = tab.evaluate("(kind) => [...picks.families.keys()].find((each) => each.startsWith(`${kind}: `))", kind)
        tab.evaluate("(family) => picks.restore({ family, seed: 0 })", family)
        tab.evaluate("drive.clear()")
        labels = [label for label in tab.evaluate("drive.able()") if "(" not in label]
        for k, label in enumerate(labels):
            gains = tab.evaluate("(label) => drive.gains.recipe(label).gains", label)
            gain = gains[k % len(gains)]
            value = gain["low"] if gain["whole"] else 0.75 * gain["value"] + 0.25 * gain["low"]
            tab.evaluate(
                "([label, gains]) => { drive.clear(); drive.add({ label, gains }); }", [label, {gain["name"]: value}]
            )
            watched.until(DRIVEN)
            same_in_python(tab, label)
        assert watched.errors == []


# what a slow base leaves of a gain, and one that another number of the law is made of
BOUND = [
    ("path_following", "stanley", "share", 0.83),
    ("path_following", "smooth_pose", "yaw_acceleration", 4.1),
    ("goal_reaching", "scan_planner", "acceleration", 0.77),
    ("docking", "reeds_shepp", "deceleration", 0.9),
]


def test_a_gain_beyond_what_the_base_can_do_drives_as_in_python(browser: Browser, files: dict[str, Path]) -> None:
    with Watched(browser, files["demo"]) as watched:
        tab = watched.page
        tab.evaluate("drive.tier.value = 'slow'")
        for task, label, gain, value in BOUND:
            kind = TASKS[task].kind
            family = tab.evaluate("(k) => [...picks.families.keys()].find((each) => each.startsWith(`${k}: `))", kind)
            tab.evaluate("(family) => { picks.restore({ family, seed: 0 }); drive.clear(); }", family)
            tab.evaluate("([label, gains]) => drive.add({ label, gains })", [label, {gain: value}])
            watched.until(DRIVEN)
            same_in_python(tab, label)
        assert watched.errors == []


LOOKED = "drive.looks.sides[0].shadow && drive.looks.sides[0].shadow.kept.get(replay.step)"
OVERLAID = {
    "path_following": ["pure_pursuit", "regulated_pure_pursuit", "smooth_pose", "stanley", "lqr"],
    "goal_reaching": ["apf_corrected", "vfh_plus", "dwa", "mppi", "scan_planner", "astar_tracker", "ppo (trained)"],
    "docking": ["reeds_shepp"],
}


def looked_at(watched: Watched, task: str, label: str, step: int) -> Any:
    """Returns what the overlay of a policy draws at a step of its run, with the run's pose there."""
    tab = watched.page
    kind = TASKS[task].kind
    family = tab.evaluate("(kind) => [...picks.families.keys()].find((each) => each.startsWith(`${kind}: `))", kind)
    tab.evaluate("(family) => { picks.restore({ family, seed: 0 }); drive.clear(); }", family)
    tab.evaluate("(label) => { drive.add({ label }); drive.pump(20000); }", label)
    tab.evaluate("async (step) => { await drive.looks.turn(true); replay.seek(step); }", step)
    watched.until(f"Boolean({LOOKED})")
    told = f"""(({{numbers, places, shape, twist}}) =>
      ({{shape, numbers: [...numbers], places: places && [...places], twist}}))({LOOKED})"""
    pose = tab.evaluate("['x', 'y', 'heading'].map((name) => replay.chosen[name][replay.step])")
    return tab.evaluate(told) | {"pose": pose}


@pytest.mark.parametrize("task", list(OVERLAID))
def test_an_overlay_is_drawn_and_changes_no_run(browser: Browser, files: dict[str, Path], task: str) -> None:
    with Watched(browser, files["demo"], viewport={"width": 1280, "height": 900}) as watched:
        tab = watched.page
        for label in OVERLAID[task]:
            looked_at(watched, task, label, 12)
            tab.evaluate("replay.toggle(false)")
            drawn = tab.evaluate("replay.canvas.toDataURL()")
            with_it = tab.evaluate(POSES)
            tab.evaluate("drive.looks.turn(false)")
            assert tab.evaluate("replay.canvas.toDataURL()") != drawn, label
            tab.evaluate("(label) => { drive.clear(); drive.add({ label }); drive.pump(20000); }", label)
            assert tab.evaluate(POSES) == with_it
        assert watched.errors == []


def test_overlays_are_the_numbers_of_the_laws(browser: Browser, files: dict[str, Path]) -> None:
    with Watched(browser, files["demo"], viewport={"width": 1280, "height": 900}) as watched:
        # pure pursuit: a point of the path, as far away as its gain says
        found = looked_at(watched, "path_following", "pure_pursuit", 25)
        px, py, distance = found["numbers"]
        assert math.hypot(px - found["pose"][0], py - found["pose"][1]) == pytest.approx(distance, abs=1e-6)
        ring = watched.page.evaluate("[...replay.world.path, ...(replay.world.closed ? [replay.world.path[0]] : [])]")
        gaps = []
        for (ax, ay), (bx, by) in itertools.pairwise(ring):
            length = math.hypot(bx - ax, by - ay)
            along = min(max(((px - ax) * (bx - ax) + (py - ay) * (by - ay)) / length**2, 0.0), 1.0)
            gaps.append(math.hypot(px - ax - along * (bx - ax), py - ay - along * (by - ay)))
        assert min(gaps) < 1e-6
        # DWA: what is driven is one of the candidates, admissible
        found = looked_at(watched, "goal_reaching", "dwa", 25)
        rows = np.reshape([math.nan if each is None else each for each in found["numbers"]], (-1, 4))[:-1]
        (driven,) = np.flatnonzero((rows[:, :3] == found["twist"]).all(axis=1))
        assert math.isfinite(rows[driven, 3])
        # VFH+: it steers where no sector is blocked
        found = looked_at(watched, "goal_reaching", "vfh_plus", 25)
        primary, binary, masked, (_, choice, looks, *_) = np.reshape(found["numbers"], (4, -1))
        assert looks == 1.0
        assert (primary[binary == 0] < 0.5).all()
        assert masked[int((choice + math.pi) / (2.0 * math.pi) * len(masked)) % len(masked)] == 0.0
        # the potential field: far from all obstacles it points at the goal, no faster than its limit
        found = looked_at(watched, "goal_reaching", "apf_corrected", 25)
        forces, places = np.reshape(found["numbers"], (-1, 2)), np.reshape(found["places"], (-1, 2)).astype(float)
        speeds = np.hypot(*forces.T)
        assert np.nanmax(speeds) <= 0.3 + 1e-9
        goal = np.array(watched.page.evaluate("replay.world.goal")[:2])
        solids = np.array(watched.page.evaluate("replay.world.obstacles"))[:, :2]
        far = [k for k, at in enumerate(places) if np.isfinite(at).all() and np.hypot(*(solids - at).T).min() > 1.6]
        assert far
        for k in far:
            way = goal - places[k]
            assert forces[k] @ way == pytest.approx(speeds[k] * np.hypot(*way), rel=1e-9)
        # MPPI: plans begin at the robot, and what is driven is their mean
        found = looked_at(watched, "goal_reaching", "mppi", 25)
        rollouts = np.array(found["numbers"], float).reshape(found["shape"])
        assert np.hypot(*rollouts[:, 1].T).max() < 0.1  # a tenth of a second on
        assert (rollouts[:-1, 0, 0] >= 0.0).all()
        assert watched.errors == []


def test_two_runs_stand_side_by_side(browser: Browser, files: dict[str, Path]) -> None:
    with Watched(browser, files["demo"], viewport={"width": 1280, "height": 900}) as watched:
        tab = watched.page
        tab.evaluate("drive.clear(); for (const label of ['vfh_plus', 'dwa']) drive.add({ label }); drive.pump(20000)")
        tab.get_by_role("button", name="compare").click()
        boxes = [tab.locator(f".board canvas >> nth={k}").bounding_box() for k in range(2)]
        assert all(box is not None and box["width"] > 300 for box in boxes)
        tab.get_by_label("run on the right").select_option("vfh_plus")
        assert tab.evaluate("[replay.other.label, replay.chosen.label].sort()") == ["dwa", "vfh_plus"]
        url = taken(tab, "copy link")
        other = watched.context.new_page()
        other.goto(url)
        other.evaluate("ready")
        assert other.evaluate("replay.other.label") == tab.evaluate("replay.other.label")
        tab.get_by_role("button", name="compare").click()
        assert tab.locator(".board canvas").nth(1).is_hidden()
        assert watched.errors == []


def test_an_image_is_a_map_and_python_drives_there(browser: Browser, files: dict[str, Path], tmp_path: Path) -> None:
    room = np.full((60, 80), 255, np.uint8)
    room[:2] = room[-2:] = 0
    room[:, :2] = room[:, -2:] = 0
    room[:40, 38:42] = 0
    Image.fromarray(room).save(tmp_path / "room.png")
    Image.fromarray(np.full((20, 20), 255, np.uint8)).save(tmp_path / "white.png")
    (tmp_path / "broken.png").write_bytes(b"\x89PNG no more")
    with Watched(browser, files["demo"]) as watched:
        tab = watched.page
        tab.locator("input[type=file]").set_input_files(tmp_path / "room.png")
        watched.until("replay.world.name === 'room'")
        solids = np.array(tab.evaluate("replay.world.obstacles"))
        dark = (room == 0).mean() * 16.0 * 12.0
        assert (4.0 * solids[:, 4] * solids[:, 5]).sum() == pytest.approx(dark, rel=1e-9)
        tab.evaluate("drive.clear(); drive.add({ label: 'astar_tracker' }); drive.pump(20000)")
        assert tab.evaluate("drive.runs[0].actor.outcome") == "success"
        same_in_python(tab, "astar_tracker")
        for name, told in (("white.png", "nothing in it is dark"), ("broken.png", "no image")):
            tab.locator("input[type=file]").set_input_files(tmp_path / name)
            place = tab.get_by_role("status").filter(has_text=name)
            place.wait_for(timeout=10_000)
            assert told in place.inner_text()
        assert tab.evaluate("replay.world.name") == "room"  # what was there is still there
        assert watched.errors == []


MINE = {
    "name": "mine",
    "drive": "differential",
    "wheels": {"radius": 0.06, "track": 0.31},
    "hull": {"radius": 0.2},
    "mass": 6.0,
    "inertia": 0.1,
    "friction": 0.8,
    "rated_wheel_speed": 14.0,
    "peak_wheel_speed": 16.0,
    "acceleration": 0.7,
    "yaw_acceleration": 2.1,
    "lag": 0.17,
}


@pytest.mark.parametrize("tier", ["lagged", "slow"])
def test_a_data_sheet_is_a_robot_and_python_drives_it_the_same(
    browser: Browser, files: dict[str, Path], tmp_path: Path, monkeypatch: pytest.MonkeyPatch, tier: str
) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "mine.json").write_text(json.dumps(MINE))
    with Watched(browser, files["demo"]) as watched:
        tab = watched.page
        tab.locator("input[type=file]").set_input_files(tmp_path / "mine.json")
        watched.until("replay.robot === 'mine'")
        for kind in ("path", "goal", "dock"):
            family = tab.evaluate("(k) => [...picks.families.keys()].find((each) => each.startsWith(`${k}: `))", kind)
            tab.evaluate(
                "([family, tier]) => { picks.restore({ family, seed: 0 }); drive.tier.value = tier; drive.offer(); }",
                [family, tier],
            )
            able = [label for label in tab.evaluate("drive.able()") if "(" not in label]
            assert len(able) >= 4
            for label in able:
                tab.evaluate("(label) => { drive.clear(); drive.add({ label }); drive.pump(20000); }", label)
                near_in_python(tab, label)
        url = taken(tab, "copy link")
        other = watched.context.new_page()
        other.goto(url)
        other.evaluate("ready")
        assert other.evaluate("[replay.robot, HULLS.mine]") == ["mine", 0.2]
        assert watched.errors == []


def near_in_python(tab: Page, label: str) -> None:
    """Asserts that the copied Python drives the run of a policy, but for the last bits of an exponential."""
    tab.evaluate("(label) => replay.choose(drive.runs.find((run) => run.asked.label === label).actor)", label)
    space: dict[str, Any] = {}
    exec(taken(tab, "copy Python"), space)
    state = space["env"].unwrapped.batch.states[0]
    x, y, steps = tab.evaluate("[replay.chosen.x.at(-1), replay.chosen.y.at(-1), replay.chosen.x.length - 1]")
    assert (label, round(space["info"]["time"] / 0.05)) == (label, steps)
    assert math.hypot(state["x"] - x, state["y"] - y) < 1e-9, label


@pytest.mark.parametrize(
    ("changed", "told"),
    [
        ({"drive": "omni"}, "drive is"),
        ({"wheels": {"radius": -1.0, "track": 0.3}}, "wheels.radius is -1"),
        ({"hull": {"kind": "box", "length": 1, "width": 1}}, "hull.radius is"),
        ({"delay": 0.2}, "delay"),
        ({"name": "p3dx"}, "p3dx"),
        ({"peak_wheel_speed": 1.0}, "at least rated_wheel_speed"),
    ],
)
def test_a_data_sheet_that_the_page_cannot_drive_is_a_sentence(
    browser: Browser, files: dict[str, Path], tmp_path: Path, changed: dict[str, Any], told: str
) -> None:
    with Watched(browser, files["demo"]) as watched:
        file = tmp_path / "other.json"
        file.write_text(json.dumps(MINE | changed))
        watched.page.locator("input[type=file]").set_input_files(file)
        place = watched.page.get_by_role("status").filter(has_text="other.json")
        place.wait_for(timeout=10_000)
        assert told in place.inner_text()
        assert watched.page.evaluate("replay.robot") == "p3dx"
        assert watched.errors == []
