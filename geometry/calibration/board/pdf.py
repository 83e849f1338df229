"""A calibration board as a PDF page at true size; the PDF is written directly."""

from __future__ import annotations

import cv2
import numpy as np

from muybridge.arrays import FloatArray
from muybridge.errors import CalibrationError
from muybridge.geometry.calibration.board.board import Board

PAPERS = {
    "a4": (0.210, 0.297), "a3": (0.297, 0.420), "a2": (0.420, 0.594), "a1": (0.594, 0.841), "a0": (0.841, 1.189),
    "letter": (0.2159, 0.2794), "tabloid": (0.2794, 0.4318),
}  # fmt: skip
"""Width and height of pages, metres."""
_POINTS = 72 / 0.0254
_MARGIN, _FOOT, _RULER = 0.008, 0.012, 0.1


def board_rectangles(board: Board) -> tuple[FloatArray, tuple[float, float]]:
    """The black rectangles of a board (of an inverted one: those of its negative).

    Returns:
        (N, 4) x, y, width, height in metres, y downwards from the top-left corner of the outermost square; and the
        board's width and height.
    """
    more = 0 if board.kind == "charuco" else 1
    columns, rows, s = board.columns + more, board.rows + more, board.square
    black: list[tuple[float, float, float, float]] = []
    if board.kind == "checkerboard":
        black = [(c * s, r * s, s, s) for r in range(rows) for c in range(columns) if (r + c) % 2 == 0]
        return np.array(black), (columns * s, rows * s)
    dictionary = cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, board.dictionary))
    made = board.charuco()
    white = set()
    cells = dictionary.markerSize + 2
    for corners, number in zip(made.getObjPoints(), np.ravel(made.getIds()), strict=True):
        x, y = np.asarray(corners).reshape(4, 3)[:, :2].min(axis=0)
        white.add((int(x / s), int(y / s)))
        bits = cv2.aruco.generateImageMarker(dictionary, int(number), cells) == 0
        cell = s * board.marker_share / cells
        black += [(x + i * cell, y + j * cell, cell, cell) for j, i in np.argwhere(bits)]
    black += [(c * s, r * s, s, s) for r in range(rows) for c in range(columns) if (c, r) not in white]
    return np.array(black), (columns * s, rows * s)


def board_pdf(board: Board, paper: tuple[float, float] | None = None) -> bytes:
    """A PDF with the board in the middle of a page, its description below, and a ruler of 100 mm.

    Args:
        board: the board.
        paper: (width, height) metres, rotated where that fits better; None for a page as large as needed.

    Raises:
        CalibrationError: the page is too small, or the dictionary has too few markers.
    """
    try:
        black, size = board_rectangles(board)
    except cv2.error as error:
        raise CalibrationError(f"no such board can be drawn ({error.err}); take a larger dictionary") from None
    quiet = max(_MARGIN, 0.25 * board.square if board.inverted else 0.0)
    need = (max(size[0], _RULER) + 2 * quiet, size[1] + 2 * quiet + _FOOT)
    page = need if paper is None else paper
    if need[0] <= page[1] and need[1] <= page[0] and not (need[0] <= page[0] and need[1] <= page[1]):
        page = (page[1], page[0])
    if need[0] > page[0] + 1e-9 or need[1] > page[1] + 1e-9:
        raise CalibrationError(
            f"the board needs {need[0] * 1e3:.0f} x {need[1] * 1e3:.0f} mm with its margin and text, the page has "
            f"{page[0] * 1e3:.0f} x {page[1] * 1e3:.0f} mm",
            remedy="board_page",
        )
    left, top = (page[0] - size[0]) / 2, (page[1] - _FOOT - size[1]) / 2
    return _document(page, _content(board, black, size, (left, top), page))


