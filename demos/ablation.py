"""Which constants and branches of the solver does it take? Each switched off, halved and doubled.

One change at a time: of the constants of interior point, start and gradient flow, and of branches
that no constant switches off. Each changed solver solves the paper's scenes on three meshes and
half of the quick rows of the stability table, well posed but for some nets that end in a
singularity, by elements of order 2. Columns:

    steps            Newton steps of all solves; one that fails counts as the whole budget
    more             steps than by the solver as it is
    failures         solves that do not end as they should
    higher energy    solves that converge in a worse minimum than by the solver as it is
    CPU seconds      of all solves, one thread; they depend on what else the machine does

What changes nothing here is there for scenes that these are not: `LASTING_RATE` and `PATIENCE` for
limits that leave hardly any room (85 % of the sphere on fine meshes, shear a million times as stiff
as threads), `GAIN` for saddles, `SETTLED` and `ROUND_OFF` for costs that fall for ever and for what
can be unrolled, `UNRESOLVED` to name singular nets. The filter is what says that a step is no good.

Switching off is a value in the tables below, at which a constant has no effect, or None where it
has one at every value. Run from the repository:

    python demos/ablation.py                # half an hour on two cores; writes docs/ablation.md
    python demos/ablation.py --only DAMPING # prints the lines of one name
"""

import contextlib
import functools
import os
import re
import sys
import time
from collections import namedtuple
from concurrent.futures import ProcessPoolExecutor, as_completed
from multiprocessing import get_context
from pathlib import Path
from unittest import mock

import ngsolve as ngs
import numpy as np
from run_time_tables import markdown
from stability_cases import ENDS, cases
from timed_solves import SCENES, TURNED

import ngcloth
from ngcloth.solver import (
    barrier,
    gradient_flow,
    interior_point,
    iterate,
    line_search,
    saddle_system,
    start,
)

PAGE = Path(__file__).parents[1] / "docs" / "ablation.md"
PROCESSES = 2
BUDGET = 150  # Newton steps
ORDER = 2  # as many steps as by order 3, in half the time
HIGHER, ZERO = 1e-3, 1e-5  # an energy is higher by more than this part of it, and this number
FRACTIONS = 0.4, 0.28, 0.2  # mesh sizes of the paper's scenes, over the diameter
AXES = (
    "ks/kc, hemisphere",
    "ks/kc, hemicatenoid",
    "kc1/kc2, ks = 1",
    "kc1/kc2, Chebyshev",
    "γmax, hemisphere ks = 0",
    "γmax, hemisphere ks = 1",
    "portion of the sphere, γmax = cos π/6",
    "portion of the sphere, Chebyshev",
    "height of the hemicatenoid, ks = 1",
    "bump on a plane, ks = 1",
    "sheared chart, ks = 1",
    "turn of the start, hemisphere",
    "turn of the start, hemicatenoid",
    "noise on the start, ks = 0",
    "noise on the start, ks = 1",
    "odd starts",
)
# Rows of these axes whose end rounding decides, or the mesh, or for which the budget is too small.
LEFT_OUT = {
    "ks/kc, hemicatenoid": ("1e+06",),
    "kc1/kc2, Chebyshev": ("0.0001",),
    "kc1/kc2, ks = 1": ("0.0001",),
    "portion of the sphere, Chebyshev": ("0.842", "0.843", "0.85"),
    "portion of the sphere, γmax = cos π/6": ("0.97",),
    "height of the hemicatenoid, ks = 1": ("3",),
    "turn of the start, hemicatenoid": ("0°", "90°"),
    "odd starts": ("sheared to γ = 0.71, γmax = 0.5",),
}
inf = np.inf
# Names, and the value at which each is switched off.
CONSTANTS = {
    barrier: {
        "FIRST_MU": 1e-3,  # no sequence of barriers but the last one
        "WARM_MU": 1.0,  # each mesh begins as the first does
        "WARMER": inf,
        "STRONG": inf,
        "LOWER_MU": 0.0,
        "UNSEEN": 1e-6,
        "UNSEEN_OF_BAR": inf,
        "LEAST_MU": 1e-3,
    },
    interior_point: {"GAIN": inf},  # no saddle is left
    iterate: {
        "HIGHER": None,
        "LASTING_RATE": inf,
        "NEARLY": 1.0,
        "CORRECTORS": 0,
        "LONGER": 1.0,  # aims for a full step
        "CENTRED": 1.0,  # aims for μ
        "LEAST_SLACK": 1e-8,
        "PATIENCE": 10**9,
        "SETTLED": inf,
        "ROUND_OFF": 0.0,
    },
    line_search: {"TO_BOUNDARY": 1 - 1e-8},
    start: {
        "STRETCHED": inf,
        "RIGID_STEPS": 0,
    },
    gradient_flow: {
        "DAMPING": 1e-9,  # 1/Δt is divided by
        "LEAST_ANGLE_SINE": 0.0,
        "UNRESOLVED": inf,
        "NEAR": 0.0,  # the Hessian never takes over
        "ROUND_OFF_OF_VALUE": 0.0,
        "ROUND_OFF": 0.0,
    },
}


