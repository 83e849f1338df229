"""Files of motion joined one behind the other, or blended into one between them."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from muybridge.errors import MuybridgeError
from muybridge.geometry.skeleton.motion import Motion
from muybridge.infer.pipelines.convert import read_files, written_files
from muybridge.infer.results.ownership import check_replaceable, refuse_root
from muybridge.infer.runtime.reading import read_for_command
from muybridge.motion.blending import (
    JoinOptions,
    RegistrationCurve,
    Weights,
    blend_motions,
    join_motions,
    plant_blend,
    register,
    same_skeleton,
)
from muybridge.motion.contacts.feet import feet_of_motion
from muybridge.motion.contacts.find import Contacts
from muybridge.motion.contacts.footskate import measure_footskate
from muybridge.motion.formats.registry import ReadOptions, can_use, check_writable
from muybridge.motion.take import Take
from muybridge.wording import counted


@dataclass(frozen=True, eq=False)
class Material:
    """What several files hold, ready to be made into one motion.

    Attributes:
        motions: of one skeleton and one frame rate.
        names: of their files.
        notices: what was assumed, one sentence each.
    """

    motions: tuple[Motion, ...]
    names: tuple[str, ...]
    notices: tuple[str, ...]


@dataclass(frozen=True, eq=False)
class Made:
    """One motion out of several.

    Attributes:
        take: the motion.
        told: what was done, one line each.
        notices: what could not be done, one sentence each.
    """

    take: Take
    told: tuple[str, ...]
    notices: tuple[str, ...]


def check_files(files: Sequence[Path], out: Path, overwrite: bool, what: str) -> None:
    """Check that there are files to be read, and that the one to be written may be.

    Args:
        files: to be read.
        out: to be written.
        overwrite: whether what is there may be replaced.
        what: for messages, "a join" or "a blend".

    Raises:
        MuybridgeError: there are fewer than two files, one is not there, or `out` cannot or may not be written.
    """
    refuse_root(out)
    check_writable(out)
    if len(files) < 2:
        raise MuybridgeError(f"{what} needs at least two files of motion")
    for file in files:
        if not file.is_file():
            raise MuybridgeError(f"{file}: no such file; give an existing one")
    read = [path for file in files for path in read_files(file, None)]
    check_replaceable(written_files(out), overwrite, read, make_folders=False)


def read_material(files: Sequence[Path], options: ReadOptions, fps: float | None = None) -> Material:
    """Read files of motion of one skeleton.

    Args:
        files: at least one.
        options: those that a file's format cannot use are left out for it.
        fps: frames per second of the result; None takes those of the first file.

    Raises:
        MuybridgeError: a file cannot be read, holds points, or moves another skeleton than the first one. The message
            names it.
    """
    motions: list[Motion] = []
    names: list[str] = []
    notices: list[str] = []
    for file in files:
        usable = {name: getattr(options, name) for name in ("units", "clip") if can_use(file, name)}
        take = read_for_command(file, ReadOptions(**usable))
        if take.motion is None:
            raise MuybridgeError(f"{file} holds points, and no skeleton that could be joined or blended",
                                 remedy="fit_points")  # fmt: skip
        motions.append(take.motion)
        names.append(file.name)
        notices += take.notices
    same, resampled = same_skeleton(motions, names, fps)
    return Material(tuple(same), tuple(names), (*dict.fromkeys(notices), *resampled))


def join_files(material: Material, options: JoinOptions, at: Sequence[float] = ()) -> Made:
    """Join motions, each to the next one.

    Args:
        material: at least two motions.
        options: how.
        at: seconds, of each join two: when the motion before is left, and when the next one is entered; none finds the
            best place.

    Raises:
        MuybridgeError: as `join_motions`; or there are more or fewer times than the joins need.
    """
    joins = len(material.motions) - 1
    if at and len(at) != 2 * joins:
        needs = f"{counted(joins, 'join')} need{'s' if joins == 1 else ''} {2 * joins} times, not {len(at)}"
        raise MuybridgeError(f"{needs}: of each, when the one motion is left and when the next one is entered")
    times = list(zip(at[::2], at[1::2], strict=True))
    for k, (leave, enter) in enumerate(times):
        _check_time(material, k, leave)
        _check_time(material, k + 1, enter)
    joined = join_motions(material.motions, material.names, options, times)
    fps = joined.motion.fps
    told = []
    for k, (place, frame, seconds) in enumerate(zip(joined.places, joined.frames, joined.seconds, strict=True)):
        shown = f"in {seconds:.2f} s" if seconds else "without a transition"
        told.append(f"{material.names[k]} at {place.leave / fps:.2f} s -> {material.names[k + 1]} at "
                    f"{place.enter / fps:.2f} s: frame {frame + 1}, {shown}; poses {place.gap * 1e3:.0f} mm apart, "
                    f"turned by {np.degrees(place.yaw):.0f} degrees")  # fmt: skip
    if joined.contacts is not None:
        told.append(f"feet move by {joined.drift() * 1e3:.1f} mm at most while they stand about the joins")
    return Made(Take(motion=joined.motion), tuple(told), joined.notes)


def _check_time(material: Material, k: int, seconds: float) -> None:
    motion = material.motions[k]
    last = (len(motion) - 1) / motion.fps
    if not -0.5 / motion.fps <= seconds <= last + 0.5 / motion.fps:
        raise MuybridgeError(f"{material.names[k]} lasts from 0 to {last:g} s, and has no frame at {seconds:g} s")


def blend_files(
    material: Material, weights: Sequence[float] = (), times: Sequence[float] = (), plant: bool = True
) -> Made:
    """Blend motions.

    Args:
        material: at least two motions.
        weights: one for each motion, or that many for one time after the other; none counts all alike.
        times: seconds of the blend at which several sets of weights hold; none spreads them evenly.
        plant: whether feet are planted where they stand in the motions.

    Raises:
        MuybridgeError: as `Weights.checked` and `register`.
    """
    count = len(material.motions)
    chosen = Weights.checked(weights or [1 / count] * count, count, times)
    curve = register(material.motions, material.names)
    blended = blend_motions(curve, chosen)
    motion = blended.motion
    notices: list[str] = []
    told = [_registered(curve, material.names, k) for k in range(count) if k != curve.reference]
    if plant:
        try:
            planted = plant_blend(blended, curve)
        except ValueError as error:
            notices.append(f"feet are not planted: {error}")
        else:
            motion = planted.motion
            told.append(_drift(motion, planted.contacts))
    return Made(Take(motion=motion), tuple(told), tuple(notices))


def _registered(curve: RegistrationCurve, names: Sequence[str], k: int) -> str:
    fps = curve.motions[k].fps
    (a, b), (c, d) = curve.frames(np.array([curve.start, curve.end]))[[k, curve.reference]] / fps
    return (f"{names[k]} from {a:.2f} to {b:.2f} s goes with {names[curve.reference]} from {c:.2f} to {d:.2f} s; poses "
            f"{curve.costs[k] * 1e3:.0f} mm apart")  # fmt: skip


def _drift(motion: Motion, contacts: Contacts) -> str:
    places = feet_of_motion(motion).places
    drift = max(
        measure_footskate(places[:, k, p], contacts.contact[:, k, p], motion.fps).extent for k in (0, 1) for p in (0, 1)
    )
    return f"feet move by {drift * 1e3:.1f} mm at most while they stand"
