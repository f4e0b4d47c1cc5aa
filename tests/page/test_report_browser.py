"""The report in a real browser, from a file: it opens, replays, sorts, and drives."""

import contextlib
import itertools
import json
import math
import random
import re
import shutil
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from oracles.hostile_page import HOSTILE, hostile
from page_recipes import AGENTS, fitting
from PIL import Image

from wayfield.benchmarks.commands import demo
from wayfield.benchmarks.report import page
from wayfield.benchmarks.report.page import Content, made, rendered
from wayfield.benchmarks.report.worlds import IN_PAGE
from wayfield.envs.robots import ROBOTS
from wayfield.envs.scenarios import TASKS, scenarios_of

CHROMIUM = shutil.which("chromium") or shutil.which("chromium-browser") or shutil.which("google-chrome")
pytestmark = [
    pytest.mark.page,
    pytest.mark.skipif(CHROMIUM is None, reason="chromium is missing: apt-get install chromium"),
]
pytest.importorskip("playwright.sync_api", reason='playwright is missing: pip install "wayfield[dev]"')

from playwright.sync_api import Browser, Page, sync_playwright  # noqa: E402

CHOSEN = "(robot) => { drive.robot.value = robot; drive.robot.dispatchEvent(new Event('change')); }"


@pytest.fixture(scope="module")
def browser() -> Iterator[Browser]:
    with sync_playwright() as playwright:
        found = playwright.chromium.launch(executable_path=CHROMIUM, args=["--no-sandbox"])
        yield found
        found.close()


def by_hand(tab: Page) -> None:
    """Takes the wheel in the scene on the screen."""
    shown = tab.evaluate("[replay.world.family, replay.world.name, replay.robot]")
    tab.locator(".large button").first.click()
    assert tab.evaluate("[replay.world.family, replay.world.name, replay.robot]") == shown


def opened(family: str) -> dict[str, Any]:
    """Returns what the demo opens on, and races in, where it has few scenes."""
    place = {"family": family, "seed": 0}
    calm = {"v": 2, "robot": "p3dx", "actuators": "lagged", "disturbance": "none", "policy": "ppo (trained)"}
    race = place | {"name": "few obstacles", "robot": "p3dx"}
    return {"opening": calm | {"place": place, "runs": [], "step": 0}, "challenges": [race]}


