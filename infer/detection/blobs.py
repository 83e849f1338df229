"""Bright markers in an image with sub-pixel accuracy; the threshold is estimated from the video itself."""

from dataclasses import dataclass

import cv2
import numpy as np
import skimage

from muybridge.arrays import BoolArray, ByteArray, FloatArray


@dataclass(frozen=True)
class BlobOptions:
    """How bright markers are detected in an image.

    Attributes:
        threshold: grey level above which a pixel belongs to a marker; None estimates it from the video.
        least_px: smallest area of a marker.
        most_px: largest area; larger blobs are lamps or windows.
        roundness: least share of its ellipse that a blob fills; with less, it is two touching markers and is split.
    """

    threshold: float | None = None
    least_px: int = 3
    most_px: int = 900
    roundness: float = 0.80


def find_threshold(images: list[ByteArray]) -> float:
    """A grey level between dark background and bright markers, from some images of one video.

    Above the background's noise there are markers and their glow; Otsu's threshold separates the two.

    Args:
        images: (H, W) grey.
    """
    levels = []
    for image in images:
        middle = float(np.median(image))
        noise = max(1.4826 * float(np.median(np.abs(image[::3, ::3].astype(np.float64) - middle))), 1.0)
        bright = image[image > middle + 8 * noise]
        if bright.size >= 10 and bright.max() > bright.min():
            floor = middle + 12 * noise
            otsu = float(skimage.filters.threshold_otsu(bright))  # type: ignore[no-untyped-call]
            levels.append(max(min(otsu, 0.6 * float(bright.max())), floor))
    return float(np.median(levels)) if levels else 128.0


def find_blobs(image: ByteArray, threshold: float, options: BlobOptions = BlobOptions()) -> FloatArray:
    """(K, 3): x, y in pixels and area of every marker.

    The centre is the mean of the pixels' positions, weighted by their level above the threshold; blobs that are no
    ellipse are split at their widest parts.

    Args:
        image: (H, W) grey.
        threshold: see `find_threshold`.
        options: sizes and shapes.
    """
    mask = image > threshold
    count, labels, stats, _ = cv2.connectedComponentsWithStats(mask.astype(np.uint8), connectivity=8)
    out = []
    for k in range(1, count):
        x, y, w, h, area = (int(v) for v in stats[k])
        if not options.least_px <= area <= 2 * options.most_px:
            continue
        window = (slice(y, y + h), slice(x, x + w))
        own = labels[window] == k
        level = np.where(own, image[window].astype(np.float64) - threshold, 0.0)
        for part, size in _parts(own, level, area, options):
            if options.least_px <= size <= options.most_px:
                rows, columns = np.mgrid[0:h, 0:w]
                total = part.sum()
                out.append((x + (part * columns).sum() / total, y + (part * rows).sum() / total, size))
    return np.array(out, dtype=np.float64).reshape(-1, 3)


def _parts(own: BoolArray, level: FloatArray, area: int, options: BlobOptions) -> list[tuple[FloatArray, int]]:
    """The markers that one blob consists of: their levels and areas."""
    if area < 12:
        return [(level, area)]
    shape = skimage.measure.regionprops(own.astype(np.uint8))[0]  # type: ignore[no-untyped-call]
    ellipse = np.pi / 4 * shape.axis_major_length * shape.axis_minor_length
    long = shape.axis_major_length / max(shape.axis_minor_length, 1.0)
    if long < 1.35 or (shape.solidity > 0.93 and area / max(ellipse, 1.0) > options.roundness and long < 1.6):
        return [(level, area)]
    padded = np.pad(own, 1).astype(np.uint8)
    depth = cv2.distanceTransform(padded, cv2.DIST_L2, 5)[1:-1, 1:-1]
    core = skimage.measure.label(depth > 0.72 * depth.max())  # type: ignore[no-untyped-call]
    if core.max() < 2:
        return [(level, area)]
    rows, columns = np.nonzero(own)
    centres = np.array([np.argwhere(core == k).mean(0) for k in range(1, core.max() + 1)])
    nearest = np.argmin((rows[:, None] - centres[:, 0]) ** 2 + (columns[:, None] - centres[:, 1]) ** 2, axis=1)
    parts = []
    for k in range(len(centres)):
        chosen = nearest == k
        part = np.zeros_like(level)
        part[rows[chosen], columns[chosen]] = level[rows[chosen], columns[chosen]]
        if part.sum() > 0:
            parts.append((part, int(chosen.sum())))
    return parts or [(level, area)]
