"""Skinning: meshes that follow joints, by several methods, and their results baked to linear blending."""

import lazy_loader as _lazy

__getattr__, __dir__, __all__ = _lazy.attach_stub(__name__, __file__)
