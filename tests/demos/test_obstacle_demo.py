"""The demo of the obstacle: the angle of a patch, and which of two patches is the lower one."""

import dataclasses

import pytest
from loading import load

import ngcloth


def test_angle_is_that_of_a_turned_patch():
    demo = load("obstacle")
    free = dataclasses.replace(
        ngcloth.scenes.hemicatenoid(1),
        constraints=(),
        symmetric=False,
        start=demo.Start(30, (1.0, 1.0)),
    )
    # One short step of the flow hardly moves the start.
    result = ngcloth.solve(free, maxh=0.5, max_steps=1, schedule="paper")
    assert demo.rotation(result) == pytest.approx(30, abs=3)


def test_turned_patch_is_lower_where_shear_is_stiff(capsys, monkeypatch):
    demo = load("obstacle")
    monkeypatch.setattr(demo, "ANGLES", [0, 20])
    found = demo.minima(100, maxh=0.5)
    assert all(result.converged for result in found)
    turned = found[0]
    assert abs(demo.rotation(turned)) > 10
    held = dataclasses.replace(demo.scene(100), symmetric=True, start=demo.START)
    straight = ngcloth.solve(held, maxh=0.5)
    assert straight.converged
    assert abs(demo.rotation(straight)) < 1e-6
    assert straight.normalized_energy == pytest.approx(0.297, abs=0.003)
    assert turned.normalized_energy < straight.normalized_energy - 0.01
    demo.table({100: found})
    assert f"{turned.normalized_energy:.5f}" in capsys.readouterr().out
