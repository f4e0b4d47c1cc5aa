"""Elementary functions of our own, for compiled code: the same bits on every machine, and in a browser.

The C library's differ in their last bits from one version to the next.
"""

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from wayfield.system.compiled import allocating, inlined

_LOWEST, _HIGHEST = -708.0, 709.0  # exponents whose powers of e are normal numbers

# pi/2 split in two, so that x - k*HIGH is exact for the angles of a plane robot and LOW mends the rest.
_HALF_PI_HIGH = 1.5707963267341256
_HALF_PI_LOW = 6.077100506506192e-11


@inlined
def sin_cos(angle):
    """Returns (sin, cos) of an angle in radians, to 2.3e-16 for |angle| up to 1e5.

    Our own polynomial rather than the C library's, so that a trajectory has the same bits on every machine (and
    because both values come out of one range reduction). Cody-Waite reduction to [-pi/4, pi/4], then the minimax
    polynomials of the Cephes library's sincos.
    """
    quadrant = math.floor(angle * 0.6366197723675814 + 0.5)
    x = (angle - quadrant * _HALF_PI_HIGH) - quadrant * _HALF_PI_LOW
    z = x * x
    s = x + x * z * (
        ((((1.58962301576546568060e-10 * z - 2.50507477628578072866e-8) * z + 2.75573136213857245213e-6) * z
          - 1.98412698295895385996e-4) * z + 8.33333333332211858878e-3) * z - 1.66666666666666307295e-1
    )  # fmt: skip
    c = 1.0 - 0.5 * z + z * z * (
        ((((-1.13585365213876817300e-11 * z + 2.08757008419747316778e-9) * z - 2.75573141792967388112e-7) * z
          + 2.48015872888517045348e-5) * z - 1.38888888888730564116e-3) * z + 4.16666666666665929218e-2
    )  # fmt: skip
    # selections rather than branches: which quadrant comes next cannot be foretold
    q = int(quadrant)
    odd = (q & 1) == 1
    sine = c if odd else s
    cosine = s if odd else c
    return -sine if (q & 2) == 2 else sine, -cosine if ((q + 1) & 2) == 2 else cosine


@inlined
def bearing(y, x):
    """Returns atan2(y, x) in [-pi, pi], to 3e-16; 0 for the zero vector.

    Our own for the same two reasons as `sin_cos`: the same bits on every machine, and no call that makes compiled code
    put its registers away. Reduced to |t| <= tan(pi/8), then the rational minimax function of Cephes's atan.
    """
    ax = abs(x)
    ay = abs(y)
    small = min(ax, ay)
    large = max(ax, ay, 1e-300)
    near_diagonal = small > 0.41421356237309503 * large
    t = (small - large if near_diagonal else small) / (small + large if near_diagonal else large)
    z = t * t
    p = (((-8.750608600031904122785e-1 * z - 1.615753718733365076637e1) * z - 7.500855792314704667340e1) * z
         - 1.228866684490136173410e2) * z - 6.485021904942025371773e1  # fmt: skip
    q = ((((z + 2.485846490142306297962e1) * z + 1.650270098316988542046e2) * z + 4.328810604912902668951e2) * z
         + 4.853903996359136964868e2) * z + 1.945506571482613964425e2  # fmt: skip
    angle = t + t * (z * p / q)
    angle = angle + 0.7853981633974483 if near_diagonal else angle
    angle = 1.5707963267948966 - angle if ay > ax else angle
    angle = 3.141592653589793 - angle if x < 0.0 else angle
    return math.copysign(angle, y)


def sines(angles: NDArray[Any]) -> NDArray[np.float64]:
    """Returns sin and cos, shape (2, k), of angles (k,), rad."""
    values: NDArray[np.float64] = _sines(np.ascontiguousarray(angles))
    return values


def bearings(y: NDArray[np.float64], x: NDArray[np.float64]) -> NDArray[np.float64]:
    """Returns `bearing` (k,) of vectors with these components, (k,) each."""
    angles: NDArray[np.float64] = _bearings(np.ascontiguousarray(y), np.ascontiguousarray(x))
    return angles


@allocating
def _sines(angles):
    values = np.empty((2, angles.shape[0]))
    for i in range(angles.shape[0]):
        values[0, i], values[1, i] = sin_cos(angles[i])
    return values


@allocating
def _bearings(y, x):
    angles = np.empty(x.shape[0])
    for i in range(x.shape[0]):
        angles[i] = bearing(y[i], x[i])
    return angles


