"""What a log must hold before anything is fitted to it: enough motion, whole, by one clock, in SI units."""

import dataclasses

import numpy as np

from wayfield.bridges.identify.estimate import MOST_WRONG, commanded
from wayfield.bridges.identify.recording import Log
from wayfield.bridges.identify.response import Drive, Flags, Floats, held
from wayfield.bridges.identify.sampling import resolution
from wayfield.system.checks import shown

FASTEST = (30.0, 30.0)  # m/s and rad/s, of a wheeled robot
LEAST_MOTION = 20.0  # s
MOVING = 0.05  # share of the largest speed, from which on a base moves
LONGEST_GAP = 0.5  # s, beyond which the response is cut
REFUSED_GAP = 1.0  # s, beyond which a log is refused
CLOSED_GAP = 4.0  # s, that are left of a longer gap: what is cut out costs nothing
ROUNDED = 0.2  # share of messages with the stamp of the one before, from which on stamps are rounded
SCALES = ((1e3, "ms"), (1e6, "us"), (1e9, "ns"))  # a second in other units
SLOWEST = 5.0  # Hz, of odometry
MOST_JITTER = 0.05  # s, of commands
SETTLING = 1.0  # s after a cut that do not count: the state there is not known
EARLIEST = -0.06  # s, of the delay at which commands and odometry agree best
AGREES, UNRELATED = 0.5, 0.3  # correlation from which on they agree, or below which they have nothing in common
OTHER_UNITS = 20.0  # ratio of odometry to commands that no gain explains
REST = 3.0  # s after a command of 0, from which on a base stands
LEAST_STILL = 20  # messages of odometry there
COARSE = 0.1  # of the largest speed: a rounding that bends more than the intervals hold
OFFSET = 0.03  # of the largest speed, which is no noise there
FASTER, SLACK = 3.0, 1.0  # times the fastest command, and m/s or rad/s more, beyond which a few messages are wrong
MOST_WILD = 0.1  # share of the messages that may be; more are in other units
BLANK = 0.2  # share of the largest speed, of messages between which one of 0 is none of the base's
HUNG = 3.0  # s, for which odometry that moves does not repeat itself to the last digit
APART, NOTICED = 0.75, 1.0  # share of its largest values, and s, by and for which odometry then is off its commands
TWICE = 0.9  # share of the messages with one stamp that are equal where each was recorded twice
SKEWED = 0.1  # s, of stamps against arrivals, beyond which a delay is not the base's
UNITS = ("m/s", "rad/s")
NAMES = ("forward speed", "yaw rate")


@dataclasses.dataclass(frozen=True)
class Checked:
    """A drive that can be fitted, and what a reader of the result should know."""

    drive: Drive
    warnings: tuple[str, ...]
    moving: float  # s of motion that counts


