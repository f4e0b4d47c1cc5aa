"""Puts the report together: one self-contained HTML file from the folders of a run."""

import base64
import dataclasses
import datetime
import html
import json
import math
import platform
import re
import subprocess
import zlib
from collections.abc import Collection, Container, Mapping, Sequence
from importlib import resources
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np

import wayfield
from wayfield.benchmarks.contests import ALL_CONTESTS
from wayfield.benchmarks.leaderboards.entries import COMPARED, label
from wayfield.benchmarks.records.episode import Episodes, Row
from wayfield.benchmarks.records.replays import MOST_DRIVES, Drive, packed, read_drives
from wayfield.benchmarks.records.results import read_rows
from wayfield.benchmarks.records.run_folder import DRIVES, WORLDS
from wayfield.benchmarks.records.table import Table
from wayfield.benchmarks.report.findings import Finding, finding_of, front_chart, ladder_chart
from wayfield.benchmarks.report.worlds import World, read_worlds
from wayfield.envs.robots import ROBOTS
from wayfield.envs.tasks.specs import CROWDS
from wayfield.system.identity import ROOMS, source_digest

BUDGET = 2_000_000  # bytes of a report

STYLES = ("page.css", "charts.css", "replay.css")
# in the order in which they need each other
SCRIPTS = (
    *("data.js", "dom.js", "tables.js", "charts.js", "heat.js"),
    *("view.js", "scene.js", "traces.js", "record.js", "replay.js", "picks.js"),
    *("kernels.js", "simulator.js", "pilots.js", "prediction.js"),
    *("files.js", "images.js", "robots.js"),
    *("edit.js", "gains.js", "looks.js", "share.js", "race.js", "drive.js", "draws.js", "main.js"),
)
OUTCOMES = ("success", "collision", "left_corridor", "timeout")
MODULE, TABLES = "kernels.wasm", "kernels.json"  # in the folder `page`; see `wasm`


@dataclasses.dataclass(frozen=True)
class Section:
    """What a report shows of one folder: its tables, and what they were made from."""

    folder: Path
    tables: Sequence[Table]
    small: tuple[str, Table] | None = None  # the result, as a sentence and a small table; a contest says so by itself
    named: tuple[str, ...] = ()  # policies that a contest's small table shows wherever they come


@dataclasses.dataclass
class Content:
    """What the page reads, gathered over the sections."""

    sentences: list[str] = dataclasses.field(default_factory=list)
    small: list[Table] = dataclasses.field(default_factory=list)
    charts: list[dict[str, Any]] = dataclasses.field(default_factory=list)
    duels: list[Mapping[str, Any]] = dataclasses.field(default_factory=list)  # a contest's, in their order
    tables: list[Table] = dataclasses.field(default_factory=list)
    worlds: list[World] = dataclasses.field(default_factory=list)
    episodes: list[dict[str, Any]] = dataclasses.field(default_factory=list)
    drives: list[Drive | None] = dataclasses.field(default_factory=list)
    missing: list[str] = dataclasses.field(default_factory=list)
    seeds: set[int] = dataclasses.field(default_factory=set)


def write_page(
    file: Path, title: str, sections: Sequence[Section], command: str, budget: int = BUDGET
) -> list[tuple[str, Table]]:
    """Writes the report of some folders as one file of at most `budget` bytes; returns its sentences and small tables.

    Raises:
        ValueError: if a folder's files are damaged; the message names the file.
        OSError: if one cannot be opened, or the report not be written.
    """
    content = Content()
    for section in sections:
        _gather(section, content)
    file.write_text(rendered(title, content, made(command, content), budget), encoding="utf-8")
    return list(zip(content.sentences, content.small, strict=True))


def _gather(section: Section, content: Content) -> None:
    """Adds what a section shows."""
    rows = read_rows(section.folder)
    content.tables += section.tables
    content.seeds.update(rows.unique("seed"))
    if section.small is not None:
        content.sentences.append(section.small[0])
        content.small.append(section.small[1])
    if rows and rows[0].get("contest") in ALL_CONTESTS:
        _gather_contests(rows, content, section.named)
    _gather_episodes(section.folder, rows, content)


