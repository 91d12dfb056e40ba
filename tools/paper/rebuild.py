"""`make paper`: every listed figure and table, rebuilt and compared, with a verdict each."""

import dataclasses
import shutil

from paper import archive, expected, figures, files, findings, listing, markdown, tables
from protocol import InputError

# Verdicts, in the order in which they are counted.
REBUILT, KEPT, TEXT, CHANGED = "rebuilt", "kept", "text", "CHANGED"


@dataclasses.dataclass
class Line:
    """A verdict on something, and what there is to say."""

    verdict: str
    what: str
    words: str

    def __str__(self):
        return f"{self.verdict:8} {self.what}: {self.words}"


class Documents:
    """The records' documents, each read once; one that is missing or not as listed is refused."""

    def __init__(self, found):
        self.listing = found
        self.refused = {}
        self.read = {}
        for record in found.records.values():
            path = found.root / record.file
            remedy = (
                f"restore it from version control, or make it again: `make paper-full RECORD={record.name}`"
            )
            if not path.is_file():
                self.refused[record.name] = f"the record is missing; {remedy}"
            elif record.file not in found.hashes["files"]:
                self.refused[record.name] = (
                    f"no hash in {listing.HASHES}; take it as it is: `make paper-accept`"
                )
            elif files.sha256(path) != found.hashes["files"][record.file]:
                self.refused[record.name] = (
                    f"the record is not the one of {listing.HASHES} (edited, or made anew and not accepted); "
                    f"{remedy}"
                )

    def of(self, entry):
        """The document of an entry, or of several by name."""
        documents = {name: self._read(self.listing.records[name]) for name in listing.names_of(entry)}
        return documents if len(documents) > 1 else next(iter(documents.values()))

    def refusal(self, entry):
        """Why an entry cannot be drawn."""
        return next((self.refused[name] for name in listing.names_of(entry) if name in self.refused), None)

    def _read(self, record):
        if record.name not in self.read:
            remedy = f"make it again: `make paper-full RECORD={record.name}`"
            self.read[record.name] = files.read_json(self.listing.root / record.file, "a record", remedy)
        return self.read[record.name]


def drawn_of(entry, found, document, root):
    """The table of an entry under the heading where it was found."""
    return tables.draw(entry.draw, document, tables.Place(root, found.heading, entry.keys))


def differences(entry, found, drawn):
    """Sentences on cells of a page that the record does not give."""
    if found.head != drawn.head:
        return [f"its head is {found.head}, the record gives {drawn.head}"]
    wanted = {expected.key_of(row, entry.keys): row for row in drawn.rows}
    problems, met = [], set()
    for row in found.filled(entry.keys):
        key = expected.key_of(row, entry.keys)
        if key in entry.without or not any(row[entry.keys :]):
            continue
        if key not in wanted:
            problems.append(f"row {key}: not in the record")
            continue
        met.add(key)
        if len(row) != len(found.head):
            problems.append(f"row {key}: {len(row)} cells, the head has {len(found.head)}")
            continue
        for column, there, cell in zip(found.head, row, wanted[key], strict=True):
            given = tables.text_of(cell)
            if given is not None and there != given:
                problems.append(f"row {key}, {column}: {there!r}, the record gives {given!r}")
    problems += [f"row {key}: in the record and not in the page" for key in wanted if key not in met]
    return problems


def is_partial(entry, drawn):
    """Whether a page's table has cells that the record does not hold: their hash is kept."""
    return bool(entry.without) or any(cell is None for row in drawn.rows for cell in row)


def run(root, out):
    """Rebuild into a folder; return the lines."""
    found = listing.read(root)
    pairs, problems = listing.matched(found)
    lines = [Line(CHANGED, problem.split(": ", 1)[0], problem.split(": ", 1)[1]) for problem in problems]
    documents = Documents(found)
    lines += [
        Line(CHANGED, found.records[name].file, reason + "; nothing is drawn from it")
        for name, reason in documents.refused.items()
    ]
    if findings.RECORD in found.records and findings.RECORD not in documents.refused:
        compared = findings.compare(root, root / found.records[findings.RECORD].file, out)
        lines += [
            Line(CHANGED if words else REBUILT, name, words or f"as {findings.RECORD} gives it")
            for name, words in compared.items()
        ]
    wanted = expected.read(root)
    for folder in ("tables", "figures"):
        shutil.rmtree(out / folder, ignore_errors=True)
    lines += _figures(found, documents, wanted, out)
    lines += _tables(found, documents, wanted, pairs, out)
    names = {table.name for table in found.tables if table.record}
    names |= {figure.file for figure in found.figures if figure.record}
    for name in sorted({one.item for one in wanted} - names):
        lines.append(Line(CHANGED, expected.FILE, f"expects {name}, which the list does not have"))
    archive.write(found, out)
    return lines


