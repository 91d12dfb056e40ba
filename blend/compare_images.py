"""Compares scene-linear EXR images and makes the pictures of a report. Runs with or without bpy.

Requests (`op` chooses; files are paths; `part` is null or names the picture in files with several, and
`integers` is null or says what integer values are, both as picture_file.read has them; SETTINGS is
"view": "AgX", "look": "None", "exposure": 0, "gamma": 1, "background": null or [r, g, b]):

  {"op": "diff", "ours": [EXR...], "reference": [EXR...], "part": null, "integers": null,
   "ours_part": null, "reference_part": null (instead of `part`), "block": 8, "pixel_threshold": 0.001,
   "tolerances": {"channel_mean_relative": 0.01, "block_relmse": 0.01}, "out": DIR or null, "range": null,
   "display": null or {SETTINGS},
   "program": what asks (optional),
   "statistics": null or {"significance": 0.01, "systematic_allowance": null or 0.002,
                          "debiased_relmse": 0.001, "sub_pixels": null or 4}}
  {"op": "display", "images": [{"exr": EXR or [EXR...], "png": PNG, "part": null, "channels": "rgba" or "rgb",
                                  SETTINGS}]}
  {"op": "cube", "axis": [LINEAR...], "values": NPY, "view", "look", "gamma"}
  {"op": "combine", "images": [EXR...], "mean": EXR, "variance": EXR}
  {"op": "difference_map", "ours": [EXR...], "reference": [EXR...], "prefix": PATH, "part": null,
   "range": null}
  {"op": "plain", "images": [{"exr": PICTURE, "plain": EXR}], "part": null, "option": "--part"}
  {"op": "flip", "pairs": [{"ours": [EXR...], "reference": [EXR...]}]}
  {"op": "field_slices", "slices": [{"title", "ours": NPY, "reference": NPY or null, "png_prefix": PATH}]}

Several files on a side are replicas: the same picture with other seeds. They are averaged, and their spread
gives standard errors. `diff` has the verdict "agrees", "differs" or "could_not_tell", by the caller's
tolerances and `statistics` alone; the possible tolerances are in TOLERANCES. NaN or infinity on either side
is "differs" before any figure; images that cannot be compared are "could_not_tell" with the reason. `out`
receives diff.json and the difference pictures, with `display` also ours.png and reference.png: what a report
reads. `statistics` adds the checks of replica_statistics.py, which judge whether two sets of replicas show
the same picture; `sub_pixels` n takes one file per side, at n times the resolution per axis, as n^2 replicas
in pairs.
"""

import importlib.metadata
import json
import math
import os
import platform

import numpy as np
import OpenImageIO as oiio

import display_picture
import false_colour
import image_metrics
import picture_file
import protocol

SCRIPT = "compare_images.py"

# Each tolerance and what it limits; values are at least 0, and equal to the limit still agrees.
TOLERANCES = {
    "channel_mean_relative": "relative difference of the mean of the worst channel",
    "block_relmse": "relMSE of block means",
    "pixel_relmse": "relMSE of pixels",
    "max_error": "largest absolute difference of a colour value",
    "failing_share": "share of pixels over the pixel threshold",
    "alpha_max_error": "largest absolute difference of alpha",
    "flip_mean": "mean HDR-FLIP error",
}
DEFAULT_BLOCK = 8
DEFAULT_PIXEL_THRESHOLD = 1e-3
MAP_QUANTILE = 0.95  # the automatic range of a difference map covers this share of the lit pixels
RELMSE_DECADES = (-6, 0)  # range of the map of relative squared differences, powers of ten
AS_IT_IS = {"view": "Raw", "look": "None", "exposure": 0.0, "gamma": 1.0}  # how display values are shown
ERROR_DECADES = (-8, 0)  # range of the logarithmic error maps, powers of ten


def handle(request, messages):
    """Run the operation that the request names."""
    operations = {
        "diff": diff,
        "display": display,
        "cube": cube,
        "combine": combine,
        "difference_map": difference_map,
        "field_slices": field_slices,
        "flip": flip,
        "plain": plain,
    }
    name = request["op"]
    if name not in operations:
        raise protocol.InputError(
            "request.op", repr(name), f"one of {', '.join(operations)}", "correct the request"
        )
    return operations[name](request, messages)


# --- requests ---------------------------------------------------------------


def files_read(request):
    """The files that a request names to be read."""
    found = []
    for holder in [
        request,
        *request.get("images", []),
        *request.get("pairs", []),
        *request.get("slices", []),
    ]:
        # The pictures of `combine` are names, not objects with names.
        names = (
            [holder] if isinstance(holder, str) else [holder.get(key) for key in ("exr", "ours", "reference")]
        )
        for name in names:
            found.extend(name if isinstance(name, list) else [name] if name else [])
    return found


