"""Files that are there as a whole, or as they were before."""

import os
import secrets
from pathlib import Path

from ..errors import InputError


def checked_file(path, *endings, argument="path"):
    """The path of a file to write, checked before anything is computed for it.

    Parameters
    ----------
    path : path
        A file in a folder that exists.
    *endings : str
        Of which the name has to have one, in small letters or capitals; by default any will do.
    argument : str
        How the caller names the path.

    Returns
    -------
    Path

    Raises
    ------
    InputError
        If it is something else.
    """
    try:
        file = Path(path)
    except TypeError:
        raise InputError(argument, path, "a path") from None
    if endings and file.suffix.lower() not in endings:
        raise InputError(argument, str(path), f"a file name that ends in {' or '.join(endings)}")
    if file.is_dir():
        raise InputError(argument, str(path), "a file; this is a folder")
    if not file.parent.is_dir():
        raise InputError(argument, str(path), "a file in a folder that exists")
    return file


def write_file(path, data):
    """Write a file under another name, and rename it once all of it is there.

    Parameters
    ----------
    path : Path
        The file, replaced if it is there.
    data : bytes
        All that it is to hold.

    Raises
    ------
    OSError
        If that fails, for instance as the disk is full; it names the file, which is as it was.
    """
    try:
        if path.exists() and not path.is_file():  # a pipe or a device, not to be replaced
            path.write_bytes(data)
            return
        target = path.resolve()
        new = target.with_name(f".{secrets.token_hex(8)}.ngcloth-new")
        try:
            new.write_bytes(data)
            os.replace(new, target)
        finally:
            new.unlink(missing_ok=True)
    except OSError as error:
        raise OSError(error.errno, f"cannot be written, {error.strerror}", str(path)) from error
