"""A mesh bound to a skeleton, with what a file may hold: seams, two materials, textures, colours, a morph."""

import io
from pathlib import Path

import numpy as np
from PIL import Image
from scipy.spatial import cKDTree

from muybridge.geometry.skeleton.motion import Motion
from muybridge.motion.character import read_character
from muybridge.motion.character.character import Character, Morph
from muybridge.motion.character.meshes import BoundMesh, Look, NamedMotion, Picture, StaticMesh, Surface
from muybridge.motion.character.rigging import rig_mesh
from tests.motion.character.rigging.figures import person

SEAM = 7  # points that two vertices share


def picture(kind: str = "PNG", colour: tuple[int, int, int] = (200, 40, 10)) -> bytes:
    out = io.BytesIO()
    Image.new("RGB", (4, 4), colour).save(out, kind)
    return out.getvalue()


def figure(seed: int = 0) -> BoundMesh:
    """A person of two objects, one with two materials; the first `SEAM` points of the body are there twice."""
    rng = np.random.default_rng(seed)
    vertices, triangles, _ = person(40.0)
    rig = rig_mesh(vertices, triangles)
    half = len(triangles) // 2
    sheared = triangles[half:].copy()
    positions = np.concatenate([vertices, vertices[:SEAM]])
    for k in range(SEAM):
        sheared[sheared == k] = len(vertices) + k
    normals = rng.normal(size=positions.shape)
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    morph = Morph("smile", np.where(positions[:, 2:] > 1.5, 0.01, 0.0) * [0.0, -1.0, 0.0])
    attributes = {"TEXCOORD_0": rng.random((len(positions), 2)), "COLOR_0": rng.random((len(positions), 4))}
    body = [Surface("body", positions, t, normals, attributes, m, (morph,))
            for m, t in enumerate((triangles[:half], sheared))]  # fmt: skip
    bare = Surface("cloth", vertices * [1.1, 1.1, 1.0], triangles)
    cloth = {"metallicFactor": 0.25, "roughnessFactor": 0.6, "baseColorFactor": [0.1, 0.5, 0.2, 0.5]}
    look = Look(
        ({"name": "skin", "normalTexture": {"index": 1},
          "pbrMetallicRoughness": {"baseColorTexture": {"index": 0}, "metallicRoughnessTexture": {"index": 1}}},
         {"name": "cloth", "alphaMode": "BLEND", "pbrMetallicRoughness": cloth}),
        ({"source": 0, "sampler": 0}, {"source": 1}), ({"wrapS": 33071},),
        (Picture("skin.png", picture(), "image/png"), Picture("bumps", picture("JPEG"), "image/jpeg")),
    )  # fmt: skip
    mesh = StaticMesh(Path("person.obj"), (*body, bare), look)
    joints = np.zeros((len(mesh.vertices), 3), np.int64)
    near = cKDTree(rig.joints).query(mesh.vertices, k=3)
    joints[:], weights = near[1], 1.0 / (near[0] + 0.02) ** 2
    return BoundMesh(mesh, rig.skeleton(), rig.joints[0], joints, weights / weights.sum(axis=1, keepdims=True))


def dance(bound: BoundMesh, name: str = "dance", frames: int = 12, fps: float = 30.0, seed: int = 0) -> NamedMotion:
    """Every joint turns by itself, and the root wanders."""
    rng = np.random.default_rng(seed)
    turn = rng.normal(0, 0.5, (1, len(bound.skeleton), 3)) * np.sin(np.linspace(0, 3, frames))[:, None, None]
    quat = np.concatenate([np.ones((*turn.shape[:2], 1)), turn], axis=2)
    quat /= np.linalg.norm(quat, axis=2, keepdims=True)
    root = bound.root + np.linspace(0, 1, frames)[:, None] * (0.5, -1.0, 0.1)
    return NamedMotion(name, Motion(bound.skeleton, fps, root, quat))


def posed(bound: BoundMesh, motion: Motion) -> np.ndarray:
    """(T, V, 3) the vertices of all surfaces by linear blending, as its definition has it."""
    world = motion.forward()
    rest = bound.skeleton.rest_positions + bound.root
    out = np.zeros((len(motion), len(bound.mesh.vertices), 3))
    for k in range(bound.joints.shape[1]):
        at = world[:, bound.joints[:, k]]
        local = bound.mesh.vertices - rest[bound.joints[:, k]]
        out += bound.weights[:, k, None] * (np.einsum("tvij,vj->tvi", at[..., :3, :3], local) + at[..., :3, 3])
    return out


def apart(seen: np.ndarray, wanted: np.ndarray) -> float:
    """Metres, the largest distance of a vertex from the nearest one of the other, over frames (T, V, 3)."""
    return max(
        max(float(cKDTree(a).query(b)[0].max()), float(cKDTree(b).query(a)[0].max()))
        for a, b in zip(seen, wanted, strict=True)
    )


def read_posed(path: Path, clip: str | None = None) -> tuple[Character, np.ndarray]:
    """A file as it is read, and the vertices of its clip."""
    character = read_character(path, clip)
    return character, np.concatenate(character.pose(character.motion), axis=1)
