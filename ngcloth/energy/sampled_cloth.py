"""The cloth at the sampling points, as numbers, with derivatives by the gradient of ψ."""

from functools import cached_property

import ngsolve as ngs
import numpy as np

from ..problem.kinematics import Kinematics
from .discretisation import of_state


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
    points : Points
    metric, fabric, curvature
        As for `Kinematics`, the tensors as fields of these points.

    Attributes
    ----------
    unknowns : ndarray
        Those of ψ1 and ψ2.
    variables : list of GridFunction
        G11, G12, G21, G22, C11, C22, C12, and the same of G⁻ᵀ b G⁻¹ if that is asked for.
    """

    def __init__(self, state, psi, points, metric, fabric, curvature):
        self.state, self.points, self._psi = state, points, psi
        self.unknowns = state.vec.FV().NumPy()[: state.space.Range(1).stop]
        self.variables, self._tensors = [points.field() for _ in range(4)], []
        super().__init__(ngs.CF(tuple(self.variables), dims=(2, 2)), metric, fabric, curvature)

    def pushed(self, tensor):
        """As for `Kinematics`, but of tensors that do not depend on ψ."""
        self._tensors.append(self.points.sample(tensor.Compile()).reshape(2, 2, -1))
        self.variables += [self.points.field() for _ in range(3)]
        return tuple(self.variables[-3:])

    @of_state
    def gradients(self):
        """G at the points, (2, 2, points)."""
        return self._psi.at_points(self.unknowns.reshape(2, -1))[:, 1:]

    @of_state
    def jacobians(self):
        """J at the points, (points,)."""
        (g11, g12), (g21, g22) = self.gradients()
        return g11 * g22 - g12 * g21

    def jacobian_slopes(self):
        """Derivatives of J by G11, G12, G21, G22, (4, points)."""
        (g11, g12), (g21, g22) = self.gradients()
        return np.array([g22, -g21, -g12, g11])

    @of_state
    def inverses(self):
        """G⁻¹ at the points, (2, 2, points)."""
        (g11, g12), (g21, g22) = self.gradients()
        return np.array([[g22, -g12], [-g21, g11]]) / self.jacobians()

    @of_state
    def pushed_tensors(self):
        """C, and G⁻ᵀ b G⁻¹ if that is asked for: a list of `PushedTensor`."""
        return [PushedTensor(self.inverses(), tensor) for tensor in self._tensors]

    @of_state
    def slopes(self):
        """Derivatives of each of `variables` by G11, G12, G21, G22, (4, points) or (4, 1)."""
        pushed = (row for tensor in self.pushed_tensors() for row in tensor.slopes)
        return [*np.eye(4)[:, :, None], *pushed]

    def bend(self, weights):
        """Second derivatives by G of the sum of `variables` times weights (variables, points)."""
        tensors = self.pushed_tensors()
        by_tensor = weights[4:].reshape(len(tensors), 3, -1)
        return sum(tensor.bend(part) for tensor, part in zip(tensors, by_tensor, strict=True))

    @of_state
    def update(self):
        """Set `variables` to their values at the current state."""
        values = [*self.gradients().reshape(4, -1)]
        values += [row for tensor in self.pushed_tensors() for row in tensor.entries]
        for field, row in zip(self.variables, values, strict=True):
            field.vec.FV().NumPy()[:] = row


class PushedTensor:
    """T = G⁻ᵀ t G⁻¹, a symmetric tensor t of the surface along the threads, at the points.

    Parameters
    ----------
    inverse, tensor : ndarray, (2, 2, points)
        G⁻¹ and t.

    Attributes
    ----------
    entries : ndarray, (3, points)
        T11, T22, T12.
    """

    def __init__(self, inverse, tensor):
        self._inverse = inverse
        half = np.einsum("ian,ijn->ajn", inverse, tensor)
        self._whole = np.einsum("ajn,jbn->abn", half, inverse)
        (t11, t12), (_, t22) = self._whole
        self.entries = np.array([t11, t22, t12])

    @cached_property
    def slopes(self):
        """Derivatives of `entries` by G11, G12, G21, G22, (3, 4, points)."""
        # dT = −(Yᵀ T + T Y), where row i of Y = dG G⁻¹ is row j of G⁻¹ and the other is zero.
        half = -np.einsum("jan,ibn->abijn", self._inverse, self._whole)
        slopes = np.array([2 * half[0, 0], 2 * half[1, 1], half[0, 1] + half[1, 0]])
        return slopes.reshape(3, 4, -1)

    def bend(self, weights):
        """Second derivatives by G of the sum of `entries` times `weights`, (4, 4, points).

        With that sum as M : T, and Y and Z from two changes of G as in `slopes`, they are
        2 M : (T Y Z + T Z Y + Yᵀ T Z), as Y itself changes by −Y Z.

        Parameters
        ----------
        weights : ndarray, (3, points)
            One for each entry.
        """
        w11, w22, w12 = weights
        turned = np.einsum("lan,abn->lbn", self._inverse, [[w11, w12 / 2], [w12 / 2, w22]])
        mixed = np.einsum("lbn,bin->lin", turned, self._whole)
        mixed = np.einsum("jkn,lin->ijkln", self._inverse, mixed)
        bend = np.einsum("ikn,lan,jan->ijkln", self._whole, turned, self._inverse)
        bend += mixed
        bend += mixed.transpose(2, 3, 0, 1, 4)
        bend *= 2
        return bend.reshape(4, 4, -1)


class SampledExpressions:
    """Expressions in what a `SampledCloth` offers, at the sampling points, all evaluated at once.

    Parameters
    ----------
    cloth : SampledCloth
    **groups : list of CoefficientFunction
        By the name under which to ask for them.
    """

    def __init__(self, cloth, **groups):
        self._cloth, self.unknowns = cloth, cloth.unknowns
        ends = np.cumsum([len(group) for group in groups.values()])
        self._rows = {
            name: slice(int(end) - len(group), int(end))
            for (name, group), end in zip(groups.items(), ends, strict=True)
        }
        expressions = [expression for group in groups.values() for expression in group]
        self._number = len(expressions)
        self._values = _Stacked(expressions)
        self._firsts = _partial_derivatives(enumerate(expressions), cloth.variables)
        self._first_values = _Stacked(self._firsts.values())

    def values(self, name):
        """Their values, (expressions of this name, points)."""
        return self._all_values()[self._rows[name]]

    def slopes(self, name):
        """Their derivatives by G11, G12, G21, G22, (expressions of this name, 4, points)."""
        return self._all_slopes()[self._rows[name]]

    def partials(self, name):
        """Their derivatives by the cloth's variables that do not vanish, (derivatives, points)."""
        rows = self._rows[name]
        chosen = [rows.start <= row < rows.stop for row, _ in self._firsts]
        return self._all_partials()[chosen]

    def bend(self, **weights):
        """Second derivatives by G of their sum times weights, (4, 4, points).

        Parameters
        ----------
        **weights : ndarray, (expressions of this name, points)
            For all groups.
        """
        weights = np.concatenate([weights[name] for name in self._rows])
        slopes = self._cloth.slopes()
        firsts = np.zeros((len(slopes), len(self._cloth.points)))
        for (row, variable), partial in zip(self._firsts, self._all_partials(), strict=True):
            firsts[variable] += weights[row] * partial
        bend = self._cloth.bend(firsts)
        places, seconds = self._seconds
        factors = [
            (weights[row] * second * (0.5 if one == other else 1) * slopes[one], slopes[other])
            for (row, one, other), second in zip(
                places, seconds.at(self._cloth.points), strict=True
            )
        ]
        return bend + symmetric_products(*zip(*factors, strict=True)) if factors else bend

    @of_state
    def _all_values(self):
        self._cloth.update()
        return self._values.at(self._cloth.points)

    @of_state
    def _all_slopes(self):
        slopes = np.zeros((self._number, 4, len(self._cloth.points)))
        for (row, variable), partial in zip(self._firsts, self._all_partials(), strict=True):
            slopes[row] += partial * self._cloth.slopes()[variable]
        return slopes

    @of_state
    def _all_partials(self):
        self._cloth.update()
        return self._first_values.at(self._cloth.points)

    @cached_property
    def _seconds(self):
        """Places (expression, variable, variable) of second derivatives, and their values."""
        variables = self._cloth.variables
        seconds = {
            (*at, other): second
            for (at, other), second in _partial_derivatives(self._firsts.items(), variables).items()
            if other <= at[1]
        }
        return list(seconds), _Stacked(seconds.values())


def symmetric_products(left, right):
    """The sum of l rᵀ + r lᵀ over pairs of l and r, each (4, points): (4, 4, points)."""
    half = np.einsum("kin,kjn->ijn", left, np.broadcast_arrays(*right))
    return half + half.swapaxes(0, 1)


def _partial_derivatives(named, variables):
    """Those of named expressions that do not vanish, by (name, number of the variable)."""
    derivatives = {
        (name, number): expression.Diff(variable)
        for name, expression in named
        for number, variable in enumerate(variables)
    }
    # NGSolve simplifies what is zero, but only its name tells.
    return {at: d for at, d in derivatives.items() if str(d) != "ZeroCoefficientFunction"}


class _Stacked:
    """Expressions to be sampled all at once."""

    def __init__(self, expressions):
        self._expression = ngs.CF(tuple(expressions)).Compile() if expressions else None

    def at(self, points):
        """Their values, (expressions, points)."""
        if self._expression is None:
            return np.empty((0, len(points)))
        return points.sample(self._expression)
