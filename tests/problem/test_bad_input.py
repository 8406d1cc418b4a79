"""Whatever a solve cannot work with is refused by name, with its value, before any mesh is made."""

import pickle
import sys
from fractions import Fraction

import ngsolve as ngs
import numpy as np
import pytest
from netgen.occ import Circle, MoveTo, OCCGeometry
from ngsolve.meshes import MakeStructured2DMesh
from scipy.interpolate import make_interp_spline

import ngcloth
from ngcloth import Disk, Elongation, InputError, Net, Obstacle, Rectangle, Scene, Surface
from ngcloth.problem.states import States

NAN, INF = float("nan"), float("inf")
SPHERE = ngcloth.scenes.hemisphere().surface


@pytest.fixture(autouse=True)
def no_mesh(monkeypatch):
    def make(*arguments, **options):
        raise AssertionError("a mesh was about to be made")

    monkeypatch.setattr(OCCGeometry, "GenerateMesh", make)
    monkeypatch.setattr(sys.modules["ngcloth.solver.meshes"], "make_mesh", make)


def refused(argument, value, call, *arguments, **options):
    with pytest.raises(InputError) as error:
        call(*arguments, **options)
    assert error.value.argument == argument
    assert str(value) in str(error.value)
    assert str(error.value).startswith(f"{argument} = ")
    return error.value


def test_an_input_error_crosses_processes():
    """Raised in a pool of processes it would else end the pool."""
    error = pickle.loads(pickle.dumps(InputError("maxh", -1.0, "0 < maxh")))
    assert (error.argument, error.value, error.allowed) == ("maxh", -1.0, "0 < maxh")
    assert "maxh = -1.0" in str(error)


def test_good_input_goes_on_to_the_mesh():
    """The bait is taken: nothing here passes only because no mesh is ever made."""
    with pytest.raises(AssertionError, match="mesh"):
        ngcloth.solve(ngcloth.scenes.hemisphere())


@pytest.mark.parametrize("portion", [0, 1, -0.2, 1.5, NAN, INF, True, "half", None, 0.5j, [0.5]])
def test_portion(portion):
    refused("portion", repr(portion), ngcloth.scenes.sphere, portion)


SETTINGS = {
    "maxh": [0, -0.1, NAN, INF, True, "fine", [0.1]],
    "order": [0, -1, 2.0, 1.5, NAN, True, "2", 15, 10**30],
    "accuracy": [0, -0.1, NAN, 1.5, "fine"],
    "quadrature": [1, -3, 6.0, True, "6", 31, 1000],
    "tolerance": [0, -1e-6, NAN, INF, True, "tight", None],
    "max_steps": [0, -5, 10.0, True, "many", None],
    "max_seconds": [0, -5, NAN, True, "long", None, np.array([1.0, 2.0]), np.array(5.0)],
    "schedule": ["fast", "Paper", None, 3, True],
    "inverse": ["pardiso", "", 1],
    "maxhh": [0.1],
    "symmetric": [True],
    "orders": [None],
}


@pytest.mark.parametrize(
    "name, value", [(name, value) for name, values in SETTINGS.items() for value in values]
)
def test_settings(name, value):
    refused(name, repr(value), ngcloth.solve, ngcloth.scenes.hemisphere(), **{name: value})


def test_unknown_settings_are_told_the_known_ones():
    error = refused("maxhh", 0.1, ngcloth.solve, ngcloth.scenes.hemisphere(), maxhh=0.1)
    for name in ("maxh", "order", "quadrature", "tolerance", "max_steps", "schedule", "inverse"):
        assert name in error.allowed


@pytest.mark.parametrize("ks", [0.0, 1.0])
@pytest.mark.parametrize("maxh", [1e-5, 1e-9, 1e-200, 5e-324, Fraction(1, 10**9)])
def test_a_mesh_that_no_machine_holds(maxh, ks):
    error = refused("maxh", float(maxh), ngcloth.solve, ngcloth.scenes.hemisphere(ks), maxh=maxh)
    assert all(unit in error.allowed for unit in ("triangles", "unknowns", "GB"))


def test_the_estimate_of_a_mesh():
    """A quarter of the disk at maxh 5e-3, 7e4 triangles, takes Netgen some 10 s."""
    scene = ngcloth.scenes.hemisphere()
    error = refused("max_seconds", 5.0, ngcloth.solve, scene, maxh=5e-3, max_seconds=5)
    assert "7.1e+04 triangles" in error.allowed
    # With limits the finest mesh that is generated is a coarse one.
    with pytest.raises(AssertionError, match="mesh"):
        ngcloth.solve(ngcloth.scenes.hemisphere(1.0), maxh=5e-3, max_seconds=5)


