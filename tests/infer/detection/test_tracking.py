"""Tracks: people who cross, detections that are missing, slots and smoothing."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np

from muybridge.arrays import BoolArray, FloatArray
from muybridge.geometry.landmarks.sets import BODY23
from muybridge.infer.detection.crop_reader import PoseReader, Poses
from muybridge.infer.detection.orientation import FrameOrientation
from muybridge.infer.detection.tracker import BoxSmoother, TrackedFrame, Tracker, TrackOptions
from muybridge.infer.detection.tracks import LandmarkArrays, by_name
from muybridge.models.people.decode import DetectedPeople


def _box(x: float, y: float = 300.0, width: float = 80.0, height: float = 240.0) -> FloatArray:
    return np.array([x - width / 2, y - height / 2, x + width / 2, y + height / 2])


def _detected(*boxes: FloatArray, scores: list[float] | None = None) -> DetectedPeople:
    return DetectedPeople(np.array(boxes).reshape(-1, 4), np.array([0.9] * len(boxes) if scores is None else scores))


def _tracker(**options: float) -> Tracker:
    return Tracker(np.array([-0.5, -0.5, 1279.5, 719.5]), TrackOptions(**options))  # type: ignore[arg-type]


def _middle_x(frame: TrackedFrame, track: int) -> float:
    (slot,) = np.flatnonzero(frame.ids == track)
    return float(frame.boxes_px[slot, [0, 2]].mean())


def test_two_people_who_cross_keep_their_tracks() -> None:
    tracker = _tracker()
    rng = np.random.default_rng(0)
    for t in range(80):
        left, right = 200.0 + 10 * t, 1000.0 - 10 * t
        noisy = [_box(x + rng.normal(0, 2)) for x in (left, right)]
        # While they overlap the detector sees one person, who is somewhere between the two.
        boxes = [_box((left + right) / 2 + rng.normal(0, 3))] if abs(left - right) < 60 else noisy[:: 1 - 2 * (t % 2)]
        frame = tracker.step(_detected(*boxes))
    assert sorted(frame.ids[frame.ids >= 0]) == [0, 1]
    first = 0 if abs(_middle_x(frame, 0) - left) < 15 else 1
    assert abs(_middle_x(frame, first) - left) < 15 and abs(_middle_x(frame, 1 - first) - right) < 15
    assert first == 0


def test_a_track_goes_on_while_the_detector_misses_it() -> None:
    tracker = _tracker(coast=10 / 30)
    for t in range(40):
        seen = not 15 <= t < 23
        frame = tracker.step(_detected(_box(200.0 + 6 * t)) if seen else _detected())
        assert frame.ids.max() == 0 and frame.seen.any() == seen and frame.missed.any() == (not seen)
        assert abs(_middle_x(frame, 0) - (200 + 6 * t)) < 25
    for _ in range(10):
        assert tracker.step(_detected()).ids.max() == 0
    assert tracker.step(_detected()).ids.max() == -1


def test_skipped_frames_are_no_misses() -> None:
    tracker = _tracker(coast=2 / 30)
    for t in range(30):
        frame = tracker.step(_detected(_box(200.0 + 6 * t)) if t % 10 == 0 else None)
        assert frame.ids.max() == 0 and not frame.missed.any()


def test_single_false_detections_end_at_once() -> None:
    tracker = _tracker()
    tracker.step(_detected(_box(200)))
    assert tracker.step(_detected()).ids.max() == 0
    assert tracker.step(_detected()).ids.max() == -1


def test_weak_detections_prolong_but_do_not_start_tracks() -> None:
    tracker = _tracker(start_score=0.5)
    assert tracker.step(_detected(_box(200), scores=[0.4])).ids.max() == -1
    assert tracker.step(_detected(_box(200), scores=[0.6])).ids.max() == 0
    frame = tracker.step(_detected(_box(202), scores=[0.3]))
    assert frame.ids.max() == 0 and frame.seen.any()


def test_slots_are_reused_only_after_a_track_ended() -> None:
    tracker = _tracker(max_people=2, coast=2 / 30)
    a, b, c = _box(200), _box(600), _box(1000)
    for _ in range(5):
        frame = tracker.step(_detected(a, b, c))
    assert frame.ids.tolist() == [0, 1]
    for _ in range(2):
        assert tracker.step(_detected(b, c)).ids.tolist() == [0, 1]
    # The third miss ends a's track and frees its slot for c.
    assert tracker.step(_detected(b, c)).ids.tolist() == [2, 1]
    # Both leave; the slot that was freed first is taken first.
    for _ in range(3):
        tracker.step(_detected(b))
    for _ in range(3):
        tracker.step(_detected())
    assert tracker.step(_detected(c)).ids.tolist() == [3, -1]


def test_a_weak_track_makes_room_for_a_strong_newcomer() -> None:
    tracker = _tracker(max_people=2)
    doubtful, sure, strong, middling = _box(200), _box(600), _box(1000), _box(1100, y=600)
    for _ in range(10):
        frame = tracker.step(_detected(sure, doubtful, scores=[0.9, 0.4]))
    assert frame.ids.tolist() == [0, 1]
    assert tracker.step(_detected(sure, middling, doubtful, scores=[0.9, 0.5, 0.4])).ids.tolist() == [0, 1]
    frame = tracker.step(_detected(sure, strong, doubtful, scores=[0.9, 0.85, 0.4]))
    assert frame.ids.tolist() == [0, 2] and frame.seen.all()
    assert _middle_x(frame, 2) == 1000


def test_a_second_box_on_a_tracked_person_starts_no_track() -> None:
    tracker = _tracker()
    tracker.step(_detected(_box(200)))
    assert (tracker.step(_detected(_box(200), _box(215))).ids >= 0).sum() == 1


def test_a_track_that_leaves_the_image_ends() -> None:
    tracker = _tracker()
    for t in range(12):
        tracker.step(_detected(_box(1100 + 15.0 * t)))
    ended = [tracker.step(_detected()).ids.max() < 0 for _ in range(6)]
    assert ended[-1] and not ended[0]


def test_other_evidence_keeps_a_track_and_can_end_it() -> None:
    tracker = _tracker(coast=3 / 30)
    for _ in range(5):
        frame = tracker.step(_detected(_box(200)))
    for t in range(20):
        frame = tracker.step(_detected())
        assert frame.ids[0] == 0
        tracker.confirm(0, _box(200.0 + 3 * t))
    assert abs(_middle_x(frame, 0) - 254) < 5
    tracker.end(0)
    assert tracker.step(_detected()).ids.max() == -1


def _frames(x: FloatArray, seen: BoolArray) -> list[TrackedFrame]:
    one = np.zeros(1, dtype=np.int64)
    return [TrackedFrame(_box(v)[None], one, np.array([s]), np.array([not s])) for v, s in zip(x, seen, strict=True)]


def test_boxes_are_filled_and_smoothed_without_lag() -> None:
    rng = np.random.default_rng(0)
    truth = 200.0 + 5 * np.arange(64)
    noisy = truth + rng.normal(0, 4, 64)
    seen = np.ones(64, dtype=bool)
    noisy[20], noisy[40:43], seen[40:43] = noisy[20] + 300, 0.0, False
    smoother = BoxSmoother()
    parts = [smoother(_frames(noisy[s : s + 16], seen[s : s + 16])) for s in range(0, 64, 16)]
    smooth = np.concatenate(parts)[:, 0, [0, 2]].mean(axis=-1)
    inner = np.abs(np.arange(64) - 20) > 0
    assert np.abs(smooth - truth)[inner].max() < 15
    assert np.sqrt(np.mean((smooth - truth)[5:-5] ** 2)) < 4
    assert abs(np.mean((smooth - truth)[5:-5])) < 2


def test_smoothing_does_not_reach_across_tracks() -> None:
    frames = []
    for t in range(12):
        ids = np.array([0 if t < 6 else 1])
        frames.append(TrackedFrame(_box(200.0 if t < 6 else 900.0)[None], ids, np.array([True]), np.array([False])))
    smooth = BoxSmoother()(frames)[:, 0, [0, 2]].mean(axis=-1)
    np.testing.assert_allclose(smooth, [200.0] * 6 + [900.0] * 6)


def test_boxes_at_low_frame_rates_do_not_lag() -> None:
    """Who strides through the picture at 6 frames a second is where the box is, not where it was on average."""
    left = np.array([0, 0, 100, 200, 300, 300, 300.0]) + np.arange(7) ** 2
    frames = [
        TrackedFrame(np.array([[x, 10, x + 80, 170]]), np.array([0]), np.array([True]), np.array([False])) for x in left
    ]
    slow, quick = (BoxSmoother(fps=fps)(frames)[:, 0, 0] for fps in (30.0, 6.0))
    assert np.abs(quick - left).max() < 3 < 20 < np.abs(slow - left).max()


def test_confident_landmarks_show_that_two_tracks_are_one_person() -> None:
    rng = np.random.default_rng(0)
    body = rng.uniform([0, 0], [100, 200], (23, 2))
    upper = np.arange(13)
    points = np.stack([body, body])[:, None].repeat(5, axis=1).reshape(10, 23, 2)
    points[5:, 13:] += 80  # one crop cuts the legs off
    score = np.full((10, 23), 0.1)
    score[:, upper] = 0.8
    poses = Poses(by_name([LandmarkArrays(BODY23, points, score, score, score)]), np.zeros((10, 4)))
    network = SimpleNamespace(landmarks=BODY23, channels=3)
    reader = PoseReader(network, None, FrameOrientation(640, 480), None, 30.0)  # type: ignore[arg-type]
    frame, track = np.tile(np.arange(5), 2), np.repeat([0, 1], 5)
    assert reader.duplicates(frame, track, poses).tolist() == [1]
    # Where nothing is sure all landmarks count; and where the sure ones are apart, they are two.
    apart = points.copy()
    apart[5:] += [60, 0]
    assert (
        reader.duplicates(
            frame, track, replace(poses, landmarks=by_name([replace(poses.body, points_px=apart)]))
        ).tolist()
        == []
    )


def test_a_track_is_not_pulled_off_its_person_so_that_a_stray_one_gets_a_box() -> None:
    tracker = _tracker()
    person, part = _box(760, 380, 680, 690), _box(1034, 496, 190, 470)
    first = tracker.step(_detected(person, scores=[0.6]))
    slot = int(np.flatnonzero(first.ids >= 0)[0])
    tracker.step(_detected(person, part, scores=[0.55, 0.36]))
    # The person again, and a poor box below it; the part is not seen.
    now = tracker.step(_detected(_box(600, 620, 530, 830), _box(750, 382, 700, 690), scores=[0.3, 0.5]))
    np.testing.assert_allclose(now.boxes_px[slot], _box(750, 382, 700, 690))
