"""Exported fields are read back by PyVista, and are those of the cloth."""

import csv
import subprocess
import sys

import ngsolve as ngs
import numpy as np
import pytest
import pyvista as pv
from vtkmodules.vtkCommonDataModel import vtkLagrangeTriangle

import ngcloth
from ngcloth import fields

SCALARS = ["stretch1", "stretch2", "shear", "angle", "thickness", "reaction", "jacobian"]


def saddle():
    """A scene without symmetry, the cloth below it."""
    surface = ngcloth.Surface(
        lambda x, y: (x, y, 0.4 * x**2 - 0.3 * x * y + 0.2 * ngs.sin(y)),
        ngcloth.Rectangle((-1, 0.5), (0, 1.2)),
        side=-1,
    )
    return ngcloth.Scene(surface=surface, fabric=ngcloth.Net(kc=3.0, ks=1.0))


@pytest.fixture(scope="module")
def chebyshev():
    return ngcloth.solve(ngcloth.scenes.hemisphere(), maxh=0.3, order=4)


@pytest.fixture(scope="module")
def elastic():
    return ngcloth.solve(ngcloth.scenes.hemisphere(ks=1.0), maxh=0.25, order=3)


@pytest.fixture(scope="module")
def own():
    return ngcloth.solve(saddle(), maxh=0.3, order=3)


@pytest.fixture(params=["chebyshev", "elastic", "own"])
def result(request):
    return request.getfixturevalue(request.param)


class Cells:
    """Curved cells of a file, interpolated by VTK's own shape functions."""

    def __init__(self, grid):
        assert set(grid.celltypes) == {pv.CellType.LAGRANGE_TRIANGLE}
        self.grid = grid
        self.nodes = grid.cell_connectivity.reshape(grid.n_cells, -1)
        m = self.nodes.shape[1]
        self.cell = vtkLagrangeTriangle()
        self.cell.GetPointIds().SetNumberOfIds(m)
        self.cell.GetPoints().SetNumberOfPoints(m)
        self.cell.Initialize()

    def slopes(self, values, r, s):
        """Derivatives by r and s at one reference point of every cell, (cells, 2, 3)."""
        derivatives = [0.0] * (2 * self.nodes.shape[1])
        self.cell.InterpolateDerivs([r, s, 0.0], derivatives)
        return np.reshape(derivatives, (2, -1)) @ np.asarray(values)[self.nodes]

    def values(self, values, r, s):
        """Values at one reference point of every cell, (cells, ...)."""
        weights = [0.0] * self.nodes.shape[1]
        self.cell.InterpolateFunctions([r, s, 0.0], weights)
        return np.einsum("m,cm...->c...", weights, np.asarray(values)[self.nodes])

    def area(self):
        rule = ngs.IntegrationRule(ngs.ET.TRIG, 14)
        return sum(
            weight * np.linalg.norm(self.normals(r, s), axis=1).sum()
            for (r, s, *_), weight in zip(rule.points, rule.weights, strict=True)
        )

    def normals(self, r, s):
        return np.cross(*np.moveaxis(self.slopes(self.grid.points, r, s), 1, 0))


def read(result, folder):
    return [pv.read(file) for file in fields.vtu(result, folder / "cloth.vtu")]


def inside(grid):
    """Points in the interior of their cells, where no field jumps, and no neighbour is met."""
    cells = grid.cell_connectivity.reshape(grid.n_cells, -1)
    order = int((np.sqrt(8 * cells.shape[1] + 1) - 3) / 2)
    return cells[:, 3 * order :].ravel()


def test_cloth_covers_the_surface(tmp_path, result):
    space, flat = read(result, tmp_path)
    target = result.scene.surface
    metric = ngs.sqrt(ngs.Det(target.metric))
    exact = result.scene.copies * ngs.Integrate(metric, result.state.space.mesh, order=12)
    assert Cells(space).area() == pytest.approx(exact, rel=1e-4)
    assert Cells(flat).area() == pytest.approx(result.area, rel=1e-9)
    position = target.evaluate(target.position, space["theta"])
    np.testing.assert_allclose(space.points, position, atol=1e-14)
    there = target.domain.contains(flat["theta"])  # curved elements may stick out of the rim
    assert there.mean() > 0.9
    psi = result.psi(*flat["theta"][there].T)
    np.testing.assert_allclose(flat.points[there, :2], psi, atol=1e-7)
    for grid in (space, flat):
        np.testing.assert_array_equal(grid["position"], space.points)
        np.testing.assert_array_equal(grid["psi"], flat.points)


