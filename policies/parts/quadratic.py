"""Quadratic programs by OSQP, solved as if Ctrl-C were not its business."""

import signal
from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


class Solver:
    """OSQP set up for a program, such that it keeps nothing of one solution for the next.

    Its own scaling and its adaptive step size, which remember, are off. The class of its extension is called: what the
    interface in Python does around it takes as long as a solution.

    Args:
        pattern: of the Hessian's upper triangle.
        bounds: the lower and the upper ones of the rows of the constraints.
        iterations: at most.
    """

    def __init__(
        self, pattern: Array, gradient: Array, constraints: Any, bounds: tuple[Any, Any], iterations: int
    ) -> None:
        # here, so that a look at the policies does not wait for SciPy
        import osqp
        import scipy.sparse

        interface = osqp.OSQP()
        size = pattern.shape[0]
        interface.setup(
            scipy.sparse.csc_matrix(pattern + size * np.eye(size)),
            gradient,
            constraints,
            *bounds,
            verbose=False,
            scaling=0,
            adaptive_rho=False,
            rho=0.1,
            eps_abs=1e-4,
            eps_rel=1e-4,
            max_iter=iterations,
            check_termination=10,
        )
        self._solver: Any = interface._solver
        self._places = np.ravel_multi_index(np.nonzero(pattern.T)[::-1], pattern.shape)  # column by column
        self._most = osqp.constant("OSQP_INFTY")
        self._interrupted = int(osqp.SolverStatus.OSQP_SIGINT)
        # the second: to ten times the tolerance, which a plan that is made anew in every control period can do with
        self._good = (int(osqp.SolverStatus.OSQP_SOLVED), int(osqp.SolverStatus.OSQP_SOLVED_INACCURATE))

    def solve(
        self, share: float, gradient: Array, lower: Array, upper: Array, hessian: Array, start: tuple[Array, Array]
    ) -> tuple[Array, Array] | None:
        """Returns OSQP's solution (variables, multipliers) from a start; None if it finds none.

        While OSQP solves it takes SIGINT, even where the process ignores it. The signal is raised again for the
        process's own handler; where that goes on, the program is solved anew, so that no solution depends on it.

        Args:
            share: of the sum, that is minimised in its place.
            hessian: of which the numbers of the pattern are read.
            start: variables and multipliers.
        """
        solver = self._solver
        solver.update_data_vec(share * gradient, np.maximum(lower, -self._most), np.minimum(upper, self._most))
        solver.update_data_mat(share * hessian.take(self._places), None, None, None)
        while True:
            solver.warm_start(*start)
            solver.solve()
            status = solver.info.status_val
            if status != self._interrupted:
                solution = solver.solution
                return (solution.x, solution.y) if status in self._good and np.isfinite(solution.x).all() else None
            signal.raise_signal(signal.SIGINT)
