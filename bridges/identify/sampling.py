"""What commands may have done between their records: a log that holds each second one holds a change late.

Half of each change half of an interval earlier is what commands did in the mean, and predicts better where they were
throttled. What is late alike is a longer delay, and leaves no trace. What is late at times bends the other parameters:
a deviation s of the lateness adds s^2 (dv / d delay)^2 to the variance of a residual, and the regression of one on the
other bounds it. By how much they are off is seen where commands are throttled once more (simulation extrapolation).

Source: Cook and Stefanski, Journal of the American Statistical Association 89, 1994.
"""

import dataclasses
import math

import numpy as np
from numpy.typing import NDArray

from wayfield.bridges.identify.response import Drive, Floats

LONGEST_INTERVAL = 0.5  # s, between commands that follow each other; beyond, one was held
EVEN = math.sqrt(3.0)  # the mean of what is even from 0 to anything, over its deviation
LEAST = 0.001  # s, of a lateness
QUANTILE = 1.645  # deviations, of 95 % on one side


def lateness(drive: Drive) -> float:
    """Returns by how much (s) a change of the commands may have come before its record, in the mean."""
    changes = np.flatnonzero(np.any(np.diff(drive.commands, axis=0) != 0.0, axis=1))
    gaps = np.diff(drive.command_times)[changes]
    return 0.5 * min(float(np.quantile(gaps, 0.75)), LONGEST_INTERVAL) if len(gaps) else 0.0


def traced(most: float, left: Floats, slopes: Floats, blocks: NDArray[np.int64]) -> float:
    """Returns the lateness (s) of which residuals bear a trace: the most if they do, or what they leave possible.

    Args:
        most: the lateness that the interval between commands allows.
        left: (2, k) residuals of each axis over their noise.
        slopes: (2, k) derivatives of the same to the delay.
        blocks: (k,) the block of the drive to which each belongs; blocks are taken as independent.
    """
    x, y = (each**2 - (each**2).mean(axis=1, keepdims=True) for each in (slopes, left))
    size = max(float((x * x).sum()), 1e-300)
    variance = float((x * y).sum()) / size
    scores = np.bincount(blocks, (x * (y - variance * x)).sum(axis=0))
    error = QUANTILE * math.sqrt(float(scores @ scores)) / size
    possible = most if variance > error else EVEN * math.sqrt(max(variance, 0.0) + error)
    return min(most, max(possible, LEAST))


def earlier(drive: Drive, share: float, span: float) -> Drive:
    """Returns the drive with a share of each change a span of time (s) before its record, or most of the interval."""
    times = drive.command_times[1:] - np.minimum(span, 0.9 * np.diff(drive.command_times))
    between = drive.commands[:-1] + share * np.diff(drive.commands, axis=0)
    every = np.concatenate([drive.command_times, times])
    order = np.argsort(every, kind="stable")
    commands = np.concatenate([drive.commands, between])[order]
    return dataclasses.replace(drive, command_times=every[order], commands=commands)


def throttled(drive: Drive, late: float) -> list[Drive]:
    """Returns the drive with commands at the nearest ticks of a clock, the last of each, at two phases of its ticks.

    They are four times the lateness (s) apart: twice the interval between commands that are as late in the mean.
    """
    ticks = drive.command_times / (4.0 * late)
    drives = []
    for phase in (0.0, 0.5):
        times = (np.round(ticks + phase) - phase) * 4.0 * late
        last = np.append(np.diff(times) > 0.0, True)
        drives.append(dataclasses.replace(drive, command_times=times[last], commands=drive.commands[last]))
    return drives


def rounded(drive: Drive, response: Floats, noise: Floats) -> list[Drive]:
    """Returns the drive with a response in place of its odometry, rounded as that is, at two phases; none if finer.

    Args:
        response: (n, 2) fitted speeds, of which odometry is a rounding; what is fitted to them again is off as it is.
        noise: (2,) standard deviation of the residuals, under which a step leaves no trace.
    """
    steps = np.array([resolution(each) for each in drive.speeds.T])
    steps[steps < noise] = 0.0
    if not steps.any():
        return []
    wide = np.where(steps > 0.0, steps, 1.0)
    rounded_speeds = [
        np.where(steps > 0.0, (np.round(response / wide + phase) - phase) * wide, response) for phase in (0.0, 0.5)
    ]
    return [dataclasses.replace(drive, speeds=each) for each in rounded_speeds]


def resolution(values: Floats) -> float:
    """Returns the least difference between values, 0 of less than three: the step to which they are rounded."""
    apart = np.diff(np.unique(np.round(values, 9)))
    return float(apart.min()) if len(apart) > 1 else 0.0
