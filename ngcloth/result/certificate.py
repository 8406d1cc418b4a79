"""A certificate for a result: what its ψ is worth, recomputed from ψ alone.

The formulas are those of the solver; forms, rules and spaces are not. NGSolve differentiates whole
expressions down to ∇ψ, where the solver puts closed forms together, or has it done automatically;
and no multiplier of the solver is used.
"""

from dataclasses import dataclass
from math import comb

import ngsolve as ngs
import numpy as np

from ..output.planar import crossing
from ..problem.constraints import Elongation, Obstacle, ShearLimit
from .equilibrium import forces
from .stationarity import _cloth, _StationaryPoint
from .stationarity import least_eigenvalue as least_eigenvalue

LIMIT = 2e-3  # by which λ, |γ| and, over its largest value, τ may miss their limits; or by a strain
SETTLED = 1e-2  # of a cost: how far it may still fall
EQUILIBRIUM = 0.1  # `Result.equilibrium_residual`
BARRIER = 1e-2  # of the stress: weight of a barrier that does not spoil the optimum
FLAT = 1e-2  # of the stress: curvature that counts as zero
HALVINGS = 3  # of an element's edges, to prove J > 0 in it


@dataclass(frozen=True)
class LimitCheck:
    """One slack of one limit, on a lattice much finer than the points where it was imposed.

    Attributes
    ----------
    name : str
        Name of the limit.
    slack : float
        Its least value.
    tolerance : float
        The limit holds if ``slack >= -tolerance``.
    theta : (float, float)
        Where the slack is least.
    """

    name: str
    slack: float
    tolerance: float
    theta: tuple

    @property
    def holds(self):
        """Whether the slack is within its tolerance."""
        return self.slack >= -self.tolerance

    def __str__(self):
        return f"{self.name} missed by {-self.slack:.2g} at θ = {_point(self.theta)}"


