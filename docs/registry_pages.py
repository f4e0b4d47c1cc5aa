"""Writes the site's pages that nobody writes by hand: each environment, each policy, the API, and copies from the root.

They are made anew in `docs/generated` before each build from the registries, so that none is missing and none is old.
"""

import dataclasses
import importlib
import inspect
import re
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import gymnasium
from sphinx.application import Sphinx

import wayfield  # noqa: F401  registers the ids
from wayfield.envs.robots import robots_with
from wayfield.envs.scenarios import TASKS
from wayfield.policies import ABOUT, POLICIES, make
from wayfield.policies.policy import observation_of
from wayfield.policies.tuned import tuned_conditions

FOLDER = "generated"
ROOT_PAGES = {"CONTRIBUTING.md": "contributing.md", "CHANGELOG.md": "changelog.md"}

# What is public: a module, and the names of it that have a place in the reference; () is all that it exports.
API: Mapping[str, tuple[str, ...]] = {
    "wayfield.policies": (),
    "wayfield.benchmarks": (),
    "wayfield.envs.scenarios": (),
    "wayfield.envs.robots": ("ROBOTS", "Robot", "Wheel", "Sensors", "Actuators", "robot_of"),
    "wayfield.envs.disturbances": ("DISTURBANCES", "LEVELS", "Disturbance"),
    "wayfield.envs.briefing": ("Briefing",),
    "wayfield.envs.observation": ("Layout", "Field"),
    "wayfield.envs.path_following": ("Observation",),
    "wayfield.envs.goal_reaching": ("Observation",),
    "wayfield.envs.single": ("SingleEnv",),
    "wayfield.envs.vector": ("NativeVectorEnv",),
    "wayfield.envs.sb3": ("NativeVecEnv",),
}
OF_ANY = {"seed": "of the law's own random numbers", "solver_iterations": "of OSQP, at most"}  # gains, in every law


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
    ids = [env_id for spec in TASKS.values() for env_id in spec.ids.values()]
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
        yield f"policies/{name}.md", policy_page(name, advice[name])
    told = "What is public, from its docstrings. Environments are made by their ids, policies by `make`."
    told += "\n\n" + "\n".join(f"- [{module}](api/{module}.md)" for module in API)
    yield "api.md", _hub("API", told, [f"api/{module}" for module in API])
    for module in API:
        yield f"api/{module}.md", api_page(module)
    for name, page in ROOT_PAGES.items():
        text = (docs.parent / name).read_text(encoding="utf-8")
        yield page, re.sub(r"\]\(docs/", "](../", text)


def _stem(env_id: str) -> str:
    return env_id.partition("/")[2].partition("-v")[0]


def _picture(env_id: str, kind: str, docs: str, width: str = "") -> str:
    what = "a film of a drive" if kind == "gif" else "the whole way of a drive in one picture"
    size = f"{{width={width}}}" if width else ""
    return f"![{_stem(env_id)}: {what}]({docs}/pictures/{_stem(env_id)}.{kind}){size}"


def _hub(title: str, told: str, entries: list[str]) -> str:
    return "\n".join([f"# {title}", "", told, "", "```{toctree}", ":hidden:", "", *entries, "```", ""])


def _table(header: tuple[str, ...], rows: list[tuple[str, ...]]) -> str:
    lines = [header, ("---",) * len(header), *rows]
    return "\n".join("| " + " | ".join(cell.replace("|", "\\|") for cell in line) + " |" for line in lines)


def environment_page(env_id: str) -> str:
    """Returns the page of a registered environment: who drives it, where, its picture and film, and its sheet."""
    spec = next(each for each in TASKS.values() if env_id in each.ids.values())
    holonomic = env_id == spec.ids[True]
    known = gymnasium.spec(env_id)
    module, _, name = str(known.entry_point).partition(":")
    sheet = inspect.cleandoc(getattr(importlib.import_module(module), name).__doc__)
    drivers = [
        f"[`{policy}`](../policies/{policy}.md)"
        for policy in POLICIES
        if observation_of(spec) in make(policy).observes and (holonomic or "holonomic" not in _needs(policy))
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
    parts = [f"# {_stem(env_id)}", head, code, "\n".join(pictures), _table(("", ""), facts), rest.strip()]
    return "\n\n".join(parts) + "\n"


def choices(docs: Path) -> dict[str, str]:
    """Returns what `choosing.md` says of when to take each policy."""
    text = (docs / "choosing.md").read_text(encoding="utf-8")
    return dict(re.findall(r"^\| `(\w+)` \| (.+?) \|$", text, re.MULTILINE))


def policy_page(name: str, advice: str) -> str:
    """Returns the page of a policy: what it is told, when to take it, its law and its gains."""
    policy = make(name)
    kind = type(policy)
    what, source = ABOUT[name]
    tasks = [spec for spec in TASKS.values() if observation_of(spec) in policy.observes]
    tuned = [f"{spec.suite}: {', '.join(tuned_conditions(name, spec.suite))}" for spec in tasks]
    facts = [
        ("drives", ", ".join(spec.title.lower() for spec in tasks)),
        ("is told before an episode", policy.knows if policy.knows != "sensors" else "nothing: it has its sensors"),
        ("needs", ", ".join(_needs(name)) or "any robot"),
        ("class", f"`{kind.__module__}.{kind.__name__}`"),
        ("source", source or "none"),
        ("tuned for (robot, m/s, disturbance)", "; ".join(each for each in tuned if not each.endswith(": ")) or "none"),
    ]
    gains = gains_of(name)
    parts = [
        f"# {name}",
        f"{what[0].upper()}{what[1:]}.",
        f"**When to take it**: {advice}",
        f'```python\nfrom wayfield.policies import Pilot, make\n\npilot = Pilot(make("{name}"), env)\n```',
        _table(("", ""), facts),
        "## The law",
        markdown(inspect.cleandoc(kind.__doc__ or "")),
        "## Gains",
        _table(("gain", "default", "meaning"), gains) if gains else "None.",
    ]
    return "\n\n".join(parts) + "\n"


def _needs(name: str) -> tuple[str, ...]:
    return tuple(getattr(make(name), "needs", ()))


def gains_of(name: str) -> list[tuple[str, str, str]]:
    """Returns each gain of a policy: its name, its default and, from the comment at its field, its meaning."""
    policy: Any = make(name)
    lines = [line for kind in type(policy).__mro__[:-1] for line in inspect.getsource(kind).splitlines()]
    law = inspect.getdoc(type(policy)) or ""
    found = []
    for field in dataclasses.fields(policy):
        beside = next((line for line in lines if re.match(rf"    {field.name}: .*  # ", line)), "").partition("  # ")[2]
        meaning = beside or OF_ANY.get(field.name, "")
        if not meaning and re.search(rf"\b{field.name}\b", law):
            meaning = "as the law says"
        found.append((f"`{field.name}`", f"`{getattr(policy, field.name)!r}`", markdown(meaning)))
    return found


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
    # a page of its own, not a page of the site and not a download
    text = re.sub(r"\[([^\]]+)\]\(demo\.html\)", rf'<a href="{up}demo.html">\1</a>', text)
    source[0] = text.replace("](results/)", "](results/README.md)")