def _gather_contests(rows: Episodes, content: Content, named: tuple[str, ...]) -> None:
    for contest in ALL_CONTESTS.values():
        for robot, mine in rows.where(contest=contest.name).groups("robot").items():
            if len(mine.unique("disturbance")) > 1:
                content.charts.append(ladder_chart(contest, robot, mine))
                calm = mine.where(disturbance="none") or mine
                finding = finding_of(contest, f"{robot}, undisturbed", calm, named)
            else:
                swept = mine.where(split="front")
                finding = finding_of(contest, robot, mine, named)
                front = front_chart(contest, robot, swept)
                if front["series"]:
                    content.charts.append(front)
            _add(finding, content)


def _add(finding: Finding, content: Content) -> None:
    content.sentences.append(finding.sentence)
    content.small.append(finding.small)
    content.charts += finding.charts
    content.duels.append(finding.duel)


def _gather_episodes(folder: Path, rows: Sequence[Row], content: Content) -> None:
    """Adds the episodes whose scenario is kept; says so where there is nothing to replay."""
    if not (folder / DRIVES).is_file() or not (folder / WORLDS).is_file():
        content.missing.append(
            f"{DRIVES} or {WORLDS} is missing, as in runs of earlier versions: nothing of it can be replayed."
        )
        return
    drives = read_drives(folder)
    worlds, keys, hulls = read_worlds(folder)
    if len(keys) != len(rows):
        raise ValueError(f"{folder / WORLDS} tells of {len(keys)} episodes; there are {len(rows)}")
    many = len(rows) > MOST_DRIVES
    if many:
        content.missing.append(f"Of {len(rows)} episodes {len(drives)} are listed; the tables are of all.")
    index: dict[str, int] = {}
    for k, (row, key) in enumerate(zip(rows, keys, strict=True)):
        if (many and k not in drives) or not key or row.get("split", "test") not in (*COMPARED, "", "worlds"):
            continue
        if key not in index:
            index[key] = len(content.worlds)
            content.worlds.append(worlds[key] | _rule_speed(row))
        hull = {"hull": hulls[k]} if hulls and row["robot"] not in ROBOTS else {}
        content.episodes.append(_episode(row, index[key]) | hull)
        content.drives.append(drives.get(k))


def _rule_speed(row: Row) -> dict[str, float]:
    """Returns the speed (m/s) that the rules of an episode's contest ask all policies for; {} where none do."""
    contest = ALL_CONTESTS.get(row.get("contest", ""))
    return {"speed": contest.rules.speed} if contest and contest.rules else {}


def _episode(row: Row, world: int) -> dict[str, Any]:
    """Returns the page's record of an episode."""
    of_contest = row["contest"] in ALL_CONTESTS
    policy = label((row["policy"], row["gains_name"])) if of_contest else f"{row['policy']} {row['gains']}".strip()
    seed = row.get("agent_seed", "")
    record = {
        "contest": row["contest"],
        "family": row["family"],
        "tier": row.get("tier", ""),
        "policy": policy,
        "agent": seed,
        "robot": row["robot"],
        "plant": row["dynamics"],
        "actuators": row["actuators"],
        "disturbance": row["disturbance"],
        "outcome": next(name for name in OUTCOMES if row[name] == 1.0),
        "time": row["time"],
        "world": world,
        "episode": row["episode"],
    }
    if (error := row.get("cross_track_rms", math.nan)) == error:  # not NaN
        record["error"] = error
    return record


def made(command: str, content: Content) -> list[list[str]]:
    """Returns how the report was made, as pairs of what and how."""
    seeds = sorted(content.seeds)
    return [
        ["command", command],
        ["commit", commit() or "not known"],
        ["code", source_digest()[:12]],
        ["wayfield", version("wayfield")],
        ["Python", platform.python_version()],
        *([name, version(name)] for name in ("numpy", "numba", "gymnasium")),
        ["machine", f"{platform.system()} {platform.machine()}"],
        *([["seeds", ", ".join(map(str, seeds)) if len(seeds) < 9 else f"{seeds[0]} to {seeds[-1]}"]] if seeds else []),
        ["date", datetime.date.today().isoformat()],
    ]


def commit(module: str = wayfield.__file__) -> str:
    """Returns the commit of the code as git describes it, marked where the code differs; "" outside of its repository.

    An installation may lie within a repository of the user's own, whose commits are of something else.

    Args:
        module: the file of the package's own.
    """
    file = Path(module).resolve()
    home = file.parents[1]

    def git(*words: str) -> str:
        return subprocess.run(["git", *words], cwd=home, check=True, capture_output=True, text=True).stdout.strip()

    own = f"{file.parent.name}/{file.name}"  # from the top of the repository
    try:
        if git("ls-files", "--full-name", "--", own) != own:
            return ""
        changed = git("status", "--porcelain", "--", file.parent.name, *ROOMS)
        return git("describe", "--always", "--tags") + ("-dirty" if changed else "")
    except (OSError, subprocess.CalledProcessError):
        return ""


