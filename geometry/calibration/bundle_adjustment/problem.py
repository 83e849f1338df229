"""What a bundle adjustment of cameras, points and rigid boards is given, and what it returns."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from muybridge.arrays import BoolArray, FloatArray, IntArray
from muybridge.geometry.cameras.group import CameraGroup


@dataclass(frozen=True)
class FreeCamera:
    """What of a camera is adjusted."""

    focal: bool = False
    principal: bool = False
    distortion: bool = False
    pose: bool = True


@dataclass(frozen=True)
class LensPrior:
    """What is known of a lens beforehand: a Gaussian over its parameters.

    Attributes:
        mean: (D,) the model's parameters.
        information: (D, D) inverse covariance; zero where nothing is known.
    """

    mean: FloatArray
    information: FloatArray


@dataclass(frozen=True)
class AdjustProblem:
    """What is adjusted, and where it starts.

    Attributes:
        cameras: the start, C cameras.
        camera: (N,) camera of each observation.
        point: (N,) its point, a row of `points`.
        pixels: (N, 2) px.
        sigma_px: (N,) its standard deviation, px.
        points: (P, 3) metres, in world axes, or in a body's axes where observed on a body.
        points_free: (P,) whether a world point is adjusted; a body's points are held.
        body: (N,) the body that the point is on, -1 for the world; None if all are.
        bodies: (B, 3, 4) world_from_body.
        free: one for each camera.
        loss_sigma: error, in standard deviations, where the Cauchy loss starts to bend; inf for least squares.
        max_iterations: at most.
        priors: one for each camera, None where a lens is left to the observations; empty for none at all.
        sway: (C, B, 6, R) how a body may have moved (rotation, then shift of its origin, world axes) between a
            camera's exposure and the time of `bodies`: R independent movements of one standard deviation each.
            None where all cameras expose at once.
        sway_mean: (C, B, R) how many standard deviations of each movement to expect; None for zero.
    """

    cameras: CameraGroup
    camera: IntArray
    point: IntArray
    pixels: FloatArray
    sigma_px: FloatArray
    points: FloatArray
    points_free: BoolArray
    free: tuple[FreeCamera, ...]
    body: IntArray | None = None
    bodies: FloatArray = field(default_factory=lambda: np.zeros((0, 3, 4)))
    loss_sigma: float = 3.0
    max_iterations: int = 50
    priors: tuple[LensPrior | None, ...] = ()
    sway: FloatArray | None = None
    sway_mean: FloatArray | None = None

    def __post_init__(self) -> None:
        count = len(self.camera)
        body = np.full(count, -1) if self.body is None else np.asarray(self.body)
        object.__setattr__(self, "body", body)
        if not (len(self.point) == len(self.pixels) == len(self.sigma_px) == len(body) == count):
            raise ValueError("camera, point, pixels, sigma_px and body must have one row for each observation")
        if len(self.free) != len(self.cameras) or len(self.points_free) != len(self.points):
            raise ValueError("free must have one entry for each camera, points_free one for each point")
        if np.any(np.asarray(self.points_free)[self.point[body >= 0]]):
            raise ValueError("points on a body cannot be free")
        if len(self.priors) not in (0, len(self.cameras)):
            raise ValueError("priors must be empty or have one entry for each camera")
        if self.sway is not None and self.sway.shape[:3] != (len(self.cameras), len(self.bodies), 6):
            raise ValueError(f"sway must be ({len(self.cameras)}, {len(self.bodies)}, 6, R), not {self.sway.shape}")


@dataclass(frozen=True)
class AdjustResult:
    """Adjusted cameras, points and bodies.

    Attributes:
        cameras: as adjusted.
        points: (P, 3).
        bodies: (B, 3, 4).
        residuals_px: (N, 2) projected minus observed; NaN behind a camera.
        weights: (N,) the robust weight of each observation at the end, from 1 (an inlier) down to 0.
        noise: observed size of the errors in given standard deviations; scales the figures below.
        focal_std: (C,) px, of the first focal length; 0 where it was held.
        position_std: (C,) metres, length of the standard deviations along the axes; relative to all cameras
            where nothing fixes the world.
        iterations: done.
        covariances: for each camera (D + 6, D + 6): lens parameters, rotation about the camera's axes, centre in
            world axes; zero where held.
        swayed: (C, B, R) the movements found, in their standard deviations; None without `sway`.
        swayed_variance: (C, B, R) what stayed unknown of them (1: nothing was seen).
    """

    cameras: CameraGroup
    points: FloatArray
    bodies: FloatArray
    residuals_px: FloatArray
    weights: FloatArray
    noise: float
    focal_std: FloatArray
    position_std: FloatArray
    iterations: int
    covariances: tuple[FloatArray, ...]
    swayed: FloatArray | None = None
    swayed_variance: FloatArray | None = None
