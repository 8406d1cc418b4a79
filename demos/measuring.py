"""For `work_precision.py`: one solve in a process of its own, and its distance from a reference.

A process of its own makes peak memory that of the solve (and of the imports), and keeps one solve's
libraries, caches and fragmentation from the next one's time. Also here: the first solve of a
process, which part of a solve takes how long, and the Newton matrix in two ways.
"""

import cProfile
import multiprocessing
import os
import pstats
import re
import resource
import subprocess
import sys
import time
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path

import ngsolve as ngs
import numpy as np
from timed_solves import SCENES

import ngcloth
from ngcloth.chebyshev import ChebyshevNet
from ngcloth.solver.meshes import make_sheets
from ngcloth.solver.settings import LINEARISATIONS
from ngcloth.solver.start import feasible_start

SHORT = 1  # repeat solves shorter than this many seconds, and take the best
INSIDE = 0.9  # of the way from the centre to the rim: stretches are compared there
PEER = "IPOPT"
COLD = """
import time
times = [time.perf_counter()]
import ngcloth
times.append(time.perf_counter())
for _ in range(2):
    ngcloth.solve(ngcloth.scenes.hemisphere(ks=1), maxh=0.2)
    times.append(time.perf_counter())
print(*times)
"""


def in_its_own_process(function, *arguments, **settings):
    """What a function of this module returns, from a new process with one thread for BLAS."""
    os.environ |= {"OPENBLAS_NUM_THREADS": "1", "OMP_NUM_THREADS": "1"}
    spawn = multiprocessing.get_context("spawn")
    with ProcessPoolExecutor(1, mp_context=spawn) as pool:
        return pool.submit(function, *arguments, **settings).result()


def solve(name, curve, **settings):
    """Solve a scene of `SCENES`, repeatedly if that is quick, by ngcloth or by its peer.

    Returns a row, and the probes {"outline": (n, 2), "stretch": (m, 2)} at fixed points.
    """
    ngs.SetNumThreads(1)
    imports = peak_megabytes()
    scene, run = SCENES[name](), peer if curve == PEER else own
    load_libraries(scene)
    runs = []
    while repeat(runs):
        cpu, wall = time.process_time(), time.perf_counter()
        result, seconds, setup = run(scene, settings)
        cpu = time.process_time() - cpu if seconds is None else seconds
        runs.append((cpu, time.perf_counter() - wall, setup))
    peak, bar = peak_megabytes(), result.error["energy"]
    row = {
        "scene": name,
        "curve": curve,
        "order": result.settings["order"],
        "maxh": result.settings["maxh"],
        "triangles": result.state.space.mesh.ne,
        "dofs": result.state.space.ndof,
        "energy": result.normalized_energy,
        "energy_bar": np.nan if bar is None else bar / scene.normalisation,
        "newton_steps": result.newton_iterations,
        "last_mesh_steps": result.last_mesh_iterations,
        "cpu_seconds": min(runs)[0],
        "wall_seconds": min(runs)[1],
        "setup_seconds": min(runs)[2],
        "peak_megabytes": peak,
        "import_megabytes": imports,
        "reason": result.reason.name,
    }
    return row, probe(result)


def load_libraries(scene):
    """Solve a little, so that what only the first solve of a process does is done."""
    ngcloth.solve(scene, maxh=scene.surface.domain.diameter / 4, max_steps=1)


def repeat(runs):
    """Whether to solve again, after (seconds, …) of earlier runs."""
    return len(runs) < 3 and (not runs or min(runs)[0] < SHORT)


def peak_megabytes():
    """Peak memory of this process so far."""
    status = Path("/proc/self/status")  # `ru_maxrss` of Linux begins with that of the parent
    found = status.exists() and re.search(r"VmHWM:\s*(\d+)", status.read_text())
    if found:
        return int(found[1]) / 2**10
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return peak / (2**20 if sys.platform == "darwin" else 2**10)


def cold_start(times=3):
    """Wall-clock seconds of import, first and second solve of a process; medians of some times."""
    runs = []
    for _ in range(times):
        done = subprocess.run([sys.executable, "-c", COLD], capture_output=True, check=True)
        runs.append(np.diff([float(moment) for moment in done.stdout.split()]))
    return np.median(runs, axis=0)


