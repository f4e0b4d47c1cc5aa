"""Iterative LQR along a path: the plan of MPC by dynamic programming over the plant's motion, without a solver."""

import dataclasses
import math
from typing import Any, ClassVar, NamedTuple

import numpy as np
from numpy.typing import NDArray

from wayfield.envs import path_following
from wayfield.envs.robots.kinematics import sinc
from wayfield.envs.tasks.briefing import Briefing
from wayfield.policies.parts.gain import gain
from wayfield.policies.parts.laws import PathLaw
from wayfield.policies.parts.params import params
from wayfield.policies.parts.path_smoothing import smoothed
from wayfield.policies.parts.pose_path import BEHIND, SPACING, locate, on_path
from wayfield.policies.parts.shooting import sinc_slope
from wayfield.policies.parts.steering import Motion, unicycle_twists, widest_turn
from wayfield.system.compiled import allocating, any_layout, compiled, inlined
from wayfield.system.elementary import sin_cos

Array = NDArray[np.float64]

MOST_STEPS = 500
STATE = 8  # x, y, heading, v, w, the commands of v and w, and sigma
INPUTS = 3  # by how much the commands and sigma change in a step
BY_SPEED, BY_YAW_RATE = (3, 5, 8), (4, 6, 9)  # columns of a step's slopes: of what changes v, and what changes w
COST = 10  # numbers of the cost's slopes: four of the gradient, six of the Hessian
ATTEMPTS = 1 + INPUTS  # at the inputs that lie on a bound
FORESIGHT = 1.25  # of the time in which it stops, that a plan sees ahead at least
ROUGH = 0.2  # of the weight of the distance from a path that `smoothed` changes: a planner's corners are no truer
# of the damping, after a sweep that lowered the sum and after one that did not; where it begins, and its range
EASIER, HARDER, AT_FIRST, LEAST, MOST = 0.3, 5.0, 30.0, 1e-4, 1e3


class Plan(NamedTuple):
    """What a robot would drive, and its slopes, of n steps."""

    states: Array  # (n + 1, STATE)
    inputs: Array  # (n, INPUTS)
    slopes: Array  # (n, STATE, STATE + INPUTS), of the state after a step by the state before it and the inputs
    costs: Array  # (n, COST), of the cost of the state after a step


