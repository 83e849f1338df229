"""Calibration and synchronisation, measured: boards, lenses, people, made rigs, clocks.

    python -m scripts.benchmarks.geometry.calibration board lenses people rigs sync --data ../shared/data

- board: four webcams that recorded a ChArUco board, by `muybridge calibrate board` as a user runs it: all frames, then
  both halves of the moments (odd and even, first and second) as folders of images; how far the distances between
  cameras differ.
- lenses: the balancing take's checkerboards, against the focal lengths that Qualisys gave.
- people: the balancing take's 2D by OpenPose. From nothing but Qualisys' lenses; with focal lengths unknown; refined
  from Qualisys' poses on one half of the frames and tried on the other.
- rigs: made rigs of 4 to 12 cameras with noise, wrong and missing points, adjusted from a start that is off: position
  errors over the Cramer-Rao bound (from the Jacobian at the truth), and how long the adjustment takes.
- sync: the balancing take and made takes cut apart by known offsets, and sound with a known offset and drift.

Everything is drawn from fixed seeds: two runs give the same figures, but for times.
"""

from __future__ import annotations

import argparse
import contextlib
import csv
import io
import re
import tempfile
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
from scipy.spatial.transform import Rotation

from muybridge.arrays import FloatArray, IndexArray
from muybridge.geometry.calibration import load_calibration
from muybridge.geometry.calibration.bundle_adjustment.adjustment import AdjustProblem, FreeCamera, adjust
from muybridge.geometry.calibration.people.calibrate import PeopleCalibrationOptions, calibrate_people, refine_people
from muybridge.geometry.cameras.camera import Camera
from muybridge.geometry.cameras.group import CameraGroup
from muybridge.geometry.numerics.rotations import exp_so3
from muybridge.geometry.sync.audio import audio_clock
from muybridge.geometry.sync.clocks import Clock
from muybridge.geometry.sync.epipolar import epipolar_clocks
from muybridge.geometry.sync.motion import motion_clocks
from muybridge.geometry.triangulation.multiview import triangulate
from muybridge.geometry.triangulation.validation import leave_one_out_error
from muybridge.infer.commands.app import run_command
from scripts.benchmarks.geometry.diagnosis import balancing
from tests.rigs import look_at

_RIGS = 4
CHECKERS = ("--board", "checkerboard", "--columns", "4", "--rows", "7", "--square", "0.06")


def command(*arguments: object) -> str:
    """What a command prints.

    Raises:
        RuntimeError: it failed.
    """
    printed = io.StringIO()
    with contextlib.redirect_stdout(printed):
        code = run_command([str(a) for a in arguments])
    if code:
        raise RuntimeError(f"muybridge {' '.join(map(str, arguments))}: exit code {code}")
    return printed.getvalue()


def distances(cameras: CameraGroup) -> FloatArray:
    """(C (C - 1) / 2,) between camera centres, metres."""
    centers = cameras.centers_world
    return np.linalg.norm(centers[:, None] - centers, axis=-1)[np.triu_indices(len(centers), 1)]


def images_of(data: Path, folder: Path, chosen: Callable[[int], bool]) -> None:
    """The videos' frames of some moments as folders of images, named by the moment."""
    rows: dict[str, list[tuple[float, int]]] = {}
    with (data / "timestamps.csv").open(newline="") as file:
        for row in csv.DictReader(file):
            rows.setdefault(row["cam_id"], []).append((float(row["frame_time"]), int(row["sync_index"])))
    for camera, stamps in rows.items():
        video = cv2.VideoCapture(str(data / f"cam_{camera}.mp4"))
        (folder / f"cam_{camera}").mkdir(parents=True)
        for _, moment in sorted(stamps):
            image = video.read()[1]
            if chosen(moment):
                cv2.imwrite(str(folder / f"cam_{camera}" / f"{moment:04}.png"), image)


