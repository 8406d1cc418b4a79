"""For `work_precision.py`: from its rows to the tables of its page.

A table is a list of lines, a line a dictionary {column: cell}. What compares, compares rows of one
scene on one mesh, or the errors along a row of meshes.
"""

import numpy as np
from measuring import PEER

DEFAULT, WEAK, PAPER = "default", "order 2, barrier_end 1e-5", "paper's schedule"
TO_ACCURACY = "accuracy="
CHEBYSHEV = "hemisphere, Chebyshev"
AGREE = 1e-4  # relative difference of energies that count as equal
FULL = 2000  # unknowns from which on exponents are fitted
MEASURES = {
    "energy_error": "energy $E/(2πk_c)$",
    "outline_error": "outline, largest",
    "stretch_error": "stretch, root mean square",
}
# For the README: scenes, and the mesh on which all have solved them.
SHORT = {"hemisphere, ks = 1": 0.1, "hemicatenoid, ks = 1": 0.1, "sphere, p = 0.85": 0.1}
SHORT |= {"obstacle, ks = 1, start turned by 10°": 0.5}


def markdown(lines):
    """A table as Markdown."""
    table = [lines[0].keys(), ["---"] * len(lines[0]), *(line.values() for line in lines)]
    return "\n".join(f"| {' | '.join(map(str, row))} |" for row in table)


def select(rows, scene, curve, maxh=None):
    """The rows of a curve."""
    return [
        row
        for row in rows
        if (row["scene"], row["curve"]) == (scene, curve) and maxh in (None, row["maxh"])
    ]


def against_peer(rows):
    """Lines of a table: IPOPT over ngcloth on the same mesh with the weak barrier."""
    for other in [row for row in rows if row["curve"] == PEER]:
        (ours,) = select(rows, other["scene"], WEAK, other["maxh"])
        apart = abs(ours["energy"] / other["energy"] - 1)
        whole = other["cpu_seconds"] + other["setup_seconds"]
        yield {
            "scene": other["scene"],
            "maxh": other["maxh"],
            "energies apart": f"{apart:.1e}" + ("" if apart <= AGREE else " (not equal)"),
            "steps, ngcloth": steps(ours),
            "on the finest mesh": steps(ours, "last_mesh_steps"),
            "steps, IPOPT": steps(other),
            "seconds, ngcloth": f"{ours['cpu_seconds']:.2f}",
            "seconds, IPOPT": f"{other['cpu_seconds']:.2f}",
            "ratio": f"{other['cpu_seconds'] / ours['cpu_seconds']:.1f}",
            "with IPOPT's set-up": f"{whole / ours['cpu_seconds']:.1f}",
        }


def bars(rows):
    """Lines of a table: what solves say of the error of their energy, and what it is."""
    for row in rows:
        if row["curve"] in (DEFAULT, TO_ACCURACY) and not np.isnan(row["energy_bar"]):
            bar, error = row["energy_bar"], row["energy_error"]
            yield {
                "scene": row["scene"],
                "curve": row["curve"],
                "maxh": f"{row['maxh']:.3g}",
                "triangles": row["triangles"],
                "E/(2π kc)": f"{row['energy']:.6g}",
                "bar": f"{bar:.1e}" if np.isfinite(bar) else "not resolved",
                "error": f"{error:.1e}",
                "bar over error": f"{bar / error:.1f}" if np.isfinite(bar) else "–",
                "seconds": f"{row['cpu_seconds']:.2f}",
            }


def against_paper(rows):
    """Lines of a table: the paper's schedule over ngcloth's on the same mesh, both of order 2."""
    for other in [row for row in rows if row["curve"] == PAPER]:
        curve = DEFAULT if other["scene"] == CHEBYSHEV else WEAK
        ours = select(rows, other["scene"], curve, other["maxh"])
        if ours:
            ratio = other["cpu_seconds"] / ours[0]["cpu_seconds"]
            yield {
                "scene": other["scene"],
                "maxh": other["maxh"],
                "steps, ngcloth": steps(ours[0]),
                "steps, paper": steps(other),
                "seconds, ngcloth": f"{ours[0]['cpu_seconds']:.2f}",
                "seconds, paper": f"{other['cpu_seconds']:.2f}",
                "ratio": _unless_stalled(other, f"{ratio:.0f}", "> "),
            }