@pytest.fixture(scope="module")
def files(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    folder = tmp_path_factory.mktemp("pages")
    content = hostile()
    content.missing = []
    content.episodes[0] |= {"contest": "goal-obstacles", "family": "clutter_5", "tier": "easy"}
    content.episodes[0] |= {"robot": "mine", "hull": 0.123}
    files = {name: folder / f"{name}.html" for name in ("report", "demo", "bare")}
    files["report"].write_text(rendered(HOSTILE, content, made("evaluate", content), page.BUDGET), encoding="utf-8")
    told = content.episodes[0]
    content.duels = [{"contest": told["contest"], "robot": told["robot"], "policies": [told["policy"]]}]
    files["duel"] = folder / "duel.html"
    files["duel"].write_text(rendered(HOSTILE, content, made("evaluate", content), page.BUDGET), encoding="utf-8")
    bare = Content(sentences=["a won"], missing=["old-run lacks drives.npz: nothing of it can be replayed."])
    files["bare"].write_text(rendered("bare", bare, made("evaluate", bare), page.BUDGET), encoding="utf-8")
    # in the last one nothing moves, so that what stands there can be dragged
    some = [family for spec in TASKS.values() for family in spec.families][::4]
    families = [*some, "doorway_4", "crowdnav_5", "wall", "clutter_5"]
    first_of = {each["family"]: each for each in reversed(demo.worlds(families))}
    driving = Content(worlds=[first_of[family] for family in families if family in first_of])
    first = driving.worlds[-1]
    told = {"demo": demo.setup() | opened(f"{first['kind']}: {first['family']}")}
    text = rendered("demo", driving, made("demo", driving), demo.BUDGET, told, AGENTS)
    files["demo"].write_text(text, encoding="utf-8")
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
        self.page.evaluate("for (const part of document.querySelectorAll('.side details')) part.open = true")

    def until(self, condition: str) -> None:
        """Waits, some minutes at most, until an expression of the page holds; the page lets nobody evaluate text."""
        for _ in range(2000):
            if self.page.evaluate(condition):
                return
            self.page.wait_for_timeout(100)
        raise AssertionError(f"never: {condition}")

    def __enter__(self) -> "Watched":
        return self

    def __exit__(self, *_: object) -> None:
        self.context.close()


@pytest.mark.parametrize(
    ("name", "width", "scheme"),
    [
        *(("report", 1280, "light"), ("demo", 390, "dark")),
        *(
            pytest.param(*each, marks=pytest.mark.slow)
            for each in (("report", 390, "dark"), ("demo", 1280, "light"), ("bare", 1280, "light"))
        ),
    ],
)
def test_it_opens_from_a_file_and_fits(
    browser: Browser, files: dict[str, Path], name: str, width: int, scheme: Any
) -> None:
    with Watched(browser, files[name], viewport={"width": width, "height": 800}, color_scheme=scheme) as watched:
        assert watched.errors == []
        assert [each for each in watched.requests if not each.startswith(("file:", "data:", "blob:"))] == []
        assert len([each for each in watched.requests if each.startswith("file:")]) == 1
        assert watched.page.evaluate("document.documentElement.scrollWidth") <= width
        assert watched.page.locator("#problem").is_hidden()
        watched.page.get_by_role("button", name="light / dark").click()
        watched.page.reload()
        assert watched.page.locator("html").get_attribute("data-theme") == {"light": "dark", "dark": "light"}[scheme]


@pytest.mark.parametrize(("width", "height"), [(1280, 800), (1440, 900), (390, 844)])
def test_robot_policy_pad_and_play_are_in_one_view_and_nothing_moves_unasked(
    browser: Browser, files: dict[str, Path], width: int, height: int
) -> None:
    size: Any = {"width": width, "height": height}
    with Watched(browser, files["demo"], viewport=size, reduced_motion="reduce") as watched:
        tab = watched.page
        assert not tab.evaluate("replay.playing")
        assert tab.evaluate("document.activeElement === document.body")
        by_hand(tab)
        tab.wait_for_timeout(200)
        assert tab.evaluate("[replay.playing, drive.hand.actor.x.length]") == [False, 1]  # the clock waits for a key
        shown = """() => {
          const box = (each) => ["left", "top", "right", "bottom"].map((side) => each.getBoundingClientRect()[side]);
          const { left, top, width, height } = replay.canvas.getBoundingClientRect();
          const [{ centre: [cx, cy], pixels }, { x, y }] = [replay.view, drive.hand.actor];
          const at = [left + width / 2 + (x[0] - cx) * pixels, top + height / 2 - (y[0] - cy) * pixels];
          const controls = [drive.pad, replay.playButton, replay.scrubber, replay.chartButton];
          return [[...at, ...at], ...controls.map(box)];
        }"""
        assert tab.evaluate("window.scrollY") == 0
        for left, top, right, bottom in tab.evaluate(shown):
            assert 0 <= left <= right <= width
            assert 0 <= top <= bottom <= height
        tab.keyboard.press("ArrowUp")
        watched.until("drive.hand.actor.x.length > 3 && drive.runs.some((run) => run !== drive.hand && !run.pending)")
        if width > 820:  # the first chart takes its room from the picture
            tab.get_by_role("button", name="charts").click()
            bottom = tab.evaluate("replay.traces[0].canvas.getBoundingClientRect().bottom")
            assert [tab.evaluate("window.scrollY"), bottom <= height] == [0, True]
        assert watched.errors == []


def test_a_name_that_is_a_script_stays_text(browser: Browser, files: dict[str, Path]) -> None:
    with Watched(browser, files["report"]) as watched:
        assert watched.page.title() == HOSTILE
        assert watched.page.locator("script").count() == 2
        watched.page.get_by_role("button", name="Tables").click()
        assert HOSTILE in watched.page.locator("#full").inner_text()


@pytest.mark.parametrize("motion", ["no-preference", "reduce"])
def test_a_report_opens_on_the_leader_in_motion(browser: Browser, files: dict[str, Path], motion: Any) -> None:
    with Watched(browser, files["duel"], reduced_motion=motion) as watched:
        watched.until("replay.chosen.told === replay.told.episodes[0]")
        watched.until("replay.step > 3" if motion == "no-preference" else "!replay.playing && replay.step === 0")
        assert watched.errors == []


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


DRIVEN = "drive.runs.every((run) => !run.pending)"
POSES = (
    "drive.runs.map((run) => [run.asked.label, [run.actor.x, run.actor.y, run.actor.heading].map((each) => [...each])])"
)
MOVED = "(({x, y}) => Math.hypot(x.at(-1) - x[0], y.at(-1) - y[0]))(drive.runs.at(-1).actor)"


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


def test_nobody_is_shown_driving_through_what_was_put_down(browser: Browser, files: dict[str, Path]) -> None:
    with Watched(browser, files["demo"], viewport={"width": 1280, "height": 900}, reduced_motion="reduce") as watched:
        tab = watched.page
        for label in ("vfh_plus", "scan_planner", "mppi"):  # some take long to be driven again
            tab.get_by_label("another robot").select_option(label)
            tab.get_by_role("button", name="add this one").click()
        watched.until(DRIVEN)
        middle = "(({ x, y }) => [x, y].map((each) => each[Math.floor(x.length / 2)]))(replay.chosen)"
        # how near the track of a robot that is shown leads to the last thing (m)
        nearest = """Math.min(...replay.actors.flatMap(({ x, y }) => [...x].map((each, k) =>
          distanceTo(replay.world.obstacles.at(-1), each, y[k]) - HULLS[replay.robot])))"""
        tab.get_by_role("button", name="Put things in its way").click()
        drag(tab, [tab.evaluate(middle)])
        pending = True
        while pending:
            pending = tab.evaluate(f"!{DRIVEN}")
            assert tab.evaluate(nearest) > -0.05  # who crashes there is into it by a step
        assert watched.errors == []


@pytest.mark.slow
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
        tab.get_by_role("button", name="reset scene").click()
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
    assert [state["x"], state["y"], round(np.max(space["info"]["time"]) / 0.05)] == last


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


def test_things_are_put_and_a_path_is_drawn_by_the_keyboard_alone(browser: Browser, files: dict[str, Path]) -> None:
    with Watched(browser, files["demo"]) as watched:
        tab = watched.page

        def pressed(button: str, *keys: str) -> None:
            tab.get_by_role("button", name=button).focus()
            for key in ("Enter", *keys):
                tab.keyboard.press(key)

        pressed("Put things in its way", "Shift+ArrowLeft", "Enter", "Enter")
        assert tab.evaluate("replay.world.obstacles.length - drive.original.obstacles.length") == 1
        pressed("Draw a path", "Enter", *["Shift+ArrowRight"] * 4, *["Shift+ArrowUp"] * 3, "Enter")
        watched.until(f"replay.world.kind === 'path' && {DRIVEN}")
        assert tab.evaluate("replay.world.path.length") > 10
        assert watched.errors == []


def test_a_link_shows_the_same_runs_and_python_drives_them(browser: Browser, files: dict[str, Path]) -> None:
    with Watched(browser, files["demo"], viewport={"width": 1280, "height": 900}) as watched:
        tab = watched.page
        tab.evaluate("drive.clear(); for (const label of ['vfh_plus', 'dwa (hand-tuned)']) drive.add({ label })")
        tab.evaluate("drive.editor.take('box')")
        x, y, _ = tab.evaluate("replay.world.goal")
        drag(tab, [[x + 0.8, y + 0.6], [x + 1.0, y + 1.1]])
        watched.until(DRIVEN)
        tab.evaluate("replay.toggle(false); replay.seek(17)")
        same_in_python(tab, "dwa (hand-tuned)")
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
        assert "at the start" not in other.locator(".side .actors").inner_text()
        assert watched.errors == []


def test_a_race_has_a_result_and_its_link_carries_the_run(browser: Browser, files: dict[str, Path]) -> None:
    with Watched(browser, files["demo"], viewport={"width": 390, "height": 844}, reduced_motion="reduce") as watched:
        tab = watched.page
        card = tab.locator(".card")
        by_hand(tab)
        assert "clock waits for your first press" in tab.locator(".sentence").inner_text()
        watched.until(DRIVEN.replace("=>", "=> run === drive.hand ||"))
        listed = tab.locator(".side .actors").inner_text()
        assert "to beat: " in listed  # no result before the start
        assert "arrived" not in listed
        tab.evaluate("replay.pace(8)")
        for key in ("ArrowLeft", "ArrowUp"):
            tab.keyboard.down(key)
            tab.wait_for_timeout(150)
        watched.until(f"drive.hand.actor.outcome !== '' && {DRIVEN}")
        told = card.inner_text()
        assert ("Finished in" in told) == tab.evaluate("drive.hand.actor.outcome === 'success'")
        assert all(f"{each}\n" in told for each in ("you", "trained network", "A* planner", "vector histogram"))
        names = "[...document.querySelectorAll('{}')].map((each) => each.textContent.replace(/ \\(.*/, ''))"
        assert tab.evaluate(names.format(".order span:first-child")) == tab.evaluate(names.format(".actors .name"))
        same_in_python(tab, "you, by keyboard or pad")
        other = watched.context.new_page()
        other.goto(taken(tab, "Copy a link to race this run"))
        tab.locator(".card .note", has_text="Link copied").wait_for()
        assert inside(box_of(tab, ".card .note"), (0, 0, 390, 844))
        other.evaluate("ready")
        for _ in range(300):  # the friend's run is driven anew
            if other.evaluate(DRIVEN):
                break
            other.wait_for_timeout(100)
        assert "A friend sent you this run" in other.locator(".sentence").inner_text()
        other.keyboard.press("Enter")  # as one ends a link that was pasted
        assert other.evaluate("[drive.hand, replay.playing]") == [None, False]
        assert other.locator(".card").is_visible()
        assert other.evaluate("drive.looks.button.dataset.why") == "choose a rival first"
        driven = POSES.replace("drive.runs", "drive.runs.filter((run) => run.tape.length)")
        (_, mine), (_, friend) = (each.evaluate(driven)[0] for each in (tab, other))
        assert friend == mine
        other.evaluate("replay.pace(8)")
        other.get_by_role("button", name="watch first").click()
        assert other.locator(".card").is_hidden()
        other.get_by_role("button", name="Race your friend").click(
            timeout=60_000
        )  # it comes back once the film has ended
        assert other.evaluate("drive.runs.length") == 5  # three rivals, the friend, and another hand
        assert other.evaluate("drive.race.limits") == tab.evaluate("drive.race.limits")  # a friend takes no medal
        quickest = other.evaluate("drive.race.limits[0]")
        result = other.evaluate(FINISHED, quickest)
        assert "a friend\n" in result
        assert ("Gold medal" in result, f"1st of {5}" in result) == (True, True)
        assert "ghost" not in other.inner_text("body")
        tab.keyboard.up("ArrowUp")
        tab.keyboard.press("r")
        assert "clock waits for your first press" in tab.locator(".sentence").inner_text()
        assert tab.evaluate("drive.hand.actor.x.length") == 1
        assert watched.errors == []


def test_arrow_keys_drive_after_a_click_in_the_bar_and_work_a_list_that_tab_led_to(
    browser: Browser, files: dict[str, Path]
) -> None:
    with Watched(browser, files["demo"], viewport={"width": 1440, "height": 900}, reduced_motion="reduce") as watched:
        tab = watched.page
        by_hand(tab)
        tab.get_by_role("button", name="copy Python").click()
        tab.locator(".drive", has_text="Drive first").wait_for()  # there is no run yet
        tab.evaluate("() => { replay.world.obstacles.length = 1; drive.begin(drive.hand, true); }")
        ahead = "drive.twistByHand(drive.hand.simulator)[0]"
        for each in ("follow robot", "laser rays", "pause", "speed of the replay"):
            tab.keyboard.press("ArrowUp")  # the clock runs
            (tab.get_by_label(each) if "speed" in each else tab.get_by_role("button", name=each, exact=True)).click()
            if "speed" in each:
                tab.keyboard.press("Escape")  # the list is closed again
            tab.keyboard.down("ArrowUp")
            assert tab.evaluate(f"[{ahead} > 0, replay.playing, replay.rate]") == [True, True, 1]
            tab.keyboard.up("ArrowUp")
            assert tab.evaluate(ahead) == 0
        clock = "getComputedStyle(replay.clock, '::after').content"
        assert tab.evaluate(clock) == "none"
        tab.keyboard.press("Space")
        assert tab.evaluate(f"[{clock}, replay.playing]") == ['"paused: arrows drive on"', False]
        tab.keyboard.press("ArrowLeft")
        assert tab.evaluate(f"[{clock}, replay.playing]") == ["none", True]
        tab.get_by_role("slider", name="time").focus()
        tab.keyboard.press("Tab")
        tab.keyboard.press("ArrowDown")
        assert tab.evaluate("replay.rate") == 2
        thinking = tab.get_by_role("button", name="show its thinking")
        shown = "getComputedStyle(drive.looks.button, '::after').content"
        assert [thinking.is_enabled(), tab.evaluate(shown)] == [False, '"choose a rival first"']
        tab.locator(".actors [data-chosen=no] .name").first.click()
        assert [thinking.is_enabled(), tab.evaluate(shown)] == [True, "none"]
        assert watched.errors == []


def test_arrow_keys_step_while_it_is_paused_wherever_a_click_left_the_focus(
    browser: Browser, files: dict[str, Path]
) -> None:
    with Watched(browser, files["demo"], viewport={"width": 1440, "height": 900}) as watched:
        tab = watched.page
        tab.evaluate(
            "drive.clear(); drive.add({ label: 'dwa' }); drive.pump(20000); replay.seek(20); replay.toggle(true)"
        )
        assert tab.evaluate("Number(replay.scrubber.max) === replay.last")
        for name in ("pause", "follow robot", "charts"):
            tab.get_by_role("button", name=name, exact=True).click()
            before = tab.evaluate("replay.step")
            for key, change in (("ArrowRight", 1), ("ArrowLeft", 0), ("ArrowLeft", -1)):
                tab.keyboard.press(key)
                assert tab.evaluate("replay.step") == before + change
        tab.locator(".files input[type=text]").focus()
        before = tab.evaluate("replay.step")
        tab.keyboard.press("ArrowRight")  # moves in the text
        assert tab.evaluate("replay.step") == before
        assert watched.errors == []


@contextlib.contextmanager
def race(browser: Browser, page: Path, file: Path, scene: str, rate: str) -> Iterator[Watched]:
    """Yields a page where a race in a scene of the user's own has been asked for, its replay at a rate."""
    file.write_text(scene)
    with Watched(browser, page, viewport={"width": 1440, "height": 900}, reduced_motion="reduce") as watched:
        watched.page.locator("input[type=file]").set_input_files(file)
        watched.until(f"replay.world.name === '{file.stem}'")
        watched.page.locator(".large button").first.click()
        watched.page.get_by_label("speed of the replay").select_option(rate)
        yield watched


def test_a_hand_drives_on_to_a_second_place_far_beyond_the_first(
    browser: Browser, files: dict[str, Path], tmp_path: Path
) -> None:
    """In a user's own scene, once all others have ended: who comes nearer to the star is never out."""
    far = '{"start": [0, 0, 0], "waypoints": [[1, 0]], "goal": [11, 0, 0]}'
    with race(browser, files["demo"], tmp_path / "far.json", far, "4") as watched:
        tab = watched.page
        tab.keyboard.down("ArrowUp")
        watched.until("drive.hand.actor.x.at(-1) > 1")
        tab.keyboard.up("ArrowUp")
        tab.locator(".actors li", has_text="arrived").nth(2).wait_for()
        tab.keyboard.down("ArrowUp")
        tab.locator(".card").wait_for(timeout=60_000)
        tab.keyboard.up("ArrowUp")
        assert "Finished in" in tab.locator(".card").inner_text()
        tab.keyboard.press("r")
        tab.get_by_label("speed of the replay").select_option("8")
        tab.keyboard.press("ArrowUp")  # and who stands still has not driven off
        tab.locator(".card", has_text="Stopped after").wait_for(timeout=60_000)
        assert watched.errors == []


def test_all_within_a_metre_of_a_drawn_line_is_in_the_scene(browser: Browser, files: dict[str, Path]) -> None:
    """With a thing in its way: who leaves it is told to turn back, not to drive on, and how the run ended."""
    with Watched(browser, files["demo"], viewport={"width": 1440, "height": 900}, reduced_motion="reduce") as watched:
        tab = watched.page
        tab.get_by_role("button", name="Draw a path").click()
        cx, cy = tab.evaluate("replay.view.centre")
        drag(tab, [[cx + x, cy + y] for x, y in ((-1.5, 0), (-1, 0), (-0.5, 0), (0, 0), (0, 0.5), (0, 1), (0, 1.5))])
        assert "grey band is the allowed width: leave it and the run ends." in tab.locator(".hint").first.inner_text()
        watched.until(f"replay.world.kind === 'path' && {DRIVEN}")
        listed = tab.locator(".side .actors")
        kinds = tab.locator(".side > .note").nth(1).inner_text()
        assert [f"{each}: " in kinds for each in ("Tuned", "hand-tuned", "paper's gains")] == [
            f", {each}\n" in listed.inner_text() for each in ("tuned", "hand-tuned", "paper's gains")
        ]
        off = [float(each) for each in re.findall(r"typically ([\d.e-]+) mm off", listed.inner_text())]
        assert len(off) > 2
        assert off == sorted(off)  # who keeps to the line best is the first
        count = tab.evaluate("drive.runs.length")
        tab.locator(".large button").first.click()
        assert "Stay on the grey band" in tab.locator(".sentence").inner_text()
        for off, out in ((0.95, False), (1.05, True)):  # m below the line, where no edge is drawn
            place = f"{{ pose: [{cx - 1}, {cy - off}, 0], world: replay.world }}"
            assert tab.evaluate(f"{cy - off} < drive.hand.field[1] && drive.outside(drive.hand, {place})") is out
        tab.get_by_role("button", name="Put things in its way").click()
        told = f"Your line followers ({count}) cannot dodge, so {tab.evaluate('drive.runs.length')} robots that can"
        assert told in tab.locator(".words .hint").first.inner_text()
        drag(tab, [[cx, cy + 0.8], [cx + 0.1, cy + 0.8]])
        watched.until(f"replay.world.obstacles.length === 1 && {DRIVEN}")
        assert "short cuts" in tab.locator(".scenes > .note").first.inner_text()
        by_hand(tab)
        assert "Drive through the rings" in tab.locator(".sentence").inner_text()
        tab.get_by_label("speed of the replay").select_option("2")
        tab.keyboard.down("ArrowUp")  # straight on, where the line turns
        for off, out in (
            (0.95, False),
            (1.05, True),
        ):  # m beside the line, both beyond what the picture showed at first
            place = f"{{ pose: [{cx + off}, {cy}, 0], world: replay.world }}"
            assert tab.evaluate(f"{cx + off} > drive.hand.field[2] && drive.outside(drive.hand, {place})") is out
        watched.until(f"drive.hand.actor.x.at(-1) > {cx + 1.1}")
        tab.keyboard.up("ArrowUp")
        tab.locator(".sentence", has_text="out of the scene: turn back").wait_for()
        tab.locator(".card", has_text="out of the scene").wait_for(timeout=60_000)
        assert "Drove off after" in tab.locator(".card").inner_text()
        assert tab.evaluate("replay.edge") is None  # it would cross the band
        assert watched.errors == []


def test_what_is_said_of_the_end_of_runs_goes_with_it_and_is_what_they_are_sorted_by(
    browser: Browser, files: dict[str, Path]
) -> None:
    with Watched(browser, files["demo"], viewport={"width": 1440, "height": 900}) as watched:
        tab = watched.page
        hint, caption = tab.locator(".words .hint").first, tab.locator(".side > .note").first
        tab.get_by_role("button", name="Put things in its way").click()
        x, y, _ = tab.evaluate("replay.world.goal")
        drag(tab, [[x + 1.5, y + 1.5], [x + 1.6, y + 1.5]])
        tab.evaluate("drive.add({ label: 'vfh_plus' }); drive.add({ label: 'dwa' }); drive.pump(20000)")
        for _ in range(2):  # and when it is looked at again
            tab.evaluate("replay.toggle(false); replay.seek(replay.last)")
            assert " of 3 arrived. Click or tap" in hint.inner_text()
            tab.evaluate("replay.seek(Math.floor(replay.last / 2))")
            assert "arrived" not in hint.inner_text()
            tab.evaluate("replay.seek(0)")
            assert "arrived" not in hint.inner_text()
        assert caption.inner_text() == "The fastest comes first."
        tab.evaluate("replay.seek(replay.last)")
        tab.get_by_role("button", name="move", exact=True).click()  # what one does next is told instead
        assert "Drag things" in hint.inner_text()
        tab.get_by_role("button", name="Draw a path").click()
        cx, cy = tab.evaluate("replay.view.centre")
        drag(tab, [[cx - 1, cy], [cx, cy + 0.3], [cx + 1, cy]])
        watched.until(f"replay.world.kind === 'path' && {DRIVEN}")
        tab.evaluate("replay.toggle(false); replay.seek(replay.last)")
        assert re.search(r"Closest to your line: .+ typically (\d\.\d\d|\d\d(\.\d)?|\d{3,}) mm off", hint.inner_text())
        assert caption.inner_text() == "The closest to the line comes first."
        tab.evaluate("replay.seek(1)")
        assert "Closest to your line" not in hint.inner_text()
        by_hand(tab)
        tab.evaluate(FINISHED, 60.0)
        tab.keyboard.press("Escape")
        tab.evaluate("replay.stretch(); replay.seek(replay.last)")
        times = [float(each) for each in re.findall(r"arrived, ([\d.]+) s", tab.locator(".side .actors").inner_text())]
        assert len(times) == tab.evaluate("drive.runs.length") - 1  # all but the hand, whose end is made up
        assert times == sorted(times)
        assert caption.inner_text() == "The fastest comes first."
        assert "Closest" not in tab.locator(".words").inner_text()
        assert watched.errors == []


@pytest.mark.parametrize(("width", "height"), [(1440, 900), (1024, 768), (390, 844)])
def test_a_line_of_text_that_comes_or_goes_moves_nothing(
    browser: Browser, files: dict[str, Path], width: int, height: int
) -> None:
    size: Any = {"width": width, "height": height}
    with Watched(browser, files["demo"], viewport=size) as watched:
        tab = watched.page
        tab.evaluate("drive.clear(); for (const label of ['dwa', 'vfh_plus']) drive.add({ label })")
        tab.evaluate("replay.split(replay.actors[0]); drive.pump(20000); replay.toggle(false)")
        tops = "[replay.canvas, replay.bar, drive.choice, replay.list, replay.scenario].map((each) => each.offsetTop)"
        before = tab.evaluate(tops)
        assert tab.locator(".side > .note").first.inner_text() == "At the end the fastest comes first."
        tab.evaluate("replay.seek(replay.last)")
        assert tab.locator(".side > .note").first.inner_text() == "The fastest comes first."
        assert tab.evaluate(tops) == before
        tab.evaluate("replay.seek(20); drive.looks.turn(true)")
        tab.locator(".hint", has_text="What is drawn").wait_for()
        settled(tab)
        assert tab.evaluate(tops) == before
        tab.evaluate("drive.result.textContent = WAITS")
        assert tab.evaluate(tops) == before
        for label in ("vfh_plus (hand-tuned)", "ppo (trained)", "smooth_pose"):  # told in one line or two
            tab.get_by_label("another robot").select_option(label)
            assert tab.evaluate(tops) == before
        assert watched.errors == []


def test_the_list_of_controllers_begins_with_the_best_and_is_searched_by_letters(
    browser: Browser, files: dict[str, Path]
) -> None:
    with Watched(browser, files["demo"], reduced_motion="reduce") as watched:
        tab = watched.page
        first = tab.locator("[aria-label='another robot'] optgroup").first
        shown = first.locator("option").evaluate_all("(found) => found.map((each) => each.value.split(' ')[0])")
        assert shown == demo.BEST["goal"]
        names = tab.evaluate("[...drive.who.options].map((each) => each.textContent)")
        assert len(set(names)) == len(names)
        assert sorted(tab.evaluate("[...drive.who.options].map((each) => each.value)")) == sorted(
            tab.evaluate("drive.able()")
        )
        tab.get_by_label("another robot").focus()
        tab.keyboard.type("dyna")
        assert tab.evaluate("drive.who.value.split(' ')[0]") == "dwa"


def test_who_passes_the_ring_is_told_by_how_much(browser: Browser, files: dict[str, Path], tmp_path: Path) -> None:
    beside = '{"start": [0, 0, 0], "goal": [1.5, 0.3, 0], "position_tolerance": 0.2}'
    with race(browser, files["demo"], tmp_path / "beside.json", beside, "8") as watched:
        tab = watched.page
        tab.keyboard.down("ArrowUp")
        tab.locator(".card", has_text="You passed 10 cm from the ring").wait_for(timeout=60_000)
        tab.keyboard.up("ArrowUp")
        assert watched.errors == []


def test_keys_that_are_held_when_a_run_ends_leave_the_film_alone_until_they_come_down_anew(
    browser: Browser, files: dict[str, Path], tmp_path: Path
) -> None:
    near = '{"start": [0, 0, 0], "goal": [1.5, 0, 0]}'
    with race(browser, files["demo"], tmp_path / "near.json", near, "4") as watched:
        tab = watched.page
        for _ in range(2000):
            tab.keyboard.down("ArrowUp")  # the first press; then it is held, and repeats
            if tab.evaluate("drive.hand.actor.outcome"):
                break
        tab.evaluate("replay.toggle(false); replay.seek(9)")
        for key in ("ArrowUp", "ArrowLeft", "ArrowLeft"):
            tab.keyboard.down(key)
        assert tab.evaluate("replay.step") == 9
        mine = tab.locator(".actors li", has_text="you").inner_text()
        assert "arrived" in mine
        assert "driving" not in mine
        tab.keyboard.up("ArrowLeft")
        tab.keyboard.up("ArrowUp")
        tab.wait_for_timeout(1600)
        tab.keyboard.press("ArrowLeft")
        assert tab.evaluate("replay.step") == 8
        assert watched.errors == []


# ends the race by hand after some seconds, and returns the card
FINISHED = """(time) => {
  const { hand: run, race } = drive;
  for (const name of ["x", "y", "heading"]) run.actor[name] = Array(Math.round(time / DT) + 1).fill(0);
  [run.actor.outcome, run.tape] = ["success", run.actor.x.slice(1)];
  race.over(run);
  return race.card.innerText;
}"""


def test_gold_is_the_quickest_controller_bronze_a_quarter_more_and_silver_half_way(
    browser: Browser, files: dict[str, Path]
) -> None:
    with Watched(browser, files["demo"], viewport={"width": 1440, "height": 900}, reduced_motion="reduce") as watched:
        tab = watched.page
        tab.evaluate("drive.race.open(0)")
        watched.until(DRIVEN.replace("=>", "=> run === drive.hand ||"))
        times = tab.evaluate("drive.runs.filter((run) => !run.pending).map(({ actor }) => (actor.x.length - 1) * DT)")
        gold, silver, bronze = tab.evaluate("drive.race.limits")
        assert gold == min(times[:-1])
        assert bronze == math.ceil(round(1.25 * gold, 6))
        assert silver == pytest.approx(0.5 * (gold + bronze), abs=0.05)
        told = [f"{each:.2f}\N{NO-BREAK SPACE}s" for each in (gold, silver, bronze)]
        assert all(each in tab.locator(".sentence").inner_text() for each in told)
        # a time of one's own, and its medal
        pairs = zip(
            (gold, silver, bronze, 60.0), ("Gold medal", "Silver medal", "Bronze medal", "No medal"), strict=True
        )
        for time, medal in pairs:
            card = tab.evaluate(FINISHED, math.floor(time / 0.05 + 1e-6) * 0.05)
            assert medal in card
            assert ("within the limit for" in card) == (medal in ("Silver medal", "Bronze medal"))
            assert all(each in card for each in [*told, "1.25"])


def test_who_stands_still_to_the_end_is_stuck_since_then_in_the_list_and_one_thing_scrolls(
    browser: Browser, files: dict[str, Path]
) -> None:
    with Watched(browser, files["demo"], viewport={"width": 1280, "height": 800}, reduced_motion="reduce") as watched:
        tab = watched.page
        tab.evaluate("drive.all()")
        tab.evaluate("""() => {
          drive.editor.change((world) => {
            const { start: [ax, ay], goal: [bx, by] } = world;
            const far = Math.hypot(bx - ax, by - ay);
            const middle = [0.5 * (ax + bx), 0.5 * (ay + by)];
            world.obstacles = [[...middle, (bx - ax) / far, (by - ay) / far, 0.1, 50, 0, 0]]; // no way around
          });
          drive.changed(true);
          drive.pump(60000);
          replay.seek(replay.last);
        }""")
        stuck = tab.evaluate(
            "replay.actors.filter(({ outcome }) => outcome === 'stuck').map(({ x, y, end }) => [[...x], [...y], end])"
        )
        assert stuck
        for x, y, end in stuck:
            since = 0.0 if end == "finds no way wide enough" else float(end.removesuffix(" s").split("since ")[1])
            away = np.hypot(np.array(x) - x[-1], np.array(y) - y[-1]) >= ROBOTS["p3dx"].hull_radius
            assert np.max(np.flatnonzero(away) + 1, initial=0) * 0.05 == pytest.approx(since)
            assert tab.locator(".actors small", has_text=end).count() > 0
        scrolls = """[...document.querySelectorAll(".side *")].filter((each) =>
          each.scrollHeight > each.clientHeight + 1 && /auto|scroll/.test(getComputedStyle(each).overflowY)).length"""
        assert tab.evaluate(f"[{scrolls}, replay.list.children.length > 8]") == [0, True]
        assert watched.errors == []


def test_the_hand_is_seen_among_robots_on_the_same_spot(browser: Browser, files: dict[str, Path]) -> None:
    with Watched(browser, files["demo"], viewport={"width": 1280, "height": 800}, reduced_motion="reduce") as watched:
        tab = watched.page
        by_hand(tab)
        tab.evaluate("replay.choose(replay.actors[0])")  # one that stands there too
        nose = """() => {
          const { context, centre: [cx, cy], pixels, ratio, width, height } = replay.view;
          const { x, y } = drive.hand.actor;
          const at = [ratio * (width / 2 + (x[0] - cx) * pixels), ratio * (height / 2 - (y[0] - cy) * pixels)];
          const [red, green, blue] = context.getImageData(...at.map(Math.round), 1, 1).data;
          return [red, green, blue].map((each) => each.toString(16).padStart(2, "0")).join("");
        }"""
        assert f"#{tab.evaluate(nose)}" == tab.evaluate("ink(colourName(KEYBOARD))")


def test_a_best_time_is_shown_and_an_easier_run_is_marked_and_is_none(browser: Browser, files: dict[str, Path]) -> None:
    with Watched(browser, files["demo"], viewport={"width": 1440, "height": 900}, reduced_motion="reduce") as watched:
        tab = watched.page
        straight = """() => {
          replay.world.obstacles.length = 1;
          drive.begin(drive.hand, true);
          drive.twistByHand = ({ pose: [x, y, heading], world: { goal } }) => {
            const off = Math.atan2(goal[1] - y, goal[0] - x) - heading;
            const turn = Math.atan2(Math.sin(off), Math.cos(off));
            return [Math.abs(turn) < 0.5 ? 0.6 : 0, 0, 2 * turn];
          };
        }"""

        def raced(*rates: float) -> str:
            tab.evaluate("drive.race.open(0)")
            tab.evaluate(straight)
            tab.keyboard.press("ArrowUp")
            for rate in rates:
                tab.evaluate("(rate) => replay.pace(rate)", rate)
                tab.wait_for_timeout(200)
            watched.until(f"drive.hand.actor.outcome === 'success' && {DRIVEN}")
            return tab.locator(".card").inner_text()

        challenge = tab.get_by_label("challenge", exact=True)
        before = challenge.inner_text()
        assert "not count as a best time" in raced(0.5, 8)
        assert challenge.inner_text() == before
        assert "Your first finish" in raced(8)
        best = f"{tab.evaluate('drive.hand.tape.length * DT'):.2f} s"
        assert best in challenge.inner_text()
        told = raced(0.5, 8)
        assert "half speed" in told
        assert f"Your best: {best}" in told.replace("\N{NO-BREAK SPACE}", " ")
        assert best in challenge.inner_text()
        # the link says so too; who loads the page again is no friend
        other = watched.context.new_page()
        other.goto(taken(tab, "Copy a link to race this run"))
        other.evaluate("ready")
        tab.reload()
        tab.evaluate("ready")
        for page_of, who in ((other, "A friend"), (tab, "You")):
            assert page_of.locator(".card").inner_text().startswith(who)
            assert page_of.get_by_role("button", name=f"Race your {'last run' if who == 'You' else 'friend'}").count()
            assert "half speed" in page_of.locator(".card").inner_text()
        tab.get_by_role("link", name="demo").click()  # the title leads back
        assert tab.locator(".card").is_hidden()
        assert watched.errors == []


def box_of(tab: Page, what: str) -> tuple[float, float, float, float]:
    """Returns left, top, right and bottom of a button, by its name, or of the picture."""
    found = tab.locator(what).first if what[0] == "." else tab.get_by_role("button", name=what, exact=True)
    box = found.bounding_box()
    assert box is not None
    return box["x"], box["y"], box["x"] + box["width"], box["y"] + box["height"]


def inside(box: tuple[float, ...], frame: tuple[float, ...]) -> bool:
    """Whether a box lies in a frame: left, top, right, bottom."""
    return box[0] >= frame[0] and box[1] >= frame[1] and box[2] <= frame[2] and box[3] <= frame[3]


class Fingers:
    """Fingers on a page, each by a number."""

    def __init__(self, watched: Watched) -> None:
        self.session = watched.context.new_cdp_session(watched.page)
        self.down: dict[int, tuple[float, float]] = {}

    def put(self, finger: int, x: float, y: float) -> None:
        """Puts a finger down, or moves it."""
        kind = "touchMove" if finger in self.down else "touchStart"
        self.down[finger] = (x, y)
        self.send(kind, self.down)

    def lift(self, finger: int) -> None:
        """Takes a finger away."""
        self.send("touchEnd", {finger: self.down.pop(finger)} if len(self.down) > 1 else {})
        self.down.pop(finger, None)

    def send(self, kind: str, fingers: dict[int, tuple[float, float]]) -> None:
        """Sends what the browser is told."""
        points = [{"x": x, "y": y, "id": finger} for finger, (x, y) in fingers.items()]
        self.session.send("Input.dispatchTouchEvent", {"type": kind, "touchPoints": points})


def settled(tab: Page) -> None:
    """Waits some frames, however long they take: what has another size is laid out and drawn anew."""
    for _ in range(4):
        tab.evaluate("() => new Promise((done) => requestAnimationFrame(() => setTimeout(done, 0)))")


@pytest.mark.parametrize(("width", "height", "held"), [(390, 844, "ahead"), (844, 390, "back")])
def test_a_finger_that_stays_down_ends_a_race_on_a_card(
    browser: Browser, files: dict[str, Path], width: int, height: int, held: str
) -> None:
    """And the robot is in the picture all the way, also off the field; pad, picture and card are in one view."""
    size: Any = {"width": width, "height": height}
    with Watched(browser, files["demo"], viewport=size, has_touch=True, reduced_motion="reduce") as watched:
        tab = watched.page
        tab.locator(".large button").first.click()
        settled(tab)
        left, top, right, bottom = picture = box_of(tab, ".board canvas")
        pad = [box_of(tab, each) for each in ("left", "ahead", "right", "back")]
        assert all(x1 <= left or right <= x0 or y1 <= top or bottom <= y0 for x0, y0, x1, y1 in pad)
        assert all(inside(each, (0, 0, width, height)) for each in [*pad, picture])
        # before the clock starts all that there is to drive around is seen
        beyond = """(({ world, view: { centre, width, height, pixels } }) => [...world.obstacles, world.goal].filter(
          ([x, y]) => Math.abs(x - centre[0]) * pixels > width / 2 || Math.abs(y - centre[1]) * pixels > height / 2
        ).length)(replay)"""
        assert tab.evaluate(beyond) == 0
        tab.evaluate("() => { replay.world.obstacles = []; replay.pace(8); drive.begin(drive.hand, true); }")
        fingers = Fingers(watched)
        left, top, *_ = box_of(tab, held)
        fingers.put(0, left + 20, top + 20)
        seen = """(({ view, chosen: { x, y } }) => [(x.at(-1) - view.centre[0]) * view.pixels / view.width,
                   (y.at(-1) - view.centre[1]) * view.pixels / view.height])(replay)"""
        for _ in range(20_000):
            assert max(map(abs, tab.evaluate(seen))) < 0.5
            if tab.evaluate("drive.hand.actor.outcome"):
                break
        fingers.lift(0)
        settled(tab)
        assert tab.evaluate("drive.hand.actor.outcome")
        # no button is where the thumb was, and a press that began before there was a card is none of it
        thumb = (left + 20, top + 20)
        for each in ("Try again", "Copy a link to race this run"):
            x0, y0, x1, y1 = box_of(tab, each)
            assert not (x0 <= thumb[0] <= x1 and y0 <= thumb[1] <= y1)
        again = tab.get_by_role("button", name="Try again")
        again.dispatch_event("click", {"detail": 1})
        assert tab.locator(".card").is_visible()
        if held == "back":  # away from the star: that ends soon
            assert tab.evaluate("[drive.hand.actor.outcome, drive.hand.tape.length < 400]") == ["left", True]
        left, top, right, bottom = picture = box_of(tab, ".board canvas")
        for each in ("Try again", "Copy a link to race this run", "close", ".card"):
            x0, y0, x1, y1 = box = box_of(tab, each)
            assert inside(box, (0, 0, width, height))
            assert x1 <= left or right <= x0 or y1 <= top or bottom <= y0
        shown = """() => {
          const box = replay.canvas.getBoundingClientRect();
          const { centre: [cx, cy], pixels, width, height } = replay.view;
          const { x, y } = drive.hand.actor;
          return [replay.world.goal, [x.at(-1), y.at(-1)]].map(([a, b]) =>
            [box.left + width / 2 + (a - cx) * pixels, box.top + height / 2 - (b - cy) * pixels]);
        }"""
        for x, y in tab.evaluate(shown):  # the star and the robot
            assert inside((x, y, x, y), picture)
        tab.keyboard.press("Escape")
        assert tab.locator(".card").is_hidden()
        tab.evaluate("drive.race.open(0)")
        settled(tab)
        sizes = "[[view.width, view.height], [canvas.width, canvas.height], [canvas.clientWidth, canvas.clientHeight]]"
        drawn, pixels, shown = tab.evaluate(f"(({{ view, canvas }}) => {sizes})(replay)")
        assert drawn == pixels == shown  # nothing is stretched
        assert watched.errors == []


def test_two_fingers_zoom_the_picture_and_drive_by_the_pad(browser: Browser, files: dict[str, Path]) -> None:
    size: Any = {"width": 390, "height": 844}
    with Watched(browser, files["demo"], viewport=size, has_touch=True, is_mobile=True) as watched:
        tab, fingers = watched.page, Fingers(watched)
        tab.get_by_role("button", name="Put things in its way").tap()
        x0, y0, x1, y1 = box_of(tab, ".board canvas")
        x, y = (x0 + x1) / 2, (y0 + y1) / 2
        before = tab.evaluate("replay.world.obstacles.length")
        fingers.put(0, x - 20, y)
        fingers.put(1, x + 20, y)
        for far in range(20, 100, 10):
            fingers.put(0, x - far, y - far)
            fingers.put(1, x + far, y + far)
        fingers.lift(1)
        fingers.lift(0)
        assert tab.evaluate("replay.view.zoom") > 2.0
        assert tab.evaluate("[replay.world.obstacles.length, scrollY, visualViewport.scale]") == [before, 0, 1]
        tab.locator(".large button").first.tap()
        tab.evaluate("() => { replay.world.obstacles = []; drive.begin(drive.hand, true); }")
        twist = "drive.twistByHand(drive.hand.simulator)"
        ahead, right = ((box[0] + 20, box[1] + 20) for box in (box_of(tab, "ahead"), box_of(tab, "right")))
        fingers.put(0, *ahead)
        fingers.put(1, *right)
        both = tab.evaluate(twist)
        assert both[0] > 0.0
        assert both[2] < 0.0
        for k in range(8):  # one of them goes astray
            fingers.put(1, x, y - 10 * k)
        fingers.lift(1)
        assert tab.evaluate(f"[...{twist}, drive.hand.actor.outcome]") == [both[0], 0, 0, ""]
        fingers.put(0, *right)  # the other slides
        watched.until(f"String({twist}) === '0,0,{both[2]}'")
        fingers.lift(0)
        assert tab.evaluate(f"[...{twist}, scrollY]") == [0, 0, 0, 0]
        assert watched.errors == []


def test_every_click_puts_a_thing_and_every_drag_draws_a_path(browser: Browser, files: dict[str, Path]) -> None:
    with Watched(browser, files["demo"], viewport={"width": 1280, "height": 900}) as watched:
        tab = watched.page
        tab.get_by_role("button", name="Put things in its way").click()
        before = tab.evaluate("replay.world.obstacles.length")
        x, y = tab.evaluate("replay.view.centre")
        for count in range(3):
            drag(tab, [[x + 0.3 * count, y]])
            assert tab.evaluate("replay.world.obstacles.length") == before + count + 1
            assert tab.evaluate("replay.playing || replay.step < replay.last")
            watched.until(DRIVEN)
            tab.evaluate("replay.seek(replay.last)")  # the run is over: the next click starts it again
            watched.until("!replay.playing")
        tab.get_by_role("button", name="undo last").click()
        assert tab.evaluate("replay.world.obstacles.length") == before + 2
        drag(tab, [[x + 1.0, y], [x + 1.1, y]])  # a short drag puts a larger one than a click
        clicked, dragged = tab.evaluate("replay.world.obstacles.slice(-2).map((each) => each[6])")
        assert dragged > clicked
        tab.get_by_role("button", name="Draw a path").click()
        for side in (1.5, -1.5):
            drag(tab, [[0.0, 0.0], [side, 0.5], [2.0 * side, 0.0]])
            watched.until(f"replay.world.kind === 'path' && {DRIVEN}")
            assert (tab.evaluate("replay.world.path.at(-1)[0]") > 0.0) == (side > 0.0)
        # what stands in its way keeps the line: all that avoid things drive along it
        line = tab.evaluate("replay.world.path")
        tab.get_by_role("button", name="Put things in its way").click()
        drag(tab, [line[len(line) // 2]])
        watched.until(DRIVEN)
        assert tab.evaluate("[replay.world.path, replay.world.obstacles.length]") == [line, 1]
        ends = tab.evaluate("drive.runs.map((run) => [run.actor.outcome, run.measures.clearance > 0])")
        assert ends == [["success", True]] * 3
        same_in_python(tab, tab.evaluate("replay.chosen.policy"))
        tab.locator(".large button").first.click()  # who goes on ends the tool
        assert tab.evaluate("[drive.editor.tool, replay.hint.hidden]") == [None, True]
        assert watched.errors == []


def test_the_chosen_policy_goes_first_and_all_stand_at_the_start(browser: Browser, files: dict[str, Path]) -> None:
    with Watched(browser, files["demo"], reduced_motion="reduce") as watched:
        tab = watched.page
        begun = """() => {
          picks.restore({ family: 'team: doorway_4', seed: 0 });
          drive.clear();
          for (const label of ['scan_planner', 'dwa', 'orca_team']) drive.add({ label }, label === 'scan_planner');
          return drive.runs.map(({ actor }) => [actor.x.length, ...actor.others.map(({ x }) => x.length)]);
        }"""
        assert tab.evaluate(begun) == [[1, 1, 1, 1]] * 3
        tab.evaluate("drive.pump(1); replay.choose(drive.runs[2].actor); drive.pump(20000)")
        first = """() => {
          drive.changed();
          while (!replay.chosen.outcome) drive.pump(1);
          return drive.runs.filter(({ actor }) => actor.outcome).map((run) => run.asked.label);
        }"""
        assert tab.evaluate(first) == ["orca_team"]
        # no moment is shown that one of those who race has not come to
        tab.get_by_role("button", name="watch all").click()
        behind = "drive.runs.filter(({ actor, pending }) => pending && actor.x.length <= replay.step).length"
        while tab.evaluate("replay.step") < 40:
            assert tab.evaluate(f"[replay.playing, {behind}]") == [True, 0]
        assert watched.errors == []


def test_what_is_chosen_takes_effect_at_once_and_who_drives_goes_on(browser: Browser, files: dict[str, Path]) -> None:
    with Watched(browser, files["demo"], viewport={"width": 1440, "height": 900}, reduced_motion="reduce") as watched:
        tab = watched.page
        tab.evaluate("drive.clear(); for (const label of ['vfh_plus', 'dwa']) drive.add({ label })")
        tab.evaluate("drive.gains.offer(); drive.gains.set('max_speed', 0.5); replay.split(replay.actors[0])")
        watched.until(DRIVEN)
        who = "[drive.runs.map(({ actor }) => replay.nameOf(actor)), replay.other.policy, replay.chosen.policy]"
        before, calm = tab.evaluate(who), tab.evaluate(POSES)
        # motors and disturbance, for those who drive and for those who race the hand
        same = "drive.runs.every((run) => JSON.stringify(run.asked.conditions) === JSON.stringify(drive.conditions()))"
        for label, value in (("motors", "slow"), ("disturbance", "severe")):
            tab.get_by_label(label, exact=True).select_option(value)
            assert tab.evaluate(f"[{same}, {who}, drive.conditions()[{json.dumps(label)}] ?? 'slow']") == [
                True,
                before,
                value,
            ]
            watched.until(DRIVEN)
            assert tab.evaluate(POSES) != calm
            calm = tab.evaluate(POSES)
        by_hand(tab)
        assert tab.evaluate(f"[{same}, drive.runs.length > 3]") == [True, True]
        tab.get_by_label("disturbance", exact=True).select_option("none")
        assert tab.evaluate(f"[{same}, drive.drives, drive.hand.tape.length]") == [True, True, 0]
        tab.keyboard.press("Escape")
        # another scene keeps them and their pictures, where they can drive; who cannot is told
        tab.evaluate(
            "drive.endHand(); replay.actors.forEach((each) => /astar|ppo/.test(each.policy) && replay.takeOut(each))"
        )
        tab.evaluate("replay.choose(drive.runs.find(({ asked }) => asked.label === 'dwa').actor)")
        tab.evaluate("replay.split(drive.runs.find(({ asked }) => asked.label === 'vfh_plus').actor)")
        scenes = tab.evaluate("[...picks.family.options].map((each) => each.value)")
        here = tab.evaluate("picks.family.value")
        other = next(each for each in scenes if each.startswith("goal: ") and each != here)
        tab.get_by_label("scene", exact=True).select_option(other)
        assert tab.evaluate(who) == before
        tab.get_by_label("scene", exact=True).select_option(next(each for each in scenes if each.startswith("path: ")))
        assert "vector histogram and dynamic window cannot drive in this scene: " in tab.locator(".result").inner_text()
        assert watched.errors == []


def test_a_thing_that_is_moved_stays_in_the_picture_and_comes_back(browser: Browser, files: dict[str, Path]) -> None:
    with Watched(browser, files["demo"], viewport={"width": 1440, "height": 900}, reduced_motion="reduce") as watched:
        tab = watched.page
        tab.evaluate("drive.add({ label: 'dwa' }); drive.add({ label: 'vfh_plus' }); replay.split(replay.actors[0])")
        before = tab.evaluate("structuredClone(replay.world)")
        tab.get_by_role("button", name="move", exact=True).click()
        x, y, _ = before["goal"]
        drag(tab, [[x, y], [x + 1, y - 50]])
        left, bottom, right, top = tab.evaluate("""() => {
          const { width, height, pixels, centre: [x, y] } = replay.view;
          const [a, b] = [width / 2 / pixels, height / 2 / pixels];
          return [x - a, y - b, x + a, y + b];
        }""")
        x, y, _ = tab.evaluate("replay.world.goal")
        assert left < x < right
        assert bottom < y < top
        tab.get_by_role("button", name="disc", exact=True).click()
        drag(tab, [[0.5 * (left + right), 0.5 * (bottom + top)]])
        for count in (len(before["obstacles"]) + 1, len(before["obstacles"])):
            assert tab.evaluate("replay.world.obstacles.length") == count
            tab.get_by_role("button", name="undo last").click()
        assert tab.evaluate("[replay.world === drive.original, replay.world]") == [True, before]
        assert watched.errors == []


def test_each_policy_looks_the_same_in_every_tab_and_like_no_other(browser: Browser, files: dict[str, Path]) -> None:
    look = "[...new Set(Object.keys(drive.kernels.tables.pilots).map((key) => key.split(' ').slice(3).join(' ')))]"
    look += ".concat([KEYBOARD, FRIEND]).map((each) => [each, `${colourName(each)} ${dashOf(each)}`])"
    with Watched(browser, files["demo"], reduced_motion="reduce") as watched:
        first = dict(watched.page.evaluate(look))
        tab = watched.context.new_page()
        tab.goto(files["demo"].as_uri())
        tab.evaluate("ready")
        tab.evaluate("drive.able().reverse().forEach((label) => drive.add({ label }))")
        assert dict(tab.evaluate(look)) == first
        assert len(set(first.values())) == len(first)
        # the browser's Back leads from a part of the page to the one before
        tab.get_by_role("button", name="About", exact=True).click()
        tab.go_back()
        assert [tab.evaluate("document.body.dataset.tab"), tab.url] == ["replay", files["demo"].as_uri()]
        assert watched.errors == []


SETTINGS = 20
# a scene's kind, a policy, and what its robot's name may begin with: those that other settings may leave out
ALSO = (
    ("path", "ilqr", ""),
    ("goal", "hybrid", "omni"),
    ("goal", "any_robot", "p3dx"),
    ("goal", "", "jackal"),
    ("dock", "reeds_shepp_scan", "jackal"),
)


def test_runs_chosen_in_the_page_are_those_of_python(browser: Browser, files: dict[str, Path]) -> None:
    """As a user chooses them, by the lists and a button: all kinds of tasks, robots, motors and policies."""
    rng = random.Random(52)
    with Watched(browser, files["demo"], reduced_motion="reduce") as watched:
        tab = watched.page

        def choose(label: str, among: Any = None) -> str:
            box = tab.get_by_label(label, exact=True)
            values = box.evaluate(
                "(box) => [...box.options].filter((each) => !each.disabled).map((each) => each.value)"
            )
            value = rng.choice([each for each in values if among is None or among(each)])
            box.select_option(value)
            return str(value)

        kinds = [spec.kind for spec in IN_PAGE.values()]
        for kind, policy, robot in (*((kinds[k % len(kinds)], "", "") for k in range(SETTINGS)), *ALSO):
            told = [choose("scene", lambda each, kind=kind: each.startswith(f"{kind}: "))]
            told += [choose("robot", lambda each, robot=robot: each.startswith(robot)), choose("motors")]
            told.append(
                choose("another robot", lambda each, policy=policy: each.startswith(policy) and each[:4] != "you,")
            )
            tab.get_by_role("button", name="add this one").click()
            watched.until(DRIVEN)
            assert tab.evaluate("replay.chosen.policy") == told[-1]
            same_in_python(tab, told[-1])
        assert watched.errors == []


def test_a_link_to_the_demo_shows_what_it_is(monkeypatch: pytest.MonkeyPatch, browser: Browser, tmp_path: Path) -> None:
    monkeypatch.setenv(demo.SITE, "https://somebody.example/wayfield/")
    text = demo.page()
    address = "https://somebody.example/wayfield/demo"
    assert f'<meta property="og:image" content="{address}.png">' in text
    (tmp_path / "demo.html").write_text(text, encoding="utf-8")
    with Watched(browser, tmp_path / "demo.html", reduced_motion="reduce") as watched:
        assert taken(watched.page, "copy link").startswith(f"{address}.html#")
        race = watched.page.locator(".large button").first
        assert race.inner_text() == "Start easy: challenge 1"
        race.click()  # not among the 24 people of the opening
        assert "open field" in watched.page.locator(".numbers option:checked").inner_text()
        watched.page.evaluate("drive.race.nth = 0; drive.race.keep(9, 'bronze')")
        watched.page.get_by_role("link", name="wayfield").click()
        assert race.inner_text() == "Go on: challenge 2"
        watched.page.get_by_role("button", name="race this scene (challenge 11)").click()
        assert watched.page.evaluate("[drive.drives, replay.world.bodies.length, drive.race.now]") == [True, 24, 10]
        watched.page.get_by_role("link", name="wayfield").click()
        race.click()
        assert "2. wide door" in watched.page.locator(".numbers option:checked").inner_text()
        assert [each for each in watched.requests if each.startswith("http")] == []


def test_a_scene_that_a_link_holds_plays_and_keeps_what_was_put_there(browser: Browser, files: dict[str, Path]) -> None:
    with Watched(browser, files["demo"], viewport={"width": 1440, "height": 900}) as watched:
        tab = watched.page
        tab.get_by_role("button", name="Put things in its way").click()
        x, y, _ = tab.evaluate("replay.world.goal")
        drag(tab, [[x + 0.8, y + 0.8], [x + 0.9, y + 0.8]])
        watched.until(f"replay.world.own === 1 && {DRIVEN}")
        tab.evaluate("replay.toggle(false); replay.seek(replay.last)")
        url = taken(tab, "copy link")
        with Watched(browser, files["demo"]) as other:
            other.page.locator(".files input[type=text]").fill(url)
            told = other.page.locator(".sentence").inner_text()
            assert "with a thing that a friend placed, came by a link" in told
            assert "play" not in told  # it plays
            other.until("replay.playing && replay.step > 3 && replay.step < replay.last")
            assert other.page.evaluate("replay.world.own") == 1


def test_what_is_shown_is_recorded(browser: Browser, files: dict[str, Path], tmp_path: Path) -> None:
    with Watched(browser, files["demo"], viewport={"width": 390, "height": 844}) as watched:
        watched.page.evaluate("drive.add({ label: 'vfh_plus' }); drive.pump(20000)")
        with watched.page.expect_download() as download:
            watched.page.get_by_role("button", name="record").click()
            watched.page.wait_for_timeout(1000)
            watched.page.evaluate("scrollTo(0, 1e5)")
            watched.page.get_by_role("button", name="stop recording").click()
        download.value.save_as(tmp_path / "film.webm")
        assert 0 < (tmp_path / "film.webm").stat().st_size < 3e6 / 4.0
        assert "wayfield.webm" in watched.page.locator(".noted").inner_text()
        assert inside(box_of(watched.page, ".noted"), (0, 0, 390, 844))  # wherever the page is scrolled to
        watched.page.evaluate("scrollTo(0, 0)")
        watched.page.evaluate("replay.pace(8); replay.seek(replay.last)")
        with watched.page.expect_download(timeout=60_000) as download:  # from its start to its end, by itself
            watched.page.get_by_role("button", name="record").click()
        assert watched.page.evaluate("replay.step === replay.last")
        download.value.save_as(tmp_path / "film.webm")
        made = watched.page.evaluate("bytes => picturesIn(bytes)", [*(tmp_path / "film.webm").read_bytes()])
        assert made > watched.page.evaluate("replay.last * DT / replay.rate * FILM.rate / 2")
        # a replay that ran goes on afterwards; so many seconds are left of the film
        watched.page.evaluate("replay.pace(1); replay.toggle(true)")
        with watched.page.expect_download(timeout=60_000):
            watched.page.get_by_role("button", name="record").click()
            left = int(watched.page.locator(".record").inner_text().split()[2])
            watched.page.wait_for_timeout(2000)
            assert 0 < int(watched.page.locator(".record").inner_text().split()[2]) < left
            watched.page.get_by_role("button", name="stop recording").click()
        assert watched.page.evaluate("[replay.playing, replay.step < replay.last]") == [True, True]
        watched.page.evaluate("replay.pace(8)")
        # another scene, or other motors, are no part of it
        watched.page.get_by_role("button", name="record").click()
        watched.until("replay.step > 3")
        with watched.page.expect_download(timeout=60_000):
            watched.page.get_by_label("motors").select_option("slow")
        watched.page.get_by_role("button", name="record", exact=True).wait_for()
        # while another part of the page is looked at, the film waits
        for name in ("record", "About"):
            watched.page.get_by_role("button", name=name, exact=True).click()
        watched.page.wait_for_timeout(500)
        before = watched.page.evaluate("replay.step")
        watched.page.wait_for_timeout(500)
        assert watched.page.evaluate("replay.step") == before < watched.page.evaluate("replay.last")
        with watched.page.expect_download(timeout=60_000):
            watched.page.get_by_role("button", name="Simulator", exact=True).click()
        assert watched.page.evaluate("replay.step === replay.last")
        # before the first press of a race it waits with the clock
        watched.page.set_viewport_size({"width": 1280, "height": 800})
        watched.page.locator(".large button").first.click()
        watched.page.get_by_role("button", name="record").click()
        watched.page.wait_for_timeout(500)
        assert watched.page.evaluate("[replay.playing, replay.step, drive.hand.tape.length]") == [False, 0, 0]
        watched.page.keyboard.down("ArrowUp")
        watched.until("drive.hand.tape.length > 10")
        watched.page.keyboard.up("ArrowUp")
        with watched.page.expect_download() as download:
            watched.page.get_by_role("button", name="stop recording").click()
        assert download.value.suggested_filename == "wayfield.webm"
        watched.page.locator(".noted", has_text="saved as wayfield.webm").wait_for()
        left, _, right, bottom = box_of(watched.page, ".noted")
        button = box_of(watched.page, ".record")  # the eye is there
        assert 0 <= button[1] - bottom < 20
        assert left <= button[0] <= button[2] <= right
        assert watched.errors == []


@pytest.mark.parametrize(
    ("changed", "told"),
    [
        (lambda text: text[:-40], "cut off or was changed"),
        (lambda text: text[9:], "cut off or was changed"),
        (lambda text: text.replace("%22v%22", "%22robot%22%3A%22p3dx%22%2C%22v%22"), 'field "robot" is there twice'),
        (lambda text: text.replace("%22v%22", "%22w%22%3A1%2C%22v%22"), 'field "w" is not known'),
        pytest.param(lambda text: text.replace("p3dx", "p3dy"), "robot is", marks=pytest.mark.slow),
        pytest.param(lambda text: text.replace("%22v%22%3A2", "%22v%22%3A9"), "version", marks=pytest.mark.slow),
    ],
)
def test_a_link_that_was_edited_is_a_sentence(
    browser: Browser, files: dict[str, Path], changed: Any, told: str
) -> None:
    with Watched(browser, files["demo"]) as watched:
        watched.page.evaluate("drive.clear(); drive.add({ label: 'vfh_plus' })")
        url = taken(watched.page, "copy link")
        head, _, tail = url.partition("#")
        driven = watched.page.evaluate(f"drive.pump(20000), {POSES}")
        watched.page.get_by_label("a friend's link").fill(f"{head}#{changed(tail)}")
        assert told in watched.page.get_by_role("status").filter(has_text="What was shown stays").inner_text()
        assert watched.page.evaluate(POSES) == driven
        other = watched.context.new_page()
        page_errors: list[str] = []
        other.on("pageerror", lambda error: page_errors.append(str(error)))
        other.goto(f"{head}#{changed(tail)}")
        other.evaluate("ready")
        assert told in other.locator("#problem").inner_text()
        assert other.evaluate("replay.world !== undefined")
        assert page_errors == []


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
        pytest.param('{"goal": [1, 2, 0], "gaol": 3}', "gaol", marks=pytest.mark.slow),
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
        assert offered == list(fitting("path_following"))
        for robot in offered:
            tab.evaluate(CHOSEN, robot)
            tab.evaluate("drive.clear(); drive.add({ label: 'vfh_plus' }); drive.pump(20000)")
            assert tab.evaluate("drive.runs[0].actor.robot") == robot
            assert tab.evaluate(MOVED) > 0.05
            # it is drawn as large as it is
            assert tab.evaluate("HULLS[replay.robot]") == pytest.approx(ROBOTS[robot].hull_radius)
        assert watched.errors == []


@pytest.mark.slow
def test_docking_is_driven_by_laws_and_by_hand_up_to_the_wall_for_every_hull(
    browser: Browser, files: dict[str, Path], tmp_path: Path
) -> None:
    with Watched(browser, files["demo"]) as watched:
        tab = watched.page
        tab.get_by_label("scene", exact=True).select_option("dock: wall")
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
        by_hand(tab)
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
        assert watched.page.evaluate("(tellHull('box', [0.4, 0.8, -0.1]), HULLS.box)") == 0.5


@pytest.mark.parametrize(
    ("without", "told"),
    [
        ("delete globalThis.WebAssembly", "no WebAssembly"),
        ("HTMLCanvasElement.prototype.getContext = () => null", "no pictures"),
    ],
)
def test_what_a_browser_lacks_is_told(browser: Browser, files: dict[str, Path], without: str, told: str) -> None:
    context = browser.new_context()
    context.add_init_script(without)
    tab = context.new_page()
    tab.goto(files["demo"].as_uri())
    tab.evaluate("ready")
    assert told in tab.locator("#problem").inner_text()
    context.close()


def test_a_slider_changes_the_run_and_python_drives_the_same(browser: Browser, files: dict[str, Path]) -> None:
    with Watched(browser, files["demo"], viewport={"width": 1280, "height": 900}) as watched:
        tab = watched.page
        tab.evaluate(
            "drive.clear(); drive.who.value = 'vfh_plus'; drive.chosenPolicy(); drive.go(false); drive.pump(20000)"
        )
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


LOOKED = "drive.looks.sides[0].shadow && drive.looks.sides[0].shadow.kept.get(replay.step)"


def looked_at(watched: Watched, task: str, label: str, step: int) -> Any:
    """Returns what the overlay of a policy draws at a step of its run, with the run's pose there."""
    tab = watched.page
    kind = TASKS[task].kind
    family = tab.evaluate("(kind) => [...picks.families.keys()].find((each) => each.startsWith(`${kind}: `))", kind)
    tab.evaluate("(family) => { replay.toggle(false); picks.restore({ family, seed: 0 }); drive.clear(); }", family)
    tab.evaluate("(label) => { drive.add({ label }); drive.pump(20000); }", label)
    tab.evaluate("async (step) => { await drive.looks.turn(true); replay.seek(step); }", step)
    watched.until(f"Boolean({LOOKED})")
    told = f"""(({{numbers, places, shape, twist}}) =>
      ({{shape, numbers: [...numbers], places: places && [...places], twist}}))({LOOKED})"""
    pose = tab.evaluate("['x', 'y', 'heading'].map((name) => replay.chosen[name][replay.step])")
    return tab.evaluate(told) | {"pose": pose}


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
        # ORCA: what is driven keeps its half-planes, and of what keeps them is the nearest to what is wanted
        moments = (looked_at(watched, "goal_reaching", "orca", step) for step in range(25, 250, 25))
        seen = (np.array(found["numbers"], float).reshape(found["shape"]) for found in moments)
        rows = next(each for each in seen if np.isfinite(each[0, 0]))
        planes, wanted, driven, most = rows[:-2], rows[-2, :2], rows[-2, 2:], rows[-1, 0]
        planes = planes[np.isfinite(planes[:, 0])]
        np.testing.assert_allclose(np.hypot(*planes[:, :2].T), 1.0, rtol=1e-12)
        spread = np.random.default_rng(0).uniform(-most, most, (2000, 2))
        kept = (np.hypot(*spread.T) <= most) & (spread @ planes[:, :2].T >= planes[:, 2]).all(axis=1)
        assert kept.any()
        assert (planes[:, :2] @ driven >= planes[:, 2] - 1e-9).all()
        assert math.hypot(*driven) <= most + 1e-9
        assert math.dist(driven, wanted) <= np.hypot(*(spread[kept] - wanted).T).min()
        # MPPI: plans begin at the robot, and what is driven is their mean
        found = looked_at(watched, "goal_reaching", "mppi", 25)
        rollouts = np.array(found["numbers"], float).reshape(found["shape"])
        assert np.hypot(*rollouts[:, 1].T).max() < 0.1  # a tenth of a second on
        assert (rollouts[:-1, 0, 0] >= 0.0).all()
        assert watched.errors == []


def test_teams_and_people_are_driven_by_laws_by_hand_and_by_python(browser: Browser, files: dict[str, Path]) -> None:
    with Watched(browser, files["demo"], viewport={"width": 1280, "height": 900}) as watched:
        tab = watched.page
        for family, label in (("team: doorway_4", "orca_team"), ("people: crowdnav_5", "social_force")):
            tab.evaluate("(family) => { picks.restore({ family, seed: 0 }); drive.clear(); }", family)
            tab.evaluate("(label) => { drive.add({ label }); drive.pump(30000); }", label)
            same_in_python(tab, label)
        tab.evaluate(CHOSEN, "omni3")
        for family, label in (
            ("team: doorway_4", "team_guided (trained)"),
            ("team: doorway_4", "team_scan (trained)"),
            ("people: crowdnav_5", "people_free (trained)"),
        ):
            tab.evaluate("(family) => { picks.restore({ family, seed: 0 }); drive.clear(); }", family)
            tab.evaluate("(label) => { drive.add({ label }); drive.pump(30000); }", label)
            same_in_python(tab, label)
        tab.evaluate(CHOSEN, "p3dx")
        # people go on walking while one drives by hand
        by_hand(tab)
        tab.keyboard.down("ArrowUp")
        watched.until("drive.hand.actor.x.length > 20")
        tab.keyboard.up("ArrowUp")
        assert tab.evaluate("drive.hand.actor.others.every(({ x, y }) => x.at(-1) !== x[0] || y.at(-1) !== y[0])")
        # of a person who walks otherwise a link tells all, and what nobody walks like is refused
        tab.evaluate("drive.clear(); drive.editor.change((world) => { world.walks[0][9] = 0.4; })")
        tab.evaluate("drive.add({ label: 'orca_team' }); drive.pump(20000)")
        same_in_python(tab, "orca_team")
        url = taken(tab, "copy link")
        for changed, told in ((url, ""), (url.replace("%22reach%22%3A10", "%22reach%22%3A-1"), "reach is -1")):
            other = watched.context.new_page()
            other.goto(changed)
            other.evaluate("ready")
            assert told in other.locator("#problem").text_content()
            assert other.locator("#problem").is_hidden() == (not told)
            if not told:
                other.evaluate("drive.pump(20000)")
                assert other.evaluate(POSES) == tab.evaluate(POSES)
        assert watched.errors == []


# the hand steers into whoever is nearest
CHASES = """() => {
    drive.twistByHand = ({ pose: [x, y, heading], others }) => {
        const away = ([a, b]) => Math.hypot(a - x, b - y);
        const [a, b] = [...others].sort((one, other) => away(one) - away(other))[0];
        const angle = Math.atan2(b - y, a - x) - heading;
        const turn = Math.atan2(Math.sin(angle), Math.cos(angle));
        return [Math.abs(turn) < 0.6 ? 0.6 : 0, 0, Math.max(-1.5, Math.min(1.5, 3 * turn))];
    };
    drive.race.go();
}"""

# the share of red pixels in the ring around what a run hit
RED = """([x, y, radius]) => {
    const { view } = replay;
    const { data } = view.context.getImageData(0, 0, view.canvas.width, view.canvas.height);
    const at = (angle) => {
        const [cx, cy] = view.centre, far = radius + 3 / view.pixels;
        const place = [x + far * Math.cos(angle) - cx, y + far * Math.sin(angle) - cy];
        const [u, v] = place.map((each) => each * view.pixels * view.ratio);
        return 4 * (Math.round(view.canvas.height / 2 - v) * view.canvas.width + Math.round(view.canvas.width / 2 + u));
    };
    const ring = [...Array(72).keys()].map((k) => at(k * Math.PI / 36));
    return ring.filter((k) => data[k] > 140 && data[k + 1] < 60 && data[k + 2] < 90).length / 72;
}"""


def test_a_crash_among_people_shows_who_was_hit_and_whose_people_are_drawn(
    browser: Browser, files: dict[str, Path]
) -> None:
    with Watched(browser, files["demo"], viewport={"width": 1280, "height": 900}, color_scheme="light") as watched:
        tab = watched.page
        tab.evaluate("() => { picks.restore({ family: 'people: crowdnav_5', seed: 0 }); drive.clear(); }")
        by_hand(tab)
        watched.until(DRIVEN.replace("=>", "=> run === drive.hand ||"))
        assert "people: yours are drawn" in tab.locator(".side").inner_text()
        # towards whoever is nearest, until that is near enough
        tab.evaluate(CHASES)
        watched.until("drive.hand.actor.outcome !== ''")
        assert tab.evaluate("drive.hand.actor.outcome") == "collision"
        end = tab.evaluate("drive.hand.actor.x.length - 1")
        assert "You hit a person, ringed in red." in tab.locator(".card").inner_text()
        (x,), (y,) = tab.evaluate("[drive.hand.actor.x.slice(-1), drive.hand.actor.y.slice(-1)]")
        bodies = tab.evaluate(
            "drive.hand.actor.others.map(({ x, y }, k) => [x.at(-1), y.at(-1), replay.world.bodies[k]])"
        )
        hit = min(bodies, key=lambda body: math.hypot(body[0] - x, body[1] - y) - body[2])
        others = tab.evaluate("Math.max(...drive.runs.map(({ actor }) => actor.x.length - 1))")
        assert others > end + 40
        for step, shown, told in (
            (end - 2, False, "people: yours are drawn"),
            (end, True, "people: yours are drawn"),
            (end + 1, True, "Your run is over: now the people of"),
            (end + 40, True, "Your run is over: now the people of"),
        ):
            tab.evaluate("(step) => { replay.toggle(false); replay.seek(step); }", step)
            assert (tab.evaluate(RED, hit) > 0.5) == shown
            assert told in tab.locator(".side").inner_text()
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
        (tmp_path / "room.yaml").write_text("image: room.png\nresolution: 0.1\n")
        tab.locator("input[type=file]").set_input_files([tmp_path / "room.yaml", tmp_path / "room.png"])
        watched.until("replay.told_of.textContent.includes('8 m along')")
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


# as a log of one may be identified: late, ramping, with wheels that saturate one by one
LATE = MINE | {
    "delay": [0.12, 0.16],
    "lag": [0.18, 0.15],
    "gain": [1.0, 0.95],
    "decelerations": [0.9, 1.5],
    "saturation": "wheels",
    "response": "continuous",
}


@pytest.mark.slow
@pytest.mark.parametrize(("sheet", "tier"), [(MINE, "slow"), (LATE, "lagged")], ids=["plain", "late"])
def test_a_data_sheet_is_a_robot_and_python_drives_it_the_same(
    browser: Browser,
    files: dict[str, Path],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    sheet: dict[str, Any],
    tier: str,
) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "mine.json").write_text(json.dumps(sheet))
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
        *(
            pytest.param(changed, told, marks=pytest.mark.slow)
            for changed, told in (
                ({"wheels": {"radius": -1.0, "track": 0.3}}, "wheels.radius is -1"),
                ({"hull": {"kind": "box", "length": 1, "width": 1}}, "hull.radius is"),
                ({"delay": 0.2}, "delay is 0.2; it must be two numbers"),
                ({"name": "p3dx"}, "p3dx"),
            )
        ),
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
