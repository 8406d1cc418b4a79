"""Fabrics from data sheets and from tests."""

import os
import pickle
from dataclasses import dataclass, replace

import matplotlib.pyplot as plt
import ngsolve as ngs
import numpy as np
import pytest

import ngcloth
from ngcloth import (
    BendingThreads,
    BiasExtension,
    Disk,
    Families,
    InputError,
    MeasuredFabric,
    Net,
    PictureFrame,
    Rectangle,
    Surface,
    Swollen,
    Turned,
)
from ngcloth.problem.kinematics import Kinematics

ROWS = 1000
FLAT = Surface(lambda x, y: (x, y, 0 * x), Disk())
LAWS = {
    "straight": lambda s: s,
    "crimped": lambda s: s**2,
    "locking": lambda s: 0.05 * s + s**6,
    "with friction": lambda s: 0.2 * np.tanh(s / 0.05) + 0.1 * s + s**5,
    "free, then stiff": lambda s: np.maximum(s - 0.6, 0) ** 2,
}


def strained(fabric, stretch1=1.0, stretch2=1.0, gamma=0.0):
    """W of numbers."""
    state = stretch1**2, stretch2**2, stretch1 * stretch2 * gamma
    energy = fabric.energy(*(ngs.Parameter(each) for each in state))
    return float(FLAT.evaluate(energy, np.zeros((1, 2)))[0])


def noisy(values, seed, level=0.02):
    return values * (1 + level * np.random.default_rng(seed).standard_normal(values.shape))


def angles(most=50.0, rows=ROWS):
    return np.linspace(0, most, rows + 1)[1:]


def linear(end=1.02, force=100.0, rows=20):
    stretch = np.linspace(1, end, rows)
    return np.column_stack([stretch, force * (stretch - 1) / (end - 1)])


def shear_table(law=LAWS["locking"], most=50.0, rows=ROWS):
    at = angles(most, rows)
    return np.column_stack([at, law(at / most)])


def test_moduli_are_those_of_small_strains():
    """Tension of one thread and shear, against E t e²/2 and G t φ²/2."""
    E, G, t, small = 70e3, 4e3, 0.3, 1e-4
    net = Net.from_moduli(E, G, t)
    assert net.ks / net.kc == pytest.approx(4 * G / E, rel=1e-12)
    assert strained(net, 1 + small) == pytest.approx(E * t * small**2 / 2, rel=2e-4)
    assert strained(net, gamma=np.sin(small)) == pytest.approx(G * t * small**2 / 2, rel=1e-6)
    unequal = Net.from_moduli((E, E / 2), G, t)
    assert strained(unequal, 1, 1 + small) == pytest.approx(E / 2 * t * small**2 / 2, rel=2e-4)
    for wrong in ({"E": 0}, {"E": (1.0, -1.0)}, {"G": -1}, {"thickness": 0}):
        with pytest.raises(InputError):
            Net.from_moduli(**({"E": E, "G": G, "thickness": t} | wrong))


@pytest.mark.parametrize("law", LAWS)
@pytest.mark.parametrize("seed", range(3))
def test_a_law_comes_back_from_noisy_tables(law, seed):
    """Stress and energy to 1 % of the greatest in the range, from rows with 2 % of noise."""
    f, end, most = LAWS[law], 0.03, 50.0
    strain, at = np.linspace(0, end, ROWS + 1)[1:], angles(most)
    gamma, reach = np.sin(np.radians(at)), np.sin(np.radians(most))
    thread = np.column_stack([1 + strain, noisy(f(strain / end), seed)])
    shear = np.column_stack([at, noisy(f(gamma / reach), seed + 100)])
    fabric = MeasuredFabric(warp=thread, weft=thread, shear=shear)
    warp, _, shear = fabric.curves.values()
    s = np.linspace(0, 1, 2001)
    true, stretch = f(s), 1 + end * s
    energy = np.append(0, np.cumsum((true[1:] + true[:-1]) / 2)) * s[1]
    tension = 2 * stretch * warp.force(stretch**2 - 1)
    for force in (tension, shear.force(reach * s)):
        assert np.abs(force - true).max() < 0.01 * true.max()
    for work, length in ((warp.energy(stretch**2 - 1), end), (shear.energy(reach * s), reach)):
        assert np.abs(work - length * energy).max() < 0.01 * length * energy.max()


