"""How far the solver can be pushed: stiff, extreme and badly started scenes, one row each.

Each row changes one thing of a scene that is easy otherwise: the stiffnesses, the weight at which
the barrier ends, the limits, the surface, the chart, the mesh, the order or the start. It says how
the solve ended, what it cost, and what the certificate (`ngcloth.verify`) makes of the patch. A row
runs in a process of its own with a limit on its time, so that a crash or a hang is a row too.

Run from the repository (Linux or macOS):

    python demos/stability.py            # ten minutes; docs/stability.csv and docs/stability.md
"""

import csv
import multiprocessing
import platform
import re
import resource
import signal
import sys
import time
from dataclasses import dataclass, field
from pathlib import Path

import ngsolve as ngs
import numpy as np

import ngcloth
from ngcloth import Disk, Elongation, Net, Rectangle, Scene, ShearLimit, Surface

SECONDS = 60  # limit of a row
FINE_MESH = 120
PATIENCE = 5  # a row that computes nothing is ended after so many times its limit
COLUMNS = (
    "axis value expected outcome newton_steps seconds triangles energy stretch_min stretch_max "
    "shear_max certificate peak_megabytes"
).split()
WRONG = ("folded", "not stationary", "the rim meets itself", "not finite")
SOLVES, ENDS, REFUSED = "solves", "ends with its reason", "is refused"


@dataclass(frozen=True)
class Case:
    """One row: a scene, made when it is run, and the settings to solve it with.

    Attributes
    ----------
    axis, value : str
        What is changed, in which scene, and to what.
    make : callable
        Returns the `Scene`.
    settings : dict
        Of `ngcloth.solve`.
    expected : str
        `SOLVES` where the problem is well posed, `ENDS` where it may have no solution, `REFUSED`
        where the input is bad.
    limit : int
        CPU seconds, certificate included, after which the row is ended.
    """

    axis: str
    value: str
    make: callable
    settings: dict = field(default_factory=dict)
    expected: str = SOLVES
    limit: int = SECONDS


# Scenes -----------------------------------------------------------------------------------------


def stereographic(r=1.0, scale=(1, 1, 1)):
    """A sphere's cap, seen from the north pole, its coordinates multiplied by `scale`."""

    def chart(x, y):
        square = r**2 * (x**2 + y**2)
        return [
            s * q / (1 + square)
            for s, q in zip(scale, (2 * r * x, 2 * r * y, square - 1), strict=True)
        ]

    return Surface(chart, Disk(), side=-1)


def catenoid(height=1.0, stretch=1.0):
    """Half a catenoid; the parameter θ1 runs `stretch` times as far as the angle."""

    def chart(x, y):
        return ngs.cosh(y) * ngs.cos(x / stretch), ngs.cosh(y) * ngs.sin(x / stretch), y

    return Surface(chart, Rectangle((0, stretch * np.pi), (-height, height)))


def bump(height, width=0.3):
    """A plane disk with a bell in the middle."""
    return Surface(lambda x, y: (x, y, height * ngs.exp(-(x * x + y * y) / width**2)), Disk())


def paraboloid(shear):
    """A cap on sheared coordinates: no orthogonal chart, and stretched triangles on the surface."""

    def chart(x, y):
        u = x + shear * y
        return u, y, -0.3 * (u * u + y * y) / (1 + shear)

    return Surface(chart, Disk())


def cloth(surface, ks=1.0, kc=1.0, shear_limit=None, symmetric=True, **more):
    """A scene that keeps threads taut unless it is a Chebyshev net."""
    limits = () if ks == 0 and shear_limit is None else (Elongation(),)
    if shear_limit is not None:
        limits += (ShearLimit(shear_limit),)
    return Scene(surface, Net(kc=kc, ks=ks), limits, symmetric=symmetric, name="stability", **more)


def dome(**more):
    """The unit hemisphere, ks = kc."""
    return cloth(stereographic(), **more)


def turned(surface, degrees, **more):
    """A start that is turned by an angle, and no symmetry."""
    c, s = np.cos(np.radians(degrees)), np.sin(np.radians(degrees))

    def start(x, y):
        return 0.5 * (c * x - s * y), 0.5 * (s * x + c * y)

    return cloth(surface, symmetric=False, start=start, **more)


