"""The MuJoCo plant: the robot's model in three dimensions in an engine that is not of this project.

The tier shapes the command as in the other plants; the wheels' servos follow it, and MuJoCo does the rest. What a
disturbance does to the wheels and to their grip is in the speeds that they are sent, what it does to the pose is a
displacement, as in the other plants. Every robot has a model of its own, with what stands around it.
"""

import functools
import math
import os
import warnings
from typing import Any

import numpy as np
from numpy.typing import NDArray

from wayfield.envs.pymunk_plant import FLOOR_FRICTION, twist_between_poses
from wayfield.envs.robots import Robot
from wayfield.envs.robots.hulls import hull_clearance
from wayfield.envs.robots.kinematic_plant import body_twist, lagging_twist
from wayfield.envs.robots.mjcf import TIMESTEP, mjcf
from wayfield.envs.robots.records import ROBOT_PARAMS, ROBOT_STATE, lag_factors, part_of
from wayfield.envs.robots.response import respond
from wayfield.envs.robots.sensing import advance_odometry
from wayfield.envs.tasks.stepping import Robots
from wayfield.envs.tasks.task import Task
from wayfield.envs.world.grids import FRAME, Grids
from wayfield.envs.world.movers import motion_at, moves
from wayfield.system.compiled import any_layout, compiled
from wayfield.system.elementary import wrap_angle

try:
    import mujoco
except ModuleNotFoundError:
    raise
except Exception as error:  # of an OpenGL that MUJOCO_GL names and that is not there
    raise ImportError(f"mujoco cannot be imported with MUJOCO_GL={os.environ.get('MUJOCO_GL')}: {error}") from None

MAJOR = "4"  # of MuJoCo's versions: another one may move otherwise
if mujoco.__version__.partition(".")[0] != MAJOR:
    raise ImportError(
        f'dynamics="mujoco" needs mujoco {MAJOR}, {mujoco.__version__} is installed: pip install "mujoco=={MAJOR}.*"'
    )
SETTLING = 1000  # sub-steps, after which a robot stands on its wheels
_REACH = 0.05  # m, by which more than its own way a hull may come near something within a period
_STATE = mujoco.mjtState.mjSTATE_INTEGRATION


@any_layout
@compiled
def command_rows(params, states, actions, skip, factors, twists, speeds):
    """Turns the wheels of all robots on by a control period, but of those in `skip`.

    Args:
        factors: (2,) of the lag over a sub-step: see `records.lag_factors`.
        twists: (b, 3) gets the mean twist that the wheels turn for.
        speeds: (b, k, n) gets the mean speed of each wheel in each of k sub-steps, rad/s.
    """
    p = params[0]
    count = speeds.shape[1]
    step = p.dt / count
    for i in range(states.shape[0]):
        if skip[i]:
            continue
        s = states[i]
        twists[i] = 0.0
        for k in range(count):
            if p.responds:
                vx, vy, yaw_rate = respond(p, s, actions, i, k * step, (k + 1) * step)
            else:
                vx, vy, yaw_rate = lagging_twist(s, factors[1])
                s.wheel_vx, s.wheel_vy, s.wheel_yaw_rate = lagging_twist(s, factors[0])
            twists[i, 0] += vx / count
            twists[i, 1] += vy / count
            twists[i, 2] += yaw_rate / count
            vx, vy, yaw_rate = body_twist(p, vx, vy, yaw_rate)
            for n in range(speeds.shape[2]):
                m = p.wheel_matrix[n]
                speeds[i, k, n] = m[0] * vx + m[1] * vy + m[2] * yaw_rate


@any_layout
@compiled
def place_movers(params, states, obstacles, i, time, places):
    """Puts into places (m, 2) where the obstacles of robot i that move are, `time` (s) after its period began."""
    s = states[i]
    for j in range(s.num_obstacles):
        if moves(obstacles[i, j]):
            places[j, 0], places[j, 1], _, _ = motion_at(obstacles[i, j], s.steps * params[0].dt + time)


