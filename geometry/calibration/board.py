"""Calibration boards: what they are, and their corners found in an image."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
_SEARCH_PX = 1000


@dataclass(frozen=True)
class Board:
    """A flat board of squares.

    Attributes:
        kind: "charuco" or "checkerboard".
        columns: squares along x for ChArUco, inner corners for a checkerboard, as makers count them.
        rows: the same along y.
        square: side of a square, metres.
        marker_share: side of a marker over that of a square (ChArUco).
        dictionary: OpenCV's name of the markers' dictionary, e.g. "DICT_4X4_50".
        inverted: printed white on black.
        legacy: ChArUco pattern of OpenCV before 4.6 (differs where `rows` is even).
    """

    kind: str
    columns: int
    rows: int
    square: float
    marker_share: float = 0.75
    dictionary: str = "DICT_4X4_50"
    inverted: bool = False
    legacy: bool = False

    def __post_init__(self) -> None:
        if self.kind not in ("charuco", "checkerboard"):
            raise ValueError(f"board kind must be charuco or checkerboard, not {self.kind!r}")
        if min(self.columns, self.rows) < 2 or not self.square > 0 or not 0 < self.marker_share < 1:
            raise ValueError("a board has at least 2 x 2, squares of positive size (metres), smaller markers")
        if self.kind == "charuco" and not hasattr(cv2.aruco, self.dictionary):
            raise ValueError(f"OpenCV has no marker dictionary {self.dictionary!r}; try DICT_4X4_50")

    @property
    def corners(self) -> Floats:
        """(K, 3) inner corners, metres, row by row, z = 0."""
        less = 1 if self.kind == "charuco" else 0
        x, y = np.meshgrid(np.arange(self.columns - less), np.arange(self.rows - less))
        return np.stack([x.ravel(), y.ravel(), np.zeros(x.size)], axis=1) * self.square

    def describe(self) -> str:
        """In words, for messages."""
        extra = f", {self.dictionary}" if self.kind == "charuco" else ""
        words = [w for w, on in (("inverted", self.inverted), ("legacy pattern", self.legacy)) if on]
        return f"{self.kind} {self.columns} x {self.rows}{extra}" + "".join(f", {w}" for w in words)


class BoardDetector:
    """Finds a board's inner corners in images."""

    def __init__(self, board: Board):
        self.board = board
        self._charuco: Any = None
        if board.kind == "charuco":
            dictionary = cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, board.dictionary))
            size = (board.columns, board.rows)
            made = cv2.aruco.CharucoBoard(size, board.square, board.square * board.marker_share, dictionary)
            made.setLegacyPattern(board.legacy)
            self._charuco = cv2.aruco.CharucoDetector(made)

    def detect(self, gray: NDArray[np.uint8]) -> tuple[NDArray[np.int64], Floats]:
        """(n,) numbers of the corners seen and (n, 2) px; empty where there is no board."""
        image = 255 - gray if self.board.inverted else gray
        if self._charuco is not None:
            px, ids = self._charuco.detectBoard(image)[:2]
            if ids is None or len(ids) == 0:
                return np.zeros(0, np.int64), np.zeros((0, 2))
            return ids.reshape(-1).astype(np.int64), px.reshape(-1, 2).astype(float)
        px = find_checkerboard(image, self.board.columns, self.board.rows)
        return (np.arange(len(px)) if len(px) else np.zeros(0, np.int64)), px


def find_checkerboard(gray: NDArray[np.uint8], columns: int, rows: int) -> Floats:
    """(columns rows, 2) px of the inner corners, row by row from either end; (0, 2) where there is no such board.

    Found in a reduced image, which is several times as fast and misses less, then measured in the full one.
    """
    size = (columns, rows)
    scale = min(1.0, _SEARCH_PX / max(gray.shape))
    small = gray if scale == 1.0 else cv2.resize(gray, None, fx=scale, fy=scale, interpolation=cv2.INTER_AREA)
    found, px = cv2.findChessboardCornersSB(small, size, None, cv2.CALIB_CB_EXHAUSTIVE)
    if not found:
        return np.zeros((0, 2))
    px = (px.reshape(-1, 2).astype(float) + 0.5) / scale - 0.5
    if scale == 1.0:
        return px
    margin = 1.6 * np.ptp(px, axis=0).max() / (min(size) - 0.5)
    low = np.maximum(px.min(axis=0) - margin, 0).astype(int)
    high = np.minimum(px.max(axis=0) + margin + 1, np.array(gray.shape[::-1])).astype(int)
    window = np.ascontiguousarray(gray[low[1] : high[1], low[0] : high[0]])
    found, fine = cv2.findChessboardCornersSB(window, size, None, cv2.CALIB_CB_EXHAUSTIVE)
    if not found:
        return px
    fine = fine.reshape(-1, 2).astype(float) + low
    for candidate in (fine, fine[::-1]):
        if np.abs(candidate - px).max() < 2.0 / scale:
            return np.asarray(candidate)
    return px


def fitting_descriptions(board: Board, images: list[NDArray[np.uint8]]) -> list[str]:
    """Variants of a description under which the board is found in images where it is not found as described."""
    variants = [replace(board, columns=board.rows, rows=board.columns), replace(board, inverted=not board.inverted)]
    if board.kind == "charuco":
        names = ("DICT_4X4_1000", "DICT_5X5_1000", "DICT_6X6_1000", "DICT_7X7_1000")
        variants += [replace(board, legacy=not board.legacy), *(replace(board, dictionary=n) for n in names)]
    found = [v.describe() for v in variants if any(len(BoardDetector(v).detect(i)[0]) >= 4 for i in images)]
    detector = BoardDetector(board)
    if any(len(detector.detect(np.ascontiguousarray(i[:, ::-1]))[0]) >= 4 for i in images):
        found.append("the same board, but the images are mirrored")
    return found
