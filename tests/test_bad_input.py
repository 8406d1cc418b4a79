"""Whatever a solve cannot work with is refused by name, with its value, before any mesh is made."""

import pickle
import sys

import ngsolve as ngs
import numpy as np
import pytest
from netgen.occ import Circle, MoveTo, OCCGeometry

import ngcloth
from ngcloth import Disk, InputError, Net, Rectangle, Scene, Surface

NAN, INF = float("nan"), float("inf")
SPHERE = ngcloth.scenes.hemisphere().surface


@pytest.fixture(autouse=True)
def no_mesh(monkeypatch):
    def make(*arguments, **options):
        raise AssertionError("a mesh was about to be made")

    monkeypatch.setattr(OCCGeometry, "GenerateMesh", make)
    monkeypatch.setattr(sys.modules["ngcloth.solver.solve"], "make_mesh", make)


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
    "order": [0, -1, 2.0, 1.5, NAN, True, "2", None],
    "quadrature": [1, -3, 6.0, True, "6"],
    "tolerance": [0, -1e-6, NAN, INF, True, "tight", None],
    "max_steps": [0, -5, 10.0, True, "many", None],
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


@pytest.mark.parametrize("scene", [None, "hemisphere", ngcloth.scenes.hemisphere, SPHERE, Scene])
def test_scene(scene):
    refused("scene", repr(scene), ngcloth.solve, scene)


@pytest.mark.parametrize("ks", [-1, -1e-9, NAN, INF, True, "soft", None, (1, 2)])
def test_ks(ks):
    refused("ks", repr(ks), Net, ks=ks)
    refused("ks", repr(ks), ngcloth.scenes.hemisphere, ks)
    refused("ks", repr(ks), ngcloth.scenes.hemicatenoid, ks=ks)


@pytest.mark.parametrize(
    "kc, culprit",
    [(bad, bad) for bad in (0, -1, NAN, INF, True, "stiff", None, [1, 2], (), (1.0,), (1, 2, 3))]
    + [((1.0, 0.0), 0.0), ((NAN, 1.0), NAN), ((-2.0, 1.0), -2.0), ((True, 1.0), True)],
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


@pytest.mark.parametrize("n", [0, -3, 2.5, True, "all", None])
def test_rim(n):
    for domain in (Disk(), Rectangle((0, 1), (0, 1))):
        refused("n", repr(n), domain.rim, n)


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
