"""Path following: stay on a path and get to its end, or round a closed one."""

import dataclasses
import math
from typing import Any, ClassVar, NamedTuple

import numpy as np
from numpy.typing import NDArray

from wayfield.envs import kinematic_plant, records, sensing
from wayfield.envs.compiled import compiled, inlined
from wayfield.envs.geometry import sin_cos, wrap_angle
from wayfield.envs.kinematics import to_body_frame
from wayfield.envs.observation import Field, Layout
from wayfield.envs.paths import PathPool, along_lap, nearest_ahead, vertex, walk_to
from wayfield.envs.patrols import PATROL
from wayfield.envs.scenarios import PathScenario, path_scenarios
from wayfield.envs.single import SingleEnv
from wayfield.envs.task import COMMAND, DRIVE, JUDGE, Options, Task, positive, whole
from wayfield.envs.vector import NativeVectorEnv


@dataclasses.dataclass(frozen=True)
class Params:
    """The numbers of the task."""

    window: float = 1.0  # m, how far ahead of the last projection the next one is searched
    end_tolerance: float = 0.05  # m, arc length before the end that counts as arrived
    preview_spacing: float = 0.1  # m, between preview points
    num_preview: int = 10
    error_scale: float = 0.1  # m, cross-track error at which the reward for progress is halved
    corridor_penalty: float = 10.0  # taken off once, when the corridor is left


STATE = np.dtype(
    [
        *records.ROBOT_STATE,
        ("arc_length", np.float64),  # of the true pose's projection, m; counts over laps, never falls
        ("segment", np.int64),  # of that projection
        ("measured_arc_length", np.float64),  # of the measured pose's projection
        ("measured_segment", np.int64),
        ("cross_track_error", np.float64),  # m, + left of the path
        ("heading_error", np.float64),  # rad, heading minus path tangent
    ],
    align=True,
)

PARAMS = [
    *records.ROBOT_PARAMS,
    *((field.name, np.dtype(field.type)) for field in dataclasses.fields(Params)),
    ("max_speed", np.float64),  # m/s
]

# One record a scenario of the bank.
COURSE = np.dtype(
    [
        ("finish", np.float64),  # m, arc length at the end of the last lap; inf when only the clock ends the run
        ("per_metre", np.float64),  # 1/m, of the arc length to the finish, or of a lap where there is none
        ("corridor", np.float64),  # m
        ("start", np.float64, (3,)),
        ("start_offset", np.float64),
        ("start_turn", np.float64),
    ],
    align=True,
)


class Observation(NamedTuple):
    """What a path follower sees; b is any batch shape, t the number of twist components."""

    pose: NDArray[Any]  # (b, 3) measured x, y (m), heading (rad), world frame
    twist: NDArray[Any]  # (b, t) measured body twist, m/s and rad/s
    cross_track_error: NDArray[Any]  # (b,) m, + left of the path
    heading_error: NDArray[Any]  # (b,) rad
    arc_length: NDArray[Any]  # (b,) m, of the projection on the path
    preview: NDArray[Any]  # (b, k, 2) points of the path ahead, body frame, m

    @staticmethod
    def layout(num_twist: int, num_preview: int) -> "Layout[Observation]":
        """Returns the order of the fields in the flat observation."""
        pi = float(np.nextafter(np.float32(math.pi), np.float32(4)))
        return Layout(
            Observation,
            (
                Field("pose", (3,), [-np.inf, -np.inf, -pi], [np.inf, np.inf, pi]),
                Field("twist", (num_twist,), -np.inf, np.inf),
                Field("cross_track_error", (), -np.inf, np.inf),
                Field("heading_error", (), -pi, pi),
                Field("arc_length", (), 0.0, np.inf),
                Field("preview", (num_preview, 2), -np.inf, np.inf),
            ),
        )


INFO = ("time", "arc_length", "progress", "cross_track_error", "heading_error", "completion")
FLAGS = ("success", "left_corridor", "collision")
LOOKAHEAD = 0.5  # m, of the marker that frames show
DRAWS = 2  # random numbers of a reset, besides the choice of the scenario


