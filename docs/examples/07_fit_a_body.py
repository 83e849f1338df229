"""Fit a skeleton with constant bone lengths to labelled points of any program.

    python 07_fit_a_body.py points.trc motion.bvh

Landmarks are matched by name: COCO, HALPE, OpenPose and MediaPipe's are known. Missing points are bridged.
"""

import sys

import numpy as np

import muybridge

points = muybridge.read_points(sys.argv[1])
fit = muybridge.fit_body(points)  # measured points, not smoothed ones: the fit weights and smooths by itself

print(f"stature {fit.body.stature_m:.2f} m")
print(f"landmarks lie {1000 * np.nanmedian(fit.residual_m):.0f} mm (median) from the body's")

skeleton = fit.motion.skeleton
places = fit.motion.joint_positions_world()
for name in ("left_forearm", "left_hand", "left_shin", "left_foot"):
    parent = skeleton.parents[skeleton.index(name)]
    length = np.linalg.norm(places[:, skeleton.index(name)] - places[:, parent], axis=-1)
    print(f"{skeleton.names[parent]:16s} {1000 * length.mean():4.0f} mm, varies by {1000 * np.ptp(length):.3f} mm")

muybridge.write_motion(sys.argv[2], fit.motion)
