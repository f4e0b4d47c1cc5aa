"""Trajectory tracking: be where a reference is, when it is there."""

import dataclasses
import functools
import math
from typing import Any, ClassVar, NamedTuple

import numpy as np
from numpy.typing import NDArray

from wayfield.envs.path_following import PathArguments, PathFollowing, project
from wayfield.envs.robots import records, robots_with, sensing
from wayfield.envs.robots.kinematics import to_body_frame
from wayfield.envs.robots.references import (
    BASE,
    RAMP,
    TIMES,
    References,
    base_of,
    beyond,
    lay_out,
    sample_index,
)
from wayfield.envs.scenarios import TASKS, path_scenarios
from wayfield.envs.scenarios.reference_proofs import proof
from wayfield.envs.single import SingleEnv
from wayfield.envs.tasks.arguments import argument
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
from wayfield.envs.tasks.task import Options
from wayfield.envs.vector import vector_of
from wayfield.envs.world.grids import NO_GRIDS
from wayfield.envs.world.paths import PathPool
from wayfield.system.checks import FINEST, MOST_GAIN, choose, number, positive, whole
from wayfield.system.compiled import compiled, flattened, inlined
from wayfield.system.elementary import exponential, sin_cos, wrap_angle

REWARDS = ("bounded", "quadratic", "exp")
BEGINS = ("rest", "rolling")
SETTLED = 10.0  # s, from which on errors decide a success
HELD = 0.02  # m, RMS error of a success after that, or FLOORS times the floor where that is more
FLOORS = 3.0


@dataclasses.dataclass(frozen=True)
class Params:
    """The numbers of the task."""

    window: float = 1.0  # m, of path, that its nearest point is looked for in, ahead of the last
    preview_spacing: float = 0.1  # s, between previewed samples, to whole control periods
    num_preview: int = 8
    error_scale: float = 0.05  # m, error at which the bounded reward is halved
    turn_weight: float = 0.02  # of the change of the commanded yaw rate, as a share of what the base can
    tube_penalty: float = 10.0  # taken off once, when the tube is left
    apart: float = 1.0  # share of the scenario's distance from the reference at the start

    def __post_init__(self) -> None:
        positive("window", self.window, least=FINEST)
        positive("preview_spacing", self.preview_spacing, least=FINEST)
        whole("num_preview", self.num_preview, 0)
        positive("error_scale", self.error_scale, least=FINEST)
        number("turn_weight", self.turn_weight, least=0.0, most=MOST_GAIN)
        number("tube_penalty", self.tube_penalty, most=MOST_GAIN)
        number("apart", self.apart, least=0.0, most=MOST_GAIN)


STATE = np.dtype(
    [
        *records.ROBOT_STATE,
        ("arc_length", np.float64),  # of the true pose's projection on the reference's path, m
        ("segment", np.int64),
        ("cross_track_error", np.float64),  # m, off that path, + left
        ("error_x", np.float64),  # of the true pose: reference minus robot in the body frame, m
        ("error_y", np.float64),
        ("heading_error", np.float64),  # rad
        ("turned", np.float64),  # rad/s, the yaw rate of the last command
        ("squares", np.float64),  # m^2, sum of squared errors after SETTLED
    ],
    align=True,
)
PARAMS = [
    *records.ROBOT_PARAMS,
    *((field.name, np.dtype(field.type)) for field in dataclasses.fields(Params)),
    ("reward", np.int64),  # of REWARDS
    ("rolling", np.int64),
    ("stride", np.int64),  # control periods between previewed samples
    ("settled", np.int64),  # control periods
]
# One record a scenario of the bank.
COURSE = np.dtype(
    [("tube", np.float64), ("start", np.float64, (3,)), ("bound", np.float64),  # m
     ("start_offset", np.float64), ("start_turn", np.float64)], align=True,
)  # fmt: skip
Q = (10.0, 10.0, 0.5)  # 1/m^2, 1/m^2, 1/rad^2, of the quadratic cost
R = (0.01, 0.001)  # s^2/m^2, s^2/rad^2


