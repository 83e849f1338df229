"""Pseudo-labels: crops of the tracked people in every view, labelled with their landmarks from all cameras together.

A 2D network errs in each view on its own; several calibrated views, the body and the take's other frames correct it.
The corrected landmarks, projected into each camera, are labels that need no annotation: `muybridge adapt` trains on
them.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from muybridge.arrays import BoolArray, FloatArray, IndexArray
from muybridge.errors import SessionError
from muybridge.geometry.cameras.camera import Camera
from muybridge.geometry.cameras.crops import crops_for_boxes
from muybridge.geometry.sync.clocks import own_frames
from muybridge.infer.detection.crop_reader import Pictures, body_boxes, crop_pixels
from muybridge.infer.detection.exposure import stretch_frames
from muybridge.infer.detection.orientation import orientation_for
from muybridge.infer.detection.resample import on_time
from muybridge.infer.pipelines.videos import Followed
from muybridge.infer.reconstruction.landmarks import Solution
from muybridge.infer.runtime.progress import Progress
from muybridge.infer.session.video import read_chunks
from muybridge.models.keypoints.metadata import KeypointModelCard
from muybridge.models.pseudo_labels import PseudoLabels

# The frames used are divided into so many blocks; every n-th block is held out from training.
_BLOCKS, _HELD_OUT = 50, 10
_STEP_M = 0.01  # step of the numerical derivative of the projection


@dataclass(frozen=True)
class PseudoLabelOptions:
    """Which parts of a take become crops.

    Attributes:
        most_crops: largest number, evenly spread over the take; each takes 0.4 MB of memory.
        larger: side of the crops relative to the network's, as a margin for augmentation.
        most_unsure: largest standard deviation of a labelled landmark, as a share of the crop.
        least_known: share of the body's landmarks that must be labelled in a crop.
        fewest_crops: with fewer crops, a network would memorise them.
    """

    most_crops: int = 2000
    larger: float = 4 / 3
    most_unsure: float = 0.015
    least_known: float = 0.5
    fewest_crops: int = 60


class _Shape(NamedTuple):
    """Side of the crops, px, and over the longer side of the person's box."""

    size_px: int
    padding: float


