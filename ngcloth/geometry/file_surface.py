"""Surfaces without a formula: what those of CAD files and of facets have in common."""

import numbers
import warnings
from abc import ABC, abstractmethod
from dataclasses import dataclass
from functools import cached_property

import ngsolve as ngs
import numpy as np

from ..errors import InputError, check_integer, check_number
from ._kernel import lattice
from .mirrors import MirrorError, mirror_lines, mirrors_of
from .sheet import planar_mesh, sheet_through, swapped

UNITS = {"mm": 1.0, "cm": 10.0, "m": 1000.0, "inch": 25.4}  # in mm
MESHES = (".stl", ".obj", ".ply", ".vtp", ".vtu")  # endings of files of facets
SHARP = 5.0  # degrees
SMALLEST = 1e-2  # mm; kernels take points within 1e-7 mm for one
TUBE = 0.75 * np.pi  # least turning around a hole, of 2π in a plane; on a tube it is 0
SURVEY = 12  # elements across, of the mesh that is looked at before anything is solved
CROWDED = 5  # triangles of a size h in an area h², where they are not smaller than that


@dataclass(frozen=True)
class Level:
    """One triangulation of a surface in space, of a chain of refinements.

    Attributes
    ----------
    vertices : ndarray, (n, 3)
    triangles : ndarray of int, (m, 3)
    parents : ndarray of int, (n, 2)
        The vertices of the level before between which each vertex lies; those that were there
        before come first.
    names : dict
        Names of edges, other than "rim", by their vertices in ascending order.
    nodes : dict
        By order, the nodes (m, nodes of a triangle, 3) of `lattice`, on the surface.
    """

    vertices: np.ndarray
    triangles: np.ndarray
    parents: np.ndarray
    names: dict
    nodes: dict


