"""People in 3D frame by frame: images of all cameras in, 3D points of the people who are tracked out."""

from __future__ import annotations

from collections import Counter, deque
from collections.abc import Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from types import TracebackType
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from muybridge.api.networks import checked_image
from muybridge.arrays import ByteArray, FloatArray, IntArray
from muybridge.geometry.association.select import take_slots
from muybridge.geometry.association.tracker import track_people
from muybridge.geometry.calibration.gravity import level_cameras
from muybridge.geometry.cameras.group import CameraGroup
from muybridge.geometry.landmarks.arrays import Keypoints2D
from muybridge.geometry.landmarks.sets import LandmarkSet
from muybridge.geometry.triangulation.left_right import repair_flips
from muybridge.geometry.triangulation.multiview import triangulate
from muybridge.infer.detection.detect import DetectOptions, first_pass
from muybridge.infer.detection.pose_estimator import PoseEstimator
from muybridge.infer.detection.tracks import CameraTracks
from muybridge.infer.networks.models import open_models
from muybridge.infer.reconstruction.landmarks import SolveOptions


@dataclass(frozen=True, eq=False)
class LivePerson:
    """Somebody in one frame.

    Attributes:
        id: stays with the person from frame to frame; never given to anybody else.
        points_world: (J, 3) metres; NaN where too few cameras agree or none is confident.
        covariance_world: (J, 3, 3) square metres; NaN where the point is.
        confidence: (J,) of the most confident camera, 0..1.
        cameras: names of the cameras that see the person.
    """

    id: int
    points_world: FloatArray
    covariance_world: FloatArray
    confidence: FloatArray
    cameras: tuple[str, ...]


class _Detections(NamedTuple):
    """One camera's people in one frame, one row a track."""

    ids: IntArray  # (P,)
    points_px: FloatArray  # (P, J, 2)
    variance_px2: FloatArray  # (P, J)
    score: FloatArray  # (P, J)


