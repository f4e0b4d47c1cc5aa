"""The report: what it keeps of episodes, what it says, and that text from files stays text."""

import base64
import dataclasses
import json
import re
import shutil
import subprocess
import zlib
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from click.testing import CliRunner
from hypothesis import given
from hypothesis import strategies as st
from oracles.hostile_page import HOSTILE, hostile

from wayfield.benchmarks import report
from wayfield.benchmarks.commands import demo
from wayfield.benchmarks.contests import Course, Entrants
from wayfield.benchmarks.contests.crowds import PEOPLE
from wayfield.benchmarks.records.replays import QUANTUM, drive_of, packed, read_drives, write_drives
from wayfield.benchmarks.records.results import write_rows
from wayfield.benchmarks.records.trajectory import Trajectory
from wayfield.benchmarks.report import page
from wayfield.benchmarks.report.__main__ import main
from wayfield.benchmarks.report.page import Section, commit, rendered, write_page
from wayfield.benchmarks.report.worlds import IN_PAGE, plain, read_worlds, worlds_of
from wayfield.benchmarks.runs.suite import Setting
from wayfield.envs.crowds.people import WALK
from wayfield.envs.robots import ROBOTS
from wayfield.envs.scenarios import TASKS, splits

PAGE = Path(report.__path__[0]) / "page"


def payload(text: str) -> tuple[dict[str, Any], bytes]:
    """Returns what a page embeds: its JSON and its bytes."""
    found = re.search(r'<script type="text/plain" id="payload">([^<]*)</script>', text)
    assert found is not None
    sevens = np.array([ord(each) & 127 for each in found[1]], np.uint8)
    content = zlib.decompress(np.packbits(np.unpackbits(sevens[:, None], axis=1)[:, 1:]).tobytes())
    length = int.from_bytes(content[:4], "little")
    return json.loads(content[4 : 4 + length]), content[4 + length :]


@given(
    st.lists(
        st.tuples(*(st.floats(-1e3, 1e3, allow_nan=False) for _ in range(2)), st.floats(-3.1, 3.1)),
        min_size=2,
        max_size=40,
    )
)
def test_a_drive_is_the_trajectory_to_half_a_quantum(poses: list[tuple[float, ...]]) -> None:
    trajectory = Trajectory(times=np.arange(len(poses)) * 0.05, poses=np.array(poses))
    drive = drive_of(trajectory)
    assert np.abs(drive[:, :2] * QUANTUM - trajectory.poses[:, :2]).max() <= 0.5 * QUANTUM + 1e-9
    # the heading may go on over half a turn, but it points the same way
    turn = drive[:, 2] * QUANTUM - trajectory.poses[:, 2]
    assert np.abs(np.exp(1j * turn) - 1.0).max() <= 0.5 * QUANTUM + 1e-6


@pytest.mark.skipif(shutil.which("node") is None, reason="node is missing: apt-get install nodejs")
def test_the_page_unpacks_what_was_packed() -> None:
    rng = np.random.default_rng(0)
    drive = np.cumsum(rng.integers(-40_000, 40_000, (50, 4)), axis=0).astype(np.int32)
    code = (
        (PAGE / "data.js").read_text()
        + f"const bytes = bytesOf('{base64.b64encode(packed(drive)).decode()}');"
        + "const d = unpacked(bytes, [0, 50, 4]);"
        + "console.log(JSON.stringify([d.x, d.y, d.heading, d.error].map((c) => Array.from(c))));"
    )
    run = subprocess.run(["node", "-e", code], capture_output=True, text=True, check=True)
    assert (np.rint(np.array(json.loads(run.stdout)).T / QUANTUM) == drive).all()


@pytest.mark.skipif(shutil.which("node") is None, reason="node is missing: apt-get install nodejs")
def test_the_other_bodies_of_a_world_reach_the_page_while_they_are_there(tmp_path: Path) -> None:
    steps = np.arange(6)
    others = np.stack([np.column_stack([0.5 * steps, -steps]), np.full((6, 2), 3.25)], axis=1)
    others[4:, 0] = np.nan  # it has left
    shown = Trajectory(steps * 0.05, np.zeros((6, 3)), others=others, other_radii=np.array([0.3, 0.2]))
    drive = drive_of(shown)
    write_drives(tmp_path, {0: drive})
    assert (read_drives(tmp_path)[0] == drive).all()
    code = (
        (PAGE / "data.js").read_text()
        + f"const d = unpacked(bytesOf('{base64.b64encode(packed(drive)).decode()}'), [0, 6, 7]);"
        + "console.log(JSON.stringify([d.error, d.others.map(({x, y}) => [Array.from(x), Array.from(y)])]));"
    )
    run = subprocess.run(["node", "-e", code], capture_output=True, text=True, check=True)
    error, found = json.loads(run.stdout)
    assert error is None
    np.testing.assert_allclose(np.array(found)[:, :, :4], others[:4].transpose(1, 2, 0), atol=1e-9)
    assert (np.array(found)[0, :, 4:] > 1e5).all()
    many = dataclasses.replace(shown, others=np.zeros((6, 99, 2)), other_radii=np.full(99, 0.3))
    assert drive_of(many).shape == (6, 3)


