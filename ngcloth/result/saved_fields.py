"""Arrays of a saved result become the surface on its mesh, and the state: checked on the way."""

import netgen.meshing
import ngsolve as ngs
import numpy as np
from netgen.occ import OCCGeometry

from ..geometry.file_surface import FileSurface, curvature_order
from ..geometry.mirrors import MIRRORS
from ..geometry.sheet import planar_mesh, sheet_through
from ..problem.constraints import LimitPoints
from .save import LIMIT, at_nodes

ROUNDING = 1e-9  # more than two machines may differ in
MOST_POINTS = 2 * 10**7  # of the integration rule on all triangles


def limit_points(fields):
    """`Result.limit_points`, taken out of the fields; none in files written before there were."""
    none = LimitPoints()._asdict()
    return LimitPoints(*(fields.pop(f"{LIMIT}{name}", each) for name, each in none.items()))


def check_fields(fields, settings, scene):
    """Refuse arrays that Netgen would take without a look, and fail on."""
    order, quadrature = settings["order"], settings["quadrature"]
    names = {"state", "theta", "psi", "vertices", "triangles", "segments"}
    file = isinstance(scene.surface, FileSurface)
    orders = (order, curvature_order(order)) if file else ()
    names |= {f"nodes{each}" for each in orders}
    if fields.keys() != names | ({"eta"} if scene.in_equilibrium else set()):
        raise ValueError(f"it has other arrays than {', '.join(sorted(names))}")
    vertices, triangles, segments = (fields[n] for n in ("vertices", "triangles", "segments"))
    nodes = (len(triangles), (order + 1) * (order + 2) // 2, 2)
    shapes = {name: nodes for name in ("theta", "psi", "eta")} | {"state": (fields["state"].size,)}
    shapes |= {"vertices": (len(vertices), 2), "triangles": (len(triangles), 3)}
    shapes |= {"segments": (len(segments), 3)}
    shapes |= {f"nodes{o}": (len(triangles), (o + 1) * (o + 2) // 2, 3) for o in orders}
    for name, array in fields.items():
        kind = "i" if name in ("triangles", "segments") else "f"
        if array.shape != shapes[name] or array.dtype.kind != kind or not np.isfinite(array).all():
            raise ValueError(f"{name} is not an array {shapes[name]} of finite numbers")
    for name, ends in {"triangles": triangles, "segments": segments[:, :2]}.items():
        if not np.all((ends >= 0) & (ends < len(vertices))):
            raise ValueError(f"{name} has other entries than vertices")
    if len(triangles) * (quadrature // 2 + 1) ** 2 > MOST_POINTS:
        raise ValueError(f"its quadrature on these triangles has more than {MOST_POINTS} points")
    if not file and not scene.surface.domain.contains(vertices).all():
        raise ValueError("vertices lie outside the domain")
    _check_triangulation(vertices, triangles, segments)


def _check_triangulation(vertices, triangles, segments):
    """Refuse triangles that are turned over, or bounded by other edges than the segments."""
    if set(triangles.ravel().tolist()) != set(range(len(vertices))):
        raise ValueError("vertices belong to no triangle")
    first, second, third = vertices[triangles].transpose(1, 2, 0)
    (a, b), (c, d) = second - first, third - first
    if not np.all(a * d - b * c > 0):
        raise ValueError("triangles are turned over or flat")
    edges = triangles[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2).astype(np.int64)
    there, back = edges @ [len(vertices), 1], edges @ [1, len(vertices)]
    once = edges[~np.isin(there, back)]
    rim = np.unique(np.sort(segments[:, :2], axis=1), axis=0)
    of_one = np.array_equal(np.unique(np.sort(once, axis=1), axis=0), rim)
    if len(np.unique(there)) < len(there) or len(rim) < len(segments) or not of_one:
        raise ValueError("segments are not the edges of one triangle")


def saved_sheet(scene, fields, order):
    """The surface on the mesh of the solve."""
    if not isinstance(scene.surface, FileSurface):
        return scene.surface.on(_mesh(scene, fields, order))
    vertices, triangles, segments = (fields[n] for n in ("vertices", "triangles", "segments"))
    ends, names = segments[:, :2], np.full(len(segments), "rim")
    if scene.symmetric:  # on the axes, and nowhere else
        on = (vertices[ends] == 0).all(axis=1)
        for axis, mirror in enumerate(MIRRORS):
            names[on[:, axis]] = mirror
    mesh = planar_mesh(vertices, triangles, ends, names)
    nodes = {each: fields[f"nodes{each}"] for each in (order, curvature_order(order))}
    return sheet_through(mesh, nodes)


def _mesh(scene, fields, order):
    """The mesh of the solve: vertices, triangles and rim from the file, curves from the domain."""
    face = scene.surface.domain.face(scene.symmetric)
    mesh = netgen.meshing.Mesh(dim=2)
    mesh.SetGeometry(OCCGeometry(face, dim=2))
    mesh.AddPoints(np.array(fields["vertices"], dtype=float))
    region = mesh.AddRegion("default", dim=2)
    mesh.AddElements(dim=2, index=region, data=fields["triangles"].astype(np.int32))
    if not np.all((fields["segments"][:, 2] >= 1) & (fields["segments"][:, 2] <= len(face.edges))):
        raise ValueError("segments lie on other edges than the domain has")
    segments = fields["segments"].astype(np.int32)
    for number, edge in enumerate(face.edges, start=1):
        region = mesh.AddRegion(edge.name, dim=1)
        place = mesh.EdgeDescriptor(region)
        place.edgenr, place.domin, place.domout, place.fdindex = number, 1, 0, 1
        ends = np.ascontiguousarray(segments[segments[:, 2] == number, :2])
        mesh.AddElements(dim=1, index=region, data=ends)
    mesh = ngs.Mesh(mesh)
    mesh.Curve(order)
    return mesh


def saved_state(scene, mesh, settings, fields):
    """The GridFunction of ψ, and of v if there are limits, on the space that the solve used."""
    order = settings["order"]
    mirrors = ("mirror1", "mirror2") if scene.symmetric else ("", "")
    components = [ngs.H1(mesh, order=order, dirichlet=line) for line in mirrors]
    if scene.in_equilibrium:
        fixed = [f"rim|{line}" if line else "rim" for line in mirrors]
        components += [
            ngs.H1(mesh, order=settings["multiplier_order"], dirichlet=lines) for lines in fixed
        ]
    state = ngs.GridFunction(ngs.FESpace(components), name="state")
    coefficients = state.vec.FV().NumPy()
    if coefficients.shape != fields["state"].shape:
        raise ValueError("its state does not belong to the mesh and the order")
    coefficients[:] = fields["state"]
    # Coefficients mean something only in the numbering and the basis that they were written in.
    found = {"theta": ngs.CF((ngs.x, ngs.y)), "psi": ngs.CF(tuple(state.components[:2]))}
    if scene.in_equilibrium:
        found["eta"] = ngs.CF(tuple(state.components[2:]))
    for name, field in found.items():
        if not same(at_nodes(field, mesh, order), fields[name]):
            raise ValueError(f"{name} at the nodes is not what mesh and state give")
    return state


def same(values, expected):
    """Whether arrays (..., n) agree to more digits than two machines may differ in."""
    known = values is not None and expected is not None
    if not (known and values.shape == expected.shape and expected.dtype.kind == "f"):
        return False
    size = np.where(np.isfinite(expected), np.abs(expected), 0).reshape(-1, expected.shape[-1])
    columns = size.max(axis=0)
    near = np.abs(values - expected) <= ROUNDING * columns + 1e-12 * columns.max()
    return bool(np.all(near | np.isclose(values, expected, rtol=0, atol=0, equal_nan=True)))
