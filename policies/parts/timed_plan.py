"""A plan of commands along a timed reference, driven by the plant's own motion: what predictive trackers share.

A plan's state, of a base of t axes: x, y, heading, the twist (t) that its wheels turn for, and its last command (t); an
input changes the command (t). Deviations of a state are seen in the plan's own frame, in which the exact period of
`reference_proofs.linearise` holds about any plan.
"""

import dataclasses
from typing import ClassVar, NamedTuple

import numpy as np
from numpy.typing import NDArray

from wayfield.envs import trajectory_tracking
from wayfield.envs.robots.kinematics import integrate_arc, limits, to_body_frame
from wayfield.envs.robots.references import sample_index
from wayfield.envs.scenarios.reference_proofs import linearise, wanted_twist
from wayfield.envs.tasks.briefing import Briefing
from wayfield.policies.parts.gain import Gains, gain
from wayfield.system.compiled import allocating, compiled, inlined
from wayfield.system.elementary import sin_cos, wrap_angle

Array = NDArray[np.float64]


@dataclasses.dataclass(frozen=True)
class TimedPlanner(Gains):
    """What plans along a reference weigh, and remember; the sum is in `timed_ilqr`."""

    q_place: float = gain(10.0, "1/m^2", "weight of the error in x and y", above=0.0, search=(1.0, 1000.0))
    q_heading: float = gain(1.0, "1/rad^2", "of the heading's", above=0.0, search=(0.01, 20.0))
    r_speed: float = gain(0.3, "s^2/m^2", "of the command's speed off that of the reference", above=0.0)
    r_turn: float = gain(0.15, "s^2/rad^2", "of its yaw rate", above=0.0, search=(0.005, 5.0))
    horizon: int = gain(25, "1", "control periods that are foreseen", least=1, most=500)

    knows: ClassVar[str] = "path"
    observes: ClassVar[tuple[type, ...]] = (trajectory_tracking.Observation,)
    needs: ClassVar[tuple[str, ...]] = ()

    def reset(self, briefing: Briefing) -> NDArray[np.void]:
        """Returns the memories (b,): each reference begins, and so does each plan."""
        shape = (self.horizon, len(briefing.robot.twist_axes))
        fields = [("period", np.int64), ("commands", np.float64, shape), ("qp_failures", np.int64)]
        return np.zeros(briefing.num_envs, fields)


class Plan(NamedTuple):
    """A plan of n steps, a control period each, of bases of t axes; m = 3 + 2 t."""

    states: Array  # (n + 1, m)
    inputs: Array  # (n, t)
    slopes: Array  # (n, m, m + t) of the state after a step, by the state before it and the input
    errors: Array  # (n, 3) reference minus plan after each step, in the plan's frame
    off: Array  # (n, t) the command minus the one that the reference takes


class Twist(NamedTuple):
    """A twist, as `linearise` reads it."""

    vx: float
    vy: float
    yaw_rate: float


@allocating
def empty_plan(n, t):
    """Returns a Plan of n steps for t axes."""
    m = 3 + 2 * t
    return Plan(np.zeros((n + 1, m)), np.zeros((n, t)), np.zeros((n, m, m + t)), np.zeros((n, 3)), np.zeros((n, t)))


@inlined
def twist_in(states, k, first, t):
    """Returns the twist (vx, vy, yaw rate) in the columns from `first` on."""
    return Twist(states[k, first], states[k, first + 1] if t == 3 else 0.0, states[k, first + t - 1])


@inlined
def bound_of(p, j, t):
    """Returns how far input j may change the command in a period."""
    return p.plant.dt * (p.plant.yaw_acceleration if j == t - 1 else p.plant.acceleration)


@inlined
def weight_of(p, j, t):
    """Returns twice the weight of a number of a stage's cost: x, y, heading, then the command off the wanted one."""
    if j < 3:
        return 2.0 * (p.q_heading if j == 2 else p.q_place)
    return 2.0 * (p.r_turn if j == 2 + t else p.r_speed)


@inlined
def wanted_at(p, samples, run, period, j, t):
    """Returns component j of the command that the reference takes in a period."""
    twist = wanted_twist(p.plant, samples[sample_index(run, period)], samples[sample_index(run, period + 1)])
    return twist[2] if j == t - 1 else (twist[0] if j == 0 else twist[1])


