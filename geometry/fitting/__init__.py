"""Fits of a body or of any skeleton to landmarks and to markers over a whole take."""

import lazy_loader as _lazy

__getattr__, __dir__, __all__ = _lazy.attach_stub(__name__, __file__)
