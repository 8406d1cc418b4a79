"""Studies: what is solved, what is not solved again, what becomes of cases that fail."""

import csv
import math
import os
import pickle
import random
import shutil
import signal
import subprocess
import sys
import time
from collections import namedtuple
from concurrent.futures import Executor, Future, ProcessPoolExecutor
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest
from matplotlib.figure import Figure
from studies.scenes_of_studies import SETTINGS, dome, other_cloth

import ngcloth
from ngcloth.studies.source import source

TESTS = Path(__file__).parents[1]
GUARD = 'if __name__ == "__main__":'
STIFF = [{"ks": ks} for ks in (1.0, 3.0, 10.0)]


class Here(Executor):
    """The least that an executor can be: it runs what is submitted at once, in this process."""

    def submit(self, function, *args):
        future = Future()
        try:
            future.set_result(function(*args))
        except Exception as error:
            future.set_exception(error)
        return future


def begun(notes):
    """The stiffnesses of the scenes that were made, in order; and by which processes."""
    file = Path(notes) / "begun"
    lines = file.read_text().splitlines() if file.exists() else []
    return [float(line.split()[1]) for line in lines], [int(line.split()[0]) for line in lines]


def physics(table):
    """A table without what differs from run to run."""
    return [{n: v for n, v in row.items() if n not in ("seconds", "notes", "key")} for row in table]


def assert_same(table, other):
    for one, two in zip(physics(table), physics(other), strict=True):
        assert one.keys() == two.keys()
        for name in one:
            same = pytest.approx(two[name], rel=1e-9) if name == "energy" else two[name]
            if isinstance(one[name], float) and name != "energy":
                same = pytest.approx(two[name], rel=1e-6, abs=1e-9)
            assert one[name] == same, name


@pytest.fixture(scope="module")
def solved(tmp_path_factory):
    """A study of three stiffnesses, and its folder."""
    folder = tmp_path_factory.mktemp("study") / "new" / "study"
    return ngcloth.study(dome, STIFF, folder, Here(), **SETTINGS), folder


# What comes out ----------------------------------------------------------------------------


def test_a_row_is_what_a_solve_of_the_case_gives(solved):
    study, _ = solved
    result = ngcloth.solve(dome(**STIFF[1]), **SETTINGS)
    row, certificate = study.table[1], result.certificate()
    assert row["ks"] == 3.0 and row["converged"] and row["reason"] == "converged"
    assert row["energy"] == pytest.approx(result.energy, rel=1e-9)
    assert row["area"] == pytest.approx(result.area, rel=1e-9)
    assert row["steps"] == result.newton_iterations
    for name, (low, high) in result.extrema.items():
        assert (row[f"{name}_min"], row[f"{name}_max"]) == pytest.approx((low, high), rel=1e-6)
    assert row["certified"] == certificate.certified and row["faults"]
    assert 0 < result.seconds and 0 < row["seconds"] < 60
    again = study.load(1)
    assert again.energy == pytest.approx(result.energy, rel=1e-9)
    assert np.abs(again.outline(50) - result.outline(50)).max() < 1e-9


def test_the_table_is_a_csv_file_a_frame_and_a_dataset(solved):
    study, folder = solved
    with open(folder / "study.csv", newline="") as file:
        rows = list(csv.DictReader(file))
    assert [float(row["ks"]) for row in rows] == [1, 3, 10]
    assert [float(row["energy"]) for row in rows] == [row["energy"] for row in study.table]
    frame, dataset = study.to_pandas(), study.to_xarray()
    assert frame["energy"].is_monotonic_increasing and len(frame) == 3
    assert dataset.sizes == {"case": 3}
    assert float(dataset["area"][2]) == study.table[2]["area"]


def test_nothing_in_the_folder_is_a_pickle(solved, tmp_path, monkeypatch):
    _, folder = solved
    files = [path for path in folder.rglob("*") if path.is_file()]
    assert {path.suffix for path in files} == {".csv", ".json", ".npz", ""}
    study = ngcloth.Study(dome, STIFF, folder, Here(), **SETTINGS)

    def refuse(*args, **kwargs):
        raise AssertionError("a pickle was read")

    for name in ("load", "loads", "Unpickler"):
        monkeypatch.setattr(pickle, name, refuse)
    assert all(row["converged"] for row in study.run().table)
    assert study.load(0).converged


