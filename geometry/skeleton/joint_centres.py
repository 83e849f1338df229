"""Joint centres from the markers on the skin about them: by construction, by regression, by motion.

- Two markers on either side of a joint: the middle between them.
- Three markers, one beside the joint and one at each end of the limb: half the joint's width inward along the normal of
  the plane that they span (R. Parent, Computer Animation, 3rd edition 2012, chapter 6). A straight limb spans no plane.
- The hip from the pelvis' four markers: M. E. Harrington and others, Journal of Biomechanics 40, 2007; A. L. Bell,
  R. A. Brand, D. R. Pedersen, Human Movement Science 8, 1989; R. B. Davis and others, Human Movement Science 10, 1991.
- Functionally: where two moving bones stay together (R. M. Ehrig, W. R. Taylor, G. N. Duda, M. O. Heller, Journal of
  Biomechanics 39, 2006: SCoRE), and the common centre of spheres on which markers move (S. S. H. U. Gamage,
  J. Lasenby, Journal of Biomechanics 35, 2002; by distances: W. Gander, G. H. Golub, R. Strebel, BIT 34, 1994).
"""

from dataclasses import dataclass, field
from typing import Literal

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

HipMethod = Literal["harrington", "bell", "davis"]


@dataclass(frozen=True, eq=False)
class JointCentres:
    """Joint centres over a take.

    Attributes:
        names: of joints of `geometry.body.BODY` (`left_thigh` begins at the hip).
        points_world: (T, N, 3) metres, NaN where not known. sigma: (N,) metres, standard deviation of a coordinate.
    """

    names: tuple[str, ...] = ()
    points_world: Array = field(default_factory=lambda: np.zeros((0, 0, 3)))
    sigma: Array = field(default_factory=lambda: np.zeros(0))


@dataclass(frozen=True, eq=False)
class Centre:
    """A centre of rotation between two bones.

    Attributes:
        in_first, in_second: (3,) metres in each bone's axes.
        residual_m: root mean square distance between the two over the take.
        sigma_m: (3,) standard deviation of `in_first` by the residual and how far the motion reaches; large about an
            axis that the bones hardly turn across.
    """

    in_first: Array
    in_second: Array
    residual_m: float
    sigma_m: Array


def midpoint(one: Array, other: Array) -> Array:
    """(T, 3) metres: the middle of two markers, NaN where one is missing."""
    return np.asarray((one + other) / 2)


def plane_centre(
    above: Array, marker: Array, below: Array, half_width: float, inward: Array, bent: float = 0.25
) -> Array:
    """The centre behind a marker beside a hinge, along the normal of the plane through three markers.

    Args:
        above, marker, below: (T, 3) metres: at the limb's upper end, beside the joint, at its lower end.
        half_width: metres from the marker's middle to the joint's.
        inward: (T, 3) a direction that is roughly inward, to choose between the normal's two.
        bent: smallest sine of the angle between the two parts; straighter limbs give NaN.

    Returns:
        (T, 3) metres.
    """
    normal = np.cross(_unit(above - marker), _unit(below - marker))
    sine = np.linalg.norm(normal, axis=-1, keepdims=True)
    normal = normal / np.maximum(sine, 1e-9)
    normal *= np.sign(np.sum(normal * inward, axis=-1, keepdims=True))
    return np.where(sine >= bent, marker + half_width * normal, np.nan)


def pelvis_frame(left_asis: Array, right_asis: Array, back: Array) -> tuple[Array, Array, float, float]:
    """Middle of the front spines (T, 3), axes forward, left, up as columns (T, 3, 3); width and depth in metres.

    Args:
        left_asis, right_asis: (T, 3) metres.
        back: (T, 3) the middle of the posterior spines, or the sacrum's marker.
    """
    front = (left_asis + right_asis) / 2
    left = _unit(left_asis - right_asis)
    forward = front - back
    forward = _unit(forward - np.sum(forward * left, axis=-1, keepdims=True) * left)
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
) -> Array:  # fmt: skip
    """The left hip's centre from the middle of the front spines: forward, left, up, metres.

    Args:
        method: `harrington` (adults and children, from width and depth), `bell` (from the width), `davis` (from the
            width and the leg's length).
        width: between the front spines. depth: from their middle to that of the posterior spines.
        leg_length: from the front spine to the medial malleolus. marker_radius: of the spines' markers.
        asis_depth: horizontal distance from the front spine to the hip, from behind; measured on the patient, else
            Davis's regression on the leg's length.

    Raises:
        ValueError: `davis` without a leg's length, or an unknown method.
    """
    if method == "harrington":
        return np.array([-0.24 * depth - 0.0099, 0.33 * width + 0.0073, -0.30 * width - 0.0109])
    if method == "bell":
        return np.array([-0.22 * width, (0.5 - 0.14) * width, -0.30 * width])
    if method != "davis":
        raise ValueError(f"unknown method {method!r}: choose harrington, bell or davis")
    if leg_length is None:
        raise ValueError("davis needs the leg's length")
    theta, beta = np.radians(28.4), np.radians(18.0)
    reach = 0.115 * leg_length - 0.0153
    back = -(0.1288 * leg_length - 0.04856 if asis_depth is None else asis_depth) - marker_radius
    return np.array([
        back * np.cos(beta) + reach * np.cos(theta) * np.sin(beta),
        width / 2 - reach * np.sin(theta),
        back * np.sin(beta) - reach * np.cos(theta) * np.cos(beta),
    ])  # fmt: skip


