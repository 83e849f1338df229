"""Registration curves: which frames of several motions belong together, and how these lie on the ground.

Kovar and Gleicher 2003, "Flexible Automatic Motion Blending with Registration Curves": a time warp, and a curve of
alignments along it. Here the curve says where in each motion the ground under the reference's hips is, and which way
there is forward; that is the frame in which poses are blended, and its steps make the way of the blend.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.interpolate import BSpline, PchipInterpolator, make_lsq_spline

from muybridge.arrays import FloatArray
from muybridge.errors import MuybridgeError
from muybridge.geometry.skeleton.motion import Motion
from muybridge.motion.blending.alignment import cloud_windows, planar_alignment, point_cloud
from muybridge.motion.blending.distances import point_weights, window_alignments
from muybridge.motion.blending.material import facing_frames
from muybridge.motion.blending.time_warp import fit_warp, warp_path
from muybridge.motion.editing.root_path import GroundPath
from muybridge.wording import counted

_FEWEST = 3  # frames of a motion
_MOST_COMPARED = 2000  # frames of a motion in the grid of distances


@dataclass(frozen=True)
class RegistrationOptions:
    """How motions are registered.

    Attributes:
        window: seconds of frames that are compared as one cloud of points.
        slope: frames of one motion that go by, at most, while one of the other does.
        free: share of a motion that may be left out at either end, where the other one has nothing like it.
        knots: seconds between the knots of the time warps and alignment curves.
        compared: frames per second that are compared.
    """

    window: float = 0.33
    slope: float = 3.0
    free: float = 0.25
    knots: float = 0.2
    compared: float = 30.0


@dataclass(frozen=True, eq=False)
class RegistrationCurve:
    """Several motions over one parameter u: the frames of the reference.

    Attributes:
        motions: of one skeleton and one frame rate.
        reference: index of the one that the others were registered to.
        start: the first u at which all motions are there.
        end: the last one.
        warps: u -> frame of each motion, increasing.
        paths: frame of the blend's coordinates in each motion at `knots_u`, on its ground.
        knots_u: (K,) the u at which they are given.
        costs: (N,) metres, root mean square distance of each motion's points to the reference's along the curve.
    """

    motions: tuple[Motion, ...]
    reference: int
    start: float
    end: float
    warps: tuple[PchipInterpolator, ...]
    paths: tuple[GroundPath, ...]
    knots_u: FloatArray
    costs: FloatArray

    def frames(self, u: FloatArray) -> FloatArray:
        """(N, ...) frames of the motions that belong together at each u (...)."""
        last = [len(m) - 1 for m in self.motions]
        return np.stack([np.clip(warp(u), 0, n) for warp, n in zip(self.warps, last, strict=True)])

    def rates(self, u: FloatArray) -> FloatArray:
        """(N, ...) frames of each motion that go by a frame of the reference."""
        return np.stack([np.asarray(warp(u, 1)) for warp in self.warps])

    def path(self, motion: int, u: FloatArray) -> GroundPath:
        """Where the blend's coordinates are in a motion at each u (U,)."""
        known = self.paths[motion]
        places = np.stack([np.interp(u, self.knots_u, known.places[:, k]) for k in range(2)], axis=1)
        return GroundPath(places, np.interp(u, self.knots_u, known.yaw))


