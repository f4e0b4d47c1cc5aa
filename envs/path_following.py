"""Path following: stay on a path and get to its end, or round a closed one."""

import dataclasses
import functools
import math
from typing import Any, ClassVar, NamedTuple

import numpy as np
from numpy.typing import NDArray

from wayfield.envs.robots import records, robots_with, sensing
from wayfield.envs.robots.kinematics import to_body_frame
from wayfield.envs.scenarios import TASKS, PathScenario, path_scenarios
from wayfield.envs.single import SingleEnv
from wayfield.envs.tasks.arguments import PlantArguments, argument
from wayfield.envs.tasks.briefing import Course
from wayfield.envs.tasks.constraints import Constraint
from wayfield.envs.tasks.observation import Field, Layout
from wayfield.envs.tasks.sheets import DIFF_DRIVE_ACTIONS, arguments_and_odometry, sheet_like
from wayfield.envs.tasks.specs import TaskSpec
from wayfield.envs.tasks.stepping import (
    Outputs,
    Reset,
    Robots,
    Step,
    Turn,
    nothing_more,
    numbered,
    reset_robots,
    step_robots,
    write_motion,
)
from wayfield.envs.tasks.task import Options, Task
from wayfield.envs.vector import vector_of
from wayfield.envs.world.grids import NO_GRIDS
from wayfield.envs.world.paths import PathPool, along_lap, nearest_ahead, vertex, walk_to
from wayfield.system.checks import FINEST, MOST_GAIN, SHORTEST, number, positive, whole
from wayfield.system.compiled import compiled, flattened, inlined
from wayfield.system.elementary import sin_cos, wrap_angle


@dataclasses.dataclass(frozen=True)
class Params:
    """The numbers of the task."""

    window: float = 1.0  # m, how far ahead of the last projection the next one is searched
    end_tolerance: float = 0.05  # m, arc length before the end that counts as arrived
    preview_spacing: float = 0.1  # m, between preview points
    num_preview: int = 10
    error_scale: float = 0.1  # m, cross-track error at which the reward for progress is halved
    corridor_penalty: float = 10.0  # taken off once, when the corridor is left

    def __post_init__(self) -> None:
        positive("window", self.window, least=SHORTEST)
        number("end_tolerance", self.end_tolerance, least=0.0)
        positive("preview_spacing", self.preview_spacing, least=FINEST)
        whole("num_preview", self.num_preview, 0)
        positive("error_scale", self.error_scale, least=FINEST)
        number("corridor_penalty", self.corridor_penalty, most=MOST_GAIN)


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
    def layout(num_twist: int, num_preview: int, task: TaskSpec = TASKS["path_following"]) -> "Layout[Observation]":
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
            task,
        )


INFO = ("time", "arc_length", "progress", "cross_track_error", "heading_error", "completion")
FLAGS = ("success", "left_corridor", "collision")
NUMBER = numbered(*INFO, "reward")
FLAG = numbered(*FLAGS, "ended")
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
    k = write_motion(s, p.holonomic, i, out)
    out[i, np.uint64(k)] = error
    out[i, np.uint64(k + 1)] = heading_error
    out[i, np.uint64(k + 2)] = s.measured_arc_length
    k += 3
    sine, cosine = sin_cos(s.measured_heading)
    segment = s.measured_segment
    ahead = along_lap(vertices, run, s.measured_arc_length, segment)
    for _ in range(p.num_preview):
        ahead += p.preview_spacing
        px, py, ahead, segment = walk_to(vertices, run, ahead, segment)
        out[i, np.uint64(k)], out[i, np.uint64(k + 1)] = to_body_frame(s.measured_x, s.measured_y, sine, cosine, px, py)
        k += 2


class World(NamedTuple):
    """The bank, as the compiled functions read it."""

    courses: NDArray[np.void]  # (scenarios,) COURSE records
    vertices: NDArray[np.void]  # of all paths
    runs: NDArray[np.void]  # (scenarios,)