def collect(
    followed: Followed, card: KeypointModelCard, progress: Progress, options: PseudoLabelOptions = PseudoLabelOptions()
) -> PseudoLabels:
    """The crops of a session whose people were tracked, with their virtual markers.

    Args:
        followed: the session and its people.
        card: of the network to be trained.
        progress: receives progress messages.
        options: which crops.

    Raises:
        SessionError: too few frames in which enough of the person is known in 3D.
    """
    shape = _Shape(round(options.larger * card.input_size), options.larger * card.box_padding)
    people = [_Person(s, options) for s in (followed.solution, *followed.solution.others)]
    cameras = range(len(followed.session.cameras))
    views = [_views(followed, c, person, shape, options) for c in cameras for person in people]
    total = sum(len(v.frames) for v in views)
    if total < options.fewest_crops:
        raise SessionError(
            f"{followed.session.path}: there is too little to adapt to: enough of the person is known in 3D in {total} "
            f"frames of all cameras, {options.fewest_crops} are needed; check the results of `muybridge run` first"
        )
    # Whole frames are chosen rather than single views, so that a held-out frame is held out in all cameras.
    known = np.unique(np.concatenate([v.frames for v in views]))
    most = max(1, options.most_crops * len(known) // total)
    kept = known[np.unique(np.linspace(0, len(known) - 1, most).astype(int))]
    apart = kept[_held_out(len(kept))]
    parts: list[tuple[NDArray[Any], ...]] = []
    with progress.task("crops", len(views)) as task:
        for view in views:
            parts += _cut(followed, view.select(np.isin(view.frames, kept)), apart, shape)
            task.advance()
    crops, landmarks, agreed, held_out = (np.concatenate(arrays) for arrays in zip(*parts, strict=True))
    facts = {
        "session": followed.session.name, "cameras": list(followed.session.cameras.names),
        "frames": len(kept), "people": len(people),
    }  # fmt: skip
    return PseudoLabels(crops, landmarks, agreed, held_out, shape.padding, facts)


class _Person:
    """One person's labels: body and markers, smoothed."""

    def __init__(self, solution: Solution, options: PseudoLabelOptions) -> None:
        self.body = solution.points
        both = [(solution.points, solution.measured)]
        if solution.markers is not None:
            both.append((solution.markers, solution.markers))
        self.points, self.covariance = (
            np.concatenate([getattr(p, k) for p, _ in both], axis=1) for k in ("points_world", "covariance_world")
        )
        self.agreed = np.concatenate([m.inlier for _, m in both], axis=2)


class _View(NamedTuple):
    """A person in some frames of one camera: boxes (n, 4) of the frame, labels (n, J, 2) px of the frame, their
    standard deviations (n, J) in shares of a crop, and whether the camera agrees (n, J)."""

    camera: int
    frames: IndexArray
    boxes_px: FloatArray
    landmarks_px: FloatArray
    agreed: BoolArray

    def select(self, chosen: BoolArray) -> _View:
        """Some of the frames."""
        return _View(
            self.camera, self.frames[chosen], self.boxes_px[chosen], self.landmarks_px[chosen], self.agreed[chosen]
        )  # fmt: skip


def _views(followed: Followed, c: int, person: _Person, shape: _Shape, options: PseudoLabelOptions) -> _View:
    """Frames in which enough of the person should be visible, with labels where the uncertainty is small enough."""
    camera = followed.session.cameras[c]
    px = camera.project_seen(person.points)
    body = len(person.body.landmarks)
    upright = orientation_for(followed.session.level_cameras[c], camera.width, camera.height)
    boxes = upright.centered_in_frame(body_boxes(upright.to_upright(px[:, :body]), person.body.landmarks))
    side = (boxes[:, 2:] - boxes[:, :2]).max(axis=1)
    uncertainty = _sigma_px(camera, person.points, person.covariance) / np.maximum(shape.padding * side, 1)[:, None]
    inside = ((px >= -0.5) & (px <= [camera.width - 0.5, camera.height - 0.5])).all(axis=-1)
    labelled = np.isfinite(px).all(axis=-1) & (uncertainty <= options.most_unsure) & inside
    px = np.where(labelled[..., None], px, np.nan)
    frames = np.flatnonzero(labelled[:, :body].mean(axis=1) >= options.least_known)
    shown = on_time(followed.session, c, followed.detected[c].repeats)
    frames = frames[shown[own_frames(followed.session.clocks, c, frames, followed.session.fps, len(shown))]]
    return _View(c, frames, boxes[frames], px[frames], person.agreed[c, frames])


def _sigma_px(camera: Camera, points: FloatArray, covariance: FloatArray) -> FloatArray:
    """(T, J) standard deviation in the image of points (T, J, 3) with covariances (T, J, 3, 3), px."""
    at = camera.project(points)
    jacobian = np.stack([camera.project(points + _STEP_M * axis) - at for axis in np.eye(3)], axis=-1) / _STEP_M
    variance = np.einsum("tjab,tjbc,tjac->tj", jacobian, covariance, jacobian) / 2
    return np.asarray(np.sqrt(np.maximum(variance, 0)))


def _held_out(count: int) -> BoolArray:
    """(count,) which frames are held out from training; some of every take."""
    block = np.arange(count) // max(1, count // _BLOCKS)
    return np.asarray(block % _HELD_OUT == min(_HELD_OUT // 2, block[-1]))


def _cut(followed: Followed, view: _View, apart: IndexArray, shape: _Shape) -> Iterator[tuple[NDArray[Any], ...]]:
    """The first arrays of `PseudoLabels` of a view, chunk by chunk; the frames `apart` are held out."""
    session, c = followed.session, view.camera
    camera, count = session.level_cameras[c], followed.detected[c].tracks.frames
    own = own_frames(session.clocks, c, view.frames, session.fps, count)
    crops = crops_for_boxes(view.boxes_px, shape.size_px, camera, shape.padding)
    frames, order = np.unique(own, return_inverse=True)
    backdrop = followed.detected[c].background_model()
    begin = 0
    chunks = read_chunks(session.videos[c], session.frame_indices[c][frames]) if len(frames) else ()
    for chunk in stretch_frames(chunks):
        here = np.flatnonzero((order >= begin) & (order < begin + len(chunk)))
        pictures = Pictures(chunk, backdrop(chunk))
        pixels = crop_pixels(pictures, backdrop, order[here] - begin, crops.select(here), 4)
        at = crops.select(here).to_crop(view.landmarks_px[here]).astype(np.float32)
        yield pixels, at, view.agreed[here], np.isin(view.frames[here], apart)
        begin += len(chunk)