@pytest.mark.parametrize(("order", "error"), [(1, 0.06), (8, 1e-7)])
def test_cells_have_the_order_of_psi(tmp_path, order, error):
    hemisphere = ngcloth.solve(ngcloth.scenes.hemisphere(), maxh=0.3, order=order)
    space, flat = (Cells(grid) for grid in read(hemisphere, tmp_path))
    assert space.area() == pytest.approx(2 * np.pi, abs=error)
    assert flat.area() == pytest.approx(hemisphere.area, rel=1e-9)


def test_cells_face_the_side_of_the_cloth(tmp_path, result):
    space, flat = (Cells(grid) for grid in read(result, tmp_path))
    target = result.scene.surface
    normals = space.normals(1 / 3, 1 / 3)
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    theta = space.values(space.grid["theta"], 1 / 3, 1 / 3)
    towards = target.evaluate(target.normal, theta)
    assert np.einsum("ij,ij->i", normals, towards).min() > 0.98
    if result.scene.symmetric:  # the unit sphere, covered from outside
        assert np.einsum("ij,ij->i", normals, space.values(space.grid.points, 0.3, 0.3)).min() > 0.9
    assert flat.normals(1 / 3, 1 / 3)[:, 2].min() > 0


def test_fields_are_those_of_the_result(tmp_path, result):
    grid, _ = read(result, tmp_path)
    points = inside(grid)
    theta = grid["theta"][points].T
    for name in SCALARS:
        expected = result.field(name, *theta)
        margin = 1e-7 * np.abs(expected).max()
        np.testing.assert_allclose(grid[name][points], expected, atol=margin, err_msg=name)
    np.testing.assert_allclose(grid["angle"], np.degrees(np.arcsin(grid["shear"])), atol=1e-9)
    assert grid.field_data["converged"] == [1]


def test_threads_are_tangent_to_the_surface(tmp_path, result):
    grid, _ = read(result, tmp_path)
    normal = result.scene.surface.evaluate(result.scene.surface.normal, grid["theta"])
    for thread in (grid["warp"], grid["weft"]):
        np.testing.assert_allclose(np.linalg.norm(thread, axis=1), 1, atol=1e-12)
        np.testing.assert_allclose(np.einsum("ij,ij->i", thread, normal), 0, atol=1e-12)
    cosine = np.einsum("ij,ij->i", grid["warp"], grid["weft"])
    np.testing.assert_allclose(90 - np.degrees(np.arccos(cosine)), grid["angle"], atol=1e-9)


def test_threads_run_where_the_flat_ones_are_laid(tmp_path, result):
    """The chain rule in the file itself: ∂position/∂X1 = λ1 warp, ∂position/∂X2 = λ2 weft."""
    space, flat = read(result, tmp_path)
    cells = Cells(space)
    at = (1 / 3, 1 / 3)
    in_space, in_plane = cells.slopes(space.points, *at), cells.slopes(flat.points, *at)[..., :2]
    threads = np.linalg.inv(in_plane) @ in_space
    for k, (thread, stretch) in enumerate((("warp", "stretch1"), ("weft", "stretch2"))):
        expected = space[stretch][:, None] * space[thread]
        np.testing.assert_allclose(threads[:, k], cells.values(expected, *at), atol=0.05)


def test_limits_are_active_where_threads_are_barely_taut(tmp_path, elastic, chebyshev):
    grid, _ = read(elastic, tmp_path)
    for k in (1, 2):
        excess = 1 - 1 / grid[f"stretch{k}"]  # the slack of the elongation
        active = grid[f"active_elongation_{k}"].astype(bool)
        np.testing.assert_array_equal(active, excess < 0.05 * excess.max())
        assert 0.01 < active.mean() < 0.3
        assert np.linalg.norm(grid["theta"][active], axis=1).min() > 0.6  # near the rim only
    grid, _ = read(chebyshev, tmp_path)
    assert not [name for name in grid.array_names if name.startswith("active")]


def test_a_solve_that_failed_says_so(tmp_path):
    failed = ngcloth.solve(ngcloth.scenes.hemisphere(), maxh=0.5, max_steps=1)
    for grid in read(failed, tmp_path):
        assert grid.field_data["converged"] == [0]


