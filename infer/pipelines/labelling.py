"""From a file of unlabelled points to labelled markers, files and a report."""

from __future__ import annotations

import json
import math
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from muybridge.arrays import BoolArray, FloatArray
from muybridge.errors import FormatError
from muybridge.geometry.landmarks.arrays import Points3D
from muybridge.geometry.landmarks.marker_sets import MarkerPlan
from muybridge.geometry.landmarks.sets import LandmarkSet
from muybridge.geometry.markers.cleaning import Cleaned, CleanOptions, Sample, clean_markers
from muybridge.infer.labelling.corrections import apply_corrections, read_corrections
from muybridge.infer.labelling.label import Labelled, LabelOptions, label_points, relabel
from muybridge.infer.networks.labelling import LabelNetwork
from muybridge.infer.report.labelling_facts import label_json
from muybridge.infer.report.labelling_page import render_label_report
from muybridge.infer.results.folder import open_output
from muybridge.models.shipped import shipped_model
from muybridge.motion.formats.points.c3d import C3DTake, take_of, write_c3d
from muybridge.motion.formats.points.common import check_fps
from muybridge.motion.formats.points.marker_protocol import find_marker_set
from muybridge.motion.formats.points.unlabelled import MarkerCloud, read_marker_cloud

FILES = ("labelled.c3d", "label.json", "report.html")
CORRECTIONS = "corrections.txt"
CERTAIN = 0.9
# With fewer points than this share of the set, another set may have been worn.
FEW = 0.8


def run_label(file: Path, out: Path, markerset: str, corrections: Path | None, model: Path | None, fps: float | None,
              overwrite: bool, options: LabelOptions, clean: CleanOptions) -> str:  # fmt: skip
    """Label a file of points.

    Args:
        file: the points.
        out: the results folder.
        markerset: the set's name, or a file.
        corrections: by a person; None for those in the results folder, if any.
        model: labelling network; None for the shipped one.
        fps: frames per second, where the file does not state it.
        overwrite: replace files that muybridge did not write.
        options: of the labelling.
        clean: of spikes and gaps.

    Returns:
        A summary of some lines.

    Raises:
        MuybridgeError: of some kind, for everything that the user can fix.
    """
    plan = find_marker_set(markerset)
    check_fps(fps)
    cloud = read_marker_cloud(file, fps)
    if not (math.isfinite(cloud.fps) and cloud.fps > 0):
        raise FormatError(f"{file}: does not state its frames per second; give --fps")
    rate = cloud.fps
    chosen = corrections or (out / CORRECTIONS if (out / CORRECTIONS).is_file() else None)
    lines = read_corrections(chosen) if chosen else []
    network = LabelNetwork(model or shipped_model("labels"))
    folder = open_output(out, FILES, [file], overwrite)
    try:
        labelled = label_points(cloud.points, rate, plan.markers, network, options, plan.distances, stated_up(cloud),
                                cloud.names)  # fmt: skip
    except FormatError as error:
        raise FormatError(f"{file}: {error}") from None
    corrected: list[str] = []
    by_hand = np.zeros(labelled.column.shape, bool)
    if chosen:
        before = labelled.column
        label, corrected = apply_corrections(labelled.label, labelled.tracks.column, lines, plan.markers.labels,
                                             cloud.names, chosen)  # fmt: skip
        labelled = relabel(labelled, label)
        by_hand = labelled.column != before
        if chosen != out / CORRECTIONS:
            folder.write(CORRECTIONS, lambda path: path.write_bytes(chosen.read_bytes()))
    cleaned = clean_markers(labelled.points, rate, clean, by_hand)
    content = label_json(labelled, cleaned, cloud.names, rate, file.name, notes_of(cloud, labelled, plan), corrected,
                         _figures(labelled))  # fmt: skip
    folder.write("labelled.c3d", lambda path: _write(path, cloud, labelled, cleaned, rate))
    folder.write_text("label.json", json.dumps(content, allow_nan=False))
    folder.write_text("report.html", render_label_report(labelled, cleaned, content))
    return summary(content, out)


def stated_up(cloud: MarkerCloud) -> FloatArray | None:
    """(3,) the axis that a C3D states as up (`POINT:Y_SCREEN`); None where it states none."""
    said = (cloud.c3d.texts("POINT", "Y_SCREEN") or [""])[0].strip().upper() if cloud.c3d is not None else ""
    axis = "XYZ".find(said[-1:]) if said else -1
    if axis < 0 or said[:-1] not in ("", "+", "-"):
        return None
    up: FloatArray = np.eye(3)[axis] * (-1.0 if said[0] == "-" else 1.0)
    return up


