"""Solved Chebyshev scenes against the exact net, symmetries and scalings; what a Result offers."""

import functools

import ngsolve as ngs
import numpy as np
import pytest

import ngcloth
from ngcloth import Disk, InputError, Net, Reason, Rectangle, Scene, SolveError, Surface, solve
from ngcloth.chebyshev import ChebyshevNet

DIAGONAL = 0.5**0.5
CORNER, CORNER_SHEAR = 0.980506754806, 0.792557400544


@pytest.fixture(scope="module")
def hemisphere():
    return ngcloth.solve(ngcloth.scenes.hemisphere())


@pytest.fixture(scope="module")
def exact_outline():
    """Rim points of a quarter and where the exact net puts them."""
    surface = ngcloth.scenes.hemisphere().surface
    rim = surface.domain.rim(400)[:101]
    return rim, ChebyshevNet.symmetric(surface).material(rim)


def outline_error(result, exact_outline):
    rim, exact = exact_outline
    return np.linalg.norm(result.psi(*rim.T) - exact, axis=1).max()


# The hemisphere ----------------------------------------------------------------------------------


def test_hemisphere_by_default(hemisphere, exact_outline):
    assert hemisphere.converged and hemisphere.reason is Reason.CONVERGED
    assert hemisphere.normalized_energy < 1e-7
    assert hemisphere.newton_iterations <= 15
    assert outline_error(hemisphere, exact_outline) < 1e-4
    for signs in ((1, 0), (0, 1), (-1, 0), (0, -1)):
        tip = hemisphere.psi(*signs)
        assert tip == pytest.approx(np.pi / 2 * np.array(signs), abs=1e-4)
    for s1, s2 in ((1, 1), (-1, 1), (-1, -1), (1, -1)):
        corner = hemisphere.psi(s1 * DIAGONAL, s2 * DIAGONAL)
        assert corner == pytest.approx([s1 * CORNER, s2 * CORNER], abs=1e-5)
        shear = hemisphere.field("shear", s1 * DIAGONAL, s2 * DIAGONAL)
        assert shear == pytest.approx(s1 * s2 * CORNER_SHEAR, abs=1e-3)
    for name in ("stretch1", "stretch2"):
        assert hemisphere.extrema[name] == pytest.approx((1, 1), abs=2e-3)
    assert hemisphere.extrema["shear"] == pytest.approx((-CORNER_SHEAR, CORNER_SHEAR), abs=1e-3)


@pytest.mark.parametrize(
    "order, maxh, energy, outline, shear",
    [
        (6, 0.3, 1e-9, 1e-5, 1e-4),
        (8, 0.3, 1e-12, 5e-7, 2e-5),
        (8, 0.25, 1e-14, 5e-8, 2e-6),
        (8, 0.2, 1e-15, 1e-8, 1e-6),
    ],
)
def test_hemisphere_at_high_order(order, maxh, energy, outline, shear, exact_outline):
    result = ngcloth.solve(ngcloth.scenes.hemisphere(), maxh=maxh, order=order)
    assert result.converged
    assert result.normalized_energy < energy
    assert outline_error(result, exact_outline) < outline
    assert result.psi(DIAGONAL, DIAGONAL) == pytest.approx([CORNER, CORNER], abs=outline)
    assert result.field("shear", DIAGONAL, DIAGONAL) == pytest.approx(CORNER_SHEAR, abs=shear)
    assert result.psi(1, 0) == pytest.approx([np.pi / 2, 0], abs=outline)


@pytest.mark.parametrize(
    "order, sizes",
    [(1, (0.1, 0.05, 0.035)), (2, (0.2, 0.1, 0.05)), (3, (0.2, 0.1, 0.07)), (4, (0.2, 0.1, 0.08))],
)
def test_energy_falls_with_the_order(order, sizes):
    """E ~ h^(2p): it is the square of what ∇ψ misses. h counts elements, h = 1/√ne."""
    results = [
        ngcloth.solve(ngcloth.scenes.hemisphere(), maxh=h, order=order, tolerance=1e-9)
        for h in sizes
    ]
    size = [-0.5 * np.log(result.state.space.mesh.ne) for result in results]
    energy = np.log([result.normalized_energy for result in results])
    rate = np.polyfit(size, energy, 1)[0]
    assert rate == pytest.approx(2 * order, abs=0.5)


