"""The cloth at the sampling points, as numbers, with derivatives by the gradient of ψ."""

from itertools import pairwise

import ngsolve as ngs
import numpy as np

from ..problem.kinematics import Kinematics
from .discretisation import of_state


class SampledCloth(Kinematics):
    """The state of the cloth at the sampling points.

    What depends on ∇ψ does so through C, G⁻ᵀ b G⁻¹ or G itself. Here these are fields of numbers:
    expressions in them are short to evaluate and to differentiate, and how they change with ψ is
    known in closed form. Expressions down to ψ take several times as long.

    A change of ψ by w changes G by Y G, Y = ∂w/∂X being the gradient of w in the flat plane. All
    derivatives are by Y11, Y12, Y21 and Y22, which keeps formulas short; `flat` has the Y of shape
    functions.

    Parameters
    ----------
    state : GridFunction
        The current ψ1, ψ2, …
    psi : Sampling
        Of a component of ψ.
    points : Points
    metric, fabric, curvature
        As for `Kinematics`, the tensors as fields of these points.

    Attributes
    ----------
    psi : Sampling
        Of a component of ψ, in the parameter plane.
    unknowns : ndarray
        Those of ψ1 and ψ2.
    variables : list of CoefficientFunction
        G11, G12, G21, G22, C11, C22, C12, and the same of G⁻ᵀ b G⁻¹ if that is asked for.
    """

    def __init__(self, state, psi, points, metric, fabric, curvature):
        self.state, self.points, self.psi = state, points, psi
        self.unknowns = state.vec.FV().NumPy()[: state.space.Range(1).stop]
        self.variables, self._numbers, self._tensors = [], [], []
        gradient = ngs.CF(self._variables(4), dims=(2, 2))
        super().__init__(gradient, metric, fabric, curvature)

    def pushed(self, tensor):
        """As for `Kinematics`, but of tensors that do not depend on ψ."""
        self._tensors.append(self.points.sample(tensor.Compile()).reshape(2, 2, -1))
        return self._variables(3)

    def _variables(self, number):
        """New ones, a tuple."""
        fields = [self.points.field() for _ in range(number)]
        # By the fields themselves NGSolve differentiates neither splines nor powers.
        variables = [1.0 * field for field in fields]
        self._numbers += [field.vec.FV().NumPy() for field in fields]
        self.variables += variables
        return tuple(variables)

    @of_state
    def gradients(self):
        """G at the points, (2, 2, points)."""
        return self.psi.at_points(self.unknowns.reshape(2, -1))

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
        """C, and G⁻ᵀ b G⁻¹ if that is asked for, each as 11, 22, 12: a list of (3, points)."""
        return [_pushed(self.inverses(), tensor) for tensor in self._tensors]

    @of_state
    def slopes(self):
        """Derivatives of each of `variables` by Y, (variables, 4, points)."""
        (g11, g12), (g21, g22) = self.gradients()
        none = np.zeros_like(g11)
        first, second = (g11, g21, none, none), (g12, g22, none, none)
        slopes = np.array([first, second, (*first[2:], *first[:2]), (*second[2:], *second[:2])])
        return np.concatenate([slopes, *(pushed_slopes(each) for each in self.pushed_tensors())])

    def bend(self, weights):
        """Second derivatives by Y of the sum of `variables` times weights (variables, points)."""
        tensors = self.pushed_tensors()
        by_tensor = weights[4:].reshape(len(tensors), 3, -1)
        return sum(map(pushed_bend, tensors, by_tensor))

    @of_state
    def flat(self):
        """Derivatives of ψ's shape functions in the flat plane, a `Sampling`."""
        return self.psi.flat(self.inverses())

    @of_state
    def update(self):
        """Set `variables` to their values at the current state."""
        values = [*self.gradients().reshape(4, -1)]
        values += [row for tensor in self.pushed_tensors() for row in tensor]
        for numbers, row in zip(self._numbers, values, strict=True):
            numbers[:] = row


def _pushed(inverse, tensor):
    """T = G⁻ᵀ t G⁻¹ as T11, T22, T12, (3, points), of t and G⁻¹, (2, 2, points)."""
    half = np.einsum("ian,ijn->ajn", inverse, tensor)
    (t11, t12), (_, t22) = np.einsum("ajn,jbn->abn", half, inverse)
    return np.array([t11, t22, t12])


