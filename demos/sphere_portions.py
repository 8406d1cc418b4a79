"""Ever larger portions of the sphere, until no Chebyshev net covers them (§5.3, Fig. 10).

The portion p of the unit sphere, a cap, is covered by the patch ψ(U) of least

    E(ψ) = ∫ J kc ((I4 − 1)² + (I6 − 1)²),

zero if the threads do not stretch; shearing is free, ks = 0. The exact net with the symmetry of the
axes has the angle g(X1 X2) between its threads, where z g'' + g' + sin g = 0 and g(0) = π/2. They
become parallel, γ = cos g = 1, on the hyperbola X1 X2 = z* = 1.8616, where g has its first zero;
the rim meets it at 45° if p = p* = 0.84236. For larger portions there is no such net, and the
solver says so.

The threads' angle at the 45° point of the rim falls to zero as p grows to p*. Here p* is found
from the portions p ≤ 0.82 that have a net, in two ways: where the flat position of the 45° point
meets the hyperbola, and where the angle itself, arccos γ, is zero. The second knows nothing of the
exact net, but near 1 a small error of γ is a large one of the angle.
"""

import sys
from pathlib import Path

import numpy as np

import ngcloth
from ngcloth.chebyshev import (
    SPHERE_COLLAPSE,
    ChebyshevNet,
    sphere_angle,
    sphere_singular_portion,
)

PORTIONS = [0.5, 0.6, 0.7, 0.75, 0.8, 0.82, 0.84, 0.85, 0.9]
FIT = [0.7, 0.75, 0.8, 0.82]  # the portions from which p* is extrapolated
FINE = {"order": 6, "maxh": 0.1}
DIAGONAL = np.sqrt([0.5, 0.5])  # the parameter point at 45° on the rim


def solve(portion, **settings):
    """Solve one portion; the default settings take a second or two."""
    return ngcloth.solve(ngcloth.scenes.sphere(portion), **settings)


def largest_shear(result):
    """The largest |γ|, over the whole cloth."""
    return result.extrema["shear"][1]


def exact_largest_shear(portions):
    """|γ| of the exact net at 45° on the rim, its largest; nan for p > 0.84."""
    portions = np.array(portions)
    reached = portions <= 0.84
    # One net on the largest cap holds those of the smaller ones.
    radius = np.sqrt(portions[reached] / (1 - portions[reached]) * (1 - 0.84) / 0.84)
    net = ChebyshevNet.symmetric(ngcloth.scenes.sphere(0.84).surface, blocks=10)
    shear = np.full(len(portions), np.nan)
    shear[reached] = np.cos(sphere_angle(net.material(radius[:, None] * DIAGONAL).prod(axis=-1)))
    return shear


def singular_portions(results):
    """p* extrapolated from the results of several portions: by position, and by angle."""
    products = [result.psi(*DIAGONAL).prod() for result in results.values()]
    angles = [np.arccos(result.field("shear", *DIAGONAL)) for result in results.values()]
    return tuple(
        float(np.polyval(np.polyfit(values, list(results), len(results) - 1), end))
        for values, end in ((products, SPHERE_COLLAPSE), (angles, 0.0))
    )


def table(results, fine):
    """Print every portion, then p*."""
    print("\n   p   E/(2π kc)  max |γ|    exact      patch area  steps  seconds  why it stopped")
    for (portion, result), exact in zip(
        results.items(), exact_largest_shear(list(results)), strict=True
    ):
        print(
            f"{portion:5.2f}  {result.normalized_energy:9.2e}  {largest_shear(result):9.6f}  "
            f"{exact:9.6f}  {result.area:10.4f}  {result.newton_iterations:5d}  "
            f"{result.seconds:7.2f}  {result.reason.name}"
        )
    for reason in dict.fromkeys(result.reason for result in results.values()):
        print(f"{reason.name}: {reason}")
    exact, (position, angle) = sphere_singular_portion(), singular_portions(fine)
    print(
        f"\np*, exact                                    {exact:.6f}"
        f"\np*, where the 45° point meets X1 X2 = z*      {position:.6f}, {position - exact:+.1e}"
        f"\np*, where the angle of the threads is zero    {angle:.6f}, {angle - exact:+.1e}"
        "\n(extrapolated from p = {}; order {order}, maxh {maxh:g})".format(
            ", ".join(map(str, fine)), **FINE
        )
    )


