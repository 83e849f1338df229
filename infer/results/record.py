"""`run.json`: one record for every kind of run, described by `run.schema.json`."""

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from datetime import datetime
from importlib import resources
from typing import Any, Literal

import numpy as np

from muybridge import __version__
from muybridge.infer.results.folder import OutputFolder
from muybridge.infer.results.provenance import machine, stage_facts, versions
from muybridge.infer.runtime.stages import StageResult

RUN = "run.json"
# Version of the schema; a field that changes its meaning or goes raises it, a new optional field does not.
FORMAT = 2
Kind = Literal["videos", "marker_videos", "points"]


@dataclass(frozen=True, kw_only=True)
class RunRecord:
    """What `run.json` says.

    Attributes:
        kind: what went in: videos of people, videos of bright markers, or a file of labelled points.
        started: when the run began.
        seconds: how long it took.
        frames: T.
        fps: frames per second.
        results: names of all files written, `run.json` itself not among them.
        notices: what was assumed or corrected, as sentences.
        problems: what spoils the result, as sentences.
        person: one sentence: who was tracked, and why; empty where there was no choice.
        stages: by name.
        options: resolved options, nested.
        models: metadata of the networks, by purpose.
        quality: figures of the first person; `coverage` is always among them.
        others: number and figures of further people.
        session: the session folder, where one went in; see `provenance.session_facts`.
        file: the file of points, where one went in.
        calibration: diagnosis of the calibration; None where it was not judged.
        markers: figures of labelled markers, where there are any.
        body: figures of a body fitted to markers or landmarks of a file; None otherwise.
        contacts: when the first person's heels and balls of the feet stand; None where there is no motion.
    """

    kind: Kind
    started: datetime
    seconds: float
    frames: int
    fps: float
    results: Sequence[str]
    notices: Sequence[str] = ()
    problems: Sequence[str] = ()
    person: str = ""
    stages: Mapping[str, StageResult] = field(default_factory=dict)
    options: Mapping[str, Any] = field(default_factory=dict)
    models: Mapping[str, Any] = field(default_factory=dict)
    quality: Mapping[str, Any]
    others: Sequence[Mapping[str, Any]] = ()
    session: Mapping[str, Any] | None = None
    file: Mapping[str, Any] | None = None
    calibration: Mapping[str, Any] | None = None
    markers: Mapping[str, Any] | None = None
    body: Mapping[str, Any] | None = None
    contacts: Mapping[str, Any] | None = None


def write_record(output: OutputFolder, record: RunRecord) -> None:
    """Write `run.json`.

    Raises:
        OutputError: it cannot be written.
    """
    content = {
        "format": FORMAT,
        "kind": record.kind,
        "muybridge": __version__,
        "started": record.started.isoformat(timespec="seconds"),
        "seconds": record.seconds,
        "frames": record.frames,
        "fps": record.fps,
        "session": record.session,
        "file": record.file,
        "results": [*record.results, RUN],
        "quality": record.quality,
        "calibration": record.calibration,
        "markers": record.markers,
        "body": record.body,
        "contacts": record.contacts,
        "person": record.person,
        "people": 1 + len(record.others),
        "others": record.others,
        "notices": record.notices,
        "problems": record.problems,
        "stages": stage_facts(record.stages),
        "options": record.options,
        "models": record.models,
        "versions": versions(),
        "machine": machine(),
    }
    output.write_text(RUN, json.dumps(json_value(content), indent=2, ensure_ascii=False, allow_nan=False) + "\n")


def read_schema() -> dict[str, Any]:
    """The JSON Schema of `run.json`."""
    text = resources.files("muybridge.infer.results").joinpath("run.schema.json").read_text(encoding="utf-8")
    schema: dict[str, Any] = json.loads(text)
    return schema


def json_value(value: Any) -> Any:
    """A value as JSON holds it: numbers that are not finite become None or text, paths become text."""
    if isinstance(value, Mapping):
        return {str(k): json_value(v) for k, v in value.items()}
    if isinstance(value, (list, tuple)):
        return [json_value(v) for v in value]
    if isinstance(value, np.ndarray):
        return json_value(value.tolist())
    if isinstance(value, np.generic):
        return json_value(value.item())
    if isinstance(value, float):
        if np.isnan(value):
            return None
        return round(value, 6) if np.isfinite(value) else str(value)
    if value is None or isinstance(value, (str, int, bool)):
        return value
    return str(value)
