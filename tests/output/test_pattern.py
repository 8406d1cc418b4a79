"""The cut pattern, read back by programs that are not ours: true scale, nothing mirrored."""

import csv
import dataclasses
import inspect
import pydoc
import subprocess
import sys
import warnings

import ezdxf
import numpy as np
import pytest
import shapely
import svgelements

import ngcloth
from ngcloth import Disk, InputError, Net, Rectangle, Scene, Surface
from ngcloth.output.pattern import cut_pattern, pinning_marks

LAYERS = ["cut", "seam", "warp", "weft", "mark", "text"]


@pytest.fixture(scope="module")
def hemisphere():
    return ngcloth.solve(ngcloth.scenes.hemisphere(), order=3, maxh=0.25)


@pytest.fixture(scope="module")
def hemicatenoid():
    return ngcloth.solve(ngcloth.scenes.hemicatenoid(), maxh=0.4)


def as_it_lies(chart, domain):
    """A cloth that lies in the plane as it is: the start ψ = (φ1, φ2) is the solution."""
    surface = Surface(lambda x, y: (*chart(x, y), 0 * x), domain)
    scene = Scene(surface=surface, fabric=Net(ks=1.0), start=chart, name="as it lies")
    result = ngcloth.solve(scene, maxh=0.4, order=4, max_steps=1)
    assert result.energy < 1e-4
    return dataclasses.replace(result, reason=ngcloth.Reason.CONVERGED)


@pytest.fixture(scope="module")
def lopsided():
    """A bent disk that differs from all its mirror images; 2 units high, 0.8 thick."""
    return as_it_lies(lambda x, y: (0.4 * x + 0.3 * y**2, y + 0.1 * x), Disk())


class Svg:
    """What svgelements makes of an SVG file, in mm, y upwards."""

    def __init__(self, path):
        self.root = svgelements.SVG.parse(str(path), ppi=25.4)
        self.groups = {
            g.id: g for g in self.root.select(lambda e: isinstance(e, svgelements.Group))
        }

    def curves(self, layer):
        """Points of the polylines of a layer, closed ones with their first point repeated."""
        return [
            np.array([(p.x, -p.y) for p in shape.as_points()])[self._vertices(shape)]
            for shape in self.groups[layer].select(lambda e: isinstance(e, svgelements.Path))
        ]

    def texts(self, layer):
        found = self.groups[layer].select(lambda e: isinstance(e, svgelements.SVGText))
        return [text.text for text in found]

    @staticmethod
    def _vertices(shape):
        """Points are those of the segments, of which each starts where the one before ends."""
        count = len(list(shape.as_points()))
        return np.r_[0, np.arange(2, count, 2)] if count > 2 else np.arange(count)


class Dxf:
    """What ezdxf makes of a DXF file."""

    def __init__(self, path):
        self.document = ezdxf.readfile(path)
        assert not self.document.audit().errors
        self.space = self.document.modelspace()

    def curves(self, layer):
        curves = []
        for line in self.space.query(f'LWPOLYLINE[layer=="{layer}"]'):
            points = np.array(line.get_points("xy"))
            curves.append(np.concatenate([points, points[:1]]) if line.closed else points)
        return curves

    def texts(self, layer):
        return [text.dxf.text for text in self.space.query(f'TEXT[layer=="{layer}"]')]


def export(result, folder, kind, **options):
    path = folder / f"pattern.{kind}"
    getattr(result, f"export_{kind}")(path, **options)
    return {"svg": Svg, "dxf": Dxf}[kind](path)


def only_polygon(read, layer):
    (curve,) = read.curves(layer)
    np.testing.assert_array_equal(curve[0], curve[-1])
    polygon = shapely.Polygon(curve)
    assert polygon.is_valid
    return polygon


# True scale --------------------------------------------------------------------------------------


@pytest.mark.parametrize("kind", ["svg", "dxf"])
@pytest.mark.parametrize("unit_mm", [5, 1000])
def test_cut_has_the_area_and_perimeter_of_the_patch(tmp_path, hemisphere, kind, unit_mm):
    options = {"unit_mm": unit_mm, "pitch": unit_mm / 10}
    cut = only_polygon(export(hemisphere, tmp_path, kind, **options), "cut")
    rim = np.append(hemisphere.outline(20000), [hemisphere.psi(1, 0)], axis=0)
    perimeter = np.linalg.norm(np.diff(rim, axis=0), axis=1).sum()
    assert cut.area == pytest.approx(unit_mm**2 * hemisphere.area, rel=1e-4)
    assert cut.length == pytest.approx(unit_mm * perimeter, rel=1e-5)


