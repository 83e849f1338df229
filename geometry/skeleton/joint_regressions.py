"""Where the landmarks of BODY23 are, given markers on the skin: joint centres from published regressions.

Each joint's centre is found frame by frame from the markers about it. Where a limb has a marker on one side only, the
centre lies half a joint's width inward from it. What is guessed rather than known (a face from a head band, a toe's tip
from its root) has a large covariance, so that the body fitted to all of it may put it elsewhere.

Sources: hips: M. E. Harrington and others, "Prediction of the hip joint centre in adults, children, and patients with
cerebral palsy based on magnetic resonance imaging", Journal of Biomechanics 40, 2007; shoulders: G. Rab, K. Petuskey,
A. Bagley, "A method for determination of upper extremity kinematics", Gait & Posture 15, 2002; knees and ankles: the
chord construction of R. B. Davis and others, "A gait analysis data collection and reduction technique", Human Movement
Science 10, 1991, with half widths for adults from C. C. Gordon and others, 2012 Anthropometric Survey of U.S. Army
Personnel.
"""

from dataclasses import dataclass, field

import numpy as np

from muybridge.arrays import FloatArray
from muybridge.geometry.landmarks.arrays import Points3D
from muybridge.geometry.landmarks.sets import BODY23
from muybridge.geometry.skeleton.hinge_axes import across, chord, unit

# Metres from the middle of a marker (7 mm above the skin) to the middle of the joint.
_HALF_WIDTH = {"knee": 0.062, "ankle": 0.044, "elbow": 0.042}
# Metres, standard deviation of a coordinate: of a joint's centre, and of what is little more than a guess.
_SIGMA = {"hip": 0.015, "shoulder": 0.015, "elbow": 0.012, "wrist": 0.008, "knee": 0.010, "ankle": 0.008,
          "heel": 0.010, "big_toe": 0.020, "small_toe": 0.020, "ear": 0.030, "eye": 0.035, "nose": 0.035}  # fmt: skip


@dataclass
class _Markers:
    """Markers by their name in SURFACE; what the set does not have is NaN."""

    points: FloatArray
    index: dict[str, int]
    found: dict[str, FloatArray] = field(default_factory=dict)

    def __getitem__(self, name: str) -> FloatArray:
        i = self.index.get(name)
        return np.full((len(self.points), 3), np.nan) if i is None else self.points[:, i]

    def middle(self, *names: str) -> FloatArray:
        """The mean of several, all of which must be there."""
        return np.asarray(np.mean([self[n] for n in names], axis=0))


def landmarks_from_markers(points: Points3D, index: dict[str, int]) -> Points3D:
    """The points of BODY23 that the markers determine, with their covariance.

    Args:
        points: (T, M, 3) metres; NaN where missing.
        index: marker of SURFACE -> its column in `points` (see `landmark_names.map_surface`).

    Returns:
        Points of BODY23; NaN where the markers needed are not there.
    """
    markers = _Markers(points.points_world, index)
    out = {name: np.full((len(points.points_world), 3), np.nan) for name in BODY23.names}
    pelvis = _pelvis(markers)
    for side, sign in (("left", 1.0), ("right", -1.0)):
        out[f"{side}_hip"] = _hip(pelvis, sign)
        _leg(markers, out, side, pelvis[1][..., 0] * sign)
        _arm(markers, out, side, sign)
    _head(markers, out)
    xyz = np.stack([out[n] for n in BODY23.names], axis=1)
    sigma = np.array([next(s for k, s in _SIGMA.items() if n.endswith(k)) for n in BODY23.names])
    covariance = np.where(np.isfinite(xyz[..., :1, None]), np.eye(3) * sigma[:, None, None] ** 2, np.nan)
    none = (0, *xyz.shape[:2])
    return Points3D(BODY23, xyz, covariance, np.empty(none), np.empty(none, dtype=np.bool_), points.fps)


def _or(first: FloatArray, second: FloatArray) -> FloatArray:
    return np.where(np.isfinite(first), first, second)


def _pelvis(markers: _Markers) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """Middle of the front spines (T, 3), axes left, up, forward as columns (T, 3, 3), width and depth (T,)."""
    left, right = markers["left_asis"], markers["right_asis"]
    back = _or(markers.middle("left_psis", "right_psis"), markers["sacrum"])
    front = (left + right) / 2
    to_left = unit(left - right)
    forward = unit(across(front - back, to_left))
    axes = np.stack([to_left, np.cross(forward, to_left), forward], axis=-1)
    # Widths are one for the take: markers slip, bones do not.
    width, depth = (np.nanmedian(np.linalg.norm(d, axis=-1)) if np.isfinite(d).any() else np.nan
                    for d in (left - right, front - back))  # fmt: skip
    return front, axes, np.asarray(width), np.asarray(depth)


