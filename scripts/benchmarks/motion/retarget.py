"""Takes put onto characters: directions of limbs, feet that stand still on their soles, independence, speed.

    python -m scripts.benchmarks.motion.retarget HERO.glb ... [--takes 12] [--recorded TAKE.bvh ...]

Takes are generated, with true contacts (`generated_takes`), recorded ones are read. Directions are compared where
inverse kinematics has no say: arms everywhere, legs without planting. A foot's drift is that of its heel and ball while
they stand, over the ground, against the middle of each contact; the sole's height is that of the foot's lowest vertex.
"""

from __future__ import annotations

import argparse
import time
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from muybridge.arrays import FloatArray
from muybridge.geometry.numerics.rotations import matrix_from_quat
from muybridge.geometry.roles import find_roles
from muybridge.geometry.skeleton.motion import Motion
from muybridge.motion.character import Character, read_character
from muybridge.motion.character.posing import pose_mesh
from muybridge.motion.contacts.footskate import contact_spans
from muybridge.motion.formats.registry import read_file
from muybridge.motion.retargeting import Retargeted, RetargetOptions, retarget
from muybridge.motion.retargeting.rig import SIDES
from scripts.benchmarks.motion.generated_takes import generated_takes
from scripts.benchmarks.motion.inside import vertices_inside

BONES = (("upper_arm", "forearm"), ("forearm", "hand"), ("thigh", "shin"), ("shin", "foot"))
_EVERY_S = 0.5  # between frames in which vertices inside of the body are counted
_CUTS = (1, 3, 7)  # frames that are cut off
_NEAR_M = 0.006  # over the lowest vertex: vertices of the sole


@dataclass(frozen=True, eq=False)
class Score:
    """What one take on one character measures.

    Attributes:
        direction_deg: largest angle between a bone and the source's, where inverse kinematics has no say.
        drift_mm: largest distance of a standing heel or ball from the middle of its contact.
        sole_mm: quantiles 0, 0.05, 0.95 and 1 of the height of the lowest vertex of a foot that stands.
        fps: frames per second of one core.
        moved_mm: the farthest that planting moved an ankle.
        hands_mm: the farthest that a hand was moved.
        inside: mean number of vertices of hands and forearms inside of the body, of a plain copy and of the result.
    """

    direction_deg: float
    drift_mm: float
    sole_mm: tuple[float, ...]
    fps: float
    moved_mm: float
    hands_mm: float
    inside: tuple[float, float]


def score(motion: Motion, roles: dict[str, int], character: Character, target_roles: dict[str, int]) -> Score:
    """Retarget a take, and measure."""
    start = time.process_time()
    done = retarget(motion, roles, character, target_roles)
    seconds = time.process_time() - start
    plain = retarget(motion, roles, character, target_roles, RetargetOptions(plant=False, touch=False))
    wanted = bone_directions(motion, roles)
    worst = 0.0
    for result, parts in ((done, ("arm",)), (plain, ("arm", "thigh", "shin"))):
        for name, have in bone_directions(result.motion, target_roles).items():
            free = result.moved_hands_m[:, SIDES.index(name.split("_")[0])] == 0
            if any(part in name for part in parts) and free.any():
                worst = max(worst, float(angle_deg(have, wanted[name])[free].max()))
    drift, heights = feet_on_floor(character, done, target_roles)
    quantiles = tuple(1e3 * np.quantile(heights, (0, 0.05, 0.95, 1))) if len(heights) else (np.nan,) * 4
    some = np.arange(0, len(motion), max(round(_EVERY_S * motion.fps), 1))
    inside = [vertices_inside(character, target_roles, r.motion, some) for r in (plain, done)]
    return Score(worst, 1e3 * drift, quantiles, len(motion) / seconds, 1e3 * done.moved_feet_m,
                 1e3 * float(done.moved_hands_m.max()), (inside[0], inside[1]))  # fmt: skip


def bone_directions(motion: Motion, roles: dict[str, int]) -> dict[str, FloatArray]:
    """(T, 3) unit directions of the limbs' bones."""
    at, out = motion.joint_positions_world(), {}
    for side in SIDES:
        for part, end in BONES:
            bone = at[:, roles[f"{side}_{end}"]] - at[:, roles[f"{side}_{part}"]]
            out[f"{side}_{part}"] = bone / np.linalg.norm(bone, axis=1, keepdims=True)
    return out


