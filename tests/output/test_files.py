"""Every file that an export writes is there as a whole, or as it was, and the fault is told."""

import subprocess
import sys

import pytest

import ngcloth
from ngcloth.output.files import write_file

WRITE = {
    "pattern.svg": lambda result, path: result.export_svg(path),
    "pattern.dxf": lambda result, path: result.export_dxf(path),
    "marks.csv": lambda result, path: result.export_svg(path.with_suffix(".svg"), marks_csv=path),
    "cloth.vtu": lambda result, path: result.export_vtu(path),
    "threads.vtp": lambda result, path: result.export_threads(path),
    "surface.stl": lambda result, path: result.export_surface(path),
    "surface.obj": lambda result, path: result.export_surface(path),
    "fibres.csv": lambda result, path: result.export_fibres(path),
    "report.html": lambda result, path: ngcloth.report(result, path),
    "cloth.png": lambda result, path: result.view(screenshot=path),
}
ON_A_FULL_DISK = """
import resource, sys
from pathlib import Path
sys.path.insert(0, sys.argv[1])
import ngcloth
from test_files import WRITE

folder = Path(sys.argv[2])
result = ngcloth.load(folder / "result")
resource.setrlimit(resource.RLIMIT_FSIZE, (500, 500))
writers = WRITE | {"result": lambda result, path: result.save(path)}
for name, write in writers.items():
    try:
        write(result, folder / name)
    except (OSError, ngcloth.InputError) as error:
        print(f"{name}: {error}", flush=True)
"""


@pytest.fixture(scope="module")
def result():
    return ngcloth.solve(ngcloth.scenes.hemisphere(), maxh=0.5)


def test_a_full_disk_is_told_and_the_former_files_stay(tmp_path, result, request):
    result.save(tmp_path / "result")
    for name in WRITE:
        (tmp_path / name).write_text("former")
    before = {path: path.read_bytes() for path in tmp_path.rglob("*") if path.is_file()}
    arguments = [str(request.path.parent), str(tmp_path)]
    run = subprocess.run(
        [sys.executable, "-c", ON_A_FULL_DISK, *arguments], capture_output=True, text=True
    )
    assert run.returncode == 0, run.stderr
    told = dict(line.split(": ", 1) for line in run.stdout.splitlines())
    assert set(told) == {*WRITE, "result"}
    for name, fault in told.items():
        assert "File too large" in fault and str(tmp_path / name.partition(".")[0]) in fault
    left = {path: path.read_bytes() for path in tmp_path.rglob("*") if path.is_file()}
    left.pop(tmp_path / "marks.svg", None)
    assert left == before


@pytest.mark.parametrize("name", WRITE)
def test_a_folder_in_the_place_of_a_file_is_refused(tmp_path, result, name):
    (tmp_path / name).mkdir()
    with pytest.raises(ngcloth.InputError, match=f"{name}.*this is a folder"):
        WRITE[name](result, tmp_path / name)
    assert [path.name for path in tmp_path.iterdir()] == [name]


@pytest.mark.parametrize("name", WRITE)
def test_a_missing_folder_is_refused(tmp_path, result, name):
    with pytest.raises(ngcloth.InputError, match=f"{name}.*in a folder that exists"):
        WRITE[name](result, tmp_path / "missing" / name)


def test_devices_are_written_to_and_links_followed(tmp_path):
    (tmp_path / "link").symlink_to("file")
    write_file(tmp_path / "link", b"text")
    assert (tmp_path / "link").is_symlink() and (tmp_path / "file").read_bytes() == b"text"
    (tmp_path / "full").symlink_to("/dev/full")
    with pytest.raises(OSError, match=r"No space left on device.*full"):
        write_file(tmp_path / "full", b"text")
    assert (tmp_path / "full").is_char_device()


def test_a_pipe_is_written_to():
    code = "from pathlib import Path; from ngcloth.output.files import write_file; "
    code += "write_file(Path('/dev/stdout'), b'text')"
    run = subprocess.run([sys.executable, "-c", code], capture_output=True, check=True)
    assert run.stdout == b"text"


def test_pictures_of_other_kinds_are_refused(tmp_path, result):
    with pytest.raises(ngcloth.InputError, match="ends in .png"):
        result.view(screenshot=tmp_path / "cloth.doc")
    result.view(screenshot=tmp_path / "cloth")
    assert (tmp_path / "cloth.png").read_bytes().startswith(b"\x89PNG")
