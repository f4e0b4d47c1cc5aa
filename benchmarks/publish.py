"""The page of results, from the folders of finished runs: python -m wayfield.benchmarks.publish

A run's tables are kept as small CSV files in docs/results, beside what made them (.json). From those files alone come
docs/results.md and, between markers, the table and the findings of README.md, so that a test can make them again.
"""

import csv
import dataclasses
import datetime
import io
import json
import re
import subprocess
import sys
from collections.abc import Mapping, Sequence
from importlib.metadata import version
from pathlib import Path
from typing import Any

import click
from tabulate import tabulate

from wayfield.benchmarks.results import TABLE, Row, read_rows
from wayfield.benchmarks.run_folder import MANIFEST, file_digest, source_digest
from wayfield.envs.command_line import Names, OneLineErrors
from wayfield.envs.readers import of_path, reader
from wayfield.envs.storage import write_whole

PAGE = "docs/results.md"
KEPT = "docs/results"  # folder of the tables and of what made them
README = "README.md"
FILM = "docs/drive.gif"
BEGIN, END = "<!-- results: made by python -m wayfield.benchmarks.publish -->", "<!-- end of results -->"

FAST = 0.75  # of the asked speed: who drives slower is accurate at another speed
MOST_FRAMES, FRAME_PX, FRAME_SKIP = 110, 400, 4  # of the film


@dataclasses.dataclass(frozen=True)
class Section:
    """One run of the page."""

    name: str  # of its folder
    title: str
    command: str
    tables: Mapping[str, str]  # file of the run: heading on the page
    not_shown: str
    pictures: Mapping[str, str] = dataclasses.field(default_factory=dict)  # file of the run: what it shows


_MAP_TOLD = "Policies that know the map are told what the others must find out. Simulation only, one kind of robot."
_IN_README = 3  # findings
_SPEED = "How a policy does at another speed than its own is in the front, not here. Simulation only."
_BEFORE = " (made with the version before)"

SECTIONS = (
    Section(
        "path-following",
        "Path following",
        "python evaluate.py --suite path-following",
        {
            "path_following_p3dx.csv": "Standings",
            "path_following_p3dx_front.csv": "Asked for a speed (m/s)",
            "path_following_p3dx_families.csv": "By family",
            "path_following_p3dx_better.csv": "Better than, in pairs",
        },
        _SPEED,
        {"path_following_p3dx_front.png": "Speed and accuracy of the path followers, each swept over its speed"},
    ),
    Section(
        "goal-obstacles",
        "Goal reaching among obstacles, P3DX",
        "python evaluate.py --suite goal-obstacles",
        {
            "goal_obstacles_p3dx.csv": "Standings",
            "goal_obstacles_p3dx_families.csv": "By family",
            "goal_obstacles_p3dx_better.csv": "Better than, in pairs",
        },
        _MAP_TOLD,
    ),
    Section(
        "goal-obstacles-omni3",
        "Goal reaching among obstacles, three omni wheels",
        "python evaluate.py --suite goal-obstacles --robot omni3",
        {"goal_obstacles_omni3.csv": "Standings"},
        _MAP_TOLD,
    ),
    Section(
        "goal-obstacles-omni4",
        "Goal reaching among obstacles, four omni wheels",
        "python evaluate.py --suite goal-obstacles --robot omni4",
        {"goal_obstacles_omni4.csv": "Standings"},
        _MAP_TOLD,
    ),
    Section(
        "disturbances",
        "Under disturbances",
        "python evaluate.py --suite disturbances",
        {
            "path_following_p3dx_ladder.csv": "Path following",
            "goal_obstacles_p3dx_ladder.csv": "Goal reaching among obstacles",
        },
        "Two scenarios of each family a level: too few to tell close policies apart.",
    ),
    Section(
        "documents",
        "The three documents",
        "python evaluate.py --suite documents",
        {TABLE: "Ours / published"},
        "The documented gain of A is weak by design of the document, and C's field as printed never arrives: beating "
        "either alone proves nothing.",
        {"document_a_trajectories.png": "Document A: the look-ahead controller as documented and retuned"},
    ),
    Section(
        "training",
        "What training adds to a controller",
        "python evaluate.py --suite path-following --policies regulated_pure_pursuit --gains tuned "
        "--agents results/training/path_following --agents results/training/path_following_plain "
        "--agents results/training/path_following_residual",
        {"training.csv": "Five seeds of each preset, 8 million frames, at 0.6 m/s and asked for 1.05 m/s"},
        "Each preset has the reward and the step sizes that served it best. Five seeds of one robot and one task.",
    ),
)

