"""Functional joint centres, from movement: SCoRE and sphere fits."""

from dataclasses import dataclass

import numpy as np

from muybridge.arrays import FloatArray
from muybridge.geometry.numerics.rotations import kabsch


@dataclass(frozen=True, eq=False)
class Centre:
    """A centre of rotation between two bones.

    Attributes:
        in_first, in_second: (3,) metres in each bone's axes.
        residual_m: root mean square distance between the two over the take.
        sigma_m: (3,) standard deviation of `in_first` by the residual and how far the motion reaches; large about an
            axis that the bones hardly turn across.
    """

    in_first: FloatArray
    in_second: FloatArray
    residual_m: float
    sigma_m: FloatArray


def segment_poses(points: FloatArray, reference: FloatArray | None = None) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Poses of a rigid cluster of markers: rotations (T, 3, 3), origins (T, 3), reference (K, 3).

    NaN where fewer than three of its markers are known.

    Args:
        points: (T, K, 3) metres.
        reference: (K, 3) the cluster at rest; None takes the frame with most markers, refined over the take.
    """
    if reference is None:
        best = int(np.argmax(np.isfinite(points[..., 0]).sum(1)))
        reference = points[best]
        for _ in range(4):
            turns, places = _rigid(points, reference)
            back = np.einsum("tij,tki->tkj", turns, points - places[:, None])
            with np.errstate(invalid="ignore"):
                reference = np.where(np.isfinite(back).any(0), _nanmean(back), np.nan)
        reference = reference - np.nanmean(reference, 0)
    return *_rigid(points, reference), reference


def _nanmean(values: FloatArray) -> FloatArray:
    known = np.isfinite(values)
    return np.asarray(np.where(known, values, 0.0).sum(0) / np.maximum(known.sum(0), 1))


def _rigid(points: FloatArray, reference: FloatArray) -> tuple[FloatArray, FloatArray]:
    known = np.isfinite(points[..., 0]) & np.isfinite(reference[:, 0])
    weight = known / np.maximum(known.sum(1), 1)[:, None]
    p, q = np.where(known[..., None], points, 0.0), np.where(np.isfinite(reference), reference, 0.0)
    mean_p, mean_q = np.einsum("tk,tki->ti", weight, p), weight @ q
    turns = kabsch(q[None] - mean_q[:, None], p - mean_p[:, None], weight)
    places = mean_p - np.einsum("tij,tj->ti", turns, mean_q)
    enough = known.sum(1) >= 3
    turns[~enough], places[~enough] = np.nan, np.nan
    return turns, places


def score_centre(
    turns: FloatArray,
    places: FloatArray,
    turns_other: FloatArray,
    places_other: FloatArray,
    rounds: int = 8,
    student_dof: float = 4.0,
) -> Centre:
    """The point that two moving bones share (SCoRE), robust against frames in which they do not.

    Args:
        turns, places: (T, 3, 3) and (T, 3) metres, world from the first bone; NaN where unknown.
        turns_other, places_other: of the second.
        rounds: of robust weights (Student's t with `student_dof`).

    Raises:
        ValueError: fewer than four frames are known.
    """
    known = np.isfinite(places).all(-1) & np.isfinite(places_other).all(-1)
    if known.sum() < 4:
        raise ValueError(f"a centre of rotation needs at least 4 frames that know both bones, not {known.sum()}")
    design = np.concatenate([turns[known], -turns_other[known]], axis=-1)
    target = places_other[known] - places[known]
    weight = np.ones(len(target))
    for _ in range(rounds):
        matrix = np.einsum("t,tki,tkj->ij", weight, design, design)
        value = np.linalg.lstsq(matrix, np.einsum("t,tki,tk->i", weight, design, target), rcond=1e-9)[0]
        square = np.sum((design @ value - target) ** 2, axis=-1)
        scale = max(float(np.median(square)) / 2.366, 1e-12)
        weight = np.minimum((student_dof + 3) / (student_dof + square / scale), 1.0)
    spread = np.linalg.pinv(matrix, rcond=1e-12) * scale
    residual = float(np.sqrt(np.sum(weight * square) / np.sum(weight)))
    return Centre(value[:3], value[3:], residual, np.sqrt(np.maximum(np.diag(spread)[:3], 0.0)))


def sphere_centre(points: FloatArray, rounds: int = 30, student_dof: float = 4.0) -> tuple[FloatArray, float]:
    """The common centre of the spheres that markers move on.

    The start is Gamage and Lasenby's closed form, which noise draws towards the markers where the motion is small; from
    there Gauss-Newton on the distances themselves, which hardly has that bias, with robust weights.

    Args:
        points: (T, K, 3) metres in the axes of the bone that holds the centre; NaN where missing.
        rounds: of Gauss-Newton; 0 is the closed form alone.
        student_dof: of Student's t.

    Returns:
        (3,) metres, and the standard deviation of the markers' distances from it, metres.

    Raises:
        ValueError: no marker is known in four frames, or they hardly move.
    """
    tracks = [points[np.isfinite(points[:, k]).all(-1), k] for k in range(points.shape[1])]
    tracks = [p for p in tracks if len(p) >= 4]
    if not tracks:
        raise ValueError("no marker is known in at least four frames, so there is no centre")
    matrix, fixed = np.zeros((3, 3)), np.zeros(3)
    origin = np.concatenate(tracks).mean(0)
    for p in tracks:
        off, square = p - p.mean(0), np.sum((p - origin) ** 2, axis=-1)
        matrix += 2 * off.T @ off / len(p)
        fixed += (square - square.mean()) @ off / len(p)
    if np.linalg.cond(matrix) > 1e7:
        raise ValueError("the markers hardly move about the centre, so it cannot be determined")
    centre = origin + np.linalg.solve(matrix, fixed)
    if not rounds:
        return centre, float(np.sqrt(np.mean([np.var(np.linalg.norm(p - centre, axis=-1)) for p in tracks])))
    # The closed form may be so near to the markers that distances lead nowhere: from farther out as well.
    away = centre - origin
    found = [_by_distances(tracks, origin + k * away, rounds, student_dof) for k in (1.0, 2.5, 6.0)]
    return min(found, key=lambda f: f[1])


def _by_distances(
    tracks: list[FloatArray], centre: FloatArray, rounds: int, student_dof: float
) -> tuple[FloatArray, float]:
    scale, weights = 0.0, [np.ones(len(p)) for p in tracks]
    for _ in range(rounds):
        matrix, fixed, squares = np.zeros((3, 3)), np.zeros(3), []
        for k, p in enumerate(tracks):
            far = np.linalg.norm(p - centre, axis=-1)
            off = far - np.average(far, weights=weights[k])
            towards = (p - centre) / np.maximum(far, 1e-9)[:, None]
            towards -= np.average(towards, axis=0, weights=weights[k])
            matrix += (towards * weights[k][:, None]).T @ towards
            fixed += (towards * weights[k][:, None]).T @ off
            squares.append(off**2)
        scale = max(float(np.median(np.concatenate(squares))) / 0.4549, 1e-14)
        weights = [np.minimum((student_dof + 1) / (student_dof + s / scale), 1.0) for s in squares]
        step = np.linalg.solve(matrix + 1e-9 * np.trace(matrix) * np.eye(3), fixed)
        centre = centre + step * min(1.0, 0.1 / max(float(np.linalg.norm(step)), 1e-12))
        if np.linalg.norm(step) < 1e-7:
            break
    return centre, float(np.sqrt(scale))
