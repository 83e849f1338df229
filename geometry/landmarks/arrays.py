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
class MarkerSet(LandmarkSet):
    """A laboratory's marker set: `names` are those of `SURFACE`, `labels` what the laboratory writes (``LASI``).

    Left and right markers of a limb may stand at unequal heights on purpose; twins are told by their labels.
    """

    labels: tuple[str, ...]

    @property
    def mirror(self) -> tuple[int, ...]:
        """For each marker the index of its left/right twin by label (itself where there is none)."""
        swap = {"L": "R", "R": "L"}
        twins = [swap.get(label[0], label[0]) + label[1:] for label in self.labels]
        return tuple(self.labels.index(t) if t in self.labels else i for i, t in enumerate(twins))

    @property
    def surface_indices(self) -> tuple[int, ...]:
        """Position of each marker in `SURFACE`: ``points[:, PLUG_IN_GAIT.surface_indices]`` are the set's."""
        return tuple(SURFACE.index(n) for n in self.names)


# Landmarks of the skin, defined on the body model's mesh by `train.markers`; each once, whatever sets use it.
SURFACE = LandmarkSet(
    name="surface",
    names=(
        "crown", "left_front_head", "right_front_head", "left_back_head", "right_back_head", "c7", "t10",
        "sternal_notch", "xiphoid", "left_scapula", "right_scapula", "left_asis", "right_asis", "left_psis",
        "right_psis", "sacrum", "left_iliac_crest", "right_iliac_crest", "left_trochanter", "right_trochanter",
        "left_acromion", "right_acromion", "left_upper_arm_proximal", "right_upper_arm_proximal",
        "left_upper_arm_distal", "right_upper_arm_distal", "left_elbow_lateral", "right_elbow_lateral",
        "left_elbow_medial", "right_elbow_medial", "left_forearm_proximal", "right_forearm_proximal",
        "left_forearm_distal", "right_forearm_distal", "left_radial_styloid", "right_radial_styloid",
        "left_ulnar_styloid", "right_ulnar_styloid", "left_metacarpal_2", "right_metacarpal_2", "left_metacarpal_5",
        "right_metacarpal_5", "left_thigh_proximal", "right_thigh_proximal", "left_thigh_distal",
        "right_thigh_distal", "left_knee_lateral", "right_knee_lateral", "left_knee_medial", "right_knee_medial",
        "left_patella", "right_patella", "left_tibial_tuberosity", "right_tibial_tuberosity", "left_shank_proximal",
        "right_shank_proximal", "left_shank_distal", "right_shank_distal", "left_malleolus_lateral",
        "right_malleolus_lateral", "left_malleolus_medial", "right_malleolus_medial", "left_heel", "right_heel",
        "left_metatarsal_1", "right_metatarsal_1", "left_toe", "right_toe", "left_metatarsal_5",
        "right_metatarsal_5", "left_hallux", "right_hallux",
    ),
    edges=(
        ("c7", "t10"), ("sternal_notch", "xiphoid"), ("left_asis", "right_asis"), ("left_psis", "right_psis"),
        ("left_front_head", "right_front_head"), ("left_back_head", "right_back_head"),
        *_both("front_head", "back_head"), *_both("acromion", "upper_arm_proximal"),
        *_both("upper_arm_proximal", "upper_arm_distal"), *_both("upper_arm_distal", "elbow_lateral"),
        *_both("elbow_lateral", "elbow_medial"), *_both("elbow_lateral", "forearm_proximal"),
        *_both("forearm_proximal", "forearm_distal"), *_both("forearm_distal", "radial_styloid"),
        *_both("radial_styloid", "ulnar_styloid"), *_both("radial_styloid", "metacarpal_2"),
        *_both("ulnar_styloid", "metacarpal_5"), *_both("metacarpal_2", "metacarpal_5"),
        *_both("asis", "iliac_crest"), *_both("iliac_crest", "psis"), *_both("trochanter", "thigh_proximal"),
        *_both("thigh_proximal", "thigh_distal"), *_both("thigh_distal", "knee_lateral"),
        *_both("knee_lateral", "patella"), *_both("patella", "knee_medial"), *_both("patella", "tibial_tuberosity"),
        *_both("knee_lateral", "shank_proximal"), *_both("shank_proximal", "shank_distal"),
        *_both("shank_distal", "malleolus_lateral"), *_both("knee_medial", "malleolus_medial"),
        *_both("malleolus_lateral", "heel"), *_both("malleolus_medial", "heel"), *_both("toe", "hallux"),
        *_both("metatarsal_1", "toe"), *_both("toe", "metatarsal_5"), *_both("heel", "metatarsal_1"),
        *_both("heel", "metatarsal_5"),
    ),
)  # fmt: skip


