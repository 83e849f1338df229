"""A page that shows motion and characters, in one HTML file that opens without a network."""

import lazy_loader as _lazy

__getattr__, __dir__, __all__ = _lazy.attach_stub(__name__, __file__)
