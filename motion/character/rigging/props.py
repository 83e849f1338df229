"""Islands of a mesh that are no part of the body: what it holds or carries on one side only."""

import numpy as np
from scipy import ndimage

from muybridge.arrays import BoolArray, FloatArray, IntArray
from muybridge.motion.character.rigging.repair import Repaired
from muybridge.motion.character.rigging.volume import Volume

_LARGE = 0.2  # of the body's extent: smaller islands cannot mislead
_ALIKE = 0.55  # share of an island that has a mirror image in the body, below which it is a prop
_MOST_OF_VOLUME = 0.4  # of the faces' box volumes that may be props; else the pose is not symmetric
_POINTS = 300


def find_props(whole: Repaired, volume: Volume, body_from_world: FloatArray) -> BoolArray:
    """(I,) islands without a counterpart on the other side of the body.

    Args:
        whole: the surface.
        volume: of it.
        body_from_world: (4, 4) to the frame that is symmetric about x = 0.
    """
    count = int(whole.island.max(initial=-1)) + 1
    out = np.zeros(count, np.bool_)
    if count == 1:
        return out
    near = ndimage.binary_dilation(volume.inside, iterations=2)
    extent = float(np.ptp(whole.vertices, axis=0).max())
    side, offset = body_from_world[0, :3], -float(body_from_world[0, 3])
    sizes = np.zeros(count)
    for k in range(count):
        points = whole.vertices[np.unique(whole.triangles[whole.island == k])]
        span = np.ptp(points, axis=0)
        sizes[k] = float(np.prod(np.maximum(span, 0.02 * extent)))
        if span.max() < _LARGE * extent:
            continue
        points = points[:: max(len(points) // _POINTS, 1)]
        image = points - 2 * (points @ side - offset)[:, None] * side
        at = np.round((image - volume.origin) / volume.cell).astype(np.int64)
        good = ((at >= 0) & (at < np.array(near.shape))).all(axis=1)
        out[k] = near[tuple(at[good].T)].sum() < _ALIKE * len(points)
    out[int(np.argmax(sizes * ~out))] = False
    return out if sizes[out].sum() < _MOST_OF_VOLUME * sizes.sum() else np.zeros(count, np.bool_)


def without_islands(whole: Repaired, left_out: BoolArray) -> Repaired:
    """A surface without some of its islands; vertices stay as they are numbered."""
    kept = ~left_out[whole.island]
    return Repaired(whole.vertices, whole.triangles[kept], whole.island[kept], whole.source, whole.inside_out,
                    whole.dropped)  # fmt: skip


def holders(
    whole: Repaired, props: BoolArray, joints: FloatArray, hands: tuple[int, ...], vertices: FloatArray
) -> IntArray:
    """(N,) of the vertices as given, the joint that each is rigid to; -1 for those of the body.

    A prop that comes near a hand hangs on it; any other moves with the body, as its weights say.

    Args:
        whole: with all islands.
        props: (I,) which of them are props.
        joints: (J, 3) metres, in the frame of `vertices`.
        hands: joints of the hands.
        vertices: (V, 3) metres, those of `whole` in that frame.
    """
    out = np.full(len(whole.source), -1, np.int64)
    near = 0.1 * float(np.ptp(joints, axis=0).max())
    for k in np.flatnonzero(props):
        mine = np.unique(whole.triangles[whole.island == k])
        away = np.linalg.norm(vertices[mine][:, None] - joints[None], axis=2).min(axis=0)
        hand = min(hands, key=lambda j: float(away[j]), default=-1)
        if hand >= 0 and away[hand] < near:
            out[np.isin(whole.source, mine)] = hand
    return out