def _always_flat(problem, recorder):
    start.flatten(problem)
    start.feasible_start(problem)


Iterate = iterate.Iterate
# What goes: where it is, and what stands in for it.
BRANCHES = {
    "inertia": (saddle_system.SaddleSystem, "is_minimum", lambda system: True),
    "inertia and curvature": (Iterate, "_tends_to_minimum", lambda self, matrix: True),
    "all correctors": (Iterate, "_corrected", lambda self, solve, ds, dz: (ds, dz)),
    "second-order corrections": (Iterate, "_bends", lambda self, violation: False),
    "filter": (line_search.Filter, "accepts", lambda pairs, length, slope, old, new: new[0] < inf),
    "the given start": (interior_point, "near_start", _always_flat),
}
BASE = "as it is", ""
Solve = namedtuple("Solve", "name make settings expected")
Outcome = namedtuple("Outcome", "reason steps energy seconds")


# Changes ----------------------------------------------------------------------------------------


def changes():
    """All changes, {(name, "off", "halved" or "doubled"): (owner, attribute, value)}."""
    found = {}
    for module, constants in CONSTANTS.items():
        for name, off in constants.items():
            value = getattr(module, name)
            values = {"off": off, "halved": scaled(value, 0.5), "doubled": scaled(value, 2)}
            found |= {(name, how): (module, name, x) for how, x in values.items() if x is not None}
    return found | {(name, "off"): branch for name, branch in BRANCHES.items()}


def scaled(value, factor):
    """A number times a factor; of bounds and fractions near 1, their distance from 1 is scaled."""
    if 0.5 < value < 1:
        return max(1 + factor * (value - 1), 0.0)
    return type(value)(factor * value)


@contextlib.contextmanager
def changed(owner, attribute, value):
    """Set an attribute of a class or module, also in modules that import it from there."""
    old = getattr(owner, attribute)
    modules = [module for name, module in sys.modules.items() if name.startswith("ngcloth.")]
    with contextlib.ExitStack() as stack:
        for holder in {owner, *(m for m in modules if vars(m).get(attribute) is old)}:
            stack.enter_context(mock.patch.object(holder, attribute, value))
        yield


# Solves -----------------------------------------------------------------------------------------


def solves():
    """What each changed solver solves."""
    found = []
    for name, make in SCENES.items():
        for fraction in FRACTIONS if name not in TURNED else ():
            maxh = fraction * make().surface.domain.diameter
            found.append(
                Solve(f"{name}, maxh {maxh:.2g}", make, {"maxh": maxh, "order": ORDER}, "CONVERGED")
            )
    rows = [case for case in cases() if case.axis in AXES]
    for case in rows[::2]:
        if case.value not in LEFT_OUT.get(case.axis, ()):
            expected = "SINGULAR" if case.expected == ENDS else "CONVERGED"
            settings = {"maxh": 0.25, "order": ORDER} | case.settings
            found.append(Solve(f"{case.axis}: {case.value}", case.make, settings, expected))
    return found


def outcomes(key, wanted):
    """The outcome of each solve by the solver with the change of a key."""
    ngs.SetNumThreads(1)
    with contextlib.nullcontext() if key == BASE else changed(*changes()[key]):
        return [_outcome(solve) for solve in wanted]


