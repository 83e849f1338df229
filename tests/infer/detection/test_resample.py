"""2D landmarks at the take's moments, where pictures were taken at others or repeat one another."""

from types import SimpleNamespace

import numpy as np
import pytest

from muybridge.geometry.landmarks.sets import BODY23
from muybridge.infer.detection.frozen_frames import RepeatedFrames, find_frozen, repeats_notice
from muybridge.infer.detection.resample import on_time, resample_tracks
from muybridge.infer.detection.tracks import CameraTracks, LandmarkArrays, by_name
from muybridge.infer.session.probe import probe_video
from muybridge.infer.session.video import read_chunks
from scripts.assets.write_video import video_writer

FPS, COUNT = 30.0, len(BODY23)


def session(frames, late=None, index=None):
    return SimpleNamespace(
        frame_indices=np.arange(frames)[None] if index is None else np.array(index)[None], fps=FPS,
        late=None if late is None else np.array(late, float)[None], ended=None,
        videos=(SimpleNamespace(path=SimpleNamespace(name="cam1.mp4")),),
    )  # fmt: skip


def tracks(x, ids=None):
    """One person whose landmarks are `x` px to the right, in a box of 200 px."""
    x = np.asarray(x, float)
    points = np.zeros((len(x), 1, COUNT, 2)) + np.arange(COUNT)[:, None] * 8.0
    points[..., 0] += x[:, None, None]
    box = np.stack([x, 0 * x, x + 200, 0 * x + 200], -1)[:, None]
    shape = (len(x), 1, COUNT)
    body = LandmarkArrays(BODY23, points, np.full(shape, 4.0), np.full(shape, 0.9), np.full(shape, 0.8))
    return CameraTracks(
        by_name([body]), box,
        np.zeros((len(x), 1), np.int64) if ids is None else np.array(ids)[:, None],
    )  # fmt: skip


def at(found):
    return found.body.points_px[:, 0, 0, 0]


NONE = np.zeros(40, bool)


def test_frames_on_time_are_unchanged():
    there = tracks(np.arange(40) * 5)
    assert resample_tracks(session(40), 0, there, NONE) is there


def test_landmarks_are_interpolated_to_the_times_of_the_take():
    """Frames up to 12 ms late or early, of somebody who moves evenly."""
    late = np.random.default_rng(3).uniform(-0.012, 0.012, 40)
    times = np.arange(40) / FPS + late
    found = resample_tracks(session(40, late), 0, tracks(150 * times), NONE)
    inside = slice(1, -1)
    assert np.abs(150 * times - 150 * np.arange(40) / FPS).max() > 1
    assert at(found)[inside] == pytest.approx(150 * np.arange(40)[inside] / FPS, abs=0.1)
    assert (found.ids == 0).all() and np.isfinite(found.boxes_px).all()
    assert found.body.score == pytest.approx(0.9) and found.body.variance_px2 == pytest.approx(4.0)


@pytest.mark.parametrize("how", ["repeated", "taken twice"])
def test_repeated_frames_are_not_used(how):
    source = np.arange(40) // 3 * 3
    shown = tracks(5.0 * source)
    if how == "repeated":
        found = resample_tracks(session(40), 0, shown, np.arange(40) % 3 > 0)
    else:
        found = resample_tracks(session(40, index=source), 0, shown, NONE)
    assert at(found) == pytest.approx(5.0 * np.minimum(np.arange(40), 39))


def test_frozen_frames_are_missing_unless_the_person_stood_still():
    source = np.where(np.arange(40) < 10, np.arange(40), np.where(np.arange(40) < 30, 10, np.arange(40)))
    repeats = np.append(False, np.diff(source) == 0)
    moved = resample_tracks(session(40), 0, tracks(5.0 * source), repeats)
    assert np.isnan(at(moved)[11:30]).all() and np.isfinite(at(moved)[[*range(11), *range(30, 40)]]).all()
    assert (moved.ids[11:30] == -1).all() and not moved.body.score[11:30].any()
    still = resample_tracks(session(40), 0, tracks(0.01 * source), repeats)
    assert np.isfinite(at(still)).all() and at(still) == pytest.approx(0.01 * np.arange(40), abs=0.01)
    ended = resample_tracks(session(40), 0, tracks(5.0 * np.minimum(np.arange(40), 30)), np.arange(40) > 30)
    assert np.isnan(at(ended)[31:]).all(), "a video that is frozen to its end shows nothing there"


