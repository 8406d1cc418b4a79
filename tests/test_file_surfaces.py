"""Patches of surfaces from files: CAD parts and facets, against charts of the same shape."""

import ast
import pickle
import sys
from dataclasses import replace

import ngsolve as ngs
import numpy as np
import pytest
import pyvista as pv
from geometry import shapes
from svgelements import SVG, Path

import ngcloth
from ngcloth import (
    Disk,
    Elongation,
    InputError,
    Net,
    Obstacle,
    Scene,
    ShearLimit,
    Surface,
    scenes,
    solve,
)
from ngcloth import __main__ as cli
from ngcloth.chebyshev import ChebyshevNet
from ngcloth.result.certificate import check_limits
from ngcloth.result.reading import plain_arrays
from ngcloth.result.save import CHECKSUMS, _packed, checksum

HEMISPHERE = 0.1842  # E/(2π kc) of taut cloth, ks = kc, by charts
TAUT = Net(ks=1.0), [Elongation()]


@pytest.fixture(scope="module")
def part(tmp_path_factory):
    path = tmp_path_factory.mktemp("parts") / "hemisphere.step"
    shapes.hemisphere().WriteStep(str(path))
    return Surface.from_cad(path, "dome")


@pytest.fixture(scope="module")
def result(part):
    return solve(Scene(part, *TAUT, name="dome", warp=(1, 0, 0)), maxh=0.2)


def test_hemisphere_of_one_face(result):
    """Its seam and its pole lie inside; two meshes, one a refinement of the other."""
    assert result.converged and result.newton_iterations <= 50
    assert result.history[0].phase == "coarse"
    assert result.normalized_energy == pytest.approx(HEMISPHERE, abs=2e-3)
    low, high = result.extrema["stretch1"]
    assert low > 0.995 and high == pytest.approx(1.23, abs=0.01)
    assert result.area == pytest.approx(5.446, abs=0.01)
    # Taut threads are shorter than the half circle that the longest of them covers.
    assert np.ptp(result.outline(), axis=0).max() < np.pi


def test_a_cost_of_ones_own(part):
    """Twice the energy has the same minimum as the energy."""
    free, costly = (
        solve(Scene(part, Net(ks=1.0), cost=cost), maxh=0.8, order=2)
        for cost in (None, lambda cloth: 2.0 * cloth.energy)
    )
    assert costly.converged and costly.energy == pytest.approx(free.energy, rel=1e-4)


@pytest.mark.slow
def test_hemisphere_by_default(part):
    """Nothing holds its direction: the patch turns at next to no cost, and takes its time."""
    result = solve(Scene(part, *TAUT))
    assert result.converged and result.newton_iterations <= 200
    assert result.normalized_energy == pytest.approx(HEMISPHERE, abs=3e-4)


def test_points_of_the_rim_and_beyond(result):
    rim = result.domain.rim(50)
    assert result.domain.contains(rim).all()
    there = result.evaluate(result.sheet.position, rim)
    assert np.abs(there[:, 2]).max() < 1e-3 and np.linalg.norm(there, axis=1).min() > 0.999
    assert result.psi(*rim.T) == pytest.approx(result.outline(50))
    assert result.psi(*(0.999 * rim).T) == pytest.approx(result.outline(50), abs=5e-3)
    with pytest.raises(InputError, match="theta"):
        result.psi(*(1.01 * rim).T)


def test_certificate_of_a_chebyshev_net(part, capfd):
    """Nothing is imposed: the optimum has no energy, and ψ alone says whether it was found."""
    result = solve(Scene(part, Net()), maxh=0.5, order=3)
    assert result.converged and result.normalized_energy < 1e-4
    certificate = result.certificate()
    assert certificate.unfolded and certificate.overlap is None
    assert certificate.stationarity < certificate.stationarity_tolerance
    assert certificate.curvature > -certificate.curvature_tolerance
    assert not capfd.readouterr().out  # NGSolve's complaints


def test_certificate_with_limits(part):
    result = solve(Scene(part, *TAUT), maxh=0.3, quadrature=10)
    certificate = result.certificate()
    assert certificate.stationarity < certificate.stationarity_tolerance
    assert certificate.equilibrium < 0.05 and certificate.unfolded
    assert certificate.curvature > certificate.curvature_tolerance
    assert "a minimum, strict on this mesh" in certificate.findings[2]


