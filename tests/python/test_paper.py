"""`make paper`: the committed list rebuilds; a changed digit, pixel, record or page is reported by name.

A small project, made here, has one of each: a table and a figure that are drawn from records, a table and
a figure that are kept.
"""

import json
import pathlib
import shutil
import subprocess
import sys

import numpy as np
import OpenImageIO as oiio
import pytest

from blend_support import ROOT

pytest.importorskip("matplotlib")

from paper import __main__ as command
from paper import expected, figures, files, listing, markdown, rebuild, tables
from test_convergence_plot import document as convergence_document

LIST = """format = "cloudparity-paper/1"

[[record]]
name = "meshes"
file = "parity/records/meshes.json"
what = "scenes"
commands = ["fake-parity {out}"]
makes = ["parity.json"]
takes = "no time"

[[record]]
name = "steps"
file = "parity/records/steps.json"
what = "steps"
commands = ["fake-steps {out}"]
makes = ["convergence.json"]
takes = "no time"

[[figure]]
file = "docs/images/steps.png"
caption = "Steps"
record = "steps"
draw = "convergence"

[[figure]]
file = "docs/images/window.png"
caption = "The window"
reason = "by hand"

[[table]]
page = "docs/page.md"
heading = "Scenes"
head = "scene"
name = "scenes"
record = "meshes"
draw = "suite"
without = { "heavy" = "hours" }

[[table]]
page = "docs/page.md"
heading = "Times"
head = "what | time"
kind = "measured"
reason = "by hand"

[[table]]
page = "docs/page.md"
heading = "Words"
head = "word"
kind = "text"
reason = "a description"

[[archive]]
path = "docs"
what = "the documents"
"""

PAGE = """# Page

## Scenes

| scene | checks that agree | bias of the mean |
| --- | --- | --- |
| sphere | ? | ? |
| heavy | 13 of 13 | +0.010 % |

![Steps](images/steps.png)

## Times

| what | time |
| --- | --- |
| a | 1.5 s |

![The window](images/window.png)

## Words

| word | meaning |
| --- | --- |
| a | b |

```text
| in code | no table |
| --- | --- |
```
"""


def scene(name, relative):
    bias = [
        {
            "channel": channel,
            "relative": relative * factor,
            "interval": [relative - 1e-3, relative + 1e-3],
            "standard_error": 3e-4,
        }
        for channel, factor in (("R", 1.0), ("G", 0.5), ("B", 0.2))
    ]
    return {"name": name, "checks": [13, 13], "bias": bias, "replicas": 8, "samples": 256}


def picture(path, value=0.5):
    made = oiio.ImageBuf(oiio.ImageSpec(8, 4, 3, oiio.UINT8))
    made.set_pixels(oiio.ROI(0, 8, 0, 4, 0, 1, 0, 3), np.full((4, 8, 3), value, np.float32))
    assert made.write(str(path))


@pytest.fixture(scope="module")
def accepted(tmp_path_factory):
    """The small project, accepted."""
    tmp_path = tmp_path_factory.mktemp("small")
    files.write(tmp_path / "Cargo.toml", '[package]\nversion = "1.2.3"\n')
    files.write(tmp_path / "README.md", "# Small\n")
    files.write(tmp_path / listing.LIST, LIST)
    files.write(tmp_path / "docs/page.md", PAGE)
    files.write(tmp_path / "parity/records/meshes.json", json.dumps([scene("mesh-sphere", 4.2e-4)]))
    steps = {**convergence_document(), "caches": []}
    files.write(tmp_path / "parity/records/steps.json", json.dumps(steps))
    (tmp_path / "docs/images").mkdir()
    picture(tmp_path / "docs/images/window.png")
    picture(tmp_path / "docs/images/steps.png")
    assert command.main(["--root", str(tmp_path), "accept"]) == 0
    return tmp_path


@pytest.fixture
def project(accepted, tmp_path):
    """A copy of it, to be changed."""
    return pathlib.Path(shutil.copytree(accepted, tmp_path / "project"))


def run(project, *arguments):
    return command.main(["--root", str(project), *arguments])


def changed(project):
    return [
        str(line) for line in rebuild.run(project, project / "out/paper") if line.verdict == rebuild.CHANGED
    ]


