"""Target surfaces: a chart φ on a domain U, and its geometry by symbolic differentiation."""

import numbers
from collections import deque
from functools import cached_property
from types import FunctionType

import ngsolve as ngs
import numpy as np
from netgen.meshing import NgException
from ngsolve.meshes import MakeStructured2DMesh

from ..errors import InputError
from ..geometry.sheet import Sheet
from . import returned
from .domain import Domain
from .heights import Heights
from .smoothness import Lattice, disagreement

SINGULAR = 1e-14  # det a/tr² a at most
FALLS = (10, 10, 10, 1e6)  # of `_measures` towards a singular point: 1e6 is nearly an apex


class Surface:
    """The surface φ(U) that the cloth has to cover.

    Parameters
    ----------
    chart : callable
        ``chart(θ1, θ2)`` returns the three components of φ, written with NGSolve's functions
        (``ngsolve.sin``, ``ngsolve.sqrt``, …) so that it can be differentiated.
    domain : Domain
        The parameter domain U, a `Disk` or a `Rectangle`.
    side : {1, -1}, optional
        The cloth lies on the side of ``side * ∂1φ × ∂2φ``. Default 1.

    Attributes
    ----------
    position : CoefficientFunction, (3,)
        φ as an expression of the mesh coordinates x = θ1, y = θ2.
    normal : CoefficientFunction, (3,)
        Unit normal n on the side of the cloth.
    metric, curvature : CoefficientFunction, (2, 2)
        First and second fundamental form, a = ∇φᵀ∇φ and b = ∂²φ·n.
    unit : str
        What a unit of length is called, in plots and reports; charts do not tell.

    Raises
    ------
    InputError
        If the domain has holes or several pieces, the chart has not three real components, its
        metric is singular or not finite somewhere on the domain, or its derivatives are not those
        of its values.
    """

    unit = "length"

    def __init__(self, chart, domain, side=1):
        if not isinstance(domain, Domain):
            raise InputError("domain", domain, "a Disk, a Rectangle or another Domain")
        domain.check_face()
        if isinstance(side, bool) or not isinstance(side, numbers.Integral) or abs(side) != 1:
            raise InputError("side", side, "1 or -1, the side of ∂1φ × ∂2φ on which the cloth lies")
        if not callable(chart):
            raise InputError("chart", chart, "a callable of (θ1, θ2) with three components")
        self.chart, self.domain, self.side = chart, domain, side

        told = "chart", chart, "chart(θ1, θ2)", "three components of φ"
        self.position = returned.vector(*told, 3, chart)
        try:
            first, second = self._tangents = [self.position.Diff(t) for t in (ngs.x, ngs.y)]
            self._bends = first.Diff(ngs.x), first.Diff(ngs.y), second.Diff(ngs.y)
        except NgException as error:
            raise returned.refusal(*told, f"that can be differentiated twice: {error}") from error
        self._check_geometry()

    @classmethod
    def from_heights(cls, x, y, z, domain=None, side=1):
        """The surface (θ1, θ2, z(θ1, θ2)) through heights on a grid, by splines of degree five.

        The splines run through all heights, and curvature feels noise strongly: smooth what was
        measured.

        Parameters
        ----------
        x, y : array_like, (nx,), (ny,)
            Where the grid lines run, six or more each, increasing and evenly spaced.
        z : array_like, (nx, ny)
            The heights, z[i, j] at (x[i], y[j]).
        domain : Domain, optional
            A part of the grid's rectangle, which it is by default.
        side : {1, -1}, optional
            As for `Surface`; 1 is the side of greater z.

        Returns
        -------
        Surface

        Raises
        ------
        InputError
            If this is no such grid, has more than 1e6 points, or does not cover the domain.
        """
        heights = Heights(x, y, z)
        rectangle = heights.rectangle
        domain = rectangle if domain is None else domain
        if isinstance(domain, Domain) and not rectangle.contains(domain.sample()).all():
            raise InputError("domain", domain, f"a part of the grid's {rectangle}")
        return cls(heights, domain, side)

    @staticmethod
    def from_cad(path, faces=None, unit="mm", side=1):
        """Read a surface from a CAD file, see `ngcloth.geometry.cad.from_cad`."""
        from ..geometry.cad import from_cad

        return from_cad(path, faces, unit, side)

    @staticmethod
    def from_mesh(source, unit="mm", smoothing="auto", side=1):
        """Make a surface from facets, see `ngcloth.geometry.facets.from_mesh`."""
        from ..geometry.facets import from_mesh

        return from_mesh(source, unit, smoothing, side)

    def __reduce__(self):
        # NGSolve's expressions are made anew from the chart.
        return type(self), (self.chart, self.domain, self.side)

    @cached_property
    def metric(self):  # noqa: D102
        first, second = self._tangents
        return ngs.CF((first * first, first * second, first * second, second * second), dims=(2, 2))

    @cached_property
    def normal(self):  # noqa: D102
        across = ngs.Cross(*self._tangents)
        return self.side / ngs.Norm(across) * across

    @cached_property
    def curvature(self):  # noqa: D102
        b11, b12, b22 = (ngs.InnerProduct(bend, self.normal) for bend in self._bends)
        return ngs.CF((b11, b12, b12, b22), dims=(2, 2))

    @property
    def diameter(self):
        """Of the domain."""
        return self.domain.diameter

    def on(self, mesh):
        """The surface on a mesh of the domain, a `Sheet`."""
        return Sheet(
            mesh=mesh,
            position=self.position,
            tangents=tuple(self._tangents),
            normal=self.normal,
            metric=self.metric,
            curvature=self.curvature,
            shape=ngs.Inv(self.metric) * self.curvature,
            side=self.side,
        )

    @cached_property
    def _frame(self):
        """One quadrilateral over a box around the domain.

        Expressions are evaluated on it at points that belong to no mesh.
        """
        (low1, high1), (low2, high2) = self.domain.box
        width, height = high1 - low1, high2 - low2
        return MakeStructured2DMesh(
            quads=True,
            nx=1,
            ny=1,
            mapping=lambda s, t: (low1 + (2 * s - 0.5) * width, low2 + (2 * t - 0.5) * height),
        )

    def evaluate(self, expression, theta):
        """Values of an expression of x = θ1, y = θ2 at points of the parameter plane.

        Parameters
        ----------
        expression : CoefficientFunction
            Any expression of the coordinates, such as `metric`.
        theta : array_like, (..., 2)
            Points within the bounding box of the domain, or up to half its size beyond.

        Returns
        -------
        ndarray, (...) + expression.dims

        Raises
        ------
        InputError
            For points farther out.
        """
        theta = np.asarray(theta, dtype=float)
        low, high = np.transpose(self.domain.box)
        outside = ~(np.abs(theta - (low + high) / 2) <= high - low).all(axis=-1)
        if outside.any():
            where = tuple(theta[outside][0].tolist())
            raise InputError("theta", where, f"a point in or about {self.domain}")
        points = self._frame(*theta.reshape(-1, 2).T)
        values = np.asarray(expression.Compile()(points))
        return values.reshape(theta.shape[:-1] + tuple(expression.dims))

    def _check_geometry(self):
        expression = ngs.CF((self.position, *self._tangents, *self._bends)).Compile()

        def sample(points):
            with np.errstate(all="ignore"):
                return np.asarray(expression(self._frame(*points.T))).reshape(-1, 6, 3)

        def measures(points):
            return _measures(sample(points), self.domain.diameter)

        # The domain's own points come first: where its grid meets a pole, it meets it exactly.
        own = self.domain.sample()
        known = _known(self.chart, self.domain, sample(own))
        if known in _CHECKED:
            return
        lattice = Lattice(self.domain)
        points = np.concatenate([own, lattice.points])
        values = sample(points)
        numbers = _measures(values, self.domain.diameter)
        bad = ~(np.isfinite(values[:, :3]).all(axis=(1, 2)) & (numbers[0] > SINGULAR))
        where = points[np.argmax(bad)] if bad.any() else None
        if where is None:
            where = lattice.singular_point(measures, numbers[:, len(own) :], FALLS)
        if where is not None:
            allowed = "its metric a = ∇φᵀ∇φ is singular or not finite at this point of the domain"
            raise InputError("chart", tuple(map(float, where)), allowed)
        found = disagreement(
            lambda points: _slopes(sample(points)),
            lattice.points,
            lattice.pairs,
            _slopes(values[len(own) :]),
        )
        if found:
            allowed = (
                "near this point first or second derivatives of φ are not those of its values: a "
                "step, a crease, or a field or table that NGSolve does not differentiate (heights "
                "on a grid make an ngcloth.Surface.from_heights)"
            )
            raise InputError("chart", tuple(map(float, found[0])), allowed)
        if known is not None:
            _CHECKED.append(known)


