"""Elastic cloth on the hemisphere and the hemicatenoid (§5.2, Figs 7, 8 and 9).

Which flat patch ψ(U) is least strained on the surface, when shearing the fabric costs energy too?

    minimise  E(ψ) = ∫ J (kc (I4 − 1)² + kc (I6 − 1)² + ks I8²)
    such that  the threads are taut, λ1 ≥ 1 and λ2 ≥ 1,
               the cloth is in equilibrium along the surface, its rim being pinned:
               dE(ψ)[v] = 0 for all v that vanish on the rim (eq. 16).

No net of inextensible threads (ks = 0) covers a curved surface without shear; as ks/kc grows the
threads stretch instead. Each case is solved at mesh sizes h and h/1.5: the difference of the two
energies is the error bar of the first. The surface may pull as well as push, so that the reaction τ
may be negative: on the hemisphere it hardly is, on the hemicatenoid it is along parts of the rim.

Equilibrium depends on ks, so that E and the patch need not vary monotonically with it: on the
hemicatenoid E is larger, and the patch smaller, at ks/kc = 10 than at 100, from every start tried.

At ks/kc = 100 the hemisphere's largest |γ| sits on the rim and still moves with the mesh; the table
has that of the interior beside it. The solver ends in a local minimum near its start. Of the
Chebyshev patches of the hemicatenoid, which are many, the figure has one: it bends most evenly.
"""

import sys
from pathlib import Path

import numpy as np

import ngcloth
from ngcloth import plot

SCENES = {"hemisphere": ngcloth.scenes.hemisphere, "hemicatenoid": ngcloth.scenes.hemicatenoid}
MESH = {"hemisphere": 0.1, "hemicatenoid": 0.15}
REFINED = 1.5  # the second mesh is finer by this factor
RATIOS = [1, 10, 100]  # ks/kc
INSIDE = 0.9  # of the way from the centre to the rim: leaves out the layer along the rim


def solve(name, ratio, **settings):
    """Solve one surface at ks/kc = `ratio`; the default settings take some seconds."""
    return ngcloth.solve(SCENES[name](ratio), **{"maxh": MESH[name]} | settings)


def largest_stretch(result):
    """The largest λ1 or λ2, over the whole cloth."""
    return max(result.extrema["stretch1"][1], result.extrema["stretch2"][1])


def least_stretch(result):
    """The smallest λ1 or λ2, over the whole cloth."""
    return min(result.extrema["stretch1"][0], result.extrema["stretch2"][0])


def shear_inside(result):
    """The largest |γ| within `INSIDE` of the way from the centre to the rim."""
    theta, _ = plot.sample(result)
    centre = result.scene.surface.domain.centre
    return np.abs(result.field("shear", *(centre + INSIDE * (theta - centre)).T)).max()


def table(name, results, fine, chebyshev=None):
    """Print the results of one surface side by side, {ks/kc: result}; `fine` are those at h/1.5."""
    h = next(iter(results.values())).settings["maxh"]
    heads = "".join(f"{f'ks/kc = {ratio}':>16s}" for ratio in results)
    print(f"\n{f'{name}, h = {h:g}':36s}{heads}")

    def row(title, form, of):
        print(f"{title:36s}" + "".join(f"{of(ratio, r):{form}}" for ratio, r in results.items()))

    row("energy E/(2π kc)", "16.4f", lambda ratio, r: r.normalized_energy)
    row("  at h/1.5", "16.4f", lambda ratio, r: fine[ratio].normalized_energy)
    row(
        "  error bar, their difference",
        "+16.4f",
        lambda ratio, r: fine[ratio].normalized_energy - r.normalized_energy,
    )
    row("largest λ", "16.4f", lambda ratio, r: largest_stretch(r))
    row("smallest λ (between the points held)", "16.4f", lambda ratio, r: least_stretch(r))
    row("largest |γ|", "16.4f", lambda ratio, r: r.extrema["shear"][1])
    row("  at h/1.5", "16.4f", lambda ratio, r: fine[ratio].extrema["shear"][1])
    row(f"largest |γ| within {INSIDE} of the rim", "16.4f", lambda ratio, r: shear_inside(r))
    row("  at h/1.5", "16.4f", lambda ratio, r: shear_inside(fine[ratio]))
    row("reaction τ/kc, least", "16.3f", lambda ratio, r: r.extrema["reaction"][0])
    row("reaction τ/kc, greatest", "16.3f", lambda ratio, r: r.extrema["reaction"][1])
    row("patch area", "16.4f", lambda ratio, r: r.area)
    row("equilibrium residual", "16.4f", lambda ratio, r: r.equilibrium_residual)
    row("  at h/1.5", "16.4f", lambda ratio, r: fine[ratio].equilibrium_residual)
    row("Newton steps", "16d", lambda ratio, r: r.newton_iterations)
    row("seconds", "16.2f", lambda ratio, r: r.seconds)
    row("why it stopped", ">16s", lambda ratio, r: r.reason.name)
    row("  at h/1.5", ">16s", lambda ratio, r: fine[ratio].reason.name)
    if chebyshev is not None:
        print(f"{'patch area at ks = 0, Chebyshev':36s}{chebyshev.area:16.4f}")
    for reason in dict.fromkeys(r.reason for r in [*results.values(), *fine.values()]):
        print(f"{reason.name}: {reason}")