def exchanged(cloud: MarkerCloud, labelled: Labelled) -> list[tuple[str, str]]:
    """Pairs of the set's labels whose names the file has exchanged, by what was found."""
    names = [n.split(":")[-1] for n in cloud.names]
    labels = labelled.markers.labels
    found = {}
    for m, label in enumerate(labels):
        column = labelled.column[:, m]
        column = column[column >= 0]
        if len(column):
            found[label] = names[int(np.bincount(column).argmax())]
    return [(a, b) for a, b in found.items() if a < b and found.get(b) == a]


def _figures(labelled: Labelled) -> dict[str, Any]:
    found = np.isfinite(labelled.points[..., 0])
    sure = labelled.confidence[found] >= CERTAIN
    return {"markers_found": int(found.any(0).sum()), "sure": _share(sure)}


def _share(sure: BoolArray) -> float:
    """Share that is true to four digits: 1 only where all are."""
    return math.floor(float(sure.mean()) * 1e4) / 1e4 if sure.size else 0.0


def notes_of(cloud: MarkerCloud, labelled: Labelled, plan: MarkerPlan) -> list[str]:
    """Notices for the user, as sentences."""
    notes = [*cloud.notices, *labelled.notes]
    found = np.isfinite(labelled.points[..., 0]).any(0)
    lost = [plan.markers.labels[i] for i in np.nonzero(~found & ~plan.optional)[0]]
    if lost:
        notes.append(f"not found: {', '.join(lost)}")
    usual = float(np.median((labelled.tracks.track >= 0).sum(1)))
    if usual < FEW * len(plan.markers) and len(lost) > 4:
        notes.append(f"frames have about {usual:.0f} points, the set {len(plan.markers)} markers: "
                     "if another set was worn, name it with --markerset")  # fmt: skip
    if (up := up_of(labelled)) not in ("+Y", "+Z"):
        notes.append(f"{up} is up in the file; labelled.c3d is rotated so that +Z is up")
    if pairs := exchanged(cloud, labelled):
        notes.append("the file has these names exchanged, by where its markers are: "
                     + ", ".join(f"{a} and {b}" for a, b in pairs))  # fmt: skip
    if cloud.why:
        notes.append(cloud.why)
    if cloud.empty:
        notes.append(f"{len(cloud.empty)} trajectories of the file are empty")
    return notes


def summary(content: dict[str, Any], out: Path) -> str:
    """What the command prints."""
    doubtful = len(content["doubtful"])
    lines = [
        f"{content['markers_found']} of {len(content['markers'])} markers of {content['marker_set']} found; "
        f"{math.floor(content['sure'] * 1e3) / 10:.1f}% of the names are at least {CERTAIN:.0%} certain, "
        f"{doubtful} {'span is' if doubtful == 1 else 'spans are'} doubtful",
        *content["notes"],
        *content["corrections"],
    ]
    if doubtful:
        lines.append(f"see {out / 'report.html'} and settle them with --corrections")
    return "\n".join([*lines, f"results: {out}"])


def _write(path: Path, cloud: MarkerCloud, labelled: Labelled, cleaned: Cleaned, fps: float) -> None:
    """The markers and the rest of the file in the file's axes; with Z up where C3D cannot state those axes."""
    points = as_points(labelled, cleaned, fps)
    up = up_of(labelled)
    turn = np.eye(3) if up in ("+Y", "+Z") else labelled.turn
    points = replace(points, points_world=points.points_world @ turn.T)
    take = C3DTake(points) if cloud.c3d is None else take_of(cloud.c3d, points, cloud.metres * labelled.factor, turn)
    write_c3d(path, take, "y" if up == "+Y" else "z")


def up_of(labelled: Labelled) -> str:
    """The axis of the file that points up, such as -Z."""
    axis = int(np.argmax(np.abs(labelled.turn[2])))
    return f"{'+' if labelled.turn[2, axis] > 0 else '-'}{'XYZ'[axis]}"


def as_points(labelled: Labelled, cleaned: Cleaned, fps: float) -> Points3D:
    """The labelled markers as points of a file, in the axes of the file they come from.

    Measured samples have a standard deviation of a millimetre, filled ones an unknown one: in a C3D file the former
    have the residual 1, the latter 0, which marks interpolated samples.
    """
    count, size = cleaned.points.shape[:2]
    names = LandmarkSet(labelled.markers.name, labelled.markers.labels, ())
    measured = (cleaned.sample == Sample.MEASURED)[..., None, None]
    covariance = np.where(measured, 1e-6 * np.eye(3), np.nan)
    nobody = np.empty((0, count, size))
    return Points3D(names, cleaned.points, covariance, nobody, nobody.astype(bool), fps)
