"""TRC and C3D: what is written is read again, and other people's readers agree."""

import subprocess
import sys

import ezc3d
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from muybridge.errors import FormatError, OutputError
from muybridge.geometry.landmarks.arrays import Points3D
from muybridge.geometry.landmarks.sets import BODY23, LandmarkSet
from muybridge.motion.formats.points.c3d import read_c3d, write_c3d
from muybridge.motion.formats.points.trc import read_trc, write_trc
from tests.paths import REPOSITORY

SHARED = REPOSITORY.parent / "shared"
REFERENCE = SHARED / "data" / "balancing" / "reference"


def make_points(seed: int = 0, frames: int = 7, missing: float = 0.2, fps: float = 60.0) -> Points3D:
    rng = np.random.default_rng(seed)
    xyz = rng.normal(0, 2, (frames, len(BODY23), 3))
    lost = rng.random(xyz.shape[:2]) < missing
    lost[:, -1] |= frames > 2  # the last cell of every row empty: what OpenSim's cell count trips over
    xyz[lost] = np.nan
    covariance = np.broadcast_to(np.diag([4e-4, 1e-4, 1e-4]), (*xyz.shape[:2], 3, 3)).copy()
    covariance[lost] = np.nan
    no_camera = (0, *lost.shape)
    return Points3D(BODY23, xyz, covariance, np.empty(no_camera), np.empty(no_camera, bool), fps)


@settings(max_examples=15, deadline=None)
@given(seed=st.integers(0, 999), frames=st.integers(1, 12), fps=st.sampled_from([24.0, 29.97, 60.0, 120.0]))
def test_round_trips(tmp_path_factory, seed, frames, fps):
    points = make_points(seed, frames, fps=fps)
    folder = tmp_path_factory.mktemp("formats")
    write_trc(folder / "p.trc", points)
    write_c3d(folder / "p.c3d", points)
    # The unit is stated because random points have no size of a person.
    for back, tolerance in ((read_trc(folder / "p.trc", "m"), 1e-6), (read_c3d(folder / "p.c3d", "mm"), 1e-6)):
        assert back.landmarks == BODY23
        assert back.fps == pytest.approx(fps, rel=1e-6)
        np.testing.assert_allclose(back.points_world, points.points_world, atol=tolerance)
    assert sorted(p.name for p in folder.iterdir()) == ["p.c3d", "p.trc"], "no temporary file stays"


def test_trc_is_what_opensim_accepts(tmp_path):
    points = make_points(frames=5)
    write_trc(tmp_path / "p.trc", points)
    lines = (tmp_path / "p.trc").read_text().split("\n")
    # OpenSim splits at tabs and drops an empty cell after the last tab; the count must then be exact.
    tokens = [line.split("\t")[:-1] if line.endswith("\t") else line.split("\t") for line in lines]
    assert tokens[0][0] == "PathFileType"
    assert len(tokens[1]) == len(tokens[2]) == 8
    assert [t for t in tokens[3] if t] == ["Frame#", "Time", *BODY23.names]
    assert [t for t in tokens[4] if t][:4] == ["X1", "Y1", "Z1", "X2"]
    assert lines[5] == ""
    assert [len(t) for t in tokens[6:11]] == [2 + 3 * len(BODY23)] * 5
    assert [float(t[1]) for t in tokens[6:11]] == pytest.approx(np.arange(5) / 60, abs=1e-6)
    assert lines[11] == "" and len(lines) == 12


def test_trc_is_y_up(tmp_path):
    points = make_points(missing=0.0)
    points.points_world[0, 0] = (1.0, 2.0, 3.0)
    write_trc(tmp_path / "p.trc", points)
    first = (tmp_path / "p.trc").read_text().split("\n")[6].split("\t")
    assert [float(c) for c in first[2:5]] == [2.0, 3.0, 1.0]


def test_c3d_by_ezc3d(tmp_path):
    points = make_points()
    write_c3d(tmp_path / "p.c3d", points)
    c3d = ezc3d.c3d(str(tmp_path / "p.c3d"))
    parameters = c3d["parameters"]["POINT"]
    assert parameters["UNITS"]["value"] == ["mm"]
    assert parameters["RATE"]["value"][0] == 60.0
    assert tuple(parameters["LABELS"]["value"]) == BODY23.names
    assert parameters["X_SCREEN"]["value"] == ["+Y"] and parameters["Y_SCREEN"]["value"] == ["+Z"]
    assert c3d["header"]["points"]["last_frame"] - c3d["header"]["points"]["first_frame"] == 6
    missing = np.isnan(points.points_world[..., 0])
    residuals = c3d["data"]["meta_points"]["residuals"][0].T
    assert (residuals[missing] == -1).all()
    assert (residuals[~missing] == 14).all(), "the root of 200 mm^2, in whole millimetres"
    np.testing.assert_allclose(
        c3d["data"]["points"][:3].transpose(2, 1, 0)[~missing], points.points_world[~missing] * 1e3, atol=1e-3
    )


