"""Worlds of the BARN challenge: the table they are read from, the robot in them, and what is refused."""

import gzip
from pathlib import Path

import pytest
from click.testing import CliRunner

from wayfield.benchmarks import barn

HEADER = "world,x_m,y_m,radius_m\n"
SHARED = Path(__file__).parents[2] / "shared" / "data" / "barn"


def written(folder: Path, text: str) -> Path:
    folder.mkdir(exist_ok=True)
    with gzip.open(folder / barn.CYLINDERS, "wt", encoding="utf-8") as table:
        table.write(text)
    return folder


def ring(world: int, x: float) -> str:
    """Returns the rows of a pen, 4.5 m x 6 m, that leaves the robot no way out."""
    across = [f"{world},{x - 4.5 + 0.15 * k},{y},0.1" for k in range(31) for y in (1.8, 8.0)]
    along = [f"{world},{side},{1.8 + 0.15 * k},0.1" for k in range(42) for side in (x - 4.5, x)]
    return "\n".join(across + along) + "\n"


def test_worlds_are_passed_in_the_order_of_the_table(tmp_path: Path) -> None:
    folder = written(tmp_path / "worlds", HEADER + "0,-5,8,0.1\n" + "4,-2.25,8,0.3\n")
    assert {world: len(circles) for world, circles in barn.worlds(folder).items()} == {0: 1, 4: 1}
    for count in (1, 2):
        options = ["--policies", "astar_tracker", "--workers", "1", "--first", str(count)]
        run = CliRunner().invoke(barn.main, [str(folder), *options])
        assert run.exit_code == 0, run.output
        assert f"{count}/{count}" in run.output


def test_a_world_without_a_way_is_refused_by_name(tmp_path: Path) -> None:
    folder = written(tmp_path / "worlds", HEADER + ring(1, 0.0))
    run = CliRunner().invoke(barn.main, [str(folder), "--policies", "astar_tracker", "--workers", "1"])
    assert run.exit_code == 2
    assert "'world_1' has no way" in run.output


@pytest.mark.parametrize(
    ("text", "said"),
    [
        (HEADER, "holds no cylinders"),
        (HEADER + "0,1,2\n", r":2: .* lacks a number"),
        ("world,x,y,radius\n0,1,2,0.1\n", r":2: .* lacks a number"),
        (HEADER + "0,1,2,0.1\n0,1,wide,0.1\n", r":3: .* lacks a number"),
        (HEADER + "0,1,2,0.1\n0,1,2,-0.1\n", r":3: circle radius is -0.1"),
        (HEADER + "0,1,2,0.1\n0,1,nan,0.1\n", r":3: circle y is nan"),
        (HEADER + "0,1,2,0.1\n" + 200_000 * "9" + ",1,2,0.1\n", r":3: field larger"),
        (HEADER + '0,1,2,0.1\n"0"x,1,2,0.1\n', r":3: .* expected after"),
    ],
)
def test_other_tables_are_refused_by_line(tmp_path: Path, text: str, said: str) -> None:
    with pytest.raises(ValueError, match=said):
        barn.worlds(written(tmp_path / "worlds", text))


def test_a_folder_without_worlds_is_one_line(tmp_path: Path) -> None:
    run = CliRunner().invoke(barn.main, [str(tmp_path)])
    assert run.exit_code == 2
    assert run.output.strip().count("\n") == 0
    (tmp_path / barn.CYLINDERS).write_bytes(b"not gzipped")
    with pytest.raises(ValueError, match="is no gzipped table"):
        barn.worlds(tmp_path)


def test_a_table_cut_anywhere_is_one_line_that_names_it(tmp_path: Path) -> None:
    folder = written(tmp_path / "worlds", HEADER + "".join(f"{k},-5,{k},0.1\n" for k in range(200)))
    whole = (folder / barn.CYLINDERS).read_bytes()
    for at in range(1, len(whole), 17):
        (folder / barn.CYLINDERS).write_bytes(whole[:at] + bytes([whole[at] ^ 0xFF]) + whole[at + 1 : at + 5])
        with pytest.raises(ValueError, match=r"cylinders\.csv\.gz:\d+: "):
            barn.worlds(folder)


def test_a_world_that_cannot_be_driven_is_named_with_its_table(tmp_path: Path) -> None:
    folder = written(tmp_path / "worlds", HEADER + "0,-5,8,0.1\n7,-2.25,3,0.1\n")
    run = CliRunner().invoke(barn.main, [str(folder), "--policies", "astar_tracker", "--workers", "1"])
    assert run.exit_code == 2
    assert f"{folder / barn.CYLINDERS}: world 7: " in run.output
    assert "json" not in run.output


@pytest.mark.skipif(not SHARED.exists(), reason="the worlds are not here")
def test_the_real_worlds_are_read() -> None:
    found = barn.worlds(SHARED)
    assert sorted(found) == list(range(0, 300, 5))
    assert all(0.0 < circle["radius"] < 1.0 for circles in found.values() for circle in circles)  # type: ignore[operator]
