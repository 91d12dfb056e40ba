"""The paper on findings about Cycles: Markdown, HTML and LaTeX from the record of `measure findings`.

    python tools/findings_paper.py parity/records/findings.json docs/findings

The text is docs/findings/paper.md.j2; every number in it comes from the record, and of scenes, where that has
none, from parity/records/findings-scenes.json. Pandoc makes HTML and LaTeX
of the Markdown, blend/findings_plot.py the figures.
"""

import argparse
import re
import sys
from pathlib import Path

import jinja2
import pypandoc

from paper import ROOT, files  # the scripts of blend/ are known from here on

import findings_plot  # isort: skip
import protocol  # isort: skip

FORMAT = "cloudparity-findings/1"
# A record of a run of its own, since scenes take longer than all else: what seeds hide in them.
SCENES = ROOT / "parity/records/findings-scenes.json"
RAISED = str.maketrans("⁻⁰¹²³⁴⁵⁶⁷⁸⁹", "-0123456789")
# Relative: some sums of 32 bits.
ROUNDING = 1e-5
# Of normal errors, the share beyond two standard errors.
BEYOND_TWO = 0.0455


def main(arguments=None):
    """Write the paper; exit status 2 where the record cannot be used."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("record", type=Path)
    parser.add_argument("folder", type=Path)
    given = parser.parse_args(arguments)
    try:
        write(with_scenes(read(given.record)), given.folder)
    except protocol.InputError as error:
        print(
            f"{error.place}: found {error.found}, expected {error.expected}; {error.remedy}", file=sys.stderr
        )
        return 2
    return 0


def read(path):
    """The record."""
    remedy = "make it with `cloudparity measure findings -o DIR`: it is DIR/findings.json"
    record = files.read_json(path, "a record of findings", remedy)
    if not isinstance(record, dict) or record.get("format") != FORMAT:
        found = record.get("format") if isinstance(record, dict) else type(record).__name__
        raise protocol.InputError(f"{path}, format", repr(found), FORMAT, remedy)
    if not any(one["name"] != "scenes" for one in record["findings"]):
        raise protocol.InputError(f"{path}, findings", "none", "at least one finding", remedy)
    return record


def with_scenes(record):
    """The record, with what SCENES says of the same release where it says nothing of scenes itself."""
    if any(one["name"] == "scenes" for one in record["findings"]):
        return record
    last = record["findings"][-1]["blender"]
    scenes = [one for one in read(SCENES)["findings"] if one["name"] == "scenes" and one["blender"] == last]
    return record | {"findings": record["findings"] + scenes}


def markdown(record):
    """The text."""
    last = record["findings"][-1]["blender"]
    own = [one for one in record["findings"] if one["blender"] == last]
    findings = [one for one in own if one["name"] != "scenes"]
    scenes = next((one for one in own if one["name"] == "scenes"), None)
    names = [one["name"] for one in findings]
    rows = [row for one in findings for row in one["rows"] if row["claim"] != "reported"]
    held = [holds for one in findings for holds in one["holding"]]
    equals = sum("equals" in row["claim"] for row in rows)
    failing = [
        cells[0]
        for one in findings
        for cells, holds in zip(one["cells"], one["holding"], strict=True)
        if holds is False
    ]
    loader = jinja2.FileSystemLoader(ROOT / "docs/findings")
    environment = jinja2.Environment(loader=loader, undefined=jinja2.StrictUndefined, trim_blocks=True)
    environment.globals.update(effect=_effect, caption=_caption, agreement=_agreement, misses=_misses)
    environment.globals["number"] = lambda name: names.index(name) + 1
    return environment.get_template("paper.md.j2").render(
        version=last,
        findings=findings,
        scenes=scenes,
        scene_counts=_counts(scenes) if scenes else "",
        others=[one for one in record["findings"] if one["blender"] != last],
        left_out=_reasons(record["left_out"]),
        claims=len(rows),
        holding=sum(one is True for one in held),
        equals=equals,
        chance=f"{BEYOND_TWO * equals:.1f}",
        failing="outside lie: " + "; ".join(failing) if failing else "",
        versions=_versions(record, last),
    )


def _reasons(left_out):
    """What was left out, by release and reason: [[how many and where, reason]]."""
    found = {}
    for what, reason in left_out:
        where, release = what.rsplit(" by ", 1)
        found.setdefault((release, reason), []).append(where.partition(":")[0])
    return [
        [f"{len(names)} scenes of {', '.join(dict.fromkeys(names))} by {release}", reason]
        for (release, reason), names in found.items()
    ]


def _counts(scenes):
    request = scenes["measured"][0]["request"]
    return f"{len(request['replicas'])} times with {request['samples']} samples"


def _effect(finding):
    """The row that is surest to miss the truth, as measured."""
    rows = [row for row in finding["rows"] if row["truth"] is not None and row["value"]["standard_error"] > 0]

    def surety(row):
        error = abs(row["value"]["value"] - row["truth"])
        # Rounding of single precision is no effect, however sure.
        return 0.0 if error < ROUNDING * abs(row["truth"]) else error / row["value"]["standard_error"]

    index = finding["rows"].index(max(rows, key=surety))
    name, measured, _, _, truth = finding["cells"][index]
    return f"{measured} instead of {truth} ({name})"


def _agreement(finding):
    held = finding["holding"]
    return f"{held.count(True)} of {len(held) - held.count(None)} predictions hold"


def _misses(finding):
    """Figures whose predictions do not hold, in words."""
    pairs = zip(finding["cells"], finding["holding"], strict=True)
    return "; ".join(
        f"{name}: {measured}, predicted {claimed}"
        for (name, measured, claimed, *_), holds in pairs
        if holds is False
    )


def _caption(finding):
    if finding["name"] == "order":
        return (
            "Left: the mean of the picture of every single sample, for two seeds. Right: means of 256 "
            "samples; replicas by seed agree with each other, and those by subset show how far all are off."
        )
    return f"{finding['title']}: measured, predicted, and what light transport says."


def _versions(record, blender):
    # A version and the hash of the sources: its first digits name the build.
    parts = sorted(build.partition("+") for build in record["builds"])
    builds = ", ".join(f"{version} ({source[:12]})" for version, _, source in parts)
    return f"cloudparity {builds} and Blender {blender} as the Python module bpy, on processors alone"


def write(record, folder):
    """All files of the paper."""
    text = markdown(record)
    last = record["findings"][-1]["blender"]
    drawn = [one for one in record["findings"] if one["blender"] == last and one["name"] != "scenes"]
    findings_plot.draw(
        {"findings": drawn, "folder": str(folder), "plain_names": True, "formats": ["png", "pdf"]},
        protocol.Messages(sys.stderr),
    )
    page = [
        "--standalone",
        "--mathml",
        "--toc",
        "--toc-depth=2",
        f"--css={(ROOT / 'docs/findings/paper.css').name}",
    ]
    to_html = pypandoc.convert_text(text, "html5", "markdown", extra_args=page)
    latex = ["--standalone", "--variable=geometry:margin=25mm", "--variable=fontsize:10pt"]
    to_latex = pypandoc.convert_text(_for_latex(text), "latex", "markdown", extra_args=latex)
    for name, content in (("README.md", _body(text)), ("index.html", to_html), ("findings.tex", to_latex)):
        files.write(folder / name, content.rstrip() + "\n")


def _for_latex(text):
    """Figures that print as lines, and signs that every LaTeX knows."""

    def raw(latex):
        return f"`{latex}`{{=latex}}"

    def power(found):
        return raw(rf"$\times 10^{{{found[1].translate(RAISED)}}}$")

    text = re.sub(r"\u00d710([⁻⁰¹²³⁴⁵⁶⁷⁸⁹]+)", power, text)
    for sign, latex in (("\N{MINUS SIGN}", "$-$"), ("\N{GREEK SMALL LETTER SIGMA}", r"$\sigma$")):
        text = text.replace(sign, raw(latex))
    return text.replace(".png)", ".pdf)")


def _body(text):
    """Markdown for readers of the repository: a heading for pandoc's block, pictures without attributes."""
    _, head, body = text.split("---\n", 2)
    title = next(line for line in head.splitlines() if line.startswith("title:"))
    abstract = head.split("abstract: |\n", 1)[1]
    summary = " ".join(line.strip() for line in abstract.splitlines()).strip()
    heading = title.removeprefix("title:").strip().strip('"')
    return f"# {heading}\n\n{summary}\n{body.replace('{width=100%}', '')}"


if __name__ == "__main__":
    sys.exit(main())
