"""How fast the page is: python benchmarks/studies/page_speed.py

Times the laws in WebAssembly under Node beside the same laws as machine code, on the same arguments, and the script of
a frame of the replay in Chromium. Both are the least of many rounds: others may be at work on the machine.
"""

import json
import shutil
import subprocess
import tempfile
import time
from importlib import resources
from pathlib import Path
from typing import Any

import click
from gymnasium.utils.seeding import np_random
from page_recipes import contest_of, environment, first_decision, of_policies

from wayfield.benchmarks.report.page import BUDGET, Content, rendered
from wayfield.benchmarks.report.worlds import DRAWS, World, plain
from wayfield.policies import make
from wayfield.system.command_line import OneLineErrors

LAWS = {"vfh_plus": ("vfh_plus", "steer"), "dwa": ("dwa", "choose_twists"), "mppi": ("mppi", "decide")}
TASK, ROBOT, TIER = "goal_reaching", "p3dx", "lagged"
CALLS, ROUNDS = 20, 100
FRAMES = 200


def native(world: World) -> dict[str, float]:
    """Returns the microseconds of a call of each law as machine code, and puts the scenario's draws into the world."""
    env = environment(TASK, ROBOT, TIER, f"{contest_of(TASK).timed_on}/test")
    found = {}
    for name, (module, function) in LAWS.items():
        ((kernel, values),) = first_decision(env, make(name), [(of_policies(module), function)])
        kernel(*values)
        least = float("inf")
        for _ in range(ROUNDS):
            begun = time.perf_counter()
            for _ in range(CALLS):
                kernel(*values)
            least = min(least, (time.perf_counter() - begun) / CALLS * 1e6)
        found[name] = least
    state = env.batch.states[0]
    world |= plain(env.task.scenarios[int(state["scenario"])], contest_of(TASK).spec.clock)
    world["draws"] = np_random(0)[0].random(DRAWS).tolist()
    return found


def in_webassembly(world: World) -> dict[str, float]:
    """Returns the same under Node."""
    home = resources.files("wayfield.benchmarks.report") / "page"
    conditions = {"world": world, "robot": ROBOT, "actuators": TIER, "calls": CALLS, "rounds": ROUNDS}
    asked = json.dumps([conditions | {"policy": name} for name in LAWS])
    command = ["node", str(home / "speed.js"), str(home)]
    run = subprocess.run(command, input=asked, capture_output=True, text=True, check=True)
    found: dict[str, float] = json.loads(run.stdout)
    return found


def frames(world: World, chromium: str) -> list[float]:
    """Returns the milliseconds of script of each frame while three policies are replayed with a scan of 72 beams."""
    from playwright.sync_api import sync_playwright

    content = Content(worlds=[world | {"seed": 0}])
    text = rendered("frames", content, [], BUDGET, {"demo": {"first": f"goal: {world['family']}"}})
    with tempfile.TemporaryDirectory() as folder, sync_playwright() as playwright:
        file = Path(folder) / "frames.html"
        file.write_text(text, encoding="utf-8")
        browser = playwright.chromium.launch(executable_path=chromium, args=["--no-sandbox"])
        tab = browser.new_page()
        tab.goto(file.as_uri())
        tab.evaluate("ready")
        for name in ("vfh_plus", "dwa", "ppo (trained)"):
            tab.evaluate(f"drive.who.value = '{name}'; drive.go(); replay.toggle(false); drive.advance(1200, 60000)")
        found: list[Any] = tab.evaluate(
            f"""() => {{
              const spent = [];
              for (let k = 0; k < {FRAMES}; k++) {{
                const begun = performance.now();
                replay.seek(k);
                spent.push(performance.now() - begun);
              }}
              return spent;
            }}"""
        )
        browser.close()
    return sorted(float(each) for each in found)


@click.command("speed", cls=OneLineErrors)
def main() -> None:
    """Prints the speed of the page's kernels beside machine code, and the script time of a frame."""
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
    spent = frames(world, chromium)
    middle, most = spent[len(spent) // 2], spent[int(0.95 * len(spent))]
    print(f"frame of 3 policies, 72 beams: median {middle:.2f} ms of script, 95 % below {most:.2f} ms")


if __name__ == "__main__":
    main()
