"""The up direction where the calibration does not state it, estimated from parts of the take in advance.

The cameras' orientations give a first guess; standing people give a better one. They are detected with the first
guess, which is good enough for standing people, and then the whole take is read with upright cameras.
"""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from muybridge.arrays import FloatArray, IndexArray
from muybridge.geometry.association.select import find_people, take_person
from muybridge.geometry.calibration.gravity import all_upside_down, level_cameras, standing_axes, tilt_notes
from muybridge.geometry.landmarks.arrays import Keypoints2D
from muybridge.geometry.triangulation.multiview import triangulate
from muybridge.infer.detection.detect import CODE, DetectOptions, detect
from muybridge.infer.detection.tracks import first_frames, merge_tracks
from muybridge.infer.networks.models import Models
from muybridge.infer.runtime.digests import code_digest, digest
from muybridge.infer.runtime.progress import Progress
from muybridge.infer.runtime.stages import StageStore
from muybridge.infer.session.session import UPRIGHT_ADVICE, Session, with_frames, with_notice

STAGE = "gravity"
# Three windows of two seconds, at this many frames per second, in the first half minute: videos are decoded from their
# beginning, and people mostly stand there.
_WINDOWS, _SECONDS, _FPS, _WITHIN = 3, 2.0, 12.0, 30.0


def estimate_gravity(
    session: Session, file_names: Sequence[str], models: Models, store: StageStore, options: DetectOptions,
    progress: Progress, turn: bool = False,
) -> Session:  # fmt: skip
    """The session with `upright` cameras, where its calibration's Z axis does not seem to be up, or may point down.

    Args:
        session: C cameras and their videos.
        file_names: (C,) the cameras' names as file names.
        models: the networks.
        store: where finished stages are.
        options: how 2D landmarks are detected.
        progress: receives progress messages.
        turn: replace the session's cameras, so that results are in the upright world.
    """
    in_doubt = session.level_cameras is session.cameras
    if in_doubt and not all_upside_down(session.cameras):
        return session
    videos = [[v.content, v.rotation_deg] for v in session.videos]
    key = digest(
        STAGE, videos, session.frame_indices, session.fps, session.cameras.cameras, options.keypoints, models.metadata,
        code_digest(*CODE, "muybridge.infer.reconstruction"),
    )  # fmt: skip
    stage = store.load(STAGE, key)
    if stage is None:
        start = time.perf_counter()
        frames, fps = _windows(session.frames, session.fps)
        part = replace(with_frames(session, frames), fps=fps)
        (store.folder / STAGE).mkdir(exist_ok=True)
        doubt = "may point down" if in_doubt else "is not up"
        progress.say(f"the calibration's Z axis {doubt}: detecting standing people in parts of the take")
        found = detect(part, file_names, models, StageStore(store.folder / STAGE), options, progress)
        shared = min(result.tracks.frames for result in found)  # a video may end before its header says
        merged = merge_tracks([first_frames(result.tracks, shared) for result in found])
        axes = _axes(part, next(iter(merged.values())))
        stage = store.save(STAGE, key, {"standing": axes}, {}, time.perf_counter() - start)
    upright = level_cameras(session.cameras, stage.arrays["standing"])
    notices: list[str] = []
    if upright is session.cameras:
        if not in_doubt:
            notices = ["standing people show that the calibration's Z axis is up; the cameras are tilted"]
    elif turn:
        notices = ["the world was turned upright: results and the calibration beside them have Z up"]
    elif in_doubt:
        notices = [f"{note}; {UPRIGHT_ADVICE}" for note in tilt_notes(session.cameras, stage.arrays["standing"])]
    for notice in notices:
        session = with_notice(session, notice, progress)
    return replace(session, cameras=upright if turn else session.cameras, upright=upright)


def _windows(frames: int, fps: float) -> tuple[IndexArray, float]:
    """The frames to read, and how many per second."""
    step = max(1, round(fps / _FPS))
    every = np.arange(0, min(frames, max(1, round(_WITHIN * fps))), step)
    length = round(_SECONDS * fps / step)
    if len(every) <= _WINDOWS * length:
        return every, fps / step
    begin = np.linspace(0, len(every) - length, _WINDOWS + 2).round().astype(int)[1:-1]
    return np.concatenate([every[b : b + length] for b in begin]), fps / step


def _axes(session: Session, keypoints: Keypoints2D) -> FloatArray:
    """(N, 3) directions from feet to shoulders of everybody seen by two cameras, where they are stretched out."""
    axes = [np.empty((0, 3))]
    frames = keypoints.points_px.shape[1]
    for person in find_people(session.cameras, keypoints, fps=session.fps) if frames else ():
        if person.rank > 0:
            points, variance, _ = take_person(keypoints, person)
            world = triangulate(session.cameras, points, variance).points_world
            axes.append(standing_axes(world, keypoints.landmarks))
    return np.concatenate(axes)
