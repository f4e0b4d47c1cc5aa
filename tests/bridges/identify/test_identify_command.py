"""`wayfield identify` from files of every kind to a sheet that is read; what cannot say is refused in one line."""

import dataclasses
import functools
import importlib.util
import json
import math
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from click.testing import CliRunner, Result
from identification import drive_of, script
from numpy.typing import NDArray

from wayfield.bridges.identify.checks import check
from wayfield.bridges.identify.command import clipped, main
from wayfield.bridges.identify.estimate import Fit, fit, intervals
from wayfield.bridges.identify.noise import measure, rates
from wayfield.bridges.identify.odometry import odometry_errors
from wayfield.bridges.identify.prediction import Prediction
from wayfield.bridges.identify.recording import Log, Topics, read_log
from wayfield.bridges.identify.response import AXES, PAIR, Drive
from wayfield.bridges.identify.sheet import doubts, identified
from wayfield.envs.robots import ROBOTS, read_robot
from wayfield.envs.robots.intervals import Interval
from wayfield.system.extras import installs

TURTLEBOT = np.array([0.12, 1.0, 0.7, 0.7, 0.18, 0.16, 1.0, 3.0, 3.0, 0.18, 0.2, 2.4])


def driven(seed: int = 0, seconds: float = 60.0) -> Drive:
    """Returns a drive of a small base: forward, then turning, then both."""
    rng = np.random.default_rng(seed)
    part = script(seconds / 2.0, 1.0)
    idle = np.zeros_like(part)
    commands = np.stack([0.2 * np.concatenate([part, idle]), 2.4 * np.concatenate([idle, part])], axis=1)
    return drive_of(rng, commands, AXES, TURTLEBOT, (0.003, 0.03), 0.3)


def log_of(drive: Drive, every: NDArray[np.int64] | slice = slice(None)) -> Log:
    return Log("drive.csv", "", "table", drive.command_times[every], drive.commands[every], drive.times[every],
               drive.speeds[every])  # fmt: skip


@functools.cache
def plain() -> Fit:
    """Returns what is found in the drive as it is."""
    return fit(check(log_of(driven())).drive)


def table(drive: Drive) -> str:
    """Returns the drive as a table, a row for each message."""
    rows = [
        (t, f"{t:.6f},{a!r},{b!r},,")
        for t, (a, b) in zip(drive.command_times.tolist(), drive.commands.tolist(), strict=True)
    ]
    rows += [
        (t, f"{t:.6f},,,{a!r},{b!r}") for t, (a, b) in zip(drive.times.tolist(), drive.speeds.tolist(), strict=True)
    ]
    return "\n".join(["t,v_cmd,w_cmd,v,w", *(row for _, row in sorted(rows))]) + "\n"


def identify(*words: str | Path) -> Result:
    return CliRunner().invoke(main, [*map(str, words)])


@pytest.fixture(scope="module")
def good(tmp_path_factory: pytest.TempPathFactory) -> Path:
    file = tmp_path_factory.mktemp("drive") / "drive.csv"
    file.write_text(table(driven()))
    return file


def test_the_command_writes_a_sheet_that_is_read_and_a_page(good: Path, tmp_path: Path) -> None:
    sheet, page = tmp_path / "mine.json", tmp_path / "report.html"
    words = [sys.executable, "-m", "wayfield.command", "identify", good, "--robot", "turtlebot3"]
    ended = subprocess.run([*words, "--out", sheet, "--report", page], capture_output=True, text=True, check=False)
    assert ended.returncode == 0, ended.stderr
    robot = read_robot(str(sheet))
    assert robot.name == "mine"
    for found, true in ((robot.delay, (0.12, 0.16)), (robot.lag, (0.18, 0.18))):
        np.testing.assert_allclose(found, true, rtol=0.15)
    assert robot.acceleration == pytest.approx(0.7, rel=0.05)
    assert robot.yaw_acceleration == pytest.approx(3.0, rel=0.05)
    assert robot.response == "continuous"
    for field in ("delay", "lag", "acceleration"):
        source = robot.sources[field]
        assert isinstance(source, Interval)
        assert "SHA-256" in source.source
        assert "wayfield identify" in source.source
    # what a log cannot say is the base's
    assert (robot.hull_radius, robot.mass) == (ROBOTS["turtlebot3"].hull_radius, ROBOTS["turtlebot3"].mass)
    assert "What to drive next" in page.read_text() or "not observable" in page.read_text()
    assert sorted(each.name for each in tmp_path.iterdir()) == [
        "mine.json", "report.html", "report_residuals.png", "report_response.png"
    ]  # fmt: skip


