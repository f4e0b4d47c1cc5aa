"""Goal reaching: drive to a goal pose, or through waypoints, among obstacles."""

import dataclasses
import functools
import math
from collections.abc import Mapping
from types import MappingProxyType
from typing import Any, ClassVar, NamedTuple

import numpy as np
from numpy.typing import NDArray

from wayfield.envs.robots import records, robots_with, sensing
from wayfield.envs.robots.hulls import least_reach
from wayfield.envs.robots.kinematics import to_body_frame
from wayfield.envs.scenarios import TASKS, GoalScenario, TaskSpec, field_scenarios
from wayfield.envs.single import SingleEnv
from wayfield.envs.tasks.arguments import PlantArguments, ScanArguments, argument
from wayfield.envs.tasks.briefing import Goals
from wayfield.envs.tasks.constraints import Constraint, at_least
from wayfield.envs.tasks.observation import Field, Layout
from wayfield.envs.tasks.sheets import OMNI_ACTIONS, arguments_and_odometry, sheet_like
from wayfield.envs.tasks.stepping import (
    Outputs,
    Reset,
    Robots,
    Step,
    Turn,
    numbered,
    reset_robots,
    step_robots,
    write_motion,
)
from wayfield.envs.tasks.task import Options, Task
from wayfield.envs.vector import vector_of
from wayfield.envs.world.blocks import in_blocks
from wayfield.envs.world.geometry import OBSTACLE, corners_of, surroundings
from wayfield.envs.world.grid_scans import SCRATCH, WORDS, scan_grids
from wayfield.envs.world.grids import FRAME, Grids, clearance_around, lay_grids
from wayfield.envs.world.movers import go_on, turns
from wayfield.system.checks import FINEST, MOST_GAIN, SHORTEST, number, positive, shown, truth, whole
from wayfield.system.compiled import allocating, flattened, inlined
from wayfield.system.elementary import sin_cos, wrap_angle


@dataclasses.dataclass(frozen=True)
class Params:
    """The numbers of the task."""

    heading_weight: float = 0.1  # m/rad, what a turn towards the goal heading is worth in the reward
    time_cost: float = 0.01  # m, taken off at every step
    success_reward: float = 5.0  # m
    collision_penalty: float = 5.0  # m
    rest_speed: float = math.inf  # m/s, no faster than which a robot has reached its goal
    rest_yaw_rate: float = math.inf  # rad/s
    end_on_success: int = 1  # 0: the episode runs on to the clock, for station keeping
    end_on_contact: int = 1  # 0: contact is survived (pymunk)

    def __post_init__(self) -> None:
        for name in ("heading_weight", "time_cost", "success_reward", "collision_penalty"):
            number(name, getattr(self, name), most=MOST_GAIN)
        for name in ("rest_speed", "rest_yaw_rate"):
            number(name, min(getattr(self, name), MOST_GAIN), above=0.0, most=MOST_GAIN)  # inf: no bound
        for name in ("end_on_success", "end_on_contact"):
            whole(name, getattr(self, name), 0, 1)


STATE = np.dtype(
    [
        *records.ROBOT_STATE,
        ("waypoint", np.int64),  # index of the one being driven to; num_goals - 1 is the goal
        ("goal_distance", np.float64),  # m, to the goal
        ("goal_heading_error", np.float64),  # rad, goal heading minus heading
        ("remaining_distance", np.float64),  # m, to the goal through the waypoints left
    ],
    align=True,
)

PARAMS = [
    *records.ROBOT_PARAMS,
    *((field.name, np.dtype(field.type)) for field in dataclasses.fields(Params)),
    ("first_beam", np.float64),  # rad, body frame
    ("beam_step", np.float64),  # rad
    ("shared_field", np.int64),  # 1: nothing in the bank moves or is pushed, and all robots read its own records
]