def test_fractions_are_numbers():
    """They are kept as floats, which NGSolve knows."""
    half = Fraction(1, 2)
    scene = Scene(
        Surface(lambda x, y: (x, y, -x * x / 2), Disk(half)),
        Net((half, half), half),
        [ngcloth.ShearLimit(half)],
        start=(half, half),
        tie_break=Fraction(0),
    )
    kept = scene.fabric.ks, scene.constraints[0].maximum, scene.surface.domain.radius
    assert kept == (0.5, 0.5, 0.5) and {type(number) for number in kept} == {float}
    assert Rectangle((0, half), (half, 1)).box == ((0.0, 0.5), (0.5, 1.0))
    assert ngcloth.scenes.sphere(half, half, half).recipe["arguments"]["portion"] == 0.5
    with pytest.raises(AssertionError, match="mesh"):
        ngcloth.solve(scene, maxh=half, max_seconds=half, barrier_end=half)


@pytest.mark.parametrize("scene", [None, "hemisphere", ngcloth.scenes.hemisphere, SPHERE, Scene])
def test_scene(scene):
    refused("scene", repr(scene), ngcloth.solve, scene)


@pytest.mark.parametrize("ks", [-1, -1e-9, NAN, INF, 1e31, 1e308, True, "soft", None, (1, 2)])
def test_ks(ks):
    refused("ks", repr(ks), Net, ks=ks)
    refused("ks", repr(ks), ngcloth.scenes.hemisphere, ks)
    refused("ks", repr(ks), ngcloth.scenes.hemicatenoid, ks=ks)


@pytest.mark.parametrize(
    "kc, culprit",
    [
        (bad, bad)
        for bad in (0, -1, NAN, INF, 1e-31, 1e308, True, "stiff", [1, 2], (), (1.0,), (1, 2, 3))
    ]
    + [
        ((1e308, 1e308), 1e308),
        ((1.0, 0.0), 0.0),
        ((NAN, 1.0), NAN),
        ((-2.0, 1.0), -2.0),
        ((True, 1.0), True),
    ],
    ids=str,
)
def test_kc(kc, culprit):
    refused("kc", repr(culprit), Net, kc=kc)


# Charts and domains ------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "chart",
    [
        lambda t1, t2: (t1, t2),
        lambda t1, t2: (t1, t2, 0, 0),
        lambda t1, t2: t1,
        lambda t1, t2: ngs.CF((t1, t2)),
        lambda t1, t2: ((t1, t2), (t2, t1), (t1, t1)),
        lambda t1, t2: None,
        lambda t1, t2: ("x", "y", "z"),
        lambda t1, t2: (np.sin(t1), t2, t1),  # numpy's sine does not know the expression
        lambda t1: (t1, t1, t1),
        None,
        (1.0, 2.0, 3.0),
    ],
)
def test_chart_without_three_components(chart):
    error = refused("chart", "", Surface, chart, Disk())
    assert "three components" in str(error)


@pytest.mark.parametrize(
    "chart, domain, where",
    [
        # polar coordinates at the origin
        (lambda r, t: (r * ngs.cos(t), r * ngs.sin(t), r**2), Rectangle((0, 1), (0, 3)), (0, None)),
        # a pole in the middle
        (lambda t1, t2: (t1 * t1, t2 * t2, t1 * t2), Disk(), (0, 0)),
        # not defined near the rim
        (lambda t1, t2: (t1, t2, ngs.sqrt(0.9 - t1 * t1 - t2 * t2)), Disk(), None),
        # infinite slope on the rim itself
        (lambda t1, t2: (t1, t2, ngs.sqrt(1 - t1 * t1)), Rectangle((-1, 1), (0, 1)), (-1, None)),
        (lambda t1, t2: (t1, t2, 1 / t1), Disk(), (0, None)),
        # a curve, a point
        (lambda t1, t2: (t1 + t2, 2 * (t1 + t2), t1 + t2), Disk(), None),
        (lambda t1, t2: (1.0, 2.0, 3.0), Disk(), None),
    ],
)
def test_chart_with_a_singular_metric(chart, domain, where):
    with pytest.raises(InputError, match="singular or not finite") as error:
        Surface(chart, domain)
    assert error.value.argument == "chart"
    point = np.array(error.value.value)
    assert domain.contains(point)
    for value, expected in zip(point, where or (None, None), strict=True):
        assert expected is None or abs(value - expected) < 1e-12
    assert repr(error.value.value) in str(error.value)