@compiled
def begin(p, samples, run, observed, i, memory, plan):
    """Fills a plan's first state, and its inputs from the commands of robot i's memory, moved on by a period."""
    poses, wheels, commands = observed
    n, t = plan.inputs.shape
    plan.states[:] = 0.0  # nothing of another robot
    for j in range(3):
        plan.states[0, j] = poses[i, j]
    period = memory[i].period
    memory[i].period = period + 1
    for j in range(t):
        plan.states[0, 3 + j] = wheels[i, j]
        plan.states[0, 3 + t + j] = commands[i, j]
        before = commands[i, j]
        for k in range(n):
            last = k == n - 1 or period == 0
            after = wanted_at(p, samples, run, period + k, j, t) if last else memory[i].commands[k + 1, j]
            plan.inputs[k, j] = after - before
            before = after
    return period


@allocating
def drive(p, samples, run, period, plan, laws, driven):
    """Drives a plan with the changes that laws (n, t, m + 1) make of it; fills `driven`, returns its cost.

    A law's last column is its step, the others are the feedback of what the state is off the plan's.
    """
    n, t = plan.inputs.shape
    away = np.zeros(plan.states.shape[1])
    total = 0.0
    for k in range(n):
        state, old = driven.states[k], plan.states[k]
        sine, cosine = sin_cos(old[2])
        away[0], away[1] = to_body_frame(old[0], old[1], sine, cosine, state[0], state[1])
        away[2] = wrap_angle(state[2] - old[2])
        for a in range(3, len(away)):
            away[a] = state[a] - old[a]
        for j in range(t):
            change = plan.inputs[k, j] + laws[k, j, len(away)]
            for a in range(len(away)):
                change += laws[k, j, a] * away[a]
            most = bound_of(p, j, t)
            driven.inputs[k, j] = min(max(change, -most), most)
            driven.states[k + 1, 3 + t + j] = state[3 + t + j] + driven.inputs[k, j]
        step_on(p.plant, t, driven, k)
        total += stage(p, samples, run, period + k, driven, k)
    return total


@inlined
def step_on(plant, t, plan, k):
    """Fills the state after step k, whose command is asked for there, by the plant's limits and motion."""
    before = twist_in(plan.states, k, 3 + t, t)
    requested = twist_in(plan.states, k + 1, 3 + t, t)
    vx, vy, w, _ = limits(
        plant, (before.vx, before.vy, before.yaw_rate), (requested.vx, requested.vy, requested.yaw_rate), plant.dt
    )
    wheels = twist_in(plan.states, k, 3, t)
    m = plant.lag_mean
    d = plant.lag_decay
    x, y, heading = integrate_arc(
        plan.states[k, 0], plan.states[k, 1], plan.states[k, 2],
        vx + m * (wheels.vx - vx), vy + m * (wheels.vy - vy), w + m * (wheels.yaw_rate - w), plant.dt,
    )  # fmt: skip
    plan.states[k + 1, 0] = x
    plan.states[k + 1, 1] = y
    plan.states[k + 1, 2] = heading
    for j in range(t):
        command = w if j == t - 1 else vx if j == 0 else vy
        plan.states[k + 1, 3 + j] = command + d * (plan.states[k, 3 + j] - command)
        plan.states[k + 1, 3 + t + j] = command
        plan.inputs[k, j] = command - plan.states[k, 3 + t + j]


@inlined
def stage(p, samples, run, period, plan, k):
    """Returns the cost of step k, and fills what it is made of."""
    t = plan.inputs.shape[1]
    there = samples[sample_index(run, period + 1)]
    state = plan.states[k + 1]
    sine, cosine = sin_cos(state[2])
    plan.errors[k, 0], plan.errors[k, 1] = to_body_frame(state[0], state[1], sine, cosine, there.x, there.y)
    plan.errors[k, 2] = wrap_angle(there.heading - state[2])
    cost = 0.0
    for j in range(3 + t):
        if j >= 3:
            plan.off[k, j - 3] = state[t + j] - wanted_at(p, samples, run, period, j - 3, t)
        number = plan.off[k, j - 3] if j >= 3 else plan.errors[k, j]
        cost += 0.5 * weight_of(p, j, t) * number * number
    return cost


@allocating
def fill_slopes(plant, plan):
    """Fills a plan's slopes."""
    n, t = plan.inputs.shape
    matrix, by_command = np.zeros((3 + t, 3 + t)), np.zeros((3 + t, t))
    for k in range(n):
        linearise(plant, t == 3, twist_in(plan.states, k, 3, t), twist_in(plan.states, k + 1, 3, t), matrix, by_command)
        f = plan.slopes[k]
        for j in range(t):
            f[3 + t + j, 3 + t + j] = f[3 + t + j, 3 + 2 * t + j] = 1.0
        for a in range(3 + t):
            for b in range(3 + t):
                f[a, b] = matrix[a, b]
            for j in range(t):
                f[a, 3 + t + j] = f[a, 3 + 2 * t + j] = by_command[a, j]