# One record a scenario of the bank.
COURSE = np.dtype(
    [
        ("start", np.float64, (3,)),
        ("start_offset", np.float64),
        ("start_turn", np.float64),
        ("position_tolerance", np.float64),
        ("heading_tolerance", np.float64),
        ("waypoint_radius", np.float64),
        ("num_goals", np.int64),
        ("num_obstacles", np.int64),
        ("num_blocks", np.int64),  # of those, where no robot has its own: see blocks.in_blocks
        *FRAME,
    ],
    align=True,
)


class Observation(NamedTuple):
    """What a goal seeker sees; b is any batch shape, t the number of twist components."""

    pose: NDArray[Any]  # (b, 3) measured x, y (m), heading (rad), world frame
    twist: NDArray[Any]  # (b, t) measured body twist, m/s and rad/s
    goal: NDArray[Any]  # (b, 2) the waypoint or goal driven to, body frame, m
    goal_heading_error: NDArray[Any]  # (b,) goal heading minus heading, rad
    waypoints_left: NDArray[Any]  # (b,) before the goal
    ranges: NDArray[Any]  # (b, beams) m, at most max_range

    @staticmethod
    def layout(
        num_twist: int, num_beams: int, max_range: float, task: TaskSpec = TASKS["goal_reaching"]
    ) -> "Layout[Observation]":
        """Returns the order of the fields in the flat observation."""
        pi = float(np.nextafter(np.float32(math.pi), np.float32(4)))
        return Layout(
            Observation,
            (
                Field("pose", (3,), [-np.inf, -np.inf, -pi], [np.inf, np.inf, pi]),
                Field("twist", (num_twist,), -np.inf, np.inf),
                Field("goal", (2,), -np.inf, np.inf),
                Field("goal_heading_error", (), -pi, pi),
                Field("waypoints_left", (), 0.0, np.inf),
                Field("ranges", (num_beams,), 0.0, max_range),
            ),
            task,
        )


INFO = (
    "time",
    "goal_distance",
    "goal_heading_error",
    "remaining_distance",
    "progress",
    "turn_progress",
    "clearance",
    "waypoint",
)
FLAGS = ("success", "collision")
NUMBER = numbered(*INFO)
FLAG = numbered(*FLAGS)
DRAWS = 3  # random numbers of a reset, besides the choice of the scenario


@inlined
def track_goal(s, course, goals):
    """Passes the waypoints that are near enough and measures what is left of the way."""
    last = course.num_goals - 1
    dx = goals[s.scenario, s.waypoint, 0] - s.x
    dy = goals[s.scenario, s.waypoint, 1] - s.y
    distance = math.sqrt(dx * dx + dy * dy)
    while s.waypoint < last and distance <= course.waypoint_radius:
        s.waypoint += 1
        dx = goals[s.scenario, s.waypoint, 0] - s.x
        dy = goals[s.scenario, s.waypoint, 1] - s.y
        distance = math.sqrt(dx * dx + dy * dy)
    s.remaining_distance = distance
    for j in range(s.waypoint, last):
        dx = goals[s.scenario, j + 1, 0] - goals[s.scenario, j, 0]
        dy = goals[s.scenario, j + 1, 1] - goals[s.scenario, j, 1]
        s.remaining_distance += math.sqrt(dx * dx + dy * dy)
    dx = goals[s.scenario, last, 0] - s.x
    dy = goals[s.scenario, last, 1] - s.y
    s.goal_distance = math.sqrt(dx * dx + dy * dy)
    s.goal_heading_error = wrap_angle(goals[s.scenario, last, 2] - s.heading)


class Bank(NamedTuple):
    """The arrays that describe the bank."""

    courses: NDArray[np.void]  # (scenarios,) COURSE records
    goals: NDArray[np.float64]  # (scenarios, w, 3) waypoints and, last of num_goals, the goal pose
    fields: NDArray[np.void]  # (scenarios, m) OBSTACLE records
    cells: NDArray[np.uint8]  # of all maps
    beams: NDArray[np.float64]  # (2, n) directions


