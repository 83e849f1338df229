from .data import Scene as Scene
from .data import read_scene as read_scene
from .page import render_page as render_page

__all__ = ["Scene", "read_scene", "render_page"]
