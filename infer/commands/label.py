"""The command `label`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import tyro

from muybridge.geometry.markers.cleaning import CleanOptions


def label(
    file: Annotated[tyro.conf.Positional[Path], tyro.conf.arg(metavar="FILE")],
    /,
    out: Path,
    markerset: str = "pig39",
    corrections: Path | None = None,
    model: Path | None = None,
    fps: float | None = None,
    overwrite: bool = False,
    clean: CleanOptions = CleanOptions(),  # noqa: B008 - frozen
) -> int:
    """Name the markers of a recording that nobody has labelled, or not rightly.

    Args:
        file: points as C3D, TRC or CSV.
        out: folder of the results: `labelled.c3d`, `label.json`, `report.html`.
        markerset: what the person wears: `pig39`, `cmu41`, ... or a text file of your own.
        corrections: what a person settled, a line each (see docs/labelling.md); it is kept in the results folder, where
            later runs find it.
        model: labelling network; the shipped one by default.
        fps: frames a second, where the file does not say.
        overwrite: replace files in the results folder that muybridge did not write or that were changed.
        clean: spikes and gaps.
    """
    from muybridge.infer.labelling.label import LabelOptions
    from muybridge.infer.pipelines.labelling import run_label

    print(run_label(file, out, markerset, corrections, model, fps, overwrite, LabelOptions(), clean))
    return 0
