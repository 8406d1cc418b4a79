"""How fast a study is: hemispheres and hemicatenoids of any shear stiffness, solved and certified.

For ks/kc = 10^U(−3, 3), each case is the minimum of E(ψ) with taut threads (λ1, λ2 ≥ 1) and the
patch in equilibrium, on one of the paper's two surfaces. Meshes are refined until the error bar of
the energy is 1 %, or the steps are spent: hemicatenoids with ks/kc < 0.1 have layers along the rim
that want more, and are left with a larger bar or none.

Of orders 3 to 6 and first meshes h = 0.45 to 0.9, order 4 and h = 0.6 take the least time. Coarser
ones are no bargain: on the hemisphere with ks/kc = 0.0018 energies of order 5 at h = 0.9 and 0.45
agree to 0.03 %, and are 3 % off.

The study solves N cases in processes of one thread, certifies and keeps each, and tells how many
bars are that small, and its throughput, the seconds of all cases over the wall clock; and, with
tasks that solve nothing, what the master takes for each case, which is what limits the number of
cores it can feed.

Run ``python demos/study_speed.py 40``; the paper-sized study is N = 2000.
"""

import argparse
import os
import tempfile
from concurrent.futures import Executor, Future
from pathlib import Path
from time import perf_counter, process_time

import numpy as np

import ngcloth

ACCURACY = 0.01  # relative, of the energy
SETTINGS = {"maxh": 0.6, "order": 4, "accuracy": ACCURACY, "max_steps": 60}


def make_scene(surface, ks):
    """One of the two surfaces of the paper."""
    return getattr(ngcloth.scenes, surface)(ks=ks)


def design(n, seed=0):
    """`n` cases, log-uniform in ks/kc."""
    exponents = np.random.default_rng(seed).uniform(-3, 3, n)
    return [
        {"surface": ("hemisphere", "hemicatenoid")[number % 2], "ks": 10.0**exponent}
        for number, exponent in enumerate(exponents)
    ]


def resolved(row):
    """Whether the energy of a case is known to `ACCURACY`, by its bar."""
    bar = row["energy_error"]
    return bar is not None and bar <= ACCURACY * row["energy"]


class Nobody(Executor):
    """Answers at once: what is left is the master's own work."""

    def submit(self, function, *arguments):
        """A future that has its row already."""
        future = Future()
        future.set_result({"converged": True})
        return future


def master_seconds(cases):
    """CPU seconds of the master for each case, to find it open, submit it and take its row."""
    with tempfile.TemporaryDirectory() as folder:
        begun = process_time()
        ngcloth.study(make_scene, cases, folder, Nobody(), **SETTINGS)
        return (process_time() - begun) / len(cases)


def main():
    """Run the study that the command line asks for, and print what it took."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("n", type=int, nargs="?", default=40, help="cases, default %(default)s")
    parser.add_argument("--processes", type=int, default=os.cpu_count())
    parser.add_argument("--out", help="a folder to keep; by default none")
    parser.add_argument("--warm", action="store_true")
    arguments = parser.parse_args()
    with tempfile.TemporaryDirectory() as temporary:
        folder = Path(arguments.out or temporary)
        begun, before = perf_counter(), os.times()
        study = ngcloth.study(
            make_scene,
            design(arguments.n),
            folder,
            arguments.processes,
            warm=arguments.warm,
            **SETTINGS,
        )
        wall, after = perf_counter() - begun, os.times()
        cpu = sum(after[2:4]) - sum(before[2:4])  # of the processes, their start included
        seconds = np.array([row["seconds"] for row in study.table], dtype=float)
        converged = sum(row["converged"] for row in study.table)
        certified = sum(row["certified"] for row in study.table)
        known = sum(map(resolved, study.table))
        steps = sum(row["steps"] or 0 for row in study.table)
        begun = perf_counter()
        rows = len(study.run().table)
        again = perf_counter() - begun
    print(f"{rows} cases, {converged} converged, {certified} certified, {steps} Newton steps")
    print(f"{known} with a bar of {ACCURACY:.0%} or less")
    print(
        f"wall clock {wall:.1f} s on {arguments.processes} processes, {seconds.mean():.3f} s each"
    )
    print(f"CPU {cpu / rows:.3f} s each")
    print(f"throughput {seconds.sum() / wall:.2f} of {arguments.processes}")
    print(f"called again, with nothing to do: {again / rows * 1e3:.2f} ms a case")
    print(f"master {master_seconds(design(500)) * 1e3:.2f} ms a case")


if __name__ == "__main__":
    main()
