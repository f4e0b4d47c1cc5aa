"""The chain of a real base, with MuJoCo as the base: python benchmarks/studies/sim_to_sim.py

A base in MuJoCo is excited as `wayfield ros excite` does, its log goes through `wayfield identify`, and the sheet that
comes out drives the kinematic plant. Both then get the same commands of another drive, open loop: how far are they
apart, with the sheet that the model in MuJoCo was made of, and with the identified one? Rows are kept as
physics_chain.csv; benchmarks/studies/physics.py shows them.
"""

import csv
import dataclasses
import functools
import json
import math
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any

import click
import numpy as np
from identification import joystick
from numpy.typing import NDArray
from part_rows import drive_missing

from wayfield.bridges.ros.body import Body
from wayfield.bridges.ros.excite import script
from wayfield.bridges.ros.messages import Twist
from wayfield.envs.robots import ROBOTS, Robot
from wayfield.envs.robots.robot import read_robot
from wayfield.system.command_line import OneLineErrors

CHAIN = Path("docs/results/physics_chain.csv")
BASES = ("p3dx", "turtlebot3", "jackal")
DRIVES, SECONDS = 3, 60.0  # of other driving
NOISE = (0.003, 0.01)  # m/s and rad/s, of the log
_COMMAND = "from wayfield.command import main; main()"
NUMBERS = ("metres", "apart", "turned_apart", "speed_error", "yaw_rate_error")
FIELDS = ("robot", "sheet", "drive", *NUMBERS, "found")


def body_of(robot: Robot, dynamics: str, folder: Path) -> Body:
    """Returns a base on an empty floor, whose twist is measured as it is."""
    floor = folder / "floor.json"
    floor.write_text(json.dumps({"start": [0, 0, 0], "goal": [900, 0, 0], "obstacles": []}))
    return Body(robot, scenario=str(floor), dynamics=dynamics, pose_source="ground_truth")


def top(robot: Robot) -> NDArray[np.float64]:
    """Returns the speeds (2,) up to which a base is driven: those of its sheet, and no faster than in a room."""
    return np.minimum(robot.max_twist, (1.0, 2.0))


def excited(robot: Robot, folder: Path) -> Path:
    """Returns the log of a base in MuJoCo."""
    body, dice = body_of(robot, "mujoco", folder), np.random.default_rng(0)
    fastest = top(robot)
    segments, _ = script(float(fastest[0]), float(fastest[1]), 60.0, 3.0)
    rows = []
    for segment in segments:
        for t in np.arange(0.0, segment.seconds, body.dt):
            command, measured = segment.at(float(t)), body.odometry.twist
            v, w = dice.normal((measured.vx, measured.yaw_rate), NOISE)
            rows.append([f"{body.time:.3f}", command.vx, command.yaw_rate, v, w])
            body.command(Twist(command.vx, 0.0, command.yaw_rate))
            body.step()
    log = folder / "drive.csv"
    with log.open("w", newline="") as file:
        csv.writer(file).writerows([["t", "v_cmd", "w_cmd", "v", "w"], *rows])
    return log


def identified(robot: Robot, folder: Path) -> Robot:
    """Returns the robot of the sheet that `wayfield identify` makes of the log."""
    out = folder / "mine.json"
    sheet = folder / "base.json"
    sheet.write_text(json.dumps(robot.sheet | {"sources": {}}))
    words = ["identify", str(excited(robot, folder)), "--robot", str(sheet), "--out", str(out)]
    done = subprocess.run([sys.executable, "-c", _COMMAND, *words], capture_output=True, text=True, check=False)
    if done.returncode:
        raise click.ClickException(done.stderr.strip())
    click.echo(done.stdout)
    return read_robot(str(out))


def path_of(robot: Robot, dynamics: str, commands: NDArray[np.float64], folder: Path) -> NDArray[np.float64]:
    """Returns pose and twist (n, 5) of a base after each command."""
    body = body_of(robot, dynamics, folder)
    states = []
    for v, w in commands.tolist():
        body.command(Twist(v, 0.0, w))
        body.step()
        state = body._env.batch.states[0]
        states.append([float(state[name]) for name in ("x", "y", "heading", "vx", "yaw_rate")])
    return np.array(states)


def rows_of(name: str) -> list[tuple[Any, ...]]:
    """Returns the rows of a base: how far apart sheet and identified sheet drive from it.

    It answers within the control period too, as real ones do, and as identification takes it.
    """
    robot = dataclasses.replace(ROBOTS[name], name="base", response="continuous")
    lines = []
    with tempfile.TemporaryDirectory() as place:
        folder = Path(place)
        mine = identified(robot, folder)
        numbers = {"track": 2.0 * mine.wheels[1].y, "gain": mine.gain, "lag": mine.lag, "delay": mine.delay}
        parameters = ";".join(
            f"{what}={' '.join(f'{each:.4f}' for each in np.atleast_1d(np.asarray(value)).tolist())}"
            for what, value in numbers.items()
        )
        for k in range(DRIVES):
            commands = joystick(np.random.default_rng(k), 0.8 * top(robot), round(SECONDS / 0.05), 0.05)
            true = path_of(robot, "mujoco", commands, folder)
            metres = float(np.abs(np.diff(true[:, :2], axis=0)).sum())
            for sheet, base in (("own", robot), ("identified", mine)):
                ours = path_of(base, "kinematic", commands, folder)
                apart = math.hypot(*(ours[-1, :2] - true[-1, :2]).tolist())
                turned = abs(math.remainder(ours[-1, 2] - true[-1, 2], 2.0 * math.pi))
                speeds = np.sqrt(((ours[:, 3:] - true[:, 3:]) ** 2).mean(axis=0)).tolist()
                numbers_of = (metres, apart, turned, *speeds)
                lines.append((sheet, k, *(f"{each:.4g}" for each in numbers_of), parameters if sheet != "own" else ""))
    return lines


@click.command(cls=OneLineErrors)
@click.option("--bases", default=",".join(BASES), show_default=True)
def main(bases: str) -> None:
    """Drives the chain of each base that is not in the rows."""
    drive_missing(CHAIN, FIELDS, (({"robot": name}, functools.partial(rows_of, name)) for name in bases.split(",")))


if __name__ == "__main__":
    main()
