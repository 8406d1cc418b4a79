"""A quarter of a part between two mirror planes, and its images beyond them."""

from dataclasses import dataclass

import ngsolve as ngs
import numpy as np

from .sheet import planar_mesh, sheet_through, swapped

MIRRORS = ("mirror1", "mirror2")  # names of edges on mirror lines
SIGNS = np.array([(1.0, 1.0), (-1.0, 1.0), (-1.0, -1.0), (1.0, -1.0)])  # of θ, by image
POINTS = 6  # of a rule on each edge of a mirror line
STRAIGHT = 1e-3  # of its length: a line that bends less does not tell its plane alone
FLAT = 1e-4  # of the size: what a mirror line may leave its plane by
SQUARE = 2.5  # degrees off a right angle; the images then meet at less than a sharp edge


class MirrorError(Exception):
    """Edges that are no mirror lines of a quarter."""


@dataclass(frozen=True)
class Mirrors:
    """Two planes in space, normal to each other.

    Attributes
    ----------
    corner : ndarray, (3,)
        Where both meet the surface.
    normals : ndarray, (2, 3)
        Unit vectors. Across plane i, component i of θ changes its sign.
    """

    corner: np.ndarray
    normals: np.ndarray

    def images(self, points):
        """Four images (4, ..., 3) of points (..., 3), in the order of `SIGNS`."""
        reflections = [np.eye(3) - (1 - signs) * self.normals.T @ self.normals for signs in SIGNS]
        return self.corner + np.stack([(points - self.corner) @ each for each in reflections])


def mirror_lines(segments, names):
    """Vertices of the two mirror lines, which have one in common.

    Parameters
    ----------
    segments : ndarray of int, (n, 2)
        Of the rims.
    names : ndarray of str, (n,)
        Those of the edges that they lie on.

    Returns
    -------
    list of ndarray

    Raises
    ------
    MirrorError
    """
    lines = [np.unique(segments[names == mirror]) for mirror in MIRRORS]
    if not all(map(len, lines)):
        raise MirrorError("no edges of its rim are named 'mirror1' and 'mirror2'")
    meetings = len(np.intersect1d(*lines))
    if meetings != 1:
        raise MirrorError(f"edges 'mirror1' and 'mirror2' have {meetings} ends in common, not one")
    return lines


def mirrors_of(sheet, size):
    """The mirror planes of a quarter.

    Parameters
    ----------
    sheet : Sheet
        Its mirror lines lie on θ1 = 0 and θ2 = 0.
    size : float
        Of the part.

    Returns
    -------
    Mirrors

    Raises
    ------
    MirrorError
        If a line does not lie in a plane, the surface does not cross it at a right angle, or the
        planes do not cross each other so: what lies beyond would be another part.
    """
    mesh, rule = sheet.mesh, ngs.IntegrationRule(ngs.SEGM, POINTS)
    corner = np.array(sheet.position(mesh(0.0, 0.0)))
    normals = []
    for name in MIRRORS:
        points = mesh.MapToAllElements({ngs.ET.SEGM: rule}, mesh.Boundaries(name))
        away = np.asarray(sheet.position(points)) - corner
        across = np.asarray(ngs.BoundaryFromVolumeCF(sheet.normal)(points))
        _, extent, axes = np.linalg.svd(away, full_matrices=False)
        normal = axes[2]
        if extent[1] < STRAIGHT * extent[0]:
            normal = np.cross(axes[0], across.mean(axis=0))
            normal /= np.linalg.norm(normal)
        off = np.abs(away @ normal).max()
        if off > FLAT * size:
            raise MirrorError(f"its edge {name!r} leaves a plane by {off:.2g}")
        _check_square(np.abs(across @ normal).max(), f"the surface and the plane of its {name!r}")
        normals.append(normal)
    _check_square(abs(normals[0] @ normals[1]), "the planes of 'mirror1' and 'mirror2'")
    return Mirrors(corner, np.array(normals))


def _check_square(sine, which):
    off = np.degrees(np.arcsin(min(sine, 1.0)))
    if off > SQUARE:
        raise MirrorError(f"{which} meet {off:.2g}° off a right angle")


def with_images(sheet, mirrors):
    """The whole surface, four images of a quarter that share the vertices on mirror lines.

    Its triangles are those of the quarter, image after image in the order of `SIGNS`; where θ is
    turned over, so are they, the first two corners swapped.

    Parameters
    ----------
    sheet : Sheet
        The quarter, on a mesh in which its mirror lines lie on θ1 = 0 and θ2 = 0.
    mirrors : Mirrors
        Its planes.

    Returns
    -------
    Sheet
    """
    mesh = sheet.mesh.ngmesh
    flat, triangles = mesh.Coordinates(), mesh.Elements2D().NumPy()["nodes"][:, :3] - 1
    ends = mesh.Elements1D().NumPy()
    rim = np.array(sheet.mesh.GetBoundaries())[ends["index"] - 1] == "rim"
    segments = ends["nodes"][rim, :2] - 1
    signs = SIGNS[:, None]
    keys = np.where(flat == 0, 0, signs)
    vertices = np.broadcast_to(np.arange(len(flat))[:, None], (4, len(flat), 1))
    keys = np.concatenate([vertices, keys], axis=-1).reshape(-1, 3)
    _, once, number = np.unique(keys, axis=0, return_index=True, return_inverse=True)
    number = number.reshape(4, -1)
    back = SIGNS.prod(axis=1) < 0
    triangles, segments = number[:, triangles], number[:, segments]
    triangles[back], segments[back] = triangles[back][..., [1, 0, 2]], segments[back][..., ::-1]
    segments = segments.reshape(-1, 2)
    names, turned = np.full(len(segments), "rim"), np.repeat(back, len(mesh.Elements2D()))
    nodes = {
        order: swapped(mirrors.images(each).reshape(-1, *each.shape[1:]), turned, order)
        for order, each in sheet.nodes.items()
    }
    flat = (signs * flat).reshape(-1, 2)[once]
    return sheet_through(planar_mesh(flat, triangles.reshape(-1, 3), segments, names), nodes)
