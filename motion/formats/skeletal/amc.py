"""ASF and AMC, Acclaim's pair of text files: a skeleton, and its motion in the skeleton's own axes.

A bone of an ASF turns at its parent's end, about axes C that the file gives it, and ends `length` along
`direction`; both are written in the rest pose's axes. With R of the AMC's angles, its rotation in those axes is
C R C^-1, which is what a joint of `Skeleton` has. A joint here bears its bone's name and stands where the bone
begins; several bones that begin at one place are several joints there.

Y is up, as in BVH. A unit of length is `1 / length` inches in the files of the CMU database (`length 0.45`),
and written files keep to that. An AMC does not state its frame rate: CMU's is 120 per second.

Source: the description of both files by Jeff Lander, "Working with Motion Capture File Formats", Game Developer,
January 1998, and the files of the CMU motion capture database.
"""

from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from muybridge.arrays import FloatArray
from muybridge.errors import FormatError, parsing
from muybridge.files import replacing
from muybridge.geometry.numerics.rotations import continuous_quat
from muybridge.geometry.skeleton.motion import Motion
from muybridge.geometry.skeleton.skeleton import Skeleton
from muybridge.motion.formats.skeletal.asf import (
    INCH,
    LENGTH,
    Asf,
    Bone,
    Lines,
    asf_lines,
    bones_of,
    find_asf,
    read_asf_file,
    skeleton_of_asf,
    word,
)
from muybridge.motion.formats.skeletal.bvh import BVH_FROM_WORLD
from muybridge.motion.formats.skeletal.euler import smooth_euler
from muybridge.motion.formats.skeletal.rigid import with_rigid_bones

CMU_FPS = 120.0


def read_amc(path: Path, asf: Path | None = None, fps: float = CMU_FPS) -> Motion:
    """Read a motion and its skeleton into metres, Z up.

    Args:
        path: the AMC file.
        asf: its skeleton; None for the ASF of the same name beside it, or whose name the AMC's begins with (as
            `01.asf` for `01_01.amc`), or the only one there.
        fps: frames per second, which the files do not state.

    Returns:
        A Motion; its skeleton has the file's rest pose. Limits are not kept: the file's are about other axes.

    Raises:
        FormatError: malformed, or the skeleton is not found; the message names file and line.
    """
    path = Path(path)
    if not (np.isfinite(fps) and fps > 0):
        raise ValueError(f"fps must be above zero, not {fps}")
    skeleton_path = find_asf(path) if asf is None else Path(asf)
    with parsing(skeleton_path, FormatError, "an ASF"):
        parsed = read_asf_file(skeleton_path)
        skeleton = skeleton_of_asf(skeleton_path, parsed)
    with parsing(path, FormatError, "an AMC"):
        return _motion(path, parsed, skeleton, fps)


def _motion(path: Path, parsed: Asf, skeleton: Skeleton, fps: float) -> Motion:
    frames = _read_frames(path, parsed)
    t_count = len(next(iter(frames.values()))) if frames else 0
    quat = np.zeros((t_count, len(skeleton), 4))
    root = np.tile(parsed.position, (t_count, 1))
    for j, name in enumerate(skeleton.names):
        bone = parsed.bones[name]
        values = frames.get(name, np.zeros((t_count, len(bone.channels))))
        turn = _turns(bone, values, parsed.degrees)
        rest = parsed.orientation if j == 0 else Rotation.identity()
        quat[:, j] = (bone.axes * turn * bone.axes.inv() * rest).as_quat()
        for k, channel in enumerate(bone.channels):
            if channel.startswith("t") and j == 0:
                root[:, "xyz".index(channel[1])] = values[:, k] + parsed.position["xyz".index(channel[1])]
            elif channel[0] in "tl" and t_count and np.abs(values[:, k]).max() > 1e-6 * max(bone.length, 1.0):
                raise FormatError(
                    f"{path}: the bone {name!r} slides against its parent or changes its length ({channel}); a "
                    "skeleton with constant bones is needed"
                )
    quat[..., :3] = quat[..., :3] @ BVH_FROM_WORLD
    return Motion(skeleton, fps, root @ BVH_FROM_WORLD * parsed.metres, continuous_quat(np.roll(quat, 1, axis=-1)))


