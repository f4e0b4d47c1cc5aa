"""A CoppeliaSim as a plant: `gymnasium.make(id, dynamics="coppelia", address="host:port")`.

The plant sends the wheel speeds of the commanded twist and reads the state back from the simulator. The actuator tier
is applied before: a wheel target is the mean speed of the tier's response over the control period, so that a simulator
with stiff motors moves as the kinematic plant. Wheel speeds follow from the geometry that the scene reports, so that
the driven twist equals the commanded one.
"""

import logging
import math
import os
import subprocess
import sys
import time
import weakref
from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from wayfield.bridges.coppelia import frames, standstill
from wayfield.bridges.coppelia.standstill import DONE, Link, stand_still
from wayfield.envs.robots.hulls import clearance_of
from wayfield.envs.robots.records import Array, Flags, Records
from wayfield.envs.robots.sensing import advance_odometry
from wayfield.envs.tasks.task import Task
from wayfield.system.compiled import compiled
from wayfield.system.elementary import wrap_angle

LOG = logging.getLogger("wayfield.coppelia")

ADDRESS = "localhost:23000"
ADDRESS_VARIABLE = "WAYFIELD_COPPELIA"
ROBOT = "/PioneerP3DX"
WHEELS = ("rightMotor", "leftMotor")  # in the order of the robot's wheels
TYRE = "rightWheel"

_FIRST_ANSWER = 5.0  # s
_ANSWER = 30.0  # s; a step of a large scene may take long
_STOPPED_WITHIN = 30.0  # s
_TOUCHING = 1e-6  # m, of clearance below which the hull is in contact
_SAME_SPEED = 1e-6  # rad/s
_SAME_SIZE = 1e-6  # m


@compiled
def note_odometry(params, states, noise, vx, vy, yaw_rate):
    """Integrates the encoder readings of the one robot for a twist of its wheels."""
    p = params[0]
    s = states[0]
    if not p.perfect_pose:
        advance_odometry(p, s, vx, vy, yaw_rate, noise, 0, s.noise_row if noise.shape[1] > 1 else 0)


