"""Association of the cameras' detections to people, and the selection of the person of interest."""

import lazy_loader as _lazy

__getattr__, __dir__, __all__ = _lazy.attach_stub(__name__, __file__)
