"""Bodies on the floor: the bearing parts lie on it, and free limbs sink onto it or stay above it."""

from dataclasses import dataclass

import numpy as np
from scipy.ndimage import gaussian_filter1d

from muybridge.arrays import BoolArray, FloatArray
from muybridge.train.synthesis.motions.rig import SIDES, SkinnedBody, apply, forward, skin, turn, unit

UP = np.array([0.0, 0.0, 1.0])
TRUNK_BONES = ("root", "pelvis", "spine", "breast", "clavicle")
KNEE_BONES = ("upperleg02", "lowerleg01")
_HIGHEST, _LOWEST = 115, 60  # degrees that a limb may be swung up, and down
_SOFT = 0.08  # s, how smooth the swings are over time


@dataclass(frozen=True)
class _Limb:
    """What swings as one: `pivot` bone, bones of the skin to keep out of the floor, and where it ends."""

    pivot: str
    bones: tuple[str, ...]
    end: str
    lowest: int = _LOWEST


def _limbs(side: str) -> dict[str, _Limb]:
    arm = tuple(f"{b}.{side}" for b in ("upperarm02", "lowerarm01", "lowerarm02", "wrist"))
    hand = tuple(f"finger{f}-{j}.{side}" for f in range(1, 6) for j in range(1, 4))
    palm = tuple(f"metacarpal{f}.{side}" for f in range(1, 5))
    leg = tuple(f"{b}.{side}" for b in ("upperleg02", "lowerleg01", "lowerleg02", "foot"))
    toes = tuple(f"toe{t}-{j}.{side}" for t in range(1, 6) for j in range(1, 4))
    return {
        "arm": _Limb(f"upperarm01.{side}", arm + hand + palm, f"wrist.{side}"),
        "leg": _Limb(f"upperleg01.{side}", leg + toes, f"foot.{side}"),
        "shank": _Limb(f"lowerleg01.{side}", leg[2:] + toes, f"foot.{side}"),
    }


def chosen_skin(skeleton: SkinnedBody, bones: tuple[str, ...]) -> BoolArray:
    """(P,) points of the skin that a bone whose name begins with one of `bones` moves the most."""
    return np.array([name.startswith(bones) for name in skeleton.bones])[skeleton.strongest]


def sink_limbs(skeleton: SkinnedBody, local: FloatArray, root: FloatArray, step: float, sink: dict[str, FloatArray],
               free: dict[str, FloatArray]) -> FloatArray:  # fmt: skip
    """Swing arms, legs and head about their joints, out of the floor z = 0 and down onto it.

    Args:
        skeleton: of the body.
        local: (T, bones, 3, 3) local rotations; root: (T, 3) metres.
        step: seconds between frames.
        sink: (T,) share of its height over the floor by which a limb sinks, by `armL`, `legR`, `shankR`, `head` ....
        free: (T,) how far a limb may be swung at all, 0 to 1, by the same names.

    Returns:
        (T, bones, 3, 3) local rotations.
    """
    local = local.copy()
    limbs = {name + s: limb for s, _ in SIDES for name, limb in _limbs(s).items()}
    limbs["head"] = _Limb("neck01", ("neck03", "head", "eye"), "head", 25)
    for name, limb in limbs.items():
        if not free[name].any():
            continue
        rotations, at = forward(skeleton, local, root)
        i = skeleton.index(limb.pivot)
        points = skin(skeleton, rotations, at, chosen_skin(skeleton, limb.bones)) - at[:, None, i]
        along = _level(at[:, skeleton.index(limb.end)] - at[:, i])
        headward = _level(at[:, skeleton.index("neck01")] - at[:, 0])
        along = unit(along + (0.1 if name[:3] in ("arm", "hea") else -0.1) * headward)
        angle = _swing(points, at[:, i, 2], along, sink[name], limb.lowest) * free[name]
        angle = gaussian_filter1d(angle, _SOFT / step, mode="nearest")
        swung = turn(np.cross(along, UP) * angle[:, None])
        above = rotations[:, skeleton.parents[i]]
        local[:, i] = np.swapaxes(above, -1, -2) @ swung @ above @ local[:, i]
    return local


def _level(vectors: FloatArray) -> FloatArray:
    return vectors * [1.0, 1.0, 0.0]


def _swing(points: FloatArray, height: FloatArray, along: FloatArray, sink: FloatArray, lowest: int) -> FloatArray:
    """(T,) radians by which a limb is swung up, of its `points` (T, P, 3) from a joint `height` (T,) over the floor,
    that reaches out `along` (T, 3)."""
    out, up = (points * along[:, None]).sum(-1), points[..., 2]
    degrees = np.radians(np.arange(-lowest, _HIGHEST + 1))
    low = np.stack([(out * np.sin(a) + up * np.cos(a)).min(1) + height for a in degrees], -1)
    now = low[:, lowest]
    target = np.where(now > 0, now * (1 - sink), 0.0)
    clear = low >= target[:, None] - 1e-6
    raised = np.where(clear[:, lowest:].any(1), clear[:, lowest:].argmax(1), low[:, lowest:].argmax(1))
    lowered = np.cumprod(clear[:, lowest::-1], axis=1).sum(1) - 1
    return np.asarray(np.radians(np.where(clear[:, lowest], -lowered, raised).astype(float)))


def flat_hand(skeleton: SkinnedBody, side: str) -> tuple[FloatArray, float]:
    """Rotation (3, 3) of a hand that lies on the floor, palm down, fingers towards -y, and how high its wrist is then,
    metres, the thumb out of the way."""
    wrist = skeleton.at("wrist." + side)
    ahead = unit(skeleton.at("finger3-1." + side) - wrist)
    across = skeleton.at("finger2-1." + side) - skeleton.at("finger5-1." + side)
    rest = np.stack([ahead, unit(across - ahead * (across @ ahead))], -1)
    rest = np.column_stack([rest, np.cross(rest[:, 0], rest[:, 1])])
    inward = np.array([-1.0 if side == "L" else 1.0, 0.0, 0.0])  # where the thumb is
    flat = np.stack([np.array([0.0, -1.0, 0.0]), inward], -1)
    flat = np.column_stack([flat, np.cross(flat[:, 0], flat[:, 1])])
    rotation = flat @ rest.T
    hand = [b for b in _limbs(side)["arm"].bones if b.startswith(("wrist", "finger", "metacarpal")) and b[6:8] != "1-"]
    mine = chosen_skin(skeleton, tuple(hand))
    low = apply(rotation, skeleton.surface[mine] - wrist)[:, 2].min()
    return rotation, float(-low)