def write_amc(path: Path, motion: Motion) -> Path:
    """Write a motion and, beside it under the same name, its skeleton as ASF.

    A bone of an ASF has one end. Where a joint's children do not all begin there, bones that can't move lead to
    them: they are called after the child with `_base`, and are joints of their own when read again.

    Args:
        path: the AMC file to write; both are replaced only once they are complete.
        motion: metres, Z up. Its frame rate is lost: the files have no place for it.

    Returns:
        The ASF file.

    Raises:
        FormatError: a joint slides, or there are several roots.
        OutputError: a file cannot be written.
    """
    path = Path(path)
    motion = with_rigid_bones(path, motion)
    skeleton = motion.skeleton
    names = ["root", *(word(n) for n in skeleton.names[1:])]
    names = [n if n not in names[:i] else f"{n}_{i}" for i, n in enumerate(names)]
    bones, links = bones_of(skeleton, names)
    asf = path.with_suffix(".asf")
    with replacing(asf) as temporary:
        temporary.write_text("\n".join(asf_lines(path.stem, bones, links)) + "\n", encoding="utf-8", newline="\n")
    xyzw = np.roll(motion.quat_wxyz, -1, axis=-1)
    xyzw[..., :3] = xyzw[..., :3] @ BVH_FROM_WORLD.T
    degrees = np.degrees(smooth_euler(xyzw, "xyz"))
    root = motion.root_positions_world @ BVH_FROM_WORLD.T * (LENGTH / INCH)
    lines = [":FULLY-SPECIFIED", ":DEGREES"]
    for t in range(len(motion)):
        lines.append(str(t + 1))
        for j, name in enumerate(names):
            values = np.concatenate([root[t], degrees[t, 0]]) if j == 0 else degrees[t, j]
            lines.append(f"{name} " + " ".join(f"{v + 0.0:.8f}" for v in values))
    with replacing(path) as temporary:
        temporary.write_text("\n".join(lines) + "\n", encoding="utf-8", newline="\n")
    return asf


def _turns(bone: Bone, values: FloatArray, degrees: bool) -> Rotation:
    """The bone's rotation in its own axes; the first channel turns first, about axes that stay."""
    turn = Rotation.identity(len(values))
    for k, channel in enumerate(bone.channels):
        if channel[0] == "r":
            vector = np.zeros((len(values), 3))
            vector[:, "xyz".index(channel[1])] = np.radians(values[:, k]) if degrees else values[:, k]
            turn = Rotation.from_rotvec(vector) * turn
    return turn


def _read_frames(path: Path, asf: Asf) -> dict[str, FloatArray]:
    """The values of each bone's channels, (T, channels)."""
    lines = Lines(path)
    values: dict[str, list[FloatArray]] = {name: [] for name, bone in asf.bones.items() if bone.channels}
    frame = 0

    def whole() -> None:
        short = [name for name, rows in values.items() if len(rows) != frame]
        if short:
            raise lines.error(f"frame {frame} ends without the bone {short[0]!r}")

    while (words := lines.next()) is not None:
        if words[0].startswith(":"):
            if words[0].lower() == ":radians":
                asf.degrees = False
            elif words[0].lower() == ":degrees":
                asf.degrees = True
            continue
        if len(words) == 1 and words[0].isdecimal():
            whole()
            frame += 1
            continue
        rows = values.get(words[0])
        if rows is None:
            raise lines.error(f"the bone {words[0]!r} is unknown to the skeleton, or has no degrees of freedom in it")
        if frame == 0 or len(rows) != frame - 1:
            raise lines.error(f"the bone {words[0]!r} appears twice in frame {frame} or before any frame")
        count = len(asf.bones[words[0]].channels)
        if len(words) != count + 1:
            raise lines.error(f"the bone {words[0]!r} has {len(words) - 1} numbers, but {count} degrees of freedom")
        rows.append(lines.numbers(words[1:], count, f"the bone {words[0]!r}"))
    whole()
    if frame == 0:
        raise FormatError(f"{path}: has no frame; is it an AMC file, and complete?")
    return {name: np.array(rows) for name, rows in values.items()}
