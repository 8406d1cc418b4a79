"""Error against run time: ngcloth by default, at other orders and barriers, and its alternatives.

How many seconds does a patch ψ of a given error take? The errors are

    |E(ψ) − E(ψ*)|/(2π kc),   max |ψ − ψ*| on the rim,   (mean (λ − λ*)²)^½ over the cloth,

where ψ* is the exact Chebyshev net (E = 0) where there is one, and else that of a far finer solve
at order 4 with a weak barrier, whose own error bar is its distance from the next coarser one; rows
below the bar tell no more. Alternatives are the paper's own schedule of barrier and pseudo-time
steps, and IPOPT on the same discrete problem (the extra `bench`), which goes to the optimum and so
compares with a weak barrier.

    python demos/work_precision.py               # under half an hour; writes docs/ and out/
    python demos/work_precision.py --quick out   # one scene, coarse; all of it to another folder
"""

import csv
import datetime
import importlib.metadata
import importlib.util
import platform
import sys
from pathlib import Path

import measuring
import ngsolve as ngs
import numpy as np
from run_time_tables import (
    CHEBYSHEV,
    DEFAULT,
    FULL,
    MEASURES,
    PAPER,
    PEER,
    WEAK,
    against_paper,
    against_peer,
    convergence,
    growth,
    in_short,
    markdown,
    select,
    steps,
    to_accuracy,
)
from timed_solves import TURNED

import ngcloth

COLUMNS = (
    "scene curve order maxh triangles dofs energy energy_error outline_error "
    "stretch_error newton_steps last_mesh_steps cpu_seconds wall_seconds setup_seconds "
    "peak_megabytes import_megabytes reason"
).split()
REFERENCE = "reference"
WEAKER = 1e-5
BUDGET = 20.0  # CPU seconds for a solve by the paper's schedule
# Mesh sizes: at order 2, at order 4, of both references, of both alternatives (the default mesh is
# 0.04 on the hemisphere, 0.07 on the hemicatenoid).
MESHES = {
    "hemisphere, ks = 1": (
        (0.2, 0.1, 0.05, 0.025, 0.01),
        (0.4, 0.2),
        (0.2, 0.1),
        (0.2, 0.1, 0.04),
    ),
    "hemisphere, ks = 10": (
        (0.2, 0.1, 0.05, 0.025, 0.0175),
        (0.4, 0.2),
        (0.2, 0.1),
        (0.04,),
    ),
    "hemisphere, ks = 100": (
        (0.2, 0.1, 0.05, 0.025, 0.0175),
        (0.4, 0.2),
        (0.14, 0.1),
        (0.04,),
    ),
    "hemicatenoid, ks = 1": (
        (0.4, 0.2, 0.1, 0.05),
        (0.6, 0.3),
        (0.15, 0.1),
        (0.2, 0.1, 0.07, 0.05),
    ),
    "hemicatenoid, ks = 100": (
        (0.4, 0.2, 0.1, 0.05),
        (0.6, 0.3),
        (0.15, 0.1),
        (0.1, 0.07, 0.05),
    ),
    "sphere, p = 0.85": (
        (0.2, 0.1, 0.07, 0.05),
        (0.4, 0.2),
        (0.14, 0.1),
        (0.1, 0.05),
    ),
    "obstacle, ks = 1": ((0.5, 0.35, 0.25, 0.15), (0.8, 0.5), (0.4, 0.3), (0.25,)),
    "obstacle, ks = 100": (
        (0.5, 0.35, 0.25, 0.15),
        (0.8, 0.5),
        (0.4, 0.3),
        (0.25,),
    ),
}
MESHES |= dict.fromkeys(TURNED, ((), (), (0.5, 0.4), (0.25,)))
WEAK_MESHES = 3  # as many of the first sizes are solved with the weak barrier as well
EXACT_MESHES = {2: (0.2, 0.1, 0.05, 0.04, 0.025, 0.0125, 0.00625), 4: (0.4, 0.2, 0.1)}
EXACT_MESHES |= {6: (0.4, 0.3, 0.2), 8: (0.4, 0.3)}
PAPER_EXACT = {"schedule": "paper", "tolerance": 3e-9, "max_steps": 5000}
PAPER_MESHES = (0.1, 0.04)
# Not by the paper's schedule, which does not converge there within its budget.
LEFT_OUT = "hemisphere, ks = 10", "hemicatenoid, ks = 100", "obstacle, ks = 100"
THREADED = {CHEBYSHEV: 0.0125, "hemisphere, ks = 1": 0.035, "sphere, p = 0.85": 0.1}
PROFILED = {"hemisphere, ks = 1": 0.05, "sphere, p = 0.85": 0.1}
QUICK = {"hemisphere, ks = 1": ((0.4, 0.3), (0.5,), (0.5, 0.4), (0.4,))}
QUICK_SIZE = {"hemisphere, ks = 1": 0.4}  # of all else

