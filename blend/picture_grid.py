"""Pictures beside a truth: a row of display pictures and of their HDR-FLIP maps, and windows of them.

All pictures of a figure go through one display transform, and all maps have one scale.
"""

import matplotlib.colors
import numpy as np
import scipy.ndimage

import display_picture
import false_colour
import image_metrics

FRAME = "#D55E00"  # around what a window shows


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

    def fill(self, row, truth, pictures, window=None):
        """Draw a row; with `window` (slices of lines and columns) that part alone. Whole maps come back."""
        maps = []
        for axis in row:
            axis.set_xticks([])
            axis.set_yticks([])
        part = window or (slice(None), slice(None))
        for axis, picture in zip(row[: 1 + self._count], (truth, *pictures), strict=True):
            axis.imshow(self._display.apply(picture)[part], interpolation="nearest")
        for axis, picture in zip(row[1 + self._count :], pictures, strict=True):
            figures, errors = image_metrics.hdr_flip(picture, truth)
            maps.append(errors)
            self.image = axis.imshow(
                errors[part], cmap=self._colours, vmin=0, vmax=self._largest, interpolation="nearest"
            )
            if window is None:
                axis.set_xlabel(f"mean {figures['mean']:.3f}", fontsize=6, labelpad=1)
        return maps


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
    axis.add_patch(matplotlib.patches.Rectangle(place, *size, fill=False, edgecolor=FRAME, linewidth=0.8))
