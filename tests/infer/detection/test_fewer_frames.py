"""Which frames are looked at, and what the others get."""

from typing import Any

import numpy as np
import pytest

from muybridge.geometry.landmarks.sets import BODY23
from muybridge.infer.detection import person_detector
from muybridge.infer.detection.background import SmallFrames
from muybridge.infer.detection.crop_reader import Poses
from muybridge.infer.detection.orientation import FrameOrientation, Letterbox
from muybridge.infer.detection.person_detector import PeopleDetector
from muybridge.infer.detection.resample import enough_rows, interpolate_poses, scatter_poses
from muybridge.infer.detection.tracks import LandmarkArrays, by_name
from muybridge.models.people.decode import DetectedPeople

BOX = np.array([100.0, 50, 160, 200])


class _Network:
    """Hands on what the frames' first pixel says: 0 for nobody, otherwise how far to the right somebody is."""

    class card:  # noqa: N801
        stride = 8

    def __call__(self, pixels: Any, difference: Any) -> tuple[Any, Any]:
        return pixels[:, 0, 0, 0], None


def _decode(places: Any, *_: Any) -> list[DetectedPeople]:
    return [DetectedPeople(BOX[None] + [at, 0, at, 0] if at else np.empty((0, 4)), np.full(int(at > 0), 0.9))
            for at in places.astype(float)]  # fmt: skip


@pytest.mark.parametrize(
    ("places", "seen"),
    [([9] * 16, [0, 3, 7, 11, 15]), ([0] * 8 + [9] * 8, [0, 3, 7, 8, 9, 10, 11, 15]),
     ([1 + 12 * k for k in range(16)], list(range(16)))],
)  # fmt: skip
def test_people_are_looked_for_in_every_frame_where_they_come_or_move_fast(
    monkeypatch: pytest.MonkeyPatch, places: list[int], seen: list[int]
) -> None:
    monkeypatch.setattr(person_detector, "decode_people", _decode)
    letterbox = Letterbox(FrameOrientation(320, 320), 320)
    pixels = np.zeros((16, 320, 320, 3), np.uint8)
    pixels[:, 0, 0, 0] = places
    detector = PeopleDetector(_Network(), letterbox, fps=60.0)  # type: ignore[arg-type]
    found = detector(SmallFrames(pixels, letterbox))
    assert [t for t, each in enumerate(found) if each is not None] == seen
    assert detector.passes == len(seen)


def test_every_frame_of_a_fast_limb_is_read() -> None:
    frames = np.array([0, 1, 2, 3, 4, 5, 6, 10, 11, 12])
    points, boxes = np.zeros((10, 23, 2)), np.tile([0.0, 0, 50, 100], (10, 1))
    points[:3, 20:, 0] = np.array([0.0, 3, 6])[:, None]  # three landmarks, 6 % of the box in two frames
    points[3:, 20:, 0] = 6
    chosen = enough_rows(frames, points, boxes, 2)
    assert frames[chosen].tolist() == [0, 1, 2, 4, 6, 10, 12]
    assert enough_rows(frames, points, boxes, 1).all()


def test_poses_between_those_read_are_interpolated() -> None:
    points = np.zeros((2, 23, 2))
    points[1] = 8.0
    points[1, 0] = np.nan
    score = np.array([0.5, 0.8])[:, None].repeat(23, 1)
    score[1, 0] = 0.0
    body = LandmarkArrays(BODY23, points, np.array([1.0, 4.0])[:, None].repeat(23, 1), score, score)
    read = np.array([True, False, False, False, True])
    poses = scatter_poses(Poses(by_name([body]), np.zeros((2, 4))), read, np.zeros((5, 4)))
    interpolate_poses(poses, np.arange(5), read)
    found = poses.body
    np.testing.assert_allclose(found.points_px[:, 1, 0], [0, 2, 4, 6, 8])
    np.testing.assert_allclose(found.variance_px2[:, 1], [1, 4, 4, 4, 4])
    np.testing.assert_allclose(found.score[:, 1], [0.5, 0.5, 0.5, 0.5, 0.8])
    assert np.isnan(found.points_px[1:4, 0]).all() and (found.score[1:, 0] == 0).all()
