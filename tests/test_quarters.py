"""A quarter of a part from STEP, between its mirror planes: the result is the whole patch."""

import numpy as np
import pytest
import pyvista as pv
from geometry import shapes
from netgen.occ import Axis, Box, Cylinder, Pnt, Sphere, Z
from svgelements import SVG, Path

import ngcloth
from ngcloth import InputError, Net, Scene, Surface, scenes, solve

RADIUS = 0.1  # in cm; of 1 mm in the file
HEMISPHERE = 0.1842  # E/(2π kc) of taut cloth, ks = kc, by charts


def read(folder, shape, **options):
    path = folder / "part.step"
    shape.WriteStep(str(path))
    return Surface.from_cad(path, "dome", **options)


@pytest.fixture(scope="module", params=[1, -1], ids=["outside", "inside"])
def result(request, tmp_path_factory):
    """On the inside, the quarter that is meshed has θ2 < 0."""
    folder = tmp_path_factory.mktemp("parts")
    quarter = read(folder, shapes.octant(), unit="cm", side=request.param)
    return solve(scenes.part(quarter, ks=1.0, symmetric=True), maxh=0.3 * RADIUS)


def test_the_patch_is_whole(result):
    assert result.converged
    assert result.normalized_energy == pytest.approx(HEMISPHERE * RADIUS**2, rel=2e-2)
    outline, i = result.outline(400), np.arange(400)
    x, y = outline.T
    enclosed = np.sum(x * np.roll(y, -1) - y * np.roll(x, -1)) / 2
    assert enclosed == pytest.approx(result.area, rel=1e-3)
    assert outline[-i] * [1, -1] == pytest.approx(outline, abs=1e-12)
    assert outline[200 - i] * [-1, 1] == pytest.approx(outline, abs=1e-12)
    assert x[0] == pytest.approx(1.368 * RADIUS, rel=2e-3) and abs(y[0]) < 1e-15
    low, high = result.extrema["shear"]
    assert low == -high and high == pytest.approx(0.70, abs=0.02)
    assert abs(result.warp[0]) == pytest.approx(1, abs=1e-9)
    assert result.certificate().certified


def test_from_the_patch_to_all_of_the_surface_and_back(result):
    flat = RADIUS * np.array([(0.5, 0.3), (-0.5, 0.3), (-0.5, -0.3), (0.5, -0.3), (0, 0)])
    there = result.lay(flat)
    assert np.linalg.norm(there, axis=1) == pytest.approx(RADIUS, rel=1e-3)
    assert there[:4] == pytest.approx(there[0] * np.insert(np.sign(flat[:4]), 2, 1, axis=1))
    assert result.flatten(there) == pytest.approx(flat, abs=1e-8 * RADIUS)
    assert np.isnan(result.lay([(3 * RADIUS, 0)])).all()


def test_saved_with_its_mirrors(tmp_path, result):
    result.save(tmp_path / "quarter")
    again = ngcloth.load(tmp_path / "quarter")
    assert again.outline() == pytest.approx(result.outline(), abs=1e-15)
    assert again.extrema == result.extrema and str(again.scene) == str(result.scene)
    assert again.lay([(-0.05, -0.03)]) == pytest.approx(result.lay([(-0.05, -0.03)]))