@inlined
def judge(p, s, world, robots, i, row, outputs):
    """Measures robot i against its path and writes its observation, info and flags."""
    course = world.courses[s.scenario]
    vertices = world.vertices
    run = world.runs[s.scenario]
    before = s.arc_length
    s.arc_length, s.segment, s.cross_track_error, s.heading_error = project(
        vertices, run, p.window, s.x, s.y, s.heading, s.arc_length, s.segment
    )
    observe(p, s, vertices, run, robots.noise, i, row, outputs.out)
    progress = s.arc_length - before
    success = s.arc_length >= course.finish - p.end_tolerance
    left = abs(s.cross_track_error) > course.corridor
    ratio = s.cross_track_error / p.error_scale
    reward = progress / (p.max_speed * p.dt * (1.0 + ratio * ratio))
    if left:
        reward -= p.corridor_penalty
    report(p, s, course, reward, progress, outputs.numbers, i)
    flags = outputs.flags
    flags[FLAG.success, i] = success and not left
    flags[FLAG.left_corridor, i] = left
    flags[FLAG.collision, i] = s.contact != 0
    flags[FLAG.ended, i] = success or left


@inlined
def report(p, s, course, reward, progress, numbers, i):
    """Writes column i of the numbers: INFO, then the reward."""
    numbers[NUMBER.time, i] = s.steps * p.dt
    numbers[NUMBER.arc_length, i] = s.arc_length
    numbers[NUMBER.progress, i] = progress
    numbers[NUMBER.cross_track_error, i] = s.cross_track_error
    numbers[NUMBER.heading_error, i] = s.heading_error
    numbers[NUMBER.completion, i] = s.arc_length * course.per_metre
    numbers[NUMBER.reward, i] = reward


@inlined
def place(p, s, world, robots, i, draws, j):
    """Sets the pose at which a robot starts."""
    course = world.courses[s.scenario]
    s.num_obstacles = 0
    s.field = i
    sine, cosine = sin_cos(course.start[2])
    aside = course.start_offset * (2.0 * draws[j, 1] - 1.0)
    s.x = course.start[0] - sine * aside
    s.y = course.start[1] + cosine * aside
    s.heading = wrap_angle(course.start[2] + course.start_turn * (2.0 * draws[j, 2] - 1.0))


@inlined
def begin(p, s, world, robots, i, outputs):
    """Writes the first observation and numbers of robot i."""
    course = world.courses[s.scenario]
    run = world.runs[s.scenario]
    s.arc_length, s.segment, s.cross_track_error, s.heading_error = project(
        world.vertices, run, p.window, s.x, s.y, s.heading, 0.0, 0
    )
    s.measured_arc_length = s.arc_length
    s.measured_segment = s.segment
    observe(p, s, world.vertices, run, robots.noise, i, 0, outputs.out)
    report(p, s, course, 0.0, 0.0, outputs.numbers, i)


@flattened(compiled)
def step_rows(phases: int, turn: Turn, step: Step, world: World, outputs: Outputs) -> Any:
    """Runs `stepping.step_robots`."""
    robots = Robots(step.params, step.states, None, step.noise, NO_GRIDS)
    return step_robots(judge, nothing_more, phases, turn, robots, step.actions, step.skip, world, outputs)


@flattened(compiled)
def reset_rows(reset: Reset, world: World, outputs: Outputs) -> None:
    """Runs `stepping.reset_robots`."""
    robots = Robots(reset.params, reset.states, None, reset.noise, NO_GRIDS)
    reset_robots(place, begin, robots, reset.rows, reset.draws, world, outputs)


def _courses_and_paths(scenarios: tuple[PathScenario, ...]) -> tuple[NDArray[np.void], PathPool]:
    """Returns the courses of a bank and the pool of its paths, not shared with another batch."""
    short = sum(len(each.path.points) for each in scenarios) <= _MOST_CACHED
    courses, pool = (_laid_out if short else _laid_out.__wrapped__)(scenarios)
    return courses.copy(), PathPool(pool.vertices.copy(), pool.runs.copy())


# a vector of single environments asks for the same bank once a robot, and every episode of a contest for the same one
@functools.lru_cache(maxsize=4)
def _laid_out(scenarios: tuple[PathScenario, ...]) -> tuple[NDArray[np.void], PathPool]:
    pool = PathPool.of([each.path for each in scenarios])
    courses = np.zeros(len(scenarios), COURSE)
    for course, each, run in zip(courses, scenarios, pool.runs, strict=True):
        course["finish"] = each.laps * run["length"] if each.laps else np.inf
        course["per_metre"] = 1.0 / (max(each.laps, 1) * run["length"])
        course["corridor"] = each.corridor
        course["start"] = each.path.start_pose if each.start is None else each.start
        course["start_offset"] = each.start_offset
        course["start_turn"] = each.start_turn
    return courses, pool