def test_pictures_show_the_cases(solved):
    study, _ = solved
    ax = study.scatter("ks", "energy", "area", ax=Figure().add_subplot())
    drawn = np.concatenate([each.get_offsets() for each in ax.collections])
    expected = [(row["ks"], row["energy"]) for row in study.table]
    assert np.allclose(sorted(map(tuple, drawn)), expected)
    ax = study.parallel_coordinates(["ks", "area", "energy"], ax=Figure().add_subplot())
    lines = [line.get_ydata() for line in ax.lines if len(line.get_xdata()) == 3]
    assert len(lines) == 3
    assert np.allclose([line[[0, 2]] for line in (lines[0], lines[2])], [[0, 0], [1, 1]])
    with pytest.raises(ngcloth.InputError, match="column"):
        study.scatter("ks", "reason")
    with pytest.raises(ngcloth.InputError, match="column"):
        study.scatter("ks", "kd")
    with pytest.raises(ngcloth.InputError, match=r"none has \['energy_error'\]"):
        study.parallel_coordinates(["ks", "energy_error"])


# What is solved, and what is not solved again ---------------------------------------------------


def test_only_new_and_changed_cases_are_solved(tmp_path):
    def run(cases, **settings):
        noted = [case | {"notes": str(tmp_path)} for case in cases]
        before = len(begun(tmp_path)[0])
        study = ngcloth.study(dome, noted, tmp_path / "s", Here(), **(SETTINGS | settings))
        assert all(row["converged"] for row in study.table)
        return begun(tmp_path)[0][before:]

    assert run(STIFF[:2]) == [1.0, 3.0]
    assert run(STIFF[1::-1]) == []
    assert run(STIFF) == [10.0]
    assert run([{"ks": 1.0}, {"ks": 1.0}, {"ks": 1.0, "height": 0.3}]) == [1.0]
    assert run(STIFF[:1], barrier_end=1e-2) == [1.0]


OWN = """
import ngcloth
{constant}
def height(x, y):
    return SLOPE * (x**2 + y**2){more}
def make(ks):
    surface = ngcloth.Surface(lambda x, y: (x, y, height(x, y)), ngcloth.Disk())
    return ngcloth.Scene(surface, ngcloth.Net(ks=ks), [ngcloth.Elongation()], symmetric=True)
{after}
"""


def test_cases_of_another_source_are_others(tmp_path, monkeypatch):
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.setattr(sys, "dont_write_bytecode", True)

    def key(**parts):
        text = OWN.format(**({"constant": "SLOPE = 0.4", "more": "", "after": ""} | parts))
        name = f"own_{abs(hash(text))}"
        (tmp_path / f"{name}.py").write_text(text)
        make = __import__(name).make
        return ngcloth.Study(make, STIFF[:1], tmp_path / "s", Here()).keys[0]

    first = key()
    assert key(after="# a remark\ndef other():\n    return 1") == first
    assert key(constant="SLOPE = 0.5") != first
    assert key(more=" + x") != first


VALUES = """
import enum
from collections import deque, namedtuple
from dataclasses import dataclass
from fractions import Fraction
from pathlib import Path
import numpy as np
from scipy.interpolate import CubicSpline
@dataclass(frozen=True)
class Cloth:
    ks: float
    @staticmethod
    def name():
        return "tulle"
class Slim:
    __slots__ = ("ks",)
    def __init__(self, ks):
        self.ks = ks
Pair = namedtuple("Pair", "ks")
VALUE = {value}
class Told:
    value = VALUE
    @property
    def twice(self):
        return 2 * VALUE
def make(ks):
    return {named}, Pair(ks)
"""


@pytest.mark.parametrize(
    ("one", "other"),
    [
        ("np.float32(1)", "np.float32(2)"),
        ("np.arange(3)[1]", "np.arange(3)[2]"),
        ("np.array([{1: 2}])", "np.array([{1: 3}])"),
        ("Path('a.step')", "Path('b.step')"),
        ("Fraction(1, 2)", "Fraction(1, 3)"),
        ("range(2)", "range(3)"),
        ("deque([1])", "deque([2])"),
        ("CubicSpline([0, 1, 2], [0, 1, 2])", "CubicSpline([0, 1, 2], [0, 1, 3])"),
        ("Cloth(1.0)", "Cloth(2.0)"),
        ("Slim(1.0)", "Slim(2.0)"),
    ],
)
@pytest.mark.parametrize("named", ["VALUE", "Told.value", "Told().twice"])
def test_cases_of_other_values_are_others(one, other, named, tmp_path, monkeypatch):
    """Of values that are named, in a module of the user's, whatever they are kept in."""
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.setattr(sys, "dont_write_bytecode", True)

    def key(number, value):
        name = f"values_{number}_{abs(hash(tmp_path))}"
        (tmp_path / f"{name}.py").write_text(VALUES.format(value=value, named=named))
        return source(__import__(name).make).replace(name, "").replace(one, "").replace(other, "")

    assert key(1, one) == key(2, one) != key(3, other)