class Observation(NamedTuple):
    """What a tracker sees; b is any batch shape, t the number of twist components."""

    pose: NDArray[Any]  # (b, 3) measured x, y (m), heading (rad), world frame
    twist: NDArray[Any]  # (b, t) measured body twist, m/s and rad/s
    error: NDArray[Any]  # (b, 3) reference minus robot, body frame, m and rad
    reference_twist: NDArray[Any]  # (b, t) in the reference's own frame
    command: NDArray[Any]  # (b, t) the twist that was last commanded to the wheels
    time_left: NDArray[Any]  # (b,) s, until the reference rests; 0 where it goes round
    preview: NDArray[Any]  # (b, k, 3 + t) poses of the reference ahead, body frame, and its twists there

    @staticmethod
    def layout(
        num_twist: int, num_preview: int, task: TaskSpec = TASKS["trajectory_tracking"]
    ) -> "Layout[Observation]":
        """Returns the order of the fields in the flat observation."""
        pi = float(np.nextafter(np.float32(math.pi), np.float32(4)))
        inf = np.inf
        ahead = np.array([inf, inf, pi, *[inf] * num_twist])
        return Layout(
            Observation,
            (
                Field("pose", (3,), [-inf, -inf, -pi], [inf, inf, pi]),
                Field("twist", (num_twist,), -inf, inf),
                Field("error", (3,), [-inf, -inf, -pi], [inf, inf, pi]),
                Field("reference_twist", (num_twist,), -inf, inf),
                Field("command", (num_twist,), -inf, inf),
                Field("time_left", (), 0.0, inf),
                Field("preview", (num_preview, 3 + num_twist), -ahead, ahead),
            ),
            task,
        )


INFO = ("time", "position_error", "cross_track_error", "heading_error", "cost")
FLAGS = ("success", "left_corridor", "collision")
NUMBER = numbered(*INFO, "reward")
FLAG = numbered(*FLAGS, "ended")
DRAWS = 3  # random numbers of a reset, besides the choice of the scenario


class World(NamedTuple):
    """The bank, as the compiled functions read it."""

    courses: NDArray[np.void]  # (scenarios,) COURSE records
    vertices: NDArray[np.void]  # of all paths
    runs: NDArray[np.void]  # (scenarios,)
    samples: NDArray[np.void]  # of all references
    times: NDArray[np.void]  # (scenarios,)


@inlined
def seen_from(x, y, heading, sine, cosine, sample):
    """Returns a sample's pose in the frame of another one: x, y (m) and heading (rad)."""
    ex, ey = to_body_frame(x, y, sine, cosine, sample.x, sample.y)
    return ex, ey, wrap_angle(sample.heading - heading)


@inlined
def write_twist(holonomic, vx, vy, yaw_rate, i, k, out):
    """Writes a twist at column k; returns the next column."""
    out[i, np.uint64(k)] = vx
    k += 1
    if holonomic:
        out[i, np.uint64(k)] = vy
        k += 1
    out[i, np.uint64(k)] = yaw_rate
    return k + 1


@inlined
def observe(p, s, world, noise, i, row, out):
    """Writes the observation of one robot."""
    sensing.measure(p, s, noise, i, row)
    times = world.times[s.scenario]
    k = write_motion(s, p.holonomic, i, out)
    sine, cosine = sin_cos(s.measured_heading)
    here = world.samples[sample_index(times, s.steps)]
    x, y, turn = seen_from(s.measured_x, s.measured_y, s.measured_heading, sine, cosine, here)
    out[i, np.uint64(k)] = x
    out[i, np.uint64(k + 1)] = y
    out[i, np.uint64(k + 2)] = turn
    k = write_twist(p.holonomic, here.vx, here.vy, here.yaw_rate, i, k + 3, out)
    k = write_twist(p.holonomic, s.command_vx, s.command_vy, s.command_yaw_rate, i, k, out)
    out[i, np.uint64(k)] = max(times.last - s.steps, 0) * p.dt if times.lap == 1 else 0.0
    k += 1
    for j in range(p.num_preview):
        ahead = world.samples[sample_index(times, s.steps + (j + 1) * p.stride)]
        x, y, turn = seen_from(s.measured_x, s.measured_y, s.measured_heading, sine, cosine, ahead)
        out[i, np.uint64(k)] = x
        out[i, np.uint64(k + 1)] = y
        out[i, np.uint64(k + 2)] = turn
        k = write_twist(p.holonomic, ahead.vx, ahead.vy, ahead.yaw_rate, i, k + 3, out)


