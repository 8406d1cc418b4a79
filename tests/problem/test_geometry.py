"""Chart geometry by symbolic differentiation against closed forms; parameter domains."""

import ngsolve as ngs
import numpy as np
import pytest

import ngcloth
from ngcloth import Disk, Rectangle, Surface


def skewed(t1, t2):
    """A chart that is neither conformal nor orthogonal."""
    return t1 + 0.3 * t2 * t2, 0.8 * t2 + 0.1 * ngs.sin(t1), ngs.exp(0.4 * t1 * t2) + 0.2 * t1


def values(surface, name, points):
    return surface.evaluate(getattr(surface, name), points)


@pytest.mark.parametrize("portion", [0.2, 0.5, 0.85])
def test_sphere(portion):
    """Stereographic: a = 4r²/(1 + r²|θ|²)² I, n points outward, b = −a on the unit sphere."""
    surface = ngcloth.scenes.sphere(portion).surface
    points = surface.domain.sample(9)
    square = portion / (1 - portion)
    factor = 4 * square / (1 + square * (points**2).sum(axis=1)) ** 2
    metric = values(surface, "metric", points)
    assert np.abs(metric - factor[:, None, None] * np.eye(2)).max() < 1e-13 * factor.max()
    position = values(surface, "position", points)
    assert np.abs(np.linalg.norm(position, axis=1) - 1).max() < 1e-14
    assert np.abs(values(surface, "normal", points) - position).max() < 1e-13
    assert np.abs(values(surface, "curvature", points) + metric).max() < 1e-12 * factor.max()
    # Archimedes: the height of the rim above the south pole is the portion.
    rim = values(surface, "position", surface.domain.rim(7))
    assert (1 + rim[:, 2]) / 2 == pytest.approx(portion, abs=1e-14)


def test_hemicatenoid():
    """a = cosh² θ2 I and b = diag(−1, 1): minimal, convex along θ1."""
    surface = ngcloth.scenes.hemicatenoid().surface
    points = surface.domain.sample(9)
    factor = np.cosh(points[:, 1]) ** 2
    assert values(surface, "metric", points) == pytest.approx(
        factor[:, None, None] * np.eye(2), abs=1e-13
    )
    assert values(surface, "curvature", points) == pytest.approx(
        np.broadcast_to(np.diag([-1.0, 1.0]), (len(points), 2, 2)), abs=1e-13
    )


def test_side_turns_normal_and_curvature():
    up, down = (Surface(skewed, Disk(0.7), side=side) for side in (1, -1))
    points = up.domain.sample(7)
    for name in ("normal", "curvature"):
        one, other = values(up, name, points), values(down, name, points)
        assert np.abs(one).max() > 0.1
        assert np.abs(one + other).max() < 1e-15
    assert np.array_equal(values(up, "metric", points), values(down, "metric", points))


@pytest.fixture(scope="module")
def chart_differences():
    """A skewed surface, points of it, and ∂φ, ∂²φ there by central differences."""
    surface, h = Surface(skewed, Disk(0.7)), 1e-4
    points, steps = surface.domain.sample(7), h * np.eye(2)

    def phi(theta):
        return values(surface, "position", theta)

    first = [(phi(points + s) - phi(points - s)) / (2 * h) for s in steps]
    second = [
        [
            (phi(points + s + t) - phi(points + s - t) - phi(points - s + t) + phi(points - s - t))
            / (4 * h * h)
            for t in steps
        ]
        for s in steps
    ]
    return surface, points, np.stack(first, 1), np.moveaxis(np.array(second), 2, 0)


def test_metric_and_curvature_are_those_of_the_chart(chart_differences):
    surface, points, first, second = chart_differences
    metric = values(surface, "metric", points)
    assert np.abs(metric[:, 0, 1]).max() > 0.1 and np.ptp(metric[:, 0, 0]) > 0.1
    assert np.abs(metric - np.einsum("nic,njc->nij", first, first)).max() < 1e-7
    normal = np.cross(first[:, 0], first[:, 1])
    normal /= np.linalg.norm(normal, axis=1)[:, None]
    assert np.abs(values(surface, "normal", points) - normal).max() < 1e-7
    curvature = np.einsum("nijc,nc->nij", second, normal)
    assert np.abs(values(surface, "curvature", points) - curvature).max() < 1e-6


