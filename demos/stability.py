"""How far the solver can be pushed: stiff, extreme and badly started scenes, one row each.

Does a solve end at a patch ψ that fulfils, whatever its stiffnesses, surface and start are,

    dE + d(dE[v]) − Σ ∫ z dc dA = 0,   dE(ψ)[w] = 0 for all w,   J > 0,
    c(ψ) > 0,   z > 0,   c z = μ

for every slack c of its limits, or else with a reason? E is as in the other demos, v and z
the multipliers of equilibrium and limits. And does the patch that comes out carry its proof, and
know its error?

Each row changes one thing of a scene that is easy otherwise: the stiffnesses, the weight at which
the barrier ends, the limits, the surface, the chart, the mesh, the order or the start. It says how
the solve ended, what it cost, how far the energy may be off (`Result.error`), and what the
certificate (`ngcloth.verify`) makes of the patch. All but the named settings are those by default,
on coarse meshes; rows that are not certified there are solved again on finer ones. A row
runs in a process of its own with a limit on its time, so that a crash or a hang is a row too.

Where Newton steps grow by a factor 3 or more over an axis, is it the solver or the problem? With
the extra `bench`, IPOPT solves the rows of that axis too.

Run from the repository (Linux or macOS):

    python demos/stability.py            # half an hour; writes docs/stability.{md,csv}
"""

import csv
import importlib.util
import multiprocessing
import platform
import re
import resource
import signal
import time
from dataclasses import replace
from pathlib import Path

import ngsolve as ngs
import numpy as np
from measuring import peak_megabytes
from stability_cases import ENDS, EXPLANATIONS, FINE_MESH, REFUSED, SOLVES, cases

import ngcloth
from ngcloth.problem.bars import with_bar

PATIENCE = 5  # a row that computes nothing is ended after so many times its limit
COLUMNS = (
    "axis value expected outcome newton_steps seconds triangles energy energy_bar stretch_min "
    "stretch_max shear_max certificate certificate_seconds peak_megabytes ipopt_steps maxh "
    "finer_maxh finer_energy finer_energy_bar finer_certificate"
).split()
STEEP = 3  # growth of Newton steps over an axis from which on IPOPT solves its rows, too
HALVINGS = 2  # at most, of the mesh by default, for a row that is not certified
PEER_SECONDS = 300  # limit of a row for IPOPT
PEER_TEXT = (
    f"IPOPT, on the same discrete problem, solves the rows of axes with a growth of {STEEP} or "
    "more that have limits, at any order; not those of `barrier_end`, as it always goes to the "
    "optimum, where ngcloth ends at a barrier of 1e-4. It has ngcloth's points, added ones "
    "included, from its first step."
)
NO_PEER = "IPOPT's columns are empty: this run was without it."
WRONG = ("folded", "not stationary", "the rim meets itself", "not finite")


# One row ----------------------------------------------------------------------------------------


def run(case, work=None):
    """The row of a case, of a process of its own that is ended at the limit.

    There `work` sends, of a case, parts of the row; by default those of ngcloth's solve.
    """
    fork = multiprocessing.get_context("fork")
    here, there = fork.Pipe(duplex=False)
    process = fork.Process(target=_work, args=(case, there, work or _solve))
    row = dict.fromkeys(COLUMNS, "") | {name: getattr(case, name) for name in COLUMNS[:3]}
    late = f"not ended in {case.limit} s"
    row |= {"outcome": late, "certificate": late}
    process.start()
    there.close()
    end = time.monotonic() + PATIENCE * case.limit
    try:
        while here.poll(max(0.0, end - time.monotonic())):
            row |= here.recv()
    except EOFError:  # all sent, out of time, or crashed
        process.join()
        if process.exitcode not in (0, -signal.SIGXCPU):
            crash = f"crash, exit code {process.exitcode}"
            row["certificate"] = crash
            if row["outcome"] == late:
                row["outcome"] = crash
    process.kill()
    process.join()
    return row


def _work(case, pipe, work):
    resource.setrlimit(resource.RLIMIT_CPU, (case.limit, case.limit + 5))
    ngs.SetNumThreads(1)
    work(case, pipe)


def _solve(case, pipe):
    """Send the row of a case, then its certificate."""
    begin = time.process_time()
    try:
        result = ngcloth.solve(case.make(), **_settings(case))
    except Exception as error:
        text = re.sub(" at 0x[0-9a-f]+", "", " ".join(str(error).split()))
        pipe.send({"outcome": f"{type(error).__name__}: {text}", "certificate": ""})
        return
    seconds = time.process_time() - begin
    peak = peak_megabytes()
    extrema, bar = result.extrema, result.error["energy"]
    stretches = [*extrema["stretch1"], *extrema["stretch2"]]
    pipe.send(
        {
            "outcome": result.reason.name,
            "newton_steps": result.newton_iterations,
            "seconds": round(seconds, 3),
            "maxh": result.settings["maxh"],
            "triangles": result.state.space.mesh.ne,
            "energy": result.normalized_energy,
            "energy_bar": "" if bar is None else bar / result.scene.normalisation,
            "stretch_min": min(stretches),
            "stretch_max": max(stretches),
            "shear_max": extrema["shear"][1],
            "peak_megabytes": round(peak),
        }
    )
    begin = time.process_time()
    told = _certificate(result)
    seconds = round(time.process_time() - begin, 3)
    pipe.send({"certificate": told, "certificate_seconds": seconds})


