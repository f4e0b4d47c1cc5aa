"""Model predictive control to a pose: plans of speeds and yaw rates, forward and backward, by quadratic programs."""

import dataclasses
import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from wayfield.envs import goal_reaching
from wayfield.envs.robots.kinematics import limit_acceleration, limits
from wayfield.envs.tasks.briefing import Briefing
from wayfield.policies.parts.arriving import is_there, stay_radius, turn_rate
from wayfield.policies.parts.gain import gain
from wayfield.policies.parts.laws import GoalLaw
from wayfield.policies.parts.params import params
from wayfield.policies.parts.polar_coordinates import polar_twist
from wayfield.policies.parts.quadratic import Solver
from wayfield.policies.parts.shooting import Slopes, drive_on, lagged_period
from wayfield.policies.parts.steering import unicycle_twists
from wayfield.system.compiled import allocating, any_layout, assign, compiled, inlined
from wayfield.system.elementary import bearing, sin_cos
from wayfield.system.threads import one_a_thread

Array = NDArray[np.float64]

MOST_HORIZON = 100  # steps: the Hessian grows with their square
DAMPING = 0.02  # of the Hessian's largest diagonal entry, added to all
_LOOP = 2.0  # rad/m, yaw rate by speed, of the plan that moves the robot sideways
SHARES = (1.0, 0.5, 0.25)  # of a change of plan, that are tried


class Program(NamedTuple):
    """A quadratic program of 2 n changes z of the plan: minimise z'Hz/2 + g'z within bounds of constant rows."""

    hessian: Array  # (2 n, 2 n), its upper triangle
    gradient: Array  # (2 n,)
    lower: Array  # (rows,)
    upper: Array