def noisy(amplitude, ks):
    """A start with waves of random phase and direction, the sum of their slopes `amplitude`."""
    draw = np.random.default_rng(1)
    waves = [(draw.uniform(2, 12, 2), *draw.uniform(0, 2 * np.pi, 2)) for _ in range(6)]

    def start(x, y):
        def shift(column):
            return sum(
                amplitude / 6 / np.linalg.norm(k) * ngs.sin(k[0] * x + k[1] * y + wave[column])
                for k, *wave in waves
            )

        return 0.7 * (x + shift(0)), 0.7 * (y + shift(1))

    return cloth(stereographic(), ks=ks, symmetric=False, start=start)


# The table --------------------------------------------------------------------------------------


def cases():
    """All cases, axis by axis."""
    return [
        case
        for axis in (
            _stiffness,
            _barriers,
            _portions,
            _surfaces,
            _charts,
            _meshes,
            _orders,
            _starts,
        )
        for case in axis()
    ]


def _stiffness():
    for ks in (0, 1e-6, 1e-3, 1, 1e3, 1e6):
        yield Case("ks/kc, hemisphere", f"{ks:g}", lambda ks=ks: ngcloth.scenes.hemisphere(ks))
        yield Case("ks/kc, hemicatenoid", f"{ks:g}", lambda ks=ks: ngcloth.scenes.hemicatenoid(ks))
    for ratio in 10.0 ** np.arange(-4, 5):
        kc = (ratio**0.5, ratio**-0.5)
        yield Case("kc1/kc2, ks = 1", f"{ratio:g}", lambda kc=kc: dome(kc=kc))
        if ratio != 1:
            yield Case("kc1/kc2, Chebyshev", f"{ratio:g}", lambda kc=kc: dome(kc=kc, ks=0))
    for scale in 10.0 ** np.arange(-9, 10, 3):
        yield Case("scale of kc = ks", f"{scale:g}", lambda s=scale: dome(kc=s, ks=s))
        if scale != 1:
            yield Case("scale of kc, Chebyshev", f"{scale:g}", lambda s=scale: dome(kc=s, ks=0))


def _barriers():
    for ks in (1.0, 100.0):
        for end in 10.0 ** -np.arange(1, 9):
            yield Case(
                f"barrier_end, hemisphere ks = {ks:g}",
                f"{end:g}",
                lambda ks=ks: dome(ks=ks),
                {"barrier_end": float(end)},
            )
    for maximum in (0.05, 0.5, 0.99, 0.9999):
        for ks in (0.0, 1.0):
            yield Case(
                f"γmax, hemisphere ks = {ks:g}",
                f"{maximum:g}",
                lambda m=maximum, ks=ks: dome(ks=ks, shear_limit=m),
            )


def _portions():
    for portion in (0.01, 0.05, 0.1, 0.3, 0.5, 0.6, 0.7, 0.8, 0.85, 0.9, 0.95, 0.97, 0.99):
        yield Case(
            "portion of the sphere, γmax = cos π/6",
            f"{portion:g}",
            lambda p=portion: ngcloth.scenes.sphere(p, shear_limit=np.cos(np.pi / 6)),
        )
    for portion in (0.01, 0.1, 0.3, 0.5, 0.7, 0.8, 0.83, 0.842, 0.843, 0.85, 0.9, 0.99):
        yield Case(
            "portion of the sphere, Chebyshev",
            f"{portion:g}",
            lambda p=portion: ngcloth.scenes.sphere(p),
            {"maxh": 0.1},
            # Threads lie on one line from p* = 0.8424 on.
            expected=SOLVES if portion <= 0.83 else ENDS,
        )


def _surfaces():
    for height in (0.1, 0.3, 1.0, 1.5, 2.0, 2.5, 3.0):
        for ks in (0.0, 1.0):
            yield Case(
                f"height of the hemicatenoid, ks = {ks:g}",
                f"{height:g}",
                lambda h=height, ks=ks: cloth(catenoid(h), ks=ks, tie_break=0.0 if ks else 1e-8),
            )
    for scale in (1e-6, 1e-3, 1e3, 1e6):
        for ks in (0.0, 1.0):
            yield Case(
                f"scale of the hemisphere, ks = {ks:g}",
                f"{scale:g}",
                lambda s=scale, ks=ks: cloth(stereographic(scale=(s, s, s)), ks=ks),
            )


