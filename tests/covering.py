"""Patches that nobody solved for."""

import ngsolve as ngs
from netgen.occ import OCCGeometry

from ngcloth import Net, Rectangle, Result, Scene, Surface
from ngcloth.result.history import Reason

PLANE = Surface(lambda x, y: (x, y, 0 * x), Rectangle((0, 1), (0, 1)))


def covered(psi, surface=PLANE, fabric=None, order=2, symmetric=False):
    """A result that nobody solved for."""
    face = surface.domain.face(symmetric)
    mesh = ngs.Mesh(OCCGeometry(face, dim=2).GenerateMesh(maxh=0.3))
    state = ngs.GridFunction(ngs.FESpace([ngs.H1(mesh, order=order)] * 2))
    for component, value in zip(state.components, psi(ngs.x, ngs.y), strict=True):
        component.Set(value)
    scene = Scene(surface, fabric or Net(ks=1.0), symmetric=symmetric)
    settings = {"order": order, "quadrature": 2 * order + 2}
    return Result(scene, state, Reason.CONVERGED, 0.0, 0, 0.0, [], settings, surface.on(mesh))
