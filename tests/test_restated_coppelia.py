"""What the server of CoppeliaSim's remote API computes, stated once more, on calls made without a socket between."""

import itertools
import math
import re
import struct

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

cbor2 = pytest.importorskip("cbor2", reason='needs pip install "wayfield[coppelia]"')
pytest.importorskip("zmq", reason='needs pip install "wayfield[coppelia]"')

from wayfield.envs.coppelia import curves, frames  # noqa: E402
from wayfield.envs.coppelia.scenes import Conditions, make_world  # noqa: E402
from wayfield.envs.coppelia.server import Caller, Client, Server  # noqa: E402
from wayfield.envs.coppelia.signatures import FUNCTIONS, NULL, CallError, Wrong, integer, number  # noqa: E402


class Desk:
    """A server that nobody serves, and a client whose calls are made at once."""

    def __init__(self, scene="empty", **conditions):
        self.server = Server(make_world(scene, Conditions(**conditions)), port=0, speed=0.0)
        self.client = Client("0123456789", "someone", 600.0)

    @property
    def world(self):
        return self.server.world

    def __getattr__(self, name):
        def call(*args):
            result = FUNCTIONS[f"sim.{name}"](Caller(self.server, self.client), list(args))
            return None if result is NULL else result

        return call

    def poses(self):
        return {node.handle: np.array(self.world.scene.pose(node)) for node in self.world.scene.objects.values()}


@pytest.fixture(scope="module")
def plain():
    """A desk for what only computes."""
    one = Desk()
    yield one
    one.server.close()


def refused(words, function, *args):
    with pytest.raises(CallError, match=re.escape(words)):
        function(*args)


def drawn(seed, count=25):
    """Yields a generator and two placements with it: (position, rotation)."""
    rng = np.random.default_rng(seed)
    for _ in range(count):
        yield rng, *((rng.uniform(-3, 3, 3), Rotation.random(random_state=rng)) for _ in range(2))


def matrix(place, turn):
    return np.column_stack([turn.as_matrix(), place]).ravel().tolist()


def pose(place, turn):
    return [*place.tolist(), *turn.as_quat().tolist()]


def same_pose(found, place, turn):
    assert found[:3] == pytest.approx(list(place), abs=1e-9)
    assert abs(np.dot(found[3:], turn.as_quat())) == pytest.approx(1.0, abs=1e-9)
    assert np.linalg.norm(found[3:]) == pytest.approx(1.0, abs=1e-12)


# Matrices, poses and angles.


def test_matrices_and_poses_are_placements_in_space(plain):
    for rng, (p, a), (q, b) in drawn(1):
        alpha, beta, gamma = euler = a.as_euler("XYZ")
        yaw, pitch, roll = a.as_euler("ZYX")
        share = rng.uniform(-0.2, 1.2)
        part = min(max(share, 0.0), 1.0)
        between = Rotation.from_rotvec(part * (b * a.inv()).as_rotvec()) * a
        middle = p + part * (q - p)
        assert plain.buildMatrix(p.tolist(), euler.tolist()) == pytest.approx(matrix(p, a), abs=1e-9)
        assert plain.getEulerAnglesFromMatrix(matrix(p, a)) == pytest.approx(euler, abs=1e-9)
        assert plain.alphaBetaGammaToYawPitchRoll(alpha, beta, gamma) == pytest.approx((yaw, pitch, roll), abs=1e-9)
        assert plain.yawPitchRollToAlphaBetaGamma(yaw, pitch, roll) == pytest.approx(euler, abs=1e-9)
        product = matrix(p + a.apply(q), a * b)
        assert plain.multiplyMatrices(matrix(p, a), matrix(q, b)) == pytest.approx(product, abs=1e-9)
        undone = matrix(-a.inv().apply(p), a.inv())
        for inverse in (plain.getMatrixInverse, plain.invertMatrix):
            assert inverse(matrix(p, a)) == pytest.approx(undone, abs=1e-9)
        for given in (matrix(p, a), pose(p, a), [*p.tolist(), *(-3.0 * a.as_quat()).tolist()]):
            assert plain.multiplyVector(given, q.tolist()) == pytest.approx(list(p + a.apply(q)), abs=1e-9)
        for turn in (euler, a.as_quat(), 5.0 * a.as_quat()):
            same_pose(plain.buildPose(p.tolist(), turn.tolist()), p, a)
        long = [*p.tolist(), *(2.0 * a.as_quat()).tolist()]
        assert plain.poseToMatrix(long) == pytest.approx(matrix(p, a), abs=1e-9)
        same_pose(plain.matrixToPose(matrix(p, a)), p, a)
        same_pose(plain.multiplyPoses(long, pose(q, b)), p + a.apply(q), a * b)
        same_pose(plain.getPoseInverse(long), -a.inv().apply(p), a.inv())
        same_pose(plain.interpolatePoses(long, pose(q, b), share), middle, between)
        assert plain.interpolateMatrices(matrix(p, a), matrix(q, b), share) == pytest.approx(
            matrix(middle, between), abs=1e-9
        )


