"""Tables of two columns that rise, as arrays or CSV files, with errors that name row and value."""

import csv
import os
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ..errors import InputError

FEWEST = 5  # rows: fewer fix no curve
BELOW_ZERO = 0.05  # of the greatest force: noise around zero
LARGEST, LARGEST_FILE = 1e6, 1e8  # rows, bytes


@dataclass(frozen=True)
class Table:
    """Two columns, the second a force.

    Attributes
    ----------
    at, force : ndarray, (n,)
    places : list of str
        What errors call the rows.
    columns : (str, str)
    """

    at: np.ndarray
    force: np.ndarray
    places: list
    columns: tuple

    def refusal(self, row, allowed):
        """The `InputError` of a row."""
        value = float(self.at[row]), float(self.force[row])
        return InputError(self.places[row], value, f"({', '.join(self.columns)}): {allowed}")


def rising_table(name, source, columns):
    """A checked table.

    Parameters
    ----------
    name : str
        What errors call it.
    source : array_like, (n, 2), or path
        A CSV file has two columns, separated by commas, and may have one line of headings.
    columns : (str, str)
        What the columns are.

    Returns
    -------
    Table
        Its first column rises from 0 or more, row by row; its second is not negative.

    Raises
    ------
    InputError
    """
    if isinstance(source, str | os.PathLike):
        values, places = _from_file(name, source)
    else:
        values, places = _from_array(name, source, columns)
    table = Table(*values.T, places, columns)
    if len(values) < FEWEST:
        allowed = f"{FEWEST} or more rows: {len(values)} fix no curve"
        raise InputError(name, len(values), allowed)
    for row in np.flatnonzero(~np.isfinite(values).all(axis=1))[:1]:
        raise table.refusal(row, "finite numbers")
    if not table.at[0] >= 0:
        raise table.refusal(0, f"{columns[0]} of 0 or more")
    for row in np.flatnonzero(np.diff(table.at) <= 0)[:1] + 1:
        raise table.refusal(row, f"a {columns[0]} above that of the row before")
    if not table.force.max() > 0:
        raise table.refusal(int(table.force.argmax()), "a force above 0 in some row")
    for row in np.flatnonzero(table.force < -BELOW_ZERO * table.force.max())[:1]:
        raise table.refusal(row, "forces of 0 or more")
    return table


def _from_array(name, source, columns):
    try:
        if np.iscomplexobj(source):
            raise TypeError("complex numbers")
        values = np.array(source, dtype=float)
    except (TypeError, ValueError) as error:
        raise InputError(name, type(source).__name__, f"numbers, (n, 2) ({error})") from error
    if values.ndim != 2 or values.shape[1] != 2 or len(values) > LARGEST:
        raise InputError(name, values.shape, f"(n, 2): {' and '.join(columns)}, row by row")
    return values, [f"{name}[{row}]" for row in range(len(values))]


def _from_file(name, source):
    allowed = "a CSV file that can be read"
    try:
        if Path(source).exists() and not Path(source).is_file():
            raise OSError("no plain file")  # a pipe would be waited for
        if Path(source).stat().st_size > LARGEST_FILE:
            raise OSError(f"more than {LARGEST_FILE:.0e} bytes")
        text = Path(source).read_text(encoding="utf-8-sig")
    except (OSError, ValueError) as error:
        raise InputError(name, str(source), f"{allowed} ({error})") from error
    rows, places = [], []
    for number, line in enumerate(text.splitlines(), start=1):
        place = f"{name}, line {number} of {Path(source).name}"
        try:
            cells = next(csv.reader([line]), [])
        except csv.Error as error:
            raise InputError(place, line[:80], f"two numbers ({error})") from error
        if not any(cell.strip() for cell in cells):
            continue
        try:
            first, second = map(float, cells)
        except ValueError:
            if number == 1 and len(cells) == 2:
                continue  # headings
            allowed = "two numbers with decimal points, separated by a comma"
            raise InputError(place, ",".join(cells), allowed) from None
        rows.append((first, second))
        places.append(place)
    return np.array(rows, dtype=float).reshape(-1, 2), places
