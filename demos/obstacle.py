"""The surface pushes and cannot pull: the hemicatenoid as an obstacle (§5.4, Figs 12 and 13).

Pinned along its rim, the cloth touches the surface all over only where the surface need not pull:

    minimise  E(ψ) = ∫ J (kc (I4 − 1)² + kc (I6 − 1)² + ks I8²)
    such that  τ = −2 S : b ≥ 0, λ1 ≥ 1, λ2 ≥ 1, and the cloth is in equilibrium.

Without τ ≥ 0 the best patch is symmetric, and is pulled along parts of its rim. With it the problem
has several solutions. Where shear is stiff the lowest are turned either way, mirror
images of each other up to the mesh, and the paper's start, ψ = (0.3 θ1, 0.4 θ2), leads to one of
them, be it turned in its plane or not; the symmetric patch has more energy. `ngcloth.minima` tries
several starts; the figures show the lowest of what came out.

The angle of a patch is that by which the mean of ∇ψ turns, in (−45°, 45°]: exchanging warp and
weft turns a patch by 90°. The mesh has no symmetry; on coarse ones E moves by some per cent with
the mesh, and so do the two mirror images against each other.

    python demos/obstacle.py            # a minute
"""

import sys
from dataclasses import dataclass, replace
from pathlib import Path

import ngsolve as ngs
import numpy as np

import ngcloth
from ngcloth import plot

RATIOS = [1, 70, 80, 90, 100]  # ks/kc
COMPARED = [1, 100]  # of them, with and without the obstacle in Fig. 12
ANGLES = [0, 10, 15, 20, -10, -20]  # of the start, degrees
START = (0.3, 0.4)  # the paper's
MESH = 0.35
SIDE = {"azimuth": -25, "elevation": 35}


@dataclass(frozen=True)
class Start:
    """The paper's start, turned in its plane by `angle` degrees; for `Scene.start`."""

    angle: float = 0.0
    scale: tuple = START

    def __call__(self, theta1, theta2):
        """ψ1 and ψ2."""
        c, s = np.cos(np.radians(self.angle)), np.sin(np.radians(self.angle))
        x1, x2 = self.scale[0] * theta1, self.scale[1] * theta2
        return c * x1 - s * x2, s * x1 + c * x2


def scene(ratio, angle=0):
    """The hemicatenoid as an obstacle at ks/kc = `ratio`, its start turned by `angle`."""
    return replace(ngcloth.scenes.hemicatenoid(ratio, obstacle=True), start=Start(angle))


def minima(ratio, **settings):
    """What the starts lead to, lowest first; by default it takes a minute."""
    starts = [Start(angle) for angle in ANGLES]
    return ngcloth.minima(scene(ratio), starts, **{"maxh": MESH} | settings)


def rotation(result):
    """By how many degrees the patch is turned, in (−45, 45]: exchanging the threads adds 90."""
    return float(45 - (45 - _whole_rotation(result)) % 90)


def _whole_rotation(result, n=2000):
    """The angle in degrees of the matrix ∫ ∇ψ dθ = ∮ ψ ⊗ n ds."""
    psi, theta = result.outline(n), result.scene.surface.domain.rim(n)
    middle, edge = (psi + np.roll(psi, -1, axis=0)) / 2, np.roll(theta, -1, axis=0) - theta
    mean = middle.T @ np.stack([edge[:, 1], -edge[:, 0]], axis=-1)
    return np.degrees(np.arctan2(mean[1, 0] - mean[0, 1], mean[0, 0] + mean[1, 1]))


def placed(result, psi):
    """Points (n, 2) of the patch, moved so that patches compare.

    Two may differ by a shift, exchange their threads, or be mirror images, turned either way.
    """
    quarters = np.round((_whole_rotation(result) - rotation(result)) / 90)
    x1, x2 = (psi - result.psi(*result.scene.surface.domain.centre)).T
    for _ in range(int(quarters) % 4):
        x1, x2 = x2, -x1
    return np.stack([x1, -x2 if rotation(result) < 0 else x2], axis=-1)


def table(results):
    """Print the minima at each ks/kc, `results` being {ks/kc: results, lowest first}."""
    h = next(iter(results.values()))[0].settings["maxh"]
    print(
        f"\nhemicatenoid, τ ≥ 0, h = {h:g}; angles in degrees, of the start and of the patch\n"
        "ks/kc  start   patch   E/(2π kc)     area   max λ   least λ   least τ/kc  equilibrium  "
        "steps  seconds  why it stopped"
    )
    for ratio, found in results.items():
        for r in found:
            stretches = np.array([r.extrema["stretch1"], r.extrema["stretch2"]])
            print(
                f"{ratio:5g}  {r.scene.start.angle:5g}  {rotation(r):6.1f}  "
                f"{r.normalized_energy:10.5f}  {r.area:7.4f}  {stretches.max():6.4f}  "
                f"{stretches.min():8.4f}  {r.extrema['reaction'][0]:11.3f}  "
                f"{r.equilibrium_residual:11.3f}  {r.newton_iterations:5d}  {r.seconds:7.1f}  "
                f"{r.reason.name}"
            )
    print("Limits hold at the points of the integration rule; least λ and τ are between them.")