# The hemicatenoid --------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "settings, energy, inner, whole",
    [
        ({}, 1e-5, 3e-4, 2e-3),
        ({"order": 6, "maxh": 0.15}, 1e-9, 1e-6, 3e-5),
        pytest.param({"order": 6}, 1e-12, 1e-8, 1e-6, marks=pytest.mark.slow),
    ],
    ids=["default", "order 6, coarse", "order 6"],
)
def test_hemicatenoid(settings, energy, inner, whole):
    """In the rectangle that the two threads on the axes determine, the net is the exact one."""
    scene = ngcloth.scenes.hemicatenoid()
    result = ngcloth.solve(scene, **settings)
    assert result.converged
    assert result.normalized_energy < energy
    assert result.newton_iterations < 100
    assert str(ngcloth.verify(result)).startswith("certified")
    net = ChebyshevNet.symmetric(scene.surface)
    centre = scene.surface.domain.centre
    for signs in ((1, 1), (1, -1), (-1, 1), (-1, -1)):
        # Most points where the errors are, near the rectangle's corner.
        part = np.concatenate([np.linspace(0, 0.9, 10), np.linspace(0.91, 1, 25)])
        exact = np.stack(np.meshgrid(*np.outer(net.extent, part)), axis=-1)
        theta = centre + np.array(signs) * (net.theta(*np.moveaxis(exact, -1, 0)) - centre)
        error = np.abs(result.psi(theta[..., 0], theta[..., 1]) - signs * exact)
        assert error[:7, :7].max() < inner
        assert error.max() < whole


# Portions of the sphere --------------------------------------------------------------------------


@functools.cache
def sphere_portion(portion):
    return ngcloth.solve(ngcloth.scenes.sphere(portion))


@pytest.mark.parametrize("portion, tolerance", [(0.5, 5e-4), (0.7, 5e-4), (0.8, 2e-3)])
def test_shear_of_sphere_portions(portion, tolerance):
    result = sphere_portion(portion)
    assert result.converged
    net = ChebyshevNet.symmetric(result.scene.surface, blocks=10)
    exact = net.shear(*net.material([DIAGONAL, DIAGONAL]))
    assert result.extrema["shear"][1] == pytest.approx(exact, abs=tolerance)
    assert result.field("shear", DIAGONAL, DIAGONAL) == pytest.approx(exact, abs=tolerance)
    tip = 2 * np.arctan(np.sqrt(portion / (1 - portion)))
    assert result.psi(1, 0) == pytest.approx([tip, 0], abs=2e-3)
    assert result.normalized_energy < 5e-6


@pytest.mark.parametrize("portion", [0.5, 0.7, 0.8, 0.83, 0.85, 0.9])
def test_singular_portions_are_named(portion):
    """Past p* = 0.8424 no Chebyshev net covers the portion, and the solve says so."""
    result, singular = sphere_portion(portion), portion > 0.8424
    assert result.reason is (Reason.SINGULAR if singular else Reason.CONVERGED)
    assert result.converged is not singular
    # What is returned is the last good iterate: it has come down, and it is not folded.
    energies = [row.energy for row in result.history]
    assert all(np.diff(energies) < 1e-12) and energies[-1] < 1e-3 * energies[0]
    assert result.extrema["jacobian"][0] > 0
    if singular:
        assert result.extrema["shear"][1] > 0.999


# Developable surfaces ----------------------------------------------------------------------------


def cylinder(t1, t2):
    return 2 * ngs.cos(t1), 2 * ngs.sin(t1), t2


def cone(t1, t2):
    """By its development: r and the angle around the apex (−2, 0), half angle 30° at the apex."""
    radius, angle = ngs.sqrt((t1 + 2) ** 2 + t2**2), 2 * ngs.atan(t2 / (t1 + 2))
    return 0.5 * radius * ngs.cos(angle), 0.5 * radius * ngs.sin(angle), 3**0.5 / 2 * radius