def _charts():
    for axes in ((1, 1, 10), (1, 1, 0.1), (1, 10, 1)):
        for ks in (0.0, 1.0):
            yield Case(
                f"half an ellipsoid, ks = {ks:g}",
                ":".join(f"{a:g}" for a in axes),
                lambda axes=axes, ks=ks: cloth(stereographic(scale=axes), ks=ks),
                {"maxh": 0.15},
                SOLVES if ks or axes == (1, 1, 0.1) else ENDS,
            )
    yield Case(
        "half an ellipsoid, ks = 1",
        "1:1:10, maxh 0.25",
        lambda: cloth(stereographic(scale=(1, 1, 10))),
    )
    for height in (0.1, 0.3, 1.0):
        for ks in (0.0, 1.0):
            yield Case(
                f"bump on a plane, ks = {ks:g}",
                f"{height:g}",
                lambda h=height, ks=ks: cloth(bump(h), ks=ks),
                {"maxh": 0.12},
                SOLVES if ks or height < 0.3 else ENDS,
            )
    for stretch in (0.01, 0.1, 10, 100, 1000):
        yield Case(
            "stretched chart, ks = 1",
            f"{stretch:g}",
            lambda s=stretch: cloth(catenoid(stretch=s)),
            {"maxh": 0.1 * max(1.0, stretch)},
        )
    for shear in (1, 3, 10):
        yield Case(
            "sheared chart, ks = 1",
            f"{shear:g}",
            lambda s=shear: cloth(paraboloid(s), symmetric=False),
        )


def _meshes():
    for maxh in (2.0, 0.5, 0.3, 0.2, 0.1, 0.05, 0.03):
        yield Case("maxh, hemisphere ks = 1", f"{maxh:g}", dome, {"maxh": maxh}, limit=FINE_MESH)
    for maxh in (2.0, 0.5, 0.2, 0.1, 0.05, 0.02, 0.0095):
        yield Case(
            "maxh, Chebyshev", f"{maxh:g}", lambda: dome(ks=0), {"maxh": maxh}, limit=FINE_MESH
        )


def _orders():
    for order in range(1, 9):
        yield Case("order, hemisphere ks = 1", f"{order}", dome, {"order": order, "maxh": 0.3})
        yield Case(
            "order, Chebyshev", f"{order}", lambda: dome(ks=0), {"order": order, "maxh": 0.3}
        )


def _starts():
    for scale in (0.01, 0.1, 0.3, 1, 3, 10):
        for ks in (0.0, 1.0):
            yield Case(
                f"scale of the start, ks = {ks:g}",
                f"{scale:g}",
                lambda s=scale, ks=ks: dome(ks=ks, start=(s, s)),
            )
    for degrees in (0, 15, 30, 45, 60, 90):
        yield Case(
            "turn of the start, hemisphere",
            f"{degrees}°",
            lambda d=degrees: turned(stereographic(), d),
        )
        yield Case(
            "turn of the start, hemicatenoid",
            f"{degrees}°",
            lambda d=degrees: turned(catenoid(), d),
        )
    for amplitude in (0.03, 0.1, 0.3, 0.9):
        for ks in (0.0, 1.0):
            yield Case(
                f"noise on the start, ks = {ks:g}",
                f"{amplitude:g}",
                lambda a=amplitude, ks=ks: noisy(a, ks),
            )
    sheared = {"start": lambda x, y: (0.5 * (x + y), 0.5 * y), "symmetric": False}
    for value, more in {
        "(0.1, 2), one thread slack": {"start": (0.1, 2)},
        "(-0.5, -0.5), turned by 180°": {"start": (-0.5, -0.5)},
        "sheared to γ = 0.71, γmax = 0.8": sheared | {"shear_limit": 0.8},
    }.items():
        yield Case("odd starts", value, lambda m=more: dome(**m))
    for value, more in {
        "sheared to γ = 0.71, γmax = 0.5": sheared | {"shear_limit": 0.5},
        "(-0.5, 0.5), inverted": {"start": (-0.5, 0.5)},
        "inverted on one side": {"start": lambda x, y: (x + x * x, y), "symmetric": False},
        "NaN on one side": {"start": lambda x, y: (ngs.sqrt(x), y), "symmetric": False},
    }.items():
        yield Case("bad starts", value, lambda m=more: dome(**m), expected=REFUSED)


# One row ----------------------------------------------------------------------------------------