def segment_poses(points: Array, reference: Array | None = None) -> tuple[Array, Array, Array]:
    """How a rigid cluster of markers moves: rotations (T, 3, 3), origins (T, 3), reference (K, 3); NaN where fewer than
    three of its markers are known.

    Args:
        points: (T, K, 3) metres.
        reference: (K, 3) the cluster at rest; None takes the frame with most markers, refined over the take.
    """
    if reference is None:
        best = int(np.argmax(np.isfinite(points[..., 0]).sum(1)))
        reference = points[best]
        for _ in range(4):
            turns, places = _rigid(points, reference)
            back = np.einsum("tij,tki->tkj", turns, points - places[:, None])
            with np.errstate(invalid="ignore"):
                reference = np.where(np.isfinite(back).any(0), _nanmean(back), np.nan)
        reference = reference - np.nanmean(reference, 0)
    return *_rigid(points, reference), reference


def _nanmean(values: Array) -> Array:
    known = np.isfinite(values)
    return np.asarray(np.where(known, values, 0.0).sum(0) / np.maximum(known.sum(0), 1))


def _rigid(points: Array, reference: Array) -> tuple[Array, Array]:
    known = np.isfinite(points[..., 0]) & np.isfinite(reference[:, 0])
    weight = known / np.maximum(known.sum(1), 1)[:, None]
    p, q = np.where(known[..., None], points, 0.0), np.where(np.isfinite(reference), reference, 0.0)
    mean_p, mean_q = np.einsum("tk,tki->ti", weight, p), weight @ q
    covariance = np.einsum("tk,tki,tkj->tij", weight, p - mean_p[:, None], q[None] - mean_q[:, None])
    u, _, vt = np.linalg.svd(covariance)
    sign = np.ones((len(points), 3))
    sign[:, 2] = np.sign(np.linalg.det(u @ vt))
    turns = (u * sign[:, None]) @ vt
    places = mean_p - np.einsum("tij,tj->ti", turns, mean_q)
    enough = known.sum(1) >= 3
    turns[~enough], places[~enough] = np.nan, np.nan
    return turns, places


def score_centre(
    turns: Array, places: Array, turns_other: Array, places_other: Array, rounds: int = 8, freedom: float = 4.0
) -> Centre:
    """The point that two moving bones share (SCoRE), robust against frames in which they do not.

    Args:
        turns, places: (T, 3, 3) and (T, 3) metres, world from the first bone; NaN where unknown.
        turns_other, places_other: of the second.
        rounds: of robust weights (Student's t with `freedom`).

    Raises:
        ValueError: fewer than four frames are known.
    """
    known = np.isfinite(places).all(-1) & np.isfinite(places_other).all(-1)
    if known.sum() < 4:
        raise ValueError(f"a centre of rotation needs at least 4 frames that know both bones, not {known.sum()}")
    design = np.concatenate([turns[known], -turns_other[known]], axis=-1)
    target = places_other[known] - places[known]
    weight = np.ones(len(target))
    for _ in range(rounds):
        matrix = np.einsum("t,tki,tkj->ij", weight, design, design)
        value = np.linalg.lstsq(matrix, np.einsum("t,tki,tk->i", weight, design, target), rcond=1e-9)[0]
        square = np.sum((design @ value - target) ** 2, axis=-1)
        scale = max(float(np.median(square)) / 2.366, 1e-12)
        weight = np.minimum((freedom + 3) / (freedom + square / scale), 1.0)
    spread = np.linalg.pinv(matrix, rcond=1e-12) * scale
    residual = float(np.sqrt(np.sum(weight * square) / np.sum(weight)))
    return Centre(value[:3], value[3:], residual, np.sqrt(np.maximum(np.diag(spread)[:3], 0.0)))