@pytest.mark.parametrize("radius", [2, 1, 0.95, 0.9, 0.7])
@pytest.mark.parametrize("apex", [(0.0, 0.0), (0.123, -0.4), (-0.5, 0.3217)])
def test_a_cone_with_its_apex(radius, apex):
    """Whether a point of a grid hits the apex does not matter; a blunt cone has none."""

    def cone(blunt):
        return lambda x, y: (
            x,
            y,
            ngs.sqrt((x - apex[0]) ** 2 + (y - apex[1]) ** 2 + blunt**2),
        )

    with pytest.raises(InputError, match="singular") as error:
        Surface(cone(0.0), Disk(radius))
    assert np.abs(np.array(error.value.value) - apex).max() < 1e-7
    Surface(cone(1e-3), Disk(radius))


@pytest.mark.parametrize(
    "chart",
    [
        lambda x, y: (x * x - y * y, 2 * x * y, 0),  # z², which covers the plane twice
        lambda x, y: (x**3, y, 0),  # det a = 0 along a line
        lambda x, y: (x * x, x * y, y * y),
        lambda x, y: (x * ngs.cos(y), x * ngs.sin(y), 0),  # polar
        lambda x, y: (x, y, 1 / x),
    ],
)
@pytest.mark.parametrize("shift", [(0.1234, 0.5678), (-0.3003, 0.0101)])
def test_singular_points_between_all_grids(chart, shift):
    def shifted(x, y):
        return chart(x - shift[0], y - shift[1])

    with pytest.raises(InputError, match="singular") as error:
        Surface(shifted, Disk())
    assert error.value.argument == "chart"
    assert abs(error.value.value[0] - shift[0]) < 1e-3


GRID = MakeStructured2DMesh(
    quads=True, nx=20, ny=20, mapping=lambda s, t: (2.2 * s - 1.1, 2.2 * t - 1.1)
)


def field(order):
    """A dome as a field of another mesh."""
    dome = ngs.GridFunction(ngs.H1(GRID, order=order))
    dome.Set(-0.5 * (ngs.x**2 + ngs.y**2))
    return dome


def heights(values):
    """A table of heights on a grid over the disk."""
    x = np.linspace(-1, 1, 201)
    return ngs.VoxelCoefficient((-1, -1), (1, 1), values(x, x[:, None]))


def spike(x, y):
    """One height of a grid stands out: a spike of width 0.02, and 0.01 in the middle."""
    return 0.1 * ((abs(x - 0.31) < 1e-9) & (abs(y + 0.42) < 1e-9))


@pytest.mark.parametrize(
    "height",
    [
        lambda x, y: field(1),
        lambda x, y: field(3),
        lambda x, y: 0.01 * field(3),
        lambda x, y: heights(lambda x, y: -0.5 * (x * x + y * y)),
        lambda x, y: heights(spike),
        lambda x, y: ngs.Interpolate(ngs.sin(2 * x) * y, ngs.H1(GRID, order=2)),
        lambda x, y: ngs.IfPos(x - 0.30003, 0.1, 0),  # torn
        lambda x, y: ngs.IfPos(x * ngs.sin(0.5) - y * ngs.cos(0.5) - 0.1, 1e-3, 0),
        lambda x, y: ngs.IfPos(x - 0.3, 0.1 * (x - 0.3), 0),  # creased
        lambda x, y: ngs.IfPos(0.005**2 - (x - 0.3) ** 2 - (y + 0.7) ** 2, 0.1, 0),
        lambda x, y: ngs.IfPos(0.005**2 - (x + 0.123) ** 2 - (y - 0.456) ** 2, 0.1, 0),
    ],
)
def test_charts_whose_derivatives_are_not_their_own(height):
    """Each would be solved as the plane, or as a surface without its steps."""
    with pytest.raises(InputError, match="derivatives") as error:
        Surface(lambda x, y: (x, y, height(x, y)), Disk())
    assert error.value.argument == "chart" and "from_heights" in error.value.allowed
    assert Disk().contains(np.array(error.value.value))


PLACE = ngs.Parameter(2.0)  # of a step, outside the disk


