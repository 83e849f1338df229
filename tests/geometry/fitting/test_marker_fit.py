"""The body fitted to skin markers: people of the statistical body in smooth motion, their markers spoiled."""

import json
from pathlib import Path

import numpy as np
import pytest

from muybridge.errors import MuybridgeError
from muybridge.geometry.fitting.marker_fit import fit_markers
from muybridge.geometry.fitting.subject import MarkerFitOptions, calibrate_person, follow_take, settle_frames
from muybridge.geometry.landmarks.arrays import Points3D
from muybridge.geometry.landmarks.marker_sets import PLUG_IN_GAIT, SURFACE
from muybridge.geometry.landmarks.sets import LandmarkSet
from muybridge.geometry.numerics.rotations import exp_so3, matrix_from_quat
from muybridge.geometry.skeleton.body import BODY
from muybridge.geometry.skeleton.joint_centres import JointCentres
from muybridge.geometry.skeleton.statistical_body import marker_body, without_rolls
from muybridge.infer.commands.app import run_command
from muybridge.motion.formats.points.c3d import write_c3d
from muybridge.train.correction.takes import MarkerFaults, add_faults

FPS = 60.0
QUICK = MarkerFitOptions(calibration_frames=40)


def staged(seed: int, frames: int = 120) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Markers (T, 72, 3), world rotations and places of BODY's joints of a person who moves within his limits."""
    rng, table = np.random.default_rng(seed), marker_body()
    vector = table.mean + rng.normal(0, 0.7, len(table.basis)) @ table.basis
    offsets, places, _ = table.parts(vector)
    skeleton = table.skeleton(offsets)
    time = np.arange(frames)[:, None, None] / FPS
    swing = np.sin(2 * np.pi * rng.uniform(0.2, 0.7, table.rest.shape) * time + rng.uniform(0, 6, table.rest.shape))
    reach = np.minimum(np.minimum(table.upper - table.rest, table.rest - table.lower), np.radians(35))
    angles = table.rest + 0.7 * np.maximum(reach, 0) * swing
    angles[:, 0] = 0
    rotations = skeleton.rotations_from_angles(angles)
    rotations[:, 0] = exp_so3(np.stack([0.1 * swing[:, 0, 0], 0.1 * swing[:, 0, 1], time[:, 0, 0] + 1], -1))
    root = np.stack([0.5 * time[:, 0, 0], 0.1 * swing[:, 0, 2], 0.95 + 0.03 * swing[:, 0, 1]], -1)
    turns, at = skeleton.forward(root, rotations)
    jitter = rng.normal(0, 0.3, (len(SURFACE), 3)) * table.tolerance[:, None]
    carrier = table.carrier
    markers = at[:, carrier] + np.einsum("tmij,mj->tmi", turns[:, carrier], places + jitter)
    plain, local = without_rolls(skeleton, rotations)
    return markers, *plain.forward(root, local)


def errors(turns: np.ndarray, places: np.ndarray, truth: tuple[np.ndarray, np.ndarray]) -> tuple[float, float]:
    """Mean position error in millimetres and rotation error in degrees."""
    trace = np.einsum("tjik,tjik->tj", turns, truth[0])
    angle = np.degrees(np.arccos(np.clip((trace - 1) / 2, -1, 1)))
    return 1e3 * float(np.linalg.norm(places - truth[1], axis=-1).mean()), float(angle.mean())


def solved(points: np.ndarray, columns: np.ndarray, **more: object) -> tuple[np.ndarray, np.ndarray]:
    motion = fit_markers(points, columns, FPS, QUICK, **more).motion  # type: ignore[arg-type]
    return motion.skeleton.forward(motion.root_positions_world, matrix_from_quat(motion.quat_wxyz))


@pytest.fixture(scope="module")
def spoiled() -> tuple[np.ndarray, np.ndarray, tuple[np.ndarray, np.ndarray]]:
    markers, turns, places = staged(1)
    columns = np.array(PLUG_IN_GAIT.surface_indices)
    points, _ = add_faults(markers[:, columns], FPS, MarkerFaults(hidden=0.2), np.random.default_rng(2))
    return points, columns, (turns, places)


