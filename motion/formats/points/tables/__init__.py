"""Tables of points: what separates cells, and the layouts of programs, one module each."""

import lazy_loader as _lazy

__getattr__, __dir__, __all__ = _lazy.attach_stub(__name__, __file__)
