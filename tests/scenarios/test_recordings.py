"""Recorded people: they walk as the file says, and a faulty file is refused in a line."""

from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
import pytest

import wayfield  # noqa: F401  registers the environments
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
    one, two = recorded(tmp_path / "one"), recorded(tmp_path / "two")
    assert len(one) == len(two) > 0
    for a, b in zip(one, two, strict=True):
        assert a.tracks.tobytes() == b.tracks.tobytes()
        assert a.walks.tobytes() == b.walks.tobytes()


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("0 1 0 0\n0 1 1 1\n", "2: id 1 is in frame 0 twice, first in line 1; it must be there once"),
        ("", "1: holds no rows; a row is frame, id, x, y"),
        ("0 1 0\n", "1: has 3 columns; a row has 4: frame, id, x, y"),
        ("0 1.5 0 0\n", "1: id is '1.5'; it must be a whole number"),
        ("0 1 0 0\n10 1 x 0\n", "2: x is 'x'; it must be a number from -10000 to 10000, in m"),
        (
            plain({1: (0, walk(0.0, 0.0, 1.0, 0.0, 12))}) + "200 1 9 9\n",
            "13: id 1 has no row between the frames 110 and 200; its rows must be 10 frames apart, as most are",
        ),
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