def hat_chart(slope=np.pi / 4, fillet=0.3, flange=0.4):
    """The part of `shapes.hat` as a height over the plane."""
    sine, cosine = np.sin(slope), np.cos(slope)
    outer, centre = (1 + fillet) * sine, (1 + fillet) * cosine

    def root(square):
        return ngs.sqrt(ngs.IfPos(square, square, 1.0))

    def chart(x, y):
        square = x * x + y * y
        along = ngs.sqrt(square + 1e-30) - outer
        round_edge = centre - root(fillet**2 - along**2)
        lower = ngs.IfPos(outer**2 - square, round_edge, centre - fillet)
        return x, y, ngs.IfPos(sine**2 - square, root(1 - square), lower)

    return Surface(chart, Disk(outer + flange))


@pytest.mark.slow
def test_dome_fillet_and_flange(tmp_path):
    """Three faces that join smoothly: the mesh follows their edges, the chart's does not."""
    shapes.hat()[0].WriteStep(str(tmp_path / "hat.step"))
    hat = Surface.from_cad(tmp_path / "hat.step")
    file, chart = (
        solve(Scene(surface, *TAUT), maxh=maxh).normalized_energy
        for surface, maxh in ((hat, 0.2), (hat_chart(), 0.06))
    )
    assert hat.faces == 3
    assert file == pytest.approx(chart, abs=2e-4)


def test_coarser_meshes_end_where_curvature_sets_their_size(tmp_path):
    """Triangles in the fillet are no larger at four times the size: refined, they would be many."""
    shapes.hat()[0].WriteStep(str(tmp_path / "hat.step"))
    hat = Surface.from_cad(tmp_path / "hat.step")
    coarse, fine = (sheet.mesh.ne for sheet in hat.sheets(0.1, 2, coarser=3))
    assert fine == 4 * coarse < 1600


@pytest.mark.slow
def test_a_double_dome(tmp_path):
    """Ten faces, rounded: curvature sets the mesh. With its direction given it is found at once."""
    shapes.double_dome().WriteStep(str(tmp_path / "part.step"))
    part = Surface.from_cad(tmp_path / "part.step", lambda face: face.centre[2] > -0.01)
    assert part.faces == 10 and part.sharp == 0
    result = solve(Scene(part, *TAUT, warp=(1, 0, 0), at=(0, 0, 0.453)), maxh=1.0)
    assert result.converged and result.newton_iterations <= 40
    tangents = result.middle[2]  # of the mesh: that plane is half a degree off
    along = tangents @ np.linalg.lstsq(tangents, [1.0, 0.0, 0.0], rcond=None)[0]
    assert abs(result.warp @ along) / np.linalg.norm(along) == pytest.approx(1, abs=1e-12)
    assert abs(result.warp[1]) < 1e-4
    assert result.certificate().certified


def test_facets_give_the_energy_of_the_smooth_surface():
    scan = Surface.from_mesh(shapes.facets(40))
    result = solve(Scene(scan, *TAUT), maxh=0.12)
    assert result.converged
    assert result.normalized_energy == pytest.approx(HEMISPHERE, rel=1e-2)


def test_two_flattenings_of_one_file(part, monkeypatch):
    """The patch belongs to the surface; Tutte's embedding alone is a chart as good as another."""
    results = [solve(Scene(part, *TAUT), maxh=0.4, barrier_end=1e-4)]
    flattening = sys.modules["ngcloth.geometry.flatten"]
    monkeypatch.setattr(flattening, "_as_rigid_as_possible", lambda points, triangles, flat: flat)
    results.append(solve(Scene(part, *TAUT), maxh=0.4, barrier_end=1e-4))
    one, other = results
    assert np.abs(one.domain.rims[0] - other.domain.rims[0]).max() > 0.04
    assert other.normalized_energy == pytest.approx(one.normalized_energy, abs=1e-5)
    assert other.area == pytest.approx(one.area, rel=1e-4)


