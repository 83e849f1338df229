"""Robust triangulation of labelled 2D points, and what improves it: left-right flips, view bias, shape prior."""

import lazy_loader as _lazy

__getattr__, __dir__, __all__ = _lazy.attach_stub(__name__, __file__)
