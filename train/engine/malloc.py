"""Keep freed memory in the process.

A training step allocates a gigabyte and frees it. By default the C library returns large blocks to the operating
system, and the next step faults every page in again: a tenth of a step where page faults are expensive, as in virtual
machines.
"""

import ctypes
import sys

# From glibc's malloc.h.
_TRIM_THRESHOLD, _MMAP_MAX = -1, -4


def keep_memory() -> bool:
    """Make this process keep the memory that it frees; True if the C library supports it (glibc does).

    Child processes have to call it themselves.
    """
    if not sys.platform.startswith("linux"):
        return False
    mallopt = getattr(ctypes.CDLL(None), "mallopt", None)
    if mallopt is None:
        return False
    return bool(mallopt(_MMAP_MAX, 0) and mallopt(_TRIM_THRESHOLD, 2**31 - 1))
