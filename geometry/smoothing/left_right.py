"""Left-right flips of 3D points over time."""

from collections.abc import Sequence

import numpy as np

from muybridge.arrays import BoolArray, FloatArray, IndexArray
from muybridge.geometry.landmarks.sets import LandmarkSet
from muybridge.geometry.numerics.robust import CHI2_3_MEDIAN, median_known
from muybridge.geometry.smoothing._kernel import exchanged_path


def undo_flips(
    landmarks: LandmarkSet, xyz: FloatArray, covariance: FloatArray, fps: float, flip_share: float
) -> tuple[FloatArray, FloatArray]:
    """Exchange sides where that makes both paths smoother, first of the whole body, then limbs, then pairs.

    A network that takes the front for the back exchanges everything at once, and all pairs together show the
    jump far better than one of them; what is left are crossed legs and single joints.
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
    # The body tells where its front is, and so which leg is which by its hips and which arm by its shoulders.
    hips, shoulders = _facing(landmarks, xyz, ("hip",)), _facing(landmarks, xyz, ("shoulder",))
    of_limb = np.stack([hips, shoulders, np.zeros_like(hips)], axis=1)[:, np.unique(limb)]
    # All at once is the network's own mistake and not rare.
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
    """(T,) log odds that left is left of the pairs `across`, from where nose and toes point: left is up x forward. 0
    where unknown."""

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
    # Hips and shoulders are each a quarter of a metre wide, and nose and feet reach half a metre to the front; noise
    # alone makes about half of that.
    usual = 0.125 * len(across)
    return np.asarray(np.nan_to_num(np.clip(width / usual, -2.0, 2.0) * np.minimum(reach / 0.3, 1.0)))


def _limb_of(name: str) -> int:
    words = (("hip", "knee", "ankle", "heel", "toe", "foot"), ("shoulder", "elbow", "wrist", "hand"))
    return next((i for i, limb in enumerate(words) if name.endswith(limb)), len(words))


def _swap_paths(
    a: FloatArray, b: FloatArray, covariance: FloatArray, group: IndexArray, fps: float, prior: FloatArray
) -> BoolArray:
    """Per group of pairs the most likely two-state path (Viterbi 1967).

    Args:
        a, b: (T, N, 3) the left and the right landmark of each pair.
        covariance: (T, N, 3, 3) of the left ones.
        group: (N,) pairs with the same number are exchanged together.
        prior: (T, G) or what broadcasts to it, what a frame in exchanged state costs (log odds).

    Returns:
        (T, N) whether a pair is exchanged.
    """
    known = np.isfinite(a[..., 0]) & np.isfinite(b[..., 0])
    t_count = len(a)
    latest = np.maximum.accumulate(np.where(known, np.arange(t_count)[:, None], -1), axis=0)
    before = np.concatenate([np.full((1, a.shape[1]), -1), latest[:-1]])
    usable = known & (before >= 0)
    column = np.arange(a.shape[1])
    # What the covariance claims, or the noise that is seen where that is more: points that are jumpy anyway
    # say little about sides.
    claimed = np.trace(covariance, axis1=-2, axis2=-1) / 3
    variance = np.maximum(claimed, np.fmax(_jump_variance(a), _jump_variance(b)))
    # How far a landmark gets between two frames without a swap: its noise and 1.5 m/s; more than the cap
    # of a mistaken step says nothing more.
    seconds = (np.arange(t_count)[:, None] - before) / fps
    moves = (1.5 * seconds) ** 2
    scale = np.where(usable, variance + variance[before, column], 1.0) + moves
    number = np.unique(group, return_inverse=True)[1]
    # Noise is every landmark's own, movement the limb's: what a foot says of it, heel and toes don't say again.
    worth = 1 / (1 + (np.bincount(number)[number] - 1) * moves / scale)

    def step(now: FloatArray, then: FloatArray) -> FloatArray:
        far = np.sum((now - then[before, column]) ** 2, axis=-1) / (2 * scale)
        return np.where(usable, worth * np.minimum(far, 8.0), 0.0)

    costs = np.stack([step(a, a) + step(b, b), step(b, a) + step(a, b)], axis=-1)
    member = (number == np.arange(number.max() + 1)[:, None]).astype(np.float64)
    prior = np.broadcast_to(prior, (t_count, len(member))) * (known @ member.T > 0)
    path = exchanged_path(np.ascontiguousarray(costs), known, number.astype(np.int64), np.ascontiguousarray(prior))
    return np.asarray(path[:, number] & known)


def _jump_variance(xyz: FloatArray) -> FloatArray:
    """(T, N, 3) -> (N,) variance of a coordinate, robustly from each point's distance to its neighbours' middle.

    Zero where there are no three frames in a row.
    """
    off = xyz[1:-1] - 0.5 * (xyz[2:] + xyz[:-2])
    median = median_known(np.sum(off**2, axis=-1))
    return np.nan_to_num(median / (1.5 * CHI2_3_MEDIAN))