def frame_record(law, seed, arm=200.0, side=150.0):
    """A picture frame's displacements and forces, by the power of a square of fabric."""
    phi = np.radians(angles())
    displacement = 2 * arm * np.cos(np.pi / 4 - phi / 2) - np.sqrt(2) * arm
    speed = arm * np.sin(np.pi / 4 - phi / 2)
    force = law(np.sin(phi)) * np.cos(phi) * side**2 / speed
    return PictureFrame(np.column_stack([displacement, noisy(force, seed)]), arm, side)


def strip_record(law, seed, length=300.0, width=100.0):
    """A bias extension's, by differences of the energy of its three zones."""
    phi = np.radians(angles())

    def energy(gamma):
        s = np.linspace(0, 1, 4001)
        values = law(s)
        whole = np.append(0, np.cumsum((values[1:] + values[:-1]) / 2)) * s[1]
        return np.interp(gamma, s, whole)

    def stored(phi):
        middle, half = (2 * length - 3 * width) * width / 2, width**2
        return middle * energy(np.sin(phi)) + half * energy(np.sin(phi / 2))

    def clamp(phi):
        return np.sqrt(2) * (length - width) * np.cos(np.pi / 4 - phi / 2) - (length - width)

    step = 1e-3
    force = (stored(phi + step) - stored(phi - step)) / (clamp(phi + step) - clamp(phi - step))
    return BiasExtension(np.column_stack([clamp(phi), noisy(force, seed)]), length, width)


@pytest.mark.parametrize("make", [frame_record, strip_record])
@pytest.mark.parametrize("seed", range(3))
def test_raw_records_give_the_law_of_the_fabric(make, seed):
    """Records made from the energies of the specimens, with 2 % of noise in the force."""

    def law(gamma):
        return 0.02 * np.tanh(gamma / 0.04) + 0.1 * gamma + 0.8 * gamma**5

    fabric = MeasuredFabric(warp=linear(), weft=linear(), shear=make(law, seed))
    gamma = np.linspace(0, np.sin(np.radians(50)), 500)
    found = fabric.curves["shear"].force(gamma)
    assert np.abs(found - law(gamma)).max() < 0.012 * law(gamma).max()


def test_a_curve_never_collapses_beyond_its_rows():
    """Forces rise, and their slope is at least the last of the data; below rest as at rest."""
    fabric = MeasuredFabric(
        warp=linear(), weft=linear(1.01, 20.0), shear=shear_table(LAWS["free, then stiff"])
    )
    for curve in fabric.curves.values():
        end, step = curve.end, 1e-3 * curve.end
        slopes = np.diff(curve.force(np.arange(end - step, 3 * end, step))) / step
        assert slopes.min() >= 0.999 * slopes[0] > 0
    warp, shear = fabric.curves["warp"], fabric.curves["shear"]
    assert warp.force(-0.5) == pytest.approx(-0.5 * 100 / 0.02 / 4, rel=2e-2)
    assert shear.force(-0.7) == pytest.approx(-shear.force(0.7), rel=1e-9)
    gamma = np.linspace(-0.999, 0.999, 999)
    assert np.diff(shear.force(gamma)).min() > -1e-12


