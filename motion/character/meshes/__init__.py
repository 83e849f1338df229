"""Meshes without a skeleton: read from files of all formats, and written with the skeleton that they get."""

import lazy_loader as _lazy

__getattr__, __dir__, __all__ = _lazy.attach_stub(__name__, __file__)
