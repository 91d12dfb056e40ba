"""Reads what cloudparity writes: studies, comparisons of density models, and comparisons of fields.

It needs numpy, OpenImageIO for pictures, and nothing of the program but its files; the formats are those of
docs/studies.md. What is a decision of the program (which settings nothing beats, which one to recommend for a
budget, what the density is at a point) is asked of the program itself, so there is no second answer to it.

    study = read_study("../out/demo/study")
    study.runs[0].relmse.value              # every run: settings, errors with standard errors, times
    study.picture(study.runs[0])            # float32 [height, width, 3], scene-linear
    mean, error = study.truth(study.runs[0])
    study.front("daylight", "graph", metric="flip")
    study.recommend("daylight", "graph", max_ms=50)

Times are seconds of processor time, but for `wall_seconds`; radiance is scene-linear; `bias` is a share of
the truth's mean. Everything that cannot be used ends in a ReadError: where, what was found, what was
expected, and what to do. `Study.records()` has the columns of results.csv, for pandas.DataFrame and its like.
"""

import csv
import json
import os
import re
import shutil
import subprocess
import tempfile
from dataclasses import dataclass
from pathlib import Path

import numpy as np

STUDY_FORMAT = "cloudparity-study-results/1"
SCENE_FORMAT = "cloudparity-scene/1"
METRICS = ("relmse", "rms", "flip")
# Settings of the light that is found beforehand; all are 0 where there is none.
LIGHT_VOLUME = ("cells", "paths", "bands", "shadow_cells", "seed")
# A clone of cloudparity: the one that this file lies in, or another for a copy of it elsewhere.
ROOT = Path(os.environ.get("CLOUDPARITY_REPOSITORY") or Path(__file__).parents[1]).resolve()

# The times of two settings on a Pareto front differ by a larger share: they are stated to the nanosecond.
_SMALLEST_DIFFERENCE = 1e-12


class ReadError(Exception):
    """Something that cannot be read: where it stands, what was found, what was expected, what to do."""

    def __init__(self, place, found, expected, remedy):
        super().__init__(f"{place}: found {found}; expected {expected}. {remedy}")
        self.place = str(place)
        self.found = found
        self.expected = expected
        self.remedy = remedy

    def _render_traceback_(self):
        """What a notebook shows in the place of a traceback."""
        return [
            f"cannot go on: {self.place}",
            f"  found     {self.found}",
            f"  expected  {self.expected}",
            f"  to do     {self.remedy}",
        ]


@dataclass(frozen=True)
class Uncertain:
    """A figure and its standard error from the noise of the truth."""

    value: float
    standard_error: float


@dataclass(frozen=True)
class Run:
    """One combination of settings: its errors against the truth and its times."""

    id: str
    scene: str
    density: str
    light: str
    steps: int
    light_steps: int
    cache_cells: int
    cache_format: str
    light_volume_cells: int
    light_volume_paths: int
    light_volume_bands: int
    light_volume_shadow_cells: int
    light_volume_seed: int
    sub_pixels: int
    jitter: str
    defects: str
    god_rays: bool
    seconds: float
    seconds_smallest: float
    seconds_largest: float
    wall_seconds: float
    prepare_seconds: float
    relmse: Uncertain
    rms: Uncertain
    bias: Uncertain
    flip: float | None
    cost: float
    picture: str
    truth: str

    @property
    def milliseconds(self):
        """Processor time of a picture, in milliseconds."""
        return 1e3 * self.seconds

    def error(self, metric):
        """The figure of a metric of METRICS; None where HDR-FLIP was not computed."""
        return self.flip if metric == "flip" else getattr(self, metric).value

    def quality(self):
        """Every setting but the scene, the density and the light model."""
        return (
            self.steps,
            self.light_steps,
            self.cache_cells,
            self.cache_format,
            *(getattr(self, f"light_volume_{name}") for name in LIGHT_VOLUME),
            self.sub_pixels,
            self.jitter,
            self.defects,
            self.god_rays,
        )

    def label(self):
        """The settings within a scene and density in a few words: light model, steps/light steps."""
        text = f"{self.light} {self.steps}/{self.light_steps}"
        if self.cache_cells:
            text += f", cache {self.cache_cells} {self.cache_format}"
        if self.light_volume_cells:
            cells, paths = self.light_volume_cells, self.light_volume_paths
            text += f", light volume of {cells} cells and {paths} paths"
        if self.sub_pixels > 1:
            text += f", {self.sub_pixels**2} rays"
        if self.jitter != "none":
            text += f", {self.jitter}"
        if self.defects != "none":
            text += f", defects {self.defects}"
        return text + (", god rays" if self.god_rays else "")


