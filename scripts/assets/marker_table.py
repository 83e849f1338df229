"""Write train/synthesis/bodies/surface_markers.csv: anatomical surface landmarks on anny's average adult.

Usage: python -m scripts.assets.marker_table

Left landmarks are found by geometry (extreme points of sections at a joint, rays from a joint, heights as shares of
stature); right ones are their mirror images by the mesh's symmetry.
"""

import csv
import pathlib

import numpy as np
from scipy.spatial import cKDTree

from muybridge.arrays import FloatArray, IndexArray
from muybridge.train.synthesis.bodies.body_model import BODY_VERTICES, BodyModel

TABLE = pathlib.Path(__file__).parents[2] / "train/synthesis/bodies/surface_markers.csv"
FORWARD, LEFT, UP = np.array([0.0, -1, 0]), np.array([1.0, 0, 0]), np.array([0.0, 0, 1])


def unit(v: FloatArray) -> FloatArray:
    return v / np.linalg.norm(v)


def across(v: FloatArray, axis: FloatArray) -> FloatArray:
    """Unit `v` without its component along `axis`."""
    axis = unit(axis)
    return unit(v - (v @ axis) * axis)


class Surface:
    """The average adult's skin in the A-pose, and the joints; the floor is z = 0.

    Args:
        body: the body model.
    """

    def __init__(self, body: BodyModel) -> None:
        phenotypes = np.full((1, len(body.model.phenotype_labels)), 0.5, np.float32)
        phenotypes[0, list(body.model.phenotype_labels).index("age")] = 2 / 3
        vertices, _, height, joints = body.forward(np.zeros((1, len(body.bones), 3)), phenotypes)
        self.vertices = vertices[0, :BODY_VERTICES].astype(float)
        self.height = float(height[0])
        self.joints = {b: j.astype(float) for b, j in zip(body.bones, joints[0], strict=True)}
        faces = body.parts[0]
        self.faces = faces[(faces < BODY_VERTICES).all(1)]
        self.corners = self.vertices[self.faces]
        steps = np.array([(i, j, 8 - i - j) for i in range(9) for j in range(9 - i)]) / 8
        self.weights = steps
        self.samples = np.einsum("sk,fkc->fsc", steps, self.corners)

    def ray(self, origin: FloatArray, direction: FloatArray, reach: float = 0.3) -> tuple[FloatArray, FloatArray]:
        """Vertices (3,) and weights (3,) of the outermost surface within `reach` of `origin` along `direction`."""
        d = unit(np.asarray(direction, float))
        a, e1, e2 = self.corners[:, 0], self.corners[:, 1] - self.corners[:, 0], self.corners[:, 2] - self.corners[:, 0]
        h = np.cross(d, e2)
        det = (e1 * h).sum(1)
        det = np.where(np.abs(det) < 1e-14, np.nan, det)
        s = np.asarray(origin, float) - a
        u = (s * h).sum(1) / det
        q = np.cross(s, e1)
        v = (q @ d) / det
        t = (q * e2).sum(1) / det
        good = (u >= 0) & (v >= 0) & (u + v <= 1) & (t > 0) & (t < reach)
        best = int(np.nanargmax(np.where(good, t, -1)))
        if not good[best]:
            raise ValueError(f"no surface from {origin} along {direction}")
        return self.faces[best], np.array([1 - u[best] - v[best], u[best], v[best]])

    def extreme(
        self, direction: FloatArray, center: FloatArray, normal: FloatArray, half: float, reach: float
    ) -> tuple[FloatArray, FloatArray]:
        """The farthest point along `direction` of the section through `center`, `half` metres thick to each side."""
        offset = self.samples - center
        near = (np.abs(offset @ unit(normal)) < half) & (np.linalg.norm(offset, axis=-1) < reach)
        score = np.where(near, offset @ unit(direction), -np.inf)
        face, sample = np.unravel_index(int(np.argmax(score)), score.shape)
        return self.faces[face], self.weights[sample]


def find(s: Surface) -> dict[str, tuple[FloatArray, FloatArray]]:
    """Left and midline landmarks: vertices and weights."""
    found: dict[str, tuple[FloatArray, FloatArray]] = {}
    found |= _head_and_trunk(s)
    found |= _arm(s)
    found |= _leg(s)
    return found


