"""The commands convert, solve and compare, run for real."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from muybridge.geometry.landmarks.arrays import Points3D
from muybridge.geometry.landmarks.marker_sets import PLUG_IN_GAIT
from muybridge.geometry.landmarks.sets import BODY23, LandmarkSet
from muybridge.geometry.numerics.rotations import exp_so3, quat_from_matrix
from muybridge.geometry.skeleton.aliases import body_landmark, map_body, map_surface
from muybridge.geometry.skeleton.body import BODY, prior_shape
from muybridge.geometry.skeleton.motion import Motion
from muybridge.infer.commands.app import run_command
from muybridge.infer.pipelines.compare import compare_points
from muybridge.motion.formats.gltf.read import read_gltf
from muybridge.motion.formats.points.c3d import Analog, C3DTake, Event, read_c3d_take, write_c3d
from muybridge.motion.formats.points.csv import write_csv
from muybridge.motion.formats.points.trc import read_trc, write_trc
from muybridge.motion.formats.registry import read_file, readable, writable
from muybridge.motion.formats.skeletal.bvh import read_bvh, write_bvh
from muybridge.motion.take import points_of_motion
from tests.paths import DATA

SHAPE = prior_shape(1.74)


def make_motion(frames: int = 24) -> Motion:
    """Someone who walks on the spot, arms down."""
    skeleton = BODY.skeleton(SHAPE)
    vectors = np.zeros((frames, len(skeleton), 3))
    swing = 0.5 * np.sin(np.linspace(0, 2 * np.pi, frames))
    for side, sign in (("left", 1.0), ("right", -1.0)):
        vectors[:, skeleton.index(f"{side}_upper_arm"), 1] = sign * 1.3
        vectors[:, skeleton.index(f"{side}_thigh"), 0] = sign * swing - 0.2
        vectors[:, skeleton.index(f"{side}_shin"), 0] = 0.4 + sign * 0.3 * swing
        vectors[:, skeleton.index(f"{side}_forearm"), 2] = -sign * 0.5
    root = np.tile([0.3, -0.2, 0.95], (frames, 1))
    return Motion(skeleton, 60.0, root, quat_from_matrix(exp_so3(vectors)))


def make_points(noise: float = 0.004) -> Points3D:
    motion = make_motion()
    world = motion.forward()
    joint, offset = BODY.landmark_joints, BODY.landmark_offsets(SHAPE)
    world = world[:, joint]
    xyz = np.einsum("tlij,lj->tli", world[..., :3, :3], offset) + world[..., :3, 3]
    order = [BODY.landmark_names.index(n) for n in BODY23.names]
    xyz = xyz[:, order] + np.random.default_rng(0).normal(0, noise, (len(xyz), len(order), 3))
    none = (0, *xyz.shape[:2])
    return Points3D(BODY23, xyz, np.full((*xyz.shape, 3), np.nan), np.empty(none), np.empty(none, bool), 60.0)


def renamed(points: Points3D, names: tuple[str, ...]) -> Points3D:
    return replace(points, landmarks=LandmarkSet("other", names, ()))


def run(capfd, *words: object) -> tuple[int, str, str]:
    code = run_command([str(w) for w in words])
    said = capfd.readouterr()
    return code, said.out, said.err


def refused(capfd, *words: object) -> str:
    code, _, err = run(capfd, *words)
    assert code == 2 and err.startswith("error: ") and err.count("\n") == 1, err
    return err


# --- convert -----------------------------------------------------------------------------------------------


def test_convert_between_all_formats_of_points(tmp_path, capfd):
    write_trc(tmp_path / "a.trc", make_points())
    chain = ["a.trc", "b.csv", "c.npz", "d.c3d", "e.trc"]
    try:
        import pyarrow  # noqa: F401

        chain.insert(3, "p.parquet")
    except ModuleNotFoundError:
        pass
    for one, other in zip(chain, chain[1:], strict=False):
        code, out, err = run(capfd, "convert", tmp_path / one, tmp_path / other)
        assert (code, err) == (0, "") and "24 frames at 60 fps, 23 points" in out
    first, last = read_trc(tmp_path / "a.trc"), read_trc(tmp_path / "e.trc")
    np.testing.assert_allclose(last.points_world, first.points_world, atol=2e-6)
    assert last.fps == 60 and last.landmarks == first.landmarks


def test_convert_between_all_formats_of_motion_and_to_points(tmp_path, capfd):
    motion = make_motion()
    write_bvh(tmp_path / "a.bvh", motion)
    for one, other in (("a.bvh", "b.glb"), *(("b.glb", n) for n in ("c.amc", "d.trc", "e.usda", "f.mot"))):
        code, out, _ = run(capfd, "convert", tmp_path / one, tmp_path / other)
        assert code == 0 and "21 joints" in out
    assert run(capfd, "convert", tmp_path / "c.amc", tmp_path / "g.bvh", "--fps", "60", "--to-units", "cm")[0] == 0
    at, names = motion.joint_positions_world(), motion.skeleton.names
    trc = read_trc(tmp_path / "d.trc")
    assert trc.fps == 60
    np.testing.assert_allclose(trc.points_world[:, [trc.landmarks.index(n) for n in names]], at, atol=2e-6)
    bvh = read_bvh(tmp_path / "g.bvh", 0.01)
    order = [bvh.skeleton.index("root" if n == "hips" else n) for n in names]
    np.testing.assert_allclose(bvh.joint_positions_world()[:, order], at, atol=5e-6)
    code, _, err = run(capfd, "convert", tmp_path / "g.bvh", tmp_path / "h.glb")
    assert code == 0 and "taken to be 0.01 m" in err
    back = read_gltf(tmp_path / "h.glb")
    order = [back.skeleton.index("root" if n == "hips" else n) for n in names]
    np.testing.assert_allclose(back.joint_positions_world()[:, order], at, atol=1e-5)


def test_convert_keeps_what_a_c3d_has_besides_points(tmp_path, capfd):
    analog = Analog(("Fz",), ("N",), 600.0, np.arange(240.0)[:, None])
    write_c3d(tmp_path / "a.c3d", C3DTake(make_points(), 11, (Event("Foot Strike", 0.3, "Left"),), analog))
    assert run(capfd, "convert", tmp_path / "a.c3d", tmp_path / "b.c3d")[0] == 0
    back = read_c3d_take(tmp_path / "b.c3d")
    assert back.first_frame == 11 and back.events[0].label == "Foot Strike" and back.analog is not None
    np.testing.assert_array_equal(back.analog.values[:, 0], np.arange(240.0))


def test_convert_says_what_makes_no_sense(tmp_path, capfd):
    write_trc(tmp_path / "a.trc", make_points())
    (tmp_path / "a.bvh").write_text("HIERARCHY")
    (tmp_path / "a.asf").write_text(":version 1.10")
    assert "muybridge solve" in refused(capfd, "convert", tmp_path / "a.trc", tmp_path / "b.bvh")
    assert "write .glb" in refused(capfd, "convert", tmp_path / "a.trc", tmp_path / "b.gltf")
    assert "known are .trc" in refused(capfd, "convert", tmp_path / "a.usda", tmp_path / "b.glb")
    assert "name the .amc" in refused(capfd, "convert", tmp_path / "a.asf", tmp_path / "b.glb")
    assert "ends after line 1" in refused(capfd, "convert", tmp_path / "a.bvh", tmp_path / "b.glb")
    assert "no such file" in refused(capfd, "convert", tmp_path / "none.trc", tmp_path / "b.csv")
    assert "file to be read" in refused(capfd, "convert", tmp_path / "a.trc", tmp_path / "a.trc", "--overwrite")
    (tmp_path / "b.csv").write_text("mine")
    assert "--overwrite" in refused(capfd, "convert", tmp_path / "a.trc", tmp_path / "b.csv")
    assert (tmp_path / "b.csv").read_text() == "mine"
    assert run(capfd, "convert", tmp_path / "a.trc", tmp_path / "b.csv", "--overwrite")[0] == 0
    points = make_points()
    points.points_world[:] = np.nan
    write_trc(tmp_path / "nothing.trc", points)
    assert "every point of it is missing" in refused(capfd, "convert", tmp_path / "nothing.trc", tmp_path / "c.csv")


def test_convert_fills_and_filters(tmp_path, capfd):
    points = make_points()
    points.points_world[8:11, 5] = np.nan
    write_trc(tmp_path / "a.trc", points)
    code, _, err = run(capfd, "convert", tmp_path / "a.trc", tmp_path / "b.csv", "--fill-gaps", "0.2",
                       "--smooth", "butterworth")  # fmt: skip
    assert code == 0 and "3 missing points filled in, 0 left" in err and "by residual analysis" in err
    assert run(capfd, "convert", tmp_path / "a.trc", tmp_path / "c.csv", "--smooth", "loess")[0] == 0
    rough, filled, gappy = (read_file(tmp_path / n).positions.points_world for n in ("a.trc", "b.csv", "c.csv"))
    assert np.isfinite(filled).all() and np.isnan(gappy[8:11, 5]).all()
    jerk = [np.nanstd(np.diff(x, 3, axis=0)) for x in (filled, gappy, rough)]
    assert jerk[0] < 0.7 * jerk[2] and jerk[1] < 0.7 * jerk[2]
    write_bvh(tmp_path / "m.bvh", make_motion())
    told = ("--smooth", "butterworth", "--cutoff", "6")
    assert run(capfd, "convert", tmp_path / "m.bvh", tmp_path / "n.bvh", *told)[0] == 0
    before, after = (read_bvh(tmp_path / n) for n in ("m.bvh", "n.bvh"))
    assert np.allclose(after.skeleton.bone_lengths, before.skeleton.bone_lengths, atol=1e-5)
    assert 0.001 < np.abs(after.joint_positions_world() - before.joint_positions_world()).max() < 0.1
    assert "between 0 and 30 Hz" in refused(capfd, "convert", tmp_path / "a.trc", tmp_path / "d.csv", "--smooth",
                                            "butterworth", "--cutoff", "40")  # fmt: skip
    assert "--smooth butterworth" in refused(capfd, "convert", tmp_path / "a.trc", tmp_path / "d.csv", "--cutoff", "6")
    assert "has no gaps" in refused(capfd, "convert", tmp_path / "m.bvh", tmp_path / "d.bvh", "--fill-gaps", "1")


def test_one_frame_converts(tmp_path, capfd):
    motion = make_motion()
    still = replace(motion, root_positions_world=motion.root_positions_world[:1], quat_wxyz=motion.quat_wxyz[:1])
    write_bvh(tmp_path / "a.bvh", still)
    for name in ("b.glb", "c.amc", "d.trc", "e.c3d", "f.mot", "g.usda"):
        assert run(capfd, "convert", tmp_path / "a.bvh", tmp_path / name)[0] == 0
    assert len(read_gltf(tmp_path / "b.glb")) == 1


def test_docs_list_every_format(repository: Path):
    text = (repository / "docs" / "reference" / "file-formats.md").read_text()
    for suffix in {*readable(), *writable()}:
        assert f"`{suffix}`" in text, suffix


# --- names -------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("name", "meant"),
    [
        ("left_shoulder", "left_shoulder"), ("LShoulder", "left_shoulder"), ("L_Shoulder", "left_shoulder"),
        ("shoulder_l", "left_shoulder"), ("Left Shoulder", "left_shoulder"), ("RBigToe", "right_big_toe"),
        ("left_foot_index", "left_big_toe"), ("REye", "right_eye"), ("Nose", "nose"), ("rwrist", "right_wrist"),
        ("subject:RHip", "right_hip"), ("LSmallToe", "left_small_toe"), ("Head", None), ("Neck", None), ("Hip", None),
        ("LASI", None), ("hip_center", None),
    ],
)  # fmt: skip
def test_names_of_landmarks(name, meant):
    assert body_landmark(name) == meant


def test_names_of_sets():
    labels = tuple(f"Someone:{label}" for label in PLUG_IN_GAIT.labels)
    assert map_surface(labels) == {name: i for i, name in enumerate(PLUG_IN_GAIT.names)} and not map_body(labels)
    halpe = ("Nose", "LShoulder", "RShoulder", "LHip", "RHip", "LBigToe", "Head", "Neck")
    assert set(map_body(halpe)) == {"nose", "left_shoulder", "right_shoulder", "left_hip", "right_hip", "left_big_toe"}
    humanik = ("Hips", "LeftUpLeg", "RightUpLeg", "LeftShoulder", "LeftArm", "LeftForeArm", "LeftHand", "LeftLeg")
    assert map_body(humanik)["left_shoulder"] == humanik.index("LeftArm"), "a skeleton's LeftShoulder is a collar bone"


# --- solve -------------------------------------------------------------------------------------------------


def test_solve_finds_the_body(tmp_path, capfd):
    write_trc(tmp_path / "p.trc", make_points())
    code, out, err = run(capfd, "solve", tmp_path / "p.trc", "--out", tmp_path / "out")
    assert code == 0 and "24 frames at 60 fps; 23 landmarks by their names" in out and err == ""
    names = {
        "motion.bvh",
        "motion.glb",
        "motion.mot",
        "landmarks.trc",
        "landmarks.c3d",
        "report.html",
        "run.json",
        "work",
    }
    assert {p.name for p in (tmp_path / "out").iterdir()} == names
    facts = json.loads((tmp_path / "out" / "run.json").read_text())["body"]
    assert facts["stature_m"] == pytest.approx(1.74, abs=0.04) and facts["residual_mm"]["median"] < 12
    truth = make_motion()
    found = read_bvh(tmp_path / "out" / "motion.bvh")
    order = [found.skeleton.index(n) for n in truth.skeleton.names]
    distance = np.linalg.norm(found.joint_positions_world()[:, order] - truth.joint_positions_world(), axis=-1)
    assert np.median(distance) < 0.015
    lengths = np.linalg.norm(np.diff(found.joint_positions_world()[:, [order[0], order[1]]], axis=1), axis=-1)
    assert np.ptp(lengths) < 1e-6
    assert "--overwrite" not in run(capfd, "solve", tmp_path / "p.trc", "--out", tmp_path / "out")[2], "its own results"


def test_solve_refuses_wrong_units_with_the_likely_one(tmp_path, capfd):
    points = make_points()
    giant = replace(points, points_world=points.points_world * 1000)
    write_trc(tmp_path / "giant.trc", giant)
    said = refused(capfd, "solve", tmp_path / "giant.trc", "--out", tmp_path / "out")
    assert "m tall" in said and "--units mm" in said and "1,7" in said
    assert not (tmp_path / "out").exists()
    write_csv(tmp_path / "giant.csv", giant)
    assert "--units mm" in refused(capfd, "solve", tmp_path / "giant.csv", "--out", tmp_path / "out")
    write_c3d(tmp_path / "dwarf.c3d", replace(points, points_world=points.points_world / 1000))
    assert "--units m" in refused(capfd, "solve", tmp_path / "dwarf.c3d", "--out", tmp_path / "out")
    assert run(capfd, "solve", tmp_path / "giant.csv", "--out", tmp_path / "out", "--units", "mm")[0] == 0


def test_solve_says_what_it_does_not_understand(tmp_path, capfd):
    points = make_points()
    write_csv(tmp_path / "a.csv", renamed(points, tuple(f"P{k}" for k in range(23))))
    said = refused(capfd, "solve", tmp_path / "a.csv", "--out", tmp_path / "out")
    assert "of 23 labels (P0, P1" in said and "muybridge label" in said
    write_csv(tmp_path / "b.csv", replace(points, points_world=points.points_world[..., [0, 2, 1]] * (1, 1, -1)))
    code, _, err = run(capfd, "solve", tmp_path / "b.csv", "--out", tmp_path / "out")
    assert code == 0 and "degrees from upright" in err and "--up" in err


def test_solve_takes_one_frame_and_gaps(tmp_path, capfd):
    points = make_points()
    one = replace(points, points_world=points.points_world[:1], covariance_world=points.covariance_world[:1])
    write_c3d(tmp_path / "one.c3d", one)
    assert run(capfd, "solve", tmp_path / "one.c3d", "--out", tmp_path / "one")[0] == 0
    assert len(read_bvh(tmp_path / "one" / "motion.bvh")) == 1
    points.points_world[:4] = np.nan
    points.points_world[10:13] = np.nan
    write_trc(tmp_path / "gaps.trc", points)
    assert run(capfd, "solve", tmp_path / "gaps.trc", "--out", tmp_path / "gaps")[0] == 0
    assert len(read_bvh(tmp_path / "gaps" / "motion.bvh")) == 24


def test_solve_markers_of_plug_in_gait(tmp_path, capfd):
    source = DATA / "markers" / "tennis_serve_pig39_gaps.c3d"
    if not source.is_file():
        pytest.skip("../shared/data is not here")
    take = read_c3d_take(source)
    short = replace(take.points, points_world=take.points.points_world[300:420],
                    covariance_world=take.points.covariance_world[300:420])  # fmt: skip
    write_c3d(tmp_path / "serve.c3d", short)
    code, out, _ = run(capfd, "solve", tmp_path / "serve.c3d", "--out", tmp_path / "out")
    assert code == 0 and "21 landmarks from 39 markers" in out
    facts = json.loads((tmp_path / "out" / "run.json").read_text())["body"]
    assert 1.5 < facts["stature_m"] < 1.9 and facts["residual_mm"]["median"] < 15
    # The body's joints lie within the markers around them.
    motion = read_bvh(tmp_path / "out" / "motion.bvh")
    at = dict(zip(motion.skeleton.names, motion.joint_positions_world().swapaxes(0, 1), strict=True))
    marker = {n.rsplit(":", 1)[-1]: short.points_world[:, i] for i, n in enumerate(short.landmarks.names)}
    for joint, label, near in (("left_shin", "LKNE", 0.10), ("right_shin", "RKNE", 0.10), ("left_foot", "LANK", 0.09),
                               ("right_forearm", "RELB", 0.09), ("left_hand", "LWRA", 0.09)):  # fmt: skip
        assert np.nanmedian(np.linalg.norm(at[joint] - marker[label], axis=1)) < near, joint


# --- compare -----------------------------------------------------------------------------------------------


def test_compare_prints_and_draws(tmp_path, capfd):
    points = make_points(0.0)
    moved = points.points_world + (0.1, 0, 0)
    moved[:, BODY23.index("nose")] += (0, 0, 0.05)
    moved[5:9, BODY23.index("left_hip")] = np.nan
    write_trc(tmp_path / "a.trc", points)
    write_csv(tmp_path / "b.csv", replace(points, points_world=moved))
    code, out, _ = run(capfd, "compare", tmp_path / "a.trc", tmp_path / "b.csv", "--plot", tmp_path / "d.png")
    assert code == 0 and (tmp_path / "d.png").read_bytes()[:4] == b"\x89PNG"
    row = {line.split()[0]: line.split() for line in out.splitlines() if line}
    assert float(row["left_knee"][1]) == pytest.approx(100, abs=0.1) and row["left_hip"][-1] == "83.3%"
    assert float(row["nose"][1]) == pytest.approx(np.hypot(100, 50), abs=0.1)
    code, out, _ = run(capfd, "compare", tmp_path / "a.trc", tmp_path / "b.csv", "--align", "rigid")
    row = {line.split()[0]: line.split() for line in out.splitlines() if line}
    assert float(row["left_knee"][1]) < 8 and "one rigid movement" in out
    assert "choose another name" in refused(
        capfd, "compare", tmp_path / "a.trc", tmp_path / "b.csv", "--plot", tmp_path / "d.png")  # fmt: skip


def test_alignments():
    points = make_points(0.0)
    turn = exp_so3(np.array([0.3, -0.2, 1.0]))
    other = replace(points, points_world=1.25 * points.points_world @ turn.T + (1, 2, 3))
    assert np.nanmax(compare_points(points, other, "similarity").distance_m) < 1e-9
    assert compare_points(points, other, "similarity").scale == pytest.approx(0.8)
    rigid = replace(points, points_world=points.points_world @ turn.T + (1, 2, 3))
    assert np.nanmax(compare_points(points, rigid, "rigid").distance_m) < 1e-9
    drifting = replace(points, points_world=points.points_world + np.linspace(0, 1, 24)[:, None, None])
    assert np.nanmax(compare_points(points, drifting, "root").distance_m) < 1e-9
    assert np.nanmedian(compare_points(points, drifting).distance_m) > 0.5


def test_compare_by_time_and_by_meaning(tmp_path, capfd):
    motion = make_motion(25)
    fine = points_of_motion(motion)
    half = replace(fine, points_world=fine.points_world[::2], covariance_world=fine.covariance_world[::2], fps=30.0)
    found = compare_points(half, fine)
    assert np.nanmax(found.distance_m) < 1e-12 and len(found.times) == 13
    late = replace(fine, points_world=fine.points_world[6:], covariance_world=fine.covariance_world[6:])
    found = compare_points(fine, late, shift=6 / 60)
    assert np.nanmax(found.distance_m) < 1e-12 and found.times[0] == pytest.approx(0.1)
    names = {"left_upper_arm": "LShoulder", "left_forearm": "LElbow", "left_hand": "LWrist", "left_thigh": "LHip",
             "left_shin": "LKnee", "left_foot": "LAnkle", "right_thigh": "RHip"}  # fmt: skip
    others = renamed(fine, tuple(names.get(n, f"x_{n}") for n in fine.landmarks.names))
    found = compare_points(others, fine)
    assert len(found.names) == 7 and np.nanmax(found.distance_m) == 0
    write_trc(tmp_path / "a.trc", renamed(fine, tuple(f"P{k}" for k in range(21))))
    write_bvh(tmp_path / "b.bvh", motion)
    assert "shares no landmark" in refused(capfd, "compare", tmp_path / "a.trc", tmp_path / "b.bvh")
    write_trc(tmp_path / "c.trc", fine)
    assert "do not overlap" in refused(capfd, "compare", tmp_path / "c.trc", tmp_path / "b.bvh", "--shift", "9")
    assert run(capfd, "compare", tmp_path / "c.trc", tmp_path / "b.bvh")[0] == 0


def test_every_readable_file_of_the_examples_is_read():
    if not DATA.is_dir():
        pytest.skip("../shared/data is not here")
    for path in (DATA / "balancing" / "reference" / "pose2sim_body25b_yup.trc",
                 DATA / "markers" / "tennis_serve_pig39.c3d"):  # fmt: skip
        assert np.isfinite(read_file(path).positions.points_world).any()
