"""Pictures beside a truth: a row of display pictures and of their HDR-FLIP maps, and windows of them.

All pictures of a figure go through one display transform, and all maps have one scale.
"""

import matplotlib.colors
import numpy as np
import scipy.ndimage

import display_picture
import false_colour
import image_metrics
import plots


class Grid:
    """Rows of axes: the truth, `count` pictures, and their maps. `largest_flip`: of the maps' scale.

    `image` is the last map, for a colour bar.
    """

    def __init__(self, count, largest_flip):
        self._count = count
        self._largest = largest_flip
        self._display = display_picture.Display("AgX", "None", 0.0, 1.0)
        self._colours = matplotlib.colors.ListedColormap(false_colour.SEQUENTIAL / 255.0)
        self.image = None

    @property
    def columns(self):
        """Axes of a row."""
        return 1 + 2 * self._count

    def fill(self, row, truth, pictures, below=None):
        """Draw a row; in the row `below` the window of the pictures where the last one errs most."""
        shown = [(self._display.apply(picture), {}) for picture in (truth, *pictures)]
        maps = [image_metrics.hdr_flip(picture, truth) for picture in pictures]
        scale = {"cmap": self._colours, "vmin": 0, "vmax": self._largest}
        shown += [(errors, scale) for _, errors in maps]
        self._draw(row, shown)
        for axis, (figures, _) in zip(row[1 + self._count :], maps, strict=True):
            axis.set_xlabel(f"mean {figures['mean']:.3f}", fontsize=6, labelpad=1)
        if below is not None:
            window = worst_window(maps[-1][1])
            self._draw(below, [(values[window], options) for values, options in shown[: 1 + self._count]])
            for axis in row:
                outline(axis, window)

    def _draw(self, row, shown):
        for axis, (values, options) in zip(row, shown, strict=True):
            image = axis.imshow(values, interpolation="nearest", **options)
            self.image = image if options else self.image
            axis.set_xticks([])
            axis.set_yticks([])


def worst_window(errors, share=0.3):
    """The window of `share` of each side whose mean error is largest, as slices of lines and columns."""
    size = [max(1, round(share * side)) for side in errors.shape]
    means = scipy.ndimage.uniform_filter(np.asarray(errors, float), size, mode="constant")
    # The filter centres a window of n at n // 2; only whole windows count.
    valid = tuple(
        slice(length // 2, side - (length - 1 - length // 2))
        for side, length in zip(errors.shape, size, strict=True)
    )
    at = np.unravel_index(np.argmax(means[valid]), means[valid].shape)
    return tuple(slice(int(begin), int(begin) + length) for begin, length in zip(at, size, strict=True))


def outline(axis, window):
    """A frame around a window of a picture."""
    import matplotlib.patches

    lines, columns = window
    place = (columns.start - 0.5, lines.start - 0.5)
    size = (columns.stop - columns.start, lines.stop - lines.start)
    axis.add_patch(
        matplotlib.patches.Rectangle(place, *size, fill=False, edgecolor=plots.ORANGE, linewidth=0.8)
    )