def test_exports_are_of_the_whole_patch(tmp_path, result):
    """On the sphere of the file, in its unit; all cells look to the side of the cloth."""
    result.export_vtu(tmp_path / "cloth.vtu")
    cloth = pv.read(tmp_path / "cloth.vtu")
    assert np.reshape(cloth.bounds, (3, 2)) == pytest.approx(
        RADIUS * np.array([(-1, 1), (-1, 1), (0, 1)]), abs=1e-9
    )
    radial = cloth.points / RADIUS
    assert np.linalg.norm(radial, axis=1) == pytest.approx(1, abs=1e-3)
    threads = [cloth.point_data[name] for name in ("warp", "weft")]
    for thread in threads:
        assert np.abs(np.sum(thread * radial, axis=1)).max() < 0.03
    outwards = np.sum(np.cross(*threads) * radial, axis=1) * result.scene.surface.side
    assert outwards.min() > 0.7
    result.export_surface(tmp_path / "dome.stl")
    dome, flat = pv.read(tmp_path / "dome.stl"), pv.read(tmp_path / "dome_flat.stl")
    assert dome.area == pytest.approx(2 * np.pi * RADIUS**2, rel=1e-3)
    assert flat.area == pytest.approx(result.area, rel=1e-3)
    normals = dome.compute_normals(auto_orient_normals=False, consistent_normals=False)
    outwards = np.sum(normals.cell_data["Normals"] * dome.cell_centers().points, axis=1)
    assert (outwards * result.scene.surface.side).min() > 0.9 * RADIUS
    result.export_threads(tmp_path / "threads.vtp", pitch=RADIUS / 2)
    places = pv.read(tmp_path / "threads.vtp").points
    assert np.linalg.norm(places, axis=1) == pytest.approx(RADIUS, rel=1e-3)
    assert (places[:, :2].min(axis=0) < -0.9 * RADIUS).all()
    result.export_fibres(tmp_path / "shells.inp", "abaqus", thickness=0.01)
    result.export_svg(tmp_path / "cut.svg")
    layers = {group.id: group for group in SVG.parse(tmp_path / "cut.svg") if group.id}
    (cut,) = layers["cut"].select(lambda each: isinstance(each, Path))
    sizes = np.ptp([(p.x, p.y) for p in cut.as_points()], axis=0) / (96 / 25.4)
    assert sizes == pytest.approx(10 * np.ptp(result.outline(), axis=0), rel=1e-3)
    if result.scene.surface.side == 1:
        ngcloth.report(result, tmp_path / "report.html")
        assert (tmp_path / "report.html").stat().st_size > 100_000


def beyond(*tools):
    """What tools leave of the sphere where y and z > 0; rims on its sides are mirror lines."""
    part = Sphere(Pnt(0, 0, 0), 1) * Box(Pnt(-1, 0, 0), Pnt(2, 2, 2))
    for tool in tools:
        part -= tool
    dome = max(part.faces, key=lambda face: face.mass)
    dome.name = "dome"
    for edge in dome.edges:
        if 0.1 < edge.center[2] < 0.85:
            edge.name = "mirror2" if abs(edge.center[1]) < 1e-9 else "mirror1"
    return part


LEFT = Box(Pnt(-2, -2, -2), Pnt(0, 2, 2))


@pytest.mark.parametrize(
    ("shape", "said"),
    [
        (beyond(), "no edges of its rim are named"),
        (beyond(Box(Pnt(-2, -2, -2), Pnt(0.3, 2, 2))), "plane of its 'mirror1' meet 17° off"),
        (beyond(LEFT.Rotate(Axis((0, 0, 0), Z), -20)), "and 'mirror2' meet 20° off a right angle"),
        (beyond(Cylinder(Pnt(-3, 0, -2), Z, 3, 4)), "edge 'mirror1' leaves a plane by"),
        (beyond(LEFT, Box(Pnt(-2, -2, 0.9), Pnt(2, 2, 2))), "have 0 ends in common"),
    ],
)
def test_what_is_no_quarter(tmp_path, shape, said):
    with pytest.raises(InputError, match=f"symmetric.*{said}"):
        Scene(read(tmp_path, shape), Net(), symmetric=True)


def test_facets_and_directions_are_refused(tmp_path):
    with pytest.raises(InputError, match="symmetric.*cut off in CAD"):
        Scene(Surface.from_mesh(shapes.facets(9)), Net(), symmetric=True)
    with pytest.raises(InputError, match="warp.*along the edge 'mirror2'"):
        Scene(read(tmp_path, shapes.octant()), Net(), symmetric=True, warp=(1, 0, 0))
