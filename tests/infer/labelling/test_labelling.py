"""`muybridge label`: the shipped network on generated and on real recordings, its files, its errors."""

import json

import ezc3d
import numpy as np
import pytest

pytest.importorskip("torch")
pytest.importorskip("anny")

from muybridge.geometry.landmarks.marker_sets import (  # noqa: E402
    CMU,
    PLUG_IN_GAIT,
    SETS,  # noqa: E402
)
from muybridge.infer.commands.app import run_command  # noqa: E402
from muybridge.infer.labelling.label import LabelOptions, label_points  # noqa: E402
from muybridge.infer.networks.labelling import LabelNetwork  # noqa: E402
from muybridge.models.shipped import shipped_model  # noqa: E402
from muybridge.motion.formats.points.unlabelled import read_marker_cloud  # noqa: E402
from muybridge.train.synthesis.markers.trajectories import FPS, MarkerBodies  # noqa: E402
from tests.paths import SHARED

SERVE = SHARED / "data" / "markers" / "tennis_serve_pig39.c3d"
FRAMES = 96


@pytest.fixture(scope="module")
def clips():
    """Markers (N, T, 72, 3) of bodies and motions that no training has seen, and their kinds."""
    bodies = MarkerBodies(0)
    bodies.reseed(987_654_321)
    made = bodies.clips(12)
    return made.points[:, :FRAMES].astype(np.float64)


@pytest.fixture(scope="module")
def network():
    return LabelNetwork(shipped_model("labels"))


def save_c3d(path, names, points_mm, rate=100.0):
    """A C3D in millimetres by ezc3d's own means; missing points have residual -1."""
    file = ezc3d.c3d()
    file["parameters"]["POINT"]["LABELS"]["value"] = list(names)
    file["parameters"]["POINT"]["RATE"]["value"] = [rate]
    file["parameters"]["POINT"]["UNITS"]["value"] = ["mm"]
    data = np.ones((4, len(names), len(points_mm)))
    data[:3] = np.nan_to_num(points_mm).transpose(2, 1, 0)
    file["data"]["points"] = data
    residual = np.where(np.isfinite(points_mm[..., 0]), 0.0, -1.0).T[None]
    file["data"]["meta_points"]["residuals"] = residual
    file["data"]["meta_points"]["camera_masks"] = np.zeros((7, *residual.shape[1:]), bool)
    file.write(str(path))


def taken(points, markers, seed=0):
    """A set's markers of a clip, shuffled: cloud (T, K, 3) and truth (T, M, 3)."""
    truth = points[:, list(markers.surface_indices)]
    return truth[:, np.random.default_rng(seed).permutation(truth.shape[1])], truth


def share(found, truth, tolerance=1e-3):
    """Share of the truth's markers that are where they should be."""
    seen = np.isfinite(truth[..., 0])
    return float((np.linalg.norm(found - truth, axis=-1) < tolerance)[seen].mean())


@pytest.mark.parametrize("markers", [PLUG_IN_GAIT, CMU, SETS["pig35"]], ids=["pig39", "cmu41", "pig35"])
def test_unseen_bodies_are_labelled(clips, network, markers):
    right = [share(label_points(*(taken(c, markers)[:1]), FPS, markers, network).points, taken(c, markers)[1])
             for c in clips[::2]]  # fmt: skip
    assert np.mean(right) > 0.97


def test_points_shuffled_in_every_frame_with_ghosts_are_labelled(clips, network):
    rng = np.random.default_rng(3)
    cloud, truth = taken(clips[0], PLUG_IN_GAIT)
    ghosts = truth.mean(1, keepdims=True) + rng.normal(0, 0.4, (len(cloud), 2, 3))
    cloud = np.concatenate([cloud, np.where(rng.random((len(cloud), 2, 1)) < 0.5, ghosts, np.nan)], 1)
    cloud = np.stack([frame[rng.permutation(len(frame))] for frame in cloud])
    done = label_points(cloud, FPS, PLUG_IN_GAIT, network)
    assert done.tracks.tracked and share(done.points, truth) > 0.95
    found = np.isfinite(done.points[..., 0])
    assert (np.linalg.norm(done.points - truth, axis=-1)[found] < 1e-3).mean() > 0.97


UPRIGHT = np.eye(3)
Y_UP, X_DOWN = UPRIGHT[[1, 2, 0]], UPRIGHT[[2, 1, 0]] * [[-1], [1], [1]]
AXES = {"y up": (Y_UP, 1.0), "x down": (X_DOWN, 1.0), "millimetres": (UPRIGHT, 1000.0), "y up, cm": (Y_UP, 100.0)}


