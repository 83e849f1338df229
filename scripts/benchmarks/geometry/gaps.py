"""How well gaps are filled: real drop-outs copied on to a recording without any.

    python -m scripts.benchmarks.geometry.gaps WHOLE.c3d GAPS.c3d [--longest 25] [--shifts 8]

GAPS is a recording of the same markers with drop-outs. Their pattern is shifted in time (and wrapped) several times, so
that each gap falls on several motions; what is filled is compared with what WHOLE has there. One row a length of gap.
"""

import argparse
from collections import Counter
from pathlib import Path

import numpy as np

from muybridge.geometry.markers.cleaning import CleanOptions, Sample, clean_markers
from muybridge.geometry.smoothing.gap_models import gaps_of
from muybridge.motion.formats.points.unlabelled import read_marker_cloud


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("whole", type=Path)
    parser.add_argument("gaps", type=Path)
    parser.add_argument("--longest", type=int, default=25)
    parser.add_argument("--shifts", type=int, default=8)
    a = parser.parse_args()
    whole, holed = read_marker_cloud(a.whole), read_marker_cloud(a.gaps)
    names = [n.split(":")[-1] for n in whole.names]
    found = {n.split(":")[-1]: np.isfinite(holed.points[:, i, 0]) for i, n in enumerate(holed.names)}
    usual = [i for i, n in enumerate(names) if n in found and not n.startswith("*")]
    truth = whole.points[:, usual]
    seen = np.stack([found[names[i]] for i in usual], 1)[: len(truth)]
    truth = truth[: len(seen)]
    rows: dict[int, list[float]] = {}
    open_, ways = Counter[int](), Counter[str]()
    for k in range(a.shifts):
        known = np.roll(seen, k * len(seen) // a.shifts, 0)
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
                    ways[Sample(done.sample[first, m]).name.lower()] += 1
                else:
                    open_[row] += 1
    print("| gap, frames | samples | median, mm | 90 %, mm | gaps left open |\n| --- | --- | --- | --- | --- |")
    for row in sorted({*rows, *open_}):
        off_mm = rows.get(row, [np.nan])
        title = f"up to {row}" if row < 10**6 else "longer"
        print(f"| {title} | {len(off_mm)} | {np.median(off_mm):.1f} | {np.quantile(off_mm, 0.9):.1f} | {open_[row]} |")
    short = [v for row, values in rows.items() if row <= a.longest for v in values]
    print(f"all up to {a.longest} frames: median {np.median(short):.2f} mm; gaps filled by {dict(ways)}")


if __name__ == "__main__":
    main()
