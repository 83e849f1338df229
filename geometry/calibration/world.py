"""Origin, axes and scale of a calibration's world."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from muybridge.arrays import BoolArray, FloatArray
from muybridge.errors import CalibrationError
from muybridge.geometry.calibration.bundle_adjustment.adjustment import AdjustProblem, FreeCamera, adjust
from muybridge.geometry.cameras.camera import Camera
from muybridge.geometry.cameras.group import CameraGroup
from muybridge.geometry.numerics.rotations import kabsch

# Error, as a share of the points' extent, from which points are wrong; factor by which the rest must fit better without
# the one that is wrong.
_WRONG, _BETTER = 0.05, 3.0


def transform_cameras(cameras: CameraGroup, new_from_old: FloatArray, scale: float = 1.0) -> CameraGroup:
    """Transform cameras to another world.

    Args:
        cameras: in the old world.
        new_from_old: (3, 4) rotation | translation of x_new = R (scale x_old) + t.
        scale: new metres per old metre.
    """
    rotation, shift = new_from_old[:, :3], new_from_old[:, 3]
    posed: list[Camera] = []
    for camera in cameras:
        turned = camera.rotation @ rotation.T
        center = scale * rotation @ camera.center_world + shift
        posed.append(camera.posed(np.column_stack([turned, -turned @ center])))
    return CameraGroup(tuple(posed))


def facing_transform(cameras: CameraGroup, up: FloatArray, origin: FloatArray) -> FloatArray:
    """(3, 4) new_from_old with Z along the unit vector `up`, +Y along the first camera's view, `origin` at zero."""
    forward = cameras[0].rotation[2] - up * (cameras[0].rotation[2] @ up)
    if np.linalg.norm(forward) < 0.1:  # it looks straight down: use the top of its image
        forward = -cameras[0].rotation[1] + up * (cameras[0].rotation[1] @ up)
    forward /= np.linalg.norm(forward)
    rotation = np.stack([np.cross(forward, up), forward, up])
    return np.column_stack([rotation, -rotation @ origin])


def on_board(cameras: CameraGroup, world_from_board: FloatArray) -> FloatArray:
    """(3, 4) new_from_old with the board as the floor: its first corner the origin, +X along its columns, Z up.

    Up is the side of the board on which the cameras are.

    Args:
        cameras: the cameras that saw the board.
        world_from_board: (3, 4) metres.
        world_from_board: (3, 4).

    Raises:
        CalibrationError: cameras are on both sides of the board.
    """
    rotation, origin = world_from_board[:, :3].copy(), world_from_board[:, 3]
    height = (cameras.centers_world - origin) @ rotation[:, 2]
    if height.min() < 0 < height.max():
        below = [n for n, h in zip(cameras.names, height, strict=True) if h * np.sign(np.median(height)) < 0]
        raise CalibrationError(
            f"the board cannot lie on the floor: camera {', '.join(below)} would look at it from below; name another "
            "moment, at which the board lay flat on the floor"
        )
    if height.mean() < 0:  # the board's z axis points into the floor: keep x, invert y and z
        rotation[:, 1:] *= -1
    return np.column_stack([rotation.T, -rotation.T @ origin])


@dataclass(frozen=True)
class Placement:
    """Transformation of a world that moves marked points to their known coordinates.

    Attributes:
        new_from_old: (3, 4) rotation | translation, after scaling.
        scale: new metres per old metre.
        errors: (N,) remaining distance of each point, metres; NaN for those not used.
        points: (N, 3) triangulated points in the new world, metres; NaN where fewer than two cameras see them.
    """

    new_from_old: FloatArray
    scale: float
    errors: FloatArray
    points: FloatArray


