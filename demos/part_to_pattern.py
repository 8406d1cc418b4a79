"""From a CAD part to a cut pattern: a hood with rounded corners and a hole, warp along its length.

Which flat patch ψ(U) covers the faces of a STEP file? The problem is that of the other demos,

    minimise  E(ψ) = ∫ J (kc (I4 − 1)² + kc (I6 − 1)² + ks I8²),  ks = kc,
    with λ1, λ2 ≥ 1 (no slack threads), equilibrium in the surface, and ∇ψ2·d = 0 at one point:

there the warp runs along d, the given direction in space projected on the part. The STEP file is
made here by Netgen's OpenCascade; a part of your own takes its place.
"""

import sys
from pathlib import Path

from netgen.occ import Axes, Box, Cylinder, Pnt, Sphere, WorkPlane, Z

import ngcloth

RADIUS = 400.0  # mm
SIZE = 360.0, 240.0
CORNER, HOLE = 50.0, 30.0


def write_part(path):
    """Write a hood, a piece of a spherical shell, as a solid 5 mm thick."""
    shell = Sphere(Pnt(0, 0, 0), RADIUS) - Sphere(Pnt(0, 0, 0), RADIUS - 5)
    plane = WorkPlane(Axes((0, 0, 0), n=Z)).RectangleC(*SIZE).Face().Extrude(2 * RADIUS)
    upright = [edge for edge in plane.edges if abs(edge.start.z - edge.end.z) > RADIUS]
    hood = shell * plane.MakeFillet(upright, CORNER)
    hood = hood - Cylinder(Pnt(70, 20, 0), Z, HOLE, 2 * RADIUS)
    hood = hood * Box(Pnt(-RADIUS, -RADIUS, 0), Pnt(RADIUS, RADIUS, 2 * RADIUS))
    both = sorted(hood.faces, key=lambda face: face.mass)[-2:]
    outside = max(both, key=lambda face: face.center.z)
    outside.name = "outside"
    hood.WriteStep(str(path))


def main(folder="."):
    """Solve, print the certificate, write pattern and pictures to `folder`."""
    folder = Path(folder)
    write_part(folder / "hood.step")
    part = ngcloth.Surface.from_cad(folder / "hood.step", "outside", unit="mm")
    print(part)
    taut = [ngcloth.Elongation()]
    scene = ngcloth.Scene(part, ngcloth.Net(ks=1.0), taut, warp=(1, 0, 0), name="hood")
    result = ngcloth.solve(scene, maxh=20.0, log=print)
    print(result, result.certificate(), sep="\n")
    result.export_dxf(folder / "hood.dxf", seam=10.0, pitch=20.0)
    result.export_svg(folder / "hood.svg", pitch=20.0)
    result.plot("shear").figure.savefig(folder / "hood.png", dpi=100)
    result.view("shear", screenshot=folder / "hood_on_part.png")
    return result


if __name__ == "__main__":
    main(*sys.argv[1:])
