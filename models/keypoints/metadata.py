"""Shipped weights and what a network's file says about itself.

A network of ours is an ONNX file whose metadata names its kind, version, input and meaning. The metadata is
read by whoever opens the file (`muybridge.infer.networks.keypoints`, or the exporter's own check) and parsed here, once,
into a frozen card. Formats are described in docs/embedding.md.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from muybridge.arrays import Float32Array, FloatArray, IndexArray
from muybridge.geometry.landmarks.marker_sets import SURFACE
from muybridge.geometry.landmarks.sets import BODY23, LandmarkSet
from muybridge.models.keypoints.decode import DecodedHeatmaps, decode_heatmaps, in_part, sigmoid
from muybridge.models.metadata_reader import Reader
from muybridge.models.uncertainty import SpreadCalibration

_Value = TypeVar("_Value", np.uint8, np.float32)
# Sides of crops that a keypoint network takes are multiples of this, px.
SIDE_MULTIPLE = 32
# What a keypoint network gives out: heatmaps and visibility, of the body and, if it finds them, of the virtual markers.
BODY_OUTPUTS = ("heatmaps", "visibility")
MARKER_OUTPUTS = ("marker_heatmaps", "marker_visibility")


@dataclass(frozen=True)
class KeypointModelCard:
    """What a keypoint network's file says about itself.

    Attributes:
        version: of the weights.
        landmarks: the meaning of the `J` axis.
        input_size: side of the square crops, px.
        stride: crop px a heatmap cell.
        spread: how a heatmap's spread becomes a variance.
        markers: the virtual markers that the network finds too; None of one that finds none.
        marker_spread: as `spread`, of the markers.
        box_padding: side of a crop over the longer side of the person's box.
        plate_input: name of the input that takes the difference to the background plate, and may be left out; None
            where the network does not see it.
        metadata: everything the file says, as text.
    """

    version: str
    landmarks: LandmarkSet
    input_size: int
    stride: int
    spread: SpreadCalibration
    markers: LandmarkSet | None
    marker_spread: SpreadCalibration | None
    box_padding: float
    plate_input: str | None
    metadata: Mapping[str, str]

    @cached_property
    def _twins(self) -> IndexArray:
        return np.array(self.landmarks.mirror, dtype=np.intp)

    def decoded(self, heatmaps: Float32Array) -> DecodedHeatmaps:
        """The landmarks that heatmaps (N, J, h, w) of this network say, twins told apart."""
        return decode_heatmaps(heatmaps, self.stride, self.spread, self._twins)

    def weighed(
        self, found: DecodedHeatmaps, visibility: Float32Array, mirrored: bool,
        score: FloatArray | None = None,
    ) -> DecodedHeatmaps:  # fmt: skip
        """The landmarks with variances that know what looks hidden, by the logits `visibility` (N, J), whether crops
        were looked at mirrored too, and which of them show a part of a person: by the landmarks' scores, or `score`
        (N, J) where theirs are of what was expected too."""
        return _weighed(found, self.spread, visibility, mirrored, found.score if score is None else score)

    def decoded_markers(self, heatmaps: Float32Array, visibility: Float32Array, mirrored: bool) -> DecodedHeatmaps:
        """The virtual markers that heatmaps (N, M, h, w) of this network say, which finds some, with variances as of
        `weighed`."""
        if self.marker_spread is None:
            raise ValueError("this network finds no virtual markers")
        found = decode_heatmaps(heatmaps, self.stride, self.marker_spread)
        return _weighed(found, self.marker_spread, visibility, mirrored, found.score)

    def inputs(self, crops: NDArray[_Value]) -> dict[str, NDArray[_Value]]:
        """The parts of crops (N, 3 or 4, S, S), RGB and the plate's difference, that each of the network's inputs takes
        in 0..1."""
        plate = {} if self.plate_input is None or crops.shape[1] < 4 else {self.plate_input: crops[:, 3:]}
        return {"image": crops[:, :3]} | plate


def _weighed(
    found: DecodedHeatmaps, spread: SpreadCalibration, visibility: Float32Array, mirrored: bool,
    score: FloatArray,
) -> DecodedHeatmaps:  # fmt: skip
    ratio = spread.ratio(sigmoid(visibility), mirrored, in_part(score)[:, None])
    return found._replace(variance_crop_px2=found.variance_crop_px2 * ratio)


def crop_side(px: float) -> int:
    """The side nearest to `px` of crops that a keypoint network takes."""
    return max(1, round(px / SIDE_MULTIPLE)) * SIDE_MULTIPLE


def keypoint_card(metadata: Mapping[str, str], path: Path) -> KeypointModelCard:
    """Parse the metadata of a keypoint network.

    Args:
        metadata: the ONNX file's custom metadata.
        path: of the file, for messages.

    Raises:
        ModelError: not a keypoint network of ours, or its metadata is damaged.
    """
    read = Reader(metadata, path)
    read.kind("keypoints")
    names = read.names("names")
    marked = "marker_names" in metadata
    return KeypointModelCard(
        version=read.text("version"),
        landmarks=_landmark_set(read.text("landmark_set"), names, read),
        input_size=read.integer("input_size", multiple_of=SIDE_MULTIPLE),
        stride=read.integer("stride"),
        spread=read.spread("variance", len(names)),
        markers=_marker_set(read.names("marker_names"), read) if marked else None,
        marker_spread=read.spread("marker_variance", len(SURFACE)) if marked else None,
        box_padding=read.positive(read.text("box_padding"), "box_padding"),
        plate_input=metadata.get("plate_input"),
        metadata=dict(metadata),
    )


def _landmark_set(name: str, names: tuple[str, ...], read: Reader) -> LandmarkSet:
    """The known set of that name, or a new one without bones."""
    if name == BODY23.name:
        if names != BODY23.names:
            raise read.error(f"its landmark names are not those of {name}")
        return BODY23
    landmarks = LandmarkSet(name, names, edges=())
    try:
        landmarks.mirror  # noqa: B018
    except ValueError:
        raise read.error("a landmark's left or right twin is not among its landmark names") from None
    return landmarks


def _marker_set(names: tuple[str, ...], read: Reader) -> LandmarkSet:
    if names != SURFACE.names:
        raise read.error(f"its marker names are not those of {SURFACE.name}")
    return SURFACE