def test_a_chart_that_has_passed_is_checked_again_once_it_is_another():
    """A study makes many surfaces alike; they are told apart by what they are closed over."""

    def dome(height, step):
        def chart(x, y):
            return x, y, height * (x * x + y * y) + ngs.IfPos(x - PLACE, 0.1, step)

        return Surface(chart, Disk())

    for height in (0.3, 0.4, 0.3):
        dome(height, 0.0)
    creased = ngs.IfPos(0.005**2 - (ngs.x - 0.3) ** 2 - (ngs.y + 0.7) ** 2, 0.1, 0)
    with pytest.raises(InputError, match="derivatives"):
        dome(0.3, creased)
    PLACE.Set(0.3)
    with pytest.raises(InputError, match="derivatives"):
        dome(0.3, 0.0)
    PLACE.Set(2.0)
    assert dome(0.3, 0.0).evaluate(ngs.x, (0.3, 0.1)) == pytest.approx(0.3)


@pytest.mark.parametrize(
    "height",
    [
        lambda x, y: 1e-3 * ngs.sin(500 * x),
        lambda x, y: 1e-6 * ngs.exp(5 * x * y),
        lambda x, y: 1e7 - 0.5 * (x * x + y * y),
        lambda x, y: ngs.IfPos(x - 0.3, 0.5 * (x - 0.3) ** 2, 0),  # rounded off: b alone jumps
        lambda x, y: ngs.sqrt(1.001 - x * x - y * y),
        lambda x, y: ngs.atan2(y, x + 3),
        lambda x, y: 0.2 * ngs.exp(-((x - 0.31) ** 2 + y * y) / 0.01**2),
    ],
)
@pytest.mark.parametrize("scale", [1e-3, 1.0, 1e4])
def test_smooth_charts_are_accepted(height, scale):
    """No false alarm, in any unit."""
    chart = Surface(
        lambda x, y: [scale * c for c in (x / scale, y / scale, height(x / scale, y / scale))],
        Disk(scale),
    )
    assert np.isfinite(chart.evaluate(chart.curvature, [0.1 * scale, 0.2 * scale])).all()


@pytest.mark.parametrize(
    "chart", [lambda x, y: (x, y, 1j * x), lambda x, y: (x, (1 + 1e-9j) * y, x)]
)
def test_complex_charts(chart):
    assert "complex" in refused("chart", "", Surface, chart, Disk()).allowed


@pytest.mark.parametrize("domain", [None, Disk, "disk", (0, 1), 1.0])
def test_domain(domain):
    refused("domain", repr(domain), Surface, lambda t1, t2: (t1, t2, 0), domain)


class Cut(Disk):
    """The unit disk less a smaller one, or less a strip."""

    def __init__(self, hole):
        super().__init__()
        object.__setattr__(self, "hole", hole)

    def _shape(self):
        return super()._shape() - self.hole


@pytest.mark.parametrize(
    ("hole", "found"),
    [
        (lambda: Circle((0, 0), 0.3).Face(), "there are 1, with 2 closed rims"),
        (lambda: MoveTo(-0.1, -2).Rectangle(0.2, 4).Face(), "there are 2, with 2 closed rims"),
    ],
)
def test_domain_with_holes_or_in_pieces(hole, found):
    with pytest.raises(InputError, match=found) as error:
        Surface(lambda t1, t2: (t1, t2, 0 * t1), Cut(hole()))
    assert error.value.argument == "domain"
    whole = Cut(MoveTo(0.9, -2).Rectangle(1, 4).Face())  # without a hole it is taken
    assert Surface(lambda t1, t2: (t1, t2, 0 * t1), whole).domain is whole


@pytest.mark.parametrize("side", [0, 2, -2, True, 1.0, "up", None, [1]])
def test_side(side):
    refused("side", repr(side), Surface, lambda t1, t2: (t1, t2, 0), Disk(), side=side)


@pytest.mark.parametrize("radius", [0, -1, NAN, INF, True, "1", None, (1, 2)])
def test_radius(radius):
    refused("radius", repr(radius), Disk, radius)


@pytest.mark.parametrize(
    "side, culprit",
    [(bad, bad) for bad in (None, 1.0, (1, 0), (1, 1), (0, 1, 2), (), "ab")]
    + [
        ((0, NAN), NAN),
        ((0, INF), INF),
        ((0, True), True),
        (("a", "b"), "a"),
        ((0, (1, 2)), (1, 2)),
    ],
    ids=str,
)
def test_rectangle(side, culprit):
    refused("side1", repr(culprit), Rectangle, side, (0, 1))
    refused("side2", repr(culprit), Rectangle, (0, 1), side)