class World(NamedTuple):
    """The bank and the scanner, as the compiled functions read them."""

    courses: NDArray[np.void]
    goals: NDArray[np.float64]
    fields: NDArray[np.void]
    lidar: sensing.Lidar


@inlined
def observe(p, s, course, world, robots, i, row, out):
    """Writes the observation of one robot; what grids hold is for `scan_maps`."""
    k = observe_goal(p, s, course, world, robots, i, row, out)
    lidar = world.lidar
    pose = (s.x, s.y, s.heading)
    sensing.scan_ranges(lidar, robots.obstacles, s.field, s.num_obstacles, s.num_blocks, pose, out, i, k)
    if robots.grids.cells.shape[0] == 0:
        disturb_ranges(p, lidar, robots.noise, i, row, out, k)


@inlined
def observe_goal(p, s, course, world, robots, i, row, out):
    """Writes the observation of one robot but for the scan; returns the column in which that begins."""
    goals = world.goals
    sensing.measure(p, s, robots.noise, i, row)
    k = write_motion(s, p.holonomic, i, out)
    sine, cosine = sin_cos(s.measured_heading)
    out[i, k], out[i, k + 1] = to_body_frame(
        s.measured_x, s.measured_y, sine, cosine, goals[s.scenario, s.waypoint, 0], goals[s.scenario, s.waypoint, 1]
    )
    out[i, k + 2] = wrap_angle(goals[s.scenario, course.num_goals - 1, 2] - s.measured_heading)
    out[i, k + 3] = course.num_goals - 1 - s.waypoint
    return k + 4


@inlined
def disturb_ranges(p, lidar, noise, i, row, out, column):
    """Adds the noise of a scan to the ranges of robot i, which begin in a column."""
    sensing.add_range_noise(p, lidar.beams.shape[1], noise, i, row, out, column)
    sensing.drop_beams(p, lidar.beams.shape[1], noise, i, row, out, column)


@inlined
def scan_maps(p, lidar, robots, which, out):
    """Shortens the ranges of some robots to what their grids hold: those of several at once, which is faster.

    Args:
        robots: `stepping.Robots`.
        which: the robots that were stepped or reset, as `grids.scan_grids` takes them.
    """
    column = out.shape[1] - lidar.beams.shape[1]
    scan_grids(robots.grids.frames, robots.grids.cells, robots.states, which, least_reach(p), lidar, out, column)
    skip, first, last = which
    for i in range(first, last):
        if skip[i]:
            continue
        row = robots.states[i].noise_row - 1 if robots.noise.shape[1] > 1 else 0
        disturb_ranges(p, lidar, robots.noise, i, row, out, column)


@allocating
def all_but(rows, count):
    """Returns which of `count` robots are not in `rows`, (count,)."""
    others = np.empty(count, np.bool_)
    for i in range(count):
        others[i] = True
    for j in range(rows.shape[0]):
        others[rows[j]] = False
    return others


@inlined
def conclude(p, world, robots, skip, first, last, outputs):
    """Sees to what is sooner done for several robots than for each: those from the first on, without the last."""
    if robots.grids.cells.shape[0] > 0:
        scan_maps(p, world.lidar, robots, (skip, first, last), outputs.out)


@inlined
def judge(p, s, world, robots, i, row, outputs):
    """Measures robot i against its goal and writes its observation, info and flags."""
    course = world.courses[s.scenario]
    before = s.remaining_distance
    turn_before = abs(s.goal_heading_error)
    track_goal(s, course, world.goals)
    observe(p, s, course, world, robots, i, row, outputs.out)
    assess(p, s, course, before, turn_before, outputs, i)


