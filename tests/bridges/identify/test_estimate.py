"""The response of a base against small steps of its equations, and hidden bases that the estimator finds again."""

import math

import numpy as np
import pytest
from identification import drive_of, poor, script, skid_steer, spoiled

from wayfield.bridges.identify.estimate import fit, intervals
from wayfield.bridges.identify.response import AXES, PAIR, TWIST, WHEELS, Drive, pair_response

P3DX = np.array([0.13, 0.9, 1.2, 1.0, 1.7, 0.1])  # delay, gain, limit, acceleration, deceleration, lag
# a skid steer; at the end a wheel's speed and half of its track
SKID = np.array([0.30, 1.01, 3.3, 3.3, 0.25, 0.26, 0.77, 7.0, 7.0, 0.30, 3.76, 0.60])


def drawn(rng: np.random.Generator, seconds: float = 12.0) -> Drive:
    """Returns commands at drawn times, and times of measurements; nothing is measured yet."""
    n = round(4 * seconds)
    times = np.sort(rng.uniform(0.0, seconds, 12 * round(seconds)))
    commands = np.stack([rng.uniform(-1.6, 1.6, n), rng.uniform(-4.0, 4.0, n)], axis=1)
    started = np.arange(len(times)) == 0
    return Drive(np.sort(rng.uniform(0.0, seconds, n)), commands, times, np.zeros((len(times), 2)), started, ~started)


def alone(drive: Drive, numbers: np.ndarray) -> np.ndarray:
    """Returns the response of the forward axis, of numbers as those of P3DX, which saturates by itself."""
    delay, gain, limit, *rest = numbers.tolist()
    return pair_response(drive, AXES, np.array([delay, gain, *rest, *SKID[5:10], limit, 100.0]))[0][0]


def integrated(drive: Drive, numbers: np.ndarray, step: float = 1e-4) -> list[float]:
    """Returns the response of the forward axis, integrated in small steps."""
    delay, gain, limit, rise, fall, lag = numbers.tolist()
    found, r, v, event = [], 0.0, 0.0, 0
    t = float(drive.times[0])
    events = [*(drive.command_times + delay).tolist(), math.inf]
    target = 0.0
    for time in drive.times.tolist():
        while t < time:
            while events[event] <= t:
                target = min(max(gain * drive.commands[event, 0], -limit), limit)
                event += 1
            most = (fall if r * (target - r) < 0.0 else rise) * step
            r += min(max(target - r, -most), most)
            v += (r - v) * step / lag
            t += step
        found.append(v)
    return found


def test_the_closed_form_is_what_small_steps_come_to() -> None:
    drive = drawn(np.random.default_rng(0))
    v = alone(drive, P3DX)
    np.testing.assert_allclose(v, integrated(drive, P3DX), atol=2e-3 * v.std())


@pytest.mark.parametrize("saturation", [AXES, TWIST, WHEELS])
def test_derivatives_are_those_of_central_differences(saturation: int) -> None:
    drive = drawn(np.random.default_rng(1))
    numbers = np.array([0.13, 0.9, 1.0, 1.7, 0.1, 0.2, 0.8, 7.0, 5.0, 0.15, 1.1, 0.3])
    if saturation == AXES:
        numbers[11] = 2.0
    _, slopes = pair_response(drive, saturation, numbers)
    for j in range(len(PAIR)):
        step = np.zeros(len(PAIR))
        step[j] = 1e-6
        after, before = (pair_response(drive, saturation, each)[0] for each in (numbers + step, numbers - step))
        np.testing.assert_allclose(slopes[..., j], (after - before) / 2e-6, atol=1e-6)


def test_the_response_shifts_scales_and_keeps_its_limits() -> None:
    drive = drawn(np.random.default_rng(2))
    v = alone(drive, P3DX)
    later = Drive(drive.command_times + 0.4, drive.commands, drive.times, drive.speeds, drive.starts, drive.counted)
    sooner, longer = P3DX.copy(), P3DX.copy()
    sooner[0] -= 0.1
    longer[0] += 0.3
    np.testing.assert_allclose(alone(later, sooner), alone(drive, longer))
    scaled = P3DX * [1.0, 2.0, 2.0, 2.0, 2.0, 1.0]
    np.testing.assert_allclose(alone(drive, scaled), 2.0 * v, atol=1e-12)
    assert np.abs(v).max() <= 1.2  # no overshoot
    assert (np.abs(np.diff(v)) <= 1.7 * np.diff(drive.times) + 1e-12).all()
    # alone, both axes respond as they do together where nothing saturates
    free = np.array([*P3DX[[0, 1, 3, 4, 5]], 0.2, 0.8, 7.0, 5.0, 0.15, 100.0, 0.3])
    unlimited = np.array([*P3DX[:2], 100.0, *P3DX[3:]])
    for saturation in (AXES, TWIST, WHEELS):
        np.testing.assert_allclose(pair_response(drive, saturation, free)[0][0], alone(drive, unlimited))


def both(rng: np.random.Generator, seconds: float = 90.0) -> np.ndarray:
    """Returns the commands (n, 2) of one who drives by two sticks, often both at once."""
    commands = np.zeros((round(20 * seconds), 2))
    for k, top in enumerate((4.2, 9.0)):
        i, level = 0, 0.0
        while i < len(commands):
            wanted = top * rng.choice([0.0, 0.0, 1.0, -1.0, rng.uniform(-1.0, 1.0)])
            part = np.concatenate(
                [np.linspace(level, wanted, rng.integers(1, 6)), np.full(rng.integers(5, 60), wanted)]
            )
            commands[i : i + len(part), k] = part[: len(commands) - i]
            i, level = i + len(part), wanted
    return commands


