"""How far from the truth pictures of so many samples are: noise and bias against one combined reference.

Request: `ours` and `cycles` (two pictures at `sub_pixels` times the resolution per axis, whose sub-pixel
images are replicas in pairs), `others` (list of {"file", "sub_pixels"}; sub_pixels 1 is a single picture of
the size that is wanted). Result: {"ours", "cycles": {"noise", "squared_bias"}, "others": [{"noise",
"squared_bias", "error"}]}.

With replicas A_k and B_k, means A and B, the combined reference is R = w A + (1 - w) B, w the share that has
the least noise for pixels on average. All figures are means over pixels and channels, divided by
R^2 + epsilon^2 (the denominator of relMSE), epsilon 1 % of the mean of R:

  noise of one replica   s_A^2 - c, c the covariance of A_k and B_k over k. Sub-pixel images differ by
                         position within the pixel; both sides do so alike, and their noise is
                         independent: c estimates that spread without bias, and it is no noise of a
                         picture whose samples spread over the whole pixel.
  squared bias           against R: ours (1 - w)^2 D, Cycles w^2 D, with D = (A - B)^2 less its noise.
  another picture X      error (X - R)^2 less the noise of R; with several replicas also its own noise, with c
                         from A and B at the same positions, and its squared bias, the error of the mean less
                         the noise.

A picture of n replicas' samples then has relMSE = squared bias + noise / n. Figures without noise may come
out slightly negative.
"""

import numpy as np

import image_metrics
import picture_file
import protocol


def measure(request, messages):
    """Answer the request; raises InputError where pictures do not belong together."""
    cells = request["sub_pixels"]
    ours, cycles = (_replicas(request[name], cells) for name in ("ours", "cycles"))
    if ours.shape != cycles.shape:
        raise protocol.InputError(
            request["ours"],
            f"replicas of shape {ours.shape}",
            f"those of the reference, {cycles.shape}",
            "render both sides alike",
        )
    found = combined(ours, cycles)
    others = []
    for index, other in enumerate(request["others"]):
        messages.progress((index + 1) / len(request["others"]), "errors")
        stack = _replicas(other["file"], other["sub_pixels"])
        if stack.shape[1:] != ours.shape[1:]:
            raise protocol.InputError(
                other["file"],
                f"replicas of shape {stack.shape[1:]}",
                f"those of the reference, {ours.shape[1:]}",
                "give the sub-pixels that it was rendered with",
            )
        others.append(against(stack, found, ours, cycles, cells, other["sub_pixels"]))
    return {"ours": found["ours"], "cycles": found["cycles"], "others": others}


def combined(ours, cycles):
    """The combined reference of two paired stacks, and what either side's replicas are against it."""
    count = len(ours)
    spread = covariance(ours, cycles)
    noises = [stack.var(axis=0, ddof=1) - spread for stack in (ours, cycles)]
    share = noises[1].mean() / (noises[0].mean() + noises[1].mean())
    reference = share * ours.mean(axis=0) + (1 - share) * cycles.mean(axis=0)
    epsilon = image_metrics.RELATIVE_EPSILON * abs(float(reference.mean()))
    weight = 1 / (reference**2 + epsilon**2)
    pairs = ours - cycles
    squared = pairs.mean(axis=0) ** 2 - pairs.var(axis=0, ddof=1) / count
    bias = float((squared * weight).mean())

    def side(noise, factor):
        return {"noise": float((noise * weight).mean()), "squared_bias": factor**2 * bias}

    return {
        "reference": reference,
        "weight": weight,
        "noise": (share**2 * noises[0] + (1 - share) ** 2 * noises[1]) / count,
        "ours": side(noises[0], 1 - share),
        "cycles": side(noises[1], share),
    }


def against(stack, found, ours, cycles, cells, own_cells):
    """What another picture's replicas are against the combined reference."""
    weight, reference = found["weight"], found["reference"]
    error = (stack.mean(axis=0) - reference) ** 2 - found["noise"]
    row = {"noise": None, "squared_bias": None, "error": float((error * weight).mean())}
    if len(stack) > 1:
        coarse = [coarser(side, cells, own_cells) for side in (ours, cycles)]
        noise = stack.var(axis=0, ddof=1) - covariance(*coarse)
        row["noise"] = float((noise * weight).mean())
        row["squared_bias"] = row["error"] - row["noise"] / len(stack)
    return row


def covariance(first, second):
    """Covariance of two stacks over their replicas, per pixel and channel."""
    products = (first - first.mean(axis=0)) * (second - second.mean(axis=0))
    return products.sum(axis=0) / (len(first) - 1)


def coarser(stack, cells, wanted):
    """Means of neighbouring sub-pixel images: a stack of cells^2 as one of wanted^2."""
    if cells % wanted:
        raise protocol.InputError(
            "sub_pixels", str(wanted), f"a divisor of {cells}", "render that picture at another resolution"
        )
    each = cells // wanted
    split = stack.reshape(wanted, each, wanted, each, *stack.shape[1:])
    return split.mean(axis=(1, 3)).reshape(wanted**2, *stack.shape[1:])


def _replicas(path, cells):
    """Colour of the sub-pixel images of a file: float64 [cells^2, h, w, 3]."""
    try:
        picture = picture_file.read(path)
        positions = [picture.names.index(name) for name in "RGB"]
        return image_metrics.sub_pixel_images(picture.pixels, cells, path)[..., positions].astype(np.float64)
    except (image_metrics.Unreadable, ValueError) as error:
        raise protocol.InputError(
            path, str(error), "a picture with channels R, G, B", "render it again"
        ) from None


if __name__ == "__main__":
    protocol.serve("sample_errors.py", measure, needs_bpy=False)
