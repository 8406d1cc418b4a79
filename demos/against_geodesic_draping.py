"""A hemisphere of facets, from file to draped angles, beside geodesic-draping 0.1.2.

Inextensible threads through the pole make a net with θ_uv + Γ(θ_u, θ_v) = 0 that
`ngcloth.chebyshev` solves to rounding: on the rim, half way between warp and weft, a point lies at
X = (0.9805, 0.9805) in the flat patch, and threads meet at 37.57°. How far from that are both
programs, after how many CPU seconds (without imports), reading the same STL file? ngcloth covers
it with a cloth of little shear stiffness, ks/kc = 1e-3, its warp held at the pole.

geodesic-draping (PyPI, GPL) needs an environment of its own, whose Python is the argument:

    python -m venv draping && draping/bin/pip install geodesic-draping==0.1.2
    python demos/against_geodesic_draping.py draping/bin/python
"""

import json
import os
import resource
import subprocess
import sys
import tempfile
from pathlib import Path

import ngsolve as ngs
import numpy as np
import pyvista as pv
from scipy.spatial import Delaunay

import ngcloth
from ngcloth.chebyshev import ChebyshevNet

RINGS = 20, 40, 80, 160  # of vertices: 6 n² facets
TARGET = np.array([0.5**0.5, 0.5**0.5, 0.0])
PEER = """
import json, resource, sys, time
import numpy as np
import geodesic_draping
started = time.process_time()
data = np.fromfile(sys.argv[1], dtype=np.uint8)[84:].reshape(-1, 50)[:, 12:48].copy()
corners = data.view(np.float32).reshape(-1, 3)
points, facets = np.unique(corners, axis=0, return_inverse=True)
points, facets = points.astype(float), facets.reshape(-1, 3).astype(np.int64)
solver = geodesic_draping.GeoDrapeSolver(points, facets)
drape = solver.solve(np.zeros(2), 0.0, mode="hybrid", sample_vertex_shear=True)
there = np.linalg.norm(points - np.array(json.loads(sys.argv[2])), axis=1).argmin()
print(json.dumps({
    "flat": np.abs(drape.distances[:, there]).tolist(),
    "angle": 90 - abs(float(drape.vertex_shear[there])),
    "seconds": time.process_time() - started,
    "megabytes": resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024,
}))
"""


def write_hemisphere(path, rings):
    """Write a unit hemisphere whose vertices lie irregularly, but exactly on it; return facets."""
    random, points = np.random.default_rng(0), [np.zeros((1, 2))]
    for i in range(1, rings + 1):
        off = 0.25 * (random.random((6 * i, 2)) - 0.5)
        polar = np.pi / 2 * (i + off[:, 0] * (i < rings)) / rings
        angle = 2 * np.pi * (np.arange(6 * i) + off[:, 1] * (i < rings)) / (6 * i)
        points.append(polar[:, None] * np.stack([np.cos(angle), np.sin(angle)], axis=-1))
    flat = np.concatenate(points)
    triangles = Delaunay(flat).simplices
    a, b, c = flat[triangles].transpose(1, 2, 0)
    clockwise = (b[0] - a[0]) * (c[1] - a[1]) < (b[1] - a[1]) * (c[0] - a[0])
    triangles[clockwise] = triangles[clockwise][:, ::-1]
    polar = np.linalg.norm(flat, axis=1, keepdims=True)
    sphere = np.hstack([flat * np.sinc(polar / np.pi), np.cos(polar)])
    pv.PolyData.from_regular_faces(sphere, triangles).save(path)
    return len(triangles)


def drape(path):
    """As `PEER`, with ngcloth."""
    ngs.SetNumThreads(1)
    started = sum(os.times()[:4])
    dome = ngcloth.Surface.from_mesh(path)
    scene = ngcloth.Scene(dome, ngcloth.Net(ks=1e-3), warp=(1, 0, 0), at=(0, 0, 1))
    result = ngcloth.solve(scene, maxh=0.25, order=3)
    flat = result.flatten([TARGET, [0.0, 0.0, 1.0]])
    rim = result.domain.rim(2000)
    near = np.linalg.norm(result.evaluate(result.sheet.position, rim) - TARGET, axis=1).argmin()
    shear = float(result.field("shear", *rim[near]))
    return {
        "flat": (flat[0] - flat[1]).tolist(),
        "angle": float(np.degrees(np.arccos(abs(shear)))),
        "seconds": sum(os.times()[:4]) - started,
        "megabytes": resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024,
    }


def outcome(*command):
    """What a process prints last, and its exact error."""
    one_thread = dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"), "1")
    done = subprocess.run(command, capture_output=True, text=True, env=os.environ | one_thread)
    if done.returncode:
        raise RuntimeError(done.stderr)
    return json.loads(done.stdout.splitlines()[-1])


def main(python):
    """Print the table."""
    net = ChebyshevNet.symmetric(ngcloth.scenes.hemisphere().surface)
    exact = net.material(TARGET[:2])  # the chart is stereographic
    angle = np.degrees(np.arccos(net.shear(*exact)))
    print("| facets | program | position off by | angle off by | CPU s | MB |\n" + 6 * "|---" + "|")
    with tempfile.TemporaryDirectory() as folder:
        for rings in RINGS:
            path = str(Path(folder) / "dome.stl")
            facets = write_hemisphere(path, rings)
            peer = outcome(python, "-c", PEER, path, json.dumps(TARGET.tolist()))
            own = outcome(sys.executable, __file__, path)
            for name, found in (("geodesic-draping", peer), ("ngcloth", own)):
                off = np.linalg.norm(np.array(found["flat"]) - exact)
                turn, used = abs(found["angle"] - angle), found["seconds"]
                row = facets, name, f"{off:.1e}", f"{turn:.2f}°", f"{used:.1f}"
                print("|", " | ".join(map(str, row)), f"| {found['megabytes']:.0f} |", flush=True)


if __name__ == "__main__":
    if sys.argv[-1].endswith(".stl"):
        print(json.dumps(drape(sys.argv[-1])))
    elif len(sys.argv) == 2:
        main(sys.argv[1])
    else:
        sys.exit(__doc__)