def triangulate_marked(cameras: CameraGroup, pixels: FloatArray) -> FloatArray:
    """(N, 3) points triangulated from (C, N, 2) px, NaN where unseen; NaN for points seen by fewer than two cameras."""
    seen: BoolArray = np.isfinite(pixels[..., 0])
    enough = seen.sum(axis=0) >= 2
    out = np.full((pixels.shape[1], 3), np.nan)
    if not enough.any():
        return out
    rows, sides = np.zeros((pixels.shape[1], 3, 3)), np.zeros((pixels.shape[1], 3))
    for c, camera in enumerate(cameras):  # nearest point to all rays
        ray = camera.rays(np.where(seen[c][:, None], pixels[c], np.nan))
        away = np.where(seen[c][:, None, None], np.eye(3) - ray[:, :, None] * ray[:, None, :], 0.0)
        rows, sides = rows + np.nan_to_num(away), sides + np.nan_to_num(away) @ camera.center_world
    out[enough] = np.linalg.solve(rows[enough], sides[enough][..., None])[..., 0]
    which, point = np.nonzero(seen & enough)
    result = adjust(
        AdjustProblem(
            cameras=cameras, camera=which, point=point, pixels=pixels[which, point], sigma_px=np.ones(len(which)),
            points=np.nan_to_num(out), points_free=enough, free=(FreeCamera(pose=False),) * len(cameras),
        )
    )  # fmt: skip
    out[enough] = result.points[enough]
    return out


def on_points(cameras: CameraGroup, pixels: FloatArray, known: FloatArray, keep_scale: bool = False) -> Placement:
    """The transformation to a world in which marked points have known coordinates.

    Args:
        cameras: C cameras in any world.
        pixels: (C, N, 2) px of the points, NaN where unseen.
        known: (N, 3) their coordinates, metres.
        keep_scale: only rotate and translate.

    Raises:
        CalibrationError: fewer than three points are seen by two cameras, or they lie on a line.
    """
    found = triangulate_marked(cameras, pixels)
    good = np.isfinite(found).all(axis=1)
    if good.sum() < 3:
        raise CalibrationError(
            f"{good.sum()} of the {len(known)} points are seen by two cameras or more, three are needed to set a "
            "world; mark each in at least two cameras"
        )
    middle, target = found[good].mean(axis=0), known[good].mean(axis=0)
    a, b = found[good] - middle, known[good] - target
    spread = np.linalg.svd(b, compute_uv=False)
    if spread[1] < 0.02 * spread[0]:
        raise CalibrationError("the points lie on a line, about which the world could turn; mark one off the line")
    rotation = kabsch(a, b, np.ones(len(a)))
    scale = 1.0 if keep_scale else float((b * (a @ rotation.T)).sum() / (a * a).sum())
    shift = target - scale * rotation @ middle
    points = scale * found @ rotation.T + shift
    errors = np.where(good, np.linalg.norm(points - known, axis=1), np.nan)
    return Placement(np.column_stack([rotation, shift]), scale, errors, points)


def check_shape(found: FloatArray, known: FloatArray) -> None:
    """Check that triangulated points have the shape of the known ones.

    Args:
        found: (N, 3) triangulated points, in any world of any scale; NaN where unknown.
        known: (N, 3) their known coordinates, metres.

    Raises:
        CalibrationError: some are off by more than a twentieth of their extent; the message names the wrong one, or
            says that they are mirrored.
    """
    good = np.isfinite(found).all(axis=1)
    a, b = found[good], known[good]
    limit = _WRONG * float(np.linalg.norm(np.ptp(b, axis=0)))
    worst = float(_unlike(a, b).max())
    if worst <= limit:
        return
    off = f"the points are up to {1e3 * worst:.0f} mm off"
    if _unlike(a, b * [1.0, -1.0, 1.0]).max() <= limit:
        raise CalibrationError(
            f"{off}; they fit with the sign of y changed: their axes are left-handed (or y and z swapped), they must "
            "be right-handed with Z up"
        )
    without = [float(_unlike(np.delete(a, k, 0), np.delete(b, k, 0)).max()) for k in range(len(a))]
    best, second = np.argsort(without)[:2]
    if len(a) > 3 and without[best] <= limit and _BETTER * without[best] < min(worst, without[second]):
        x, y, z = b[best]
        raise CalibrationError(
            f"{off}; without ({x:g}, {y:g}, {z:g}) the others fit to {1e3 * without[best]:.0f} mm: check that point "
            "and its pixels, or leave it out"
        )
    raise CalibrationError(f"{off}; check their coordinates, and that each row has a point and its own pixel")


def _unlike(a: FloatArray, b: FloatArray) -> FloatArray:
    """(N,) distances of points b from points a after the similarity transform of a that fits best."""
    a, b = a - a.mean(axis=0), b - b.mean(axis=0)
    turned = a @ kabsch(a, b, np.ones(len(a))).T
    scale = (b * turned).sum() / max(float((a * a).sum()), 1e-300)
    return np.asarray(np.linalg.norm(scale * turned - b, axis=1))