def _head_and_trunk(s: Surface) -> dict[str, tuple[FloatArray, FloatArray]]:
    h = s.height / 1.838
    band = s.joints["eye.L"][2] + 0.040 * h  # a head band above the brows
    head = np.array([0, s.joints["head"][1] - 0.01, band])
    hip = s.joints["upperleg01.L"]
    chest = s.joints["spine02"]
    at = lambda x, z: np.array([x * h, chest[1] - 0.03, z * h])  # noqa: E731
    return {
        "crown": s.ray(head, UP),
        "left_front_head": s.ray(head, [0.85, -0.53, 0]),
        "left_back_head": s.ray(head, [0.66, 0.75, 0]),
        "c7": s.ray(at(0, 1.572), -FORWARD),
        "t10": s.ray(at(0, 1.325), -FORWARD),
        "sternal_notch": s.ray(at(0, 1.500), FORWARD),
        "xiphoid": s.ray(at(0, 1.300), FORWARD),
        "left_scapula": s.ray(at(0.095, 1.42), -FORWARD),
        "left_asis": s.ray(np.array([0.120 * h, hip[1], hip[2] + 0.068 * h]), FORWARD),
        "left_psis": s.ray(np.array([0.045 * h, hip[1], hip[2] + 0.085 * h]), -FORWARD),
        "sacrum": s.ray(np.array([0, hip[1], hip[2] + 0.070 * h]), -FORWARD),
        "left_iliac_crest": s.ray(np.array([0.05 * h, hip[1] - 0.01, hip[2] + 0.125 * h]), LEFT),
        "left_trochanter": s.extreme(LEFT, hip - 0.012 * h * UP, UP, 0.008 * h, 0.2),
    }


def _arm(s: Surface) -> dict[str, tuple[FloatArray, FloatArray]]:
    j = s.joints
    shoulder, elbow, wrist = j["upperarm01.L"], j["lowerarm01.L"], j["wrist.L"]
    upper, fore = unit(elbow - shoulder), unit(wrist - elbow)
    lateral = -unit(np.cross(upper, fore))
    hinge = elbow + 0.005 * unit(upper - fore)  # in line with the humerus; the end of the bone lies in front of it
    radial = across(j["finger2-1.L"] - j["finger5-1.L"], fore)
    middle = (j["finger2-1.L"] + j["finger5-1.L"]) / 2
    dorsal_hand = -unit(np.cross(middle - wrist, j["finger2-1.L"] - j["finger5-1.L"]))
    dorsal = across(-np.cross(fore, radial), fore)
    upper_arm = lambda k: shoulder + (elbow - shoulder) * k  # noqa: E731
    forearm = lambda k: elbow + (wrist - elbow) * k  # noqa: E731
    across_upper = across(lateral, upper)
    return {
        "left_acromion": s.ray(shoulder + np.array([-0.004, 0.006, 0]), UP),
        "left_upper_arm_proximal": s.ray(upper_arm(0.42), across_upper, 0.15),
        "left_upper_arm_distal": s.ray(upper_arm(0.66), across_upper, 0.15),
        "left_elbow_lateral": s.ray(hinge, lateral, 0.08),
        "left_elbow_medial": s.ray(hinge, -lateral, 0.08),
        "left_forearm_proximal": s.ray(forearm(0.36), dorsal, 0.1),
        "left_forearm_distal": s.ray(forearm(0.68), dorsal, 0.1),
        "left_radial_styloid": s.extreme(radial, wrist - 0.006 * fore, fore, 0.004, 0.06),
        "left_ulnar_styloid": s.extreme(-radial, wrist - 0.010 * fore, fore, 0.004, 0.06),
        "left_metacarpal_2": s.ray(j["finger2-1.L"], dorsal_hand, 0.05),
        "left_metacarpal_5": s.ray(j["finger5-1.L"], dorsal_hand, 0.05),
    }


def _leg(s: Surface) -> dict[str, tuple[FloatArray, FloatArray]]:
    j = s.joints
    hip, knee, ankle = j["upperleg01.L"], j["lowerleg01.L"], j["foot.L"]
    thigh, shank = knee - hip, ankle - knee
    whole = ankle - hip
    lateral, front = across(LEFT, whole), across(FORWARD, whole)
    on_thigh, on_shank = (lambda k: hip + thigh * k), (lambda k: knee + shank * k)
    foot = unit((j["toe2-1.L"] - ankle) * [1, 1, 0])
    out = across(LEFT, foot)
    return {
        "left_thigh_proximal": s.ray(on_thigh(0.38), across(LEFT, thigh)),
        "left_thigh_distal": s.ray(on_thigh(0.66), across(LEFT, thigh)),
        "left_knee_lateral": s.extreme(lateral, knee, whole, 0.006, 0.1),
        "left_knee_medial": s.extreme(-lateral, knee, whole, 0.006, 0.1),
        "left_patella": s.ray(knee, front),
        "left_tibial_tuberosity": s.ray(on_shank(0.13), across(FORWARD, shank)),
        "left_shank_proximal": s.ray(on_shank(0.36), across(LEFT, shank)),
        "left_shank_distal": s.ray(on_shank(0.66), across(LEFT, shank)),
        "left_malleolus_lateral": s.ray(ankle - 0.006 * UP + 0.004 * foot, out, 0.08),
        "left_malleolus_medial": s.ray(ankle + 0.008 * UP + 0.008 * foot, -out, 0.08),
        "left_heel": s.extreme(-foot, ankle - 0.040 * UP, UP, 0.006, 0.1),
        "left_metatarsal_1": s.ray(j["toe1-1.L"], -out + 0.35 * UP, 0.06),
        "left_toe": s.ray(j["toe2-1.L"] - 0.008 * foot, UP, 0.06),
        "left_metatarsal_5": s.ray(j["toe5-1.L"], out + 0.45 * UP, 0.06),
        "left_hallux": s.ray(j["toe1-2.L"] + 0.012 * foot, UP, 0.05),
    }