def _paths(request, key):
    value = request[key]
    if not isinstance(value, list) or not value or not all(isinstance(item, str) for item in value):
        raise protocol.InputError(
            f"{request.place}.{key}",
            json.dumps(value),
            "a list of one or more file names",
            "name the EXR files",
        )
    return value


def _number(request, key, default, low, high=math.inf):
    value = request.get(key)
    if value is None:
        value = default
    if value is None:
        return None
    good = isinstance(value, int | float) and not isinstance(value, bool) and math.isfinite(value)
    if not good or not low <= value <= high:
        raise protocol.InputError(
            f"{request.place}.{key}",
            json.dumps(value),
            f"a number from {low} to {high}",
            "correct the request",
        )
    return value


def _tolerances(request):
    given = request["tolerances"]
    for key in given:
        if key not in TOLERANCES:
            raise protocol.InputError(
                f"{given.place}.{key}",
                "an unknown tolerance",
                f"one of {', '.join(TOLERANCES)}",
                "correct the request",
            )
        _number(given, key, None, 0)
    return {key: float(given[key]) for key in TOLERANCES if given.get(key) is not None}


def _replica_statistics():
    """The module of the statistical verdict; imported where it is asked for, because scipy takes its time."""
    try:
        import replica_statistics
    except ImportError as error:
        raise protocol.InputError(
            "request.statistics", str(error), "the Python package scipy", "run make setup"
        ) from None
    return replica_statistics


def _statistics_settings(request):
    """The settings of the statistical verdict, or None where it was not asked for."""
    given = request.get("statistics")
    if given is None:
        return None
    cells = _number(given, "sub_pixels", None, 2, 64)
    if cells is not None and cells != int(cells):
        raise protocol.InputError(
            f"{given.place}.sub_pixels", str(cells), "a whole number", "name the cells' edge in pixels"
        )
    return {
        "significance": _number(
            given, "significance", _replica_statistics().DEFAULT_SIGNIFICANCE, 1e-12, 0.5
        ),
        "systematic_allowance": _number(given, "systematic_allowance", None, 0, 1),
        "debiased_relmse": _number(given, "debiased_relmse", _replica_statistics().DEFAULT_RELMSE_LIMIT, 0),
        "sub_pixels": None if cells is None else int(cells),
        "is_paired": cells is not None,
    }


def _set_allowance(settings, reference):
    """Fill in the systematic allowance and where it comes from."""
    if settings["systematic_allowance"] is not None:
        settings["allowance_rule"] = "chosen by the caller"
        return
    facts = reference.files[0]["provenance"]
    found = _replica_statistics().default_allowance(
        facts["samples"], facts["renderer"], by_subset=facts["subset"] is not None
    )
    if found is None:
        raise image_metrics.Unreadable(
            "no systematic allowance is known for this reference (renderer "
            f"{facts['renderer'] or 'not named'}, samples {facts['samples'] or 'not named'}; the rule "
            "covers Cycles "
            "with 64 samples or more). Choose one, 0 for none: --systematic-allowance 0."
        )
    settings["systematic_allowance"], settings["allowance_rule"] = found


def _choice(request, which=None):
    """What picture_file.read takes, of a request and a side of it."""
    own = request.get(f"{which}_part") if which else None
    return {
        "part": own or request.get("part"),
        "integers": request.get("integers"),
        "option": f"--{which}-part" if which else request.get("option") or "--part",
    }


def _scene_linear(request):
    """The same for requests that take radiance alone: integers are rejected by what they are."""
    return _choice(request) | {"integers": picture_file.LINEAR}


def _check_radiance(picture):
    if picture.meaning != "radiance":
        raise image_metrics.Unreadable("its values are integers, which are no radiance")


