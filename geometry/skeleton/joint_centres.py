"""Joint centres from the markers on the skin about them: by construction, by regression, by motion.

- Two markers on either side of a joint: the middle between them.
- Three markers, one beside the joint and one at each end of the limb: half the joint's width inward along the normal of
  the plane that they span (R. Parent, Computer Animation, 3rd edition 2012, chapter 6). A straight limb spans no plane.
- One marker beside a hinge: the chord function with the hinge's axis over the take (`hinge_axes`).
- The hip from the pelvis' four markers: M. E. Harrington and others, Journal of Biomechanics 40, 2007; A. L. Bell,
  R. A. Brand, D. R. Pedersen, Human Movement Science 8, 1989; R. B. Davis and others, Human Movement Science 10, 1991;
  R. Hara and others, Scientific Reports 6, 2016.
- The shoulder below the acromion: G. Rab, K. Petuskey, A. Bagley, Gait & Posture 15, 2002.
- Functionally: where two moving bones stay together (R. M. Ehrig, W. R. Taylor, G. N. Duda, M. O. Heller, Journal of
  Biomechanics 39, 2006: SCoRE), and the common centre of spheres on which markers move (S. S. H. U. Gamage,
  J. Lasenby, Journal of Biomechanics 35, 2002; by distances: W. Gander, G. H. Golub, R. Strebel, BIT 34, 1994).
"""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Literal

import numpy as np

from muybridge.arrays import FloatArray
from muybridge.geometry.skeleton.functional_centres import segment_poses, sphere_centre
from muybridge.geometry.skeleton.hinge_axes import Hinge, chord, outward_of, twisted, unit

HipMethod = Literal["harrington", "bell", "davis", "hara"]


@dataclass(frozen=True, eq=False)
class JointCentres:
    """Joint centres over a take.

    Attributes:
        names: of joints of `geometry.body.BODY` (`left_thigh` begins at the hip).
        points_world: (T, N, 3) metres, NaN where not known. sigma: (N,) metres, standard deviation of a coordinate.
    """

    names: tuple[str, ...] = ()
    points_world: FloatArray = field(default_factory=lambda: np.zeros((0, 0, 3)))
    sigma: FloatArray = field(default_factory=lambda: np.zeros(0))


@dataclass(frozen=True)
class Measurements:
    """What was measured on the subject, metres; markers tell what is not given.

    Attributes:
        asis_width: between the front spines, which markers on soft tissue lie wider than.
        marker_diameter: of the markers.
        leg_length, knee_width, ankle_width, elbow_width: of the `left` and the `right`; widths without markers.
    """

    asis_width: float | None = None
    marker_diameter: float | None = None
    leg_length: Mapping[str, float] = field(default_factory=dict)
    knee_width: Mapping[str, float] = field(default_factory=dict)
    ankle_width: Mapping[str, float] = field(default_factory=dict)
    elbow_width: Mapping[str, float] = field(default_factory=dict)

    def half_width(self, joint: str, side: str, length: float, adult: float) -> float:
        """Metres from a marker to the centre of `shin`, `foot` or `forearm`, on a limb `length` long: for their length,
        short limbs have wide joints."""
        radius = _RADIUS if self.marker_diameter is None else self.marker_diameter / 2
        widths = {"shin": self.knee_width, "foot": self.ankle_width, "forearm": self.elbow_width}[joint]
        if side in widths:
            return widths[side] / 2 + radius
        return radius + (_HALF_WIDTH[joint] - _RADIUS) * float(np.sqrt(np.clip(length / adult, 0.3, 1.4)))


def midpoint(one: FloatArray, other: FloatArray) -> FloatArray:
    """(T, 3) metres: the middle of two markers, NaN where one is missing."""
    return np.asarray((one + other) / 2)


