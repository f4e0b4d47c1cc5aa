"""Elementary functions of our own beside the C library's."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from wayfield.system.elementary import area_sine, exponential, hyperbolic_tangent, logarithm, power


@given(st.floats(-700.0, 700.0))
def test_exponential(x: float) -> None:
    assert exponential(x) == pytest.approx(math.exp(x), rel=1e-15, abs=0.0)


@given(st.floats(1e-300, 1e300))
def test_logarithm(x: float) -> None:
    assert logarithm(x) == pytest.approx(math.log(x), rel=5e-16, abs=1e-18)


@given(st.floats(-1e6, 1e6).filter(lambda x: x == 0.0 or abs(x) > 1e-150))
def test_area_sine(x: float) -> None:
    assert area_sine(x) == pytest.approx(math.asinh(x), rel=2e-15, abs=0.0)


@given(st.floats(-50.0, 50.0))
def test_hyperbolic_tangent_to_single_precision(x: float) -> None:
    assert hyperbolic_tangent(x) == pytest.approx(math.tanh(x), rel=5e-9, abs=0.0)


@given(st.floats(1e-6, 1e6), st.floats(0.1, 5.0))
def test_power(x: float, exponent: float) -> None:
    assert power(x, exponent) == pytest.approx(x**exponent, rel=1e-13, abs=0.0)


def test_beyond_the_normal_numbers() -> None:
    assert [exponential(x) for x in (-1000.0, -1e10, -1e300, -math.inf)] == [0.0] * 4
    assert math.isfinite(exponential(1000.0))
    assert power(0.0, 2.0) == 0.0
    assert exponential(0.0) == 1.0
    assert logarithm(1.0) == 0.0
