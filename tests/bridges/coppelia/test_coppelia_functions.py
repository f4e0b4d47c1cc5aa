"""Reference implementations of what the server of CoppeliaSim's remote API computes."""

import itertools
import math
import struct

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

pytest.importorskip("zmq", reason='needs pip install "wayfield[coppelia]"')

from oracles.desk import Desk, refused

from wayfield.bridges.coppelia import frames


@pytest.fixture(scope="module")
def plain():
    """A desk for what only computes."""
    one = Desk()
    yield one
    one.server.close()


def drawn(seed, count=25):
    """Yields a generator and two placements with it: (position, rotation)."""
    rng = np.random.default_rng(seed)
    for _ in range(count):
        yield rng, *((rng.uniform(-3, 3, 3), Rotation.random(random_state=rng)) for _ in range(2))


def matrix(place, turn):
    return np.column_stack([turn.as_matrix(), place]).ravel().tolist()


def pose(place, turn):
    return [*place.tolist(), *turn.as_quat().tolist()]


# Matrices and angles.


def test_matrices_are_placements_in_space(plain):
    for _, (p, a), (q, b) in drawn(1):
        product = matrix(p + a.apply(q), a * b)
        assert plain.multiplyMatrices(matrix(p, a), matrix(q, b)) == pytest.approx(product, abs=1e-9)
        assert plain.getMatrixInverse(matrix(p, a)) == pytest.approx(matrix(-a.inv().apply(p), a.inv()), abs=1e-9)
        for given in (matrix(p, a), pose(p, a), [*p.tolist(), *(-3.0 * a.as_quat()).tolist()]):
            assert plain.multiplyVector(given, q.tolist()) == pytest.approx(list(p + a.apply(q)), abs=1e-9)
        assert frames.quaternion_from_euler(*a.as_euler("XYZ")) == pytest.approx(a.as_quat()) or (
            frames.quaternion_from_euler(*a.as_euler("XYZ")) == pytest.approx(-a.as_quat())
        )
        assert frames.euler_from_quaternion(a.as_quat()) == pytest.approx(a.as_euler("XYZ"), abs=1e-9)


@pytest.mark.parametrize("beta", [0.5 * math.pi, -0.5 * math.pi])
def test_at_a_right_angle_the_first_euler_angle_is_zero_and_the_turn_is_the_same(beta):
    for alpha, gamma in ((0.3, 0.4), (-2.0, 1.0), (0.0, 3.0)):
        turn = Rotation.from_euler("XYZ", [alpha, beta, gamma])
        found = frames.euler_from_quaternion(turn.as_quat())
        assert found[0] == 0.0
        assert Rotation.from_euler("XYZ", found).as_matrix() == pytest.approx(turn.as_matrix(), abs=1e-7)


def test_a_skew_matrix_and_a_zero_quaternion_are_refused(plain):
    good, place = matrix(np.zeros(3), Rotation.identity()), [0.0, 0.0, 0.0]
    skew = [*good[:4], 0.01, *good[5:]]
    refused("rows are not orthonormal", plain.getMatrixInverse, skew)
    refused("rows are not orthonormal", plain.multiplyVector, skew, place)
    refused("the quaternion is zero", plain.multiplyVector, [0.0] * 7, place)
    refused("got 8", plain.multiplyVector, [1.0] * 8, place)
    refused("12 numbers are needed, got 11", plain.getMatrixInverse, good[:11])
    refused("beyond 1e+06", plain.getMatrixInverse, [*good[:3], 2e6, *good[4:]])


# Paths as tables.


def slerp(a, b, share):
    """Returns the quaternion a share of the shorter way from a to b, by way of rotation vectors."""
    first, second = Rotation.from_quat(a), Rotation.from_quat(b)
    return (Rotation.from_rotvec(share * (second * first.inv()).as_rotvec()) * first).as_quat()


def between(a, b, share, types):
    """Returns the row a share of the way from a to b."""
    row = [p + share * (q - p) for p, q in zip(a, b, strict=True)]
    for k, kind in enumerate(types):
        if kind == 1:
            row[k] = a[k] + share * math.remainder(b[k] - a[k], 2.0 * math.pi)
    fours = [k for k, kind in enumerate(types) if kind == 2]
    for k in fours[::4]:
        row[k : k + 4] = slerp(a[k : k + 4], b[k : k + 4], share)
    return np.array(row)


