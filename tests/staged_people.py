"""The command line with a staged estimator in place of the networks: it sees a person who is not filmed.

Everything but the networks is real. Run as a script it takes the arguments of `muybridge`; tests that need it
in their own process load it by path (see the fixture `staged` in conftest.py).
"""

import os
import sys
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from muybridge.arrays import ByteArray, FloatArray, IndexArray
from muybridge.geometry.cameras.camera import Camera
from muybridge.geometry.landmarks.marker_sets import SURFACE
from muybridge.geometry.landmarks.sets import BODY23, LandmarkSet
from muybridge.infer.commands.app import run_command
from muybridge.infer.detection import detect
from muybridge.infer.detection import refine as refinement
from muybridge.infer.detection.background import BackgroundModel
from muybridge.infer.detection.crop_reader import Pictures, Poses
from muybridge.infer.detection.orientation import FrameOrientation
from muybridge.infer.detection.tracks import CameraTracks, LandmarkArrays, by_name
from muybridge.infer.networks.keypoints import Expectation
from muybridge.infer.networks.models import Models
from muybridge.infer.pipelines import videos as pipeline

# A standing person who faces -Y, metres: the subject's left is +X.
_MIDDLE = {"nose": (0.0, -0.12, 1.62)}
_LEFT = {
    "eye": (0.03, -0.10, 1.66), "ear": (0.07, 0.0, 1.64), "shoulder": (0.18, 0.0, 1.42),
    "elbow": (0.24, 0.03, 1.13), "wrist": (0.26, -0.05, 0.88), "hip": (0.09, 0.0, 0.93),
    "knee": (0.10, -0.02, 0.51), "ankle": (0.10, 0.02, 0.09), "big_toe": (0.11, -0.16, 0.03),
    "small_toe": (0.16, -0.12, 0.03), "heel": (0.10, 0.06, 0.04),
}  # fmt: skip


def person(frames: int, fps: float = 30.0) -> FloatArray:
    """(T, 23, 3) metres: the person sways, turns a little and lifts the left arm."""
    rest = np.array(
        [
            _MIDDLE[n] if n in _MIDDLE
            else np.array(_LEFT[n.split("_", 1)[1]]) * ([1, 1, 1] if n.startswith("left") else [-1, 1, 1])
            for n in BODY23.names
        ]
    )  # fmt: skip
    time_s = np.arange(frames) / fps
    turn = 0.4 * np.sin(2 * np.pi * 0.5 * time_s)
    points = np.repeat(rest[None], frames, axis=0)
    arm = [BODY23.index("left_elbow"), BODY23.index("left_wrist")]
    shoulder = rest[BODY23.index("left_shoulder")]
    for t, lift in enumerate(0.6 * (1 - np.cos(2 * np.pi * 0.7 * time_s))):
        cos, sin = np.cos(lift), np.sin(lift)
        about_y = np.array([[cos, 0, -sin], [0, 1, 0], [sin, 0, cos]])
        points[t, arm] = (points[t, arm] - shoulder) @ about_y.T + shoulder
        cos, sin = np.cos(turn[t]), np.sin(turn[t])
        points[t] = points[t] @ np.array([[cos, -sin, 0], [sin, cos, 0], [0, 0, 1]]).T
    points[..., 0] += 0.2 * np.sin(2 * np.pi * 0.4 * time_s)[:, None]
    return points


def skin(frames: int) -> FloatArray:
    """(T, 72, 3) metres: markers around the person's middle, each at a place of its own, left ones on the left."""
    turns = np.arange(len(SURFACE)) / len(SURFACE) * 20
    around = 0.2 * np.stack([np.cos(turns), np.sin(turns), np.linspace(-4, 4, len(SURFACE))], -1)
    side = np.array([1 if n.startswith("left_") else -1 if n.startswith("right_") else 0 for n in SURFACE.names])
    around[:, 0] = 0.15 * side + 0.05 * around[:, 0]
    return person(frames).mean(axis=1, keepdims=True) + around


