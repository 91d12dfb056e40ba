"""Tables drawn from records: one function per kind, which takes the record's document and the table's place.

A cell is a text, or a `Cell` that says besides which number it shows and how far a record that is made
again may be from it, with the reason. None is a cell that the record does not hold (times of a table of
sizes, say).
"""

import dataclasses
import math
import pathlib
import types

import presentation
from paper import files
from protocol import InputError

# A 99.99 % interval of a normal distribution is 3.9 standard errors: a false alarm in ten thousand cells.
STANDARD_ERRORS = 4.0
CHANNELS = {"R": "red", "G": "green", "B": "blue"}


@dataclasses.dataclass
class Cell:
    """A text, the number that it shows, its tolerance, and why it is that."""

    text: str
    value: float
    tolerance: float
    reason: str


@dataclasses.dataclass
class Place:
    """Where a table is to stand."""

    root: pathlib.Path
    heading: str
    keys: int


@dataclasses.dataclass
class Drawn:
    """A table."""

    head: list
    rows: list

    def texts(self):
        """The rows as texts; what the record does not hold is empty."""
        return [[text_of(cell) or "" for cell in row] for row in self.rows]


def text_of(cell):
    """The text of a cell, or None."""
    return cell.text if isinstance(cell, Cell) else cell


DRAWERS = {}


def drawer(name):
    """Registers a function that draws."""

    def register(function):
        DRAWERS[name] = function
        return function

    return register


def draw(name, document, place):
    """The table, or an error that names the record's missing part."""
    try:
        return DRAWERS[name](document, place)
    except (KeyError, IndexError, TypeError, AttributeError, ValueError) as error:
        raise InputError(
            f"the record of a table drawn as {name}",
            f"{type(error).__name__}: {error}",
            "the fields that the function reads",
            "make the record again: `make paper-full RECORD=NAME`",
        ) from None


def scientific(value, digits=1):
    """1.2e-7: without the zeros that Python puts into exponents, as the program writes it."""
    mantissa, exponent = f"{value:.{digits}e}".split("e")
    return f"{mantissa}e{int(exponent)}"


def two_digits(value, signed=False):
    """Two significant digits; below 0.1 with a power of ten."""
    sign = "+" if signed else ""
    if value and abs(value) < 0.1:
        return ("+" if signed and value > 0 else "") + scientific(value)
    return f"{value:{sign}.{max(0, 1 - math.floor(math.log10(abs(value))))}f}" if value else "0"


def fixed(value):
    """Two significant digits without a power of ten."""
    return f"{value:.{max(0, 1 - math.floor(math.log10(abs(value))))}f}" if value else "0"


# Suites against Cycles


def _percent(value):
    return f"{100 * value:+.3f}"


def _bias(found):
    """The channel with the largest bias of the mean; grey pictures have one for all."""
    largest = max(found["bias"], key=lambda bias: abs(bias["relative"]))
    low, high = largest["interval"]
    grey = len({_percent(bias["relative"]) for bias in found["bias"]}) == 1
    channel = "" if grey else CHANNELS[largest["channel"]] + ": "
    error = 100 * largest["standard_error"]
    return Cell(
        f"{_percent(largest['relative'])} % ({channel}{_percent(low)} to {_percent(high)} %)",
        100 * largest["relative"],
        STANDARD_ERRORS * math.sqrt(2) * error,
        "4 standard errors of the difference of two independent measurements",
    )


def _checks(found):
    agree, all_of_them = found["checks"]
    return Cell(
        f"{agree} of {all_of_them}",
        agree,
        1,
        "each check has level 0.01: one of thirteen may fail by chance in one measurement of eight",
    )


@drawer("suite")
def suite(document, place):
    """`parity.json` in short: scene, checks, bias; the scenes of meshes without that word."""
    rows = [[found["name"].removeprefix("mesh-"), _checks(found), _bias(found)] for found in document]
    return Drawn(["scene", "checks that agree", "bias of the mean"], rows)


