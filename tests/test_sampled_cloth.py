"""Numbers at the sampling points against NGSolve's expressions down to ψ."""

import ngsolve as ngs
import pytest
from test_constrained import TAYLOR, discretised

from ngcloth.kinematics import Kinematics, gradient
from ngcloth.sampled_cloth import SampledExpressions

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
    sampled = SampledExpressions(here, FELT[felt](here))
    values, slopes = sampled.values(), sampled.slopes()
    n = here.points.ndof
    assert values.shape == (len(FELT[felt](cloth)), n) and slopes.shape == (len(values), 4, n)
    one, four = ngs.GridFunction(here.points), ngs.GridFunction(here.points**4)
    for row, expression in enumerate(FELT[felt](cloth)):
        one.Interpolate(expression)
        assert values[row] == pytest.approx(one.vec.FV().NumPy(), rel=1e-10, abs=1e-12)
        four.Interpolate(expression.Diff(cloth.gradient))
        expected = four.vec.FV().NumPy().reshape(4, n)
        assert slopes[row] == pytest.approx(expected, abs=1e-10 * max(abs(expected).max(), 1))


def test_follows_the_state(cloths):
    """Values are those of the present ψ: a patch twice as large halves both stretches."""
    here, _ = cloths
    stretches = SampledExpressions(here, [here.stretch1, here.stretch2])
    before, slopes = stretches.values(), stretches.slopes()
    here.state.vec.data *= 2.0
    assert stretches.values() == pytest.approx(before / 2, rel=1e-12)
    assert stretches.slopes() == pytest.approx(slopes / 4, rel=1e-12, abs=1e-12)