@pytest.mark.parametrize("beta", [0.5 * math.pi, -0.5 * math.pi])
def test_at_a_right_angle_one_euler_angle_is_left_over_and_the_turn_is_the_same(plain, beta):
    for alpha, gamma in ((0.3, 0.4), (-2.0, 1.0), (0.0, 3.0)):
        turn = Rotation.from_euler("XYZ", [alpha, beta, gamma])
        found = plain.getEulerAnglesFromMatrix(matrix(np.zeros(3), turn))
        assert found[0] == 0.0
        assert Rotation.from_euler("XYZ", found).as_matrix() == pytest.approx(turn.as_matrix(), abs=1e-7)
        upright = Rotation.from_euler("ZYX", [alpha, beta, gamma])
        yaw, pitch, roll = plain.alphaBetaGammaToYawPitchRoll(*frames.euler_from_quaternion(upright.as_quat()))
        assert roll == 0.0
        assert Rotation.from_euler("ZYX", [yaw, pitch, roll]).as_matrix() == pytest.approx(
            upright.as_matrix(), abs=1e-7
        )


def test_half_turns_are_plus_pi_and_no_angle_is_a_negative_zero(plain):
    for axis, place in (("X", 0), ("Z", 2)):
        for sign in (-1.0, 1.0):
            found = plain.getEulerAnglesFromMatrix(matrix(np.zeros(3), Rotation.from_euler(axis, sign * math.pi)))
            assert found[place] == pytest.approx(math.pi)
        assert math.copysign(1.0, plain.getEulerAnglesFromMatrix(matrix(np.zeros(3), Rotation.identity()))[place]) > 0
    for turn in (-math.pi, math.pi):
        assert frames.yaw_of(frames.yawed(0.0, 0.0, 0.0, turn)) == pytest.approx(math.pi)


def test_what_is_no_placement_is_refused(plain):
    good, place = matrix(np.zeros(3), Rotation.identity()), [0.0, 0.0, 0.0]
    skew = [*good[:4], 0.01, *good[5:]]
    for function, args in (
        (plain.getMatrixInverse, [skew]),
        (plain.matrixToPose, [skew]),
        (plain.multiplyVector, [skew, place]),
    ):
        refused("rows are not orthonormal", function, *args)
    nowhere = [0.0] * 7
    for function, args in (
        (plain.poseToMatrix, [nowhere]),
        (plain.multiplyPoses, [nowhere, nowhere]),
        (plain.getPoseInverse, [nowhere]),
        (plain.buildPose, [place, [0.0] * 4]),
        (plain.multiplyVector, [nowhere, place]),
    ):
        refused("the quaternion is zero", function, *args)
    refused("got 8", plain.multiplyVector, [1.0] * 8, place)
    refused("got 5", plain.buildPose, place, [1.0] * 5)
    refused("12 numbers are needed, got 11", plain.matrixToPose, good[:11])
    refused("beyond 1e+06", plain.poseToMatrix, [2e6, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0])
    assert plain.poseToMatrix([1e6, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0])[3] == 1e6


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
            again = np.reshape(plain.resamplePath(flat, told, 9, options, list(types)), (9, -1))
            for at, found in zip(np.linspace(0.0, lengths[-1], 9)[:-1], again[:-1], strict=True):
                alike(found, rounded(rows, lengths, at, types, w, round_whole), types)


