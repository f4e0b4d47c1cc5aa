"""Poses in the conventions of CoppeliaSim: pure functions of plain numbers.

A pose is (x, y, z, qx, qy, qz, qw), m and a unit quaternion with its scalar last. Euler angles (alpha, beta, gamma)
mean R = Rx(alpha) Ry(beta) Rz(gamma); a matrix is the upper three rows of the homogeneous one, 12 numbers by rows.
"""

import math
from collections.abc import Sequence

Vector = tuple[float, float, float]
Quaternion = tuple[float, float, float, float]
Pose = tuple[float, float, float, float, float, float, float]

ORIGIN: Pose = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0)
_LEAST = 1e-12  # the smallest norm of a quaternion


def pose_of(position: Sequence[float], quaternion: Sequence[float]) -> Pose:
    """Returns the pose of a position and a quaternion, which is normalised.

    Raises:
        ValueError: if the quaternion is zero.
    """
    x, y, z, w = quaternion
    size = math.sqrt(x * x + y * y + z * z + w * w)
    if size < _LEAST:
        raise ValueError("the quaternion is zero; it must have a direction")
    if abs(size - 1.0) < 1e-15:
        size = 1.0
    px, py, pz = position
    return (float(px), float(py), float(pz), x / size, y / size, z / size, w / size)


def yawed(x: float, y: float, z: float, yaw: float) -> Pose:
    """Returns the pose of an upright frame with a yaw (rad)."""
    return (x, y, z, 0.0, 0.0, math.sin(0.5 * yaw), math.cos(0.5 * yaw))


def yaw_of(pose: Sequence[float]) -> float:
    """Returns the yaw of a pose, in (-pi, pi], rad."""
    _, _, _, x, y, z, w = pose
    yaw = math.atan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z))
    return math.pi if yaw == -math.pi else yaw


def multiplied(a: Sequence[float], b: Sequence[float]) -> Quaternion:
    """Returns the product a b of two quaternions."""
    ax, ay, az, aw = a
    bx, by, bz, bw = b
    return (
        aw * bx + ax * bw + ay * bz - az * by,
        aw * by - ax * bz + ay * bw + az * bx,
        aw * bz + ax * by - ay * bx + az * bw,
        aw * bw - ax * bx - ay * by - az * bz,
    )


def turned(q: Sequence[float], v: Sequence[float]) -> Vector:
    """Returns the vector v rotated by the quaternion q."""
    qx, qy, qz, qw = q
    vx, vy, vz = v
    tx = 2.0 * (qy * vz - qz * vy)
    ty = 2.0 * (qz * vx - qx * vz)
    tz = 2.0 * (qx * vy - qy * vx)
    return (
        vx + qw * tx + qy * tz - qz * ty,
        vy + qw * ty + qz * tx - qx * tz,
        vz + qw * tz + qx * ty - qy * tx,
    )


def composed(a: Sequence[float], b: Sequence[float]) -> Pose:
    """Returns the product a b of two poses: b, given in the frame a, in the parent frame of a."""
    x, y, z = turned(a[3:], b[:3])
    return (a[0] + x, a[1] + y, a[2] + z, *multiplied(a[3:], b[3:]))


def inverse(pose: Sequence[float]) -> Pose:
    """Returns the inverse of a pose."""
    _, _, _, qx, qy, qz, qw = pose
    conjugate = (-qx, -qy, -qz, qw)
    x, y, z = turned(conjugate, pose[:3])
    return (-x, -y, -z, *conjugate)


def quaternion_from_euler(alpha: float, beta: float, gamma: float) -> Quaternion:
    """Returns the quaternion of Rx(alpha) Ry(beta) Rz(gamma)."""
    about_x = (math.sin(0.5 * alpha), 0.0, 0.0, math.cos(0.5 * alpha))
    about_y = (0.0, math.sin(0.5 * beta), 0.0, math.cos(0.5 * beta))
    about_z = (0.0, 0.0, math.sin(0.5 * gamma), math.cos(0.5 * gamma))
    return multiplied(multiplied(about_x, about_y), about_z)


def rotation(q: Sequence[float]) -> tuple[Vector, Vector, Vector]:
    """Returns the rows of the rotation matrix of a unit quaternion."""
    x, y, z, w = q
    return (
        (1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y - w * z), 2.0 * (x * z + w * y)),
        (2.0 * (x * y + w * z), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z - w * x)),
        (2.0 * (x * z - w * y), 2.0 * (y * z + w * x), 1.0 - 2.0 * (x * x + y * y)),
    )


def euler_from_rotation(rows: Sequence[Sequence[float]]) -> Vector:
    """Returns (alpha, beta, gamma), each in (-pi, pi]; alpha is 0 where beta is a right angle."""
    (r00, r01, r02), (r10, r11, r12), (_, _, r22) = rows
    flat = math.hypot(r00, r01)
    beta = math.atan2(r02, flat)
    if flat < 1e-9:
        return 0.0, beta, math.atan2(r10, r11)
    # + 0.0: no angle is a negative zero
    alpha, gamma = math.atan2(-r12, r22) + 0.0, math.atan2(-r01, r00) + 0.0
    return (
        math.pi if alpha == -math.pi else alpha,
        beta,
        math.pi if gamma == -math.pi else gamma,
    )


def euler_from_quaternion(q: Sequence[float]) -> Vector:
    """Returns the Euler angles of a unit quaternion."""
    return euler_from_rotation(rotation(q))


def matrix_of(pose: Sequence[float]) -> list[float]:
    """Returns the 12 numbers of a pose's matrix."""
    first, second, third = rotation(pose[3:])
    return [*first, float(pose[0]), *second, float(pose[1]), *third, float(pose[2])]


def pose_from_matrix(m: Sequence[float]) -> Pose:
    """Returns the pose of a matrix of 12 numbers.

    Raises:
        ValueError: if its first three columns are no rotation within 1e-3.
    """
    rows = (m[0:3], m[4:7], m[8:11])
    for i in range(3):
        for j in range(3):
            if abs(sum(a * b for a, b in zip(rows[i], rows[j], strict=True)) - (i == j)) > 1e-3:
                raise ValueError("the matrix is no rotation and translation: its rows are not orthonormal")
    (r00, r01, r02), (r10, r11, r12), (r20, r21, r22) = rows
    # the largest of the four components is taken from the diagonal (Shepperd, 1978)
    largest = max(r00 + r11 + r22, r00, r11, r22)
    if largest == r00 + r11 + r22:
        q = (r21 - r12, r02 - r20, r10 - r01, 1.0 + r00 + r11 + r22)
    elif largest == r00:
        q = (1.0 + r00 - r11 - r22, r01 + r10, r02 + r20, r21 - r12)
    elif largest == r11:
        q = (r01 + r10, 1.0 - r00 + r11 - r22, r12 + r21, r02 - r20)
    else:
        q = (r02 + r20, r12 + r21, 1.0 - r00 - r11 + r22, r10 - r01)
    return pose_of((m[3], m[7], m[11]), q)
