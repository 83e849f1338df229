"""Groups of markers whose order can be mistaken as a whole, and what the posture of the head says about its order."""

import numpy as np

from muybridge.arrays import FloatArray, IndexArray

_HAND = ("radial_styloid", "ulnar_styloid", "metacarpal_2", "metacarpal_5")
_FOOT = ("malleolus_lateral", "malleolus_medial", "heel", "metatarsal_1", "metatarsal_5", "toe", "hallux")
_HEAD = ("left_front_head", "right_front_head", "left_back_head", "right_back_head")
_TRUNK = (("c7", "sternal_notch", "left_acromion", "right_acromion"),
          ("t10", "xiphoid", "left_asis", "right_asis", "left_psis", "right_psis"))  # fmt: skip

# A head is turned far and nods, bands sit askew front to back; it leans sideways little: standard deviations, degrees.
_LEAN, _TURN = 8.0, 45.0


def groups_of(names: tuple[str, ...]) -> list[list[int]]:
    """Indices of the head's markers, of each hand's and of each foot's, by the body points of a set."""
    stems = [_HEAD, *((tuple(f"{side}_{n}" for n in part)) for part in (_HAND, _FOOT) for side in ("left", "right"))]
    found = [[names.index(n) for n in stem if n in names] for stem in stems]
    return [group for group in found if len(group) > 1]


def head_posture(place: FloatArray, chosen: IndexArray, names: tuple[str, ...]) -> float:
    """Logarithm of how usual the head's posture is, up to a constant; 0 where it is not known.

    Args:
        place: (F, K, 3) columns, metres, Z up.
        chosen: (A,) column of each marker, -1 for none.
        names: (A,) their body points.
    """
    where = {n: chosen[i] for i, n in enumerate(names) if chosen[i] >= 0}
    if not all(n in where for n in _HEAD):
        return 0.0
    lf, rf, lb, rb = (place[:, where[n]] for n in _HEAD)
    across, ahead = lf + lb - rf - rb, lf + rf - lb - rb
    top, low = ([place[:, where[n]] for n in part if n in where] for part in _TRUNK)
    vertical = np.tile([0.0, 0.0, 1.0], (len(place), 1))
    leans = [_angle(across, vertical)]
    if len(top) > 1 and len(low) > 1:
        trunk = np.mean(top, 0) - np.mean(low, 0)
        leans.append(_angle(across, trunk))
        vertical = trunk
    lean = min(leans)
    turned = 0.0
    if "left_acromion" in where and "right_acromion" in where:
        left = place[:, where["left_acromion"]] - place[:, where["right_acromion"]]
        front = np.cross(left, vertical)
        flat = ahead - vertical * ((ahead * vertical).sum(-1) / (vertical * vertical).sum(-1))[:, None]
        cosine = (flat * front).sum(-1) / (np.linalg.norm(flat, axis=-1) * np.linalg.norm(front, axis=-1) + 1e-9)
        turned = _middle(np.degrees(np.arccos(np.clip(cosine, -1, 1))))
    return -min(0.5 * (lean / _LEAN) ** 2, 12.0) - 0.5 * (turned / _TURN) ** 2


def _angle(across: FloatArray, up: FloatArray) -> float:
    """How far an axis is from level, degrees, the median over frames."""
    sine = (across * up).sum(-1) / (np.linalg.norm(across, axis=-1) * np.linalg.norm(up, axis=-1) + 1e-9)
    return _middle(np.degrees(np.abs(np.arcsin(np.clip(sine, -1, 1)))))


def _middle(values: FloatArray) -> float:
    known = values[np.isfinite(values)]
    return float(np.median(known)) if len(known) else 0.0
