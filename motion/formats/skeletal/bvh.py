"""BVH, the text format of animation: a hierarchy of offsets and Euler angles.

Our files are Y up and in metres, so that Blender's default import (scale 1, forward -Z, up Y) shows them upright and at
the right size: (x, y, z)_bvh = (x_world, z_world, -y_world). At rest the body stands in a T-pose and faces +Z.

The format states neither unit nor axes: reading keeps lengths unless a scale is given, and takes Y for up. All joints
have the file's axes at rest; a skeleton's own axes are not written. Joints that slide have position channels, which
replace their OFFSET, unless all of them are zero in all frames; several roots are several hierarchies.
"""

from dataclasses import replace
from pathlib import Path
from typing import Literal

import numpy as np
import scipy

from muybridge.arrays import FloatArray
from muybridge.errors import FormatError, parsing
from muybridge.files import replacing
from muybridge.geometry.numerics.rotations import continuous_quat
from muybridge.geometry.skeleton.motion import Motion
from muybridge.geometry.skeleton.skeleton import Skeleton
from muybridge.motion.formats.points.common import METRES_OF_UNIT
from muybridge.motion.formats.skeletal.bvh_text import (
    AXES,
    BvhJoint,
    BvhWords,
    name_apart,
    offset_of,
    read_joints,
    read_values,
)
from muybridge.motion.formats.skeletal.euler import smooth_euler
from muybridge.motion.take import Take

_SHORTEST_M = 0.01
BVH_FROM_WORLD = np.array([[1.0, 0, 0], [0, 0, 1], [0, -1, 0]])
_STILL = 2e-6  # of a unit, or of the position: by less a joint does not slide
# The unit of a BVH is given, or recognised by the body's height.
METRES_OF_LENGTH = METRES_OF_UNIT | {"dm": 0.1, "cmu": 0.0254 / 0.45}
# Height of a body in units, and the unit that this implies. Nothing is guessed outside these ranges, where two units
# would make a person or none does.
_TALL = ((0.4, 3.0, "m"), (11.0, 20.0, "dm"), (20.0, 40.0, "cmu"), (45.0, 85.0, "in"), (100.0, 300.0, "cm"),
         (1000.0, 3000.0, "mm"))  # fmt: skip
_JOINTS_OF_A_BODY = 8


def write_bvh(path: Path, motion: Motion, units: Literal["m", "cm"] = "m") -> None:
    """Write a motion: six channels on roots and sliding joints, three on every other, end sites on the tips.

    An end site is at least 1 cm from its joint, as some programs drop a bone without length. Spaces in names become
    underscores, since a name ends at a space.

    Args:
        path: the file to write; replaced only once it is complete.
        motion: metres, Z up.
        units: what one unit of the file is; the format does not state it.

    Raises:
        OutputError: the file cannot be written.
    """
    skeleton, per_metre = motion.skeleton, {"m": 1.0, "cm": 100.0}[units]
    order: list[int] = []
    lines = ["HIERARCHY"]
    names = ["_".join(n.split()) or "_" for n in skeleton.names]
    names = [n if n not in names[:i] else f"{n}.{i:03d}" for i, n in enumerate(names)]
    scaled = replace(
        skeleton, names=tuple(names), offsets=skeleton.offsets * per_metre, tips=_long_tips(skeleton) * per_metre
    )
    for root in skeleton.roots:
        _write_joint(scaled, root, 0, lines, order)
    xyzw = np.roll(motion.quat_wxyz[:, order], -1, axis=-1)
    xyzw[..., :3] = xyzw[..., :3] @ BVH_FROM_WORLD.T
    t_count = len(motion)
    degrees = np.degrees(smooth_euler(xyzw, "ZXY"))
    moved = {0: motion.root_positions_world @ BVH_FROM_WORLD.T * per_metre}
    if motion.translations is not None:
        slides = motion.translations @ BVH_FROM_WORLD.T * per_metre
        moved |= {j: slides[:, k] for k, j in enumerate(skeleton.sliding)}
    columns = [c for k, j in enumerate(order) for c in ([moved[j]] if j in moved else []) + [degrees[:, k]]]
    lines += ["MOTION", f"Frames: {t_count}", f"Frame Time: {1 / motion.fps:.9f}"]
    lines += [" ".join(f"{v:.6f}" for v in row) for row in np.concatenate(columns, axis=1)]
    with replacing(path) as temporary:
        temporary.write_text("\n".join(lines) + "\n", encoding="utf-8", newline="\n")