def test_svg_sheet_is_in_mm_and_holds_everything(tmp_path, hemisphere):
    svg = export(hemisphere, tmp_path, "svg", seam=10)
    values = svg.root.values
    width, height = (float(values[side].removesuffix("mm")) for side in ("width", "height"))
    assert values["width"].endswith("mm") and values["height"].endswith("mm")
    assert values["viewBox"].split() == ["0", "0", f"{width:.4f}", f"{height:.4f}"]
    for layer in LAYERS:
        for curve in svg.curves(layer):
            assert curve.min(axis=0).min() >= -height and curve[:, 0].min() >= 9.999
            assert curve[:, 0].max() <= width - 9.999 and curve[:, 1].max() <= -9.999


def test_dxf_is_in_mm_and_opens_on_the_pattern(tmp_path, hemisphere):
    dxf = export(hemisphere, tmp_path, "dxf")
    assert dxf.document.header["$INSUNITS"] == 4
    assert dxf.document.header["$MEASUREMENT"] == 1
    (view,) = dxf.document.viewports.get("*Active")
    assert 300 < view.dxf.height < 600


@pytest.mark.parametrize("kind", ["svg", "dxf"])
def test_scale_is_stated_and_can_be_checked_with_a_ruler(tmp_path, hemisphere, kind):
    read = export(hemisphere, tmp_path, kind, unit_mm=250, pitch=20, seam=10)
    square = only_polygon(read, "text")
    assert np.ptp(np.array(square.exterior.coords), axis=0) == pytest.approx(100, abs=1e-4)
    assert square.area == pytest.approx(1e4, rel=1e-5)
    assert square.distance(only_polygon(read, "cut")) > 5
    label = "\n".join(read.texts("text"))
    for said in (hemisphere.scene.name, str(hemisphere.scene.fabric), "= 250 mm", "100 mm",
                 "every 20 mm", "allowance: 10 mm"):  # fmt: skip
        assert said in label


# Curves ------------------------------------------------------------------------------------------


@pytest.mark.parametrize("tolerance", [0.5, 0.01])
@pytest.mark.parametrize("scene", ["hemisphere", "hemicatenoid"])
def test_outline_keeps_its_tolerance(request, scene, tolerance):
    result = request.getfixturevalue(scene)
    pattern = cut_pattern(result, tolerance=tolerance)
    ring = shapely.LinearRing(pattern.outline)
    rim = shapely.points(100 * result.outline(5003))
    assert shapely.distance(ring, rim).max() < tolerance
    assert len(pattern.outline) < 3000


def test_corners_are_kept(hemicatenoid):
    outline = cut_pattern(hemicatenoid, tolerance=1).outline
    for theta1 in (0, np.pi):
        for theta2 in (-1, 1):
            corner = 100 * hemicatenoid.psi(theta1, theta2)
            assert np.linalg.norm(outline - corner, axis=1).min() < 1e-9


@pytest.mark.parametrize("kind", ["svg", "dxf"])
def test_nothing_is_mirrored_or_turned(tmp_path, lopsided, kind):
    read = np.array(only_polygon(export(lopsided, tmp_path, kind), "cut").exterior.coords)
    expected = 100 * lopsided.outline(2000)
    read += expected.max(axis=0) - read.max(axis=0)
    same = shapely.Polygon(expected)
    assert same.symmetric_difference(shapely.Polygon(read)).area < 1e-3 * same.area
    for mirror in ([-1, 1], [1, -1], [-1, -1]):
        image = read * mirror
        image += expected.max(axis=0) - image.max(axis=0)
        assert same.symmetric_difference(shapely.Polygon(image)).area > 0.05 * same.area


