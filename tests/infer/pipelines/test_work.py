"""A run's work per image: seconds depend on the machine, counts do not, so that a run cannot get slower unnoticed."""

from muybridge.infer.pipelines.videos import RunOptions, run_session
from muybridge.infer.runtime.progress import Progress
from scripts.benchmarks.takes.work_counts import counted
from tests.conftest import first_frames_of_demo


def test_a_run_does_no_more_work_per_image_than_it_did_and_a_second_one_none(tmp_path):
    session = first_frames_of_demo(tmp_path / "take", 24)
    with counted() as counts, Progress(quiet=True) as progress:
        run_session(session, tmp_path / "results", RunOptions(), progress)
    images = 24 * 4
    assert counts["decode"].rows <= 3 * images
    assert counts["encode"].rows == images
    assert images / 8 <= counts["people"].rows <= images
    assert images <= counts["keypoints"].rows <= 4 * images
    # In batches: a crop alone takes longer than one in a batch.
    assert counts["keypoints"].rows >= 4 * counts["keypoints"].calls
    with counted() as again, Progress(quiet=True) as progress:
        run_session(session, tmp_path / "results", RunOptions(), progress)
    assert not again.tallies
