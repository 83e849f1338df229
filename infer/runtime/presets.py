"""Presets: how much time a run takes, against how accurate it is.

A preset sets options that were left at their defaults; those that were given are kept. What each costs and gains is in
docs/benchmarks.md.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any, Literal, TypeVar

Preset = Literal["fast", "balanced", "accurate"]
_Options = TypeVar("_Options")

# Values of options by their path in `RunOptions`. Those of `balanced` are the defaults.
PRESETS: Mapping[Preset, Mapping[str, Any]] = {
    "fast": {
        "detect.keypoints.onnx.flip": False,
        "detect.keypoints.refine_crop": False,
        "detect.keypoints.most_fps": 20.0,
        "refinement.everywhere": False,
        "diagnose": False,
        "overlays": False,
    },
    "balanced": {},
    "accurate": {
        "detect.keypoints.onnx.size": 1.0,
        "detect.keypoints.onnx.flip": True,
        "detect.keypoints.people.every": 1,
        "detect.keypoints.most_fps": 1000.0,
        "refinement.most_fps": 1000.0,
    },
}


def with_preset(options: _Options, preset: Preset, defaults: _Options) -> _Options:
    """The options with a preset's values where they are those of `defaults`.

    Raises:
        ValueError: no such preset.
    """
    if preset not in PRESETS:
        raise ValueError(f"preset is {preset!r}: one of {', '.join(PRESETS)}")
    for path, value in PRESETS[preset].items():
        options = _with_value(options, path.split("."), value, defaults)
    return options


def _with_value(options: _Options, path: list[str], value: Any, defaults: Any) -> _Options:
    """The options with one value, by the names of the fields that lead to it."""
    name, *rest = path
    now, before = getattr(options, name), getattr(defaults, name)
    if rest:
        value = _with_value(now, rest, value, before)
    elif now != before:
        return options
    changed: Any = replace(options, **{name: value})  # type: ignore[type-var]
    return changed  # type: ignore[no-any-return]
