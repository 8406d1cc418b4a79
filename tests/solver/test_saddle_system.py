"""Linear systems of saddles: solved without pivoting, and their pivots counted."""

import numpy as np
import pytest
from discretising import TAYLOR, discretised, times, with_multipliers

from ngcloth.solver.saddle_system import ACCURACY, SaddleSystem, _pivots


@pytest.fixture(params=TAYLOR)
def displaced(request):
    """A strictly feasible state with v ≠ 0, and a direction in all free unknowns."""
    problem = discretised(TAYLOR[request.param]())
    problem.mu = 0.1
    direction = with_multipliers(problem)
    assert problem.least_jacobian() > 0 and problem.slacks().min() > 0
    return problem, direction


def test_linear_solver_with_and_without_pivoting(displaced):
    """LDLᵀ of the softened matrix, refined, and LU of the matrix itself."""
    problem, direction = displaced
    c = problem.slacks()
    matrix = problem.hessian(problem.mu / c, problem.mu / c**2)
    matrix.AsVector().data += problem.flow.AsVector()
    load, found = (problem.state.vec.CreateVector() for _ in range(2))
    load.FV().NumPy()[:] = times(matrix, direction)
    for inverse, accuracy in (("sparsecholesky", ACCURACY), ("umfpack", 1e-7)):
        problem.inverse = inverse
        system = SaddleSystem(problem)
        for scale in (1.0, 2.0):  # the same system again, with other entries
            matrix.AsVector().data *= scale
            system.solver(matrix)(load, found)
            missed = times(matrix, found.FV().NumPy()) - load.FV().NumPy()
            assert np.linalg.norm(missed[list(problem.free)]) < accuracy * load.Norm()
        matrix.AsVector().data *= 0.5


def test_minimum_is_told_from_other_saddles(displaced):
    """By the pivots, as by the eigenvalues: as many negative ones as v."""
    problem, _ = displaced
    c, free = problem.slacks(), list(problem.free)
    matrix = problem.hessian(problem.mu / c, problem.mu / c**2)
    multipliers = sum(free[problem.psi_dofs.stop :])
    problem.inverse = "sparsecholesky"
    system = SaddleSystem(problem)
    told, added = [], 0.0
    for rate in (-100.0, -1.0, 0.0, 1.0, 10.0, 100.0, 1e3, 1e4, 1e5):
        matrix.AsVector().data += (rate - added) * problem.flow.AsVector()
        added = rate
        system.solver(matrix)
        dense = matrix.ToDense().NumPy()[free][:, free]
        told.append(system.is_minimum())
        assert told[-1] == ((np.linalg.eigvalsh(dense) < 0).sum() == multipliers)
    assert told == sorted(told) and not told[0] and told[-1]
    factors = matrix.Inverse(problem.free, inverse="sparsecholesky")
    assert _pivots(factors, sum(free) - 1) is None  # as it would be in another layout
