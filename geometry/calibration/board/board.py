"""Calibration boards, and the detection of their corners in images."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, replace
from typing import Any

import cv2
import numpy as np

from muybridge.arrays import ByteArray, FloatArray, IntArray

_SEARCH_PX = 1000
_LARGER = cv2.CALIB_CB_EXHAUSTIVE | cv2.CALIB_CB_LARGER
# The first markers of a family's dictionaries are identical, and no board has more than 250.
_FAMILIES = ("DICT_4X4_250", "DICT_5X5_250", "DICT_6X6_250", "DICT_7X7_250", "DICT_ARUCO_ORIGINAL",
             "DICT_APRILTAG_16H5", "DICT_APRILTAG_25H9", "DICT_APRILTAG_36H11")  # fmt: skip
_SMALLER = (50, 100, 250)
_SURE_CORNERS = 6
_CLOSELY, _FIRSTS = 4, 8


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
        first_marker: number of the first marker (ChArUco); a set of boards has consecutive numbers.
        thickness: of a ChArUco board whose back has the mirrored print, metres, so that each corner lies behind that of
            the front; None for a board with one face.
    """

    kind: str
    columns: int
    rows: int
    square: float
    marker_share: float = 0.75
    dictionary: str = "DICT_4X4_50"
    inverted: bool = False
    legacy: bool = False
    first_marker: int = 0
    thickness: float | None = None

    def __post_init__(self) -> None:
        if self.kind not in ("charuco", "checkerboard"):
            raise ValueError(f"board kind must be charuco or checkerboard, not {self.kind!r}")
        if min(self.columns, self.rows) < 2 or not self.square > 0 or not 0 < self.marker_share < 1:
            raise ValueError("a board has at least 2 x 2, squares of positive size (metres), smaller markers")
        if self.first_marker < 0 or (self.thickness is not None and not 0 <= self.thickness < 1):
            raise ValueError("the first marker's number is 0 or more, a board's thickness 0 to 1 m")
        known = self.dictionary.startswith("DICT_") and isinstance(getattr(cv2.aruco, self.dictionary, None), int)
        if self.kind == "charuco" and not known:
            raise ValueError(f"OpenCV has no marker dictionary {self.dictionary!r}; try DICT_4X4_50")

    @property
    def corners(self) -> FloatArray:
        """(K, 3) inner corners, metres, row by row, z = 0; of a board with two faces those of its back after them."""
        less = 1 if self.kind == "charuco" else 0
        x, y = np.meshgrid(np.arange(self.columns - less), np.arange(self.rows - less))
        corners = np.stack([x.ravel(), y.ravel(), np.zeros(x.size)], axis=1).astype(np.float64)
        front = np.asarray(corners * self.square)
        return front if self.thickness is None else np.concatenate([front, front + [0.0, 0.0, self.thickness]])

    @property
    def markers(self) -> range:
        """The numbers of a ChArUco board's markers."""
        return range(self.first_marker, self.first_marker + self.columns * self.rows // 2)

    def charuco(self) -> Any:
        """OpenCV's board with a square of side 1 times `square`."""
        dictionary = cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, self.dictionary))
        size, marker = (self.columns, self.rows), self.square * self.marker_share
        made = cv2.aruco.CharucoBoard(size, self.square, marker, dictionary, np.array(self.markers, dtype=np.int32))
        made.setLegacyPattern(self.legacy)
        return made

    def describe(self) -> str:
        """Description for messages."""
        extra = f", {self.dictionary}" if self.kind == "charuco" else ""
        words = [w for w, on in self._traits() if on]
        return f"{self.kind} {self.columns} x {self.rows}{extra}" + "".join(f", {w}" for w in words)

    def _traits(self) -> tuple[tuple[str, bool], ...]:
        return (
            ("inverted", self.inverted), ("legacy pattern", self.legacy),
            (f"markers from {self.first_marker}", self.first_marker > 0), ("two faces", self.thickness is not None),
        )  # fmt: skip


