"""Bounding boxes from the person detector's outputs."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from muybridge.arrays import Float32Array, FloatArray, IndexArray
from muybridge.models.keypoints.decode import sigmoid


class DetectedPeople(NamedTuple):
    """People in one image, highest score first.

    Attributes:
        boxes_px: (K, 4) left, top, right, bottom, px of the network's input.
        scores: (K,) in 0..1.
    """

    boxes_px: FloatArray
    scores: FloatArray


def decode_people(
    heatmap: Float32Array,
    box: Float32Array,
    stride: int,
    threshold: float = 0.3,
    max_people: int = 16,
    max_overlap: float = 0.5,
) -> list[DetectedPeople]:
    """Bounding boxes from the detector's maps.

    Args:
        heatmap: (N, 1, h, w) logits of a box's centre.
        box: (N, 4, h, w) distances from the cell's centre to the left, top, right and bottom edge, input px.
        stride: input pixels per cell.
        threshold: least probability of a detection.
        max_people: most detections per image.
        max_overlap: of two boxes with a larger intersection over union the one with the lower score is dropped.

    Returns:
        One entry per image.

    Raises:
        ValueError: the shapes do not fit together.
    """
    if heatmap.ndim != 4 or box.shape != (len(heatmap), 4, *heatmap.shape[2:]):
        raise ValueError(f"heatmap (N, 1, h, w) and box (N, 4, h, w) expected: {heatmap.shape}, {box.shape}")
    scores = sigmoid(heatmap[:, 0])
    padded = np.pad(scores, ((0, 0), (1, 1), (1, 1)), constant_values=-1.0)
    around = np.lib.stride_tricks.sliding_window_view(padded, (3, 3), axis=(1, 2))
    peaks = (scores >= threshold) & (scores >= around.max(axis=(-1, -2)))
    found = []
    for image in range(len(scores)):
        rows, columns = np.nonzero(peaks[image])
        center = np.stack([columns, rows], axis=1) * stride + (stride - 1) / 2
        left, top, right, bottom = box[image][:, rows, columns].astype(np.float64)
        boxes = np.stack([center[:, 0] - left, center[:, 1] - top, center[:, 0] + right, center[:, 1] + bottom], axis=1)
        usable = np.isfinite(boxes).all(axis=1) & (boxes[:, 2:] - boxes[:, :2] > 1.0).all(axis=1)
        boxes, score = boxes[usable], scores[image, rows, columns][usable]
        keep = suppress_overlaps(boxes, score, max_overlap)[:max_people]
        found.append(DetectedPeople(boxes[keep], score[keep]))
    return found


def suppress_overlaps(boxes_px: FloatArray, scores: FloatArray, max_overlap: float) -> IndexArray:
    """Indices, highest score first, of the boxes that no box with a higher score overlaps by more than `max_overlap`
    (IoU)."""
    order = np.argsort(-scores, kind="stable")
    overlap = box_overlap(boxes_px, boxes_px)
    keep: list[int] = []
    for index in order:
        if not keep or overlap[index, keep].max() <= max_overlap:
            keep.append(int(index))
    return np.array(keep, dtype=np.intp)


def box_overlap(a_px: FloatArray, b_px: FloatArray) -> FloatArray:
    """(A, B) intersection over union of (A, 4) and (B, 4) boxes: left, top, right, bottom."""
    low = np.maximum(a_px[:, None, :2], b_px[None, :, :2])
    high = np.minimum(a_px[:, None, 2:], b_px[None, :, 2:])
    common = np.clip(high - low, 0, None).prod(axis=-1)
    area_a = (a_px[:, 2:] - a_px[:, :2]).prod(axis=-1)
    area_b = (b_px[:, 2:] - b_px[:, :2]).prod(axis=-1)
    overlap: FloatArray = common / np.maximum(area_a[:, None] + area_b[None, :] - common, 1e-12)
    return overlap