def _load_pair(request, block, messages, statistics=None):
    """Both sides, with the channels that both have, and notes on what else they have."""
    cells = statistics["sub_pixels"] if statistics else None
    names = ("ours", "reference")
    paths = [_paths(request, name) for name in names]
    total, sides = len(paths[0]) + len(paths[1]), []

    def load(index, as_luminance=False):
        def progress(file):
            messages.progress(0.8 * (len(paths[0]) * index + file) / total, f"reading {names[index]}")

        try:
            return image_metrics.load_side(
                paths[index],
                block,
                progress,
                statistics is not None,
                cells,
                as_luminance,
                **_choice(request, names[index]),
            )
        except image_metrics.Unreadable as error:
            raise image_metrics.Unreadable(f"{names[index]}: {error}") from None

    sides = [load(index) for index in (0, 1)]
    is_grey = ["Y" in side.names and "X" not in side.names for side in sides]
    for index, side in enumerate(sides):
        if is_grey[1 - index] and all(name in side.names for name in "RGB"):
            sides[index] = load(index, as_luminance=True)
            sides[index].notes.append(
                f"{names[1 - index]} has luminance alone; the Rec.709 luminance of {names[index]} is "
                "compared."
            )
    image_metrics.check_comparable(*sides)
    shared = [name for name in sides[1].names if name in sides[0].names]
    for index, side in enumerate(sides):
        if "A" in side.names and "A" not in shared:
            side.notes.append(
                f"{names[1 - index]} has no alpha; colours alone are compared, with alpha multiplied in."
            )
    for side in sides:
        image_metrics.reorder(side, shared)
    if sides[0].origin != sides[1].origin:
        sides[0].notes.append(
            f"the display windows begin at {sides[0].origin} and {sides[1].origin}; pixels are compared by "
            "their places within them."
        )
    if statistics is not None:
        image_metrics.check_replicas(dict(zip(names, sides, strict=True)), cells)
        _set_allowance(statistics, sides[1])
    return sides


# --- diff -------------------------------------------------------------------


def diff(request, messages):
    """Compare two sides; see the head of this file."""
    block = int(_number(request, "block", DEFAULT_BLOCK, 1, 4096))
    threshold = _number(request, "pixel_threshold", DEFAULT_PIXEL_THRESHOLD, 0)
    tolerances = _tolerances(request)
    settings = _statistics_settings(request)
    result = {
        "verdict": "could_not_tell",
        "reasons": [],
        "checks": [],
        "tolerances": tolerances,
        "notes": [],
        "images": None,
        "finite": None,
        "colour": None,
        "alpha": None,
        "channels": None,
        "relmse": None,
        "flip": None,
        "statistics": None,
        "map": None,
        "files": {},
        "versions": {
            "OpenImageIO": oiio.VERSION_STRING,
            "numpy": np.__version__,
            "python": platform.python_version(),
            # Of the program that asks, where it says which it is.
            **({"cloudparity": request["program"]} if "program" in request else {}),
        },
    }
    flip_map = sides = maps = None
    try:
        sides = _load_pair(request, block, messages, settings)
        ours, reference = sides
        result["images"] = _describe_images(request, ours, reference)
        result["finite"] = {"ours": ours.bad, "reference": reference.bad}
        result["notes"] = _notes(ours, reference)
        bad = [
            f"{which} has {side.bad['nan']} NaN and {side.bad['infinite']} infinite values"
            for which, side in (("ours", ours), ("reference", reference))
            if side.bad["nan"] or side.bad["infinite"]
        ]
        if bad:
            result["verdict"], result["reasons"] = (
                "differs",
                [f"{text}; no other figure is computed." for text in bad],
            )
            sides = None
        else:
            messages.progress(0.85, "comparing")
            flip_map = _figures(result, ours, reference, block, threshold)
            result["checks"] = _checks(result, tolerances)
            if settings is not None:
                messages.progress(0.9, "statistics")
                maps = _judge_replicas(result, ours, reference, settings)
            _decide(result)
    except image_metrics.Unreadable as error:
        result["reasons"] = [str(error)]
    if request.get("out") is not None:
        messages.progress(0.95, "writing pictures")
        _write_outputs(result, request, sides, flip_map, maps)
    return result


def _judge_replicas(result, ours, reference, settings):
    """Add the statistical verdict to the result; returns its maps."""
    statistics, checks, notes, maps = _replica_statistics().judge(
        ours.stack,
        reference.stack,
        reference.names,
        reference.indices("colour"),
        reference.indices("alpha"),
        settings,
    )
    result["statistics"] = statistics
    result["versions"]["scipy"] = importlib.metadata.version("scipy")
    result["checks"] += checks
    result["notes"] += notes
    return maps


def _describe_images(request, ours, reference):
    return {
        "ours": _describe_side(ours),
        "reference": _describe_side(reference),
        "width": reference.size[0],
        "height": reference.size[1],
        "channels": reference.names,
        "part": request.get("part"),
    }


def _describe_side(side):
    return {
        "files": _names(side),
        "replicas": side.replicas,
        "colour_space": side.colour_space,
        "picture": side.picture,
        "values": side.meaning,
    }


