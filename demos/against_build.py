"""CPU seconds of this build over those of another commit, over the scenes of the run-time report.

Each build solves in processes of its own, that import ngcloth from its own tree: this one as it
lies there, the other as committed. Both are alive at the same time and solve in turns, so that what
else the machine does hits both; a round of new processes follows another, and the best of them
counts. Seconds are CPU seconds of one thread, mesh and set-up included, imports not.

    python demos/against_build.py 9dded49               # a quarter of an hour
    python demos/against_build.py 9dded49 --quick       # two coarse meshes of each scene
    python demos/against_build.py 9dded49 --certificate # times result.certificate() as well
    python demos/against_build.py 9dded49 --default     # likewise, with default settings alone

Steps in brackets: not converged. Energies are E/(2π kc).
"""

import io
import json
import os
import subprocess
import sys
import tarfile
import tempfile
from contextlib import contextmanager
from pathlib import Path

from run_time_tables import CHEBYSHEV, DEFAULT, WEAK, markdown
from timed_solves import MORE, SCENES, TURNED
from work_precision import MESHES, chebyshev_jobs, jobs

ROOT = Path(__file__).resolve().parents[1]
SHORT = 10  # seconds
ROUNDS = 3  # of solves shorter than `SHORT` seconds; others are solved once
QUICK = 2  # meshes of a scene


def solves(quick=False):
    """The report's solves of order 2, with settings that all builds know, as (scene, settings)."""
    report = {CHEBYSHEV: chebyshev_jobs()}
    report |= {scene: jobs(scene, sizes) for scene, sizes in MESHES.items()}
    found = []
    for scene, those in report.items():
        curve = DEFAULT if scene == CHEBYSHEV else WEAK
        own = [settings for name, settings in those if name == curve]
        own.sort(key=lambda settings: -settings["maxh"])
        found += [(scene, settings) for settings in own[: QUICK if quick else None]]
    return found


def default_solves():
    """One solve with default settings of each scene, as (scene, settings)."""
    return [(scene, {}) for scene in SCENES | MORE if scene not in TURNED]


def extract(commit, folder):
    """Write the tree of a commit to a folder."""
    archive = ["git", "-C", str(ROOT), "archive", "--format=tar", commit]
    packed = subprocess.run(archive, stdout=subprocess.PIPE, check=True).stdout
    with tarfile.open(fileobj=io.BytesIO(packed)) as tree:
        tree.extractall(folder, filter="data")


@contextmanager
def build(tree):
    """A function that has the ngcloth of a tree solve: (scene, settings, certificate) to answer."""
    tree = Path(tree).resolve()
    paths = [str(tree), *filter(None, [os.environ.get("PYTHONPATH")])]
    one_thread = {"OPENBLAS_NUM_THREADS": "1", "OMP_NUM_THREADS": "1"}
    with subprocess.Popen(
        [sys.executable, str(ROOT / "demos" / "timed_solves.py")],
        env=os.environ | one_thread | {"PYTHONPATH": os.pathsep.join(paths)},
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
    ) as process:

        def told():
            line = process.stdout.readline()
            if not line:
                raise RuntimeError(f"the build of {tree} ended with {process.wait()}")
            return json.loads(line)

        def solve(scene, settings, certificate):
            question = {"scene": scene, "settings": settings, "certificate": certificate}
            print(json.dumps(question), file=process.stdin, flush=True)
            return told()

        found = Path(told())
        if not found.is_relative_to(tree):
            raise RuntimeError(f"{tree} was to be timed, and {found} was imported")
        yield solve


def compare(trees, wanted, certificate=False):
    """Answers of both trees to each solve, [([{...}, ...], [{...}, ...]), ...]."""
    rows = [([], []) for _ in wanted]
    for number in range(ROUNDS):
        print(f"round {number + 1} of {ROUNDS}", file=sys.stderr)
        with build(trees[0]) as one, build(trees[1]) as other:
            for row, (scene, settings) in zip(rows, wanted, strict=True):
                if number == 0 or max(best(runs)["total"] for runs in row) < SHORT:
                    for runs, solve in zip(row, (one, other), strict=True):
                        runs.append(solve(scene, settings, certificate))
    return rows


def best(runs):
    """Steps, energy and reason of the first run, the least seconds of all."""
    seconds = {name: min(run[name] for run in runs) for name in ("solve", "certificate")}
    return runs[0] | seconds | {"total": sum(seconds.values())}


def table(names, wanted, rows, certificate=False):
    """Lines of the table, the last one the total."""
    timed = ("solve", "certificate", "total") if certificate else ("solve",)
    found = [[best(runs) for runs in row] for row in rows]
    lines = []
    for (scene, settings), both in zip(wanted, found, strict=True):
        line = {"scene": scene, "settings": ", ".join(f"{k} {v:g}" for k, v in settings.items())}
        line |= {f"steps, {name}": _steps(one) for name, one in zip(names, both, strict=True)}
        line |= {f"E, {n}": f"{one['energy']:.6g}" for n, one in zip(names, both, strict=True)}
        lines.append(line | _seconds(names, both, timed))
    total = [{part: sum(both[n][part] for both in found) for part in timed} for n in range(2)]
    lines.append(dict.fromkeys(lines[0], "") | {"scene": "total"} | _seconds(names, total, timed))
    return lines


def _steps(one):
    return str(one["steps"]) if one["reason"] == "CONVERGED" else f"({one['steps']})"


def _seconds(names, both, timed):
    """Cells of seconds and their ratio, the second build's over the first's."""
    cells = {}
    for part in timed:
        seconds = [one[part] for one in both]
        cells |= {f"{part}, s, {name}": f"{s:.3f}" for name, s in zip(names, seconds, strict=True)}
        cells[f"{part}, ratio"] = f"{seconds[1] / seconds[0]:.2f}"
    if "certificate" in timed:
        cells["certificate over solve"] = f"{both[1]['certificate'] / both[1]['solve']:.2f}"
    return cells


def main(commit, *options):
    """Print the table of this build against a commit."""
    if not set(options) <= {"--quick", "--certificate", "--default"}:
        sys.exit(__doc__)
    default = "--default" in options
    certificate = default or "--certificate" in options
    wanted = default_solves() if default else solves("--quick" in options)
    with tempfile.TemporaryDirectory() as folder:
        extract(commit, folder)
        rows = compare((folder, ROOT), wanted, certificate)
    print(markdown(table((commit, "here"), wanted, rows, certificate)))


if __name__ == "__main__":
    if len(sys.argv) < 2:
        sys.exit(__doc__)
    main(*sys.argv[1:])
