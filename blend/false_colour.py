"""False colour pictures and their legends.

Two maps, both interpolated in OKLab, so lightness is even between their anchors: SEQUENTIAL goes from dark
violet to pale yellow and stays readable in grey; DIVERGING runs from blue through near white to orange with
equal lightness on both sides. Legends are SVG that follow the viewer's light or dark scheme.
"""

import html
import math

import numpy as np

# (lightness, chroma, hue in degrees) in OKLCh.
SEQUENTIAL_ANCHORS = [
    (0.16, 0.05, 300),
    (0.36, 0.12, 288),
    (0.54, 0.11, 235),
    (0.72, 0.13, 165),
    (0.96, 0.09, 105),
]
DIVERGING_ANCHORS = [(0.36, 0.12, 255), (0.66, 0.12, 250), (0.97, 0.0, 0), (0.66, 0.12, 50), (0.36, 0.12, 40)]
STEPS = 256

EQUAL = (222, 224, 228)  # exactly equal values, in logarithmic error maps
NOT_FINITE = (214, 0, 147)  # NaN or infinite on either side


def _srgb8(linear):
    linear = np.clip(linear, 0.0, 1.0)
    encoded = np.where(linear <= 0.0031308, 12.92 * linear, 1.055 * linear ** (1 / 2.4) - 0.055)
    return np.floor(255 * encoded + 0.5).astype(np.uint8)


def _table(anchors):
    """256 sRGB colours, linear in OKLab between the anchors."""
    lab = [(lum, c * math.cos(math.radians(h)), c * math.sin(math.radians(h))) for lum, c, h in anchors]
    position = np.linspace(0, 1, STEPS)
    stops = np.linspace(0, 1, len(anchors))
    lum, a, b = (np.interp(position, stops, [point[i] for point in lab]) for i in range(3))
    # OKLab to linear sRGB: Bjorn Ottosson, "A perceptual color space for image processing", 2020.
    long = (lum + 0.3963377774 * a + 0.2158037573 * b) ** 3
    medium = (lum - 0.1055613458 * a - 0.0638541728 * b) ** 3
    short = (lum - 0.0894841775 * a - 1.2914855480 * b) ** 3
    red = 4.0767416621 * long - 3.3077115913 * medium + 0.2309699292 * short
    green = -1.2684380046 * long + 2.6097574011 * medium - 0.3413193965 * short
    blue = -0.0041960863 * long - 0.7034186147 * medium + 1.7076147010 * short
    return _srgb8(np.stack([red, green, blue], axis=-1))


SEQUENTIAL = _table(SEQUENTIAL_ANCHORS)
SEQUENTIAL_REVERSED = SEQUENTIAL[::-1]
DIVERGING = _table(DIVERGING_ANCHORS)


def colour(values, low, high, table):
    """Map values (float [h, w]) from [low, high] to uint8 [h, w, 3]; outside values take the end colours."""
    span = high - low
    position = (np.nan_to_num(values, nan=low, posinf=high, neginf=low) - low) / (span if span > 0 else 1.0)
    picture = table[np.clip(np.floor(position * STEPS), 0, STEPS - 1).astype(int)]
    picture[~np.isfinite(values)] = NOT_FINITE
    return picture


def figure(value):
    """A number of a legend, four significant digits."""
    return f"{value:.4g}".replace("-", "\u2212")


def legend(lines, table, ticks, swatches=()):
    """An SVG colour bar as wide as its place, with text of constant size.

    `lines`: title, one entry per line; `ticks`: (position 0..1, label); `swatches`: (rgb, label), below.
    """
    shades = table[np.linspace(0, STEPS - 1, 33).round().astype(int)].tolist()
    stops = "".join(
        f'<stop offset="{i / 32:.4f}" stop-color="#{bytes(shade).hex()}"/>' for i, shade in enumerate(shades)
    )
    parts = [f'<text y="{13 + 16 * i}">{html.escape(line)}</text>' for i, line in enumerate(lines)]
    top = 16 * len(lines) + 6
    parts.append(
        f'<rect class="edge" x="1" y="{top}" width="100%" height="16" fill="url(#scale)"'
        ' style="width:calc(100% - 2px)"/>'
    )
    for position, label in ticks:
        x, anchor = f"{100 * position:.2f}%", "middle"
        if position < 0.03:
            x, anchor = "1", "start"
        elif position > 0.97:
            anchor = "end"
        parts.append(f'<text x="{x}" y="{top + 31}" text-anchor="{anchor}">{html.escape(label)}</text>')
    height, x = top + 38, 1
    for rgb, label in swatches:
        parts.append(
            f'<rect class="edge" x="{x}" y="{height + 1}" width="13" height="13" fill="#{bytes(rgb).hex()}"/>'
            f'<text x="{x + 19}" y="{height + 12}">{html.escape(label)}</text>'
        )
        x += 36 + 7 * len(label)
    height += 20 if swatches else 0
    spoken = f"{' '.join(lines)}; colour scale at {', '.join(label for _, label in ticks)}"
    return (
        f'<svg xmlns="http://www.w3.org/2000/svg" width="100%" height="{height}" role="img">'
        f"<title>{html.escape(spoken)}</title>"
        "<style>:root{color-scheme:light dark}text{font:12px system-ui,sans-serif;fill:#333a44}"
        ".edge{stroke:#7d8590;stroke-width:.75}@media(prefers-color-scheme:dark){text{fill:#c8cfd8}}</style>"
        f'<defs><linearGradient id="scale">{stops}</linearGradient></defs>{"".join(parts)}</svg>\n'
    )


def linear_ticks(low, high, count=5, unit=""):
    """Evenly spaced ticks of a linear scale with their values; `unit` is appended to every label."""
    return [(i / (count - 1), figure(low + (high - low) * i / (count - 1)) + unit) for i in range(count)]


def decade_ticks(low, high):
    """One tick per second power of ten of a logarithmic scale from 10^low to 10^high."""
    return [((exponent - low) / (high - low), f"1e{exponent}") for exponent in range(low, high + 1, 2)]
