"""Virtual markers of the tracked person: from their 2D positions in every camera to a laboratory's marker set."""

from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from muybridge.arrays import FloatArray
from muybridge.geometry.cameras.group import CameraGroup
from muybridge.geometry.landmarks.arrays import Points3D, select_markers
from muybridge.geometry.landmarks.marker_sets import CMU, PLUG_IN_GAIT, SURFACE, MarkerChoice, MarkerSet
from muybridge.geometry.landmarks.sets import LandmarkSet
from muybridge.geometry.triangulation.left_right import FlipOptions, repair_flips
from muybridge.geometry.triangulation.multiview import TriangulateOptions, triangulate

_SETS: dict[MarkerChoice, MarkerSet] = {"plug-in-gait": PLUG_IN_GAIT, "cmu": CMU}
# Markers that flip sides together with the body's own parts.
_ARM = ("acromion", "upper_arm", "elbow", "forearm", "radial", "ulnar", "metacarpal")
_LEG = ("trochanter", "thigh", "knee", "patella", "tibial", "shank", "malleolus", "heel", "metatarsal", "toe", "hallux")


def triangulate_markers(
    cameras: CameraGroup,
    body: tuple[FloatArray, FloatArray, LandmarkSet],
    markers: tuple[FloatArray, FloatArray],
    flips: FlipOptions,
    options: TriangulateOptions,
) -> dict[str, NDArray[Any]]:
    """Markers in 3D, with left-right flips repaired from markers and body landmarks together.

    Args:
        cameras: C cameras.
        body: the person's detected landmarks: (C, T, J, 2) px, (C, T, J) px squared, and their set.
        markers: (C, T, M, 2) px and (C, T, M) px squared of `SURFACE`.
        flips: repair of left-right flips.
        options: of the triangulation.

    Returns:
        `points_world`, `covariance_world`, `residual_px` and `inlier` as in `Points3D`, and `flipped` (C, T, M), where
        a flip was repaired.
    """
    known = len(body[2])
    # Both sets have heels: those of the skin get a name of their own.
    names = tuple(f"{name}_skin" for name in SURFACE.names)
    both = LandmarkSet("body and skin", (*body[2].names, *names), ())
    px, variance = (np.concatenate(pair, axis=2) for pair in zip(body[:2], markers, strict=True))
    px, variance, flipped = repair_flips(cameras, px, variance, both, _with_markers(flips, names))
    found = triangulate(cameras, px[:, :, known:], variance[:, :, known:], options)
    return {
        "points_world": found.points_world,
        "covariance_world": found.covariance_world,
        "residual_px": found.residual_px,
        "inlier": found.inlier,
        "flipped": flipped[:, :, known:],
    }


def _with_markers(flips: FlipOptions, names: tuple[str, ...]) -> FlipOptions:
    """The options with markers added to the arms and legs that they flip with."""
    plain = sorted({name.removeprefix("left_") for name in names if name.startswith("left_")})
    parts = []
    for part in flips.parts:
        regions = _ARM if "wrist" in part else _LEG if "ankle" in part else ()
        parts.append((*part, *(name for name in plain if name.startswith(regions))) if regions else part)
    return replace(flips, parts=tuple(parts))


def marker_set(points: Points3D, choice: MarkerChoice) -> Points3D:
    """The markers of a laboratory's set under its labels; all of them under their own names where no set is chosen."""
    return select_markers(points, _SETS[choice]) if choice in _SETS else points