# The README's six rows: the tuned followers that a reader would choose from, and the trained agents.
CONTENDERS = (
    *(("pure_pursuit", "tuned"), ("regulated_pure_pursuit", "tuned"), ("stanley", "tuned"), ("lqr", "tuned")),
    *(("mpc", "tuned"), ("ppo", "trained")),
)


@dataclasses.dataclass(frozen=True)
class Made:
    """What made a section's tables."""

    command: str
    version: str
    commit: str  # as git describes it; "" where it is not known
    code: str  # digest of the source; "" where it was not kept
    date: str
    scenarios: int
    stale: bool  # whether another code than that of today made them

    def __post_init__(self) -> None:
        for field in dataclasses.fields(self):
            value = getattr(self, field.name)
            if not isinstance(value, field.type):  # type: ignore[arg-type]
                raise ValueError(f"{field.name!r} must be of type {field.type.__name__}, got {value!r}")  # type: ignore[union-attr]

    def sentence(self) -> str:
        """Returns what made the tables, and whether that is the code of today."""
        where = f", commit {self.commit}" if self.commit else ""
        code = f", code `{self.code[:12]}`" if self.code else ""
        told = (
            f"Made by `{self.command}`, wayfield {self.version}{where}{code}, {self.date}; {self.scenarios} scenarios."
        )
        if not self.stale:
            return told
        return f"**Made with the version before{where}: the code has changed since.** {told}"


@reader("origin of published tables", "made.json", {"made.json": '{"command": "python evaluate.py"}\n'}, of_path)
def read_object(file: Path) -> dict[str, Any]:
    """Returns what a JSON file tells of a run.

    Raises:
        ValueError: if it is no JSON object; the message names the file.
        OSError: if it cannot be opened.
    """
    try:
        content = json.loads(file.read_text(encoding="utf-8"))
    except (RecursionError, ValueError) as error:
        raise ValueError(f"{file} is no JSON: {error}") from None
    if not isinstance(content, dict):
        raise ValueError(f"{file} must hold a JSON object")
    return content


@click.command("publish", cls=OneLineErrors, context_settings={"help_option_names": ["-h", "--help"]})
@click.option("--run", "first", is_flag=True, help="Run the suites first; what was interrupted goes on.")
@click.option("--only", type=Names("--only", [each.name for each in SECTIONS]), help="Only these.  [default: all]")
@click.option("--stale", is_flag=True, help="Take results of another version of the code; the page says so.")
@click.option("--film", is_flag=True, help=f"Also make {FILM}, the README's moving picture.")
@click.option("--results", default="results", show_default=True, metavar="DIR", help="Where the runs' folders are.")
@click.option("--root", default=".", show_default=True, metavar="DIR", help="The repository, with README.md and docs.")
def main(first: bool, only: tuple[str, ...] | None, stale: bool, film: bool, results: str, root: str) -> None:
    """Makes docs/results.md and the README's table from the folders of finished runs.

    A section without a folder keeps the tables that it had. A folder that other code made is refused.
    """
    above, home = Path(results), Path(root)
    wanted = [each for each in SECTIONS if only is None or each.name in only]
    try:
        for section in wanted:
            # training needs agents that are trained first
            if first and section.name != "training" and not done(above / section.name):
                run(section, above, home)
        files: dict[str, bytes] = {}
        for section in wanted:
            if (above / section.name / MANIFEST).is_file():
                files |= gathered(section, above / section.name, home, stale)
            elif only is not None:
                raise ValueError(f"--only {section.name}: {above / section.name} holds no finished run")
        store = Kept(home, files)
        store.mark_stale()
        for name, content in (store.changed | pages(store)).items():
            (home / name).parent.mkdir(parents=True, exist_ok=True)
            write_whole(home / name, content)
    except (OSError, ValueError) as error:
        raise click.ClickException(str(error)) from None
    if film:
        write_whole(home / FILM, moving_picture())
    print(f"{home / PAGE} and {home / README} are made from {len(list((home / KEPT).glob('*.json')))} runs")


def done(folder: Path) -> bool:
    """Returns whether a folder holds a finished run of the installed code; OSError or ValueError if it is damaged."""
    return (folder / MANIFEST).is_file() and read_object(folder / MANIFEST).get("code") == source_digest()


