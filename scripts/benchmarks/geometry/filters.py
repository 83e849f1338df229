"""Filters and gap filling compared with the truth.

Usage: python -m scripts.benchmarks.geometry.filters synthetic
       python -m scripts.benchmarks.geometry.filters gaps WHOLE.c3d GAPS.c3d [--longest 25] [--shifts 8]

synthetic, filters: joints of the CMU take 01_01 (climbing and jumping) at 120 and 60 frames/s with noise of 10 mm per
axis, white and correlated over time. Filters with parameters get those that are best on the first half of the take
(`tuned`) or choose them themselves (`auto`). Printed is the RMSE on the second half, of positions in mm and of
accelerations in m/s^2. Gaps: 300 gaps of each length cut into a real serve with 39 markers; mean error in mm.

gaps: real drop-outs copied to a recording without any. GAPS is a recording of the same markers with drop-outs. Their
pattern is shifted in time (cyclically) several times, so that each gap falls on several motions; filled points are
compared with those of WHOLE. One row per length of gap.
"""

import argparse
from collections import Counter
from pathlib import Path

import numpy as np

from muybridge.geometry.markers.cleaning import CleanOptions, Sample, clean_markers
from muybridge.geometry.smoothing.filters import FilterOptions, hampel, residual_cutoff, smooth
from muybridge.geometry.smoothing.gap_models import gaps_of
from muybridge.geometry.smoothing.gaps import GAP_METHODS, fill_gaps
from muybridge.geometry.smoothing.kalman import SmoothOptions, smooth_points
from muybridge.motion.formats.points.c3d import read_c3d
from muybridge.motion.formats.points.unlabelled import read_marker_cloud
from muybridge.motion.formats.skeletal.bvh import read_bvh
from scripts.benchmarks.common import CMU_METRES_PER_UNIT, DATA, as_points, cmu_landmarks, correlated_noise

GRIDS: dict[str, list[FilterOptions]] = {
    "butterworth": [FilterOptions(cutoff_hz=c) for c in (2, 3, 4, 5, 6, 8, 10, 12)],
    "kalman": [FilterOptions(acceleration=a) for a in (2, 5, 12, 25, 50)],
    "savgol": [FilterOptions(window=w, degree=d) for w in (0.1, 0.2, 0.3, 0.4) for d in (2, 3)],
    "gcv_spline": [FilterOptions(smoothing=s) for s in (1e-7, 1e-6, 1e-5, 1e-4)],
    "one_euro": [FilterOptions(min_cutoff_hz=c, beta=b) for c in (0.5, 1.5, 3, 6) for b in (0.5, 2, 5, 10)],
    "gaussian": [FilterOptions(sigma=s) for s in (0.01, 0.02, 0.03, 0.045, 0.06)],
    "median": [FilterOptions(window=w) for w in (0.05, 0.1, 0.2)],
    "loess": [FilterOptions(window=w, degree=d) for w in (0.15, 0.25, 0.35, 0.5) for d in (2, 3)],
}