def _set(name: str, by_label: dict[str, str]) -> MarkerSet:
    chosen = set(by_label.values())
    edges = tuple((a, b) for a, b in SURFACE.edges if a in chosen and b in chosen)
    return MarkerSet(name, tuple(by_label.values()), edges, tuple(by_label))


# Vicon's Plug-in Gait, whole body, 39 markers.
PLUG_IN_GAIT = _set(
    "plug_in_gait",
    {
        "LFHD": "left_front_head", "RFHD": "right_front_head", "LBHD": "left_back_head", "RBHD": "right_back_head",
        "C7": "c7", "T10": "t10", "CLAV": "sternal_notch", "STRN": "xiphoid", "RBAK": "right_scapula",
        "LSHO": "left_acromion", "LUPA": "left_upper_arm_proximal", "LELB": "left_elbow_lateral",
        "LFRM": "left_forearm_distal", "LWRA": "left_radial_styloid", "LWRB": "left_ulnar_styloid",
        "LFIN": "left_metacarpal_2", "RSHO": "right_acromion", "RUPA": "right_upper_arm_distal",
        "RELB": "right_elbow_lateral", "RFRM": "right_forearm_proximal", "RWRA": "right_radial_styloid",
        "RWRB": "right_ulnar_styloid", "RFIN": "right_metacarpal_2", "LASI": "left_asis", "RASI": "right_asis",
        "LPSI": "left_psis", "RPSI": "right_psis", "LTHI": "left_thigh_distal", "LKNE": "left_knee_lateral",
        "LTIB": "left_shank_distal", "LANK": "left_malleolus_lateral", "LHEE": "left_heel", "LTOE": "left_toe",
        "RTHI": "right_thigh_proximal", "RKNE": "right_knee_lateral", "RTIB": "right_shank_proximal",
        "RANK": "right_malleolus_lateral", "RHEE": "right_heel", "RTOE": "right_toe",
    },
)  # fmt: skip

# The 41 markers of the Carnegie Mellon motion capture database.
CMU = _set(
    "cmu",
    {
        "LFHD": "left_front_head", "RFHD": "right_front_head", "LBHD": "left_back_head", "RBHD": "right_back_head",
        "C7": "c7", "T10": "t10", "CLAV": "sternal_notch", "STRN": "xiphoid", "RBAC": "right_scapula",
        "LSHO": "left_acromion", "LUPA": "left_upper_arm_proximal", "LELB": "left_elbow_lateral",
        "LFRM": "left_forearm_distal", "LWRA": "left_radial_styloid", "LWRB": "left_ulnar_styloid",
        "LFIN": "left_metacarpal_2", "RSHO": "right_acromion", "RUPA": "right_upper_arm_distal",
        "RELB": "right_elbow_lateral", "RFRM": "right_forearm_proximal", "RWRA": "right_radial_styloid",
        "RWRB": "right_ulnar_styloid", "RFIN": "right_metacarpal_2", "LFWT": "left_asis", "RFWT": "right_asis",
        "LBWT": "left_psis", "RBWT": "right_psis", "LTHI": "left_thigh_distal", "LKNE": "left_knee_lateral",
        "LSHN": "left_shank_distal", "LANK": "left_malleolus_lateral", "LHEE": "left_heel", "LTOE": "left_toe",
        "LMT5": "left_metatarsal_5", "RTHI": "right_thigh_proximal", "RKNE": "right_knee_lateral",
        "RSHN": "right_shank_proximal", "RANK": "right_malleolus_lateral", "RHEE": "right_heel", "RTOE": "right_toe",
        "RMT5": "right_metatarsal_5",
    },
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