def sphere_centre(points: Array, rounds: int = 30, freedom: float = 4.0) -> tuple[Array, float]:
    """The common centre of the spheres that markers move on.

    The start is Gamage and Lasenby's closed form, which noise draws towards the markers where the motion is small; from
    there Gauss-Newton on the distances themselves, which hardly has that bias, with robust weights.

    Args:
        points: (T, K, 3) metres in the axes of the bone that holds the centre; NaN where missing.
        rounds: of Gauss-Newton; 0 is the closed form alone.
        freedom: of Student's t.

    Returns:
        (3,) metres, and the standard deviation of the markers' distances from it, metres.

    Raises:
        ValueError: no marker is known in four frames, or they hardly move.
    """
    tracks = [points[np.isfinite(points[:, k]).all(-1), k] for k in range(points.shape[1])]
    tracks = [p for p in tracks if len(p) >= 4]
    if not tracks:
        raise ValueError("no marker is known in four frames or more, so it tells no centre")
    matrix, fixed = np.zeros((3, 3)), np.zeros(3)
    origin = np.concatenate(tracks).mean(0)
    for p in tracks:
        off, square = p - p.mean(0), np.sum((p - origin) ** 2, axis=-1)
        matrix += 2 * off.T @ off / len(p)
        fixed += (square - square.mean()) @ off / len(p)
    if np.linalg.cond(matrix) > 1e7:
        raise ValueError("the markers hardly move about the centre: it cannot be told")
    centre = origin + np.linalg.solve(matrix, fixed)
    if not rounds:
        return centre, float(np.sqrt(np.mean([np.var(np.linalg.norm(p - centre, axis=-1)) for p in tracks])))
    # The closed form may be so near to the markers that distances lead nowhere: from farther out as well.
    away = centre - origin
    found = [_by_distances(tracks, origin + k * away, rounds, freedom) for k in (1.0, 2.5, 6.0)]
    return min(found, key=lambda f: f[1])


def _by_distances(tracks: list[Array], centre: Array, rounds: int, freedom: float) -> tuple[Array, float]:
    scale, weights = 0.0, [np.ones(len(p)) for p in tracks]
    for _ in range(rounds):
        matrix, fixed, squares = np.zeros((3, 3)), np.zeros(3), []
        for k, p in enumerate(tracks):
            far = np.linalg.norm(p - centre, axis=-1)
            off = far - np.average(far, weights=weights[k])
            towards = (p - centre) / np.maximum(far, 1e-9)[:, None]
            towards -= np.average(towards, axis=0, weights=weights[k])
            matrix += (towards * weights[k][:, None]).T @ towards
            fixed += (towards * weights[k][:, None]).T @ off
            squares.append(off**2)
        scale = max(float(np.median(np.concatenate(squares))) / 0.4549, 1e-14)
        weights = [np.minimum((freedom + 1) / (freedom + s / scale), 1.0) for s in squares]
        step = np.linalg.solve(matrix + 1e-9 * np.trace(matrix) * np.eye(3), fixed)
        centre = centre + step * min(1.0, 0.1 / max(float(np.linalg.norm(step)), 1e-12))
        if np.linalg.norm(step) < 1e-7:
            break
    return centre, float(np.sqrt(scale))


# Half widths of adults from the middle of a marker (7 mm above the skin) to the middle of the joint, metres:
# C. C. Gordon and others, 2012 Anthropometric Survey of U.S. Army Personnel.
_HALF_WIDTH = {"forearm": 0.042, "shin": 0.062, "foot": 0.044}
# joint: markers beside it outside and inside, at the upper and at the lower end of the limb
_HINGES = {
    "forearm": ("elbow_lateral", "elbow_medial", "acromion", "radial_styloid"),
    "shin": ("knee_lateral", "knee_medial", "trochanter", "malleolus_lateral"),
    "foot": ("malleolus_lateral", "malleolus_medial", "knee_lateral", "toe"),
}
# Metres, what a coordinate of a centre found so is off.
_SIGMA = {"midpoint": 0.006, "plane": 0.012, "harrington": 0.009, "bell": 0.015, "davis": 0.018}
METHODS = ("midpoint", "plane", "harrington", "bell", "davis", "functional")