@dataclasses.dataclass(frozen=True)
class MpcPose(GoalLaw):
    """Drives the start of the best plan for the next `horizon` steps, planned anew in every control period.

    In the frame of the pose to be reached, x along its heading, it minimises over the commands (v_k, w_k), with
    h = step,

        sum_k h (along x_k^4 + across y_k^2 + heading th_k^4 + effort (v_k^4 + w_k^4 / 16))

    over the plant's own motion: from one step to the next the command changes by equal parts in each control period,
    behind it a first-order lag, exact arcs. The powers are the point: with squares throughout, a robot beside its pose
    would stay there whatever the weights, since to move off x and th costs more at once than y pays within any horizon;
    with these no terminal cost or constraint is needed. Bounds: |v_k| <= speed, |w_k| <= max_yaw_rate, the
    accelerations and the wheel speeds.

    Each period takes the cheapest of five plans, the last one, moved on, and, forward and backward, what the law of
    `polar` would drive and a loop that leads sideways, v = a sin s, w = 2 a cos s, s from 0 to 2 pi, with the a that
    takes y off: beside the pose and parallel to it the sum is level, and no step would leave it. It improves that plan
    by a Gauss-Newton step: a program that OSQP solves, of whose change all, a
    half or a quarter is taken, the first that makes the plan cheaper. Programs that are not solved are counted in the
    memory's field `qp_failures`; the plan is then driven as it is. At the pose (see `arrival_radius` of `SmoothPose`)
    the robot turns on the spot by what is left. What stands around is not seen. A waypoint is taken as a pose that is
    headed for. Drives any robot as a unicycle.

    Sources: Worthmann, Mehrez, Zanon, Mann, Gosine and Diehl, Model Predictive Control of Nonholonomic Mobile Robots
    Without Stabilizing Constraints and Costs, IEEE Trans. Control Syst. Technol. 24(4), 2016 (the sum); Diehl, Bock and
    Schloeder, SIAM J. Control Optim. 43(5), 2005 (real-time iteration); Stellato et al., Math. Prog. Comp. 12, 2020
    (OSQP). The plans to choose from and the turn at the end are ours.
    """

    along: float = gain(1.0, "1/(m^4 s)", "weight of the fourth power of x", above=0.0)
    across: float = gain(5.0, "1/(m^2 s)", "weight of the square of y", above=0.0, search=(1.0, 20.0))
    heading: float = gain(0.1, "1/(rad^4 s)", "weight of the fourth power of th", above=0.0, search=(0.02, 0.5))
    effort: float = gain(
        0.1,
        "s^3/m^4",
        "weight of the fourth power of v; of w a quarter",
        above=0.0,
        search=(0.01, 0.5),
    )
    speed: float = gain(0.6, "m/s", "at most", above=0.0, search=(0.2, 0.6))
    horizon: int = gain(20, "steps", "of the prediction", least=1, most=MOST_HORIZON)
    step: float = gain(0.15, "s", "rounded to whole control periods", above=0.0, search=(0.1, 0.25))
    solver_iterations: int = gain(400, "1", "of OSQP, at most", least=1, most=1_000_000)
    arrival_radius: float = gain(
        0.02, "m", "within which it turns to the heading, or less if the goal asks for it", above=0.0
    )
    turn_gain: float = gain(2.0, "1/s", "of the turn at the goal", above=0.0)
    yaw_acceleration: float = gain(1.0, "rad/s^2", "of the turn at the goal; no more than the base can", above=0.0)
    max_yaw_rate: float = gain(1.5, "rad/s", "at most", above=0.0)

    def reset(self, briefing: Briefing) -> NDArray[Any]:
        """Returns each robot's plan, last command and count of failures, (b,); all zero: it stands."""
        memory = np.zeros(
            briefing.num_envs,
            [
                ("commands", np.float64, (2, self.horizon)),  # at the end of each step, m/s and rad/s
                ("command", np.float64, (2,)),  # of the last control period
                ("arrived", np.float64),
                ("stay", np.float64),  # m, of `stay_radius`
                ("qp_failures", np.int64),  # programs that were not solved, in this episode
            ],
        )
        memory["stay"] = stay_radius(self.arrival_radius, briefing)
        return memory

    def act(self, observation: goal_reaching.Observation, briefing: Briefing, memory: NDArray[Any]) -> Array:
        """Returns the twists (b, t): m/s, rad/s, and nothing sideways."""
        actuators, robot = briefing.actuators, briefing.robot
        p = params(
            self,
            briefing,
            substeps=max(round(self.step / briefing.dt), 1),
            max_speed=self.speed,
            deceleration=0.4 * min(actuators.acceleration, 1.0),
            k_rho=3.0,
            k_alpha=8.0,
            k_beta=-1.5,
            yaw_acceleration=min(self.yaw_acceleration, actuators.yaw_acceleration),
        )
        wheels = tuple(map(tuple, robot.wheel_matrix[:, [0, 2]].tolist()))
        program = pose_program(self.horizon, wheels, self.speed, self.solver_iterations)
        twists = np.empty((len(memory), 2))
        commands, command = memory["commands"], memory["command"]
        seen = Seen(observation.goal, observation.goal_heading_error, observation.waypoints_left, observation.twist)
        for i in range(len(memory)):
            if rest(p, seen, memory, i, twists):
                continue
            cost = choose(p, seen, memory, command, commands, i)
            slope = linearise(p, seen, command, commands, i, program.arrays)
            change = program.solve(slope)
            if change is None:
                memory["qp_failures"][i] += 1
            else:
                improve(p, seen, command, commands, i, cost, change)
            apply(p, commands, command, i, twists)
        return unicycle_twists(robot, twists[:, 0], twists[:, 1])


class Seen(NamedTuple):
    """What b robots observe of their goals and of themselves."""

    goals: Array  # (b, 2) m, body frame
    turns: Array  # (b,) rad, goal heading minus heading
    waypoints_left: Array  # (b,)
    twists: Array  # (b, t) m/s and rad/s


