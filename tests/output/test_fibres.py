"""Shells of structural solvers, read back by programs that are none of ours."""

import json
import re
import subprocess
import sys
from functools import cache

import ngsolve as ngs
import numpy as np
import pytest
from dynakw import DynaKeywordReader

import ngcloth
from ngcloth import InputError, Net, Rectangle, Scene, Surface, fields
from ngcloth.output.shells import shells

THICKNESS = 0.02
# Carbon in epoxy, about: stiff along the first axis.
CLOTH = """*MATERIAL, NAME=CLOTH
*ELASTIC, TYPE=ENGINEERING CONSTANTS
130., 10., 10., .3, .3, .4, 5., 5.,
3.5
"""
# pyNastran 1.4.1 wants NumPy 1, and misses of NumPy 2 this alias alone where it reads and looks up.
READ_NASTRAN = """
import json, sys
import numpy as np
np.in1d = np.isin
from pyNastran.bdf.bdf import read_bdf
for file in sys.argv[1:]:
    model = read_bdf(file, debug=None, punch=True, xref=False)
    model.add_mat8(1, 130.0, 10.0, 0.3, 5.0, 5.0, 3.5)
    model.cross_reference()
    rows = []
    for number in sorted(model.elements):
        element = model.elements[number]
        _, _, along, _, normal = element.material_coordinate_system()
        rows.append([*along, *normal, element.T1, element.T2, element.T3])
    print(json.dumps([element.type, rows]))
"""


def turned(points):
    """Coordinates turned about two axes, so that no direction is one of theirs."""
    rotation = np.linalg.qr(np.array([[3.0, 1, 2], [1, -2, 1], [0.5, 1, 4]]))[0]
    return tuple(sum(float(row[k]) * points[k] for k in range(3)) for row in rotation)


@cache
def solved(name):
    saddle = Surface(
        lambda x, y: turned((x, y, 0.4 * x**2 - 0.3 * x * y + 0.2 * ngs.sin(y))),
        Rectangle((-1, 0.5), (0, 1.2)),
        side=-1,
    )
    plane = Surface(lambda x, y: turned((x + 0.4 * y, y, 0 * x)), Rectangle((0, 3), (0, 2)))
    scene, settings = {
        "saddle": (Scene(saddle, Net(kc=3.0, ks=1.0)), {"maxh": 0.3, "order": 2}),
        "plane": (Scene(plane, Net(ks=1.0)), {"maxh": 1, "order": 2}),
        "hemisphere": (ngcloth.scenes.hemisphere(), {"maxh": 0.3, "order": 4}),
    }[name]
    return ngcloth.solve(scene, **settings)


@pytest.fixture(scope="module", params=["saddle", "plane", "hemisphere"])
def result(request):
    return solved(request.param)


@pytest.fixture(scope="module")
def saddle():
    return solved("saddle")


def table(result, folder):
    """Warp and weft at the centroids, (m, 3) each, and the other columns of the table."""
    file = fields.fibres(result, folder / "fibres.csv")
    rows = np.genfromtxt(file, delimiter=",", names=True)
    threads = (np.stack([rows[f"{thread}_{i}"] for i in "xyz"], -1) for thread in ("warp", "weft"))
    return (*threads, rows)


def angles_between(axes, directions, normals):
    """Angles in the planes of triangles, of axes of either sign, in degrees."""

    def projected(vectors):
        vectors = vectors - np.einsum("ni,ni->n", vectors, normals)[:, None] * normals
        return vectors / np.linalg.norm(vectors, axis=1, keepdims=True)

    across = np.cross(projected(axes), projected(directions))
    return np.degrees(np.arcsin(np.clip(np.linalg.norm(across, axis=1), 0, 1)))


def corner_normals(nodes, triangles):
    first, second, third = nodes[triangles[:, :3]].swapaxes(0, 1)
    normals = np.cross(second - first, third - first)
    return normals / np.linalg.norm(normals, axis=1, keepdims=True)


# The shells themselves --------------------------------------------------------------------------


