"""The hemisphere clothed with a Chebyshev net, beside the exact one (§5.1, Figs 4 and 5).

Which flat patch ψ(U) covers the unit hemisphere without stretching its threads? Shearing is free
(ks = 0), so that the least energy

    E(ψ) = ∫ J kc ((I4 − 1)² + (I6 − 1)²)

is zero, and belongs to a net of inextensible threads. The one with the symmetry of the axes is
known exactly: the angle between its threads is g(X1 X2) with z g'' + g' + sin g = 0, g(0) = π/2.
The tips of its patch lie on the axes at π/2. Along the diagonal, X1 = X2 = s/√2, the paper gives
the first terms of the shear, γ = cos g(s²/2) ≈ cos(π/2 − s²/2 + s⁶/144) (eq. 27).
"""

import sys
from pathlib import Path

import numpy as np

import ngcloth
from ngcloth.chebyshev import ChebyshevNet, sphere_angle

RUNS = [{"order": 2}, {"order": 6, "maxh": 0.3}, {"order": 8, "maxh": 0.3}]
TIP = np.pi / 2
CORNER, CORNER_SHEAR = 0.980506754806, 0.792557400544  # of the exact net, at 45° on the rim
QUARTER = np.linspace(0, np.pi / 2, 101)  # a quarter of the rim
RIM = np.stack([np.cos(QUARTER), np.sin(QUARTER)], axis=-1)


def solve(log=None, **settings):
    """Solve the scene; the default settings take a second."""
    return ngcloth.solve(ngcloth.scenes.hemisphere(), log=log, **settings)


def exact_outline():
    """A quarter of the exact patch's outline, at the points `RIM`."""
    return ChebyshevNet.symmetric(ngcloth.scenes.hemisphere().surface).material(RIM)


def diagonal(result):
    """Arc length s along the flat diagonal, from rim to rim, zero at the centre, and γ there."""
    theta = np.linspace(-np.sqrt(0.5), np.sqrt(0.5), 201)
    s = np.sign(theta) * np.linalg.norm(result.psi(theta, theta), axis=-1)
    return s, result.field("shear", theta, theta)


def eq27(s):
    """The shear along the diagonal as the paper gives it."""
    return np.cos(np.pi / 2 - s**2 / 2 + s**6 / 144)


def errors(result):
    """What the closing table says of a result, by name."""
    corner = np.sqrt(0.5)
    s, shear = diagonal(result)
    return {
        "energy E/(2π kc)": result.normalized_energy,
        "outline, farthest from exact": np.abs(result.psi(*RIM.T) - exact_outline()).max(),
        "tip on the axis − π/2": result.psi(1, 0)[0] - TIP,
        f"45° point − {CORNER}": result.psi(corner, corner)[0] - CORNER,
        f"γ there − {CORNER_SHEAR}": result.field("shear", corner, corner) - CORNER_SHEAR,
        "γ on the diagonal, from exact": np.abs(shear - np.cos(sphere_angle(s**2 / 2))).max(),
        "γ on the diagonal, from eq. (27)": np.abs(shear - eq27(s)).max(),
        "Newton steps": result.newton_iterations,
        "seconds": result.seconds,
    }


def table(results):
    """Print the errors of several results side by side."""
    titles = ["order {order}, maxh {maxh:g}".format(**result.settings) for result in results]
    print(f"\n{'hemisphere, ks = 0':35s}" + "".join(f"{title:>20s}" for title in titles))
    columns = [errors(result) for result in results]
    for name in columns[0]:
        form = {"Newton steps": "20d", "seconds": "20.2f"}.get(name, "20.2e")
        print(f"{name:35s}" + "".join(f"{column[name]:{form}}" for column in columns))
    s, _ = diagonal(results[-1])
    gap = np.abs(eq27(s) - np.cos(sphere_angle(s**2 / 2))).max()
    print(f"Eq. (27) leaves out terms from s¹⁰ on: it is itself off by {gap:.2e}.")


def figures(result, out):
    """Draw Figs 4a, 4b, 5a, 5b and 5c to the folder `out`."""
    import matplotlib.pyplot as plt

    from ngcloth import plot

    def save(figure, name):
        figure.savefig(out / name, dpi=120)
        plt.close(figure)

    figure, ax = plt.subplots(figsize=(4.5, 4.5), layout="constrained")
    plot.patch(ax, result, label="optimal patch")
    quarter = exact_outline()[::5]
    exact = np.concatenate([quarter * sign for sign in [(1, 1), (-1, 1), (-1, -1), (1, -1)]])
    ax.plot(*exact.T, "o", color="tab:red", markersize=3.5, fillstyle="none", label="exact net")
    ax.legend(loc="center")
    save(figure, "fig4a_patch.png")

    figure, ax = plt.subplots(figsize=(5, 4.2), layout="constrained")
    plot.patch(ax, result, field="shear")
    end = CORNER * np.array([-1, 1])
    ax.plot(end, end, "k--", linewidth=1)
    for name, place in zip("ab", end, strict=True):
        ax.annotate(name, (place, place), (1.12 * place, 1.12 * place), ha="center", va="center")
    save(figure, "fig5a_shear.png")

    figure, ax = plt.subplots(figsize=(4.8, 3.6), layout="constrained")
    s, shear = diagonal(result)
    ax.plot(s, np.cos(sphere_angle(s**2 / 2)), color="0.7", linewidth=4, label="exact net")
    ax.plot(s, shear, color="tab:blue", label="optimal patch")
    ax.plot(s[::10], eq27(s[::10]), "o", color="tab:red", fillstyle="none", label="eq. (27)")
    ax.set(xlabel=r"$s$ along $ab$ [length]", ylabel=r"shear $\gamma$")
    ax.legend()
    save(figure, "fig5b_diagonal.png")

    figure, ax = plt.subplots(figsize=(4.8, 3.6), layout="constrained")
    paper, adaptive = (solve(maxh=0.2, schedule=schedule) for schedule in ("paper", "adaptive"))
    steps = "{}, {} Newton steps".format
    plot.convergence(ax, paper, label=steps("Δt = 0.1, as in the paper", paper.newton_iterations))
    plot.convergence(ax, adaptive, label=steps("Δt adaptive", adaptive.newton_iterations))
    ax.set_title("maxh = 0.2", fontsize="medium")
    ax.legend(loc="center right", fontsize="small")
    save(figure, "fig5c_convergence.png")

    try:
        from ngcloth import view

        view.cloth(result, pitch=0.15, screenshot=out / "cloth.png")
    except (ImportError, RuntimeError) as error:  # a machine without any graphics library
        print(f"Fig. 4b is left out: {error}")
        return
    figure, (left, right) = plt.subplots(1, 2, figsize=(8, 4), layout="constrained")
    plot.patch(left, result, pitch=0.15)
    right.imshow(plt.imread(out / "cloth.png"))
    right.axis("off")
    save(figure, "fig4b_cloth.png")
    (out / "cloth.png").unlink()


def main(out="out"):
    """Solve, print, draw."""
    result = solve(log=print)
    print(f"\n{result}")
    table([result] + [solve(**settings) for settings in RUNS[1:]])
    out = Path(out)
    out.mkdir(parents=True, exist_ok=True)
    figures(result, out)
    print(f"Pictures: {', '.join(sorted(str(path) for path in out.glob('fig[45]*.png')))}")


if __name__ == "__main__":
    main(*sys.argv[1:])
