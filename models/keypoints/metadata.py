"""Shipped weights and what a network's file says about itself.

A network of ours is an ONNX file whose metadata names its kind, version, input and meaning. The metadata is
read by whoever opens the file (`muybridge.infer.networks.keypoints`, or the exporter's own check) and parsed here, once,
into a frozen card. Formats are described in docs/embedding.md.
"""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from importlib import resources
from pathlib import Path
from typing import Any, Literal, TypeVar

import numpy as np
from numpy.typing import NDArray

from muybridge.errors import ModelError
from muybridge.geometry.landmarks.arrays import BODY23, SURFACE, LandmarkSet
from muybridge.models.keypoints.decode import DecodedHeatmaps, SpreadCalibration, decode_heatmaps, in_part, sigmoid

ModelKind = Literal["keypoints", "people", "labels", "solver"]
Precision = Literal["int8", "fp32"]
_Value = TypeVar("_Value", np.uint8, np.float32)
_KINDS: tuple[ModelKind, ...] = ("keypoints", "people", "labels", "solver")
# Sides of crops that a keypoint network takes are multiples of this, px.
SIDE_MULTIPLE = 32
# What a keypoint network gives out: heatmaps and visibility, of the body and, if it finds them, of the virtual markers.
BODY_OUTPUTS = ("heatmaps", "visibility")
MARKER_OUTPUTS = ("marker_heatmaps", "marker_visibility")
_REMEDY = "name a model that muybridge exported, or leave the option out to use the shipped one"


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
    def _twins(self) -> NDArray[np.intp]:
        return np.array(self.landmarks.mirror, dtype=np.intp)

    def decoded(self, heatmaps: NDArray[np.float32]) -> DecodedHeatmaps:
        """The landmarks that heatmaps (N, J, h, w) of this network say, twins told apart."""
        return decode_heatmaps(heatmaps, self.stride, self.spread, self._twins)

    def weighed(
        self, found: DecodedHeatmaps, visibility: NDArray[np.float32], mirrored: bool,
        score: NDArray[np.float64] | None = None,
    ) -> DecodedHeatmaps:  # fmt: skip
        """The landmarks with variances that know what looks hidden, by the logits `visibility` (N, J), whether crops
        were looked at mirrored too, and which of them show a part of a person: by the landmarks' scores, or `score`
        (N, J) where theirs are of what was expected too."""
        return _weighed(found, self.spread, visibility, mirrored, found.score if score is None else score)

    def decoded_markers(
        self, heatmaps: NDArray[np.float32], visibility: NDArray[np.float32], mirrored: bool
    ) -> DecodedHeatmaps:
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
    found: DecodedHeatmaps, spread: SpreadCalibration, visibility: NDArray[np.float32], mirrored: bool,
    score: NDArray[np.float64],
) -> DecodedHeatmaps:  # fmt: skip
    ratio = spread.ratio(sigmoid(visibility), mirrored, in_part(score)[:, None])
    return found._replace(variance_crop_px2=found.variance_crop_px2 * ratio)


@dataclass(frozen=True)
class PeopleModelCard:
    """What a person detector's file says about itself.

    Attributes:
        version: of the weights.
        input_long_side: the longer side frames are resized to, px.
        stride: input px a heatmap cell.
        metadata: everything the file says, as text.
    """

    version: str
    input_long_side: int
    stride: int
    metadata: Mapping[str, str]


def crop_side(px: float) -> int:
    """The side nearest to `px` of crops that a keypoint network takes."""
    return max(1, round(px / SIDE_MULTIPLE)) * SIDE_MULTIPLE


def shipped_model(kind: ModelKind, precision: Precision = "fp32") -> Path:
    """Path of the weights that came with the package.

    Args:
        kind: what the network is for.
        precision: `int8` is three times as fast, to be had of the keypoint network alone.

    Raises:
        ModelError: the installation has none.
    """
    if kind not in _KINDS:
        raise ValueError(f"no model of kind {kind!r}; known: {', '.join(_KINDS)}")
    file = f"{kind}-int8.onnx" if precision == "int8" else f"{kind}.onnx"
    path = Path(str(resources.files("muybridge.models"))) / "weights" / file
    if not path.is_file():
        raise ModelError(
            f"{path}: the shipped {kind} model is missing; reinstall muybridge, or name a model file of yours"
        )
    return path


def keypoint_card(metadata: Mapping[str, str], path: Path) -> KeypointModelCard:
    """Parse the metadata of a keypoint network.

    Args:
        metadata: the ONNX file's custom metadata.
        path: of the file, for messages.

    Raises:
        ModelError: not a keypoint network of ours, or its metadata is damaged.
    """
    read = _Reader(metadata, path)
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


