"""Every setting of every preset at both ends of its listed range: taken, or refused in one line before any frame."""

import math
import typing

import pytest

pytest.importorskip("stable_baselines3")

from wayfield.policies.parts.gain import Gain
from wayfield.policies.training.presets import PRESETS, overridden, settable


def ends(listed: Gain) -> list[str]:
    """Returns the values at the ends of a range, or just inside where an end is open; none of words."""
    if listed.kind is bool:
        return ["true", "false"]
    if typing.get_origin(listed.kind) is typing.Literal:
        return list(typing.get_args(listed.kind))
    if listed.kind is int:
        return [*listed.range.split(" to ")[:1], str(int(float(listed.range.split(" to ")[1])))]
    if listed.kind not in (float, float | None):
        return []
    bounds = (listed.above, listed.least, listed.below, listed.most)
    above, least, below, most = (float(each) if not isinstance(each, str) else math.inf for each in bounds)
    low = least if math.isfinite(least) else above + 1e-9 if math.isfinite(above) else -1e6
    high = most if math.isfinite(most) else below - 1e-9 if math.isfinite(below) else 1e6
    return [repr(low), repr(high)]


@pytest.mark.parametrize("name", PRESETS)
def test_a_setting_at_the_end_of_its_range_is_taken_or_refused_in_one_line(name: str) -> None:
    tried, refusals = 0, {}
    for key, listed in settable(PRESETS[name]).items():
        for value in ends(listed):
            tried += 1
            try:
                overridden(PRESETS[name], [f"{key}={value}"])
            except ValueError as error:
                refusals[key, value] = str(error)
    assert tried >= 60
    assert len(refusals) < tried / 4, refusals
    assert not [each for each in refusals.values() if "\n" in each]
    for (key, _), line in refusals.items():
        assert key.rpartition(".")[2].split("_")[0] in line