def run(section: Section, above: Path, home: Path) -> None:
    """Runs a section's command in the repository; what an earlier run left unfinished goes on."""
    words = section.command.split()[2:]
    command = [sys.executable, "evaluate.py", *words, "--out", str((above / section.name).resolve())]
    status = subprocess.run(command, cwd=home, check=False).returncode
    if status:
        raise click.ClickException(f"`{section.command}` ended with status {status}; nothing was published")


def gathered(section: Section, folder: Path, home: Path, stale: bool) -> dict[str, bytes]:
    """Returns the files that the repository keeps of a finished run, by their place.

    Raises:
        ValueError: if another code made them and `stale` is not set, or one was changed or is missing.
        OSError: if one cannot be read.
    """
    manifest = read_object(folder / MANIFEST)
    listed, code = manifest.get("files"), manifest.get("code")
    if not isinstance(listed, dict) or not isinstance(code, str) or not isinstance(manifest.get("command"), str):
        raise ValueError(f"{folder / MANIFEST} must tell command, code and files of a run")
    other = code != source_digest()
    if other and not stale:
        raise ValueError(
            f"{folder} was made by other code ({code[:12]}) than what is installed ({source_digest()[:12]}): "
            "give --run to make it anew, or --stale to publish it as that"
        )
    found: dict[str, bytes] = {}
    for name in (*section.tables, *section.pictures):
        file = folder / name
        if name not in listed:
            continue  # a run of some policies alone has no table of them all
        if not file.is_file() or file_digest(file) != listed[name]:
            raise ValueError(f"{file} is not as the run wrote it: run `{section.command}` again")
        found[_place(section, name)] = file.read_bytes()
    if not any(name in listed for name in section.tables):
        raise ValueError(f"{folder} has none of the tables {', '.join(section.tables)}")
    date = datetime.datetime.fromtimestamp((folder / MANIFEST).stat().st_mtime, datetime.UTC).date().isoformat()
    commit = "" if other else described(home)
    made = Made(manifest["command"], version("wayfield"), commit, code, date, scenarios(read_rows(folder)), other)
    found[f"{KEPT}/{section.name}.json"] = _json(made)
    return found


def _place(section: Section, name: str) -> str:
    """Returns where the repository keeps a file of a run."""
    if name in section.pictures:
        return f"docs/{name}"
    return f"{KEPT}/{section.name}.md" if name == TABLE else f"{KEPT}/{name}"


def _json(made: Made) -> bytes:
    return (json.dumps(dataclasses.asdict(made), indent=1) + "\n").encode()


def scenarios(rows: Sequence[Row]) -> int:
    """Returns how many different scenarios the rows of the standings are about."""
    # contests have rows of the validation split and of the front too
    tested = [row for row in rows if row.get("split", "test") in ("test", "")]
    return len({(row.get("document", row.get("contest")), row["scenario"], row.get("episode")) for row in tested})


def described(home: Path) -> str:
    """Returns the commit of the code as git describes it, marked where the code differs from it; "" without git."""
    try:
        told = ["describe", "--always", "--tags"], ["status", "--porcelain", "--", "envs", "policies", "benchmarks"]
        name, changed = (
            subprocess.run(["git", *words], cwd=home, check=True, capture_output=True, text=True).stdout.strip()
            for words in told
        )
    except (OSError, subprocess.CalledProcessError):
        return ""
    return name + ("-dirty" if changed else "")


class Kept:
    """The repository's files as they will be: those that change, else those that are there."""

    def __init__(self, home: Path, changed: Mapping[str, bytes] | None = None) -> None:
        self.home = home
        self.changed = dict(changed or {})

    def __contains__(self, name: str) -> bool:
        return name in self.changed or (self.home / name).is_file()

    def text(self, name: str) -> str:
        """Returns a file's text; OSError if there is none."""
        content = self.changed[name] if name in self.changed else (self.home / name).read_bytes()
        return str(content, "utf-8")

    def rows(self, stem: str) -> list[Row]:
        """Returns the rows of a kept table, none where there is no such table; ValueError if it is damaged."""
        name = f"{KEPT}/{stem}.csv"
        if name not in self:
            return []
        rows: list[Row] = list(csv.DictReader(io.StringIO(self.text(name), newline=""), strict=True))
        if not rows or any(None in row or None in row.values() for row in rows):
            raise ValueError(f"{self.home / name} is empty, or has rows that are longer or shorter than its header")
        return rows

    def sections(self) -> list[tuple[Section, Made]]:
        """Returns the sections that there are tables of, in the order of the page.

        Raises:
            ValueError: if a file is damaged; the message names it.
        """
        found = []
        for section in SECTIONS:
            name = f"{KEPT}/{section.name}.json"
            if name in self:
                try:
                    found.append((section, Made(**json.loads(self.text(name)))))
                except (TypeError, ValueError) as error:
                    raise ValueError(f"{self.home / name}: {error}") from None
        return found

    def mark_stale(self) -> None:
        """Marks the sections that the installed code did not make."""
        for section, made in self.sections():
            if made.code != source_digest() and not made.stale:
                self.changed[f"{KEPT}/{section.name}.json"] = _json(dataclasses.replace(made, stale=True))


