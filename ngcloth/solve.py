"""solve(): mesh, loops, result."""

import ngsolve as ngs
from netgen.occ import OCCGeometry

from .constrained import ConstrainedLagrangian
from .errors import InputError, SolveError, check_integer, check_number
from .gradient_flow import adaptive_flow, fixed_flow
from .history import Reason, Recorder
from .interior_point import interior_point
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
    multiplier_order=None,
    quadrature=None,
    barrier_end=1e-3,
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
    multiplier_order : int, optional
        Polynomial order of the multiplier η of equilibrium, in scenes with constraints. By
        default that of ψ: with order 1, as in the paper, a layer one element wide along the rim
        goes unbalanced, and the energy converges only like h, from below.
    quadrature : int, optional
        Degree of the integration rule. By default ``2 * order + 2``.
    barrier_end : float, optional
        The barrier weight μ over kc at which a solve with constraints ends, at most 1. Default
        1e-3.
    tolerance : float, optional
        The solve ends where the decrease of the Lagrangian still in sight is below this fraction
        of it; with the "paper" schedule where |∂t L|/(2π kc) is below it. Default 1e-6.
    max_steps : int, optional
        Budget of Newton steps. Default 500.
    schedule : {"adaptive", "paper"}, optional
        The pseudo-time loop: one Newton step to each of ever longer steps, or the paper's steps
        of one size with a Newton solve in each. Only for scenes without constraints.
    inverse : {"sparsecholesky", "umfpack"}, optional
        NGSolve's direct solver. Default "sparsecholesky".
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
    known = (
        "maxh, order, multiplier_order, quadrature, barrier_end, tolerance, max_steps, schedule, "
        "inverse, log, throw"
    )
    for name, value in unknown.items():
        raise InputError(name, value, f"unknown setting; there are {known}")
    diameter = scene.surface.domain.diameter
    settings = {
        "maxh": check_number("maxh", 0.02 * diameter if maxh is None else maxh, 0, open_low=True),
        "order": check_integer("order", order, 1),
        "quadrature": check_integer(
            "quadrature", 2 * order + 2 if quadrature is None else quadrature, 2 * order - 2
        ),
        "max_steps": check_integer("max_steps", max_steps, 1),
        "ngsolve": ngs.__version__,
    }
    if not (log is None or callable(log)):
        raise InputError("log", log, "a callable of one line of text, or None")
    settings["inverse"] = _check_choice("inverse", inverse, INVERSES)
    check_number("tolerance", tolerance, 0, open_low=True)
    check_number("barrier_end", barrier_end, 0, 1, open_low=True)
    _check_choice("schedule", schedule, FLOWS)
    if scene.constraints:
        if schedule == "paper":
            raise InputError("schedule", schedule, "'adaptive' for a scene with constraints")
        settings["multiplier_order"] = check_integer(
            "multiplier_order", order if multiplier_order is None else multiplier_order, 1
        )
        settings["barrier_end"] = barrier_end
    else:
        settings |= {"tolerance": tolerance, "schedule": schedule}

    recorder = Recorder(scene.copies / scene.normalisation * scene.fabric.stiffness, max_steps, log)
    mesh = make_mesh(scene, settings["maxh"], order)
    discretisation = (scene, mesh, order, settings["quadrature"], inverse)
    if scene.constraints:
        problem = ConstrainedLagrangian(*discretisation, settings["multiplier_order"])
        reason = interior_point(problem, recorder, barrier_end)
    else:
        gauss_newton = scene.inextensible and schedule == "adaptive"
        problem = Lagrangian(*discretisation, gauss_newton)
        reason = _run(problem, recorder, FLOWS[schedule], tolerance)
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
