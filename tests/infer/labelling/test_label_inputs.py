"""`muybridge label` on files that hold nothing to label: one line says what is wrong, and no result is left."""

import json

import ezc3d
import numpy as np
import pytest

from muybridge.geometry.landmarks.arrays import Points3D
from muybridge.geometry.landmarks.sets import LandmarkSet
from muybridge.infer.commands.app import run_command
from muybridge.infer.labelling.settle import up_turn
from muybridge.motion.formats.points.c3d import Analog, C3DTake, Event, read_c3d_take, write_c3d
from muybridge.motion.formats.points.c3d_read import read_raw_c3d

FRAMES, MARKERS = 20, 12


def save_c3d(path, points_mm, labels=None, analog=0):
    """(T, K, 3) millimetres; NaN is stored as missing."""
    count = points_mm.shape[1]
    file = ezc3d.c3d()
    file["parameters"]["POINT"]["LABELS"]["value"] = list(labels or [f"*{i}" for i in range(count)])
    file["parameters"]["POINT"]["RATE"]["value"] = [100.0]
    file["parameters"]["POINT"]["UNITS"]["value"] = ["mm"]
    data = np.ones((4, count, len(points_mm)))
    data[:3] = np.nan_to_num(points_mm).transpose(2, 1, 0)
    file["data"]["points"] = data
    if count:
        residual = np.where(np.isfinite(points_mm[..., 0]), 0.0, -1.0).T[None]
        file["data"]["meta_points"]["residuals"] = residual
        file["data"]["meta_points"]["camera_masks"] = np.zeros((7, *residual.shape[1:]), bool)
    if analog:
        file["parameters"]["ANALOG"]["RATE"]["value"] = [1000.0]
        file["parameters"]["ANALOG"]["LABELS"]["value"] = [f"A{i}" for i in range(analog)]
        file["data"]["analogs"] = np.zeros((1, analog, 10 * len(points_mm)))
    file.write(str(path))


