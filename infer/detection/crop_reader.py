"""Landmarks of people whose boxes are known: crop, run the network, decode; crop again where the box was poor."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np
import scipy
from numpy.typing import NDArray

from muybridge.arrays import BoolArray, ByteArray, FloatArray, IndexArray, IntArray
from muybridge.geometry.cameras.camera import Camera
from muybridge.geometry.cameras.crops import Crops, crops_for_boxes
from muybridge.geometry.landmarks.sets import LandmarkSet
from muybridge.geometry.numerics.robust import row_median
from muybridge.infer.detection.background import BackgroundModel, SmallFrames
from muybridge.infer.detection.crop_pixels import extract_crops, scaled_down
from muybridge.infer.detection.exposure import brighten_crops
from muybridge.infer.detection.orientation import FrameOrientation
from muybridge.infer.detection.resample import fast_gaps, interpolate_poses, scatter_poses
from muybridge.infer.detection.tracker import filled_boxes, smoothed_boxes, smoothing_frames
from muybridge.infer.detection.tracks import LandmarkArrays, body_of, by_name, flat
from muybridge.infer.networks.external import ExternalModel
from muybridge.infer.networks.keypoints import Expectation, KeypointNetwork, Located
from muybridge.models.keypoints.decode import DecodedHeatmaps, sigmoid
from muybridge.models.keypoints.test_time import Series

# Margin of a person's box around the landmarks, in longer sides of the landmarks' own box.
_REACH = {"nose": 0.11, "eye": 0.11, "ear": 0.11, "wrist": 0.10}
_REACH_ELSEWHERE = 0.04

# Boxes narrower than this are widened: they are too small to show anything.
_MIN_BOX_PX = 8.0

# Edges of boxes are rounded to a grid of so many cells per power of two below their longer side.
_GRID = 64

# Smoothing of the landmarks' own boxes (seconds), and how many frames around a poor box are read again.
_OWN_BOX_SMOOTHING = 0.067
_REDO_AROUND = 3

# Interval (seconds) at which crops of low confidence in a track are read in every orientation.
_TRY_EVERY = 0.13

# Two tracks are one person if the median distance of their landmarks is below this share of the body's longer side; the
# younger one is dropped unless its confidence is higher by this much. Landmarks of which both are confident decide,
# where there are enough: those that one crop shows and the other cuts off are guesses.
_SAME_PERSON = 0.06
_MUCH_MORE_CONFIDENT = 0.1
_CONFIDENT, _ENOUGH_CONFIDENT = 0.3, 5


@dataclass(frozen=True, eq=False)
class Poses:
    """Landmarks in K boxes, K over frames and tracks.

    Attributes:
        landmarks: (K, J, ...) arrays by the name of their set, the body's first; px of the frame.
        boxes_px: (K, 4) boxes that were cropped, upright px.
    """

    landmarks: Mapping[str, LandmarkArrays]
    boxes_px: FloatArray

    @property
    def body(self) -> LandmarkArrays:
        """The body's landmarks."""
        return body_of(self.landmarks)

    @property
    def confidence(self) -> FloatArray:
        """(K,) mean score of the landmarks found; the others may lie outside the image, or another model may not know
        them. With fewer than a third of the landmarks found, the sum is divided by that third, because a false
        detection has one or two."""
        body = self.body
        there = np.isfinite(body.points_px).all(axis=-1).sum(axis=1)
        return np.asarray(body.score.sum(axis=1) / np.maximum(there, body.score.shape[1] / 3), dtype=np.float64)

    def arrays(self) -> dict[str, NDArray[Any]]:
        """All arrays, without a copy: those of the sets as `body23.points_px` and so on, and `boxes_px`."""
        return {**flat(self.landmarks), "boxes_px": self.boxes_px}

    def select(self, index: IndexArray) -> Poses:
        """The poses picked by an index array over K."""
        landmarks = {name: each.map(lambda _, a: a[index]) for name, each in self.landmarks.items()}
        return Poses(landmarks, self.boxes_px[index])


def join_poses(parts: Sequence[Poses]) -> Poses:
    """The poses of several parts, one after another."""
    joined = by_name(_join([part.landmarks[name] for part in parts]) for name in parts[0].landmarks)
    return Poses(joined, np.concatenate([part.boxes_px for part in parts]))


def _join(parts: Sequence[LandmarkArrays]) -> LandmarkArrays:
    return parts[0].map(lambda field, _: np.concatenate([part.arrays()[field] for part in parts]))