def register(
    motions: Sequence[Motion], names: Sequence[str], options: RegistrationOptions | None = None,
    reference: int | None = None,
) -> RegistrationCurve:  # fmt: skip
    """Find which frames of motions belong together, and how they lie on the ground.

    Args:
        motions: at least one, of one skeleton and one frame rate (`same_skeleton`), Z up.
        names: of the motions, for messages.
        options: how.
        reference: the motion that the others are registered to; None takes the one that is most like the others.

    Raises:
        MuybridgeError: a motion has fewer than three frames, or no time warp leads from one to another. The message
            names it.
    """
    options = options or RegistrationOptions()
    for motion, name in zip(motions, names, strict=True):
        if len(motion) < _FEWEST:
            raise MuybridgeError(f"{name} has {counted(len(motion), 'frame')}, and a blend needs at least {_FEWEST}")
    weights = point_weights(motions[0].skeleton)
    clouds = [point_cloud(m) for m in motions]
    if reference is None:
        reference = _most_alike(motions, clouds, names, weights, options) if len(motions) > 2 else 0
    warps, costs = [], []
    for k in range(len(motions)):
        warp, cost = _warp(motions, clouds, names, weights, reference, k, options)
        warps.append(warp)
        costs.append(cost)
    start, end = max(w.x[0] for w in warps), min(w.x[-1] for w in warps)
    if end - start < _FEWEST - 1:
        raise MuybridgeError(f"{', '.join(names)} have no frames in common that all of them go through")
    u = np.linspace(start, end, max(round(end - start), 2) + 1)
    own = [facing_frames(m, options.window) for m in motions]
    base = _along(own[reference], warps[reference](u))
    paths = [
        base if k == reference
        else _aligned_path(base, _along(own[k], warps[k](u)), _at(clouds[reference], warps[reference](u)),
                           _at(clouds[k], warps[k](u)), weights, motions[k].fps, options)
        for k in range(len(motions))
    ]  # fmt: skip
    return RegistrationCurve(
        tuple(motions), reference, float(start), float(end), tuple(warps), tuple(paths), u, np.array(costs)
    )


