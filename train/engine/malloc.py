"""Memory that is kept once the system has given it.

A training step allocates a gigabyte and gives it back. By default the C library hands large blocks back to the system,
and the next step pays for every page of them anew: a tenth of a step where pages are dear, as in virtual machines.
"""

import ctypes
import sys

# Of glibc's malloc.h.
_TRIM_THRESHOLD, _MMAP_MAX = -1, -4


def keep_memory() -> bool:
    """Has this process keep what it frees, for itself; returns whether the C library could be told so (glibc's can).
    Processes that it starts decide for themselves."""
    if not sys.platform.startswith("linux"):
        return False
    mallopt = getattr(ctypes.CDLL(None), "mallopt", None)
    if mallopt is None:
        return False
    return bool(mallopt(_MMAP_MAX, 0) and mallopt(_TRIM_THRESHOLD, 2**31 - 1))
