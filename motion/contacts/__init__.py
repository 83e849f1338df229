"""Contacts of feet with the ground: finding them, and how much the feet slide in them."""

import lazy_loader as _lazy

__getattr__, __dir__, __all__ = _lazy.attach_stub(__name__, __file__)