@dataclasses.dataclass(frozen=True)
class Ilqr(PathLaw):
    """Drives the start of the best plan for the next `horizon` seconds, made better in every control period.

    The plan is that of `mpc`: commands and places sigma_k that it aims at on the same curve of poses P(sigma), whose
    corners are turns with a length of their own. With N steps of lengths h, T = horizon together, or 1.25 times the
    time in which the base stops if that is more, and

        rho(d) = 2 softness^2 (sqrt(1 + (d / softness)^2) - 1),

    which is d^2 near the path and grows in proportion beyond `softness`, it minimises

        sum_k h (position rho(|p_k - P(sigma_k)|) + heading (th_k - P_th(sigma_k))^2
                 + acceleration a_k^2 + yaw_acceleration alpha_k^2)
            - (1 - eagerness) (sigma_N - sigma_0) - eagerness 2 / (N + 1) sum_k (N h / T) (sigma_k - sigma_0)

    within the bounds 0 <= v_k <= speed, of the accelerations, of sigma (it never falls, grows by no more than speed h,
    and not beyond the path's end) and, where it drives the plan, of the wheels. The earlier steps have fewer control
    periods than the later ones, by at most one.

    A sweep backward over the steps makes of the costs' slopes and Gauss and Newton's curvature a feedback law for each
    step, with inputs that lie on a bound held there; a drive forward by these laws, over the plant's own motion, is the
    next plan if its sum is lower. If not, the next sweep is damped more (Levenberg and Marquardt). A sweep that lowers
    the sum by less than `tolerance`, or the last of `sweeps`, ends it; the next control period begins with the plan
    moved on. The plan is driven as it is where no sweep makes it better, so that there is nothing to wait for.

    Where the path is that of a planner, see `smoothed`, `position` weighs a fifth: its corners are no truer than its
    cells, and driven to the millimetre each takes a stop.

    It finds a minimum, not the least: it does not look at other ways to come back from far off. A unicycle law that
    never reverses: an omni base drives it without its sideways motion. Noise of the pose and a delay that it does not
    know slow it down, for errors count more than progress: to 0.04 m/s with a delay of three control periods.

    Sources: Li and Todorov, ICINCO 2004 (iterative LQR); Tassa, Mansard and Todorov, ICRA 2014 (bounds); Lam, Manzie
    and Good, CDC 2010 (contouring with progress).
    """

    speed: float = gain(0.6, "m/s", "the most that is driven", above=0.0)
    position: float = gain(15_000.0, "1/(m s)", "weight of the squared distance", above=0.0, search=(1e3, 3e5))
    heading: float = gain(0.3, "m/s", "weight of the squared heading error", above=0.0, search=(0.03, 3.0))
    softness: float = gain(0.013, "m", "distance beyond which it weighs in proportion", above=0.0, search=(0.002, 0.2))
    acceleration: float = gain(0.005, "s^3/m", "weight of the squared acceleration", above=0.0, search=(5e-4, 0.05))
    yaw_acceleration: float = gain(
        0.0004, "m s^3", "weight of the squared yaw acceleration", above=0.0, search=(1e-5, 0.01)
    )
    eagerness: float = gain(
        0.4,
        "1",
        "share of the pay that is for early progress; with less it may stand before the end",
        least=0.0,
        most=1.0,
    )
    turn_radius: float = gain(0.15, "m", "length that a radian on the spot counts as", above=0.0, search=(0.03, 0.3))
    horizon: float = gain(1.8, "s", "of the prediction; longer where it takes longer to stop", above=0.0, most=60.0)
    steps: int = gain(20, "1", "of the prediction", least=1, most=MOST_STEPS)
    sweeps: int = gain(8, "1", "in a control period, at most", least=1)
    tolerance: float = gain(0.001, "m", "of the sum's fall, under which a sweep is the last", least=0.0)

    needs: ClassVar[tuple[str, ...]] = ("turns_on_the_spot",)

    def reset(self, briefing: Briefing) -> NDArray[Any]:
        """Returns each robot's plan, last command and damping, (b,): it sets off, as fast as it can."""
        memory = np.zeros(
            briefing.num_envs,
            [
                ("plan", np.float64, (INPUTS, self.steps)),  # commands at the end of each step, and progress in it
                ("command", np.float64, (2,)),  # of the last control period, m/s and rad/s
                ("damping", np.float64),
            ],
        )
        memory["plan"][:, 0] = self.speed
        memory["damping"] = AT_FIRST
        return memory

    def act(self, observation: path_following.Observation, briefing: Briefing, memory: NDArray[Any]) -> Array:
        """Returns the twists (b, t): m/s, rad/s, and nothing sideways."""
        assert briefing.path is not None
        actuators = briefing.actuators
        stopping = self.speed / actuators.acceleration + actuators.reaction
        periods = max(round(max(self.horizon, FORESIGHT * stopping) / briefing.dt), self.steps)
        reach = BEHIND + 3.0 * math.pi * self.turn_radius + self.speed * periods * briefing.dt
        twists = np.empty((2, len(memory)))
        course, motion = smoothed(briefing.path, Motion.of(observation))
        either = params(self, briefing, periods=periods, rows=math.ceil(reach / SPACING) + 4).repeat(2)
        either["position"][1] *= ROUGH
        rough = (course.runs["length"] != briefing.path.runs["length"]).astype(np.int64)
        plan_rows(either, rough, course, motion, memory["plan"], memory["command"], memory["damping"], twists)
        return unicycle_twists(briefing.robot, twists[0], twists[1])


