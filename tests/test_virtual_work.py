"""Numbers at the sampling points, assembled, against the whole Lagrangian as a SymbolicEnergy."""

import ngsolve as ngs
import numpy as np
import pytest
from test_constrained import TAYLOR, derivative, discretised, vector

import ngcloth
from ngcloth import Elongation, Scene
from ngcloth.energy.sampling import RimPoints, Sampling


class Felt:
    """A law that is no polynomial, and whose third derivatives do not vanish."""

    stiffness = 2.0

    def energy(self, I4, I6, I8):
        return ngs.exp(I4 - 1) - I4 + 2 * (ngs.sqrt(I6) - 1) ** 4 + I8**2 / (1 + I8**2) * I4


SCENES = TAYLOR | {
    "felt": lambda: Scene(
        ngcloth.scenes.sphere(0.6).surface, Felt(), (Elongation(),), start=(0.5, 0.45)
    ),
    "a cost of its own": lambda: Scene(
        ngcloth.scenes.hemisphere().surface,
        ngcloth.Net(ks=1.0),
        (Elongation(),),
        start=(0.45, 0.5),
        cost=lambda cloth: cloth.shear**2 + cloth.jacobian * cloth.stretch1 + cloth.gradient[0, 1],
    ),
}


@pytest.fixture(params=[(name, order) for name in SCENES for order in (1, 2, 4)], ids=str)
def displaced(request):
    """A feasible state with η ≠ 0."""
    name, order = request.param
    problem = discretised(SCENES[name](), order=order)
    state, eta = vector(problem), slice(problem.psi_dofs.stop, None)
    random = np.random.default_rng(3).uniform(-1, 1, problem.fes.ndof)
    state[eta] = (0.1 * random * np.array(list(problem.free)))[eta]
    return problem


def dense(matrix):
    rows, columns, values = matrix.COO()
    full = np.zeros((matrix.height, matrix.width))
    full[np.array(rows), np.array(columns)] = values
    return full


def test_lagrangian_is_that_of_the_symbolic_energy(displaced):
    """Value, forces and matrix, limits on the rim aside, are those of NGSolve's linearisation."""
    problem = displaced
    c, draw = problem.slacks(), np.random.default_rng(4)
    z, stiffness = draw.uniform(0, 1, c.shape), draw.uniform(0, 1, c.shape)
    z[:, len(problem.points) :] = stiffness[:, len(problem.points) :] = 0  # on the rim
    energy = problem.symbolic_energy(c, z, stiffness)
    assert abs(problem.work()) > 1e-3
    value = problem.cost() + problem.work() - (problem.weights * z * c).sum()
    assert value == pytest.approx(energy.Energy(problem.state.vec), rel=1e-10)

    force = problem.state.vec.CreateVector()
    energy.Apply(problem.state.vec, force)
    expected = force.FV().NumPy()
    assert derivative(problem, z) == pytest.approx(expected, abs=1e-10 * abs(expected).max())

    energy.AssembleLinearization(problem.state.vec)
    whole, here = dense(energy.mat), dense(problem.hessian(z, stiffness))
    assert np.abs(here[problem.psi_dofs, problem.psi_dofs.stop :]).max() > 1e-2
    assert np.abs(here - whole).max() <= 1e-10 * np.abs(whole).max()


def test_cost_gradient(displaced):
    """Without multipliers and η, the forces are those of the cost."""
    problem = displaced
    out = problem.state.vec.CreateVector()
    problem.cost_gradient(out)
    vector(problem)[problem.psi_dofs.stop :] = 0
    expected = derivative(problem, np.zeros_like(problem.slacks()))
    expected[problem.psi_dofs.stop :] = 0
    assert out.FV().NumPy() == pytest.approx(expected, abs=1e-12 * abs(expected).max())


def test_sampling(displaced):
    """Samples are NGSolve's own values and derivatives, the transposed map is the transpose."""
    problem = displaced
    function, slope = problem.state.components[0], ngs.grad(problem.state.components[0])
    space = function.space
    sampling = Sampling(space, problem.points)
    (samples,) = sampling.at_points([function.vec.FV().NumPy()])
    probe = problem.points.field()
    for row, expression in zip(samples, (function, slope[0], slope[1]), strict=True):
        probe.Interpolate(expression)
        assert row == pytest.approx(probe.vec.FV().NumPy(), abs=1e-12)
        assert problem.points.sample(expression)[0] == pytest.approx(row, abs=1e-12)
    random = np.random.default_rng(1)
    values, loads = random.normal(size=(2, space.ndof)), random.normal(size=(2, *samples.shape))
    there = sampling.at_points(values) * loads
    assert (sampling.transposed(loads) * values).sum() == pytest.approx(there.sum())
    derivatives = sampling.transposed(loads[:, 1:])
    assert (derivatives * values).sum() == pytest.approx(there[:, 1:].sum())


def test_points_on_the_rim(displaced):
    """Values and derivatives are those of NGSolve in the triangles there, weights are lengths."""
    problem = displaced
    function, mesh = problem.state.components[0], problem.fes.mesh
    points, along = RimPoints(mesh, 6), mesh.Boundaries("rim")
    (samples,) = Sampling(function.space, points).at_points([function.vec.FV().NumPy()])
    expected = points.sample(ngs.BoundaryFromVolumeCF(ngs.CF((function, ngs.grad(function)))))
    assert samples == pytest.approx(expected, abs=1e-12)
    (x,) = points.sample(ngs.x)
    assert points.weights @ x**2 == pytest.approx(
        ngs.Integrate(ngs.x**2 * ngs.ds(definedon=along, bonus_intorder=6), mesh), rel=1e-6
    )