def test_energy_is_the_work_of_the_tests_as_an_expression():
    """At states within and beyond the tests, NGSolve's expression is the sum of three works."""
    fabric = MeasuredFabric(warp=linear(), weft=linear(1.01, 20.0), shear=shear_table())
    warp, weft, shear = fabric.curves.values()
    for stretch1, stretch2, gamma in [(1.01, 1.005, 0.3), (0.8, 1.3, -0.95), (1.6, 0.5, 0.0)]:
        expected = warp.energy(stretch1**2 - 1) + weft.energy(stretch2**2 - 1)
        expected += shear.energy(stretch1 * stretch2 * gamma)
        assert strained(fabric, stretch1, stretch2, gamma) == pytest.approx(expected, rel=1e-12)
    assert fabric.stiffness == pytest.approx((100 / 0.02 + 20 / 0.01) / 2 / 8, rel=3e-2)


def test_files_pickles_and_words(tmp_path):
    file = tmp_path / "shear.csv"
    table = shear_table(rows=60)
    np.savetxt(file, table, delimiter=",", header="angle,force", comments="")
    fabric = MeasuredFabric(warp=linear(), weft=linear(), shear=file)
    same = MeasuredFabric(warp=linear(), weft=linear(), shear=table)
    again = pickle.loads(pickle.dumps(fabric))
    for each in (same, again):
        assert strained(each, 1.01, 1.0, 0.4) == pytest.approx(strained(fabric, 1.01, 1.0, 0.4))
    assert "shear to 50°" in str(fabric) and "λ = 1.02" in str(fabric)
    said = " ".join(fabric.undetermined)
    assert "beyond 50°" in said and "beyond λ = 1.02" in said and "at once" in said
    late = MeasuredFabric(warp=linear(), weft=linear(), shear=table[20:])
    assert any("below" in each and "°" in each for each in late.undetermined)


def test_the_fit_is_drawn_over_the_rows():
    fabric = MeasuredFabric(warp=linear(), weft=linear(), shear=strip_record(LAWS["locking"], 0))
    axes = fabric.plot()
    rows, fit, beyond = axes[2].lines
    assert rows.get_xdata()[-1] == pytest.approx(50) and fit.get_xdata()[-1] == pytest.approx(50)
    missed = np.interp(rows.get_xdata(), *fit.get_data()) - rows.get_ydata()
    assert np.sqrt(np.mean(missed**2)) < 0.02 * fit.get_ydata().max()
    assert beyond.get_xdata()[-1] > 52
    plt.close(axes[0].figure)


def cap(x, y):
    return x, y, -0.3 * x**2 - 0.4 * y**2


def row(table, number, *values):
    table = np.array(table)
    table[number] = values
    return table


BAD = [
    ({"warp": linear(rows=2)}, "warp", "5 or more rows"),
    ({"warp": row(linear(), 7, 1.0, 5.0)}, "warp[7]", "above that of the row before"),
    ({"weft": row(linear(), 15, linear()[15, 0], 10.0)}, "weft[15]", "forces that rise"),
    ({"weft": row(linear(), 3, linear()[3, 0], -30.0)}, "weft[3]", "0 or more"),
    ({"weft": row(linear(), 3, linear()[3, 0], np.nan)}, "weft[3]", "finite"),
    ({"warp": linear() - [1, 0]}, "warp[0]", "not strains"),
    ({"warp": linear() * [100, 1]}, "warp[0]", "not in percent"),
    ({"warp": linear() * [1, 0]}, "warp[0]", "above 0"),
    ({"warp": linear()[:, 0]}, "warp", "(n, 2)"),
    ({"warp": "no such file.csv"}, "warp", "can be read"),
    ({"warp": [["a", "b"]] * 6}, "warp", "numbers"),
    ({"shear": shear_table() * [np.pi / 180, 1]}, "shear[999]", "not radians"),
    ({"shear": shear_table(most=120)}, "shear[741]", "degrees, at most 89"),
    ({"shear": shear_table() * [1, 1e9]}, "shear[999]", "unit of warp and weft"),
    ({"shear": PictureFrame([[k, k] for k in range(9)], arm=0.2)}, "shear[1]", "size allows"),
    ({"shear": PictureFrame([[k, k] for k in range(9)], arm=1e6)}, "shear[8]", "unit of the spec"),
    ({"shear": PictureFrame(linear(), arm=100, side=120)}, "shear.side", "<= 100"),
    ({"warp": linear(force=1e-300)}, "warp[19]", "the unit of the weft"),
    ({"shear": BiasExtension(linear(), length=150, width=100)}, "shear.length", "200"),
]


