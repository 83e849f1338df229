"""Metadata of a keypoint network.

A muybridge network is an ONNX file whose metadata give its kind, version, input and meaning. Whoever opens the file
(`muybridge.infer.networks.keypoints`, or the exporter's own check) parses them here into a frozen card. The formats are
described in docs/reference/model-files.md.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from muybridge.arrays import BoolArray, Float32Array, FloatArray, IndexArray
from muybridge.errors import ModelError, parsing
from muybridge.geometry.landmarks.marker_sets import SURFACE
from muybridge.geometry.landmarks.sets import BODY23, LandmarkSet
from muybridge.models.keypoints.decode import DecodedHeatmaps, decode_heatmaps, in_part, sigmoid
from muybridge.models.metadata_reader import Reader
from muybridge.models.uncertainty import SpreadCalibration

_Value = TypeVar("_Value", np.uint8, np.float32)
# The side of a crop must be a multiple of this, px.
SIDE_MULTIPLE = 32
# Output names of keypoint networks: heatmaps and visibility of the body and, if it detects them, of the virtual
# markers.
BODY_OUTPUTS = ("heatmaps", "visibility")
MARKER_OUTPUTS = ("marker_heatmaps", "marker_visibility")


@dataclass(frozen=True)
class KeypointModelCard:
    """Metadata of a keypoint network.

    Attributes:
        version: of the weights.
        landmarks: the meaning of the `J` axis.
        input_size: side of the square crops, px.
        stride: crop px per heatmap cell.
        spread: calibration from a heatmap's spread to a variance.
        markers: the virtual markers that the network detects; None if it detects none.
        marker_spread: as `spread`, for the markers.
        box_padding: side of a crop relative to the longer side of the person's bounding box.
        plate_input: name of the optional input for the difference to the background model; None if the network does not
            use it.
        metadata: all metadata, as text.
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

    def decode(self, heatmaps: Float32Array) -> DecodedHeatmaps:
        """Landmarks from heatmaps (N, J, h, w) of this network, with left-right ambiguity resolved."""
        return decode_heatmaps(heatmaps, self.stride, self.spread, self._twins)

    def scale_variance(
        self, found: DecodedHeatmaps, visibility: Float32Array, mirrored: bool | BoolArray,
        score: FloatArray | None = None,
    ) -> DecodedHeatmaps:  # fmt: skip
        """The landmarks with variances that account for visibility, mirroring and partly visible people.

        Args:
            found: N crops' landmarks.
            visibility: (N, J) logits.
            mirrored: whether outputs were averaged with those of the mirrored crops, of all or (N,) of each.
            score: (N, J) which decide which crops show part of a person; the landmarks' own by default. Needed where
                those are of maps that were combined with an expectation.
        """
        return _scale_variance(found, self.spread, visibility, mirrored, found.score if score is None else score)

    def decode_markers(
        self, heatmaps: Float32Array, visibility: Float32Array, mirrored: bool | BoolArray
    ) -> DecodedHeatmaps:
        """Virtual markers from heatmaps (N, M, h, w) and visibility logits (N, M), with variances as in
        `scale_variance`.

        Raises:
            ValueError: this network detects no markers.
        """
        if self.marker_spread is None:
            raise ValueError("this network detects no virtual markers")
        found = decode_heatmaps(heatmaps, self.stride, self.marker_spread)
        return _scale_variance(found, self.marker_spread, visibility, mirrored, found.score)

    def inputs(self, crops: NDArray[_Value]) -> dict[str, NDArray[_Value]]:
        """The network's inputs from crops (N, 3 or 4, S, S) in 0..1: RGB and the difference to the background model."""
        plate = {} if self.plate_input is None or crops.shape[1] < 4 else {self.plate_input: crops[:, 3:]}
        return {"image": crops[:, :3]} | plate


def _scale_variance(
    found: DecodedHeatmaps, spread: SpreadCalibration, visibility: Float32Array, mirrored: bool | BoolArray,
    score: FloatArray,
) -> DecodedHeatmaps:  # fmt: skip
    ratio = spread.ratio(sigmoid(visibility), np.asarray(mirrored)[..., None], in_part(score)[:, None])
    return found._replace(variance_crop_px2=found.variance_crop_px2 * ratio)


def crop_side(px: float) -> int:
    """The side nearest to `px` that a keypoint network accepts."""
    return max(1, round(px / SIDE_MULTIPLE)) * SIDE_MULTIPLE


def keypoint_card(metadata: Mapping[str, str], path: Path) -> KeypointModelCard:
    """Parse the metadata of a keypoint network.

    Args:
        metadata: the ONNX file's custom metadata.
        path: of the file, for messages.

    Raises:
        ModelError: not a muybridge keypoint network, or its metadata are damaged.
    """
    with parsing(path, ModelError, "a usable muybridge model"):
        return _keypoint_card(Reader(metadata, path), metadata)


def _keypoint_card(read: Reader, metadata: Mapping[str, str]) -> KeypointModelCard:
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
