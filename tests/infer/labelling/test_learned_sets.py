"""`muybridge markerset from`, and what it writes used by `label` and `solve`."""

import json
import shutil
from dataclasses import replace

import numpy as np
import pytest

from muybridge.errors import FormatError
from muybridge.geometry.landmarks.marker_sets import SETS, SURFACE, MarkerDistances, plan_of
from muybridge.geometry.markers.known_distances import known_rigidity, measure_distances, near_known, open_to_any
from muybridge.infer.commands.app import run_command
from muybridge.infer.labelling.label import label_points
from muybridge.infer.labelling.learn_set import learn_marker_set
from muybridge.infer.labelling.set_evidence import name_evidence, partners_by_name, parts_of
from muybridge.infer.networks.labelling import LabelNetwork
from muybridge.infer.reconstruction.recognise import recognise
from muybridge.models.shipped import shipped_model
from muybridge.motion.formats.points.marker_protocol import read_marker_set, write_marker_set
from muybridge.motion.formats.points.unlabelled import read_marker_cloud
from muybridge.motion.formats.registry import read_file
from tests.paths import DATA

CASES, WALK = DATA / "cases", DATA / "markers" / "walk_force_plates.c3d"
here = pytest.mark.skipif(not CASES.is_dir(), reason="../shared/data is not here")


@pytest.fixture(scope="module")
def network():
    return LabelNetwork(shipped_model("labels"))


def share(found, labels, truth, names):
    """Share of the truth's visible points (mm) that have their names."""
    right = total = 0
    for i, name in enumerate(names):
        seen = np.isfinite(truth[:, i, 0])
        total += seen.sum()
        if name in labels:
            off = np.linalg.norm(found[:, labels.index(name)] * 1000 - truth[:, i], axis=-1)
            right += (off[seen] < 1).sum()
    return right / total


def test_names_say_sides_parts_and_partners():
    labels = ["R_Thigh_Front", "L_Thigh_Front", "Top_Head", "LTHI2", "RTHI2", "LHFTFL"]
    assert [parts_of(name) for name in labels] == [("thigh",), ("thigh",), ("head",), ("thigh",), ("thigh",), ()]
    assert partners_by_name(labels) == [1, 0, 2, 4, 3, 5]
    evidence = name_evidence(labels)
    at = SURFACE.index
    assert evidence[0, at("right_thigh_distal")] > evidence[0, at("right_patella")] > evidence[0, at("right_heel")]
    assert evidence[0, at("right_thigh_distal")] > evidence[0, at("left_thigh_distal")] + 10
    assert evidence[2, at("crown")] > evidence[2, at("left_front_head")]


@here
def test_a_set_of_opensims_names_labels_another_trial(network, tmp_path):
    plan, notes = learn_marker_set(CASES / "markerset_from_wrong" / "learn.c3d", None)
    point = dict(zip(plan.markers.labels, plan.markers.names, strict=True))
    assert len(point) == 41 and len(set(point.values())) == 41
    assert point["R_Temple"] == "right_front_head" and point["V_Sacral"] == "sacrum"
    for label, name in point.items():
        if label[:2] in ("R_", "L_"):
            assert name.startswith({"R": "right_", "L": "left_"}[label[0]]), (label, name)
            twin = plan.markers.labels[plan.twins[plan.markers.labels.index(label)]]
            assert twin == {"R": "L", "L": "R"}[label[0]] + label[1:]
    assert "R_Thigh_Front" in plan.markers.near and "R_ASIS" not in plan.markers.near
    assert any(note.startswith("R_Thigh_Front is on no body point") for note in notes)
    write_marker_set(tmp_path / "set.txt", plan)
    again = read_marker_set(tmp_path / "set.txt")
    cloud = read_marker_cloud(CASES / "markerset_from_wrong" / "pf.c3d")
    truth = np.load(CASES / "markerset_from_wrong" / "pf.npz")
    labelled = label_points(cloud.points, cloud.fps, again.markers, network, known=again.distances)
    assert share(labelled.points, again.markers.labels, truth["points_mm"], truth["names"].tolist()) >= 0.95


@here
def test_no_body_point_is_given_twice(tmp_path):
    plan, notes = learn_marker_set(CASES / "markerset_from_twice" / "learn.c3d", None)
    assert len(set(plan.markers.names)) == len(plan.markers) >= 38
    assert not {"LHFTBA", "TRXO", "PELAng"} & set(plan.markers.labels)
    assert not any("were multiplied" in note for note in notes), "markers in clusters are close together"
    write_marker_set(tmp_path / "set.txt", plan)
    assert read_marker_set(tmp_path / "set.txt").markers.names == plan.markers.names


@here
def test_outputs_beside_the_markers_disturb_nobody(tmp_path, capsys):
    shutil.copy(WALK, tmp_path / "walk.c3d")
    assert run_command(["markerset", "from", str(tmp_path / "walk.c3d"), "--out", str(tmp_path / "set.txt")]) == 0
    said = capsys.readouterr().out
    assert "18 markers" in said and "36 segment axes" in said and "4 joint centres" in said
    command = ["label", str(tmp_path / "walk.c3d"), "--markerset", str(tmp_path / "set.txt"), "--out"]
    assert run_command([*command, str(tmp_path / "o")]) == 0
    assert "left out because they are no markers: 36 segment axes" in capsys.readouterr().out
    before, after = read_marker_cloud(tmp_path / "walk.c3d"), read_marker_cloud(tmp_path / "o" / "labelled.c3d")
    assert set(after.names) == set(before.names) and len(after.names) == 18
    truth = before.points * 1000
    assert share(after.points, after.names, truth, before.names) > 0.99


