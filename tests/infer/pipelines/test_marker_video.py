"""Markers in video: blobs to sub-pixel, matched without names, ghosts rejected; the whole way to a skeleton."""

from pathlib import Path

import numpy as np
import pytest

from muybridge.geometry.calibration import save_calibration
from muybridge.geometry.markers.matching import MatchOptions, find_real_markers, follow_points, match_points
from muybridge.geometry.markers.tracking import track_points
from muybridge.infer.commands.app import run_command
from muybridge.infer.detection.blobs import find_blobs, find_threshold
from muybridge.motion.formats.points.c3d import read_c3d
from muybridge.motion.formats.skeletal.bvh import read_bvh
from muybridge.train.synthesis.markers.video import VideoFaults, draw_markers, ring_of_cameras
from scripts.assets.write_video import video_writer
from tests.run_record import check_record


def cloud(frames: int, count: int, rng: np.random.Generator, fps: float = 120.0) -> np.ndarray:
    """(T, N, 3) markers that move smoothly in a person's space, never nearer than 3 cm to one another."""
    time = np.arange(frames) / fps
    base = np.zeros((0, 3))
    while len(base) < count:
        new = rng.uniform([-0.4, -0.3, 0.1], [0.4, 0.3, 1.7])
        if len(base) == 0 or np.linalg.norm(base - new, axis=1).min() > 0.12:
            base = np.concatenate([base, new[None]])
    phase = rng.uniform(0, 6, (count, 3))
    return base + 0.04 * np.sin(2 * np.pi * 0.8 * time[:, None, None] + phase)


def test_blobs_to_a_fraction_of_a_pixel() -> None:
    rng = np.random.default_rng(0)
    camera = ring_of_cameras(1)[0]
    points = cloud(1, 30, rng)[0]
    images = [draw_markers(camera, points, np.zeros((0, 3)), VideoFaults(flickers=0), rng) for _ in range(3)]
    threshold = find_threshold(images)
    assert 40 < threshold < 220
    at = camera.project(points)
    apart = np.linalg.norm(at[:, None] - at[None], axis=-1) + 1e3 * np.eye(len(at))
    alone = apart.min(1) > 14
    found = find_blobs(images[0], threshold)
    off = np.linalg.norm(at[:, None] - found[None, :, :2], axis=-1).min(1)
    assert alone.sum() > 10
    assert np.sqrt(np.mean(off[alone] ** 2)) < 0.15
    assert len(found) <= len(points)


def test_touching_markers_are_split() -> None:
    rng = np.random.default_rng(1)
    camera = ring_of_cameras(1)[0]
    ray = np.array([0.0, 0.0, 0.9])
    side = camera.rotation[0] * 0.022
    image = draw_markers(camera, np.stack([ray - side / 2, ray + side / 2]), np.zeros((0, 3)),
                         VideoFaults(flickers=0, bloom=0.05), rng)  # fmt: skip
    found = find_blobs(image, find_threshold([image]))
    at = camera.project(np.stack([ray - side / 2, ray + side / 2]))
    assert len(found) == 2
    assert np.linalg.norm(at[:, None] - found[None, :, :2], axis=-1).min(1).max() < 1.0


def test_an_empty_image_has_no_blobs() -> None:
    image = np.random.default_rng(2).normal(14, 4, (200, 300)).clip(0, 255).astype(np.uint8)
    assert len(find_blobs(image, find_threshold([image]))) == 0


def test_matching_finds_markers_and_rejects_ghosts() -> None:
    rng = np.random.default_rng(3)
    cameras = ring_of_cameras(6)
    truth = cloud(40, 45, rng)
    seen = []
    for points in truth:
        at = cameras.project(points)
        frame = []
        for c in range(6):
            known = rng.random(len(points)) < 0.75
            lights = rng.uniform(0, 1023, (8, 2))
            noisy = at[c][known] + rng.normal(0, 0.15, (known.sum(), 2))
            frame.append(rng.permutation(np.concatenate([noisy, lights])))
        seen.append(frame)
    # Three cameras that agree hardly ever do so by accident; two do, until trajectories are looked at.
    for options, most in ((MatchOptions(pair_px=0.0), 12), (MatchOptions(), 200)):
        found, _ = follow_points(cameras, seen, 120.0, options)
        errors, ghosts, hit = [], 0, 0
        for t, points in enumerate(truth):
            here = found[t][np.isfinite(found[t, :, 0])]
            gap = np.linalg.norm(here[:, None] - points[None], axis=-1)
            ghosts += int((gap.min(1) > 0.01).sum())
            hit += int((gap.min(0) < 0.005).sum())
            errors.append(gap.min(1)[gap.min(1) < 0.01])
        assert np.sqrt(np.mean(np.concatenate(errors) ** 2)) < 0.0008
        assert hit / truth[..., 0].size > 0.97
        assert ghosts < most
    tracks = track_points(found, 120.0)
    good = find_real_markers(tracks.points, tracks.track, 5, 120.0)
    gap = np.linalg.norm(tracks.points[:, :, None] - truth[:, None], axis=-1)
    assert (np.nan_to_num(gap, nan=9.0).min(2)[good] > 0.01).sum() == 0


