"""Surfaces from facets: STL, OBJ, PLY, VTP, VTU, or points and triangles."""

import tempfile
import warnings
from pathlib import Path

import numpy as np
from netgen.meshing import NgException

from ..errors import InputError, check_number
from .cad import patience, read_bytes
from .file_surface import MESHES, FileSurface, check_size, tube
from .flatten import FlatteningError, flatten
from .jets import EXACT, Jets
from .process import KernelError, run
from .remesh import Remesher
from .rim_curves import RimCurves
from .topology import clean, topology

ENDINGS = {ending: ending for ending in MESHES}
LARGER = 1.05  # area of a smooth surface over that of facets, from which on it is not near them
CHOICE = (
    "All facets are taken: cut the part in another program, and save it as .obj or .ply, which "
    "keep the cut, or pass points, and the triangles that you choose"
)
ROUGH = 0.06  # noise over length of edges from which on curvature is not to be relied on


class FacetSurface(FileSurface):
    """A smooth surface near the vertices of facets.

    Parameters
    ----------
    points : ndarray, (n, 3)
    triangles : ndarray of int, (m, 3)
    unit : {"mm", "cm", "m", "inch"}
    side : {1, -1}
    smoothing : "auto" or float
    argument, value : str, object
        What to name in an error.

    Attributes
    ----------
    noise : float
        Standard deviation of the vertices from the surface, in its unit.
    curvature_error : float
        That of the mean curvature, by this noise.
    rough : bool
        Whether there is too much noise for curvature, and for the reaction of the surface.
    """

    def __init__(self, points, triangles, unit, side, smoothing, argument, value):
        super().__init__(unit, side)
        points, triangles = _whole(*_checked(points, triangles, argument, value))
        if len(points) < EXACT:
            allowed = f"at least {EXACT} vertices of facets with an area; there are {len(points)}"
            raise InputError(argument, value, allowed)
        self.box = np.array([points.min(axis=0), points.max(axis=0)])
        check_size(self.box, unit, argument, value)
        found, turned = topology(triangles)
        if fault := _fault(points, triangles, found):
            allowed = f"a disk, with or without holes; this is {fault} (found: {found}). {CHOICE}"
            raise InputError(argument, value, allowed)
        triangles[turned] = triangles[turned][:, [1, 0, 2]]
        self.points, self.triangles, self.smoothing = points, triangles, smoothing

        normals, areas = _normals(points, triangles)
        edge = np.sqrt(4 / np.sqrt(3) * areas.sum() / len(triangles))
        neighbours = None
        if smoothing != "auto":
            smoothing = check_number("smoothing", smoothing, 0)
            neighbours = int(np.pi * smoothing**2 * len(points) / areas.sum())
        jets = Jets(points, normals, neighbours)
        self.noise, self.curvature_error = jets.noise, jets.curvature_error
        self.rough = bool(self.noise > ROUGH * edge)
        reach = np.sqrt(jets.neighbours * areas.sum() / len(points) / np.pi)
        curves = RimCurves(points, found.rims, reach if self.noise > 1e-2 * ROUGH * edge else 0)
        try:
            flat = flatten(points, triangles, found.rims)
        except FlatteningError as error:
            raise InputError(argument, value, f"a surface that can be laid flat; {error}") from None
        self._remesher = Remesher(points, triangles, flat, jets, curves)
        self._survey(argument, value)
        if not self.area < LARGER * areas.sum():
            allowed = (
                f"facets near a smooth surface; theirs have {areas.sum():.3g} {unit}², the one "
                f"through their vertices {self.area:.3g}. Take more even facets, without needles, "
                "folds and sharp edges, or a CAD file"
            )
            raise InputError(argument, value, allowed)

    def levels(self, maxh, orders, count):  # noqa: D102
        try:
            return self._remesher.levels(maxh, orders, count)
        except NgException as error:
            raise InputError("maxh", maxh, f"a size in which it can be meshed ({error})") from error

    def arrays(self):  # noqa: D102
        return {
            "points": self.points,
            "triangles": self.triangles,
            "unit": np.array(self.unit),
            "side": np.array(self.side),
            "smoothing": np.array(self.smoothing),
        }

    @classmethod
    def of_arrays(cls, arrays):  # noqa: D102
        others = (arrays[name].item() for name in ("unit", "side", "smoothing"))
        return cls(arrays["points"], arrays["triangles"], *others, "arrays", "points and triangles")

    def __str__(self):
        noise = f"  noise   {self.noise:.2g} {self.unit}"
        if self.rough:
            noise += ", too much for curvature and reaction"
        return f"surface of {len(self.triangles)} facets\n{super().__str__()}\n{noise}"