class StagedEstimator:
    """Stands in for `PoseEstimator`: the person, projected into the camera, half a pixel of noise on it."""

    def __init__(
        self, keypoints: Path, people: Path, camera: Camera, options: Any, model_card: str | None, markers: bool,
        fps: float,
    ) -> None:  # fmt: skip
        assert model_card is None
        self._camera = camera
        self._frames = 0
        self._markers = markers

    def process(self, frames: ByteArray, half: ByteArray | None = None, thin: bool = True) -> None:
        assert frames.shape[1:] == (self._camera.height, self._camera.width, 3)
        self._frames += len(frames)
        time.sleep(float(os.environ.get("STAGED_SECONDS_PER_FRAME", "0")) * len(frames))

    def finish(self) -> CameraTracks:
        t, j = self._frames, len(BODY23)
        noise = np.random.default_rng(len(self._camera.name)).normal(0, 0.3, (t, 1, j, 2))
        points = self._camera.project(person(t))[:, None] + noise
        if os.environ.get("STAGED_NOBODY"):
            points[:] = np.nan
        seen = np.isfinite(points).all(axis=-1)
        boxes = np.concatenate([points.min(axis=2), points.max(axis=2)], axis=-1)
        score = np.where(seen, 0.9, 0.0)
        found = [LandmarkArrays(BODY23, points, np.where(seen, 0.25, np.nan), score, score)]
        found += [self._skin(t)] if self._markers else []
        return CameraTracks(by_name(found), boxes, np.zeros((t, 1), np.int64))

    def background(self, tracks: CameraTracks) -> None:
        """There is none."""

    def _skin(self, frames: int) -> LandmarkArrays:
        points = self._camera.project(skin(frames))[:, None]
        known = np.full(points.shape[:-1], 1.0)
        return LandmarkArrays(SURFACE, points, 0.25 * known, 0.9 * known)


class StagedReader:
    """Stands in for the second look's `PoseReader`: the person at the time that fits what is expected."""

    def __init__(
        self, markers: bool, camera: Camera, upright: FrameOrientation, backdrop: BackgroundModel, fps: float
    ) -> None:
        self.upright, self._camera, self._markers = upright, camera, markers

    def coarseness(self, boxes_px: FloatArray) -> FloatArray:
        return np.ones(len(boxes_px))

    def expecting(
        self, pictures: Pictures, frame: IndexArray, boxes_px: FloatArray, expected: Expectation
    ) -> tuple[Poses, Poses]:
        views = self._camera.project(person(120))
        away = np.linalg.norm(views[None] - expected.points_px[:, None], axis=-1)
        at = np.nanmedian(away, axis=-1).argmin(1)
        noise = np.random.default_rng(len(at)).normal(0, 0.3, (len(at), len(BODY23), 2))
        known = np.ones((len(at), len(BODY23)))
        found = [LandmarkArrays(BODY23, views[at] + noise, 0.25 * known, 0.9 * known, 0.9 * known)]
        if self._markers:
            skin_px = self._camera.project(skin(120))[at]
            marked = np.ones(skin_px.shape[:2])
            found.append(LandmarkArrays(SURFACE, skin_px, 0.25 * marked, 0.9 * marked))
        poses = Poses(by_name(found), boxes_px)
        return poses, poses


@dataclass
class _StagedNetwork:
    finds_markers: bool
    landmarks: LandmarkSet = BODY23
    channels: int = 3


def _staged_keypoints(path: Path, card: str | None, options: Any, markers: bool) -> _StagedNetwork:
    return _StagedNetwork(markers)


def staged_models(options: detect.DetectOptions) -> Models:
    """Stands in for `open_models`."""
    return Models(Path("keypoints"), Path("people"), BODY23, {
        "keypoints": {"version": "staged"}, "people": {"input_long_side": "320"},
    })  # fmt: skip


def stage(replace: Callable[[Any, str, Any], None] = setattr) -> None:
    """Put the staged estimator and its models in place, by `replace(where, name, what)`."""
    replace(detect, "PoseEstimator", StagedEstimator)
    replace(refinement, "open_keypoints", _staged_keypoints)
    replace(refinement, "PoseReader", lambda network, *rest: StagedReader(network.finds_markers, *rest))
    replace(pipeline, "open_models", staged_models)


if __name__ == "__main__":
    stage()
    sys.exit(run_command(sys.argv[1:]))
