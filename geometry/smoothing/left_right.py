"""Correction of left-right flips of 3D points over time."""

from collections.abc import Sequence

import numpy as np

from muybridge.arrays import BoolArray, FloatArray, IndexArray
from muybridge.geometry.landmarks.sets import LandmarkSet
from muybridge.geometry.numerics.robust import CHI2_3_MEDIAN, median_known
from muybridge.geometry.smoothing._kernel import flipped_path


def undo_flips(
    landmarks: LandmarkSet, xyz: FloatArray, covariance: FloatArray, fps: float, flip_share: float
) -> tuple[FloatArray, FloatArray]:
    """Flip sides where that makes both paths smoother: first of the whole body, then of limbs, then of pairs.

    A network that mistakes the front for the back flips everything at once, which all pairs together show far better
    than one of them; crossed legs and single joints remain for the later steps.
    """
    names = landmarks.names
    pairs = [
        (i, names.index("right_" + name[5:]))
        for i, name in enumerate(names)
        if name.startswith("left_") and "right_" + name[5:] in names
    ]
    if len(xyz) < 3 or not pairs:
        return xyz, covariance
    xyz, covariance = xyz.copy(), covariance.copy()
    left, right = np.array(pairs, dtype=np.intp).T
    limb = np.array([_limb_of(names[i]) for i in left])
    rare = float(np.log((1 - flip_share) / flip_share))
    # The facing direction of the body determines the sides of the legs (by the hips) and arms (by the shoulders).
    hips, shoulders = _facing(landmarks, xyz, ("hip",)), _facing(landmarks, xyz, ("shoulder",))
    of_limb = np.stack([hips, shoulders, np.zeros_like(hips)], axis=1)[:, np.unique(limb)]
    # Flips of the whole body are a common error of networks.
    whole = 0.4 * rare + _facing(landmarks, xyz, ("hip", "shoulder"))[:, None]
    for group, prior in (
        (np.zeros(len(left), dtype=np.intp), whole),
        (limb, rare + of_limb),
        (np.arange(len(left)), np.full((1, 1), rare)),
    ):
        flipped = _swap_paths(xyz[:, left], xyz[:, right], covariance[:, left], group, fps, prior)
        t, k = np.nonzero(flipped)
        for array in (xyz, covariance):
            array[t, left[k]], array[t, right[k]] = array[t, right[k]], array[t, left[k]]
    return xyz, covariance


def _facing(landmarks: LandmarkSet, xyz: FloatArray, across: Sequence[str]) -> FloatArray:
    """(T,) log odds that left is left of the pairs `across`, from the direction of nose and toes (left is up x
    forward); 0 where unknown."""

    def at(name: str) -> FloatArray:
        return xyz[:, landmarks.names.index(name)] if name in landmarks.names else np.full_like(xyz[:, 0], np.nan)

    up = at("left_shoulder") + at("right_shoulder") - at("left_hip") - at("right_hip")
    head = 2 * at("nose") - at("left_ear") - at("right_ear")
    feet = [at(f"{side}_big_toe") - at(f"{side}_heel") for side in ("left", "right")]
    forward = np.nansum([head, *feet], axis=0)
    left = np.cross(up / np.maximum(np.linalg.norm(up, axis=-1, keepdims=True), 1e-9), forward)
    reach = np.linalg.norm(left, axis=-1)
    wide = np.sum([at(f"left_{pair}") - at(f"right_{pair}") for pair in across], axis=0)
    with np.errstate(invalid="ignore", divide="ignore"):
        width = np.sum(left * wide, axis=-1) / reach
    # Hips and shoulders are each a quarter of a metre wide, and nose and feet extend half a metre to the front; noise
    # alone causes about half of that.
    usual = 0.125 * len(across)
    return np.asarray(np.nan_to_num(np.clip(width / usual, -2.0, 2.0) * np.minimum(reach / 0.3, 1.0)))


def _limb_of(name: str) -> int:
    words = (("hip", "knee", "ankle", "heel", "toe", "foot"), ("shoulder", "elbow", "wrist", "hand"))
    return next((i for i, limb in enumerate(words) if name.endswith(limb)), len(words))


def _swap_paths(
    a: FloatArray, b: FloatArray, covariance: FloatArray, group: IndexArray, fps: float, prior: FloatArray
) -> BoolArray:
    """Most probable two-state path of each group of pairs (Viterbi 1967).

    Args:
        a, b: (T, N, 3) the left and the right landmark of each pair.
        covariance: (T, N, 3, 3) of the left ones.
        group: (N,) pairs with the same number are flipped together.
        prior: (T, G), or broadcastable to it: cost of a frame in the flipped state (log odds).

    Returns:
        (T, N) whether a pair is flipped.
    """
    known = np.isfinite(a[..., 0]) & np.isfinite(b[..., 0])
    t_count = len(a)
    latest = np.maximum.accumulate(np.where(known, np.arange(t_count)[:, None], -1), axis=0)
    before = np.concatenate([np.full((1, a.shape[1]), -1), latest[:-1]])
    usable = known & (before >= 0)
    column = np.arange(a.shape[1])
    # The stated covariance, or the observed noise where that is larger: noisy points say little about sides.
    claimed = np.trace(covariance, axis1=-2, axis2=-1) / 3
    variance = np.maximum(claimed, np.fmax(_jump_variance(a), _jump_variance(b)))
    # Displacement of a landmark between two frames without a flip: noise and 1.5 m/s; the cost of a step is capped.
    seconds = (np.arange(t_count)[:, None] - before) / fps
    moves = (1.5 * seconds) ** 2
    scale = np.where(usable, variance + variance[before, column], 1.0) + moves
    number = np.unique(group, return_inverse=True)[1]
    # Noise is independent between landmarks, motion is that of the limb: heel and toes are no independent evidence.
    worth = 1 / (1 + (np.bincount(number)[number] - 1) * moves / scale)

    def step(now: FloatArray, then: FloatArray) -> FloatArray:
        far = np.sum((now - then[before, column]) ** 2, axis=-1) / (2 * scale)
        return np.where(usable, worth * np.minimum(far, 8.0), 0.0)

    costs = np.stack([step(a, a) + step(b, b), step(b, a) + step(a, b)], axis=-1)
    member = (number == np.arange(number.max() + 1)[:, None]).astype(np.float64)
    prior = np.broadcast_to(prior, (t_count, len(member))) * (known @ member.T > 0)
    costs, prior = np.ascontiguousarray(costs), np.ascontiguousarray(prior)
    whole = np.ascontiguousarray(known)  # of one layout, as all of them, or everything is compiled for each
    path = flipped_path(costs, whole, number.astype(np.int64), prior)
    return np.asarray(path[:, number] & known)


def _jump_variance(xyz: FloatArray) -> FloatArray:
    """(T, N) to (N,) robust variance of a coordinate, from each point's distance to the middle of its neighbours.

    Zero where there are no three frames in a row.
    """
    off = xyz[1:-1] - 0.5 * (xyz[2:] + xyz[:-2])
    median = median_known(np.sum(off**2, axis=-1))
    return np.nan_to_num(median / (1.5 * CHI2_3_MEDIAN))
