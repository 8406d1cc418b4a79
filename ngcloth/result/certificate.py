"""A certificate for a result: what its ψ is worth, recomputed from ψ alone.

Of the solver it knows the points at which limits were imposed, and nothing else: no multiplier, no
matrix. Spaces, derivatives and factorisations are its own.
"""

from dataclasses import dataclass, replace
from itertools import combinations

import ngsolve as ngs
import numpy as np

from ..errors import check_result
from ..geometry.file_surface import FileSurface
from ..geometry.sheet import mesh_points
from ..output.planar import crossing
from ..problem.bars import with_bar
from ..problem.constraints import Elongation, Obstacle, ShearLimit
from ..problem.kinematics import Kinematics, gradient
from ..problem.warp import in_words
from .bernstein import basis, lattice, product
from .between import Between, least_ratio
from .equilibrium import forces
from .patch import Patch
from .stationarity import StationaryPoint

LIMIT = 2e-3  # by which λ and |γ| may miss their limits; or another, by a strain
SHARP = 3e-4  # of λ and |γ|: what proofs lose at most, if that does not take too long
PUSH = 1e-3  # of the largest reaction: by which others may be negative
FINE = 24  # points along a side at which limits are sampled
SETTLED = 1e-2  # of a cost: how far it may still fall
BARRIER = 1e-2  # of the cost, which a barrier may make where it strains by more than `LIMIT`


@dataclass(frozen=True)
class LimitCheck:
    """One slack of one limit, on all of every triangle.

    Attributes
    ----------
    name : str
        Name of the limit.
    slack : float
        Its least value on a lattice with `FINE` points along each side of a triangle.
    tolerance : float
        The limit holds if ``slack >= -tolerance``, and `bound` as well where there is one.
    theta : (float, float)
        Where the slack is least on the lattice.
    claim : str
        What is so, in words, if the limit holds.
    bound : float or None
        A value below which the slack is proven to lie nowhere; None of limits that are sampled
        alone.
    place : str or None
        Where that is in space, with the unit, on surfaces from files.
    """

    name: str
    slack: float
    tolerance: float
    theta: tuple
    claim: str
    bound: float | None = None
    place: str | None = None

    @property
    def holds(self):
        """Whether the slack is within its tolerance."""
        least = self.slack if self.bound is None else min(self.slack, self.bound)
        return bool(least >= -self.tolerance)

    def __str__(self):
        place = self.place or f"θ = {_point(self.theta)}"
        if np.isnan(self.slack):
            return f"{self.name} not known at {place}: the mesh is too coarse"
        if self.slack >= -self.tolerance and not self.holds:
            return f"{self.name} proven only to within {-self.bound:.2g}"
        return f"{self.name} missed by {-self.slack:.2g} at {place}"


