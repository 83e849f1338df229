"""OpenSim's storage files as input: joint angles, markers, and what is named and refused."""

import numpy as np
import pytest

from muybridge.errors import FormatError
from muybridge.geometry.skeleton.body import BODY, prior_shape
from muybridge.motion.formats.registry import read_file
from muybridge.motion.formats.skeletal.mot import write_mot
from tests.motion.formats.test_mot import make_motion


def _table(path, columns, rows, *facts):
    head = ["Any name", "version=1", f"nRows={len(rows)}", f"nColumns={len(columns) + 1}", *facts, "endheader"]
    lines = [*head, "\t".join(["time", *columns]), *("\t".join(map(str, row)) for row in rows)]
    path.write_text("\n".join(lines) + "\n")
    return path


@pytest.mark.parametrize("suffix", [".mot", ".sto"])
def test_what_is_written_reads_back(tmp_path, suffix):
    motion = make_motion(12)
    write_mot(tmp_path / "m.mot", motion)
    path = (tmp_path / "m.mot").rename(tmp_path / f"n{suffix}")
    take = read_file(path)
    assert take.motion.fps == pytest.approx(100) and "no lengths of bones" in take.notices[0]
    np.testing.assert_allclose(take.motion.joint_positions_world(), motion.joint_positions_world(), atol=1e-6)


def test_knees_of_gait2392_bend_the_other_way(tmp_path):
    columns = ("pelvis_ty", "hip_flexion_r", "knee_angle_r", "mtp_angle_r")
    rows = [(k / 50, 0.95, 10, -60 - k, 0) for k in range(4)]
    take = read_file(_table(tmp_path / "g.mot", columns, rows, "inDegrees=yes"))
    rows = [(k / 50, 0.95, 10, 60 + k, 0) for k in range(4)]
    other = read_file(_table(tmp_path / "r.mot", columns, rows, "inDegrees=yes"))
    np.testing.assert_allclose(take.motion.quat_wxyz, other.motion.quat_wxyz, atol=1e-12)
    assert any("gait2392" in n for n in take.notices) and not any("gait2392" in n for n in other.notices)
    assert any("mtp_angle_r left out" in n for n in other.notices)
    knee, ankle, hip = (BODY.skeleton(prior_shape(1.75)).index(f"right_{n}") for n in ("shin", "foot", "thigh"))
    places = other.motion.joint_positions_world()[0]
    thigh, shin = places[knee] - places[hip], places[ankle] - places[knee]
    bent = np.degrees(np.arccos(thigh @ shin / np.linalg.norm(thigh) / np.linalg.norm(shin)))
    assert bent == pytest.approx(60, abs=5)


def test_radians_are_read(tmp_path):
    columns, rows = ("hip_flexion_r", "knee_angle_r"), [(0, 30, 60), (0.1, 20, 50)]
    degrees = read_file(_table(tmp_path / "d.mot", columns, rows, "inDegrees=yes"))
    rows = [(t, np.radians(a), np.radians(b)) for t, a, b in rows]
    radians = read_file(_table(tmp_path / "r.mot", columns, rows, "inDegrees=no"))
    np.testing.assert_allclose(radians.motion.quat_wxyz, degrees.motion.quat_wxyz, atol=1e-12)


def test_tables_of_vectors_are_points(tmp_path):
    rows = [(0.5 + k / 100, f"{k},900,300", "nan,nan,nan") for k in range(3)]
    path = _table(tmp_path / "v.sto", ("R.ASIS", "L.ASIS"), rows, "DataType=Vec3", "Units=mm")
    take = read_file(path)
    assert take.points.landmarks.names == ("R.ASIS", "L.ASIS") and take.fps == pytest.approx(100)
    assert take.start == 0.5
    np.testing.assert_allclose(take.points.points_world[:, 0], [[0.3, k / 1000, 0.9] for k in range(3)])
    assert np.isnan(take.points.points_world[:, 1]).all()


@pytest.mark.parametrize(
    ("columns", "says"),
    [
        (("ground_force_vx", "ground_force_vy", "ground_force_vz", "ground_force_px"), "holds forces"),
        (("1_ground_force_vx", "1_ground_torque_x", "1_ground_force_pz", "1_ground_force_vy"), "holds forces"),
        (("soleus_r.activation", "soleus_r.fiber_length"), "holds states of a simulation"),
        (
            ("/jointset/hip_r/hip_flexion_r/value", "/jointset/hip_r/hip_flexion_r/speed"),
            "holds states of a simulation",
        ),
        (("total_squared_error", "marker_error_RMS", "marker_error_max"), "marker errors"),
        (("pelvis_X", "pelvis_Y", "pelvis_Z", "pelvis_Ox"), "positions or velocities"),
        (("bone_0_tx", "bone_0_rz", "bone_0_rx"), "a skeleton that the file does not describe"),
        (("apples", "pears"), "no joint angles of a known model but apples, pears"),
    ],
)
def test_other_tables_are_named(tmp_path, columns, says):
    path = _table(tmp_path / "x.sto", columns, [(0, *(1.0 for _ in columns)), (0.1, *("nan" for _ in columns))])
    with pytest.raises(FormatError, match=says) as raised:
        read_file(path)
    assert str(path) in str(raised.value) and "\n" not in str(raised.value)


@pytest.mark.parametrize(
    ("times", "says"), [((0, 0.1, 0.3), "times are not even"), ((0,), "single row"), ((0, 0.1, 0.1), "do not rise")]
)
def test_times_must_be_even(tmp_path, times, says):
    path = _table(tmp_path / "x.mot", ("hip_flexion_r", "knee_angle_r"), [(t, 1, 2) for t in times])
    with pytest.raises(FormatError, match=says):
        read_file(path)
