"""Characters with known joints and weights: anny's bodies in a pose and clothes, with the proportions of cartoons.

Proportions change as a rig would change them: each bone scales what follows it along and across itself, and what hangs
on it moves along; then space itself is bent a little, joints with the skin.
"""

from dataclasses import dataclass

import numpy as np

from muybridge.arrays import Float32Array, FloatArray, IntArray
from muybridge.train.synthesis.bodies.body_model import BodyModel
from muybridge.train.synthesis.bodies.pose_sampler import _shortest_rotation
from muybridge.train.synthesis.clothing.shells import Shells

_GROUPS = (
    ("head", ("head", "eye")), ("neck", ("neck",)), ("upper_arm", ("upperarm",)), ("forearm", ("lowerarm",)),
    ("hand", ("wrist", "finger", "metacarpal")), ("thigh", ("upperleg",)), ("shin", ("lowerleg",)),
    ("foot", ("foot", "toe")), ("trunk", ("root", "spine", "pelvis", "clavicle", "shoulder")),
)  # fmt: skip
# Ends of the bones along which a group is long: names without side, or None for upright ones.
_ALONG = {"upper_arm": ("upperarm01", "lowerarm01"), "forearm": ("lowerarm01", "wrist"),
          "thigh": ("upperleg01", "lowerleg01"), "shin": ("lowerleg01", "foot")}  # fmt: skip
_WAVES = 4  # of the bent space
_SHIRT, _TROUSERS, _SHOES, _SKIRT, _HAIR = 2, 1, 3, 4, 5  # parts of `Shells`


@dataclass(frozen=True, eq=False)
class Figure:
    """A mesh with its joints and weights.

    Attributes:
        vertices: (V, 3) metres, Z up, facing -Y.
        triangles: (F, 3).
        names: of the joints.
        parents: (J,) of the joints, -1 for the root.
        joints: (J, 3) metres.
        weights: (V, J) each row's sum one.
        height: of what stands on the floor without hair and hats, metres.
    """

    vertices: FloatArray
    triangles: IntArray
    names: tuple[str, ...]
    parents: IntArray
    joints: FloatArray
    weights: Float32Array
    height: float


