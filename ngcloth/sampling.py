"""Shape functions at the sampling points, as arrays over the triangles."""

import ngsolve as ngs
import numpy as np


class Sampling:
    """From a scalar function to its value and gradient at the sampling points, and transposed.

    Parameters
    ----------
    space : H1
        Of one order, on triangles.
    points : IntegrationRuleSpace
    dx : DifferentialSymbol
        With the rules of `points`.

    Attributes
    ----------
    shapes : ndarray, (3, triangles, points of a triangle, dofs of a triangle)
        Values and both derivatives of the shape functions.
    dofs : ndarray, (triangles, dofs of a triangle)
        Their numbers in `space`.
    """

    def __init__(self, space, points, dx):
        samples, triangles = points**3, space.mesh.ne
        trial, test = space.TrialFunction(), samples.TestFunction()
        form = ngs.BilinearForm(trialspace=space, testspace=samples)
        form += ngs.CF((trial, ngs.grad(trial))) * test * dx
        entries, columns, _ = (part.NumPy() for part in form.Assemble().mat.CSR())
        weights = point_weights(points, dx).reshape(triangles, -1, 1)
        at_one = weights.shape[1]
        self.shapes = entries.reshape(3, triangles, at_one, -1) / weights
        self.dofs = columns.reshape(3, triangles, at_one, -1)[0, :, 0].copy()
        self._ndof = space.ndof

    def at_points(self, coefficients):
        """Value and both derivatives, (3, points), of the function with these (dofs,)."""
        samples = np.einsum("mtqn,tn->mtq", self.shapes, coefficients[self.dofs])
        return samples.reshape(3, -1)

    def transposed(self, samples):
        """`at_points` transposed: from (3, points), or (2, points) without values, to (dofs,)."""
        shapes = self.shapes[-len(samples) :]
        loads = np.einsum("mtqn,mtq->tn", shapes, samples.reshape(shapes.shape[:3]))
        return np.bincount(self.dofs.ravel(), loads.ravel(), self._ndof)


def point_weights(points, dx, density=1.0):
    """The weights, (points,), with which sums over the points are integrals of `density`."""
    form = ngs.LinearForm(points)
    form += density * points.TestFunction() * dx
    return form.Assemble().vec.FV().NumPy().copy()


def sampled(expression, field):
    """Values of an expression, (components, points); `field` is a GridFunction of these points."""
    field.Interpolate(expression)
    return field.vec.FV().NumPy().reshape(expression.dim, -1).copy()
