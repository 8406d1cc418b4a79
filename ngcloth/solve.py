"""solve(): mesh, loops, result."""

import ngsolve as ngs
from netgen.occ import OCCGeometry

from .errors import InputError, SolveError, check_integer, check_number
from .gradient_flow import adaptive_flow, fixed_flow
from .history import Reason, Recorder
from .lagrangian import Lagrangian
from .result import Result
from .scene import Scene

FLOWS = {"adaptive": adaptive_flow, "paper": fixed_flow}
INVERSES = ("sparsecholesky", "umfpack")
FIRST_TIE_BREAK = 1e-4


def solve(
    scene,
    maxh=None,
    order=2,
    *,
    quadrature=None,
    tolerance=1e-6,
    max_steps=500,
    schedule="adaptive",
    inverse="sparsecholesky",
    log=None,
    throw=False,
    **unknown,
):
    """Find the optimal patch of a scene.

    Parameters
    ----------
    scene : Scene
        What to cover with what.
    maxh : float, optional
        Largest element size in the parameter plane. By default 2 % of the domain's diameter.
    order : int, optional
        Polynomial order of ψ. Default 2.
    quadrature : int, optional
        Degree of the integration rule. By default ``2 * order + 2``.
    tolerance : float, optional
        The solve ends where the decrease of the Lagrangian still in sight is below this fraction
        of it; with the "paper" schedule where |∂t L|/(2π kc) is below it. Default 1e-6.
    max_steps : int, optional
        Budget of Newton steps. Default 500.
    schedule : {"adaptive", "paper"}, optional
        The pseudo-time loop: one Newton step to each of ever longer steps, or the paper's steps
        of one size with a Newton solve in each.
    inverse : {"sparsecholesky", "umfpack"}, optional
        NGSolve's direct solver.
    log : callable, optional
        Called with one line of text per step, for instance ``print``. Silent by default.
    throw : bool, optional
        Raise `SolveError` instead of returning a result that has not converged.

    Returns
    -------
    Result
        With ``converged`` and ``reason``; the last good iterate where it has not converged.

    Raises
    ------
    InputError
        If a setting is unknown or out of bounds; before any mesh is made.
    SolveError
        If the solve did not converge and `throw` is set.
    """
    if not isinstance(scene, Scene):
        raise InputError("scene", scene, "an ngcloth.Scene")
    known = "maxh, order, quadrature, tolerance, max_steps, schedule, inverse, log, throw"
    for name, value in unknown.items():
        raise InputError(name, value, f"unknown setting; there are {known}")
    diameter = scene.surface.domain.diameter
    settings = {
        "maxh": check_number("maxh", 0.02 * diameter if maxh is None else maxh, 0, open_low=True),
        "order": check_integer("order", order, 1),
        "quadrature": check_integer(
            "quadrature", 2 * order + 2 if quadrature is None else quadrature, 2 * order - 2
        ),
        "tolerance": check_number("tolerance", tolerance, 0, open_low=True),
        "max_steps": check_integer("max_steps", max_steps, 1),
        "schedule": _check_choice("schedule", schedule, FLOWS),
        "inverse": _check_choice("inverse", inverse, INVERSES),
        "ngsolve": ngs.__version__,
    }
    if not (log is None or callable(log)):
        raise InputError("log", log, "a callable of one line of text, or None")

    recorder = Recorder(scene.copies / scene.normalisation * scene.fabric.stiffness, max_steps, log)
    mesh = make_mesh(scene, settings["maxh"], order)
    gauss_newton = scene.inextensible and schedule == "adaptive"
    problem = Lagrangian(scene, mesh, order, settings["quadrature"], inverse, gauss_newton)
    reason = _run(problem, recorder, FLOWS[schedule], settings["tolerance"])
    result = Result(
        scene=scene,
        state=problem.state,
        reason=reason,
        cost=problem.cost(),
        newton_iterations=recorder.newton,
        seconds=recorder.seconds,
        history=recorder.rows,
        settings=settings,
    )
    if log:
        log(str(reason))
    if throw and not result.converged:
        raise SolveError(result)
    return result


def make_mesh(scene, maxh, order):
    """The curved triangulation of the scene's domain, or of its quarter."""
    face = scene.surface.domain.face(scene.symmetric)
    mesh = ngs.Mesh(OCCGeometry(face, dim=2).GenerateMesh(maxh=maxh))
    mesh.Curve(order)
    return mesh


def _run(problem, recorder, flow, tolerance):
    tie_break = problem.scene.tie_break
    for weight in (max(FIRST_TIE_BREAK, tie_break), tie_break) if tie_break else (0.0,):
        problem.mu = weight
        reason = flow(problem, recorder, "flow", tolerance)
        if reason is not Reason.CONVERGED:
            break
    return reason


def _check_choice(argument, value, choices):
    if not isinstance(value, str) or value not in choices:
        raise InputError(argument, value, "one of " + ", ".join(map(repr, choices)))
    return value
