"""Cameras from nothing but views of a board: lenses one by one, poses chained, one adjustment over all."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import cv2
import numpy as np
from numpy.typing import NDArray

from muybridge.errors import CalibrationError
from muybridge.geometry.calibration.adjust import AdjustProblem, AdjustResult, FreeCamera, adjust
from muybridge.geometry.calibration.board import Board
from muybridge.geometry.cameras import Camera, CameraGroup

Floats = NDArray[np.float64]
View = tuple[NDArray[np.int64], Floats]
"""Numbers of a board's corners and their (n, 2) px."""
FEWEST_VIEWS = 4
_FEWEST_CORNERS = 6
_CORNER_SIGMA_PX = 0.3
_OUT_OF_STEP = 2.5


@dataclass(frozen=True)
class RigCalibration:
    """Cameras from a moved board.

    Attributes:
        cameras: in the first camera's axes.
        adjusted: the adjustment that they come from.
        camera: (N,) camera of each of its observations.
        apart: (camera, time) of views that did not fit the others of that time and so say nothing of the poses.
    """

    cameras: CameraGroup
    adjusted: AdjustResult
    camera: NDArray[np.int64]
    apart: tuple[tuple[str, int], ...]


def calibrate_lens(name: str, board: Board, views: Sequence[View], size: tuple[int, int]) -> Camera:
    """A camera's lens (OPENCV model) from views of a board; its pose is the identity.

    Raises:
        CalibrationError: too few views.
    """
    good = [v for v in views if len(v[0]) >= _FEWEST_CORNERS]
    if len(good) < FEWEST_VIEWS:
        raise CalibrationError(
            f"camera {name}: the board is seen in {len(good)} usable views of {len(views)}, at least {FEWEST_VIEWS} "
            "are needed; show it closer, flatter lit and from more sides"
        )
    objects = [board.corners[ids].astype(np.float32).reshape(-1, 1, 3) for ids, _ in good]
    images = [px.astype(np.float32).reshape(-1, 1, 2) for _, px in good]
    _, matrix, bend, _, _ = cv2.calibrateCamera(objects, images, size, None, None, flags=cv2.CALIB_FIX_K3)
    k = np.asarray(bend).ravel()[:4]
    params = (matrix[0, 0], matrix[1, 1], matrix[0, 2], matrix[1, 2], *k)
    return Camera(name, "OPENCV", size[0], size[1], tuple(map(float, params)), np.eye(4)[:3])


def calibrate_rig(
    board: Board, views: Mapping[str, Mapping[int, View]], sizes: Mapping[str, tuple[int, int]]
) -> RigCalibration:
    """Cameras that saw a moved board at the same times; the first camera is the world.

    Args:
        board: what was moved.
        views: by camera and by time.
        sizes: (width, height) px by camera.

    Raises:
        CalibrationError: too few views of a camera, or one that shares no view with the rest (named).
    """
    names = list(views)
    lenses = [calibrate_lens(n, board, list(views[n].values()), sizes[n]) for n in names]
    seen: list[dict[int, Floats]] = [
        {t: _board_pose(c, board, v) for t, v in views[c.name].items() if len(v[0]) >= _FEWEST_CORNERS}
        for c in lenses
    ]
    poses = _chain(names, seen)
    cameras = CameraGroup(tuple(c.posed(p[:3]) for c, p in zip(lenses, poses, strict=True)))
    times = sorted(set().union(*seen))
    bodies = []
    for t in times:  # the camera that sees most of the board says where it starts
        c = max((c for c in range(len(names)) if t in seen[c]), key=lambda c: len(views[names[c]][t][0]))
        bodies.append(np.linalg.inv(poses[c]) @ seen[c][t])
    rows = [(c, b, *views[names[c]][t]) for c in range(len(names)) for b, t in enumerate(times) if t in seen[c]]
    camera = np.concatenate([np.full(len(ids), c) for c, _, ids, _ in rows])
    free = [FreeCamera(True, True, True, pose=c > 0) for c in range(len(names))]
    problem = AdjustProblem(
        cameras=cameras, camera=camera, point=np.concatenate([r[2] for r in rows]),
        pixels=np.concatenate([r[3] for r in rows]), sigma_px=np.full(len(camera), _CORNER_SIGMA_PX),
        points=board.corners, points_free=np.zeros(len(board.corners), bool), free=tuple(free),
        body=np.concatenate([np.full(len(ids), b) for _, b, ids, _ in rows]), bodies=np.stack(bodies)[:, :3],
    )  # fmt: skip
    return _adjust_in_step(problem, [(names[c], times[b]) for c, b, _, _ in rows], [len(r[2]) for r in rows])


