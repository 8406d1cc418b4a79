"""Whatever is drawn, a solve ends with finite numbers and a reason, or refuses before the mesh."""

import math
import pickle
import sys

import ngsolve as ngs
import numpy as np
import pytest
from hypothesis import HealthCheck, Phase, given, settings
from hypothesis import strategies as st
from scipy.interpolate import make_interp_spline

import ngcloth
from ngcloth import (
    Disk,
    Elongation,
    InputError,
    Net,
    Obstacle,
    Reason,
    Rectangle,
    Scene,
    ShearLimit,
    SolveError,
    Surface,
)

NAN, INF = float("nan"), float("inf")
BUDGET = 25
GRID = np.linspace(-1, 1, 11)
MAKE_MESH = sys.modules["ngcloth.solver.meshes"].make_mesh

drawn = settings(
    max_examples=40,
    derandomize=True,
    deadline=None,
    database=None,
    phases=[Phase.explicit, Phase.generate],  # shrinking a failure would take minutes
    suppress_health_check=list(HealthCheck),
)


def powers(low, high):
    """Numbers from 10^low to 10^high, and their order of magnitude drawn evenly."""
    return st.floats(low, high).map(lambda exponent: 10.0**exponent)


def cap(radius, scale):
    def chart(x, y):
        square = radius**2 * (x * x + y * y)
        return [scale * q / (1 + square) for q in (2 * radius * x, 2 * radius * y, square - 1)]

    return Surface(chart, Disk(), side=-1)


def catenoid(height, stretch):
    def chart(x, y):
        return ngs.cosh(y) * ngs.cos(x / stretch), ngs.cosh(y) * ngs.sin(x / stretch), y

    return Surface(chart, Rectangle((0, stretch * np.pi), (-height, height)))


def dome(a, b, tilt):
    return Surface(lambda x, y: (x + tilt * y, y, -a * x * x - b * y * y), Disk(), side=1)


def turned_start(scale, angle):
    c, s = scale * np.cos(angle), scale * np.sin(angle)
    return lambda x, y: (c * x - s * y, s * x + c * y)


class Locking:
    """A user's law: threads stiffen exponentially."""

    stiffness = 2.0

    def __init__(self, rate):
        self.rate = rate

    def energy(self, I4, I6, I8):
        return sum(ngs.exp(self.rate * (I - 1) ** 2) - 1 for I in (I4, I6)) + I8**2  # noqa: E741


class Stiffening(Locking):
    """The first two terms of its series, which no stretch makes overflow."""

    def energy(self, I4, I6, I8):
        squares = [self.rate * (I - 1) ** 2 for I in (I4, I6)]  # noqa: E741
        return sum(square + square**2 / 2 for square in squares) + I8**2


surfaces = st.one_of(
    st.builds(cap, powers(-1, 0.5), powers(-3, 3)),
    st.builds(catenoid, powers(-1, 0.3), powers(-1, 1)),
    st.builds(dome, st.floats(-0.5, 1), st.floats(-0.5, 1), st.sampled_from([0.0, 0.5])),
)
stiffnesses = st.one_of(powers(-9, 9), st.tuples(powers(-3, 3), powers(-3, 3)))
fabrics = st.one_of(
    st.builds(Net, kc=stiffnesses, ks=st.one_of(st.just(0.0), powers(-6, 6))),
    st.builds(Stiffening, st.floats(0.1, 10)),
)
limits = st.lists(
    st.one_of(
        st.just(Elongation()),
        st.builds(ShearLimit, st.floats(0.05, 0.9999)),
        st.just(Obstacle()),
    ),
    max_size=2,
)
starts = st.one_of(
    st.none(),
    st.tuples(powers(-2, 1), powers(-2, 1)),
    st.builds(turned_start, powers(-2, 1), st.floats(0, np.pi / 2)),
)
scenes = st.fixed_dictionaries(
    {
        "surface": surfaces,
        "fabric": fabrics,
        "constraints": limits,
        "start": starts,
        "symmetric": st.booleans(),
        "tie_break": st.sampled_from([0.0, 0.0, 1e-8]),
    }
)
solver_settings = st.fixed_dictionaries(
    {
        "order": st.integers(1, 4),
        "max_steps": st.integers(1, BUDGET),
        "inverse": st.sampled_from(["sparsecholesky", "umfpack"]),
    },
    optional={
        "multiplier_order": st.integers(1, 4),
        "quadrature": st.integers(0, 10),
        "barrier_end": powers(-8, 0),
        "tolerance": powers(-14, 0),
        "schedule": st.sampled_from(["adaptive", "paper"]),
    },
)


