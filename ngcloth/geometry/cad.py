"""Surfaces from CAD files: STEP, IGES and BREP."""

import tempfile
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ..errors import InputError
from .file_surface import UNITS, FileSurface, Level, check_size
from .mirrors import MIRRORS
from .process import KernelError, run

ENDINGS = {
    ".step": ".step",
    ".stp": ".step",
    ".iges": ".iges",
    ".igs": ".iges",
    ".brep": ".brep",
    ".brp": ".brep",
}  # the kernel reads but one spelling of each
GAP = 1e-5  # of the size; gaps as wide are closed, as between the loose faces of IGES files
PATIENCE = 120.0, 3e-5  # seconds, and for each byte, in which a file is read or has no end
MESHING = 120.0, 2e-2  # and for each triangle, in which faces are meshed


@dataclass(frozen=True)
class Face:
    """A face of a CAD file, for the choice of faces.

    Attributes
    ----------
    index : int
    name : str
        Empty if the file tells none.
    area : float
    centre : ndarray, (3,)
        Its centre of mass.
    box : ndarray, (2, 3)
        Corners of its bounding box.
    """

    index: int
    name: str
    area: float
    centre: np.ndarray
    box: np.ndarray


class CadSurface(FileSurface):
    """A surface made of faces of a CAD file.

    Parameters
    ----------
    brep : bytes
        The faces, joined, in the .brep format and in mm.
    edge_names : ndarray of str
        Names of their edges, in the order of the kernel. Those named "mirror1" and "mirror2" are
        mirror lines of a symmetric scene.
    box : ndarray, (2, 3)
        In mm.
    faces : int
        How many.
    unit : {"mm", "cm", "m", "inch"}
    side : {1, -1}
    """

    def __init__(self, brep, edge_names, box, faces, unit, side):
        super().__init__(unit, side)
        self.brep, self.edge_names, self.faces = brep, edge_names, faces
        self.box = np.asarray(box) / UNITS[unit]
        self._survey("faces", faces)

    def levels(self, maxh, orders, count):  # noqa: D102
        triangles = 10 * (self.size / maxh) ** 2 * 4 ** (count - 1)
        with tempfile.TemporaryDirectory() as folder:
            (Path(folder) / "part.brep").write_bytes(self.brep)
            try:
                answer = run(
                    "mesh_part",
                    Path(folder),
                    MESHING[0] + MESHING[1] * triangles,
                    edge_names=self.edge_names,
                    maxh=maxh * UNITS[self.unit],
                    levels=count,
                    orders=orders,
                )
            except KernelError as error:
                allowed = f"faces that can be meshed ({error}); take fewer, or repair the file"
                raise InputError("faces", self.faces, allowed) from error
        return [self._level(answer, number, orders) for number in range(count)]

    def arrays(self):  # noqa: D102
        return {
            "brep": np.frombuffer(self.brep, dtype=np.uint8),
            "edge_names": np.asarray(self.edge_names, dtype=str),
            "box": self.box * UNITS[self.unit],
            "faces": np.array(self.faces),
            "unit": np.array(self.unit),
            "side": np.array(self.side),
        }

    @classmethod
    def of_arrays(cls, arrays):  # noqa: D102
        faces, unit, side = (arrays[name].item() for name in ("faces", "unit", "side"))
        brep = arrays["brep"].astype(np.uint8).tobytes()
        return cls(brep, arrays["edge_names"].astype(str), arrays["box"], faces, unit, side)

    def _level(self, answer, number, orders):
        segments, names = answer[f"segments_{number}"], answer[f"segment_names_{number}"]
        keys = map(tuple, np.sort(segments, axis=1).tolist())
        return Level(
            vertices=answer[f"vertices_{number}"] / UNITS[self.unit],
            triangles=answer[f"triangles_{number}"],
            parents=answer[f"parents_{number}"],
            names={k: str(n) for k, n in zip(keys, names, strict=True) if n in MIRRORS},
            nodes={order: answer[f"nodes{order}_{number}"] / UNITS[self.unit] for order in orders},
        )

    def __str__(self):
        return f"surface of {self.faces} CAD faces\n{super().__str__()}"