def _adjust_in_step(problem: AdjustProblem, views: list[tuple[str, int]], counts: list[int]) -> RigCalibration:
    """Adjust, with views that were not taken when the others were counted for their own camera's lens only.

    Cameras that are triggered by software are milliseconds apart; where the board moved fast, its pose differs
    between them by more than the corners' noise. Such a view gets a pose of the board of its own.
    """
    view = np.repeat(np.arange(len(views)), counts)
    everything = problem.free
    held = tuple(FreeCamera(pose=f.pose) for f in everything)
    result = adjust(replace(problem, free=held, loss_sigma=10.0))
    apart: set[int] = set()
    for free in (held, everything, everything, everything):
        squares = np.nan_to_num((result.residuals_px**2).sum(axis=1), nan=1e6)
        rms = np.sqrt(np.bincount(view, squares) / counts)
        late = set(np.nonzero(rms > max(_OUT_OF_STEP * float(np.median(rms)), 2 * _CORNER_SIGMA_PX))[0]) - apart
        body, bodies = problem.body.copy(), [*result.bodies]
        for v in sorted(late):
            bodies.append(result.bodies[body[view == v][0]])
            body[view == v] = len(bodies) - 1
        apart |= late
        problem = replace(
            problem, cameras=result.cameras, bodies=np.stack(bodies), body=body, free=free, loss_sigma=3.0
        )
        result = adjust(problem)
    return RigCalibration(result.cameras, result, problem.camera, tuple(views[v] for v in sorted(apart)))


def _board_pose(camera: Camera, board: Board, view: View) -> Floats:
    """(4, 4) cam_from_board."""
    ids, px = view
    slopes = camera.unproject(px)
    _, turn, shift = cv2.solvePnP(board.corners[ids], slopes, np.eye(3), np.zeros(4), flags=cv2.SOLVEPNP_IPPE)
    out = np.eye(4)
    out[:3, :3], out[:3, 3] = cv2.Rodrigues(turn)[0], shift.ravel()
    return out


def _chain(names: Sequence[str], seen: Sequence[Mapping[int, Floats]]) -> list[Floats]:
    """(4, 4) cam_from_first of each camera, over the pairs that share most views."""
    poses: dict[int, Floats] = {0: np.eye(4)}
    while len(poses) < len(names):
        new = [b for b in range(len(names)) if b not in poses]
        pairs = [(len(seen[a].keys() & seen[b].keys()), a, b) for a in poses for b in new]
        most, a, b = max(pairs)
        if most == 0:
            lost = ", ".join(n for k, n in enumerate(names) if k not in poses)
            raise CalibrationError(
                f"{lost}: no view of the board is shared with the other cameras; show it where both see it at once"
            )
        relative = np.stack([seen[b][t] @ np.linalg.inv(seen[a][t]) for t in sorted(seen[a].keys() & seen[b].keys())])
        turn = np.einsum("nij,mij->nm", relative[:, :3, :3], relative[:, :3, :3])
        apart = np.arccos(np.clip((turn - 1) / 2, -1, 1))
        apart += np.linalg.norm(relative[:, None, :3, 3] - relative[None, :, :3, 3], axis=-1)
        poses[b] = relative[np.argmin(np.median(apart, axis=1))] @ poses[a]
    return [poses[k] for k in range(len(names))]