def solved_or_refused(scene, settings):
    """The result of a solve, or the `InputError` by which it was refused before the mesh."""
    meshes = []

    def noting(*arguments):
        meshes.append(MAKE_MESH(*arguments))
        return meshes[-1]

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(sys.modules["ngcloth.solver.meshes"], "make_mesh", noting)
        try:
            made = Scene(**scene)
            return ngcloth.solve(made, maxh=0.3 * made.surface.domain.diameter, **settings)
        except InputError as error:
            # Whether some multiple of a start respects the limits is asked at the mesh's points.
            assert not meshes or error.argument == "start" and "multiple" in error.allowed
            return error


@drawn
@given(scenes, solver_settings)
def test_every_draw_is_solved_or_refused(scene, settings):
    result = solved_or_refused(scene, settings)
    if isinstance(result, InputError):
        return
    assert isinstance(result.reason, Reason) and str(result.reason)
    assert result.newton_iterations <= settings["max_steps"]
    assert math.isfinite(result.energy) and math.isfinite(result.area)
    assert np.isfinite(list(result.extrema.values())).all()
    assert all(math.isfinite(row.energy) for row in result.history)
    assert np.isfinite(result.outline(12)).all()
    assert isinstance(str(result.certificate()), str)
    if result.converged and result.history:
        assert result.history[-1].newton <= result.newton_iterations
        assert not any(fault.startswith("folded") for fault in result.certificate().faults)


# One bad thing in a good scene -------------------------------------------------------------------


class Law:
    """A fabric whose energy is a given function."""

    stiffness = 1.0

    def __init__(self, energy):
        self.energy = energy


numbers_not_positive = st.sampled_from([0, -1.0, NAN, INF, -INF, True, None, "1", [1.0], 1j])
lengths_too_extreme = st.sampled_from([1e-30, 1e-9, 1e9, 1e300])
energies = st.sampled_from(
    [
        lambda I4, I6, I8: ngs.log(I4 - 1) + I6,  # -inf in the undeformed cloth
        lambda I4, I6, I8: ngs.sqrt(I4 - 1) ** 3 + (I6 - 1) ** 2,  # its derivative is NaN there
        lambda I4, I6, I8: 1 / I8,
        lambda I4, I6, I8: NAN * I4,
        lambda I4, I6, I8: INF * I4,
        lambda I4, I6, I8: None,
        lambda I4, I6, I8: 1.0,
        lambda I4, I6, I8: ngs.CF((I4, I6)),
        lambda I4, I6, I8: np.exp(I4),
        lambda I4, I6: I4 + I6,
    ]
)
charts = st.sampled_from(
    [
        lambda x, y: (x, y, ngs.sqrt(0.5 - x * x)),
        lambda x, y: (x, y, NAN * x),
        lambda x, y: (x, y, INF * y),
        lambda x, y: (1e200 * x, y, x * y),
        lambda x, y: (x, x, x),
        lambda x, y: ngs.CF((x, y)) * ngs.CF((x, y, x)),
        lambda x, y: (np.cos(x), y, 0),
    ]
)
bad_starts = st.sampled_from(
    [
        lambda x, y: (NAN * x, y),
        lambda x, y: (INF * x, y),
        lambda x, y: (ngs.sqrt(x), y),
        lambda x, y: (x, -y),
        lambda x, y: (1e-200 * x, y),  # no finite energy
        (-1.0, 1.0),
        (NAN, 1.0),
        (1e200, 1e-200),
    ]
)
GOOD = {"surface": dome(0.5, 0.5, 0.0), "fabric": Net(ks=1.0)}
bad_input = st.one_of(
    numbers_not_positive.map(lambda bad: lambda: Disk(bad)),
    lengths_too_extreme.map(lambda bad: lambda: Disk(bad)),
    lengths_too_extreme.map(lambda bad: lambda: Rectangle((0, bad), (0, 1))),
    numbers_not_positive.map(lambda bad: lambda: Net(kc=bad)),
    numbers_not_positive.map(lambda bad: lambda: Net(kc=(1.0, bad))),
    numbers_not_positive.map(lambda bad: lambda: ShearLimit(bad)),
    charts.map(lambda bad: lambda: Surface(bad, Disk())),
    energies.map(lambda bad: lambda: Scene(**GOOD | {"fabric": Law(bad)})),
    bad_starts.map(lambda bad: lambda: Scene(**GOOD, start=bad)),
    st.tuples(
        st.sampled_from(["maxh", "order", "max_steps", "barrier_end"]),
        numbers_not_positive.filter(lambda bad: bad is not None),
    ).map(
        lambda bad: (
            lambda: ngcloth.solve(Scene(**GOOD, constraints=[Elongation()]), **{bad[0]: bad[1]})
        )
    ),
)


@drawn
@given(bad_input)
def test_bad_input_is_refused_before_the_mesh(make):
    def no_mesh(*arguments):
        raise AssertionError("a mesh was about to be made")

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(sys.modules["ngcloth.solver.meshes"], "make_mesh", no_mesh)
        with pytest.raises(InputError) as error:
            make()
    assert error.value.argument and error.value.allowed