def _long_tips(skeleton: Skeleton) -> FloatArray:
    """(J, 3): tips of at least 1 cm; an unknown one continues the direction of its bone."""
    tips = np.nan_to_num(skeleton.tips)
    short = np.linalg.norm(tips, axis=1) < _SHORTEST_M
    for directions in (skeleton.offsets, np.tile([0.0, 0.0, 1.0], (len(tips), 1)), tips):
        length = np.linalg.norm(directions, axis=1)
        use = short & (length > 1e-6)
        tips[use] = directions[use] * (_SHORTEST_M / length[use])[:, None]
    return np.asarray(tips)


def _write_joint(skeleton: Skeleton, j: int, depth: int, lines: list[str], order: list[int]) -> None:
    def offset(vector: FloatArray) -> str:
        return "OFFSET " + " ".join(f"{v + 0.0:.9f}" for v in BVH_FROM_WORLD @ vector)

    order.append(j)
    indent = "  " * depth
    rotations = "Zrotation Xrotation Yrotation"
    lines.append(f"{indent}{'JOINT' if depth else 'ROOT'} {skeleton.names[j]}")
    lines.append(f"{indent}{{")
    lines.append(f"{indent}  {offset(skeleton.offsets[j])}")
    moves = depth == 0 or j in skeleton.sliding
    position = "Xposition Yposition Zposition " if moves else ""
    lines.append(f"{indent}  CHANNELS {6 if moves else 3} {position}{rotations}")
    children = [k for k, parent in enumerate(skeleton.parents) if parent == j]
    for child in children:
        _write_joint(skeleton, child, depth + 1, lines, order)
    if not children:
        end = offset(skeleton.tips[j])
        lines += [f"{indent}  End Site", f"{indent}  {{", f"{indent}    {end}", f"{indent}  }}"]
    lines.append(f"{indent}}}")


def read_bvh(path: Path, metres_per_unit: float = 1.0) -> Motion:
    """Read a motion into metres, Z up.

    Args:
        path: the file.
        metres_per_unit: what one unit of the file is: 1 for ours, 0.01 for many, 0.0254 / 0.45 for CMU's.

    Returns:
        A Motion; its skeleton has no limits (BVH knows none) and the file's rest pose. Position channels of joints
        below the root replace their OFFSET; where they change over time, the joint slides.

    Raises:
        FormatError: malformed; the message names the line.
    """
    return read_bvh_file(path, metres_per_unit)[0]


def read_bvh_file(path: Path, metres_per_unit: float = 1.0) -> tuple[Motion, tuple[str, ...]]:
    """As `read_bvh`, with what was assumed in reading, one sentence each."""
    path = Path(path)
    with parsing(path, FormatError, "a BVH"):
        text = path.read_text(encoding="utf-8-sig", errors="replace").replace("\r\n", "\n").replace("\r", "\n")
        words = BvhWords(path, text)
        return _read(words, metres_per_unit), tuple(words.notices)


def _read(words: BvhWords, metres_per_unit: float) -> Motion:
    words.expect("HIERARCHY")
    words.expect("ROOT")
    joints: list[BvhJoint] = []
    read_joints(words, joints)
    while words.expect("MOTION", "ROOT") == "root":
        read_joints(words, joints)
    name_apart(words, joints)
    values, fps = read_values(words, sum(len(j.channels or ()) for j in joints))
    places, quat_xyzw = _split_channels(words, joints, values)
    quat_xyzw[..., :3] = quat_xyzw[..., :3] @ BVH_FROM_WORLD
    still = np.array([j.offset for j in joints])
    sliding = tuple(j for j in range(1, len(joints)) if j in places or joints[j].parent < 0)
    offsets = still @ BVH_FROM_WORLD * metres_per_unit
    tips = np.array([np.full(3, np.nan) if j.tip is None else j.tip for j in joints]) @ BVH_FROM_WORLD
    for j, joint in enumerate(joints):
        if joint.parent < 0 and j:
            offsets[j] -= offsets[0]
    offsets[0] = 0.0
    free = np.full((len(joints), 3), np.inf)
    skeleton = Skeleton(
        names=tuple(j.name for j in joints),
        parents=tuple(j.parent for j in joints),
        offsets=offsets,
        tips=tips * metres_per_unit,
        twist_axis=(2,) * len(joints),
        lower=-free,
        upper=free,
        sliding=sliding,
    )
    quat = continuous_quat(np.roll(quat_xyzw, 1, axis=-1))
    slides = [places.get(j, np.tile(still[j], (len(values), 1))) @ BVH_FROM_WORLD for j in sliding]
    translations = np.stack(slides, axis=1) * metres_per_unit if slides else None
    return Motion(skeleton, fps, places[0] @ BVH_FROM_WORLD * metres_per_unit, quat, translations)


