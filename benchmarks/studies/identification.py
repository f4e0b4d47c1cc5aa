"""How well `wayfield identify` finds hidden bases: python benchmarks/studies/identification.py."""

import dataclasses
import time

import click
import numpy as np
from numpy.typing import NDArray

from wayfield.benchmarks.identify.command import held_out
from wayfield.benchmarks.identify.estimate import axis_problem, correlations, fit, fit_axis, intervals
from wayfield.benchmarks.identify.response import AXES, SATURATIONS, WHEELS, Drive, Floats, pair_response
from wayfield.system.command_line import SEED, OneLineErrors

# delay, limit, acceleration and lag; noise and its correlation; the top speed that is asked for; the axis
CASES = {
    "p3dx v": ((0.13, 1.2, 1.0, 0.1), (0.02, 0.0), 1.2, 0),
    "p3dx v, coloured": ((0.13, 1.2, 1.0, 0.1), (0.02, 0.8), 1.2, 0),
    "turtlebot3 v": ((0.06, 0.22, 1.0, 0.1), (0.004, 0.0), 0.22, 0),
    "turtlebot3 w": ((0.06, 2.75, 3.0, 0.1), (0.05, 0.0), 2.75, 1),
    "jackal v": ((0.03, 2.0, 20.0, 0.1), (0.03, 0.0), 2.0, 0),
    "heavy base v": ((0.3, 3.9, 3.4, 0.26), (0.05, 0.8), 3.9, 0),
}
PERIOD = 0.05  # s, of commands and odometry


def script(seconds: float, top: float) -> Floats:
    """Returns the commands (n,) of one axis at 20 Hz: rest, steps, reversals, beyond the limit, ramp and chirp."""
    levels = [(0, 2), *((level, 1.4) for level in (1, -1, 0.5, -0.5, 0.25, -0.25)), (0, 1)]
    levels += [(1, 2), (-1, 2.5), (1, 2.5), (-1, 2.5), (0, 1.5), (1.3, 3.5), (-1.3, 4.5), (0, 1.5)]
    found = [np.full(round(span * seconds / 60.0 / PERIOD), float(level)) for level, span in levels]
    ramp = round(6.0 * seconds / 60.0 / PERIOD)
    found.append(0.8 * (1.0 - np.abs(np.linspace(-1.0, 1.0, ramp))))
    left = round(seconds / PERIOD) - sum(map(len, found))
    t = np.arange(left) * PERIOD
    found.append(0.6 * np.sin(2.0 * np.pi * (0.2 * t + 0.5 * (1.3 - 0.2) / (left * PERIOD) * t * t)))
    return top * np.concatenate(found)


def coloured(rng: np.random.Generator, n: int, deviation: float, correlation: float) -> Floats:
    """Returns noise (n,) of a first-order process."""
    white = rng.normal(0.0, deviation, n)
    found = np.empty(n)
    last = white[0]
    for i in range(n):
        last = correlation * last + np.sqrt(1.0 - correlation**2) * white[i] if i else white[0]
        found[i] = last
    return found


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
    """Returns a drive of the case "p3dx v" that does not excite everything."""
    (delay, limit, acceleration, lag), (noise, correlation), top, _ = CASES["p3dx v"]
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


def covered(case: str, seed: int) -> tuple[Floats, NDArray[np.bool_], float]:
    """Returns errors (5,) of delay (s) and of gain, limit, slew and lag (shares), what is covered, and s of a fit."""
    (delay, limit, slew, lag), (noise, correlation), top, axis = CASES[case]
    rng = np.random.default_rng(seed)
    commands = np.zeros((1200, 2))
    commands[:, axis] = script(60.0, top)
    one = (delay, 1.0, slew, slew, lag)
    drive = drive_of(rng, commands, AXES, np.array([*one, *one, limit, limit]), (noise, noise), correlation)
    began = time.process_time()
    found = fit_axis(drive, axis)
    spent = time.process_time() - began
    problem = axis_problem(drive, axis)
    x = problem.parameters(found)
    errors, _ = problem.at(x)
    rho = float(correlations(errors[None])[0])
    count = len(errors) * (1.0 - rho) / (1.0 + rho)
    # in units of the noise: squares then sum up to the count
    share = np.sqrt(count / float(errors @ errors))
    problem = dataclasses.replace(problem, weights=np.full(len(errors), share), _last=None)
    ends = [problem.interval(x, count, i, count) for i in range(5)]
    true, values = np.array([delay, 1.0, limit, slew, lag]), found[[0, 1, 2, 3, 5]]
    inside = np.array([low <= value <= high for value, (low, high) in zip(true, ends, strict=True)])
    return np.where(np.arange(5) == 0, values - true, values / true - 1.0), inside, spent


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
    kept = rng.random(len(speeds)) > 0.05
    kept[:40] = True
    return Drive(
        drive.command_times, drive.commands, times[kept], speeds[kept], drive.starts[kept], drive.counted[kept]
    )


@click.command(cls=OneLineErrors)
@click.option("--logs", type=click.IntRange(1, 10_000), default=200, show_default=True, help="Of each case.")
@click.option("--seed", type=SEED, default=0, show_default=True)
def main(logs: int, seed: int) -> None:
    """Measures coverage, bias and spread of estimates, what is not excited, and a stand-in for a real log."""
    print("| case | covered: d, g, V, A, tau | bias: ms, % ... | sd: ms, % ... | CPU s a fit |")
    print("|---|---|---|---|---|")
    shares = []
    for case in CASES:
        errors, inside, spent = map(np.array, zip(*(covered(case, seed + k) for k in range(logs)), strict=True))
        scale = np.array([1e3, 100.0, 100.0, 100.0, 100.0])
        shares.append(inside.mean())
        cells = [" ".join(f"{each:.2f}" for each in row)
                 for row in (inside.mean(axis=0), scale * errors.mean(axis=0), scale * errors.std(axis=0))]  # fmt: skip
        print(f"| {case} | {' | '.join(cells)} | {np.median(spent):.2f} |", flush=True)
    print(f"covered over all: {np.mean(shares):.3f}")
    for excitation in ("half speed", "first seconds", "small steps", "slow sine"):
        rows = []
        for k in range(10):
            drive = poor(np.random.default_rng(seed + k), excitation)
            rows.append([each.name for each in intervals(drive, fit(drive)).estimates if not each.seen])
        always = [name for name in rows[0] if all(name in row for row in rows) and not name.endswith("_w")]
        print(f"{excitation}: a bound in 10 of 10 logs: {', '.join(always)}", flush=True)
    for k in range(6):
        rng = np.random.default_rng(seed + k // 2)
        drive = skid_steer(rng)
        if k % 2:
            drive = spoiled(rng, drive)
        began = time.process_time()
        found = intervals(drive, fit(drive, half_track=0.3))
        seconds = time.process_time() - began
        tested = held_out(drive, 0.6, 0.3)
        assert tested is not None
        told = ", ".join(f"{model:.3f} (ideal {ideal:.3f})" for model, ideal in zip(*tested, strict=True))
        kind = "skid steer, spoiled" if k % 2 else "skid steer"
        print(f"{kind} {k // 2}: {SATURATIONS[found.saturation]}, held-out RMS {told}, {seconds:.1f} CPU s", flush=True)


if __name__ == "__main__":
    main()