@inlined
def measure_error(p, s, world):
    """Measures the true pose against the reference; returns the squared distance (m^2) and the quadratic cost."""
    here = world.samples[sample_index(world.times[s.scenario], s.steps)]
    sine, cosine = sin_cos(s.heading)
    s.error_x, s.error_y, s.heading_error = seen_from(s.x, s.y, s.heading, sine, cosine, here)
    square = s.error_x * s.error_x + s.error_y * s.error_y
    dx = s.command_vx - here.vx
    dy = s.command_vy - here.vy
    dw = s.command_yaw_rate - here.yaw_rate
    turn = s.heading_error
    cost = Q[0] * square + Q[2] * turn * turn + R[0] * (dx * dx + dy * dy) + R[1] * dw * dw
    return square, cost


@inlined
def judge(p, s, world, robots, i, row, outputs):
    """Measures robot i against its reference and writes its observation, info and flags."""
    course = world.courses[s.scenario]
    square, cost = measure_error(p, s, world)
    s.arc_length, s.segment, s.cross_track_error, _ = project(
        world.vertices, world.runs[s.scenario], p.window, s.x, s.y, s.heading, s.arc_length, s.segment
    )
    observe(p, s, world, robots.noise, i, row, outputs.out)
    left = square > course.tube * course.tube
    if s.steps > p.settled:
        s.squares += square
    held = s.squares <= course.bound * course.bound * (s.steps - p.settled)
    if p.reward == 0:
        reward = 1.0 / (1.0 + square / (p.error_scale * p.error_scale))
        reward -= p.turn_weight * abs(s.command_yaw_rate - s.turned) / (p.yaw_acceleration * p.dt)
    else:
        reward = -cost if p.reward == 1 else exponential(-cost)
    s.turned = s.command_yaw_rate
    if left:
        reward -= p.tube_penalty
    report(p, s, square, cost, reward, outputs.numbers, i)
    flags = outputs.flags
    flags[FLAG.success, i] = s.steps > p.settled and held and not left
    flags[FLAG.left_corridor, i] = left
    flags[FLAG.collision, i] = s.contact != 0
    flags[FLAG.ended, i] = left


@inlined
def report(p, s, square, cost, reward, numbers, i):
    """Writes column i of the numbers: INFO, then the reward."""
    numbers[NUMBER.time, i] = s.steps * p.dt
    numbers[NUMBER.position_error, i] = math.sqrt(square)
    numbers[NUMBER.cross_track_error, i] = s.cross_track_error
    numbers[NUMBER.heading_error, i] = s.heading_error
    numbers[NUMBER.cost, i] = cost
    numbers[NUMBER.reward, i] = reward


@inlined
def place(p, s, world, robots, i, draws, j):
    """Sets the pose at which a robot starts: as far from the reference as the scenario says, or a share of it."""
    course = world.courses[s.scenario]
    begin = world.samples[world.times[s.scenario].first]
    s.num_obstacles = 0
    s.field = i
    aside = course.start_offset
    s.x = begin.x + p.apart * (course.start[0] - begin.x + aside * (2.0 * draws[j, 1] - 1.0))
    s.y = begin.y + p.apart * (course.start[1] - begin.y + aside * (2.0 * draws[j, 2] - 1.0))
    turn = wrap_angle(course.start[2] - begin.heading) + course.start_turn * (2.0 * draws[j, 3] - 1.0)
    s.heading = wrap_angle(begin.heading + p.apart * turn)


@inlined
def begin(p, s, world, robots, i, outputs):
    """Writes the first observation and numbers of robot i, which rolls already where that was asked."""
    if p.rolling:
        here = world.samples[world.times[s.scenario].first]
        s.vx = s.wheel_vx = s.command_vx = here.vx
        s.vy = s.wheel_vy = s.command_vy = here.vy
        s.yaw_rate = s.wheel_yaw_rate = s.command_yaw_rate = here.yaw_rate
    s.turned = s.command_yaw_rate
    s.squares = 0.0
    square, cost = measure_error(p, s, world)
    run = world.runs[s.scenario]
    s.arc_length, s.segment, s.cross_track_error, _ = project(
        world.vertices, run, p.window, s.x, s.y, s.heading, 0.0, 0
    )
    observe(p, s, world, robots.noise, i, 0, outputs.out)
    report(p, s, square, cost, 0.0, outputs.numbers, i)


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