def test_units_and_sizes(tmp_path, part):
    """In cm the same part has other numbers for lengths, and the same energy over them."""
    shapes.hemisphere().WriteStep(str(tmp_path / "dome.step"))
    small = Surface.from_cad(tmp_path / "dome.step", "dome", unit="cm")
    one = solve(Scene(part, Net(ks=1.0)), maxh=0.4)
    other = solve(Scene(small, Net(ks=1.0)), maxh=0.04)
    assert other.energy == pytest.approx(one.energy / 100, rel=1e-4)


def test_the_side_of_the_cloth_bears_the_obstacle(tmp_path, part):
    """From outside a dome pushes everywhere; from inside it would have to pull."""
    shapes.hemisphere().WriteStep(str(tmp_path / "dome.step"))
    inner = Surface.from_cad(tmp_path / "dome.step", "dome", side=-1)
    outside, inside = (
        solve(Scene(surface, *TAUT), maxh=0.6).extrema["reaction"] for surface in (part, inner)
    )
    assert outside[1] > 3 > -1 < outside[0]
    assert inside[0] < -3


def test_what_a_file_cannot_have(tmp_path, part):
    noisy = Surface.from_mesh(shapes.facets(20, noise=1e-2))
    with pytest.raises(InputError, match="noise"):
        Scene(noisy, Net(ks=1.0), [Obstacle()])
    assert noisy.rough and Scene(noisy, Net(ks=1.0), [ShearLimit(0.9)])
    with pytest.raises(InputError, match="start"):
        Scene(part, Net(), start=(-1.0, 1.0))


def test_a_users_law_is_tried_as_on_charts(part):
    class Kinked(Net):
        def energy(self, i4, i6, i8):
            return super().energy(i4, i6, i8) + ngs.IfPos(i4 - 1.1, 1.0, 0.0)

    with pytest.raises(InputError, match="derivatives"):
        Scene(part, Kinked())


HOLE = 5 / 20  # of the quarter circle from the pole to the rim


@pytest.fixture(scope="module")
def holed():
    """A dome of 10 cm with a hole around its pole, from facets."""
    points, triangles = shapes.facets(20, hole=5)
    scan = Surface.from_mesh((10 * points, triangles), unit="cm")
    return solve(scenes.part(scan, ks=1.0), maxh=3.0)


def test_a_hole(holed):
    assert holed.converged and holed.domain.holes == 1
    rims = [holed.outline(200, hole) for hole in (0, 1)]
    one, other = (0.5 * np.linalg.det(np.stack([r, np.roll(r, -1, axis=0)], 1)).sum() for r in rims)
    assert one > 0 > other and one + other == pytest.approx(holed.area, rel=2e-3)
    edge = holed.evaluate(holed.sheet.position, holed.domain.rim(20, 1))
    assert edge[:, 2] == pytest.approx(10 * np.cos(np.pi / 2 * HOLE), abs=0.05)
    with pytest.raises(InputError, match="hole"):
        holed.outline(10, 2)
    assert not holed.domain.contains(np.zeros(2))


def test_pattern_with_a_hole(tmp_path, holed):
    """True to scale by itself: 1 cm of the file is 10 mm; the hole is cut, threads end there."""
    holed.export_svg(tmp_path / "cut.svg")
    holed.export_dxf(tmp_path / "cut.dxf", seam=5.0)
    layers = {group.id: group for group in SVG.parse(tmp_path / "cut.svg") if group.id}
    cut = [path for path in layers["cut"].select(lambda each: isinstance(each, Path))]
    sizes = sorted(np.ptp([(p.x, p.y) for p in path.as_points()], axis=0).max() for path in cut)
    mm = 96 / 25.4  # what the reader makes of one
    assert len(sizes) == 2
    assert sizes[1] / mm == pytest.approx(np.ptp(10 * holed.outline(), axis=0).max(), rel=1e-3)
    assert sizes[0] / mm == pytest.approx(
        np.ptp(10 * holed.outline(400, 1), axis=0).max(), rel=1e-3
    )


