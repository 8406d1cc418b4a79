"""The certificate: given to what is solved, refused to each wrong answer, and why."""

from dataclasses import replace
from functools import cache

import ngsolve as ngs
import numpy as np
import pytest
from covering import covered
from scipy.sparse import csc_matrix

import ngcloth
from ngcloth import Disk, Elongation, Net, Rectangle, Scene, ShearLimit, Surface, solve
from ngcloth.output.planar import crossing
from ngcloth.result import elements, system
from ngcloth.result.between import Between
from ngcloth.result.certificate import LimitCheck
from ngcloth.result.elements import factorised, parts_of_square
from ngcloth.result.patch import Patch
from ngcloth.result.stationarity import Pencil, StationaryPoint
from ngcloth.scenes import hemicatenoid, hemisphere, sphere
from ngcloth.solver import chain


@cache
def solved(name):
    scene, settings = {
        "chebyshev": (hemisphere(), {"maxh": 0.2}),
        "hemisphere": (hemisphere(1.0), {"maxh": 0.15, "quadrature": 12}),
        "coarse": (hemisphere(1.0), {"maxh": 0.3}),
        "hemicatenoid": (hemicatenoid(1.0), {"maxh": 0.3}),
    }[name]
    return solve(scene, **settings)


def moved(result, size):
    """The result with ψ1 changed by a smooth function, symmetric as ψ1 is."""
    state = ngs.GridFunction(result.state.space)
    change = ngs.GridFunction(result.state.space)
    change.components[0].Set(size * ngs.x * (1 + ngs.y**2 - ngs.x**2))
    state.vec.data = result.state.vec + change.vec
    return replace(result, state=state)


@pytest.mark.parametrize("name", ["chebyshev", "hemisphere", "hemicatenoid"])
def test_certified(name):
    certificate = solved(name).certificate()
    assert certificate.certified, str(certificate)
    assert str(certificate).startswith("certified: ") and "proven" in str(certificate)
    assert "a minimum" in str(certificate) and "within the symmetry" in str(certificate)
    assert certificate.unfolded and certificate.curvature > 0


def test_verify_is_the_same_and_changes_nothing():
    result = solved("coarse")
    before = result.state.vec.FV().NumPy().copy()
    assert ngcloth.verify(result) == result.certificate()
    assert (result.state.vec.FV().NumPy() == before).all()


def test_slack_threads_are_found():
    """A patch that is not the solution: where it is most slack, and by how much."""
    result = moved(solved("coarse"), 0.01)
    certificate = result.certificate()
    assert not certificate.certified
    worst = min(certificate.limits, key=lambda check: check.slack)
    assert worst.name == "elongation" and worst.slack < -2e-3
    # λ jumps from element to element: the worst of them is beside the point.
    t = 2 * np.pi * np.arange(24) / 24
    beside = np.array(worst.theta)[:, None] + 1e-3 * np.stack([np.cos(t), np.sin(t)])
    beside = beside[:, result.scene.surface.domain.contains(beside.T)]
    stretch = min(result.field(f"stretch{i}", *beside).min() for i in (1, 2))
    assert stretch - 1 == pytest.approx(worst.slack, abs=5e-4)
    assert "elongation missed" in str(certificate)


@pytest.mark.parametrize("name, size", [("chebyshev", 2e-3), ("hemicatenoid", 3e-3)])
def test_perturbed(name, size):
    """A change that may not break a limit, but the balance."""
    good, bad = solved(name).certificate(), moved(solved(name), size).certificate()
    assert not bad.certified and "not stationary" in str(bad)
    assert bad.stationarity > 30 * good.stationarity


def test_stationarity_measures_the_distance():
    """In a scene without limits the norm of dL is linear in the change of ψ."""
    measured = []
    for size in (1e-3, 2e-3):
        certificate = moved(solved("chebyshev"), size).certificate()
        measured.append(certificate.stationarity * certificate.stress)
    assert measured[1] / measured[0] == pytest.approx(2, rel=0.05)


