"""A run's work per image: seconds depend on the machine, counts do not, so that a run cannot get slower unnoticed."""

from pathlib import Path

import numpy as np

from muybridge.infer.pipelines.videos import RunOptions, run_session
from muybridge.infer.runtime.progress import Progress
from muybridge.infer.session.probe import probe_video
from muybridge.infer.session.video import read_chunks
from scripts.assets.write_video import video_writer
from scripts.benchmarks.takes.work_counts import counted
from tests.conftest import first_frames_of_demo


def test_a_run_does_no_more_work_per_image_than_it_did_and_a_second_one_none(tmp_path):
    session = first_frames_of_demo(tmp_path / "take", 24)
    with counted() as counts, Progress(quiet=True) as progress:
        run_session(session, tmp_path / "results", RunOptions(), progress)
    images = 24 * 4
    # Small videos have no smaller copies, and are decoded for each pass and for the overlay.
    assert counts["decode"].rows <= 3 * images
    assert counts["overlay"].rows == images
    assert images / 8 <= counts["people"].rows <= 0.6 * images
    assert images <= counts["keypoints"].rows <= 2.9 * images
    # In batches: a crop alone takes longer than one in a batch.
    assert counts["keypoints"].rows >= 4 * counts["keypoints"].calls
    with counted() as again, Progress(quiet=True) as progress:
        run_session(session, tmp_path / "results", RunOptions(), progress)
    assert not again.tallies


def test_large_videos_are_not_decoded_for_the_overlay(tmp_path):
    session = first_frames_of_demo(tmp_path / "take", 8)
    for video in (session / "videos").iterdir():
        _enlarge(video)
    with counted() as counts, Progress(quiet=True) as progress:
        run_session(session, tmp_path / "results", RunOptions(), progress)
    assert counts["overlay"].rows == 8 * 4
    # For either pass at most, and the first frame of each when the session is opened.
    assert counts["decode"].rows <= (2 * 8 + 1) * 4


def _enlarge(video: Path) -> None:
    """Make a video of 640 x 480 pixels one of 1920 x 1440."""
    info = probe_video(video)
    frames = [frame for chunk in read_chunks(info) for frame in chunk]
    with video_writer(video, (3 * info.width, 3 * info.height), info.fps) as write:
        for frame in frames:
            write(np.repeat(np.repeat(frame, 3, axis=0), 3, axis=1))
