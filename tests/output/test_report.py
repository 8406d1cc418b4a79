"""What a person looks at: `Result.plot`, `Result.view`, and the page, read and opened."""

import base64
import io
import json
from dataclasses import replace
from functools import cache
from html.parser import HTMLParser

import matplotlib
import numpy as np
import pytest

import ngcloth
from ngcloth import (
    BendingThreads,
    Disk,
    Families,
    InputError,
    Net,
    Reason,
    Rectangle,
    Scene,
    Surface,
    Turned,
)

matplotlib.use("Agg")
import matplotlib.pyplot as plt  # noqa: E402
from matplotlib.colors import to_rgb  # noqa: E402

from ngcloth import plot  # noqa: E402
from ngcloth.output.angles import BANDS  # noqa: E402
from ngcloth.output.report import RINGS  # noqa: E402

RADIUS = np.sqrt(1.25)  # of the ball around the box around the hemisphere
VOID = {"meta", "link", "img", "br", "input"}


@cache
def solved(name):
    if name == "claimed":
        return replace(solved("cut short"), reason=Reason.CONVERGED)
    plane = Surface(lambda x, y: (x, y, 0 * x), Rectangle((0, 3), (1, 2)))
    scene, settings = {
        "chebyshev": (ngcloth.scenes.hemisphere(), {"maxh": 0.2}),
        "coarse": (ngcloth.scenes.hemisphere(1.0), {"maxh": 0.3}),
        "cut short": (ngcloth.scenes.hemisphere(1.0), {"maxh": 0.3, "max_steps": 6}),
        "plane": (Scene(plane, Net(ks=1.0), name="<script>alert('&')</script>"), {"maxh": 1}),
    }[name]
    return ngcloth.solve(scene, **settings)


@pytest.fixture(scope="module")
def written(tmp_path_factory):
    folder = tmp_path_factory.mktemp("pages")

    @cache
    def page(name):
        return ngcloth.report(solved(name), folder / f"{name}.html")

    return page


@pytest.fixture(autouse=True)
def no_figures_left():
    yield
    plt.close("all")


class Reader(HTMLParser):
    """The tags of a page with their attributes and texts; fails where they do not nest."""

    def __init__(self, path):
        super().__init__()
        self.open, self.tags = [], []
        self.feed(path.read_text(encoding="utf-8"))
        self.close()
        assert not self.open

    def handle_starttag(self, tag, attributes):
        self.tags.append([tag, dict(attributes), ""])
        if tag not in VOID:
            self.open.append(self.tags[-1])

    def handle_endtag(self, tag):
        assert self.open.pop()[0] == tag

    def handle_data(self, data):
        for tag in self.open:
            tag[2] += data

    def all(self, tag):
        return [(attributes, text) for each, attributes, text in self.tags if each == tag]

    def verdict(self):
        return self.all("div")[0][0], self.all("p")[0][1]

    def cloth(self):
        return next(json.loads(text) for it, text in self.all("script") if it.get("id") == "cloth")


# Pictures ---------------------------------------------------------------------------------------


def test_plot_shows_the_patch_with_its_threads():
    result = solved("chebyshev")
    ax = result.plot()
    assert ax.get_title() == "" and ax.get_aspect() == 1
    outline = np.array(ax.lines[0].get_data()).T
    np.testing.assert_allclose(outline[:-1], result.outline())
    warp, weft = (len(threads.get_paths()) for threads in ax.collections)
    assert warp == weft == plot.THREADS


def test_plot_of_the_domain_has_the_same_threads_and_a_field():
    result = solved("chebyshev")
    _, ax = plt.subplots()
    assert result.plot("shear", where="domain", ax=ax) is ax
    np.testing.assert_allclose(np.hypot(*ax.lines[0].get_data()), 1)  # the unit disk
    field, warp, weft = ax.collections
    assert field.get_clim()[1] == pytest.approx(0.8, abs=0.02)
    pitch = plot.default_pitch(result.outline())
    for threads, component in ((warp, 1), (weft, 0)):
        theta = np.concatenate([path.vertices for path in threads.get_paths()])
        level = result.psi(*(0.9999 * theta).T)[:, component] / pitch
        assert np.abs(level - np.rint(level)).max() < 0.02


@pytest.mark.parametrize("where", ["patch", "domain"])
@pytest.mark.parametrize("field", [None, "stretch1", "shear", "reaction"])
def test_nothing_of_a_plot_sticks_out_of_its_picture(tmp_path, field, where):
    figure = solved("coarse").plot(field, where).figure
    figure.savefig(tmp_path / "patch.png")
    assert len(figure.axes) == (1 if field is None else 2)
    for ax in figure.axes:
        box = ax.get_tightbbox()
        assert box.min.min() > 2 and (figure.bbox.max - box.max).min() > 2