class FigureSampler:
    """Draws characters.

    Args:
        seed: random seed.
    """

    def __init__(self, seed: int) -> None:
        self.rng = np.random.default_rng(seed)
        self.body = BodyModel(seed)
        self.shells = Shells(self.body)
        model = self.body.model
        count, joints = len(self.body.rest), len(self.body.bones)
        self.weights = np.zeros((count, joints), np.float32)
        at, share = model.vertex_bone_indices.numpy()[:count], model.vertex_bone_weights.numpy()[:count]
        np.add.at(self.weights, (np.arange(count)[:, None], at), share)
        self.weights /= self.weights.sum(axis=1, keepdims=True)
        self.parents = np.array([int(p) for p in model.bone_parents])
        plain = [bone.split(".")[0] for bone in self.body.bones]
        self.group = [next(g for g, starts in _GROUPS if name.startswith(starts)) for name in plain]

    def sample(self, cartoon: float = 0.7) -> Figure:
        """A character; a share `cartoon` of them with the proportions of cartoons, the others with those of people."""
        rng, body = self.rng, self.body
        vertices, _, height, joints = body.forward(self._pose(), body.sample_phenotypes(1))
        points, places = vertices[0].astype(np.float64), joints[0].astype(np.float64)
        bare = np.unique(self.shells.parts[0])
        if rng.random() < cartoon:
            points, places = self._reshaped(points, places)
            points, places = self._bent(points, places, float(height[0]))
        floor = points[bare, 2].min()
        points[:, 2] -= floor
        places[:, 2] -= floor
        tall = float(points[bare, 2].max())
        table, triangles, source = self._dressed(points, tall / float(height[0]))
        return Figure(table, triangles, tuple(body.bones), self.parents, places, self.weights[source], tall)

    def _pose(self) -> FloatArray:
        """(1, bones, 3) rotation vectors of somebody who stands to be rigged: arms from level to hanging."""
        body, rng = self.body, self.rng
        rotvec = np.zeros((1, len(body.bones), 3))
        down = rng.choice([rng.uniform(-5, 10), rng.uniform(25, 60), rng.uniform(60, 80)])
        bend = np.interp(down, [0, 45, 72], [-22.0, -8.0, 5.0])
        stance = rng.normal(-3, 5)
        for letter, sign in (("L", 1.0), ("R", -1.0)):
            below, ahead = np.radians(down + rng.normal(0, 2)), np.radians(rng.normal(4, 6))
            wanted = np.array([[sign * np.cos(below) * np.cos(ahead), -np.cos(below) * np.sin(ahead), -np.sin(below)]])
            lifted = _shortest_rotation(np.array([[sign * 0.17, -0.02, -0.20]]), wanted)[0]
            for bone, share in (("clavicle", 0.12), ("shoulder01", 0.10), ("upperarm01", 0.78)):
                rotvec[0, body.index(f"{bone}.{letter}")] = lifted * share
            hinge = np.cross([sign * 0.17, -0.02, -0.20], [sign * 0.12, -0.15, -0.13])
            angle = np.radians(bend + rng.normal(0, 7))
            rotvec[0, body.index(f"lowerarm01.{letter}")] = angle * hinge / np.linalg.norm(hinge)
            rotvec[0, body.index(f"upperleg01.{letter}"), 1] = -sign * np.radians(stance)
            rotvec[0, body.index(f"lowerleg01.{letter}"), 0] = np.radians(abs(rng.normal(0, 5)))
        for k, name in enumerate(body.bones):
            if name.startswith(("spine", "neck", "head")):
                rotvec[0, k] = np.radians(rng.normal(0, 1.5, 3))
        return rotvec

    def _reshaped(self, points: FloatArray, places: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Points and joints with other proportions."""
        rng = self.rng
        width = {g: float(np.exp(rng.normal(0, s))) for g, s in
                 (("neck", 0.25), ("upper_arm", 0.3), ("thigh", 0.3), ("trunk", 0.22))}  # fmt: skip
        width |= {"head": float(np.exp(rng.uniform(-0.1, 0.85))), "hand": float(np.exp(rng.uniform(-0.3, 0.7))),
                  "foot": float(np.exp(rng.uniform(-0.2, 0.7)))}  # fmt: skip
        width["forearm"] = width["upper_arm"] * float(np.exp(rng.normal(0.05, 0.2)))
        width["shin"] = width["thigh"] * float(np.exp(rng.normal(0.05, 0.2)))
        long = dict(width)
        arms, legs = float(np.exp(rng.normal(-0.1, 0.2))), float(np.exp(rng.uniform(-0.8, 0.25)))
        long |= {"neck": float(np.exp(rng.uniform(-0.8, 0.2))), "trunk": float(np.exp(rng.normal(-0.1, 0.2))),
                 "upper_arm": arms, "forearm": arms * float(np.exp(rng.normal(0, 0.1))), "thigh": legs,
                 "shin": legs * float(np.exp(rng.normal(0, 0.1)))}  # fmt: skip
        flat = {g: float(np.exp(rng.normal(0, 0.12))) for g in width}
        scales = np.stack([self._scale(k, width[g], long[g], flat[g], places) for k, g in enumerate(self.group)])
        moved = places.copy()
        for j, p in enumerate(self.parents):
            if p >= 0:
                moved[j] = moved[p] + scales[p] @ (places[j] - places[p])
        shift = moved - np.einsum("jab,jb->ja", scales, places)
        blend = np.einsum("vj,jab->vab", self.weights, scales)
        return np.einsum("vab,vb->va", blend, points) + self.weights @ shift, moved

    def _scale(self, bone: int, width: float, long: float, flat: float, places: FloatArray) -> FloatArray:
        """(3, 3) of one bone."""
        group, name = self.group[bone], self.body.bones[bone]
        axis = np.array([0.0, 0.0, 1.0])
        if group in _ALONG:
            side = name[-2:]
            begin, end = (places[self.body.index(n + side)] for n in _ALONG[group])
            axis = (end - begin) / max(float(np.linalg.norm(end - begin)), 1e-9)
        out = width * (np.eye(3) - np.outer(axis, axis)) + long * np.outer(axis, axis)
        return np.asarray(out @ np.diag([1.0, flat, 1.0])) if group not in _ALONG else out

    def _bent(self, points: FloatArray, places: FloatArray, height: float) -> tuple[FloatArray, FloatArray]:
        """Points and joints in a space that is bent by a few waves."""
        rng = self.rng
        ways = rng.normal(0, 1, (_WAVES, 3)) * [0.5, 1.0, 1.0] * 2 * np.pi / height
        size = rng.normal(0, 0.008 * height, (_WAVES, 3)) * [1.0, 1.0, 0.5]
        phase = rng.uniform(0, 2 * np.pi, _WAVES)

        def bend(p: FloatArray) -> FloatArray:
            return np.asarray(p + np.sin(p @ ways.T + phase) @ size)

        return bend(points), bend(places)

    def _dressed(self, points: FloatArray, scale: float) -> tuple[FloatArray, IntArray, IntArray]:
        """Vertices and triangles with clothes, and the vertex of the body that each is."""
        rng, shells = self.rng, self.shells
        _, normals = shells.shape(points.astype(np.float32))
        rest = self.body.rest[:, 2]
        faces, whole, source, count = (
            [shells.parts[0].astype(np.int64)],
            [points],
            [np.arange(len(points))],
            len(points),
        )
        if rng.random() < 0.6:  # no eyes, teeth and lashes, as sculptors leave them out
            inner = (shells.parts[0] < 13380).all(axis=1)
            faces = [faces[0][inner]]
        wears = [] if rng.random() < 0.3 else self._wardrobe()
        for part, away, low, high in wears:
            cloth = shells.parts[part]
            middle = rest[cloth].mean(axis=1)
            faces.append(cloth[(middle > low) & (middle < high)].astype(np.int64) + count)
            whole.append(points + scale * away * normals[: len(points)])
            source.append(np.arange(len(points)))
            count += len(points)
        every, triangles, of = np.concatenate(whole), np.concatenate(faces), np.concatenate(source)
        used, corner = np.unique(triangles, return_inverse=True)
        return every[used], corner.reshape(-1, 3).astype(np.int64), of[used]

    def _wardrobe(self) -> list[tuple[int, float, float, float]]:
        """Shells to wear: part, metres from the skin, lowest and highest height at rest."""
        rng = self.rng
        out = [(_SKIRT, rng.uniform(0.005, 0.03), rng.uniform(-0.62, -0.2), 9.0) if rng.random() < 0.25 else
               (_TROUSERS, rng.uniform(0.004, 0.03), rng.uniform(-0.78, -0.1), 9.0)]  # fmt: skip
        out.append((_SHIRT, rng.uniform(0.004, 0.04), rng.uniform(-0.1, 0.15), rng.uniform(0.5, 0.6)))
        if rng.random() < 0.6:
            out.append((_SHOES, rng.uniform(0.006, 0.03), -9.0, rng.uniform(-0.78, -0.7)))
        if rng.random() < 0.6:
            out.append((_HAIR, rng.uniform(0.0, 0.03), rng.uniform(0.3, 0.62), 9.0))
        return out
