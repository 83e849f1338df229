"""Contact sheets of training crops, for inspection."""

import pathlib

import cv2
import numpy as np
from numpy.typing import NDArray

from muybridge.arrays import BoolArray, ByteArray
from muybridge.files import replacing
from muybridge.geometry.landmarks.sets import BODY23
from muybridge.train.images.backgrounds import make_backgrounds
from muybridge.train.images.compositor import Batch, Compositor
from muybridge.train.synthesis.rendering.framing import SIZE
from muybridge.train.synthesis.rendering.store import load_renders

LEFT, RIGHT, MIDDLE = (240, 200, 60), (60, 140, 250), (220, 220, 220)  # BGR: the person's left is blue


def draw_crops(batch: Batch, tile: int = 192, columns: int = 10) -> ByteArray:
    """(H, W, 3) BGR: every other crop with its landmarks, hidden ones in red."""
    tiles = []
    scale = tile / batch.image.shape[-1]
    for i in range(len(batch.image)):
        picture = np.ascontiguousarray(batch.image[i].numpy().transpose(1, 2, 0)[..., ::-1])
        picture = cv2.resize(picture, (tile, tile)).astype(np.uint8)
        if i % 2:
            _draw_landmarks(picture, (batch.landmarks_px[i].numpy() + 0.5) * scale - 0.5, batch.visible[i].numpy())
        tiles.append(picture)
    rows = [np.concatenate(tiles[k : k + columns], 1) for k in range(0, len(tiles) - columns + 1, columns)]
    return np.concatenate(rows, 0)


def _draw_landmarks(picture: ByteArray, points: NDArray[np.floating], visible: BoolArray) -> None:
    at = [tuple(int(round(float(c))) for c in p) for p in points]
    for a, b in BODY23.edge_indices:
        names = BODY23.names[a] + BODY23.names[b]
        both = "left_" in names and "right_" in names
        colour = MIDDLE if both else LEFT if "left_" in names else RIGHT if "right_" in names else MIDDLE
        cv2.line(picture, at[a], at[b], colour, 1, cv2.LINE_AA)
    for point, seen in zip(at, visible, strict=True):
        cv2.circle(picture, point, 2, (80, 220, 80) if seen else (40, 40, 250), -1, cv2.LINE_AA)


def write_sheet(renders: pathlib.Path, count: int = 60, size: int = SIZE, seed: int = 1) -> pathlib.Path:
    """Composite `count` training crops of a store into `sheet.png` beside its shards."""
    batch = Compositor(load_renders(renders), make_backgrounds(64, SIZE, seed), size, seed).batch(count)
    path = renders / "sheet.png"
    _, code = cv2.imencode(".png", draw_crops(batch))
    with replacing(path) as temporary:
        temporary.write_bytes(code.tobytes())
    return path