def check(log: Log, cut: bool = False) -> Checked:
    """Returns the drive of a log.

    Args:
        log: what was recorded.
        cut: whether a log with long gaps is fitted by its pieces.

    Raises:
        ValueError: in one line, with what is missing or wrong.
    """
    warnings: list[str] = []
    _check_clock("commands", log.command_times)
    _check_clock("odometry", log.times)
    _check_seconds(log.times)
    _check_units("commands", log.commands, 0.0)
    _check_units("odometry", log.speeds, MOST_WRONG)
    if abs(log.skew) > SKEWED:
        warnings.append(
            f"commands arrive {abs(log.skew):.2f} s {'later' if log.skew > 0.0 else 'sooner'} after their stamps than "
            "odometry does: clocks of two computers, or a slow network? The delays contain it; compare --stamps arrival"
        )
    odometry, lines = _sound(log)
    warnings += lines
    commands = log.command_times, log.commands
    again = _again(*odometry)
    if again.any() and again.sum() >= TWICE * (np.diff(odometry[0]) == 0.0).sum():
        warnings.append(f"{again.sum()} messages of odometry repeat the one before, its stamp too, and are left out")
        commands, odometry = ((times[~of], values[~of]) for times, values, of in
                              ((*commands, _again(*commands)), (*odometry, again)))  # fmt: skip
    hung = _hung(commands, *odometry)
    if hung.any() and not hung.all():
        first = int(hung.argmax())
        said = (
            f"odometry repeats {shown(odometry[1][first].tolist())} for {hung.sum()} messages, the first at "
            f"{odometry[0][first]:.1f} s, while the base is commanded to move"
        )
        if not cut:
            raise ValueError(f"{said}: was it switched off, or its driver hung? Leave them out with --cut")
        warnings.append(f"{said}; they are left out")
        odometry = odometry[0][~hung], odometry[1][~hung]
    step = max(_rounding(commands[0]), _rounding(odometry[0]))
    if step:
        warnings.append(f"stamps are rounded to {step:.3g} s: messages with one stamp are spread over it")
        commands, odometry = (_spread(commands[0], step), commands[1]), (_spread(odometry[0], step), odometry[1])
    commands, odometry = _once(*commands), _once(*odometry)
    within = odometry[0] >= commands[0][0]
    if within.sum() < 20 or commands[0][0] > odometry[0][-1] or commands[0][-1] < odometry[0][0]:
        raise ValueError(
            f"commands are from {commands[0][0]:.1f} to {commands[0][-1]:.1f} s, odometry from {odometry[0][0]:.1f} to "
            f"{odometry[0][-1]:.1f} s: they must overlap; are their stamps of different clocks?"
        )
    times, speeds = odometry[0][within], odometry[1][within]
    rate = 1.0 / float(np.median(np.diff(times)))
    if rate < SLOWEST:
        raise ValueError(f"odometry comes at {rate:.2g} Hz; it must come at {SLOWEST:g} Hz or faster")
    if not np.abs(commands[1]).max() > 0.0:
        raise ValueError("commands are all zero: drive the base, with steps of both speeds")
    tops = np.maximum(np.quantile(np.abs(speeds), 0.98, axis=0), (0.01, 0.02))  # without messages that are wrong
    moves = (np.abs(speeds) > MOVING * tops).any(axis=1)
    if not moves.any() or (np.abs(speeds).max(axis=0) < (0.005, 0.01)).all():
        raise ValueError("the base never moves by its odometry: drive it, with steps of both speeds")
    drive, gaps = _cut(commands, times, speeds, moves)
    drive = _closed(drive)
    longest = [each for each in gaps if each[1] > REFUSED_GAP]
    if longest and not cut:
        named = ", ".join(f"{length:.3g} s in {what} at {at:.1f} s" for at, length, what in longest[:5])
        raise ValueError(
            f"the log has gaps: {named}; what the base did is not known: record again, or fit the pieces with --cut"
        )
    if gaps:
        warnings.append(f"{len(gaps)} gaps of more than {LONGEST_GAP} s were cut out, the longest of "
                        f"{max(each[1] for each in gaps):.3g} s")  # fmt: skip
    moving = float((moves & drive.counted).sum()) / rate
    if moving < LEAST_MOTION:
        raise ValueError(f"the base moves for {moving:.1f} s; it must move for {LEAST_MOTION:g} s or more")
    intervals = np.diff(commands[0])
    jitter = float(np.quantile(np.abs(intervals - np.median(intervals)), 0.95)) if len(intervals) else 0.0
    if jitter > MOST_JITTER:
        warnings.append(f"commands come irregularly: 5 % of their intervals are {1e3 * jitter:.0f} ms or more off")
    warnings += _check_following(drive)
    warnings += _offsets(drive, tops)
    for axis, values in enumerate(speeds.T):
        if (step := resolution(values)) > COARSE * tops[axis]:
            warnings.append(f"the {NAMES[axis]} of odometry is rounded to {step:.3g} {UNITS[axis]}: record it finer, "
                            "answers may be farther off than their intervals say")  # fmt: skip
    return Checked(drive, tuple(warnings), moving)


