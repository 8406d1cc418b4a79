"""The interior point: steps, budgets, starts, refusals."""

from functools import cache

import numpy as np
import pytest
from discretising import assert_strictly_feasible, discretised, vector

import ngcloth
from ngcloth import (
    BendingThreads,
    Disk,
    Elongation,
    InputError,
    Net,
    Obstacle,
    Reason,
    Rectangle,
    Scene,
    ShearLimit,
    Surface,
    solve,
)
from ngcloth.energy.closed_form import ClosedFormLagrangian
from ngcloth.scenes import hemicatenoid, hemisphere, sphere
from ngcloth.solver.iterate import LASTING_RATE, PATIENCE, Iterate
from ngcloth.solver.meshes import make_sheets
from ngcloth.solver.recorder import Recorder
from ngcloth.solver.start import feasible_start


class Longest:
    """No thread is stretched beyond `largest`."""

    name = "longest thread"

    def __init__(self, largest):
        self.largest = largest

    def slacks(self, cloth):
        return self.largest - cloth.stretch1, self.largest - cloth.stretch2


@cache
def solved(ks, maxh, **settings):
    return solve(hemisphere(ks), maxh=maxh, **settings)


def test_refused_step_leaves_the_state_whole(monkeypatch):
    problem = discretised(hemisphere(10.0))
    iterate, recorder = Iterate(problem, 1.0), Recorder(1.0, 100, None)
    before = [vector(problem).copy(), iterate.c.copy(), iterate.s.copy(), iterate.z.copy()]
    with monkeypatch.context() as patch:
        patch.setattr(problem, "cost", lambda: np.nan)
        rate, accepted = iterate.step(recorder)
    assert not accepted and iterate.refusals == 1
    after = [vector(problem), iterate.c, iterate.s, iterate.z]
    assert all(map(np.array_equal, after, before))
    assert iterate.rate > rate > 0  # the next one is shorter
    rate, accepted = iterate.step(recorder)
    assert accepted and not np.array_equal(vector(problem), before[0])


def test_budget_of_steps_leaves_a_feasible_iterate():
    result = solved(10.0, 0.3, max_steps=5)
    assert result.reason is Reason.STEP_BUDGET and not result.converged
    assert result.newton_iterations == 5
    assert_strictly_feasible(result)
    with pytest.raises(ngcloth.SolveError) as caught:
        solve(result.scene, maxh=0.3, max_steps=5, throw=True)
    assert caught.value.result.reason is Reason.STEP_BUDGET


def test_limits_hold_strictly_at_the_sampling_points():
    for result in (solved(1.0, 0.15), solved(100.0, 0.3)):
        assert_strictly_feasible(result)


def test_slack_start_is_pulled_taut():
    """ψ = 3θ leaves threads at a third of their length; the answer does not depend on it."""
    scene = Scene(
        hemisphere().surface, Net(ks=10.0), (Elongation(),), start=(3.0, 3.0), symmetric=True
    )
    lines = []
    result = solve(scene, maxh=0.3, log=lines.append)
    (line,) = [line for line in lines if "start" in line]
    assert float(line.split()[-1]) < 1 / 3
    assert result.converged
    assert result.energy == pytest.approx(solved(10.0, 0.3).energy, rel=1e-4)


def test_start_that_no_multiple_makes_feasible():
    """Shear does not change with scale, and what is flattened has some: none respects the limit."""
    surface, limits = hemisphere().surface, (Elongation(), ShearLimit(0.05))
    scene = Scene(surface, Net(ks=10.0), limits, start=lambda x, y: (x + y, y))
    result = solve(scene, maxh=0.4, order=2)
    assert result.converged and result.extrema["shear"][1] < 0.06
    usual = solve(Scene(surface, Net(ks=10.0), limits), maxh=0.4, order=2)
    assert result.energy == pytest.approx(usual.energy, rel=0.02)


def test_limit_from_above_that_the_answer_respects_changes_nothing():
    """No multiple of the start keeps 1 ≤ λ ≤ 1.2, and the answer without that limit does."""
    dome = Surface(lambda x, y: (x, y, -0.25 * x**2 - 0.6 * y**2), Disk(1.0))
    limits = (Elongation(), Longest(1.2))
    free, held = (
        solve(Scene(dome, Net(ks=1.0), limits[:n], symmetric=True), maxh=0.3) for n in (1, 2)
    )
    assert free.converged and held.converged
    assert free.extrema["stretch2"][1] < 1.1
    assert held.energy == pytest.approx(free.energy, rel=5e-3)  # the barrier's