def test_cases_of_another_module_of_a_module_are_others(tmp_path, monkeypatch):
    monkeypatch.syspath_prepend(tmp_path)
    (tmp_path / "makes_it.py").write_text(
        "import told_by\ndef make(ks):\n    return told_by.slope(ks)"
    )
    told = "from constant_of import SLOPE\ndef slope(ks):\n    return SLOPE"
    (tmp_path / "told_by.py").write_text(told)
    (tmp_path / "constant_of.py").write_text("SLOPE = 1.0")
    make = __import__("makes_it").make
    before = source(make)
    assert source(make) == before
    monkeypatch.setattr(sys.modules["told_by"], "SLOPE", 2.0)
    assert source(make) != before


def test_packages_in_the_folder_of_a_user_are_installed(tmp_path, monkeypatch):
    """As `pip install --user` puts them; a module without source, too, is told by its name."""
    packages = tmp_path / "lib" / "site-packages"
    packages.mkdir(parents=True)
    (packages / "of_others.py").write_text("def ks():\n    return 1.0")
    (tmp_path / "uses_others.py").write_text(
        "import of_others, without_source\ndef make(ks):\n    return of_others, without_source.ks"
    )
    without = ModuleType("without_source")
    without.__file__ = str(tmp_path / "without_source.so")
    monkeypatch.setitem(sys.modules, "without_source", without)
    for folder in (packages, tmp_path):
        monkeypatch.syspath_prepend(folder)
    text = source(__import__("uses_others").make)
    assert "def make" in text and "of_others" in text and "def ks" not in text


def test_failures_are_rows_and_tried_again(tmp_path):
    bad = [{"ks": 1.0, "then": "raise"}, {"ks": -1.0}, {"ks": 1.0, "height": 0.2}]
    bad = [case | {"notes": str(tmp_path)} for case in bad]
    study = ngcloth.study(dome, bad, tmp_path / "s", Here(), **SETTINGS)
    reasons = [row["reason"] for row in study.table]
    assert reasons[0] == "RuntimeError: no such cloth"
    assert reasons[1].startswith("InputError: ks = -1.0")
    assert [row["converged"] for row in study.table] == [False, False, True]
    assert "3 cases" in study.explain() and "to do   2, of which 2 failed" in study.explain()
    assert "done    1, of which 0 did not converge" in study.explain()
    with pytest.raises(ngcloth.InputError, match="no such cloth"):
        study.load(0)
    study.run()
    assert begun(tmp_path)[0] == [1.0, -1.0, 1.0, 1.0, -1.0]


def test_cases_of_any_fabric_are_kept(tmp_path):
    """Of three families, and of threads that bend."""
    cases = [{"fabric": "triaxial"}, {"fabric": "bending"}]
    study = ngcloth.study(other_cloth, cases, tmp_path, Here(), **SETTINGS)
    assert [row["converged"] for row in study.table] == [True, True]
    assert [row["certified"] for row in study.table] == [True, True]
    assert "to do   0" in study.explain()
    for number in (0, 1):
        scene = other_cloth(**cases[number])
        assert ngcloth.load(tmp_path / "cases" / study.keys[number] / "result", scene).converged


def test_a_case_that_does_not_converge_is_kept_with_its_reason(tmp_path):
    case = [{"ks": 1.0, "notes": str(tmp_path)}]
    for _ in range(2):
        study = ngcloth.study(dome, case, tmp_path / "s", Here(), max_steps=2, **SETTINGS)
        (row,) = study.table
        assert not row["converged"] and "budget of Newton steps" in row["reason"]
    assert begun(tmp_path)[0] == [1.0]
    assert not study.load(0).converged


