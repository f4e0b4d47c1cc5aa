"""The world of a scene: the robot, its plant (kinematic or pymunk), sonars, and the state of the simulation."""

import dataclasses
import math
from collections.abc import Iterable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from wayfield.bridges.coppelia import frames, lidar, models, sonars
from wayfield.bridges.coppelia.constants import (
    ABOUT_TO_STOP,
    ADVANCING,
    FIRST,
    FIRST_AFTER_PAUSE,
    LAST_BEFORE_PAUSE,
    LAST_BEFORE_STOP,
    PAUSED,
    RUNNING,
    STOPPED,
)
from wayfield.bridges.coppelia.drawing import Drawings
from wayfield.bridges.coppelia.frames import Pose, Vector
from wayfield.bridges.coppelia.models import Model
from wayfield.bridges.coppelia.sandbox import Sandbox
from wayfield.bridges.coppelia.scene import Footprint, Object, Scene
from wayfield.envs.batch import Batch, Results
from wayfield.envs.robots.hulls import clearance_of
from wayfield.envs.tasks.task import CONTROL_PERIOD
from wayfield.envs.world.movers import motion_at
from wayfield.system.elementary import sin_cos, wrap_angle

ROOM_FOR_OBSTACLES = 1024  # besides those of the scene
MAX_TRAIL = 10_000  # places; a longer trail keeps every second one
MAX_WHEEL_TARGET = 1e6  # rad/s; larger targets are clipped
_ROW = np.zeros(1, np.int64)

Reading = tuple[int, float, list[float], int, list[float]]
NOTHING: Reading = (0, 0.0, [0.0, 0.0, 0.0], -1, [0.0, 0.0, 0.0])


@dataclasses.dataclass(eq=False)
class Before:
    """The state that a stop restores."""

    places: dict[Object, tuple[Object | None, Pose]]
    robot: tuple[float, float, float]
    records: dict[Footprint, np.void]
    targets: NDArray[np.float64]
    angles: NDArray[np.float64]


