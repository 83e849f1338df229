"""Choosing one of the animations that a file holds."""

from collections.abc import Callable, Sequence
from pathlib import Path

from muybridge.errors import FormatError

Clip = str | int | None


def choose_clip(names: Sequence[str], clip: Clip, error: Callable[..., FormatError]) -> int | None:
    """Number of the animation to read; None where there is none and none was asked for.

    Args:
        names: of the file's animations, no two the same.
        clip: one of them, or its number from 0; None is the first.
        error: makes the exception from what is wrong and the remedy's key.

    Raises:
        FormatError: there is no such clip; the message lists those there are.
    """
    if clip is None:
        return 0 if names else None
    if isinstance(clip, str) and clip in names:
        return list(names).index(clip)
    number = int(clip) if isinstance(clip, int) or clip.isdecimal() else -1
    if 0 <= number < len(names):
        return number
    listed = ", ".join(f"{i} {name!r}" for i, name in enumerate(names)) or "none"
    raise error(f"has no clip {clip!r}; its clips are: {listed}", "choose_clip")


def first_clip_notice(path: Path, names: Sequence[str]) -> str:
    """The notice that the first of a file's several animations `names` was read, since none was asked for."""
    return f"{path.name}: the first of its {len(names)} clips was read, {names[0]!r}" if names else ""
