"""The paper on findings says what its record says, and refuses what is none."""

import json
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
RECORD = ROOT / "parity/records/findings.json"
PAPER = ROOT / "docs/findings"


def paper(record, folder):
    """Run the tool."""
    command = [sys.executable, ROOT / "tools/findings_paper.py", record, folder]
    return subprocess.run(command, capture_output=True, text=True, check=False, timeout=300)


def test_the_committed_paper_is_that_of_the_committed_record(tmp_path):
    done = paper(RECORD, tmp_path)
    assert done.returncode == 0, done.stderr
    for name in ("README.md", "findings.tex", "index.html"):
        # Pictures stand beside the text; only the text is compared, letter by letter.
        assert (tmp_path / name).read_text() == (PAPER / name).read_text(), name
    record = json.loads(RECORD.read_text())
    for finding in record["findings"]:
        if finding["name"] != "scenes":
            assert (tmp_path / f"{finding['name']}.pdf").stat().st_size > 1000


def test_a_changed_figure_changes_the_paper(tmp_path):
    record = json.loads(RECORD.read_text())
    cells = record["findings"][-1]["cells"][0]
    assert cells[1] in (PAPER / "README.md").read_text()
    cells[1] = "0.123456(7)"
    changed = tmp_path / "findings.json"
    changed.write_text(json.dumps(record))
    done = paper(changed, tmp_path / "out")
    assert done.returncode == 0, done.stderr
    assert "0.123456(7)" in (tmp_path / "out/README.md").read_text()
    assert (tmp_path / "out/README.md").read_text() != (PAPER / "README.md").read_text()


@pytest.mark.parametrize(
    ("content", "place"),
    [
        (None, "No such file"),
        ("{", "findings.json"),
        ("[]", "format"),
        ('{"format": "cloudparity-findings/0", "findings": []}', "cloudparity-findings/1"),
        ('{"format": "cloudparity-findings/1", "findings": []}', "at least one finding"),
    ],
)
def test_what_is_no_record_is_refused(tmp_path, content, place):
    path = tmp_path / "findings.json"
    if content is not None:
        path.write_text(content)
    done = paper(path, tmp_path / "out")
    assert done.returncode == 2
    assert place in done.stderr and "cloudparity measure findings" in done.stderr
    assert "Traceback" not in done.stderr
