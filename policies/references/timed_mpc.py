"""Model predictive control about a reference that is told: one quadratic program a control period, by OSQP."""

import dataclasses
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from wayfield.envs import trajectory_tracking
from wayfield.envs.tasks.briefing import Briefing
from wayfield.policies.parts.gain import gain
from wayfield.policies.parts.params import params
from wayfield.policies.parts.quadratic import Solver
from wayfield.policies.parts.timed_plan import TimedPlanner, begin, bound_of, drive, empty_plan, fill_slopes, weight_of
from wayfield.system.compiled import allocating, any_layout
from wayfield.system.threads import one_a_thread

Array = NDArray[np.float64]


@dataclasses.dataclass(frozen=True)
class TimedMpc(TimedPlanner):
    """Drives the start of the best plan for the next `horizon` control periods, planned anew in every one of them.

    It minimises the sum of `timed_ilqr` over changes of the command, within the bounds of the accelerations and of the
    wheel speeds. Real-time iteration: the last plan, moved on by a control period and driven by the plant's own motion,
    is what the program is made around; OSQP solves one of it, and a plan that it finds none for is driven on, and
    counted in the memory's field `qp_failures`.

    Sources: Kuehne, Lages, Gomes da Silva, Model predictive control of a mobile robot using linearization, Mechatronics
    and Robotics, 2004; Diehl, Bock and Schloeder, SIAM J. Control Optim. 43(5), 2005 (real-time iteration).
    """

    solver_iterations: int = gain(1000, "1", "about 3 microseconds each", least=1, most=1_000_000)

    def act(self, observation: trajectory_tracking.Observation, briefing: Briefing, memory: NDArray[np.void]) -> Array:
        """Returns the twists (b, t), m/s and rad/s."""
        assert briefing.reference is not None
        read, robot = params(self, briefing), briefing.robot
        axes = [0, 2] if len(robot.twist_axes) == 2 else [0, 1, 2]
        wheels = tuple(map(tuple, robot.wheel_matrix[:, axes].tolist()))
        program = quadratic_program(self.horizon, wheels, self.solver_iterations)
        twists = np.empty(observation.twist.shape)
        observed = observation.pose, observation.twist, observation.command
        laws, both = np.zeros((self.horizon, len(axes), 4 + 2 * len(axes))), program.plans
        for i in range(len(memory)):
            period = arrange(read, *briefing.reference, observed, i, memory, *both, program.arrays)
            steps = program.solve()
            memory["qp_failures"][i] += steps is None
            laws[:, :, -1] = 0.0 if steps is None else steps
            take(read, *briefing.reference, i, period, *both, laws, memory)
            twists[i] = memory["commands"][i, 0]
        return twists


class Program(NamedTuple):
    """A quadratic program of n t steps z: minimise z'Hz/2 + g'z within bounds of constant rows."""

    hessian: Array  # (n t, n t)
    gradient: Array  # (n t,)
    lower: Array  # (rows,) of each change of the command, then of the speed of each wheel in each period
    upper: Array


class QuadraticProgram:
    """The program of a base: its rows are the changes of the command, and what each wheel turns at after them."""

    def __init__(self, horizon: int, wheels: tuple[tuple[float, ...], ...], solver_iterations: int) -> None:
        # here, so that a look at the policies does not wait for SciPy
        import scipy.sparse

        axes = len(wheels[0])
        count = horizon * axes
        summed = np.kron(np.tril(np.ones((horizon, horizon))), np.array(wheels))
        self.scale = np.concatenate([np.ones(count), np.full(len(summed), 1.0 / np.abs(wheels).max())])
        rows = scipy.sparse.csc_matrix(self.scale[:, None] * np.vstack([np.eye(count), summed]))
        self.plans = empty_plan(horizon, axes), empty_plan(horizon, axes)
        self.arrays = Program(
            np.zeros((count, count)), np.zeros(count), np.zeros(rows.shape[0]), np.zeros(rows.shape[0])
        )
        pattern = np.triu(np.ones((count, count)))
        self.shape = (horizon, axes)
        self._solver = Solver(pattern, self.arrays.gradient, rows, self.arrays[2:], solver_iterations)

    def solve(self) -> Array | None:
        """Returns the steps (n, t) that OSQP finds from none; None if it finds none."""
        if not np.isfinite(self.arrays.gradient).all():
            return None
        share = 1.0 / max(float(np.abs(np.diag(self.arrays.hessian)).max()), 1e-9)
        solution = self._solver.solve(
            share,
            self.arrays.gradient,
            self.scale * self.arrays.lower,
            self.scale * self.arrays.upper,
            self.arrays.hessian,
            (np.zeros(len(self.arrays.gradient)), np.zeros(len(self.scale))),
        )
        return None if solution is None else solution[0].reshape(self.shape)


# One program serves every robot of its kind in a thread: it holds nothing of theirs from one solution to the next.
quadratic_program = one_a_thread(QuadraticProgram)


@any_layout
@allocating
def arrange(params, samples, times, index, observed, i, memory, plan, other, program):
    """Drives robot i's last plan into `other`, fills the program around it; returns the period of the reference."""
    p = params[0]
    run = times[index[i]]
    n, t = plan.inputs.shape
    m = 3 + 2 * t
    period = begin(p, samples, run, observed, i, memory, plan)
    other.states[0] = plan.states[0]
    drive(p, samples, run, period, plan, np.zeros((n, t, 4 + 2 * t)), other)
    fill_slopes(p.plant, other)
    by, moved = np.zeros((m, n * t)), np.zeros((m, n * t))
    program.hessian[:] = 0.0
    program.gradient[:] = 0.0
    for k in range(n):
        f = other.slopes[k]
        for a in range(m):
            for b in range(t * k):
                moved[a, b] = 0.0
                for c in range(m):
                    moved[a, b] += f[a, c] * by[c, b]
            for j in range(t):
                moved[a, t * k + j] = f[a, m + j]
        by, moved = moved, by
        for j in range(3 + t):
            a = j if j < 3 else j + t
            weight = weight_of(p, j, t)
            off = other.off[k, j - 3] if j >= 3 else -other.errors[k, j]
            for b in range(t * (k + 1)):
                program.gradient[b] += weight * off * by[a, b]
                for c in range(b, t * (k + 1)):
                    program.hessian[b, c] += weight * by[a, b] * by[a, c]
        for j in range(t):
            most = bound_of(p, j, t)
            program.lower[t * k + j] = -most - other.inputs[k, j]
            program.upper[t * k + j] = most - other.inputs[k, j]
        for w in range(p.plant.num_wheels):
            turning = 0.0
            for j in range(t):
                turning += p.plant.wheel_matrix[w, 2 if j == t - 1 else j] * other.states[k + 1, 3 + t + j]
            row = n * t + p.plant.num_wheels * k + w
            program.lower[row] = min(-p.plant.wheel_speed_limit - turning, 0.0)
            program.upper[row] = max(p.plant.wheel_speed_limit - turning, 0.0)
    return period


@any_layout
@allocating
def take(params, samples, times, index, i, period, plan, other, laws, memory):
    """Drives the plan of `arrange` with its steps, and keeps its commands in the memory of robot i."""
    p = params[0]
    n, t = plan.inputs.shape
    plan.states[0] = other.states[0]
    drive(p, samples, times[index[i]], period, other, laws, plan)
    for k in range(n):
        for j in range(t):
            memory[i].commands[k, j] = plan.states[k + 1, 3 + t + j]