OMISSIONS = """\
CPU seconds are those of one thread in a process of its own, after a first solve that loads the
libraries; the best of three where a solve takes less than {short:g} seconds. They hold mesh, set-up
and result for ngcloth, the flattening of its start, and the solves on coarser meshes with which it
begins; for IPOPT, which begins on the mesh itself and at the scene's start, made feasible, neither
set-up nor the compilation of its kernels, which the last ratio counts as well, by the clock on the
wall. A factorisation that only raises 1/Δt counts as a Newton step of ngcloth, not of IPOPT. A step
on a coarser mesh counts like any other in "steps", and not in those "on the finest mesh". Peak
memory is that of the process, imports included; exponents of memory are of what exceeds them. IPOPT
runs at order 2 only, with options found best on these scenes (exact derivatives, adaptive barrier,
MUMPS, kernels in C where there is a compiler); no other program is timed. Nothing was tuned scene
by scene for ngcloth. The paper's schedule is ngcloth's own implementation of it, with the same
limits, on the rim as well; it is then cut off after {budget:g} seconds, and not run on three
scenes, {left_out}, where it did not converge within them, nor from turned starts. It "stalls" where
Newton's method fails in one of its time steps. Two threads are timed on three scenes only, by the
clock on the wall, and mean something only where both cores are idle: NGSolve's threads wait for
each other spinning, and a busy core makes them many times slower than one. All else is of one
thread, in CPU seconds; of cold starts only one is timed, by the clock on the wall. Meshes are
uniform. Orders are 2 and 4, and 6 and 8 on the exact net. With limits, the finest meshes have 15
000 triangles at ks = 1, and fewer elsewhere. At the default barrier, 1e-3, errors do not fall below
what this barrier shifts; where a scene has several minima, as with the obstacle and a shear limit,
meshes and solvers may end in different ones, and a row is then as far from the reference as the
minima are. Energies below 1e-17 mean zero."""


def jobs(scene, meshes):
    """All solves of a scene with limits, the two references first: (curve, settings)."""
    second, fourth, references, others = meshes
    weak = {"barrier_end": WEAKER}
    found = [(REFERENCE, {"order": 4, "maxh": maxh, **weak}) for maxh in references]
    found += [(DEFAULT, {"maxh": maxh}) for maxh in dict.fromkeys((*second, *others))]
    both = dict.fromkeys((*second[:WEAK_MESHES], *others))
    found += [(WEAK, {"maxh": maxh, **weak}) for maxh in both]
    found += [(f"order 4, {WEAK}", {"order": 4, "maxh": maxh, **weak}) for maxh in fourth]
    budget = {"max_steps": 10**6, "cpu_budget": BUDGET}
    papers = others if scene not in (*LEFT_OUT, *TURNED) else ()
    found += [(PAPER, {"schedule": "paper", "maxh": maxh, **budget}) for maxh in papers]
    if importlib.util.find_spec("casadi"):
        found += [(PEER, {"maxh": maxh}) for maxh in others]
    return found


def chebyshev_jobs():
    """All solves of the scene that has an exact solution."""
    found = [
        (DEFAULT if order == 2 else f"order {order}", {"order": order, "maxh": maxh})
        for order, sizes in EXACT_MESHES.items()
        for maxh in sizes
    ]
    return found + [(PAPER, {**PAPER_EXACT, "maxh": maxh}) for maxh in PAPER_MESHES]