def figures(results, out):
    """Draw Figs 10a, 10b and 10c-e to the folder `out`."""
    import matplotlib.pyplot as plt

    from ngcloth import plot, view

    figure, ax = plt.subplots(figsize=(5.6, 5.2), layout="constrained")
    colours = plt.colormaps["viridis"](np.linspace(0, 0.95, len(results)))
    for (portion, result), colour in zip(results.items(), colours, strict=True):
        style = {} if result.converged else {"linestyle": ":"}
        label = f"{portion:.2f}" + ("" if result.converged else " (no net)")
        plot.patch(ax, result, color=colour, linewidth=1.1, label=label, **style)
    branch = np.linspace(SPHERE_COLLAPSE / 2.3, 2.3)
    for sign1, sign2 in ((1, 1), (-1, 1), (-1, -1), (1, -1)):
        ax.plot(sign1 * branch, sign2 * SPHERE_COLLAPSE / branch, "k--", linewidth=1)
    ax.plot([], [], "k--", linewidth=1, label=r"$X_1X_2 = \pm z^*$")
    figure.legend(title=r"portion $p$", loc="outside center right", fontsize="small")
    figure.savefig(out / "fig10a_patches.png", dpi=120)

    figure, ax = plt.subplots(figsize=(4.8, 3.6), layout="constrained")
    singular = sphere_singular_portion()
    curve = np.linspace(0.5, 0.84, 69)
    exact = np.append(exact_largest_shear(curve), 1.0)
    ax.plot(np.append(curve, singular), exact, color="0.6", linewidth=3, label="exact net")
    for converged, marker, label in ((True, "o", "optimal patch"), (False, "x", "no net found")):
        these = {p: largest_shear(r) for p, r in results.items() if r.converged is converged}
        ax.plot(list(these), list(these.values()), marker, color="tab:blue", label=label)
    ax.axvline(singular, color="k", linestyle="--", linewidth=1, label=rf"$p^*$ = {singular:.4f}")
    ax.set(xlabel=r"portion $p$ of the sphere", ylabel=r"largest shear $|\gamma|$")
    ax.legend(loc="lower right", fontsize="small")
    figure.savefig(out / "fig10b_shear.png", dpi=120)

    result = results[0.85]  # the camera's north is the middle of the cloth
    side = {"azimuth": -45, "elevation": -5}
    view.cloth(result, field="shear", pitch=0.15, screenshot=out / "fig10c_side.png", **side)
    bottom = {"azimuth": -90, "elevation": -90}
    view.cloth(result, field="shear", pitch=0.15, screenshot=out / "fig10d_bottom.png", **bottom)
    figure, ax = plt.subplots(figsize=(5, 4.2), layout="constrained")
    plot.patch(ax, result, field="shear", pitch=0.15)
    figure.savefig(out / "fig10e_shear.png", dpi=120)
    plt.close("all")


def main(out="out"):
    """Solve, print, draw."""
    results = {}
    for portion in PORTIONS:
        results[portion] = solve(portion)
        print(f"p = {portion}: {results[portion].reason}")
    table(results, {portion: solve(portion, **FINE) for portion in FIT})
    out = Path(out)
    out.mkdir(parents=True, exist_ok=True)
    figures(results, out)
    print(f"Pictures: {', '.join(sorted(str(path) for path in out.glob('fig10*.png')))}")


if __name__ == "__main__":
    main(*sys.argv[1:])