def _sound(log: Log) -> tuple[tuple[Floats, Floats], list[str]]:
    """Returns times and speeds of odometry without what no base does, and a line for each kind that is left out."""
    lines: list[str] = []
    sane = _sane(log)
    if not sane.all():
        lines.append(
            f"{(~sane).sum()} messages of odometry are faster than what was commanded explains, and are left out"
        )
    times, speeds = log.times[sane], log.speeds[sane]
    blank = _blank(speeds)
    if blank.any():
        lines.append(f"{blank.sum()} messages of odometry are 0 between two that move, and are left out")
    return (times[~blank], speeds[~blank]), lines


def _check_clock(what: str, times: Floats) -> None:
    backward = np.flatnonzero(np.diff(times) < 0.0)
    if len(backward):
        at = int(backward[0])
        raise ValueError(
            f"stamps of {what} run backward {len(backward)} times, first {times[at]:.3f} to {times[at + 1]:.3f} s; "
            "they must ascend: try --stamps arrival, or sort the table"
        )


def _check_seconds(times: Floats) -> None:
    """Raises ValueError where odometry would come at a usual rate if its stamps were in other units."""
    steps = np.diff(times)
    step = float(np.median(steps[steps > 0.0])) if (steps > 0.0).any() else 1.0
    for scale, unit in SCALES:
        if 0.9 * scale > step > 0.001 * scale and step > 1.0:
            raise ValueError(f"odometry comes every {step:.4g} s; are its stamps in {unit}? Divide them by {scale:g}")


def _sane(log: Log) -> Flags:
    """Returns which messages of odometry are not a few, here and there, far faster than all that was commanded."""
    speeds = np.abs(log.speeds)
    wild = (speeds > FASTER * np.abs(log.commands).max(axis=0) + SLACK).any(axis=1)
    sane: Flags = np.all(speeds <= FASTEST, axis=1)
    longest, left = (np.diff(each).max(initial=0.0) for each in (log.times, log.times[~wild]))
    return sane & ~wild if wild.mean() <= MOST_WILD and left <= max(longest, LONGEST_GAP) else sane


def _blank(speeds: Floats) -> Flags:
    """Returns which messages are 0 between two that move the same way: no base stops for a message or two."""
    zero = (speeds == 0.0).all(axis=1)
    moves = np.flatnonzero(~zero)
    if len(moves) < 2:
        return np.zeros_like(zero)
    last = np.clip(np.searchsorted(moves, np.arange(len(zero))), 1, len(moves) - 1)
    before, after = speeds[moves[last - 1]], speeds[moves[last]]
    fast = np.minimum(np.abs(before), np.abs(after)) > BLANK * np.quantile(np.abs(speeds), 0.98, axis=0)
    blank: Flags = zero & (moves[last] - moves[last - 1] <= 3) & ((before * after > 0.0) & fast).any(axis=1)
    return blank


def _again(times: Floats, values: Floats) -> Flags:
    """Returns which messages are the one before once more."""
    return np.append(False, (np.diff(times) == 0.0) & (np.diff(values, axis=0) == 0.0).all(axis=1))


def _hung(commands: tuple[Floats, Floats], times: Floats, speeds: Floats) -> Flags:
    """Returns which messages are those of a time in which odometry says the same and not what is commanded."""
    requested = commands[1][np.maximum(np.searchsorted(commands[0], times, "right") - 1, 0)]
    shares = [each / np.maximum(np.quantile(np.abs(each), 0.98, axis=0), 1e-9) for each in (requested, speeds)]
    off = (np.abs(shares[0] - shares[1]) > APART).any(axis=1)
    run = np.cumsum(np.append(False, (np.diff(speeds, axis=0) != 0.0).any(axis=1)))
    _, first, count = np.unique(run, return_index=True, return_counts=True)
    spans = times[first + count - 1] - times[first]
    hung: Flags = ((spans > HUNG) & (spans * np.bincount(run, off) > NOTICED * count))[run]
    return hung


def _rounding(times: Floats) -> float:
    """Returns to what (s) stamps are rounded so that many messages share one; 0 if few do."""
    steps = np.diff(times)
    if not len(steps) or (steps == 0.0).mean() < ROUNDED or not (steps > 0.0).any():
        return 0.0
    return float(np.quantile(steps[steps > 0.0], 0.1))