def pages(kept: Kept) -> dict[str, bytes]:
    """Returns docs/results.md and README.md as the kept tables make them.

    Raises:
        ValueError: if a table is damaged, or README.md has lost its markers.
        OSError: if a file cannot be read.
    """
    readme = kept.text(README)
    start, end = readme.find(BEGIN), readme.find(END)
    if start < 0 or end < start:
        raise ValueError(f"{kept.home / README} needs a line {BEGIN!r} and after it a line {END!r}")
    shown = "\n".join([BEGIN, *_contenders(kept), "", *findings(kept)[:_IN_README], "", END])
    return {PAGE: _page(kept).encode(), README: (readme[:start] + shown + readme[end + len(END) :]).encode()}


def _page(kept: Kept) -> str:
    """Returns the page of results."""
    sections = kept.sections()
    blocks = [
        "# Results",
        "Made by `python -m wayfield.benchmarks.publish` from the tables in [results/](results/), which come from the "
        "folders of finished runs; `--run` runs them first. Edited by hand, it fails a test.",
        "Every policy meets the same scenarios, starts and disturbances. `default` are the gains of the policy's file, "
        "`tuned` those found by search on the validation split, `paper` a law as published, `trained` all seeds of the "
        "agents that ship. Brackets are 95 % intervals: Wilson's for the success of one policy, else of a "
        "stratified bootstrap. What the "
        "columns mean is in [evaluate.md](evaluate.md).",
        "## Findings",
        "\n".join(findings(kept)),
    ]
    for section, made in sections:
        blocks += [f"## {section.title}", made.sentence(), f"What it does not show: {section.not_shown}"]
        for name, alt in section.pictures.items():
            if f"docs/{name}" in kept:
                blocks.append(f"![{alt}]({name})")
        for name, heading in section.tables.items():
            place = _place(section, name)
            if place in kept:
                blocks += [f"### {heading}", _shown(kept, place)]
    missing = [section for section in SECTIONS if section.name not in {each.name for each, _ in sections}]
    if missing:
        rest = "\n".join(f"- {section.title}: `{section.command}`" for section in missing)
        blocks += ["## Not run on this version", rest]
    return "\n\n".join(blocks) + "\n"


def _shown(kept: Kept, place: str) -> str:
    """Returns a kept table as Markdown."""
    if place.endswith(".md"):
        return re.sub(r"^## ", "#### ", kept.text(place).strip(), flags=re.MULTILINE)
    rows = kept.rows(Path(place).stem)
    cells = [[cell.replace("|", "\\|") for cell in row.values()] for row in rows]
    return str(tabulate(cells, list(rows[0]), tablefmt="github", disable_numparse=True))


def _cell(row: Row, header: str) -> str:
    """Returns a cell by what its column's header begins with."""
    for name, text in row.items():
        if name.startswith(header):
            return text
    raise ValueError(f"the standings have no column {header!r}: {', '.join(row)}")


def _label(row: Row) -> str:
    gains = row["gains"]
    return row["policy"] if gains == "default" else f"{row['policy']} ({gains})"


def _contenders(kept: Kept) -> list[str]:
    """Returns the README's table, and the line that says what made it."""
    made = {section.name: each for section, each in kept.sections()}.get("path-following")
    rows = {(row["policy"], row["gains"]): row for row in kept.rows("path_following_p3dx")}
    if made is None or not rows:
        return ["No run of this version is published."]
    header = ["policy", "gains", "is told", "success (%)", "RMS error (m)", "mean speed (m/s)"]
    columns = ("policy", "gains", "knows", "success", "RMS error", "mean speed")
    lines = [[_cell(rows[entry], each) for each in columns] for entry in CONTENDERS if entry in rows]
    for line in lines:
        line[0] = f"`{line[0]}`"
    return [tabulate(lines, header, tablefmt="github", disable_numparse=True), "", made.sentence()]