@inlined
def project(vertices, run, window, x, y, heading, s, segment):
    """Returns (arc length, segment, cross-track error, heading error) of the projection onto the path ahead of s."""
    s, segment = nearest_ahead(vertices, run, x, y, s, segment, window)
    a = vertex(vertices, run, segment)
    along = along_lap(vertices, run, s, segment) - a.s
    px = a.x + along * a.ux
    py = a.y + along * a.uy
    dx = x - px
    dy = y - py
    error = math.copysign(math.sqrt(dx * dx + dy * dy), a.ux * dy - a.uy * dx)
    return s, segment, error, wrap_angle(heading - a.heading)


@inlined
def observe(p, s, vertices, run, noise, i, row, out):
    """Writes the observation of one robot."""
    sensing.measure(p, s, noise, i, row)
    error = s.cross_track_error
    heading_error = s.heading_error
    if p.perfect_pose:
        s.measured_arc_length = s.arc_length
        s.measured_segment = s.segment
    else:
        s.measured_arc_length, s.measured_segment, error, heading_error = project(
            vertices,
            run,
            p.window,
            s.measured_x,
            s.measured_y,
            s.measured_heading,
            s.measured_arc_length,
            s.measured_segment,
        )
    out[i, 0] = s.measured_x
    out[i, 1] = s.measured_y
    out[i, 2] = s.measured_heading
    out[i, 3] = s.measured_vx
    k = 4
    if p.holonomic:
        out[i, np.uint64(k)] = s.measured_vy
        k += 1
    out[i, np.uint64(k)] = s.measured_yaw_rate
    out[i, np.uint64(k + 1)] = error
    out[i, np.uint64(k + 2)] = heading_error
    out[i, np.uint64(k + 3)] = s.measured_arc_length
    k += 4
    sine, cosine = sin_cos(s.measured_heading)
    segment = s.measured_segment
    ahead = along_lap(vertices, run, s.measured_arc_length, segment)
    for _ in range(p.num_preview):
        ahead += p.preview_spacing
        px, py, ahead, segment = walk_to(vertices, run, ahead, segment)
        out[i, np.uint64(k)], out[i, np.uint64(k + 1)] = to_body_frame(s.measured_x, s.measured_y, sine, cosine, px, py)
        k += 2


@inlined
def judge(p, s, course, vertices, run, noise, i, row, out, numbers, flags):
    """Measures robot i against its path and writes its observation, info and flags."""
    before = s.arc_length
    s.arc_length, s.segment, s.cross_track_error, s.heading_error = project(
        vertices, run, p.window, s.x, s.y, s.heading, s.arc_length, s.segment
    )
    observe(p, s, vertices, run, noise, i, row, out)
    progress = s.arc_length - before
    success = s.arc_length >= course.finish - p.end_tolerance
    left = abs(s.cross_track_error) > course.corridor
    ratio = s.cross_track_error / p.error_scale
    reward = progress / (p.max_speed * p.dt * (1.0 + ratio * ratio))
    if left:
        reward -= p.corridor_penalty
    report(p, s, course, reward, progress, numbers, i)
    flags[0, i] = success and not left
    flags[1, i] = left
    flags[2, i] = s.contact != 0
    flags[3, i] = success or left


@inlined
def report(p, s, course, reward, progress, numbers, i):
    """Writes column i of the numbers: INFO, then the reward."""
    numbers[0, i] = s.steps * p.dt
    numbers[1, i] = s.arc_length
    numbers[2, i] = progress
    numbers[3, i] = s.cross_track_error
    numbers[4, i] = s.heading_error
    numbers[5, i] = s.arc_length * course.per_metre
    numbers[6, i] = reward


@compiled
def step_rows(phases, params, states, obstacles, actions, noise, skip, courses, vertices, runs, out, numbers, flags):
    """Runs the asked phases of a step for all robots but those in `skip`.

    Returns the first robot whose action is not finite, before anything has moved; -1 if there is none.
    """
    if phases & COMMAND:
        for i in range(states.shape[0]):
            for k in range(actions.shape[1]):
                if not skip[i] and not math.isfinite(actions[i, k]):
                    return i
    p = params[0]
    for i in range(states.shape[0]):
        if skip[i]:
            continue
        s = states[i]
        row = s.noise_row if noise.shape[1] > 1 else 0
        if phases & COMMAND:
            kinematic_plant.command(p, s, actions, i)
            kinematic_plant.shove(p, s, obstacles, i, 0)
        if phases & DRIVE:
            kinematic_plant.drive(p, s, obstacles, i, 0, noise, row)
        if phases & JUDGE:
            s.steps += 1
            judge(p, s, courses[s.scenario], vertices, runs[s.scenario], noise, i, row, out, numbers, flags)
            s.noise_row += 1
    return -1


