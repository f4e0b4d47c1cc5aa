"""The formulas of the tables, written a second time from their definitions.

Nothing here is shared with the modules that make the tables: plain sums and sorting, tails of the binomial distribution
instead of quantiles of the beta distribution, another bootstrap in place of both the first and the t-test.
"""

import bisect
import math
import random
from collections.abc import Callable, Mapping, Sequence

Row = Mapping[str, str]
Numbers = Sequence[float]


def value(row: Row, metric: str) -> float:
    """Returns the number of a cell; NaN where it is empty or missing."""
    return float(row.get(metric) or math.nan)


def won(row: Row) -> bool:
    """Returns whether the episode was a success."""
    return value(row, "success") == 1.0


def counted(rows: Sequence[Row], metric: str) -> list[float]:
    """Returns the metric of each run, that of a failure being what its row says that a failure costs."""
    return [value(row, metric) if won(row) else value(row, "failure_cost") for row in rows]


def of_successes(rows: Sequence[Row], metric: str) -> list[float]:
    """Returns the metric of each success."""
    return [value(row, metric) for row in rows if won(row)]


def every(rows: Sequence[Row], metric: str) -> list[float]:
    """Returns the metric of each run that has it."""
    return [value(row, metric) for row in rows if not math.isnan(value(row, metric))]


def failed(rows: Sequence[Row], metric: str) -> list[float]:
    """Returns whether each run failed in a way, nothing where a row does not tell; the clock ends the rest."""
    found = []
    for row in rows:
        other = value(row, "collision" if row["contest"] != "path-following" else "left_corridor")
        told = 1.0 - other if metric == "timeout" and not row.get(metric) else value(row, metric)
        found.append(0.0 if won(row) else told)
    return [] if any(map(math.isnan, found)) else found


def average(numbers: Numbers) -> float:
    """Returns the mean; NaN of nothing."""
    return math.fsum(numbers) / len(numbers) if numbers else math.nan


def middle_half(numbers: Numbers) -> float:
    """Returns the mean of what is left when a quarter, rounded down, is cut off at either end."""
    cut = len(numbers) // 4
    return average(sorted(numbers)[cut : len(numbers) - cut])


def largest(numbers: Numbers) -> float:
    """Returns the largest; NaN of nothing."""
    return max(numbers) if numbers else math.nan


# header of the standings: which runs, which metric, how reduced, to which unit
Meaning = tuple[Callable[[Sequence[Row], str], list[float]], str, Callable[[Numbers], float], float]
MEANINGS: Mapping[str, Meaning] = {
    "success (%)": (every, "success", average, 100.0),
    "RMS error (m)": (counted, "cross_track_rms", average, 1.0),
    "RMS error, IQM (m)": (counted, "cross_track_rms", middle_half, 1.0),
    "acquisition (s)": (of_successes, "acquisition_time", average, 1.0),
    "area (mm s)": (of_successes, "acquisition_area", average, 1000.0),
    "tracking (m)": (counted, "tracking_rms", average, 1.0),
    "worst (m)": (counted, "cross_track_max", largest, 1.0),
    "p95 (m)": (counted, "cross_track_p95", average, 1.0),
    "RMS over time (m)": (counted, "cross_track_rms_time", average, 1.0),
    "mean speed (m/s)": (of_successes, "mean_speed", average, 1.0),
    "time (s)": (of_successes, "time", average, 1.0),
    "time of successes (s)": (of_successes, "time", average, 1.0),
    "imputed (s)": (counted, "time", average, 1.0),
    "LDLJ": (every, "ldlj", average, 1.0),
    "effort (rad²/s)": (of_successes, "effort", average, 1.0),
    "saturated (%)": (every, "saturated_share", average, 100.0),
    "faults": (every, "faults", average, 1.0),
    "collision (%)": (failed, "collision", average, 100.0),
    "timeout (%)": (failed, "timeout", average, 100.0),
    "left corridor (%)": (failed, "left_corridor", average, 100.0),
    "SPL": (every, "spl", average, 1.0),
    "SCT": (every, "sct", average, 1.0),
    "BARN": (every, "barn_score", average, 1.0),
    "least clearance (m)": (every, "min_clearance", average, 1.0),
    "mean (m)": (every, "mean_clearance", average, 1.0),
    "under 0.1 m (%)": (every, "near_share", average, 100.0),
    # of docks: the last moment of every run, and how often a success turned back
    "position error (mm)": (every, "final_position_error", average, 1000.0),
    "heading error (mrad)": (every, "final_heading_error", average, 1000.0),
    "changes of direction": (of_successes, "direction_changes", average, 1.0),
    # of public benchmarks
    "score (2, 8)": (every, "barn_score", average, 1.0),
    "score 2022 (4, 8)": (every, "barn_score_2022", average, 1.0),
    "mean speed of successes (m/s)": (of_successes, "mean_speed", average, 1.0),
    "safety: least clearance (m)": (every, "min_clearance", average, 1.0),
    "safety: under 0.1 m (% of time)": (every, "near_share", average, 100.0),
    "motion efficiency (s)": (of_successes, "time", average, 1.0),
    "velocity smoothness (m/s²)": (every, "velocity_smoothness", average, 1.0),
    "path of successes (m)": (of_successes, "path_length", average, 1.0),
}