def _spread(times: Floats, step: float) -> Floats:
    """Returns times of which those that are equal lie evenly within the step from there on."""
    _, first, count = np.unique(times, return_index=True, return_counts=True)
    place = np.arange(len(times)) - np.repeat(first, count)
    spread: Floats = times + step * (place + 0.5) / np.repeat(count, count)
    return spread


def _once(times: Floats, values: Floats) -> tuple[Floats, Floats]:
    """Returns times and values with the last of each time alone."""
    last = np.append(np.diff(times) > 0.0, True)
    return times[last], np.ascontiguousarray(values[last])


def _check_units(what: str, values: Floats, wrong: float) -> None:
    """Raises ValueError where more than a share of the messages is faster than any base."""
    for axis in range(2):
        fastest = float(np.quantile(np.abs(values[:, axis]), 1.0 - wrong, method="higher"))
        if fastest > FASTEST[axis]:
            raise ValueError(
                f"the {NAMES[axis]} of {what} reaches {fastest:.4g} {UNITS[axis]}; it must be at most "
                f"{FASTEST[axis]:g}: is it in other units?"
            )


def _cut(
    commands: tuple[Floats, Floats], times: Floats, speeds: Floats, moves: Flags
) -> tuple[Drive, list[tuple[float, float, str]]]:
    """Returns the drive cut at gaps, and the gaps: where, how long, of what.

    A gap of commands is one only where the base had something to do: what holds, and when it stops, is not recorded.
    """
    starts = np.zeros(len(times), np.bool_)
    starts[0] = True
    unknown = times < times[0] + SETTLING
    gaps: list[tuple[float, float, str]] = []
    for k in np.flatnonzero(np.diff(times) > LONGEST_GAP):
        gaps.append((float(times[k]), float(times[k + 1] - times[k]), "odometry"))
        starts[k + 1] = True
        unknown |= (times > times[k]) & (times < times[k + 1] + SETTLING)
    ends = np.append(commands[0], times[-1])
    for k in np.flatnonzero(np.diff(ends) > LONGEST_GAP):
        during = (times > ends[k] + LONGEST_GAP) & (times < ends[k + 1])
        if k == len(commands[0]) - 1:  # after the last command
            unknown |= during
            continue
        if not np.any(commands[1][k]) and not (moves & during & (times > ends[k] + 2.0 * SETTLING)).any():
            continue
        gaps.append((float(ends[k]), float(ends[k + 1] - ends[k]), "commands"))
        after = np.searchsorted(times, ends[k + 1])
        starts[after : after + 1] = True
        unknown |= during | ((times >= ends[k + 1]) & (times < ends[k + 1] + SETTLING))
    return Drive(*commands, times, np.ascontiguousarray(speeds), starts, ~unknown), sorted(gaps)


def _closed(drive: Drive) -> Drive:
    """Returns the drive with long gaps of odometry closed to CLOSED_GAP; commands within come when the gap ends."""
    long = np.flatnonzero(np.diff(drive.times) > CLOSED_GAP)
    begins, ends = drive.times[long] + 0.5 * CLOSED_GAP, drive.times[long + 1] - 0.5 * CLOSED_GAP

    def moved(times: Floats) -> Floats:
        shifted = times.copy()
        for begin, end in zip(begins, ends, strict=True):
            shifted -= np.clip(times - begin, 0.0, end - begin)
        return shifted

    commands = _once(moved(drive.command_times), drive.commands)
    return dataclasses.replace(drive, command_times=commands[0], commands=commands[1], times=moved(drive.times))