def plane_centre(
    above: FloatArray, marker: FloatArray, below: FloatArray, half_width: float, inward: FloatArray, bent: float = 0.25
) -> FloatArray:
    """The centre behind a marker beside a hinge, along the normal of the plane through three markers.

    Args:
        above, marker, below: (T, 3) metres: at the limb's upper end, beside the joint, at its lower end.
        half_width: metres from the marker's middle to the joint's.
        inward: (T, 3) a direction that is roughly inward, to choose between the normal's two.
        bent: smallest sine of the angle between the two parts; straighter limbs give NaN.

    Returns:
        (T, 3) metres.
    """
    normal = np.cross(unit(above - marker), unit(below - marker))
    sine = np.linalg.norm(normal, axis=-1, keepdims=True)
    normal = normal / np.maximum(sine, 1e-9)
    normal *= np.sign(np.sum(normal * inward, axis=-1, keepdims=True))
    return np.where(sine >= bent, marker + half_width * normal, np.nan)


def pelvis_frame(
    left_asis: FloatArray, right_asis: FloatArray, back: FloatArray
) -> tuple[FloatArray, FloatArray, float, float]:
    """Middle of the front spines (T, 3), axes forward, left, up as columns (T, 3, 3); width and depth in metres.

    Args:
        left_asis, right_asis: (T, 3) metres.
        back: (T, 3) the middle of the posterior spines, or the sacrum's marker.
    """
    front = (left_asis + right_asis) / 2
    left = unit(left_asis - right_asis)
    forward = front - back
    forward = unit(forward - np.sum(forward * left, axis=-1, keepdims=True) * left)
    axes = np.stack([forward, left, np.cross(forward, left)], axis=-1)
    width = np.linalg.norm(left_asis - right_asis, axis=-1)
    depth = np.linalg.norm(front - back, axis=-1)
    known = np.isfinite(width) & np.isfinite(depth)
    if not known.any():
        return front, axes, float("nan"), float("nan")
    return front, axes, float(np.median(width[known])), float(np.median(depth[known]))


def hip_in_pelvis(
    method: HipMethod, width: float, depth: float, leg_length: float | None = None, marker_radius: float = 0.007,
    asis_depth: float | None = None,
) -> FloatArray:  # fmt: skip
    """The left hip's centre from the middle of the front spines: forward, left, up, metres.

    Args:
        method: `harrington` (adults and children, from width and depth), `bell` (from the width), `davis` (from the
            width and the leg's length), `hara` (from the leg's length).
        width: between the front spines. depth: from their middle to that of the posterior spines.
        leg_length: from the front spine to the medial malleolus. marker_radius: of the spines' markers.
        asis_depth: horizontal distance from the front spine to the hip, from behind; measured on the patient, else
            Davis's regression on the leg's length.

    Raises:
        ValueError: `davis` or `hara` without a leg's length, or an unknown method.
    """
    if method == "harrington":
        return np.array([-0.24 * depth - 0.0099, 0.33 * width + 0.0073, -0.30 * width - 0.0109])
    if method == "bell":
        return np.array([-0.22 * width, (0.5 - 0.14) * width, -0.30 * width])
    if method not in ("davis", "hara"):
        raise ValueError(f"unknown method {method!r}: choose harrington, bell, davis or hara")
    if leg_length is None:
        raise ValueError(f"{method} needs the leg's length")
    if method == "hara":
        return np.array([0.011 - 0.063 * leg_length, 0.008 + 0.086 * leg_length, -0.009 - 0.078 * leg_length])
    theta, beta = np.radians(28.4), np.radians(18.0)
    reach = 0.115 * leg_length - 0.0153
    back = -(0.1288 * leg_length - 0.04856 if asis_depth is None else asis_depth) - marker_radius
    return np.array([
        back * np.cos(beta) + reach * np.cos(theta) * np.sin(beta),
        width / 2 - reach * np.sin(theta),
        back * np.sin(beta) - reach * np.cos(theta) * np.cos(beta),
    ])  # fmt: skip


# Half widths from the middle of a marker (its radius above the skin) to the middle of the joint, metres, of adults with
# this leg: C. C. Gordon and others, 2012 Anthropometric Survey of U.S. Army Personnel.
_RADIUS, _ADULT_LEG, _ADULT_ARM = 0.007, 0.90, 0.56
_HALF_WIDTH = {"forearm": 0.042, "shin": 0.062, "foot": 0.044}
# joint: markers beside it outside and inside, at the upper and at the lower end of the limb
_HINGES = {
    "forearm": ("elbow_lateral", "elbow_medial", "acromion", "radial_styloid"),
    "shin": ("knee_lateral", "knee_medial", "trochanter", "malleolus_lateral"),
    "foot": ("malleolus_lateral", "malleolus_medial", "knee_lateral", "toe"),
}
# Metres, what a coordinate of a centre found so is off.
_SIGMA = {"midpoint": 0.006, "plane": 0.012, "chord": 0.007, "harrington": 0.009, "bell": 0.015, "davis": 0.018,
          "hara": 0.011, "regressions": 0.009, "shoulder": 0.015}  # fmt: skip