def test_plot_of_the_history_shows_every_step():
    result = solved("coarse")
    ax = result.plot(where="history")
    lines = {line.get_label().split(" ")[0]: line.get_data() for line in ax.lines}
    assert set(lines) == {"energy", "residual", "weight"} and ax.get_yscale() == "log"
    for key, column in (("energy", "energy"), ("weight", "mu")):
        np.testing.assert_array_equal(lines[key][0], [row.newton for row in result.history])
        np.testing.assert_array_equal(lines[key][1], [getattr(r, column) for r in result.history])
    assert lines["energy"][1][-1] == pytest.approx(result.normalized_energy, rel=1e-6)


def test_plot_says_not_converged():
    for where in plot.PLACES:
        assert solved("cut short").plot(where=where).get_title() == "not converged"


@pytest.mark.parametrize(
    "wrong",
    [{"field": "colour"}, {"field": ["shear"]}, {"where": "moon"},
     {"field": "shear", "where": "history"}],
)  # fmt: skip
def test_what_cannot_be_plotted_is_refused_without_a_figure(wrong):
    with pytest.raises(InputError):
        solved("chebyshev").plot(**wrong)
    assert not plt.get_fignums()


def test_a_result_without_steps_has_no_history_to_plot():
    with pytest.raises(InputError, match="accepted no step"):
        replace(solved("chebyshev"), history=[]).plot(where="history")


def test_threads_of_a_strip_are_drawn():
    strip = Surface(lambda x, y: (x, y, 0 * x), Rectangle((0, 9), (0, 0.2)))
    ax = ngcloth.solve(Scene(strip, Net(ks=1.0)), maxh=1).plot()
    assert all(len(threads.get_paths()) > 1 for threads in ax.collections)


def test_view_writes_a_picture(tmp_path):
    result = solved("plane")
    with pytest.raises(InputError):
        result.view("colour")
    result.view("shear", pitch=0.25, screenshot=tmp_path / "cloth.png")
    assert 0.1 < (plt.imread(tmp_path / "cloth.png")[..., :3] < 0.99).any(axis=-1).mean() < 0.9


# The page, read ---------------------------------------------------------------------------------


@pytest.mark.parametrize("name", ["chebyshev", "claimed", "cut short"])
def test_page_is_small_and_loads_nothing(written, name):
    page = Reader(written(name))
    assert written(name).stat().st_size < 2e6
    for tag, attributes, text in page.tags:
        assert tag not in ("iframe", "object", "embed", "base")
        for key in ("src", "href", "srcset", "action", "data"):
            assert attributes.get(key, "data:").startswith("data:")
        if tag in ("style", "script"):
            assert not any(
                word in text for word in ("http:", "https:", "url(", "@import", "fetch(")
            )


def test_page_has_a_place_for_the_error_bar(tmp_path):
    bars = {"energy": 0.0123 * solved("plane").scene.normalisation, "area": None, "outline": None}
    with_bar = replace(solved("plane"), error=bars)
    (_, text), *_ = Reader(ngcloth.report(with_bar, tmp_path / "page.html")).all("body")
    assert "± 1.2e-02" in text


def test_page_tells_the_result(written):
    result, page = solved("chebyshev"), Reader(written("chebyshev"))
    assert page.verdict() == ({"class": "verdict good"}, "Converged and certified:")
    (_, text), *_ = page.all("body")
    assert all(finding in text for finding in result.certificate().findings)
    assert all(line in text for line in str(result.scene).splitlines())
    numbers = [result.energy, result.area, *result.extrema["stretch1"], *result.extrema["shear"]]
    for number in numbers:
        assert f"{number:.6g}" in text
    for limit, (area, share) in result.area_beyond().items():
        assert f"{limit:g}°{area:.6g}{share:.1%}" in text
    for word in ("sparsecholesky", "Newton steps", f"{result.seconds:.2f}", ngcloth.__version__):
        assert word in text
    assert "equilibrium" not in text  # nothing to hold


@pytest.mark.parametrize(("name", "count"), [("chebyshev", 7), ("cut short", 8)])
def test_figures_are_drawn(written, name, count):
    figures = Reader(written(name)).all("img")
    assert len(figures) == count  # the reaction only where there is stress
    for attributes, _ in figures:
        picture = base64.b64decode(attributes["src"].removeprefix("data:image/png;base64,"))
        pixels = plt.imread(io.BytesIO(picture))[..., :3]
        assert 0.03 < (pixels < 0.9).any(axis=-1).mean() < 0.9
        assert attributes["alt"]


