"""Sentences that describe the faults of a calibration; what a user can do about them is up to the front end."""

from __future__ import annotations

from collections.abc import Sequence

from muybridge.geometry.calibration.diagnosis.findings import Kind

TOO_MANY = (
    "The remaining cameras fit no better than that: with half of the cameras wrong, the correct ones cannot be "
    "identified."
)


def rivals_sentence(rivals: Sequence[str]) -> str:
    """Which other cameras may be the faulty one."""
    return f"It could also be {' or '.join(rivals)}: these landmarks cannot distinguish between them."


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


def shift_sentence(name: str, frames: float, effect_px: float) -> str:
    """A video that is `frames` late (negative: early)."""
    late = frames > 0
    return (
        f"{name} is {abs(frames):.1f} frames {'late' if late else 'early'} ({effect_px:.0f} px in its image): it shows "
        f"{'after' if late else 'before'} a given frame what the other cameras show at that frame."
    )


def focal_sentence(name: str, share: float, effect_px: float, also: Sequence[Kind]) -> str:
    """A focal length that is wrong by a share of itself (positive: too large)."""
    text = (
        f"The focal length of {name} is {abs(share):.1%} too {'large' if share > 0 else 'small'} ({effect_px:.0f} px "
        "in its image): was it zoomed or refocused, or is its lens that of another camera?"
    )
    if {"moved", "turned"} & set(also):
        text += " A movement of the camera explains it nearly as well."
    return text


def pose_sentence(name: str, kind: Kind, turn_deg: float, move: float, effect_px: float, also: Sequence[Kind]) -> str:
    """A camera that was rotated by degrees, or moved by metres as well."""
    change = f"turned by {turn_deg:.1f} degrees"
    if kind == "moved":
        change = f"moved by {move * 100:.0f} cm and turned by {turn_deg:.1f} degrees"
    elif "moved" in also:
        change = f"turned by about {turn_deg:.1f} degrees, and perhaps moved,"
    return (
        f"{name} was {change} after the calibration ({effect_px:.0f} px in its image), or its image is cropped "
        "differently."
    )


def unrelated_sentence(name: str, error_px: float) -> str:
    """A camera that no explanation corrects."""
    return (
        f"{name} shows a different scene from the other cameras ({error_px:.0f} px apart), and no rotation, movement, "
        "time shift, focal length or swap of files corrects it: is it a video of another take, or a calibration of "
        "another place?"
    )