class Pictures(NamedTuple):
    """Frames of one camera.

    Attributes:
        frames: (n, H, W, 3) RGB.
        small: the same as scaled down by its `BackgroundModel`; None for networks that do not take the background.
        half: the same averaged over two by two pixels; None where that is not at hand.
        scale: of the video's frames, over how many by how many pixels these are averaged.
    """

    frames: ByteArray
    small: SmallFrames | None
    half: ByteArray | None = None
    scale: int = 1


class PoseReader:
    """Reads the landmarks in boxes of one camera's frames.

    Attributes:
        upright: rotation of the camera's frames; boxes are in upright px.
    """

    def __init__(
        self, network: KeypointNetwork | ExternalModel, camera: Camera | None, upright: FrameOrientation,
        backdrop: BackgroundModel, fps: float,
    ) -> None:  # fmt: skip
        self._network = network
        self._camera = camera
        self._backdrop = backdrop
        self.upright = upright
        self._smoothing = smoothing_frames(_OWN_BOX_SMOOTHING, fps)
        self._try_every = max(1, round(_TRY_EVERY * fps))

    def __call__(self, pictures: Pictures, frame: IndexArray, track: IntArray, boxes_px: FloatArray) -> Poses:
        """Landmarks in boxes.

        Args:
            pictures: n frames.
            frame: (K,) the frame of each box.
            track: (K,) the track of each box; frames ascend within a track.
            boxes_px: (K, 4) upright px.
        """
        boxes_px = _cropped_boxes(boxes_px)
        crops = self._crops(boxes_px)
        found = self._network.locate(self._pixels(pictures, frame, crops), series=Series(track, self._try_every))
        return self._poses(found, crops, boxes_px)

    def thinly(
        self, pictures: Pictures, frame: IndexArray, track: IntArray, boxes_px: FloatArray, every: int,
        min_confidence: float,
    ) -> Poses:  # fmt: skip
        """The same, read in every n-th frame of a track and its last, and between those only where people move fast.

        A track whose confidence is below `min_confidence` is nobody, or is read again: its landmarks jump, which does
        not count.
        """
        if every == 1 or len(frame) < 2:
            return self(pictures, frame, track, boxes_px)
        rows = [np.flatnonzero(track == number) for number in np.unique(track)]
        chosen = np.zeros(len(frame), dtype=np.bool_)
        for each in rows:
            chosen[each[::every]] = chosen[each[-1]] = True
        found = self(pictures, frame[chosen], track[chosen], boxes_px[chosen])
        poses = scatter_poses(found, chosen, _cropped_boxes(boxes_px))
        read = chosen.copy()
        for each in rows:
            at = np.flatnonzero(chosen[each])
            if poses.confidence[each[at]].mean() < min_confidence:
                continue
            moved = poses.body.points_px[each[at]]
            side = (boxes_px[each[at], 2:] - boxes_px[each[at], :2]).max(axis=1)
            for low, high in fast_gaps(at, moved, side):
                read[each[low:high]] = True
        more = read & ~chosen
        if more.any():
            further = self(pictures, frame[more], track[more], boxes_px[more]).arrays()
            for name, values in poses.arrays().items():
                values[more] = further[name]
        for each in rows:
            interpolate_poses(poses, each, read[each])
        return poses

    def expecting(
        self, pictures: Pictures, frame: IndexArray, boxes_px: FloatArray, expected: Expectation
    ) -> tuple[Poses, Poses]:
        """Landmarks in boxes of one person, with and without a prior on where they are.

        Args:
            pictures, frame, boxes_px: as above; frames ascend.
            expected: the prior for every box, in px of the frame.
        """
        boxes_px = _cropped_boxes(boxes_px)
        crops = self._crops(boxes_px)
        in_crop = expected._replace(points_px=crops.to_crop(expected.points_px))
        one = Series(np.zeros(len(frame), dtype=np.int64), self._try_every)
        located = self._network.locate(self._pixels(pictures, frame, crops), in_crop, one)
        poses = self._poses(located, crops, boxes_px)
        if located.alone is None:
            return poses, poses
        points, variance, score = _in_frame(located.alone, crops)
        alone = replace(poses.body, points_px=points, variance_px2=variance, score=score)
        return poses, replace(poses, landmarks={**poses.landmarks, alone.set.name: alone})

    def _poses(self, located: Located, crops: Crops, boxes_px: FloatArray) -> Poses:
        """What was located in crops of these boxes (K, 4), upright px."""
        body, *further = self._network.sets
        found = [LandmarkArrays(body, *_in_frame(located.found, crops), sigmoid(located.visibility))]
        found += [LandmarkArrays(each, *_in_frame(located.further[each.name], crops)) for each in further]
        return Poses(by_name(found), boxes_px)

    def _crops(self, boxes_px: FloatArray) -> Crops:
        network = self._network
        in_frame = network.fitted_boxes(self.upright.centered_in_frame(boxes_px))
        return crops_for_boxes(in_frame, network.crop_size, self._camera, network.box_padding)

    def coarseness(self, boxes_px: FloatArray) -> FloatArray:
        """(K,) pixels of the frame per pixel of a crop of these boxes (K, 4), upright px."""
        return self._crops(_cropped_boxes(boxes_px)).image_px_per_crop_px

    def _pixels(self, pictures: Pictures, frame: IndexArray, crops: Crops) -> ByteArray:
        return crop_pixels(pictures, self._backdrop, frame, crops, self._network.channels)

    def own_boxes(self, poses: Poses) -> FloatArray:
        """(K, 4) boxes around the landmarks, upright px; NaN where there are none."""
        return body_boxes(self.upright.to_upright(poses.body.points_px), self._network.landmarks)

    def refined(
        self,
        pictures: Pictures,
        frame: IndexArray,
        track: IntArray,
        poses: Poses,
        min_confidence: float,
        change: float,
    ) -> Poses:
        """The poses, read again where a track's boxes differ much from those of its landmarks.

        Args:
            pictures: n frames.
            frame: (K,) the frame of each pose.
            track: (K,) the track of each pose; frames ascend within a track.
            poses: of the first reading.
            min_confidence: mean score from which a pose's own box is trusted.
            change: difference in centre or size, relative to the box, from which a box is poor.
        """
        wanted = poses.boxes_px.copy()
        own, confident = self.own_boxes(poses), poses.confidence >= min_confidence
        again = np.zeros(len(frame), dtype=np.bool_)
        for number in np.unique(track):
            rows = np.flatnonzero(track == number)
            trusted = confident[rows] & np.isfinite(own[rows]).all(axis=1)
            if not trusted.any():
                continue
            series = filled_boxes(own[rows], trusted)
            # Before the first and after the last trusted pose the crop stays as it was.
            inner = rows[np.isfinite(series).all(axis=1) & _between(trusted)]
            wanted[inner] = smoothed_boxes(series[_between(trusted)], self._smoothing)
            poor = _differs(wanted[rows], poses.boxes_px[rows], change)
            again[rows] = scipy.ndimage.maximum_filter1d(poor.astype(np.uint8), 2 * _REDO_AROUND + 1).astype(np.bool_)
        again &= (wanted != poses.boxes_px).any(axis=1)
        redo = np.flatnonzero(again)
        if not len(redo):
            return poses
        second = self(pictures, frame[redo], track[redo], wanted[redo])
        # Over all landmarks: a crop that cuts some off is not better for its confidence in the rest.
        gain = (second.body.score - poses.body.score[redo]).mean(axis=1)
        for number in np.unique(track[redo]):
            here = track[redo] == number
            # All frames of a track or none: alternating readings would jitter.
            if gain[here].mean() <= 0:
                continue
            for values, new in zip(poses.arrays().values(), second.arrays().values(), strict=True):
                values[redo[here]] = new[here]
        return poses

    def duplicates(self, frame: IndexArray, track: IntArray, poses: Poses) -> IntArray:
        """Tracks whose landmarks lie on the person of another track in most frames that both are in."""
        own, body = self.own_boxes(poses), poses.body
        side = (own[:, 2:] - own[:, :2]).max(axis=1)
        tracks = np.unique(track)
        # Over all landmarks: a box on a part of a person finds few, with high confidence.
        confidence = {int(t): float(body.score[track == t].mean()) for t in tracks}
        gone: set[int] = set()
        for older, younger in [(int(a), int(b)) for i, a in enumerate(tracks) for b in tracks[i + 1 :]]:
            if gone & {older, younger}:
                continue
            a, b = np.flatnonzero(track == older), np.flatnonzero(track == younger)
            _, in_a, in_b = np.intersect1d(frame[a], frame[b], return_indices=True)
            if not len(in_a):
                continue
            a, b = a[in_a], b[in_b]
            away = np.linalg.norm(body.points_px[a] - body.points_px[b], axis=-1)
            both = np.minimum(body.score[a], body.score[b]) >= _CONFIDENT
            away = np.where(both | (both.sum(axis=1, keepdims=True) < _ENOUGH_CONFIDENT), away, np.nan)
            apart = row_median(away, 1) / np.maximum(side[a], side[b])
            if np.isfinite(apart).any() and np.nanmedian(apart) < _SAME_PERSON:
                gone.add(older if confidence[younger] > confidence[older] + _MUCH_MORE_CONFIDENT else younger)
        return np.array(sorted(gone), dtype=np.int64)


