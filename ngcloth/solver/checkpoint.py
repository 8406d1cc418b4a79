"""The file from which a solve that was cut off goes on."""

import json
import os
import zipfile
from dataclasses import astuple, replace
from pathlib import Path

import numpy as np

from ..errors import InputError
from ..result.history import Row


class Checkpoint:
    """One npz file, replaced as a whole after each step, and read without running code.

    Parameters
    ----------
    path : path
    identity : dict
        What tells this solve from others, plain values; a file of another solve is refused.

    Raises
    ------
    InputError
        If there is no folder to write to.
    """

    def __init__(self, path, identity):
        if not isinstance(path, str | os.PathLike) or not Path(path).absolute().parent.is_dir():
            raise InputError("checkpoint", path, "the path of a file in an existing folder")
        self._path, self._identity = Path(path), json.dumps(identity, sort_keys=True)

    def write(self, state, rows, memory):
        """Replace the file by one of this state, history, and memory of the loop."""
        phases = np.array([row.phase for row in rows])
        numbers = np.array([astuple(row)[1:] for row in rows], dtype=float)
        new = self._path.with_name(f".{self._path.name}.new")
        with open(new, "wb") as file:
            np.savez(
                file,
                identity=np.array(self._identity),
                state=state,
                phases=phases,
                numbers=numbers,
                **{f"memory_{name}": value for name, value in memory.items()},
            )
        os.replace(new, self._path)

    def read(self, size):
        """State, rows and memory in the file; None if there is no file.

        Parameters
        ----------
        size : int
            Of the state.

        Raises
        ------
        InputError
            If the file is damaged, or of another solve.
        """
        if not self._path.exists():
            return None
        allowed = "a file of this very solve, or one that does not exist yet"
        try:
            with np.load(self._path, allow_pickle=False) as file:
                found = dict(file)
            identity, state, rows = str(found["identity"]), found["state"], []
            for phase, numbers in zip(found["phases"], found["numbers"], strict=True):
                row = Row(str(phase), *numbers.tolist())
                rows.append(replace(row, newton=int(row.newton), active=int(row.active)))
            rows[-1]
        except (
            OSError,
            EOFError,
            KeyError,
            ValueError,
            TypeError,
            IndexError,
            zipfile.BadZipFile,
        ) as error:
            text = f"{allowed}; it is damaged ({type(error).__name__}: {error})"
            raise InputError("checkpoint", str(self._path), text) from error
        if identity != self._identity or state.shape != (size,):
            raise InputError("checkpoint", str(self._path), f"{allowed}; this is another one's")
        memory = {name[7:]: found[name] for name in found if name.startswith("memory_")}
        return state, rows, memory

    def remove(self):
        """Delete the file: the solve has converged."""
        self._path.unlink(missing_ok=True)