@any_layout
@allocating
def plan_rows(params, rough, course, motion, plans, command, damping, twists):
    """Makes the plans (b, INPUTS, n) better, sets the commands (b, 2) and fills the twists (2, b).

    Beside the gains: `periods` of the horizon, and `rows` of the path ahead. The second row of params is that of paths
    that are `rough` (runs,).
    """
    vertices, runs, path_index = course
    n = params[0].steps
    path = np.empty((params[0].rows, 3))
    start = np.empty(5)
    both = empty_plan(n), empty_plan(n)
    laws = np.zeros((n, INPUTS, STATE + 1))
    for i in range(plans.shape[0]):
        which = rough[path_index[i]]
        p = params[which]
        locate(vertices, runs, path_index, params[which : which + 1], motion.poses, motion.arc_lengths, i, path, start)
        stay_with_base(p, motion.twists, command, i)
        plan, other = both
        for a in range(3):
            plan.states[0, a] = start[a]
        plan.states[0, 3] = motion.twists[i, 0]
        plan.states[0, 4] = motion.twists[i, motion.twists.shape[1] - 1]
        plan.states[0, 5] = command[i, 0]
        plan.states[0, 6] = command[i, 1]
        plan.states[0, 7] = start[3]
        other.states[0] = plan.states[0]
        moved_on(p, plans, command, i, plan.inputs)
        best = np.nan
        if math.isfinite(start[0] + start[1] + start[2] + plan.states[0, 3] + plan.states[0, 4]):
            laws[:] = 0.0
            best = drive(p, path, start[4], plan, laws, plan)
        for _ in range(p.sweeps):
            if math.isnan(best):  # of a pose that is no number: the plan is driven on
                break
            sweep_back(p, damping[i], start[4], plan, laws)
            cost = drive(p, path, start[4], plan, laws, other)
            if cost < best:
                plan, other = other, plan
                gained = best - cost
                best = cost
                damping[i] = max(EASIER * damping[i], LEAST)
                if gained < p.tolerance:
                    break
            else:
                damping[i] = min(HARDER * damping[i], MOST)
        for j in range(2):
            planned = command[i, j]
            command[i, j] += plan.inputs[0, j] / periods_of(p, 0)
            twists[j, i] = command[i, j]
            for k in range(n):
                planned += plan.inputs[k, j]
                plans[i, j, k] = planned
        for k in range(n):
            plans[i, 2, k] = plan.inputs[k, 2]


@allocating
def empty_plan(n):
    """Returns a Plan of n steps."""
    return Plan(
        np.empty((n + 1, STATE)), np.empty((n, INPUTS)), np.zeros((n, STATE, STATE + INPUTS)), np.empty((n, COST))
    )


@inlined
def periods_of(p, k):
    """Returns how many control periods step k has: the last steps one more than the first, where they do not share."""
    each = p.periods // p.steps
    return each + (1 if k >= p.steps - (p.periods - each * p.steps) else 0)


@inlined
def stay_with_base(p, twists, command, i):
    """Keeps the last command within what the measured twist can lag behind: another may have driven."""
    time = p.plant.lag + p.plant.dt
    for j in range(2):
        measured = twists[i, 0] if j == 0 else twists[i, twists.shape[1] - 1]
        most = time * (p.plant.acceleration if j == 0 else p.plant.yaw_acceleration)
        if command[i, j] > measured + most:
            command[i, j] = measured + most
        elif command[i, j] < measured - most:
            command[i, j] = measured - most


@inlined
def moved_on(p, plans, command, i, inputs):
    """Fills the inputs (n, INPUTS) with the last plan moved on by a control period, within the accelerations."""
    n = inputs.shape[0]
    for k in range(n):
        following = min(k + 1, n - 1)
        share = 1.0 / periods_of(p, following)
        for j in range(2):
            inputs[k, j] = plans[i, j, k] + share * (plans[i, j, following] - plans[i, j, k])
        inputs[k, 2] = (1.0 - 1.0 / periods_of(p, k)) * plans[i, 2, k] + share * plans[i, 2, following]
    for j in range(2):
        before = command[i, j]
        for k in range(n):
            most = p.plant.dt * periods_of(p, k) * (p.plant.acceleration if j == 0 else p.plant.yaw_acceleration)
            inputs[k, j] = min(max(inputs[k, j] - before, -most), most)
            before += inputs[k, j]


@inlined
def bounds_of(p, k, end, states):
    """Returns the least and the most of each input of step k, from the state before it."""
    h = p.plant.dt * periods_of(p, k)
    v = h * p.plant.acceleration
    w = h * p.plant.yaw_acceleration
    return (
        (max(-v, -states[k, 5]), min(v, p.speed - states[k, 5])),
        (-w, w),
        (0.0, min(h * p.speed, end - states[k, 7])),
    )