def rounded(rows, lengths, at, types, w, closed):
    """Returns the row at a length of the way, corners rounded by quadratic Bezier arcs over a share w of a segment."""
    last = len(rows) - 2
    k = min(max(int(np.searchsorted(lengths, at, side="right")) - 1, 0), last)
    u = min((at - lengths[k]) / (lengths[k + 1] - lengths[k]), 1.0)
    corner = None
    if w > 0.0 and u < 0.5 * w and (k > 0 or closed):
        corner, t = (k - 1 if k else last, k), 0.5 + u / w
    elif w > 0.0 and u > 1.0 - 0.5 * w and (k < last or closed):
        corner, t = (k, k + 1 if k < last else 0), (u - 1.0 + 0.5 * w) / w
    if corner is None:
        return between(rows[k], rows[k + 1], u, types)
    # de Casteljau: from half a share before the corner to half a share behind it
    (i, j) = corner
    first = between(rows[i], rows[i + 1], 1.0 - 0.5 * w * (1.0 - t), types)
    second = between(rows[j], rows[j + 1], 0.5 * w * t, types)
    return between(first, second, t, types)


def wandering(rng, count, types, closed):
    rows = rng.uniform(-2.0, 2.0, (count, len(types)))
    for k in [k for k, kind in enumerate(types) if kind == 2][::4]:
        rows[:, k : k + 4] = Rotation.random(count, random_state=rng).as_quat()
    if closed:
        rows[-1] = rows[0]
    return rows


def alike(found, wanted, types):
    for k, kind in enumerate(types):
        if kind == 0:
            assert found[k] == pytest.approx(wanted[k], abs=1e-7)
        if kind == 1:
            assert math.remainder(found[k] - wanted[k], 2.0 * math.pi) == pytest.approx(0.0, abs=1e-7)
    for k in [k for k, kind in enumerate(types) if kind == 2][::4]:
        assert abs(np.dot(found[k : k + 4], wanted[k : k + 4])) == pytest.approx(1.0, abs=1e-7)


@pytest.mark.parametrize("types", [(0, 0), (0, 0, 0, 2, 2, 2, 2), (1, 0, 1), (2, 2, 2, 2, 1, 0)], ids=str)
@pytest.mark.parametrize("closed", [False, True])
def test_a_row_along_a_path_is_on_its_segments_or_on_the_arcs_at_its_corners(plain, types, closed):
    rng = np.random.default_rng(len(types) + closed)
    for count in (2, 3, 5, 7):
        rows = wandering(rng, count, types, closed and count > 2)
        lengths = np.concatenate([[0.0], np.cumsum(rng.uniform(0.2, 1.0, count - 1))])
        flat, told = rows.ravel().tolist(), lengths.tolist()
        for strength, forced in itertools.product((None, 0.0, 0.4, 1.0), (False, True)):
            method = {} if strength is None else {"type": "quadraticBezier", "strength": strength}
            w = 0.0 if strength is None else max(strength, 0.05)
            round_whole = closed and count > 2 and not forced
            options = {**method, "forceOpen": True} if forced else method
            inside = np.concatenate([np.linspace(0.0, lengths[-1], 14)[1:-1], 0.5 * (lengths[1:] + lengths[:-1])])
            for at in inside.tolist():
                found = plain.getPathInterpolatedConfig(flat, told, at, options, list(types))
                alike(found, rounded(rows, lengths, at, types, w, round_whole), types)
            for at in (-1.0, 0.0):
                found = plain.getPathInterpolatedConfig(flat, told, at, options, list(types))
                alike(found, rounded(rows, lengths, 0.0, types, w, round_whole), types)
            for at in (lengths[-1], lengths[-1] + 1.0):
                found = plain.getPathInterpolatedConfig(flat, told, at, options, list(types))
                alike(found, rounded(rows, lengths, lengths[-1] - 1e-8 * (w > 0.0), types, w, round_whole), types)


