"""Diagnosis: the faulty camera is identified for each kind of fault, and a healthy rig has none."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from muybridge.geometry.calibration import load_calibration
from muybridge.geometry.calibration.diagnosis.faults import diagnose
from muybridge.geometry.calibration.diagnosis.findings import CalibrationDiagnosis, DiagnosisOptions
from muybridge.geometry.calibration.diagnosis.hypotheses import fit_camera, perturb_camera
from muybridge.geometry.calibration.people.calibrate import refine_people
from muybridge.geometry.cameras.camera import Camera
from muybridge.geometry.cameras.group import CameraGroup
from muybridge.geometry.cameras.video_size import fit_to_video
from muybridge.geometry.numerics.robust import extent, student_scale
from tests.rigs import rig_around_a_walk

Landmarks = tuple[np.ndarray, np.ndarray]
Fault = Callable[[CameraGroup, Landmarks, int], tuple[CameraGroup, Landmarks, set[int]]]

# Half a standing person, metres: x to the side, z up.
_HALF = np.array([(0.18, 0, 1.41), (0.24, 0, 1.11), (0.26, 0.05, 0.86), (0.11, 0, 0.91), (0.11, 0.02, 0.49),
                  (0.11, 0, 0.07), (0.11, -0.05, 0.03), (0.13, 0.17, 0.02)])  # fmt: skip


def _walk(frames: int) -> np.ndarray:
    """(T, 16, 3) a person at 60 frames per second who walks about and swings the arms."""
    body = np.concatenate([_HALF, _HALF * [-1, 1, 1]])
    out = np.empty((frames, 16, 3))
    for t in range(frames):
        angle = 2 * np.pi * t / 300
        posed = body.copy()
        for side in (0, 8):
            swing = Rotation.from_euler("x", (1 if side else -1) * 0.8 * np.sin(6 * angle)).as_matrix()
            posed[side + 1 : side + 3] = posed[side] + (posed[side + 1 : side + 3] - posed[side]) @ swing.T
        place = np.array([1.2 * np.sin(angle), np.sin(2 * angle), 0])
        out[t] = posed @ Rotation.from_euler("z", 2 * angle).as_matrix().T + place
    return out


def _seen(cameras: CameraGroup, seed: int, frames: int = 80) -> Landmarks:
    """What a 2D network makes of it: an error per landmark and camera that stays (3 px), one that drifts (2 px),
    one of each frame (2 px), wrong points, missing points and stretches."""
    rng = np.random.default_rng(seed)
    world = _walk(frames)
    px = cameras.project(world)
    px += rng.normal(0, 3.0, (len(cameras), 1, 16, 2)) + rng.normal(0, 2.0, px.shape)
    knots = rng.normal(0, 2.0, (len(cameras), frames // 10 + 2, 16, 2))
    at = np.arange(frames) / 10
    share = (at - np.floor(at))[None, :, None, None]
    px += knots[:, at.astype(int)] * (1 - share) + knots[:, at.astype(int) + 1] * share
    wrong = rng.random(px.shape[:-1]) < 0.03
    px[wrong] += rng.normal(0, 60.0, (int(wrong.sum()), 2))
    px[rng.random(px.shape[:-1]) < 0.08] = np.nan
    for c in range(len(cameras)):
        px[c, (first := int(rng.integers(frames))) : first + 8] = np.nan
    return px, np.where(np.isfinite(px[..., 0]), 9.0 * rng.uniform(0.5, 2, px.shape[:-1]), np.nan)


def _with(cameras: CameraGroup, c: int, camera: Camera) -> CameraGroup:
    return CameraGroup(tuple(camera if k == c else other for k, other in enumerate(cameras)))


def _turned(cameras: CameraGroup, seen: Landmarks, c: int) -> tuple[CameraGroup, Landmarks, set[int]]:
    axis = np.random.default_rng(c).normal(size=3)
    by = np.radians(1.0) * axis / np.linalg.norm(axis)
    return _with(cameras, c, perturb_camera(cameras[c], np.array([*by, 0, 0, 0, 0]))), seen, {c}


def _shifted(cameras: CameraGroup, seen: Landmarks, c: int) -> tuple[CameraGroup, Landmarks, set[int]]:
    px, variance = seen[0].copy(), seen[1].copy()
    by = 3 if c % 2 else -3
    for array in (px, variance):
        array[c] = np.roll(array[c], by, axis=0)
        array[c, slice(0, by) if by > 0 else slice(by, None)] = np.nan
    return cameras, (px, variance), {c}


def _zoomed(cameras: CameraGroup, seen: Landmarks, c: int) -> tuple[CameraGroup, Landmarks, set[int]]:
    by = np.log(1.03 if c % 2 else 0.97)
    return _with(cameras, c, perturb_camera(cameras[c], np.array([0, 0, 0, 0, 0, 0, by]))), seen, {c}


def _swapped(cameras: CameraGroup, seen: Landmarks, c: int) -> tuple[CameraGroup, Landmarks, set[int]]:
    order = list(range(len(cameras)))
    other = (c + 1 + c % 2) % len(cameras)
    order[c], order[other] = other, c
    return cameras, (seen[0][order], seen[1][order]), {c, other}


_FAULTS: dict[str, Fault] = {"turned": _turned, "shifted": _shifted, "focal": _zoomed, "swapped": _swapped}


def _blames(report: CalibrationDiagnosis, kind: str, diagnosis: set[int]) -> None:
    """The right camera, of the right fault, alone, first in the order and in the sentence."""
    assert len(report.faults) == 1, report.sentence
    fault = report.faults[0]
    assert {report.names.index(n) for n in fault.cameras} == diagnosis, report.sentence
    assert fault.kind == kind or kind in fault.also, report.sentence
    assert set(report.order[: len(diagnosis)]) == diagnosis
    assert report.probability[list(diagnosis)].min() > 0.95
    assert all(name in report.sentence for name in fault.cameras)
    assert report.corrected_px < report.noise_px


@pytest.mark.parametrize("kind", _FAULTS)
@pytest.mark.parametrize("count", [4, pytest.param(6, marks=pytest.mark.slow), pytest.param(8, marks=pytest.mark.slow)])
def test_the_faulty_camera_is_identified(kind: str, count: int) -> None:
    for seed in range(1 if count == 4 else 2):
        c = (seed + count // 2 + len(kind)) % count
        rig = rig_around_a_walk(count)
        cameras, seen, diagnosis = _FAULTS[kind](rig, _seen(rig, 10 * count + seed), c)
        report = diagnose(cameras, *seen)
        _blames(report, kind, diagnosis)
        size = report.faults[0].amount
        if kind == "turned":
            assert size == pytest.approx(1.0, abs=0.25)
        if kind == "shifted":
            assert size == pytest.approx(3 if c % 2 else -3, abs=0.4)
            assert ("late" if c % 2 else "early") in report.sentence
        if kind == "focal":
            assert size == pytest.approx(0.03 if c % 2 else -0.03, abs=0.012)


@pytest.mark.parametrize("count", [3, 4, pytest.param(8, marks=pytest.mark.slow)])
def test_a_healthy_rig_has_no_faults(count: int) -> None:
    rig = rig_around_a_walk(count)
    report = diagnose(rig, *_seen(rig, 200 + count))
    assert report.faults == () and report.probability.max() < 0.95
    assert "All cameras agree" in report.sentence


@pytest.mark.slow
@pytest.mark.parametrize(("share", "blamed"), [(0.0095, False), (0.03, True)])
def test_network_bias_is_no_fault_of_a_camera(share: float, blamed: bool) -> None:
    """2D points that fit within half a pixel, all of one camera's a little too far to the right: a network errs by a
    hundredth of the person too, and always in the same way."""
    rig, rng = rig_around_a_walk(4), np.random.default_rng(5)
    px = rig.project(_walk(80))
    px += rng.normal(0, 0.5, px.shape)
    size = float(np.median((px[2].max(axis=1) - px[2].min(axis=1)).max(axis=-1)))
    px[2, ..., 0] += share * size
    report = diagnose(rig, px, np.full(px.shape[:-1], 0.25))
    assert bool(report.faults) == blamed, report.sentence
    if blamed:
        assert report.faults[0].cameras == (rig.names[2],)


def test_a_video_of_another_take_is_identified() -> None:
    rig = rig_around_a_walk(5)
    px, variance = _seen(rig, 5)
    later, late = _seen(rig, 6, frames=240)
    px[3], variance[3] = later[3, 150:230], late[3, 150:230]
    report = diagnose(rig, px, variance)
    assert [f.cameras for f in report.faults] == [("cam4",)]
    assert report.order[0] == 3


def test_tolerance_grows_with_the_size_of_the_person() -> None:
    cameras = CameraGroup(tuple(replace(c, params=(2400, 2400, 960, 540)) for c in rig_around_a_walk(4).cameras))
    px, variance = _seen(cameras, 3)
    px[1] += np.random.default_rng(3).normal(0, 75.0, px[1].shape)
    person = np.nanmedian(extent(px[1]))
    assert 75 * 1.18 > DiagnosisOptions().unrelated * 1920 and person > 700
    report = diagnose(cameras, px, variance)
    assert not [f for f in report.faults if f.kind == "unrelated"], report.sentence


@pytest.mark.parametrize("order", [(1, 2, 0, 3), (3, 2, 1, 0), (2, 0, 3, 1)])
def test_permuted_files_are_all_identified(order: tuple[int, ...]) -> None:
    rig = rig_around_a_walk(4)
    px, variance = _seen(rig, 9)
    report = diagnose(rig, px[list(order)], variance[list(order)])
    assert [f.kind for f in report.faults] == ["swapped"], report.sentence
    assert tuple(order[k] for k in report.files) == (0, 1, 2, 3)
    assert report.faults[0].cameras == tuple(n for k, n in enumerate(rig.names) if order[k] != k)
    assert f"cam1 has that of {rig.names[order.index(0)]}" in report.sentence


@pytest.mark.slow
def test_two_faults_are_found_one_after_the_other() -> None:
    rig = rig_around_a_walk(6)
    cameras, seen, _ = _turned(rig, _seen(rig, 7), 1)
    cameras, seen, _ = _shifted(cameras, seen, 4)
    report = diagnose(cameras, *seen)
    assert {(f.kind, f.cameras[0]) for f in report.faults} == {("turned", "cam2"), ("shifted", "cam5")}
    assert set(report.order[:2]) == {1, 4}


def test_undetermined_cases_have_a_note() -> None:
    rig = rig_around_a_walk(4)
    px, variance = _seen(rig, 8)
    two = CameraGroup(rig.cameras[:2])
    report = diagnose(two, px[:2], variance[:2])
    assert report.faults == () and "two cameras" in report.sentence
    px[:, 5:] = np.nan
    assert "frames" in diagnose(rig, px, variance).sentence
    with pytest.raises(ValueError, match="variance_px2"):
        diagnose(rig, px, variance[:, 1:])


def test_camera_fit_is_robust_to_wrong_points() -> None:
    rng = np.random.default_rng(9)
    truth = rig_around_a_walk(4)[0]
    world = _walk(40).reshape(-1, 3)
    px = truth.project(world) + rng.normal(0, 1.0, (len(world), 2))
    px[::7] += rng.normal(0, 90.0, px[::7].shape)
    off = np.array([0.02, -0.01, 0.015, 0.05, -0.04, 0.03, 0.0])
    fit = fit_camera(perturb_camera(truth, off), world, px, np.ones(len(world)), np.arange(7) < 6)
    assert fit is not None
    assert np.abs(fit.camera.cam_from_world - truth.cam_from_world)[:, :3].max() < 2e-3
    assert np.linalg.norm(fit.camera.center_world - truth.center_world) < 5 * np.linalg.norm(fit.sd[3:6]) < 0.1
    assert student_scale((rng.standard_t(3, (20000, 2)) ** 2).sum(1) * 4) == pytest.approx(2.0, rel=0.2)


@pytest.fixture(scope="module")
def people_refined(real_data: Path) -> tuple[CameraGroup, CameraGroup, Landmarks]:
    """The real rig as its maker calibrated it and as the person refines it, and the reference's landmarks."""
    folder = real_data / "balancing"
    stored = np.load(folder / "reference" / "openpose_body25b.npz")
    score = stored["keypoints2d_px"][..., 2]
    px = np.where((score > 0.3)[..., None], stored["keypoints2d_px"][..., :2], np.nan)
    variance = np.where(score > 0.3, 1 / np.maximum(score, 0.3) ** 2, np.nan)
    cameras = load_calibration(folder / "calibration" / "Calib.qca.txt")
    fitted = [fit_to_video(c, 1080, 1920, "letterbox")[0] if k < 2 else c for k, c in enumerate(cameras)]
    given = CameraGroup(tuple(fitted))
    return given, refine_people(given, px, variance, [str(n) for n in stored["names"]]).cameras, (px, variance)


