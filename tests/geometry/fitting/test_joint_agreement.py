"""Joints of the fitted body against true centres: people of plain anatomy, and a laboratory's own model."""

from pathlib import Path

import numpy as np
import pytest

from muybridge.geometry.fitting.marker_fit import fit_markers
from muybridge.geometry.fitting.subject import MarkerFitOptions
from muybridge.geometry.landmarks.marker_sets import PLUG_IN_GAIT
from muybridge.geometry.numerics.rotations import matrix_from_quat, swing_twist_from_matrix
from muybridge.geometry.skeleton.joint_centres import USUAL, centres_from_markers
from muybridge.geometry.skeleton.motion import Motion
from muybridge.infer.pipelines.solve_points import SolvePointsOptions, solve_points
from muybridge.infer.runtime.progress import Progress
from muybridge.motion.formats.registry import read_file
from muybridge.train.synthesis.markers.anatomical import AnatomicalPerson, AnatomicalTake, anatomical_take
from tests.paths import DATA

LEG, ARM = ("thigh", "shin", "foot"), ("upper_arm", "forearm", "hand")
COLUMNS = np.array(PLUG_IN_GAIT.surface_indices)
MOST_MM = {"thigh": 20, "shin": 20, "foot": 15, "upper_arm": 20, "forearm": 15, "hand": 10}
PEOPLE = {
    "adult": AnatomicalPerson(),
    "child": AnatomicalPerson(1.35, 1.05, 0.15, 0.2, examiner=0.003),
    "stout, wide range": AnatomicalPerson(1.7, 1.1, elbow=(0.1, 2.2)),
}


def flexion_deg(above: np.ndarray, joint: np.ndarray, below: np.ndarray) -> np.ndarray:
    first, second = joint - above, below - joint
    cosine = np.sum(first * second, -1) / np.linalg.norm(first, axis=-1) / np.linalg.norm(second, axis=-1)
    return np.degrees(np.arccos(np.clip(cosine, -1, 1)))


def hinge_deg(motion: Motion, joint: str) -> np.ndarray:
    """(T,) the angle about the hinge that files of joint angles have, degrees; flexion is positive."""
    k, elbow = motion.skeleton.index(joint), joint.endswith("forearm")
    axis = motion.skeleton.twist_axis[k]
    angle = swing_twist_from_matrix(matrix_from_quat(motion.quat_wxyz[:, k]), axis)[:, 2 if elbow else 0]
    return np.asarray(np.degrees(-angle if joint == "left_forearm" else angle))


def joints_of(motion: Motion) -> dict[str, np.ndarray]:
    return dict(zip(motion.skeleton.names, np.moveaxis(motion.joint_positions_world(), 1, 0), strict=True))


@pytest.fixture(scope="module", params=list(PEOPLE))
def fitted(request: pytest.FixtureRequest) -> tuple[AnatomicalTake, Motion]:
    take = anatomical_take(PEOPLE[request.param], np.random.default_rng(6), 60)
    centres = centres_from_markers(take.points, take.index, USUAL)
    return take, fit_markers(take.points, COLUMNS, take.fps, MarkerFitOptions(calibration_frames=30), centres).motion


def test_joints_are_where_they_truly_are(fitted: tuple[AnatomicalTake, Motion]) -> None:
    take, motion = fitted
    joints = joints_of(motion)
    for side in ("left", "right"):
        for joint, most in MOST_MM.items():
            off = np.linalg.norm(joints[f"{side}_{joint}"] - take.centres[f"{side}_{joint}"], axis=-1)
            assert 1e3 * np.median(off) < most, f"{side} {joint}"


def test_knees_and_elbows_flex_as_they_truly_do(fitted: tuple[AnatomicalTake, Motion]) -> None:
    take, motion = fitted
    joints = joints_of(motion)
    for side in ("left", "right"):
        for part in (LEG, ARM):
            true = flexion_deg(*(take.centres[f"{side}_{j}"] for j in part))
            off = flexion_deg(*(joints[f"{side}_{j}"] for j in part)) - true
            assert np.median(np.abs(off)) < 5, f"{side} {part[1]}"
            # The hinge's own angle lacks what the forearm deviates outward.
            hinge = hinge_deg(motion, f"{side}_{part[1]}")
            assert (hinge[true > 20] > 0).all(), f"{side} {part[1]} is hyperextended"
            assert np.median(np.abs(hinge - true)[true > 30]) < 8


def test_asked_for_centres_keep_the_flexion() -> None:
    take = anatomical_take(PEOPLE["adult"], np.random.default_rng(8), 60)
    for asked in (("plane",), ("bell",)):
        centres = centres_from_markers(take.points, take.index, (*asked, *USUAL))
        options = MarkerFitOptions(calibration_frames=30)
        joints = joints_of(fit_markers(take.points, COLUMNS, take.fps, options, centres).motion)
        for side in ("left", "right"):
            for part in (LEG, ARM):
                off = flexion_deg(*(joints[f"{side}_{j}"] for j in part)) - flexion_deg(
                    *(take.centres[f"{side}_{j}"] for j in part)
                )
                assert np.median(np.abs(off)) < 5, f"{asked} {side} {part[1]}"


@pytest.mark.slow
@pytest.mark.parametrize("centres", [(), ("plane",), ("bell", "midpoint")])
def test_a_laboratorys_walk_is_solved_with_its_own_joints(tmp_path: Path, centres: tuple[str, ...]) -> None:
    path = DATA / "markers" / "walk_force_plates.c3d"
    if not path.exists():
        pytest.skip("no shared data")
    options = SolvePointsOptions(centres=centres)  # type: ignore[arg-type]
    joints = joints_of(solve_points(path, tmp_path / "out", options, False, Progress(quiet=True)).body.motion)
    take = read_file(path).positions
    at = {n: take.points_world[:, i] for i, n in enumerate(take.landmarks.names)}
    for side in ("left", "right"):
        own = {j: at[f"{side[0].upper()}{n}"] for j, n in zip(LEG, ("FEP", "KJC", "AJC"), strict=True)}
        flexion = flexion_deg(*(joints[f"{side}_{j}"] for j in LEG)) - flexion_deg(*own.values())
        assert np.median(np.abs(flexion)) < 5
        if not centres:
            off = [1e3 * np.median(np.linalg.norm(joints[f"{side}_{j}"] - own[j], axis=-1)) for j in LEG]
            assert off[0] < 20 and off[1] < 20 and off[2] < 12


@pytest.mark.slow
def test_a_servers_elbows_bend_as_the_markers_show(tmp_path: Path) -> None:
    path = DATA / "markers" / "tennis_serve_pig39.c3d"
    if not path.exists():
        pytest.skip("no shared data")
    result = solve_points(path, tmp_path / "out", SolvePointsOptions(), False, Progress(quiet=True))
    joints, motion = joints_of(result.body.motion), result.body.motion
    points = read_file(path).positions.points_world
    for side in ("left", "right"):
        at = {n: points[:, result.recognised.columns[f"{side}_{n}"]]
              for n in ("acromion", "elbow_lateral", "radial_styloid", "ulnar_styloid")}  # fmt: skip
        seen = flexion_deg(at["acromion"], at["elbow_lateral"], (at["radial_styloid"] + at["ulnar_styloid"]) / 2)
        solved = flexion_deg(*(joints[f"{side}_{j}"] for j in ARM))
        assert np.nanmedian(np.abs(solved - seen)) < 5
        assert (hinge_deg(motion, f"{side}_forearm")[seen > 20] > 0).all()
