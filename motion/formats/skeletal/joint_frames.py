"""A motion from the positions and orientations of its joints in the world, as other programs' files give them."""

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from muybridge.arrays import FloatArray
from muybridge.errors import FormatError
from muybridge.geometry.numerics.rotations import continuous_quat, quat_from_matrix
from muybridge.geometry.skeleton.motion import Motion
from muybridge.geometry.skeleton.skeleton import Skeleton

# Metres by which a joint may move against its parent and still count as fixed; errors add up along a chain.
_SLIDE_M = 1e-6


def motion_from_frames(
    names: Sequence[str],
    parents: Sequence[int],
    turns: FloatArray,
    places: FloatArray,
    rest: FloatArray,
    tips: FloatArray,
    fps: float,
    world_from_file: FloatArray,
    rest_translations: FloatArray | None = None,
) -> Motion:
    """The motion of joints whose frames in the world are known.

    Args:
        names: of the J joints; of those of one name all but the first get a number.
        parents: (J,) -1 for a root, the first joint a root, parents before children.
        turns: (T, J, 3, 3) world from joint, in the joint's own axes.
        places: (T, J, 3) metres.
        rest: (J, 3, 3) world from joint at rest.
        tips: (J, 3) metres to the end of a bone, in the joint's axes; NaN where there is none.
        fps: frames per second.
        world_from_file: (3, 3) axes of the file; a joint with these at rest has no axes of its own.
        rest_translations: (J, 3) metres from the parent at rest, in the parent's axes (a root's: in the world), NaN
            where unknown; used for joints that slide, whose first frame counts where it is unknown.

    Returns:
        A Motion; joints that move against their parents slide in it.
    """
    count = len(parents)
    offsets = np.zeros((count, 3))
    at_rest = np.full((count, 3), np.nan) if rest_translations is None else rest_translations
    sliding, slides = [], []
    for i, parent in enumerate(parents[1:], start=1):
        if parent < 0:
            sliding.append(i)
            slides.append(places[:, i])
            first = at_rest[i] - at_rest[0]
            offsets[i] = first if np.isfinite(first).all() else places[0, i] - places[0, 0]
            continue
        local = (np.swapaxes(turns[:, parent], 1, 2) @ (places[:, i] - places[:, parent])[..., None])[..., 0]
        if np.ptp(local, axis=0).max() > _SLIDE_M:
            sliding.append(i)
            slides.append(local @ rest[parent].T)
            offsets[i] = rest[parent] @ (at_rest[i] if np.isfinite(at_rest[i]).all() else local[0])
        else:
            offsets[i] = rest[parent] @ local.mean(axis=0)
    world = turns @ np.swapaxes(rest, 1, 2)
    local = np.stack(
        [world[:, i] if p < 0 else np.swapaxes(world[:, p], 1, 2) @ world[:, i] for i, p in enumerate(parents)], axis=1
    )
    free = np.full((count, 3), np.inf)
    skeleton = Skeleton(
        names=different_names(names),
        parents=tuple(parents),
        offsets=offsets,
        tips=np.einsum("jab,jb->ja", rest, tips),
        twist_axis=(2,) * count,
        lower=-free,
        upper=free,
        axes=None if np.allclose(rest, world_from_file, atol=1e-7) else rest,
        sliding=tuple(sliding),
    )
    translations = np.stack(slides, axis=1) if slides else None
    return Motion(skeleton, fps, places[:, 0], continuous_quat(quat_from_matrix(local)), translations)


def skeleton_at_rest(
    names: Sequence[str],
    parents: Sequence[int],
    rest: FloatArray,
    places: FloatArray,
    tips: FloatArray,
    world_from_file: FloatArray,
) -> Skeleton:
    """The skeleton of joints whose frames at rest are known; no joint slides but further roots.

    Args:
        names: of the J joints; of those of one name all but the first get a number.
        parents: (J,) -1 for a root, the first joint a root, parents before children.
        rest: (J, 3, 3) world from joint.
        places: (J, 3) metres.
        tips: (J, 3) metres from joints to the ends of their bones, in the world; NaN where there is none.
        world_from_file: (3, 3) axes of the file; a joint with these has no axes of its own.
    """
    free = np.full((len(parents), 3), np.inf)
    return Skeleton(
        names=different_names(names),
        parents=tuple(parents),
        offsets=np.stack([places[i] - places[max(p, 0)] for i, p in enumerate(parents)]),
        tips=tips,
        twist_axis=(2,) * len(parents),
        lower=-free,
        upper=free,
        axes=None if np.allclose(rest, world_from_file, atol=1e-7) else rest,
        sliding=tuple(i for i, p in enumerate(parents) if p < 0 and i),
    )


def motion_of_skeleton(
    skeleton: Skeleton, turns: FloatArray, places: FloatArray, fps: float, world_from_file: FloatArray
) -> Motion:
    """The motion of a skeleton whose joints' frames are known; joints that leave their place slide.

    Args:
        skeleton: whose offsets hold wherever they can.
        turns: (T, J, 3, 3) world from joint, in the joint's own axes.
        places: (T, J, 3) metres.
        fps: frames per second.
        world_from_file: (3, 3) the axes at rest of a skeleton without axes of its own.
    """
    parents = skeleton.parents
    rest = np.tile(world_from_file, (len(parents), 1, 1)) if skeleton.axes is None else skeleton.axes
    world = turns @ np.swapaxes(rest, 1, 2)
    local, sliding, slides = world.copy(), [], []
    for i, p in enumerate(parents):
        if p < 0:
            shift = places[:, i]
        else:
            up = np.swapaxes(world[:, p], 1, 2)
            local[:, i] = up @ world[:, i]
            shift = (up @ (places[:, i] - places[:, p])[..., None])[..., 0]
        if i and (p < 0 or np.abs(shift - skeleton.offsets[i]).max(initial=0.0) > _SLIDE_M):
            sliding.append(i)
            slides.append(shift)
    moved = replace(skeleton, sliding=tuple(sliding))
    quat = continuous_quat(quat_from_matrix(local))
    return Motion(moved, fps, places[:, 0], quat, np.stack(slides, axis=1) if slides else None)


def frame_times(first: float, last: float, fps: float, keys: int, error: Callable[[str], FormatError]) -> FloatArray:
    """(T,) seconds of even frames from the first of `keys` keys to the last; `error` where they lie too far apart."""
    count = (last - first) * fps + 1
    if not count < 10_000 + 100 * keys:
        raise error(f"its keys lie {last - first:g} s apart, too far for {fps:g} frames per second")
    return np.asarray(first + np.arange(round(count)) / fps)


def different_names(names: Sequence[str]) -> tuple[str, ...]:
    """The names, with `.001`, `.002`, ... added to those that occurred before."""
    out: list[str] = []
    for name in names:
        other, k = name, 1
        while other in out:
            other, k = f"{name}.{k:03d}", k + 1
        out.append(other)
    return tuple(out)
