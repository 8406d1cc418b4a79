"""Surfaces from CAD files: exact geometry back from what netgen.occ exports, and bad files."""

import ngsolve as ngs
import numpy as np
import pytest
import shapes
from netgen.occ import Axes, Box, Compound, Cylinder, MoveTo, Pnt, WorkPlane, X, Y, Z

from ngcloth.errors import InputError
from ngcloth.geometry import cad
from ngcloth.geometry._kernel import named
from ngcloth.geometry.cad import from_cad


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    folder = tmp_path_factory.mktemp("parts")
    shapes.hemisphere().WriteStep(str(folder / "hemisphere.step"))
    shapes.octant().WriteStep(str(folder / "octant.step"))
    shapes.octant().WriteBrep(str(folder / "octant.brep"))
    return folder


@pytest.fixture(scope="module")
def hemisphere(folder):
    return from_cad(folder / "hemisphere.step", "dome")


def integral(sheet, density, rule=ngs.dx):
    return ngs.Integrate(ngs.CF(density) * rule(bonus_intorder=12), sheet.mesh)


def area_element(sheet):
    return ngs.sqrt(ngs.Det(sheet.metric))


def rim_length(sheet):
    along = ngs.specialcf.tangential(2)
    metric = ngs.BoundaryFromVolumeCF(sheet.metric)
    return integral(sheet, ngs.sqrt(ngs.InnerProduct(metric * along, along)), ngs.ds)


def mean(sheet, density):
    return integral(sheet, area_element(sheet) * density) / integral(sheet, area_element(sheet))


def test_a_hemisphere_is_one_face_with_seam_and_pole_inside(hemisphere):
    assert hemisphere.faces == 1 and len(hemisphere.topology.rims) == 1
    assert hemisphere.sharp == 0
    assert hemisphere.least_radius == pytest.approx(1, rel=5e-3)
    assert "2 × 2 × 1 mm" in str(hemisphere)
    *_, sheet = hemisphere.sheets(0.15, order=4)
    assert integral(sheet, area_element(sheet)) == pytest.approx(2 * np.pi, rel=1e-8)
    assert rim_length(sheet) == pytest.approx(2 * np.pi, rel=1e-8)
    # Gauss and Bonnet, of a disk whose rim is a geodesic
    gauss = ngs.Det(sheet.curvature) / ngs.Det(sheet.metric)
    assert integral(sheet, area_element(sheet) * gauss) == pytest.approx(2 * np.pi, rel=1e-6)


def test_refined_meshes_are_nested_and_their_curvature_converges(hemisphere):
    coarse, fine = hemisphere.sheets(0.075, order=2, coarser=1)
    assert fine.mesh.ne == 4 * coarse.mesh.ne
    assert integral(fine, 1) == pytest.approx(integral(coarse, 1), rel=1e-12)
    for vertex in list(coarse.mesh.vertices)[::20]:
        assert coarse.position(coarse.mesh(*vertex.point)) == pytest.approx(
            fine.position(fine.mesh(*vertex.point)), abs=1e-12
        )
    for sheet, allowed in ((coarse, 1e-3), (fine, 1e-4)):
        solvers = ngs.Trace(ngs.Inv(sheet.metric) * sheet.curvature) / 2
        for found in (sheet.mean_curvature, solvers):
            assert mean(sheet, (found + 1) ** 2) ** 0.5 < allowed
    errors = [abs(integral(s, area_element(s)) - 2 * np.pi) for s in (coarse, fine)]
    assert errors[1] < errors[0] / 12  # of order 4


@pytest.mark.parametrize("side", [1, -1])
def test_the_normal_points_to_the_side_of_the_cloth(folder, side):
    (sheet,) = from_cad(folder / "octant.step", "dome", side=side).sheets(0.3, order=3)
    assert mean(sheet, ngs.Norm(sheet.normal - side * sheet.position)) < 1e-3
    shape = ngs.Inv(sheet.metric) * sheet.curvature
    assert mean(sheet, ngs.Trace(shape) / 2) == pytest.approx(-side, abs=1e-3)


def test_metric_and_curvature_are_whole_on_the_rim(folder):
    (sheet,) = from_cad(folder / "octant.step", "dome").sheets(0.3, order=4, symmetric=True)
    gauss = ngs.Det(sheet.curvature) / ngs.Det(sheet.metric)
    gauss = ngs.BoundaryFromVolumeCF(gauss)
    assert integral(sheet, gauss, ngs.ds) == pytest.approx(integral(sheet, 1, ngs.ds), rel=1e-3)
    assert sorted(set(sheet.mesh.GetBoundaries())) == ["mirror1", "mirror2", "rim"]
    on_mirror = ngs.ds("mirror1")
    assert ngs.Integrate(sheet.position[0] ** 2 * on_mirror, sheet.mesh) < 1e-20