# Defects that draws have found -------------------------------------------------------------------


def test_a_law_beyond_its_range_is_refused():
    """A law that locks at I4 = 2 has no energy at a start that is stretched further."""
    law = Law(lambda I4, I6, I8: -ngs.log(1 - (I4 - 1) ** 2) - ngs.log(1 - (I6 - 1) ** 2) + I8**2)
    Scene(GOOD["surface"], law)
    with pytest.raises(InputError, match="no finite energy") as error:
        Scene(GOOD["surface"], law, start=(0.1, 0.1))
    assert error.value.argument == "start"


@pytest.mark.parametrize("multiplier_order", [3, 4])
def test_multipliers_of_too_high_order(multiplier_order):
    scene = {"surface": GOOD["surface"], "fabric": Net(ks=1.0), "constraints": [Elongation()]}
    result = solved_or_refused(scene, {"order": 2, "multiplier_order": multiplier_order})
    assert isinstance(result, InputError) and result.argument == "multiplier_order"


@pytest.mark.parametrize("inverse", ["sparsecholesky", "umfpack"])
def test_overflow_ends_with_a_reason(inverse):
    """An energy of e^(10 (I4 − 1)²) overflows within a step or two of this start."""
    scene = {"surface": cap(1.85, 1.0), "fabric": Locking(9.8), "constraints": [Elongation()]}
    result = solved_or_refused(scene, {"order": 1, "max_steps": 8, "inverse": inverse})
    assert isinstance(result, InputError) or math.isfinite(result.energy)


def test_a_chart_without_values_between_the_samples():
    """The metric is NaN in a disk of radius 0.03 only."""

    def chart(x, y):
        return x, y, ngs.sqrt((x - 0.533) ** 2 + (y - 0.217) ** 2 - 1e-3)

    with pytest.raises(InputError) as error:
        Surface(chart, Disk())
    assert error.value.argument == "chart"


def splined():
    """(I − 1)² as a table."""
    at = np.linspace(-0.5, 30, 200)
    table = make_interp_spline(at, (at - 1) ** 2, k=5)
    return ngs.BSpline(6, list(table.t), list(table.c))


@pytest.mark.parametrize("linearisation", ["closed form", "automatic"])
def test_a_law_by_splines_is_the_law_that_it_is_of(linearisation):
    """With limits, too, where NGSolve once found no derivatives; and so is one by powers."""
    spline, limits = splined(), [Elongation(), ShearLimit(0.6)]
    laws = [
        Law(lambda I4, I6, I8: spline(I4) + spline(I6) + I8**2),
        Law(lambda I4, I6, I8: (I4 - 1) ** 2 + (I6**0.5 * I6**0.5 - 1) ** 2 + I8**2),
        Net(ks=1.0),
    ]
    results = [
        ngcloth.solve(
            Scene(GOOD["surface"], law, limits, symmetric=True),
            maxh=0.5,
            linearisation=linearisation,
        )
        for law in laws
    ]
    for result in results[:2]:
        assert result.converged
        assert result.energy == pytest.approx(results[2].energy, rel=1e-8)
        assert str(result.certificate()) == str(results[2].certificate())


# Crossing processes ------------------------------------------------------------------------------


def paraboloid(x, y):
    return x, y, -(x * x + y * y) / 2


@pytest.mark.parametrize(
    "scene",
    [
        ngcloth.scenes.hemisphere(1.0),
        ngcloth.scenes.sphere(0.3),
        ngcloth.scenes.hemicatenoid(1.0, obstacle=True),
        Scene(Surface(paraboloid, Disk(0.7), side=-1), Net((1.0, 2.0), 0.5), [ShearLimit(0.8)]),
        Scene(Surface.from_heights(GRID, GRID, -np.add.outer(GRID**2, GRID**2)), Net()),
    ],
    ids=lambda scene: scene.name,
)
def test_scenes_pickle(scene):
    """By the standard library: what comes back is the same to every digit, and so is its recipe."""
    again = pickle.loads(pickle.dumps(scene))
    assert again.recipe == scene.recipe and str(again) == str(scene)
    assert again.surface.domain == scene.surface.domain and again.constraints == scene.constraints
    points = scene.surface.domain.sample(7)
    for name in ("position", "metric", "curvature"):
        one, other = (
            each.surface.evaluate(getattr(each.surface, name), points) for each in (scene, again)
        )
        assert np.array_equal(one, other)


def test_solve_error_pickles():
    """A process pool brings it back with its result."""
    with pytest.raises(SolveError) as error:
        ngcloth.solve(ngcloth.scenes.hemisphere(1.0), maxh=0.5, max_steps=2, throw=True)
    again = pickle.loads(pickle.dumps(error.value))
    assert isinstance(again, SolveError) and str(again) == str(error.value)
    assert again.result.energy == error.value.result.energy
    assert np.array_equal(again.result.outline(12), error.value.result.outline(12))