def test_reads_other_programs_files():
    if not REFERENCE.is_dir():
        pytest.skip("../shared/data is not here")
    trc = read_trc(REFERENCE / "pose2sim_body25b_yup.trc")
    assert trc.points_world.shape == (100, 21, 3) and trc.fps == 60
    left, right, head = (trc.points_world[:, trc.landmarks.index(n)] for n in ("LHip", "RHip", "Head"))
    assert (head[:, 2] > left[:, 2]).all() and np.linalg.norm(left - right, axis=1).mean() < 0.4
    c3d = read_c3d(SHARED / "data" / "markers" / "tennis_serve_pig39_gaps.c3d")
    assert c3d.points_world.shape == (1092, 39, 3) and c3d.fps == 50
    assert np.isnan(c3d.points_world[..., 0]).sum() == 145


def test_scores_zero_against_its_own_reference(tmp_path):
    if not REFERENCE.is_dir():
        pytest.skip("../shared/data is not here")
    reference = np.load(REFERENCE / "openpose_body25b.npz")
    names = [str(n) for n in reference["names"]]
    kept = [n for n in BODY23.names if n in names]
    assert len(kept) == 23
    xyz = reference["points3d_world"][:, [names.index(n) for n in kept]]
    t, j = xyz.shape[:2]
    nothing = np.full((t, j, 3, 3), np.nan)
    points = Points3D(BODY23, xyz, nothing, np.empty((0, t, j)), np.empty((0, t, j), bool), 60.0)
    write_trc(tmp_path / "points.trc", points)
    score = subprocess.run(
        [sys.executable, SHARED / "tools" / "score_balancing.py", tmp_path / "points.trc"],
        capture_output=True, text=True, check=True,
    ).stdout  # fmt: skip
    figures = dict(line.split(" ", 1) for line in score.splitlines())
    assert float(figures["coverage"]) == 1.0
    assert float(figures["mpjpe_mm"]) < 1e-3


TRC_HEAD = (
    "PathFileType\t4\t(X/Y/Z)\tx.trc\nDataRate\tCameraRate\tNumFrames\tNumMarkers\tUnits\n"
    "60\t60\t1\t1\tm\nFrame#\tTime\ta\n\t\tX1\tY1\tZ1\n\n"
)


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("", "PathFileType"),
        ("hello\n" * 9, "PathFileType"),
        (TRC_HEAD.replace("60\t60", "no\t60"), "line 3: DataRate"),
        (TRC_HEAD.replace("\tm\n", "\tft\n"), "valid are m, cm, mm"),
        (TRC_HEAD.replace("\ta\n", "\t\n"), "line 4"),
        (TRC_HEAD.replace("\t1\t1\tm", "\t1\t9\tm"), "NumMarkers"),
        (TRC_HEAD + "1\t0\t1\tx\t3\n", "line 7, cell 4: 'x'"),
        (TRC_HEAD + "1\t0\t1\t2\t3\t4\n", "line 7 has more cells"),
    ],
)
def test_malformed_trc_names_the_line(tmp_path, text, says):
    (tmp_path / "bad.trc").write_text(text)
    with pytest.raises(FormatError, match=says) as raised:
        read_trc(tmp_path / "bad.trc")
    assert "\n" not in str(raised.value) and "bad.trc" in str(raised.value)


def test_c3d_residuals_fit_their_byte(tmp_path):
    points = make_points(missing=0.0)
    points.covariance_world[0] = np.eye(3) * 9.0
    points.covariance_world[1] = np.eye(3) * 1e-8
    points.covariance_world[2] = np.nan
    write_c3d(tmp_path / "p.c3d", points)
    residuals = ezc3d.c3d(str(tmp_path / "p.c3d"))["data"]["meta_points"]["residuals"][0].T
    assert [set(r.tolist()) for r in residuals[:3, :-1]] == [{127.0}, {1.0}, {0.0}]


def test_broken_c3d_and_unwritable_folder(tmp_path):
    (tmp_path / "bad.c3d").write_bytes(b"\x02\x50" + b"nonsense" * 200)
    with pytest.raises(FormatError, match="bad.c3d"):
        read_c3d(tmp_path / "bad.c3d")
    with pytest.raises(FormatError, match="no such file"):
        read_c3d(tmp_path / "none.c3d")
    (tmp_path / "a_file").write_text("")
    for write in (write_trc, write_c3d):
        with pytest.raises(OutputError, match="cannot be written"):
            write(tmp_path / "a_file" / "p.trc", make_points())


def test_other_landmark_sets_keep_their_names(tmp_path):
    landmarks = LandmarkSet("two", ("LASI", "RASI"), ())
    points = Points3D(
        landmarks, np.ones((3, 2, 3)), np.full((3, 2, 3, 3), np.nan),
        np.empty((0, 3, 2)), np.empty((0, 3, 2), bool), 50.0,
    )  # fmt: skip
    write_c3d(tmp_path / "p.c3d", points)
    assert read_c3d(tmp_path / "p.c3d").landmarks.names == ("LASI", "RASI")