def crop_pixels(
    pictures: Pictures, backdrop: BackgroundModel, frame: IndexArray, crops: Crops, channels: int
) -> ByteArray:
    """(K, S, S, channels) pixels of crops of their frames (K,): RGB and, as a fourth channel, the difference to the
    background."""
    pixels = np.zeros((len(crops), crops.size_px, crops.size_px, channels), dtype=np.uint8)
    own = scaled_down(crops, pictures.scale)
    for index in np.unique(frame):
        here = np.flatnonzero(frame == index)
        half = None if pictures.half is None else pictures.half[index]
        pixels[here, ..., :3] = extract_crops(pictures.frames[index], own.select(here), half)
        if channels > 3 and pictures.small is not None:
            pixels[here, ..., 3] = backdrop.difference_in(crops.select(here), pictures.small, int(index))
    brighten_crops(pixels)
    return pixels


def _in_frame(found: DecodedHeatmaps, crops: Crops) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Points (K, J, 2), variances (K, J) and scores (K, J) in px of the frame."""
    points_crop, variance_crop, score = found
    points = crops.to_image(points_crop)
    score[~np.isfinite(points).all(axis=-1)] = 0.0
    return points, crops.variance_to_image(points_crop, variance_crop), score


def _between(known: BoolArray) -> BoolArray:
    """(n,) from the first to the last True."""
    inside: BoolArray = np.logical_or.accumulate(known)
    return inside & np.logical_or.accumulate(known[::-1])[::-1]


def _differs(a: FloatArray, b: FloatArray, change: float) -> BoolArray:
    """(K,) whether boxes differ in centre or size by more than `change` of b's longer side."""
    side_a, side_b = (np.maximum((box[:, 2:] - box[:, :2]).max(axis=1), _MIN_BOX_PX) for box in (a, b))
    moved = np.linalg.norm((a[:, :2] + a[:, 2:] - b[:, :2] - b[:, 2:]) / 2, axis=1) / side_b
    return np.asarray((moved > change) | (np.abs(np.log(side_a / side_b)) > np.log1p(change)), dtype=np.bool_)


