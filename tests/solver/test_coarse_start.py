"""Solves that begin on coarser meshes: same patch, few steps on the fine one, honest when cut."""

from importlib import import_module
from math import cos, pi

import ngsolve as ngs
import numpy as np
import pytest

import ngcloth
from ngcloth import Reason, scenes

chain, interior_point = map(
    import_module, ("ngcloth.solver.chain", "ngcloth.solver.interior_point")
)


@pytest.fixture
def from_scene_start(monkeypatch):
    """Solve without coarser meshes."""

    def solve(scene, **settings):
        with monkeypatch.context() as patch:
            patch.setattr(chain, "_start_from_coarser", lambda *_: False)
            return ngcloth.solve(scene, **settings)

    return solve


@pytest.mark.parametrize("scene", [scenes.hemisphere(1.0), scenes.hemicatenoid(10.0)], ids=str)
def test_coarser_meshes_lead_to_the_same_patch(scene, from_scene_start):
    maxh = 0.05 * scene.surface.domain.diameter
    nested, direct = ngcloth.solve(scene, maxh=maxh), from_scene_start(scene, maxh=maxh)
    assert any(row.phase == "coarse" for row in nested.history)
    assert not any(row.phase == "coarse" for row in direct.history)
    assert nested.energy == pytest.approx(direct.energy, rel=1e-4)
    np.testing.assert_allclose(nested.outline(100), direct.outline(100), atol=5e-3)


def test_steps_on_the_finest_mesh_do_not_grow():
    def solve(maxh):
        return ngcloth.solve(scenes.hemisphere(100.0), maxh=maxh, order=2)

    results = [solve(maxh) for maxh in (0.2, 0.1, 0.05)]
    assert max(result.last_mesh_iterations for result in results) <= 30
    assert max(result.newton_iterations for result in results) <= 70


def test_correctors_save_steps(monkeypatch):
    """Same patch in fewer steps."""
    for scene in (scenes.hemicatenoid(1.0), scenes.hemicatenoid(100.0)):
        corrected = ngcloth.solve(scene, maxh=0.2, order=2)
        with monkeypatch.context() as patch:
            patch.setattr(interior_point.Iterate, "_corrected", lambda _, solve, *step: step)
            plain = ngcloth.solve(scene, maxh=0.2, order=2)
        assert corrected.converged and plain.converged
        assert corrected.energy == pytest.approx(plain.energy, rel=1e-3)
        assert corrected.newton_iterations <= 0.75 * plain.newton_iterations


def test_barrier_waits_for_a_patch_that_slides():
    """It turns round the obstacle."""
    scene = scenes.hemicatenoid(100.0, obstacle=True)
    result = ngcloth.solve(scene, maxh=0.3, order=2, max_steps=180)
    assert result.converged
    assert result.normalized_energy == pytest.approx(0.2804, abs=5e-4)


@pytest.mark.parametrize("order, rate, least", [(2, 1.8, 1.5e-4), (3, 2.5, 5e-5)])
def test_errors_on_uniform_meshes_fall_like_the_order(order, rate, least):
    """With limits at the points of integration rules inside alone they fall like h."""
    scene, limit = scenes.hemisphere(1.0), 0.184172  # of order 4 at maxh 0.05
    sizes = np.array([0.2, 0.1, 0.05])[: 3 if order == 2 else 2]
    results = [ngcloth.solve(scene, maxh=maxh, order=order, barrier_end=1e-5) for maxh in sizes]
    errors = [abs(result.normalized_energy - limit) for result in results]
    assert np.polyfit(np.log(sizes), np.log(errors), 1)[0] > rate
    assert errors[-1] < least


def test_meshes_are_nested():
    """On a rectangle the finer mesh holds every patch of the coarser one."""
    scene = scenes.hemicatenoid(10.0)
    settings = {"maxh": 0.15, "order": 2, "quadrature": 6, "multiplier_order": 2}
    settings["linearisation"] = "closed form"
    settings |= {"inverse": "umfpack"}
    coarse, fine = (
        chain.discretised(scene, sheet, settings)
        for sheet in chain.make_sheets(scene, settings["maxh"], settings["order"])[-2:]
    )
    assert fine.fes.mesh.ne == 4 * coarse.fes.mesh.ne
    values = np.random.default_rng(3).normal(size=coarse.fes.ndof)
    coarse.state.vec.FV().NumPy()[:] = np.where(list(coarse.free), values, 0)
    fine.take(coarse.state)
    difference = fine.state.components[0] - coarse.state.components[0]
    assert ngs.Integrate(difference**2, fine.fes.mesh) < 1e-20


def test_large_portion_with_a_shear_limit():
    """Many limits meet here."""
    result = ngcloth.solve(scenes.sphere(0.85, shear_limit=cos(pi / 6)), maxh=0.15, order=2)
    assert result.converged
    assert result.newton_iterations <= 300


def test_steps_hardly_grow_with_the_order():
    counts = [
        ngcloth.solve(scenes.hemisphere(1.0), maxh=0.35, order=order).newton_iterations
        for order in (2, 3, 4, 5, 7)
    ]
    assert max(counts[:4]) <= 24
    assert counts[4] <= 30


def test_stop_on_a_coarse_mesh_is_told():
    result = ngcloth.solve(scenes.hemisphere(10.0), maxh=0.1, max_steps=2)
    assert result.reason is Reason.STEP_BUDGET
    assert result.settings["maxh"] == 0.4
    assert np.isfinite(result.energy)
    assert result.history[-1].phase == "coarse"


def test_callback_sees_the_coarse_patch():
    seen = []

    def keep(result):
        seen.append((result.history[-1].phase, result.settings["maxh"], result.area))

    result = ngcloth.solve(scenes.hemisphere(10.0), maxh=0.1, callback=keep)
    assert {(phase, maxh) for phase, maxh, _ in seen} == {
        ("coarse", 0.4),
        ("coarse", 0.2),
        ("barrier", 0.1),
    }
    assert seen[-1][2] == pytest.approx(result.area)