def angle_deg(a: FloatArray, b: FloatArray) -> FloatArray:
    """(T,) degrees between unit vectors."""
    return np.asarray(np.degrees(2 * np.arcsin(np.clip(np.linalg.norm(a - b, axis=-1) / 2, 0, 1))))


def feet_on_floor(character: Character, done: Retargeted, roles: dict[str, int]) -> tuple[float, FloatArray]:
    """The largest drift in metres, and the heights of the lowest vertices of standing feet."""
    frames = done.motion.forward()
    drift, heights = 0.0, [np.zeros(0)]
    for k, side in enumerate(SIDES):
        contact = done.contacts.contact[:, k]
        vertices = _foot_vertices(character, frames, roles, side)
        if not contact.any() or not vertices.shape[1]:
            continue
        heights.append(vertices[contact.any(-1), :, 2].min(axis=1))
        turns = frames[:, roles[f"{side}_foot"]]
        for point, part in enumerate(_sole_parts(character, roles, side)):
            place = (turns[:, :3, :3] @ part) + turns[:, :3, 3]
            for a, b in contact_spans(contact[:, point]):
                drift = max(drift, float(np.linalg.norm((place[a:b] - place[a:b].mean(0))[:, :2], axis=1).max()))
    return drift, np.concatenate(heights)


def _foot_vertices(character: Character, frames: FloatArray, roles: dict[str, int], side: str) -> FloatArray:
    """(T, V, 3) metres of the lower half of a foot's vertices."""
    foot = np.nonzero(character.skeleton.is_ancestor[roles[f"{side}_foot"]])[0]
    out = [np.zeros((len(frames), 0, 3))]
    for mesh in character.meshes:
        share = (mesh.weights * np.isin(mesh.joints, foot)).sum(axis=1)
        chosen = share > 0.5
        if chosen.any():
            part = replace(mesh, positions=mesh.positions[chosen], joints=mesh.joints[chosen],
                           weights=mesh.weights[chosen], morphs=(), morph_weights=np.zeros(0))  # fmt: skip
            out.append(pose_mesh(part, frames))
    return np.concatenate(out, axis=1)


def _sole_parts(character: Character, roles: dict[str, int], side: str) -> tuple[FloatArray, FloatArray]:
    """(3,) places of heel and ball from the ankle at rest: the rear end of the sole, and under the toe's joint."""
    rest = character.rest_motion().forward()[0]
    points = _foot_vertices(character, rest[None], roles, side)[0]
    sole = points[points[:, 2] < points[:, 2].min() + _NEAR_M]
    foot = rest[roles[f"{side}_foot"], :3, 3]
    ball = rest[roles[f"{side}_toe"], :3, 3] if f"{side}_toe" in roles else sole[np.argmin(sole[:, 1])]
    heel = sole[np.argmax(sole[:, 1])]
    return heel * [0, 1, 1] + foot * [1, 0, 0] - foot, ball - foot


def posed_copy(character: Character, roles: dict[str, int], angle_deg: float) -> Character:
    """The same character bound with its arms lowered: its rest is an A-pose if it was a T-pose."""
    skeleton = character.skeleton
    turns = np.tile(np.eye(3), (len(skeleton), 1, 1))
    for side, sign in (("left", 1), ("right", -1)):
        for j in np.nonzero(skeleton.is_ancestor[roles[f"{side}_upper_arm"]])[0]:
            turns[j] = Rotation.from_euler("y", sign * angle_deg, degrees=True).as_matrix()
    offsets = np.array([turns[max(p, 0)] @ o for p, o in zip(skeleton.parents, skeleton.offsets, strict=True)])
    return replace(character, skeleton=replace(skeleton, offsets=offsets), meshes=())


def pose_difference_deg(character: Character, motion: Motion, roles: dict[str, int], other: dict[str, int]) -> float:
    """The largest angle between a T-pose and an A-pose copy of a character in one take, of all joints in the world."""
    results = []
    for angle in (0.0, 45.0):
        copy = posed_copy(character, other, angle)
        done = retarget(motion, roles, copy, other, RetargetOptions(plant=False, touch=False))
        turns = done.motion.forward()[..., :3, :3]
        back = np.tile(np.eye(3), (len(copy.skeleton), 1, 1))
        for side, sign in (("left", 1), ("right", -1)):
            for j in np.nonzero(copy.skeleton.is_ancestor[other[f"{side}_upper_arm"]])[0]:
                back[j] = Rotation.from_euler("y", sign * angle, degrees=True).as_matrix()
        results.append(turns @ back)
    gap = np.swapaxes(results[0], -1, -2) @ results[1]
    return float(np.degrees(np.linalg.norm(Rotation.from_matrix(gap.reshape(-1, 3, 3)).as_rotvec(), axis=1).max()))


