"""The pages: their code runs, on coarse meshes, their links lead somewhere, the notebook is clean.

Blocks of `python` on a page run one after another, as a reader would; one that is the file of a
main program runs as such. Blocks of `py` are excerpts and need only be Python. In blocks of `sh`,
commands of ngcloth run, beside the file of a `toml` block that begins with its name. Other files
that pages speak of are made here.
"""

import functools
import json
import os
import re
import shlex
import subprocess
import sys
from pathlib import Path

import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as plt
import pytest
import pyvista as pv
from geometry import shapes
from netgen.occ import Z

import ngcloth
from ngcloth import __main__ as cli

ROOT = Path(__file__).parents[1]
PAGES = {
    path.relative_to(ROOT).as_posix(): path.read_text(encoding="utf-8")
    for folder in (".", "docs", "demos")
    for path in sorted((ROOT / folder).glob("*.md"))
}
BLOCK = re.compile(r"^```(\w+)[^\n]*\n(.*?)^```$", re.DOTALL | re.MULTILINE)
PER_DIAMETER = 4  # triangles
COARSE = {"maxh": 0.8, "order": 2}  # of studies, whose solves are in other processes


def part(path):
    """A dome of 60 mm across in a STEP file, its upper face named."""
    dome = shapes.hemisphere().Scale((0, 0, 0), 30)
    dome.faces.Max(Z).name = "top"
    dome.WriteStep(str(path))


def scan(path):
    points, triangles = shapes.facets(12)
    pv.PolyData.from_regular_faces(30 * points, triangles).save(path)


FILES = {"part.step": part, "scan.stl": scan}


def blocks(page, *languages):
    """The blocks of a page in these languages, each behind as many empty lines as precede it."""
    for found in BLOCK.finditer(PAGES[page]):
        if found[1] in languages:
            yield "\n" * (PAGES[page].count("\n", 0, found.start()) + 1) + found[2]


def with_blocks(*languages):
    return [page for page in PAGES if list(blocks(page, *languages))]


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """A folder with the `FILES`, and solves on coarse meshes."""
    solve = ngcloth.solve

    @functools.wraps(solve)
    def coarse(scene, maxh=None, **settings):
        settings = {"order": 2} | settings | {"accuracy": None}
        return solve(scene, scene.surface.diameter / PER_DIAMETER, **settings)

    for module in (ngcloth, cli):
        monkeypatch.setattr(module, "solve", coarse)
    monkeypatch.setattr(pv.Plotter, "show", lambda plotter: plotter.close())
    monkeypatch.chdir(tmp_path)
    for name, make in FILES.items():
        make(tmp_path / name)
    yield tmp_path
    plt.close("all")


@pytest.mark.parametrize("page", with_blocks("python"))
def test_code_of_pages_runs(page, folder):
    names = {"__name__": "page"}
    for source in blocks(page, "python"):
        if "__main__" in source:
            run_as_a_program(source, folder)
        else:
            exec(compile(source, ROOT / page, "exec"), names)
    results = [value for value in names.values() if isinstance(value, ngcloth.Result)]
    assert all(result.converged for result in results)


def coarsened(text):
    for name, value in COARSE.items():
        text = re.sub(rf"\b{name}( ?= ?)[\d.]+", rf"{name}\g<1>{value}", text)
    return text


def run_as_a_program(source, folder):
    (folder / "program.py").write_text(coarsened(source), encoding="utf-8")
    environment = os.environ | {"PYTHONPATH": str(ROOT), "MPLBACKEND": "Agg"}
    program = [sys.executable, "program.py"]
    done = subprocess.run(program, cwd=folder, env=environment, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr


@pytest.mark.parametrize("page", with_blocks("py"))
def test_excerpts_are_python(page):
    for source in blocks(page, "py"):
        compile(source, ROOT / page, "exec")


def commands():
    for page in with_blocks("sh"):
        for block in blocks(page, "sh"):
            lines = block.replace("\\\n", " ").splitlines()
            yield from ((page, line) for line in lines if line.startswith("ngcloth "))
        yield from ((page, line) for line in re.findall(r"`(ngcloth [^`]*--[^`]*)`", PAGES[page]))


@pytest.mark.parametrize("page, command", sorted(set(commands())))
def test_commands_of_pages_run(page, command, folder, monkeypatch):
    monkeypatch.setattr(cli, "FILES", {"result": cli.FILES["result"]})  # tests/test_cli.py has all
    for text in map(str.strip, blocks(page, "toml")):
        (folder / text.partition("\n")[0].strip("# ")).write_text(coarsened(text), encoding="utf-8")
    arguments = shlex.split(command, comments=True)[1:]
    if "--help" in arguments:
        with pytest.raises(SystemExit) as end:
            cli.main(arguments)
        assert end.value.code == 0
    else:
        assert cli.main(arguments) == cli.CONVERGED


@pytest.mark.parametrize("page", PAGES)
def test_links_lead_somewhere(page):
    targets = re.findall(r"\]\(([^)#]+)\)", BLOCK.sub("", PAGES[page]))
    made = ("gallery/", "reference/")  # with the site, and checked there
    inside = [target for target in targets if "://" not in target and not target.startswith(made)]
    missing = [target for target in inside if not (ROOT / page).parent.joinpath(target).exists()]
    assert not missing


def test_the_notebook_is_stripped():
    cells = json.loads((ROOT / "docs/tour.ipynb").read_text(encoding="utf-8"))["cells"]
    code = [cell for cell in cells if cell["cell_type"] == "code"]
    assert len(code) > 5
    assert not any(cell["outputs"] or cell["execution_count"] for cell in code)