def test_fields_of_a_part(tmp_path, result):
    """Points lie on the sphere, threads tangent to it, cells look outwards."""
    result.export_vtu(tmp_path / "cloth.vtu")
    cloth = pv.read(tmp_path / "cloth.vtu")
    radial = cloth.points / np.linalg.norm(cloth.points, axis=1)[:, None]
    assert np.linalg.norm(cloth.points, axis=1) == pytest.approx(1, abs=1e-3)
    warp = cloth.point_data["warp"]
    assert np.abs(np.sum(warp * radial, axis=1)).max() < 0.03
    angle = cloth.point_data["angle"]
    assert np.sin(np.radians(angle)).max() == pytest.approx(result.extrema["shear"][1], abs=0.02)
    result.export_surface(tmp_path / "dome.stl")
    dome, flat = pv.read(tmp_path / "dome.stl"), pv.read(tmp_path / "dome_flat.stl")
    assert dome.area == pytest.approx(2 * np.pi, rel=1e-3)
    assert flat.area == pytest.approx(result.area, rel=1e-3)
    outwards = np.sum(dome.compute_normals().cell_data["Normals"] * dome.cell_centers().points, 1)
    assert outwards.min() > 0.9
    result.export_threads(tmp_path / "threads.vtp")
    threads, flat = pv.read(tmp_path / "threads.vtp"), pv.read(tmp_path / "threads_flat.vtp")
    assert np.linalg.norm(threads.points, axis=1) == pytest.approx(1, abs=1e-3)
    for line, weft, level in zip(
        *(range(flat.n_cells), *map(flat.cell_data.get, ("weft", "level"))), strict=True
    ):
        assert flat.get_cell(line).points[:, 1 - weft] == pytest.approx(level, abs=5e-5)


def test_pictures_of_a_part(tmp_path, holed):
    axes = holed.plot("shear")
    rim = holed.outline()
    assert len(axes.lines) == 2 and axes.get_xlim()[1] > rim[:, 0].max()
    assert axes.get_xlabel() == "$X_1$ [cm]"
    holed.plot(where="domain")
    holed.view("shear", screenshot=tmp_path / "view.png")
    ngcloth.report(holed, tmp_path / "report.html")
    assert (tmp_path / "view.png").stat().st_size > 10_000
    assert (tmp_path / "report.html").stat().st_size > 100_000
    assert "area of the flat patch [cm²]" in (tmp_path / "report.html").read_text()


def test_limits_are_missed_at_places_in_space(holed):
    for check in check_limits(holed):
        assert str(replace(check, slack=-0.2)) == f"elongation missed by 0.2 at {check.place}"
        numbers, unit = check.place.rsplit(" ", 1)
        assert np.linalg.norm(ast.literal_eval(numbers)) == pytest.approx(10, abs=0.05)
        assert unit == "cm"


def test_saved_with_the_surface(tmp_path, holed, part):
    """Of a named scene the folder is enough, whatever has become of the file."""
    holed.save(tmp_path / "holed")
    again = ngcloth.load(tmp_path / "holed")
    assert again.outline() == pytest.approx(holed.outline(), abs=1e-12)
    assert again.extrema == holed.extrema and str(again.scene) == str(holed.scene)
    solved = solve(scenes.part(part, ks=1.0), maxh=0.6)
    solved.save(tmp_path / "dome")
    assert ngcloth.load(tmp_path / "dome").energy == pytest.approx(solved.energy, rel=1e-12)
    with pytest.raises(InputError, match="surface"):
        ngcloth.load(tmp_path / "dome", holed.scene)


def test_a_scene_of_ones_own_is_given_again_or_pickled(tmp_path, result):
    result.save(tmp_path / "dome")
    with pytest.raises(InputError, match="functions"):
        ngcloth.load(tmp_path / "dome")
    assert ngcloth.load(tmp_path / "dome", result.scene).energy == result.energy
    again = pickle.loads(pickle.dumps(result))
    assert again.outline() == pytest.approx(result.outline(), abs=1e-12)


def test_goes_on_from_a_checkpoint(tmp_path, part):
    scene, settings = scenes.part(part, ks=1.0), {"maxh": 0.6, "checkpoint": tmp_path / "half"}
    begun = solve(scene, max_steps=4, **settings)
    assert not begun.converged
    resumed, whole = solve(scene, **settings), solve(scene, maxh=0.6)
    assert resumed.converged and resumed.energy == pytest.approx(whole.energy, rel=1e-9)
    assert resumed.history[0].newton == begun.history[0].newton