def test_limits_that_contradict_each_other_are_named():
    scene = Scene(hemisphere().surface, Net(), (Elongation(), Longest(0.95)), symmetric=True)
    result = solve(scene, maxh=0.5, max_steps=500)
    assert result.reason is Reason.INFEASIBLE
    assert "elongation missed by" in str(result) or "longest thread missed by" in str(result)
    assert "nor a step that misses them by less; " in str(result)
    with pytest.raises(ngcloth.SolveError, match="missed by .* at θ"):
        solve(scene, maxh=0.5, max_steps=5, throw=True)


def test_a_solve_that_gives_up_returns_what_misses_least():
    """On a mesh too coarse for 97 % of the sphere."""
    scene = sphere(0.97, shear_limit=float(np.cos(np.pi / 6)))
    problem, states = discretised(scene, 0.5, 2), []

    def missed(state):
        vector(problem)[:] = state
        return Iterate(problem, 1.0).missed()

    def keep(result):
        states.append(vector(result).copy())

    result = solve(scene, maxh=0.5, order=2, callback=keep)
    assert result.reason is Reason.INFEASIBLE
    assert missed(vector(result)) < 0.7 * missed(states[-1])


@pytest.mark.parametrize(
    "setting, value",
    [
        ("multiplier_order", 0),
        ("multiplier_order", 1.5),
        ("multiplier_order", True),
        ("barrier_end", 0.0),
        ("barrier_end", 1e-30),  # below the rounding of slacks
        ("barrier_end", 10.0),
        ("barrier_end", -1e-3),
        ("barrier_end", np.nan),
        ("barrier_end", "small"),
        ("schedule", "fast"),
    ],
)
def test_bad_settings(setting, value):
    with pytest.raises(InputError) as caught:
        solve(hemisphere(1.0), maxh=0.5, **{setting: value})
    assert caught.value.argument == setting


@pytest.mark.parametrize("limit", [1.2, 1.0, 0.0, -0.5, np.nan, "0.5", True])
def test_bad_shear_limit(limit):
    for make in (ShearLimit, lambda limit: sphere(0.6, shear_limit=limit)):
        with pytest.raises(InputError) as caught:
            make(limit)
        assert caught.value.argument == "shear_limit"


@pytest.mark.parametrize("limits", [Elongation(), (Elongation,), ("taut",), 1.0])
def test_bad_constraints(limits):
    with pytest.raises(InputError) as caught:
        Scene(hemisphere().surface, Net(ks=1.0), limits)
    assert caught.value.argument == "constraints"


def test_obstacle_needs_stress():
    with pytest.raises(InputError):
        hemicatenoid(0.0, obstacle=True)
    assert any(
        isinstance(limit, Obstacle) for limit in hemicatenoid(1.0, obstacle=True).constraints
    )


def test_a_start_beyond_a_limit_from_above_is_dilated():
    """ψ = θ/2 stretches threads up to 4, and 1.5 is allowed: a larger multiple is feasible."""
    scene = Scene(hemisphere().surface, Net(ks=10.0), (Longest(1.5),), (0.5, 0.5), symmetric=True)
    *_, sheet = make_sheets(scene, 0.3, order=2)
    problem = ClosedFormLagrangian(scene, sheet, 2, 6, "sparsecholesky", 2)
    size = problem.state.vec.Norm()
    feasible_start(problem)
    assert problem.slacks().min() > 0
    assert problem.state.vec.Norm() > 4 / 1.5 * size
    result = ngcloth.solve(scene, maxh=0.3)
    assert result.converged and result.extrema["stretch1"][1] < 1.5 + 1e-2


def test_tie_break_is_for_scenes_without_limits():
    """Its term would be missing from the objective of the line search."""
    with pytest.raises(InputError, match="tie_break"):
        Scene(hemisphere().surface, Net(ks=1.0), hemisphere(1.0).constraints, tie_break=1e-8)


