"""Vectorised operations on rays: directions of pixels, and points nearest to bundles of rays.

For tracking people in every frame: approximate, fast and robust. Final results come from
`muybridge.geometry.triangulation.multiview`.
"""

import numpy as np

from muybridge.arrays import FloatArray
from muybridge.geometry.cameras.group import CameraGroup

_ROBUST_ROUNDS = 2


def midpoint(
    center_a: FloatArray, ray_a: FloatArray, center_b: FloatArray, ray_b: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Classical triangulation from two rays: the midpoint of the shortest segment between them.

    With P = center_a + s ray_a and Q = center_b + t ray_b, that segment is perpendicular to both rays,

        (P - Q) . ray_a = 0   and   (P - Q) . ray_b = 0,

    which are two linear equations in s and t. It considers neither noise nor further views; the robust triangulation
    starts from such points.

    Args:
        center_a, center_b: (..., 3) origins of the rays.
        ray_a, ray_b: (..., 3) directions of any length.

    Returns:
        (..., 3) midpoint of P and Q, NaN where the rays are parallel or the point is behind a camera; (...) distance
        between P and Q.

    Source: R. Parent, Computer Animation, 3rd edition, 2012, equations 6.1 to 6.4.
    """
    aa, bb, ab = (np.sum(x * y, axis=-1) for x, y in ((ray_a, ray_a), (ray_b, ray_b), (ray_a, ray_b)))
    between = center_b - center_a
    along_a, along_b = np.sum(between * ray_a, axis=-1), np.sum(between * ray_b, axis=-1)
    determinant = aa * bb - ab**2
    with np.errstate(divide="ignore", invalid="ignore"):
        s = (bb * along_a - ab * along_b) / determinant
        t = (ab * along_a - aa * along_b) / determinant
    ahead = (determinant > 1e-12 * aa * bb) & (s > 0) & (t > 0)
    on_a, on_b = center_a + s[..., None] * ray_a, center_b + t[..., None] * ray_b
    middle: FloatArray = np.where(ahead[..., None], (on_a + on_b) / 2, np.nan)
    return middle, np.where(ahead, np.linalg.norm(on_a - on_b, axis=-1), np.nan)


def ray_directions(cameras: CameraGroup, points_px: FloatArray) -> FloatArray:
    """(C, ..., 2) px to (C, ..., 3) unit vectors in the world, from the camera centres; NaN stays NaN."""
    slopes = cameras.unproject(points_px)
    rays = np.concatenate([slopes, np.ones((*slopes.shape[:-1], 1))], axis=-1)
    rays /= np.linalg.norm(rays, axis=-1, keepdims=True)
    return np.stack([r @ camera.rotation for r, camera in zip(rays, cameras, strict=True)])


def nearest_points(centers: FloatArray, rays: FloatArray, weights: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Points nearest to bundles of rays: weighted least squares of the distances, with outliers downweighted.

    Args:
        centers: (C, 3) origins of the cameras' rays.
        rays: (C, N, J, 3) unit vectors, NaN where missing.
        weights: (C, N) inverse variance of the distances in metres.

    Returns:
        (N, J, 3) points, NaN with fewer than two rays, and the distances (C, N, J) of the rays.
    """
    known = np.isfinite(rays[..., 0])
    d = np.where(known[..., None], rays, 0.0)
    weight = known * weights[..., None]
    enough = known.sum(0) >= 2
    points = _meet(centers, d, weight)
    for _ in range(_ROBUST_ROUNDS):
        away = np.where(known, ray_distance(centers, d, points), np.nan)
        scale = 1.5 * _middle(np.where(enough, away, np.nan)) + 1e-6
        points = _meet(centers, d, weight / (1 + (np.nan_to_num(away) / scale[:, None]) ** 2) ** 2)
    away = np.where(known & enough, ray_distance(centers, d, points), np.nan)
    return np.where(enough[..., None], points, np.nan), away


def ray_distance(centers: FloatArray, rays: FloatArray, points: FloatArray) -> FloatArray:
    """(C, N, J) distances of points (N, J, 3) from rays (C, N, J, 3)."""
    offset = points[None] - centers[:, None, None]
    along = np.sum(offset * rays, axis=-1, keepdims=True)
    distance: FloatArray = np.linalg.norm(offset - along * rays, axis=-1)
    return distance


def _meet(centers: FloatArray, d: FloatArray, weight: FloatArray) -> FloatArray:
    """Solve sum w (I - d d') x = sum w (I - d d') c."""
    w = weight[..., None, None]
    projector = w * (np.eye(3) - d[..., :, None] * d[..., None, :])
    a = projector.sum(0)
    b = np.einsum("cnjxy,cy->njx", projector, centers)
    # Parallel rays and single rays have no intersection: keep the system solvable, the caller drops the result.
    a += (1e-9 * np.trace(a, axis1=-2, axis2=-1)[..., None, None] + 1e-12) * np.eye(3)
    solved: FloatArray = np.linalg.solve(a, b[..., None])[..., 0]
    return solved


def _middle(away: FloatArray) -> FloatArray:
    """(N,) medians over cameras and landmarks."""
    rows = np.sort(np.moveaxis(away, 1, 0).reshape(away.shape[1], -1), axis=1)  # NaN last
    count = np.isfinite(rows).sum(1)
    return np.where(count > 0, rows[np.arange(len(rows)), np.maximum(count - 1, 0) // 2], 0.0)


def pair_points(
    center_a: FloatArray, rays_a: FloatArray, center_b: FloatArray, rays_b: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Midpoints between every detection of one camera and every detection of another.

    Args:
        center_a, center_b: (3,) camera centres.
        rays_a, rays_b: (A, J, 3) and (B, J, 3) unit vectors.

    Returns:
        (A, B, J, 3) midpoints between two rays, NaN behind a camera, and (A, B, J) distances between the rays.
    """
    u, v = rays_a[:, None], rays_b[None]
    between = center_a - center_b
    cos = np.sum(u * v, axis=-1)
    at_u, at_v = u @ between, v @ between
    with np.errstate(divide="ignore", invalid="ignore"):
        sin2 = np.where(1 - cos**2 > 1e-6, 1 - cos**2, np.nan)
        s = (cos * at_v - at_u) / sin2
        t = (at_v - cos * at_u) / sin2
    a, b = center_a + s[..., None] * u, center_b + t[..., None] * v
    ahead = (s > 0) & (t > 0)
    return np.where(ahead[..., None], (a + b) / 2, np.nan), np.where(ahead, np.linalg.norm(a - b, axis=-1), np.nan)
