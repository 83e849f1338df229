"""Files of points and of motion; `read_file` and `write_file` choose the format by the suffix."""

import lazy_loader as _lazy

__getattr__, __dir__, __all__ = _lazy.attach_stub(__name__, __file__)
