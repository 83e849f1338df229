"""Short takes of people, as a 2D network sees them: seeded cameras, motions and errors, without pictures.

The errors follow those of the networks on real footage, in shares of the person's size in the image:

- a bias of each landmark in each view that depends on the side from which the camera sees the person, and a smaller one
  that all landmarks of a view share;
- drifts that are correlated over ten frames, half of them common to a limb, and a smaller one of the whole view;
- heavy-tailed errors of single frames; guesses of hidden landmarks that are far off for 5 to 20 frames;
- left-right flips of a few frames, missing landmarks, missing stretches;
- standard deviations that the network misjudges by a factor of its own in each camera.

A calibration without a fault still has the errors of a good one: 0.05 degrees, 3 mm, 0.1 % of the focal length, and
videos that start within a sixth of a frame.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial.transform import Rotation

from muybridge.arrays import FloatArray
from muybridge.geometry.calibration.diagnosis.hypotheses import perturb_camera
from muybridge.geometry.cameras.camera import Camera
from muybridge.geometry.cameras.group import CameraGroup
from muybridge.geometry.landmarks.arrays import Keypoints2D
from muybridge.geometry.landmarks.sets import BODY23
from muybridge.geometry.numerics.robust import extent
from scripts.benchmarks.common import correlated_noise
from tests.rigs import look_at

ACTIVITIES = ("still", "walking", "seated", "exercise")
# A standing person who faces +Y, metres; the subject's left is -X.
_LEFT = {
    "eye": (-0.03, 0.10, 1.66), "ear": (-0.07, 0.0, 1.64), "shoulder": (-0.18, 0.0, 1.42),
    "elbow": (-0.24, -0.03, 1.13), "wrist": (-0.26, 0.05, 0.88),
    "hip": (-0.09, 0.0, 0.93), "knee": (-0.10, 0.02, 0.51), "ankle": (-0.10, -0.02, 0.09),
    "big_toe": (-0.11, 0.16, 0.03), "small_toe": (-0.16, 0.12, 0.03), "heel": (-0.10, -0.06, 0.04),
}  # fmt: skip
_LIMBS = {"arm": ("elbow", "wrist"), "fore": ("wrist",), "leg": ("knee", "ankle", "big_toe", "small_toe", "heel"),
          "shank": ("ankle", "big_toe", "small_toe", "heel")}  # fmt: skip
_PIVOT = {"arm": "shoulder", "fore": "elbow", "leg": "hip", "shank": "knee"}


@dataclass(frozen=True)
class ShortTake:
    """A simulated take.

    Attributes:
        cameras: C cameras as the calibration has them.
        keypoints: everyone's landmarks.
        fps: frames per second.
        description: cameras, frames and people in a few words.
    """

    cameras: CameraGroup
    keypoints: Keypoints2D
    fps: float
    description: str


def _rest() -> FloatArray:
    """(23, 3) the standing person."""
    out = []
    for name in BODY23.names:
        side, _, part = name.partition("_")
        at = np.array(_LEFT[part]) if part else np.array((0.0, 0.12, 1.62))
        out.append(at * ([-1, 1, 1] if side == "right" else [1, 1, 1]))
    return np.array(out)


def _swing(body: FloatArray, side: str, limb: str, angle: float, axis: str = "x") -> None:
    """Turn a limb of (23, 3) `body` about its first joint, in place."""
    rows = [BODY23.index(f"{side}_{part}") for part in _LIMBS[limb]]
    pivot = body[BODY23.index(f"{side}_{_PIVOT[limb]}")].copy()
    body[rows] = pivot + (body[rows] - pivot) @ Rotation.from_euler(axis, angle).as_matrix().T


def motion(activity: str, times: FloatArray, middle: float, rng: np.random.Generator) -> FloatArray:
    """(T, 23, 3) metres: a person at `times` (T,) seconds, who passes the origin at `middle` where they walk."""
    phase, pace = rng.uniform(0, 2 * np.pi, 6), rng.uniform(0.7, 1.1)
    heading = rng.uniform(0, 2 * np.pi)
    stature = rng.uniform(1.5, 1.95)
    out = np.empty((len(times), len(BODY23), 3))
    for t, time in enumerate(times):
        body = _rest()
        cycle = 2 * np.pi * pace * time + phase[0]
        for side, sign in (("left", 1.0), ("right", -1.0)):
            if activity == "walking":
                _swing(body, side, "fore", 0.3)
                _swing(body, side, "arm", 0.4 * sign * np.sin(cycle))
                _swing(body, side, "shank", -0.5 * max(np.sin(cycle + (0.6 if sign > 0 else 3.7)), 0.0))
                _swing(body, side, "leg", -0.45 * sign * np.sin(cycle))
            elif activity == "seated":
                _swing(body, side, "fore", 1.1 + 0.3 * np.sin(0.7 * cycle + phase[1] * sign))
                _swing(body, side, "arm", 0.3 + 0.15 * np.sin(0.5 * cycle + phase[2] * sign))
                _swing(body, side, "shank", -1.45)
                _swing(body, side, "leg", 1.45)
            elif activity == "exercise":
                depth = 0.6 * (1 - np.cos(0.5 * cycle)) / 2
                _swing(body, side, "fore", 0.4 + 0.5 * np.sin(0.8 * cycle + phase[1]))
                _swing(body, side, "arm", (0.9 + 0.8 * np.sin(0.8 * cycle)) * sign * 1.2, "y")
                _swing(body, side, "shank", -2 * depth)
                _swing(body, side, "leg", depth)
        if activity == "seated":
            body[:, 2] -= 0.45
        sway = 0.006 * np.array(
            [np.sin(1.7 * time + phase[3]), np.sin(1.3 * time + phase[4]), 0.2 * np.sin(1.5 * time)]
        )
        turn, place = 0.02 * np.sin(0.9 * time + phase[5]), sway
        if activity == "walking":
            place = sway + [0, 1.25 * pace * (time - middle), 0]
        elif activity == "exercise":
            turn = 0.5 * np.sin(0.6 * 2 * np.pi * time + phase[5])
            place = sway + 0.25 * np.array([np.sin(cycle * 0.4), np.cos(cycle * 0.3), 0])
        out[t] = body @ Rotation.from_euler("z", turn).as_matrix().T + place
    out *= stature / 1.75
    return np.asarray(out @ Rotation.from_euler("z", heading).as_matrix().T)


def good_rig(count: int, rng: np.random.Generator) -> CameraGroup:
    """Cameras around a room, or along one side of it, of different lenses."""
    size = (1080, 1920) if rng.random() < 0.3 else (1920, 1080)
    span = 2 * np.pi if rng.random() < 0.6 else rng.uniform(0.35, 0.8) * np.pi
    first = rng.uniform(0, 2 * np.pi)
    cameras = []
    for k in range(count):
        angle = first + span * (k + rng.uniform(-0.25, 0.25)) / (count if span > 6 else max(count - 1, 1))
        distance = rng.uniform(2.8, 5.5)
        center = np.array([distance * np.cos(angle), distance * np.sin(angle), rng.uniform(0.9, 2.6)])
        pose = look_at(center, np.array([0, 0, 0.95]) + rng.normal(0, 0.12, 3))
        focal = rng.uniform(0.24, 0.42) * distance * min(size)
        middle = (np.array(size) - 1) / 2 + rng.normal(0, 8, 2)
        cameras.append(Camera(f"cam{k + 1}", "OPENCV", *size, (focal, focal, *middle, -0.06, 0.02, 0, 0), pose))
    return CameraGroup(tuple(cameras))


def calibrated(truth: CameraGroup, rng: np.random.Generator) -> CameraGroup:
    """The rig as a good calibration has it."""
    errors = rng.normal(size=(len(truth), 7)) * [*(np.radians(0.03),) * 3, *(0.002,) * 3, 0.001]
    return CameraGroup(tuple(perturb_camera(c, e) for c, e in zip(truth, errors, strict=True)))


def view(camera: Camera, world: FloatArray, fps: float, rng: np.random.Generator) -> tuple[FloatArray, FloatArray]:
    """What a network makes of one person in one camera: (T, J, 2) px and (T, J) variances; see the module."""
    frames, joints = world.shape[:2]
    px = camera.project(world)
    size = float(np.nanmedian(extent(px)))
    if not np.isfinite(size):
        return np.full((frames, joints, 2), np.nan), np.full((frames, joints), np.nan)
    across = world[:, BODY23.index("right_hip"), :2] - world[:, BODY23.index("left_hip"), :2]
    aspect = np.arctan2(across[:, 1], across[:, 0]) - np.arctan2(*(camera.center_world[:2] - world[0, 11, :2])[::-1])
    waves = np.stack([np.ones(frames), np.cos(aspect), np.sin(aspect)], axis=-1)
    error = np.einsum("tk,kji->tji", waves, rng.normal(0, 0.005, (3, joints, 2)))
    error += np.einsum("tk,ki->ti", waves, rng.normal(0, 0.0015, (3, 2)))[:, None]
    kept = float(np.exp(-30.0 / (10.0 * fps)))
    limb = np.array(
        [(2 if n.startswith("left") else 1) + 2 * (j > 4) + 2 * (j > 10) for j, n in enumerate(BODY23.names)]
    )
    error += 0.0045 * correlated_noise((frames, joints, 2), kept, rng)
    error += 0.0045 * correlated_noise((frames, limb.max() + 1, 2), kept, rng)[:, limb]
    error += 0.0025 * correlated_noise((frames, 1, 2), kept, rng)
    error += 0.003 * rng.standard_t(3, error.shape)
    hidden = _bursts(frames, joints, 0.004, (5, 20), rng)
    error += np.where(hidden[..., None], rng.normal(0, 0.07, (1, joints, 2)), 0.0)
    sigma = 0.01 * size * np.exp(rng.normal(0, 0.6)) * np.exp(rng.normal(0, 0.4, (frames, joints)))
    sigma = np.where(hidden, sigma * rng.uniform(1, 4), sigma)
    px = px + size * error
    flipped = _bursts(frames, 1, 0.006, (2, 15), rng)[:, 0]
    px[flipped] = px[flipped][:, list(BODY23.mirror)]
    missing = _bursts(frames, joints, 0.006, (3, 15), rng) | _bursts(frames, 1, 0.003, (3, 10), rng)
    missing |= rng.random((frames, joints)) < 0.03
    if rng.random() < 0.2:  # a table in front of the legs, or a narrow view
        missing |= (np.arange(joints) >= (13 if rng.random() < 0.7 else 9))[None]
    outside = ~((px > 0) & (px < [camera.width - 1, camera.height - 1])).all(axis=-1)
    missing |= outside
    px[missing] = np.nan
    return px, np.where(missing, np.nan, sigma**2)


def _bursts(
    frames: int, joints: int, rate: float, lengths: tuple[int, int], rng: np.random.Generator
) -> np.ndarray[tuple[int, int], np.dtype[np.bool_]]:
    """(T, J) stretches that begin with probability `rate` in each frame."""
    out = np.zeros((frames, joints), dtype=bool)
    for t, j in zip(*np.nonzero(rng.random((frames, joints)) < rate), strict=True):
        out[t : t + int(rng.integers(*lengths)), j] = True
    return out


def simulate(
    seed: int,
    frames: int | None = None,
    cameras: int | None = None,
    people: int | None = None,
    activity: str | None = None,
    late: tuple[int, int] | None = None,
) -> ShortTake:
    """A take of a good calibration; what is not given is drawn.

    Args:
        seed: of everything that is drawn.
        frames: 10 to 100 where it is drawn.
        cameras: 2 to 4, sometimes 6.
        people: 1 to 3.
        activity: of `ACTIVITIES`, for everybody; each person has their own where it is drawn.
        late: camera, and by how many frames its video is late.
    """
    rng = np.random.default_rng([seed, 2026])
    drawn = (
        int(rng.integers(10, 101)), int(rng.choice([2, 3, 3, 3, 4, 4, 4, 6])), int(rng.choice([1, 1, 2, 3]))
    )  # fmt: skip
    frames, count, people = frames or drawn[0], cameras or drawn[1], people or drawn[2]
    fps = float(rng.choice([25.0, 30.0, 50.0, 60.0]))
    truth = good_rig(count, rng)
    start = rng.uniform(-1 / 6, 1 / 6, count)
    if late is not None:
        start[late[0]] -= late[1]
    points, variances, what = [], [], []
    for p in range(people):
        doing = activity or str(rng.choice(ACTIVITIES))
        what.append(doing)
        place = np.array([0.0, 0, 0]) if p == 0 else np.array([*rng.uniform(-1.3, 1.3, 2), 0.0])
        state = int(rng.integers(2**31))
        views = []
        for c in range(count):
            times = (np.arange(frames) + start[c]) / fps
            world = motion(doing, times, frames / 2 / fps, np.random.default_rng(state)) + place
            views.append(view(truth[c], world, fps, rng))
        points.append(np.stack([v[0] for v in views]))
        variances.append(np.stack([v[1] for v in views]))
    px, variance = np.stack(points, axis=2), np.stack(variances, axis=2)
    for c in range(count):  # slots are unrelated between cameras
        order = rng.permutation(people)
        px[c], variance[c] = px[c][:, order], variance[c][:, order]
    score = np.where(np.isfinite(variance), 0.8, 0.0)
    described = f"{count} cameras, {frames} frames, {people} people ({', '.join(what)})"
    return ShortTake(calibrated(truth, rng), Keypoints2D(BODY23, px, variance, score), fps, described)


def with_fault(take: ShortTake, kind: str, c: int, size: float, rng: np.random.Generator) -> ShortTake:
    """The take with a fault in the calibration or the files of camera `c`; a late video is made by `simulate`.

    Args:
        take: a good take.
        kind: "turned" (degrees), "moved" (metres), "focal" (share), or "swapped" with the next camera.
        c: the camera.
        size: of the fault.
        rng: directions are drawn from it.
    """
    if kind == "swapped":
        order = list(range(len(take.cameras)))
        other = (c + 1) % len(order)
        order[c], order[other] = other, c
        kept = take.keypoints
        return replace(take, keypoints=Keypoints2D(
            kept.landmarks, kept.points_px[order], kept.variance_px2[order], kept.score[order]
        ))  # fmt: skip
    change, axis = np.zeros(7), rng.normal(size=3)
    axis /= np.linalg.norm(axis)
    if kind == "turned":
        change[:3] = np.radians(size) * axis
    elif kind == "moved":
        change[3:6] = size * axis
    else:
        change[6] = np.log1p(size if rng.random() < 0.5 else -size)
    wrong = perturb_camera(take.cameras[c], change)
    return replace(take, cameras=CameraGroup(tuple(wrong if k == c else o for k, o in enumerate(take.cameras))))
