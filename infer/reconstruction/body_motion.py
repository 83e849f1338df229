"""The skeleton fitted to triangulated landmarks, and gaps filled from it."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from muybridge.arrays import BoolArray
from muybridge.geometry.fitting.body_fit import FitOptions, fit_body, landmarks_from_motion
from muybridge.geometry.landmarks.arrays import Points3D
from muybridge.infer.reconstruction.motion_arrays import pack_motion
from muybridge.infer.runtime.stages import Arrays, Facts

# Landmarks measured in at least this share of the frames may be filled from the fitted body elsewhere ...
_OFTEN_MEASURED = 0.2
# ... where a camera is confident of them in at least this share.
_OFTEN_CONFIDENT = 0.5


def fitted_motion(points: Points3D, options: FitOptions) -> tuple[Arrays, Facts]:
    """The motion, with the landmarks on the fitted body and how far measured ones typically lie from them."""
    fitted = fit_body(points, options)
    arrays, facts = pack_motion(fitted.motion)
    on_body = {
        "landmarks_world": landmarks_from_motion(fitted.motion, fitted.body, points.landmarks),
        # The uncertainty of a landmark that is filled from the body.
        "landmark_sigma": np.array([np.median(r[np.isfinite(r)]) if np.isfinite(r).any() else np.nan
                                    for r in fitted.residual_m.T]),
    }  # fmt: skip
    return {**arrays, **on_body}, facts


def fill_from_body(
    points: Points3D, measured: Points3D, confident: BoolArray, body: Arrays, fill_share: float
) -> Points3D:
    """The points with missing landmarks taken from the fitted body, in frames where the body is well known.

    A landmark is filled if it is measured in some other frames, or lies on one bone with a landmark that is measured
    here. Landmarks of which no camera is confident most of the time, such as legs under a desk, stay missing.

    Args:
        points: (T, J, 3) as smoothed.
        measured: (T, J, 3) as triangulated.
        confident: (T, J) whether any camera is confident of the landmark.
        body: arrays of `fitted_motion`.
        fill_share: share of the landmarks that must be measured in a frame.
    """
    there = np.asarray(np.isfinite(measured.points_world).all(-1))
    known = there.mean(1) >= fill_share
    if not known.any():
        return points
    often = (there[known].mean(0) >= _OFTEN_MEASURED) & (confident[known].mean(0) >= _OFTEN_CONFIDENT)
    tied = there @ _on_one_bone(points.landmarks.names)
    gap = known[:, None] & np.isnan(points.points_world).any(-1) & np.isfinite(body["landmarks_world"]).all(-1)
    gap &= often | tied
    variance = np.broadcast_to(body["landmark_sigma"] ** 2, gap.shape)
    position, covariance = points.points_world.copy(), points.covariance_world.copy()
    position[gap] = body["landmarks_world"][gap]
    covariance[gap] = variance[gap][:, None, None] * np.eye(3)
    return replace(points, points_world=position, covariance_world=covariance)


def _on_one_bone(names: Sequence[str]) -> BoolArray:
    """(J, J) whether two landmarks keep their distance in every pose."""
    bones = []
    for name in names:
        side, part = name.split("_")[0], name.rsplit("_", 1)[-1]
        foot, face = part in ("ankle", "heel", "toe"), part in ("nose", "eye", "ear")
        bones.append(f"{side} foot" if foot else "face" if face else part if part in ("hip", "shoulder") else name)
    return np.array([[a == b for b in bones] for a in bones])
