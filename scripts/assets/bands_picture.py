"""Draw docs/assets/motion-bands.webp: the swing of an arm, its frequency bands, and the swing with gains.

    python -m scripts.assets.bands_picture

The walk is the one of the tests, with a tremor added.
"""

from __future__ import annotations

import io
from dataclasses import replace
from pathlib import Path

import numpy as np

from muybridge.geometry.numerics.rotations import multiply_quat, quat_from_rotvec
from muybridge.motion.signals import split_bands
from tests.motion.editing.clips import FPS, walk

PICTURE = Path(__file__).resolve().parents[2] / "docs" / "assets" / "motion-bands.webp"
GAINS = (0.0, 0.0, 1.0, 1.0, 1.6, 1.6)
AHEAD = 0  # the axis that the arm swings about


def main() -> None:
    """Draw the picture."""
    import matplotlib

    matplotlib.use("Agg")
    import matplotlib.pyplot as plt
    from PIL import Image

    motion = walk(264)
    arm = motion.skeleton.index("left_upper_arm")
    tremor = np.zeros((264, 3))
    tremor[:, AHEAD] = np.radians(2) * np.sin(2 * np.pi * 11 * np.arange(264) / FPS)
    quat = motion.quat_wxyz.copy()
    quat[:, arm] = multiply_quat(quat[:, arm], quat_from_rotvec(tremor))
    bands = split_bands(replace(motion, quat_wxyz=quat))
    changed = split_bands(bands.with_gains(GAINS))
    time = np.arange(264) / FPS
    figure, (left, right) = plt.subplots(1, 2, figsize=(9, 4.2), facecolor="white", layout="constrained")
    for k, (low, high) in enumerate(bands.ranges()):
        left.plot(time, np.degrees(bands.rotations[k, :, arm, AHEAD]) - 14 * k, lw=1, color="#2a6f97")
        left.text(time[-1] + 0.1, -14 * k, f"{low:.2g} to {high:.2g} Hz", va="center", fontsize=8)
    left.set(title="bands", xlabel="s", yticks=[], xlim=(0, time[-1] + 1.9))
    for label, one, color in (("take", bands, "#999999"), ("with gains", changed, "#c1121f")):
        right.plot(time, np.degrees(one.chart.vectors[:, arm, AHEAD]), lw=1.2, color=color, label=label)
    right.set(title=f"gains {' '.join(f'{g:g}' for g in GAINS)}", xlabel="s", ylabel="degrees", ylim=(-22, 27))
    right.legend(frameon=False, loc="upper center", ncols=2)
    data = io.BytesIO()
    figure.savefig(data, dpi=90)
    Image.open(data).convert("RGB").save(PICTURE, quality=80, method=6)
    print(f"{PICTURE.name}: {PICTURE.stat().st_size / 1024:.0f} kB")


if __name__ == "__main__":
    main()
