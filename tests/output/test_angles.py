"""Shear angle and thickness: against the exact net and closed forms, and in three colours."""

import matplotlib
import ngsolve as ngs
import numpy as np
import pytest

import ngcloth
from ngcloth import Disk, InputError, Net, Rectangle, Scene, Surface, chebyshev, plot

matplotlib.use("Agg")
import matplotlib.pyplot as plt  # noqa: E402
from matplotlib.colors import to_rgb  # noqa: E402

from ngcloth import view  # noqa: E402
from ngcloth.output.angles import BANDS  # noqa: E402


@pytest.fixture(scope="module")
def hemisphere():
    return ngcloth.solve(ngcloth.scenes.hemisphere(), maxh=0.3, order=6)


def test_angle_is_that_of_the_exact_net(hemisphere):
    net = chebyshev.ChebyshevNet.symmetric(hemisphere.scene.surface)
    ring, turn = np.meshgrid(np.linspace(0.1, 0.95, 6), np.linspace(0, 2 * np.pi, 17))
    theta = np.stack([ring * np.cos(turn), ring * np.sin(turn)], axis=-1)
    u, v = np.moveaxis(net.material(np.abs(theta)), -1, 0)
    exact = np.degrees(np.arcsin(net.shear(u, v))) * np.sign(theta[..., 0] * theta[..., 1])
    found = hemisphere.field("angle", *np.moveaxis(theta, -1, 0))
    np.testing.assert_allclose(found, exact, atol=0.02)
    assert np.ptp(exact) > 90
    low, high = hemisphere.extrema["angle"]
    assert low == -high
    assert np.sin(np.radians(high)) == pytest.approx(hemisphere.extrema["shear"][1], abs=1e-12)


def test_inextensible_cloth_thickens_as_its_threads_close(hemisphere):
    theta = np.array([[0.3, 0.5], [-0.6, 0.6], [0.0, 0.2]]).T
    closing = np.cos(np.radians(hemisphere.field("angle", *theta)))
    np.testing.assert_allclose(hemisphere.field("thickness", *theta), 1 / closing, rtol=2e-3)


def test_cloth_around_a_cylinder_keeps_its_thickness():
    cylinder = Surface(
        lambda x, y: (ngs.cos(x), ngs.sin(x), y + 0.3 * x), Rectangle((-1, 1), (0, 1))
    )
    result = ngcloth.solve(Scene(cylinder, Net(ks=1.0)), maxh=0.5, order=3)
    assert result.extrema["thickness"] == pytest.approx((1, 1), abs=1e-3)
    assert result.extrema["angle"] == pytest.approx((0, 0), abs=0.05)
    assert [area for area, _ in result.area_beyond().values()] == [0, 0]


def stretched(slope, shear):
    """A flat panel whose patch is known: ψ is set, not solved for."""
    panel = Surface(lambda x, y: (x, y, 0 * x), Rectangle((0, 2), (0, 1)))
    result = ngcloth.solve(Scene(panel, Net(ks=1.0)), maxh=1, order=2)
    psi1, psi2 = result.state.components[:2]
    psi1.Set(slope * ngs.x + shear * ngs.y)
    psi2.Set(ngs.y)
    return result


def test_a_stretched_panel_is_thinner_by_its_areal_stretch():
    result = stretched(slope=0.8, shear=0.0)  # of a warp that is stretched by 1.25
    assert result.extrema["thickness"] == pytest.approx((0.8, 0.8), abs=1e-12)
    assert result.extrema["angle"] == pytest.approx((0, 0), abs=1e-9)


def test_a_sheared_panel_has_the_angle_of_its_threads():
    result = stretched(slope=1.0, shear=-np.tan(np.radians(20)))  # the weft leans towards the warp
    assert result.extrema["angle"] == pytest.approx((20, 20), abs=1e-9)
    assert result.extrema["thickness"] == pytest.approx((1, 1), abs=1e-12)
    beyond = result.area_beyond((15, 30))
    assert beyond[15] == pytest.approx((2, 1)) and beyond[30] == (0, 0)


