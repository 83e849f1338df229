"""Cameras from people: refined from a calibration, found from nothing, with standard deviations that hold."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from muybridge.errors import CalibrationError
from muybridge.geometry.calibration import load_calibration
from muybridge.geometry.calibration.bundle_adjustment.with_bones import (
    ArticulatedProblem,
    ArticulatedState,
    adjust_articulated,
)
from muybridge.geometry.calibration.people.calibrate import (
    PeopleCalibrationOptions,
    bone_pairs,
    calibrate_people,
    refine_people,
)
from muybridge.geometry.cameras.group import CameraGroup
from muybridge.geometry.cameras.video_size import fit_to_video
from muybridge.geometry.triangulation.multiview import triangulate
from muybridge.geometry.triangulation.validation import leave_one_out_error
from tests.paths import SHARED
from tests.rigs import rig_around_a_walk

NAMES = tuple(
    f"{side}_{part}"
    for part in ("shoulder", "elbow", "wrist", "hip", "knee", "ankle", "heel", "big_toe")
    for side in ("left", "right")
)

# A standing person of 1.72 m: x to the side, y forward, z up; one side.
_BODY = {
    "shoulder": (0.18, 0, 1.407), "elbow": (0.24, 0, 1.11), "wrist": (0.26, 0.05, 0.86), "hip": (0.11, 0, 0.912),
    "knee": (0.11, 0.02, 0.491), "ankle": (0.11, 0, 0.07), "heel": (0.11, -0.05, 0.03),
    "big_toe": (0.13, 0.17, 0.02),
}  # fmt: skip


def _walk(frames: int) -> np.ndarray:
    """(T, 16, 3) a person who walks a figure of eight and swings the arms; bones keep their lengths."""
    at = np.linspace(0, 2 * np.pi, frames)
    body = np.array([(s * _BODY[n.split("_", 1)[1]][0], *_BODY[n.split("_", 1)[1]][1:])
                     for n, s in ((n, 1 if n.startswith("right") else -1) for n in NAMES)])  # fmt: skip
    out = np.empty((frames, len(NAMES), 3))
    for t, angle in enumerate(at):
        posed = body.copy()
        for k, side in enumerate(("left", "right")):
            swing = Rotation.from_euler("x", (-1) ** k * 0.8 * np.sin(6 * angle)).as_matrix()
            top = posed[NAMES.index(f"{side}_shoulder")]
            for part in ("elbow", "wrist"):
                j = NAMES.index(f"{side}_{part}")
                posed[j] = top + swing @ (posed[j] - top)
        place = np.array([1.2 * np.sin(angle), 1.0 * np.sin(2 * angle), 0])
        out[t] = posed @ Rotation.from_euler("z", 2 * angle).as_matrix().T + place
    return out


def _observed(cameras: CameraGroup, world: np.ndarray, seed: int) -> tuple[np.ndarray, np.ndarray]:
    """Noise of 3 px, one point in twenty off by 60 px, one in ten missing."""
    rng = np.random.default_rng(seed)
    px = cameras.project(world) + rng.normal(0, 3.0, (len(cameras), *world.shape[:2], 2))
    wrong = rng.random(px.shape[:-1]) < 0.05
    px[wrong] += rng.normal(0, 60.0, (int(wrong.sum()), 2))
    px[rng.random(px.shape[:-1]) < 0.1] = np.nan
    return px, np.where(np.isfinite(px[..., 0]), 9.0, np.nan)


def _apart(a: CameraGroup, b: CameraGroup) -> tuple[np.ndarray, np.ndarray]:
    """(C,) degrees and (C,) metres between rigs, after the similarity that brings a onto b."""
    turn = Rotation.from_matrix(np.stack([y.rotation.T @ x.rotation for x, y in zip(a, b, strict=True)])).mean()
    one, two = a.centers_world - a.centers_world.mean(0), b.centers_world - b.centers_world.mean(0)
    moved = turn.apply(one)
    scale = (moved * two).sum() / (one**2).sum()
    rest = [Rotation.from_matrix(y.rotation.T @ x.rotation) * turn.inv() for x, y in zip(a, b, strict=True)]
    degrees = np.array([np.degrees(r.magnitude()) for r in rest])
    return degrees, np.linalg.norm(scale * moved - two, axis=1)


def test_a_rig_from_nothing_in_metres_on_its_floor() -> None:
    truth, world = rig_around_a_walk(5), _walk(60)
    px, variance = _observed(truth, world, 1)
    blank = CameraGroup(tuple(c.posed(np.eye(3, 4)) for c in truth))
    found = calibrate_people(blank, px, variance, NAMES, PeopleCalibrationOptions(height=1.72))
    degrees, metres = _apart(found.cameras, truth)
    assert degrees.max() < 0.3 and metres.max() < 0.02
    # The size is the person's, up is up, and the floor is at zero.
    spread = np.linalg.norm(found.cameras.centers_world - found.cameras.centers_world.mean(0), axis=1)
    wanted = np.linalg.norm(truth.centers_world - truth.centers_world.mean(0), axis=1)
    np.testing.assert_allclose(spread, wanted, rtol=0.04)
    np.testing.assert_allclose(found.cameras.centers_world[:, 2], truth.centers_world[:, 2], atol=0.12)
    assert any("up:" in n for n in found.notes)


def test_a_wrong_focal_length_is_found() -> None:
    truth, world = rig_around_a_walk(4), _walk(60)
    px, variance = _observed(truth, world, 2)
    cameras = list(truth)
    cameras[1] = replace(cameras[1], params=(1260, 1260, 960, 540))
    wrong = CameraGroup(tuple(cameras))
    found = calibrate_people(wrong, px, variance, NAMES, PeopleCalibrationOptions(height=1.72, focal_sigma=0.1))
    focal = np.array([c.params[0] for c in found.cameras])
    np.testing.assert_allclose(focal, 1200, rtol=0.02)
    assert (np.abs(focal / 1200 - 1) < 4 * found.focal_sd + 1e-3).all()


def test_what_a_short_take_cannot_tell_of_a_lens_stays_as_it_was_given() -> None:
    """Errors that stay in every frame, as 2D networks make them, must not outweigh what is known of the lenses."""
    truth, world = rig_around_a_walk(4), _walk(200)[:30]
    rng = np.random.default_rng(8)
    px = truth.project(world) + rng.normal(0, 5.0, (4, 1, len(NAMES), 2)) + rng.normal(0, 1.0, (4, 30, len(NAMES), 2))
    variance = np.full(px.shape[:-1], 9.0)
    blank = CameraGroup(tuple(c.posed(np.eye(3, 4)) for c in truth))
    off = []
    for sigma in (0.02, 0.3):
        options = PeopleCalibrationOptions(height=1.72, focal_sigma=sigma)
        found = calibrate_people(blank, px, variance, NAMES, options)
        off.append(np.abs([c.params[0] / 1200 - 1 for c in found.cameras]).max())
    assert off[0] < 0.025 < off[1]


def test_refinement_mends_turned_cameras_and_keeps_the_world() -> None:
    truth, world = rig_around_a_walk(4), _walk(40)
    px, variance = _observed(truth, world, 3)
    rng = np.random.default_rng(4)
    shaken = []
    for camera in truth:
        rotation = Rotation.from_rotvec(np.radians(rng.normal(0, 1.0, 3))).as_matrix() @ camera.rotation
        center = camera.center_world + rng.normal(0, 0.02, 3)
        shaken.append(camera.posed(np.concatenate([rotation, -(rotation @ center)[:, None]], axis=1)))
    before = CameraGroup(tuple(shaken))
    found = refine_people(before, px, variance, NAMES)
    assert _apart(found.cameras, truth)[0].max() < 0.25 < _apart(before, truth)[0].max()
    assert _apart(found.cameras, truth)[1].max() < 0.02
    assert np.linalg.norm(found.cameras.centers_world - before.centers_world, axis=1).max() < 0.12
    assert 2.0 < found.noise_px < 4.5


@pytest.mark.slow
def test_standard_deviations_are_those_of_repeated_takes() -> None:
    truth, world = rig_around_a_walk(4), _walk(40)
    offs, known = [], []
    for seed in range(6):
        px, variance = _observed(truth, world, 10 + seed)
        found = refine_people(truth, px, variance, NAMES)
        offs.append(_apart(found.cameras, truth)[0])
        known.append(np.linalg.norm(found.rotation_sd_deg, axis=1))
    ratio = np.sqrt(np.mean(np.square(offs))) / np.sqrt(np.mean(np.square(known)))
    assert 0.3 < ratio < 1.5


def test_the_jacobians_are_the_derivatives() -> None:
    """From a start at the truth without noise, nothing moves; from one beside it, all comes back exactly."""
    truth, world = rig_around_a_walk(3), _walk(12)
    px = truth.project(world)
    bones, sigma = bone_pairs(NAMES)
    lengths = np.linalg.norm(world[0, bones[:, 0]] - world[0, bones[:, 1]], axis=-1)
    problem = ArticulatedProblem(
        truth.unproject(px), np.full(3, 1200.0), np.full(px.shape[:-1], 1.0), bones, sigma, focal_sigma=1.0
    )
    rng = np.random.default_rng(5)
    start = ArticulatedState(
        Rotation.from_rotvec(rng.normal(0, 0.01, (3, 3))).as_matrix() @ truth.cam_from_world[:, :, :3],
        truth.centers_world + rng.normal(0, 0.03, (3, 3)), np.full(3, 0.01),
        world + rng.normal(0, 0.02, world.shape), lengths * 1.02,
    )  # fmt: skip
    done = adjust_articulated(problem, start, 40, 1e-12)
    assert np.nanmax(done.residual_px) < 0.3


def test_cameras_that_share_nobody_are_named() -> None:
    truth, world = rig_around_a_walk(3), _walk(20)
    px, variance = _observed(truth, world, 6)
    px[2], variance[2] = np.nan, np.nan
    with pytest.raises(CalibrationError, match="cam3"):
        calibrate_people(truth, px, variance, NAMES)
    with pytest.raises(ValueError, match="height"):
        PeopleCalibrationOptions(height=172)


@pytest.fixture(scope="module")
def balancing() -> tuple[CameraGroup, np.ndarray, np.ndarray, list[str]]:
    folder = SHARED / "data" / "balancing"
    if not folder.is_dir():
        pytest.skip("no real recordings beside the checkout (../shared/data)")
    stored = np.load(folder / "reference" / "openpose_body25b.npz")
    score = stored["keypoints2d_px"][..., 2]
    seen = score > 0.3
    px = np.where(seen[..., None], stored["keypoints2d_px"][..., :2], np.nan)
    variance = np.where(seen, 1 / np.maximum(score, 0.3) ** 2, np.nan)
    cameras = load_calibration(folder / "calibration" / "Calib.qca.txt")
    fitted = [fit_to_video(c, 1080, 1920, "letterbox")[0] if k < 2 else c for k, c in enumerate(cameras)]
    return CameraGroup(tuple(fitted)), px, variance, [str(n) for n in stored["names"]]


def test_the_real_rig_from_nothing(balancing: tuple[CameraGroup, np.ndarray, np.ndarray, list[str]]) -> None:
    cameras, px, variance, names = balancing
    blank = CameraGroup(tuple(c.posed(np.eye(3, 4)) for c in cameras))
    found = calibrate_people(blank, px[:, ::2], variance[:, ::2], names)
    degrees, metres = _apart(found.cameras, cameras)
    assert degrees.max() < 2.5 and metres.max() < 0.15
    pairs = [(i, j) for i in range(4) for j in range(i)]
    between = [
        Rotation.from_matrix(
            (cameras[i].rotation @ cameras[j].rotation.T).T @ found.cameras[i].rotation @ found.cameras[j].rotation.T
        )
        for i, j in pairs
    ]
    assert max(np.degrees(r.magnitude()) for r in between) < 2.5


def test_the_real_rig_refined_on_one_half_holds_on_the_other(
    balancing: tuple[CameraGroup, np.ndarray, np.ndarray, list[str]],
) -> None:
    cameras, px, variance, names = balancing
    halves = [slice(0, 50), slice(50, 100)]
    found = [refine_people(cameras, px[:, h], variance[:, h], names) for h in halves]
    for result, other in zip(found, halves[::-1], strict=True):
        error = triangulate(result.cameras, px[:, other], variance[:, other]).residual_px
        left_out = leave_one_out_error(result.cameras, px[:, other], variance[:, other])
        assert np.nanmedian(error) < 7.5
        assert np.nanmedian(left_out) < 14.5
    degrees, metres = _apart(found[0].cameras, found[1].cameras)
    sd_deg = np.sqrt(sum((r.rotation_sd_deg**2).sum(axis=1) for r in found))
    sd = np.sqrt(sum((r.center_sd**2).sum(axis=1) for r in found))
    assert (degrees < 2 * sd_deg).all() and (metres < 2 * sd).all()
