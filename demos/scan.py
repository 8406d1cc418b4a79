"""From a scan to a patch: facets with noise and a ragged rim, smoothed as far as they need it.

Which flat patch covers a surface that is known at points alone, each off by a little? Polynomials
of degree 4 are fitted around vertices, through so many neighbours as the noise asks for, and the
cloth lies on the smooth surface that blends them. Noise of 0.1 mm on a dome of 200 mm is no harm
to patch and energy, σ_H ~ σ/(ρ² √k) is left of it in the mean curvature; much more, and
`from_mesh` warns. The STL file is made here; a scan of your own takes its place.
"""

import sys
from pathlib import Path

import numpy as np
import pyvista as pv
from scipy.spatial import Delaunay

import ngcloth

NOISE = 0.1  # mm
POINTS = 12_000


def write_scan(path):
    """Write an ellipsoidal cap, 240 × 180 mm, as a scanner leaves it."""
    random = np.random.default_rng(3)
    xy = random.uniform(-1, 1, (POINTS, 2)) * [130, 100]
    triangles = Delaunay(xy).simplices
    angle, far = np.arctan2(xy[:, 1] / 90, xy[:, 0] / 120), np.hypot(xy[:, 0] / 120, xy[:, 1] / 90)
    inside = far < 0.95 + 0.02 * np.sin(9 * angle) + 0.02 * np.sin(23 * angle)
    triangles = triangles[inside[triangles].all(axis=1)]
    for _ in range(3):  # no ears of one triangle
        edges = np.sort(triangles[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2), axis=1)
        _, edge, times = np.unique(edges, axis=0, return_inverse=True, return_counts=True)
        triangles = triangles[(times[edge].reshape(-1, 3) == 2).sum(axis=1) > 1]
    z = 90 * np.sqrt(np.maximum(1 - (xy[:, 0] / 160) ** 2 - (xy[:, 1] / 130) ** 2, 0))
    points = np.column_stack([xy, z + NOISE * random.standard_normal(POINTS)])
    pv.PolyData.from_regular_faces(points, triangles).save(path)


def main(folder="."):
    """Solve, print the certificate, write pattern and pictures to `folder`."""
    folder = Path(folder)
    write_scan(folder / "scan.stl")
    scan = ngcloth.Surface.from_mesh(folder / "scan.stl", unit="mm")
    print(scan)
    taut = [ngcloth.Elongation()]
    scene = ngcloth.Scene(scan, ngcloth.Net(ks=1.0), taut, warp=(1, 0, 0), name="scan")
    result = ngcloth.solve(scene, maxh=25.0, log=print)
    print(result, result.certificate(), sep="\n")
    result.export_svg(folder / "scan.svg", pitch=20.0)
    result.export_vtu(folder / "scan.vtu")
    result.export_surface(folder / "scan_smooth.stl")
    result.plot("shear").figure.savefig(folder / "scan.png", dpi=100)
    result.view("shear", screenshot=folder / "scan_on_part.png")
    return result


if __name__ == "__main__":
    main(*sys.argv[1:])