def _names(side):
    return [{key: file[key] for key in ("file", "sha256")} for file in side.files]


def _notes(ours, reference):
    notes = []
    for which, side in (("ours", ours), ("reference", reference)):
        hashes = [item["sha256"] for item in side.files]
        if len(set(hashes)) < len(hashes):
            notes.append(f"Some replicas of {which} are the same file, so its standard error is too small.")
        if side.bad["negative"]:
            notes.append(
                f"{which} has {side.bad['negative']} negative values; they are compared as they are."
            )
        notes += [f"{which}: {note}" for note in side.notes]
        if not side.colour_space and side.meaning == "radiance":
            notes.append(f"{which} declares no colour space; linear Rec.709 is assumed.")
    shared = {item["sha256"] for item in ours.files} & {item["sha256"] for item in reference.files}
    if shared:
        notes.append(f"{len(shared)} file(s) are on both sides, so the two sides are not independent.")
    return notes


def _figures(result, ours, reference, block, threshold):
    """Fill in every figure; returns the FLIP map or None."""
    colour, alpha = reference.indices("colour"), reference.indices("alpha")
    a, b = ours.mean[..., colour], reference.mean[..., colour]
    names = [reference.names[i] for i in colour]
    result["colour"] = image_metrics.openimageio_figures(a, b, names, threshold)
    if alpha:
        pair = ours.mean[..., alpha], reference.mean[..., alpha]
        result["alpha"] = image_metrics.openimageio_figures(
            *pair, [reference.names[i] for i in alpha], threshold
        )
    result["channels"] = image_metrics.channel_means(ours, reference)
    result["relmse"] = image_metrics.relmse(ours, reference, block)
    result["flip"], flip_map = image_metrics.hdr_flip(a, b, reference.meaning)
    return flip_map


def _checks(result, tolerances):
    checks = []
    for name, limit in tolerances.items():
        if name == "channel_mean_relative":
            value, outcome, reason = _check_means(result["channels"], limit)
        elif name in ("block_relmse", "pixel_relmse"):
            value, outcome, reason = _check_relmse(result["relmse"], name.split("_")[0], limit)
        else:
            value, outcome, reason = _check_value(name, _plain_value(result, name), limit)
            if name == "alpha_max_error" and value is None:
                reason = "Alpha is not in both pictures."
        checks.append({"name": name, "value": value, "limit": limit, "outcome": outcome, "reason": reason})
    return checks


def _plain_value(result, name):
    if name == "flip_mean":
        return result["flip"]["mean"]
    if name == "alpha_max_error":
        return result["alpha"]["max_error"] if result["alpha"] else None
    return result["colour"][name]


def _check_value(name, value, limit):
    what = TOLERANCES[name]
    if value is None:
        return None, "could_not_tell", f"The {what} could not be computed."
    outcome = "agrees" if value <= limit else "differs"
    relation = "within" if outcome == "agrees" else "over"
    return value, outcome, f"The {what} is {value:.4g}, {relation} the limit {limit:.4g}."


def _check_means(channels, limit):
    """Judge the worst channel; where the known noise is too large for the limit, say so instead of guessing.

    A mean agrees only if its standard error is at most half the limit, and differs only if it is off by the
    limit and three standard errors.
    """
    if any(row["relative_difference"] is None for row in channels):
        dark = ", ".join(row["channel"] for row in channels if row["relative_difference"] is None)
        return (
            None,
            "could_not_tell",
            f"The reference's mean of {dark} is 0, so no relative difference exists.",
        )
    worst = max(channels, key=lambda row: abs(row["relative_difference"]))
    value, error = worst["relative_difference"], worst["standard_error_relative"]
    text = f"Channel {worst['channel']} has a mean {_signed_percent(value)} from the reference's"
    text += f", limit {100 * limit:.4g} %"
    text += (
        f", standard error {100 * error:.2g} %."
        if error is not None
        else "; no replicas, so its noise is unknown."
    )
    noise = max((row["standard_error_relative"] or 0.0) for row in channels)
    if abs(value) > limit + 3 * noise:
        return value, "differs", text
    if noise > limit / 2 or (abs(value) > limit and noise > 0):
        return (
            value,
            "could_not_tell",
            text + " The noise is too large for this limit: add replicas or samples.",
        )
    return value, "agrees" if abs(value) <= limit else "differs", text


def _signed_percent(value):
    return "0 %" if value == 0 else f"{100 * value:+.3g} %"