def all_outcomes(key):
    """`outcomes` of all `solves`, for a process that knows its key alone."""
    return outcomes(key, solves())


@functools.cache
def _made(make, name):
    return make()


def _outcome(solve):
    scene = _made(solve.make, solve.name)
    begin = time.process_time()
    try:
        result = ngcloth.solve(scene, max_steps=BUDGET, **solve.settings)
        outcome = result.reason.name, result.newton_iterations, result.normalized_energy
    except Exception as error:  # of whatever a change leads to
        outcome = type(error).__name__, BUDGET, np.inf
    if outcome[0] != solve.expected:
        outcome = outcome[0], BUDGET, outcome[2]
    return Outcome(*outcome, time.process_time() - begin)


# The table --------------------------------------------------------------------------------------


def line(key, wanted, found, base):
    """A line of the table, from the outcomes of a change, and those of the solver as it is."""
    steps, before = (sum(one.steps for one in outcomes) for outcomes in (found, base))
    return {
        "what": key[0],
        "where": "" if key == BASE else changes()[key][0].__name__.split(".")[-1],
        "change": _change(key),
        "steps": steps,
        "more": f"{100 * (steps / before - 1):+.1f} %",
        "failures": len(failures(wanted, found)),
        "higher energy": len(higher(wanted, found, base)),
        "CPU seconds": f"{sum(one.seconds for one in found):.1f}",
    }


def failures(wanted, found):
    """Name and end of the solves that do not end as they should."""
    pairs = zip(wanted, found, strict=True)
    return [f"{w.name}: {o.reason}" for w, o in pairs if o.reason != w.expected]


def higher(wanted, found, base):
    """Names of the solves that converge in a worse minimum than by the solver as it is."""
    return [
        f"{w.name}: {one.energy:.4g} > {other.energy:.4g}"
        for w, one, other in zip(wanted, found, base, strict=True)
        if one.reason == other.reason == "CONVERGED"
        and one.energy > (1 + HIGHER) * other.energy + ZERO
    ]


def _change(key):
    if key == BASE:
        return ""
    owner, name, value = changes()[key]
    return "off" if callable(value) else f"{key[1]}: {getattr(owner, name)} → {value}"


def page(lines, number):
    """The page, Markdown."""
    columns, reasons = __doc__.split("Columns:\n\n")[1].split("\n\n")[:2]
    return "\n".join(
        [
            "# Constants and branches of the solver, one at a time",
            "",
            f"Written by `python demos/ablation.py`, ngcloth {ngcloth.__version__}, ngsolve "
            f"{ngs.__version__}: {number} solves by each changed solver, with a budget of {BUDGET} "
            "Newton steps each.",
            "",
            *("- " + re.sub(" {2,}", ": ", column.strip()) for column in columns.splitlines()),
            "",
            *reasons.splitlines(),
            "",
            markdown(lines),
            "",
        ]
    )


def main(*arguments):
    """Run all changes, or those of one name; print a line for each, and write the page."""
    keys = list(changes())
    if arguments:
        if arguments[0] != "--only" or len(arguments) != 2:
            sys.exit(__doc__)
        names = list(dict.fromkeys(name for name, _ in keys))
        keys = [key for key in keys if key[0] == arguments[1]]
        if not keys:
            sys.exit(f"{arguments[1]} is none of {', '.join(names)}")
    os.environ |= {"OPENBLAS_NUM_THREADS": "1", "OMP_NUM_THREADS": "1"}
    wanted, lines = solves(), {}
    with ProcessPoolExecutor(PROCESSES, mp_context=get_context("spawn")) as pool:
        tasks = {pool.submit(all_outcomes, key): key for key in (BASE, *keys)}
        base = next(iter(tasks)).result()
        for task in as_completed(tasks):
            key, found = tasks[task], task.result()
            lines[key] = line(key, wanted, found, base)
            print(*lines[key].values(), sep=" | ")
            for text in failures(wanted, found) + higher(wanted, found, base):
                print("   ", text)
            sys.stdout.flush()
    ordered = [lines[key] for key in (BASE, *keys)]
    print("", markdown(ordered), sep="\n")
    if not arguments:
        PAGE.write_text(page(ordered, len(wanted)), encoding="utf-8")


if __name__ == "__main__":
    main(*sys.argv[1:])
