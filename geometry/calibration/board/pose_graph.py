"""Relative poses of cameras, from the poses of a board that they saw at the same times.

Cameras are added one by one, each time the one that shares most views with those already added, so that cameras that
never see the board at the same time are chained. A checkerboard is symmetric under half a turn (a square one under a
quarter turn); each camera's numbering of its corners is resolved by the consistency of relative poses over time.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from muybridge.arrays import FloatArray, IntArray
from muybridge.errors import CalibrationError
from muybridge.geometry.calibration.board.board import Board
from muybridge.geometry.numerics.rotations import kabsch, log_so3

_MOST_SHARED = 60
_AGREE_RAD, _AGREE_SHARE, _SURE_SHARE, _MIRRORED_RAD = 0.5, 0.5, 0.7, 0.2
_AMBIGUOUS = 0.7
_MIRRORED = "its pictures are mirrored: they fit when flipped left to right; turn mirroring off in the camera"
_BACK = (
    "its views agree if it sees the board's back, with a second print whose markers have the same numbers; cover one "
    "side, or print a board with other numbers on it and calibrate with one of the two"
)
_UNPAIRED = (
    "check that the images of all cameras belong to the same moments (sync.toml, timestamps.csv, numbers of the "
    "images), and that no camera was moved"
)


@dataclass(frozen=True)
class Chain:
    """Initial poses of a rig.

    Attributes:
        poses: (C, 4, 4) cam_from_first.
        world_from_board: (4, 4) by time, with the board's own numbering.
        turns: by camera (index) and time, the one of `symmetries` that relates the camera's numbering to it.
        joined: (camera, to which, shared views) in the order of joining.
    """

    poses: FloatArray
    world_from_board: dict[int, FloatArray]
    turns: dict[tuple[int, int], int]
    joined: tuple[tuple[int, int, int], ...]


def symmetries(board: Board) -> list[tuple[FloatArray, IntArray]]:
    """Rotations that map a board's corners onto themselves.

    Returns:
        (4, 4) board_from_turned, and (K,) for each index in the rotated numbering the index in the board's own; the
        first is the identity. A ChArUco board has no other.
    """
    corners = board.corners
    out = [(np.eye(4), np.arange(len(corners)))]
    if board.kind == "charuco":
        return out
    middle = corners.mean(axis=0)
    quarter = np.array([[0.0, -1, 0], [1, 0, 0], [0, 0, 1]])
    turns = (quarter, quarter @ quarter, quarter.T) if board.columns == board.rows else (quarter @ quarter,)
    for turn in turns:
        moved = np.eye(4)
        moved[:3, :3], moved[:3, 3] = turn, middle - turn @ middle
        at = corners @ turn.T + moved[:3, 3]
        number = np.argmin(np.linalg.norm(at[:, None] - corners[None], axis=-1), axis=1)
        out.append((moved, number))
    return out


def chain(names: Sequence[str], seen: Sequence[Mapping[int, FloatArray]], board: Board) -> Chain:
    """Join cameras over their shared views.

    Args:
        names: of C cameras.
        seen: for each camera and time, (4, 4) cam_from_board, in the camera's own numbering of the corners.
        board: the board.

    Raises:
        CalibrationError: a camera shares no view with the rest, or its views contradict theirs (named).
    """
    turns = [s[0] for s in symmetries(board)]
    size = float(np.linalg.norm(np.ptp(board.corners, axis=0)))
    poses: dict[int, FloatArray] = {0: np.eye(4)}
    joined: list[tuple[int, int, int]] = []
    chosen = {(0, t): 0 for t in seen[0]}
    boards = {t: pose.copy() for t, pose in seen[0].items()}
    while len(poses) < len(names):
        left = [k for k in range(len(names)) if k not in poses]
        shared = {k: sorted(boards.keys() & seen[k].keys()) for k in left}
        new = max(left, key=lambda k: len(shared[k]))
        if not shared[new]:
            here, there = ([names[k] for k in group] for group in (sorted(poses), left))
            few, many = (here, there) if len(here) < len(there) else (there, here)
            raise CalibrationError(
                f"{', '.join(few)}: no view of the board is shared with {', '.join(many)}; show the board where both "
                "see it at the same time, or check that the frames are paired rightly"
            )
        partner = max(poses, key=lambda k: len(seen[k].keys() & seen[new].keys()))
        at = _spread(shared[new], _MOST_SHARED)
        poses[new] = _relative(names[new], [seen[new][t] for t in at], [boards[t] for t in at], turns, size)
        joined.append((new, partner, len(shared[new])))
        for t, pose in seen[new].items():
            world = np.linalg.inv(poses[new]) @ pose
            if t in boards:
                chosen[new, t] = int(np.argmin([_apart(world @ np.linalg.inv(s), boards[t], size) for s in turns]))
            else:
                chosen[new, t], boards[t] = 0, world
    return Chain(np.stack([poses[k] for k in range(len(names))]), boards, chosen, tuple(joined))


def _spread(times: list[int], most: int) -> list[int]:
    return [times[k] for k in np.unique(np.linspace(0, len(times) - 1, min(most, len(times))).astype(int))]


def _apart(a: FloatArray, b: FloatArray, size: float) -> float:
    """Difference of two poses: radians, or board sizes of translation."""
    turn = _angle(a[:3, :3], b[:3, :3])
    return float(turn + np.linalg.norm(a[:3, 3] - b[:3, 3]) / (2 * size))


def _relative(
    name: str, new: Sequence[FloatArray], boards: Sequence[FloatArray], turns: Sequence[FloatArray], size: float
) -> FloatArray:
    """(4, 4) camera_from_world on which most times agree, for any numbering of the board by the camera."""
    # candidate[t, g]: the camera's pose if its numbering of the board at t is rotated by g.
    candidate = [[n @ np.linalg.inv(s) @ np.linalg.inv(w) for s in turns] for n, w in zip(new, boards, strict=True)]
    flat = np.array(candidate).reshape(-1, 4, 4)
    cosine = np.einsum("nij,mij->nm", flat[:, :3, :3], flat[:, :3, :3])
    centers = -np.einsum("nji,nj->ni", flat[:, :3, :3], flat[:, :3, 3])
    turned = np.arccos(np.clip((cosine - 1) / 2, -1, 1))
    apart = turned + np.linalg.norm(centers[:, None] - centers, axis=-1) / (2 * size)
    groups = len(flat), len(new), len(turns)
    cost = np.median(apart.reshape(groups).min(axis=2), axis=1)
    best = int(np.argmin(cost))
    agree = float((turned.reshape(groups)[best].min(axis=1) < _AGREE_RAD).mean())
    if len(new) >= 3 and agree < _AGREE_SHARE:
        raise CalibrationError(
            f"camera {name}: where it stands comes out differently from view to view ({agree:.0%} of {len(new)} shared "
            f"views agree); {_explained(new, boards, turns)}"
        )
    if len(turns) > 1:
        other = apart[best] > 0.5
        if other.any():
            second = float(cost[other].min())
            if len(new) < 2 or second * _AMBIGUOUS < cost[best]:
                if len(new) >= 3 and _is_mirrored(new, boards):
                    raise CalibrationError(f"camera {name}: {_MIRRORED}")
                raise CalibrationError(
                    f"camera {name}: which way round the checkerboard is cannot be told, since it looks the same after "
                    f"half a turn and {len(new)} shared view(s) fit either way; turn and move the board more between "
                    "views, or use a ChArUco board"
                )
    return np.asarray(flat[best])


def _explained(new: Sequence[FloatArray], boards: Sequence[FloatArray], turns: Sequence[FloatArray]) -> str:
    """Why a camera's views may contradict those of the others."""
    if len(turns) > 1:
        return _MIRRORED if _is_mirrored(new, boards) else _UNPAIRED
    # Markers that are read are not mirrored; but a print on the back has the same numbers.
    front = _camera_turns(new, boards, np.eye(4))
    for axis in (0, 1):
        flip = np.diag([-1.0, -1.0, -1.0, 1.0])
        flip[axis, axis] = 1.0
        back = _camera_turns(new, boards, flip)
        # It may see both sides in turn.
        away = [[min(_angle(a, f), _angle(a, b)) for f, b in zip(front, back, strict=True)] for a in back]
        if (np.array(away) < _AGREE_RAD).mean(axis=1).max() >= _SURE_SHARE:
            return _BACK
    return _UNPAIRED


