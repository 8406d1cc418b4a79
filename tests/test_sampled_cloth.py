"""Numbers at the sampling points against NGSolve's expressions down to ψ."""

import ngsolve as ngs
import numpy as np
import pytest
from test_constrained import TAYLOR, discretised

from ngcloth.energy.sampled_cloth import SampledExpressions
from ngcloth.problem.kinematics import Kinematics, gradient

FELT = {
    "stretches and shear": lambda cloth: [cloth.stretch1, cloth.stretch2, cloth.shear],
    "stress": lambda cloth: [
        cloth.jacobian * cloth.contravariant_stress[0, 1],
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


@pytest.mark.parametrize("felt", FELT)
def test_values_and_slopes(cloths, felt):
    """What a limit may use, and its derivatives by ∇ψ, are those of NGSolve's expressions."""
    here, cloth = cloths
    sampled = SampledExpressions(here, before=[here.stretch2], felt=FELT[felt](here))
    values, slopes = sampled.values("felt"), sampled.slopes("felt")
    n = len(here.points)
    assert values.shape == (len(FELT[felt](cloth)), n) and slopes.shape == (len(values), 4, n)
    for row, expression in enumerate(FELT[felt](cloth)):
        (expected,) = here.points.sample(expression)
        assert values[row] == pytest.approx(expected, rel=1e-10, abs=1e-12)
        expected = here.points.sample(expression.Diff(cloth.gradient))
        assert slopes[row] == pytest.approx(expected, abs=1e-10 * max(abs(expected).max(), 1))


def test_follows_the_state(cloths):
    """Values are those of the present ψ: a patch twice as large halves both stretches."""
    here, _ = cloths
    stretches = SampledExpressions(here, both=[here.stretch1, here.stretch2])
    before, slopes = stretches.values("both"), stretches.slopes("both")
    here.state.vec.data *= 2.0
    assert stretches.values("both") == pytest.approx(before / 2, rel=1e-12)
    assert stretches.slopes("both") == pytest.approx(slopes / 4, rel=1e-12, abs=1e-12)


@pytest.mark.parametrize("felt", FELT)
def test_second_derivatives(cloths, felt):
    """Weighted second derivatives by ∇ψ are those of NGSolve's expressions."""
    here, cloth = cloths
    expressions = FELT[felt](cloth)
    n, draw = len(here.points), np.random.default_rng(2)
    weights = draw.normal(size=(len(expressions), n))
    sampled = SampledExpressions(here, felt=FELT[felt](here))
    bend, expected = sampled.bend(felt=weights), np.zeros((4, 4, n))
    for weight, expression in zip(weights, expressions, strict=True):
        slope = expression.Diff(cloth.gradient)
        for i, j in np.ndindex(2, 2):
            second = here.points.sample(slope[i, j].Diff(cloth.gradient))
            expected[2 * i + j] += weight * second
    assert bend == pytest.approx(expected, abs=1e-9 * max(abs(expected).max(), 1))
