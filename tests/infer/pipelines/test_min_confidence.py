"""Landmarks that all cameras have and none is sure of."""

import numpy as np
import pytest

from muybridge.geometry.calibration import load_calibration
from muybridge.geometry.landmarks.arrays import Keypoints2D, Points3D
from muybridge.geometry.landmarks.marker_sets import SURFACE
from muybridge.geometry.landmarks.sets import BODY23
from muybridge.infer.demo_take.take import demo_folder, true_points
from muybridge.infer.reconstruction.body_motion import fill_from_body
from muybridge.infer.reconstruction.landmarks import SolveOptions, solve
from muybridge.infer.reconstruction.person_stages import confident
from muybridge.infer.reconstruction.quality import assess, unsure_landmarks
from muybridge.infer.runtime.progress import Progress
from muybridge.infer.runtime.stages import StageStore

FRAMES = 30
WRIST, TWIN = BODY23.index("left_wrist"), BODY23.index("right_wrist")


@pytest.fixture(scope="module")
def walk():
    """The demo's cameras and its person's landmarks as they are, (C, T, 1, J, 2)."""
    folder = demo_folder()
    cameras = load_calibration(folder / "calibration.toml")
    truth, names = true_points(folder)
    world = truth[:FRAMES, [names.index(name) for name in BODY23.names]]
    return cameras, world, cameras.project(world)[:, :, None]


def solved(walk, score, folder, **options):
    folder.mkdir(exist_ok=True)
    cameras, _, px = walk
    known = np.isfinite(px).all(-1)
    keypoints = Keypoints2D(BODY23, px, np.where(known, 1.0, np.nan), np.where(known, score[:, :, None], 0.0))
    with Progress(quiet=True) as progress:
        return solve(cameras, {"body23": keypoints}, 25.0, "", StageStore(folder), SolveOptions(**options), progress)


def test_landmarks_of_low_confidence_are_left_out_and_reported(walk, tmp_path):
    cameras, world, px = walk
    score = np.ones(px.shape[:2] + px.shape[3:4])
    score[:, :20, WRIST] = 0.3
    solution = solved(walk, score, tmp_path)
    assert np.isnan(solution.measured.points_world[:20, WRIST]).all()
    assert np.isnan(solution.points.points_world[:20, WRIST]).all()
    assert not solution.measured.inlier[:, :20, WRIST].any()
    # Nothing else is.
    assert solution.unsure.sum() == 20 and solution.unsure[:20, WRIST].all()
    there = np.isfinite(solution.points.points_world).all(-1)
    assert there.sum() == there.size - 20
    assert np.nanmedian(np.linalg.norm(solution.points.points_world - world, axis=-1)) < 0.01
    (said,) = unsure_landmarks(solution)
    assert "left wrist" in said and "right" not in said and "67%" in said
    assert assess(cameras, solution).landmarks["left_wrist"]["coverage"] == pytest.approx(1 / 3)


def test_guesses_are_kept_on_request_or_with_one_confident_camera(walk, tmp_path):
    _, world, px = walk
    score = np.full(px.shape[:2] + px.shape[3:4], 0.3)
    everything = solved(walk, score, tmp_path / "all", min_confidence=0.0)
    assert np.isfinite(everything.points.points_world).all() and unsure_landmarks(everything) == []
    score[1] = 0.6
    assert np.isfinite(solved(walk, score, tmp_path / "one").points.points_world).all()


def test_a_minimum_confidence_is_between_0_and_1():
    with pytest.raises(ValueError, match="min_confidence is 5"):
        SolveOptions(min_confidence=5)


def test_short_gaps_of_confidence_are_filled_from_the_body(walk, tmp_path):
    _, world, px = walk
    score = np.ones(px.shape[:2] + px.shape[3:4])
    score[:, 10:16, WRIST] = 0.3
    solution = solved(walk, score, tmp_path)
    assert np.isnan(solution.measured.points_world[10:16, WRIST]).all()
    away = np.linalg.norm(solution.points.points_world[10:16, WRIST] - world[10:16, WRIST], axis=-1)
    assert away.max() < 0.1 and unsure_landmarks(solution) == []