def test_damaged_records_are_solved_again(tmp_path):
    study = ngcloth.study(dome, STIFF[:1], tmp_path, Here(), **SETTINGS)
    before = study.table
    record = tmp_path / "cases" / study.keys[0] / "case.json"
    whole = record.read_bytes()
    wrong = [b"", b"{}", b"[" * 10**5, b"\x80\x04.", whole[:-100], whole.replace(b'"area"', b'"a"')]
    for data in wrong[:-1]:
        record.write_bytes(data)
        assert study.table[0]["reason"] == "not solved yet"
    for data in wrong[-1:]:
        record.write_bytes(data)
        assert study.table[0]["reason"] == "not solved yet"
        assert_same(study.run().table, before)


def test_cases_whose_result_is_gone_are_solved_again(tmp_path):
    study = ngcloth.study(dome, STIFF[:1], tmp_path, Here(), **SETTINGS)
    before, place = study.table, tmp_path / "cases" / study.keys[0]
    for damage in (lambda: shutil.rmtree(place / "result"), lambda: _replaced_by_file(place)):
        damage()
        assert study.table[0]["reason"] == "not solved yet"
        assert_same(study.run().table, before)
        assert study.load(0).converged


def _replaced_by_file(place):
    shutil.rmtree(place)
    place.write_text("no folder")


def test_explain_tells_cost_and_what_is_done(tmp_path):
    study = ngcloth.Study(dome, STIFF, tmp_path / "s", Here(), **SETTINGS)
    assert not (tmp_path / "s").exists()
    text = study.explain()  # solves one to tell
    assert "done    1" in text and "to do   2" in text and "MB" in text and " s " in text
    assert sum(row["converged"] for row in study.table) == 1
    assert "to do   0" in study.run().explain()


def test_parts_share_the_cases(tmp_path):
    cases = [{"ks": ks, "notes": str(tmp_path)} for ks in (1.0, 2.0, 3.0)]
    for k, mine in ((2, [2.0]), (1, [1.0, 3.0])):
        before = len(begun(tmp_path)[0])
        study = ngcloth.study(dome, cases, tmp_path / "s", Here(), part=(k, 2), **SETTINGS)
        assert begun(tmp_path)[0][before:] == mine
    assert all(row["converged"] for row in study.table)


def test_a_warm_start_gives_the_same_answer(solved, tmp_path):
    study, _ = solved
    warm = ngcloth.study(dome, STIFF, tmp_path, Here(), warm=True, **SETTINGS)
    for one, other in zip(warm.table, study.table, strict=True):
        assert one["energy"] == pytest.approx(other["energy"], rel=2e-3)  # its barrier's error
    assert warm.load(2).converged


def test_a_damaged_neighbour_is_no_start(tmp_path):
    for number, damage in enumerate((lambda file: file.write_bytes(b"no zip"), Path.unlink)):
        arguments = {"folder": tmp_path / str(number), "executor": Here(), "warm": True}
        one = ngcloth.study(dome, STIFF[:1], **arguments, **SETTINGS)
        damage(arguments["folder"] / "cases" / one.keys[0] / "result" / "fields.npz")
        both = ngcloth.study(dome, STIFF[:2], **arguments, **SETTINGS)
        assert [row["reason"] for row in both.table] == ["converged", "converged"]


def test_a_neighbour_that_is_no_start_is_left_alone(tmp_path):
    """A polynomial of degree seven near the portion where nets collapse folds the cloth."""
    portions = [{"portion": portion} for portion in (0.8, 0.3)]
    make = ngcloth.scenes.sphere
    warm = ngcloth.study(make, portions, tmp_path, Here(), warm=True, maxh=0.4, order=5)
    alone = ngcloth.solve(make(0.3), maxh=0.4, order=5)
    assert warm.table[1]["converged"]
    assert warm.table[1]["area"] == pytest.approx(alone.area, rel=1e-3)


# Executors --------------------------------------------------------------------------------------


def script(folder, executor, tail=""):
    """A program that runs a study of eight cases, each noted in the folder."""
    return f"""
import ngcloth
from studies.scenes_of_studies import SETTINGS, dome
if __name__ == "__main__":
    cases = [dict(ks=float(k), notes={str(folder)!r}) for k in range(1, 9)]
    ngcloth.study(dome, cases, {str(folder / "study")!r}, {executor}, **SETTINGS)
    {tail}
"""


