"""Compilation of numerical kernels, with the same settings everywhere."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from numba import njit

compiled = njit(cache=True, nogil=True, error_model="numpy")
# For sums whose order does not matter: several products at a time. The result may differ in its last digits between
# processors.
compiled_sums = njit(cache=True, nogil=True, error_model="numpy", fastmath={"contract", "reassoc", "nsz"})


def is_compiled(kernel: Any) -> bool:
    """Whether a kernel is in numba's cache, or cannot be: without a cache, compiling ahead is useless."""
    folder = getattr(getattr(kernel, "stats", None), "cache_path", None)
    module = kernel.__module__.rpartition(".")[2]
    return folder is None or any(Path(folder).glob(f"{module}.{kernel.__name__}-*.nbi"))