def changed(drive: Drive, **columns: Any) -> Drive:
    """Returns the drive with other arrays."""
    return dataclasses.replace(drive, **columns)


def bad() -> Iterator[tuple[str, str, str]]:
    """Yields a name, the text of a table, and a part of the line with which it is refused."""
    drive = driven()
    yield "short", table(driven(seconds=12.0)), "must move for 20 s or more"
    yield "still", table(changed(drive, speeds=0.0 * drive.speeds)), "never moves"
    yield "millimetres", table(changed(drive, speeds=drive.speeds * [1500.0, 1.0])), "it must be at most 30"
    slow = changed(drive, speeds=drive.speeds * [1.0, 0.15], commands=drive.commands * [1.0, 0.15 * 180.0 / math.pi])
    for scale, unit in ((1e3, "ms"), (1e9, "ns")):
        other = changed(drive, times=scale * drive.times, command_times=scale * drive.command_times)
        yield f"stamps in {unit}", table(other), f"are its stamps in {unit}?"
    yield "degrees", table(changed(drive, speeds=57.3 * drive.speeds, commands=57.3 * drive.commands)), "at most 30"
    yield "slow degrees", table(slow), "one of them is in other units"
    yield "a sign", table(changed(drive, speeds=drive.speeds * [1.0, -1.0])), "yaw rate of odometry goes against"
    yield "swapped", table(changed(drive, speeds=drive.speeds[:, ::-1])), "does not follow the commands"
    gap = np.where(drive.times > 20.0, drive.times + 14.7, drive.times)
    later = np.where(drive.command_times > 20.0, drive.command_times + 14.7, drive.command_times)
    yield "gap", table(changed(drive, times=gap, command_times=later)), "gaps: 14.7 s"
    held = np.where((drive.times > 30.0)[:, None], drive.speeds[400], drive.speeds)
    yield "hung", table(changed(drive, speeds=held)), "was it switched off"
    few = slice(None, None, 6)
    stuck = (
        np.where([True, False], 0.07, drive.speeds),
        np.where([False, True], 2.0 * (drive.speeds > 1.0), drive.speeds),
    )
    yield "stuck", table(changed(drive, speeds=stuck[0])), "forward speed of odometry is 0.07 m/s in all messages"
    yield "a switch", table(changed(drive, speeds=stuck[1])), "yaw rate of odometry is 0 or 2 rad/s in all messages"
    yield "slow", table(changed(drive, times=drive.times[few], speeds=drive.speeds[few])), "5 Hz or faster"
    yield "early", table(changed(drive, command_times=drive.command_times + 0.6)), "different clocks"
    yield "NaN", table(drive).replace(",,,0.0", ",,,nan", 1).replace(",,,-", ",,,nan-", 1), "must be a finite number"
    lines = table(drive).splitlines()
    yield "backward", "\n".join([*lines[:300], *lines[100:]]) + "\n", "run backward"
    yield "cut off", table(drive)[:-25] + '"', "drive.csv:"
    yield (
        "decimal commas",
        table(drive).replace(",", ";").replace(".", ","),
        "must be a finite number with a decimal point",
    )
    for names, told in (
        ("clock,v_cmd,w_cmd,v,w", "columns are ['clock', "),
        ("time [µs],v_cmd,w_cmd,v,w", "columns are ['time [µs]', "),
        ("secs,nsecs,w_cmd,v,w", "'nsecs' is a part of a time; write one column t"),
        ("time,stamp,w_cmd,v,w", "the columns 'time' and 'stamp' could all be t; name one of them t"),
        (
            "t,linear.x,angular.z,v,w",
            "holds no commands; name columns t, v_cmd, w_cmd in the first line of a table, here",
        ),
        ("t,v_cmd,w_cmd,v (%),w", "holds no odometry"),
        ("t,v_cmd,w_cmd,v,omega (rpm)", "holds no odometry"),
        ("t,v_cmd,w_cmd,v_left,v_right", "holds no odometry"),
    ):
        yield names, table(drive).replace("t,v_cmd,w_cmd,v,w", names, 1), told


