"""Leave-one-camera-out error on frames that were not used for learning.

Usage: python -m scripts.benchmarks.takes.left_out --data DATA

The balancing take's 2D by OpenPose. Cameras are refined from the person (as by `muybridge calibrate people`) on one
half of the frames; the network's view-dependent bias (`geometry.triangulation.view_bias`) is learned on the same half
with those cameras. In every frame of the other half each camera is left out in turn, the other three are triangulated,
and the points are projected into it. Medians over all landmarks, cameras and frames, px, with the roles of the halves
exchanged.
"""

import argparse
from collections.abc import Callable, Collection
from itertools import combinations, pairwise
from pathlib import Path

import numpy as np

from muybridge.arrays import FloatArray
from muybridge.geometry.calibration.people.calibrate import refine_people
from muybridge.geometry.cameras.group import CameraGroup
from muybridge.geometry.landmarks.sets import LandmarkSet
from muybridge.geometry.triangulation.multiview import triangulate
from muybridge.geometry.triangulation.view_bias import (
    ViewBias,
    learn_view_bias,
    remove_view_bias,
    trunk_axes,
)
from scripts.benchmarks.geometry.diagnosis import balancing
from scripts.benchmarks.geometry.whole_take import triangulate_take

Solve = Callable[[CameraGroup, FloatArray, FloatArray], FloatArray]
FPS = 60.0


def bones_of(names: list[str]) -> list[tuple[int, int]]:
    """Pairs of landmarks of nearly constant distance: limbs, and everything rigid within head, trunk and feet."""
    sided = [f"{side}_{{}}".format for side in ("left", "right")]
    joints = ("shoulder", "elbow", "wrist"), ("hip", "knee", "ankle")
    limbs = [(s(a), s(b)) for s in sided for limb in joints for a, b in pairwise(limb)]
    trunk = combinations(["left_shoulder", "right_shoulder", "left_hip", "right_hip", "neck"], 2)
    head = combinations(["nose", "left_eye", "right_eye", "left_ear", "right_ear"], 2)
    feet = [pair for s in sided for pair in combinations([s(n) for n in ("ankle", "heel", "big_toe", "small_toe")], 2)]
    both = [*limbs, *trunk, *head, *feet]
    return [(names.index(a), names.index(b)) for a, b in both]


def left_out(
    cameras: CameraGroup, px: FloatArray, variance: FloatArray, solve: Solve, offsets: ViewBias | None
) -> float:
    """Median distance in px of a camera's points from those that `solve` computes from the other cameras."""
    error = []
    for c, camera in enumerate(cameras):
        others = [k for k in range(len(cameras)) if k != c]
        group, seen, doubt = cameras.select([cameras.names[k] for k in others]), px[others], variance[others]
        if offsets is not None:
            seen = remove_view_bias(group, seen, doubt, triangulate(group, seen, doubt), offsets)[0]
        points = solve(group, seen, doubt)
        expected = camera.project(points)
        if offsets is not None:
            axes = trunk_axes(points, offsets.landmarks)
            assert axes is not None
            expected += offsets.px(cameras.select([camera.name]), points, axes)[0]
        error.append(np.linalg.norm(expected - px[c], axis=-1)[np.isfinite(variance[c])])
    return float(np.nanmedian(np.concatenate(error)))


def medians(data: Path, kinds: Collection[str] = ("delivered", "refined")) -> dict[tuple[str, str, str], list[float]]:
    """Medians in px on the second and the first half, by cameras, solver, and whether the bias is known."""
    (delivered, px, variance), names = balancing(data)
    landmarks, bones = LandmarkSet("reference", tuple(names), ()), bones_of(names)
    solvers: dict[str, Solve] = {
        "single frames": lambda group, seen, doubt: triangulate(group, seen, doubt).points_world,
        f"whole take, {len(bones)} bones": lambda group, seen, doubt: (
            triangulate_take(group, seen, doubt, bones).points_world
        ),
    }
    halves = np.split(np.arange(px.shape[1]), 2)
    rows: dict[tuple[str, str, str], list[float]] = {}
    for learn, test in (halves, halves[::-1]):
        known, doubt = px[:, learn], variance[:, learn]
        poses = {"delivered": delivered, "refined": refine_people(delivered, known, doubt, names).cameras}
        for kind in kinds:
            cameras = poses[kind]
            found = triangulate(cameras, known, doubt)
            learned = learn_view_bias(cameras, known, doubt, landmarks, FPS, found)
            for name, solve in solvers.items():
                for bias, offsets in (("", None), ("known", learned)):
                    median = left_out(cameras, px[:, test], variance[:, test], solve, offsets)
                    rows.setdefault((kind, name, bias), []).append(median)
    return rows


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--data", type=Path, default=Path("../shared/data"))
    print("| cameras | triangulated | where landmarks are seen | tried on the second half | on the first |")
    print("|" + " --- |" * 5)
    for key, (second, first) in medians(parser.parse_args().data).items():
        print(f"| {' | '.join(key)} | {second:.2f} | {first:.2f} |")


if __name__ == "__main__":
    main()