def test_distances_along_paths_and_between_rows(plain):
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
        a, b = (np.array([*rng.uniform(-9, 9, 2), *Rotation.random(random_state=rng).as_quat()]) for _ in range(2))
        weights = rng.uniform(0.1, 2.0, 6)
        angle = (Rotation.from_quat(b[2:]) * Rotation.from_quat(a[2:]).inv()).magnitude()
        turn = math.remainder(b[1] - a[1], 2.0 * math.pi)
        wanted = math.sqrt(sum((w * d) ** 2 for w, d in zip(weights, (b[0] - a[0], turn, angle), strict=False)))
        types = [0, 1, 2, 2, 2, 2]
        found = plain.getConfigDistance(a.tolist(), b.tolist(), weights.tolist(), types)
        assert found == pytest.approx(wanted)
        assert plain.getConfigDistance(a[:2].tolist(), b[:2].tolist()) == pytest.approx(math.dist(a[:2], b[:2]))


def test_a_point_beside_a_standing_step_of_a_path_is_told_by_the_others(plain):
    points = [0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0]
    assert plain.getClosestPosOnPath(points, [0.0, 0.0, 1.0], [0.4, 1.0, 0.0]) == pytest.approx(0.4)
    assert plain.getClosestPosOnPath(points, [0.0, 0.0, 1.0], [5.0, 1.0, 0.0]) == 1.0
    assert plain.getClosestPosOnPath(points, [0.0, 0.0, 1.0], [-5.0, 1.0, 0.0]) == 0.0


def test_numbers_of_a_call_are_taken_up_to_their_bounds():
    for value in (2**63 - 1, -(2**63), 3.0, -0.0):
        assert integer(None, value) == value
        assert type(integer(None, value)) is int
    for value in (2**63, -(2**63) - 1, 1e19, -1e19):
        with pytest.raises(Wrong, match="it is too large"):
            integer(None, value)
    for value in (9e299, -9e299, 2):
        assert number(None, value) == value
    for value in (1e300, -1e300, math.inf, -math.inf, math.nan):
        with pytest.raises(Wrong, match="it is too large"):
            number(None, value)
    for value, words in ((True, "got True"), ("1", "got '1'"), (None, "got None"), ([1], "got an array of 1")):
        for function in (integer, number):
            with pytest.raises(Wrong, match=words):
                function(None, value)
    with pytest.raises(Wrong, match=r"got 2\.5"):
        integer(None, 2.5)


@pytest.mark.parametrize(
    ("function", "args", "words"),
    [
        ("getPathLengths", [[1.0, 2.0, 3.0], 2], "3 numbers are not 1 or more rows of 2"),
        ("getPathLengths", [[1.0, 2.0], 0], "rows of 0"),
        ("getPathLengths", [[2e6, 2.0], 2], "beyond 1e+06"),
        ("getPathInterpolatedConfig", [[1.0, 2.0], [0.0], 0.0], "2 or more rows"),
        ("getPathInterpolatedConfig", [[1.0, 2.0, 3.0], [0.0, 1.0], 0.0], "not a row for each of 2 lengths"),
        ("getPathInterpolatedConfig", [[1.0, 2.0], [], 0.0], "not a row for each of 0 lengths"),
        ("getPathInterpolatedConfig", [[1.0, 2.0], [1.0, 0.0], 0.0], "the lengths must ascend"),
        ("getPathInterpolatedConfig", [[1.0, 2.0], [0.0, 1.0], 0.0, {"type": "cubic"}], "method.type"),
        ("getPathInterpolatedConfig", [[1.0, 2.0], [0.0, 1.0], 0.0, {"strength": 1.5}], "method.strength is 1.5"),
        ("getPathInterpolatedConfig", [[1.0, 2.0], [0.0, 1.0], 0.0, {"strength": -0.5}], "method.strength is -0.5"),
        ("getPathInterpolatedConfig", [[1.0, 2.0], [0.0, 1.0], 0.0, {}, [3]], "types are 0"),
        ("getPathInterpolatedConfig", [[1.0, 2.0], [0.0, 1.0], 0.0, {}, [0, 0]], "one a column, 1"),
        ("getPathInterpolatedConfig", [[1.0, 2.0], [0.0, 1.0], 0.0, {}, [2]], "one a column, 1"),
        ("getPathInterpolatedConfig", [[1.0] * 10, [0.0, 1.0], 0.0, {}, [2, 0, 2, 2, 2]], "types are 0"),
        ("resamplePath", [[1.0, 2.0], [0.0, 1.0], 1], "2 to 100,000"),
        ("resamplePath", [[1.0, 2.0], [0.0, 1.0], 100_001], "2 to 100,000"),
        ("resamplePath", [[1.0] * 24, [0.0, 1.0], 100_000], "fit in a reply"),
        ("getPathLengths", [[1.0, 2.0], 1, "mine@func"], "a function of the client's"),
        ("getClosestPosOnPath", [[0.0] * 6, [0.0], [0.0] * 3], "1 lengths for 2 rows"),
        ("getClosestPosOnPath", [[0.0] * 3, [0.0], [0.0] * 3], "2 or more rows of 3"),
        ("getConfigDistance", [[1.0], [1.0, 2.0]], "1 and 2 numbers"),
        ("getConfigDistance", [[], []], "0 and 0 numbers"),
        ("getConfigDistance", [[1.0], [1.0], [1.0, 2.0]], "metric must have 1 numbers, got 2"),
    ],
)  # fmt: skip
def test_what_is_no_table_is_refused(plain, function, args, words):
    refused(words, getattr(plain, function), *args)


