"""The cloth as triangular shells of a structural solver, each with its material axes."""

from dataclasses import dataclass

import ngsolve as ngs
import numpy as np

# Corners of the reference triangle, and the middles of its sides 12, 23, 31.
POINTS = [(0, 0), (1, 0), (0, 1), (0.5, 0), (0.5, 0.5), (0, 0.5)]
CENTROID = (1 / 3, 1 / 3)
ENDS = [(0, 0), (1, 1), (2, 2), (0, 1), (1, 2), (2, 0)]  # the corners that each lies between
VERTEX = [2, 0, 1]  # of NGSolve at each corner


@dataclass(frozen=True)
class Shells:
    """Triangles on the surface that share their nodes, numbered from 0.

    Attributes
    ----------
    nodes : ndarray, (n, 3)
        On the surface, in its unit of length.
    triangles : ndarray of int, (m, 3) or (m, 6)
        Corners, counter-clockwise seen from the side of the cloth, and middles of the sides 12, 23,
        31.
    axes : ndarray, (m, 3, 3)
        Rows: the warp at the centroid, projected on the triangle; across it in the triangle; and
        the normal of the triangle.
    warp_angles : ndarray, (m,)
        From side 12 to the warp in degrees, counter-clockwise; of triangles with straight sides.
    thickness : ndarray, (m,)
        At the centroids.
    nodal_thickness : ndarray, (n,)
    """

    nodes: np.ndarray
    triangles: np.ndarray
    axes: np.ndarray
    warp_angles: np.ndarray
    thickness: np.ndarray
    nodal_thickness: np.ndarray


def shells(result, order, thickness):
    """The elements of a result, mirror images included, as shells.

    Parameters
    ----------
    result : Result
        Its elements are those of its mesh.
    order : {1, 2}
        Of the triangles.
    thickness : float
        Of the flat cloth; on the surface it is 1/(areal stretch) of that.

    Returns
    -------
    Shells
        In the order of the elements of `ngcloth.fields.fibres`.
    """
    from .fields import element_fields

    count = 3 * order
    fields = element_fields(result, [*POINTS[:count], CENTROID])
    centre = {name: values[:, -1] for name, values in fields.items()}
    at_nodes = {name: values[:, :-1] for name, values in fields.items()}
    triangles, first = _joined(result, at_nodes["theta"])
    nodes = at_nodes["position"].reshape(-1, 3)[first]
    ratios = np.bincount(triangles.ravel(), at_nodes["thickness"].ravel())

    # A triangle that a mirror turned over is numbered the other way.
    sides = at_nodes["theta"][:, 1:3] - at_nodes["theta"][:, :1]
    turned = np.linalg.det(sides) * result.sheet.side < 0
    back = [0, 2, 1, 5, 4, 3][:count]
    triangles = np.where(turned[:, None], triangles[:, back], triangles)
    along, normal = _tangent(nodes[triangles])
    warp = centre["warp"] - np.einsum("ni,ni->n", centre["warp"], normal)[:, None] * normal
    warp = _unit(warp)
    across = np.cross(normal, warp)
    return Shells(
        nodes=nodes,
        triangles=triangles,
        axes=np.stack([warp, across, normal], axis=1),
        warp_angles=_angle(along, warp, normal),
        thickness=thickness * centre["thickness"],
        nodal_thickness=thickness * ratios / np.bincount(triangles.ravel()),
    )


def _joined(result, theta):
    """Nodes that elements share as one: their numbers (m, count), and where each comes first.

    A node is known by the ends of its side, and by which mirror images of it are the same.
    """
    mesh, domain, copies = result.state.space.mesh, result.domain, result.scene.copies
    vertices = np.array([[v.nr for v in element.vertices] for element in mesh.Elements(ngs.VOL)])
    ends = np.sort(vertices[:, VERTEX][:, ENDS[: theta.shape[1]]], axis=-1)
    away = theta - domain.centre
    on_mirror = np.abs(away) < 1e-9 * domain.diameter
    image = np.where(on_mirror, 0, np.sign(away)) if copies > 1 else np.zeros_like(theta)
    keys = np.concatenate([np.tile(ends, (copies, 1, 1)), image], axis=-1).reshape(-1, 4)
    _, first, number = np.unique(keys, axis=0, return_index=True, return_inverse=True)
    return number.reshape(theta.shape[:2]), first


def _tangent(corners):
    """Unit vectors at the centroids of triangles, (m, 3) each: along ξ, from 1 to 2, and normal."""
    first, second, third = corners[:, 0], corners[:, 1], corners[:, 2]
    along, towards = second - first, third - first
    if corners.shape[1] == 6:
        m12, m23, m31 = corners[:, 3], corners[:, 4], corners[:, 5]
        along = along / 3 + 4 / 3 * (m23 - m31)
        towards = towards / 3 + 4 / 3 * (m23 - m12)
    return _unit(along), _unit(np.cross(along, towards))


def _angle(first, second, normal):
    """From first to second about the normal, in degrees."""
    sine = np.einsum("ni,ni->n", normal, np.cross(first, second))
    return np.degrees(np.arctan2(sine, np.einsum("ni,ni->n", first, second)))


def _unit(vectors):
    return vectors / np.linalg.norm(vectors, axis=1, keepdims=True)
