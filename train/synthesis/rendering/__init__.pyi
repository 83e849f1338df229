from .renderer import Render as Render
from .renderer import Renderer as Renderer
from .renderer import View as View
from .renderer import look_at as look_at
from .store import RenderSet as RenderSet
from .store import load_renders as load_renders
from .store import make_renders as make_renders

__all__ = [
    "Render",
    "RenderSet",
    "Renderer",
    "View",
    "load_renders",
    "look_at",
    "make_renders",
]