@inlined
def wrap_angle(angle):
    """Returns the angle in (-pi, pi] that points the same way; an angle already there comes back unchanged."""
    if -math.pi < angle <= math.pi:
        return angle
    wrapped = angle - 2.0 * math.pi * math.floor((angle + math.pi) / (2.0 * math.pi))
    # floor maps onto [-pi, pi); heading errors of exactly half a turn are taken to the left
    if wrapped <= -math.pi:
        wrapped += 2.0 * math.pi
    return wrapped


# 2^(16 k), from k = -64 on, and 2^k: their products are exact, those of numbers that are not normal too
_SIXTEENTHS = np.ldexp(1.0, 16 * np.arange(-64, 64))
_UNITS = np.ldexp(1.0, np.arange(16))


@inlined
def power_of_two(n):
    """Returns 2^n for a whole number n from -1022 to 1023, exactly."""
    return _SIXTEENTHS[(n >> 4) + 64] * _UNITS[n & 15]


@inlined
def exponential(x):
    """Returns e^x to 3e-16, relative; x is cut to where that is a normal number, and 0 comes out far below.

    The rational function of the Cephes library's exp: e^r = 1 + 2 r P(r^2) / (Q(r^2) - r P(r^2)), |r| at most ln(2)/2.
    """
    if x < _LOWEST:
        return 0.0
    n = math.floor(min(x, _HIGHEST) * 1.4426950408889634 + 0.5)
    r = (min(x, _HIGHEST) - n * 6.93145751953125e-1) - n * 1.42860682030941723212e-6
    z = r * r
    p = r * ((1.26177193074810590878e-4 * z + 3.02994407707441961300e-2) * z + 1.0)
    q = ((3.00198505138664455042e-6 * z + 2.52448340349684104192e-3) * z + 2.27265548208155028766e-1) * z + 2.0
    return (1.0 + 2.0 * (p / (q - p))) * power_of_two(int(n))


# n, 2^n and 2^-n for n from 512 down to 1
_HALVINGS = np.array([(2.0**k, 2.0**2**k, 2.0 ** -(2**k)) for k in range(9, -1, -1)])


@inlined
def logarithm(x):
    """Returns ln(x) to 3e-16 for a normal number x > 0: the rational function of the Cephes library's log."""
    n = 0.0
    for k in range(10):
        if x >= _HALVINGS[k, 1]:
            x *= _HALVINGS[k, 2]
            n += _HALVINGS[k, 0]
        elif x < 2.0 * _HALVINGS[k, 2]:
            x *= _HALVINGS[k, 1]
            n -= _HALVINGS[k, 0]
    # now in [1, 2)
    if x > 1.4142135623730951:
        x *= 0.5
        n += 1.0
    r = x - 1.0
    z = r * r
    p = (
        ((((1.01875663804580931796e-4 * r + 4.97494994976747001425e-1) * r + 4.70579119878881725854) * r
          + 1.44989225341610930846e1) * r + 1.79368678507819816313e1) * r + 7.70838733755885391666
    )  # fmt: skip
    q = (
        ((((r + 1.12873587189167450590e1) * r + 4.52279145837532221105e1) * r + 8.29875266912776603211e1) * r
          + 7.11544750618563894466e1) * r + 2.31251620126765340583e1
    )  # fmt: skip
    return r + (r * (z * p / q) - n * 2.121944400546905827679e-4 - 0.5 * z) + n * 0.693359375


@inlined
def power(x, exponent):
    """Returns x^exponent to 1e-13, relative, for x >= 0 and an exponent > 0."""
    return exponential(exponent * logarithm(x)) if x > 1e-300 else 0.0


@inlined
def area_sine(x):
    """Returns asinh(x) to 1e-15, relative: ln(1 + y) by Kahan's quotient, y = |x| + x^2 / (1 + sqrt(1 + x^2))."""
    a = abs(x)
    y = a + a * a / (1.0 + math.sqrt(1.0 + a * a))
    u = 1.0 + y
    area = y if u == 1.0 else logarithm(u) * (y / (u - 1.0))
    return math.copysign(area, x)


@inlined
def hyperbolic_tangent(x):
    """Returns tanh(x) to 1e-9, relative, which single precision does not see."""
    a = abs(x)
    if a < 1e-4:
        return x
    e = exponential(-2.0 * min(a, 40.0))
    return math.copysign((1.0 - e) / (1.0 + e), x)