def wavy_start(x, y):
    return 0.6 * x * (1 + 0.2 * y * y), 0.7 * y + 0.1 * y * ngs.sin(x) ** 2


@pytest.mark.parametrize("start", [(0.5, 0.5), wavy_start], ids=["scaled", "wavy"])
@pytest.mark.parametrize("order", [1, 2, 5])
@pytest.mark.parametrize(
    "chart, domain, flat",
    [
        (cylinder, Disk(1), (2, 1)),
        (cylinder, Rectangle((-1, 1), (-0.5, 0.5)), (2, 1)),
        (cone, Disk(1), (1, 1)),
    ],
    ids=["cylinder on a disk", "cylinder on a rectangle", "cone"],
)
def test_developable_surfaces_cost_nothing(chart, domain, flat, order, start):
    scene = Scene(Surface(chart, domain), Net(), start=start, symmetric=True)
    result = ngcloth.solve(scene, maxh=0.4, order=order)
    assert result.converged
    assert result.energy < 1e-24
    points = np.array([[0.3, -0.2], [0.0, 0.4], [-0.6, 0.1]])
    assert result.psi(*points.T) == pytest.approx(points * flat, abs=1e-11)
    assert result.extrema["stretch1"] == pytest.approx((1, 1), abs=1e-11)
    assert np.abs(result.extrema["shear"]).max() < 1e-11


def test_developable_surfaces_cost_nothing_without_symmetry():
    result = ngcloth.solve(Scene(Surface(cylinder, Disk(1)), Net(), start=(0.5, 0.5)), maxh=0.4)
    assert result.converged and result.energy < 1e-24
    assert result.area == pytest.approx(2 * np.pi, rel=1e-3)


# Symmetries and scalings -------------------------------------------------------------------------


def ellipsoid(t1, t2):
    return t1, 0.8 * t2, 0.9 * ngs.sqrt(1 - t1 * t1 / 2 - t2 * t2 / 3)


def ellipsoid_scene(fabric, *, chart=ellipsoid, start=(0.7, 0.6), **options):
    return Scene(Surface(chart, Disk(1)), fabric, start=start, symmetric=True, **options)


POINTS = np.stack(np.meshgrid(np.linspace(-0.7, 0.7, 6), np.linspace(-0.7, 0.7, 7)), axis=-1)


def patch(scene, **settings):
    result = ngcloth.solve(scene, **{"maxh": 0.35, "order": 4, "tolerance": 1e-10} | settings)
    assert result.converged, result.reason
    return result, result.psi(POINTS[..., 0], POINTS[..., 1])


@pytest.fixture(scope="module")
def reference():
    return patch(ellipsoid_scene(Net(kc=(1.0, 2.5), ks=0.4)))


def test_warp_and_weft_are_equals(reference):
    """Chart, stiffnesses and start swapped: the same patch, mirrored on the diagonal."""
    swapped = ellipsoid_scene(
        Net(kc=(2.5, 1.0), ks=0.4),
        chart=lambda t1, t2: ellipsoid(t2, t1),
        start=(0.6, 0.7),
    )
    result, _ = patch(swapped)
    mirrored = result.psi(POINTS[..., 1], POINTS[..., 0])[..., ::-1]
    expected, psi = reference
    assert result.energy == pytest.approx(expected.energy, rel=1e-4)
    assert mirrored == pytest.approx(psi, abs=2e-5)
    assert result.extrema["stretch1"] == pytest.approx(expected.extrema["stretch2"], abs=1e-3)
    assert np.subtract(expected.extrema["stretch1"], expected.extrema["stretch2"]).min() < -1e-2


def test_translation_of_the_start_changes_nothing(reference):
    scene = ellipsoid_scene(
        Net(kc=(1.0, 2.5), ks=0.4), start=lambda x, y: (0.7 * x + 5.0, 0.6 * y - 300.0)
    )
    result, psi = patch(scene)
    assert psi == pytest.approx(reference[1], abs=1e-10)
    assert result.energy == pytest.approx(reference[0].energy, rel=1e-12)