@compiled
def reset_rows(params, states, obstacles, rows, draws, noise, courses, vertices, runs, out, numbers, flags):
    """Starts an episode for each robot in `rows`; draws: uniform numbers, (len(rows), 1 + DRAWS) or 2 more."""
    p = params[0]
    for j in range(rows.shape[0]):
        i = rows[j]
        s = states[i]
        scenario = min(int(draws[j, 0] * courses.shape[0]), courses.shape[0] - 1)
        s.scenario = scenario
        course = courses[scenario]
        run = runs[scenario]
        sine, cosine = sin_cos(course.start[2])
        aside = course.start_offset * (2.0 * draws[j, 1] - 1.0)
        s.x = course.start[0] - sine * aside
        s.y = course.start[1] + cosine * aside
        s.heading = wrap_angle(course.start[2] + course.start_turn * (2.0 * draws[j, 2] - 1.0))
        records.halt(s)
        records.draw_shove(p, s, draws, j)
        s.clearance = np.inf
        s.arc_length, s.segment, s.cross_track_error, s.heading_error = project(
            vertices, run, p.window, s.x, s.y, s.heading, 0.0, 0
        )
        s.measured_arc_length = s.arc_length
        s.measured_segment = s.segment
        observe(p, s, vertices, run, noise, i, 0, out)
        s.noise_row = 1
        report(p, s, course, 0.0, 0.0, numbers, i)
        flags[:, i] = False


class PathFollowing(Task):
    """The path-following task of one robot on a bank of paths."""

    state_dtype = STATE
    info_names = INFO
    flag_names = FLAGS
    draws = DRAWS
    step_rows = staticmethod(step_rows)
    reset_rows = staticmethod(reset_rows)

    def __init__(self, scenario: str, options: Options, scale: float = 1.0, **params: Any) -> None:
        self.scenarios: tuple[PathScenario, ...] = path_scenarios(scenario, scale)
        self.options = options
        self.robot = options.robot
        self.task_params = Params(**params)
        whole("num_preview", self.task_params.num_preview, 0)
        positive("preview_spacing", self.task_params.preview_spacing)
        pool = PathPool.of([each.path for each in self.scenarios])
        courses = np.zeros(len(self.scenarios), COURSE)
        for course, each, run in zip(courses, self.scenarios, pool.runs, strict=True):
            course["finish"] = each.laps * run["length"] if each.laps else np.inf
            course["per_metre"] = 1.0 / (max(each.laps, 1) * run["length"])
            course["corridor"] = each.corridor
            course["start"] = each.path.start_pose if each.start is None else each.start
            course["start_offset"] = each.start_offset
            course["start_turn"] = each.start_turn
        self.pool = pool
        self.world = (courses, pool.vertices, pool.runs)
        self.layout = Observation.layout(len(self.robot.twist_axes), self.task_params.num_preview)
        self.beam_angles = np.empty(0)
        self.max_obstacles = 0
        self.patrols = np.zeros((len(self.scenarios), 0), PATROL)
        self.params = records.record(
            PARAMS,
            options.robot_params()
            | dataclasses.asdict(self.task_params)
            | {"max_range": 0.0}
            | {"max_speed": self.robot.max_twist[0]},
        )

    def drawing(self, state: NDArray[np.void]) -> dict[str, Any]:
        """Returns what a frame shows of the task, as fields of `rendering.Scene`."""
        scenario = self.scenarios[int(state["scenario"])]
        run = self.pool.runs[int(state["scenario"])]
        vertices = self.pool.vertices[run["first"] : run["first"] + run["segments"] + 1]
        path = np.column_stack([vertices["x"], vertices["y"]])
        margin = scenario.corridor + self.robot.hull_radius
        # the two markers that document A shows live: the point half a metre ahead, and the path point nearest to it
        lookahead = (
            float(state["x"] + LOOKAHEAD * math.cos(state["heading"])),
            float(state["y"] + LOOKAHEAD * math.sin(state["heading"])),
        )
        s, segment = nearest_ahead(
            self.pool.vertices,
            run,
            *lookahead,
            float(state["arc_length"]),
            int(state["segment"]),
            self.task_params.window,
        )
        a = vertices[segment]
        along = along_lap(self.pool.vertices, run, s, segment) - a["s"]
        return {
            "path": path,
            "corridor": scenario.corridor,
            "bounds": (*(path.min(axis=0) - margin).tolist(), *(path.max(axis=0) + margin).tolist()),
            "start": tuple(self.world[0]["start"][int(state["scenario"])][:2].tolist()),
            "lookahead": lookahead,
            "reference": (float(a["x"] + along * a["ux"]), float(a["y"] + along * a["uy"])),
            "caption": (
                f"t {state['steps'] * self.options.dt:5.2f} s   "
                f"cross-track error {100 * state['cross_track_error']:+6.1f} cm"
            ),
        }

    def obstacle_counts(self, states: NDArray[np.void]) -> NDArray[np.int64]:
        """Returns zeros: nothing stands beside a path."""
        return np.zeros(len(states), np.int64)

    def told(self, states: NDArray[np.void], knows: str) -> dict[str, Any]:
        """Returns the task's part of the briefing: the path, unless the policy knows its sensors alone."""
        if knows == "sensors":
            return {}
        return {"paths": self.pool, "path_index": states["scenario"].copy()}