def profile(name, maxh):
    """CPU seconds of the parts of a solve of a scene with limits, by default settings."""
    ngs.SetNumThreads(1)
    scene, profiler = SCENES[name](), cProfile.Profile(time.process_time)
    load_libraries(scene)
    result = profiler.runcall(ngcloth.solve, scene, maxh=maxh)
    stats = pstats.Stats(profiler)

    def cumulative(file, *functions):
        return sum(
            entry[3]
            for (path, _, function), entry in stats.stats.items()
            if Path(path).name == file and function in functions
        )

    steps = cumulative("interior_point.py", "interior_point")
    parts = {
        "mesh and set-up": cumulative("meshes.py", "make_sheets")
        + cumulative("chain.py", "discretised"),
        "from coarser meshes": cumulative("constrained.py", "take"),
        "start": cumulative("start.py", "near_start"),
        "matrix": cumulative("closed_form.py", "hessian"),
        "factorisation, solution": cumulative("saddle_system.py", "solver", "solve"),
        "line search": cumulative("iterate.py", "_line_search"),
    }
    parts["forces, stopping test"] = steps - sum(list(parts.values())[2:])
    parts["check for folds"] = cumulative("result.py", "unfolded")
    total = cumulative("solve.py", "solve")
    return {**parts, "rest": total - sum(parts.values())}, total, result.newton_iterations


def linearised(name, linearisation, maxh):
    """CPU seconds of a Newton matrix and of a solve by default settings, and its Newton steps."""
    ngs.SetNumThreads(1)
    scene = SCENES[name]()
    *_, sheet = make_sheets(scene, maxh, order=3)
    problem = LINEARISATIONS[linearisation](scene, sheet, 3, 8, "sparsecholesky", 3)
    feasible_start(problem)
    c = problem.slacks()
    matrices, runs = [], []
    for _ in range(3):
        scaled(problem)
        begin = time.process_time()
        problem.hessian(1 / c, 1 / c**2)
        matrices.append(time.process_time() - begin)
    load_libraries(scene)
    while repeat(runs):
        begin = time.process_time()
        result = ngcloth.solve(scene, maxh=maxh, linearisation=linearisation)
        runs.append((time.process_time() - begin, result.newton_iterations))
    seconds, steps = min(runs)
    return min(matrices), seconds, steps


def scaled(problem):
    """Move the state a little, so that nothing of its values is remembered."""
    problem.state.vec.data *= 1 - 1e-9


def own(scene, settings):
    """Result, None for seconds of the whole call, none of set-up apart; `cpu_budget` in seconds."""
    settings = dict(settings)
    end = time.process_time() + settings.pop("cpu_budget", np.inf)
    watch = (lambda _: time.process_time() > end) if end < np.inf else None
    return ngcloth.solve(scene, callback=watch, **settings), None, 0.0


def peer(scene, settings):
    """Result, CPU seconds of IPOPT alone, wall-clock seconds of mesh, set-up and compilation."""
    from ipopt_peer import solve_with_ipopt

    settings = dict(settings)
    seconds = settings.pop("cpu_budget", 1e6)
    added = ngcloth.solve(scene, **settings).limit_points
    settings.pop("barrier_end", None)
    outcome = solve_with_ipopt(scene, added=added, max_cpu_time=seconds, **settings)
    return outcome.result, outcome.result.seconds, outcome.setup


def probe_points(scene):
    """Rim points, and points inside."""
    domain = scene.surface.domain
    inside = domain.sample(15)[: -4 * 15]  # the last ones are on the rim
    return domain.rim(400), domain.centre + INSIDE * (inside - domain.centre)


def probe(result):
    """Outline and stretches at `probe_points`; the outline about its centre."""
    rim, inside = probe_points(result.scene)
    outline = result.psi(*rim.T)
    stretch = [result.field(name, *inside.T) for name in ("stretch1", "stretch2")]
    return {"outline": outline - outline.mean(axis=0), "stretch": np.stack(stretch, axis=-1)}


def exact(name):
    """Reference of a Chebyshev scene: E = 0, λ = 1, the outline from its hyperbolic equation."""
    rim, inside = probe_points(SCENES[name]())
    net = ChebyshevNet.symmetric(SCENES[name]().surface)
    outline = np.copysign(net.material(np.abs(rim)), rim)
    outline -= outline.mean(axis=0)
    return {"energy": 0.0}, {"outline": outline, "stretch": np.ones_like(inside)}


def errors(row, probes, reference):
    """Of energy, outline (largest) and stretch (root mean square), absolute, against another."""
    other, expected = reference
    distance = np.linalg.norm(probes["outline"] - expected["outline"], axis=1)
    return {
        "energy_error": abs(row["energy"] - other["energy"]),
        "outline_error": float(distance.max()),
        "stretch_error": float(np.sqrt(np.mean((probes["stretch"] - expected["stretch"]) ** 2))),
    }
