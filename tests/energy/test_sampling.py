"""Sampling points, inside and on the rim, against NGSolve's own values and integrals."""

import ngsolve as ngs
import numpy as np
import pytest
from discretising import TAYLOR, discretised

from ngcloth.energy.sampling import RimPoints, Sampling


@pytest.fixture(params=[(name, order) for name in TAYLOR for order in (1, 2, 4)], ids=str)
def displaced(request):
    name, order = request.param
    return discretised(TAYLOR[name](), order=order)


def test_sampling(displaced):
    """Samples are NGSolve's own derivatives, the transposed map is the transpose."""
    function, points = displaced.state.components[0], displaced.points
    sampling = Sampling(function.space, points)
    (samples,) = sampling.at_points([function.vec.FV().NumPy()])
    assert samples == pytest.approx(points.sample(ngs.grad(function)), abs=1e-12)
    probe = points.field()
    probe.Interpolate(ngs.grad(function)[1])
    assert samples[1] == pytest.approx(probe.vec.FV().NumPy(), abs=1e-12)
    random = np.random.default_rng(1)
    values, loads = (
        random.normal(size=(2, function.space.ndof)),
        random.normal(size=(2, *samples.shape)),
    )
    there = sampling.at_points(values) * loads
    assert (sampling.transposed(loads) * values).sum() == pytest.approx(there.sum())


def test_sampling_in_the_flat_plane(displaced):
    """ψ itself has the identity for its gradient in the flat plane."""
    cloth = displaced._here
    identity = cloth.flat().at_points(cloth.unknowns.reshape(2, -1))
    expected = np.broadcast_to(np.eye(2)[:, :, None], identity.shape)
    assert identity == pytest.approx(expected, abs=1e-10)


def test_points_on_the_rim(displaced):
    """Derivatives are those of NGSolve in the triangles there, weights are lengths."""
    function, mesh = displaced.state.components[0], displaced.fes.mesh
    points, along = RimPoints(mesh, 6), mesh.Boundaries("rim")
    (samples,) = Sampling(function.space, points).at_points([function.vec.FV().NumPy()])
    expected = points.sample(ngs.BoundaryFromVolumeCF(ngs.grad(function)))
    assert samples == pytest.approx(expected, abs=1e-12)
    (x,) = points.sample(ngs.x)
    assert points.weights @ x**2 == pytest.approx(
        ngs.Integrate(ngs.x**2 * ngs.ds(definedon=along, bonus_intorder=6), mesh), rel=1e-6
    )


def test_fields_on_edges(displaced):
    """They have the values that were set at the points on the rim, and none elsewhere."""
    points, mesh = displaced.rim_points, displaced.fes.mesh
    field, set_values = points.on_edges()
    values = np.random.default_rng(1).normal(size=len(points))
    set_values(values)
    assert points.sample(field)[0] == pytest.approx(values, abs=1e-12)
    square = ngs.Integrate(field**2 * ngs.dx(element_boundary=True), mesh)
    rim = mesh.Boundaries("rim")
    assert square == pytest.approx(ngs.Integrate(field**2 * ngs.ds(definedon=rim), mesh), rel=1e-6)