_CHECKED = deque(maxlen=16)  # what `_known` says of surfaces that passed: a study has many alike


def _known(chart, domain, values):
    """What a surface is: its chart by code and values closed over, and numbers at some points.

    The numbers tell what has changed meanwhile without a trace in the chart, such as a global
    variable. None for a chart or a domain that cannot be compared.
    """
    try:
        if isinstance(chart, FunctionType):
            cells = tuple(cell.cell_contents for cell in chart.__closure__ or ())
            named = tuple((chart.__kwdefaults__ or {}).items())
            chart = chart.__code__, chart.__defaults__, named, cells
        known = chart, domain, values.tobytes()
        hash(known)
    except (TypeError, ValueError):
        return None
    return known


def _measures(values, diameter):
    """Four positive numbers at each point that fall to zero at singular points, (4, n).

    They are det a/tr² a, tr a, its inverse, and the inverse of the largest curvature.

    Parameters
    ----------
    values : ndarray, (n, 6, 3)
        φ, ∂1φ, ∂2φ, ∂11φ, ∂12φ, ∂22φ.
    diameter : float
        Of the domain.
    """
    with np.errstate(all="ignore"):
        a11, a12, a22 = (
            np.einsum("nc,nc->n", values[:, i], values[:, j]) for i, j in ((1, 1), (1, 2), (2, 2))
        )
        trace = a11 + a22
        bend = diameter**2 * (values[:, 3:] ** 2).sum(axis=(1, 2)) / trace
        flatness = np.where(np.isnan(bend), 1.0, 1 / (1 + bend))
        return np.array([(a11 * a22 - a12**2) / trace**2, trace, 1 / trace, flatness])


def _slopes(values):
    """φ, ∂1φ and ∂2φ, (n, 9), and their derivatives, (n, 9, 2), of `values` as for `_measures`."""
    slopes = values[:, [[1, 2], [3, 4], [4, 5]]]
    return values[:, :3].reshape(-1, 9), slopes.swapaxes(2, 3).reshape(-1, 9, 2)