class LiveCapture:
    """Tracks people in 3D from one image per camera at a time.

    Each camera has its own person detector, tracker and keypoint network; detections of different cameras are
    associated in 3D over the last `window` seconds, and each person is triangulated from the cameras that see them.
    Points are neither smoothed nor fitted with a body, and nothing is refined later: `capture` on recorded videos is
    more accurate. Someone who is lost for longer than the window comes back with a new `id`.

    Cameras have to be synchronised: the images of one call show the same moment. The first call compiles numerical
    kernels, which takes some seconds once after an installation.

    Attributes:
        landmarks: what is found, the meaning of the J axis.
    """

    def __init__(
        self,
        cameras: CameraGroup,
        *,
        fps: float,
        window: float = 0.5,
        detect: DetectOptions | None = None,
        solve: SolveOptions | None = None,
    ) -> None:
        """Open the networks, once for each camera.

        Args:
            cameras: C calibrated cameras that do not move, at the images' sizes.
            fps: sets of images a second.
            window: seconds over which people are associated between cameras.
            detect: how 2D landmarks are found; by default the faster settings with which `capture` begins.
            solve: of these `tracking`, `flips`, `triangulate` and `min_confidence` are used.

        Raises:
            ValueError: fewer than two cameras, or a frame rate or window that is not above zero.
            ModelError: a network named in `detect` is missing or unusable.

        Example:
            >>> import muybridge, numpy
            >>> cameras = muybridge.load_calibration("session/calibration.toml")
            >>> with muybridge.LiveCapture(cameras, fps=30) as live:
            ...     people = live.process([numpy.zeros((480, 640, 3), numpy.uint8) for _ in cameras])
            >>> people
            ()
        """
        if len(cameras) < 2:
            raise ValueError(f"3D needs two cameras or more, and there is {len(cameras)}")
        if not (fps > 0 and window > 0):
            raise ValueError(f"fps and window must be above zero, not {fps} and {window}")
        self._cameras, self._fps = cameras, float(fps)
        self._detect = detect or first_pass(DetectOptions())
        models = open_models(self._detect)
        self._solve = (solve or SolveOptions()).with_card(models.min_confidence)
        self._estimators = [
            PoseEstimator(models.keypoints, models.people, camera, self._detect.keypoints, models.model_card, fps=fps)
            for camera in level_cameras(cameras)
        ]
        self.landmarks: LandmarkSet = models.landmarks
        self._window: deque[list[_Detections]] = deque(maxlen=max(2, round(window * fps)))
        # Who every detection of the window is: (camera, frame, track of the camera) to a person's id.
        self._who: dict[tuple[int, int, int], int] = {}
        self._frame, self._people = -1, 0
        self._pool = ThreadPoolExecutor(max_workers=self._detect.workers)

    def __enter__(self) -> LiveCapture:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def close(self) -> None:
        """End the worker threads."""
        self._pool.shutdown()

    def process(
        self, images: Sequence[NDArray[np.uint8] | None] | Mapping[str, NDArray[np.uint8] | None]
    ) -> tuple[LivePerson, ...]:
        """Work on the next moment.

        Args:
            images: (H, W, 3) RGB of every camera, in the cameras' order or by name; None for a camera that missed this
                frame.

        Returns:
            Everyone whom two cameras or more see in this frame, by `id`; metres, in the cameras' world.

        Raises:
            ValueError: images that are not one a camera, not (H, W, 3) uint8, or not of the camera's size.

        Example:
            >>> import muybridge, numpy
            >>> cameras = muybridge.load_calibration("session/calibration.toml")
            >>> black = numpy.zeros((480, 640, 3), numpy.uint8)
            >>> with muybridge.LiveCapture(cameras, fps=30) as live:
            ...     for moment in range(2):
            ...         people = live.process({name: black for name in cameras.names})
        """
        frames = self._checked(images)
        self._frame += 1
        self._window.append(list(self._pool.map(self._read, range(len(frames)), frames)))
        keypoints, tracks = self._keypoints()
        followed = track_people(self._cameras, keypoints, self._solve.tracking, self._fps)
        people = [
            person
            for slots, number in zip(followed, self._identify(followed, tracks), strict=True)
            if (slots[:, -1] >= 0).sum() >= 2 and (person := self._person(keypoints, slots, number)) is not None
        ]
        return tuple(sorted(people, key=lambda person: person.id))

    def _checked(
        self, images: Sequence[NDArray[np.uint8] | None] | Mapping[str, NDArray[np.uint8] | None]
    ) -> list[ByteArray | None]:
        names = self._cameras.names
        if isinstance(images, Mapping):
            unknown = sorted(set(images) - set(names))
            if unknown:
                raise ValueError(f"no camera {', '.join(unknown)}: the cameras are {', '.join(names)}")
            images = [images.get(name) for name in names]
        if len(images) != len(names):
            raise ValueError(f"{len(images)} images for {len(names)} cameras ({', '.join(names)}): pass one a camera")
        return [
            None if image is None else checked_image(image, camera, f"image of {camera.name}")
            for image, camera in zip(images, self._cameras, strict=True)
        ]

    def _read(self, camera: int, frame: ByteArray | None) -> _Detections:
        """The 2D landmarks of one camera's next frame."""
        if frame is None:
            return _nobody(len(self.landmarks))
        estimator = self._estimators[camera]
        estimator.process(frame[None])
        return _last(estimator.take())

    def _keypoints(self) -> tuple[Keypoints2D, list[IntArray]]:
        """The window's detections, one slot a track, and each camera's tracks (P,) in the order of its slots."""
        tracks = [np.unique(np.concatenate([moment[c].ids for moment in self._window])) for c in range(self._count)]
        size = self._count, len(self._window), max(1, *map(len, tracks)), len(self.landmarks)
        points, variance, score = np.full((*size, 2), np.nan), np.full(size, np.nan), np.zeros(size)
        for t, moment in enumerate(self._window):
            for c, found in enumerate(moment):
                slots = np.searchsorted(tracks[c], found.ids)
                points[c, t, slots], variance[c, t, slots] = found.points_px, found.variance_px2
                score[c, t, slots] = found.score
        return Keypoints2D(self.landmarks, points, variance, score), tracks

    @property
    def _count(self) -> int:
        return len(self._cameras)

    def _identify(self, followed: Sequence[IntArray], tracks: Sequence[IntArray]) -> list[int]:
        """The ids of the people (slots (C, T) of the window) by the detections that they share with the last call's."""
        first = self._frame - len(self._window) + 1
        keys = [
            [
                (int(c), first + int(t), int(tracks[c][slots[c, t]]))
                for c, t in zip(*np.nonzero(slots >= 0), strict=True)
            ]
            for slots in followed
        ]
        votes = [Counter(self._who[key] for key in mine if key in self._who) for mine in keys]
        ranked = sorted(((n, i, number) for i, v in enumerate(votes) for number, n in v.items()), reverse=True)
        numbers: dict[int, int] = {}
        for _, i, number in ranked:
            if i not in numbers and number not in numbers.values():
                numbers[i] = number
        for i in range(len(followed)):
            if i not in numbers:
                numbers[i] = self._people
                self._people += 1
        kept = {key: number for key, number in self._who.items() if key[1] >= first}
        self._who = kept | {key: numbers[i] for i, mine in enumerate(keys) for key in mine}
        return [numbers[i] for i in range(len(followed))]

    def _person(self, keypoints: Keypoints2D, slots: IntArray, number: int) -> LivePerson | None:
        """A person in the newest frame; the frames before tell left from right and how noisy the points are."""
        points_px, variance_px2, score = take_slots(keypoints, slots)
        points_px, variance_px2, flipped = repair_flips(
            self._cameras, points_px, variance_px2, self.landmarks, self._solve.flips
        )
        score = np.where(flipped, score[..., list(self.landmarks.mirror)], score)
        found = triangulate(self._cameras, points_px, variance_px2, self._solve.triangulate)
        confidence = score[:, -1].max(axis=0)
        unsure = confidence < self._solve.confident_from
        points = np.where(unsure[:, None], np.nan, found.points_world[-1])
        if not np.isfinite(points).any():
            return None
        names = tuple(name for name, slot in zip(self._cameras.names, slots[:, -1], strict=True) if slot >= 0)
        covariance = np.where(unsure[:, None, None], np.nan, found.covariance_world[-1])
        return LivePerson(number, points, covariance, confidence, names)


def _nobody(landmarks: int) -> _Detections:
    empty = np.empty((0, landmarks))
    return _Detections(np.empty(0, dtype=np.int64), np.empty((0, landmarks, 2)), empty, empty)


def _last(tracks: CameraTracks) -> _Detections:
    """The people of the last frame."""
    there = np.flatnonzero(tracks.ids[-1] >= 0)
    there = there[np.argsort(tracks.ids[-1, there])]
    body = tracks.body
    return _Detections(
        tracks.ids[-1, there], body.points_px[-1, there], body.variance_px2[-1, there], body.score[-1, there]
    )