@pytest.mark.parametrize("kind", [*(pytest.param(k, marks=pytest.mark.slow) for k in _FAULTS), "healthy"])
def test_the_realrig_around_a_walk(people_refined: tuple[CameraGroup, CameraGroup, Landmarks], kind: str) -> None:
    _, cameras, seen = people_refined
    if kind == "healthy":
        assert diagnose(cameras, *seen).faults == ()
        return
    wrong, landmarks, diagnosis = _FAULTS[kind](cameras, seen, len(kind) % 4)
    _blames(diagnose(wrong, *landmarks), kind, diagnosis)


def test_the_real_calibration_has_a_rotated_camera(
    people_refined: tuple[CameraGroup, CameraGroup, Landmarks],
) -> None:
    """Its maker's poses are off by one to two degrees: refined from the person, the third camera turns most."""
    given, refined, seen = people_refined
    turns = [Rotation.from_matrix(a.rotation @ b.rotation.T).magnitude() for a, b in zip(given, refined, strict=True)]
    report = diagnose(given, *seen, replace(DiagnosisOptions(), max_faults=1))
    assert report.faults[0].kind in ("turned", "moved") and report.faults[0].cameras == (given.names[2],)
    assert 0.5 < report.faults[0].turn_deg < 2.5 and max(turns) > np.radians(0.3)
