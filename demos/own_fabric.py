"""Fabrics, limits and costs of one's own, on the hemisphere (§2 and §3 with other laws).

How does the patch ψ(U) change with what the cloth is made of, and with what is asked of it?

    minimise  ∫ J χ, by default χ = W(I4, I6, I8), any smooth law
    such that  slacks c(ψ) ≥ 0 hold, and dE(ψ)[v] = 0 for all v that vanish on the rim:
               the pinned cloth is in equilibrium along the surface.

Stress and its derivatives follow from W by symbolic differentiation. Beside the paper's net,
W = kc (I4 − 1)² + kc (I6 − 1)² + ks I8² (eq. 25) with taut threads, 1 − 1/λ ≥ 0, the table has

- a net with warp twice and weft half as stiff, kc = 2 and ½;
- threads that lock: W = Σ kc/b (exp(b (I − 1)²) − 1) + ks I8²;
- another limit in place of the taut threads: none is longer than 1.1 times its length,
  c = 1/λ − 1/1.1;
- another cost in place of W: χ = kc γ² + W/100, little shear rather than little stretch.

    python demos/own_fabric.py          # some seconds; a table, and outlines to out/own_fabric
"""

from dataclasses import dataclass, replace
from pathlib import Path

import matplotlib

if __name__ == "__main__":
    matplotlib.use("Agg")
import matplotlib.pyplot as plt
import ngsolve as ngs
import numpy as np

import ngcloth

OUT = Path("out/own_fabric")
PAPERS = ngcloth.scenes.hemisphere(ks=10)


@dataclass(frozen=True)
class Locking:
    """Threads whose stiffness grows exponentially with the stretch."""

    ks: float = 10.0
    b: float = 1.0
    stiffness = 1.0

    def energy(self, I4, I6, I8):
        """W: for small strains that of the paper's net."""
        threads = sum((ngs.exp(self.b * (i - 1) ** 2) - 1) / self.b for i in (I4, I6))
        return threads + self.ks * I8**2


@dataclass(frozen=True)
class Longest:
    """No thread is stretched to more than `maximum` times its length."""

    maximum: float
    name = "longest thread"

    def slacks(self, cloth):
        """1/λ − 1/λmax for both families."""
        return tuple(1 / s - 1 / self.maximum for s in (cloth.stretch1, cloth.stretch2))


def little_shear(cloth):
    """χ/kc per flat area."""
    return cloth.shear**2 + 0.01 * cloth.fabric.energy(cloth.I4, cloth.I6, cloth.I8)


SCENES = {
    "paper's net": PAPERS,
    "warp 2, weft ½": replace(PAPERS, fabric=ngcloth.Net(kc=(2.0, 0.5), ks=10.0)),
    "locking threads": replace(PAPERS, fabric=Locking()),
    "λ ≤ 1.1": replace(PAPERS, constraints=(Longest(1.1),)),
    "little shear": replace(PAPERS, cost=little_shear),
}


def solve(name, maxh=0.15, log=None):
    """One of the `SCENES`, solved."""
    return ngcloth.solve(SCENES[name], maxh=maxh, log=log)


def main():
    """Solve all, print the table, draw the outlines."""
    OUT.mkdir(parents=True, exist_ok=True)
    _, ax = plt.subplots(figsize=(6, 6))
    print(
        f"{'':16s} {'E/2πkc':>8s} {'area':>7s} {'λ1 max':>7s} {'λ2 max':>7s} {'|γ| max':>7s} steps"
    )
    for name in SCENES:
        result = solve(name)
        ends = [result.extrema[field][1] for field in ("stretch1", "stretch2", "shear")]
        numbers = "{:8.4f} {:7.4f} {:7.4f} {:7.4f} {:7.4f}".format(
            result.normalized_energy, result.area, *ends
        )
        told = "" if result.converged else f"  {result.reason}"
        print(f"{name:16s} {numbers} {result.newton_iterations:5d}{told}")
        outline = result.outline(400)
        ax.plot(
            *np.vstack([outline, outline[:1]]).T, label=name if result.converged else f"({name})"
        )
    ax.set(
        aspect="equal", xlabel="$X_1$", ylabel="$X_2$", title="Outlines, hemisphere, $k_s/k_c = 10$"
    )
    ax.legend()
    plt.savefig(OUT / "outlines.png", dpi=150)
    print(f"outlines in {OUT}")


if __name__ == "__main__":
    main()
