"""solve(): mesh, loops, result. minima(): from several starts."""

from copy import copy
from dataclasses import replace

import numpy as np

from ..errors import InputError, SolveError, check_number
from ..problem.cost_size import normalised
from ..problem.scene import Scene
from ..result.alone import alone
from ..result.history import Reason
from ..result.result import Result
from ..result.save import fingerprint
from .barrier import unseen
from .chain import discretised, run, run_finer
from .checkpoint import Checkpoint
from .error import helped_by_meshes, with_error
from .meshes import COARSER, coarser_levels, make_sheets
from .recorder import Recorder
from .settings import KNOWN, checked_settings
from .size import check_memory, check_seconds

QUARTER_TURN = np.array([[0, 1], [-1, 0]])


@alone
def solve(
    scene,
    maxh=None,
    order=None,
    *,
    accuracy=None,
    multiplier_order=None,
    quadrature=None,
    barrier_end=None,
    tolerance=1e-6,
    max_steps=500,
    max_seconds=np.inf,
    schedule="adaptive",
    linearisation="closed form",
    inverse="sparsecholesky",
    log=None,
    callback=None,
    checkpoint=None,
    throw=False,
    **unknown,
):
    """Find the optimal patch of a scene.

    Parameters
    ----------
    scene : Scene
        What to cover with what.
    maxh : float, optional
        Largest element size in the parameter plane, for surfaces from files in space. By default
        2 % of the domain's diameter, or of that of a disk as large as the file's surface; 4 % in
        scenes with limits.
    order : int, optional
        Polynomial order of ψ, 1 to 14. Default 3 in scenes with limits, 2 in others.
    accuracy : float, optional
        In scenes with limits, the relative error of the energy, by the bar of `Result.error`, above
        which meshes of half the size follow, as long as steps, seconds and memory last; 1e-8 or
        more. The barrier ends as low as that asks for. The result is the last that converged, and
        its text says what was reached. By default there is one chain of meshes, down to `maxh`.
    multiplier_order : int, optional
        Polynomial order of the multiplier v of equilibrium, in scenes with constraints. By
        default that of ψ: with order 1, as in the paper, a layer one element wide along the rim
        goes unbalanced, and the energy converges only like h, from below.
    quadrature : int, optional
        Degree of the integration rules, at whose points inside and along the rim limits hold. By
        default ``2 * order + 2``, with constraints from order 5 on ``4 * order - 4``; at most 30.
    barrier_end : float, optional
        The barrier weight μ over kc at which a solve with constraints ends, 1e-12 to 1. By default
        1e-4 of the cost per area, where the barrier no longer shows; with the "paper" schedule
        1e-3.
    tolerance : float, optional
        The solve ends where the decrease of the Lagrangian still in sight is below this fraction
        of it; with the "paper" schedule where |∂t L|/(2π kc) is below it; for a cost without
        constraints where forces per area over kc are below it. Default 1e-6.
        `barrier_end` and this are relative to the size of a cost of the scene's own: kc is then
        what it gains where the energy of threads would gain kc.
    max_steps : int, optional
        Budget of Newton steps. Default 500.
    max_seconds : float, optional
        Budget of wall-clock time, checked after each step; the mesh counts. By default there is
        none.
    schedule : {"adaptive", "paper"}, optional
        The pseudo-time loop: one Newton step to each of ever longer steps, or the paper's steps
        of one size with a Newton solve in each; with constraints also its barrier, from μ = 10
        halved each time the flow comes to rest. The second is there for comparison.
    linearisation : {"closed form", "automatic"}, optional
        How scenes with limits are differentiated: by closed forms at the sampling points, or by
        NGSolve's automatic linearisation of the whole Lagrangian as one `SymbolicEnergy`, which is
        the definition, gives the same numbers, and takes several times as long. Scenes without
        limits always use the latter.
    inverse : {"sparsecholesky", "umfpack"}, optional
        NGSolve's direct solver. Default "sparsecholesky".
    log : callable, optional
        Called with one line of text per step, for instance ``print``. Silent by default.
    callback : callable, optional
        Called after each accepted step with a `Result` of that moment, good until the next step;
        its last row of history tells phase, energies and residual. The solve stops if it returns
        True.
    checkpoint : path, optional
        A file that is replaced after each accepted step. A solve that is called again with the
        same arguments after it was cut off goes on from there, and deletes it once converged.
        Where it cannot be written, a warning and the log say so, and the solve goes on.
    throw : bool, optional
        Raise `SolveError` instead of returning a result that has not converged.

    Returns
    -------
    Result
        With ``converged`` and ``reason``; the last good iterate where it has not converged.

    Raises
    ------
    InputError
        If a setting is unknown or out of bounds, the solve would be larger than the memory of the
        machine, or the checkpoint is another solve's; before any mesh is made.
    SolveError
        If the solve did not converge and `throw` is set.
    RuntimeError
        In a process forked from one that has meshed already.

    Notes
    -----
    Scenes with limits are solved on coarser meshes first. Each mesh is a refinement of the one
    before, with triangles of half the size, and each patch a start for the next. Their rows in the
    history are of phase "coarse", and a solve that stops there returns that patch, as its
    ``settings["maxh"]`` says. How patches change from mesh to mesh tells the error of the last. A
    solve that goes on from a checkpoint knows but the last mesh, and no error.

    Ctrl-C ends the solve with ``Reason.INTERRUPTED`` and the last accepted step.

    NGSolve bears one solve at a time in a process: solves in several threads wait for each other
    (a callback must not wait for another thread's solve), and a process forked after a solve
    cannot solve. To solve several scenes at a time, start processes by "spawn", as with
    ``ProcessPoolExecutor(mp_context=multiprocessing.get_context("spawn"))``; results and errors
    come back by pickle, scenes go there if their charts, laws and limits are of a module.
    """
    if not isinstance(scene, Scene):
        raise InputError("scene", scene, "an ngcloth.Scene")
    for name, value in unknown.items():
        raise InputError(name, value, f"unknown setting; there are {KNOWN}")
    for name, function in {"log": log, "callback": callback}.items():
        if not (function is None or callable(function)):
            raise InputError(name, function, "a callable of one argument, or None")
    if not (isinstance(max_seconds, float) and max_seconds == np.inf):
        max_seconds = check_number("max_seconds", max_seconds, 0, open_low=True)
    settings = checked_settings(
        scene,
        maxh=maxh,
        order=order,
        accuracy=accuracy,
        multiplier_order=multiplier_order,
        quadrature=quadrature,
        barrier_end=barrier_end,
        tolerance=tolerance,
        max_steps=max_steps,
        schedule=schedule,
        linearisation=linearisation,
        inverse=inverse,
    )
    solved, size = normalised(scene)
    if solved.net_choice != solved.tie_break:
        solved = copy(solved)
        object.__setattr__(solved, "tie_break", scene.net_choice)
    check_memory(scene, settings)
    coarsest = settings["maxh"] * COARSER ** coarser_levels(scene, settings["maxh"])
    check_seconds(scene, coarsest, max_seconds)
    if checkpoint is not None:
        identity = {name: array.tolist() for name, array in fingerprint(scene).items()}
        identity |= {name: value for name, value in settings.items() if name != "max_steps"}
        checkpoint = Checkpoint(checkpoint, identity)

    def outcome(reason):
        problem = recorder.problem or whole
        known = problem.settings
        if "barrier_end" in known and known["barrier_end"] is None:
            known = known | {"barrier_end": float(unseen(problem))}
        return Result(
            scene=scene,
            state=problem.state,
            reason=reason,
            cost=size * problem.cost(),
            newton_iterations=recorder.newton,
            seconds=recorder.seconds,
            history=list(recorder.rows),
            settings=known,
            sheet=problem.sheet,
            limit_points=problem.limit_points,
        )

    def asks_to_stop():
        said = callback(outcome(Reason.RUNNING))
        return isinstance(said, bool | np.bool_) and bool(said)

    recorder = Recorder(
        size * scene.copies / scene.normalisation * scene.fabric.stiffness,
        max_steps,
        log,
        max_seconds,
        callback and asks_to_stop,
        checkpoint,
    )
    *coarser, sheet = make_sheets(scene, settings["maxh"], settings["order"])
    whole, levels = discretised(solved, sheet, settings), []

    def level():
        """Keep what was found on a mesh; the result so far."""
        levels.append(outcome(Reason.CONVERGED))
        return with_error(levels)

    try:
        recorder.resume(whole)
        reason = run(whole, recorder, coarser, level)
        result = level() if reason is Reason.CONVERGED else outcome(reason)
        while result.converged and result.falls_short and helped_by_meshes(result):
            if not run_finer(recorder):
                break
            result = level()
    except KeyboardInterrupt:
        if not recorder.restore():
            raise
        result = outcome(Reason.INTERRUPTED)
    if result.converged and not result.unfolded:
        result = replace(result, reason=Reason.FOLDED)
    if result.converged:
        recorder.forget()
    if log:
        log(result.why)
    if throw and not result.converged:
        raise SolveError(result)
    return result