def run(meshes, exact=True, report=None):
    """All rows: a list of dictionaries with the keys `COLUMNS`. `report` is called with each."""
    rows, in_a_process = [], measuring.in_its_own_process

    def add(scene, curve, settings, reference):
        row, probes = in_a_process(measuring.solve, scene, curve, **settings)
        # The first reference has nothing to be compared with: the bar is that of the second.
        row |= measuring.errors(row, probes, reference or (row, probes))
        rows.append({name: row[name] for name in COLUMNS})
        if report:
            report(rows[-1])
        return row, probes

    if exact:
        reference = measuring.exact(CHEBYSHEV)
        for curve, settings in chebyshev_jobs():
            add(CHEBYSHEV, curve, settings, reference)
    for scene, sizes in meshes.items():
        reference = None
        for curve, settings in jobs(scene, sizes):
            found = add(scene, curve, settings, reference)
            if curve == REFERENCE and found[0]["reason"] == "CONVERGED":
                reference = found
    return rows


def then_two_threads(sizes):
    """Lines of a table: wall-clock seconds with one thread and with two."""
    for scene, maxh in sizes.items():
        (one, taken), (two, others) = (
            measuring.in_its_own_process(measuring.with_threads, scene, threads, maxh)
            for threads in (1, 2)
        )
        yield {
            "scene": scene,
            "maxh": maxh,
            "Newton steps": f"{taken}, {others}",
            "seconds, one thread": f"{one:.2f}",
            "seconds, two": f"{two:.2f}",
            "ratio": f"{one / two:.2f}",
        }


def cold_start():
    """The line of a table: wall-clock seconds of the first solve of a process."""
    imports, first, second = measuring.cold_start()
    yield {
        "scene": "hemisphere, ks = 1",
        "maxh": 0.2,
        "import ngcloth": f"{imports:.2f}",
        "first solve": f"{first:.2f}",
        "second solve": f"{second:.2f}",
        "first, more by": f"{first - second:.2f}",
    }


def where_the_time_goes(sizes):
    """Lines of a table: shares of CPU seconds."""
    for scene, maxh in sizes.items():
        parts, total, taken = measuring.in_its_own_process(measuring.profile, scene, maxh)
        shares = {part: f"{seconds / total:.0%}" for part, seconds in parts.items()}
        yield {"scene": scene, "maxh": maxh, "Newton steps": taken, **shares}


def linearisations(sizes):
    """Lines of a table: what automatic linearisation costs, and closed forms."""
    for scene, maxh in sizes.items():
        for way in ("automatic", "closed form"):
            found = measuring.in_its_own_process(measuring.linearised, scene, way, maxh)
            matrix, seconds, steps = found
            yield {
                "scene": scene,
                "maxh": maxh,
                "linearisation": way,
                "ms, a Newton matrix": f"{1e3 * matrix:.1f}",
                "seconds, the solve": f"{seconds:.2f}",
                "Newton steps": steps,
            }


def measured_apart(threaded, profiled):
    """Sections of the page that are not made of rows: titles and tables."""
    return {
        "Then two threads: wall-clock seconds": list(then_two_threads(threaded)),
        "Cold start: wall-clock seconds": list(cold_start()),
        "Where the time goes": list(where_the_time_goes(profiled)),
        "Two linearisations, the same numbers": list(linearisations(profiled)),
    }


def tables(rows, apart):
    """All tables but that of all solves, {title: lines}; `apart` is of `measured_apart`."""
    found = {
        "In short": in_short(rows),
        "To an energy, Chebyshev hemisphere": to_accuracy(rows),
        "Against IPOPT, same discrete problem, order 2": against_peer(rows),
        "Against the paper's schedule, same mesh, order 2": against_paper(rows),
        "Growth with the mesh, default settings": growth(rows),
        "Errors on ever finer meshes, order 2, barrier_end 1e-5": convergence(rows),
    }
    return {title: list(lines) for title, lines in (found | apart).items()}


def page(rows, tables):
    """The report as Markdown; `tables` is what the function of this name returns."""
    fields = ("scene", "curve", "maxh", *MEASURES, "newton_steps", "last_mesh_steps", "cpu_seconds")
    shown = [{k: _cell(row[k]) for k in (*fields, "peak_megabytes")} for row in rows]
    for line, row in zip(shown, rows, strict=True):
        line["newton_steps"] = steps(row)
    parts = [
        "# Error against run time",
        "Written by `python demos/work_precision.py`; all columns are in "
        "[work_precision.csv](work_precision.csv), the "
        "tables that follow in [work_precision_tables.csv](work_precision_tables.csv).",
        versions(),
        *(part for title, lines in tables.items() for part in _section(title, lines)),
        f"Exponents are fitted from {FULL} unknowns on. Steps in brackets: not converged. Shares "
        "of time are of CPU seconds of one thread.",
        "## Omissions and tweaking",
        OMISSIONS.format(short=measuring.SHORT, budget=BUDGET, left_out="; ".join(LEFT_OUT)),
        *_section("All solves", shown),
        "References: order 4; the errors of the second are its bar, the first has none.",
    ]
    return "\n\n".join(parts) + "\n"


