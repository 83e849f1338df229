"""Motion matching: at every moment the frame of recorded takes that fits best goes on, so that a figure can be steered."""

import lazy_loader as _lazy

__getattr__, __dir__, __all__ = _lazy.attach_stub(__name__, __file__)
