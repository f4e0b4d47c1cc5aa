"""Model predictive path following: a contouring controller that chooses its own speed, by quadratic programs."""

import dataclasses
import math
from typing import Any, ClassVar, NamedTuple

import numpy as np
from numpy.typing import NDArray

from wayfield.envs import path_following
from wayfield.envs.robots import Actuators, Robot
from wayfield.envs.robots.kinematics import limits
from wayfield.envs.robots.records import aligned, record
from wayfield.envs.tasks.briefing import Briefing
from wayfield.policies.parts.gain import gain
from wayfield.policies.parts.laws import PathLaw
from wayfield.policies.parts.params import PLANT, plant
from wayfield.policies.parts.path_smoothing import smoothed
from wayfield.policies.parts.pose_path import BEHIND, SPACING, locate, on_path
from wayfield.policies.parts.quadratic import Solver
from wayfield.policies.parts.shooting import Slopes, drive_on
from wayfield.policies.parts.steering import Motion, unicycle_twists
from wayfield.system.compiled import allocating, any_layout, compiled, inlined
from wayfield.system.elementary import bearing, wrap_angle
from wayfield.system.threads import one_a_thread

Array = NDArray[np.float64]

MOST_HORIZON = 500  # steps: the Hessian grows with their square

AHEAD = 0.3  # m, of path that is left, from which a plan to stand is no plan

MODEL = aligned(
    [
        ("substeps", np.int64),  # control periods in a step
        ("plant", PLANT),
        ("speed", np.float64),  # m/s
        ("turn_radius", np.float64),  # m
        ("position", np.float64),  # twice the weights in the sum over the steps: 1/m
        ("heading", np.float64),  # m
        ("speed_change", np.float64),  # s^2/m
        ("yaw_rate_change", np.float64),  # m s^2
        ("eagerness", np.float64),
    ]
)


class Program(NamedTuple):
    """A quadratic program of 3 n unknowns z: minimise z'Hz/2 + g'z within bounds of constant rows."""

    hessian: Array  # (3 n, 3 n), its upper triangle
    gradient: Array  # (3 n,)
    plan: Array  # (3 n,) z: what it is made around, and then its solution
    lower: Array  # (rows,)
    upper: Array


