"""Calibration of cameras from views of a moved board: lenses one by one, chained poses, one adjustment of everything.

The cameras need not be exposed at the same time: see `muybridge.geometry.calibration.board.exposure_delay`.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from muybridge.arrays import FloatArray, IntArray
from muybridge.errors import CalibrationError
from muybridge.geometry.calibration.board.board import Board
from muybridge.geometry.calibration.board.exposure_delay import (
    FIRST_SPREAD,
    Delays,
    board_rates,
    next_delays,
    sway,
    world_rates,
)
from muybridge.geometry.calibration.board.intrinsics import (
    CORNER_SIGMA_PX,
    Lens,
    LensCalibration,
    View,
    board_pose,
    calibrate_lens,
    lens_prior,
    usable,
)
from muybridge.geometry.calibration.board.pose_graph import Chain, chain, symmetries
from muybridge.geometry.calibration.board.view_selection import choose_times
from muybridge.geometry.calibration.bundle_adjustment.adjustment import (
    AdjustProblem,
    AdjustResult,
    FreeCamera,
    adjust,
)
from muybridge.geometry.calibration.bundle_adjustment.result import CalibrationResult, solved
from muybridge.geometry.cameras.camera import Camera
from muybridge.geometry.cameras.group import CameraGroup

Views = Mapping[str, Mapping[int, View]]
"""Views of the board by camera and time (a whole number of time steps)."""
_ROUNDS = 8
_SETTLED = 0.05
_MISREAD_PX = 4.0


@dataclass(frozen=True)
class BoardOptions:
    """Options of the calibration from a board.

    Attributes:
        lens: `pinhole` with radial and tangential distortion, or `fisheye`.
        max_views: maximum number of times at which views are used, chosen for coverage.
        in_step: whether the cameras are exposed at the same time (a hardware trigger, or a board that stands still).
    """

    lens: Lens = "pinhole"
    max_views: int = 80
    in_step: bool = False

    def __post_init__(self) -> None:
        if self.max_views < 4:
            raise ValueError("max_views must be at least 4")


@dataclass(frozen=True)
class RigCalibration:
    """Cameras from a moved board.

    Attributes:
        solved: the cameras in the first camera's axes, residuals and uncertainties.
        board: the board.
        times: (B,) times at which it was seen.
        world_from_boards: (B, 3, 4) its poses, metres.
        delays: (C, B) exposure delay of each camera relative to the others, in time steps; NaN where the board was not
            seen, or by no other camera.
        delay_spread: standard deviation of the delays about each camera's mean; 0 with `in_step`.
        joined: (camera, camera, views): the pairs that connect the rig, and their number of shared views.
        unused: by camera, the number of views with too few corners or without the board.
    """

    solved: CalibrationResult
    board: Board
    times: IntArray
    world_from_boards: FloatArray
    delays: FloatArray
    delay_spread: float
    joined: tuple[tuple[str, str, int], ...]
    unused: Mapping[str, int]

    @property
    def cameras(self) -> CameraGroup:
        """The calibrated cameras."""
        return self.solved.cameras


def calibrate_rig(
    board: Board,
    views: Views,
    sizes: Mapping[str, tuple[int, int]],
    options: BoardOptions = BoardOptions(),
    known: CameraGroup | None = None,
    kept: int | None = None,
) -> RigCalibration:
    """Calibrate cameras that saw a moved board at the same times; the first camera defines the world.

    Args:
        board: the board.
        views: views by camera and by time.
        sizes: (width, height) px by camera.
        options: see `BoardOptions`.
        known: cameras with known lenses, which are kept; only poses are estimated then.
        kept: time at which the board's pose is required.

    Raises:
        CalibrationError: too few views of a camera, or a camera that shares no view with the rest (named); no view of
            the time `kept` that fits.
    """
    names = list(views)
    lenses, good, _ = _lenses(board, views, sizes, options, known)
    if kept is not None and not any(kept in mine for mine in good.values()):
        raise CalibrationError(f"moment {kept}: what was taken for the board does not fit the lenses; name another one")
    seen = [{t: board_pose(c, board, v) for t, v in good[c.name].items()} for c in lenses]
    found = chain(names, seen, board)
    rates = board_rates(_own_numbering(seen, found, board), board.corners.mean(axis=0))
    times = choose_times(good, sizes, options.max_views, kept)
    problem = _problem(board, good, lenses, found, times, known is not None)
    problem, result, of_views, delays = _adjust_swaying(problem, rates, times, options.in_step)
    turned = np.einsum("nij,nj->ni", result.bodies[problem.body, :, :3], problem.points[problem.point])
    world = turned + result.bodies[problem.body, :, 3]
    bodies = result.bodies.copy()
    bodies[:, :, 3] -= bodies[:, :, :3] @ board.corners.mean(axis=0)
    return RigCalibration(
        solved=solved(problem, result, np.array(times)[problem.body], world), board=board, times=np.array(times),
        world_from_boards=bodies, delays=of_views, delay_spread=delays.spread,
        joined=tuple((names[a], names[b], n) for a, b, n in found.joined),
        unused={n: len(views[n]) - len(good[n]) for n in names},
    )  # fmt: skip


def _lenses(
    board: Board, views: Views, sizes: Mapping[str, tuple[int, int]], options: BoardOptions, known: CameraGroup | None
) -> tuple[list[Camera], dict[str, dict[int, View]], list[LensCalibration]]:
    """Each camera's lens, the views that fit it, and its calibration where it was not known."""
    lenses: list[Camera] = []
    good: dict[str, dict[int, View]] = {}
    made: list[LensCalibration] = []
    for name in views:
        mine = {t: v for t, v in views[name].items() if usable(board, [v])}
        if known is None:
            few = choose_times({name: mine}, sizes, options.max_views)
            made.append(calibrate_lens(name, board, {t: mine[t] for t in few}, sizes[name], options.lens))
        lenses.append(made[-1].camera if known is None else known[name].posed(np.eye(4)[:3]))
        good[name] = _fitting(lenses[-1], board, mine)
    return lenses, good, made