def pushed_slopes(pushed):
    """Derivatives of T11, T22, T12 by Y, −(Yᵀ T + T Y), (3, 4, points). Linear in T."""
    t11, t22, t12 = pushed
    slopes = np.zeros((3, 4, len(t11)))
    slopes[0, 0], slopes[0, 2] = -2 * t11, -2 * t12
    slopes[1, 1], slopes[1, 3] = -2 * t12, -2 * t22
    slopes[2] = -t12, -t11, -t22, -t12
    return slopes


def pushed_bend(pushed, weights):
    """Second derivatives by Y of w11 T11 + w22 T22 + w12 T12, (4, 4, points). Linear in T and w.

    With Y and Z of two changes, and the sum as M : T, they are 2 M : (T Y Z + T Z Y + Yᵀ T Z).
    """
    (t11, t22, t12), (m11, m22, m12) = pushed, weights
    whole, turned = np.array([[t11, t12], [t12, t22]]), np.array([[m11, m12 / 2], [m12 / 2, m22]])
    bend = 2 * whole[:, None, :, None] * turned[:, None, :]
    product = 2 * np.einsum("abn,bcn->acn", whole, turned)
    for i in (0, 1):
        bend[:, i, i] += product
        bend[i, :, :, i] += product.swapaxes(0, 1)
    return bend.reshape(4, 4, -1)


class SampledExpressions:
    """Expressions in what a `SampledCloth` offers, at the sampling points, all evaluated at once.

    Parameters
    ----------
    cloth : SampledCloth
    expressions : list of CoefficientFunction
    """

    def __init__(self, cloth, expressions):
        self._cloth, self.unknowns, self.number = cloth, cloth.unknowns, len(expressions)
        self._firsts = partial_derivatives(enumerate(expressions), cloth.variables)
        seconds = {
            (*at, other): second
            for (at, other), second in partial_derivatives(
                self._firsts.items(), cloth.variables
            ).items()
            if other <= at[1]
        }
        self._seconds = list(seconds)  # places: expression, variable, variable
        self._all = Stacked(expressions, self._firsts.values(), seconds.values())

    @of_state
    def _evaluated(self):
        """Their values, and their first and second derivatives by variables."""
        self._cloth.update()
        return self._all.at(self._cloth.points)

    def values(self):
        """Their values, (expressions, points)."""
        return self._evaluated()[0]

    @of_state
    def slopes(self):
        """Their derivatives by Y, (expressions, 4, points)."""
        (_, firsts, _), of_variables = self._evaluated(), self._cloth.slopes()
        slopes = np.zeros((self.number, 4, len(self._cloth.points)))
        for (row, variable), first in zip(self._firsts, firsts, strict=True):
            slopes[row] += first * of_variables[variable]
        return slopes

    def bend(self, weights):
        """Second derivatives by Y of their sum times weights (expressions, points)."""
        (_, firsts, seconds), slopes = self._evaluated(), self._cloth.slopes()
        by_variable = np.zeros((len(slopes), len(self._cloth.points)))
        for (row, variable), first in zip(self._firsts, firsts, strict=True):
            by_variable[variable] += weights[row] * first
        bend = self._cloth.bend(by_variable)
        factors = [
            (weights[row] * second * (0.5 if one == other else 1) * slopes[one], slopes[other])
            for (row, one, other), second in zip(self._seconds, seconds, strict=True)
        ]
        return bend + symmetric_products(*zip(*factors, strict=True)) if factors else bend


def symmetric_products(left, right):
    """The sum of l rᵀ + r lᵀ over pairs of l and r, each (4, points): (4, 4, points)."""
    half = np.einsum("kin,kjn->ijn", left, right)
    return half + half.swapaxes(0, 1)


def partial_derivatives(named, variables):
    """Those of named expressions that do not vanish, by (name, number of the variable)."""
    derivatives = {
        (name, number): expression.Diff(variable)
        for name, expression in named
        for number, variable in enumerate(variables)
    }
    # NGSolve simplifies what is zero, but only its name tells.
    return {at: d for at, d in derivatives.items() if str(d) != "ZeroCoefficientFunction"}


class Stacked:
    """Groups of expressions to be sampled all at once, which takes little longer than for one."""

    def __init__(self, *groups):
        groups = [list(group) for group in groups]
        self._ends = np.cumsum([len(group) for group in groups])
        every = [expression for group in groups for expression in group]
        self._expression = ngs.CF(tuple(every)).Compile() if every else None

    def at(self, points):
        """Their values, an array (expressions, points) for each group."""
        none = self._expression is None
        values = np.empty((0, len(points))) if none else points.sample(self._expression)
        return [values[begin:end] for begin, end in pairwise([0, *self._ends])]