@inlined
def assess(p, s, course, before, turn_before, outputs, i):
    """Writes reward, info and flags of robot i, whose way left and turn left were those `before`.

    The reward is the last of the numbers and the end the last of the flags: what stands between is another task's.
    """
    progress = before - s.remaining_distance
    turn_progress = turn_before - abs(s.goal_heading_error)
    collision = s.contact != 0
    success = (
        s.waypoint == course.num_goals - 1
        and s.goal_distance <= course.position_tolerance
        and abs(s.goal_heading_error) <= course.heading_tolerance
        and abs(s.yaw_rate) <= p.rest_yaw_rate
        and s.vx * s.vx + s.vy * s.vy <= p.rest_speed * p.rest_speed
        and not collision
    )
    reward = progress + p.heading_weight * turn_progress - p.time_cost
    if success:
        reward += p.success_reward
    if collision:
        reward -= p.collision_penalty
    report(p, s, reward, progress, turn_progress, outputs.numbers, i)
    flags = outputs.flags
    flags[FLAG.success, i] = success
    flags[FLAG.collision, i] = collision
    flags[flags.shape[0] - 1, i] = (success and p.end_on_success == 1) or (collision and p.end_on_contact == 1)


@inlined
def report(p, s, reward, progress, turn_progress, numbers, i):
    """Writes column i of the numbers: INFO, then the reward."""
    numbers[NUMBER.time, i] = s.steps * p.dt
    numbers[NUMBER.goal_distance, i] = s.goal_distance
    numbers[NUMBER.goal_heading_error, i] = s.goal_heading_error
    numbers[NUMBER.remaining_distance, i] = s.remaining_distance
    numbers[NUMBER.progress, i] = progress
    numbers[NUMBER.turn_progress, i] = turn_progress
    numbers[NUMBER.clearance, i] = s.clearance
    numbers[NUMBER.waypoint, i] = s.waypoint
    numbers[numbers.shape[0] - 1, i] = reward


@inlined
def place(p, s, world, robots, i, draws, j):
    """Sets the obstacles around a robot and the pose at which it starts: displaced where that is clear."""
    obstacles = robots.obstacles
    course = world.courses[s.scenario]
    s.num_obstacles = course.num_obstacles
    s.field = s.scenario if p.shared_field == 1 else i
    s.num_blocks = course.num_blocks if p.shared_field == 1 else 0
    if p.shared_field == 0:
        for k in range(course.num_obstacles):
            obstacles[i, k] = world.fields[s.scenario, k]
    if p.moving:
        go_on(obstacles, i, course.num_obstacles, 0.0)
    s.x = course.start[0] + course.start_offset * (2.0 * draws[j, 1] - 1.0)
    s.y = course.start[1] + course.start_offset * (2.0 * draws[j, 2] - 1.0)
    if clearance_around(robots, i, s, s.x, s.y) <= p.hull_radius:
        s.x = course.start[0]
        s.y = course.start[1]
    s.heading = wrap_angle(course.start[2] + course.start_turn * (2.0 * draws[j, 3] - 1.0))


@inlined
def begin(p, s, world, robots, i, outputs):
    """Writes the first observation and numbers of robot i."""
    course = world.courses[s.scenario]
    s.waypoint = 0
    track_goal(s, course, world.goals)
    observe(p, s, course, world, robots, i, 0, outputs.out)
    report(p, s, 0.0, 0.0, 0.0, outputs.numbers, i)


@flattened(allocating)
def step_rows(phases: int, turn: Turn, step: Step, bank: Bank, outputs: Outputs) -> Any:
    """Runs `stepping.step_robots`."""
    world = World(bank.courses, bank.goals, bank.fields, scanner(step.params[0], bank.beams, bank.cells))
    robots = Robots(step.params, step.states, step.obstacles, step.noise, Grids(bank.courses, bank.cells))
    return step_robots(judge, conclude, phases, turn, robots, step.actions, step.skip, world, outputs)