@pytest.mark.parametrize("order", [1, 2])
def test_shells_are_one_sheet_with_shared_nodes_that_faces_the_cloth(result, order):
    sheet = shells(result, order, THICKNESS)
    corners = sheet.triangles[:, :3]
    ends = np.sort(corners[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2), axis=1)
    sides, count = np.unique(ends, axis=0, return_counts=True)
    assert set(count) == {1, 2}
    vertices = len(np.unique(corners))
    assert vertices - len(sides) + len(corners) == 1  # Euler's number of a disk
    assert len(sheet.nodes) == vertices + (len(sides) if order == 2 else 0)
    assert set(sheet.triangles.ravel()) == set(range(len(sheet.nodes)))
    surface = result.scene.surface
    theta = fields.element_fields(result, [(1 / 3, 1 / 3)])["theta"][:, 0]
    towards = surface.evaluate(surface.normal, theta)
    np.testing.assert_array_less(0.9, np.einsum("ni,ni->n", sheet.axes[:, 2], towards))
    np.testing.assert_allclose(np.linalg.det(sheet.axes), 1)
    if order == 2:
        middles = (sheet.nodes[corners] + sheet.nodes[np.roll(corners, -1, axis=1)]) / 2
        gap = np.linalg.norm(sheet.nodes[sheet.triangles[:, 3:]] - middles, axis=-1)
        assert gap.max() < 0.1 * np.ptp(sheet.nodes, axis=0).max()


def test_thickness_keeps_the_volume_of_the_cloth(result):
    sheet = shells(result, 2, THICKNESS)
    first, second, third = sheet.nodes[sheet.triangles[:, :3]].swapaxes(0, 1)
    areas = np.linalg.norm(np.cross(second - first, third - first), axis=1) / 2
    assert areas @ sheet.thickness == pytest.approx(THICKNESS * result.area, rel=0.08)
    by_nodes = sheet.nodal_thickness[sheet.triangles[:, :3]].mean(axis=1)
    np.testing.assert_allclose(by_nodes, sheet.thickness, rtol=0.15)


# Read back --------------------------------------------------------------------------------------


def stretched(deck, nodes):
    """A deck with all nodes moved away from the origin by a thousandth, and stresses printed.

    In every triangle the strain is .001 in all directions of its plane; so the stress is largest
    along the stiff one.
    """
    moved = "".join(
        f"{number}, {k}, {k}, {1e-3 * value:.9g}\n"
        for number, point in enumerate(nodes, 1)
        for k, value in enumerate(point, 1)
    )
    step = f"*STEP\n*STATIC\n*BOUNDARY\n{moved}*EL PRINT, ELSET=CLOTH, GLOBAL=YES\nS\n*END STEP\n"
    return deck + CLOTH + step


def run_calculix(folder, job):
    run = subprocess.run(["ccx", "-i", job], cwd=folder, capture_output=True, text=True)
    assert run.returncode == 0 and "*ERROR" not in run.stdout, run.stdout[-2000:]
    return run.stdout


def stresses(file):
    """Largest principal stresses of the elements and their directions, means over all points."""
    rows = {}
    for line in file.read_text().splitlines():
        words = line.split()
        if len(words) > 7 and words[0].isdigit():
            rows.setdefault(int(words[0]), []).append([float(word) for word in words[2:8]])
    xx, yy, zz, xy, xz, yz = np.array([np.mean(rows[k], axis=0) for k in sorted(rows)]).T
    tensors = np.stack([xx, xy, xz, xy, yy, yz, xz, yz, zz], axis=-1).reshape(-1, 3, 3)
    values, vectors = np.linalg.eigh(tensors)
    return values, vectors[:, :, 2]


@pytest.mark.parametrize("order", [1, 2])
def test_calculix_finds_the_cloth_stiff_along_the_warp(tmp_path, result, order):
    warp, _, _ = table(result, tmp_path)
    file = result.export_fibres(
        tmp_path / "cloth.inp", "calculix", thickness=THICKNESS, order=order
    )
    sheet = shells(result, order, THICKNESS)
    (tmp_path / "job.inp").write_text(stretched(file.read_text(), sheet.nodes))
    assert "*WARNING" not in run_calculix(tmp_path, "job")
    values, stiff = stresses(tmp_path / "job.dat")
    angles = angles_between(stiff, warp, corner_normals(sheet.nodes, sheet.triangles))
    plane = np.ptp(sheet.nodes @ sheet.axes[0, 2]) < 1e-9
    # CalculiX does not turn the axes of an element where it curves, and these curve by up to 25°.
    assert angles.max() < (0.01 if order == 1 or plane else 8)
    if order == 1 or plane:  # the plane stress of the material under equal strains
        low = 10 / 130 * 0.3
        expected = 1e-3 * np.array([10 * (1 + 0.3), 130 * (1 + low)]) / (1 - 0.3 * low)
        np.testing.assert_allclose(values[:, 1:], np.tile(expected, (len(values), 1)), rtol=1e-2)
    assert np.abs(values[:, 0]).max() < 0.05 * values[:, 2].min()