def test_gauss_equation(chart_differences):
    """det b = R_1212(a): the curvature seen in space is the one felt in the metric."""
    surface, points, *_ = chart_differences
    a = surface.metric
    da = a.Diff(ngs.x), a.Diff(ngs.y)

    def at(expression):
        return surface.evaluate(expression, points)

    first = np.stack([at(d) for d in da], axis=1)  # ∂k a_ij
    # Christoffel symbols of the first kind, Γ_{k,ij} = ½ (∂i a_jk + ∂j a_ik − ∂k a_ij)
    symbols = (first.transpose(0, 3, 1, 2) + first.transpose(0, 3, 2, 1) - first) / 2
    inverse = np.linalg.inv(at(a))
    second = (
        2 * at(da[0].Diff(ngs.y))[:, 0, 1]
        - at(da[1].Diff(ngs.y))[:, 0, 0]
        - at(da[0].Diff(ngs.x))[:, 1, 1]
    ) / 2
    mixed, one, two = symbols[:, :, 0, 1], symbols[:, :, 0, 0], symbols[:, :, 1, 1]
    product = [np.einsum("ni,nij,nj->n", p, inverse, q) for p, q in ((mixed, mixed), (one, two))]
    riemann = second + product[0] - product[1]
    determinant = np.linalg.det(values(surface, "curvature", points))
    assert np.ptp(determinant) > 0.05
    assert np.abs(determinant - riemann).max() < 1e-12


def test_evaluate_keeps_shapes():
    surface = Surface(skewed, Disk(0.7))
    assert surface.evaluate(surface.metric, [0.1, 0.2]).shape == (2, 2)
    assert surface.evaluate(surface.normal, np.zeros((4, 5, 2))).shape == (4, 5, 3)
    assert surface.evaluate(ngs.x - ngs.y, [[0.5, 0.2]]) == pytest.approx([0.3])


# Heights on a grid -----------------------------------------------------------------------------


def cap(x, y):
    """A height without any symmetry, in NGSolve's functions or NumPy's."""
    functions = np if isinstance(x, np.ndarray) else ngs
    return 0.5 * functions.cos(1.2 * x + 0.3) * functions.exp(0.4 * y)


def gridded(n, domain=None):
    x, y = np.linspace(-1.1, 1.1, n), np.linspace(-1.0, 1.2, n + 2)
    return Surface.from_heights(x, y, cap(x[:, None], y), domain)


def disk_area(surface):
    """Of the surface over the unit disk, by Gauss points on rays that are equally spaced."""
    nodes, weights = np.polynomial.legendre.leggauss(100)
    radius, turn = (nodes[:, None] + 1) / 2, 2 * np.pi * np.arange(200) / 200
    theta = np.stack([radius * np.cos(turn), radius * np.sin(turn)], axis=-1)
    density = np.sqrt(np.linalg.det(values(surface, "metric", theta)))
    return np.pi * float((weights / 2 * (2 * radius * density).mean(axis=1)[:, None].T).sum())


def test_heights_make_the_surface_that_they_are_of():
    """Area and curvature of the surface itself, by powers of the grid's spacing."""
    exact = Surface(lambda x, y: (x, y, cap(x, y)), Disk())
    points = exact.domain.sample(40)
    errors = []
    for n in (21, 41):
        surface = gridded(n, Disk())
        curvature = values(surface, "curvature", points) - values(exact, "curvature", points)
        errors.append([abs(disk_area(surface) - disk_area(exact)), np.abs(curvature).max()])
    assert errors[1][0] < 1e-9 and errors[1][1] < 1e-6
    assert errors[1][1] < errors[0][1] / 2**3.5
    metric = values(surface, "metric", points)
    assert metric == pytest.approx(values(exact, "metric", points), abs=1e-7)


def test_heights_are_met_and_differentiated_exactly():
    """The spline of a polynomial of degree five is that polynomial, up to third derivatives."""
    x, y = np.linspace(-2, 1, 8), np.linspace(0, 3, 7)
    surface = Surface.from_heights(x, y, np.add.outer(x**5 - x, 0 * y) + np.multiply.outer(x, y**3))
    points = surface.domain.sample(13)
    u, v = points.T
    z = surface.position[2]
    for expression, expected in (
        (z, u**5 - u + u * v**3),
        (z.Diff(ngs.x), 5 * u**4 - 1 + v**3),
        (z.Diff(ngs.x).Diff(ngs.y), 3 * v**2),
        (z.Diff(ngs.x).Diff(ngs.x).Diff(ngs.x), 60 * u**2),
        (surface.chart(ngs.x / 2, ngs.y / 2 + 1)[2], u**5 / 32 - u / 2 + u / 2 * (v / 2 + 1) ** 3),
    ):
        assert surface.evaluate(expression, points) == pytest.approx(expected, abs=1e-9)
    assert surface.domain == Rectangle((-2, 1), (0, 3))