_MOST_CACHED = 100_000  # points, 5 MB: longer paths are the user's own, and laid out anew


@dataclasses.dataclass(frozen=True, kw_only=True)
class PathArguments(PlantArguments):
    """What an environment on paths takes."""

    scenario: Any = argument(
        "random_splines", 'a name of `envs.scenarios.PATH_SCENARIOS`, a family ("circuits/train"), or a file'
    )
    scale: float = argument(1.0, "multiplies the path's coordinates")
    num_preview: int = argument(10, "the preview; longer than a closed path it goes round again")
    preview_spacing: float = argument(0.1, shown="0.1 m")


class PathFollowing(Task):
    """The path-following task of one robot on a bank of paths."""

    state_dtype = STATE
    info_names: ClassVar[tuple[str, ...]] = INFO
    flag_names = FLAGS
    draws = DRAWS
    step_rows = staticmethod(step_rows)
    reset_rows = staticmethod(reset_rows)
    belongs_to: ClassVar[TaskSpec] = TASKS["path_following"]
    numbers: ClassVar[type[Params]] = Params

    def __init__(self, arguments: PathArguments, options: Options) -> None:
        self.scenarios: tuple[PathScenario, ...] = path_scenarios(arguments.scenario, arguments.scale, self.belongs_to)
        self.options = options
        self.robot = options.robot
        self.task_params = arguments.numbers(self.numbers)
        courses, pool = _courses_and_paths(self.scenarios)
        self.pool = pool
        self.layout = Observation.layout(len(self.robot.twist_axes), self.task_params.num_preview, self.belongs_to)
        self.beam_angles = np.empty(0)
        self.max_obstacles = 0
        self.world = World(courses, pool.vertices, pool.runs)
        numbers = [(field.name, np.dtype(field.type)) for field in dataclasses.fields(self.numbers)]
        self.params = records.record(
            [*records.ROBOT_PARAMS, *numbers, ("max_speed", np.float64)],
            options.robot_params()
            | dataclasses.asdict(self.task_params)
            | {"max_range": 0.0, "moving": False}
            | {"max_speed": self.robot.max_twist[0]},
        )

    def last_indices(self, scenarios: NDArray[np.int64]) -> dict[str, NDArray[np.int64]]:
        """Returns the greatest value (b,) of each index."""
        return dict.fromkeys(("segment", "measured_segment"), self.pool.runs["segments"][scenarios] - 1)

    @property
    def of_states(self) -> tuple[Constraint, ...]:
        """Returns the corridor, which a robot that leaves it fails by."""
        corridors = self.world.courses["corridor"].copy()

        def tube(error: Any, scenario: Any) -> list[Any]:
            return [error - corridors[scenario], -error - corridors[scenario]]

        return (Constraint("tube", "state", ("cross_track_error", "scenario"), "m", corridors, tube),)

    def around(self, state: NDArray[np.void]) -> dict[str, Any]:
        """Returns what a frame shows of the path, as fields of `rendering.Scene`."""
        scenario = self.scenarios[int(state["scenario"])]
        run = self.pool.runs[int(state["scenario"])]
        vertices = self.pool.vertices[run["first"] : run["first"] + run["segments"] + 1]
        path = np.column_stack([vertices["x"], vertices["y"]])
        margin = scenario.corridor + self.robot.hull_radius
        return {
            "path": path,
            "corridor": scenario.corridor,
            "bounds": (*(path.min(axis=0) - margin).tolist(), *(path.max(axis=0) + margin).tolist()),
            "start": tuple(self.world.courses["start"][int(state["scenario"])][:2].tolist()),
        }

    def drawing(self, state: NDArray[np.void]) -> dict[str, Any]:
        """Returns what a frame shows of the task, as fields of `rendering.Scene`."""
        run = self.pool.runs[int(state["scenario"])]
        vertices = self.pool.vertices[run["first"] : run["first"] + run["segments"] + 1]
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
        return self.around(state) | {
            "lookahead": lookahead,
            "reference": (float(a["x"] + along * a["ux"]), float(a["y"] + along * a["uy"])),
            "caption": (
                f"t {state['steps'] * self.options.dt:5.2f} s   "
                f"cross-track error {100 * state['cross_track_error']:+z6.1f} cm"
            ),
        }

    def obstacle_counts(self, states: NDArray[np.void]) -> NDArray[np.int64]:
        """Returns zeros: nothing stands beside a path."""
        return np.zeros(len(states), np.int64)

    def briefing_fields(self, states: NDArray[np.void], knows: str) -> dict[str, Any]:
        """Returns the task's part of the briefing: the path, unless the policy knows its sensors alone."""
        if knows in ("sensors", "bodies"):
            return {}
        return {"path": Course.of(self.pool, states["scenario"].copy())}


