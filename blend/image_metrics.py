"""Scene-linear images and the figures that compare two of them.

`load_side` reads the replicas of one side (independent renders of one picture, same settings, other seeds)
and keeps their mean and the spread of their means. The functions below it turn two sides into figures. Every
formula that is known under several definitions is written out in the result together with its epsilon.

Limits: one picture of each file (picture_file.py finds it); rows count from the top, pixels from 0, in the
display window.
"""

import hashlib
import math
import os

import numpy as np
import OpenImageIO as oiio

import picture_file
import protocol
from picture_file import Unreadable, first_line

LUMINANCE_WEIGHTS = (0.2126, 0.7152, 0.0722)  # Rec.709 primaries, D65
RELATIVE_EPSILON = 0.01  # epsilon of every relative figure, as a share of the mean of the reference
FLIP_MIDTONE = 0.85  # FLIP's exposures map the median and the maximum of the reference to this display value
FLIP_TONEMAPPER = "ACES"


class Side:
    """The replicas of one side, averaged.

    files: [{"file", "sha256"}]; names: channel names; size: width, height;
    origin: x, y of the display window; meaning: "radiance" or one of picture_file.INTEGERS;
    picture: part and layer in the files; notes: sentences;
    mean: float64 [h, w, c] over the replicas;
    pixel_variance: float64 [h, w, c] of one replica, or None for a single file;
    image_means: float64 [k, c], one row per replica; block_means: float64 [k, by, bx, c];
    bad: counts of NaN, infinite and negative values;
    stack: float32 [k, h, w, c], every replica, or None where they were not kept.
    """

    def __init__(
        self,
        files,
        facts,
        mean,
        pixel_variance,
        image_means,
        block_means,
        bad,
        stack=None,
    ):
        self.files = files
        self.names = facts["names"]
        self.size = facts["size"]
        self.origin = facts["origin"]
        self.colour_space = facts["space"]
        self.meaning = facts["meaning"]
        self.picture = facts["picture"]
        self.notes = facts["notes"]
        self.mean = mean
        self.pixel_variance = pixel_variance
        self.image_means = image_means
        self.block_means = block_means
        self.bad = bad
        self.stack = stack

    @property
    def replicas(self):
        """Number of files of this side."""
        return len(self.files)

    def indices(self, kind):
        """Positions of the "colour" channels (R, G, B, or else all but alpha), or of "alpha" ([] if none)."""
        last = [name.rsplit(".", 1)[-1] for name in self.names]
        alpha = [i for i, name in enumerate(last) if name == "A"]
        if kind == "alpha":
            return alpha
        if all(name in last for name in "RGB"):
            return [last.index(name) for name in "RGB"]
        return [i for i in range(len(last)) if i not in alpha]


def sha256(path):
    """SHA-256 of a file as 64 hexadecimal digits."""
    with open(path, "rb") as stream:
        return hashlib.file_digest(stream, "sha256").hexdigest()


def check_replicas(sides, cells):
    """Raise Unreadable unless the kept replicas of both sides can be replicas: {"ours": Side, ...}.

    Equal pixels under other seeds are those of an exact estimator; equal pixels without seeds are a copy.
    """
    for which, side in sides.items():
        if cells is None:
            check_one_side(which, side)
        elif side.replicas != 1:
            raise Unreadable(f"{which} has {side.replicas} files; sub-pixel images need one file per side.")
    hashes = {which: {file["sha256"] for file in side.files} for which, side in sides.items()}
    shared = hashes["ours"] & hashes["reference"]
    if shared:
        raise Unreadable(
            f"{len(shared)} file(s) are on both sides, so the sides are not independent. Give each side "
            "its own."
        )


def check_one_side(which, side):
    """Raise Unreadable unless the kept files of a side, named `which`, can be replicas of each other."""
    if side.replicas < 2:
        raise Unreadable(
            f"{which} is one file, and one picture says nothing of its noise. Render replicas with other "
            "seeds, "
            "or give one picture per side at several times the resolution and --pixels-as-replicas."
        )
    facts = [file["provenance"] for file in side.files]
    for file in side.files:
        if file["provenance"]["content"] is not None:
            raise Unreadable(
                f"{file['file']} of {which} is no replica but the {file['provenance']['content']}. "
                "Name the files of single seeds."
            )
    _check_seeds(which, side, [_own_numbers(fact) for fact in facts])
    samples = {fact["samples"] for fact in facts}
    if len(samples) > 1:
        listed = ", ".join(str(count) for count in sorted(samples, key=lambda count: count or 0))
        raise Unreadable(
            f"the replicas of {which} have {listed} samples; replicas differ in their seed alone."
        )


