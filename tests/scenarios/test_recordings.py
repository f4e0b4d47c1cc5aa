"""Recorded people: they walk as the file says, and a faulty file is refused in a line."""

import os
import warnings
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
import pytest

import wayfield  # noqa: F401  registers the environments
from wayfield.envs.crowds.people import track_place
from wayfield.envs.scenarios.recordings import recorded


def plain(people: dict[int, Any], step: int = 10) -> str:
    rows = [
        (frame * step, i, x, y) for i, (first, places) in people.items() for frame, (x, y) in enumerate(places, first)
    ]
    return "".join(f"{frame}\t{i}\t{x:.4f}\t{y:.4f}\n" for frame, i, x, y in sorted(rows))


def walk(x: float, y: float, vx: float, vy: float, count: int) -> Any:
    return np.array([x, y]) + 0.4 * np.arange(count)[:, None] * (vx, vy)


PEOPLE = {
    1: (0, walk(0.0, 0.0, 1.2, 0.0, 20)),
    2: (3, walk(5.0, 3.0, -1.0, -0.1, 30)),
    7: (12, walk(2.0, -2.0, 0.0, 0.1, 9)),
}


def test_people_walk_as_recorded_while_the_robot_stands_for_one_of_them(tmp_path: Path) -> None:
    (tmp_path / "crowds.txt").write_text(plain(PEOPLE))
    found = recorded(tmp_path)
    assert [each.name.rpartition("_")[2] for each in found] == ["1", "2"]  # the third walks too short a way
    scenario = found[0]
    np.testing.assert_allclose(scenario.starts[0, :2], PEOPLE[1][1][0])
    np.testing.assert_allclose(scenario.goals[0, :2], PEOPLE[1][1][-1])
    env: Any = gymnasium.make("wayfield/OmniPeople-v0", scenario=str(tmp_path), sees="bodies").unwrapped
    env.reset(seed=0, options={"scenario": 0})
    for step in range(1, 281):
        env.step(np.zeros(3))
        (there,) = env.task.walking(env.batch.own)
        time = 0.05 * step
        for k, i in enumerate((2, 7)):
            first, places = PEOPLE[i]
            at = time - 0.4 * first
            assert there[k, 4] == (-1e-6 <= at <= 0.4 * (len(places) - 1) + 1e-6)
            if there[k, 4]:
                velocity = (places[1] - places[0]) / 0.4
                np.testing.assert_allclose(there[k, :2], places[0] + at * velocity, atol=2e-4)
                np.testing.assert_allclose(there[k, 2:4], velocity, atol=2e-3)


def test_both_forms_say_the_same(tmp_path: Path) -> None:
    (tmp_path / "one").mkdir()
    (tmp_path / "two").mkdir()
    (tmp_path / "one" / "biwi.txt").write_text(plain(PEOPLE))
    rows = [line.split() for line in plain(PEOPLE, 6).splitlines()]
    eth = "".join(f"  {int(f):.7e} {int(i):.7e} {x} 0 {y} 9 9 9\n" for f, i, x, y in rows)
    (tmp_path / "two" / "obsmat.txt").write_text(eth)
    (tmp_path / "three").mkdir()  # by the millisecond since 1970, under the columns' names
    stamped = "".join(f"{1_700_000_000_000 + 400 * int(f) // 6},{i},{x},{y}\n" for f, i, x, y in rows)
    (tmp_path / "three" / "log.txt").write_text(f"Frame,ID,X,Y\n{stamped}")
    one, *others = (recorded(tmp_path / name) for name in ("one", "two", "three"))
    for other in others:
        assert len(one) == len(other) > 0
        for a, b in zip(one, other, strict=True):
            assert a.tracks.tobytes() == b.tracks.tobytes()
            assert a.walks.tobytes() == b.walks.tobytes()


