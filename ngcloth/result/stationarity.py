"""Whether a ψ is stationary, and a minimum: what `ngcloth.verify` asks of the Lagrangian."""

from functools import cached_property

import numpy as np

from ..problem.cost_size import cost_size
from . import changes
from .elements import restricted
from .lanczos import lanczos
from .system import System, refined

AT_REST = 1e-2  # of the stress: what may be unbalanced in a scene without limits
BALANCED = 1e-3  # and in one with limits, or as much as a barrier can achieve
ROUND_OFF = 1e-9  # stress over kc that counts as none
RESOLVED = 0.05  # of the stress, or of kc: what a richer space may find unbalanced
EQUILIBRIUM = 0.075  # of the stress, a tenth of what reaches the rim: what may be unbalanced inside
UNFELT = 1e-2  # of kc, what a strain of 1e-3 makes: unbalanced, an error of the mesh
FLAT = 1e-2  # of the stress: curvature that counts as zero
# A strain: in a richer space no limit is nearer, else 1/c² drowns all other forces in rounding.
TOUCHING = 1e-7


class StationaryPoint:
    """L(ψ, v) = E(ψ) + dE(ψ)[v] − μ Σ ∫ log c dA over kc near the ψ of a result.

    Integrals are taken at the solver's own points, where alone the barrier exists. Those of the
    barrier are over the surface, along the rim with a weight of `RIM_SHARE` in all, and at points
    that the solve has added with the weight of a mean point of their triangle.
    """

    def __init__(self, patch, settings):
        self.patch, self.scene = patch, patch.scene
        self.degree = settings.get("multiplier_order")  # of v
        self.size, self._systems = cost_size(self.scene), {}
        self.mu = self.size * settings.get("barrier_end", 0.0)
        self.inside = patch.inside
        self.flat_areas = self.inside.flat_areas().ravel()
        areas = self.inside.areas().ravel()
        self.area = areas.sum()
        self.limits = []
        if self.scene.constraints:
            beside = patch.beside
            self.limits = [_Limits(self.inside, areas), _Limits(beside, beside.weights.ravel())]

    @property
    def interior(self):
        """Whether all limits hold at the points where they are imposed."""
        return all(limits.values.min(initial=np.inf) > 0 for limits in self.limits)

    @cached_property
    def cost(self):
        """Value, first and second derivatives by Z of what is minimised times J, over J and kc."""
        if self.scene.cost is None:
            return self.energy
        parts = self.inside.functions(lambda cloth: [self.scene.cost(cloth)])
        value, first, second = (part[0] / self.scene.fabric.stiffness for part in parts)
        return value, *changes.with_area(value, first, second)

    @cached_property
    def energy(self):
        """Likewise of W."""
        (density, slopes, bends, _), felt = self.law, self.inside.felt
        both = changes.chained(slopes, bends, felt.firsts, felt.seconds)
        return density, *changes.with_area(density, *both)

    @cached_property
    def law(self):
        """W and its derivatives up to the third, see `Points.law`."""
        return self.inside.law(3)

    @cached_property
    def stress(self):
        """Root mean square over the surface of the derivative of the cost by ∇ψ.

        Where parts of that balance each other, as in bent threads, it is the cost per area.
        """
        cost = abs(float(self.flat_areas @ self.cost[0] / self.area))
        return max(self._mean(self.cost[1]), cost, ROUND_OFF * self.size)

    @cached_property
    def force(self):
        """Root mean square of that of the energy: what pulls at the cloth."""
        return max(self._mean(self.energy[1]), ROUND_OFF)

    def _mean(self, slopes):
        flux = slopes.reshape(len(self.flat_areas), 2, -1)
        c11, c22, c12 = self.inside.strain.T
        one, other = flux[:, :, 0], flux[:, :, 1]
        square = c11[:, None] * one**2 + c22[:, None] * other**2 + 2 * c12[:, None] * one * other
        mean = self.flat_areas @ (square.sum(axis=1) / self.inside.stretch) / self.area
        return float(np.sqrt(mean))

    def tests(self):
        """The fields of the `Certificate` that are found here."""
        stress = self.stress
        found = {
            "stress": stress,
            "barrier": self.mu,
            "stationarity_tolerance": self._tolerance(),
            # A Chebyshev net has no stress but the error of the mesh.
            "richer_tolerance": RESOLVED * max(1.0, self.size / stress),
            "equilibrium_tolerance": max(EQUILIBRIUM, UNFELT / self.force),
            "curvature_tolerance": self._flat(),
        }
        return found | self._about_psi() if self.interior else found

    def _flat(self):
        """Curvature that counts as zero.

        Turning cloth changes its energy by about the square of a small stress. Limits, asked at
        points, change that by more. Of a Chebyshev net all stress is an error of the mesh, and so
        is curvature of that size.
        """
        if self.scene.inextensible:
            return self.stress
        part = 1.0 if self.limits else min(1.0, self.stress / self.size)
        return FLAT * part * self.stress + ROUND_OFF * self.size

    def _tolerance(self):
        """An interior point ends with stationarity and all c z − μ below μ, per area."""
        if not self.limits:
            return AT_REST
        weights = sum(limits.weights.sum() for limits in self.limits) / self.area
        achieved = np.sqrt(1 + weights * len(self.limits[0].values)) * self.mu
        return max(float(achieved / self.stress), BALANCED)

    def _about_psi(self):
        residual, v = self.remainder(self.patch.order)
        richer, _ = self.remainder(self.patch.order + 1, TOUCHING)
        pencil = Pencil(self, v)
        flips = [(0, 0), (1, 0), (0, 1), (1, 1)] if self.scene.symmetric else [(0, 0)]
        strain, share = pencil.barrier_effect() if self.limits else (0.0, 0.0)
        own, *others = (pencil.least_eigenvalue(each) for each in flips)
        return {
            "stationarity": residual / self.stress,
            "stationarity_richer": richer / self.stress,
            "curvature": own,
            "asymmetric_curvature": min(others, default=None),
            "in_sight": pencil.in_sight() if self.scene.cost and not self.limits else None,
            "barrier_strain": strain,
            "barrier_share": float(share),
        }

    def system(self, order):
        """The `System` of an order."""
        if order not in self._systems:
            self._systems[order] = System(self, order)
        return self._systems[order]

    def remainder(self, order, touching=0.0):
        """The least of |dL|² + Σ ∫ (c z − μ)² dA over all v and z, its root per √area; and v.

        The first norm is dual to the H¹ seminorm over ψ of that order. With z = μ/c + ∇c·w/c² the
        solution w is what would have to be gained: c z alone may be off by μ at the solver's end.
        Slacks c of less than `touching`, as a strain, count as that much: no z gets by more easily.
        """
        system = self.system(order)
        force = system.load(self.inside, self.flat_areas[:, None] * self.cost[1])
        tangents = [self.flat_areas[:, None, None] * self.inside.norm(), 0.0]
        for number, limits in enumerate(self.limits):
            least = touching * np.abs(limits.slopes).max(axis=2)
            ratios = limits.slopes / np.maximum(limits.values, least)[:, :, None]
            weighted = limits.weights[:, None] * ratios
            force -= self.mu * system.load(limits.points, weighted.sum(axis=0))
            tangents[number] = tangents[number] + np.einsum("sni,snj->nij", weighted, ratios)
        solution = system.solved(system.matrix(*tangents), force)
        square = force @ solution / self.area
        return float(np.sqrt(max(square, 0.0))), -solution[system.psi.stop :]


