"""The command `label`: names for the markers of an unlabelled recording."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import tyro

from muybridge.geometry.markers.cleaning import CleanOptions


def label(
    file: Annotated[tyro.conf.Positional[Path], tyro.conf.arg(metavar="FILE")],
    /,
    out: Path,
    overwrite: bool = False,
    markerset: Annotated[str, tyro.conf.arg(metavar="NAME|FILE")] = "pig39",
    corrections: Path | None = None,
    model: Path | None = None,
    fps: float | None = None,
    clean: CleanOptions = CleanOptions(),  # noqa: B008 - frozen
) -> int:
    """Label the markers of a recording that has no labels, or wrong ones.

    Example:
        muybridge label walk.c3d --markerset pig39 --out results/walk

    Args:
        file: points as C3D, TRC or CSV.
        out: results folder: `labelled.c3d`, `label.json`, `report.html`.
        overwrite: replace files in the results folder that muybridge did not write or that were changed since.
        markerset: markers that the person wears: `pig39`, `cmu41`, another set of `muybridge markerset list`, or a text
            file of your own.
        corrections: manual corrections, one per line (see docs/guides/label-markers.md); the file is copied to the
            results folder, where later runs find it.
        model: labelling network in place of the shipped one.
        fps: frames per second, where the file does not say.
        clean: spikes and gaps.
    """
    from muybridge.infer.labelling.label import LabelOptions
    from muybridge.infer.pipelines.labelling import run_label

    print(run_label(file, out, markerset, corrections, model, fps, overwrite, LabelOptions(), clean))
    return 0
