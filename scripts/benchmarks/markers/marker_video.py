"""Markers in video, from images to names and a skeleton, on a synthetic take with known truth.

Usage: python -m scripts.benchmarks.markers.marker_video [--frames 240] [--kind dance] [--session FOLDER]

Six cameras of 1024 x 1024 px at 120 Hz around one of anny's bodies with the 39 Plug-in Gait markers; a marker is seen
where it faces a camera and no limb (capsule) is in front. Bloom, noise, three lamps in the room, and about one flicker
per camera and frame. A marker counts as visible if at least two (three) cameras see it. With --session the take is also
written as a session folder for `muybridge run-markers FOLDER`, which is run and scored.
"""

import argparse
import time
from contextlib import ExitStack
from pathlib import Path

import numpy as np

from muybridge.geometry.calibration import save_calibration
from muybridge.geometry.cameras.group import CameraGroup
from muybridge.geometry.landmarks.marker_sets import PLUG_IN_GAIT
from muybridge.infer.detection.blobs import find_blobs, find_threshold
from muybridge.infer.reconstruction.marker_videos import MarkerVideoOptions, find_markers, triangulate_again
from muybridge.train.synthesis.markers.rig import NAMES, bones_of
from muybridge.train.synthesis.markers.trajectories import MarkerBodies
from muybridge.train.synthesis.markers.video import VideoFaults, draw_markers, markers_in_sight, ring_of_cameras
from muybridge.train.synthesis.motions.rig import forward, turn
from muybridge.train.synthesis.motions.sampler import MotionSampler
from scripts.assets.write_video import video_writer

FPS = 120.0
LIMBS = (
    ("hips", "chest", 0.13),
    ("chest", "neck", 0.13),
    ("neck", "head", 0.06),
    *(
        (f"{s}_{a}", f"{s}_{b}", r)
        for s in ("left", "right")
        for a, b, r in (
            ("upper_arm", "forearm", 0.045),
            ("forearm", "hand", 0.035),
            ("thigh", "shin", 0.07),
            ("shin", "foot", 0.045),
        )
    ),
)