class DiffDrivePathFollowing(SingleEnv):
    __doc__ = f"""A differential drive, such as the Pioneer P3DX, follows a path.

    ## Description

    A differential-drive robot (document A: wheel radius 0.0975 m, half track 0.1905 m, rim speed at most 1.2 m/s;
    others in `wayfield.envs.robots`) shall stay on a polyline and get to its end, or round a closed one. Control period
    0.05 s. Progress is measured by a projection that only moves forward: the nearest point of the path within 1 m of
    arc length ahead of the last one, so that a path may cross itself.

    ## Action space

    {DIFF_DRIVE_ACTIONS}

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

        reward = ds / (v_max dt) / (1 + (e / 0.1 m)^2) - 10 left_corridor

    v_max is the bound of the forward speed (index 0 of the twist actions), dt = 0.05 s.
    The first term lies in [0, 1] while the robot drives along the path; it is halved 0.1 m beside it.

    ## Starting state

    At rest at the scenario's start (by default the path's first point, along it), displaced sideways by a uniform draw
    from +-`start_offset` and turned by one from +-`start_turn` of the scenario. `random_splines` draws one of 64 paths;
    `reset(options={{"scenario": k}})` starts the k-th instead, and draws all else as without it.

    ## Episode end

    Terminated in success within 0.05 m of arc length of the path's end, or of the end of the last lap asked; in failure
    when |e| exceeds the scenario's corridor. Truncated after 1200 steps (60 s). `circle` and other closed document runs
    have no end but the clock.

    ## Info

    `time` (s), `arc_length` (m), `progress` (m, since the last step), `cross_track_error` (m), `heading_error` (rad),
    `completion` (share of the path, or laps), and the flags `success`, `left_corridor`, `collision`; all of the true
    pose.

    {arguments_and_odometry(PathArguments, holonomic=False)}

    ## Version history

    * v0: first version.
    """

    arguments = PathArguments
    asks: ClassVar[type[PathFollowing]] = PathFollowing
    robots = robots_with(holonomic=False)


DiffDrivePathFollowingVector = vector_of(DiffDrivePathFollowing)


class OmniPathFollowing(DiffDrivePathFollowing):
    __doc__ = sheet_like(
        DiffDrivePathFollowing,
        "A robot on omni or mecanum wheels follows a path.",
        {
            "Description": """
                A holonomic robot with three omni wheels (document B: wheel radius 0.075 m on a circle of 0.3 m), four
                (document C: 0.03 m on 0.13 m) or four mecanum wheels (0.05 m) shall stay on a polyline and get to its
                end, or round a closed one. Control period 0.05 s. Progress is measured by a projection that only moves
                forward: the nearest point of the path within 1 m of arc length ahead of the last one, so that a path
                may cross itself.
            """,
            "Observation space": """
                `Box(9 + 2 k,)` float32, k = `num_preview`; `env.unwrapped.task.layout.unpack(observation)` gives the
                named fields.

                | index | field | meaning | min | max | unit |
                |---|---|---|---|---|---|
                | 0, 1 | pose | measured x, y in the world frame | -inf | inf | m |
                | 2 | pose | measured heading | -pi | pi | rad |
                | 3, 4, 5 | twist | measured v_x, v_y, yaw rate | -inf | inf | m/s, rad/s |
                | 6 | cross_track_error | distance to the path, + left of it | -inf | inf | m |
                | 7 | heading_error | heading minus path tangent | -pi | pi | rad |
                | 8 | arc_length | of the projection, counting over laps | 0 | inf | m |
                | 9, ... | preview | k points (x, y) every `preview_spacing` ahead, body frame | -inf | inf | m |

                All fields follow from the measured pose: with `pose_source="odometry"` or noise they err together, as
                on a robot.
            """,
        },
        arguments=PathArguments,
        holonomic=True,
    )

    robots = robots_with(holonomic=True)


OmniPathFollowingVector = vector_of(OmniPathFollowing)
