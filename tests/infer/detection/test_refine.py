"""People whom one camera missed are found where the other cameras know them to be."""

import shutil
from pathlib import Path

import numpy as np
import pytest

from muybridge.geometry.landmarks.arrays import Points3D
from muybridge.geometry.landmarks.sets import BODY23
from muybridge.infer.detection.detect import (
    CameraResult,
    DetectOptions,
    file_names,
    first_pass,
    is_finished,
)
from muybridge.infer.detection.orientation import FrameOrientation, Letterbox
from muybridge.infer.detection.refine import RefinementOptions, TopDownRefinement, missing_views
from muybridge.infer.detection.tracks import CameraTracks, LandmarkArrays, by_name
from muybridge.infer.networks.keypoints import Expectation, KeypointNetwork
from muybridge.infer.networks.models import open_models
from muybridge.infer.runtime.progress import Progress
from muybridge.infer.runtime.stages import StageResult, StageStore
from muybridge.infer.session.session import SessionOptions, open_session, with_frames
from muybridge.infer.session.video import read_chunks
from muybridge.models.keypoints.decode import decode_heatmaps, with_expectation
from muybridge.models.shipped import shipped_model
from muybridge.models.uncertainty import SpreadCalibration

LOST = np.arange(10, 14)


@pytest.fixture
def demo(repository: Path, tmp_path: Path):
    """The demo's session and its true landmarks, every camera following the person but the second, who loses them."""
    take = tmp_path / "take"
    shutil.copytree(repository / "infer" / "demo_take", take)
    session = with_frames(open_session(take, SessionOptions()), 60)
    with np.load(take / "truth.npz") as truth:
        columns = [list(truth["names"]).index(n) for n in BODY23.names]
        world = truth["points_world"][: session.frames, columns]
    frames, cameras = len(world), len(session.cameras)
    slots = np.zeros((cameras, frames), np.int64)
    slots[1, LOST] = -1
    pixels = session.cameras.project(world)
    residual = np.where(slots[..., None] < 0, np.nan, np.zeros(pixels.shape[:-1]))
    covariance = np.broadcast_to(1e-4 * np.eye(3), (*world.shape, 3))
    points = Points3D(BODY23, world, covariance, residual, slots[..., None] + np.zeros(23) >= 0, session.fps)
    return session, points, slots, pixels


def look(demo, folder: Path, hung: float | None = None, **options: float) -> TopDownRefinement:
    """`hung`: the first look knew the background, and the cameras turned by this angle, radians."""
    options = {"everywhere": False, **options}
    session, _, slots, pixels = demo
    detected = []
    for c in range(len(pixels)):
        px = np.where(slots[c, :, None, None] < 0, np.nan, pixels[c])[:, None]
        known = np.isfinite(px).all(-1)
        body = LandmarkArrays(BODY23, px, np.where(known, 1.0, np.nan), known * 0.9, known * 0.9)
        tracks = CameraTracks(by_name([body]), np.full((len(px), 1, 4), np.nan), np.where(known.any(-1), 0, -1))
        upright = FrameOrientation(session.cameras[c].width, session.cameras[c].height, hung or 0.0)
        facts = {"frames_width_height_angle_and_long_side": [upright.width, upright.height, upright.angle, 320]}
        arrays = {name: np.zeros(tracks.frames, dtype=bool) for name in ("repeats", "unreadable")}
        if hung is not None:
            frames = next(iter(read_chunks(session.videos[c])))
            arrays["plate"] = Letterbox(upright, 320).apply(frames[-1])
        stage = StageResult(arrays, facts, 0.0, False, f"camera {c}")
        detected.append(CameraResult(tracks, folder / "none.mp4", stage))
    folder.mkdir(exist_ok=True)
    return TopDownRefinement(
        session, detected, session.cameras.names, open_models(DetectOptions()), StageStore(folder), DetectOptions(),
        RefinementOptions(**options), Progress(quiet=True),
    )  # fmt: skip


def test_the_background_is_that_of_the_cameras_before_they_were_refined(demo, tmp_path):
    """Its picture is of another size where a refined camera hangs otherwise."""
    _, points, slots, pixels = demo
    again = look(demo, tmp_path / "work", hung=0.1)(slots, points)
    seen = again.keypoints["body23"].points_px[1, LOST, 1]
    side = np.ptp(pixels[1, LOST], axis=1).max()
    assert np.median(np.linalg.norm(seen - pixels[1, LOST], axis=-1)) < 0.03 * side


def test_a_lost_person_is_found_again(demo, tmp_path):
    _, points, slots, pixels = demo
    again = look(demo, tmp_path / "work")(slots, points)
    found = again.slots[1, LOST]
    assert (found == 1).all() and (again.slots[0] == 0).all()
    seen = again.keypoints["body23"].points_px[1, LOST, 1]
    side = np.ptp(pixels[1, LOST], axis=1).max()
    # By the picture, not by the prediction: near, and yet never the same.
    away = np.linalg.norm(seen - pixels[1, LOST], axis=-1)
    assert 0 < np.median(away) < 0.03 * side
    assert again.keypoints["body23"].score[1, :10, 1].max() == 0
    # What was found is kept for a run that resumes.
    twice = look(demo, tmp_path / "work")(slots, points)
    assert all(stage.resumed for stage in twice.stages.values())
    np.testing.assert_array_equal(twice.keypoints["body23"].points_px, again.keypoints["body23"].points_px)


