"""The MuJoCo plant: the robot's model in three dimensions in an engine that is not of this project.

The tier shapes the command as in the other plants; the wheels' servos follow it, and MuJoCo does the rest. What a
disturbance does to the wheels and to their grip is in the speeds that they are sent, what it does to the pose is a
displacement, as in the other plants. Every world has a model of its own: its robots, and what stands around them.
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
from wayfield.envs.robots.mjcf import TIMESTEP, mjcf, prefixes
from wayfield.envs.robots.records import ROBOT_PARAMS, ROBOT_STATE, Array, Flags, Records, lag_factors, part_of
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
    """MuJoCo's model and state of robots and of what stands around them.

    Attributes:
        data: MuJoCo's MjData.
        poses: (n, 3) of the robots, as they were last read or put.
    """

    def __init__(
        self, robot: Robot, wheels: str | None, poses: NDArray[np.float64], obstacles: NDArray[np.void], grid: Any
    ) -> None:
        self._made_of = (robot, wheels, poses.copy(), obstacles.copy(), grid)
        count = len(poses)
        self.model = model_of(mjcf(robot, wheels, obstacles, grid, FLOOR_FRICTION, count))
        self.data = mujoco.MjData(self.model)
        self.poses = poses.copy()
        built = len(robot.built)
        self.axles = built // len(robot.wheels)  # wheels that turn alike
        positions, warm = standing(robot, wheels)
        size = len(positions)
        self.turns = slice(7, size, (size - 7) // built)  # angles of wheels, past those of rollers
        # a row a robot; pushed things lie behind them
        self.own, self.velocities, self.warm = (
            whole[: count * each].reshape(count, each)
            for whole, each in (
                (self.data.qpos, size),
                (self.data.qvel, len(warm)),
                (self.data.qacc_warmstart, len(warm)),
            )
        )
        self.own[:], self.warm[:] = positions, warm
        self.own[:, :2] = poses[:, :2]
        for own, pose in zip(self.own, poses, strict=True):
            own[3:7] = _turned(positions[3:7], float(pose[2]))
        moving = obstacles["patrol"]["leg_time"] > 0.0
        self.movers = np.flatnonzero(moving)
        self.things = np.flatnonzero(~moving & (obstacles["mass"] > 0.0))
        self.reach = float(robot.wheel_radii.max())
        self.hulls = np.array([self.model.geom(f"{prefix}hull").id for prefix in prefixes(count)])
        self.bodies = [self.model.body(f"thing{j}").id for j in self.things]

    def take(self, other: "World", pairs: list[tuple[int, int]]) -> None:
        """Takes over the state of another world of the same things.

        Args:
            pairs: robots here and there that are the same; each other one stands where it was put.
        """
        for mine, theirs in pairs:
            self.poses[mine] = other.poses[theirs]
            for here, there in (
                (self.own, other.own),
                (self.velocities, other.velocities),
                (self.warm, other.warm),
            ):
                here[mine] = there[theirs]
        for name, here, there in (
            ("qpos", self.own, other.own),
            ("qvel", self.velocities, other.velocities),
            ("qacc_warmstart", self.warm, other.warm),
        ):
            getattr(self.data, name)[here.size :] = getattr(other.data, name)[there.size :]

    def put(self, poses: NDArray[np.float64]) -> None:
        """Displaces robots to poses (n, 3), where they are not there; they keep their twists."""
        for k in np.flatnonzero((poses != self.poses).any(axis=1)).tolist():
            own, velocity = self.own[k], self.velocities[k]
            turn = float(poses[k, 2] - self.poses[k, 2])
            own[:2] += poses[k, :2] - self.poses[k, :2]
            own[3:7] = _turned(own[3:7].copy(), turn)
            c, s = math.cos(turn), math.sin(turn)
            velocity[:2] = c * velocity[0] - s * velocity[1], s * velocity[0] + c * velocity[1]

    def wheels(self) -> NDArray[np.float64]:
        """Returns the angles (n, wheels) of the driven wheels, rad."""
        turned = np.array(self.own[:, self.turns])
        return turned if self.axles == 1 else turned.reshape(len(turned), -1, self.axles).mean(axis=2)

    def step(self, speeds: NDArray[np.float64], near: bool, movers: Any) -> NDArray[np.bool_]:
        """Drives the wheels at speeds (n, k, wheels) in k sub-steps; returns whose hull (n,) has touched what stands.

        Args:
            near: whether one may.
            movers: movers(k) puts what moves where it is after k sub-steps; None: nothing moves.
        """
        model, data = self.model, self.data
        if self.axles > 1:
            speeds = np.repeat(speeds, self.axles, axis=2)
        controls = speeds.transpose(1, 0, 2).reshape(speeds.shape[1], -1)
        touched = np.zeros(len(speeds), np.bool_)
        if not near and movers is None and (controls == controls[0]).all():
            data.ctrl[:] = controls[0]
            mujoco.mj_step(model, data, len(controls))
            return touched
        for k, each in enumerate(controls):
            data.ctrl[:] = each
            if movers is not None:
                movers(k + 1)
            mujoco.mj_step(model, data)
            if near:
                pairs = data.contact.geom
                others = ~np.isin(pairs, self.hulls).all(axis=1)  # the task decides when two robots touch
                touched |= np.isin(self.hulls, pairs[others])
        return touched

    def read(self, states: NDArray[np.void], rows: NDArray[np.int64]) -> None:
        """Writes poses and twists of the robots into their rows."""
        for k, i in enumerate(rows.tolist()):
            own, velocity, state = self.own[k], self.velocities[k], states[i]
            heading = wrap_angle(yaw_of(own[3:7]))
            self.poses[k] = own[0], own[1], heading
            c, s = math.cos(heading), math.sin(heading)
            state["x"], state["y"], state["heading"] = self.poses[k].tolist()
            state["vx"] = c * velocity[0] + s * velocity[1]
            state["vy"] = c * velocity[1] - s * velocity[0]
            state["yaw_rate"] = velocity[5]

    def read_things(self, obstacles: NDArray[np.void], rows: NDArray[np.int64]) -> None:
        """Writes where pushed things are, into the rows of all robots."""
        for j, body in zip(self.things.tolist(), self.bodies, strict=True):
            heading = yaw_of(self.data.xquat[body])
            x, y = self.data.xpos[body, :2].tolist()
            for name, value in (("x", x), ("y", y), ("cos", math.cos(heading)), ("sin", math.sin(heading))):
                obstacles[name][rows, j] = value

    def __reduce__(self) -> tuple[Any, ...]:
        state = np.empty(mujoco.mj_stateSize(self.model, _STATE))
        mujoco.mj_getState(self.model, self.data, state, _STATE)
        return World, self._made_of, (state, self.poses)

    def __setstate__(self, state: tuple[NDArray[np.float64], NDArray[np.float64]]) -> None:
        physics, self.poses = state
        mujoco.mj_setState(self.model, self.data, physics, _STATE)


class MujocoPlant:
    """Drives a batch of robots, each world in a MuJoCo model of its own, built when it first moves.

    Where a robot has left its world, or begins anew in one that goes on, the model is built anew, and what is in both
    goes on as it was. A robot whose episode is over brakes. People are no bodies here: the task moves them, and ends
    the episode of who touches them.

    Attributes:
        worlds: the `World` of each team; None where it has not moved since the reset.
        rows: whose states are those of the robots of each world; -1 where one begins anew.

    Raises:
        ValueError: if the robot cannot be built.
    """

    def __init__(self, task: Task, num_envs: int) -> None:
        options = task.options
        self.task = task
        self.wheels = options.wheels
        self.worlds: list[World | None] = [None] * (num_envs // task.team)
        self.rows = np.arange(num_envs).reshape(-1, task.team).tolist()
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
        """Forgets the robots in `rows`, and worlds all of whose robots are."""
        del states, obstacles
        begun = set(rows.tolist())
        for w in {i // self.task.team for i in begun}:
            self.rows[w] = [-1 if i in begun else i for i in self.rows[w]]
            if set(self.rows[w]) == {-1}:
                self.worlds[w] = None

    def _world(self, w: int, rows: list[int], states: NDArray[np.void], obstacles: NDArray[np.void]) -> World:
        """Returns the world of a team whose robots in `rows` are there, built where they and their obstacles are."""
        world, known = self.worlds[w], self.rows[w]
        if world is not None and rows == known:
            return world
        first = rows[0]
        count = int(self.task.obstacle_counts(states[first : first + 1])[0])
        grid = getattr(self.task.courses_of()[states[first]["scenario"]], "grid", None)
        made = World(self.task.robot, self.wheels, self.before[rows], obstacles[first, :count], grid)
        if world is not None:
            made.take(world, [(k, known.index(i)) for k, i in enumerate(rows) if i in known])
        self.worlds[w], self.rows[w] = made, rows
        return made

    def drive(self, states: Records, obstacles: Records, actions: Array, noise: Array, skip: Flags) -> None:
        """Moves every robot that is not in `skip` by one control period."""
        params, robots, grids = self._views(states)
        for k, name in enumerate(("x", "y", "heading")):
            self.before[:, k] = states[name]
        command_rows(params, robots, actions, skip, self.factors, self.twists, self.speeds)
        self.speeds[skip] = 0.0
        there = (self.task.present(states) | ~skip).reshape(-1, self.task.team)
        for w in np.flatnonzero(~skip.reshape(there.shape).all(axis=1)).tolist():
            rows = w * self.task.team + np.flatnonzero(there[w])
            world = self._world(w, rows.tolist(), states, obstacles)
            self._drive(rows, world, states, obstacles, robots, params, skip)
        finish_rows(params, robots, obstacles, grids, noise, skip, self.before, self.twists, self.slips)

    def _drive(
        self,
        rows: NDArray[np.int64],
        world: World,
        states: Records,
        obstacles: Records,
        robots: Records,
        params: Records,
        skip: Flags,
    ) -> None:
        """Moves the robots of a world, in some rows, by one control period."""
        dt, speeds = self.task.options.dt, self.speeds[rows]
        movers = None
        if len(world.movers):
            first = rows[~skip[rows]][0]

            def movers(k: int) -> None:
                place_movers(params, robots, obstacles, first, k * dt / self.count, self.places)
                world.data.mocap_pos[:, :2] = self.places[world.movers]

        world.put(self.before[rows])
        travel = dt * float(np.abs(speeds).max()) * world.reach + _REACH
        near = len(world.things) > 0 or bool((states["clearance"][rows] < travel).any())
        angles = world.wheels()
        touched = world.step(speeds, near, movers)
        self.slips[rows] = speeds.mean(axis=1) - (world.wheels() - angles) / dt
        world.read(states, rows)
        states["contact"][rows[touched & ~skip[rows]]] = 1
        if len(world.things):
            world.read_things(obstacles, rows)

    def frame(self, i: int = 0, size: tuple[int, int] = (640, 480)) -> NDArray[np.uint8]:
        """Returns MuJoCo's own picture (h, w, 3) of what is around robot i, once its world has moved.

        Raises:
            ValueError: if it has not, or the robot has left it.
            RuntimeError: without OpenGL.
        """
        w = i // self.task.team
        world = self.worlds[w]
        if world is None or i not in self.rows[w]:
            raise ValueError(f"robot {i} has not moved since its reset, or has left: MuJoCo's picture needs a step")
        return picture(world.model, world.data, size, world.poses[self.rows[w].index(i)], 4.0)


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
