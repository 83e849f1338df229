"""Characters: a file's skeleton, meshes and clips; read, posed, and written back with one more clip."""

import lazy_loader as _lazy

__getattr__, __dir__, __all__ = _lazy.attach_stub(__name__, __file__)
