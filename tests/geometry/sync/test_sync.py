"""Clocks of cameras from sound, motion and epipolar geometry; `muybridge sync` and what `run` does with it."""

from pathlib import Path

import av
import numpy as np
import pytest

from muybridge.errors import SessionError
from muybridge.geometry.calibration import load_calibration
from muybridge.geometry.cameras.group import CameraGroup
from muybridge.geometry.cameras.video_size import fit_to_video
from muybridge.geometry.landmarks.arrays import Keypoints2D
from muybridge.geometry.landmarks.sets import BODY23
from muybridge.geometry.sync.audio import audio_clock
from muybridge.geometry.sync.clocks import Clock, Delays, clock_from_delays, parabola, resample, resample_keypoints
from muybridge.geometry.sync.epipolar import epipolar_clocks
from muybridge.geometry.sync.motion import motion_clocks
from muybridge.infer.pipelines.sync import SyncResult, disagreements, read_audio, write_sync
from muybridge.infer.session.sync_file import first_frames_in_common, read_sync
from tests.rigs import ring_of_cameras

FPS = 60.0


def _rig(count: int) -> CameraGroup:
    return ring_of_cameras(
        count,
        radius=5,
        height=[1.6 + 0.2 * k for k in range(count)],
        size=(1920, 1080),
        params=(1500, 1500, 960, 540),
    )


