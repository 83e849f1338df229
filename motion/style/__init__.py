"""Styles: priors of poses learned from takes, and poses solved from a few goals in the style of those takes."""

import lazy_loader as _lazy

__getattr__, __dir__, __all__ = _lazy.attach_stub(__name__, __file__)
