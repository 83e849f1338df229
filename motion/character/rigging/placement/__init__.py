"""Where the joints of each template are, from the landmarks of a body or from its volume."""

import lazy_loader as _lazy

__getattr__, __dir__, __all__ = _lazy.attach_stub(__name__, __file__)