@compiled
def drive(p, path, end, plan, laws, driven):
    """Drives a plan with the changes that the laws (n, INPUTS, STATE + 1) make; fills `driven`, returns its sum.

    A law's last column is its step, the others are the feedback of what the state differs by from the plan's.
    """
    total = 0.0
    for k in range(plan.inputs.shape[0]):
        bounds = bounds_of(p, k, end, driven.states)
        law = laws[k]
        for j in range(INPUTS):
            change = law[j, STATE]
            for a in range(STATE):
                change += law[j, a] * (driven.states[k, a] - plan.states[k, a])
            low, high = bounds[j]
            driven.inputs[k, j] = max(min(plan.inputs[k, j] + change, high), low)
        most = widest_turn(p.plant, driven.states[k, 5] + driven.inputs[k, 0])
        w = driven.states[k, 6]
        driven.inputs[k, 1] = min(max(driven.inputs[k, 1], -most - w), most - w)
        step_on(p.plant, periods_of(p, k), driven, k)
        h = p.plant.dt * periods_of(p, k)
        v = driven.inputs[k, 0]
        w = driven.inputs[k, 1]
        total += path_cost(p, path, driven, k, h) + (p.acceleration * v * v + p.yaw_acceleration * w * w) / h
    return total


@inlined
def step_on(plant, periods, plan, k):
    """Fills the plan's state after step k, and its slopes."""
    x = plan.states[k, 0]
    y = plan.states[k, 1]
    heading = plan.states[k, 2]
    v = plan.states[k, 3]
    w = plan.states[k, 4]
    f = plan.slopes[k]
    for a in range(STATE):
        for b in range(STATE + INPUTS):
            f[a, b] = 0.0
    for a in range(STATE):
        f[a, a] = 1.0
    f[7, 10] = 1.0
    for j in range(periods):
        share = (j + 1) / periods
        to_v = plan.states[k, 5] + share * plan.inputs[k, 0]
        to_w = plan.states[k, 6] + share * plan.inputs[k, 1]
        mean_v = to_v + plant.lag_mean * (v - to_v)
        mean_w = to_w + plant.lag_mean * (w - to_w)
        v = to_v + plant.lag_decay * (v - to_v)
        w = to_w + plant.lag_decay * (w - to_w)
        half_turn = 0.5 * mean_w * plant.dt
        sine, cosine = sin_cos(heading + half_turn)
        chord = plant.dt * sinc(half_turn)
        bend = plant.dt * sinc_slope(half_turn)
        dx = chord * cosine * mean_v
        dy = chord * sine * mean_v
        for c in range(3):
            # the lagging speed by itself, by its command, and by the change of that
            held = 0.0 if c == 0 else (1.0 if c == 1 else share)
            b = BY_SPEED[c]
            mean = held + plant.lag_mean * (f[3, b] - held)
            f[3, b] = held + plant.lag_decay * (f[3, b] - held)
            f[0, b] += chord * cosine * mean
            f[1, b] += chord * sine * mean
            b = BY_YAW_RATE[c]
            f[4, b] = f[3, BY_SPEED[c]]
            f[0, b] += 0.5 * plant.dt * mean_v * (bend * cosine - chord * sine) * mean - dy * f[2, b]
            f[1, b] += 0.5 * plant.dt * mean_v * (bend * sine + chord * cosine) * mean + dx * f[2, b]
            f[2, b] += plant.dt * mean
        f[0, 2] -= dy
        f[1, 2] += dx
        x += dx
        y += dy
        heading += 2.0 * half_turn
    f[5, 8] = 1.0
    f[6, 9] = 1.0
    plan.states[k + 1, 0] = x
    plan.states[k + 1, 1] = y
    plan.states[k + 1, 2] = heading
    plan.states[k + 1, 3] = v
    plan.states[k + 1, 4] = w
    for j in range(INPUTS):
        plan.states[k + 1, 5 + j] = plan.states[k, 5 + j] + plan.inputs[k, j]


