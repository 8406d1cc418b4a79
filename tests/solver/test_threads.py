"""Threads and processes: the same with two as with one, and nothing global is changed."""

import subprocess
import sys

import ngsolve as ngs
import numpy as np
import pytest

import ngcloth

SCENES = {
    "Chebyshev": lambda: ngcloth.scenes.hemisphere(),
    "with limits": lambda: ngcloth.scenes.sphere(0.5, ks=1.0, shear_limit=0.8),
}
POINTS = np.array([[0.0, 0.0], [0.3, 0.1], [0.5, 0.5], [0.9, 0.2], [0.0, 1.0]])


def solved(make, threads):
    ngs.SetNumThreads(threads)
    with ngs.TaskManager():
        return ngcloth.solve(make(), maxh=0.5, barrier_end=0.1)


@pytest.mark.parametrize("name", SCENES)
def test_two_threads_agree_with_one(name):
    try:
        one, two = (solved(SCENES[name], threads) for threads in (1, 2))
    finally:
        ngs.SetNumThreads(1)
    assert one.converged and two.converged
    assert two.energy == pytest.approx(one.energy, rel=1e-8)
    assert np.abs(one.psi(*POINTS.T) - two.psi(*POINTS.T)).max() < 1e-8
    assert one.newton_iterations == two.newton_iterations


# In a process of its own: this one has imported ngcloth already.
GLOBAL_STATE = """
import locale, os, random, warnings
import ngsolve as ngs
import numpy as np
import scipy.sparse.linalg  # sets a filter of its own

def state():
    names = [name for name in dir(ngs.ngsglobals) if name[0] != "_"]
    mesh = ngs.Mesh(ngs.unit_square.GenerateMesh(maxh=1))
    matrix = ngs.BilinearForm(ngs.H1(mesh)).Assemble().mat
    return {
        **{name: str(getattr(ngs.ngsglobals, name)) for name in names},
        "threads": ngs.GetNumThreads(),
        "inverse": getattr(matrix, "inversetype", None),
        "errors": np.geterr(),
        "random": (random.getstate(), np.random.get_state()[1].tolist()),
        "filters": [str(entry) for entry in warnings.filters],
        "locale": locale.setlocale(locale.LC_ALL),
        "environment": dict(os.environ),
        "folder": os.getcwd(),
    }

def check(what):
    changed = [name for name, value in state().items() if value != before[name]]
    assert not changed, f"{what} changed {changed}"

ngs.SetNumThreads(2)
ngs.ngsglobals.msg_level = 1
before = state()
import ngcloth
check("import")
ngcloth.solve(ngcloth.scenes.hemisphere(ks=1.0), maxh=0.4).certificate()
check("a scene with limits")
ngcloth.solve(ngcloth.scenes.hemicatenoid(), maxh=0.5, max_steps=3, inverse="umfpack")
check("a solve that does not end")
"""


def test_nothing_global_is_changed():
    done = subprocess.run(
        [sys.executable, "-c", GLOBAL_STATE], capture_output=True, text=True, timeout=120
    )
    assert done.returncode == 0, done.stderr


# Several solves at a time -------------------------------------------------------------------

THREADS_AND_FORK = """
import itertools, multiprocessing
from concurrent.futures import ProcessPoolExecutor, ThreadPoolExecutor
import ngcloth

steps = []

def energy(ks):
    def note(result):
        if not steps or steps[-1] != ks:
            ngcloth.solve(result.scene, maxh=1.0, max_steps=1)  # a callback may solve, too
        steps.append(ks)

    return ngcloth.solve(ngcloth.scenes.hemisphere(ks), maxh=0.5, callback=note).energy

stiffness = [1.0, 3.0, 10.0, 30.0]
with ThreadPoolExecutor(2) as pool:
    found = list(pool.map(energy, stiffness))
assert len(steps) > 12
turns = [ks for ks, _ in itertools.groupby(steps)]
assert sorted(turns) == stiffness, turns
for ks, there in zip(stiffness, found):
    here = energy(ks)
    assert abs(there - here) <= 1e-9 * here, (ks, there, here)
with ProcessPoolExecutor(1, mp_context=multiprocessing.get_context("fork")) as pool:
    error = pool.submit(energy, 1.0).exception()
assert isinstance(error, RuntimeError) and "spawn" in str(error), error
"""


def run(script, *arguments):
    done = subprocess.run(
        [sys.executable, *arguments, script], capture_output=True, text=True, timeout=120
    )
    assert done.returncode == 0, done.stderr


def test_solves_in_threads_take_turns_and_forked_ones_are_refused():
    run(THREADS_AND_FORK, "-c")


SPAWNED = """
import multiprocessing
from concurrent.futures import ProcessPoolExecutor
import ngcloth

def bowl(x, y):
    return x, y, 0.3 * x**2 + 0.2 * y**2

def solved(max_steps):
    scene = ngcloth.Scene(
        ngcloth.Surface(bowl, ngcloth.Disk()), ngcloth.Net(ks=1.0), [ngcloth.Elongation()]
    )
    return ngcloth.solve(scene, maxh=0.5, barrier_end=0.1, max_steps=max_steps, throw=True)

if __name__ == "__main__":
    here = solved(50)
    with ProcessPoolExecutor(1, mp_context=multiprocessing.get_context("spawn")) as pool:
        there = pool.submit(solved, 50).result()
        error = pool.submit(solved, 1).exception()
    assert there.converged and abs(there.energy - here.energy) <= 1e-9 * here.energy
    assert there.certificate().certified == here.certificate().certified
    assert isinstance(error, ngcloth.SolveError), error
    assert error.result.reason is ngcloth.Reason.STEP_BUDGET
    assert len(error.result.history) == 1
"""


def test_results_and_errors_come_back_from_processes(tmp_path):
    (tmp_path / "study.py").write_text(SPAWNED)
    run(tmp_path / "study.py")