@dataclass(frozen=True)
class Truth:
    """Path tracing of one density in one scene, in independent replicas."""

    id: str
    scene: str
    density: str
    seconds: float
    replicas: tuple[str, ...]


@dataclass(frozen=True)
class Skipped:
    """A combination that was left out: its settings as in results.json, and why."""

    settings: dict
    reason: str


@dataclass(frozen=True)
class Verified:
    """A relMSE that was measured twice, against independent truths; t is the difference over its error."""

    id: str
    scene: str
    density: str
    first: Uncertain
    second: Uncertain
    t: float
    agrees: bool


@dataclass(frozen=True)
class Study:
    """The folder of a study."""

    folder: Path
    title: str
    version: str
    machine: str
    resolution: tuple[int, int]
    truth_settings: dict
    timing: dict
    axes: dict
    runs: tuple[Run, ...]
    truths: tuple[Truth, ...]
    skipped: tuple[Skipped, ...]

    def groups(self):
        """{(scene, density): runs}: what may be compared with each other, in the order of the axes."""
        found = {}
        for scene in dict.fromkeys(run.scene for run in self.runs):
            for density in dict.fromkeys(run.density for run in self.runs):
                runs = [run for run in self.runs if (run.scene, run.density) == (scene, density)]
                if runs:
                    found[scene, density] = runs
        order = {name: place for place, name in enumerate(self.axes["densities"])}
        return dict(sorted(found.items(), key=lambda one: (self.scenes().index(one[0][0]), order[one[0][1]])))

    def scenes(self):
        """Names of the scenes that have runs, in the order of the study's axes where this names them."""
        names = list(dict.fromkeys(run.scene for run in self.runs))
        order = [scene.get("name") for scene in self.axes["scenes"]]
        return sorted(names, key=lambda name: order.index(name) if name in order else len(order))

    def lights(self):
        """Light models that have runs, with their parameters, in the order of the study's axes."""
        entries = self.axes["lights"]

        def place(name):
            # A light under an axis of parameters is named by the axis' entry and what the parameters add.
            own = [entry for entry in entries if f"{name} ".startswith(f"{entry} ")]
            return entries.index(max(own, key=len)) if own else len(entries)

        return sorted(dict.fromkeys(run.light for run in self.runs), key=place)

    def metrics(self):
        """The metrics that some run has: HDR-FLIP is missing where it could not be computed."""
        return [name for name in METRICS if any(run.error(name) is not None for run in self.runs)]

    def records(self):
        """One flat {column: value} per run, with the columns of results.csv but for `on_front`."""
        uncertain = ("relmse", "rms", "bias")
        found = []
        for run in self.runs:
            fields = {name: getattr(run, name) for name in Run.__dataclass_fields__}
            for name in uncertain:
                fields[name] = getattr(run, name).value
                fields[f"{name}_standard_error"] = getattr(run, name).standard_error
            found.append(
                {name: value for name, value in fields.items() if name not in ("id", "picture", "truth")}
            )
        return found

    def picture(self, run):
        """The picture of a run: float32 [height, width, 3], scene-linear."""
        return read_picture(self.folder / run.picture)

    def truth(self, run):
        """Mean over the replicas of a run's truth, and its standard error, per pixel and channel."""
        record = next((one for one in self.truths if one.id == run.truth), None)
        if record is None:
            raise ReadError(
                self.folder / "results.json",
                f"no truth {run.truth}",
                f"the truth of {run.density} in {run.scene}",
                "Run the study again: what is missing is made again.",
            )
        replicas = np.stack([read_picture(self.folder / name) for name in record.replicas]).astype(np.float64)
        return replicas.mean(axis=0), replicas.std(axis=0, ddof=1) / np.sqrt(len(replicas))

    def recommend(self, scene, density, *, max_ms=None, max_relmse=None, max_flip=None, metric="relmse"):
        """What `cloudparity recommend` says: least error in a time, or shortest time for an error.

        One budget is given. A ReadError where no run keeps to it holds the program's words.
        """
        budgets = {"--max-ms": max_ms, "--max-relmse": max_relmse, "--max-flip": max_flip}
        given = [
            part
            for name, value in budgets.items()
            if value is not None
            for part in (name, repr(float(value)))
        ]
        place = ["--scene", scene, "--density", density, "--metric", metric]
        text = run_program("recommend", self.folder, *given, *place, "--json")
        found = json.loads(text)[0]["run"]["id"]
        return next(run for run in self.runs if run.id == found)

    def front(self, scene, density, metric="relmse"):
        """The runs that no other beats in both time and a metric, by rising time.

        The program is asked for the best run in ever shorter times, until the answer is the fastest run.
        """
        runs = [run for run in self.groups()[scene, density] if run.error(metric) is not None]
        if not runs:
            return []
        fastest = min(run.seconds for run in runs)
        found = []
        milliseconds = 2e3 * max(run.seconds for run in runs)
        while not found or found[-1].seconds > fastest:
            found.append(self.recommend(scene, density, max_ms=milliseconds, metric=metric))
            milliseconds = found[-1].milliseconds * (1 - _SMALLEST_DIFFERENCE)
        return found[::-1]

    def front_of_table(self):
        """Ids of the runs that results.csv marks as on a Pareto front (by relMSE)."""
        path = self.folder / "results.csv"
        with _opened(path, "the table of a study") as file:
            rows = list(csv.DictReader(file))
        return {run.id for run, row in zip(self.runs, rows, strict=True) if row["on_front"] == "true"}

    def verified(self):
        """The errors that `cloudparity study --verify` measured again; None where it has not run."""
        path = self.folder / "verified.json"
        if not path.exists():
            return None
        with _reading(path, "cloudparity study --verify"):
            return [
                Verified(
                    one["id"],
                    one["combination"]["scene"],
                    one["combination"]["density"],
                    Uncertain(**one["first"]),
                    Uncertain(**one["second"]),
                    one["t"],
                    one["agrees"],
                )
                for one in _json(path, "cloudparity study --verify")
            ]