def claims(results):
    """Print what the paper says beside what came out, `results` being {name: {ratio: result}}."""
    sphere, catenoid = results["hemisphere"][100], results["hemicatenoid"][1]
    low, high = sphere.extrema["reaction"]
    pull, push = catenoid.extrema["reaction"]
    centre = float(sphere.field("reaction", 0, 0))
    rows = [
        ("", "paper", "here"),
        ("hemisphere, ks/kc = 100: largest λ", "1.8", f"{largest_stretch(sphere):.3f}"),
        ("  largest |γ|, all of the cloth", "0.075", f"{sphere.extrema['shear'][1]:.3f}"),
        (f"  largest |γ| within {INSIDE} of the rim", "", f"{shear_inside(sphere):.3f}"),
        ("  least τ/kc", "≥ 0", f"{low:.2f}"),
        ("  greatest τ/kc; in the centre", "equal", f"{high:.2f}; {centre:.2f}"),
        ("hemicatenoid, ks/kc = 1: τ/kc", "both signs", f"{pull:.2f} to {push:.2f}"),
    ]
    print()
    for title, paper, here in rows:
        print(f"{title:36s}{paper:>14s}{here:>18s}")
    for name, cases in results.items():
        areas = [r.area for r in cases.values()]
        trend = "shrinks" if np.all(np.diff(areas) < 0) else "does not shrink throughout"
        print(f"{name}: the patch shrinks as ks/kc grows, the paper says; here it {trend}.")


def figures(results, out):
    """Draw Figs 7a-e, 8a-e and 9a-b to the folder `out`; `results` include ks = 0."""
    _outlines(results["hemisphere"], out / "fig7a_patches.png")
    _outlines(results["hemicatenoid"], out / "fig8a_patches.png")
    _maps(results["hemisphere"][100], out, "fig7cde_maps.png", (13, 3.9))
    _maps(results["hemicatenoid"][1], out, "fig8cde_maps.png", (14, 2.7))
    _convergence(results["hemisphere"][100], out / "fig9ab_convergence.png")
    try:
        from ngcloth import view

        view.cloth(results["hemisphere"][100], pitch=0.15, screenshot=out / "fig7b_cloth.png")
        side = {"azimuth": -25, "elevation": 35}
        view.cloth(
            results["hemicatenoid"][1], pitch=0.2, screenshot=out / "fig8b_cloth.png", **side
        )
    except (ImportError, RuntimeError) as error:  # a machine without any graphics library
        print(f"Figs 7b and 8b are left out: {error}")


def _outlines(cases, path):
    import matplotlib.pyplot as plt

    figure, ax = plt.subplots(figsize=(6, 4.6), layout="constrained")
    colours = plt.colormaps["viridis"](np.linspace(0, 0.9, len(cases) - 1))
    for (ratio, result), colour in zip(cases.items(), ["black", *colours], strict=True):
        label = "0 (Chebyshev)" if ratio == 0 else f"{ratio}"
        label += "" if result.converged else " (not converged)"
        style = {"linestyle": "--"} if ratio == 0 else {}
        plot.patch(ax, result, color=colour, label=label, **style)
    figure.legend(title=r"$k_s/k_c$", loc="outside center right", fontsize="small")
    figure.savefig(path, dpi=120, bbox_inches="tight")
    plt.close(figure)


def _maps(result, out, name, size):
    import matplotlib.pyplot as plt

    figure, axes = plt.subplots(1, 3, figsize=size, layout="constrained")
    for ax, field in zip(axes, ("stretch1", "shear", "reaction"), strict=True):
        bar = plot.patch(ax, result, field=field, levels=31)
    low, high = bar.mappable.get_clim()
    if low < -0.1 * high:  # both signs: zero is white, and colours end where the pushing does
        bar.mappable.set(cmap="RdBu_r", clim=(-high, high))
    figure.savefig(out / name, dpi=120)
    plt.close(figure)


def _convergence(result, path):
    """L, and E beside the rest of L, against Newton steps: Δt is adaptive, μ falls in jumps."""
    import matplotlib.pyplot as plt

    rows = result.history
    steps = [row.newton for row in rows]
    energy, lagrangian = (np.array([getattr(r, key) for r in rows]) for key in
                          ("energy", "lagrangian"))  # fmt: skip
    figure, (left, right) = plt.subplots(1, 2, figsize=(9, 3.6), layout="constrained")
    left.plot(steps, lagrangian, ".-", linewidth=1)
    left.set(ylabel=r"Lagrangian $\mathcal{L}/(2\pi k_c)$")
    right.semilogy(steps, energy, ".-", linewidth=1, label=r"energy $\mathcal{E}$")
    right.semilogy(
        steps,
        np.abs(lagrangian - energy),
        ".-",
        linewidth=1,
        label=r"$|\mathcal{L} - \mathcal{E}|$: barriers, imbalance",
    )
    right.semilogy(steps, [r.mu for r in rows], color="0.5", drawstyle="steps-post", label=r"$\mu$")
    right.set_ylabel(r"in units of $2\pi k_c$")
    right.legend(fontsize="small")
    for ax in (left, right):
        ax.set_xlabel("Newton steps")
        ax.xaxis.get_major_locator().set_params(integer=True)
        ax.grid(alpha=0.3)
        for before, after in zip(rows, rows[1:], strict=False):
            if after.mu < before.mu:
                ax.axvline(after.newton, color="0.7", linewidth=0.8, linestyle=":")
    figure.savefig(path, dpi=120)
    plt.close(figure)


def main(out="out"):
    """Solve, print, draw."""
    results = {}
    for name in SCENES:
        results[name] = {ratio: solve(name, ratio) for ratio in [0, *RATIOS]}
        fine = {ratio: solve(name, ratio, maxh=MESH[name] / REFINED) for ratio in RATIOS}
        table(name, {ratio: results[name][ratio] for ratio in RATIOS}, fine, results[name][0])
    claims(results)
    out = Path(out)
    out.mkdir(parents=True, exist_ok=True)
    figures(results, out)
    print(f"Pictures: {', '.join(sorted(str(path) for path in out.glob('fig[789]*.png')))}")


if __name__ == "__main__":
    main(*sys.argv[1:])