def claims(results, free):
    """Print what the paper says beside what came out; `free` is {ks/kc: result, no obstacle}."""
    turned = {ratio: abs(rotation(found[0])) for ratio, found in results.items()}
    stiff = [angle for ratio, angle in turned.items() if ratio >= 70]
    growing = all(b > a for a, b in zip(stiff, stiff[1:], strict=False))
    print("\nFig. 13: the patch is turned, the more the larger ks/kc is, the paper says.")
    print("Here: " + ", ".join(f"{a:.1f}° at {ratio:g}" for ratio, a in turned.items()) + ".")
    print(f"The angle {'grows' if growing else 'does not grow throughout'} from 70 to 100.")
    for ratio, without in free.items():
        best = results[ratio][0]
        print(
            f"ks/kc = {ratio:g}: the obstacle raises E/(2π kc) from {without.normalized_energy:.4f}"
            f" to {best.normalized_energy:.4f}; area {without.area:.3f} to {best.area:.3f}; "
            f"without it τ/kc goes down to {without.extrema['reaction'][0]:.2f}."
        )


def figures(results, free, out):
    """Draw Figs 12a-d and 13 to the folder `out`."""
    import matplotlib.pyplot as plt

    best = {ratio: found[0] for ratio, found in results.items()}
    figure, axes = plt.subplots(2, len(free), figsize=(11, 6.4), layout="constrained")
    for (above, below), (ratio, without) in zip(axes.T, free.items(), strict=True):
        reaction(above, without, zero=True)
        outline(below, without, color="0.5", linestyle="--", label="τ free")
        outline(below, best[ratio], color="black", label="τ ≥ 0")
        above.set_title(f"$k_s/k_c$ = {ratio:g}, τ free; black: τ = 0")
        below.set_title(f"turned by {abs(rotation(best[ratio])):.1f}°")
        below.legend(fontsize="small", loc="center")
    figure.savefig(out / "fig12_obstacle.png", dpi=120)

    stiff = [ratio for ratio in best if ratio > 1]
    figure, axes = plt.subplots(
        1, len(stiff), figsize=(4.2 * len(stiff), 3.6), layout="constrained", squeeze=False
    )
    for ax, ratio in zip(axes[0], stiff, strict=True):
        reaction(ax, best[ratio])
        ax.set_title(f"$k_s/k_c$ = {ratio:g}\nturned by {abs(rotation(best[ratio])):.1f}°")
    figure.savefig(out / "fig13_patches.png", dpi=120)

    figure, ax = plt.subplots(figsize=(5, 3.6), layout="constrained")
    points = [(ratio, abs(rotation(r))) for ratio, found in results.items() for r in found]
    ax.plot(*zip(*points, strict=True), "o", fillstyle="none", label="other starts")
    ax.plot(list(best), [abs(rotation(r)) for r in best.values()], "k.", label="lowest energy")
    ax.set(xlabel="$k_s/k_c$", ylabel="angle of the patch [°]")
    ax.legend(fontsize="small")
    figure.savefig(out / "fig13_rotation.png", dpi=120)
    plt.close("all")
    try:
        from ngcloth import view

        for ratio in stiff:
            name = out / f"fig13_cloth_{ratio:g}.png"
            view.cloth(best[ratio], field="reaction", pitch=0.2, screenshot=name, **SIDE)
    except (ImportError, RuntimeError) as error:  # a machine without any graphics library
        print(f"The cloth of Fig. 13 is left out: {error}")


def outline(ax, result, **line):
    """The outline of the patch, placed."""
    x = placed(result, result.outline())
    ax.plot(*np.concatenate([x, x[:1]]).T, **line)
    ax.use_sticky_edges = False  # contours would cut the outline in half
    ax.margins(0.04)
    ax.set(aspect="equal", xlabel="$X_1$ [length]", ylabel="$X_2$ [length]")


def reaction(ax, result, zero=False):
    """The patch, placed, in the colours of τ, white at 0; and the curves on which τ = 0."""
    theta, triangles = plot.sample(result)
    x = placed(result, result.psi(*theta.T)).T
    values = plot.sampled_field(result, "reaction", theta)
    levels = np.linspace(-values.max(), values.max(), 32)
    filled = ax.tricontourf(*x, triangles, values, levels, cmap="RdBu_r", extend="min")
    ax.figure.colorbar(filled, ax=ax, label=plot.LABELS["reaction"], shrink=0.85, format="%.1f")
    if zero:
        ax.tricontour(*x, triangles, values, levels=[0], colors="black")
    outline(ax, result, color="black", linewidth=1)


def main(out="out"):
    """Solve, print, draw."""
    # With several threads the last digits vary, and they may decide which mirror image is found.
    ngs.SetNumThreads(1)
    results = {}
    for ratio in RATIOS:
        results[ratio] = minima(ratio)
        print(f"ks/kc = {ratio}: {', '.join(r.reason.name for r in results[ratio])}", flush=True)
    free = {ratio: ngcloth.solve(ngcloth.scenes.hemicatenoid(ratio)) for ratio in COMPARED}
    table(results)
    claims(results, free)
    for r in results[100]:
        print(f"ks/kc = 100, turned by {rotation(r):.1f}°: {r.certificate()}")
    out = Path(out)
    out.mkdir(parents=True, exist_ok=True)
    figures(results, free, out)
    print(f"Pictures: {', '.join(sorted(str(path) for path in out.glob('fig1[23]*.png')))}")


if __name__ == "__main__":
    main(*sys.argv[1:])
