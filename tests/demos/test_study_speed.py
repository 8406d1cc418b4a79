"""The study whose speed is measured: its cases, their precision, and the master alone."""

import numpy as np
import pytest
from loading import load

import ngcloth

demo = load("study_speed")


def test_cases_are_spread_over_six_decades_and_two_surfaces():
    cases = demo.design(200)
    exponents = np.log10([case["ks"] for case in cases])
    assert np.histogram(exponents, 6, (-3, 3))[0].min() > 20
    assert sum(case["surface"] == "hemicatenoid" for case in cases) == 100


@pytest.mark.parametrize(
    "surface", ["hemisphere", pytest.param("hemicatenoid", marks=pytest.mark.slow)]
)
def test_bars_contain_the_energies_on_a_finer_mesh(surface):
    scene = demo.make_scene(surface, 10.0)
    coarse = ngcloth.solve(scene, **demo.SETTINGS)
    finer = {"maxh": coarse.settings["maxh"] / 2, "order": 5}
    bar = coarse.error["energy"]
    assert demo.resolved({"energy": coarse.energy, "energy_error": bar})
    assert abs(ngcloth.solve(scene, **finer).energy - coarse.energy) <= bar


def test_the_master_alone_solves_nothing():
    assert 0 < demo.master_seconds(demo.design(20)) < 1