def _figures(found, documents, wanted, out):
    lines = []
    for figure in found.figures:
        path = found.root / figure.file
        if not path.is_file():
            continue
        if not figure.record:
            lines.append(
                _kept(found.hashes["files"].get(figure.file), files.sha256(path), figure.file, figure.reason)
            )
            continue
        if documents.refusal(figure):
            continue
        target = out / "figures" / path.stem
        target.parent.mkdir(parents=True, exist_ok=True)
        made = figures.DRAWERS[figure.draw](documents.of(figure), target)
        limits = [one for one in wanted if one.item == figure.file]
        if not limits:
            words = (
                f"rebuilt, and {expected.FILE} expects nothing of it; take it as it is: `make paper-accept`"
            )
            lines.append(Line(CHANGED, figure.file, words))
            continue
        result = figures.compare(path, made, limits[0].value + limits[0].tolerance)
        if result is None:
            words = f"another size than what the record gives ({made})"
            lines.append(Line(CHANGED, figure.file, words))
            continue
        largest, count, where = result
        if where is not None:
            words = (
                f"{count} pixels differ from the record's, by up to {largest} of 255, the first at {where}"
            )
            lines.append(Line(CHANGED, figure.file, f"{words}; compare {made}"))
        else:
            lines.append(Line(REBUILT, figure.file, f"from {figure.record}, pixels within {largest} of 255"))
    return lines


def _kept(before, now, what, reason):
    if before is None:
        return Line(CHANGED, what, f"no hash in {listing.HASHES}; take it as it is: `make paper-accept`")
    if before != now:
        remedy = "restore it, or take it as it is: `make paper-accept`"
        words = f"not what was accepted; {remedy}. Not rebuilt: {reason}"
        return Line(CHANGED, what, words)
    return Line(KEPT, what, f"as accepted; not rebuilt: {reason}")


def _tables(found, documents, wanted, pairs, out):
    lines, texts, counts, seen = [], {}, {}, {}
    for entry, table in pairs:
        if not entry.record:
            what = f"{entry.page}, {table.heading}, {table.head[0] or table.head[1]} ..."
            if entry.kind == "text":
                if entry.heading != "*":
                    lines.append(Line(TEXT, what, entry.reason))
                else:
                    counts.setdefault(entry.place(), [0, entry.reason])[0] += 1
            else:
                before = found.hashes["tables"].get(listing.table_key(entry, table))
                lines.append(_kept(before, listing.table_hash(table), what, entry.reason))
            continue
        if documents.refusal(entry):
            continue
        drawn = drawn_of(entry, table, documents.of(entry), found.root)
        texts.setdefault(entry.name, []).append(
            f"## {table.heading}\n\n{markdown.text(drawn.head, drawn.texts())}"
        )
        seen.setdefault(entry.name, (entry, []))[1].append((table, drawn))
    for place, (count, reason) in counts.items():
        lines.append(Line(TEXT, place, f"{count} tables; {reason}"))
    for name, (entry, group) in seen.items():
        merged = tables.Drawn(group[0][1].head, [row for _, drawn in group for row in drawn.rows])
        problems = [
            f"{table.heading}, {problem}" if entry.heading == "*" else problem
            for table, drawn in group
            for problem in differences(entry, table, drawn)
        ]
        for table, drawn in group:
            kept = found.hashes["tables"].get(listing.table_key(entry, table))
            if not problems and is_partial(entry, drawn) and kept != listing.table_hash(table):
                remedy = "restore it, or take it as it is: `make paper-accept`"
                problems.append(f"a cell that no record holds is not what was accepted; {remedy}")
        unexpected, compared = expected.compare(name, merged, entry.keys, wanted)
        what = f"{entry.page}, {'' if entry.heading == '*' else entry.heading + ', '}table {name}"
        lines += [Line(CHANGED, what, problem) for problem in [*problems, *unexpected]]
        if not problems and not unexpected:
            rows = f"{len(merged.rows)} rows equal"
            words = f"from {entry.record}, {rows}, {compared} values within their tolerances"
            lines.append(Line(REBUILT, what, words))
            for key, reason in entry.without.items():
                lines.append(Line(KEPT, what, f"row {key} is not rebuilt: {reason}"))
        files.write(out / "tables" / f"{name}.md", "\n".join(texts[name]))
    return lines