@pytest.mark.parametrize(("given", "argument", "allowed"), BAD)
def test_what_no_test_can_have_measured(given, argument, allowed):
    """Refused with row and value."""
    good = {"warp": linear(), "weft": linear(), "shear": shear_table()}
    with pytest.raises(InputError) as error:
        MeasuredFabric(**(good | given))
    assert error.value.argument == argument
    assert allowed in error.value.allowed


def test_files_are_refused_by_line(tmp_path):
    file = tmp_path / "warp.csv"
    file.write_text("stretch,force\n1,0\n1.01,3\n1.02;5\n")
    with pytest.raises(InputError) as error:
        MeasuredFabric(warp=file, weft=linear(), shear=shear_table())
    assert error.value.argument == "warp, line 4 of warp.csv"
    assert error.value.value == "1.02;5"


@pytest.mark.parametrize(
    "text",
    [
        "stretch;force\n1,00;0,0\n1,01;2,5\n",
        "1,00,0,0\n1,01,2,5\n",
        "1\t0\n1.01\t2.5\n",
        "x" * 200_000 + ",1\n",
        "",
    ],
)
def test_files_of_other_programs_are_refused(text, tmp_path):
    """With semicolons, decimal commas, tabs, a cell that no reader takes, or nothing."""
    file = tmp_path / "warp.csv"
    file.write_text(text)
    with pytest.raises(InputError, match="warp"):
        MeasuredFabric(warp=file, weft=linear(), shear=shear_table())


def test_a_pipe_is_no_table(tmp_path):
    """Nobody may ever write to it."""
    os.mkfifo(tmp_path / "warp.csv")
    with pytest.raises(InputError, match="no plain file"):
        MeasuredFabric(warp=tmp_path / "warp.csv", weft=linear(), shear=shear_table())


def test_a_path_that_is_none():
    with pytest.raises(InputError, match="can be read"):
        MeasuredFabric(warp="a\0b", weft=linear(), shear=shear_table())


def test_a_result_of_a_measured_fabric_is_saved_and_loaded(tmp_path):
    """The same fabric is known again, and another one refused."""
    dome = Surface(cap, Disk())
    table = shear_table(LAWS["straight"])
    fabric = MeasuredFabric(warp=linear(), weft=linear(), shear=table)
    scene = ngcloth.Scene(dome, fabric, [ngcloth.Elongation()], symmetric=True)
    result = ngcloth.solve(scene, maxh=0.4)
    assert result.converged
    result.save(tmp_path / "dome")
    assert ngcloth.load(tmp_path / "dome", scene).energy == pytest.approx(result.energy)
    assert pickle.loads(pickle.dumps(result)).energy == pytest.approx(result.energy)
    stiffer = MeasuredFabric(warp=linear(), weft=linear(), shear=table * [1, 1.1])
    other = ngcloth.Scene(dome, stiffer, [ngcloth.Elongation()], symmetric=True)
    with pytest.raises(InputError):
        ngcloth.load(tmp_path / "dome", other)


STATES = [(1.1, 0.9, 0.3), (1.3, 1.2, -0.6), (1.0, 1.0, 0.0)]


@pytest.mark.parametrize("state", STATES)
def test_families_at_right_angles_are_a_net(state):
    net = Net(kc=(2.0, 0.5), ks=3.0)
    same = [Families((0, 90), kc=(2.0, 0.5), ks=3.0), Turned(Turned(net, 35), -35)]
    swapped = [Turned(Net(kc=(0.5, 2.0), ks=3.0), 90), Families((90, 0), kc=(0.5, 2.0), ks=3.0)]
    for fabric in (*same, *swapped):
        assert strained(fabric, *state) == pytest.approx(strained(net, *state), rel=1e-12)
    bias = Turned(Net(ks=3.0), 45), Families((45, -45), ks=3.0)
    one, other = (strained(fabric, *state) for fabric in bias)
    assert one == pytest.approx(other, rel=1e-12, abs=1e-15)


