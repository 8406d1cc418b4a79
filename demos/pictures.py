"""The pictures of the README and of the gallery: each flat patch, and the cloth that it becomes.

A patch ψ(U) and the surface φ(U) that it covers have the same threads: the lines ψ2 = const are the
warp (blue), ψ1 = const the weft (orange). On the left they are straight, at ψ(θ), where the cloth
is cut; on the right they lie as they are worn, at φ(θ), over a field f(θ) in colours:

    γ = C12/(λ1 λ2), the cosine of the angle between the threads, C = ∇ψ⁻ᵀ ∇φᵀ∇φ ∇ψ⁻¹;
    λ1 = √C11, the stretch of the warp;
    τ = −2 S : b, the reaction, with which the surface pushes (τ > 0) or pulls, over kc.

    python demos/pictures.py            # a minute; writes docs/pictures/
"""

import sys
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory

import ngsolve as ngs
import numpy as np

import ngcloth
from ngcloth import Disk, Elongation, Net, Scene, Surface, plot, scenes

SIDE, BELOW = {"azimuth": -25, "elevation": 35}, {"azimuth": -45, "elevation": -5}


def ellipsoid(theta1, theta2):
    """A cap of the ellipsoid with half axes √3, 1.6 and 1."""
    return theta1, 0.8 * theta2, ngs.sqrt(1 - theta1**2 / 3 - theta2**2 / 4)


def turned(theta1, theta2):
    """The paper's start for the obstacle, (0.3 θ1, 0.4 θ2), turned by 15°."""
    c, s = np.cos(np.pi / 12), np.sin(np.pi / 12)
    return c * 0.3 * theta1 - s * 0.4 * theta2, s * 0.3 * theta1 + c * 0.4 * theta2


CAP = Scene(Surface(ellipsoid, Disk(1.2)), Net(ks=10), [Elongation()], symmetric=True, name="cap")
LARGE = scenes.sphere(0.85, shear_limit=np.cos(np.pi / 6))
OBSTACLE = replace(scenes.hemicatenoid(100, obstacle=True), start=turned)

# Name: scene, settings, field, distance of the threads, where to look from.
PICTURES = {
    "hemisphere": (scenes.hemisphere(), {}, "shear", 0.15, {}),
    "hemicatenoid": (scenes.hemicatenoid(), {}, "shear", 0.2, SIDE),
    "sphere_portions": (scenes.sphere(0.8), {}, "shear", 0.2, BELOW),
    "own_surface": (CAP, {"maxh": 0.15}, "stretch1", 0.1, {}),
    "elastic": (scenes.hemisphere(ks=10), {"maxh": 0.1}, "stretch1", 0.1, {}),
    "shear_limited": (LARGE, {"maxh": 0.15}, "reaction", 0.2, BELOW),
    "obstacle": (OBSTACLE, {"maxh": 0.35, "order": 3}, "reaction", 0.2, SIDE),
}


def solve(name, **settings):
    """Solve the scene of one of the `PICTURES`."""
    scene, usual, *_ = PICTURES[name]
    return ngcloth.solve(scene, **usual | settings)


def draw(name, result, out):
    """Draw the result of one of the `PICTURES` to the folder `out`; the path of the picture."""
    import matplotlib.pyplot as plt
    from PIL import Image  # comes with matplotlib

    from ngcloth import view

    _, _, field, pitch, side = PICTURES[name]
    ratios = {"width_ratios": [1, 1.25]}
    figure, (flat, worn) = plt.subplots(
        1, 2, figsize=(8.4, 3.6), layout="constrained", gridspec_kw=ratios
    )
    plot.patch(flat, result, pitch=pitch)
    with TemporaryDirectory() as folder:
        cloth = Path(folder) / "cloth.png"
        view.cloth(result, field=field, pitch=pitch, screenshot=cloth, size=(920, 740), **side)
        worn.imshow(plt.imread(cloth))
    worn.axis("off")
    path = Path(out) / f"{name}.png"
    figure.savefig(path, dpi=100)
    plt.close(figure)
    # 256 colours, mixed from dot to dot, take half the bytes.
    full = Image.open(path).convert("RGB")
    full.quantize(palette=full.quantize(256)).save(path, optimize=True)
    return path


def main(out="docs/pictures"):
    """Solve and draw all."""
    Path(out).mkdir(parents=True, exist_ok=True)
    for name in PICTURES:
        result = solve(name)
        print(f"{draw(name, result, out)}: {result.scene.name}, {result.reason}")


if __name__ == "__main__":
    main(*sys.argv[1:])
