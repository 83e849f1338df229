"""Sentences that describe the faults of a calibration; what a user can do about them is up to the front end."""

from __future__ import annotations

from collections.abc import Sequence

from muybridge.geometry.calibration.diagnosis.findings import Kind

TOO_MANY = (
    "The remaining cameras fit no better than that: with half of the cameras wrong, the correct ones cannot be "
    "identified."
)

_MAYBE: dict[Kind, str] = {
    "turned": "was turned", "moved": "was moved", "focal": "has another focal length", "shifted": "is out of step",
    "swapped": "has the file of another camera", "unrelated": "shows something else",
}  # fmt: skip


def measured(size: float, sd: float, digits: int = 1) -> str:
    """A size with its standard deviation, not less than the last digit shown."""
    return f"{size:.{digits}f} ± {max(sd, 10.0**-digits):.{digits}f}"


def rivals_sentence(name: str, rivals: Sequence[str]) -> str:
    """Cameras of which one is faulty, before the sentence that says what is wrong if it is `name`."""
    return f"Either {' or '.join([name, *rivals])} is wrong; these landmarks cannot tell which. If it is {name}:"


def doubt_sentence(trials: Sequence[tuple[str, Kind]], frames: int) -> str:
    """Cameras that may be faulty, and how, though the take does not prove it."""
    each = ", or ".join(f"{name} {_MAYBE[kind]}" for name, kind in trials)
    return (
        f"Whether {each} cannot be judged from this take ({frames} frames): the signs are within what errors of the "
        "landmarks explain. A take of several seconds in which somebody walks about, turns and raises the arms tells."
    )


def swap_sentence(names: Sequence[str], owners: Sequence[str]) -> str:
    """Cameras whose video files are permuted.

    Args:
        names: cameras with a wrong file.
        owners: for each, the camera whose file belongs to it.
    """
    if len(names) == 2:
        return f"The video files of {names[0]} and {names[1]} are swapped: each fits the rig with the other's file."
    pairs = ", ".join(f"{name} has that of {owner}" for name, owner in zip(names, owners, strict=True))
    return f"The video files of {', '.join(names)} are swapped: the rig fits where {pairs}."


def shift_sentence(name: str, frames: float, sd: float, effect_px: float) -> str:
    """A video that is `frames` late (negative: early)."""
    late = frames > 0
    return (
        f"{name} is {measured(abs(frames), sd)} frames {'late' if late else 'early'} ({effect_px:.0f} px in its "
        f"image): it shows {'after' if late else 'before'} a given frame what the other cameras show at that frame."
    )


def focal_sentence(name: str, share: float, sd: float, effect_px: float, also: Sequence[Kind]) -> str:
    """A focal length that is wrong by a share of itself (positive: too large)."""
    text = (
        f"The focal length of {name} is {measured(100 * abs(share), 100 * sd)} % too "
        f"{'large' if share > 0 else 'small'} ({effect_px:.0f} px in its image): was it zoomed or refocused, or is its "
        "lens that of another camera?"
    )
    if {"moved", "turned"} & set(also):
        text += " A movement of the camera explains it nearly as well."
    return text


def pose_sentence(
    name: str, turn: tuple[float, float], move: tuple[float, float] | None, effect_px: float, also: Sequence[Kind]
) -> str:
    """A camera that was rotated by degrees, or moved by metres as well; each with its standard deviation."""
    change = f"turned by {measured(*turn)} degrees"
    if move is not None:
        change = f"moved by {measured(100 * move[0], 100 * move[1], 0)} cm and {change}"
    elif "moved" in also:
        change += ", and perhaps moved,"
    text = f"{name} was {change} after the calibration ({effect_px:.0f} px in its image), or its image is cropped "
    text += "differently."
    if "focal" in also:
        text += " Another focal length explains it nearly as well."
    return text


def unrelated_sentence(name: str, error_px: float) -> str:
    """A camera that no explanation corrects."""
    return (
        f"{name} shows a different scene from the other cameras ({error_px:.0f} px apart), and no rotation, movement, "
        "time shift, focal length or swap of files corrects it: is it a video of another take, or a calibration of "
        "another place?"
    )
