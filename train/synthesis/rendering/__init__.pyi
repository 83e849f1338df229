from .labels import Render as Render
from .renderer import Renderer as Renderer
from .store import RenderSet as RenderSet
from .store import load_renders as load_renders
from .store import make_renders as make_renders
from .view import View as View
from .view import look_at as look_at

__all__ = [
    "Render",
    "RenderSet",
    "Renderer",
    "View",
    "load_renders",
    "look_at",
    "make_renders",
]