@any_layout
@compiled
def finish_rows(params, states, obstacles, grids, noise, skip, before, twists, slips):
    """Ends the control period of all robots but those in `skip`: clearance, contact, odometry.

    Args:
        before: (b, 3) the poses at which it began.
        twists: (b, 3) the mean twists that the wheels were to turn for.
        slips: (b, n) by how much less each wheel has turned on average, rad/s.
    """
    robots = Robots(params, states, obstacles, noise, grids)
    p = params[0]
    for i in range(states.shape[0]):
        if skip[i]:
            continue
        s = states[i]
        s.clearance = hull_clearance(p, robots, i, s, s.x, s.y, s.heading)
        if s.clearance < 0.0:
            s.contact = 1
        if p.perfect_pose:
            continue
        vx, vy, yaw_rate = twists[i]
        for n in range(slips.shape[1]):
            vx -= p.forward_matrix[0, n] * slips[i, n]
            vy -= p.forward_matrix[1, n] * slips[i, n]
            yaw_rate -= p.forward_matrix[2, n] * slips[i, n]
        if p.passive_encoders:
            x, y, heading = before[i]
            vx, vy, yaw_rate = twist_between_poses(x, y, heading, s.x, s.y, s.heading, p.dt)
        advance_odometry(p, s, vx, vy, yaw_rate, noise, i, s.noise_row if noise.shape[1] > 1 else 0)


@functools.lru_cache(maxsize=64)
def model_of(xml: str) -> Any:
    """Returns MuJoCo's model of an MJCF; worlds of the same one share it."""
    return mujoco.MjModel.from_xml_string(xml)


