"""`run.json` of every kind of run against its JSON Schema; the runs are those of small staged takes."""

import re
from pathlib import Path

import jsonschema
import numpy as np
import pytest

from muybridge.geometry.landmarks.arrays import Points3D
from muybridge.geometry.landmarks.sets import BODY23
from muybridge.infer.commands.app import run_command
from muybridge.infer.results.record import FORMAT, read_schema
from muybridge.motion.formats.points.trc import write_trc
from tests.run_record import check_record
from tests.staged_people import person


def test_the_schema_is_valid_and_strict() -> None:
    schema = read_schema()
    jsonschema.Draft202012Validator.check_schema(schema)
    validator = jsonschema.Draft202012Validator(schema)
    assert [e for e in validator.iter_errors({"format": FORMAT, "kind": "videos"})]
    assert [e for e in validator.iter_errors({"unheard-of": 1})]


def test_a_run_on_videos(make_session, staged, tmp_path: Path) -> None:
    take = make_session(frames=12, width=160, height=120)
    done = staged("run", take, "--out", tmp_path / "out", "--everyone", "--refine-cameras", "--quiet")
    assert done.returncode == 0, done.stderr
    record = check_record(tmp_path / "out", "videos")
    assert record["session"]["frames"] == record["frames"] == 12 and record["quality"]["coverage"] > 0.9


@pytest.mark.parametrize("more", [[], ["--fps", "50"]])
def test_solving_a_file_of_points(tmp_path: Path, more: list[str]) -> None:
    xyz = person(20)
    none = (0, *xyz.shape[:2])
    points = Points3D(BODY23, xyz, np.full((*xyz.shape, 3), np.nan), np.empty(none), np.empty(none, bool), 25.0)
    write_trc(tmp_path / "p.trc", points)
    out = tmp_path / "out"
    assert run_command(["solve", str(tmp_path / "p.trc"), "--out", str(out), *more]) == 0
    record = check_record(out, "points")
    assert record["body"]["method"] == "landmarks" and record["file"]["name"] == "p.trc"
    assert not record["stages"]["body"]["resumed"] and record["problems"] == []
    page = (out / "report.html").read_text(encoding="utf-8")
    assert "from where the fitted body has it" in page and "Camera by camera" not in page
    assert not re.search(r"\bnan\b", page.split("<script")[0], re.IGNORECASE)
    # The same again is read from the results folder; what an earlier version left there goes.
    assert run_command(["solve", str(tmp_path / "p.trc"), "--out", str(out), *more]) == 0
    assert check_record(out, "points")["stages"]["body"]["resumed"]
