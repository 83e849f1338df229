"""What the page shows of a file: joints or points over time, meshes that follow them, and feet on the floor."""

import base64
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from muybridge.arrays import FloatArray, IntArray
from muybridge.errors import FormatError, MuybridgeError
from muybridge.geometry.landmarks.arrays import Points3D
from muybridge.geometry.roles import find_roles
from muybridge.geometry.skeleton.motion import Motion
from muybridge.infer.runtime.reading import read_for_command
from muybridge.infer.viewer.packing import encode, pack_places, pack_units
from muybridge.motion.character import Character, Mesh, pose_meshes, read_character
from muybridge.motion.character.surface import vertex_normals
from muybridge.motion.contacts.feet import feet_of_motion, feet_of_points
from muybridge.motion.contacts.find import find_contacts
from muybridge.motion.formats.registry import ReadOptions
from muybridge.motion.take import points_of_motion

_CHARACTERS = (".glb", ".gltf", ".vrm", ".vrma", ".fbx")
_IMAGES = ("image/png", "image/jpeg")
# Joints that a vertex follows in the page: the heaviest ones.
MOST_JOINTS = 8


@dataclass(frozen=True, eq=False)
class Scene:
    """One file as the page shows it.

    Attributes:
        packed: what the script gets, for JSON.
        frames: how many.
        fps: frames per second.
        vertices: of all meshes.
        size: metres, the largest extent of the joints or points in the first frame with any.
        notices: assumptions made in reading, one sentence each.
    """

    packed: dict[str, Any]
    frames: int
    fps: float
    vertices: int = 0
    size: float = 0.0
    notices: tuple[str, ...] = field(default_factory=tuple)


def read_scene(path: Path, options: ReadOptions | None = None) -> Scene:
    """Read what the page shows of a file of points, of motion, or of a character.

    Args:
        path: any file that `read_file` reads.
        options: what the file does not state.

    Raises:
        FormatError: malformed, of no known format, without a frame, or without a single finite position.
    """
    options = options or ReadOptions()
    take = read_for_command(path, options)
    character = None
    if path.suffix.lower() in _CHARACTERS:
        character = read_character(path, options.clip)
    points = take.positions
    motion = take.motion
    if character is not None:
        motion = character.motion
        if take.motion is not None and options.fps is not None:
            motion = Motion(motion.skeleton, options.fps, motion.root_positions_world, motion.quat_wxyz,
                            motion.translations)  # fmt: skip
        points = points_of_motion(motion)
    if not len(points.points_world):
        raise FormatError(f"{path}: holds no frame, so there is nothing to show")
    if not np.isfinite(points.points_world).all(axis=-1).any():
        raise FormatError(f"{path}: holds no position that is known, so there is nothing to show")
    packed = pack_take(path.name, points, motion)
    packed["contacts"] = _contacts(motion if motion is not None else points, character)
    vertices = 0
    if character is not None:
        packed |= {"meshes": [pack_mesh(m) for m in character.meshes], "materials": _materials(character)}
        packed["margin"] = _margin(character, points)
        vertices = sum(len(m.positions) for m in character.meshes)
    notices = tuple(dict.fromkeys((*take.notices, *(character.notices if character is not None else ()))))
    return Scene(packed, len(points.points_world), points.fps, vertices, _size(points), notices)


def _size(points: Points3D) -> float:
    known = np.asarray(np.isfinite(points.points_world).all(axis=-1))
    first = int(np.argmax(known.any(axis=1)))
    return float(np.ptp(points.points_world[first, known[first]], axis=0).max())


def pack_take(name: str, points: Points3D, motion: Motion | None = None) -> dict[str, Any]:
    """Names, lines between them and places over time; of a motion also the joints' turns in the world."""
    names = points.landmarks.names
    place = {n: i for i, n in enumerate(names)}
    packed: dict[str, Any] = {
        "name": name,
        "fps": points.fps,
        "frames": len(points.points_world),
        "names": list(names),
        "edges": [[place[a], place[b]] for a, b in points.landmarks.edges],
        "places": pack_places(points.points_world),
        "parents": None,
        "turns": None,
        "meshes": [],
        "materials": [],
        "contacts": None,
        "margin": None,
    }
    if motion is not None:
        turns = motion.forward()[..., :3, :3]
        quat_xyzw = Rotation.from_matrix(turns.reshape(-1, 3, 3)).as_quat().reshape(*turns.shape[:2], 4)
        packed |= {"parents": list(motion.skeleton.parents), "turns": pack_units(quat_xyzw)}
    return packed


