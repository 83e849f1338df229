"""BVH, the text format of animation: a hierarchy of offsets and Euler angles.

Our files are Y up and in metres, so that Blender's default import (scale 1, forward -Z, up Y) shows them upright and at
the right size: (x, y, z)_bvh = (x_world, z_world, -y_world). At rest the body stands in a T-pose and faces +Z.

The format states neither unit nor axes: reading keeps lengths unless a scale is given, and takes Y for up. All joints
have the file's axes at rest; a skeleton's own axes are not written. Joints that slide have position channels, which
replace their OFFSET; several roots are several hierarchies.
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from decimal import Decimal
from pathlib import Path
from typing import Literal

import numpy as np
from scipy.spatial.transform import Rotation

from muybridge.arrays import FloatArray
from muybridge.errors import FormatError
from muybridge.files import replacing
from muybridge.geometry.numerics.rotations import continuous_quat
from muybridge.geometry.skeleton.motion import Motion
from muybridge.geometry.skeleton.skeleton import Skeleton
from muybridge.motion.formats.skeletal.euler import smooth_euler

_SHORTEST_M = 0.01
BVH_FROM_WORLD = np.array([[1.0, 0, 0], [0, 0, 1], [0, -1, 0]])
_AXES = "xyz"
_STILL = 2e-6  # of a unit, or of the position: by less a joint does not slide
_PRECISE = 0.02  # share of a frame's time that its text may deviate by for the rate to be recognised


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


@dataclass
class _Joint:
    name: str
    parent: int
    line: int
    offset: FloatArray | None = None
    tip: FloatArray | None = None
    channels: tuple[str, ...] | None = None


class _Words:
    """The words of a file with their line numbers; every error names file and line."""

    def __init__(self, path: Path, text: str) -> None:
        self.path = path
        self.size = len(text)
        self._words: Iterator[tuple[int, str]] = (
            (number, word) for number, line in enumerate(text.split("\n"), start=1) for word in line.split()
        )
        self.line = 1

    def next(self, wanted: str) -> str:
        word = next(self._words, None)
        if word is None:
            raise FormatError(f"{self.path}: ends after line {self.line}, where {wanted} must follow; is it cut off?")
        self.line = word[0]
        return word[1]

    def more(self) -> bool:
        """Whether another word follows; it is consumed."""
        word = next(self._words, None)
        self.line = word[0] if word else self.line
        return word is not None

    def bad(self, found: str, wanted: str) -> FormatError:
        return FormatError(
            f"{self.path}: line {self.line}: {found!r} found where {wanted} is expected; correct or re-export the file"
        )

    def expect(self, *words: str) -> str:
        found = self.next(" or ".join(words))
        if found.lower() not in [w.lower() for w in words]:
            raise self.bad(found, " or ".join(words))
        return found.lower()

    def number(self, wanted: str) -> float:
        return self.value(self.next(wanted), wanted)

    def value(self, found: str, wanted: str) -> float:
        try:
            value = float(found)
        except ValueError:
            value = np.nan
        if not abs(value) < 1e12:
            raise self.bad(found, wanted)
        return value

    def count(self, wanted: str) -> int:
        value = self.number(wanted)
        if value < 0 or value != int(value):
            raise self.bad(f"{value:g}", wanted)
        return int(value)

    def vector(self) -> FloatArray:
        return np.array([self.number("an offset's number") for _ in range(3)])


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
    path = Path(path)
    try:
        text = path.read_text(encoding="utf-8-sig", errors="replace").replace("\r\n", "\n").replace("\r", "\n")
    except OSError as error:
        raise FormatError(f"{path}: cannot be read ({error.strerror}); give an existing BVH file") from error
    words = _Words(path, text)
    words.expect("HIERARCHY")
    words.expect("ROOT")
    joints: list[_Joint] = []
    _read_joints(words, joints)
    while words.expect("MOTION", "ROOT") == "root":
        _read_joints(words, joints)
    values, fps = _read_values(words, sum(len(j.channels or ()) for j in joints))
    places, quat_xyzw = _split_channels(joints, values)
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


def _read_joints(words: _Words, joints: list[_Joint]) -> None:
    """The hierarchy, after the word ROOT to the brace that closes it; not recursive, so depth is no
    risk."""
    open_joints: list[int] = []
    while True:
        name = words.next("a joint's name")
        line = words.line
        after = words.next("{")
        while after != "{":  # names with spaces
            if words.line != line or after == "}":
                raise words.bad(after, "{")
            name, after = f"{name}_{after}", words.next("{")
        if name in (j.name for j in joints):
            raise FormatError(f"{words.path}: line {line}: the joint {name!r} appears twice; rename one of them")
        joints.append(_Joint(name, open_joints[-1] if open_joints else -1, line))
        open_joints.append(len(joints) - 1)
        while True:
            joint = joints[open_joints[-1]]
            word = words.expect("OFFSET", "CHANNELS", "JOINT", "End", "}")
            if word == "joint":
                break
            if word == "offset":
                joint.offset = words.vector()
            elif word == "channels":
                joint.channels = _read_channels(words)
            elif word == "end":
                joint.tip = _read_end_site(words)
            else:
                if joint.offset is None:
                    raise FormatError(
                        f"{words.path}: line {joint.line}: the joint {joint.name!r} has no OFFSET; add one"
                    )
                open_joints.pop()
                if not open_joints:
                    return


def _read_channels(words: _Words) -> tuple[str, ...]:
    count = words.count("the number of channels")
    valid = [f"{axis}{kind}" for kind in ("position", "rotation") for axis in _AXES]
    channels = tuple(words.expect(*valid) for _ in range(min(count, 7)))
    if count > 6 or len(set(channels)) != count:
        raise words.bad(f"{count} channels", "at most six different ones")
    return channels


def _read_end_site(words: _Words) -> FloatArray:
    words.expect("Site")
    while words.next("{") != "{":  # some give the end site a name
        pass
    words.expect("OFFSET")
    tip = words.vector()
    words.expect("}")
    return tip


def _read_values(words: _Words, channels: int) -> tuple[FloatArray, float]:
    """(T, channels) and frames per second, after the word MOTION."""
    words.expect("Frames:")
    frames = words.count("the number of frames")
    words.expect("Frame")
    words.expect("Time:")
    text = words.next("the seconds of a frame")
    seconds = words.value(text, "the seconds of a frame")
    if seconds <= 0:
        raise words.bad(f"{seconds:g}", "a frame time above zero")
    if frames * max(channels, 1) > words.size:
        raise FormatError(
            f"{words.path}: announces {frames} frames of {channels} numbers, more than it can hold; is it cut off?"
        )
    values = np.empty((frames, channels))
    for t in range(frames):
        begun = 0
        for c in range(channels):
            values[t, c] = words.number(f"number {c + 1} of {channels} of frame {t + 1}")
            begun = begun or words.line
            if words.line != begun:
                raise FormatError(
                    f"{words.path}: line {begun} has {c} numbers, but the {channels} channels need as many; "
                    "correct the line"
                )
    if words.more():
        raise FormatError(
            f"{words.path}: line {words.line}: more follows the {frames} frames that the file announces; correct "
            "Frames:"
        )
    return values, _rate(text, seconds)


def _rate(text: str, seconds: float) -> float:
    """Frames per second: a whole number where the text is its rounded or truncated reciprocal."""
    fps = 1 / seconds
    whole, last = float(max(round(fps), 1)), Decimal(text).as_tuple().exponent
    decimals = -last if isinstance(last, int) else 0
    ulp = 10.0**-decimals
    rounded = ulp < 2 * _PRECISE * seconds and -ulp < seconds - 1 / whole <= 0.5 * ulp
    return whole if rounded or abs(fps - whole) < 2e-5 * fps else fps


def _split_channels(joints: list[_Joint], values: FloatArray) -> tuple[dict[int, FloatArray], FloatArray]:
    """Positions (T, 3) of the roots and of joints that slide, and rotations (T, J, 4) xyzw, in the file's axes.

    Position channels of other joints replace their OFFSET in `joints`.
    """
    t_count = len(values)
    quat = np.zeros((t_count, len(joints), 4))
    quat[..., 3] = 1.0
    places: dict[int, FloatArray] = {}
    column = 0
    for j, joint in enumerate(joints):
        names = joint.channels or ()
        mine = values[:, column : column + len(names)]
        column += len(names)
        turning = [k for k, name in enumerate(names) if name.endswith("rotation")]
        if turning and t_count:
            order = "".join(names[k][0] for k in turning).upper()
            angles = mine[:, turning] if len(turning) > 1 else mine[:, turning[0]]
            quat[:, j] = Rotation.from_euler(order, angles, degrees=True).as_quat().reshape(t_count, 4)
        assert joint.offset is not None
        place = np.tile(joint.offset, (t_count, 1))
        for k, name in enumerate(names):
            if name.endswith("position"):
                place[:, _AXES.index(name[0])] = mine[:, k]
        # A few units of the last printed decimal are not a movement.
        if joint.parent < 0 or t_count and (np.ptp(place, axis=0) > _STILL * np.maximum(1.0, abs(place).max(0))).any():
            places[j] = place
        elif t_count:
            joint.offset = np.median(place, axis=0)
    return places, quat
