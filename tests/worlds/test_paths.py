"""Paths: the windowed nearest-point search against a search over every segment, laps, and points by arc length."""

import math

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st
from numpy.typing import NDArray

from wayfield.envs.world.paths import Path, PathPool, along_lap, nearest_ahead, segment_at, walk_to

COORDINATES = st.floats(-4.0, 4.0).map(lambda value: round(value, 3))
FRACTIONS = st.floats(0.0, 1.0)


@st.composite
def paths(draw: st.DrawFn) -> Path:
    """Random polylines that may cross themselves; half of them closed."""
    closed = draw(st.booleans())
    points = draw(st.lists(st.tuples(COORDINATES, COORDINATES), min_size=3, max_size=25, unique=True))
    return Path(points, closed)


def unrolled(path: Path, laps: int) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Returns the vertices (n, 2) of several laps behind one another and their arc lengths (n,)."""
    ring = np.vstack([path.points, path.points[:1]]) if path.closed else path.points
    points = np.vstack([ring, *[ring[1:]] * (laps - 1)]) if path.closed else ring
    return points, np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(points, axis=0).T))])


def nearest_of_all(
    path: Path, x: float, y: float, first: float, last: float
) -> tuple[float, NDArray[np.float64], NDArray[np.float64]]:
    """Returns the least distance, and the distances and arc lengths of the candidate of each segment."""
    points, s = unrolled(path, 5)
    best, at = [], []
    for a, b, sa, sb in zip(points[:-1], points[1:], s[:-1], s[1:], strict=True):
        low, high = max(sa, first), min(sb, last)
        if low > high:
            continue
        u = (b - a) / (sb - sa)
        t = min(max((np.array([x, y]) - a) @ u, low - sa), high - sa)
        best.append(float(np.hypot(*(a + t * u - [x, y]))))
        at.append(sa + t)
    return min(best), np.array(best), np.array(at)


def point_at(path: Path, s: float) -> NDArray[np.float64]:
    points, arc_lengths = unrolled(path, 5)
    return np.array([np.interp(s, arc_lengths, points[:, k]) for k in range(2)])


# there and back again, to the end of the lap: the last segment begins half a lap before it
@example(
    path=Path([(0.0, 0.0), (0.0, -1.0), (0.0, -2.0)], closed=True), x=0.0, y=0.0, fraction=1.0, lap=0, window=math.inf
)
@given(
    paths(), COORDINATES, COORDINATES, FRACTIONS, st.integers(0, 2), st.one_of(st.floats(0.0, 60.0), st.just(math.inf))
)
def test_the_windowed_search_finds_the_nearest_point(
    path: Path, x: float, y: float, fraction: float, lap: int, window: float
) -> None:
    pool = PathPool.of([Path([(9.0, 9.0), (8.0, 9.0)]), path])
    run = pool.runs[1]
    inside = fraction * path.length
    segment = segment_at(pool.vertices, run, inside)
    start = inside + (lap * path.length if path.closed else 0.0)
    s, segment = nearest_ahead(pool.vertices, run, x, y, start, segment, window)
    last = min(start + min(window, path.length), math.inf if path.closed else path.length)
    least, distances, candidates = nearest_of_all(path, x, y, start, last)
    assert start - 1e-9 <= s <= last + 1e-9
    assert np.hypot(*(point_at(path, s) - [x, y])) == pytest.approx(least, abs=1e-9)
    # the first of equally near points, and of no other
    assert s <= candidates[distances <= least + 1e-12].max() + 1e-9
    assert s >= candidates[distances <= least + 1e-9].min() - 1e-6
    # the segment is the one that holds s
    along = along_lap(pool.vertices, run, s, segment)
    a, b = pool.vertices[run["first"] + segment], pool.vertices[run["first"] + segment + 1]
    assert a["s"] - 1e-9 <= along <= b["s"] + 1e-9
    assert [a["x"] + (along - a["s"]) * a["ux"], a["y"] + (along - a["s"]) * a["uy"]] == pytest.approx(
        point_at(path, s).tolist(), abs=1e-9
    )


@given(
    st.lists(st.sampled_from([0.01, 0.3, 3.0]), min_size=4, max_size=16),
    st.lists(st.floats(-1.5, 1.5), min_size=16, max_size=16), st.integers(0, 15), FRACTIONS, st.floats(-1.0, 1.0),
)  # fmt: skip
def test_the_search_skips_no_block_of_long_and_short_segments(
    lengths: list[float], turns: list[float], k: int, fraction: float, aside: float
) -> None:
    """A point beside any segment of an unevenly sampled path is found, though the middle of its block be far away."""
    headings = np.cumsum(turns[: len(lengths)])
    steps = np.array(lengths)[:, None] * np.column_stack([np.cos(headings), np.sin(headings)])
    path = Path(np.vstack([[0.0, 0.0], np.cumsum(steps, axis=0)]))
    pool = PathPool.of([path])
    k %= len(lengths)
    beside = path.points[k] + fraction * steps[k] + aside * np.array([-np.sin(headings[k]), np.cos(headings[k])])
    s, _ = nearest_ahead(pool.vertices, pool.runs[0], *beside, 0.0, 0, 100.0)
    least, _, _ = nearest_of_all(path, *beside, 0.0, path.length)
    assert np.hypot(*(point_at(path, s) - beside)) == pytest.approx(least, abs=1e-9)


def test_equally_near_points_give_the_first() -> None:
    square = Path([(1.0, 1.0), (-1.0, 1.0), (-1.0, -1.0), (1.0, -1.0)], closed=True)
    pool = PathPool.of([square])
    for first, wanted in ((0.0, 1.0), (1.5, 3.0), (3.5, 5.0), (7.5, 9.0)):
        inside = first % 8.0
        s, _ = nearest_ahead(pool.vertices, pool.runs[0], 0.0, 0.0, first, int(inside // 2), 8.0)
        assert s == pytest.approx(wanted)


# folded back: of the two branches at 1.2 m the search takes the one at 0.8 m, from where 1.8 m is beyond its window
@example(Path([(-1.0, 0.0), (0.0, 0.0), (-2.0, 0.0)], closed=False), [1.0, 1.0, 1.0])
@given(paths(), st.lists(st.floats(0.0, 3.0), min_size=1, max_size=60))
def test_following_a_point_along_laps_never_goes_back(path: Path, steps: list[float]) -> None:
    pool = PathPool.of([path])
    run = pool.runs[0]
    s, segment, there = 0.0, 0, 0.0
    for step in steps:
        there = there + min(step, 0.2 * path.length)
        if there > (4.0 * path.length if path.closed else path.length):
            break
        x, y = point_at(path, there)
        before = s
        s, segment = nearest_ahead(pool.vertices, run, x, y, s, segment, 0.3 * path.length)
        assert s >= before
        if not before <= there <= before + 0.3 * path.length:
            break  # the path lies upon itself, and another branch was as near or, by rounding, nearer
        assert point_at(path, s).tolist() == pytest.approx([x, y], abs=1e-9)


@given(paths(), FRACTIONS, st.lists(st.floats(0.0, 2.0), min_size=1, max_size=8))
def test_walking_ahead_reaches_the_point_at_the_arc_length(path: Path, fraction: float, steps: list[float]) -> None:
    pool = PathPool.of([path])
    run = pool.runs[0]
    s = fraction * path.length
    segment = segment_at(pool.vertices, run, s)
    total = s
    for step in steps:
        step = min(step, 0.5 * path.length)
        total += step
        x, y, s, segment = walk_to(pool.vertices, run, s + step, segment)
        wanted = point_at(path, total % path.length if path.closed else min(total, path.length))
        assert [x, y] == pytest.approx(wanted.tolist(), abs=1e-9)
        if path.closed:
            assert math.remainder(s - total, path.length) == pytest.approx(0.0, abs=1e-9)


@given(paths(), FRACTIONS)
def test_bisection_finds_the_segment(path: Path, fraction: float) -> None:
    pool = PathPool.of([path])
    run = pool.runs[0]
    s = fraction * path.length
    k = segment_at(pool.vertices, run, s)
    assert pool.vertices["s"][k] <= s
    assert k == run["segments"] - 1 or s < pool.vertices["s"][k + 1]


@given(paths())
def test_vertices_carry_arc_length_and_unit_tangents(path: Path) -> None:
    v = path.vertices
    np.testing.assert_allclose(np.hypot(v["ux"], v["uy"]), 1.0, rtol=1e-12)
    steps = np.diff(v["s"])
    np.testing.assert_allclose(v["x"][:-1] + steps * v["ux"][:-1], v["x"][1:], atol=1e-12)
    np.testing.assert_allclose(v["y"][:-1] + steps * v["uy"][:-1], v["y"][1:], atol=1e-12)
    x, y, heading = path.start_pose
    assert (x, y) == tuple(path.points[0])
    assert (math.cos(heading), math.sin(heading)) == pytest.approx((v["ux"][0], v["uy"][0]), abs=1e-12)


@pytest.mark.parametrize(
    ("points", "closed", "message"),
    [
        ([(0, 0)], False, "at least 2 points, got 1"),
        ([(0, 0), (1, 0)], True, "a closed path needs at least 3 points, got 2"),
        ([(0, 0, 0), (1, 0, 0)], False, "shape (n, 2), got (2, 3)"),
        ([(0, 0), (1, math.nan)], False, "path point 1"),
        ([(0, 0), (1, 0), (1, 0)], False, "path points 1 and 2"),
        ([(0, 0), (1, 0), (0, 0)], True, "path points 2 and 0"),
        ([("a", "b"), (1, 0)], False, "must be numbers"),
    ],
)
def test_faulty_paths_are_refused(points: list[object], closed: bool, message: str) -> None:
    with pytest.raises(ValueError, match=message.replace("(", r"\(").replace(")", r"\)")):
        Path(points, closed)  # type: ignore[arg-type]