def test_unsolved():
    result = solve(hemisphere(1.0), maxh=0.3, max_steps=1)
    assert not result.converged
    assert "not stationary" in str(result.certificate())


def test_barrier_too_strong():
    """Stationary with a barrier that keeps all threads far from slack is not optimal."""
    result = solve(hemisphere(1.0), maxh=0.3, barrier_end=1e-2)
    certificate = result.certificate()
    assert result.converged and certificate.stationarity < certificate.stationarity_tolerance
    assert len(certificate.faults) == 1 and "barrier" in certificate.faults[0]


def test_long_triangles_are_balanced_as_well():
    """What is put on the diagonal of v, for lack of pivoting, is no force: on a chart that is long
    in one direction it was a thousand times what is left of dL."""
    surface = Surface(
        lambda x, y: (ngs.cosh(y) * ngs.cos(x / 100), ngs.cosh(y) * ngs.sin(x / 100), y),
        Rectangle((0, 100 * np.pi), (-1, 1)),
    )
    scene = Scene(surface, Net(ks=1.0), (Elongation(),), symmetric=True)
    assert solve(scene, maxh=50).certificate().stationarity < 1e-6


def test_no_net_beyond_the_singular_portion():
    """Stationary on its mesh, and far from it in a richer space."""
    certificate = solve(sphere(0.9), maxh=0.2).certificate()
    assert not certificate.certified and certificate.stationarity_richer > 0.3
    assert "mesh" in str(certificate) or "not stationary" in str(certificate)


@pytest.mark.parametrize("weight, sound", [(1e-3, False), (1e-6, True)])
def test_a_stress_that_the_barrier_makes(weight, sound):
    """A flat trapezoid lies flat; a barrier alone stretches it, by a strain like the root of μ."""
    surface = Surface(
        lambda u, v: ((1 - 0.4 * v) * u, 0.8 * v, 0.6 * v), Rectangle((-1, 1), (0, 1))
    )
    scene = Scene(surface, Net(ks=1.0), (Elongation(),))
    certificate = solve(scene, maxh=0.7, barrier_end=weight).certificate()
    assert certificate.barrier_share == pytest.approx(1, abs=0.02)
    assert 0.15 < certificate.barrier_strain / np.sqrt(weight) < 0.4
    assert certificate.certified == sound and ("barrier makes" in str(certificate)) != sound


@pytest.mark.parametrize("name, most", [("chebyshev", 7), ("hemisphere", 9)])
def test_few_factorisations_and_no_symbolic_form(name, most, monkeypatch):
    """A norm of equilibrium for each component, both orders of stationarity, each symmetry of the
    curvature, one of them twice: where it is negative."""
    result, count = solved(name), []

    def counted(matrix):
        count.append(matrix.shape)
        return factorised(matrix)

    for module in (system, elements):
        monkeypatch.setattr(module, "factorised", counted)
    monkeypatch.delattr(ngs, "BilinearForm")
    monkeypatch.delattr(ngs, "LinearForm")
    assert result.certificate().certified and len(count) <= most


def test_the_first_unknowns_alone_have_the_energy_of_their_parts():
    draw = np.random.default_rng(0)
    factor, load = np.triu(draw.random((12, 12)) < 0.3) + np.eye(12), draw.random(12)
    matrix = factor.T @ factor
    parts = parts_of_square(csc_matrix(matrix), load)
    for n in (5, 12):
        alone = load[:n] @ np.linalg.solve(matrix[:n, :n], load[:n])
        assert parts[:n].sum() == pytest.approx(alone, rel=1e-12)


def test_folded():
    certificate = covered(lambda x, y: (x - 0.8 * x * x, y)).certificate()
    assert certificate.jacobian == pytest.approx(-0.6, abs=1e-9)
    assert not certificate.unfolded and "folded" in str(certificate)
    assert certificate.stationarity == np.inf