@pytest.fixture(scope="module")
def files(tmp_path_factory):
    """A good file and what can be wrong with one."""
    folder = tmp_path_factory.mktemp("files")
    points = np.random.default_rng(0).normal(0, 300, (FRAMES, MARKERS, 3)) + [0, 0, 1000]
    save_c3d(folder / "good.c3d", points)
    save_c3d(folder / "none.c3d", points[:, :0])
    save_c3d(folder / "analog.c3d", points[:, :0], analog=3)
    save_c3d(folder / "one.c3d", points[:, :1])
    save_c3d(folder / "missing.c3d", np.full_like(points, np.nan))
    save_c3d(folder / "still.c3d", np.zeros_like(points) + [10.0, 20.0, 30.0])
    whole = (folder / "good.c3d").read_bytes()
    for share in (0, 10, 600, len(whole) // 2, len(whole) - 700):
        (folder / f"cut{share}.c3d").write_bytes(whole[:share])
    head = ",".join(f"m{i}_{c}" for i in range(MARKERS) for c in "xyz")
    (folder / "header.csv").write_text(head + "\n")
    (folder / "nan.csv").write_text("\n".join([head, *[",".join(["nan"] * 3 * MARKERS)] * 5]))
    (folder / "noise.c3d").write_bytes(np.random.default_rng(1).bytes(5000))
    (folder / "trc.trc").write_text("PathFileType\t4\t(X/Y/Z)\tx.trc\nDataRate\tCameraRate\n")
    return folder


@pytest.mark.parametrize(("name", "what"), [
    ("none.c3d", "holds no points"), ("analog.c3d", "3 analog channels"), ("one.c3d", "at least 6 markers"),
    ("missing.c3d", "trajectories are empty"), ("still.c3d", "no person in any unit"), ("header.csv", "no frames"),
    ("nan.csv", "trajectories are empty"), ("cut0.c3d", ""), ("cut10.c3d", ""), ("cut600.c3d", ""), ("noise.c3d", ""),
    ("trc.trc", ""),
])  # fmt: skip
def test_a_file_with_nothing_to_label_is_refused_in_one_line(files, tmp_path, capsys, name, what):
    assert run_command(["label", str(files / name), "--fps", "100", "--out", str(tmp_path / "out")]) == 2
    said = capsys.readouterr().err
    assert name in said and what in said and len(said.splitlines()) == 1, said
    assert not (tmp_path / "out" / "labelled.c3d").exists()


def test_a_truncated_recording_is_refused(files, tmp_path, capsys):
    cut = [path for path in files.glob("cut*.c3d") if path.stat().st_size > 1000]
    assert len(cut) == 2
    for path in cut:
        code = run_command(["label", str(path), "--out", str(tmp_path / path.stem)])
        said = capsys.readouterr()
        assert code == 2 and path.name in said.err and len(said.err.splitlines()) == 1, said.err


def test_random_points_do_no_harm(files, tmp_path, capsys):
    assert run_command(["label", str(files / "good.c3d"), "--out", str(tmp_path / "out")]) == 0
    assert "of 39 markers" in capsys.readouterr().out


@pytest.fixture(scope="module")
def take():
    """Points of a trial with events, a force plate and its channels, beginning at frame 41."""
    points = np.random.default_rng(0).normal(0, 0.3, (FRAMES, MARKERS, 3)) + [0, 0, 1]
    none = np.empty((0, FRAMES, MARKERS))
    names = LandmarkSet("m", tuple(f"*{i}" for i in range(MARKERS)), ())
    points = Points3D(names, points, np.full((*points.shape, 3), np.nan), none, none.astype(bool), 100.0)
    analog = Analog(("Fz", "EMG"), ("N", "V"), 1000.0, np.arange(20.0 * FRAMES).reshape(-1, 2))
    plates = {"USED": [1], "TYPE": [2], "CORNERS": np.arange(12.0).reshape(3, 4, 1), "ORIGIN": np.ones((3, 1)),
              "CHANNEL": np.array([[1], [2]]), "ZERO": [0, 0]}  # fmt: skip
    return C3DTake(points, 41, (Event("Foot Strike", 0.5, "Left"),), analog, plates)


@pytest.mark.parametrize("axis", ["+Z", "+Y", "+X", "-Z"])
def test_events_channels_and_plates_are_kept_and_the_axis_is_right(take, tmp_path, monkeypatch, axis):
    turn = up_turn("XYZ".index(axis[1]), 1.0 if axis[0] == "+" else -1.0)
    monkeypatch.setattr("muybridge.infer.labelling.label.find_upright", lambda *a: (turn, 0.0))
    write_c3d(tmp_path / "a.c3d", take)
    assert run_command(["label", str(tmp_path / "a.c3d"), "--clean.no-fill", "--out", str(tmp_path / "out")]) == 0
    raw = read_raw_c3d(tmp_path / "out" / "labelled.c3d")
    kept = axis in ("+Z", "+Y")
    assert raw.texts("POINT", "Y_SCREEN") == ["+Y" if axis == "+Y" else "+Z"]
    notes = json.loads((tmp_path / "out" / "label.json").read_text())["notes"]
    assert any("is rotated" in note for note in notes) == (not kept)
    back = read_c3d_take(tmp_path / "out" / "labelled.c3d", up="z")
    assert back.first_frame == 41 and back.events[0].time == pytest.approx(0.5) and back.analog is not None
    np.testing.assert_array_equal(back.analog.values, take.analog.values)
    turn = np.eye(3) if kept else turn
    corners = np.tensordot(turn, take.force_platforms["CORNERS"], 1)
    np.testing.assert_allclose(back.force_platforms["CORNERS"], corners, atol=1e-6)
    measured = back.points.points_world[np.isfinite(back.points.points_world[..., 0])]
    there = (take.points.points_world @ turn.T).reshape(-1, 3)
    assert len(measured) and all(np.abs(there - p).max(1).min() < 1e-5 for p in measured)


def test_another_frame_rate_moves_events_and_samples_with_the_frames(take, tmp_path):
    write_c3d(tmp_path / "a.c3d", take)
    source = str(tmp_path / "a.c3d")
    for words in (["convert", source, str(tmp_path / "b.c3d")], ["label", source, "--out", str(tmp_path / "out")]):
        assert run_command([*words, "--fps", "50"]) == 0
    for name in ("b.c3d", "out/labelled.c3d"):
        back = read_c3d_take(tmp_path / name)
        assert back.points.fps == 50 and back.analog is not None and back.analog.rate == 500
        assert back.events[0].time == pytest.approx(1.0)
