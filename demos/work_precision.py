"""Error against run time: ngcloth by default, to an accuracy, at other orders; alternatives.

How many seconds does a patch ψ of a given error take? The errors are

    |E(ψ) − E(ψ*)|/(2π kc),   max |ψ − ψ*| on the rim,   (mean (λ − λ*)²)^½ over the cloth,

where ψ* is the exact Chebyshev net (E = 0) where there is one, and else that of a far finer solve
at order 4 with a weak barrier, whose own error bar is its distance from the next coarser one; rows
below the bar tell no more. Alternatives are the paper's own schedule of barrier and pseudo-time
steps, and IPOPT on the same discrete problem (the extra `bench`), which goes to the optimum and so
compares with a weak barrier. Beside errors of the energy are the bars that the solves gave
themselves.

    python demos/work_precision.py               # ten minutes; writes docs/ and out/
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
    TO_ACCURACY,
    WEAK,
    against_paper,
    against_peer,
    bars,
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
    "scene curve order maxh triangles dofs energy energy_bar energy_error outline_error "
    "stretch_error newton_steps last_mesh_steps cpu_seconds wall_seconds setup_seconds "
    "peak_megabytes import_megabytes reason"
).split()
REFERENCE = "reference"
WEAKER = 1e-5  # barrier, where IPOPT is compared with
WEAKEST = 1e-7  # of references
BUDGET = 10.0  # CPU seconds for a solve by the paper's schedule, or to an accuracy
PEER_BUDGET = 30.0
# Mesh sizes: by default, at order 4, of both references, of both alternatives at order 2 (the
# default mesh is 0.08 on the sphere, 0.15 on the hemicatenoid).
MESHES = {
    "hemisphere, ks = 1": ((0.32, 0.16, 0.08, 0.04), (0.32, 0.16), (0.14, 0.07), (0.2, 0.1)),
    "hemisphere, ks = 10": ((0.16, 0.08), (), (0.2, 0.1), ()),
    "hemisphere, ks = 100": ((0.32, 0.16, 0.08), (0.32, 0.16), (0.14, 0.07), ()),
    "hemicatenoid, ks = 1": ((0.6, 0.3, 0.15, 0.075), (0.6, 0.3), (0.2, 0.1), (0.2, 0.1)),
    "hemicatenoid, ks = 100": ((0.3, 0.15), (), (0.2, 0.15), ()),
    "sphere, p = 0.7": ((0.32, 0.16, 0.08), (0.32,), (0.2, 0.1), ()),
    "sphere, p = 0.85": ((0.32, 0.16, 0.08), (), (0.2, 0.16), (0.1,)),
    "obstacle, ks = 1": ((0.6, 0.3), (0.6,), (0.5, 0.4), ()),
    "obstacle, ks = 100": ((0.6, 0.5), (), (0.6, 0.5), ()),
}
MESHES |= dict.fromkeys(TURNED, ((), (), (0.6, 0.5), (0.5,)))
EXACT_MESHES = {2: (0.2, 0.1, 0.05, 0.04, 0.025, 0.0125), 4: (0.4, 0.2, 0.1)}
EXACT_MESHES |= {6: (0.4, 0.3, 0.2), 8: (0.4, 0.3)}
PAPER_EXACT = {"schedule": "paper", "tolerance": 3e-9, "max_steps": 5000}
PAPER_MESHES = (0.1,)
WEAK_MESHES = 3  # as many of the default's first sizes are solved at order 2 as well
ACCURACIES = (1e-2, 1e-3)  # relative, of `solve`; not of obstacles
PROFILED = {"hemisphere, ks = 1": 0.08, "sphere, p = 0.85": 0.16}
LINEARISED = {"hemisphere, ks = 1": 0.08}
QUICK = {"hemisphere, ks = 1": ((0.4, 0.3), (0.5,), (0.5, 0.4), (0.4,))}
QUICK_SIZE = {"hemisphere, ks = 1": 0.3}  # of all else

OMISSIONS = """\
CPU seconds are those of one thread in a process of its own, after a first solve that loads the
libraries; the best of three where a solve takes less than {short:g} seconds. They hold mesh, set-up
and result for ngcloth, the flattening of its start, and the solves on coarser meshes with which it
begins; for IPOPT, which begins on the mesh itself and at the scene's start, made feasible, neither
set-up nor the compilation of its kernels, which the last ratio counts as well, by the clock on the
wall. IPOPT has the points at which ngcloth's solve came to ask limits from the beginning; what it
took to find them is not counted, but is in its peak memory. A factorisation that only raises 1/Δt
counts as a Newton step of ngcloth, not of IPOPT. A step on a coarser mesh counts like any other in
"steps", and not in those "on the finest mesh". Peak memory is that of the process, imports
included; exponents of memory are of what exceeds them. IPOPT runs at order 2 only, with options
found best on these scenes (exact derivatives, adaptive barrier, MUMPS, kernels in C where there is
a compiler); no other program is timed. Nothing was tuned scene by scene for ngcloth. The paper's
schedule is ngcloth's own implementation of it at order 2, with the limits at the points of the
rules alone; it is cut off after {budget:g} seconds, IPOPT after {peer_budget:g}. It "stalls" where
Newton's method fails in one of its time steps. Solves to an accuracy are cut off after {budget:g}
seconds, and have then the last mesh that was finished; there are none of obstacles. All is of one
thread, in CPU seconds; of cold starts only one is timed, by the clock on the wall. The machine did
other work at the same time, so that ratios are good to some tens of per cent. Meshes are uniform.
Where a scene has several minima, as with the obstacle and a shear limit, meshes and solvers may end
in different ones, and a row is then as far from the reference as the minima are; on the sphere with
p = 0.85 no mesh here resolves the layer along the rim, and "errors" there tell the distance of one
coarse answer from another. Energies below 1e-17 mean zero."""


def jobs(scene, meshes):
    """All solves of a scene with limits, the two references first: (curve, settings)."""
    second, fourth, references, others = meshes
    best = {"order": 4, "barrier_end": WEAKEST}
    found = [(REFERENCE, {"maxh": maxh, **best}) for maxh in references]
    found += [(DEFAULT, {"maxh": maxh}) for maxh in dict.fromkeys((*second, *others))]
    found += [("order 4", {"order": 4, "maxh": maxh}) for maxh in fourth]
    if second and not scene.startswith("obstacle"):
        found += [(TO_ACCURACY, {"accuracy": a, "cpu_budget": BUDGET}) for a in ACCURACIES]
    weak = {"order": 2, "barrier_end": WEAKER}
    both = dict.fromkeys((*second[:WEAK_MESHES], *others))
    found += [(WEAK, {"maxh": maxh, **weak}) for maxh in both]
    paper = {"order": 2, "schedule": "paper", "max_steps": 10**6, "cpu_budget": BUDGET}
    found += [(PAPER, {"maxh": maxh, **paper}) for maxh in (() if scene in TURNED else others)]
    if importlib.util.find_spec("casadi"):
        found += [(PEER, {"maxh": maxh, "cpu_budget": PEER_BUDGET, **weak}) for maxh in others]
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


def measured_apart(profiled, linearised):
    """Sections of the page that are not made of rows: titles and tables."""
    return {
        "Cold start: wall-clock seconds": list(cold_start()),
        "Where the time goes": list(where_the_time_goes(profiled)),
        "Two linearisations, the same numbers": list(linearisations(linearised)),
    }


def tables(rows, apart):
    """All tables but that of all solves, {title: lines}; `apart` is of `measured_apart`."""
    found = {
        "In short": in_short(rows),
        "Bars beside errors": bars(rows),
        "To an energy, Chebyshev hemisphere": to_accuracy(rows),
        "Against IPOPT, same discrete problem, order 2": against_peer(rows),
        "Against the paper's schedule, same mesh, order 2": against_paper(rows),
        "Growth with the mesh, default settings": growth(rows),
        "Errors on ever finer meshes, default settings": convergence(rows),
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
        OMISSIONS.format(short=measuring.SHORT, budget=BUDGET, peer_budget=PEER_BUDGET),
        *_section("All solves", shown),
        "References: order 4, barrier_end 1e-7; the errors of the second are its bar, the first "
        "has none.",
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
        references = [row for row in mine if row["curve"] == REFERENCE][-1:]
        for panel, (name, title) in zip(panels, MEASURES.items(), strict=True):
            for curve in dict.fromkeys(row["curve"] for row in mine if row["curve"] != REFERENCE):
                line = sorted(select(mine, scene, curve), key=lambda row: row["cpu_seconds"])
                style = {PAPER: "s--", PEER: "^:"}.get(curve, "o-")
                seconds = [row["cpu_seconds"] for row in line]
                (drawn,) = panel.loglog(
                    seconds, [row[name] for row in line], style, ms=4, label=curve
                )
                if name == "energy_error" and curve in (DEFAULT, TO_ACCURACY):  # up to their bars
                    told = [row for row in line if np.isfinite(row["energy_bar"])]
                    ends = [[row[key] for row in told] for key in ("energy_error", "energy_bar")]
                    seconds = [row["cpu_seconds"] for row in told]
                    panel.vlines(seconds, *ends, color=drawn.get_color(), alpha=0.5)
                    panel.plot(seconds, ends[1], "_", color=drawn.get_color())
            for bar in references:
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
    apart = measured_apart(*((QUICK_SIZE,) * 2 if quick else (PROFILED, LINEARISED)))
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
