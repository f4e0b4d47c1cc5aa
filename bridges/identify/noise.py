"""Noise of a log's sensors, and the rates of its topics."""

import dataclasses

import numpy as np

from wayfield.bridges.identify.estimate import Fit
from wayfield.bridges.identify.recording import Log
from wayfield.bridges.identify.response import Drive, Floats, held

REST = 1.5  # s after the last command other than zero, from which on a base rests
LEAST = 10  # samples of which a deviation is taken


@dataclasses.dataclass(frozen=True)
class Noise:
    """Standard deviations; NaN where the log does not say."""

    resting: tuple[float, float]  # m/s and rad/s, of odometry's twist
    moving: tuple[float, float]  # of what the fit leaves
    correlation: tuple[float, float]  # of that, from one sample to the next
    scan: float  # m, of a beam
    dropouts: float  # share of beams without a return


@dataclasses.dataclass(frozen=True)
class Rate:
    """How often a topic's messages come."""

    what: str
    count: int
    hertz: float
    jitter: float  # s, standard deviation of the intervals
    longest: float  # s, between two messages


def measure(log: Log, fit: Fit) -> Noise:
    """Returns the noise of odometry, at rest and in motion, and of scans at rest."""
    drive = fit.drive
    rest = resting(drive, drive.times)
    deviations = drive.speeds[rest].std(axis=0) if rest.sum() >= LEAST else np.full(2, np.nan)
    scan, dropouts = np.nan, np.nan
    if len(log.scans):
        seen = np.isfinite(log.scans) & (log.scans > 0.0)
        dropouts = float(1.0 - seen.mean())
        still = log.scans[resting(drive, log.scan_times)]
        if len(still) >= LEAST:
            beams = np.where(np.isfinite(still) & (still > 0.0), still, np.nan)
            whole = beams[:, np.isfinite(beams).sum(axis=0) >= LEAST]
            scan = float(np.median(np.nanstd(whole, axis=0))) if whole.shape[1] else np.nan
    left = fit.residuals()
    again = np.clip((left[:, 1:] * left[:, :-1]).sum(axis=1) / np.maximum((left**2).sum(axis=1), 1e-300), 0.0, 1.0)
    return Noise(
        (float(deviations[0]), float(deviations[1])),
        (float(fit.noise[0]), float(fit.noise[1])),
        (float(again[0]), float(again[1])),
        scan,
        dropouts,
    )


def resting(drive: Drive, times: Floats) -> np.ndarray[tuple[int], np.dtype[np.bool_]]:
    """Returns at which times (n,) the command has been zero for REST."""
    commanded = np.any(drive.commands != 0.0, axis=1)
    last = np.maximum.accumulate(np.where(commanded, np.append(drive.command_times[1:], np.inf), -np.inf))
    rest: np.ndarray[tuple[int], np.dtype[np.bool_]] = (times >= drive.command_times[0]) & (
        times - held(drive.command_times, last, times) > REST
    )
    return rest


def rates(log: Log) -> list[Rate]:
    """Returns how often commands, odometry, truth and scans come."""
    rates_seen = []
    for what, times in (
        ("commands", log.command_times),
        ("odometry", log.times),
        ("truth", log.truth_times),
        ("scans", log.scan_times),
    ):
        if len(times) > 2:
            gaps = np.diff(times)
            rates_seen.append(
                Rate(what, len(times), 1.0 / float(np.median(gaps)), float(gaps.std()), float(gaps.max()))
            )
    return rates_seen