def calibrate_lenses(
    board: Board, views: Views, sizes: Mapping[str, tuple[int, int]], options: BoardOptions = BoardOptions()
) -> CalibrationResult:
    """Calibrate lenses only, each from its own camera's views; all cameras have the identity pose.

    Args and errors as of `calibrate_rig`.
    """
    _, _, made = _lenses(board, views, sizes, options, None)
    counts = [len(m.result.residuals_px) for m in made]
    world = [
        np.concatenate([board.corners[v[0]] @ b[:, :3].T + b[:, 3] for v, b in zip(m.views.values(), m.result.bodies,
                                                                                   strict=True)])
        for m in made
    ]  # fmt: skip
    every = [(t, *v) for m in made for t, v in m.views.items()]
    return CalibrationResult(
        cameras=CameraGroup(tuple(m.camera for m in made)), camera=np.repeat(np.arange(len(made)), counts),
        time=np.concatenate([np.full(len(ids), t) for t, ids, _ in every]),
        point=np.concatenate([ids for _, ids, _ in every]), pixels=np.concatenate([px for _, _, px in every]),
        points_world=np.concatenate(world), residuals_px=np.concatenate([m.result.residuals_px for m in made]),
        weights=np.concatenate([m.result.weights for m in made]),
        covariances=tuple(m.result.covariances[0] for m in made),
        noise_px=float(np.median([m.noise_px for m in made])),
    )  # fmt: skip


def _fitting(lens: Camera, board: Board, views: Mapping[int, View]) -> dict[int, View]:
    """The views that fit a flat board."""
    out = {}
    for t, (ids, px) in views.items():
        pose = board_pose(lens, board, (ids, px))
        error = np.linalg.norm(lens.posed(pose[:3]).project(board.corners[ids]) - px, axis=1)
        if np.median(np.nan_to_num(error, nan=np.inf)) <= _MISREAD_PX:
            out[t] = (ids, px)
    if len(out) < 0.5 * len(views):
        raise CalibrationError(
            f"camera {lens.name}: {len(views) - len(out)} of {len(views)} views of the board do not fit its lens; "
            "was the lens calibrated at another zoom or image size?",
            remedy="lens_fisheye",
        )
    return out


