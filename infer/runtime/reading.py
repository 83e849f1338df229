"""Files of motion and points as the commands read them: with a notice where the size is nobody's."""

import shlex
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

from muybridge.geometry.roles import find_motion_roles
from muybridge.geometry.skeleton.skeleton import Skeleton
from muybridge.motion.formats.registry import ReadOptions, read_file
from muybridge.motion.formats.stature import leg_metres, likely_scale
from muybridge.motion.take import Take


def read_for_command(path: Path, options: ReadOptions | None = None) -> Take:
    """`read_file`, with one notice more where a body has the size of no figure.

    Raises:
        FormatError: as `read_file`.
    """
    take = read_file(path, options)
    if take.motion is None:
        return take
    names = take.motion.skeleton.names
    found = find_motion_roles(take.motion, {bone: names[j] for bone, j in take.humanoid.items()})
    return replace(take, notices=(*take.notices, *size_notices(path, take.motion.skeleton, found.roles)))


def size_notices(path: Path, skeleton: Skeleton, roles: Mapping[str, int]) -> tuple[str, ...]:
    """A notice that a body is far too large or small, with the command that corrects it, where there is one."""
    legs = leg_metres(skeleton, roles)
    scale = likely_scale(legs)
    if scale is None:
        return ()
    fixed = path.with_name(f"{path.stem}_scaled.glb").name
    return (f"{path.name}: its legs are {legs:.3g} m long by the unit that it is in; to correct that, run `muybridge "
            f"edit {shlex.quote(str(path))} scale {scale:.4g} {shlex.quote(fixed)}`",)  # fmt: skip
