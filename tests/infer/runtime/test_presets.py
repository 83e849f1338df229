"""Presets set what was left at its default."""

from dataclasses import replace
from typing import get_args

import pytest

from muybridge.infer.pipelines.videos import RunOptions
from muybridge.infer.runtime.presets import PRESETS, Preset, with_preset


def _value(options: object, path: str) -> object:
    for name in path.split("."):
        options = getattr(options, name)
    return options


@pytest.mark.parametrize("preset", get_args(Preset))
def test_every_value_of_a_preset_is_set_and_none_is_the_default(preset: Preset) -> None:
    options = with_preset(RunOptions(), preset, RunOptions())
    for path, value in PRESETS[preset].items():
        assert _value(options, path) == value != _value(RunOptions(), path)


def test_balanced_is_the_default() -> None:
    assert RunOptions().preset == "balanced"
    assert with_preset(RunOptions(), "balanced", RunOptions()) == RunOptions()


def test_options_that_were_given_are_kept() -> None:
    given = RunOptions()
    given = replace(
        given, detect=replace(given.detect, workers=1, keypoints=replace(given.detect.keypoints, most_fps=5))
    )
    options = with_preset(given, "fast", RunOptions())
    assert options.detect.workers == 1 and options.detect.keypoints.most_fps == 5
    assert options.detect.keypoints.onnx.flip is False and not options.overlays


def test_other_names_are_refused() -> None:
    with pytest.raises(ValueError, match="fast, balanced, accurate"):
        with_preset(RunOptions(), "quick", RunOptions())  # type: ignore[arg-type]
