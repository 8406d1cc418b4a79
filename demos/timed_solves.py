"""The scenes of the run-time report, and a process that solves them when told to.

By public names only, so that `against_build.py` can run it on any build of ngcloth: it answers each
line on standard input, a JSON object

    {"scene": of SCENES or MORE, "settings": of ngcloth.solve, "certificate": whether to make it},

with a line on standard output, CPU seconds and outcome of a solve in a process that is warm.
"""

import functools
import json
import os
import sys
import time

import ngsolve as ngs
import numpy as np
import obstacle

import ngcloth
from ngcloth import scenes

SCENES = {"hemisphere, Chebyshev": lambda: scenes.hemisphere()}
SCENES |= {f"hemisphere, ks = {ks}": lambda ks=ks: scenes.hemisphere(ks) for ks in (1, 10, 100)}
SCENES |= {f"hemicatenoid, ks = {ks}": lambda ks=ks: scenes.hemicatenoid(ks) for ks in (1, 100)}
SCENES |= {
    f"sphere, p = {p}": lambda p=p: scenes.sphere(p, shear_limit=np.cos(np.pi / 6))
    for p in (0.7, 0.85)
}
SCENES |= {
    f"obstacle, ks = {ks}": lambda ks=ks: scenes.hemicatenoid(ks, obstacle=True) for ks in (1, 100)
}
# From the paper's start, IPOPT and ngcloth end in different minima; from these in the same.
TURNED = {
    f"obstacle, ks = {ks}, start turned by {angle}°": lambda ks=ks, angle=angle: obstacle.scene(
        ks, angle
    )
    for ks, angle in ((1, 10), (100, -10))
}
SCENES |= TURNED


class Measured:
    """Threads as in a `Net`, and shear that stiffens: a law of powers of γ²."""

    stiffness = 1.0

    def energy(self, I4, I6, I8):
        """W at the invariants."""
        square = I8**2 / (I4 * I6)
        shear = sum(c * square**k for k, c in enumerate((0.3, 0.2, 0.1, 0.05), start=1))
        return (I4 - 1) ** 2 + (I6 - 1) ** 2 + shear


def taut(chart, fabric):
    """A symmetric scene on the unit disk with taut threads."""
    surface = ngcloth.Surface(chart, ngcloth.Disk())
    return ngcloth.Scene(surface, fabric, (ngcloth.Elongation(),), symmetric=True)


# Not of the report: for solves with default settings alone.
MORE = {
    f"sphere, p = {p}": lambda p=p: scenes.sphere(p, shear_limit=np.cos(np.pi / 6))
    for p in (0.5, 0.8)
}
MORE["dome, ks = 10"] = lambda: taut(
    lambda x, y: (x, y, -0.5 * x**2 - 0.8 * y**2), ngcloth.Net(1, 10)
)
MORE["dome, measured law"] = lambda: taut(lambda x, y: (x, y, -0.5 * x**2 - 0.8 * y**2), Measured())


def answer(scene, settings, certificate):
    """Solve, and return what the table needs to know."""
    made = warm_scene(scene, certificate)
    begin = time.process_time()
    result = ngcloth.solve(made, **settings)
    solved = time.process_time()
    if certificate:
        result.certificate()
    return {
        "solve": solved - begin,
        "certificate": time.process_time() - solved,
        "steps": result.newton_iterations,
        "energy": result.normalized_energy,
        "reason": result.reason.name,
    }


@functools.cache
def warm_scene(name, certificate):
    """The scene, after a coarse solve: what only the first one does is then done."""
    scene = (SCENES | MORE)[name]()
    result = ngcloth.solve(scene, maxh=scene.surface.domain.diameter / 4)
    if certificate:
        result.certificate()
    return scene


def main():
    """Say which ngcloth this is, then answer line after line."""
    answers = os.fdopen(os.dup(1), "w")
    os.dup2(2, 1)  # what libraries print is no answer
    ngs.SetNumThreads(1)
    print(json.dumps(ngcloth.__file__), file=answers, flush=True)
    for line in sys.stdin:
        print(json.dumps(answer(**json.loads(line))), file=answers, flush=True)


if __name__ == "__main__":
    main()
