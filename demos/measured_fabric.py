"""From the tests of a fabric, in CSV files, to a draped part with its shear angles.

How does one clothe a part in a woven fabric that is known by tests alone?

    W = W1(I4) + W2(I6) + W3(I8),  each convex, through the rows of a test:
    tension of warp and weft, 2 λ W1'(λ²) = force per width at stretch λ;
    shear by a picture frame of arms L, displacement d, force F, specimen of side l:
    √2 L + d = 2 L cos(45° − φ/2),  W3'(sin φ) = F L / (2 cos(45° − φ/2) l²).

The records are synthetic, with 2 % of noise: threads that are crimped at first, and shear that is
free up to about 30° and locks beyond 45°, as is usual for woven reinforcements. The part is a boss
on a plate, in mm. Threads may not go slack. The table tells how well the tests are met, and what
they do not determine.

    python demos/measured_fabric.py     # half a minute; files and pictures in out/measured_fabric
"""

from pathlib import Path

import matplotlib

if __name__ == "__main__":
    matplotlib.use("Agg")
import matplotlib.pyplot as plt
import ngsolve as ngs
import numpy as np

import ngcloth

OUT = Path("out/measured_fabric")
ARM, SIDE = 200.0, 150.0  # mm
NOISE, ROWS = 0.02, 500
HEIGHT, WIDTH = 60.0, 50.0  # mm, of the boss


def tension(stretch):
    """Newton per mm of width: crimp, then glass."""
    crimp = 0.003
    strain = stretch - 1
    return 4000 * (np.hypot(strain, crimp) - crimp) + 400 * strain


def shear_force(gamma):
    """Newton per mm: friction, then locking between 30° and 45°."""
    free, locked = np.sin(np.radians([30, 45]))
    beyond = np.clip(gamma - free, 0, None)
    ramp = np.where(gamma < locked, beyond**2 / (2 * (locked - free)), 0)
    ramp = np.where(gamma < locked, ramp, beyond - (locked - free) / 2)
    return 0.01 * np.tanh(gamma / 0.05) + 0.02 * gamma + 1.5 * ramp


def write_records(folder, seed=0):
    """Write synthetic records of the tests as CSV files."""
    folder.mkdir(parents=True, exist_ok=True)
    noise = np.random.default_rng(seed)
    stretch = np.linspace(1, 1.02, ROWS)
    phi = np.radians(np.linspace(0, 55, ROWS))
    half = np.pi / 4 - phi / 2
    displacement = 2 * ARM * np.cos(half) - np.sqrt(2) * ARM
    pull = shear_force(np.sin(phi)) * 2 * np.cos(half) * SIDE**2 / ARM
    tables = {
        "warp.csv": ("stretch,force [N/mm]", stretch, tension(stretch)),
        "weft.csv": ("stretch,force [N/mm]", stretch, 0.8 * tension(stretch)),
        "picture_frame.csv": ("displacement [mm],force [N]", displacement, pull),
    }
    for name, (header, at, force) in tables.items():
        rows = np.column_stack([at, force * (1 + NOISE * noise.standard_normal(ROWS))])
        np.savetxt(folder / name, rows, "%.6g", ",", header=header, comments="")


def fabric(folder):
    """The fabric of these files."""
    frame = ngcloth.PictureFrame(folder / "picture_frame.csv", arm=ARM, side=SIDE)
    return ngcloth.MeasuredFabric(folder / "warp.csv", folder / "weft.csv", frame)


def boss(x, y):
    """The part: an oval boss on a plate, in mm."""
    return x, y, HEIGHT * ngs.exp(-(x**2 + 1.5 * y**2) / WIDTH**2)


def scene(cloth):
    """The part in this cloth, with taut threads."""
    part = ngcloth.Surface(boss, ngcloth.Rectangle((-110, 110), (-90, 90)))
    limits = [ngcloth.Elongation()]
    return ngcloth.Scene(part, cloth, limits, symmetric=True, name="boss in measured fabric")


def solve(cloth, maxh=8.0):
    """The draped part; a barrier of the default weight would weigh as much as this cloth does."""
    return ngcloth.solve(scene(cloth), maxh=maxh, order=3, barrier_end=1e-4)


def main():
    """Write the records, fit, drape, and draw."""
    write_records(OUT)
    cloth = fabric(OUT)
    print(cloth)
    print("not determined by these tests:", *cloth.undetermined, sep="\n  - ")
    axes = cloth.plot()
    axes[0].figure.savefig(OUT / "fabric.png", dpi=150)
    result = solve(cloth)
    print(result, result.certificate(), sep="\n")
    _, axes = plt.subplots(1, 2, figsize=(12, 5), layout="constrained")
    result.plot("angle", ax=axes[0])
    result.plot("stretch1", ax=axes[1])
    axes[0].figure.savefig(OUT / "patch.png", dpi=150)
    result.view("angle", screenshot=OUT / "part.png")
    result.export_svg(OUT / "pattern.svg", unit_mm=1)
    print(f"CSV files, pictures and the pattern are in {OUT}")


if __name__ == "__main__":
    main()