def test_a_table_that_cannot_say_is_refused_in_a_line(tmp_path: Path) -> None:
    file = tmp_path / "drive.csv"
    for name, text, told in bad():
        file.write_text(text)
        with pytest.raises(ValueError, match=r"\S") as error:
            check(read_log([file]))
        assert told in str(error.value), name
        assert "\n" not in str(error.value), name


@pytest.mark.parametrize(
    ("names", "units"),
    [
        ("T,cmd_v,cmd_w,vx,omega", [1, 1, 1, 1, 1]),
        ("Time [s],v_cmd (m/s),yaw_rate_cmd (rad/s),vel_x,yawRate", [1, 1, 1, 1, 1]),
        ("timestamp,cmd_vel.linear.x,cmd_vel.angular.z,/odom/twist/twist/linear/x,twist.twist.angular.z", [1] * 5),
        ("time_ms,v_cmd_kmh,w_cmd_deg_s,v (cm/s),w (°/s)", [1e3, 3.6, 180 / math.pi, 100, 180 / math.pi]),
    ],
)
def test_other_names_and_units_of_a_header_are_read_as_the_table_in_si(
    names: str, units: list[float], tmp_path: Path
) -> None:
    drive = driven(seconds=10.0)
    plain, other = tmp_path / "plain.csv", tmp_path / "other.csv"
    plain.write_text(table(drive))
    t, command, speed = units[0], units[1:3], units[3:]
    scaled = {"times": t * drive.times, "command_times": t * drive.command_times}
    other.write_text(
        table(changed(drive, **scaled, commands=drive.commands * command, speeds=drive.speeds * speed)).replace(
            "t,v_cmd,w_cmd,v,w", names, 1
        ),
        encoding="utf-8",
    )
    ours, theirs = read_log([plain]), read_log([other])
    for name in ("command_times", "commands", "times", "speeds"):
        np.testing.assert_allclose(getattr(theirs, name), getattr(ours, name), rtol=1e-12, atol=1e-5)


def test_what_topic_echo_writes_is_read_as_the_table_of_its_numbers(tmp_path: Path) -> None:
    drive = driven(seconds=30.0)
    texts = ["", "", "t,v_cmd,w_cmd\n", "t,v,w\n"]
    for k, (times, twists, before) in enumerate(
        ((drive.command_times, drive.commands, ""), (drive.times, drive.speeds, ",base" + ",0.0" * 43))
    ):
        for t, (v, w) in zip(times.tolist(), twists.tolist(), strict=True):
            sec, nanosec = divmod(round(1e9 * t), 10**9)
            texts[k] += f"{sec},{nanosec},odom{before},{v!r},0.0,0.0,0.0,0.0,{w!r}{',0.0' * 36 * k}\n"
            texts[2 + k] += f"{sec}.{nanosec:09d},{v!r},{w!r}\n"
    files = [tmp_path / f"{k}.csv" for k in range(4)]
    for file, text in zip(files, texts, strict=True):
        file.write_text(text)
    echoed, plain = read_log(files[:2]), read_log(files[2:])
    for name in ("command_times", "commands", "times", "speeds"):
        np.testing.assert_array_equal(getattr(echoed, name), getattr(plain, name))
    files[0].write_text(texts[0] + "A message was lost!!!\n")
    with pytest.raises(ValueError, match=rf"0\.csv:{1 + len(drive.commands)}: is no message"):
        read_log(files[:2])


@pytest.mark.parametrize("separator", [";", "\t"])
def test_columns_are_separated_by_what_separates_those_of_the_header(separator: str, tmp_path: Path) -> None:
    file, other = tmp_path / "drive.csv", tmp_path / "other.csv"
    file.write_text(table(driven()))
    other.write_text(table(driven()).replace(",", separator))
    np.testing.assert_array_equal(read_log([file]).speeds, read_log([other]).speeds)