@pytest.mark.parametrize("kind", ["svg", "dxf"])
@pytest.mark.parametrize("scene, exact", [("hemisphere", True), ("hemicatenoid", False)])
def test_seam_allowance_is_a_true_offset(request, tmp_path, kind, scene, exact):
    read = export(request.getfixturevalue(scene), tmp_path, kind, seam=10, tolerance=0.01)
    seam, cut = only_polygon(read, "seam"), only_polygon(read, "cut")
    distances = shapely.distance(shapely.points(cut.exterior.segmentize(1).coords), seam)
    assert np.abs(distances - 10).max() < 0.011
    steiner = seam.area + 10 * seam.length + 100 * np.pi
    assert cut.area < steiner * (1 + 1e-6)  # equal where no circle of 10 mm is pinched
    assert cut.area == pytest.approx(steiner, rel=1e-5 if exact else 1e-3)


def test_without_allowance_there_is_no_seam(tmp_path, hemisphere):
    assert export(hemisphere, tmp_path, "svg").curves("seam") == []
    assert export(hemisphere, tmp_path, "dxf").curves("seam") == []


# Threads, grain ----------------------------------------------------------------------------------


@pytest.mark.parametrize("kind", ["svg", "dxf"])
@pytest.mark.parametrize("scene, width", [("hemisphere", 314.2), ("hemicatenoid", 365.5)])
def test_threads_are_straight_at_their_pitch_and_fill_the_patch(
    request, tmp_path, kind, scene, width
):
    read = export(request.getfixturevalue(scene), tmp_path, kind, pitch=8)
    cut = only_polygon(read, "cut")
    for layer, along in (("warp", 0), ("weft", 1)):
        threads = np.array(read.curves(layer))
        assert threads.shape[1:] == (2, 2)
        assert np.abs(np.ptp(threads[:, :, 1 - along], axis=1)).max() < 1e-5
        levels = np.unique(threads[:, 0, 1 - along].round(4))
        np.testing.assert_allclose(np.diff(levels), 8, atol=2e-4)
        assert 8 * np.ptp(threads, axis=1).sum() == pytest.approx(cut.area, rel=0.01)
        assert cut.buffer(1e-4).covers(shapely.MultiLineString(list(threads)))
        ends = shapely.points(threads.reshape(-1, 2))
        assert shapely.distance(cut.exterior, ends).max() < 1e-4
        if layer == "warp":
            assert len(levels) == int(width / 2 / 8) * 2 + 1


def test_grain_arrow_lies_along_the_warp_on_the_cloth(tmp_path, lopsided):
    read = export(lopsided, tmp_path, "dxf", marks=0)
    shaft, *heads = read.curves("mark")
    assert np.ptp(shaft[:, 1]) == 0 and np.ptp(shaft[:, 0]) > 20
    assert len(heads) == 2 and read.texts("mark") == ["warp"]
    cut = only_polygon(read, "cut")
    assert all(cut.contains(shapely.LineString(curve)) for curve in (shaft, *heads))


# Marks -------------------------------------------------------------------------------------------


@pytest.mark.parametrize("kind", ["svg", "dxf"])
@pytest.mark.parametrize("scene", ["hemisphere", "hemicatenoid"])
def test_marks_lie_on_the_outline_and_match_those_on_the_surface(request, tmp_path, kind, scene):
    result = request.getfixturevalue(scene)
    read = export(result, tmp_path, kind, marks=12, marks_csv=tmp_path / "marks.csv")
    outline = only_polygon(read, "cut")
    ticks = np.array(read.curves("mark")[:12])
    starts = ticks[:, 0]
    assert shapely.distance(outline.exterior, shapely.points(starts)).max() < 0.01
    assert all(outline.buffer(0.01).covers(shapely.LineString(tick)) for tick in ticks)
    assert read.texts("mark")[:12] == [str(i) for i in range(1, 13)]

    with open(tmp_path / "marks.csv", newline="", encoding="utf-8") as file:
        table = np.array([[float(v) for v in row.values()] for row in csv.DictReader(file)])
    number, flat, theta, space = np.split(table, [1, 3, 5], axis=1)
    assert number[:, 0].tolist() == list(range(1, 13))
    np.testing.assert_allclose(starts - starts[0], flat - flat[0], atol=1e-3)
    np.testing.assert_allclose(flat, 100 * result.psi(*theta.T), atol=1e-3)
    surface = result.scene.surface
    np.testing.assert_allclose(space, 100 * surface.evaluate(surface.position, theta), atol=1e-3)


