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
import re
import resource
import signal
import time
from dataclasses import replace
from pathlib import Path

import ngsolve as ngs
import numpy as np
from measuring import peak_megabytes
from stability_cases import FINE_MESH, cases
from stability_page import STEEP, WRONG, growth, on_finer, page, summary, uncertified, wrong

import ngcloth

PATIENCE = 5  # a row that computes nothing is ended after so many times its limit
COLUMNS = (
    "axis value expected outcome newton_steps seconds triangles energy energy_bar stretch_min "
    "stretch_max shear_max certificate certificate_seconds peak_megabytes ipopt_steps maxh "
    "finer_maxh finer_energy finer_energy_bar finer_certificate"
).split()
HALVINGS = 2  # at most, of the mesh by default, for a row that is not certified
PEER_SECONDS = 300  # limit of a row for IPOPT


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
        print(f"finer  {case.axis:42s} {case.value:>8s}  {on_finer(row)}", flush=True)
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