def _camera_turns(new: Sequence[FloatArray], boards: Sequence[FloatArray], flip: FloatArray) -> list[FloatArray]:
    """(3, 3) how a camera is turned by each view, if what it sees of the board is flipped."""
    return [(n @ flip @ np.linalg.inv(w))[:3, :3] for n, w in zip(new, boards, strict=True)]


def _angle(a: FloatArray, b: FloatArray) -> float:
    return float(np.linalg.norm(log_so3(a @ b.T)))


def _is_mirrored(new: Sequence[FloatArray], boards: Sequence[FloatArray]) -> bool:
    """Whether mirrored images explain a camera in which the board moves differently from the others."""
    flip = np.diag([-1.0, 1, 1])
    normals = np.stack([p[:3, 2] for p in new]), np.stack([p[:3, 2] for p in boards])
    plain = _mismatch(*normals)
    mirrored = _mismatch(normals[0] @ flip, normals[1])
    return mirrored < 0.5 * plain and mirrored < _MIRRORED_RAD


def _mismatch(a: FloatArray, b: FloatArray) -> float:
    """Median angle between directions that should be related by one rotation."""
    rotation = kabsch(a, b, np.ones(len(a)))
    return float(np.median(np.arccos(np.clip(((a @ rotation.T) * b).sum(axis=1), -1, 1))))