@pytest.mark.parametrize("n", [0, -3, 2.5, True, "all", None, 10**9])
def test_rim(n):
    for domain in (Disk(), Rectangle((0, 1), (0, 1))):
        refused("n", repr(n), domain.rim, n)


@pytest.mark.parametrize("theta", [(3.0, 0.0), (0.0, -1e300), (NAN, 0.0), (INF, 0.0)])
def test_points_far_from_the_domain(theta):
    error = refused("theta", theta, SPHERE.evaluate, SPHERE.metric, theta)
    assert "Disk" in error.allowed


@pytest.mark.parametrize("starts", [None, 0.5])
def test_starts_of_minima(starts):
    refused("starts", starts, ngcloth.minima, ngcloth.scenes.hemisphere(), starts)
    refused("scene", None, ngcloth.minima, None, [(1.0, 1.0)])


# Scenes ------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "name, values",
    [
        ("surface", [None, Surface, "sphere", Disk()]),
        ("fabric", [None, Net, "net", 1.0, SPHERE]),
        ("symmetric", [None, 1, "yes", np.True_]),
        ("name", [5, None, b"dome", "dome\n", "\x01"]),
        ("tie_break", [-1e-3, 2, NAN, True, "a bit", None]),
    ],
)
def test_scene_arguments(name, values):
    for value in values:
        given = {"surface": SPHERE, "fabric": Net()} | {name: value}
        refused(name, repr(value), Scene, **given)


def test_named_scenes_check_symmetric():
    for scene in (ngcloth.scenes.hemisphere, ngcloth.scenes.hemicatenoid, ngcloth.scenes.sphere):
        refused("symmetric", "'no'", scene, symmetric="no")


@pytest.mark.parametrize(
    "start, culprit",
    [(bad, bad) for bad in (0.5, "ab", (), (1.0,), (1.0, 1.0, 1.0), {"s1": 1, "s2": 2})]
    + [
        ((0.5, NAN), NAN),
        ((INF, 0.5), INF),
        ((True, 1.0), True),
        (("a", 1), "a"),
        ((None, 1), None),
    ],
    ids=str,
)
def test_start_that_is_no_pair(start, culprit):
    refused("start", repr(culprit), Scene, SPHERE, Net(), start=start)


def test_start_array_of_the_wrong_shape():
    refused("start", "", Scene, SPHERE, Net(), start=np.eye(2))
    refused("start", "", Scene, SPHERE, Net(), start=np.ones(3))


@pytest.mark.parametrize("start", [(0.0, 1.0), (1.0, 0.0), (-0.5, 0.5), (0.5, -1e-3)])
def test_start_that_folds(start):
    error = refused("start", repr(start), Scene, SPHERE, Net(), start=start)
    assert "J = det ∇ψ must be > 0" in str(error) and f"{start[0] * start[1]:.3g}" in str(error)


@pytest.mark.parametrize(
    "start",
    [
        lambda x, y: (y, x),  # turned over
        lambda x, y: (x, x),
        lambda x, y: (1.0, 2.0),
        lambda x, y: (x - 0.6 * x * x, y),  # folds where x > 5/6
        lambda x, y: (x**3, y),  # J = 0 on one line
        lambda x, y: (ngs.sqrt(x), y),  # not defined on one half
        lambda x, y: (ngs.log(0.5 - x), -y),
    ],
)
def test_callable_start_that_folds(start):
    error = refused("start", repr(start), Scene, SPHERE, Net(), start=start)
    assert "J = det ∇ψ must be > 0" in str(error)


@pytest.mark.parametrize(
    "start",
    [
        lambda x, y: x,
        lambda x, y: (x,),
        lambda x, y: (x, y, x),
        lambda x, y: ((x, y), (y, x)),
        lambda x, y: None,
        lambda x, y: ("x", "y"),
        lambda x, y: (np.sin(x), y),
        lambda x: (x, x),
    ],
)
def test_callable_start_without_two_components(start):
    error = refused("start", repr(start), Scene, SPHERE, Net(), start=start)
    assert "two components" in str(error)


@pytest.mark.parametrize(
    "start",
    [
        lambda x, y: (x + 0.1 * y, y),
        lambda x, y: (x, y + 0.2 * x * x),
        lambda x, y: (x + 0.1 * x * x, y),
        lambda x, y: (x, y + 1e-3 * x * x * x),
    ],
)
def test_start_without_the_symmetry_of_the_scene(start):
    Scene(SPHERE, Net(), start=start)  # good enough without
    error = refused("start", repr(start), Scene, SPHERE, Net(), start=start, symmetric=True)
    assert "symmetry" in str(error)