@pytest.mark.parametrize(
    "start", [None, (1.4, 1.3), lambda x, y: (0.6 * x + 0.1 * x * y**2, 0.7 * y)]
)
def test_patch_does_not_depend_on_the_start(reference, start):
    _, psi = patch(ellipsoid_scene(Net(kc=(1.0, 2.5), ks=0.4), start=start))
    assert psi == pytest.approx(reference[1], abs=1e-6)


@pytest.mark.parametrize("ks", [0.0, 0.4])
@pytest.mark.parametrize("factor", [1e-6, 1e6])
def test_only_ratios_of_stiffness_matter(ks, factor):
    one, psi = patch(ellipsoid_scene(Net(kc=1.0, ks=ks)))
    other, same = patch(ellipsoid_scene(Net(kc=factor, ks=factor * ks)))
    assert same == pytest.approx(psi, abs=1e-9)
    assert other.energy == pytest.approx(factor * one.energy, rel=1e-9)
    assert other.normalized_energy == pytest.approx(one.normalized_energy, rel=1e-9)
    assert other.newton_iterations == one.newton_iterations


@pytest.mark.parametrize("ks", [0.0, 0.4])
@pytest.mark.parametrize("factor", [1e-3, 1e3])
@pytest.mark.parametrize("start", [None, (0.7, 0.6)])
def test_patch_scales_with_the_surface(factor, ks, start):
    def scaled(t1, t2):
        return [factor * component for component in ellipsoid(t1, t2)]

    one, psi = patch(ellipsoid_scene(Net(ks=ks), start=start))
    if start:
        start = tuple(factor * s for s in start)
    other, large = patch(ellipsoid_scene(Net(ks=ks), chart=scaled, start=start))
    assert large / factor == pytest.approx(psi, abs=1e-9)
    assert other.energy == pytest.approx(factor**2 * one.energy, rel=1e-7)
    assert other.area == pytest.approx(factor**2 * one.area, rel=1e-9)
    assert other.newton_iterations == one.newton_iterations


def test_hemicatenoid_scales():
    """The tie break is homogeneous: it scales with the rest."""
    results = []
    for factor in (1.0, 1e3):
        scene = ngcloth.scenes.hemicatenoid()
        chart = scene.surface.chart
        surface = Surface(
            lambda t1, t2, factor=factor, chart=chart: [factor * c for c in chart(t1, t2)],
            scene.surface.domain,
        )
        start = (0.5 * factor, 0.5 * factor)
        scene = Scene(surface, Net(), start=start, symmetric=True, tie_break=1e-8)
        results.append(ngcloth.solve(scene, maxh=0.3, order=3))
    one, other = results
    assert one.converged and other.converged
    assert other.outline(40) / 1e3 == pytest.approx(one.outline(40), abs=1e-6)


@pytest.mark.parametrize("ks", [0.3, 2.0])
def test_symmetric_halves_are_what_the_whole_finds(ks):
    """On a cap with three distinct axes the optimum has its mirror lines, if shear is stiff.

    Softer cloth does better without them, and the certificate of the quarter says so. With ks = 0
    any two crossing curves span a Chebyshev net.
    """
    surface = Surface(ellipsoid, Disk(1))
    quarter, whole = (
        ngcloth.solve(
            Scene(surface, Net(ks=ks), start=(0.7, 0.6), symmetric=flag),
            maxh=0.3,
            order=4,
            tolerance=1e-9,
        )
        for flag in (True, False)
    )
    assert quarter.converged and whole.converged
    assert quarter.energy > 1e-4
    certificate = quarter.certificate()
    if certificate.asymmetric_curvature < -certificate.curvature_tolerance:
        assert ks == 0.3 and whole.energy < 0.95 * quarter.energy
        assert "without the symmetry may cost less" in str(certificate)
    else:
        assert ks == 2.0 and whole.energy == pytest.approx(quarter.energy, rel=1e-4)
        assert whole.area == pytest.approx(quarter.area, rel=1e-5)
        shifted = whole.outline(24) - whole.psi(0, 0)
        assert shifted == pytest.approx(quarter.outline(24), abs=1e-3)