def _own_numbers(fact):
    """What tells a replica from others: its seed, or its part of the samples of one; None where unknown."""
    if fact["seed"] is None or fact["subset"] is None:
        return fact["seed"]
    return f"{fact['seed']} and the samples from {fact['subset']} on"


def _check_seeds(which, side, seeds):
    known = [seed for seed in seeds if seed is not None]
    for seed in set(known):
        if known.count(seed) > 1:
            raise Unreadable(f"two replicas of {which} have the seed {seed}. Give every replica its own.")
    seen = {}
    for file, seed, pixels in zip(side.files, seeds, side.stack, strict=True):
        digest = hashlib.sha256(np.ascontiguousarray(pixels).tobytes()).hexdigest()
        if digest in seen and (seed is None or seen[digest][1] is None):
            raise Unreadable(
                f"{file['file']} and {seen[digest][0]} of {which} have the same pixels and do not name "
                "different "
                "seeds: a copy is no replica. Render each with its own seed."
            )
        seen[digest] = (file["file"], seed)


def blocks_of(image, size):
    """Means of size x size pixel blocks [by, bx, c]; blocks at the right and lower edge may be smaller."""
    rows = np.arange(0, image.shape[0], size)
    columns = np.arange(0, image.shape[1], size)
    sums = np.add.reduceat(np.add.reduceat(image.astype(np.float64), rows, axis=0), columns, axis=1)
    return sums / block_weights(image.shape, size)[..., None]


def block_weights(shape, size):
    """Number of pixels of every block, float64 [by, bx]."""
    heights = np.diff(np.append(np.arange(0, shape[0], size), shape[0]))
    widths = np.diff(np.append(np.arange(0, shape[1], size), shape[1]))
    return np.outer(heights, widths).astype(np.float64)


def provenance(path):
    """What an EXR says of its own making: {"seed", "samples", "subset" (first sample of it): int or None,
    "renderer", "content": text or None}.

    Files of this program say so in attributes "cloudparity:...", those of Blender in
    "cycles.<layer>.samples".
    """
    found = {"seed": None, "samples": None, "subset": None, "renderer": None, "content": None}
    file = oiio.ImageInput.open(path)
    if file is None:
        return found
    for attribute in file.spec().extra_attribs:
        name, value = attribute.name, attribute.value
        if name in ("cloudparity:seed", "cloudparity:samples"):
            found[name.split(":")[1]] = _whole_number(value)
        elif name == "cloudparity:sample_offset":
            found["subset"] = _whole_number(value)
        elif name in ("cloudparity:renderer", "cloudparity:content"):
            found[name.split(":")[1]] = str(value)
        elif name.startswith("cycles.") and name.endswith(".samples"):
            found["samples"] = found["samples"] or _whole_number(value)
            found["renderer"] = found["renderer"] or "Cycles"
    file.close()
    return found


def shared_attributes(paths):
    """The attributes "cloudparity:..." and the colour space that all files have with the same value."""
    shared = None
    for path in paths:
        file = oiio.ImageInput.open(path)
        found = {
            item.name: item.value
            for item in file.spec().extra_attribs
            if item.name.startswith("cloudparity:") or item.name == "colorInteropID"
        }
        file.close()
        shared = (
            found
            if shared is None
            else {name: value for name, value in shared.items() if found.get(name) == value}
        )
    return shared


def _whole_number(value):
    try:
        return int(str(value))
    except ValueError:
        return None