class DiffDrivePathFollowing(SingleEnv):
    """A Pioneer P3DX follows a path.

    ## Description

    A differential-drive robot (document A: wheel radius 0.0975 m, half track 0.1905 m, rim speed at most 1.2 m/s) shall
    stay on a polyline and get to its end, or round a closed one. Control period 0.05 s. Progress is measured by a
    projection that only moves forward: the nearest point of the path within 1 m of arc length ahead of the last one, so
    that a path may cross itself.

    ## Action space

    `Box(2,)` float32. Values beyond the bounds are allowed: the base scales all wheels by one factor, which keeps the
    direction of motion. Non-finite values, other shapes and other types are errors.

    | index | `action_mode="twist"` | bound | `action_mode="wheel_speeds"` | bound |
    |---|---|---|---|---|
    | 0 | forward speed v, m/s | 1.2 | right wheel, rad/s | 12.31 |
    | 1 | yaw rate w, rad/s | 6.30 | left wheel, rad/s | 12.31 |

    ## Observation space

    `Box(8 + 2 k,)` float32, k = `num_preview`; `env.unwrapped.task.layout.unpack(observation)` gives the named fields.

    | index | field | meaning | min | max | unit |
    |---|---|---|---|---|---|
    | 0, 1 | pose | measured x, y in the world frame | -inf | inf | m |
    | 2 | pose | measured heading | -pi | pi | rad |
    | 3, 4 | twist | measured forward speed and yaw rate | -inf | inf | m/s, rad/s |
    | 5 | cross_track_error | distance to the path, + left of it | -inf | inf | m |
    | 6 | heading_error | heading minus path tangent | -pi | pi | rad |
    | 7 | arc_length | of the projection, counting over laps | 0 | inf | m |
    | 8, ... | preview | k points (x, y) every `preview_spacing` ahead, body frame | -inf | inf | m |

    All fields follow from the measured pose: with `pose_source="odometry"` or noise they err together, as on a robot.

    ## Rewards

    With ds the `progress`, e the `cross_track_error` and `left_corridor` of info:

        reward = ds / (v_max dt) / (1 + (e / 0.1 m)^2) - 10 left_corridor,    v_max = 1.2 m/s, dt = 0.05 s

    The first term lies in [0, 1] while the robot drives along the path; it is halved 0.1 m beside it.

    ## Starting state

    At rest at the scenario's start (by default the path's first point, along it), displaced sideways by a uniform draw
    from +-`start_offset` and turned by one from +-`start_turn` of the scenario. `random_splines` draws one of 64 paths;
    `reset(options={"scenario": k})` starts the k-th instead, and draws all else as without it.

    ## Episode end

    Terminated in success within 0.05 m of arc length of the path's end, or of the end of the last lap asked; in failure
    when |e| exceeds the scenario's corridor. Truncated after 1200 steps (60 s). `circle` and other closed document runs
    have no end but the clock.

    ## Info

    `time` (s), `arc_length` (m), `progress` (m, since the last step), `cross_track_error` (m), `heading_error` (rad),
    `completion` (share of the path, or laps), and the flags `success`, `left_corridor`, `collision`; all of the true
    pose.

    ## Arguments

    | argument | default | meaning |
    |---|---|---|
    | scenario | "random_splines" | a name of `envs.scenarios.PATH_SCENARIOS`, a family ("circuits/train"), or a file |
    | robot | "p3dx" | the robot |
    | dynamics | "kinematic" | "kinematic", or "pymunk": mass, wheel slip, contacts |
    | actuators | "ideal" | "ideal"; "lagged": 1.0 m/s^2, 3 rad/s^2, lag 0.1 s; "slow": 0.5, 1.5, 0.25 |
    | action_mode | "twist" | "twist" or "wheel_speeds" |
    | noise | 0.0 | scales standard deviations: position 0.01 m, heading 0.01 rad, encoders 2 % |
    | pose_source | "ground_truth" | or "odometry": the pose integrated from the encoders |
    | shove | None | (t, dx, dy, turn): the pose is displaced at time t, in the world frame |
    | disturbance | "none" | "light", "moderate", "strong", "severe", or one cause: `wayfield.envs.disturbances` |
    | scale | 1.0 | multiplies the path's coordinates |
    | num_preview, preview_spacing | 10, 0.1 m | the preview |
    | render_mode | None | "rgb_array" or "human" |

    The vector environment takes `autoreset_mode="NextStep"|"SameStep"` besides.

    ## Version history

    * v0: first version.
    """

    robots: ClassVar[tuple[str, ...]] = ("p3dx",)  # the first is the default

    def __init__(
        self,
        scenario: str = "random_splines",
        robot: str | None = None,
        dynamics: str = "kinematic",
        actuators: str = "ideal",
        action_mode: str = "twist",
        noise: float = 0.0,
        pose_source: str = "ground_truth",
        shove: tuple[float, float, float, float] | None = None,
        disturbance: str = "none",
        scale: float = 1.0,
        num_preview: int = 10,
        preview_spacing: float = 0.1,
        render_mode: str | None = None,
    ) -> None:
        super().__init__(
            PathFollowing(
                scenario,
                Options.of(
                    self.robots[0] if robot is None else robot,
                    self.robots,
                    dynamics,
                    actuators,
                    action_mode,
                    noise,
                    pose_source,
                    shove,
                    disturbance,
                ),
                scale,
                num_preview=num_preview,
                preview_spacing=preview_spacing,
            ),
            render_mode,
        )