@dataclass(frozen=True)
class Field:
    """One density of a comparison: `statistics` as in models.json, times in nanoseconds per density."""

    id: str
    title: str
    factor: float
    statistics: dict
    cpu_nanoseconds: float
    gpu_nanoseconds: float | None

    def histogram(self):
        """Edges in means over the filled places, the probability density between, the share beyond."""
        *shares, beyond = self.statistics["histogram"]
        edges = np.linspace(0.0, 6.0, len(shares) + 1)
        return edges, np.array(shares) / np.diff(edges), beyond

    def spectrum(self):
        """Wave numbers in waves per side of the box, and the power per mode of the density over its mean."""
        power = np.array(self.statistics["spectrum"])
        return np.arange(1, len(power) + 1), power


@dataclass(frozen=True)
class ModelPicture:
    """A picture of a comparison: one density under one light model, or by path tracing."""

    light: str
    light_title: str
    density: str
    exr: Path
    seconds: float
    mean_radiance: float


@dataclass(frozen=True)
class ModelComparison:
    """What `cloudparity compare-models` found."""

    folder: Path
    scene: str
    settings: dict
    fields: tuple[Field, ...]
    pictures: tuple[ModelPicture, ...]
    adapter: dict | None


def read_study(folder):
    """Reads the folder of a study."""
    folder = Path(folder)
    path = folder / "results.json"
    if not path.exists():
        raise ReadError(
            path,
            "no such file",
            "the folder of a study that has run",
            "Run `make demo`, which leaves one in out/demo/study, or `cloudparity study FILE -o DIR`.",
        )
    maker = "cloudparity study"
    document = _json(path, maker)
    found = document.get("format") if isinstance(document, dict) else None
    if found != STUDY_FORMAT:
        raise ReadError(
            f"{path}, format",
            "no format" if found is None else found,
            STUDY_FORMAT,
            "Run the study with this version of cloudparity, into another folder.",
        )
    with _reading(path, maker):
        study = document["study"]
        return Study(
            folder=folder,
            title=study["title"],
            version=document["version"],
            machine=document["machine"],
            resolution=tuple(study["resolution"]),
            truth_settings=study["truth"],
            timing=study["timing"],
            axes={name: study["axes"][name] for name in ("scenes", "densities", "lights")} | study["axes"],
            runs=tuple(_run(one) for one in document["runs"]),
            truths=tuple(
                Truth(one["id"], one["scene"], one["density"], one["seconds"], tuple(one["replicas"]))
                for one in document["truths"]
            ),
            skipped=tuple(Skipped(one["combination"], one["reason"]) for one in document["skipped"]),
        )


