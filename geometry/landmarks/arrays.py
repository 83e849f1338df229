"""Landmarks and the arrays that carry them: 2D keypoints a camera, 3D points a take.

Shape legend of the whole project: `C` cameras, `T` frames, `P` people, `J` landmarks or joints, `M` markers,
`V` vertices. Missing is NaN (and a score of zero), never a zero coordinate.
"""

from dataclasses import dataclass

from muybridge.arrays import BoolArray, FloatArray
from muybridge.geometry.landmarks.marker_sets import MarkerSet
from muybridge.geometry.landmarks.sets import LandmarkSet


@dataclass(frozen=True)
class Keypoints2D:
    """2D landmarks of up to `P` people in every camera and frame, not yet associated between cameras.

    A slot `p` is one track of one camera: the same person over time as far as the tracker could tell, with no
    relation between slot `p` of one camera and slot `p` of another.

    Attributes:
        landmarks: the meaning of the `J` axis.
        points_px: (C, T, P, J, 2) pixels of the original video, (0, 0) the centre of the top-left pixel; NaN
            where nothing was found.
        variance_px2: (C, T, P, J) variance of each coordinate in original pixels squared; NaN where missing.
        score: (C, T, P, J) in 0..1, zero where missing.
    """

    landmarks: LandmarkSet
    points_px: FloatArray
    variance_px2: FloatArray
    score: FloatArray


@dataclass(frozen=True)
class Points3D:
    """3D landmarks of one person over a take.

    Attributes:
        landmarks: the meaning of the `J` axis.
        points_world: (T, J, 3) metres, Z up; NaN where unknown.
        covariance_world: (T, J, 3, 3) square metres; NaN where unknown.
        residual_px: (C, T, J) distance of the reprojection to the 2D point; NaN where the camera had none.
        inlier: (C, T, J) whether the camera's 2D point took part.
        fps: frames per second.
    """

    landmarks: LandmarkSet
    points_world: FloatArray
    covariance_world: FloatArray
    residual_px: FloatArray
    inlier: BoolArray
    fps: float


def select_markers(points: Points3D, markers: MarkerSet) -> Points3D:
    """The points of a marker set out of all of `SURFACE`, under the laboratory's labels.

    What it returns is what `write_c3d` and `write_trc` write, so that a take leaves with the names that Plug-in
    Gait or CMU's tools expect.

    Raises:
        ValueError: `points` lack one of the set's landmarks.
    """
    at = [points.landmarks.index(n) for n in markers.names]
    label = dict(zip(markers.names, markers.labels, strict=True))
    return Points3D(
        LandmarkSet(markers.name, markers.labels, tuple((label[a], label[b]) for a, b in markers.edges)),
        points.points_world[:, at],
        points.covariance_world[:, at],
        points.residual_px[:, :, at],
        points.inlier[:, :, at],
        points.fps,
    )