def people_card(metadata: Mapping[str, str], path: Path) -> PeopleModelCard:
    """Parse the metadata of a person detector; arguments and errors as `keypoint_card`."""
    read = _Reader(metadata, path)
    read.kind("people")
    return PeopleModelCard(
        version=read.text("version"),
        input_long_side=read.integer("input_long_side"),
        stride=read.integer("stride"),
        metadata=dict(metadata),
    )


def _landmark_set(name: str, names: tuple[str, ...], read: _Reader) -> LandmarkSet:
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


def _marker_set(names: tuple[str, ...], read: _Reader) -> LandmarkSet:
    if names != SURFACE.names:
        raise read.error(f"its marker names are not those of {SURFACE.name}")
    return SURFACE


class _Reader:
    """Typed access to a file's metadata; every complaint is a ModelError that names the file."""

    def __init__(self, metadata: Mapping[str, str], path: Path) -> None:
        self._metadata = metadata
        self._path = path

    def error(self, what: str) -> ModelError:
        return ModelError(f"{self._path}: not a usable muybridge model: {what}; {_REMEDY}")

    def kind(self, expected: ModelKind) -> None:
        found = self._metadata.get("muybridge_kind")
        if found is None:
            raise ModelError(
                f"{self._path}: an ONNX file, but not one of muybridge's (no muybridge_kind in its "
                f"metadata); for a keypoint network of others name its card with --model-card; {_REMEDY}"
            )
        if found != expected:
            raise ModelError(
                f"{self._path}: a muybridge model of kind {found!r} where {expected!r} is needed; {_REMEDY}"
            )

    def text(self, key: str) -> str:
        value = self._metadata.get(key, "")
        if not value:
            raise self.error(f"its metadata has no {key}")
        return value

    def integer(self, key: str, multiple_of: int = 1) -> int:
        text = self.text(key)
        if not text.isdecimal() or int(text) == 0 or int(text) % multiple_of:
            wanted = "a positive whole number" + (f" divisible by {multiple_of}" if multiple_of > 1 else "")
            raise self.error(f"{key} is {text!r}, not {wanted}")
        return int(text)

    def positive(self, value: Any, key: str) -> float:
        try:
            number = float(value)
        except (TypeError, ValueError):
            raise self.error(f"{key} is {value!r}, not a number") from None
        if not (math.isfinite(number) and number > 0):
            raise self.error(f"{key} is {number}, not a positive number")
        return number

    def knots(self, value: Any, key: str) -> tuple[tuple[float, float], ...]:
        """Pairs of positive numbers, both ascending; older files have none."""
        if not isinstance(value, list) or not all(isinstance(pair, list) and len(pair) == 2 for pair in value):
            raise self.error(f"{key} is not a list of pairs")
        pairs = tuple((self.positive(a, key), self.positive(b, key)) for a, b in value)
        for (a, b), (next_a, next_b) in zip(pairs, pairs[1:], strict=False):
            if next_a <= a or next_b < b:
                raise self.error(f"{key} do not ascend")
        return pairs

    def json_object(self, key: str) -> dict[str, Any]:
        value = self._json(key)
        if not isinstance(value, dict):
            raise self.error(f"{key} is not a JSON object")
        return value

    def ratios(self, value: Any, key: str, count: int) -> tuple[float, ...]:
        """One positive number a landmark; older files have none."""
        if not isinstance(value, list) or len(value) not in (0, count):
            raise self.error(f"{key} is not a list of {count} numbers, one a landmark")
        return tuple(self.positive(ratio, key) for ratio in value)

    def spread(self, key: str, landmarks: int) -> SpreadCalibration:
        spread = self.json_object(key)
        return SpreadCalibration(
            scale=self.positive(spread.get("scale"), f"{key}.scale"),
            floor_px2=self.positive(spread.get("floor_px2"), f"{key}.floor_px2"),
            knots=self.knots(spread.get("knots", []), f"{key}.knots"),
            hidden=self.positive(spread.get("hidden", 1.0), f"{key}.hidden"),  # older files know none of these
            mirrored=self.positive(spread.get("mirrored", 1.0), f"{key}.mirrored"),
            part=self.positive(spread.get("part", 1.0), f"{key}.part"),
            landmarks=self.ratios(spread.get("landmarks", []), f"{key}.landmarks", landmarks),
        )

    def names(self, key: str) -> tuple[str, ...]:
        value = self._json(key)
        if not isinstance(value, list) or not value or not all(isinstance(n, str) for n in value):
            raise self.error(f"{key} is not a JSON list of landmark names")
        if len(set(value)) != len(value):
            raise self.error("a landmark name is there twice")
        return tuple(value)

    def _json(self, key: str) -> Any:
        try:
            return json.loads(self.text(key))
        except json.JSONDecodeError:
            raise self.error(f"{key} is not JSON") from None
