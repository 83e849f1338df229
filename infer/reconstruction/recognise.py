"""Which labels of a file of points are landmarks or markers of a body, and whether the points have a person's size."""

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from muybridge.arrays import FloatArray
from muybridge.errors import FormatError
from muybridge.geometry.landmarks.arrays import Points3D
from muybridge.geometry.landmarks.marker_names import normal
from muybridge.geometry.landmarks.marker_sets import MarkerSet
from muybridge.geometry.landmarks.real_markers import find_markers
from muybridge.geometry.landmarks.sets import BODY23
from muybridge.geometry.skeleton.aliases import (
    joint_centres_of,
    map_body,
    map_surface,
    nearest_names,
    one_of_several,
    subject_of,
)
from muybridge.geometry.skeleton.joint_regressions import landmarks_from_markers
from muybridge.geometry.triangulation.plausibility import trunk_of
from muybridge.motion.formats.points.common import UNIT_NAMES
from muybridge.motion.formats.points.person import STATURES, stature_of
from muybridge.motion.formats.registry import ReadOptions, can_use, read_file

_FEWEST_LABELS = 6


@dataclass(frozen=True, eq=False)
class RecognisedPoints:
    """Points of a file as landmarks of a body.

    Attributes:
        points: landmarks of BODY23.
        used: the file's labels of the points that were used.
        unused: the other labels.
        how: one sentence on how the labels were recognised.
        columns: marker of SURFACE -> column of the file's points; empty where these are landmarks.
        whose: one sentence on the chosen subject, where the file has several.
        notes: other sentences for the user: what is left out, and which labels are unknown.
        centres: joint of `geometry.skeleton.body.BODY` -> column of the joint centre that the file has for it.
    """

    points: Points3D
    used: tuple[str, ...]
    unused: tuple[str, ...]
    how: str
    columns: Mapping[str, int] = field(default_factory=dict)
    whose: str = ""
    notes: tuple[str, ...] = ()
    centres: Mapping[str, int] = field(default_factory=dict)


def recognise(
    path: Path, points: Points3D, computed: Collection[str] = (), markers: MarkerSet | None = None
) -> RecognisedPoints:
    """Landmarks of BODY23 from a file's points, by their labels.

    Args:
        path: of the file, for messages.
        points: what it holds.
        computed: labels that the file lists as computed from markers; they are no markers.
        markers: the set that the file's labels are of; without it, all sets that are known.

    Raises:
        FormatError: too few labels are known; the message lists what is there.
    """
    names = points.landmarks.names
    kinds = find_markers(names, computed)
    real = [i for i in range(len(names)) if kinds.marker[i] and np.isfinite(points.points_world[:, i, 0]).any()]
    plain = [names[i] for i in real]
    body = {} if markers else {name: real[i] for name, i in map_body(plain).items()}
    surface = {name: real[i] for name, i in (_of_set(plain, markers) if markers else map_surface(plain)).items()}
    if len(body) < _FEWEST_LABELS and len(surface) < _FEWEST_LABELS:
        known = f"labels of the set {markers.name}" if markers else (
            "known landmarks or markers (nose, LShoulder, left_hip, RKnee, ...; LASI, RKNE, ...)")  # fmt: skip
        unknown = [name for i, name in zip(real, plain, strict=True) if i not in {*body.values(), *surface.values()}]
        message = (
            f"{path}: of {len(names)} labels ({', '.join(names[:6])}, ...) only {max(len(body), len(surface))} are "
        )
        raise FormatError(message + "; ".join([known, *nearest_names(unknown), *([kinds.note] if kinds.note else [])]),
                          remedy="rename_labels", path=path)  # fmt: skip
    if len(body) >= len(surface):
        mapped, columns, skin = _body_landmarks(points, body), set(body.values()), {}
        how = f"{len(body)} landmarks by their names"
    else:
        mapped, columns, skin = landmarks_from_markers(points, surface), set(surface.values()), surface
        count = int(np.isfinite(mapped.points_world).any(axis=(0, 2)).sum())
        how = f"{count} landmarks from {len(surface)} markers"
    used = tuple(n for i, n in enumerate(names) if i in columns)
    unused = tuple(n for i, n in enumerate(names) if i not in columns)
    notes = [kinds.note] if kinds.note else []
    subjects = {subject_of(name) for name in used}
    strange = [n for i, n in enumerate(names) if i in real and i not in columns and subject_of(n) in subjects]
    if skin and strange:
        shown = ", ".join(strange[:8]) + (f" and {len(strange) - 8} more" if len(strange) > 8 else "")
        notes.append(f"markers that were not used, because no set has a body point for them: {shown}")
    return RecognisedPoints(mapped, used, unused, how, skin, one_of_several(names, sorted(columns)), tuple(notes),
                            joint_centres_of(names))  # fmt: skip


def _of_set(names: Sequence[str], markers: MarkerSet) -> dict[str, int]:
    """Point of SURFACE -> index in `names`, by the labels of one set, without its markers beside their points."""
    point = {normal(label): name for label, name in zip(markers.labels, markers.names, strict=True)
             if label not in markers.near}  # fmt: skip
    out: dict[str, int] = {}
    for i, name in enumerate(names):
        if (key := normal(name)) in point:
            out.setdefault(point[key], i)
    return out


def _body_landmarks(points: Points3D, columns: Mapping[str, int]) -> Points3D:
    shape = (len(points.points_world), len(BODY23), 3)
    xyz, covariance = np.full(shape, np.nan), np.full((*shape, 3), np.nan)
    for landmark, column in columns.items():
        xyz[:, BODY23.index(landmark)] = points.points_world[:, column]
        covariance[:, BODY23.index(landmark)] = points.covariance_world[:, column]
    none = (0, *shape[:2])
    return replace(points, landmarks=BODY23, points_world=xyz, covariance_world=covariance,
                   residual_px=np.empty(none), inlier=np.empty(none, dtype=np.bool_))  # fmt: skip


def check_size(
    path: Path, recognised: RecognisedPoints, options: ReadOptions, markers: MarkerSet | None = None
) -> float:
    """The person's stature in metres; NaN where it is unknown.

    Args:
        path: the file.
        recognised: its points.
        options: how it was read.
        markers: the set that its labels are of, where it was named.

    Raises:
        FormatError: no person has this height; the message has the likely unit of the file's numbers.
    """
    stature = stature_of(recognised.points.points_world)
    if not np.isfinite(stature) or STATURES[0] <= stature <= STATURES[1]:
        return stature
    message = f"{path}: the person would be {stature:,.4g} m tall"
    for unit in UNIT_NAMES if can_use(path, "units") else ():
        try:
            other = read_file(path, replace(options, units=unit)).positions
        except FormatError:  # beyond any room in this unit
            continue
        if STATURES[0] <= stature_of(recognise(path, other, (), markers).points.points_world) <= STATURES[1]:
            message += f"; the file's numbers are likely {UNIT_NAMES[unit]}"
            raise FormatError(message, remedy="unit_of_points", unit=unit)
    raise FormatError(f"{message}; no usual unit makes that a person: are the labels right?")


def tilt_deg(points_world: FloatArray) -> float:
    """Median angle between the trunk and up, degrees; 0 where it is unknown.

    Args:
        points_world: (T, 23, 3) of BODY23.
    """
    trunk = trunk_of(points_world, BODY23)
    length = np.linalg.norm(trunk, axis=-1)
    known = np.isfinite(length) & (length > 1e-6)
    if not known.any():
        return 0.0
    return float(np.degrees(np.median(np.arccos(np.clip(trunk[known, 2] / length[known], -1, 1)))))