def test_whole_hemisphere_reaches_zero_as_well():
    result = ngcloth.solve(ngcloth.scenes.hemisphere(symmetric=False), maxh=0.4, order=3)
    assert result.converged
    assert result.normalized_energy < 1e-4
    assert result.extrema["jacobian"][0] > 0


# The result --------------------------------------------------------------------------------------


def test_psi_takes_scalars_and_arrays(hemisphere):
    assert hemisphere.psi(0.2, 0.3).shape == (2,)
    assert hemisphere.psi([0.1, 0.2], 0.3).shape == (2, 2)
    assert hemisphere.psi(np.zeros((3, 1)), np.zeros(4)).shape == (3, 4, 2)
    assert hemisphere.psi([], []).shape == (0, 2)
    assert hemisphere.field("jacobian", 0.1, 0.1).shape == ()
    points = np.array([[0.1, 0.2], [0.8, 0.1], [-0.3, 0.9]])
    together = hemisphere.psi(*points.T)
    for point, value in zip(points, together, strict=True):
        assert np.array_equal(hemisphere.psi(*point), value)
    assert np.abs(hemisphere.psi(0, 0)).max() < 1e-12


def test_psi_of_mirror_images(hemisphere):
    points = np.random.default_rng(1).uniform(0, 0.7, (20, 2))
    here = hemisphere.psi(*points.T)
    assert (here > 0).all()
    for signs in ((-1, 1), (-1, -1), (1, -1)):
        assert np.array_equal(hemisphere.psi(*(points * signs).T), here * signs)
    assert np.abs(hemisphere.psi(0.0, np.linspace(-1, 1, 5))[:, 0]).max() < 1e-12


def unlimited_hemisphere(symmetric):
    """Shear stiffness, which makes the patch unique, and no limit."""
    surface = ngcloth.scenes.hemisphere().surface
    return Scene(surface, Net(ks=1.0), start=(0.5, 0.5), symmetric=symmetric)


@pytest.mark.parametrize("order, maxh", [(1, 0.1), (2, 0.3), (3, 0.5), (8, 0.4)])
@pytest.mark.parametrize("symmetric", [True, False])
def test_psi_on_the_rim(order, maxh, symmetric):
    """Rim points belong to the domain, though the mesh follows the rim only nearly."""
    scene = unlimited_hemisphere(symmetric)
    result = ngcloth.solve(scene, maxh=maxh, order=order)
    rim = scene.surface.domain.rim(720)
    on, beside = result.psi(*rim.T), result.psi(*(0.999 * rim).T)
    assert np.isfinite(on).all()
    step = np.linalg.norm(on - beside, axis=1)
    assert 0.5e-3 < step.min() and step.max() < 2.5e-3


@pytest.mark.parametrize("point", [(1.01, 0), (0.8, 0.8), (0, -1.001), (np.nan, 0), (0, np.inf)])
def test_points_outside_are_refused(hemisphere, point):
    for ask in (hemisphere.psi, lambda *theta: hemisphere.field("shear", *theta)):
        with pytest.raises(InputError, match="Disk") as error:
            ask([0.0, point[0]], [0.0, point[1]])
        assert error.value.argument == "theta"


def test_unknown_field(hemisphere):
    with pytest.raises(InputError, match="'strain'.*stretch1"):
        hemisphere.field("strain", 0, 0)


@pytest.mark.parametrize("n", [4, 37, 400])
def test_outline(hemisphere, n):
    """Starts on the axis, runs counter-clockwise around the whole patch, and closes."""
    outline = hemisphere.outline(n)
    assert outline.shape == (n, 2)
    assert outline[0] == pytest.approx([np.pi / 2, 0], abs=1e-4)
    assert outline[1, 1] > 0.01 * outline[0, 0] / n
    angle = np.unwrap(np.arctan2(*np.vstack([outline, outline[:1]]).T[::-1]))
    assert np.all(np.diff(angle) > 0)
    assert angle[-1] - angle[0] == pytest.approx(2 * np.pi)
    steps = np.linalg.norm(outline - np.roll(outline, 1, axis=0), axis=1)
    assert steps[0] < 1.5 * np.median(steps)