@flattened(allocating)
def reset_rows(reset: Reset, bank: Bank, outputs: Outputs) -> None:
    """Runs `stepping.reset_robots`."""
    world = World(bank.courses, bank.goals, bank.fields, scanner(reset.params[0], bank.beams, bank.cells))
    robots = Robots(reset.params, reset.states, reset.obstacles, reset.noise, Grids(bank.courses, bank.cells))
    reset_robots(place, begin, robots, reset.rows, reset.draws, world, outputs)
    if bank.cells.shape[0] > 0:
        count = reset.states.shape[0]
        scan_maps(reset.params[0], world.lidar, robots, (all_but(reset.rows, count), 0, count), outputs.out)


@allocating
def scanner(p, beams, cells):
    """Returns the range scanner, with scratch for obstacles and, where the batch has some, for maps."""
    # from where a line of the processor's cache begins: numbers that go together lie in one
    size = SCRATCH if cells.shape[0] > 0 else 0
    room = np.empty(size + 15, np.float32)
    begin = (64 - np.int64(room.ctypes.data) % 64) % 64 // 4
    ways = room[begin : begin + size]
    scratch = np.empty(sensing.ROOM)
    return sensing.Lidar(beams, p.first_beam, p.beam_step, p.max_range, scratch, ways, np.empty(WORDS, np.uint64))


def _courses_and_fields(scenarios: tuple[GoalScenario, ...]) -> list[NDArray[Any]]:
    """Returns a copy of what `_laid_out` returns, not shared with another batch."""
    few = sum(len(each.obstacles) for each in scenarios) <= _MOST_CACHED
    cached = few and all(each.grid is None for each in scenarios)  # a map is the user's own, and may be large
    return [each.copy() for each in (_laid_out if cached else _laid_out.__wrapped__)(scenarios)]


_MOST_CACHED = 20_000  # obstacles; those of all families are fewer, and take 10 MB


# a vector of single environments asks for the same bank once a robot, and every episode of a contest for the same one
@functools.lru_cache(maxsize=4)
def _laid_out(scenarios: tuple[GoalScenario, ...]) -> tuple[NDArray[Any], ...]:
    """Returns the courses of a bank and, a row each, their goals and obstacles."""
    most_goals = max(len(each.waypoints) for each in scenarios) + 1
    courses = np.zeros(len(scenarios), COURSE)
    goals = np.zeros((len(scenarios), most_goals, 3))
    fields = np.zeros((len(scenarios), max(len(each.obstacles) for each in scenarios)), OBSTACLE)
    for i, each in enumerate(scenarios):
        for name in COURSE.names or ():
            courses[name][i] = getattr(each, name, 0)
        courses["num_goals"][i] = len(each.waypoints) + 1
        courses["num_obstacles"][i] = len(each.obstacles)
        if each.waypoints:
            goals[i, : len(each.waypoints), :2] = each.waypoints
        goals[i, len(each.waypoints)] = each.goal
        fields[i, : len(each.obstacles)] = each.obstacles
    return courses, goals, fields


@dataclasses.dataclass(frozen=True, kw_only=True)
class GoalArguments(PlantArguments, ScanArguments):
    """What an environment among obstacles takes."""

    scenario: Any = argument(
        "discs", 'a name of `envs.scenarios.GOAL_SCENARIOS`, a family ("clutter_10/train"), or a file'
    )
    end_on_success: bool = argument(True, "see Episode end")
    end_on_contact: bool = argument(True)

    def __post_init__(self) -> None:
        truth("end_on_success", self.end_on_success)
        truth("end_on_contact", self.end_on_contact)
        if not self.end_on_contact and self.dynamics == "kinematic":
            raise ValueError(
                'end_on_contact=False needs dynamics="pymunk" or "mujoco": without forces no contact can be survived'
            )


