"""What the rows of the stability table say, in a few sentences and as a page."""

import platform

import ngsolve as ngs
import numpy as np
from stability_cases import ENDS, EXPLANATIONS, REFUSED, SOLVES

import ngcloth
from ngcloth.problem.bars import with_bar

STEEP = 3  # growth of Newton steps over an axis from which on IPOPT solves its rows, too
PEER_TEXT = (
    f"IPOPT, on the same discrete problem, solves the rows of axes with a growth of {STEEP} or "
    "more that have limits, at any order; not those of `barrier_end`, as it always goes to the "
    "optimum, where ngcloth ends at a barrier of 1e-4. It has ngcloth's points, added ones "
    "included, from its first step."
)
NO_PEER = "IPOPT's columns are empty: this run was without it."
WRONG = ("folded", "not stationary", "the rim meets itself", "not finite")


def wrong(row):
    """Whether a row says "converged" of an answer that its certificate finds wrong."""
    return row["outcome"] == "CONVERGED" and row["certificate"].startswith(WRONG)


def uncertified(row):
    """Whether a well-posed row converges to what is not certified."""
    solved = row["expected"] == SOLVES and row["outcome"] == "CONVERGED"
    return solved and row["certificate"] != "certified"


def failed(row):
    """Whether a row does not do what is expected of it."""
    if row["expected"] == REFUSED:
        return not row["outcome"].startswith("InputError")
    if row["expected"] == ENDS:
        return wrong(row) or not row["outcome"].isupper()
    return wrong(row) or row["outcome"] != "CONVERGED"


def growth(rows, column="newton_steps"):
    """Least and greatest count of the converged rows of each axis: {axis: (min, max)}."""
    counts = {}
    for row in rows:
        solved = row["outcome"] == "CONVERGED" and isinstance(row[column], int)
        if row["expected"] == SOLVES and solved:
            counts.setdefault(row["axis"], []).append(row[column])
    return {axis: (min(steps), max(steps)) for axis, steps in counts.items()}


def summary(rows):
    """The table in a few sentences."""
    posed = [row for row in rows if row["expected"] == SOLVES]
    ill = [row for row in rows if row["expected"] == ENDS]
    bad = [row for row in rows if row["expected"] == REFUSED]
    solved = [row for row in posed if row["outcome"] == "CONVERGED"]
    certified = [row for row in solved if row["certificate"] == "certified"]
    finer = sum(row["finer_certificate"] == "certified" for row in rows)
    steps = growth(rows)
    steep = sum(high >= STEEP * low for low, high in steps.values())
    told = [
        f"{len(rows)} rows, {len(posed)} of them well posed: {len(solved)} converge "
        f"({100 * len(solved) / max(len(posed), 1):.1f} %).",
        f"Of those {len(certified)} are certified "
        f"({100 * len(certified) / max(len(solved), 1):.1f} %), "
        f"{sum(map(wrong, rows))} wrong by their certificates (folded, not stationary or "
        f"overlapping); the rest is listed below. On the mesh by default, or one of half or "
        f"a quarter of its size, {finer} more are certified, "
        f"{100 * (len(certified) + finer) / max(len(solved), 1):.1f} % in all.",
        f"{sum(isinstance(row['energy_bar'], float) for row in solved)} of them have a chain of "
        f"meshes, and so a bar; {sum(row['energy_bar'] == np.inf for row in solved)} of these are "
        "not resolved by their coarse meshes, and say so.",
        f"{sum(not failed(row) for row in ill)} of {len(ill)} rows that may have no solution end "
        f"with a reason, {sum(not failed(row) for row in bad)} of {len(bad)} bad inputs are "
        "refused.",
        f"Newton counts grow by less than {STEEP} over {len(steps) - steep} of {len(steps)} axes.",
    ]
    both = [row for row in rows if isinstance(row["ipopt_steps"], int)]
    if both:
        peer = growth(both, "ipopt_steps")
        more = sum(row["newton_steps"] > row["ipopt_steps"] for row in both)
        told.append(
            f"On {len(peer)} of the other axes IPOPT solved the same rows: its counts grow by less "
            f"than {STEEP} over {sum(high < STEEP * low for low, high in peer.values())} of them. "
            f"ngcloth takes more steps than IPOPT in {more} of {len(both)} rows."
        )
    return told