def test_a_wheel_speed_in_rpm_is_doubted_in_a_line(good: Path, tmp_path: Path) -> None:
    sheet = tmp_path / "rpm.json"
    fast = {"name": "rpm", "rated_wheel_speed": 150.0, "peak_wheel_speed": 150.0}
    sheet.write_text(json.dumps(ROBOTS["p3dx"].sheet | fast))
    ended = identify(good, "--robot", sheet)
    assert ended.exit_code == 0, ended.stderr
    assert len(ended.stderr.splitlines()) == 1
    assert "if it is in rpm, write 15.71" in ended.stderr


def test_a_refused_log_leaves_the_sheet_that_was_there(tmp_path: Path) -> None:
    file, sheet = tmp_path / "drive.csv", tmp_path / "robot.json"
    file.write_text(table(changed(driven(), speeds=driven().speeds * [1500.0, 1.0])))
    sheet.write_text("before")
    ended = identify(file, "--out", sheet, "--report", tmp_path / "page.html")
    assert ended.exit_code == 2
    assert len(ended.stderr.splitlines()) == 1
    assert "it must be at most 30" in ended.stderr
    assert sheet.read_text() == "before"
    assert sorted(each.name for each in tmp_path.iterdir()) == ["drive.csv", "robot.json"]


def test_a_log_with_gaps_is_fitted_by_its_pieces_where_that_is_wanted() -> None:
    drive = driven()
    times = np.where(drive.times > 40.0, drive.times + 3.0, drive.times)
    commands = np.where(drive.command_times > 40.0, drive.command_times + 3.0, drive.command_times)
    log = Log("a log", "", "table", commands, drive.commands, times, drive.speeds)
    with pytest.raises(ValueError, match="--cut"):
        check(log)
    checked = check(log, cut=True)
    assert checked.warnings
    inside = (checked.drive.times > 43.0) & (checked.drive.times < 43.9)
    assert not checked.drive.counted[inside].any()
    assert checked.drive.starts.sum() == 2
    # however long it is, and whatever else is fitted is the same
    pieces = fit(checked.drive).numbers
    for gap in (100.0, 3e7):
        wide = dataclasses.replace(log, times=np.where(times > 42.0, times + gap, times),
                                   command_times=np.where(commands > 42.0, commands + gap, commands))  # fmt: skip
        found = check(wide, cut=True).drive
        assert found.times[-1] < times[-1] + 2.0
        np.testing.assert_array_equal(found.counted, checked.drive.counted)
        np.testing.assert_allclose(fit(found).numbers, pieces, rtol=1e-3, atol=1e-3)


