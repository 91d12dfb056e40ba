"""The paper on findings (docs/findings), which has a tool of its own: all of it again from its record, and compared."""

from paper import figures

RECORD = "findings"
FOLDER = "docs/findings"
TEXTS = ("README.md", "index.html", "findings.tex")


def compare(root, path, out):
    """What differs, by file: sentences, empty where the file is the record's."""
    import findings_paper  # Pandoc and templates: only who has this paper needs them

    folder = out / "findings"
    findings_paper.write(findings_paper.read(path), folder)
    found = {}
    for name in TEXTS:
        there = root / FOLDER / name
        same = there.is_file() and there.read_bytes() == (folder / name).read_bytes()
        found[f"{FOLDER}/{name}"] = "" if same else "not the text that the record gives"
    for drawn in sorted(folder.glob("*.png")):
        there = root / FOLDER / drawn.name
        if not there.is_file():
            found[f"{FOLDER}/{drawn.name}"] = "missing"
            continue
        compared = figures.compare(drawn, there)
        if compared is None:
            found[f"{FOLDER}/{drawn.name}"] = "of another size than the record gives"
            continue
        largest, beyond, _ = compared
        found[f"{FOLDER}/{drawn.name}"] = f"{beyond} pixels differ, by up to {largest}" if beyond else ""
    return found
