"""The site, built with warnings as errors, and opened in a browser. Needs the extra ``docs``."""

import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

import ngcloth

pytestmark = pytest.mark.slow

ROOT = Path(__file__).parents[1]
SIZES = [(1280, 900), (390, 844)]
PAGES = ("index", "tour", "gallery/index", "gallery/hemisphere", "method", "reference/class.Result")


@pytest.fixture(scope="module")
def site(tmp_path_factory):
    """The folder of the built site; every link inside it is checked by Sphinx."""
    out = tmp_path_factory.mktemp("site")
    build = [sys.executable, "-m", "sphinx", "-W", "--keep-going", "-n", "-q", "docs", out]
    done = subprocess.run(build, cwd=ROOT, capture_output=True, encoding="utf-8")
    assert done.returncode == 0, done.stderr
    return out


@pytest.fixture(params=SIZES, ids=["desktop", "phone"])
def opened(request, site, browser):
    """A function that opens a page of the site, and fails where the page complains."""
    width, height = request.param
    page = browser.new_page(viewport={"width": width, "height": height})
    said, asked = [], []
    page.on("pageerror", lambda error: said.append(str(error)))
    page.on("request", lambda request: asked.append(request.url))

    def open_page(name):
        page.goto((site / f"{name}.html").as_uri())
        return page

    yield open_page
    outside = [url for url in asked if not url.startswith(("file:", "data:", "blob:", "about:"))]
    page.close()
    assert not said and not outside


@pytest.mark.parametrize("name", PAGES)
def test_nothing_sticks_out_and_every_picture_is_there(opened, name):
    page = opened(name)
    width = page.viewport_size["width"]
    assert page.evaluate("document.documentElement.scrollWidth") == width
    broken = "[...document.images].filter(i => !(i.complete && i.naturalWidth)).map(i => i.src)"
    page.evaluate("for (const i of document.images) i.loading = 'eager'")
    page.wait_for_function("[...document.images].every(i => i.complete)")
    assert page.evaluate(broken) == []


def test_equations_are_set(opened):
    page = opened("method")
    page.wait_for_selector("mjx-container")
    page.wait_for_function("MathJax.startup.promise.then(() => true)")
    blocks = page.locator("div.math")
    assert blocks.count() > 8
    assert page.locator("div.math mjx-container").count() == blocks.count()
    assert page.locator("mjx-merror").count() == 0


def test_the_cloth_of_the_tour_is_drawn_in_3d(opened):
    page = opened("tour")
    frame = page.frame_locator("iframe.cloth")
    frame.locator("#view").scroll_into_view_if_needed()
    inside = page.frames[1]
    inside.wait_for_function("!waiting && canvas.clientWidth > 0")
    pixels = """() => {
        const image = new Image(), plane = document.createElement("canvas").getContext("2d");
        return new Promise(done => {
            image.onload = () => {
                plane.canvas.width = image.width; plane.canvas.height = image.height;
                plane.drawImage(image, 0, 0);
                const data = plane.getImageData(0, 0, image.width, image.height).data;
                let drawn = 0;
                for (let i = 3; i < data.length; i += 4) drawn += data[i] > 0;
                done(drawn / (data.length / 4));
            };
            image.src = canvas.toDataURL();
        });
    }"""
    assert 0.1 < inside.evaluate(pixels) < 0.9


def test_every_public_name_has_its_place(site):
    from sphinx.util.inventory import InventoryFile

    listed = InventoryFile.loads((site / "objects.inv").read_bytes(), uri="")
    known = {name for kind, names in listed.data.items() if kind[:3] == "py:" for name in names}
    modules = {name for name in ngcloth.__all__ if type(getattr(ngcloth, name)) is type(os)}
    assert {f"ngcloth.{name}" for name in set(ngcloth.__all__) - modules} <= known


def test_every_demo_has_its_page(site):
    numbered = r"^\*\*\d+\. \[(\w+)\.py"
    text = (ROOT / "demos/README.md").read_text(encoding="utf-8")
    names = set(re.findall(numbered, text, re.MULTILINE))
    pages = {path.stem for path in (site / "gallery").glob("*.html")} - {"index"}
    assert len(names) > 7 and names == pages
    for name in ("hemisphere", "own_fabric"):  # which are run
        page = (site / f"gallery/{name}.html").read_text(encoding="utf-8")
        assert "What it prints" in page and "<img" in page.partition("What it draws")[2]


def test_the_tour_ran(site):
    text = (site / "tour.html").read_text(encoding="utf-8")
    assert "hemisphere" in text and ": converged" in text and "Traceback" not in text
