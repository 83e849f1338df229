"""What `muybridge label` does: read, name, write."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np

from muybridge.errors import FormatError, MuybridgeError
from muybridge.geometry.landmarks import CMU, PLUG_IN_GAIT, LandmarkSet, MarkerSet, Points3D
from muybridge.infer.label_network import LabelNetwork
from muybridge.infer.labelling import Labelled, LabelOptions, label_points
from muybridge.infer.outputs import open_output
from muybridge.models.label_card import shipped_labels
from muybridge.motion.formats.c3d import write_c3d
from muybridge.motion.formats.marker_cloud import MarkerCloud, read_marker_cloud

FILES = ("labelled.c3d",)
SETS = {"pig39": PLUG_IN_GAIT, "cmu41": CMU}


def run_label(file: Path, out: Path, markerset: str, model: Path | None, fps: float | None, overwrite: bool,
              options: LabelOptions) -> str:  # fmt: skip
    """Labels `file` into the folder `out`; returns what to tell the user."""
    markers = find_set(markerset)
    cloud = read_marker_cloud(file)
    rate = rate_of(file, cloud, fps)
    folder = open_output(out, FILES, [file], overwrite)
    try:
        labelled = label_points(cloud.points, rate, markers, LabelNetwork(model or shipped_labels()), options)
    except FormatError as error:
        raise FormatError(f"{file}: {error}") from None
    folder.write("labelled.c3d", lambda path: write_c3d(path, as_points(labelled, rate)))
    found = np.isfinite(labelled.points[..., 0])
    lines = [f"{int(found.any(0).sum())} of {len(markers)} markers found, {found.mean():.1%} of their samples"]
    return "\n".join([*lines, *labelled.notes, f"results: {out}"])


def find_set(name: str) -> MarkerSet:
    """A marker set by name."""
    if name not in SETS:
        raise MuybridgeError(f"no marker set {name!r}; known: {', '.join(SETS)}")
    return SETS[name]


def rate_of(file: Path, cloud: MarkerCloud, fps: float | None) -> float:
    """Frames a second, as given or as the file says."""
    rate = cloud.fps if fps is None else fps
    if not (math.isfinite(rate) and rate > 0):
        raise FormatError(f"{file}: does not say how many frames it has a second; give --fps")
    return rate


def as_points(labelled: Labelled, fps: float) -> Points3D:
    """The named markers as points of a file."""
    count, size = labelled.points.shape[:2]
    names = LandmarkSet(labelled.markers.name, labelled.markers.labels, ())
    nothing = np.full((count, size, 3, 3), np.nan)
    return Points3D(names, labelled.points, nothing, np.empty((0, count, size)), np.empty((0, count, size), bool), fps)
