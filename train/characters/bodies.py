"""Examples for the network that finds joints: points of generated characters' surfaces with their joints, on disk."""

import pathlib
from collections.abc import Mapping

import numpy as np

from muybridge.arrays import Float32Array, FloatArray
from muybridge.files import replacing
from muybridge.motion.character.rigging.placement.people import SPINE
from muybridge.motion.character.rigging.points import surface_points
from muybridge.motion.character.rigging.templates import TEMPLATES
from muybridge.train.characters.figures import Figure, FigureSampler
from muybridge.train.characters.rigs import decimated, with_prop
from muybridge.train.synthesis.motions.rig import BONE_OF_ROLE

PER_SHARD, POINTS = 64, 4096
ROLES = TEMPLATES["human"].roles
_CARTOON, _COARSE, _HOLDING = 0.6, 0.3, 0.3  # shares of the bodies
_TRUNK = ("root", "spine05", "spine04", "spine03", "spine02", "spine01", "neck01")


def joints_of(figure: Figure) -> dict[str, FloatArray]:
    """Role -> (3,) metres of the template's joints; those of the trunk at shares of the way from the hips to the
    neck."""
    at: Mapping[str, FloatArray] = dict(zip(figure.names, figure.joints, strict=True))
    out = {role: at[bone] for role, bone in BONE_OF_ROLE.items()}
    for side, letter in (("left", "L"), ("right", "R")):
        out[f"{side}_clavicle"] = at[f"clavicle.{letter}"]
    out["hips"] = (out["left_thigh"] + out["right_thigh"]) / 2
    trunk = np.stack([at[bone] for bone in _TRUNK])
    along = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(trunk, axis=0), axis=1))])
    for role, share in SPINE:
        out[role] = np.array([np.interp(share * along[-1], along, trunk[:, k]) for k in range(3)])
    return {role: out[role] for role in ROLES}


def draw_body(sampler: FigureSampler) -> tuple[Float32Array, Float32Array]:
    """(POINTS, 6) points of a character, and (J, 3) its joints, metres."""
    rng = sampler.rng
    figure = sampler.sample(_CARTOON)
    joints = np.stack(list(joints_of(figure).values())).astype(np.float32)
    if rng.random() < _HOLDING:
        for _ in range(rng.integers(1, 4)):
            figure = with_prop(figure, rng)
    if rng.random() < _COARSE:
        figure = decimated(figure, int(np.exp(rng.uniform(np.log(300), np.log(3000)))))
    return surface_points(figure.vertices, figure.triangles, POINTS, rng), joints


def make_body_shard(folder: pathlib.Path, seed: int, shard: int) -> None:
    """Write a shard of bodies."""
    sampler = FigureSampler(int(np.random.SeedSequence([seed, 77, shard]).generate_state(1)[0]))
    drawn = [draw_body(sampler) for _ in range(PER_SHARD)]
    folder.mkdir(parents=True, exist_ok=True)
    with replacing(folder / f"{shard:05}.npz") as temporary, open(temporary, "wb") as file:
        np.savez(file, points=np.stack([p for p, _ in drawn]).astype(np.float16),
                 joints=np.stack([j for _, j in drawn]))  # fmt: skip


def load_bodies(folder: pathlib.Path, shards: range) -> tuple[np.ndarray, np.ndarray]:
    """(N, POINTS, 6) points and (N, J, 3) joints of those shards that exist."""
    points, joints = [np.zeros((0, POINTS, 6), np.float16)], [np.zeros((0, len(ROLES), 3), np.float32)]
    for shard in shards:
        path = folder / f"{shard:05}.npz"
        if not path.exists():
            break
        with np.load(path) as arrays:
            points.append(arrays["points"])
            joints.append(arrays["joints"])
    return np.concatenate(points), np.concatenate(joints)