@pytest.mark.parametrize("saturation", [AXES, TWIST, WHEELS])
def test_a_hidden_base_is_found_within_its_intervals(saturation: int) -> None:
    rng = np.random.default_rng(3)
    hidden = SKID.copy()
    if saturation == AXES:
        hidden[11] = 6.2
    drive = drive_of(rng, both(rng), saturation, hidden, (0.06, 0.15), 0.6)
    found = intervals(fit(drive, half_track=0.35))
    assert found.saturation == saturation
    names = {
        f"{name}_{axis}": 5 * k + i
        for k, axis in enumerate("vw")
        for i, name in ((0, "delay"), (2, "acceleration"), (4, "lag"))
    }
    limits = {"speed_v": hidden[10], "speed_w": hidden[11], "wheel_speed": hidden[10], "track": 2.0 * hidden[11]}
    covered = []
    for each in found.estimates:
        assert each.low <= each.value <= each.high
        true = limits[each.name] if each.name in limits else hidden[names[each.name]] if each.name in names else None
        if true is not None:
            assert each.value == pytest.approx(true, rel=0.1), each
            covered.append(each.low <= true <= each.high)
    assert sum(covered) >= len(covered) - 2  # each has its 5 %
    np.testing.assert_allclose(found.noise, (0.06, 0.15), rtol=0.15)


@pytest.mark.parametrize("saturation", [TWIST, WHEELS])
def test_the_saturation_is_told_where_a_base_drives_spirals(saturation: int) -> None:
    rng, t = np.random.default_rng(0), np.arange(1200) * 0.05
    share = t % 20.0 / 20.0
    commands = np.stack([3.6 - 2.16 * share, np.where(t // 20.0 % 2.0, -8.0, 8.0) * share], axis=1)
    commands[t % 20.0 < 1.5] = 0.0
    assert fit(drive_of(rng, commands, saturation, SKID, (0.06, 0.15), 0.6), 0.35).saturation == saturation


def test_a_deceleration_of_its_own_is_found_where_there_is_one() -> None:
    rng = np.random.default_rng(4)
    hidden = np.array([0.1, 1.0, 0.7, 1.4, 0.1, 0.1, 1.0, 3.0, 3.0, 0.1, 1.0, 2.5])
    commands = np.stack([script(60.0, 1.0), script(60.0, 2.5)[::-1]], axis=1)
    found = intervals(fit(drive_of(rng, commands, AXES, hidden, (0.02, 0.05), 0.0)))
    for name, value in (("deceleration_v", 1.4), ("acceleration_v", 0.7), ("deceleration_w", 3.0)):
        assert found[name].value == pytest.approx(value, rel=0.05)
        assert found[name].low <= value <= found[name].high


@pytest.mark.parametrize("excitation", ["half speed", "first seconds", "small steps", "slow sine"])
def test_what_was_not_excited_has_a_wide_interval_that_holds(excitation: str) -> None:
    true = {"delay_v": 0.13, "acceleration_v": 1.0, "deceleration_v": 1.0, "lag_v": 0.1, "speed_v": 1.2}
    true["delay_v + lag_v"] = 0.23
    outside = 0
    for seed in range(3):
        found = intervals(fit(poor(np.random.default_rng(seed), excitation)))
        outside += sum(not found[name].low * 0.999 <= value <= found[name].high * 1.001 for name, value in true.items())
        if excitation != "first seconds":  # which reach the top speed
            assert found["speed_v"].high == math.inf
            assert "1.3 times the top speed" in found["speed_v"].missing
        for name in ("delay_w", "acceleration_w", "speed_w"):
            assert str(found[name]) == "not observable"
    assert outside <= 3  # of 18, each of which has its 5 %


def test_what_real_logs_have_besides_noise_spoils_no_answer() -> None:
    """Quantised encoders, a dead band, outliers, lost messages, and late stamps, which are a part of the delay."""
    rng = np.random.default_rng(7)
    drive = spoiled(rng, skid_steer(rng))
    found = {each.name: each for each in intervals(fit(drive, half_track=0.3)).estimates}
    true = {"delay_v": 0.308, "delay_w": 0.268, "gain_v": 1.01, "gain_w": 0.77, "lag_v": 0.25, "lag_w": 0.30}
    for name, value in true.items():
        width = found[name].high - found[name].low
        assert found[name].low - 0.2 * width <= value <= found[name].high + 0.2 * width
        assert found[name].value == pytest.approx(value, rel=0.15)


def test_a_drive_without_noise_is_known_best_of_all_its_decelerations_too() -> None:
    """As of a simulator: what is left is rounding, of which no interval can be made."""
    part = script(30.0, 1.0)
    idle = np.zeros_like(part)
    commands = np.stack([0.2 * np.concatenate([part, idle]), 2.4 * np.concatenate([idle, part])], axis=1)
    true = np.array([0.12, 1.0, 0.7, 1.1, 0.18, 0.16, 1.0, 3.0, 3.0, 0.18, 0.2, 2.4])
    drive = drive_of(np.random.default_rng(0), commands, AXES, true, (0.0, 0.0), 0.0)
    found = intervals(fit(drive))
    for each in found.estimates:
        if "+" in each.name:
            continue
        kind, axis = each.name.split("_")
        value = true[10 + "vw".index(axis)] if kind == "speed" else true[PAIR.index(each.name)]
        assert each.value == pytest.approx(value, rel=1e-3)
        assert each.low <= value * (1.0 + 1e-6)
        assert value * (1.0 - 1e-6) <= each.high
