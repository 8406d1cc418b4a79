"""Pictures are drawn, and show what they should; a plain import loads no plotting."""

import os
import subprocess
import sys

import matplotlib
import numpy as np
import pytest

import ngcloth

matplotlib.use("Agg")
import matplotlib.pyplot as plt  # noqa: E402

from ngcloth import plot  # noqa: E402


@pytest.fixture(scope="module")
def hemisphere():
    return ngcloth.solve(ngcloth.scenes.hemisphere(), order=4, maxh=0.3)


@pytest.fixture
def ax():
    figure, ax = plt.subplots()
    yield ax
    plt.close(figure)


def test_import_loads_no_plotting():
    code = "import sys, ngcloth; print({'matplotlib', 'pyvista', 'vtk'} & set(sys.modules))"
    run = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert run.stdout.strip() == "set()"


def test_sample_covers_the_domain_with_its_corners():
    surface = ngcloth.Surface(lambda x, y: (x, y, 0 * x), ngcloth.Rectangle((0, 3), (1, 2)))
    flat = ngcloth.solve(ngcloth.Scene(surface=surface, fabric=ngcloth.Net(ks=1)), maxh=1)
    theta, triangles = plot.sample(flat, rings=5)
    sides = theta[triangles[:, 1:]] - theta[triangles[:, :1]]
    areas = np.linalg.det(sides) / 2
    assert areas.min() > 0
    assert areas.sum() == pytest.approx(3)
    x = flat.psi(*theta.T)
    assert np.linalg.norm(x - x[0], axis=1).max() == pytest.approx(np.hypot(1.5, 0.5))


def test_outline_is_closed_and_axes_are_equal(ax, hemisphere):
    plot.patch(ax, hemisphere)
    x1, x2 = ax.lines[0].get_data()
    assert (x1[0], x2[0]) == (x1[-1], x2[-1])
    area = np.sum(x1[:-1] * x2[1:] - x1[1:] * x2[:-1]) / 2
    assert area == pytest.approx(hemisphere.area, rel=1e-3)
    assert ax.get_aspect() == 1
    assert "X_1" in ax.get_xlabel() and "length" in ax.get_xlabel()


def test_threads_are_straight_on_the_flat_patch(ax, hemisphere):
    plot.patch(ax, hemisphere, pitch=0.5)
    warp, weft = ax.collections
    assert len(warp.get_paths()) == len(weft.get_paths()) == 7  # −1.5, −1, …, 1.5
    for threads, fixed in ((warp, 1), (weft, 0)):
        for path, level in zip(threads.get_paths(), np.arange(-1.5, 2, 0.5), strict=True):
            np.testing.assert_allclose(path.vertices[:, fixed], level, atol=1e-9)


@pytest.mark.parametrize("field", plot.LABELS)
def test_map_names_its_field(ax, hemisphere, field):
    bar = plot.patch(ax, hemisphere, field=field, rings=20)
    assert bar.ax.get_ylabel() == plot.LABELS[field]
    low, high = bar.mappable.get_clim()
    least, greatest = hemisphere.extrema[field]
    if field != "reaction":  # its extrema at the elements' edges are not met by the sampling
        margin = 0.1 * (greatest - least)
        assert least - margin <= low < high <= greatest + margin
    assert not field == "shear" or low == -high


def test_constant_field_can_be_drawn(ax):
    surface = ngcloth.Surface(lambda x, y: (x, y, 0 * x), ngcloth.Disk())
    scene = ngcloth.Scene(surface=surface, fabric=ngcloth.Net(), symmetric=True)
    plot.patch(ax, ngcloth.solve(scene, maxh=1), field="jacobian")


def test_convergence_shows_every_step(ax, hemisphere):
    plot.convergence(ax, hemisphere)
    times, energies = ax.lines[0].get_data()
    assert len(times) == len(hemisphere.history)
    assert np.all(np.diff(times) > 0)
    assert energies[-1] == hemisphere.history[-1].energy
    assert ax.get_yscale() == "log"


@pytest.mark.parametrize("wrong", [{"field": "colour"}, {"pitch": 0}, {"pitch": 1, "rings": 1}])
def test_what_cannot_be_drawn_is_refused(ax, hemisphere, wrong):
    with pytest.raises(ngcloth.InputError):
        plot.patch(ax, hemisphere, **wrong)


def test_pictures_in_space_leave_the_environment_as_it_was(tmp_path, hemisphere, monkeypatch):
    from ngcloth import view

    monkeypatch.delenv("DISPLAY", raising=False)
    before = dict(os.environ)
    view.cloth(hemisphere, rings=30, screenshot=tmp_path / "cloth.png", size=(60, 40))
    with pytest.raises(ngcloth.InputError, match="pitch"):
        view.cloth(hemisphere, rings=30, pitch=1e-9)
    assert dict(os.environ) == before


@pytest.mark.parametrize("field", [None, "shear"])
def test_cloth_is_pictured(tmp_path, hemisphere, field):
    from ngcloth import view

    path = tmp_path / "cloth.png"
    view.cloth(hemisphere, field=field, pitch=0.5, rings=30, screenshot=path, size=(300, 200))
    picture = plt.imread(path)[..., :3]
    assert picture.shape[:2] == (200, 300)
    drawn = (picture < 0.99).any(axis=-1)
    assert 0.2 < drawn.mean() < 0.9
    assert not drawn[[0, -1]].any() and not drawn[:, [0, -1]].any()  # nothing is cut off
    red_and_blue = np.ptp(picture[..., 0] - picture[..., 2])
    assert red_and_blue > 0.3  # warp and weft, or shear of both signs, have their colours
