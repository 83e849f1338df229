"""Draw docs/assets/motion-graph.webp: distances of windows with their transitions, and a walk along a path.

    python -m scripts.assets.graph_picture

The takes are generated: `scripts.benchmarks.motion.walking_takes`. Needs the `train` extra.
"""

from __future__ import annotations

import io
from pathlib import Path

import numpy as np

from muybridge.infer.pipelines.characters import graphs
from muybridge.infer.pipelines.characters.graph_pictures import draw_matrix, draw_trail
from muybridge.motion.graphs import build_graph, floor_path
from scripts.benchmarks.motion.walking_takes import walking_takes

PICTURE = Path(__file__).resolve().parents[2] / "docs" / "assets" / "motion-graph.webp"
FRAMES = 4000
CORNERS = np.array([(0.0, 0.0), (0.0, -4.0), (3.0, -7.0), (3.0, -11.0), (0.0, -14.0)])


def main() -> None:
    """Draw the picture."""
    import matplotlib

    matplotlib.use("Agg")
    import matplotlib.pyplot as plt
    from PIL import Image

    names, clips = zip(*walking_takes(FRAMES), strict=True)
    graph = build_graph(clips, names, [n.split("_")[0] for n in names]).graph
    wanted = floor_path(CORNERS)
    walked = graphs.walk(graph, wanted)
    figure, (left, right) = plt.subplots(1, 2, figsize=(11, 5), layout="constrained")
    draw_matrix(left, graph)
    draw_trail(right, walked.trail, wanted)
    drawn = io.BytesIO()
    figure.savefig(drawn, dpi=90)
    Image.open(drawn).convert("RGB").save(PICTURE, "WEBP", quality=75, method=6)
    print(PICTURE, PICTURE.stat().st_size)


if __name__ == "__main__":
    main()