def test_page_without_convergence_says_so_first(written):
    attributes, text = Reader(written("cut short")).verdict()
    assert attributes["class"] == "verdict bad"
    assert text.startswith("Not converged. Stopped: the budget of Newton steps is used up.")
    assert ".bad { background: #c01818" in written("cut short").read_text(encoding="utf-8")


def test_page_without_certificate_says_what_is_missed(written):
    attributes, text = Reader(written("claimed")).verdict()
    assert attributes["class"] == "verdict doubtful"
    assert text == "Converged, but not certified:"
    told = [text for _, text in Reader(written("claimed")).all("li")]
    assert told == solved("claimed").certificate().faults != []


@pytest.mark.parametrize("fabric", [Families((0, 60, 120)), BendingThreads(Net(ks=1.0), 0.1)])
def test_pages_of_other_fabrics(fabric, tmp_path):
    """Of a third family, and of threads that bend."""
    flat = Surface(lambda x, y: (x, y, 0 * x), Disk())
    result = ngcloth.solve(Scene(flat, fabric), maxh=1.0)
    page = Reader(ngcloth.report(result, tmp_path / "page.html"))
    (_, text), *_ = page.all("body")
    assert ("stretch of family 3" in text) == isinstance(fabric, Families)
    assert page.verdict()[1] == "Converged and certified:"


def test_the_page_draws_threads_where_they_run(tmp_path):
    """Those of cloth that is turned by 90° are those of the other family."""
    flat = Surface(lambda x, y: (x, y, 0 * x), Disk())
    found = []
    for angle in (0, 30, 90):
        result = ngcloth.solve(Scene(flat, Turned(Net(ks=1.0), angle)), maxh=1.0)
        page = Reader(ngcloth.report(result, tmp_path / "page.html"))
        lines = np.reshape(page.cloth()["lines"], (-1, 3))[:, :2] / 1000
        psi = result.psi(*plot.sample(result, RINGS)[0].T)
        found.append((np.linalg.pinv(psi) @ lines * plot.default_pitch(psi)).T)
    for turn, angle in zip(found, np.radians((0, 30, 90)), strict=True):
        c, s = np.cos(angle), np.sin(angle)
        np.testing.assert_allclose(turn, [[c, s], [-s, c]], atol=1e-3)


def test_cloth_is_the_hemisphere_with_its_threads(written):
    cloth, result = Reader(written("chebyshev")).cloth(), solved("chebyshev")
    points = RADIUS * np.reshape(cloth["points"], (-1, 3)) / 1e4 + [0, 0, 0.5]
    np.testing.assert_allclose(np.linalg.norm(points, axis=1), 1, atol=3e-4)
    normals = np.reshape(cloth["normals"], (-1, 3)) / 100
    np.testing.assert_allclose(normals, points, atol=0.02)  # the cloth lies outside
    corners = points[np.reshape(cloth["triangles"], (-1, 3))]
    first, second = np.moveaxis(corners[:, 1:] - corners[:, :1], 1, 0)
    area = np.linalg.norm(np.cross(first, second), axis=1).sum() / 2
    assert area == pytest.approx(2 * np.pi, rel=2e-3)
    assert len(corners) < 10_000  # which a browser draws in a moment
    lines = np.reshape(cloth["lines"], (-1, 3)) / 1000
    rim = lines[:, 2] == 0
    np.testing.assert_allclose(points[rim, 2], 0, atol=3e-4)
    outline = result.outline(120)
    np.testing.assert_allclose(lines[rim, :2] * plot.default_pitch(outline), outline, atol=1e-3)
    shear = cloth["fields"][2]
    values = np.interp(shear["values"], [0, 255], [float(shear["low"]), float(shear["high"])])
    assert values[rim].max() == pytest.approx(result.extrema["shear"][1], abs=0.02)


def test_names_are_text_and_links_lead_to_files_beside_the_page(tmp_path):
    (tmp_path / "run 1").mkdir()
    (tmp_path / "run 1" / "cut & sew.svg").touch()
    files = ["run 1", tmp_path / "run 1" / "cut & sew.svg"]
    page = Reader(ngcloth.report(solved("plane"), tmp_path / "page.html", files))
    assert page.all("a") == [
        ({"href": "run%201"}, "run 1"),
        ({"href": "run%201/cut%20%26%20sew.svg"}, "run 1/cut & sew.svg"),
    ]
    assert [text for _, text in page.all("h1")] == ["<script>alert('&')</script>"]
    assert len(page.all("script")) == 2
    # The stretches of a plane are constant.
    assert all(0 <= value <= 255 for field in page.cloth()["fields"] for value in field["values"])