class PoseProgram:
    """Minimises z'Hz/2 + g'z over changes (v_1 ... v_N, w_1 ... w_N) of a plan within bounds on constant rows.

    The rows, each for every step: speed, yaw rate, their changes, each wheel's speed. OSQP keeps nothing of one
    solution for the next.
    """

    def __init__(self, horizon: int, wheels: tuple[tuple[float, ...], ...], speed: float, iterations: int) -> None:
        """Sets the program up; wheels: by v (rad/m) and by w, for each wheel."""
        # here, so that a look at the policies does not wait for SciPy
        import scipy.sparse

        n = horizon
        one = scipy.sparse.eye(n)
        change = one - scipy.sparse.eye(n, k=-1)
        fastest = max(abs(by_v) for by_v, _ in wheels)
        rows = [[one, None], [None, one], [change, None], [None, change]]
        # in units of the speed: so OSQP weighs what is asked of the wheels like what is asked of the rest
        rows += [[by_v / fastest * one, by_w / fastest * one] for by_v, by_w in wheels]
        constraints = scipy.sparse.csc_matrix(scipy.sparse.block_array(rows))
        self.unit = 1.0 / fastest
        pattern = np.triu(np.ones((2 * n, 2 * n)))
        size = constraints.shape[0]
        self.arrays = Program(np.zeros((2 * n, 2 * n)), np.zeros(2 * n), np.zeros(size), np.zeros(size))
        self._none = np.zeros(2 * n), np.zeros(size)
        self._speed = speed
        bounds = self.arrays.lower, self.arrays.upper
        self._solver = Solver(pattern, self.arrays.gradient, constraints, bounds, iterations)

    def solve(self, slope: float) -> Array | None:
        """Returns the change (2 n,) of the plan; None if the program is not solved.

        Args:
            slope: the largest derivative of the sum at the plan, by which the sum is divided: its fourth powers vary
                more than OSQP's tolerances can.
        """
        if not math.isfinite(slope):
            return None
        share = 1.0 / max(slope, 1e-9)
        arrays = self.arrays
        solution = self._solver.solve(share, arrays.gradient, arrays.lower, arrays.upper, arrays.hessian, self._none)
        return None if solution is None else solution[0]


# One program serves every robot of its kind in a thread: it holds nothing of theirs from one solution to the next.
pose_program = one_a_thread(PoseProgram)


@any_layout
@compiled
def rest(params, seen, memory, i, twists):
    """Returns whether robot i is at its goal, where it turns on the spot; its plan is then to stand."""
    p = params[0]
    m = memory[i]
    px, py = seen.goals[i]
    # forward or backward: the place is reached when it no longer lies where the last command drives
    way = -1.0 if m.command[0] < 0.0 else 1.0
    there = is_there(m.arrived == 1.0, way * px, way * py, p.arrival_radius, m.stay) and seen.waypoints_left[i] == 0.0
    m.arrived = 1.0 if there else 0.0
    if there:
        twists[i, 0] = 0.0
        twists[i, 1] = turn_rate(p, seen.turns[i])
        m.commands[:] = 0.0
        m.command[0] = 0.0
        m.command[1] = twists[i, 1]
    return there


@inlined
def pose_in_goal_frame(seen, i):
    """Returns the robot's pose (x, y, heading) in the frame of its goal; a waypoint is headed for."""
    gx, gy = seen.goals[i]
    turn = seen.turns[i] if seen.waypoints_left[i] == 0.0 else bearing(gy, gx)
    sine, cosine = sin_cos(turn)
    return -(cosine * gx + sine * gy), sine * gx - cosine * gy, -turn


@inlined
def last_twist(seen, i):
    """Returns the lagging twist (v, w) of robot i."""
    return seen.twists[i, 0], seen.twists[i, seen.twists.shape[1] - 1]


@inlined
def step_cost(p, pose, v, w):
    """Returns what a step adds to the sum."""
    x, y, heading = pose
    v2 = v * v
    w2 = 0.0625 * w * w
    x2 = x * x
    turn2 = heading * heading
    return p.step * (
        p.along * x2 * x2 + p.across * y * y + p.heading * turn2 * turn2 + p.effort * (v2 * v2 + 16.0 * w2 * w2)
    )


@compiled
def plan_cost(p, pose, twist, last, plan):
    """Returns the sum for a plan (2, n) from a pose in the goal's frame, a lagging twist and the last command."""
    total = 0.0
    before_v, before_w = last
    for k in range(plan.shape[1]):
        for j in range(p.substeps):
            share = (j + 1) / p.substeps
            v = before_v + share * (plan[0, k] - before_v)
            w = before_w + share * (plan[1, k] - before_w)
            pose, twist, _ = lagged_period(p, pose, twist, (v, w))
        before_v = plan[0, k]
        before_w = plan[1, k]
        total += step_cost(p, pose, before_v, before_w)
    return total