@pytest.mark.parametrize("name", ["part.STP", "part.Step", "part.BREP"])
def test_any_spelling_of_the_ending_and_any_unit(folder, tmp_path, name):
    source = "octant.brep" if name.endswith("BREP") else "octant.step"
    (tmp_path / name).write_bytes((folder / source).read_bytes())
    part = from_cad(tmp_path / name, lambda face: face.area > 1.2 / 25.4**2, unit="inch")
    assert part.faces == 1
    (sheet,) = part.sheets(0.2 / 25.4, order=4)
    assert integral(sheet, area_element(sheet)) == pytest.approx(np.pi / 2 / 25.4**2, rel=1e-7)


def test_names_that_are_not_set(folder):
    """They are empty for the kernel; what else is not set stays so, and files with names do."""
    given = b"#1=CURVE($,#2,$);#3 = FACE ( $,(#1));(ITEM()REPRESENTATION_ITEM($));#4=UNIT(*,$)"
    names = b"#1=CURVE('',#2,$);#3 = FACE ( '',(#1));(ITEM()REPRESENTATION_ITEM(''));#4=UNIT(*,$)"
    assert named(given) == names
    whole = (folder / "octant.step").read_bytes()
    assert named(whole) == whole


def test_faces_that_join_smoothly(tmp_path):
    part, area, fillet = shapes.hat()
    part.WriteStep(str(tmp_path / "hat.step"))
    hat = from_cad(tmp_path / "hat.step")
    assert hat.faces == 3 and hat.sharp == 0
    assert hat.least_radius == pytest.approx(fillet, rel=0.05)
    (sheet,) = hat.sheets(0.1, order=4)
    assert integral(sheet, area_element(sheet)) == pytest.approx(area, rel=1e-6)


def test_an_iges_file_of_another_writer(tmp_path):
    shapes.write_iges(tmp_path / "half.IGS")
    half = from_cad(tmp_path / "half.IGS", side=-1)
    assert half.faces == 2 and half.sharp == 0 and half.topology.parts == 1
    (sheet,) = half.sheets(0.3, order=4)
    assert integral(sheet, area_element(sheet)) == pytest.approx(2 * np.pi, rel=1e-7)
    assert abs(mean(sheet, sheet.mean_curvature)) == pytest.approx(0.5, abs=1e-4)
    assert mean(sheet, sheet.gauss_curvature) == pytest.approx(0, abs=1e-4)
    assert integral(sheet, 1) == pytest.approx(2 * np.pi, rel=1e-2)  # it unrolls, by chords


def test_faces_may_be_loose_reversed_and_meet_at_an_edge(tmp_path):
    floor = MoveTo(0, 0).Rectangle(2, 1).Face()
    wall = WorkPlane(Axes((2 + 1e-6, 0, 0), n=X, h=Y)).Rectangle(1, 1).Face()
    for faces in ([floor, wall], [floor.Reversed(), wall]):
        Compound(faces).WriteStep(str(tmp_path / "corner.step"))
        corner = from_cad(tmp_path / "corner.step")
        assert corner.sharp == pytest.approx(1)
        (sheet,) = corner.sheets(0.5, order=1)
        normal = [mean(sheet, sheet.normal[i]) for i in range(3)]
        # Whichever was turned, both now look to the inside of the corner, or both to the outside.
        assert abs(normal[0]) == pytest.approx(1 / 3, abs=1e-6)
        assert normal[0] * normal[2] < 0 and abs(normal[2]) == pytest.approx(2 / 3, abs=1e-6)
        assert integral(sheet, 1) == pytest.approx(3, rel=1e-4)  # it unfolds


def test_a_panel_with_a_hole(tmp_path):
    shapes.panel_with_hole().WriteStep(str(tmp_path / "panel.step"))
    panel = from_cad(tmp_path / "panel.step")
    assert len(panel.topology.rims) == 2
    (sheet,) = panel.sheets(0.3, order=4)
    assert integral(sheet, area_element(sheet)) == pytest.approx(6 - 0.16 * np.pi, rel=1e-6)
    assert rim_length(sheet) == pytest.approx(10 + 0.8 * np.pi, rel=1e-6)
    assert panel.least_radius > 1e6


@pytest.mark.parametrize(
    ("faces", "said"),
    [
        (None, "a closed surface"),
        ("lid", "names of faces: \\['dome'\\]"),
        (7, "numbers from 0 to 3"),
        (True, "numbers from 0 to 3"),
        ("", "names of faces"),
        (lambda face: False, "at least one of the 4 faces"),
        ([], "at least one of the 4 faces"),
    ],
)
def test_refused_choices_of_faces(folder, faces, said):
    with pytest.raises(InputError, match=said):
        from_cad(folder / "octant.step", faces)


def three_at_an_edge():
    up = WorkPlane(Axes((0, 0, 0), n=-Y, h=X)).Rectangle(1, 1).Face()
    return [MoveTo(0, 0).Rectangle(1, 1).Face(), MoveTo(0, -1).Rectangle(1, 1).Face(), up]


