"""Closed forms at the sampling points against the whole Lagrangian as one SymbolicEnergy."""

import ngsolve as ngs
import numpy as np
import pytest
from discretising import TAYLOR, derivative, discretised, vector, with_multipliers

import ngcloth
from ngcloth import Elongation, Scene
from ngcloth.energy.automatic import AutomaticLagrangian
from ngcloth.energy.closed_form import ClosedFormLagrangian
from ngcloth.problem.constraints import LimitPoints

KINDS = ClosedFormLagrangian, AutomaticLagrangian


class Felt:
    """A law that is no polynomial, and whose third derivatives do not vanish."""

    stiffness = 2.0

    def energy(self, I4, I6, I8):
        return ngs.exp(I4 - 1) - I4 + 2 * (ngs.sqrt(I6) - 1) ** 4 + I8**2 / (1 + I8**2) * I4


SCENES = TAYLOR | {
    "felt": lambda: Scene(
        ngcloth.scenes.sphere(0.6).surface, Felt(), (Elongation(),), start=(0.95, 0.9)
    ),
    "a cost of its own": lambda: Scene(
        ngcloth.scenes.hemisphere().surface,
        ngcloth.Net(ks=1.0),
        (Elongation(),),
        start=(0.45, 0.5),
        cost=lambda cloth: cloth.shear**2 + cloth.jacobian * cloth.stretch1 + cloth.gradient[0, 1],
    ),
}


CASES = [(name, order) for name in SCENES for order in (1, 2, 3, 4)]


@pytest.fixture(params=CASES, ids=str)
def both(request):
    """A feasible state with v ≠ 0, by closed forms and by automatic linearisation."""
    name, order = request.param
    scene = SCENES[name]()
    here, there = (discretised(scene, order=order, kind=kind) for kind in KINDS)
    direction = with_multipliers(here)
    vector(there)[:] = vector(here)
    added = np.array([[0.25, 0.5], [0.0, 1.0], [0.25, 0.5]])
    for problem in (here, there):
        problem.add_limit_points(LimitPoints(np.array([1, 0, 3]), added))
        problem.add_limit_points(LimitPoints(np.array([1, 2, 2]), added))
        vector_of = problem.direction.vec.FV().NumPy()
        vector_of[:] = direction
    return here, there


def dense(matrix):
    rows, columns, values = matrix.COO()
    full = np.zeros((matrix.height, matrix.width))
    full[np.array(rows), np.array(columns)] = values
    return full


def test_both_linearisations_are_the_same(both):
    """Value, forces and matrix, limits on the rim included."""
    here, there = both
    c, draw = here.slacks(), np.random.default_rng(4)
    assert there.slacks() == pytest.approx(c, rel=1e-10, abs=1e-12)
    changes = here.slack_changes()
    assert there.slack_changes() == pytest.approx(changes, abs=1e-10 * np.abs(changes).max())
    assert there.weights == pytest.approx(here.weights, rel=1e-10)
    assert abs(here.work()) > 1e-3
    for name in ("cost", "work", "least_jacobian", "stiffness", "imbalance"):
        assert getattr(there, name)() == pytest.approx(getattr(here, name)(), rel=1e-10), name

    z, stiffness = draw.uniform(0, 1, c.shape), draw.uniform(0, 1, c.shape)
    expected = derivative(there, z)
    assert derivative(here, z) == pytest.approx(expected, abs=1e-10 * abs(expected).max())
    whole, closed = dense(there.hessian(z, stiffness)), dense(here.hessian(z, stiffness))
    assert np.abs(closed[here.psi_dofs, here.psi_dofs.stop :]).max() > 1e-2
    assert np.abs(closed - whole).max() <= 1e-10 * np.abs(whole).max()
    for part in here.parts[1:]:  # the rim is felt, and what was added
        without = np.ones(len(here.weights))
        without[part] = 0
        others = dense(here.hessian(z * without, stiffness * without))
        assert np.abs(others - whole).max() > 1e-8 * np.abs(whole).max()


def test_cost_gradient(both):
    """Without multipliers, the forces are those of the cost."""
    for problem in both:
        out = problem.state.vec.CreateVector()
        problem.cost_gradient(out)
        kept = vector(problem).copy()
        vector(problem)[problem.psi_dofs.stop :] = 0
        expected = derivative(problem, np.zeros_like(problem.slacks()))
        expected[problem.psi_dofs.stop :] = 0
        vector(problem)[:] = kept
        assert out.FV().NumPy() == pytest.approx(expected, abs=1e-12 * abs(expected).max())


GAMMA = float(np.cos(np.pi / 6))
SOLVES = {
    "hemisphere": (lambda: ngcloth.scenes.hemisphere(1.0), {"maxh": 0.3}),
    "order 4": (lambda: ngcloth.scenes.hemisphere(10.0), {"maxh": 0.4, "order": 4}),
    "linear v": (lambda: ngcloth.scenes.hemisphere(1.0), {"maxh": 0.3, "multiplier_order": 1}),
    "catenoid": (lambda: ngcloth.scenes.hemicatenoid(100.0), {"maxh": 0.4}),
    "shear limit": (lambda: ngcloth.scenes.sphere(0.7, shear_limit=GAMMA), {"maxh": 0.3}),
    "obstacle": (lambda: ngcloth.scenes.hemicatenoid(1.0, obstacle=True), {"maxh": 0.7}),
    "a law of its own": (SCENES["felt"], {"maxh": 0.65, "order": 2}),
    "a cost of its own": (
        lambda: Scene(
            ngcloth.scenes.hemisphere().surface,
            ngcloth.Net(ks=1.0),
            (Elongation(),),
            cost=lambda cloth: cloth.shear**2 + (cloth.I4 - 1) ** 2 + (cloth.I6 - 1) ** 2,
            symmetric=True,
        ),
        {"maxh": 0.4},
    ),
    "a cost without limits": (
        lambda: Scene(
            ngcloth.scenes.sphere(0.2).surface,
            ngcloth.Net(ks=1.0),
            cost=lambda cloth: (cloth.I4 - 1) ** 2 + (cloth.I6 - 1) ** 2 + 2 * cloth.I8**2,
            symmetric=True,
        ),
        {"maxh": 0.4},
    ),
}


@pytest.mark.parametrize("name", SOLVES)
def test_the_symbolic_energy_solves(name):
    """By its automatic linearisation alone, in the same steps to the same patch."""
    make, settings = SOLVES[name]
    here, there = (
        ngcloth.solve(make(), linearisation=kind, **settings)
        for kind in ("closed form", "automatic")
    )
    assert here.converged and there.converged
    assert there.newton_iterations == here.newton_iterations
    assert there.energy == pytest.approx(here.energy, rel=1e-8)
    assert there.outline(40) == pytest.approx(here.outline(40), abs=1e-6)