def test_thread_lines_lie_on_the_surface(tmp_path, result):
    pitch = 0.17
    space, flat = (pv.read(f) for f in fields.threads(result, tmp_path / "threads.vtp", pitch))
    assert space.n_lines == flat.n_lines == space.n_cells
    if result.scene.symmetric:
        np.testing.assert_allclose(np.linalg.norm(space.points, axis=1), 1, atol=1e-12)
    else:
        x, y, z = space.points.T
        np.testing.assert_allclose(z, 0.4 * x**2 - 0.3 * x * y + 0.2 * np.sin(y), atol=1e-12)
    np.testing.assert_array_equal(space["psi"], flat.points)
    np.testing.assert_array_equal(flat["position"], space.points)
    lengths, domain = np.zeros(2), result.scene.surface.domain
    for i in range(flat.n_cells):
        weft, level = flat["weft"][i], flat["level"][i]
        line = flat.get_cell(i).points
        np.testing.assert_allclose(line[:, 1 - weft], level, atol=1e-5)
        np.testing.assert_allclose(line[1:-1, 1 - weft], level, atol=1e-10)
        assert level / pitch == pytest.approx(round(level / pitch))
        assert np.diff(line[:, weft]).min() > 0
        lengths[weft] += np.ptp(line[:, weft])
    # Threads in strips one pitch wide fill the patch.
    np.testing.assert_allclose(lengths * pitch, result.area, rtol=0.03)
    for _, _, theta in fields.thread_lines(result, pitch):
        beyond = domain.centre + 1.001 * (theta[[0, -1]] - domain.centre)
        assert not domain.contains(beyond).any()


def test_thread_lines_follow_the_given_order(result):
    lines = fields.thread_lines(result, 0.5)
    assert [weft for weft, _, _ in lines] == sorted(weft for weft, _, _ in lines)
    for family in (0, 1):
        levels = [level for weft, level, _ in lines if weft == family]
        assert levels == sorted(levels) and np.diff(levels) == pytest.approx(0.5)


@pytest.mark.parametrize("size", [1e-3, 500])
def test_the_default_pitch_suits_the_patch(tmp_path, size):
    surface = ngcloth.Surface(lambda x, y: (x, y, 0 * x), ngcloth.Disk(size))
    flat = ngcloth.solve(ngcloth.Scene(surface, ngcloth.Net(ks=1.0)), maxh=size)
    file, _ = flat.export_threads(tmp_path / "threads.vtp")
    weft = pv.read(file).cell_data["weft"]
    assert 15 < (weft == 0).sum() < 30 and 15 < (weft == 1).sum() < 30


@pytest.mark.parametrize("ending", [".stl", ".OBJ"])
def test_surface_and_patch_are_closed_sheets(tmp_path, result, ending):
    files = fields.surface(result, tmp_path / f"sheet{ending}")
    space, flat = (pv.read(file).clean() for file in files)
    vtu, _ = read(result, tmp_path)
    assert space.area == pytest.approx(Cells(vtu).area(), rel=1e-3)
    assert flat.area == pytest.approx(result.area, rel=1e-3)
    for sheet in (space, flat):
        rim = sheet.extract_feature_edges(feature_edges=False, manifold_edges=False)
        assert rim.strip(join=True, max_length=10**6).n_cells == 1
        assert sheet.n_points - sheet.extract_all_edges().n_cells + sheet.n_cells == 1
    upwards = flat.compute_normals(auto_orient_normals=False, consistent_normals=False)
    assert upwards.cell_data["Normals"][:, 2].min() > 0.99
    facing = space.compute_normals(auto_orient_normals=False, consistent_normals=False)
    centres = space.cell_centers().points
    outwards = centres if result.scene.symmetric else [0, 0, -1]  # the saddle is a graph over x, y
    assert (facing.cell_data["Normals"] * outwards).sum(axis=1).min() > 0.5


@pytest.mark.parametrize("tolerance", [None, 1e-2])
def test_triangles_are_within_the_tolerance_and_no_more_than_it_needs(
    tmp_path, chebyshev, tolerance
):
    files = fields.surface(chebyshev, tmp_path / "sheet.obj", tolerance)
    space, flat = (pv.read(file) for file in files)
    stated = 2e-4 * 3 if tolerance is None else tolerance  # of the diagonal of the half ball's box
    assert max(file.stat().st_size for file in files) < (1e6 if tolerance is None else 5e4)
    for share in (0.5, 0.2):  # along the sides
        ends = space.points[space.regular_faces]
        inside = share * ends + (1 - share) * np.roll(ends, -1, axis=1)
        gaps = 1 - np.linalg.norm(inside, axis=-1)
        assert gaps.max() < stated
    assert gaps.max() > 0.1 * stated
    angles = space.cell_quality("min_angle")["min_angle"]
    assert angles.min() > 5
    outline = chebyshev.outline(10_000)
    rim = flat.extract_feature_edges(feature_edges=False, manifold_edges=False)
    middles = rim.cell_centers().points[:, :2]
    off = np.linalg.norm(middles[:, None] - outline[None], axis=-1).min(axis=1)
    assert off.max() < stated + 5e-4  # half a step of the outline


