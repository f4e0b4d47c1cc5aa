"""Iterative LQR about a reference that is told: a plan for the next second by dynamic programming, no solver."""

import dataclasses

import numpy as np
from numpy.typing import NDArray

from wayfield.envs import trajectory_tracking
from wayfield.envs.scenarios.reference_proofs import solved
from wayfield.envs.tasks.briefing import Briefing
from wayfield.policies.parts.gain import gain
from wayfield.policies.parts.params import params
from wayfield.policies.parts.timed_plan import TimedPlanner, begin, bound_of, drive, empty_plan, fill_slopes, weight_of
from wayfield.system.compiled import allocating, any_layout, inlined

HARDER, EASIER = 10.0, 0.1  # of the damping, after a sweep that did not lower the cost, and after one that did


@dataclasses.dataclass(frozen=True)
class TimedIlqr(TimedPlanner):
    """Drives the start of the best plan for the next `horizon` control periods, made better in every one of them.

    With e the reference minus the robot, and c_r the command that the reference takes, it minimises

        sum_k q_place (e_x,k^2 + e_y,k^2) + q_heading e_th,k^2 + (c_k - c_r,k)'R (c_k - c_r,k)

    over the commands c_k and the plant's own motion, within its accelerations. It is the sum of `tv_lqr`, which knows
    no limits and is linear about the reference. A sweep backward over the plan makes a feedback law for each step, with
    changes of the command that lie on a bound held there; a drive forward by these laws is the next plan if its sum is
    lower, and else the next sweep is damped more. The next control period begins with the plan moved on.

    Sources: Li and Todorov, ICINCO 2004; Tassa, Mansard and Todorov, ICRA 2014 (bounds).
    """

    sweeps: int = gain(4, "1", "in a control period, at most", least=1)
    tolerance: float = gain(1e-4, "1", "share of the sum, by which a sweep that goes on lowers it", least=0.0)

    def act(
        self, observation: trajectory_tracking.Observation, briefing: Briefing, memory: NDArray[np.void]
    ) -> NDArray[np.float64]:
        """Returns the twists (b, t), m/s and rad/s."""
        assert briefing.reference is not None
        twists = np.empty(observation.twist.shape)
        observed = observation.pose, observation.twist, observation.command
        plan_rows(params(self, briefing), *briefing.reference, observed, memory, twists)
        return twists


@any_layout
@allocating
def plan_rows(params, samples, times, index, observed, memory, twists):
    """Makes the plans of the memory better, and fills the twists (b, t) with their first commands."""
    p = params[0]
    n, t = p.horizon, twists.shape[1]
    laws = np.zeros((n, t, 4 + 2 * t))
    both = empty_plan(n, t), empty_plan(n, t)
    for i in range(twists.shape[0]):
        run = times[index[i]]
        plan, other = both
        period = begin(p, samples, run, observed, i, memory, plan)
        other.states[0] = plan.states[0]
        laws[:] = 0.0
        best = drive(p, samples, run, period, plan, laws, other)
        plan, other = other, plan
        damping = 0.0
        for _ in range(p.sweeps):
            fill_slopes(p.plant, plan)
            sweep_back(p, damping, plan, laws)
            cost = drive(p, samples, run, period, plan, laws, other)
            if not cost < best:
                damping = max(HARDER * damping, 1.0)
                continue
            plan, other = other, plan
            gained, best = best - cost, cost
            damping *= EASIER
            if gained < p.tolerance * best:
                break
        for j in range(t):
            twists[i, j] = plan.states[1, 3 + t + j]
            for k in range(n):
                memory[i].commands[k, j] = plan.states[k + 1, 3 + t + j]


@allocating
def sweep_back(p, damping, plan, laws):
    """Fills the laws (n, t, m + 1) that are best for the plan's slopes, from its last step to its first."""
    n, t = plan.inputs.shape
    m = 3 + 2 * t
    value = np.zeros((m + 1, m))  # Hessian of the least cost to go, by the state, and last its gradient
    work, q, held = np.zeros((m + 1, m + t)), np.zeros((m + t, m + t)), np.zeros(t)
    size, right = np.zeros((t, t)), np.zeros((t, m + 1))
    for k in range(n - 1, -1, -1):
        for j in range(3 + t):
            a = j if j < 3 else j + t
            weight = weight_of(p, j, t)
            value[a, a] += weight
            value[m, a] += weight * (plan.off[k, j - 3] if j >= 3 else -plan.errors[k, j])
        f = plan.slopes[k]
        for a in range(m + 1):
            for b in range(m + t):
                work[a, b] = 0.0
                for c in range(m):
                    work[a, b] += value[a, c] * f[c, b]
        for a in range(m + t):
            for b in range(m + t):
                q[a, b] = 0.0
                for c in range(m):
                    q[a, b] += f[c, a] * work[c, b]
        held[:] = 0.0
        for _ in range(t + 1):  # inputs beyond a bound are held on it, one after the other
            for j in range(t):
                right[j, m] = -work[m, m + j]
                for b in range(m):
                    right[j, b] = -q[m + j, b]
                for b in range(t):
                    size[j, b] = q[m + j, m + b] + (damping if b == j else 0.0)
            hold(held, size, right)
            solved(size, right)
            more = False
            for j in range(t):
                after = plan.inputs[k, j] + right[j, m]
                most = bound_of(p, j, t)
                if held[j] == 0.0 and abs(after) > most:
                    held[j] = (most if after > 0.0 else -most) - plan.inputs[k, j]
                    held[j] = held[j] if held[j] != 0.0 else 1e-300
                    more = True
            if not more:
                break
        laws[k] = right
        for a in range(m + 1):
            for b in range(m):
                total = work[m, b] if a == m else q[a, b]
                for j in range(t):
                    pull = q[m + j, b]
                    for c in range(t):
                        pull += q[m + j, m + c] * right[c, b]
                    total += pull * right[j, a] + right[j, b] * (work[m, m + j] if a == m else q[m + j, a])
                value[a, b] = total


@inlined
def hold(held, size, right):
    """Makes the rows of inputs that are held those of their step, with no feedback; others see that step."""
    last = right.shape[1] - 1
    for j in range(len(held)):
        if held[j] != 0.0:
            for i in range(len(held)):
                right[i, last] -= size[i, j] * held[j]
                size[i, j] = size[j, i] = 0.0
            right[j] = 0.0
            size[j, j] = 1.0
            right[j, last] = held[j]