@dataclass(frozen=True)
class Certificate:
    """What `verify` found; `str` is one line.

    Stresses and curvatures are over kc. "The stress" is the root mean square over the surface of
    the derivative of the energy density by ∇ψ.

    Attributes
    ----------
    limits : tuple of LimitCheck
        One per slack of the scene's constraints.
    jacobian : float
        The least J on the lattice.
    unfolded : bool
        Whether J > 0 is proven on every element, by Bernstein coefficients.
    overlap : (float, float) or None
        A point X of the patch where its rim meets itself. With J > 0 and none, ψ is injective.
    equilibrium : float or None
        `Result.equilibrium_residual`, or, where nothing but a direction of the warp is asked for,
        the force inside over the stress; None where stationarity implies it.
    stress : float
        The scale of `stationarity`, and of `curvature`.
    stationarity : float
        What is left of dL with the best multipliers: its norm over all ψ of the mesh, over the
        stress; infinite where a limit is violated at the points at which it is imposed.
    stationarity_tolerance : float
        What of it is accepted: with limits, what a barrier of weight `barrier` can achieve.
    stationarity_richer : float
        Likewise over all ψ one order richer: the error of the discretisation. It may be a tenth of
        the stress, or of kc where that is more: a Chebyshev net has no stress but this error.
    richer_tolerance : float
        What of it is accepted; for a cost of the scene's own, kc is what it gains where the energy
        of threads would gain kc.
    barrier : float
        The weight μ for which stationarity was tested, 0 without limits: at most 1 % of the stress.
    curvature : float
        Smallest eigenvalue of the Hessian of L on changes of ψ that keep the equilibrium, in the
        H¹ seminorm of the surface. Negative beyond `curvature_tolerance`: a saddle, or, without
        symmetry on a surface of revolution, the turning named below.
    curvature_tolerance : float
    asymmetric_curvature : float or None
        In a symmetric scene, likewise for the changes that break the symmetry, for information. On
        a surface of revolution one of them turns the cloth and costs nothing: expect 0 up to the
        error of the mesh, of either sign.
    in_sight : float or None
        With a cost of the scene's own and no limits, how far a Newton step promises to lower it,
        over itself. One that falls for ever, as the patch shrinks, leaves no force.
    one_of_many : bool
        Whether the patch is one among Chebyshev nets that are as good, chosen to bend evenly.
    """

    limits: tuple
    jacobian: float
    unfolded: bool
    overlap: tuple | None
    equilibrium: float | None
    stress: float
    stationarity: float
    stationarity_tolerance: float
    stationarity_richer: float
    richer_tolerance: float
    barrier: float
    curvature: float
    curvature_tolerance: float
    asymmetric_curvature: float | None
    in_sight: float | None
    one_of_many: bool

    @property
    def certified(self):
        """Whether every check holds."""
        return not self.faults

    @property
    def faults(self):
        """What does not hold, a list of phrases."""
        faults = [str(check) for check in self.limits if not check.holds]
        if not self.jacobian > 0:
            faults.append(f"folded, J = {self.jacobian:.2g}")
        elif not self.unfolded:
            faults.append("J > 0 not proven between the points")
        if self.overlap is not None:
            faults.append(f"the rim meets itself at X = {_point(self.overlap)}")
        if self.equilibrium is not None and not self.equilibrium <= EQUILIBRIUM:
            faults.append(f"{self.equilibrium:.2g} of the force is not in equilibrium")
        if not self.barrier <= BARRIER * self.stress:
            faults.append(f"the barrier's weight is {self.barrier / self.stress:.2g} of the stress")
        if not self.stationarity <= self.stationarity_tolerance:
            faults.append(f"not stationary, {self.stationarity:.2g} of the stress")
        elif self.in_sight is not None and not self.in_sight <= SETTLED:
            faults.append(f"the cost may still fall by {self.in_sight:.2g} of itself")
        elif not self.stationarity_richer <= self.richer_tolerance:
            faults.append(
                f"the mesh leaves {self.stationarity_richer:.2g} of the stress unbalanced"
            )
        elif not self.curvature >= -self.curvature_tolerance:
            faults.append(f"a saddle, curvature {self.curvature:.2g}")
        return faults

    def __str__(self):
        if self.faults:
            return "not certified: " + "; ".join(self.faults)
        parts = [f"J ≥ {self.jacobian:.2g}", "no overlap"]
        if self.limits:
            worst = min(self.limits, key=lambda check: check.slack / check.tolerance)
            parts = [f"limits within {max(-worst.slack, 0):.1g}", *parts]
        if self.equilibrium is not None:
            parts.append(f"equilibrium to {self.equilibrium:.1g}")
        parts.append(f"stationary to {self.stationarity:.1g} of the stress")
        minimum = f"a minimum, curvature {self.curvature:.2g}"
        if self.asymmetric_curvature is not None:
            minimum += f" within the symmetry, {self.asymmetric_curvature:.2g} across it"
        many = ", one of many, chosen to bend evenly" if self.one_of_many else ""
        return "certified: " + ", ".join([*parts, minimum]) + many


def verify(result):
    """Check a result from its ψ alone, on finer rules and richer spaces than the solver's.

    Parameters
    ----------
    result : Result
        Of any reason: one that has not converged tells here what is missing.

    Returns
    -------
    Certificate
        `certified` if the limits hold between the sampling points too, ψ folds and overlaps
        nowhere, the pinned cloth is in equilibrium, and ψ is a (local) minimum: stationary, with
        multipliers found from ψ, and of no negative curvature. In a symmetric scene, a minimum
        among symmetric patches.
    """
    limits, jacobian = check_limits(result)
    fine = _unfolded(result) if jacobian > 0 else False
    tests = {"stationarity": np.inf, "stationarity_richer": np.inf, "curvature": np.nan}
    tests |= {"asymmetric_curvature": np.nan if result.scene.symmetric else None, "in_sight": None}
    point = _StationaryPoint(result)
    if jacobian > 0 and point.interior:
        tests = point.tests()
    return Certificate(
        limits=limits,
        jacobian=jacobian,
        unfolded=fine,
        overlap=crossing(*_outlines(result)),
        equilibrium=_equilibrium(result, point),
        stress=point.stress,
        stationarity_tolerance=point.tolerance,
        richer_tolerance=point.richer_tolerance,
        barrier=point.mu,
        curvature_tolerance=FLAT * point.stress,
        one_of_many=result.scene.net_choice > 0,
        **tests,
    )


