"""`parity/records/expected.csv`: values that tables and figures are to have, tolerances, reasons.

The file is written by `accept` from the tolerances that each table's function states, and read wherever
something is compared.
"""

import csv
import dataclasses
import io
import math

from paper import files, tables
from protocol import InputError

FILE = "parity/records/expected.csv"
HEAD = ["item", "row", "column", "value", "tolerance", "reason"]
REMEDY = "restore it from version control, or write it anew: `make paper-accept`"


@dataclasses.dataclass
class Expected:
    """A value of a table's cell, or of a figure's comparison."""

    item: str
    row: str
    column: str
    value: float
    tolerance: float
    reason: str


def read(root):
    """All of them."""
    path = root / FILE
    text = files.read_text(path, "the expected values", REMEDY)
    lines = list(csv.reader(io.StringIO(text)))
    if not lines or lines[0] != HEAD:
        raise InputError(f"{FILE}, line 1", repr(lines[:1]), ",".join(HEAD), REMEDY)
    found = []
    for number, line in enumerate(lines[1:], 2):
        place = f"{FILE}, line {number}"
        if len(line) != len(HEAD):
            raise InputError(place, f"{len(line)} cells", f"{len(HEAD)} cells", REMEDY)
        try:
            value, tolerance = float(line[3]), float(line[4])
        except ValueError:
            raise InputError(place, repr(line[3:5]), "two numbers", REMEDY) from None
        if not (math.isfinite(value) and math.isfinite(tolerance) and tolerance >= 0 and line[5].strip()):
            expected = "finite numbers, a tolerance of 0 or more, and its reason"
            raise InputError(place, repr(line[3:]), expected, REMEDY)
        found.append(Expected(*line[:3], value, tolerance, line[5]))
    return found


def of_table(name, drawn, keys):
    """The values that a drawn table states."""
    found = []
    for row in drawn.rows:
        key = key_of(row, keys)
        for column, cell in zip(drawn.head, row, strict=True):
            if isinstance(cell, tables.Cell):
                found.append(Expected(name, key, column, cell.value, cell.tolerance, cell.reason))
    return found


def key_of(row, keys):
    """What a row is called: its first cells."""
    return " / ".join(tables.text_of(cell) or "" for cell in row[:keys])


def text(values):
    """The file."""
    stream = io.StringIO()
    writer = csv.writer(stream, lineterminator="\n")
    writer.writerow(HEAD)
    for one in values:
        writer.writerow(
            [one.item, one.row, one.column, f"{one.value:.6g}", f"{one.tolerance:.3g}", one.reason]
        )
    return stream.getvalue()


def compare(name, drawn, keys, expected):
    """Sentences on what is not as expected, and how many values were compared."""
    wanted = {(one.row, one.column): one for one in expected if one.item == name}
    problems, compared = [], 0
    for found in of_table(name, drawn, keys):
        one = wanted.pop((found.row, found.column), None)
        where = f"{found.row}, {found.column}"
        if one is None:
            problems.append(f"{where}: {found.value:.6g}, and {FILE} expects nothing there")
            continue
        compared += 1
        # Six digits are written.
        if not abs(found.value - one.value) <= one.tolerance + 1e-5 * abs(one.value):
            problems.append(
                f"{where}: {found.value:.6g}, "
                f"expected {one.value:.6g} within {one.tolerance:.3g}: {one.reason}"
            )
    for row, column in wanted:
        problems.append(f"{row}, {column}: expected by {FILE}, and not there")
    return problems, compared