@functools.cache
def standing(robot: Robot, wheels: str | None) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Returns positions and warm start of a robot that stands on its wheels, at the origin, heading along x."""
    model = model_of(mjcf(robot, wheels))
    data = mujoco.MjData(model)
    mujoco.mj_step(model, data, SETTLING)
    data.qpos[:2] = 0.0
    return data.qpos.copy(), data.qacc_warmstart.copy()


def _turned(quaternion: NDArray[np.float64], yaw: float) -> NDArray[np.float64]:
    """Returns a rotation with one about the vertical after it."""
    product = np.empty(4)
    mujoco.mju_mulQuat(product, np.array([math.cos(0.5 * yaw), 0.0, 0.0, math.sin(0.5 * yaw)]), quaternion)
    return product


def yaw_of(quaternion: NDArray[np.float64]) -> float:
    """Returns the heading (rad) of a rotation (4,)."""
    w, x, y, z = quaternion.tolist()
    return math.atan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z))


class World:
    """MuJoCo's model and state of a robot and of what stands around it.

    Attributes:
        data: MuJoCo's MjData.
        pose: (3,) of the robot, as it was last read or put.
    """

    def __init__(
        self, robot: Robot, wheels: str | None, pose: NDArray[np.float64], obstacles: NDArray[np.void], grid: Any
    ) -> None:
        self._made_of = (robot, wheels, pose.copy(), obstacles.copy(), grid)
        self.model = model_of(mjcf(robot, wheels, obstacles, grid, FLOOR_FRICTION))
        self.data = mujoco.MjData(self.model)
        self.pose = pose.copy()
        built = len(robot.built)
        self.axles = built // len(robot.wheels)  # wheels that turn alike
        positions, warm = standing(robot, wheels)
        self.turns = slice(7, len(positions), (len(positions) - 7) // built)  # angles of wheels, past those of rollers
        self.data.qpos[: len(positions)] = positions
        self.data.qpos[:2] = pose[:2]
        self.data.qpos[3:7] = _turned(positions[3:7], float(pose[2]))
        self.data.qacc_warmstart[: len(warm)] = warm
        moving = obstacles["patrol"]["leg_time"] > 0.0
        self.movers = np.flatnonzero(moving)
        self.things = np.flatnonzero(~moving & (obstacles["mass"] > 0.0))
        self.reach = float(robot.wheel_radii.max())
        self.hull = self.model.geom("hull").id
        self.bodies = [self.model.body(f"thing{j}").id for j in self.things]

    def put(self, pose: NDArray[np.float64]) -> None:
        """Displaces the robot to a pose, if it is not there; it keeps its twist."""
        if (pose == self.pose).all():
            return
        own, velocity = self.data.qpos, self.data.qvel
        turn = float(pose[2] - self.pose[2])
        own[:2] += pose[:2] - self.pose[:2]
        own[3:7] = _turned(own[3:7].copy(), turn)
        c, s = math.cos(turn), math.sin(turn)
        velocity[:2] = c * velocity[0] - s * velocity[1], s * velocity[0] + c * velocity[1]

    def wheels(self) -> NDArray[np.float64]:
        """Returns the angles (n,) of the driven wheels, rad."""
        turned = np.array(self.data.qpos[self.turns])
        return turned if self.axles == 1 else turned.reshape(-1, self.axles).mean(axis=1)

    def step(self, speeds: NDArray[np.float64], near: bool, movers: Any) -> bool:
        """Drives the wheels at speeds (k, wheels) in k sub-steps; returns whether the hull has touched something.

        Args:
            near: whether it may.
            movers: movers(k) puts what moves where it is after k sub-steps; None: nothing moves.
        """
        model, data = self.model, self.data
        if self.axles > 1:
            speeds = np.repeat(speeds, self.axles, axis=1)
        if not near and movers is None and (speeds == speeds[0]).all():
            data.ctrl[:] = speeds[0]
            mujoco.mj_step(model, data, len(speeds))
            return False
        touched = False
        for k, each in enumerate(speeds):
            data.ctrl[:] = each
            if movers is not None:
                movers(k + 1)
            mujoco.mj_step(model, data)
            touched = touched or (near and bool((data.contact.geom == self.hull).any()))
        return touched

    def read(self, state: NDArray[np.void]) -> None:
        """Writes pose and twist of the robot into its state."""
        own, velocity = self.data.qpos, self.data.qvel
        heading = wrap_angle(yaw_of(own[3:7]))
        self.pose[:] = own[0], own[1], heading
        c, s = math.cos(heading), math.sin(heading)
        state["x"], state["y"], state["heading"] = self.pose.tolist()
        state["vx"] = c * velocity[0] + s * velocity[1]
        state["vy"] = c * velocity[1] - s * velocity[0]
        state["yaw_rate"] = velocity[5]

    def read_things(self, obstacles: NDArray[np.void]) -> None:
        """Writes where pushed things are."""
        for j, body in zip(self.things.tolist(), self.bodies, strict=True):
            heading = yaw_of(self.data.xquat[body])
            obstacles["x"][j], obstacles["y"][j] = self.data.xpos[body, :2].tolist()
            obstacles["cos"][j], obstacles["sin"][j] = math.cos(heading), math.sin(heading)

    def __reduce__(self) -> tuple[Any, ...]:
        state = np.empty(mujoco.mj_stateSize(self.model, _STATE))
        mujoco.mj_getState(self.model, self.data, state, _STATE)
        return World, self._made_of, (state, self.pose)

    def __setstate__(self, state: tuple[NDArray[np.float64], NDArray[np.float64]]) -> None:
        physics, self.pose = state
        mujoco.mj_setState(self.model, self.data, physics, _STATE)


class MujocoPlant:
    """Drives a batch of robots, each world in a MuJoCo model of its own, built when it first moves.

    Attributes:
        worlds: the `World` of each robot; None where it has not moved since the reset.

    Raises:
        ValueError: if the robot cannot be built.
    """

    def __init__(self, task: Task, num_envs: int) -> None:
        options = task.options
        self.task = task
        self.wheels = options.wheels
        self.worlds: list[World | None] = [None] * num_envs
        mjcf(task.robot, self.wheels)  # refuses what cannot be built
        self.count = round(options.dt / TIMESTEP)
        self.factors = np.array(lag_factors(options.actuators.lag, options.dt / self.count))
        self.twists = np.zeros((num_envs, 3))
        self.speeds = np.zeros((num_envs, self.count, len(task.robot.wheels)))
        self.before = np.zeros((num_envs, 3))
        self.slips = np.zeros((num_envs, len(task.robot.wheels)))
        self.places = np.zeros((task.max_obstacles, 2))
        self._parts: tuple[Any, ...] | None = None

    def __getstate__(self) -> dict[str, Any]:
        return self.__dict__ | {"_parts": None}  # views of arrays that are made anew

    def _views(self, states: NDArray[np.void]) -> tuple[Any, ...]:
        """Returns what a plant reads of a task's records, so that one kernel does for all tasks."""
        if self._parts is None or self._parts[0] is not states:
            task = self.task
            grids = Grids(part_of(task.grids.frames, FRAME), task.grids.cells)
            self._parts = states, part_of(task.params, ROBOT_PARAMS), part_of(states, ROBOT_STATE), grids
        return self._parts[1:]

    def reset(self, rows: NDArray[np.int64], states: NDArray[np.void], obstacles: NDArray[np.void]) -> None:
        """Forgets the worlds of the robots in `rows`."""
        del states, obstacles
        for i in rows.tolist():
            self.worlds[i] = None

    def _world(self, i: int, states: NDArray[np.void], obstacles: NDArray[np.void]) -> World:
        """Returns the world of robot i, built where it and its obstacles are."""
        count = int(self.task.obstacle_counts(states[i : i + 1])[0])
        grid = getattr(self.task.scenarios[states[i]["scenario"]], "grid", None)
        world = World(self.task.robot, self.wheels, self.before[i], obstacles[i, :count], grid)
        self.worlds[i] = world
        return world

    def drive(
        self,
        states: NDArray[np.void],
        obstacles: NDArray[np.void],
        actions: NDArray[np.float64],
        noise: NDArray[np.float64],
        skip: NDArray[np.bool_],
    ) -> None:
        """Moves every robot that is not in `skip` by one control period."""
        params, robots, grids = self._views(states)
        for k, name in enumerate(("x", "y", "heading")):
            self.before[:, k] = states[name]
        command_rows(params, robots, actions, skip, self.factors, self.twists, self.speeds)
        for i in np.flatnonzero(~skip).tolist():
            world = self.worlds[i] or self._world(i, states, obstacles)
            self._drive(i, world, states, obstacles, robots, params)
        finish_rows(params, robots, obstacles, grids, noise, skip, self.before, self.twists, self.slips)

    def _drive(
        self,
        i: int,
        world: World,
        states: NDArray[np.void],
        obstacles: NDArray[np.void],
        robots: NDArray[np.void],
        params: NDArray[np.void],
    ) -> None:
        """Moves robot i by one control period."""
        dt, speeds = self.task.options.dt, self.speeds[i]
        movers = None
        if len(world.movers):

            def movers(k: int) -> None:
                place_movers(params, robots, obstacles, i, k * dt / self.count, self.places)
                world.data.mocap_pos[:, :2] = self.places[world.movers]

        world.put(self.before[i])
        travel = dt * float(np.abs(speeds).max()) * world.reach + _REACH
        near = len(world.things) > 0 or bool(states["clearance"][i] < travel)
        angles = world.wheels()
        touched = world.step(speeds, near, movers)
        self.slips[i] = speeds.mean(axis=0) - (world.wheels() - angles) / dt
        world.read(states[i])
        states["contact"][i] |= touched
        if len(world.things):
            world.read_things(obstacles[i])

    def frame(self, i: int = 0, size: tuple[int, int] = (640, 480)) -> NDArray[np.uint8]:
        """Returns MuJoCo's own picture (h, w, 3) of the world of robot i, once that has moved.

        Raises:
            ValueError: if it has not.
            RuntimeError: without OpenGL.
        """
        world = self.worlds[i]
        if world is None:
            raise ValueError(f"robot {i} has not moved since its reset: MuJoCo's picture needs a step")
        return picture(world.model, world.data, size, world.pose, 4.0)