class _Limits:
    """All slacks at some of the points where limits are imposed, with their weights there."""

    def __init__(self, points, weights):
        self.points, self.weights = points, weights
        limits = points.patch.scene.constraints
        self.values, self.slopes, self.bends = points.functions(
            lambda cloth: [slack for limit in limits for slack in limit.slacks(cloth)]
        )


class Pencil:
    """The matrices [[H, Aᵀ], [A, 0]] and [[M, 0], [0, 0]]: H Hessian of L, A equilibrium.

    Parameters
    ----------
    point : StationaryPoint
    v : ndarray
        Its multipliers of equilibrium.
    """

    def __init__(self, point, v):
        self._point, self.system = point, point.system(point.patch.order)
        inside, system, weights = point.inside, self.system, point.flat_areas[:, None, None]
        tangents = [weights * point.cost[2], 0.0]
        if v.size:
            spread = inside.gradients(point.degree, system.v_by_triangle(v))
            tangents[0] = tangents[0] + weights * changes.along(point.law, inside.felt, spread)
        self._barrier = np.zeros(system.size)
        for number, limits in enumerate(point.limits):
            ratios = limits.slopes / limits.values[:, :, None]
            weighted = limits.weights[:, None] * ratios
            self._barrier += system.load(limits.points, weighted.sum(axis=0))
            shares = point.mu * limits.weights / limits.values
            bent = point.mu * np.einsum("sni,snj->nij", weighted, ratios)
            tangents[number] = tangents[number] + bent
            tangents[number] -= np.einsum("sn,snij->nij", shares, limits.bends)
        # A cost's unit is that of L.
        self.hessian = system.matrix(*tangents, coupled=point.size)
        self.norm = system.matrix(weights * inside.norm(), coupled=0.0)

    def least_eigenvalue(self, flips=(0, 0)):
        """The smallest finite eigenvalue on changes of one symmetry, by Lanczos iteration.

        It is about a shift below all: eigenvalues below the shift would show as pivots. Then the
        shift moves down.
        """
        _, _, norm, shift, factors = self._own if flips == (0, 0) else self._shifted(flips)
        values, _ = lanczos(factors.solve, lambda x: norm @ x, norm.shape[0])
        return float(shift + 1 / values[-1])

    @cached_property
    def _own(self):
        return self._shifted((0, 0))

    def _shifted(self, flips):
        """The free unknowns, H and M on them, the shift, and factors of H less that times M."""
        free, rows = self.system.free(flips)
        hessian, norm = restricted(rows, self.hessian, self.norm)
        held = int((free >= self.system.psi.stop).sum())
        shift, shifted = -FLAT * self._point.stress, hessian.copy()
        while True:
            shifted.data = hessian.data - shift * norm.data
            factors = self.system.factorised(shifted, free)
            if factors.negative <= held:
                return free, hessian, norm, shift, factors
            shift *= 4

    def _step(self, force):
        """The change of ψ, in equilibrium, that H takes to a force."""
        free, hessian, _, _, factors = self._own
        step = np.zeros(self.system.size)
        step[free] = refined(factors, hessian, force[free])
        return step

    def in_sight(self):
        """What the cost may still fall by, over itself: dᵀHd/2 of the Newton step d in equilibrium.

        A cost that falls for ever, as the patch shrinks, has forces that vanish with it.
        """
        force = self._cost_force()
        return abs(force @ self._step(force)) / 2 / self._cost_size()

    def barrier_effect(self):
        """What the barrier changes, to first order, by μ dψ/dμ.

        Returns
        -------
        strain : float
            Its root mean square over the surface.
        share : float
            What the cost would fall by without the barrier, over itself.
        """
        change, (free, _, norm, _, _) = self._point.mu * self._step(self._barrier), self._own
        strain = float(np.sqrt(change[free] @ (norm @ change[free]) / self._point.area))
        return strain, abs(self._cost_force() @ change) / self._cost_size()

    def _cost_force(self):
        point = self._point
        return self.system.load(point.inside, point.flat_areas[:, None] * point.cost[1])

    def _cost_size(self):
        point = self._point
        cost = abs(float(point.flat_areas @ point.cost[0]))
        return cost + ROUND_OFF**2 * point.size * point.area
