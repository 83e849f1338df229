"""Triangulate 2D points of your own detector, robustly and with covariances.

    python 05_triangulate_arrays.py calibration.toml

Made-up detections: two points that move for a second, 2 px of noise, and one camera that is wrong a tenth of the time.
"""

import sys

import numpy as np

import muybridge

cameras = muybridge.load_calibration(sys.argv[1])  # any known format
random = np.random.default_rng(0)

t = np.linspace(0, 1, 30)
wrist = np.stack([0.3 * np.cos(2 * np.pi * t), 0.3 * np.sin(2 * np.pi * t), 1.0 + 0.2 * t], axis=1)
hip = np.stack([0 * t, 0 * t, 0.9 + 0.02 * np.sin(6 * t)], axis=1)
truth = np.stack([wrist, hip], axis=1)  # (frames, points, 3) metres

detected = cameras.project(truth) + random.normal(0, 2, (len(cameras), *truth.shape[:2], 2))
wrong = random.random(len(t)) < 0.1
detected[0, wrong] += 150  # another person's wrist, say
detected[1, 5:10] = np.nan  # not detected

points = muybridge.triangulate(cameras, detected, ["wrist", "hip"], fps=30, sd_px=2.0)

error_mm = 1000 * np.linalg.norm(points.points_world - truth, axis=-1)
print(f"median error {np.median(error_mm):.1f} mm, largest {error_mm.max():.1f} mm")
print(f"{cameras.names[0]} was ignored in {(~points.inlier[0, wrong]).mean():.0%} of the wrong cases")
sd_mm = 1000 * np.sqrt(np.diagonal(points.covariance_world, axis1=-2, axis2=-1))
print("typical standard deviation along x, y, z:", np.round(np.median(sd_mm, axis=(0, 1)), 1), "mm")