def _hip(pelvis: tuple[FloatArray, FloatArray, FloatArray, FloatArray], sign: float) -> FloatArray:
    front, axes, width, depth = pelvis
    local = np.array([sign * (0.33 * width + 0.0073), -0.30 * width - 0.0109, -0.24 * depth - 0.0099])
    return np.asarray(front + axes @ local)


def _leg(markers: _Markers, out: dict[str, FloatArray], side: str, outward: FloatArray) -> None:
    hip, knee_marker = out[f"{side}_hip"], markers[f"{side}_knee_lateral"]
    thigh = _or(markers[f"{side}_thigh_distal"], markers[f"{side}_thigh_proximal"])
    shank = _or(markers[f"{side}_shank_distal"], markers[f"{side}_shank_proximal"])
    inside = markers[f"{side}_knee_medial"]
    # A marker on the side of the thigh determines the rotation of the leg; the pelvis, where it was placed by eye.
    to_side = unit(across(thigh - hip, unit(knee_marker - hip)))
    outward = np.where(np.isfinite(to_side), to_side + outward, outward)
    knee = chord(hip, knee_marker, outward, _HALF_WIDTH["knee"])
    knee = _or((knee_marker + inside) / 2, knee)
    ankle_marker, inside = markers[f"{side}_malleolus_lateral"], markers[f"{side}_malleolus_medial"]
    outward = unit(knee_marker - knee)
    to_side = unit(across(shank - knee, unit(ankle_marker - knee)))
    outward = np.where(np.isfinite(to_side), to_side + outward, outward)
    ankle = _or((ankle_marker + inside) / 2, chord(knee, ankle_marker, outward, _HALF_WIDTH["ankle"]))
    heel, toe = markers[f"{side}_heel"], markers[f"{side}_toe"]
    out |= {f"{side}_knee": knee, f"{side}_ankle": ankle, f"{side}_heel": heel}
    # The roots of the toes are at 73 and 63 % of the foot, their tips at 98 and 82.
    out[f"{side}_big_toe"] = _or(markers[f"{side}_hallux"], toe + 0.34 * (toe - heel))
    fifth = markers[f"{side}_metatarsal_5"]
    out[f"{side}_small_toe"] = fifth + 0.30 * (fifth - heel)


def _arm(markers: _Markers, out: dict[str, FloatArray], side: str, sign: float) -> None:
    left, right = markers["left_acromion"], markers["right_acromion"]
    trunk_up = unit(
        _or(markers.middle("c7", "sternal_notch"), (left + right) / 2)
        - _or(markers.middle("t10", "xiphoid"), markers.middle("left_asis", "right_asis"))
    )
    between = np.linalg.norm(left - right, axis=-1)
    drop = 0.17 * (np.nanmedian(between) if np.isfinite(between).any() else 0.36)
    shoulder = markers[f"{side}_acromion"] - drop * trunk_up
    wrist = markers.middle(f"{side}_radial_styloid", f"{side}_ulnar_styloid")
    outside, inside = markers[f"{side}_elbow_lateral"], markers[f"{side}_elbow_medial"]
    # A bent elbow's axis is at right angles to both its bones; of a straight one little is known.
    turn = np.cross(unit(outside - shoulder), unit(wrist - outside)) * sign
    bent = np.clip(np.linalg.norm(turn, axis=-1, keepdims=True) / 0.3, 0.0, 1.0)
    elbow = outside + bent * _HALF_WIDTH["elbow"] * unit(turn)
    out |= {f"{side}_shoulder": shoulder, f"{side}_wrist": wrist}
    out[f"{side}_elbow"] = _or((outside + inside) / 2, _or(elbow, outside))


def _head(markers: _Markers, out: dict[str, FloatArray]) -> None:
    """From four markers of a band about the forehead; how high it sits is not known."""
    front, back = (markers.middle(f"left_{end}_head", f"right_{end}_head") for end in ("front", "back"))
    to_left = unit(markers["left_front_head"] - markers["right_front_head"])
    forward = unit(across(front - back, to_left))
    up = np.cross(forward, to_left)
    middle = (front + back) / 2
    out["nose"] = front + 0.055 * forward - 0.09 * up
    for side, sign in (("left", 1.0), ("right", -1.0)):
        out[f"{side}_eye"] = front + sign * 0.032 * to_left + 0.02 * forward - 0.05 * up
        out[f"{side}_ear"] = middle + sign * 0.075 * to_left - 0.07 * up
