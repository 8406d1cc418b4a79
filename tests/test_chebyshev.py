"""The exact Chebyshev net against closed forms, conservation laws and the geometry of surfaces."""

import ngsolve as ngs
import numpy as np
import pytest

from ngcloth.chebyshev import (
    SPHERE_COLLAPSE,
    ChebyshevNet,
    sphere_angle,
    sphere_singular_portion,
)
from ngcloth.errors import InputError
from ngcloth.problem.domain import Disk, Rectangle
from ngcloth.problem.surface import Surface


def sphere(portion):
    r2 = portion / (1 - portion)

    def chart(t1, t2):
        square = r2 * (t1 * t1 + t2 * t2)
        return tuple(c / (1 + square) for c in (2 * r2**0.5 * t1, 2 * r2**0.5 * t2, square - 1))

    return Surface(chart, Disk(1))


SURFACES = {
    "hemisphere": lambda: sphere(0.5),
    "hemicatenoid": lambda: Surface(
        lambda t1, t2: (ngs.cosh(t2) * ngs.cos(t1), ngs.cosh(t2) * ngs.sin(t1), t2),
        Rectangle((0, np.pi), (-1, 1)),
    ),
    "ellipsoid": lambda: Surface(
        lambda t1, t2: (t1, 0.8 * t2, ngs.sqrt(1 - t1 * t1 / 3 - t2 * t2 / 4)), Disk(0.8)
    ),
    "saddle": lambda: Surface(
        lambda t1, t2: (t1, t2, 0.5 * t1 * t1 - 0.3 * t2 * t2 + 0.2 * t1), Disk(1)
    ),
}


@pytest.fixture(scope="module")
def nets():
    return {name: ChebyshevNet.symmetric(surface()) for name, surface in SURFACES.items()}


def grid(net, n):
    return np.meshgrid(*(np.linspace(0, end, n) for end in net.extent), indexing="ij")


def test_sphere_angle_starts_as_its_series():
    z = np.array([1e-2, 3e-2, 5e-2])
    expected = np.pi / 2 - z + z**3 / 18 - 0.0038888888888889 * z**5
    assert np.abs(sphere_angle(z) - expected).max() < 1e-12


def test_sphere_angle_solves_its_equation():
    """z g'' + g' + sin g = 0, integrated: z g'(z) = −∫₀ᶻ sin g."""
    x, weights = np.polynomial.legendre.leggauss(60)
    for z in (0.5, 1.2, 1.9):
        t = z * (1 + x) / 2
        integral = z / 2 * weights @ np.sin(sphere_angle(t))
        h = 1e-3
        stencil = sphere_angle(z + h * np.array([-2, -1, 1, 2])) @ [1, -8, 8, -1] / (12 * h)
        assert z * stencil == pytest.approx(-integral, abs=1e-11)


def test_sphere_constants():
    assert SPHERE_COLLAPSE == pytest.approx(1.861591677, abs=1e-9)
    assert abs(sphere_angle(SPHERE_COLLAPSE)) < 1e-14
    assert sphere_singular_portion() == pytest.approx(0.842359785, abs=1e-9)
    with pytest.raises(InputError, match="z = "):
        sphere_angle(2.1)


@pytest.mark.parametrize("portion, blocks", [(0.5, 6), (0.7, 8)])
def test_sphere_net_has_the_exact_angle(portion, blocks):
    net = ChebyshevNet.symmetric(sphere(portion), blocks=blocks)
    assert net.extent == pytest.approx(2 * np.arctan(np.sqrt(portion / (1 - portion))), abs=1e-13)
    u, v = grid(net, 61)
    valid = net.valid(u, v)
    assert not np.any(valid & (u * v > SPHERE_COLLAPSE))
    assert np.mean(valid[u * v < SPHERE_COLLAPSE]) > 0.9
    exact = np.cos(sphere_angle((u * v)[valid]))
    assert np.abs(net.shear(u, v)[valid] - exact).max() < 1e-12