@inlined
def path_cost(p, path, plan, k, h):
    """Returns the cost of the state after step k, of length h (s), and fills the slopes of it.

    They are the gradient by x, y, heading and sigma, and of Gauss and Newton's Hessian xx = yy, x sigma, y sigma,
    heading heading, heading sigma and sigma sigma.
    """
    px, py, pth, dx, dy, dth = on_path(path, plan.states[k + 1, 7])
    ex = plan.states[k + 1, 0] - px
    ey = plan.states[k + 1, 1] - py
    eth = plan.states[k + 1, 2] - pth
    beyond = math.sqrt(1.0 + (ex * ex + ey * ey) / (p.softness * p.softness))
    position = 2.0 * h * p.position / beyond
    heading = 2.0 * h * p.heading
    pay = 2.0 * p.eagerness * h / (p.periods * p.plant.dt) * p.steps / (p.steps + 1)
    if k == p.steps - 1:
        pay += 1.0 - p.eagerness
    cost = plan.costs[k]
    cost[0] = position * ex
    cost[1] = position * ey
    cost[2] = heading * eth
    cost[3] = -position * (ex * dx + ey * dy) - heading * eth * dth - pay
    cost[4] = position
    cost[5] = -position * dx
    cost[6] = -position * dy
    cost[7] = heading
    cost[8] = -heading * dth
    cost[9] = position * (dx * dx + dy * dy) + heading * dth * dth
    far = 2.0 * h * p.position * p.softness * p.softness * (beyond - 1.0)
    return far + 0.5 * heading * eth * eth - pay * (plan.states[k + 1, 7] - plan.states[0, 7])


@allocating
def sweep_back(p, damping, end, plan, laws):
    """Fills the laws (n, INPUTS, STATE + 1) that are best for the plan's slopes, from its last step to its first."""
    value = np.zeros((STATE + 1, STATE))  # Hessian of the least sum to go, by the state, and last its gradient
    work = np.empty((STATE + 1, STATE + INPUTS))
    q = np.empty((STATE + INPUTS, STATE + INPUTS))
    for k in range(plan.inputs.shape[0] - 1, -1, -1):
        add_cost(plan.costs[k], value)
        times_slopes(plan.slopes[k], value, work)
        times_slopes(plan.slopes[k], work[:STATE].T, q)
        g = work[STATE]
        h = p.plant.dt * periods_of(p, k)
        for j in range(2):
            weight = 2.0 * (p.acceleration if j == 0 else p.yaw_acceleration) / h
            q[STATE + j, STATE + j] += weight
            g[STATE + j] += weight * plan.inputs[k, j]
        law = laws[k]
        fixed = h * p.plant.acceleration, h * p.speed
        solve(q, g, damping / h, bounds_of(p, k, end, plan.states), fixed, plan.inputs[k], law)
        for a in range(STATE):
            pull0, pull1, pull2 = pulls(q, law, a)
            for b in range(a, STATE + 1):
                last = b == STATE
                total = g[a] if last else q[a, b]
                for j in range(INPUTS):
                    pull = pull0 if j == 0 else (pull1 if j == 1 else pull2)
                    total += pull * law[j, b] + law[j, a] * (g[STATE + j] if last else q[STATE + j, b])
                if last:
                    value[STATE, a] = total
                else:
                    work[a, b] = total
        for a in range(STATE):
            for b in range(a, STATE):
                value[a, b] = work[a, b]
                value[b, a] = work[a, b]


@inlined
def pulls(q, law, a):
    """Returns what state a and the law's answer to it do to the slopes by each of the inputs."""
    return (
        q[8, a] + q[8, 8] * law[0, a] + q[8, 9] * law[1, a] + q[8, 10] * law[2, a],
        q[9, a] + q[9, 8] * law[0, a] + q[9, 9] * law[1, a] + q[9, 10] * law[2, a],
        q[10, a] + q[10, 8] * law[0, a] + q[10, 9] * law[1, a] + q[10, 10] * law[2, a],
    )


@inlined
def add_cost(cost, value):
    """Adds the slopes of `path_cost` to those of the sum to go."""
    for j in range(3):
        value[STATE, j] += cost[j]
    value[STATE, 7] += cost[3]
    value[0, 0] += cost[4]
    value[1, 1] += cost[4]
    value[2, 2] += cost[7]
    value[7, 7] += cost[9]
    for j in range(3):
        mixed = cost[8] if j == 2 else cost[5 + j]
        value[j, 7] += mixed
        value[7, j] += mixed


