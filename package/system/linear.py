"""Small linear algebra in plain arithmetic, to the same bits on every machine.

NumPy's `linalg`, `@` and `einsum` run on BLAS and LAPACK, whose kernels and order of sums depend on the processor. What
feeds motion, observations or commands uses these.
"""

import numpy as np
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]

DOUBLINGS = 60  # of the horizon of a Riccati equation


def product(a: ArrayLike, b: ArrayLike) -> Array:
    """Returns the matrix product (n, m) of (n, k) and (k, m), summed in the order of k."""
    left, right = np.asarray(a, np.float64), np.asarray(b, np.float64)
    total = np.zeros((left.shape[0], right.shape[1]))
    for k in range(left.shape[1]):
        total += left[:, k, None] * right[None, k]
    return total


def solve(matrix: ArrayLike, right: ArrayLike) -> Array:
    """Returns x of matrix x = right, (n, n) and (n, m), by elimination with row pivoting.

    Raises:
        ValueError: if the matrix is singular.
    """
    a = np.array(matrix, np.float64)
    x = np.array(right, np.float64)
    n = len(a)
    for k in range(n):
        pivot = k + int(np.abs(a[k:, k]).argmax())
        if a[pivot, k] == 0.0:
            raise ValueError("the matrix is singular")
        a[[k, pivot]], x[[k, pivot]] = a[[pivot, k]], x[[pivot, k]]
        factors = a[k + 1 :, k, None] / a[k, k]
        a[k + 1 :] -= factors * a[None, k]
        x[k + 1 :] -= factors * x[None, k]
    for k in range(n - 1, -1, -1):
        for j in range(k + 1, n):
            x[k] -= a[k, j] * x[j]
        x[k] /= a[k, k]
    return x


def pseudo_inverse(matrix: ArrayLike) -> Array:
    """Returns the Moore-Penrose inverse (m, n) of a matrix (n, m) whose columns are independent or zero.

    By the normal equations of the columns that are not zero: A+ = (A^T A)^-1 A^T. A column of zeros, as the sideways
    one of a differential drive, gives a row of zeros.

    Raises:
        ValueError: if other columns depend on each other.
    """
    a = np.asarray(matrix, np.float64)
    columns = [j for j in range(a.shape[1]) if a[:, j].any()]
    some = a[:, columns]
    gram = product(some.T, some)
    inverse = np.zeros((a.shape[1], a.shape[0]))
    if columns:
        inverse[columns] = solve(gram, some.T)
    return inverse


def riccati(a: ArrayLike, b: ArrayLike, q: ArrayLike, r: float) -> Array:
    """Returns the stabilising solution P of P = A^T P A - A^T P B (r + B^T P B)^-1 B^T P A + Q, for one input.

    The structure-preserving doubling algorithm (Chu, Fan, Lin and Wang, "Structure-preserving algorithms for periodic
    discrete-time algebraic Riccati equations", Int. J. Control 77, 2004): every step looks twice as far ahead.

    Args:
        a, b, q: (n, n), (n, 1) and (n, n), q symmetric and positive semidefinite.
        r: weight of the input, above 0.

    Raises:
        ValueError: if it does not converge: the pair is not stabilisable, or what is not seen is not stable.
    """
    f = np.array(a, np.float64)
    column = np.asarray(b, np.float64)
    g = product(column, column.T) / r
    h = np.array(q, np.float64)
    one = np.eye(len(f))
    for _ in range(DOUBLINGS):
        if not max(np.abs(f).max(), np.abs(g).max(), np.abs(h).max()) < 1e100:
            break  # before a product overflows
        left = solve(one + product(g, h), np.hstack([f, g]))
        forward, inward = left[:, : len(f)], left[:, len(f) :]
        change = product(f.T, product(h, forward))
        g = g + product(f, product(inward, f.T))
        f = product(f, forward)
        h = h + 0.5 * (change + change.T)
        g = 0.5 * (g + g.T)
        if np.abs(change).max() <= 1e-15 * np.abs(h).max():
            return h
    raise ValueError("the Riccati equation has no stabilising solution")