def figures(found: np.ndarray, truth: np.ndarray, fps: float) -> tuple[float, float]:
    """RMSE of position (mm) and acceleration (m/s^2) over the second half, without the ends."""
    half = slice(len(truth) // 2, len(truth) - 10)
    off = found - truth
    second = np.diff(off, 2, axis=0) * fps**2
    return (
        1e3 * float(np.sqrt(np.mean(np.sum(off[half] ** 2, axis=-1)))),
        float(np.sqrt(np.mean(np.sum(second[half] ** 2, axis=-1)))),
    )


def filters(name: str, truth: np.ndarray, fps: float, correlation: float) -> None:
    """Print the table of one take and one kind of noise."""
    noisy = truth + 0.01 * correlated_noise(truth.shape, correlation, np.random.default_rng(0))
    half = slice(10, len(truth) // 2)
    rows = {"as measured": figures(noisy, truth, fps)}
    for method, grid in GRIDS.items():
        errors = [np.mean((smooth(noisy, fps, method, o)[half] - truth[half]) ** 2) for o in grid]
        rows[f"{method}, tuned"] = figures(smooth(noisy, fps, method, grid[int(np.argmin(errors))]), truth, fps)
    cutoff = residual_cutoff(noisy, fps)
    rows[f"butterworth, auto {cutoff:.1f} Hz"] = figures(smooth(noisy, fps, "butterworth"), truth, fps)
    rows["gcv_spline, auto"] = figures(smooth(noisy, fps, "gcv_spline"), truth, fps)
    rows["kalman, auto"] = figures(smooth(noisy, fps, "kalman"), truth, fps)
    plain = SmoothOptions(unflip=False)
    rows["smooth_points, auto"] = figures(smooth_points(as_points(noisy, fps, 0.01), plain).points_world, truth, fps)
    print(f"\n{name}, {'white noise' if correlation == 0 else f'noise correlated by {correlation:g} per frame'}")
    for what, (position, acceleration) in rows.items():
        print(f"| {what} | {position:.1f} | {acceleration:.1f} |", flush=True)


def corrupted(truth: np.ndarray, fps: float) -> None:
    """Print the errors for points as cameras give them: correlated noise, 5 % outliers of 0.3 m, 5 % missing; all
    methods choose their own parameters."""
    rng = np.random.default_rng(2)
    noisy = truth + 0.01 * correlated_noise(truth.shape, 0.8, rng)
    far = rng.random(noisy.shape[:2]) < 0.05
    noisy[far] += rng.normal(0, 0.3 / np.sqrt(3), (int(far.sum()), 3))
    noisy[rng.random(noisy.shape[:2]) < 0.05] = np.nan
    noisy[0], noisy[-1] = truth[0], truth[-1]
    ready = fill_gaps(hampel(noisy, 3)[0], fps)
    rows = {f"hampel, fill_gaps, {m}": smooth(ready, fps, m) for m in ("butterworth", "kalman", "gcv_spline")}
    rows["hampel, fill_gaps, butterworth 6 Hz"] = smooth(ready, fps, "butterworth", FilterOptions(cutoff_hz=6.0))
    rows["smooth_points"] = smooth_points(as_points(noisy, fps, 0.01), SmoothOptions(unflip=False)).points_world
    print("\n60 frames/s, correlated noise, outliers, missing points")
    for what, found in rows.items():
        position, acceleration = figures(found, truth, fps)
        print(f"| {what} | {position:.1f} | {acceleration:.1f} |", flush=True)


def gaps() -> None:
    """Print the table of the gap filling methods."""
    points = read_c3d(DATA / "markers" / "tennis_serve_pig39.c3d")
    truth, fps = points.points_world, points.fps
    whole = np.flatnonzero(np.isfinite(truth).all(axis=(0, 2)))
    truth = truth[:, whole]
    print(f"\ngaps: {truth.shape[1]} markers, {len(truth)} frames at {fps:g}/s; mean error in mm")
    print("| method | 0.1 s | 0.3 s | 0.6 s | 1 s |\n| --- | --- | --- | --- | --- |")
    for method in ("auto", *GAP_METHODS):
        row = []
        for seconds in (0.1, 0.3, 0.6, 1.0):
            rng = np.random.default_rng(1)
            length = round(seconds * fps)
            errors = []
            for _ in range(30):
                holed = truth.copy()
                cut = []
                for j in rng.choice(truth.shape[1], 10, replace=False):
                    start = int(rng.integers(5, len(truth) - length - 5))
                    holed[start : start + length, j] = np.nan
                    cut.append((j, slice(start, start + length)))
                filled = fill_gaps(holed, fps, method)
                errors += [np.linalg.norm(filled[s, j] - truth[s, j], axis=-1).mean() for j, s in cut]
            row.append(f"{1e3 * np.mean(errors):.1f}")
        print(f"| {method} | {' | '.join(row)} |", flush=True)


def recorded_gaps(a: argparse.Namespace) -> None:
    """Print the errors of filled gaps, one row per length of gap."""
    whole, gappy = read_marker_cloud(a.whole), read_marker_cloud(a.gaps)
    names = [n.split(":")[-1] for n in whole.names]
    found = {n.split(":")[-1]: np.isfinite(gappy.points[:, i, 0]) for i, n in enumerate(gappy.names)}
    shared = [i for i, n in enumerate(names) if n in found and not n.startswith("*")]
    truth = whole.points[:, shared]
    present = np.stack([found[names[i]] for i in shared], 1)[: len(truth)]
    truth = truth[: len(present)]
    rows: dict[int, list[float]] = {}
    left_open, methods = Counter[int](), Counter[str]()
    for k in range(a.shifts):
        known = np.roll(present, k * len(present) // a.shifts, 0)
        done = clean_markers(np.where(known[..., None], truth, np.nan), whole.fps, CleanOptions())
        off = np.linalg.norm(done.points - truth, axis=-1) * 1000
        for m in range(truth.shape[1]):
            for first, last in gaps_of(known[:, m]):
                if not np.isfinite(truth[first:last, m, 0]).all():
                    continue
                length = last - first
                row = next((edge for edge in (1, 5, 10, a.longest) if length <= edge), 10**6)
                if np.isfinite(off[first:last, m]).all():
                    rows.setdefault(row, []).extend(off[first:last, m].tolist())
                    methods[Sample(done.sample[first, m]).name.lower()] += 1
                else:
                    left_open[row] += 1
    print("| gap, frames | samples | median, mm | 90 %, mm | gaps left open |\n| --- | --- | --- | --- | --- |")
    for row in sorted({*rows, *left_open}):
        off_mm = rows.get(row, [np.nan])
        title = f"up to {row}" if row < 10**6 else "longer"
        print(
            f"| {title} | {len(off_mm)} | {np.median(off_mm):.1f} | {np.quantile(off_mm, 0.9):.1f} | {left_open[row]} |"
        )
    short = [v for row, values in rows.items() if row <= a.longest for v in values]
    print(f"all up to {a.longest} frames: median {np.median(short):.2f} mm; gaps filled by {dict(methods)}")


def measure_all(_: argparse.Namespace) -> None:
    """Print all tables."""
    motion = read_bvh(DATA / "motion" / "01_01.bvh", metres_per_unit=CMU_METRES_PER_UNIT)
    keep = [j for j in range(len(motion.skeleton)) if j == 0 or motion.skeleton.bone_lengths[j] > 1e-6]
    fast = motion.joint_positions_world()[1:, keep]
    slow, fps = cmu_landmarks()
    filters("120 frames/s", fast, motion.fps, 0.0)
    filters("60 frames/s", slow[1:], fps, 0.0)
    filters("60 frames/s", slow[1:], fps, 0.8)
    corrupted(slow[1:], fps)
    gaps()


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    commands = parser.add_subparsers(required=True)
    commands.add_parser("synthetic").set_defaults(run=measure_all)
    recorded = commands.add_parser("gaps")
    recorded.add_argument("whole", type=Path)
    recorded.add_argument("gaps", type=Path)
    recorded.add_argument("--longest", type=int, default=25)
    recorded.add_argument("--shifts", type=int, default=8)
    recorded.set_defaults(run=recorded_gaps)
    arguments = parser.parse_args()
    arguments.run(arguments)


if __name__ == "__main__":
    main()
