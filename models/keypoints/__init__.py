"""The keypoint network: its design, the metadata of its files, and the decoding of its outputs."""

import lazy_loader as _lazy

__getattr__, __dir__, __all__ = _lazy.attach_stub(__name__, __file__)
