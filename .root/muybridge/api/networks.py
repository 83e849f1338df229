"""The shipped networks on plain images: where people are, and where their landmarks are."""

from __future__ import annotations

import os
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike, NDArray

from muybridge.arrays import ByteArray, FloatArray
from muybridge.geometry.cameras.camera import Camera
from muybridge.geometry.landmarks.sets import LandmarkSet
from muybridge.infer.detection.background import BackgroundModel
from muybridge.infer.detection.crop_reader import Pictures, PoseReader
from muybridge.infer.detection.exposure import stretch_contrast
from muybridge.infer.detection.orientation import FrameOrientation, Letterbox, orientation_for
from muybridge.infer.detection.person_detector import PeopleDetector, PeopleOptions
from muybridge.infer.detection.pose_estimator import KeypointOptions
from muybridge.infer.networks.external import open_keypoints
from muybridge.infer.networks.keypoints import OnnxOptions, PeopleNetwork
from muybridge.models.shipped import Precision, shipped_model


@dataclass(frozen=True, eq=False)
class PersonBoxes:
    """People in one image, best first.

    Attributes:
        boxes_px: (K, 4) left, top, right, bottom, px of the image.
        confidence: (K,) probability of each, 0..1.
    """

    boxes_px: FloatArray
    confidence: FloatArray

    def __len__(self) -> int:
        return len(self.boxes_px)


@dataclass(frozen=True, eq=False)
class ImageLandmarks:
    """Landmarks of K people in one image.

    Attributes:
        landmarks: the meaning of the J axis.
        points_px: (K, J, 2) px of the image, (0, 0) the centre of the top-left pixel; NaN where the network does not
            find the landmark.
        sd_px: (K, J) standard deviation of each coordinate, px; NaN where missing.
        confidence: (K, J) in 0..1; zero where missing.
        visibility: (K, J) probability that nothing hides the landmark.
        boxes_px: (K, 4) the boxes that were read in the end, px of the image.
    """

    landmarks: LandmarkSet
    points_px: FloatArray
    sd_px: FloatArray
    confidence: FloatArray
    visibility: FloatArray
    boxes_px: FloatArray

    def __len__(self) -> int:
        return len(self.points_px)


class PersonDetector:
    """Finds people in images; each image by itself."""

    def __init__(
        self,
        model: str | os.PathLike[str] | None = None,
        *,
        min_confidence: float = 0.35,
        onnx: OnnxOptions | None = None,
    ) -> None:
        """Open the network.

        Args:
            model: an ONNX file of muybridge's kind; the shipped one where it is None.
            min_confidence: least probability of a person, 0..1.
            onnx: how the network runs.

        Raises:
            ModelError: the file is missing, damaged or no person detector of muybridge's.
        """
        path = shipped_model("people") if model is None else Path(model)
        self._network = PeopleNetwork(path, onnx or OnnxOptions())
        self._options = PeopleOptions(min_score=min_confidence)

    def detect(
        self, image: NDArray[np.uint8], *, camera: Camera | None = None, background: NDArray[np.uint8] | None = None
    ) -> PersonBoxes:
        """Find the people in one image.

        Args:
            image: (H, W, 3) RGB.
            camera: the calibrated camera, Z up; its images are turned upright first, which matters for cameras that
                are mounted on their side or upside down.
            background: (H, W, 3) RGB, what the camera sees without anybody; people are found more surely with it.

        Raises:
            ValueError: an image that is not (H, W, 3) uint8, or of another size than `camera` or `background`.

        Example:
            >>> import muybridge, numpy
            >>> empty = numpy.full((480, 640, 3), 90, numpy.uint8)
            >>> len(muybridge.PersonDetector().detect(empty))
            0
        """
        frame, upright, backdrop, small = _prepared(image, camera, background, self._network)
        detector = PeopleDetector(self._network, small, self._options)
        found = detector(backdrop(frame[None]))[0]
        assert found is not None  # of a frame that is looked at
        return PersonBoxes(upright.around_in_frame(found.boxes_px), found.scores)


