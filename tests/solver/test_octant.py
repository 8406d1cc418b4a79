"""An eighth of the sphere from STEP, between two mirror lines: the numbers of a quarter dome."""

import ngsolve as ngs
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
    scene = Scene(octant, fabric, limits)
    object.__setattr__(scene, "symmetric", True)  # the patch is that of the quarter in the file
    return solve(scene, **settings)


def tips(result):
    """Distances of the two corners on the equator from the pole in the flat patch, π/2 of a net."""
    mesh, psi = result.state.space.mesh, ngs.CF(result.state.components[:2])
    rim = [mesh(*vertex.point) for vertex in mesh.vertices]
    places = np.array([result.sheet.position(point) for point in rim])
    flat = np.array([psi(point) for point in rim])
    return [
        np.linalg.norm(flat[np.linalg.norm(places - end, axis=1).argmin()]) for end in np.eye(3)
    ]


@pytest.mark.parametrize(
    ("order", "maxh", "energy", "error"),
    [(2, 0.075, 1e-6, 5e-4), (4, 0.075, 1e-12, 5e-7), (6, 0.15, 1e-14, 2e-8)],
)
def test_chebyshev_net(octant, order, maxh, energy, error):
    result = solved(octant, Net(), [], maxh=maxh, order=order)
    assert result.converged and result.newton_iterations <= 15
    assert result.normalized_energy < energy
    first, second, pole = tips(result)
    assert max(abs(first - np.pi / 2), abs(second - np.pi / 2)) < error
    assert pole < 1e-12


@pytest.mark.parametrize(("maxh", "error"), [(0.15, 1.5e-3), (0.075, 3e-4)])
def test_taut_cloth(octant, maxh, error):
    result = solved(octant, Net(ks=1.0), [Elongation()], maxh=maxh)
    assert result.converged
    assert result.normalized_energy == pytest.approx(0.1842, abs=error)
