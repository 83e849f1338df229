"""Skeletons for meshes that have none: where the joints of a body are, found from its shape alone."""

import lazy_loader as _lazy

__getattr__, __dir__, __all__ = _lazy.attach_stub(__name__, __file__)