def test_outline_of_the_hemicatenoid_starts_where_the_contract_says():
    scene = ngcloth.scenes.hemicatenoid()
    result = ngcloth.solve(scene, maxh=0.3)
    outline = result.outline(100)
    assert np.array_equal(outline[0], result.psi(np.pi, 0.0))
    assert outline[0] == pytest.approx([np.pi / 2, 0], abs=1e-2)
    corners = result.psi([np.pi, 0, 0, np.pi], [1, 1, -1, -1])
    gaps = np.linalg.norm(outline[:, None] - corners, axis=2).min(axis=0)
    assert gaps.max() < 1e-12


@pytest.mark.parametrize(
    "scene",
    [ngcloth.scenes.hemisphere(), unlimited_hemisphere(symmetric=False)],
    ids=["quarter", "whole"],
)
def test_area_is_that_within_the_outline(scene):
    result = ngcloth.solve(scene, maxh=0.3, order=5)
    x, y = result.outline(4000).T
    shoelace = 0.5 * (x @ np.roll(y, -1) - y @ np.roll(x, -1))
    assert result.area == pytest.approx(shoelace, rel=1e-5)


def test_extrema(hemisphere):
    names = {"stretch1", "stretch2", "shear", "angle", "thickness", "reaction", "jacobian"}
    assert set(hemisphere.extrema) == names
    t = np.random.default_rng(2).uniform(-0.7, 0.7, (2, 500))
    for name, (low, high) in hemisphere.extrema.items():
        values = hemisphere.field(name, *t)
        assert low - 1e-3 <= values.min() and values.max() <= high + 1e-3
        assert np.isfinite([low, high]).all() and low < high
    assert hemisphere.extrema["jacobian"][0] > 0


@pytest.mark.parametrize("sign", [1, -1])
def test_the_greatest_shear_is_told_whatever_its_sign_and_place(sign):
    """Two circles shifted along each other: an exact net with γ = sin θ1 sin θ2."""
    surface = ngcloth.Surface(
        lambda u, v: (ngs.sin(u), ngs.sin(v), -ngs.cos(u) - ngs.cos(v)),
        ngcloth.Rectangle((0, 1), (0, 1.2) if sign > 0 else (-1.2, 0)),
    )
    result = ngcloth.solve(ngcloth.Scene(surface, ngcloth.Net()), maxh=0.5, order=4)
    corner = sign * np.sin(1) * np.sin(1.2)
    assert result.extrema["shear"] == pytest.approx(sorted([0, corner]), abs=1e-9)
    assert "|γ| up to 0.784284, threads at 38.3° or more" in str(result)


def test_extrema_on_a_plane():
    plane = Surface(lambda t1, t2: (t1, t2, 0), Disk(1))
    result = ngcloth.solve(Scene(plane, Net(kc=3.0, ks=1.0)), maxh=0.5)
    assert result.converged
    assert result.area == pytest.approx(np.pi, rel=1e-3)
    for name, value in {"stretch1": 1, "stretch2": 1, "shear": 0, "reaction": 0}.items():
        assert result.extrema[name] == pytest.approx((value, value), abs=1e-12)
    assert result.extrema["jacobian"] == pytest.approx((1, 1), abs=1e-12)


@pytest.mark.parametrize("schedule", ["adaptive", "paper"])
def test_history(schedule):
    lines = []
    result = ngcloth.solve(
        ngcloth.scenes.hemisphere(),
        maxh=0.3,
        schedule=schedule,
        tolerance=1e-4,
        log=lines.append,
    )
    assert result.converged
    rows = result.history
    assert len(rows) > 3
    newton, seconds, time = (
        np.array([getattr(row, name) for row in rows])
        for name in ("newton", "seconds", "pseudo_time")
    )
    assert np.all(np.diff(newton) >= 1) and np.all(np.diff(seconds) >= 0)
    assert time == pytest.approx(np.cumsum([row.step for row in rows]), rel=1e-12)
    assert 0 < seconds[-1] <= result.seconds and newton[0] >= 1
    assert newton[-1] == result.newton_iterations
    assert rows[-1].energy == pytest.approx(result.normalized_energy, rel=1e-12)
    assert np.all(np.diff([row.lagrangian for row in rows]) <= 1e-12)
    assert len(lines) == len(rows) + 2 and lines[-1] == str(result.reason)
    assert all(f"{row.energy:.4e}" in line for row, line in zip(rows, lines[1:-1], strict=True))