def test_stretch_along_a_flat_direction_is_that_of_the_map():
    """Of the deformation F with C = Fᵀ F, |F t| for any t."""
    rng = np.random.default_rng(0)
    deformation, angle = np.eye(2) + 0.2 * rng.standard_normal((2, 2)), 25.0
    green = deformation.T @ deformation
    triaxial = Families((angle, angle + 60, angle + 120), kc=(1.0, 2.0, 3.0))
    expected = 0
    for k, each in zip(triaxial.kc, triaxial.angles, strict=True):
        t = np.array([np.cos(np.radians(each)), np.sin(np.radians(each))])
        expected += k * (np.linalg.norm(deformation @ t) ** 2 - 1) ** 2
    stretch = np.sqrt(np.diag(green))
    energy = strained(triaxial, *stretch, green[0, 1] / stretch.prod())
    assert energy == pytest.approx(expected, rel=1e-12)


def sphere_cap(x, y):
    return x, y, ngs.sqrt(2.25 - x**2 - y**2)


def test_a_round_dome_does_not_tell_how_cloth_is_turned():
    """On a cap the patch of a net laid at 45° is that of the net, turned: E and limits."""
    found = []
    for fabric in (Net(ks=1.0), Turned(Net(ks=1.0), 45)):
        limits = [ngcloth.Elongation(), ngcloth.ShearLimit(0.5)]
        scene = ngcloth.Scene(Surface(sphere_cap, Disk()), fabric, limits, symmetric=True)
        found.append(ngcloth.solve(scene, maxh=0.25))
    net, turned = found
    assert net.converged and turned.converged
    assert turned.energy == pytest.approx(net.energy, rel=1e-2)  # the mesh is not turned
    for name in ("stretch1", "shear"):
        assert np.abs(turned.extrema[name]) == pytest.approx(np.abs(net.extrema[name]), abs=5e-3)
    r = np.linspace(0, 0.9, 5)
    along = r / np.sqrt(2)
    assert turned.field("stretch1", along, along) == pytest.approx(
        net.field("stretch1", r, 0 * r), abs=6e-3
    )


def test_three_families_stay_taut_and_are_drawn():
    fabric = Families((0, 60, 120))
    scene = ngcloth.Scene(
        Surface(sphere_cap, Disk()), fabric, [ngcloth.Elongation()], symmetric=True
    )
    result = ngcloth.solve(scene, maxh=0.3)
    assert result.converged
    least = [result.extrema[f"stretch{k}"][0] for k in (1, 2, 3)]
    assert min(least) > 0.995
    axes = result.plot()
    lines = [contours.get_paths()[0].vertices for contours in axes.collections]
    found = [np.degrees(np.arctan2(*(line[-1] - line[0])[::-1])) % 180 for line in lines]
    assert found == pytest.approx([0, 60, 120], abs=3) or found == pytest.approx(
        [180, 60, 120], abs=3
    )
    plt.close(axes.figure)
    for export in (result.export_svg, result.export_threads):
        with pytest.raises(InputError):
            export("never.svg" if export == result.export_svg else "never.vtp")


@pytest.mark.parametrize(
    ("make", "argument"),
    [
        (lambda: Families((0,)), "angles"),
        (lambda: Families((0, 180)), "angles"),
        (lambda: Families((0, 60, 120), kc=(1.0, 2.0)), "kc"),
        (lambda: Turned(Net(), np.nan), "angle"),
    ],
)
def test_families_that_cannot_be(make, argument):
    with pytest.raises(InputError) as error:
        make()
    assert error.value.argument == argument


