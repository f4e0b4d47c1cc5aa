"""Reference implementation of an agent's decision, part by part, and of the base that it drives as."""

import dataclasses
import itertools
import math
from typing import Any

import gymnasium
import pytest

from wayfield import policies
from wayfield.envs.robots import ACTUATORS, Actuators
from wayfield.policies.learned.conditions import effective_actuators, network_speed, out_of_distribution
from wayfield.policies.learned.residual import Base, controller_at

PATH = "wayfield/DiffDrivePathFollowing-v0"
TIERS: Any = (*ACTUATORS.values(), *(Actuators(True, a, w, lag) for a, w, lag in itertools.product(
    (0.3, 1.0, 1.5), (1.0, 3.0, 4.0), (0.05, 0.1, 0.3))))  # fmt: skip


def briefing_of(env_id: str, **kwargs: Any) -> Any:
    env = gymnasium.make(env_id, **kwargs)
    env.reset(seed=0)
    return env.unwrapped.briefing("sensors")  # type: ignore[attr-defined]


@pytest.fixture(scope="module")
def told() -> Any:
    return briefing_of(PATH)


def stopping(speed: float, base: Actuators) -> float:
    """Returns the way (m) on which a base stops."""
    return speed * base.lag + speed**2 / (2.0 * base.acceleration)


@pytest.mark.parametrize("known", [("lagged",), ("slow",), ("lagged", "slow"), ("ideal",), ("slow", "ideal", "lagged")])
def test_which_base_an_agent_drives_a_base_as_and_how_fast(known: tuple[str, ...], told: Any) -> None:
    cruises = {"lagged": [[0.4, 0.3], [0.8, 0.5]], "slow": [[0.5, 0.4]]}
    card = {"trained_on": {"actuators": [*known], "speeds": [0.8, 0.4], "disturbances": [], "beams": []}}
    card["cruises"] = {tier: each for tier, each in cruises.items() if tier in known}
    bases = [ACTUATORS[tier] for tier in known]
    for own, speed in itertools.product(TIERS, (0.2, 0.45, 0.7, 0.9)):
        here = dataclasses.replace(told, actuators=own)
        best = max(bases, key=lambda each: each.acceleration)
        is_quicker = (
            own.acceleration >= best.acceleration
            and own.yaw_acceleration >= best.yaw_acceleration
            and own.lag <= best.lag
        )
        wanted = own if own in bases or not is_quicker else best
        assert effective_actuators(card, here) == wanted
        if wanted in bases:
            pairs = card["cruises"].get(known[bases.index(wanted)], [])
            asked = speed
            if pairs and speed <= pairs[-1][1]:
                steps = [[0.0, 0.0], *pairs]
                for (a, b), (c, d) in itertools.pairwise(steps):
                    if b <= speed <= d:
                        asked = a + (c - a) * (speed - b) / (d - b)
            elif pairs:
                asked = pairs[-1][0] if pairs[-1][0] < 0.8 else max(pairs[-1][0], speed)
            assert network_speed(card, here, speed) == pytest.approx(asked)
            continue
        worst = min(bases, key=lambda each: each.acceleration)
        slowed = network_speed(card, here, speed)
        if worst.acceleration == math.inf or stopping(speed, own) <= stopping(speed, worst):
            assert slowed == speed
        else:
            assert slowed < speed
            assert stopping(slowed, own) == pytest.approx(stopping(speed, worst))
    assert effective_actuators({}, told) is told.actuators
    assert network_speed({}, told, 0.33) == 0.33
    assert out_of_distribution({}, told, 9.0) == ""


def test_a_controller_under_an_agent_cruises_at_the_speed_that_is_asked_for() -> None:
    """Whatever speed its gains were tuned for, and with all else of them."""
    for policy in ("lqr", "stanley", "mpc", "pure_pursuit", "regulated_pure_pursuit", "lookahead_retuned", "dwa"):
        gains = policies.tuned_gains(policy, "goal-obstacles" if policy == "dwa" else "path-following", "p3dx")
        for speed in (0.25, 0.6, 1.05):
            for law in (controller_at(policy, gains, speed), Base(policy, gains, 0.2).policy(speed)):
                has: Any = vars(law)
                cruise = next(name for name in ("k_lin", "speed", "max_speed") if name in has)
                ahead = has["lookahead_distance"] if cruise == "k_lin" else 1.0  # that law settles at v = k_lin L
                assert has[cruise] * ahead == pytest.approx(speed)
                assert {name: has[name] for name in gains if name != cruise} == {
                    name: each for name, each in gains.items() if name != cruise
                }
