"""`muybridge calibrate print-board`: a calibration board as a PDF file in true size."""

from pathlib import Path
from typing import Annotated, Literal

import tyro

from muybridge.errors import CalibrationError
from muybridge.files import replacing
from muybridge.geometry.calibration.board.pdf import PAPERS, board_pdf
from muybridge.infer.pipelines.calibration.board import BoardChoice
from muybridge.infer.results.ownership import check_replaceable


def print_board(
    out: Annotated[tyro.conf.Positional[Path], tyro.conf.arg(metavar="OUT.pdf")] = Path("board.pdf"),
    pattern: BoardChoice = BoardChoice(),  # noqa: B008 - frozen
    paper: Literal["a4", "a3", "a2", "a1", "a0", "letter", "tabloid", "fit"] = "a4",
    overwrite: bool = False,
) -> int:
    """Make a calibration board as a PDF file in true size, with a ruler to check the print.

    Example:
        muybridge calibrate print-board board.pdf --columns 7 --rows 5 --square 0.035

    Args:
        out: file to write.
        pattern: the calibration board; the same options describe it to `muybridge calibrate board`.
        paper: size of the page, turned as needed; `fit` for a page as large as the board needs.
        overwrite: replace OUT.pdf where muybridge did not write it.
    """
    board = pattern.board_described()
    text = board_pdf(board, None if paper == "fit" else PAPERS[paper])
    if out.suffix.lower() != ".pdf":
        raise CalibrationError(f"{out}: the board is written as a PDF; give a name that ends in .pdf")
    check_replaceable([out], overwrite)
    with replacing(out) as temporary:
        temporary.write_bytes(text)
    print(f"{out}: {board.describe()}, squares of {board.square * 1e3:g} mm")
    print("Print at 100 % (no fit to page), measure the ruler, and glue the sheet to something stiff and flat.")
    return 0
