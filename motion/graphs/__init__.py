"""Motion graphs: clips joined by transitions, and walks in them that last, follow a path or do what is listed."""

import lazy_loader as _lazy

__getattr__, __dir__, __all__ = _lazy.attach_stub(__name__, __file__)
