"""The command line: what it solves, which files it leaves, how it ends."""

import inspect
import os
import re
import signal
import subprocess
import sys
from pathlib import Path
from xml.etree import ElementTree

import ezdxf
import numpy as np
import pytest
import pyvista as pv

import ngcloth
from ngcloth import __main__ as cli

ROOT = Path(__file__).parents[1]
COARSE = ["--maxh", "0.4", "--quiet"]
# A shell may start background jobs with Ctrl-C ignored; a terminal does not.
AT_A_TERMINAL = """
import signal
signal.signal(signal.SIGINT, signal.default_int_handler)
"""
QUICKLY = """
from ngcloth import __main__ as cli
cli.FILES = {name: cli.FILES[name] for name in ("result", "pattern.svg")}
cli.run()
"""


def start(program, *arguments):
    return subprocess.Popen(
        [sys.executable, *program, *arguments],
        cwd=ROOT,
        env=os.environ | {"PYTHONIOENCODING": "utf-8"},
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        encoding="utf-8",
    )


@pytest.fixture(scope="module")
def stiff(tmp_path_factory):
    """The folder, and what was printed, of the issue's command on a coarse mesh."""
    out = tmp_path_factory.mktemp("cli") / "new" / "out"
    options = ["--ks", "100", "--maxh", "0.3", "--out", str(out)]
    process = start(["-m", "ngcloth"], "hemisphere", *options)
    printed, complaints = process.communicate(timeout=120)
    assert process.returncode == 0, complaints
    return out, printed, complaints


def test_result_is_that_of_the_library(stiff):
    result = ngcloth.load(stiff[0] / "result")
    assert result.converged
    assert result.extrema["stretch1"][1] == pytest.approx(1.8, abs=0.05)
    same = ngcloth.solve(ngcloth.scenes.hemisphere(ks=100), maxh=0.3)
    ends = [each.settings.pop("barrier_end") for each in (result, same)]
    assert ends[0] == pytest.approx(ends[1], rel=1e-9)
    assert result.settings == same.settings
    assert result.normalized_energy == pytest.approx(same.normalized_energy, rel=1e-6)


def test_every_step_and_the_summary_are_printed(stiff):
    out, printed, complaints = stiff
    result = ngcloth.load(out / "result")
    lines = printed.splitlines()
    steps = [line for line in lines if re.match(r" *\d+  (coarse|barrier) ", line)]
    assert len(steps) == len(result.history)
    assert any(line.endswith(": converged") for line in lines)
    assert f"E/(2π kc) = {result.normalized_energy:.6e}" in printed
    assert "Traceback" not in complaints


def test_fields_are_on_the_hemisphere(stiff):
    out, *_ = stiff
    result = ngcloth.load(out / "result")
    grid = pv.read(out / "cloth.vtu")
    radius = np.linalg.norm(grid.points, axis=1)
    assert grid.field_data["converged"] == 1 and np.abs(radius - 1).max() < 1e-6
    threads = pv.read(out / "threads_flat.vtp")
    levels = threads.cell_data["level"]
    assert np.abs(levels / cli.PITCH - np.round(levels / cli.PITCH)).max() < 1e-9
    assert pv.read(out / "surface.obj").n_points == pv.read(out / "surface_flat.obj").n_points
    fibres = np.loadtxt(out / "fibres.csv", delimiter=",", skiprows=1)
    assert len(fibres) == 4 * result.state.space.mesh.ne == grid.n_cells


def test_pattern_has_the_area_of_the_patch_at_100_mm_to_the_unit(stiff):
    out, *_ = stiff
    area = 100**2 * ngcloth.load(out / "result").area
    cut = ezdxf.readfile(out / "pattern.dxf").modelspace().query('LWPOLYLINE[layer=="cut"]')
    assert shoelace(np.array(cut.first.get_points("xy"))) == pytest.approx(area, rel=1e-4)
    svg = ElementTree.parse(out / "pattern.svg").getroot()
    path = svg.find(".//*[@id='cut']/*").get("d").strip("M Z").split(" L ")
    points = np.array([[float(v) for v in point.split(",")] for point in path])
    assert -shoelace(points) == pytest.approx(area, rel=1e-4)  # y points downwards


def shoelace(points):
    (x, y), (u, v) = points.T, np.roll(points, -1, axis=0).T
    return float(np.sum(x * v - y * u) / 2)


def test_report_is_there_unless_it_says_why_not(stiff):
    out, _, complaints = stiff
    assert (out / "report.html").exists() != ("report.html left out" in complaints)