class KeypointNetwork:
    """Finds the landmarks of people whose bounding boxes are known; each image by itself.

    Attributes:
        landmarks: what it finds, the meaning of the J axis.
    """

    def __init__(
        self,
        model: str | os.PathLike[str] | None = None,
        *,
        model_card: str | None = None,
        precision: Precision = "int8",
        onnx: OnnxOptions | None = None,
    ) -> None:
        """Open the network.

        Args:
            model: an ONNX file; the shipped one where it is None.
            model_card: what that network takes in and gives out, where it is not one of muybridge's: a TOML file, or
                the name of a card that comes with muybridge, such as `rtmpose-coco17`.
            precision: of the shipped network.
            onnx: how the network runs.

        Raises:
            ModelError: a file is missing, damaged or unusable.
        """
        path = shipped_model("keypoints", precision) if model is None else Path(model)
        self._options = KeypointOptions(onnx=onnx or OnnxOptions())
        self._network = open_keypoints(path, model_card, self._options.onnx, False)
        self._people = PeopleNetwork(shipped_model("people"), OnnxOptions())
        self.landmarks: LandmarkSet = self._network.landmarks

    def locate(
        self,
        image: NDArray[np.uint8],
        boxes_px: ArrayLike,
        *,
        camera: Camera | None = None,
        background: NDArray[np.uint8] | None = None,
    ) -> ImageLandmarks:
        """Locate the landmarks of the people in these boxes.

        Args:
            image: (H, W, 3) RGB.
            boxes_px: (K, 4) left, top, right, bottom, px of the image: `PersonDetector.detect(image).boxes_px`.
                Where the landmarks suggest another box, that is read too, and kept if the network is more confident.
            camera: the calibrated camera, Z up; crops are then those of a level virtual camera, as in training.
            background: (H, W, 3) RGB, what the camera sees without anybody; landmarks are more accurate with it.

        Raises:
            ValueError: an image that is not (H, W, 3) uint8 or of another size than `camera` or `background`, or boxes
                that are not (K, 4) with left < right and top < bottom.

        Example:
            >>> import muybridge, numpy
            >>> image = numpy.full((480, 640, 3), 90, numpy.uint8)
            >>> found = muybridge.KeypointNetwork().locate(image, [[200, 100, 300, 400]])
            >>> found.points_px.shape, found.sd_px.shape
            ((1, 23, 2), (1, 23))
        """
        boxes = np.asarray(boxes_px, dtype=np.float64)
        if boxes.ndim != 2 or boxes.shape[1] != 4 or not (boxes[:, 2:] > boxes[:, :2]).all():
            raise ValueError(f"boxes_px must be (K, 4): left < right, top < bottom; not {boxes.tolist()}")
        frame, upright, backdrop, _ = _prepared(image, camera, background, self._people)
        pictures = Pictures(frame[None], backdrop(frame[None]))
        reader = PoseReader(self._network, camera, upright, backdrop, 30.0)
        where, person = np.zeros(len(boxes), dtype=np.intp), np.arange(len(boxes))
        options = self._options
        poses = reader(pictures, where, person, _around_upright(upright, boxes))
        poses = reader.refined(pictures, where, person, poses, options.min_confidence, options.refine_change)
        body = poses.body
        return ImageLandmarks(
            landmarks=self.landmarks,
            points_px=np.asarray(body.points_px, dtype=np.float64),
            sd_px=np.sqrt(body.variance_px2),
            confidence=np.asarray(body.score, dtype=np.float64),
            visibility=np.asarray(body.visibility, dtype=np.float64),
            boxes_px=upright.around_in_frame(poses.boxes_px),
        )


def checked_image(image: NDArray[np.uint8], camera: Camera | None, what: str = "image") -> ByteArray:
    """A copy of an image (H, W, 3), stretched where it is too dark or flat for the networks.

    Raises:
        ValueError: it is no RGB image of bytes, or not of the camera's size.
    """
    array = np.asarray(image)
    if array.ndim != 3 or array.shape[-1] != 3 or array.dtype != np.uint8:
        raise ValueError(f"{what} must be (H, W, 3) RGB uint8, not {array.shape} {array.dtype}")
    if camera is not None and array.shape[:2] != (camera.height, camera.width):
        raise ValueError(
            f"{what} of {array.shape[1]}x{array.shape[0]} px for camera {camera.name} of "
            f"{camera.width}x{camera.height}: resize it, or pass a calibration of its size"
        )
    frame = np.array(array, dtype=np.uint8, order="C")
    stretch_contrast(frame)
    return frame


def _prepared(
    image: NDArray[np.uint8], camera: Camera | None, background: NDArray[np.uint8] | None, people: PeopleNetwork
) -> tuple[ByteArray, FrameOrientation, BackgroundModel, Letterbox]:
    """The image, its turn to upright, its background model and the detector's letterbox."""
    frame = checked_image(image, camera)
    height, width = frame.shape[:2]
    upright = orientation_for(camera, width, height)
    small = Letterbox(upright, people.card.input_long_side)
    if background is None:
        return frame, upright, BackgroundModel(small, enabled=False), small
    empty = checked_image(background, camera, "background")
    if empty.shape != frame.shape:
        raise ValueError(f"background of {empty.shape[1]}x{empty.shape[0]} px for an image of {width}x{height}")
    return frame, upright, BackgroundModel(small, known=small.apply(empty)), small


def _around_upright(upright: FrameOrientation, boxes_px: FloatArray) -> FloatArray:
    """(K, 4) boxes in upright px around boxes in px of the frame."""
    left, top, right, bottom = boxes_px.T
    corners = np.stack([left, top, right, top, right, bottom, left, bottom], axis=1).reshape(-1, 4, 2)
    corners = upright.to_upright(corners)
    return np.concatenate([corners.min(axis=1), corners.max(axis=1)], axis=1)