def body_boxes(points_px: FloatArray, landmarks: LandmarkSet) -> FloatArray:
    """Boxes of whole bodies from their landmarks.

    Args:
        points_px: (K, J, 2), NaN where missing.
        landmarks: the meaning of the J axis; heads and hands have wider margins than the rest.

    Returns:
        (K, 4) left, top, right, bottom; NaN where no landmark is known.
    """
    points = np.where(np.isfinite(points_px).all(axis=-1, keepdims=True), points_px, np.nan)
    side = (_nan_extreme(points, np.fmax) - _nan_extreme(points, np.fmin)).max(axis=1)
    reach = np.array([_REACH.get(name.rsplit("_", 1)[-1], _REACH_ELSEWHERE) for name in landmarks.names])
    margin = (reach * side[:, None])[..., None]
    low, high = _nan_extreme(points - margin, np.fmin), _nan_extreme(points + margin, np.fmax)
    return np.concatenate([low, high], axis=1)


def _nan_extreme(points: FloatArray, extreme: np.ufunc) -> FloatArray:
    """(K, J, 2) to (K, 2) by np.fmin or np.fmax, which ignore NaN without a warning."""
    return np.asarray(extreme.reduce(points, axis=1), dtype=np.float64)


def _cropped_boxes(boxes: FloatArray) -> FloatArray:
    """The boxes (K, 4) as they are cropped: widened about their centres to a least side, their edges rounded to a grid.

    Boxes come from a network or from 3D points, whose last digits depend on the processor. A crop moved by a millionth
    of a pixel has other values in a few pixels, and all activations of a network of 8 bits change by a rounding: its
    landmarks by tenths of a pixel, some hypotheses altogether. Equal boxes give equal crops to the bit.
    """
    center = (boxes[:, :2] + boxes[:, 2:]) / 2
    half = np.maximum(boxes[:, 2:] - boxes[:, :2], _MIN_BOX_PX) / 2
    cell = 2.0 ** np.floor(np.log2(2 * half.max(axis=1, keepdims=True))) / _GRID
    half = np.maximum(half, cell)
    return np.concatenate([np.round((center - half) / cell) * cell, np.round((center + half) / cell) * cell], axis=1)