@dataclasses.dataclass(frozen=True)
class Mpc(PathLaw):
    """Drives the start of the best plan for the next `horizon` steps, planned anew in every control period.

    The path is a curve of poses P(sigma) = (position, heading). Where it turns sharper than a circle of radius
    `turn_radius`, its parameter counts the turn: d sigma = max(ds, turn_radius |d heading|), so that a corner is no
    jump but a turn on the spot, with a length of its own. With h = step, it minimises over the commands
    c_k = (v_k, w_k) and the places sigma_k that the plan aims at, k = 1 ... N = horizon,

        sum_k h (position |p_k - P(sigma_k)|^2 + heading (th_k - P_th(sigma_k))^2
                 + acceleration a_k^2 + yaw_acceleration alpha_k^2)
            - (1 - eagerness) (sigma_N - sigma_0) - eagerness 2 / (N + 1) sum_k (sigma_k - sigma_0)

    over the plant's own motion: from c_k-1 to c_k the command changes by equal parts in each control period, behind it
    a first-order lag, exact arcs. Bounds: 0 <= v_k <= speed, the accelerations a_k and alpha_k, the wheel speeds,
    0 <= sigma_k - sigma_k-1 <= speed h, and sigma_N no farther than the path's end. The last line pays a metre of
    progress with 1, so that the robot slows down where, and only where, it would leave the path otherwise; without
    `eagerness` it would put off the last metres. sigma_0 is the place nearest to the pose in the measure of the first
    two terms; the path's heading is unwrapped, and starts within half a turn of the robot's.

    Real-time iteration: the last plan, moved on by a control period, starts at most `iterations` Gauss-Newton steps,
    each a quadratic program of 3 N unknowns within bounds on constant rows, which OSQP starts from the plan and its
    multipliers. A step that changes no command by `tolerance` is the last. A plan to stand, a local minimum of some
    starts beside the path, gives way to one that turns towards the path ahead and drives. A program that OSQP does not
    solve within `solver_iterations`, not even to ten times its tolerance, is counted in the memory's field
    `qp_failures` and changes nothing: the plan that it should have improved is driven on. After `patience` seconds
    without any program solved the robot brakes with its nominal acceleration and plans from nothing.

    A unicycle law that never reverses: an omni base drives it without its sideways motion.

    Sources: Lam, Manzie and Good, CDC 2010 (contouring with progress); Diehl, Bock and Schloeder, SIAM J. Control
    Optim. 43(5), 2005 (real-time iteration); Stellato et al., Math. Prog. Comp. 12, 2020 (OSQP).
    """

    speed: float = gain(0.6, "m/s", "the most that is driven", above=0.0)
    position: float = gain(1000.0, "1/(m s)", "weight of the squared distance", above=0.0, search=(100.0, 100_000.0))
    heading: float = gain(2.0, "m/s", "weight of the squared heading error", above=0.0, search=(0.2, 20.0))
    acceleration: float = gain(0.01, "s^3/m", "weight of the squared acceleration", above=0.0)
    yaw_acceleration: float = gain(0.001, "m s^3", "weight of the squared yaw acceleration", above=0.0)
    eagerness: float = gain(0.2, "1", "share of the pay that is for early progress", least=0.0, most=1.0)
    turn_radius: float = gain(0.2, "m", "length that a radian on the spot counts as", above=0.0, search=(0.05, 0.5))
    horizon: int = gain(20, "steps", "of the prediction", least=1, most=MOST_HORIZON)
    step: float = gain(0.1, "s", "rounded to whole control periods", above=0.0)
    iterations: int = gain(3, "1", "Gauss-Newton steps in a control period, at most", least=1)
    tolerance: float = gain(0.01, "m/s", "and rad/s, of the change that ends the iteration", least=0.0)
    solver_iterations: int = gain(2000, "1", "about 3 microseconds each", least=1, most=1_000_000)
    patience: float = gain(0.5, "s", "without a plan, after which it stops", least=0.0)

    needs: ClassVar[tuple[str, ...]] = ("turns_on_the_spot",)

    def reset(self, briefing: Briefing) -> NDArray[Any]:
        """Returns each robot's plan, last command and count of failures, (b,); all zero: it stands."""
        bounds = (4 + len(briefing.robot.wheel_matrix)) * self.horizon + 1
        return np.zeros(
            briefing.num_envs,
            [
                ("commands", np.float64, (2, self.horizon)),  # at the end of each step, m/s and rad/s
                ("progress", np.float64, (self.horizon,)),  # in each step, m
                ("multipliers", np.float64, (bounds,)),
                ("command", np.float64, (2,)),  # of the last control period
                ("age", np.int64),  # control periods since a program was solved
                ("qp_failures", np.int64),  # programs that were not solved, in this episode
            ],
        )

    def act(self, observation: path_following.Observation, briefing: Briefing, memory: NDArray[Any]) -> Array:
        """Returns the twists (b, t): m/s, rad/s, and nothing sideways."""
        assert briefing.path is not None
        model, program = prepared(self, briefing.robot, briefing.actuators, briefing.dt)
        reach = BEHIND + 3.0 * math.pi * self.turn_radius + self.speed * self.horizon * self.step_of(briefing.dt)
        course, motion = smoothed(briefing.path, Motion.of(observation))
        path = np.empty((math.ceil(reach / SPACING) + 4, 3))
        start = np.empty(5)
        commands, progress, multipliers = memory["commands"], memory["progress"], memory["multipliers"]
        twists = np.empty((len(memory), 2))
        for i in range(len(memory)):
            shift_plan(model, commands, progress, multipliers, i)
            locate(
                *course,
                model,
                motion.poses,
                motion.arc_lengths,
                i,
                path,
                start,
            )
            memory["age"][i] += 1
            for _ in range(self.iterations):
                slope = linearise(
                    model, path, start, motion.twists, memory["command"], commands, progress, i, program.arrays
                )
                if not program.solve(slope, multipliers[i]):
                    memory["qp_failures"][i] += 1
                    break
                memory["age"][i] = 0
                multipliers[i] = program.multipliers
                if take_plan(program.arrays.plan, start, commands, progress, i) < self.tolerance:
                    break
            if commands[i, 0].max() < self.tolerance and start[4] - start[3] > AHEAD:
                drive_off(model, path, start, commands, progress, i)
                multipliers[i] = 0.0
            brake = memory["age"][i] * briefing.dt > self.patience
            if brake:
                commands[i] = progress[i] = multipliers[i] = 0.0
            apply(model, commands, brake, memory["command"], i, twists)
        return unicycle_twists(briefing.robot, twists[:, 0], twists[:, 1])

    def step_of(self, dt: float) -> float:
        """Returns the length of a step in whole control periods, s."""
        return max(round(self.step / dt), 1) * dt

    def units(self, model: np.void) -> tuple[float, ...]:
        """Returns what a bound of each kind of row is measured in, see `QuadraticProgram`.

        They hold what is asked of a bound against what is asked of the sum: with these, found by trial, OSQP takes a
        median of some 40 iterations where it would take some 600 with SI units.
        """
        base = model["plant"]
        step = float(base["dt"] * model["substeps"])
        length = self.speed * step
        return (
            self.speed / 3.0,
            min(self.speed / 2.0, 3.0 * step * float(base["acceleration"])),
            min(self.speed / self.turn_radius / 3.0, 3.0 * step * float(base["yaw_acceleration"])),
            length,
            float(base["wheel_speed_limit"]),
            length,
        )

    def model(self, robot: Robot, actuators: Actuators, dt: float) -> NDArray[np.void]:
        """Returns one MODEL record, (1,): the robot, its actuators and the weights of the sum."""
        step = self.step_of(dt)
        base = plant(robot, actuators, dt)[0]
        base["acceleration"], base["yaw_acceleration"] = actuators.acceleration, actuators.yaw_acceleration
        return record(
            MODEL,
            {
                "substeps": round(step / dt),
                "plant": base,
                "speed": self.speed,
                "turn_radius": self.turn_radius,
                "position": 2.0 * self.position * step,
                "heading": 2.0 * self.heading * step,
                "speed_change": 2.0 * self.acceleration / step,
                "yaw_rate_change": 2.0 * self.yaw_acceleration / step,
                "eagerness": self.eagerness,
            },
        )