def run(case):
    """The row of a case, solved in a process of its own that is ended at the limit."""
    fork = multiprocessing.get_context("fork")
    here, there = fork.Pipe(duplex=False)
    process = fork.Process(target=_work, args=(case, there))
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


def _work(case, pipe):
    """Send the row of a case, then its certificate."""
    resource.setrlimit(resource.RLIMIT_CPU, (case.limit, case.limit + 5))
    ngs.SetNumThreads(1)
    begin = time.process_time()
    try:
        result = ngcloth.solve(case.make(), **({"maxh": 0.25} | case.settings))
    except Exception as error:
        text = re.sub(" at 0x[0-9a-f]+", "", " ".join(str(error).split()))
        pipe.send({"outcome": f"{type(error).__name__}: {text}", "certificate": ""})
        return
    seconds = time.process_time() - begin
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    extrema = result.extrema
    stretches = [*extrema["stretch1"], *extrema["stretch2"]]
    pipe.send(
        {
            "outcome": result.reason.name,
            "newton_steps": result.newton_iterations,
            "seconds": round(seconds, 3),
            "triangles": result.state.space.mesh.ne,
            "energy": result.normalized_energy,
            "stretch_min": min(stretches),
            "stretch_max": max(stretches),
            "shear_max": extrema["shear"][1],
            "peak_megabytes": round(peak / (2**20 if sys.platform == "darwin" else 2**10)),
        }
    )
    pipe.send({"certificate": _certificate(result)})


def _certificate(result):
    """What the certificate finds wrong, wrong answers before coarse meshes, or "certified"."""
    try:
        faults = result.certificate().faults
    except Exception as error:
        return f"{type(error).__name__}: {error}"
    if not np.isfinite([result.normalized_energy, *np.ravel(list(result.extrema.values()))]).all():
        faults = ["not finite", *faults]
    return "; ".join(sorted(faults, key=lambda text: not text.startswith(WRONG))) or "certified"


# The page --------------------------------------------------------------------------------------

# Why a row fails, by axis and value. "Probably" marks what has not been tested.
_FOLDED_ELLIPSOID = (
    "Triangles are too coarse for the metric. J > 0 is asked at the integration points only, and "
    "the cloth folds between them; some runs end there, others use up their steps or time."
)
_SLOW = "It needs more steps, or steps of more seconds, than the limit of the row allows."
EXPLANATIONS = {
    ("ks/kc, hemicatenoid", "1e+06"): (
        "The barrier's weight is relative to kc while forces are a million times that: probably "
        "the tests for the next barrier are below the round-off of the forces."
    ),
    ("kc1/kc2, Chebyshev", "10000"): (
        "The certificate finds the patch stationary. Probably Gauss-Newton converges linearly "
        "where the mesh leaves an energy, more slowly the more unequal the threads, until its "
        "steps are below round-off."
    ),
    ("barrier_end, hemisphere ks = 100", "1e-07"): (
        "The energy agrees with that of 1e-6 to 8 digits. Probably the stopping test, absolute in "
        "units of kc, asks for less than the round-off of a stress of 100 kc."
    ),
    ("barrier_end, hemisphere ks = 100", "1e-08"): "As at 1e-7.",
    ("portion of the sphere, γmax = cos π/6", "0.99"): (
        "The radius of the chart is 10: the metric varies ten-thousandfold over a few triangles, "
        "and the last iterate is folded between the integration points. The reason is right in "
        "that the mesh is too coarse."
    ),
    ("height of the hemicatenoid, ks = 1", "3"): (
        "The patch is a minimum, but its ends overlap in the plane: nothing in the problem forbids "
        "it, and it cannot be cut from one piece. Only the certificate tells."
    ),
    ("half an ellipsoid, ks = 1", "1:1:10"): _FOLDED_ELLIPSOID,
    ("half an ellipsoid, ks = 1", "1:1:10, maxh 0.25"): _FOLDED_ELLIPSOID,
    ("half an ellipsoid, ks = 1", "1:1:0.1"): _FOLDED_ELLIPSOID,
    ("half an ellipsoid, ks = 1", "1:10:1"): _SLOW,
    ("maxh, hemisphere ks = 1", "0.03"): _SLOW,
}


def wrong(row):
    """Whether a row says "converged" of an answer that its certificate finds wrong."""
    return row["outcome"] == "CONVERGED" and row["certificate"].startswith(WRONG)


