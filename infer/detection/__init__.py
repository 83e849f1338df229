"""2D landmarks of the people in each camera's video, and bright markers in images."""

import lazy_loader as _lazy

__getattr__, __dir__, __all__ = _lazy.attach_stub(__name__, __file__)
