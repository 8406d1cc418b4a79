"""Large portions of the sphere, clothed by stretching the threads (§5.3, Fig. 11).

Beyond p = 0.84 of the sphere no Chebyshev net covers it: threads become parallel, |γ| = 1. Here
the angle between them is kept above 30° instead, and they may stretch:

    minimise  E(ψ) = ∫ J kc ((I4 − 1)² + (I6 − 1)²)
    such that  |γ| ≤ γmax = cos(π/6), λ1 ≥ 1, λ2 ≥ 1, and the cloth is in equilibrium.

Small portions stay below the limit, and all but keep the energy zero of the Chebyshev net. Larger
ones meet it; there a larger surface takes longer threads, but these are stretched more, so that
the flat patch grows with p and then shrinks. The paper says that it is largest near p = 0.85.

For p ≥ 0.8 there are several local minima, and which one is found depends on the mesh. The table
gives each portion at two mesh sizes, and says where they are far apart.
"""

import sys
from pathlib import Path

import numpy as np

import ngcloth
from ngcloth import plot

PORTIONS = [0.5, 0.6, 0.7, 0.75, 0.8, 0.85, 0.9]
SHEAR_LIMIT = float(np.cos(np.pi / 6))
MESH = 0.15
REFINED = 1.5  # the second mesh is finer by this factor
APART = 0.05  # relative difference of the areas at both meshes worth a remark


def solve(portion, **settings):
    """Solve one portion; the default settings take some seconds."""
    scene = ngcloth.scenes.sphere(portion, shear_limit=SHEAR_LIMIT)
    return ngcloth.solve(scene, **{"maxh": MESH} | settings)


def largest_stretch(result):
    """The largest λ1 or λ2, over the whole cloth."""
    return max(result.extrema["stretch1"][1], result.extrema["stretch2"][1])


def table(results, fine):
    """Print every portion, {p: result}, at mesh size h and, from `fine`, at h/1.5."""
    print(
        f"\nks = 0, |γ| ≤ {SHEAR_LIMIT:.4f}, h = {MESH:g}"
        "\n   p     E/(2π kc)   at h/1.5   patch area   at h/1.5  max λ  max |γ|  "
        "least τ/kc  equilibrium  steps  seconds  why it stopped, at h and h/1.5"
    )
    for portion, r in results.items():
        f = fine[portion]
        print(
            f"{portion:5.2f}  {r.normalized_energy:11.5f}{f.normalized_energy:11.5f}  "
            f"{r.area:11.4f}{f.area:11.4f}  {largest_stretch(r):5.3f}  "
            f"{r.extrema['shear'][1]:7.4f}  {r.extrema['reaction'][0]:10.3f}  "
            f"{r.equilibrium_residual:11.3f}  {r.newton_iterations:5d}  {r.seconds:7.2f}  "
            f"{r.reason.name}, {f.reason.name}"
        )
    for reason in dict.fromkeys(r.reason for r in [*results.values(), *fine.values()]):
        print(f"{reason.name}: {reason}")
    apart = [p for p, r in results.items() if abs(fine[p].area / r.area - 1) > APART]
    if apart:
        print(
            f"At p = {', '.join(map(str, apart))} the areas at h and h/1.5 are more than "
            f"{APART:.0%} apart: different local minima, or too coarse a mesh."
        )
    print("Equilibrium: the part of the in-plane force that is not balanced inside the rim.")
    print("The limits hold at the points of the integration rule; between them max |γ| is past it.")
    largest, again = (max(rs, key=lambda p: rs[p].area) for rs in (results, fine))
    print(
        f"The patch is largest for p = {largest} at h and p = {again} at h/1.5, of the portions "
        "solved;\nthe paper says for p ≈ 0.85."
    )


def figures(results, fine, out):
    """Draw Figs 11a to 11f, and the area against p, to the folder `out`."""
    import matplotlib.pyplot as plt

    figure, ax = plt.subplots(figsize=(7, 6), layout="constrained")
    colours = plt.colormaps["tab10"](range(len(results)))
    for (portion, result), colour in zip(results.items(), colours, strict=True):
        label = f"{portion:.2f}" + ("" if result.converged else " (not converged)")
        plot.patch(ax, result, color=colour, linewidth=1.2, label=label)
    figure.legend(title=r"portion $p$", loc="outside center right", fontsize="small")
    figure.savefig(out / "fig11a_patches.png", dpi=120, bbox_inches="tight")

    figure, ax = plt.subplots(figsize=(4.8, 3.6), layout="constrained")
    for these, style, label in ((results, "none", "patch, h"), (fine, "full", "patch, h/1.5")):
        areas = [r.area for r in these.values()]
        ax.plot(list(these), areas, "o", color="tab:blue", fillstyle=style, label=label)
    stopped = [(p, r.area) for rs in (results, fine) for p, r in rs.items() if not r.converged]
    if stopped:
        ax.plot(*zip(*stopped, strict=True), "rx", label="not converged")
    covered = np.linspace(0.5, 0.9)
    ax.plot(covered, 4 * np.pi * covered, "0.6", label="surface covered")
    ax.set(xlabel=r"portion $p$ of the sphere", ylabel="area [length²]")
    ax.legend(fontsize="small")
    figure.savefig(out / "fig11_area.png", dpi=120)

    result = results[0.85]
    figure, axes = plt.subplots(1, 3, figsize=(13, 3.9), layout="constrained")
    for ax, field in zip(axes, ("stretch1", "shear", "reaction"), strict=True):
        plot.patch(ax, result, field=field, pitch=0.15 if field == "shear" else None)
    figure.savefig(out / "fig11def_maps.png", dpi=120)
    plt.close("all")

    try:
        from ngcloth import view

        # The camera's north is the middle of the cloth.
        side = {"azimuth": -45, "elevation": -5}
        view.cloth(result, pitch=0.15, screenshot=out / "fig11b_side.png", **side)
        bottom = {"azimuth": -90, "elevation": -90}
        view.cloth(result, pitch=0.15, screenshot=out / "fig11c_bottom.png", **bottom)
    except (ImportError, RuntimeError) as error:  # a machine without any graphics library
        print(f"Figs 11b and 11c are left out: {error}")


def main(out="out"):
    """Solve, print, draw."""
    results, fine = {}, {}
    for portion in PORTIONS:
        results[portion] = solve(portion)
        fine[portion] = solve(portion, maxh=MESH / REFINED)
        print(f"p = {portion}: {results[portion].reason}; {fine[portion].reason}")
    table(results, fine)
    out = Path(out)
    out.mkdir(parents=True, exist_ok=True)
    figures(results, fine, out)
    print(f"Pictures: {', '.join(sorted(str(path) for path in out.glob('fig11*.png')))}")


if __name__ == "__main__":
    main(*sys.argv[1:])
