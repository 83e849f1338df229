"""Metadata of a labelling network."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from muybridge.arrays import FloatArray, IndexArray
from muybridge.errors import ModelError, parsing
from muybridge.geometry.landmarks.marker_sets import SURFACE
from muybridge.models.metadata_reader import Reader


@dataclass(frozen=True)
class LabelModelCard:
    """Metadata of a labelling network.

    Attributes:
        version: of the weights.
        window: times relative to a frame that the network sees, seconds.
        neighbours: neighbours of a point; a frame must be padded to more points than that.
        distance_m: (L, L) mean distance between the landmarks of `SURFACE` on the training bodies, metres.
        motion_m: (L, L) its standard deviation within a clip, while a body moves, metres.
        bodies_m: (L, L) standard deviation of its mean between bodies and placements, metres.
        metadata: all metadata, as text.
    """

    version: str
    window: tuple[float, ...]
    neighbours: int
    distance_m: FloatArray
    motion_m: FloatArray
    bodies_m: FloatArray
    metadata: Mapping[str, str]

    def between(self, points: Sequence[int] | IndexArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """`distance_m`, `motion_m` and `bodies_m`, each (A, A), of some points of `SURFACE`."""
        some = np.ix_(np.asarray(points), np.asarray(points))
        return self.distance_m[some], self.motion_m[some], self.bodies_m[some]


def label_card(metadata: Mapping[str, str], path: Path) -> LabelModelCard:
    """Parse the metadata of a labelling network.

    Args:
        metadata: the ONNX file's custom metadata.
        path: of the file, for messages.

    Raises:
        ModelError: not a muybridge labelling network, or its metadata are damaged.
    """
    with parsing(path, ModelError, "a usable muybridge model"):
        return _label_card(Reader(metadata, path), metadata)


def _label_card(read: Reader, metadata: Mapping[str, str]) -> LabelModelCard:
    read.kind("labels")
    rigidity = read.json_object("rigidity")
    distance, motion, bodies = (_matrix(rigidity.get(k), k, read) for k in ("distance_mm", "motion_mm", "bodies_mm"))
    window = read.seconds("window")
    if read.names("names") != SURFACE.names:
        raise read.error("its label names are not those of the surface landmarks")
    return LabelModelCard(
        read.text("version"), window, read.integer("neighbours"), distance, motion, bodies, dict(metadata)
    )


def _matrix(value: Any, key: str, read: Reader) -> FloatArray:
    """A symmetric matrix from its upper triangle in millimetres."""
    size = len(SURFACE)
    upper = np.triu_indices(size, 1)
    if not isinstance(value, list) or len(value) != len(upper[0]):
        raise read.error(f"rigidity.{key} does not hold a number for every pair of labels")
    out = np.zeros((size, size))
    out[upper] = [read.positive(v, f"rigidity.{key}", zero=True) / 1000 for v in value]
    return out + out.T
