"""Target surfaces: a chart φ on a domain U, and its geometry by symbolic differentiation."""

import numbers
from functools import cached_property

import ngsolve as ngs
import numpy as np
from netgen.meshing import NgException
from ngsolve.meshes import MakeStructured2DMesh

from ..errors import InputError
from .domain import Domain


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

    Raises
    ------
    InputError
        If the domain has holes or several pieces, the chart has not three components, or its
        metric is singular or not finite somewhere on the domain.
    """

    def __init__(self, chart, domain, side=1):
        if not isinstance(domain, Domain):
            raise InputError("domain", domain, "a Disk, a Rectangle or another Domain")
        domain.check_face()
        if isinstance(side, bool) or not isinstance(side, numbers.Integral) or abs(side) != 1:
            raise InputError("side", side, "1 or -1, the side of ∂1φ × ∂2φ on which the cloth lies")
        if not callable(chart):
            raise InputError("chart", chart, "a callable of (θ1, θ2) with three components")
        self.chart, self.domain, self.side = chart, domain, side

        try:
            components = chart(ngs.x, ngs.y)
            if not isinstance(components, ngs.CoefficientFunction):
                components = ngs.CF(tuple(components))
        except (TypeError, ValueError, NgException) as error:
            raise InputError("chart", chart, f"three components of φ ({error})") from error
        if tuple(components.dims) != (3,):
            raise InputError(
                "chart", tuple(components.dims), "φ must have exactly three components"
            )
        self.position = components
        self._tangents = (components.Diff(ngs.x), components.Diff(ngs.y))
        self._check_metric()

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
        first, second = self._tangents
        b11, b12, b22 = (
            ngs.InnerProduct(derivative, self.normal)
            for derivative in (first.Diff(ngs.x), first.Diff(ngs.y), second.Diff(ngs.y))
        )
        return ngs.CF((b11, b12, b12, b22), dims=(2, 2))

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
        ndarray, (...) or (..., *expression.dims)
        """
        theta = np.asarray(theta, dtype=float)
        points = self._frame(*theta.reshape(-1, 2).T)
        values = np.asarray(expression.Compile()(points))
        return values.reshape(theta.shape[:-1] + tuple(expression.dims))

    def _check_metric(self):
        points = self.domain.sample()
        metric = self.evaluate(self.metric, points)
        with np.errstate(over="ignore", invalid="ignore"):
            finite = np.isfinite(metric).all(axis=(1, 2))
            trace = np.where(finite, metric[:, 0, 0] + metric[:, 1, 1], 1.0)
            determinant = metric[:, 0, 0] * metric[:, 1, 1] - metric[:, 0, 1] ** 2
            bad = ~finite | ~(determinant > 1e-14 * trace**2)
        if bad.any():
            where = tuple(float(t) for t in points[np.argmax(bad)])
            raise InputError(
                "chart",
                where,
                "its metric a = ∇φᵀ∇φ is singular or not finite at this point of the domain",
            )
