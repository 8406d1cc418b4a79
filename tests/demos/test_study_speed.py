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


@pytest.mark.parametrize("surface", ["hemisphere", "hemicatenoid"])
def test_energies_are_within_a_third_of_a_percent_of_those_on_a_finer_mesh(surface):
    scene = demo.make_scene(surface, 10.0)
    coarse = ngcloth.solve(scene, **demo.SETTINGS)
    fine = ngcloth.solve(scene, **(demo.SETTINGS | {"maxh": 0.2}))
    assert coarse.energy == pytest.approx(fine.energy, rel=3e-3)


def test_the_master_alone_solves_nothing():
    assert 0 < demo.master_seconds(demo.design(20)) < 1
