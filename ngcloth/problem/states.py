"""Fabric, limits and cost of a scene, tried in many states of the cloth scattered over the surface.

Their derivatives have to be those of their values; and in a symmetric scene the mirror image of a
state has to be as good as the state.
"""

import ngsolve as ngs
import numpy as np
from netgen.meshing import NgException
from ngsolve.meshes import MakeStructured3DMesh

from ..errors import InputError
from . import returned
from .kinematics import Kinematics
from .smoothness import disagreement

PLACES = 16  # along each side of the domain's box: at each a line in the space of ∇ψ
STEPS = 16  # along a line
STRETCH, SHEAR = (0.7, 1.4), 0.6  # to which the lines lead: cloth in use
SAME = 1e-8  # to what part of their size values of mirror images agree
MIRRORS = np.array([np.diag([-1.0, 1.0]), np.diag([1.0, -1.0])])


class States:
    """Lines in the space of ∇ψ, from the undeformed cloth to other states, one at each place.

    Every other line leads to the start of the scene.

    Parameters
    ----------
    scene : Scene
    start_slopes : CoefficientFunction, (2, 2)
        ∇ψ of its start.
    """

    def __init__(self, scene, start_slopes):
        self._scene, self._surface = scene, scene.tried_on
        low, high = self._box = np.array(self._surface.domain.box, dtype=float).T
        middles = low + (high - low) * (np.arange(PLACES)[:, None] + 0.5) / PLACES
        places = np.stack(np.meshgrid(*middles.T), axis=-1)
        self._known = self._surface.domain.contains(places)
        self._places = places[self._known]
        values, vectors = np.linalg.eigh(self._at(self._surface.metric))
        root = (vectors * np.sqrt(values)[:, None]) @ vectors.swapaxes(1, 2)
        scattered, turn = _scattered(len(root))
        start = self._at(start_slopes)
        left, _, right = np.linalg.svd(start @ np.linalg.inv(root))
        chosen = np.arange(len(root))[:, None, None] % 2 == 1
        # Turned so that only positive stretches lie between, and J > 0.
        undeformed = np.where(chosen, left @ right, turn) @ root
        self._lines = np.array([undeformed, np.where(chosen, start, scattered @ turn @ root)])
        # θ1, θ2, and how far along the line.
        self._frame = MakeStructured3DMesh(
            nx=1,
            ny=1,
            nz=1,
            mapping=lambda s, t, u: (*(low + (2 * np.array([s, t]) - 0.5) * (high - low)), u),
        )

    def check_derivatives(self):
        """Refuse what NGSolve differentiates wrongly.

        Raises
        ------
        InputError
        """
        cloth = self._cloth(self._lines)
        told, functions = self._functions(cloth)
        firsts, seconds = [], []
        for owner, function in zip(told, functions, strict=True):
            try:
                firsts.append(function.Diff(ngs.z))
                seconds.append(firsts[-1].Diff(ngs.z))
            except NgException as error:
                expected = f"what has two derivatives ({' '.join(str(error).split())})"
                raise InputError(*owner[:2], f"`{owner[2]}` must return {expected}") from error
        expression = ngs.CF((*functions, *firsts, *seconds)).Compile()
        n = len(functions)

        def sample(points):
            values = self._values(expression, points)
            return values[:, : 2 * n], values[:, n:, None]

        steps = np.linspace(0, 1, STEPS + 1)
        points = np.column_stack(
            [np.repeat(self._places, len(steps), axis=0), np.tile(steps, len(self._places))]
        )
        numbers = np.arange(len(points)).reshape(-1, len(steps))
        pairs = np.stack([numbers[:, :-1].ravel(), numbers[:, 1:].ravel()], axis=-1)
        found = disagreement(sample, points, pairs, sample(points))
        if found:
            where, component = found
            argument, owner, method = told[component % n]
            state = self._values(ngs.CF((cloth.I4, cloth.I6, cloth.I8)), where[None])[0]
            allowed = (
                f"derivatives of `{method}`, as NGSolve finds them, must be those of its values, "
                "and are not near I4 = {:.3g}, I6 = {:.3g}, I8 = {:.3g} "
                "at θ = ({:.3g}, {:.3g}): a step, a kink, a spline below its knots, where "
                "NGSolve's are zero, or a table or field that it does not differentiate"
            )
            raise InputError(argument, owner, allowed.format(*state, *where[:2]))

    def check_mirrors(self):
        """Refuse a law, a limit or a cost that tells a state from its mirror image.

        Raises
        ------
        InputError
        """
        told, here = self._mirror_values(self._lines, self._places)
        centre = self._surface.domain.centre
        for axis, mirror in enumerate(MIRRORS):
            image = self._places.copy()
            image[:, axis] = 2 * centre[axis] - image[:, axis]
            table = self._table(mirror @ self._lines @ mirror)
            lines = np.flip(table, axis=2 - axis)[:, self._known]
            _, there = self._mirror_values(lines, image)
            kinds = [argument for argument, *_ in told]
            for argument in dict.fromkeys(kinds):
                # Limits may change places: γ < γmax and −γ < γmax do.
                chosen = [kind == argument for kind in kinds]
                if not self._differ(here[:, chosen], there[:, chosen]).any():
                    continue
                for owner in (row for row in told if row[0] == argument):
                    chosen = [row == owner for row in told]
                    differs = self._differ(here[:, chosen], there[:, chosen])
                    if differs.any():
                        where = self._places[np.argmax(differs)]
                        allowed = (
                            f"`{owner[2]}` must have the mirror symmetry of the scene: at "
                            "θ = ({:.3g}, {:.3g}) it tells a state of the cloth from its mirror "
                            f"image across θ{axis + 1} = {centre[axis]:.4g}"
                        )
                        raise InputError(*owner[:2], allowed.format(*where))

    def _mirror_values(self, lines, places):
        """The functions and their values at the ends of the lines, (places, functions)."""
        told, functions = self._functions(self._cloth(lines))
        ends = np.column_stack([places, np.ones(len(places))])
        return told, self._values(ngs.CF(tuple(functions)).Compile(), ends)

    @staticmethod
    def _differ(one, other):
        one, other = np.sort(one, axis=1), np.sort(other, axis=1)
        size = np.abs(one) + np.nanmedian(np.abs(one), axis=0)
        with np.errstate(invalid="ignore"):
            return (np.abs(one - other) > SAME * size).any(axis=1)

    def _at(self, expression):
        return self._surface.evaluate(expression, self._places)

    def _values(self, expression, points):
        """Values of an expression at points (θ1, θ2, way along the line), (n, components)."""
        with np.errstate(all="ignore"):
            return np.asarray(expression(self._frame(*points.T))).reshape(len(points), -1)

    def _table(self, lines):
        """Lines of the places in the grid of all, (2, rows, columns, 2, 2)."""
        table = np.full((2, *self._known.shape, 2, 2), np.eye(2))
        table[:, self._known] = lines
        return table

    def _cloth(self, lines):
        """The cloth along lines (2, places, 2, 2) from ∇ψ to ∇ψ; z is the way along them."""
        start, end = (
            ngs.CF(
                tuple(
                    ngs.VoxelCoefficient(*map(tuple, self._box), entry.copy(), linear=False)
                    for entry in np.moveaxis(table, (2, 3), (0, 1)).reshape(4, *self._known.shape)
                ),
                dims=(2, 2),
            )
            for table in self._table(lines)
        )
        surface = self._surface
        gradient = start + ngs.z * (end - start)
        # Across the middle of the patch: laws may depend on the place, too.
        place = [(1 - 1.5 * ngs.z) * psi for psi in self._scene.start_expression()]
        tensors = surface.metric, self._scene.fabric, lambda: surface.curvature
        return Kinematics(gradient, *tensors, place)

    def _functions(self, cloth):
        """What the scene asks of the cloth: (argument, owner, method) and expression of each."""
        scene = self._scene
        told = [("fabric", scene.fabric, f"{type(scene.fabric).__name__}.energy(I4, I6, I8)")]
        functions = [
            returned.energy(scene.fabric, cloth.I4, cloth.I6, cloth.I8, *cloth.bends, *cloth.place)
        ]
        for limit in scene.constraints:
            slacks = returned.slacks(limit, cloth)
            told += len(slacks) * [("constraints", limit, f"{type(limit).__name__}.slacks(cloth)")]
            functions += slacks
        if scene.cost is not None:
            told.append(("cost", scene.cost, "cost(cloth)"))
            functions.append(returned.cost_density(scene.cost, cloth))
        return told, functions


def _scattered(n):
    """C^(−1/2) of `n` states as in STRETCH and SHEAR, and rotations; each (n, 2, 2)."""
    drawn = np.random.default_rng(0)
    stretch = np.exp(drawn.uniform(*np.log(STRETCH), (n, 2)))
    shear = drawn.uniform(-SHEAR, SHEAR, n)
    angle = drawn.uniform(0, 2 * np.pi, n)
    one, other = stretch.T
    green = np.moveaxis(
        np.array([[one**2, one * other * shear], [one * other * shear, other**2]]), 2, 0
    )
    values, vectors = np.linalg.eigh(green)
    inverse_root = (vectors / np.sqrt(values)[:, None]) @ vectors.swapaxes(1, 2)
    turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    return inverse_root, np.moveaxis(turn, 2, 0)
