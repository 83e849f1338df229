"""Contacts of feet with the ground: finding them, planting the feet, and how much they slide."""

import lazy_loader as _lazy

__getattr__, __dir__, __all__ = _lazy.attach_stub(__name__, __file__)