class GoalReaching(Task):
    """The goal-reaching task of one robot on a bank of obstacle fields."""

    state_dtype = STATE
    info_names: ClassVar[tuple[str, ...]] = INFO
    flag_names: ClassVar[tuple[str, ...]] = FLAGS
    draws = DRAWS
    step_rows = staticmethod(step_rows)
    reset_rows = staticmethod(reset_rows)
    belongs_to: ClassVar[TaskSpec] = TASKS["goal_reaching"]
    numbers: ClassVar[type[Params]] = Params
    param_fields: ClassVar[list[Any]] = PARAMS
    further: Mapping[str, Any] = MappingProxyType({})  # the values of those that are another task's

    def __init__(self, arguments: ScanArguments, options: Options) -> None:
        scan, scenario = options.robot.sensors, arguments.scenario
        num_beams = scan.beams if arguments.num_beams is None else arguments.num_beams
        field_of_view = scan.angle if arguments.field_of_view is None else arguments.field_of_view
        max_range = scan.range if arguments.max_range is None else arguments.max_range
        whole("num_beams", num_beams, 0)
        positive("max_range", max_range, least=SHORTEST)
        positive("field_of_view", field_of_view, most=MOST_GAIN)
        if not FINEST <= field_of_view <= 2.0 * math.pi:
            raise ValueError(f"field_of_view must be above 0 and at most 2 pi rad, got {field_of_view!r}")
        field_of_view, max_range = float(field_of_view), float(max_range)
        self.scenarios = self.bank(scenario, options.robot.hull_radius)
        courses_of = self.courses_of()
        if options.dynamics == "coppelia" and any(each.grid is not None for each in courses_of):
            raise ValueError(f'scenario {shown(scenario)} has a map; dynamics="coppelia" has none')
        self.options = options
        self.robot = options.robot
        self.max_obstacles = max(len(each.obstacles) for each in courses_of)
        self.beam_angles = sensing.beam_angles(num_beams, field_of_view)
        self.max_range = max_range
        courses, goals, fields = _courses_and_fields(courses_of)
        self.grids = lay_grids([each.grid for each in courses_of], courses)
        moving = bool(fields["patrol"]["leg_time"].any())
        self.fields = fields
        self.shared_obstacles = None
        if options.dynamics == "kinematic" and not moving:
            self.shared_obstacles, courses["num_blocks"] = in_blocks(fields, courses["num_obstacles"])
        beams = np.ascontiguousarray(sensing.beam_directions(self.beam_angles).T)
        self.world: Any = Bank(courses, goals, fields, self.grids.cells, beams)
        self.layout = self.observed(num_beams, max_range)
        self.params = records.record(
            self.param_fields,
            options.robot_params()
            | dataclasses.asdict(arguments.numbers(self.numbers))
            | {
                "first_beam": self.beam_angles[0] if num_beams else 0.0,
                "beam_step": self.beam_angles[1] - self.beam_angles[0] if num_beams > 1 else 2.0 * math.pi,
                "max_range": max_range,
                "moving": moving,
                "shared_field": self.shared_obstacles is not None,
            }
            | dict(self.further),
        )

    def bank(self, scenario: str, hull_radius: float) -> tuple[Any, ...]:
        """Returns the scenarios of a name, for a hull of a radius (m)."""
        return field_scenarios(self.belongs_to, scenario, hull_radius)

    def observed(self, num_beams: int, max_range: float) -> Layout[Any]:
        """Returns the layout of what a robot observes."""
        return Observation.layout(len(self.robot.twist_axes), num_beams, max_range, self.belongs_to)

    def last_indices(self, scenarios: NDArray[np.int64]) -> dict[str, NDArray[np.int64]]:
        """Returns the greatest value (b,) of each index."""
        return {"waypoint": self.world.courses["num_goals"][scenarios] - 1}

    @property
    def of_states(self) -> tuple[Constraint, ...]:
        """Returns the distance of hull and obstacles."""
        return (at_least("clearance", "clearance"),)

    def drawing(self, state: NDArray[np.void]) -> dict[str, Any]:
        """Returns what a frame shows of the task, as fields of `rendering.Scene`."""
        courses, goals, fields, *_ = self.world
        scenario = int(state["scenario"])
        course = courses[scenario]
        poses = goals[scenario, : course["num_goals"]].copy()
        poses[:-1, 2] = np.nan  # a waypoint has no heading
        solid = fields[scenario, : course["num_obstacles"]]
        low, high = corners_of(solid)
        points = np.vstack([course["start"][None, :2], poses[:, :2], low, high])
        # both ends of every patrol, so that nothing moves out of the frame
        reach = 0.5 * (high - low)[solid["patrol"]["leg_time"] > 0.0]
        points = np.vstack([points, *(end + r for end in turns(solid).swapaxes(0, 1) for r in (-reach, reach))])
        grid = self.courses_of()[scenario].grid
        if grid is not None:
            points = np.vstack([points, grid.corners])
        # a large world is shown where it is driven in; the robot counts in whole metres, for what moves the frame has
        # all layers drawn anew
        here = np.round([state["x"], state["y"]])
        part = surroundings(np.vstack([course["start"][:2], poses[:, :2], here]), points)
        margin = 2.0 * self.robot.hull_radius
        room = f"   clearance {self.room(state):5.2f} m" if self.room(state) < math.inf else ""
        return {
            "grid": grid,
            "goals": poses[state["waypoint"] :],
            "goal_tolerance": float(course["position_tolerance"]),
            "beam_angles": self.beam_angles,
            "max_range": self.max_range,
            "bounds": part or (*(points.min(axis=0) - margin).tolist(), *(points.max(axis=0) + margin).tolist()),
            "start": tuple(course["start"][:2].tolist()),
            "caption": f"t {state['steps'] * self.options.dt:5.2f} s   goal {state['goal_distance']:5.2f} m" + room,
        }

    def room(self, state: NDArray[np.void]) -> float:
        """Returns the distance (m) of the robot's hull to the nearest thing that it can touch; inf: none is near."""
        return float(state["clearance"])

    def obstacle_counts(self, states: NDArray[np.void]) -> NDArray[np.int64]:
        """Returns how many obstacles each robot has around it."""
        return states["num_obstacles"].copy()

    def briefing_fields(self, states: NDArray[np.void], knows: str) -> dict[str, Any]:
        """Returns the task's part of the briefing: waypoints and goal, and the obstacles for a policy with a map."""
        courses, goals, *_ = self.world
        scenario = states["scenario"]
        fields: dict[str, Any] = {name: courses[name][scenario] for name in ("position_tolerance", "heading_tolerance")}
        if knows not in ("sensors", "bodies"):
            fields["goal"] = Goals(goals[scenario], courses["num_goals"][scenario])
        return fields


