"""The work of sliding and what couples ψ and η, against NGSolve's own differentiation."""

import ngsolve as ngs
import numpy as np
import pytest
from test_constrained import TAYLOR, discretised, vector

from ngcloth.kinematics import gradient, virtual_strain
from ngcloth.sampling import Sampling


@pytest.fixture(params=TAYLOR)
def displaced(request):
    """A feasible state with η ≠ 0, and its work as a `SymbolicEnergy` of ψ and η."""
    problem = discretised(TAYLOR[request.param]())
    state, eta = vector(problem), slice(problem.psi_dofs.stop, None)
    random = np.random.default_rng(3).uniform(-1, 1, problem.fes.ndof)
    state[eta] = (0.1 * random * np.array(list(problem.free)))[eta]
    surface, trial = problem.scene.surface, problem.fes.TrialFunction()
    cloth = problem._kinematics(trial)
    strain = virtual_strain(
        ngs.CF(tuple(trial[2:])), gradient(*trial[2:]), surface.metric, surface.metric_derivatives
    )
    density = (
        ngs.InnerProduct(cloth.jacobian * cloth.contravariant_stress, strain)
        / problem.scene.fabric.stiffness
    )
    return problem, problem._symbolic_energy(density)


def dense(matrix):
    rows, columns, values = matrix.COO()
    full = np.zeros((matrix.height, matrix.width))
    full[np.array(rows), np.array(columns)] = values
    return full


def test_work_and_forces(displaced):
    """The work is ∫ J S : L_η a, and its derivative by η the force of equilibrium."""
    problem, energy = displaced
    assert abs(problem.work()) > 1e-3
    assert problem.work() == pytest.approx(energy.Energy(problem.state.vec), rel=1e-10)
    force = problem.state.vec.CreateVector()
    energy.Apply(problem.state.vec, force)
    eta_force = force.FV().NumPy()[problem.psi_dofs.stop :]
    assert problem._work.eta_force() == pytest.approx(eta_force, abs=1e-10 * abs(eta_force).max())


def test_matrix_is_that_of_automatic_linearisation(displaced):
    """With z and stiffness zero, the Hessian is that of E + work, each a `SymbolicEnergy`."""
    problem, energy = displaced
    nothing = np.zeros_like(problem.slacks())
    problem.freeze(nothing, nothing, nothing)
    energy.AssembleLinearization(problem.state.vec)
    problem._energy.AssembleLinearization(problem.state.vec)
    whole = dense(energy.mat) + dense(problem._energy.mat)
    here = dense(problem.hessian())
    assert np.abs(here[problem.psi_dofs, problem.psi_dofs.stop :]).max() > 1e-2
    assert here == pytest.approx(whole, abs=1e-10 * np.abs(whole).max())


def test_sampling(displaced):
    """Samples are NGSolve's own values and derivatives, the transposed map is the transpose."""
    problem, _ = displaced
    function, slope = problem.state.components[0], ngs.grad(problem.state.components[0])
    space = function.space
    sampling = Sampling(space, problem.points, problem._dx)
    samples = sampling.at_points(function.vec.FV().NumPy())
    probe = ngs.GridFunction(problem.points)
    for row, expression in zip(samples, (function, slope[0], slope[1]), strict=True):
        probe.Interpolate(expression)
        assert row == pytest.approx(probe.vec.FV().NumPy(), abs=1e-12)
    random = np.random.default_rng(1)
    values, loads = random.normal(size=space.ndof), random.normal(size=samples.shape)
    there = (sampling.at_points(values) * loads).sum()
    assert sampling.transposed(loads) @ values == pytest.approx(there)
    assert sampling.transposed(loads[1:]) @ values == pytest.approx(
        (sampling.at_points(values) * loads)[1:].sum()
    )
