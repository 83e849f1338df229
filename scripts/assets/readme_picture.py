"""Make the README's animation from the results of `muybridge demo`.

Usage: python -m scripts.assets.readme_picture [RESULTS] [OUT]      (default: muybridge-demo docs/assets/demo.webp)

Left: the camera views with projected landmarks (from the overlays). Right: the fitted motion (motion.bvh) in 3D.
"""

import sys
from pathlib import Path

import av
import cv2
import numpy as np
from numpy.typing import NDArray
from PIL import Image

from muybridge.arrays import ByteArray, FloatArray
from muybridge.infer.results.overlay_drawing import colour_of
from muybridge.motion.formats.skeletal.bvh import read_bvh

HEIGHT, FPS, SECONDS = 400, 12.5, 4.0
PAPER, GRID, INK = (247, 246, 243), (205, 202, 195), (51, 55, 61)
# Drawn at twice the size and averaged down.
FINE = 2


def read_video(path: Path, wanted_fps: float) -> list[ByteArray]:
    """Every n-th frame of a video, at about `wanted_fps`."""
    with av.open(str(path)) as container:
        stream = container.streams.video[0]
        every = max(1, round(float(stream.average_rate) / wanted_fps))
        return [f.to_ndarray(format="rgb24") for i, f in enumerate(container.decode(stream)) if i % every == 0]


def camera_sheet(views: list[ByteArray], height: int) -> ByteArray:
    """Up to four images in two rows, `height` px in total."""
    rows = [views[:2], views[2:4]] if len(views) > 2 else [views]
    each = height // len(rows)
    strips = []
    for row in rows:
        small = [
            cv2.resize(v, (round(v.shape[1] * each / v.shape[0]), each), interpolation=cv2.INTER_AREA) for v in row
        ]
        strips.append(np.concatenate(small, axis=1))
    width = min(s.shape[1] for s in strips)
    return np.concatenate([s[:, :width] for s in strips], axis=0)


def stage(joints: FloatArray, yaw: float, target: FloatArray) -> tuple[NDArray, NDArray]:
    """Pixels (at `FINE` times the size) and depths of (N, 3) world points seen from `yaw`, slightly from above."""
    pitch, distance, focal = 0.2, 4.6, 1.75 * HEIGHT * FINE
    away = np.array([np.cos(pitch) * np.cos(yaw), np.cos(pitch) * np.sin(yaw), np.sin(pitch)])
    right = np.cross(-away, [0.0, 0.0, 1.0])
    right /= np.linalg.norm(right)
    rows = np.stack([right, np.cross(-away, right), -away])
    eye = (joints - target - distance * away) @ rows.T
    return focal * eye[:, :2] / eye[:, 2:] + HEIGHT * FINE / 2, eye[:, 2]


def draw_stage(
    joints: FloatArray, parents: tuple[int, ...], names: tuple[str, ...], yaw: float, target: NDArray
) -> ByteArray:
    """The skeleton on the ground, a square image of `HEIGHT` px."""
    image = np.full((HEIGHT * FINE, HEIGHT * FINE, 3), PAPER, np.uint8)
    around = np.round(target[:2])
    for i in range(-3, 4):
        for ends in (([i, -3, 0], [i, 3, 0]), ([-3, i, 0], [3, i, 0])):
            px, _ = stage(np.array(ends, float) + [*around, 0.0], yaw, target)
            cv2.line(image, *[tuple(int(v) for v in p) for p in px], GRID, FINE, cv2.LINE_AA)
    bones = [(p, j) for j, p in enumerate(parents) if p >= 0]
    shadow, _ = stage(joints * [1.0, 1.0, 0.0], yaw, target)
    for p, j in bones:
        ends = [tuple(int(v) for v in shadow[k]) for k in (p, j)]
        cv2.line(image, *ends, (222, 219, 212), 9 * FINE, cv2.LINE_AA)
    px, depth = stage(joints, yaw, target)
    for p, j in sorted(bones, key=lambda bone: -depth[list(bone)].sum()):
        ends = [tuple(int(v) for v in px[k]) for k in (p, j)]
        warm_or_cool = {(255, 159, 28): (214, 110, 0), (86, 190, 255): (0, 114, 178)}
        colour = warm_or_cool.get(colour_of(names[j]), INK)
        cv2.line(image, *ends, PAPER, 9 * FINE, cv2.LINE_AA)
        cv2.line(image, *ends, colour, 6 * FINE, cv2.LINE_AA)
    if "head" in names:
        h = names.index("head")
        up = joints[h] - joints[parents[h]]
        (centre,), (far,) = stage((joints[h] + 0.09 * up / np.linalg.norm(up))[None], yaw, target)
        radius = round(0.095 * 1.75 * HEIGHT * FINE / far)
        cv2.circle(image, tuple(int(v) for v in centre), radius, INK, -1, cv2.LINE_AA)
    return cv2.resize(image, (HEIGHT, HEIGHT), interpolation=cv2.INTER_AREA)


def main() -> None:
    """Read the results, draw every frame, write one animated WebP."""
    results = Path(sys.argv[1] if len(sys.argv) > 1 else "muybridge-demo")
    out = Path(sys.argv[2] if len(sys.argv) > 2 else "docs/assets/demo.webp")
    videos = [read_video(path, FPS) for path in sorted(results.glob("overlay_*.mp4"))[:4]]
    if not videos:
        sys.exit(f"{results} has no overlay_*.mp4: run `muybridge demo` first")
    motion = read_bvh(results / "motion.bvh")
    joints = motion.joint_positions_world()
    target = np.array([*np.median(joints[:, 0, :2], axis=0), 0.85])
    count = min(round(SECONDS * FPS), *(len(v) for v in videos))
    frames = []
    for k in range(count):
        t = min(round(k * len(joints) / len(videos[0])), len(joints) - 1)
        yaw = -0.9 + 0.5 * np.sin(2 * np.pi * k / count)
        names, parents = motion.skeleton.names, tuple(int(p) for p in motion.skeleton.parents)
        figure = draw_stage(joints[t], parents, names, yaw, target)
        sheet = camera_sheet([video[k] for video in videos], HEIGHT)
        frames.append(Image.fromarray(np.concatenate([sheet, figure], axis=1)))
    out.parent.mkdir(parents=True, exist_ok=True)
    frames[0].save(
        out, save_all=True, append_images=frames[1:], duration=round(1000 / FPS), loop=0, quality=55, method=6
    )
    width, height = frames[0].size
    print(f"{out}: {len(frames)} frames of {width} x {height}, {out.stat().st_size / 1e3:.0f} kB")


if __name__ == "__main__":
    main()