@pytest.mark.parametrize("name", ngcloth.scenes.NAMED)
def test_help_tells_every_parameter(name, capsys):
    with pytest.raises(SystemExit) as end:
        cli.main([name, "--help"])
    assert end.value.code == 0
    told = " ".join(capsys.readouterr().out.split())
    parameters = inspect.signature(ngcloth.scenes.NAMED[name]).parameters
    for parameter in [*parameters, *cli.SETTINGS]:
        assert f" --{parameter.replace('_', '-')}" in told
    assert "Shear stiffness over thread stiffness" in told and "Budget of Newton steps" in told
    assert "2 % of the domain" in told and "exit status: 0 converged" in told


def test_help_names_every_scene(capsys):
    with pytest.raises(SystemExit) as end:
        cli.main(["--help"])
    told = capsys.readouterr().out
    assert end.value.code == 0 and all(f"\n    {name}" in told for name in ngcloth.scenes.NAMED)


def test_options_reach_scene_and_solve(monkeypatch, capsys):
    asked = {}

    def solve(scene, **settings):
        asked.update(settings, **scene.recipe["arguments"])
        raise KeyboardInterrupt

    # The parser reads the signature of solve(), which a stand-in has to keep.
    solve.__signature__, solve.__doc__ = inspect.signature(cli.solve), cli.solve.__doc__
    monkeypatch.setattr(cli, "solve", solve)
    options = "--portion 0.6 --ks 2 --shear-limit 0.8 --no-symmetric --maxh 0.2 --order 3"
    options += " --barrier-end 0.01 --max-steps 7 --quiet"
    assert cli.main(["sphere", *options.split()]) == 130
    scene = {"portion": 0.6, "ks": 2.0, "shear_limit": 0.8, "symmetric": False}
    settings = {"maxh": 0.2, "order": 3, "barrier_end": 0.01, "max_steps": 7}
    settings |= {"log": None, "callback": None}
    assert asked == scene | settings
    assert capsys.readouterr().err == "ngcloth: interrupted\n"


def test_a_solve_that_does_not_converge_ends_with_1_and_says_so(tmp_path, capsys):
    out = tmp_path / "out"
    options = ["--ks", "10", "--max-steps", "2", *COARSE, "--out", str(out)]
    assert cli.main(["hemisphere", *options]) == 1
    printed = capsys.readouterr()
    assert ": converged" not in printed.out
    assert str(ngcloth.Reason.STEP_BUDGET) in printed.out
    assert printed.err.startswith(f"ngcloth: not converged: {ngcloth.Reason.STEP_BUDGET}\n")
    assert not ngcloth.load(out / "result").converged
    assert pv.read(out / "cloth.vtu").field_data["converged"] == 0


