"""Quadratic programs by OSQP, solved as if Ctrl-C were not its business."""

import signal
from typing import Any

import numpy as np
from numpy.typing import NDArray


def solver_of(
    pattern: Any, gradient: NDArray[np.float64], constraints: Any, bounds: tuple[Any, Any], iterations: int
) -> Any:
    """Returns OSQP set up for a program, such that it keeps nothing of one solution for the next.

    Its own scaling and its adaptive step size, which remember, are off.

    Args:
        pattern: of the Hessian's upper triangle.
        bounds: the lower and the upper ones of the rows of the constraints.
        iterations: at most.
    """
    # here, so that a look at the policies does not wait for SciPy
    import osqp
    import scipy.sparse

    solver = osqp.OSQP()
    size = pattern.shape[0]
    solver.setup(
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
    return solver


def solution(solver: Any, *start: NDArray[np.float64]) -> Any | None:
    """Returns OSQP's solution from a start (variables, multipliers); None if it finds none.

    While OSQP solves it takes SIGINT, even where the process ignores it. The signal is raised again for the process's
    own handler; where that goes on, the program is solved anew, so that no solution depends on it.
    """
    import osqp

    # the second: to ten times the tolerance, which a plan that is made anew in every control period can do with
    good = (osqp.SolverStatus.OSQP_SOLVED, osqp.SolverStatus.OSQP_SOLVED_INACCURATE)
    while True:
        solver.warm_start(*start)
        result = solver.solve(raise_error=False)
        if result.info.status_val != osqp.SolverStatus.OSQP_SIGINT:
            return result if result.info.status_val in good and np.isfinite(result.x).all() else None
        signal.raise_signal(signal.SIGINT)
