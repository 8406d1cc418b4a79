"""Lanczos iteration for the eigenvalues next to a shift, where a matrix has been factorised."""

import numpy as np

KRYLOV = 30  # vectors at most
SURE = 1e-3  # of the last eigenvalue: the change at which it ends


def lanczos(solve, norm, size):
    """Eigenvalues of inverse · norm on a Krylov space, and the vector of the last.

    NGSolve's own Arnoldi solver returns the eigenvalues nearest to a shift and would not tell that
    there are others below it.

    Parameters
    ----------
    solve, norm : callable
        The inverse and the norm, which is positive semidefinite, times a vector.
    size : int
        Of vectors.

    Returns
    -------
    values : ndarray
        Ascending.
    vector : ndarray, (size,)
    """
    vector = solve(norm(np.random.default_rng(0).standard_normal(size)))
    basis, duals = np.zeros((KRYLOV, size)), np.zeros((KRYLOV, size))
    matrix, values, vectors, lengths = np.zeros((KRYLOV, KRYLOV)), np.zeros(1), np.eye(1), []
    for k in range(KRYLOV):
        dual = norm(vector)
        lengths.append(np.sqrt(max(vector @ dual, 0.0)))
        if not lengths[k] > 1e-13 * lengths[0] * (k > 0):
            break
        matrix[k, k - 1] = lengths[k] if k else 0.0
        basis[k], duals[k] = vector / lengths[k], dual / lengths[k]
        vector = solve(duals[k])
        matrix[k, k] = vector @ duals[k]
        for _ in range(2):
            vector = vector - (duals[: k + 1] @ vector) @ basis[: k + 1]
        before = values[-1]
        values, vectors = np.linalg.eigh(matrix[: k + 1, : k + 1])
        if abs(values[-1] - before) <= SURE * abs(values[-1]):
            break
    return values, vectors[:, -1] @ basis[: len(values)]