@pytest.mark.parametrize("step", [0.1, 1.0])
def test_rounded_stamps_leave_the_answers(step: float) -> None:
    log = log_of(driven())
    rough = dataclasses.replace(log, times=step * (log.times // step), command_times=step * (log.command_times // step))
    checked = check(rough)
    assert "rounded" in checked.warnings[0]
    np.testing.assert_allclose(fit(checked.drive).numbers, plain().numbers, rtol=0.1, atol=0.03)


def test_what_was_recorded_twice_is_taken_once() -> None:
    drive = driven()
    once, twice = check(log_of(drive)), check(log_of(drive, np.repeat(np.arange(len(drive.times)), 2)))
    for field in dataclasses.fields(Drive):
        np.testing.assert_array_equal(getattr(twice.drive, field.name), getattr(once.drive, field.name))


def test_a_few_messages_far_beyond_all_commands_are_left_out_and_nothing_else() -> None:
    drive = driven()
    wild = np.random.default_rng(0).random(len(drive.times)) < 0.05
    speeds = np.where(wild[:, None], [9.9, 0.0], drive.speeds)
    checked = check(log_of(changed(drive, speeds=speeds)))
    assert not np.isin(drive.times[wild], checked.drive.times).any()
    assert np.isin(drive.times[~wild], checked.drive.times).sum() >= 0.95 * (~wild).sum()


def test_zeros_between_messages_that_move_are_left_out_and_no_stop_of_the_base_is() -> None:
    drive = driven()
    zeros = (np.arange(len(drive.times)) % 5 == 0) | (np.random.default_rng(0).random(len(drive.times)) < 0.1)
    found = fit(check(log_of(changed(drive, speeds=np.where(zeros[:, None], 0.0, drive.speeds)))).drive)
    np.testing.assert_allclose(found.numbers[[1, 6]], 1.0, rtol=0.01)
    stops = np.where(np.abs(drive.speeds) < [0.02, 0.24], 0.0, drive.speeds)
    assert check(log_of(changed(drive, speeds=stops))).warnings == ()


def test_odometry_that_hangs_is_left_out_and_a_base_that_does_what_is_commanded_never_hangs() -> None:
    drive = driven()
    hung = (drive.times > 10.0) & (drive.times < 20.0)
    checked = check(log_of(changed(drive, speeds=np.where(hung[:, None], drive.speeds[0], drive.speeds))), cut=True)
    assert not np.isin(drive.times[hung][1:], checked.drive.times).any()
    # cruising for ten seconds each, without noise
    legs = np.repeat([[0.2, 0.0], [0.0, 0.0], [-0.2, 0.5], [0.1, -1.0], [0.0, 1.0]], 200, axis=0)
    times = 0.05 * np.arange(len(legs))
    check(Log("drive.csv", "", "table", times, legs, times + 0.1, 0.8 * legs))


@pytest.mark.parametrize("axis", [0, 1])
def test_a_speed_of_odometry_that_does_not_follow_is_told_by_its_name(axis: int) -> None:
    drive, name = driven(), ("forward speed", "yaw rate")[axis]
    signless, noise = drive.speeds.copy(), drive.speeds.copy()
    signless[:, axis] = np.abs(signless[:, axis])
    noise[:, axis] = np.random.default_rng(0).normal(0.0, 0.1, len(noise))
    for speeds, told in ((signless, "is its sign lost?"), (noise, "mean little")):
        lines = [each for each in check(log_of(changed(drive, speeds=speeds))).warnings if "does not follow" in each]
        assert len(lines) == 1
        assert lines[0].startswith(f"the {name} of odometry")
        assert told in lines[0]


def test_odometry_that_never_goes_backward_is_clipped_at_0() -> None:
    drive = driven()
    found = fit(check(log_of(changed(drive, speeds=np.maximum(drive.speeds, [0.0, -np.inf])))).drive)
    assert found.drive.reported[0, 0] == 0.0
    np.testing.assert_allclose(found.numbers[[1, 6]], 1.0, rtol=0.01)


@pytest.mark.parametrize("level", [0.15, 0.8])
@pytest.mark.parametrize("axis", [0, 1])
def test_odometry_that_its_driver_clips_leaves_the_answers(axis: int, level: float) -> None:
    drive, most = driven(), np.full(2, np.inf)
    most[axis] = level * TURTLEBOT[10 + axis]
    found = intervals(fit(check(log_of(changed(drive, speeds=np.clip(drive.speeds, -most, 0.7 * most)))).drive))
    np.testing.assert_array_equal(found.drive.reported.T[axis], (-most[axis], 0.7 * most[axis]))
    assert clipped(found.drive)[0].count("\n") == 0
    held = [each.low <= TURTLEBOT[PAIR.index(each.name)] <= each.high for each in found.estimates if each.name in PAIR]
    assert sum(held) >= len(held) - 1  # each has its 5 %
    limits = [found[name] for name in ("speed_v", "speed_w")]
    assert all(each.low <= true <= each.high for each, true in zip(limits, TURTLEBOT[10:], strict=True))


def test_limits_of_a_base_are_no_clipped_odometry() -> None:
    """Not even where it has no noise and is rounded, so that a cruise repeats one largest speed."""
    part = script(30.0, 1.3)
    idle = np.zeros_like(part)
    commands = np.stack([0.2 * np.concatenate([part, idle]), 2.4 * np.concatenate([idle, part])], axis=1)
    drive = drive_of(np.random.default_rng(0), commands, AXES, TURTLEBOT, (0.0, 0.0), 0.0)
    for decimals in (3, 9):
        found = fit(changed(drive, speeds=np.round(drive.speeds, decimals)))
        assert np.isinf(found.drive.reported).all()
        np.testing.assert_allclose(found.numbers[10:], TURTLEBOT[10:], rtol=0.01)


@pytest.mark.parametrize(("own", "told"), [((0.2, 0.2), "keep"), ((0.2, 9.0), "predicts"), ((1.0, 1.0), "")])
def test_a_sheet_that_predicts_worse_than_the_base_has_is_doubted(own: tuple[float, float], told: str) -> None:
    lines = Prediction(np.ones(2), np.full(2, 0.5), np.array(own), np.ones(2)).doubts("mine", driven())
    assert told in "".join(lines)
    assert len(lines) == bool(told)
    assert ("keep" in "".join(lines)) == (told == "keep")


def test_stamps_of_two_clocks_are_doubted_in_a_line() -> None:
    log = log_of(driven())
    assert check(log).warnings == ()
    assert "clocks" in check(dataclasses.replace(log, skew=-0.5)).warnings[0]


@pytest.mark.parametrize(("scale", "told"), [((3.6, 1.0), "gain_v is 3."), ((1.0, 1.0), "")])
def test_a_log_in_other_units_than_the_base_can_have_is_doubted(scale: tuple[float, float], told: str) -> None:
    drive = driven()
    base = ROBOTS["turtlebot3"]
    fitted = plain() if scale == (1.0, 1.0) else fit(check(log_of(changed(drive, speeds=drive.speeds * scale))).drive)
    sheet, _, _ = identified(base, intervals(fitted), "mine", "a log")
    lines = "; ".join(doubts(base, sheet))
    assert told in lines
    assert bool(lines) == bool(told)


def test_errors_of_odometry_are_found_against_ground_truth() -> None:
    rng = np.random.default_rng(0)
    times = np.arange(0.0, 600.0, 0.05)
    v = 0.3 + 0.2 * np.sin(0.13 * times)
    w = 0.8 * np.sin(0.31 * times)
    slip, track, radius, half = 0.05, 0.03, 0.02, 0.16
    true_v = (1.0 - slip) * v
    b = (1.0 - slip) / (1.0 + track)
    true_w = b * w - radius * (1.0 - slip) / (half * (1.0 + track)) * v

    def poses(v: np.ndarray, w: np.ndarray) -> np.ndarray:
        heading = np.concatenate([[0.0], np.cumsum(w[:-1] * 0.05)])
        middle = heading + 0.025 * w
        return np.stack(
            [np.concatenate([[0.0], np.cumsum((v * f(middle))[:-1] * 0.05)]) for f in (np.cos, np.sin)] + [heading],
            axis=1,
        )

    truth = poses(true_v, true_w) + rng.normal(0.0, (0.003, 0.003, 0.01), (len(times), 3))
    twists = np.stack([v, w], axis=1)
    log = Log("a log", "", "table", times, twists, times, twists, poses(v, w), times, truth)
    for found, true in zip(odometry_errors(log, half), (slip, track, radius), strict=True):
        assert found.low - 0.003 <= true <= found.high + 0.003, found
        assert found.value == pytest.approx(true, abs=0.006)
    assert all(each.missing for each in odometry_errors(Log("a", "", "table", times, twists, times, twists), half))


def test_noise_is_that_of_the_sensors() -> None:
    rng = np.random.default_rng(1)
    rest = np.zeros((200, 2))
    drive = drive_of(rng, np.concatenate([rest, driven().commands]), AXES, TURTLEBOT, (0.003, 0.03), 0.3)
    scans = 2.0 + rng.normal(0.0, 0.01, (300, 36))
    scans[:, 5] = np.inf
    log = Log("a log", "", "table", drive.command_times, drive.commands, drive.times, drive.speeds,
              scan_times=np.linspace(0.0, 70.0, 300), scans=scans)  # fmt: skip
    found = measure(log, fit(drive, 0.08))
    assert found.scan == pytest.approx(0.01, rel=0.3)
    assert found.dropouts == pytest.approx(1.0 / 36.0)
    np.testing.assert_allclose(found.moving, (0.003, 0.03), rtol=0.1)
    np.testing.assert_allclose(found.resting, (0.003, 0.03), rtol=0.3)
    assert {each.what: round(each.hertz) for each in rates(log)}["odometry"] == 20


# Bags: written here with the library's writers, and read to equal arrays.


def messages(store: Any, first: bool) -> dict[str, list[tuple[int, Any]]]:
    """Returns topics with messages and their arrival (ns)."""
    kinds = store.types

    def of(name: str, *values: Any) -> Any:
        return kinds[name](*values)

    found: dict[str, list[tuple[int, Any]]] = {
        "/cmd_vel": [],
        "/stamped": [],
        "/odom": [],
        "/pose": [],
        "/scan": [],
        "/text": [],
        "/unstamped": [],
    }
    for k in range(40):
        sec, nanosec = 100 + k // 10, (k % 10) * 10**8
        arrival = sec * 10**9 + nanosec + 5_000_000
        stamp = of("builtin_interfaces/msg/Time", sec, nanosec)
        header = of("std_msgs/msg/Header", *((k, stamp, "odom") if first else (stamp, "odom")))
        twist = of(
            "geometry_msgs/msg/Twist",
            of("geometry_msgs/msg/Vector3", 0.1 * k, 0.0, 0.0),
            of("geometry_msgs/msg/Vector3", 0.0, 0.0, -0.2 * k),
        )
        half = 0.05 * k
        pose = of(
            "geometry_msgs/msg/Pose",
            of("geometry_msgs/msg/Point", 1.0 * k, 2.0, 0.0),
            of("geometry_msgs/msg/Quaternion", 0.0, 0.0, math.sin(half), math.cos(half)),
        )
        found["/cmd_vel"].append((arrival, twist))
        found["/stamped"].append((arrival, of("geometry_msgs/msg/TwistStamped", header, twist)))
        found["/pose"].append((arrival, of("geometry_msgs/msg/PoseStamped", header, pose)))
        found["/odom"].append(
            (
                arrival,
                of(
                    "nav_msgs/msg/Odometry",
                    header,
                    "base",
                    of("geometry_msgs/msg/PoseWithCovariance", pose, np.zeros(36)),
                    of("geometry_msgs/msg/TwistWithCovariance", twist, np.zeros(36)),
                ),
            )
        )
        ranges = np.array([1.0, np.inf, 0.0, 2.5, 5.01, 0.05, np.nan], np.float32)
        found["/scan"].append(
            (arrival, of("sensor_msgs/msg/LaserScan", header, 0.0, 6.0, 1.0, 0.0, 0.2, 0.1, 5.0, ranges, ranges))
        )
        never = of("builtin_interfaces/msg/Time", 0, 0)
        blank = of("std_msgs/msg/Header", *((k, never, "") if first else (never, "")))
        found["/unstamped"].append((arrival, of("geometry_msgs/msg/TwistStamped", blank, twist)))
        found["/text"].append((arrival, of("std_msgs/msg/String", "a word")))
    return found


def bag(folder: Path, kind: str, leave_out: str = "") -> Path:
    """Writes a bag of a kind; returns what is named on the command line."""
    pytest.importorskip("rosbags")
    from rosbags.rosbag1 import Writer as Writer1
    from rosbags.rosbag2 import StoragePlugin, Writer
    from rosbags.typesys import Stores, get_typestore

    first = kind == "ros1"
    store = get_typestore(Stores.ROS1_NOETIC if first else Stores.LATEST)
    plugin = StoragePlugin.SQLITE3 if kind == "sqlite3" else StoragePlugin.MCAP
    file = folder / ("drive.bag" if first else "bag")
    writer: Any = Writer1(file) if first else Writer(file, version=9, storage_plugin=plugin)
    with writer:
        for topic, rows in messages(store, first).items():
            if topic == leave_out:
                continue
            name = rows[0][1].__msgtype__
            connection = writer.add_connection(topic, name, typestore=store)
            for arrival, message in rows:
                writer.write(
                    connection,
                    arrival,
                    store.serialize_ros1(message, name) if first else store.serialize_cdr(message, name),
                )
    if kind == "bare":
        (file / "bag.mcap").rename(folder / "drive.mcap")
        return folder / "drive.mcap"
    return file


@pytest.mark.parametrize("kind", ["ros1", "sqlite3", "mcap", "bare"])
def test_every_kind_of_bag_reads_to_the_same_arrays(kind: str, tmp_path: Path) -> None:
    k = np.arange(40.0)
    file = bag(tmp_path, kind)
    log = read_log([file], Topics(truth="/pose"))
    np.testing.assert_allclose(log.command_times, 0.1 * k, atol=1e-6)
    np.testing.assert_allclose(log.commands, np.stack([0.1 * k, -0.2 * k], axis=1))
    np.testing.assert_allclose(log.speeds, log.commands)
    expected = np.stack([k, 0 * k + 2.0, np.arctan2(np.sin(0.1 * k), np.cos(0.1 * k))], axis=1)
    np.testing.assert_allclose(log.poses, expected, atol=1e-12)
    np.testing.assert_allclose(log.truth, expected, atol=1e-12)
    np.testing.assert_array_equal(log.scans, np.tile([1.0, np.inf, np.inf, 2.5, np.inf, np.inf, np.inf], (40, 1)))
    assert log.stamps == "arrival"
    assert len(log.digest) == 64
    stamped = read_log([file], Topics(cmd="/stamped"))
    assert abs(stamped.skew) < 1e-6
    assert stamped.stamps == "header"
    np.testing.assert_allclose(stamped.commands, log.commands)
    # headers that were left at 0 are none
    unstamped = read_log([file], Topics(cmd="/unstamped"))
    assert unstamped.stamps == "arrival"
    np.testing.assert_array_equal(unstamped.command_times, log.command_times)
    np.testing.assert_array_equal(unstamped.times, log.times)
    with pytest.raises(ValueError, match="--stamps header, but all those of topic /unstamped are 0"):
        read_log([file], Topics(cmd="/unstamped"), "header")


@pytest.mark.parametrize("kind", ["ros1", "sqlite3", "mcap", "bare"])
def test_a_bag_that_cannot_say_is_refused_in_a_line(kind: str, tmp_path: Path) -> None:
    file = bag(tmp_path, kind, leave_out="/odom")
    for topics, told in (
        (Topics(), r"has no topic /odom; its topics are /cmd_vel \(geometry_msgs/msg/Twist\), /pose"),
        (Topics(odom="/text"), r"/text is of type std_msgs/msg/String; it must be nav_msgs/msg/Odometry"),
        (Topics(cmd="/pose"), "it must be geometry_msgs/msg/Twist or"),
    ):
        with pytest.raises(ValueError, match=told) as error:
            read_log([file], topics)
        assert "\n" not in str(error.value)
    whole = max(
        (each for each in ([file] if file.is_file() else file.iterdir()) if each.suffix != ".yaml"),
        key=lambda each: each.stat().st_size,
    )
    content = whole.read_bytes()
    for share in (0.0, 0.1, 0.5, 0.9):
        whole.write_bytes(content[: int(share * len(content))])
        with pytest.raises(ValueError, match=r"\S") as error:
            read_log([file], Topics(odom="/pose"))
        assert "\n" not in str(error.value)


def test_without_rosbags_a_line_says_how_to_get_it(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "drive.mcap").write_bytes(b"")
    find = importlib.util.find_spec
    monkeypatch.setattr(
        importlib.util, "find_spec", lambda name, *more: None if name == "rosbags" else find(name, *more)
    )
    ended = identify(tmp_path / "drive.mcap")
    assert ended.exit_code == 2
    assert len(ended.stderr.splitlines()) == 1
    assert installs("bags") in ended.stderr


def test_rounding_and_an_offset_of_odometry_are_told() -> None:
    log, true = log_of(driven()), intervals(plain())
    coarse = dataclasses.replace(log, speeds=0.06 * np.round(log.speeds / 0.06))
    found = intervals(fit(check(coarse).drive))
    for each in true.estimates[:10]:
        if each.bounded:
            assert found[each.name].low <= each.value <= found[each.name].high, (each, found[each.name])
    (told,) = check(dataclasses.replace(log, speeds=np.round(log.speeds, 1))).warnings
    assert "forward speed of odometry is rounded to 0.1 m/s" in told
    still = np.zeros((200, 2))
    log = dataclasses.replace(
        log,
        commands=np.concatenate([log.commands, still[:1]]),
        command_times=np.append(log.command_times, log.command_times[-1] + 0.05),
        times=np.concatenate([log.times, log.times[-1] + 0.05 * np.arange(1, 201)]),
        speeds=np.concatenate([log.speeds, still]),
    )
    assert not any("offset" in each for each in check(log).warnings)
    (told,) = check(dataclasses.replace(log, speeds=log.speeds + np.array([0.0, 0.3]))).warnings
    assert "odometry says 0.3 rad/s" in told
