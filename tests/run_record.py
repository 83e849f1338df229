"""`run.json` of a results folder, checked."""

import json
from pathlib import Path
from typing import Any

import jsonschema

from muybridge.infer.results.record import FORMAT, read_schema


def check_record(out: Path, kind: str) -> dict[str, Any]:
    """The record, if it is valid and names the files that are there."""
    record: dict[str, Any] = json.loads((out / "run.json").read_text(encoding="utf-8"))
    validator = jsonschema.Draft202012Validator(read_schema())
    assert not [f"{e.json_path}: {e.message}" for e in validator.iter_errors(record)]
    assert record["format"] == FORMAT and record["kind"] == kind
    assert {p.name for p in out.iterdir()} - {"work"} == set(record["results"])
    return record
