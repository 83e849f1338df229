"""Motion-capture assisted animation: joints that nobody animated, and fine movement, from captured takes."""

import lazy_loader as _lazy

__getattr__, __dir__, __all__ = _lazy.attach_stub(__name__, __file__)
