"""How often the right camera is named, over many rigs, takes and faults.

    python -m scripts.benchmarks.geometry.diagnosis --seeds 20 --data ../shared/data

Each seed draws a room: 4 to 8 cameras (3 with --fewest 3) around it at 3.5 to 6 m, 1 to 2.6 m high, of different
focal lengths, looking at its middle with some error; and a person of 1.55 to 1.95 m who wanders about, turns and
swings the limbs for 80 to 240 frames at 30 to 60 frames a second. A camera's 2D landmarks have an error that stays
for each landmark (2 to 4 px), one that drifts over ten frames (2 px) and one of each frame (1.5 to 3 px), 3 % are off
by 60 px more, 8 % and a stretch of each camera are missing. Then one camera is put wrong:

- turned: by 1 degree about a random axis;
- shifted: its file by 3 frames, early or late;
- focal: 3 % too long or too short;
- swapped: its file exchanged with that of another;
- healthy: nothing, to see whether anybody is blamed.

`named` counts reports whose first fault blames exactly the right camera (both of exchanged ones) and which lead the
ranking; `only` those that blame nobody else besides; `kind` those that say what is wrong with it.

With --data the same faults go into the calibration of `triangulation_case.npz` (a real rig with made landmarks; its
cameras are the truth) and, for every camera in turn, into the balancing take's cameras refined from the person first.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from muybridge.arrays import FloatArray
from muybridge.geometry.calibration import load_calibration
from muybridge.geometry.calibration.diagnosis.faults import diagnose
from muybridge.geometry.calibration.diagnosis.hypotheses import perturb_camera
from muybridge.geometry.calibration.people.calibrate import refine_people
from muybridge.geometry.cameras.camera import Camera
from muybridge.geometry.cameras.group import CameraGroup
from muybridge.geometry.cameras.video_size import fit_to_video
from tests.rigs import look_at

Take = tuple[CameraGroup, FloatArray, FloatArray]
KINDS = ("turned", "shifted", "focal", "swapped", "healthy")
SIZE = (1920, 1080)
# Half a standing person of 1.75 m: x to the side, y forwards, z up.
_HALF = np.array([(0.07, 0.0, 1.63), (0.18, 0, 1.45), (0.22, 0.02, 1.18), (0.24, 0.1, 0.95), (0.10, 0, 0.95),
                  (0.11, 0.03, 0.52), (0.11, -0.03, 0.09), (0.13, 0.16, 0.03), (0.11, -0.09, 0.03)])  # fmt: skip
BODY = np.concatenate([_HALF, _HALF * [-1, 1, 1]])


def room(count: int, rng: np.random.Generator) -> CameraGroup:
    """Cameras of different lenses around a room."""
    cameras = []
    for k in range(count):
        angle = 2 * np.pi * (k + rng.uniform(-0.3, 0.3)) / count
        distance = rng.uniform(3.5, 6.0)
        center = np.array([distance * np.cos(angle), distance * np.sin(angle), rng.uniform(1.0, 2.6)])
        pose = look_at(center, np.array([0, 0, 0.9]) + rng.normal(0, 0.15, 3))
        focal = rng.uniform(0.17, 0.25) * distance * SIZE[0]
        middle = (np.array(SIZE) - 1) / 2 + rng.normal(0, 10, 2)
        terms = (focal, focal, *middle, -0.08, 0.02, 0.0, 0.0)
        cameras.append(Camera(f"cam{k + 1}", "OPENCV", *SIZE, terms, pose))
    return CameraGroup(tuple(cameras))


def person(times: FloatArray, rng: np.random.Generator) -> FloatArray:
    """(T, 18, 3) somebody who wanders about, turns and swings the limbs."""
    pace, swing = rng.uniform(0.1, 0.35), rng.uniform(0.5, 1.1)
    phase = rng.uniform(0, 2 * np.pi, 4)
    along = 2 * np.pi * pace * times
    place = np.stack([1.1 * np.sin(along + phase[0]), 0.9 * np.sin(1.3 * along + phase[1]), 0 * times], axis=-1)
    heading = np.unwrap(np.arctan2(*np.gradient(place[:, :2], axis=0).T))
    limbs = 0.7 * np.sin(2 * np.pi * swing * times + phase[2])
    out = np.empty((len(times), len(BODY), 3))
    for t in range(len(times)):
        posed = BODY.copy()
        for side, sign in ((0, 1.0), (len(_HALF), -1.0)):
            for top, parts, by in ((1, (2, 3), sign), (4, (5, 6, 7, 8), -sign)):
                turn = Rotation.from_euler("x", by * limbs[t]).as_matrix()
                at = posed[side + top]
                for p in parts:
                    posed[side + p] = at + turn @ (posed[side + p] - at)
        out[t] = posed @ Rotation.from_euler("z", -heading[t]).as_matrix().T + place[t]
    return out * rng.uniform(1.55, 1.95) / 1.75


def seen_by(cameras: CameraGroup, world: FloatArray, rng: np.random.Generator) -> tuple[FloatArray, FloatArray]:
    """What a 2D network makes of a person: px and variances."""
    frames, joints = world.shape[:2]
    px = cameras.project(world)
    px += rng.normal(0, rng.uniform(2, 4), (len(cameras), 1, joints, 2))
    px += rng.normal(0, rng.uniform(1.5, 3), px.shape)
    knots = rng.normal(0, 2.0, (len(cameras), frames // 10 + 2, joints, 2))
    at = np.arange(frames) / 10
    share = (at - np.floor(at))[None, :, None, None]
    px += knots[:, at.astype(int)] * (1 - share) + knots[:, at.astype(int) + 1] * share
    wrong = rng.random(px.shape[:-1]) < 0.03
    px[wrong] += rng.normal(0, 60.0, (int(wrong.sum()), 2))
    px[rng.random(px.shape[:-1]) < 0.08] = np.nan
    for c in range(len(cameras)):
        first = int(rng.integers(frames))
        px[c, first : first + frames // 10] = np.nan
    outside = ~((px > 0) & (px < np.array(SIZE))).all(axis=-1)
    px[outside] = np.nan
    return px, np.where(np.isfinite(px[..., 0]), 9.0 * rng.uniform(0.5, 2, px.shape[:-1]), np.nan)


def put_wrong(take: Take, kind: str, c: int, rng: np.random.Generator) -> tuple[Take, set[int]]:
    """The take with a fault in camera c, and the cameras to be blamed."""
    cameras, px, variance = take[0], take[1].copy(), take[2].copy()
    if kind == "healthy":
        return (cameras, px, variance), set()
    if kind == "swapped":
        other = int((c + rng.integers(1, len(cameras))) % len(cameras))
        px[[c, other]], variance[[c, other]] = px[[other, c]], variance[[other, c]]
        return (cameras, px, variance), {c, other}
    if kind == "shifted":
        by = 3 if rng.random() < 0.5 else -3
        for array in (px, variance):
            array[c] = np.roll(array[c], by, axis=0)
            array[c, slice(0, by) if by > 0 else slice(by, None)] = np.nan
        return (cameras, px, variance), {c}
    change = np.zeros(7)
    if kind == "turned":
        axis = rng.normal(size=3)
        change[:3] = np.radians(1.0) * axis / np.linalg.norm(axis)
    else:
        change[6] = np.log(1.03 if rng.random() < 0.5 else 1 / 1.03)
    wrong = perturb_camera(cameras[c], change)
    group = CameraGroup(tuple(wrong if k == c else camera for k, camera in enumerate(cameras)))
    return (group, px, variance), {c}


def judged(take: Take, kind: str, diagnosis: set[int]) -> tuple[bool, bool, bool, str]:
    """Whether the right camera is named, alone, and for the right reason; and what was said."""
    report = diagnose(*take)
    if kind == "healthy":
        quiet = not report.faults
        return quiet, quiet, quiet, report.sentence
    if not report.faults:
        return False, False, False, report.sentence
    first = report.faults[0]
    right = {report.names.index(n) for n in first.cameras} == diagnosis
    right = right and set(report.order[: len(diagnosis)]) == diagnosis
    return right, right and len(report.faults) == 1, right and kind in (first.kind, *first.also), report.sentence


def table(
    name: str, draw: Callable[[int], Take], seeds: int, every_camera: bool, verbose: bool, kinds: Sequence[str] = KINDS
) -> None:
    """Print rates for each kind of fault."""
    began = time.perf_counter()
    print(f"{name}\n  fault     cases  named    only    kind")
    for kind in kinds:
        results = []
        for seed in range(seeds):
            take = draw(seed)
            count = len(take[0])
            for c in range(count) if every_camera and kind != "healthy" else [seed % count]:
                rng = np.random.default_rng([seed, c, KINDS.index(kind)])
                wrong, diagnosis = put_wrong(take, kind, c, rng)
                results.append(judged(wrong, kind, diagnosis))
                if verbose and not (results[-1][0] and results[-1][1]):
                    blame = ", ".join(take[0].names[k] for k in sorted(diagnosis)) or "nobody"
                    print(f"    seed {seed}, {count} cameras, {kind} {blame}: {results[-1][3]}")
        rates = np.mean([r[:3] for r in results], axis=0)
        print(f"  {kind:9} {len(results):4}  {rates[0]:6.1%}  {rates[1]:6.1%}  {rates[2]:6.1%}", flush=True)
    print(f"  {time.perf_counter() - began:.0f} s")


def synthetic(seed: int, fewest: int) -> Take:
    """A room, and what its cameras saw of a person."""
    rng = np.random.default_rng([seed, 77])
    cameras = room(int(rng.integers(fewest, 9)), rng)
    times = np.arange(int(rng.integers(80, 241))) / rng.choice([30.0, 50.0, 60.0])
    return cameras, *seen_by(cameras, person(times, rng), rng)


def made_landmarks(data: Path) -> Take:
    """A real rig with landmarks made for it."""
    case = np.load(data / "triangulation_case.npz")
    cameras = []
    for c, size in enumerate(case["size_px"].astype(int)):
        terms = (*case["camera_matrix"][c][[0, 1, 0, 1], [0, 1, 2, 2]], *case["distortion_k1k2p1p2"][c])
        rotation = Rotation.from_rotvec(case["rotvec_cam_from_world"][c]).as_matrix()
        pose = np.column_stack([rotation, case["translation_cam_from_world"][c]])
        cameras.append(Camera(f"cam{c + 1:02}", "OPENCV", int(size[0]), int(size[1]), terms, pose))
    px = np.asarray(case["points_px"], dtype=np.float64)
    return CameraGroup(tuple(cameras)), px, np.where(np.isfinite(px[..., 0]), 9.0, np.nan)


def balancing(data: Path) -> tuple[Take, list[str]]:
    """The balancing take's 2D by OpenPose, with Qualisys' cameras; and the landmarks' names."""
    folder = data / "balancing"
    stored = np.load(folder / "reference" / "openpose_body25b.npz")
    score = stored["keypoints2d_px"][..., 2]
    px = np.where((score > 0.3)[..., None], stored["keypoints2d_px"][..., :2], np.nan).astype(np.float64)
    variance = np.where(score > 0.3, 1 / np.maximum(score, 0.3) ** 2, np.nan)
    cameras = load_calibration(folder / "calibration" / "Calib.qca.txt")
    fitted = [fit_to_video(c, 1080, 1920, "letterbox")[0] if k < 2 else c for k, c in enumerate(cameras)]
    return (CameraGroup(tuple(fitted)), px, variance), [str(n) for n in stored["names"]]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seeds", type=int, default=20)
    parser.add_argument("--fewest", type=int, default=4)
    parser.add_argument("--data", type=Path)
    parser.add_argument("--kinds", nargs="+", choices=KINDS, default=KINDS)
    parser.add_argument("--verbose", action="store_true")
    args = parser.parse_args()
    if args.data is not None:
        take, names = balancing(args.data)
        refined = refine_people(*take, names).cameras
        table("balancing, cameras refined from the person", lambda _: (refined, *take[1:]), 1, True, args.verbose)
        case = made_landmarks(args.data)
        every = case[1].shape[1] // 10

        def part(seed: int) -> Take:
            cut = slice(seed * every, (seed + 1) * every)
            return case[0], case[1][:, cut], case[2][:, cut]

        table("triangulation_case.npz, a tenth each", part, 2, True, args.verbose)
    if args.seeds:
        table("synthetic rooms", lambda seed: synthetic(seed, args.fewest), args.seeds, False, args.verbose, args.kinds)


if __name__ == "__main__":
    main()