def _own_numbering(seen: Sequence[Mapping[int, FloatArray]], found: Chain, board: Board) -> list[dict[int, FloatArray]]:
    """The board's poses with a consistent numbering of its corners."""
    turns = [s[0] for s in symmetries(board)]
    return [{t: p @ np.linalg.inv(turns[found.turns[c, t]]) for t, p in s.items()} for c, s in enumerate(seen)]


def _problem(
    board: Board, views: Views, lenses: Sequence[Camera], found: Chain, times: Sequence[int], held: bool
) -> AdjustProblem:
    """The adjustment problem at its initial values; the board rotates about its centre."""
    numbers = [s[1] for s in symmetries(board)]
    rows = [
        (c, b, numbers[found.turns[c, t]][views[camera.name][t][0]], views[camera.name][t][1])
        for c, camera in enumerate(lenses)
        for b, t in enumerate(times)
        if t in views[camera.name]
    ]
    middle = board.corners.mean(axis=0)
    bodies = np.stack([found.world_from_board[t][:3] for t in times])
    bodies[:, :, 3] += bodies[:, :, :3] @ middle
    lens = not held
    return AdjustProblem(
        cameras=CameraGroup(tuple(c.posed(p[:3]) for c, p in zip(lenses, found.poses, strict=True))),
        camera=np.concatenate([np.full(len(r[2]), r[0]) for r in rows]),
        point=np.concatenate([r[2] for r in rows]), pixels=np.concatenate([r[3] for r in rows]),
        sigma_px=np.full(sum(len(r[2]) for r in rows), CORNER_SIGMA_PX),
        points=board.corners - middle, points_free=np.zeros(len(board.corners), np.bool_),
        free=tuple(FreeCamera(lens, lens, lens, pose=c > 0) for c in range(len(lenses))),
        body=np.concatenate([np.full(len(r[2]), r[1]) for r in rows]), bodies=bodies,
        priors=tuple(lens_prior(c) for c in lenses) if lens else (),
    )  # fmt: skip


def _adjust_swaying(
    problem: AdjustProblem, rates: Sequence[Mapping[int, FloatArray]], times: Sequence[int], in_step: bool
) -> tuple[AdjustProblem, AdjustResult, FloatArray, Delays]:
    """Adjust all cameras, and estimate their exposure delays unless they are in step.

    Returns:
        The last problem, its result, (C, B) the delay of each shared view, and the distribution of the delays.
    """
    shape = len(problem.cameras), len(problem.bodies)
    has = np.zeros(shape, np.bool_)
    has[problem.camera, problem.body] = True
    shared = has & (has.sum(axis=0) > 1)
    delays = Delays(np.zeros(shape[0]), np.full(shape, FIRST_SPREAD), FIRST_SPREAD)
    in_step = in_step or not shared.any()
    free = problem.free
    problem = replace(problem, free=tuple(FreeCamera(pose=f.pose) for f in free), loss_sigma=20.0)
    for k in range(_ROUNDS):
        if not in_step:
            rotations = np.stack([c.rotation for c in problem.cameras])
            moves, expected = sway(world_rates(rates, rotations, times), delays)
            problem = replace(problem, sway=moves, sway_mean=expected)
        result = adjust(problem)
        before, of_views = delays, np.where(shared, 0.0, np.nan)
        if result.swayed is not None and result.swayed_variance is not None:
            of_views = np.where(shared, result.swayed[..., 0] * delays.views, np.nan)
            delays = next_delays(delays, result.swayed, result.swayed_variance, shared)
        if k > 1 and (in_step or k == _ROUNDS - 1 or abs(delays.spread / before.spread - 1) <= _SETTLED):
            break
        sigma = np.full(len(problem.pixels), max(result.noise * float(problem.sigma_px[0]), 0.05))
        problem = replace(
            problem, cameras=result.cameras, bodies=result.bodies, free=free, loss_sigma=4.0,
            sigma_px=sigma if k > 0 else problem.sigma_px,
        )  # fmt: skip
    return problem, result, of_views, before if not in_step else Delays(before.mean, before.views * 0, 0.0)