def test_hidden_and_shifted_markers_hardly_matter(
    spoiled: tuple[np.ndarray, np.ndarray, tuple[np.ndarray, np.ndarray]],
) -> None:
    points, columns, truth = spoiled
    person = calibrate_person(points, columns, FPS, QUICK)
    plain = settle_frames(person, points, follow_take(person, points, FPS, QUICK), QUICK, robust=False)
    rotations = person.skeleton.rotations_from_angles(plain.angles)
    rotations[:, 0] = plain.turn
    skeleton, rotations = without_rolls(person.skeleton, rotations)
    before = errors(*skeleton.forward(plain.root, rotations), truth)
    after = errors(*solved(points, columns, person=person), truth)
    # Every joint moves at random here, also those that no marker tells alone (collar bones, the spine's middle).
    assert after[0] < 8.0 and after[1] < 6.5
    assert after[0] < 0.9 * before[0] and after[1] < 0.9 * before[1]


def test_given_joint_centres_count(spoiled: tuple[np.ndarray, np.ndarray, tuple[np.ndarray, np.ndarray]]) -> None:
    points, columns, truth = spoiled
    hips = [BODY.joint_names.index(f"{s}_thigh") for s in ("left", "right")]
    given = JointCentres(("left_thigh", "right_thigh"), truth[1][:, hips], np.full(2, 0.002))
    with_them = solved(points, columns, centres=given)[1]
    alone = solved(points, columns)[1]

    def off(places: np.ndarray) -> float:
        return float(np.linalg.norm(places[:, hips] - truth[1][:, hips], axis=-1).mean())

    assert off(with_them) < 0.003
    assert off(with_them) < 0.7 * off(alone)


def test_a_lower_body_set_is_solved_too() -> None:
    markers, turns, places = staged(3, 60)
    legs = ("asis", "psis", "thigh_distal", "knee_lateral", "shank_distal", "malleolus_lateral", "heel", "toe")
    columns = np.array([i for i, n in enumerate(SURFACE.names) if n.endswith(legs)])
    motion = fit_markers(markers[:, columns], columns, FPS, QUICK).motion
    below = [i for i, n in enumerate(BODY.joint_names) if n.endswith(("thigh", "shin", "foot"))]
    found = motion.joint_positions_world()[:, below]
    assert np.linalg.norm(found - places[:, below], axis=-1).mean() < 0.025
    assert np.isfinite(motion.quat_wxyz).all()


def test_too_few_markers_is_an_error() -> None:
    points = np.full((10, 39, 3), np.nan)
    points[:, :5] = 1.0
    with pytest.raises(MuybridgeError, match="at least 6"):
        fit_markers(points, np.array(PLUG_IN_GAIT.surface_indices), FPS)


def test_solve_takes_the_markers_and_says_so(tmp_path: Path) -> None:
    markers, turns, places = staged(4, 40)
    xyz = markers[:, list(PLUG_IN_GAIT.surface_indices)]
    unknown = np.full((*xyz.shape, 3), np.nan)
    none = np.empty((0, *xyz.shape[:2]))
    write_c3d(tmp_path / "m.c3d", Points3D(LandmarkSet("m", PLUG_IN_GAIT.labels, ()), xyz, unknown, none,
                                           none.astype(bool), FPS))  # fmt: skip
    out = tmp_path / "out"
    assert run_command(["solve", str(tmp_path / "m.c3d"), "--out", str(out), "--centres", "harrington"]) == 0
    facts = json.loads((out / "run.json").read_text())["body"]
    assert facts["method"] == "markers" and facts["joint_centres"] == ["harrington"]
    assert facts["residual_mm"]["median"] < 6
    assert facts["network"] is None, "centres that were asked for are not corrected unasked"
    assert {"motion.bvh", "motion.mot", "landmarks.trc"} <= {p.name for p in out.iterdir()}
    said, bones = [], []
    for more in (["--centres", "body"], ["--centres", "body", "--no-correct"]):
        here = tmp_path / f"out{len(said)}"
        assert run_command(["solve", str(tmp_path / "m.c3d"), "--out", str(here), *more]) == 0
        facts = json.loads((here / "run.json").read_text())["body"]
        said.append(facts["network"])
        bones.append(list(facts["bone_lengths_m"].values()))
    assert said[0] and said[1] is None
    # The network's bones are others, and not by more than skin and placement explain.
    assert 0.0005 < np.abs(np.subtract(*bones)).max() < 0.04