def test_schedules_end_at_the_same_patch():
    """The paper's loop goes the same way, only slowly."""
    one, other = (
        ngcloth.solve(ngcloth.scenes.hemisphere(), maxh=0.4, schedule=schedule, tolerance=1e-6)
        for schedule in ("adaptive", "paper")
    )
    assert one.converged and other.converged
    assert other.outline(40) == pytest.approx(one.outline(40), abs=5e-3)
    assert other.normalized_energy == pytest.approx(one.normalized_energy, rel=2e-2)
    assert other.newton_iterations > 5 * one.newton_iterations


def test_settings_are_recorded(hemisphere):
    assert hemisphere.settings == {
        "maxh": pytest.approx(0.04),
        "order": 2,
        "quadrature": 6,
        "tolerance": 1e-6,
        "max_steps": 500,
        "schedule": "adaptive",
        "inverse": "sparsecholesky",
        "ngsolve": ngs.__version__,
    }
    given = {"maxh": 0.4, "order": 3, "quadrature": 9, "max_steps": 60, "inverse": "umfpack"}
    result = ngcloth.solve(ngcloth.scenes.hemisphere(), **given)
    assert given.items() <= result.settings.items()
    default = ngcloth.solve(ngcloth.scenes.hemisphere(), **given | {"inverse": "sparsecholesky"})
    assert result.outline(8) == pytest.approx(default.outline(8), abs=1e-7)


def test_step_budget():
    scene = ngcloth.scenes.hemisphere()
    result = ngcloth.solve(scene, maxh=0.3, max_steps=2)
    assert result.converged is False and result.reason is Reason.STEP_BUDGET
    assert result.newton_iterations == 2 and len(result.history) <= 2
    assert result.extrema["jacobian"][0] > 0
    assert str(Reason.STEP_BUDGET) in str(result) and "budget" in str(result)
    with pytest.raises(SolveError, match="budget") as error:
        ngcloth.solve(scene, maxh=0.3, max_steps=2, throw=True)
    assert error.value.result.reason is Reason.STEP_BUDGET
    assert error.value.result.energy == pytest.approx(result.energy, rel=1e-9)
    assert ngcloth.solve(scene, maxh=0.3, throw=True).converged


def test_silent_by_default(capfd):
    ngcloth.solve(ngcloth.scenes.hemisphere(), maxh=0.4)
    assert capfd.readouterr() == ("", "")


def test_printed_forms(hemisphere):
    text = str(hemisphere)
    assert "converged" in text and f"{hemisphere.normalized_energy:.6e}" in text
    scene = str(ngcloth.scenes.hemicatenoid())
    assert "one quarter" in scene and "ε" in scene
    assert "ε" not in str(ngcloth.scenes.hemisphere())


@pytest.mark.parametrize(
    "height, area",
    [(lambda x, y: -0.25 * x**2 - 0.6 * y**2, 3.74), (lambda x, y: 0.4 * x * y, 3.29)],
)
def test_of_many_nets_an_even_one_is_chosen(height, area):
    """Without mirrors any two curves may be threads: E alone ends with half as much cloth again."""
    surface = Surface(lambda x, y: (x, y, height(x, y)), Disk(1.0))
    scene = Scene(surface, Net())
    result = solve(scene, maxh=0.25)
    assert result.converged and result.newton_iterations <= 60
    assert result.area == pytest.approx(area, rel=0.01)
    assert "evenest net" in str(scene) and "one of many" in str(result)
    assert result.certificate().one_of_many