def findings(kept: Kept) -> list[str]:
    """Returns the findings in words, from the kept tables alone."""
    found = []
    paths = kept.rows("path_following_p3dx")
    if paths:
        said = _ranking(paths, "RMS error", " m", 1.0)
        found.append(f"- **Following paths, each at its own speed**, the least error is that of {said}.")
    found += _goal_finding(kept, "goal-obstacles", "p3dx")
    found += _front_finding(kept.rows("path_following_p3dx_front"))
    agent = {row["policy"]: row for row in kept.rows("path_following_p3dx_better")}.get("ppo (trained)")
    if agent is not None:
        verdicts: dict[str, list[str]] = {"better than": [], "worse than": [], "undecided against": []}
        for other, cell in agent.items():
            if other != "policy" and cell:
                won = float(cell.rstrip("*")) > 0.5
                kind = "undecided against" if not cell.endswith("*") else "better than" if won else "worse than"
                verdicts[kind].append(f"`{other}`")
        told = "; ".join(f"{kind} {', '.join(names)}" for kind, names in verdicts.items() if names)
        found.append(f"- **Path by path**, the trained agents are {told}.")
    found += _goal_finding(kept, "goal-obstacles-omni3", "omni3")
    found += _goal_finding(kept, "goal-obstacles-omni4", "omni4")
    return found


def _goal_finding(kept: Kept, section: str, robot: str) -> list[str]:
    """Returns who arrives most of those that see the scan alone; nothing where there is no table."""
    rows = [row for row in kept.rows(f"goal_obstacles_{robot}") if row["knows"] == "sensors"]
    if not rows:
        return []
    said = _ranking(rows, "success", " %", -1.0)
    before = any(each.name == section and made.stale for each, made in kept.sections())
    return [f"- **Reaching goals with `{robot}` by the scan alone**, the most arrive with {said}{_BEFORE * before}."]


def _front_finding(rows: Sequence[Row]) -> list[str]:
    """Returns who errs least at the highest speed that was asked for, of those that go nearly as fast."""
    if not rows:
        return []
    asked = list(rows[0])[-1]
    # error with its interval | speed
    points = [(row["policy"], *(cell.split()[0] for cell in row[asked].split(" | "))) for row in rows]
    fast = sorted((each for each in points if float(each[2]) >= FAST * float(asked)), key=lambda each: float(each[1]))
    if not fast:
        return []
    said = ", ".join(f"`{policy}` ({error} m at {speed} m/s)" for policy, error, speed in fast)
    return [f"- **Asked for {asked} m/s**, those that go at least {FAST * 100:.0f} % as fast, by their error: {said}."]


def _ranking(rows: Sequence[Row], header: str, unit: str, sign: float) -> str:
    """Returns the first two of the standings by a column, and where the trained agents stand."""
    order = sorted(rows, key=lambda row: sign * float(_cell(row, header).split()[0]))
    first = ", ".join(f"`{_label(row)}` ({_cell(row, header).split()[0]}{unit})" for row in order[:2])
    places = [k for k, row in enumerate(order) if row["gains"] == "trained"]
    if not places:
        return first
    agents = _cell(order[places[0]], header).split()[0]
    return f"{first}; the trained agents, {agents}{unit}, are in place {places[0] + 1} of {len(order)}"


def moving_picture() -> bytes:
    """Returns a GIF of tuned VFH+ that drives through clutter by its scan."""
    import gymnasium
    from PIL import Image

    import wayfield.policies
    from wayfield.benchmarks.video import gif

    env = gymnasium.make(
        "wayfield/DiffDriveGoalObstacles-v0",
        render_mode="rgb_array",
        scenario="clutter_10/test",
        actuators="lagged",
        num_beams=72,
        max_range=5.0,
    )
    policy = wayfield.policies.make("vfh_plus", **wayfield.policies.tuned_gains("vfh_plus", "goal-obstacles"))
    pilot = wayfield.policies.Pilot(policy, env)
    observation, _ = env.reset(seed=0, options={"scenario": 0})
    pilot.reset()
    frames, ended = [], False
    for step in range(MOST_FRAMES * FRAME_SKIP):
        if step % FRAME_SKIP == 0 or ended:
            frame: Any = env.render()
            image = Image.fromarray(frame)
            frames.append(image.resize((FRAME_PX, FRAME_PX * image.height // image.width), Image.Resampling.LANCZOS))
        if ended:
            break
        observation, _, terminated, truncated, _ = env.step(pilot.act(observation))
        ended = terminated or truncated
    env.close()
    return gif(frames, 0.025 * FRAME_SKIP)  # twice the robot's pace


if __name__ == "__main__":
    main()
