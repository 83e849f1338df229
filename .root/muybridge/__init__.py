"""Markerless motion capture from a few calibrated cameras.

The names below are the public interface (docs/reference/api-policy.md says what is stable); importing this package is
cheap, since each name is loaded when it is first used.

    import muybridge

    result = muybridge.capture("session")  # videos and a calibration in ...
    result.save("walk.bvh")                # ... motion out
"""

import lazy_loader as _lazy

__version__ = "0.1.0"

__getattr__, __dir__, _names = _lazy.attach_stub(__name__, __file__)
__all__ = [*_names, "__version__"]
