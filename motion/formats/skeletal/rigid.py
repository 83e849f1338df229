"""Motions for formats whose bones keep their lengths."""

from pathlib import Path

from muybridge.errors import FormatError
from muybridge.geometry.skeleton.motion import Motion


def with_rigid_bones(path: Path, motion: Motion) -> Motion:
    """The motion with joints fixed that slide by less than a millimetre.

    Raises:
        FormatError: a joint slides farther, or there are several roots; the message names `path`.
    """
    try:
        return motion.with_rigid_bones()
    except ValueError as error:
        suffix = Path(path).suffix.lower()
        raise FormatError(f"{path}: {error}, which {suffix} cannot hold; write .glb, .fbx or .bvh instead") from error