def test_a_path_through_control_points_is_its_rounding_spaced_evenly():
    rng = np.random.default_rng(8)
    types = (0, 0, 0, 2, 2, 2, 2)
    for closed, smoothness, subdivision in itertools.product((False, True), (0.0, 0.3, 1.0), (5, 24)):
        points = wandering(rng, 4, types, False)
        found = curves.path_rows(points, closed, subdivision, smoothness)
        rows = np.vstack([points, points[:1]]) if closed else points
        if smoothness:
            lengths = curves.lengths_of(rows)
            ways = np.linspace(0.0, lengths[-1], 2 * subdivision)
            ways[-1] -= 1e-8  # the end belongs to the last segment
            rows = np.array([rounded(rows, lengths, at, types, smoothness, closed) for at in ways])
        lengths = curves.lengths_of(rows)
        for at, row in zip(np.linspace(0.0, lengths[-1], subdivision)[:-1], found[:-1], strict=True):
            alike(row, rounded(rows, lengths, at, types, 0.0, False), types)
        if closed:
            assert found[-1].tolist() == found[0].tolist()
        else:
            assert found[-1] == pytest.approx(rows[-1], abs=1e-7) or found[-1] == pytest.approx(
                rows[-1] * [1, 1, 1, -1, -1, -1, -1], abs=1e-7
            )


@pytest.mark.parametrize(("mode", "axes"), list(enumerate(["xy", "xz", "yx", "yz", "zx", "zy"])))
@pytest.mark.parametrize("closed", [False, True])
def test_computed_orientations_have_an_axis_along_the_path_and_another_upwards(plain, mode, axes, closed):
    first, second = ("xyz".index(axis) for axis in axes)
    rng = np.random.default_rng(mode)
    points = wandering(rng, 5, (0, 0, 0, 2, 2, 2, 2), False)
    for up in ([0.0, 0.0, 1.0], [0.3, -2.0, 0.5]):
        handle = plain.createPath(points.ravel().tolist(), 16 + 2 * closed, 12, 0.0, mode, up)
        rows = np.frombuffer(plain.readCustomBufferData(handle, "PATH"), "<f8").reshape(-1, 7)
        plane = curves.path_rows(points, closed, 12, 0.0)
        assert rows[:, :3] == pytest.approx(plane[:, :3], abs=1e-12)
        for i, row in enumerate(rows):
            here, there = (i, i + 1) if i < 11 else (0, 1) if closed else (10, 11)
            along = rows[there, :3] - rows[here, :3]
            turn = Rotation.from_quat(row[3:]).as_matrix()
            assert np.linalg.det(turn) == pytest.approx(1.0)
            along /= np.linalg.norm(along)
            assert turn[:, first] == pytest.approx(along, abs=1e-7)
            upward = np.array(up) - np.dot(up, along) * along
            assert turn[:, second] == pytest.approx(upward / np.linalg.norm(upward), abs=1e-7)
    # where the path goes straight up, the second axis is any that is level
    for x, line in ((0.0, [0.0, 0.0, 1.0]), (1.0, [1.0, 0.0, 0.0])):
        rows = np.zeros((3, 7))
        rows[:, :3] = np.outer(range(3), line)
        rows[:, 6] = 1.0
        turned = curves.oriented(rows, False, mode, line)
        for row in turned:
            turn = Rotation.from_quat(row[3:]).as_matrix()
            assert turn[:, first] == pytest.approx(line, abs=1e-9), x
            assert np.dot(turn[:, second], line) == pytest.approx(0.0, abs=1e-9)
    standing = np.repeat(rows[:1], 3, axis=0)
    assert curves.oriented(standing, False, mode, [0.0, 0.0, 1.0]).tolist() == standing.tolist()


