"""The paper on findings (docs/findings), which has a tool of its own: all of it from its record, compared."""

import subprocess
import sys

from paper import figures
from protocol import InputError

RECORD = "findings"
FOLDER = "docs/findings"
TEXTS = ("README.md", "index.html", "findings.tex")


def compare(root, path, out):
    """What differs, by file: sentences, empty where the file is the record's."""
    folder = out / "findings"
    # A process of its own: what matplotlib drew before would move its letters.
    command = [sys.executable, root / "tools/findings_paper.py", path, folder]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    if done.returncode:
        last = (done.stderr.strip().splitlines() or ["no answer"])[-1]
        raise InputError(
            str(path), last, "a record that the paper can be made of", "run `make findings-paper`"
        )
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