def test_angles_of_a_fabric_of_ones_own_are_checked():
    net = Net(ks=1.0)
    object.__setattr__(net, "angles", (0, "90"))
    with pytest.raises(InputError) as error:
        ngcloth.Scene(Surface(cap, Disk()), net)
    assert error.value.argument == "fabric.angles"


def test_threads_that_bend_leave_the_hoop_without_limits():
    """Along the hoop is stationary, and costs B/2R² per area; at 45° it is half of that."""
    tube = Surface(lambda x, y: (ngs.sin(x), y, ngs.cos(x)), Disk())
    fabric = BendingThreads(Net(kc=100.0, ks=100.0), 1.0)
    result = ngcloth.solve(ngcloth.Scene(tube, fabric), maxh=0.4)
    assert result.converged and result.energy == pytest.approx(np.pi / 4, rel=5e-3)


def domed(X1, X2):
    """The stretches of the plane by which the sphere covers it stereographically."""
    growth = 2 / (1 + X1**2 + X2**2)
    return growth, growth


@pytest.mark.parametrize("symmetric", [True, False])
def test_a_flat_disk_that_swells_becomes_a_hemisphere(symmetric):
    """It needs no limit and no stress: E = 0, λ = g and γ = 0, from a start that is neither."""
    fabric = Swollen(Net(ks=1.0), domed)
    scene = ngcloth.Scene(
        ngcloth.scenes.hemisphere().surface, fabric, symmetric=symmetric, start=(0.8, 0.9)
    )
    result = ngcloth.solve(scene, maxh=0.4, order=3)
    assert result.converged and result.newton_iterations < 12
    assert result.normalized_energy < 1e-20
    radius = np.linalg.norm(result.outline(60), axis=1)
    assert radius == pytest.approx(np.ones(60), abs=1e-4)
    theta = np.array([[0.0, 0.0], [0.3, 0.4], [0.0, -0.9]])
    growth = 2 / (1 + (theta**2).sum(axis=1))
    assert result.field("stretch1", *theta.T) == pytest.approx(growth, rel=1e-6)
    certificate = result.certificate()
    assert certificate.certified and certificate.curvature > (0.5 if symmetric else -1e-9)


def test_growth_by_numbers_is_a_change_of_lengths():
    """Cloth that has grown by (1.2, 1.1) is at rest there, and covers a cylinder so."""
    net = Net(kc=(1.0, 2.0), ks=3.0)
    swollen = Swollen(net, (1.2, 1.1))
    assert strained(swollen, 1.2 * 1.05, 1.1 * 0.9, 0.2) == pytest.approx(
        strained(net, 1.05, 0.9, 0.2), rel=1e-12
    )
    cylinder = Surface(lambda x, y: (ngs.sin(x), y, ngs.cos(x)), Rectangle((-1, 1), (-1, 1)))
    result = ngcloth.solve(ngcloth.Scene(cylinder, swollen), maxh=1.0)
    assert result.area == pytest.approx(4 / (1.2 * 1.1), rel=1e-9)
    for wrong in ((1.0, 0.0), (1.0,), 2.0):
        with pytest.raises(InputError):
            Swollen(net, wrong)


def test_the_least_angle_is_that_of_any_two_families():
    """The first two families are at right angles on a cylinder, the third is at 45° to both."""
    tube = Surface(lambda x, y: (ngs.sin(x), y, ngs.cos(x)), Disk())
    result = ngcloth.solve(ngcloth.Scene(tube, Families((0, 90, 45))), maxh=0.6)
    assert np.abs(result.extrema["shear"]).max() < 1e-3
    assert result.largest_shear == pytest.approx(np.sqrt(0.5), abs=1e-3)
    assert "threads at 45.0° or more" in str(result)


GRADED = Swollen(Net(), lambda X1, X2: (1 + 0.1 * ngs.sin(X1), 1.0))


