"""Files of unnamed points, marker sets of one's own, corrections."""

from dataclasses import replace

import numpy as np
import pytest

from muybridge.errors import FormatError
from muybridge.geometry.landmarks.marker_sets import SETS, SURFACE, MarkerDistances, plan_of
from muybridge.infer.labelling.corrections import apply_corrections, read_corrections
from muybridge.motion.formats.points.marker_protocol import find_marker_set, read_marker_set, write_marker_set
from muybridge.motion.formats.points.unlabelled import read_marker_cloud

ezc3d = pytest.importorskip("ezc3d")


def save_c3d(path, names, points_mm, unit="mm", rate=100.0, analog=0, **lists):
    """A C3D by ezc3d's own means; missing points have residual -1."""
    file = ezc3d.c3d()
    parameters = file["parameters"]["POINT"]
    parameters["LABELS"]["value"] = list(names)
    parameters["RATE"]["value"] = [rate]
    parameters["UNITS"]["value"] = [unit]
    for key, value in lists.items():
        file.add_parameter("POINT", key, value)
    data = np.ones((4, len(names), len(points_mm)))
    data[:3] = np.nan_to_num(points_mm).transpose(2, 1, 0)
    file["data"]["points"] = data
    residual = np.where(np.isfinite(points_mm[..., 0]), 0.0, -1.0).T[None]
    file["data"]["meta_points"]["residuals"] = residual
    file["data"]["meta_points"]["camera_masks"] = np.zeros((7, *residual.shape[1:]), bool)
    if analog:
        file["parameters"]["ANALOG"]["RATE"]["value"] = [rate]
        file["parameters"]["ANALOG"]["LABELS"]["value"] = [f"A{i}" for i in range(analog)]
        file["data"]["analogs"] = np.zeros((1, analog, len(points_mm)))
    file.write(str(path))


@pytest.fixture
def points():
    return np.random.default_rng(0).normal(1000, 300, (12, 8, 3))


def test_a_c3d_gives_its_points_and_leaves_out_what_is_none(tmp_path, points):
    points[:, 3] = np.nan
    points[5, 0] = np.nan
    names = ["S:LASI", "U2", "U3", "U4", "LHipAngles", "made_up", "LGroundReactionForce", "U8"]
    save_c3d(tmp_path / "a.c3d", names, points, ANGLES=["made_up"])
    cloud = read_marker_cloud(tmp_path / "a.c3d")
    assert cloud.names == ("S:LASI", "U2", "U3", "U8") and cloud.fps == 100 and cloud.unit == "mm"
    assert cloud.left_out == ("LHipAngles", "made_up", "LGroundReactionForce") and cloud.empty == ("U4",)
    expected = points[:, [0, 1, 2, 7]] / 1000
    np.testing.assert_allclose(cloud.points, expected, atol=1e-6)


def test_labels_that_are_all_equal_are_no_hindrance(tmp_path, points):
    save_c3d(tmp_path / "a.c3d", ["M"] * 8, points)
    assert read_marker_cloud(tmp_path / "a.c3d").names == ("M",) * 8


@pytest.mark.parametrize("unit, factor", [("mm", 1), ("cm", 0.1), ("m", 0.001)])
def test_units_become_metres(tmp_path, points, unit, factor):
    save_c3d(tmp_path / "a.c3d", [f"U{i}" for i in range(8)], points * factor, unit)
    np.testing.assert_allclose(read_marker_cloud(tmp_path / "a.c3d").points, points / 1000, rtol=1e-6)


def bad_files(folder, points):
    """Each kind of bad input with what its message must say."""
    names = [f"U{i}" for i in range(8)]
    save_c3d(folder / "empty.c3d", names, points * np.nan)
    save_c3d(folder / "analog.c3d", [], np.zeros((10, 0, 3)), analog=4)
    save_c3d(folder / "angles.c3d", ["LKneeAngles", "RKneeAngles"], points[:, :2])
    save_c3d(folder / "unit.c3d", names, points, unit="furlong")
    save_c3d(folder / "whole.c3d", names, points)
    whole = (folder / "whole.c3d").read_bytes()
    (folder / "cut.c3d").write_bytes(whole[: len(whole) - 700])
    (folder / "header.c3d").write_bytes(whole[:300])
    (folder / "text.c3d").write_text("no C3D at all")
    (folder / "names.csv").write_text("frame,time\n1,0\n")
    (folder / "word.csv").write_text("a_x,a_y,a_z\n1,2,three\n")
    (folder / "headonly.csv").write_text("a_x,a_y,a_z\n")
    (folder / "void.csv").write_text("")
    (folder / "points.xyz").write_text("")
    return {"empty.c3d": "holds no points", "analog.c3d": "analog", "angles.c3d": "no markers", "unit.c3d": "furlong",
            "cut.c3d": "cut off", "header.c3d": "C3D", "text.c3d": "C3D", "names.csv": "names no points",
            "word.csv": "line 2", "headonly.csv": "no frames", "void.csv": "empty", "points.xyz": "valid are",
            "absent.c3d": "no such file"}  # fmt: skip