class QuadraticProgram:
    """Minimises z'Hz/2 + g'z over z = (v_1 ... v_N, w_1 ... w_N, sigma_1 ... sigma_N) within bounds on constant rows.

    The rows, each for every step: speed, its change, the yaw rate's change, the progress, each wheel's speed; last,
    sigma_N. OSQP keeps nothing of one solution for the next: the factors are made anew of every Hessian, start and
    multipliers are given, its own scaling and its adaptive step size, which remember, are off.
    """

    def __init__(
        self,
        horizon: int,
        wheels: tuple[tuple[float, ...], ...],
        units: tuple[float, ...],
        solver_iterations: int,
    ) -> None:
        """Sets the program up.

        Args:
            wheels: by v (rad/m) and by w, for each wheel.
            units: of the bounds of each kind of row.
        """
        # here, so that a look at the policies does not wait for SciPy
        import scipy.sparse

        n = horizon
        one = scipy.sparse.eye(n)
        change = one - scipy.sparse.eye(n, k=-1)
        rows = [
            [one, None, None],
            [change, None, None],
            [None, change, None],
            [None, None, change],
            *([by_v * one, by_w * one, None] for by_v, by_w in wheels),
            [None, None, scipy.sparse.csc_matrix(([1.0], ([0], [n - 1])), (1, n))],
        ]
        # every place depends on the commands before it alone
        before = np.triu(np.ones((n, n)))
        pattern = np.triu(np.ones((3 * n, 3 * n)))
        pattern[:, 2 * n :] = np.vstack([before, before, np.eye(n)])
        self.scale = 1.0 / np.repeat(units, [n, n, n, n, n * len(wheels), 1])
        constraints = scipy.sparse.csc_matrix(scipy.sparse.diags(self.scale) @ scipy.sparse.block_array(rows))
        self.arrays = Program(
            hessian=np.zeros((3 * n, 3 * n)),
            gradient=np.zeros(3 * n),
            plan=np.zeros(3 * n),
            lower=np.zeros(constraints.shape[0]),
            upper=np.zeros(constraints.shape[0]),
        )
        self.multipliers = np.zeros(constraints.shape[0])
        bounds = self.arrays.lower, self.arrays.upper
        self._solver = Solver(pattern, self.arrays.gradient, constraints, bounds, solver_iterations)

    def solve(self, slope: float, multipliers: Array) -> bool:
        """Puts the solution into `arrays.plan` and `multipliers`, started from them; False if none.

        Args:
            multipliers: that it starts from.
            slope: the largest derivative of the sum at the plan. Far from the path it is steep, and so are the
                multipliers: OSQP would take as many times longer if the sum were not divided by it.
        """
        if not math.isfinite(slope):
            return False
        share = 1.0 / max(slope, 1.0)
        solution = self._solver.solve(
            share,
            self.arrays.gradient,
            self.scale * self.arrays.lower,
            self.scale * self.arrays.upper,
            self.arrays.hessian,
            (self.arrays.plan, share * multipliers),
        )
        if solution is None:
            return False
        self.arrays.plan[:] = solution[0]
        self.multipliers[:] = solution[1] / share
        return True


