"""Does each default answer respect its limits between the points, and know its error?

Solves scenes with limits by default, one thread, and prints beside each energy E/(2π kc) its bar
and a reference of higher order, how far limits are missed on a lattice of 24 to a side of every
triangle (λ − 1, γmax − |γ|, τ over its largest), Newton steps and CPU seconds.
"""

import sys
import time

import ngsolve as ngs
import numpy as np

import ngcloth
from ngcloth import Disk, Elongation, Net, Obstacle, Scene, ShearLimit, Surface
from ngcloth.geometry.sheet import lattice, mesh_points
from ngcloth.scenes import hemicatenoid, hemisphere, sphere

SIDE = 24
GAMMA = float(np.cos(np.pi / 6))


def dome():
    """A cap with two curvatures."""
    surface = Surface(lambda x, y: (x, y, -0.5 * x**2 - 0.8 * y**2), Disk(1.0))
    return Scene(surface, Net(kc=1.0, ks=10.0), [Elongation()], symmetric=True, name="dome")


# With references: order 4, maxh 0.05 and 0.06, barrier_end 1e-6.
SCENES = {
    "hemisphere, ks = 1": (lambda: hemisphere(1.0), 0.184172),
    "hemisphere, ks = 10": (lambda: hemisphere(10.0), 0.898383),
    "hemisphere, ks = 100": (lambda: hemisphere(100.0), 1.40868),
    "hemicatenoid, ks = 1": (lambda: hemicatenoid(1.0), 0.121619),
    "hemicatenoid, ks = 100": (lambda: hemicatenoid(100.0), 0.213612),
    "dome, ks = 10": (dome, 0.110643),
    "sphere, p = 0.5": (lambda: sphere(0.5, shear_limit=GAMMA), 0.0),
    "sphere, p = 0.7": (lambda: sphere(0.7, shear_limit=GAMMA), 0.0188),
    "sphere, p = 0.8": (lambda: sphere(0.8, shear_limit=GAMMA), 0.2801),
    "sphere, p = 0.85": (lambda: sphere(0.85, shear_limit=GAMMA), None),
    "obstacle, ks = 1": (lambda: hemicatenoid(1.0, obstacle=True), None),
    "obstacle, ks = 100": (lambda: hemicatenoid(100.0, obstacle=True), None),
}


def worst_slack(result):
    """The least of λ − 1, γmax − |γ| and τ/max τ on a fine lattice of all triangles."""
    mesh, nodes = result.state.space.mesh, lattice(SIDE)
    triangles = np.repeat(np.arange(mesh.ne), len(nodes))
    points = mesh_points(mesh, triangles, np.tile(nodes, (mesh.ne, 1)))
    fields = {
        name: np.asarray(result._fields[name](points)).ravel()
        for name in ("stretch1", "stretch2", "shear", "reaction")
    }
    slacks = []
    for limit in result.scene.constraints:
        if isinstance(limit, Elongation):
            slacks.append(min(fields["stretch1"].min(), fields["stretch2"].min()) - 1)
        elif isinstance(limit, ShearLimit):
            slacks.append(limit.maximum - np.abs(fields["shear"]).max())
        elif isinstance(limit, Obstacle):
            slacks.append(fields["reaction"].min() / fields["reaction"].max())
    return float(min(slacks))


def measured(name, **settings):
    """A row of the table."""
    make, reference = SCENES[name]
    scene, begin = make(), time.process_time()
    result = ngcloth.solve(scene, **settings)
    seconds, bar = time.process_time() - begin, result.error["energy"]
    return {
        "scene": name,
        "converged": result.converged,
        "E": result.normalized_energy,
        "bar": None if bar is None else bar / scene.normalisation,
        "reference": reference,
        "slack": worst_slack(result),
        "steps": result.newton_iterations,
        "CPU s": seconds,
    }


def line(row):
    """A row as text."""
    cells = (f"{cell:.6g}" if isinstance(cell, float) else str(cell) for cell in row.values())
    return "| " + " | ".join(cells) + " |"


if __name__ == "__main__":
    ngs.SetNumThreads(1)
    for number, name in enumerate(sys.argv[1:] or SCENES):
        row = measured(name)
        if not number:
            print("|", " | ".join(row), "|\n|" + " --- |" * len(row))
        print(line(row), flush=True)
