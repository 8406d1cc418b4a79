"""The meshes that a scene is solved on: nested, so that each holds the patches of the coarser."""

import ngsolve as ngs
import numpy as np
from netgen.occ import OCCGeometry

from ..geometry.file_surface import FileSurface

COARSEST = 0.3  # mesh size over diameter
COARSER = 2  # the size of each over that of the next finer one, which is a refinement of it


def make_sheets(scene, maxh, order):
    """The surface on the meshes that a scene is solved on, a `Sheet` each, the finest last."""
    levels, surface = coarser_levels(scene, maxh), scene.surface
    if isinstance(surface, FileSurface):
        return surface.sheets(maxh, order, levels, scene.symmetric)
    sizes = [maxh * COARSER**level for level in reversed(range(levels + 1))]
    return [surface.on(make_mesh(scene, size, order)) for size in sizes]


def make_mesh(scene, maxh, order):
    """The curved triangulation of the scene's domain, or of its quarter.

    In a scene with limits it is refined from the coarser ones that are solved first. Interpolation
    between meshes that are not nested would leave their limits, and equilibrium.
    """
    face = scene.surface.domain.face(scene.symmetric)
    levels = coarser_levels(scene, maxh)
    mesh = OCCGeometry(face, dim=2).GenerateMesh(maxh=maxh * COARSER**levels)
    for _ in range(levels):
        mesh.Refine()
    mesh = ngs.Mesh(mesh)
    mesh.Curve(order)
    return mesh


def coarser_levels(scene, maxh):
    """How many coarser meshes are solved first."""
    if not scene.constraints:
        return 0
    return max(int(np.log(COARSEST * scene.surface.diameter / maxh) / np.log(COARSER)), 0)
