"""How the notebooks show things: figures in the colours of the program's own, tables, pictures.

Colours and markers of light models are those of study.svg, from blend/.
"""

import html
import math
import sys

import matplotlib.pyplot as pyplot
import numpy as np

from study_reader import ROOT

sys.path.insert(0, str(ROOT / "blend"))

import plots
import study_plot

plain_ticks = plots.plain_ticks
COLOURS = {"cpu": plots.BLACK, "gpu": plots.ORANGE, "oracle": plots.BLUE}
DENSITY_COLOURS = {"graph": plots.BLUE, "perlin-fbm": plots.ORANGE}
SIGNED = "PuOr_r"  # orange is too bright, purple too dark

pyplot.rcParams.update(
    {
        "figure.dpi": 130,
        "figure.constrained_layout.use": True,
        "font.size": 8,
        "axes.titlesize": 8,
        "axes.linewidth": 0.6,
        "axes.axisbelow": True,
        "grid.linewidth": 0.3,
        "grid.color": "0.85",
        "lines.linewidth": 1.0,
        "lines.markersize": 4,
        "legend.frameon": False,
        "legend.fontsize": 7,
        "image.interpolation": "nearest",
    }
)


class Table:
    """Rows under headings, which a notebook shows as a table; numbers are aligned to the right."""

    def __init__(self, headings, rows):
        self.headings = list(headings)
        self.rows = [[str(cell) for cell in row] for row in rows]

    def _repr_html_(self):
        head = "".join(f'<th style="text-align:left">{html.escape(cell)}</th>' for cell in self.headings)
        body = "".join("<tr>" + "".join(map(_cell, row)) + "</tr>" for row in self.rows)
        return f"<table><thead><tr>{head}</tr></thead><tbody>{body}</tbody></table>"

    def __repr__(self):
        rows = [self.headings, *self.rows]
        widths = [max(len(row[index]) for row in rows) for index in range(len(self.headings))]
        return "\n".join(
            "  ".join(cell.ljust(width) for cell, width in zip(row, widths, strict=True)).rstrip()
            for row in rows
        )


def _cell(text):
    side = "right" if text[:1] in tuple("+-0123456789") else "left"
    return f'<td style="text-align:{side}">{html.escape(text)}</td>'


def light_style(lights, name):
    """Colour and marker of a light model, as in study.svg."""
    number = lights.index(name)
    colours, markers = study_plot.COLOURS, study_plot.MARKERS
    return {"color": colours[number % len(colours)], "marker": markers[number % len(markers)]}


def grid(axis):
    """Fine lines at the major ticks."""
    axis.grid(True, which="major")


def log_axes(axis):
    """Both axes logarithmic, with plain numbers."""
    axis.set_xscale("log")
    axis.set_yscale("log")
    plain_ticks(axis.xaxis)
    plain_ticks(axis.yaxis)
    grid(axis)


def bare(axis):
    """An axis for a picture: no ticks, a thin frame."""
    axis.set_xticks([])
    axis.set_yticks([])
    for spine in axis.spines.values():
        spine.set_color("0.6")


def exposure_of(picture):
    """The factor that brings the 99th percentile of a scene-linear picture to 0.9."""
    high = float(np.percentile(picture, 99))
    return 0.9 / high if high > 0 else 1.0


def to_display(picture, exposure):
    """A scene-linear picture as sRGB from 0 to 1: exposure, clip, transfer curve; no tone mapping."""
    linear = np.clip(np.asarray(picture, dtype=np.float64) * exposure, 0.0, 1.0)
    return np.where(linear <= 0.0031308, 12.92 * linear, 1.055 * linear ** (1 / 2.4) - 0.055)


def relative_difference(picture, truth):
    """Signed difference of the channels' means over those of the truth, per pixel.

    1 % of the truth's mean is added below, as in relMSE, so that dark pixels stay finite.
    """
    ours, theirs = np.mean(picture, axis=-1), np.mean(truth, axis=-1)
    return (ours - theirs) / (theirs + 0.01 * theirs.mean())


def ulp_distance(ours, theirs):
    """How many float32 numbers lie between two: 0 for equal ones, both zeros counting as one."""

    def place(values):
        bits = np.asarray(values, dtype=np.float32).view(np.int32).astype(np.int64)
        return np.where(bits < 0, -(bits & 0x7FFFFFFF), bits)

    return np.abs(place(ours) - place(theirs))


def number(value, digits=3):
    """A number in so many significant digits, without trailing noise."""
    return f"{value:.{digits}g}"


MINUS, TIMES = "\u2212", "\u00d7"
SUPERSCRIPTS = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")


def uncertain(found):
    """A figure with its standard error in units of its last digit, `0.0779(9)`: as the program writes it.

    The rule is that of the Particle Data Group (Review of Particle Physics, section 5.3): of the three
    leading digits of the error 100 to 354 are rounded to two, 355 to 949 to one, 950 to 999 to 1000 with
    two kept.
    """
    value, error = found.value, found.standard_error
    if not math.isfinite(value):
        return "NaN" if math.isnan(value) else "∞" if value > 0 else MINUS + "∞"
    if not (math.isfinite(error) and error > 0):
        return number(value).replace("-", MINUS) + ("" if error == 0 else "(NaN)")
    leading, size = _digits(error, 2)
    if leading <= 354:
        digits, place = _digits(error, 1)
        place -= 1
    elif leading <= 949:
        digits, place = _digits(error, 0)
    else:
        digits, place = 10, size
    exponent = max(size, _digits(value, 2)[1]) if value else size
    if place > 0 or exponent < -3:
        exponent = max(exponent, place)
        text = _without_sign_of_zero(f"{value / 10.0**exponent:.{exponent - place}f}")
        power = str(exponent).translate(SUPERSCRIPTS)
        return f"{text}({digits}){TIMES}10{power}".replace("-", MINUS)
    return f"{_without_sign_of_zero(f'{value:.{-place}f}')}({digits})".replace("-", MINUS)


def _digits(value, behind):
    """A number rounded to so many digits behind its first: the digits, and the first one's power of ten."""
    digits, exponent = f"{abs(value):.{behind}e}".split("e")
    return int(digits.replace(".", "")), int(exponent)


def _without_sign_of_zero(text):
    return text if any(letter in "123456789" for letter in text) else text.lstrip("-")
