"""Writes the site's pages that nobody writes by hand: each environment, each policy, the API, and copies from the root.

They are made anew in `docs/generated` before each build from the registries, so that none is missing and none is old.
"""

import html
import importlib
import inspect
import io
import json
import os
import re
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import gymnasium
from equations import EQUATIONS
from matplotlib.font_manager import FontProperties
from matplotlib.mathtext import math_to_image
from simulators import pilots, places
from sphinx.application import Sphinx

import wayfield  # noqa: F401  registers the ids
from wayfield.benchmarks.leaderboards.disclosure import inputs
from wayfield.envs.robots import robots_with
from wayfield.envs.tasks.specs import EVERY, spec_of
from wayfield.policies import ABOUT, POLICIES, drives, make
from wayfield.policies.parts.gain import gains_of
from wayfield.policies.parts.tuned import tuned_conditions

FOLDER = "generated"
ROOT_PAGES = {"CONTRIBUTING.md": "contributing.md", "CHANGELOG.md": "changelog.md"}

# What is public: a module, and the names of it that have a place in the reference; () is all that it exports.
API: Mapping[str, tuple[str, ...]] = {
    "wayfield.policies": (),
    "wayfield.benchmarks": (),
    "wayfield.envs.scenarios": (),
    "wayfield.envs.robots": ("ROBOTS", "Robot", "Wheel", "Sensors", "Actuators", "robot_of"),
    "wayfield.envs.robots.disturbances": ("DISTURBANCES", "LEVELS", "Disturbance"),
    "wayfield.envs.tasks.briefing": ("Briefing",),
    "wayfield.envs.tasks.observation": ("Layout", "Field"),
    "wayfield.envs.path_following": ("Observation",),
    "wayfield.envs.goal_reaching": ("Observation",),
    "wayfield.envs.single": ("SingleEnv",),
    "wayfield.envs.vector": ("NativeVectorEnv",),
    "wayfield.envs.sb3": ("NativeVecEnv",),
}


def setup(app: Sphinx) -> dict[str, Any]:
    """Registers the extension with Sphinx."""
    app.connect("config-inited", lambda app, config: write(Path(app.srcdir)))
    app.connect("source-read", _linked)
    return {"parallel_read_safe": True}


def write(docs: Path) -> None:
    """Writes all pages that are generated into a folder of the documentation; files that are as they were stay so."""
    home = docs / FOLDER
    wanted = dict(pages(docs))
    for old in home.rglob("*.md"):
        if str(old.relative_to(home)) not in wanted:
            old.unlink()
    for name, text in wanted.items():
        file = home / name
        file.parent.mkdir(parents=True, exist_ok=True)
        if not file.exists() or file.read_text(encoding="utf-8") != text:
            file.write_text(text, encoding="utf-8")


def pages(docs: Path) -> Iterator[tuple[str, str]]:
    """Yields name and text of each page that is generated."""
    ids = [env_id for spec in EVERY.values() for env_id in spec.ids.values()]
    told = "Each environment's sheet, with units, rewards and ends of episodes; `help(env.unwrapped)` prints it too."
    rows = [(f"[{_stem(each)}](environments/{_stem(each)}.md)", _picture(each, "gif", "..")) for each in ids]
    told += "\n\n" + _table(("environment", "a drive in it"), rows)
    yield "environments.md", _hub("Each environment", told, [f"environments/{_stem(each)}" for each in ids])
    for env_id in ids:
        yield f"environments/{_stem(env_id)}.md", environment_page(env_id)
    told = "Each law with its equations, source and gains; [choosing a controller](../choosing.md) says which when."
    rows = [(f"[`{name}`](policies/{name}.md)", ABOUT[name].what, ABOUT[name].source) for name in POLICIES]
    told += "\n\n" + _table(("policy", "what it is", "source"), rows)
    yield "policies.md", _hub("Each policy", told, [f"policies/{name}" for name in POLICIES])
    advice = choices(docs)
    for name in POLICIES:
        yield f"policies/{name}.md", policy_page(name, advice.get(name, ""))
    told = "What is public, from its docstrings. Environments are made by their ids, policies by `make`."
    told += "\n\n" + "\n".join(f"- [{module}](api/{module}.md)" for module in API)
    yield "api.md", _hub("API", told, [f"api/{module}" for module in API])
    for module in API:
        yield f"api/{module}.md", api_page(module)
    books = sorted((docs / "notebooks").glob("*.ipynb"))
    told = "What they print is kept in them; each opens in Jupyter, VS Code or Colab (Upload)."
    yield "notebooks.md", _hub("Notebooks", told, [f"notebooks/{book.stem}" for book in books])
    for book in books:
        yield f"notebooks/{book.stem}.md", notebook_page(book)
    for name, page in ROOT_PAGES.items():
        text = (docs.parent / name).read_text(encoding="utf-8")
        yield page, re.sub(r"\]\(docs/", "](../", text)