# One program serves every robot of its kind in a thread: it holds nothing of theirs from one solution to the next.
quadratic_program = one_a_thread(QuadraticProgram)


@one_a_thread
def prepared(law: Mpc, robot: Robot, actuators: Actuators, dt: float) -> tuple[NDArray[np.void], QuadraticProgram]:
    """Returns the model and the program of a law on a robot."""
    model = law.model(robot, actuators, dt)
    wheels = tuple(map(tuple, robot.wheel_matrix[:, [0, 2]].tolist()))
    return model, quadratic_program(law.horizon, wheels, law.units(model[0]), law.solver_iterations)


@any_layout
@compiled
def shift_plan(model, commands, progress, multipliers, i):
    """Moves robot i's plan on by a control period; it ends as it ended before."""
    n = progress.shape[1]
    share = 1.0 / model[0].substeps
    for k in range(n - 1):
        for j in range(2):
            commands[i, j, k] += share * (commands[i, j, k + 1] - commands[i, j, k])
        progress[i, k] += share * (progress[i, k + 1] - progress[i, k])
    for row in range(0, multipliers.shape[1] - 1, n):
        for k in range(row, row + n - 1):
            multipliers[i, k] += share * (multipliers[i, k + 1] - multipliers[i, k])


@any_layout
@allocating
def linearise(model, path, start, twists, last, commands, progress, i, program):
    """Fills the quadratic program of robot i around its plan.

    Returns the largest derivative of the sum at the plan. The Hessian is Gauss and Newton's, its upper triangle.
    """
    m = model[0]
    n = progress.shape[1]
    unknowns = program.plan
    put_plan(commands, progress, i, start, unknowns)
    program.hessian[:] = 0.0
    program.gradient[:] = 0.0
    slopes = Slopes(np.zeros(n), np.zeros(n), np.zeros(n), np.zeros(n), np.zeros(n), np.zeros(n))
    pose = start[0], start[1], start[2]
    twist = twists[i, 0], twists[i, twists.shape[1] - 1]
    before = last[i, 0], last[i, 1]
    for k in range(n):
        after = unknowns[k], unknowns[n + k]
        for j in range(m.substeps):
            pose, twist = drive_on(m, pose, twist, before, after, (j + 1) / m.substeps, k, slopes)
        before = after
        add_path_errors(m, path, pose, k, slopes, program)
    add_pay(m, program.gradient)
    add_changes(m, last[i], program)
    slope = 0.0
    for a in range(3 * n):
        slope = max(slope, abs(program.gradient[a]))
    centre(program)
    bound(m, start, last[i], program)
    return slope


@inlined
def put_plan(commands, progress, i, start, unknowns):
    """Fills the unknowns with robot i's plan."""
    n = progress.shape[1]
    sigma = start[3]
    for k in range(n):
        unknowns[k] = commands[i, 0, k]
        unknowns[n + k] = commands[i, 1, k]
        sigma += progress[i, k]
        unknowns[2 * n + k] = sigma


@inlined
def add_path_errors(m, path, pose, k, slopes, program):
    """Adds the squares of step k's distance to the place that it aims at and of its heading error."""
    hessian = program.hessian
    gradient = program.gradient
    _, dx_v, dy_v, dx_w, dy_w, dth_w = slopes
    n = gradient.shape[0] // 3
    s = 2 * n + k
    px, py, pth, px_s, py_s, pth_s = on_path(path, program.plan[s])
    ex = m.position * (pose[0] - px)
    ey = m.position * (pose[1] - py)
    eth = m.heading * (pose[2] - pth)
    for a in range(k + 1):
        gradient[a] += ex * dx_v[a] + ey * dy_v[a]
        gradient[n + a] += ex * dx_w[a] + ey * dy_w[a] + eth * dth_w[a]
        for b in range(a, k + 1):
            hessian[a, b] += m.position * (dx_v[a] * dx_v[b] + dy_v[a] * dy_v[b])
            hessian[n + a, n + b] += (
                m.position * (dx_w[a] * dx_w[b] + dy_w[a] * dy_w[b]) + m.heading * dth_w[a] * dth_w[b]
            )
        for b in range(k + 1):
            hessian[a, n + b] += m.position * (dx_v[a] * dx_w[b] + dy_v[a] * dy_w[b])
        hessian[a, s] = -m.position * (dx_v[a] * px_s + dy_v[a] * py_s)
        hessian[n + a, s] = -m.position * (dx_w[a] * px_s + dy_w[a] * py_s) - m.heading * dth_w[a] * pth_s
    hessian[s, s] = m.position * (px_s * px_s + py_s * py_s) + m.heading * pth_s * pth_s
    gradient[s] = -ex * px_s - ey * py_s - eth * pth_s