METHODS = ("midpoint", "plane", "chord", "harrington", "bell", "davis", "hara", "regressions", "functional")
# Tibial torsion of adults, radians; what the shoulder is below the acromion, as a share of the acromia's distance.
_TORSION, _DROP = np.radians(20.0), 0.17
# What locates the joints unless something else is asked for.
USUAL = ("midpoint", "regressions", "chord")


def centres_from_markers(
    points_world: FloatArray, index: dict[str, int], methods: tuple[str, ...], measured: Measurements | None = None
) -> JointCentres:
    """All joint centres that the markers and the methods determine; of two methods for one joint the first counts, and
    the second in frames where the first does not tell.

    Args:
        points_world: (T, M, 3) metres, NaN where missing.
        index: marker of SURFACE -> its column.
        methods: of METHODS.
        measured: what was measured on the subject.

    Raises:
        ValueError: unknown method.
    """
    if unknown := [m for m in methods if m not in METHODS]:
        raise ValueError(f"unknown method {unknown[0]!r}: choose of {', '.join(METHODS)}")
    found: dict[str, tuple[FloatArray, float]] = {}
    measured = measured or Measurements()
    for method in methods:
        for side in ("left", "right"):
            at = {n.removeprefix(f"{side}_"): points_world[:, i] for n, i in index.items() if n.startswith(side)}
            if method in ("midpoint", "plane"):
                new = _hinges(at, points_world, index, side, method, measured)
            elif method == "chord":
                new = _chords(at, points_world, index, side, found, measured)
            elif method == "functional":
                new = _functional(at, points_world, index, side)
            else:
                new = _regressed(at, points_world, index, side, method, measured)  # type: ignore[arg-type]
            for joint, (points, sigma) in new.items():
                if np.isfinite(points).any():
                    before, sigma = found.get(f"{side}_{joint}", (points, sigma))
                    found[f"{side}_{joint}"] = np.where(np.isfinite(before), before, points), sigma
    if not found:
        return JointCentres()
    return JointCentres(tuple(found), np.stack([p for p, _ in found.values()], 1),
                        np.array([s for _, s in found.values()]))  # fmt: skip


def _hinges(at: dict[str, FloatArray], points: FloatArray, index: dict[str, int], side: str, method: str,
            measured: Measurements) -> dict[str, tuple[FloatArray, float]]:  # fmt: skip
    out = {}
    for joint, (outside, inside, above, below) in _HINGES.items():
        if method == "midpoint" and outside in at and inside in at:
            out[joint] = midpoint(at[outside], at[inside]), _SIGMA[method]
        other = points[:, index[f"{_OTHER[side]}_{outside}"]] if f"{_OTHER[side]}_{outside}" in index else None
        upper = at.get(above, at.get("asis"))
        # The plane of shank and foot is no ankle's: the toe's marker lies far inward.
        bends = method == "plane" and joint != "foot"
        if bends and outside in at and below in at and upper is not None and other is not None:
            # The markers of both sides give roughly the inward direction; arms and legs may cross for some frames.
            inward = np.where(np.isfinite(other), other - at[outside], 0.0)
            adult = _ADULT_LEG if joint == "shin" else _ADULT_ARM
            width = measured.half_width(joint, side, _median_length(upper, at[outside], at[below]), adult)
            out[joint] = plane_centre(upper, at[outside], at[below], width, inward), _SIGMA[method]
    if method == "midpoint" and "radial_styloid" in at and "ulnar_styloid" in at:
        out["hand"] = midpoint(at["radial_styloid"], at["ulnar_styloid"]), _SIGMA[method]
    return out


_OTHER = {"left": "right", "right": "left"}


