"""What a report's page holds: the episodes, their worlds and drives, and the kernels' constants, stated once more."""

import base64
import html
import itertools
import json
import zlib
from importlib import resources
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from test_restated_figures import unfolded
from test_restated_tables import rows_of

from wayfield.benchmarks.contests import CONTESTS
from wayfield.benchmarks.page import Kept, _contenders
from wayfield.benchmarks.report import page
from wayfield.benchmarks.report.drives import packed, write_drives
from wayfield.benchmarks.report.page import Content, Section, rendered
from wayfield.benchmarks.results import write_rows
from wayfield.benchmarks.table import Table
from wayfield.envs.robots import ROBOTS

OUTCOMES = ("success", "collision", "left_corridor", "timeout")


def folder_of(folder: Path, rows: list[dict[str, str]], keys: list[str], hulls: list[Any]) -> dict[int, Any]:
    """Writes a run's files and returns its drives."""
    rng = np.random.default_rng(1)
    drives = {k: np.cumsum(rng.integers(-30, 30, (5 + k % 7, 3)), axis=0).astype(np.int32) for k in range(len(rows))}
    del drives[2]  # of a run too large some are not kept
    write_rows(folder, rows)
    write_drives(folder, drives)
    worlds = {key: {"kind": "goal", "name": key} for key in keys if key}
    (folder / "worlds.json").write_text(json.dumps({"worlds": worlds, "rows": keys, "hulls": hulls}))
    return drives


def ended(rows: list[dict[str, str]]) -> list[dict[str, str]]:
    """Returns rows whose numbers are written as a run's are, each with one outcome."""
    found = []
    for row in rows:
        won, hit = float(row["success"]), float(row["collision"])
        of = {"success": won, "collision": hit, "left_corridor": 0.0, "timeout": float(not won and not hit)}
        told = {name: f"{each:g}" for name, each in of.items()} | {"time": row["time"] or "60"}
        found.append(row | told | {"robot": "mine" if row["policy"] == "C" else "p3dx"})
    return found


def payload(text: str) -> tuple[Any, bytes]:
    content = zlib.decompress(base64.b64decode(text.partition('id="payload">')[2].partition("<")[0]))
    size = int.from_bytes(content[:4], "little")
    return json.loads(content[4 : 4 + size]), content[4 + size :]


@pytest.fixture(scope="module")
def gathered(tmp_path_factory: pytest.TempPathFactory) -> Any:
    folder = tmp_path_factory.mktemp("run")
    rows = ended([row for row in rows_of(CONTESTS["goal-obstacles"], 2) if row["speed"] != "0.9"])
    keys = [f"{row['scenario']}#{row['episode']}#1" if k % 11 else "" for k, row in enumerate(rows)]
    hulls = [0.3 if k % 2 else [0.5, 0.4] for k in range(len(rows))]
    drives = folder_of(folder, rows, keys, hulls)
    content = Content()
    tables = [Table("t", ["a"], [["b"]], "n")]
    page._gather(Section(folder, tables, ("A sentence.", tables[0])), content)
    return rows, keys, hulls, drives, content, tables


def test_episodes_of_the_compared_splits_are_told_with_their_worlds(gathered: Any) -> None:
    rows, keys, hulls, drives, content, tables = gathered
    worlds: list[str] = []
    wanted, kept = [], []
    for k, (row, key) in enumerate(zip(rows, keys, strict=True)):
        if not key or row["split"] != "test":
            continue
        if key not in worlds:
            worlds.append(key)
        gains = row["gains_name"]
        wanted.append(
            {
                "contest": "goal-obstacles", "family": row["family"], "tier": row["tier"], "agent": row["agent_seed"],
                "policy": row["policy"] + (f" ({gains})" if gains != "default" else ""), "robot": row["robot"],
                "plant": "kinematic", "actuators": "lagged", "disturbance": "none", "time": float(row["time"]),
                "outcome": next(name for name in OUTCOMES if row[name] == "1"), "world": worlds.index(key),
                "episode": int(row["episode"]), **({"hull": hulls[k]} if row["robot"] == "mine" else {}),
            }
        )  # fmt: skip
        kept.append(drives.get(k))
    assert content.episodes == wanted
    assert [each["name"] for each in content.worlds] == worlds
    for mine, drive in zip(kept, content.drives, strict=True):
        assert (mine is None) == (drive is None)
        assert mine is None or np.array_equal(mine, drive)
    assert content.tables == tables
    assert content.seeds == {row["seed"] for row in rows}
    assert content.sentences[0] == "A sentence."
    assert {sentence.split(" with ")[1].split(":")[0] for sentence in content.sentences[1:]} == {"p3dx", "mine"}
    fronts = [chart for chart in content.charts if chart["kind"] == "front"]
    assert [chart["title"].split(", ")[1].split(":")[0] for chart in fronts] == ["p3dx", "mine"]
    assert content.missing == []