def accept(root, names=()):
    """Take records, figures and tables as they are: hashes, expected values, and what pages show of records.

    With names, the pages are changed for these records alone. Returns what was written.
    """
    found = listing.read(root)
    for name in names:
        if name not in found.records:
            raise InputError("the record", repr(name), f"one of {', '.join(found.records)}", "name one")
    changed = []
    hashes = {"files": {}, "tables": {}}
    for record in found.records.values():
        path = root / record.file
        if not path.is_file():
            raise InputError(
                record.file, "no file", "the record", f"make it: `make paper-full RECORD={record.name}`"
            )
        hashes["files"][record.file] = files.sha256(path)
    found.hashes = hashes
    documents = Documents(found)
    pairs, problems = listing.matched(found)
    if problems:
        place, words = problems[0].split(": ", 1)
        raise InputError(
            place, words.split(";")[0], "a list that fits the documents", words.split(";")[-1].strip()
        )
    values = []
    for figure in found.figures:
        path = root / figure.file
        if figure.record:
            if not names or set(names) & set(listing.names_of(figure)):
                made = root / "out/paper/figures" / path.stem
                made.parent.mkdir(parents=True, exist_ok=True)
                drawn = figures.DRAWERS[figure.draw](documents.of(figure), made)
                result = figures.compare(path, drawn)
                if result is None or result[2] is not None:
                    files.write(path, (root / drawn).read_bytes())
                    changed.append(figure.file)
            values.append(
                expected.Expected(figure.file, "", figures.COLUMN, 0, figures.TOLERANCE, figures.REASON)
            )
        else:
            hashes["files"][figure.file] = files.sha256(path)
    # From the last table of a page to the first, so that the lines of the others stay.
    for entry, table in sorted(pairs, key=lambda pair: (pair[0].page, -pair[1].line)):
        if not entry.record:
            if entry.kind == "measured":
                hashes["tables"][listing.table_key(entry, table)] = listing.table_hash(table)
            continue
        drawn = drawn_of(entry, table, documents.of(entry), root)
        values += expected.of_table(entry.name, drawn, entry.keys)
        chosen = not names or set(names) & set(listing.names_of(entry))
        if chosen and differences(entry, table, drawn):
            page = root / entry.page
            rows = _renewed(entry, table, drawn)
            files.write(page, markdown.replaced(page.read_text(encoding="utf-8"), table, rows))
            changed.append(f"{entry.page}, {table.heading}")
            table.rows = rows
        if is_partial(entry, drawn):
            hashes["tables"][listing.table_key(entry, table)] = listing.table_hash(table)
    order = {
        name: at for at, name in enumerate([f.file for f in found.figures] + [t.name for t in found.tables])
    }
    values.sort(key=lambda one: order[one.item])
    hashes = {key: dict(sorted(found_hashes.items())) for key, found_hashes in hashes.items()}
    for name, text in ((expected.FILE, expected.text(values)), (listing.HASHES, files.json_text(hashes))):
        path = root / name
        if not path.is_file() or path.read_text(encoding="utf-8") != text:
            files.write(path, text)
            changed.append(name)
    return changed


def _renewed(entry, table, drawn):
    """The rows of a page's table with the record's cells; of other rows, those stay that the list names."""
    wanted = {expected.key_of(row, entry.keys): row for row in drawn.rows}
    rows = []
    for shown, full in zip(table.rows, table.filled(entry.keys), strict=True):
        key = expected.key_of(full, entry.keys)
        if key in wanted:
            cells = wanted.pop(key)
            renewed = [
                there if at < entry.keys or tables.text_of(cell) is None else tables.text_of(cell)
                for at, (there, cell) in enumerate(zip(shown, cells, strict=True))
            ]
            rows.append(renewed)
        elif key in entry.without or not any(full[entry.keys :]):
            rows.append(shown)
    return rows + [[tables.text_of(cell) or "" for cell in row] for row in wanted.values()]
