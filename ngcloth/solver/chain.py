"""One scene on ever finer meshes: each patch is a start for the next."""

import numpy as np

from ..energy.lagrangian import Lagrangian
from ..errors import InputError
from ..result.history import Reason
from .interior_point import GAIN, interior_point
from .meshes import COARSER, make_sheets
from .net_choice import chosen_net
from .saddle_exit import leave_saddle
from .saddle_flow import saddle_flow
from .saddle_system import SaddleSystem
from .settings import FLOWS, LINEARISATIONS
from .size import check_memory

PAPERS_END = 1e-3  # of the paper's barrier, by default
TURNS = np.pi / 8 * np.arange(1, 8)  # by half a turn threads lie as before


def discretised(scene, sheet, settings):
    """The problem of a scene on a mesh.

    Parameters
    ----------
    scene : Scene
        To be solved.
    sheet : Sheet
        Its surface on the mesh.
    settings : dict
        Of `solve`; kept as the problem's, as the mesh may be another one than the user's.

    Returns
    -------
    Discretisation
    """
    arguments = (settings[name] for name in ("order", "quadrature", "inverse"))
    if scene.in_equilibrium:
        kind = LINEARISATIONS[settings["linearisation"]]
        problem = kind(scene, sheet, *arguments, settings["multiplier_order"])
    else:
        gauss_newton = scene.inextensible and settings["schedule"] == "adaptive"
        problem = Lagrangian(scene, sheet, *arguments, gauss_newton)
    problem.settings = settings
    return problem


def run(problem, recorder, coarser, solved):
    """Solve a problem by the loop that its scene and settings ask for.

    Parameters
    ----------
    problem : Discretisation
        Its `state` is moved.
    recorder : Recorder
        Keeps budget and history, and the memory of an earlier run to go on from.
    coarser : list of Sheet
        The surface on coarser meshes, to be solved first.
    solved : callable
        Called after each of these without arguments.

    Returns
    -------
    Reason
    """
    scene, settings = problem.scene, problem.settings
    tolerance = settings.get("tolerance")
    if scene.in_equilibrium:
        end = settings.get("barrier_end", tolerance)
        if settings["schedule"] == "paper":
            end = settings.get("barrier_end", 0)
            return saddle_flow(problem, recorder, PAPERS_END if end is None else end, tolerance)
        warm = not recorder.memory and _start_from_coarser(problem, recorder, coarser, solved)
        if recorder.exhausted:
            return recorder.why
        return interior_point(problem, recorder, end, warm=warm)
    flow = FLOWS[settings["schedule"]]
    if scene.tie_break:
        return chosen_net(problem, recorder, flow, tolerance)
    reason, saddle = flow(problem, recorder, "flow", tolerance), np.inf
    while reason is Reason.CONVERGED and not scene.symmetric:
        cost = problem.cost()
        if not (saddle - cost > GAIN * abs(cost) and (_turn(problem) or _leave(problem))):
            break
        saddle = cost
        reason = flow(problem, recorder, "flow", tolerance)
    return reason


def _leave(problem):
    """Move off a saddle; whether it is one."""
    return leave_saddle(problem, SaddleSystem(problem), problem.hessian(exact=True))


def _turn(problem):
    """Turn the patch in its plane, if that lowers the cost; whether it does.

    A patch along the mirrors of surface and fabric is stationary, and the net may want to turn by
    so little force that no curvature tells: by how much the cost falls on the way does.
    """
    given, before = problem.unknowns.copy(), problem.cost()
    best, kept = before - GAIN * abs(before), given
    for angle in TURNS:
        c, s = np.cos(angle), np.sin(angle)
        problem.unknowns[:] = np.ravel(np.array([[c, -s], [s, c]]) @ given.reshape(2, -1))
        if problem.cost() < best:
            best, kept = problem.cost(), problem.unknowns.copy()
    problem.unknowns[:] = kept
    return kept is not given


def run_finer(recorder):
    """Go on from the patch that was found last, on a mesh of half the size.

    Parameters
    ----------
    recorder : Recorder
        Its `problem` is that of the patch.

    Returns
    -------
    bool
        Whether that converged; not where the machine does not hold the mesh, or the patch folds.
    """
    known = recorder.problem
    settings = known.settings | {"maxh": known.settings["maxh"] / COARSER}
    try:
        check_memory(known.scene, settings)
    except InputError:
        return False
    sheet = make_sheets(known.scene, settings["maxh"], settings["order"])[-1]
    problem = discretised(known.scene, sheet, settings)
    if not problem.take(known.state):
        return False
    end = settings["barrier_end"]
    reason = interior_point(problem, recorder, end, phase="finer", warm=True)
    return reason is Reason.CONVERGED


def _start_from_coarser(problem, recorder, sheets, solved):
    """Set the state to the solution of the next coarser problem, if it fits.

    Returns whether it does; else the state is as it was. Where the limits are active, and how far
    the patch is from its start, is found where steps are cheap.
    """
    if not sheets:
        return False
    settings = problem.settings | {"maxh": COARSER * problem.settings["maxh"]}
    coarse = discretised(problem.scene, sheets[-1], settings)
    warm = _start_from_coarser(coarse, recorder, sheets[:-1], solved)
    if recorder.exhausted:
        return False
    end = settings.get("barrier_end", settings.get("tolerance"))
    reason = interior_point(coarse, recorder, end, phase="coarse", warm=warm)
    given = problem.unknowns.copy()
    if reason is Reason.CONVERGED:
        solved()
        if problem.take(coarse.state):
            return True
    problem.unknowns[:] = given
    return False
