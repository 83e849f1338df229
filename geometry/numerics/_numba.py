"""Compilation of numerical kernels, with the same settings everywhere."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from numba import njit
from numba.extending import register_jitable

# For what Python calls.
compiled = njit(cache=True, nogil=True, error_model="numpy")

# For what only kernels call. Compiled into each of them, without the entry from Python and the file in the cache that
# take half of the time that compiling takes. Python that calls it runs it as it stands.
subroutine = register_jitable(error_model="numpy", no_cfunc_wrapper=True)
# The same for what makes no arrays: no code that counts references to them.
leaf = register_jitable(error_model="numpy", no_cfunc_wrapper=True, _nrt=False)


def is_compiled(kernel: Any) -> bool:
    """Whether a kernel is in numba's cache, or cannot be: without a cache, compiling ahead is useless."""
    folder = getattr(getattr(kernel, "stats", None), "cache_path", None)
    module = kernel.__module__.rpartition(".")[2]
    return folder is None or any(Path(folder).glob(f"{module}.{kernel.__name__}-*.nbi"))
