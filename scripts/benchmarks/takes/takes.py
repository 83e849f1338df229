"""From video to motion compared with the truth: `muybridge run --everyone` on rendered takes of people and things.

Usage: python -m scripts.benchmarks.takes.takes TAKES [--out RESULTS] [--only NAME ...] [options of `muybridge run`]

TAKES is made by scripts.assets.takes. "found" is the share of a true person's frames (of those in which two cameras
have four fifths of them in the image) in which somebody was found within 0.4 m, "missed" the number of the others;
"switches" are changes of identity; "false" is the share of frames of found people in which no true person was near.
Errors are of the final landmarks, smoothed and with gaps filled: mean, also of each person, median, and the share
within 5 cm. "flips" is the share of limb landmarks nearer to the true position of their left-right counterpart, of
those whose counterpart is more than 5 cm away.
"""

import argparse
import pathlib
import time

import numpy as np

from muybridge.arrays import BoolArray, FloatArray
from muybridge.geometry.calibration import load_calibration
from muybridge.motion.formats.points.trc import read_trc
from muybridge.train.keypoints.evaluate import LIMB, MIRROR
from scripts.benchmarks.common import print_header, run_muybridge
from scripts.benchmarks.takes.people import match, matched_points

APART_M = 0.05
DIGITS = {"people": ".0f", "missed": ".0f", "switches": ".0f", "each mm": "", "mean mm": ".1f", "median mm": ".1f"}


def truth_of(take: pathlib.Path) -> tuple[FloatArray, list[str], BoolArray]:
    """Points (P, T, J, 3) metres, names, and where (P, T) two cameras have the person in the picture."""
    with np.load(take / "truth.npz") as data:
        points, names = data["points_world"].astype(float), [str(n) for n in data["names"]]
    seen = []
    for camera in load_calibration(take / "calibration.toml").cameras:
        px = camera.project(points)
        inside = ((px >= 0) & (px < [camera.width, camera.height])).all(-1)
        ahead = points @ camera.cam_from_world[2, :3] + camera.cam_from_world[2, 3] > 0.3
        seen.append((inside & ahead).mean(-1) >= 0.8)
    return points, names, np.sum(seen, 0) >= 2


def found_in(out: pathlib.Path, names: list[str], frames: int) -> list[FloatArray]:
    """(T, J, 3) metres of everybody in a results folder."""
    people = []
    for path in sorted(out.glob("points*.trc")):
        points = read_trc(path)
        index = [points.landmarks.names.index(n) for n in names]
        whole = np.full((frames, len(names), 3), np.nan)
        whole[: len(points.points_world)] = points.points_world[:frames, index]
        people.append(whole)
    return people


def flips(truth: FloatArray, people: FloatArray) -> float:
    """Share of the limbs' landmarks that are nearer to their twin's true place than to their own.

    Args:
        truth: (..., J, 3) metres, the landmarks of BODY23.
        people: the same of who was found, NaN where nobody was or shall not count.
    """
    twins = truth[..., MIRROR, :]
    own, twin = (np.linalg.norm(people - at, axis=-1) for at in (truth, twins))
    apart = np.linalg.norm(truth - twins, axis=-1) > APART_M
    return float((twin < own)[LIMB & apart & np.isfinite(own)].mean())


def score(take: pathlib.Path, out: pathlib.Path) -> dict[str, float | str]:
    """Figures of one take."""
    truth, names, visible = truth_of(take)
    people = found_in(out, names, truth.shape[1])
    switches, which = match(truth, people)
    points, matched = matched_points(people, which), which >= 0
    error = 1000 * np.linalg.norm(points - truth, axis=-1)
    counted = error[visible & matched]
    each = [float(np.nanmean(e[v & m])) if (v & m).any() else np.nan
            for e, v, m in zip(error, visible, matched, strict=True)]  # fmt: skip
    total = sum(int(np.isfinite(p).any((1, 2)).sum()) for p in people)
    return {
        "people": len(truth), "found": float((matched & visible).sum() / visible.sum()),
        "missed": int((visible & ~matched).sum()), "switches": switches,
        "false": 1 - float(matched.sum()) / max(total, 1), "mean mm": float(np.nanmean(counted)),
        "each mm": ", ".join(f"{e:.1f}" for e in each),
        "median mm": float(np.nanmedian(counted)), "within 5 cm": float((counted < 50).sum() / counted.size),
        "flips": flips(truth[visible & matched], points[visible & matched]),
    }  # fmt: skip


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("takes", type=pathlib.Path)
    parser.add_argument("--out", type=pathlib.Path, default=pathlib.Path("runs/bench-takes"))
    parser.add_argument("--only", nargs="+", default=[])
    options, rest = parser.parse_known_args()
    columns = (
        "take | people | found | missed | switches | false | mean mm | each mm | median mm | within 5 cm | flips | s"
    )
    print_header(columns.split(" | "))
    for take in sorted(p.parent for p in options.takes.glob("*/calibration.toml")):
        if options.only and take.name not in options.only:
            continue
        out, start = options.out / take.name, time.monotonic()
        if failure := run_muybridge("run", str(take), "--everyone", "--out", str(out), "--quiet", *rest):
            print(f"| {take.name} | failed: {failure} |")
            continue
        figures = score(take, out)
        cells = [f"{v:{DIGITS.get(k, '.3f')}}" for k, v in figures.items()]
        print(f"| {take.name} | {' | '.join(cells)} | {time.monotonic() - start:.0f} |", flush=True)


if __name__ == "__main__":
    main()
