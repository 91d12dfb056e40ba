"""`parity/paper.toml`: every figure and table of the documents, the records, and what goes into the archive.

A figure or table names the record that it is drawn from and the function that draws it, or the reason why
it is not rebuilt. The hashes that show a later change stand in `parity/paper.sha256.json`, which `accept`
writes.
"""

import dataclasses
import hashlib
import pathlib
import tomllib

from paper import figures, files, markdown, tables
from protocol import InputError

FORMAT = "cloudparity-paper/1"
LIST = "parity/paper.toml"
HASHES = "parity/paper.sha256.json"
RECORDS = "parity/records"
# A paper of its own, which is rebuilt whole (findings.py).
APART = "docs/findings/"
PICTURES = (".png", ".jpg", ".jpeg", ".svg", ".gif", ".webp")
# What a table without a record is: its hash is kept where it was measured.
KINDS = ("measured", "text")


@dataclasses.dataclass
class Record:
    """A committed record, and the commands that make it again."""

    name: str
    file: str
    what: str
    commands: list
    makes: list
    takes: str
    statuses: list = dataclasses.field(default_factory=lambda: [0])


@dataclasses.dataclass
class Figure:
    """A picture of the documents; the caption is the one by which a page shows it."""

    file: str
    caption: str
    record: str = ""
    draw: str = ""
    reason: str = ""


@dataclasses.dataclass
class Table:
    """A table of a page; with the heading `*`, every table of the page with this head."""

    page: str
    heading: str
    head: str
    name: str = ""
    record: str = ""
    draw: str = ""
    reason: str = ""
    kind: str = ""
    keys: int = 1
    without: dict = dataclasses.field(default_factory=dict)

    def place(self):
        """What it is called in messages."""
        heading = "every heading" if self.heading == "*" else self.heading
        return f"{self.page}, {heading}, table of {self.head}"

    def fits(self, found):
        """Whether a table of the page is this one."""
        head = " | ".join(found.head)
        return self.heading in ("*", found.heading) and (
            head == self.head or head.startswith(self.head + " |")
        )


@dataclasses.dataclass
class Archived:
    """A file or folder of the archive."""

    path: str
    what: str


@dataclasses.dataclass
class Listing:
    """All of it."""

    root: pathlib.Path
    records: dict
    figures: list
    tables: list
    archive: list
    hashes: dict


def _entry(cls, found, place):
    fields = {field.name: field for field in dataclasses.fields(cls)}
    if not isinstance(found, dict):
        raise InputError(place, repr(found), "a table of TOML", "write it as the others of the list")
    for key, value in found.items():
        if key not in fields:
            raise InputError(
                f"{place}.{key}", "an unknown key", f"one of {', '.join(fields)}", "correct the key"
            )
        wanted = fields[key].type
        if type(value) is not wanted:
            raise InputError(
                f"{place}.{key}", repr(value), f"a value of the type {wanted.__name__}", "correct it"
            )
    missing = [
        name
        for name, field in fields.items()
        if name not in found
        and field.default is dataclasses.MISSING
        and field.default_factory is dataclasses.MISSING
    ]
    if missing:
        raise InputError(place, f"no {missing[0]}", f"the key {missing[0]}", "add it")
    return cls(**found)


def names_of(entry):
    """The records of an entry: `one`, or `one + another`, whose documents the function gets by name."""
    return [name.strip() for name in entry.record.split("+")] if entry.record else []


def _judged(entry, place, records, drawers):
    """An entry that is drawn has a record and a function; any other has a reason."""
    if entry.record:
        for name in names_of(entry):
            if name not in records:
                listed = ", ".join(records)
                raise InputError(f"{place}.record", repr(name), f"one of {listed}", "name a listed record")
        if entry.draw not in drawers:
            raise InputError(
                f"{place}.draw",
                repr(entry.draw),
                f"one of {', '.join(drawers)}",
                "name a function that draws",
            )
        if entry.reason:
            raise InputError(f"{place}.reason", "a reason beside a record", "one of them", "take one away")
    elif not entry.reason:
        raise InputError(
            place, "neither record nor reason", "one of them", "say why it is not rebuilt, plainly"
        )


