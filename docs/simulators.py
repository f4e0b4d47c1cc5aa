"""The directive `simulator`: the demo page, small, in a page of the site, with a policy, a scene and gains chosen.

    ```{simulator} pure_pursuit
    :family: "path: circuits"
    :robot: p3dx
    :gains: lookahead_distance 0.25, speed 0.4
    ```

All share one file, `demo.html`, which holds kernels, scenes and page; browsers load it once, where one comes into view.
"""

import functools
import html
import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any, ClassVar
from urllib.parse import quote

from docutils import nodes
from docutils.parsers.rst import directives
from sphinx.application import Sphinx
from sphinx.util.docutils import SphinxDirective

from wayfield.benchmarks.commands import demo
from wayfield.benchmarks.report.page import kernel_part
from wayfield.envs.robots import ROBOTS
from wayfield.envs.tasks.specs import EVERY

# of each kind of scenarios a family and one of the demo's seeds
FIRST = {
    "path": ("path: circuits", 0), "goal": ("goal: clutter_10", 1), "dock": ("dock: open", 1),
    "team": ("team: circle_8", 0), "people": ("people: crossing_flow_8", 0),
}  # fmt: skip


@functools.cache
def tables() -> Any:
    """Returns what the demo's kernels are handed: who can drive there, and which gains have sliders."""
    return kernel_part(set(ROBOTS), demo.AGENTS_THERE)[0]


def pilots(kind: str, robot: str) -> list[str]:
    """Returns the policies that can drive in the page, by label, in scenarios of a kind with a robot."""
    task = next(spec.name for spec in EVERY.values() if spec.kind == kind)
    start = f"{task} {robot} lagged "
    return [key.removeprefix(start) for key in tables()["pilots"] if key.startswith(start)]


def places(policy: str) -> list[tuple[str, str]]:
    """Returns kind and robot of where a policy can drive in the page, a differential drive first."""
    return [
        (kind, robot)
        for kind in FIRST
        for robot in ("p3dx", "omni3")
        if any(label.split()[0] == policy for label in pilots(kind, robot))
    ]


def state(
    kind: str, robot: str, policies: list[str], gains: Mapping[str, float], place: tuple[str, int], embed: str
) -> str:
    """Returns the hash that opens the page there.

    Raises:
        ValueError: if the page has no such family, policy or gain.
    """
    family, seed = place
    if family.partition(": ")[0] != kind or not any(
        family == f"{spec.kind}: {each}" for spec in EVERY.values() for each in spec.families
    ):
        raise ValueError(f"the demo has no scenes {family!r} of kind {kind!r}")
    able = pilots(kind, robot)
    if unknown := [each for each in policies if each not in able]:
        raise ValueError(f"{', '.join(unknown)} cannot drive {robot} in the page; here drive {', '.join(able)}")
    task = next(spec.name for spec in EVERY.values() if spec.kind == kind)
    known = {
        each["name"] for each in tables()["sliders"].get(f"{task} {policies[0].split()[0]}", {"gains": []})["gains"]
    }
    if unknown := [each for each in gains if each not in known]:
        raise ValueError(f"{policies[0]} has no slider for {', '.join(unknown)}; it has {', '.join(sorted(known))}")
    runs = [{"policy": each} | ({"gains": gains} if gains and not k else {}) for k, each in enumerate(policies)]
    told = {"v": 2, "robot": robot, "actuators": "lagged", "disturbance": "none", "policy": policies[0]}
    told |= {"place": {"family": family, "seed": seed}, "runs": runs, "step": 0, "overlay": True, "embed": embed}
    return quote(json.dumps(told, separators=(",", ":")))


class Simulator(SphinxDirective):
    """Puts the simulator into a page; arguments are the policies that drive, the first of them looked at."""

    required_arguments = 1
    final_argument_whitespace = True
    option_spec: ClassVar[dict[str, Any]] = {  # type: ignore[misc]
        "kind": directives.unchanged, "robot": directives.unchanged, "family": directives.unchanged,
        "gains": directives.unchanged, "seed": directives.nonnegative_int, "about": directives.unchanged,
    }  # fmt: skip

    def run(self) -> list[nodes.Node]:
        """Returns the frame."""
        policies = [each.strip() for each in self.arguments[0].split(",")]
        found = places(policies[0].split()[0])
        family = self.options.get("family", "").strip("\"'")
        kind = self.options.get("kind", family.partition(":")[0] or (found[0][0] if found else "path"))
        robot = self.options.get("robot", next((each for where, each in found if where == kind), "p3dx"))
        try:
            pairs = [each.split() for each in self.options.get("gains", "").split(",") if each.strip()]
            gains = {name: float(value) for name, value in pairs}
            where = (family, int(self.options.get("seed", 0))) if family else FIRST[kind]
            place = state(kind, robot, policies, gains, where, self.options.get("about", "law"))
        except ValueError as error:
            raise self.error(f"simulator: {error}") from None
        up = "../" * self.env.docname.count("/")
        title = html.escape(f"Simulator: {', '.join(policies)}")
        frame = f'<iframe class="simulator" loading="lazy" title="{title}" src="{up}demo.html#{place}"></iframe>'
        return [nodes.raw("", frame, format="html")]


def write(file: Path) -> None:
    """Writes the demo page."""
    file.parent.mkdir(exist_ok=True)
    file.write_text(demo.page(), encoding="utf-8")


def setup(app: Sphinx) -> dict[str, Any]:
    """Registers the directive, and writes the page that its frames open."""
    app.add_directive("simulator", Simulator)
    app.connect("config-inited", lambda app, config: write(Path(app.srcdir) / "generated/demo.html"))
    return {"parallel_read_safe": True}
