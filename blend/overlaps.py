"""Finds volumes that Cycles handles otherwise than light would: faces that coincide, and too many at a place.

Measured with Cycles 5.0.1 and 5.3.0: a ray that meets two faces at one distance passes one of them alone. It
so never leaves the first of two cubes that stand face to face (depth 3 instead of 2), and of two that are at
one place it enters one (1 instead of 2). Cycles keeps at most 31 volumes at one place; of 40 nested ones the
depth is 1.54 instead of 1.91.
"""

import numpy as np

from scene_io import matrix_array

# Volumes that Cycles keeps at one place.
STACK_LIMIT = 31
# Planes are one where they lie as close as Cycles' own rounding of distances, relative to the scene's size.
SAME_PLANE = 1e-6
# Pairs of triangles that are looked at, at most: a scene of instances may have millions.
MOST_PAIRS = 200_000
SHOWN = 3
# Of a box whose corner k has its upper end along axis a where bit a of k is set.
BOX_TRIANGLES = np.array(
    [
        *((0, 2, 3), (0, 3, 1), (4, 5, 7), (4, 7, 6), (0, 1, 5), (0, 5, 4)),
        *((2, 6, 7), (2, 7, 3), (0, 4, 6), (0, 6, 2), (1, 3, 7), (1, 7, 5)),
    ]
)


def warn_of_overlaps(volumes, messages):
    """Report what of these volumes (entries of a scene) Cycles shows otherwise than a scene file does."""
    if len(volumes) < 2:
        return
    outlines = [_outline(volume) for volume in volumes]
    pairs = _coinciding(outlines)
    if pairs:
        names = [f'"{volumes[a]["object"]}" and "{volumes[b]["object"]}"' for a, b in pairs[:SHOWN]]
        more = f" and {len(pairs) - SHOWN} more pairs" if len(pairs) > SHOWN else ""
        messages.warning(
            f"objects {', '.join(names)}{more}",
            "their faces coincide: Cycles passes one of two faces at the same distance alone, so a ray never "
            "leaves the one volume or never enters the other; here it meets both. For the same picture in "
            "Blender leave a gap or join the meshes",
        )
    boxes = np.array([[points.min(axis=0), points.max(axis=0)] for points, _ in outlines])
    depth = _deepest(boxes)
    if depth > STACK_LIMIT:
        messages.warning(
            f"{len(volumes)} volumes",
            f"{depth} of their bounding boxes share a place: Cycles keeps {STACK_LIMIT} volumes at one place "
            "and loses the others; here all count",
        )


def _outline(volume):
    """Corners in the world f64 [n, 3] and triangles [m, 3] of a volume's outline."""
    shape, bounds = volume["shape"], volume["bounds"]
    if shape["type"] == "mesh":
        points, triangles = np.asarray(shape["vertices"], float), np.asarray(shape["triangles"])
    else:
        limits = np.array([bounds["min"], bounds["max"]])
        points = np.array([[limits[corner >> axis & 1, axis] for axis in range(3)] for corner in range(8)])
        # A grid's outline is not its bounding box: it has no faces to compare.
        triangles = BOX_TRIANGLES if shape["type"] == "box" else np.empty((0, 3), int)
    matrix = matrix_array(volume["matrix_world"])
    return points @ matrix[:3, :3].T + matrix[:3, 3], triangles


def _coinciding(outlines):
    """Pairs of outlines with triangles that lie in one plane and overlap there, in order."""
    size = max(np.abs(points).max() for points, _ in outlines)
    tolerance = SAME_PLANE * max(size, 1e-30)
    corners = np.concatenate([points[triangles] for points, triangles in outlines])
    owner = np.concatenate([[number] * len(triangles) for number, (_, triangles) in enumerate(outlines)])
    if len(corners) == 0:
        return []
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    lengths = np.linalg.norm(normals, axis=1)
    kept = lengths > 0.0
    corners, owner, normals = corners[kept], owner[kept].astype(int), normals[kept] / lengths[kept, None]
    # One of two opposite normals: the one whose largest component is positive.
    largest = np.take_along_axis(normals, np.abs(normals).argmax(axis=1)[:, None], axis=1)
    normals *= np.sign(largest)
    distances = np.einsum("ij,ij->i", normals, corners[:, 0])
    order = np.argsort(distances)
    found, looked_at = set(), 0
    last = 0
    for index, here in enumerate(order):
        while distances[order[last]] < distances[here] - tolerance:
            last += 1
        for other in order[last:index]:
            pair = tuple(sorted((owner[here], owner[other])))
            if pair[0] == pair[1] or pair in found or looked_at >= MOST_PAIRS:
                continue
            looked_at += 1
            if np.abs((corners[other] - corners[here][0]) @ normals[here]).max() > tolerance:
                continue
            if _overlap(corners[here], corners[other], normals[here], tolerance):
                found.add(pair)
    return sorted(found)


def _overlap(first, second, normal, tolerance):
    """Whether two triangles of one plane share an area: no edge of either has the other beyond it."""
    for one, two in ((first, second), (second, first)):
        for start, end, opposite in ((0, 1, 2), (1, 2, 0), (2, 0, 1)):
            inward = np.cross(normal, one[end] - one[start])
            inward /= np.linalg.norm(inward)
            if (one[opposite] - one[start]) @ inward < 0.0:
                inward = -inward
            if ((two - one[start]) @ inward).max() <= tolerance:
                return False
    return True


def _deepest(boxes):
    """The largest number of boxes [n, 2, 3] that share a place; as soon as it is known to be beyond the limit
    of Cycles it is what was found."""
    if len(boxes) <= STACK_LIMIT:
        return len(boxes)
    best = 0
    # The deepest place has a lower end of some box along each axis.
    for x in np.unique(boxes[:, 0, 0]):
        across = boxes[(boxes[:, 0, 0] <= x) & (x < boxes[:, 1, 0])]
        if len(across) <= max(best, STACK_LIMIT):
            continue
        for y in np.unique(across[:, 0, 1]):
            column = across[(across[:, 0, 1] <= y) & (y < across[:, 1, 1])]
            if len(column) <= max(best, STACK_LIMIT):
                continue
            lows, highs = np.sort(column[:, 0, 2]), np.sort(column[:, 1, 2])
            counts = np.arange(1, len(lows) + 1) - np.searchsorted(highs, lows, side="right")
            best = max(best, int(counts.max()))
    return best