def _content(
    board: Board, black: FloatArray, size: tuple[float, float], at: tuple[float, float], page: tuple[float, float]
) -> bytes:
    """The drawing of the page, in points from the bottom left."""
    lines: list[str] = []

    def rectangle(x: float, y: float, w: float, h: float) -> None:
        x0, y1 = round(x * _POINTS, 4), round((page[1] - y) * _POINTS, 4)
        w0, h0 = round(w * _POINTS, 4), round(h * _POINTS, 4)
        lines.append(f"{x0:.4f} {y1 - h0:.4f} {w0:.4f} {h0:.4f} re")

    if board.inverted:
        border = 0.2 * board.square
        rectangle(at[0] - border, at[1] - border, size[0] + 2 * border, size[1] + 2 * border)
        lines.append("0 g f\n1 g")
    for x, y, w, h in _merge_rectangles(black):
        rectangle(at[0] + x, at[1] + y, w, h)
    lines.append("f\n0 g")
    foot = page[1] - _FOOT
    for k in range(11):  # ticks, and the line that joins them
        rectangle(_MARGIN + k * 0.01, foot, 0.0002, 0.003 if k % 5 else 0.004)
    rectangle(_MARGIN, foot, _RULER, 0.0002)
    lines.append("f")
    words = f"{board.describe()}   square {board.square * 1e3:g} mm"
    if board.kind == "charuco":
        words += f"   marker {board.square * board.marker_share * 1e3:g} mm"
    words += "   ruler above: 100 mm   print at 100 %"
    y = (page[1] - foot - 0.0075) * _POINTS
    size_pt = min(7.0, (page[0] - 2 * _MARGIN) * _POINTS / (0.52 * len(words)))
    lines.append(f"BT /F1 {size_pt:.2f} Tf {_MARGIN * _POINTS:.2f} {y:.2f} Td ({words}) Tj ET")
    return "\n".join(lines).encode("latin-1")


def _merge_rectangles(black: FloatArray) -> FloatArray:
    """Rectangles with adjoining ones in a row merged, so that viewers draw no thin lines between them."""
    out: list[list[float]] = []
    for x, y, w, h in sorted(black.tolist(), key=lambda b: (round(b[3], 9), round(b[1], 9), b[0])):
        last = out[-1] if out else None
        if last and abs(last[1] - y) < 1e-9 and abs(last[3] - h) < 1e-9 and abs(last[0] + last[2] - x) < 1e-9:
            last[2] += w
        else:
            out.append([x, y, w, h])
    return np.array(out)


def _document(page: tuple[float, float], content: bytes) -> bytes:
    """A PDF 1.4 of one page."""
    box = f"[0 0 {page[0] * _POINTS:.4f} {page[1] * _POINTS:.4f}]"
    objects = [
        b"<< /Type /Catalog /Pages 2 0 R /ViewerPreferences << /PrintScaling /None >> >>",
        b"<< /Type /Pages /Kids [3 0 R] /Count 1 >>",
        (
            f"<< /Type /Page /Parent 2 0 R /MediaBox {box} /Contents 4 0 R /Resources << /Font << /F1 5 0 R >> >> >>"
        ).encode(),
        b"<< /Length %d >>\nstream\n%s\nendstream" % (len(content), content),
        b"<< /Type /Font /Subtype /Type1 /BaseFont /Helvetica >>",
    ]
    out = b"%PDF-1.4\n%\xe2\xe3\xcf\xd3\n%muybridge\n"
    offsets = []
    for number, body in enumerate(objects, start=1):
        offsets.append(len(out))
        out += b"%d 0 obj\n%s\nendobj\n" % (number, body)
    start = len(out)
    out += b"xref\n0 %d\n0000000000 65535 f \n" % (len(objects) + 1)
    out += b"".join(b"%010d 00000 n \n" % o for o in offsets)
    return out + b"trailer\n<< /Size %d /Root 1 0 R >>\nstartxref\n%d\n%%%%EOF\n" % (len(objects) + 1, start)