def _run(found):
    settings = found["combination"]
    names = ("scene", "density", "light", "steps", "light_steps", "sub_pixels", "jitter")
    return Run(
        id=found["id"],
        **{name: settings[name] for name in names},
        # Left out in the file where there are none.
        defects=settings.get("defects", "none"),
        god_rays=settings.get("god_rays", False),
        cache_cells=settings["cache"]["cells"],
        cache_format=settings["cache"]["format"],
        **{
            f"light_volume_{name}": (settings.get("light_volume") or {}).get(name, 0) for name in LIGHT_VOLUME
        },
        seconds=found["seconds"]["median"],
        seconds_smallest=found["seconds"]["smallest"],
        seconds_largest=found["seconds"]["largest"],
        **{
            name: found[name]
            for name in ("wall_seconds", "prepare_seconds", "flip", "cost", "picture", "truth")
        },
        **{name: Uncertain(**found["errors"][name]) for name in ("relmse", "rms", "bias")},
    )


def read_models(folder):
    """Reads what `cloudparity compare-models` or `cloudparity demo` left in a folder."""
    folder = Path(folder)
    path = folder / "models.json"
    if not path.exists():
        raise ReadError(
            path,
            "no such file",
            "the folder of a comparison of density models",
            "Run `make demo`, which leaves one in out/demo, or `cloudparity compare-models SCENE -o DIR`.",
        )
    maker = "cloudparity compare-models"
    document = _json(path, maker)
    names = ("id", "title", "factor", "statistics", "cpu_nanoseconds", "gpu_nanoseconds")
    with _reading(path, maker):
        return ModelComparison(
            folder=folder,
            scene=document["scene"],
            settings=document["settings"],
            fields=tuple(Field(**{name: side[name] for name in names}) for side in document["sides"]),
            pictures=tuple(
                ModelPicture(
                    one["light"],
                    one["light_title"],
                    one["density"],
                    folder / one["exr"],
                    one["seconds"],
                    one["mean_radiance"],
                )
                for one in document["pictures"]
            ),
            adapter=document["adapter"],
        )


def read_probes(folder):
    """The comparisons with live Cycles in probe.json, as `cloudparity probe` or `demo` write them.

    A list of objects; None where the folder has none.
    """
    found = _optional(
        Path(folder) / "probe.json", "cloudparity probe SCENE --backend all -o FOLDER/probe.json"
    )
    return [found] if isinstance(found, dict) else found


def read_modes(folder):
    """The comparisons of every mode of every node in modes.json, or None where the folder has none."""
    return _optional(Path(folder) / "modes.json", "cloudparity modes")


def read_slices(folder):
    """{name: (Cycles' values, WGSL's)} of the slices through the field that `cloudparity demo` keeps.

    Rows from the upper edge down. Empty where the folder has none.
    """
    found = {}
    for path in sorted((Path(folder) / "slices").glob("*-cycles.npy")):
        name = path.name.removesuffix("-cycles.npy")
        other = path.with_name(f"{name}-gpu.npy")
        if other.exists():
            found[name] = (np.load(path), np.load(other))
    return found


def read_golden_values():
    """Values of Cycles that are committed for machines without Blender: `points` and `values`."""
    path = ROOT / "parity" / "golden-values.json"
    return _json(path, "the repository")


def read_scene(path):
    """A scene file as it is: JSON with the keys of docs/scene-format.md."""
    document = _json(Path(path), "cloudparity export")
    found = document.get("format") if isinstance(document, dict) else None
    if found != SCENE_FORMAT:
        raise ReadError(
            f"{path}, format",
            "no format" if found is None else found,
            SCENE_FORMAT,
            "Export the scene with this version of cloudparity.",
        )
    return document