def test_people_of_a_world_walk_as_its_contest_lets_them() -> None:
    settings = []
    for contest in (PEOPLE["people-seen"], PEOPLE["people-unseen"]):
        entrants = Entrants(("orca_team",), ("default",))
        case, *_ = contest.cases("omni3", Course("crowdnav_5", "test"), entrants, "none", None)
        settings.append(Setting("people", case, "kinematic", "lagged", 0, 1))
    seen, unseen = worlds_of(settings).values()
    blind = WALK.names.index("blind")
    assert {walk[blind] for walk in seen["walks"]} == {0}
    assert {walk[blind] for walk in unseen["walks"]} == {1}


def test_a_world_keeps_every_bit() -> None:
    for spec in TASKS.values():
        for family in list(spec.families)[:3]:
            scenario = splits.split(spec.name, family, "test")[0]
            world = json.loads(json.dumps(plain(scenario, spec.clock)))
            assert world == plain(scenario, spec.clock)
            assert world["kind"] == spec.kind


def test_text_from_files_is_escaped() -> None:
    text = rendered(HOSTILE, hostile(), [["command", HOSTILE]], page.BUDGET)
    assert "<script>alert" not in text
    assert text.count("<script") == 2  # the payload and the page's own
    told, _ = payload(text)
    assert told["tables"][0]["title"] == HOSTILE


def test_a_page_of_any_run_keeps_to_its_budget_and_to_its_failures() -> None:
    """Trajectories of noise do not deflate: as many are left out as have to be, failures last."""
    budget = page.BUDGET
    rng = np.random.default_rng(1)
    content = hostile()
    content.drives = [rng.integers(-(2**20), 2**20, (400, 3)).astype(np.int32) for _ in range(3000)]
    ended = {True: "collision", False: "success"}
    content.episodes = [
        content.episodes[0] | {"agent": str(k % 10), "episode": k, "outcome": ended[k % 60 == 59]} for k in range(3000)
    ]
    text = rendered("full", content, [], budget)
    assert 0.7 * budget < len(text.encode()) <= budget
    kept = [each for each in payload(text)[0]["episodes"] if "drive" in each]
    assert 0 < len(kept) < 3000
    assert sum(each["outcome"] == "collision" for each in kept) == 50
    # of trained agents the first seeds come first
    assert {each["agent"] for each in kept if each["outcome"] == "success"} == {"0"}


def test_a_page_asks_for_nothing_from_outside() -> None:
    text = rendered("page", hostile(), [], page.BUDGET)
    shown = re.sub(r'id="payload">[^<]*<', "", text).replace("http://www.w3.org/2000/svg", "")
    assert not re.search(r"https?://|src=|@import|url\(", shown)
    assert "default-src 'none'" in text


def test_a_folder_without_trajectories_gives_a_page_that_says_so(tmp_path: Path) -> None:
    row = {
        **{"suite": "path", "contest": "path", "family": "way", "scenario": "way", "robot": "", "policy": "lqr"},
        **{"gains": "", "gains_name": "default", "dynamics": "kinematic", "actuators": "ideal", "seed": "0"},
        **{"disturbance": "none", "episode": "0", "success": "1", "collision": "0", "left_corridor": "0"},
        **{"timeout": "0", "time": "3.5", "mean_speed": "0.5", "cross_track_rms": "0.01"},
    }
    write_rows(tmp_path, [row])
    write_page(tmp_path / "report.html", "t", [Section(tmp_path, [])], "evaluate")
    told, _ = payload((tmp_path / "report.html").read_text(encoding="utf-8"))
    assert "nothing of it can be replayed" in told["missing"][0]


def test_the_command_refuses_a_folder_without_a_run(tmp_path: Path) -> None:
    run = CliRunner().invoke(main, [str(tmp_path)])
    assert run.exit_code == 2
    assert "episodes.csv" in run.output


@pytest.mark.parametrize(
    "text",
    [
        "",
        '{"worlds": 3, "rows": []}',
        '{"worlds": {}, "rows": [""], "hulls": [[0.3, -1]]}',
        '{"worlds": {"a": {}}, "rows": ["a"]}',
        '{"worlds": {}, "rows": ""}',
    ],
)
def test_damaged_worlds_are_refused(tmp_path: Path, text: str) -> None:
    (tmp_path / "worlds.json").write_text(text)
    with pytest.raises(ValueError, match=re.escape(str(tmp_path))):
        read_worlds(tmp_path)


def test_the_page_tells_what_the_results_found_of_its_opening() -> None:
    results = (Path(__file__).parents[2] / "docs/results/flocks.md").read_text(encoding="utf-8")
    row = next(each for each in results.splitlines() if each.startswith("| among people who avoid the robot"))
    _, _, agent, solved, _, rival, best, _, scenes, _, outcome, *_ = (each.strip() for each in row.split("|"))
    assert agent == f"`{demo.OPENING['policy'].removesuffix(' (trained)')}`"
    assert rival.endswith(" tuned`")
    assert outcome == "tie"
    assert (
        f"In {scenes} scenes with people, the network that the page opens on arrives in "
        f"{float(solved.split()[0]):.0f} % and {demo.NAMES[rival.split()[0].strip('`')][0]}, a controller with gains "
        f"found by a search, in {float(best):.0f} %: no significant difference."
    ) == demo.FOUND
    names = list(demo.scenes().values())
    assert len(set(names)) == len(names)


