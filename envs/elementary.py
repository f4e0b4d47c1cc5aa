"""Elementary functions of our own, for compiled laws: the same bits on every machine, and in a browser.

The C library's differ in their last bits from one version to the next. Sine, cosine and arc tangent are in `geometry`.
"""

import math

from wayfield.envs.compiled import inlined

_LOWEST, _HIGHEST = -708.0, 709.0  # exponents whose powers of e are normal numbers


@inlined
def power_of_two(n):
    """Returns 2^n for a whole number n from -1022 to 1023, exactly."""
    result = 1.0
    factor = 2.0 if n >= 0 else 0.5
    left = abs(n)
    while left > 0:
        if left & 1:
            result *= factor
        factor *= factor
        left >>= 1
    return result


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


@inlined
def logarithm(x):
    """Returns ln(x) to 3e-16 for a normal number x > 0: the rational function of the Cephes library's log."""
    n = 0.0
    step = 512.0
    up = 2.0**512
    down = 2.0**-512
    while step >= 1.0:
        if x >= up:
            x *= down
            n += step
        elif x < down * 2.0:
            x *= up
            n -= step
        step *= 0.5
        up = math.sqrt(up)
        down = math.sqrt(down)
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
    found = y if u == 1.0 else logarithm(u) * (y / (u - 1.0))
    return math.copysign(found, x)


@inlined
def hyperbolic_tangent(x):
    """Returns tanh(x) to 1e-9, relative, which single precision does not see."""
    a = abs(x)
    if a < 1e-4:
        return x
    e = exponential(-2.0 * min(a, 40.0))
    return math.copysign((1.0 - e) / (1.0 + e), x)