@pytest.mark.parametrize(
    ("args", "words"),
    [
        ([[0.0] * 7], "2 or more rows of 7"),
        ([[0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0, 1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0], 2], "3 or more rows of 7"),
        ([[0.0] * 14], "a control point's quaternion is zero"),
        ([[0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0] * 2], "all control points are the same"),
        ([[[0.0, 0.0, 0.0], "a"]], "argument"),
        ([[0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0] * 2, 0, 1], "subdivisions 2 or more"),
        ([[0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0] * 2, 0, 100_001], "subdivisions 2 or more"),
        ([[0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0] * 2, 0, 10, 1.1], "smoothness is 1.1"),
        ([[0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0] * 2, 0, 10, -0.1], "smoothness is -0.1"),
        ([[0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0] * 2, 0, 10, 1.0, 6], "orientationMode is 6"),
        ([[0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0] * 2, 0, 10, 1.0, -1], "orientationMode is -1"),
        ([[*[0.0] * 6, 1.0, 1.0, *[0.0] * 5, 1.0], 16, 10, 1.0, 0, [0.0] * 3], "at most 10,000 rows"),
        ([[*[0.0] * 6, 1.0, 1.0, *[0.0] * 5, 1.0], 16, 10_001], "at most 10,000 rows"),
    ],
)  # fmt: skip
def test_what_is_no_path_is_refused_and_leaves_nothing(desk, args, words):
    if words == "argument":
        words = "the control points:"
    one = desk()
    before = list(one.world.scene.objects)
    refused(words, one.createPath, *args)
    assert list(one.world.scene.objects) == before
    assert not one.server.stored


def test_a_path_s_points_stand_below_it_and_are_given_in_one_array_or_in_many(desk):
    one = desk()
    rng = np.random.default_rng(2)
    points = wandering(rng, 4, (0, 0, 0, 2, 2, 2, 2), False)
    long = points * [1, 1, 1, 3, 3, 3, 3]
    handles = [one.createPath(long.ravel().tolist()), one.createPath(long.tolist(), 0, 100, 1.0)]
    for handle in handles:
        path = one.world.scene.objects[handle]
        assert one.getObjectAlias(handle) == "Path"
        assert np.frombuffer(path.data["PATHCTRLPTS"]).reshape(-1, 7) == pytest.approx(points)
        assert np.frombuffer(path.data["PATH"]).reshape(-1, 7) == pytest.approx(
            curves.path_rows(points, False, 100, 1.0)
        )
        assert [child.alias for child in path.children] == ["ctrlPt"] * 4
        assert np.array([child.pose for child in path.children]) == pytest.approx(points)
        assert all(child.kind == 4 for child in path.children)
    assert one.server.stored == {(h, key): 56 * n for h in handles for key, n in (("PATH", 100), ("PATHCTRLPTS", 4))}


# Packed tables.


@pytest.mark.parametrize(
    ("kind", "code", "low", "high"),
    [
        ("UInt8", "B", 0, 255),
        ("UInt16", "H", 0, 65535),
        ("UInt32", "I", 0, 2**32 - 1),
        ("Int32", "i", -(2**31), 2**31 - 1),
        ("Float", "f", -8, 8),
        ("Double", "d", -8, 8),
    ],
)  # fmt: skip
def test_packed_tables_are_little_endian_numbers_of_a_width(plain, kind, code, low, high):
    rng = np.random.default_rng(3)
    values = [int(each) for each in rng.integers(low, high, 9, endpoint=True)]
    pack, unpack = getattr(plain, f"pack{kind}Table"), getattr(plain, f"unpack{kind}Table")
    for start, count in itertools.product((-1, 0, 2, 20), (-1, 0, 3, 30)):
        first = max(start, 0)
        chosen = values[first : first + count] if count > 0 else values[first:]
        data = pack(values, start, count)
        assert data == struct.pack(f"<{len(chosen)}{code}", *chosen)
        width = struct.calcsize(f"<{code}")
        whole = b"#" * 3 + struct.pack(f"<{len(values)}{code}", *values)
        assert unpack(whole, start, count, 3) == chosen, width
    assert unpack(struct.pack(f"<{code}", 1), 0, 0, -4) == [1]
    assert pack([1]) == struct.pack(f"<{code}", 1)
    if code not in "fd":
        for wrong in (high + 1, low - 1, 0.5):
            refused("argument type is not correct", pack, [wrong])
    if code != "B":
        refused("bytes are not", unpack, b"\0")