@compiled
def polar_plan(p, radius, pose, twist, last, way, plan):
    """Fills a plan (2, n) with what `polar` drives: forward, way 1, or backward, -1; within `radius` (m) it turns."""
    v, w = last
    for k in range(plan.shape[1]):
        for _ in range(p.substeps):
            x, y, heading = pose
            sine, cosine = sin_cos(heading)
            gx = -way * (cosine * x + sine * y)
            gy = -way * (cosine * y - sine * x)
            if gx * gx + gy * gy > radius * radius:
                to_v, to_w = polar_twist(p, gx, gy, -heading)
                to_v *= way
            else:
                to_v = 0.0
                to_w = turn_rate(p, -heading)
            v, _, w = limit_acceleration(
                (v, 0.0, w), (to_v, 0.0, to_w), p.plant.acceleration, p.plant.yaw_acceleration, p.plant.dt
            )
            pose, twist, _ = lagged_period(p, pose, twist, (v, w))
        plan[0, k] = v
        plan[1, k] = w


@compiled
def loop_plan(p, pose, way, plan):
    """Fills a plan (2, n) that moves a robot beside its pose sideways: out, forward (way 1) or backward, and back.

    With v = a sin(s), w = b cos(s), s from 0 to 2 pi over the horizon of T seconds, x and th come back to where they
    began and y changes by a b T^2 / (4 pi), to third order.
    """
    n = plan.shape[1]
    horizon = n * p.step
    product = 4.0 * math.pi * pose[1] / (horizon * horizon)
    a = min(math.sqrt(abs(product) / _LOOP), p.speed)
    for k in range(n):
        sine, cosine = sin_cos(2.0 * math.pi * (k + 1) / n)
        plan[0, k] = way * a * sine
        plan[1, k] = -way * math.copysign(min(_LOOP * a, p.max_yaw_rate), product) * cosine


@any_layout
@allocating
def choose(params, seen, memory, command, commands, i):
    """Puts the cheapest of the plans to start from in the place of robot i's; returns its cost."""
    p = params[0]
    n = commands.shape[2]
    pose = pose_in_goal_frame(seen, i)
    twist = last_twist(seen, i)
    last = command[i, 0], command[i, 1]
    share = 1.0 / p.substeps
    for k in range(n - 1):
        for j in range(2):
            commands[i, j, k] += share * (commands[i, j, k + 1] - commands[i, j, k])
    best = plan_cost(p, pose, twist, last, commands[i])
    plan = np.empty((2, n))
    for way in (1.0, -1.0):
        for loop in (False, True):
            if loop:
                loop_plan(p, pose, way, plan)
            else:
                polar_plan(p, min(p.arrival_radius, 0.5 * memory[i].stay), pose, twist, last, way, plan)
            cost = plan_cost(p, pose, twist, last, plan)
            if cost < best:
                best = cost
                assign(commands[i], plan)
    return best


@any_layout
@allocating
def linearise(params, seen, command, commands, i, program):
    """Fills the quadratic program of changes of robot i's plan; returns the largest derivative of the sum.

    The Hessian is Gauss and Newton's, of the residuals x^2, y, th^2, v^2 and w^2, its upper triangle, damped.
    """
    p = params[0]
    n = commands.shape[2]
    hessian, gradient, _, _ = program
    hessian[:] = 0.0
    gradient[:] = 0.0
    slopes = Slopes(np.zeros(n), np.zeros(n), np.zeros(n), np.zeros(n), np.zeros(n), np.zeros(n))
    pose = pose_in_goal_frame(seen, i)
    twist = last_twist(seen, i)
    before = command[i, 0], command[i, 1]
    of_x = np.zeros(2 * n)
    of_y = np.zeros(2 * n)
    of_turn = np.zeros(2 * n)
    for k in range(n):
        after = commands[i, 0, k], commands[i, 1, k]
        for j in range(p.substeps):
            pose, twist = drive_on(p, pose, twist, before, after, (j + 1) / p.substeps, k, slopes)
        before = after
        x, y, heading = pose
        # a sum of squares r^2 has the gradient 2 r dr and Gauss and Newton's Hessian 2 dr dr'
        for a in range(k + 1):
            of_x[a] = 2.0 * x * slopes.x_v[a]
            of_x[n + a] = 2.0 * x * slopes.x_w[a]
            of_y[a] = slopes.y_v[a]
            of_y[n + a] = slopes.y_w[a]
            of_turn[n + a] = 2.0 * heading * slopes.heading_w[a]
        add_square(2.0 * p.step * p.along, x * x, of_x, k, program)
        add_square(2.0 * p.step * p.across, y, of_y, k, program)
        add_square(2.0 * p.step * p.heading, heading * heading, of_turn, k, program)
        for j in range(2):
            a = j * n + k
            weight = 2.0 * p.step * p.effort * (0.0625 if j else 1.0)
            value = commands[i, j, k]
            gradient[a] += weight * 2.0 * value * value * value
            hessian[a, a] += weight * 4.0 * value * value
    slope = 0.0
    largest = 0.0
    for a in range(2 * n):
        slope = max(slope, abs(gradient[a]))
        largest = max(largest, hessian[a, a])
    for a in range(2 * n):
        hessian[a, a] += DAMPING * largest + 1e-9
    bound(p, command[i], commands[i], program)
    return slope