def _certificate(result):
    """What the certificate finds wrong, wrong answers before coarse meshes, or "certified"."""
    try:
        faults = result.certificate().faults
    except Exception as error:
        return f"{type(error).__name__}: {error}"
    if not np.isfinite([result.normalized_energy, *np.ravel(list(result.extrema.values()))]).all():
        faults = ["not finite", *faults]
    return "; ".join(sorted(faults, key=lambda text: not text.startswith(WRONG))) or "certified"


def _settings(case):
    return {"maxh": 0.25} | case.settings


def on_finer_meshes(case):
    """The row of a case on the mesh that a solve has by default, or on a finer one.

    Meshes of half the size follow as long as it converges to what is not certified.
    """
    row = run(_with_maxh(case, None))
    for _ in range(HALVINGS):
        if not uncertified(row):
            break
        row = run(_with_maxh(case, row["maxh"] / 2))
    return row


def _with_maxh(case, maxh):
    return replace(case, settings=case.settings | {"maxh": maxh}, limit=FINE_MESH)


def for_finer_meshes(rows, chosen):
    """The rows, with their cases, that may lack no more than a mesh for their certificate."""
    return [
        (row, case)
        for row, case in zip(rows, chosen, strict=True)
        if uncertified(row) and not wrong(row) and not case.axis.startswith("maxh")
    ]


def peer_steps(case):
    """IPOPT's steps for a case, or why there are none."""
    row = run(replace(case, limit=PEER_SECONDS), _solve_by_peer)
    return row["ipopt_steps"] or row["outcome"]


def _solve_by_peer(case, pipe):
    from ipopt_peer import solve_with_ipopt

    try:
        scene, settings = case.make(), {"order": 3} | _settings(case)
        added = ngcloth.solve(scene, **settings).limit_points
        outcome = solve_with_ipopt(scene, added=added, **settings)
    except ngcloth.InputError as error:  # the start has no feasible multiple
        pipe.send({"ipopt_steps": f"refuses {error.argument}"})
        return
    solved = outcome.result.converged
    pipe.send({"ipopt_steps": outcome.result.newton_iterations if solved else outcome.status})


def for_peer(rows, chosen):
    """The rows, with their cases, of axes over which Newton steps grow, that IPOPT may solve.

    It goes to the optimum, whatever the `barrier_end`, and needs a limit to respect.
    """
    steep = [axis for axis, (low, high) in growth(rows).items() if high >= STEEP * low]
    return [
        (row, case)
        for row, case in zip(rows, chosen, strict=True)
        if case.axis in steep and "barrier_end" not in case.settings and case.make().constraints
    ]


# The page --------------------------------------------------------------------------------------


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
        + (f". *{_on_finer(row)}*" if row["finer_certificate"] else "")
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


def _on_finer(row):
    told = row["finer_certificate"]
    if row["finer_energy"] == "":
        return f"On a finer mesh: {told}"
    return f"At maxh {row['finer_maxh']:.3g}, {_with_bar(row, 'finer_energy')}: {told}"


def _with_bar(row, name="energy"):
    bar = row[f"{name}_bar"]
    return with_bar(f"{row[name]:.4e}", None if bar == "" else bar)


def _table_row(cells):
    return "| " + " | ".join(cells) + " |"


def main(folder=Path(__file__).parents[1] / "docs", pick=slice(None)):
    """Print a line for each case and the summary; write CSV and page to `folder`."""
    chosen = cases()[pick]
    rows = []
    for number, case in enumerate(chosen, 1):
        row = run(case)
        rows.append(row)
        print(
            f"{number:3d}/{len(chosen)}  {case.axis:42s} {case.value:>8s}"
            f"  {row['outcome'][:30]:11s}  {row['newton_steps']!s:>4s} steps"
            f"  {row['seconds']!s:>7s} s"
            f"  {row['certificate'].split(';')[0][:50]}",
            flush=True,
        )
    for row, case in for_finer_meshes(rows, chosen):
        finer = on_finer_meshes(case)
        row |= {f"finer_{name}": finer[name] for name in ("maxh", "energy", "energy_bar")}
        ended = "" if finer["outcome"] == "CONVERGED" else finer["outcome"] + "; "
        row["finer_certificate"] = ended + finer["certificate"]
        print(f"finer  {case.axis:42s} {case.value:>8s}  {_on_finer(row)}", flush=True)
    pairs = for_peer(rows, chosen) if importlib.util.find_spec("casadi") else []
    for number, (row, case) in enumerate(pairs, 1):
        row["ipopt_steps"] = peer_steps(case)
        print(
            f"{number:3d}/{len(pairs)}  {case.axis:42s} {case.value:>8s}"
            f"  {row['newton_steps']!s:>4s} steps, IPOPT {row['ipopt_steps']}",
            flush=True,
        )
    folder = Path(folder)
    folder.mkdir(exist_ok=True)
    with open(folder / "stability.csv", "w", newline="", encoding="utf-8") as file:
        writer = csv.DictWriter(file, COLUMNS)
        writer.writeheader()
        writer.writerows(rows)
    (folder / "stability.md").write_text(page(rows), encoding="utf-8")
    print("", *summary(rows), sep="\n")
    return rows


if __name__ == "__main__":
    main()
