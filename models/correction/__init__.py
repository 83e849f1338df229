"""The network that corrects bodies fitted to markers: its design, input and output."""

import lazy_loader as _lazy

__getattr__, __dir__, __all__ = _lazy.attach_stub(__name__, __file__)