def test_pinning_marks_of_the_hemisphere_are_on_its_equator(hemisphere):
    marks = pinning_marks(hemisphere, 4)
    np.testing.assert_allclose(
        marks.space, [[1, 0, 0], [0, 1, 0], [-1, 0, 0], [0, -1, 0]], atol=1e-9
    )
    np.testing.assert_allclose(marks.flat[0], [np.pi / 2, 0], atol=1e-3)


def test_label_says_which_face_is_drawn(hemisphere):
    dome = Surface(lambda x, y: (x, y, -0.2 * (x**2 + y**2)), Disk())
    above = ngcloth.solve(Scene(surface=dome, fabric=Net(), symmetric=True), maxh=0.5)
    for result, said in ((hemisphere, "lies against"), (above, "looks away from")):
        pattern, surface = cut_pattern(result), result.scene.surface
        assert shapely.Polygon(pattern.outline).exterior.is_ccw
        rim = pattern.marks.space
        pole = 100 * surface.evaluate(surface.position, surface.domain.centre)
        seen_from = np.cross(rim - pole, np.roll(rim, -1, axis=0) - pole).sum(axis=0)
        outwards = pole - rim.mean(axis=0)
        assert (seen_from @ outwards > 0) == (said == "looks away from")
        assert any(said in item.text for item in pattern.layers["text"][1:])


# Layers ------------------------------------------------------------------------------------------


def test_layers_have_names_and_colours(tmp_path, hemisphere):
    svg, dxf = (export(hemisphere, tmp_path, kind, seam=5) for kind in ("svg", "dxf"))
    label = "{http://www.inkscape.org/namespaces/inkscape}"
    strokes, colours = set(), set()
    for name in LAYERS:
        group = svg.groups[name]
        assert group.values[f"{label}groupmode"] == "layer"
        assert group.values[f"{label}label"] == name
        strokes.add(group.values["stroke"])
        colours.add(dxf.document.layers.get(name).color)
        assert len(svg.curves(name)) == len(dxf.curves(name)) > 0
        assert svg.texts(name) == dxf.texts(name)
    assert len(strokes) == len(colours) == len(LAYERS)


def test_dxf_shows_on_dark_and_bright_screens(tmp_path, hemisphere):
    """Colour 7 is the only one that programs turn from black to white; an RGB value stays."""
    layers = export(hemisphere, tmp_path, "dxf").document.layers
    assert layers.get("text").color == 7 and layers.get("text").rgb is None
    assert layers.get("cut").rgb == (224, 0, 0)


def test_dxf_is_written_in_the_encoding_that_it_names(tmp_path, hemisphere):
    """GDAL, for one, believes the header also where the version of the format says UTF-8."""
    named = dataclasses.replace(hemisphere.scene, name="Kuppel für |γ| ≤ 0.5")
    export(dataclasses.replace(hemisphere, scene=named), tmp_path, "dxf")
    written = (tmp_path / "pattern.dxf").read_bytes()
    header = written.split(b"$DWGCODEPAGE")[1].split()
    assert header[1] == b"ANSI_1252"
    assert " cm²" in written.decode("cp1252")
    assert b"\\U+" not in written  # what AutoCAD decodes, but few other programs do
    assert "Kuppel für |gamma| <= 0.5" in Dxf(tmp_path / "pattern.dxf").texts("text")


# Warnings, refusals ------------------------------------------------------------------------------


def test_a_sound_patch_is_written_without_a_warning(tmp_path, hemicatenoid):
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        export(hemicatenoid, tmp_path, "svg", seam=10)


def test_overlap_is_warned_of(tmp_path):
    import ngsolve as ngs

    wound = as_it_lies(
        lambda x, y: ((1 + x) * ngs.cos(y), (1 + x) * ngs.sin(y)), Rectangle((0, 1), (0, 7.5))
    )
    with pytest.warns(UserWarning, match="overlaps itself") as caught:
        export(wound, tmp_path, "svg", seam=3)
    assert caught[0].filename == __file__


def test_narrow_parts_are_warned_of(tmp_path):
    waist = as_it_lies(lambda x, y: (x, y * (0.02 + x**2)), Rectangle((-1, 1), (-1, 1)))
    with pytest.warns(UserWarning, match="narrower than 2 mm.*at \\(-?0.0, "):
        export(waist, tmp_path, "dxf", unit_mm=40)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        export(waist, tmp_path, "dxf", unit_mm=100)