def _resolution(path):
    """The pixels that a scene asks for."""
    film = files.read_json(path, "a scene", "restore it from version control")["film"]
    return [side * film.get("resolution_percentage", 100) // 100 for side in film["resolution"]]


@drawer("suite-with-sizes")
def suite_with_sizes(document, place):
    """`parity.json` with pixels and samples, of which the suite file says the first."""
    path = place.root / "parity/parity.suite.json"
    entries = files.read_json(path, "the suite", "restore it from version control")["entries"]
    entries = {entry["name"]: entry for entry in entries}
    rows = []
    for found in document:
        entry = entries[found["name"]]
        width, height = entry.get("resolution") or _resolution(place.root / "parity" / entry["scene"])
        size = f"{width} x {height}"
        if parts := entry["replicas"].get("sub_pixels"):
            size += f", sub-pixels of {parts * width} x {parts * height}"
        replicas = f"{found['replicas']} x {found['samples']}"
        rows.append([found["name"], size, replicas, _checks(found), _bias(found)])
    head = ["scene", "pixels", "replicas x samples", "checks that agree", "bias of the mean"]
    return Drawn(head, rows)


# Ray marching

DETERMINISTIC = "deterministic; another processor's mathematical functions move the last digit shown"
ORDERS = ("root_relmse", "relative_rms", "relative_mean_error")


def _each(document):
    """The documents of several records, or the only one."""
    return [document] if "format" in document else list(document.values())


@drawer("orders")
def orders(document, place):
    """`convergence.json`: the fitted orders of each scene."""
    rows = [row for found in _each(document) for row in _orders(found)]
    return Drawn(["scene", "integration", "root relMSE", "relative RMS", "relative mean error"], rows)


def _orders(document):
    rows = []
    for integration in ("energy-conserving", "plain"):
        row = [SCENES[document["scene"]][0], integration]
        for figure in ORDERS:
            fits = [order for order in document["orders"] if order["integration"] == integration]
            (fit,) = [order for order in fits if order["figure"] == figure] or [None]
            if fit and fit["asymptotic"]:
                row.append(Cell(f"{fit['order']:.2f}", fit["order"], 0.02, DETERMINISTIC))
            else:
                row.append(_last_doublings(document, integration, figure))
        rows.append(row)
    return rows


def _last_doublings(document, integration, figure):
    """The orders of the last two doublings, where they are nearer than a quarter of an order."""
    points = [point for point in document["points"] if point["integration"] == integration]
    errors = [abs(point[figure]) for point in points[-3:]]
    if len(errors) < 3 or min(errors) == 0:
        return "by chance"
    first, last = (math.log2(errors[at] / errors[at + 1]) for at in (0, 1))
    if abs(last - first) > 0.25:
        return "by chance"
    return Cell(f"{first:.1f}, then {last:.1f} in the last doublings", last, 0.05, DETERMINISTIC)


# What the pages call the scenes: among orders, among caches.
SCENES = {
    "noise-coloured": ("smooth (Noise Texture)", "Noise Texture"),
    "procedural-clouds": ("cloud", "cloud"),
}


@drawer("caches")
def caches(document, place):
    """`convergence.json`: f16 caches with trilinear filter."""
    rows = [row for found in _each(document) for row in _caches(found)]
    head = ["scene", "cells", "field error, largest", "field error, RMS", "relative RMS"]
    return Drawn([*head, "relative mean error"], rows)


def _caches(document):
    reason = (
        "deterministic; a cell whose edge another processor's rounding moves counts for less than a twentieth"
    )
    rows = []
    for point in document["caches"]:
        settings = point["cache"]["settings"]
        if (settings["format"], settings["filter"]) != ("f16", "trilinear"):
            continue
        cache = point["cache"]
        figures = [
            (fixed(cache["relative_max_error"]), cache["relative_max_error"]),
            (scientific(cache["relative_rms_error"]), cache["relative_rms_error"]),
            (two_digits(point["relative_rms"]), point["relative_rms"]),
            (two_digits(point["relative_mean_error"], signed=True), point["relative_mean_error"]),
        ]
        row = [SCENES[document["scene"]][1], str(settings["cells"])]
        row += [Cell(text, value, 0.05 * abs(value), reason) for text, value in figures]
        rows.append(row)
    return rows


@drawer("kernels")
def kernels(document, place):
    """`explain --kernels` of several scenes: what the specialised march leaves out."""
    reason = "texts of kernels change with the program; a tenth more or less is another kernel"
    rows = []
    for scene, explained in document.items():
        found = explained["kernels"]
        generic, special = found["generic"], found["specialised"]
        left_out = ", ".join(word.replace("-", " ") for word in found["left_out"]) or "nothing"
        row = [scene, left_out]
        for key in ("wgsl_bytes", "spirv_instructions"):
            value = special[key]
            row.append(Cell(f"{generic[key]} to {value}", generic[key], 0.1 * generic[key], reason))
        # Times are of a machine, and of what it did besides: shown, not expected.
        row += [f"{race['ratio']:.2f}" for race in found["races"]]
        rows.append(row)
    head = ["scene", "left out", "WGSL, bytes", "SPIR-V instructions", "CPU, times as fast"]
    return Drawn([*head, "adapter, times as fast"], rows)


# Tuning


@drawer("tuned")
def tuned(document, place):
    """A preset: what a search found, and the best published light model beside it."""
    reason = "HDR-FLIP of two halves of the truths is 0.008; a search that rounds otherwise ends elsewhere"
    found = document["provenance"]
    exposure = f"{document['parameters']['exposure']:.2f}"
    flips = [found["held_out_flip"], found["best_published_held_out_flip"]]
    cells = [Cell(f"{flip:.4f}", flip, 0.008, reason) for flip in flips]
    rows = [
        ["tuned", exposure, None, cells[0], None, None],
        [found["best_published"], None, None, cells[1], None, None],
    ]
    head = ["light model", "exposure", "FLIP, training", "FLIP, held out", "relMSE, held out", "time"]
    return Drawn(head, rows)


@drawer("tuning")
def tuning(document, place):
    """`tuning.json`: the tuned engine, the same finer, and every published light model, best first."""
    # Twice: a mean may move by what noise makes of the truth on either side.
    tolerance = 2 * document["noise_flip"]
    reason = f"HDR-FLIP of two halves of the truths is {document['noise_flip']:.4f}"
    rows = []
    for named in [("tuned", document["tuned"]), ("tuned, finer", document["finer"])] + [
        (found["name"], found) for found in document["published"]
    ]:
        name, found = named
        parts = [found["train"], found["held_out"]]
        flips = [sum(view["flip"] for view in part) / len(part) for part in parts]
        errors = [view["errors"]["relmse"]["value"] for view in found["held_out"]]
        rows.append(
            [name, f"{found['exposure']:.2f}"]
            + [Cell(f"{flip:.4f}", flip, tolerance, reason) for flip in flips]
            + [f"{sum(errors) / len(errors):.4f}", f"{1000 * found['seconds']:.0f} ms"]
        )
    head = ["light model", "exposure", "FLIP, training", "FLIP, held out", "relMSE, held out", "time"]
    return Drawn(head, rows)


# Stability


@drawer("stability")
def stability(document, place):
    """`stability.json`: the rows that are no pass."""
    reason = "a driver may round otherwise; what any may do ends at the derived bound, 1"
    rows = []
    for row in document["rows"]:
        if row["verdict"] == "pass":
            continue
        share = row["share_of_bound"]
        bound = "-" if share is None else Cell(f"{share:.2f}", share, max(1 - share, 0), reason)
        rows.append([row["id"], f"{row['max_error']:.1e}", f"{row['limit']:.1e}", bound])
    return Drawn(["row", "error", "limit", "of bound"], rows)


# Releases

STATUSES = (
    ("differs", "differ"),
    ("within", "within limits"),
    ("strange", "at strange values"),
    ("absent", "absent"),
)


def _counts(rows):
    counts = {status: 0 for status, _ in STATUSES} | {"equal": 0}
    for row in rows:
        counts[row["status"]] += 1
    return counts


def _drift(rows):
    counts = _counts(rows)
    if counts["equal"] == len(rows):
        return "equal"
    parts = ", ".join(f"{counts[status]} {word}" for status, word in STATUSES if counts[status])
    largest = max(row["largest_error"] for row in rows)
    error = f", up to {scientific(largest)}" if counts["differs"] else ""
    return f"{parts} of {len(rows)}{error}"


@drawer("releases")
def releases(document, place):
    """`drift.json`: nodes by release, those that differ somewhere."""
    bits = "the same kernel gives the same bits on every x86-64 processor"
    found = document["releases"]
    first = []
    for release in found:
        counts = _counts(release["rows"])
        ordinary = counts["equal"] + counts["strange"]
        text = f"{counts['equal']} of {len(release['rows'])} equal, {ordinary} at ordinary values"
        first.append(Cell(text, counts["equal"], 0, bits))
    rows, same = [["outputs of all modes", *first]], 0
    for node in dict.fromkeys(row["node"] for release in found for row in release["rows"]):
        row = [_drift([row for row in release["rows"] if row["node"] == node]) for release in found]
        if all(cell == "equal" for cell in row):
            same += 1
        else:
            rows.append([node, *row])
    rows.append([f"{same} other nodes", *["equal"] * len(found)])
    return Drawn(["node", *(release["blender"] for release in found)], rows)


def _uncertain(value, error):
    return presentation.uncertain(types.SimpleNamespace(value=value, standard_error=error))


@drawer("release-values")
def release_values(document, place):
    """`node-releases.json`: how many outputs of each release have our values of 4.5."""
    bits = "the same kernel gives the same bits on every x86-64 processor"
    sums = {}
    for row in document["rows"]:
        if row["values"] == "4.5":
            counts = [row[key] for key in ("outputs", "equal", "ordinary")]
            known = sums.get(row["release"], [0, 0, 0])
            sums[row["release"]] = [a + b for a, b in zip(known, counts, strict=True)]
    rows = [
        [release, *(Cell(f"{count} of {outputs}", count, 0, bits) for count in counts)]
        for release, (outputs, *counts) in sums.items()
    ]
    return Drawn(["values of 4.5 against", "equal", "at ordinary values"], rows)


@drawer("release-pictures")
def release_pictures(document, place):
    """`drift.json`: pictures by release."""
    reason = "4 standard errors of the difference of two independent measurements"
    rows = []
    for picture in document["pictures"]:
        row = [picture["scene"], picture["release"]]
        for key, unit in (("brightness", 100), ("relmse", 1)):
            value, error = (unit * picture[key][part] for part in ("value", "standard_error"))
            tolerance = STANDARD_ERRORS * math.sqrt(2) * error
            row.append(Cell(_uncertain(value, error), value, tolerance, reason))
        # Seconds are of a machine, and of what it did besides: the page keeps those of a quiet one.
        row.append(None)
        rows.append(row)
    return Drawn(["scene", "release", "brightness, %", "relMSE", "seconds"], rows)


# Nodes

NODES = ["node", "modes", "f32 against Cycles", "WGSL: largest error", "CPU per point", "Cycles / CPU"]
NODES += ["equal in releases"]
MODES = ["mode", "f32: points that differ", "f32: largest error", "WGSL: largest error", "WGSL: ulp"]
MODES += ["WGSL: beyond its limit", "f32", "f64", "WGSL", "Cycles", "Cycles / f32"]


def _error(value):
    return scientific(value) if value else "0"


def _nanoseconds(value):
    return f"{value:.1f} ns" if value < 100 else f"{value:.0f} ns"


def _ratio(value):
    return f"{value:.1f}" if value < 10 else f"{value:.0f}"


def _of_range(values, words):
    low, high = words(min(values)), words(max(values))
    return low if low == high else f"{low} to {high}"


def _by_node(rows):
    found = {}
    for row in rows:
        found.setdefault(row["node"], []).append(row)
    return found


@drawer("nodes")
def nodes(document, place):
    """`node-errors.json`, `node-costs.json` and `node-releases.json`: every node that was measured."""
    reason = "f32 on the CPU is claimed to have Cycles' bits"
    costs = _by_node(document["node-costs"]["rows"])
    releases_by_node = _by_node(document["node-releases"]["rows"])
    rows = []
    for node, modes in _by_node(document["node-errors"]["rows"]).items():
        differing = sum(mode["cpu_differing"] > 0 for mode in modes)
        failing = sum(not mode["pass"] for mode in modes)
        if differing:
            words = f"{_error(max(mode['cpu_max_error'] for mode in modes))} in {differing} modes"
        else:
            words = "equal" if len(modes) == 1 else f"equal in {len(modes)} modes"
        words += f"; {failing} beyond their limits" if failing else ""
        errors = [mode["wgsl_max_error"] for mode in modes if mode.get("wgsl_max_error") is not None]
        shown = _error(max(errors)) if errors else "not measured"
        times = [row["cloudparity_ns"] for row in costs.get(node, [])]
        ratios = [row["ratio"] for row in costs.get(node, []) if row.get("ratio") is not None]
        cost = _of_range(times, _nanoseconds) if times else "not measured"
        ratio = _of_range(ratios, _ratio) if ratios else ""
        label = node if node.startswith("(") else f"[{node}](#{_anchor(node)})"
        releases = _releases_of(releases_by_node.get(node, []))
        rows.append([label, str(len(modes)), Cell(words, differing, 0, reason), shown, cost, ratio, releases])
    # Blender's nodes and those that the compiler inserts stand in tables of their own.
    inserted = place.heading != "Nodes"
    return Drawn(NODES, [row for row in rows if row[0].startswith("(") == inserted])


def _releases_of(rows):
    """Releases with a node's values, by those of ours that fit best; in brackets: at ordinary values."""
    best = {}
    for row in rows:
        rank = (row["equal"], row["ordinary"], row["values"] == "5.0")
        if rank > best.get(row["release"], ((),))[0]:
            best[row["release"]] = (rank, row)
    words = []
    for release in sorted(best, key=lambda release: [int(part) for part in release.split(".")]):
        row = best[release][1]
        text = release.rpartition(".")[0]
        text += "" if row["values"] == "5.0" else f" by the values of {row['values']}"
        if row["equal"] == row["outputs"]:
            words.append(text)
        elif row["ordinary"] == row["outputs"]:
            words.append(f"({text})")
    return ", ".join(words)


def _anchor(label):
    kept = (letter for letter in label if letter.isalnum() or letter in " -")
    return "".join("-" if letter == " " else letter.lower() for letter in kept)


@drawer("node-modes")
def node_modes(document, place):
    """`node-errors.json` and `node-costs.json`: every mode of the node that the heading names."""
    errors = _by_node(document["node-errors"]["rows"]).get(place.heading, [])
    costs = {row["mode"]: row for row in _by_node(document["node-costs"]["rows"]).get(place.heading, [])}
    rows = []
    for found in errors:
        mode = found["mode"].replace("|", "\\|")
        row = [mode or "(one mode)"]
        differing = found["cpu_differing"]
        row.append(f"{differing} of {found['points']}" if differing else "0")
        row.append(_error(found["cpu_max_error"]))
        row.append("" if found.get("wgsl_max_error") is None else _error(found["wgsl_max_error"]))
        row.append("" if found.get("wgsl_max_ulp") is None else str(found["wgsl_max_ulp"]))
        beyond, explained = found.get("wgsl_beyond"), found.get("wgsl_explained") or 0
        if beyond:
            of_all = f"{beyond} of {found.get('wgsl_points') or 0}"
            row.append(f"{of_all} ({explained} within their rounding bound)")
        else:
            row.append("" if beyond is None else "0")
        row += _costs(costs.get(found["mode"]))
        rows.append(row)
    return Drawn(MODES, rows)


def _costs(found):
    if found is None:
        return ["not measured", "", "", "", ""]
    # What is taken off an evaluation in WGSL may be more than its spread leaves.
    wgsl = found.get("wgsl_ns")
    times = [found["cloudparity_ns"], found["oracle_ns"], None if wgsl is None else max(wgsl, 0.0)]
    cells = ["" if time is None else _nanoseconds(time) for time in times]
    spread, cycles = found.get("cycles_spread_ns"), found.get("cycles_ns")
    apart = "" if spread is None else f" ± {_nanoseconds(spread)}"
    cells.append("" if cycles is None else _nanoseconds(cycles) + apart)
    cells.append("" if found.get("ratio") is None else _ratio(found["ratio"]))
    return cells