# Signals, properties and blocks.


def test_signals_and_properties_are_kept_where_they_were_put_until_they_are_forgotten(desk):
    one = desk()
    dummy, other = one.createDummy(0.1), one.createDummy(0.1)
    kept = {
        ("String", "a"): "text", ("Buffer", "b"): b"\0\1", ("Int32", "c"): -5, ("Integer", "d"): 7,
        ("Float", "e"): 0.5, ("Double", "f"): -0.25,
    }  # fmt: skip
    for (kind, key), value in kept.items():
        assert getattr(one, f"get{kind}Signal")(key) is None
        assert getattr(one, f"set{kind}Signal")(key, value) is None
        assert getattr(one, f"get{kind}Signal")(key) == value
        assert one.getFloatProperty(-12, f"signal.{key}") == value
    one.clearStringSignal("a")
    one.setFloatSignal("e", None)
    assert one.getStringSignal("a") is None
    assert one.world.signals == {key: value for (_, key), value in kept.items() if key not in "ae"}
    values = {"Buffer": b"xyz", "String": "s", "Float": 1.5, "Int": 3, "Bool": True, "Table": {"k": [1, 2]}}
    for i, (where, (kind, value)) in enumerate(itertools.product((dummy, other, -12, -13), values.items())):
        for prefix in ("customData", "signal"):
            key = f"{prefix}.own{i}"
            put, get = getattr(one, f"set{kind}Property"), getattr(one, f"get{kind}Property")
            refused("property is unknown", get, where, key)
            assert get(where, key, {"noError": True}) is None
            put(where, key, value)
            assert get(where, key) == value
            elsewhere = [each for each in (dummy, other, -12, -13) if each != where]
            assert all(get(each, key, {"noError": True}) is None for each in elsewhere)
            one.removeProperty(where, key)
            assert get(where, key, {"noError": 1}) is None
    for key in ("own", "customData", "customData.", "signal.", "data.own"):
        for function in (one.getIntProperty, one.removeProperty):
            refused("property is unknown", function, dummy, key)
        refused("property is unknown", one.setIntProperty, dummy, key, 1)
    assert not [entry for entry in one.server.stored if entry[0] == -1]


def test_blocks_are_properties_by_another_name_and_nothing_forgets_them(desk):
    one = desk()
    dummy = one.createDummy(0.1)
    for kind, value, empty in (
        ("Block", b"12", b""), ("BufferData", b"345", None), ("StringData", "text", None), ("TableData", [1, 2], {}),
    ):  # fmt: skip
        name = f"CustomData{kind}" if kind == "Block" else f"Custom{kind}"
        write, read = getattr(one, f"write{name}"), getattr(one, f"read{name}")
        for key in ("a", "@tmp.b"):
            assert read(dummy, key) == empty
            for nothing in (None, "" if kind == "StringData" else b"" if kind != "TableData" else None):
                write(dummy, key, value)
                assert read(dummy, key) == value
                assert one.getTableProperty(dummy, f"customData.{key.removeprefix('@tmp.')}") == value
                write(dummy, key, nothing)
                assert read(dummy, key) == empty
    one.writeCustomTableData(dummy, "t", {"a": 1})
    assert one.server.stored == {(dummy, "t"): len(cbor2.dumps({"a": 1}))}
    for function in (one.writeCustomTableData, one.setTableProperty):
        refused("must be an array or a map; got 'no table'", function, dummy, "customData.t", "no table")


