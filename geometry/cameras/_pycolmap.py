"""pycolmap without its handler for SIGTERM, which prints a stack trace when a process is asked to end, and can hang.

`from muybridge.geometry.cameras import _pycolmap as pycolmap` gives its names. It is slow to load, and videos are
opened without any lens: it is loaded when the first name is looked up, in any thread.
"""

import ctypes
import functools
import signal
from types import ModuleType
from typing import Any


def __getattr__(name: str) -> Any:
    if name.startswith("__"):
        raise AttributeError(name)
    return getattr(load(), name)


@functools.cache
def load() -> ModuleType:
    """Load pycolmap, if it is not."""
    # Python's own functions for handlers of the operating system: unlike `signal.signal`, they work in any thread.
    get, put = ctypes.pythonapi.PyOS_getsig, ctypes.pythonapi.PyOS_setsig
    get.restype = put.restype = ctypes.c_void_p
    put.argtypes = (ctypes.c_int, ctypes.c_void_p)
    before = get(signal.SIGTERM)
    import pycolmap

    put(signal.SIGTERM, before)
    return pycolmap