def test_no_interpolation_between_two_people():
    ids = np.where(np.arange(40) < 20, 0, 1)
    repeats = np.isin(np.arange(40), [19, 18, 17])
    found = resample_tracks(session(40), 0, tracks(5.0 * np.arange(40), ids), repeats)
    assert (found.ids[[17, 18], 0] == -1).all() and at(found)[16] == 80 and at(found)[20] == 100


def film(path, positions, step=40, depth=180):
    """A bright square on a noisy ground at each of these places."""
    rng = np.random.default_rng(1)
    ground = rng.integers(40, 60, (160, 320, 3)).astype(np.uint8)
    with video_writer(path, (320, 160), FPS) as write:
        for x in positions:
            frame = ground.copy()
            frame[60:100, int(x) : int(x) + step] = 60 + depth
            write(frame)
    return probe_video(path)


def test_repeated_frames_are_found_in_an_encoded_video(tmp_path):
    source = np.arange(40) // 2 * 2
    video = film(tmp_path / "film.mp4", 20 + 4 * source)
    repeats = RepeatedFrames(video.width, video.height)
    for chunk in read_chunks(video):
        for frame in chunk:
            repeats.add(frame)
    assert np.flatnonzero(repeats.confirmed(tracks(4.0 * source))).tolist() == list(range(1, 39, 2))
    assert not repeats.confirmed(tracks(0.01 * source)).any(), "of somebody who stands still it does not matter"


def test_similar_frames_are_no_repeats(tmp_path):
    """Somebody who hardly differs from the ground: the pictures do not tell that they move, their landmarks do."""
    x = 4.0 * np.arange(40)
    video = film(tmp_path / "film.mp4", 20 + x, depth=-6)
    repeats = RepeatedFrames(video.width, video.height)
    for chunk in read_chunks(video):
        for frame in chunk:
            repeats.add(frame)
    assert np.mean(repeats._repeats) > 0.3
    assert not repeats.confirmed(tracks(x)).any()


def test_a_video_frozen_to_its_end_is_found_by_the_other_cameras():
    walks, stays = tracks(np.arange(40) * 5), tracks(np.zeros(40))
    froze = tracks(np.minimum(np.arange(40), 19) * 5)
    assert find_frozen([froze, walks], [20, 40], FPS) == [20, None]
    # Not where the others see somebody stand still as well, for a moment alone, or where all videos do.
    assert find_frozen([froze, stays], [20, 40], FPS) == [None, None]
    assert find_frozen([froze, walks], [36, 40], FPS) == [None, None]
    assert find_frozen([froze, froze], [20, 20], FPS) == [None, None]
    left = resample_tracks(session(40), 0, froze, np.arange(40) >= 20)
    assert (left.ids[:20] == 0).all() and (left.ids[20:] == -1).all() and np.isnan(left.body.points_px[20:]).all()


def test_still_frames_at_the_end_are_counted():
    pictures = np.random.default_rng(0).integers(0, 255, (6, 40, 40, 3)).astype(np.uint8)
    for shown, expected in (([0, 1, 2, 2, 2], 3), ([0, 1, 1, 2], 4), ([0, 0, 0], 1)):
        repeats = RepeatedFrames(40, 40)
        for k in shown:
            repeats.add(pictures[k])
        assert repeats.still_from == expected


def test_a_camera_may_have_more_frames_than_the_take():
    repeats = np.arange(50) % 3 == 1
    assert f"{repeats[:40].sum()} of 40 frames" in repeats_notice(session(40), 0, repeats)
    assert on_time(session(40, np.zeros(40)), 0, repeats).shape == (40,)


def test_a_video_with_repeated_frames_is_reported():
    said = repeats_notice(session(40), 0, np.arange(40) % 2 == 1)
    assert said is not None and said.startswith("cam1.mp4 repeats the frame before in 20 of 40 frames")
    assert repeats_notice(session(40), 0, np.arange(40) < 2) is None


def test_frames_of_another_time_are_no_training_data():
    repeats = np.isin(np.arange(6), [2])
    assert on_time(session(6), 0, repeats).tolist() == [True, True, False, True, True, True]
    late = [0, 0.002, 0, -0.02, 0.01, 0]
    assert on_time(session(6, late), 0, repeats).tolist() == [True, True, False, False, False, True]