def test_good_starts_are_accepted():
    """No false alarm: bent, turned, and translated starts; pairs of every kind."""
    for start in (
        None,
        (1, 2),
        [0.5, 0.5],
        np.array([0.5, 2.0]),
        (-1.0, -1.0),
        lambda x, y: ngs.CF((x, y)),
        lambda x, y: (x * (1 + 0.2 * y * y) + 7, y + 0.1 * ngs.sin(y)),
    ):
        assert Scene(SPHERE, Net(), start=start, symmetric=True).start is start
    Scene(SPHERE, Net(), start=lambda x, y: (x + y, y - x))
    Surface(lambda t1, t2: [t1, t2, 0], Disk(), side=-1)


# What a user's own functions return ---------------------------------------------------------------


class Law:
    """A fabric whose energy is a given function."""

    stiffness = 1.0

    def __init__(self, energy):
        self.energy = energy


class Limit:
    """A limit whose slacks are a given function."""

    name = "mine"

    def __init__(self, slacks):
        self.slacks = slacks


def net(I4, I6, I8):
    return (I4 - 1) ** 2 + (I6 - 1) ** 2 + I8**2


def scene(law=net, limits=(), **options):
    return Scene(SPHERE, Law(law), [Limit(limit) for limit in limits], **options)


@pytest.mark.parametrize(
    "what",
    [None, 1.0, "text", len, [None], (1.0,), (), ngs.CF((ngs.x, ngs.y)), 1j * ngs.x],
    ids=str,
)
def test_returns_of_the_wrong_kind(what):
    """The class, its method and what is expected are named."""
    wanted = {
        "fabric": ("Law.energy(I4, I6, I8)", lambda: scene(lambda *invariants: what)),
        "constraints": ("Limit.slacks(cloth)", lambda: scene(limits=[lambda cloth: what])),
        "cost": ("mine(cloth)", lambda: scene(cost=mine)),
    }

    def mine(cloth):
        return what

    for argument, (method, make) in wanted.items():
        error = refused(argument, "", make)
        assert f"`{method}` must return" in error.allowed
        assert "scalar expression" in error.allowed


def test_slacks_are_a_sequence():
    error = refused("constraints", "Limit", scene, limits=[lambda cloth: cloth.shear])
    assert "a tuple" in error.allowed
    pair = [lambda cloth: (ngs.CF((cloth.shear, cloth.stretch1)),)]
    assert "2 components" in refused("constraints", "Limit", scene, limits=pair).allowed
    scene(limits=[lambda cloth: [1 + cloth.shear], lambda cloth: (s for s in [cloth.stretch1])])


@pytest.mark.parametrize("kind", [KeyError, ValueError, ZeroDivisionError, RuntimeError])
def test_errors_of_ones_own_pass_through(kind):
    """Unchanged, and with a note of where (from Python 3.11 on)."""
    error = kind("mine")

    def broken(*arguments):
        raise error

    class Broken(Law):
        stiffness = property(broken)

    calls = {
        "chart(θ1, θ2)": lambda: Surface(broken, Disk()),
        "start(θ1, θ2)": lambda: scene(start=broken),
        "Law.energy(I4, I6, I8)": lambda: scene(broken),
        "Limit.slacks(cloth)": lambda: scene(limits=[broken]),
        "broken(cloth)": lambda: scene(cost=broken),
        "Broken.stiffness": lambda: Scene(SPHERE, Broken(net)),
    }
    for place, call in calls.items():
        with pytest.raises(kind) as caught:
            call()
        assert caught.value is error
        assert not hasattr(error, "add_note") or place in error.__notes__[-1]


@pytest.mark.parametrize("factor", [1e9, 1e-9, 0.0])
def test_stiffness_that_is_not_the_laws(factor):
    error = refused("fabric.stiffness", 1.0, scene, lambda *state: factor * net(*state))
    assert "Law.energy" in error.allowed
    law = Law(lambda *state: 1e9 * net(*state))
    law.stiffness = 1e9
    Scene(SPHERE, law)
    Scene(SPHERE, Net(kc=1e-9, ks=1e6))  # shear may be far stiffer


