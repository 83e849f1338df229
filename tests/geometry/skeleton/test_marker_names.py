"""Names of markers in many sets, and what in a file is no marker."""

import pytest

from muybridge.geometry.landmarks.marker_names import map_names, side_of_label, surface_of
from muybridge.geometry.landmarks.marker_sets import SETS, SURFACE
from muybridge.geometry.landmarks.real_markers import find_markers
from muybridge.geometry.landmarks.sets import BODY23
from muybridge.geometry.skeleton.aliases import joint_centres_of, map_body, map_surface, nearest_names, subject_of
from muybridge.geometry.skeleton.profiles import PROFILES
from muybridge.motion.formats.points.c3d_read import read_raw_c3d
from tests.paths import DATA

WALK = DATA / "markers" / "walk_force_plates.c3d"


@pytest.mark.parametrize("name", [
    "RASI", "rasi", "R.ASIS", "R_ASIS", "r asis", "R-ASIS", "Right ASIS", "RightASIS", "ASIS_R", "asis.right", "RASIS",
    "Bob:RASI", "Bob_RASI", "T:Bob_RASI", "RASI1", "RASI_2", "r.ASIS_study", "right_asis",
])  # fmt: skip
def test_spellings_of_one_marker(name):
    assert surface_of(name) == "right_asis" and side_of_label(name) in ("right", "")


@pytest.mark.parametrize("name, meant", [
    ("V.Sacral", "sacrum"), ("R.Wrist.Med", "right_ulnar_styloid"), ("Top.Head", "crown"), ("L.Toe.Tip", "left_hallux"),
    ("RLFC", "right_knee_lateral"), ("LMFC", "left_knee_medial"), ("LLMAL", "left_malleolus_lateral"),
    ("LMMAL", "left_malleolus_medial"), ("LMED", "left_malleolus_medial"), ("RFAradius", "right_radial_styloid"),
    ("LCAL", "left_heel"), ("CLAV", "sternal_notch"), ("r_knee_study", "right_knee_lateral"),
    ("L_mknee_study", "left_knee_medial"), ("r_lelbow_study", "right_elbow_lateral"), ("L_calc_study", "left_heel"),
    ("L_FAL", "left_malleolus_lateral"), ("CV7", "c7"), ("KneeMedR", "right_knee_medial"), ("T10", "t10"),
    ("LTHI", "left_thigh_distal"), ("RTHI", "right_thigh_proximal"), ("T12", None), ("L5", None), ("RKJC", None),
    ("RTH3", None), ("R.Thigh.Front", None), ("LElbow", None), ("Nose", None), ("left_hip", None), ("LeftArm", None),
])  # fmt: skip
def test_names_of_other_sets(name, meant):
    assert surface_of(name) == meant


def test_a_joints_name_is_a_markers_among_markers_only():
    opensim = [label for label in SETS["gait2354"].labels if label not in SETS["gait2354"].near]
    assert map_surface(opensim)["right_elbow_lateral"] == opensim.index("R.Elbow")
    assert len(map_surface(opensim)) == 33
    assert set(map_names(BODY23.names)) == {"left_heel", "right_heel"}, "points of both sets"
    assert not map_names(["LShoulder", "RShoulder", "LElbow", "LHeel", "RKnee", "Neck"])
    for profile, names in PROFILES.items():
        assert len(map_names(list(names.values()))) <= 2, f"joints of {profile} are no markers"


def test_of_two_names_for_one_point_the_plain_one_counts():
    assert map_names(["LTHI2", "LTHI"]) == {"left_thigh_distal": 1} and map_names(["LTHI2"]) == {"left_thigh_distal": 0}


def test_every_set_is_known_by_its_own_labels():
    for name, markers in SETS.items():
        meant = {label: point for label, point in zip(markers.labels, markers.names, strict=True)
                 if label not in markers.near}  # fmt: skip
        assert {label: surface_of(label, True) for label in meant} == meant, name
        assert set(markers.near) <= set(markers.labels)


def test_prefixes_of_subjects_are_no_part_of_names():
    told = {"Anna_LASI": "Anna", "Anna:R.ASIS": "Anna", "R_ASIS": "", "R_Elbow": "", "L_knee_study": "", "V_Sacral": ""}
    assert {name: subject_of(name) for name in told} == told


@pytest.mark.parametrize("name", [
    "LKneeAngles", "Bob:LAbsAnkleAngle", "LPelvisAnglesROT", "PELAng", "LEFT_ANKLE_ANGLE", "LHipMoment", "RKneePower",
    "LGroundReactionForce", "LNormalisedGRF", "FP1_COP", "LKJC", "RHJC_study", "R.Tib.KJC", "CentreOfMass", "PelvisCOM",
    "Total_CoM", "CentreOfMassFloor", "l_thigh_4X4", "V_Pelvis_Origin", "V_Mid_ASIS", "virtual_1",
])  # fmt: skip
def test_outputs_are_no_markers(name):
    kinds = find_markers(["LASI", name])
    assert kinds.marker.tolist() == [True, False] and name in kinds.note


@pytest.mark.parametrize("name", [
    "V.Sacral", "V_Sacral", "LScapAngle", "RTOO", "COMB", "LTIP", "CLAV", "*12", "Unlabelled3", "Scop", "Vertex",
    *SETS["pig43"].labels, *SETS["rajagopal"].labels, *SETS["opencap"].labels, *SETS["gait2354"].labels, *SURFACE.names,
])  # fmt: skip
def test_markers_are_not_taken_for_outputs(name):
    assert find_markers([name]).marker.all()


def test_axes_come_in_fours_and_unnamed_points_are_told_apart():
    names = [f"{who}:{segment}{axis}" for who in "AB" for segment in ("PEL", "LFE") for axis in "OALP"]
    del names[-1]
    kinds = find_markers([*names, "*7", "LASI", "made"], ["made"])
    assert kinds.marker.tolist() == [False] * 12 + [True] * 3 + [True, True, False]
    assert kinds.unnamed.tolist() == [False] * 15 + [True, False, False]
    assert kinds.note.endswith(
        "12 segment axes (A:PELO, A:PELA, A:PELL, A:PELP, ...); made (outputs listed in the file)"
    )
    assert find_markers(["LASI"]).note == "" and len(find_markers([]).marker) == 0


def test_a_recording_with_all_outputs_has_its_18_markers():
    if not WALK.is_file():
        pytest.skip("../shared/data is not here")
    names = read_raw_c3d(WALK).texts("POINT", "LABELS")
    real = [name for name, kept in zip(names, find_markers(names).marker, strict=True) if kept]
    assert real == names[36:54] and not map_body(real)
    assert joint_centres_of(names) == {"left_shin": 92, "right_shin": 93, "left_foot": 94, "right_foot": 95}


def test_nearest_names():
    assert nearest_names(["RAZI", "P7"]) == ["the nearest known names are RASI for RAZI"] and not nearest_names(["P7"])
