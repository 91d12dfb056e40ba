"""Tables of Markdown: found in a page, written, and changed in place."""

import dataclasses
import re

RULE = re.compile(r"^\s*\|[\s:|-]*-[\s:|-]*$")
# A bar that a backslash stands before belongs to its cell.
BAR = re.compile(r"(?<!\\)\|")


@dataclasses.dataclass
class Found:
    """A table of a page: the heading that it stands under, its cells, and the line of its head, from 1."""

    heading: str
    head: list
    rows: list
    line: int

    def filled(self, keys):
        """The rows; an empty cell among the first `keys` is that of the row before."""
        rows = []
        for row in self.rows:
            row = list(row)
            for column in range(min(keys - 1, len(row))):
                if not row[column] and rows and all(row[at] == rows[-1][at] for at in range(column)):
                    row[column] = rows[-1][column]
            rows.append(row)
        return rows


def cells(line):
    """The cells of a row."""
    inner = line.strip()
    inner = inner[1:] if inner.startswith("|") else inner
    inner = inner[:-1] if inner.endswith("|") and not inner.endswith("\\|") else inner
    return [cell.strip() for cell in BAR.split(inner)]


def tables(text):
    """The tables of a page, those in code left out."""
    lines = text.split("\n")
    found, heading, fenced, at = [], "", False, 0
    while at < len(lines):
        line = lines[at]
        if line.startswith("```"):
            fenced = not fenced
        elif not fenced and re.match(r"#+ ", line):
            heading = line.lstrip("#").strip()
        elif not fenced and line.startswith("|") and at + 1 < len(lines) and RULE.match(lines[at + 1]):
            table = Found(heading, cells(line), [], at + 1)
            at += 2
            while at < len(lines) and lines[at].startswith("|"):
                table.rows.append(cells(lines[at]))
                at += 1
            found.append(table)
            continue
        at += 1
    return found


def row(row_cells):
    """A row as text."""
    return "| " + " | ".join(row_cells) + " |"


def text(head, rows):
    """A table as text."""
    return "\n".join([row(head), row(["---"] * len(head)), *map(row, rows)]) + "\n"


def replaced(page, found, rows):
    """The page with other rows in a table."""
    lines = page.split("\n")
    begin = found.line + 1
    lines[begin : begin + len(found.rows)] = [row(cells_of_row) for cells_of_row in rows]
    return "\n".join(lines)