def test_area_beyond_a_limit_is_that_of_the_exact_net(hemisphere):
    """On the unit sphere the angle is g(uv), with uv = const along its level lines."""
    net = chebyshev.ChebyshevNet.symmetric(hemisphere.scene.surface)
    r, turn = np.meshgrid((np.arange(120) + 0.5) / 120, (np.arange(60) + 0.5) / 60 * np.pi / 4)
    theta = np.stack([r * np.cos(turn), r * np.sin(turn)], axis=-1)
    u, v = np.moveaxis(net.material(theta), -1, 0)
    angle = 90 - np.degrees(chebyshev.sphere_angle(u * v))
    density = 4 * r / (1 + r**2) ** 2  # stereographic
    for limit, (area, share) in hemisphere.area_beyond((10, 40)).items():
        exact = (density * (angle > limit)).sum() / density.sum()
        assert share == pytest.approx(exact, abs=2e-3) and 0.05 < share < 0.7
        assert area == pytest.approx(share * 2 * np.pi, rel=1e-3)


@pytest.mark.parametrize(
    "limits", [(30, 15), (15, 15), (0, 30), (15, 90), (15,), 15, ("15", "30"), (15, np.nan)]
)
def test_limits_that_are_none_are_refused(hemisphere, limits, tmp_path):
    calls = [
        lambda: hemisphere.area_beyond(limits),
        lambda: hemisphere.plot("angle", limits=limits),
        lambda: hemisphere.view("angle", limits=limits, screenshot=tmp_path / "cloth.png"),
        lambda: ngcloth.report(hemisphere, tmp_path / "page.html", limits=limits),
    ]
    for call in calls:
        with pytest.raises(InputError, match="limits"):
            call()
    assert not list(tmp_path.iterdir()) and not plt.get_fignums()


def test_limits_are_of_the_angle_alone(hemisphere):
    with pytest.raises(InputError, match="limits"):
        hemisphere.plot("shear", limits=(15, 30))
    assert not plt.get_fignums()


def shares(pixels):
    """How much of what has a colour of the map each of the three has, by hue."""
    colours = np.array([to_rgb(band) for band in BANDS])
    pixels = pixels.reshape(-1, 3)
    lit = pixels / np.maximum(pixels.max(axis=1, keepdims=True), 1e-9)
    near = np.linalg.norm(lit[:, None] - colours / colours.max(axis=1, keepdims=True), axis=-1)
    return np.bincount(near.argmin(axis=1)[near.min(axis=1) < 0.1], minlength=3)


def test_map_of_the_angle_has_three_colours_with_the_areas_of_the_patch(hemisphere):
    figure, ax = plt.subplots()
    bar = plot.patch(ax, hemisphere, field="angle", limits=(10, 40))
    labels = [label.get_text() for label in bar.ax.get_yticklabels()]
    assert labels[:3] == ["0", "10", "40"] and float(labels[3]) == pytest.approx(52.4, abs=0.3)
    bar.remove()
    ax.set_axis_off()
    figure.canvas.draw()
    found = shares(np.asarray(figure.canvas.buffer_rgba())[..., :3] / 255)
    plt.close(figure)
    net = chebyshev.ChebyshevNet.symmetric(hemisphere.scene.surface)
    x, y = np.meshgrid(np.linspace(0, 1.6, 400), np.linspace(0, 1.6, 400))
    theta = net.theta(np.minimum(x, np.pi / 2), np.minimum(y, np.pi / 2))
    inside = (np.linalg.norm(theta, axis=-1) < 1) & (np.maximum(x, y) < np.pi / 2)
    angle = 90 - np.degrees(chebyshev.sphere_angle(np.minimum(x * y, 2)))
    exact = np.bincount(np.digitize(angle[inside], (10, 40)), minlength=3) / inside.sum()
    np.testing.assert_allclose(found / found.sum(), exact, atol=0.01)


def test_view_shows_the_three_colours(tmp_path, hemisphere):
    picture = {"rings": 30, "size": (450, 400), "screenshot": tmp_path / "cloth.png"}
    view.cloth(hemisphere, field="angle", pitch=0.5, **picture)
    found = shares(plt.imread(tmp_path / "cloth.png")[..., :3])
    assert found.min() > 0.05 * found.sum()


def test_all_the_cloth_in_one_colour_can_be_drawn():
    flat = Surface(lambda x, y: (x, y, 0 * x), Disk())
    result = ngcloth.solve(Scene(flat, Net(), symmetric=True), maxh=1)
    low, *beyond = shares(drawn(result.plot("angle").figure))
    assert low > 10 * sum(beyond)  # these in the bar alone
    plt.close("all")


def drawn(figure):
    figure.canvas.draw()
    return np.asarray(figure.canvas.buffer_rgba())[..., :3] / 255