def _walker(times: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """(n, 12, 3) a cloud of landmarks that wanders and swings, smooth in time."""
    base = rng.uniform([-0.3, -0.3, 0.1], [0.3, 0.3, 1.8], (12, 3))
    rates, phases = rng.uniform(0.4, 2.2, (12, 3, 3)), rng.uniform(0, 2 * np.pi, (12, 3, 3))
    swing = (0.12 * np.sin(2 * np.pi * rates * times[:, None, None, None] + phases)).sum(axis=-1)
    path = np.stack([np.sin(0.7 * times), np.cos(0.5 * times), 0 * times], axis=-1)
    return base + swing + 0.5 * path[:, None]


def _views(offsets: np.ndarray, drifts: np.ndarray, seconds: float) -> tuple[CameraGroup, np.ndarray, np.ndarray]:
    cameras = _rig(len(offsets))
    frames = np.arange(int(seconds * FPS)) / FPS
    px = []
    for camera, offset, drift in zip(cameras, offsets, drifts, strict=True):
        world = _walker((frames - offset) / (1 + drift), np.random.default_rng(5))
        px.append(camera.project(world))
    noisy = np.stack(px) + np.random.default_rng(6).normal(0, 2.0, np.shape(px))
    return cameras, noisy, np.full(noisy.shape[:-1], 4.0)


def test_movement_finds_sub_frame_offsets() -> None:
    offsets = np.array([0.0, 13.4, -21.25, 5.6]) / FPS
    _, px, variance = _views(offsets, np.zeros(4), 8.0)
    clocks = motion_clocks(px, variance, FPS, 1.0)
    error = np.array([c.offset for c in clocks]) - offsets
    assert np.abs(error).max() * FPS < 0.25
    assert all(abs(e) < 5 * c.offset_sd for e, c in zip(error[1:], clocks[1:], strict=True))


def test_a_short_take_gets_no_accidental_offset() -> None:
    """Speeds of noisy landmarks over one second hardly correlate, and chance is largest in short overlaps."""
    _, px, variance = _views(np.zeros(3), np.zeros(3), 1.2)
    noise = np.random.default_rng(7).normal(0, 12.0, px.shape)
    clocks = motion_clocks(px + noise, variance, FPS, 2.0)
    assert all(abs(c.offset) < 0.1 for c in clocks)


def test_a_peak_at_the_edge_is_not_interpolated() -> None:
    assert parabola(np.array([-np.inf, 3.0, 2.0]), 1) == 0.0
    assert parabola(np.array([1.0, 3.0, 2.0]), 1) == pytest.approx(1 / 6)


def test_epipolar_geometry_finds_sub_frame_offsets_and_drift() -> None:
    offsets, drifts = np.array([0.0, 4.3, -6.7]) / FPS, np.array([0.0, 400e-6, -250e-6])
    cameras, px, variance = _views(offsets, drifts, 40.0)
    clocks = epipolar_clocks(cameras, px, variance, FPS, with_drift=True)
    assert np.abs(np.array([c.offset for c in clocks]) - offsets).max() * FPS < 0.1
    assert np.abs(np.array([c.drift for c in clocks]) - drifts).max() < 60e-6


def _sound(times: np.ndarray) -> np.ndarray:
    """Noise in bursts at any times (seconds), smooth enough to be interpolated."""
    rng = np.random.default_rng(3)
    grid = np.arange(0, times.max() + 12, 1 / 16000)
    loud = np.repeat(rng.uniform(0, 1, len(grid) // 800 + 1) ** 4, 800)[: len(grid)]
    return np.interp(times + 5, grid, rng.normal(size=len(grid)) * loud)


@pytest.mark.slow
def test_sound_finds_offset_and_drift_over_ten_minutes() -> None:
    rate, offset, drift = 8000, 0.3371, 50e-6
    own = np.arange(600 * rate) / rate
    noise = np.random.default_rng(4).normal(0, 0.05, (2, len(own)))
    clock = audio_clock(_sound(own) + noise[0], _sound((own - offset) / (1 + drift)) + noise[1], rate)
    assert abs(clock.offset - offset) < 2e-3
    assert abs(clock.drift - drift) < 10e-6
    assert clock.offset_sd < 1e-3


@pytest.mark.parametrize("late", [0.3, -0.8, 1.3])
def test_periodic_sound_is_resolved_by_other_sounds(late: float) -> None:
    rng, rate = np.random.default_rng(3), 8000
    beat = np.zeros(30 * rate)
    for start in range(0, len(beat) - 500, 6 * rate // 10):
        beat[start : start + 500] += np.sin(np.arange(500) * 0.8) * np.exp(-np.arange(500) / 70)
    room, begin = 0.02 * rng.normal(size=len(beat)), 5 * rate
    other = begin - round(late * rate)

    def heard(sound: np.ndarray, at: int) -> np.ndarray:
        return sound[at : at + 20 * rate] + 0.01 * rng.normal(size=20 * rate)

    resolved = audio_clock(heard(beat + room, begin), heard(beat + room, other), rate, 2.0)
    assert abs(resolved.offset - late) < 1e-3 and resolved.offset_sd < 1e-3
    # Beats alone say nothing of which is which.
    assert audio_clock(heard(beat, begin), heard(beat, other), rate, 2.0).offset_sd > 0.5


def test_silence_is_not_an_offset() -> None:
    assert not np.isfinite(audio_clock(np.zeros(80000), _sound(np.arange(80000) / 8000), 8000).offset_sd)


def test_a_line_through_delays_ignores_wrong_windows() -> None:
    at = np.linspace(10, 590, 20)
    delay = 0.1 + 50e-6 * at
    delay[[3, 11, 12]] += (0.4, -0.2, 0.7)
    clock = clock_from_delays(Delays(at, delay, np.full(20, 1e-4), np.ones(20)), with_drift=True)
    assert abs(clock.offset - 0.1) < 1e-4 and abs(clock.drift - 50e-6) < 1e-6


def test_resample_is_exact_on_frames_and_missing_beside_gaps() -> None:
    px = np.arange(20.0).reshape(10, 1, 2)
    variance = np.ones((10, 1))
    px[4], variance[4] = np.nan, np.nan
    at, sd = resample(px, variance, 10.0, np.array([-0.1, 0.3, 0.35, 0.5, 0.55, 0.9, 0.95]))
    assert np.isnan(at[[0, 2, 6]]).all() and np.isnan(sd[[0, 2, 6]]).all()
    np.testing.assert_allclose(at[[1, 3, 4, 5], 0, 0], [6, 10, 11, 18])


def test_the_shifted_real_take_is_aligned(real_data: Path) -> None:
    folder = real_data / "balancing"
    stored = np.load(folder / "reference" / "openpose_body25b.npz")
    points, score = stored["keypoints2d_px"][..., :2], stored["keypoints2d_px"][..., 2]
    variance = np.where(score > 0.2, 1 / np.maximum(score, 0.05) ** 2, np.nan)
    cameras = load_calibration(folder / "calibration" / "Calib.qca.txt")
    fitted = [fit_to_video(c, 1080, 1920, "letterbox")[0] if k < 2 else c for k, c in enumerate(cameras)]
    late = np.array([0, 7, -5, 3])
    px = np.stack([points[c, 10 - n : 90 - n] for c, n in enumerate(late)])
    variance = np.stack([variance[c, 10 - n : 90 - n] for c, n in enumerate(late)])
    clocks = epipolar_clocks(CameraGroup(tuple(fitted)), px, variance, FPS)
    found = np.array([c.offset for c in clocks]) * FPS
    assert np.abs(found - late).max() < 0.25
    assert np.abs(found - late)[1:].max() < 5 * max(c.offset_sd for c in clocks) * FPS


def test_sync_file_round_trip_and_invalid_files(tmp_path: Path) -> None:
    clocks = (Clock(0.0, 0.0, 0.0, 0.0, 1.0), Clock(0.1234567, -3.2e-5, 1e-3, 1e-6, 0.5))
    path = tmp_path / "sync.toml"
    write_sync(path, ("a b", "cam.2"), SyncResult(clocks, ("reference", "audio"), {}, ()))
    read = read_sync(path, ("a b", "cam.2"))
    assert read[1].offset == clocks[1].offset and read[1].drift == pytest.approx(clocks[1].drift, rel=1e-12)
    with pytest.raises(SessionError, match="none of the cameras"):
        read_sync(path, ("x", "y"))
    for text in ("[", "muybridge_sync = 2", 'muybridge_sync = 1\n[cameras.x]\noffset = "late"'):
        path.write_text(text)
        with pytest.raises(SessionError, match="sync.toml"):
            read_sync(path, ("x", "y"))


def test_videos_start_at_the_first_common_time() -> None:
    def clock(offset: float, drift: float = 0.0) -> Clock:
        return Clock(offset, drift, 0.0, 0.0, 1.0)

    # The second video starts 1.6 s after the first, the third 0.11 s before it, with a clock that drifts.
    clocks = (clock(0.0), clock(-1.6), clock(0.11, 5e-5))
    first, left = first_frames_in_common(clocks, "abc", (100, 60, 90), 25.0)
    np.testing.assert_array_equal(first, [40, 0, 43])
    times = np.arange(40) / 25
    for c, (before, after) in enumerate(zip(clocks, left, strict=True)):
        np.testing.assert_allclose(first[c] / 25 + after.at(times), before.at(1.6 + times), atol=1e-8)
    assert left[0].offset == left[1].offset == 0 and abs(left[2].offset) < 0.02
    # The take's time is that of the first video, whichever clock is the reference in the file.
    first, left = first_frames_in_common((clock(0.51), clock(0.5)), "ab", (50, 50), 25.0)
    assert first.tolist() == [0, 0] and left[0].offset == 0 and left[1].offset == pytest.approx(-0.01)
    with pytest.raises(SessionError, match="by sync.toml b ends 0.44 s before a begins"):
        first_frames_in_common((clock(0.0), clock(4.8)), "ab", (100, 110), 25.0)


def test_landmarks_are_resampled() -> None:
    offsets = np.array([0.0, 2.5, -1.25]) / FPS
    cameras, px, variance = _views(offsets, np.zeros(3), 4.0)
    count = len(BODY23.names)
    pad = [(0, 0), (0, 0), (0, 0), (0, count - 12)]
    everyone = Keypoints2D(
        BODY23,
        np.pad(px[:, :, None], [*pad, (0, 0)], constant_values=np.nan),
        np.pad(variance[:, :, None], pad, constant_values=np.nan),
        np.pad(np.ones_like(variance)[:, :, None], pad),
    )
    moved = resample_keypoints(everyone, [Clock(o, 0.0, 0.0, 0.0, 1.0) for o in offsets], FPS)
    truth = cameras.project(_walker(np.arange(px.shape[1]) / FPS, np.random.default_rng(5)))
    before = np.nanmedian(np.abs(px - truth)[1:])
    after = np.nanmedian(np.abs(moved.points_px[:, :, 0, :12] - truth)[1:])
    assert after < 2.0 < before
    assert (moved.score[~np.isfinite(moved.variance_px2)] == 0).all()


def test_methods_that_disagree_are_reported() -> None:
    zero = Clock(0.0, 0.0, 0.0, 0.0, 1.0)
    found = {
        "audio": (zero, Clock(0.5, 0.0, 1e-4, 0.0, 1.0), Clock(0.1, 0.0, 1e-4, 0.0, 1.0)),
        "epipolar": (zero, Clock(0.1, 0.0, 2e-3, 0.0, 1.0), Clock(0.101, 0.0, 2e-3, 0.0, 1.0)),
    }
    sentences = disagreements(("a", "b", "c"), found, FPS)
    assert len(sentences) == 1 and "camera b" in sentences[0] and "audio" in sentences[0]


def test_sound_is_read_from_a_video(tmp_path: Path) -> None:
    path = tmp_path / "take.mka"
    rate = 16000
    own = np.arange(3 * rate) / rate
    sound = (0.2 * _sound(own)).astype(np.float32)
    with av.open(str(path), "w") as container:
        stream = container.add_stream("pcm_s16le", rate=rate, layout="mono")
        frame = av.AudioFrame.from_ndarray((sound * 32767).astype(np.int16)[None], format="s16", layout="mono")
        frame.rate = rate
        container.mux(stream.encode(frame))
        container.mux(stream.encode(None))
    read = read_audio(path)
    assert read is not None and len(read) == len(sound)
    np.testing.assert_allclose(read, sound, atol=1e-3)