def in_short(rows):
    """Lines of a table for the README: steps and seconds beside those of the alternatives."""

    def line(name, ours, paper, peer):
        taken, last = steps(ours), ours["last_mesh_steps"]
        if last < ours["newton_steps"]:
            taken += f", of which {last} on this mesh"
        spent = "–"
        if paper:
            spent = _unless_stalled(paper, f"{paper['cpu_seconds']:.2g}", "more than ")
        return {
            "one thread": name,
            "Newton steps": taken,
            "seconds": f"{ours['cpu_seconds']:.2g}",
            "IPOPT": _beside(peer, ours) if peer else "–",
            "the paper's schedule": spent,
        }

    for goal in (1e-7, 1e-12):
        ours, paper = fastest(rows, goal), fastest(rows, goal, by_paper=True)
        if ours:
            name = f"Chebyshev hemisphere to E/(2π kc) = {goal:g}, order {ours['order']}"
            yield line(name, ours, paper, None)
    for scene, maxh in SHORT.items():
        ours, peers, papers = (select(rows, scene, c, maxh) for c in (WEAK, PEER, PAPER))
        if ours:
            yield line(f"{scene}, maxh {maxh}", ours[0], *(m[0] if m else None
                       for m in (papers, peers)))  # fmt: skip


def _beside(peer, ours):
    apart = peer["energy"] / ours["energy"] - 1
    told = "" if abs(apart) <= AGREE else f", E {100 * apart:+.0f} %"
    return f"{steps(peer)} steps, {peer['cpu_seconds']:.2g}{told}"


def _unless_stalled(row, text, more):
    """The text; after `more` if the row ran out of time, and another one if it gave up."""
    return {"CONVERGED": text, "CALLBACK": more + text}.get(row["reason"], "stalls")


def fastest(rows, goal, by_paper=False):
    """The row that takes least time to bring the energy of the Chebyshev scene below `goal`."""
    good = (
        row
        for row in rows
        if row["scene"] == CHEBYSHEV
        and (row["curve"] == PAPER) == by_paper
        and row["energy"] <= goal
        and row["reason"] == "CONVERGED"
    )
    return min(good, key=lambda row: row["cpu_seconds"], default=None)


def to_accuracy(rows):
    """Lines of a table: seconds to an energy on the Chebyshev hemisphere."""
    for goal in (1e-6, 1e-7, 1e-12):
        line = {"E/(2π kc) below": f"{goal:g}"}
        for name, paper in (("paper", True), ("ngcloth", False)):
            best = fastest(rows, goal, paper)
            line[f"seconds, {name}"] = f"{best['cpu_seconds']:.2f}" if best else "–"
            line[f"order, maxh, {name}"] = f"{best['order']}, {best['maxh']}" if best else "–"
        yield line


def growth(rows):
    """Lines of a table: Newton steps, and exponents in the unknowns, along each mesh row."""
    for scene in dict.fromkeys(row["scene"] for row in rows):
        line = sorted(select(rows, scene, DEFAULT), key=lambda row: row["dofs"])
        yield {
            "scene": scene,
            "triangles": ", ".join(str(row["triangles"]) for row in line),
            "Newton steps": ", ".join(steps(row) for row in line),
            "on the finest mesh": ", ".join(steps(row, "last_mesh_steps") for row in line),
            "exponent of time": _exponent(line, lambda row: row["cpu_seconds"]),
            "of memory": _exponent(
                line, lambda row: row["peak_megabytes"] - row["import_megabytes"]
            ),
        }


def convergence(rows):
    """Lines of a table: with which power of the mesh size the errors fall."""
    for scene in dict.fromkeys(row["scene"] for row in rows):
        line = [row for row in select(rows, scene, DEFAULT) if row["reason"] == "CONVERGED"]
        if len(line) > 2 and scene != CHEBYSHEV:
            sizes = np.log([row["maxh"] for row in line])
            powers = {
                name: np.polyfit(sizes, np.log([row[name] for row in line]), 1)[0]
                for name in MEASURES
            }
            yield {
                "scene": scene,
                "maxh": ", ".join(f"{row['maxh']:g}" for row in line),
                "triangles": ", ".join(str(row["triangles"]) for row in line),
                "Newton steps": ", ".join(steps(row) for row in line),
                **{f"power, {name.split('_')[0]}": f"{q:.1f}" for name, q in powers.items()},
            }


def _exponent(line, measure):
    large = [row for row in line if row["dofs"] >= FULL]
    if len(large) < 2:
        return "–"
    logs = np.log([(row["dofs"], measure(row)) for row in large])
    return f"{np.polyfit(*logs.T, 1)[0]:.2f}"


def steps(row, which="newton_steps"):
    """A number of steps, in brackets if the solve did not converge."""
    return str(row[which]) if row["reason"] == "CONVERGED" else f"({row[which]})"
