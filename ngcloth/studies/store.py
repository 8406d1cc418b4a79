"""The folder of a study: one folder a case, there as a whole or not at all, of open formats."""

import csv
import io
import json
import os
import secrets
import shutil
from contextlib import contextmanager
from math import isfinite
from pathlib import Path

from ..errors import InputError
from ..output.files import write_file
from ..result.reading import plain_bytes
from ..result.save import checked_path

CASES, TABLE = "cases", "study.csv"
RECORD, RESULT = "case.json", "result"  # of one case
LARGEST = 2**24  # bytes of a record
FORMAT, VERSION = "ngcloth case", 1
FIELDS = ("stretch1", "stretch2", "shear", "angle", "thickness", "reaction", "jacobian")
BARS = ("energy", "area", "outline")
OUTPUTS = (  # of a case, in its row of the table
    ("converged", "reason", "energy", "normalized_energy", "area")
    + tuple(f"{name}_error" for name in BARS)
    + tuple(f"{name}_{end}" for name in FIELDS for end in ("min", "max"))
    + ("steps", "certified", "faults", "memory", "seconds")
)
COLUMNS = ("key", *OUTPUTS)


def checked_folder(folder):
    """The folder of a study as a path; it need not be there yet."""
    path = checked_path(folder)
    try:
        there = next(place for place in (path, *path.parents) if place.exists())
    except OSError as error:  # a name that is too long
        allowed = f"the path of a folder ({error.strerror})"
        raise InputError("folder", str(folder), allowed) from error
    if not (there.is_dir() and os.access(there, os.W_OK | os.X_OK)):
        raise InputError("folder", str(folder), f"a folder to write to; {there} is none")
    return path


class Store:
    """Cases by key in a folder that several processes, and machines, may share.

    Parameters
    ----------
    folder : path
    """

    def __init__(self, folder):
        self.folder = Path(folder)
        self._cases = self.folder / CASES

    def place(self, key):
        """The folder of a case."""
        return self._cases / key

    def record(self, key):
        """What is known of a case, as `record` of `task` made it; None if nothing is."""
        try:
            record = json.loads(plain_bytes(self.place(key) / RECORD, LARGEST))
            known = (record["format"], record["version"], record["key"]) == (FORMAT, VERSION, key)
            whole = set(record["row"]) == set(OUTPUTS) and isinstance(record["finished"], bool)
            there = not record["finished"] or (self.place(key) / RESULT).is_dir()
            return record if known and whole and there else None
        except (OSError, ValueError, KeyError, TypeError, RecursionError):
            return None  # damaged ones are made again

    def finished(self, key):
        """Whether a case has been solved, to the end or to a reason to stop."""
        record = self.record(key)
        return bool(record and record["finished"])

    @contextmanager
    def workshop(self, key):
        """A folder to write a case to, which is put in its place, or is gone if that fails."""
        new = self._cases / f".{key}-{secrets.token_hex(4)}"
        new.mkdir(parents=True)
        try:
            yield new
            self._put(new, key)
        finally:
            shutil.rmtree(new, ignore_errors=True)

    def _put(self, new, key):
        if not self.finished(key):  # a failure, or damaged
            _remove(self.place(key))
        try:
            os.rename(new, self.place(key))
        except OSError:
            if not self.finished(key):  # or else by another master of the same study
                raise

    def begun(self):
        """Keys of the cases that somebody has begun and not ended."""
        return {left.name[1:].partition("-")[0] for left in self._cases.glob(".*-*")}

    def clear(self, keys):
        """Take away failures, and what those have left that were ended before their case was."""
        keys = set(keys)
        for left in self._cases.glob(".*-*"):
            if left.name[1:].partition("-")[0] in keys:
                shutil.rmtree(left, ignore_errors=True)
        for key in keys:
            if not self.finished(key):
                _remove(self.place(key))

    def write_record(self, place, key, record):
        """Write the record of a case to its workshop."""
        record = {"format": FORMAT, "version": VERSION, "key": key} | record
        text = json.dumps(strict(record), indent=2, ensure_ascii=False, allow_nan=False)
        (place / RECORD).write_bytes(text.encode(errors="surrogatepass"))

    def write_table(self, rows):
        """Write the table as a file of comma separated values, lists and dicts as JSON."""
        text = io.StringIO(newline="")
        table = csv.DictWriter(text, list(dict.fromkeys(name for row in rows for name in row)))
        table.writeheader()
        for row in rows:
            table.writerow({name: _cell(value) for name, value in row.items()})
        self.folder.mkdir(parents=True, exist_ok=True)
        write_file(self.folder / TABLE, text.getvalue().encode(errors="replace"))


def _remove(place):
    """Take away a folder, or whatever else has its name."""
    if place.is_dir() and not place.is_symlink():
        shutil.rmtree(place, ignore_errors=True)
    else:
        place.unlink(missing_ok=True)


def _cell(value):
    return json.dumps(value) if isinstance(value, list | tuple | dict) else value


def strict(value):
    """A value with None for numbers that JSON has not, and Python's own for NumPy's."""
    if hasattr(value, "tolist"):
        value = value.tolist()
    if isinstance(value, float):
        return value if isfinite(value) else None
    if isinstance(value, dict):
        return {name: strict(each) for name, each in value.items()}
    if isinstance(value, list | tuple):
        return [strict(each) for each in value]
    return value
