"""Solving alters no global state of NGSolve, and gives the same with two threads as with one."""

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
