"""What runs in a process of its own: the CAD kernel, the mesher, and readers of facets.

A file can bring down each of them, or send it into an endless loop, and with it the process that
it runs in. Called by `process.run` as a script, ``python _kernel.py TASK FOLDER``, with the
arguments in FOLDER/arguments.npz and the answer in FOLDER/answer.npz. Knows nothing of ngcloth, so
that it starts quickly.
"""

import re
import sys
from collections import Counter
from pathlib import Path

import numpy as np

# A name that is not set, as in files of Rhino: netgen wants a text there.
NO_NAME = re.compile(rb"(=\s*\w+\s*\(\s*|\bREPRESENTATION_ITEM\s*\(\s*)\$")

FINEST = 20  # largest over smallest element; small radii would ask for more than cloth feels


def read_cad(folder, name, measured):
    """Make FOLDER/whole.brep of a CAD file, and a table of its faces, `measured` if asked."""
    from netgen.occ import OCCGeometry

    path = folder / str(name)
    if path.suffix == ".step":
        path.write_bytes(named(path.read_bytes()))
    shape = OCCGeometry(str(path)).shape
    shape.WriteBrep(str(folder / "whole.brep"))
    faces = list(shape.faces)
    # Slow, seconds for a face of many knots.
    properties = [face.Properties() if measured else (np.nan, [np.nan] * 3) for face in faces]
    return {
        "names": np.array([face.name or "" for face in faces], dtype=str),
        "areas": np.array([area for area, _ in properties]),
        "centres": np.array([tuple(centre) for _, centre in properties]).reshape(-1, 3),
        "boxes": np.array([[tuple(end) for end in face.bounding_box] for face in faces]),
        "edge_names": np.array([edge.name or "" for edge in shape.edges], dtype=str),
    }


def named(step):
    """The bytes of a STEP file in which no first attribute, the name, is left out."""
    return NO_NAME.sub(rb"\1''", step)


def join_faces(folder, faces, edge_names, tolerance):
    """Make FOLDER/part.brep of some faces of FOLDER/whole.brep, joined along common edges.

    Tells whether no edge is a rim; poles hide that, but not from who looks at a mesh.
    """
    from netgen.occ import OCCGeometry, Sew

    shape = OCCGeometry(str(folder / "whole.brep")).shape
    _name_edges(shape, edge_names)
    known = list(shape.faces)
    chosen = [known[i] for i in faces]
    part = chosen[0]
    if len(chosen) > 1:
        part = Sew(chosen, tolerance=float(tolerance), non_manifold=True)
    part.WriteBrep(str(folder / "part.brep"))
    sides = Counter(edge for face in part.faces for edge in face.edges)  # seams have two
    return {
        "edge_names": np.array([edge.name or "" for edge in part.edges], dtype=str),
        "closed": min(sides.values()) > 1,
    }


def _name_edges(shape, names):
    """Give back the names that .brep files do not keep; they do keep the order of edges."""
    for edge, name in zip(shape.edges, names, strict=True):
        if name:
            edge.name = str(name)


def mesh_part(folder, edge_names, maxh, levels, orders):
    """Triangulate FOLDER/part.brep, refine, and take nodes of each order on each level.

    Nodes are those of `lattice`.
    """
    import ngsolve as ngs
    from netgen.meshing import MeshingStep
    from netgen.occ import OCCGeometry

    shape = OCCGeometry(str(folder / "part.brep")).shape
    _name_edges(shape, edge_names)
    netgen_mesh = OCCGeometry(shape).GenerateMesh(
        maxh=float(maxh), minh=float(maxh) / FINEST, perfstepsend=MeshingStep.MESHSURFACE
    )
    answer = {}
    for level in range(int(levels)):
        if level:
            netgen_mesh.Refine()
        answer |= _elements(ngs.Mesh(netgen_mesh), level)
        for order in orders:
            netgen_mesh.Curve(int(order))
            points = lattice(int(order))
            rule = ngs.IntegrationRule(points.tolist(), [0.0] * len(points))
            mapped = ngs.Mesh(netgen_mesh).MapToAllElements({ngs.ET.TRIG: rule}, ngs.BND)
            nodes = ngs.CF((ngs.x, ngs.y, ngs.z))(mapped)
            answer[f"nodes{order}_{level}"] = nodes.reshape(-1, len(points), 3)
    return answer


def _elements(mesh, level):
    triangles = mesh.ngmesh.Elements2D().NumPy()["nodes"][:, :3]
    segments = mesh.ngmesh.Elements1D().NumPy()
    names = np.array(mesh.GetBBoundaries(), dtype=str)
    parents = [mesh.GetParentVertices(vertex) for vertex in range(mesh.nv)]
    return {
        f"vertices_{level}": np.array(mesh.ngmesh.Coordinates()),
        f"triangles_{level}": triangles.astype(int) - 1,
        f"segments_{level}": segments["nodes"][:, :2].astype(int) - 1,
        f"segment_names_{level}": names[segments["index"] - 1],
        f"parents_{level}": np.array(parents, dtype=int),
    }


def read_facets(folder, name):
    """Points and triangles of a file of facets."""
    import pyvista

    path = folder / str(name)
    mesh = _read_obj(path) if path.suffix == ".obj" else pyvista.read(str(path))
    if isinstance(mesh, pyvista.MultiBlock):
        mesh = mesh.combine()
    if not isinstance(mesh, pyvista.PolyData):
        mesh = mesh.extract_surface(algorithm=None)
    mesh = mesh.triangulate()
    points = np.array(mesh.points, dtype=float).reshape(-1, 3)
    return {"points": points, "triangles": np.array(mesh.regular_faces, dtype=int).reshape(-1, 3)}


def _read_obj(path):
    """Faces of an OBJ file by its own vertices, which VTK doubles where it has textures."""
    import pyvista

    points, faces = [], []
    for line in path.read_text(errors="replace").replace("\\\n", " ").splitlines():
        word, *rest = line.split() or [""]
        if word == "v":
            points.append([float(number) for number in rest[:3]])
        elif word == "f":
            corners = [int(corner.split("/")[0]) for corner in rest]
            faces += [len(rest), *(n - 1 if n > 0 else n + len(points) for n in corners)]
    return pyvista.PolyData(np.array(points).reshape(-1, 3), np.array(faces, dtype=int))


def lattice(order):
    """The nodes (n, 2) of a triangle of an order, in the coordinates of NGSolve's triangle.

    Its corners are (1, 0), (0, 1) and (0, 0).
    """
    steps = range(order + 1)
    return np.array([(i / order, j / order) for i in steps for j in range(order + 1 - i)])


TASKS = {task.__name__: task for task in (read_cad, join_faces, mesh_part, read_facets)}

if __name__ == "__main__":
    task, folder = TASKS[sys.argv[1]], Path(sys.argv[2])
    with np.load(folder / "arguments.npz") as arguments:
        answer = task(folder, **arguments)
    np.savez(folder / "answer.npz", **answer)