class BoardDetector:
    """Detects a board's inner corners in images."""

    def __init__(self, board: Board):
        self.board = board
        self._charuco: Any = None
        if board.kind == "charuco":
            self._charuco = cv2.aruco.CharucoDetector(board.charuco())

    def detect(self, gray: ByteArray) -> tuple[IntArray, FloatArray]:
        """(n,) indices of the visible corners and (n, 2) px; empty where there is no board."""
        image = 255 - gray if self.board.inverted else gray
        if self._charuco is not None:
            ids, px = self._corners(image)
            if self.board.thickness is not None and len(ids) < _SURE_CORNERS:
                back, there = self._corners(np.ascontiguousarray(image[:, ::-1]))
                if len(back) > len(ids):
                    there[:, 0] = image.shape[1] - 1 - there[:, 0]
                    return back + len(self.board.corners) // 2, there
            return ids, px
        px = find_checkerboard(image, self.board.columns, self.board.rows)
        return (np.arange(len(px)) if len(px) else np.zeros(0, np.int64)), px

    def _corners(self, image: ByteArray) -> tuple[IntArray, FloatArray]:
        """Corners of a ChArUco board."""
        px, ids = self._charuco.detectBoard(image)[:2]
        if ids is None or len(ids) == 0:
            return np.zeros(0, np.int64), np.zeros((0, 2))
        return ids.reshape(-1).astype(np.int64), px.reshape(-1, 2).astype(float)


def find_checkerboard(gray: ByteArray, columns: int, rows: int) -> FloatArray:
    """(columns rows, 2) px of the inner corners, row by row from either end; (0, 2) where there is no such board.

    Detected in a reduced image, which is several times faster and more reliable, then located in the full one.
    """
    size = (columns, rows)
    small, scale = _reduce(gray)
    # A larger board contains the described one at several positions; that is not the described board.
    found, px, meta = cv2.findChessboardCornersSBWithMeta(small, size, _LARGER)
    if not found or meta.shape != (rows, columns):
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


def _reduce(gray: ByteArray) -> tuple[ByteArray, float]:
    """An image of at most `_SEARCH_PX`, and its scale."""
    scale = min(1.0, _SEARCH_PX / max(gray.shape))
    if scale == 1.0:
        return gray, scale
    return cv2.resize(gray, None, fx=scale, fy=scale, interpolation=cv2.INTER_AREA).astype(np.uint8, copy=False), scale


def fitting_descriptions(board: Board, images: list[ByteArray]) -> list[str]:
    """Descriptions under which clearly more corners are found than under the given one, best first.

    Args:
        board: the given description.
        images: some pictures, grayscale; those with most markers are examined in detail.
    """
    images = _telling(images)
    tried = _charuco_variants(board, images) if board.kind == "charuco" else []
    if not tried and (board.kind == "checkerboard" or seen_markers(board, images) is None):
        tried += [(v, False) for v in _checkerboards(board, images)]
    if board.kind == "checkerboard" and not tried:
        tried += _charuco_variants(Board("charuco", board.columns + 1, board.rows + 1, board.square), images)
    had = _count_corners(board, images)
    counts = {}
    for variant, mirrored in tried:
        shown = [np.ascontiguousarray(i[:, ::-1]) for i in images] if mirrored else images
        words = variant.describe() + (", its pictures mirrored left to right" if mirrored else "")
        counts[words] = _count_corners(variant, shown)
    best = max(counts.values(), default=0)
    good = [w for w, n in sorted(counts.items(), key=lambda c: -c[1]) if n >= max(0.9 * best, 1.2 * had, 4)]
    return [w for w in good if w != board.describe()][:3]


def _telling(images: list[ByteArray]) -> list[ByteArray]:
    """The few pictures with most markers of any family, mirrored or not."""
    if len(images) <= _CLOSELY:
        return images
    counts = []
    for image in images:
        small = _reduce(image)[0]
        shown = [small, 255 - small, np.ascontiguousarray(small[:, ::-1]), np.ascontiguousarray(255 - small[:, ::-1])]
        counts.append(max(len(_markers(name, [one])) for name in _FAMILIES for one in shown))
    if max(counts) < 2:  # none: any picture may contain a checkerboard
        return [images[k] for k in np.linspace(0, len(images) - 1, _CLOSELY).round().astype(int)]
    return [images[k] for k in sorted(np.argsort(counts, kind="stable")[-_CLOSELY:])]


def _count_corners(board: Board, images: list[ByteArray]) -> int:
    """Number of corners that lie on a plane, in neighbouring positions."""
    detector, total = BoardDetector(board), 0
    for image in images:
        ids, px = detector.detect(image)
        if len(ids) >= 4 and board.kind == "charuco":
            # With a wrong layout corners are found as well, but they lie on no plane.
            flat, fits = cv2.findHomography(board.corners[ids][:, :2], px, cv2.RANSAC, 0.02 * np.ptp(px, axis=0).max())
            total += int(fits.sum()) if flat is not None else 0
        else:
            total += len(ids)
    return total