def test_bad_files_are_refused_with_what_is_wrong(tmp_path, points):
    for name, what in bad_files(tmp_path, points).items():
        with pytest.raises(FormatError, match=what) as caught:
            read_marker_cloud(tmp_path / name)
        assert name in str(caught.value)


def test_csv_with_a_header_and_vicons_export(tmp_path, points):
    head = "Frame,Time," + ",".join(f"U{i} {c} (mm)" for i in range(8) for c in "XYZ")
    rows = [f"{t},{t / 50}," + ",".join(f"{v:.6f}" for v in frame.ravel()) for t, frame in enumerate(points)]
    rows[2] = "2,0.04," + "," * 23
    (tmp_path / "a.csv").write_text("\n".join([head, *rows]))
    cloud = read_marker_cloud(tmp_path / "a.csv")
    assert cloud.fps == pytest.approx(50) and cloud.names[7] == "U7" and np.isnan(cloud.points[2]).all()
    np.testing.assert_allclose(cloud.points[3:], points[3:] / 1000, atol=1e-8)

    lines = ["Trajectories", "120", ",," + ",,,".join(f"S:*{i}" for i in range(8)) + ",,",
             "Frame,Sub Frame" + ",X,Y,Z" * 8, "," + ",mm" * 24]  # fmt: skip
    lines[4] = "," + lines[4]
    lines += [f"{t + 1},0," + ",".join(f"{v:.6f}" for v in frame.ravel()) for t, frame in enumerate(points)]
    (tmp_path / "v.csv").write_text("\n".join(lines) + "\n")
    cloud = read_marker_cloud(tmp_path / "v.csv")
    assert cloud.fps == 120 and cloud.unit == "mm" and cloud.names[0] == "S:*0"
    np.testing.assert_allclose(cloud.points, points / 1000, atol=1e-8)


def test_known_sets_stand_on_points_of_the_body_and_have_twins():
    assert {name: len(s) for name, s in SETS.items()} == {
        "pig39": 39, "pig37": 37, "pig35": 35, "pig43": 43, "cmu41": 41, "lower16": 16, "lower22": 22,
        "gait2354": 41, "rajagopal": 44, "opencap": 37}  # fmt: skip
    for markers in SETS.values():
        plan = plan_of(markers)
        assert set(markers.names) <= set(SURFACE.names) and len(set(markers.names)) == len(markers)
        for i, twin in enumerate(plan.twins):
            assert plan.twins[twin] == i
            sided = markers.labels[i][0] in "LRr" and markers.labels[i] not in ("RBAK", "RBAC")
            assert (twin == i) == (not sided)


def test_a_set_of_ones_own_round_trips(tmp_path):
    text = "# ours\nA1 left_asis\nA2 right_asis mirror=A1 jitter=20\nC c7 optional\nD t10\nE left_heel\nF right_heel\n"
    (tmp_path / "our.txt").write_text(text)
    plan = find_marker_set(str(tmp_path / "our.txt"))
    assert plan.markers.labels == ("A1", "A2", "C", "D", "E", "F") and plan.twins == (1, 0, 2, 3, 5, 4)
    assert plan.jitter_m[1] == 0.02 and plan.optional.tolist() == [False, False, True, False, False, False]
    write_marker_set(tmp_path / "again.txt", plan, "the same")
    again = read_marker_set(tmp_path / "again.txt")
    assert again.markers.labels == plan.markers.labels and again.markers.names == plan.markers.names
    assert again.twins == plan.twins and np.array_equal(again.optional, plan.optional)


