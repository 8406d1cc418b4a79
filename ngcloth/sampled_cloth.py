"""The cloth at the sampling points, as numbers, with derivatives by the gradient of ψ."""

import ngsolve as ngs
import numpy as np

from .kinematics import Kinematics
from .lagrangian import of_state
from .sampling import sampled


class SampledCloth(Kinematics):
    """The state of the cloth at the sampling points.

    What depends on ∇ψ does so through C, G⁻ᵀ b G⁻¹ or G itself. Here these are fields of numbers:
    expressions in them are short to evaluate and to differentiate, and how they change with G is
    known in closed form. Expressions down to ψ take several times as long.

    Parameters
    ----------
    state : GridFunction
        The current ψ1, ψ2, …
    psi : Sampling
        Of a component of ψ.
    points : IntegrationRuleSpace
    metric, fabric, curvature
        As for `Kinematics`, the tensors as fields of these points.

    Attributes
    ----------
    variables : list of GridFunction
        G11, G12, G21, G22, C11, C22, C12, and the same of G⁻ᵀ b G⁻¹ if that is asked for.
    """

    def __init__(self, state, psi, points, metric, fabric, curvature):
        self.state, self.points, self._psi = state, points, psi
        self.variables, self._tensors = [ngs.GridFunction(points) for _ in range(4)], []
        super().__init__(ngs.CF(tuple(self.variables), dims=(2, 2)), metric, fabric, curvature)

    def pushed(self, tensor):
        """As for `Kinematics`, but of tensors that do not depend on ψ."""
        entries = sampled(tensor.Compile(), ngs.GridFunction(self.points**4))
        self._tensors.append(entries.reshape(2, 2, -1))
        self.variables += [ngs.GridFunction(self.points) for _ in range(3)]
        return tuple(self.variables[-3:])

    @of_state
    def gradients(self):
        """G at the points, (2, 2, points)."""
        coefficients = (psi.vec.FV().NumPy() for psi in self.state.components[:2])
        return np.array([self._psi.at_points(row)[1:] for row in coefficients])

    @of_state
    def jacobians(self):
        """J at the points, (points,)."""
        (g11, g12), (g21, g22) = self.gradients()
        return g11 * g22 - g12 * g21

    @of_state
    def inverses(self):
        """G⁻¹ at the points, (2, 2, points)."""
        (g11, g12), (g21, g22) = self.gradients()
        return np.array([[g22, -g12], [-g21, g11]]) / self.jacobians()

    @of_state
    def pushed_tensors(self):
        """C, and G⁻ᵀ b G⁻¹ if that is asked for, at the points: a list of (2, 2, points)."""
        inverse = self.inverses()
        halves = (np.einsum("ian,ijn->ajn", inverse, tensor) for tensor in self._tensors)
        return [np.einsum("ajn,jbn->abn", half, inverse) for half in halves]

    @of_state
    def slopes(self):
        """Derivatives of C11, C22, C12, … by G11, G12, G21, G22: (variables − 4, 4, points)."""
        inverse, slopes = self.inverses(), []
        for pushed in self.pushed_tensors():
            # dT = −(Yᵀ T + T Y), where row i of Y = dG G⁻¹ is row j of G⁻¹ and the other is zero.
            half = -np.einsum("jan,ibn->abijn", inverse, pushed)
            slopes += [2 * half[0, 0], 2 * half[1, 1], half[0, 1] + half[1, 0]]
        return np.array(slopes).reshape(len(slopes), 4, -1)

    @of_state
    def update(self):
        """Set `variables` to their values at the current state."""
        values = list(self.gradients().reshape(4, -1))
        for (t11, t12), (_, t22) in self.pushed_tensors():
            values += [t11, t22, t12]
        for field, row in zip(self.variables, values, strict=True):
            field.vec.FV().NumPy()[:] = row


class SampledExpressions:
    """Expressions in what a `SampledCloth` offers, at the sampling points.

    Parameters
    ----------
    cloth : SampledCloth
    expressions : list of CoefficientFunction
    """

    def __init__(self, cloth, expressions):
        self._cloth, self._number, self.state = cloth, len(expressions), cloth.state
        self._values = _Stacked(expressions, cloth.points)
        derivatives = {
            (row, column): expression.Diff(variable)
            for row, expression in enumerate(expressions)
            for column, variable in enumerate(cloth.variables)
        }
        # NGSolve simplifies what is zero, but only its name tells.
        partial = {at: d for at, d in derivatives.items() if str(d) != "ZeroCoefficientFunction"}
        self._places, self._partial = list(partial), _Stacked(partial.values(), cloth.points)

    @of_state
    def values(self):
        """Their values, (expressions, points)."""
        self._cloth.update()
        return self._values()

    @of_state
    def slopes(self):
        """Their derivatives by G11, G12, G21, G22, (expressions, 4, points)."""
        self._cloth.update()
        slopes = np.zeros((self._number, 4, self._cloth.points.ndof))
        for (row, column), partial in zip(self._places, self._partial(), strict=True):
            if column < 4:
                slopes[row, column] += partial
            else:
                slopes[row] += partial * self._cloth.slopes()[column - 4]
        return slopes


class _Stacked:
    """Expressions to be sampled all at once."""

    def __init__(self, expressions, points):
        self._expression = ngs.CF(tuple(expressions)).Compile() if expressions else None
        self._field = ngs.GridFunction(points ** max(len(expressions), 1))

    def __call__(self):
        if self._expression is None:
            return np.empty((0, self._field.vec.size))
        return sampled(self._expression, self._field)
