"""A page of 60 difficult synthetic cases with the landmarks of the shipped network, or optionally of a real take.

Usage: python -m scripts.assets.test_sheet docs/assets/test-sheet.webp
       python -m scripts.assets.test_sheet sheet.png --take RESULTS

The synthetic cases are held-out people under the hardest settings of the augmentation: any roll up to 60 degrees,
occluders, second persons, the border of the video. Left limbs are orange, right ones blue, the truth is thin and white;
landmarks that the network cannot locate, which count as missing in use, are not drawn. The second form shows the
overlays of a finished `muybridge run`: every camera at ten instants.
"""

import argparse
import pathlib
from dataclasses import replace

import cv2
import numpy as np
from numpy.typing import NDArray

from muybridge.arrays import ByteArray
from muybridge.geometry.landmarks.sets import BODY23
from muybridge.models.keypoints.decode import NO_IDEA
from muybridge.models.shipped import shipped_model
from muybridge.train.images.backgrounds import make_backgrounds
from muybridge.train.images.compositor import Batch, Compositor
from muybridge.train.images.dataset import HELD_OUT
from muybridge.train.images.options import WHOLE
from muybridge.train.keypoints.evaluate import load_model, read_crops
from muybridge.train.synthesis.rendering.framing import SIZE
from muybridge.train.synthesis.rendering.store import load_renders

CASES, COLUMNS, TILE = 60, 10, 192
LEFT, RIGHT, MIDDLE = (255, 140, 0), (0, 150, 255), (120, 255, 120)
HARD = replace(
    WHOLE, rotation_sd_deg=10, tumble=0.2, second_person=0.4, occluder=0.5, mosaic=0.1, truncate=0.2, close_up=0.1
)
SEED = 60


def hard_cases(renders: pathlib.Path, size: int) -> Batch:
    """The same cases for every network: they depend only on the held-out shards."""
    store = load_renders(renders, HELD_OUT)
    pool = make_backgrounds(200, SIZE, SEED)
    return Compositor(store, pool, size, SEED, HARD).batch(CASES)


def draw(picture: ByteArray, points: NDArray[np.floating], scale: float, truth: bool = False) -> None:
    """Draw bones into an RGB picture, in place; landmarks that are NaN are skipped."""
    for a, b in BODY23.edge_indices:
        if not np.isfinite(points[[a, b]]).all():
            continue
        name = BODY23.names[b] if BODY23.names[a].split("_")[0] == BODY23.names[b].split("_")[0] else "middle"
        colour = LEFT if name.startswith("left") else RIGHT if name.startswith("right") else MIDDLE
        ends = [tuple(np.round((points[i] + 0.5) * scale - 0.5).astype(int).tolist()) for i in (a, b)]
        cv2.line(picture, *ends, (255, 255, 255) if truth else colour, 1 if truth else 2, cv2.LINE_AA)


def synthetic_sheet(renders: pathlib.Path, model: pathlib.Path) -> ByteArray:
    """RGB page of the hard cases; prints their scores."""
    session, card = load_model(model)
    batch = hard_cases(renders, card.input_size)
    image = batch.pixels.numpy().astype(np.float32) / 255
    decoded = read_crops(session, card, image, flip=True, turn=True)
    found = decoded.points_crop_px
    truth, visible = batch.landmarks_px.numpy(), batch.visible.numpy()
    error = np.linalg.norm(found - truth, axis=-1)
    print(f"median error {np.median(error[visible]):.2f} px of {card.input_size}, "
          f"PCK@0.05 {(error[visible] < 0.05 * card.input_size).mean():.3f}")  # fmt: skip
    shown = np.where(decoded.score[..., None] < NO_IDEA, np.nan, found)
    tiles = []
    for image, at, true in zip(batch.image.numpy(), shown, truth, strict=True):
        scale = TILE / card.input_size
        tile = cv2.resize(image.transpose(1, 2, 0), (TILE, TILE), interpolation=cv2.INTER_AREA)
        draw(tile, at, scale)
        draw(tile, true, scale, truth=True)
        tiles.append(tile)
    rows = [np.concatenate(tiles[k : k + COLUMNS], 1) for k in range(0, CASES, COLUMNS)]
    return np.concatenate(rows)


def take_sheet(results: pathlib.Path, instants: int = 10, height: int = 320) -> ByteArray:
    """RGB page: one row per camera, one column per instant, from the overlay videos of `muybridge run`."""
    import av

    rows = []
    for path in sorted(results.glob("overlay_*.mp4")):
        with av.open(str(path)) as container:
            frames = [f.to_ndarray(format="rgb24") for f in container.decode(video=0)]
        chosen = [frames[k] for k in np.linspace(0, len(frames) - 1, instants).round().astype(int)]
        width = round(height * chosen[0].shape[1] / chosen[0].shape[0])
        rows.append(np.concatenate([cv2.resize(f, (width, height), interpolation=cv2.INTER_AREA) for f in chosen], 1))
    widest = max(r.shape[1] for r in rows)
    return np.concatenate([np.pad(r, ((0, 0), (0, widest - r.shape[1]), (0, 0))) for r in rows])


def main() -> None:
    """Write the page."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("out", type=pathlib.Path)
    parser.add_argument("--renders", type=pathlib.Path, default=pathlib.Path("runs/renders"))
    parser.add_argument("--model", type=pathlib.Path, default=shipped_model("keypoints"))
    parser.add_argument("--take", type=pathlib.Path, help="results folder of `muybridge run`, instead of the cases")
    options = parser.parse_args()
    page = take_sheet(options.take) if options.take else synthetic_sheet(options.renders, options.model)
    cv2.imwrite(str(options.out), cv2.cvtColor(page, cv2.COLOR_RGB2BGR), [cv2.IMWRITE_WEBP_QUALITY, 75])
    print(f"wrote {options.out}")


if __name__ == "__main__":
    main()