@inlined
def add_square(weight, value, slope, k, program):
    """Adds weight/2 times the square of a residual that depends on the commands up to step k."""
    n = slope.shape[0] // 2
    for a in range(2 * n):
        if a % n > k or slope[a] == 0.0:
            continue
        program.gradient[a] += weight * value * slope[a]
        for b in range(a, 2 * n):
            program.hessian[a, b] += weight * slope[a] * slope[b]


@inlined
def bound(p, last, plan, program):
    """Fills the bounds of the rows of `PoseProgram`: what the plan leaves of what the robot can."""
    n = plan.shape[1]
    step = p.substeps * p.plant.dt
    lower = program.lower
    upper = program.upper
    for j in range(2):
        most = p.max_yaw_rate if j else p.speed
        change = step * (p.plant.yaw_acceleration if j else p.plant.acceleration)
        before = last[j]
        for k in range(n):
            lower[j * n + k] = min(-most - plan[j, k], 0.0)
            upper[j * n + k] = max(most - plan[j, k], 0.0)
            lower[(2 + j) * n + k] = min(-change - (plan[j, k] - before), 0.0)
            upper[(2 + j) * n + k] = max(change - (plan[j, k] - before), 0.0)
            before = plan[j, k]
    fastest = 0.0
    for wheel in range(p.plant.num_wheels):
        fastest = max(fastest, abs(p.plant.wheel_matrix[wheel, 0]))
    for wheel in range(p.plant.num_wheels):
        for k in range(n):
            turning = p.plant.wheel_matrix[wheel, 0] * plan[0, k] + p.plant.wheel_matrix[wheel, 2] * plan[1, k]
            row = (4 + wheel) * n + k
            lower[row] = min((-p.plant.wheel_speed_limit - turning) / fastest, 0.0)
            upper[row] = max((p.plant.wheel_speed_limit - turning) / fastest, 0.0)


@any_layout
@allocating
def improve(params, seen, command, commands, i, cost, change):
    """Adds to robot i's plan the largest share of a change (2 n,) that makes it cheaper; nothing if none does."""
    p = params[0]
    n = commands.shape[2]
    pose = pose_in_goal_frame(seen, i)
    twist = last_twist(seen, i)
    last = command[i, 0], command[i, 1]
    plan = np.empty((2, n))
    for share in SHARES:
        for j in range(2):
            for k in range(n):
                plan[j, k] = commands[i, j, k] + share * change[j * n + k]
        if plan_cost(p, pose, twist, last, plan) < cost:
            assign(commands[i], plan)
            return


@any_layout
@compiled
def apply(params, commands, command, i, twists):
    """Sets the twist of robot i: its plan's command a control period ahead, within reach of the last command."""
    p = params[0]
    share = 1.0 / p.substeps
    v = command[i, 0] + share * (commands[i, 0, 0] - command[i, 0])
    w = command[i, 1] + share * (commands[i, 1, 0] - command[i, 1])
    command[i, 0], _, command[i, 1], _ = limits(p.plant, (command[i, 0], 0.0, command[i, 1]), (v, 0.0, w), p.plant.dt)
    twists[i, 0] = command[i, 0]
    twists[i, 1] = command[i, 1]