class Bank(NamedTuple):
    """The scenarios laid out for a base."""

    courses: NDArray[np.void]
    pool: PathPool
    samples: NDArray[np.void]
    times: NDArray[np.void]
    floors: NDArray[np.float64]  # (scenarios,) m, RMS error of the regulator of `reference_proofs`


# a vector of single environments asks for the same bank once a robot, and every episode of a contest for the same one
@functools.lru_cache(maxsize=4)
def laid_out(scenarios: tuple[Any, ...], base: bytes, holonomic: bool, rolling: bool) -> Bank:
    """Returns the bank of some scenarios for a base, the bytes of a BASE record.

    Raises:
        ValueError: if the base cannot follow a reference; it names the limit, where and how much.
    """
    bases = np.frombuffer(base, BASE)
    courses, times = np.zeros(len(scenarios), COURSE), np.zeros(len(scenarios), TIMES)
    floors, samples, first = np.zeros(len(scenarios)), [], 0
    for k, each in enumerate(scenarios):
        knots = each.knots_of(holonomic)
        scaled = not math.isnan(each.share)
        ramp = 0.0 if rolling or not each.path.closed else RAMP
        laid = lay_out(knots, each.path.closed, each.share if scaled else None, ramp, bases, holonomic)
        if said := beyond(laid, bases, scaled):
            raise ValueError(f"{each.name}: the reference {said}")
        floors[k] = proof(laid, bases, holonomic)[1]
        samples.append(laid.samples)
        times[k] = first, len(laid.samples) - 1, laid.lap
        first += len(laid.samples)
        begin = laid.samples[0]
        start = (begin["x"], begin["y"], begin["heading"]) if each.start is None else each.start
        bound = max(HELD, FLOORS * floors[k])
        courses[k] = each.corridor, start, bound, each.start_offset, each.start_turn
    return Bank(courses, PathPool.of([each.path for each in scenarios]), np.concatenate(samples), times, floors)


@dataclasses.dataclass(frozen=True, kw_only=True)
class TrackingArguments(PathArguments):
    """What an environment with references takes."""

    scenario: Any = argument(
        "eights", 'a name of `TASKS["trajectory_tracking"].presets`, a family ("min_jerk/train"), or a file'
    )
    begins: str = argument("rest", '"rest": a reference in motion sets in within 2 s; "rolling": so does the robot')
    apart: float = argument(1.0, "share of the scenario's distance from the reference at the start; 0: on it")
    reward: str = argument("bounded", '"bounded", "quadratic" or "exp", see below')
    num_preview: int = argument(8, "the preview")
    preview_spacing: float = argument(0.1, shown="0.1 s")