def from_mesh(source, unit="mm", smoothing="auto", side=1):
    """Make a surface from facets.

    Parameters
    ----------
    source : path, or pair of array_like
        A file of facets (.stl, .obj, .ply, .vtp, .vtu); or points (n, 3), and triangles (m, 3) by
        the numbers of their points.
    unit : {"mm", "cm", "m", "inch"}, optional
        What one unit of length in the file is; it is kept in all that is computed and exported.
        Default mm.
    smoothing : "auto" or float, optional
        The radius of the neighbourhoods of vertices through which the smooth surface is fitted. By
        default small where vertices are exact, and as large as their noise asks for and the shape
        allows, where they are not.
    side : {1, -1}, optional
        The cloth lies on the side from which the larger part of the facets is counter-clockwise, or
        on the other. Default 1.

    Returns
    -------
    FacetSurface

    Raises
    ------
    InputError
        If the file cannot be read, whatever is in it; if points are not finite; if the facets do
        not make a disk, with or without holes; or no smooth surface through their vertices is near
        them.

    Warns
    -----
    UserWarning
        Where noise hides the curvature, as at 1e-2 of the radius of a dome; and of edges at which
        the surface turns by more than 5°.
    """
    if isinstance(source, tuple | list):
        if len(source) != 2:
            raise InputError("source", source, "a path, or a pair of points and triangles")
        arrays = "source", "points and triangles"
        return _with_warnings(FacetSurface(*source, unit, side, smoothing, *arrays), "the surface")
    path, ending, data = read_bytes(source, ENDINGS)
    with tempfile.TemporaryDirectory() as folder:
        folder = Path(folder)
        (folder / f"file{ending}").write_bytes(data)
        try:
            facets = run("read_facets", folder, patience(data), name=f"file{ending}")
        except KernelError as error:
            raise InputError("path", str(path), f"a readable {ending[1:]} file ({error})") from None
    facets = facets["points"], facets["triangles"]
    return _with_warnings(
        FacetSurface(*facets, unit, side, smoothing, "path", str(path)), path.name
    )


def _with_warnings(surface, name):
    surface.warn_of_edges(name, stacklevel=4)
    if surface.rough:
        noise = f"vertices {surface.noise:.2g} {surface.unit} off a smooth surface"
        warnings.warn(f"{noise}: too rough for its curvature and its reaction", stacklevel=4)
    return surface


def _checked(points, triangles, argument, value):
    """Points and triangles as arrays."""
    try:
        points = np.asarray(points, dtype=float)
        triangles = np.asarray(triangles)
    except (TypeError, ValueError):
        raise InputError(argument, value, "numbers") from None
    for name, array in {"points": points, "triangles": triangles}.items():
        if array.ndim != 2 or array.shape[1] != 3:
            raise InputError(argument, value, f"{name} of shape (n, 3), not {array.shape}")
        if not len(array):
            raise InputError(argument, value, f"{name} of facets; there are none in it")
    if triangles.dtype.kind not in "iu":
        raise InputError(argument, value, "triangles of whole numbers")
    if triangles.min() < 0 or triangles.max() >= len(points):
        raise InputError(argument, value, f"triangles of numbers from 0 to {len(points) - 1}")
    points = points + 0.0  # -0.0 is the same point as 0.0
    bad = np.flatnonzero(~np.isfinite(points).all(axis=1))
    if len(bad):
        raise InputError(argument, value, f"finite points; {len(bad)} are not, first {bad[0]}")
    if not np.ptp(points, axis=0).max() > 0:
        raise InputError(argument, value, "facets with a size; all points are one")
    return points, triangles


def _whole(points, triangles):
    """Facets joined where vertices coincide, or, if only without that they are a disk, not joined.

    A tube that was cut open has both sides of the cut in one place.
    """
    whole = clean(points, triangles)
    if _fault(*whole, topology(whole[1])[0]):
        own = clean(points, triangles, merge=False)
        if not _fault(*own, topology(own[1])[0]):
            return own
    return whole


def _fault(points, triangles, found):
    """Why facets of this topology are no disk; None if they are one."""
    return found.fault or tube(points, triangles, found.rims)


def _normals(points, triangles):
    """Unit normals at the vertices, (n, 3), and areas of the facets."""
    a, b, c = points[triangles].transpose(1, 0, 2)
    across = np.cross(b - a, c - a)
    sums = [
        np.bincount(triangles.ravel(), np.repeat(across[:, i], 3), len(points)) for i in range(3)
    ]
    normals = np.stack(sums, axis=-1)
    lengths = np.linalg.norm(normals, axis=1, keepdims=True)
    return normals / np.maximum(lengths, 1e-300), np.linalg.norm(across, axis=1) / 2
