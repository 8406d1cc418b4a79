"""Numbers at the sampling points against NGSolve's expressions down to ψ."""

import ngsolve as ngs
import numpy as np
import pytest
from discretising import TAYLOR, discretised

from ngcloth.energy.sampled_cloth import SampledExpressions
from ngcloth.problem.kinematics import Kinematics, gradient

FELT = {
    "stretches and shear": lambda cloth: [cloth.stretch1, cloth.stretch2, cloth.shear],
    "stress": lambda cloth: [
        cloth.jacobian * cloth.energy_slopes[2],
        *cloth.energy_slopes,
    ],
    "reaction": lambda cloth: [cloth.reaction],
    "G itself": lambda cloth: [
        cloth.gradient[1, 0] * cloth.inverse[0, 1],
        ngs.sqrt(cloth.jacobian) * cloth.cauchy_green[1, 0],
    ],
    "a constant": lambda cloth: [ngs.CF(2.0)],
    "nothing": lambda cloth: [],
}


@pytest.fixture(params=TAYLOR)
def cloths(request):
    """The cloth at the points of a problem, and the same in expressions."""
    problem = discretised(TAYLOR[request.param]())
    here = problem._here
    surface, fabric = problem.scene.surface, problem.scene.fabric
    slope = gradient(*problem.state.components[:2])
    cloth = Kinematics(slope, surface.metric, fabric, lambda: surface.curvature)
    return here, cloth


def by_flat_gradients(here, derivative):
    """Derivatives by Y of those by G, (2, 2, points): G changes by Y G."""
    return np.einsum("imn,jmn->ijn", derivative, here.gradients()).reshape(4, -1)


@pytest.mark.parametrize("felt", FELT)
def test_values_and_slopes(cloths, felt):
    """What a limit may use, and its derivatives by Y, are those of NGSolve's expressions."""
    here, cloth = cloths
    sampled = SampledExpressions(here, FELT[felt](here))
    values, slopes = sampled.values(), sampled.slopes()
    n = len(here.points)
    assert values.shape == (len(FELT[felt](cloth)), n) and slopes.shape == (len(values), 4, n)
    for row, expression in enumerate(FELT[felt](cloth)):
        (expected,) = here.points.sample(expression)
        assert values[row] == pytest.approx(expected, rel=1e-10, abs=1e-12)
        derivative = here.points.sample(expression.Diff(cloth.gradient))
        expected = by_flat_gradients(here, derivative.reshape(2, 2, -1))
        assert slopes[row] == pytest.approx(expected, abs=1e-10 * max(abs(expected).max(), 1))


def test_follows_the_state(cloths):
    """Values are those of the present ψ: a patch twice as large halves both stretches."""
    here, _ = cloths
    stretches = SampledExpressions(here, [here.stretch1, here.stretch2])
    before, slopes = stretches.values(), stretches.slopes()
    here.state.vec.data *= 2.0
    assert stretches.values() == pytest.approx(before / 2, rel=1e-12)
    assert stretches.slopes() == pytest.approx(slopes / 2, rel=1e-12, abs=1e-12)


@pytest.mark.parametrize("felt", FELT)
def test_second_derivatives(cloths, felt):
    """Weighted second derivatives by Y are those of NGSolve's expressions."""
    here, cloth = cloths
    expressions = FELT[felt](cloth)
    n, draw = len(here.points), np.random.default_rng(2)
    weights = draw.normal(size=(len(expressions), n))
    bend, expected = SampledExpressions(here, FELT[felt](here)).bend(weights), np.zeros((4, 4, n))
    for weight, expression in zip(weights, expressions, strict=True):
        slope = expression.Diff(cloth.gradient)
        for i, j in np.ndindex(2, 2):
            second = here.points.sample(slope[i, j].Diff(cloth.gradient))
            expected[2 * i + j] += weight * second
    half = np.array([by_flat_gradients(here, row.reshape(2, 2, -1)) for row in expected])
    turned = half.reshape(2, 2, 4, -1).swapaxes(0, 2).swapaxes(1, 2)
    expected = np.array([by_flat_gradients(here, row) for row in turned])
    assert bend == pytest.approx(expected, abs=1e-9 * max(abs(expected).max(), 1))
