"""The table of docs/corpus.md."""

from pathlib import Path

from corpus.run import AGREES, DIFFERS, PIXELS, POINTS, REFUSED, SUB_PIXELS

HEAD = """# The corpus: files like those that people make

{count} .blend files, made by bpy in `tests/python/corpus/`, one function each. Every file is exported; the
fields that decide its medium (whatever is linked into a closure or a Mix Shader) are evaluated at {points}
random points and compared with live Cycles, bit for bit (`cloudparity probe`, grids of Volume objects
left out); and its picture by path tracing is compared with Cycles' picture
**of the .blend itself**, not of the scene that was exported, so that what the exporter loses shows. {cycles}
renders by null collision; {width} x {height} pixels of {sub} x {sub} sub-pixels, which are the replicas
for the 13 checks of `cloudparity diff` (docs/parity.md), with the same samples on both sides.

```sh
export PYTHONPATH=tests/python:blend PYTHONDONTWRITEBYTECODE=1
.venv/bin/python -m corpus --table docs/corpus.md   # all, written here: minutes
.venv/bin/python -m corpus fog-box god-rays         # some
```

`make test` does the export and the fields of all and the pictures of those whose medium is constant
(`tests/python/test_corpus.py`); pictures of the others cost Cycles up to a minute each, nearly all of it the
preparation of its octree.

{summary}

| file | what it is | fields: points that differ | picture: checks that agree, bias of the mean | verdict |
| --- | --- | --- | --- | --- |
"""

# What was learnt, written by hand: it stands below the table.
FINDINGS = Path(__file__).with_name("findings.md")


def _fields(outcome):
    if not outcome.fields:
        return "constant" if outcome.verdict != REFUSED else ""
    agreeing = [item for item in outcome.fields if item.verdict == AGREES]
    return f"0 in {len(agreeing)}" if len(agreeing) == len(outcome.fields) else "differ"


def _picture(outcome):
    figures = outcome.figures
    if "checks" not in figures:
        return "" if outcome.verdict == REFUSED else "not made"
    agree = sum(check["outcome"] == AGREES for check in figures["checks"])
    means = [mean for mean in figures["statistics"]["means"] if mean["relative_bias"] is not None]
    text = f"{agree} of {len(figures['checks'])}"
    if means:
        worst = max(means, key=lambda mean: abs(mean["relative_bias"]))
        text += f", {100 * worst['relative_bias']:+.2f} % ± {100 * worst['relative_standard_error']:.2f} %"
    samples = outcome.entry.samples
    return text if samples == 64 else f"{text} ({samples} samples)"


def _plain(text):
    return text.replace("|", "\\|").replace("\n", " ")


def _verdict(outcome):
    entry = outcome.entry
    if outcome.verdict == REFUSED:
        error = outcome.refusal
        found = error.split(": found ", 1)[-1].split("; expected ", 1)[0]
        where = f" ([listed]({entry.documented.removeprefix('docs/')}))" if outcome.as_documented else ""
        return f"refused: {_plain(found)}{where}"
    if outcome.verdict == DIFFERS and outcome.as_documented:
        return f"differs as the exporter says ([listed]({entry.documented.removeprefix('docs/')}))"
    if outcome.verdict == DIFFERS:
        return f"**differs**: {_plain(outcome.describe())}"
    if outcome.verdict != AGREES:
        return _plain(outcome.verdict + ": " + outcome.describe())
    if outcome.picture is None:
        return "the fields agree"
    if entry.left_out:
        return f"agrees, without {', '.join(entry.left_out)}, which the exporter names"
    return AGREES


def table(outcomes, cycles):
    """The document: `cycles` names the renderer."""
    counts = {}
    for outcome in outcomes:
        if outcome.verdict == DIFFERS and outcome.as_documented:
            kind = "differs as the exporter says"
        elif outcome.verdict != REFUSED:
            kind = outcome.verdict
        else:
            kind = "refused as documented" if outcome.as_documented else "refused without a documented reason"
        counts[kind] = counts.get(kind, 0) + 1
    summary = ", ".join(f"{number} {kind}" for kind, number in sorted(counts.items()))
    text = HEAD.format(
        count=len(outcomes),
        points=POINTS,
        cycles=cycles,
        width=PIXELS[0],
        height=PIXELS[1],
        sub=SUB_PIXELS,
        summary=f"Of {len(outcomes)} files: {summary}.",
    )
    rows = [
        f"| {outcome.entry.name} | {_plain(outcome.entry.about)} | {_fields(outcome)} "
        f"| {_picture(outcome)} | {_verdict(outcome)} |\n"
        for outcome in outcomes
    ]
    return text + "".join(rows) + "\n" + FINDINGS.read_text(encoding="utf-8")
