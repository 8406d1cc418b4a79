"""Meshes as the bytes of files, so that a full disk is told where they are written."""

import io

import numpy as np


def xml(mesh):
    """What VTK's writer makes of a mesh. Left to write files, it is silent about a full disk."""
    from vtkmodules.vtkIOXML import vtkXMLPolyDataWriter, vtkXMLUnstructuredGridWriter

    polygonal = mesh.IsA("vtkPolyData")
    writer = vtkXMLPolyDataWriter() if polygonal else vtkXMLUnstructuredGridWriter()
    writer.SetInputData(mesh)
    writer.WriteToOutputStringOn()
    writer.Write()
    return writer.GetOutputString().encode()


def stl(points, triangles, _):
    """Triangles as binary STL."""
    corners = points[triangles]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    record = [("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")]
    facets = np.zeros(len(corners), record)
    facets["normal"] = normals / np.linalg.norm(normals, axis=1, keepdims=True)
    facets["corners"] = corners
    return b"ngcloth".ljust(80) + np.uint32(len(facets)).tobytes() + facets.tobytes()


def obj(points, triangles, uv):
    """Triangles as OBJ, with texture coordinates."""
    text = io.StringIO()
    np.savetxt(text, points, "v %.9g %.9g %.9g")
    np.savetxt(text, uv, "vt %.9g %.9g")
    np.savetxt(text, np.repeat(triangles + 1, 2, axis=1), "f %d/%d %d/%d %d/%d")
    return text.getvalue().encode()
