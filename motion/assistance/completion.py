"""A key-framed clip completed by captured takes: the joints that were not animated, and the texture of the others.

After K. Pullen, C. Bregler, "Motion capture assisted animation: texturing and synthesis", 2002.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from muybridge.arrays import FloatArray
from muybridge.errors import MuybridgeError
from muybridge.geometry.numerics.rotations import conjugate_quat as inverse
from muybridge.geometry.numerics.rotations import continuous_quat, multiply_quat, quat_from_rotvec, rotvec_from_quat
from muybridge.geometry.skeleton.motion import Motion
from muybridge.motion.assistance.fragments import (
    Fragment,
    break_clip,
    find_driving,
    signals_of,
    texture_bands,
)
from muybridge.motion.assistance.joining import joined_rotations, joined_vectors
from muybridge.motion.assistance.matching import Match, match_fragments
from muybridge.motion.assistance.takes import CapturedTake
from muybridge.motion.editing.channels import check_editable
from muybridge.motion.signals.charts import chart_of
from muybridge.motion.signals.filter_bank import filter_bank
from muybridge.wording import counted

STILL = np.radians(0.5)  # of a joint that nobody animated
_FEWEST = 8
_END = 0.25  # seconds at either end of a take without texture, behind which it comes in as slowly


@dataclass(frozen=True)
class AssistOptions:
    """How key frames are completed.

    Attributes:
        texture: gain of the takes' movement above 6 Hz on the key-framed joints below the root; 0 leaves them as they
            are.
        candidates: nearest captured fragments from which a path is chosen.
    """

    texture: float = 0.0
    candidates: int = 24


@dataclass(frozen=True, eq=False)
class Assisted:
    """A completed clip.

    Attributes:
        motion: of the key frames' skeleton, frame by frame.
        made: joints whose movement is captured.
        driving: joints that the takes were matched by.
        wanted: fragments of the key frames.
        match: of takes, one for each.
    """

    motion: Motion
    made: tuple[int, ...]
    driving: tuple[int, ...]
    wanted: tuple[Fragment, ...]
    match: Match


def check_keys(keys: Motion) -> None:
    """Check that a clip is long enough to be divided.

    Raises:
        MuybridgeError: it has too few frames.
    """
    check_editable(keys)
    if len(keys) < _FEWEST:
        raise MuybridgeError(f"the key frames have {counted(len(keys), 'frame')}; at least {_FEWEST} are needed, so "
                             "write every frame of the animation")  # fmt: skip


def still_joints(keys: Motion) -> tuple[int, ...]:
    """The joints below the root that never turn, which nobody animated."""
    away = rotvec_from_quat(multiply_quat(inverse(keys.quat_wxyz[:1]), keys.quat_wxyz))
    angle = np.linalg.norm(away, axis=-1).max(axis=0)
    return tuple(int(j) for j in np.flatnonzero(angle < STILL) if keys.skeleton.parents[j] >= 0)


def driving_joints(keys: Motion, made: Sequence[int], roles: Mapping[str, int]) -> tuple[int, ...]:
    """The joints that takes are matched by: thighs that are key-framed, else upper arms, else the two joints that move
    most.

    Raises:
        MuybridgeError: no joint below the root is key-framed.
    """
    keyed = [j for j in range(len(keys.skeleton)) if j not in set(made) and keys.skeleton.parents[j] >= 0]
    if not keyed:
        raise MuybridgeError("no joint below the root is key-framed; animate some, or name the joints to make")
    for part in ("thigh", "upper_arm"):
        found = [roles[f"{side}_{part}"] for side in ("left", "right") if f"{side}_{part}" in roles]
        if found := [j for j in found if j in keyed]:
            return tuple(found)
    spread = np.ptp(keys.quat_wxyz[:, keyed], axis=0).max(axis=-1)
    return tuple(keyed[int(k)] for k in np.argsort(-spread)[:2])


def assist(
    keys: Motion, takes: Sequence[CapturedTake], made: Sequence[int], driving: Sequence[int],
    options: AssistOptions | None = None,
) -> Assisted:  # fmt: skip
    """Complete a key-framed clip by captured takes.

    The clip and the takes are broken into fragments where the driving joints turn; each fragment of the clip gets one
    of the takes that moves alike, in a row that hangs together, and the joints to be made are theirs, stretched in time
    and faded into each other.

    Args:
        keys: the clip, Z up.
        takes: of its skeleton and frame rate (`bring_take`).
        made: joints to be made.
        driving: joints of the clip that takes are matched by.
        options: how.

    Raises:
        MuybridgeError: no takes, no joints, a clip of too few frames, or driving joints that do not move.
    """
    options = options or AssistOptions()
    check_keys(keys)
    if not takes:
        raise MuybridgeError("no takes are given")
    if not made:
        raise MuybridgeError("no joint is left to be made: all joints move; name those to make")
    if both := [keys.skeleton.names[j] for j in made if j in set(driving)]:
        raise MuybridgeError(f"{both[0]} cannot drive and be made")
    common = find_driving(keys.quat_wxyz, driving, keys.fps)
    ours = signals_of(keys.quat_wxyz, common, keys.fps)
    theirs = [signals_of(take.motion.quat_wxyz, common, keys.fps) for take in takes]
    wanted = break_clip(ours, common, -1)
    captured = [f for k, signals in enumerate(theirs) for f in break_clip(signals, common, k)]
    free = list(made)
    poses = [continuous_quat(take.motion.quat_wxyz[:, free]) for take in takes]
    match = match_fragments(wanted, ours, captured, theirs, common, poses, options.candidates)
    quat = keys.quat_wxyz.copy()
    quat[:, free] = joined_rotations(wanted, match.fragments, poses, len(keys), keys.fps)
    if options.texture:
        kept = [j for j in range(len(keys.skeleton)) if j not in set(made) and keys.skeleton.parents[j] >= 0]
        texture = _texture(takes, kept, wanted, match, keys, options.texture)
        quat[:, kept] = multiply_quat(quat[:, kept], quat_from_rotvec(texture))
    out = replace(keys, quat_wxyz=continuous_quat(quat))
    return Assisted(out, tuple(free), tuple(driving), tuple(wanted), match)


def _texture(
    takes: Sequence[CapturedTake], joints: list[int], wanted: Sequence[Fragment], match: Match, keys: Motion,
    gain: float,
) -> FloatArray:  # fmt: skip
    """(T, K, 3) radians, the takes' fast movement of joints, joined as the fragments are."""
    fast: list[FloatArray] = []
    used = {f.clip for f in match.fragments}
    for k, take in enumerate(takes):
        frames = len(take.motion)
        vectors = np.zeros((frames, len(joints), 3))
        if k in used:
            bands, _ = filter_bank(chart_of(take.motion.quat_wxyz[:, joints]).vectors)
            vectors = bands[: texture_bands(frames, keys.fps)].sum(axis=0)
            # A take that ends in a movement has fast parts at its ends that are the filters'.
            from_end = np.minimum(np.arange(frames), np.arange(frames)[::-1]) / (_END * keys.fps)
            vectors *= (np.clip(from_end - 1, 0, 1) ** 2)[:, None, None]
        fast.append(vectors)
    return gain * joined_vectors(wanted, match.fragments, fast, len(keys), keys.fps)
