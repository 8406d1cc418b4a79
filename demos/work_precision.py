"""Work and precision on the hemisphere: error against run time, order by order.

The Chebyshev hemisphere (§5.1 of the paper) has an exact patch: E = 0, and the hyperbolic equation
gives the outline to rounding error (`ngcloth.chebyshev`). One thread solves it at orders 1 to 8 on
several meshes, and beside them by the paper's schedule of pseudo-time steps of one size at order 2.

Run from the repository:

    python demos/work_precision.py            # three minutes; table, CSV and plot go to out/
"""

import csv
import platform
import resource
import sys
import time
from pathlib import Path

import ngsolve as ngs
import numpy as np

import ngcloth
from ngcloth.chebyshev import ChebyshevNet

MESHES = {
    1: (0.2, 0.1, 0.05, 0.025),
    2: (0.4, 0.2, 0.1, 0.05, 0.04, 0.03),
    3: (0.4, 0.2, 0.1, 0.05),
    4: (0.4, 0.3, 0.2, 0.1, 0.06),
    5: (0.4, 0.3, 0.2, 0.1),
    6: (0.4, 0.3, 0.2, 0.15, 0.1),
    7: (0.4, 0.3, 0.2, 0.15),
    8: (0.4, 0.3, 0.25, 0.2, 0.15),
}
PAPER = {"schedule": "paper", "order": 2, "tolerance": 3e-9, "max_steps": 5000}
PAPER_MESHES = (0.1, 0.05, 0.04)
COLUMNS = (
    "schedule order maxh dofs energy outline_error newton_steps seconds peak_megabytes reason"
).split()
SHORT = 1.0  # repeat runs shorter than this many seconds, and take the best

OMISSIONS = """\
Omissions. One scene, smooth up to its rim: where an inequality is active high order gains less.
Energy errors below 1e-17 are not to be trusted further than their size. Seconds are wall-clock
time of `solve`, mesh and result included, one thread; the best of three where a run takes less
than a second; the first solve of a process, which loads libraries, is not counted. Peak memory is
that of the process so far, hence only an upper bound for all but the largest run before it. The
fixed-step rows stop at maxh = 0.04: that run takes a minute. No other program is timed."""


def exact_outline(scene, n=100):
    """Rim points of a quarter, and their exact flat positions."""
    rim = scene.surface.domain.rim(4 * n)[: n + 1]
    return rim, ChebyshevNet.symmetric(scene.surface).material(rim)


def measure(scene, exact, **settings):
    """One row of the table: solve, repeatedly if that is quick, and compare with the exact net."""
    rim, expected = exact
    seconds = []
    while len(seconds) < 3 and (not seconds or min(seconds) < SHORT):
        begin = time.perf_counter()
        result = ngcloth.solve(scene, **settings)
        seconds.append(time.perf_counter() - begin)
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return {
        "schedule": result.settings["schedule"],
        "order": result.settings["order"],
        "maxh": result.settings["maxh"],
        "dofs": result.state.space.ndof,
        "energy": result.normalized_energy,
        "outline_error": float(np.linalg.norm(result.psi(*rim.T) - expected, axis=1).max()),
        "newton_steps": result.newton_iterations,
        "seconds": min(seconds),
        "peak_megabytes": peak / (2**20 if sys.platform == "darwin" else 2**10),
        "reason": result.reason.name,
    }


def run(meshes=MESHES, paper_meshes=PAPER_MESHES, report=None):
    """All rows: a list of dictionaries with the keys `COLUMNS`. `report` is called with each."""
    ngs.SetNumThreads(1)
    scene = ngcloth.scenes.hemisphere()
    exact = exact_outline(scene)
    ngcloth.solve(scene, maxh=0.5)
    wanted = [{"order": order, "maxh": maxh} for order, sizes in meshes.items() for maxh in sizes]
    wanted += [{**PAPER, "maxh": maxh} for maxh in paper_meshes]
    rows = []
    for settings in wanted:
        rows.append(measure(scene, exact, **settings))
        if report:
            report(rows[-1])
    return rows