def test_missing_rows_are_filled_in_and_long_gaps_part_a_person(tmp_path: Path) -> None:
    (tmp_path / "whole").mkdir()
    (tmp_path / "gaps").mkdir()
    rows = plain(PEOPLE).splitlines(keepends=True)
    (tmp_path / "whole" / "a.txt").write_text("".join(rows))
    held = {f"{10 * frame}\t{person}\t" for frame, person in ((5, 1), (6, 1), (9, 2), (20, 2))}
    (tmp_path / "gaps" / "a.txt").write_text("".join(row for row in rows if not row.startswith(tuple(held))))
    whole = recorded(tmp_path / "whole")
    with pytest.warns(UserWarning, match=r"a\.txt: 4 missing rows are filled in along straight lines; rows are"):
        filled = recorded(tmp_path / "gaps")
    for a, b in zip(whole, filled, strict=True):  # who walks straight on walks the same
        np.testing.assert_allclose(b.tracks, a.tracks, atol=2e-4)
        assert (a.starts.tobytes(), a.goals.tobytes()) == (b.starts.tobytes(), b.goals.tobytes())
    late = "".join(f"{10 * (40 + k)}\t1\t{9.0 + 0.4 * k}\t3\n" for k in range(20))
    (tmp_path / "gaps" / "a.txt").write_text("".join(rows) + late)
    with pytest.warns(UserWarning, match=r"a\.txt: at 1 gaps of more than 2 s, or jumps, a person leaves and another"):
        parted = recorded(tmp_path / "gaps")
    assert [each.name for each in parted] == ["gaps_1", "gaps_1.1", "gaps_2"]
    assert (len(parted[0].walks), len(whole[0].walks)) == (3, 2)
    last = max(int(row.split()[0]) for row in rows if row.split()[1] == "1")
    jumped = "".join(f"{last + 10 * (k + 1)}\t1\t{60.0 + 0.4 * k}\t3\n" for k in range(20))
    (tmp_path / "gaps" / "a.txt").write_text("".join(rows) + jumped)
    with pytest.warns(UserWarning, match="at 1 gaps .* or jumps"):
        assert [each.name for each in recorded(tmp_path / "gaps")] == ["gaps_1", "gaps_1.1", "gaps_2"]


@pytest.mark.parametrize("rate", [2.5, 10.0, 16.0, 25.0])
def test_rows_of_another_rate_are_read_at_it_and_noticed_without(tmp_path: Path, rate: float) -> None:
    ways = {1: ((0.0, 0.0), (1.3, 0.0)), 2: ((8.0, 3.0), (-1.2, 0.2))}
    file = tmp_path / "crowd.txt"
    seconds = np.arange(round(20.0 * rate) + 1)[:, None] / rate
    file.write_text(plain({i: (0, np.array(at) + seconds * velocity) for i, (at, velocity) in ways.items()}, 1))
    first, second = recorded(file, rate)
    for scenario, other in ((first, 2), (second, 1)):
        (person,) = scenario.walks
        assert person["frame_time"] == 1.0 / rate
        assert person["speed"] == pytest.approx(np.hypot(*ways[other][1]), abs=1e-3)
        velocities = scenario.tracks[scenario.walked_rows, 2:] * rate
        np.testing.assert_allclose(velocities, [ways[other][1]] * len(velocities), atol=4e-3)
    named = recorded(f"{file}@{rate:g}")
    assert [each.walks.tobytes() for each in named] == [first.walks.tobytes(), second.walks.tobytes()]
    if rate == 2.5:
        assert [each.name for each in recorded(file)] == [first.name, second.name]
        return
    with pytest.warns(UserWarning, match=r"crowd\.txt: people walk at 0\.\d+ m/s .* such as crowd\.txt@[\d.]+") as said:
        recorded(file)
    assert float(str(said[0].message).rpartition("@")[2].split()[0]) == pytest.approx(rate, rel=0.1)
    for wrong in (0.0, -1.0, float("nan"), 1e9):
        with pytest.raises(ValueError, match="rate is"):
            recorded(file, wrong)
    for behind in ("", "fast", "0", "nan"):
        with pytest.raises(ValueError, match="rate is"):
            gymnasium.make("wayfield/OmniPeople-v0", scenario=f"{file}@{behind}")


@pytest.mark.parametrize(("factor", "said"), [(1.0, ""), (0.1, "walk at 0.13 m/s"), (10.0, "walk at 13 m/s")])
def test_people_who_stand_do_not_slow_down_those_who_walk(factor: float, said: str, tmp_path: Path) -> None:
    stand = {i: (0, np.tile([3.0 * i, 40.0], (100, 1))) for i in range(1, 31)}
    go = {i: (0, walk(0.0, 2.0 * (i - 35), 1.3 * factor, 0.0, 100)) for i in range(31, 41)}
    (tmp_path / "crowd.txt").write_text(plain(stand | go))
    with warnings.catch_warnings(record=True) as found:
        warnings.simplefilter("always")
        try:
            assert len(recorded(tmp_path / "crowd.txt")) == 10
        except ValueError as error:
            found.append(error)  # type: ignore[arg-type]
    lines = [str(getattr(each, "message", each)) for each in found]
    assert [said in line for line in lines] == [True] * bool(said), lines


