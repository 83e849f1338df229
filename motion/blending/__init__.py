"""Several motions of one skeleton made into one: laid over each other on the ground, joined and blended."""

import lazy_loader as _lazy

__getattr__, __dir__, __all__ = _lazy.attach_stub(__name__, __file__)