def test_what_is_flat_needs_few_triangles(tmp_path):
    plane = ngcloth.Surface(lambda x, y: (x, y, 0 * x), ngcloth.Rectangle((0, 3), (0, 1)))
    result = ngcloth.solve(ngcloth.Scene(plane, ngcloth.Net(ks=1.0)), maxh=1)
    space = pv.read(fields.surface(result, tmp_path / "panel.stl")[0])
    assert space.n_cells < 300 and space.area == pytest.approx(3, rel=1e-6)


def test_texture_coordinates_are_flat_positions(tmp_path, result):
    files = fields.surface(result, tmp_path / "sheet.obj")
    space, flat = (pv.read(file) for file in files)
    uv = space.active_texture_coordinates
    np.testing.assert_allclose(uv, flat.points[:, :2], atol=1e-6)
    x, y, z = np.asarray(space.points, dtype=float).T
    theta = (x / (1 - z), y / (1 - z)) if result.scene.symmetric else (x, y)
    centre = result.scene.surface.domain.centre
    theta = [c + (1 - 1e-6) * (t - c) for c, t in zip(centre, theta, strict=True)]
    np.testing.assert_allclose(uv, result.psi(*theta), atol=1e-5)
    text = files[0].read_text().splitlines()
    assert sum(line.startswith("vt ") for line in text) == space.n_points


def test_fibres_of_every_element(tmp_path, result):
    file = fields.fibres(result, tmp_path / "fibres.csv")
    with open(file, newline="") as text:
        rows = list(csv.DictReader(text))
    vtu, _ = read(result, tmp_path)
    assert [int(row["element"]) for row in rows] == list(vtu["element"])
    position, warp, weft = (
        np.array([[float(row[f"{prefix}{axis}"]) for axis in "xyz"] for row in rows])
        for prefix in ("", "warp_", "weft_")
    )
    cells = Cells(vtu)
    np.testing.assert_allclose(position, cells.values(vtu.points, 1 / 3, 1 / 3), atol=5e-3)
    np.testing.assert_allclose(warp, cells.values(vtu["warp"], 1 / 3, 1 / 3), atol=0.03)
    np.testing.assert_allclose(weft, cells.values(vtu["weft"], 1 / 3, 1 / 3), atol=0.03)
    x, y, z = position.T
    theta = (x / (1 - z), y / (1 - z)) if result.scene.symmetric else (x, y)
    for name in ("stretch1", "stretch2", "thickness", "angle"):
        column = [float(row["shear_angle_deg" if name == "angle" else name]) for row in rows]
        np.testing.assert_allclose(column, result.field(name, *theta), atol=1e-8)
    angle = np.degrees(np.arccos(np.einsum("ij,ij->i", warp, weft)))
    np.testing.assert_allclose([float(row["angle_deg"]) for row in rows], angle, atol=1e-8)


WRONG = [
    ("export_vtu", "cloth.vtk"),
    ("export_vtu", "missing/cloth.vtu"),
    ("export_vtu", None),
    ("export_surface", "cloth.ply"),
    ("export_surface", "cloth.obj", 0),
    ("export_surface", "cloth.obj", 1.0),
    ("export_surface", "cloth.obj", "fine"),
    ("export_fibres", "fibres"),
    ("export_threads", "threads.vtu", 0.1),
    ("export_threads", "threads.vtp", 0),
    ("export_threads", "threads.vtp", "0.1"),
    ("export_threads", "threads.vtp", np.nan),
    ("export_threads", "threads.vtp", 1e-3),
]


@pytest.mark.parametrize(("method", "name", "pitch"), [(*wrong, None)[:3] for wrong in WRONG])
def test_what_cannot_be_written_is_refused(tmp_path, own, method, name, pitch):
    path = name and tmp_path / name
    with pytest.raises(ngcloth.InputError):
        getattr(own, method)(path, *([] if pitch is None else [pitch]))
    assert not list(tmp_path.iterdir())


def test_results_export_themselves(tmp_path, own):
    files = [
        *own.export_vtu(tmp_path / "cloth.vtu"),
        *own.export_threads(str(tmp_path / "threads.vtp"), 0.3),
        *own.export_surface(tmp_path / "cloth.obj"),
        own.export_fibres(tmp_path / "fibres.csv"),
    ]
    assert sorted(files) == sorted(tmp_path.iterdir())
    assert {f.name for f in files} >= {"cloth_flat.vtu", "threads_flat.vtp", "cloth_flat.obj"}


def test_import_loads_no_plotting():
    heavy = {"matplotlib", "pyvista", "vtkmodules"}
    code = f"import sys, ngcloth.output.fields; print({heavy} & set(sys.modules))"
    run = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert run.stdout.strip() == "set()"
