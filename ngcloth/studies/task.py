"""One case of a study, solved where an executor runs it, and kept before anybody is told."""

from dataclasses import asdict, replace
from time import perf_counter

import ngsolve as ngs

from ..errors import InputError
from ..problem.scene import Scene
from ..result.alone import alone
from ..result.history import Reason
from ..solver.size import estimated_memory
from ..solver.solve import solve
from .store import BARS, FIELDS, OUTPUTS, RESULT, Store, strict
from .warm import warmed

NOT_YET = "not solved yet"


@alone
def solve_case(make_scene, case, settings, folder, key, neighbours=()):
    """Solve one case with one thread, and write it to the folder of the study.

    Parameters
    ----------
    make_scene : callable
        ``make_scene(**case)`` is the scene.
    case, settings : dict
        Arguments of `make_scene`, and of `solve`.
    folder : str
        Of the study.
    key : str
        Under which the case is kept.
    neighbours : sequence of str
        Keys of cases to start from, if they are solved by now, the nearest first.

    Returns
    -------
    dict
        The row of the table, `OUTPUTS`. A case that raises has its error as its reason.
    """
    store, begun = Store(folder), perf_counter()
    record = store.record(key)
    if record and record["finished"]:  # by another master of the same study
        return record["row"]
    threads = ngs.GetNumThreads()
    ngs.SetNumThreads(1)
    try:
        with store.workshop(key) as place:
            told = {"case": case, "settings": settings, "finished": False}
            try:
                result = _solved(make_scene, case, settings, store, neighbours)
                row, told["certificate"] = _outcome(result)
                result.save(place / RESULT)
                told["finished"] = result.reason is not Reason.INTERRUPTED
            except (Exception, SystemExit) as error:  # a script that exits ends its case alone
                row = failure(f"{type(error).__name__}: {error}")
            row["seconds"] = perf_counter() - begun
            store.write_record(place, key, told | {"row": row})
    finally:
        ngs.SetNumThreads(threads)
    return strict(row)


def failure(why):
    """The row of a case that has no result."""
    return dict.fromkeys(OUTPUTS) | {"converged": False, "reason": why, "certified": False}


def _solved(make_scene, case, settings, store, neighbours):
    scene = make_scene(**case)
    if not isinstance(scene, Scene):
        raise InputError("what make_scene returns", type(scene), "an ngcloth.Scene")
    warm = warmed(scene, store, neighbours)
    if warm:
        result = solve(warm, **settings)
        if result.converged:
            return replace(result, scene=scene)  # as it is made again to load it
    return solve(scene, **settings)


def _outcome(result):
    """The row of a result, and its certificate as a dict."""
    bars, certificate = result.error, result.certificate()
    row = {
        "converged": result.converged,
        "reason": result.why,
        "energy": result.energy,
        "normalized_energy": result.normalized_energy,
        "area": result.area,
        **{f"{name}_error": bars.get(name) for name in BARS},
        "steps": result.newton_iterations,
        "certified": result.converged and certificate.certified,
        "faults": "; ".join(certificate.faults),
        "memory": estimated_memory(result.scene, result.settings),
    }
    for name in FIELDS:
        row[f"{name}_min"], row[f"{name}_max"] = result.extrema[name]
    return dict.fromkeys(OUTPUTS) | row, asdict(certificate)