@pytest.mark.parametrize(
    "make",
    [
        lambda: Turned(GRADED, 30),
        lambda: Turned(BendingThreads(Net(), 1.0), 30),
        lambda: Turned(None, 30),
        lambda: Turned(Net, 30),
        lambda: Swollen(GRADED, (1.1, 1.0)),
        lambda: Swollen(BendingThreads(Net(), 1.0), (1.1, 1.0)),
        lambda: BendingThreads(BendingThreads(Net(), 1.0), 1.0),
    ],
)
def test_fabrics_that_hold_no_other(make):
    """Place and curvature are not handed on."""
    with pytest.raises(InputError, match="does not depend on curvature") as error:
        make()
    assert error.value.argument == "fabric"


def test_growth_beyond_reason():
    for growth in ((1e300, 1.0), (1.0, 1e-300)):
        with pytest.raises(InputError, match="growth = 1e"):
            Swollen(Net(), growth)


@pytest.mark.parametrize(
    ("growth", "allowed"),
    [
        (lambda X1, X2: (1 + 0.1 * X1,), "must return a pair"),
        (lambda X1, X2: 1 + 0.1 * X1, "must return a pair"),
        (lambda X1, X2: (ngs.IfPos(X1, 1.0, 1.2), 1.0), "derivatives"),
        (lambda X1, X2: (1 + 0.1 * ngs.sqrt(X2 * X2), 1.0), "derivatives"),
    ],
)
def test_growth_that_cannot_be(growth, allowed):
    """One number for two, and steps and kinks in the cloth, along which no state changes."""
    with pytest.raises(InputError) as error:
        ngcloth.Scene(Surface(cap, Disk()), Swollen(Net(ks=1.0), growth))
    assert error.value.argument == "fabric" and allowed in error.value.allowed


def test_cloth_that_grows_without_bound_holds_no_patch():
    """The farther from X = 0, the smaller the patch and its energy: there is no optimum."""
    fabric = Swollen(Net(ks=1.0), lambda X1, X2: (1 + 0.05 * X1, 1.0))
    result = ngcloth.solve(ngcloth.Scene(Surface(cap, Disk()), fabric), maxh=0.6, order=2)
    assert result.reason is ngcloth.Reason.ADRIFT and result.newton_iterations < 100
    assert np.abs(result.psi(0.0, 0.0)).max() > 100


def test_cloth_that_grows_within_bounds_is_covered_where_that_costs_least():
    """Threads that are longest where sin 2X1 = 1."""
    fabric = Swollen(Net(ks=1.0), lambda X1, X2: (1 + 0.1 * ngs.sin(2 * X1), 1.0))
    result = ngcloth.solve(ngcloth.Scene(Surface(cap, Disk()), fabric), maxh=0.6, order=2)
    assert result.converged
    assert result.psi(0.0, 0.0)[0] == pytest.approx(np.pi / 4, abs=0.02)


@dataclass(frozen=True)
class Zones:
    """A net with a soft middle."""

    of_place, stiffness = True, 1.0

    def energy(self, I4, I6, I8, X1, X2):
        return (1 - 0.8 * ngs.exp(-8 * (X1**2 + X2**2))) * ((I4 - 1) ** 2 + (I6 - 1) ** 2 + I8**2)


def test_a_soft_middle_takes_the_strain_in_equilibrium(tmp_path):
    """With taut threads, and in equilibrium with what pulls where the stiffness changes."""
    dome = Surface(cap, Disk())
    scene = ngcloth.Scene(dome, Zones(), [ngcloth.Elongation()], symmetric=True)
    result = ngcloth.solve(scene, maxh=0.35, order=3, barrier_end=1e-4)
    even = ngcloth.solve(replace(scene, fabric=Net(ks=1.0)), maxh=0.35, order=3, barrier_end=1e-4)
    assert result.converged and result.settings["linearisation"] == "automatic"
    assert result.certificate().certified
    assert result.energy < 0.9 * even.energy
    result.save(tmp_path / "zones")
    assert ngcloth.load(tmp_path / "zones", scene).energy == pytest.approx(result.energy)