def quickest(rows, energy, schedule="adaptive", order=None):
    """The row that reaches an energy in the least time; None if there is none."""
    reached = [
        row
        for row in rows
        if row["energy"] <= energy
        and row["schedule"] == schedule
        and row["reason"] == "CONVERGED"
        and order in (None, row["order"])
    ]
    return min(reached, key=lambda row: row["seconds"], default=None)


def ratios(rows):
    """Seconds to an energy of 1e-7: by the paper's schedule, the default at order 2, any order."""
    paper = quickest(rows, 1e-7, "paper")
    return paper, quickest(rows, 1e-7, order=2), quickest(rows, 1e-7)


def plot(rows, path):
    """Energy and outline error against seconds, a line for each order, log-log."""
    import matplotlib

    matplotlib.use("Agg")
    from matplotlib import pyplot

    figure, panels = pyplot.subplots(1, 2, figsize=(11, 4.6), layout="constrained")
    titles = {"energy": "energy $E/(2πk_c)$, exactly 0", "outline_error": "largest outline error"}
    orders = sorted({row["order"] for row in rows})
    colours = dict(zip(orders, pyplot.cm.viridis(np.linspace(0, 0.9, len(orders))), strict=True))
    lines = sorted({(row["schedule"], row["order"]) for row in rows})
    for panel, (name, title) in zip(panels, titles.items(), strict=True):
        for schedule, order in lines:
            line = [r for r in rows if (r["schedule"], r["order"]) == (schedule, order)]
            paper = schedule == "paper"
            panel.loglog(
                [row["seconds"] for row in line],
                [row[name] for row in line],
                "s--" if paper else "o-",
                color="crimson" if paper else colours[order],
                markersize=4,
                label=f"fixed steps, order {order}" if paper else f"order {order}",
            )
        panel.set(xlabel="seconds, one thread", title=title)
        panel.grid(True, which="major", alpha=0.3)
    panels[1].legend(fontsize="small", loc="lower right")
    figure.savefig(path, dpi=150)
    pyplot.close(figure)


def main(folder="out"):
    """Print the table and the closing ratios; write CSV and plot to `folder`."""
    print(
        f"ngcloth {ngcloth.__version__}, ngsolve {ngs.__version__}, numpy {np.__version__}, "
        f"Python {platform.python_version()}, {platform.machine()}\n"
    )
    print(" schedule order   maxh    dofs      energy     outline  newton  seconds   peak MB")

    def report(row):
        print(
            "{schedule:>9s} {order:5d} {maxh:6.3f} {dofs:7d}  {energy:10.2e}  "
            "{outline_error:10.2e}  {newton_steps:6d} {seconds:8.3f}  {peak_megabytes:8.0f}".format(
                **row
            )
            + ("" if row["reason"] == "CONVERGED" else f"  {row['reason']}"),
            flush=True,
        )

    rows = run(report=report)
    folder = Path(folder)
    folder.mkdir(exist_ok=True)
    with open(folder / "work_precision.csv", "w", newline="") as file:
        writer = csv.DictWriter(file, COLUMNS)
        writer.writeheader()
        writer.writerows(rows)
    plot(rows, folder / "work_precision.png")

    paper, *ours = ratios(rows)
    if paper:
        print(f"\nto E/(2π kc) = 1e-7: {paper['seconds']:.1f} s with fixed steps at order 2")
        for row in ours:
            print(
                f"    {row['seconds']:.3f} s by default steps at order {row['order']}, "
                f"maxh {row['maxh']}: {paper['seconds'] / row['seconds']:.0f} times faster"
            )
    else:
        print("\nFixed steps do not reach E/(2π kc) = 1e-7 on these meshes.")
    for name, goal in (("energy", 1e-12), ("outline_error", 1e-8)):
        reached = [row for row in rows if row[name] <= goal]
        row = min(reached, key=lambda row: row["seconds"])
        print(
            f"to {name.replace('_', ' ')} {goal:g}: {row['seconds']:.3f} s at order "
            f"{row['order']}, maxh {row['maxh']}"
        )
    print(f"\n{OMISSIONS}")


if __name__ == "__main__":
    main()