def rendered(
    title: str,
    content: Content,
    how: Sequence[Sequence[str]],
    budget: int,
    extra: Mapping[str, Any] | None = None,
    agents: Collection[str] = (),
    preview: str = "",
) -> str:
    """Returns the page's text; as many episodes can be replayed as the budget has room for.

    Args:
        preview: HTML of its head, which describes the page where a link to it is shown.
        agents: trained among bodies, that can drive there besides those of the episodes.
    """
    robots = {episode["robot"] for episode in content.episodes} if extra is None else set(ROBOTS)
    kinds = {world["kind"] for world in content.worlds}
    agents = {*agents, *(episode["policy"].partition(" ")[0] for episode in content.episodes)}
    kernels, machinery = kernel_part(robots, agents, crowds=bool({"team", "people"} & kinds))
    plain = {
        "charts": content.charts,
        "duels": content.duels,
        "tables": [dataclasses.asdict(table) for table in content.tables],
        "worlds": content.worlds,
        "missing": content.missing,
        "made": how,
        "hulls": {name: robot.hull_radius for name, robot in ROBOTS.items()},
        "boxes": {name: (*robot.hull_box, robot.hull_x) for name, robot in ROBOTS.items() if robot.hull_box},
        **(extra or {}),
    }
    template = asset("page.html")
    parts = {
        "title": html.escape(title),
        "preview": preview,
        "style": "\n".join(asset(name) for name in STYLES),
        "summary": "".join(f"<p>{html.escape(each)}</p>" for each in content.sentences),
        "small": "".join(_static(table) for table in content.small),
        "made": "".join(f"<dt>{html.escape(a)}</dt><dd>{html.escape(b)}</dd>" for a, b in how),
        "script": re.sub(r"(?m)^ *//.*\n", "", "\n".join(asset(name) for name in SCRIPTS)),  # without comments
    }
    fixed = sum(map(len, parts.values())) + len(template)
    head = _json(plain | {"episodes": content.episodes, "drives": []})
    room = (budget - fixed) * 5 // 6 - len(zlib.compress(head + _json(kernels) + machinery, 9)) - 20_000
    chosen = _chosen(content, room)
    episodes = [episode | ({"drive": k} if k in chosen else {}) for k, episode in enumerate(content.episodes)]
    pieces: list[bytes] = []
    shapes: dict[int, list[int]] = {}
    at = 0
    for k in sorted(chosen):
        drive = content.drives[k]
        assert drive is not None
        pieces.append(packed(drive))
        shapes[k] = [at, *drive.shape]
        at += len(pieces[-1])
    if kernels:
        kernels["module"][0] += at
        kernels["blobs"] = [[at + first, length] for first, length in kernels["blobs"]]
    text = _json(plain | {"episodes": episodes, "drives": shapes, "kernels": kernels or None})
    payload = len(text).to_bytes(4, "little") + text + b"".join(pieces) + machinery
    parts["payload"] = as_text(zlib.compress(payload, 9))
    return re.sub(r"\{\{(\w+)\}\}", lambda match: parts[match[1]], template)


def as_text(data: bytes) -> str:
    """Returns bytes as text for a page: seven bits a character, which takes a seventh less room than base64.

    The three characters that HTML would not leave as they are stand 256 higher.
    """
    bits = np.unpackbits(np.frombuffer(data, np.uint8))
    sevens = np.packbits(np.pad(bits, (0, -len(bits) % 7)).reshape(-1, 7), axis=1) >> 1
    return sevens.tobytes().decode("ascii").translate({ord(each): ord(each) + 256 for each in "\0\r<"})