class DiffDrivePathFollowingVector(NativeVectorEnv):
    """Many `DiffDrivePathFollowing` robots stepped by one compiled call; the same keyword arguments."""

    def __init__(self, num_envs: int = 1, **kwargs: Any) -> None:
        super().__init__(DiffDrivePathFollowing, num_envs, **kwargs)


class OmniPathFollowing(DiffDrivePathFollowing):
    """An omni robot follows a path.

    The task, observation fields, rewards, episode ends, info and arguments are those of `DiffDrivePathFollowing`, but
    for the robot: three omni wheels (document B, `robot="omni3"`, the default) or four (document C, `"omni4"`), with
    the pose sources "odometry_uncorrected" (omni3) and "odometry_plain_sum" besides.

    ## Action space

    `Box(3,)` float32 for `action_mode="twist"`, `Box(3,)` or `Box(4,)` for `"wheel_speeds"`.

    | index | "twist" | omni3 | omni4 | "wheel_speeds" | omni3 | omni4 |
    |---|---|---|---|---|---|---|
    | 0 | v_x, m/s | 1.73 | 1.27 | wheel 1, rad/s | 20 | 30 |
    | 1 | v_y, m/s | 1.5 | 1.27 | wheel 2, rad/s | 20 | 30 |
    | 2 | yaw rate, rad/s | 5.0 | 6.92 | wheel 3, rad/s | 20 | 30 |
    | 3 | | | | wheel 4, rad/s | | 30 |

    ## Observation space

    `Box(9 + 2 k,)` float32: the field `twist` is v_x, v_y and yaw rate.

    ## Rewards

    v_max is the bound of v_x.

    ## Version history

    * v0: first version.
    """

    robots = ("omni3", "omni4")


class OmniPathFollowingVector(NativeVectorEnv):
    """Many `OmniPathFollowing` robots stepped by one compiled call; the same keyword arguments."""

    def __init__(self, num_envs: int = 1, **kwargs: Any) -> None:
        super().__init__(OmniPathFollowing, num_envs, **kwargs)