def test_lengths_along_a_path_and_its_nearest_point(plain):
    rng = np.random.default_rng(5)
    for _ in range(20):
        rows = rng.uniform(-2.0, 2.0, (6, 5))
        lengths, whole = plain.getPathLengths(rows.ravel().tolist(), 5)
        legs = [math.dist(a[:3], b[:3]) for a, b in itertools.pairwise(rows.tolist())]
        assert lengths == pytest.approx([0.0, *itertools.accumulate(legs)])
        assert whole == lengths[-1]
        points, place = rows[:, :3], rng.uniform(-3.0, 3.0, 3)
        at = plain.getClosestPosOnPath(points.ravel().tolist(), lengths, place.tolist())
        dense = np.linspace(0.0, whole, 4001)
        way = np.stack([np.interp(dense, lengths, points[:, k]) for k in range(3)], axis=1)
        best = np.linalg.norm(way - place, axis=1)
        there = [float(np.interp(at, lengths, points[:, k])) for k in range(3)]
        assert math.dist(there, place) <= best.min() + 1e-12
        assert at == pytest.approx(dense[best.argmin()], abs=2.0 * whole / 4000) or best.min() == pytest.approx(
            math.dist(there, place), abs=1e-3
        )


# Packed tables.


@pytest.mark.parametrize(
    ("kind", "code", "low", "high"),
    [
        ("UInt8", "B", 0, 255), ("UInt16", "H", 0, 65535), ("UInt32", "I", 0, 2**32 - 1),
        ("Int32", "i", -(2**31), 2**31 - 1), ("Float", "f", -8, 8), ("Double", "d", -8, 8),
    ],
)  # fmt: skip
def test_packed_tables_are_little_endian_numbers_of_a_width(plain, kind, code, low, high):
    values = [low, 0, 1, 2, high]
    pack, unpack = getattr(plain, f"pack{kind}Table"), getattr(plain, f"unpack{kind}Table")
    for start, count in itertools.product((0, 2, 20), (0, 3, 30)):
        chosen = values[start : start + count] if count else values[start:]
        assert pack(values, start, count) == struct.pack(f"<{len(chosen)}{code}", *chosen)
        whole = b"#" * 3 + struct.pack(f"<{len(values)}{code}", *values)
        assert unpack(whole, start, count, 3) == chosen
    if code not in "fd":
        for wrong in (high + 1, low - 1, 0.5):
            refused("argument type is not correct", pack, [wrong])
    if code != "B":
        refused("bytes are not", unpack, b"\0")


# Drawing.


def test_drawing_objects_hold_items_until_they_are_full_and_are_emptied_by_none(desk):
    one = desk()
    points = [[0.1 * k, 0.0, 0.0] for k in range(4)]
    for cyclic, added, kept in ((0, [1, 1, 0, 0], points[:2]), (4096, [1, 1, 1, 1], points[2:])):
        handle = one.addDrawingObject(0 | cyclic, 3, 0.0, -1, 2, [1, 0, 0])
        assert [one.addDrawingObjectItem(handle, point) for point in points] == added
        items = one.world.drawings.drawings[handle].items
        assert items == kept
        assert one.addDrawingObjectItem(handle, None) == 0
        assert not items
        one.removeDrawingObject(handle)
        refused("drawing object does not exist", one.addDrawingObjectItem, handle, points[0])
    for kind, width in {0: 3, 1: 6, 2: 9, 7: 3, 8: 3, 9: 7, 12: 7}.items():
        handle = one.addDrawingObject(kind, 3)
        refused(f"an item has {width} numbers", one.addDrawingObjectItem, handle, [0.0] * (width - 1))
        assert one.addDrawingObjectItem(handle, [0.0] * width) == 1
    near = one.addDrawingObject(0, 3, 0.15)
    assert [one.addDrawingObjectItem(near, point) for point in points] == [1, 0, 1, 0]
    one.removeDrawingObject(-2)
    refused("drawing object does not exist", one.removeDrawingObject, near)
    refused("type 3 is unknown", one.addDrawingObject, 3, 1)
