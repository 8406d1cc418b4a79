"""An eighth of the sphere from STEP, between two mirror lines: the numbers of a quarter dome."""

import numpy as np
import pytest
from geometry import shapes

from ngcloth import Elongation, Net, Scene, Surface, solve


@pytest.fixture(scope="module")
def octant(tmp_path_factory):
    path = tmp_path_factory.mktemp("parts") / "octant.step"
    shapes.octant().WriteStep(str(path))
    return Surface.from_cad(path, "dome")


def solved(octant, fabric, limits, **settings):
    return solve(Scene(octant, fabric, limits, symmetric=True), **settings)


@pytest.mark.parametrize(
    ("order", "maxh", "energy", "error"),
    [(2, 0.075, 1e-6, 5e-4), (4, 0.075, 1e-12, 5e-7), (6, 0.15, 1e-14, 2e-8)],
)
def test_chebyshev_net(octant, order, maxh, energy, error):
    result = solved(octant, Net(), [], maxh=maxh, order=order)
    assert result.converged and result.newton_iterations <= 15
    assert result.normalized_energy < energy
    first, second, pole = np.linalg.norm(result.flatten([(1, 0, 0), (0, 1, 0), (0, 0, 1)]), axis=1)
    assert max(abs(first - np.pi / 2), abs(second - np.pi / 2)) < error
    assert pole < 1e-12


@pytest.mark.parametrize(
    ("order", "maxh", "error"), [(2, 0.15, 1.8e-3), (2, 0.075, 4e-4), (3, 0.15, 3e-4)]
)
def test_taut_cloth(octant, order, maxh, error):
    """With a metric of a higher order than ψ, or with more points in its rules, it is no better."""
    result = solved(octant, Net(ks=1.0), [Elongation()], order=order, maxh=maxh)
    assert result.converged
    assert result.normalized_energy == pytest.approx(0.1842, abs=error)
