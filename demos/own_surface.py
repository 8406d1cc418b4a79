"""Surfaces of one's own: two caps, and two that cloth covers without any strain.

Which flat patch ψ(U) covers a surface φ(U) that is given as a chart? The problem is

    minimise  E(ψ) = ∫ J (kc (I4 − 1)² + kc (I6 − 1)² + ks I8²)
    with  C = ∇ψ⁻ᵀ a ∇ψ⁻¹, I4 = C11, I6 = C22, I8 = C12,

and knows the surface by its metric a = ∇φᵀ∇φ alone. A chart is a callable of (θ1, θ2) with three
components in NGSolve's functions; a follows by symbolic differentiation, and nothing is asked of
the chart: of these four only the cylinder's is conformal, that is, has a = f Id.

On the caps, with ks = 0, E = 0 belongs to a Chebyshev net, and the exact one is computed beside it
by its hyperbolic equation, θ_uv + Γ(θ)(θ_u, θ_v) = 0.

A cylinder and a cone unroll to the plane. Whatever the start, the least energy is zero there, to
rounding error, if the elements can represent the unrolled patch. The cylinder's is a rectangle,
which any order does; the cone's is a sector of an annulus, for which order 10 is enough. The cone
is given some shear stiffness: with ks = 0 it has a Chebyshev net for every pair of crossing
threads, and no reason to prefer one.
"""

import sys
from pathlib import Path

import ngsolve as ngs
import numpy as np

import ngcloth
from ngcloth import Disk, Net, Rectangle, Scene, Surface
from ngcloth.chebyshev import ChebyshevNet


def ellipsoid():
    """A cap of the ellipsoid with half axes √3, 1.6 and 1, its summit at the centre."""

    def chart(theta1, theta2):
        height = ngs.sqrt(1 - theta1**2 / 3 - theta2**2 / 4)
        return theta1, 0.8 * theta2, height

    surface = Surface(chart, Disk(1.2))
    return Scene(surface=surface, fabric=Net(), symmetric=True, name="ellipsoid")


def paraboloid():
    """The paraboloid z = −|θ|²/2, down to where its radius is 1.2."""

    def chart(theta1, theta2):
        return theta1, theta2, -(theta1**2 + theta2**2) / 2

    surface = Surface(chart, Disk(1.2))
    return Scene(surface=surface, fabric=Net(), symmetric=True, name="paraboloid")


def cylinder():
    """Half a cylinder of radius 1 and length 2."""

    def chart(theta1, theta2):
        return ngs.cos(theta1), ngs.sin(theta1), theta2

    return Scene(
        surface=Surface(chart, Rectangle((0, np.pi), (-1, 1))),
        fabric=Net(),
        start=(0.5, 0.5),  # (1, 1) would be the answer
        symmetric=True,
        name="cylinder",
    )


def cone():
    """A piece of a cone of opening angle 90°, from 0.5 to 1.5 below its apex."""

    def chart(depth, angle):
        return depth * ngs.cos(angle), depth * ngs.sin(angle), -depth

    surface = Surface(chart, Rectangle((0.5, 1.5), (-1, 1)))
    return Scene(surface=surface, fabric=Net(ks=1.0), start=(0.5, 0.5), name="cone")


SETTINGS = {
    ellipsoid: {},
    paraboloid: {},
    cylinder: {},
    cone: {"order": 10, "maxh": 0.5},
}


def solve(scene, log=None):
    """Solve one of the four scenes, each with its settings."""
    return ngcloth.solve(scene(), log=log, **SETTINGS[scene])


def outline_error(result):
    """How far the outline is from that of the exact patch.

    That is the exact Chebyshev net of a symmetric scene. The cone's patch may be turned: its
    outline is compared by the distances between its points with those of the unrolled cone.
    """
    surface = result.scene.surface
    if result.scene.symmetric:
        rim = surface.domain.rim(200)[:51]
        return np.abs(result.psi(*rim.T) - ChebyshevNet.symmetric(surface).material(rim)).max()
    depth, angle = surface.domain.rim(200).T
    sector = np.sqrt(2) * depth * np.array([np.cos(angle / 2**0.5), np.sin(angle / 2**0.5)])
    patch, unrolled = (
        np.linalg.norm(points[:, None] - points, axis=-1)
        for points in (result.outline(200), sector.T)
    )
    return np.abs(patch - unrolled).max()


def table(results):
    """Print the results, one line each."""
    print(
        "\nsurface       E/(2π kc)  outline error  patch area  |γ| up to  steps  seconds  stopped"
    )
    for result in results:
        print(
            f"{result.scene.name:12s}  {result.normalized_energy:9.2e}  "
            f"{outline_error(result):13.2e}  {result.area:10.6f}  "
            f"{max(map(abs, result.extrema['shear'])):9.2e}  {result.newton_iterations:5d}  "
            f"{result.seconds:7.2f}  {result.reason}"
        )
    print(f"Areas of the cylinder and the cone themselves: {2 * np.pi:.6f}, {2 * np.sqrt(2):.6f}.")


def figures(results, out):
    """Draw the four patches and their surfaces to the folder `out`."""
    import matplotlib.pyplot as plt

    from ngcloth import plot, view

    figure, axes = plt.subplots(2, 4, figsize=(13, 6.2), layout="constrained")
    for (flat, space), result in zip(axes.T, results, strict=True):
        plot.patch(flat, result, pitch=0.2)
        flat.set_title(result.scene.name)
        picture = out / "cloth.png"
        view.cloth(result, pitch=0.2, screenshot=picture, size=(700, 600))
        space.imshow(plt.imread(picture))
        space.axis("off")
        picture.unlink()
    figure.savefig(out / "own_surface.png", dpi=110)
    plt.close(figure)


def main(out="out"):
    """Solve, print, draw."""
    results = []
    for scene in SETTINGS:
        print(f"\n{scene.__name__}")
        results.append(solve(scene, log=print))
    table(results)
    out = Path(out)
    out.mkdir(parents=True, exist_ok=True)
    figures(results, out)
    print(f"Picture: {out / 'own_surface.png'}")


if __name__ == "__main__":
    main(*sys.argv[1:])
