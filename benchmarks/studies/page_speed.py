"""How fast the page is: python benchmarks/studies/page_speed.py

Times the laws in WebAssembly under Node beside the same laws as machine code, on the same arguments, the least of many
rounds each: others may be at work on the machine. And the demo page in Chromium: when it is ready, and its frames.
"""

import json
import shutil
import subprocess
import tempfile
import time
from importlib import resources
from pathlib import Path

import click
from gymnasium.utils.seeding import np_random
from page_recipes import contest_of, environment, first_decision, of_policies

from wayfield.benchmarks.commands import demo
from wayfield.benchmarks.report.worlds import DRAWS, World, plain
from wayfield.policies import make
from wayfield.system.command_line import OneLineErrors

LAWS = {"vfh_plus": ("vfh_plus", "steer"), "dwa": ("dwa", "choose_twists"), "mppi": ("mppi", "decide")}
TASK, ROBOT, TIER = "goal_reaching", "p3dx", "lagged"
CALLS, ROUNDS = 20, 100
FRAMES = 240
LOADS = 5


def native(world: World) -> dict[str, float]:
    """Returns the microseconds of a call of each law as machine code, and puts the scenario's draws into the world."""
    env = environment(TASK, ROBOT, TIER, f"{contest_of(TASK).timed_on}/test")
    times = {}
    for name, (module, function) in LAWS.items():
        ((kernel, values),) = first_decision(env, make(name), [(of_policies(module), function)])
        kernel(*values)
        least = float("inf")
        for _ in range(ROUNDS):
            begun = time.perf_counter()
            for _ in range(CALLS):
                kernel(*values)
            least = min(least, (time.perf_counter() - begun) / CALLS * 1e6)
        times[name] = least
    state = env.batch.states[0]
    world |= plain(env.task.scenarios[int(state["scenario"])], contest_of(TASK).spec.clock)
    world["draws"] = np_random(0)[0].random(DRAWS).tolist()
    return times


def in_webassembly(world: World) -> dict[str, float]:
    """Returns the same under Node."""
    home = resources.files("wayfield.benchmarks.report") / "page"
    conditions = {"world": world, "robot": ROBOT, "actuators": TIER, "calls": CALLS, "rounds": ROUNDS}
    query = json.dumps([conditions | {"policy": name} for name in LAWS])
    command = ["node", str(home / "speed.js"), str(home)]
    run = subprocess.run(command, input=query, capture_output=True, text=True, check=True)
    times: dict[str, float] = json.loads(run.stdout)
    return times


def _most(spent: list[float]) -> float:
    return spent[int(0.95 * len(spent))]


def in_chromium(chromium: str, page: Path) -> dict[str, list[float]]:
    """Returns milliseconds in a real browser, sorted: until the demo page is ready, and between frames of it at 1x.

    MPPI drives while it is shown, alone and with its rollouts drawn; of some rounds the quietest.
    """
    from playwright.sync_api import sync_playwright

    times: dict[str, list[float]] = {"ready": []}
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=chromium, args=["--no-sandbox"])
        for _ in range(LOADS):
            tab = browser.new_page(viewport={"width": 1280, "height": 800}, reduced_motion="reduce")
            tab.goto(page.as_uri())
            times["ready"].append(tab.evaluate("ready.then(() => performance.now())"))
            if len(times["ready"]) < LOADS:
                tab.close()
        for name, overlay in (("MPPI", "false"), ("MPPI and its rollouts", "true")):
            query = f"""async () => {{
                  drive.clear();
                  await drive.looks.turn({overlay});
                  drive.add({{ label: "mppi" }});
                  replay.seek(0);
                  replay.toggle(true);
                  const spent = [];
                  let before = await new Promise(requestAnimationFrame);
                  while (spent.length < {FRAMES}) {{
                    const now = await new Promise(requestAnimationFrame);
                    spent.push(now - before);
                    before = now;
                  }}
                  replay.toggle(false);
                  return spent.sort((a, b) => a - b);
                }}"""
            times[name] = min((tab.evaluate(query) for _ in range(LOADS)), key=_most)
        browser.close()
    return {name: sorted(map(float, each)) for name, each in times.items()}


@click.command("speed", cls=OneLineErrors)
def main() -> None:
    """Prints the speed of the page's kernels beside machine code, and of the demo page in Chromium."""
    if shutil.which("node") is None:
        raise click.ClickException("node is missing: apt-get install nodejs")
    world: World = {}
    here = native(world)
    there = in_webassembly(world)
    for name, microseconds in here.items():
        share = 100.0 * microseconds / there[name]
        pair = f"machine code {microseconds:8.1f} us, WebAssembly {there[name]:8.1f} us"
        print(f"{name:<12} {pair}: {share:.0f} % of the speed")
    chromium = shutil.which("chromium")
    if chromium is None:
        print("chromium is missing: apt-get install chromium")
        return
    with tempfile.TemporaryDirectory() as folder:
        page = Path(folder) / "demo.html"
        page.write_text(demo.page(), encoding="utf-8")
        browsed = in_chromium(chromium, page)
        size = page.stat().st_size / 1e6
    print(f"the demo: {size:.2f} MB, ready in {browsed.pop('ready')[0] / 1e3:.2f} s at best")
    for name, spent in browsed.items():
        print(f"frames with {name} at 1x: median {spent[len(spent) // 2]:.1f} ms, 95 % within {_most(spent):.1f} ms")


if __name__ == "__main__":
    main()