@inlined
def add_pay(m, gradient):
    """Takes off what progress is paid with: `eagerness` of it for early progress, the rest for the last place."""
    n = gradient.shape[0] // 3
    for k in range(n):
        gradient[2 * n + k] -= m.eagerness * 2.0 / (n + 1)
    gradient[3 * n - 1] -= 1.0 - m.eagerness


@inlined
def add_changes(m, last, program):
    """Adds the squares of the accelerations, from the last command (2,) on."""
    hessian = program.hessian
    gradient = program.gradient
    n = gradient.shape[0] // 3
    for j in range(2):
        weight = m.yaw_rate_change if j else m.speed_change
        before = last[j]
        for k in range(n):
            a = j * n + k
            change = weight * (program.plan[a] - before)
            before = program.plan[a]
            gradient[a] += change
            hessian[a, a] += weight
            if k:
                gradient[a - 1] -= change
                hessian[a - 1, a] -= weight
                hessian[a - 1, a - 1] += weight


@inlined
def centre(program):
    """Makes a gradient at the plan one at zero."""
    hessian = program.hessian
    gradient = program.gradient
    for a in range(gradient.shape[0]):
        for b in range(a, gradient.shape[0]):
            gradient[a] -= hessian[a, b] * program.plan[b]
            if b > a:
                gradient[b] -= hessian[a, b] * program.plan[a]


@inlined
def bound(m, start, last, program):
    """Fills the bounds of the rows of `QuadraticProgram`."""
    lower = program.lower
    upper = program.upper
    n = program.gradient.shape[0] // 3
    step = m.substeps * m.plant.dt
    lower[:n] = 0.0
    upper[:n] = m.speed
    lower[n : 2 * n] = -m.plant.acceleration * step
    upper[n : 2 * n] = m.plant.acceleration * step
    lower[2 * n : 3 * n] = -m.plant.yaw_acceleration * step
    upper[2 * n : 3 * n] = m.plant.yaw_acceleration * step
    lower[3 * n : 4 * n] = 0.0
    upper[3 * n : 4 * n] = m.speed * step
    for j in range(2):
        lower[(1 + j) * n] += last[j]
        upper[(1 + j) * n] += last[j]
    lower[3 * n] += start[3]
    upper[3 * n] += start[3]
    lower[4 * n : -1] = -m.plant.wheel_speed_limit
    upper[4 * n : -1] = m.plant.wheel_speed_limit
    lower[-1] = -np.inf
    upper[-1] = start[4]


@any_layout
@compiled
def take_plan(unknowns, start, commands, progress, i):
    """Makes a solution the plan of robot i; returns the largest change of a command (m/s or rad/s)."""
    n = progress.shape[1]
    largest = 0.0
    sigma = start[3]
    for k in range(n):
        for j in range(2):
            largest = max(largest, abs(unknowns[j * n + k] - commands[i, j, k]))
            commands[i, j, k] = unknowns[j * n + k]
        progress[i, k] = max(unknowns[2 * n + k] - sigma, 0.0)
        sigma += progress[i, k]
    return largest


@any_layout
@compiled
def drive_off(model, path, start, commands, progress, i):
    """Makes robot i's plan one that turns towards the path ahead and drives: to stand is a local minimum beside it."""
    m = model[0]
    n = progress.shape[1]
    step = m.substeps * m.plant.dt
    x, y, _, _, _, _ = on_path(path, start[3] + AHEAD)
    turn = wrap_angle(bearing(y - start[1], x - start[0]) - start[2])
    for k in range(n):
        commands[i, 0, k] = 0.5 * m.speed
        commands[i, 1, k] = 2.0 * turn / (n * step) if k < n // 2 else 0.0
        progress[i, k] = 0.5 * m.speed * step


@any_layout
@compiled
def apply(model, commands, brake, command, i, twists):
    """Sets the twist of robot i: its plan's command a control period ahead, within reach of the last command."""
    m = model[0]
    share = 0.0 if brake else 1.0 / m.substeps
    v = 0.0 if brake else command[i, 0] + share * (commands[i, 0, 0] - command[i, 0])
    w = 0.0 if brake else command[i, 1] + share * (commands[i, 1, 0] - command[i, 1])
    v = min(max(v, 0.0), m.speed)
    last = command[i, 0], 0.0, command[i, 1]
    command[i, 0], _, command[i, 1], _ = limits(m.plant, last, (v, 0.0, w), m.plant.dt)
    twists[i, 0] = command[i, 0]
    twists[i, 1] = command[i, 1]