def spline(low, high, law=lambda i: (i - 1) ** 2):
    """A law of one invariant, tabulated from `low` to `high`."""
    at = np.linspace(low, high, 60)
    table = make_interp_spline(at, law(at), k=5)
    return ngs.BSpline(6, list(table.t), list(table.c))


@pytest.mark.parametrize(
    "wrong",
    [
        lambda i: ngs.IfPos(i - 1.234, 0.1, 0),
        lambda i: ngs.IfPos(i - 1.234, 0.1 * (i - 1.234), 0),
        lambda i: ngs.IfPos(0.005 - ngs.sqrt((i - 1.234) ** 2), 0.1, 0),
        lambda i: ngs.VoxelCoefficient(
            (0.0,), (3.0,), (np.linspace(0, 3, 300) - 1) ** 2, trafocf=ngs.CF((i,))
        ),
        spline(0.8, 3.0),
    ],
)
def test_laws_whose_derivatives_are_not_their_own(wrong):
    """Steps, kinks, tables, and a spline that is zero below its knots."""
    for law in (lambda I4, I6, I8: wrong(I4) + I6**2 + I8**2, lambda I4, I6, I8: I4**2 + wrong(I6)):
        error = refused("fabric", "Law", scene, law)
        assert "I4 = " in error.allowed and "Law.energy" in error.allowed
    limit = [lambda cloth: (3 + wrong(cloth.I4),)]
    assert "Limit.slacks" in refused("constraints", "Limit", scene, limits=limit).allowed
    error = refused("cost", "", scene, cost=lambda cloth: wrong(cloth.I6) + cloth.shear**2)
    assert "derivatives" in error.allowed


@pytest.mark.parametrize(
    "known",
    [
        ngcloth.scenes.hemisphere(ks=0.0),
        ngcloth.scenes.sphere(0.85, ks=3.0, shear_limit=0.8),
        ngcloth.scenes.hemicatenoid(ks=0.1, obstacle=True, symmetric=True),
        Scene(SPHERE, Net(kc=1e3, ks=1e-3), [Elongation(), Obstacle()], start=(0.2, 0.1)),
    ],
)
def test_the_laws_of_the_library_would_pass_what_those_of_users_have_to(known):
    """Scenes of nothing else are not tried, which would take most of their time."""
    states = States(known, known._check_start())
    states.check_derivatives()
    if known.symmetric:
        states.check_mirrors()


def test_a_start_below_the_knots_of_a_spline():
    """The message says where the invariants left the table."""
    table = spline(0.3, 3.0)

    def law(I4, I6, I8):
        return table(I4) + table(I6) + I8**2

    scene(law, start=(1.0, 1.0))
    error = refused("fabric", "Law", scene, law, start=(6.0, 6.0))
    assert "I4 = 0.3, I6 = 0.3" in error.allowed and "knots" in error.allowed


@pytest.mark.parametrize(
    "law",
    [
        lambda I4, I6, I8: sum(ngs.exp(9.8 * (i - 1) ** 2) - 1 for i in (I4, I6)) + I8**2,
        lambda I4, I6, I8: sum(ngs.IfPos(i - 1, (i - 1) ** 2, 0) for i in (I4, I6)) + I8**2,
        lambda I4, I6, I8: net(I4, I6, I8) + 1e-3 * ngs.sin(100 * I4),
        lambda I4, I6, I8: (I4**1.5 - 1) ** 2 + (I6 - 1) ** 2 + (I8 * I8) ** 1.5,
        lambda I4, I6, I8: spline(0.1, 9.0)(I4) + spline(0.1, 9.0)(I6) + I8**2,
        lambda I4, I6, I8: net(I4, I6, I8) * ngs.IfPos(ngs.x, 2, 1),  # two cloths, sewn
    ],
)
def test_smooth_laws_are_accepted(law):
    scene(law, [lambda cloth: (2 - cloth.stretch1,)], cost=lambda cloth: law(*invariants(cloth)))


def invariants(cloth):
    return cloth.I4, cloth.I6, cloth.I8


# Symmetry that is not there -----------------------------------------------------------------------


def bowl(a, b, turn=0.0):
    c, s = np.cos(turn), np.sin(turn)
    return Surface(
        lambda x, y: (x, y, -a * (c * x + s * y) ** 2 - b * (c * y - s * x) ** 2), Disk()
    )


