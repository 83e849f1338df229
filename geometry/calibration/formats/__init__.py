"""Calibration formats of this and other programs: one module each, and the table that lists them."""

import lazy_loader as _lazy

__getattr__, __dir__, __all__ = _lazy.attach_stub(__name__, __file__)
