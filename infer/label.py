"""The command `label`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import tyro

from muybridge.infer.labelling import LabelOptions


def label(
    file: Annotated[tyro.conf.Positional[Path], tyro.conf.arg(metavar="FILE")],
    /,
    out: Path,
    markerset: str = "pig39",
    model: Path | None = None,
    fps: float | None = None,
    overwrite: bool = False,
    options: Annotated[LabelOptions, tyro.conf.arg(name="")] = LabelOptions(),  # noqa: B008 - frozen
) -> int:
    """Name the markers of a recording that nobody has labelled, or not rightly.

    Args:
        file: points as C3D, TRC or CSV.
        out: folder of the results: `labelled.c3d`, `label.json`, `report.html`.
        markerset: what the person wears: `pig39`, `cmu41`, ... or a text file of your own.
        model: labelling network; the shipped one by default.
        fps: frames a second, where the file does not say.
        overwrite: replace files in the results folder that muybridge did not write or that were changed.
        options: how markers are named.
    """
    from muybridge.infer.label_run import run_label

    print(run_label(file, out, markerset, model, fps, overwrite, options))
    return 0