@inlined
def times_slopes(f, rows, out):
    """Fills out (r, STATE + INPUTS) with the product of rows (r, STATE) and a step's slopes, without their zeros."""
    for a in range(out.shape[0]):
        out[a, 0] = rows[a, 0]
        out[a, 1] = rows[a, 1]
        out[a, 2] = rows[a, 0] * f[0, 2] + rows[a, 1] * f[1, 2] + rows[a, 2]
        out[a, 7] = rows[a, 7]
        out[a, 10] = rows[a, 7]
        for c in range(3):
            b = BY_SPEED[c]
            out[a, b] = rows[a, 0] * f[0, b] + rows[a, 1] * f[1, b] + rows[a, 3] * f[3, b] + rows[a, 5] * f[5, b]
            b = BY_YAW_RATE[c]
            out[a, b] = (
                rows[a, 0] * f[0, b] + rows[a, 1] * f[1, b] + rows[a, 2] * f[2, b]
                + rows[a, 4] * f[4, b] + rows[a, 6] * f[6, b]
            )  # fmt: skip


@inlined
def solve(q, g, damping, bounds, fixed, inputs, law):
    """Fills the law of a step whose inputs keep their bounds: those beyond one are held on it, and have no feedback."""
    held0 = held1 = held2 = False
    fixed0, fixed2 = fixed
    at0 = at1 = at2 = 0.0
    moving0 = moving2 = False
    for _ in range(ATTEMPTS):
        for a in range(STATE, -1, -1):
            last = a == STATE
            y0 = -(g[8] if last else q[8, a])
            y1 = -(g[9] if last else q[9, a])
            y2 = -(g[10] if last else q[10, a])
            m00, m11, m22 = q[8, 8] + damping, q[9, 9] + damping, q[10, 10] + damping
            m01, m02, m12 = q[8, 9], q[8, 10], q[9, 10]
            if held0:
                y0 = at0 if last else (-1.0 if a == 5 and moving0 else 0.0)
                y1 -= m01 * y0
                y2 -= m02 * y0
                m00, m01, m02 = 1.0, 0.0, 0.0
            if held1:
                y1 = at1 if last else 0.0
                y0 -= m01 * y1
                y2 -= m12 * y1
                m11, m01, m12 = 1.0, 0.0, 0.0
            if held2:
                y2 = at2 if last else (-1.0 if a == 7 and moving2 else 0.0)
                y0 -= m02 * y2
                y1 -= m12 * y2
                m22, m02, m12 = 1.0, 0.0, 0.0
            # by Cholesky's factors
            l10 = m01 / m00
            l20 = m02 / m00
            d1 = m11 - l10 * m01
            l21 = (m12 - l10 * m02) / d1
            d2 = m22 - l20 * m02 - l21 * l21 * d1
            y1 -= l10 * y0
            y2 -= l20 * y0 + l21 * y1
            law[2, a] = y2 / d2
            law[1, a] = y1 / d1 - l21 * law[2, a]
            law[0, a] = y0 / m00 - l10 * law[1, a] - l20 * law[2, a]
        before = held0, held1, held2
        held2, at2 = holding(law[2, STATE], bounds[2], inputs[2], held2, at2)
        held0, at0 = holding(law[0, STATE], bounds[0], inputs[0], held0, at0)
        held1, at1 = holding(law[1, STATE], bounds[1], inputs[1], held1, at1)
        if before == (held0, held1, held2):
            break
        # where a bound moves with the state, so does what lies on it: the limits of the speed, and the path's end
        moving0 = held0 and abs(inputs[0] + at0) < fixed0
        moving2 = held2 and 0.0 < inputs[2] + at2 < fixed2


@inlined
def holding(step, bounds, planned, held, at):
    """Returns (whether an input is held on a bound, its step there): as it was, or where its step leads beyond one."""
    if held:
        return True, at
    low = bounds[0] - planned
    high = bounds[1] - planned
    return step < low or step > high, min(max(step, low), high)