def _equilibrium(result, point):
    if result.scene.constraints or result.scene.cost:
        return result.equilibrium_residual
    if not result.scene.in_equilibrium:
        return None
    # What holds the direction of the warp is a force at a point: the rim carries none.
    return float(forces(result)[0] / (point.stress * np.sqrt(point.area)))


def _on_lattice(result, points):
    """Mesh points at reference points (n, 2) of each element."""
    rule = ngs.IntegrationRule([tuple(p) for p in points.tolist()], [0.0] * len(points))
    return result.state.space.mesh.MapToAllElements({ngs.ET.TRIG: rule}, ngs.VOL)


def check_limits(result):
    """A `LimitCheck` for every slack, and the least J."""
    points = _on_lattice(result, _lattice(2 * result.settings["quadrature"]))
    cloth, theta = _cloth(result), ngs.CF((ngs.x, ngs.y))(points)
    checks = []
    for limit in result.scene.constraints:
        for slack in limit.slacks(cloth):
            values = slack.Compile()(points).ravel()
            worst = int(np.argmin(values))  # a NaN, if there is one
            tolerance = LIMIT
            if not isinstance(limit, Elongation | ShearLimit | Obstacle):
                # The strain that makes up for it, whatever the unit of the slack.
                strain = (slack.Diff(cloth.gradient) * cloth.gradient.trans).Compile()(points)
                tolerance *= float(np.linalg.norm(strain.reshape(-1, 4)[worst]))
            if isinstance(limit, ShearLimit):
                tolerance *= 2 * limit.maximum  # its slack is γmax² − γ²
            elif isinstance(limit, Obstacle):
                tolerance *= float(np.abs(values).max())
            checks.append(
                LimitCheck(
                    limit.name, float(values[worst]), tolerance, tuple(theta[worst].tolist())
                )
            )
    return tuple(checks), float(cloth.jacobian.Compile()(points).min())


def _lattice(n):
    """Points (i, j)/n of the reference triangle, edges and vertices included."""
    n = max(n, 1)
    return np.array([(i, j) for i in range(n + 1) for j in range(n + 1 - i)]) / n


def _unfolded(result):
    """Whether J > 0 on all of every element.

    On the reference triangle J times the Jacobian of the element is a polynomial of degree
    2(order − 1), curved or not, and lies above the least of its Bernstein coefficients. Parts of
    an element have closer ones.
    """
    degree = max(2 * (result.settings["order"] - 1), 1)
    lattice = _lattice(degree)
    i, j = np.rint(degree * lattice).astype(int).T
    s, t = lattice.T[:, :, None]
    count = np.array([comb(degree, a) * comb(degree - a, b) for a, b in zip(i, j, strict=True)])
    basis = np.linalg.inv(count * s**i * t**j * (1 - s - t) ** (degree - i - j))

    element = ngs.Det(ngs.specialcf.JacobianMatrix(2))
    density = (_cloth(result).jacobian * element).Compile()
    parts = [np.array([[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]])]
    for _ in range(HALVINGS + 1):
        points = np.concatenate([p[0] + lattice @ (p[1:] - p[0]) for p in parts])
        values = density(_on_lattice(result, points)).reshape(-1, len(lattice))
        if (values @ basis.T).min() > 0:
            return True
        parts = [part for whole in parts for part in _quartered(whole)]
    return False


def _quartered(triangle):
    middles = (triangle + np.roll(triangle, -1, axis=0)) / 2
    corners = [np.array([triangle[k], middles[k], middles[k - 1]]) for k in range(3)]
    return [*corners, middles]


def _outlines(result):
    """The rim of the patch and those of its holes, eight points for each element there."""
    edges = result.state.space.mesh.Boundaries("rim").Elements()
    n = int(np.clip(8 * result.scene.copies * sum(1 for _ in edges), 400, 2000))
    return [result.outline(n, hole) for hole in range(result.domain.holes + 1)]


def _point(values):
    return "(" + ", ".join(f"{round(value, 9) + 0.0:.3g}" for value in values) + ")"