def seen_markers(board: Board, images: list[ByteArray]) -> range | None:
    """The numbers, from lowest to highest, of the markers of the board's family in pictures; None if there are none."""
    family = board.dictionary.rsplit("_", 1)[0]
    name = next((f for f in _FAMILIES if f.rsplit("_", 1)[0] == family), board.dictionary)
    ids = _often(_markers(name, [_reduce(255 - i if board.inverted else i)[0] for i in images]))
    return range(min(ids), max(ids) + 1) if len(ids) > 1 else None


def _often(ids: list[int]) -> list[int]:
    """Numbers without those that are seen much more rarely than others, which are false detections."""
    counts = Counter(ids)
    return [i for i, n in counts.items() if n >= 0.3 * max(counts.values())]


def _charuco_variants(board: Board, images: list[ByteArray]) -> list[tuple[Board, bool]]:
    """ChArUco boards whose markers are in the images, and whether these are mirrored."""
    polarities = (board.inverted, not board.inverted)
    for mirrored, inverted in [(m, i) for m in (False, True) for i in polarities]:
        shown = [_reduce(255 - i if inverted else i)[0] for i in images]
        shown = [np.ascontiguousarray(i[:, ::-1]) for i in shown] if mirrored else shown
        ids, name = max(((_markers(name, shown), name) for name in _FAMILIES), key=lambda c: len(c[0]))
        if len(ids) < 2:
            continue
        found = _layouts(board, name, inverted, int(max(ids)) + 1) + _numbered(board, name, inverted, _often(ids))
        full = [np.ascontiguousarray(i[:, ::-1]) for i in images] if mirrored else images
        if any(_count_corners(v, full) >= _SURE_CORNERS for v in found):  # not only false detections of markers
            return [(v, mirrored) for v in found]
    return []


def _markers(name: str, images: list[ByteArray]) -> list[int]:
    """Numbers of a family's detected markers, with repetitions."""
    detector = cv2.aruco.ArucoDetector(cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, name)))
    found = [detector.detectMarkers(image)[1] for image in images]
    return [int(i) for ids in found if ids is not None for i in np.ravel(ids)]


def _layouts(board: Board, family: str, inverted: bool, markers: int) -> list[Board]:
    """Boards of a marker family, with the number of detected markers, or of the described size."""
    sizes = {(board.columns, board.rows), (board.rows, board.columns)}
    sizes |= {(c, r) for c in range(3, 25) for r in range(3, 25) if c * r // 2 == markers and c < 3 * r and r < 3 * c}
    name = board.dictionary if board.dictionary.rsplit("_", 1)[0] == family.rsplit("_", 1)[0] else family
    if name == family and family.endswith("_250"):
        stem = family.rsplit("_", 1)[0]
        name = next(f"{stem}_{n}" for n in _SMALLER if n >= markers)
    kept = replace(board, dictionary=name, inverted=inverted)
    out = [replace(kept, columns=c, rows=r) for c, r in sorted(sizes) if c * r // 2 >= markers]
    return out + [replace(b, legacy=not b.legacy) for b in out if b.rows % 2 == 0]


def _numbered(board: Board, family: str, inverted: bool, ids: list[int]) -> list[Board]:
    """The described board with other numbers of its markers, such that it has all that were seen."""
    if not ids or board.dictionary.rsplit("_", 1)[0] != family.rsplit("_", 1)[0]:
        return []
    firsts = range(max(0, max(ids) - len(board.markers) + 1), min(ids) + 1)
    return [replace(board, inverted=inverted, first_marker=f) for f in firsts if f != board.first_marker][-_FIRSTS:]


def _checkerboards(board: Board, images: list[ByteArray]) -> list[Board]:
    """Checkerboards of any size that are in the images."""
    found = []
    for image in images:
        for inverted in (False, True):
            small, _ = _reduce(255 - image if inverted else image)
            ok, _, meta = cv2.findChessboardCornersSBWithMeta(small, (3, 3), _LARGER)
            if ok:
                rows, columns = meta.shape
                if (columns < rows) != (board.columns < board.rows):
                    columns, rows = rows, columns
                found.append(Board("checkerboard", columns, rows, board.square, inverted=inverted))
                break
    return sorted(set(found), key=lambda b: -found.count(b))[:2]