def test_flipped_landmarks_keep_their_own_confidence():
    score = np.ones((2, 1, len(BODY23)))
    score[:, 0, WRIST] = 0.2
    flipped = np.zeros(score.shape, bool)
    flipped[:, 0, [WRIST, TWIN]] = True
    sure = confident(score, flipped, BODY23, 0.5)
    assert sure[0, WRIST] and not sure[0, TWIN] and sure.sum() == len(BODY23) - 1


def test_gaps_are_filled_from_the_body_only_where_it_is_known():
    frames = 4
    truth = np.random.default_rng(0).normal(size=(frames, 23, 3))
    seen = truth.copy()
    seen[1, 9] = np.nan  # one wrist in an else well known frame
    seen[2, 4:] = np.nan  # hardly anything is known
    covariance = np.broadcast_to(np.eye(3) * 1e-4, (frames, 23, 3, 3))
    none = np.zeros((2, frames, 23))
    points = Points3D(BODY23, seen, covariance, none, none.astype(bool), 25.0)
    sure = np.ones((frames, 23), bool)
    body = {"landmarks_world": truth + 0.01, "landmark_sigma": np.full(23, 0.03)}
    filled = fill_from_body(points, points, sure, body, 0.5)
    np.testing.assert_array_equal(filled.points_world[1, 9], truth[1, 9] + 0.01)
    np.testing.assert_allclose(filled.covariance_world[1, 9], np.eye(3) * 9e-4)
    assert np.isnan(filled.points_world[2, 4:]).all()
    np.testing.assert_array_equal(filled.points_world[[0, 3]], truth[[0, 3]])
    assert np.isnan(fill_from_body(points, points, sure, body, 1.1).points_world[1, 9]).all()
    # Knees that are never seen are not made up; a heel that is not is where its toes say.
    knee, heel = BODY23.index("left_knee"), BODY23.index("left_heel")
    seen[:, [knee, heel]] = np.nan
    filled = fill_from_body(points, points, sure, body, 0.5)
    assert np.isnan(filled.points_world[:, knee]).all() and np.isfinite(filled.points_world[[0, 1, 3], heel]).all()
    # What no camera is sure of, most of the time, is not.
    sure[:3, 9] = False
    assert np.isnan(fill_from_body(points, points, sure, body, 0.5).points_world[1, 9]).all()


def test_frames_without_people_do_not_count_for_confidence():
    truth = np.random.default_rng(0).normal(size=(30, 23, 3))
    sure = np.zeros((30, 23), bool)
    sure[:10] = True  # then the person leaves
    sure[4, 9] = False
    seen = np.where(sure[..., None], truth, np.nan)
    none = np.zeros((2, 30, 23))
    points = Points3D(BODY23, seen, np.full((30, 23, 3, 3), np.nan), none, none.astype(bool), 25.0)
    body = {"landmarks_world": truth, "landmark_sigma": np.full(23, 0.03)}
    filled = fill_from_body(points, points, sure, body, 0.5).points_world
    np.testing.assert_array_equal(filled[:10], truth[:10])
    assert np.isnan(filled[10:]).all()


def test_markers_of_low_confidence_are_left_out(walk, tmp_path):
    cameras, world, px = walk
    marks = np.repeat(px[..., :1, :], len(SURFACE), axis=-2) + 0.1 * np.arange(len(SURFACE))[:, None]
    score = np.ones(marks.shape[:-1])
    crown = SURFACE.index("crown")
    score[:, 5:, 0, crown] = 0.2
    known = np.isfinite(px).all(-1)
    body = Keypoints2D(BODY23, px, np.where(known, 1.0, np.nan), known.astype(float))
    keypoints = {"body23": body, "surface": Keypoints2D(SURFACE, marks, np.ones(score.shape), score)}
    with Progress(quiet=True) as progress:
        solution = solve(cameras, keypoints, 25.0, "", StageStore(tmp_path), SolveOptions(), progress)
    there = np.isfinite(solution.markers.points_world).all(-1)
    assert not there[5:, crown].any() and there[:5, crown].all()
    assert np.delete(there, crown, axis=1).all()
