"""Files that other programs have written.

`gmsh_bump.step`, by gmsh 4.15.2 with OpenCASCADE: a sphere of radius 100 about (0, 0, −60) fused
with a plate 240 × 200 whose upper face is z = 0, the edge between them rounded with 25 (mm).
`trimesh_dome.ply`, by trimesh 5.2.0: those triangles of ``creation.icosphere(subdivisions=3)``
whose middles lie above z = 0.05, in binary.
"""

from pathlib import Path

import ngsolve as ngs
import numpy as np
import pytest

from ngcloth import Surface

PARTS = Path(__file__).parent / "parts"
AREAS = 20106.19, 10592.24, 21610.62  # of the three upper faces, as gmsh measures them


def test_step_of_gmsh():
    part = Surface.from_cad(PARTS / "gmsh_bump.step", lambda face: face.centre[2] > -1e-3)
    assert part.faces == 3 and part.sharp == 0 and len(part.topology.rims) == 1
    assert part.area == pytest.approx(sum(AREAS), rel=1e-4)
    assert part.least_radius == pytest.approx(25, rel=0.03)
    assert "240 × 200 × 40 mm" in str(part)  # the kernel's box is wider than the part
    (sheet,) = part.sheets(40.0, order=2)
    summit = max(sheet.position(sheet.mesh(*v.point))[2] for v in sheet.mesh.vertices)
    assert 38 < summit <= 40 + 1e-9


def test_ply_of_trimesh():
    dome = Surface.from_mesh(PARTS / "trimesh_dome.ply")
    assert len(dome.triangles) == 608 and dome.noise < 1e-5
    (sheet,) = dome.sheets(0.2, order=2)
    points = sheet.mesh.MapToAllElements(ngs.IntegrationRule(ngs.TRIG, 4), ngs.VOL)
    radii = np.linalg.norm(sheet.position(points), axis=1)
    assert np.abs(radii - 1).max() < 2e-3  # facets are 2.5e-3 inside, their rim a zigzag
