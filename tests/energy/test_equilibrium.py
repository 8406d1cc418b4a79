"""Equilibrium and reaction, by symbols alone."""

import ngsolve as ngs
import numpy as np
import pytest
from discretising import skew_surface

from ngcloth import Disk, Elongation, Net, Rectangle, Scene, Surface
from ngcloth.problem.kinematics import Kinematics
from ngcloth.solver.meshes import make_mesh


def cap(radius=1.0, domain=None):
    def chart(t1, t2):
        square = t1 * t1 + t2 * t2
        return [radius * q / (1 + square) for q in (2 * t1, 2 * t2, square - 1)]

    return Surface(chart, domain or Disk(1), side=-1)


SQUARE = Rectangle((-1, 1), (-0.5, 0.5))
SURFACES = {
    "cap": lambda: cap(domain=SQUARE),
    "skew": lambda: skew_surface(SQUARE),
    "catenoid": lambda: Surface(
        lambda u, v: (ngs.cosh(v) * ngs.cos(u), ngs.cosh(v) * ngs.sin(u), v), SQUARE
    ),
}
FABRIC = Net(kc=(2.0, 0.5), ks=0.7)


def wavy(x, y):
    return 0.8 * x + 0.1 * x * y + 0.1 * ngs.sin(y), 0.7 * y + 0.1 * ngs.sin(x) * y + 0.1 * x


def jacobi(pair):
    entries = [f.Diff(t) for f in pair for t in (ngs.x, ngs.y)]
    return ngs.CF(tuple(entries), dims=(len(pair), 2))


@pytest.mark.parametrize("name", SURFACES)
def test_equilibrium_in_the_flat_plane_is_that_of_sliding(name):
    """dE(ψ)[v] of v = ∇ψ·η is −∫ J S : L_η a: minus the work of sliding along η, eq. (16).

    The right side is the paper's form with the Lie derivative of the metric, the left side the
    change of energy as the cloth moves in the plane; and it is what finite differences say.
    """
    surface = SURFACES[name]()
    scene = Scene(surface, FABRIC, (Elongation(),), start=wavy)
    mesh, rule = make_mesh(scene, 0.25, 1), ngs.dx(bonus_intorder=12)
    x, y = ngs.x, ngs.y
    bubble = (1 - x * x) * (0.25 - y * y)
    eta = bubble * (1 + x - 2 * y), bubble * (0.5 + x * y + y)
    slope, metric = jacobi(wavy(x, y)), surface.metric
    cloth = Kinematics(slope, metric, FABRIC)
    stretched = metric * jacobi(eta)
    lie = eta[0] * metric.Diff(x) + eta[1] * metric.Diff(y) + stretched + stretched.trans
    along_threads = zip(cloth.energy_slopes, cloth.pushed(lie), strict=True)
    density = cloth.jacobian * sum((w * part for w, part in along_threads), ngs.CF(0))
    work = ngs.Integrate(density.Compile() * rule, mesh)

    v = [slope[i, 0] * eta[0] + slope[i, 1] * eta[1] for i in (0, 1)]
    turned = jacobi(v)

    def energy(t):
        moved = Kinematics(slope + t * turned, metric)
        return moved.jacobian * FABRIC.energy(moved.I4, moved.I6, moved.I8)

    def integral(density):
        return ngs.Integrate(density.Compile() * rule, mesh)

    flat = integral(energy(0).Diff(slope, turned))
    t = 1e-3
    change = integral(8 * (energy(t) - energy(-t)) - (energy(2 * t) - energy(-2 * t))) / (12 * t)
    assert abs(work) > 1e-2
    assert flat == pytest.approx(-work, rel=1e-9)
    assert flat == pytest.approx(change, rel=1e-6)


def test_reaction_of_a_balloon():
    """ψ = cθ on a sphere of radius R, Λ = λ²: τ = 8 kc Λ (Λ − 1)/R per flat area, outward.

    Laplace: both tensions per current length are 4 kc (Λ − 1), the sum of both over R is the
    pressure per current area, and flat area grows by Λ.
    """
    radius, c = 2.5, 3.5
    surface, points = cap(radius), np.array([[0.0, 0.0], [0.3, -0.2], [0.6, 0.7]])
    fabric = Net(kc=3.0, ks=5.0)
    cloth = Kinematics(
        ngs.CF((c, 0, 0, c), dims=(2, 2)), surface.metric, fabric, lambda: surface.curvature
    )
    square = (2 * radius / (1 + (points**2).sum(axis=1)) / c) ** 2
    assert (square > 1).any() and (square < 1).any()  # pushed where taut, pulled where slack
    expected = 8 * 3.0 * square * (square - 1) / radius
    assert surface.evaluate(cloth.reaction, points) == pytest.approx(expected, rel=1e-10)


@pytest.mark.parametrize("name", SURFACES)
def test_reaction_agrees_with_the_weak_formula(name):
    """Eq. (17): ∫ J (P ∇ψ⁻ᵀ : ∇(v n) − τ v) = 0, with P = dW/dF and F = ∇φ ∇ψ⁻¹."""
    surface = SURFACES[name]()
    scene = Scene(surface, FABRIC, start=wavy)
    mesh, rule = make_mesh(scene, 0.25, 1), ngs.dx(bonus_intorder=12)
    slope = jacobi(wavy(ngs.x, ngs.y))
    cloth = Kinematics(slope, surface.metric, FABRIC, lambda: surface.curvature)
    deformation = jacobi([surface.position[i] for i in range(3)]) * ngs.Inv(slope)
    green = deformation.trans * deformation
    stress = FABRIC.energy(green[0, 0], green[1, 1], green[0, 1]).Diff(deformation)
    traction = stress * ngs.Inv(slope).trans
    for v in (ngs.CF(1), ngs.exp(ngs.x) + ngs.y, ngs.cos(3 * ngs.x) * (1 + ngs.y)):
        pushed = [v * surface.normal[i] for i in range(3)]
        inner = cloth.jacobian * ngs.InnerProduct(traction, jacobi(pushed))
        left = ngs.Integrate(inner.Compile() * rule, mesh)
        right = ngs.Integrate((cloth.jacobian * cloth.reaction * v).Compile() * rule, mesh)
        assert abs(right) > 1e-2
        assert left == pytest.approx(right, rel=1e-9)