def test_the_list_of_a_kind_of_scene_begins_with_the_first_of_its_published_table() -> None:
    docs = Path(__file__).parents[2] / "docs"
    tables = (docs / "results.md").read_text(encoding="utf-8").split("\n**[")
    headings = {"path": "Follow a path", "goal": "Reach a goal among static obstacles", "dock": "Dock at a pose"}
    for kind, heading in headings.items():
        table = next(each for each in tables if each.startswith(heading))
        policies = dict.fromkeys(re.findall(r"^\|(?:[^|`\n]*\|)? *`(\w+)`", table, re.MULTILINE))
        assert [each for each in policies if each in demo.NAMES][:3] == demo.BEST[kind]
    flocks = (docs / "results/flocks.md").read_text(encoding="utf-8").split("## ")[0]
    for kind in ("team", "people"):  # the best agent of a row, and the best controller
        assert any(
            all(f"| `{each}" in row for each in demo.BEST[kind])
            for row in flocks.splitlines()
            if ("people" in row) == (kind == "people")
        )
    assert set(demo.BEST) == {spec.kind for spec in IN_PAGE.values()}


def test_the_demo_is_not_written_over_what_is_no_page_nor_for_a_site_that_is_none(tmp_path: Path) -> None:
    (tmp_path / "path.csv").write_text("x,y\n0,0\n")
    made = CliRunner().invoke(demo.main, ["--out", str(tmp_path / "path.csv")])
    assert made.exit_code == 2
    assert "must end in .html" in made.stderr
    assert (tmp_path / "path.csv").read_text() == "x,y\n0,0\n"
    made = CliRunner().invoke(demo.main, ["--out", str(tmp_path / "demo.html")], env={demo.SITE: "somebody.example"})
    assert made.exit_code == 2
    assert f"{demo.SITE} is 'somebody.example'" in made.stderr
    assert not (tmp_path / "demo.html").exists()


def test_the_demo_is_one_file_within_its_budget_that_asks_for_nothing(tmp_path: Path) -> None:
    made = CliRunner().invoke(demo.main, ["--out", str(tmp_path / "demo.html")], catch_exceptions=False)
    assert made.exit_code == 0
    text = (tmp_path / "demo.html").read_text(encoding="utf-8")
    assert len(text.encode()) <= demo.BUDGET
    assert demo.FOUND in text
    assert "pip install wayfield" not in text  # which no index has yet
    assert re.findall(r'(?:src|href)="https?:', text) == []
    told, _ = payload(text)
    assert {world["kind"] for world in told["worlds"]} == {spec.kind for spec in IN_PAGE.values()}
    refused = CliRunner().invoke(demo.main, ["--out", str(tmp_path / "absent" / "demo.html")])
    assert refused.exit_code == 1
    assert len(refused.output.splitlines()) == 1


def test_a_challenge_begins_with_a_free_metre_ahead_on_the_side_of_its_star() -> None:
    families = {each["family"].split(": ")[1] for each in demo.CHALLENGES}
    scenes = {(f"{world['kind']}: {world['family']}", world["seed"]): world for world in demo.worlds(families)}
    for challenge in demo.CHALLENGES:
        world = scenes[challenge["family"], challenge["seed"]]
        x, y, heading = world["start"]
        ahead = np.linspace(0.0, 1.0, 21)
        if world["kind"] != "dock":
            assert (world["goal"][0] - x) * np.cos(heading) + (world["goal"][1] - y) * np.sin(heading) > 0.0
        places = np.column_stack([x + ahead * np.cos(heading), y + ahead * np.sin(heading)])
        for *middle, cos, sin, length, width, radius, _ in world["obstacles"]:
            along = np.abs((places - middle) @ [[cos, -sin], [sin, cos]]) - [length, width]
            assert np.hypot(*np.maximum(along, 0.0).T).min() > radius + ROBOTS[challenge["robot"]].hull_radius


@pytest.mark.parametrize("tracked", [False, True], ids=["beside", "committed"])
def test_the_commit_of_somebody_elses_repository_is_none_of_ours(tmp_path: Path, tracked: bool) -> None:
    package = tmp_path / ".venv" / "lib" / "site-packages" / "wayfield"
    package.mkdir(parents=True)
    (package / "__init__.py").touch()
    (tmp_path / "mine.py").touch()
    who = ("-c", "user.name=me", "-c", "user.email=me")
    for words in (
        ("init", "-q"),
        ("add", "." if tracked else "mine.py"),
        (*who, "commit", "-qm", "mine"),
        ("tag", "v9"),
    ):
        subprocess.run(["git", *words], cwd=tmp_path, check=True)
    assert commit(str(package / "__init__.py")) == ""
