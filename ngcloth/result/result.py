"""What comes out: the optimal patch, and how the solve went. Knows nothing of solvers."""

from dataclasses import dataclass, field
from functools import cached_property

import ngsolve as ngs
import numpy as np

from ..errors import InputError, check_integer, check_points
from ..geometry.file_surface import FileSurface
from ..geometry.mirrors import with_images
from ..geometry.nearest import nearest_on_sheet
from ..geometry.sheet import Sheet, lattice
from ..problem.bars import UNKNOWN
from ..problem.constraints import LimitPoints
from ..problem.domain import MeshDomain, MirroredDomain
from ..problem.kinematics import Kinematics, gradient
from ..problem.scene import Scene
from ..problem.warp import middle, on_surface
from .equilibrium import equilibrium_residual
from .history import Reason
from .patch import Patch
from .summary import summary
from .taken_away import TakenAway

NO_ENERGY = 1e-11  # per area and stiffness: that of strains of 1e-6
SIGNED = ("shear", "angle")  # fields whose sign a mirror turns over


@dataclass(frozen=True)
class Result(TakenAway):
    """The outcome of `ngcloth.solve`.

    Attributes
    ----------
    scene : Scene
    state : GridFunction
        ψ on the meshed domain, its first two components; multipliers after them.
    reason : Reason
        Why the solve stopped, in words. A result that has not `converged` holds the last good
        iterate.
    cost : float
        What was minimised, over kc and the meshed domain: E, or the scene's own cost.
    newton_iterations : int
        All Newton steps, refused ones and those on coarser meshes included.
    seconds : float
        Wall-clock time of the solve.
    history : list of Row
        One row per accepted step.
    settings : dict
        What was used, defaults and versions included.
    sheet : Sheet
        The surface on the mesh of ψ.
    limit_points : LimitPoints
        Where the solve asked limits beside the points of its rules.
    error : dict
        How far "energy", "area" and "outline" (its farthest point) may be from the truth, in their
        own units: {"energy": ±, …}. None where that is not estimated, as without a chain of meshes,
        and infinite where these are too coarse to tell.
    """

    scene: Scene
    state: ngs.GridFunction
    reason: Reason
    cost: float
    newton_iterations: int
    seconds: float
    history: list
    settings: dict
    sheet: Sheet = field(repr=False)
    limit_points: LimitPoints = field(default=LimitPoints(), repr=False)
    error: dict = field(default_factory=lambda: dict(UNKNOWN))

    @property
    def converged(self):
        """Whether `reason` is `Reason.CONVERGED`."""
        return self.reason is Reason.CONVERGED

    @property
    def last_mesh_iterations(self):
        """Newton steps on the last mesh alone, without those on coarser ones that led to it."""
        last = self.history[-1].phase if self.history else ""
        before = [row.newton for row in self.history if row.phase == "coarse" != last]
        return self.newton_iterations - max(before, default=0)

    @property
    def energy(self):
        """E = ∫ J W, whole surface, in units of stiffness × length²."""
        if self.scene.cost is None:
            return self.scene.copies * self.scene.fabric.stiffness * self.cost
        cloth = self._cloth
        return self._integral(cloth.energy)

    @property
    def normalized_energy(self):
        """E / (2π kc), as the paper reports it."""
        return self.energy / self.scene.normalisation

    @cached_property
    def area(self):
        """Area of the whole flat patch, ∫ J."""
        return self._integral(ngs.CF(1.0))

    @cached_property
    def extrema(self):
        """Least and greatest value of each field, {"stretch1": (min, max), …}.

        They are taken over a lattice on every element that includes its edges and is finer than
        the integration rule; the keys are the names of `field`. Shear and its angle count in all
        mirror images.
        """
        extrema = {name: self._range(field) for name, field in self._fields.items()}
        if self.scene.symmetric:
            for name in SIGNED:
                low, high = extrema[name]
                extrema[name] = min(low, -high), max(high, -low)
        return extrema

    @property
    def unfolded(self):
        """Whether J > 0 all over the lattice of `extrema`."""
        return self._range(self._cloth.jacobian)[0] > 0

    @property
    def largest_shear(self):
        """The greatest |γ| of any two families of threads, over the lattice of `extrema`."""
        return max(abs(end) for shear in self._cloth.shears for end in self._range(shear))

    def _range(self, expression):
        points = lattice(2 * self.settings["order"] + 2).tolist()
        rule = ngs.IntegrationRule(points, [0.0] * len(points))
        points = self._mesh.MapToAllElements({ngs.ET.TRIG: rule}, ngs.VOL)
        values = expression.Compile()(points)
        return float(values.min()), float(values.max())

    @cached_property
    def domain(self):
        """The parameter domain: the chart's, or the flat copy of the mesh on a file's surface.

        With mirrors, mirror images are part of it.
        """
        if not self._from_file:
            return self.scene.surface.domain
        if not self.scene.symmetric:
            return self._meshed
        quarter = np.sign(self._meshed.triangles.mean(axis=(0, 1)))
        return MirroredDomain(self.whole.mesh, quarter)

    @cached_property
    def whole(self):
        """The surface on all of `domain`: `sheet`, with mirror images where a file has none."""
        if self._from_file and self.scene.symmetric:
            return with_images(self.sheet, self.scene.surface.quarter[1])
        return self.sheet

    @property
    def _from_file(self):
        return isinstance(self.scene.surface, FileSurface)

    @cached_property
    def _meshed(self):
        return MeshDomain(self._mesh)

    def evaluate(self, expression, theta):
        """Values of an expression of `whole` at points of the domain.

        Parameters
        ----------
        expression : CoefficientFunction
            Such as ``result.whole.position``.
        theta : array_like, (..., 2)
            Points of the closed domain, rim and mirror images included.

        Returns
        -------
        ndarray, (...) + expression.dims
        """
        if not isinstance(expression, ngs.CoefficientFunction):
            allowed = "an expression of NGSolve, such as result.whole.position"
            raise InputError("expression", expression, allowed)
        theta = check_points("theta", theta, 2)
        if not self._from_file:
            return self.scene.surface.evaluate(expression, theta)
        values = _at(expression.Compile(), self.domain.located(theta.reshape(-1, 2)))
        return values.reshape(theta.shape[:-1] + tuple(expression.dims))

    def psi(self, theta1, theta2):
        """Flat position of parameter points.

        Parameters
        ----------
        theta1, theta2 : float or array_like
            Points of the closed domain, rim and mirror images included.

        Returns
        -------
        ndarray, (..., 2)
            X = ψ(θ) in units of length; the centre of the domain is at the origin of a symmetric
            patch.

        Raises
        ------
        InputError
            If a point lies outside the domain.
        """
        theta, sign = self._folded(theta1, theta2)
        points, offset = self._located(theta)
        values = np.stack([_at(component, points) for component in self._psi], axis=-1)
        slopes = np.stack([_at(ngs.Grad(component), points) for component in self._psi], axis=-2)
        values += np.einsum("nij,nj->ni", slopes, offset)
        return values.reshape(sign.shape) * sign

    def slopes(self, theta):
        """∇ψ at parameter points.

        Parameters
        ----------
        theta : array_like, (..., 2)
            Points of the closed domain, rim and mirror images included.

        Returns
        -------
        ndarray, (..., 2, 2)
            Rows are components of ψ.
        """
        folded, sign = self._folded(*np.moveaxis(check_points("theta", theta, 2), -1, 0))
        points, _ = self._located(folded)
        values = _at(gradient(*self._psi), points).reshape(*sign.shape, 2)
        return values * sign[..., :, None] * sign[..., None, :]

    @cached_property
    def warp(self):
        """A unit vector along the warp, (3,), at `Scene.at`, by default near the middle."""
        theta, _, tangents = self.middle
        along = tangents @ np.linalg.inv(self.slopes(theta))[:, 0]
        if self.scene.symmetric and self._from_file:
            across = self.scene.surface.quarter[1].normals[0]
            along = across * np.sign(across @ along)  # exactly: a triangle knows it to its error
        return along / np.linalg.norm(along)

    @cached_property
    def middle(self):
        """Parameters, point and ∂φ/∂θ where `warp` is told."""
        surface, given = self.scene.surface, self.scene.at
        at = middle(surface, self.scene.symmetric) if given is None else np.array(given)
        return nearest_on_sheet(self.sheet, at) if self._from_file else on_surface(surface, at)

    def field(self, name, theta1, theta2):
        """A field of the cloth at parameter points.

        Parameters
        ----------
        name : str
            "stretch1", "stretch2" (and so on, for more families of threads), "shear" (γ, cosine of
            the angle between threads of the first two), "angle" (the shear angle in degrees: 90°
            minus the angle between these threads, signed as γ), "thickness" (t/t0 of incompressible
            cloth, 1 over the areal stretch), "reaction" (force per flat area, > 0 where the surface
            pushes) or "jacobian".
        theta1, theta2 : float or array_like
            As for `psi`.

        Returns
        -------
        ndarray, (...)
        """
        if not isinstance(name, str) or name not in self._fields:
            raise InputError("name", name, f"one of {', '.join(self._fields)}")
        theta, sign = self._folded(theta1, theta2)
        points, _ = self._located(theta)
        values = _at(self._fields[name], points).reshape(sign.shape[:-1])
        return values * sign.prod(axis=-1) if name in SIGNED else values

    def outline(self, n=400, hole=0):
        """`n` points along the rim of the whole flat patch, shape (n, 2); 2²⁰ at most.

        They start at the largest θ1 on the axis θ2 = centre, for files without mirrors at the
        largest of all, and run counter-clockwise in θ. The curve is closed: the first point
        follows the last and is not repeated.

        Around a `hole`, numbered from 1 to ``result.domain.holes``, they run clockwise.
        """
        if not check_integer("hole", hole, 0) <= self.domain.holes:
            raise InputError("hole", hole, f"a number up to {self.domain.holes}")
        return self.psi(*(self.domain.rim(n, hole) if hole else self.domain.rim(n)).T)

    def __reduce__(self):
        # NGSolve's own pickles hold no checks, and need the same version.
        from .load import restored
        from .save import contents

        return restored, (contents(self), self.scene if self.scene.recipe is None else None)

    @property
    def falls_short(self):
        """Whether the energy is not known as well as the solve was asked for."""
        accuracy, bar = self.settings.get("accuracy"), self.error["energy"]
        if accuracy is None:
            return False
        least = NO_ENERGY * self.scene.fabric.stiffness * self.area
        return bar is None or bar > max(accuracy * abs(self.energy), least)

    @property
    def why(self):
        """`reason` in words; if not converged, with what limits are missed by, and where."""
        from .certificate import check_limits

        checks = () if self.converged else check_limits(self)
        return "; ".join([str(self.reason), *(str(check) for check in checks if not check.holds)])

    def __str__(self):
        return summary(self)

    @cached_property
    def equilibrium_residual(self):
        """How far the pinned cloth is from in-plane equilibrium, between 0 and 1.

        The force with which the cloth slides, dE(ψ)[v] for all v one order richer than ψ that
        vanish on the rim (eq. 16), over the same for all v, the rim included. Forces of strains
        below 1e-9 count as none. Where the rim carries no force either, as without active limits,
        the ratio says little.
        """
        return equilibrium_residual(Patch(self))

    @property
    def _psi(self):
        return self.state.components[:2]

    @property
    def _mesh(self):
        return self.state.space.mesh

    @cached_property
    def _cloth(self):
        sheet, psi = self.sheet, self._psi
        tensors = sheet.metric, self.scene.fabric, lambda: sheet.curvature
        return Kinematics(gradient(*psi), *tensors, psi)

    @cached_property
    def _fields(self):
        cloth = self._cloth
        return {
            **{f"stretch{k}": stretch for k, stretch in enumerate(cloth.stretches, 1)},
            "shear": cloth.shear,
            "angle": cloth.angle,
            "thickness": cloth.thickness,
            "reaction": cloth.reaction,
            "jacobian": cloth.jacobian,
        }

    def _integral(self, density):
        """Integral over the whole flat patch."""
        rule = ngs.dx(bonus_intorder=2 * self.settings["order"])
        integral = ngs.Integrate(self._cloth.jacobian * density * rule, self._mesh)
        return self.scene.copies * integral

    def _folded(self, theta1, theta2):
        """Images (n, 2) of the points in the meshed domain, and the signs (..., 2) of ψ there."""
        try:
            theta = np.stack(np.broadcast_arrays(theta1, theta2), axis=-1).astype(
                float, casting="safe"
            )
        except (TypeError, ValueError):
            allowed = "real numbers or arrays that broadcast against each other"
            raise InputError("theta", (theta1, theta2), allowed) from None
        domain = self.domain
        outside = ~domain.contains(theta)
        if outside.any():
            raise InputError("theta", tuple(theta[outside][0].tolist()), f"a point of {domain}")
        sign = np.ones_like(theta)
        if self.scene.symmetric:
            away = theta - domain.centre
            sign[away * domain.quarter < 0] = -1
            theta = domain.centre + sign * away
        return theta.reshape(-1, 2), sign

    def _located(self, theta):
        """Mesh points at or right beside `theta`, and what is missing, θ − θ(point), (n, 2).

        Curved elements follow the rim up to interpolation error: points of the rim may lie
        outside every element by as much, and are approached from the centre.
        """
        if self._from_file:
            return self._meshed.located(theta), np.zeros_like(theta)
        centre = self.domain.centre
        inside, points = theta.copy(), self._mesh(*theta.T)
        if self.scene.symmetric:
            centre = centre + 0.25 * self.domain.diameter
        for shrink in (*10.0 ** np.arange(-13, -2), *np.linspace(0.01, 0.3, 30)):
            missing = np.flatnonzero(points["nr"] < 0)
            if not missing.size:
                break
            inside[missing] = centre + (1 - shrink) * (theta[missing] - centre)
            points[missing] = self._mesh(*inside[missing].T)
        return points, theta - inside


def _at(expression, points):
    values = np.asarray(expression(points))
    return values.reshape(len(points), *(expression.dims or ()))
