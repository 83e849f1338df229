"""The rows of the table of steps that treat a motion as a signal."""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Literal

import numpy as np

from muybridge.errors import MuybridgeError
from muybridge.geometry.skeleton.motion import Motion
from muybridge.motion.contacts.keeping import keep_feet
from muybridge.motion.editing.arguments import Parameter, Step
from muybridge.motion.editing.channels import body_roles
from muybridge.motion.formats.registry import read_file
from muybridge.motion.signals.bands import split_bands
from muybridge.motion.signals.reaching import ENDS, reach_key
from muybridge.motion.signals.time_warping import time_map, warp_time
from muybridge.motion.signals.warping import Method, keys_of_motion, warp_to_keys
from muybridge.motion.style.files import load_style
from muybridge.motion.take import Take
from muybridge.wording import counted

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


def _warp(take: Take, file: str, times: Sequence[float] | None, method: Method, blend: float, feet: Feet) -> tuple[
    Take, str
]:  # fmt: skip
    motion = _motion(take)
    poses = read_file(Path(file)).motion
    if poses is None:
        raise MuybridgeError(f"{file}: holds points, which are no key poses", remedy="fit_points")
    try:
        keys = keys_of_motion(poses, motion, times or ())
    except MuybridgeError as error:
        raise error.about(file) from error
    out, note = _with_feet(take, warp_to_keys(motion, keys, method, blend), feet)
    asked = times or [k / poses.fps for k in range(len(poses))]
    moved = float(np.abs(keys.frames / motion.fps - asked).max())
    if moved > 1e-6:
        note += f"; keys put on the nearest frames, by up to {moved * 1e3:.0f} ms"
    at = ", ".join(f"{f / motion.fps:.3g}" for f in keys.frames[:6]) + (", ..." if len(keys.frames) > 6 else "")
    return out, f"{counted(len(keys.frames), 'key pose')} of {counted(int(keys.keyed.sum()), 'joint')} at {at} s{note}"


def _timewarp(take: Take, times: Sequence[tuple[float, float]]) -> tuple[Take, str]:
    motion = _motion(take)
    warp = time_map(times, (len(motion) - 1) / motion.fps)
    speed = np.diff(warp(np.linspace(0, warp.new[-1], 1001))) / (warp.new[-1] / 1000)
    out = replace(take, motion=warp_time(motion, times), keys=None)
    return (
        out,
        f"{counted(len(times), 'moment')} moved; speed between {speed.min():.2f} and {speed.max():.2f} of its own",
    )


def _reach(
    take: Take, part: str, time: float, x: float, y: float, z: float, blend: float, feet: Feet, style: str | None
) -> tuple[Take, str]:
    motion, place = _motion(take), np.array([x, y, z])
    learned = None if style is None else load_style(Path(style))
    roles = body_roles(take) if learned is None else learned.roles
    try:
        key = reach_key(motion, part, time, place, roles, learned)
    except MuybridgeError as error:
        raise error if style is None or not error.remedy else error.about(style) from error
    before = motion.select(key.frames).joint_positions_world()[0, roles[part]]
    out, note = _with_feet(take, warp_to_keys(motion, key, blend=blend), feet)
    away = float(np.linalg.norm(place - before))
    return (
        out,
        f"{part} moved by {away:.2f} m in frame {int(key.frames[0]) + 1}, with {int(key.keyed.sum())} joints{note}",
    )


_BLEND = Parameter("blend", "time", "over which the change comes and goes, before and behind the keys (0.5 s)", 0.5)
SIGNAL_STEPS = (
    Step("bands", "scale the frequency bands of the movement, from fine to coarse", _bands, (
        Parameter("gains", "factor", "one for each octave, the fastest first; 1 for those that are left out",
                  required=True, many=True), _FEET)),
    Step("warp", "bend the movement so that it passes through key poses", _warp, (
        Parameter("file", "file", "of key poses of the same skeleton: its frames, a pose each", required=True),
        Parameter("times", "time", "of the poses, in seconds of the clip (those of the file's own frames)", many=True),
        Parameter("method", "name", "add to the movement, or scale its swings (add)", "add",
                  choices=("add", "multiply")), _BLEND, _FEET)),
    Step("timewarp", "put moments of the clip at other times, smoothly in between", _timewarp, (
        Parameter("times", "times", "what is at OLD seconds happens at NEW seconds: 1.0=0.8", required=True,
                  many=True),)),
    Step("reach", "bring a hand or a foot to a place at a time", _reach, (
        Parameter("part", "name", "which", required=True, choices=ENDS),
        Parameter("time", "time", "when", required=True),
        Parameter("x", "length", "metres in the world", required=True),
        Parameter("y", "length", "metres in the world", required=True),
        Parameter("z", "length", "metres up", required=True), _BLEND, _FEET,
        Parameter("style", "file", "of a style learned from takes, in which the rest of the body is posed (none)"))),
)  # fmt: skip