class CoppeliaPlant:
    """Drives the one robot of a batch in a running simulator.

    Raises:
        ValueError: if the task has several robots, another robot or another time step.
        ConnectionError: if there is no answer at the address.
        RuntimeError: if the scene has no P3DX.
    """

    def __init__(self, task: Task, num_envs: int) -> None:
        options = task.options
        if num_envs != 1:
            raise ValueError(f'dynamics="coppelia" drives the one robot of a simulator; num_envs is {num_envs}')
        if task.robot.holonomic:
            raise ValueError(f'dynamics="coppelia" drives a differential drive; robot is {task.robot.name!r}')
        if options.shove is not None or options.disturbance.distorts or options.disturbance.displaces:
            raise ValueError('dynamics="coppelia" takes no shove and no disturbance of the motion: the simulator moves')
        self.task = task
        self.address = options.address or os.environ.get(ADDRESS_VARIABLE) or ADDRESS
        self._end: Callable[[], object] | None = None
        self._targets = [0.0, 0.0]
        self._wheels = np.zeros(2)  # forward speed and yaw rate of the tier's wheels
        self._connect()

    def _connect(self) -> None:
        """Opens a link and reads the scene over it."""
        self._link = Link(self.address, _FIRST_ANSWER)
        try:
            self._read_scene()
        except BaseException:
            self._link.broken = True
            self._link.close()
            raise
        self._link.timeout = _ANSWER
        weakref.finalize(self, Link.close, self._link)

    def _read_scene(self) -> None:
        """Reads the geometry of the scene's robot, and compares it with the task's."""
        try:
            self._link.call("zmqRemoteApi.info", "sim")
        except ConnectionError:
            raise ConnectionError(
                f"no CoppeliaSim at {self.address}; start it, or `python -m wayfield.bridges.coppelia`, "
                f"or name another by address or {ADDRESS_VARIABLE}"
            ) from None
        sim = self._sim
        self.base = sim("getObject", ROBOT, {"noError": True})
        joints = [sim("getObject", f"{ROBOT}/{name}", {"noError": True}) for name in WHEELS]
        tyre = sim("getObject", f"{ROBOT}/{TYRE}", {"noError": True})
        if -1 in (self.base, tyre, *joints):
            raise RuntimeError(f"the scene at {self.address} has no robot {ROBOT} with {', '.join(WHEELS)} and {TYRE}")
        self.joints = [int(joint) for joint in joints]
        scene_dt = float(sim("getSimulationTimeStep"))
        self.steps = round(self.task.options.dt / scene_dt)
        if self.steps < 1 or abs(self.steps * scene_dt - self.task.options.dt) > 1e-9:
            raise ValueError(
                f"the scene's time step of {scene_dt:g} s does not divide the control period of "
                f"{self.task.options.dt:g} s; set it in the scene's simulation settings"
            )
        right, left = (sim("getObjectPosition", joint, self.base) for joint in self.joints)
        self.ahead = 0.5 * (right[0] + left[0])  # m, of the axle before the base's origin
        self.half_track = 0.5 * (left[1] - right[1])  # m
        self.radius = 0.5 * float(sim("getShapeGeomInfo", int(tyre))[2][0])  # m
        if not (self.half_track > 0.0 and self.radius > 0.0):
            raise RuntimeError(
                f"the robot at {self.address} has half track {self.half_track} m, wheels {self.radius} m"
            )
        self.height = float(sim("getObjectPosition", self.base)[2])
        robot = self.task.robot
        expected, rim = abs(robot.wheels[0].y), robot.wheels[0].radius
        if abs(self.half_track - expected) > _SAME_SIZE or abs(self.radius - rim) > _SAME_SIZE:
            LOG.warning(
                "the scene's robot has half track %.4f m and wheel radius %.4f m, the task's %.4f m and %.4f m; "
                "wheel speeds are those of the scene's",
                *(self.half_track, self.radius, expected, rim),
            )

    def _sim(self, function: str, *args: Any) -> Any:
        return self._link.call(f"sim.{function}", *args)

    def reset(self, rows: NDArray[np.int64], states: NDArray[np.void], obstacles: NDArray[np.void]) -> None:
        """Puts the robot at rest at its start, with the simulation running and stepped.

        After a call without an answer it connects anew: the simulator may have been started again.
        """
        del rows, obstacles
        if self._link.broken:
            self._link.close()
            self._connect()
            if self._end is not None:
                self._end()
                self._end = None
        if self._end is None:
            self._end = _left_standing(self, self.address, self.joints)
        sim = self._sim
        sim("stopSimulation")
        patience = time.monotonic() + _STOPPED_WITHIN
        while sim("getSimulationState") != 0:
            if time.monotonic() > patience:
                raise ConnectionError(f"the simulation at {self.address} does not stop")
            time.sleep(0.005)
        x, y, heading = (float(states[name][0]) for name in ("x", "y", "heading"))
        base = (x - self.ahead * math.cos(heading), y - self.ahead * math.sin(heading))
        sim("setObjectPose", self.base, list(frames.yawed(*base, self.height, heading)))
        self._wheels[:] = 0.0
        self._set_wheels([0.0, 0.0])
        if sim("setStepping", True) > 0:
            sim("setStepping", False)
        sim("startSimulation")

    def _set_wheels(self, speeds: list[float]) -> None:
        for joint, speed in zip(self.joints, speeds, strict=True):
            self._sim("setJointTargetVelocity", joint, speed)
        self._targets = speeds

    def drive(self, states: Records, obstacles: Records, actions: Array, noise: Array, skip: Flags) -> None:
        """Drives the wheels for one control period and reads the state of the robot.

        Raises:
            RuntimeError: if another program sets the wheel speeds.
        """
        if skip[0]:
            return
        sim = self._sim
        s = states[0]
        p = self.task.params[0]
        command = np.array([float(s["command_vx"]), float(s["command_yaw_rate"])])
        speed, yaw_rate = (command + float(p["lag_mean"]) * (self._wheels - command)).tolist()
        self._wheels = command + float(p["lag_decay"]) * (self._wheels - command)
        across = yaw_rate * self.half_track
        self._set_wheels([(speed + across) / self.radius, (speed - across) / self.radius])
        for _ in range(self.steps):
            sim("step", True)
        if sim("getSimulationState") in (0, 8):
            raise RuntimeError(f"the simulation at {self.address} was stopped or paused by another client")
        for joint, target in zip(self.joints, self._targets, strict=True):
            result = sim("getJointTargetVelocity", joint)
            if abs(result - target) > _SAME_SPEED * max(1.0, abs(target)):
                raise RuntimeError(
                    f"a script in the scene drives the wheels (set {target:.4g} rad/s, found {result:.4g}): "
                    "delete it; the stock P3DX model carries one"
                )
        pose = sim("getObjectPose", self.base)
        linear, angular = sim("getObjectVelocity", self.base)
        right, left = (sim("getJointVelocity", joint) for joint in self.joints)
        heading = frames.yaw_of(pose)
        c, n = math.cos(heading), math.sin(heading)
        s["x"], s["y"], s["heading"] = pose[0] + self.ahead * c, pose[1] + self.ahead * n, wrap_angle(heading)
        s["vx"] = c * linear[0] + n * linear[1]
        s["vy"] = c * linear[1] - n * linear[0] + angular[2] * self.ahead
        s["yaw_rate"] = angular[2]
        s["wheel_vx"] = 0.5 * self.radius * (right + left)
        s["wheel_vy"] = 0.0
        s["wheel_yaw_rate"] = 0.5 * self.radius * (right - left) / self.half_track
        count = int(self.task.obstacle_counts(states)[0])
        s["clearance"] = clearance_of(self.task.robot, obstacles[0], count, (s["x"], s["y"], s["heading"]))
        # the simulator reports no contacts; they follow from the task's own obstacles
        s["contact"] = int(s["clearance"] < _TOUCHING)
        note_odometry(self.task.params, states, noise, s["wheel_vx"], 0.0, s["wheel_yaw_rate"])

    def close(self) -> None:
        """Stops the wheels and the simulation over a second link: this one may wait for an answer."""
        if self._end is not None:
            self._end()
            self._end = None
        self._link.close()


def _left_standing(plant: CoppeliaPlant, address: str, joints: list[int]) -> Callable[[], object]:
    """Returns the finalizer that stops the robot: on call, on deletion of the plant, at the end of the process.

    A child process watches, for the case that this process is killed.
    """
    words = [sys.executable, "-P", standstill.__file__, address, *map(str, joints)]
    # a session of its own, which Ctrl-C in the terminal does not reach
    watcher = subprocess.Popen(words, stdin=subprocess.PIPE, stdout=subprocess.DEVNULL, start_new_session=True)
    return weakref.finalize(plant, _stop, watcher, address, joints)


def _stop(watcher: "subprocess.Popen[bytes]", address: str, joints: list[int]) -> None:
    words = b""
    try:
        stand_still(address, joints)
        words = DONE
    except (ConnectionError, RuntimeError) as error:
        LOG.warning("the robot may still be driving: %s", error)
    try:
        watcher.communicate(words, timeout=5.0)
    except (subprocess.TimeoutExpired, OSError):
        watcher.kill()