def mirrored_vertices(rest: FloatArray) -> IndexArray:
    """For every body vertex the index of its mirror image."""
    distance, twin = cKDTree(rest).query(rest * [-1, 1, 1])
    if distance.max() > 1e-3:
        raise ValueError(f"the mesh is not symmetric: {distance.max():.4f} m")
    return twin


# Tolerance: standard deviation between trained examiners who palpate the landmark or place the marker, mm.
TOLERANCE_MM = {
    "crown": 10, "front_head": 15, "back_head": 15, "c7": 10, "t10": 14, "sternal_notch": 6, "xiphoid": 12,
    "scapula": 25, "asis": 12, "psis": 10, "sacrum": 10, "iliac_crest": 15, "trochanter": 14, "acromion": 10,
    "upper_arm_proximal": 25, "upper_arm_distal": 25, "elbow_lateral": 8, "elbow_medial": 8,
    "forearm_proximal": 25, "forearm_distal": 25, "radial_styloid": 6, "ulnar_styloid": 6, "metacarpal_2": 7,
    "metacarpal_5": 7, "thigh_proximal": 30, "thigh_distal": 30, "knee_lateral": 10, "knee_medial": 10,
    "patella": 8, "tibial_tuberosity": 7, "shank_proximal": 25, "shank_distal": 25, "malleolus_lateral": 6,
    "malleolus_medial": 6, "heel": 7, "metatarsal_1": 6, "toe": 7, "metatarsal_5": 6, "hallux": 6,
}  # fmt: skip

_PAIRS = {
    "front_head": ("FHD", "FHD"), "back_head": ("BHD", "BHD"), "acromion": ("SHO", "SHO"),
    "elbow_lateral": ("ELB", "ELB"), "radial_styloid": ("WRA", "WRA"), "ulnar_styloid": ("WRB", "WRB"),
    "metacarpal_2": ("FIN", "FIN"), "asis": ("ASI", "FWT"), "psis": ("PSI", "BWT"), "knee_lateral": ("KNE", "KNE"),
    "malleolus_lateral": ("ANK", "ANK"), "heel": ("HEE", "HEE"), "toe": ("TOE", "TOE"), "metatarsal_5": ("", "MT5"),
}  # fmt: skip
# Names in the sets (Plug-in Gait, CMU); limb markers are at different heights left and right.
SET_NAMES = {
    "c7": ("C7", "C7"), "t10": ("T10", "T10"), "sternal_notch": ("CLAV", "CLAV"), "xiphoid": ("STRN", "STRN"),
    "right_scapula": ("RBAK", "RBAC"),
    "left_upper_arm_proximal": ("LUPA", "LUPA"), "right_upper_arm_distal": ("RUPA", "RUPA"),
    "left_forearm_distal": ("LFRM", "LFRM"), "right_forearm_proximal": ("RFRM", "RFRM"),
    "left_thigh_distal": ("LTHI", "LTHI"), "right_thigh_proximal": ("RTHI", "RTHI"),
    "left_shank_distal": ("LTIB", "LSHN"), "right_shank_proximal": ("RTIB", "RSHN"),
} | {
    f"{side}_{name}": tuple(side[0].upper() + short if short else "" for short in shorts)
    for name, shorts in _PAIRS.items() for side in ("left", "right")
}  # fmt: skip


def main() -> None:
    body = BodyModel(0)
    surface = Surface(body)
    twin = mirrored_vertices(body.rest[:BODY_VERTICES].astype(float))
    rows = []
    for name, (face, weights) in find(surface).items():
        stem = name.removeprefix("left_")
        sides = (("left", face), ("right", twin[face])) if stem != name else (("", face),)
        for side, vertices in sides:
            full = f"{side}_{stem}" if side else stem
            mirror = {"left": f"right_{stem}", "right": f"left_{stem}"}.get(side, stem)
            pig, cmu = SET_NAMES.get(full, ("", ""))
            rows.append(
                [full, side or "middle", mirror, *map(int, vertices), *(f"{w:.4f}" for w in weights),
                 TOLERANCE_MM[stem], pig, cmu]
            )  # fmt: skip
    with TABLE.open("w", newline="") as file:
        out = csv.writer(file, lineterminator="\n")
        header = "name side mirror vertex_a vertex_b vertex_c weight_a weight_b weight_c tolerance_mm pig39 cmu41"
        out.writerow(header.split())
        out.writerows(rows)
    print(f"{len(rows)} landmarks in {TABLE}")


if __name__ == "__main__":
    main()