@pytest.mark.parametrize("name", AXES)
def test_any_up_axis_and_any_unit_are_labelled(clips, network, name):
    turn, unit = AXES[name]
    assert np.linalg.det(turn) == pytest.approx(1)
    cloud, truth = taken(clips[2], PLUG_IN_GAIT)
    plain = label_points(cloud, FPS, PLUG_IN_GAIT, network)
    done = label_points(cloud @ turn.T * unit, FPS, PLUG_IN_GAIT, network)
    assert np.allclose(done.turn @ turn @ [0, 0, 1], [0, 0, 1])
    assert share(done.points, truth @ turn.T) >= share(plain.points, truth) - 0.02
    assert any("unit" in note for note in done.notes) == (unit != 1)


def test_motion_backwards_in_time_is_labelled_as_well(clips, network):
    cloud, truth = taken(clips[4], PLUG_IN_GAIT)
    forth = share(label_points(cloud, FPS, PLUG_IN_GAIT, network).points, truth)
    back = share(label_points(cloud[::-1], FPS, PLUG_IN_GAIT, network).points, truth[::-1])
    assert back >= forth - 0.03


def test_the_command_writes_names_confidence_changes_and_a_page(clips, tmp_path, capsys):
    cloud, truth = taken(clips[6], PLUG_IN_GAIT)
    cloud[30:34, 5] = np.nan
    save_c3d(tmp_path / "take.c3d", [f"*{i}" for i in range(39)], cloud * 1000, rate=FPS)
    out = tmp_path / "out"
    assert run_command(["label", str(tmp_path / "take.c3d"), "--out", str(out)]) == 0
    assert "39 of 39 markers" in capsys.readouterr().out
    written = read_marker_cloud(out / "labelled.c3d")
    assert written.names == PLUG_IN_GAIT.labels and written.fps == FPS
    content = json.loads((out / "label.json").read_text())
    assert content["frames"] == FRAMES and set(content["markers"]) == set(PLUG_IN_GAIT.labels)
    assert all(len(m["confidence"]) == FRAMES for m in content["markers"].values())
    named = [c for c in content["changes"] if c["change"] == "named"]
    assert len({c["from"] for c in named}) == 39
    # What was taken out as a spike (a jerk of the generated motion may be one) is filled too, and says so.
    spikes = [(c["marker"], c["frames"]) for c in content["changes"] if c["change"] == "spike taken out"]
    filled = [c for c in content["changes"] if c["change"] == "filled" and (c["marker"], c["frames"]) not in spikes]
    assert [c["frames"] for c in filled] == [[30, 33]]
    marker = filled[0]["marker"]
    spans = content["markers"][marker]["samples"]
    assert spans[0] == [0, 29, "measured"] and spans[1][2] in ("curve", "rigid", "pattern")
    m = PLUG_IN_GAIT.labels.index(marker)
    assert share(written.points, truth, 2e-3) > 0.97
    assert np.linalg.norm(written.points[30:34, m] - truth[30:34, m], axis=-1).max() < 0.03
    residual = ezc3d.c3d(str(out / "labelled.c3d"))["data"]["meta_points"]["residuals"][0, m]
    assert (residual[30:34] == 0).all() and (np.delete(residual, range(30, 34)) == 1).all()
    page = (out / "report.html").read_text()
    assert "Content-Security-Policy" in page and "<!--@" not in page and "http" not in page.split("</style>")[1]


def test_corrections_are_applied_and_kept_for_later_runs(clips, tmp_path, capsys):
    cloud, _ = taken(clips[6], PLUG_IN_GAIT)
    save_c3d(tmp_path / "take.c3d", [f"*{i}" for i in range(39)], cloud * 1000, rate=FPS)
    (tmp_path / "settled.txt").write_text("10-20 LWRA LWRB\n10-20 LWRB LWRA\n40-50 LTOE delete\n")
    label = ["label", str(tmp_path / "take.c3d"), "--clean.no-fill", "--out"]
    assert run_command([*label, str(tmp_path / "plain")]) == 0
    assert run_command([*label, str(tmp_path / "out"), "--corrections", str(tmp_path / "settled.txt")]) == 0
    assert "LTOE deleted in 11 frames" in capsys.readouterr().out
    assert run_command([*label, str(tmp_path / "out")]) == 0  # and again, unasked
    plain, again = (read_marker_cloud(tmp_path / d / "labelled.c3d") for d in ("plain", "out"))
    a, b, toe = (PLUG_IN_GAIT.labels.index(n) for n in ("LWRA", "LWRB", "LTOE"))
    assert np.array_equal(again.points[10:21, a], plain.points[10:21, b])
    assert np.array_equal(again.points[10:21, b], plain.points[10:21, a])
    assert np.isnan(again.points[40:51, toe]).all() and np.isfinite(again.points[51:, toe]).all()
    content = json.loads((tmp_path / "out" / "label.json").read_text())
    assert content["markers"]["LWRA"]["confidence"][15] > 0.99 and len(content["corrections"]) == 3