def binomial_ends(successes: int, trials: int) -> tuple[float, float]:
    """Returns the shares under which so many successes, or more, or fewer, have a chance of 2.5 % each."""

    def chance(share: float, k: int) -> float:
        if share in (0.0, 1.0):
            return float(k == trials * share)
        # by logarithms: of ten thousand trials, what stands before is beyond any float
        ways = math.lgamma(trials + 1) - math.lgamma(k + 1) - math.lgamma(trials - k + 1)
        return math.exp(ways + k * math.log(share) + (trials - k) * math.log1p(-share))

    def tail(share: float, counts: range) -> float:
        return math.fsum(chance(share, k) for k in counts)

    def solved(excess: Callable[[float], float]) -> float:
        grid = range(1_000_001)
        return bisect.bisect_left(grid, 0.0, key=lambda k: excess(k / 1e6)) / 1e6

    low = 0.0 if successes == 0 else solved(lambda share: tail(share, range(successes, trials + 1)) - 0.025)
    high = 1.0 if successes == trials else solved(lambda share: 0.025 - tail(share, range(successes + 1)))
    return low, high


def resampled(
    strata: Sequence[Numbers], reduce: Callable[[Numbers], float], times: int = 400, seed: int = 1
) -> tuple[float, float]:
    """Returns roughly the 95 % ends of a statistic of one policy: what one resample in forty is below, or above.

    Each stratum draws one number fewer than it has, which gives the spread of the mean without a correction (McCarthy
    and Snowden, Vital and Health Statistics 2-95, 1985). No standard deviation: of a middle half that a few failures
    more would reach, the rarest resamples are a hundred times as far away as all the others.
    """
    rng = random.Random(seed)
    drawn = sorted(
        reduce([each for stratum in strata for each in rng.choices(stratum, k=len(stratum) - 1)]) for _ in range(times)
    )
    return drawn[times // 40], drawn[-1 - times // 40]


def counted_ends(strata: Sequence[Sequence[tuple[float, bool]]], failure: float) -> tuple[float, float]:
    """Returns roughly the 95 % ends of a mean of numbers, each with whether its run succeeded, where failures count.

    The ends that the successes have by themselves, `resampled`, and those of the share of failures, `binomial_ends`,
    each as far from the mean as it moves that; the two distances on either side add by their squares.

    Args:
        failure: what a failure counts as where there is none.
    """
    runs = [run for stratum in strata for run in stratum]
    good, bad = ([number for number, success in runs if success is which] for which in (True, False))
    typical = average(good)
    cost = (average(bad) if bad else failure) - typical
    share = len(bad) / len(runs)
    ends = sorted(cost * (end - share) for end in binomial_ends(len(bad), len(runs)))
    apart = [[number - (typical if success else typical + cost) for number, success in stratum] for stratum in strata]
    below, above = resampled(apart, average)
    middle = average([number for number, _ in runs])
    return middle - math.hypot(below, ends[0]), middle + math.hypot(above, ends[1])


def stepped_down(ps: Sequence[float]) -> list[float]:
    """Returns each p as Holm's method has it: from the least on, times those that are left, never less than before."""
    there = sorted((p, k) for k, p in enumerate(ps) if not math.isnan(p))
    found, least = [math.nan] * len(ps), 0.0
    for done, (p, k) in enumerate(there):
        least = max(least, min(1.0, p * (len(there) - done)))
        found[k] = least
    return found


def verdict(line: Mapping[str, str], p_success: float, p_cost: float) -> str:
    """Returns what is to be said of a line of pairs, by its corrected p of success and of cost."""
    if math.isnan(p_success):
        return "too few scenarios"
    low, high = float(line["from"]), float(line["to"])
    side = (low > 0.0) - (high < 0.0)
    many = f"{'more' if float(line['success (points)']) > 0.0 else 'fewer'} successes"
    if side and p_success < 0.05:
        return many
    alike = not side and low >= -1.0 and max(high, float(line["exact limit (points)"])) <= 1.0
    success = "equivalent" if alike else "tie"
    timed, cost, less, sure = line["unit"] == "s", "tie", 0, True
    speeds = [float(line[each].strip("-") or "nan") for each in ("speed (m/s)", "its speed (m/s)")]
    apart = line["asked (m/s)"] != "" and min(speeds) < 0.97 * max(speeds)
    if line["cost from"]:
        ends = float(line["cost from"]), float(line["cost to"])
        if max(map(abs, ends)) <= 0.05 * float(line["lesser cost"]):
            cost = "tie" if apart else "equivalent"
        elif ends[0] * ends[1] > 0.0:
            less, sure = 1 if ends[1] < 0.0 else -1, p_cost < 0.05
    if side and (side != less or not sure):
        return f"{many} (not significant)"
    if not less:
        return cost if cost == success else f"{success} in success; {cost} in {'time' if timed else 'error'}"
    words = ("faster", "slower") if timed else ("lower error", "higher error")
    best, worst = speeds[::less]
    told = f" at a {'lower' if less > 0 else 'higher'} speed" if apart and best < worst else ""
    return f"{success} in success; {words[less < 0]}{told}{'' if sure else ' (not significant)'}"