def page(rows):
    """The Markdown page."""
    lines = [
        "# Stiff and extreme cases",
        "",
        "Written by `python demos/stability.py`, with "
        f"ngcloth {ngcloth.__version__}, ngsolve {ngs.__version__}, "
        f"Python {platform.python_version()}; all columns are in [stability.csv](stability.csv). "
        "Seconds are CPU seconds of one thread, peak memory is that of a process that ran "
        "nothing else. Scenes are hemispheres with ks = kc where no other is named, maxh 0.25 (by "
        "default it were 0.08), order 3 with limits and 2 without. A bar needs a chain of meshes: "
        "scenes without limits have none.",
        "",
        "## Summary",
        "",
        *(f"- {line}" for line in summary(rows)),
        "",
        "## Not certified",
        "",
    ]
    lines += [
        f"- {row['axis']}: {row['value']}: {row['certificate']}"
        + (f". *{on_finer(row)}*" if row["finer_certificate"] else "")
        for row in rows
        if uncertified(row)
    ] or ["None."]
    lines += ["", "## Failures", ""]
    failures = [row for row in rows if failed(row)]
    for row in failures:
        why = EXPLANATIONS.get((row["axis"], row["value"]), "Not explained yet.")
        lines.append(f"- **{row['axis']}: {row['value']}**: {_outcome(row)}. {why}")
    lines += ["None." if not failures else "", "", "## Newton steps over each axis", ""]
    head = "axis", "least", "greatest", "growth", "IPOPT, least", "greatest", "growth"
    lines += [_table_row(head), _table_row(["---"] * len(head))]
    peer = growth(rows, "ipopt_steps")
    lines += [
        _table_row([axis, *_span(steps), *_span(peer.get(axis))])
        for axis, steps in growth(rows).items()
    ]
    lines += [
        "",
        PEER_TEXT if any(row["ipopt_steps"] for row in rows) else NO_PEER,
    ]
    lines += ["", "## All rows", ""]
    head = (
        "value ends Newton IPOPT seconds triangles E/2πkc λ \\|γ\\| MB checked certificate".split()
    )
    for axis in dict.fromkeys(row["axis"] for row in rows):
        lines += [f"### {axis}", "", _table_row(head), _table_row(["---"] * len(head))]
        lines += [_table_row(_cells(row)) for row in rows if row["axis"] == axis]
        lines.append("")
    return "\n".join(lines)


def _span(steps):
    """Least, greatest and growth as cells."""
    if steps is None:
        return [""] * 3
    low, high = steps
    return [str(low), str(high), f"{high / low:.1f}"]


def _outcome(row):
    text = row["outcome"]
    return f"{text}, but {row['certificate'].split(';')[0]}" if wrong(row) else text


def _cells(row):
    if row["energy"] == "":
        return [row["value"], row["outcome"], *[""] * 10]
    return [
        row["value"],
        row["outcome"],
        str(row["newton_steps"]),
        str(row["ipopt_steps"]),
        f"{row['seconds']:.2f}",
        str(row["triangles"]),
        _with_bar(row),
        f"{row['stretch_min']:.3f} … {row['stretch_max']:.3f}",
        f"{row['shear_max']:.3f}",
        str(row["peak_megabytes"]),
        f"{row['certificate_seconds']} s",
        row["certificate"].split(";")[0],
    ]


def on_finer(row):
    """What finer meshes tell of a row, in words."""
    told = row["finer_certificate"]
    if row["finer_energy"] == "":
        return f"On a finer mesh: {told}"
    return f"At maxh {row['finer_maxh']:.3g}, {_with_bar(row, 'finer_energy')}: {told}"


def _with_bar(row, name="energy"):
    bar = row[f"{name}_bar"]
    return with_bar(f"{row[name]:.4e}", None if bar == "" else bar)


def _table_row(cells):
    return "| " + " | ".join(cells) + " |"
