"""2D landmarks of a session: detected, or read from its results folder."""

from pathlib import Path

from muybridge.errors import MuybridgeError
from muybridge.geometry.landmarks.arrays import Keypoints2D
from muybridge.geometry.sync.clocks import resample_keypoints
from muybridge.infer.detection.detect import DetectOptions, damage_notices, detect, file_names, first_pass, is_finished
from muybridge.infer.detection.resample import resample_tracks
from muybridge.infer.detection.tracks import merge_tracks
from muybridge.infer.networks.models import open_models
from muybridge.infer.reconstruction.gravity import estimate_gravity
from muybridge.infer.results.folder import open_output
from muybridge.infer.results.names import DEFAULT_OUT
from muybridge.infer.runtime.progress import Progress
from muybridge.infer.runtime.stages import StageStore
from muybridge.infer.session.session import Session, with_notice


def session_keypoints(
    session: Session, results: Path | None, options: DetectOptions, progress: Progress
) -> tuple[Session, Keypoints2D]:
    """Everyone's synchronised 2D landmarks of a session, from a results folder where they are already there.

    Args:
        session: its cameras and videos.
        results: results folder of a run; None for the session's own.
        options: how landmarks are detected.
        progress: receives progress messages.

    Raises:
        OutputError: the folder cannot be made, or cannot take results.
    """
    inputs = [session.calibration, *(v.path for v in session.videos)]
    folder = open_output(results or session.path / DEFAULT_OUT, (), inputs).work
    models, store, names = open_models(options), StageStore(folder), file_names(session.cameras.names)
    first = first_pass(options)  # as in a run
    session = estimate_gravity(session, names, models, store, first, progress)
    options = first if is_finished(session, names, models, store, first) else options
    found = detect(session, names, models, store, options, progress)
    for notice in damage_notices(session, found):
        session = with_notice(session, notice, progress)
    frames = min(d.tracks.frames for d in found)
    if frames < session.frames:
        raise MuybridgeError(
            f"{session.path}: a video has fewer frames than its header suggests; run `muybridge run` to see which"
        )
    body = next(
        iter(merge_tracks([resample_tracks(session, c, d.tracks, d.repeats) for c, d in enumerate(found)]).values())
    )
    return session, resample_keypoints(body, session.clocks, session.fps)