def first_frame_difference_deg(
    character: Character, motion: Motion, roles: dict[str, int], other: dict[str, int]
) -> float:
    """The largest change of a joint's rotation where a take's first frame is its rest pose, 0.5 s and more after it."""
    strange = motion.quat_wxyz.copy()
    strange[0] = [1, 0, 0, 0]
    turns = [matrix_from_quat(retarget(m, roles, character, other).motion.quat_wxyz)
             for m in (motion, replace(motion, quat_wxyz=strange))]  # fmt: skip
    late = round(0.5 * motion.fps)
    gap = np.swapaxes(turns[0][late:], -1, -2) @ turns[1][late:]
    return float(np.degrees(np.linalg.norm(Rotation.from_matrix(gap.reshape(-1, 3, 3)).as_rotvec(), axis=1).max()))


def cut_difference_deg(
    character: Character, motion: Motion, roles: dict[str, int], other: dict[str, int], cut: int
) -> float:
    """The largest change of a joint's rotation, from 1 s on, where a take lacks some frames at its start."""
    whole, rest = (retarget(m, roles, character, other).motion for m in (motion, motion.select(slice(cut, None))))
    late = round(motion.fps)
    turns = [matrix_from_quat(q) for q in (whole.quat_wxyz[cut + late :], rest.quat_wxyz[late:])]
    gap = np.swapaxes(turns[0], -1, -2) @ turns[1]
    return float(np.degrees(np.linalg.norm(Rotation.from_matrix(gap.reshape(-1, 3, 3)).as_rotvec(), axis=1).max()))


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("characters", type=Path, nargs="+")
    parser.add_argument("--takes", type=int, default=12)
    parser.add_argument("--recorded", type=Path, nargs="*", default=[])
    arguments = parser.parse_args()
    takes = [(t.kind, t.motion, t.roles) for t in generated_takes(arguments.takes, seed=50)] if arguments.takes else []
    for path in arguments.recorded:
        motion = read_file(path).motion
        takes.append((path.stem, motion, find_roles(motion.skeleton, positions=motion.joint_positions_world()).roles))
    print(
        "character | take | directions deg | drift mm | sole mm (least, 5 %, 95 %, most) | moved mm | hands mm | "
        "vertices inside, plain and now | frames/s"
    )
    for path in arguments.characters:
        character = read_character(path)
        table = {bone: character.skeleton.names[j] for bone, j in character.humanoid.items()}
        found = find_roles(character.skeleton, table).roles
        cuts, totals = list[float](), np.zeros(2)
        for kind, motion, roles in takes:
            s = score(motion, roles, character, found)
            soles = ", ".join(f"{v:.1f}" for v in s.sole_mm)
            print(f"{path.stem} | {kind} | {s.direction_deg:.2f} | {s.drift_mm:.1f} | {soles} | {s.moved_mm:.0f} | "
                  f"{s.hands_mm:.0f} | {s.inside[0]:.1f}, {s.inside[1]:.1f} | {s.fps:.0f}", flush=True)  # fmt: skip
            cuts.extend(cut_difference_deg(character, motion, roles, found, k) for k in _CUTS)
            totals += s.inside
        kind, motion, roles = takes[0]
        pose = pose_difference_deg(character, motion, roles, found)
        first = first_frame_difference_deg(character, motion, roles, found)
        print(f"{path.stem} | A-pose against T-pose: {pose:.3f} deg, another first frame: {first:.3f} deg, "
              f"cut takes: {np.mean(np.array(cuts) < 0.1):.0%} within 0.1 deg, median {np.median(cuts):.3f}, "
              f"worst {max(cuts):.2f} deg; vertices inside: {totals[1] / max(totals[0], 1e-9):.2f} of a plain copy's",
              flush=True)  # fmt: skip


if __name__ == "__main__":
    main()