def notebook_page(book: Path) -> str:
    """Returns a notebook as a page: its texts, its code, and what the code printed."""
    parts = []
    for cell in json.loads(book.read_text(encoding="utf-8"))["cells"]:
        text = "".join(cell["source"])
        if cell["cell_type"] == "markdown":
            parts.append(text)
            continue
        parts.append(f"```python\n{text}\n```")
        said = "".join(line for output in cell["outputs"] for line in output.get("text", []))
        if said:
            parts.append(f"```text\n{said.rstrip()}\n```")
    elsewhere = f"{{download}}`This notebook <../../notebooks/{book.name}>`, to run it elsewhere."
    if repository := os.environ.get("GITHUB_REPOSITORY"):  # where the site is built for others
        at = f"https://colab.research.google.com/github/{repository}/blob/main/docs/notebooks/{book.name}"
        elsewhere += f" Or [open it in Colab]({at})."
    parts.append(elsewhere)
    return "\n\n".join(parts) + "\n"


def _stem(env_id: str) -> str:
    return env_id.partition("/")[2].partition("-v")[0]


def _picture(env_id: str, kind: str, docs: str, width: str = "") -> str:
    what = "a film of a drive" if kind == "gif" else "the whole way of a drive in one picture"
    size = f'{{width="{width}"}}' if width else ""  # quoted: MyST takes no bare per cent
    return f"![{_stem(env_id)}: {what}]({docs}/pictures/{_stem(env_id)}.{kind}){size}"


def _hub(title: str, told: str, entries: list[str]) -> str:
    return "\n".join([f"# {title}", "", told, "", "```{toctree}", ":hidden:", "", *entries, "```", ""])


def _table(header: tuple[str, ...], rows: list[tuple[str, ...]]) -> str:
    lines = [header, ("---",) * len(header), *rows]
    return "\n".join("| " + " | ".join(cell.replace("|", "\\|") for cell in line) + " |" for line in lines)


def environment_page(env_id: str) -> str:
    """Returns the page of a registered environment: who drives it, where, its picture and film, and its sheet."""
    spec = spec_of(env_id)
    holonomic = env_id == spec.ids[True]
    known = gymnasium.spec(env_id)
    module, _, name = str(known.entry_point).partition(":")
    sheet = inspect.cleandoc(getattr(importlib.import_module(module), name).__doc__)
    drivers = [
        f"[`{policy}`](../policies/{policy}.md)"
        for policy in POLICIES
        if drives(policy, spec) and (holonomic or "holonomic" not in _needs(policy))
    ]
    facts = [
        ("robots", ", ".join(f"`{robot}`" for robot in robots_with(holonomic))),
        ("families", ", ".join(f"`{family}`" for family in spec.families)),
        ("other scenarios", ", ".join(f"`{preset}`" for preset in spec.presets)),
        ("clock", f"{known.max_episode_steps} steps; contests give {spec.clock}"),
        ("a run is compared by", f"success, then {spec.cost.name} ({spec.cost.unit})"),
        ("policies", ", ".join(drivers)),
    ]
    head, _, rest = sheet.partition("\n")
    pictures = [_picture(env_id, "png", "../..", "60%"), _picture(env_id, "gif", "../..", "36%")]
    code = f'```python\nimport gymnasium\nimport wayfield\n\nenv = gymnasium.make("{env_id}")\n```'
    shown = {
        "path": "pure_pursuit, lqr", "goal": "vfh_plus, dwa", "dock": "reeds_shepp, polar",
        "team": "orca_team, social_force", "people": "orca_team, vfh_plus",
    }.get(spec.kind)  # fmt: skip
    options = [f":kind: {spec.kind}", f":robot: {'omni3' if holonomic else 'p3dx'}", ":about: scenes"]
    options += [":family: 'dock: wall'", ":seed: 1"] if spec.kind == "dock" else []
    # the page drives what its kernels were built for
    simulated = "\n".join([f"```{{simulator}} {shown}", *options, "```"]) if shown else ""
    parts = [f"# {_stem(env_id)}", head, code, simulated, "\n".join(pictures), _table(("", ""), facts), rest.strip()]
    return "\n\n".join(filter(None, parts)) + "\n"


def choices(docs: Path) -> dict[str, str]:
    """Returns what `choosing.md` says of when to choose each policy; its links are as from a policy's page."""
    text = re.sub(r"\]\((?!\w+:|#)", "](../../", (docs / "choosing.md").read_text(encoding="utf-8"))
    return dict(re.findall(r"^\| `(\w+)` \| (.+?) \|$", text, re.MULTILINE))


