"""The networks as functions: onnxruntime sessions whose files are checked before the first frame.

One thread per session is the default: larger batches and threads within a network gain almost nothing with these small
networks, whereas several cameras, each with its own sessions, run in parallel.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from types import MappingProxyType
from typing import Any, NamedTuple

import numpy as np
import onnxruntime

from muybridge.arrays import BoolArray, ByteArray, Float32Array, FloatArray, IndexArray
from muybridge.errors import ModelError
from muybridge.geometry.landmarks.sets import LandmarkSet
from muybridge.infer.networks.sessions import REMEDY, Device, open_session
from muybridge.models.keypoints.decode import NO_IDEA, WITHHELD, DecodedHeatmaps, with_expectation
from muybridge.models.keypoints.metadata import (
    BODY_OUTPUTS,
    MARKER_OUTPUTS,
    SIDE_MULTIPLE,
    KeypointModelCard,
    crop_side,
    keypoint_card,
)
from muybridge.models.keypoints.test_time import (
    LEAST,
    WORTH_MIRRORING,
    Series,
    augment_at_test_time,
    crop_uncertainty,
    mean_of_mirrored,
)
from muybridge.models.metadata_reader import metadata_of
from muybridge.models.people.metadata import PeopleModelCard, people_card

# Limits of `OnnxOptions.size`: below the first the networks find nobody, and beyond the second they are wrong in some
# views, which looks like a fault of the calibration.
SIZES = LEAST, 1.5


@dataclass(frozen=True)
class OnnxOptions:
    """How networks run.

    Attributes:
        threads: threads within one network.
        device: what networks run on: the processor, a graphics card through one of onnxruntime's providers, or `auto`
            for the first of these that is there.
        batch: images per call; it bounds memory, and speed hardly depends on it.
        flip: run the keypoint network on the mirrored crop too and average: more accurate, twice the time. By default
            with muybridge's 8-bit networks, which take half the time, on crops of which the first reading is not sure.
        size: side of the keypoint network's crops relative to the one at which it is most accurate; smaller crops are
            faster. By default 1, and less in a first pass over views that are all read again.
        turn: test-time augmentation of the keypoint network: people seen in part are also read smaller, crops of low
            confidence also rotated by quarter turns (people who lie or stand on their hands) and, where crops are
            mirrored, tilted to both sides and read in a tighter box.
    """

    threads: int = 1
    batch: int = 16
    flip: bool | None = None
    size: float | None = None
    turn: bool = True
    device: Device = "cpu"

    def __post_init__(self) -> None:
        if self.threads < 1 or self.batch < 1:
            raise ValueError("threads and batch must be at least 1")
        if self.size is not None and not SIZES[0] <= self.size <= SIZES[1]:
            least, most = SIZES
            raise ValueError(f"size must be between {least:g} and {most:g} of the network's own, not {self.size}")


class Located(NamedTuple):
    """Landmarks in N crops.

    Attributes:
        found: points, variances and scores of the body's J landmarks, px of the crops.
        visibility: (N, J) logits of the body's landmarks being in view.
        further: the same as `found` for the network's other landmark sets, by name.
        alone: `found` without the expectation, where there was one.
    """

    found: DecodedHeatmaps
    visibility: Float32Array
    further: Mapping[str, DecodedHeatmaps] = MappingProxyType({})
    alone: DecodedHeatmaps | None = None


class Expectation(NamedTuple):
    """A prior on where landmarks are.

    Attributes:
        points_px: (N, J, 2) px of the crops; NaN where there is none.
        sd: standard deviation, in sides of a crop.
        most: largest penalty of a position, nats.
    """

    points_px: FloatArray
    sd: float
    most: float


class KeypointNetwork:
    """A keypoint network: crops to heatmaps.

    Attributes:
        path: of the file.
        card: the file's metadata, parsed.
        metadata: the same as text, for reports.
        sets: landmark sets that it finds: the body's and, where they were asked for, the virtual markers.
        channels: of its crops: 4 with the difference to the background, otherwise 3.
    """

    def __init__(self, path: Path, options: OnnxOptions = OnnxOptions(), markers: bool = False) -> None:
        """Open a network.

        Args:
            path: of the file.
            options: how it runs.
            markers: compute the virtual markers too.

        Raises:
            ModelError: the file is missing, damaged or no keypoint network of muybridge's, or has no markers.
        """
        self.path = path
        self._options = options
        self._session = open_session(path, options.threads, options.device, () if markers else MARKER_OUTPUTS)
        self.card: KeypointModelCard = keypoint_card(metadata_of(self._session, path), path)
        count = len(self.card.landmarks)
        outputs = dict(zip(BODY_OUTPUTS, ((4, count), (2, count)), strict=True))
        self.sets: tuple[LandmarkSet, ...] = (self.card.landmarks,)
        if markers:
            if self.card.markers is None:
                raise ModelError(f"{path}: this network finds no virtual markers; {REMEDY}, or ask for no markers")
            self.sets = self.card.landmarks, self.card.markers
            many = len(self.card.markers)
            outputs |= zip(MARKER_OUTPUTS, ((4, many), (2, many)), strict=True)
        _check_signature(self._session, path, channels=3, outputs=outputs)
        plate = self.card.plate_input  # networks of earlier versions have none
        if plate is not None and plate not in [n.name for n in self._session.get_overridable_initializers()]:
            raise ModelError(f"{path}: not a usable muybridge model: its input {plate!r} cannot be left out; {REMEDY}")
        self.channels = 3 if plate is None else 4
        self.metadata = dict(self.card.metadata)
        self._flip = self.metadata.get("precision") == "int8" if options.flip is None else options.flip
        self._flip_all = options.flip is True

    @property
    def landmarks(self) -> LandmarkSet:
        """The body landmarks that it finds."""
        return self.card.landmarks

    @property
    def crop_size(self) -> int:
        """Side of the crops, px."""
        return crop_side(self.card.input_size * (1.0 if self._options.size is None else self._options.size))

    @property
    def box_padding(self) -> float:
        """Side of a crop over the longer side of the box."""
        return self.card.box_padding

    def fitted_boxes(self, boxes_px: FloatArray) -> FloatArray:
        """(N, 4) boxes as the crops want them: as they are, since the crops are square."""
        return boxes_px

    def locate(self, crops: ByteArray, expected: Expectation | None = None, series: Series | None = None) -> Located:
        """Landmarks in crops.

        Args:
            crops: (N, S, S, C), see `__call__`.
            expected: prior on where landmarks are.
            series: which crops follow each other in a track, so that not all are augmented.
        """
        card = self.card
        maps, mirrored = self._read(crops)
        if self._options.turn:
            alone = augment_at_test_time(self, crops, maps, card, 1, series, tilt=self._flip)
        else:
            alone = card.decode(maps[0])
        heatmaps, visibility, *markers = maps
        alone = card.scale_variance(alone, visibility, mirrored)
        further = {}
        if markers:
            further[self.sets[1].name] = _known(card.decode_markers(markers[0], markers[1], mirrored))
        nothing = alone.score < WITHHELD
        if expected is None:
            return Located(_known(alone, nothing), visibility, further)
        sd_px = expected.sd * crops.shape[1]
        heatmaps = with_expectation(heatmaps, card.stride, expected.points_px, sd_px, expected.most)
        found = card.scale_variance(card.decode(heatmaps), visibility, mirrored, alone.score)
        # An uninformative map would otherwise return the prior.
        return Located(_known(found, nothing), visibility, further, _known(alone, nothing))

    def _read(self, crops: ByteArray) -> tuple[list[Float32Array], BoolArray]:
        """The maps of crops as `__call__` gives them, mirrored where that is wanted, and (N,) where it was."""
        mirrored = np.full(len(crops), self._flip)
        if not self._flip or self._flip_all:
            return self(crops), mirrored
        maps = self._maps(crops, [crops])
        mirrored = crop_uncertainty(self.card.decode(maps[0]), crops.shape[1]) > WORTH_MIRRORING
        if mirrored.any():
            unsure = crops[mirrored]
            for k, (out, other) in enumerate(zip(maps, self._maps(unsure, [unsure[:, :, ::-1]]), strict=True)):
                out[mirrored] = mean_of_mirrored(out[mirrored], other, self._twins(k))
        return maps, mirrored

    def __call__(self, crops: ByteArray) -> list[Float32Array]:
        """Run the network.

        Args:
            crops: (N, S, S, 3) RGB, S the card's `input_size`, at which the network is best, or another multiple of
                32; or (N, S, S, 4) with the difference to the background, if the network takes it.

        Returns:
            heatmaps (N, J, S/stride, S/stride) and visibility (N, J), both logits, and the same of the M markers where
            they are computed.
        """
        size = crops.shape[1]
        if size % SIDE_MULTIPLE or crops.shape[1:] not in {(size, size, channels) for channels in (3, self.channels)}:
            wanted = f"(N, S, S, {self.channels}), S a multiple of {SIDE_MULTIPLE}"
            raise ValueError(f"crops must be {wanted}, not {crops.shape}")
        return self._maps(crops, self._views(crops))

    def _maps(self, crops: ByteArray, views: list[ByteArray]) -> list[Float32Array]:
        """The maps of crops (N, S, S, C) averaged over `views` of them: themselves and, second, mirrored; or one."""
        size = crops.shape[1]
        cells = size // self.card.stride
        maps = []
        for each in self.sets:
            maps.append(np.empty((len(crops), len(each), cells, cells), dtype=np.float32))
            maps.append(np.empty((len(crops), len(each)), dtype=np.float32))
        for part in batches(len(crops), self._options.batch):
            found, *mirrored = [self._run(view[part]) for view in views]
            for out, once in zip(maps, found, strict=True):
                if once.shape != out[part].shape:
                    raise ModelError(f"{self.path}: an output has the shape {once.shape}, and its metadata mean "
                                     f"{out[part].shape}; {REMEDY}")  # fmt: skip
                out[part] = once
            for other in mirrored:
                for k, out in enumerate(maps):
                    out[part] = mean_of_mirrored(out[part], other[k], self._twins(k))
        return maps

    def _twins(self, k: int) -> IndexArray:
        """(J,) each landmark's counterpart on the other side, of the set that the map k belongs to."""
        return np.array(self.sets[k // 2].mirror, dtype=np.intp)

    def _views(self, crops: ByteArray) -> list[ByteArray]:
        """The crops and, where that is wanted, the mirrored ones."""
        return [crops, crops[:, :, ::-1]] if self._flip else [crops]

    def _run(self, crops: ByteArray) -> Sequence[Float32Array]:
        # Transposed as bytes, a quarter of the size of floats.
        planes = np.ascontiguousarray(crops.transpose(0, 3, 1, 2))
        inputs = {name: np.multiply(part, np.float32(1 / 255)) for name, part in self.card.inputs(planes).items()}
        outputs = [*BODY_OUTPUTS, *MARKER_OUTPUTS][: 2 * len(self.sets)]
        return run_session(self._session, self.path, outputs, inputs)


def _known(found: DecodedHeatmaps, nothing: BoolArray | None = None) -> DecodedHeatmaps:
    """The landmarks without those of which the network knows nothing (N, J)."""
    points, variance, score = found
    nothing = score < NO_IDEA if nothing is None else nothing
    return DecodedHeatmaps(np.where(nothing[..., None], np.nan, points), np.where(nothing, np.nan, variance),
                           np.where(nothing, 0.0, score))  # fmt: skip


class PeopleNetwork:
    """A person detector: small frames with a background difference to maps of people.

    Attributes:
        path: of the file.
        card: the file's metadata, parsed.
    """

    def __init__(self, path: Path, options: OnnxOptions = OnnxOptions()) -> None:
        """Open a network; errors as `KeypointNetwork`."""
        self.path = path
        self._options = options
        self._session = open_session(path, options.threads, options.device)
        self.card: PeopleModelCard = people_card(metadata_of(self._session, path), path)
        _check_signature(self._session, path, channels=4, outputs={"heatmap": (4, 1), "box": (4, 4)})

    def __call__(self, frames: ByteArray, difference: Float32Array) -> tuple[Float32Array, Float32Array]:
        """Run the network.

        Args:
            frames: (N, h, w, 3) RGB at the network's resolution, h and w multiples of 32.
            difference: (N, h, w) mean over RGB of |frame - background| in 0..1, zero where unknown.

        Returns:
            heatmap (N, 1, h/stride, w/stride) logits and box (N, 4, h/stride, w/stride) px.
        """
        if frames.shape[:3] != difference.shape or frames.shape[1] % 32 or frames.shape[2] % 32:
            raise ValueError(f"frames (N, h, w, 3) and difference (N, h, w) expected, not {frames.shape}")
        heatmaps, boxes = [], []
        for part in batches(len(frames), self._options.batch):
            image = np.empty((len(frames[part]), 4, *frames.shape[1:3]), dtype=np.float32)
            planes = np.ascontiguousarray(frames[part].transpose(0, 3, 1, 2))
            np.multiply(planes, np.float32(1 / 255), out=image[:, :3])
            image[:, 3] = difference[part]
            heatmap, box = run_session(self._session, self.path, ["heatmap", "box"], {"image": image})
            cells = tuple(side // self.card.stride for side in frames.shape[1:3])
            if heatmap.shape[2:] != cells or box.shape[2:] != cells:
                raise ModelError(f"{self.path}: its maps have {heatmap.shape[2:]} and {box.shape[2:]} cells, and its "
                                 f"metadata mean {cells}; {REMEDY}")  # fmt: skip
            heatmaps.append(heatmap)
            boxes.append(box)
        return np.concatenate(heatmaps), np.concatenate(boxes)


def batches(count: int, size: int) -> list[slice]:
    """Slices of at most `size` that cover `count`."""
    return [slice(start, start + size) for start in range(0, count, size)]


def _check_signature(
    session: onnxruntime.InferenceSession, path: Path, channels: int, outputs: dict[str, tuple[int, int]]
) -> None:
    """ModelError unless the graph has the input `image` and the outputs, by name: (axes, size of axis 1)."""

    def check(what: str, found: list[Any], name: str, axes: int, size: int) -> None:
        node = next((n for n in found if n.name == name), None)
        if node is None:
            raise ModelError(f"{path}: not a usable muybridge model: it has no {what} {name!r}; {REMEDY}")
        shape = list(node.shape)
        fixed = len(shape) == axes and (not isinstance(shape[1], int) or shape[1] == size)
        if not fixed or node.type != "tensor(float)":
            raise ModelError(
                f"{path}: not a usable muybridge model: {what} {name!r} is {node.type} {shape}, expected "
                f"float with {axes} axes, {size} along the second; {REMEDY}"
            )

    check("input", session.get_inputs(), "image", 4, channels)
    for name, (axes, size) in outputs.items():
        check("output", session.get_outputs(), name, axes, size)


def run_session(
    session: onnxruntime.InferenceSession, path: Path, outputs: list[str], inputs: dict[str, Float32Array]
) -> Sequence[Float32Array]:
    """The named outputs for named inputs.

    Raises:
        ModelError: the network fails.
    """
    try:
        result: Sequence[Float32Array] = session.run(outputs, inputs)
    except Exception as error:  # onnxruntime's exceptions share no base but Exception
        shapes = ", ".join(str(values.shape) for values in inputs.values())
        raise ModelError(
            f"{path}: the network failed on an input of shape {shapes}: {str(error).splitlines()[0]}; {REMEDY}"
        ) from error
    return result