def test_command_line(tmp_path, capsys):
    shapes.hemisphere().WriteStep(str(tmp_path / "dome.STEP"))
    file, out = str(tmp_path / "dome.STEP"), tmp_path / "out"
    options = ["--ks", "1", "--maxh", "0.06", "--quiet", "--out", str(out)]
    assert cli.main([file, "--faces", "dome", "--unit", "cm", *options]) == 0
    assert {path.name for path in out.iterdir()} >= set(cli.FILES)
    loaded = ngcloth.load(out / "result")
    assert loaded.scene.surface.unit == "cm" and loaded.scene.fabric.ks == 1
    assert loaded.normalized_energy == pytest.approx(HEMISPHERE / 100, rel=0.05)
    assert cli.main([file, "--faces", "9", *options]) == cli.BAD_INPUT
    points, triangles = shapes.facets(8)
    faces = np.column_stack([np.full(len(triangles), 3), triangles])
    pv.PolyData(points, faces).save(tmp_path / "scan.ply")
    assert cli.main([str(tmp_path / "scan.ply"), "--faces", "0", *options]) == cli.BAD_INPUT
    told = capsys.readouterr().err
    assert "numbers from 0 to 1, or names of faces: ['dome']" in told and "which is not of" in told


def test_the_exact_net_wants_a_chart(part):
    with pytest.raises(InputError, match="chart"):
        ChebyshevNet.symmetric(part)


def test_a_damaged_surface_in_a_folder(tmp_path, holed):
    holed.save(tmp_path / "holed")
    place = tmp_path / "holed" / "scene.npz"
    arrays = plain_arrays(place.read_bytes(), 2**26)
    arrays["surface_points"][3] = np.nan
    data = _packed(**arrays)
    sums = (tmp_path / "holed" / CHECKSUMS).read_text()
    sums = sums.replace(checksum(place.read_bytes()), checksum(data))
    place.write_bytes(data)
    (tmp_path / "holed" / CHECKSUMS).write_text(sums)
    with pytest.raises(InputError, match="scene.npz.*finite"):
        ngcloth.load(tmp_path / "holed")


@pytest.mark.parametrize("name", ["part", "holed", "chart", "corners"])
def test_from_the_patch_to_the_surface_and_back(name, result, holed):
    cloth = {
        "part": lambda: result,
        "holed": lambda: holed,
        "chart": lambda: solve(scenes.hemisphere(), maxh=0.4),
        "corners": lambda: solve(scenes.hemicatenoid(1.0), maxh=0.5),
    }[name]()
    outline = cloth.outline(60)
    low, high = outline.min(axis=0), outline.max(axis=0)
    flat = np.random.default_rng(0).uniform(low, high, (1500, 2))
    there = cloth.lay(flat)
    on = np.isfinite(there).all(axis=-1)
    assert on.mean() * np.prod(high - low) == pytest.approx(cloth.area, rel=0.04)
    size = np.ptp(outline)
    assert cloth.flatten(there[on]) == pytest.approx(flat[on], abs=1e-8 * size)
    assert cloth.flatten(cloth.lay(outline)) == pytest.approx(outline, abs=1e-8 * size)


def test_points_beside_the_surface(result):
    """They go where the nearest point of the sphere goes."""
    points = np.array([[0.3, 0.2, 0.8], [-0.5, 0.5, 0.1], [0.1, -0.9, 0.6]])
    nearest = points / np.linalg.norm(points, axis=1)[:, None]
    assert result.flatten(points) == pytest.approx(result.flatten(nearest), abs=2e-3)
    assert result.lay(result.flatten(nearest)) == pytest.approx(nearest, abs=1e-3)
    assert np.isnan(result.lay([[9.0, 9.0]])).all()
    for wrong in ([[1.0, 2.0]], [0.0, 0.0, 30.0], 3 * [1e300], [0, 0, 1j], "abc"):
        with pytest.raises(InputError, match="points"):
            result.flatten(wrong)


@pytest.mark.parametrize("theta", [0.1, [0.1, 0.2, 0.3], [], "ab", [np.nan, 0.0], [1j, 0.0]])
def test_parameters_that_are_no_points(result, theta):
    with pytest.raises(InputError, match="theta"):
        result.slopes(theta)
    with pytest.raises(InputError, match="theta"):
        result.evaluate(result.sheet.position, theta)
    with pytest.raises(InputError, match="expression"):
        result.evaluate(5, [0.0, 0.0])
