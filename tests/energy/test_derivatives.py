"""Value, forces and matrix of the Lagrangian with limits, by Taylor tests and a closed form."""

from dataclasses import dataclass

import ngsolve as ngs
import numpy as np
import pytest
from discretising import TAYLOR, bent, derivative, discretised, times, vector, with_multipliers

from ngcloth import BendingThreads, Elongation, Net, Scene, ShearLimit
from ngcloth.energy.automatic import AutomaticLagrangian
from ngcloth.problem.constraints import RIM_SHARE
from ngcloth.scenes import hemisphere, sphere
from ngcloth.solver.iterate import Iterate


@pytest.fixture(params=TAYLOR)
def displaced(request):
    """A strictly feasible state with v ≠ 0, and a direction in all free unknowns."""
    problem = discretised(TAYLOR[request.param]())
    problem.mu = 0.1
    direction = with_multipliers(problem)
    assert problem.least_jacobian() > 0 and problem.slacks().min() > 0
    return problem, direction


def barrier_value(problem):
    """E + dE[v] − μ Σ ∫ log c dA."""
    barrier = (problem.weights * np.log(problem.slacks())).sum()
    return problem.cost() + problem.work() - problem.mu * barrier


def barrier_slope(problem):
    return derivative(problem, problem.mu / problem.slacks())


def remainders(problem, direction, curved):
    """|value|, first and second order of the value, first order of the gradient, for falling t."""
    state = vector(problem)
    base, value, slope = state.copy(), barrier_value(problem), barrier_slope(problem)
    rows = []
    for t in 2.0 ** -np.arange(7, 12):
        state[:] = base + t * direction
        change, turned = barrier_value(problem) - value, barrier_slope(problem) - slope
        first = change - t * slope @ direction
        second = first - t * t * curved @ direction / 2
        rows.append([abs(first), abs(second), np.linalg.norm(turned - t * curved)])
    state[:] = base
    return np.array(rows).T


def rates(values):
    values = np.asarray(values)
    return np.log2(values[:-1] / values[1:])


def test_taylor(displaced):
    """ψ, v and barrier: gradient of the value, and the primal-dual matrix at z = μ/c, which is
    the Hessian there and nowhere else."""
    problem, direction = displaced
    c = problem.slacks()
    z = problem.mu / c
    curved = times(problem.hessian(z, z / c), direction)
    first, second, gradients = remainders(problem, direction, curved)
    assert rates(first) == pytest.approx(2, abs=0.2)
    assert rates(second)[1:] == pytest.approx(3, abs=0.3)
    assert rates(gradients)[1:] == pytest.approx(2, abs=0.2)
    assert second[-1] < 0.1 * first[-1]

    curved = times(problem.hessian(30 * z, 30 * z / c), direction)
    _, second, gradients = remainders(problem, direction, curved)
    assert rates(second)[-1] < 2.3 and rates(gradients)[-1] < 1.3


@dataclass(frozen=True)
class Zones:
    """A net that is softer in the middle, and pulls along X1 on one side."""

    of_place, stiffness = True, 1.0

    def energy(self, I4, I6, I8, X1, X2):
        soft = ngs.exp(-(X1**2) - 2 * X2**2)
        return (2 - soft) * (I4 - 1) ** 2 + (1 + 0.3 * X1) * (I6 - 1) ** 2 + (1 + soft) * I8**2


@pytest.mark.parametrize(
    ("fabric", "placed"),
    [(Zones(), True), (BendingThreads(Net(ks=1.0), (0.3, 0.1), 0.2), False)],
)
def test_taylor_of_fabrics_of_more_than_strain(fabric, placed):
    """Value, forces and matrix, with what comes from ψ itself or its curvature, and from v."""
    limits = Elongation(), ShearLimit(0.9)
    scene = Scene(sphere(0.6).surface, fabric, limits, bent)
    problem = discretised(scene, kind=AutomaticLagrangian)
    problem.mu = 0.1
    direction = with_multipliers(problem)
    c = problem.slacks()
    z = problem.mu / c
    curved = times(problem.hessian(z, z / c), direction)
    first, second, gradients = remainders(problem, direction, curved)
    assert rates(first) == pytest.approx(2, abs=0.2)
    assert rates(second)[1:] == pytest.approx(3, abs=0.3)
    assert rates(gradients)[1:] == pytest.approx(2, abs=0.2)
    held = problem.fes.FreeDofs().NumSet() - problem.free.NumSet()
    assert held == (0 if placed else 2)  # it may matter where X = 0 is


def test_slack_changes(displaced):
    problem, direction = displaced
    problem.direction.vec.FV().NumPy()[:] = direction
    changes, state = problem.slack_changes(), vector(problem)
    base, t = state.copy(), 1e-4
    state[:] = base + t * direction
    ahead = problem.slacks()
    state[:] = base - t * direction
    behind = problem.slacks()
    for change, plus, minus in zip(changes, ahead, behind, strict=True):
        scale = np.abs(change).max()
        assert scale > 1e-3
        assert (plus - minus) / (2 * t) == pytest.approx(change, abs=1e-4 * scale)


def test_barrier_of_a_uniform_stretch():
    """ψ = cθ: −μ ∫ log(1 − 1/λ) dA of λ = 2/(c (1 + ρ²)), by a quadrature in ρ alone.

    The rim, where λ = 1/c, counts as a part `RIM_SHARE` of the area.
    """
    c, mu = 0.5, 0.3
    scene = Scene(hemisphere().surface, Net(), (Elongation(),), start=(c, c), symmetric=True)
    problem = discretised(scene, maxh=0.25, order=4, quadrature=12)
    iterate = Iterate(problem, mu)
    nodes, weights = np.polynomial.legendre.leggauss(40)
    rho = (nodes + 1) / 2
    conformal = 4 / (1 + rho**2) ** 2
    integrand = 2 * np.log(1 - c * (1 + rho**2) / 2) * conformal * 2 * np.pi * rho
    rim = RIM_SHARE * 2 * np.pi * 2 * np.log(1 - c)
    expected = -mu * ((weights / 2) @ integrand + rim)
    assert 4 * (iterate.lagrangian() - problem.cost()) == pytest.approx(expected, rel=1e-6)
