"""What motions must share before they are joined, blended or compared: a skeleton, and frames per second."""

from collections.abc import Mapping, Sequence

import numpy as np

from muybridge.errors import MuybridgeError
from muybridge.geometry.skeleton.motion import Motion
from muybridge.geometry.skeleton.skeleton import Skeleton
from muybridge.motion.editing.channels import check_editable
from muybridge.motion.editing.resampling import resample
from muybridge.motion.editing.root_path import GroundPath, ground_path

_SAME_LENGTH = 0.02  # of the larger skeleton's size: offsets that differ by less are of one body


def facing_frames(motion: Motion, smoothing: float = 0.0, roles: Mapping[str, int] | None = None) -> GroundPath:
    """The facing frame of every frame: the hips projected on the floor, and the heading of the body.

    Args:
        motion: Z up.
        smoothing: seconds, standard deviation of a Gaussian; zero follows the hips exactly.
        roles: role -> joint; None finds them.

    Raises:
        MuybridgeError: as `ground_path`.
    """
    return ground_path(motion, smoothing, turning=True, roles=roles)


def same_skeleton(
    motions: Sequence[Motion], names: Sequence[str], fps: float | None = None
) -> tuple[list[Motion], list[str]]:
    """Bring motions to one frame rate, and check that they move one skeleton.

    Args:
        motions: at least one.
        names: of the motions, for messages.
        fps: frames per second of the result; None takes those of the first motion.

    Returns:
        The motions, all on the first one's skeleton; and a sentence on each that was resampled.

    Raises:
        MuybridgeError: a motion is empty or not finite, or its skeleton is another one. The message names it.
    """
    first = motions[0]
    rate = first.fps if fps is None else fps
    out, notes = [], []
    for motion, name in zip(motions, names, strict=True):
        try:
            check_editable(motion)
        except MuybridgeError as error:
            raise MuybridgeError(f"{name}: {error}") from error
        if (why := _difference(first.skeleton, motion.skeleton)) is not None:
            raise MuybridgeError(f"{name} moves another skeleton than {names[0]}: {why}", remedy="other_skeleton")
        if motion.fps != rate:
            notes.append(f"{name} is resampled from {motion.fps:g} to {rate:g} frames/s")
            motion = resample(motion, rate)
        out.append(motion)
    return out, notes


def _difference(one: Skeleton, other: Skeleton) -> str | None:
    """Why two skeletons are not the same; None where they are."""
    if one.names != other.names:
        missing = [n for n in one.names if n not in other.names]
        extra = [n for n in other.names if n not in one.names]
        if missing:
            return f"it has no joint {missing[0]!r}"
        return f"it has a joint {extra[0]!r} more" if extra else "its joints are in another order"
    if one.parents != other.parents:
        joint = next(j for j, (a, b) in enumerate(zip(one.parents, other.parents, strict=True)) if a != b)
        return f"its joint {one.names[joint]!r} hangs from another joint"
    if one.sliding != other.sliding:
        return "other joints of it slide"
    fixed = [j for j in range(len(one)) if j not in one.sliding]
    gaps = np.linalg.norm(one.offsets - other.offsets, axis=1)[fixed]
    size = max(float(np.ptp(s.rest_positions, axis=0).max()) for s in (one, other))
    if len(gaps) and gaps.max() > _SAME_LENGTH * size:
        joint = fixed[int(np.argmax(gaps))]
        return f"the offset of its joint {one.names[joint]!r} differs by {gaps.max() * 1e3:.0f} mm"
    return None
