"""Joint centres and flexion of `muybridge solve` against a laboratory's own model and against the markers themselves.

Usage: python -m scripts.benchmarks.markers.recorded_joints [FILE ...] [--centres harrington midpoint] [--json OUT.json]

Without files: every recording of markers in the shared data. Centres of hips, knees and ankles are compared with those
that the laboratory stored in the same file (Plug-in Gait's outputs LFEP, LFEO or LKJC, LTIO or LAJC), and flexion of
the knee, the angle between the lines from hip to knee and from knee to ankle, with the laboratory's centres and with
its `LKneeAngles`. Elbows have no stored truth: their flexion is compared with the angle that shoulder, elbow and wrist
markers make, and with Plug-in Gait's elbow (chord function) computed from the markers here. Medians over frames.
"""

import argparse
import json
import logging
import tempfile
from pathlib import Path

import numpy as np

from muybridge.arrays import FloatArray
from muybridge.errors import MuybridgeError
from muybridge.geometry.numerics.rotations import matrix_from_quat, swing_twist_from_matrix
from muybridge.geometry.skeleton.aliases import map_surface
from muybridge.geometry.skeleton.motion import Motion
from muybridge.infer.pipelines.solve_points import SolvePointsOptions, solve_points
from muybridge.infer.runtime.progress import Progress
from muybridge.motion.formats.registry import read_file
from scripts.benchmarks.common import DATA

RECORDINGS = (
    "markers/walk_force_plates.c3d", "markers/tennis_serve_pig39.c3d", "markers/tennis_serve_pig39_gaps.c3d",
    "cases/c3d_unsigned_offset/shd01.c3d", "cases/c3d_y_screen_minus_z/CB_Static0001.c3d",
    "cases/solve_opensim_names/subject01_walk1.trc", "cases/trc_double_tabs/static_walk_2.trc",
)  # fmt: skip
# Joint of the body: labels of the laboratory's centre, the first that is there counts.
CENTRES = {"thigh": ("HJC", "FEP"), "shin": ("KJC", "FEO"), "foot": ("AJC", "TIO")}
RADIUS_M, SHOULDER_M, ELBOW_M = 0.007, 0.050, 0.045  # Plug-in Gait's usual measurements of an adult


def flexion_deg(above: FloatArray, joint: FloatArray, below: FloatArray) -> FloatArray:
    """(T,) degrees, 0 for a straight limb."""
    first, second = joint - above, below - joint
    cosine = np.sum(first * second, -1) / np.linalg.norm(first, axis=-1) / np.linalg.norm(second, axis=-1)
    return np.degrees(np.arccos(np.clip(cosine, -1, 1)))


def unit(vectors: FloatArray) -> FloatArray:
    return vectors / np.linalg.norm(vectors, axis=-1, keepdims=True)


def chord(offset: float, above: FloatArray, marker: FloatArray, side: FloatArray) -> FloatArray:
    """Plug-in Gait's CHORD: the centre `offset` from the marker, seen from it at right angles to `above`, in the plane
    of the three points on the side of `side`."""
    reach = marker - above
    length = np.linalg.norm(reach, axis=-1, keepdims=True)
    along = reach / length
    out = side - above
    out = unit(out - np.sum(out * along, -1, keepdims=True) * along)
    sine = offset / length
    return marker + offset * (np.sqrt(1 - sine**2) * out - sine * along)


def plug_in_gait_arm(at: dict[str, FloatArray], side: str) -> tuple[FloatArray, FloatArray, FloatArray] | None:
    """Shoulder, elbow and wrist by Plug-in Gait's upper limb model; None where a marker is not in the set."""
    trunk = ("c7", "t10", "sternal_notch", "xiphoid")
    arm = ("acromion", "elbow_lateral", "radial_styloid", "ulnar_styloid")
    if not all(n in at for n in trunk) or not all(f"{side}_{n}" in at for n in arm):
        return None
    shoulder, elbow, radial, ulnar = (at[f"{side}_{n}"] for n in arm)
    up = unit(at["c7"] + at["sternal_notch"] - at["t10"] - at["xiphoid"])
    forward = unit(at["sternal_notch"] + at["xiphoid"] - at["c7"] - at["t10"])
    origin = at["sternal_notch"] - RADIUS_M * forward
    wand = np.cross(shoulder - origin, forward if side == "left" else -forward)
    wand = wand * np.sign(np.sum(wand * up, -1, keepdims=True))
    joint = chord(SHOULDER_M + RADIUS_M, origin, shoulder, shoulder - wand)
    wrist = (radial + ulnar) / 2
    # The elbow's construction vector is at right angles to the plane of shoulder, elbow and the middle of the wrist.
    normal = np.cross(joint - elbow, wrist - elbow) * (1.0 if side == "left" else -1.0)
    centre = chord(ELBOW_M + RADIUS_M, joint, elbow, elbow - normal)
    return joint, centre, wrist


def raw_points(path: Path) -> dict[str, FloatArray]:
    """All points of a C3D, metres, in its own axes; zeros are missing."""
    import ezc3d

    c3d = ezc3d.c3d(str(path), ignore_bad_formatting=True)
    points = c3d["data"]["points"][:3].transpose(2, 1, 0)
    unit_m = {"m": 1.0, "cm": 0.01}.get(str(c3d["parameters"]["POINT"]["UNITS"]["value"][0]), 1e-3)
    points = np.where(np.all(points == 0, -1, keepdims=True), np.nan, points) * unit_m
    return {str(n): points[:, i] for i, n in enumerate(c3d["parameters"]["POINT"]["LABELS"]["value"])}