class FileSurface(ABC):
    """A surface of disk shape, with or without holes, that a file describes.

    Parameters
    ----------
    unit : {"mm", "cm", "m", "inch"}
        What one unit of length is in all that is computed and exported.
    side : {1, -1}
        The cloth lies on the side to which the larger part of the faces looks, or on the other.

    Attributes
    ----------
    box : ndarray, (2, 3)
        Its corners, in this unit.
    area : float
    topology : Topology
    sharp : float
        Length of the edges inside at which the surface turns by more than 5°.
    least_radius : float
        Of curvature, over the nodes of a mesh of a twelfth of the size.
    survey : Sheet
        The surface on that mesh.
    rough : bool
        Whether there is too much noise for curvature, and for the reaction of the surface.

    Raises
    ------
    InputError
        If it is no disk with holes.
    """

    def __init__(self, unit, side):
        if not isinstance(unit, str) or unit not in UNITS:
            raise InputError("unit", unit, "one of " + ", ".join(map(repr, UNITS)))
        if isinstance(side, bool) or not isinstance(side, numbers.Integral) or abs(side) != 1:
            raise InputError("side", side, "1 or -1, the side to which the faces look or the other")
        self.unit, self.side = unit, int(side)

    @abstractmethod
    def levels(self, maxh, orders, count):
        """Triangulations of the surface, each a refinement of the one before, by halving edges.

        Parameters
        ----------
        maxh : float
            Largest element size on the first, in the unit of the surface.
        orders : tuple of int
            Of the nodes.
        count : int
            How many.

        Returns
        -------
        list of Level
        """

    @abstractmethod
    def arrays(self):
        """What `of_arrays` makes the same surface of, a dict of ndarray without objects."""

    @classmethod
    @abstractmethod
    def of_arrays(cls, arrays):
        """The surface that had these `arrays`; `InputError` if they are none."""

    def __reduce__(self):
        return type(self).of_arrays, (self.arrays(),)

    def sheets(self, maxh, order, coarser=0, symmetric=False):
        """Charts on planar meshes for a solve, the coarsest first.

        Parameters
        ----------
        maxh : float
            Largest element size on the last of them, in space, in the unit of the surface.
        order : int
            Of ψ, hence of the φ that the metric is of.
        coarser : int, optional
            How many meshes come before it at most, each of twice the element size of the next,
            which is a refinement of it: more than one only where the curvature of the part lets
            triangles be that large. Default 0.
        symmetric : bool, optional
            Whether edges of a CAD file that are named "mirror1" and "mirror2" keep these names, as
            mirror lines; they lie on θ1 = 0 and θ2 = 0. By default all edges are "rim".

        Returns
        -------
        list of Sheet
        """
        maxh = check_number("maxh", maxh, 0, open_low=True)
        order, coarser = check_integer("order", order, 1), check_integer("coarser", coarser, 0)
        orders = (order, curvature_order(order))
        while coarser > 1 and not self._is_meshed(maxh * 2**coarser):
            coarser -= 1
        levels = self.levels(maxh * 2**coarser, orders, coarser + 1)
        return _sheets(levels, self.side, symmetric)

    def _is_meshed(self, maxh):
        """Whether triangles are of this size, and not smaller for the curvature of the part."""
        (level,) = self.levels(maxh, (1, 1), 1)
        return len(level.triangles) * maxh**2 <= CROWDED * self.area

    @cached_property
    def quarter(self):
        """`survey` between mirror lines, as scenes with mirrors have it, and its `Mirrors`.

        Raises
        ------
        InputError
            If edges named "mirror1" and "mirror2" do not bound a quarter of a part.
        """
        from .flatten import FlatteningError

        try:
            (sheet,) = _sheets([self._surveyed], self.side, symmetric=True)
            return sheet, mirrors_of(sheet, self.size)
        except (MirrorError, FlatteningError) as error:
            allowed = (
                "False, to solve the whole part; or a quarter, cut off in CAD along its two mirror "
                "planes, its edges there named 'mirror1' and 'mirror2', the latter along the warp. "
                f"Here, {error}"
            )
            raise InputError("symmetric", True, allowed) from None

    def _survey(self, argument, value):
        """Look at it on a coarse mesh, and refuse what is no disk."""
        # SciPy is not imported with ngcloth: it takes time, and sets filters of warnings.
        from .flatten import FlatteningError
        from .topology import topology

        try:
            (level,) = self.levels(self.size / SURVEY, (4,), 1)
        except InputError as error:
            if error.argument == argument:
                raise
            allowed = f"a surface that can be meshed: {error.argument} = {error.value!r}, "
            raise InputError(argument, value, allowed + error.allowed) from error
        self._surveyed = level
        self.topology, turned = topology(level.triangles)
        fault = self.topology.fault or tube(level.vertices, level.triangles, self.topology.rims)
        if fault:
            found = f"{fault} (found: {self.topology})"
            raise InputError(argument, value, f"a disk, with or without holes; this is {found}")
        self.sharp = _sharp(level, turned)
        try:
            (sheet,) = _sheets([level], self.side)
            self.survey = sheet
        except FlatteningError as error:
            raise InputError(argument, value, f"a surface that can be laid flat; {error}") from None
        mean, gauss = sheet.mean_curvature, sheet.gauss_curvature
        largest = ngs.sqrt(ngs.IfPos(mean**2 - gauss, mean**2 - gauss, 0)) + ngs.Norm(mean)
        points = sheet.mesh.MapToAllElements(ngs.IntegrationRule(ngs.TRIG, 4), ngs.VOL)
        self.least_radius = 1 / max(float(largest.Compile()(points).max()), 1e-300)
        self.area = ngs.Integrate(
            ngs.sqrt(ngs.Det(sheet.metric)) * ngs.dx(bonus_intorder=4), sheet.mesh
        )

    rough = False

    def warn_of_edges(self, name, stacklevel):
        """Warn of sharp edges, if there are any."""
        if self.sharp:
            text = f"{name} has edges sharper than {SHARP:g}°, {self.sharp:.3g} {self.unit} of them"
            warnings.warn(f"{text}: the reaction there is not known", stacklevel=stacklevel + 1)

    @property
    def diameter(self):
        """Of a disk of the same area."""
        return float(np.sqrt(4 / np.pi * self.area))

    @property
    def size(self):
        """Length of the diagonal of the bounding box over √3."""
        return float(np.linalg.norm(np.ptp(self.box, axis=0)) / np.sqrt(3))

    def __str__(self):
        # The box of a CAD kernel is one around control points, and wider.
        places = self._surveyed.nodes[4].reshape(-1, 3)
        lengths = " × ".join(f"{length:.4g}" for length in np.ptp(places, axis=0))
        holes = len(self.topology.rims) - 1
        flat = self.least_radius > 1e6 * self.size
        lines = [
            f"  size    {lengths} {self.unit}, area {self.area:.6g} {self.unit}²",
            f"  rims    1 outside, {holes} around holes",
            f"  edges   {self.sharp:.4g} {self.unit} sharper than {SHARP:g}°",
            "  radius  " + ("flat" if flat else f"{self.least_radius:.3g} {self.unit} at least"),
        ]
        return "\n".join(lines)


