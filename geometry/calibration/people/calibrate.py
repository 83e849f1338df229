"""Cameras calibrated, or a calibration refined, from the 2D landmarks of people who move before them.

The lenses are known, or their focal lengths roughly; what is found is where the cameras stand. `refine_people`
starts from a calibration and keeps its world; `calibrate_people` starts from nothing: relative poses from
landmark tracks, cameras added one by one, then the same adjustment (`people_adjust`), with the size from a
person's height, up and the floor from the feet.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from muybridge.arrays import FloatArray, IndexArray
from muybridge.errors import CalibrationError
from muybridge.geometry.calibration.bundle_adjustment.with_bones import (
    ArticulatedProblem,
    ArticulatedResult,
    ArticulatedState,
    adjust_articulated,
)
from muybridge.geometry.calibration.people.initialise import start_from_nothing
from muybridge.geometry.calibration.people.world import world_from_people
from muybridge.geometry.cameras.camera import Camera, colmap_camera
from muybridge.geometry.cameras.group import CameraGroup
from muybridge.geometry.triangulation.multiview import triangulate

# Pairs of landmarks with bone between them, without a side's prefix where there is one on either side; and
# how constant their distance is, as landmarks of a 2D network go, in metres.
_ACROSS = (("shoulder", 0.03), ("hip", 0.03), ("ear", 0.02))
_ALONG = (
    ("shoulder", "elbow", 0.02),
    ("elbow", "wrist", 0.02),
    ("hip", "knee", 0.03),
    ("knee", "ankle", 0.02),
    ("ankle", "heel", 0.02),
    ("ankle", "big_toe", 0.03),
    ("heel", "big_toe", 0.02),
    ("ear", "eye", 0.02),
)
_FEWEST_FRAMES = 5
_NOISE_ROUNDS = 3
_FIRST_NOISE_PX = 8.0
_RAYLEIGH_MEDIAN = 1.1774  # median length of a 2D Gaussian of unit variance


@dataclass(frozen=True)
class PeopleCalibrationOptions:
    """How cameras are calibrated from people.

    Attributes:
        height: of the (first) person, metres; None for an average adult, or for the scale of the calibration
            that is refined.
        bones: hold bone lengths constant in time.
        max_frames: as many frames, evenly spread, take part at most.
        focal_sigma: how far a focal length may be off, as a share; 0 to hold them.
        prior_rotation_deg: when refining: standard deviation of the given rotations.
        prior_center: when refining: standard deviation of the given camera centres, metres.
        loss_sigma: error, in standard deviations, from which a 2D point is down-weighted.
        max_iterations: of the adjustment.
    """

    height: float | None = None
    bones: bool = True
    max_frames: int = 200
    focal_sigma: float = 0.0
    prior_rotation_deg: float = 1.5
    prior_center: float = 0.05
    loss_sigma: float = 1.0
    max_iterations: int = 30

    def __post_init__(self) -> None:
        if self.height is not None and not 0.3 <= self.height <= 2.8:
            raise ValueError(f"height is in metres, 0.3 to 2.8, not {self.height:g}")
        if self.max_frames < _FEWEST_FRAMES:
            raise ValueError(f"max_frames must be at least {_FEWEST_FRAMES}")
        if min(self.prior_rotation_deg, self.prior_center, self.loss_sigma) <= 0 or self.focal_sigma < 0:
            raise ValueError("standard deviations must be positive")


@dataclass(frozen=True)
class PeopleCalibration:
    """Cameras from people.

    Attributes:
        cameras: the calibrated cameras, metres, Z up.
        rotation_sd_deg: (C, 3) about each camera's own axes.
        center_sd: (C, 3) along the world's axes, metres.
        focal_sd: (C,) of the focal lengths, as a share; zero where they were held.
        frames: which frames took part.
        points_world: (T', K, 3) the landmarks in those frames, metres; NaN where unknown.
        residual_px: (C, T', K) reprojection error of the adjustment; NaN where nothing was seen.
        noise_px: standard deviation of a 2D point of median quality, as the take shows it.
        notes: what was assumed, in plain sentences.
    """

    cameras: CameraGroup
    rotation_sd_deg: FloatArray
    center_sd: FloatArray
    focal_sd: FloatArray
    frames: IndexArray
    points_world: FloatArray
    residual_px: FloatArray
    noise_px: float
    notes: tuple[str, ...]


def bone_pairs(names: Sequence[str]) -> tuple[IndexArray, FloatArray]:
    """Pairs of landmarks that bone joins.

    Args:
        names: of the landmarks (`left_knee`, ...).

    Returns:
        (B, 2) indices and (B,) standard deviations of the lengths in time, metres.
    """
    pairs: list[tuple[int, int]] = []
    sigmas: list[float] = []
    wanted = [(f"left_{a}", f"right_{a}", s) for a, s in _ACROSS]
    wanted += [(f"{side}_{a}", f"{side}_{b}", s) for a, b, s in _ALONG for side in ("left", "right")]
    for a, b, sigma in wanted:
        if a in names and b in names:
            pairs.append((list(names).index(a), list(names).index(b)))
            sigmas.append(sigma)
    return np.array(pairs, dtype=np.intp).reshape(-1, 2), np.array(sigmas)


def refine_people(
    cameras: CameraGroup,
    points_px: FloatArray,
    variance_px2: FloatArray,
    names: Sequence[str],
    options: PeopleCalibrationOptions = PeopleCalibrationOptions(),
) -> PeopleCalibration:
    """Better poses of calibrated cameras, from people.

    Args:
        cameras: C cameras; their world and scale are kept as far as the people allow.
        points_px: (C, T, P, J, 2) px of P people who were put in order between the cameras; (C, T, J, 2) for
            one. NaN where missing.
        variance_px2: (C, T, P, J) or (C, T, J) of each coordinate; its relative size counts.
        names: (J,) of the landmarks; they name the ends of bones.
        options: how.

    Raises:
        CalibrationError: too little was seen by two cameras or more.
        ValueError: arrays that do not match the cameras and names.
    """
    px, variance, people = _flattened(cameras, points_px, variance_px2, names)
    frames = _chosen_frames(cameras, px, variance, options)
    px, variance = px[:, frames], variance[:, frames]
    found = triangulate(cameras, px, variance)
    bones, sigma = _all_bones(names, people, options)
    state = _state(cameras, found.points_world, bones)
    prior = (np.radians(options.prior_rotation_deg), options.prior_center)
    adjusted, refined, noise = _adjusted(cameras, px, variance, state, bones, sigma, prior, options)
    notes: list[str] = []
    return _result(refined, adjusted, frames, noise, notes)


def calibrate_people(
    cameras: CameraGroup,
    points_px: FloatArray,
    variance_px2: FloatArray,
    names: Sequence[str],
    options: PeopleCalibrationOptions = PeopleCalibrationOptions(),
) -> PeopleCalibration:
    """Poses of cameras of which only the lenses are known, from people.

    Args:
        cameras: C cameras, whose poses are not looked at.
        points_px, variance_px2, names: as for `refine_people`.
        options: how; with `focal_sigma` above zero the focal lengths are refined too.

    Raises:
        CalibrationError: cameras that share too little (they are named), or too little movement.
        ValueError: arrays that do not match the cameras and names.
    """
    px, variance, people = _flattened(cameras, points_px, variance_px2, names)
    frames = _chosen_frames(cameras, px, variance, options)
    px, variance = px[:, frames], variance[:, frames]
    posed, points = start_from_nothing(cameras, px, variance)
    posed, points, notes = world_from_people(posed, points, names, options.height)
    bones, sigma = _all_bones(names, people, options)
    adjusted, posed, noise = _adjusted(posed, px, variance, _state(posed, points, bones), bones, sigma, None, options)
    posed, points, notes = world_from_people(posed, adjusted.state.points, names, options.height)
    # Once more in metres: the bones' tolerance is in them. The lenses' prior stays where it was.
    lenses = CameraGroup(tuple(c.posed(p.cam_from_world) for c, p in zip(cameras, posed, strict=True)))
    start = replace(_state(lenses, points, bones), log_focal=adjusted.state.log_focal)
    adjusted, posed, noise = _adjusted(lenses, px, variance, start, bones, sigma, None, options)
    posed, points, notes = world_from_people(posed, adjusted.state.points, names, options.height)
    adjusted = replace(adjusted, state=replace(adjusted.state, points=points))
    return _result(posed, adjusted, frames, noise, notes)


def _flattened(
    cameras: CameraGroup, points_px: FloatArray, variance_px2: FloatArray, names: Sequence[str]
) -> tuple[FloatArray, FloatArray, int]:
    """(C, T, P J, 2) and (C, T, P J), NaN together, and P."""
    px = np.array(points_px, dtype=np.float64)
    variance = np.array(variance_px2, dtype=np.float64)
    if px.ndim == 4:
        px, variance = px[:, :, None], variance[:, :, None] if variance.ndim == 3 else variance
    if px.ndim != 5 or px.shape[:-1] != variance.shape or px.shape[-1] != 2:
        raise ValueError(f"points_px is {px.shape}, variance_px2 {variance.shape}: they do not match")
    if px.shape[0] != len(cameras) or px.shape[3] != len(names):
        raise ValueError(f"{px.shape[0]} cameras and {px.shape[3]} landmarks, not {len(cameras)} and {len(names)}")
    missing = ~(np.isfinite(px).all(axis=-1) & (variance > 0) & np.isfinite(variance))
    px[missing], variance[missing] = np.nan, np.nan
    c, t, p, j = variance.shape
    return px.reshape(c, t, p * j, 2), variance.reshape(c, t, p * j), p


def _chosen_frames(
    cameras: CameraGroup, px: FloatArray, variance: FloatArray, options: PeopleCalibrationOptions
) -> IndexArray:
    """Frames in which two cameras see something, evenly spread where there are too many."""
    seen = np.isfinite(variance)
    shared = (seen.sum(axis=0) >= 2).sum(axis=1) >= 4
    for c, name in enumerate(cameras.names):
        others = np.delete(seen, c, axis=0).any(axis=0)
        if (seen[c] & others).any(axis=1).sum() < _FEWEST_FRAMES:
            raise CalibrationError(
                f"camera {name} shares a person with no other camera in {_FEWEST_FRAMES} frames or more: "
                "let the person walk where it and another camera see them",
                remedy="leave_out_camera",
            )
    frames = np.flatnonzero(shared)
    if len(frames) < _FEWEST_FRAMES:
        raise CalibrationError(
            f"only {len(frames)} frames show a person to two cameras at once, {_FEWEST_FRAMES} are needed; "
            "record for longer, with the whole person in view"
        )
    if len(frames) > options.max_frames:
        frames = frames[np.linspace(0, len(frames) - 1, options.max_frames).round().astype(np.intp)]
    return frames


def _all_bones(names: Sequence[str], people: int, options: PeopleCalibrationOptions) -> tuple[IndexArray, FloatArray]:
    pairs, sigma = bone_pairs(names)
    if not options.bones:
        pairs, sigma = pairs[:0], sigma[:0]
    every = np.concatenate([pairs + p * len(names) for p in range(people)])
    return every, np.tile(sigma, people)


def _state(cameras: CameraGroup, points: FloatArray, bones: IndexArray) -> ArticulatedState:
    vector = points[:, bones[:, 0]] - points[:, bones[:, 1]]
    length = np.linalg.norm(vector, axis=-1)
    known = np.isfinite(length).any(axis=0)
    lengths = np.zeros(len(bones))
    lengths[known] = np.nanmedian(length[:, known], axis=0)
    rotations = cameras.cam_from_world[:, :, :3]
    return ArticulatedState(rotations, cameras.centers_world, np.zeros(len(cameras)), points, lengths)


def _adjusted(
    cameras: CameraGroup,
    px: FloatArray,
    variance: FloatArray,
    state: ArticulatedState,
    bones: IndexArray,
    bone_sigma: FloatArray,
    prior: tuple[float, float] | None,
    options: PeopleCalibrationOptions,
) -> tuple[ArticulatedResult, CameraGroup, float]:
    """Adjust, with the noise as the take shows it; the adjusted cameras and the noise beside the result."""
    relative = np.sqrt(variance / np.nanmedian(variance))
    noise, alike, start = _FIRST_NOISE_PX, 1.0, state
    focal = np.array([np.sqrt(c.camera_matrix[0, 0] * c.camera_matrix[1, 1]) for c in cameras])
    seen = cameras.unproject(px)
    for _ in range(_NOISE_ROUNDS):
        problem = ArticulatedProblem(
            seen=seen,
            focal_px=focal,
            sigma_px=noise * relative,
            bones=bones,
            bone_sigma=bone_sigma,
            focal_sigma=options.focal_sigma,
            pose_sigma=prior,
            prior_worth=alike,
            loss_sigma=options.loss_sigma,
        )
        adjusted = adjust_articulated(problem, start, options.max_iterations)
        start = replace(start, points=adjusted.state.points, lengths=adjusted.state.lengths)
        if prior is None:
            start = adjusted.state
        noise, alike = _noise(adjusted.residual_px, relative), _frames_alike(adjusted.error_px, noise)
    poses = np.concatenate(
        [adjusted.state.rotations, -adjusted.state.rotations @ adjusted.state.centers[..., None]], axis=-1
    )
    posed = CameraGroup(
        tuple(_zoomed(c.posed(p), np.exp(s)) for c, p, s in zip(cameras, poses, adjusted.state.log_focal, strict=True))
    )
    return adjusted, posed, noise


def _zoomed(camera: Camera, factor: float) -> Camera:
    """The camera with its focal lengths times a factor."""
    if factor == 1.0:
        return camera
    params = list(camera.params)
    for index in colmap_camera(camera).focal_length_idxs():
        params[index] *= factor
    return replace(camera, params=tuple(params))


def _noise(residual_px: FloatArray, relative: FloatArray) -> float:
    """Standard deviation of a point of median quality; each 3D point takes three of its residuals' freedoms."""
    seen = np.isfinite(residual_px)
    views = np.broadcast_to(seen.sum(axis=0), seen.shape)[seen]
    student_dof = np.maximum(1 - 3 / (2 * np.maximum(views, 2)), 0.25)
    scaled = residual_px[seen] / relative[seen] / np.sqrt(student_dof)
    return float(max(np.median(scaled) / _RAYLEIGH_MEDIAN, 0.1))


def _frames_alike(error_px: FloatArray, noise: float) -> float:
    """How many frames count as one: a landmark's error in a camera is much the same for many frames.

    The variance of each error's mean over the take, over what it would be if frames were independent. The
    prior on the poses must be weighed against what the frames are worth, not against their number.
    """
    clipped = np.clip(error_px, -3 * noise, 3 * noise)
    count = np.isfinite(clipped[..., 0]).sum(axis=1)
    used = count >= _FEWEST_FRAMES
    if not used.any():
        return 1.0
    series = np.moveaxis(clipped, 1, -1)[used]  # (n, 2, T)
    mean = np.nanmean(series, axis=-1)
    power = np.nanmean(series**2, axis=-1)
    alike = (count[used][:, None] * mean**2).sum() / max(power.sum(), 1e-12)
    return float(np.clip(alike, 1.0, error_px.shape[1]))


def _result(
    cameras: CameraGroup, adjusted: ArticulatedResult, frames: IndexArray, noise: float, notes: Sequence[str]
) -> PeopleCalibration:
    sd = np.sqrt(np.maximum(np.diag(adjusted.covariance), 0)).reshape(-1, 7)
    return PeopleCalibration(
        cameras=cameras,
        rotation_sd_deg=np.degrees(sd[:, :3]),
        center_sd=sd[:, 3:6],
        focal_sd=sd[:, 6],
        frames=frames,
        points_world=adjusted.state.points,
        residual_px=adjusted.residual_px,
        noise_px=noise,
        notes=tuple(notes),
    )
