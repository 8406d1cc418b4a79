"""The demos of elastic and of shear-limited cloth, imported by their path; one number of each."""

import pytest
from loading import load

from ngcloth import Reason


def test_elastic_hemisphere_energy_and_table(capsys):
    demo = load("elastic")
    result = demo.solve("hemisphere", 1, maxh=0.2)
    assert result.reason is Reason.CONVERGED
    assert result.normalized_energy == pytest.approx(0.182, abs=0.004)
    assert demo.shear_inside(result) <= result.extrema["shear"][1]
    demo.table("hemisphere", {1: result}, {1: result})
    printed = capsys.readouterr().out
    assert f"{result.normalized_energy:.4f}" in printed and "CONVERGED" in printed


def test_elastic_hemisphere_stretches_by_80_percent_at_high_shear_stiffness():
    demo = load("elastic")
    result = demo.solve("hemisphere", 100, maxh=0.2)
    assert demo.largest_stretch(result) == pytest.approx(1.8, abs=0.04)
    assert demo.shear_inside(result) < 0.075


def test_elastic_hemicatenoid_energy():
    result = load("elastic").solve("hemicatenoid", 1, maxh=0.3)
    assert result.normalized_energy == pytest.approx(0.1226, abs=0.006)


def test_shear_limited_patch_area():
    demo = load("shear_limited")
    result = demo.solve(0.7)
    assert result.reason is Reason.CONVERGED
    assert result.area == pytest.approx(9.48, abs=0.15)
    assert result.extrema["shear"][1] == pytest.approx(demo.SHEAR_LIMIT, abs=0.02)
