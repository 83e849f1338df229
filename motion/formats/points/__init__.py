"""Points and markers as C3D, TRC, tables, NPZ and Parquet, and sets of markers."""

import lazy_loader as _lazy

__getattr__, __dir__, __all__ = _lazy.attach_stub(__name__, __file__)