def from_cad(path, faces=None, unit="mm", side=1):
    """Read a surface from a CAD file.

    Parameters
    ----------
    path : path
        A STEP, IGES or BREP file (.step, .stp, .iges, .igs, .brep, .brp).
    faces : int, str, sequence of them, or callable, optional
        The faces to be covered: by their number in the file, from 0; by name; or a function of a
        `Face` that returns whether to take it. By default all.
    unit : {"mm", "cm", "m", "inch"}, optional
        The unit of length in which to compute, of `maxh` and of all that is exported. Files are
        converted to it: STEP and IGES tell the unit that they are in, BREP is taken to be in mm.
        Default mm.
    side : {1, -1}, optional
        The cloth lies on the side to which the larger part of the faces looks, the outside of a
        solid, or on the other. Default 1.

    Returns
    -------
    CadSurface

    Raises
    ------
    InputError
        If the file cannot be read, whatever is in it; no face is chosen; or the faces do not make
        a disk, with or without holes.

    Warns
    -----
    UserWarning
        Of edges at which the surface turns by more than 5°: a reaction along them is not seen.
    """
    path, ending, data = read_bytes(path, ENDINGS)
    if not isinstance(unit, str) or unit not in UNITS:
        raise InputError("unit", unit, "one of " + ", ".join(map(repr, UNITS)))
    with tempfile.TemporaryDirectory() as folder:
        folder = Path(folder)
        (folder / f"file{ending}").write_bytes(data)
        try:
            table = run(
                "read_cad",
                folder,
                patience(data),
                name=f"file{ending}",
                measured=callable(faces),
            )
        except KernelError as error:
            raise InputError("path", str(path), f"a readable {ending[1:]} file ({error})") from None
        numbers = _chosen(table, faces, path, unit)
        boxes = table["boxes"][numbers]
        box = np.array([boxes[:, 0].min(axis=0), boxes[:, 1].max(axis=0)])
        check_size(box, "mm", "path", str(path))
        try:
            joined = run(
                "join_faces",
                folder,
                faces=numbers,
                edge_names=table["edge_names"],
                tolerance=GAP * np.linalg.norm(np.ptp(box, axis=0)),
            )
        except KernelError as error:
            raise InputError("faces", numbers, f"faces that can be joined ({error})") from None
        if joined["closed"]:  # known before it is meshed, which takes minutes for an assembly
            from .topology import CLOSED

            allowed = f"a disk, with or without holes; this is {CLOSED}"
            raise InputError("faces", len(numbers), allowed)
        brep = (folder / "part.brep").read_bytes()
    surface = CadSurface(brep, joined["edge_names"], box, len(numbers), unit, side)
    surface.warn_of_edges(path.name, stacklevel=3)
    return surface


def _chosen(table, faces, path, unit):
    """The numbers of the chosen faces."""
    known = [
        Face(index, str(name), float(area), centre, box)
        for index, (name, area, centre, box) in enumerate(
            zip(
                table["names"],
                table["areas"] / UNITS[unit] ** 2,
                table["centres"] / UNITS[unit],
                table["boxes"] / UNITS[unit],
                strict=True,
            )
        )
    ]
    if not known:
        raise InputError("path", str(path), "a file with faces; it has none")
    if faces is None:
        return [face.index for face in known]
    if callable(faces):
        chosen = {face.index for face in known if faces(face)}
    else:
        chosen = set()
        single = isinstance(faces, str | int | np.integer)
        for wanted in [faces] if single else list(faces):
            found = {face.index for face in known if wanted in (face.index, face.name)}
            if not found or isinstance(wanted, bool) or wanted == "":
                names = sorted({face.name for face in known} - {""})
                allowed = f"numbers from 0 to {len(known) - 1}, or names of faces: {names}"
                raise InputError("faces", wanted, allowed)
            chosen |= found
    if not chosen:
        raise InputError("faces", faces, f"at least one of the {len(known)} faces")
    return sorted(chosen)


def read_bytes(path, endings):
    """A file as Path, its ending as the readers know it, and its bytes; `InputError` if not."""
    try:
        path = Path(path)
    except TypeError:
        raise InputError("path", path, "the path of a file") from None
    ending = endings.get(path.suffix.lower())
    if ending is None:
        raise InputError("path", str(path), "a file that ends in " + ", ".join(endings))
    if path.exists() and not path.is_file():  # a pipe would be waited for
        raise InputError("path", str(path), "a plain file")
    try:
        data = path.read_bytes()
    except (OSError, ValueError) as error:
        allowed = f"a file that can be read ({getattr(error, 'strerror', error)})"
        raise InputError("path", str(path), allowed) from None
    if not data:
        raise InputError("path", str(path), "a file that is not empty")
    return path, ending, data


def patience(data):
    """How many seconds a reader may take over a file."""
    return PATIENCE[0] + PATIENCE[1] * len(data)