def test_no_person_is_added_where_the_prediction_is_wrong(demo, tmp_path):
    session, points, slots, _ = demo
    world = points.points_world.copy()
    world[LOST] += 1.5 * session.cameras[1].rotation[0]  # a metre and a half beside the person
    wrong = Points3D(BODY23, world, points.covariance_world, points.residual_px, points.inlier, points.fps)
    again = look(demo, tmp_path / "work")(slots, wrong)
    assert again is None or (again.slots[1, LOST] == -1).all()


def test_only_views_that_should_see_the_person_are_read(demo, tmp_path):
    session, points, slots, _ = demo
    expected = np.zeros(slots.shape, bool)
    expected[1, LOST] = True
    np.testing.assert_array_equal(missing_views(session, slots, points, RefinementOptions()), expected)
    behind = points.points_world + 20 * session.cameras[1].rotation[0]  # out of its picture
    away = Points3D(BODY23, behind, points.covariance_world, points.residual_px, points.inlier, points.fps)
    assert not missing_views(session, slots, away, RefinementOptions())[1].any()
    # Somebody else's landmarks in a view are as good as none.
    stranger = points.inlier.copy()
    stranger[2, 5] = False
    other = Points3D(BODY23, points.points_world, points.covariance_world, points.residual_px, stranger, points.fps)
    assert missing_views(session, slots, other, RefinementOptions())[2, 5]


def test_every_view_is_read_again_where_the_person_is(demo, tmp_path):
    _, points, slots, pixels = demo
    again = look(demo, tmp_path / "work", everywhere=True)(slots, points)
    assert (again.slots == 1).all()
    side = np.ptp(pixels, axis=2).max(-1)
    for found in (again.keypoints["body23"], again.alone):
        away = np.linalg.norm(found.points_px[:, :, 1] - pixels, axis=-1) / side[..., None]
        assert np.nanmedian(away) < 0.02
    # What is expected decides where a view alone is of two minds, and hardly moves what it is sure of.
    error = {k: np.linalg.norm(f.points_px[:, :, 1] - pixels, axis=-1) / side[..., None]
             for k, f in (("told", again.keypoints["body23"]), ("alone", again.alone))}  # fmt: skip
    assert np.nanpercentile(error["told"], 99) < 0.8 * np.nanpercentile(error["alone"], 99)
    moved = np.linalg.norm(again.keypoints["body23"].points_px[:, :, 1] - again.alone.points_px[:, :, 1], axis=-1)
    assert np.nanmedian(moved / side[..., None]) < 0.003
    untold = look(demo, tmp_path / "other", everywhere=True, expected_most=0)(slots, points)
    np.testing.assert_array_equal(untold.keypoints["body23"].points_px, untold.alone.points_px)


def test_an_uninformative_view_does_not_return_the_prior():
    logits = np.zeros((1, 2, 48, 48), np.float32)
    logits[0, 1, 10, 10], logits[0, 1, 30, 30] = 6.0, 7.0
    expected = np.array([[[41.5, 41.5], [41.5, 41.5]]])
    told = with_expectation(logits, 4, expected, 15.0, 2.0)
    spread = SpreadCalibration()
    np.testing.assert_allclose(decode_heatmaps(told, 4, spread).points_crop_px[0, 1], [41.5, 41.5], atol=2)
    np.testing.assert_allclose(decode_heatmaps(logits, 4, spread).points_crop_px[0, 1], [121.5, 121.5], atol=2)
    nothing = with_expectation(logits, 4, np.full((1, 2, 2), np.nan), 15.0, 2.0)
    np.testing.assert_array_equal(nothing, logits)
    # A hypothesis that is surer than what the expectation can say stays.
    logits[0, 1, 30, 30] = 9.0
    kept = decode_heatmaps(with_expectation(logits, 4, expected, 15.0, 2.0), 4, spread)
    np.testing.assert_allclose(kept.points_crop_px[0, 1], [121.5, 121.5], atol=2)


def test_an_even_map_stays_unknown(demo, tmp_path):
    network = KeypointNetwork(shipped_model("keypoints"))
    side = network.crop_size
    blank = np.full((1, side, side, 3), 127, np.uint8)
    expected = Expectation(np.full((1, 23, 2), side / 2), 0.08, 4.0)
    alone, told = network.locate(blank), network.locate(blank, expected)
    np.testing.assert_array_equal(np.isnan(alone.found.points_crop_px), np.isnan(told.found.points_crop_px))
    assert np.isnan(alone.found.points_crop_px).any()


def test_refinement_can_be_disabled(demo, tmp_path):
    _, points, slots, _ = demo
    assert look(demo, tmp_path / "work", enabled=False)(slots, points) is None


def test_other_commands_reuse_the_landmarks_of_a_run(make_session, staged, staged_people) -> None:
    take = make_session(frames=12, width=160, height=120)
    assert staged("run", take, "--quiet").returncode == 0
    session, options = open_session(take), DetectOptions()
    store = StageStore(take / "muybridge" / "work")
    names, models = file_names(session.cameras.names), staged_people.staged_models(options)
    # A run that reads every view again reads it once at first, whatever is asked.
    assert is_finished(session, names, models, store, first_pass(options))
    assert not is_finished(session, names, models, store, options)
    (store.folder / "landmarks-cam2.npz").unlink()
    assert not is_finished(session, names, models, store, first_pass(options))