@pytest.mark.parametrize(
    ("path", "files"),
    [("page.txt", ()), ("no/page.html", ()), (3, ()), ("page.html", ["absent.svg"]),
     ("page.html", ["../elsewhere"]), ("page.html", "a.svg"), ("page.html", [None])],
)  # fmt: skip
def test_pages_that_cannot_be_are_refused(tmp_path, path, files):
    with pytest.raises(InputError):
        ngcloth.report(None, tmp_path / path if isinstance(path, str) else path, files)
    assert not list(tmp_path.iterdir())


def test_a_page_is_of_a_result(tmp_path):
    with pytest.raises(InputError, match="result = None"):
        ngcloth.report(None, tmp_path / "page.html")
    with pytest.raises(InputError, match="result = None"):
        ngcloth.verify(None)


# The page, opened -------------------------------------------------------------------------------


def drawn(page):
    """What the canvas shows, (height, width, 4), once it has been drawn."""
    page.wait_for_function(
        "!waiting && canvas.clientWidth > 0 && canvas.width == 2 * canvas.clientWidth"
    )
    data = page.evaluate("canvas.toDataURL()")
    return plt.imread(io.BytesIO(base64.b64decode(data.partition(",")[2])))


@pytest.mark.parametrize("size", [(1280, 900), (390, 844)])
def test_page_opens_and_the_cloth_turns_under_the_mouse(written, browser, size):
    page = browser.new_page(viewport={"width": size[0], "height": size[1]})
    said, asked = [], []
    page.on("console", lambda message: said.append(message.text))
    page.on("pageerror", lambda error: said.append(str(error)))
    page.on("request", lambda request: asked.append(request.url))
    page.goto(written("chebyshev").as_uri())
    assert page.evaluate("document.documentElement.scrollWidth") == size[0]  # nothing sticks out

    before = drawn(page)
    height, width, _ = before.shape
    assert 0.1 < (before[..., 3] > 0).mean() < 0.6
    blue, red = (before[..., i] - before[..., 2 - i] for i in (2, 0))
    assert blue.max() > 0.3 and red.max() > 0.3  # warp and weft

    box = page.locator("#view").bounding_box()
    x, y = box["x"] + box["width"] / 2, box["y"] + box["height"] / 4
    page.mouse.move(x, y)
    page.mouse.down()
    page.mouse.move(x, y + 150, steps=5)  # 60 degrees up, more than to the pole
    page.mouse.up()
    above = drawn(page)[..., 3] > 0
    radius = 0.49 * min(width, height) / RADIUS
    assert above.mean() == pytest.approx(np.pi * radius**2 / (width * height), rel=0.01)
    assert above[:, width // 2].sum() == pytest.approx(2 * radius, rel=0.01)

    page.select_option("#field", label="shear γ")
    shear = drawn(page)[..., :3]
    assert page.locator("#map").bounding_box()["width"] > 100
    extreme = solved("chebyshev").extrema["shear"][1]
    assert float(page.inner_text("#high")) == pytest.approx(extreme, abs=0.02)
    for sign, degrees in ((-1, 15), (1, 105), (-1, 195), (1, 285)):  # θ1 = θ2 first, from outside
        angle = np.radians(degrees)
        x, y = 0.93 * radius * np.cos(angle), 0.93 * radius * np.sin(angle)
        red, _, blue = shear[round(height / 2 - y), round(width / 2 + x)]
        assert sign * (red - blue) > 0.2
    page.select_option("#field", label="shear angle [°]")
    angle = drawn(page)[..., :3]
    assert page.locator("#map u").all_inner_texts() == ["15", "30"]
    colours, turn = np.array([to_rgb(band) for band in BANDS]), np.radians(15)
    for polar, band in ((0.0, 0), (0.5, 0), (0.77, 1), (0.95, 2)):  # on a diagonal
        x, y = polar * radius * np.cos(turn), polar * radius * np.sin(turn)
        here = angle[round(height / 2 - y) + 4, round(width / 2 + x) + 4]
        there = np.linalg.norm(here / here.max() - colours / colours.max(1, keepdims=True), axis=1)
        assert there.argmin() == band
    for display in ("none", ""):  # as while a page is laid out, or in a tab behind
        page.evaluate(f"canvas.style.display = '{display}'; drawn()")
    assert (drawn(page)[..., 3] > 0).any()
    assert said == [] and asked == [written("chebyshev").as_uri()]
    page.close()