def edit(project, name, before, after):
    path = project / name
    text = path.read_text(encoding="utf-8")
    assert text.count(before) == 1, f"{before!r} stands once in {name}"
    path.write_text(text.replace(before, after), encoding="utf-8")


def test_the_committed_list_rebuilds_every_figure_and_table(tmp_path, capsys):
    """A fresh clone: nothing but what is committed is read, and nothing is written beside the output."""
    assert command.main(["rebuild", "-o", str(tmp_path)]) == 0, capsys.readouterr().out
    told = capsys.readouterr().out
    assert "0 changed" in told and "rebuilt  docs/nodes.md" in told
    kept = [line for line in told.splitlines() if line.startswith("kept ")]
    assert kept and all("not rebuilt: " in line for line in kept), "what is not rebuilt has a reason"
    document = json.loads((tmp_path / "archive.json").read_text(encoding="utf-8"))
    named = {row["file"]: row for row in document["files"]}
    assert "rebuilt/tables/nodes.md" in named and "src/main.rs" in named and "CITATION.cff" in named
    assert named["README.md"]["sha256"] == files.sha256(ROOT / "README.md")
    assert document["bytes"] == sum(row["bytes"] for row in document["files"])
    assert not any("/target/" in name or "__pycache__" in name for name in named)


def test_records_are_small():
    found = listing.read(ROOT)
    assert sum((ROOT / record.file).stat().st_size for record in found.records.values()) <= 4 << 20


def test_acceptance_writes_page_and_figure_from_the_records(project):
    page = (project / "docs/page.md").read_text(encoding="utf-8")
    assert "| sphere | 13 of 13 | +0.042 % (red: -0.058 to +0.142 %) |" in page
    assert "| heavy | 13 of 13 | +0.010 % |" in page and "| a | 1.5 s |" in page
    assert figures.pixels(project / "docs/images/steps.png").shape[1] > 1000, "drawn, no longer 8 pixels wide"
    assert changed(project) == []
    assert run(project) == 0
    sums = (project / "out/paper/SHA256SUMS").read_text(encoding="utf-8")
    assert f"{files.sha256(project / 'docs/page.md')}  docs/page.md\n" in sums


@pytest.mark.parametrize(
    ("before", "after", "words"),
    [
        ("+0.042 %", "+0.043 %", ["docs/page.md, Scenes", "row sphere", "bias of the mean", "'+0.042 %"]),
        ("| sphere | 13", "| sphere | 12", ["row sphere", "checks that agree"]),
        ("| sphere |", "| ball |", ["row ball: not in the record"]),
        ("| heavy |", "| light |", ["row light: not in the record"]),
        ("+0.010 %", "+0.011 %", ["docs/page.md, Scenes", "a cell that no record holds"]),
        ("1.5 s", "1.6 s", ["docs/page.md, Times", "not what was accepted"]),
        ("| a | 1.5 s |", "| a | 1.5 s |\n\n| new | table |\n| --- | --- |", ["new | table", "not listed"]),
        ("| what | time |", "| what | hours |", ["what | hours: not listed", "what | time: listed in"]),
    ],
)
def test_a_changed_cell_is_named(project, capsys, before, after, words):
    edit(project, "docs/page.md", before, after)
    told = "\n".join(changed(project))
    assert all(word in told for word in words), told
    assert run(project) == 1
    assert "CHANGED" in capsys.readouterr().out


def test_a_changed_word_of_a_description_is_no_change(project):
    edit(project, "docs/page.md", "| a | b |", "| a | c |")
    assert changed(project) == []


def test_a_changed_pixel_is_named_with_its_place(project):
    path = project / "docs/images/steps.png"
    whole = oiio.ImageBuf(str(path))
    pixel = [value - 3.5 / 255 if value > 0.5 else value + 3.5 / 255 for value in whole.getpixel(20, 10)]
    whole.setpixel(20, 10, pixel)
    assert whole.write(str(path))
    told = changed(project)
    assert len(told) == 1 and "docs/images/steps.png: 1 pixels differ" in told[0] and "(20, 10)" in told[0], (
        told
    )