def test_a_set_is_learned_from_a_labelled_trial(clips, tmp_path, capsys):
    truth = clips[8][:, list(PLUG_IN_GAIT.surface_indices)]
    names = [f"S:{n}" for n in PLUG_IN_GAIT.labels]
    names[PLUG_IN_GAIT.labels.index("LKNE")] = "S:kneeL"
    save_c3d(tmp_path / "trial.c3d", names, truth * 1000, rate=FPS)
    path = tmp_path / "our.txt"
    assert run_command(["markerset", "from", str(tmp_path / "trial.c3d"), "--out", str(path)]) == 0
    assert "kneeL stands on left_knee_lateral" in capsys.readouterr().out
    command = ["label", str(tmp_path / "trial.c3d"), "--markerset", str(path), "--out", str(tmp_path / "o")]
    assert run_command(command) == 0
    written = read_marker_cloud(tmp_path / "o" / "labelled.c3d")
    assert "kneeL" in written.names and len(written.names) == 39


def test_bad_input_is_one_line_and_exit_code_two(clips, tmp_path, capsys):
    cloud, _ = taken(clips[0], PLUG_IN_GAIT)
    names = [f"*{i}" for i in range(39)]
    save_c3d(tmp_path / "one.c3d", names[:1], cloud[:, :1] * 1000)
    save_c3d(tmp_path / "room.c3d", names[:8], cloud[:, :8] * 1e-7)
    save_c3d(tmp_path / "good.c3d", names, cloud * 1000)
    rows = [",".join(f"a{i}_{c}" for i in range(8) for c in "xyz")]
    rows += [",".join(f"{v:.4f}" for v in frame[:8].ravel()) for frame in cloud]
    (tmp_path / "norate.csv").write_text("\n".join(rows))
    cases = {
        ("one.c3d",): "at least 6 markers", ("room.c3d",): "no person in any unit", ("absent.c3d",): "no such file",
        ("norate.csv",): "--fps", ("good.c3d", "--markerset", "pig93"): "did you mean",
        ("good.c3d", "--model", str(tmp_path / "one.c3d")): "not an ONNX model",
        ("good.c3d", "--corrections", str(tmp_path / "absent.txt")): "corrections",
    }  # fmt: skip
    for (file, *more), what in cases.items():
        assert run_command(["label", str(tmp_path / file), "--out", str(tmp_path / "o"), *more]) == 2, file
        said = capsys.readouterr().err
        assert what in said and len(said.splitlines()) == 1, said
    assert run_command(["label", str(tmp_path / "norate.csv"), "--fps", "30", "--out", str(tmp_path / "csv")]) == 0


def test_equal_names_and_empty_trajectories_do_no_harm(clips, network, tmp_path):
    cloud, truth = taken(clips[2], PLUG_IN_GAIT)
    cloud = np.concatenate([cloud, np.full((FRAMES, 3, 3), np.nan)], 1)
    save_c3d(tmp_path / "same.c3d", ["M"] * 42, cloud * 1000, rate=FPS)
    assert run_command(["label", str(tmp_path / "same.c3d"), "--out", str(tmp_path / "o")]) == 0
    assert share(read_marker_cloud(tmp_path / "o" / "labelled.c3d").points, truth, 2e-3) > 0.97
    assert "3 trajectories of the file are empty" in json.loads((tmp_path / "o" / "label.json").read_text())["notes"]


def test_of_two_people_the_one_with_more_points_is_labelled_and_reported(clips, network):
    one, truth = taken(clips[0], PLUG_IN_GAIT)
    other = taken(clips[2], PLUG_IN_GAIT)[0][:, :33]
    other = other - other.mean((0, 1)) + truth.mean((0, 1)) + [2.2, 0, 0]
    for away in (0.0, 2.0, 8.0):
        both = np.concatenate([one, other + [0, away, 0]], 1)
        done = label_points(both, FPS, PLUG_IN_GAIT, network)
        assert done.factor == 1 and len(done.notes) == 1 and "two people" in done.notes[0]
        assert share(done.points, truth) > 0.95


@pytest.mark.skipif(not SERVE.is_file(), reason="no recordings beside this checkout")
def test_the_serve_is_labelled_accurately(network):
    cloud = read_marker_cloud(SERVE)
    names = [n.split(":")[-1] for n in cloud.names]
    truth = cloud.points[:, [names.index(n) for n in PLUG_IN_GAIT.labels]]
    rng = np.random.default_rng(11)
    whole = label_points(truth[:, rng.permutation(39)], cloud.fps, PLUG_IN_GAIT, network)
    assert share(whole.points, truth) > 0.995
    some = slice(100, 500)
    shuffled = np.stack([frame[rng.permutation(39)] for frame in truth[some]])
    tracked = label_points(shuffled, cloud.fps, PLUG_IN_GAIT, network)
    assert share(tracked.points, truth[some]) > 0.96
    alone = label_points(truth[some], cloud.fps, PLUG_IN_GAIT, network, LabelOptions(votes=False, window=False))
    assert share(alone.points, truth[some]) > 0.85  # the network and the distances by themselves