def _pelvis(points: FloatArray, index: dict[str, int]) -> tuple[FloatArray, FloatArray, float, float] | None:
    if not {"left_asis", "right_asis"} <= set(index):
        return None
    if {"left_psis", "right_psis"} <= set(index):
        back = (points[:, index["left_psis"]] + points[:, index["right_psis"]]) / 2
    elif "sacrum" in index:
        back = points[:, index["sacrum"]]
    else:
        return None
    return pelvis_frame(points[:, index["left_asis"]], points[:, index["right_asis"]], back)


def _chords(at: dict[str, FloatArray], points: FloatArray, index: dict[str, int], side: str,
            found: dict[str, tuple[FloatArray, float]], measured: Measurements
            ) -> dict[str, tuple[FloatArray, float]]:  # fmt: skip
    """Knee, ankle, shoulder and elbow behind the one marker beside each."""
    out = _chords_of_leg(at, points, index, side, found, measured)
    shoulder = _shoulder(at, points, index, side)
    if shoulder is None:
        return out
    out["upper_arm"] = shoulder, _SIGMA["shoulder"]
    counts, _ = found.get(f"{side}_upper_arm", (shoulder, 0.0))
    shoulder = np.where(np.isfinite(counts), counts, shoulder)
    wrists = [at[n] for n in ("radial_styloid", "ulnar_styloid") if n in at]
    if "elbow_lateral" in at and wrists:
        wrist, marker = np.mean(wrists, axis=0), at["elbow_lateral"]
        width = measured.half_width("forearm", side, _median_length(at["acromion"], marker, wrist), _ADULT_ARM)
        # The forearm deviates outward by some ten degrees, and its marker may be anywhere on the arm.
        hinge = Hinge(width, 0.0, -1.0 if side == "left" else 1.0, 0.21, 0.10, np.inf, np.inf, slip=np.radians(20.0))
        wands = tuple(at[n] for n in ("upper_arm_distal", "upper_arm_proximal") if n in at)
        out["forearm"] = (
            chord(shoulder, marker, outward_of(hinge, shoulder, marker, wrist, wands), width),
            _SIGMA["chord"],
        )
    return out


def _chords_of_leg(at: dict[str, FloatArray], points: FloatArray, index: dict[str, int], side: str,
                   found: dict[str, tuple[FloatArray, float]], measured: Measurements
                   ) -> dict[str, tuple[FloatArray, float]]:  # fmt: skip
    out: dict[str, tuple[FloatArray, float]] = {}
    pelvis = _pelvis(points, index)
    hip, _ = found.get(f"{side}_thigh") or (None, 0.0)
    if pelvis is None or hip is None or not {"knee_lateral", "malleolus_lateral"} <= set(at):
        return out
    marker, ankle, left = at["knee_lateral"], at["malleolus_lateral"], 1.0 if side == "left" else -1.0
    leg = measured.leg_length.get(side) or _leg_length(at) or _ADULT_LEG
    width, below = (measured.half_width(joint, side, leg, _ADULT_LEG) for joint in ("shin", "foot"))
    hinge = Hinge(width, below, left, 0.0, 0.06, np.radians(8.0), np.radians(12.0), _TORSION)
    wands = tuple(at[n] for n in ("thigh_distal", "thigh_proximal", "patella") if n in at)
    outward = outward_of(hinge, hip, marker, ankle, wands, left * pelvis[1][..., 1])
    knee = chord(hip, marker, outward, width)
    out["shin"] = knee, _SIGMA["chord"]
    # The ankle hangs from the knee that counts.
    counts, _ = found.get(f"{side}_shin", (knee, 0.0))
    knee = np.where(np.isfinite(counts), counts, knee)
    # The malleoli's axis is turned outward against the knee's.
    outward = twisted(hinge, unit(marker - knee), ankle - knee)
    out["foot"] = chord(knee, ankle, outward, below), _SIGMA["chord"]
    return out


def _median_length(*places: FloatArray) -> float:
    parts = [np.linalg.norm(a - b, axis=-1) for a, b in zip(places, places[1:], strict=False)]
    whole = np.sum(parts, axis=0)
    return float(np.median(whole[np.isfinite(whole)])) if np.isfinite(whole).any() else _ADULT_ARM


