"""Pictures of motion graphs: the matrix of distances with its minima, clips with their transitions, walks."""

import base64
import html
import io
import textwrap
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from muybridge.arrays import FloatArray
from muybridge.errors import MuybridgeError
from muybridge.files import replacing
from muybridge.infer.pipelines.characters.graphs import summary
from muybridge.motion.graphs.distances import sampled_distances
from muybridge.motion.graphs.graph import MotionGraph
from muybridge.motion.graphs.paths import FloorPath

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

PICTURES = (".png", ".svg", ".webp", ".html")
_SIDE = 700  # windows along a side of the matrix that is drawn
_MOST_ARCS = 1500
_COLOURS = ("#2a7f8e", "#d9713c", "#6d94b8", "#8a9a3b", "#a05a8c", "#c9a227")


def check_picture(path: Path) -> None:
    """MuybridgeError for a file that no picture can be written to."""
    if path.suffix.lower() not in PICTURES:
        raise MuybridgeError(f"{path}: a picture is written as {', '.join(PICTURES)}", remedy="other_name")


def draw_graph(path: Path, graph: MotionGraph) -> None:
    """Write a picture of a graph: distances of all windows with the transitions on the left, clips with the transitions
    as arcs on the right.

    Raises:
        MuybridgeError: the suffix is of no picture, or the file cannot be written.
    """
    check_picture(path)
    figure = _figure(13, 6.4)
    left, right = figure.subplots(1, 2, width_ratios=(1, 1))
    draw_matrix(left, graph)
    _draw_arcs(right, graph)
    _write(path, figure, f"Motion graph: {summary(graph)}")


def draw_walk(path: Path, trail: FloatArray, wanted: FloorPath | None, title: str) -> None:
    """Write a picture of a walk from above.

    Args:
        path: file to write.
        trail: (T, 2) metres, of the hips.
        wanted: path that was to be followed; None for none.
        title: above the picture.

    Raises:
        MuybridgeError: the suffix is of no picture, or the file cannot be written.
    """
    check_picture(path)
    figure = _figure(7, 7)
    draw_trail(figure.subplots(), trail, wanted)
    _write(path, figure, title)


def draw_matrix(axes: "Axes", graph: MotionGraph) -> None:
    """The distances of all windows, dark where they are alike, and a dot for each transition."""
    frames = np.unique(np.linspace(0, len(graph) - 1, min(_SIDE, len(graph))).astype(np.int64))
    distances = sampled_distances([graph.clip(k) for k in range(len(graph.names))], graph.window, frames)
    seconds = len(graph) / graph.fps
    known = distances[np.isfinite(distances)]
    image = axes.imshow(distances * 100, cmap="gray", extent=(0, seconds, seconds, 0), vmin=0,
                        vmax=100 * float(np.quantile(known, 0.9)) if len(known) else 1.0)  # fmt: skip
    ways = graph.transitions
    few = len(ways) < 2000
    axes.plot(ways.enter / graph.fps, ways.leave / graph.fps, ".", color="#d9713c", markersize=4 if few else 1.5)
    for start in graph.starts[1:-1] / graph.fps if len(graph.names) <= 60 else ():
        axes.axhline(start, color="#2a7f8e", linewidth=0.5)
        axes.axvline(start, color="#2a7f8e", linewidth=0.5)
    axes.set_xlabel("seconds: window entered")
    axes.set_ylabel("seconds: window left")
    axes.figure.colorbar(image, ax=axes, label="distance of windows, cm", fraction=0.046)


def _draw_arcs(axes: "Axes", graph: MotionGraph) -> None:
    ways, starts = graph.transitions, graph.starts
    rows = {k: len(graph.names) - 1 - k for k in range(len(graph.names))}
    labels = sorted(set(graph.labels))
    for k, label in enumerate(graph.labels):
        colour = _COLOURS[labels.index(label) % len(_COLOURS)]
        length = (starts[k + 1] - starts[k]) / graph.fps
        axes.plot([0, length], [rows[k], rows[k]], color="#cccccc", linewidth=2)
        inside = np.flatnonzero(graph.component[starts[k] : starts[k + 1]])
        if len(inside):
            axes.plot(inside[[0, -1]] / graph.fps, [rows[k], rows[k]], color=colour, linewidth=3)
    some = np.unique(np.linspace(0, max(len(ways) - 1, 0), min(len(ways), _MOST_ARCS)).astype(int)) if len(ways) else ()
    clip, behind = graph.clip_of, ways.enter + graph.window
    for e in some:
        a, b = int(clip[ways.leave[e]]), int(clip[behind[e]])
        x = np.array([ways.leave[e] - starts[a], behind[e] - starts[b]]) / graph.fps
        y = np.array([rows[a], rows[b]], dtype=float)
        s = np.linspace(0, 1, 16)
        bow = 0.35 * np.sin(np.pi * s) if a == b else np.zeros(16)
        alpha = float(np.clip(60 / len(some), 0.04, 0.6))
        axes.plot(x[0] + s * (x[1] - x[0]), y[0] + s * (y[1] - y[0]) + bow, color="#22384d", linewidth=0.6, alpha=alpha)
    if len(rows) <= 40:
        axes.set_yticks(list(rows.values()), [graph.names[k] for k in rows], fontsize=8)
    else:
        axes.set_yticks([])
    axes.set_xlabel("seconds in the clip")
    axes.set_title("coloured: connected; lines: transitions", fontsize=9)
    axes.spines[["top", "right", "left"]].set_visible(False)


def draw_trail(axes: "Axes", trail: FloatArray, wanted: FloorPath | None) -> None:
    """Where the hips went, from above, and the path that was wanted."""
    if wanted is not None:
        axes.plot(*wanted.places.T, color="#22384d", linewidth=1.2, linestyle="--", label="path")
    axes.plot(*trail.T, color="#d9713c", linewidth=1.6, label="hips")
    axes.plot(*trail[0], "o", color="#2a7f8e", markersize=6, label="start")
    axes.set_aspect("equal", adjustable="datalim")
    axes.set_xlabel("x, metres")
    axes.set_ylabel("y, metres")
    axes.grid(color="#dddddd", linewidth=0.6)
    axes.set_axisbelow(True)
    axes.legend(frameon=False, fontsize=8)


def _figure(width: float, height: float) -> "Figure":
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=(width, height), dpi=110, layout="constrained")
    FigureCanvasAgg(figure)
    return figure


def _write(path: Path, figure: "Figure", title: str) -> None:
    if path.suffix.lower() != ".html":
        columns = int(12 * figure.get_figwidth())  # characters of this size that fit beside each other
        figure.suptitle("\n".join(textwrap.wrap(title, columns)), fontsize=10)
    with replacing(path) as temporary:
        if path.suffix.lower() != ".html":
            figure.savefig(temporary)
            return
        picture = io.BytesIO()
        figure.savefig(picture, format="png")
        temporary.write_text(_PAGE.format(title=html.escape(title), png=base64.b64encode(picture.getvalue()).decode()),
                             encoding="utf-8")  # fmt: skip


_PAGE = """<!DOCTYPE html>
<html lang="en"><head><meta charset="utf-8"><meta name="generator" content="muybridge graph">
<title>muybridge graph</title></head>
<body style="font-family: system-ui, sans-serif; margin: 2rem; color: #22384d"><p>{title}</p>
<img style="max-width: 100%" alt="{title}" src="data:image/png;base64,{png}"></body></html>
"""
