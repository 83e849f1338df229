"""Which joint of a skeleton is which part of a human body: by names, by the file's own table, or by geometry."""

import lazy_loader as _lazy

__getattr__, __dir__, __all__ = _lazy.attach_stub(__name__, __file__)
