"""Blocks of obstacles, rays into grids, and how values are shown, in plain Python."""

import math
from typing import Any

import numpy as np
import pytest

from wayfield.envs.world import blocks
from wayfield.envs.world.geometry import OBSTACLE
from wayfield.system import checks

# Blocks of obstacles.


def scattered(rng: np.random.Generator, count: int) -> Any:
    field = np.zeros(count, OBSTACLE)
    field["x"], field["y"] = rng.uniform(-20, 20, count), rng.uniform(-5, 9, count)
    field["cos"] = 1.0
    for name in ("half_length", "half_width", "radius"):
        field[name] = rng.uniform(0.0, 0.5, count)
    return field


def halved(part: Any) -> None:
    """Asserts that a part is halved across where it is wide, the first half of whole blocks, twice as many each."""
    if len(part) <= 16:
        return
    half = 16 * 2 ** (math.ceil(math.log2(len(part) / 16)) - 1)
    across = "x" if np.ptp(part["x"]) >= np.ptp(part["y"]) else "y"
    assert part[across][:half].max() <= part[across][half:].min()
    halved(part[:half])
    halved(part[half:])


@pytest.mark.parametrize("count", [129, 144, 200, 256, 257, 700])
def test_many_obstacles_are_halved_into_blocks_with_discs_around_them(count: int) -> None:
    rng = np.random.default_rng(count)
    fields = np.zeros((3, count), OBSTACLE)
    counts = np.array([count, 128, count - 1])
    for row, number in zip(fields, counts, strict=True):
        row[:number] = scattered(rng, number)
    placed, found = blocks.in_blocks(fields, counts)
    assert found.tolist() == [math.ceil(count / 16), 0, math.ceil((count - 1) / 16) if count > 129 else 0]
    assert placed[1, :128].tolist() == fields[1, :128].tolist()
    whole = math.ceil(count / 16)
    assert placed.shape == (3, count + whole + math.ceil(whole / 16))
    for row, number, many in zip(placed, counts.tolist(), found.tolist(), strict=True):
        if not many:
            continue
        assert sorted(row[:number].tolist()) == sorted(fields[0 if number == count else 2, :number].tolist())
        halved(row[:number])
        of_blocks, of_many = row[number : number + many], row[number + many : number + many + math.ceil(many / 16)]
        for discs, inside in ((of_blocks, row[:number]), (of_many, of_blocks)):
            for k, disc in enumerate(discs):
                part = inside[16 * k : 16 * k + 16]
                x, y = (0.5 * (part[a].min() + part[a].max()) for a in "xy")
                far = np.hypot(part["x"] - x, part["y"] - y) + part["half_length"] + part["half_width"] + part["radius"]
                assert (disc["x"], disc["y"]) == (x, y)
                assert disc["radius"] == pytest.approx(far.max(), rel=2e-9)
                assert disc["radius"] >= far.max()
                assert (disc["cos"], disc["sin"], disc["half_length"], disc["half_width"]) == (1.0, 0.0, 0.0, 0.0)
    few, none = blocks.in_blocks(fields[:, :128], np.array([128, 5, 0]))
    assert not none.any()
    assert few.shape == (3, 128)


# Grids.


# Values.


@pytest.mark.parametrize(
    ("value", "found"),
    [(1, 1.0), (np.float32(0.5), 0.5), (10**400, math.inf), (-(10**400), -math.inf), (True, math.nan), ("1", math.nan),
     (None, math.nan), (1j, math.nan), (np.array([1.0]), math.nan)],
)  # fmt: skip
def test_what_is_a_real_number(value: Any, found: float) -> None:
    assert checks.real(value) == pytest.approx(found, nan_ok=True)
