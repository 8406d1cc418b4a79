"""A curved triangulation in space as a chart on a flat copy of its triangles."""

import netgen.meshing
import ngsolve as ngs
import numpy as np

from ._kernel import lattice


class Sheet:
    """The chart φ on a planar, straight-sided mesh: a polynomial on each triangle.

    It is continuous, and smooth inside triangles alone; so the metric jumps from one to the next.

    Parameters
    ----------
    flat : ndarray, (n, 2)
        Vertices of the planar mesh.
    triangles : ndarray of int, (m, 3)
        Counter-clockwise, the surface seen from the side of the cloth.
    segments : ndarray of int, (s, 2)
        Edges of the rim.
    names : ndarray of str, (s,)
        Their names, "rim", "mirror1" or "mirror2".
    nodes : dict
        By the order of φ, the nodes (m, (order + 1)(order + 2)/2, 3) of `lattice` in space, of two
        orders or of one. The metric is of the lower order, that of ψ; normal and curvature are of
        the higher.

    Attributes
    ----------
    mesh : ngsolve.Mesh
    position : CoefficientFunction, (3,)
        φ.
    metric, curvature : CoefficientFunction, (2, 2)
        First and second fundamental form, of φ and of the φ of higher order. Both can be sampled
        on the rim as well.
    normal : CoefficientFunction, (3,)
        Unit normal, on the side of the cloth.
    mean_curvature, gauss_curvature : CoefficientFunction
        Of the φ of higher order alone, as precise as it is.
    """

    def __init__(self, flat, triangles, segments, names, nodes):
        self.mesh = planar_mesh(flat, triangles, segments, names)
        lower, higher = min(nodes), max(nodes)
        self.position, tangents, _ = _chart(self.mesh, lower, nodes[lower])
        self.metric = _products(tangents)
        _, tangents, hessians = _chart(self.mesh, higher, nodes[higher])
        across = ngs.Cross(*tangents)
        self.normal = across / ngs.Norm(across)
        x, y, z = (self.normal[i] * hessians[i] for i in range(3))
        self.curvature = x + y + z
        shape = ngs.Inv(_products(tangents)) * self.curvature
        self.mean_curvature, self.gauss_curvature = ngs.Trace(shape) / 2, ngs.Det(shape)


def _products(tangents):
    first, second = tangents
    return ngs.CF((first * first, first * second, first * second, second * second), dims=(2, 2))


def planar_mesh(flat, triangles, segments, names):
    """The mesh of triangles in the plane, its edges `segments` named."""
    mesh = netgen.meshing.Mesh(dim=2)
    mesh.AddPoints(np.ascontiguousarray(flat, dtype=float))
    region = mesh.AddRegion("default", dim=2)
    mesh.AddElements(dim=2, index=region, data=triangles.astype(np.int32))
    for number, name in enumerate(np.unique(names), start=1):
        region = mesh.AddRegion(str(name), dim=1)
        place = mesh.EdgeDescriptor(region)
        place.edgenr, place.domin, place.domout, place.fdindex = number, 1, 0, 1
        mesh.AddElements(dim=1, index=region, data=segments[names == name].astype(np.int32))
    return ngs.Mesh(mesh)


def _chart(mesh, order, nodes):
    """φ of one order through nodes; ∂1φ and ∂2φ; the second derivatives of each component."""
    chart = ngs.GridFunction(ngs.H1(mesh, order=order) ** 3, name="position")
    coefficients = chart.vec.FV().NumPy().reshape(3, -1)
    for elements, shapes, dofs in _elements(chart.components[0].space):
        values = np.linalg.solve(shapes, nodes[elements])
        coefficients[:, dofs] = values.transpose(2, 0, 1)
    # On edges of the rim, NGSolve knows but the derivatives along them.
    gradients = [ngs.BoundaryFromVolumeCF(ngs.Grad(part)) for part in chart.components]
    hessians = [ngs.BoundaryFromVolumeCF(part.Operator("hesse")) for part in chart.components]
    tangents = [ngs.CF(tuple(gradient[i] for gradient in gradients)) for i in (0, 1)]
    return ngs.CF(tuple(chart.components)), tangents, hessians


def _elements(space):
    """Triangles with the same shape functions, their values at the nodes, and their numbers.

    Those of NGSolve depend on the order in which the vertices of a triangle are numbered.
    """
    mesh, order = space.mesh, space.globalorder
    vertices = np.array([[v.nr for v in element.vertices] for element in mesh.Elements()])
    kind = np.argsort(vertices, axis=1) @ [9, 3, 1]
    dofs = np.array([element.dofs for element in space.Elements()])
    for each in np.unique(kind):
        elements = np.flatnonzero(kind == each)
        one = space.GetFE(ngs.ElementId(ngs.VOL, int(elements[0])))
        shapes = np.array([np.array(one.CalcShape(*node)) for node in lattice(order)])
        yield elements, shapes, dofs[elements]