def test_a_rounding_of_the_rasteriser_is_no_change(project):
    path = project / "docs/images/steps.png"
    whole = oiio.ImageBuf(str(path))
    whole.setpixel(20, 10, [value - 1 / 255 for value in whole.getpixel(20, 10)])
    assert whole.write(str(path))
    assert changed(project) == []


def test_another_picture_by_hand_and_another_size_are_named(project):
    picture(project / "docs/images/window.png", 0.6)
    picture(project / "docs/images/steps.png")
    picture(project / "docs/images/new.png")
    told = "\n".join(changed(project))
    assert "docs/images/window.png: not what was accepted" in told
    assert "docs/images/steps.png: another size" in told
    assert "docs/images/new.png: listed 0 times" in told


def test_a_record_edited_by_hand_is_refused_and_nothing_drawn_from_it(project):
    edit(project, "parity/records/meshes.json", '"checks": [13, 13]', '"checks": [12, 13]')
    told = changed(project)
    assert len(told) == 1 and told[0].startswith("CHANGED  parity/records/meshes.json: the record is not"), (
        told
    )
    assert "make paper-full RECORD=meshes" in told[0]
    assert not (project / "out/paper/tables/scenes.md").exists()


def test_a_missing_record_is_named_with_what_makes_it(project, capsys):
    (project / "parity/records/steps.json").unlink()
    told = changed(project)
    assert len(told) == 1 and "parity/records/steps.json: the record is missing" in told[0], told
    assert run(project, "accept") == 2
    assert "make paper-full RECORD=steps" in capsys.readouterr().err


def test_a_record_without_its_fields_is_an_error_with_place_and_remedy(project, capsys):
    files.write(project / "parity/records/meshes.json", "[{}]")
    assert run(project, "accept") == 2
    told = capsys.readouterr().err
    assert (
        "drawn as suite" in told
        and "KeyError" in told
        and "make paper-full" in told
        and "Traceback" not in told
    )


def test_a_value_beyond_its_tolerance_is_named_with_the_reason(project):
    """Four standard errors of a difference of two measurements are 4 sqrt(2) 0.03 % = 0.17 %."""
    for relative, is_there in ((4.2e-4 + 1.6e-3, False), (4.2e-4 + 1.8e-3, True)):
        files.write(project / "parity/records/meshes.json", json.dumps([scene("mesh-sphere", relative)]))
        entry = next(table for table in listing.read(project).tables if table.name == "scenes")
        place = tables.Place(project, "Scenes", 1)
        document = json.loads((project / "parity/records/meshes.json").read_text())
        drawn = tables.draw(entry.draw, document, place)
        problems, compared = expected.compare("scenes", drawn, 1, expected.read(project))
        assert compared == 2
        assert ("4 standard errors" in " ".join(problems)) == is_there, (relative, problems)


@pytest.mark.parametrize(
    ("before", "after", "place"),
    [
        ('format = "cloudparity-paper/1"', 'format = "cloudparity-paper/9"', "format"),
        ('record = "meshes"', 'record = "nothing"', "table[0].record"),
        ('draw = "suite"', 'draw = "nothing"', "table[0].draw"),
        ('kind = "text"', 'kind = "other"', "table[2].kind"),
        ('takes = "no time"\n\n[[figure]]', "takes = 3\n\n[[figure]]", "record[1].takes"),
        ('what = "steps"\n', "", "record[1]"),
        ('caption = "Steps"', 'captain = "Steps"', "figure[0].captain"),
        ('record = "steps"\n', "", "figure[0]"),
        ("[[archive]]", "[[archives]]", "archives"),
        ('path = "docs"', 'path = "nowhere"', "archive[0].path"),
        ("[[archive]]", "[[archive]", "paper.toml"),
    ],
)
def test_a_faulty_list_is_an_error_with_its_place(project, capsys, before, after, place):
    edit(project, listing.LIST, before, after)
    assert run(project) == 2
    told = capsys.readouterr().err
    assert place in told and "found: " in told and "expected: " in told, told