def _check_relmse(relmse, kind, limit):
    value, noise = relmse[kind], relmse[f"noise_{kind}"]
    where = f"{relmse['block_size']} x {relmse['block_size']} block means" if kind == "block" else "pixels"
    if value is None:
        return None, "could_not_tell", f"The reference is black, so the relMSE of {where} does not exist."
    text = f"The relMSE of {where} is {value:.3g}, limit {limit:.3g}"
    text += (
        f"; noise of {' and '.join(relmse['noise_from'])} alone adds {noise:.2g}."
        if noise is not None
        else "."
    )
    if value <= limit:
        return value, "agrees", text
    if noise is not None and value - noise <= limit:
        return value, "could_not_tell", text + " Without that noise it may agree: add replicas or samples."
    return value, "differs", text


def _decide(result):
    outcomes = [check["outcome"] for check in result["checks"]]
    if not outcomes:
        result["reasons"] = [
            "No tolerance was given, so nothing was judged. Name one in `tolerances`, or give replicas "
            "of both sides."
        ]
        return
    verdict = next((word for word in ("differs", "could_not_tell") if word in outcomes), "agrees")
    result["verdict"] = verdict
    result["reasons"] = [check["reason"] for check in result["checks"] if check["outcome"] == verdict]
    if verdict == "agrees" and result["statistics"] is not None:
        told = [check["reason"] for check in result["checks"] if check["name"] == "image_mean"]
        result["reasons"] = [f"All {len(outcomes)} checks agree, none for want of sensitivity.", *told]


def _write_outputs(result, request, sides, flip_map, maps):
    folder = request["out"]
    if sides is not None:
        ours, reference = sides
        result["map"] = _write_difference_maps(ours, reference, os.path.join(folder, "difference"), request)
        result["files"] = result["map"].pop("files")
        if flip_map is not None:
            lines = ["HDR-FLIP error", "0: no visible difference"]
            picture = false_colour.colour(flip_map, 0.0, 1.0, false_colour.SEQUENTIAL)
            legend = false_colour.legend(lines, false_colour.SEQUENTIAL, false_colour.linear_ticks(0, 1))
            result["files"] |= _write_picture(os.path.join(folder, "flip"), "flip", picture, legend)
        if maps is not None:
            result["files"] |= _write_statistics_maps(folder, maps, reference)
        display = request.get("display")
        if display is not None:
            if reference.meaning == picture_file.DISPLAY:
                # These are display values: they are shown as they are.
                display = protocol.located(display | AS_IT_IS, display.place)
            for which, side in (("ours", ours), ("reference", reference)):
                shown = _write_display(side, display, os.path.join(folder, f"{which}.png"))
                result["files"] |= {which: shown["png"], f"{which}_view": shown["view_used"]}
        result["files"] = {key: os.path.basename(name) for key, name in result["files"].items()}
    text = json.dumps(result, indent=1, ensure_ascii=False, allow_nan=False) + "\n"
    display_picture.write_text(os.path.join(folder, "diff.json"), text)


def _write_statistics_maps(folder, maps, reference):
    """t.png (luminance, -4 to 4), relmse.png (decades), and t.exr with t of every colour channel."""
    reach = _replica_statistics().T_RANGE
    picture = false_colour.colour(maps["t"], -reach, reach, false_colour.DIVERGING)
    lines = ["t of the luminance: difference in standard errors", "blue: ours darker, orange: ours brighter"]
    legend = false_colour.legend(lines, false_colour.DIVERGING, false_colour.linear_ticks(-reach, reach))
    files = _write_picture(os.path.join(folder, "t"), "t", picture, legend)
    with np.errstate(divide="ignore"):
        logarithm = np.where(maps["relmse"] > 0, np.log10(maps["relmse"]), -np.inf)
    picture = false_colour.colour(
        np.maximum(logarithm, RELMSE_DECADES[0]), *RELMSE_DECADES, false_colour.SEQUENTIAL
    )
    lines = ["Squared relative difference, mean of the channels", "(o - r)^2 / (r^2 + e^2), noise included"]
    legend = false_colour.legend(lines, false_colour.SEQUENTIAL, false_colour.decade_ticks(*RELMSE_DECADES))
    files |= _write_picture(os.path.join(folder, "relmse"), "relmse", picture, legend)
    files["t_exr"] = os.path.join(folder, "t.exr")
    names = [reference.names[i] for i in reference.indices("colour")]
    display_picture.write_exr(files["t_exr"], maps["t_channels"], names)
    return files


# --- display ----------------------------------------------------------------


