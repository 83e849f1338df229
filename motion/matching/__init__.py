"""Motion matching: a figure is steered by going on, at any moment, with the frame of recorded takes that fits best."""

import lazy_loader as _lazy

__getattr__, __dir__, __all__ = _lazy.attach_stub(__name__, __file__)
