"""Labelled marker takes with the truth of every joint, and faults of marker recordings."""

from dataclasses import dataclass, replace

import numpy as np

from muybridge.arrays import BoolArray, Float32Array, FloatArray, IndexArray
from muybridge.geometry.landmarks.marker_sets import SURFACE, MarkerSet
from muybridge.geometry.skeleton.motion import Motion
from muybridge.train.synthesis.bodies.surface_markers import marker_table
from muybridge.train.synthesis.markers.augment import LOOSE
from muybridge.train.synthesis.markers.rig import BODY_JOINTS, follow, joints_of, rig_of
from muybridge.train.synthesis.markers.trajectories import MarkerBodies
from muybridge.train.synthesis.motions.rig import SkinnedBody, forward, skin, turn

# Range of markers that laboratories place anywhere along a limb, as in the labelling network's training, metres.
ALONG_M = 0.03


@dataclass(frozen=True)
class SolverTake:
    """Markers of one person and the truth.

    Attributes:
        points: (T, M, 3) metres, in the order of SURFACE.
        turns: (T, J, 3, 3) world_from_joint rotations of BODY's joints, T-pose at rest.
        places: (T, J, 3) their positions, metres.
        fps: frames per second.
    """

    points: FloatArray
    turns: FloatArray
    places: FloatArray
    fps: float

    def frames(self, chosen: slice) -> "SolverTake":
        """Some of the frames."""
        return replace(self, points=self.points[chosen], turns=self.turns[chosen], places=self.places[chosen])


@dataclass(frozen=True)
class MarkerFaults:
    """Faults of labelled markers.

    Attributes:
        hidden: share of samples that are missing.
        shifted: share of samples that are displaced.
        far_m: largest displacement, metres; its size is uniform, its direction random.
        noise_m: standard deviation per coordinate, metres.
        run_s: mean length of a gap or displacement, seconds; 0: every sample is independent.
    """

    hidden: float = 0.1
    shifted: float = 0.1
    far_m: float = 0.05
    noise_m: float = 0.002
    run_s: float = 0.0


def recorded_take(bodies: MarkerBodies, phenotype: Float32Array, motion: Motion, placement: float = 1.0) -> SolverTake:
    """A body of anny that follows a recording, with markers placed as in laboratories.

    Args:
        bodies: their generator draws the placement.
        phenotype: of the body.
        motion: see `markers.rig.follow`.
        placement: factor on the standard deviation of the placement.
    """
    body = bodies.skeleton(phenotype)
    rotvec, root = follow(body, motion)
    return take_of(bodies, body, rotvec, root, motion.fps, placement)


def take_of(
    bodies: MarkerBodies, body: SkinnedBody, rotvec: FloatArray, root: FloatArray, fps: float, placement: float
) -> SolverTake:
    """Markers and truth of a motion of `body`; each marker stays where it was placed on the skin."""
    jitter = bodies.rng.normal(0, 1, (len(SURFACE), 3)) * placement_spread()[:, None] * placement
    points, normals = bodies.markers(body, rotvec, root)
    # Displaced along the skin, rotating with the triangle that carries the marker.
    rotations, origins = forward(body, turn(rotvec), root)
    corners = skin(body, rotations, origins)[:, bodies.place]
    first = corners[:, :, 1] - corners[:, :, 0]
    first -= (first * normals).sum(-1, keepdims=True) * normals
    first /= np.linalg.norm(first, axis=-1, keepdims=True) + 1e-12
    frame = np.stack([first, np.cross(normals, first), normals], -1)
    points = points + np.einsum("tmij,mj->tmi", frame, jitter * [1, 1, 0.25])
    turns, places = joints_of(rig_of(body.bones, body.rest), body, rotvec, root)
    return SolverTake(points, turns[:, BODY_JOINTS], places[:, BODY_JOINTS], fps)


def placement_spread() -> FloatArray:
    """(M,) metres, standard deviation of where laboratories place each marker of SURFACE along the skin."""
    sigma = marker_table().tolerance_m.astype(np.float64)
    for name, value in LOOSE.items():
        sigma[SURFACE.index(name)] = value
    return sigma


def add_faults(
    points: FloatArray, fps: float, how: MarkerFaults, rng: np.random.Generator
) -> tuple[FloatArray, BoolArray]:
    """Corrupted points (T, M, 3), NaN where hidden, and (T, M) which were displaced."""
    shape = points.shape[:2]
    hidden = _marks(shape, how.hidden, how.run_s * fps, rng)
    shifted = _marks(shape, how.shifted, how.run_s * fps, rng) & ~hidden
    towards = rng.normal(size=(*shape, 3))
    towards /= np.linalg.norm(towards, axis=-1, keepdims=True)
    shift = towards * rng.uniform(0, how.far_m, (*shape, 1))
    if how.run_s > 0:
        # One displacement per run.
        for t in range(1, shape[0]):
            go_on = shifted[t] & shifted[t - 1]
            shift[t, go_on] = shift[t - 1, go_on]
    out = points + rng.normal(0, how.noise_m, points.shape) + np.where(shifted[..., None], shift, 0.0)
    out[hidden] = np.nan
    return out, shifted


def _marks(shape: tuple[int, int], share: float, run: float, rng: np.random.Generator) -> BoolArray:
    """(T, M) true for a share of the samples, in runs of geometric length with mean `run`."""
    if run <= 1:
        return rng.random(shape) < share
    out = np.zeros(shape, np.bool_)
    begin, end = share / (1 - share) / run, 1 / run
    now = rng.random(shape[1]) < share
    for t in range(shape[0]):
        out[t] = now
        now = np.where(now, rng.random(shape[1]) >= end, rng.random(shape[1]) < begin)
    return out


def marker_columns(markers: MarkerSet) -> IndexArray:
    """Positions of a set's markers in SURFACE."""
    return np.array(markers.surface_indices, dtype=np.intp)