def policy_page(name: str, advice: str) -> str:
    """Returns the page of a policy: what it gets, when to choose it, its law and its gains."""
    policy = make(name)
    kind = type(policy)
    what, source = ABOUT[name].what, ABOUT[name].source
    tasks = [spec for spec in EVERY.values() if drives(name, spec)]
    tuned = [f"{spec.suite}: {', '.join(tuned_conditions(name, spec.suite))}" for spec in tasks]
    facts = [
        ("drives", ", ".join(spec.title.lower() for spec in tasks)),
        ("inputs", ", ".join(dict.fromkeys(inputs(policy.knows, spec.observes) for spec in tasks))),
        ("needs", ", ".join(_needs(name)) or "any robot"),
        ("class", f"`{kind.__module__}.{kind.__name__}`"),
        ("source", source or "none"),
        ("tuned for (robot, m/s, disturbance)", "; ".join(each for each in tuned if not each.endswith(": ")) or "none"),
    ]
    gains = gain_rows(name)
    parts = [
        f"# {name}",
        f"{what[0].upper()}{what[1:]}.",
        f"**When to choose it**: {advice}" if advice else "",
        f'```python\nfrom wayfield.policies import Pilot, make\n\npilot = Pilot(make("{name}"), env)\n```',
        _table(("", ""), facts),
        "## The law",
        equations(name),
        simulator(name, places(name)),
        markdown(inspect.cleandoc(kind.__doc__ or "")),
        "## Gains",
        _table(("gain", "default", "unit", "range", "meaning"), gains) if gains else "None.",
    ]
    return "\n\n".join(filter(None, parts)) + "\n"


def equations(name: str) -> str:
    """Returns a policy's equations, one below the other."""
    return "\n\n".join(equation(each) for each in EQUATIONS.get(name, ()))


def equation(tex: str) -> str:
    """Returns an equation as it is set: outlines in the ink of the page, which need no font, script or network."""
    drawn = io.StringIO()
    math_to_image(
        f"${tex}$".replace(r"\frac", r"\dfrac"), drawn, prop=FontProperties(math_fontfamily="cm", size=14), format="svg"
    )
    text = drawn.getvalue()[drawn.getvalue().index("<svg") :]
    for part in ("metadata", "style"):
        text = re.sub(rf"<{part}.*?</{part}>", "", text, flags=re.DOTALL)
    text = re.sub(r'<g id="patch_1">.*?</g>|<!--.*?-->', "", text, flags=re.DOTALL)
    text = " ".join(text.split()).replace("<svg ", '<svg fill="currentColor" aria-hidden="true" ', 1)
    return f'<div class="equation" role="img" tabindex="0" aria-label="{html.escape(tex)}">{text}</div>'


def simulator(name: str, found: list[tuple[str, str]]) -> str:
    """Returns the simulator in which a policy drives, small; "" where it cannot drive in the page."""
    if not found:
        film = f"pictures/policy_{name}.gif"
        return f"![{name}: a film of a drive](../../{film})" if (Path(__file__).parent / film).is_file() else ""
    kind, robot = found[0]
    label = next(each for each in pilots(kind, robot) if each.split()[0] == name)
    lines = [f"```{{simulator}} {label}", f":kind: {kind}", f":robot: {robot}", "```", ""]
    told = "*overlay* draws what it looks at, the sliders are its gains; in the whole simulator things can be moved."
    return "\n".join([*lines, told])


def _needs(name: str) -> tuple[str, ...]:
    return tuple(getattr(make(name), "needs", ()))


def gain_rows(name: str) -> list[tuple[str, ...]]:
    """Returns each gain of a policy: its name, default, unit, range and meaning."""
    return [
        (f"`{gain}`", f"`{each.default!r}`", each.unit.strip("1") or "-", each.range or "-", markdown(each.meaning))
        for gain, each in gains_of(make(name)).items()
    ]


def markdown(text: str) -> str:
    """Returns a docstring as Markdown: stars of formulas in its sentences are stars."""
    lines = [line if line.startswith("    ") else re.sub(r"(?<=\S)\*|(?<!^)\*(?=\S)", r"\\*", line)
             for line in text.split("\n")]  # fmt: skip
    return "\n".join(lines)


def api_page(module: str) -> str:
    """Returns the page of a module's public names, which autodoc fills from the docstrings."""
    found = importlib.import_module(module)
    names = API[module] or tuple(found.__all__)
    about = inspect.cleandoc(found.__doc__ or "").partition("\n\n")[0]
    parts = [f"# {module}", markdown(about)]
    for name in names:
        value = getattr(found, name)
        if inspect.isclass(value) or inspect.isfunction(value):
            kind = "class" if inspect.isclass(value) else "function"
            parts.append(f"```{{eval-rst}}\n.. auto{kind}:: {module}.{name}\n```")
        else:
            listed = ", ".join(f"``{key}``" for key in value)
            parts.append(f"```{{eval-rst}}\n.. py:data:: {module}.{name}\n\n   {len(value)}: {listed}\n```")
    return "\n\n".join(parts) + "\n"


def _linked(app: Sphinx, page: str, source: list[str]) -> None:
    """Turns links to what has another place on the site: files of the root, folders."""
    del app
    up = "../" * page.count("/")
    text = source[0]
    for name, there in ROOT_PAGES.items():
        text = re.sub(rf"\]\((?:\.\./)+{re.escape(name)}", f"]({up}{FOLDER}/{there}", text)
    if page == "results":  # the sidebar has one entry for all of them
        text += "\n```{toctree}\n:hidden:\n:glob:\n\nresults/*\n```\n"
    source[0] = text.replace("](results/)", "](results/README.md)")
