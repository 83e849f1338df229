"""Another motion in a BVH file whose hierarchy stays as it is, to the letter."""

import re
from pathlib import Path

import numpy as np

from muybridge.arrays import FloatArray
from muybridge.errors import FormatError
from muybridge.files import replacing
from muybridge.geometry.skeleton.motion import Motion
from muybridge.motion.formats.skeletal.bvh import BVH_FROM_WORLD
from muybridge.motion.formats.skeletal.bvh_text import AXES, BvhJoint, BvhWords, offset_of, read_joints
from muybridge.motion.formats.skeletal.euler import smooth_euler

_HELD = 1e-6  # metres
_LOST_DEG = 0.5  # turns that a joint without channels for them may lose unsaid


def write_bvh_motion(source: Path, text: str, metres: float, motion: Motion, path: Path) -> tuple[str, ...]:
    """Write a file's hierarchy with another motion, in the file's own channels.

    Args:
        source: the file, as messages name it.
        text: its contents.
        metres: that one of its units is.
        motion: of its skeleton, joint by joint.
        path: the file to write.

    Returns:
        What could not be kept, one sentence each.

    Raises:
        FormatError: a joint moves against its parent for which the file has no position channels.
        OutputError: the file cannot be written.
    """
    words, joints = BvhWords(source, text), list[BvhJoint]()
    words.expect("HIERARCHY")
    while words.expect("MOTION", "ROOT") == "root":
        read_joints(words, joints)
    skeleton = motion.skeleton
    xyzw = np.roll(motion.quat_wxyz, -1, axis=-1)
    xyzw[..., :3] = xyzw[..., :3] @ BVH_FROM_WORLD.T
    slides = {0: motion.root_positions_world}
    if motion.translations is not None:
        slides |= {j: motion.translations[:, k] for k, j in enumerate(skeleton.sliding)}
    columns, notices = [], []
    for j, joint in enumerate(joints):
        places = np.tile(skeleton.offsets[j], (len(motion), 1)) if j not in slides else slides[j]
        in_file = places @ BVH_FROM_WORLD.T / metres
        channels = joint.channels or ()
        away = np.abs(in_file - offset_of(joint)).max() * metres
        if away > _HELD and sum(c.endswith("position") for c in channels) < 3:
            raise FormatError(f"{source}: the joint {skeleton.names[j]!r} moves by {away:.3g} m from its OFFSET, for "
                              "which the file has no position channels")  # fmt: skip
        turns = [c[0].upper() for c in channels if c.endswith("rotation")]
        angles, lost = _angles(xyzw[:, j], turns)
        if lost > _LOST_DEG:
            notices.append(f"{source.name}: turns of up to {lost:.1f} degrees of {skeleton.names[j]!r} are lost, for "
                           "which it has no channels")  # fmt: skip
        columns += [in_file[:, AXES.index(c[0])] if c.endswith("position") else angles[c[0].upper()] for c in channels]
    start = re.search(r"^\s*MOTION\s*$", text, re.MULTILINE | re.IGNORECASE)
    assert start is not None
    head = text[: start.end()].rstrip("\r\n")
    line = "\r\n" if "\r\n" in text else "\n"
    lines = [f"Frames: {len(motion)}", f"Frame Time: {1 / motion.fps:.9f}"]
    lines += [" ".join(f"{v + 0.0:.6f}" for v in row) for row in np.stack(columns, axis=1)]
    with replacing(path) as temporary:
        temporary.write_text(line.join([head, *lines, ""]), encoding="utf-8", newline="")
    return tuple(notices)


def _angles(xyzw: FloatArray, turns: list[str]) -> tuple[dict[str, FloatArray], float]:
    """(T,) degrees about each axis, turned about in this order, and the largest turn about an axis not among them."""
    order = [*turns, *(axis for axis in "XYZ" if axis not in turns)]
    degrees = np.degrees(smooth_euler(xyzw[:, None], "".join(order))[:, 0])
    lost = np.abs(degrees[:, len(turns) :]).max(initial=0.0)
    return {axis: degrees[:, k] for k, axis in enumerate(order)}, float(lost)