def board(data: Path) -> None:
    """Four webcams that recorded a board."""
    folder = data / "charuco"
    flags = ("--board-file", folder / "charuco.toml", "--quiet")
    with tempfile.TemporaryDirectory() as scratch:
        out = Path(scratch) / "all.toml"
        print(command("calibrate", "board", folder, *flags, "--out", out).replace(scratch, "."))
        moments = sorted({int(r["sync_index"]) for r in csv.DictReader((folder / "timestamps.csv").open(newline=""))})
        middle = moments[len(moments) // 2]
        splits: dict[str, Callable[[int], bool]] = {
            "odd": lambda m: m % 2 == 1, "even": lambda m: m % 2 == 0,
            "first": lambda m: m < middle, "second": lambda m: m >= middle,
        }  # fmt: skip
        found = {}
        for name, chosen in splits.items():
            images_of(folder, Path(scratch) / name, chosen)
            file = Path(scratch) / f"{name}.toml"
            report = command("calibrate", "board", Path(scratch) / name, *flags, "--out", file)
            median = re.search(r"median reprojection error ([\d.]+)", report)
            found[name] = distances(load_calibration(file))
            print(f"{name:7} median {median[1] if median else '?'} px, distances {np.round(found[name], 4)} m")
        whole = distances(load_calibration(out))
    for a, b in (("odd", "even"), ("first", "second")):
        print(
            f"{a} and {b}: distances differ by at most {np.abs(found[a] / found[b] - 1).max():.2%}; from those of all "
            f"frames by {max(np.abs(found[k] / whole - 1).max() for k in (a, b)):.2%}"
        )


def lenses(data: Path) -> None:
    """Lenses from checkerboards."""
    folder = data / "balancing" / "calibration"
    with tempfile.TemporaryDirectory() as scratch:
        out = Path(scratch) / "lenses.toml"
        flags = (*CHECKERS, "--lenses-only", "--quiet", "--out", out)
        print(command("calibrate", "board", folder / "intrinsics", *flags))
        found = load_calibration(out)
    for ours, theirs in zip(found, load_calibration(folder / "Calib.qca.txt"), strict=True):
        off = np.array(ours.params[:2]) / theirs.params[:2] - 1
        print(f"{theirs.name}: focal lengths {off[0]:+.2%} and {off[1]:+.2%} from Qualisys'")


def apart(a: CameraGroup, b: CameraGroup) -> tuple[FloatArray, FloatArray, float]:
    """(C,) degrees and (C,) metres between rigs after the best similarity, and degrees between pairs of cameras."""
    turn = Rotation.from_matrix(np.stack([y.rotation.T @ x.rotation for x, y in zip(a, b, strict=True)])).mean()
    one, two = a.centers_world - a.centers_world.mean(0), b.centers_world - b.centers_world.mean(0)
    moved = turn.apply(one)
    scale = (moved * two).sum() / (moved**2).sum()
    rest = [Rotation.from_matrix(y.rotation.T @ x.rotation) * turn.inv() for x, y in zip(a, b, strict=True)]
    pairs = [
        Rotation.from_matrix((b[i].rotation @ b[j].rotation.T).T @ a[i].rotation @ a[j].rotation.T).magnitude()
        for i in range(len(a))
        for j in range(i)
    ]
    degrees = np.array([np.degrees(r.magnitude()) for r in rest])
    return degrees, np.linalg.norm(scale * moved - two, axis=1), float(np.degrees(max(pairs)))


def people(data: Path) -> None:
    """Cameras from a person."""
    (cameras, px, variance), names = balancing(data)
    blank = CameraGroup(tuple(c.posed(np.eye(3, 4)) for c in cameras))
    wide = CameraGroup(tuple(
        replace(c, params=(1.1 * c.params[0], 1.1 * c.params[1], *c.params[2:])) for c in blank
    ))  # fmt: skip
    whole, both = {"all frames": slice(None)}, {"first half": slice(0, 50), "second half": slice(50, 100)}
    for name, start, options, parts in (
        ("from Qualisys' lenses", blank, PeopleCalibrationOptions(), whole | both),
        ("the same, known to 10 %", blank, PeopleCalibrationOptions(focal_sigma=0.1), whole),
        ("10 % too long, known to 10 %", wide, PeopleCalibrationOptions(focal_sigma=0.1), whole),
    ):
        for part, rows in parts.items():
            began = time.perf_counter()
            found = calibrate_people(start, px[:, rows], variance[:, rows], names, options)
            took = time.perf_counter() - began
            degrees, metres, pairs = apart(found.cameras, cameras)
            focal = [f.params[0] / c.params[0] - 1 for f, c in zip(found.cameras, cameras, strict=True)]
            print(
                f"{name}, {part}: rotations {degrees.max():.2f} deg (between cameras {pairs:.2f}), centres "
                f"{metres.max():.3f} m, focal lengths {min(focal):+.1%} to {max(focal):+.1%}; {took:.1f} s"
            )
    halves = {"first": slice(0, 50), "second": slice(50, 100)}
    refined = {k: refine_people(cameras, px[:, h], variance[:, h], names) for k, h in halves.items()}
    for fitted, tried in (("first", "second"), ("second", "first")):
        rows = halves[tried]
        for who, rig in (("Qualisys'", cameras), (f"refined on the {fitted} half", refined[fitted].cameras)):
            error = np.nanmedian(triangulate(rig, px[:, rows], variance[:, rows]).residual_px)
            out = np.nanmedian(leave_one_out_error(rig, px[:, rows], variance[:, rows]))
            print(f"{tried} half, {who}: median reprojection {error:.2f} px, leave-one-camera-out {out:.2f} px")
    degrees, metres, _ = apart(refined["first"].cameras, refined["second"].cameras)
    sd_deg = np.sqrt(sum((r.rotation_sd_deg**2).sum(axis=1) for r in refined.values()))
    sd = np.sqrt(sum((r.center_sd**2).sum(axis=1) for r in refined.values()))
    print(f"halves apart over the standard deviation: rotations {np.round(degrees / sd_deg, 2)}, "
          f"centres {np.round(metres / sd, 2)}")  # fmt: skip


def ring(count: int, rng: np.random.Generator) -> CameraGroup:
    """Cameras around a room of 8 m."""
    cameras = []
    for k in range(count):
        angle = 2 * np.pi * k / count + rng.uniform(-0.1, 0.1)
        center = np.array([4 * np.cos(angle), 4 * np.sin(angle), rng.uniform(1.0, 2.8)])
        terms = (1300.0 + 30 * k, 1300.0 + 30 * k, 960.0, 540.0, -0.08, 0.02, 0.0005, -0.0005)
        cameras.append(Camera(f"c{k}", "OPENCV", 1920, 1080, terms, look_at(center, (0, 0, 1))))
    return CameraGroup(tuple(cameras))


def bound(problem: AdjustProblem, truth: CameraGroup, points: FloatArray) -> FloatArray:
    """(C,) Cramer-Rao bound on each free camera's position, from the Jacobian by differences, good points only."""
    step, free = 1e-6, [c for c, f in enumerate(problem.free) if f.pose]
    size = 7  # turn, shift, focal
    hgg = np.zeros((len(truth) * size, len(truth) * size))
    hpg = np.zeros((len(points), 3, len(truth) * size))
    hpp = np.zeros((len(points), 3, 3))
    for c, camera in enumerate(truth):
        mine = problem.camera == c
        at, rows = points[problem.point[mine]], problem.point[mine]
        here = camera.project(at)
        by_point = np.stack([(camera.project(at + step * e) - here) / step for e in np.eye(3)], axis=-1)
        by_camera = []
        for k in range(size):
            d = step * np.eye(size)[k]
            rotation = exp_so3(d[:3]) @ camera.rotation
            center = camera.center_world + d[3:6]
            params = tuple(v * (1 + d[6]) if i < 2 else v for i, v in enumerate(camera.params))
            moved = replace(camera, params=params).posed(np.column_stack([rotation, -rotation @ center]))
            by_camera.append((moved.project(at) - here) / step)
        jacobian = np.stack(by_camera, axis=-1) / problem.sigma_px[mine][:, None, None]
        by_point = by_point / problem.sigma_px[mine][:, None, None]
        own = slice(size * c, size * (c + 1))
        hgg[own, own] = np.einsum("nai,naj->ij", jacobian, jacobian)
        np.add.at(hpp, rows, np.einsum("nai,naj->nij", by_point, by_point))
        hpg[rows, :, own] = np.einsum("nai,naj->nij", by_point, jacobian)
    seen = np.bincount(problem.point, minlength=len(points)) >= 2
    reduced = hgg - np.einsum("pig,pih->gh", hpg[seen], np.linalg.solve(hpp[seen], hpg[seen]))
    kept = np.concatenate([np.arange(size * c, size * (c + 1)) for c in free])
    spread = np.diag(np.linalg.inv(reduced[np.ix_(kept, kept)]))
    out = np.full(len(truth), np.nan)
    out[free] = np.sqrt(spread.reshape(-1, size)[:, 3:6].sum(axis=1))
    return out


def rigs() -> None:
    """Made rigs against the Cramer-Rao bound."""
    print("cameras  seeds  position error / bound (RMS, largest)  / own standard deviation  bound mm  CPU s")
    for count in (4, 8, 12):
        over, own, bounds, longest = [], [], [], 0.0
        for seed in range(_RIGS):
            rng = np.random.default_rng([count, seed])
            truth = ring(count, rng)
            points = rng.uniform([-1.5, -1.5, 0], [1.5, 1.5, 2], size=(500, 3))
            camera, point = np.nonzero(rng.random((count, len(points))) < 0.7)
            enough = np.bincount(point, minlength=len(points))[point] >= 2
            camera, point = camera[enough], point[enough]
            pixels = truth.project(points)[camera, point] + rng.normal(size=(len(camera), 2)) * 0.5
            wrong = rng.random(len(camera)) < 0.05
            pixels[wrong] += rng.normal(size=(int(wrong.sum()), 2)) * 60
            free = (FreeCamera(pose=False),) * 2 + (FreeCamera(focal=True),) * (count - 2)
            start = []
            for k, c in enumerate(truth):
                turned = exp_so3(rng.normal(size=3) * 0.02 * (k > 1)) @ c.rotation
                center = c.center_world + rng.normal(size=3) * 0.05 * (k > 1)
                start.append(c.posed(np.column_stack([turned, -turned @ center])))
            problem = AdjustProblem(
                CameraGroup(tuple(start)), camera, point, pixels, np.full(len(camera), 0.5),
                points + rng.normal(size=points.shape) * 0.03, np.ones(len(points), bool), free,
            )  # fmt: skip
            began = time.process_time()
            result = adjust(problem)
            longest = max(longest, time.process_time() - began)
            off = np.linalg.norm(result.cameras.centers_world - truth.centers_world, axis=1)[2:]
            least = bound(problem, truth, points)[2:]
            over += list(off / least)
            own += list(off / result.position_std[2:])
            bounds += list(least)
        print(
            f"{count:7}  {_RIGS:5}  {np.sqrt(np.mean(np.square(over))):.2f}, {max(over):.2f}"
            f"{np.sqrt(np.mean(np.square(own))):>32.2f}{1e3 * np.mean(bounds):>20.2f}{longest:>11.2f}", flush=True
        )  # fmt: skip


def _cut(px: FloatArray, variance: FloatArray, late: IndexArray) -> tuple[FloatArray, FloatArray]:
    """Camera c's frames `late[c]` later: rows of one frame are of different moments."""
    most = int(np.abs(late).max())
    length = px.shape[1] - 2 * most
    rows = [slice(most - n, most - n + length) for n in late]
    return np.stack([p[r] for p, r in zip(px, rows, strict=True)]), np.stack(
        [v[r] for v, r in zip(variance, rows, strict=True)]
    )


def sync(data: Path) -> None:
    """Takes cut apart and put back."""
    (cameras, px, variance), _ = balancing(data)
    worst: dict[str, list[float]] = {"motion": [], "epipolar": []}
    for seed in range(4):
        late = np.array([0, *np.random.default_rng(seed).integers(-10, 11, len(cameras) - 1)])
        cut = _cut(px, variance, late)
        for name, clocks in (
            ("motion", motion_clocks(*cut, 60.0)),
            ("epipolar", epipolar_clocks(cameras, *cut, 60.0)),
        ):
            off = np.array([c.offset for c in clocks]) * 60 - late
            worst[name].append(float(np.abs(off).max()))
    for name, values in worst.items():
        print(f"balancing, 1.3 s, 4 cuts, {name}: off by at most {np.round(values, 2)} frames")
    _sound()


def _sound() -> None:
    rate, seconds = 8000, 600
    for seed in range(3):
        rng = np.random.default_rng(seed)
        offset, drift = rng.uniform(-1.5, 1.5), 50e-6 * (1 if seed % 2 else -1)
        grid = np.arange(0, seconds + 12, 1 / 16000)
        loud = np.repeat(rng.uniform(0, 1, len(grid) // 800 + 1) ** 4, 800)[: len(grid)]
        sound = rng.normal(size=len(grid)) * loud
        own = np.arange(seconds * rate) / rate
        one = np.interp(own + 5, grid, sound) + rng.normal(0, 0.05, len(own))
        two = np.interp((own - offset) / (1 + drift) + 5, grid, sound) + rng.normal(0, 0.05, len(own))
        clock: Clock = audio_clock(one, two, rate)
        print(
            f"sound, 10 minutes: offset off by {1e3 * (clock.offset - offset):+.3f} ms, drift by "
            f"{1e6 * (clock.drift - drift):+.2f} ppm"
        )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("what", nargs="+", choices=["board", "lenses", "people", "rigs", "sync"])
    parser.add_argument("--data", type=Path, default=Path(__file__).resolve().parents[3].parent / "shared" / "data")
    args = parser.parse_args()
    parts = {"board": board, "lenses": lenses, "people": people, "rigs": lambda _: rigs(), "sync": sync}
    for what in args.what:
        print(f"== {what}", flush=True)
        parts[what](args.data)


if __name__ == "__main__":
    main()
