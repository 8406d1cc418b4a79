"""Reading files of strangers: plain files of a bounded size, and arrays without code."""

import io
import math
import os
import stat
import zipfile

import numpy as np

MEMBERS = 100  # of an archive; results and checkpoints have less than twenty


def is_plain(path):
    """Whether there is a file in the narrow sense: no link, folder, pipe or device."""
    return stat.S_ISREG(os.lstat(path).st_mode)


def plain_bytes(path, most):
    """The bytes of a plain file.

    Parameters
    ----------
    path : path
        Of the file.
    most : int
        The largest number of bytes to read.

    Returns
    -------
    bytes

    Raises
    ------
    OSError
        If there is no file, or it cannot be read.
    ValueError
        If it is not a plain file, in which case it is not opened, or a larger one.
    """
    if not is_plain(path):
        raise ValueError("it is not a plain file")
    # Should it be another one by now: pipes are not waited for, and links not followed.
    flags = (getattr(os, name, 0) for name in ("O_NOFOLLOW", "O_NONBLOCK", "O_BINARY"))
    with open(os.open(path, os.O_RDONLY | sum(flags)), "rb") as file:
        if not stat.S_ISREG(os.fstat(file.fileno()).st_mode):
            raise ValueError("it is not a plain file")
        data = file.read(most + 1)
    if len(data) > most:
        raise ValueError(f"it is larger than {most} bytes")
    return data


def plain_arrays(data, most):
    """The arrays of an npz file, {name: array}, none of which holds objects.

    Parameters
    ----------
    data : bytes
        Of the file.
    most : int
        The largest number of bytes to unpack.

    Returns
    -------
    dict of ndarray

    Raises
    ------
    ValueError, zipfile.BadZipFile
        If it is damaged or foreign, or larger once unpacked; before memory is taken for it.
    """
    if data.count(b"PK\x01\x02") > MEMBERS:  # what a list of contents has at each member
        raise ValueError(f"it has more than {MEMBERS} members")
    with zipfile.ZipFile(io.BytesIO(data)) as archive:
        members = archive.infolist()
        if sum(member.file_size for member in members) > most:
            raise ValueError(f"it is larger than {most} bytes once unpacked")
        names = [member.filename.removesuffix(".npy") for member in members]
        if len(set(names)) < len(names):
            raise ValueError("two of its arrays have one name")
        return {name: _array(archive, each) for name, each in zip(names, members, strict=True)}


def _array(archive, member):
    # Other methods of packing unpack more at once than is asked for.
    if member.compress_type not in (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED):
        raise ValueError(f"{member.filename} is packed in another way than NumPy's")
    with archive.open(member) as file:
        if np.lib.format.read_magic(file) != (1, 0):
            raise ValueError(f"{member.filename} is of another version than 1.0")
        shape, _, kind = np.lib.format.read_array_header_1_0(file)
        size = math.prod(shape) * kind.itemsize
        if min(shape, default=0) < 0 or size != member.file_size - file.tell():
            raise ValueError(f"{member.filename} has another size than its shape says")
    with archive.open(member) as file:
        return np.lib.format.read_array(file, allow_pickle=False)