def curvature_order(order):
    """The order of the φ that curvature is taken from, for one whose metric is of `order`.

    Two higher at least, for second derivatives; and even, because curved elements of odd order have
    poor curvature in Netgen.
    """
    order = max(order + 2, 4)
    return order + order % 2


def _sheets(levels, side, symmetric=False):
    """Charts on planar meshes, each a refinement of the one before; the coarsest is flattened."""
    from .flatten import between_mirrors, flatten
    from .topology import topology

    charts, flat = [], None
    for level in levels:
        found, turned = topology(level.triangles)
        if side == -1:
            turned = ~turned
        triangles = np.where(turned[:, None], level.triangles[:, [1, 0, 2]], level.triangles)
        rims = [rim[::side] for rim in found.rims]
        if charts:
            new = level.parents[len(flat) :]
            flat = np.concatenate([flat, flat[new].mean(axis=1)])
        else:
            flat = flatten(level.vertices, triangles, rims)
        segments = np.concatenate([np.stack([rim, np.roll(rim, -1)], axis=-1) for rim in rims])
        keys = map(tuple, np.sort(segments, axis=1).tolist())
        known = level.names if symmetric else {}
        names = np.array([known.get(key, "rim") for key in keys])
        if symmetric and not charts:
            flat = between_mirrors(flat, triangles, rims, *mirror_lines(segments, names))
        nodes = {order: swapped(nodes, turned, order) for order, nodes in level.nodes.items()}
        charts.append(sheet_through(planar_mesh(flat, triangles, segments, names), nodes))
    return charts


def tube(points, triangles, rims):
    """What is wrong with a surface of two rims of which neither goes around a hole; or None.

    The geodesic curvature of the rim of a hole adds up to −2π in a plane, and to 0 on a tube.
    """
    from .flatten import corner_angles

    angles = corner_angles(points, triangles)
    sums = np.bincount(triangles.ravel(), angles.ravel(), len(points))
    turning = sorted(float(np.sum(np.pi - sums[rim])) for rim in rims)
    if len(rims) > 1 and turning[-2] > -TUBE:
        return "a tube; cut it open from rim to rim"
    return None


def check_size(box, unit, argument, value):
    """Refuse what is too small to be a part that cloth covers."""
    size = float(np.linalg.norm(np.ptp(box, axis=0)))
    if size * UNITS[unit] < SMALLEST:
        allowed = f"at least {SMALLEST:g} mm large; it is {size:.2g} {unit}: is that its unit?"
        raise InputError(argument, value, allowed)


def _sharp(level, turned):
    """Length of the edges between triangles whose normals differ by more than SHARP."""
    order, triangles = max(level.nodes), level.triangles
    exponents = np.rint(order * lattice(order)).astype(int)
    i, j = exponents.T
    values = lattice(order)[:, :1] ** i * lattice(order)[:, 1:] ** j
    x, y = np.array([[0.5, 0.5], [0, 0.5], [0.5, 0]]).T[:, :, None]  # middles of the edges
    along_x = i * x ** np.maximum(i - 1, 0) * y**j
    along_y = j * x**i * y ** np.maximum(j - 1, 0)
    tangents = [slope @ np.linalg.solve(values, level.nodes[order]) for slope in (along_x, along_y)]
    normals = np.cross(*tangents) * np.where(turned, -1, 1)[:, None, None]
    normals = (normals / np.linalg.norm(normals, axis=-1, keepdims=True)).reshape(-1, 3)
    ends = np.sort(triangles[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2), axis=1)
    order = np.lexsort(ends.T)
    same = np.flatnonzero(np.all(ends[order[1:]] == ends[order[:-1]], axis=1))
    one, two = order[same], order[same + 1]
    sharp = np.sum(normals[one] * normals[two], axis=1) < np.cos(np.radians(SHARP))
    begin, end = level.vertices[ends[one[sharp]].T]
    return float(np.linalg.norm(end - begin, axis=1).sum())
