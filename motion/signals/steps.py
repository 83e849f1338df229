"""The rows of the table of steps that treat a motion as a signal."""

from collections.abc import Sequence
from dataclasses import replace
from typing import Literal

from muybridge.errors import MuybridgeError
from muybridge.geometry.skeleton.motion import Motion
from muybridge.motion.contacts.keeping import keep_feet
from muybridge.motion.editing.arguments import Parameter, Step
from muybridge.motion.editing.channels import body_roles
from muybridge.motion.signals.bands import split_bands
from muybridge.motion.take import Take

Feet = Literal["free", "keep"]
_FEET = Parameter("feet", "name", "keep: feet stand where they stood before, and the legs follow (free)", "free",
                  choices=("free", "keep"))  # fmt: skip


def _motion(take: Take) -> Motion:
    assert take.motion is not None  # checked before a step is applied
    return take.motion


def _with_feet(take: Take, motion: Motion, feet: Feet) -> tuple[Take, str]:
    """The take with its edited motion, with feet where they stood if that is asked for, and what was done for them."""
    if feet == "free":
        return replace(take, motion=motion, keys=None), ""
    try:
        kept = keep_feet(motion, _motion(take), roles=body_roles(take))
    except ValueError as error:  # legs that are not known
        raise MuybridgeError(str(error)) from error
    note = f"; feet kept by moving ankles by up to {kept.moved_feet_m * 1e3:.0f} mm"
    if kept.unreached_m > 1e-3:
        note += f", {kept.unreached_m * 1e3:.0f} mm short where a leg is too short"
    return replace(take, motion=kept.motion, keys=None), note


def _bands(take: Take, gains: Sequence[float], feet: Feet) -> tuple[Take, str]:
    bands = split_bands(_motion(take))
    out, note = _with_feet(take, bands.with_gains(gains), feet)
    scaled = [f"{low:.2g} to {high:.2g} Hz times {gain:g}"
              for gain, (low, high) in zip(gains, bands.ranges(), strict=False) if gain != 1]  # fmt: skip
    return out, f"{', '.join(scaled) or 'nothing scaled'}, of {len(bands)} bands{note}"


SIGNAL_STEPS = (
    Step("bands", "scale the frequency bands of the movement, from fine to coarse", _bands, (
        Parameter("gains", "factor", "one for each octave, the fastest first; 1 for those that are left out",
                  required=True, many=True), _FEET)),
)  # fmt: skip