class OmniGoalObstacles(SingleEnv):
    __doc__ = f"""A robot on omni or mecanum wheels drives to a goal pose, or through waypoints, among obstacles.

    ## Description

    A holonomic robot with three omni wheels (document B: wheel radius 0.075 m on a circle of 0.3 m), four (document C:
    0.03 m on 0.13 m) or four mecanum wheels (0.05 m) shall reach a goal pose among circles, boxes and walls, passing
    waypoints in their order where the scenario has some. Control period 0.05 s. The hull is a disc: 0.3 m for omni3,
    0.177 m for omni4, 0.27 m for mecanum4. Obstacles with a patrol move by themselves: in each step first to where they
    are at its end, then the robot drives.

    ## Action space

    {OMNI_ACTIONS}

    ## Observation space

    `Box(10 + n,)` float32, n = `num_beams`; `env.unwrapped.task.layout.unpack(observation)` gives the named fields.

    | index | field | meaning | min | max | unit |
    |---|---|---|---|---|---|
    | 0, 1 | pose | measured x, y in the world frame | -inf | inf | m |
    | 2 | pose | measured heading | -pi | pi | rad |
    | 3, 4, 5 | twist | measured v_x, v_y, yaw rate | -inf | inf | m/s, rad/s |
    | 6, 7 | goal | the waypoint or goal driven to, body frame | -inf | inf | m |
    | 8 | goal_heading_error | goal heading minus heading, in (-pi, pi] | -pi | pi | rad |
    | 9 | waypoints_left | before the goal | 0 | inf | |
    | 10, ... | ranges | from right to left over `field_of_view`, a full circle from behind | 0 | max_range | m |

    ## Rewards

    With `progress` (decrease of `remaining_distance`), `turn_progress` (decrease of |goal_heading_error|), `success`
    and `collision` of info:

        reward = progress + 0.1 turn_progress - 0.01 + 5 success - 5 collision

    ## Starting state

    At rest at the scenario's start, displaced by uniform draws from +-`start_offset` in x and y (not where that would
    touch an obstacle) and turned by one from +-`start_turn`. A random family such as "discs" draws one of 64 fields;
    `reset(options={{"scenario": k}})` starts the k-th instead, and draws all else as without it.

    ## Episode end

    Terminated in success when the waypoints are passed and the pose is within the scenario's tolerance of the goal in
    position and heading; in failure when the hull touches an obstacle, in front of which the kinematic robot stops, or
    when a moving obstacle runs into the hull, which makes `clearance` negative.
    Truncated after 1200 steps (60 s). `end_on_success=False` runs on, to show station keeping, and pays the success
    reward at every step within tolerance; `end_on_contact=False` (pymunk) survives contact.

    ## Info

    `time` (s), `goal_distance` (m), `goal_heading_error` (rad), `remaining_distance` (m, through the waypoints left),
    `progress` (m), `turn_progress` (rad), `clearance` (m, hull to the nearest surface; inf without obstacles),
    `waypoint` (index of the one driven to), and the flags `success`, `collision`; all of the true pose.

    {arguments_and_odometry(GoalArguments, holonomic=True)}

    ## Version history

    * v0: first version.
    """

    arguments = GoalArguments
    asks: ClassVar[type[GoalReaching]] = GoalReaching
    robots = robots_with(holonomic=True)


