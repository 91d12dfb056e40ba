"""The list of an archive's files: `archive.json` for a deposit with a DOI, `SHA256SUMS` to check one."""

import re

from paper import files, listing
from protocol import InputError

FORMAT = "cloudparity-archive/1"
# What tools leave in folders, which belongs to no archive.
LEFT = ("__pycache__", ".pytest_cache", ".ruff_cache", ".ipynb_checkpoints", "target", "artifacts", "work")


def _below(path):
    if path.is_file():
        return [path]
    found = (each for each in path.rglob("*") if each.is_file())
    return [each for each in found if not set(each.relative_to(path).parts) & set(LEFT)]


def write(found, out):
    """Write both lists: the project's files that the list names, and what was rebuilt."""
    root = found.root
    rows = []
    for at, entry in enumerate(found.archive):
        path = root / entry.path
        if not path.exists():
            place = f"{listing.LIST}, archive[{at}].path"
            raise InputError(
                place, repr(entry.path), "a file or folder of the project", "correct it, or take it out"
            )
        rows += [(str(each.relative_to(root)), each, entry.what) for each in _below(path)]
    for folder, what in (("figures", "a figure, rebuilt"), ("tables", "a table, rebuilt")):
        if (out / folder).is_dir():
            rows += [(f"rebuilt/{folder}/{each.name}", each, what) for each in _below(out / folder)]
    documents, sums = [], []
    seen = {}
    for name, path, what in sorted(rows):
        # The first entry of the list that names a file says what it is.
        if name in seen:
            continue
        content = path.read_bytes()
        seen[name] = files.hashlib.sha256(content).hexdigest()
        documents.append({"file": name, "bytes": len(content), "sha256": seen[name], "what": what})
        sums.append(f"{seen[name]}  {name}\n")
    version = re.search(
        r'^version = "(.*)"$', (root / "Cargo.toml").read_text(encoding="utf-8"), re.MULTILINE
    )
    document = {
        "format": FORMAT,
        "title": "cloudparity",
        "version": version.group(1) if version else None,
        "citation": "CITATION.cff",
        "files": documents,
        "bytes": sum(row["bytes"] for row in documents),
    }
    files.write(out / "archive.json", files.json_text(document))
    files.write(out / "SHA256SUMS", "".join(sums))
