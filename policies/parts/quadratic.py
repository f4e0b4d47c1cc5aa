"""Quadratic programs by OSQP, solved as if Ctrl-C were not its business."""

import signal
from typing import Any

import numpy as np
from numpy.typing import NDArray


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
        found = solver.solve(raise_error=False)
        if found.info.status_val != osqp.SolverStatus.OSQP_SIGINT:
            return found if found.info.status_val in good and np.isfinite(found.x).all() else None
        signal.raise_signal(signal.SIGINT)