def read_picture(path):
    """The colour channels R, G and B of an EXR: float32 [height, width, 3], scene-linear."""
    try:
        import OpenImageIO as oiio
    except ImportError as error:
        raise ReadError(
            "Python package OpenImageIO", str(error), "what reads EXR files", "Run `make setup`."
        ) from None
    file = oiio.ImageInput.open(str(path))
    if file is None:
        raise ReadError(path, oiio.geterror().strip(), "an EXR picture", "Make the folder again.")
    try:
        names = list(file.spec().channelnames)
        pixels = file.read_image(oiio.FLOAT)
    finally:
        file.close()
    if pixels is None or not set("RGB") <= set(names):
        found = f"channels {', '.join(names)}" if pixels is not None else "pixels that cannot be read"
        raise ReadError(path, found, "channels R, G and B", "Make the folder again.")
    return pixels[..., [names.index(name) for name in "RGB"]]


def evaluate(scene, points, evaluator="cpu", output=None):
    """The density of a scene, or an output "NODE.SOCKET" inside its graph, at points of the object's frame.

    `scene` is a file, or a document as read_scene gives it; `evaluator` is "cpu" (the bits of Cycles), "gpu"
    (WGSL on the adapter) or "oracle" (f64). Values are float32.
    """
    with tempfile.TemporaryDirectory(prefix="cloudparity-") as folder:
        folder = Path(folder)
        if isinstance(scene, dict):
            path = folder / "scene.json"
            path.write_text(json.dumps(scene), encoding="utf-8")
        else:
            path = Path(scene)
        np.save(folder / "points.npy", np.asarray(points, dtype=np.float32))
        arguments = [path, "--points", folder / "points.npy", "-o", folder / "values.npy"]
        arguments += ["--backend", evaluator] + (["--target", output] if output else [])
        run_program("eval", *arguments)
        return np.load(folder / "values.npy")


def run_program(*arguments):
    """What a command of cloudparity prints; its words as a ReadError where it fails."""
    command = [str(program()), *map(str, arguments)]
    finished = subprocess.run(command, capture_output=True, text=True)
    if finished.returncode:
        words = finished.stderr.strip().removeprefix("error: ")
        parts = re.fullmatch(r"(.*?): found (.*); expected (.*?)\. (.*)", words, re.DOTALL)
        if parts:
            raise ReadError(*parts.groups())
        found = words or f"exit status {finished.returncode}"
        raise ReadError(f"cloudparity {arguments[0]}", found, "exit status 0", "See what it says.")
    return finished.stdout


def program():
    """The program: CLOUDPARITY_PROGRAM, or the build of this repository, or the one on the path."""
    named = os.environ.get("CLOUDPARITY_PROGRAM")
    built = ROOT / os.environ.get("CARGO_TARGET_DIR", "target") / "release" / "cloudparity"
    if named or built.exists():
        path = Path(named) if named else built
    else:
        path = Path(shutil.which("cloudparity") or built)
    if not path.exists():
        raise ReadError(
            path, "no such file", "the program", "Run `make build`, or name it in CLOUDPARITY_PROGRAM."
        )
    return path


def _opened(path, what):
    try:
        return open(path, encoding="utf-8", newline="")
    except OSError as error:
        raise ReadError(path, error.strerror or str(error), what, "Make the folder again.") from None


def _json(path, maker):
    """A JSON file; broken ones are named with line and column."""
    remedy = f"Remove the file and run {maker} again."
    with _opened(path, f"what {maker} writes") as file:
        try:
            return json.load(file)
        except json.JSONDecodeError as error:
            place = f"{path}, line {error.lineno}, column {error.colno}"
            raise ReadError(place, error.msg, "JSON", remedy) from None
        except UnicodeDecodeError as error:
            raise ReadError(path, f"no UTF-8 at byte {error.start}", "JSON", remedy) from None


def _optional(path, maker):
    return _json(path, maker) if path.exists() else None


class _reading:
    """Turns missing keys and wrong types within a file into a ReadError."""

    def __init__(self, path, maker):
        self._path, self._maker = path, maker

    def __enter__(self):
        return self

    def __exit__(self, kind, error, traceback):
        if kind is None or not issubclass(kind, KeyError | TypeError | AttributeError):
            return False
        found = f"no {error}" if isinstance(error, KeyError) else str(error)
        raise ReadError(
            self._path, found, f"what {self._maker} of this version writes", f"Run {self._maker} again."
        ) from None