def centres_from_markers(points_world: Array, index: dict[str, int], methods: tuple[str, ...]) -> JointCentres:
    """Every joint centre that the markers and the methods tell; of two methods for one joint the first counts.

    Args:
        points_world: (T, M, 3) metres, NaN where missing.
        index: marker of SURFACE -> its column.
        methods: of METHODS.

    Raises:
        ValueError: unknown method.
    """
    if unknown := [m for m in methods if m not in METHODS]:
        raise ValueError(f"unknown method {unknown[0]!r}: choose of {', '.join(METHODS)}")
    found: dict[str, tuple[Array, float]] = {}
    for method in methods:
        for side in ("left", "right"):
            at = {n.removeprefix(f"{side}_"): points_world[:, i] for n, i in index.items() if n.startswith(side)}
            if method in ("midpoint", "plane"):
                new = _hinges(at, points_world, index, side, method)
            elif method == "functional":
                new = _functional(at, points_world, index, side)
            else:
                new = _regressed(at, points_world, index, side, method)  # type: ignore[arg-type]
            for joint, (points, sigma) in new.items():
                if np.isfinite(points).any():
                    found.setdefault(f"{side}_{joint}", (points, sigma))
    if not found:
        return JointCentres()
    return JointCentres(tuple(found), np.stack([p for p, _ in found.values()], 1),
                        np.array([s for _, s in found.values()]))  # fmt: skip


def _hinges(at: dict[str, Array], points: Array, index: dict[str, int], side: str, method: str
            ) -> dict[str, tuple[Array, float]]:  # fmt: skip
    out = {}
    for joint, (outside, inside, above, below) in _HINGES.items():
        if method == "midpoint" and outside in at and inside in at:
            out[joint] = midpoint(at[outside], at[inside]), _SIGMA[method]
        other = points[:, index[f"{_OTHER[side]}_{outside}"]] if f"{_OTHER[side]}_{outside}" in index else None
        upper = at.get(above, at.get("asis"))
        if method == "plane" and outside in at and below in at and upper is not None and other is not None:
            # The two sides' markers tell roughly where inward is; arms and legs may cross for some frames.
            inward = np.where(np.isfinite(other), other - at[outside], 0.0)
            out[joint] = plane_centre(upper, at[outside], at[below], _HALF_WIDTH[joint], inward), _SIGMA[method]
    if method == "midpoint" and "radial_styloid" in at and "ulnar_styloid" in at:
        out["hand"] = midpoint(at["radial_styloid"], at["ulnar_styloid"]), _SIGMA[method]
    return out


_OTHER = {"left": "right", "right": "left"}


def _pelvis(points: Array, index: dict[str, int]) -> tuple[Array, Array, float, float] | None:
    if not {"left_asis", "right_asis"} <= set(index):
        return None
    if {"left_psis", "right_psis"} <= set(index):
        back = (points[:, index["left_psis"]] + points[:, index["right_psis"]]) / 2
    elif "sacrum" in index:
        back = points[:, index["sacrum"]]
    else:
        return None
    return pelvis_frame(points[:, index["left_asis"]], points[:, index["right_asis"]], back)


def _regressed(at: dict[str, Array], points: Array, index: dict[str, int], side: str, method: HipMethod
               ) -> dict[str, tuple[Array, float]]:  # fmt: skip
    pelvis = _pelvis(points, index)
    if pelvis is None:
        return {}
    front, axes, width, depth = pelvis
    leg = None
    if method == "davis":
        ankle = at.get("malleolus_medial", at.get("malleolus_lateral"))
        if ankle is None or "asis" not in at or "knee_lateral" not in at:
            return {}
        # Along the leg, so that a bent knee makes it no shorter.
        parts = (at["asis"] - at["knee_lateral"], at["knee_lateral"] - ankle)
        long = sum(np.linalg.norm(p, axis=-1) for p in parts)
        known = np.isfinite(long)
        if not known.any():
            return {}
        leg = float(np.quantile(long[known], 0.9))
    local = hip_in_pelvis(method, width, depth, leg) * [1, 1.0 if side == "left" else -1.0, 1]
    return {"thigh": (front + axes @ local, _SIGMA[method])}


def _functional(at: dict[str, Array], points: Array, index: dict[str, int], side: str
                ) -> dict[str, tuple[Array, float]]:  # fmt: skip
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
        # How well the motion tells it: the spread of the markers over the sphere against the noise.
        known = local[np.isfinite(local).all((1, 2))]
        if len(known) < 20:
            continue
        reach = np.sqrt(np.linalg.eigvalsh(np.cov(known.mean(1).T))[:2].min())
        radius = float(np.linalg.norm(known.mean((0, 1)) - centre))
        sigma = spread * radius / max(float(reach), 1e-6) / np.sqrt(12.0)
        if sigma < 0.03 and radius < 0.6:
            out[joint] = places + turns @ centre, float(np.hypot(sigma, 0.006))
    return out


def _unit(vectors: Array) -> Array:
    return np.asarray(vectors / np.maximum(np.linalg.norm(vectors, axis=-1, keepdims=True), 1e-9))