@pytest.mark.parametrize("gap, proven", [(1e-2, True), (-1e-5, False)])
def test_fold_between_the_points(gap, proven):
    """J = |θ − p|² + gap, exact in order 3, is negative on a spot of width 0.006 or nowhere."""

    def psi(x, y):
        return (x - 0.37) ** 3 / 3 + x * ((y - 0.41) ** 2 + gap), y

    result = covered(psi, order=3)
    assert result.certificate().unfolded == proven == Between(Patch(result)).unfolded()


@pytest.mark.parametrize("turns, overlaps", [(0.9, False), (1.1, True)])
def test_overlap(turns, overlaps):
    """A strip bent into a ring, J = r everywhere: whether it covers itself only the rim knows."""
    surface = Surface(lambda r, t: (r, t, 0 * r), Rectangle((1, 2), (0, 2 * np.pi * turns)))

    def ring(r, t):
        return r * ngs.cos(t), r * ngs.sin(t)

    certificate = covered(ring, surface, order=4).certificate()
    assert certificate.unfolded and (certificate.overlap is not None) == overlaps
    assert ("meets itself" in str(certificate)) == overlaps
    if overlaps:
        assert 0.9 < np.hypot(*certificate.overlap) < 2.1


def test_crossing_of_polylines():
    t = 2 * np.pi * np.arange(300) / 300
    assert crossing(np.stack([np.cos(t), np.sin(t)], axis=1)) is None
    eight = crossing(np.stack([np.sin(t + 0.01), np.sin(2 * t + 0.02)], axis=1))
    assert np.hypot(*eight) < 0.05
    assert crossing(np.array([[0.0, 0.0], [2, 0], [2, 2], [1, 0], [0, 2]])) is not None  # touches


class Unstable:
    """A net that gains energy by shearing: unstretched and unsheared it is at rest on a saddle."""

    stiffness = 1.0

    def energy(self, I4, I6, I8):
        return (I4 - 1) ** 2 + (I6 - 1) ** 2 - 0.5 * I8**2


def test_saddle():
    """At ψ = θ the Hessian is 8 (∂1v1)² + 8 (∂2v2)² ± (∂1v2 + ∂2v1)²: its least eigenvalue is −2
    (pure shear) for the unstable net and 0 (turning) for the paper's."""
    saddle = covered(lambda x, y: (x, y), fabric=Unstable()).certificate()
    assert saddle.stationarity < 1e-2 and saddle.faults == [f"a saddle, curvature {-2:.2g}"]
    assert saddle.curvature == pytest.approx(-2, abs=1e-6)
    stable = covered(lambda x, y: (x, y), fabric=Net(ks=0.5)).certificate()
    assert stable.certified and stable.curvature == pytest.approx(0, abs=1e-9)


def test_a_weak_barrier_does_not_drown_what_the_mesh_leaves_unbalanced():
    """Active slacks of 1e-9 ask for 1e18 in the matrix; that of a richer space is not so exact."""
    strong, weak = (
        solve(hemisphere(1.0), maxh=0.3, barrier_end=end).certificate().stationarity_richer
        for end in (1e-5, 1e-7)
    )
    assert weak == pytest.approx(strong, rel=0.02) and strong > 0.01


def test_a_saddle_of_a_shallow_cap(monkeypatch):
    """Threads along the axes are stationary there, and turning them changes the energy by about the
    square of a small stress: it falls by a tenth where they go along the diagonals."""
    monkeypatch.setattr(chain, "_leave", lambda problem: False)
    surface = Surface(
        lambda x, y: (x, y, -0.25 * x**2 - 0.6 * y**2), Rectangle((-0.6, 0.6), (-0.6, 0.6))
    )
    one, other = (
        solve(Scene(surface, Net(ks=1.0), start=start), maxh=0.3)
        for start in (None, lambda x, y: (x + y, y - x))
    )
    assert one.converged and other.converged and other.energy < 0.9 * one.energy
    certificate = one.certificate()
    assert len(certificate.faults) == 1 and certificate.faults[0].startswith("a saddle")
    assert 0.001 < -certificate.curvature / certificate.stress < 0.01
    assert other.certificate().certified