@pytest.mark.parametrize("text, what", [
    ("LASI left_hip\n", "line 1: no body point 'left_hip'"), ("LASI\n", "is alone on its line"),
    ("A c7\nB c7\n", "line 2: 'c7' appears twice"), ("A c7 colour=red\n", "colour=red"),
    ("A c7 jitter=-3\n", "jitter"), ("A c7\nB t10\n", "at least 6"),
    ("distance A B 3\n", "line 7: 3 words after"), ("distance A Q 3 1\n", "line 7: Q, of a distance"),
    ("distance A A 3 1\n", "line 7: a distance from A"), ("distance A B 9e9 1\n", "line 7: the distance, 9e9"),
    ("distance A B 30 x\n", "line 7: the spread, x"), ("Z near=3 c7\n", "line 7: no body point 'near=3'"),
    ("Z crown near=3\n", "line 7: 'near=3' is not"), ("\0\n", "line 7: '.x00' is alone"),
    ("A c7 mirror=Z\nB t10\nC left_asis\nD right_asis\nE left_heel\nF right_heel\n", "mirror of A"),
])  # fmt: skip
def test_faults_of_a_set_are_named_with_their_line(tmp_path, text, what):
    six = "A c7\nB t10\nC left_asis\nD right_asis\nE left_heel\nF right_heel\n"
    (tmp_path / "our.txt").write_text(six + text if "line 7" in what else text)
    with pytest.raises(FormatError, match=what) as caught:
        read_marker_set(tmp_path / "our.txt")
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("content", [b"\xff\xfe\x00\xd8", b"\x89PNG\r\n\x1a\n" + bytes(range(256)), b""])
def test_what_is_no_text_is_refused_as_a_set_and_as_corrections(tmp_path, content):
    (tmp_path / "our.txt").write_bytes(content)
    with pytest.raises(FormatError, match="our.txt: "):
        read_marker_set(tmp_path / "our.txt")
    if content:
        with pytest.raises(FormatError, match="our.txt: "):
            read_corrections(tmp_path / "our.txt")


def test_a_set_of_one_person_keeps_distances_and_what_is_beside_its_point(tmp_path):
    mean = np.full((16, 16), np.nan)
    mean[0, 1] = mean[1, 0] = 0.2431
    markers = replace(SETS["lower16"], near=("LTHI", "RTHI"))
    plan = replace(plan_of(markers), distances=MarkerDistances(mean, mean / 100))
    write_marker_set(tmp_path / "one.txt", plan)
    again = read_marker_set(tmp_path / "one.txt")
    assert again.markers.near == ("LTHI", "RTHI") and again.optional.tolist() == plan.optional.tolist()
    np.testing.assert_allclose(again.distances.mean_m, mean, atol=5e-5)
    np.testing.assert_allclose(again.distances.sigma_m, mean / 100, atol=5e-5)
    (tmp_path / "d.txt").write_text("distance c7\n" + "\n".join(f"{p} {p}" for p in SURFACE.names[6:12]))
    assert read_marker_set(tmp_path / "d.txt").markers.labels[0] == "distance", "a label like any other"


def test_the_example_of_the_docs_is_a_set(repository, tmp_path):
    text = (repository / "docs" / "guides" / "label-markers.md").read_text()
    (tmp_path / "our.txt").write_text("# Leg set" + text.split("# Leg set")[1].split("```")[0])
    plan = find_marker_set(str(tmp_path / "our.txt"))
    assert len(plan.markers) == 8 and plan.jitter_m[2] == 0.06 and plan.optional.sum() == 2


def test_an_unknown_set_suggests_one():
    with pytest.raises(FormatError, match="did you mean pig39"):
        find_marker_set("pg39")


LABELS, NAMES = ("LWRA", "LWRB", "LTOE"), ("*1", "*2", "*3", "*4")


def correct_joints(tmp_path, text, label, column=None):
    (tmp_path / "c.txt").write_text(text)
    column = np.tile(np.arange(label.shape[1]), (len(label), 1)) if column is None else column
    return apply_corrections(label, column, read_corrections(tmp_path / "c.txt"), LABELS, NAMES, tmp_path / "c.txt")


def test_corrections_exchange_delete_and_name(tmp_path):
    label = np.tile([0, 1, 2, -1], (10, 1))
    text = "# settled\n2-4 LWRA LWRB\n2-4 LWRB LWRA\n5 LTOE delete\n7-9 *4 LTOE\n"
    out, said = correct_joints(tmp_path, text, label)
    assert out[3].tolist() == [1, 0, 2, -1] and out[5].tolist() == [0, 1, -1, -1]
    assert out[8].tolist() == [0, 1, -1, 2] and out[0].tolist() == [0, 1, 2, -1]  # who bore the name loses it
    assert said[0] == "LWRA called LWRB in 3 frames" and len(said) == 4
    assert label[3].tolist() == [0, 1, 2, -1]


@pytest.mark.parametrize("text, what", [
    ("1-2 LWRA\n", "line 1: 2 words"), ("5-2 LWRA LWRB\n", "backwards"), ("x LWRA LWRB\n", "no range"),
    ("1 LWRA NOSE\n", "no label 'NOSE'"), ("1 NOSE LWRA\n", "neither a label"), ("99 LWRA delete\n", "beyond the last"),
])  # fmt: skip
def test_faulty_corrections_are_named_with_their_line(tmp_path, text, what):
    with pytest.raises(FormatError, match=what):
        correct_joints(tmp_path, text, np.tile([0, 1, 2, -1], (10, 1)))
