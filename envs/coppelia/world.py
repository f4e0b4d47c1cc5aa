"""A robot in a scene, and time: one pass at a time, on the kinematic plant or on pymunk."""

import dataclasses
import math
from collections.abc import Iterable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from wayfield.envs.batch import Batch, Results
from wayfield.envs.coppelia import frames, models, sonars
from wayfield.envs.coppelia.constants import (
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
from wayfield.envs.coppelia.drawing import Drawings
from wayfield.envs.coppelia.frames import Pose, Vector
from wayfield.envs.coppelia.models import Model
from wayfield.envs.coppelia.scene import Footprint, Object, Scene
from wayfield.envs.geometry import sin_cos, wrap_angle
from wayfield.envs.hulls import clearance_of
from wayfield.envs.patrols import patrol_at
from wayfield.envs.sandbox import Sandbox
from wayfield.envs.task import CONTROL_PERIOD

ROOM_FOR_OBSTACLES = 1024  # besides those of the scene
MAX_WHEEL_TARGET = 1e6  # rad/s; a wheel that is asked for more is asked for this
_ROW = np.zeros(1, np.int64)

Reading = tuple[int, float, list[float], int, list[float]]
NOTHING: Reading = (0, 0.0, [0.0, 0.0, 0.0], -1, [0.0, 0.0, 0.0])


@dataclasses.dataclass(eq=False)
class Before:
    """What a stop brings back."""

    places: dict[Object, tuple[Object | None, Pose]]
    robot: tuple[float, float, float]
    records: dict[Footprint, np.void]
    targets: NDArray[np.float64]
    angles: NDArray[np.float64]


class World:
    """The robot, its wheels and sonars, what stands around it, and the state of the simulation.

    Args:
        name: of the scene.
        model: the robot.
        start: x, y (m) and heading (rad) of the robot's centre, its axle's middle.
        moving: whether the scene has obstacles that move by a script.
        room: how many obstacles it has.
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
        self.bounds: tuple[float, float, float, float] | None = None  # that a window shows, m
        self.trail: list[tuple[float, float]] = []
        self._stop_asked = self._pause_asked = False
        self._before: Before | None = None
        self._shapes: list[Object] = []  # by the index of their obstacles
        self._echoes: dict[int, Reading] = {}
        self._sensed: Pose | None = None  # the base's pose that the readings are of; None: nothing has been sensed
        self.moving = moving
        self._capacity = room + ROOM_FOR_OBSTACLES
        self._drive_with(dynamics, actuators, dt)
        self._put(*start)

    def _drive_with(self, dynamics: str, actuators: str, dt: float) -> None:
        self.dynamics, self.actuators, self.dt = dynamics, actuators, dt
        self.task = Sandbox(self.model.robot, dynamics, actuators, dt, self._capacity, self.moving)
        self.batch = Batch(self.task, 1)
        self._results = Results(self.task, 1)
        self._generators = [np.random.default_rng(0)]
        self._state = self.batch.states[0]

    def set_dt(self, dt: float) -> None:
        """Changes the time step of a stopped simulation."""
        start = self.robot_pose
        self._keep_records()
        self._drive_with(self.dynamics, self.actuators, dt)
        self._load()
        self._put(*start)

    def compile(self) -> None:
        """Runs what is compiled, once."""
        x, y, heading = self.robot_pose
        self.batch.step(self._generators, self._results)
        self._state["steps"] = 0
        self._put(x, y, heading)

    # Where things are.

    @property
    def robot_pose(self) -> tuple[float, float, float]:
        """Returns x, y (m) and heading (rad) of the robot's centre."""
        s = self._state
        return float(s["x"]), float(s["y"]), float(s["heading"])

    @property
    def running(self) -> bool:
        """Returns whether passes are to be made."""
        return bool(self.state & ADVANCING)

    @property
    def stopping(self) -> bool:
        """Returns whether the simulation is stopped or about to be."""
        return self.state in (STOPPED, ABOUT_TO_STOP, LAST_BEFORE_STOP)

    def _placed(self, node: Object) -> Pose | None:
        """Returns the pose of what the plant moves; None for the rest."""
        if node is self.scene.base:
            x, y, heading = self.robot_pose
            ahead = self.model.ahead
            return frames.yawed(
                x - ahead * math.cos(heading), y - ahead * math.sin(heading), self.model.height, heading
            )
        if node.footprint is not None and node.footprint.index >= 0:
            record = self.batch.obstacles[0, node.footprint.index]
            heading = math.atan2(record["sin"], record["cos"])
            # an upright thing that has not been moved keeps its pose to the last bit
            stored = node.pose
            if stored[0] == record["x"] and stored[1] == record["y"] and abs(frames.yaw_of(stored) - heading) < 1e-12:
                return stored
            return frames.yawed(float(record["x"]), float(record["y"]), stored[2], heading)
        return None

    def _turned(self, node: Object) -> float:
        return float(self.angles[node.wheel]) if node.wheel >= 0 else 0.0

    def _put(self, x: float, y: float, heading: float) -> None:
        """Puts the robot at rest at a pose of its centre, whatever is there."""
        s = self._state
        steps = int(s["steps"])
        s["x"], s["y"], s["heading"] = x, y, wrap_angle(heading)
        # what moves by a script stays on its way: the reset would take it back to where that begins
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
        """Puts the footprints of the scene into the plant, after one came, went or was moved."""
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
        self.task.patrols[...] = 0
        for j, node in enumerate(self._shapes):
            footprint = node.footprint
            assert footprint is not None
            footprint.index = j
            self.batch.obstacles[0, j] = footprint.record
            if footprint.patrol is not None:
                self.task.patrols[0, j] = footprint.patrol
        self._state["num_obstacles"] = len(self._shapes)
        self._state["clearance"] = self._clearance()
        self._forget_contacts()

    def _forget_contacts(self) -> None:
        """Makes pymunk build its space anew, from where everything is now."""
        if self.batch.plant is not None:
            self.batch.plant.reset(_ROW, self.batch.states, self.batch.obstacles)

    # What clients change.

    def add_obstacle(self, alias: str, footprint: Footprint, height: float, **settings: Any) -> Object:
        """Returns a new shape that stands on the floor where its footprint is."""
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
        """Takes objects out of the scene."""
        self.hold_readings()
        nodes = list(nodes)
        for node in nodes:
            self.scene.remove(node)
        if any(node.footprint is not None for node in nodes):
            self.arrange()

    def move(self, node: Object, pose: Pose) -> None:
        """Puts an object at a pose in the world; the robot keeps its height and stays upright, and comes to rest."""
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
            node.pose = pose
            if node.footprint.patrol is not None:
                node.footprint.patrol = None  # moved by hand, it stays where it was put
            self.arrange()
            return
        node.pose = frames.composed(frames.inverse(self.scene.frame(node.parent)), pose)

    def velocity(self, node: Object) -> tuple[Vector, Vector]:
        """Returns linear and angular velocity in the world of an object's origin, as the last pass left them."""
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
        """Returns the centre of an obstacle and its velocity, if it is pushed or moves by a script."""
        footprint = node.footprint
        assert footprint is not None
        record = self.batch.obstacles[0, footprint.index]
        at = (float(record["x"]), float(record["y"]))
        if footprint.patrol is not None and footprint.patrol["leg_time"] > 0.0:
            _, _, vx, vy = patrol_at(footprint.patrol, float(self._state["steps"]) * self.dt)
            return at, (vx, vy, 0.0)
        if self.batch.plant is not None and record["mass"] > 0.0:
            body = self.batch.plant.bodies[0, footprint.index]
            return at, (float(body["vx"]), float(body["vy"]), float(body["yaw_rate"]))
        return at, (0.0, 0.0, 0.0)

    # Time.

    def start(self) -> None:
        """Starts a stopped simulation, or goes on with a paused one."""
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
        self._patrols = {node: node.footprint.patrol for node in self._shapes if node.footprint is not None}
        self._state["steps"] = 0
        self._put(*self.robot_pose)
        self.time = 0.0
        self.state = FIRST
        self._stop_asked = self._pause_asked = False
        self._silence()
        self.trail = []

    def stop(self) -> None:
        """Asks a simulation to stop, which it has after three more passes."""
        if self.state == PAUSED:
            self.state = ABOUT_TO_STOP
        elif self.running:
            self._stop_asked = True

    def pause(self) -> None:
        """Asks a running simulation to pause, which it has after two more passes."""
        if self.running:
            self._pause_asked = True

    def advance(self) -> None:
        """Makes a pass: the wheels turn for one time step, sonars see, time goes on, the state changes."""
        self.batch.actions[0] = self.targets
        self.batch.step(self._generators, self._results)
        s = self._state
        rolled = np.array([s["rolled_vx"], s["rolled_vy"], s["rolled_yaw_rate"]])
        self.speeds = (self.model.robot.wheel_matrix * rolled).sum(axis=1)
        self.angles = np.array([wrap_angle(angle) for angle in (self.angles + self.speeds * self.dt).tolist()])
        self._echoes = {}
        self._sensed = self.scene.pose(self.scene.base) if self.scene.base is not None else None
        self.time += self.dt
        self.passes += 1
        if len(self.trail) < 100_000:
            self.trail.append((float(s["x"]), float(s["y"])))
        self._change_state()

    def _change_state(self) -> None:
        if self.state == LAST_BEFORE_STOP:
            self._restore()
            self.state = STOPPED
        elif self.state == ABOUT_TO_STOP:
            self.state = LAST_BEFORE_STOP
        elif self._stop_asked:
            self._stop_asked = self._pause_asked = False
            self.state = ABOUT_TO_STOP
        elif self.state == LAST_BEFORE_PAUSE:
            self.state = PAUSED
        elif self._pause_asked:
            self._pause_asked = False
            self.state = LAST_BEFORE_PAUSE
        else:
            self.state = RUNNING

    def _restore(self) -> None:
        """Brings back what was there before the start."""
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
                node.footprint.patrol = self._patrols.get(node)
        self.targets[:] = before.targets
        self.angles[:] = before.angles
        self._load()
        self._state["steps"] = 0
        self._put(*before.robot)
        self._silence()

    # Sonars.

    def _silence(self) -> None:
        self._echoes = {}
        self._sensed = None

    def hold_readings(self) -> None:
        """Senses with all sonars what has not been read yet of the last pass, before something is moved by hand."""
        if self._sensed is None:
            return
        for node in self.scene.objects.values():
            if node.sonar is not None:
                self.reading(node)

    def reading(self, node: Object) -> Reading:
        """Returns what a sonar sensed in the last pass: whether, how far, where, what, and the surface's normal."""
        if node.handle not in self._echoes:
            if self._sensed is None:
                return NOTHING
            self._echoes[node.handle] = self._sense(node, self._sensed)
        return self._echoes[node.handle]

    def peek(self, node: Object, only: Object | None = None) -> Reading:
        """Returns what a sonar would sense now, of everything or of one object alone."""
        assert self.scene.base is not None
        return self._sense(node, self.scene.pose(self.scene.base), only)

    def sense(self, node: Object) -> Reading:
        """Returns what a sonar senses now, which is its reading until the next pass."""
        reading = self.peek(node)
        if self.state != STOPPED:
            self._echoes[node.handle] = reading
        return reading

    def reset_reading(self, node: Object) -> None:
        """Makes a sonar read nothing until the next pass."""
        self._echoes[node.handle] = NOTHING

    def _sense(self, node: Object, base: Pose, only: Object | None = None) -> Reading:
        sonar = node.sonar
        assert sonar is not None
        x, y, _ = frames.composed(base, (sonar.x, sonar.y, 0.0, 0.0, 0.0, 0.0, 1.0))[:3]
        shapes = self._shapes if only is None else [each for each in self._shapes if each is only]
        obstacles = [
            self.batch.obstacles[0, each.footprint.index].item() for each in shapes if each.footprint is not None
        ]
        found = sonars.echo(x, y, frames.yaw_of(base) + sonar.bearing, obstacles)
        if found is None:
            return NOTHING
        distance, aside, normal, j = found
        point = [distance * math.sin(aside), 0.0, distance * math.cos(aside)]
        return 1, distance, point, shapes[j].handle, [math.sin(normal), 0.0, math.cos(normal)]
