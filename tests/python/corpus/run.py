"""Takes files of the corpus through the program and through Cycles, and judges them."""

import json
import os
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from pathlib import Path

from blend_support import ROOT, built_program
from corpus.registry import File
from corpus.targets import targets

# Points per field. A difference in a thousandth of the box is then missed once in e^4.
POINTS = 4000
# A picture is judged as 24 x 16 pixels of 4 x 4 sub-pixels: 16 replicas in pairs, of one render per side.
PIXELS = (24, 16)
SUB_PIXELS = 4
CYCLES_SEED = 5000
SEED = 100

AGREES, DIFFERS, REFUSED, UNDECIDED = "agrees", "differs", "refused", "could not tell"
VERDICTS = {0: AGREES, 1: DIFFERS, 2: UNDECIDED}


@dataclass
class Field:
    """A field of a medium against Cycles' values."""

    target: str
    verdict: str
    text: str


@dataclass
class Outcome:
    """What became of a file."""

    entry: File
    # The error of `export` or, later, of `render`, as it is printed.
    refusal: str | None = None
    warnings: list[str] = field(default_factory=list)
    fields: list[Field] = field(default_factory=list)
    # Verdict and figures of the comparison of pictures, where one was made.
    picture: str | None = None
    figures: dict = field(default_factory=dict)

    @property
    def verdict(self):
        """The worst of all that was looked at."""
        if self.refusal is not None:
            return REFUSED
        found = [item.verdict for item in self.fields] + ([self.picture] if self.picture else [])
        return next((verdict for verdict in (REFUSED, DIFFERS, UNDECIDED) if verdict in found), AGREES)

    @property
    def as_documented(self):
        """Whether the file agrees, or differs or is refused with the words that its entry expects."""
        if self.entry.differs is not None:
            said = any(self.entry.differs in warning for warning in self.warnings)
            # Without a picture there is nothing yet that could differ.
            return said and (self.picture == DIFFERS if self.picture else self.verdict == AGREES)
        if self.entry.refused is None:
            return self.verdict == AGREES
        return self.verdict == REFUSED and self.entry.refused in self.refusal

    def describe(self):
        """All that speaks against the file, as text."""
        lines = [self.refusal] if self.refusal else []
        lines += [f"{item.target}: {item.text}" for item in self.fields if item.verdict != AGREES]
        if self.picture not in (None, AGREES):
            lines += [f"picture: {self.picture}", *self.figures.get("reasons", [str(self.figures)])]
        return "\n".join(lines)


def program(*arguments, usual=False):
    """Run the program; returns (exit status, stdout, stderr). `usual`: by the interpreter of the project;
    that of another release, which the corpus may be run by, has no packages that judge pictures."""
    left_out = {"CLOUDPARITY_PYTHON"} if usual else set()
    finished = subprocess.run(
        [str(built_program()), *map(str, arguments)],
        capture_output=True,
        text=True,
        cwd=ROOT,
        env={name: value for name, value in os.environ.items() if name not in left_out},
        stdin=subprocess.DEVNULL,
    )
    return finished.returncode, finished.stdout, finished.stderr


def examine(blend, entry, pictures, reuse=False):
    """Export a file, probe its fields and, if `pictures`, compare its picture with Cycles'.

    `reuse` takes the picture by Cycles that an earlier run has left beside the file.
    """
    outcome = Outcome(entry)
    scene = blend.with_suffix(".scene.json")
    status, _, errors = program("export", blend, "-o", scene, *entry.arguments)
    if status != 0:
        outcome.refusal = errors.strip()
        return outcome
    outcome.warnings = [line for line in errors.splitlines() if line.startswith("warning")]
    for variant, names in _variants(scene):
        for name in names:
            outcome.fields.append(_probe(variant, name))
    refused = [item for item in outcome.fields if item.verdict == REFUSED]
    if refused:
        outcome.refusal = refused[0].text
    elif pictures:
        compare(blend, scene, outcome, reuse)
    return outcome


def _variants(scene):
    """Scene files that hold one volume each, one for every material, and the targets of its graph."""
    whole = json.loads(scene.read_text(encoding="utf-8"))
    graphs = [whole["graph"], *whole.pop("other_graphs", [])]
    volumes = [whole["volume"], *whole.pop("other_volumes", [])]
    for graph in graphs:
        names = targets(graph)
        for number, volume in enumerate(volumes):
            # Of a material without a node that shows the object, one is as good as all.
            if volume["material"] == graph["material"] and volume["shape"]["type"] != "grid":
                path = scene.with_name(f"{scene.name.removesuffix('.scene.json')}-{number}.scene.json")
                path.write_text(json.dumps(whole | {"volume": volume, "graph": graph}), encoding="utf-8")
                yield path, names


def _probe(scene, name):
    status, output, errors = program("probe", scene, "--points", POINTS, "--target", name)
    text = (output + errors).strip()
    return Field(name, REFUSED if "error" in errors else VERDICTS[status], text)


def compare(blend, scene, outcome, reuse):
    """Compare the picture of an exported scene with Cycles' of the .blend, and note verdict and figures."""
    entry = outcome.entry
    size = [side * SUB_PIXELS for side in PIXELS]
    ours, reference = blend.with_suffix(".ours.exr"), blend.with_suffix(".cycles.exr")
    arguments = ["--resolution", f"{size[0]}x{size[1]}", "--integrator", "path"]
    arguments += ["--samples", entry.samples, "--seed", SEED, "-o", ours]
    status, _, errors = program("render", scene, *arguments)
    if status != 0:
        outcome.refusal = errors.strip()
        return
    request = {
        "blend": str(blend),
        "scene": str(scene),
        "exr": str(reference),
        "resolution": size,
        "samples": entry.samples,
        "seed": CYCLES_SEED,
        "left_out": entry.left_out,
        "sample_world": entry.sample_world,
    }
    script = [sys.executable, "-P", Path(__file__).with_name("cycles_picture.py"), json.dumps(request)]
    modules = {"PYTHONPATH": str(ROOT / "blend"), "PYTHONDONTWRITEBYTECODE": "1"}
    if not (reuse and reference.exists()):
        subprocess.run(script, check=True, capture_output=True, env=os.environ | modules)
    judged = ["diff", "--ours", ours, "--reference", reference, "--pixels-as-replicas", SUB_PIXELS]
    status, output, errors = program(*judged, "--json", usual=True)
    outcome.picture = VERDICTS[status]
    outcome.figures = json.loads(output) if output.startswith("{") else {"error": output + errors}


def run(folder, entries, pictures, threads=2, reuse=False):
    """Examine files, whose .blend lie in `folder`, side by side; yields outcomes in the order of `entries`.

    `pictures(entry)` says whether the picture is compared, too.
    """
    with ThreadPoolExecutor(threads) as pool:
        jobs = [
            pool.submit(examine, Path(folder) / f"{entry.name}.blend", entry, pictures(entry), reuse)
            for entry in entries
        ]
        for job in jobs:
            yield job.result()