def test_a_documents_episode_has_its_own_words(tmp_path: Path) -> None:
    row = {
        "document": "A", "experiment": "course", "policy": "lqr", "gains": "k=2", "gains_name": "default", "robot": "",
        "dynamics": "kinematic", "actuators": "ideal", "disturbance": "none", "episode": "4", "seed": "7",
        "success": "0", "collision": "0", "left_corridor": "1", "timeout": "0", "time": "3.5",
        "cross_track_rms": "0.25",
    }  # fmt: skip
    told = page._episode(row, 3)
    assert (told["contest"], told["family"], told["policy"], told["outcome"]) == (
        "A",
        "course",
        "lqr k=2",
        "left_corridor",
    )
    assert (told["error"], told["world"], told["episode"], told["agent"], told["tier"]) == (0.25, 3, 4, "", "")
    assert page._episode(row | {"gains": ""}, 0)["policy"] == "lqr"
    assert "error" not in page._episode(row | {"cross_track_rms": ""}, 0)
    write_rows(tmp_path, [row])
    content = Content()
    page._gather(Section(tmp_path, []), content)
    assert (len(content.missing), content.episodes, content.charts) == (1, [], [])
    folder_of(tmp_path, [row] * 3, ["a", "", "a"], [])
    write_rows(tmp_path, [row] * 2)
    with pytest.raises(ValueError, match="tells of 3 episodes; there are 2"):
        page._gather(Section(tmp_path, []), Content())


def test_the_page_s_bytes_lead_to_every_drive_and_constant(gathered: Any) -> None:
    content, tables = gathered[4], gathered[5]
    text = rendered("A <title>", content, [["what", "<how>"]], page.BUDGET)
    told, rest = payload(text)
    assert told["episodes"] == [
        each | ({"drive": k} if content.drives[k] is not None else {}) for k, each in enumerate(content.episodes)
    ]
    assert told["worlds"] == content.worlds
    assert told["made"] == [["what", "<how>"]]
    assert told["hulls"] == {name: robot.hull_radius for name, robot in ROBOTS.items()}
    assert told["boxes"] == {name: list(robot.hull_box) for name, robot in ROBOTS.items() if robot.hull_box}
    assert told["tables"] == [{"title": "t", "header": ["a"], "rows": [["b"]], "note": "n"}]
    end = 0
    for key, (at, steps, columns) in told["drives"].items():
        drive = content.drives[int(key)]
        assert (at, steps, columns) == (end, *drive.shape)
        end = at + len(packed(drive))
        np.testing.assert_array_equal(unfolded(rest[at:end], columns), drive)
    home = resources.files("wayfield.benchmarks.report") / "page"
    module = (home / "kernels.wasm").read_bytes()
    kernels, at = told["kernels"], told["kernels"]["module"]
    assert at == [end, len(module)]
    assert rest[at[0] : at[0] + at[1]] == module
    constants = [rest[first : first + length] for first, length in kernels["blobs"]]
    assert sum(map(len, constants)) + sum(at) == len(rest)
    source = json.loads((home / "kernels.json").read_text(encoding="utf-8"))
    blobs = [base64.b64decode(each) for each in source["blobs"]]
    assert len(constants) == len(set(constants))
    for task, mine in kernels["tasks"].items():
        whole = source["tasks"][task]
        assert set(mine["params"]) == {key for key in whole["params"] if key.split()[0] == "p3dx"}
        for key, k in mine["params"].items():
            assert constants[k] == blobs[whole["params"][key]]
        if whole["directions"] is not None:
            assert constants[mine["directions"]] == blobs[whole["directions"]]
    assert set(kernels["pilots"]) == {key for key in source["pilots"] if key.split()[1] == "p3dx"}
    for key, mine in kernels["pilots"].items():
        whole = source["pilots"][key]
        for name in ("sizes", "numbers"):
            assert name not in whole or constants[mine[name]] == blobs[whole[name]]
        for one, other in zip(mine.get("arguments", ()), whole.get("arguments", ()), strict=True):
            assert "blob" not in other or constants[one["blob"]] == blobs[other["blob"]]
            assert {k: v for k, v in one.items() if k != "blob"} == {k: v for k, v in other.items() if k != "blob"}
    assert "<title>A &lt;title&gt;</title>" in text
    assert "<dt>what</dt><dd>&lt;how&gt;</dd>" in text
    for sentence in content.sentences:
        assert f"<p>{html.escape(sentence)}</p>" in text
    for table in content.small:
        cells = "".join(f"<td>{html.escape(cell)}</td>" for cell in table.rows[0])
        heads = "".join(f'<th scope="col">{html.escape(cell)}</th>' for cell in table.header)
        assert f"<thead><tr>{heads}</tr></thead><tbody><tr>{cells}</tr>" in text
        assert f'<p class="note">{html.escape(table.note)}</p>' in text
    assert tables