def minima(scene, starts, **settings):
    """Solve a scene from several starts, and keep the minima that differ.

    Parameters
    ----------
    scene : Scene
        What to cover with what; its own start is not used.
    starts : sequence
        Values for `Scene.start`.
    **settings
        For `solve`, whose notes tell what threads and processes may do.

    Returns
    -------
    list of Result
        Those that converged first, by energy. Of results that agree to 1e-3 in energy and to
        1e-2 of the size of the patch in outline, the first is kept. A patch that is turned by a
        right angle, its warp in the place of its weft, or by two, is the same.
    """
    if not isinstance(scene, Scene):
        raise InputError("scene", scene, "an ngcloth.Scene")
    try:
        starts = list(starts)
    except TypeError:
        raise InputError("starts", starts, "a sequence of starts") from None
    found = []
    for start in starts:
        result = solve(replace(scene, start=start), **settings)
        if not any(_same_minimum(result, other) for other in found):
            found.append(result)
    return sorted(found, key=lambda result: (not result.converged, result.energy))


def _same_minimum(one, other):
    if one.converged != other.converged:
        return False
    near = abs(one.energy - other.energy) <= 1e-3 * max(one.energy, other.energy)
    # Up to a translation, which without symmetry is free.
    here, there = (
        outline - outline.mean(axis=0) for outline in (one.outline(100), other.outline(100))
    )
    turned = (there @ np.linalg.matrix_power(QUARTER_TURN, n) for n in range(4))
    return near and any(np.abs(here - x).max() <= 1e-2 * np.abs(here).max() for x in turned)
