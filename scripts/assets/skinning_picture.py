"""Draw docs/assets/skinning.webp: a forearm twisted, an elbow and a knee bent, by every skinning method.

    python -m scripts.assets.skinning_picture

Needs the extra `train`.
"""

from __future__ import annotations

import io
from dataclasses import replace
from pathlib import Path

import numpy as np

from muybridge.arrays import FloatArray, IntArray
from muybridge.motion.character.skinning import METHODS, Skinner
from scripts.benchmarks.motion.joint_bends import Bend, Body, bends_of, bent_frames, generated_body

PICTURE = Path(__file__).resolve().parents[2] / "docs" / "assets" / "skinning.webp"
ROWS = (("forearm twist", 160.0), ("elbow", 140.0), ("knee", 130.0))
SKIN, LIGHT = np.array([0.86, 0.66, 0.52]), np.array([0.35, 0.5, 0.8])


def main() -> None:
    """Draw the picture."""
    import matplotlib

    matplotlib.use("Agg")
    import matplotlib.pyplot as plt
    from PIL import Image

    body = generated_body()
    bends = bends_of(body)
    figure, axes = plt.subplots(len(ROWS), len(METHODS), figsize=(13, 5.2), facecolor="white")
    for row, (name, angle) in enumerate(ROWS):
        bend = bends[name]
        frame = bent_frames(body, replace(bend, angles_deg=(angle,)))
        rows, view = limb(body, bend), towards(body, bend, frame[0])
        for column, method in enumerate(METHODS):
            axis = axes[row, column]
            draw(axis, Skinner([body.skin], method).pose(frame)[0][0].astype(float) @ view.T, rows)
        label = f"{name}, {angle:.0f}°"
        axes[row, 0].text(-0.04, 0.5, label, transform=axes[row, 0].transAxes, rotation=90, ha="right", va="center")
    for column, method in enumerate(METHODS):
        figure.text(0.03 + 0.965 / len(METHODS) * (column + 0.5), 0.95, method, fontsize=11, ha="center")
    figure.subplots_adjust(0.03, 0.01, 0.995, 0.95, 0.02, 0.0)
    data = io.BytesIO()
    figure.savefig(data, dpi=100)
    Image.open(data).convert("RGB").save(PICTURE, quality=80, method=6)
    print(f"{PICTURE.name}: {PICTURE.stat().st_size / 1024:.0f} kB")


def limb(body: Body, bend: Bend) -> IntArray:
    """(F, 3) triangles of the limb around a joint."""
    names, skin = body.skeleton.names, body.skin
    side = bend.joint[-2:]
    kinds = ("upperarm02", "lowerarm", "wrist") if "arm" in bend.joint else ("upperleg02", "lowerleg", "foot")
    wanted = np.array([n.startswith(kinds) and n.endswith(side) for n in names])
    share = (skin.weights * wanted[skin.joints]).sum(axis=1)
    return skin.triangles[(share > 0.5)[skin.triangles].all(axis=1)]


def towards(body: Body, bend: Bend, frame: FloatArray) -> FloatArray:
    """(3, 3) right, up and towards the eye: the limb's plane, its first bone to the right."""
    index = body.skeleton.index
    if len(bend.bones) == 1:
        along = frame[index(bend.bones[0][1]), :3, 3] - frame[index(bend.bones[0][0]), :3, 3]
        out = np.cross(along, [0.0, 0, 1])
    else:
        along = frame[index(bend.bones[0][1]), :3, 3] - frame[index(bend.bones[0][0]), :3, 3]
        out = bend.axis
    along, out = along / np.linalg.norm(along), out / np.linalg.norm(out)
    out = out - along * (out @ along)
    out /= np.linalg.norm(out)
    return np.stack([along, np.cross(out, along), out])


def draw(axis: object, points: FloatArray, triangles: IntArray) -> None:
    """Triangles from the back to the front, shaded by their normals."""
    from matplotlib.collections import PolyCollection

    corners = points[triangles]
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normal /= np.maximum(np.linalg.norm(normal, axis=1, keepdims=True), 1e-12)
    order = np.argsort(corners[:, :, 2].mean(axis=1))
    shade = 0.45 + 0.6 * np.clip(normal @ (LIGHT / np.linalg.norm(LIGHT)), 0, 1)
    colours = np.clip(SKIN * shade[:, None], 0, 1)
    axis.add_collection(  # type: ignore[attr-defined]
        PolyCollection(corners[order][:, :, :2], facecolors=colours[order], edgecolors=colours[order], linewidths=0.3)
    )
    axis.autoscale_view()  # type: ignore[attr-defined]
    axis.set_aspect("equal")  # type: ignore[attr-defined]
    axis.axis("off")  # type: ignore[attr-defined]


if __name__ == "__main__":
    main()
