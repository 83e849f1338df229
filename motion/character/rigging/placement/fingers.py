"""Where the joints of fingers are: on ways through a fine volume of the hand, or at usual places of a closed one."""

import numpy as np

from muybridge.arrays import FloatArray, IntArray
from muybridge.geometry.skeleton.profiles import FINGERS
from muybridge.motion.character.rigging.paths import Branch, build_graph, find_branches
from muybridge.motion.character.rigging.volume import Volume, fill_volume

_CELLS = 56  # along the longest extent of a hand
_ROOM = 0.72  # of the hand's length, around its middle
_PALM = 0.38  # of the way from the wrist to the tip
_LEAST = 0.18  # of the hand's length that a finger is free
_JOINTS = (1.0, 0.55, 0.27)  # of a finger's length from its tip: knuckle, middle and last joint
_KNUCKLE = 0.66  # of the way from a finger's tip to the middle of the palm
_THUMB = (0.14, 0.4)  # its first joint: along the hand, and across it as a share of what its tip is
_THUMB_JOINTS = (1.0, 0.62, 0.27)  # of the way from its tip to its first joint
# Of a closed hand, in its length: along it and across it from its middle, to the first joint and to the tip.
_USUAL = {"thumb": ((0.18, 0.14), (0.58, 0.34)), "index": ((0.52, 0.15), (0.93, 0.18)),
          "middle": ((0.54, 0.04), (0.98, 0.05)), "ring": ((0.52, -0.06), (0.93, -0.08)),
          "little": ((0.48, -0.15), (0.82, -0.2))}  # fmt: skip


def place_fingers(
    vertices: FloatArray, triangles: IntArray, wrist: FloatArray, tip: FloatArray, ahead: FloatArray
) -> tuple[dict[str, FloatArray], bool]:
    """Finger and number of the joint -> (3,) metres; and whether five fingers were seen.

    Args:
        vertices: (V, 3) metres.
        triangles: (F, 3).
        wrist: (3,) metres.
        tip: (3,) metres, of the hand.
        ahead: (3,) unit vector to where a thumb is expected.
    """
    length = max(float(np.linalg.norm(tip - wrist)), 1e-6)
    along = (tip - wrist) / length
    near = np.linalg.norm(vertices - (wrist + tip) / 2, axis=1) < _ROOM * length
    own = triangles[near[triangles].all(axis=1)]
    fingers: list[Branch] = []
    if len(own) > 20:
        volume = fill_volume(vertices, own, _CELLS)
        graph = build_graph(volume)
        root = graph.node_near(wrist + _PALM * length * along)
        found = find_branches(graph, root, _LEAST * length)
        fingers = [b for b in found if (b.points[0] - wrist) @ along > 0.35 * length][:6]
        if len(fingers) == 5:
            return _seen(fingers, wrist, tip), True
        across = _across(volume, wrist, along, ahead)
    else:
        across = ahead - (ahead @ along) * along
        across /= max(float(np.linalg.norm(across)), 1e-9)
    return _usual(wrist, along, across, length), False


def _seen(fingers: list[Branch], wrist: FloatArray, tip: FloatArray) -> dict[str, FloatArray]:
    """Joints on the ways of five fingers."""
    length = float(np.linalg.norm(tip - wrist))
    along = (tip - wrist) / length
    bases = np.array([b.at(_KNUCKLE * b.along[-1]) for b in fingers])
    ends = np.array([b.points[0] for b in fingers])
    thumb = int(np.argmin((ends - wrist) @ along + (bases - wrist) @ along))
    rest = [k for k in range(5) if k != thumb]
    spread = np.linalg.svd(bases[rest] - bases[rest].mean(axis=0))[2][0]
    spread *= np.sign(spread @ (ends[thumb] - bases[rest].mean(axis=0))) or 1.0
    rest.sort(key=lambda k: -float(bases[k] @ spread))
    out = {}
    for finger, k in zip(FINGERS[1:], rest, strict=True):
        for number, share in enumerate(_JOINTS, start=1):
            out[f"{finger}_{number}"] = fingers[k].at(share * _KNUCKLE * float(fingers[k].along[-1]))
    reach = ends[thumb] - wrist
    start = wrist + _THUMB[0] * length * along + _THUMB[1] * (reach - (reach @ along) * along)
    for number, share in enumerate(_THUMB_JOINTS, start=1):
        out[f"thumb_{number}"] = ends[thumb] + share * (start - ends[thumb])
    return out


def _across(volume: Volume, wrist: FloatArray, along: FloatArray, ahead: FloatArray) -> FloatArray:
    """(3,) unit vector across a closed hand, towards its thumb."""
    points = volume.centres(np.argwhere(volume.inside)) - wrist
    flat = points - (points @ along)[:, None] * along
    flat -= flat.mean(axis=0)
    axis = np.linalg.svd(flat.T @ flat)[0][:, 0]
    return np.asarray(axis * (np.sign(axis @ ahead) or 1.0))


def _usual(wrist: FloatArray, along: FloatArray, across: FloatArray, length: float) -> dict[str, FloatArray]:
    out = {}
    for finger, (base, end) in _USUAL.items():
        start, stop = (wrist + length * (a * along + c * across) for a, c in (base, end))
        for number, share in enumerate(_JOINTS, start=1):
            out[f"{finger}_{number}"] = stop + share * (start - stop)
    return out
