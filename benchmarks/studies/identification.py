"""How well `wayfield identify` finds hidden bases: python benchmarks/studies/identification.py."""

import dataclasses
import math
import time
from typing import NamedTuple

import click
import numpy as np

from wayfield.bridges.identify.checks import check
from wayfield.bridges.identify.estimate import Estimate, fit, intervals
from wayfield.bridges.identify.recording import Log
from wayfield.bridges.identify.response import AXES, PAIR, WHEELS, Drive, Floats, pair_response
from wayfield.system.command_line import SEED, OneLineErrors

P3DX = (0.13, 1.2, 1.0, 0.1)  # delay, limit, acceleration and lag
PERIOD = 0.05  # s, of commands and odometry


def script(seconds: float, top: float) -> Floats:
    """Returns the commands (n,) of one axis at 20 Hz: rest, steps, reversals, beyond the limit, ramp and chirp."""
    levels = [(0, 2), *((level, 1.4) for level in (1, -1, 0.5, -0.5, 0.25, -0.25)), (0, 1)]
    levels += [(1, 2), (-1, 2.5), (1, 2.5), (-1, 2.5), (0, 1.5), (1.3, 3.5), (-1.3, 4.5), (0, 1.5)]
    parts = [np.full(round(span * seconds / 60.0 / PERIOD), float(level)) for level, span in levels]
    ramp = round(6.0 * seconds / 60.0 / PERIOD)
    parts.append(0.8 * (1.0 - np.abs(np.linspace(-1.0, 1.0, ramp))))
    left = round(seconds / PERIOD) - sum(map(len, parts))
    t = np.arange(left) * PERIOD
    parts.append(0.6 * np.sin(2.0 * np.pi * (0.2 * t + 0.5 * (1.3 - 0.2) / (left * PERIOD) * t * t)))
    return top * np.concatenate(parts)


def coloured(rng: np.random.Generator, n: int, deviation: float, correlation: float) -> Floats:
    """Returns noise (n,) of a first-order process."""
    white = rng.normal(0.0, deviation, n)
    noise = np.empty(n)
    last = white[0]
    for i in range(n):
        last = correlation * last + np.sqrt(1.0 - correlation**2) * white[i] if i else white[0]
        noise[i] = last
    return noise


def drive_of(
    rng: np.random.Generator,
    commands: Floats,
    saturation: int,
    numbers: Floats,
    noise: tuple[float, float],
    correlation: float,
) -> Drive:
    """Returns what a base with these numbers is measured to do at 20 Hz, stamps a few milliseconds off."""
    n = len(commands)
    sent = PERIOD * np.arange(n) + rng.uniform(0.0, 0.01, n)
    times = PERIOD * np.arange(n) + 0.02 + rng.uniform(0.0, 0.004, n)
    starts = np.arange(n) == 0
    drive = Drive(sent, np.ascontiguousarray(commands), times, np.zeros((n, 2)), starts, times > times[0] + 1.0)
    v = pair_response(drive, saturation, numbers)[0].T
    speeds = v + np.stack([coloured(rng, n, each, correlation) for each in noise], axis=1)
    return dataclasses.replace(drive, speeds=speeds)


def poor(rng: np.random.Generator, excitation: str) -> Drive:
    """Returns a drive of a P3-DX that goes straight, and does not excite everything."""
    delay, limit, acceleration, lag = P3DX
    top, noise, correlation = limit, 0.02, 0.0
    t = np.arange(1200) * PERIOD
    commands = np.zeros((1200, 2))
    commands[:, 0] = {
        "half speed": 0.5 * np.clip(script(60.0, top), -top, top),
        "first seconds": script(60.0, top),
        "small steps": 0.08 * np.sign(np.sin(2.0 * np.pi * t / 4.0)),
        "slow sine": 0.6 * np.sin(2.0 * np.pi * 0.1 * t),
    }[excitation]
    if excitation == "first seconds":
        commands = commands[:400]
    axis = (delay, 1.0, acceleration, acceleration, lag)
    return drive_of(rng, commands, AXES, np.array([*axis, *axis, limit, limit]), (noise, noise), correlation)


class Drawn(NamedTuple):
    """A log of a base whose response is known."""

    log: Log
    drive: str  # one of DRIVES
    fault: str  # one of FAULTS
    truth: dict[str, float]  # of each parameter


DRIVES = ("joystick", "route", "excite")
FAULTS = ("none", "bursts", "half the commands", "half the odometry")