def nose_cone():
    """Half a cone's skin; its warp has no stress but what keeps it taut."""

    def chart(t, z):
        return (1 - 0.4 * z) * t**2, 0.178 * (1 - 0.4 * z) * t, 2 * z

    domain = Rectangle((-0.5, 0.5), (0, 1))
    return Scene(Surface(chart, domain), Net(ks=0.1), (Elongation(),))


@pytest.mark.parametrize(
    "make, maxh, flips",
    [
        (lambda: hemicatenoid(1.0), 0.7, (0, 0)),
        (lambda: hemicatenoid(1.0), 0.7, (1, 1)),
        (nose_cone, 0.5, (0, 0)),
    ],
)
def test_curvature_against_dense_algebra(make, maxh, flips):
    """The Hessian on the null space of the linearised equilibrium, by SVD."""
    result = solve(make(), maxh=maxh)
    point = StationaryPoint(Patch(result), result.settings)
    pencil = Pencil(point, point.remainder(2)[1])
    free, rows = pencil.system.free(flips)
    on_psi = free < pencil.system.psi.stop
    whole, norm = (m[rows][:, rows].toarray() for m in (pencil.hessian, pencil.norm))
    assert np.abs(whole - whole.T).max() < 1e-9 * np.abs(whole).max()
    _, singular, directions = np.linalg.svd(whole[np.ix_(~on_psi, on_psi)])
    assert singular.min() > 1e-6
    kernel = directions[len(singular) :].T
    root = np.linalg.inv(np.linalg.cholesky(kernel.T @ norm[np.ix_(on_psi, on_psi)] @ kernel))
    reduced = root @ kernel.T @ whole[np.ix_(on_psi, on_psi)] @ kernel @ root.T
    expected = np.linalg.eigvalsh(reduced)[0]
    assert pencil.least_eigenvalue(flips) == pytest.approx(expected, rel=1e-3)


def test_saddle_across_the_symmetry():
    """A quarter of the plane: pure shear, of eigenvalue −2, breaks both mirror symmetries."""
    square = Surface(lambda x, y: (x, y, 0 * x), Rectangle((-1, 1), (-1, 1)))
    result = covered(lambda x, y: (x, y), square, Unstable(), symmetric=True)
    certificate = result.certificate()
    assert certificate.asymmetric_curvature == pytest.approx(-2, abs=1e-3)
    assert certificate.curvature > -1.9


DOME = Surface(lambda x, y: (x, y, -0.5 * x**2 - 0.8 * y**2), Disk(1.0))


@cache
def cheapest(unit, shear=1.0, threads=1.0, **settings):
    def cost(cloth):
        stretched = (cloth.stretch1 - 1) ** 2 + (cloth.stretch2 - 1) ** 2
        return unit * (threads * stretched + shear * cloth.shear**2)

    return solve(Scene(DOME, Net(ks=1.0), cost=cost, symmetric=True), maxh=0.3, **settings)


def test_equilibrium_counts_with_a_cost_and_no_limits():
    """The cost's minimum is not the energy's: on this mesh a fifth of the force is unbalanced."""
    result = cheapest(1.0)
    assert result.converged
    certificate = result.certificate()
    assert certificate.equilibrium > 0.08 and not certificate.certified
    assert result.equilibrium_residual > certificate.equilibrium
    assert "equilibrium" in str(certificate)


def test_a_limit_that_is_nowhere_active_changes_no_certificate():
    """The rim carries no force: all that is out of balance is the error of the mesh."""
    free, limited = (
        solve(Scene(DOME, Net(ks=1.0), limits, symmetric=True), maxh=0.3, order=3)
        for limits in ((), [ShearLimit(0.9)])
    )
    assert limited.energy == pytest.approx(free.energy, rel=1e-3)
    assert limited.equilibrium_residual > 0.5
    certificate = limited.certificate()
    assert certificate.certified and free.certificate().certified
    assert certificate.equilibrium < 0.02