def cube(request, messages):
    """Display values of all colours of an axis, [red, green, blue, channel], and which view was used."""
    axis = np.asarray(request["axis"], np.float32)
    colours = np.stack(np.meshgrid(axis, axis, axis, indexing="ij"), axis=-1)
    view = display_picture.Display(request["view"], request["look"], 0.0, request["gamma"])
    values = view.apply(colours.reshape(len(axis), -1, 3)).reshape(colours.shape)
    np.save(request["values"], values.astype(np.float32))
    return {"view_used": view.used}


def display(request, messages):
    """Make display pictures; the result says for each which view was used."""
    results = []
    for index, item in enumerate(request["images"]):
        messages.progress(index / len(request["images"]), f"picture {index + 1}")
        paths = item["exr"] if isinstance(item["exr"], list) else [item["exr"]]
        try:
            side = image_metrics.load_side(paths, DEFAULT_BLOCK, **_scene_linear(item))
            _check_radiance(side)
        except image_metrics.Unreadable as error:
            raise protocol.InputError(
                ", ".join(paths), str(error), "a readable scene-linear EXR", "give another file"
            ) from None
        results.append(_write_display(side, item, item["png"]))
    return {"images": results}


def plain(request, messages):
    """Write the picture of each file as a plain EXR, with what the file says of its making."""
    for index, item in enumerate(request["images"]):
        messages.progress(index / len(request["images"]), f"picture {index + 1}")
        try:
            picture = picture_file.read(item["exr"], **_scene_linear(request))
            _check_radiance(picture)
            attributes = image_metrics.shared_attributes([item["exr"]])
            attributes.pop("colorInteropID", None)
            pixels, names = picture_file.colours(picture)
        except image_metrics.Unreadable as error:
            raise protocol.InputError(
                item["exr"], str(error).rstrip("."), "a scene-linear picture", "give another file"
            ) from None
        display_picture.write_exr(item["plain"], pixels, names, attributes)
        for note in picture.notes:
            messages.warning(item["exr"], note)
    return {}


def flip(request, messages):
    """Mean HDR-FLIP of pairs, the exposures by each pair's reference; null where it is not computed."""
    means, references = [], {}
    for index, pair in enumerate(request["pairs"]):
        messages.progress(index / len(request["pairs"]), f"pair {index + 1}")
        sides = []
        for name in ("ours", "reference"):
            paths = tuple(pair[name])
            try:
                # Many pairs share their reference.
                side = references.get(paths) or image_metrics.load_side(list(paths), DEFAULT_BLOCK)
            except image_metrics.Unreadable as error:
                raise protocol.InputError(
                    f"{pair.place}.{name}", str(error), "a readable scene-linear EXR", "give another file"
                ) from None
            if name == "reference":
                references[paths] = side
            sides.append(side.mean[..., side.indices("colour")])
        if sides[0].shape != sides[1].shape:
            raise protocol.InputError(
                f"{pair.place}",
                f"{sides[0].shape} and {sides[1].shape}",
                "pictures of one size",
                "give others",
            )
        figures, _ = image_metrics.hdr_flip(*sides)
        means.append(figures["mean"])
    return {"means": means}


def _write_display(side, settings, png):
    """Write one display picture: RGBA for a film with alpha; over a background, RGB beside it."""
    colour, alpha = side.indices("colour"), side.indices("alpha")
    rgb = side.mean[..., colour if len(colour) == 3 else [colour[0]] * 3]
    exposure = _number(settings, "exposure", settings["exposure"], -64, 64)
    gamma = _number(settings, "gamma", settings["gamma"], 0.01, 100)
    view = display_picture.Display(settings["view"], settings["look"], exposure, gamma)
    background = settings.get("background")
    result = {"png": png, "png_alpha": None, "view_used": view.used, "background": background}
    channels = settings.get("channels") or "rgba"
    if channels not in ("rgba", "rgb"):
        raise protocol.InputError(
            f"{settings.place}.channels", repr(channels), "rgba or rgb", "correct the request"
        )
    # Blender divides by alpha only where it writes alpha, so neither does this.
    if not alpha or (channels == "rgb" and background is None):
        display_picture.write_png(png, display_picture.to_uint8(view.apply(rgb)))
        return result
    coverage = side.mean[..., alpha[0]]
    transparent = display_picture.straight_rgba(view, rgb, coverage)
    if background is None:
        display_picture.write_png(png, transparent)
        return result | {"png_alpha": png}
    if not (isinstance(background, list) and len(background) == 3 and all(map(_is_radiance, background))):
        raise protocol.InputError(
            f"{settings.place}.background",
            json.dumps(background),
            "null or three scene-linear values of at least 0",
            "correct it",
        )
    display_picture.write_png(png, display_picture.over(view, rgb, coverage, background))
    result["png_alpha"] = f"{os.path.splitext(png)[0]}-alpha.png"
    display_picture.write_png(result["png_alpha"], transparent)
    return result


