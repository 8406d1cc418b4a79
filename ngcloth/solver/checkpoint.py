"""The file from which a solve that was cut off goes on."""

import json
import os
import tempfile
from dataclasses import astuple, replace
from pathlib import Path

import numpy as np

from ..errors import InputError
from ..problem.constraints import LimitPoints
from ..result.history import Row
from ..result.reading import plain_arrays, plain_bytes
from ..result.save import checksum

ALLOWED = "a file of this very solve, or one that does not exist yet"
FARTHEST = 1e100  # coordinates of a patch: cubes of them are numbers
LARGEST = 2**28  # bytes: 30 million numbers


class Checkpoint:
    """One npz file, replaced as a whole after each step, and read without running code.

    Several solves may share it: it is the one written last.

    Parameters
    ----------
    path : path
    identity : dict
        What tells this solve from others, plain values.

    Raises
    ------
    InputError
        If there is no folder to write to, or the file is damaged or of another solve.
    """

    def __init__(self, path, identity):
        allowed = "the path of a file in an existing folder"
        try:
            self._path = Path(path).resolve()
            here = self._path.parent.is_dir() and (self._path.is_file() or not self._path.exists())
        except (TypeError, ValueError, OSError, RuntimeError) as error:
            raise InputError("checkpoint", path, f"{allowed} ({error})") from error
        if not here:
            raise InputError("checkpoint", path, allowed)
        self._identity = json.dumps(identity, sort_keys=True)
        # Short, as names may be as long as the system bears, and no other file's.
        self._hidden = f".ngcloth-{checksum(self._path.name.encode())[:16]}-"
        self._found = self._read() if self._path.exists() else None

    def write(self, state, rows, memory):
        """Replace the file by one of this state, history, and memory of the loop.

        Raises
        ------
        OSError
            If the disk is full, for instance; the file is as it was.
        """
        phases = np.array([row.phase for row in rows])
        numbers = np.array([astuple(row)[1:] for row in rows], dtype=float)
        handle, new = tempfile.mkstemp(prefix=self._hidden, dir=self._path.parent)
        try:
            with open(handle, "wb") as file:
                np.savez(
                    file,
                    identity=np.array(self._identity),
                    state=state,
                    phases=phases,
                    numbers=numbers,
                    **{f"memory_{name}": value for name, value in memory.items()},
                )
            os.replace(new, self._path)
        except BaseException:
            Path(new).unlink(missing_ok=True)
            raise

    def found(self, size, slacks, triangles):
        """State, rows and memory in the file; None if there was none.

        Parameters
        ----------
        size : int
            Of the state.
        slacks : tuple
            The shape of what a loop remembers of each slack, without that at added points.
        triangles : int
            Of the mesh.

        Raises
        ------
        InputError
            If the file has arrays of other shapes.
        """
        if self._found is None:
            return None
        state, rows, memory = self._found
        shapes = {"filter": (*memory.get("filter", state).shape[:1], 2)}
        if "triangles" in memory:
            points = LimitPoints(*(memory[name] for name in LimitPoints._fields))
            try:
                points.check(triangles)
            except ValueError as error:
                self._refuse(f"it is damaged ({error})", error)
            added = len(points.triangles)
            shapes |= {"s": (slacks[0], slacks[1] + added), "triangles": (added,)}
            shapes |= {"z": shapes["s"], "reference": (added, 2)}
        wrong = [name for name in memory if memory[name].shape != shapes.get(name, ())]
        if state.shape != (size,) or wrong:
            told = ", ".join(wrong) or "the state"
            self._refuse(f"one of another build, with another shape of {told}, cannot be resumed")
        return self._found

    def remove(self):
        """Delete the file, and what killed processes have left of it: the solve has converged."""
        self._path.unlink(missing_ok=True)
        for left in self._path.parent.glob(f"{self._hidden}*"):
            left.unlink(missing_ok=True)

    def _read(self):
        try:
            found = plain_arrays(plain_bytes(self._path, LARGEST), LARGEST)
            identity = found["identity"].item()
            if identity == self._identity:
                return self._checked(found)
        except Exception as error:
            self._refuse(f"it is damaged ({type(error).__name__}: {error})", error)
        self._refuse("this is another one's")

    def _checked(self, found):
        memory = Memory(self._path)
        memory |= {n.removeprefix("memory_"): found[n] for n in found if n.startswith("memory_")}
        for name, array in (memory | {"state": found["state"]}).items():
            if array.dtype.kind not in "fbi" or np.isnan(array).any():
                raise ValueError(f"{name} is not of numbers")
        if not (np.abs(found["state"]) < FARTHEST).all():
            raise ValueError("its patch is larger than anything")
        rows = []
        for phase, numbers in zip(found["phases"].tolist(), found["numbers"], strict=True):
            row = Row(phase, *numbers.tolist())
            rows.append(replace(row, newton=int(row.newton), active=int(row.active)))
        if not (rows[-1].newton >= 0 and 0 <= rows[-1].seconds < np.inf):
            raise ValueError("its steps or seconds are impossible")
        return found["state"], rows, memory

    def _refuse(self, why, error=None):
        raise InputError("checkpoint", str(self._path), f"{ALLOWED}; {why}") from error


class Memory(dict):
    """What a loop remembers; refuses the file where it misses something."""

    def __init__(self, path):
        super().__init__()
        self._path = path

    def __missing__(self, name):
        text = f"{ALLOWED}; one of another build, without {name}, cannot be resumed"
        raise InputError("checkpoint", str(self._path), text)