@pytest.mark.parametrize(
    ("arguments", "told"),
    [
        ("hemisphere --maxh -1", "maxh = -1.0"),
        ("hemisphere --maxh nan", "maxh = nan"),
        ("hemisphere --maxh wide", "argument --maxh: invalid float value: 'wide'"),
        ("hemisphere --order 0", "order = 0"),
        ("hemisphere --order 2.5", "argument --order: invalid int value: '2.5'"),
        ("hemisphere --ks=-1", "ks = -1.0"),
        ("hemisphere --barrier-end 2", "barrier_end = 2.0"),
        ("hemisphere --max-steps 0", "max_steps = 0"),
        ("hemisphere --portion 0.5", "unrecognized arguments: --portion"),
        ("sphere --portion 1", "portion = 1.0"),
        ("sphere --shear-limit 1.5", "shear_limit = 1.5"),
        ("hemisphere --out=", "out = ''"),
        ("hemicatenoid --obstacle", "obstacle = True"),
        ("klein_bottle", "invalid choice: 'klein_bottle'"),
        ("", "required: scene"),
    ],
)
def test_bad_input_ends_with_2_and_one_line(arguments, told, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    try:
        status = cli.main(arguments.split())
    except SystemExit as end:
        status = end.code
    printed = capsys.readouterr()
    assert status == 2
    assert told in printed.err and printed.err.count("\n") == 1 and printed.err.endswith("\n")
    assert printed.out == "" and not list(tmp_path.iterdir())


def test_bad_input_shows_no_traceback_in_a_shell():
    process = start(["-m", "ngcloth"], "sphere", "--portion", "2")
    printed, complaints = process.communicate(timeout=60)
    assert process.returncode == 2 and printed == ""
    assert complaints == "ngcloth: portion = 2.0: a finite number, 0 < portion < 1\n"


def test_out_below_a_file_is_refused_before_the_solve(tmp_path, capsys):
    (tmp_path / "file").write_text("mine")
    assert cli.main(["hemisphere", *COARSE, "--out", str(tmp_path / "file" / "out")]) == 2
    printed = capsys.readouterr()
    assert printed.out == "" and printed.err.startswith("ngcloth: out = ")
    assert (tmp_path / "file").read_text() == "mine"


def only(monkeypatch, *names):
    """Leave out the other files, to be quick."""
    monkeypatch.setattr(cli, "FILES", {name: cli.FILES[name] for name in names})


def test_foreign_files_stay_and_are_told(tmp_path, monkeypatch, capsys):
    only(monkeypatch, "result", "fibres.csv")
    (tmp_path / "result").mkdir()
    (tmp_path / "result" / "mine").write_text("mine")
    assert cli.main(["hemisphere", *COARSE, "--out", str(tmp_path)]) == 2
    assert "ngcloth: result not written: folder = " in capsys.readouterr().err
    assert [path.name for path in (tmp_path / "result").iterdir()] == ["mine"]
    assert (tmp_path / "fibres.csv").exists()


def test_without_the_extra_dxf_is_left_out_and_no_old_one_stays(tmp_path, monkeypatch, capsys):
    only(monkeypatch, "pattern.dxf", "fibres.csv")
    (tmp_path / "pattern.dxf").write_text("of an earlier result")
    monkeypatch.setitem(sys.modules, "ezdxf", None)
    assert cli.main(["hemisphere", *COARSE, "--out", str(tmp_path)]) == 0
    complaints = capsys.readouterr().err
    assert "pattern.dxf left out" in complaints and "ngcloth[cut]" in complaints
    assert not list(tmp_path.glob("pattern.*")) and (tmp_path / "fibres.csv").exists()


def test_report_is_written_to_a_relative_folder_and_links_to_its_files(
    tmp_path, monkeypatch, capsys
):
    only(monkeypatch, "fibres.csv", "report.html")
    monkeypatch.chdir(tmp_path)
    assert cli.main(["hemisphere", *COARSE, "--out", "out"]) == 0
    assert capsys.readouterr().err == ""
    page = (tmp_path / "out" / "report.html").read_text(encoding="utf-8")
    assert '<a href="fibres.csv">' in page and 'href="report.html"' not in page


def test_ctrl_c_ends_with_130_and_leaves_the_last_good_iterate(tmp_path):
    options = ["--ks", "1", "--maxh", "0.03", "--out", str(tmp_path)]
    process = start(["-c", AT_A_TERMINAL + QUICKLY], "hemisphere", *options)
    for line in process.stdout:
        if " barrier " in line:
            break
    process.send_signal(signal.SIGINT)
    printed, complaints = process.communicate(timeout=60)
    assert process.returncode == 130
    told, *warned = complaints.splitlines()
    assert told == "ngcloth: interrupted" and len(warned) == 1 and "did not converge" in warned[0]
    assert ": converged" not in printed
    result = ngcloth.load(tmp_path / "result")
    assert result.reason is ngcloth.Reason.INTERRUPTED and len(result.history) >= 1
    assert str(result.reason) in (tmp_path / "pattern.svg").read_text(encoding="utf-8")


def test_nobody_who_reads_is_no_reason_to_leave_out_files(tmp_path):
    process = start(["-c", QUICKLY], "hemisphere", "--maxh", "0.4", "--out", str(tmp_path))
    process.stdout.close()  # as after `| head`
    assert process.stderr.read() == "" and process.wait(timeout=60) == 0
    assert ngcloth.load(tmp_path / "result").converged and (tmp_path / "pattern.svg").exists()


@pytest.mark.parametrize("streams", [">&-", "<&- >&- 2>&-", ">/dev/full"])
def test_files_are_written_whatever_becomes_of_standard_output(tmp_path, streams):
    options = ["hemisphere", "--maxh", "0.4", "--out", str(tmp_path)]
    command = ["sh", "-c", f'exec "$@" {streams}', "sh", sys.executable, "-c", QUICKLY, *options]
    run = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, timeout=60)
    assert run.returncode == 0
    told = "ngcloth: standard output: [Errno 28] No space left on device\n"
    assert run.stderr == (told if "full" in streams else "")
    assert ngcloth.load(tmp_path / "result").converged
    ElementTree.parse(tmp_path / "pattern.svg")  # nothing that was printed went into it


def test_version(capsys):
    with pytest.raises(SystemExit) as end:
        cli.main(["--version"])
    assert end.value.code == 0
    assert capsys.readouterr().out == f"ngcloth {ngcloth.__version__}\n"