def _is_radiance(value):
    return isinstance(value, int | float) and not isinstance(value, bool) and 0 <= value < math.inf


# --- replicas ---------------------------------------------------------------


def combine(request, messages):
    """Write the mean of replicas and the variance of one of them (K - 1 degrees of freedom) per value."""
    paths = _paths(request, "images")
    try:
        side = image_metrics.load_side(paths, DEFAULT_BLOCK, keep=True, **_choice(request))
        image_metrics.check_one_side("images", side)
    except image_metrics.Unreadable as error:
        raise protocol.InputError(
            f"{request.place}.images", str(error), "replicas of one picture", "render them again"
        ) from None
    attributes = image_metrics.shared_attributes(paths)
    attributes |= {
        "cloudparity:replicas": side.replicas,
        "cloudparity:seeds": json.dumps([file["provenance"]["seed"] for file in side.files]),
        "cloudparity:replicas_sha256": json.dumps([file["sha256"] for file in side.files]),
    }
    for name, pixels, what in (
        ("mean", side.mean, "mean over the replicas"),
        ("variance", side.pixel_variance, "variance of one replica, squared values"),
    ):
        display_picture.write_exr(
            request[name], pixels, side.names, attributes | {"cloudparity:content": what}
        )
    return {"mean": request["mean"], "variance": request["variance"], "replicas": side.replicas}


# --- difference maps --------------------------------------------------------


def difference_map(request, messages):
    """Write the signed relative and the absolute difference map of two sides."""
    try:
        ours, reference = _load_pair(request, DEFAULT_BLOCK, messages)
    except image_metrics.Unreadable as error:
        raise protocol.InputError(
            request.place, str(error), "two comparable images", "render both with the same film settings"
        ) from None
    return _write_difference_maps(ours, reference, request["prefix"], request)


def _write_difference_maps(ours, reference, prefix, request):
    colour = reference.indices("colour")
    a, b = ours.mean[..., colour], reference.mean[..., colour]
    bright_a, bright_b = image_metrics.luminance(a), image_metrics.luminance(b)
    epsilon = image_metrics.RELATIVE_EPSILON * abs(float(np.nanmean(bright_b)))
    with np.errstate(invalid="ignore", divide="ignore"):
        scale = np.sqrt(bright_b**2 + epsilon**2)
        relative = np.where(bright_a == bright_b, 0.0, (bright_a - bright_b) / scale)
        absolute = np.abs(a - b).max(axis=-1)
    lit = np.isfinite(relative) & ((bright_a > epsilon) | (bright_b > epsilon))
    limit = _number(request, "range", None, 1e-12)
    automatic = limit is None
    if automatic:
        limit = _round_up(float(np.quantile(np.abs(relative[lit]), MAP_QUANTILE)) if lit.any() else 0.0)
    top = _round_up(float(np.quantile(absolute[lit], MAP_QUANTILE)) if lit.any() else 0.0)

    signed = false_colour.colour(relative, -limit, limit, false_colour.DIVERGING)
    lines = ["Relative luminance difference", "blue: ours darker, orange: ours brighter"]
    ticks = false_colour.linear_ticks(-100 * limit, 100 * limit, unit=" %")
    files = _write_picture(
        prefix, "difference", signed, false_colour.legend(lines, false_colour.DIVERGING, ticks)
    )
    picture = false_colour.colour(absolute, 0.0, top, false_colour.SEQUENTIAL)
    unit = "display values" if reference.meaning == picture_file.DISPLAY else "linear radiance"
    lines = [f"Absolute difference, {unit}", "of the worst colour channel"]
    legend = false_colour.legend(lines, false_colour.SEQUENTIAL, false_colour.linear_ticks(0, top))
    files |= _write_picture(f"{prefix}_absolute", "difference_absolute", picture, legend)
    return {
        "files": files,
        "formula": "(Y_ours - Y_reference) / sqrt(Y_reference^2 + epsilon^2), Y = Rec.709 luminance",
        "epsilon": epsilon,
        "range": limit,
        "range_rule": "covers 95 % of the lit pixels" if automatic else "chosen by the caller",
        "clipped_share": float((np.abs(relative) > limit).mean()),
        "absolute_range": top,
        "absolute_clipped_share": float((absolute > top).mean()),
    }