def _split_channels(
    words: BvhWords, joints: list[BvhJoint], values: FloatArray
) -> tuple[dict[int, FloatArray], FloatArray]:
    """Positions (T, 3) of the roots and of joints that slide, and rotations (T, J, 4) xyzw, in the file's axes.

    Position channels of other joints replace their OFFSET in `joints`.
    """
    t_count = len(values)
    quat = np.zeros((t_count, len(joints), 4))
    quat[..., 3] = 1.0
    places: dict[int, FloatArray] = {}
    stated: dict[int, FloatArray] = {}
    column = 0
    for j, joint in enumerate(joints):
        names = joint.channels or ()
        mine = values[:, column : column + len(names)]
        column += len(names)
        turning = [k for k, name in enumerate(names) if name.endswith("rotation")]
        if turning and t_count:
            order = "".join(names[k][0] for k in turning).upper()
            turns = scipy.spatial.transform.Rotation.from_euler(order, mine[:, turning], degrees=True)
            quat[:, j] = turns.as_quat().reshape(t_count, 4)
        place = np.tile(offset_of(joint), (t_count, 1))
        for k, name in enumerate(names):
            if name.endswith("position"):
                place[:, AXES.index(name[0])] = mine[:, k]
        stated[j] = place
    unused = _unused(joints, stated)
    if unused:
        words.notice("the position channels of its joints are zero in all frames: unused, so their OFFSET holds")
    for j, joint in enumerate(joints):
        place = np.tile(offset_of(joint), (t_count, 1)) if j in unused else stated[j]
        # A few units of the last printed decimal are not a movement.
        if joint.parent < 0 or t_count and (np.ptp(place, axis=0) > _STILL * np.maximum(1.0, abs(place).max(0))).any():
            places[j] = place
        elif t_count:
            joint.offset = np.median(place, axis=0)
    return places, quat


def _unused(joints: list[BvhJoint], places: dict[int, FloatArray]) -> set[int]:
    """Joints that position channels would put onto their parents in all frames, if no such channel says otherwise."""
    moved = {
        j for j, joint in enumerate(joints)
        if joint.parent >= 0 and any(c.endswith("position") for c in joint.channels or ())
        and len(places[j]) and np.abs(places[j] - offset_of(joint)).max() > _STILL
    }  # fmt: skip
    return moved if all(not places[j].any() for j in moved) else set()


def read_bvh_take(path: Path, units: str | None = None) -> Take:
    """Read a BVH into metres.

    Args:
        path: the file.
        units: m, dm, cm, mm, in or cmu (0.0254 / 0.45 m); None recognises the unit by how tall the body is at rest.

    Raises:
        FormatError: malformed, an unknown unit, or a height that fits none.
    """
    if units is not None:
        if units not in METRES_OF_LENGTH:
            raise FormatError(f"{path}: {units!r} is not a unit; valid are {', '.join(METRES_OF_LENGTH)}")
        motion, notices = read_bvh_file(path, METRES_OF_LENGTH[units])
        return Take(motion=motion, notices=notices)
    motion, notices = read_bvh_file(path)
    metres, guess = metres_per_unit_of(Path(path), motion)
    if metres == 1.0:
        return Take(motion=motion, notices=notices)
    return Take(motion=read_bvh_file(path, metres)[0], notices=(*notices, *guess))


def metres_per_unit_of(path: Path, motion: Motion) -> tuple[float, list[str]]:
    """Metres that a unit of a BVH is, by how tall the body is at rest, and a notice where this was a guess.

    Args:
        path: named in messages.
        motion: of the file, read as if a unit were a metre.

    Raises:
        FormatError: the height fits no unit.
    """
    tall = _height(motion)
    for low, high, unit in _TALL:
        if low <= tall <= high:
            metres = METRES_OF_LENGTH[unit]
            return metres, [] if unit == "m" else [
                f"{path.name}: the body is {tall:.4g} units tall, so a unit is taken to be {metres:.4g} m ({unit})"
            ]
    if len(motion.skeleton) < _JOINTS_OF_A_BODY:  # not a person, so its height implies nothing
        return 1.0, []
    raise FormatError(
        f"{path}: the body is {tall:.4g} units tall, and BVH does not state what a unit is", remedy="bvh_units",
        units=", ".join(METRES_OF_LENGTH),
    )  # fmt: skip


def _height(motion: Motion) -> float:
    """Largest extent of the joints and tips at rest, in the motion's unit."""
    rest, tips = motion.skeleton.rest_positions, motion.skeleton.tips
    ends = np.concatenate([rest, (rest + tips)[np.isfinite(tips).all(axis=1)]])
    return float(np.ptp(ends, axis=0).max())