def start(tmp_path, executor):
    file = tmp_path / "run.py"
    file.write_text(script(tmp_path, executor))
    path = os.pathsep.join([str(TESTS), str(TESTS.parent), os.environ.get("PYTHONPATH", "")])
    environment = os.environ | {"PYTHONPATH": path}
    return subprocess.Popen([sys.executable, str(file)], env=environment)


def wait_for(condition, process, seconds=100):
    end = time.monotonic() + seconds
    while not condition() and process.poll() is None and time.monotonic() < end:
        time.sleep(0.02)
    assert condition() or process.poll() == 0


def is_running(pid):
    try:
        os.kill(pid, 0)
    except ProcessLookupError:
        return False
    return "\nState:\tZ" not in Path(f"/proc/{pid}/status").read_text()


def finished(tmp_path):
    """Cases that are there, and when they were written."""
    return {path: path.stat().st_mtime_ns for path in tmp_path.glob("study/cases/*/case.json")}


def eight(tmp_path):
    return [{"ks": float(k), "notes": str(tmp_path)} for k in range(1, 9)]


def test_killed_worker_and_master_do_not_matter(tmp_path):
    master = start(tmp_path, 1)
    wait_for(lambda: len(finished(tmp_path)) >= 1, master)
    os.kill(begun(tmp_path)[1][-1], signal.SIGKILL)  # a worker: it is made anew
    wait_for(lambda: len(finished(tmp_path)) >= 3, master)
    master.send_signal(signal.SIGKILL)
    master.wait()
    worker, end = begun(tmp_path)[1][-1], time.monotonic() + 60
    while is_running(worker) and time.monotonic() < end:
        time.sleep(0.02)
    assert not is_running(worker)  # none outlives its master
    kept = finished(tmp_path)
    study = ngcloth.study(dome, eight(tmp_path), tmp_path / "study", Here(), **SETTINGS)
    assert kept.items() <= finished(tmp_path).items()
    assert all(row["converged"] for row in study.table)
    again = ngcloth.study(dome, eight(tmp_path)[3:6], tmp_path / "other", Here(), **SETTINGS)
    assert_same(study.table[3:6], again.table)
    assert {path.name for path in (tmp_path / "study/cases").iterdir()} == set(study.keys)


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(3))
def test_killed_at_random_moments(tmp_path, seed):
    draw, kills = random.Random(seed), 0
    while kills < 5:
        master = start(tmp_path, 2)
        while kills < 5 and master.poll() is None:
            time.sleep(draw.uniform(0.0, 8.0))
            worker = draw.random() < 0.6
            victims = [pid for pid in begun(tmp_path)[1][-2:] if is_running(pid)] * worker
            os.kill(draw.choice(victims) if victims else master.pid, signal.SIGKILL)
            kills += 1
        if kills < 5:
            assert master.wait() in (0, -signal.SIGKILL)
    master.wait()
    last = start(tmp_path, 2)
    assert last.wait() == 0
    study = ngcloth.Study(dome, eight(tmp_path), tmp_path / "study", Here(), **SETTINGS)
    whole = ngcloth.study(dome, eight(tmp_path), tmp_path / "other", Here(), **SETTINGS)
    assert_same(study.table, whole.table)
    assert all(row["converged"] for row in study.table)


def test_a_case_that_takes_its_process_down_is_found(tmp_path):
    cases = [{"ks": 1.0}, {"ks": 2.0, "then": "die"}, {"ks": 3.0}]
    study = ngcloth.study(dome, cases, tmp_path, 2, **SETTINGS)
    assert [row["converged"] for row in study.table] == [True, False, True]
    assert "takes down the process" in study.table[1]["reason"]


def test_a_case_that_exits_or_gives_no_scene_is_a_row(tmp_path):
    cases = [{"ks": 1.0, "then": "exit"}, {"ks": 2.0, "then": "nothing"}, {"ks": 3.0}]
    study = ngcloth.study(dome, cases, tmp_path, 1, **SETTINGS)
    reasons = [row["reason"] for row in study.table]
    nothing = "InputError: what make_scene returns = <class 'NoneType'>: an ngcloth.Scene"
    assert reasons == ["SystemExit: no more cloth", nothing, "converged"]