OmniGoalObstaclesVector = vector_of(OmniGoalObstacles)


class DiffDriveGoalObstacles(OmniGoalObstacles):
    __doc__ = sheet_like(
        OmniGoalObstacles,
        "A differential drive, such as the Pioneer P3DX, drives to a goal pose, or through waypoints, among obstacles.",
        {
            "Description": """
                A differential-drive robot (document A: wheel radius 0.0975 m, half track 0.1905 m, rim speed at most
                1.2 m/s; others in `wayfield.envs.robots`), which cannot go sideways, shall reach a goal pose among
                circles, boxes and walls, passing waypoints in their order where the scenario has some. Control period
                0.05 s. The hull is a disc, of 0.25 m for p3dx, or a rectangle, of 0.508 m x 0.43 m for jackal.
                Obstacles with a patrol move by themselves: in each step first to where they are at its end, then the
                robot drives.
            """,
            "Observation space": """
                `Box(9 + n,)` float32, n = `num_beams`; `env.unwrapped.task.layout.unpack(observation)` gives the named
                fields.

                | index | field | meaning | min | max | unit |
                |---|---|---|---|---|---|
                | 0, 1 | pose | measured x, y in the world frame | -inf | inf | m |
                | 2 | pose | measured heading | -pi | pi | rad |
                | 3, 4 | twist | measured forward speed and yaw rate | -inf | inf | m/s, rad/s |
                | 5, 6 | goal | the waypoint or goal driven to, body frame | -inf | inf | m |
                | 7 | goal_heading_error | goal heading minus heading, in (-pi, pi] | -pi | pi | rad |
                | 8 | waypoints_left | before the goal | 0 | inf | |
                | 9, ... | ranges | right to left over `field_of_view`, a full circle from behind | 0 | max_range | m |
            """,
        },
        arguments=GoalArguments,
        holonomic=False,
    )

    robots = robots_with(holonomic=False)


DiffDriveGoalObstaclesVector = vector_of(DiffDriveGoalObstacles)