@pytest.mark.parametrize(("rate", "tremble", "lost"), [(2.5, 5, 0), (2.5, 40, 3), (30.0, 0, 0), (30.0, 3, 20)])
def test_stamps_in_milliseconds_that_tremble_are_rows_all_the_same(
    tmp_path: Path, rate: float, tremble: int, lost: int
) -> None:
    random, count = np.random.default_rng(0), round(20.0 * rate)
    stamps = np.round(1000.0 * np.arange(count) / rate + random.integers(-tremble, tremble + 1, count)).astype(int)
    kept = np.delete(stamps, np.linspace(2, count - 3, lost).astype(int))
    rows = [f"{1_700_000_000_000 + at} 1 {1.3e-3 * at:.4f} 0\n" for at in kept]
    (tmp_path / "a.txt").write_text("".join(rows) + "".join(row.replace(" 1 ", " 2 ", 1)[:-2] + "5\n" for row in rows))
    with warnings.catch_warnings(record=True) as said:
        warnings.simplefilter("always")
        scenario = recorded(f"{tmp_path / 'a.txt'}@{rate}")[0]
    assert [f": {2 * lost} missing rows" in str(each.message) for each in said] == [True] * bool(lost)
    (person,) = scenario.walks
    assert (person["rows"], person["speed"]) == (pytest.approx(count, abs=1), pytest.approx(1.3, rel=5e-3))


def test_a_recording_that_was_changed_is_read_again(tmp_path: Path) -> None:
    file = tmp_path / "crowd.txt"
    file.write_text(plain(PEOPLE))
    stamp, before = file.stat().st_mtime_ns, recorded(file)
    file.write_text(plain(PEOPLE).replace("5.0000", "5.1000"))  # of the same size, and at the same time
    os.utime(file, ns=(stamp, stamp))
    assert recorded(file)[0].tracks.tobytes() != before[0].tracks.tobytes()


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("0 1 0 0\n0 1 1 1\n", "2: id 1 is in frame 0 twice, first in line 1; it must be there once"),
        ("", "1: holds no rows; a row is frame, id, x, y"),
        ("0 1 0\n", "1: has 3 columns; a row has 4: frame, id, x, y"),
        (
            "frame_id ped_id x y\n0 1 0 0\n",
            "1: is 'frame_id ped_id x y'; a line that names columns is frame id x y, or",
        ),
        ("0 1.5 0 0\n", "1: id is '1.5'; it must be a whole number"),
        ("0 1 0 0\n10 1 x 0\n", "2: x is 'x'; it must be a number from -10000 to 10000, in m"),
        (
            plain({1: (0, walk(0.0, 0.0, 25.0, 0.0, 12))}),
            "1: people walk at 25 m/s in the median, at 0.4 s between rows; it must be from 0.05 to 4 m/s",
        ),
        (plain({1: (0, walk(0.0, 0.0, 0.2, 0.0, 12))}), "nobody walks 3 m in 4 s from a free place"),
    ],
)
def test_a_faulty_recording_is_refused_in_a_line(text: str, said: str, tmp_path: Path) -> None:
    (tmp_path / "crowd.txt").write_text(text)
    for name in (tmp_path, tmp_path / "crowd.txt"):
        with pytest.raises(ValueError, match=r"crowd\.txt:") as caught:
            gymnasium.make("wayfield/OmniPeople-v0", scenario=str(name))
        assert said in str(caught.value)
        assert "\n" not in str(caught.value)


def test_a_folder_of_several_recordings_asks_for_one(tmp_path: Path) -> None:
    for name in ("a.txt", "b.txt"):
        (tmp_path / name).write_text(plain(PEOPLE))
    with pytest.raises(ValueError, match=r"has 2 \.txt files and no obsmat\.txt; name one"):
        recorded(tmp_path)
    assert recorded(tmp_path / "a.txt")


def test_a_track_is_followed_to_its_own_last_row_and_no_farther() -> None:
    tracks = np.full((5, 4), np.nan)  # of others, before and behind
    tracks[1:4] = [[0.0, 1.0, 0.5, 0.0], [0.2, 1.1, 0.4, 0.1], [0.4, 1.3, 0.3, 0.2]]
    for row in range(3):
        np.testing.assert_allclose(track_place(tracks, 1, 3, float(row)), tracks[1 + row], atol=1e-12)