def _shoulder(at: dict[str, FloatArray], points: FloatArray, index: dict[str, int], side: str) -> FloatArray | None:
    """Rab's centre: below the acromion, down the trunk, by a share of the distance of both."""
    if not {"left_acromion", "right_acromion"} <= set(index):
        return None

    def middle(*names: str) -> FloatArray | None:
        return np.mean([points[:, index[n]] for n in names], axis=0) if set(names) <= set(index) else None

    both = middle("left_acromion", "right_acromion")
    for top, bottom in ((middle("c7", "sternal_notch"), middle("t10", "xiphoid")),
                        (both, middle("left_asis", "right_asis"))):  # fmt: skip
        if top is not None and bottom is not None:
            apart = np.linalg.norm(points[:, index["left_acromion"]] - points[:, index["right_acromion"]], axis=-1)
            if np.isfinite(apart).any():
                return at["acromion"] - _DROP * float(np.nanmedian(apart)) * unit(top - bottom)
    return None


def _regressed(at: dict[str, FloatArray], points: FloatArray, index: dict[str, int], side: str,
               method: HipMethod | Literal["regressions"], measured: Measurements
               ) -> dict[str, tuple[FloatArray, float]]:  # fmt: skip
    pelvis = _pelvis(points, index)
    if pelvis is None:
        return {}
    front, axes, width, depth = pelvis
    leg, width = measured.leg_length.get(side) or _leg_length(at), measured.asis_width or width
    if method in ("davis", "hara") and leg is None:
        return {}
    chosen: tuple[HipMethod, ...] = (method,) if method != "regressions" else ("harrington", "davis", "hara")
    known = [hip_in_pelvis(m, width, depth, leg) for m in chosen if leg is not None or m == "harrington"]
    local = np.mean(known, axis=0) * [1, 1.0 if side == "left" else -1.0, 1]
    return {"thigh": (front + axes @ local, _SIGMA[method])}


def _leg_length(at: dict[str, FloatArray]) -> float | None:
    """Metres from the front spine to the malleolus, along the leg, so that a bent knee makes it no shorter."""
    ankle = at.get("malleolus_medial", at.get("malleolus_lateral"))
    if ankle is None or "asis" not in at or "knee_lateral" not in at:
        return None
    long = np.linalg.norm(at["asis"] - at["knee_lateral"], axis=-1) + np.linalg.norm(
        at["knee_lateral"] - ankle, axis=-1
    )
    known = np.isfinite(long)
    return float(np.quantile(long[known], 0.9)) if known.any() else None


def _functional(at: dict[str, FloatArray], points: FloatArray, index: dict[str, int], side: str
                ) -> dict[str, tuple[FloatArray, float]]:  # fmt: skip
    """Hip, shoulder and the like by motion: spheres in the axes of the bone above."""
    out = {}
    pelvis = [index[n] for n in ("left_asis", "right_asis", "left_psis", "right_psis", "sacrum") if n in index]
    trunk = [index[n] for n in ("c7", "t10", "sternal_notch", "xiphoid") if n in index]
    for joint, base, parts in (
        ("thigh", pelvis, ("thigh_proximal", "thigh_distal", "knee_lateral", "knee_medial", "trochanter")),
        ("upper_arm", trunk, ("upper_arm_proximal", "upper_arm_distal", "elbow_lateral", "elbow_medial")),
    ):
        limb = [at[p] for p in parts if p in at]
        if len(base) < 3 or not limb:
            continue
        turns, places, _ = segment_poses(points[:, base])
        local = np.einsum("tji,tkj->tki", turns, np.stack(limb, 1) - places[:, None])
        try:
            centre, spread = sphere_centre(local)
        except ValueError:
            continue
        # How well the motion determines it: the spread of the markers over the sphere against the noise.
        known = local[np.isfinite(local).all((1, 2))]
        if len(known) < 20:
            continue
        reach = np.sqrt(np.linalg.eigvalsh(np.cov(known.mean(1).T))[:2].min())
        radius = float(np.linalg.norm(known.mean((0, 1)) - centre))
        sigma = spread * radius / max(float(reach), 1e-6) / np.sqrt(12.0)
        if sigma < 0.03 and radius < 0.6:
            out[joint] = places + turns @ centre, float(np.hypot(sigma, 0.006))
    return out