def test_what_is_replayed_where_there_is_no_room_for_all() -> None:
    """The first scenario of every family and tier with the first agent, then the others, in their order."""
    rng = np.random.default_rng(3)
    content = Content()
    for k, (policy, family, tier, world, agent) in enumerate(
        itertools.product("pq", ("wide", "narrow"), ("easy", "hard"), range(3), ("", "0", "1"))
    ):
        at = ("wide", "narrow").index(family) * 6 + ("easy", "hard").index(tier) * 3 + world
        content.episodes.append(
            {
                "contest": "c",
                "robot": "r",
                "family": family,
                "tier": tier,
                "policy": policy,
                "world": at,
                "agent": agent,
            }
        )
        content.drives.append(None if k == 5 else rng.integers(-999, 999, (20, 3)).astype(np.int32))
    order = sorted(
        range(len(content.episodes)),
        key=lambda k: (
            max(content.episodes[k]["world"] % 3, int(content.episodes[k]["agent"] or 0)),
            content.episodes[k]["world"] % 3,
            k,
        ),
    )
    order.remove(5)
    sizes = np.cumsum([len(zlib.compress(packed(content.drives[k]), 6)) for k in order])  # type: ignore[arg-type]
    for count in (0, 1, 17, len(order)):
        room = int(sizes[count - 1]) if count else 10
        assert page._chosen(content, room) == set(order[:count])
        assert page._chosen(content, room - 1) == set(order[: max(count - 1, 0)])
    assert page._chosen(content, 10**9) == set(order)


def test_the_readme_s_table_says_what_its_mark_means() -> None:
    made = {
        "command": "c", "version": "1", "commit": "", "code": "", "date": "d", "scenarios": 3, "stale": False,
    }  # fmt: skip
    header = ["policy", "gains", "learned from", "knows", "success (%)", "RMS error (m)", "typical (m)", "mean speed"]
    for speed, marked in (("0.600", False), ("0.400 ‡", True)):
        rows = [("stanley", "tuned", "0.600"), ("mpc", "tuned", speed), ("lqr", "default", "0.100 ‡")]
        lines = [",".join(header), *(f"{policy},{gains},1,2,3,4,5,{last}" for policy, gains, last in rows)]
        kept = Kept(
            Path("nowhere"),
            {
                "docs/results/path-following.json": json.dumps(made).encode(),
                "docs/results/path_following_p3dx.csv": "\n".join(lines).encode(),
            },
        )
        table, empty, told = _contenders(kept)
        cells = [[each.strip() for each in line.strip("|").split("|")] for line in table.splitlines()[2:]]
        assert cells == [["`stanley`", "tuned", *"12345", "0.600"], ["`mpc`", "tuned", *"12345", speed]]
        assert empty == ""
        assert told.startswith("Made by `c`, wayfield 1, d; 3 scenarios.")
        assert told.endswith("‡: not at the speed that was asked for.") is marked
    assert _contenders(Kept(Path("nowhere"))) == ["No run of this version is published."]


def test_how_a_report_was_made() -> None:
    content = Content(seeds={str(k) for k in (3, 1, 12)})
    told = dict(page.made("evaluate x", content))
    assert (told["command"], told["seeds"]) == ("evaluate x", "1, 3, 12")
    assert len(told["code"]) == 12
    assert dict(page.made("", Content(seeds={str(k) for k in range(8)})))["seeds"] == "0, 1, 2, 3, 4, 5, 6, 7"
    assert dict(page.made("", Content(seeds={str(k) for k in range(4, 13)})))["seeds"] == "4 to 12"
    assert "seeds" not in dict(page.made("", Content()))
