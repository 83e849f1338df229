"""Camera poses from landmark tracks alone: two cameras first, the others one by one.

Pairs of cameras get an essential matrix by RANSAC over everything both saw, landmark by landmark and frame by
frame. From each of the best pairs the rig is grown: points are triangulated, the camera that sees most of
them is placed by PnP with RANSAC, everything is adjusted, and so on. The rig of the lowest cost is kept: the
choice among the first pairs is what guards against a pair whose geometry was ill-posed.
"""

from __future__ import annotations

from itertools import combinations
from typing import NamedTuple

import cv2
import numpy as np

from muybridge.arrays import FloatArray
from muybridge.errors import CalibrationError
from muybridge.geometry.calibration.bundle_adjustment.with_bones import (
    ArticulatedProblem,
    ArticulatedState,
    adjust_articulated,
)
from muybridge.geometry.cameras.camera import Camera
from muybridge.geometry.cameras.group import CameraGroup
from muybridge.geometry.triangulation.multiview import TriangulateOptions, triangulate

_GATE_PX = 12.0  # of the RANSACs, in an image of 1000 px focal length
_FOCAL_OF_GATE = 1000.0
_FEWEST_SHARED = 20
_FEWEST_AGREEING = 0.4
_SEEDS = 3
_SAMPLE = 3000
_CONFIDENCE = 0.9999
_GROWTH_ITERATIONS = 10
_GROWTH_FRAMES = 50


class PairGeometry(NamedTuple):
    """Two cameras' relative pose.

    Attributes:
        first, second: the cameras.
        second_from_first: (3, 4), the translation of unit length.
        shared: how many points both saw.
        inliers: share of them that agree.
        angle_deg: median angle between the two rays of a point.
    """

    first: int
    second: int
    second_from_first: FloatArray
    shared: int
    inliers: float
    angle_deg: float


def pair_geometry(seen: FloatArray, first: int, second: int, gate: float) -> PairGeometry | None:
    """Relative pose of two cameras from everything both saw; None where that is too little.

    Args:
        seen: (C, N, 2) undistorted normalised coordinates, NaN where missing.
        first, second: which.
        gate: epipolar distance of an inlier, in the units of `seen`.
    """
    both = np.isfinite(seen[first]).all(axis=-1) & np.isfinite(seen[second]).all(axis=-1)
    shared = int(both.sum())
    if shared < _FEWEST_SHARED:
        return None
    index = np.flatnonzero(both)
    if shared > _SAMPLE:
        index = index[np.linspace(0, shared - 1, _SAMPLE).astype(np.intp)]
    a, b = np.ascontiguousarray(seen[first, index]), np.ascontiguousarray(seen[second, index])
    cv2.setRNGSeed(1)
    essential, mask = cv2.findEssentialMat(a, b, np.eye(3), cv2.RANSAC, _CONFIDENCE, gate)
    if essential is None or essential.shape != (3, 3):
        return None
    _, rotation, translation, front = cv2.recoverPose(essential, a, b, np.eye(3), mask=mask.copy())
    good = front.ravel() > 0
    if not good.any():
        return None
    rays_a = np.concatenate([a, np.ones((len(a), 1))], axis=1) @ rotation.T
    rays_b = np.concatenate([b, np.ones((len(b), 1))], axis=1)
    cosine = (rays_a * rays_b).sum(axis=1) / np.linalg.norm(rays_a, axis=1) / np.linalg.norm(rays_b, axis=1)
    angle = float(np.degrees(np.median(np.arccos(np.clip(cosine[good], -1, 1)))))
    pose = np.concatenate([rotation, translation.reshape(3, 1)], axis=1)
    return PairGeometry(first, second, pose, shared, float(good.mean()), angle)


def start_from_nothing(
    cameras: CameraGroup, points_px: FloatArray, variance_px2: FloatArray
) -> tuple[CameraGroup, FloatArray]:
    """Poses of cameras whose lenses are known, up to a similarity.

    Args:
        cameras: C cameras; their poses are not looked at.
        points_px: (C, T, K, 2) px, NaN where missing.
        variance_px2: (C, T, K).

    Returns:
        The posed cameras and (T, K, 3) points, NaN where unknown, in the units of the first pair's baseline.

    Raises:
        CalibrationError: a camera cannot be placed; it is named.
    """
    seen = cameras.unproject(points_px)
    flat = seen.reshape(len(cameras), -1, 2)
    gates = _GATE_PX / _FOCAL_OF_GATE
    found = [pair_geometry(flat, i, j, gates) for i, j in combinations(range(len(cameras)), 2)]
    pairs = [p for p in found if p is not None and p.inliers >= _FEWEST_AGREEING]
    if not pairs:
        raise CalibrationError(
            "no two cameras agree on how they stand to each other: too few shared landmarks, or not the same "
            "person, or the videos are not in step; check with the overlays, synchronise, or record a longer walk"
        )
    pairs.sort(key=lambda p: -p.inliers * np.sqrt(p.shared) * np.sin(np.radians(np.clip(p.angle_deg, 0, 90))))
    best: tuple[float, CameraGroup] | None = None
    missing: list[int] = []
    some = np.unique(np.linspace(0, seen.shape[1] - 1, _GROWTH_FRAMES).round().astype(np.intp))
    for pair in pairs[:_SEEDS]:
        grown = _grown(cameras, points_px[:, some], variance_px2[:, some], seen[:, some], pair)
        if isinstance(grown, list):
            missing = grown
        elif best is None or grown[0] < best[0]:
            best = grown
    if best is None:
        names = ", ".join(cameras.names[c] for c in missing)
        raise CalibrationError(
            f"camera {names} cannot be placed: it shares too few landmarks with the others that fit together; "
            "let the person walk where several cameras see them",
            remedy="leave_out_camera",
        )
    options = TriangulateOptions(noise_px=_GATE_PX)
    return best[1], triangulate(best[1], points_px, variance_px2, options).points_world


