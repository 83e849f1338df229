"""People who use things: posed by the places of what they sit on, hold or ride."""

import lazy_loader as _lazy

__getattr__, __dir__, __all__ = _lazy.attach_stub(__name__, __file__)