def truth_of(path: Path, names: tuple[str, ...], points: FloatArray) -> dict[str, FloatArray]:
    """The laboratory's centres in the axes of `points`, and its knee angles in degrees."""
    if path.suffix != ".c3d":
        return {}
    raw, out = raw_points(path), {}
    common = [(raw[n], points[:, i]) for i, n in enumerate(names) if n in raw]
    first, second = (np.concatenate(part) for part in zip(*common, strict=True))
    known = np.isfinite(first).all(-1) & np.isfinite(second).all(-1)
    turn = np.linalg.lstsq(np.c_[first[known], np.ones(known.sum())], second[known], rcond=None)[0]
    for side in ("left", "right"):
        for joint, labels in CENTRES.items():
            label = next((side[0].upper() + n for n in labels if side[0].upper() + n in raw), None)
            if label and np.isfinite(raw[label]).any():
                out[f"{side}_{joint}"] = np.c_[raw[label], np.ones(len(raw[label]))] @ turn
        if f"{side[0].upper()}KneeAngles" in raw:
            out[f"{side}_knee_deg"] = raw[f"{side[0].upper()}KneeAngles"][:, 0] * 1e3
    return out


def median(values: FloatArray) -> float | None:
    known = values[np.isfinite(values)]
    return round(float(np.median(known)), 1) if known.size else None


def score(path: Path, options: SolvePointsOptions) -> dict[str, float | None]:
    """Medians over frames: distances of centres in mm, differences of flexion in degrees."""
    take = read_file(path, options.read).positions
    with tempfile.TemporaryDirectory() as folder:
        body = solve_points(path, Path(folder) / "out", options, False, Progress(quiet=True)).body
    places = body.motion.joint_positions_world()
    at = dict(zip(body.motion.skeleton.names, np.moveaxis(places, 1, 0), strict=True))
    names = take.landmarks.names
    skin = {n: take.points_world[:, i] for n, i in map_surface(names).items()}
    truth, out = truth_of(path, names, take.points_world), {}
    for side in ("left", "right"):
        knee = flexion_deg(*(at[f"{side}_{j}"] for j in CENTRES))
        for joint, name in zip(CENTRES, ("hip", "knee", "ankle"), strict=True):
            if f"{side}_{joint}" in truth:
                off = at[f"{side}_{joint}"] - truth[f"{side}_{joint}"]
                out[f"{side}_{name}_mm"] = median(1e3 * np.linalg.norm(off, axis=-1))
        if all(f"{side}_{joint}" in truth for joint in CENTRES):
            own = flexion_deg(*(truth[f"{side}_{j}"] for j in CENTRES))
            out[f"{side}_knee_deg"] = median(np.abs(knee - own))
        if f"{side}_knee_deg" in truth:
            out[f"{side}_knee_lab_deg"] = median(np.abs(knee - truth[f"{side}_knee_deg"]))
        out |= _elbow(body.motion, at, skin, side)
    return out


def hinge_deg(motion: Motion, side: str) -> FloatArray:
    """(T,) degrees, the elbow's flexion about its hinge, below 0 where it is hyperextended."""
    joint = motion.skeleton.index(f"{side}_forearm")
    turns = matrix_from_quat(motion.quat_wxyz[:, joint])
    angle = swing_twist_from_matrix(turns, motion.skeleton.twist_axis[joint])[:, 2]
    return np.degrees(-angle if side == "left" else angle)


def _elbow(
    motion: Motion, at: dict[str, FloatArray], skin: dict[str, FloatArray], side: str
) -> dict[str, float | None]:
    needed = [f"{side}_{n}" for n in ("acromion", "elbow_lateral", "radial_styloid", "ulnar_styloid")]
    if any(n not in skin for n in needed):
        return {}
    parts = [at[f"{side}_{j}"] for j in ("upper_arm", "forearm", "hand")]
    solved = flexion_deg(*parts)
    shoulder, elbow, radial, ulnar = (skin[n] for n in needed)
    seen = flexion_deg(shoulder, elbow, (radial + ulnar) / 2)
    out = {f"{side}_elbow_markers_deg": median(np.abs(solved - seen)), f"{side}_elbow_seen_deg": median(seen)}
    # Frames in which the markers show a flexed elbow and the hinge is solved beyond straight.
    bent = seen > 20
    beyond = hinge_deg(motion, side)[bent] < 0
    out[f"{side}_elbow_hyperextended"] = round(float(beyond.mean()), 3) if bent.any() else 0.0
    arm = plug_in_gait_arm(skin, side)
    if arm is not None:
        own = flexion_deg(*arm)
        out[f"{side}_elbow_chord_deg"] = median(np.abs(solved - own))
    return out


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("files", type=Path, nargs="*")
    parser.add_argument("--centres", nargs="*", default=[])
    parser.add_argument("--no-correct", action="store_true")
    parser.add_argument("--json", type=Path)
    given = parser.parse_args()
    logging.disable(logging.WARNING)
    options = SolvePointsOptions(centres=tuple(given.centres), correct=not given.no_correct)
    results: dict[str, dict[str, float | None]] = {}
    for path in given.files or [DATA / name for name in RECORDINGS]:
        try:
            results[path.stem] = score(path, options)
        except MuybridgeError as error:
            print(f"{path.stem}  not solved: {error}", flush=True)
            continue
        print(path.stem, *(f"{key}={value}" for key, value in results[path.stem].items()), sep="  ", flush=True)
    if given.json:
        given.json.write_text(json.dumps(results, indent=1))


if __name__ == "__main__":
    main()