def test_what_did_not_converge_says_so(tmp_path):
    result = ngcloth.solve(ngcloth.scenes.hemisphere(), maxh=0.5, max_steps=2)
    assert not result.converged
    with pytest.warns(UserWarning, match="not converge"):
        read = export(result, tmp_path, "svg")
    assert any("NOT CONVERGED" in line for line in read.texts("text"))


@pytest.mark.parametrize(
    "wrong",
    [
        {"unit_mm": 0},
        {"unit_mm": "100"},
        {"unit_mm": 1e-300},
        {"unit_mm": 1e300},
        {"pitch": -1},
        {"pitch": 1e-6},
        {"pitch": np.inf},
        {"seam": -5},
        {"seam": 1e9},
        {"marks": 2.5},
        {"marks": 100_000},
        {"tolerance": 0},
        {"tolerance": 1e-14},
        {"tolerance": 1e3},
    ],
)
def test_bad_options_are_refused_before_a_file_is_written(tmp_path, hemisphere, wrong):
    for kind in ("svg", "dxf"):
        with pytest.raises(InputError, match=next(iter(wrong))):
            export(hemisphere, tmp_path, kind, **wrong)
    assert not list(tmp_path.iterdir())


def test_a_large_patch_has_threads_farther_apart(hemisphere):
    """50 m: 10 mm between threads would be refused, though nobody has asked for it."""
    pattern = cut_pattern(hemisphere, unit_mm=2e4, tolerance=1.0)
    levels = np.unique([line.points[0, 1].round(3) for line in pattern.layers["warp"]])
    assert np.diff(levels).min() > 40


@pytest.mark.parametrize("kind", ["svg", "dxf"])
def test_help_tells_every_option(hemisphere, kind):
    """Options are written once, at `cut_pattern`, and shown where one looks for them."""
    method = getattr(hemisphere, f"export_{kind}")
    shown = inspect.signature(method).parameters
    options = dict(inspect.signature(cut_pattern).parameters)
    del options["result"]
    assert set(shown) == {"path", "marks_csv", *options}
    told = pydoc.plain(pydoc.render_doc(method))
    for name, option in options.items():
        assert shown[name] == option and f"{name}={option.default!r}" in told
        assert f"\n    {name} : " in told
    for section in ("Parameters", "Warns", "Raises"):
        assert told.count(f"{section}\n    ---") == 1
    assert "**options" not in told and "Returns" not in told


@pytest.mark.parametrize(
    ("missing", "kind", "options"), [("shapely", "svg", {"seam": 5}), ("ezdxf", "dxf", {})]
)
def test_a_missing_extra_is_named(tmp_path, monkeypatch, hemisphere, missing, kind, options):
    monkeypatch.setitem(sys.modules, missing, None)
    with pytest.raises(ImportError, match=r"'ngcloth\[cut\]', in a clone '\.\[cut\]'"):
        export(hemisphere, tmp_path, kind, **options)
    assert not list(tmp_path.iterdir())


def test_the_core_alone_gives_the_pattern(tmp_path):
    """What setup.cfg requires, and what that requires, writes the SVG of the command line."""
    code = """
import sys
for extra in ("shapely", "ezdxf", "svgelements", "tqdm", "casadi", "playwright"):
    sys.modules[extra] = None
from ngcloth.__main__ import main
sys.exit(main())
"""
    options = ["hemisphere", "--maxh", "0.4", "--quiet", "--out", str(tmp_path)]
    run = subprocess.run([sys.executable, "-c", code, *options], capture_output=True, text=True)
    assert run.returncode == 0
    (left_out,) = run.stderr.splitlines()
    assert left_out.startswith("ngcloth: pattern.dxf left out")
    svg = Svg(tmp_path / "pattern.svg")
    area = 100**2 * ngcloth.load(tmp_path / "result").area
    assert only_polygon(svg, "cut").area == pytest.approx(area, rel=1e-4)
    assert np.ptp(only_polygon(svg, "text").exterior.coords, axis=0) == pytest.approx(100, abs=1e-4)
    threads = sum(np.linalg.norm(np.diff(curve, axis=0)) for curve in svg.curves("warp"))
    assert 10 * threads == pytest.approx(area, rel=0.01)
    assert svg.texts("mark") == [*map(str, range(1, 13)), "warp"]