def turned_by(degrees):
    """A start that lays the warp at an angle to θ1."""
    c, s = np.cos(np.radians(degrees)), np.sin(np.radians(degrees))
    return lambda x, y: (c * x + s * y, c * y - s * x)


def cylinder(x, y):
    return ngs.sin(x / 2) * 2, y, ngs.cos(x / 2) * 2


def density(surface, fabric, start, theta):
    """W at a point under a start."""
    psi = start(ngs.x, ngs.y)
    slopes = ngs.CF(tuple(p.Diff(t) for p in psi for t in (ngs.x, ngs.y)), dims=(2, 2))
    cloth = Kinematics(slopes, surface.metric, fabric, lambda: surface.curvature)
    return float(surface.evaluate(cloth.energy, np.array([theta]))[0])


@pytest.mark.parametrize("degrees", [0, 20, 45, 70, 90])
def test_threads_bent_around_a_cylinder(degrees):
    """At an angle α to the hoop κ is cos²α/R and sin²α/R, and the twist sin α cos α/R."""
    B1, B2, D, R = 2.0, 3.0, 5.0, 2.0
    fabric = BendingThreads(Net(ks=1.0), (B1, B2), D)
    surface = Surface(cylinder, Disk(1.0))
    found = density(surface, fabric, turned_by(degrees), (0.3, -0.2))
    c, s = np.cos(np.radians(degrees)), np.sin(np.radians(degrees))
    expected = (B1 * c**4 + B2 * s**4) / 2 / R**2 + D * (s * c) ** 2 / R**2
    assert found == pytest.approx(expected, rel=1e-9)
    along_hoop = BendingThreads(Turned(Net(ks=1.0), -degrees), (B1, B2), D)
    straight = density(surface, along_hoop, turned_by(degrees), (0.3, -0.2))
    assert straight == pytest.approx(B1 / 2 / R**2, rel=1e-9)


def test_on_a_sphere_bending_adds_a_constant():
    """Whatever the state: all normal curvatures are 1/R."""
    net, B, R = Net(kc=(1.0, 2.0), ks=3.0), 0.7, 1.5
    surface = Surface(sphere_cap, Disk(1.0))

    def state(x, y):
        return x + 0.2 * x * y, 0.9 * y - 0.1 * x

    bent, unbent = (
        density(surface, fabric, state, (0.4, 0.5)) for fabric in (BendingThreads(net, B), net)
    )
    assert bent - unbent == pytest.approx(B / R**2, rel=1e-9)


@pytest.mark.parametrize(("twist", "angle"), [(0.0, 45), (0.08, 0)])
def test_bending_turns_the_cloth_on_a_cylinder(twist, angle):
    """Threads lie where they bend least: at 45°, if twist is cheap, else along the axis."""
    B, R = 0.02, 2.0
    fabric = BendingThreads(Net(ks=1.0), B, twist)
    surface = Surface(cylinder, Disk(1.0))
    result = ngcloth.solve(ngcloth.Scene(surface, fabric, start=turned_by(30)), maxh=0.7)
    assert result.converged
    warp = np.degrees(np.arctan2(*result.slopes(np.zeros((1, 2)))[0, ::-1, 0]))
    assert abs(warp) == pytest.approx(angle, abs=1e-3)
    least = np.pi * (B / 4 if angle else B / 2) / R**2
    assert result.energy == pytest.approx(least, rel=2e-3)  # threads stretch a little for it
    certificate = result.certificate()
    assert certificate.certified
    # That of the energy by the angle, over the square of the seminorm of turning.
    assert certificate.curvature == pytest.approx(abs(B - twist) / R**2, rel=2e-2)


def test_bending_that_cannot_be():
    for wrong in ((1.0, 2.0, 3.0), -1.0):
        with pytest.raises(InputError):
            BendingThreads(Net(), wrong)
    with pytest.raises(InputError) as error:
        ngcloth.Scene(Surface(cap, Disk()), BendingThreads(Net(ks=1.0), 0.1), [ngcloth.Obstacle()])
    assert "Laplace" in error.value.allowed
