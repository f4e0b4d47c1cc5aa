"""Poses in space as CoppeliaSim writes them: pure functions of plain numbers.

A pose is (x, y, z, qx, qy, qz, qw), m and a unit quaternion with its scalar last. Euler angles (alpha, beta, gamma)
mean R = Rx(alpha) Ry(beta) Rz(gamma); a matrix is the upper three rows of the homogeneous one, 12 numbers by rows.
"""

import math
from collections.abc import Sequence

Vector = tuple[float, float, float]
Quaternion = tuple[float, float, float, float]
Pose = tuple[float, float, float, float, float, float, float]

ORIGIN: Pose = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0)
_LEAST = 1e-12  # the smallest norm of something that has a direction


def pose_of(position: Sequence[float], quaternion: Sequence[float]) -> Pose:
    """Returns the pose of a position and a quaternion that is made one of unit length.

    Raises:
        ValueError: if the quaternion has no direction.
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
    """Returns the pose of something upright that looks along `yaw` (rad)."""
    return (x, y, z, 0.0, 0.0, math.sin(0.5 * yaw), math.cos(0.5 * yaw))


def yaw_of(pose: Sequence[float]) -> float:
    """Returns the direction in (-pi, pi] of the x axis seen from above, rad."""
    _, _, _, x, y, z, w = pose
    yaw = math.atan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z))
    return math.pi if yaw == -math.pi else yaw


def multiplied(a: Sequence[float], b: Sequence[float]) -> Quaternion:
    """Returns the quaternion that turns by b, then by a."""
    ax, ay, az, aw = a
    bx, by, bz, bw = b
    return (
        aw * bx + ax * bw + ay * bz - az * by,
        aw * by - ax * bz + ay * bw + az * bx,
        aw * bz + ax * by - ay * bx + az * bw,
        aw * bw - ax * bx - ay * by - az * bz,
    )


def turned(q: Sequence[float], v: Sequence[float]) -> Vector:
    """Returns the vector v turned by the quaternion q."""
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
    """Returns the pose of b, which is given in the frame of a, in the frame that a is given in."""
    x, y, z = turned(a[3:], b[:3])
    return (a[0] + x, a[1] + y, a[2] + z, *multiplied(a[3:], b[3:]))


def inverse(pose: Sequence[float]) -> Pose:
    """Returns the pose that undoes another."""
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
    """Returns the pose of a matrix of 12 numbers, whose rotation may be off by rounding.

    Raises:
        ValueError: if its first three columns are no rotation.
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


def matrix_product(a: Sequence[float], b: Sequence[float]) -> list[float]:
    """Returns the product of two matrices of 12 numbers, whatever they are."""
    product = []
    for i in (0, 4, 8):
        for j in range(4):
            value = sum(a[i + k] * b[4 * k + j] for k in range(3))
            product.append(value + (a[i + 3] if j == 3 else 0.0))
    return product


def slerped(a: Sequence[float], b: Sequence[float], share: float) -> Quaternion:
    """Returns the quaternion a share of the shorter way from a to b (Shoemake, 1985)."""
    dot = sum(p * q for p, q in zip(a, b, strict=True))
    if dot < 0.0:
        b, dot = [-q for q in b], -dot
    if dot > 1.0 - 1e-12:
        mixed = [(1.0 - share) * p + share * q for p, q in zip(a, b, strict=True)]
    else:
        angle = math.acos(min(dot, 1.0))
        u, v = math.sin((1.0 - share) * angle), math.sin(share * angle)
        mixed = [u * p + v * q for p, q in zip(a, b, strict=True)]
    size = math.sqrt(sum(q * q for q in mixed)) or 1.0
    x, y, z, w = (q / size for q in mixed)
    return x, y, z, w


def yaw_pitch_roll_from_euler(alpha: float, beta: float, gamma: float) -> Vector:
    """Returns (yaw, pitch, roll) with Rz(yaw) Ry(pitch) Rx(roll) the same rotation."""
    rows = rotation(quaternion_from_euler(alpha, beta, gamma))
    (r00, r01, _), (r10, r11, _), (r20, r21, r22) = rows
    flat = math.hypot(r00, r10)
    pitch = math.atan2(-r20, flat)
    if flat < 1e-9:
        return math.atan2(-r01, r11), pitch, 0.0
    return math.atan2(r10, r00), pitch, math.atan2(r21, r22)


def euler_from_yaw_pitch_roll(yaw: float, pitch: float, roll: float) -> Vector:
    """Returns the Euler angles of Rz(yaw) Ry(pitch) Rx(roll)."""
    about_z = (0.0, 0.0, math.sin(0.5 * yaw), math.cos(0.5 * yaw))
    about_y = (0.0, math.sin(0.5 * pitch), 0.0, math.cos(0.5 * pitch))
    about_x = (math.sin(0.5 * roll), 0.0, 0.0, math.cos(0.5 * roll))
    return euler_from_quaternion(multiplied(multiplied(about_z, about_y), about_x))