@pytest.mark.parametrize("order", [1, 2])
def test_an_abaqus_deck_means_the_same_to_a_converter_and_to_calculix(tmp_path, saddle, order):
    warp, _, _ = table(saddle, tmp_path)
    file = saddle.export_fibres(tmp_path / "cloth.inp", "abaqus", thickness=THICKNESS, order=order)
    sheet = shells(saddle, order, THICKNESS)
    assert f"*ELEMENT, TYPE={'S3' if order == 1 else 'STRI65'}, ELSET=CLOTH\n" in file.read_text()
    (tmp_path / "job.inp").write_text(stretched(file.read_text(), sheet.nodes))
    subprocess.run(
        [sys.executable, "-m", "abq2ccx", "job.inp", "-o", "read.inp", "--json"],
        cwd=tmp_path,
        capture_output=True,
        check=True,
    )
    read = (tmp_path / "read.inp").read_text()
    read = re.sub(r"\*\*[^\n]*\n", "", read)  # comments
    sections = re.findall(r"\*SHELL SECTION[^\n]*\n([^\n,]*)", read)
    np.testing.assert_allclose(
        np.sort([float(each) for each in sections]), np.sort(sheet.thickness), rtol=1e-6
    )
    axes = re.findall(r"\*ORIENTATION[^\n]*\n([^\n]*)", read)
    axes = np.array([[float(word) for word in line.split(",")[:3]] for line in axes])
    assert len(axes) == len(warp)
    normals = corner_normals(sheet.nodes, sheet.triangles)
    cosines = np.abs(axes @ sheet.axes[:, 0].T) / np.linalg.norm(axes, axis=1, keepdims=True)
    assert np.degrees(np.arccos(np.clip(cosines.max(axis=0), 0, 1))).max() < 0.01
    run_calculix(tmp_path, "read")
    _, stiff = stresses(tmp_path / "read.dat")
    assert angles_between(stiff, warp, normals).max() < (0.01 if order == 1 else 3)


@pytest.fixture(scope="module")
def pynastran(tmp_path_factory):
    """What pyNastran reads of a deck; by its own requirements it cannot live beside NumPy 2."""
    folder = tmp_path_factory.mktemp("pynastran")
    packages = ["pyNastran==1.4.1", "cpylog==1.6.0", "docopt-ng==0.9.0", "colorama==0.4.6"]
    pip = [sys.executable, "-m", "pip", "install", "-q", "--no-deps", "--no-compile"]
    subprocess.run([*pip, "--target", str(folder), *packages], check=True)
    code = f"import sys; sys.path.append({str(folder)!r})\n{READ_NASTRAN}"

    def read(*files):
        command = [sys.executable, "-c", code, *files]
        run = subprocess.run(command, capture_output=True, text=True)
        assert run.returncode == 0, run.stderr
        return [json.loads(line) for line in run.stdout.splitlines() if line.startswith("[")]

    return read


def test_pynastran_reads_the_same_axes_and_thickness(tmp_path, pynastran):
    cases = [(name, order) for name in ("saddle", "plane", "hemisphere") for order in (1, 2)]
    files = [
        solved(name).export_fibres(
            tmp_path / f"{name}{order}.bdf", thickness=THICKNESS, order=order
        )
        for name, order in cases
    ]
    for (name, order), (kind, rows) in zip(cases, pynastran(*files), strict=True):
        result, rows = solved(name), np.array(rows)
        along, normal, thickness = rows[:, :3], rows[:, 3:6], rows[:, 6:]
        sheet, (warp, _, told) = shells(result, order, THICKNESS), table(result, tmp_path)
        assert kind == ("CTRIA3" if order == 1 else "CTRIA6")
        np.testing.assert_allclose(normal, corner_normals(sheet.nodes, sheet.triangles), atol=1e-6)
        # Of a curved element pyNastran knows the plane of the corners, and projects on that.
        assert angles_between(along, sheet.axes[:, 0], normal).max() < 0.01
        assert angles_between(along, warp, normal).max() < (0.01 if order == 1 else 0.3)
        assert np.einsum("ni,ni->n", along, warp).min() > 0.9
        expected = np.tile(THICKNESS * told["thickness"], (3, 1)).T
        np.testing.assert_allclose(thickness, expected, rtol=1e-6)


