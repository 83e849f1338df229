"""A motion or points with left and right exchanged.

Every joint takes the mirror image of its counterpart's orientation in the world, so that limbs point where the
counterpart's images point, also on a skeleton whose rest pose is not symmetric: a constant rotation for each joint
leads from its own bone at rest to the image of its counterpart's. Bones keep their lengths.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Literal, cast

import numpy as np

from muybridge.arrays import FloatArray
from muybridge.errors import MuybridgeError
from muybridge.geometry.landmarks.arrays import Points3D
from muybridge.geometry.numerics.rotations import (
    continuous_quat,
    exp_so3,
    kabsch,
    log_so3,
    quat_from_matrix,
)
from muybridge.geometry.roles import find_motion_roles
from muybridge.geometry.skeleton.motion import Motion
from muybridge.geometry.skeleton.skeleton import Skeleton
from muybridge.motion.editing.channels import T, body_joint, check_editable, roots_of
from muybridge.motion.editing.pairing import Sides, find_sides, pair_names

Plane = Literal["start", "x", "y"]
_SHORTEST = 1e-4  # metres of a bone that has a direction
_START = 1.0  # seconds: about one stride
_PARALLEL = 0.05  # sine under which bones are of one direction


@dataclass(frozen=True, eq=False)
class RestImages:
    """How the two sides of a rest pose differ.

    Attributes:
        reflection: (3, 3) across the plane between the sides at rest.
        turns: (J, 3, 3) from a joint's own bones at rest to the images of its counterpart's; the identity on a
            symmetric skeleton.
    """

    reflection: FloatArray
    turns: FloatArray

    @property
    def largest_angle(self) -> float:
        """Radians, of all these rotations."""
        return float(np.linalg.norm(log_so3(self.turns), axis=-1).max())


def mirror(thing: T, plane: Plane = "start", roles: Mapping[str, int] | None = None) -> T:
    """Exchange left and right.

    Args:
        thing: a motion, or points whose names say left and right.
        plane: the vertical plane of the mirror: "start" goes through where the body is at the start, along its
            heading, so that the take begins as it did; "x" and "y" are the world's planes x = 0 and y = 0.
        roles: role -> joint of a motion; None finds them.

    Raises:
        MuybridgeError: the skeleton or the names have no two sides, or the clip is empty.
    """
    check_editable(thing)
    return cast(T, _mirror_points(thing, plane) if isinstance(thing, Points3D) else _mirror_motion(thing, plane, roles))  # type: ignore[redundant-cast]


def rest_images(skeleton: Skeleton, sides: Sides) -> RestImages:
    """Rotations between the two sides of a rest pose."""
    reflection = _reflection(sides.normal)
    turns = np.tile(np.eye(3), (len(skeleton), 1, 1))
    for j, parent in enumerate(skeleton.parents):
        other = sides.partner[j]
        if other < j:  # the exact inverse of the counterpart's, so that mirroring twice changes nothing
            turns[j] = reflection @ turns[other].T @ reflection
            continue
        own, images = _bones(skeleton, sides, j, reflection)
        if len(own) == 0:
            turns[j] = turns[parent] if parent >= 0 else np.eye(3)
        else:
            turns[j] = _between(own, images)
        if other == j:
            turn = log_so3(turns[j][None])[0]
            turns[j] = exp_so3(0.5 * (turn + reflection @ turn))
    return RestImages(reflection, turns)


def _bones(skeleton: Skeleton, sides: Sides, j: int, reflection: FloatArray) -> tuple[FloatArray, FloatArray]:
    """(N, 3) directions of a joint's bones, and of the images of its counterpart's; unit length."""
    other, pairs = sides.partner[j], []
    for child, parent in enumerate(skeleton.parents):
        if parent == j and skeleton.parents[sides.partner[child]] == other and child not in sides.alone:
            pairs.append((skeleton.offsets[child], reflection @ skeleton.offsets[sides.partner[child]]))
    if not pairs and np.isfinite(skeleton.tips[[j, other]]).all():
        pairs.append((skeleton.tips[j], reflection @ skeleton.tips[other]))
    pairs = [(a, b) for a, b in pairs if min(np.linalg.norm(a), np.linalg.norm(b)) > _SHORTEST]
    unit = [(a / np.linalg.norm(a), b / np.linalg.norm(b)) for a, b in pairs]
    return np.array([a for a, _ in unit]).reshape(-1, 3), np.array([b for _, b in unit]).reshape(-1, 3)


def _between(own: FloatArray, images: FloatArray) -> FloatArray:
    """(3, 3) the rotation of directions to directions; the least one where they leave a freedom."""
    spread = max(float(np.linalg.norm(np.cross(own[0], v))) for v in own)
    if spread > _PARALLEL:
        return kabsch(own, images, np.ones(len(own)))
    a, b = own[0], images[0]
    axis = np.cross(a, b)
    sine, cosine = float(np.linalg.norm(axis)), float(a @ b)
    if sine < 1e-12:
        # Opposite directions leave the axis open; the bones of such a pair are left as they are.
        return np.eye(3)
    return exp_so3(axis / sine * np.arctan2(sine, cosine))


def _reflection(normal: FloatArray) -> FloatArray:
    return np.asarray(np.eye(3) - 2 * np.outer(normal, normal))


def _mirror_motion(motion: Motion, plane: Plane, roles: Mapping[str, int] | None) -> Motion:
    roles = find_motion_roles(motion).roles if roles is None else roles
    sides = find_sides(motion.skeleton, roles)
    motion = _with_sides_sliding(motion, sides)
    skeleton, partner = motion.skeleton, list(sides.partner)
    images = rest_images(skeleton, sides)
    place, normal = _plane_of_motion(motion, sides, images, plane, body_joint(motion, roles))
    across = _reflection(normal)
    turns = motion.forward()[..., :3, :3]
    turned = across @ turns[:, partner] @ images.reflection @ images.turns
    local = turned.copy()
    for j, parent in enumerate(skeleton.parents):
        if parent >= 0:
            local[:, j] = np.swapaxes(turned[:, parent], 1, 2) @ turned[:, j]
    roots = list(skeleton.roots)
    places = dict(zip(roots, np.moveaxis(roots_of(motion)[0], 1, 0), strict=True))
    moved = {r: (places.get(partner[r], places[r]) - place) @ across + place for r in roots}
    slides = None if motion.translations is None else motion.translations.copy()
    for k, j in enumerate(skeleton.sliding):
        assert slides is not None and motion.translations is not None
        if j in roots:
            slides[:, k] = moved[j]
        else:
            image = motion.translations[:, skeleton.sliding.index(partner[j])] @ images.reflection
            slides[:, k] = image @ images.turns[skeleton.parents[j]]
    return Motion(skeleton, motion.fps, moved[0], continuous_quat(quat_from_matrix(local)), slides)


def _with_sides_sliding(motion: Motion, sides: Sides) -> Motion:
    """The motion with a joint sliding where its counterpart does; one that did not keeps its offset."""
    skeleton = motion.skeleton
    wanted = tuple(sorted({*skeleton.sliding, *(sides.partner[j] for j in skeleton.sliding)} - {0}))
    if motion.translations is None or wanted == skeleton.sliding:
        return motion
    slides = np.tile(skeleton.offsets[list(wanted)], (len(motion), 1, 1))
    slides[:, [wanted.index(j) for j in skeleton.sliding]] = motion.translations
    return replace(motion, skeleton=replace(skeleton, sliding=wanted), translations=slides)


def _plane_of_motion(
    motion: Motion, sides: Sides, images: RestImages, plane: Plane, body: int
) -> tuple[FloatArray, FloatArray]:
    """A point of the mirror's plane and its unit normal; the same for the mirror image of the motion."""
    if plane != "start":
        return np.zeros(3), np.eye(3)["xy".index(plane)]
    skeleton = motion.skeleton
    if sides.partner[body] != body:
        body = 0
    world = motion.select(slice(0, _start_frames(motion.fps))).forward()
    fixed = body  # the joint whose place is mirrored exactly: a root, or a joint that slides on one
    while (above := skeleton.parents[fixed]) >= 0 and not (fixed in skeleton.sliding and skeleton.parents[above] < 0):
        fixed = above
    # Half way between the two sides, of which neither is right about the heading.
    half = exp_so3(-0.5 * log_so3(images.turns[body][None])[0])
    across = (world[:, body, :3, :3] @ half @ sides.normal).mean(axis=0)
    return world[0, fixed, :3, 3] * (1, 1, 0), _level(across)


