"""Clean labelled 3D points over time: outliers, short gaps and noise.

    python 06_smooth_points.py points.trc smooth.trc

Reads TRC, C3D, CSV, Parquet or NPZ. Noise, outliers and a gap are added first, so that there is something to do.
"""

import sys
from dataclasses import replace

import numpy as np

import muybridge

points = muybridge.read_points(sys.argv[1])
truth, random = points.points_world, np.random.default_rng(0)
spoiled = truth + random.normal(0, 0.01, truth.shape)  # 10 mm
spoiled[random.random(truth.shape[:2]) < 0.02] += 0.4  # outliers
spoiled[10:14, 0] = np.nan  # a gap

smooth = muybridge.smooth(replace(points, points_world=spoiled))
sixth = muybridge.smooth(
    replace(points, points_world=spoiled), muybridge.SmoothOptions(method="butterworth", cutoff_hz=6.0)
)

for name, found in (("spoiled", spoiled), ("Kalman smoother", smooth.points_world), ("6 Hz", sixth.points_world)):
    error_mm = 1000 * np.linalg.norm(found - truth, axis=-1)
    print(f"{name:16s} RMS error {np.sqrt(np.nanmean(error_mm**2)):6.1f} mm, missing {np.isnan(error_mm).mean():.1%}")
muybridge.write_points(sys.argv[2], smooth)
