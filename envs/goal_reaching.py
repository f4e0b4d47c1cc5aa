"""Goal reaching: drive to a goal pose, or through waypoints, among obstacles."""

import dataclasses
import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from wayfield.envs import kinematic_plant, records, sensing
from wayfield.envs.compiled import compiled, inlined
from wayfield.envs.geometry import OBSTACLE, row_clearance, sin_cos, wrap_angle
from wayfield.envs.kinematics import to_body_frame
from wayfield.envs.observation import Field, Layout
from wayfield.envs.scenarios import GoalScenario, goal_scenarios
from wayfield.envs.single import SingleEnv
from wayfield.envs.task import COMMAND, DRIVE, JUDGE, Options, Task
from wayfield.envs.vector import NativeVectorEnv


@dataclasses.dataclass(frozen=True)
class Params:
    """The numbers of the task."""

    heading_weight: float = 0.1  # m/rad, what a turn towards the goal heading is worth in the reward
    time_cost: float = 0.01  # m, taken off at every step
    success_reward: float = 5.0  # m
    collision_penalty: float = 5.0  # m
    end_on_success: int = 1  # 0: the episode runs on to the clock, for station keeping
    end_on_contact: int = 1  # 0: contact is survived (pymunk)


STATE = np.dtype(
    [
        *records.ROBOT_STATE,
        ("num_obstacles", np.int64),
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
    def layout(num_twist: int, num_beams: int, max_range: float) -> "Layout[Observation]":
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


@inlined
def observe(p, s, course, goals, beams, obstacles, spans, noise, i, row, out):
    """Writes the observation of one robot."""
    sensing.measure(p, s, noise, i, row)
    out[i, 0] = s.measured_x
    out[i, 1] = s.measured_y
    out[i, 2] = s.measured_heading
    out[i, 3] = s.measured_vx
    k = 4
    if p.holonomic:
        out[i, k] = s.measured_vy
        k += 1
    out[i, k] = s.measured_yaw_rate
    sine, cosine = sin_cos(s.measured_heading)
    out[i, k + 1], out[i, k + 2] = to_body_frame(
        s.measured_x, s.measured_y, sine, cosine, goals[s.scenario, s.waypoint, 0], goals[s.scenario, s.waypoint, 1]
    )
    out[i, k + 3] = wrap_angle(goals[s.scenario, course.num_goals - 1, 2] - s.measured_heading)
    out[i, k + 4] = course.num_goals - 1 - s.waypoint
    sensing.scan_ranges(
        obstacles,
        i,
        s.num_obstacles,
        s.x,
        s.y,
        s.heading,
        beams,
        p.first_beam,
        p.beam_step,
        p.max_range,
        spans,
        out,
        k + 5,
    )
    sensing.add_range_noise(p, beams.shape[0], noise, i, row, out, k + 5)


@inlined
def judge(p, s, course, goals, beams, obstacles, spans, noise, i, row, out, numbers, flags):
    """Measures robot i against its goal and writes its observation, info and flags."""
    before = s.remaining_distance
    turn_before = abs(s.goal_heading_error)
    track_goal(s, course, goals)
    observe(p, s, course, goals, beams, obstacles, spans, noise, i, row, out)
    progress = before - s.remaining_distance
    turn_progress = turn_before - abs(s.goal_heading_error)
    collision = s.contact != 0
    success = (
        s.waypoint == course.num_goals - 1
        and s.goal_distance <= course.position_tolerance
        and abs(s.goal_heading_error) <= course.heading_tolerance
        and not collision
    )
    reward = progress + p.heading_weight * turn_progress - p.time_cost
    if success:
        reward += p.success_reward
    if collision:
        reward -= p.collision_penalty
    report(p, s, reward, progress, turn_progress, numbers, i)
    flags[0, i] = success
    flags[1, i] = collision
    flags[2, i] = (success and p.end_on_success == 1) or (collision and p.end_on_contact == 1)


@inlined
def report(p, s, reward, progress, turn_progress, numbers, i):
    """Writes column i of the numbers: INFO, then the reward."""
    numbers[0, i] = s.steps * p.dt
    numbers[1, i] = s.goal_distance
    numbers[2, i] = s.goal_heading_error
    numbers[3, i] = s.remaining_distance
    numbers[4, i] = progress
    numbers[5, i] = turn_progress
    numbers[6, i] = s.clearance
    numbers[7, i] = s.waypoint
    numbers[8, i] = reward


@compiled
def step_rows(
    phases, params, states, obstacles, actions, noise, skip, courses, goals, fields, beams, out, numbers, flags
):
    """Runs the asked phases of a step for all robots but those in `skip`.

    Returns the first robot whose action is not finite, before anything has moved; -1 if there is none.
    """
    if phases & COMMAND:
        for i in range(states.shape[0]):
            for k in range(actions.shape[1]):
                if not skip[i] and not math.isfinite(actions[i, k]):
                    return i
    p = params[0]
    spans = np.empty((obstacles.shape[1], 2))
    for i in range(states.shape[0]):
        if skip[i]:
            continue
        s = states[i]
        row = s.noise_row if noise.shape[1] > 1 else 0
        if phases & COMMAND:
            s.contact = 0
            kinematic_plant.command(p, s, actions, i)
            kinematic_plant.shove(p, s, obstacles, i, s.num_obstacles)
        if phases & DRIVE and not s.contact:
            kinematic_plant.drive(p, s, obstacles, i, s.num_obstacles, noise, row)
        if phases & JUDGE:
            s.steps += 1
            judge(
                p,
                s,
                courses[s.scenario],
                goals,
                beams,
                obstacles,
                spans,
                noise,
                i,
                row,
                out,
                numbers,
                flags,
            )
            s.noise_row += 1
    return -1


@compiled
def reset_rows(params, states, obstacles, rows, draws, noise, courses, goals, fields, beams, out, numbers, flags):
    """Starts an episode for each robot in `rows`; draws: uniform numbers, (len(rows), 1 + DRAWS)."""
    p = params[0]
    spans = np.empty((obstacles.shape[1], 2))
    for j in range(rows.shape[0]):
        i = rows[j]
        s = states[i]
        scenario = min(int(draws[j, 0] * courses.shape[0]), courses.shape[0] - 1)
        s.scenario = scenario
        course = courses[scenario]
        s.num_obstacles = course.num_obstacles
        for k in range(course.num_obstacles):
            obstacles[i, k] = fields[scenario, k]
        s.x = course.start[0] + course.start_offset * (2.0 * draws[j, 1] - 1.0)
        s.y = course.start[1] + course.start_offset * (2.0 * draws[j, 2] - 1.0)
        s.heading = wrap_angle(course.start[2] + course.start_turn * (2.0 * draws[j, 3] - 1.0))
        records.halt(s)
        s.clearance = row_clearance(obstacles, i, s.num_obstacles, s.x, s.y) - p.hull_radius
        s.waypoint = 0
        track_goal(s, course, goals)
        observe(p, s, course, goals, beams, obstacles, spans, noise, i, 0, out)
        s.noise_row = 1
        report(p, s, 0.0, 0.0, 0.0, numbers, i)
        flags[:, i] = False


class GoalReaching(Task):
    """The goal-reaching task of one robot on a bank of obstacle fields."""

    state_dtype = STATE
    info_names = INFO
    flag_names = FLAGS
    draws = DRAWS
    step_rows = staticmethod(step_rows)
    reset_rows = staticmethod(reset_rows)

    def __init__(
        self,
        scenario: str,
        options: Options,
        num_beams: int,
        field_of_view: float,
        max_range: float,
        **params: Any,
    ) -> None:
        self.scenarios: tuple[GoalScenario, ...] = goal_scenarios(scenario, options.robot.hull_radius)
        self.options = options
        self.robot = options.robot
        self.max_obstacles = max(len(each.obstacles) for each in self.scenarios)
        self.beam_angles = sensing.beam_angles(num_beams, field_of_view)
        self.max_range = max_range
        most_goals = max(len(each.waypoints) for each in self.scenarios) + 1
        courses = np.zeros(len(self.scenarios), COURSE)
        goals = np.zeros((len(self.scenarios), most_goals, 3))
        fields = np.zeros((len(self.scenarios), self.max_obstacles), OBSTACLE)
        for i, each in enumerate(self.scenarios):
            for name in COURSE.names or ():
                courses[name][i] = getattr(each, name, 0)
            courses["num_goals"][i] = len(each.waypoints) + 1
            courses["num_obstacles"][i] = len(each.obstacles)
            if each.waypoints:
                goals[i, : len(each.waypoints), :2] = each.waypoints
            goals[i, len(each.waypoints)] = each.goal
            fields[i, : len(each.obstacles)] = each.obstacles
        beams = np.column_stack([np.cos(self.beam_angles), np.sin(self.beam_angles)])
        self.world = (courses, goals, fields, beams)
        self.layout = Observation.layout(len(self.robot.twist_axes), num_beams, max_range)
        self.params = records.record(
            PARAMS,
            options.robot_params()
            | dataclasses.asdict(Params(**params))
            | {
                "first_beam": self.beam_angles[0] if num_beams else 0.0,
                "beam_step": self.beam_angles[1] - self.beam_angles[0] if num_beams > 1 else 2.0 * math.pi,
                "max_range": max_range,
            },
        )

    def drawing(self, state: NDArray[np.void]) -> dict[str, Any]:
        """Returns what a frame shows of the task, as fields of `rendering.Scene`."""
        courses, goals, fields, _ = self.world
        scenario = int(state["scenario"])
        course = courses[scenario]
        poses = goals[scenario, : course["num_goals"]]
        solid = fields[scenario, : course["num_obstacles"]]
        reach = solid["radius"] + np.hypot(solid["half_length"], solid["half_width"])
        centres = np.column_stack([solid["x"], solid["y"]])
        points = np.vstack(
            [course["start"][None, :2], poses[:, :2], centres - reach[:, None], centres + reach[:, None]]
        )
        margin = 2.0 * self.robot.hull_radius
        return {
            "goals": poses[state["waypoint"] :],
            "goal_tolerance": float(course["position_tolerance"]),
            "beam_angles": self.beam_angles,
            "max_range": self.max_range,
            "bounds": (*(points.min(axis=0) - margin).tolist(), *(points.max(axis=0) + margin).tolist()),
            "start": tuple(course["start"][:2].tolist()),
            "caption": (
                f"t {state['steps'] * self.options.dt:5.2f} s   goal {state['goal_distance']:5.2f} m   "
                f"clearance {state['clearance']:5.2f} m"
            ),
        }

    def obstacle_counts(self, states: NDArray[np.void]) -> NDArray[np.int64]:
        """Returns how many obstacles each robot has around it."""
        return states["num_obstacles"].copy()

    def told(self, states: NDArray[np.void], knows: str) -> dict[str, Any]:
        """Returns the task's part of the briefing: waypoints and goal, and the obstacles for a policy with a map."""
        if knows == "sensors":
            return {}
        courses, goals, _, _ = self.world
        scenario = states["scenario"]
        return {"goals": goals[scenario], "num_goals": courses["num_goals"][scenario]}


class OmniGoalObstacles(SingleEnv):
    """TO BE WRITTEN"""

    def __init__(
        self,
        scenario: str = "discs",
        robot: str = "omni3",
        dynamics: str = "kinematic",
        actuators: str = "ideal",
        action_mode: str = "twist",
        noise: float = 0.0,
        pose_source: str = "ground_truth",
        shove: tuple[float, float, float, float] | None = None,
        num_beams: int = 32,
        field_of_view: float = 2.0 * math.pi,
        max_range: float = 5.0,
        end_on_success: bool = True,
        end_on_contact: bool = True,
        render_mode: str | None = None,
    ) -> None:
        if not end_on_contact and dynamics == "kinematic":
            raise ValueError('end_on_contact=False needs dynamics="pymunk": without forces no contact can be survived')
        super().__init__(
            GoalReaching(
                scenario,
                Options.of(robot, ("omni3", "omni4"), dynamics, actuators, action_mode, noise, pose_source, shove),
                num_beams,
                field_of_view,
                max_range,
                end_on_success=int(end_on_success),
                end_on_contact=int(end_on_contact),
            ),
            render_mode,
        )


class OmniGoalObstaclesVector(NativeVectorEnv):
    """Many `OmniGoalObstacles` robots stepped by one compiled call; the same keyword arguments."""

    def __init__(self, num_envs: int = 1, **kwargs: Any) -> None:
        super().__init__(OmniGoalObstacles, num_envs, **kwargs)
