"""The layouts of tables that programs write, recognised by their contents: a layout is one module and one row."""

from collections.abc import Callable
from dataclasses import dataclass

from muybridge.errors import FormatError, parsing
from muybridge.motion.formats.points.tables import anipose, deeplabcut, motive, nexus, qualisys
from muybridge.motion.formats.points.tables.sheet import Sheet
from muybridge.motion.formats.points.world import Trajectories


@dataclass(frozen=True)
class Layout:
    """How a program lays out its tables.

    Attributes:
        program: its name.
        matches: whether a table looks like the program's.
        read: the points of such a table; `fps` overrides the file.
    """

    program: str
    matches: Callable[[Sheet], bool]
    read: Callable[[Sheet, float | None], Trajectories]


LAYOUTS = (
    Layout("Vicon Nexus", nexus.matches, nexus.read),
    Layout("Qualisys QTM", qualisys.matches, qualisys.read),
    Layout("OptiTrack Motive", motive.matches, motive.read),
    Layout("DeepLabCut", deeplabcut.matches, deeplabcut.read),
    Layout("Anipose", anipose.matches, anipose.read),
)


def read_layout(sheet: Sheet, fps: float | None) -> Trajectories | None:
    """The points of a table that a known program wrote; None where its layout is of none.

    Raises:
        FormatError: the table is damaged, or holds something else than points; the message names the program.
    """
    for layout in LAYOUTS:
        if layout.matches(sheet):
            with parsing(sheet.path, FormatError, f"a table of {layout.program}"):
                return layout.read(sheet, fps)
    return None