def test_singular_portion_is_where_the_net_collapses():
    """The collapse curve of the net is nearest to the pole on the diagonal, at the portion p*."""
    net = ChebyshevNet.symmetric(sphere(0.8), extent=(2.0, 2.0), blocks=8, degree=16)
    u = np.array([1.0, 1.2, 1.3, np.sqrt(SPHERE_COLLAPSE), 1.4, 1.5])
    radius = np.linalg.norm(net.theta(u, (SPHERE_COLLAPSE - 1e-9) / u), axis=-1)
    assert radius.argmin() == 3
    portion = 4 * radius**2 / (1 + 4 * radius**2)  # r² = p/(1 − p) = 4
    assert portion[3] == pytest.approx(sphere_singular_portion(), abs=1e-8)


def test_hemisphere_outline(nets):
    net = nets["hemisphere"]
    tip1, corner, tip2 = net.material([[1, 0], [0.5**0.5, 0.5**0.5], [0, 1]])
    assert tip1 == pytest.approx([np.pi / 2, 0], abs=1e-12)
    assert tip2 == pytest.approx([0, np.pi / 2], abs=1e-12)
    assert corner == pytest.approx([0.980506754806] * 2, abs=1e-11)
    assert net.shear(*corner) == pytest.approx(0.792557400544, abs=1e-11)

    quarter = net.material(net.surface.domain.rim(400)[:101])
    assert np.isfinite(quarter).all()
    assert np.abs(quarter - quarter[::-1, ::-1]).max() < 1e-11  # warp and weft swapped
    assert np.all(np.diff(quarter[:, 0]) < 0)


@pytest.mark.parametrize("name", SURFACES)
def test_threads_keep_their_length(nets, name):
    """a(θ_u, θ_u) = a(θ_v, θ_v) = 1, by differences of θ itself and by the net's own tangents."""
    net, h = nets[name], 2e-3
    assert net.stretch_error < 2e-12
    u, v = (x[1:-1, 1:-1].ravel() for x in grid(net, 12))
    inside = net.valid(u + 4 * h, v + 4 * h)
    u, v = u[inside], v[inside]
    shifts = h * np.array([-4, -3, -2, -1, 1, 2, 3, 4])[:, None]
    weights = np.array([1 / 280, -4 / 105, 1 / 5, -4 / 5, 4 / 5, -1 / 5, 4 / 105, -1 / 280]) / h
    metric = net.surface.evaluate(net.surface.metric, net.theta(u, v))
    along = [
        np.tensordot(weights, net.theta(*moved), 1) for moved in ((u + shifts, v), (u, v + shifts))
    ]
    for tangent in along:
        length = np.einsum("ni,nij,nj->n", tangent, metric, tangent)
        assert np.abs(length - 1).max() < 1e-11
    shear = np.einsum("ni,nij,nj->n", along[0], metric, along[1])
    assert np.abs(net.shear(u, v) - shear).max() < 1e-11


@pytest.mark.parametrize("name", SURFACES)
def test_shear_obeys_the_gauss_equation(nets, name):
    """ω_uv = −K sin ω, integrated over [0, u] × [0, v]: the angle defect is the total curvature."""
    net = nets[name]
    surface = net.surface
    x, weights = np.polynomial.legendre.leggauss(24)
    u, v = 0.6 * net.extent
    points = net.theta(*np.meshgrid(u * (1 + x) / 2, v * (1 + x) / 2, indexing="ij"))
    determinants = [
        np.linalg.det(surface.evaluate(form, points))
        for form in (surface.curvature, surface.metric)
    ]
    shear = net.shear(*np.meshgrid(u * (1 + x) / 2, v * (1 + x) / 2, indexing="ij"))
    density = determinants[0] / determinants[1] * np.sqrt(1 - shear**2)
    total = u * v / 4 * weights @ density @ weights
    corners = np.arccos(net.shear([0, u, 0, u], [0, 0, v, v]))
    assert corners @ [1, -1, -1, 1] == pytest.approx(-total, abs=1e-11)


def test_hemicatenoid_threads(nets):
    net = nets["hemicatenoid"]
    assert net.extent == pytest.approx([np.pi / 2, np.sinh(1)], abs=1e-13)
    s = np.linspace(0, 1, 9)
    warp, weft = net.theta(np.pi / 2 * s, 0), net.theta(0, np.sinh(1) * s)
    assert np.abs(warp - np.stack([np.pi / 2 * (1 + s), 0 * s], -1)).max() < 1e-13
    exact = np.stack([0 * s + np.pi / 2, np.arcsinh(np.sinh(1) * s)], -1)
    assert np.abs(weft - exact).max() < 1e-13
    # The corner of the domain lies beyond the characteristic rectangle of the two threads.
    assert np.isnan(net.material([np.pi, 1.0])).all()