@pytest.mark.parametrize(
    ("part", "wrong"),
    [
        ("if __name__", "if True or __name__"),
        (f", dome\n{GUARD}", f"\n{GUARD}\n    def dome(ks, notes): return None"),
    ],
)
def test_processes_that_cannot_begin_end_the_study(part, wrong, tmp_path):
    """The study is not guarded, or make_scene is, so that other processes do not have it."""
    file = tmp_path / "run.py"
    file.write_text(script(tmp_path, 1).replace(part, wrong))
    environment = os.environ | {"PYTHONPATH": os.pathsep.join([str(TESTS), str(TESTS.parent)])}
    done = subprocess.run(
        [sys.executable, str(file)], env=environment, capture_output=True, text=True, timeout=120
    )
    complaint = done.stderr.splitlines()[-1]
    assert done.returncode == 1 and "if __name__ == '__main__'" in complaint
    assert "make_scene above that" in complaint


def test_a_broken_executor_of_the_users_is_told(tmp_path):
    cases = [{"ks": 2.0, "then": "die"}]
    with ProcessPoolExecutor(1, multiprocessing_context()) as pool:
        with pytest.raises(RuntimeError, match="executor=None, which finds the case"):
            ngcloth.study(dome, cases, tmp_path, pool, **SETTINGS)


def multiprocessing_context():
    import multiprocessing

    return multiprocessing.get_context("spawn")


def test_a_dask_cluster_is_an_executor(solved, tmp_path):
    from dask.distributed import Client, LocalCluster

    with (
        LocalCluster(
            n_workers=1, threads_per_worker=1, protocol="tcp://", dashboard_address=None
        ) as cluster,
        Client(cluster) as client,
    ):
        assert client.scheduler.address.startswith("tcp://")
        cases = [*STIFF[:2], {"ks": 1.0, "then": "raise"}]
        study = ngcloth.study(dome, cases, tmp_path, client.get_executor(), **SETTINGS)
    assert_same(study.table[:2], solved[0].table[:2])
    assert study.table[2]["reason"] == "RuntimeError: no such cloth"


# Bad input --------------------------------------------------------------------------------------


def no_source():
    scope = {}
    exec("def make(ks):\n    return None", scope)
    return scope["make"]


@pytest.mark.parametrize(
    ("argument", "given"),
    [
        ("cases", {"cases": {"ks": 1.0}}),
        ("cases", {"cases": 3}),
        ("cases", {"cases": []}),
        (r"cases\[1\]", {"cases": [{"ks": 1.0}, [1.0]]}),
        (r"cases\[0\]", {"cases": [{"kd": 1.0}]}),
        (r"cases\[0\]", {"cases": [{}]}),
        (r"cases\[0\]\['ks'\]", {"cases": [{"ks": math.nan}]}),
        (r"cases\[0\]\['ks'\]", {"cases": [{"ks": np.array([1.0, np.inf])}]}),
        (r"cases\[0\]\['ks'\]", {"cases": [{"ks": object()}]}),
        (r"cases\[0\]\['ks'\]", {"cases": [{"ks": namedtuple("Pair", "one other")(1, 2)}]}),
        (r"cases\[0\]", {"cases": [{"energy": 1.0}], "make_scene": lambda energy: None}),
        ("make_scene", {"make_scene": 3}),
        ("make_scene", {"make_scene": ngcloth.Scene}),
        ("make_scene", {"make_scene": no_source()}),
        ("make_scene", {"make_scene": lambda ks: dome(ks), "executor": None}),
        ("executor", {"executor": "dask"}),
        ("executor", {"executor": 0}),
        ("executor", {"executor": Here}),
        ("executor", {"executor": True}),
        ("warm", {"warm": 1}),
        ("log", {"log": "print"}),
        ("part", {"part": (3, 2)}),
        ("part", {"part": 3}),
        ("callback", {"callback": print}),
        ("checkpoint", {"checkpoint": "run.npz"}),
        ("max_h", {"max_h": 0.1}),
        ("maxh", {"maxh": -0.1}),
        ("order", {"order": 99}),
        ("tolerance", {"tolerance": math.nan}),
        ("folder", {"folder": __file__}),
        ("folder", {"folder": Path(__file__) / "below"}),
        ("folder", {"folder": None}),
        ("folder", {"folder": "long" * 100}),
    ],
)
def test_bad_input_is_refused_before_anything_is_solved(argument, given, tmp_path):
    arguments = {"make_scene": dome, "cases": STIFF, "folder": tmp_path / "s", "executor": Here()}
    with pytest.raises(ngcloth.InputError, match=f"^{argument} = "):
        ngcloth.study(**(arguments | given))
    assert not (tmp_path / "s").exists()
