"""Third-party top-down pose models in place of muybridge's keypoint network, described by a model card."""

from __future__ import annotations

from pathlib import Path
from reprlib import repr as shorten

import numpy as np
import onnxruntime

from muybridge.arrays import ByteArray, Float32Array, FloatArray
from muybridge.errors import ModelError
from muybridge.geometry.landmarks.sets import BODY23, LandmarkSet
from muybridge.infer.networks.keypoints import (
    Expectation,
    KeypointNetwork,
    Located,
    OnnxOptions,
    batches,
    run_session,
)
from muybridge.infer.networks.sessions import open_session
from muybridge.models.keypoints.decode import DecodedHeatmaps
from muybridge.models.keypoints.external import ModelCard, find_card, load_card
from muybridge.models.keypoints.simcc import decode_simcc, decode_value_heatmaps
from muybridge.models.keypoints.test_time import Series

# Radius around a coordinate whose probability is its score, as a share of the crop's longer side.
_SCORE_RADIUS = 0.04

# Pixels of a batch of fixed size: 64 images of 512 px.
_LARGEST_BATCH_PX = 64 * 512**2

# These models do not predict visibility: every landmark is as likely hidden as not.
_UNKNOWN_LOGIT = 0.0


class ExternalModel:
    """A model described by a card. Its landmarks are BODY23; those that the model does not have are missing.

    Attributes:
        path: of the file.
        card: its inputs and outputs.
        metadata: for reports.
        channels: of its crops.
    """

    channels = 3

    def __init__(self, path: Path, card: ModelCard, options: OnnxOptions) -> None:
        """Open a model.

        Raises:
            ModelError: the file is missing or damaged, or its inputs and outputs are not the card's.
        """
        if options.flip:
            raise ModelError(f"{path}: mirrored crops are for muybridge's own networks; leave flip out")
        self.path, self.card, self._options = path, card, options
        self._session = open_session(path, options.threads, options.device)
        inputs = {node.name: node for node in self._session.get_inputs()}
        outputs = {node.name: node for node in self._session.get_outputs()}
        if len(inputs) != 1 or (card.input_name and card.input_name not in inputs):
            raise ModelError(f"{path}: its inputs are {', '.join(inputs)}, its card says {card.input_name or 'one'}")
        self._input = next(iter(inputs))
        for name in card.outputs:
            if name not in outputs:
                raise ModelError(f"{path}: it has no output {name!r} but {', '.join(outputs)}; correct its card")
            count = (list(outputs[name].shape) + [None, None])[1]
            if isinstance(count, int) and count != len(card.names):
                raise ModelError(
                    f"{path}: output {name!r} has {count} landmarks, its card {len(card.names)}; correct the card"
                )
        self._check_input(inputs[self._input])
        self._fixed_batch = isinstance(inputs[self._input].shape[0], int) and inputs[self._input].shape[0]
        self.metadata = {
            "name": card.name, "landmarks": ", ".join(card.names), "decode": card.decode,
            "min_confidence": str(card.min_confidence),
        }  # fmt: skip
        known = [(j, card.names.index(name)) for j, name in enumerate(BODY23.names) if name in card.names]
        self._ours, self._theirs = (np.array(index) for index in zip(*known, strict=True))

    def _check_input(self, node: onnxruntime.NodeArg) -> None:
        """ModelError unless the model takes float32 (N, 3, height, width) of the card's size."""
        wanted = (None, 3, self.card.height, self.card.width)
        fits = len(node.shape) == 4 and all(
            not isinstance(found, int) or size in (None, found) for found, size in zip(node.shape, wanted, strict=True)
        )
        if node.type == "tensor(float)" and fits:
            batch = node.shape[0]
            if isinstance(batch, int) and not 0 < batch * self.card.width * self.card.height <= _LARGEST_BATCH_PX:
                raise ModelError(
                    f"{self.path}: its input takes {batch} images of {self.card.width} x {self.card.height} px; "
                    "export it with a batch size that varies"
                )
            return
        raise ModelError(
            f"{self.path}: its input is {node.type} {shorten(list(node.shape))}, its card says float (N, 3, "
            f"{self.card.height}, {self.card.width}); correct width and height in the card, or export the model with "
            "float32 images in the order N, channels, height, width"
        )

    @property
    def landmarks(self) -> LandmarkSet:
        """The landmarks that it finds."""
        return BODY23

    @property
    def sets(self) -> tuple[LandmarkSet, ...]:
        """Landmark sets that it finds."""
        return (BODY23,)

    @property
    def crop_size(self) -> int:
        """Side of the square crops to feed, px: the longer side of the model's input."""
        return max(self.card.width, self.card.height)

    @property
    def box_padding(self) -> float:
        """Side of a crop over the longer side of the box."""
        return self.card.box_padding

    def fitted_boxes(self, boxes_px: FloatArray) -> FloatArray:
        """(N, 4) boxes widened about their middles to the shape of the model's input."""
        aspect = self.card.width / self.card.height
        middle = (boxes_px[:, :2] + boxes_px[:, 2:]) / 2
        width, height = (boxes_px[:, 2:] - boxes_px[:, :2]).T
        half = np.stack([np.maximum(width, height * aspect), np.maximum(height, width / aspect)], axis=1) / 2
        return np.concatenate([middle - half, middle + half], axis=1)

    def locate(self, crops: ByteArray, expected: Expectation | None = None, series: Series | None = None) -> Located:
        """Landmarks in (N, S, S, 3) RGB crops, S the `crop_size`; the input is the centre of the crops.

        A prior (`expected`) and the order of crops (`series`) are ignored, because the confidence of a third-party
        model's maps is not calibrated.

        Raises:
            ModelError: the model fails, or its outputs have other shapes than its card states.
        """
        card, size = self.card, self.crop_size
        if crops.shape[1:] != (size, size, 3):
            raise ValueError(f"crops must be (N, {size}, {size}, 3), not {crops.shape}")
        left, top = (size - card.width) // 2, (size - card.height) // 2
        crops = crops[:, top : top + card.height, left : left + card.width]
        count = len(BODY23)
        points = np.full((len(crops), count, 2), np.nan)
        variance, score = np.full((len(crops), count), np.nan), np.zeros((len(crops), count))
        for part in batches(len(crops), int(self._fixed_batch or self._options.batch)):
            found = self._decoded(self._run(crops[part]))
            points[part, self._ours] = found.points_crop_px[:, self._theirs] + [left, top]
            variance[part, self._ours] = found.variance_crop_px2[:, self._theirs]
            score[part, self._ours] = found.score[:, self._theirs]
        visibility = np.full((len(crops), count), _UNKNOWN_LOGIT, dtype=np.float32)
        return Located(DecodedHeatmaps(points, variance, score), visibility)

    def _run(self, crops: ByteArray) -> list[Float32Array]:
        card, count = self.card, len(crops)
        pixels = crops if card.colour == "rgb" else crops[..., ::-1]
        mean, std = (np.array(values, dtype=np.float32) for values in (card.mean, card.std))
        normalised = (pixels * np.float32(card.white / 255) - mean) / std
        image: Float32Array = np.ascontiguousarray(normalised.transpose(0, 3, 1, 2)).astype(np.float32)
        if self._fixed_batch and count < self._fixed_batch:
            filled = np.zeros((self._fixed_batch, *image.shape[1:]), dtype=np.float32)
            filled[:count] = image
            image = filled
        outputs = run_session(self._session, self.path, list(card.outputs), {self._input: image})
        axes = 3 if card.decode == "simcc" else 4
        for name, values in zip(card.outputs, outputs, strict=True):
            if values.ndim != axes or values.shape[1] != len(card.names):
                raise ModelError(
                    f"{self.path}: output {name!r} has the shape {values.shape}, not ({len(image)}, "
                    f"{len(card.names)}, ...) with {axes} axes; correct its card"
                )
        return [values[:count] for values in outputs]

    def _decoded(self, outputs: list[Float32Array]) -> DecodedHeatmaps:
        card = self.card
        if card.decode == "heatmaps":
            return decode_value_heatmaps(outputs[0], card.stride, card.origin_px, card.spread, card.logits)
        x, y = outputs
        for values, side, name in ((x, card.width, card.outputs[0]), (y, card.height, card.outputs[1])):
            if abs(values.shape[2] - side * card.split_ratio) > 1:
                raise ModelError(
                    f"{self.path}: output {name!r} has {values.shape[2]} bins for {side} px, its card says "
                    f"{card.split_ratio:g} a pixel; correct the card"
                )
        radius = _SCORE_RADIUS * self.crop_size
        return decode_simcc(x, y, card.split_ratio, card.spread, card.softmax_scale, radius)


def open_keypoints(
    path: Path, card: str | None, options: OnnxOptions, markers: bool = False
) -> KeypointNetwork | ExternalModel:
    """Muybridge's keypoint network, or a third-party model where there is a card for it.

    Args:
        path: of the ONNX file.
        card: a TOML file, the name of a shipped card, or None for `<model>.toml` beside the file, if any.
        options: how it runs.
        markers: compute the virtual markers too, which only muybridge's own networks have.

    Raises:
        ModelError: a file is missing or unusable.
    """
    found = find_card(path, card)
    if found is None:
        return KeypointNetwork(path, options, markers)
    if markers:
        raise ModelError(f"{path}: virtual markers come from muybridge's own networks alone; ask for no markers")
    return ExternalModel(path, load_card(found), options)
