from .folder import OutputFolder as OutputFolder
from .folder import open_output as open_output
from .overlay import OverlayOptions as OverlayOptions
from .overlay import write_overlay as write_overlay
from .overlay_drawing import OverlayData as OverlayData
from .overlay_drawing import draw_overlay as draw_overlay
from .record import RunRecord as RunRecord
from .record import read_schema as read_schema
from .run import Run as Run

__all__ = [
    "OutputFolder",
    "OverlayData",
    "OverlayOptions",
    "Run",
    "RunRecord",
    "draw_overlay",
    "open_output",
    "read_schema",
    "write_overlay",
]