def test_a_reader_of_lsdyna_finds_the_angles_from_the_first_side(tmp_path, result):
    warp, _, rows = table(result, tmp_path)
    file = result.export_fibres(tmp_path / "cloth.k", thickness=THICKNESS)
    with DynaKeywordReader(str(file)) as reader:
        found = {keyword.full_keyword: keyword.cards for keyword in reader.keywords()}
    nodes, cards = found["*NODE"]["Card 1"], found["*ELEMENT_SHELL_THICKNESS_BETA"]
    points = np.stack([nodes[axis] for axis in "XYZ"], axis=-1)
    corners = np.stack([cards["Card 1"][f"N{k}"] for k in range(1, 5)], axis=-1) - 1
    np.testing.assert_array_equal(corners[:, 3], corners[:, 2])
    normals = corner_normals(points, corners)
    side = points[corners[:, 1]] - points[corners[:, 0]]
    side /= np.linalg.norm(side, axis=1, keepdims=True)
    beta = np.radians(cards["Card 2"]["BETA"])[:, None]
    axis = np.cos(beta) * side + np.sin(beta) * np.cross(normals, side)
    assert angles_between(axis, warp, normals).max() < 0.01
    assert np.einsum("ni,ni->n", axis, warp).min() > 0.9
    for k in range(1, 5):
        np.testing.assert_allclose(
            cards["Card 2"][f"THIC{k}"], THICKNESS * rows["thickness"], rtol=1e-6
        )


# Refused ----------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("argument", "name", "options"),
    [
        ("format", "cloth.inp", {"thickness": 1.0}),  # of Abaqus or of CalculiX?
        ("format", "cloth.bdf", {"format": "ansys", "thickness": 1.0}),
        ("format", "cloth.bdf", {"format": ["nastran"], "thickness": 1.0}),
        ("path", "cloth.cdb", {"thickness": 1.0}),
        ("path", "cloth.bdf", {"format": "abaqus", "thickness": 1.0}),
        ("path", "no/cloth.bdf", {"thickness": 1.0}),
        ("thickness", "cloth.bdf", {}),
        ("thickness", "cloth.bdf", {"thickness": 0.0}),
        ("thickness", "cloth.bdf", {"thickness": 1e300}),
        ("thickness", "cloth.bdf", {"thickness": 1e-300}),
        ("thickness", "cloth.bdf", {"thickness": "1 mm"}),
        ("thickness", "cloth.csv", {"thickness": 1.0}),
        ("order", "cloth.csv", {"order": 1}),
        ("order", "cloth.bdf", {"thickness": 1.0, "order": 3}),
        ("order", "cloth.k", {"thickness": 1.0, "order": 2}),
    ],
)
def test_what_no_solver_would_read_is_refused(tmp_path, saddle, argument, name, options):
    with pytest.raises(InputError) as error:
        saddle.export_fibres(tmp_path / name, **options)
    assert error.value.argument == argument
    assert not list(tmp_path.iterdir())


def test_folded_cloth_makes_no_shells(tmp_path):
    panel = Surface(lambda x, y: (x, y, 0 * x), Rectangle((0, 2), (0, 1)))
    result = ngcloth.solve(Scene(panel, Net(ks=1.0)), maxh=1, order=2)
    result.state.components[0].Set(ngs.x * (ngs.x - 1))
    with pytest.raises(InputError, match="folded"):
        result.export_fibres(tmp_path / "cloth.bdf", thickness=THICKNESS)
    assert not list(tmp_path.iterdir())
    result.export_fibres(tmp_path / "cloth.csv")
    assert np.genfromtxt(tmp_path / "cloth.csv", delimiter=",", names=True)["thickness"].min() < 0


def test_a_solve_that_failed_says_so_in_its_files(tmp_path):
    failed = ngcloth.solve(ngcloth.scenes.hemisphere(), maxh=0.5, max_steps=1)
    for name, format in (
        ("c.inp", "calculix"),
        ("a.inp", "abaqus"),
        ("n.bdf", None),
        ("d.k", None),
    ):
        file = failed.export_fibres(tmp_path / name, format, thickness=THICKNESS)
        assert "NOT CONVERGED" in file.read_text().splitlines()[0]
