"""Labelled points to a solved skeleton: what a file holds, its size, the fit, and the results."""

import json
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from muybridge.arrays import FloatArray
from muybridge.errors import FormatError
from muybridge.geometry.fitting.body_fit import BodyFit
from muybridge.geometry.fitting.marker_fit import MarkerFit
from muybridge.geometry.fitting.subject import MarkerFitOptions
from muybridge.geometry.triangulation.plausibility import trunk_of

# Metres: nobody who stands is outside; children from two years on are inside.
_STATURES = (0.75, 2.60)
_FEWEST = 6
# So many markers tell a body by themselves.
MARKERS = 12
Units = Literal["m", "cm", "mm"]
Up = Literal["y", "z"]
Method = Literal["auto", "markers", "landmarks"]
Centres = Literal["midpoint", "plane", "harrington", "bell", "davis", "functional"]
MOTION_BVH, MOTION_GLB, MOTION_MOT = "motion.bvh", "motion.glb", "motion.mot"
LANDMARKS_TRC, LANDMARKS_C3D, FACTS = "landmarks.trc", "landmarks.c3d", "solve.json"
RESULTS = (MOTION_BVH, MOTION_GLB, MOTION_MOT, LANDMARKS_TRC, LANDMARKS_C3D, FACTS)


@dataclass(frozen=True, eq=False)
class Labelled:
    """Points as the body knows them.

    Attributes:
        points: of BODY23.
        used: what the file calls the points that were used.
        unused: the others.
        how: one sentence on how they were understood.
        columns: marker of SURFACE -> column of the file's points; empty where these are landmarks.
        whose: one sentence on whose they are, where the file has several people's.
    """

    points: Any
    used: tuple[str, ...]
    unused: tuple[str, ...]
    how: str
    columns: dict[str, int] = field(default_factory=dict)
    whose: str = ""


if TYPE_CHECKING:
    from muybridge.infer.networks.correction import SolverNetwork


def open_corrector(network: Path | None, correct: bool, centres: tuple[str, ...]) -> "SolverNetwork | None":
    """The network that corrects, if one does: what `centres` say about joints is not corrected unasked."""
    from muybridge.infer.networks.correction import SolverNetwork
    from muybridge.models.shipped import shipped_model

    if not correct or (centres and network is None):
        return None
    return SolverNetwork(network or shipped_model("solver"))


def fit_marker_file(
    path: Path, labelled: Labelled, points: Any, centres: tuple[str, ...], options: MarkerFitOptions,
    corrector: "SolverNetwork | None",
) -> MarkerFit:  # fmt: skip
    from muybridge.geometry.fitting.marker_fit import fit_markers
    from muybridge.geometry.landmarks.marker_sets import SURFACE
    from muybridge.geometry.skeleton.joint_centres import centres_from_markers
    from muybridge.infer.networks.correction import corrected

    if not labelled.columns:
        raise FormatError(f"{path}: --method markers needs labelled markers on the skin, and {labelled.how}")
    chosen = points.points_world[:, list(labelled.columns.values())]
    surface = np.array([SURFACE.index(n) for n in labelled.columns])
    known = centres_from_markers(points.points_world, labelled.columns, centres)
    fit = fit_markers(chosen, surface, points.fps, options, known)
    return fit if corrector is None else corrected(fit, chosen, corrector)


def understand(path: Path, points: Any) -> Labelled:
    """Landmarks of BODY23 out of a file's points, by their names.

    Raises:
        FormatError: too few names are understood; the message lists what is there.
    """
    from dataclasses import replace

    from muybridge.geometry.landmarks.sets import BODY23
    from muybridge.geometry.skeleton.aliases import map_body, map_surface, one_of_several
    from muybridge.geometry.skeleton.joint_regressions import landmarks_from_markers

    names = points.landmarks.names
    body, surface = ({n: i for n, i in known(names).items() if _ever(points, i)} for known in (map_body, map_surface))
    if len(body) < _FEWEST and len(surface) < _FEWEST:
        known = "nose, LShoulder, left_hip, RKnee, ...; LASI, RKNE, ..."
        raise FormatError(
            f"{path}: of {len(names)} labels ({', '.join(names[:6])}, ...) only {max(len(body), len(surface))} are "
            f"landmarks or markers we know ({known}); rename them, or name unlabelled points with `muybridge label`"
        )
    if len(body) >= len(surface):
        shape = (len(points.points_world), len(BODY23), 3)
        xyz, covariance = np.full(shape, np.nan), np.full((*shape, 3), np.nan)
        for landmark, column in body.items():
            xyz[:, BODY23.index(landmark)] = points.points_world[:, column]
            covariance[:, BODY23.index(landmark)] = points.covariance_world[:, column]
        none = (0, *shape[:2])
        mapped = replace(points, landmarks=BODY23, points_world=xyz, covariance_world=covariance,
                         residual_px=np.empty(none), inlier=np.empty(none, dtype=np.bool_))  # fmt: skip
        columns, how = set(body.values()), f"{len(body)} landmarks by their names"
    else:
        mapped = landmarks_from_markers(points, surface)
        told = int(np.isfinite(mapped.points_world).any(axis=(0, 2)).sum())
        columns, how = set(surface.values()), f"{told} landmarks from {len(surface)} markers"
    used = tuple(n for i, n in enumerate(names) if i in columns)
    skin = {} if len(body) >= len(surface) else surface
    unused = tuple(n for i, n in enumerate(names) if i not in columns)
    return Labelled(mapped, used, unused, how, skin, one_of_several(names, sorted(columns)))


def _ever(points: Any, column: int) -> bool:
    return bool(np.isfinite(points.points_world[:, column, 0]).any())