def test_what_a_removed_object_held_makes_room_for_others(desk, monkeypatch):
    from wayfield.envs.coppelia import calls_data

    monkeypatch.setattr(calls_data, "MAX_ENTRIES", 3)
    monkeypatch.setattr(calls_data, "MAX_STORED", 100)
    one = desk()
    dummy = one.createDummy(0.1)
    for key in "abc":
        one.writeCustomDataBlock(dummy, key, b"1")
    refused("there are 3 signals and blocks", one.setStringSignal, "d", "1")
    one.writeCustomDataBlock(dummy, "a", b"22")  # what is there already may change
    one.removeObject(dummy)
    one.setStringSignal("d", "x" * 60)
    assert one.server.stored == {(0, "d"): 60}
    refused("100 bytes together", one.setStringSignal, "e", "x" * 41)
    one.setStringSignal("e", "x" * 40)
    one.setStringSignal("d", "y" * 60)
    refused("100 bytes together", one.setStringSignal, "d", "y" * 61)
    assert one.getStringSignal("d") == "y" * 60


# Drawing.


def test_drawing_objects_take_items_of_their_width(desk):
    one = desk()
    for kind, width in {0: 3, 1: 6, 2: 9, 7: 3, 8: 3, 9: 7, 10: 7, 11: 7, 12: 7}.items():
        handle = one.addDrawingObject(kind, 2.0)
        found = one.world.drawings.drawings[handle]
        assert (found.kind, found.size, found.tolerance, found.parent, found.most) == (kind, 2.0, 0.0, -1, 1000)
        assert found.colour == (0.0, 0.0, 0.0)
        assert not found.cyclic
        two = np.arange(2.0 * width).tolist()
        assert one.addDrawingObjectItem(handle, [*two, 1.0]) == 1
        assert found.items == [two[:width], two[width:]]
        refused(f"an item has {width} numbers", one.addDrawingObjectItem, handle, two[: width - 1])
        assert one.addDrawingObjectItem(handle | 0x1000000, two[:width]) == 1
        assert one.addDrawingObjectItem(handle, []) == 0
        assert found.items == []
    last = one.addDrawingObject(0x1000 | 1, 1.0, 0.5, -1, 3, [0.1, 2.0, -1.0])
    found = one.world.drawings.drawings[last]
    assert (found.cyclic, found.tolerance, found.most, found.colour) == (True, 0.5, 3, (0.1, 1.0, 0.0))
    for x in range(5):
        one.addDrawingObjectItem(last, [float(x)] * 6)
    assert [item[0] for item in found.items] == [2.0, 3.0, 4.0]
    dummy = one.createDummy(0.1)
    assert one.world.drawings.drawings[one.addDrawingObject(0, 1.0, 0.0, dummy)].parent == dummy
    refused("object does not exist", one.addDrawingObject, 0, 1.0, 0.0, 999)
    for args in ((0, -1.0), (0, 2e6), (0, 1.0, -0.1), (0, 1.0, 2e6)):
        refused("size and tolerance must be 0 to", one.addDrawingObject, *args)
    refused("drawing object type 3 is unknown", one.addDrawingObject, 3, 1.0)
    refused("at most 100,000 items", one.addDrawingObject, 0, 1.0, 0.0, -1, 100_001)
    refused("at most 100,000 items", one.addDrawingObject, 0, 1.0, 0.0, -1, -2)
    one.addDrawingObject(0, 1.0, 0.0, -1, 100_000)
    count = len(one.world.drawings.drawings)
    assert one.removeDrawingObject(last | 0x1000000) is None
    assert len(one.world.drawings.drawings) == count - 1
    for handle in (last, -1, 5000):
        refused("none has the handle", one.removeDrawingObject, handle)
    one.removeDrawingObject(-2)
    assert not one.world.drawings.drawings


def test_items_keep_their_distance_and_all_together_have_a_limit(desk, monkeypatch):
    from wayfield.envs.coppelia import drawing

    one = desk()
    handle = one.addDrawingObject(0, 1.0, 0.5)
    for place, added in (([0, 0, 0], 1), ([0.3, 0.39, 0], 0), ([0.3, 0.4, 0], 1), ([0.3, 0.4, 0.49], 0)):
        assert one.addDrawingObjectItem(handle, place) == added
    assert one.addDrawingObjectItem(handle, [5, 5, 5, 0, 0, 0]) == 0  # of the last of them
    monkeypatch.setattr(drawing, "MAX_NUMBERS", 12)
    assert one.addDrawingObjectItem(handle, [9, 9, 9]) == 1
    refused("all drawing objects together are full", one.addDrawingObjectItem, handle, [7, 7, 7])
    monkeypatch.setattr(drawing, "MAX_DRAWINGS", 1)
    refused("there are 1 drawing objects", one.addDrawingObject, 0, 1.0)