def test_a_mould_of_heights_is_not_a_flat_disk():
    """As a table of NGSolve's it was: area π. It is what its chart is, and the patch fits it."""
    x = np.linspace(-1, 1, 41)
    dome = Surface.from_heights(x, x, -0.25 * x[:, None] ** 2 - 0.6 * x**2, Disk())
    chart = Surface(lambda x, y: (x, y, -0.25 * x * x - 0.6 * y * y), Disk())
    assert disk_area(dome) == pytest.approx(3.721395, abs=1e-6)
    one, other = (
        ngcloth.solve(ngcloth.Scene(s, ngcloth.Net(ks=1.0), symmetric=True), maxh=0.3)
        for s in (dome, chart)
    )
    assert one.converged and one.energy == pytest.approx(other.energy, rel=1e-6)
    assert one.area > 3.6 and one.area == pytest.approx(other.area, rel=1e-8)


# Domains ---------------------------------------------------------------------------------------

DOMAINS = [
    Disk(1.0),
    Disk(2.5),
    Rectangle((0.0, np.pi), (-1.0, 1.0)),
    Rectangle((-3, -2), (1, 5)),
    Rectangle((0, 100), (0, 1)),
]


def shoelace(curve):
    x, y = curve.T
    return 0.5 * float(x @ np.roll(y, -1) - y @ np.roll(x, -1))


def area(domain):
    (low1, high1), (low2, high2) = domain.box
    whole = (high1 - low1) * (high2 - low2)
    return np.pi / 4 * whole if isinstance(domain, Disk) else whole


@pytest.mark.parametrize("domain", DOMAINS, ids=str)
@pytest.mark.parametrize("n", [8, 33, 400])
def test_rim(domain, n):
    """Starts on the axis at the largest θ1, runs counter-clockwise, encloses the domain."""
    rim = domain.rim(n)
    assert rim.shape == (n, 2)
    assert rim[0] == pytest.approx([domain.box[0][1], domain.centre[1]], abs=1e-15)
    assert rim[1, 1] > rim[0, 1]
    assert domain.contains(rim).all()
    assert not domain.contains(rim + 1e-3 * (rim - domain.centre)).any()
    assert len(np.unique(rim.round(12), axis=0)) == n
    if isinstance(domain, Rectangle):  # no corner is cut off
        assert shoelace(rim) == pytest.approx(area(domain), rel=1e-12)
    else:
        polygon = np.sin(2 * np.pi / n) * n / 2 * domain.radius**2
        assert shoelace(rim) == pytest.approx(polygon, rel=1e-13)


@pytest.mark.parametrize("domain", DOMAINS, ids=str)
def test_contains(domain):
    (low1, high1), (low2, high2) = domain.box
    inside = domain.centre + [0.4 * (high1 - low1), 0.25 * (high2 - low2)]
    assert domain.contains(inside)
    assert domain.contains(domain.centre)
    corner = np.array([high1, high2])
    assert bool(domain.contains(corner)) == isinstance(domain, Rectangle)
    beyond = np.array([[high1 + 0.01, domain.centre[1]], [domain.centre[0], low2 - 0.01]])
    assert domain.contains(beyond).tolist() == [False, False]
    assert not domain.contains(np.array([np.nan, domain.centre[1]]))
    assert domain.contains(np.zeros((3, 4, 2)) + domain.centre).shape == (3, 4)


@pytest.mark.parametrize("domain", DOMAINS, ids=str)
def test_faces_and_their_edges(domain):
    whole, quarter = domain.face(), domain.face(symmetric=True)
    for face, part in ((whole, 1), (quarter, 4)):
        assert sum(f.mass for f in face.faces) == pytest.approx(area(domain) / part, rel=1e-9)
    assert {edge.name for edge in whole.edges} == {"rim"}
    on_mirror = {"mirror1": 0, "mirror2": 1}
    assert {edge.name for edge in quarter.edges} == {"rim", *on_mirror}
    for edge in quarter.edges:
        middle = np.array([edge.center.x, edge.center.y])
        for name, axis in on_mirror.items():
            at_centre = abs(middle[axis] - domain.centre[axis]) < 1e-9
            assert at_centre == (edge.name == name)
        assert np.all(middle > domain.centre - 1e-9)


def test_diameter_and_centre():
    assert Disk(2.5).diameter == pytest.approx(5.0)
    rectangle = Rectangle((0, 6), (-1, 7))
    assert rectangle.diameter == pytest.approx(10 / np.sqrt(2))
    assert rectangle.centre.tolist() == [3, 3]


@pytest.mark.parametrize("domain", DOMAINS, ids=str)
def test_sample_covers_the_closed_domain(domain):
    points = domain.sample(11)
    assert domain.contains(points).all()
    low, high = np.array(domain.box).T
    assert points.min(axis=0) == pytest.approx(low, abs=1e-12)
    assert points.max(axis=0) == pytest.approx(high, abs=1e-12)
    assert np.abs(points - domain.centre).sum(axis=1).min() < 1e-12