def test_multipliers_begin_anew_after_steps_at_large_rates():
    """A multiplier that has run away from its slack keeps every later step from moving."""
    problem = discretised(hemisphere(1.0), 0.6)
    feasible_start(problem)
    iterate = Iterate(problem, 1.0)
    iterate.lower_mu(1e-3)
    iterate.s[0, 0], iterate.z[0, 0] = 1e-7, 1e6
    iterate.slow_steps, recorder = PATIENCE - 1, Recorder(1.0, 100, None)
    iterate._regularised = lambda recorder: setattr(iterate, "rate", 2 * LASTING_RATE)
    iterate._slack_step = lambda products: (0 * iterate.s, 0 * iterate.z)
    iterate._corrected = lambda solve, ds, dz: (ds, dz)
    iterate._line_search = lambda ds, dual_length: 1.0
    problem.unknowns[problem.psi_dofs.stop :] = 1.0
    iterate.step(recorder)
    assert iterate.mu == problem.mu == pytest.approx(1.0)
    assert iterate.s == pytest.approx(np.maximum(problem.slacks(), 0.01))
    assert iterate.s * iterate.z == pytest.approx(1.0)
    assert not problem.unknowns[problem.psi_dofs.stop :].any()


@pytest.mark.parametrize("bend", [0.0, 0.15])
def test_a_saddle_is_left(bend):
    """Warp along the axes of the cap is stationary at 0.015, the minimum is along a diagonal."""

    def chart(x, y):
        along = x * (1 + bend * (0.36 - x * x) * y)
        return along, y, -0.4 * along**2 - 0.7 * y**2

    cap = Surface(chart, Rectangle((-0.6, 0.6), (-0.6, 0.6)))
    result = solve(Scene(cap, Net(ks=1.0), (Elongation(),)), maxh=0.3)
    assert result.converged
    assert result.energy == pytest.approx(0.0082, rel=0.01)
    (x, y), (x0, y0) = result.psi([1e-3, 0.0], [0.0, 0.0])
    assert abs(np.degrees(np.arctan2(abs(y - y0), abs(x - x0))) - 45) < 2


@pytest.mark.parametrize(
    "curvatures, domain, fabric, least",
    [
        ((0.25, 0.6), Rectangle((-0.6, 0.6), (-0.6, 0.6)), Net(ks=1.0), 0.001284),
        ((0.3, 0.4), Disk(), BendingThreads(Net(ks=1.0), 0.05, 0.02), 0.068324),
    ],
)
def test_a_saddle_is_left_without_limits(curvatures, domain, fabric, least):
    """The threads turn on the surface from the axes, at 0.001447 and 0.068930, to the diagonals; no
    turn of the patch in its plane lowers the cost."""
    a, b = curvatures
    surface = Surface(lambda x, y: (x, y, -a * x**2 - b * y**2), domain)
    for start in (None, lambda x, y: (x + y, y - x)):
        result = solve(Scene(surface, fabric, start=start), maxh=0.3)
        assert result.converged and result.energy == pytest.approx(least, rel=1e-3)


@pytest.mark.parametrize("degrees", [20, 45])
def test_a_patch_that_is_free_to_turn(degrees):
    """The barrier does not decide which way, nor does the start: by order 3 at maxh 0.1 .0051738.

    From 45° by symmetry the cost has a greatest value there: the patch must leave it.
    """
    dome = Surface(lambda x, y: (x, y, -0.25 * x**2 - 0.6 * y**2), Disk(1.0))
    cosine, sine = np.cos(np.radians(degrees)), np.sin(np.radians(degrees))

    def start(x, y):
        return cosine * x + sine * y, cosine * y - sine * x

    result = solve(Scene(dome, Net(ks=1.0), [Elongation()], start=start), maxh=0.3)
    assert result.converged
    bar = result.error["energy"] / result.scene.normalisation
    assert result.normalized_energy == pytest.approx(0.0051738, abs=bar) and bar < 3e-4


@pytest.mark.slow
def test_fine_mesh_of_a_large_portion():
    """At the start on the fine mesh limits leave no room; on a finer one 500 steps do not end."""
    result = solve(sphere(0.85, shear_limit=float(np.cos(np.pi / 6))), maxh=0.08, max_steps=300)
    assert result.converged
    assert result.normalized_energy == pytest.approx(0.98, abs=1e-2)