def distance_grid(
    clouds: tuple[FloatArray, FloatArray], fps: float, weights: FloatArray, options: RegistrationOptions
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Mean squared distances (T, S) of the windows of two clouds, metres squared, and the frames (T,), (S,) compared.

    Args:
        clouds: (frames, N, 3) metres each.
        fps: frames per second.
        weights: (N,) of the points.
        options: how.
    """
    rate = min(options.compared, fps)
    at = []
    for cloud in clouds:
        count = int(np.clip(np.ceil((len(cloud) - 1) * rate / fps) + 1, 2, _MOST_COMPARED))
        at.append(np.unique(np.round(np.linspace(0, len(cloud) - 1, count)).astype(int)))
    half = max(round(0.5 * options.window * rate), 1)
    found = window_alignments(clouds[0][at[0]], clouds[1][at[1]], half, weights)
    return found.distance, at[0].astype(np.float64), at[1].astype(np.float64)


def _warp(
    motions: Sequence[Motion], clouds: Sequence[FloatArray], names: Sequence[str], weights: FloatArray, reference: int,
    k: int, options: RegistrationOptions,
) -> tuple[PchipInterpolator, float]:  # fmt: skip
    """The time warp of one motion as a function of the reference's frames, and the distance along it."""
    if k == reference:
        whole = np.arange(len(motions[k]), dtype=np.float64)
        return PchipInterpolator(whole, whole), 0.0
    fps = motions[k].fps
    grid, rows, columns = distance_grid((clouds[reference], clouds[k]), fps, weights, options)
    try:
        way = warp_path(grid, options.free, max(round(options.slope), 2))
    except ValueError as error:
        raise MuybridgeError(f"{names[k]} ({len(motions[k])} frames) and {names[reference]} "
                             f"({len(motions[reference])} frames) differ too much in length to be blended; cut them "
                             "to the same movement first") from error  # fmt: skip
    cost = float(np.sqrt(grid[way[:, 0], way[:, 1]].mean()))
    pairs = np.stack([rows[way[:, 0]], columns[way[:, 1]]], axis=1)
    warp = fit_warp(pairs, options.knots * fps, options.slope)
    u = np.linspace(warp.start, warp.end, max(round(warp.end - warp.start), 2) + 1)
    mine, theirs = warp.frames(u)
    inside = (mine > -1e-9) & (mine < len(clouds[reference]) - 1 + 1e-9)
    inside &= (theirs > -1e-9) & (theirs < len(clouds[k]) - 1 + 1e-9)
    if inside.sum() < 2:
        inside[:] = True
    return PchipInterpolator(mine[inside], theirs[inside]), cost


def _most_alike(
    motions: Sequence[Motion], clouds: Sequence[FloatArray], names: Sequence[str], weights: FloatArray,
    options: RegistrationOptions,
) -> int:  # fmt: skip
    """The motion to which the others have the least distance."""
    count = len(motions)
    costs = np.zeros((count, count))
    for a in range(count):
        for b in range(a):
            costs[a, b] = costs[b, a] = _warp(motions, clouds, names, weights, a, b, options)[1]
    return int(np.argmin(costs.sum(axis=1)))


def _at(cloud: FloatArray, frames: FloatArray) -> FloatArray:
    """(U, N, 3) the points at times between frames."""
    frames = np.clip(frames, 0, len(cloud) - 1)
    before = np.minimum(frames.astype(np.intp), len(cloud) - 2)
    share = (frames - before)[:, None, None]
    return np.asarray((1 - share) * cloud[before] + share * cloud[before + 1])


def _along(path: GroundPath, frames: FloatArray) -> GroundPath:
    """A path at times between frames."""
    whole = np.arange(len(path.yaw))
    places = np.stack([np.interp(frames, whole, path.places[:, k]) for k in range(2)], axis=1)
    return GroundPath(places, np.interp(frames, whole, path.yaw))


def _aligned_path(
    base: GroundPath, own: GroundPath, reference: FloatArray, moved: FloatArray, weights: FloatArray, fps: float,
    options: RegistrationOptions,
) -> GroundPath:  # fmt: skip
    """The reference's path as it lies in another motion once that is aligned to it at each u.

    Args:
        base: (U,) the reference's path.
        own: (U,) the other motion's own path, to which the result is near.
        reference: (U, N, 3) the reference's points.
        moved: (U, N, 3) the other motion's.
        weights: (N,) of the points.
        fps: frames per second, about, of u.
        options: how.
    """
    half = min(max(round(0.5 * options.window * fps), 1), (len(moved) - 1) // 2)
    size = 2 * half + 1
    windows = [cloud_windows(np.pad(c, ((half, half), (0, 0), (0, 0)), mode="edge"), size) for c in (reference, moved)]
    found = planar_alignment(windows[0], windows[1], np.tile(weights, size) / size)
    c, s = np.cos(-found.yaw), np.sin(-found.yaw)
    x, y = (base.places - found.shift).T
    places = np.stack([c * x - s * y, s * x + c * y], axis=1)
    # What is smoothed is seen from the motion's own path, since a turn moves what is far from the origin.
    c, s = np.cos(own.yaw), np.sin(own.yaw)
    x, y = (places - own.places).T
    turn = np.unwrap(np.angle(np.exp(1j * (base.yaw - found.yaw - own.yaw))))
    seen = _smoothed(np.stack([c * x + s * y, c * y - s * x, turn], axis=1), options.knots * fps)
    x, y, turn = seen.T
    return GroundPath(own.places + np.stack([c * x - s * y, s * x + c * y], axis=1), own.yaw + turn)


def _smoothed(values: FloatArray, knot_frames: float) -> FloatArray:
    """(U, K) a spline of degree two by least squares, with knots about so many frames apart."""
    count, degree = len(values), 2
    if count < 2 * (degree + 1):
        return np.broadcast_to(values.mean(axis=0), values.shape)
    pieces = int(np.clip(round(count / knot_frames), 1, (count - degree) // 2))
    x = np.arange(count, dtype=np.float64)
    inner = np.linspace(0, count - 1, pieces + 1)
    knots = np.concatenate([[0.0] * degree, inner, [count - 1.0] * degree])
    spline: BSpline = make_lsq_spline(x, values, knots, degree)
    return np.asarray(spline(x))