class TrajectoryTracking(PathFollowing):
    """The task of one robot that follows references in time."""

    state_dtype = STATE
    info_names = INFO
    flag_names = FLAGS
    draws = DRAWS
    step_rows = staticmethod(step_rows)
    reset_rows = staticmethod(reset_rows)
    belongs_to: ClassVar[TaskSpec] = TASKS["trajectory_tracking"]
    numbers: ClassVar[type[Any]] = Params

    def __init__(self, arguments: TrackingArguments, options: Options) -> None:
        choose("reward", arguments.reward, REWARDS)
        choose("begins", arguments.begins, BEGINS)
        self.scenarios = path_scenarios(arguments.scenario, arguments.scale, self.belongs_to)
        self.options = options
        self.robot = robot = options.robot
        self.task_params = arguments.numbers(self.numbers)
        rolling = arguments.begins == "rolling"
        base = base_of(robot, options.actuators, options.dt)
        bank = laid_out(self.scenarios, base.tobytes(), robot.holonomic, rolling)
        self.pool, self.floors = bank.pool, bank.floors
        self.layout: Layout[Any] = Observation.layout(
            len(robot.twist_axes), self.task_params.num_preview, self.belongs_to
        )
        self.beam_angles = np.empty(0)
        self.max_obstacles = 0
        self.world = World(bank.courses, bank.pool.vertices, bank.pool.runs, bank.samples, bank.times)
        self.params = records.record(
            PARAMS,
            options.robot_params()
            | dataclasses.asdict(self.task_params)
            | {"max_range": 0.0, "moving": False}
            | {"reward": REWARDS.index(arguments.reward), "rolling": rolling}
            | {"stride": max(round(self.task_params.preview_spacing / options.dt), 1)}
            | {"settled": round(SETTLED / options.dt)},
        )

    def last_indices(self, scenarios: NDArray[np.int64]) -> dict[str, NDArray[np.int64]]:
        """Returns the greatest value (b,) of each index."""
        return {"segment": self.pool.runs["segments"][scenarios] - 1}

    @property
    def of_states(self) -> tuple[Constraint, ...]:
        """Returns the tube, which a robot that leaves it fails by."""
        squares = self.world.courses["tube"] ** 2

        def tube(x: Any, y: Any, scenario: Any) -> list[Any]:
            return [x * x + y * y - squares[scenario]]

        return (Constraint("tube", "state", ("error_x", "error_y", "scenario"), "m^2", squares, tube),)

    def reference_at(self, state: NDArray[np.void]) -> NDArray[np.void]:
        """Returns the SAMPLE record at which a robot shall be."""
        times, k = self.world.times[state["scenario"]], int(state["steps"])
        if k > times["last"]:
            k = int(times["last"] - times["lap"] + 1 + (k - times["last"] - 1) % times["lap"])
        samples: NDArray[np.void] = self.world.samples[times["first"] + k]
        return samples

    def drawing(self, state: NDArray[np.void]) -> dict[str, Any]:
        """Returns what a frame shows of the task, as fields of `rendering.Scene`."""
        here = self.reference_at(state)
        return self.around(state) | {
            "reference": (float(here["x"]), float(here["y"])),
            "caption": (
                f"t {state['steps'] * self.options.dt:5.2f} s   "
                f"error {100.0 * math.hypot(state['error_x'], state['error_y']):6.1f} cm"
            ),
        }

    def briefing_fields(self, states: NDArray[np.void], knows: str) -> dict[str, Any]:
        """Returns the task's part of the briefing: path and reference, unless the policy knows its sensors alone."""
        spaced = {"preview_spacing": float(self.params["stride"][0]) * self.options.dt}
        if knows in ("sensors", "bodies"):
            return spaced
        index = states["scenario"].copy()
        return spaced | {
            "path": Course.of(self.pool, index),
            "reference": References(self.world.samples, self.world.times, index),
        }


