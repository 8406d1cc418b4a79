"""A curved triangulation in space as a chart on a flat copy of its triangles."""

from dataclasses import dataclass, field

import netgen.meshing
import ngsolve as ngs
import numpy as np

from ._kernel import lattice


@dataclass(frozen=True)
class Sheet:
    """A surface on the mesh of a solve: expressions of θ that hold there.

    Attributes
    ----------
    mesh : ngsolve.Mesh
        Planar.
    position : CoefficientFunction, (3,)
        φ.
    tangents : tuple of CoefficientFunction, (3,)
        ∂1φ and ∂2φ.
    normal : CoefficientFunction, (3,)
        Unit normal, on the side of the cloth.
    metric, curvature : CoefficientFunction, (2, 2)
        First and second fundamental form. On the rim of a surface from a file NGSolve knows them
        but from the triangles there, by ``BoundaryFromVolumeCF``.
    shape : CoefficientFunction, (2, 2)
        a⁻¹ b, whose eigenvalues are the principal curvatures.
    side : {1, -1}
        The normal is that of ``side * ∂1φ × ∂2φ``.
    nodes : dict
        What `sheet_through` made it of; empty for a chart.
    """

    mesh: ngs.Mesh
    position: ngs.CoefficientFunction
    tangents: tuple
    normal: ngs.CoefficientFunction
    metric: ngs.CoefficientFunction
    curvature: ngs.CoefficientFunction
    shape: ngs.CoefficientFunction
    side: int = 1
    nodes: dict = field(default_factory=dict)

    @property
    def mean_curvature(self):
        """Half the sum of the principal curvatures."""
        return ngs.Trace(self.shape) / 2

    @property
    def gauss_curvature(self):
        """The product of the principal curvatures."""
        return ngs.Det(self.shape)


def sheet_through(mesh, nodes):
    """The surface through nodes, a polynomial on each triangle of a straight-sided mesh.

    It is continuous, and smooth inside triangles alone; so the metric jumps from one to the next.

    Parameters
    ----------
    mesh : ngsolve.Mesh
        As of `planar_mesh`, counter-clockwise seen from the side of the cloth.
    nodes : dict
        By the order of φ, the nodes (m, (order + 1)(order + 2)/2, 3) of `lattice` in space, of two
        orders or of one. Position, tangents and metric are of the lower order, that of ψ; normal
        and principal curvatures are of the higher, and as precise.

    Returns
    -------
    Sheet
    """
    lower, higher = min(nodes), max(nodes)
    position, tangents, _ = _chart(mesh, lower, nodes[lower])
    _, finer, hessians = _chart(mesh, higher, nodes[higher])
    across = ngs.Cross(*finer)
    normal = across / ngs.Norm(across)
    x, y, z = (normal[i] * hessians[i] for i in range(3))
    metric, shape = _products(tangents), ngs.Inv(_products(finer)) * (x + y + z)
    curvature = metric * shape  # so that principal curvatures are those of the finer chart
    return Sheet(
        mesh=mesh,
        position=position,
        tangents=tuple(tangents),
        normal=normal,
        metric=metric,
        curvature=(curvature + curvature.trans) / 2,
        shape=shape,
        nodes=nodes,
    )


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


def swapped(nodes, turned, order):
    """The nodes of triangles, of which some have their first two corners swapped."""
    points = np.rint(order * lattice(order)).astype(int).tolist()
    number = {tuple(point): i for i, point in enumerate(points)}
    swap = [number[j, i] for i, j in points]
    return np.where(turned[:, None, None], nodes[:, swap], nodes)


def mesh_points(mesh, triangles, reference):
    """NGSolve's points of a mesh by numbers of triangles (n,) and reference coordinates (n, 2)."""
    corner = ngs.IntegrationRule([(0.0, 0.0)], [0.0])
    points = mesh.MapToAllElements({ngs.ET.TRIG: corner}, ngs.VOL)[np.asarray(triangles)]
    points["x"], points["y"] = np.asarray(reference, dtype=float).T
    return points


def _chart(mesh, order, nodes):
    """φ of one order through nodes; ∂1φ and ∂2φ; the second derivatives of each component."""
    chart = ngs.GridFunction(ngs.H1(mesh, order=order) ** 3, name="position")
    coefficients = chart.vec.FV().NumPy().reshape(3, -1)
    for elements, shapes, dofs in _elements(chart.components[0].space):
        values = np.linalg.solve(shapes, nodes[elements])
        coefficients[:, dofs] = values.transpose(2, 0, 1)
    gradients = [ngs.Grad(part) for part in chart.components]
    hessians = [part.Operator("hesse") for part in chart.components]
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
