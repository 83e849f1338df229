"""Landmarks and the arrays that carry them: 2D keypoints a camera, 3D points a take.

Shape legend of the whole project: `C` cameras, `T` frames, `P` people, `J` landmarks or joints, `M` markers,
`V` vertices. Missing is NaN (and a score of zero), never a zero coordinate.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True)
class LandmarkSet:
    """An ordered set of named body points.

    Attributes:
        name: identifier of the set, e.g. ``"body23"``.
        names: the landmarks in the order of every array's `J` axis.
        edges: pairs of names to draw as bones.
    """

    name: str
    names: tuple[str, ...]
    edges: tuple[tuple[str, str], ...]

    def __len__(self) -> int:
        return len(self.names)

    def index(self, name: str) -> int:
        """Position of `name`; ValueError if the set has no such landmark."""
        return self.names.index(name)

    @property
    def mirror(self) -> tuple[int, ...]:
        """For each landmark the index of its left/right twin (itself where there is none)."""

        def twin(name: str) -> str:
            if name.startswith("left_"):
                return "right_" + name[5:]
            return "left_" + name[6:] if name.startswith("right_") else name

        return tuple(self.names.index(twin(n)) for n in self.names)

    @property
    def edge_indices(self) -> tuple[tuple[int, int], ...]:
        """`edges` as pairs of indices."""
        return tuple((self.index(a), self.index(b)) for a, b in self.edges)


def _both(a: str, b: str) -> tuple[tuple[str, str], tuple[str, str]]:
    return (f"left_{a}", f"left_{b}"), (f"right_{a}", f"right_{b}")


# The order of anny's COCO regressor: COCO-17, then the six foot points.
BODY23 = LandmarkSet(
    name="body23",
    names=(
        "nose", "left_eye", "right_eye", "left_ear", "right_ear",
        "left_shoulder", "right_shoulder", "left_elbow", "right_elbow", "left_wrist", "right_wrist",
        "left_hip", "right_hip", "left_knee", "right_knee", "left_ankle", "right_ankle",
        "left_big_toe", "right_big_toe", "left_small_toe", "right_small_toe", "left_heel", "right_heel",
    ),
    edges=(
        ("nose", "left_eye"), ("nose", "right_eye"), *_both("eye", "ear"),
        ("left_shoulder", "right_shoulder"), ("left_hip", "right_hip"),
        *_both("shoulder", "elbow"), *_both("elbow", "wrist"), *_both("shoulder", "hip"),
        *_both("hip", "knee"), *_both("knee", "ankle"), *_both("ankle", "heel"),
        *_both("ankle", "big_toe"), *_both("big_toe", "small_toe"), *_both("heel", "big_toe"),
    ),
)  # fmt: skip


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
    points_px: NDArray[np.float64]
    variance_px2: NDArray[np.float64]
    score: NDArray[np.float64]


@dataclass(frozen=True)
class Points3D:
    """3D landmarks of one person over a take.

    Attributes:
        landmarks: the meaning of the `J` axis.
        points_world: (T, J, 3) metres, Z up; NaN where unknown.
        covariance_world: (T, J, 3, 3) square metres; NaN where unknown.
        residual_px: (C, T, J) distance of the reprojection to the 2D point; NaN where the camera had none.
        inlier: (C, T, J) whether the camera's 2D point took part.
        fps: frames a second.
    """

    landmarks: LandmarkSet
    points_world: NDArray[np.float64]
    covariance_world: NDArray[np.float64]
    residual_px: NDArray[np.float64]
    inlier: NDArray[np.bool_]
    fps: float