def read(root):
    """The list of a project folder."""
    path = root / LIST
    text = files.read_text(path, "the list of figures and tables", "restore it from version control")
    try:
        document = tomllib.loads(text)
    except tomllib.TOMLDecodeError as error:
        raise InputError(str(path), str(error), "a file in TOML", "correct the place") from None
    sections = {"record": Record, "figure": Figure, "table": Table, "archive": Archived}
    if document.get("format") != FORMAT:
        raise InputError(LIST, f"format {document.get('format')!r}", repr(FORMAT), "use this build's list")
    for key in document:
        if key != "format" and key not in sections:
            raise InputError(
                f"{LIST}, {key}", "an unknown section", f"one of {', '.join(sections)}", "correct it"
            )
    entries = {}
    for key, cls in sections.items():
        found = document.get(key, [])
        entries[key] = [_entry(cls, entry, f"{LIST}, {key}[{at}]") for at, entry in enumerate(found)]
    records = {}
    for record in entries["record"]:
        if record.name in records:
            raise InputError(f"{LIST}, record {record.name}", "listed twice", "one of it", "take one away")
        records[record.name] = record
    for at, figure in enumerate(entries["figure"]):
        _judged(figure, f"{LIST}, figure[{at}]", records, figures.DRAWERS)
    names = set()
    for at, table in enumerate(entries["table"]):
        place = f"{LIST}, table[{at}]"
        _judged(table, place, records, tables.DRAWERS)
        if table.record and (not table.name or table.name in names):
            raise InputError(f"{place}.name", repr(table.name), "a name of its own", "give it one")
        if not table.record and table.kind not in KINDS:
            raise InputError(f"{place}.kind", repr(table.kind), f"one of {', '.join(KINDS)}", "name one")
        names.add(table.name)
    return Listing(
        root, records, entries["figure"], entries["table"], entries["archive"], _hashes(root / HASHES)
    )


def _hashes(path):
    if not path.exists():
        return {"files": {}, "tables": {}}
    document = files.read_json(path, "the hashes of the list", "restore it, or run `make paper-accept`")
    for key in ("files", "tables"):
        if not isinstance(document.get(key), dict):
            raise InputError(
                f"{path}, {key}", repr(document.get(key)), "an object of hashes", "run `make paper-accept`"
            )
    return document


def pages(root):
    """The pages whose figures and tables are listed."""
    found = (str(path.relative_to(root)) for path in (root / "docs").rglob("*.md"))
    return ["README.md", *sorted(name for name in found if not name.startswith(APART))]


def pictures(root):
    """The pictures of the documents."""
    found = (path for path in (root / "docs").rglob("*") if path.suffix.lower() in PICTURES)
    names = (str(path.relative_to(root)) for path in found)
    return sorted(name for name in names if not name.startswith(APART))


def matched(listing):
    """Each table of each page with its entry; and what is not listed, or listed and not there."""
    pairs, problems, met = [], [], set()
    for page in pages(listing.root):
        text = files.read_text(listing.root / page, "a page", "restore it from version control")
        for found in markdown.tables(text):
            entries = [entry for entry in listing.tables if entry.page == page and entry.fits(found)]
            exact = [entry for entry in entries if entry.heading != "*"] or entries
            place = f"{page}, line {found.line}, {found.heading}, table of {' | '.join(found.head)[:60]}"
            if len(exact) == 1:
                pairs.append((exact[0], found))
                met.add(id(exact[0]))
            elif exact:
                problems.append(f"{place}: listed {len(exact)} times in {LIST}; leave one entry")
            else:
                problems.append(f"{place}: not listed; add it to {LIST} with its record or the reason")
    for entry in listing.tables:
        if id(entry) not in met:
            problems.append(
                f"{entry.place()}: listed in {LIST} and not in the page; take it out, or restore it"
            )
    listed = [figure.file for figure in listing.figures]
    there = pictures(listing.root)
    for name in there:
        if listed.count(name) != 1:
            problems.append(f"{name}: listed {listed.count(name)} times in {LIST}; it has to be there once")
    for name in listed:
        if name not in there:
            problems.append(f"{name}: listed in {LIST}, and there is no such picture; restore it")
    return pairs, problems


def table_key(entry, found):
    """The name of a table among the hashes."""
    return f"{entry.page} | {found.heading} | {' | '.join(found.head)}"


def table_hash(found):
    """The hash of a table's cells."""
    return hashlib.sha256(
        "\n".join(" | ".join(row) for row in [found.head, *found.rows]).encode()
    ).hexdigest()