def hidden_base(rng: np.random.Generator) -> tuple[int, Floats, Floats]:
    """Returns the saturation, the numbers and the top speeds (2,) of a base."""
    top = np.array([math.exp(rng.uniform(math.log(0.2), math.log(4.0))), rng.uniform(0.8, 5.0)])
    saturation = int(rng.integers(3))
    rises = top / np.exp(rng.uniform(math.log(0.1), math.log(1.5), 2))
    falls = rises * (rng.uniform(1.2, 2.5) if rng.random() < 0.3 else 1.0)
    delays = rng.uniform(0.0, 0.35) + rng.uniform(0.0, 0.05, 2)
    lags = rng.uniform(0.03, 0.4) * rng.uniform(0.8, 1.2, 2)
    gains = np.ones(2) if rng.random() < 0.3 else rng.uniform(0.75, 1.1, 2)
    limits = top[0], top[1] if saturation == AXES else top[0] / top[1]
    return saturation, np.array([*np.stack([delays, gains, rises, falls, lags]).T.ravel(), *limits]), top


def joystick(rng: np.random.Generator, top: Floats, n: int, period: float) -> Floats:
    """Returns commands (n, 2) of one who pushes two sticks and holds them, at times beyond what the base can."""
    commands = np.zeros((n, 2))
    for k in range(2):
        i, level = 0, 0.0
        while i < n:
            share = rng.choice([0.0, 0.0, 1.0, -1.0, *rng.uniform(-1.0, 1.0, 2)]) * rng.choice([1.0, 1.0, 1.15])
            ramp, hold = (max(round(rng.uniform(*span) / period), 1) for span in ((0.05, 0.4), (0.2, 3.0)))
            part = np.concatenate([np.linspace(level, top[k] * share, ramp), np.full(hold, top[k] * share)])
            commands[i : i + len(part), k] = part[: n - i]
            i, level = i + len(part), top[k] * share
    return commands


def route(rng: np.random.Generator, top: Floats, n: int, period: float) -> Floats:
    """Returns commands (n, 2) of a controller: legs in bends at part of the top speed, stops and turns between."""
    commands, i, v, w = np.zeros((n, 2)), 0, 0.0, 0.0
    cruise, up = rng.uniform(0.4, 0.9) * top[0], top[0] / rng.uniform(0.5, 2.0) * period
    while i < n:
        end = i + round(rng.uniform(5.0, 20.0) / period)
        for i in range(i, min(end, n)):  # noqa: B020
            goal = cruise if i < end - 2.0 / period else 0.0
            v += min(max(goal - v, -up), up)
            w += 0.35 * top[1] * math.sqrt(period) * rng.normal() - w * period / 1.5
            commands[i] = v, min(max(w, -0.8 * top[1]), 0.8 * top[1]) if v > 0.0 else 0.0
        i += 1
        if rng.random() < 0.4:
            turn = round(rng.uniform(1.0, 3.0) / period)
            commands[i : i + turn, 1] = rng.choice([-0.5, 0.5]) * top[1]
            i += turn
        i += round(1.0 / period)
    return commands


def excite(rng: np.random.Generator, top: Floats, n: int, period: float) -> Floats:
    """Returns commands (n, 2) of a script: ahead, turning, both, again and again."""
    del rng
    part = script(40.0, 1.0)
    none = np.zeros_like(part)
    both = (
        0.95 * top * np.stack([np.concatenate(each) for each in ([part, none, 0.6 * part], [none, part, 0.6 * part])]).T
    )
    twists: Floats = both[(np.arange(n) * period / PERIOD).astype(int) % len(both)]
    return twists


