"""Draw docs/assets/style.webp: one goal of a hand, without a style and in two styles.

    python -m scripts.assets.style_picture

The takes are generated: walks and runs of `scripts.benchmarks.motion.walking_takes`. Needs the `train` extra.
"""

from __future__ import annotations

import io
from pathlib import Path
from typing import Any

import numpy as np

from muybridge.arrays import FloatArray
from muybridge.geometry.roles import find_motion_roles
from muybridge.geometry.skeleton.motion import Motion
from muybridge.motion.editing.root_path import ground_path
from muybridge.motion.signals.reaching import reach
from muybridge.motion.style import Examples, Style, examples_of, learn_style
from scripts.benchmarks.motion.walking_takes import walking_takes

PICTURE = Path(__file__).resolve().parents[2] / "docs" / "assets" / "style.webp"
FRAMES = 8000
GOAL = np.array([-0.15, -0.42, 1.28])  # from under the hips, the body facing -y
NEAR, FAR, PLAIN, RED = "#00695c", "#80cbc4", "#9e9e9e", "#ff5722"


def style_of(kind: str, takes: list[tuple[str, Motion]], roles: dict[str, int]) -> Style:
    """The style of all takes of a kind."""
    examples: Examples | None = None
    for name, motion in takes:
        if name.startswith(kind):
            found = examples_of(name, motion, roles=roles)
            examples = found if examples is None else examples.merged(found)
    assert examples is not None
    return learn_style(examples, roles)


def draw(axes: Any, places: FloatArray, motion: Motion, goal: FloatArray, across: int) -> None:
    """A stick figure; the limbs of the left side are lighter."""
    for j, parent in enumerate(motion.skeleton.parents):
        if parent >= 0:
            left = motion.skeleton.names[j].endswith(".L")
            line = places[[parent, j]]
            axes.plot(line[:, across], line[:, 2], color=FAR if left else NEAR, lw=3.5, solid_capstyle="round",
                      zorder=1 if left else 2)  # fmt: skip
    axes.plot(goal[across], goal[2], "o", color=RED, ms=9, zorder=3)
    axes.axhline(0, color=PLAIN, lw=1)
    axes.set_aspect("equal")
    axes.set_xlim(-0.75, 0.75)
    axes.set_ylim(-0.05, 1.45)
    axes.axis("off")


def main() -> None:
    """Draw the picture."""
    import matplotlib

    matplotlib.use("Agg")
    import matplotlib.pyplot as plt
    from PIL import Image

    takes = list(walking_takes(FRAMES))  # the first walk is not learned from
    roles = dict(find_motion_roles(takes[0][1]).roles)
    held_out = next(k for k, (n, _) in enumerate(takes) if n.startswith("walk"))
    take = takes.pop(held_out)[1]
    heading = ground_path(take, 0.0, turning=True, roles=roles)
    middle = 90
    yaw = float(heading.yaw[middle])
    c, s = np.cos(yaw), np.sin(yaw)
    spin = np.array([[c, -s, 0], [s, c, 0], [0, 0, 1.0]])
    under = np.array([*heading.places[middle], 0.0])
    goal = spin @ GOAL + under
    made = {"without a style": reach(take, "right_hand", middle / take.fps, goal, roles=roles)}
    for kind, label in (("walk", "style of walks"), ("run", "style of runs")):
        made[label] = reach(take, "right_hand", middle / take.fps, goal, style=style_of(kind, takes, roles))
    made = {"the take": take, **made}
    figure, panels = plt.subplots(2, len(made), figsize=(10, 5.4), layout="constrained")
    for column, (label, motion) in enumerate(made.items()):
        places = (motion.joint_positions_world()[middle] - under) @ spin
        for row, across in enumerate((0, 1)):
            draw(panels[row, column], places, motion, GOAL, across)
        panels[0, column].set_title(label, fontsize=12)
    drawn = io.BytesIO()
    figure.savefig(drawn, dpi=90)
    Image.open(drawn).convert("RGB").save(PICTURE, "WEBP", quality=80, method=6)
    print(PICTURE, PICTURE.stat().st_size)


if __name__ == "__main__":
    main()
