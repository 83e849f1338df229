"""A skeleton whose joints have axes of their own, as other programs make them, as one with the world's axes at rest."""

from collections.abc import Callable, Sequence

import numpy as np

from muybridge.arrays import FloatArray
from muybridge.errors import FormatError
from muybridge.geometry.numerics.rotations import continuous_quat, quat_from_matrix
from muybridge.geometry.skeleton.motion import Motion
from muybridge.geometry.skeleton.skeleton import Skeleton

_SLIDE_M = 1e-3


def motion_in_world_axes(
    names: Sequence[str],
    parents: Sequence[int],
    turns: FloatArray,
    places: FloatArray,
    rest: FloatArray,
    tips: FloatArray,
    fps: float,
    error: Callable[[str], FormatError],
) -> Motion:
    """The motion of joints that are known by where they are and how they stand.

    Args:
        names: of the J joints; of those of one name all but the first get a number.
        parents: (J,) the root first, parents before children.
        turns: (T, J, 3, 3) world from joint.
        places: (T, J, 3) metres.
        rest: (J, 3, 3) world from joint at rest.
        tips: (J, 3) metres to the end of a bone, in the joint's axes; NaN where there is none.
        fps: frames a second.
        error: what is raised, from what is wrong.

    Raises:
        FormatError: from `error`, a joint slides against its parent.
    """
    count = len(parents)
    offsets = np.zeros((count, 3))
    for i, parent in enumerate(parents[1:], start=1):
        local = (np.swapaxes(turns[:, parent], 1, 2) @ (places[:, i] - places[:, parent])[..., None])[..., 0]
        offsets[i] = rest[parent] @ local.mean(axis=0)
        slide = np.ptp(local, axis=0).max()
        if slide > _SLIDE_M:
            raise error(
                f"the joint {names[i]!r} slides by {slide * 1e3:.1f} mm against its parent, and a "
                "skeleton with constant bones is needed: bake translations into rotations"
            )
    world = turns @ np.swapaxes(rest, 1, 2)
    local = np.stack(
        [world[:, i] if p < 0 else np.swapaxes(world[:, p], 1, 2) @ world[:, i] for i, p in enumerate(parents)], axis=1
    )
    free = np.full((count, 3), np.inf)
    skeleton = Skeleton(
        names=_different(names),
        parents=tuple(parents),
        offsets=offsets,
        tips=np.einsum("jab,jb->ja", rest, tips),
        twist_axis=(2,) * count,
        lower=-free,
        upper=free,
    )
    return Motion(skeleton, fps, places[:, 0], continuous_quat(quat_from_matrix(local)))


def frame_times(first: float, last: float, fps: float, keys: int, error: Callable[[str], FormatError]) -> FloatArray:
    """(T,) seconds of even frames from the first of `keys` keys to the last; `error` where they lie too far apart."""
    count = (last - first) * fps + 1
    if not count < 10_000 + 100 * keys:
        raise error(f"its keys lie {last - first:g} s apart, too far for {fps:g} frames a second")
    return np.asarray(first + np.arange(round(count)) / fps)


def _different(names: Sequence[str]) -> tuple[str, ...]:
    out: list[str] = []
    for name in names:
        other, k = name, 1
        while other in out:
            other, k = f"{name}.{k:03d}", k + 1
        out.append(other)
    return tuple(out)
