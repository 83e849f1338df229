"""A page of generated motion: every kind as stick figures over time, from the side and from the front.

Usage: python -m scripts.assets.motion_sheet motions.webp
"""

import argparse
import pathlib

import cv2
import numpy as np

from muybridge.arrays import BoolArray, ByteArray, FloatArray
from muybridge.train.synthesis.bodies.body_model import BodyModel
from muybridge.train.synthesis.motions.rig import SkinnedBody, forward, rot, turn
from muybridge.train.synthesis.motions.sampler import MOTIONS, MotionClip, MotionSampler

FRAMES, TILE, SCALE = 12, 104, 46
MIDDLE = ("root", "spine03", "spine01", "neck01", "head")
ARM = ("spine01", "upperarm01.", "lowerarm01.", "wrist.", "finger3-1.")
LEG = ("root", "upperleg01.", "lowerleg01.", "foot.", "toe2-1.", "toe2-3.")
COLOURS = {"M": (90, 90, 90), "L": (230, 110, 0), "R": (0, 110, 230)}


def draw(tile: ByteArray, skeleton: SkinnedBody, at: FloatArray, view: FloatArray,
         touching: BoolArray) -> None:  # fmt: skip
    """Draw one figure into a tile; `view` (3,) is the horizontal axis of the picture. The floor is grey, contacts are
    green."""
    ground = TILE - 12
    cv2.line(tile, (0, ground), (TILE, ground), (200, 200, 200), 1)
    centre = at[skeleton.index("root")] @ view

    def pixel(bone: str) -> tuple[int, int]:
        p = at[skeleton.index(bone)]
        return round(TILE / 2 + (p @ view - centre) * SCALE), round(ground - p[2] * SCALE)

    for side in "RL":
        for chain in (ARM, LEG):
            names = [b + side if b.endswith(".") else b for b in chain]
            for a, b in zip(names[:-1], names[1:], strict=True):
                cv2.line(tile, pixel(a), pixel(b), COLOURS[side], 2, cv2.LINE_AA)
        if touching["LR".index(side)]:
            cv2.circle(tile, pixel("toe2-1." + side), 3, (0, 170, 0), -1)
    for a, b in zip(MIDDLE[:-1], MIDDLE[1:], strict=True):
        cv2.line(tile, pixel(a), pixel(b), COLOURS["M"], 2, cv2.LINE_AA)
    head, neck = np.array(pixel("head")), np.array(pixel("neck01"))
    cv2.circle(tile, tuple((head + 0.5 * (head - neck)).astype(int).tolist()), 5, COLOURS["M"], -1, cv2.LINE_AA)


def strip(skeleton: SkinnedBody, clip: MotionClip) -> ByteArray:
    """Two rows of figures: from the side (facing left) and from the front."""
    _, at = forward(skeleton, turn(clip.rotvec), clip.root)
    hips = at[:, skeleton.index("upperleg01.L")] - at[:, skeleton.index("upperleg01.R")]
    left = np.append(hips[:, :2].mean(0), 0)
    left /= np.linalg.norm(left)
    fore = rot(2, -90.0) @ left
    page = np.full((2 * TILE, FRAMES * TILE, 3), 255, np.uint8)
    for i, f in enumerate(np.linspace(0, len(at) - 1, FRAMES).astype(int)):
        for row, view in enumerate((-fore, left)):
            tile = np.full((TILE, TILE, 3), 255, np.uint8)
            draw(tile, skeleton, at[f], view, clip.contacts[f])
            page[row * TILE : (row + 1) * TILE, i * TILE : (i + 1) * TILE] = tile
    cv2.putText(page, clip.kind, (4, 14), cv2.FONT_HERSHEY_SIMPLEX, 0.45, (0, 0, 0), 1, cv2.LINE_AA)
    return page


def sheet(skeleton: SkinnedBody, seed: int, seconds: dict[str, float], kinds: list[str]) -> ByteArray:
    """All kinds in two columns."""
    sampler = MotionSampler(skeleton, np.random.default_rng(seed))
    strips = [strip(skeleton, sampler.sample(seconds.get(k, 5.0), 60.0, k)) for k in kinds]
    if len(strips) % 2:
        strips.append(np.full_like(strips[0], 255))
    half = len(strips) // 2
    return np.hstack([np.vstack(strips[:half]), np.vstack(strips[half:])])


def main() -> None:
    """Write the page."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("out", type=pathlib.Path)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--kinds", nargs="*", default=list(MOTIONS))
    options = parser.parse_args()
    body = BodyModel(0)
    phenotypes = np.full(len(body.model.phenotype_labels), 0.5, np.float32)
    phenotypes[list(body.model.phenotype_labels).index("age")] = 0.75
    seconds = {"walk": 1.6, "run": 1.0, "jump": 2.5, "kick": 2.5, "throw": 2.5, "get_up": 6.5, "crawl": 2.5}
    page = sheet(body.skeleton(phenotypes), options.seed, seconds, options.kinds)
    quality = [cv2.IMWRITE_WEBP_QUALITY, 60] if options.out.suffix == ".webp" else []
    if not cv2.imwrite(str(options.out), page[..., ::-1], quality):
        raise SystemExit(f"could not write {options.out}")


if __name__ == "__main__":
    main()