def test_no_blobs_give_no_points() -> None:
    cameras = ring_of_cameras(3)
    assert len(match_points(cameras, [np.zeros((0, 2))] * 3).points) == 0
    one = [np.array([[500.0, 500.0]]), np.zeros((0, 2)), np.zeros((0, 2))]
    assert len(match_points(cameras, one, None, MatchOptions()).points) == 0


def test_a_session_of_marker_videos_is_processed(tmp_path: Path) -> None:
    """Videos in; named markers and a skeleton out."""
    from muybridge.geometry.landmarks.marker_sets import PLUG_IN_GAIT
    from muybridge.geometry.skeleton.statistical_body import marker_body

    rng, table, frames = np.random.default_rng(6), marker_body(), 20
    offsets, places, _ = table.parts(table.mean)
    skeleton = table.skeleton(offsets)
    angles = np.tile(table.rest, (frames, 1, 1))
    angles[:, 1:] += 0.25 * np.sin(np.arange(frames)[:, None, None] / 12 + rng.uniform(0, 6, table.rest[1:].shape))
    angles = np.clip(angles, table.lower, table.upper)
    angles[:, 0] = 0
    height = -skeleton.rest_positions[:, 2].min() + 0.05
    turns, at = skeleton.forward(np.tile([0, 0, height], (frames, 1)), skeleton.rotations_from_angles(angles))
    truth = at[:, table.carrier] + np.einsum("tmij,mj->tmi", turns[:, table.carrier], places)
    truth = truth[:, list(PLUG_IN_GAIT.surface_indices)]
    cameras = ring_of_cameras(6, width=640, tall=640, focal_px=720.0)
    (tmp_path / "videos").mkdir()
    save_calibration(cameras, tmp_path / "calibration.toml")
    for camera in cameras:
        with video_writer(tmp_path / "videos" / f"{camera.name}.mp4", (640, 640), 120.0, crf=12) as write:
            for points in truth:
                seen = points[rng.random(len(points)) < 0.8]
                image = draw_markers(camera, seen, np.zeros((0, 3)), VideoFaults(flickers=0.5), rng)
                write(np.repeat(image[..., None], 3, axis=2))
    assert run_command(["run-markers", str(tmp_path), "--quiet"]) == 0
    out = tmp_path / "muybridge"
    points = read_c3d(out / "points.c3d")
    assert points.landmarks.names == PLUG_IN_GAIT.labels
    gap = np.linalg.norm(points.points_world - truth, axis=-1)
    assert np.mean(gap < 0.005) > 0.9
    record = check_record(out, "marker_videos")
    assert record["markers"]["found"] >= 37 and record["body"]["residual_mm"]["median"] < 8
    motion = read_bvh(out / "motion.bvh")
    assert len(motion) == frames and record["body"]["network"]
    joints = motion.joint_positions_world()
    named = [n for n in skeleton.names if n in motion.skeleton.names]
    gap = np.linalg.norm(joints[:, [motion.skeleton.names.index(n) for n in named]]
                         - at[:, [skeleton.names.index(n) for n in named]], axis=-1)  # fmt: skip
    assert len(named) > 15 and np.median(gap) < 0.02
    assert run_command(["run-markers", str(tmp_path), "--markerset", "nonsense"]) == 2


@pytest.mark.parametrize("frames", [3])
def test_lamps_and_flickers_are_no_markers(frames: int) -> None:
    rng = np.random.default_rng(4)
    points = np.full((60, 4, 3), np.nan)
    time = np.arange(60) / 120
    points[:, 0] = np.stack([np.sin(time), time, 1 + 0 * time], -1)
    points[:, 1] = points[:, 0] + [0, 0.1, 0]
    points[:, 2] = np.array([2.0, 2, 2]) + rng.normal(0, 2e-4, (60, 3))
    points[20 : 20 + frames, 3] = [1.0, 1, 1]
    tracks = track_points(points, 120.0)
    good = find_real_markers(tracks.points, tracks.track, 5, 120.0)
    assert good.sum() == 120