@here
def test_of_a_files_points_only_markers_are_recognised():
    take = read_file(WALK)
    assert set(take.c3d.modelled) == {"LKJC", "RKJC", "LAJC", "RAJC"}
    found = recognise(WALK, take.positions, take.c3d.modelled)
    assert len(found.used) == 16 and "LTHI2" in found.unused and len(found.centres) == 4
    assert [note.split(":")[0] for note in found.notes] == [
        "left out because they are no markers",
        "markers that were not used, because no set has a body point for them",
    ]
    plan = plan_of(replace(SETS["lower16"], near=("LTHI",)))
    again = recognise(WALK, take.positions, markers=plan.markers)
    assert set(found.used) - set(again.used) == {"LTHI"}, "it is beside its point"
    with pytest.raises(FormatError, match="only 0 are labels of the set gait2354"):
        recognise(WALK, take.positions, markers=replace(SETS["gait2354"], labels=tuple(f"Q{i}" for i in range(41))))


@here
def test_opensims_names_are_recognised_at_once():
    source = CASES / "solve_opensim_names" / "subject01_walk1.trc"
    found = recognise(source, read_file(source).positions)
    assert len(found.columns) == 33 and len(found.unused) == 8
    assert found.columns["right_elbow_lateral"] == 28 and found.columns["sacrum"] == 2


@pytest.mark.slow
@here
def test_solve_uses_markers_only_and_centres_of_the_file_where_asked(tmp_path, capsys):
    centres = {}
    for which in ("", "file"):
        out = tmp_path / f"o{which}"
        assert run_command(["solve", str(WALK), "--out", str(out), *(["--centres", which] if which else [])]) == 0
        facts = json.loads((out / "run.json").read_text())
        assert len(facts["file"]["labels_used"]) == 16 and "PELO" in facts["file"]["labels_unused"]
        centres[which] = facts["body"]["stature_m"]
        assert "no markers: 36 segment axes" in capsys.readouterr().err
    assert centres[""] != centres["file"]


@pytest.mark.slow
@here
def test_opensims_own_file_is_solved(tmp_path, capsys):
    source = CASES / "solve_opensim_names" / "subject01_walk1.trc"
    assert run_command(["solve", str(source), "--out", str(tmp_path / "o")]) == 0
    told = capsys.readouterr()
    assert "14 landmarks from 33 markers" in told.out and "R.Thigh.Front" in told.err
    facts = json.loads((tmp_path / "o" / "run.json").read_text())["body"]
    assert 1.6 < facts["stature_m"] < 1.95 and facts["residual_mm"]["median"] < 4


def test_unnamed_trajectories_and_too_few_are_refused(tmp_path, capsys):
    rows = ["time," + ",".join(f"*{i}_{c}" for i in range(8) for c in "xyz")]
    rows += [",".join(f"{v:.3f}" for v in (t / 50, *np.random.default_rng(t).normal(0, 0.4, 24))) for t in range(20)]
    (tmp_path / "a.csv").write_text("\n".join(rows))
    assert run_command(["markerset", "from", str(tmp_path / "a.csv"), "--out", str(tmp_path / "s.txt")]) == 2
    said = capsys.readouterr().err
    assert "0 of its 8 trajectories have names of markers" in said and len(said.splitlines()) == 1


def test_known_distances_outweigh_the_table_and_wrong_measurements():
    rng = np.random.default_rng(3)
    body = rng.normal(0, 0.4, (7, 3))
    points = np.repeat(body[None], 30, 0) + rng.normal(0, 0.0005, (30, 7, 3))
    points[:, 6] += rng.normal(0, 0.1, (30, 3))
    points[5:, 5] = np.nan
    known = measure_distances(points, links=4)
    assert isinstance(known, MarkerDistances) and np.isnan(known.mean_m[5]).all(), "too few frames"
    table = np.full((7, 7), 0.3), np.full((7, 7), 0.02), np.full((7, 7), 0.2)
    rigid = known_rigidity(known, *table, links=3)
    for marker in range(5):
        assert not {5, 6} & set(rigid.partners[marker]), "what moves with a marker is its partner"
        true = np.linalg.norm(body[rigid.partners[marker]] - body[marker], axis=-1)
        np.testing.assert_allclose(rigid.mean_m[marker], true, atol=2e-3)
    wrong = type(rigid)(rigid.partners, rigid.mean_m + 0.5, rigid.sigma_m)
    np.testing.assert_array_equal(near_known(wrong, rigid).mean_m, rigid.mean_m)
    close = type(rigid)(rigid.partners, rigid.mean_m + 0.01, rigid.sigma_m)
    np.testing.assert_array_equal(near_known(close, rigid).mean_m, close.mean_m)


def test_points_of_no_body_point_are_open_to_any_marker():
    scores = np.log(np.array([[[0.001, 0.009, 0.99], [0.90, 0.05, 0.05]]]))
    opened = open_to_any(scores)
    assert np.allclose(opened[0, 0, :2], scores[0, 0, 2] - np.log(3)) and opened[0, 1, 0] == scores[0, 1, 0]
    assert (opened[..., 2] == scores[..., 2]).all()


def test_the_sets_of_opensims_models_are_listed(capsys):
    assert run_command(["markerset", "list"]) == 0
    out = capsys.readouterr().out
    assert all(name in out for name in SETS)
