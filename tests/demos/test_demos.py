"""Every demo, imported by its path, and one number of each."""

import re

import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as plt
import numpy as np
import pytest
from loading import DEMOS, load

from ngcloth import Reason
from ngcloth.chebyshev import sphere_singular_portion


def test_hemisphere_has_no_energy_and_the_exact_shear():
    demo = load("hemisphere")
    result = demo.solve()
    assert result.normalized_energy <= 1e-7
    s, shear = demo.diagonal(result)
    assert np.abs(shear - demo.eq27(s)).max() < 2e-3


def test_hemisphere_table_prints_every_error(capsys):
    demo = load("hemisphere")
    result = demo.solve(order=6, maxh=0.3)
    demo.table([result])
    printed = capsys.readouterr().out
    errors = demo.errors(result)
    assert all(name in printed for name in errors)
    assert errors["outline, farthest from exact"] < 1e-5


def test_hemicatenoid_has_no_energy_and_no_smooth_extension():
    demo = load("hemicatenoid")
    result = demo.solve(order=6, maxh=0.2)
    assert result.normalized_energy <= 1e-5
    assert demo.error_in_rectangle(result, 0.6) < 1e-4
    assert np.isnan(demo.smooth_extension_at(demo.CORNER)).all()


def test_sphere_portions_find_the_singular_portion():
    demo = load("sphere_portions")
    results = {portion: demo.solve(portion, order=6, maxh=0.15) for portion in demo.FIT}
    position, _ = demo.singular_portions(results)
    assert abs(position - sphere_singular_portion()) < 1e-3


def test_sphere_portions_beyond_it_are_singular():
    assert load("sphere_portions").solve(0.9).reason is Reason.SINGULAR


@pytest.mark.parametrize("name", ["cylinder", "cone"])
def test_own_surface_unrolls(name):
    demo = load("own_surface")
    result = demo.solve(getattr(demo, name))
    assert result.normalized_energy < 1e-20
    assert demo.outline_error(result) < 1e-12


def test_pictures_are_drawn_small(tmp_path):
    demo = load("pictures")
    result = demo.solve("hemisphere", maxh=0.3)
    path = demo.draw("hemisphere", result, tmp_path)
    pixels = plt.imread(path)[..., :3]
    red = (pixels[..., 0] > 0.6) & (pixels[..., 1:] < 0.25).all(axis=-1)
    flat, worn = np.array_split(red, 2, axis=1)
    assert flat.sum() < 20 < 1000 < worn.sum()  # the shear, on the cloth alone
    assert path.stat().st_size < 150e3


def test_gallery_has_every_picture_and_every_script():
    text = (DEMOS / "README.md").read_text()
    shown = set(re.findall(r"\.\./docs/pictures/(\w+)\.png", text))
    files = {path.stem: path.stat().st_size for path in (DEMOS / "../docs/pictures").glob("*.png")}
    assert shown == set(files) == set(load("pictures").PICTURES)
    assert sum(files.values()) < 600e3
    assert all(path.name in text for path in DEMOS.glob("*.py"))