def _start_frames(fps: float) -> int:
    """Frames at the start over which the heading is averaged, since hips turn with each step."""
    return max(1, round(_START * fps))


def _level(across: FloatArray) -> FloatArray:
    """The horizontal unit vector of a direction; x where it has none, as of a body on its side."""
    length = float(np.hypot(across[0], across[1]))
    if length < 0.1 * max(float(np.linalg.norm(across)), 1e-9):
        return np.array([1.0, 0.0, 0.0])
    return np.array([across[0], across[1], 0.0]) / length


def _mirror_points(points: Points3D, plane: Plane) -> Points3D:
    pairs = pair_names(points.landmarks.names)
    if not pairs:
        raise MuybridgeError("no point has a counterpart on another side by its name; the points are "
                             f"{', '.join(points.landmarks.names[:12])}")  # fmt: skip
    partner = list(range(len(points.landmarks)))
    for a, b in pairs.items():
        partner[a], partner[b] = b, a
    place, normal = _plane_of_points(points.points_world, points.fps, pairs) if plane == "start" else (
        np.zeros(3), np.eye(3)["xy".index(plane)])  # fmt: skip
    across = _reflection(normal)
    return replace(
        points,
        points_world=(points.points_world[:, partner] - place) @ across + place,
        covariance_world=across @ points.covariance_world[:, partner] @ across,
        residual_px=points.residual_px[:, :, partner],
        inlier=points.inlier[:, :, partner],
    )


def _plane_of_points(places: FloatArray, fps: float, pairs: dict[int, int]) -> tuple[FloatArray, FloatArray]:
    left, right = places[:, list(pairs)], places[:, list(pairs.values())]
    known = np.asarray(np.isfinite(left).all(axis=-1) & np.isfinite(right).all(axis=-1))
    if not known.any():
        raise MuybridgeError("no pair of left and right points is known in any frame")
    first = int(np.argmax(known.any(axis=1)))
    ways = np.where(known[..., None], left - right, 0.0)[first : first + _start_frames(fps)]
    middle = 0.5 * (left[first, known[first]] + right[first, known[first]]).mean(axis=0)
    return middle * (1, 1, 0), _level(ways.sum(axis=(0, 1)))
