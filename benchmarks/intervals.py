"""Intervals for shares of successes."""

import math

_Z = 1.959963984540054  # of the two-sided 95 % interval


def wilson(successes: int, trials: int) -> tuple[float, float]:
    """Returns the 95 % Wilson score interval of a success rate (Wilson, JASA 22, 1927)."""
    if trials < 1 or not 0 <= successes <= trials:
        raise ValueError(f"successes must lie in 0..trials and trials be at least 1, got {successes} of {trials}")
    share = successes / trials
    spread = _Z * math.sqrt(share * (1.0 - share) / trials + (_Z / (2.0 * trials)) ** 2)
    middle = share + _Z**2 / (2.0 * trials)
    scale = 1.0 + _Z**2 / trials
    return max((middle - spread) / scale, 0.0), min((middle + spread) / scale, 1.0)