def stature_of(points_world: FloatArray) -> float:
    """Metres: the height that the median lengths of trunk and limbs ask for; NaN where none is known.

    Args:
        points_world: (T, 23, 3) of BODY23.
    """
    from muybridge.geometry.landmarks.sets import BODY23
    from muybridge.geometry.skeleton.body import SHAPE_PRIOR

    pairs = {"upper_arm": ("shoulder", "elbow"), "forearm": ("elbow", "wrist"), "thigh": ("hip", "knee"),
             "shin": ("knee", "ankle"), "trunk": ("hip", "shoulder")}  # fmt: skip
    found = []
    for part, (a, b) in pairs.items():
        for side in ("left", "right"):
            bone = points_world[:, BODY23.index(f"{side}_{a}")] - points_world[:, BODY23.index(f"{side}_{b}")]
            length = np.linalg.norm(bone, axis=-1)
            if np.isfinite(length).any():
                found.append(float(np.nanmedian(length)) / SHAPE_PRIOR[part][0])
    return float(np.median(found)) if found else float("nan")


def check_size(path: Path, labelled: Labelled, options: Any) -> float:
    """The person's stature in metres, if it can be one.

    Raises:
        FormatError: nobody is as tall; the message has the unit that the file's numbers are likely in.
    """
    from dataclasses import replace

    from muybridge.motion.formats.registry import can_use, read_file

    stature = stature_of(labelled.points.points_world)
    if not np.isfinite(stature) or _STATURES[0] <= stature <= _STATURES[1]:
        return stature
    likely = []
    for unit in ("m", "cm", "mm") if can_use(path, "units") else ():
        other = read_file(path, replace(options, units=unit)).positions
        if _STATURES[0] <= stature_of(understand(path, other).points.points_world) <= _STATURES[1]:
            likely.append(unit)
    words = {"m": "metres", "cm": "centimetres", "mm": "millimetres"}
    hint = (f"the file's numbers are likely {words[likely[0]]}: give --units {likely[0]}" if likely
            else "no usual unit makes that a person: are the labels right?")  # fmt: skip
    raise FormatError(f"{path}: the person would be {stature:,.4g} m tall; {hint}")


def tilt_deg(points_world: FloatArray) -> float:
    """Median angle between the trunk and up; 0 where it is not known."""
    from muybridge.geometry.landmarks.sets import BODY23

    trunk = trunk_of(points_world, BODY23)
    length = np.linalg.norm(trunk, axis=-1)
    known = np.isfinite(length) & (length > 1e-6)
    if not known.any():
        return 0.0
    return float(np.degrees(np.median(np.arccos(np.clip(trunk[known, 2] / length[known], -1, 1)))))


def solve_facts(
    path: Path, labelled: Labelled, fitted: BodyFit | MarkerFit, stature: float, notices: list[str],
    names: tuple[str, ...], centres: tuple[str, ...],
) -> dict[str, Any]:  # fmt: skip
    from muybridge import __version__

    def percentiles(residual: FloatArray) -> dict[str, float | None]:
        known = residual[np.isfinite(residual)] * 1e3
        return {
            "median": round(float(np.median(known)), 3) if known.size else None,
            "p95": round(float(np.percentile(known, 95)), 3) if known.size else None,
        }

    skeleton = fitted.motion.skeleton
    return {
        "muybridge": __version__,
        "points": path.name,
        "understood": labelled.how,
        "method": "markers" if isinstance(fitted, MarkerFit) else "landmarks",
        "joint_centres": list(centres),
        "labels_used": labelled.used,
        "labels_unused": labelled.unused,
        "notices": notices,
        "frames": len(fitted.motion),
        "fps": fitted.motion.fps,
        "stature_m": round(fitted.body.stature_m, 4),
        "stature_of_points_m": round(stature, 4) if np.isfinite(stature) else None,
        "bone_lengths_m": {n: round(float(v), 5) for n, v in zip(skeleton.names, skeleton.bone_lengths, strict=True)},
        "noise_scale": round(fitted.noise_scale, 4),
        "coverage": round(float(np.isfinite(fitted.residual_m).mean()), 4),
        "residual_mm": percentiles(fitted.residual_m),
        "residual_mm_by_landmark": {n: percentiles(fitted.residual_m[:, j]) for j, n in enumerate(names)},
    }


def write(output: Any, fitted: BodyFit | MarkerFit, facts: dict[str, Any]) -> None:
    from muybridge.geometry.fitting.body_fit import landmarks_from_motion
    from muybridge.geometry.landmarks.arrays import Points3D
    from muybridge.geometry.landmarks.sets import BODY23
    from muybridge.motion.formats.gltf.write import write_glb
    from muybridge.motion.formats.points.c3d import write_c3d
    from muybridge.motion.formats.points.trc import write_trc
    from muybridge.motion.formats.skeletal.bvh import write_bvh
    from muybridge.motion.formats.skeletal.mot import write_mot

    places = landmarks_from_motion(fitted.motion, fitted.body, BODY23)
    none = (0, *places.shape[:2])
    body = Points3D(BODY23, places, np.full((*places.shape, 3), np.nan), np.empty(none),
                    np.empty(none, dtype=np.bool_), fitted.motion.fps)  # fmt: skip
    output.write(MOTION_BVH, lambda path: write_bvh(path, fitted.motion))
    output.write(MOTION_GLB, lambda path: write_glb(path, fitted.motion))
    output.write(MOTION_MOT, lambda path: write_mot(path, fitted.motion))
    output.write(LANDMARKS_TRC, lambda path: write_trc(path, body))
    output.write(LANDMARKS_C3D, lambda path: write_c3d(path, body))
    output.write_text(FACTS, json.dumps(facts, indent=2, ensure_ascii=False, allow_nan=False) + "\n")