def picture(
    model: Any, data: Any, size: tuple[int, int], pose: NDArray[np.float64], distance: float
) -> NDArray[np.uint8]:
    """Returns MuJoCo's picture (h, w, 3) of what is around a pose, from a distance (m) behind it.

    Raises:
        RuntimeError: without OpenGL, in one line.
    """
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            renderer = mujoco.Renderer(model, size[1], size[0])
    except Exception as error:  # what is missing differs by platform
        raise RuntimeError(
            "MuJoCo's pictures need OpenGL, which is not there; without a display set MUJOCO_GL=egl or osmesa"
        ) from error
    try:
        camera = mujoco.MjvCamera()
        camera.lookat[:] = pose[0], pose[1], 0.1
        camera.distance, camera.azimuth, camera.elevation = distance, math.degrees(pose[2]) + 40.0, -25.0
        mujoco.mj_forward(model, data)
        renderer.update_scene(data, camera)
        pixels: NDArray[np.uint8] = renderer.render()
        return pixels
    finally:
        renderer.close()


def portrait(robot: Robot, wheels: str | None, size: tuple[int, int] = (960, 720)) -> NDArray[np.uint8]:
    """Returns MuJoCo's picture (h, w, 3) of a robot that stands on the floor; errors as of `picture`."""
    model = model_of(mjcf(robot, wheels))
    data = mujoco.MjData(model)
    data.qpos[:] = standing(robot, wheels)[0]
    return picture(model, data, size, np.zeros(3), 5.0 * robot.hull_radius)