def drawn_log(seed: int) -> Drawn:
    """Returns a log of 30 to 600 s of a drawn base, driven and spoiled in one of twelve ways, which come in turn."""
    rng = np.random.default_rng([seed, 49])
    saturation, numbers, top = hidden_base(rng)
    drive, fault = DRIVES[seed % 3], FAULTS[seed // 3 % 4]
    seconds = math.exp(rng.uniform(math.log(60.0 if drive == "route" else 30.0), math.log(600.0)))
    period, step = (
        1.0 / rng.choice([10.0, 20.0, 20.0, 30.0]),
        0.05 if seconds > 200.0 else 1.0 / rng.choice([20.0, 50.0]),
    )
    commands = {"joystick": joystick, "route": route, "excite": excite}[drive](
        rng, top, round(seconds / period), period
    )
    sent = period * np.arange(len(commands)) + rng.uniform(0.0, 0.005, len(commands))
    times = step * np.arange(round(seconds / step)) + 0.003 + rng.uniform(0.0, 0.002, round(seconds / step))
    if fault == "half the odometry":
        times = times[::2]
    n = len(times)
    whole = Drive(sent, commands, times, np.zeros((n, 2)), np.arange(n) == 0, np.ones(n, np.bool_))
    correlation, noise = rng.choice([0.0, 0.3, 0.6, 0.8]), top * np.exp(rng.uniform(math.log(0.003), math.log(0.03)))
    v = pair_response(whole, saturation, numbers)[0].T
    speeds = v + np.stack([coloured(rng, n, each, correlation) for each in noise], axis=1)
    for _ in range(rng.integers(1, 4) if fault == "bursts" else 0):
        k, length = rng.integers(2), rng.integers(5, 20)
        at = rng.integers(n // 10, n - length)
        steady = rng.random() < 0.6
        speeds[at : at + length, k] = (
            rng.choice([0.0, 4.0, -1.5]) * top[k] if steady else rng.normal(0.0, 3.0 * top[k], length)
        )
    if fault == "half the commands":
        sent, commands = sent[1::2], commands[1::2]
    truth = dict(zip(PAIR, numbers.tolist(), strict=True))
    wide = numbers[11] if saturation == AXES else numbers[10] / numbers[11]
    truth |= {"speed_v": numbers[10], "wheel_speed": numbers[10], "speed_w": wide, "track": 2.0 * numbers[10] / wide}
    truth |= {f"delay_{a} + lag_{a}": truth[f"delay_{a}"] + truth[f"lag_{a}"] for a in "vw"}
    log = Log(f"log {seed}", "", "table", sent, np.ascontiguousarray(commands), times, np.ascontiguousarray(speeds))
    return Drawn(log, drive, fault, truth)


def covered(drawn: Drawn) -> list[tuple[Estimate, bool]]:
    """Returns the estimates of a log, and whether their intervals hold what is true, to a thousandth."""
    estimates = intervals(fit(check(drawn.log).drive)).estimates
    return [(each, each.low * 0.999 <= drawn.truth[each.name] <= each.high * 1.001) for each in estimates]


def skid_steer(rng: np.random.Generator, seconds: float = 130.0) -> Drive:
    """Returns a stand-in for a log of a skid steer: two speeds an axis, wheels that saturate, coloured noise."""
    commands = np.zeros((round(seconds / PERIOD), 2))
    for k, tops in enumerate(((2.0, 4.2), (4.0, 9.0))):
        i, level = 0, 0.0
        while i < len(commands):
            wanted = rng.choice([0.0, 1.0, -1.0]) * rng.choice(tops)
            ramp, hold = rng.integers(1, 6), rng.integers(5, 60)
            part = np.concatenate([np.linspace(level, wanted, ramp), np.full(hold, wanted)])
            commands[i : i + len(part), k] = part[: len(commands) - i]
            i, level = i + len(part), wanted
    numbers = np.array([0.30, 1.01, 3.3, 3.3, 0.25, 0.26, 0.77, 7.0, 7.0, 0.30, 3.76, 0.60])
    return drive_of(rng, commands, WHEELS, numbers, (0.09, 0.30), 0.8)


def spoiled(rng: np.random.Generator, drive: Drive) -> Drive:
    """Returns a drive as real logs have it.

    Encoders count steps and stand still below a dead band; one message of a hundred is wrong by metres a second, one of
    twenty is lost; stamps are late by 8 ms in the mean.
    """
    speeds = drive.speeds * (np.abs(drive.speeds) > (0.05, 0.12))
    speeds = np.round(speeds / (0.02, 0.05)) * (0.02, 0.05)
    wrong = rng.random(len(speeds)) < 0.01
    speeds[wrong] += rng.normal(0.0, (3.0, 8.0), (int(wrong.sum()), 2))
    times = np.maximum.accumulate(drive.times + rng.exponential(0.008, len(speeds))) + 1e-6 * np.arange(len(speeds))
    intact = rng.random(len(speeds)) > 0.05
    intact[:40] = True
    return Drive(
        drive.command_times, drive.commands, times[intact], speeds[intact], drive.starts[intact], drive.counted[intact]
    )


@click.command(cls=OneLineErrors)
@click.option("--logs", type=click.IntRange(1, 10_000), default=200, show_default=True)
@click.option("--seed", type=SEED, default=0, show_default=True)
def main(logs: int, seed: int) -> None:
    """Measures the coverage of intervals on logs of drawn bases, by parameter, drive and fault."""
    hits: dict[str, list[bool]] = {}
    began = time.process_time()
    for k in range(seed, seed + logs):
        drawn = drawn_log(k)
        for each, inside in covered(drawn):
            for name in ("all", drawn.drive, drawn.fault, each.name):
                hits.setdefault(name, []).append(inside)
            if not inside:
                what = f"{drawn.log.name}, {drawn.drive}, {drawn.fault}"
                print(f"{what}: {each.name} {each}, true {drawn.truth[each.name]:.4g}")
    print("| intervals of | hold the true value | n |\n|---|---|---|")
    for name, held in hits.items():
        print(f"| {name} | {100.0 * np.mean(held):.1f} % | {len(held)} |")
    print(f"{(time.process_time() - began) / logs:.1f} CPU s a log")


if __name__ == "__main__":
    main()
