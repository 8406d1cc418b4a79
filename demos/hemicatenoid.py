"""The hemicatenoid clothed with a Chebyshev net, and where that net is unique (§5.1, Fig. 6).

Which flat patch ψ(U) covers (cosh θ2 cos θ1, cosh θ2 sin θ1, θ2), 0 < θ1 < π, |θ2| < 1, without
stretching its threads? With ks = 0 the least energy E(ψ) = ∫ J kc ((I4 − 1)² + (I6 − 1)²) is zero.

A Chebyshev net θ(u, v) solves the hyperbolic equation θ_uv + Γ(θ)(θ_u, θ_v) = 0. Two crossing
threads, here the two lines of symmetry, determine it in the characteristic rectangle that they
span, |u| ≤ π/2 and |v| ≤ sinh 1, and nowhere else. But the corners of the domain lie beyond. So
the optimal net is not unique: there the scene chooses the net that bends most evenly, by adding
(ε/2) ∫ |∇∇∇ψ|² with ε → 0 (`Scene.tie_break`), and ends with a few steps on E alone, which free the
net inside of what is left of ε. The least of |∇∇ψ|² instead would kink in its second derivatives
along the threads that bound the rectangle, and the mesh would spread that inside. To continue the
two threads beyond the rim, analytically, is no way out: that net collapses before it reaches the
corners of the domain.
"""

import sys
from pathlib import Path

import numpy as np

import ngcloth
from ngcloth.chebyshev import ChebyshevNet

RUNS = [{"order": 2}, {"order": 6, "maxh": 0.1}, {"order": 6}]
FRACTIONS = [0.4, 0.6, 0.8, 0.9, 0.99, 1.0]
CORNER = np.array([np.pi, 1.0])


def solve(log=None, **settings):
    """Solve the scene; the default settings take a few seconds, with order 6 a minute."""
    return ngcloth.solve(ngcloth.scenes.hemicatenoid(), log=log, **settings)


def error_in_rectangle(result, fraction):
    """How far ψ is from the exact net in that fraction of the characteristic rectangle."""
    net = ChebyshevNet.symmetric(result.scene.surface)
    u, v = np.meshgrid(*(np.linspace(0, fraction * end, 25) for end in net.extent))
    exact = np.stack([u, v], axis=-1)
    return np.abs(result.psi(*np.moveaxis(net.theta(u, v), -1, 0)) - exact).max()


def smooth_extension_at(theta):
    """Where the threads continued beyond the rim take a parameter point; nan if nowhere."""
    surface = ngcloth.scenes.hemicatenoid().surface
    return ChebyshevNet.symmetric(surface, extent=(3.0, 2.1), blocks=10).material(theta)


def first_missed():
    """The first θ1 on the rim θ2 = 1 that the smooth extension does not reach."""
    theta1 = np.linspace(np.pi / 2, np.pi, 158)
    missed = np.isnan(smooth_extension_at(np.stack([theta1, np.ones(158)], axis=-1))[:, 0])
    return theta1[missed][0]


def table(results):
    """Print the results side by side."""
    titles = ["order {order}, maxh {maxh:.2g}".format(**result.settings) for result in results]
    print(f"\n{'hemicatenoid, ks = 0':40s}" + "".join(f"{title:>20s}" for title in titles))

    def row(name, form, of):
        print(f"{name:40s}" + "".join(f"{of(result):{form}}" for result in results))

    row("energy E/(2π kc)", "20.2e", lambda result: result.normalized_energy)
    for fraction in FRACTIONS:
        name = f"ψ from exact, in {fraction:.0%} of the rectangle"
        row(name, "20.2e", lambda result, f=fraction: error_in_rectangle(result, f))
    row("|γ| up to", "20.4f", lambda result: result.extrema["shear"][1])
    row("chosen corner of the patch, X1", "20.4f", lambda result: result.psi(*CORNER)[0])
    row("chosen corner of the patch, X2", "20.4f", lambda result: result.psi(*CORNER)[1])
    row("patch area", "20.4f", lambda result: result.area)
    row("Newton steps", "20d", lambda result: result.newton_iterations)
    row("seconds", "20.2f", lambda result: result.seconds)

    print(
        "Chebyshev nets of this surface are unique in the rectangle |X1| ≤ π/2, |X2| ≤ sinh 1 only."
        "\nBeyond, the scene picks the net that bends evenly. What it picks is no property of the"
        "\nsurface: the patch's corner and its area move with mesh, order and the last weight ε."
        f"\nThe smooth extension takes θ = (π, 1) to {smooth_extension_at(CORNER)}, nowhere:"
        f"\nalong the rim θ2 = 1 its threads collapse before θ1 = {first_missed():.2f}."
    )


def figures(result, out):
    """Draw Figs 6a, 6b and 6c to the folder `out`."""
    import matplotlib.pyplot as plt

    from ngcloth import plot, view

    figure, ax = plt.subplots(figsize=(5, 3.6), layout="constrained")
    plot.patch(ax, result, pitch=0.2, label="optimal patch")
    ends = np.array([[1, 1], [-1, 1], [-1, -1], [1, -1], [1, 1]]) * (np.pi / 2, np.sinh(1))
    ax.plot(*ends.T, "--", color="tab:red", label="determined by its axes")
    figure.legend(loc="outside upper center", ncols=2, fontsize="small")
    figure.savefig(out / "fig6a_patch.png", dpi=120)

    view.cloth(result, pitch=0.2, azimuth=-25, elevation=35, screenshot=out / "fig6b_cloth.png")

    figure, ax = plt.subplots(figsize=(5.6, 3.6), layout="constrained")
    plot.patch(ax, result, field="shear")
    figure.savefig(out / "fig6c_shear.png", dpi=120)
    plt.close("all")


def main(out="out"):
    """Solve, print, draw."""
    result = solve(log=print)
    print(f"\n{result}")
    table([result] + [solve(**settings) for settings in RUNS[1:]])
    out = Path(out)
    out.mkdir(parents=True, exist_ok=True)
    figures(result, out)
    print(f"Pictures: {', '.join(sorted(str(path) for path in out.glob('fig6*.png')))}")


if __name__ == "__main__":
    main(*sys.argv[1:])