def test_a_cost_that_is_the_energy_is_certified_like_it():
    def energy(cloth):
        return 3.0 * cloth.energy

    scene = Scene(DOME, Net(ks=1.0), cost=energy, symmetric=True)
    result = solve(scene, maxh=0.3, order=3)
    assert result.converged and result.equilibrium_residual > 0.5
    assert result.certificate().certified


def test_a_metric_that_the_mesh_does_not_resolve_is_told():
    check = LimitCheck("elongation", np.nan, 1e-3, (0.1, 0.2), "λ1 ≥ 1")
    assert not check.holds
    assert str(check) == "elongation not known at θ = (0.1, 0.2): the mesh is too coarse"


@pytest.mark.parametrize("unit", [1e-7, 1e5])
def test_the_unit_of_a_cost_does_not_decide(unit):
    one, other = cheapest(1.0), cheapest(unit)
    assert other.newton_iterations == one.newton_iterations
    assert other.area == pytest.approx(one.area, rel=1e-9)
    assert other.cost == pytest.approx(unit * one.cost, rel=1e-6)
    assert other.certificate().faults == one.certificate().faults


def test_a_patch_that_shrinks_for_ever_is_no_minimum():
    """Less cloth shears less: all forces vanish as the patch does, and the cost with them."""
    result = cheapest(1.0, threads=0.0, max_steps=40, tolerance=1e-2)
    assert not result.converged and result.area < 1
    assert any("fall by" in fault for fault in result.certificate().faults)


@pytest.mark.parametrize("unit", [1e-3, 1e3])
def test_the_unit_of_a_slack_does_not_decide(unit):
    class Taut:
        name = "taut"

        def slacks(self, cloth):
            return tuple(unit * slack for slack in Elongation().slacks(cloth))

    one, other = (
        solve(Scene(hemisphere().surface, Net(ks=1.0), [limit], symmetric=True), maxh=0.4)
        for limit in (Elongation(), Taut())
    )
    assert other.energy == pytest.approx(one.energy, rel=2e-3)
    slack = (moved(result, 0.015).certificate().limits for result in (other, one))
    for mine, theirs in zip(*slack, strict=True):
        assert mine.holds is theirs.holds is False
        assert mine.slack == pytest.approx(unit * theirs.slack, rel=0.03)
        assert mine.tolerance == pytest.approx(unit * theirs.tolerance, rel=0.4)


class Long:
    """The law of a `Net` with ks = 1, and powers of γ² that add next to nothing."""

    stiffness = 1.0

    def __init__(self, degree):
        self.degree = degree

    def energy(self, I4, I6, I8):
        powers = sum(1e-12 * (I8**2 / (I4 * I6)) ** k for k in range(1, self.degree + 1))
        return (I4 - 1) ** 2 + (I6 - 1) ** 2 + I8**2 + powers


@pytest.mark.parametrize("degree", [1, 6])
def test_a_long_law_has_the_certificate_of_the_short_one(degree):
    """Of degree 6 its derivatives by ∇ψ took minutes."""
    result = solved("coarse")
    short = result.certificate()
    long = replace(result, scene=replace(result.scene, fabric=Long(degree))).certificate()
    for name in ("stress", "stationarity", "stationarity_richer", "curvature"):
        assert getattr(long, name) == pytest.approx(getattr(short, name), rel=1e-5), name


def test_what_has_not_converged_says_what_is_missed():
    """In words, whatever the limits are, and in the log of a solve."""
    told = []
    cut = solve(hemisphere(1.0), maxh=0.3, max_steps=3, log=told.append)
    assert not cut.converged and told[-1] == cut.why
    wrong = moved(cut, 0.5)
    for limits, missed in (
        ((), []),
        ((ShearLimit(0.05),), ["shear limit missed by"]),
        ((Elongation(), ShearLimit(0.05)), ["elongation missed by", "shear limit missed by"]),
    ):
        result = replace(wrong, scene=replace(cut.scene, constraints=limits))
        assert [words in str(result) for words in missed] == [True] * len(missed)
        assert ("missed by" in result.why) == bool(missed)
