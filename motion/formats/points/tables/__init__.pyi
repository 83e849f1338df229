from .layouts import LAYOUTS as LAYOUTS
from .layouts import Layout as Layout
from .layouts import read_layout as read_layout
from .sheet import Sheet as Sheet
from .sheet import read_sheet as read_sheet

__all__ = ["LAYOUTS", "Layout", "Sheet", "read_layout", "read_sheet"]