@pytest.mark.parametrize(
    ("faces", "said"),
    [
        (three_at_an_edge(), "three faces or more meet"),
        ([MoveTo(i, 0).Rectangle(1, 1).Face() for i in (0, 3)], "2 loose parts"),
        ([MoveTo(i, i).Rectangle(1, 1).Face() for i in (0, 1)], "vertices alone|loose parts"),
        ([Cylinder(Pnt(0, 0, 0), Z, 1, 2).faces[0]], "a tube"),
        ([MoveTo(0, 0).Rectangle(1e-3, 1e-3).Face()], "at least 0.01 mm large"),
    ],
)
def test_refused_shapes(tmp_path, faces, said):
    Compound(faces).WriteStep(str(tmp_path / "part.step"))
    with pytest.raises(InputError, match=said):
        from_cad(tmp_path / "part.step")


@pytest.mark.parametrize(
    ("name", "data"),
    [
        ("part.step", b""),
        ("part.step", b"ISO-10303-21;\nHEADER;\nENDSEC;\n"),
        ("part.igs", bytes(range(256)) * 8),
        ("part.brep", bytes(range(256)) * 8),
        ("part.txt", b"solid"),
        ("missing/part.step", None),
    ],
)
def test_refused_files(tmp_path, name, data):
    if data is not None:
        (tmp_path / name).write_bytes(data)
    with pytest.raises(InputError, match="path = .*part"):
        from_cad(tmp_path / name)


def test_a_closed_surface_is_refused_before_it_is_meshed(folder, monkeypatch):
    Box(Pnt(0, 0, 0), Pnt(1, 1, 1)).WriteStep(str(folder / "closed.step"))
    monkeypatch.setattr(cad, "MESHING", (1e-3, 0.0))
    with pytest.raises(InputError, match="a closed surface"):
        from_cad(folder / "closed.step")
    with pytest.raises(InputError, match="no end after"):
        from_cad(folder / "closed.step", [0, 1])


def test_a_mesher_without_end_is_ended(folder, monkeypatch):
    part = from_cad(folder / "octant.step", "dome")
    monkeypatch.setattr(cad, "MESHING", (1e-3, 0.0))
    with pytest.raises(InputError, match="can be meshed .*no end after"):
        part.sheets(0.3, order=2)


def test_small_rounds_do_not_ask_for_many_triangles(tmp_path):
    box, radius = Box(Pnt(0, 0, 0), Pnt(1, 1, 1)), 1e-3
    edge = [e for e in box.edges if np.allclose(tuple(e.center), (1, 0.5, 1))]
    box.MakeFillet(edge, radius).WriteStep(str(tmp_path / "box.step"))
    part = from_cad(tmp_path / "box.step", lambda f: f.centre[2] > 0.99 or f.centre[0] > 0.99)
    assert part.faces == 3 and part.sharp == 0
    assert part.area == pytest.approx(2 - 2 * radius + np.pi / 2 * radius, rel=1e-4)
    (sheet,) = part.sheets(0.1, order=2)
    assert sheet.mesh.ne < 5000  # 31 000 if curvature decides


def test_a_warning_of_sharp_edges(tmp_path):
    box = Box(Pnt(0, 0, 0), Pnt(3, 2, 1))
    box.WriteStep(str(tmp_path / "box.step"))
    with pytest.warns(UserWarning, match="14 mm of them"):
        from_cad(tmp_path / "box.step", lambda face: face.centre[2] < 0.9)


@pytest.mark.parametrize("share", [0.17, 0.51, 0.97])
def test_truncated_files_take_no_program_down(folder, tmp_path, monkeypatch, share):
    """Some of these end in a segmentation fault of the kernel, some in an endless loop."""
    monkeypatch.setattr(cad, "PATIENCE", (5.0, 0.0))
    for name in ("octant.brep", "octant.step"):
        data = (folder / name).read_bytes()
        (tmp_path / name).write_bytes(data[: int(share * len(data))])
        with pytest.raises(InputError, match="path = .*octant"):
            from_cad(tmp_path / name)


@pytest.mark.parametrize(("unit", "side"), [("km", 1), (None, 1), ("mm", 0), ("mm", True)])
def test_refused_settings(folder, unit, side):
    with pytest.raises(InputError, match="unit|side"):
        from_cad(folder / "octant.step", "dome", unit, side)


def test_a_box_without_lid_unfolds(tmp_path):
    box = Box(Pnt(0, 0, 0), Pnt(3, 2, 1))
    box.faces.Max(Z).name = "lid"
    box.WriteStep(str(tmp_path / "box.step"))
    part = from_cad(tmp_path / "box.step", lambda face: face.name != "lid")
    assert part.sharp == pytest.approx(2 * (3 + 2) + 4)
    (sheet,) = part.sheets(0.5, order=2)
    assert integral(sheet, area_element(sheet)) == pytest.approx(6 + 10, rel=1e-9)
