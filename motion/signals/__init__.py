"""Motion as a signal: frequency bands with gains, and warps of movement and of time through key frames."""

import lazy_loader as _lazy

__getattr__, __dir__, __all__ = _lazy.attach_stub(__name__, __file__)