class DiffDriveTrajectoryTracking(SingleEnv):
    __doc__ = f"""A differential drive, such as the Pioneer P3DX, is where a reference is, when it is there.

    ## Description

    A reference says for every control period of 0.05 s where the robot shall be, how it shall look and how it shall
    move: a path with a clock. Its clock is scaled for each robot and tier until following takes a given share of the
    wheel speed and the accelerations; a share of 0.56 is an eight in 21 s for the P3DX and in 114 s for the TurtleBot3.
    Every reference but those of `too_fast` was shown to be followed within a millimetre, see
    `envs.scenarios.reference_proofs`. One that ends is held there at rest; one round a closed curve comes again.

    ## Action space

    {DIFF_DRIVE_ACTIONS}

    ## Observation space

    `Box(13 + 5 k,)` float32, k = `num_preview`; `env.unwrapped.task.layout.unpack(observation)` gives the named fields.

    | index | field | meaning | min | max | unit |
    |---|---|---|---|---|---|
    | 0, 1 | pose | measured x, y in the world frame | -inf | inf | m |
    | 2 | pose | measured heading | -pi | pi | rad |
    | 3, 4 | twist | measured forward speed and yaw rate | -inf | inf | m/s, rad/s |
    | 5, 6 | error | reference minus robot, body frame | -inf | inf | m |
    | 7 | error | of the heading | -pi | pi | rad |
    | 8, 9 | reference_twist | of the reference | -inf | inf | m/s, rad/s |
    | 10, 11 | command | the twist last commanded to the wheels | -inf | inf | m/s, rad/s |
    | 12 | time_left | until the reference rests; 0 where it goes round | 0 | inf | s |
    | 13, ... | preview | k poses (x, y, heading) every `preview_spacing` ahead, body frame, each with its twist | | | |

    All fields follow from the measured pose: with `pose_source="odometry"` or noise they err together, as on a robot.

    ## Rewards

    With d the `position_error`, dw the change of the commanded yaw rate in the step and alpha the base's yaw
    acceleration, `reward="bounded"` is

        reward = 1 / (1 + (d / 0.05 m)^2) - 0.02 |dw| / (alpha dt) - 10 left_corridor

    "quadratic" is minus the `cost` of info, and "exp" e to the power of that, both less the same 10:

        cost = z' diag(10, 10, 0.5) z + (u - u_r)' diag(0.01, 0.001) (u - u_r)

    with z the errors in x, y and heading, u the commanded twist and u_r the reference's.

    ## Starting state

    At rest beside the reference's first pose: up to 0.3 m in x and y and 0.3 rad off it, as the scenario says,
    multiplied by `apart`. A reference that would begin in motion sets in smoothly within 2 s; with `begins="rolling"`
    it does not, and the robot begins with its twist. `eights` draws one of 64 scenarios; `reset(options={{"scenario":
    k}})` starts the k-th instead.

    ## Episode end

    Terminated in failure when d exceeds the scenario's tube of 1 m. Truncated after 1200 steps (60 s). It is a success
    if the RMS of d after the first 10 s is at most 20 mm; in `too_fast`, three times what a regulator with a model
    leaves.

    ## Info

    `time` (s), `position_error` (m), `cross_track_error` (m, off the path, whenever), `heading_error` (rad), `cost`,
    and the flags `success` (as it stands), `left_corridor`, `collision`; all of the true pose.

    {arguments_and_odometry(TrackingArguments, holonomic=False)}

    ## Version history

    * v0: first version.
    """

    arguments = TrackingArguments
    asks: ClassVar[type[TrajectoryTracking]] = TrajectoryTracking
    robots = robots_with(holonomic=False)


DiffDriveTrajectoryTrackingVector = vector_of(DiffDriveTrajectoryTracking)


class OmniTrajectoryTracking(DiffDriveTrajectoryTracking):
    __doc__ = sheet_like(
        DiffDriveTrajectoryTracking,
        "A robot on omni or mecanum wheels is where a reference is, when it is there.",
        {
            "Description": """
                A reference says for every control period of 0.05 s where the robot shall be, how it shall look and how
                it shall move. Its clock is scaled for each robot and tier until following takes a given share of the
                wheel speed and the accelerations. A base that goes sideways looks along the path all the same, but in
                `facing_eights`: there it keeps its heading, looks at a point, or spins, and starts at any angle to
                that, for it starts turned about along the path. Every reference but those of `too_fast` was shown to
                be followed within a millimetre, see `envs.scenarios.reference_proofs`. One that ends is held there at
                rest; one round a closed curve comes again.
            """,
            "Observation space": """
                `Box(16 + 6 k,)` float32, k = `num_preview`; `env.unwrapped.task.layout.unpack(observation)` gives the
                named fields.

                | index | field | meaning | min | max | unit |
                |---|---|---|---|---|---|
                | 0, 1 | pose | measured x, y in the world frame | -inf | inf | m |
                | 2 | pose | measured heading | -pi | pi | rad |
                | 3, 4, 5 | twist | measured v_x, v_y, yaw rate | -inf | inf | m/s, rad/s |
                | 6, 7 | error | reference minus robot, body frame | -inf | inf | m |
                | 8 | error | of the heading | -pi | pi | rad |
                | 9, 10, 11 | reference_twist | of the reference | -inf | inf | m/s, rad/s |
                | 12, 13, 14 | command | the twist last commanded to the wheels | -inf | inf | m/s, rad/s |
                | 15 | time_left | until the reference rests; 0 where it goes round | 0 | inf | s |
                | 16, ... | preview | k poses every `preview_spacing` ahead, body frame, each with its twist | | | |

                All fields follow from the measured pose: with `pose_source="odometry"` or noise they err together, as
                on a robot.
            """,
        },
        arguments=TrackingArguments,
        holonomic=True,
    )

    robots = robots_with(holonomic=True)


OmniTrajectoryTrackingVector = vector_of(OmniTrajectoryTracking)
