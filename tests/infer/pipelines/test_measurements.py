"""A subject's measurements in C3D files: found, and nonsense left out."""

from pathlib import Path

import numpy as np
import pytest

from muybridge.geometry.skeleton.joint_centres import Measurements
from muybridge.infer.reconstruction.measurements import measurements_of


def c3d_with(path: Path, processing: dict[str, float], subjects: int = 1) -> Path:
    import ezc3d

    file = ezc3d.c3d()
    file["parameters"]["POINT"]["RATE"]["value"] = [100.0]
    file["parameters"]["POINT"]["LABELS"]["value"] = ("LKNE",)
    points = np.ones((4, 1, 3))
    file["data"]["points"] = points
    file.add_parameter("SUBJECTS", "USED", [subjects])
    for name, value in processing.items():
        file.add_parameter("PROCESSING", name, [value])
    file.write(str(path))
    return path


def test_measurements_of_a_gait_model_are_read_in_metres(tmp_path: Path) -> None:
    found = measurements_of(c3d_with(tmp_path / "a.c3d", {
        "InterAsisDistance": 227.0, "LLegLength": 886.0, "RLegLength": 884.0, "LKneeWidth": 109.0, "RAnkleWidth": 63.0,
        "Marker Diameter": 14.0, "Bodymass": 73.4,
    }))  # fmt: skip
    assert found.asis_width == pytest.approx(0.227) and found.marker_diameter == pytest.approx(0.014)
    assert found.leg_length == {"left": pytest.approx(0.886), "right": pytest.approx(0.884)}
    assert found.knee_width == {"left": pytest.approx(0.109)} and found.ankle_width == {"right": pytest.approx(0.063)}
    assert found.elbow_width == {}


def test_numbers_that_no_person_has_are_left_out(tmp_path: Path) -> None:
    wrong = {"InterAsisDistance": 0.0, "LLegLength": 88.6, "LKneeWidth": 1090.0, "RAnkleWidth": -63.0}
    assert measurements_of(c3d_with(tmp_path / "a.c3d", wrong)) == Measurements()


def test_of_several_subjects_nobody_knows_whose_they_are(tmp_path: Path) -> None:
    assert measurements_of(c3d_with(tmp_path / "a.c3d", {"LKneeWidth": 109.0}, 2)) == Measurements()


def test_other_files_have_none(tmp_path: Path) -> None:
    assert measurements_of(tmp_path / "a.trc") == Measurements()