@pytest.mark.parametrize("name", SURFACES)
def test_material_inverts_theta(nets, name):
    net = nets[name]
    u, v = grid(net, 17)
    theta = net.theta(u, v)
    inside = np.isfinite(theta[..., 0]) & net.surface.domain.contains(theta)
    found = net.material(theta)
    assert found.shape == theta.shape
    assert np.abs(found - np.stack([u, v], -1))[inside].max() < 1e-11


def test_developable_surfaces_are_laid_flat():
    """Skew threads on a cylinder: a translation net of constant angle, found in any quadrant."""
    cylinder = Surface(lambda t1, t2: (2 * ngs.cos(t1), 2 * ngs.sin(t1), t2), Disk(1))
    warp, weft = np.array([0.4, 0.6]), np.array([-0.3, 0.8])  # the metric is diag(4, 1)
    for extent in ((0.8, 0.7), (-0.8, 0.7), (-0.8, -0.7)):
        net = ChebyshevNet(
            cylinder, lambda u: u[:, None] * warp, lambda v: v[:, None] * weft, extent, blocks=2
        )
        u, v = grid(net, 9)
        exact = u[..., None] * warp + v[..., None] * weft
        assert np.abs(net.theta(u, v) - exact).max() < 1e-13
        assert np.abs(net.shear(u, v)).max() < 1e-12
        assert np.abs(net.material(exact) - np.stack([u, v], -1)).max() < 1e-12


def test_quadrants_mirror_each_other(nets):
    net = nets["ellipsoid"]
    other = ChebyshevNet.symmetric(net.surface, extent=net.extent * [-1, 1])
    u, v = grid(net, 7)
    assert np.abs(other.theta(-u, v) - net.theta(u, v) * [-1, 1]).max() < 1e-12
    assert np.abs(other.shear(-u, v) + net.shear(u, v)).max() < 1e-12


def test_beyond_validity_is_nan(nets):
    net = nets["hemisphere"]
    u, v = np.array([1.5, 1.37, 1.6, -0.1, np.nan]), np.array([1.5, 1.37, 0.1, 0.1, 0.1])
    assert not net.valid(u, v).any()
    assert np.isnan(net.theta(u, v)).all() and np.isnan(net.shear(u, v)).all()
    assert np.isnan(net.material([[-0.5, 0.5], [np.nan, 0.0]])).all()
    assert net.material(np.empty((0, 2))).shape == (0, 2)
    assert net.valid(0.3, 0.4).shape == () and net.theta(0.3, [[0.4, 0.5]]).shape == (1, 2, 2)


def test_threads_may_end_or_leave():
    """A thread that runs out of the surface spoils only what depends on it."""
    plane = Surface(lambda t1, t2: (t1, t2, 0 * t1), Disk(1))
    net = ChebyshevNet.symmetric(plane, extent=(4.0, 1.0), blocks=8)
    assert net.valid([1.9, 0.1], [0.9, 0.9]).all() and not net.valid(2.1, 0.1)


def straight(direction, start=(0.0, 0.0)):
    return lambda s: np.array(start) + s[:, None] * np.array(direction, dtype=float)


@pytest.mark.parametrize(
    "argument, change",
    [
        ("warp", {"warp": straight((2, 0))}),
        ("warp", {"warp": lambda u: u}),
        ("warp", {"warp": straight((1, 0), (5, 0))}),
        ("weft", {"weft": straight((0, 1), (0.1, 0))}),
        ("weft", {"weft": straight((-1, 0))}),
        ("weft", {"weft": lambda v: np.full((len(v), 2), np.nan)}),
        ("extent", {"extent": (1.0, 0.0)}),
        ("extent", {"extent": 1.0}),
        ("extent", {"extent": (1.0, np.inf)}),
        ("blocks", {"blocks": 0}),
        ("degree", {"degree": 1}),
    ],
)
def test_input_errors_name_the_argument(argument, change):
    plane = Surface(lambda t1, t2: (t1, t2, 0 * t1), Disk(1))
    given = {"warp": straight((1, 0)), "weft": straight((0, 1)), "extent": (1.0, 1.0)}
    with pytest.raises(InputError) as error:
        ChebyshevNet(plane, **given | change)
    assert error.value.argument == argument
