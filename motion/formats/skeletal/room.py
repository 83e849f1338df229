"""Motions that no room could hold, as damage and wrong units make them."""

from pathlib import Path

import numpy as np

from muybridge.errors import FormatError
from muybridge.geometry.skeleton.motion import Motion
from muybridge.motion.formats.points.world import FARTHEST


def check_room(path: Path, motion: Motion) -> None:
    """Check that no joint or tip of a motion is beyond any room.

    Raises:
        FormatError: one is; the message names it and its first such frame.
    """
    names, places = motion.skeleton.names, motion.joint_positions_world()
    with np.errstate(over="ignore", invalid="ignore"):
        far = ~(np.abs(places) <= FARTHEST).all(axis=-1)
        long = (np.abs(np.nan_to_num(motion.skeleton.tips)) > FARTHEST).any(axis=-1)
    if far.any():
        t, j = np.argwhere(far)[0]
        raise FormatError(
            f"{path}: the joint {names[j]!r} is {np.abs(places[t, j]).max():.3g} m from the origin in frame {t + 1}, "
            "beyond any room: the file is damaged, or in another unit"
        )
    if long.any():
        raise FormatError(f"{path}: the bone of {names[int(np.argmax(long))]!r} is longer than any room")