def kernel_part(
    robots: Container[str], agents: Container[str] = (), crowds: bool = True
) -> tuple[dict[str, Any], bytes]:
    """Returns what the page needs to drive some robots: the tables, and the bytes that they point into; {} for none.

    Args:
        agents: trained among bodies or for any robot, whose weights are needed; those of others stay behind.
        crowds: whether any of it drives among other bodies.
    """
    home = resources.files("wayfield.benchmarks.report") / "page"
    if not (home / MODULE).is_file() or not robots:
        return {}, b""
    tables = json.loads((home / TABLES).read_text(encoding="utf-8"))
    if not crowds:
        for part in ("tasks", "pilots", "sliders"):
            tables[part] = {key: each for key, each in tables[part].items() if key.split()[0] not in CROWDS}
    pieces, places = [(home / MODULE).read_bytes()], {}
    at = len(pieces[0])
    blobs: list[list[int]] = []

    def placed(k: int) -> int:
        nonlocal at
        if k not in places:
            places[k] = len(blobs)
            pieces.append(base64.b64decode(tables["blobs"][k]))
            blobs.append([at, len(pieces[-1])])
            at += len(pieces[-1])
        return places[k]

    for task in tables["tasks"].values():
        task["params"] = {key: placed(k) for key, k in task["params"].items() if key.split()[0] in robots}
        if task["directions"] is not None:
            task["directions"] = placed(task["directions"])
        if task["late"] is not None and "beams" in task["late"]:
            task["late"]["beams"] = placed(task["late"]["beams"])
    tables["pilots"] = {
        key: each
        for key, each in tables["pilots"].items()
        if key.split()[1] in robots
        and not (
            each.get("network") and (key.split()[0] in CROWDS or "any" in each) and each["make"]["name"] not in agents
        )
    }
    for pilot in tables["pilots"].values():
        for name in ("sizes", "numbers"):
            if name in pilot:
                pilot[name] = placed(pilot[name])
        base, alone = pilot.get("base", {}), pilot.get("alone", {})
        for part in (
            pilot,
            *(base.get(name, {}) for name in ("want", "avoid")),
            alone.get("behind", {}),
            *(pilot.get(name, {}) for name in ("shield", "planner")),
        ):
            for argument in part.get("arguments", ()):
                if "blob" in argument:
                    argument["blob"] = placed(argument["blob"])
    return tables | {"module": [0, len(pieces[0])], "blobs": blobs}, b"".join(pieces)


def _chosen(content: Content, room: int) -> set[int]:
    """Returns the episodes that are replayed: all, or failures first, then the first of every family and tier.

    Args:
        room: bytes, compressed.
    """
    met: dict[tuple[Any, ...], list[int]] = {}
    keys = []
    for k, episode in enumerate(content.episodes):
        group = met.setdefault((episode["contest"], episode["robot"], episode["family"], episode["tier"]), [])
        if episode["world"] not in group:
            group.append(episode["world"])
        nth = group.index(episode["world"])
        keys.append((episode["outcome"] == "success", max(nth, int(episode["agent"] or 0)), nth, k))
    chosen: set[int] = set()
    for *_, k in sorted(keys):
        drive = content.drives[k]
        if drive is None:
            continue
        room -= len(zlib.compress(packed(drive), 6))
        if room < 0:
            break
        chosen.add(k)
    return chosen


def _json(value: Any) -> bytes:
    return json.dumps(value, separators=(",", ":"), allow_nan=False, default=str).encode()


def _static(table: Table) -> str:
    """Returns a small table as HTML, to be read without a script too."""
    columns = zip(*table.rows, strict=True)
    numbers = [all(re.match(r"[^\w\s]?\s*[\d.]", cell or "0") for cell in column) for column in columns]
    classes = [' class="number"' if each else "" for each in numbers] or [""] * len(table.header)
    cells = [
        "".join(f"<td{kind}>{html.escape(cell)}</td>" for kind, cell in zip(classes, row, strict=True))
        for row in table.rows
    ]
    head = "".join(
        f'<th scope="col"{kind}>{html.escape(cell)}</th>' for kind, cell in zip(classes, table.header, strict=True)
    )
    body = "".join(f"<tr>{row}</tr>" for row in cells)
    return (
        f'<div class="wide" tabindex="0" role="region" aria-label="{html.escape(table.title)}"><table><caption>'
        f"{html.escape(table.title)}</caption><thead><tr>{head}</tr></thead><tbody>{body}</tbody></table></div>"
        f'<p class="note">{html.escape(table.note)}</p>'
    )


def asset(name: str) -> str:
    """Returns the text of a file of the folder `page`."""
    return (resources.files("wayfield.benchmarks.report") / "page" / name).read_text(encoding="utf-8")
