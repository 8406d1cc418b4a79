"""The peer of the report on run times: IPOPT has the same problem, and finds the same patch."""

import casadi as ca
import numpy as np
import pytest
from loading import load

import ngcloth
from ngcloth.errors import InputError

SCENES = {
    "hemisphere": (ngcloth.scenes.hemisphere(1.0), 0.4),
    "obstacle": (ngcloth.scenes.hemicatenoid(10.0, obstacle=True), 0.8),
    "shear limit": (ngcloth.scenes.sphere(0.7, shear_limit=np.cos(np.pi / 6)), 0.4),
    "unequal threads": (
        ngcloth.Scene(
            surface=ngcloth.scenes.hemisphere().surface,
            fabric=ngcloth.Net(kc=(1.0, 3.0), ks=2.0),
            constraints=[ngcloth.Elongation()],
        ),
        0.6,
    ),
}


@pytest.fixture(scope="module")
def demo():
    return load("ipopt_peer")


@pytest.fixture
def interpreted(demo, monkeypatch):
    """Without a compiler: slower kernels, and none of the seconds of compilation."""
    monkeypatch.setattr(demo.shutil, "which", lambda name: None)
    demo.point_kernels.cache_clear()
    yield demo
    demo.point_kernels.cache_clear()


@pytest.fixture(params=[(2, 2), (3, 1)], ids=["equal order", "orders 3 and 1"])
def orders(request):
    return request.param


def disturbed(demo, scene, maxh, orders):
    """A discretised scene and its program at a patch that is nothing special."""
    order, multiplier_order = orders
    problem = demo.discretise(scene, maxh, order, multiplier_order, 2 * order + 2)
    problem.add_limit_points(problem.rim_vertices())
    program = demo.Program(problem, 2 * order + 2)
    random = np.random.default_rng(1)
    x = program.start + 1e-3 * random.standard_normal(program.start.size)
    problem.state.vec.FV().NumPy()[program.unknowns] = x
    return problem, program, x, random


@pytest.mark.parametrize("name", SCENES)
def test_program_is_the_problem_of_ngcloth(interpreted, name, orders):
    problem, program, x, _ = disturbed(interpreted, *SCENES[name], orders)
    f, g = ca.Function("program", [program.nlp["x"]], [program.nlp["f"], program.nlp["g"]])(x)
    g = np.array(g).ravel()
    assert float(f) == pytest.approx(problem.cost(), rel=1e-12)

    gradient = problem.state.vec.CreateVector()
    problem.gradient(np.zeros_like(problem.slacks()), gradient)
    free = np.flatnonzero(list(problem.free))
    imbalance = gradient.FV().NumPy()[free[free >= problem.psi_dofs.stop]]
    equations = program.upper == 0
    assert np.abs(imbalance).max() > 0.1
    np.testing.assert_allclose(g[equations], imbalance, atol=1e-10)

    slacks = np.transpose(problem.slacks()).ravel()
    np.testing.assert_allclose(g[~equations], slacks, rtol=1e-10, atol=1e-10)


@pytest.mark.parametrize("name", SCENES)
def test_derivatives_against_differences(interpreted, name):
    _, program, x, random = disturbed(interpreted, *SCENES[name], (2, 2))
    derivatives, sigma = program.derivatives, 0.7
    multiplier, step = random.standard_normal(program.upper.size), random.standard_normal(x.size)

    def at(offset):
        f, slope = derivatives["grad_f"](x + offset * step, [])
        g, rows = derivatives["jac_g"](x + offset * step, [])
        return float(f), np.array(g).ravel(), np.array(sigma * slope + rows.T @ multiplier).ravel()

    h = 1e-6
    df, dg, d_lagrangian = ((high - low) / (2 * h) for high, low in zip(at(h), at(-h), strict=True))
    _, slope = derivatives["grad_f"](x, [])
    _, rows = derivatives["jac_g"](x, [])
    upper = np.array(derivatives["hess_lag"](x, [], sigma, multiplier))
    assert not np.tril(upper, -1).any()
    curvature = (upper + np.triu(upper, 1).T) @ step
    assert float(slope.T @ step) == pytest.approx(df, rel=1e-5)
    rows_step = np.array(rows @ step).ravel()
    np.testing.assert_allclose(rows_step, dg, atol=1e-6 * np.abs(dg).max())
    np.testing.assert_allclose(curvature, d_lagrangian, atol=1e-6 * np.abs(d_lagrangian).max())


def test_folded_cloth_has_no_energy(interpreted):
    problem, program, x, _ = disturbed(interpreted, *SCENES["hemisphere"], (2, 2))
    energy = ca.Function("energy", [program.nlp["x"]], [program.nlp["f"]])
    mirror = np.where(program.unknowns < problem.fes.Range(0).stop, -1.0, 1.0)
    assert np.isfinite(float(energy(x)))
    assert np.isnan(float(energy(mirror * x)))


def test_same_patch_as_ngcloth(demo):
    scene, maxh = ngcloth.scenes.hemisphere(1.0), 0.3
    result = ngcloth.solve(scene, maxh=maxh, order=2, barrier_end=1e-5)
    peer = demo.solve_with_ipopt(scene, maxh, added=result.limit_points)
    assert peer.status == "Solve_Succeeded" and peer.result.converged
    assert peer.result.normalized_energy == pytest.approx(result.normalized_energy, rel=1e-4)
    assert peer.result.area == pytest.approx(result.area, rel=1e-4)
    assert np.abs(peer.result.outline(40) - result.outline(40)).max() < 1e-3


def test_history_and_arrival(interpreted):
    peer = interpreted.solve_with_ipopt(ngcloth.scenes.hemisphere(10.0), 0.4)
    seconds, energy, violation = peer.history.T
    assert len(seconds) == peer.result.newton_iterations + 1
    assert energy[-1] == pytest.approx(peer.result.normalized_energy, rel=1e-9)
    assert violation[0] > 0.1 and violation[-1] < 1e-6
    assert (np.diff(seconds) >= 0).all()
    assert seconds[0] < peer.arrival <= peer.result.seconds


def test_budget_is_not_convergence(interpreted):
    peer = interpreted.solve_with_ipopt(ngcloth.scenes.hemisphere(1.0), 0.4, max_iter=3)
    assert peer.status == "Maximum_Iterations_Exceeded" and not peer.result.converged


def test_scene_without_constraints_is_refused(demo):
    with pytest.raises(InputError, match="constraints"):
        demo.solve_with_ipopt(ngcloth.scenes.hemisphere(), 0.4)