def test_surfaces_without_the_symmetry_of_the_scene():
    for surface in (
        bowl(0.25, 0.6, np.pi / 4),
        Surface(lambda x, y: (x, y, 0.1 * x**3), Rectangle((-1, 0.5), (0, 1))),
        Surface(lambda x, y: (x, y, 0.1 * ngs.exp(-400 * ((x - 0.4) ** 2 + y * y))), Disk()),
    ):
        Scene(surface, Net())
        error = refused("surface", "Surface", Scene, surface, Net(), symmetric=True)
        assert "mirror" in error.allowed
    Scene(bowl(0.25, 0.6), Net(), symmetric=True)
    Scene(bowl(0.25, 0.6, np.pi / 2), Net(), symmetric=True)
    odd = Surface(lambda x, y: (x, y, 0.3 * x**3), Disk())  # its mirror image is itself, turned
    Scene(odd, Net(ks=1.0), [Elongation()], symmetric=True)


def test_a_hypar_is_symmetric_but_for_its_sides():
    """z = xy/2: a mirror turns the surface over, which energies do not feel and the obstacle does.

    Half a turn about an axis takes it to itself, and its side to the other.
    """
    hypar = Surface(lambda x, y: (x, y, 0.5 * x * y), Disk())
    Scene(hypar, Net(ks=1.0), [Elongation()], symmetric=True)
    limits = [Elongation(), Obstacle()]
    error = refused("constraints", "Obstacle", Scene, hypar, Net(ks=1), limits, symmetric=True)
    assert "mirror" in error.allowed


@pytest.mark.parametrize(
    "argument, options",
    [
        ("fabric", {"law": lambda I4, I6, I8: net(I4, I6, I8 - 0.3)}),
        ("fabric", {"law": lambda I4, I6, I8: net(I4, I6, I8) * (2 + ngs.x)}),
        ("fabric", {"law": lambda I4, I6, I8: net(I4, I6, I8) * (2 + 0.1 * ngs.y)}),
        ("constraints", {"limits": [lambda cloth: (0.9 - cloth.shear,)]}),
        ("constraints", {"limits": [lambda cloth: (2 + ngs.x - cloth.stretch1,)]}),
        ("cost", {"cost": lambda cloth: cloth.shear**2 + cloth.gradient[0, 1]}),
        ("cost", {"cost": lambda cloth: (cloth.shear - 0.1) ** 2}),
    ],
)
def test_choices_without_the_symmetry_of_the_scene(argument, options):
    scene(**options)
    assert "mirror" in refused(argument, "", scene, **options, symmetric=True).allowed


def test_choices_with_the_symmetry_of_the_scene():
    """Even in I8 and in place; slacks, and limits, that change places with one another."""
    both = [lambda cloth: (0.9 - cloth.shear, 0.9 + cloth.shear)]
    each = [lambda cloth: (0.9 - cloth.shear,), lambda cloth: (0.9 + cloth.shear,)]
    for limits in both, each:
        scene(limits=limits, symmetric=True)
    scene(lambda *state: net(*state) * (2 + ngs.x**2), symmetric=True)
    scene(lambda I4, I6, I8: 3 * (I4 - 1) ** 2 + (I6 - 1) ** 2, symmetric=True)  # warp and weft
    scene(cost=lambda cloth: cloth.shear**2 + cloth.gradient[0, 1] ** 2, symmetric=True)


# Heights on a grid --------------------------------------------------------------------------------

X = np.linspace(-1.0, 1.0, 9)


@pytest.mark.parametrize(
    "argument, x, z",
    [
        ("x", X[::-1], np.zeros((9, 9))),
        ("x", X**3, np.zeros((9, 9))),
        ("x", X[:5], np.zeros((5, 9))),
        ("x", X[:, None], np.zeros((9, 9))),
        ("x", "grid", np.zeros((9, 9))),
        ("z", X, np.zeros((9, 8))),
        ("z", X, np.zeros(9)),
        ("z", X, np.full((9, 9), NAN)),
        ("z", X, np.full((9, 9), 1e308)),
        ("z", X, [[1, 2], [3]]),
        ("z", X, 1j * np.ones((9, 9))),
        ("z", X, None),
    ],
)
def test_heights(argument, x, z):
    refused(argument, "", Surface.from_heights, x, X, z)


def test_heights_have_to_cover_the_domain():
    refused("domain", "Disk", Surface.from_heights, X, X, np.zeros((9, 9)), Disk(1.1))
    refused("side", "0", Surface.from_heights, X, X, np.zeros((9, 9)), side=0)
    Surface.from_heights(X, X, np.zeros((9, 9)), Disk(1.0))