@dataclass(frozen=True)
class Certificate:
    """What `verify` found; `str` tells what is proven, sampled and found, in a line each.

    Stresses and curvatures are over kc. "The stress" is the root mean square over the surface of
    the derivative of the energy density by ∇ψ.

    Attributes
    ----------
    limits : tuple of LimitCheck
        One per slack of the scene's constraints. `Elongation` and `ShearLimit` are proven, others
        sampled.
    metric_error : float or None
        Relative error of the metric's interpolation, on which the proofs of limits rest; measured,
        not proven, doubled, and part of all bounds. None where there is nothing to prove.
    jacobian : float
        The least J on a lattice.
    unfolded : bool
        Whether J > 0 is proven on every element, by Bernstein coefficients.
    overlap : (float, float) or None
        A point X of the patch where its rim meets itself. With J > 0 and none, ψ is injective.
    equilibrium : float or None
        The force inside over the stress of the energy; None where stationarity implies it.
    equilibrium_tolerance : float
        What of it is accepted: 0.075, or what is a hundredth of kc, an error of the mesh.
    stress : float
        The scale of `stationarity`, and of `curvature`.
    stationarity : float
        What is left of dL with the best multipliers: its norm over all ψ of the mesh, over the
        stress; infinite where a limit is violated at the points at which it is imposed.
    stationarity_tolerance : float
        What of it is accepted: with limits a thousandth, or what a barrier of weight `barrier` can
        achieve.
    stationarity_richer : float
        Likewise over all ψ one order richer: the error of the discretisation. It may be a twentieth
        of the stress, or of kc where that is more: a Chebyshev net has no stress but this error.
    richer_tolerance : float
        What of it is accepted; for a cost of the scene's own, kc is what it gains where the energy
        of threads would gain kc.
    barrier : float
        The weight μ for which stationarity was tested, 0 without limits.
    barrier_strain : float
        How far that barrier keeps the cloth from the optimum without one: μ dψ/dμ, as a strain, its
        root mean square over the surface. It may be `LIMIT`.
    barrier_share : float
        What the cost would fall by without the barrier, over itself, to first order. Where the
        barrier strains the cloth more, it may be a hundredth: where the fabric has a stress of its
        own. Of stress that the barrier makes it is all.
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
    energy : float
        `Result.normalized_energy`.
    energy_error : float or None
        Of `Result.error`, in the same unit: estimated, not proven.
    """

    limits: tuple
    metric_error: float | None
    jacobian: float
    unfolded: bool
    overlap: tuple | None
    equilibrium: float | None
    equilibrium_tolerance: float
    stress: float
    stationarity: float
    stationarity_tolerance: float
    stationarity_richer: float
    richer_tolerance: float
    barrier: float
    barrier_strain: float
    barrier_share: float
    curvature: float
    curvature_tolerance: float
    asymmetric_curvature: float | None
    in_sight: float | None
    one_of_many: bool
    energy: float
    energy_error: float | None

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
        if self.equilibrium is not None and not self.equilibrium <= self.equilibrium_tolerance:
            faults.append(f"{self.equilibrium:.2g} of the force is not in equilibrium")
        if not self.stationarity <= self.stationarity_tolerance:
            faults.append(f"not stationary, {self.stationarity:.2g} of the stress")
        elif self.in_sight is not None and not self.in_sight <= SETTLED:
            faults.append(f"the cost may still fall by {self.in_sight:.2g} of itself")
        elif not (self.barrier_strain <= LIMIT or self.barrier_share <= BARRIER):
            faults.append(
                f"the barrier makes {self.barrier_share:.2g} of the cost, "
                f"and a strain of {self.barrier_strain:.2g}"
            )
        elif not self.stationarity_richer <= self.richer_tolerance:
            faults.append(
                f"the mesh leaves {self.stationarity_richer:.2g} of the stress unbalanced"
            )
        elif not self.curvature >= -self.curvature_tolerance:
            faults.append(f"a saddle, curvature {self.curvature:.2g}")
        return faults

    @property
    def findings(self):
        """What holds, and how: a phrase on proofs, on samples, and on ψ as an optimum."""
        proven = [check.claim for check in self.limits if check.bound is not None]
        sampled = [check.claim for check in self.limits if check.bound is None]
        proofs = f"{', '.join([*proven, 'J > 0'])} proven on every triangle"
        if proven:
            proofs += f", the metric known to {self.metric_error:.0e}"
        samples = ", ".join([*sampled, f"J ≥ {self.jacobian:.2g}", "no overlap"])
        strict = self.curvature > self.curvature_tolerance
        which = "strict on this mesh" if strict else "the warp may turn, or something, at no cost"
        optimum = f"a minimum, {which}, curvature {self.curvature:.2g}"
        if self.asymmetric_curvature is not None:
            across = self.asymmetric_curvature
            optimum += f" within the symmetry, {across:.2g} across it"
            if across < -self.curvature_tolerance:
                optimum += ": patches without the symmetry may cost less"
        optimum += f", stationary to {self.stationarity:.1g} of the stress"
        if self.equilibrium is not None:
            optimum += f", equilibrium to {self.equilibrium:.1g}"
        if self.limits:
            optimum += f", the barrier strains by {self.barrier_strain:.1g}"
        if self.one_of_many:
            optimum += ", one of many, chosen to bend evenly"
        energy = f"E/(2π kc) = {with_bar(f'{self.energy:.4e}', self.energy_error)}"
        return [proofs, f"{samples} at the points of a lattice", optimum, energy]

    def __str__(self):
        if self.faults:
            return "not certified: " + "; ".join(self.faults)
        return "certified: " + "\n  ".join(self.findings)


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

    Raises
    ------
    InputError
        If this is no result.
    """
    check_result(result)
    patch, bar = Patch(result), result.error["energy"]
    between = Between(patch)
    found = {
        "equilibrium_tolerance": np.nan,
        "stress": np.nan,
        "stationarity": np.inf,
        "stationarity_tolerance": np.nan,
        "stationarity_richer": np.inf,
        "richer_tolerance": np.nan,
        "barrier": np.nan,
        "barrier_strain": np.nan,
        "barrier_share": np.nan,
        "curvature": np.nan,
        "curvature_tolerance": np.nan,
        "asymmetric_curvature": np.nan if result.scene.symmetric else None,
        "in_sight": None,
    }
    point = StationaryPoint(patch, result.settings)
    if between.jacobian > 0:
        found |= point.tests()
    proven = any(type(limit) in (Elongation, ShearLimit) for limit in result.scene.constraints)
    return Certificate(
        limits=check_limits(result, between),
        metric_error=between.error if proven else None,
        jacobian=between.jacobian,
        unfolded=between.jacobian > 0 and between.unfolded(),
        overlap=crossing(*_outlines(result)),
        equilibrium=_equilibrium(point),
        one_of_many=result.scene.net_choice > 0,
        energy=float(result.normalized_energy),
        energy_error=None if bar is None else float(bar / result.scene.normalisation),
        **found,
    )


def _equilibrium(point):
    if not point.scene.in_equilibrium:
        return None
    # Not over the force with the rim, as `Result.equilibrium_residual`: where no limit is active
    # the rim carries none, and all there is are errors of the mesh.
    return float(forces(point.patch)[0] / (point.force * np.sqrt(point.area)))


def check_limits(result, between=None):
    """A `LimitCheck` for every slack."""
    between = between or Between(Patch(result))
    checks = []
    for limit in result.scene.constraints:
        proven = {Elongation: _stretches, ShearLimit: _shear}.get(type(limit))
        checks += proven(limit, between) if proven else _sampled(limit, result, between.triangles)
    if isinstance(surface := result.scene.surface, FileSurface):
        checks = [replace(check, place=f"{check.place} {surface.unit}") for check in checks]
    else:
        checks = [replace(check, place=None) for check in checks]
    return tuple(checks)


def _stretches(limit, between):
    """1 − 1/λ of all families, proven."""
    square, degree = between.area_square, between.degree
    kept = 1 - between.error  # of a square, at least
    squares, checks = _on_lattice(square, degree), []
    for number, line in enumerate(between.lines, start=1):
        above = between.product(line, line)
        with np.errstate(invalid="ignore"):  # where the metric is not resolved
            stretches = np.sqrt(_on_lattice(above, degree) / squares)
        enough = max((1 - LIMIT) ** 2 / kept, (stretches.min() - SHARP) ** 2)
        ratio, _ = least_ratio(above, square, degree, enough)
        stretch, values = float(np.sqrt(max(ratio * kept, 1e-300))), 1 - 1 / stretches
        proven = f"λ{number} ≥ {_below(stretch)}", 1 - 1 / stretch
        checks.append(_check(limit, values, LIMIT, between.sheet, *proven))
    return checks


def _shear(limit, between):
    """γmax² − γ² of each two families, proven."""
    error, allowed, degree = between.error, limit.maximum + LIMIT, 2 * between.degree
    tolerance, checks = allowed**2 - limit.maximum**2, []
    for pair in combinations(between.lines, 2):
        mixed, (one, other) = between.product(*pair), (between.product(t, t) for t in pair)
        both = between.degree, between.degree
        squares, threads = product(mixed, mixed, both), product(one, other, both)
        values = _on_lattice(squares, degree) / _on_lattice(threads, degree)
        enough = min(allowed * (1 - error) - error, np.sqrt(values.max()) + SHARP)
        ratio, _ = least_ratio(-squares, threads, degree, -(enough**2))
        shear, values = float((np.sqrt(-ratio) + error) / (1 - error)), limit.maximum**2 - values
        proven = f"|γ| ≤ {-_below(-shear)}", limit.maximum**2 - shear**2
        checks.append(_check(limit, values, tolerance, between.sheet, *proven))
    return checks


def _below(value):
    return float(np.floor(1e5 * value) / 1e5) if np.isfinite(value) else value


def _sampled(limit, result, triangles):
    """The slacks of a limit that is not one of polynomials, on a lattice alone."""
    sheet, psi = result.sheet, result.state.components[:2]
    slope = gradient(*psi)
    cloth = Kinematics(slope, sheet.metric, result.scene.fabric, lambda: sheet.curvature, psi)
    checks = []
    for slack in limit.slacks(cloth):
        expression, points = slack.Compile(), triangles.at_lattice(FINE)
        values = expression(points).reshape(len(triangles), -1)
        if isinstance(limit, Obstacle):
            tolerance = PUSH * float(np.abs(values).max())
        else:  # The strain that makes up for it, whatever the unit of the slack.
            strain = slack.Diff(slope) * slope.trans
            worst = points[[np.argmin(values)]]
            tolerance = LIMIT * float(np.linalg.norm(strain.Compile()(worst)))
        missed = max(0.0, -float(values.min()))
        claim = f"{limit.name} missed by {missed:.1g} of {tolerance:.1g} allowed"
        checks.append(_check(limit, values, tolerance, sheet, claim))
    return checks


def _on_lattice(coefficients, degree):
    """Values of polynomials, (triangles, points)."""
    return coefficients @ basis(degree, lattice(FINE)).T


def _check(limit, values, tolerance, sheet, claim, bound=None):
    """The check of a slack, of its values at the lattice of all triangles."""
    number, worst = np.unravel_index(np.argmin(values), values.shape)  # a NaN, if there is one
    point = mesh_points(sheet.mesh, np.array([number]), lattice(FINE)[[worst]])
    theta, slack = tuple(ngs.CF((ngs.x, ngs.y))(point)[0].tolist()), float(values[number, worst])
    place = in_words(sheet.position(point)[0])
    return LimitCheck(limit.name, slack, tolerance, theta, claim, bound, place)


def _outlines(result):
    """The rim of the patch and those of its holes, eight points for each element there."""
    edges = result.state.space.mesh.Boundaries("rim").Elements()
    n = int(np.clip(8 * result.scene.copies * sum(1 for _ in edges), 400, 2000))
    return [result.outline(n, hole) for hole in range(result.domain.holes + 1)]


def _point(values):
    return "(" + ", ".join(f"{round(value, 9) + 0.0:.3g}" for value in values) + ")"
