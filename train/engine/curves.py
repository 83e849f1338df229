"""Plots of a training run: loss, scores and throughput against the number of images."""

import json
import pathlib
from typing import Any

from muybridge.files import replacing

# Entries of a log line that are not plotted.
_COUNTERS = ("step", "images", "seconds", "options")


def write_curves(log: pathlib.Path) -> pathlib.Path | None:
    """Plot the figures of `log.jsonl` (see `loop.log_line`) into `curves.png` beside it.

    Dashed lines mark resumed runs; a line cut off by a killed process is skipped.

    Returns:
        Path of the picture; None if nothing has been scored yet.
    """
    from matplotlib.figure import Figure

    lines = _read_lines(log)
    scored = [line for line in lines if "loss" in line]
    if not scored:
        return None
    names = [name for name in scored[-1] if name not in _COUNTERS]
    columns = 3
    rows = -(-len(names) // columns)
    figure = Figure((4.2 * columns, 2.8 * rows), layout="constrained")
    for k, name in enumerate(names):
        axes = figure.add_subplot(rows, columns, k + 1)
        axes.plot([r["images"] / 1e3 for r in scored], [float(r.get(name, "nan")) for r in scored], linewidth=1.2)
        for start in (r["images"] / 1e3 for r in lines if "options" in r and r["images"]):
            axes.axvline(start, color="0.8", linestyle="--", linewidth=0.7, zorder=0)
        axes.set_title(name.replace("_", " "), fontsize=9)
        axes.set_xlabel("thousand images", fontsize=8)
        axes.tick_params(labelsize=8)
        axes.grid(alpha=0.2)
    path = log.with_name("curves.png")
    with replacing(path) as temporary:
        figure.savefig(temporary, format="png", dpi=110)
    return path


def _read_lines(log: pathlib.Path) -> list[dict[str, Any]]:
    lines = []
    for text in log.read_text().splitlines():
        try:
            lines.append(json.loads(text))
        except json.JSONDecodeError:
            continue
    return lines