def _offsets(drive: Drive, tops: Floats) -> list[str]:
    """Returns a line for each speed that odometry has long after its command became 0: no interval holds an offset."""
    offsets = []
    k = np.maximum(np.searchsorted(drive.command_times, drive.times, "right") - 1, 0)
    for axis in range(2):
        zero = drive.commands[:, axis] == 0.0
        begins = zero & ~np.append(False, zero[:-1])
        since = np.maximum.accumulate(np.where(begins, drive.command_times, -np.inf))
        still = drive.speeds[zero[k] & (drive.times - since[k] > REST), axis]
        offset = float(np.median(still)) if len(still) >= LEAST_STILL else 0.0
        if abs(offset) > OFFSET * tops[axis]:
            offsets.append(
                f"odometry says {offset:.3g} {UNITS[axis]} where the {NAMES[axis]} has been commanded to be 0 for "
                f"{REST:g} s: subtract the offset, which the intervals do not hold"
            )
    return offsets


def _check_following(drive: Drive) -> list[str]:
    """Returns a line for each speed that does not follow its commands.

    Raises:
        ValueError: where odometry is ahead of its commands, against them, in other units, or of something else.
    """
    best, lines = [], []
    for axis in commanded(drive):
        values, most = np.unique(drive.speeds[:, axis]), np.abs(drive.commands[:, axis]).max()
        if len(values) <= 2:  # a stuck sensor, or a switch: both ends are taken as clipped, and none is left
            raise ValueError(
                f"the {NAMES[axis]} of odometry is {' or '.join(f'{each:.3g}' for each in values)} {UNITS[axis]} in "
                f"all messages, while up to {most:.3g} is commanded: nothing can be fitted to it; is it measured?"
            )
        lead, highest, lowest, ratio = _agreement(drive, axis)
        best.append(highest)
        if highest < UNRELATED:
            lost = ", and is never below 0 though its commands are: is its sign lost?"
            unsigned = values[0] >= 0.0 > drive.commands[:, axis].min()
            lines.append(
                f"the {NAMES[axis]} of odometry does not follow its commands (correlation {highest:.2f})"
                f"{lost if unsigned else ': its numbers below mean little'}"
            )
        if -lowest > max(AGREES, highest + 0.1):
            raise ValueError(
                f"the {NAMES[axis]} of odometry goes against its commands (correlation {lowest:.2f}): "
                "a sign is the other way round in one of them"
            )
        if highest > AGREES and lead < EARLIEST:
            raise ValueError(
                f"the {NAMES[axis]} of odometry is {-lead:.2f} s ahead of its commands: their stamps are of "
                "different clocks, or the topic is not what drives the base"
            )
        if highest > AGREES and not 1.0 / OTHER_UNITS < ratio < OTHER_UNITS:
            raise ValueError(
                f"the {NAMES[axis]} of odometry is {ratio:.3g} times its commands: one of them is in other units"
            )
    if max(best, default=0.0) < UNRELATED:
        raise ValueError(
            f"odometry does not follow the commands (correlation {max(best, default=0.0):.2f} at best): the base did "
            "not move, the topic is not what drives it, or the axes are swapped"
        )
    return lines


def _agreement(drive: Drive, axis: int) -> tuple[float, float, float, float]:
    """Returns the delay (s) at which command and measured speed correlate best, that correlation, the lowest, a ratio.

    The last is that of speed to command, by least squares at that delay.
    """
    step = 0.02
    grid = np.arange(drive.times[0], drive.times[-1], step)
    commanded = held(drive.command_times, drive.commands[:, axis], grid)
    measured = np.interp(grid, drive.times, drive.speeds[:, axis])
    commanded, measured = commanded - commanded.mean(), measured - measured.mean()
    scale = np.sqrt((commanded**2).sum() * (measured**2).sum())
    if scale <= 0.0:  # what never changes agrees with anything
        return 0.0, 0.0 if commanded.any() else 1.0, 0.0, 1.0
    most = round(1.0 / step)
    shifts = range(-most, most + 1)
    sums = [
        float((commanded[max(-k, 0) : len(grid) - max(k, 0)] * measured[max(k, 0) : len(grid) + min(k, 0)]).sum())
        for k in shifts
    ]
    best = int(np.argmax(sums))
    return float(shifts[best]) * step, sums[best] / scale, min(sums) / scale, sums[best] / float((commanded**2).sum())