def versions():
    """One line: programs, machine, date."""
    found = {"ngcloth": ngcloth.__version__, "ngsolve": ngs.__version__, "numpy": np.__version__}
    if importlib.util.find_spec("casadi"):
        found["casadi"] = importlib.metadata.version("casadi")
    listed = ", ".join(f"{name} {version}" for name, version in found.items())
    machine = f"Python {platform.python_version()}, {platform.machine()}"
    return f"{listed}, {machine}, {datetime.date.today()}"


def plot(rows, folder):
    """A figure for each scene: the three errors against CPU seconds, a line for each curve."""
    import matplotlib

    matplotlib.use("Agg")
    from matplotlib import pyplot

    for scene in dict.fromkeys(row["scene"] for row in rows):
        figure, panels = pyplot.subplots(1, 3, figsize=(13, 4.2), layout="constrained")
        mine = [row for row in rows if row["scene"] == scene]
        bars = [row for row in mine if row["curve"] == REFERENCE][-1:]
        for panel, (name, title) in zip(panels, MEASURES.items(), strict=True):
            for curve in dict.fromkeys(row["curve"] for row in mine if row["curve"] != REFERENCE):
                line = sorted(select(mine, scene, curve), key=lambda row: row["cpu_seconds"])
                style = {PAPER: "s--", PEER: "^:"}.get(curve, "o-")
                seconds = [row["cpu_seconds"] for row in line]
                panel.loglog(seconds, [row[name] for row in line], style, ms=4, label=curve)
            for bar in bars:
                panel.axhspan(bar[name] / 10, bar[name], color="0.9", label="bar of the reference")
            panel.set(xlabel="CPU seconds, one thread", title=title)
            panel.tick_params(which="minor", labelsize="x-small", labelrotation=45)
            panel.grid(True, alpha=0.3)
        panels[0].legend(fontsize="small")
        figure.suptitle(scene)
        file = "".join(c if c.isalnum() else "_" for c in scene)
        figure.savefig(folder / f"work_precision_{file}.png", dpi=120)
        pyplot.close(figure)


def _cell(value):
    return f"{value:.3g}" if isinstance(value, float) else str(value)


def _section(title, lines):
    return [f"## {title}", markdown(lines)] if lines else []


def main(*arguments):
    """Solve everything, print as it goes; write CSV, page and plots."""
    quick = "--quick" in arguments
    folders = [argument for argument in arguments if argument != "--quick"]
    docs, out = (Path(folders[0]),) * 2 if folders else (Path("docs"), Path("out"))
    for folder in (docs, out):
        folder.mkdir(exist_ok=True)
    print(versions(), flush=True)

    def report(row):
        print(
            "{scene:22s} {curve:24s} {order} {maxh:5.3f} {dofs:6d} {energy:10.4e} "
            "{energy_error:8.1e} {outline_error:8.1e} {stretch_error:8.1e} {newton_steps:5d} "
            "{cpu_seconds:7.2f} s {peak_megabytes:5.0f} MB {reason}".format(**row),
            flush=True,
        )

    rows = run(QUICK if quick else MESHES, exact=not quick, report=report)
    apart = measured_apart(*(QUICK_SIZE,) * 2 if quick else (THREADED, PROFILED))
    with open(docs / "work_precision.csv", "w", newline="") as file:
        writer = csv.DictWriter(file, COLUMNS)
        writer.writeheader()
        writer.writerows({name: _short(value) for name, value in row.items()} for row in rows)
    found = tables(rows, apart)
    with open(docs / "work_precision_tables.csv", "w", newline="") as file:
        writer = csv.writer(file)
        writer.writerow(("table", "line", "column", "value"))
        for title, lines in found.items():
            for number, line in enumerate(lines):
                writer.writerows((title, number, *cell) for cell in line.items())
    text = page(rows, found)
    (docs / "work_precision.md").write_text(text, encoding="utf-8")
    plot(rows, out)
    print("\n" + text.split("## All solves")[0])


def _short(value):
    return f"{value:.8g}" if isinstance(value, float) else value


if __name__ == "__main__":
    main(*sys.argv[1:])