def _grown(
    cameras: CameraGroup, px: FloatArray, variance: FloatArray, seen: FloatArray, pair: PairGeometry
) -> tuple[float, CameraGroup] | list[int]:
    """(cost, cameras) of the rig grown from a pair; or the cameras that could not be placed."""
    posed: dict[int, Camera] = {
        pair.first: cameras[pair.first].posed(np.eye(3, 4)),
        pair.second: cameras[pair.second].posed(pair.second_from_first),
    }
    cost, points = _settled(posed, px, variance)
    while len(posed) < len(cameras):
        known = np.isfinite(points).all(axis=-1)
        open_ = [c for c in range(len(cameras)) if c not in posed]
        shared = {c: int((known & np.isfinite(seen[c]).all(axis=-1)).sum()) for c in open_}
        chosen = max(open_, key=lambda c: shared[c])
        pose = _placed(points[known], seen[chosen][known]) if shared[chosen] >= _FEWEST_SHARED else None
        if pose is None:
            return open_
        posed[chosen] = cameras[chosen].posed(pose)
        cost, points = _settled(posed, px, variance)
    return cost, CameraGroup(tuple(posed[c] for c in range(len(cameras))))


def _placed(points: FloatArray, seen: FloatArray) -> FloatArray | None:
    """(3, 4) pose from (N, 3) points and (N, 2) normalised coordinates."""
    good = np.isfinite(seen).all(axis=-1)
    cv2.setRNGSeed(1)
    ok, rotvec, translation, inliers = cv2.solvePnPRansac(
        points[good], seen[good], np.eye(3), None, iterationsCount=2000,
        reprojectionError=2 * _GATE_PX / _FOCAL_OF_GATE, confidence=_CONFIDENCE, flags=cv2.SOLVEPNP_SQPNP,
    )  # fmt: skip
    if not ok or inliers is None or len(inliers) < _FEWEST_SHARED:
        return None
    inliers = inliers.ravel()
    rotvec, translation = cv2.solvePnPRefineLM(
        points[good][inliers], seen[good][inliers], np.eye(3), None, rotvec, translation
    )
    rotation, _ = cv2.Rodrigues(rotvec)
    return np.concatenate([rotation, translation.reshape(3, 1)], axis=1)


def _settled(posed: dict[int, Camera], px: FloatArray, variance: FloatArray) -> tuple[float, FloatArray]:
    """Triangulate and adjust the cameras placed so far (in place); the cost for each observation, and points."""
    order = sorted(posed)
    group = CameraGroup(tuple(posed[c] for c in order))
    rows, spread = px[order], variance[order]
    points = triangulate(group, rows, spread, TriangulateOptions(noise_px=_GATE_PX)).points_world
    focal = np.array([c.camera_matrix[0, 0] for c in group])
    problem = ArticulatedProblem(
        seen=group.unproject(rows),
        focal_px=focal,
        sigma_px=(_GATE_PX / 2) * np.sqrt(spread / np.nanmedian(spread)),
        bones=np.zeros((0, 2), dtype=np.intp),
        bone_sigma=np.zeros(0),
    )
    state = ArticulatedState(
        group.cam_from_world[:, :, :3], group.centers_world, np.zeros(len(group)), points, np.zeros(0)
    )
    done = adjust_articulated(problem, state, _GROWTH_ITERATIONS)
    for c, rotation, center in zip(order, done.state.rotations, done.state.centers, strict=True):
        posed[c] = posed[c].posed(np.concatenate([rotation, -(rotation @ center)[:, None]], axis=1))
    counted = max(int(np.isfinite(done.residual_px).sum()), 1)
    # Points that the cameras could not agree on are missing from the cost: they must not make it cheap.
    lost = int((np.isfinite(spread).sum(axis=0) >= 2).sum()) * 2 - counted
    return done.cost / counted + max(lost, 0) / counted, done.state.points