def make_take(frames: int, kind: str, seed: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Markers (T, M, 3), normals, and ends of limbs (T, S, 2, 3)."""
    bodies = MarkerBodies(seed)
    phenotype = bodies.model.sample_phenotypes(1)[0]
    base = bodies.model.skeleton(phenotype)
    clip = MotionSampler(base, bodies.rng).sample(frames / FPS, FPS, kind)
    root = clip.root - [*clip.root[:, :2].mean(0), 0]
    body = bodies.skeleton(phenotype)
    points, normals = bodies.markers(body, clip.rotvec, root)
    columns = list(PLUG_IN_GAIT.surface_indices)
    _, origins = forward(body, turn(clip.rotvec), root)
    joints = origins[:, bones_of(body.bones)[0]]
    limbs = np.stack([joints[:, [NAMES.index(a), NAMES.index(b)]] for a, b, _ in LIMBS], 1)
    return points[:, columns], normals[:, columns], limbs


def score(found: np.ndarray, truth: np.ndarray, views: np.ndarray) -> str:
    """Score unnamed or named points against the truth."""
    errors, ghosts = [], 0
    hit, there = np.zeros(2), np.zeros(2)
    for t in range(len(truth)):
        here = found[t][np.isfinite(found[t, :, 0])]
        gap = np.linalg.norm(here[:, None] - truth[t][None], axis=-1)
        nearest = gap.min(1, initial=9.0)
        ghosts += int((nearest > 0.01).sum())
        errors.append(nearest[nearest <= 0.01])
        for k, least in enumerate((2, 3)):
            seen = views[t] >= least
            there[k] += seen.sum()
            hit[k] += (gap.min(0, initial=9.0)[seen] < 0.005).sum()
    rms = 1e3 * float(np.sqrt(np.mean(np.concatenate(errors) ** 2)))
    share = hit / there
    return (f"{rms:.2f} mm RMS; found {share[0]:.2%} of those that 2 cameras see, {share[1]:.2%} of 3; "
            f"{100 * ghosts / len(truth):.2f} ghosts in 100 frames")  # fmt: skip


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--frames", type=int, default=240)
    parser.add_argument("--kind", default="dance")
    parser.add_argument("--seed", type=int, default=5)
    parser.add_argument("--session", type=Path, default=None)
    options = parser.parse_args()
    rng = np.random.default_rng(options.seed)
    cameras, faults = ring_of_cameras(6), VideoFaults()
    truth, normals, limbs = make_take(options.frames, options.kind, options.seed)
    radii = np.array([r for _, _, r in LIMBS])
    lamps = rng.uniform([-3, -3, 2.2], [3, 3, 3], (faults.lamps, 3))
    sight = [markers_in_sight(cameras, truth[t], normals[t], limbs[t], radii) for t in range(len(truth))]
    views = np.array([s.sum(0) for s in sight])
    print(f"{views.mean():.1f} cameras see a marker; {(views < 2).mean():.2%} of markers are seen by fewer than two")
    place = ExitStack()
    writers = [place.enter_context(writer) for writer in _writers(options.session, cameras)]
    thresholds: list[float] = []
    seen = []
    for t in range(len(truth)):
        images = [draw_markers(c, truth[t, sight[t][k]], lamps, faults, rng) for k, c in enumerate(cameras)]
        for write, image in zip(writers, images, strict=False):
            write(np.repeat(image[..., None], 3, axis=2))
        thresholds = thresholds or [find_threshold([i]) for i in images]
        seen.append([find_blobs(i, h) for i, h in zip(images, thresholds, strict=True)])
    begun = time.process_time()
    print("blobs a camera:", round(float(np.mean([[len(s) for s in f] for f in seen])), 1))
    found = find_markers(cameras, seen, FPS, MarkerVideoOptions())
    print(f"unnamed: {score(found.points, truth, views)}; {time.process_time() - begun:.1f} s")
    from muybridge.infer.labelling.label import label_points
    from muybridge.infer.networks.labelling import LabelNetwork
    from muybridge.models.shipped import shipped_model

    labelled = label_points(found.points, FPS, PLUG_IN_GAIT, LabelNetwork(shipped_model("labels")))
    named(labelled.points, truth, views, "named")
    again, _ = triangulate_again(cameras, seen, labelled.points)
    named(again, truth, views, "named, triangulated again")
    place.close()
    if options.session:
        _run(options.session, truth, views)


def named(points: np.ndarray, truth: np.ndarray, views: np.ndarray, title: str) -> None:
    gap = np.linalg.norm(points - truth, axis=-1)
    there = np.isfinite(gap)
    right = gap < 0.01
    visible = views >= 2
    rms = 1e3 * float(np.sqrt(np.mean(gap[right] ** 2)))
    print(f"{title}: {right[there].mean():.2%} of the names right, {right[visible].mean():.2%} of visible markers "
          f"named rightly, {rms:.2f} mm RMS")  # fmt: skip


def _writers(folder: Path | None, cameras: CameraGroup) -> list:
    """Writers of the cameras' videos into a session folder; none without a folder."""
    if folder is None:
        return []
    (folder / "videos").mkdir(parents=True, exist_ok=True)
    save_calibration(cameras, folder / "calibration.toml")
    return [video_writer(folder / "videos" / f"{c.name}.mp4", (c.width, c.height), FPS, crf=14) for c in cameras]


def _run(folder: Path, truth: np.ndarray, views: np.ndarray) -> None:
    import subprocess
    import sys

    from muybridge.motion.formats.points.c3d import read_c3d

    begun = time.perf_counter()
    command = [sys.executable, "-m", "muybridge", "run-markers", str(folder), "--overwrite"]
    subprocess.run(command, check=True)
    points = read_c3d(folder / "muybridge" / "points.c3d").points_world
    named(points[: len(truth)], truth, views, f"muybridge run ({time.perf_counter() - begun:.0f} s), gaps filled")


if __name__ == "__main__":
    main()
