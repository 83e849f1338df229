"""Arrays of labelled landmarks: 2D keypoints of cameras and 3D points of a take.

Shape legend of the whole project: `C` cameras, `T` frames, `P` people, `J` landmarks or joints, `M` markers, `V`
vertices. Missing values are NaN (with a score of zero), never a zero coordinate.
"""

from dataclasses import dataclass

from muybridge.arrays import BoolArray, FloatArray
from muybridge.geometry.landmarks.marker_sets import MarkerSet
from muybridge.geometry.landmarks.sets import LandmarkSet


@dataclass(frozen=True)
class Keypoints2D:
    """2D landmarks of up to `P` people in every camera and frame, not yet associated between cameras.

    A slot `p` is one track of one camera: the same person over time as far as the tracker can determine, unrelated to
    slot `p` of another camera.

    Attributes:
        landmarks: the meaning of the `J` axis.
        points_px: (C, T, P, J, 2) px of the original video, (0, 0) the centre of the top-left pixel; NaN where not
            detected.
        variance_px2: (C, T, P, J) variance of each coordinate, original px^2; NaN where missing.
        score: (C, T, P, J) confidence, 0 to 1, zero where missing.
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
        residual_px: (C, T, J) distance of the reprojection from the 2D point; NaN where the camera has none.
        inlier: (C, T, J) whether the camera's 2D point was used.
        fps: frames per second.
    """

    landmarks: LandmarkSet
    points_world: FloatArray
    covariance_world: FloatArray
    residual_px: FloatArray
    inlier: BoolArray
    fps: float


def select_markers(points: Points3D, markers: MarkerSet) -> Points3D:
    """Select the points of a marker set from `SURFACE`, under the laboratory's labels.

    The result can be written with `write_c3d` and `write_trc`, with the names that Plug-in Gait or CMU's tools expect.

    Raises:
        ValueError: `points` lack a landmark of the set.
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