def sub_pixel_images(pixels, cells, name):
    """The images at each position of every cells x cells cell: [cells^2, h, w, c] of [H, W, c]."""
    height, width, channels = pixels.shape
    if height % cells or width % cells:
        raise Unreadable(
            f"{name} has {width} x {height} pixels, which {cells} x {cells} cells do not divide. Render "
            "it at "
            f"{cells} times the resolution per axis."
        )
    split = pixels.reshape(height // cells, cells, width // cells, cells, channels)
    return split.transpose(1, 3, 0, 2, 4).reshape(cells * cells, height // cells, width // cells, channels)


def load_side(
    paths, block, progress=lambda index: None, keep=False, cells=None, as_luminance=False, **choice
):
    """Read and average the replicas of one side; raises Unreadable when they do not belong together.

    Replicas are read one by one, so memory hardly grows with their number (Welford's variance), unless `keep`
    asks for all of them. With `cells`, the only file is one picture whose cells of cells x cells pixels
    become pixels, and `stack` holds its sub-pixel images. `as_luminance` takes colours as their luminance.
    `choice` is what picture_file.read takes: which picture of a file, and what integers mean.
    """
    files, image_means, block_means, kept = [], [], [], []
    bad = {"nan": 0, "infinite": 0, "negative": 0}
    mean = spread = first = None
    for index, path in enumerate(paths):
        progress(index)
        picture = picture_file.read(path, **choice)
        pixels, names = _luminance_of(picture) if as_luminance else (picture.pixels, picture.names)
        height, width = pixels.shape[:2]
        if cells is not None:
            bad["negative"] += int((pixels < 0).sum())
            kept = sub_pixel_images(pixels, cells, os.path.basename(path))
            with np.errstate(invalid="ignore"):
                pixels = kept.mean(axis=0, dtype=np.float64)
            width, height = width // cells, height // cells
        facts = {
            "names": names,
            "size": (width, height),
            "origin": picture.origin,
            "space": picture.space,
            "meaning": picture.meaning,
            "picture": picture.name,
            "notes": picture.notes,
        }
        if first is None:
            first = facts | {"notes": []}
            mean = np.zeros(pixels.shape, np.float64)
            spread = np.zeros(pixels.shape, np.float64)
        elif any(facts[key] != first[key] for key in ("names", "size", "meaning")):
            raise Unreadable(
                f"{os.path.basename(path)} is {describe(facts)}, the first replica of its side is "
                f"{describe(first)}. Average only renders of one picture."
            )
        first["notes"] += [note for note in picture.notes if note not in first["notes"]]
        files.append({"file": os.path.basename(path), "sha256": sha256(path), "provenance": provenance(path)})
        bad["nan"] += int(np.isnan(pixels).sum())
        bad["infinite"] += int(np.isinf(pixels).sum())
        bad["negative"] += int((pixels < 0).sum()) if cells is None else 0
        if keep and cells is None:
            kept.append(pixels)
        pixels = pixels.astype(np.float64)
        with np.errstate(invalid="ignore"):
            step = pixels - mean
            mean += step / (index + 1)
            spread += step * (pixels - mean)
            image_means.append(pixels.mean(axis=(0, 1)))
            block_means.append(blocks_of(pixels, block))
    return Side(
        files,
        first,
        mean,
        spread / (len(files) - 1) if len(files) > 1 else None,
        np.array(image_means),
        np.array(block_means),
        bad,
        np.asarray(kept) if len(kept) else None,
    )


def _luminance_of(picture):
    """Pixels and channel names of a picture with its colours as Rec.709 luminance, "Y"."""
    names = picture.names
    grey = luminance(picture.pixels[..., [names.index(name) for name in "RGB"]]).astype(np.float32)[..., None]
    if "A" not in names:
        return grey, ["Y"]
    return np.concatenate([grey, picture.pixels[..., [names.index("A")]]], axis=-1), ["Y", "A"]


def describe(facts):
    """Size, channels and meaning of a picture in words."""
    width, height = facts["size"]
    values = "" if facts["meaning"] == "radiance" else f", {facts['meaning']} integers"
    return f"{width} x {height} with channels {', '.join(facts['names'])}{values}"


def _facts(side):
    return {"names": side.names, "size": side.size, "meaning": side.meaning}


def check_comparable(ours, reference):
    """Raise Unreadable unless both sides have the same size, colours, kind of values and colour space."""
    colours = [[name for name in side.names if name != "A"] for side in (ours, reference)]
    if ours.size != reference.size or sorted(colours[0]) != sorted(colours[1]):
        raise Unreadable(
            f"ours is {describe(_facts(ours))}, the reference is {describe(_facts(reference))}. "
            "Render both with the same film settings, or name the same pass of both: --part."
        )
    if (ours.meaning == picture_file.DISPLAY) != (reference.meaning == picture_file.DISPLAY):
        raise Unreadable(
            "one side has display values, the other scene-linear values. Make a PNG of the other by the view "
            "that the first was saved with (cloudparity export), or decode the integers: --integers srgb."
        )
    if ours.colour_space and reference.colour_space and ours.colour_space != reference.colour_space:
        raise Unreadable(
            f"ours declares colour space {ours.colour_space}, the reference {reference.colour_space}. "
            "Write both as linear Rec.709."
        )


def reorder(side, names):
    """Keep the channels `names` of a side, in this order."""
    order = [side.names.index(name) for name in names]
    side.names = list(names)
    side.mean = side.mean[..., order]
    side.image_means = side.image_means[..., order]
    side.block_means = side.block_means[..., order]
    if side.pixel_variance is not None:
        side.pixel_variance = side.pixel_variance[..., order]
    if side.stack is not None:
        side.stack = side.stack[..., order]


def _buffer(array):
    return oiio.ImageBuf(np.ascontiguousarray(array, np.float32))


def openimageio_figures(ours, reference, names, threshold):
    """OpenImageIO's ImageBufAlgo.compare of two [h, w, c] arrays; the same as `idiff` prints.

    mean_error and rms_error average over pixels and channels; psnr = 20 log10(1 / rms_error), peak 1, null
    where the images are equal; a pixel fails where any channel differs by more than `threshold`.
    """
    result = oiio.ImageBufAlgo.compare(_buffer(ours), _buffer(reference), threshold, threshold)
    x, y, c = result.maxx, result.maxy, result.maxc
    pixels = ours.shape[0] * ours.shape[1]
    return {
        "mean_error": result.meanerror,
        "rms_error": result.rms_error,
        "psnr": result.PSNR if math.isfinite(result.PSNR) else None,
        "max_error": result.maxerror,
        "max_at": None
        if result.maxerror == 0
        else {
            "x": x,
            "y": y,
            "channel": names[c],
            "ours": float(np.float32(ours[y, x, c])),
            "reference": float(np.float32(reference[y, x, c])),
        },
        "threshold": threshold,
        "failing_pixels": int(result.nfail),
        "failing_share": result.nfail / pixels,
        "pixels": pixels,
    }


def channel_means(ours, reference):
    """Mean of every channel on both sides, their relative difference and, with replicas, standard errors.

    relative_difference = (ours - reference) / reference, null where only the reference's is 0.
    standard_error_relative = sqrt(se_ours^2 + se_reference^2) / |reference| of what is known of the two.
    """
    rows = []
    for c, name in enumerate(ours.names):
        a, b = float(ours.image_means[:, c].mean()), float(reference.image_means[:, c].mean())
        errors = [standard_error(side.image_means[:, c]) for side in (ours, reference)]
        known = [error for error in errors if error is not None]
        rows.append(
            {
                "channel": name,
                "ours": a,
                "reference": b,
                "relative_difference": (a - b) / b if b != 0 else (0.0 if a == 0 else None),
                "ours_standard_error": errors[0],
                "reference_standard_error": errors[1],
                "standard_error_relative": math.sqrt(sum(e * e for e in known)) / abs(b)
                if known and b
                else None,
            }
        )
    return rows


def standard_error(means):
    """Standard error of the mean of K replica means, s / sqrt(K); None for K = 1."""
    return float(np.std(means, ddof=1) / math.sqrt(len(means))) if len(means) > 1 else None


def relative_squared_error(ours, reference, epsilon, weights=None):
    """relMSE: the mean over pixels (or blocks, weighted by their pixels) and channels of
    (ours - reference)^2 / (reference^2 + epsilon^2). None when epsilon is 0 and the images differ."""
    return _relative_mean((ours - reference) ** 2, reference, epsilon, weights)


def _relative_mean(squares, reference, epsilon, weights):
    if epsilon == 0:
        return 0.0 if not squares.any() else None
    per_cell = (squares / (reference**2 + epsilon**2)).mean(axis=-1)
    return float(np.average(per_cell, weights=weights))


def relmse(ours, reference, block):
    """All relMSE figures of the colour channels; see the formula texts in the result.

    noise_*: what Monte Carlo noise alone is expected to add, from the replicas of each side that has two or
    more; null when neither has. debiased_block: the product of the differences of two disjoint halves of the
    replicas, whose expectation holds no noise; null unless both sides have two or more.
    """
    channels = ours.indices("colour")
    a, b = ours.mean[..., channels], reference.mean[..., channels]
    weights = block_weights(a.shape, block)
    epsilon = RELATIVE_EPSILON * abs(float(b.mean()))
    blocks = [side.block_means[..., channels] for side in (ours, reference)]
    block_a, block_b = blocks[0].mean(axis=0), blocks[1].mean(axis=0)
    noisy = [side for side in (ours, reference) if side.replicas > 1]
    noise_pixel = noise_block = debiased = None
    if noisy:
        pixel = sum(side.pixel_variance[..., channels] / side.replicas for side in noisy)
        cell = sum(side.block_means[..., channels].var(axis=0, ddof=1) / side.replicas for side in noisy)
        noise_pixel = _relative_mean(pixel, b, epsilon, None)
        noise_block = _relative_mean(cell, block_b, epsilon, weights)
    if len(noisy) == 2:
        halves = [[stack[i::2].mean(axis=0) for i in (0, 1)] for stack in blocks]
        product = (halves[0][0] - halves[1][0]) * (halves[0][1] - halves[1][1])
        debiased = _relative_mean(product, block_b, epsilon, weights)
    return {
        "formula": "mean over cells and channels of (ours - reference)^2 / (reference^2 + epsilon^2)",
        "epsilon": epsilon,
        "epsilon_rule": "1 % of the mean of the reference over its pixels and R, G, B",
        "block_size": block,
        "block_count": int(weights.size),
        "pixel": relative_squared_error(a, b, epsilon),
        "block": relative_squared_error(block_a, block_b, epsilon, weights),
        "noise_pixel": noise_pixel,
        "noise_block": noise_block,
        "debiased_block": debiased,
        "noise_from": [
            name for name, side in (("ours", ours), ("reference", reference)) if side.replicas > 1
        ],
    }


def luminance(rgb):
    """Rec.709 luminance of [h, w, 3], float64 [h, w]; the channel itself for a single channel."""
    if rgb.shape[-1] != 3:
        return rgb.astype(np.float64).mean(axis=-1)
    return rgb.astype(np.float64) @ np.array(LUMINANCE_WEIGHTS)


def hdr_flip(ours, reference, meaning="radiance"):
    """HDR-FLIP of two scene-linear [h, w, 3] arrays: (figures, error map float32 [h, w] or None).

    The exposures follow the reference alone, so they are the same for every candidate: the start exposure
    maps its largest luminance to the display value 0.85, the stop exposure the median luminance of its lit
    pixels (those above epsilon; the empty film would drive the median to 0). Negative values count as 0.
    Display values (`meaning`) have no exposure, and so no HDR-FLIP.
    """
    figures = {
        "kind": "HDR-FLIP",
        "mean": None,
        "why_not": None,
        "exposure_start": None,
        "exposure_stop": None,
        "exposure_rule": "fixed by the reference: its largest luminance and the median luminance of its "
        "pixels above 1 % of the mean, each mapped to 0.85 by the tone mapper",
        "tonemapper": FLIP_TONEMAPPER,
        "pixels_per_degree": None,
    }
    if meaning == picture_file.DISPLAY:
        figures["why_not"] = "display values have no exposures"
        return figures, None
    bright = luminance(reference)
    lit = bright[bright > max(RELATIVE_EPSILON * bright.mean(), 0.0)]
    try:
        import flip_evaluator
    except ImportError:
        figures["why_not"] = "the Python package flip-evaluator is not installed"
        return figures, None
    if reference.shape[-1] != 3 or lit.size == 0:
        figures["why_not"] = (
            "the reference has no R, G, B" if reference.shape[-1] != 3 else "the reference is black"
        )
        return figures, None
    midtone = _aces_inverse(FLIP_MIDTONE)
    start, stop = math.log2(midtone / lit.max()), math.log2(midtone / np.median(lit))
    # The evaluator ends the process on an empty exposure range.
    parameters = {
        "startExposure": start,
        "stopExposure": max(stop, start + 1e-3),
        "tonemapper": FLIP_TONEMAPPER,
    }
    a, b = (np.ascontiguousarray(np.maximum(image, 0), np.float32) for image in (ours, reference))
    error_map, mean, used = flip_evaluator.evaluate(b, a, "HDR", True, False, True, parameters)
    figures.update(
        mean=float(mean),
        exposure_start=start,
        exposure_stop=parameters["stopExposure"],
        pixels_per_degree=float(used["ppd"]),
    )
    return figures, np.asarray(error_map, np.float32).reshape(a.shape[:2])


def _aces_inverse(value):
    """Scene value that the ACES approximation used by FLIP maps to `value`."""
    numerator, denominator = (0.36 * 2.51, 0.6 * 0.03, 0.0), (0.36 * 2.43, 0.6 * 0.59, 0.14)
    a, b, c = (n - value * d for n, d in zip(numerator, denominator, strict=True))
    return (-b + math.sqrt(b * b - 4 * a * c)) / (2 * a)


def input_array(path, place):
    """Read a float32 [h, w] .npy file."""
    try:
        array = np.load(path, allow_pickle=False)
    except (OSError, ValueError) as error:
        raise protocol.InputError(
            f"{place}: {path}",
            first_line(str(error)),
            "a float32 .npy file of shape [h, w]",
            "write the slice again",
        ) from None
    if array.dtype != np.float32 or array.ndim != 2 or array.size == 0:
        raise protocol.InputError(
            f"{place}: {path}",
            f"{array.dtype} of shape {list(array.shape)}",
            "float32 of shape [h, w]",
            "write the slice with numpy.save(path, values.astype(numpy.float32))",
        )
    return array
