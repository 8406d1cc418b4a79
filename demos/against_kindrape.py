"""Shear angles on a hemisphere: the exact net, KinDrape, and a solve, after how many CPU seconds.

KinDrape (Krogh et al., 2021, doi 10.1007/s00158-021-02925-z) lays a pin-jointed net of cells of
one size from the pole outward. Inextensible threads through the pole make a net that
`ngcloth.chebyshev` solves to rounding. The angle of a cell, the mean of its corners, is held
against that of the exact net at its middle, and so is the shear of a solve by ngcloth there.

KinDrape's Python is got from https://github.com/chrkrogh/KinDrape, folder "Python implementation",
and runs by a Python of its own; its plots are left out:

    python -m venv peer && peer/bin/pip install numpy==1.26.4 scipy==1.10.1 matplotlib==3.8.4
    python demos/against_kindrape.py peer/bin/python KinDrape.py KinDrape_eff_NR.py
"""

import json
import os
import subprocess
import sys
import time
from pathlib import Path

import ngsolve as ngs
import numpy as np

from ngcloth import scenes, solve
from ngcloth.chebyshev import ChebyshevNet, sphere_angle

WIDTH, CELLS = 0.075, 24  # of a cell; nodes in a row of the net, as in its authors' call
SOLVES = (2, 0.1), (4, 0.2), (6, 0.2)  # order, maxh
PEER = """
import importlib, json, sys, time
from pathlib import Path
from unittest.mock import MagicMock
path, width, cells = Path(sys.argv[1]), float(sys.argv[2]), int(sys.argv[3])
sys.path.insert(0, str(path.parent))
module = importlib.import_module(path.stem)
module.mpl = module.plt = module.Axes3D = module.art3d = MagicMock()
call = getattr(module, path.stem)
middle = cells // 2 - 1
arguments = [width, [cells, cells], [-width / 2, -width / 2], 0, [middle, middle], 0.0, True]
started = time.process_time()
shear = call(*arguments[: call.__code__.co_argcount])[1]
seconds = time.process_time() - started
angles = shear.reshape((cells - 1) ** 2, -1).mean(axis=1)
print(json.dumps({"angles": angles.tolist(), "seconds": seconds}))
"""


def peer(python, path):
    """Angles of the cells in degrees, and CPU seconds, the least of three runs."""
    one_thread = dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"), "1")
    command = python, "-c", PEER, path, str(WIDTH), str(CELLS)
    runs = []
    for _ in range(3):
        done = subprocess.run(command, capture_output=True, text=True, env=os.environ | one_thread)
        if done.returncode:
            raise RuntimeError(done.stderr)
        runs.append(json.loads(done.stdout.splitlines()[-1]))
    return np.array(runs[0]["angles"]), min(run["seconds"] for run in runs)


def seconds(function):
    """What a function returns, and its CPU seconds, the least of three."""
    best = np.inf
    for _ in range(3):
        started = time.process_time()
        value = function()
        best = min(best, time.process_time() - started)
    return value, best


def row(name, found, exact, spent):
    """A line of the table."""
    error = np.abs(found - exact)
    print(f"| {name} | {error.max():.2g}° | {error.mean():.2g}° | {spent:.2f} |", flush=True)


def main(python, *paths):
    """Print the table."""
    ngs.SetNumThreads(1)
    middles = WIDTH * (np.arange(CELLS - 1) - (CELLS - 2) / 2)
    u, v = np.meshgrid(middles, middles)
    exact = np.degrees(np.pi / 2 - sphere_angle(np.abs(u * v)))
    print(f"largest angle {exact.max():.2f}°")
    print("| program | largest error | mean | CPU s |\n" + 4 * "|---" + "|")
    for path in paths:
        angles, spent = peer(python, path)
        row(Path(path).name, angles, exact.ravel(), spent)
    surface = scenes.hemisphere().surface

    def net_alone():
        net = ChebyshevNet.symmetric(surface)
        return net, np.degrees(np.arcsin(np.abs(net.shear(np.abs(u), np.abs(v)))))

    (net, angles), spent = seconds(net_alone)
    row("ngcloth.chebyshev", angles, exact, spent)
    theta = net.theta(np.abs(u), np.abs(v)).reshape(-1, 2)
    for order, maxh in SOLVES:

        def solved(order=order, maxh=maxh):
            result = solve(scenes.hemisphere(), maxh=maxh, order=order)
            return np.degrees(np.arcsin(np.abs(result.field("shear", *theta.T))))

        angles, spent = seconds(solved)
        row(f"ngcloth, order {order}, maxh {maxh:g}", angles, exact.ravel(), spent)


if __name__ == "__main__":
    if len(sys.argv) < 3:
        sys.exit(__doc__)
    main(*sys.argv[1:])
