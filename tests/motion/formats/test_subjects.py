"""Files with several people's labels, and recordings that begin at other times."""

import numpy as np
import pytest

from muybridge.geometry.landmarks.arrays import Points3D
from muybridge.geometry.landmarks.marker_sets import PLUG_IN_GAIT
from muybridge.geometry.landmarks.sets import BODY23, LandmarkSet
from muybridge.geometry.skeleton.aliases import map_body, map_surface, one_of_several, subject_of
from muybridge.infer.commands.app import run_command
from muybridge.infer.pipelines.compare import compare_points
from muybridge.infer.reconstruction.recognise import recognise
from muybridge.motion.formats.points.c3d import C3DTake, write_c3d
from muybridge.motion.formats.points.csv import write_csv
from muybridge.motion.formats.points.trc import write_trc


def make_points(names, frames=12, seed=0):
    xyz = np.random.default_rng(seed).normal(0, 1, (frames, len(names), 3))
    none = np.empty((0, *xyz.shape[:2]))
    return Points3D(LandmarkSet("m", tuple(names), ()), xyz, np.full((*xyz.shape, 3), np.nan), none,
                    none.astype(bool), 50.0)  # fmt: skip


@pytest.mark.parametrize("between", [":", "_"])
def test_markers_of_two_people_are_never_mixed(tmp_path, between):
    labels = PLUG_IN_GAIT.labels
    names = [f"{who}{between}{label}" for label in labels for who in ("Anna", "Bob")]
    names.remove(f"Anna{between}LASI")
    found = map_surface(names)
    assert len(found) == len(labels) and all(names[i].startswith("Bob") for i in found.values())
    said = one_of_several(names, list(found.values()))
    assert "Anna (38), Bob (39)" in said and "taken are those of Bob" in said
    labelled = recognise(tmp_path / "a.c3d", make_points(names))
    assert labelled.whose == said and all(name.startswith("Bob") for name in labelled.used)
    alone = [n for n in names if n.startswith("Anna")] + ["*12", "*13"]
    assert one_of_several(alone, list(map_surface(alone).values())) == ""


def test_landmarks_of_two_people_are_never_mixed():
    names = [*(f"A:{n}" for n in BODY23.names[:12]), *(f"B:{n}" for n in BODY23.names)]
    assert map_body(names) == {n: 12 + i for i, n in enumerate(BODY23.names)}
    assert "taken are those of B" in one_of_several(names, list(map_body(names).values()))


def test_whom_a_label_belongs_to():
    told = {"Anna:LASI": "Anna", "LASI": "", "Anna_LASI": "Anna", "left_asis": "", "left_hip": "",
            "T:Anna_LASI": "T:Anna", "mixamorig:LeftArm": "mixamorig"}  # fmt: skip
    assert {name: subject_of(name) for name in told} == told


def test_of_two_people_one_is_compared_with_one():
    both = make_points([f"{who}:{label}" for label in PLUG_IN_GAIT.labels for who in ("Anna", "Bob")])
    bob = make_points(PLUG_IN_GAIT.labels)
    bob.points_world[:] = both.points_world[:, ::2]
    found = compare_points(both, bob, called=("both.c3d", "one.c3d"))
    assert np.nanmax(found.distance_m) == 0 and len(found.names) == 39
    assert len(found.notices) == 1 and found.notices[0].startswith("both.c3d: its labels are of several subjects")
    found = compare_points(both, both)
    assert len(found.names) == 78 and not found.notices


def test_markers_without_points_are_not_counted(tmp_path):
    points = make_points(PLUG_IN_GAIT.labels)
    points.points_world[:, :4] = np.nan
    labelled = recognise(tmp_path / "a.c3d", points)
    assert "from 35 markers" in labelled.how and labelled.unused == PLUG_IN_GAIT.labels[:4]


def test_recordings_that_begin_at_other_times_are_told_apart(tmp_path, capfd):
    points = make_points(("a", "b", "c"), 100)
    write_trc(tmp_path / "a.trc", points)
    write_csv(tmp_path / "a.csv", points)
    write_c3d(tmp_path / "late.c3d", C3DTake(points, 26))
    for one, other, shift in (("a.trc", "late.c3d", 0.5), ("late.c3d", "a.csv", -0.5)):
        assert run_command(["compare", str(tmp_path / one), str(tmp_path / other)]) == 0
        assert f"--shift {shift:.3f}" in capfd.readouterr().err
        told = ["compare", str(tmp_path / one), str(tmp_path / other), "--shift", str(shift)]
        assert run_command(told) == 0
        said = capfd.readouterr()
        assert said.err == "" and "75 frames" in said.out
    text = (tmp_path / "a.trc").read_text().split("\n")
    head = [*text[:2], text[2].replace("\t100\t", "\t50\t"), *text[3:6]]
    (tmp_path / "b.trc").write_text("\n".join([*head, *text[56:]]))
    for name in ("late.c3d", "b.trc"):
        assert run_command(["compare", str(tmp_path / name), str(tmp_path / name)]) == 0
        assert capfd.readouterr().err == ""
    assert run_command(["compare", str(tmp_path / "a.trc"), str(tmp_path / "b.trc")]) == 0
    assert "--shift 1.000" in capfd.readouterr().err