def _round_up(value):
    """The next of 1, 2, 5 times a power of ten; 1e-6 for 0, so that a scale is never empty."""
    if value <= 1e-6:
        return 1e-6
    power = 10.0 ** math.floor(math.log10(value))
    factor = next((f for f in (1.0, 2.0, 5.0, 10.0) if value <= f * power * (1 + 1e-9)), 10.0)
    return float(f"{factor * power:.1e}")


def _write_picture(prefix, key, picture, legend):
    files = {key: f"{prefix}.png", f"{key}_legend": f"{prefix}_legend.svg"}
    display_picture.write_png(files[key], picture)
    display_picture.write_text(files[f"{key}_legend"], legend)
    return files


# --- field slices -----------------------------------------------------------


def field_slices(request, messages):
    """Pictures of planar slices of a field and of their error; row 0 of an array is the upper row."""
    results = []
    for index, item in enumerate(request["slices"]):
        messages.progress(index / len(request["slices"]), str(item["title"]))
        ours = image_metrics.input_array(item["ours"], f"{item.place}.ours")
        reference = None
        if item.get("reference") is not None:
            reference = image_metrics.input_array(item["reference"], f"{item.place}.reference")
            if reference.shape != ours.shape:
                raise protocol.InputError(
                    f"{item.place}.reference",
                    f"shape {list(reference.shape)}",
                    f"shape {list(ours.shape)}, as ours",
                    "evaluate both at the same points",
                )
        results.append(_write_slice(item["title"], ours, reference, item["png_prefix"]))
    return {"slices": results}


def _write_slice(title, ours, reference, prefix):
    shown = ours if reference is None else np.stack([ours, reference])
    finite = shown[np.isfinite(shown)]
    low, high = (float(finite.min()), float(finite.max())) if finite.size else (0.0, 0.0)
    table = false_colour.SEQUENTIAL
    picture = false_colour.colour(ours.astype(np.float64), low, high, table)
    swatches = [(false_colour.NOT_FINITE, "not finite")] if finite.size < shown.size else []
    ticks = false_colour.linear_ticks(low, high) if high > low else [(0.5, false_colour.figure(low))]
    files = _write_picture(
        f"{prefix}_field",
        "field",
        picture,
        false_colour.legend(["Value, linear scale"], table, ticks, swatches),
    )
    result = {
        "title": title,
        "field_png": os.path.basename(files["field"]),
        "field_legend": os.path.basename(files["field_legend"]),
        "error_png": None,
        "error_legend": None,
        "low": low,
        "high": high,
        "equal_share": None,
        "max_error": None,
        "one_sided_nonfinite": None,
        "error_formula": None,
    }
    if reference is None:
        return result
    equal = (ours == reference) | (np.isnan(ours) & np.isnan(reference))
    one_sided = (np.isfinite(ours) != np.isfinite(reference)) & ~equal
    a, b = ours.astype(np.float64), reference.astype(np.float64)
    known = np.abs(b[np.isfinite(b)])
    scale = max(1.0, float(known.max())) if known.size else 1.0
    with np.errstate(invalid="ignore"):
        error = np.where(equal, 0.0, np.abs(a - b) / scale)
    both = np.isfinite(error)
    decades, table = ERROR_DECADES, false_colour.SEQUENTIAL_REVERSED[32:]
    with np.errstate(divide="ignore"):
        logarithm = np.where(both & ~equal, np.log10(np.where(error > 0, error, 1.0)), np.nan)
    picture = _log_picture(logarithm, decades, table, equal)
    formula = "|ours - reference| / max(1, max |reference|)"
    swatches = [(false_colour.EQUAL, "exactly equal"), (false_colour.NOT_FINITE, "not finite on one side")]
    legend = false_colour.legend([formula], _full(table), false_colour.decade_ticks(*decades), swatches)
    files = _write_picture(f"{prefix}_error", "error", picture, legend)
    result.update(
        error_png=os.path.basename(files["error"]),
        error_legend=os.path.basename(files["error_legend"]),
        equal_share=float(equal.mean()),
        max_error=float(error[both].max()) if both.any() else None,
        one_sided_nonfinite=int(one_sided.sum()),
        error_formula=formula,
    )
    return result


def _full(table):
    """Stretch a part of a colour table to the length of a whole one."""
    return table[np.linspace(0, len(table) - 1, false_colour.STEPS).round().astype(int)]


def _log_picture(logarithm, decades, table, equal):
    picture = false_colour.colour(logarithm, decades[0], decades[1], _full(table))
    picture[equal] = false_colour.EQUAL
    return picture


if __name__ == "__main__":
    protocol.serve(SCRIPT, handle, needs_bpy=False, reads=files_read)