def test_a_faulty_file_of_expected_values_is_an_error_with_its_line(project, capsys):
    path = project / expected.FILE
    text = path.read_text(encoding="utf-8")
    for broken, place in (
        (text.replace(",1,", ",one,"), "line"),
        ("item\n", "line 1"),
        (text + "a,b\n", "line 5"),
    ):
        assert broken != text
        files.write(path, broken)
        assert run(project) == 2
        assert place in capsys.readouterr().err
    path.unlink()
    assert run(project) == 2


def fake(project, name, source):
    path = project / "bin" / name
    files.write(path, f"#!/bin/sh\n{source}\n")
    path.chmod(0o755)


def test_records_are_made_once_by_a_build_and_compared_with_what_is_expected(project, capsys):
    fake(project, "cloudparity", """echo '{"build": "1.2.3+0123456789abcdef"}'""")
    fake(project, "fake-parity", f'echo run >> {project}/runs; cp {project}/next.json "$1/parity.json"')
    full = ["full", "--program", str(project / "bin/cloudparity"), "--record", "meshes"]
    files.write(project / "next.json", json.dumps([scene("mesh-sphere", 5.0e-4)]))
    assert run(project, *full) == 0
    assert "agrees   scenes: 2 values" in capsys.readouterr().out
    assert run(project, *full) == 0
    assert "there    meshes: made by this build before" in capsys.readouterr().out
    assert (project / "runs").read_text() == "run\n"
    # Another build makes it again, and what it makes is far off.
    fake(project, "cloudparity", """echo '{"build": "1.2.3+fedcba9876543210"}'""")
    files.write(project / "next.json", json.dumps([scene("mesh-sphere", 1.0e-2)]))
    assert run(project, *full) == 1
    assert "DIFFERS  scenes: sphere, bias of the mean: 1, expected 0.042" in capsys.readouterr().out
    assert (project / "runs").read_text() == "run\nrun\n"
    assert "0.00042" in (project / "parity/records/meshes.json").read_text(), "the committed record stays"
    assert run(project, *full, "--take") == 0
    assert "+1.000 %" in (project / "docs/page.md").read_text(encoding="utf-8")
    assert changed(project) == []


def test_a_command_that_fails_is_named_and_others_go_on(project, capsys):
    fake(project, "cloudparity", """echo '{"build": "1.2.3+0123456789abcdef"}'""")
    fake(project, "fake-parity", "exit 3")
    fake(project, "fake-steps", f'cp {project}/parity/records/steps.json "$1/convergence.json"')
    assert run(project, "full", "--program", str(project / "bin/cloudparity")) == 1
    told = capsys.readouterr().out
    assert "FAILED   meshes: exit status 3" in told and "making   steps" in told
    assert run(project, "full", "--program", str(project / "bin/nothing")) == 2
    assert run(project, "full", "--program", str(project / "bin/cloudparity"), "--record", "x") == 2


def test_tables_are_read_as_github_shows_them():
    table = "| a \\| b | c |\n|--:|---|\n| 1 | 2 |\n|  | 3 |\n"
    page = f"# A\n\n{table}\ntext | with bars |\n\n```\n# no heading\n| x |\n| - |\n```\n"
    (found,) = markdown.tables(page)
    assert (found.heading, found.head, found.rows, found.line) == (
        "A",
        ["a \\| b", "c"],
        [["1", "2"], ["", "3"]],
        3,
    )
    assert found.filled(2) == [["1", "2"], ["1", "3"]]
    assert markdown.replaced(page, found, [["9", "8"]]).count("| 9 | 8 |\n\ntext") == 1


@pytest.mark.parametrize(
    ("value", "texts"),
    [
        (0.41, ["4.1e-1", "0.41", "+0.41"]),
        (0.0882, ["8.8e-2", "8.8e-2", "+8.8e-2"]),
        (-0.33, ["-3.3e-1", "-0.33", "-0.33"]),
    ],
)
def test_numbers_are_written_as_in_the_documents(value, texts):
    assert [
        tables.scientific(value),
        tables.two_digits(value),
        tables.two_digits(value, signed=True),
    ] == texts


def test_it_runs_as_a_command():
    ended = subprocess.run(
        [sys.executable, "-m", "paper", "--help"],
        cwd=ROOT / "tools",
        capture_output=True,
        text=True,
        check=False,
    )
    assert ended.returncode == 0 and "accept" in ended.stdout
