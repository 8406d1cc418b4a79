"""The direction of the warp at a point of the surface: given in space, held by a condition on ∇ψ.

The warp runs along the direction d of the parameter plane where ∇ψ d is a positive multiple of e1.
∇ψ2·d = 0 is one linear condition on ψ, which a rotation of the patch fulfils.
"""

import ngsolve as ngs
import numpy as np

from ..errors import InputError
from ..geometry.file_surface import FileSurface
from ..geometry.nearest import nearest_on_sheet, nearest_parameters
from .domain import MeshDomain

STEEP = 1e-3  # least part of a direction that lies along the surface
NEAR = 1e-2  # of the size: how far from the surface a point may lie
STRAIGHT = 1e-6  # sine of an angle that counts as none


def checked_warp(scene):
    """Direction and point of a scene as triples of floats.

    Raises
    ------
    InputError
        If one is not of three finite numbers, the point is off the surface, or the direction
        normal to it, or not that of the warp in a scene with mirrors.
    """
    if scene.warp is None:
        if scene.at is not None:
            raise InputError("at", scene.at, "None without a direction of the warp")
        return None, None
    surface, direction = scene.surface, _triple("warp", scene.warp)
    if scene.symmetric and isinstance(surface, FileSurface):
        allowed = "None in a scene with mirrors: where these meet, it runs along the edge 'mirror2'"
        raise InputError("warp", scene.warp, allowed)
    if not np.abs(direction).max() > 0:
        raise InputError("warp", scene.warp, "a direction in space, not zero")
    direction = direction / np.abs(direction).max()
    at = middle(surface) if scene.at is None else _triple("at", scene.at)
    theta, point, tangents = on_surface(surface, at)
    told = in_words(point)
    if not (distance := np.linalg.norm(point - at)) <= NEAR * _size(surface):
        allowed = f"a point of the surface; the nearest is {told}, {distance:.3g} away"
        raise InputError("at", scene.at, allowed)
    along = parameter_direction(tangents, direction)
    if not np.linalg.norm(tangents @ along) > STEEP * np.linalg.norm(direction):
        allowed = f"a direction along the surface, and this one is normal to it at {told}"
        raise InputError("warp", scene.warp, allowed)
    if scene.symmetric:
        size = np.linalg.norm(tangents @ along)
        across = np.linalg.norm(tangents[:, 1] * along[1]) > STRAIGHT * size
        off = np.abs(theta - surface.domain.centre).min() > STRAIGHT * surface.diameter
        if across or off or along[0] < 0:
            allowed = "that of θ1 on a mirror line in a scene with mirrors, as these ask for"
            raise InputError("warp", scene.warp, allowed)
    return tuple(direction.tolist()), tuple(at.tolist())


def parameter_direction(tangents, direction):
    """The d of the parameter plane that tangents (3, 2) take to a direction's part along them."""
    return np.linalg.lstsq(tangents, np.asarray(direction, dtype=float), rcond=None)[0]


def in_words(triple):
    """Three numbers as text."""
    return "({:.4g}, {:.4g}, {:.4g})".format(*(np.round(triple, 9) + 0.0))


def middle(surface, symmetric=False):
    """A point in the middle of the surface, in space, (3,); with mirrors, where these meet."""
    if isinstance(surface, FileSurface):
        if symmetric:
            return surface.quarter[1].corner
        sheet = surface.survey
        return np.array(sheet.position(sheet.mesh(*MeshDomain(sheet.mesh).centre)))
    return surface.evaluate(surface.position, surface.domain.centre)


def on_surface(surface, target):
    """The parameters (2,) of the point of a surface nearest to one in space; it; ∂φ/∂θ (3, 2).

    Of surfaces from files, those of `survey`.
    """
    if isinstance(surface, FileSurface):
        return nearest_on_sheet(surface.survey, target)
    slopes = ngs.CF(surface.on(None).tangents, dims=(2, 3))

    def place(theta):
        return surface.evaluate(surface.position, theta)

    def tangents(theta):
        return surface.evaluate(slopes, theta).T

    domain = surface.domain
    samples = np.concatenate([domain.centre[None], domain.sample()])
    theta = nearest_parameters(target, samples, place, tangents, domain.contains)
    return theta, place(theta[None])[0], tangents(theta)


class HeldDirection:
    """∇ψ2·d = 0 at one point of a mesh, as a linear condition normal·ψ = 0 on coefficients.

    Parameters
    ----------
    space : FESpace
        Its first two components are those of ψ.
    sheet : Sheet
        The surface on the mesh of the space.
    direction, at : (float, float, float)
        In space.

    Attributes
    ----------
    normal : BaseVector
        Of unit length.
    """

    def __init__(self, space, sheet, direction, at):
        theta, _, tangents = nearest_on_sheet(sheet, np.array(at))
        along = parameter_direction(tangents, direction)
        point = sheet.mesh(*theta)
        element = ngs.ElementId(ngs.VOL, point.nr)
        # NGSolve's points do not keep the map alive that they are of.
        part, map_to = space.components[0], sheet.mesh.GetTrafo(element)
        self._numbers = np.array(part.GetDofNrs(element))
        shapes = part.GetFE(element).CalcDShape(map_to(*point.pnt[:2]))
        self._slopes = np.array(shapes) @ along
        self.normal = ngs.BaseVector(space.ndof)
        self.normal[:] = 0
        numbers = self._numbers + space.Range(1).start
        self.normal.FV().NumPy()[numbers] = self._slopes / np.linalg.norm(self._slopes)

    def turn(self, psi):
        """Rotate the components of ψ, so that ∇ψ d is a positive multiple of e1."""
        one, two = (component.vec.FV().NumPy() for component in psi)
        along, across = (self._slopes @ part[self._numbers] for part in (one, two))
        cosine, sine = np.array([along, across]) / np.hypot(along, across)
        one[:], two[:] = cosine * one + sine * two, cosine * two - sine * one


class HeldInverse(ngs.BaseMatrix):
    """The inverse of a matrix A under a condition: A x + λ normal = load, normal·x = 0.

    Parameters
    ----------
    inverse : BaseMatrix
        Of A.
    normal : BaseVector
    """

    def __init__(self, inverse, normal):
        super().__init__()
        self._inverse, self._normal = inverse, normal
        self._response = normal.CreateVector()
        self._response.data = inverse * normal
        self._compliance = self._response.InnerProduct(normal)

    def Mult(self, load, out):  # noqa: D102, N802
        out.data = self._inverse * load
        share = out.InnerProduct(self._normal) / self._compliance
        out.data -= float(share) * self._response

    def Height(self):  # noqa: D102, N802
        return len(self._normal)

    Width = Height

    def CreateVector(self, column):  # noqa: D102, N802
        return self._normal.CreateVector()


def _triple(argument, value):
    try:
        array = np.array(value, dtype=float)
    except (TypeError, ValueError):
        array = np.empty(0)
    if array.shape != (3,) or not np.isfinite(array).all():
        raise InputError(argument, value, "three finite numbers, (x, y, z)")
    return array


def _size(surface):
    if isinstance(surface, FileSurface):
        return surface.size
    places = surface.evaluate(surface.position, surface.domain.sample(5))
    return float(np.linalg.norm(np.ptp(places, axis=0)) / np.sqrt(3))