def pack_mesh(mesh: Mesh) -> dict[str, Any]:
    """A mesh: vertices, and the few joints that they follow with their bind matrices."""
    positions = mesh.positions
    for morph, weight in zip(mesh.morphs, mesh.morph_weights, strict=True):
        positions = positions + weight * morph.offsets
    joints, weights = _heaviest(mesh.joints, mesh.weights)
    used, numbers = np.unique(joints, return_inverse=True)
    normals = mesh.normals if mesh.normals is not None else vertex_normals(positions, mesh.triangles)
    packed = {
        "name": mesh.name,
        "count": len(positions),
        "positions": pack_places(positions),
        "normals": encode(np.round(127 * np.clip(np.c_[normals, np.zeros(len(normals))], -1, 1)), "i1"),
        "triangles": encode(mesh.triangles, "<u4"),
        "width": joints.shape[1],
        "joints": encode(numbers.reshape(joints.shape), "<u2"),
        "weights": encode(np.round(65535 * weights), "<u2"),
        "used": used.tolist(),
        "bind": encode(mesh.bind[used, :3], "<f4"),
        "uvs": None if mesh.uvs is None else encode(mesh.uvs, "<f4"),
        "material": mesh.material,
    }
    return packed


def _margin(character: Character, points: Points3D) -> list[list[float]] | None:
    """Metres by which the meshes go beyond the joints in the first frame, towards each axis' low and high end."""
    if not character.meshes:
        return None
    posed = np.concatenate([m[0] for m in pose_meshes(character, character.motion.select([0]))])
    joints = points.points_world[0]
    low, high = joints.min(axis=0) - posed.min(axis=0), posed.max(axis=0) - joints.max(axis=0)
    return [np.maximum(low, 0.0).tolist(), np.maximum(high, 0.0).tolist()]


def _heaviest(joints: IntArray, weights: FloatArray) -> tuple[IntArray, FloatArray]:
    """(V, 4 or 8) of each vertex's joints and weights, whose sum is one."""
    width = 4 if weights.shape[1] <= 4 else MOST_JOINTS
    order = np.argsort(-weights, axis=1, kind="stable")[:, :width]
    joints, weights = np.take_along_axis(joints, order, 1), np.take_along_axis(weights, order, 1)
    short = width - weights.shape[1]
    weights = np.pad(weights, ((0, 0), (0, short)))
    joints = np.where(weights > 0, np.pad(joints, ((0, 0), (0, short))), joints[:, :1])
    return joints, weights / np.maximum(weights.sum(axis=1, keepdims=True), 1e-12)


def _materials(character: Character) -> list[dict[str, Any]]:
    return [
        {
            "colour": np.round(m.colour, 4).tolist(),
            "double": m.double_sided,
            "image": f"data:{m.image_type};base64,{base64.b64encode(m.image).decode('ascii')}"
            if m.image is not None and m.image_type in _IMAGES
            else None,
        }
        for m in character.materials
    ]


def _contacts(source: Motion | Points3D, character: Character | None) -> dict[str, Any] | None:
    """Which heels and balls stand, and where they are; None where the feet are not known."""
    try:
        if isinstance(source, Motion):
            names = source.skeleton.names
            table = {} if character is None else {bone: names[j] for bone, j in character.humanoid.items()}
            roles = find_roles(source.skeleton, table or None).roles
            feet = feet_of_motion(source, roles)
            found = find_contacts(source, roles=roles)
        else:
            feet, found = feet_of_points(source), find_contacts(source)
    except (ValueError, MuybridgeError):
        return None
    count = len(found.contact)
    return {
        "stands": encode(found.contact.reshape(count, 4), "u1"),
        "places": pack_places(feet.places.reshape(count, 4, 3)),
        "floor": float(found.floor.height),
    }