def failed(row):
    """Whether a row does not do what is expected of it."""
    if row["expected"] == REFUSED:
        return not row["outcome"].startswith("InputError")
    if row["expected"] == ENDS:
        return wrong(row) or not row["outcome"].isupper()
    return wrong(row) or row["outcome"] != "CONVERGED"


def growth(rows):
    """Least and greatest Newton count of the converged rows of each axis: {axis: (min, max)}."""
    counts = {}
    for row in rows:
        if row["expected"] == SOLVES and row["outcome"] == "CONVERGED":
            counts.setdefault(row["axis"], []).append(row["newton_steps"])
    return {axis: (min(steps), max(steps)) for axis, steps in counts.items()}


def summary(rows):
    """The table in a few sentences."""
    posed = [row for row in rows if row["expected"] == SOLVES]
    ill = [row for row in rows if row["expected"] == ENDS]
    bad = [row for row in rows if row["expected"] == REFUSED]
    solved = [row for row in posed if row["outcome"] == "CONVERGED"]
    certified = [row for row in solved if row["certificate"] == "certified"]
    steps = growth(rows)
    steep = sum(high >= 3 * low for low, high in steps.values())
    return [
        f"{len(rows)} rows, {len(posed)} of them well posed: {len(solved)} converge "
        f"({100 * len(solved) / max(len(posed), 1):.1f} %).",
        f"Of those {len(certified)} are certified on their coarse meshes, and "
        f"{sum(map(wrong, rows))} wrong by their certificates (folded, not stationary or "
        "overlapping); the certificate's other remarks, limits missed between the points at which "
        "they are imposed and forces that the mesh cannot balance, fade as meshes get finer.",
        f"{sum(not failed(row) for row in ill)} of {len(ill)} rows that may have no solution end "
        f"with a reason, {sum(not failed(row) for row in bad)} of {len(bad)} bad inputs are "
        "refused.",
        f"Newton counts grow by less than 3 over {len(steps) - steep} of {len(steps)} axes.",
    ]


def page(rows):
    """The Markdown page."""
    lines = [
        "# Stiff and extreme cases",
        "",
        "Written by `python demos/stability.py`, with "
        f"ngcloth {ngcloth.__version__}, ngsolve {ngs.__version__}, "
        f"Python {platform.python_version()}; all columns are in [stability.csv](stability.csv). "
        "Seconds are CPU seconds of one thread, peak memory is that of a process that ran "
        "nothing else. Scenes are hemispheres with ks = kc where no other is named, maxh 0.25.",
        "",
        "## Summary",
        "",
        *(f"- {line}" for line in summary(rows)),
        "",
        "## Failures",
        "",
    ]
    failures = [row for row in rows if failed(row)]
    for row in failures:
        why = EXPLANATIONS.get((row["axis"], row["value"]), "Not explained yet.")
        lines.append(f"- **{row['axis']}: {row['value']}**: {_outcome(row)}. {why}")
    lines += ["None." if not failures else "", "", "## Newton steps over each axis", ""]
    lines += ["| axis | least | greatest | growth |", "|---|---|---|---|"]
    lines += [
        f"| {axis} | {low} | {high} | {high / low:.1f} |"
        for axis, (low, high) in growth(rows).items()
    ]
    lines += ["", "## All rows", ""]
    head = "value ends Newton seconds triangles E/2πkc λ \\|γ\\| MB certificate".split()
    for axis in dict.fromkeys(row["axis"] for row in rows):
        lines += [f"### {axis}", "", _table_row(head), _table_row(["---"] * len(head))]
        lines += [_table_row(_cells(row)) for row in rows if row["axis"] == axis]
        lines.append("")
    return "\n".join(lines)


def _outcome(row):
    text = row["outcome"]
    return f"{text}, but {row['certificate'].split(';')[0]}" if wrong(row) else text


def _cells(row):
    if row["energy"] == "":
        return [row["value"], row["outcome"], *[""] * 8]
    return [
        row["value"],
        row["outcome"],
        str(row["newton_steps"]),
        f"{row['seconds']:.2f}",
        str(row["triangles"]),
        f"{row['energy']:.4e}",
        f"{row['stretch_min']:.3f} … {row['stretch_max']:.3f}",
        f"{row['shear_max']:.3f}",
        str(row["peak_megabytes"]),
        row["certificate"].split(";")[0],
    ]


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