class World:
    """The robot, its wheels and sonars, the obstacles, and the state of the simulation.

    Args:
        name: of the scene.
        model: the robot.
        start: x, y (m) and heading (rad) of the robot's centre, its axle's middle.
        moving: whether the scene has moving obstacles.
        room: number of obstacles of the scene.
    """

    def __init__(
        self,
        name: str,
        model: Model,
        start: tuple[float, float, float],
        dynamics: str = "kinematic",
        actuators: str = "ideal",
        dt: float = CONTROL_PERIOD,
        moving: bool = False,
        room: int = 0,
    ) -> None:
        self.model = model
        self.scene = Scene(name)
        self.scene.placed, self.scene.turned = self._placed, self._turned
        self.wheels = models.build(self.scene, model)
        self.targets = np.zeros(len(self.wheels))  # rad/s
        self.angles = np.zeros(len(self.wheels))  # rad, (-pi, pi]
        self.speeds = np.zeros(len(self.wheels))  # rad/s, over the last pass
        self.drawings = Drawings()
        self.signals: dict[str, Any] = {}
        self.app_signals: dict[str, Any] = {}
        self.state = STOPPED
        self.time = 0.0
        self.passes = 0
        self.bounds: tuple[float, float, float, float] | None = None  # of the window, m
        self.trail: list[tuple[float, float]] = []  # of the robot's centre, every `_stride`-th pass
        self._stride = 1
        self.set_while_stopped = False  # whether a wheel was, since the last stop
        self._stop_requested = self._pause_requested = False
        self._before: Before | None = None
        self._shapes: list[Object] = []  # by the index of their obstacles
        self._echoes: dict[int, Reading] = {}
        self._ranges: NDArray[np.float64] | None = None  # of the lidar at the last pass, once read
        self._scanned = False  # whether a client reads the lidar
        self._sensed: Pose | None = None  # pose of the base at the last pass; None: no readings
        self._capacity = room + ROOM_FOR_OBSTACLES
        self.dynamics, self.actuators, self.dt = dynamics, actuators, dt
        self.task = Sandbox(model.robot, dynamics, actuators, dt, self._capacity, moving)
        self.batch = Batch(self.task, 1)
        self._results = Results(self.task, 1)
        self._generators = [np.random.default_rng(0)]
        self._state = self.batch.states[0]
        self._put(*start)

    def compile(self) -> None:
        """Compiles the kernels, by one step."""
        x, y, heading = self.robot_pose
        self.batch.step(self._generators, self._results)
        lidar.scan(self.batch.obstacles[0], 0, x, y, heading, lidar.ANGLES, lidar.REACH, np.empty(lidar.BEAMS))
        self._state["steps"] = 0
        self._put(x, y, heading)

    # Poses.

    @property
    def robot_pose(self) -> tuple[float, float, float]:
        """Returns x, y (m) and heading (rad) of the robot's centre."""
        s = self._state
        return float(s["x"]), float(s["y"]), float(s["heading"])

    @property
    def running(self) -> bool:
        """Returns whether the simulation advances."""
        return bool(self.state & ADVANCING)

    @property
    def stopping(self) -> bool:
        """Returns whether the simulation is stopped or stopping."""
        return self.state in (STOPPED, ABOUT_TO_STOP, LAST_BEFORE_STOP)

    def _placed(self, node: Object) -> Pose | None:
        """Returns the pose of an object that the plant moves; None for others."""
        if node is self.scene.base:
            x, y, heading = self.robot_pose
            ahead = self.model.ahead
            return frames.yawed(
                x - ahead * math.cos(heading), y - ahead * math.sin(heading), self.model.height, heading
            )
        if node.footprint is not None and node.footprint.index >= 0:
            record = self.batch.obstacles[0, node.footprint.index]
            heading = math.atan2(record["sin"], record["cos"])
            # an obstacle that has not moved keeps its pose to the last bit
            stored = node.pose
            if stored[0] == record["x"] and stored[1] == record["y"] and abs(frames.yaw_of(stored) - heading) < 1e-12:
                return stored
            return frames.yawed(float(record["x"]), float(record["y"]), stored[2], heading)
        return None

    def _turned(self, node: Object) -> float:
        return float(self.angles[node.wheel]) if node.wheel >= 0 else 0.0

    def _put(self, x: float, y: float, heading: float) -> None:
        """Puts the robot at rest at a pose of its centre, even inside an obstacle."""
        s = self._state
        steps = int(s["steps"])
        s["x"], s["y"], s["heading"] = x, y, wrap_angle(heading)
        # moving obstacles stay: the reset would put them at the start of their patrols
        places = self.batch.obstacles.copy()
        self.batch.reset(_ROW, self._generators, self._results)
        self.batch.obstacles[...] = places
        s["steps"] = steps
        s["clearance"] = self._clearance()
        self.speeds[:] = 0.0

    def _clearance(self) -> float:
        s = self._state
        pose = s["x"], s["y"], s["heading"]
        return clearance_of(self.model.robot, self.batch.obstacles[0], int(s["num_obstacles"]), pose)

    def arrange(self) -> None:
        """Copies the footprints of the scene into the plant, after a change of the obstacles."""
        self._keep_records()
        self._load()

    def _keep_records(self) -> None:
        for node in self._shapes:
            if node.footprint is not None:
                node.footprint.record = self.batch.obstacles[0, node.footprint.index].copy()

    def _load(self) -> None:
        for node in self._shapes:
            assert node.footprint is not None
            node.footprint.index = -1
        self._shapes = [node for node in self.scene.objects.values() if node.footprint is not None]
        if len(self._shapes) > self._capacity:
            raise ValueError(f"the scene has {self._capacity} obstacles, which is the most")
        for j, node in enumerate(self._shapes):
            footprint = node.footprint
            assert footprint is not None
            footprint.index = j
            self.batch.obstacles[0, j] = footprint.record
        self._state["num_obstacles"] = len(self._shapes)
        self._state["clearance"] = self._clearance()
        self._forget_contacts()

    def _forget_contacts(self) -> None:
        """Rebuilds the space of pymunk from the current poses."""
        if self.batch.plant is not None:
            self.batch.plant.reset(_ROW, self.batch.states, self.batch.obstacles)

    # Changes by clients.

    def add_obstacle(self, alias: str, footprint: Footprint, height: float, **settings: Any) -> Object:
        """Returns a new shape on the floor at its footprint."""
        if len(self._shapes) >= self._capacity:
            raise ValueError(f"the scene has {self._capacity} obstacles, which is the most")
        self.hold_readings()
        record = footprint.record
        heading = math.atan2(record["sin"], record["cos"])
        pose = frames.yawed(float(record["x"]), float(record["y"]), 0.5 * height, heading)
        new = self.scene.add(alias, 0, None, pose, footprint=footprint, **settings)
        self.arrange()
        return new

    def remove(self, nodes: Iterable[Object]) -> None:
        """Removes objects from the scene."""
        self.hold_readings()
        nodes = list(nodes)
        for node in nodes:
            self.scene.remove(node)
        if any(node.footprint is not None for node in nodes):
            self.arrange()

    def move(self, node: Object, pose: Pose) -> None:
        """Moves an object to a pose in the world; the robot stays upright at its height, and comes to rest."""
        self.hold_readings()
        if node is self.scene.base:
            heading = frames.yaw_of(pose)
            ahead = self.model.ahead
            self._put(pose[0] + ahead * math.cos(heading), pose[1] + ahead * math.sin(heading), heading)
            return
        if node.footprint is not None:
            heading = frames.yaw_of(pose)
            sine, cosine = sin_cos(heading)
            record = self.batch.obstacles[0, node.footprint.index]
            record["x"], record["y"], record["cos"], record["sin"] = pose[0], pose[1], cosine, sine
            record["patrol"] = 0  # an obstacle moved by a client leaves its patrol
            node.pose = pose
            self.arrange()
            return
        node.pose = frames.composed(frames.inverse(self.scene.frame(node.parent)), pose)

    def velocity(self, node: Object) -> tuple[Vector, Vector]:
        """Returns the linear and angular velocity of an object's origin in the world, after the last pass."""
        none = (0.0, 0.0, 0.0)
        if not self.running and self.state != PAUSED:
            return none, none
        moved = next((each for each in (node, *node.ancestors()) if self._placed(each) is not None), None)
        if moved is None:
            return none, none
        s = self._state
        if moved is self.scene.base:
            sine, cosine = math.sin(s["heading"]), math.cos(s["heading"])
            at = (float(s["x"]), float(s["y"]))
            vx, vy = float(cosine * s["vx"] - sine * s["vy"]), float(sine * s["vx"] + cosine * s["vy"])
            yaw_rate = float(s["yaw_rate"])
        else:
            at, (vx, vy, yaw_rate) = self._obstacle_motion(moved)
        x, y, *_ = self.scene.pose(node)
        # v + w x r
        return (vx - yaw_rate * (y - at[1]), vy + yaw_rate * (x - at[0]), 0.0), (0.0, 0.0, yaw_rate)

    def _obstacle_motion(self, node: Object) -> tuple[tuple[float, float], tuple[float, float, float]]:
        """Returns the centre and the velocity (vx, vy, yaw rate) of an obstacle."""
        footprint = node.footprint
        assert footprint is not None
        record = self.batch.obstacles[0, footprint.index]
        at = (float(record["x"]), float(record["y"]))
        if record["patrol"]["leg_time"] > 0.0:
            _, _, vx, vy = motion_at(record, float(self._state["steps"]) * self.dt)
            return at, (vx, vy, 0.0)
        if self.batch.plant is not None and record["mass"] > 0.0:
            body = self.batch.plant.bodies[0, footprint.index]
            return at, (float(body["vx"]), float(body["vy"]), float(body["yaw_rate"]))
        return at, (0.0, 0.0, 0.0)

    # Time.

    def start(self) -> None:
        """Starts a stopped simulation, or resumes a paused one."""
        if self.state == PAUSED:
            self.state = FIRST_AFTER_PAUSE
        if self.state != STOPPED:
            return
        self._before = Before(
            {
                node: (node.parent, node.pose if node.footprint is None else self.scene.pose(node))
                for node in self.scene.objects.values()
            },
            self.robot_pose,
            {
                node.footprint: self.batch.obstacles[0, node.footprint.index].copy()
                for node in self._shapes
                if node.footprint is not None
            },
            self.targets.copy(),
            self.angles.copy(),
        )
        self._state["steps"] = 0
        self._put(*self.robot_pose)
        self.time = 0.0
        self.state = FIRST
        self._stop_requested = self._pause_requested = False
        self._silence()
        self.trail, self._stride = [], 1
        self.set_while_stopped = False

    def stop(self) -> None:
        """Requests a stop, which takes three passes."""
        if self.state == PAUSED:
            self.state = ABOUT_TO_STOP
        elif self.running:
            self._stop_requested = True

    def pause(self) -> None:
        """Requests a pause, which takes two passes."""
        if self.running:
            self._pause_requested = True

    def advance(self) -> None:
        """Makes a pass: one time step of the plant, new sonar readings, time and state."""
        self.batch.actions[0] = self.targets
        self.batch.step(self._generators, self._results)
        s = self._state
        rolled = np.array([s["rolled_vx"], s["rolled_vy"], s["rolled_yaw_rate"]])
        self.speeds = (self.model.robot.wheel_matrix * rolled).sum(axis=1)
        self.angles = np.array([wrap_angle(angle) for angle in (self.angles + self.speeds * self.dt).tolist()])
        self._echoes, self._ranges = {}, None
        self._sensed = self.scene.pose(self.scene.base) if self.scene.base is not None else None
        self.time += self.dt
        self.passes += 1
        if self.passes % self._stride == 0:
            self.trail.append((float(s["x"]), float(s["y"])))
        if len(self.trail) >= MAX_TRAIL:
            del self.trail[::2]
            self._stride *= 2
        self._change_state()

    def _change_state(self) -> None:
        if self.state == LAST_BEFORE_STOP:
            self._restore()
            self.state = STOPPED
        elif self.state == ABOUT_TO_STOP:
            self.state = LAST_BEFORE_STOP
        elif self._stop_requested:
            self._stop_requested = self._pause_requested = False
            self.state = ABOUT_TO_STOP
        elif self.state == LAST_BEFORE_PAUSE:
            self.state = PAUSED
        elif self._pause_requested:
            self._pause_requested = False
            self.state = LAST_BEFORE_PAUSE
        else:
            self.state = RUNNING

    def _restore(self) -> None:
        """Restores the state before the start."""
        before = self._before
        assert before is not None
        self._before = None
        for node in [node for node in self.scene.objects.values() if node.created]:
            self.scene.remove(node)
        for node in list(self.scene.objects.values()):
            if node.part or node not in before.places:
                continue
            parent, pose = before.places[node]
            if parent is not node.parent and (parent is None or parent.handle in self.scene.objects):
                self.scene.attach(node, parent, keep=False)
            node.pose = pose
            if node.footprint is not None:
                node.footprint.record = before.records[node.footprint]
        self.targets[:] = before.targets
        self.angles[:] = before.angles
        self._load()
        self._state["steps"] = 0
        self._put(*before.robot)
        self._silence()

    # Sonars.

    def _silence(self) -> None:
        self._echoes, self._ranges = {}, None
        self._sensed = None

    def hold_readings(self) -> None:
        """Computes all readings of the last pass, before a client moves an object."""
        if self._sensed is None:
            return
        for node in self.scene.objects.values():
            if node.sonar is not None:
                self.reading(node)
        if self._scanned:
            self.scan()

    def reading(self, node: Object) -> Reading:
        """Returns a sonar's reading in the last pass: hit, distance, point, handle of the object, surface normal."""
        if node.handle not in self._echoes:
            if self._sensed is None:
                return NOTHING
            self._echoes[node.handle] = self._sense(node, self._sensed)
        return self._echoes[node.handle]

    def scan(self) -> NDArray[np.float64] | None:
        """Returns the distances (684,) of the lidar's beams in the last pass, m; None without a pass or a lidar."""
        if self._sensed is None or self.model.robot.holonomic:
            return None
        self._scanned = True
        if self._ranges is None:
            x, y, *_ = frames.composed(self._sensed, (self.model.ahead, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0))
            self._ranges = np.empty(lidar.BEAMS)
            heading, count = frames.yaw_of(self._sensed), len(self._shapes)
            obstacles = self.batch.obstacles[0]
            lidar.scan(obstacles, count, x, y, heading, lidar.ANGLES, lidar.REACH, self._ranges)
        return self._ranges

    def peek(self, node: Object, only: Object | None = None) -> Reading:
        """Returns the reading of a sonar at this moment, of all objects or of one."""
        assert self.scene.base is not None
        return self._sense(node, self.scene.pose(self.scene.base), only)

    def sense(self, node: Object) -> Reading:
        """Returns the reading of a sonar at this moment, and keeps it until the next pass."""
        reading = self.peek(node)
        if self.state != STOPPED:
            self._echoes[node.handle] = reading
        return reading

    def _sense(self, node: Object, base: Pose, only: Object | None = None) -> Reading:
        sonar = node.sonar
        assert sonar is not None
        x, y, _ = frames.composed(base, (sonar.x, sonar.y, 0.0, 0.0, 0.0, 0.0, 1.0))[:3]
        shapes = self._shapes if only is None else [each for each in self._shapes if each is only]
        obstacles = [
            self.batch.obstacles[0, each.footprint.index].item() for each in shapes if each.footprint is not None
        ]
        echo = sonars.echo(x, y, frames.yaw_of(base) + sonar.bearing, obstacles)
        if echo is None:
            return NOTHING
        distance, aside, normal, j = echo
        point = [distance * math.sin(aside), 0.0, distance * math.cos(aside)]
        return 1, distance, point, shapes[j].handle, [math.sin(normal), 0.0, math.cos(normal)]
